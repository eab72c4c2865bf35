"""Laws 1 to 3 of the fingertip's effects, compiled."""

from __future__ import annotations

import math

from numba import njit

__all__ = [
    "adhesive_slip",
    "pulp_in_series",
    "soft_finger_in_series",
    "spring_in_series",
    "stribeck_slip",
]

PULP_FORCE = 1.5  # N over which a pulp fills out
SLIP_SPEED = 0.01  # m/s
SLIP_LOAD = 0.5  # N from which a rubber's friction falls behind the load


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


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def soft_finger_in_series(stiffness: float, depth: float, give: float) -> tuple[float, float]:
    """As :func:`spring_in_series` with a layer whose force goes with the square of its depth (soft
    fingers: Xydas and Kao 1999; Kao and Yang 2004).
    """
    b = give / math.sqrt(5.0)
    root = 2.0 * depth / (b + math.sqrt(b * b + 4.0 * depth / stiffness))  # of the force
    return root * root, 2.0 * root / (2.0 * root + stiffness * b)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def adhesive_slip(weakening: float, load: float) -> float:
    """Factor on Coulomb's friction at a ``load`` N: that of rubber goes with the area of contact,
    the load to the power 2/3, so that its coefficient falls (Schallamach 1952).
    """
    factor: float = 1.0 - weakening * (1.0 - (1.0 + load / SLIP_LOAD) ** (-1.0 / 3.0))
    return factor
