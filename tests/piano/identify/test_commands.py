"""`pianobot identify` and `pianobot optimize` as a user runs them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pianobot_ros.bags.write import write_bag
from pianobot_ros.cli.app import main
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    record = simulate_cell(
        standard_strikes(1, 10, repeats=2),
        parameter_errors={"joint_stiffness": 0.2},
        seed=1,
        encoder=True,
    )
    return write_bag(record, tmp_path_factory.mktemp("bags") / "strikes")


def run(*arguments: object) -> int:
    try:
        return int(main([str(a) for a in arguments]) or 0)
    except SystemExit as end:
        return int(end.code or 0)


@pytest.mark.long
def test_json_pictures_and_files(bag: Path, tmp_path: Path, capfd: Any) -> None:
    assert run("identify", "keystroke", bag, "--iterations", 0, "--json", "-o", tmp_path / "k") == 0
    found = json.loads(capfd.readouterr().out)
    names = [e["name"] for e in found["estimates"]]
    assert names[:2] == ["stiffness", "damping"]
    assert Path(found["pictures"][0]).stat().st_size > 10_000
    assert (tmp_path / "k" / "result.json").is_file()
    calibration = tmp_path / "stiffness.yaml"
    assert (
        run("identify", "vacuum", bag, "--write-calibration", calibration, "-o", tmp_path / "v")
        == 0
    )
    assert calibration.is_file() and "N*m/rad" in capfd.readouterr().out
    assert run("identify", "parameters", bag, "--names", "joint_stiffness", "--json") == 0
    assert json.loads(capfd.readouterr().out)["estimates"][0]["name"] == "joint_stiffness -100 kPa"


def test_a_ratio_has_no_unit(bag: Path, capfd: Any) -> None:
    assert run("identify", "keystroke", bag, "--iterations", 0) == 0
    told = [line.split() for line in capfd.readouterr().out.splitlines()]
    assert [w[2] for w in told if w and w[0] in ("stiffness", "damping_ratio")] == ["N*m/rad", "95"]


@pytest.mark.long
def test_a_search_that_is_resumed_equals_one_that_was_not(
    bag: Path, tmp_path: Path, capfd: Any
) -> None:
    def search(*more: object) -> dict[str, Any]:
        assert run("optimize", "stiffness", bag, "--pressure", 0, "--seed", 2, "--json", *more) == 0
        return dict(json.loads(capfd.readouterr().out))

    whole = search("--iterations", 10, "-o", tmp_path / "s")
    state = tmp_path / "state.json"
    search("--iterations", 7, "--resume", state)
    assert search("--iterations", 10, "--resume", state)["history"] == whole["history"]
    assert (tmp_path / "s" / "stiffness.png").is_file()


def test_dynamics_become_a_phrase(tmp_path: Path, capfd: Any) -> None:
    from pianobot_ros.cell.score import load_score

    phrase = tmp_path / "loud.yaml"
    assert (
        run("optimize", "dynamics", "--scale", 2, "--phrase", phrase, "--json", "-o", tmp_path) == 0
    )
    strikes = json.loads(capfd.readouterr().out)["strikes"]
    assert [s["wanted"]["velocity"] for s in strikes] == [20, 100]
    played = load_score(phrase).strikes
    assert np.allclose(
        [s.motion.speed for s in played], [s["motion"]["speed"] for s in strikes], atol=1e-5
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("identify", "keystroke", "/nowhere.csv"), "cannot read"),
        (("identify", "vacuum", "/nowhere"), "does not exist"),
        (("optimize", "stiffness", "/nowhere.mid"), "not"),
        (("optimize", "stiffness", "x.yaml", "--lambda1", "2"), "--lambda1"),
        (("optimize", "dynamics"), "either a MIDI file or --scale"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: tuple[str, ...], words: str, capfd: Any
) -> None:
    assert run(*arguments) == 2
    out, error = capfd.readouterr()
    assert words in error and error.count("\n") == 1 and not out
