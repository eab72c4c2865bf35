"""The reduced strike model and the MuJoCo twin are two solutions of the same nominal laws."""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.cell.motion import StrikeMotion
from pianobot_ros.twin.rollout import play, reduced, strike_commands
from pianobot_ros.twin.strike import strike_model


@pytest.mark.parametrize(("finger", "note"), [("middle", 64), ("thumb", 62)])
@pytest.mark.parametrize(("speed", "pressure"), [(0.1, 0.0), (0.25, -100e3)])
def test_same_strike(finger: str, note: int, speed: float, pressure: float) -> None:
    commands = strike_commands({finger: note}, StrikeMotion(speed, 0.014, 0.15), pressure=pressure)
    run = play(commands, reduced(finger, note))
    angle, _, force = run.key(note)
    model = strike_model(finger, note)
    every = max(1, round(1e-3 / float(np.median(np.diff(run.time)))))
    time, pose = run.time[::every], run.pose[::every]
    given = model.input(time, pose[:, :3], pose[0, 3:], pressure, float(time[0]) + 0.02, float(time[-1]) - 0.02)
    stroke = model.strike(given)
    real_angle, real_force = np.interp(given.time, run.time, angle), np.interp(given.time, run.time, force)
    assert np.sqrt(np.mean((stroke.angle - real_angle) ** 2)) < 0.01 * real_angle.max()
    hold = (given.time > given.time[0] + 0.4 * np.ptp(given.time)) & (
        given.time < given.time[0] + 0.6 * np.ptp(given.time)
    )
    # MuJoCo's friction is a soft constraint: a sticking tip creeps, so that its force stays 1 to 1.5 % lower.
    assert np.mean(stroke.force[hold]) == pytest.approx(np.mean(real_force[hold]), rel=0.02)
