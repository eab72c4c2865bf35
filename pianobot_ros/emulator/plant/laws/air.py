"""Laws 1 and 2 of the pneumatic effects, compiled."""

from __future__ import annotations

from numba import njit

__all__ = ["laminar_leak", "play", "seal_leak"]

SEAL = 30_000.0  # Pa at which a lip seal begins to leak


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def laminar_leak(pressure: float, droop: float) -> float:
    """Loss of vacuum, Pa, through a long thin crack: in proportion to the difference of pressure
    (Hagen and Poiseuille); ``droop`` Pa at -100 kPa.
    """
    return droop * max(-pressure, 0.0) / 100_000.0


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def seal_leak(pressure: float, droop: float) -> float:
    """Loss of vacuum, Pa, past a lip seal that lifts at 30 kPa (Beater 2007, *Pneumatic drives*);
    ``droop`` Pa at -100 kPa.
    """
    return droop * max(-pressure - SEAL, 0.0) / (100_000.0 - SEAL)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def play(memory: float, x: float, half: float) -> float:
    """Play operator of half width ``half`` (Krasnosel'skii and Pokrovskii 1989)."""
    return min(max(memory, x - half), x + half)
