"""What the calibration learns from the answers to known cells."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "benchmarks"))

from calibration.learning import conformal, fit, gain_of, learn, learn_scalings
from calibration.piano_cells import refuse_held_back
from calibration.views import AS_SET, FACTORS, View, answer, answer_by

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.numbers import learned as learned_file
from pianobot_ros.gap import Calibration, Scaling
from pianobot_ros.gap.posterior.table import Table
from pianobot_ros.gap.posterior.verdict import credible_set, level_of
from pianobot_ros.piano.gap.diagnosis import settings


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


def view(cell: int, probability: float, truth: str) -> View:
    """A cell of which "hammer" is said with that probability, and *unknown* else."""
    weight = np.array([probability])
    table = Table((("hammer",),), weight, 1.0 - probability, {}, ("hammer",))
    return View(f"c{cell}", (truth,), False, table)


def test_answers_that_are_always_right_are_given_more_surely_and_wrong_ones_less():
    given = [0.7 + 0.01 * i for i in range(25)]
    right = [view(i, p, "hammer") for i, p in enumerate(given)]
    wrong = [view(i, p, "unknown") for i, p in enumerate(given)]
    surer, less = fit(right), fit(wrong)
    for p, r, w in zip(given, right, wrong, strict=True):
        assert answer(r, surer).truth > p
        assert answer(w, less).truth > 1.0 - p
    learned = learn_scalings(right)
    assert set(learned.scaling) == {"effect"}  # no other group has enough


@pytest.mark.long
def test_how_sure_to_be_is_learned_from_how_often_it_was_right():
    views = [view(i, 0.94, "hammer" if i % 4 else "unknown") for i in range(200)]
    learned = answer(views[0], fit(views))
    assert learned.probability == pytest.approx(0.75, abs=0.02)
    reached = learn_scalings(views).reached
    assert reached is not None
    assert reached.each_cell_left_out.expected_calibration_error < 0.03
    assert reached.before.expected_calibration_error == pytest.approx(0.19, abs=0.01)


def test_what_few_cells_tell_stays_near_what_the_scores_say():
    few = [view(i, 0.6, "hammer" if i % 5 < 3 else "unknown") for i in range(20)]
    assert answer(few[0], fit(few)).probability == pytest.approx(0.6, abs=0.03)
    assert learn_scalings(few).scaling == {}


@pytest.mark.long
def test_a_temperature_is_learned_where_it_predicts_cells_left_out():
    as_set = [view(i, 0.9, "hammer" if i % 5 < 3 else "unknown") for i in range(100)]
    cooler = [view(i, 0.6, "hammer" if i % 5 < 3 else "unknown") for i in range(100)]
    by_factors = {f: cooler if f[1] > 1.0 else as_set for f in FACTORS}
    learned = learn(by_factors, Calibration(temperature=10.0, event_temperature=4.0))
    assert learned.temperatures == {"series": 10.0, "event": 8.0}
    assert learned.reached is not None
    assert learned.reached.temperatures is not None
    assert learned.reached.temperatures.gain > 0.1
    same = learn(dict.fromkeys(FACTORS, as_set), Calibration())
    assert same.temperatures == {}
    assert learned.reached.views == len(by_factors[AS_SET])


def test_views_of_one_cell_count_as_one():
    gain = np.array([1.0, 1.0, -1.0, -1.0])
    apart = gain_of(gain, np.array(["a", "b", "c", "d"]))
    together = gain_of(gain, np.array(["a", "a", "b", "b"]))
    assert apart[0] == together[0] == 0.0
    assert together[1] > apart[1]


def test_few_cells_cannot_promise_and_many_can():
    assert conformal([0.9] * 18) == 0.95
    assert conformal([0.2] * 30 + [1.0] * 10) == 0.95, "no set holds what has no probability"
    assert conformal([0.97] * 19) == pytest.approx(0.971)
    assert conformal([*[0.96] * 38, 0.99]) == pytest.approx(0.961)
    assert conformal([*[0.2] * 38, 0.9]) == 0.95, "calibration never asks for less than is promised"


def test_a_level_of_its_own_for_every_group_of_answers():
    calibration = Calibration(levels={"effect": 0.9, "quiet": 0.97})
    assert level_of(calibration, "hammer") == 0.9
    assert level_of(calibration, "parameters") == 0.97
    assert level_of(calibration, "unknown") == 0.95


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scaling: {effect: {power: hot}}\nlevels: {}\n", r"power: .* valid number"),
        ("scaling: {effect: {heat: 3}}\nlevels: {}\n", r"heat"),
        ("scaling: {cause: {power: 1}}\nlevels: {}\n", r"effect.*unknown.*quiet"),
        ("levels: {effect: 1.5}\n", r"levels.effect: .* less than 1"),
    ],
)
def test_a_file_without_what_was_learned_is_refused(tmp_path, monkeypatch, text, said):
    folder = tmp_path / "calibration"
    folder.mkdir()
    (folder / "diagnosis.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(learned_file, "config_dir", lambda: tmp_path)
    settings.options.cache_clear()
    with pytest.raises(ConfigError, match=said):
        settings.options()
    settings.options.cache_clear()


def test_what_was_learned_replaces_what_is_set(tmp_path, monkeypatch):
    folder = tmp_path / "calibration"
    folder.mkdir()
    text = "temperatures: {event: 6.0}\nscaling: {effect: {unknown: 0.5}}\nlevels: {effect: 0.97}\n"
    (folder / "diagnosis.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(learned_file, "config_dir", lambda: tmp_path)
    settings.options.cache_clear()
    found = settings.options().calibration
    settings.options.cache_clear()
    assert found.scaling == {"effect": Scaling(unknown=0.5)}
    assert found.levels == {"effect": 0.97}
    assert found.event_temperature == 6.0
    assert found.temperature == settings.prior_options().calibration.temperature
