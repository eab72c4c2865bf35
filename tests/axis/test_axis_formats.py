"""Logs as robots' and drives' own programs write them."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
from laboratory import TAU, Q, T, U, V, check, table
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.io import savemat

from pianobot_ros.axis.reading import read_log, read_recordings
from pianobot_ros.gap import GapError


def test_a_time_within_a_message_is_not_when_it_was_made(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    point = "trajectory_msgs/JointTrajectoryPoint"
    fields = f"std_msgs/Header header\nstring[] joint_names\n{point} reference\n{point} feedback\n"
    name = "control_msgs/msg/State"
    store.register(get_types_from_msg(fields, name))
    kinds = store.types
    stamp, duration = (kinds[f"builtin_interfaces/msg/{k}"] for k in ("Time", "Duration"))
    state = kinds["trajectory_msgs/msg/JointTrajectoryPoint"]

    def at(q, v, ns):
        return state(np.array([q]), np.array([v]), np.zeros(0), np.zeros(0), duration(0, ns % 9))

    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topic = bag.add_connection("/controller_state", name, typestore=store)
        for t, q, v, u in zip(T + 5.0, Q, V, U, strict=True):
            ns = round(1e9 * t)
            header = kinds["std_msgs/msg/Header"](stamp(ns // 10**9, ns % 10**9), "")
            message = kinds[name](header, ["tilt_joint"], at(u, 0.0, ns), at(q, v, ns))
            bag.write(topic, ns, store.serialize_cdr(message, name))
    (found,) = read_recordings([tmp_path / "bag"])
    assert list(found.joints) == ["tilt"]
    check(found.joints["tilt"], velocity=True)


def test_the_time_of_a_trajectory_point_in_a_table_is_none(tmp_path):
    zero = np.zeros(T.size)
    of = {"desired.time_from_start.secs": zero, "desired.time_from_start.nsecs": zero}
    columns = of | {"%time": T, "desired.positions0": U, "actual.positions0": Q}
    check(read_log(table(tmp_path / "state.csv", columns)))
    check(read_log(table(tmp_path / "own.csv", {"time_from_start": T, "cmd": U, "pos": Q})))


@pytest.mark.parametrize("alone", [True, False])
def test_a_scope_of_simulink_has_one_time_for_its_signals(tmp_path, alone):
    of = {"phi_soll": U, "phi_ist": Q, "M_mot": TAU}
    signals = [{"values": y.reshape(-1, 1), "label": name} for name, y in of.items()]
    scope = {"time": T.reshape(-1, 1), "signals": signals, "blockName": "joint/Scope"}
    savemat(tmp_path / "scope.mat", {"ScopeData": scope} | ({} if alone else {"gain": 3.0}))
    log = read_log(tmp_path / "scope.mat")
    check(log, effort=True)
    assert log.effort_unit == "Nm"


@pytest.mark.parametrize(
    "names",
    [
        ("ref/q_des", "link/position", "motor/position", "motor/velocity", "motor/current"),
        ("Sollwinkel", "Abtriebswinkel", "Motorwinkel", "Motordrehzahl", "Motormoment"),
    ],
)
def test_the_encoder_behind_the_gear_is_the_joint_s(tmp_path, names):
    columns = dict(zip(names, (U, Q, 100 * Q, 100 * V, TAU), strict=True))
    log = read_log(table(tmp_path / "log.csv", {"time": T, **columns}))
    check(log, velocity=True, effort=True)
    assert any("motor" in n.lower() and "left out" in n for n in log.notes)


def test_registers_of_moteus_are_in_turns(tmp_path):
    turn = 2 * np.pi
    columns = {"timestamp": T, "command_position": U / turn, "MODE": 10 + 0 * T}
    columns |= {"POSITION": Q / turn, "VELOCITY": V / turn, "TORQUE": TAU, "Q_CURRENT": TAU}
    log = read_log(table(tmp_path / "log.csv", columns | {"D_CURRENT": 0 * T}))
    check(log, velocity=True, effort=True)
    assert any("moteus" in n for n in log.notes)


def test_registers_of_moteus_are_in_turns_also_under_the_names_of_its_library(tmp_path):
    turn = 2 * np.pi
    columns = {"time": T, "control_position": U / turn, "position": Q / turn, "velocity": V / turn}
    log = read_log(table(tmp_path / "log.csv", columns | {"torque": TAU, "q_current": TAU}))
    check(log, velocity=True, effort=True)


def test_a_link_beside_a_motor_in_a_structure_of_matlab(tmp_path):
    held = {"t": T, "q_ref": U, "q_m": Q, "q_l": Q + 1e-3 * TAU, "tau_m": TAU}
    savemat(tmp_path / "run07.mat", {"log": {k: v.reshape(-1, 1) for k, v in held.items()}})
    (found,) = read_recordings([tmp_path / "run07.mat"])
    check(next(log for log in found.joints.values() if log.command is not None), effort=True)


def test_the_rate_of_demonstrations_stands_in_the_environments_arguments(tmp_path):
    with h5py.File(tmp_path / "demo.hdf5", "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": 1.0 / (T[1] - T[0])}})
        for k in range(2):
            data[f"demo_{k}/actions"] = np.stack([U, np.sign(U)], axis=1)
            data[f"demo_{k}/obs/robot0_joint_pos"] = Q.reshape(-1, 1)
    first, second = read_recordings([tmp_path / "demo.hdf5"])
    for found in (first, second):
        (log,) = found.joints.values()
        assert np.median(np.diff(log.t)) == pytest.approx(T[1] - T[0])


def test_what_stands_still_is_no_velocity_of_what_moves(tmp_path):
    columns = {"time": T, "angle": Q, "speed_meters_per_sec": 0 * T, "erpm": 66.8 * V}
    log = read_log(table(tmp_path / "log.csv", columns | {"current_motor": TAU}))
    check(log, command=False, velocity=True, effort=True)


def test_letters_of_a_type_are_no_part_of_a_name(tmp_path):
    names = ("fSollPosition", "fIstPosition", "fIstGeschw", "nIstMoment")
    columns = {f"MAIN.st.{n}": y for n, y in zip(names, (U, Q, V, TAU), strict=True)}
    check(read_log(table(tmp_path / "log.csv", {"time": T, **columns})), velocity=True, effort=True)


@pytest.mark.parametrize("stamp", ["{:.3f} > ", "15:02:{:06.3f} > "])
def test_a_monitor_s_numbers_have_no_header_but_their_stamps(tmp_path, stamp):
    """The velocity stands before its position, what alone is left is the effort."""
    head = ["MOT: Monitor enabled!", "MOT: Zero elec. angle: 3.87", "MOT: Ready."]
    rows = [f"{u:.6f}\t{f:.6f}\t{v:.6f}\t{q:.6f}" for u, f, v, q in zip(U, TAU, V, Q, strict=True)]
    rows = [stamp.format(t) + row for t, row in zip(T, rows, strict=True)]
    rows.insert(150, stamp.format(T[150]) + "Warn: \\r detected!")
    text = "\n".join([*(stamp.format(0.0) + x for x in head), *rows])
    (tmp_path / "monitor.log").write_text(text)
    log = read_log(tmp_path / "monitor.log")
    check(log, velocity=True, effort=True, tolerance=1e-4)
    assert any("position=4, velocity=3, command=1, effort=2" in n for n in log.notes)


def test_a_dumper_s_folders_are_one_run(tmp_path):
    """A folder says what its bottles are; stamps of the two are apart, as nobody syncs them."""
    held = {"stateExt": [], "reference": []}
    for k, (t, q, v, f, u) in enumerate(zip(T + 1.7e9, Q, V, TAU, U, strict=True)):
        lists = [(q, 2 * q), (v, 2 * v), (0, 0), (100 * q, 0), (100 * v, 0), (0, 0), (f, f)]
        lists += [(0, 0), (0, 0), (9, 9), (9, 9)]
        bottle = " ".join(f"({a:.6f} {b:.6f}) 1" for a, b in lists)
        held["stateExt"].append(f"{k} {t:.6f} {t - 4e-4:.6f} {bottle}")
        held["reference"].append(f"{k} {t - 1e-3:.6f} {u:.6f} {2 * u:.6f}")
    for name, lines in held.items():
        (tmp_path / "leg" / name).mkdir(parents=True)
        (tmp_path / "leg" / name / "data.log").write_text("\n".join(lines))
        info = f"Type: Bottle;\n[0.0] /icub/{name}:o [connected]\n"
        (tmp_path / "leg" / name / "info.log").write_text(info)
    (found,) = read_recordings([tmp_path])
    assert list(found.joints) == ["0", "1"]
    check(found.joints["0"], velocity=True, effort=True, tolerance=2e-3)


@pytest.mark.parametrize("order", ["BLOCK", "KANAL"])
def test_channels_in_a_file_beside_their_headers(tmp_path, order):
    for axis in (1, 2):
        name = f"PICK_NextGenDrive#{axis}"
        of = {
            "Sollposition": (np.degrees(U), "Grad", 1e-4),
            "Istposition": (np.degrees(Q), "Grad", 1e-4),
        }
        of["Istmoment"] = TAU, "Nm", 1e-2
        raw = np.column_stack([y / factor for y, _, factor in of.values()])
        (raw if order == "BLOCK" else raw.T).astype("<f8").tofile(tmp_path / f"{name}.r64")
        time = {200: "Zeit", 202: "s", 210: "IMPLIZIT", 220: T.size, 240: 0, 241: 0.02}
        channels = [time]
        for k, (channel, (_, unit, factor)) in enumerate(of.items()):
            first = k + 1 if order == "BLOCK" else k * T.size + 1
            said = {200: channel, 202: unit, 210: "EXPLIZIT", 211: f"{name}.r64", 213: order}
            channels.append(said | {214: "REAL64", 220: T.size, 221: first, 241: factor})
        lines = ["#BEGINGLOBALHEADER", "103,KUKA", "#ENDGLOBALHEADER"]
        for said in channels:
            lines += ["#BEGINCHANNELHEADER", *(f"{k},{v}" for k, v in said.items())]
            lines += ["#ENDCHANNELHEADER", ""]
        (tmp_path / f"{name}.dat").write_text("\r\n".join(lines))
    found = read_recordings([tmp_path])
    assert [list(run.joints) for run in found] == [["1"], ["2"]]
    log = found[0].joints["1"]
    check(log, effort=True)
    assert not any("no unit" in n or "taken as degrees" in n for n in log.notes)
    (tmp_path / "PICK_NextGenDrive#1.r64").unlink()
    with pytest.raises(GapError, match="numbers are in PICK_NextGenDrive#1.r64, which is not"):
        read_log(tmp_path / "PICK_NextGenDrive#1.dat")
    said = (tmp_path / "PICK_NextGenDrive#2.dat").read_text()
    wrong = tmp_path / "wrong.dat"
    wrong.write_text(said.replace(f"220,{T.size}", f"220,{10**12}"))
    with pytest.raises(GapError, match="a channel of 1000000000000 rows"):
        read_log(wrong)


def test_a_file_beside_arrays_says_their_rate_and_names(tmp_path):
    np.savez(
        tmp_path / "ep0.npz",
        obs=np.column_stack([Q, V, TAU]),
        actions=np.column_stack([U / 1.4, V]),
    )
    with pytest.raises(GapError, match="no column of time stamps; .*--rate HZ"):
        read_log(tmp_path / "ep0.npz")
    told = {"dt": 0.02, "observation": ["elbow_pos", "elbow_vel", "elbow_torque"]}
    told |= {"action": ["elbow_target", "spare"], "action_space": {"scale_to_rad": [1.4, 1.0]}}
    (tmp_path / "metadata.json").write_text(json.dumps(told))
    for path in (tmp_path, tmp_path / "ep0.npz"):
        log = read_recordings([path])[0].joints["elbow"]
        check(log, velocity=True, effort=True)
        assert any("metadata.json" in n for n in log.notes)


def test_a_folder_of_what_is_not_read_says_why(tmp_path):
    (tmp_path / "rollout.pkl").write_bytes(b"\x80\x04N.")
    with pytest.raises(GapError, match="pickled files may run any code"):
        read_log(tmp_path)


@pytest.mark.filterwarnings("error")
def test_columns_that_do_not_move_divide_nothing(tmp_path):
    big = {f"c{k}": np.full(T.size, 1e300 * (k == 2)) for k in range(4)} | {"q": 1e9 * Q}
    rows = zip(T, *big.values(), strict=True)
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(f"{x:.6g}" for x in row) for row in rows))
    with pytest.raises(GapError):
        read_log(path)


def test_a_row_of_units_says_so_before_each_channel(tmp_path):
    channels = {"Axis.SetPos": (1e3 * U, "mm"), "Axis.ActPos": (1e3 * Q, "mm")}
    channels |= {"Axis.ActTorque": (TAU, "%"), "Term.Temp": (0 * T + 24.3, "°C")}
    rows = [
        ";".join(f"Name;{name}" for name in channels),
        ";".join("SampleTime[ms];20" for _ in channels),
        ";".join(f"Unit;{unit}" for _, unit in channels.values()),
    ]
    for k, t in enumerate(1e3 * T):
        rows.append(";".join(f"{t:g};{y[k]:.6f}".replace(".", ",") for y, _ in channels.values()))
    (tmp_path / "scope.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    log = read_log(tmp_path / "scope.csv")
    check(log, effort=True)
    assert log.unit == "m" and log.effort_unit == "%"


def test_telemetry_of_yarp_says_whose_each_row_is(tmp_path):
    joints = ("r_hip", "r_knee")

    def signal(y):
        held = {"data": np.stack([y, np.roll(y, 40)]), "timestamps": T + 1.7e9}
        return held | {"elements_names": np.array(joints, object), "name": "positions"}

    joint = {"positions": signal(Q), "position_references": signal(U), "torques": signal(TAU)}
    motor = {"positions": signal(Q + 1e-3 * np.sin(30.0 * T)), "temperatures": signal(0 * T)}
    states = {"joints_state": joint, "motors_state": motor, "yarp_robot_name": "one"}
    savemat(tmp_path / "run.mat", {"robot_logger_device": states})
    (found,) = read_recordings([tmp_path / "run.mat"])
    assert [name.split()[-1] for name in found.joints] == ["hip", "knee"]
    hip = next(iter(found.joints.values()))
    assert hip.link == pytest.approx(Q) and hip.command == pytest.approx(U)


def test_a_group_of_one_trial_names_no_quantity(tmp_path):
    with h5py.File(tmp_path / "bench.h5", "w") as file:
        file["trial_01/time"] = T
        for joint in ("hip", "knee"):
            for name, y in {"q_des": U, "q": Q, "qd": V, "tau": TAU}.items():
                file[f"trial_01/{joint}/{name}"] = y
    (found,) = read_recordings([tmp_path / "bench.h5"])
    assert len(found.joints) == 2
    for log in found.joints.values():
        check(log, velocity=True, effort=True)


def test_parameters_numbers_and_fingers_are_told_from_commands_and_rows(tmp_path):
    names = ("Drive_Z.r2665: setpoint", "Drive_Z.r2521[0]: position actual", "Drive_Z.r80: Torque")
    columns = dict(zip(names, (U, Q, TAU), strict=True))
    log = read_log(table(tmp_path / "trace.csv", {"Time": T} | columns))
    check(log, effort=True)
    assert not any("not what was measured" in note for note in log.notes)
    held = {f"fingers.{f}.pos": Q for f in ("thumb", "index")}
    (found,) = read_recordings([table(tmp_path / "hand.csv", {"time": T} | held)])
    assert sorted(found.joints) == ["fingers index", "fingers thumb"]


def test_a_column_called_unit_is_no_row_of_units(tmp_path):
    rows = ["export;of;run;7", "time;command;position;unit"]
    rows += [f"{t:.3f};{u:.9f};{q:.9f};rad" for t, u, q in zip(T, U, Q, strict=True)]
    (tmp_path / "run.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    check(read_log(tmp_path / "run.csv"))


@pytest.mark.parametrize("name", ["dict.npy", "dict.npz"])
def test_pickles_of_numpy_say_how_to_save_them(tmp_path, name):
    held = {"t": T, "q": Q, "tau": TAU}
    if name.endswith("y"):
        np.save(tmp_path / name, held)
    else:
        np.savez(tmp_path / name, data=np.array(held, object))
    with pytest.raises(GapError, match=r"pickled objects.*numpy\.savez"):
        read_recordings([tmp_path / name])


def test_numbers_in_what_python_prints_around_them(tmp_path):
    """`csv.writer` writes the `repr` of lists; NumPy 2 says the type of each of its scalars."""
    lines = ["time,q,q_des,tau"]
    for t, q, u, tau in zip(T, Q, U, TAU, strict=True):
        cells = f"np.float64({t:.3f}),[np.float64({q:.9f})],\"tensor({u:.9f}, device='cuda:0')\""
        lines.append(f'{cells},"array([{tau:.9f}], dtype=float32)"')
    (tmp_path / "log.csv").write_text("\n".join(lines))
    log = read_log(tmp_path / "log.csv")
    check(log, effort=True)


def test_signals_of_a_recorder_call_themselves(tmp_path):
    """dSPACE's recorders keep an array of structures, each with its name, unit and data."""
    kinds = [(name, "O") for name in ("Name", "Type", "Data", "Unit", "XIndex")]
    named = (("pos_act", "deg", np.degrees(Q)), ("pos_ref", "deg", np.degrees(U)))
    signals = [
        (f"Model Root/Axis/{name}/Out1", 8, y[None], unit, 1)
        for name, unit, y in (*named, ("torque", "mNm", 1e3 * TAU))
    ]
    clock = {"Name": "HostService", "Type": 4, "Data": T[None], "Unit": "s"}
    savemat(tmp_path / "a.mat", {"rec1_001": {"X": clock, "Y": np.array(signals, dtype=kinds)}})
    log = read_log(tmp_path / "a.mat")
    check(log, effort=True)
    assert np.allclose(log.effort, TAU)


def test_records_and_stored_tables_in_hdf5(tmp_path):
    names = ["time", "q", "q_cmd", "tau"]
    rows = np.zeros(T.size, [("time", float), ("q", float, (1,)), ("q_cmd", float), ("tau", float)])
    for name, y in zip(names, (T, Q[:, None], U, TAU), strict=True):
        rows[name] = y
    with h5py.File(tmp_path / "records.h5", "w") as file:
        file["log"] = rows
    with h5py.File(tmp_path / "pandas.h5", "w") as file:
        file["df/axis0"] = file["df/block0_items"] = np.array(names, "S")
        file["df/axis1"] = np.arange(T.size)
        file["df/block0_values"] = np.column_stack([T, Q, U, TAU])
    for name in ("records.h5", "pandas.h5"):
        check(read_log(tmp_path / name), effort=True)


def test_a_command_is_compared_with_what_is_taken_as_position(tmp_path):
    """And what is `M_IST` is a moment, also in capitals."""
    columns = {"t": T, "AX1 IST": np.degrees(Q), "AX1 SOLL": np.degrees(U), "AX1 M_IST": TAU}
    log = read_log(table(tmp_path / "a.csv", columns))
    check(log, effort=True)
    raw = {"t": T, "action_1": U, "joint_1_pos": Q, "encoder_1_raw": np.cos(40 * T)}
    check(read_log(table(tmp_path / "b.csv", raw)))


@pytest.mark.parametrize("names", ["1.{}", "servo_stats.{}"])
def test_registers_of_one_moteus_of_several_are_in_turns(tmp_path, names):
    turns = {"position": Q, "velocity": V, "torque": TAU, "q_current": TAU}
    columns = {names.format(n): y / (1 if "t" in n[:1] else 2 * np.pi) for n, y in turns.items()}
    log = read_log(table(tmp_path / "a.csv", {"timestamp": T, **columns}))
    check(log, command=False, velocity=True, effort=True)


def test_a_state_that_never_changes_is_no_position(tmp_path):
    """Nor is a letter beside joints by number, as in EGM of ABB's controllers."""
    columns = {"t": T, "feedBack_j1": np.degrees(Q), "planned_j1": np.degrees(U)}
    columns |= {"feedBack_x": 300 + Q, "feedBack_y": U, "motorState": np.ones(T.size)}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns)])
    assert list(recording.joints) == ["1"]
    check(recording.joints["1"])
    with pytest.raises(GapError, match="no column of positions"):
        read_log(table(tmp_path / "b.csv", {"t": T, "motorState": np.ones(T.size), "tau": TAU}))


def test_a_duration_that_rises_is_the_time(tmp_path):
    columns = {"duration": np.arange(T.size), "q[0]": Q, "q_d[0]": U, "tau_J[0]": TAU}
    log = read_log(table(tmp_path / "franka.csv", columns))
    assert np.allclose(log.t, 1e-3 * np.arange(T.size)) and log.effort is not None
    took = {"duration": 0.001 + 1e-4 * (np.arange(T.size) % 3), "q": Q, "q_d": U}
    with pytest.raises(GapError, match="no column of time stamps"):
        read_log(table(tmp_path / "took.csv", took))


def test_the_current_of_the_q_axis_goes_before_what_a_drive_draws(tmp_path):
    columns = {
        "ms_today": 1e3 * T,
        "current_motor": TAU * np.sign(V) - 0.1,
        "current_in": 0.2 * TAU,
    }
    columns |= {"q_axis_current": TAU, "encoder_position": np.degrees(Q) % 360}
    (recording,) = read_recordings([table(tmp_path / "a.csv", columns, delimiter=";")])
    assert {c.role: c.header for c in recording.taken}["effort"] == "q_axis_current"


def test_words_of_papers_and_simulators(tmp_path):
    columns = {"t": T, "theta": Q, "theta*": U, "qfrc_actuator": TAU, "qfrc_bias": U}
    check(read_log(table(tmp_path / "a.csv", columns)), effort=True)
    columns = {"t": T, "ActualPos": Q, "DemandPos": U, "ActualTq": TAU}
    check(read_log(table(tmp_path / "b.csv", columns)), effort=True)


@pytest.mark.parametrize("waveforms", [False, True])
def test_labviews_groups_of_channels(tmp_path, waveforms):
    """Waveforms state their increment; other channels stand beside one of the time."""
    step = {"wf_increment": T[1] - T[0], "wf_start_offset": 0.0} if waveforms else {}
    held = {"Command": (U, "deg"), "Angle": (Q, "deg"), "Motor torque": (TAU, "N·m")}
    channels = [] if waveforms else [ChannelObject("Run", "Time", T, {"unit_string": "s"})]
    for name, (y, unit) in held.items():
        values = np.degrees(y) if unit == "deg" else y
        channels.append(ChannelObject("Run", name, values, {"unit_string": unit, **step}))
    with TdmsWriter(tmp_path / "bench.tdms") as file:
        file.write_segment([RootObject({}), GroupObject("Run", {}), *channels])
        file.write_segment([ChannelObject("Notes", "Operator", np.array([1.0, 2.0]))])
    log = read_log(tmp_path / "bench.tdms")
    check(log, effort=True)
    assert (log.unit, log.effort_unit) == ("rad", "Nm")


@pytest.mark.parametrize(
    ("name", "said"), [("cut.tdms", "cannot be read as tdms"), ("run.mf4", "save them as Parquet")]
)
def test_measurement_files_that_are_not_read_say_why(tmp_path, name, said):
    (tmp_path / name).write_bytes(b"TDSm" + bytes(40))
    with pytest.raises(GapError, match=said):
        read_recordings([tmp_path / name])
