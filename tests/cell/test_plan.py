"""Plans keep the arm's limits and are continuous, whatever the phrase."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from examples import fewer
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.motion import wrist_poses
from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import WristPose
from pianobot_ros.cell.recordings.commands import CYCLE
from pianobot_ros.cell.score import (
    Plan,
    Score,
    ScoreStrike,
    load_score,
    motion_refusal,
    parse_phrase,
    phrase_names,
    plan_retreat,
    plan_score,
)

LIMITS = wrist_limits()


def check(plan: Plan) -> None:
    speed = np.diff(plan.position, axis=0) / CYCLE
    assert np.linalg.norm(speed, axis=1).max() <= LIMITS.speed
    assert np.linalg.norm(np.diff(speed, axis=0) / CYCLE, axis=1).max() <= LIMITS.acceleration
    assert np.linalg.norm(plan.velocity[:, 3:], axis=1).max() <= LIMITS.angular_speed
    assert (plan.position >= LIMITS.low).all() and (plan.position <= LIMITS.high).all()
    assert np.allclose(plan.velocity[[0, -1]], 0, atol=1e-3), "at rest at both ends"
    # The feed-forward velocity is the slope of the position.
    middle = (plan.position[2:] - plan.position[:-2]) / (2 * CYCLE)
    assert np.abs(middle - plan.velocity[1:-1, :3]).max() < LIMITS.acceleration * CYCLE
    assert all(a.start < a.end <= plan.duration for a in plan.strikes)
    starts = sorted({s.start for s in plan.strikes})
    for s in plan.strikes:
        assert not any(s.start < other < s.end for other in starts), "windows do not overlap"


@pytest.mark.parametrize("name", phrase_names())
def test_every_phrase_that_ships_keeps_the_limits(name: str) -> None:
    check(plan_score(load_score(name), WristPose(x=0.0, y=0.27, z=0.24)))


motions = st.builds(
    StrikeMotion,
    speed=st.floats(0.05, 0.4),
    depth=st.floats(0.008, 0.02),
    hold=st.floats(0, 0.5),
    clearance=st.just(0.005),
).filter(lambda m: not motion_refusal(m, LIMITS))
strikes = st.builds(
    lambda finger, note, motion, pressure: ScoreStrike((finger,), (note,), motion, pressure, "c"),
    st.sampled_from(["thumb", "middle"]),
    st.integers(60, 71),
    motions,
    st.sampled_from([0.0, -50e3, -100e3]),
)


@fewer(0.4)
@given(st.lists(strikes, min_size=1, max_size=5))
def test_any_strikes_in_any_order_keep_the_limits(played: list[ScoreStrike]) -> None:
    plan = plan_score(Score("any", tuple(played)))
    check(plan)
    assert [s.note for s in plan.strikes] == [s.notes[0] for s in played]


def test_the_note_length_is_the_time_between_onsets() -> None:
    plan = plan_score(
        parse_phrase("defaults: {note: 64, note_length: 1.1, repeats: 3}\nstrikes: [{}]")
    )
    assert np.diff([s.start for s in plan.strikes]) == pytest.approx([1.1, 1.1], abs=1e-9)


def test_a_note_length_that_is_too_short_is_said() -> None:
    with pytest.raises(ScoreError, match="too early for the hand"):
        plan_score(parse_phrase("defaults: {note_length: 0.2}\nstrikes: [{note: 60}, {note: 71}]"))


def test_lost_strikes_are_planned_again_later_than_their_times_if_need_be() -> None:
    score = parse_phrase(
        "defaults: {note_length: 0.6, depth: 0.014, hold: 0.02}\n"
        "strikes: [{note: 60}, {notes: [62, 66], speed: 0.2}, {note: 71, speed: 0.2}]"
    )
    assert score.places == [0, 1, 1, 2], "a chord is one strike of two keys"
    again = score.again([2, 1, 1])
    assert [s.notes for s in again.strikes] == [(62, 66), (71,)]
    hurried = replace(score, strikes=tuple(replace(s, note_length=0.1) for s in score.strikes))
    with pytest.raises(ScoreError, match="too early"):
        plan_score(hurried)
    late = plan_score(hurried, number=5, in_time=False)
    check(late)
    assert [m.index for m in late.strikes] == [5, 6, 7, 8]


@fewer(0.5)
@given(st.tuples(st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.floats(-0.4, 0.4)))
def test_a_retreat_goes_up_smoothly_from_any_motion(velocity: tuple[float, float, float]) -> None:
    start, v = np.array([0.0, 0.27, 0.17]), np.array(velocity)
    path, speeds = plan_retreat(start, v)
    steps = np.diff(np.vstack([start, path]), axis=0) / CYCLE
    assert np.linalg.norm(steps[0] - v) < LIMITS.acceleration * CYCLE
    assert (
        np.linalg.norm(np.diff(steps, axis=0) / CYCLE, axis=1).max() <= 1.01 * LIMITS.acceleration
    )
    assert (
        path[-1] == pytest.approx(start + np.array([0, 0, 0.03]), abs=1e-9) and not speeds[-1].any()
    )


def test_the_posture_of_a_chord_is_found_once_however_often_it_is_played() -> None:
    text = "strikes: [{notes: [60, 63], repeats: 50}, {note: 62}, {notes: [60, 63], hold: 0.1}]"
    wrist_poses._two_tips.cache_clear()
    plan = plan_score(parse_phrase(text))
    assert len(plan.strikes) == 2 * 51 + 1
    assert wrist_poses._two_tips.cache_info().misses == 1


def test_the_wrist_turns_as_its_velocity_says() -> None:
    plan = plan_score(load_score("two_note"))
    turns = Rotation.from_rotvec(plan.rotation)
    steps = (turns[2:] * turns[:-2].inv()).as_rotvec() / (2 * CYCLE)
    assert np.abs(steps).max() > 0.1  # else there is nothing to see
    np.testing.assert_allclose(plan.velocity[1:-1, 3:], steps, atol=0.05 * np.abs(steps).max())
