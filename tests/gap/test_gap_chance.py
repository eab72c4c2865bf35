"""What chance opens of a perfect twin's observables is nothing, and a gap of all blocks is one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pianobot_ros.gap import Calibration
from pianobot_ros.gap.fitting.evidence import anything, material
from pianobot_ros.gap.floor.measure import Gauge

BLOCKS, OBSERVABLES, SESSIONS = 40, 9, 500


def study(squares: np.ndarray, conditions: int = BLOCKS) -> Any:
    """Of one event a block and observable, with squared residuals (u, o) in floors², of so many
    conditions in turn.
    """
    gauge = Gauge.__new__(Gauge)
    gauge._n = np.ones(squares.shape)
    blocks = np.arange(len(squares))
    gauge.problem = SimpleNamespace(  # type: ignore[assignment]
        blocks=blocks, condition_of_block=blocks % conditions, block_of_unit=blocks
    )
    gauge.squares = lambda _: squares  # type: ignore[method-assign]
    return SimpleNamespace(
        gauge=gauge,
        nominal=None,
        options=SimpleNamespace(calibration=Calibration()),
        problem=SimpleNamespace(present=range(squares.shape[1])),
    )


@pytest.mark.parametrize("conditions", [10, 20])
def test_a_gap_of_one_condition_is_no_chance(perfect: list[np.ndarray], conditions: int) -> None:
    """All of its repeats have it. By the error over all blocks it had been chance however large."""
    own = np.arange(BLOCKS) % conditions == 3
    shares = []
    for times in (1.0, 20.0):
        scale = np.where(own[:, None] & (np.arange(OBSERVABLES) == 4), times, 1.0)
        # a shift of the repeats, and their scatter about it
        squares = [(np.sqrt(scale) - 1.0 + np.sqrt(x)) ** 2 for x in perfect]
        shares.append(np.mean([anything(study(x, conditions)) for x in squares]))
    assert shares[0] < 0.05
    assert shares[1] > 0.9


@pytest.fixture(scope="module")
def perfect() -> list[np.ndarray]:
    """Sessions in which nothing but the noise of the floor is left."""
    return list(np.random.default_rng(1).chisquare(1.0, (SESSIONS, BLOCKS, OBSERVABLES)))


def test_chance_alone_is_seldom_a_gap(perfect: list[np.ndarray]) -> None:
    share = np.mean([anything(study(x)) for x in perfect])
    assert share <= Calibration().false_alarm + 2.0 * np.sqrt(0.02 / SESSIONS)
    # one observable at a time, one standard error each, is another matter
    assert np.mean([material(study(x), x) for x in perfect]) > 0.3


def test_a_gap_of_all_blocks_is_one_however_large_its_scatter(perfect: list[np.ndarray]) -> None:
    for factor in (3.0, 30.0, 3000.0):
        scale = np.where(np.arange(OBSERVABLES) == 4, factor, 1.0)
        assert np.mean([anything(study(scale * x)) for x in perfect]) > 0.95
