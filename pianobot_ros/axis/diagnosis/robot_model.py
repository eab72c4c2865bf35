"""A model of the whole robot (URDF or MJCF) as regressor: gravity and inertia of each joint as they
change with the other joints.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.log import Log
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

__all__ = ["RobotModel"]

PACE = 0.05
"""s between two poses that the model is asked at; gravity changes little within."""
MOST = 20_000
"""Poses of one log."""


class RobotModel:
    """Gravity and inertia of the joints of a robot, by MuJoCo.

    Raises GapError in one line if the file cannot be loaded or names no joint with an angle.
    """

    def __init__(self, path: Path) -> None:
        import mujoco

        if not path.is_file():
            raise GapError(f"{path}: no such model")
        try:
            self._model = mujoco.MjModel.from_xml_path(str(path))
        except Exception as error:  # whatever a damaged file makes the compiler throw
            text = " ".join(str(error).split())[:160]
            raise GapError(f"{path.name}: cannot be loaded as URDF or MJCF ({text})") from None
        self._mujoco: Any = mujoco
        self._data = mujoco.MjData(self._model)
        kinds = {int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)}
        numbers = [k for k in range(self._model.njnt) if int(self._model.jnt_type[k]) in kinds]
        self.joints = {str(self._model.joint(k).name): k for k in numbers}
        if not self.joints:
            raise GapError(f"{path.name}: holds no hinge or slide joint")

    def matched(self, names: Sequence[str]) -> dict[str, int]:
        """Joints of a log by their number in the model: by name, or in order if equally many.

        Raises GapError if neither fits.
        """
        low = {_plain(n): k for n, k in self.joints.items()}
        by_name = {n: low[_plain(n)] for n in names if _plain(n) in low}
        if by_name:
            return by_name
        if len(names) == len(self.joints):
            return dict(zip(names, self.joints.values(), strict=True))
        raise GapError(
            f"the log's joints ({', '.join(names) or 'one without a name'}) are none of the model's"
            f" ({', '.join(self.joints)})"
        )

    def regressor(self, log: Log) -> Array | None:
        """Sine and cosine of gravity and inertia relative to its mean, (n, 3), at the samples of a
        log; None for a joint that the model does not hold.

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
        made[:, 2] /= max(float(np.mean(made[:, 2])), 1e-12)
        return np.stack([np.interp(log.t, times, column) for column in made.T], axis=1)

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
