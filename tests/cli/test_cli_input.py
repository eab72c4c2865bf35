"""Wrong input as a stranger would give it: one line on stderr that says what to do, exit code 2,
nothing written.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import mido
import pytest

from pianobot_ros.cli.app import main

Told = Callable[..., str]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Told:
    """Runs a command that must fail and returns its only line on stderr."""

    def run(*words: str | Path) -> str:
        assert main([str(w) for w in words]) == 2
        captured = capsys.readouterr()
        assert captured.out == ""
        (line,) = captured.err.splitlines()
        assert line.startswith("error: ") and "Traceback" not in line
        return line

    return run


def midi_file(path: Path, notes: list[int]) -> Path:
    track = mido.MidiTrack()
    for note in notes:
        track.append(mido.Message("note_on", note=note, velocity=60, time=480))
        track.append(mido.Message("note_off", note=note, velocity=0, time=480))
    file = mido.MidiFile()
    file.tracks.append(track)
    file.save(path)
    return path


def test_a_phrase_with_a_typing_error_names_the_word(refused: Told, tmp_path: Path) -> None:
    path = tmp_path / "phrase.yaml"
    path.write_text("strikes:\n  - {note: 64, sped: 0.15}\n")
    assert "did you mean 'speed'?" in refused("play", path, "--dry-run")
    path.write_text("strikes: [{note: 64\n")
    assert "phrase.yaml" in refused("play", path, "--dry-run")
    path.write_text("strikes:\n  - {note: 64, speed: fast}\n")
    assert "speed" in refused("play", path, "--dry-run")


def test_a_midi_file_two_octaves_away_says_how_to_transpose(
    refused: Told, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = midi_file(tmp_path / "low.mid", [36, 38, 40])
    line = refused("play", path, "--dry-run")
    assert "off the keyboard" in line and "--transpose 24" in line
    assert main(["play", str(path), "--dry-run", "--json", "--transpose", "24"]) == 0, (
        "the advice works"
    )
    assert json.loads(capsys.readouterr().out)["notes"] == [60, 62, 64]


def test_a_file_that_is_no_midi_file(refused: Told, tmp_path: Path) -> None:
    path = tmp_path / "song.mid"
    path.write_bytes(b"MThd is not enough")
    assert "song.mid is not a standard MIDI file" in refused("play", path, "--dry-run")


@pytest.mark.parametrize(
    ("score", "says"),
    [("singel", "singel"), ("none.mid", "does not exist"), ("song.mp3", "song.mp3")],
    ids=["unknown phrase", "missing file", "wrong suffix"],
)
def test_a_score_that_is_not_there(refused: Told, score: str, says: str) -> None:
    assert says in refused("play", score, "--dry-run")


@pytest.mark.parametrize("tempo", ["0", "-1", "nan", "1e9"])
def test_a_tempo_that_is_none(refused: Told, tempo: str) -> None:
    assert "tempo" in refused("play", "single", "--dry-run", "--tempo", tempo)


@pytest.mark.parametrize(
    "words",
    [
        ["bag", "info"],
        ["bag", "repair"],
        ["diagnose"],
        ["experiment", "next"],
        ["identify", "keystroke"],
        ["blind", "diagnose"],
    ],
    ids=" ".join,
)
def test_a_missing_bag_is_named_and_nothing_is_made(
    refused: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "nobag" in refused(*words, tmp_path / "nobag")
    assert list(tmp_path.iterdir()) == []


def test_a_bag_that_is_none(refused: Told, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("not a bag")
    for command in ("info", "repair"):
        assert "not a rosbag2 bag" in refused("bag", command, tmp_path)
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"something else")
    for command in ("info", "repair"):
        assert "broken.mcap" in refused("bag", command, broken)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["broken.mcap", "notes.txt"]


def test_a_model_goes_into_an_xml_file_that_can_be_written(refused: Told, tmp_path: Path) -> None:
    assert ".xml" in refused("export-model", tmp_path / "model.urdf")
    assert "nodir" in refused("export-model", tmp_path / "nodir" / "model.xml")


def test_node_parameters_with_typing_errors(
    refused: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    config = tmp_path / "cell.yaml"
    config.write_text("conducter: {rate: 125.0}\n")
    assert "did you mean 'conductor'?" in refused("up", "--config", config, "--no-tui")
    config.write_text("conductor: 125\n")
    assert "conductor" in refused("up", "--config", config, "--no-tui")
    assert "none.yaml" in refused("up", "--config", tmp_path / "none.yaml", "--no-tui")


@pytest.mark.parametrize(
    "words",
    [
        ["nosuch"],
        ["play"],
        ["play", "single", "--tempo", "fast"],
        ["up", "--domain", "500"],
        ["bag", "nosuch"],
    ],
    ids=" ".join,
)
def test_words_that_are_no_command(refused: Told, words: list[str]) -> None:
    refused(*words)


def test_playing_without_a_running_cell_says_how_to_start_one(ros_domain: int) -> None:
    # In a process of its own: the command takes over this process' signals and ROS context.
    done = subprocess.run(
        [sys.executable, "-m", "pianobot_ros.cli.app", "play", "single", "--timeout", "0.5"],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
        env=dict(os.environ),
    )
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "error: no conductor is running: start the cell with `pianobot up`"
    ]
