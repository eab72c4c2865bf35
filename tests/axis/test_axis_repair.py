"""What laboratories' logs get wrong: every case is either mended and said, or refused in one
line.
"""

from __future__ import annotations

import numpy as np
import pytest

from pianobot_ros.axis.diagnosis.joint import diagnose_logs
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.reading import read_log
from pianobot_ros.axis.signals.cleaning import clean, quantisation
from pianobot_ros.gap import GapError
from pianobot_ros.gap.problem.recordings.spikes import spikes

T = np.arange(0, 12, 0.01)
C = 0.5 * np.sin(np.pi * T)
Q = 0.48 * np.sin(np.pi * T - 0.1)
V = np.gradient(Q, T)
E = 0.05 * np.gradient(V, T) + 0.1 * np.sign(V)


def write(path, header, *columns):
    np.savetxt(
        path,
        np.column_stack(columns),
        delimiter=",",
        header=",".join(header),
        comments="",
        fmt="%.12g",
    )
    return path


def said(log, words):
    assert any(words in note for note in log.notes), log.notes


@pytest.mark.parametrize("mark", ["# ", "%"])
def test_header_behind_a_comment_sign(tmp_path, mark):
    path = tmp_path / "log.csv"
    np.savetxt(
        path,
        np.column_stack([T, C, Q]),
        delimiter=",",
        header="time,command,position",
        comments=mark,
    )
    assert np.allclose(read_log(path).position, Q)


def test_desired_position_is_not_taken_for_the_measured_one(tmp_path):
    log = read_log(write(tmp_path / "log.csv", ["t", "q_d", "q", "qd", "tau"], T, C, Q, V, E))
    assert log.command is not None
    assert np.allclose(log.command, C)
    assert np.allclose(log.position, Q)


def test_clock_reset_keeps_the_order_of_recording(tmp_path):
    t = T.copy()
    t[600:] -= 5.0
    log = read_log(write(tmp_path / "log.csv", ["time", "command", "position"], t, C, Q))
    assert np.allclose(log.position, Q)
    assert np.allclose(log.t, T, atol=1e-6)
    said(log, "clock jumps back")


@pytest.mark.parametrize("modulus", [8.194, 8.195, 8.196])
def test_a_counter_that_overflows_is_no_log_out_of_order(tmp_path, modulus):
    """Sorted, the stamps of its rounds lie between each other as evenly as those of one round, but
    closer: a logger would have had to write twice as fast (motors' clocks of 15 bits)."""
    t = np.mod(T + 3.0, modulus)
    log = read_log(write(tmp_path / "log.csv", ["time", "command", "position"], t, C, Q))
    assert log.t.size == T.size
    assert np.allclose(log.position, Q)
    assert np.allclose(np.diff(log.t), 0.01, atol=5e-3)
    said(log, "clock jumps back")


def test_rows_out_of_order_fill_the_hole_that_they_left(tmp_path):
    rng = np.random.default_rng(3)
    t = T + rng.uniform(-0.003, 0.003, T.size)
    order = np.r_[0:300, 700:900, 300:700, 900 : T.size]
    names = ["time", "command", "position"]
    log = read_log(write(tmp_path / "log.csv", names, t[order], C[order], Q[order]))
    assert np.allclose(log.t - log.t[0], t - t[0], atol=1e-9)
    assert np.allclose(log.position, Q)
    said(log, "sorted")


def test_a_damaged_row_is_left_out(tmp_path):
    t, q = T.copy(), Q.copy()
    t[700], q[700] = 1e218, -3.0
    log = read_log(write(tmp_path / "log.csv", ["time", "command", "position"], t, C, q))
    assert log.t.size == T.size - 1
    assert np.allclose(log.position, np.delete(Q, 700))


@pytest.mark.parametrize("value", [np.inf, -1.4e218, 50.0])
def test_spikes_are_left_out_and_do_not_turn_radians_into_degrees(tmp_path, value):
    q = Q.copy()
    q[500] = value
    log = read_log(write(tmp_path / "log.csv", ["time", "command", "position"], T, C, q))
    kept = np.isfinite(log.position)
    assert not kept[500]
    assert np.allclose(log.position[kept], Q[kept])


def test_a_log_that_moves_fast_has_no_spikes():
    steps = np.sign(np.sin(2 * np.pi * T)) + 0.01 * np.sin(T)
    assert np.isfinite(clean(Log("log", T, steps, steps, None, None)).log.position).all()


def test_wrapped_angles_are_unwrapped(tmp_path):
    wrapped = [np.mod(8 * x + np.pi, 2 * np.pi) - np.pi for x in (C, Q)]
    log = read_log(write(tmp_path / "log.csv", ["time", "command", "position"], T, *wrapped))
    assert np.allclose(log.position, 8 * Q, atol=1e-6)


@pytest.mark.parametrize("period", [25.0, 8 * np.pi, 0.7])
def test_readings_that_come_round_at_their_devices_range_are_joined(tmp_path, period):
    """Motors on a bus send positions in a range of their own, which is no turn."""
    command, position = period * 1.5 * C, period * 1.5 * Q
    read = np.mod(position + 0.5 * period, period) - 0.5 * period
    names = ["time_s", "command_rad", "position_rad", "torque_Nm"]
    log = read_log(write(tmp_path / "log.csv", names, T, command, read, E))
    assert np.ptp(log.position) == pytest.approx(np.ptp(position), rel=2e-3)
    apart = log.position - position
    assert np.ptp(apart) < 0.02 * period
    assert np.max(np.abs(log.command - log.position)) < 0.5 * period
    said(log, "at which it comes round")


def test_a_joint_that_jumps_back_to_its_start_does_not_come_round(tmp_path):
    """The fly-back of a saw-tooth takes a joint some samples; only its command jumps."""
    saw = 3.0 * np.mod(T, 2.0) / 2.0
    slow = np.convolve(np.r_[np.zeros(9), saw], np.ones(10) / 10, "valid")
    names = ["time", "command", "position"]
    log = read_log(write(tmp_path / "log.csv", names, T, saw, slow))
    assert np.allclose(clean(log).log.position, slow)
    assert np.ptp(clean(log).log.command) == pytest.approx(np.ptp(saw))


def test_a_command_that_never_changes_beside_a_joint_that_moves_on_is_none(tmp_path):
    names = ["time", "position_cmd", "position", "torque"]
    log = read_log(write(tmp_path / "log.csv", names, T, 0 * T, Q, E))
    assert log.command is None
    said(log, "commands nothing")
    step = 1.0 - np.exp(-3.0 * T)
    log = read_log(write(tmp_path / "step.csv", names, T, 0 * T + 1.0, step, np.exp(-3.0 * T)))
    assert log.command is not None


def test_a_joint_that_stands_still_is_told_from_one_that_was_told_to():
    still = Log("still", T, C, np.full(T.size, 0.1), None, E, "Nm")
    with pytest.raises(GapError, match="though its command moves by 1: the drive is off"):
        clean(still)
    with pytest.raises(GapError, match=r"is constant\); a log with motion"):
        clean(Log("still", T, None, np.full(T.size, 0.1), None, E, "Nm"))


def test_encoder_counts_can_be_declared(tmp_path):
    path = write(
        tmp_path / "log.csv", ["time", "goal", "position"], T, np.round(C * 652), np.round(Q * 652)
    )
    log = read_log(path, units={"position": "4096/turn"})
    assert np.allclose(log.position, Q, atol=2e-3)


@pytest.mark.parametrize("names", [("command", "position"), ("setpoint_deg", "encoder_deg")])
def test_a_joint_whose_encoder_is_upside_down_has_its_command_still(tmp_path, names):
    log = read_log(write(tmp_path / "log.csv", ["time", *names, "torque_Nm"], T, C, 0.2 - Q, E))
    assert log.command is not None
    scale = np.ptp(log.position) / np.ptp(Q)
    assert np.allclose(log.position, scale * (0.2 - Q)) and np.allclose(log.command, -scale * C)
    said(log, "counts against its command")


def test_an_effort_against_the_position_is_no_command(tmp_path):
    """What holds a swinging load does so, and may be called "control"; it goes as far by chance."""
    for size in (0.3, 3.0):
        names = ["time", "control", "position"]
        log = read_log(write(tmp_path / "log.csv", names, T, -size * Q, Q))
        assert log.command is None


def test_effort_against_the_motion_is_turned():
    right, wrong = (clean(Log("log", T, C, Q, None, sign * E)) for sign in (1, -1))
    assert right.effort is not None
    assert wrong.effort is not None
    assert np.allclose(right.effort, wrong.effort)
    said(wrong.log, "other sign")


@pytest.mark.parametrize("sign", [1, -1])
def test_the_sign_of_effort_in_free_swings_is_told_by_the_work(sign):
    """A pendulum that swings under a torque which hardly changes, with a noisy encoder: there
    acceleration is a sine of the angle, as gravity is.
    """
    rng = np.random.default_rng(3)
    t = np.arange(0, 40, 0.005)
    torque = 1.0 - 0.2 * np.cos(0.4 * t)
    q, v, out = 0.0, 0.0, np.empty(t.size)
    for i, pull in enumerate(torque):
        out[i] = q
        v += 0.005 * (pull - 3.6 * np.sin(q) - 0.05 * v - 0.05 * np.tanh(50 * v)) / 0.18
        q += 0.005 * v
    noisy = out + 2e-3 * rng.standard_normal(t.size)
    effort = torque + 0.01 * rng.standard_normal(t.size)
    cleaned = clean(Log("log", t, None, noisy, None, sign * effort))
    assert cleaned.effort is not None
    assert cleaned.effort[100:-100].mean() == pytest.approx(1.0, abs=0.1)


def test_gravity_that_another_joint_turns_is_no_friction_of_the_other_sign():
    """A torque behind the gear has no friction; the load passes power between the joints, and taken
    for this one's own it looks like friction that pushes.
    """
    q = 0.5 * np.sin(1.6 * T) + 0.2 * np.sin(3.7 * T)
    other = -1.8 + 0.6 * np.sin(1.6 * T + 2.0) + 0.2 * np.sin(3.7 * T + 4.0)
    effort = 0.8 * np.gradient(np.gradient(q, T), T) + 14.0 * np.sin(q + other)
    beside = {"elbow": other}
    cleaned = clean(Log("log", T, None, q, None, effort, "Nm", others=beside))
    assert cleaned.effort is not None
    assert np.mean(np.abs(cleaned.effort - effort)) < 0.02 * np.std(effort)


def test_a_sensor_that_hangs_is_left_out(tmp_path):
    """A position that hung for 12 % of the log had been "none, 100 %", with a loop 50 times too
    slow.
    """
    hung = Q.copy()
    hung[300:370] = Q[300]
    log = read_log(write(tmp_path / "log.csv", ["t", "cmd", "pos"], T, C, hung))
    said(log, "hangs for 0.69 s")
    assert np.isnan(log.position[301:370]).all() and np.isfinite(log.position).sum() == T.size - 69


def test_a_joint_that_stands_is_no_sensor_that_hangs(tmp_path):
    """Play: it stands at each reversal, to the last digit, and sets out where it stood."""
    stands = [0.0]
    for c in C[1:]:
        stands.append(float(np.clip(stands[-1], c - 0.2, c + 0.2)))
    path = write(tmp_path / "log.csv", ["t", "cmd", "pos"], T, C, np.array(stands))
    log = read_log(path)
    assert np.isfinite(log.position).all()


def test_magnitude_of_the_current_is_no_effort():
    cleaned = clean(Log("log", T, C, Q, None, np.abs(E)))
    assert cleaned.effort is None
    said(cleaned.log, "magnitude")


def test_gravity_that_is_never_negative_stays_an_effort():
    assert clean(Log("log", T, C, Q, None, 1.0 + E + 0.2 * np.sin(Q))).effort is not None


@pytest.mark.parametrize(
    ("position", "words"),
    [
        (np.full(T.size, 0.1), "never moves"),
        (1e-4 * np.random.default_rng(0).standard_normal(T.size), "own noise"),
        (1e-3 * np.round(2.4 * np.sin(np.pi * T)), "moves by 4 steps of its encoder"),
    ],
)
def test_a_log_without_motion_is_refused(position, words):
    with pytest.raises(GapError, match=words):
        diagnose_logs([Log("log", T, C, position, None, E)])


def test_encoder_steps_are_foreseen_in_the_acceleration():
    step = 2 * np.pi / 1024
    coarse = clean(Log("log", T, C, step * np.round(Q / step), None, E))
    fine = clean(Log("log", T, C, Q, None, E))
    error = float(np.std(coarse.a - fine.a))
    assert 0.5 * error < quantisation(coarse)[2] < 2.0 * error
    assert quantisation(fine) == (0.0, 0.0, 0.0)


def turning_over():
    """Angle and torque of a pendulum that turns over thrice, and its times."""
    t = np.arange(0, 40, 0.005)
    q, v, out, torque = 0.0, 0.0, np.empty(t.size), 2.2 * np.sin(0.9 * t)
    for i, pull in enumerate(torque):
        out[i] = q
        v += 0.005 * (pull - 1.5 * np.sin(q) - 0.1 * v) / 0.1
        q += 0.005 * v
    assert np.ptp(out) > 14.0
    return t, out + 0.4 * np.pi, torque


def zeros_now_and_then(x, share=0.003):
    return np.where(np.random.default_rng(4).random(x.size) < share, 0.0, x)


def silent_for_a_while(x):
    return np.where(np.arange(x.size) // 60 == 20, 0.0, x)


@pytest.mark.parametrize("fault", [zeros_now_and_then, silent_for_a_while])
def test_faults_of_a_bus_do_not_tell_the_unit(tmp_path, fault):
    """Angles without a unit that turn over are in rad where the torque goes by their sine: readings
    of zero had made them degrees.
    """
    t, q, torque = turning_over()
    log = read_log(write(tmp_path / "log.csv", ["time", "position", "torque"], t, fault(q), torque))
    said(log, "taken as rad")


@pytest.mark.parametrize("size", [50.0, -1e4])
def test_spikes_of_effort_are_left_out(size):
    at = np.random.default_rng(5).choice(T.size, 4, replace=False)
    effort = E.copy()
    effort[at] += size
    cleaned, sound = (clean(Log("log", T, C, Q, None, e)) for e in (effort, E))
    said(cleaned.log, "4 spike(s) in effort left out")
    assert cleaned.effort is not None
    assert sound.effort is not None
    assert np.max(np.abs(cleaned.effort - sound.effort)) < 0.2 * np.ptp(E)


def test_readings_of_zero_amid_a_motion_are_spikes_and_the_motion_is_none():
    random = np.random.default_rng(6)
    t = np.arange(0.0, 20.0, 0.01)
    swing = 2.0 + np.sin(9.0 * t) * np.exp(-0.1 * t)
    zero = random.choice(np.arange(2, t.size - 2, 5), 10, replace=False)
    read = swing.copy()
    read[zero] = 0.0
    assert set(np.flatnonzero(spikes(read))) == set(zero)
    for sound in (swing, np.sin(60.0 * t), random.normal(size=t.size), np.sign(swing - 2.0)):
        assert not spikes(sound).any()
