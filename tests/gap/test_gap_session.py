"""A disturbance on its own clock is told from scatter."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.gap.floor.session import line_share, own_clock, steady_line


def blocks(rng, hum: float, noise: float):
    t = [k * 4.0 + np.arange(0, 3.9, 0.01) for k in range(8)]
    return t, [
        hum * np.sin(2 * np.pi * 3.37 * b + 0.4) + noise * rng.standard_normal(b.size) for b in t
    ]


@pytest.mark.parametrize("seed", range(3))
def test_line_is_found_with_its_size(seed):
    t, x = blocks(np.random.default_rng(seed), 1.0, 0.5)
    lines = steady_line(t, x)
    assert lines is not None
    for b, line in zip(t, lines, strict=True):
        assert np.allclose(line, np.sin(2 * np.pi * 3.37 * b + 0.4), atol=0.15)


@pytest.mark.parametrize("seed", range(8))
def test_scatter_of_any_colour_has_no_line(seed):
    rng = np.random.default_rng(seed)
    t, x = blocks(rng, 0.0, 1.0)
    assert steady_line(t, x) is None
    slow = [np.cumsum(y) * 0.05 + rng.standard_normal() for y in x]
    assert steady_line(t, slow) is None
    ringing = [
        rng.standard_normal() * np.sin(2 * np.pi * 5 * (b - b[0]) + rng.uniform(0, 6.28)) for b in t
    ]
    assert steady_line(t, ringing) is None
    assert steady_line(t[:3], x[:3]) is None


def test_a_line_of_its_own_stands_in_the_residual_and_not_in_the_prediction():
    rng = np.random.default_rng(0)
    t, residual = blocks(rng, 1.0, 0.3)
    moves = [np.sin(2 * np.pi * 0.4 * b) for b in t]
    assert own_clock(t, residual, moves) == pytest.approx(3.37, abs=0.01)
    assert line_share(t, residual, 3.37) > 0.8
    assert line_share(t, residual, 2.9) < 0.1
    asked = [m + 2.0 * np.sin(2 * np.pi * 3.37 * b) for m, b in zip(moves, t, strict=True)]
    assert own_clock(t, residual, asked) is None, "the robot was asked to move like that"
    assert own_clock(t, blocks(rng, 0.5, 1.0)[1], moves) is None, "most of it is something else"
    assert own_clock(t[:3], residual[:3], moves[:3]) is None
