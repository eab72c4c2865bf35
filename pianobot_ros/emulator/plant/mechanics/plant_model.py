"""The plant's clock tick: from the wrist's motion and the pressures over one tick to forces, angles
and key contacts.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.laws.row_layout import (
    BASE,
    CLEAR,
    FATIGUE,
    JAM,
    SAG,
    STIFFNESS,
    YAW,
)
from pianobot_ros.emulator.plant.mechanics.finger_joints import stiffness_at
from pianobot_ros.emulator.plant.mechanics.motion_equations import BaseMotion, advance
from pianobot_ros.emulator.plant.mechanics.physics import (
    Model,
    Simulated,
    State,
    new_state,
    physics,
    plant_parameters,
)

__all__ = ["TICK", "PlantModel", "plant_tick"]


TICK = 1e-3  # s
WARMING_TIME = 20.0  # s
SAG_TIME = 0.1  # s
PATH_WIDTH = (
    30_000.0  # Pa: how far pressure must come back before the grains have forgotten the way
)
FULL_VACUUM = 100_000.0  # Pa


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _matrix(rotation: Array, out: Array) -> None:
    angle = math.sqrt(rotation[0] ** 2 + rotation[1] ** 2 + rotation[2] ** 2)
    if angle < 1e-9:
        a, b = 1.0, 0.5
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
    x, y, z = rotation[0], rotation[1], rotation[2]
    c = math.cos(angle)
    out[0, 0], out[0, 1], out[0, 2] = c + b * x * x, b * x * y - a * z, b * x * z + a * y
    out[1, 0], out[1, 1], out[1, 2] = b * x * y + a * z, c + b * y * y, b * y * z - a * x
    out[2, 0], out[2, 1], out[2, 2] = b * x * z - a * y, b * y * z + a * x, c + b * z * z


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def plant_tick(
    simulated: Simulated,
    start: float,
    dt: float,
    steps: int,
    wrist: Array,
    pressure: Array,
    events: Array,
) -> int:
    """Advance by ``dt`` s in ``steps`` steps while the wrist goes from state 0 to state 1 along a
    cubic.

    ``wrist`` (4, 6) is its pose and twist at the start and those at the end, the rotation as a
    rotation vector and its derivative; ``pressure`` (3,) Pa. Returns the number of note events
    written to ``events`` (n, 4): time, on, key index, speed at the contact point.
    """
    model, state, fingers = simulated
    pose0, twist0, pose1, twist1 = wrist[0], wrist[1], wrist[2], wrist[3]
    plant, hand, curve = model.plant, model.hand, model.curve
    fs, cell = state.fingers, state.cell
    sag_aim = plant.palm_sag * -(pressure[0] + pressure[1] + pressure[2]) / (3.0 * FULL_VACUUM)
    cell[SAG] += (sag_aim - cell[SAG]) * min(dt / SAG_TIME, 1.0)
    rotation0, rotation1 = np.empty((3, 3)), np.empty((3, 3))
    _matrix(pose0[3:], rotation0)
    _matrix(pose1[3:], rotation1)
    base, base_rate = np.empty((3, 3)), np.empty((3, 3))
    acceleration, axes = np.empty((2, 3, 3)), np.empty((2, 3, 3, 3))
    for f in fingers:
        cy, sy = math.cos(hand[f, YAW]), math.sin(hand[f, YAW])
        for i in range(3):
            r0, r1 = rotation0[i], rotation1[i]
            b0 = (
                r0[0] * hand[f, BASE]
                + r0[1] * hand[f, BASE + 1]
                + r0[2] * (hand[f, BASE + 2] - cell[SAG])
            )
            b1 = (
                r1[0] * hand[f, BASE]
                + r1[1] * hand[f, BASE + 1]
                + r1[2] * (hand[f, BASE + 2] - cell[SAG])
            )
            turn = (b1 - b0) / dt
            p0, p1 = pose0[i] + b0, pose1[i] + b1
            v0, v1 = twist0[i] + turn, twist1[i] + turn
            slope = (p1 - p0) / dt
            base[f, i], base_rate[f, i] = p0, v0
            acceleration[0, f, i] = (6.0 * slope - 4.0 * v0 - 2.0 * v1) / dt
            acceleration[1, f, i] = (-6.0 * slope + 2.0 * v0 + 4.0 * v1) / dt
            axes[0, f, 0, i], axes[1, f, 0, i] = -sy * r0[0] + cy * r0[1], -sy * r1[0] + cy * r1[1]
            axes[0, f, 1, i], axes[1, f, 1, i] = -cy * r0[0] - sy * r0[1], -cy * r1[0] - sy * r1[1]
            axes[0, f, 2, i], axes[1, f, 2, i] = r0[2], r1[2]
        warm = 1.0 - plant.stiffness_temperature * (1.0 - math.exp(-max(start, 0.0) / WARMING_TIME))
        if plant.grain_fatigue > 0.0:
            # every press moves some grains, until the vacuum is let go (Brown and others 2010)
            if pressure[f] > -5_000.0:
                fs[f, FATIGUE] *= 1.0 - dt / 0.1
            elif fs[f, CLEAR] == 0.0:
                fs[f, FATIGUE] += (1.0 - fs[f, FATIGUE]) * dt / 1.0
            warm *= 1.0 - plant.grain_fatigue * fs[f, FATIGUE]
        if plant.finger_coupling > 0.0:  # hoses and webs between the fingers stiffen with theirs
            others = (pressure[0] + pressure[1] + pressure[2] - pressure[f]) / 2.0
            warm *= 1.0 - plant.finger_coupling * others / FULL_VACUUM
        path = 0.0
        if plant.jamming_hysteresis_law == 2:  # the same over a wider path
            width = 2.0 * PATH_WIDTH
            fs[f, JAM] = min(max(fs[f, JAM], pressure[f] - width), pressure[f] + width)
            path = plant.jamming_hysteresis * (fs[f, JAM] - pressure[f]) / width
        elif (
            plant.jamming_hysteresis > 0.0 and plant.jamming_hysteresis_law == 0
        ):  # grains jam tighter on the way to more vacuum than on the way back
            fs[f, JAM] = min(max(fs[f, JAM], pressure[f] - PATH_WIDTH), pressure[f] + PATH_WIDTH)
            path = plant.jamming_hysteresis * (fs[f, JAM] - pressure[f]) / PATH_WIDTH
        fs[f, STIFFNESS] = (
            plant.stiffness_scale * stiffness_at(curve, pressure[f]) * warm * (1.0 + 0.5 * path)
        )
    motion = BaseMotion(base, base_rate, acceleration, axes)
    count: int = advance(simulated, start, dt / steps, steps, motion, events)
    return count


class PlantModel:
    """Fingers and keys of one case, stepped tick by tick (the live plant; offline runs compile the
    loop as well).
    """

    def __init__(
        self, case: Case | None = None, fingers: ArrayLike = (0, 1, 2), step: float | None = None
    ) -> None:
        self.case = case or Case()
        model = plant_parameters(
            self.case.strengths(),
            self.case.parameters,
            laws=self.case.laws,
            seed=self.case.seed,
            repeatability=self.case.repeatability,
        )
        self.step_size = step or physics().step
        self.simulated = Simulated(model, new_state(model), np.asarray(fingers, dtype=np.int64))
        self.time = 0.0
        self._events = np.zeros((64, 4))

    @property
    def model(self) -> Model:
        """Its constants."""
        return self.simulated.model

    @property
    def state(self) -> State:
        """Where fingers and keys are."""
        return self.simulated.state

    def tick(
        self,
        pose0: Array,
        twist0: Array,
        pose1: Array,
        twist1: Array,
        pressure: Array,
        dt: float = TICK,
    ) -> Array:
        """Advance by ``dt`` s; see :func:`plant_tick`. Returns the note events (n, 4) of this
        tick.
        """
        steps = max(1, round(dt / self.step_size))
        n = plant_tick(
            self.simulated,
            self.time,
            dt,
            steps,
            np.array([pose0, twist0, pose1, twist1]),
            pressure,
            self._events,
        )
        self.time += dt
        return np.array(self._events[:n])
