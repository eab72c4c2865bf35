"""Laws 1 to 3 of the finger joints' effects, compiled. Torques in N m, angles in rad."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.plant.laws.row_layout import GAP, MAXWELL, SLIDERS

__all__ = [
    "bouc_wen",
    "dahl_slider",
    "eyring_creep",
    "gear_play",
    "grown_flank",
    "jammed_soil",
    "maxwell_slip",
    "meeting_bones",
    "piecewise_hardening",
    "regularised_friction",
    "sharp_flank",
]

HARDENING_START, HARDENING_SPAN = 0.015, 0.085  # rad
SLIP_SHARES = (0.5, 0.3, 0.2)
SLIP_ANGLES = (0.001, 0.003, 0.008)  # rad
SLIP_STRIBECK, SLIP_STATIC = 0.2, 0.3  # rad/s, 1
SOIL_ANGLE = 0.03  # rad, reference strain of the hyperbola
EYRING_TIME, EYRING_ANGLE = 0.6, 0.005  # s, rad


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


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def maxwell_slip(
    fs: Array, f: int, j: int, level: float, rate: float, h: float
) -> tuple[float, float]:
    """Friction torque of three springs in parallel that slip one after the other, each at a limit
    that falls with speed (generalised Maxwell slip: Al-Bender, Lampaert and Swevers 2005), and the
    stiffness of those that stick.
    """
    strength = 1.0 + SLIP_STATIC * math.exp(-((rate / SLIP_STRIBECK) ** 2))
    torque, stiffness = 0.0, 0.0
    for b in range(3):
        column, spring = MAXWELL + 4 * b + j, level * SLIP_SHARES[b] / SLIP_ANGLES[b]
        z, limit = fs[f, column] + h * rate, strength * SLIP_ANGLES[b]
        if abs(z) > limit:
            z = math.copysign(limit, z)
        else:
            stiffness += spring
        fs[f, column] = z
        torque += spring * z
    return torque, stiffness


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def gear_play(
    fs: Array, f: int, j: int, strain: float, rate: float, gap: float, time: float, h: float
) -> tuple[float, float, bool]:
    """Twist and rate of twist of a shaft whose far end has play of half width ``gap`` rad, and
    whether it touches a flank (Nordin, Galic and Gutman 1997). The shaft is a spring and a damper
    of relaxation time ``time`` s; inside the gap it carries no torque, and no flank ever pulls.
    """
    before = fs[f, GAP + j]
    free = (before + h * rate + h / time * strain) / (1.0 + h / time)
    now = min(max(free, -gap), gap)
    fs[f, GAP + j] = now
    return strain - now, rate - (now - before) / h, now != free


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def meeting_bones(strain: float, scale: float) -> tuple[float, float]:
    """Extra torque of bones whose round ends press on one another when the joint is bent back, not
    when it is closed, ``scale`` N m at 0.1 rad, and its stiffness (power 3/2: Hertz 1882).
    """
    if strain >= 0.0:
        return 0.0, 0.0
    root = math.sqrt(-strain / 0.1)
    return -scale * root * root * root, 15.0 * scale * root


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def jammed_soil(fs: Array, f: int, j: int, step: float) -> float:
    """Elastic deflection, rad, of grains that yield along a hyperbola (Kondner 1963) after a
    displacement of ``step`` rad. After a reversal the hyperbola starts anew, as wide as what is
    left to the ceiling on the other side (Pyke 1979).
    """
    z, turned, way = fs[f, SLIDERS + j], fs[f, SLIDERS + 4 + j], fs[f, SLIDERS + 8 + j]
    if step == 0.0:
        return float(z)
    if step * way < 0.0:
        turned = z
    way = math.copysign(1.0, step)
    room = max(SOIL_ANGLE - way * turned, 1e-9)
    run = abs(z - turned)
    run = run / max(1.0 - run / room, 1e-9) + abs(step)
    z = turned + way * run / (1.0 + run / room)
    fs[f, SLIDERS + j], fs[f, SLIDERS + 4 + j], fs[f, SLIDERS + 8 + j] = z, turned, way
    return float(z)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def eyring_creep(crept: float, aim: float, total: float, h: float) -> float:
    """What has given way, rad, on its way to ``aim`` after ``h`` s: the faster the more is left, as
    a hyperbolic sine (spring beside a thermally activated dashpot: Halsey, White and Eyring 1945).
    Solved exactly; ``total`` is the give of the effect.
    """
    scale = 2.0 * EYRING_ANGLE * total
    left = math.tanh((aim - crept) / scale) * math.exp(-h / EYRING_TIME)
    return aim - scale * math.atanh(left)
