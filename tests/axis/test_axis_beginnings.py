"""What a log holds before its first reading and behind its last one."""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import TAU, Q, T, U, check, table

from pianobot_ros.axis.reading import read_log

REST = 40


def rested(q, u):
    """Position and command that rest at their first numbers before they move."""
    return (np.concatenate([np.full(REST, y[0]), y]) for y in (q, u))


@pytest.mark.parametrize("behind", [False, True])
def test_rows_that_were_never_stamped_are_left_out(tmp_path, behind):
    columns = {"t": T + 361.4, "cmd": U, "pos": Q, "torque": TAU}
    none = np.zeros(7)
    filled = {h: np.concatenate([y, none] if behind else [none, y]) for h, y in columns.items()}
    check(read_log(table(tmp_path / "buffer.csv", filled)), effort=True)


def test_a_clock_that_begins_at_zero_keeps_its_first_row(tmp_path):
    log = read_log(table(tmp_path / "log.csv", {"t": T, "cmd": U, "pos": Q}))
    assert log.t.size == T.size
    check(log)


def test_a_coarse_clock_keeps_the_rows_that_share_its_zero(tmp_path):
    log = read_log(table(tmp_path / "log.csv", {"time [s]": np.floor(10 * T), "cmd": U, "pos": Q}))
    assert log.t.size == T.size


@pytest.mark.parametrize("commanded", ["given", "unread", "none"])
def test_a_position_that_was_not_read_yet_is_left_out(tmp_path, commanded):
    q, u = rested(Q + 1.0, U + 1.0)
    q[:25] = 0.0
    if commanded == "unread":
        u[:25] = 0.0
        u[25:REST] = q[REST]
    t = np.arange(q.size) * 0.02
    columns = {"t": t, "pos": q} | ({} if commanded == "none" else {"cmd": u})
    log = read_log(table(tmp_path / "log.csv", columns))
    assert np.all(np.isnan(log.position[:25])) and np.allclose(log.position[25:], q[25:])
    assert any("is 0 in the first 25 row(s), and leaps" in n for n in log.notes)


def test_a_command_that_was_not_given_yet_is_left_out(tmp_path):
    q, u = rested(Q + 1.0, U + 1.0)
    u[:25], u[25:REST] = 0.0, q[0]
    log = read_log(table(tmp_path / "log.csv", {"t": np.arange(q.size) * 0.02, "cmd": u, "pos": q}))
    assert np.all(np.isnan(log.command[:25])) and np.allclose(log.command[25:], u[25:])
    assert np.allclose(log.position, q)


def test_a_step_that_a_slow_log_shows_in_one_row_was_read(tmp_path):
    u = np.where(np.arange(T.size) < 100, 0.0, 1.0)
    q = np.where(np.arange(T.size) < 101, 0.0, 1.0 - 0.1 * 0.5 ** (np.arange(T.size) - 101.0))
    log = read_log(table(tmp_path / "log.csv", {"t": 5.0 * T, "cmd": u, "pos": q}))
    assert np.allclose(log.position, q) and np.allclose(log.command, u)


def test_a_joint_that_is_pulled_off_its_zero_by_its_load_was_sent_there(tmp_path):
    u = np.where(np.arange(T.size) < 100, 0.0, 0.6 * np.sin(3.0 * (T - T[100])) + 0.5)
    log = read_log(table(tmp_path / "log.csv", {"t": T, "cmd": u, "pos": u + 0.2}))
    assert np.allclose(log.command, u)
