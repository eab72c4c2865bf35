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


def study(squares: np.ndarray) -> Any:
    """Of one event a block and observable, with squared residuals (u, o) in floors²."""
    gauge = Gauge.__new__(Gauge)
    gauge._n = np.ones(squares.shape)
    gauge.problem = SimpleNamespace(block_of_unit=np.arange(BLOCKS))  # type: ignore[assignment]
    gauge.squares = lambda _: squares  # type: ignore[method-assign]
    return SimpleNamespace(
        gauge=gauge,
        nominal=None,
        options=SimpleNamespace(calibration=Calibration()),
        problem=SimpleNamespace(present=range(squares.shape[1])),
    )


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
