"""Stiffness from keystrokes: the search, its interval, vacuum levels, several parameters, and what
is refused.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mido
import numpy as np
import pytest
import yaml

from pianobot_ros.cell.errors import ConfigError, PianobotError, RecordingError, ScoreError
from pianobot_ros.cell.recordings.keystroke import keystroke_error
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.score import parse_phrase, plan_score
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
from pianobot_ros.piano.identify.bayes import Dimension, Optimizer
from pianobot_ros.piano.identify.cell.answer import identify_cell
from pianobot_ros.piano.identify.cell.dynamics import Wanted, play, solve
from pianobot_ros.piano.identify.cell.held_out import fit_parameters
from pianobot_ros.piano.identify.cell.vacuum import identify_vacuum, write_calibration
from pianobot_ros.piano.identify.state import load_state, plain, save_state
from pianobot_ros.piano.identify.stiffness import optimize_stiffness, profile_stiffness
from pianobot_ros.piano.identify.takes.levels import level_name, side_name
from pianobot_ros.piano.identify.takes.objective import Objective, comparable
from pianobot_ros.piano.identify.takes.references import (
    takes_from_midi,
    takes_from_reference,
    takes_from_references,
)
from pianobot_ros.piano.identify.takes.take import Take, takes_from_recording
from pianobot_ros.piano.twin.reduced.strike_geometry import stiffness_of

pytestmark = pytest.mark.slow

TWO_NOTES = (
    "strikes: [{notes: {thumb: 64, middle: 68}, "
    "speed: 0.15, depth: 0.014, hold: 0.4, note_length: 2.5, pressure: -50000}]"
)
NOMINAL = 15.5  # N m/rad at -50 kPa


def two_notes(stiffness: float, seed: int = 0) -> Recording:
    played = plan_score(parse_phrase(TWO_NOTES))
    return simulate_cell(
        played, parameter_errors={"joint_stiffness": stiffness / NOMINAL - 1}, seed=seed
    )


@pytest.fixture(scope="module")
def set_of_strikes() -> Recording:
    return simulate_cell(
        standard_strikes(1, 24, repeats=2), parameter_errors={"joint_stiffness": 0.2}, seed=1
    )


@pytest.fixture(scope="module")
def takes(set_of_strikes: Recording) -> list[Take]:
    return takes_from_recording(set_of_strikes)


@pytest.mark.parametrize("truth", [pytest.param(3.5, marks=pytest.mark.long), 7.0])
def test_a_hidden_stiffness_is_found_and_err_is_below_the_papers(truth: float) -> None:
    fit = optimize_stiffness(takes_from_recording(two_notes(truth)), iterations=20)
    assert fit.err < 0.0441
    assert fit.stiffness == pytest.approx(truth, rel=0.25)
    assert fit.profile.low < truth < fit.profile.high


def test_a_stiff_hand_is_called_not_identifiable() -> None:
    fit = optimize_stiffness(takes_from_recording(two_notes(90.0)), iterations=8)
    assert not fit.profile.identifiable
    assert any("cannot be identified" in w for w in fit.warnings)


@pytest.mark.long
def test_a_search_goes_on_where_it_was_stopped() -> None:
    used = takes_from_recording(two_notes(8.0))
    whole = optimize_stiffness(used, iterations=12, seed=4)
    part = optimize_stiffness(
        used, iterations=12, seed=4, cancelled=iter([False] * 7 + [True]).__next__
    )
    assert part.cancelled and len(part.history) == 7
    resumed = optimize_stiffness(used, iterations=12, resume=part.state)
    assert resumed.history == whole.history and resumed.stiffness == whole.stiffness


def test_state_files_belong_to_their_search(tmp_path: Path) -> None:
    state = Optimizer([Dimension("stiffness", 1, 10)], seed=3).state()
    path = save_state(tmp_path / "a" / "state.json", state, {"reference": "x"})
    assert load_state(path, {"reference": "x"}) == state
    with pytest.raises(ConfigError, match="belongs to a search with reference 'x'"):
        load_state(path, {"reference": "y"})
    path.write_text("{")
    with pytest.raises(ConfigError, match="not the state of a search"):
        load_state(path, {})
    with pytest.raises(PianobotError, match="not that of a search for stiffness"):
        optimize_stiffness(
            takes_from_recording(two_notes(8.0)),
            resume=Optimizer([Dimension("damping", 1, 10)]).state(),
        )


def test_the_optimizer_finds_a_minimum_and_refuses_nonsense() -> None:
    search = Optimizer([Dimension("a", 0.1, 10), Dimension("b", -1, 1, log=False)], seed=1)
    for _ in range(22):
        asked = search.ask()
        assert 0.1 <= asked["a"] <= 10 and -1 <= asked["b"] <= 1
        search.tell(asked, (np.log(asked["a"]) - 0.7) ** 2 + (asked["b"] - 0.3) ** 2)
    best, value = search.best()
    assert value < 0.03 and best["a"] == pytest.approx(2.0, rel=0.2)
    with pytest.raises(ConfigError, match="finite penalty"):
        search.tell({"a": 1.0, "b": 0.0}, float("nan"))
    with pytest.raises(ConfigError, match="not a range"):
        Dimension("a", 2, 1)


def test_the_objective_is_the_papers_with_its_slips_mended(takes: list[Take]) -> None:
    take = takes[0]
    stroke = take.stroke()
    found = take.keystroke(stroke)
    assert found is not None and take.reference is not None
    both = Objective((0.8, 0.2))([take], [stroke], [found])
    assert both == pytest.approx(2 * keystroke_error(found, take.reference), rel=1e-9)
    once = Objective((0.8, 0.2), "hold_once")([take], [stroke], [found])
    assert once == pytest.approx(2 * keystroke_error(found, take.reference, t_idle=False), rel=1e-9)
    assert Objective()([take], [stroke], [None]) > 3 > both
    for weights in ((0.8, 0.8), (0.0, 0.0), (1.5, -0.5)):
        with pytest.raises(ConfigError, match="sum to 1"):
            Objective(weights)
    with pytest.raises(ConfigError, match="did you mean 'paper'"):
        Objective(form="papr")  # type: ignore[arg-type]


def test_an_unknown_release_velocity_does_not_count(takes: list[Take]) -> None:
    reference = takes[0].reference
    assert reference is not None
    louder = replace(reference, v_pre=1.1 * reference.v_pre, v_rel=9.0)
    found, wanted = comparable(louder, replace(reference, v_rel=float("nan")))
    assert keystroke_error(found, wanted) == pytest.approx(0.8 * 0.1)


@pytest.mark.long
def test_every_vacuum_level_and_the_calibration_file(takes: list[Take], tmp_path: Path) -> None:
    curve = identify_vacuum(takes)
    whole = {round(x.pressure / 1e4): x for x in curve.levels if x.branch == "all"}
    for level, nominal in ((0, 5.73), (-5, 15.5), (-10, 28.65)):
        assert whole[level].identifiable
        assert whole[level].low < 1.2 * nominal < whole[level].high
        assert whole[level].stiffness == pytest.approx(1.2 * nominal, rel=0.1)
    assert not curve.hysteresis and not curve.decides
    path = write_calibration(curve, tmp_path / "stiffness.yaml", "a bag")
    table = yaml.safe_load(path.read_text())
    assert len(table["pressure"]["value"]) == 3
    assert np.all(np.diff(table["stiffness"]["value"]) >= 0)


def test_a_wrong_velocity_gain_no_longer_moves_the_stiffness() -> None:
    """5 % less gain once turned 15.5 into 4.6 N m/rad."""
    record = simulate_cell(
        standard_strikes(3, 12, repeats=2), parameter_errors={"midi_velocity_gain": -0.05}, seed=2
    )
    found = identify_cell(takes_from_recording(record))
    for known, pressure in zip(found.levels, found.pressures, strict=True):
        truth = float(stiffness_of(pressure))
        assert known.low < truth < known.high and known.value == pytest.approx(truth, rel=0.1)
    gain = next(k for k in found.known if k.name == "midi_velocity_gain")
    assert gain.low < 0.95 < gain.high
    assert found.err_after < found.err_before


@pytest.mark.long
def test_what_midi_alone_leaves_open_is_said_and_not_written(tmp_path: Path) -> None:
    phrase = (
        "strikes: ["
        + ", ".join(
            "{note: 64, finger: middle, speed: 0.15, depth: 0.014, hold: 0.3, note_length: 1.5,"
            f" pressure: {p}}}"
            for p in (0, -50000)
        )
        + "]"
    )
    record = simulate_cell(plan_score(parse_phrase(phrase)), seed=1, encoder=False)
    used = [replace(t, force=np.zeros(0)) for t in takes_from_recording(record)]
    curve = identify_vacuum(used)
    assert not any(x.identifiable for x in curve.levels)
    assert "note 64" in curve.decides
    with pytest.raises(PianobotError, match="what would decide it: .*note 64") as caught:
        write_calibration(curve, tmp_path / "stiffness.yaml", "a bag")
    assert "\n" not in str(caught.value) and not (tmp_path / "stiffness.yaml").exists()


def test_a_level_that_reads_a_little_below_nothing_is_nothing() -> None:
    assert level_name(-100.0) == level_name(0.0) == "joint_stiffness 0 kPa"
    assert side_name(-50_100.0) == "loading_stiffness -50 kPa"


def test_vacuum_that_never_rests_gives_no_levels(takes: list[Take]) -> None:
    moving = [
        replace(t, pressure=t.pressure + 20e3 * (t.given.time - t.given.start)) for t in takes
    ]
    with pytest.raises(RecordingError, match="two or more steady levels"):
        identify_vacuum(moving)


@pytest.mark.long
def test_hysteresis_shows_when_it_is_there(takes: list[Take]) -> None:
    """Signals played with a stiffness that depends on where the vacuum came from."""
    soft = [t for t in takes if round(t.strike.pressure / 1e3) == 0]
    loading = list({t.strike.condition: t for t in soft}.values())
    assert len(loading) >= 4, "conditions differ"
    bent = []
    for i in range(16):
        t = loading[i // 4]
        pressure = -50e3 if i % 2 else (0.0 if i % 4 == 0 else -100e3)
        k = {0.0: 6.0, -100e3: 25.0}.get(pressure, 13.0 if i % 4 == 1 else 16.0)
        stroke = t.stroke(k)
        strike = replace(t.strike, start=float(i), pressure=pressure, condition=f"{i}")
        given = replace(
            t.given,
            stiffness=np.full(len(t.given.time), float(stiffness_of(pressure))),
        )
        bent.append(
            replace(
                t,
                strike=strike,
                given=given,
                reference=t.keystroke(stroke),
                pressure=np.full(len(t.given.time), pressure),
                angle=stroke.angle,
                force=stroke.force,
            )
        )
    (found,) = identify_vacuum(bent).hysteresis
    assert found["loading"] == pytest.approx(13.0, rel=0.05)
    assert found["unloading"] == pytest.approx(16.0, rel=0.05)


@pytest.mark.long
def test_several_parameters_at_once(takes: list[Take]) -> None:
    fit = fit_parameters(takes, ("joint_stiffness", "trigger_on"))
    by_name = {e.name: e for e in fit.estimates}
    assert by_name["joint_stiffness -50 kPa"].value == pytest.approx(1.2, rel=0.1)
    assert by_name["trigger_on"].value == pytest.approx(0.0, abs=0.001)
    assert fit.err_held_out < 0.03  # rounding of MIDI velocities alone leaves half of it
    with pytest.raises(PianobotError, match="did you mean 'joint_stiffness'"):
        fit_parameters(takes, ("joint_stifness",))


def test_wanted_velocity_and_hold_are_played() -> None:
    for wanted in (Wanted(64, 30, 0.3), Wanted(62, 80, 0.25)):
        (solved,) = solve([wanted])
        keystroke, stroke = play(solved.motion, wanted.note, solved.pressure)
        assert keystroke is not None
        assert solved.velocity == pytest.approx(wanted.velocity, abs=0.6)
        assert keystroke.t_hold == pytest.approx(wanted.t_hold, abs=2e-3)
        assert stroke.force.max() == pytest.approx(solved.peak_force)
        assert 2 * solved.motion.speed**2 / solved.motion.amplitude <= 25.0, (
            "within the arm's acceleration"
        )
    with pytest.raises(ScoreError, match="out of reach"):
        solve([Wanted(64, 127, 0.3)], max_speed=0.1)
    with pytest.raises(ScoreError, match="ask for a longer note"):
        solve([Wanted(64, 20, 0.01)])


def midi_file(path: Path, release: int = 64) -> Path:
    file, track = mido.MidiFile(), mido.MidiTrack()
    file.tracks.append(track)
    for note, velocity in ((64, 40), (66, 35)):
        track.append(mido.Message("note_on", note=note, velocity=velocity, time=480))
        track.append(mido.Message("note_off", note=note, velocity=release, time=480))
    file.save(path)
    return path


def test_a_midi_file_is_a_reference(tmp_path: Path) -> None:
    used = takes_from_midi(midi_file(tmp_path / "a.mid"))
    assert [t.strike.note for t in used] == [64, 66]
    for take, velocity in zip(used, (40, 35), strict=True):
        assert take.reference is not None
        assert take.reference.v_pre * take.midi.velocity_gain == pytest.approx(velocity)
        assert take.reference.t_hold == pytest.approx(0.5) and np.isnan(take.reference.v_rel)
        assert take.keystroke(take.stroke()) is not None
    measured = takes_from_midi(midi_file(tmp_path / "b.mid", release=30))
    assert measured[0].reference is not None and np.isfinite(measured[0].reference.v_rel)
    assert np.isfinite(optimize_stiffness(used, iterations=6).err)


def test_what_is_no_reference_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.mid").write_bytes(b"no midi")
    for name, words in (
        ("x.mid", "not a standard MIDI file"),
        ("x.yaml", "does not say how"),
        ("bag", "does not exist"),
    ):
        with pytest.raises(PianobotError, match=words):
            takes_from_reference(tmp_path / name)
    with pytest.raises(RecordingError, match="no strike at -90 kPa"):
        takes_from_references([midi_file(tmp_path / "a.mid")], pressure=-90e3)


def test_bad_recordings_are_named_in_one_line(set_of_strikes: Recording) -> None:
    first = set_of_strikes.strikes[0]
    one = replace(set_of_strikes, strikes=[first])
    cut = [e for e in one.notes["real"] if e.on or e.time > first.end + 1e9]
    twice = [first, replace(first, index=1, start=first.start + 0.05)]
    cases = [
        (replace(one, notes={"real": cut[:1]}), "has no release"),
        (replace(one, strikes=twice), "strikes 0 and 1 of note 64 overlap"),
        (
            replace(
                one, warnings=("the clock of /real/midi jumps back by 1.000 s: 3 samples left out",)
            ),
            "jumps back",
        ),
        (replace(one, notes={}), "/real/midi is not in this recording"),
        (replace(one, notes={"real": []}), "no strike sounded"),
    ]
    for recording, words in cases:
        with pytest.raises(RecordingError, match=words) as caught:
            takes_from_recording(recording)
        assert "\n" not in str(caught.value)


def test_the_interval_narrows_with_more_strikes(takes: list[Take]) -> None:
    soft = [t for t in takes if t.strike.pressure == 0.0]
    few, many = profile_stiffness(soft[:1]), profile_stiffness(soft)
    assert many.high / many.low < few.high / few.low


def test_numbers_that_json_does_not_know_become_null() -> None:
    assert plain({"a": [float("nan"), 1.5, (float("inf"),)], "b": "x"}) == {
        "a": [None, 1.5, [None]],
        "b": "x",
    }


@pytest.mark.long
def test_what_no_signature_explains_widens_the_interval_and_asks_for_a_diagnosis() -> None:
    record = simulate_cell(
        standard_strikes(3, 12, repeats=2), effects={"key_friction": 10.0}, seed=2, encoder=True
    )
    found = identify_cell(takes_from_recording(record))
    assert found.joint.birge > 2.0
    for known, pressure in zip(found.levels, found.pressures, strict=True):
        assert known.low < float(stiffness_of(pressure)) < known.high
    assert ("pianobot diagnose" in found.decides) == (not all(k.identifiable for k in found.levels))
