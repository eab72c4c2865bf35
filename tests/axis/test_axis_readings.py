"""What the laws say of smoothed signals: what is quicker than the smoothing is not in them."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.axis.laws import kernel
from pianobot_ros.axis.laws.readings import Readings
from pianobot_ros.axis.signals.filtering import derivative, low_pass

DT, CUTOFF, WAVES = 0.004, 15.0, 30.0
T = np.arange(0.0, 8.0, DT)
JOINT = {"inertia": 0.1, "viscous": 0.2}
SIZES = {"smooth_speed": 1e-3, "hysteresis_distance": 1.0, "stribeck_speed": 1.0}
"""Of laws that are switched off, which divide by them."""


def _motion(speed: float) -> np.ndarray:
    """To and fro, at the middle with `speed`."""
    return speed / 2.0 * np.sin(2.0 * T)


def _parameters(**values: float) -> np.ndarray:
    return np.array([(JOINT | SIZES | values).get(n, 0.0) for n in kernel.NAMES])


def _readings(position: np.ndarray) -> Readings:
    q = low_pass(position, DT, CUTOFF)
    v = derivative(q, DT)
    return Readings(position, (q, v, derivative(v, DT)), DT, CUTOFF)


# 5 and 40 Hz at the middle of the motion
@pytest.mark.parametrize("speed", [1.0, 8.4])
def test_cogging_is_smoothed_like_the_effort_that_was_measured(speed):
    q = _motion(speed)
    v = derivative(q, DT)
    effort = 0.1 * derivative(v, DT) + 0.2 * v + 0.5 * np.sin(WAVES * q + 0.7)
    p = _parameters(cogging=0.5, cogging_waves=WAVES, cogging_phase=0.7)
    readings, felt = _readings(q), low_pass(effort, DT, CUTOFF)
    moved = readings.moved(p)
    need, free = moved.compared(kernel.NO_FIELD, felt, (25, 0))
    assert np.max(np.abs(need - felt)[50:-50]) < 0.01
    assert np.max(np.abs(free - q)[50:-50]) < 0.01 * np.ptp(q)


@pytest.mark.parametrize("speed", [1.0, 8.4])
def test_of_a_ripple_of_the_encoder_the_true_motion_is_left(speed):
    true = _motion(speed)
    reading = true + 0.004 * np.sin(WAVES * true + 0.7)
    p = _parameters(encoder_ripple=0.004, encoder_waves=WAVES, encoder_phase=0.7)
    q, v, a = _readings(reading).moved(p).motion
    for found, wanted in zip((q, v, a), _readings(true).smoothed, strict=True):
        assert np.std((found - wanted)[50:-50]) < 0.02 * np.std(wanted)
    untouched = _readings(reading).smoothed[2] - _readings(true).smoothed[2]
    assert np.std((a - _readings(true).smoothed[2])[50:-50]) < 0.3 * np.std(untouched[50:-50])
