"""The demo's last part on a recorded bag: the answer stays closed until the verdict is there."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pianobot_ros.cell.score import load_score
from pianobot_ros.cli.demo import demonstration, requests, summary
from pianobot_ros.emulator.plant.cases.draw import draw_case


def test_what_is_hidden_is_strong_enough_and_drawn_by_the_seed(tmp_path: Path) -> None:
    words = demonstration.hidden_effect(7, tmp_path)
    assert words[words.index("--seed") + 1] == "7"
    cases = [draw_case(seed, "effect", magnitude=demonstration.MAGNITUDE) for seed in range(30)]
    assert all(3.0 <= m <= 10.0 for case in cases for m in case.effects.values())
    assert len({name for case in cases for name in case.effects}) > 8
    assert draw_case(7, "effect", magnitude=demonstration.MAGNITUDE) == cases[7]


def test_the_phrase_gives_a_diagnosis_enough_to_go_by() -> None:
    strikes = load_score(demonstration.PHRASE).strikes
    conditions = [s.condition for s in strikes]
    assert len(strikes) >= 20
    assert all(conditions.count(c) >= 3 for c in conditions)
    assert {s.notes for s in strikes} == {(64,)}, "the key with the force sensor"


def test_the_answer_is_opened_after_the_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stands in for the graph alone: when it is asked there is no answer that it could read."""
    answer = tmp_path / demonstration.ANSWER

    def diagnose(_: Any, bag: Path, output: Path) -> dict[str, Any]:
        assert (bag, output) == (tmp_path / "bag", tmp_path / "diagnosis")
        assert not answer.exists()
        answer.write_text(json.dumps({"effects": {"hammer": 4.0}}), encoding="utf-8")
        likely = {"hammer": 0.9, "let_off": 0.1}
        return {
            "verdict": "effect",
            "sentence": "Missing effect: hammer.",
            "credible_set": ["hammer"],
            "candidates": [{"name": n, "probability": p} for n, p in likely.items()],
        }

    monkeypatch.setattr(requests, "diagnose", diagnose)
    cell: Any = SimpleNamespace(tell=lambda _: None)
    found = demonstration._diagnose(cell, tmp_path, 7)
    assert found["hit"]
    assert found["inside"]
    assert found["answer"] == ["hammer"]
    assert found["report"] == str(tmp_path / "diagnosis" / "report.html")
    text = summary.markdown(
        {
            "strikes": 0,
            "both_sounded": 0,
            "midi": "",
            "failures": [],
            "seconds": 1.0,
            "run": "x",
            "diagnosis": found,
        },
        [],
    )
    assert text.index("Missing effect") < text.index("the answer") < text.index("named first")
