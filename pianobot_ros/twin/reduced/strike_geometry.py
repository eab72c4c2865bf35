"""Finger and key as the reduced strike model needs them: lengths, masses and moments from the
configuration.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Hand, Keyboard, hand, is_black, keyboard
from pianobot_ros.cell.numbers.nominal import stiffness_calibration

__all__ = ["FingerModel", "KeyModel", "finger_model", "key_model", "stiffness_of"]


@dataclass(frozen=True)
class FingerModel:
    """A finger as a chain of hinges: abduction about the palm's normal at the MCP joint, then one
    flexion for each phalanx.

    ``base`` (3,) m in the wrist frame; ``yaw`` rad; ``pitch`` (n,) absolute pitch of each phalanx
    at rest, rad; ``length`` (n,) m; ``moment`` (n,) kg m: mass that each phalanx carries times
    lever, so that sum(moment_j u_j) is the first moment of mass; ``mass`` (n+1, n+1) generalised
    mass at rest, kg m²; ``mass_total`` kg; ``radius`` m of the tip.
    """

    name: str
    base: Array
    yaw: float
    pitch: Array
    length: Array
    moment: Array
    mass: Array
    radius: float
    abduction_ratio: float
    damping: float
    pad_stiffness: float
    pad_damping: float
    pad_friction: float


@dataclass(frozen=True)
class KeyModel:
    """A key: ``hinge`` (3,) m in the base frame, at the height of the white keys' tops; ``height``
    m of its surface above it; inertia kg m²; stops in N m/rad, springs or felt
    (:class:`~pianobot_ros.cell.motion.geometry.Mechanism`); dry ``friction`` N m.
    """

    note: int
    hinge: Array
    height: float
    inertia: float
    stiffness: float
    damping: float
    max_angle: float
    stop_stiffness: float
    stop_damping: float
    rest_stiffness: float
    rest_damping: float
    radius: float
    stop_radius: float
    friction: float = 0.0
    felt_power: float = 1.0
    felt_force: float = 1.0


@lru_cache(maxsize=16)
def finger_model(name: str, model: Hand | None = None) -> FingerModel:
    """The finger ``name`` of the configured hand."""
    model = model or hand()
    f = model.fingers[name]
    n = len(f.lengths)
    pitch = f.pitch + np.concatenate([[0.0], np.cumsum(f.bends)])
    length, radius = np.array(f.lengths), f.radius
    cylinder = model.density * np.pi * radius**2 * length
    ball = model.density * 4 / 3 * np.pi * radius**3
    mass = cylinder + ball
    centre = length / 2
    # Capsule about its centre, across its axis: cylinder, and two half balls at its ends.
    inertia = cylinder * (length**2 / 12 + radius**2 / 4) + ball * (
        0.4 * radius**2 + length**2 / 4 + 3 / 8 * length * radius
    )
    mass, inertia, centre = mass.copy(), inertia.copy(), centre.copy()
    whole = mass[-1] + model.pad.mass  # the pad is a point at the tip
    shifted = (mass[-1] * centre[-1] + model.pad.mass * length[-1]) / whole
    inertia[-1] += (
        mass[-1] * (centre[-1] - shifted) ** 2 + model.pad.mass * (length[-1] - shifted) ** 2
    )
    mass[-1], centre[-1] = whole, shifted
    beyond = np.concatenate([np.cumsum(mass[::-1])[::-1][1:], [0.0]])
    moment = length * beyond + centre * mass
    big = np.zeros((n + 1, n + 1))
    for i in range(n):
        reach = np.append(length[:i], centre[i])
        along = pitch[: i + 1]
        # d(centre of mass i)/d(flexion k) = sum over phalanges k..i of lever times tangent
        column = np.zeros((n, 2))
        for k in range(i + 1):
            column[k] = [
                -np.sum(reach[k:] * np.sin(along[k:])),
                -np.sum(reach[k:] * np.cos(along[k:])),
            ]
        big[1:, 1:] += mass[i] * column @ column.T
        turning = np.zeros(n)
        turning[: i + 1] = 1.0
        big[1:, 1:] += inertia[i] * np.outer(turning, turning)
        across = float(np.sum(reach * np.cos(along)))
        spin = cylinder[i] * radius**2 / 2 + ball * 0.4 * radius**2
        big[0, 0] += (
            mass[i] * across**2 + inertia[i] * np.cos(pitch[i]) ** 2 + spin * np.sin(pitch[i]) ** 2
        )
    return FingerModel(
        name,
        np.array(f.base),
        f.yaw,
        pitch,
        length,
        moment,
        big,
        radius,
        model.joints.abduction_ratio,
        model.joints.damping,
        model.pad.stiffness,
        model.pad.damping,
        model.pad.friction,
    )


@lru_cache(maxsize=32)
def key_model(note: int, board: Keyboard | None = None) -> KeyModel:
    """The key of ``note`` on the configured keyboard: a wooden box from its front to its hinge, as
    high as the sharp.
    """
    board = board or keyboard()
    m = board.mechanism
    black = is_black(note)
    length = board.white.pivot - (board.black.front if black else 0.0)
    width = board.black.width if black else board.white.width
    top = board.black.height if black else 0.0
    bottom = -board.white.thickness
    mass = board.density * length * width * (top - bottom)
    # about the hinge: along the key, and across it from the bottom to the top
    inertia = mass * (length**2 + top**2 + top * bottom + bottom**2) / 3 + m.added_inertia
    hinge = np.array([0.0, board.origin[1] + board.white.pivot, board.origin[2]])
    r2 = m.reference_radius**2
    radius = board.white.pivot - (board.strike_point.black if black else board.strike_point.white)
    return KeyModel(
        note,
        hinge,
        top,
        inertia,
        m.stiffness,
        m.damping,
        m.max_angle,
        m.stop_stiffness * r2,
        m.stop_damping * r2,
        m.rest_stiffness * r2,
        m.rest_damping * r2,
        radius,
        m.reference_radius,
        m.friction_torque,
        m.felt_power,
        m.felt_force,
    )


@lru_cache(maxsize=1)
def _calibration() -> PchipInterpolator:
    table = stiffness_calibration()
    pressure, stiffness = np.array(table.pressure), np.array(table.stiffness)
    order = np.argsort(pressure)
    return PchipInterpolator(pressure[order], stiffness[order])


def stiffness_of(pressure: float | Array) -> Array:
    """Joint stiffness (N m/rad) at a gauge pressure (Pa, 0 to -100 kPa; clipped to the calibrated
    range).
    """
    curve = _calibration()
    return np.asarray(curve(np.clip(pressure, curve.x[0], curve.x[-1])))
