"""Wrong input as a stranger would give it: one line on stderr that says what to do, exit code 2,
nothing written.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

import mido
import pytest
import typer

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cli.analysis.identify import emit
from pianobot_ros.cli.app import app, main
from pianobot_ros.cli.new_paths import default_folder

Told = Callable[..., str]


def commands(at: Any = None, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command with the words that call it."""
    at = typer.main.get_command(app) if at is None else at
    below = getattr(at, "commands", {})
    if not below:
        yield words, at
    for name, command in below.items():
        yield from commands(command, (*words, name))


def options_of(kind: type, named: str = "") -> list[tuple[str, ...]]:
    """Options of a type in all commands: each as the words of a call that lacks only its value."""
    found: list[tuple[str, ...]] = []
    for words, command in commands():
        needed: list[str] = []
        for p in command.params:
            if p.required:
                needed += [p.opts[0], "x"] if p.opts[0].startswith("--") else ["x"]
        for p in command.params:
            annotation = p.type_descriptor.annotation
            if kind in (annotation, *get_args(annotation)) and named in p.name:
                found.append((*words, *needed, p.opts[0]))
    return found


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


def test_a_fitted_twin_that_is_not_there_says_what_writes_one(
    refused: Told, tmp_path: Path
) -> None:
    log = tmp_path / "log.csv"
    log.write_text("time,position,torque\n0,0,0\n")
    said = refused("axis", "predict", log, "--fitted", tmp_path / "twin.json")
    assert "twin.json: No such file" in said and "`pianobot axis diagnose LOG --json`" in said


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


def test_more_strikes_than_a_score_may_have(refused: Told) -> None:
    words = ("play", "two_note", "--repeats", "2000")
    assert "12000 strikes are too many, a score has at most 10000" in refused(*words)
    assert "12000 strikes are too many, a score has at most 10000" in refused(*words, "--dry-run")


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


def test_options_are_found() -> None:
    assert len(options_of(int, "seed")) >= 7 and len(options_of(float)) >= 9


@pytest.mark.parametrize("words", options_of(int, "seed"), ids=" ".join)
@pytest.mark.parametrize("value", ["-1", str(2**32), "1.5"])
def test_a_seed_that_is_none(
    refused: Told,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    value: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert words[-1] in refused(*words, value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", options_of(float), ids=" ".join)
@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_number_that_is_none(refused: Told, words: tuple[str, ...], value: str) -> None:
    assert words[-1] in refused(*words, value)


@pytest.mark.parametrize("words", options_of(float, "timeout"), ids=" ".join)
def test_a_wait_of_less_than_nothing(refused: Told, words: tuple[str, ...]) -> None:
    assert "--timeout" in refused(*words, "-1")


@pytest.mark.parametrize(
    "words",
    [
        ["diagnose", ""],
        ["bag", "info", ""],
        ["axis", "diagnose", ""],
        ["diagnose", "bag", "--output="],
        ["view", "--host", ""],
    ],
    ids=" ".join,
)
def test_an_empty_word_is_not_the_folder_one_is_in(refused: Told, words: list[str]) -> None:
    assert "empty" in refused(*words)


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


@pytest.mark.parametrize("value", ["nan", "inf", "heavy"])
def test_a_nominal_value_that_is_no_number(refused: Told, tmp_path: Path, value: str) -> None:
    log = tmp_path / "log.csv"
    log.write_text("time,command,position\n")
    words = ("axis", "diagnose", log, "--nominal", f"inertia={value}")
    assert refused(*words) == f"error: --nominal inertia wants a finite number, got '{value}'"


@pytest.mark.parametrize(
    "words",
    [
        ["experiment", "next", "nobag", "--out", "there.yaml"],
        ["export-model", "there.xml"],
        ["optimize", "dynamics", "--scale", "3", "--phrase", "there.yaml"],
        ["identify", "vacuum", "nobag", "--write-calibration", "there.yaml"],
        ["blind", "score", "nocases", "--answers", "none.json", "--svg", "there.svg"],
        ["blind", "make", "cases", "--answers", "there.json"],
        ["axis", "diagnose", "nolog", "--report", "there.html"],
        ["demo", "--picture", "there.svg"],
    ],
    ids=" ".join,
)
def test_a_file_that_is_there_is_not_replaced(
    refused: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    there = Path(words[-1])
    there.write_text("mine")
    assert refused(*words).startswith(f"error: {there} exists already")
    assert [p.read_text() for p in tmp_path.iterdir()] == ["mine"]


WRITERS = [
    (["diagnose", "nobag", "--output"], "diagnosis.json"),
    (["investigate", "--output"], "report.html"),
    (["identify", "keystroke", "nobag", "--output"], "result.json"),
    (["identify", "vacuum", "nobag", "--output"], "result.json"),
    (["identify", "parameters", "nobag", "--output"], "result.json"),
    (["optimize", "stiffness", "nobag", "--output"], "result.json"),
    (["optimize", "dynamics", "--scale", "3", "--output"], "result.json"),
    (["axis", "diagnose", "nolog", "--report"], "index.html"),
]


@pytest.mark.parametrize(("words", "file"), WRITERS, ids=lambda w: " ".join(w[:2]))
def test_results_that_are_there_are_not_replaced(
    refused: Told, tmp_path: Path, words: list[str], file: str
) -> None:
    (tmp_path / file).write_text("mine")
    assert f"{tmp_path / file} exists already" in refused(*words, tmp_path)
    assert (tmp_path / file).read_text() == "mine"


@pytest.mark.parametrize(
    "words", [*(w for w, _ in WRITERS), ["reproduce", "--output"], ["up", "--no-tui", "--run"]]
)
def test_a_file_where_results_are_to_go_is_seen_before_computing(
    refused: Told, tmp_path: Path, words: list[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        assert f"{tmp_path / 'file'} is a file and no folder" in refused(*words, place)


def test_what_cannot_be_written_is_said_all_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def draw(folder: Path) -> Path:
        raise OSError(28, "No space left on device", str(folder))

    for as_json, said in ((False, "k = 1"), (True, '"k": 1')):
        with pytest.raises(PianobotError, match="No space left"):
            emit({"k": 1}, tmp_path, as_json, ["k = 1"], draw)
        assert said in capsys.readouterr().out


def test_each_run_has_a_folder_of_its_own_for_its_diagnosis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    here = Path("diagnosis")
    for bag, name in {
        "A/bag": "A",
        "B/bag": "B",
        "B/bag/bag_0.mcap": "B",
        "B/bag-2": "B-bag-2",
        "recordings/monday": "monday",
        "bagatelle": "bagatelle",
        "one.mcap": "one.mcap",
    }.items():
        assert default_folder(Path(bag)) == here / name
    (here / "A").mkdir(parents=True)
    assert default_folder(Path("A/bag")) == here / "A-2"
    Path("B").mkdir()
    monkeypatch.chdir(tmp_path / "B")
    assert default_folder(Path("bag")) == here / "B"


@pytest.mark.parametrize(
    "words",
    [
        ["diagnose"],
        ["experiment", "next"],
        ["identify", "vacuum"],
        ["optimize", "stiffness"],
        ["axis", "diagnose"],
    ],
    ids=" ".join,
)
def test_a_recording_counts_once(refused: Told, tmp_path: Path, words: list[str]) -> None:
    same = (tmp_path / "bag", tmp_path / "x" / ".." / "bag")
    assert f"{same[1]} is given twice" in refused(*words, *same)
