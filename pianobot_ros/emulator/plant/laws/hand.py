"""Laws 1 and 2 of the finger joints' effects, compiled. Torques in N m, angles in rad."""

from __future__ import annotations

import math

from numba import njit

__all__ = [
    "bouc_wen",
    "dahl_slider",
    "grown_flank",
    "piecewise_hardening",
    "regularised_friction",
    "sharp_flank",
]

HARDENING_START, HARDENING_SPAN = 0.015, 0.085  # rad


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def regularised_friction(
    level: float, rate: float, slow: float, stribeck: float, static: float
) -> tuple[float, float]:
    """Friction torque and its ratio to the rate: a hyperbolic tangent of width ``slow`` rad/s for
    stiction, falling from ``1 + static`` times ``level`` over ``stribeck`` rad/s (Andersson,
    Söderberg and Björklund 2007).

    The ratio, and not the slope, is the damping of a linearly implicit step: with it friction never
    turns a motion around, whatever the step; the slope is nothing beyond ``slow``, and the friction
    of a light body then changes sign at every step.
    """
    size = level * (1.0 + static * math.exp(-((rate / stribeck) ** 2)))
    if abs(rate) < 1e-6 * slow:
        return size * rate / slow, size / slow
    friction = size * math.tanh(rate / slow)
    return friction, friction / rate


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def bouc_wen(z: float, step: float) -> float:
    """State of Bouc and Wen's hysteresis, exponent 2, in [-1, 1], after a displacement of ``step``
    in units of its presliding (Wen 1976).
    """
    n = max(1, int(abs(step) / 0.1) + 1)
    d = step / n
    for _ in range(n):
        z += d - (0.5 * abs(d) * z * abs(z) + 0.5 * d * z * z)
    return min(max(z, -1.0), 1.0)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def sharp_flank(strain: float, gap: float) -> tuple[float, float]:
    """Elastic deflection behind a dead zone of half width ``gap``, and its slope (Nordin and Gutman
    2002); 1 % of the strain acts in the gap.
    """
    beyond = abs(strain) - gap
    if beyond <= 0.0:
        return 0.01 * strain, 0.01
    return math.copysign(0.99 * beyond, strain) + 0.01 * strain, 1.0


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def grown_flank(strain: float, gap: float) -> tuple[float, float]:
    """As :func:`sharp_flank` with flanks that grow stiff over twice the gap, as rough faces do
    (Greenwood and Williamson 1966).
    """
    beyond = abs(strain) - gap
    if beyond <= 0.0:
        return 0.01 * strain, 0.01
    total = beyond + 2.0 * gap
    slope = beyond * (beyond + 4.0 * gap) / (total * total)
    return math.copysign(0.99 * beyond * beyond / total, strain) + 0.01 * strain, 0.01 + slope


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def piecewise_hardening(strain: float, scale: float) -> tuple[float, float]:
    """Extra torque of a second spring that is met at 0.015 rad and has ``scale`` N m at 0.1 rad,
    and its stiffness (Shaw and Holmes 1983).
    """
    beyond = abs(strain) - HARDENING_START
    if beyond <= 0.0:
        return 0.0, 0.0
    return math.copysign(scale * beyond / HARDENING_SPAN, strain), scale / HARDENING_SPAN


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def dahl_slider(z: float, step: float, limit: float) -> float:
    """Elastic deflection of a Dahl element after a displacement of ``step`` rad; it approaches
    ``limit`` rad (Dahl 1968).
    """
    if step == 0.0:
        return z
    end = math.copysign(limit, step)
    return end - (end - z) * math.exp(-abs(step) / limit)
