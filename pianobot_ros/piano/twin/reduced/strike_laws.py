"""Laws of the reduced strike model, one function each, and the vector of numbers that they read.

A number whose nominal value is 0 belongs to a law that vanishes exactly at 0, so one kernel serves
every combination of structural terms. The laws are textbook ones, with the source in each
docstring.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array

GRAVITY = 9.81  # m/s^2

# Values of the nominal cell, as factors.
_JOINT_FACTORS = ("joint_stiffness", "joint_damping")
_KEY_FACTORS = ("key_stiffness", "key_damping", "key_inertia")
# Laws.
_JOINT = (
    "joint_friction",
    "joint_friction_static",
    "joint_friction_rest",
    "joint_friction_breakaway",
    "joint_friction_creep",
    "joint_backlash",
    "joint_hardening",
    "joint_hardening_power",
    "jamming_hysteresis",
    "jamming_yield",
    "joint_creep",
    "joint_creep_time",
    "joint_creep_spread",
)
_TIP = (
    "pad_stiffness",
    "pad_softening",
    "tip_slip",
    "tip_slip_weakening",
    "tip_slip_speed",
    "tip_drop",
)
_KEY = (
    "key_friction",
    "key_friction_static",
    "key_friction_breakaway",
    "key_friction_creep",
    "key_preload",
    "key_preload_fade",
    "hammer",
    "hammer_coupling",
    "hammer_weight",
    "hammer_escape",
    "hammer_damping",
    "hammer_captive",
    "let_off",
    "let_off_angle",
    "let_off_width",
    "let_off_return",
    "felt_exponent",
    "felt_thickness",
)
NAMES = (*_JOINT_FACTORS, *_KEY_FACTORS, *_JOINT, *_TIP, "tip_reach", *_KEY)
"""Names of the mechanical numbers of a strike; the order is that of the parameter vector."""
NULLS: dict[str, float] = dict.fromkeys(NAMES, 0.0) | {
    "joint_stiffness": 1.0,
    "joint_damping": 1.0,
    "key_stiffness": 1.0,
    "key_damping": 1.0,
    "key_inertia": 1.0,
    "joint_friction_breakaway": 0.003,
    "tip_slip_speed": 0.005,
    "jamming_yield": 0.03,
    "joint_creep_time": 0.3,
    "joint_creep_spread": 1.0,
    "pad_stiffness": 1.0,
    "key_friction_breakaway": 0.0008,
    "hammer_coupling": 1892.1,
    "hammer_weight": GRAVITY / 5.0,
    "hammer_escape": 0.1,
    "hammer_damping": 5.33,  # N s/m, piano-action paper, Table 2
    "joint_hardening_power": 2.0,
    "let_off_angle": 0.03,
    "let_off_width": 0.0025,
    "let_off_return": 0.33,
    "felt_exponent": 1.0,
}
HAND_ALONE = frozenset((*_JOINT_FACTORS, *_JOINT, *_TIP))
"""Numbers that a key under a given force does not feel."""
KEY_ALONE = frozenset((*_KEY_FACTORS, *_KEY))
"""Numbers that a hand on a key with a given motion does not feel. A number in neither set belongs
to both, which costs time and is never wrong.
"""
INDEX = {name: i for i, name in enumerate(NAMES)}
(
    JOINT_STIFFNESS,
    JOINT_DAMPING,
    KEY_STIFFNESS,
    KEY_DAMPING,
    KEY_INERTIA,
    JOINT_FRICTION,
    JOINT_FRICTION_STATIC,
    JOINT_FRICTION_REST,
    JOINT_FRICTION_BREAKAWAY,
    JOINT_FRICTION_CREEP,
    JOINT_BACKLASH,
    JOINT_HARDENING,
    JOINT_HARDENING_POWER,
    JAMMING_HYSTERESIS,
    JAMMING_YIELD,
    JOINT_CREEP,
    JOINT_CREEP_TIME,
    JOINT_CREEP_SPREAD,
    PAD_STIFFNESS,
    PAD_SOFTENING,
    TIP_SLIP,
    TIP_SLIP_WEAKENING,
    TIP_SLIP_SPEED,
    TIP_DROP,
    TIP_REACH,
    KEY_FRICTION,
    KEY_FRICTION_STATIC,
    KEY_FRICTION_BREAKAWAY,
    KEY_FRICTION_CREEP,
    KEY_PRELOAD,
    KEY_PRELOAD_FADE,
    HAMMER,
    HAMMER_COUPLING,
    HAMMER_WEIGHT,
    HAMMER_ESCAPE,
    HAMMER_DAMPING,
    HAMMER_CAPTIVE,
    LET_OFF,
    LET_OFF_ANGLE,
    LET_OFF_WIDTH,
    LET_OFF_RETURN,
    FELT_EXPONENT,
    FELT_THICKNESS,
) = range(len(NAMES))

HARDENING_REFERENCE = (
    0.1  # rad of deflection at which a hardening of any power has the torque of Duffing's
)
JOINT_STRIBECK, KEY_STRIBECK = 0.2, 0.05  # rad/s over which friction falls from its static level
LET_OFF_SPEED = 0.02  # rad/s over which the let-off's dry part changes its sign
ESCAPE_WIDTH = 0.004  # rad of the key over which the jack leaves the hammer
FELT_REFERENCE = 0.001  # m of compression at which a felt of any exponent has the nominal force


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def stable_armature(stiffness: float, damping: float, h: float) -> float:
    """Inertia kg m² beside any mass with which steps of `h` s are stable for an explicit spring
    (N m/rad) with an implicit damper (N m s/rad): 4 M + 2 c h > k h². More damping would do as well
    and make light joints calmer than they are; an inertia goes with the square of the step.
    """
    return 0.5 * h * max(0.5 * h * stiffness - damping, 0.0)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def dahl_slope(z: float, v: float, breakaway: float) -> float:
    """dz/dx of Dahl's friction state z in [-1, 1] (Dahl 1968): (1 - sgn(v) z) / breakaway."""
    sign = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)
    return (1.0 - sign * z) / breakaway


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def dahl_advance(z: float, dx: float, breakaway: float) -> float:
    """Dahl's state after a displacement dx, exactly (friction is rate independent)."""
    if dx == 0.0:
        return z
    sign = 1.0 if dx > 0.0 else -1.0
    return sign - (sign - z) * math.exp(-abs(dx) / breakaway)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def friction_advance(z: float, dx: float, breakaway: float, creep: float, h: float) -> float:
    """Dahl's state after a displacement dx in `h` s, with what it holds fading at the rate `creep`
    (1/s): 0 is Dahl's law; where it fades fast, the friction of a slow motion grows with its speed
    up to `breakaway` times `creep`, as in regularised Coulomb friction, and nothing is held.
    """
    moved = dahl_advance(z, dx, breakaway)
    return float(moved * math.exp(-creep * h)) if creep != 0.0 else float(moved)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def stribeck(v: float, static: float, speed: float) -> float:
    """Factor on Coulomb friction at speed v: 1 + `static` at rest, falling exponentially over
    `speed` (Tustin 1947, as in Armstrong-Hélouvry et al. 1994).
    """
    return 1.0 + static * math.exp(-abs(v) / speed) if static != 0.0 else 1.0


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def relaxed(h: float, time: float, spread: float) -> tuple[float, float]:
    """Shares by which two Kelvin branches relax in `h` s: one `spread` times as quick as `time`
    (s), one as many times slower. Two branches stand for a spectrum (Findley, Lai and Onaran 1976,
    5.5); at a spread of 1 they are one.
    """
    return 1.0 - math.exp(-h * spread / time), 1.0 - math.exp(-h / (spread * time))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def held_by_friction(torque: float, friction: float) -> float:
    """Dahl's state in which friction holds against a torque at rest, as far as it can."""
    return -min(max(torque / friction, -1.0), 1.0)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def preload(angle: float, torque: float, fade: float) -> float:
    """Torque (N m) that presses a key up: `torque` at rest, less by a factor e with each 1 / `fade`
    rad, as of a magnet or of a felt that lets go; constant where `fade` is 0.
    """
    return torque * math.exp(-fade * max(angle, 0.0)) if fade != 0.0 else torque


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def joint_spring(
    x: float, k: float, backlash: float, hardening: float, power: float
) -> tuple[float, float]:
    """Torque and stiffness of a joint spring at deflection x: dead zone of full width `backlash`
    (Nordin and Gutman 2002), then k x (1 + hardening x² (x / 0.1 rad)^(power - 2)), which is
    Duffing's law for power 2. N·m and N·m/rad.
    """
    if backlash > 0.0:
        if x > 0.5 * backlash:
            x -= 0.5 * backlash
        elif x < -0.5 * backlash:
            x += 0.5 * backlash
        else:
            return 0.02 * k * x, 0.02 * k
    square = hardening * x * x
    if power != 2.0 and x != 0.0:
        square *= (abs(x) / HARDENING_REFERENCE) ** (power - 2.0)
    return k * x * (1.0 + square), max(k * (1.0 + (power + 1.0) * square), 0.05 * k)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def pad_spring(x: float, k: float, softening: float) -> tuple[float, float]:
    """Force and stiffness of the pad compressed by x >= 0: k x² / (x + softening), soft at first
    like a rounded or rough layer (Greenwood and Tripp 1967), linear where x is large against
    `softening` (m).
    """
    if softening <= 0.0:
        return k * x, k
    total = x + softening
    return k * x * x / total, k * x * (x + 2.0 * softening) / (total * total)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def felt(x: float, k: float, exponent: float) -> tuple[float, float]:
    """Force and stiffness of a felt stop compressed by x >= 0 (m): power law of Hunt and Crossley
    1975 with the nominal force at 1 mm.
    """
    if exponent == 1.0 or x <= 0.0:
        return k * x, k
    ratio = (x / FELT_REFERENCE) ** (exponent - 1.0)
    return k * x * ratio, exponent * k * ratio


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator,unused-ignore]
def rail_felt(
    x: float, v: float, k: float, c: float, power: float, reference: float
) -> tuple[float, float, float]:
    """Force, stiffness and damping of a rail's felt compressed by x (m) at the rate v (m/s): Hunt
    and Crossley 1975, as stiff (secant) as a spring k (N/m) and as lossy as a damper c (N s/m) at
    the force `reference` (N). Without jump at touch; never pulls.
    """
    if x <= 0.0:
        return 0.0, 0.0, 0.0
    spring = k * x * (k * x / reference) ** (power - 1.0)
    lossy = 1.0 + c / reference * v
    if lossy <= 0.0:
        return 0.0, 0.0, 0.0
    return spring * lossy, power * spring / x * lossy, spring * c / reference


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def jack(angle: float, escape: float) -> float:
    """Share of the hammer's coupling that is left at a key's angle: the jack slips out from under
    it at `escape` (rad).
    """
    return min(max((escape + ESCAPE_WIDTH - angle) / ESCAPE_WIDTH, 0.0), 1.0)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def carried(
    p: Array, th: float, w: float, angle: float, rate: float, radius2: float, h: float
) -> tuple[float, float]:
    """What couples the key (``th``, ``w``) to its hammer (``angle``, ``rate``) in a step of ``h`` s
    of a linearly implicit scheme: the share of the system's matrix, and the torque N m, negative
    where a linked hammer pulls; both 0 where they are apart.
    """
    stretch, closing, hold = th - angle, w - rate, jack(th, p[HAMMER_ESCAPE])
    k, c = hold * p[HAMMER_COUPLING] * radius2, hold * p[HAMMER_DAMPING] * radius2
    full = k * stretch + c * closing + 0.5 * h * k * closing
    follows = 0.25 * h * h * k + 0.5 * h * c
    if stretch + 0.5 * h * closing > 0.0 and full > 0.0:
        return follows, full
    return p[HAMMER_CAPTIVE] * follows, p[HAMMER_CAPTIVE] * full


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def let_off(
    angle: float, rate: float, height: float, centre: float, width: float, back: float
) -> tuple[float, float, float]:
    """Extra resisting torque where the jack meets the let-off button (Fletcher and Rossing, 12.1):
    a bump over the key's angle, on the way back `back` times as high. 1 is a spring that gives back
    what it took, -1 dry friction alone (a click). Returns its elastic and its dry part (N m) and
    the slope of the dry part over the rate (N m s/rad).
    """
    u = (angle - centre) / width
    if abs(u) > 4.0:
        return 0.0, 0.0, 0.0
    bump = height * math.exp(-u * u)
    sign = math.tanh(rate / LET_OFF_SPEED)
    dry = 0.5 * (1.0 - back) * bump
    return 0.5 * (1.0 + back) * bump, dry * sign, dry * (1.0 - sign * sign) / LET_OFF_SPEED


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def let_off_of(p: Array, angle: float, rate: float) -> tuple[float, float, float]:
    """:func:`let_off` by the parameter vector."""
    height, centre, width = p[LET_OFF], p[LET_OFF_ANGLE], p[LET_OFF_WIDTH]
    elastic, dry, slope = let_off(angle, rate, height, centre, width, p[LET_OFF_RETURN])
    return elastic, dry, slope


def vector(values: dict[str, float] | None = None) -> Array:
    """The parameter vector (len(NAMES),) of the nominal cell with `values` put in by name."""
    full = NULLS | (values or {})
    return np.array([full[name] for name in NAMES], dtype=float)
