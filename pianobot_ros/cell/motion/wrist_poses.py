"""Which pose of the wrist brings fingers to their keys."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.motion.geometry import (
    Hand,
    Keyboard,
    fingertip,
    hand,
    is_black,
    keyboard,
    strike_point,
)
from pianobot_ros.cell.numbers.config import Section

# SciPy is imported where it is used: it takes half of the time in which a node starts that needs
# none of it.
if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = ["WristPose", "wrist_pose"]

THUMB_ROLL = -0.27  # rad about y: lifts the other fingers by 18 mm, more than a key's dip
MISS = 1e-3  # m by which a fingertip may land beside the place that it was meant for
MAX_TURN = 0.61  # rad: beyond 35 degrees the fingertip's flank would meet the key


class WristPose(Section):
    """A pose of the wrist frame in the base frame: position (m) and roll, pitch, yaw (rad, fixed
    axes x, y, z).
    """

    x: float
    y: float
    z: float
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    @property
    def position(self) -> Array:
        """Position, shape (3,), m."""
        return np.array([self.x, self.y, self.z])

    @property
    def rotation(self) -> Rotation:
        """Orientation of the wrist frame in the base frame."""
        from scipy.spatial.transform import Rotation

        return Rotation.from_euler("xyz", [self.roll, self.pitch, self.yaw])

    def raised(self, height: float) -> WristPose:
        """The same pose ``height`` metres higher."""
        return self.model_copy(update={"z": self.z + height})


def wrist_pose(
    targets: Mapping[str, int], model: Hand | None = None, board: Keyboard | None = None
) -> WristPose:
    """The wrist pose in which each finger of ``targets`` just touches its key at rest.

    One finger (thumb or middle): its plane stands along the key, and the thumb is reached by
    rolling so that the others
    stay clear. Two fingers: yaw and roll are solved for, and each may land anywhere on its key's
    open surface. Raises :class:`ScoreError` where the posture is out of reach or would press other
    keys.
    """
    model, board = model or hand(), board or keyboard()
    tips = {name: fingertip(name, model) for name in targets}
    points = {name: strike_point(note, board) for name, note in targets.items()}
    if len(targets) == 1:
        (name,) = targets
        if name == "index":
            raise ScoreError(
                "the index finger rests above its neighbours and cannot strike alone: use thumb or"
                " middle"
            )
        pose = WristPose(x=0.0, y=0.0, z=0.0, pitch=THUMB_ROLL if name == "thumb" else 0.0)
        x, y, z = points[name] - pose.rotation.apply(tips[name])
        return pose.model_copy(update={"x": float(x), "y": float(y), "z": float(z)})
    ends = tuple(
        _End(tuple(tips[name].tolist()), tuple(points[name].tolist()), _landing_range(note, board))
        for name, note in targets.items()
    )
    if _apart(*ends):
        u = _two_tips(ends)
        pose = WristPose(x=u[0], y=u[1], z=u[2], pitch=u[3], yaw=u[4])
        if all(_reaches(pose, end) for end in ends):
            return pose
    stretch = " and ".join(f"{n} on note {targets[n]}" for n in targets)
    raise ScoreError(
        f"the hand cannot stretch to {stretch}: choose another interval or play the notes singly"
    )


class _End(NamedTuple):
    """What one of two fingers asks of the wrist: its ``tip`` in the wrist frame is to touch
    ``point``, and may do so from ``landing[0]`` to ``landing[1]`` in y. All in m.
    """

    tip: tuple[float, ...]
    point: tuple[float, ...]
    landing: tuple[float, float]


def _apart(a: _End, b: _End) -> bool:
    """Whether two tips are as far from each other as two places where they may land: a rigid hand
    cannot reach them otherwise, however it turns.
    """
    across = np.array(b.point)[[0, 2]] - np.array(a.point)[[0, 2]]
    low, high = b.landing[0] - a.landing[1], b.landing[1] - a.landing[0]
    nearest, farthest = max(low, -high, 0.0), max(-low, high)
    apart = math.dist(a.tip, b.tip)
    slack = 4 * MISS  # each of the two may miss in each direction
    least, most = math.hypot(*across, nearest) - slack, math.hypot(*across, farthest) + slack
    return least <= apart <= most


@lru_cache(maxsize=1024)
def _two_tips(ends: tuple[_End, ...]) -> tuple[float, ...]:
    """x, y, z (m), pitch and yaw (rad) of the wrist that come nearest to what two fingers ask for.

    Remembered, since it takes tens of milliseconds and a score asks for the same thousands of
    times.
    """
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    tips, points = [np.array(end.tip) for end in ends], [np.array(end.point) for end in ends]

    def misses(u: Array) -> Array:
        turn = Rotation.from_euler("xyz", [0.0, u[3], u[4]])
        rows = [0.002 * u[3:]]
        for tip, point, end in zip(tips, points, ends, strict=True):
            place = turn.apply(tip) + u[:3]
            outside = max(end.landing[0] - place[1], 0.0) + max(place[1] - end.landing[1], 0.0)
            rows.append(np.array([*(place - point) * [1.0, 0.02, 1.0], outside]))
        return np.concatenate(rows)

    middle = np.mean([point - tip for tip, point in zip(tips, points, strict=True)], axis=0)
    tries = [
        least_squares(
            misses, np.concatenate([middle, [0.0, yaw]]), x_scale=[0.01, 0.01, 0.01, 0.1, 0.1]
        )
        for yaw in (0.0, -0.4, 0.4)
    ]
    return tuple(map(float, min(tries, key=lambda found: found.cost).x))


def _reaches(pose: WristPose, end: _End) -> bool:
    """Whether a fingertip of the hand lands within a millimetre of where it may on its key."""
    place = pose.rotation.apply(end.tip) + pose.position
    miss = place - end.point
    return bool(
        end.landing[0] - MISS <= place[1] <= end.landing[1] + MISS
        and max(abs(miss[0]), abs(miss[2])) <= MISS
        and max(abs(pose.pitch), abs(pose.yaw)) <= MAX_TURN
    )


def _landing_range(note: int, board: Keyboard) -> tuple[float, float]:
    """From where to where (y in the base frame, m) a fingertip may land on ``note`` without
    touching a neighbour.
    """
    start = board.black.front + 0.005 if is_black(note) else 0.005
    end = board.white.length - 0.010 if is_black(note) else board.black.front - 0.002
    return board.origin[1] + start, board.origin[1] + end
