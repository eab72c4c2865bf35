"""A disturbance on its own clock is told from scatter."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.gap.session import steady_line


def blocks(rng, hum: float, noise: float):
    t = [k * 4.0 + np.arange(0, 3.9, 0.01) for k in range(8)]
    return t, [hum * np.sin(2 * np.pi * 3.37 * b + 0.4) + noise * rng.standard_normal(b.size) for b in t]


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
    ringing = [rng.standard_normal() * np.sin(2 * np.pi * 5 * (b - b[0]) + rng.uniform(0, 6.28)) for b in t]
    assert steady_line(t, ringing) is None
    assert steady_line(t[:3], x[:3]) is None
