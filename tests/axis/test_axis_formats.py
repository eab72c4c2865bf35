"""Logs as robots' and drives' own programs write them."""

from __future__ import annotations

import numpy as np
import pytest
from laboratory import TAU, Q, T, U, V, check, table
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.io import savemat

from pianobot_ros.axis.reading import read_log, read_recordings


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


def test_what_stands_still_is_no_velocity_of_what_moves(tmp_path):
    columns = {"time": T, "angle": Q, "speed_meters_per_sec": 0 * T, "erpm": 66.8 * V}
    log = read_log(table(tmp_path / "log.csv", columns | {"current_motor": TAU}))
    check(log, command=False, velocity=True, effort=True)


def test_letters_of_a_type_are_no_part_of_a_name(tmp_path):
    names = ("fSollPosition", "fIstPosition", "fIstGeschw", "nIstMoment")
    columns = {f"MAIN.st.{n}": y for n, y in zip(names, (U, Q, V, TAU), strict=True)}
    check(read_log(table(tmp_path / "log.csv", {"time": T, **columns})), velocity=True, effort=True)
