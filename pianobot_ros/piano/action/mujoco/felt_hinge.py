"""The action on felt as the mechanism of a hinged key in MuJoCo: coupler, rails and string by Hunt
and Crossley (``piano/action/felt.py``), which MuJoCo has not.

The key is a body of the model; its hammer lives here, in substeps of its own, since a hammer's felt
on a string is far stiffer than anything that MuJoCo steps. Key and hammer push each other through
the coupler: the hammer sees the key go on at its speed through the step, the key the mean of the
coupler's force. Positions are counted from rest, where the hammer's weight presses coupler and back
rail. There is no let-off: that is :mod:`~pianobot_ros.piano.action.mujoco.mujoco_parts`, on
springs.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from pianobot_ros.cell.arrays import Array
from pianobot_ros.piano.action.felt import (
    COUPLER,
    POWER,
    RAIL,
    STEP,
    STIFFNESS,
    felt_force,
    felts_of,
)
from pianobot_ros.piano.action.mujoco.hinge import HingeMechanism, balance, find_hinge
from pianobot_ros.piano.action.mujoco.mujoco_parts import ActionEvent
from pianobot_ros.piano.action.parameters import ActionParameters, load_parameters

__all__ = ["FeltActions", "add_felt_key"]

MASS, BUSHING, WEIGHT, DIP, HEIGHT, BACK = range(6)
STRING = 2  # row of the felts
HAMMER, SPEED, TOUCHING = range(3)  # what an action remembers
REST = 1e-9  # m/s, N: below it an action at rest is left alone, so that its key may sleep


def add_felt_key(
    spec: mujoco.MjSpec,
    key_body: str,
    key_joint: str,
    *,
    radius: float,
    parameters: ActionParameters | None = None,
) -> None:
    """Give the hinged key ``key_body`` of ``spec`` the paper's inertia and damping at ``radius`` m
    from ``key_joint``; the rest is :class:`FeltActions`. Raises :class:`ConfigError` as
    :func:`~pianobot_ros.piano.action.mujoco.hinge.add_action_mechanism`.
    """
    p = parameters or load_parameters()
    body, joint = find_hinge(spec, key_body, key_joint)
    square = radius**2
    hinge = HingeMechanism(
        radius, p.key.mass * square, p.key.damping * square, 0.0, p.key.dip / radius, 0.0, 0.0, 0.0
    )
    balance(body, joint, hinge, radius)
    joint.armature = 0.0
    joint.damping[0] = hinge.damping
    joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _advance(
    h: float,
    substeps: int,
    keys: NDArray[np.int64],
    radius: Array,
    p: Array,
    felts: Array,
    q: Array,
    v: Array,
    applied: Array,
    memory: Array,
    struck: Array,
) -> int:
    """One step of all actions, up to the end of which ``applied`` acts on the keys. ``struck`` (n,
    2): which actions' hammers met their strings, and how fast; returns how many.
    """
    count, dt = 0, h / substeps
    for i in range(keys.shape[0]):
        r, own = radius[i], memory[i]
        x, w = q[keys[i, 0]] * r, v[keys[i, 1]] * r
        place, speed = own[HAMMER], own[SPEED]
        bed = felt_force(x - p[DIP], w, felts[RAIL])
        back = felt_force(p[BACK] - x, -w, felts[RAIL])
        if abs(w) < REST and abs(speed) < REST:
            push = felt_force(x - place, w - speed, felts[COUPLER])
            if abs(push - p[WEIGHT]) < REST and abs(back - bed - push) < REST:
                applied[keys[i, 1]] = 0.0
                continue
        coupled = 0.0
        for s in range(substeps):
            at = x + w * (s + 0.5) * dt
            push = felt_force(at - place, w - speed, felts[COUPLER])
            string = felt_force(place - p[HEIGHT], speed, felts[STRING])
            if string > 0.0 and own[TOUCHING] == 0.0:
                struck[count, 0], struck[count, 1] = i, speed
                count += 1
            own[TOUCHING] = 1.0 if string > 0.0 else 0.0
            speed += dt * (push - string - p[WEIGHT] - p[BUSHING] * speed) / p[MASS]
            place += dt * speed
            coupled += push / substeps
        own[HAMMER], own[SPEED] = place, speed
        applied[keys[i, 1]] = (back - bed - coupled) * r
    return count


class FeltActions:
    """The actions of a compiled ``model``, whose keys are hinges ``joints`` pressed at ``radii``
    (n,) m from them. Call :meth:`update` before a step.

    Attributes: ``events``, the strings struck since the last :meth:`reset`; ``memory`` (n, 3):
    place m and speed m/s of each hammer, seen at the key, and whether it touches its string.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        joints: Sequence[str],
        radii: Array,
        parameters: ActionParameters | None = None,
    ) -> None:
        p = parameters or load_parameters()
        self.joints, self.events = tuple(joints), list[ActionEvent]()
        self.felts = felts_of(p)
        self._step = float(model.opt.timestep)
        self._substeps = int(np.ceil(self._step / STEP - 1e-9))
        found = [model.joint(j) for j in joints]
        self._keys = np.array([(j.qposadr[0], j.dofadr[0]) for j in found], dtype=np.int64)
        self._radii = np.ascontiguousarray(radii, dtype=float)
        weight = p.hammer.weight
        self._sunk, back = (self._depth(weight, felt) for felt in (COUPLER, RAIL))
        self._numbers = np.array(
            [p.hammer.mass, p.hammer.bushing_damping, weight, p.key.dip, p.string.height, back]
        )
        self._struck: Array = np.zeros((len(self.joints) * self._substeps, 2))
        self.memory: Array = np.zeros((len(self.joints), 3))
        self.reset()

    def _depth(self, force: float, felt: int) -> float:
        """How far a force presses a felt, m."""
        stiffness, power = self.felts[felt, STIFFNESS], self.felts[felt, POWER]
        return float((force / stiffness) ** (1.0 / power))

    def reset(self) -> None:
        """All actions at rest."""
        self.events.clear()
        self.memory[:] = 0.0
        self.memory[:, HAMMER] = -self._sunk

    def update(self, data: mujoco.MjData) -> None:
        """Advance the hammers through the coming step and press the keys."""
        count = _advance(
            self._step,
            self._substeps,
            self._keys,
            self._radii,
            self._numbers,
            self.felts,
            data.qpos,
            data.qvel,
            data.qfrc_applied,
            self.memory,
            self._struck,
        )
        for i, speed in self._struck[:count].tolist():
            self.events.append(
                ActionEvent(float(data.time), self.joints[int(i)], "string made", speed)
            )
