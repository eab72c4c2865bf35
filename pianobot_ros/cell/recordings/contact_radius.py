"""Where along its key a finger lands: r of Eq. 2 of "Data-driven Simulation Framework".

An instrument tells how fast a key *turns*: its velocity curve is given at the key's usual contact
point (:func:`~pianobot_ros.cell.motion.geometry.pivot_radius`). Eq. 2 wants the speed where the
finger is. A hand that plays two keys at once cannot land at the usual point of both.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache

from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.motion.geometry import fingertip, keyboard, pivot_radius
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.keystroke import Keystroke

__all__ = ["at_contact", "contact_radius", "planned_radius", "played_together"]

TOGETHER = 0.05  # s: strikes whose windows start within this are one chord


def contact_radius(finger: str, position: ArrayLike, rotation: ArrayLike) -> float:
    """Distance (m) from the keys' hinge of the resting tip of ``finger``, with the wrist at
    ``position`` (3,) m and ``rotation`` (3,) rotation vector, both in the base frame.
    """
    board = keyboard()
    reach = Rotation.from_rotvec(rotation).apply(fingertip(finger))
    return float(board.origin[1] + board.white.pivot - reach[1] - position[1])  # type: ignore[index]


def planned_radius(note: int, targets: Mapping[str, int]) -> float:
    """r of Eq. 2 (m) on ``note`` when the fingers of ``targets`` (finger: note) play together; the
    key's usual contact point where the hand cannot play them or ``note`` is not among them.
    """
    return _planned(note, tuple(sorted(targets.items())))


@lru_cache(maxsize=256)
def _planned(note: int, targets: tuple[tuple[str, int], ...]) -> float:
    finger = next((f for f, n in targets if n == note), None)
    if finger is None:
        return pivot_radius(note)
    try:
        pose = wrist_pose(dict(targets))
    except ScoreError:
        return pivot_radius(note)
    return contact_radius(finger, pose.position, pose.rotation.as_rotvec())


def played_together(
    strikes: Iterable[tuple[float, str, int]], start: float, note: int
) -> dict[str, int]:
    """Finger: note of the chord to which the strike of ``note`` that starts at ``start`` s belongs,
    among ``strikes`` (start, finger, note).
    """
    chord = {f: n for begun, f, n in strikes if abs(begun - start) < TOGETHER}
    return chord if note in chord.values() else {}


def at_contact(stroke: Keystroke, radius: float) -> Keystroke:
    """The keystroke of an instrument with its speeds carried from the key's usual contact point to
    ``radius`` m.
    """
    factor = radius / pivot_radius(stroke.note)
    return replace(stroke, v_pre=factor * stroke.v_pre, v_rel=factor * stroke.v_rel, radius=radius)
