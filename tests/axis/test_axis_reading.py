"""Logs in the shapes in which robots' logs are published: each is read without help, or with what
a user can say.
"""

from __future__ import annotations

import json
from datetime import datetime, timedelta

import h5py
import numpy as np
import pyarrow as pa
import pytest
from laboratory import SECOND, TAU, N, Q, T, U, V, check, table
from pyarrow import parquet
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from pianobot_ros.axis.reading import Request, read_log, read_recordings
from pianobot_ros.axis.reading.columns.relations import lead
from pianobot_ros.axis.reading.formats import text
from pianobot_ros.cli.app import main
from pianobot_ros.gap import GapError

TURN = 2 * np.pi


def pair(path, **names):
    """A table of two joints; the second does half of what the first does."""
    columns = {"timestamp": T + 1.7e9}
    for name, y in names.items():
        columns |= {name.format(0): y, name.format(1): SECOND * y}
    return table(path, columns)


@pytest.mark.parametrize(
    "names",
    [
        {"target_q_{}": U, "actual_q_{}": Q, "actual_qd_{}": V, "actual_current_{}": TAU},
        {"q_d[{}]": U, "q[{}]": Q, "dq[{}]": V, "tau_J[{}]": TAU, "tau_ext_hat_filtered[{}]": V},
        {"des_dof_pos_{}": U, "dof_pos_{}": Q, "dof_vel_{}": V, "dof_torque_{}": TAU},
        {"ctrl_{}": U, "qpos_{}": Q, "qvel_{}": V, "actuator_force_{}": TAU},
        {
            "/joint_states/joint{}/position": Q,
            "/joint_states/joint{}/velocity": V,
            "/joint_states/joint{}/effort": TAU,
            "/controller/reference/joint{}/position": U,
        },
        {"JointCmd{}": U, "JointPos{}": Q, "JointVel{}": V, "JointTorque{}": TAU},
    ],
    ids=["UR RTDE", "Franka", "PACE", "MuJoCo", "PlotJuggler", "camel case"],
)
def test_wide_tables(tmp_path, names):
    (recording,) = read_recordings([pair(tmp_path / "log.csv", **names)])
    first, second = recording.joints.values()
    check(first, velocity=True, effort=True, tolerance=1e-4)
    assert np.allclose(second.position, SECOND * Q, atol=1e-5)


def test_lists_in_cells_one_file_per_side_and_a_list_of_joints(tmp_path):
    """As NVIDIA's SAGE writes a motion of a robot."""

    def cells(y):
        return ['"[' + ", ".join(f"{x:.9f}" for x in (v, SECOND * v)) + ']"' for v in y]

    kind = ["CONTROL"] * N
    table(tmp_path / "control.csv", {"type": kind, "timestamp": T * 1e6, "positions": cells(U)})
    table(
        tmp_path / "state_motor.csv",
        {
            "type": kind,
            "timestamp": T * 1e6 + 5.0,
            "positions": cells(Q),
            "velocities": cells(V),
            "torques": cells(TAU),
        },
    )
    (tmp_path / "joint_list.txt").write_text("Shoulder\nElbow\n", encoding="utf-8")
    (tmp_path / "event.csv").write_text("type,timestamp,event\nEVENT,0,START\n", encoding="utf-8")
    (recording,) = read_recordings([tmp_path])
    assert list(recording.joints) == ["Shoulder", "Elbow"]
    check(recording.joints["Shoulder"], velocity=True, effort=True, tolerance=1e-4)
    both = [tmp_path / "state_motor.csv", tmp_path / "control.csv"]
    assert list(read_recordings(both)[0].joints) == ["Shoulder", "Elbow"]


def test_a_file_for_each_signal(tmp_path):
    for name, y in (("position", Q), ("command", U), ("torque", TAU)):
        table(tmp_path / f"{name}.csv", {"time": T + 100.0, "value": y})
    check(read_log(tmp_path), effort=True)


def test_desired_and_measured_files_of_one_run(tmp_path):
    for name, q in (("run__desired", U), ("run__measured", Q)):
        table(tmp_path / f"{name}.csv", {"time": T, "position": q, "velocity": V, "torque": TAU})
    (recording,) = read_recordings(sorted(tmp_path.glob("*.csv")))
    check(recording.joints[""], velocity=True, effort=True)


def test_runs_of_one_joint_stay_apart(tmp_path):
    paths = [
        table(tmp_path / f"run{k}.csv", {"time": T, "command": U, "position": Q}) for k in (1, 2)
    ]
    assert len(read_recordings(paths)) == 2
    assert len(read_recordings([tmp_path])) == 2


@pytest.mark.parametrize("names", [["pan", "lift"], [["pan", "lift"]], ["pan.pos", "lift.pos"]])
def test_lerobot(tmp_path, names):
    (tmp_path / "meta").mkdir()
    info = {"fps": 50, "features": {"observation.state": {"names": names}}}
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info), encoding="utf-8")
    both = {
        k: [[np.degrees(x), SECOND * np.degrees(x)] for x in np.tile(y, 2)]
        for k, y in (("action", U), ("observation.state", Q))
    }
    rows = pa.table(
        {
            **both,
            "timestamp": np.tile(T, 2),
            "frame_index": np.tile(np.arange(N), 2),
            "episode_index": np.repeat([0, 1], N),
            "index": np.arange(2 * N),
        }
    )
    path = tmp_path / "data.parquet"
    parquet.write_table(rows, path)
    recordings = read_recordings([path])
    assert len(recordings) == 2
    assert list(recordings[0].joints) == ["pan", "lift"]
    check(recordings[1].joints["pan"])


def test_rhoban_entries(tmp_path):
    entries = [
        {"timestamp": t, "position": q, "speed": v, "goal_position": u, "load": f, "temp": 30}
        | {"torque_enable": True, "input_volts": 12.0}
        for t, q, v, u, f in zip(T, Q, V, U, TAU, strict=True)
    ]
    path = tmp_path / "log.json"
    held = {"mass": 0.5, "length": 0.1, "kp": 8, "entries": entries}
    path.write_text(json.dumps(held), encoding="utf-8")
    check(read_log(path), velocity=True, effort=True, tolerance=1e-4)


def test_a_drive_that_is_mostly_off_is_heard(tmp_path):
    t = np.arange(1000) * 0.02
    u, q = (0.6 * np.sin(2.1 * t + late) for late in (0.1, 0.0))
    path = tmp_path / "log.csv"
    table(path, {"time": t, "command": u, "position": q, "torque_enable": 1.0 * (t > 16.0)})
    log = read_log(path)
    assert any("the drive is off in" in note for note in log.notes)


def test_records_by_line_and_a_row_for_each_joint(tmp_path):
    lines = [
        json.dumps({"t": t, "joint": name, "cmd": k * u, "pos": k * q})
        for t, q, u in zip(T, Q, U, strict=True)
        for name, k in (("hip", 1.0), ("knee", SECOND))
    ]
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(lines), encoding="utf-8")
    (recording,) = read_recordings([path])
    assert list(recording.joints) == ["hip", "knee"]
    check(recording.joints["hip"])


@pytest.mark.parametrize("suffix", ["npz", "mat", "h5"])
def test_arrays(tmp_path, suffix):
    path = tmp_path / f"log.{suffix}"
    held = {"time": T, "q": np.array([Q, SECOND * Q]), "q_des": np.array([U, SECOND * U])}
    if suffix == "npz":
        np.savez(path, **{k: v.T for k, v in held.items()}, mode=np.array(["x"]))
    elif suffix == "mat":
        savemat(path, {"log": held, "note": "a test"})
    else:
        with h5py.File(path, "w") as file:
            for name, y in held.items():
                file[f"robot/{name}"] = y.T
    (recording,) = read_recordings([path])
    assert len(recording.joints) == 2
    check(next(iter(recording.joints.values())))


def test_rate_instead_of_stamps(tmp_path):
    path = tmp_path / "log.npz"
    np.savez(path, position=Q, command=U)
    with pytest.raises(GapError, match="--rate HZ"):
        read_log(path)
    (recording,) = read_recordings([path], Request(rate=50.0))
    check(recording.joints[""])
    np.savez(path, position=Q, command=U, dt=0.02)
    check(read_log(path))


def test_bag_of_joint_and_controller_states(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    stamp, numbers = (
        store.types["builtin_interfaces/msg/Time"],
        store.types["std_msgs/msg/Float64"],
    )
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        joints = bag.add_connection("/joint_states", state.__msgtype__, typestore=store)
        goal = bag.add_connection("/elbow/command", numbers.__msgtype__, typestore=store)
        for t, q, v, f, u in zip(T + 5.0, Q, V, TAU, U, strict=True):
            ns = round(1e9 * t)
            message = state(
                header(stamp(ns // 10**9, ns % 10**9), ""),
                ["elbow"],
                np.array([q]),
                np.array([v]),
                np.array([f]),
            )
            bag.write(joints, ns, store.serialize_cdr(message, state.__msgtype__))
            bag.write(goal, ns, store.serialize_cdr(numbers(u), numbers.__msgtype__))
    check(read_log(tmp_path / "bag"), velocity=True, effort=True, tolerance=1e-4)
    check(read_log(next((tmp_path / "bag").glob("*.mcap"))), velocity=True, effort=True)


def states_of(path, topics):
    """A bag of joint states (position and effort of an elbow) by topic."""
    store = get_typestore(Stores.ROS2_JAZZY)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        for topic, (q, f) in topics.items():
            joints = bag.add_connection(topic, state.__msgtype__, typestore=store)
            for k, t in enumerate(T):
                ns = round(1e9 * (t + 5.0))
                head = header(stamp(ns // 10**9, ns % 10**9), "")
                made = state(head, ["elbow"], q[k : k + 1], np.zeros(0), f[k : k + 1])
                bag.write(joints, ns, store.serialize_cdr(made, state.__msgtype__))
    return path


def test_two_robots_in_one_bag_are_two(tmp_path):
    """The second one's joints, called like the first one's, were dropped among what is not used."""
    other = 0.4 * np.cos(3.3 * T)
    held = {"/left/joint_states": (Q, TAU), "/right/joint_states": (other, V)}
    bag = states_of(tmp_path / "bag", held)
    asked = Request(units={"right elbow:effort": "A"})
    logs = {name: log for run in read_recordings([bag], asked) for name, log in run.joints.items()}
    assert sorted(logs) == ["left elbow", "right elbow"]
    assert np.allclose(logs["left elbow"].position, Q) and np.allclose(
        logs["left elbow"].effort, TAU
    )
    assert np.allclose(logs["right elbow"].position, other)
    assert np.allclose(logs["right elbow"].effort, V) and logs["right elbow"].effort_unit == "A"
    with pytest.raises(GapError, match="no joint 'elbow'; there are left elbow, right elbow"):
        read_recordings([bag], Request(units={"elbow:effort": "A"}))


def test_one_motion_in_two_namespaces_is_of_one_robot(tmp_path):
    held = {"/raw/joint_states": (Q, TAU), "/smooth/joint_states": (Q + 1e-3 * U, TAU)}
    (run,) = read_recordings([states_of(tmp_path / "bag", held)])
    assert list(run.joints) == ["elbow"]


def test_robots_that_move_alike_have_commands_of_their_own(tmp_path):
    held = {f"/{arm}/joint_states": (Q + 1e-3 * U * n, TAU) for n, arm in enumerate(("l", "r"))}
    held |= {f"/{arm}/joint_commands": (U, TAU) for arm in ("l", "r")}
    logs = {}
    for run in read_recordings([states_of(tmp_path / "bag", held)]):
        logs |= run.joints
    assert sorted(logs) == ["l elbow", "r elbow"]
    check(logs["l elbow"], effort=True)
    assert np.allclose(logs["r elbow"].position, Q + 1e-3 * U)


def test_what_leads_an_arm_is_no_robot_beside_it(tmp_path):
    held = {"/leader/joint_states": (U, TAU), "/follower/joint_states": (Q, TAU)}
    (run,) = read_recordings([states_of(tmp_path / "bag", held)])
    assert list(run.joints) == ["elbow"]


def test_dates_with_coarse_and_fine_stamps(tmp_path):
    begin = datetime(2024, 3, 1, 12, 0, 0)
    fine = [(begin + timedelta(seconds=float(t))).isoformat() for t in T]
    check(read_log(table(tmp_path / "a.csv", {"date": fine, "setpoint": U, "actual": Q})))
    coarse = [(begin + timedelta(seconds=int(t))).isoformat(sep=" ") for t in T]
    log = read_log(table(tmp_path / "b.csv", {"Date Time": coarse, "setpoint": U, "actual": Q}))
    check(log)
    assert any("coarse" in n for n in log.notes)


def test_seconds_and_nanoseconds_apart(tmp_path):
    columns = {"sec": np.floor(T) + 1.7e9, "nanosec": np.round((T % 1) * 1e9), "cmd": U, "pos": Q}
    check(read_log(table(tmp_path / "a.csv", columns)))


def test_unsorted_rows(tmp_path):
    shuffled = np.concatenate([np.arange(150, N), np.arange(150)])
    columns = {"time": T[shuffled], "command": U[shuffled], "position": Q[shuffled]}
    log = read_log(table(tmp_path / "a.csv", columns))
    check(log)
    assert any("sorted" in n for n in log.notes)


def test_shuffled_rows_do_not_change_the_unit_of_time(tmp_path):
    k = np.random.default_rng(0).permutation(N)
    columns = {"time": T[k], "command": U[k], "position": Q[k], "velocity": V[k]}
    check(read_log(table(tmp_path / "a.csv", columns)), velocity=True)


@pytest.mark.parametrize("style", ["%d/%m/%Y %H:%M:%S.%f", "%m/%d/%Y %I:%M:%S.%f %p"])
def test_dates_of_other_countries(tmp_path, style):
    begin = datetime(2024, 3, 21, 12, 59, 58)
    when = [(begin + timedelta(seconds=float(t))).strftime(style) for t in T]
    check(read_log(table(tmp_path / "a.csv", {"Date": when, "Setpoint": U, "Actual": Q})))


def test_words_of_other_languages_and_code_pages(tmp_path):
    german = {"Zeit": T, "Sollposition": U, "Istposition": Q, "Drehmoment": TAU}
    check(read_log(table(tmp_path / "a.csv", german, ";", comma=True)), effort=True)
    french = {"temps": T, "consigne": U, "position": Q, "couple": TAU}
    check(read_log(table(tmp_path / "b.csv", french)), effort=True)
    degrees = {"Zeit [s]": T, "Winkel [°]": np.degrees(Q), "Sollwert [°]": np.degrees(U)}
    path = table(tmp_path / "c.csv", degrees, ";")
    path.write_bytes(path.read_text(encoding="utf-8").encode("cp1252"))
    check(read_log(path))


@pytest.mark.parametrize(
    "names",
    [
        {"a": T, "b": U, "c": Q, "d": TAU},
        {"time": T, "setpoint": U, "input": Q, "note": TAU},
        {"time": T, "axis0.controller.input_pos": U / TURN, "axis0.encoder.pos_estimate": Q / TURN},
        {"t_us": T * 1e6, "PCMD_X": U, "PFBK_X": Q, "PERR_X": U - Q},
    ],
    ids=["letters", "PID", "ODrive", "stage"],
)
def test_who_follows_whom_tells_where_names_do_not(tmp_path, names):
    log = read_log(table(tmp_path / "a.csv", names))
    check(log)
    assert log.effort is None


def test_commands_without_joint_names_go_to_the_joints_that_follow_them(tmp_path):
    columns = {"time": T, "fb_j1": Q, "fb_j2": SECOND * Q, "pl_j2": SECOND * U, "pl_j1": U}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    first, second = recording.joints.values()
    check(first)
    assert np.allclose(second.command, SECOND * U, atol=1e-5)


def test_a_motor_s_torque_is_no_commanded_position(tmp_path):
    columns = {"time": T, "qpos_0": Q, "ctrl_0": np.cos(9.0 * T)}
    log = read_log(table(tmp_path / "a.csv", columns))
    assert log.command is None and log.effort is not None


def test_an_output_in_per_cent_is_an_effort(tmp_path):
    columns = {"time": T, "Position": Q, "Setpoint": U, "Output %": TAU}
    log = read_log(table(tmp_path / "a.csv", columns))
    check(log, effort=True)
    assert log.effort_unit == "%"


def test_a_command_of_a_wrapped_position_is_wrapped_no_more(tmp_path):
    columns = {
        "time": T,
        "position_deg": np.degrees(Q) % 360.0,
        "command_deg": np.degrees(U) % 360.0,
    }
    log = read_log(table(tmp_path / "a.csv", columns))
    assert np.abs(log.command - log.position).max() < 1.5 * np.abs(U - Q).max()


def test_a_speed_in_rpm_tells_the_counts_of_a_turn(tmp_path):
    counts = 10_000 / (2 * np.pi)
    columns = {
        "X_Value": T,
        "Position actual value": np.round(Q * counts),
        "Target position": np.round(U * counts),
        "Speed [rpm]": V * 30 / np.pi,
    }
    check(read_log(table(tmp_path / "a.csv", columns)), velocity=True, tolerance=0.01)


def test_two_rows_of_headers_where_one_alone_repeats_itself(tmp_path):
    path = table(
        tmp_path / "a.csv", {"": T, "j1": Q, "j2": SECOND * Q, "j1 ": U, "j2 ": SECOND * U}
    )
    what = "time,position,position,target,target\n"
    path.write_text(what + path.read_text(encoding="utf-8"), encoding="utf-8")
    (recording,) = read_recordings([path])
    check(recording.joints["1"])
    assert list(recording.joints) == ["1", "2"]


@pytest.mark.parametrize(
    "above",
    [
        ["A run,,,,,,", ",Joint 1,,,Joint 2,,", "Time [s],Pos,Cmd,Torque,Pos,Cmd,Torque"],
        ["Time,J1,J1,J1,J2,J2,J2", "s,actual,command,torque,actual,command,torque"],
        [
            ",position,command,torque,position,command,torque",
            "joint,j1,j1,j1,j2,j2,j2",
            "time,,,,,,",
        ],
    ],
    ids=["a name over its columns", "names repeated", "levels of pandas"],
)
def test_headers_over_several_rows(tmp_path, above):
    rows = np.column_stack([T, Q, U, TAU, 2 * Q, 2 * U, 2 * TAU])
    np.savetxt(tmp_path / "a.csv", rows, "%.9g", ",", header="\n".join(above), comments="")
    (recording,) = read_recordings([tmp_path / "a.csv"])
    assert list(recording.joints) == ["1", "2"]
    check(recording.joints["1"], effort=True)
    assert np.allclose(recording.joints["2"].position, 2 * Q, atol=1e-5)
    assert np.allclose(recording.joints["2"].effort, 2 * TAU, atol=1e-5)


@pytest.mark.parametrize("names", [("cmd_deg", "error_deg"), ("cmd [deg]", "following error")])
def test_an_error_has_the_unit_of_its_command(tmp_path, names):
    columns = {"t": T, names[0]: np.degrees(U), names[1]: np.degrees(U - Q)}
    check(read_log(table(tmp_path / "a.csv", columns)))


def test_a_position_that_wraps_follows_a_command_that_does_not(tmp_path):
    columns = {"t": T, "angle_deg": np.degrees(9 * Q) % 360, "target_deg": np.degrees(9 * U)}
    log = read_log(table(tmp_path / "a.csv", columns))
    assert log.command is not None
    assert np.allclose(log.command - log.position, 9 * (U - Q), atol=1e-5)


def test_milliamperes_behind_an_underscore(tmp_path):
    columns = {"time": T, "soll_winkel_grad": np.degrees(U), "ist_winkel_grad": np.degrees(Q)}
    log = read_log(table(tmp_path / "a.csv", {**columns, "motor_strom_mA": 1e3 * TAU}))
    check(log, effort=True)
    assert log.effort_unit == "A" and np.allclose(log.effort, TAU, atol=1e-6)


def test_servos_asked_in_turn_by_number(tmp_path):
    columns = {
        "time": np.repeat(T, 2) + np.tile([0.0, 1e-3], N),
        "id": np.tile([11.0, 12.0], N),
        "goal_position_rad": np.column_stack([U, SECOND * U]).ravel(),
        "present_position_rad": np.column_stack([Q, SECOND * Q]).ravel(),
    }
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert list(recording.joints) == ["11", "12"]
    check(recording.joints["11"])


def test_one_reference_for_all_runs_of_a_folder(tmp_path):
    for name, q in (("run_1", Q), ("run_2", Q), ("ref_pos", U)):
        table(tmp_path / f"{name}.csv", {"time": T, "pos_rad": q})
    for recording in read_recordings([tmp_path]):
        check(recording.joints[""])


def test_simulink_signals_with_their_own_time(tmp_path):
    from scipy.io import savemat

    def signal(y):
        return {"time": T, "signals": {"values": y}}

    held = {"theta": signal(Q), "theta_ref": signal(U), "current": signal(TAU)}
    savemat(tmp_path / "out.mat", {"logsout": held})
    check(read_log(tmp_path / "out.mat"), effort=True)


def test_joint_names_that_stand_in_every_row(tmp_path):
    columns = {"%time": T * 1e9 + 1.7e18, "field.name0": ["hip"] * N, "field.name1": ["knee"] * N}
    columns |= {"field.position0": Q, "field.position1": Q}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert list(recording.joints) == ["hip", "knee"]
    listed = {"time": T, "name": ['"[hip, knee]"'] * N}
    listed["position"] = [f'"[{q:.15g}, {q:.15g}]"' for q in Q]
    (recording,) = read_recordings([table(tmp_path / "b.csv", listed)])
    assert list(recording.joints) == ["hip", "knee"]


def test_linear_axis(tmp_path):
    columns = {
        "time [s]": T,
        "x_ref [mm]": 1e3 * U,
        "x [mm]": 1e3 * Q,
        "v [mm/s]": 1e3 * V,
        "F [N]": TAU,
    }
    log = read_log(table(tmp_path / "a.csv", columns, ";", comma=True))
    check(log, velocity=True, effort=True, tolerance=1e-4)
    assert (log.unit, log.effort_unit) == ("m", "N")


def test_a_row_of_units(tmp_path):
    path = tmp_path / "a.csv"
    rows = ["Exported by a tool;;;", "Time;SetPos;ActPos;ActCurrent", "ms;deg;deg;mA"]
    rows += [
        f"{1e3 * t:.3f};{np.degrees(u):.7f};{np.degrees(q):.7f};{1e3 * i:.5f}"
        for t, u, q, i in zip(T, U, Q, TAU, strict=True)
    ]
    path.write_text("\n".join(rows), encoding="utf-8")
    log = read_log(path)
    check(log, effort=True)
    assert log.effort_unit == "A"
    assert log.effort is not None and np.allclose(log.effort, TAU, atol=1e-6)


def test_small_degrees_beside_radians(tmp_path):
    small = {"time": T, "command": 0.1 * U, "position": np.degrees(0.1 * Q)}
    log = read_log(table(tmp_path / "a.csv", small))
    assert np.allclose(log.position, 0.1 * Q, atol=1e-6)
    assert any("deg" in n for n in log.notes)


def test_degrees_by_the_encoder_s_steps(tmp_path):
    step = 360.0 / 4096
    small = {"time": T, "position": step * np.round(np.degrees(0.15 * Q) / step), "torque": TAU}
    log = read_log(table(tmp_path / "a.csv", small))
    assert np.allclose(log.position, 0.15 * Q, atol=1e-3)


def test_many_turns_in_rad_beside_their_torque(tmp_path):
    t = np.arange(0, 20, 0.01)
    q = 9.0 * np.sin(0.9 * t) + 5.0 * np.sin(0.31 * t)
    torque = 0.1 * np.gradient(np.gradient(q, t), t) + 2.0 * np.sin(q)
    log = read_log(table(tmp_path / "a.csv", {"time": t, "position": q, "torque": torque}))
    assert np.allclose(log.position, q, atol=1e-5)


@pytest.mark.parametrize("sign", [1, -1])
def test_position_error_instead_of_position(tmp_path, sign):
    columns = {"time": T, "reference": U, "tracking_error": sign * (U - Q)}
    log = read_log(table(tmp_path / "a.csv", columns))
    check(log)
    assert any("error" in n for n in log.notes)


def test_headerless_with_columns(tmp_path):
    path = table(tmp_path / "a.txt", {"0": T, "1": U, "2": Q}, " ", header=False)
    check(read_log(path))
    check(read_log(path, {"time": "0", "command": "1", "position": "2"}))


def test_a_sparse_command_beside_a_fast_state(tmp_path):
    """An export that gives every topic its own rows."""
    t = np.concatenate([T, T + 0.004])
    order = np.argsort(t)
    command = np.concatenate([np.full(N, np.nan), np.interp(T + 0.004, T, U)])
    position = np.concatenate([Q, np.full(N, np.nan)])
    cells = {"time": t[order], "command": command[order], "position": position[order]}
    log = read_log(table(tmp_path / "a.csv", cells))
    assert np.nanmax(np.abs(log.position - Q[: log.t.size])) < 1e-4
    assert log.command is not None
    assert np.nanmax(np.abs(log.command - U[: log.t.size])[2:-2]) < 2e-3


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", "", "empty"),
        ("a.csv", "hello\nworld\n" * 30, "no numbers"),
        ("a.csv", "time,speed\n" + "\n".join(f"{t},{v}" for t, v in enumerate(V)), "position"),
        ("a.pt", "x", "pickled"),
        ("a.xlsx", "x", "CSV"),
        ("a.mat", "x" * 200, "cannot be read"),
        ("a.parquet", "x" * 200, "cannot be read"),
        ("a.json", "{}", "no list of records"),
        ("a.mcap", "x" * 200, "bag"),
        ("a.mcap", "x" * 6, "bag"),
    ],
)
def test_what_is_no_log_says_so_in_one_line(tmp_path, capsys, name, content, words):
    (tmp_path / name).write_text(content, encoding="utf-8")
    assert main(["axis", "columns", str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert words in error


def test_columns_that_share_a_row_lead_nowhere():
    one = np.where(np.arange(50) == 7, 1.0, np.nan)
    assert lead(one, one) == 0.0


def test_columns_says_what_is_read_as_what(tmp_path, capsys):
    path = pair(
        tmp_path / "log.csv", **{"target_q_{}": U, "actual_q_{}": Q, "actual_TCP_pose_{}": Q}
    )
    assert main(["axis", "columns", str(path), "--json"]) == 0
    (listed,) = json.loads(capsys.readouterr().out)["recordings"]
    assert listed["joints"]["0"]["columns"]["position"]["header"] == "actual_q_0"
    assert listed["joints"]["0"]["columns"]["command"]["unit"] == "rad"
    assert listed["joints"]["1"]["rate"] == pytest.approx(50.0)
    assert "actual_TCP_pose_1" in listed["unused"]
    assert main(["axis", "columns", str(path)]) == 0
    assert "no velocity, effort" in capsys.readouterr().out


@pytest.mark.parametrize("shuffled", [False, True])
def test_a_long_log_is_averaged_while_it_is_read(tmp_path, monkeypatch, shuffled):
    monkeypatch.setattr("pianobot_ros.axis.reading.formats.table.LARGE", 1000)
    monkeypatch.setattr(text, "PIECE", 256)
    t = np.arange(3000) * 0.002
    q, u = 0.6 * np.sin(2.1 * t) + 0.2, 0.6 * np.sin(2.1 * t + 0.1) + 0.2
    k = np.random.default_rng(0).permutation(t.size) if shuffled else np.arange(t.size)
    path = table(tmp_path / "a.csv", {"time": t[k], "command": u[k], "position": q[k]})
    log = read_log(path)
    assert log.t.size <= 1000
    assert any("averaged in groups of 4" in n for n in log.notes)
    at = log.t + np.arcsin((log.position[0] - 0.2) / 0.6) / 2.1
    assert np.allclose(log.position, 0.6 * np.sin(2.1 * at) + 0.2, atol=1e-4)
    assert log.command is not None
    assert np.allclose(log.command, 0.6 * np.sin(2.1 * at + 0.1) + 0.2, atol=1e-4)
    without = read_recordings([table(tmp_path / "b.csv", {"command": u, "position": q})], RATE_500)
    assert without[0].joints[""].t[-1] == pytest.approx(t[-1], abs=0.01)


RATE_500 = Request(rate=500.0)
