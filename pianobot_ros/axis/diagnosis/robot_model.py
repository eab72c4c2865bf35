"""A model of the whole robot (URDF or MJCF) as regressor: gravity and inertia of each joint as they
change with the other joints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import HIGHEST, MAX_RATE
from pianobot_ros.axis.signals.filtering import derivative, low_pass
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

__all__ = ["RobotModel"]

PACE = 0.05
"""s between two poses that the model is asked at; gravity changes little within."""
MOST = 20_000
"""Poses of one log."""
MOST_FINE = 200_000
"""Samples of one log at which other joints' motion is asked for."""


class RobotModel:
    """Gravity and inertia of the joints of a robot, by MuJoCo.

    Raises GapError in one line if the file cannot be loaded or names no joint with an angle.
    """

    def __init__(self, path: Path) -> None:
        import mujoco

        if not path.is_file():
            raise GapError(f"{path}: no such model")
        self._mujoco: Any = mujoco
        self._model = self._loaded(path)
        self._data = mujoco.MjData(self._model)
        kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
        numbers = [k for k in range(self._model.njnt) if int(self._model.jnt_type[k]) in kinds]
        self.joints = {str(self._model.joint(k).name): k for k in numbers}
        if not self.joints:
            raise GapError(f"{path.name}: holds no hinge or slide joint")

    def _loaded(self, path: Path) -> Any:
        """The compiled model; where its meshes are missing, without them: gravity and inertia
        stand with the bodies.
        """
        try:
            return self._mujoco.MjModel.from_xml_path(str(path))
        except Exception as error:  # whatever a damaged file makes the compiler throw
            text = " ".join(str(error).split())[:160]
        try:
            spec = self._mujoco.MjSpec.from_file(str(path))
            shapes = [g for g in spec.geoms if g.type == self._mujoco.mjtGeom.mjGEOM_MESH]
            for part in (*shapes, *spec.meshes, *spec.textures, *spec.materials):
                spec.delete(part)
            return spec.compile()
        except Exception:  # nor without
            raise GapError(f"{path.name}: cannot be loaded as URDF or MJCF ({text})") from None

    def matched(self, names: Sequence[str]) -> dict[str, int]:
        """Joints of a log by their number in the model: by name; joints that only have a number,
        and not all in the model, by their place, from 0 where one is called that, else from 1; or
        in order if equally many.

        Raises GapError if neither fits.
        """
        low = {_plain(n): k for n, k in self.joints.items()}
        by_name = {n: low[_plain(n)] for n in names if _plain(n) in low}
        places = list(self.joints.values())
        if len(by_name) < len(names) and all(n.isdigit() for n in names):
            at = {n: int(n) - (0 if "0" in names else 1) for n in names}
            if max(at.values()) < len(places):
                return {n: places[k] for n, k in at.items()}
        if by_name:
            return by_name
        if len(names) == len(self.joints):
            return dict(zip(names, self.joints.values(), strict=True))
        raise GapError(
            f"the log's joints ({', '.join(names) or 'one without a name'}) are none of the model's"
            f" ({', '.join(self.joints)})"
        )

    def told(self, log: Log) -> Log:
        """The log with what the model says of its joint; one that the model lacks stays as it is,
        and that is said.
        """
        said = self.regressor(log)
        if said is None:
            note = f"the model holds no joint {log.joint!r}"
            return replace(log, notes=(*log.notes, note))
        inertia = float(np.mean(said[:, 2]))
        said[:, 2] /= max(inertia, 1e-12)
        return replace(log, model=said, coupling=self.coupling(log), inertia=inertia)

    def regressor(self, log: Log) -> Array | None:
        """Sine and cosine of gravity and inertia, (n, 3), at the samples of a log; None for a joint
        that the model does not hold.

        Gravity is a·sin q + b·cos q of the joint's own angle q, a and b following the others.
        """
        found = self.matched(log.joints)
        if log.joint not in found:
            return None
        angles = {log.joint: log.position, **log.others}
        step = max(PACE, float(np.ptp(log.t)) / MOST)
        times = np.arange(log.t[0], log.t[-1] + step, step)
        poses = {
            k: np.interp(times, log.t[ok], angles[n][ok])
            for n, k in found.items()
            if n in angles and (ok := np.isfinite(angles[n])).sum() > 1
        }
        made = np.array([self._at(found[log.joint], poses, i) for i in range(times.size)])
        return np.stack([np.interp(log.t, times, column) for column in made.T], axis=1)

    def coupling(self, log: Log) -> Array | None:
        """Effort (n,) that the other joints' motion draws of a log's joint: inverse dynamics less
        the joint's own inertia and its weight. None for a joint that the model does not hold, and
        for a log of too many samples.

        Motions are smoothed as a log's are that is cleaned.
        """
        found = self.matched(log.joints)
        dt = max(log.interval, 1.0 / MAX_RATE)
        times = np.arange(log.t[0], log.t[-1], dt)
        if log.joint not in found or not 50 < times.size <= MOST_FINE:
            return None
        model, data = self._model, self._data
        q, v, a = (np.zeros((times.size, model.njnt)) for _ in range(3))
        for name, y in {log.joint: log.position, **log.others}.items():
            ok = np.isfinite(y)
            if name in found and ok.sum() > 1:
                k = found[name]
                q[:, k] = low_pass(np.interp(times, log.t[ok], y[ok]), dt, min(HIGHEST, 0.2 / dt))
                v[:, k] = derivative(q[:, k], dt)
                a[:, k] = derivative(v[:, k], dt)
        own = found[log.joint]
        dof, dofs = int(model.jnt_dofadr[own]), model.jnt_dofadr[list(found.values())]
        angles = model.jnt_qposadr[list(found.values())]
        moved = list(found.values())
        full, drawn = np.zeros((model.nv, model.nv)), np.empty(times.size)
        for i in range(times.size):
            data.qpos[angles], data.qvel[:] = q[i, moved], 0.0
            self._mujoco.mj_forward(model, data)
            weight = float(data.qfrc_bias[dof])
            data.qvel[dofs] = v[i, moved]
            self._mujoco.mj_forward(model, data)
            self._mujoco.mj_fullM(model, data, full)
            shared = float(full[dof, dofs] @ a[i, moved]) - full[dof, dof] * a[i, own]
            drawn[i] = float(data.qfrc_bias[dof]) - weight + shared
        return np.asarray(np.interp(log.t, times, drawn))

    def _at(self, joint: int, poses: Mapping[int, Array], i: int) -> tuple[float, float, float]:
        model, data = self._model, self._data
        dof, own = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
        data.qvel[:] = 0.0
        for k, angle in poses.items():
            data.qpos[int(model.jnt_qposadr[k])] = angle[i]
        here = float(data.qpos[own])
        torque = []
        for at in (0.5 * math.pi, 0.0, here):
            data.qpos[own] = at
            self._mujoco.mj_forward(model, data)
            torque.append(float(data.qfrc_bias[dof]))
        full = np.zeros((model.nv, model.nv))
        self._mujoco.mj_fullM(model, data, full)
        if int(model.jnt_type[joint]) == int(self._mujoco.mjtJoint.mjJNT_SLIDE):
            return 0.0, 0.0, float(full[dof, dof])
        return torque[0], torque[1], float(full[dof, dof])


def _plain(name: str) -> str:
    return (
        "".join(c for c in name.lower() if c.isalnum()).removeprefix("joint").removesuffix("joint")
    )
