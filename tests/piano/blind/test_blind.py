"""The blind check from the command line: what is written, what is hidden, and that tampering is
noticed.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.score import read_phrase
from pianobot_ros.cli.analysis.diagnosis import register
from pianobot_ros.piano.blind.make import (
    SHARES,
    WITHHELD,
    Design,
    _deal,
    _Drawn,
    _withhold,
    make_cases,
)
from pianobot_ros.piano.blind.reliability import bins_of, calibration_error, chance_error, to_svg
from pianobot_ros.piano.blind.scorecard import Scorecard, score_cases

pytestmark = pytest.mark.slow

app = typer.Typer()
register(app)


def run(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def answer(kind: str, **effects: float) -> dict[str, object]:
    return {"kind": kind, "effects": effects, "stages": ["key"] * len(effects), "parameters": {}}


@pytest.mark.long
def test_make_diagnose_score(tmp_path: Path) -> None:
    cases, answers = tmp_path / "cases", tmp_path / "answers.json"
    run(
        "blind",
        "make",
        str(cases),
        "--answers",
        str(answers),
        "--cases",
        "2",
        "--seed",
        "5",
        "--strikes",
        "8",
    )
    secret = json.loads(answers.read_text())
    for path in cases.rglob("*"):
        if path.is_file() and path.suffix in (".json", ".yaml"):
            text = path.read_text()
            assert secret["salt"] not in text
            for case in secret["cases"].values():
                assert not any(f'"{name}"' in text for name in case["effects"])
    hidden = answers.rename(tmp_path / "hidden.json")  # the diagnosis cannot look
    how = ("--jobs", "1", "--backend", "threading", "--budget", "1000")
    run("blind", "diagnose", str(cases), *how, "--json")
    printed = json.loads(run("blind", "score", str(cases), "--answers", str(hidden), "--json"))
    assert sum(n for row in printed["confusion"].values() for n in row.values()) == 2
    hidden.write_text(hidden.read_text().replace("case000", "case001", 1))
    with pytest.raises(ConfigError, match="SHA-256"):
        score_cases(cases, hidden)


def test_same_seed_same_answers_and_no_answers_among_the_cases(tmp_path: Path) -> None:
    for name in ("a", "b"):
        make_cases(tmp_path / name, tmp_path / f"{name}.json", Design(cases=1, seed=9, strikes=8))
    a, b = (json.loads((tmp_path / f"{n}.json").read_text()) for n in ("a", "b"))
    assert a["cases"] == b["cases"] and a["salt"] != b["salt"]
    with pytest.raises(ConfigError, match="not lie in the folder"):
        make_cases(tmp_path / "c", tmp_path / "c" / "answers.json", Design(cases=1))
    with pytest.raises(ConfigError, match="not empty"):
        make_cases(tmp_path / "a", tmp_path / "d.json", Design(cases=1))


def test_kinds_are_dealt_in_their_shares() -> None:
    import numpy as np

    kinds = _deal(120, np.random.default_rng(0))
    assert {k: kinds.count(k) for k in SHARES} == {
        k: pytest.approx(120 * s, abs=1) for k, s in SHARES.items()
    }
    assert len(_deal(7, np.random.default_rng(0))) == 7


def test_figures_of_made_up_results(tmp_path: Path) -> None:
    """Four cases whose figures are known: right, wrong but inseparable, a false alarm, and an
    unknown.
    """
    cases = tmp_path / "cases"
    (cases / "results").mkdir(parents=True)
    hidden = {
        "a": answer("effect", key_friction=5.0),
        "b": answer("effect", key_preload=2.0),
        "c": answer("none"),
        "d": answer("unknown", magnetic_snap=4.0),
    }
    answers = tmp_path / "answers.json"
    answers.write_text(json.dumps({"cases": hidden}))
    manifest = {
        "cases": list(hidden),
        "commitment": hashlib.sha256(answers.read_bytes()).hexdigest(),
    }
    (cases / "manifest.json").write_text(json.dumps(manifest))

    def result(verdict: str, name: str, p: float, **more: object) -> dict[str, object]:
        gap = {"floor": 1.0, "before": 3.0, "refit": 2.0, "after": 1.2, "closed": 0.9}
        effects = (
            [{"name": name, "stage": "key", "probability": p, "parameters": {}}]
            if verdict == "effect"
            else []
        )
        return {
            "verdict": verdict,
            "effects": effects,
            "candidates": [{"name": name, "stage": "key", "probability": p}],
            "credible_set": [name],
            "inseparable": [],
            "gap": gap,
            "runtime_s": 10.0,
        } | more

    found = {
        "a": result(
            "effect", "key_friction", 0.99, criteria={"aic": "let_off", "bic": "key_friction"}
        ),
        "b": result("effect", "key_friction", 0.7, inseparable=[["key_friction", "key_preload"]]),
        "c": result("effect", "hammer", 0.8),
        "d": result("unknown", "unknown", 0.95),
    }
    for name, document in found.items():
        (cases / "results" / f"{name}.json").write_text(json.dumps(document))
    score = score_cases(cases, answers)
    value = {f.name: f.value for f in score.figures}
    assert value["right effect first, gap ≥ 3 × floor"] == 1.0
    assert value["right effect first, gap 1 to 3 × floor"] == 0.0
    assert value["right, or declared inseparable from it"] == 1.0
    assert value["none-cases called something"] == 1.0
    assert value["left-out effects called unknown"] == 1.0
    assert value["truth inside the 95 % credible set"] == 0.5
    assert value["right effect first by AIC on the same fits"] == 0.0
    assert value["right effect first by BIC on the same fits"] == 0.5
    assert value["the same by parameter fitting alone"] == 0.5
    assert value["mean size of that set"] == 1.0
    assert value["expected calibration error of the first answer"] == pytest.approx(
        (0.01 + 0.7 + 0.8 + 0.05) / 4, abs=0.02
    )
    assert score.confusion["key_preload"] == {"key_friction": 1}
    assert "key_preload → key_friction (1)" in score.to_text()


def scored(
    folder: Path, hidden: dict, answers: dict[str, str], without: dict[str, str]
) -> Scorecard:
    """Of cases with `hidden` causes, whose answers name "unknown" or effects joined by "+"."""
    cases = folder / "cases"
    (cases / "results").mkdir(parents=True)
    path = folder / "answers.json"
    path.write_text(json.dumps({"cases": hidden}))
    commitment = hashlib.sha256(path.read_bytes()).hexdigest()
    manifest = {"cases": list(hidden), "commitment": commitment, "without": without}
    (cases / "manifest.json").write_text(json.dumps(manifest))
    for name, verdict in answers.items():
        own = [{"name": n, "stage": "key", "probability": 0.95} for n in verdict.split("+")]
        document = {
            "verdict": "unknown" if verdict == "unknown" else "effect",
            "effects": [] if verdict == "unknown" else own,
            "candidates": own,
            "credible_set": verdict.split("+"),
        }
        (cases / "results" / f"{name}.json").write_text(json.dumps(document))
    return score_cases(cases, path)


def test_a_withheld_family_is_rightly_called_unknown_or_a_declared_relative(tmp_path: Path) -> None:
    score = scored(
        tmp_path,
        {n: answer("effect", wrist_delay=5.0) for n in "abcd"},
        {"a": "unknown", "b": "wrist_lag", "c": "hammer", "d": "wrist_lag"},
        dict.fromkeys("abc", "wrist_delay") | {"d": "hammer"},
    )
    figure = {f.name: f for f in score.figures}
    found = figure["withheld families called unknown or a declared relative"]
    assert found.value == pytest.approx(2 / 3) and found.cases == 3
    assert figure["withheld families called unknown"].value == pytest.approx(1 / 3)
    assert figure["right effect first, gap ≥ 3 × floor"].cases == 1  # the others are no such case
    assert figure["truth inside the 95 % credible set"].value == 0.5
    assert score.confusion["unknown"] == {"unknown": 1, "wrist_lag": 1, "hammer": 1}


def test_pairs_of_which_both_are_strong_are_told_apart(tmp_path: Path) -> None:
    sizes = {"a": (5.0, 4.0), "b": (5.0, 2.0), "c": (9.0, 3.0)}
    score = scored(
        tmp_path,
        {n: answer("two", hammer=x, let_off=y) for n, (x, y) in sizes.items()},
        {"a": "hammer+let_off", "b": "hammer", "c": "let_off"},
        {},
    )
    figure = {f.name: f for f in score.figures}
    both, strong = "both of two effects named", "… where each is of 3 floors and more"
    assert figure[both].value == pytest.approx(1 / 3) and figure[both].cases == 3
    assert figure[strong].value == 0.5 and figure[strong].cases == 2


def test_families_are_withheld_in_turn() -> None:
    from pianobot_ros.emulator.plant.cases.case import Case
    from pianobot_ros.piano.gap.effects import NAMES

    drawn = [_Drawn("", "effect", Case({NAMES[i % 27]: 2.0}), 0) for i in range(81)]
    drawn += [_Drawn("", "none", Case(), 0)] * 20
    without = _withhold(drawn, 4)
    assert without == _withhold(drawn, 4) != _withhold(drawn, 5)
    true = [w for w, d in zip(without, drawn, strict=True) if w in d.case.effects]
    assert len(true) == round(81 * WITHHELD) and set(true) == set(NAMES)
    other = [w for w, d in zip(without, drawn, strict=True) if w not in d.case.effects]
    assert set(other) == set(NAMES)


def test_reliability_of_known_answers() -> None:
    p, right = [0.95] * 4 + [0.55] * 4, [True] * 4 + [True, False] * 2
    assert calibration_error(p, right) == pytest.approx(0.05)
    assert [b.right for b in bins_of(p, right)] == [0.5, 1.0]
    drawing = to_svg(bins_of(p, right))
    assert drawing.count("<circle") == 2 and drawing.endswith("</svg>\n")


def test_chance_makes_an_error_too_and_the_less_the_more_cases() -> None:
    few, many = chance_error([0.7] * 40), chance_error([0.7] * 4000)
    assert few == pytest.approx(0.674 * (0.7 * 0.3 / 40) ** 0.5, rel=0.2)  # a normal's median size
    assert many == pytest.approx(few / 10, rel=0.2)
    assert chance_error([1.0] * 40) == 0.0


def test_a_library_lacks_what_it_is_told_to_lack() -> None:
    from pianobot_ros.piano.gap.diagnosis.relatives import RELATIVES, relatives_of
    from pianobot_ros.piano.gap.effects import NAMES, library_without

    assert [f.name for f in library_without(["hammer"])] == [n for n in NAMES if n != "hammer"]
    with pytest.raises(ConfigError, match="did you mean 'hammer'"):
        library_without(["hamer"])
    assert all(a in NAMES and b in NAMES and a != b for a, b in RELATIVES)
    assert relatives_of("wrist_lag") == {"wrist_delay"} and not relatives_of("let_off")


def test_next_experiment_is_a_phrase_that_can_be_played(tmp_path: Path) -> None:
    from pianobot_ros.piano.gap.diagnosis.proposals import phrase_of, write_phrase

    proposal = {
        "name": "proposal 1",
        "attributes": {
            "note": 64.0,
            "finger": 2.0,
            "speed": 0.12,
            "depth": 0.014,
            "hold": 0.8,
            "pressure": -50e3,
        },
        "separates": ["key_friction", "key_preload"],
    }
    score = read_phrase(write_phrase(phrase_of([proposal], repeats=3), tmp_path / "next.yaml"))
    assert len(score.strikes) == 3
    assert score.strikes[0].fingers == ("middle",) and score.strikes[0].notes == (64,)
    assert score.strikes[0].motion.hold == 0.8
