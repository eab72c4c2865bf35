"""Small logs in the forms of some that others publish."""

from __future__ import annotations

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from laboratory import TAU, Q, T, U, V, check, table
from scipy.io import savemat

from pianobot_ros.axis.reading import Request, read_log, read_recordings
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.gap import GapError


@pytest.mark.parametrize("word", ["q_ddot", "theta_ddot", "q_dot_dot", "thetaddot", "xddot"])
def test_a_second_derivative_is_no_position(word):
    assert meaning(f"{word}_filtered[2]").role == "acceleration"
    assert meaning(f"{word.replace('ddot', 'dot').replace('dot_dot', 'dot')}[2]").role == "velocity"


@pytest.mark.parametrize(
    ("word", "role"),
    [
        ("jointacttorque", "effort"),
        ("measuredjointpos1", "position"),
        ("jointtargetpos1", "command"),
        ("positioncontroller", "position"),
    ],
)
def test_three_words_may_be_written_as_one(word, role):
    assert meaning(word).role == role


def test_arrays_of_a_filter_are_the_joints_they_are_of(tmp_path):
    of = {"q_filtered": Q, "q_dot_filtered": V, "jointacttorque_filtered": TAU}
    of |= {"q_ddot_filtered": np.gradient(V, T)}
    savemat(tmp_path / "run.mat", {"t": T} | {h: np.stack([y, 2 * y], 1) for h, y in of.items()})
    (run,) = read_recordings([tmp_path / "run.mat"])
    assert list(run.joints) == ["0", "1"]
    check(run.joints["0"], command=False, velocity=True, effort=True)


@pytest.mark.parametrize("resting", [0.0, 1e-4])
def test_one_joint_that_moves_alone_tells_the_blocks_of_a_table(tmp_path, resting):
    noise = np.random.default_rng(4).normal(size=(4, T.size)) * resting
    q = np.degrees(Q) + 90.0
    rpm = np.gradient(q, T) / 6.0
    rows = [T, noise[0], q, noise[1] + 2.0, noise[2], rpm, noise[3], TAU * 0.1, TAU, TAU * 0.2]
    np.savetxt(tmp_path / "arm.txt", np.stack(rows, 1))
    (run,) = read_recordings([tmp_path / "arm.txt"])
    log = run.joints["2"]
    check(
        replace(log, position=log.position - np.radians(90.0)),
        command=False,
        velocity=True,
        effort=True,
    )


def test_what_rests_is_no_slope_of_what_moves(tmp_path):
    leaning = 0.9 + 1e-4 * np.gradient(Q, T)
    columns = [T, Q, 0.3 + 1e-6 * TAU, leaning, 2.0 - 1e-6 * TAU, TAU, TAU**2]
    np.savetxt(tmp_path / "arm.txt", np.stack(columns, 1))
    with pytest.raises(GapError, match="no column of positions"):
        read_recordings([tmp_path / "arm.txt"])


def test_arrays_of_other_lengths_in_one_file_are_not_called_files(tmp_path):
    savemat(tmp_path / "run.mat", {"opt": np.stack([Q, V, TAU]), "solved": np.linspace(0, 1, 31)})
    with pytest.raises(GapError, match="holds arrays of 300 and of 31 rows"):
        read_recordings([tmp_path / "run.mat"])


@pytest.mark.parametrize("owner", ["data set", "file", "group", "positions", "text"])
def test_names_of_joints_in_hdf5(tmp_path, owner):
    names = ["shoulder", "elbow"]
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["time"] = T
        of = {"joint_positions": Q, "joint_targets": U, "joint_torques": TAU}
        for key, y in of.items():
            file[f"arm/{key}"] = np.stack([y, 2 * y], 1)
        if owner == "data set":
            file["joint_names"] = names
        at = {"file": file, "group": file["arm"], "positions": file["arm/joint_positions"]}
        if owner != "data set":
            at.get(owner, file).attrs["joint_names"] = (
                "shoulder, elbow" if owner == "text" else names
            )
    (run,) = read_recordings([tmp_path / "run.h5"])
    assert list(run.joints) == names
    check(run.joints["shoulder"], effort=True)


def test_names_of_joints_beside_arrays_that_are_all_as_wide(tmp_path):
    of = {"q_rad": Q, "q_desired_rad": U, "tau_J_Nm": TAU}
    np.savez(tmp_path / "run.npz", time_s=T, **{h: np.stack([y, 2 * y], 1) for h, y in of.items()})
    told = {"limits": {"names": ["a", "b"]}, "joint_order": ["shoulder", "elbow"]}
    (tmp_path / "recording.json").write_text(json.dumps(told), encoding="utf-8")
    (run,) = read_recordings([tmp_path / "run.npz"])
    assert list(run.joints) == ["shoulder", "elbow"]
    check(run.joints["shoulder"], effort=True)


def test_what_is_of_no_joint_says_nothing_of_units(tmp_path):
    of = {"ctrl_input": 90.0 * V, "joint_angle": Q, "joint_ref": U}
    columns = {"t": T} | {f"{h}_{k}": y for h, y in of.items() for k in range(4)}
    (run,) = read_recordings([table(tmp_path / "quadruped.csv", columns)])
    check(run.joints["3"])


def test_rows_that_are_numbered_before_each_channel_are_no_joint(tmp_path):
    of = {"Position demand value [0x6062/0]": U, "Position actual value [0x6064/0]": Q}
    cells = {h: np.round(1e5 * y) for h, y in of.items()}
    rows = np.arange(T.size)
    heads = [",,".join(cells) + ",", ",".join(["X,Y"] * len(cells))]
    body = zip(*(y for cell in cells.values() for y in (rows, cell)), strict=True)
    lines = [*heads, *(",".join(f"{x:.0f}" for x in row) for row in body)]
    (tmp_path / "scope.csv").write_text("\n".join(lines), encoding="utf-8")
    (run,) = read_recordings([tmp_path / "scope.csv"], Request(rate=50.0))
    assert len(run.joints) == 1


def test_a_servo_s_speed_is_in_the_counts_of_its_position(tmp_path):
    turn = 4096 / (2 * np.pi)
    t = np.arange(0.0, 30.0, 0.1)
    move, speed = 0.5 * np.sin(2.5 * t), 1.25 * np.cos(2.5 * t)
    columns = {"t": t, "pos": np.round(turn * move) + 2048, "speed": np.round(turn * speed)}
    log = read_log(table(tmp_path / "servo.csv", columns))
    assert np.allclose(log.velocity, speed, atol=1 / turn)
    assert any("velocity taken as counts/s" in n for n in log.notes)


def test_a_servo_s_registers_beside_what_a_program_makes_of_them(tmp_path):
    turn = 4096 / (2 * np.pi)
    late = 0.6 * np.sin(2.1 * T + 0.05) + 0.2
    columns = {
        "time_s": T,
        "position_trajectory_rad": late,
        "position_trajectory_tick": np.round(turn * late) + 2048,
        "q_cmd_rad": U,
        "goal_position_tick": np.round(turn * U) + 2048,
        "q_present_rad": Q,
        "present_position_tick": np.round(turn * Q) + 2048,
        "velocity_trajectory_rad_s": np.gradient(late, T),
        "current_A_joint": TAU,
    }
    (run,) = read_recordings([table(tmp_path / "telemetry.csv", columns)])
    assert list(run.joints) == [""]
    check(run.joints[""], effort=True)


def test_a_trajectory_alone_is_what_was_recorded():
    assert meaning("trajectory_position_1", ["time", "trajectory_position_1"]).role == "position"


def test_cells_of_arrays_are_refused_by_their_names(tmp_path):
    cells = np.empty(2, object)
    cells[:] = [Q, Q[:200]]
    savemat(tmp_path / "runs.mat", {"raw": {"pos_select": cells, "tau_select": cells}})
    with pytest.raises(GapError, match=r"cells of arrays \(raw.pos_select, raw.tau_select\)"):
        read_recordings([tmp_path / "runs.mat"])


def test_a_refusal_says_how_columns_without_names_are_named_and_what_a_speed_is_for(tmp_path):
    np.savetxt(tmp_path / "a.txt", np.stack([T, TAU, np.cos(9.0 * T)], 1))
    with pytest.raises(GapError, match="numbers from 0"):
        read_recordings([tmp_path / "a.txt"])
    with pytest.raises(GapError, match="a speed alone must be summed up"):
        read_recordings([table(tmp_path / "b.csv", {"t": T, "rpm": V, "out": TAU})])


@pytest.mark.parametrize("standing", [0.0, 7.0])
def test_a_counter_that_stands_shifts_no_blocks(tmp_path, standing):
    first = [np.full(T.size, standing), *(k * Q for k in (1.0, 0.5, -0.7))]
    columns = [T, *first, *(k * V for k in (1.0, 0.5, -0.7)), *(k * TAU for k in (1.0, 2.0, 3.0))]
    np.savetxt(tmp_path / "arm.txt", np.stack(columns, 1))
    (run,) = read_recordings([tmp_path / "arm.txt"])
    assert list(run.joints) == ["1", "2", "3"]
    check(run.joints["1"], command=False, velocity=True, effort=True)


def test_an_axis_that_rests_has_a_slope_that_rests(tmp_path):
    other = 0.5 * np.sin(3.3 * T)
    columns = [T, 1e-9 * TAU, Q, other, Q + 1.0, V, np.gradient(other, T), TAU]
    np.savetxt(tmp_path / "arm.txt", np.stack(columns, 1))
    with pytest.raises(GapError, match="no column of positions"):
        read_recordings([tmp_path / "arm.txt"])


def test_what_rests_by_a_few_steps_follows_nothing(tmp_path):
    steps = np.round(1.6 * np.sin(2.1 * T))
    columns = {"a": T, "b": 0.001 * np.round(1.6 * np.sin(2.1 * T + 0.4)), "c": 0.001 * steps}
    with pytest.raises(GapError, match="no column of positions"):
        read_recordings([table(tmp_path / "arm.csv", columns, header=False)])


def test_accelerations_of_an_arm_of_which_some_joints_rest_are_no_efforts(tmp_path):
    noise = np.random.default_rng(3).normal(size=(9, T.size)) * 1e-3
    move = np.cumsum(np.where((T > 2.0) & (T < 4.0), np.sin(np.pi * T), 0.0)) * 0.02
    q, v = [move, *noise[:2]], [np.gradient(move, T), *noise[2:4]]
    a = [np.gradient(v[0], T), *(0.3 + 50.0 * noise[4:6])]
    wanted = [np.roll(move, -3), *noise[6:8]]
    np.savetxt(tmp_path / "arm.txt", np.stack([T, *q, *v, *a, *wanted], 1))
    (run,) = read_recordings([tmp_path / "arm.txt"])
    assert run.joints["1"].effort is None and run.joints["1"].command is not None
