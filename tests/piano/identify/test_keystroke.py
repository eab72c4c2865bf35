"""Keystroke identification: known keys are found again, and what the data cannot say is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
from pianobot_ros.piano.identify.key.key_estimate import bounce_time, identify_keystroke
from pianobot_ros.piano.identify.key.key_fit import KeyFit
from pianobot_ros.piano.identify.key.load_test import (
    cut_presses,
    load_test_from_csv,
    load_test_from_recording,
)
from pianobot_ros.piano.twin.reduced.strike_geometry import key_model

Presses = tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, float]]


def test_a_key_simulated_elsewhere_is_found_again(write_csv: Any, presses: Presses) -> None:
    time, force, angle, truth = presses
    fit = identify_keystroke(
        load_test_from_csv(write_csv(time=time, force=force, angle=angle)), bayes_iterations=0
    )
    for name, value in truth.items():
        assert fit[name].value == pytest.approx(value, rel=0.03), name
        assert fit[name].low < fit[name].value < fit[name].high
    assert fit.rms < 3e-4
    assert fit.bounce_modelled == pytest.approx(fit.bounce_measured, abs=0.01)
    assert any("never reaches its stop" in w for w in fit.warnings)


def test_the_emulated_rig_shows_spring_damper_and_stop() -> None:
    errors = {"key_stiffness": 0.3, "key_damping": 0.2}
    record = simulate_cell(
        standard_strikes(2, 12, repeats=2), parameter_errors=errors, seed=4, encoder=True
    )
    fit = identify_keystroke(load_test_from_recording(record), bayes_iterations=0)
    key = key_model(64)
    assert fit["stiffness"].value == pytest.approx(1.3 * key.stiffness, rel=0.03)
    assert fit["damping"].value == pytest.approx(1.2 * key.damping, rel=0.1)
    assert fit["max_angle"].value == pytest.approx(key.max_angle, rel=0.01)
    assert fit["stop_stiffness"].value == pytest.approx(
        key.stop_stiffness / key.stop_radius**2, rel=0.05
    )


@pytest.mark.long
def test_the_papers_method_comes_near_and_repeats_with_its_seed(
    write_csv: Any, presses: Presses
) -> None:
    time, force, angle, truth = presses
    test = load_test_from_csv(write_csv(time=time[:1000], force=force[:1000], angle=angle[:1000]))
    one, two = (identify_keystroke(test, bayes_iterations=14, seed=3).bayes for _ in range(2))
    assert one == two
    assert 0.5 < one["stiffness"] / truth["stiffness"] < 2


def test_dead_weights_without_noise_are_no_saturation(write_csv: Any, swing: Any) -> None:
    time = np.arange(0.0, 2.0, 2e-3)
    force = np.where((time > 0.3) & (time < 1.2), 0.4, 0.0)
    angle = swing(time, force, 2.4, 0.02, 9e-4)
    fit = identify_keystroke(
        load_test_from_csv(write_csv(time=time, force=force, angle=angle)), bayes_iterations=0
    )
    assert fit["stiffness"].value == pytest.approx(2.4, rel=0.02)
    assert any("only one press" in w for w in fit.warnings)


def test_a_slow_release_leaves_inertia_unknown(write_csv: Any) -> None:
    time = np.arange(0.0, 8.0, 2e-3)
    force = 0.3 * (1 - np.cos(2 * np.pi * np.clip((time - 0.5) / 7, 0, 1)))
    angle = force * 0.195 / 2.4 + 5e-5 * np.random.default_rng(0).standard_normal(time.size)
    fit = identify_keystroke(
        load_test_from_csv(write_csv(time=time, force=force, angle=angle)), bayes_iterations=0
    )
    assert fit["stiffness"].value == pytest.approx(2.4, rel=0.02)
    assert not fit["inertia"].identified
    assert any("no release is abrupt" in w for w in fit.warnings)


def test_bounce_time_is_when_it_stays_small() -> None:
    angle = np.concatenate([np.ones(10), np.zeros(20), np.full(5, 0.2), np.zeros(50)])
    assert bounce_time(angle) == pytest.approx(0.035)


def test_a_force_delay_moves_the_angle_by_as_much(presses: Presses, write_csv: Any) -> None:
    time, force, angle, _ = presses
    (press, *_) = cut_presses(load_test_from_csv(write_csv(time=time, force=force, angle=angle)))
    model = KeyFit(key_model(64), 0.195)
    (now,), (later,) = model.angles({}, [press]), model.angles({"force_delay": 0.004}, [press])
    assert np.allclose(later[100:-10], now[104:-6], atol=1e-5)


class TestBadInput:
    def refused(self, path: Path, words: str) -> None:
        with pytest.raises(RecordingError, match=words) as caught:
            cut_presses(load_test_from_csv(path))
        assert "\n" not in str(caught.value) and str(path) in str(caught.value)

    def test_columns_numbers_and_length(
        self, write_csv: Any, presses: Presses, tmp_path: Path
    ) -> None:
        time, force, angle, _ = presses
        self.refused(
            write_csv("time,angle", time=time, angle=angle),
            "column force is missing; found time, angle",
        )
        broken = force.copy()
        broken[700] = np.nan
        self.refused(write_csv(time=time, force=broken, angle=angle), "force holds NaN")
        self.refused(write_csv(time=time[:20], force=force[:20], angle=angle[:20]), "at least 50")
        path = tmp_path / "words.csv"
        path.write_text("time,force,angle\n0,one,0\n")
        self.refused(path, "line 2")

    def test_a_clock_that_jumps_back(self, write_csv: Any, presses: Presses) -> None:
        time, force, angle, _ = presses
        jumped = time.copy()
        jumped[1500:] -= 0.5
        self.refused(
            write_csv(time=jumped, force=force, angle=angle), "the clock jumps back after 2.998"
        )

    def test_no_release(self, write_csv: Any, presses: Presses) -> None:
        time, force, angle, _ = presses
        self.refused(
            write_csv(time=time[:750], force=force[:750], angle=angle[:750]), "without a release"
        )

    def test_overlapping_presses(self, write_csv: Any, presses: Presses) -> None:
        time, force, angle, _ = presses
        cut = (time < 0.58) | (time > 1.25)  # the second press begins before the key is back
        count = int(cut.sum())
        self.refused(
            write_csv(
                time=time[:count],
                force=np.where(np.arange(count) % 290 < 40, 0, force[cut]),
                angle=angle[cut] + 0.02,
            ),
            "overlap",
        )

    @pytest.mark.parametrize("level", [0.25, 0.35])
    def test_a_saturated_sensor(self, write_csv: Any, presses: Presses, level: float) -> None:
        time, force, angle, _ = presses
        self.refused(
            write_csv(time=time, force=np.minimum(force, level), angle=angle), "saturated at"
        )

    def test_a_key_that_does_not_move(self, write_csv: Any, presses: Presses) -> None:
        time, force, angle, _ = presses
        self.refused(write_csv(time=time, force=force, angle=0 * angle), "does not move")


class TestForceGain:
    def misread(self, write_csv: Any, presses: Presses) -> Any:
        """A file whose forces are 15 % too large, what is identified from it, and the truth."""
        time, force, angle, truth = presses
        path = write_csv(time=time, force=1.15 * force, angle=angle)
        return path, identify_keystroke(load_test_from_csv(path), bayes_iterations=0), truth

    def test_a_gain_that_is_off_moves_values_but_stays_in_the_interval(
        self, write_csv: Any, presses: Presses
    ) -> None:
        path, fit, truth = self.misread(write_csv, presses)
        for name in ("stiffness", "damping", "inertia"):
            assert fit[name].value == pytest.approx(1.15 * truth[name], rel=0.03), name
            assert fit[name].low < truth[name] < fit[name].high, name
        assert any("gain" in w for w in fit.warnings)
        sure = identify_keystroke(load_test_from_csv(path), force_error=0.0, bayes_iterations=0)
        assert sure["stiffness"].low > truth["stiffness"]
        assert not any("gain" in w for w in sure.warnings)

    def test_what_the_gain_does_not_touch_stays_sharp(
        self, write_csv: Any, presses: Presses
    ) -> None:
        _, fit, truth = self.misread(write_csv, presses)
        k, c, inertia = (truth[n] for n in ("stiffness", "damping", "inertia"))
        frequency = np.sqrt(k / inertia) / (2 * np.pi)
        assert fit["natural_frequency"].value == pytest.approx(frequency, rel=0.02)
        assert fit["damping_ratio"].value == pytest.approx(c / (2 * np.sqrt(k * inertia)), rel=0.05)
        assert fit["natural_frequency"].high / fit["natural_frequency"].low < 1.1
