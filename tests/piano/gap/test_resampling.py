"""Compiled passages between grids do what NumPy does."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.piano.gap.simulation.resampling import moved_along, sampled

seeds = st.integers(0, 2**32 - 1)


@given(seeds, st.integers(1, 40), st.floats(-1e3, 1e3))
def test_sampling_is_linear_and_held_at_the_ends(seed: int, n: int, start: float) -> None:
    rng = np.random.default_rng(seed)
    x, step = rng.normal(size=n), 1e-3
    times = start + step * rng.uniform(-3.0, n + 3.0, 50)
    expected = np.interp(times, start + step * np.arange(n), x)
    assert np.allclose(sampled(times, start, step, x), expected, atol=1e-6)


@given(seeds, st.integers(-12, 12), st.integers(-3, 3))
def test_a_strike_moves_as_its_example_did(seed: int, shift: int, longer: int) -> None:
    rng = np.random.default_rng(seed)
    own, other = rng.normal(size=30), rng.normal(size=30 + longer)
    rolled = other + rng.normal(size=other.size)
    at = np.clip(np.arange(own.size) + shift, 0, other.size - 1)
    expected = own + (rolled - other)[at]
    assert np.allclose(moved_along(own, rolled, other, shift, -np.inf), expected)
    assert np.allclose(moved_along(own, rolled, other, shift, 0.0), np.maximum(expected, 0.0))
