"""A disturbance on its own clock is told from scatter."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.gap.floor.session.lines import line_share, own_clock, steady_lines
from pianobot_ros.gap.problem.options import Options

SHARE = Options().calibration.material_share


def blocks(rng, hum: float, noise: float, count: int = 8):
    times = [k * 4.0 + np.arange(0, 3.9, 0.01) for k in range(count)]
    return [
        (t, hum * np.sin(2 * np.pi * 3.31 * t + 0.4) + noise * rng.standard_normal(t.size))
        for t in times
    ]


def in_conditions(rows, count: int):
    """The rows dealt to so many conditions in turn."""
    return [group for group in (rows[k::count] for k in range(count)) if len(group) > 1]


@pytest.mark.parametrize("conditions", [1, 2])
@pytest.mark.parametrize("seed", range(3))
def test_line_is_found_with_its_size(seed, conditions):
    groups = in_conditions(blocks(np.random.default_rng(seed), 1.0, 0.5), conditions)
    found = steady_lines(groups, SHARE)
    assert found is not None
    for group, lines in zip(groups, found, strict=True):
        for (t, _), line in zip(group, lines, strict=True):
            assert np.allclose(line, np.sin(2 * np.pi * 3.31 * t + 0.4), atol=0.15)


@pytest.mark.parametrize("conditions", [1, 4])
@pytest.mark.parametrize("seed", range(8))
def test_scatter_of_any_colour_has_no_line(seed, conditions):
    rng = np.random.default_rng(seed)
    rows = blocks(rng, 0.0, 1.0)
    slow = [(t, np.cumsum(x) * 0.05 + rng.standard_normal()) for t, x in rows]
    ringing = [
        (t, rng.standard_normal() * np.sin(2 * np.pi * 5 * (t - t[0]) + rng.uniform(0, 6.28)))
        for t, _ in rows
    ]
    for each in (rows, slow, ringing, rows[:3]):
        assert steady_lines(in_conditions(each, conditions), SHARE) is None


def test_scatter_is_taken_for_a_line_as_often_as_the_level_of_the_test_says():
    """Levels that differ between blocks at regular intervals are the hard case: they alias."""
    rng = np.random.default_rng(1)
    found = 0
    for _ in range(100):
        rows = [(t, x + 2.0 * rng.standard_normal()) for t, x in blocks(rng, 0.0, 1.0, 12)]
        found += steady_lines(in_conditions(rows, 3), SHARE) is not None
    assert found <= 2


def test_a_line_of_its_own_stands_in_the_residual_and_not_in_the_prediction():
    rng = np.random.default_rng(0)
    residual = blocks(rng, 1.0, 0.3)
    moves = [(t, np.sin(2 * np.pi * 0.4 * t)) for t, _ in residual]
    assert own_clock(residual, moves) == pytest.approx(3.31, abs=0.01)
    assert line_share(residual, 3.31) > 0.8
    assert line_share(residual, 2.9) < 0.1
    asked = [(t, m + 2.0 * np.sin(2 * np.pi * 3.31 * t)) for t, m in moves]
    assert own_clock(residual, asked) is None, "the robot was asked to move like that"
    assert own_clock(blocks(rng, 0.5, 1.0), moves) is None, "most of it is something else"
    assert own_clock(residual[:3], moves[:3]) is None
