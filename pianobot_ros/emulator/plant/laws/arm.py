"""Laws 1 and 2 of the wrist's effects, compiled."""

from __future__ import annotations

import math

from numba import njit

__all__ = ["first_order", "hardening_give", "next_poll", "rate_limited"]

GIVE_TIME = 0.005  # s
GIVE_FORCE = 4.0  # N at which a hardening transmission gives half of what a linear one would


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def next_poll(now: float, mean: float) -> float:
    """Time, s, at which a receiver that polls every ``2 * mean`` s next looks (Törngren 1998,
    *Fundamentals of implementing real-time control applications in distributed computer systems*).
    """
    period = 2.0 * mean
    return (math.floor(now / period) + 1.0) * period


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def first_order(y: float, aim: float, dt: float, time: float) -> float:
    """First-order lag of time constant ``time`` s after ``dt`` s of held ``aim`` (Åström and Murray
    2008, *Feedback systems*).
    """
    return y + (aim - y) * (1.0 - math.exp(-dt / time))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def rate_limited(y: float, aim: float, dt: float, time: float, band: float) -> float:
    """Smooth rate limit of ``band / time``: a first-order lag within ``band``, a constant speed far
    from the aim (Åström and Murray 2008; saturation as a hyperbolic tangent).
    """
    most = band * dt / time
    return y + most * math.tanh((aim - y) * (1.0 - math.exp(-dt / time)) / most)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def hardening_give(force: float, give: float) -> float:
    """Deflection, m, of a transmission that stiffens with load: ``give`` m/N at rest (harmonic
    drives: Tuttle and Seering 1996).
    """
    return give * force / (1.0 + abs(force) / GIVE_FORCE)
