"""The posture of a cell from what is measured of it.

Wrist, keys and vacuum are measured; the finger joints of the soft hand are not. They are estimated:
every hinge is the twin's spring at the stiffness of the measured vacuum, gravity acts, and a
fingertip rests on the key under it, at the key's measured angle, where the finger's springs, the
pad and the key balance. A key that has no encoder gives way as the twin's key does. No dynamics: a
finger in free swing is drawn at rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import FINGERS, is_black
from pianobot_ros.piano.twin.model.arm import arm_inverse
from pianobot_ros.piano.twin.model.cell_model import TwinModel
from pianobot_ros.piano.twin.model.hand import abduction_joint, flexion_joints, tip_geom

__all__ = ["Measured", "Posture", "PostureSolver"]

ITERATIONS = 4
EDGE = 0.004  # m by which a fingertip's centre may lie beside a key's edge and still rest on it


@dataclass(frozen=True)
class Measured:
    """What is known of a cell at a moment: wrist ``pose`` (6,) m and rotation vector rad; arm
    ``joints`` (6,) rad or None; ``pressure`` (3,) Pa gauge; ``keys`` rad by note, those measured;
    ``force`` N on the key ``force_note``, or None.
    """

    pose: Array
    joints: Array | None = None
    pressure: Array = field(default_factory=lambda: np.zeros(3))
    keys: dict[int, float] = field(default_factory=dict)
    force: float | None = None
    force_note: int | None = None


@dataclass(frozen=True)
class Posture:
    """A posture of the model: positions ``xpos`` (bodies, 3) m and orientations ``xquat`` (bodies,
    4); where the arrow of force stands ``tip`` (3,) m, ``force`` N, and whether that force is
    ``measured`` or estimated.
    """

    qpos: Array
    xpos: Array
    xquat: Array
    tip: Array
    force: float
    measured: bool


class PostureSolver:
    """For one cell. ``twin`` is its own: vacuum changes the model's stiffness."""

    def __init__(self, twin: TwinModel) -> None:
        self.twin, self.model = twin, twin.model
        self.data = mujoco.MjData(self.model)
        m = self.model
        self._dofs, self._qpos, self._tips, self._radius = {}, {}, {}, {}
        for finger in twin.options.fingers:
            names = (abduction_joint(finger), *flexion_joints(finger, twin.hand))
            joints = [m.joint(name).id for name in names]
            self._dofs[finger] = m.jnt_dofadr[joints]
            self._qpos[finger] = m.jnt_qposadr[joints]
            self._tips[finger] = m.geom(tip_geom(finger)).id
            self._radius[finger] = twin.hand.fingers[finger].radius
        self._jacobian = np.zeros((3, m.nv))
        self._bias = np.zeros(m.nv)
        self._pressure: Array | None = None
        self._pose: Array | None = None
        self._arm: Array = np.zeros(6)

    def solve(self, measured: Measured) -> Posture:
        """The posture in which the cell is seen. Raises PianobotError where the arm cannot
        reach.
        """
        if self._pressure is None or np.any(np.abs(measured.pressure - self._pressure) > 100.0):
            self._pressure = np.nan_to_num(measured.pressure)
            self.twin.set_pressure(self._pressure)
        if self._pose is None or np.any(np.abs(measured.pose - self._pose) > 1e-6):
            self._pose, self._arm = measured.pose.copy(), arm_inverse(measured.pose)
        data = self.data
        data.qpos[:] = 0.0
        data.qpos[:6] = self._arm
        for note, angle in measured.keys.items():
            data.qpos[self.twin.key_qpos[self.twin.notes.index(note)]] = angle
        loads = dict.fromkeys(self._dofs, 0.0)
        touched: dict[str, int] = {}
        for _ in range(ITERATIONS):
            self._kinematics()
            for finger in self._dofs:
                on = self._relax(finger, loads, measured.keys)
                if on is not None:
                    touched[finger] = on
        self._kinematics()
        tip, force, known = self._arrow(loads, touched, measured)
        if measured.joints is not None:
            # Drawn as the arm says it stands; the hand stays where the wrist was measured.
            data.qpos[:6] = measured.joints
        wrist = self.model.body("wrist").id
        held = data.xpos[wrist:].copy(), data.xquat[wrist:].copy()
        mujoco.mj_kinematics(self.model, data)
        data.xpos[wrist:], data.xquat[wrist:] = held
        return Posture(data.qpos.copy(), data.xpos.copy(), data.xquat.copy(), tip, force, known)

    def _kinematics(self) -> None:
        m, d = self.model, self.data
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        mujoco.mj_comVel(m, d)
        mujoco.mj_rne(m, d, 0, self._bias)

    def _relax(self, finger: str, loads: dict[str, float], keys: dict[int, float]) -> int | None:
        """One Newton step of a finger towards balance; the note of the key it is on, if any."""
        m, d, dofs = self.model, self.data, self._dofs[finger]
        stiffness = m.jnt_stiffness[m.dof_jntid[dofs]]
        geom = self._tips[finger]
        centre = d.geom_xpos[geom]
        found = self._key_under(centre)
        load, push = loads[finger], np.zeros(len(dofs))
        if found is not None:
            note, hinge, normal, top = found
            mujoco.mj_jac(m, d, self._jacobian, None, centre, m.geom_bodyid[geom])
            lever = normal @ self._jacobian[:, dofs]
            distance = float((centre - hinge) @ normal) - top - self._radius[finger]
            # The finger as it would stand under the present load, to first order.
            target = (load * lever - self._bias[dofs]) / stiffness
            distance += float(lever @ (target - d.qpos[self._qpos[finger]]))
            pad = 1.0 / self.twin.hand.pad.stiffness
            give = float(lever @ (lever / stiffness)) + pad
            give += self._key_gives(note, load, keys, centre)
            load = max(0.0, load - (distance + load * pad) / give)
            push = load * lever
            if note not in keys:
                self._press(note, load, centre)
        loads[finger] = load
        d.qpos[self._qpos[finger]] = (push - self._bias[dofs]) / stiffness
        return found[0] if found is not None and load > 0.0 else None

    def _key_under(self, centre: Array) -> tuple[int, Array, Array, float] | None:
        """Note, a point of the hinge (3,), the top's normal (3,) and its height above the hinge."""
        board = self.twin.board
        best = None
        for i, note in enumerate(self.twin.notes):
            black = is_black(note)
            body = self.model.jnt_bodyid[self.model.dof_jntid[self.twin.key_dof[i]]]
            hinge = self.data.xpos[body]
            half = (board.black.width if black else board.white.width) / 2
            length = board.white.pivot - (board.black.front if black else 0.0)
            behind = float(hinge[1] - centre[1])
            if abs(centre[0] - hinge[0]) > half + EDGE or not -0.02 < behind < length + EDGE:
                continue
            normal = self.data.xmat[body].reshape(3, 3)[:, 2]
            top = board.black.height if black else 0.0
            nearer = abs(float(centre[0] - hinge[0])) - (0.02 if black else 0.0)
            if best is None or nearer < best[0]:
                best = (nearer, (note, hinge, normal, top))
        return None if best is None else best[1]

    def _radius_at(self, note: int, centre: Array) -> float:
        hinge_y = self.twin.board.origin[1] + self.twin.board.white.pivot
        return max(float(hinge_y - centre[1]), 0.02)

    def _key_gives(self, note: int, load: float, keys: dict[int, float], centre: Array) -> float:
        """Compliance of a key without encoder at the fingertip, m/N; 0 of one that is measured."""
        if note in keys:
            return 0.0
        mechanism, radius = self.twin.board.mechanism, self._radius_at(note, centre)
        if radius * load / mechanism.stiffness >= mechanism.max_angle:
            return 1.0 / mechanism.stop_stiffness
        return radius**2 / mechanism.stiffness

    def _press(self, note: int, load: float, centre: Array) -> None:
        mechanism = self.twin.board.mechanism
        angle = self._radius_at(note, centre) * load / mechanism.stiffness
        place = self.twin.key_qpos[self.twin.notes.index(note)]
        self.data.qpos[place] = min(angle, mechanism.max_angle)

    def _arrow(
        self, loads: dict[str, float], touched: dict[str, int], measured: Measured
    ) -> tuple[Array, float, bool]:
        finger = max(loads, key=lambda f: (loads[f], f == FINGERS[-1]))
        low = self.data.geom_xpos[self._tips[finger]] - [0.0, 0.0, self._radius[finger]]
        if measured.force is not None and touched.get(finger) in (measured.force_note, None):
            return low, measured.force, True
        return low, loads[finger], False
