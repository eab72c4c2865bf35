"""Tables of many joints: without headers, told by their numbers, and as the user names columns."""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import table
from scipy.io import savemat

from pianobot_ros.axis.reading import Request, read_recordings
from pianobot_ros.cli.app import main
from pianobot_ros.gap import GapError

RATE, N, JOINTS = 100.0, 1500, 4
T = np.arange(N) / RATE


def motion(lag=0.0):
    """Positions (n, 4) of joints that move each in its own way; the last one rests."""
    t = T[:, None] - lag
    speed, size = np.array([1.1, 1.7, 2.3, 1.0]), np.array([0.8, 0.5, 0.6, 0.0])
    return size * (np.sin(speed * t) + 0.3 * np.sin(2.7 * speed * t)) + np.array([0.1, -1, 0.4, 1])


Q, U = motion(0.03), motion()
V, W = np.gradient(Q, T, axis=0), np.gradient(U, T, axis=0)
TAU = np.array([1.0, 2.0, 0.5, 1.0]) * np.sign(V) + np.sin(Q)


def headless(path, *blocks):
    np.savetxt(path, np.column_stack(blocks), fmt="%.9g", delimiter=",")
    return path


def columns(recording):
    """Headers by role of each joint."""
    out = {}
    for c in recording.taken:
        out.setdefault(c.joint, {})[c.role] = c.header
    return out


def numbered(**first):
    """What `columns` says where blocks begin at those columns."""
    return {
        str(k + 1): {role: f"column{n + k}" for role, n in first.items()} for k in range(JOINTS)
    }


def said(recording, words):
    assert any(words in n for n in recording.notes), recording.notes


# -- without headers -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("blocks", "found"),
    [
        ((Q, V, TAU), {"position": 1, "velocity": 5, "effort": 9}),
        ((Q, V, TAU, U, W), {"position": 1, "velocity": 5, "effort": 9, "command": 13}),
        ((U, Q, V, TAU), {"position": 5, "velocity": 9, "effort": 13, "command": 1}),
        ((Q, U, V, TAU), {"position": 1, "velocity": 9, "effort": 13, "command": 5}),
        ((Q, V, np.gradient(V, T, axis=0)), {"position": 1, "velocity": 5}),
        ((Q, np.degrees(V), TAU), {"position": 1, "velocity": 5, "effort": 9}),
    ],
    ids=[
        "efforts",
        "commands behind",
        "commands before",
        "commands between",
        "accelerations",
        "another unit",
    ],
)
def test_blocks_are_told_by_which_is_the_slope_of_which(tmp_path, blocks, found):
    (recording,) = read_recordings([headless(tmp_path / "a.csv", T, *blocks)])
    assert columns(recording) == numbered(**found)
    said(recording, "columns taken by their numbers")
    assert not any(n.endswith(": ") for n in recording.notes)


def test_commanded_accelerations_behind_the_velocities_are_no_efforts(tmp_path):
    late = motion(0.15)  # whose speeds the commanded accelerations are not the slopes of
    blocks = (late, np.gradient(late, T, axis=0), np.gradient(W, T, axis=0), W, U)
    (recording,) = read_recordings([headless(tmp_path / "a.csv", T, *blocks)])
    assert columns(recording) == numbered(position=1, velocity=5, command=17)


def test_one_joint_that_moves_tells_the_blocks_of_all(tmp_path):
    q = Q * np.array([0, 1, 0, 0])
    rows = (T, q, np.gradient(q, T, axis=0), TAU)
    (recording,) = read_recordings([headless(tmp_path / "a.csv", *rows)])
    assert columns(recording) == numbered(position=1, velocity=5, effort=9)


def test_one_joint_without_headers(tmp_path):
    rows = (T, Q[:, 0], U[:, 0], V[:, 0], TAU[:, 0])
    (recording,) = read_recordings([headless(tmp_path / "a.csv", *rows)])
    found = {"position": "column1", "command": "column2", "velocity": "column3"}
    assert columns(recording) == {"": {**found, "effort": "column4"}}


@pytest.mark.parametrize("late", [0, 1])
def test_a_demand_with_the_speed_s_own_slope_is_the_command(tmp_path, late):
    """The speed that a drive writes down may be its demand's."""
    speed = (W, V)[late][:, 0]
    rows = (T, np.sign(U[:, 0]), U[:, 0], Q[:, 0], speed, TAU[:, 0])
    (recording,) = read_recordings([headless(tmp_path / "a.csv", *rows)])
    found = {"command": "column2", "position": "column3", "velocity": "column4"}
    assert columns(recording) == {"": {**found, "effort": "column5"}}


def test_what_the_user_names_goes_before_what_the_file_is_called(tmp_path):
    rows = (T, U[:, 1], U[:, 0], Q[:, 0], V[:, 0], TAU[:, 0])
    path = headless(tmp_path / "full-travel-1Hz.csv", *rows)
    named = {"command": "2", "position": "3", "effort": "5"}
    (recording,) = read_recordings([path], Request({"time": "0", **named}))
    assert columns(recording) == {"": {role: f"column{k}" for role, k in named.items()}}


@pytest.mark.parametrize(
    ("reach", "unit"),
    [
        ([0.6, 0.9, 0.6, 7.7], "rad"),
        ([0.6, 0.9, 0.6, 15.0], "deg"),
        ([0.01, 0.02, 0.01, 7.7], "deg"),
        ([0.6, 5.0, 3.0, 7.7], "deg"),
    ],
    ids=["a roll that turns on", "too far", "the others rest", "two beyond half a turn"],
)
def test_one_joint_of_many_may_turn_on(tmp_path, reach, unit):
    q = U / np.max(np.abs(U), 0) * np.array(reach)
    rows = (T, q, np.gradient(q, T, axis=0), TAU)
    (recording,) = read_recordings([headless(tmp_path / "a.csv", *rows)])
    scale = 1.0 if unit == "rad" else np.pi / 180
    assert np.allclose(recording.joints["4"].position, scale * q[:, 3], atol=1e-6)


@pytest.mark.parametrize("across", [False, True])
def test_a_file_of_one_nameless_matrix_is_a_table_without_headers(tmp_path, across):
    """As a data-acquisition program saves it: one matrix, the time its first row or column."""
    rows = np.column_stack([T, Q, V, TAU])
    savemat(tmp_path / "run.mat", {"data": rows.T if across else rows})
    (recording,) = read_recordings([tmp_path / "run.mat"])
    expected = {f"{k + 1}": f"data[{5 + k}]" for k in range(JOINTS)}
    assert {j: c["velocity"] for j, c in columns(recording).items()} == expected
    asked = Request({"position": "2", "effort": "10"})
    (recording,) = read_recordings([tmp_path / "run.mat"], asked)
    assert columns(recording) == {"": {"position": "data[2]", "effort": "data[10]"}}


@pytest.mark.parametrize("counted", [False, True])
def test_blocks_at_a_rate(tmp_path, counted):
    rows = (np.arange(N), Q, V, TAU) if counted else (Q, V, TAU)
    path = headless(tmp_path / "a.csv", *rows)
    (recording,) = read_recordings([path], Request(rate=RATE))
    first = {"position": 0, "velocity": 4, "effort": 8}
    assert columns(recording) == numbered(**{role: k + counted for role, k in first.items()})
    assert np.allclose(recording.joints["2"].position, Q[:, 1], atol=1e-6)


@pytest.mark.parametrize("rate", [50.0, 200.0])
def test_another_rate_is_named_where_all_velocities_need_one_factor(tmp_path, rate):
    path = headless(tmp_path / "a.csv", Q, V, TAU)
    (recording,) = read_recordings([path], Request(rate=rate))
    said(recording, f"at about 100 Hz instead of {rate:g} Hz")
    assert all(any("--rate 100 says so" in n for n in x.notes) for x in recording.joints.values())
    assert recording.joints["1"].t[1] == pytest.approx(1 / rate)


def test_a_unit_or_one_joint_of_many_is_no_other_rate(tmp_path):
    for k, speed in enumerate((np.degrees(V), V * np.array([2.0, 1.0, 1.0, 1.0]))):
        cells = {"time": T, **{f"q_{j}": Q[:, j] for j in range(3)}}
        cells |= {f"vel_{j}": speed[:, j] for j in range(3)}
        (recording,) = read_recordings([table(tmp_path / f"{k}.csv", cells)])
        assert not any("rate" in n for n in recording.notes)


# -- as the user names them ------------------------------------------------------------------------
def options(*said):
    return [w for s in said for w in ("--columns", s)]


@pytest.mark.parametrize(
    "asked",
    [
        ("position=1-4", "velocity=5-8", "effort=9-12"),
        ("position=1,2,3,4", "velocity=column5-column8", "effort=9,10-12"),
        ("position=1", "position=2-3", "position=4", "velocity=5-8", "effort=9-12"),
    ],
    ids=["ranges", "lists", "twice"],
)
def test_lists_and_ranges_name_all_joints_at_once(tmp_path, capsys, asked):
    path = headless(tmp_path / "a.csv", T, Q, V, TAU)
    assert main(["axis", "columns", str(path), *options(*asked)]) == 0
    out = capsys.readouterr().out
    for k in range(JOINTS):
        assert f"\n  {k + 1}: " in out
        for name, first in (("position", 1), ("velocity", 5), ("effort", 9)):
            assert f"    {name:<9} = column{first + k} " in out


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (("position=1-4", "effort=9-11"), "3 column(s) were named for effort"),
        (("position=1-40",), "no column '1-40' (for position)"),
        (("position=4-1",), "column1 comes before column4"),
        (("position=1,99",), "no column '99' (for position)"),
        (("position=1", "position=-"), "another names one"),
        (("position=1-4", "effort=4-7"), "column4 was named for position and for effort"),
    ],
)
def test_what_contradicts_itself_is_one_line(tmp_path, capsys, asked, words):
    path = headless(tmp_path / "a.csv", T, Q, V, TAU)
    assert main(["axis", "columns", str(path), *options(*asked)]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1


def arm(path):
    """A table with headers of three joints and two torques of each."""
    cells = {"time": T}
    held = {"position": Q, "velocity": V, "torque": TAU, "motor_torque": 0.01 * TAU}
    for name, y in held.items():
        cells |= {f"{name}_{k + 1}": y[:, k] for k in range(3)}
    return table(path, cells)


def efforts(recording):
    return [head["effort"] for head in columns(recording).values()]


def test_a_column_of_one_joint_takes_its_place_and_nothing_else(tmp_path):
    path = arm(tmp_path / "a.csv")
    (recording,) = read_recordings([path], Request({"effort": "motor_torque_2"}))
    assert efforts(recording) == ["torque_1", "motor_torque_2", "torque_3"]
    assert all(log.velocity is not None for log in recording.joints.values())
    assert set(recording.unused) == {"motor_torque_1", "torque_2", "motor_torque_3"}
    (recording,) = read_recordings([path], Request({"time": "time"}))
    assert efforts(recording) == ["torque_1", "torque_2", "torque_3"]


def test_what_the_headers_of_a_group_have_in_common_names_it(tmp_path):
    path = arm(tmp_path / "a.csv")
    for stem in ("torque", "motor_torque"):
        (recording,) = read_recordings([path], Request({"effort": stem}))
        assert efforts(recording) == [f"{stem}_{k}" for k in (1, 2, 3)]


def test_a_column_of_no_joint_is_refused_where_there_are_many(tmp_path):
    path = arm(tmp_path / "a.csv")
    with pytest.raises(GapError, match="is of none of the joints 1, 2, 3; name a column for each"):
        read_recordings([path], Request({"effort": "time"}))
    with pytest.raises(GapError, match="torque_1 and motor_torque_1 were named for the effort of"):
        read_recordings([path], Request({"effort": ("torque_1", "motor_torque_1")}))


@pytest.mark.parametrize("names", [("tau_cal", "tau_est"), ("torque_ref", "current_meas")])
def test_what_was_measured_goes_before_what_was_calculated(tmp_path, names):
    cells = {"time": T}
    for name, y in zip((*names, "joint_pos"), (2 * TAU, TAU, Q), strict=True):
        cells |= {f"{name}_{k}": y[:, k] for k in range(3)}
    path = table(tmp_path / "a.csv", cells)
    (recording,) = read_recordings([path])
    assert efforts(recording) == [f"{names[1]}_{k}" for k in range(3)]
    assert recording.unused == tuple(f"{names[0]}_{k}" for k in range(3))
    (recording,) = read_recordings([path], Request({"effort": names[0]}))
    assert efforts(recording) == [f"{names[0]}_{k}" for k in range(3)]


def test_one_joint_has_a_unit_of_its_own(tmp_path, capsys):
    cells = {"time": T}
    for k, joint in enumerate(("torso_lift", "arm_1", "arm_2")):
        cells |= {f"{joint}_position": Q[:, k], f"{joint}_velocity": V[:, k]}
    path = table(tmp_path / "a.csv", cells)
    said_ = ["--units", "torso lift:position=mm", "position=deg"]
    assert main(["axis", "columns", str(path), *said_]) == 0
    (recording,) = read_recordings([path], Request(units={"torso_lift:position": "mm"}))
    lift, *arm_ = recording.joints.values()
    assert lift.unit == "m" and np.allclose(lift.position, 1e-3 * Q[:, 0])
    assert all(log.unit == "rad" for log in arm_)
    assert np.allclose(arm_[0].position, Q[:, 1])
    assert main(["axis", "columns", str(path), "--units", "neck:position=m"]) == 2
    assert "there is no joint 'neck'; there are torso lift, 1, 2" in capsys.readouterr().err


def test_a_motion_that_was_computed_beside_the_measured_one_is_its_command(tmp_path):
    """One joint moves while the other stands still, and its position goes before what was
    computed, as clocks of their own make it: the numbers alone would turn the two round.
    """
    t = np.arange(0, 6, 0.004)
    wanted = np.clip(t - 1.0, 0.0, 4.0) * 0.3
    moved = np.interp(t + 0.02, t, wanted) + 2e-5 * np.sin(700.0 * t)
    names = ["Time", "Position1", "Position2", "Torque1", "Torque2"]
    names += ["PositionCmptd1", "PositionCmptd2", "TorqueCmptd1", "TorqueCmptd2"]
    pull = np.sin(t) + np.gradient(moved)
    numbers = [t, 1e-5 * np.sin(t), moved, pull, 2 * pull, 0 * t, wanted, 0 * t, pull]
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack(numbers), delimiter=",", header=",".join(names), comments="")
    (recording,) = read_recordings([path], Request())
    taken = columns(recording)
    assert set(taken) == {"1", "2"}
    assert taken["2"]["position"] == "Position2"
    assert taken["2"]["command"] == "PositionCmptd2"
    assert taken["2"]["effort"] == "Torque2"


def test_a_current_of_a_motors_field_is_no_joints_position(tmp_path):
    """`i_q` is a current: the joint's place is `theta`, and there is no joint called i."""
    names = ["t", "theta_des", "theta", "i_q", "i_d", "u_q"]
    numbers = [T, U[:, 0], Q[:, 0], TAU[:, 0], 0.1 * np.sin(T), np.cos(T)]
    path = tmp_path / "log.mat"
    savemat(path, dict(zip(names, numbers, strict=True)))
    (recording,) = read_recordings([path], Request())
    roles = {"command": "theta_des", "position": "theta", "effort": "i_q"}
    assert columns(recording) == {"": roles}
