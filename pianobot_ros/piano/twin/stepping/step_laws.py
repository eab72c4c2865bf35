"""Mechanical laws that MuJoCo lacks in the twin: departures from the nominal laws, and the felt of
keys that have it. What MuJoCo has is set in the model, the rest acts in each step.
"""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.piano.twin.model.cell_model import TwinModel
from pianobot_ros.piano.twin.model.hand import abduction_joint, flexion_joints, tip_geom
from pianobot_ros.piano.twin.model.keyboard import key_geom, key_joint
from pianobot_ros.piano.twin.reduced.strike_geometry import finger_model, key_model
from pianobot_ros.piano.twin.reduced.strike_laws import NULLS, vector
from pianobot_ros.piano.twin.stepping.step_kernel import (
    ANGLE,
    FRICTION,
    PRELOAD,
    act_on_joints,
    act_on_keys,
    act_on_tips,
)

__all__ = ["StepLaws"]


SETTLING = 0.1  # s after a start in which joints find their rest and laws remember nothing
_JOINTS = (
    "joint_friction",
    "joint_backlash",
    "joint_hardening",
    "jamming_hysteresis",
    "joint_creep",
)
_KEYS = ("key_friction", "key_preload", "hammer", "let_off")
_TIPS = ("pad_softening", "tip_slip_weakening")


class StepLaws:
    """The mechanical ``numbers`` (see ``strike_laws.py``) in a model of the whole hand.

    :meth:`set_model` sets what MuJoCo has natively; call the object before each step, and
    :meth:`remove` to go back. The factors of nominal numbers are the model's own
    (:meth:`TwinModel.set_parameters`) and are left out here.
    """

    def __init__(self, cell: TwinModel, data: mujoco.MjData, numbers: Mapping[str, float]) -> None:
        own = ("joint_stiffness", "joint_damping", "key_stiffness", "key_damping", "key_inertia")
        self.numbers = {**NULLS, **numbers, **dict.fromkeys(own, 1.0)}
        self.p = vector(self.numbers)
        self._cell, self._data = cell, data
        self._views = data.qpos, data.qvel, data.qfrc_applied
        self._step = cell.timestep
        spring = cell.options.mechanism == "spring"
        changed = {n for n, x in self.numbers.items() if x != NULLS[n]}
        self._joints_act = bool(changed & set(_JOINTS))
        self._keys_act = bool(changed & {*_KEYS, *(("felt_exponent",) if spring else ())})
        self._keys_act |= spring and cell.board.mechanism.acts_by_steps
        self._tips_act = bool(changed & set(_TIPS))
        self._index()
        self.reset()

    def _index(self) -> None:
        cell, m = self._cell, self._cell.model
        rows: list[tuple[int, int, int, int]] = []
        spans = {}
        for finger in cell.options.fingers:
            first = len(rows)
            for sideways, name in [
                (1, abduction_joint(finger)),
                *((0, n) for n in flexion_joints(finger, cell.hand)),
            ]:
                joint = m.joint(name)
                rows.append((joint.qposadr[0], joint.dofadr[0], joint.id, sideways))
            spans[finger] = first, len(rows)
        self._joints = np.array(rows, dtype=np.int64).reshape(-1, 4)
        keys = [m.joint(key_joint(n)) for n in cell.notes]
        self._keys = np.array(
            [
                (k.qposadr[0], k.dofadr[0], touch)
                for k, touch in zip(keys, cell.force_index, strict=True)
            ],
            dtype=np.int64,
        )
        models = [key_model(n) for n in cell.notes]
        self._places = np.array([(k.hinge_y, k.hinge_z, k.height) for k in models])
        k, spring = models[0], cell.options.mechanism == "spring"
        self._mechanism = np.array(
            [
                k.max_angle,
                k.stop_stiffness / k.stop_radius**2,
                k.stop_damping,
                k.stop_radius,
                k.rest_stiffness / k.stop_radius**2,
                k.rest_damping / k.stop_radius**2,
                k.felt_power if spring else 1.0,
                k.felt_force,
                k.preload if spring else 0.0,
                k.rest_angle if spring else 0.0,
                k.friction if spring else 0.0,
            ]
        )
        self._preload = float(self._mechanism[PRELOAD])
        self._tips = {f: m.geom(tip_geom(f)).id for f in cell.options.fingers}
        contacts, order = [], []
        for finger in cell.options.fingers:
            for i, note in enumerate(cell.notes):
                contacts.append((self._tips[finger], i, *spans[finger]))
                order.append(m.pair(f"{tip_geom(finger)}_{key_geom(note)}").id)
        back = np.argsort(order)
        self._contacts = np.array(contacts, dtype=np.int64)[back]
        self._radius = m.geom_size[self._contacts[:, 0], 0].copy()
        self._homes = {f: m.geom_pos[i].copy() for f, i in self._tips.items()}
        self._limits = m.jnt_range[[k.id for k in keys]].copy()
        self._key_joints = [k.id for k in keys]

    @property
    def acts(self) -> bool:
        """Whether there is anything that acts in each step."""
        return self._joints_act or self._keys_act or self._tips_act

    def reset(self) -> None:
        """At rest, nothing remembered but where friction held the joints."""
        self._joint_memory: Array = np.zeros((len(self._joints), 5))
        self._joint_memory[:, FRICTION] = self.numbers["joint_friction_rest"]
        self._joint_memory[:, ANGLE] = self._data.qpos[self._joints[:, 0]]
        self._key_memory: Array = np.zeros((len(self._keys), 4))
        self._key_memory[:, ANGLE] = self._data.qpos[self._keys[:, 0]]
        self._tip_memory: Array = np.zeros((len(self._contacts), 4))
        self._tip_memory[:, 0] = -1.0
        self._began = float(self._data.time)
        self._angle, self._rate = np.zeros(len(self._keys)), np.zeros(len(self._keys))

    def set_model(self) -> None:
        """Put into the model what MuJoCo has natively. Repeat it after
        :meth:`TwinModel.set_parameters`.
        """
        m, n, pad = self._cell.model, self.numbers, self._cell.hand.pad
        m.pair_solref[:, 0] *= n["pad_stiffness"]
        self._friction = pad.friction * (1.0 - n["tip_slip"])
        m.pair_friction[:, :2] = self._friction
        self._solref = m.pair_solref.copy()
        for finger, geom in self._tips.items():
            yaw = finger_model(finger).yaw
            ahead, up = np.array([-np.sin(yaw), np.cos(yaw), 0.0]), np.array([0.0, 0.0, 1.0])
            m.geom_pos[geom] = self._homes[finger] + n["tip_reach"] * ahead - n["tip_drop"] * up
        if self._cell.options.mechanism == "spring":
            self._mechanism[PRELOAD] = self._preload * self._cell.options.factor("key_stiffness")
            felt = n["felt_thickness"] / self._mechanism[3]
            m.jnt_range[self._key_joints, 1] = self._limits[:, 1] - felt

    def remove(self) -> None:
        """Leave the model as it was without laws; contacts, joints and pressure are to be set
        anew.
        """
        m = self._cell.model
        for finger, geom in self._tips.items():
            m.geom_pos[geom] = self._homes[finger]
        m.jnt_range[self._key_joints] = self._limits
        self._data.qfrc_applied[:] = 0.0

    def __call__(self) -> None:
        """Act in the step to come."""
        m, d, p, h = self._cell.model, self._data, self.p, self._step
        if self._joints_act:
            act_on_joints(
                p,
                h,
                self._cell.implicit,
                self._cell.damping,
                self._joints,
                d.qpos,
                d.qvel,
                m.jnt_stiffness,
                d.qfrc_applied,
                m.dof_armature,
                self._joint_memory,
                d.time < self._began + SETTLING,
            )
        if self._tips_act:
            act_on_tips(
                p,
                h,
                self._contacts,
                self._joints,
                self._places,
                self._radius,
                d.qvel,
                self._angle,
                self._rate,
                d.geom_xpos,
                d.xaxis,
                self._solref,
                self._friction,
                m.pair_solref,
                m.pair_friction,
                self._tip_memory,
            )
            self._angle[:], self._rate[:] = d.qpos[self._keys[:, 0]], d.qvel[self._keys[:, 1]]
        if self._keys_act:
            act_on_keys(
                p, h, self._mechanism, self._keys, *self._views, d.sensordata, self._key_memory
            )
