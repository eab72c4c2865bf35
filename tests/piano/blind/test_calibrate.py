"""What the calibration learns from the answers to known cells."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from benchmarks.calibrate import (
    TRIED,
    Answer,
    Point,
    View,
    answer_by,
    conformal,
    descend,
    is_better,
    learn,
    neighbours,
    refuse_held_back,
)
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.gap.posterior.verdict import credible_set, level_of
from pianobot_ros.gap.problem.options import Calibration
from pianobot_ros.piano.gap.diagnosis import settings

START: dict[str, float] = {n: getattr(settings.prior_options().calibration, n) for n in TRIED}


def test_the_held_back_law_teaches_nothing():
    refuse_held_back((0, 1, 2))
    with pytest.raises(SystemExit, match="law 3 of the plant is held back"):
        refuse_held_back((2, 3))


def test_a_set_that_holds_more_than_is_needed_holds_the_truth():
    masses = {"hammer": 0.5, "let_off": 0.3, "unknown": 0.15, "none": 0.05}
    for truth in masses:
        given = answer_by(masses, [truth], any_of=False)
        assert given.first == "hammer"
        names, probabilities = list(masses), list(masses.values())
        assert truth in credible_set(names, probabilities, given.before + 1e-6)
        if given.before > 0:
            assert truth not in credible_set(names, probabilities, given.before - 1e-6)


def test_both_of_two_must_be_held_and_of_relatives_one():
    masses = {"hammer": 0.5, "let_off": 0.3, "unknown": 0.2}
    both = answer_by(masses, ["hammer", "let_off"], any_of=False)
    assert both.before == pytest.approx(0.5)
    one = answer_by(masses, ["unknown", "let_off"], any_of=True)
    assert one.before == pytest.approx(0.5)


def test_what_is_set_is_among_what_is_tried():
    for name, values in TRIED.items():
        assert START[name] in values
        assert list(values) == sorted(values)
    around = neighbours(START)
    assert all(sum(p[n] != START[n] for n in TRIED) == 1 for p in around)


def answers(probability: dict[str, float], right: list[str]) -> Any:
    """How answers would be if only `temperature` mattered: the colder, the surer."""

    def ask(view: View, point: Point) -> Answer:
        p = probability[view.cell] ** (START["temperature"] / point["temperature"])
        is_right = view.cell in right
        return Answer("hammer", p, is_right, p if is_right else 1 - p, 0.0 if is_right else p)

    return ask


def cells(number: int) -> list[View]:
    return [View(f"c{i}", ("hammer",), False, cast("Any", None)) for i in range(number)]


def test_answers_that_are_always_right_are_given_more_surely_and_wrong_ones_less():
    views = cells(20)
    given = {v.cell: 0.7 + 0.01 * i for i, v in enumerate(views)}
    every = learn(views, answers(given, [v.cell for v in views]))
    assert every["constants"] == {"temperature": max(TRIED["temperature"])}
    assert every["reached"]["each cell left out"] == every["reached"]["on these cells"] | {
        "covered": 1.0
    }
    assert is_better(every["reached"])
    none = learn(views, answers(given, []))
    assert none["constants"] == {"temperature": min(TRIED["temperature"])}


def test_what_the_cells_do_not_determine_stays_as_it_is():
    rng = np.random.default_rng(5)
    views = cells(20)
    given = {v.cell: 0.6 for v in views}
    right = [v.cell for v in views if rng.random() < 0.6]
    learned = learn(views, answers(given, right))
    assert learned["constants"] == {}
    assert not is_better(learned["reached"])


def test_views_of_one_cell_count_as_one():
    def losses(point: Point) -> np.ndarray:
        better = point["temperature"] > START["temperature"]
        return np.array([0.0 if better else 5.0, 0.0 if better else 5.0, 1.1 if better else 1.0])

    def found(names: list[str]) -> Point:
        return descend(losses, START, np.array(names), np.ones(3, dtype=bool))

    assert found(["a", "b", "c"])["temperature"] > START["temperature"]
    assert found(["a", "a", "c"]) == START


def test_few_cells_cannot_promise_and_many_can():
    assert conformal([0.0] * 18) == 0.999
    assert conformal([0.0] * 19) == pytest.approx(0.001)
    assert conformal([*[0.2] * 38, 0.9]) == pytest.approx(0.201)


def test_a_level_of_its_own_for_every_group_of_answers():
    calibration = Calibration(levels={"effect": 0.9, "quiet": 0.97})
    assert level_of(calibration, "hammer") == 0.9
    assert level_of(calibration, "parameters") == 0.97
    assert level_of(calibration, "unknown") == 0.95


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("constants: {temperature: hot}\nlevels: {}\n", r"temperature: .* valid number"),
        ("constants: {heat: 3}\nlevels: {}\n", r"heat.* no constant of the diagnosis"),
        ("levels: {effect: 1.5}\n", r"levels.effect: .* less than 1"),
    ],
)
def test_a_file_without_what_was_learned_is_refused(tmp_path, monkeypatch, text, said):
    folder = tmp_path / "calibration"
    folder.mkdir()
    (folder / "diagnosis.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(settings, "config_dir", lambda: tmp_path)
    settings.options.cache_clear()
    with pytest.raises(ConfigError, match=said):
        settings.options()
    settings.options.cache_clear()


def test_constants_that_were_learned_replace_those_that_are_set(tmp_path, monkeypatch):
    folder = tmp_path / "calibration"
    folder.mkdir()
    text = "constants: {mimic: 0.09}\nlevels: {effect: 0.97}\n"
    (folder / "diagnosis.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(settings, "config_dir", lambda: tmp_path)
    settings.options.cache_clear()
    found = settings.options().calibration
    settings.options.cache_clear()
    assert (found.mimic, found.levels) == (0.09, {"effect": 0.97})
    assert found.temperature == settings.prior_options().calibration.temperature
