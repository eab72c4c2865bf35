"""The motion-driven check: exact model, MuJoCo and the keys answer the same motion."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.piano.twin.experiments.motion_driven import DOWN, TRAVEL, motion, reactions


def test_the_motion_goes_down_and_stops() -> None:
    time, path, speed, _ = motion(2e-5)
    assert time[-1] == pytest.approx(DOWN, abs=1e-4)
    assert path[-1] == pytest.approx(TRAVEL, rel=1e-3) and abs(speed[-1]) < 2e-3


def test_mujoco_answers_as_the_exact_model_and_a_bare_key_with_much_less() -> None:
    found = {r.name: r for r in reactions()}
    exact, mujoco = found["hybrid action, exact"], found["hybrid action, MuJoCo"]
    late = mujoco.time > 0.002
    at = np.interp(mujoco.time[late], exact.time, exact.force)
    assert np.sqrt(np.mean((mujoco.force[late] - at) ** 2)) < 0.02 * exact.peak
    assert found["with all parts, exact"].peak == pytest.approx(exact.peak, rel=0.01)
    assert found["key `paper`"].peak < 0.5 * exact.peak
    assert found["key `paper`"].peak < found["key `acoustic`"].peak < exact.peak
