"""Logs of a joint with an encoder on either side of gear and spring."""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import TAU, Q, T, U, V, check, table

from pianobot_ros.axis.reading import read_log, read_recordings
from pianobot_ros.axis.reading.request import Request

TWIST = 0.004 * np.sin(9.0 * T)
MOTOR = Q + TWIST


@pytest.mark.parametrize(
    "names",
    [
        ("q_ref", "q_link", "q_mot"),
        ("Sollwinkel", "Abtriebswinkel", "Antriebswinkel"),
        ("q_d", "q", "theta"),
        ("q_ref", "q_l", "q_m"),
    ],
)
@pytest.mark.parametrize("ratio", [1.0, -100.0])
def test_all_is_referred_to_the_motor_and_the_joint_shows_the_twist(tmp_path, names, ratio):
    columns = dict(zip(names, (U, Q, ratio * (MOTOR - 3.0)), strict=True))
    held = {"time": T, **columns, "torque": TAU}
    log = read_log(table(tmp_path / "log.csv", held))
    assert log.link == pytest.approx(Q)
    assert np.std(log.position - MOTOR) < 0.02 * np.std(TWIST)
    assert any("shows the twist" in note for note in log.notes)


def test_a_motor_s_position_may_be_in_another_message(tmp_path):
    table(tmp_path / "run_joint_states.csv", {"time": T, "position": Q, "effort": TAU})
    columns = {"time": T + 2e-3, "motor_position": MOTOR}
    table(tmp_path / "run_motor_states.csv", columns)
    (found,) = read_recordings([tmp_path])
    (log,) = found.joints.values()
    assert log.link == pytest.approx(Q)


def test_the_link_s_own_speed_says_nothing_more(tmp_path):
    held = {"time": T, "q_ref": U, "q_link": Q, "q_mot": MOTOR, "torque": TAU}
    slope = np.gradient(MOTOR, T)
    assert read_log(table(tmp_path / "a.csv", held | {"dq": slope})).velocity is not None
    log = read_log(table(tmp_path / "b.csv", held | {"dq": V}))
    assert log.velocity is None and any("the velocity is the link's" in n for n in log.notes)


def test_who_wants_the_joint_alone_says_so(tmp_path):
    held = {"time": T, "q_ref": U, "q_link": Q, "q_mot": MOTOR, "torque": TAU}
    path = table(tmp_path / "log.csv", held)
    (found,) = read_recordings([path], Request({"motor": "-"}))
    (log,) = found.joints.values()
    check(log, effort=True)
    assert log.link is None
    (found,) = read_recordings([path], Request({"position": "q_mot"}))
    (log,) = found.joints.values()
    assert log.link is None and log.position == pytest.approx(MOTOR)


@pytest.mark.parametrize(
    ("motor", "why"),
    [
        (Q + 0.3 * np.linspace(0.0, 2.0, T.size), "drift apart by"),
        (np.cos(17.0 * T), "another motion"),
        (2.0 * Q + 1.0, "no twist"),
    ],
)
def test_why_a_motor_is_left_out_is_said(tmp_path, motor, why):
    held = {"time": T, "q_ref": U, "q_link": Q, "q_mot": motor, "torque": TAU}
    log = read_log(table(tmp_path / "log.csv", held))
    assert log.link is None and any(why in note for note in log.notes), log.notes


def test_a_ratio_of_one_is_one_in_degrees_too(tmp_path):
    names = {"q_ref_deg": U, "q_link_deg": Q, "q_mot_deg": 1.005 * MOTOR}
    columns = {name: np.degrees(y) for name, y in names.items()}
    log = read_log(table(tmp_path / "log.csv", {"time": T, **columns, "torque": TAU}))
    assert np.ptp(log.position - 1.005 * MOTOR) < 1e-9
