"""The key about its hinge, with a hammer or without, compiled. Torques in N m, against the motion
down; angles in rad, downwards.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from foreign_cell.law_table import (
    FELT_NONLINEAR,
    HAMMER,
    KEY_FRICTION,
    KEY_PRELOAD,
    KEY_SPRING_CUBIC,
    LET_OFF,
)
from pianobot_ros.cell.arrays import Array, IntArray
from pianobot_ros.cell.motion.geometry import keyboard

__all__ = ["KEY_MEMORY", "Key", "key_torque", "white_key"]

KEY_MEMORY = 4
"""Length of the key's memory: bristle, rad; hammer's angle, rad, and rate, rad/s; 1 while the jack
has escaped.
"""
_BRISTLE, _HAMMER_ANGLE, _HAMMER_RATE, _ESCAPED = range(4)
_SLOW = 0.02  # rad/s
_BRISTLE_LENGTH = 0.0008  # rad
_JACK_STIFFNESS, _JACK_DAMPING = 76.0, 0.05  # N m/rad, N m s/rad
_HAMMER_WEIGHT = 60.0  # rad/s^2, weight's torque over the hammer's inertia
_COUPLING, _COUPLING_DAMPING = 2 * math.pi * 45, 0.15  # rad/s, 1


class Key(NamedTuple):
    """Numbers of a white key, all about its hinge.

    Attributes:
        inertia: kg m^2.
        stiffness: of the spring, N m/rad.
        damping: N m s/rad.
        bottom: angle of the bottom rail, rad.
        bottom_stiffness: N m/rad.
        bottom_damping: N m s/rad.
        rest_stiffness: of the rest rail, N m/rad.
        rest_damping: N m s/rad.
        radius: of the key's reference point, m.
        hinge_forward: place of the hinge in the base frame, m.
        hinge_up: likewise, m.
    """

    inertia: float
    stiffness: float
    damping: float
    bottom: float
    bottom_stiffness: float
    bottom_damping: float
    rest_stiffness: float
    rest_damping: float
    radius: float
    hinge_forward: float
    hinge_up: float


def white_key() -> Key:
    """A white key of the configuration in force: a box about an edge."""
    board = keyboard()
    mechanism, white = board.mechanism, board.white
    length, thickness = white.pivot, white.thickness
    mass = board.density * length * white.width * thickness
    square = mechanism.reference_radius**2
    return Key(
        inertia=mass * (length * length + thickness * thickness) / 3,
        stiffness=mechanism.stiffness,
        damping=mechanism.damping,
        bottom=mechanism.max_angle,
        bottom_stiffness=mechanism.stop_stiffness * square,
        bottom_damping=mechanism.stop_damping * square,
        rest_stiffness=mechanism.rest_stiffness * square,
        rest_damping=mechanism.rest_damping * square,
        radius=mechanism.reference_radius,
        hinge_forward=board.origin[1] + white.pivot,
        hinge_up=board.origin[2],
    )


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def key_torque(
    laws: tuple[IntArray, Array],
    key: Key,
    angle: float,
    rate: float,
    force: float,
    memory: Array,
    h: float,
) -> tuple[float, float]:
    """Torque against the key at the predicted midpoint ``angle`` and ``rate``, rad/s, under the
    contact ``force``, N, and what it adds to the matrix, kg m^2. ``memory`` goes on by ``h`` s.
    """
    law, size = laws
    torque = key.stiffness * angle + key.damping * rate
    implicit = 0.5 * h * key.damping + 0.25 * h * h * key.stiffness
    if law[FELT_NONLINEAR] > 0:
        pushed, tangent = _felt(law[FELT_NONLINEAR], size[FELT_NONLINEAR], key, angle, rate, h)
        torque += pushed
        implicit += tangent
    elif angle > key.bottom:
        pushed = key.bottom_stiffness * (angle - key.bottom) + key.bottom_damping * rate
        if pushed > 0:
            torque += pushed
            implicit += 0.5 * h * key.bottom_damping + 0.25 * h * h * key.bottom_stiffness
    if angle < 0:
        pushed = key.rest_stiffness * angle + key.rest_damping * rate
        if pushed < 0:
            torque += pushed
            implicit += 0.5 * h * key.rest_damping + 0.25 * h * h * key.rest_stiffness
    if law[KEY_FRICTION] == 1:  # Coulomb's law, regularised; bushing loaded by the finger
        level = size[KEY_FRICTION] * (0.4 + 0.6 * force / 3.0)
        drag = level * math.tanh(rate / _SLOW)
        torque += drag
        implicit += 0.5 * h * (drag / rate if abs(rate) > 1e-7 else level / _SLOW)
    elif law[KEY_FRICTION] == 2:
        torque += _bristle_friction(size[KEY_FRICTION], memory, rate, h)
    torque = _static_torques(law, size, key, angle, rate, torque)
    if law[HAMMER] > 0:
        torque += _hammer(law[HAMMER], size[HAMMER], key.bottom, angle, rate, memory, h)
    return torque, implicit


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _felt(
    law: int, thickness: float, key: Key, angle: float, rate: float, h: float
) -> tuple[float, float]:
    """Torque of the bottom felt, whose layer of ``thickness`` m at the key's reference point lies
    before the rail, and what it adds to the matrix. Law 1: exponential (Fung 1967), linear beyond;
    law 2: parabolic, 35 % weaker while it unloads.
    """
    radius = key.radius
    x = (angle - key.bottom) * radius
    stiffness = key.bottom_stiffness / (radius * radius)
    damping = key.bottom_damping / (radius * radius)
    t = thickness
    if law == 1:
        x += t
        if x <= 0:
            return 0.0, 0.0
        if x < t:
            force = stiffness * t * (math.exp(x / t) - 1) / math.e
            slope = stiffness * math.exp(x / t - 1)
        else:
            force, slope = stiffness * (t * (1 - 1 / math.e) + x - t), stiffness
        force += damping * (slope / stiffness) * rate * radius
        implicit = 0.5 * h * damping * slope / stiffness
    else:
        x += 2 * t
        if x <= 0:
            return 0.0, 0.0
        if x < 2 * t:
            force, slope = stiffness * x * x / (4 * t), stiffness * x / (2 * t)
        else:
            force, slope = stiffness * (x - t), stiffness
        unloading = 1 / (1 + math.exp(min(max(rate / _SLOW, -30.0), 30.0)))
        force *= 1 - 0.35 * unloading
        share = min(1.0, x / (2 * t))
        force += damping * share * rate * radius
        implicit = 0.5 * h * damping * share
    if force <= 0:
        return 0.0, 0.0
    return force * radius, radius * radius * (implicit + 0.25 * h * h * slope)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _bristle_friction(level: float, memory: Array, rate: float, h: float) -> float:
    """Elasto-plastic friction (Dupont and others 2002), half as strong on the way up."""
    bent = memory[_BRISTLE]
    slip = 0.0
    if bent * rate > 0:
        if abs(bent) >= _BRISTLE_LENGTH:
            slip = 1.0
        elif abs(bent) > 0.5 * _BRISTLE_LENGTH:
            over = abs(bent) - 0.75 * _BRISTLE_LENGTH
            slip = 0.5 * (1 + math.sin(math.pi * over / (0.5 * _BRISTLE_LENGTH)))
    memory[_BRISTLE] = bent + h * rate * (1 - slip * abs(bent) / _BRISTLE_LENGTH)
    side = 1.0 if memory[_BRISTLE] > 0 else 0.5
    torque: float = level * side * memory[_BRISTLE] / _BRISTLE_LENGTH
    return torque


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _static_torques(
    law: IntArray, size: Array, key: Key, angle: float, rate: float, torque: float
) -> float:
    """``torque`` with what has no memory: preload (a magnet at rest, or a spring over its centre),
    let-off (a bump, or a click that is weaker on the way back) and a spring that stiffens with the
    cube (Duffing 1918).
    """
    if law[KEY_PRELOAD] == 1:
        torque += size[KEY_PRELOAD] * max(0.0, 1 - (angle / 0.035) ** 2)
    elif law[KEY_PRELOAD] == 2:
        over = min(max(angle / 0.05, 0.0), 1.0)
        torque += size[KEY_PRELOAD] * 0.5 * (1 + math.cos(math.pi * over))
    if law[LET_OFF] == 1:
        torque += size[LET_OFF] / (1 + ((angle - 0.031) / 0.004) ** 2)
    elif law[LET_OFF] == 2:
        height = 0.0
        if 0.024 < angle < 0.036:
            height = (angle - 0.024) / 0.012
        elif 0.036 <= angle < 0.038:
            height = (0.038 - angle) / 0.002
        down = 1 / (1 + math.exp(min(max(-rate / _SLOW, -30.0), 30.0)))
        torque += size[LET_OFF] * height * (0.3 + 0.7 * down)
    if law[KEY_SPRING_CUBIC] > 0:
        torque += key.stiffness * size[KEY_SPRING_CUBIC] * angle * (angle / key.bottom) ** 2
    return torque


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _hammer(
    law: int, inertia: float, bottom: float, angle: float, rate: float, memory: Array, h: float
) -> float:
    """Torque on the key of a hammer of ``inertia`` kg m^2. Law 1: it lies on a jack that only
    pushes and escapes near the bottom, flies, and rebounds from a string (Hirschkorn, McPhee,
    Birkett 2006); law 2: it hangs on the key by a spring of 45 Hz (Den Hartog 1956).
    """
    hammer, speed = memory[_HAMMER_ANGLE], memory[_HAMMER_RATE]
    stretch = angle - (hammer + 0.5 * h * speed)
    if law == 1:
        push = _JACK_STIFFNESS * stretch + _JACK_DAMPING * (rate - speed)
        if angle > 0.9 * bottom:
            memory[_ESCAPED] = 1.0
        if angle < 0.7 * bottom:
            memory[_ESCAPED] = 0.0
        if stretch <= 0 or push < 0 or memory[_ESCAPED] > 0.0:
            push = 0.0
        weight = inertia * _HAMMER_WEIGHT
    else:
        push = inertia * (
            _COUPLING * _COUPLING * stretch + 2 * _COUPLING_DAMPING * _COUPLING * (rate - speed)
        )
        weight = 0.0
    acceleration = (push - weight) / inertia
    hammer += h * speed + 0.5 * h * h * acceleration
    speed += h * acceleration
    if law == 1:
        if hammer > 1.3 * bottom and speed > 0:
            speed = -0.5 * speed
        if memory[_ESCAPED] > 0.0 and hammer < 0.7 * bottom and speed < 0:
            speed = 0.0
        if hammer < -0.01 and speed < 0:
            speed = 0.0
            hammer = -0.01
    memory[_HAMMER_ANGLE], memory[_HAMMER_RATE] = hammer, speed
    torque: float = push
    return torque
