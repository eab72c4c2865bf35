"""r of Eq. 2: where along its key a finger lands."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.cell.motion.geometry import pivot_radius
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.recordings.contact_radius import (
    at_contact,
    contact_radius,
    planned_radius,
    played_together,
)
from pianobot_ros.cell.recordings.keystroke import Keystroke, keystroke_error
from pianobot_ros.cell.score import parse_phrase, plan_score
from pianobot_ros.emulator.plant.offline import simulate_cell
from pianobot_ros.piano.identify.takes.take import takes_from_recording

STRETCH = {"thumb": 64, "middle": 68}


@pytest.mark.parametrize(("finger", "note"), [("middle", 64), ("thumb", 62), ("middle", 66)])
def test_a_single_note_is_played_at_the_usual_point(finger: str, note: int) -> None:
    pose = wrist_pose({finger: note})
    found = contact_radius(finger, pose.position, pose.rotation.as_rotvec())
    assert found == pytest.approx(pivot_radius(note), abs=1e-9)
    assert planned_radius(note, {finger: note}) == pytest.approx(found)


def test_a_stretch_lands_nearer_the_front_and_nearer_the_hinge() -> None:
    assert planned_radius(64, STRETCH) == pytest.approx(0.215, abs=1e-3)
    assert planned_radius(68, STRETCH) == pytest.approx(0.127, abs=1e-3)
    assert planned_radius(65, STRETCH) == pivot_radius(65), "not announced"
    assert planned_radius(60, {"thumb": 60, "middle": 71}) == pivot_radius(60), "out of reach"


def test_chords_are_strikes_that_start_together() -> None:
    strikes = [(1.0, "thumb", 64), (1.01, "middle", 68), (2.5, "middle", 68)]
    assert played_together(strikes, 1.0, 64) == STRETCH
    assert played_together(strikes, 2.5, 68) == {"middle": 68}
    assert played_together(strikes, 2.5, 64) == {}


def test_speeds_move_with_the_radius_and_err_does_not() -> None:
    reported, other = (
        Keystroke(68, 0.0, 0.3, 0.2, 0.4, 2.0),
        Keystroke(68, 0.0, 0.33, 0.2, 0.4, 2.0),
    )
    here, there = at_contact(reported, 0.12), at_contact(other, 0.12)
    assert here.v_pre == pytest.approx(0.8 * reported.v_pre) and here.radius == 0.12
    assert keystroke_error(there, here) == pytest.approx(keystroke_error(other, reported))


def test_a_recording_tells_the_radius_by_the_measured_wrist() -> None:
    phrase = "strikes: [{notes: {thumb: 64, middle: 68}, speed: 0.15, depth: 0.014, hold: 0.4}]"
    takes = takes_from_recording(simulate_cell(plan_score(parse_phrase(phrase)), seed=0))
    radius = {t.strike.note: t.radius for t in takes}
    for note, wanted in ((64, 0.215), (68, 0.127)):
        assert radius[note] == pytest.approx(wanted, abs=1e-3)
    take = next(t for t in takes if t.strike.note == 64)
    stroke = take.stroke()
    touching = stroke.force > 0.5
    assert np.median(stroke.lever[touching]) == pytest.approx(take.radius, abs=1e-3)
    assert take.reference is not None
    faster = take.at_contact(take.reference).v_pre / take.reference.v_pre
    assert faster == pytest.approx(0.215 / 0.195, abs=0.005)
