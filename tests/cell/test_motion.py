from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid

from pianobot_ros.cell.errors import ScoreError
from pianobot_ros.cell.motion.strike_motion import StrikeMotion

motions = st.builds(
    StrikeMotion,
    speed=st.floats(0.01, 1),
    depth=st.floats(0.001, 0.05),
    hold=st.floats(0, 2),
    clearance=st.floats(0, 0.05),
    release_speed=st.floats(0, 1).filter(lambda v: v == 0 or v > 0.01),
)


@given(motions)
def test_goes_down_and_comes_back(motion: StrikeMotion) -> None:
    time = np.linspace(-0.1, motion.duration + 0.1, 4001)
    height = motion.height(time)
    assert height[0] == pytest.approx(motion.clearance)
    assert height[-1] == pytest.approx(motion.clearance)
    assert height.min() >= -motion.depth - 1e-12
    assert motion.height(motion.down_time) == pytest.approx(-motion.depth)


@given(motions)
def test_velocity_is_the_slope_and_peaks_as_asked(motion: StrikeMotion) -> None:
    down, still = motion.down_time, motion.down_time + motion.hold
    time = np.concatenate(
        [np.linspace(0, down, 4001), still + np.linspace(0, motion.up_time, 4001)]
    )
    velocity = motion.velocity(time)
    travelled = cumulative_trapezoid(velocity, time, initial=0)
    path = motion.height(time) - motion.clearance
    assert np.allclose(travelled, path, rtol=0.0, atol=1e-3 * motion.amplitude)
    assert motion.velocity(motion.down_time / 2) == pytest.approx(-motion.speed)


@pytest.mark.parametrize(
    "wrong", [{"speed": 0}, {"depth": -0.01}, {"hold": -1}, {"speed": float("nan")}]
)
def test_nonsense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ScoreError):
        StrikeMotion(**{"speed": 0.1, "depth": 0.01, "hold": 0.1, **wrong})
