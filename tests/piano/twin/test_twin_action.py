"""The keyboard with the piano action on every key: a fingertip plays hammers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.motion.geometry import pivot_radius
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.piano.action import load_parameters
from pianobot_ros.piano.action.hybrid.action_model import PARTS
from pianobot_ros.piano.twin.experiments.repetition import NOTE, grand, half_way, strike_action
from pianobot_ros.piano.twin.model.cell_model import TIMESTEP, TwinOptions
from pianobot_ros.piano.twin.stepping import rollout
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin

NOTE_RADIUS = pivot_radius(NOTE)
SINGLE = PARTS - {"repetition_lever"}


def struck(
    speed: float, note: int = NOTE, parts: frozenset[str] = PARTS, timestep: float = TIMESTEP
) -> rollout.Run:
    return strike_action(speed, replace(grand(parts, note), timestep=timestep))


def at(run: rollout.Run, rule: str) -> list[float]:
    return [e.time for e in run.action if e.rule == rule]


@pytest.mark.parametrize("parts", [frozenset(), PARTS], ids=["paper", "parts"])
@pytest.mark.parametrize("note", [64, 66])
def test_a_strike_gives_a_note_like_that_of_the_spring(parts: frozenset[str], note: int) -> None:
    (ours,) = struck(0.2, note, parts).strokes
    commands = rollout.strike_commands(
        {"middle": note}, StrikeMotion(0.2, 0.014, 0.15), pressure=-50e3
    )
    (spring,) = rollout.play(commands, rollout.reduced("middle", note)).strokes
    assert ours.v_pre == pytest.approx(spring.v_pre, rel=0.4)
    # The hammer's mass returns the key more slowly than the spring.
    assert spring.t_hold < ours.t_hold < spring.t_hold + 0.15
    assert 0.3 * spring.peak_force < ours.peak_force < spring.peak_force


@pytest.mark.parametrize("speed", [0.1, 0.2])
def test_one_press_strikes_the_string_once_and_is_checked(speed: float) -> None:
    run = struck(speed)
    assert (
        len(at(run, "jack out"))
        == len(at(run, "string made"))
        == len(at(run, "hammer checked"))
        == 1
    )
    assert at(run, "jack out")[0] < at(run, "string made")[0] < at(run, "hammer checked")[0]
    assert len(at(run, "jack back")) == 1, "and is ready again"
    assert [e.note for e in run.events] == [64, 64]


def test_faster_fingers_make_faster_hammers_and_shorter_lags() -> None:
    lags, speeds = [], []
    for speed in (0.1, 0.12, 0.2):
        run = struck(speed)
        lags.append(at(run, "string made")[0] - at(run, "jack out")[0])
        speeds.append(next(e.hammer_velocity for e in run.action if e.rule == "string made"))
    expected = load_parameters().expected
    assert lags[0] > lags[1] > lags[2]
    assert speeds[0] < speeds[1] < speeds[2]
    assert expected.key_to_hammer_fast < lags[0] < expected.key_to_hammer_slow
    assert lags[2] < expected.key_to_hammer_fast


def test_a_note_repeats_from_half_way_only_with_the_lever() -> None:
    commands = half_way()
    with_lever, without = rollout.play(commands, grand()), rollout.play(commands, grand(SINGLE))
    assert len(at(with_lever, "string made")) == 2
    assert len(at(without, "string made")) == 1
    second = at(with_lever, "string made")[1]
    angle = with_lever.key(64)[0]
    between = (with_lever.time > 0.5) & (with_lever.time < second)
    assert angle[between].min() > 0.3 * angle.max(), "the key came back only part of its way"


@pytest.mark.long
def test_a_finer_step_gives_the_same_strike() -> None:
    coarse, fine = struck(0.15), struck(0.15, timestep=TIMESTEP / 8)
    for rule in ("jack out", "string made"):
        assert at(coarse, rule) == pytest.approx(at(fine, rule), abs=1e-3)
    ours, theirs = (
        next(e.hammer_velocity for e in r.action if e.rule == "string made") for r in (coarse, fine)
    )
    assert ours == pytest.approx(theirs, rel=0.03)
    assert coarse.force.max() == pytest.approx(fine.force.max(), rel=0.03)


def test_whole_keyboard_stays_at_rest_and_starts_over() -> None:
    twin = CellTwin(TwinOptions(mechanism="action", parts=PARTS))
    assert np.abs(twin.step(300).angle).max() < 1e-6
    assert twin.switches is not None
    assert [e.rule for e in twin.switches.events] == []
    assert all("jack" in mode for mode in twin.switches.modes())
    commands = rollout.strike_commands(
        {"middle": 64}, StrikeMotion(0.2, 0.014, 0.1), pressure=-50e3
    )
    twin.reset(commands.pose[0])
    targets = commands.at_steps(twin.cell.timestep)
    twin.step(len(targets), targets)
    assert {e.name for e in twin.switches.events} == {"key_64"}
    twin.reset()
    assert twin.switches.events == []


def test_batches_switch_as_single_runs_do() -> None:
    commands = rollout.strike_commands(
        {"middle": 64}, StrikeMotion(0.2, 0.014, 0.1), pressure=-50e3
    )
    (batch,) = rollout.play_batch([rollout.BatchJob(commands)], grand())
    alone = rollout.play(commands, grand())
    assert batch.action == alone.action
    np.testing.assert_array_equal(batch.force, alone.force)


def test_bad_parts_say_what_to_do() -> None:
    with pytest.raises(ConfigError, match="only the mechanism 'action'"):
        TwinOptions(parts=PARTS)
    with pytest.raises(ConfigError, match="did you mean 'let_off'"):
        CellTwin(grand(frozenset({"let_of"})))
    with pytest.raises(ConfigError, match="add the part let_off"):
        CellTwin(grand(frozenset({"backcheck"})))


def on_felt(speed: float, timestep: float = TIMESTEP) -> rollout.Run:
    options = TwinOptions(fingers=("middle",), notes=(NOTE,), mechanism="felt", timestep=timestep)
    motion = StrikeMotion(speed, 0.016, 0.15)
    return rollout.play(rollout.strike_commands({"middle": NOTE}, motion, pressure=-80e3), options)


def test_a_hand_plays_hammers_on_felt() -> None:
    runs = [on_felt(speed) for speed in (0.1, 0.2, 0.35)]
    speeds = [run.action[0].hammer_velocity for run in runs]
    assert speeds[0] < speeds[1] < speeds[2]
    bottom = 0.01 / NOTE_RADIUS
    for run in runs:
        assert [e.note for e in run.events] == [NOTE, NOTE]
        reached = float(run.time[np.argmax(run.key(NOTE)[0] > bottom)])
        assert abs(reached - at(run, "string made")[0]) < 0.012


def test_hammers_on_felt_converge() -> None:
    (coarse,), (fine,) = on_felt(0.2).strokes, on_felt(0.2, TIMESTEP / 8).strokes
    for name in ("peak_force", "v_pre", "v_rel", "t_hold"):
        assert getattr(coarse, name) == pytest.approx(getattr(fine, name), rel=0.005)


def test_a_whole_keyboard_on_felt_sleeps_until_it_is_played() -> None:
    twin = CellTwin(TwinOptions(mechanism="felt"))
    assert np.abs(twin.step(300).angle).max() == 0.0
    assert twin.data.ntree_awake == 1
