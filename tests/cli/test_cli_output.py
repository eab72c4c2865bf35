"""What the commands say: help without heavy imports, and JSON that parses."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.text import Text
from typer.main import get_command

from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.cli.app import app, main
from pianobot_ros.cli.graph import doctor

HEAVY = ("rclpy", "mujoco", "numba", "scipy", "numpy", "rosbags", "matplotlib", "viser", "skopt")
COMMANDS = {
    "compile",
    "demo",
    "up",
    "play",
    "record",
    "bag",
    "identify",
    "optimize",
    "diagnose",
    "blind",
    "experiment",
    "export-model",
    "doctor",
    "reproduce",
}


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    time = np.arange(0, 2, 0.002)
    gap = (time < 0.8) | (time > 1.3)
    signals = {
        "real/fsr.force": TimeSeries(time[gap], np.ones(gap.sum()), "N"),
        "real/wrist/state.position": TimeSeries(time[::4], np.zeros((250, 3)), "m"),
    }
    return write_bag(Recording(signals, fsr_note=64, epoch=1.7e9), tmp_path / "bag")


def printed(capsys: pytest.CaptureFixture[str], *words: str | Path) -> object:
    """The JSON that a command prints; nothing else may be on stdout."""
    code = main([str(w) for w in words])
    captured = capsys.readouterr()
    assert code == 0, captured.err
    assert "NaN" not in captured.out, "not JSON, though Python reads it"
    return json.loads(captured.out)


def test_help_names_every_command_and_imports_nothing_heavy() -> None:
    look = (
        "import sys; from pianobot_ros.cli.app import main; code = main(['--help'])\n"
        f"print([m for m in {HEAVY} if m in sys.modules], code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", look], capture_output=True, text=True, timeout=600, check=True
    )
    *help_text, last = done.stdout.splitlines()
    assert last == "[] 0"
    words = {line.split()[1] for line in help_text if len(line.split()) > 2}
    assert words >= COMMANDS


def test_every_option_says_what_it_is() -> None:
    def silent(command: Any, *words: str) -> Iterator[str]:
        for name, one in getattr(command, "commands", {}).items():
            yield from silent(one, *words, name)
        for p in command.params:
            if not getattr(p, "help", "") and p.name != "help":
                yield " ".join((*words, p.name))

    assert not list(silent(get_command(app)))


def test_help_is_printed_as_it_is_written() -> None:
    """Help passes through Rich's markup, which takes a text in brackets for a style; and in a
    table of commands a line of the source stays a line.
    """

    def texts(command: Any) -> Iterator[str]:
        for one in getattr(command, "commands", {}).values():
            yield from texts(one)
            assert "\n" not in one.help.split("\n\n")[0], one.help
        yield from (p.help for p in command.params if getattr(p, "help", ""))
        yield command.help

    assert [t for t in texts(get_command(app)) if Text.from_markup(t).plain != t] == []


def test_without_arguments_there_is_help(capsys: pytest.CaptureFixture[str]) -> None:
    main([])
    captured = capsys.readouterr()
    assert "Usage" in captured.out + captured.err


@pytest.mark.long
def test_compile_says_what_it_has_compiled(capsys: pytest.CaptureFixture[str]) -> None:
    main(["compile"])
    said = capsys.readouterr().out.splitlines()
    assert {line.split(":")[1].split("(")[0].strip() for line in said} == {
        "emulated cell",
        "emulated arm",
        "running twin",
        "strike",
        "robot joint",
        "diagnosis",
    }


def test_bag_info(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    info = printed(capsys, "bag", "info", bag, "--json")
    assert isinstance(info, dict)
    topics = {t["name"]: t for t in info["topics"]}
    assert info["whole"] and info["messages"] == sum(t["count"] for t in topics.values())
    assert topics["/real/fsr"]["rate"] == pytest.approx(500, rel=0.01)
    ((start, length),) = topics["/real/fsr"]["gaps"]
    assert (start, length) == (pytest.approx(0.8, abs=0.005), pytest.approx(0.5, abs=0.005))
    assert topics["/real/wrist/state"]["rate"] == pytest.approx(125, rel=0.01)
    assert topics["/real/wrist/state"]["gaps"] == []
    assert main(["bag", "info", str(bag)]) == 0
    assert "1 gaps, longest 0.50 s" in capsys.readouterr().out


def test_bag_repair(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = printed(capsys, "bag", "repair", bag, "--json")
    assert isinstance(whole, dict) and whole["original"] is None
    (bag / "metadata.yaml").unlink()
    repaired = printed(capsys, "bag", "repair", bag, "--json")
    assert isinstance(repaired, dict)
    assert repaired["messages"] == whole["messages"] and Path(repaired["original"]).is_dir()


def test_play_dry_run(capsys: pytest.CaptureFixture[str]) -> None:
    plan = printed(capsys, "play", "two_note", "--dry-run", "--json")
    assert isinstance(plan, dict)
    assert plan["strikes"] == len(plan["notes"]) == 12 and plan["unreachable"] == []


def test_a_dry_run_counts_repeats(capsys: pytest.CaptureFixture[str]) -> None:
    once = printed(capsys, "play", "two_note", "--dry-run", "--json")
    plan = printed(capsys, "play", "two_note", "--dry-run", "--json", "--repeats", "3")
    assert isinstance(once, dict) and isinstance(plan, dict)
    assert plan["notes"] == 3 * once["notes"] and plan["duration"] > 2.5 * once["duration"]


def test_a_diagnosis_proposes_one_strike_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strike = {"note": 64, "finger": 2, "speed": 0.2, "depth": 0.01, "hold": 0.5, "pressure": 0.0}
    proposal = {
        "name": "proposal 1",
        "attributes": strike,
        "separates": ["hammer", "let_off"],
        "shows_in": "force",
        "expected_gain": 0.5,
        "gain_over_median": 2.0,
    }
    file, phrase = tmp_path / "diagnosis.json", tmp_path / "new" / "next.yaml"
    file.write_text(json.dumps({"verdict": "effect", "next_experiment": proposal}))
    words = ["experiment", "next", str(file)]
    assert main([*words, "--count", "5", "--out", str(phrase)]) == 0
    said = capsys.readouterr()
    assert said.err == "Note: a diagnosis holds its best strike only; give its bags for 5\n"
    assert said.out.splitlines()[-1] == f"Phrase: {phrase} (pianobot play {phrase})"
    assert main([*words, "--count", "1"]) == 0 and not capsys.readouterr().err
    assert main([*words, str(tmp_path)]) == 2 and "alone" in capsys.readouterr().err
    proposal["attributes"] = {"travel": 0.1}
    file.write_text(json.dumps({"verdict": "effect", "next_experiment": proposal}))
    assert main(words) == 2 and "no strike" in capsys.readouterr().err


def test_doctor(capsys: pytest.CaptureFixture[str]) -> None:
    findings = printed(capsys, "doctor", "--json")
    assert isinstance(findings, list) and all(
        f["state"] in ("ok", "limited", "missing") for f in findings
    )
    assert all(f["remedy"] for f in findings if f["state"] != "ok")


def test_graphics_that_do_not_answer_leave_nothing_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine the doctor had named them as what nothing works without."""
    monkeypatch.setattr(doctor, "_RENDERS", 1e-3)
    (found,) = (check for check in doctor.examine() if check.name == "Rendering")
    assert found.state == "limited" and "no answer" in found.detail and found.remedy


def test_the_exported_model_is_one_that_stock_mujoco_loads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import mujoco

    done = printed(capsys, "export-model", tmp_path / "cell.xml", "--json")
    assert isinstance(done, dict)
    assert mujoco.MjModel.from_xml_path(done["file"]).nbody > 10
