"""The emulated arm's mathematics, compiled: what the controller computes in each of its cycles.

``arm`` (6, 11) describes the links and joints by the columns below, ``frames`` (7, 4, 4) are base,
link 1 … link 6 (the flange) in the base frame, ``jacobian`` (6, 6) is of the wrist. All arrays are
contiguous float64.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array

__all__ = [
    "ARM_COLUMNS",
    "arm_frames",
    "bear",
    "carry",
    "flange_of_tool",
    "flange_of_wrist",
    "gravity",
    "place_of_pose",
    "point_jacobian",
    "pose_of_place",
    "rotation_of",
    "rotation_vector_of",
    "told",
    "track",
    "wrist_of_flange",
]

A, D, COSINE, SINE, WEIGHT, CENTRE, FRICTION, INERTIA, CONSTANT = 0, 1, 2, 3, 4, 5, 8, 9, 10
ARM_COLUMNS = 11
"""Denavit-Hartenberg ``a`` and ``d`` m, cosine and sine of ``alpha``, weight N, centre of mass (3)
m, friction N m s/rad, inertia kg m^2, torque N m of one ampere.
"""
Q, QD, QDD, TORQUE, CURRENT = 0, 1, 2, 3, 4
"""Rows of the joints' state (5, 6): angle rad and its derivatives, torque N m, current A."""

compiled = njit(cache=True, error_model="numpy")


@compiled  # type: ignore[untyped-decorator]
def rotation_of(vector: Array, out: Array) -> None:
    """Rotation matrix ``out`` (3, 3) of a rotation vector (3,)."""
    x, y, z = vector[0], vector[1], vector[2]
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        c, s, k = 1.0, 1.0, 0.0
    else:
        x, y, z = x / angle, y / angle, z / angle
        c, s = math.cos(angle), math.sin(angle)
        k = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k


@compiled  # type: ignore[untyped-decorator]
def rotation_vector_of(r: Array, out: Array) -> None:
    """Rotation vector ``out`` (3,) of the rotation matrix in the first rows and columns of ``r``;
    its angle is in [0, pi].
    """
    # 2 sin(angle) times the unit axis
    out[0], out[1], out[2] = r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    double_sine = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    double_cosine = r[0, 0] + r[1, 1] + r[2, 2] - 1.0
    angle = math.atan2(double_sine, double_cosine)
    if double_sine > 1e-6:
        factor = angle / double_sine
    elif double_cosine > 0.0:
        factor = 0.5
    else:
        # Half a turn: the antisymmetric part vanishes, the axis is the dominant column of
        # (R + 1) / 2.
        column = 0
        for i in range(1, 3):
            if r[i, i] > r[column, column]:
                column = i
        for i in range(3):
            out[i] = 0.5 * (r[i, column] + (1.0 if i == column else 0.0))
        factor = angle / math.sqrt(out[column])
    for i in range(3):
        out[i] *= factor


@compiled  # type: ignore[untyped-decorator]
def place_of_pose(pose: Array, out: Array) -> None:
    """Homogeneous matrix ``out`` (4, 4) of a pose (6,): position and rotation vector."""
    rotation_of(pose[3:], out)
    for i in range(3):
        out[i, 3], out[3, i] = pose[i], 0.0
    out[3, 3] = 1.0


@compiled  # type: ignore[untyped-decorator]
def pose_of_place(place: Array, out: Array) -> None:
    """Pose ``out`` (6,) of a homogeneous matrix (4, 4)."""
    for i in range(3):
        out[i] = place[i, 3]
    rotation_vector_of(place, out[3:])


@compiled  # type: ignore[untyped-decorator]
def _product(first: Array, second: Array, out: Array) -> None:
    """``out`` = ``first`` @ ``second``, homogeneous matrices (4, 4)."""
    for i in range(3):
        for j in range(4):
            x = first[i, 0] * second[0, j] + first[i, 1] * second[1, j] + first[i, 2] * second[2, j]
            out[i, j] = x + first[i, 3] if j == 3 else x
        out[3, i] = 0.0
    out[3, 3] = 1.0


@compiled  # type: ignore[untyped-decorator]
def flange_of_wrist(wrist: Array, mount: Array, out: Array) -> None:
    """Flange ``out`` (4, 4) of a wrist pose (6,); ``mount`` (4, 4) holds the flange's axes in the
    wrist frame, and in its last column the wrist frame's origin in the flange frame.
    """
    turn = np.empty((3, 3))
    rotation_of(wrist[3:], turn)
    for i in range(3):
        out[i, 3], out[3, i] = wrist[i], 0.0
        for j in range(3):
            x = 0.0
            for k in range(3):
                x += turn[i, k] * mount[k, j]
            out[i, j] = x
            out[i, 3] -= x * mount[j, 3]
    out[3, 3] = 1.0


@compiled  # type: ignore[untyped-decorator]
def wrist_of_flange(flange: Array, mount: Array, out: Array) -> None:
    """Wrist pose ``out`` (6,) of a flange (4, 4): :func:`flange_of_wrist` the other way."""
    turn = np.empty((3, 3))
    for i in range(3):
        out[i] = flange[i, 3]
        for j in range(3):
            out[i] += flange[i, j] * mount[j, 3]
            turn[i, j] = 0.0
            for k in range(3):
                turn[i, j] += flange[i, k] * mount[j, k]
    rotation_vector_of(turn, out[3:])


@compiled  # type: ignore[untyped-decorator]
def flange_of_tool(tool: Array, tcp_inverse: Array, out: Array) -> None:
    """Flange ``out`` (4, 4) of a tool pose (6,)."""
    place = np.empty((4, 4))
    place_of_pose(tool, place)
    _product(place, tcp_inverse, out)


@compiled  # type: ignore[untyped-decorator]
def arm_frames(q: Array, arm: Array, frames: Array) -> None:
    """Fill ``frames`` for joint angles (6,)."""
    frames[:] = 0.0
    for i in range(4):
        frames[0, i, i] = 1.0
    for j in range(6):
        c, s = math.cos(q[j]), math.sin(q[j])
        before, after = frames[j], frames[j + 1]
        for i in range(3):
            x, y, z = before[i, 0], before[i, 1], before[i, 2]
            after[i, 0] = c * x + s * y
            after[i, 1] = arm[j, COSINE] * (c * y - s * x) + arm[j, SINE] * z
            after[i, 2] = arm[j, SINE] * (s * x - c * y) + arm[j, COSINE] * z
            after[i, 3] = arm[j, A] * after[i, 0] + arm[j, D] * z + before[i, 3]
        after[3, 3] = 1.0


@compiled  # type: ignore[untyped-decorator]
def point_jacobian(frames: Array, point: Array, out: Array) -> None:
    """Geometric Jacobian ``out`` (6, 6) of a point (3,) of the flange, in the base frame."""
    for j in range(6):
        a, b, c = frames[j, 0, 2], frames[j, 1, 2], frames[j, 2, 2]
        x = point[0] - frames[j, 0, 3]
        y = point[1] - frames[j, 1, 3]
        z = point[2] - frames[j, 2, 3]
        out[0, j], out[1, j], out[2, j] = b * z - c * y, c * x - a * z, a * y - b * x
        out[3, j], out[4, j], out[5, j] = a, b, c


@compiled  # type: ignore[untyped-decorator]
def _solve(matrix: Array, right: Array) -> None:
    """Turn ``right`` (n,) into the solution of ``matrix`` (n, n), which is used up: Gauss with
    pivots from the column.
    """
    n = right.shape[0]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if best != k:
            right[k], right[best] = right[best], right[k]
            for j in range(k, n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        for i in range(k + 1, n):
            share = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= share * matrix[k, j]
            right[i] -= share * right[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]


@compiled  # type: ignore[untyped-decorator]
def joint_turn(jacobian: Array, twist: Array, out: Array) -> None:
    """Joint changes ``out`` (6,) that move the wrist by ``twist`` (6,)."""
    matrix = jacobian.copy()
    for i in range(6):
        matrix[i, i] += 1e-9
        out[i] = twist[i]
    _solve(matrix, out)


@compiled  # type: ignore[untyped-decorator]
def track(flange: Array, q: Array, arm: Array, frames: Array, iterations: int) -> None:
    """Move ``q`` (6,) to where the flange is at ``flange`` (4, 4): damped Newton steps. ``frames``
    gets lost.
    """
    turn, error, point = np.empty((3, 3)), np.empty(6), np.empty(3)
    jacobian, square = np.empty((6, 6)), np.empty((6, 6))
    for _ in range(iterations):
        arm_frames(q, arm, frames)
        for i in range(3):
            point[i] = frames[6, i, 3]
            error[i] = flange[i, 3] - point[i]
            for j in range(3):
                turn[i, j] = 0.0
                for k in range(3):
                    turn[i, j] += flange[i, k] * frames[6, j, k]
        rotation_vector_of(turn, error[3:])
        if np.sum(error * error) < 1e-14:
            break
        point_jacobian(frames, point, jacobian)
        for i in range(6):
            for j in range(6):
                square[i, j] = 1e-8 if i == j else 0.0
                for k in range(6):
                    square[i, j] += jacobian[i, k] * jacobian[j, k]
        _solve(square, error)
        for i in range(6):
            for k in range(6):
                q[i] += jacobian[k, i] * error[k]


@compiled  # type: ignore[untyped-decorator]
def gravity(frames: Array, arm: Array, load: Array, out: Array) -> None:
    """Joint torques ``out`` (6,), N m, that hold the links and ``load`` (4,) against gravity: its
    weight, N, and its centre in the flange frame, m.
    """
    weight, x, y = 0.0, 0.0, 0.0  # of everything outboard of a joint: weight, its first moments
    for j in range(5, -1, -1):
        link = frames[j + 1]
        own, centre = arm[j, WEIGHT], arm[j, CENTRE : CENTRE + 3]
        weight += own
        x += own * (
            link[0, 0] * centre[0] + link[0, 1] * centre[1] + link[0, 2] * centre[2] + link[0, 3]
        )
        y += own * (
            link[1, 0] * centre[0] + link[1, 1] * centre[1] + link[1, 2] * centre[2] + link[1, 3]
        )
        if j == 5:
            weight += load[0]
            x += load[0] * (
                link[0, 0] * load[1] + link[0, 1] * load[2] + link[0, 2] * load[3] + link[0, 3]
            )
            y += load[0] * (
                link[1, 0] * load[1] + link[1, 1] * load[2] + link[1, 2] * load[3] + link[1, 3]
            )
        hinge = frames[j]
        out[j] = hinge[0, 2] * (y - weight * hinge[1, 3]) - hinge[1, 2] * (x - weight * hinge[0, 3])


@compiled  # type: ignore[untyped-decorator]
def bear(
    joints: Array,
    arm: Array,
    frames: Array,
    jacobian: Array,
    load: Array,
    point: Array,
    force: Array,
) -> None:
    """Renew ``jacobian`` and the torques and currents of ``joints``: ``force`` (3,), N, acts on the
    wrist at ``point`` (3,).
    """
    point_jacobian(frames, point, jacobian)
    gravity(frames, arm, load, joints[TORQUE])
    for j in range(6):
        for i in range(3):
            joints[TORQUE, j] -= jacobian[i, j] * force[i]
        joints[CURRENT, j] = (
            joints[TORQUE, j] + arm[j, FRICTION] * joints[QD, j] + arm[j, INERTIA] * joints[QDD, j]
        ) / arm[j, CONSTANT]


@compiled  # type: ignore[untyped-decorator]
def follow(
    joints: Array,
    arm: Array,
    frames: Array,
    jacobian: Array,
    flange: Array,
    twist: Array,
    dt: float,
) -> None:
    """Move ``joints`` and ``frames`` on by ``dt`` s to where the flange is; ``twist`` (6,) of the
    wrist.
    """
    q, qd = np.empty(6), np.empty(6)
    for j in range(6):
        q[j] = joints[Q, j] + joints[QD, j] * dt
    track(flange, q, arm, frames, 3)
    # From the twist, as differences of the angles would be mostly encoder noise.
    joint_turn(jacobian, twist, qd)
    for j in range(6):
        # the difference alone is too rough to drive a current
        joints[QDD, j] += 0.2 * ((qd[j] - joints[QD, j]) / dt - joints[QDD, j])
        joints[Q, j], joints[QD, j] = q[j], qd[j]
    arm_frames(q, arm, frames)


@compiled  # type: ignore[untyped-decorator]
def carry(
    joints: Array,
    arm: Array,
    frames: Array,
    jacobian: Array,
    load: Array,
    mount: Array,
    wrist: Array,
    dt: float,
) -> Array:
    """:func:`follow` the wrist and :func:`bear` its force, in one call: to enter compiled code
    costs more than some of these. ``wrist`` (4, 6) is its pose as measured, its twist, its true
    pose, and first in the last row the force, (3,), N. Returns the flange, (4, 4).
    """
    flange = np.empty((4, 4))
    flange_of_wrist(wrist[0], mount, flange)
    follow(joints, arm, frames, jacobian, flange, wrist[1], dt)
    bear(joints, arm, frames, jacobian, load, wrist[2, :3], wrist[3, :3])
    return flange


@compiled  # type: ignore[untyped-decorator]
def told(
    flange: Array,
    tcp: Array,
    mount: Array,
    jacobian: Array,
    wrist: Array,
    out: Array,
) -> None:
    """What the controller tells of the tool, ``out`` (4, 6): its pose, its twist, the pose that it
    is following, and how far the joints are behind, rad, to first order. ``wrist`` (3, 6) is the
    wrist's pose, twist and target.
    """
    tool, aim = np.empty((4, 4)), np.empty((4, 4))
    _product(flange, tcp, tool)
    pose_of_place(tool, out[0])
    x, y, z = tool[0, 3] - wrist[0, 0], tool[1, 3] - wrist[0, 1], tool[2, 3] - wrist[0, 2]
    a, b, c = wrist[1, 3], wrist[1, 4], wrist[1, 5]
    for i in range(6):
        out[1, i] = wrist[1, i]
    out[1, 0] += b * z - c * y
    out[1, 1] += c * x - a * z
    out[1, 2] += a * y - b * x
    flange_of_wrist(wrist[2], mount, aim)
    _product(aim, tcp, tool)
    pose_of_place(tool, out[2])
    joint_turn(jacobian, wrist[2] - wrist[0], out[3])
