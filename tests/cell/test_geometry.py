from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.motion.geometry import (
    finger_points,
    fingertip,
    hand,
    is_black,
    key_centre,
    keyboard,
    strike_point,
)
from pianobot_ros.cell.motion.wrist_poses import wrist_pose


def test_angles_of_the_paper() -> None:
    fingers = hand().fingers
    assert np.degrees(fingers["thumb"].yaw - fingers["index"].yaw) == pytest.approx(35, abs=0.01)
    assert np.degrees(fingers["index"].yaw - fingers["middle"].yaw) == pytest.approx(10, abs=0.01)
    assert [len(fingers[f].lengths) for f in ("thumb", "index", "middle")] == [3, 4, 4]
    for finger in fingers.values():
        bends = np.degrees(finger.bends)
        assert bends[:2] == pytest.approx([10, 10], abs=0.01)
        assert bends[2:] == pytest.approx([0.0] * len(bends[2:]))


@pytest.mark.parametrize("name", ["thumb", "index", "middle"])
def test_phalanges_keep_their_lengths(name: str) -> None:
    finger = hand().fingers[name]
    steps = np.linalg.norm(np.diff(finger_points(finger), axis=0), axis=1)
    assert steps == pytest.approx(finger.lengths)


def test_an_octave_is_an_octave() -> None:
    board = keyboard()
    whites = [n for n in board.notes if not is_black(n)]
    assert len(whites) == 7
    assert np.diff([key_centre(n) for n in whites]) == pytest.approx([board.white.pitch] * 6)
    assert key_centre(61) == pytest.approx((key_centre(60) + key_centre(62)) / 2)


@pytest.mark.parametrize("finger", ["thumb", "middle"])
@pytest.mark.parametrize("note", range(60, 72))
def test_the_striking_finger_touches_and_the_others_stay_clear(finger: str, note: int) -> None:
    pose = wrist_pose({finger: note})
    board = keyboard()
    for other in hand().fingers:
        tip = pose.rotation.apply(fingertip(other)) + pose.position
        if other == finger:
            assert tip == pytest.approx(strike_point(note), abs=1e-9)
            continue
        above_keys = tip[1] > board.origin[1]
        assert not above_keys or tip[2] - board.origin[2] > 0.013, "a neighbour would be pressed"


def test_the_paper_s_stretch_of_e_and_g_sharp() -> None:
    pose = wrist_pose({"thumb": 64, "middle": 68})
    for finger, note in (("thumb", 64), ("middle", 68)):
        tip = pose.rotation.apply(fingertip(finger)) + pose.position
        assert tip[[0, 2]] == pytest.approx(strike_point(note)[[0, 2]], abs=1e-3)


@pytest.mark.parametrize(
    "targets", [{"index": 64}, {"thumb": 60, "middle": 71}, {"pinky": 60}, {"middle": 40}]
)
def test_out_of_reach_says_so(targets: dict[str, int]) -> None:
    with pytest.raises(ScoreError):
        wrist_pose(targets)
