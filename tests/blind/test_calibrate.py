"""What the calibration learns from tables of probabilities."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.calibrate import EVENTS, SERIES, View, conformal, is_better, learn, left_out
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.gap.posterior.verdict import credible_set, level_of
from pianobot_ros.gap.problem.options import Calibration
from pianobot_ros.piano_twin.diagnosis import settings

POINTS = [f"{s:g} {e:g}" for s in SERIES for e in EVENTS]


def view(cell: str, masses: dict[str, float], *names: str, any_of: bool = False) -> View:
    return View(cell, any_of, names, dict.fromkeys(POINTS, masses))


def test_a_set_that_holds_more_than_is_needed_holds_the_truth():
    masses = {"hammer": 0.5, "let_off": 0.3, "unknown": 0.15, "none": 0.05}
    for truth in masses:
        first, needed = view("a", masses, truth).needed(POINTS[0])
        assert first == "hammer"
        names, probabilities = list(masses), list(masses.values())
        assert truth in credible_set(names, probabilities, needed + 1e-6)
        if needed > 0:
            assert truth not in credible_set(names, probabilities, needed - 1e-6)


def test_both_of_two_must_be_held_and_of_relatives_one():
    masses = {"hammer": 0.5, "let_off": 0.3, "unknown": 0.2}
    assert view("a", masses, "hammer", "let_off").needed(POINTS[0])[1] == pytest.approx(0.5)
    relatives = view("a", masses, "unknown", "let_off", any_of=True)
    assert relatives.needed(POINTS[0])[1] == pytest.approx(0.5)


def test_temperature_goes_with_how_often_the_first_answer_is_right():
    sure, unsure = {"hammer": 0.99, "let_off": 0.01}, {"hammer": 0.6, "let_off": 0.4}
    tables = dict.fromkeys(POINTS, unsure) | {POINTS[0]: sure}
    right = [View(f"r{i}", False, ("hammer",), tables) for i in range(6)]
    wrong = [View(f"w{i}", False, ("let_off",), tables) for i in range(4)]
    assert learn(right)["temperature"] == SERIES[0]
    assert learn([*right, *wrong])["reached"]["mean log loss"] == pytest.approx(0.673, abs=1e-3)


def test_a_cell_that_is_left_out_is_judged_by_what_the_others_prefer():
    loss = np.array([[9.0, 1.0], [9.0, 1.0], [0.1, 1.0], [0.1, 1.0]])
    assert left_out(loss, ["a", "a", "b", "c"]).tolist() == [9.0, 9.0, 1.0, 1.0]


@pytest.mark.parametrize(("left", "better"), [(0.69, False), (0.67, False), (0.6, True)])
def test_a_gain_within_its_standard_error_is_none(left, better):
    reached = {
        "mean log loss before": 0.68,
        "mean log loss, each cell left out": left,
        "standard error of the last two's difference": 0.02,
    }
    assert is_better(reached) == better


def test_few_cells_cannot_promise_and_many_can():
    assert conformal([0.0] * 18) == 0.999
    assert conformal([0.0] * 19) == pytest.approx(0.001)
    assert conformal([*[0.2] * 38, 0.9]) == pytest.approx(0.201)


def test_a_level_of_its_own_for_every_group_of_answers():
    calibration = Calibration(levels={"effect": 0.9, "quiet": 0.97})
    assert level_of(calibration, "hammer") == 0.9
    assert level_of(calibration, "parameters") == 0.97
    assert level_of(calibration, "unknown") == 0.95


def test_a_file_without_what_was_learned_is_refused(tmp_path, monkeypatch):
    folder = tmp_path / "calibration"
    folder.mkdir()
    (folder / "diagnosis.yaml").write_text("temperature: hot\n", encoding="utf-8")
    monkeypatch.setattr(settings, "config_dir", lambda: tmp_path)
    settings.options.cache_clear()
    with pytest.raises(ConfigError, match=r"diagnosis.yaml: temperature: .* valid number"):
        settings.options()
    settings.options.cache_clear()
