"""Logs as they come: separators, units, names, holes; and how they are cut."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.reading import read_log
from pianobot_ros.axis.signals.cleaning import clean
from pianobot_ros.axis.signals.filtering import derivative
from pianobot_ros.axis.signals.segment import blocks_of
from pianobot_ros.gap import GapError

T = np.arange(0, 8, 0.01)
Q = 0.6 * np.sin(2 * np.pi * 0.5 * T)
V = 0.6 * np.pi * np.cos(2 * np.pi * 0.5 * T)


def write(path, columns, delimiter=",", comma=False):
    rows = [delimiter.join(columns)]
    for row in zip(*columns.values(), strict=True):
        cells = [f"{x:.15g}" for x in row]
        rows.append(delimiter.join(c.replace(".", ",") if comma else c for c in cells))
    path.write_text("# a comment\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("columns", "delimiter", "comma"),
    [
        (
            {"time": T, "target_q_0": Q, "actual_q_0": Q, "actual_qd_0": V, "actual_current_0": Q},
            " ",
            False,
        ),
        (
            {
                "timestamp_ms": T * 1e3 + 1.7e12,
                "goal_deg": np.degrees(Q),
                "present_position_deg": np.degrees(Q),
            },
            ";",
            True,
        ),
        ({"t": T, "posDes": Q, "pos": Q, "vel": V, "tau": Q}, "\t", False),
        (
            {
                "stamp_ns": T * 1e9,
                "cmd": Q,
                "theta": Q,
                "speed_rpm": V * 60 / 2 / np.pi,
                "torque": Q,
            },
            ",",
            False,
        ),
    ],
)
def test_columns_and_units_are_found(tmp_path, columns, delimiter, comma):
    log = read_log(write(tmp_path / "log.csv", columns, delimiter, comma))
    assert np.allclose(log.t, T, atol=1e-3)
    assert np.allclose(log.position, Q, atol=1e-6)
    assert log.command is not None
    assert np.allclose(log.command, Q, atol=1e-6)
    if log.velocity is not None:
        assert np.allclose(log.velocity, V, rtol=2e-2, atol=2e-2)


def test_mapping_and_units_can_be_declared(tmp_path):
    path = write(tmp_path / "log.csv", {"a": T * 1000, "b": np.degrees(Q), "c": Q})
    log = read_log(
        path,
        {"time": "a", "position": "b", "effort": "2"},
        {"time": "ms", "position": "deg", "effort": "mA"},
    )
    assert np.allclose(log.position, Q, atol=1e-6)
    assert log.effort_unit == "A"
    assert log.command is None


@pytest.mark.parametrize(
    ("columns", "roles", "message"),
    [
        ({"pos": Q}, None, "say --columns time=HEADER"),
        ({"time": T, "pos": Q}, {"position": "nope"}, "no column 'nope'"),
        ({"time": T, "pos": Q}, {"colour": "pos"}, "unknown column role"),
        ({"time": T[:5], "pos": Q[:5]}, None, "at least 20"),
        ({"time": T, "pos": np.full(T.size, np.nan)}, None, "almost"),
    ],
)
def test_bad_logs_say_what_to_do(tmp_path, columns, roles, message):
    with pytest.raises(GapError, match=message):
        read_log(write(tmp_path / "log.csv", columns), roles)


def test_missing_file():
    with pytest.raises(GapError, match="no such log"):
        read_log("/nowhere/log.csv")


def test_repeats_of_a_cycle_are_found():
    blocks, how = blocks_of(clean(Log("x", T, Q, Q, None, None)))
    assert "repeats" in how
    assert len({b.condition for b in blocks}) == 1
    assert len(blocks) >= 3


def test_moves_are_cut_at_rests_and_equal_ones_are_repeats():
    y, levels = [], [0.0, 0.5, 0.0, 0.5, 0.0, 0.5, 0.0]
    for a, b in pairwise(levels):
        s = np.linspace(0, 1, 80)
        y += [np.full(60, a), a + (b - a) * s * s * (3 - 2 * s)]
    q = np.concatenate([*y, np.zeros(60)])
    q[:300] += 0.0
    blocks, _ = blocks_of(clean(Log("x", np.arange(q.size) * 0.01, q, q, None, None)))
    conditions = [b.condition for b in blocks]
    assert len(set(conditions)) < len(conditions)


def test_long_moves_are_cut_and_none_is_left_out():
    t = np.arange(2000) * 0.01
    moves = [t * (20 - t) * (1.2 + np.sin(k * t) + np.sin(2.3 * t**1.1)) for k in (1, 2, 3, 4)]
    q = 0.01 * np.concatenate([np.concatenate([x, np.zeros(150)]) for x in moves])
    _, how = blocks_of(clean(Log("x", np.arange(q.size) * 0.01, q, q, None, None)))
    assert "moves between rests; at most 12 s of each are used, 56 %" in how


def test_log_that_never_moves():
    with pytest.raises(GapError, match="never moves"):
        blocks_of(clean(Log("x", T, None, np.zeros(T.size), None, None)))


def test_holes_become_missing_samples():
    keep = (T < 3.0) | (T > 3.6)
    c = clean(Log("x", T[keep], Q[keep], Q[keep], None, None))
    assert not c.valid.all()
    blocks, _ = blocks_of(c)
    assert any(np.isnan(b.outputs["position"].y).any() for b in blocks)


def test_fast_logs_are_thinned_without_a_shift():
    t = np.arange(0, 4, 0.001)
    c = clean(Log("x", t, None, np.sin(3 * t), None, None))
    assert c.dt == pytest.approx(0.004)
    assert np.max(np.abs(c.position - np.sin(3 * c.t))) < 1e-4


def test_derivative_is_of_fourth_order():
    t = np.arange(0, 3, 0.02)
    error = np.abs(derivative(np.sin(8 * t), 0.02) - 8 * np.cos(8 * t))[2:-2]
    assert np.max(error) < 8 * (8 * 0.02) ** 4 / 20
