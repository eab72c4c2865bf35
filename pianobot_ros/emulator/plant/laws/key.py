"""The key's felt stops, laws 1 to 3 of its effects, compiled. Torques in N m, angles in rad."""

from __future__ import annotations

import math

from numba import njit
from numpy import float64
from numpy.typing import NDArray

from pianobot_ros.emulator.plant.laws.row_layout import HAMMER, HAMMER_SPEED, KEY_FELT

__all__ = [
    "button_click",
    "button_cosine",
    "button_triangle",
    "coiled_spring",
    "hung_hammer",
    "knuckle_hammer",
    "magnet",
    "relaxing_felt",
    "slotted_hammer",
    "stop_felt",
    "wool_felt",
]

KNUCKLE_STIFFNESS = 72.0  # N m/rad at KNUCKLE_REFERENCE
KNUCKLE_REFERENCE = 0.004  # rad
STRING_ANGLE = 0.08  # rad, beyond what the key reaches, since nothing lets the hammer off
HUNG = 2.0 * math.pi * 30.0  # rad/s
HUNG_DAMPING = 0.15
MAGNET_REACH = 0.01  # rad
FELT_TIME, FELT_SHARE = 0.008, 0.6  # s, 1
SLOT_STIFFNESS, SLOT_PLAY = 72.0, 0.0008  # N m/rad, rad to either side
WOUND = 0.09  # rad by which a return spring is wound at rest
FULLY_PRESSED = 0.5  # of a felt's thickness, where it is as strong as the other laws


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def stop_felt(
    pressed: float, closing: float, stiffness: float, damping: float, power: float, level: float
) -> tuple[float, float, float]:
    """Torque of a stop's felt that is ``pressed`` by so many rad and further at ``closing`` rad/s
    (Hunt and Crossley 1975), and its tangents; ``level`` N m: where it is a spring of ``stiffness``
    with ``damping``.
    """
    loss = 1.0 + damping * closing / level
    if pressed <= 0.0 or loss <= 0.0:
        return 0.0, 0.0, 0.0
    elastic = level * (stiffness * pressed / level) ** power
    return elastic * loss, power * elastic * loss / pressed, elastic * damping / level


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def magnet(torque: float, theta: float) -> float:
    """Pull of a magnet at the rest position, with the square of the distance (Coulomb's law of
    poles).
    """
    near = 1.0 / (1.0 + max(theta, 0.0) / MAGNET_REACH)
    return torque * near * near


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def button_cosine(theta: float) -> float:
    """Bump of height 1 between 0.027 and 0.035 rad, a raised cosine, the same both ways (Askenfelt
    and Jansson 1990 for its place).
    """
    x = (theta - 0.027) / 0.008
    if x <= 0.0 or x >= 1.0:
        return 0.0
    return 0.5 - 0.5 * math.cos(2.0 * math.pi * x)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def button_click(theta: float, omega: float) -> float:
    """Friction of a spring-loaded click between 0.026 and 0.036 rad, against the motion both ways
    (as in digital keyboards; Coulomb's law).
    """
    rise = 1.0 / (1.0 + math.exp(-min(max((theta - 0.026) / 5e-4, -40.0), 40.0)))
    fall = 1.0 / (1.0 + math.exp(-min(max((0.036 - theta) / 5e-4, -40.0), 40.0)))
    return rise * fall * math.tanh(omega / 0.02)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def relaxing_felt(ks: NDArray[float64], j: int, ratio: float, h: float) -> float:
    """Relative force of a felt compressed by ``ratio`` of its thickness: a power law less its own
    fading memory (Stulov 1995).
    """
    u = ratio * ratio * math.sqrt(ratio) if ratio > 0.0 else 0.0
    ks[j, KEY_FELT] += (u - ks[j, KEY_FELT]) * h / (FELT_TIME + h)
    left: float = max(u - FELT_SHARE * ks[j, KEY_FELT], 0.0)
    return left


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def knuckle_hammer(
    ks: NDArray[float64], j: int, inertia: float, theta: float, omega: float, h: float
) -> float:
    """Torque on the key of a hammer on a felt knuckle, force to the power 1.5 (Hirschkorn, McPhee
    and Birkett 2006); no escapement, no check. Semi-implicit Euler.
    """
    mass = max(inertia, 5e-6)
    angle, rate = ks[j, HAMMER], ks[j, HAMMER_SPEED]
    x = theta - angle
    push = 0.0
    if x > 0.0:
        push = KNUCKLE_STIFFNESS * x * math.sqrt(x / KNUCKLE_REFERENCE)
        push += math.sqrt(KNUCKLE_STIFFNESS * mass) * (omega - rate)
        push = max(push, 0.0)
    rate += h * (push / mass - 25.0)
    if angle < -0.0005:
        rate += h * (-4e5 * (angle + 0.0005) - 600.0 * rate)
    elif angle > STRING_ANGLE and rate > 0.0:
        rate *= -0.4
    ks[j, HAMMER] = angle + h * rate
    ks[j, HAMMER_SPEED] = rate
    return -push * inertia / mass


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def hung_hammer(
    ks: NDArray[float64], j: int, inertia: float, theta: float, omega: float, h: float
) -> float:
    """Torque on the key of a mass that hangs on it by a spring and damper of 30 Hz and never leaves
    it (two-mass system; Den Hartog 1956, *Mechanical vibrations*). Semi-implicit Euler.
    """
    push = HUNG * HUNG * (theta - ks[j, HAMMER])
    push += 2.0 * HUNG_DAMPING * HUNG * (omega - ks[j, HAMMER_SPEED])
    ks[j, HAMMER_SPEED] += h * push
    ks[j, HAMMER] += h * ks[j, HAMMER_SPEED]
    torque: float = -inertia * push
    return torque


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def coiled_spring(torque: float, theta: float) -> float:
    """Torque of a return spring that is wound by 0.09 rad at rest and further as the key goes down
    (Wahl 1963, *Mechanical springs*).
    """
    return torque * (1.0 + max(theta, 0.0) / WOUND)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def button_triangle(theta: float, omega: float) -> float:
    """Bump of straight sides from 0.026 to 0.036 rad with its top of 1 at 0.033 rad, on the way
    down only: back, the jack slips under the knuckle by itself (Askenfelt and Jansson 1990).
    """
    rise, fall = (theta - 0.026) / 0.007, (0.036 - theta) / 0.003
    return max(min(rise, fall), 0.0) * (0.5 + 0.5 * math.tanh(omega / 0.02))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def wool_felt(ratio: float) -> float:
    """Relative force of a wool felt compressed by ``ratio`` of what it is at the rail: fibres meet
    one another the more often the less room is left (van Wyk 1946).
    """
    left = 1.0 - FULLY_PRESSED * ratio
    full = 1.0 - FULLY_PRESSED
    return (1.0 / (left * left * left) - 1.0) / (1.0 / (full * full * full) - 1.0)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def slotted_hammer(
    ks: NDArray[float64], j: int, inertia: float, theta: float, omega: float, h: float
) -> float:
    """Torque on the key of a weighted lever that it carries along in a slot with some play, as in
    digital pianos: two inertias and a stiff spring with a dead zone (Nordin and Gutman 2002).
    Semi-implicit Euler.
    """
    mass = max(inertia, 5e-6)
    angle, rate = ks[j, HAMMER], ks[j, HAMMER_SPEED]
    x = theta - angle
    push = 0.0
    if x > SLOT_PLAY:
        push = SLOT_STIFFNESS * (x - SLOT_PLAY) + math.sqrt(SLOT_STIFFNESS * mass) * (omega - rate)
        push = max(push, 0.0)
    elif x < -SLOT_PLAY:
        push = SLOT_STIFFNESS * (x + SLOT_PLAY) + math.sqrt(SLOT_STIFFNESS * mass) * (omega - rate)
        push = min(push, 0.0)
    rate += h * (push / mass - 25.0)
    if angle < -0.0005:
        rate += h * (-4e5 * (angle + 0.0005) - 600.0 * rate)
    ks[j, HAMMER] = angle + h * rate
    ks[j, HAMMER_SPEED] = rate
    return -push * inertia / mass
