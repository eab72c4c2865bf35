"""Messages of robots as their tools record them: lists of messages, plain arrays, several writers
of one topic, topics in lines of JSON.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from laboratory import SECOND, TAU, Q, T, U, V, check
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from pianobot_ros.axis.diagnosis.robot import logs_by_joint
from pianobot_ros.axis.reading import read_recordings
from pianobot_ros.gap import GapError

STATE, POINT = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectoryPoint"
NAMES = ["lift_joint", "tilt_joint"]
EMPTY = np.zeros(0)


class Bag:
    """A bag of messages at the times of the laboratory's log."""

    def __init__(self, path, **definitions):
        self.path, self.store = path, get_typestore(Stores.ROS2_JAZZY)
        for name, fields in definitions.items():
            own = "lab_msgs/msg/" + name
            self.store.register(get_types_from_msg(fields, own))
        self.messages = []

    def new(self, kind, *fields):
        return self.store.types[kind](*fields)

    def header(self, t):
        stamp = self.new("builtin_interfaces/msg/Time", int(t), round(t % 1 * 1e9))
        return self.new("std_msgs/msg/Header", stamp, "")

    def state(self, t, names, q, v=EMPTY, effort=EMPTY):
        return self.new(STATE, self.header(t), names, np.array(q), np.array(v), np.array(effort))

    def point(self, q):
        still = self.new("builtin_interfaces/msg/Duration", 0, 0)
        return self.new(POINT, np.array(q), EMPTY, EMPTY, EMPTY, still)

    def add(self, topic, t, message):
        self.messages.append((t, topic, message))

    def read(self):
        with Writer(self.path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            topics = {}
            for t, topic, message in sorted(self.messages, key=lambda m: m[0]):
                kind = message.__msgtype__
                if topic not in topics:
                    topics[topic] = bag.add_connection(topic, kind, typestore=self.store)
                raw = self.store.serialize_cdr(message, kind)
                bag.write(topics[topic], round(1e9 * t), raw)
        (run,) = read_recordings([self.path])
        return run


ROWS = list(zip(5.0 + T, Q, V, TAU, U, strict=True))
"""Time, position, velocity, effort and command of the lift joint."""


def test_a_state_of_interfaces_is_called_by_joint_and_interface(tmp_path):
    bag = Bag(
        tmp_path / "bag",
        Values="string[] interface_names\nfloat64[] values\n",
        States="std_msgs/Header header\nstring[] joint_names\nlab_msgs/Values[] interface_values\n",
    )
    kinds = ["position", "velocity", "effort"]
    for t, q, v, effort, _ in ROWS:
        own = [
            bag.new("lab_msgs/msg/Values", kinds, k * np.array([q, v, effort])) for k in (1, SECOND)
        ]
        bag.add(
            "/dynamic_joint_states", t, bag.new("lab_msgs/msg/States", bag.header(t), NAMES, own)
        )
    run = bag.read()
    assert list(run.joints) == ["lift", "tilt"]
    check(run.joints["lift"], command=False, velocity=True, effort=True)
    assert np.allclose(run.joints["tilt"].effort, SECOND * TAU)


def test_motors_in_a_list_are_joints_by_their_place(tmp_path):
    bag = Bag(
        tmp_path / "bag",
        Motor="float32 q\nfloat32 dq\nfloat32 tau_est\n",
        Low="lab_msgs/Motor[2] motor_state\nuint32 tick\n",
        Order="float32 q\n",
        Orders="lab_msgs/Order[2] motor_cmd\n",
    )
    for t, q, v, effort, u in ROWS:
        own = [bag.new("lab_msgs/msg/Motor", k * q, k * v, k * effort) for k in (SECOND, 1)]
        bag.add("/lowstate", t, bag.new("lab_msgs/msg/Low", own, 7))
        told = [bag.new("lab_msgs/msg/Order", k * u) for k in (SECOND, 1)]
        bag.add("/lowcmd", t, bag.new("lab_msgs/msg/Orders", told))
    run = bag.read()
    assert list(run.joints) == ["0", "1"] and run.name == "bag"
    check(run.joints["1"], velocity=True, effort=True)


@pytest.mark.parametrize("points", [1, 2])
def test_a_streamed_trajectory_is_a_command_and_a_plan_is_none(tmp_path, points):
    bag = Bag(tmp_path / "bag")
    kind = "trajectory_msgs/msg/JointTrajectory"
    for t, q, v, effort, u in ROWS:
        both = np.array([1, SECOND])
        bag.add("/joint_states", t, bag.state(t, NAMES, q * both, v * both, effort * both))
        told = [bag.point(u * both), bag.point(0 * both)][:points]
        bag.add("/arm/joint_trajectory", t, bag.new(kind, bag.header(t), NAMES, told))
    log = bag.read().joints["lift"]
    check(log, command=points == 1, velocity=True, effort=True)


def test_places_in_an_array_are_no_numbers_of_joints(tmp_path):
    """Of `joint_1` to `joint_3` the command is `data[0]` to `data[2]`."""
    bag = Bag(tmp_path / "bag")
    sizes = np.array([1.0, SECOND, -0.3])
    kind, layout = "std_msgs/msg/Float64MultiArray", "std_msgs/msg/MultiArrayLayout"
    shift = np.array([0.0, 0.1, 0.2])
    for t, q, _, effort, u in ROWS:
        names = [f"joint_{k}" for k in (1, 2, 3)]
        bag.add("/joint_states", t, bag.state(t, names, q * sizes + shift, EMPTY, effort * sizes))
        bag.add("/joint_states", t + 0.004, bag.state(t + 0.004, ["grip_joint"], [0.1]))
        told = bag.new(kind, bag.new(layout, [], 0), u * sizes + shift)
        bag.add("/forward_position_controller/commands", t, told)
    run = bag.read()
    for k, (size, moved) in enumerate(zip(sizes, shift, strict=True)):
        assert np.allclose(run.joints[f"{k + 1}"].command, size * U + moved, atol=1e-6)


def test_of_two_writers_of_one_topic_each_has_its_own_times(tmp_path):
    """An arm and a gripper publish on one topic: rows of the one are no gaps of the other."""
    bag = Bag(tmp_path / "bag")
    for t, q, v, effort, _ in ROWS:
        bag.add("/joint_states", t, bag.state(t, ["lift_joint"], [q], [v], [effort]))
        own = bag.state(t + 0.008, ["grip_joint"], [0.02 * np.cos(3 * t)], [0.0], [np.sin(t)])
        bag.add("/joint_states", t + 0.008, own)
    run = bag.read()
    check(run.joints["lift"], command=False, velocity=True, effort=True)
    grip = np.interp(T, T + 0.008, 0.02 * np.cos(3 * (T + 5.0)))
    assert np.allclose(run.joints["grip"].position[1:], grip[1:], atol=1e-6)


def test_a_desired_state_within_a_message_is_the_command(tmp_path):
    bag = Bag(
        tmp_path / "bag",
        State="std_msgs/Header header\n"
        f"{STATE} measured_joint_state\n{STATE} desired_joint_state\n",
    )
    names = ["fr3_joint1", "fr3_joint2"]
    for t, q, v, effort, u in ROWS:
        both = np.array([1, SECOND])
        felt = bag.state(t, names, q * both, v * both, effort * both)
        told = bag.state(t, names, u * both)
        bag.add("/robot_state", t, bag.new("lab_msgs/msg/State", bag.header(t), felt, told))
    run = bag.read()
    (joint,) = logs_by_joint([run], ["fr3_joint1"])
    check(run.joints[joint], velocity=True, effort=True)
    with pytest.raises(GapError, match="fr3_joint7"):
        logs_by_joint([run], ["fr3_joint7"])


def test_where_bodies_are_is_no_joint(tmp_path):
    bag = Bag(tmp_path / "bag")
    for t, q, *_ in ROWS:
        place = bag.new("geometry_msgs/msg/Vector3", q, 0.0, 1.0)
        turned = bag.new("geometry_msgs/msg/Quaternion", 0.0, 0.0, np.sin(q), np.cos(q))
        pose = bag.new("geometry_msgs/msg/Transform", place, turned)
        own = bag.new("geometry_msgs/msg/TransformStamped", bag.header(t), "tool", pose)
        bag.add("/tf", t, bag.new("tf2_msgs/msg/TFMessage", [own]))
    with pytest.raises(GapError, match="no topic with numbers"):
        bag.read()


@pytest.mark.parametrize("key", ["data", "msg"])
def test_topics_in_lines_of_json_are_apart(tmp_path, key):
    """As `mcap cat --json` and rosbridge write them, whichever order they came in."""
    lines = []
    for k, (t, q, v, effort, u) in enumerate(ROWS):
        header = {"stamp": {"sec": int(t), "nanosec": round(t % 1 * 1e9)}}
        state = {"header": header, "name": NAMES, "position": [q, SECOND * q]}
        state |= {"velocity": [v, SECOND * v], "effort": [effort, SECOND * effort]}
        lines.append({"topic": "/joint_states", "log_time": f"{t + 0.001:.9f}", key: state})
        told = {"header": header, "joint_names": NAMES[::-1]}
        told["reference"] = {"positions": [SECOND * u, u], "velocities": []}
        if k % 2 == 0:
            lines.append({"topic": "/state", "log_time": f"{t + 0.002:.9f}", key: told})
    path = tmp_path / "out.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    (run,) = read_recordings([path])
    for name, size in zip(NAMES, (1.0, SECOND), strict=True):
        log = run.joints[name]
        assert np.allclose(log.position, size * Q) and np.allclose(log.effort, size * TAU)
        assert np.allclose(log.command[:-1], size * U[:-1], atol=1e-3)  # every other row has one


def test_a_bag_that_broke_off_says_what_mends_it(tmp_path):
    bag = Bag(tmp_path / "bag")
    for t, q, v, effort, _ in ROWS:
        bag.add("/joint_states", t, bag.state(t, NAMES[:1], [q], [v], [effort]))
    bag.read()
    (whole,) = (tmp_path / "bag").glob("*.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[:-40])
    with pytest.raises(GapError, match=r"pianobot bag repair cut\.mcap"):
        read_recordings([cut])


# -- what is no joint's in a recording of joints ---------------------------------------------------
CLOSE = {"velocity": True, "effort": True}


def clutter(bag, t):
    """What a robot's bag holds beside its joints: by their names or their sizes some might be."""
    for kind, topic, said in (
        ("sensor_msgs/msg/FluidPressure", "/vacuum/pressure", (9e4 + 50 * np.sin(t), 0.0)),
        ("sensor_msgs/msg/Temperature", "/motor_temperature", (30.0 + 0.01 * t, 0.0)),
        ("sensor_msgs/msg/Range", "/sonar", (0, 0.1, 0.02, 4.0, 1.0 + 0.1 * np.sin(t), 0.0)),
    ):
        bag.add(topic, t, bag.new(kind, bag.header(t), *said))
    push = bag.new("geometry_msgs/msg/Vector3", 5 * np.sin(3 * t), 0.0, 0.0)
    felt = bag.new("geometry_msgs/msg/Wrench", push, push)
    bag.add("/wrench", t, bag.new("geometry_msgs/msg/WrenchStamped", bag.header(t), felt))
    bag.add("/cmd_vel", t, bag.new("geometry_msgs/msg/Twist", push, push))
    bag.add("/speed_scaling", t, bag.new("std_msgs/msg/Float64", 99.0 + np.sin(t)))
    state = bag.new("lab_msgs/msg/Vacuum", ["a", "b"], -5e4 * np.ones(2), -5e4 * np.sin([t, t + 1]))
    bag.add("/vacuum/state", t, state)
    key = bag.new("lab_msgs/msg/Key", np.array([60.0]), 0.02 * np.sin([t]), np.zeros(1))
    bag.add("/key", t, key)


VACUUM = "string[] fingers\nfloat64[] setpoint\nfloat64[] measured\n"
KEY = "float64[] notes\nfloat64[] angle\nfloat64[] velocity\n"


def test_where_messages_name_joints_nothing_else_is_one_or_tells_their_unit(tmp_path):
    """Pressures of 90 000 were degrees, and made degrees of all joints."""
    bag = Bag(tmp_path / "bag", Vacuum=VACUUM, Key=KEY)
    for t, q, v, effort, _ in ROWS:
        bag.add("/joint_states", t, bag.state(t, NAMES, [q, SECOND * q], [v, v], [effort, effort]))
        clutter(bag, t)
    run = bag.read()
    assert list(run.joints) == ["lift", "tilt"]
    check(run.joints["lift"], command=False, **CLOSE)
    assert any("vacuum/state: measured[0]" in n and "no joint's" in n for n in run.notes)


def test_a_wheel_that_turns_on_makes_no_degrees_of_an_arm(tmp_path):
    """`JointState` is in rad by its definition; that a joint goes far is said."""
    bag = Bag(tmp_path / "bag")
    lines = []
    for t, q, _, effort, _ in ROWS:
        names = ["lift_joint", "wheel_left", "wheel_right"]
        turned = [q, 9 * t, 9 * t + 0.1 * q]
        bag.add("/joint_states", t, bag.state(t, names, turned, EMPTY, [effort, 1.0, 1.0]))
        state = {"header": {}, "name": names, "position": turned, "velocity": []}
        state |= {"effort": [effort, 1.0, 1.0]}
        lines.append(json.dumps({"topic": "/joint_states", "log_time": f"{t:.9f}", "msg": state}))
    run = bag.read()
    path = tmp_path / "same.jsonl"
    path.write_text("\n".join(lines), encoding="utf-8")
    (same,) = read_recordings([path])
    for read, name in ((run, "lift"), (same, "lift_joint")):
        check(read.joints[name], command=False, effort=True)
        assert any("stated in rad" in n for n in read.notes)


def test_a_joint_may_be_called_like_anything(tmp_path):
    """What a joint is called says nothing of the quantity."""
    names = ["tool_joint", "speed_motor", "load_axis"]
    bag = Bag(tmp_path / "bag")
    for t, q, v, effort, _ in ROWS:
        sizes = np.array([1.0, SECOND, -0.3])
        bag.add("/joint_states", t, bag.state(t, names, q * sizes, v * sizes, effort * sizes))
    run = bag.read()
    assert len(run.joints) == 3
    check(next(iter(run.joints.values())), command=False, **CLOSE)


def test_an_array_is_of_the_joints_whose_positions_stand_beside_it(tmp_path):
    """A driver's arrays of three, in degrees and in their own order, beside an arm's four names."""
    bag = Bag(
        tmp_path / "bag",
        Own="float64[3] position\nfloat64[3] commanded_position\nfloat64[3] torque\n"
        "float64 time\nfloat64[2] elbow\nfloat64[2] elbow_d\n",
    )
    names = ["joint_1", "joint_2", "joint_3", "grip_joint"]
    places = [2, 0, 1]
    for t, q, _, effort, u in ROWS:
        moved = [q, 0.5 * np.cos(t), 0.3 * np.sin(3 * t)]
        bag.add("/joint_states", t, bag.state(t, names, [*moved, 0.1]))
        told = [u, 0.5 * np.cos(t + 0.1), 0.3 * np.sin(3 * t + 0.1)]
        pulls = [effort, np.sin(t), np.cos(t)]
        own = (np.degrees(np.array(moved)[places]), np.degrees(np.array(told)[places]))
        arm = [np.array([moved[1], 1.0]), np.array([told[1], 1.0])]
        made = bag.new("lab_msgs/msg/Own", *own, np.array(pulls)[places], t + 1e3, *arm)
        bag.add("/driver", t, made)
    run = bag.read()
    assert list(run.joints) == ["1", "2", "3", "grip"]
    check(run.joints["1"], effort=True)
    assert np.allclose(run.joints["2"].effort, np.sin(5.0 + T))


def test_arrays_of_other_sizes_are_not_of_the_joints(tmp_path):
    """Efforts of 2 beside joint_1 to joint_3: which two, nothing tells; `[1]` is not joint_1."""
    bag = Bag(tmp_path / "bag", Own="float64[2] motor_current\n")
    names = ["joint_1", "joint_2", "joint_3"]
    for t, q, v, _, u in ROWS:
        sizes = np.array([1.0, SECOND, -0.3])
        bag.add("/joint_states", t, bag.state(t, names, q * sizes, v * sizes))
        told = bag.new("trajectory_msgs/msg/JointTrajectory", bag.header(t), names, [])
        told.points.append(bag.point(u * sizes))
        bag.add("/arm/joint_trajectory", t, told)
        bag.add("/driver", t, bag.new("lab_msgs/msg/Own", np.array([3.0 * u, 5.0 * q])))
    run = bag.read()
    assert all(log.effort is None for log in run.joints.values())
    assert any("motor_current[0]" in n and "unused" in n for n in run.notes)


def test_a_message_of_one_motor_says_whose_it_is(tmp_path):
    """As Dynamixel's messages do, in a list or on a topic each."""
    bag = Bag(
        tmp_path / "bag",
        Motor="string name\nfloat64 goal_pos\nfloat64 current_pos\nfloat64 load\n",
        Motors="lab_msgs/Motor[] dynamixel_state\n",
    )
    for t, q, _, effort, u in ROWS:
        rows = [(n, k * u, k * q, k * effort) for n, k in zip(NAMES, (1, SECOND), strict=True)]
        own = [bag.new("lab_msgs/msg/Motor", *row) for row in rows]
        bag.add("/motors", t, bag.new("lab_msgs/msg/Motors", own[::-1]))
        bag.add("/pan", t, bag.new("lab_msgs/msg/Motor", "pan_joint", 2 * u, 2 * q, 2 * effort))
    run = bag.read()
    assert set(run.joints) == {"lift", "tilt", "pan"}
    check(run.joints["lift"], effort=True)
    assert np.allclose(run.joints["pan"].command, 2 * U)


def test_a_named_gripper_hides_no_arm(tmp_path):
    """An arm's state without names, beside a gripper's `JointState`."""
    bag = Bag(tmp_path / "bag", Own="float64[3] q\nfloat64[3] dq\nfloat64[3] tau_J\n")
    for t, q, v, effort, _ in ROWS:
        sizes = np.array([1.0, SECOND, -0.3])
        bag.add("/arm", t, bag.new("lab_msgs/msg/Own", q * sizes, v * sizes, effort * sizes))
        bag.add("/grip/joint_states", t, bag.state(t, ["finger_joint"], [0.02 * np.cos(t)]))
    run = bag.read()
    assert list(run.joints) == ["0", "1", "2", "finger"]
    check(run.joints["0"], command=False, **CLOSE)


def test_a_topic_s_name_says_what_its_numbers_are_of(tmp_path):
    """A battery's current is no joint's, and setpoints of two fingers hide no arm's commands."""
    lines = []
    for t, q, _, _, u in ROWS:
        at = {"header": {"stamp": {"sec": int(t), "nanosec": round(t % 1 * 1e9)}}}
        state = {**at, "name": NAMES, "position": [q, SECOND * q]}
        vacuum = {**at, "setpoint": [-5e4, 0.0, t], "measured": [-5e4 * np.sin(t), 0.0, t]}
        for topic, said in (
            ("/joint_states", state),
            ("/vacuum", vacuum),
            ("/battery_state", {**at, "current": np.sin(3 * t)}),
            ("/cmd", {"data": [u, SECOND * u]}),
        ):
            lines.append(json.dumps({"topic": topic, "log_time": f"{t:.9f}", "data": said}))
    path = tmp_path / "out.jsonl"
    path.write_text("\n".join(lines), encoding="utf-8")
    (run,) = read_recordings([path])
    assert list(run.joints) == NAMES
    check(run.joints[NAMES[0]])
    assert np.allclose(run.joints[NAMES[1]].command, SECOND * U)


def test_of_one_joint_a_battery_s_current_is_no_effort(tmp_path):
    bag = Bag(tmp_path / "bag", Battery="float64 current\nfloat64 charge\n")
    for t, q, _, _, u in ROWS:
        bag.add("/joint_states", t, bag.state(t, ["lift_joint"], [q]))
        bag.add("/lift/command", t, bag.new("std_msgs/msg/Float64", u))
        bag.add("/battery", t, bag.new("lab_msgs/msg/Battery", np.sin(3 * t), 0.5))
    check(bag.read().joints["lift"])


def test_a_bag_of_no_joint_says_so_with_its_topics(tmp_path):
    bag = Bag(tmp_path / "bag", Vacuum=VACUUM, Key="float64[] notes\nfloat64[] velocity\n")
    for t, *_ in ROWS:
        push = bag.new("geometry_msgs/msg/Vector3", 5 * np.sin(3 * t), 0.0, 0.0)
        felt = bag.new("geometry_msgs/msg/Wrench", push, push)
        bag.add("/wrench", t, bag.new("geometry_msgs/msg/WrenchStamped", bag.header(t), felt))
        kind = "sensor_msgs/msg/FluidPressure"
        bag.add("/pressure", t, bag.new(kind, bag.header(t), 9e4 + np.sin(t), 0.0))
    with pytest.raises(GapError, match=r"none of its topics tells a joint's position.*wrench"):
        bag.read()


@pytest.mark.parametrize("named", [False, True])
def test_a_body_s_place_is_no_joint_of_a_quadruped(tmp_path, named):
    """Places of an array of `position` had been those of the first motors."""
    bag = Bag(
        tmp_path / "bag",
        Motor="float32 q\nfloat32 dq\nfloat32 tau_est\n",
        Low="lab_msgs/Motor[3] motor_state\n",
        Sport="float32[3] position\nfloat32[3] velocity\nfloat32[3] foot_position_body\n",
    )
    for t, q, v, effort, _ in ROWS:
        moved = [q, 0.5 * np.cos(t), 0.3 * np.sin(3 * t)]
        told = zip(moved, (v, -0.5 * np.sin(t), 0.9 * np.cos(3 * t)), (effort, 1, 1), strict=True)
        own = [bag.new("lab_msgs/msg/Motor", *map(float, row)) for row in told]
        bag.add("/lowstate", t, bag.new("lab_msgs/msg/Low", own))
        body = [np.sin([t, t + 1, t + 2]).astype(np.float32) for _ in range(3)]
        bag.add("/sportmodestate", t, bag.new("lab_msgs/msg/Sport", *body))
        if named:
            bag.add("/joint_states", t, bag.state(t, ["hip", "thigh", "knee"], moved))
    run = bag.read()
    assert list(run.joints) == (["hip", "thigh", "knee"] if named else ["0", "1", "2"])
    check(next(iter(run.joints.values())), command=False, **CLOSE)
    assert run.joints[next(iter(run.joints))].link is None
