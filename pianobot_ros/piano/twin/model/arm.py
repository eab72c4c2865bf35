"""The UR5 that carries the hand: its joints in MuJoCo, and the servo that moves them.

The wrist follows its command as the second-order system of ``config/wrist_model.yaml``, coordinate
by coordinate (position and rotation vector), solved exactly for commands held over a step. The
joint angles of that motion drive position servos in MuJoCo, whose rotors are so heavy that the keys
deflect the wrist by less than a tenth of a micrometre (the nominal law: not at all).

Kinematics: Universal Robots, "DH Parameters for calculations of kinematics and dynamics" (UR5).
"""

from __future__ import annotations

import math
from functools import lru_cache

import mujoco
import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.limits import MountConfig
from pianobot_ros.cell.numbers.config import configured
from pianobot_ros.cell.numbers.nominal import WristServo, wrist_servo

__all__ = [
    "JOINTS",
    "ArmTracker",
    "add_arm",
    "arm_forward",
    "arm_inverse",
    "home_joints",
    "home_pose",
    "mount",
    "servo",
]


JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
DH_D = np.array([0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823])
DH_A = np.array([0.0, -0.425, -0.39225, 0.0, 0.0, 0.0])
DH_ALPHA = np.array([math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0])
MASSES = (3.7, 8.393, 2.33, 1.219, 1.219, 0.1879)
ELBOW_UP = np.array([-2.0, -1.6, 2.0, 1.2, 1.57, 2.7])
"""Near the configuration in which the arm plays; picks the branch of the inverse kinematics."""

# kg m^2, reflected inertia of each joint's rotor: makes the motion independent of what the hand
# touches
ROTOR = 1e4
BANDWIDTH = 400.0  # rad/s of the joint servos, critically damped


@lru_cache(maxsize=1)
def servo() -> WristServo:
    """The servo of the configuration in force."""
    return wrist_servo()


mount = configured("wrist.yaml", MountConfig, "mount")
"""How the hand sits on the flange, by the configuration in force."""


def home_pose() -> Array:
    """Pose (6,) in which the wrist waits: position m and rotation vector rad."""
    return np.array([*mount().home, 0.0, 0.0, 0.0])


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _frames(q: Array, origin: Array, turn: Array) -> None:
    """Fill in origins (7, 3) and orientations (7, 3, 3) of the base and the six links' frames."""
    origin[0] = 0.0
    for i in range(3):
        for j in range(3):
            turn[0, i, j] = 1.0 if i == j else 0.0
    for k in range(6):
        c, s = math.cos(q[k]), math.sin(q[k])
        ca, sa = math.cos(DH_ALPHA[k]), math.sin(DH_ALPHA[k])
        for i in range(3):
            x, y, z = turn[k, i, 0], turn[k, i, 1], turn[k, i, 2]
            turn[k + 1, i, 0] = c * x + s * y
            turn[k + 1, i, 1] = ca * (c * y - s * x) + sa * z
            turn[k + 1, i, 2] = sa * (s * x - c * y) + ca * z
            origin[k + 1, i] = origin[k, i] + DH_A[k] * (c * x + s * y) + DH_D[k] * z


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _flange(pose: Array, mount: Array, offset: Array, place: Array, wanted: Array) -> None:
    """Fill in where the flange is, ``place`` (3,) and ``wanted`` (3, 3), when the wrist is at
    ``pose`` (6,).
    """
    x, y, z = pose[3], pose[4], pose[5]
    angle = math.sqrt(x**2 + y**2 + z**2)
    a = 1.0 - angle * angle / 6 if angle < 1e-5 else math.sin(angle) / angle
    b = 0.5 - angle * angle / 24 if angle < 1e-5 else (1.0 - math.cos(angle)) / angle**2
    rows = (
        (1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y),
        (b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x),
        (b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)),
    )
    for i in range(3):
        r = rows[i]
        place[i] = pose[i]
        for j in range(3):
            wanted[i, j] = r[0] * mount[0, j] + r[1] * mount[1, j] + r[2] * mount[2, j]
            place[i] -= wanted[i, j] * offset[j]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _solve(matrix: Array, right: Array) -> None:
    """Turn ``right`` (6,) into the solution of ``matrix`` (6, 6), which is used up."""
    for k in range(6):
        best = k
        for i in range(k + 1, 6):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if best != k:
            right[k], right[best] = right[best], right[k]
            for j in range(k, 6):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        pivot = matrix[k, k]
        if pivot == 0.0:  # stretched out: no turn of the joints leads nearer
            right[:] = 0.0
            return
        for i in range(k + 1, 6):
            share = matrix[i, k] / pivot
            for j in range(k + 1, 6):
                matrix[i, j] -= share * matrix[k, j]
            right[i] -= share * right[k]
    for k in range(5, -1, -1):
        for j in range(k + 1, 6):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _inverse(
    pose: Array, mount: Array, offset: Array, q: Array, iterations: int
) -> tuple[Array, float]:
    """Joint angles near ``q`` for the wrist ``pose`` by Newton's method, and the miss that is left
    (m and rad). In plain loops: it is done in each step of a moving wrist, where calls of a library
    for matrices would take as long as all of the physics.
    """
    place, wanted = np.empty(3), np.empty((3, 3))
    _flange(pose, mount, offset, place, wanted)
    q = q.copy()
    origin, turn = np.empty((7, 3)), np.empty((7, 3, 3))
    error, jacobian = np.empty(6), np.empty((6, 6))
    miss = 1e9
    for _ in range(iterations):
        _frames(q, origin, turn)
        error[3:] = 0.0
        for i in range(3):
            error[i] = place[i] - origin[6, i]
            j, k = (i + 1) % 3, (i + 2) % 3
            for c in range(3):
                error[3 + i] += 0.5 * (turn[6, j, c] * wanted[k, c] - turn[6, k, c] * wanted[j, c])
        miss = np.abs(error).max()
        if miss < 1e-11:
            break
        for n in range(6):
            for i in range(3):
                j, k = (i + 1) % 3, (i + 2) % 3
                jacobian[i, n] = turn[n, j, 2] * (origin[6, k] - origin[n, k]) - turn[n, k, 2] * (
                    origin[6, j] - origin[n, j]
                )
                jacobian[3 + i, n] = turn[n, i, 2]
        _solve(jacobian, error)
        q += error * min(1.0, 0.3 / max(np.abs(error).max(), 1e-300))
    return q, miss


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _track(
    targets: Array,
    phi: Array,
    dt: float,
    rotor: float,
    kp: float,
    kv: float,
    mount: Array,
    offset: Array,
    pose: Array,
    rate: Array,
    joint: Array,
    speed: Array,
    lift: Array,
    control: Array,
    poses: Array,
    rates: Array,
) -> int:
    """Advance pose, rate, joint and speed by one step for each row of ``targets``. Returns the
    first row out of reach or -1.

    ``lift`` (n + 1,): by how much the wrist is higher than the servo has it, before and after each
    step.
    ``control`` gets the setpoint that moves a joint of inertia ``rotor`` exactly along its path
    with implicit dampers.
    """
    for k in range(targets.shape[0]):
        moving = False
        for i in range(6):
            gap = pose[i] - targets[k, i]
            if gap != 0.0 or rate[i] != 0.0:
                moving = True
            pose[i] = targets[k, i] + phi[0, 0] * gap + phi[0, 1] * rate[i]
            rate[i] = phi[1, 0] * gap + phi[1, 1] * rate[i]
            if abs(rate[i]) < 1e-12 and abs(pose[i] - targets[k, i]) < 1e-13:
                pose[i], rate[i] = targets[k, i], 0.0
        for i in range(6):
            poses[k, i], rates[k, i] = pose[i], rate[i]
        poses[k, 2] += lift[k + 1]
        rates[k, 2] += (lift[k + 1] - lift[k]) / dt
        ahead = joint
        if moving or lift[k + 1] != lift[k]:
            ahead, miss = _inverse(poses[k], mount, offset, joint + dt * speed, 4)
            if miss > 1e-6:
                return k
        for i in range(6):
            new = (ahead[i] - joint[i]) / dt
            control[k, i] = (
                joint[i] + (kv * speed[i] + (rotor + dt * kv) * (new - speed[i]) / dt) / kp
            )
            speed[i] = new
            joint[i] = ahead[i]
    return -1


def arm_forward(joint: ArrayLike) -> Array:
    """Wrist pose (6,) of joint angles (6,) rad: position m and rotation vector rad in the base
    frame.
    """
    seat = mount()
    origin, turn = np.empty((7, 3)), np.empty((7, 3, 3))
    _frames(np.asarray(joint, dtype=float), origin, turn)
    flange = Rotation.from_matrix(turn[6])
    wrist = flange * Rotation.from_rotvec(seat.rotation).inv()
    return np.concatenate([origin[6] + flange.apply(seat.tcp_offset), wrist.as_rotvec()])


def arm_inverse(pose: ArrayLike, near: ArrayLike = ELBOW_UP) -> Array:
    """Joint angles (6,) rad for a wrist pose (6,), in the branch of ``near``. Raises PianobotError
    out of reach.
    """
    seat = mount()
    turn = Rotation.from_rotvec(seat.rotation).as_matrix()
    start, wanted = np.asarray(near, dtype=float), np.asarray(pose, dtype=float)
    q, miss = _inverse(wanted, turn, np.array(seat.tcp_offset), start, 200)
    if not miss < 1e-9:
        raise PianobotError(
            f"the arm cannot reach the wrist position {wanted[:3].round(3).tolist()}: choose one"
            " nearer"
        )
    return np.asarray(start + (q - start + np.pi) % (2 * np.pi) - np.pi)


@lru_cache(maxsize=1)
def home_joints() -> Array:
    """Joint angles (6,) rad in which the arm waits, to as many digits as MJCF keeps, so that an
    export is the same arm.
    """
    return np.asarray(arm_inverse(home_pose()).round(5))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator,unused-ignore]
def _heights(targets: Array, phi: Array, z: float, rate: float) -> Array:
    """Heights (n,) after each step towards ``targets`` (n,), from ``z`` and its ``rate``."""
    out = np.empty_like(targets)
    for k in range(targets.size):
        gap = z - targets[k]
        z = targets[k] + phi[0, 0] * gap + phi[0, 1] * rate
        rate = phi[1, 0] * gap + phi[1, 1] * rate
        out[k] = z
    return out


class ArmTracker:
    """From commanded wrist poses to the controls of MuJoCo's arm, step by step.

    Attributes: ``pose``, ``rate`` (6,) of the wrist as the servo has it; ``lift`` m, by how much it
    is higher; ``joint``, ``speed`` (6,) of the arm.
    """

    def __init__(self, timestep: float, pose: ArrayLike | None = None) -> None:
        seat, law = mount(), servo()
        w, z = law.natural_frequency, law.damping_ratio
        self.timestep = timestep
        self._phi = np.ascontiguousarray(
            expm(np.array([[0.0, 1.0], [-w * w, -2 * z * w]]) * timestep)
        )
        self._mount = np.ascontiguousarray(Rotation.from_rotvec(seat.rotation).as_matrix())
        self._offset = np.array(seat.tcp_offset)
        self.reset(home_pose() if pose is None else pose)

    def reset(self, pose: ArrayLike) -> None:
        """At rest at ``pose`` (6,)."""
        self.pose: Array = np.array(pose, dtype=float)
        self.rate: Array = np.zeros(6)
        self.joint: Array = arm_inverse(self.pose)
        self.speed: Array = np.zeros(6)
        self.lift = 0.0

    def heights(self, targets: Array) -> Array:
        """Heights (n,) m that the servo will have after each of n steps towards ``targets`` (n,
        6).
        """
        aim = np.ascontiguousarray(targets[:, 2])
        return np.asarray(_heights(aim, self._phi, float(self.pose[2]), float(self.rate[2])))

    def advance(self, targets: Array, lift: Array | None = None) -> tuple[Array, Array, Array]:
        """Controls (n, 6) for n steps with the commanded poses ``targets`` (n, 6), and pose and
        rate (n, 6) of the wrist after each. It is higher than the servo has it by ``lift`` (n,) m,
        by default as before.

        Controls are setpoints of the joints, rad from where the arm waits.

        Raises PianobotError if a pose is out of the arm's reach; the tracker then stays where it
        was.
        """
        n = len(targets)
        control, poses, rates = np.empty((n, 6)), np.empty((n, 6)), np.empty((n, 6))
        before = self.pose.copy(), self.rate.copy(), self.joint.copy(), self.speed.copy()
        raised = np.full(n + 1, self.lift)
        if lift is not None:
            raised[1:] = lift
        failed = _track(
            # A copy of one kind: for a view that cannot be written numba would compile anew, for
            # seconds, amid a phrase.
            np.array(targets, dtype=float, order="C"),
            self._phi,
            self.timestep,
            ROTOR,
            ROTOR * BANDWIDTH**2,
            2 * ROTOR * BANDWIDTH,
            self._mount,
            self._offset,
            self.pose,
            self.rate,
            self.joint,
            self.speed,
            raised,
            control,
            poses,
            rates,
        )
        control -= home_joints()
        if failed >= 0:
            place = self.pose[:3].round(3).tolist()
            self.pose, self.rate, self.joint, self.speed = before
            raise PianobotError(
                f"the arm cannot follow the wrist to {place}: keep the command inside its reach"
            )
        self.lift = float(raised[-1])
        return control, poses, rates


def add_arm(spec: mujoco.MjSpec) -> mujoco.MjsBody:
    """Add the six joints with their servos; returns the body whose frame is the wrist frame. Drawn
    as capsules.

    The joints' reference is the home pose and the servos count from there, so that a model as
    loaded, with all controls at 0, stands where the arm waits.
    """
    home = home_joints()
    body = spec.worldbody
    turn, step = np.eye(3), np.zeros(3)
    for i, name in enumerate(JOINTS):
        pan = Rotation.from_euler("z", home[i])
        body = body.add_body(
            name=name, pos=step, quat=(Rotation.from_matrix(turn) * pan).as_quat(scalar_first=True)
        )
        joint = body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0.0, 0.0, 1.0],
            ref=float(home[i]),
            armature=ROTOR,
        )
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        turn = Rotation.from_euler("x", DH_ALPHA[i]).as_matrix()
        step = np.array([DH_A[i], 0.0, DH_D[i]])
        _add_link(body, i)
        servo_ = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo_.set_to_position(kp=ROTOR * BANDWIDTH**2, kv=2 * ROTOR * BANDWIDTH)
        servo_.biasprm[0] = ROTOR * BANDWIDTH**2 * home[i]
    seat = mount()
    flange = Rotation.from_matrix(turn)
    wrist = flange * Rotation.from_rotvec(seat.rotation).inv()
    return body.add_body(
        name="wrist",
        pos=step + flange.apply(seat.tcp_offset),
        quat=wrist.as_quat(scalar_first=True),
    )


# What is drawn of each link, in its frame: radius and ends. The real upper arm and forearm stand
# beside the frames' plane.
_SHAPES: tuple[
    tuple[tuple[float, tuple[float, float, float], tuple[float, float, float]], ...], ...
] = (
    ((0.060, (0.0, 0.0, -0.085), (0.0, 0.0, 0.045)),),
    (
        (0.059, (0.0, 0.0, -0.050), (0.0, 0.0, 0.190)),
        (0.046, (0.0, 0.0, 0.136), (-0.425, 0.0, 0.136)),
    ),
    (
        (0.048, (0.0, 0.0, -0.030), (0.0, 0.0, 0.185)),
        (0.038, (0.0, 0.0, 0.016), (-0.39225, 0.0, 0.016)),
    ),
    ((0.037, (0.0, 0.0, -0.030), (0.0, 0.0, 0.140)),),
    ((0.037, (0.0, 0.0, -0.040), (0.0, 0.0, 0.125)),),
    ((0.035, (0.0, 0.0, 0.030), (0.0, 0.0, 0.0823)),),
)


def _add_link(body: mujoco.MjsBody, i: int) -> None:
    for number, (radius, start, end) in enumerate(_SHAPES[i]):
        body.add_geom(
            name=f"link_{i + 1}{'ab'[number]}",
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            fromto=[*start, *end],
            size=[radius, 0.0, 0.0],
            mass=MASSES[i] if number == 0 else 0.0,
            contype=0,
            conaffinity=0,
            group=1,
            rgba=(0.72, 0.75, 0.78, 1.0),
        )
