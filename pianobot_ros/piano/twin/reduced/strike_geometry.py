"""Finger and key as the reduced strike model needs them: lengths, masses and moments from the
configuration.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import Hand, Keyboard, hand, is_black, keyboard
from pianobot_ros.cell.numbers.nominal import stiffness_calibration
from pianobot_ros.piano.twin.reduced.strike_records import FingerModel, KeyModel

__all__ = ["finger_model", "key_model", "stiffness_of"]


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
        base=np.array(f.base),
        yaw=f.yaw,
        pitch=tuple(pitch.tolist()),
        length=length,
        moment=moment,
        mass=big,
        radius=float(radius),
        abduction_ratio=float(model.joints.abduction_ratio),
        damping=float(model.joints.damping),
        pad_stiffness=float(model.pad.stiffness),
        pad_damping=float(model.pad.damping),
        pad_friction=float(model.pad.friction),
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
    r2 = m.reference_radius**2
    radius = board.white.pivot - (board.strike_point.black if black else board.strike_point.white)
    return KeyModel(
        hinge_y=float(board.origin[1] + board.white.pivot),
        hinge_z=float(board.origin[2]),
        inertia=float(inertia),
        stiffness=float(m.stiffness),
        damping=float(m.damping),
        max_angle=float(m.max_angle),
        stop_stiffness=float(m.stop_stiffness * r2),
        stop_damping=float(m.stop_damping * r2),
        rest_stiffness=float(m.rest_stiffness * r2),
        rest_damping=float(m.rest_damping * r2),
        stop_radius=float(m.reference_radius),
        height=float(top),
        felt_power=float(m.felt_power),
        felt_force=float(m.felt_force),
        radius=float(radius),
        friction=float(m.friction_torque),
        preload=float(m.preload_torque),
        rest_angle=float(m.rest_angle),
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
