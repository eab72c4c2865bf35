"""What a verdict adopts, what an overlay refuses, and that its text is the whole of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cli.app import main
from pianobot_ros.piano.gap.adoption.adopt import adoption, corrections_of
from pianobot_ros.piano.gap.adoption.export_corrected import export_corrected
from pianobot_ros.piano.gap.simulation.corrections import (
    Correction,
    Corrections,
    cell_id,
    parse_corrections,
)


def document(verdict: str = "effect", **changes: Any) -> dict[str, Any]:
    """A diagnosis as diagnosis.json has it."""

    def number(value: float, unit: str = "1") -> dict[str, Any]:
        return {"value": value, "low": 0.9 * value, "high": 1.1 * value, "unit": unit}

    friction = {
        "joint_friction": number(0.03, "N*m"),
        "joint_friction_static": number(0.1),
        "joint_friction_rest": number(0.2),
    }
    found = {"name": "joint_friction", "stage": "hand", "probability": 0.9}
    return {
        "verdict": verdict,
        "sentence": "dry friction in the finger's joints",
        "effects": [found | {"parameters": friction}] if verdict == "effect" else [],
        "parameters": {"joint_stiffness": number(1.2), "wrist_stamp": number(1e-3, "s")},
        "gap": {"before": 4.0, "refit": 2.0, "after": 1.0},
        "inseparable": [["joint_friction", "tip_slip"]],
        "unknown": {"text": "force against speed"} if verdict == "unknown" else None,
        "provenance": {"cell": cell_id(), "recordings": ["bag"], "strikes": 40},
    } | changes


def test_an_effect_is_adopted_with_its_parameters_and_comes_back_from_its_text() -> None:
    found = adoption(document()).corrections
    assert found.values() == {
        "joint_stiffness": 1.2,
        "joint_friction": 0.03,
        "joint_friction_static": 0.1,
        # not in the diagnosis, which may be older than these: nominal
        "joint_friction_breakaway": 0.003,
        "joint_friction_creep": 0.0,
    }
    assert found.source["recordings"] == ["bag"]
    assert found.open == ("cannot be told apart: joint_friction, tip_slip",)
    again = parse_corrections(found.to_yaml())
    assert again == found
    assert again.identity == found.identity


def test_none_and_an_unknown_that_refitting_does_not_shrink_adopt_nothing() -> None:
    assert not adoption(document("none")).corrections
    gap = {"before": 4.0, "refit": 3.95, "after": 3.9}
    assert not adoption(document("unknown", gap=gap)).corrections


def test_unknown_adopts_parameters_that_help_and_says_what_stays_open() -> None:
    found = adoption(document("unknown"))
    assert set(found.corrections.values()) == {"joint_stiffness"}
    assert "force against speed" in found.corrections.open[0]
    assert "force against speed" in found.sentence


@pytest.mark.parametrize("verdict", ["effect", "parameters", "unknown"])
@pytest.mark.parametrize("measure", ["gap", "err"])
def test_nothing_is_adopted_that_makes_held_out_strikes_worse(verdict: str, measure: str) -> None:
    good = {"before": 0.05, "after": 0.02, "low": -0.04, "high": -0.01}
    bad = {"before": 0.05, "after": 0.07, "low": 0.005, "high": 0.03}
    unsure = bad | {"low": -0.005}
    for own, adopted in ((bad, False), (unsure, True)):
        measures = {"gap": good, "err": good} | {measure: own}
        found = adoption(document(verdict, adopting=measures))
        assert bool(found.corrections) == adopted
    assert "not fitted" in adoption(document(verdict, adopting={measure: bad})).sentence


def test_an_effect_that_was_adopted_before_goes_back_to_its_family() -> None:
    own = document("parameters")
    own["parameters"]["key_friction"] = {"value": 0.01, "unit": "N*m"}
    own["provenance"]["adopted"] = "abc"
    found = adoption(own).corrections
    assert found.effects["key_friction"]["key_friction"].value == 0.01
    assert found.follows == "abc"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("value: 1.2,", "value: 7,", "from 0.4 to 2.5"),
        ("value: 1.2,", "value: true,", "no number"),
        ("joint_stiffness", "joint_stifness", "did you mean 'joint_stiffness'"),
        ("joint_friction:\n", "joint_fiction:\n", "unknown effect"),
        ("unit: N*m", "unit: mN*m", "must be in 'N*m'"),
        ("kind: corrections of the twin", "kind: cell", "no overlay"),
        (f"cell: {cell_id()}", "cell: 0123456789ab", "another cell"),
    ],
)
def test_a_wrong_overlay_is_refused_in_one_line(old: str, new: str, said: str) -> None:
    text = adoption(document()).corrections.to_yaml()
    assert old in text
    with pytest.raises(ConfigError) as refused:
        parse_corrections(text.replace(old, new, 1))
    assert said in str(refused.value) and "\n" not in str(refused.value)


def test_a_request_that_names_nothing_adopts_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not even the diagnosis that lies where the twin was started."""
    (tmp_path / "diagnosis.json").write_text(json.dumps(document()), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for text in ("", " ", "\n"):
        with pytest.raises(ConfigError, match="nothing is given to adopt"):
            corrections_of(text)


def test_command_writes_once_and_refuses_to_write_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "diagnosis.json").write_text(json.dumps(document()), encoding="utf-8")
    assert main(["adopt", str(tmp_path)]) == 0
    path = tmp_path / "corrections.yaml"
    text = path.read_text(encoding="utf-8")
    assert corrections_of(str(path)).values() == adoption(document()).corrections.values()
    capsys.readouterr()
    assert main(["adopt", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "adopted before" in error and len(error.splitlines()) == 1
    assert path.read_text(encoding="utf-8") == text


def test_a_run_has_its_diagnosis_in_a_folder(tmp_path: Path) -> None:
    """The demo ends with "everything is in runs/…", which is what a user then gives."""
    folder = tmp_path / "diagnosis"
    folder.mkdir()
    (folder / "diagnosis.json").write_text(json.dumps(document()), encoding="utf-8")
    assert main(["adopt", str(tmp_path)]) == 0
    assert [p.name for p in tmp_path.iterdir()] == ["diagnosis"]
    assert corrections_of(str(tmp_path)) and (folder / "corrections.yaml").exists()


def test_what_is_not_there_is_told_with_what_to_give(tmp_path, capsys):
    assert main(["adopt", str(tmp_path)]) == 2
    assert "give a diagnosis.json, or the folder that has it" in capsys.readouterr().err


def test_command_refuses_the_diagnosis_of_another_cell(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = document()
    other["provenance"]["cell"] = "0123456789ab"
    (tmp_path / "diagnosis.json").write_text(json.dumps(other), encoding="utf-8")
    assert main(["adopt", str(tmp_path)]) == 2
    assert "another cell" in capsys.readouterr().err
    assert not (tmp_path / "corrections.yaml").exists()


def test_what_an_exported_model_lacks_is_told_with_units_where_there_are_any(
    tmp_path: Path,
) -> None:
    number = {"value": 0.17, "low": 0.1, "high": 0.2}
    sensor = {
        "fsr_hysteresis": number | {"unit": "1"},
        "fsr_hysteresis_from": number | {"unit": "N"},
    }
    found = {"name": "fsr_hysteresis", "parameters": sensor}
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(document(effects=[found])), encoding="utf-8")
    left = export_corrected(tmp_path / "twin.xml", path)
    assert "fsr_hysteresis.fsr_hysteresis = 0.17 (sensing)" in left
    assert "fsr_hysteresis.fsr_hysteresis_from = 0.17 N (sensing)" in left


def test_names_have_units_where_there_are_any() -> None:
    own = {"level": Correction(0.25, unit="N*m"), "share": Correction(-0.0079)}
    said = Corrections({"joint_stiffness": Correction(1.2)}, {"drag": own}).names()
    assert said == ["joint_stiffness=1.2", "drag (level=0.25 N*m, share=-0.0079)"]
