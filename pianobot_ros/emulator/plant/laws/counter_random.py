"""Counter-based random numbers for compiled code: the same seed and counter give the same number,
whoever asks.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

__all__ = ["normal", "uniform"]


@njit(cache=True, error_model="numpy", forceinline=True)  # type: ignore[untyped-decorator]
def uniform(seed: int, stream: int, counter: int) -> float:
    """A number in (0, 1) by the SplitMix64 finaliser (Steele, Lea and Flood 2014)."""
    x = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(stream) * np.uint64(
        0xD1B54A32D192ED03
    )
    x += np.uint64(counter) * np.uint64(0x8CB92BA72F3D8DD7) + np.uint64(0x632BE59BD9B4E019)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x = x ^ (x >> np.uint64(31))
    return (float(x >> np.uint64(11)) + 0.5) / 9007199254740992.0


@njit(cache=True, error_model="numpy", forceinline=True)  # type: ignore[untyped-decorator]
def normal(seed: int, stream: int, counter: int) -> float:
    """A standard normal number (Box and Muller)."""
    u, v = uniform(seed, stream, 2 * counter), uniform(seed, stream, 2 * counter + 1)
    return math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * v)
