"""Logs as robots' and drives' own programs write them."""

from __future__ import annotations

import numpy as np
from laboratory import Q, T, U, V, check, table
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

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
