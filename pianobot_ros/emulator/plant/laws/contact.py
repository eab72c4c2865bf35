"""Laws 1 and 2 of the fingertip's effects, compiled."""

from __future__ import annotations

import math

from numba import njit

__all__ = ["pulp_in_series", "spring_in_series", "stribeck_slip"]

PULP_FORCE = 1.5  # N over which a pulp fills out
SLIP_SPEED = 0.01  # m/s


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def spring_in_series(stiffness: float, depth: float, give: float) -> tuple[float, float]:
    """Force, N, of a pad of ``stiffness`` N/m on a linear layer that gives by ``give`` m at 5 N,
    pressed in by ``depth`` m, and the pad's share of the depth (springs in series; Johnson 1985,
    *Contact mechanics*, for thin layers).
    """
    share = 1.0 / (1.0 + stiffness * give / 5.0)
    return stiffness * share * depth, share


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def pulp_in_series(stiffness: float, depth: float, give: float) -> tuple[float, float]:
    """As :func:`spring_in_series` with a soft pulp that fills out exponentially (Fung 1967; of
    fingertips: Serina, Mote and Rempel 1997). Newton's method on the force.
    """
    scale = give / (1.0 - math.exp(-5.0 / PULP_FORCE))
    force = stiffness * depth
    slope = 1.0 / stiffness
    for _ in range(8):
        left = math.exp(-force / PULP_FORCE)
        slope = 1.0 / stiffness + scale * left / PULP_FORCE
        force -= (force / stiffness + scale * (1.0 - left) - depth) / slope
        force = max(force, 0.0)
    return force, 1.0 / (stiffness * slope)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def stribeck_slip(weakening: float, speed: float) -> float:
    """Factor on Coulomb's friction at a sliding ``speed`` m/s: falls as a Gaussian (Armstrong-
    Hélouvry, Dupont and Canudas de Wit 1994).
    """
    return 1.0 - weakening * (1.0 - math.exp(-((speed / SLIP_SPEED) ** 2)))
