"""Tables whose headers say nothing: what their numbers tell of one joint."""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import TAU, N, Q, T, U, check

from pianobot_ros.axis.reading import Request, read_recordings


def test_what_is_left_beside_a_command_and_its_position_is_the_effort(tmp_path):
    """Without headers and without a velocity, in any order of the columns."""
    for k, order in enumerate([(U, Q, TAU), (TAU, U, Q), (Q, TAU, U)]):
        path = tmp_path / f"run{k}.csv"
        np.savetxt(path, np.column_stack([T, *order]), delimiter=",", fmt="%.9g")
        (run,) = read_recordings([path])
        (log,) = run.joints.values()
        check(log, effort=True)
        assert np.allclose(log.effort, TAU, atol=1e-6)
        assert any("who follows whom" in note for note in run.notes)


@pytest.mark.parametrize("spare", [U - Q, 2.0 * Q + 1.0, np.full(N, 3.0)])
def test_what_command_and_position_make_is_no_effort(tmp_path, spare):
    np.savetxt(tmp_path / "run.csv", np.column_stack([T, U, Q, spare]), delimiter=",", fmt="%.9g")
    (run,) = read_recordings([tmp_path / "run.csv"])
    assert all(log.effort is None for log in run.joints.values())


def test_what_a_fed_forward_loop_hardly_lags_behind_is_still_its_command(tmp_path):
    """A robot's target positions beside the measured ones: neither goes before the other, and the
    measured speed is the slope of what was measured.
    """
    t = np.arange(0.0, 8.0, 0.008)
    wanted = np.stack([a * np.sin(w * t) for a, w in ((0.6, 2.0), (0.4, 2.7), (0.5, 1.6))], 1)
    ringing = 0.01 * np.stack([np.sin(w * t) for w in (23.0, 19.0, 27.0)], 1)
    early = np.stack([np.interp(t + 2e-4, t, u) for u in wanted.T], 1)
    measured = early + ringing
    speed = np.gradient(measured, t, axis=0)
    path = tmp_path / "run.csv"
    np.savetxt(path, np.column_stack([t, measured, speed, wanted]), delimiter=",", fmt="%.9g")
    (run,) = read_recordings([path])
    for log, q, u in zip(run.joints.values(), measured.T, wanted.T, strict=True):
        assert np.allclose(log.position, q, atol=1e-6)
        assert np.allclose(log.command, u, atol=1e-6)


def test_an_error_tells_which_two_it_is_of(tmp_path):
    """Command minus position, also where the position goes before its command, as one does behind
    a fed-forward speed; a row that a sampler missed makes no signal of the row's number.
    """
    early = 0.6 * np.sin(2.1 * T + 0.13) + 0.2
    rows = np.column_stack([np.arange(N), U, early, U - early, TAU])
    lines = [" ".join(f"{x:.6f}" for x in row) for row in rows]
    lines[100] = "overrun"
    path = tmp_path / "samples.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    (run,) = read_recordings([path], Request(rate=50.0))
    (log,) = run.joints.values()
    known = np.isfinite(log.position)
    assert np.allclose(log.position[known], early[known], atol=1e-5)
    assert np.allclose(log.command[known], U[known], atol=1e-5)
    assert np.allclose(log.effort[known], TAU[known], atol=1e-5)
