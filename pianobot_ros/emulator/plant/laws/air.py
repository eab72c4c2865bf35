"""Laws 1 to 3 of the pneumatic effects, compiled."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.cell.arrays import Array

__all__ = ["choked_leak", "laminar_leak", "play", "relay_loop", "seal_leak"]

SEAL = 30_000.0  # Pa at which a lip seal begins to leak
ATMOSPHERE = 101_325.0  # Pa
CRITICAL_RATIO = 0.528  # of ISO 6358 for an ideal nozzle
SPAN = 100_000.0  # Pa, the regulator's range
RELAYS = (0.1, 0.2, 0.3, 0.4)  # half widths of the relays in units of the range
LOOP_AT_HALF = 0.365  # half width of the loop at half the range, in units of the range


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


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def choked_leak(pressure: float, droop: float) -> float:
    """Loss of vacuum, Pa, through a hole that air enters from outside: choked, and so the same,
    where the pressure inside is below the critical ratio (ISO 6358); ``droop`` Pa at -100 kPa.
    """
    ratio = (ATMOSPHERE + min(pressure, 0.0)) / ATMOSPHERE
    if ratio <= CRITICAL_RATIO:
        return droop
    part = (ratio - CRITICAL_RATIO) / (1.0 - CRITICAL_RATIO)
    return droop * math.sqrt(max(1.0 - part * part, 0.0))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def relay_loop(plays: Array, aim: float, half: float) -> float:
    """Pressure, Pa, of a regulator that is told ``aim`` and is right at both ends of its range: a
    Preisach model with relays of all centres and four widths (Preisach 1935; Mayergoyz 1991).

    The relays of one width are a play, ``plays`` (4,) in units of the range, stretched until it
    ends where the range does. ``half`` Pa: half the loop's width at half the range.
    """
    x = min(max(-aim / SPAN, 0.0), 1.0)
    mean = 0.0
    for k in range(4):
        width = RELAYS[k]
        plays[k] = min(max(plays[k], x - width, width), x + width, 1.0 - width)
        mean += 0.25 * (plays[k] - width) / (1.0 - 2.0 * width)
    return aim - half / LOOP_AT_HALF * (mean - x)
