"""Scores as strangers write them."""

from __future__ import annotations

from pathlib import Path

import mido
import pytest

from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.score import load_score, parse_phrase, plan_score
from pianobot_ros.cell.score.midi_file import MidiNote, reduce_notes, wrist_speed


def midi(path: Path, notes: list[int], length: int = 960) -> Path:
    file, track = mido.MidiFile(), mido.MidiTrack()
    file.tracks.append(track)
    for note in notes:
        track.append(mido.Message("note_on", note=note, velocity=60, time=0))
        track.append(mido.Message("note_off", note=note, velocity=0, time=length))
    file.save(path)
    return path


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("strikes: [{note: 64, sped: 0.1}]", "did you mean 'speed'"),
        ("strikes: [{note: 84}]", "not on the keyboard"),
        ("strikes: [{note: 64, finger: index}]", "cannot strike alone"),
        ("strikes: [{note: 64, finger: ring}]", "unknown finger"),
        ("strikes: [{note: 64, notes: [60, 63]}]", "exactly one of"),
        ("strikes: [{notes: [60, 71]}]", "cannot stretch"),
        ("strikes: [{note: 64, speed: 0.9, depth: 0.02}]", "too fast"),
        ("strikes: [{note: 64, speed: .nan}]", "speed"),
        ("strikes: [{note: 64, articulation: legato}]", "needs a note_length"),
        ("strikes: [{glissando: {from: 61, to: 64, time: 1}}]", "white key"),
        ("strikes: []", "no strikes"),
        ("strikes: [", "not valid YAML"),
        ("- 1", "mapping"),
    ],
)
def test_mistakes_in_a_phrase_are_named(text: str, words: str) -> None:
    with pytest.raises(ScoreError, match=words):
        parse_phrase(text)


def test_repeats_share_a_condition_and_two_orders_take_turns() -> None:
    score = load_score("repeats")
    names = [s.condition for s in score.strikes]
    assert len(names) == 40 and {names.count(n) for n in names} == {4}
    assert names[:10] != sorted(names[:10])
    assert names[20:] == names[:20] and names[10:20] != names[:10]


def test_legato_holds_longer_than_staccato() -> None:
    short, long = (
        parse_phrase(f"strikes: [{{note: 64, note_length: 1, articulation: {a}}}]")
        .strikes[0]
        .motion.hold
        for a in ("staccato", "legato")
    )
    assert long - short == pytest.approx(0.55)


def test_a_midi_file_in_reach_is_played(tmp_path: Path) -> None:
    score = load_score(midi(tmp_path / "a.mid", [60, 62, 64]))
    assert [s.notes for s in score.strikes] == [(60,), (62,), (64,)] and not score.unreachable
    assert len(plan_score(score).strikes) == 3


def test_a_midi_file_two_octaves_away_says_how_to_transpose(tmp_path: Path) -> None:
    path = midi(tmp_path / "high.mid", [84, 86, 88])
    with pytest.raises(ScoreError, match="--transpose -24"):
        load_score(path)
    assert len(load_score(path, transpose=-24).strikes) == 3


def test_notes_left_out_are_named_with_the_reason() -> None:
    notes = [
        MidiNote(0, 0.5, 60, 60),
        MidiNote(0.05, 0.1, 71, 60),
        MidiNote(2, 2.5, 90, 60),
        MidiNote(3, 3.5, 62, 60),
    ]
    strikes, left_out = reduce_notes(notes)
    assert [s.notes for s in strikes] == [(60,), (62,)]
    assert any("71" in line and "too fast" in line for line in left_out)
    assert any("90" in line and "out of reach" in line for line in left_out)


def test_what_is_no_midi_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.mid"
    path.write_bytes(b"not midi")
    with pytest.raises(ScoreError, match="not a standard MIDI file"):
        load_score(path)
    with pytest.raises(ScoreError, match="did you mean 'demo'"):
        load_score("dem")


def test_louder_notes_are_struck_faster_within_the_limits() -> None:
    speeds = [wrist_speed(v) for v in range(1, 128)]
    assert speeds == sorted(speeds) and speeds[0] > 0
