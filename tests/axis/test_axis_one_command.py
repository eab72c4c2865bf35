"""Joints that one command moves: nothing tells whose an effort is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cascade import forearm

from pianobot_ros.axis.commissioning.around.arm import coupling
from pianobot_ros.axis.commissioning.around.neighbours import with_neighbours
from pianobot_ros.axis.commissioning.around.other_joints import TOLD, told
from pianobot_ros.axis.signals.cleaning import Clean, clean

NAMES = ("shoulder", "elbow")


def together(seed: int) -> Clean:
    """An arm whose shoulder follows the elbow's command, a little later and by another factor."""
    log = forearm(seed, 0.0)
    assert log.command is not None
    late, share = 1 + seed % 5, (1.0, -1.0, 0.6, -1.6)[seed % 4]
    return clean(replace(log, others={"shoulder": 0.3 + share * np.roll(log.command, late)}))


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_joints_with_a_command_of_their_own_are_told_apart(seed):
    c = clean(forearm(seed, 0.0))
    assert not told([c], "shoulder")
    assert coupling([c], "elbow", NAMES) == {"shoulder": 1.0}


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_of_joints_that_one_command_moves_none_is_asked(seed):
    c = together(seed)
    assert told([c], "shoulder")
    assert coupling([c], "elbow", NAMES) == {}
    assert with_neighbours([c])[1] == ""


def test_the_limit_lies_between_both_kinds(monkeypatch):
    """By a factor of two to either side at least."""
    room = "pianobot_ros.axis.commissioning.around.other_joints.TOLD"
    for factor in (0.5, 2.0):
        monkeypatch.setattr(room, factor * TOLD)
        assert not any(told([clean(forearm(seed, 0.0))], "shoulder") for seed in range(1, 9))
        assert all(told([together(seed)], "shoulder") for seed in range(1, 9))
