"""Configuration, phrases and MIDI files that mean harm, or whose author slipped."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import mido
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.cell.errors import ConfigError, ScoreError, unknown_name
from pianobot_ros.cell.motion.geometry import Keyboard
from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.cell.numbers.bounded_files import LONGEST, parse_yaml, plain, yaml_text
from pianobot_ros.cell.numbers.config import config_dir, load_section, load_yaml
from pianobot_ros.cell.score import load_score, parse_phrase, plan_score, types
from pianobot_ros.devices.fsr import FsrConfig

BOMB = "a0: &a0 [1, 2]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: " + "[" * 5000, "levels deep"),
        ("a: &a [*a]", "part of"),
        (BOMB, "more than"),
        ("a: " + "x" * (LONGEST + 1), "longer than"),
        ("a: .inf", "finite"),
        ("a: 1e999", "finite"),
        ("a: 0x" + "f" * 4000, "finite"),
        ("a: " + "1" * 5000, "not valid YAML"),
        ("a: !!int ''", "not valid YAML"),
        ("a: !!timestamp x", "not valid YAML"),
        ("a: !!set {a}", "is a set"),
        ("a: !!timestamp 2001-01-01", "is a date"),
        ("? [a]\n: b", "not valid YAML"),
        ("1.5: b", "is no name"),
        ('a: "\\x07"', "do not print"),
        ("- a", "mapping"),
    ],
)
def test_yaml_out_of_bounds_is_refused_in_one_line(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says) as error:
        parse_yaml(text, "it")
    assert len(str(error.value).splitlines()) == 1 and len(str(error.value)) < 400


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text() | st.binary(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text() | st.none(), inner),
    )
)
def test_plain_takes_what_is_finite_and_prints(value: object) -> None:
    def good(node: object) -> bool:
        if isinstance(node, dict):
            return all(isinstance(k, str) and good(k) and good(v) for k, v in node.items())
        if isinstance(node, list):
            return all(map(good, node))
        if isinstance(node, str):
            return all(c.isprintable() or c in "\n\t" for c in node)
        return node is None or (isinstance(node, (int, float)) and abs(node) <= 1e15)

    try:
        plain(value, "it")
    except ConfigError:
        assert not good(value)
    else:
        assert good(value)


def test_numbers_with_an_exponent_are_numbers() -> None:
    assert parse_yaml("a: 1e-3\nb: 2001-01-01", "it") == {"a": 0.001, "b": "2001-01-01"}


@pytest.fixture
def configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    copy = tmp_path / "config"
    shutil.copytree(config_dir(), copy)
    monkeypatch.setenv("PIANOBOT_CONFIG", str(copy))
    return copy


@given(st.from_regex(r"[0-9]{1,5}e[0-9]{1,5}|[-+.0-9eE_:]{1,7}|[0-9a-f+]{7}", fullmatch=True))
def test_a_text_that_looks_like_a_number_is_written_and_read_as_a_text(text: str) -> None:
    assert parse_yaml(yaml_text({"commit": text, "number": 1e-3}), "it") == {
        "commit": text,
        "number": 0.001,
    }


@pytest.mark.parametrize("value", [".inf", ".nan", "true", "'1'", "[1]"])
def test_no_number_of_a_configuration_is_anything_else(configuration: Path, value: str) -> None:
    board = configuration / "keyboard.yaml"
    board.write_text(board.read_text().replace("{value: 0.0235,", f"{{value: {value},"))
    with pytest.raises(ConfigError, match="pitch"):
        load_section("keyboard.yaml", Keyboard)
    sensor = configuration / "fsr.yaml"
    sensor.write_text(sensor.read_text().replace("[16,", f"[{value},", 1))
    with pytest.raises(ConfigError, match="counts"):
        FsrConfig.load()
    wrist = configuration / "wrist.yaml"
    text = wrist.read_text()
    at = text.index("{value: ", text.index("  tilt:")) + len("{value: ")
    wrist.write_text(text[:at] + value + text[text.index(",", at) :])
    wrist_limits.cache_clear()
    with pytest.raises(ConfigError, match="tilt"):
        wrist_limits()
    wrist_limits.cache_clear()


def test_what_is_no_file_is_called_what_it_is(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.yaml"
    os.mkfifo(pipe)
    for path, says in (
        ("/dev/null", "is a device or a pipe"),
        (str(pipe), "is a device or a pipe"),
        (str(tmp_path), "is a directory"),
        (str(tmp_path / "none.yaml"), "does not exist"),
        ("x" * 300 + ".yaml", "cannot be looked up"),
    ):
        with pytest.raises(ConfigError, match=says):
            load_yaml(path)
        with pytest.raises(ScoreError, match=says):
            load_score(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("strikes: [{note: 64, speed: 1e-320}]", "speed"),
        ("strikes: [{note: 64, release_speed: 1e-9}]", "release_speed"),
        ("strikes: [{note: 64, depth: 1e-9}]", "depth"),
        ("strikes: [{note: true}]", "note"),
        ("strikes: [{note: 64.0}]", "note"),
        ("strikes: [{note: 64, hold: true}]", "hold"),
        ("strikes: [{note: 64, hold: '0.1'}]", "hold"),
        ("strikes: [{note: 64, repeats: 4294967295}]", "repeats"),
        ("strikes: [{glissando: {from: 60, to: 999999999, time: 1}}]", "glissando.to"),
        ("strikes: [{glissando: {from: 60, to: 64, time: 1e-9}}]", "glissando.time"),
        ("defaults: {repeats: 1000}\nstrikes: [" + "{note: 64}, " * 11 + "]", "too many"),
        ("strikes: [{note: 64, hold: 20, repeats: 1000}]", "minutes"),
        ("strikes: [{note: 64, note_length: 60, repeats: 100}]", "minutes"),
        ("strikes: [{note: 64, condition: " + "x" * 201 + "}]", "condition"),
        ("strikes: {a: 1}", "strikes"),
        ("defaults: {3: 4}\nstrikes: [{note: 64}]", "unknown name '3'"),
    ],
)
def test_a_phrase_out_of_bounds_is_refused_before_it_costs_anything(text: str, says: str) -> None:
    with pytest.raises(ScoreError, match=says):
        plan_score(parse_phrase(text))


@pytest.mark.parametrize("tempo", [float("nan"), float("inf"), 0.0, 1e-320, -1.0])
def test_a_tempo_is_a_sane_factor(tempo: float, tmp_path: Path) -> None:
    with pytest.raises(ScoreError, match="tempo"):
        parse_phrase("strikes: [{note: 64}]", tempo=tempo)
    with pytest.raises(ScoreError, match="tempo"):
        load_score(_midi(tmp_path / "a.mid", 1, 10), tempo=tempo)


def test_repeats_without_end_are_refused() -> None:
    with pytest.raises(ScoreError, match="too many"):
        parse_phrase("strikes: [{note: 64}]").repeated(4294967295)


def _midi(path: Path, notes: int, ticks: int) -> Path:
    file, track = mido.MidiFile(), mido.MidiTrack()
    file.tracks.append(track)
    for _ in range(notes):
        track.append(mido.Message("note_on", note=64, velocity=60, time=ticks))
        track.append(mido.Message("note_off", note=64, velocity=0, time=ticks))
    file.save(path)
    return path


def test_midi_files_without_end_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch, pytest.raises(ScoreError, match="too many"):
        patch.setattr(types, "MOST_STRIKES", 20)
        load_score(_midi(tmp_path / "many.mid", 21, 1))
    with pytest.raises(ScoreError, match="minutes"):
        plan_score(load_score(_midi(tmp_path / "long.mid", 3, 2**27)))
    large = tmp_path / "large.mid"
    large.write_bytes(bytes(1_000_001))
    with pytest.raises(ScoreError, match="longer than"):
        load_score(large)


def test_a_long_unknown_name_is_cut_short() -> None:
    assert len(unknown_name("finger", "x" * 10**6, ["thumb"])) < 200
