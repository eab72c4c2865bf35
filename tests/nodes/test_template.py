"""Templates give the same bytes as messages filled by hand."""

from __future__ import annotations

import itertools

import pytest
from geometry_msgs.msg import Point, Pose, Quaternion
from pianobot_msgs.msg import KeyAngle, KeyForce, VacuumState, WristState
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from pianobot_ros.bags.message_types import typestore
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.topics.template import Template

STAMP = 1_700_000_000_123_456_789


def test_numbers_flags_and_counters() -> None:
    template = Template(KeyForce(note=64), force="d", counts="i", saturated="?", sequence="I")
    template.fill(1, force=9.0, counts=7, saturated=False, sequence=1)
    data = template.fill(STAMP, force=1.25, counts=-1, saturated=True, sequence=2**32 - 1)
    expected = KeyForce(note=64, force=1.25, counts=-1, saturated=True, sequence=2**32 - 1)
    expected.header.stamp = common.time_msg(STAMP)
    assert deserialize_message(data, KeyForce) == expected


def test_arrays_behind_names() -> None:
    template = Template(
        KeyAngle(notes=[60, 61, 62], angle=[0.0] * 3, velocity=[0.0] * 3), angle="3d", velocity="3d"
    )
    got = deserialize_message(
        template.fill(STAMP, angle=[0.1, 0.2, 0.3], velocity=(1, 2, 3)), KeyAngle
    )
    assert (
        list(got.notes) == [60, 61, 62]
        and got.angle.tolist() == [0.1, 0.2, 0.3]
        and got.velocity.tolist() == [1, 2, 3]
    )
    vacuum = Template(
        VacuumState(fingers=["thumb", "index"], setpoint=[0.0] * 2, measured=[0.0] * 2),
        measured="2d",
    )
    state = deserialize_message(vacuum.fill(STAMP, measured=[-1.0, -2.0]), VacuumState)
    assert (
        state.fingers == ["thumb", "index"]
        and state.setpoint.tolist() == [0, 0]
        and state.measured.tolist() == [-1, -2]
    )
    joints = Template(
        JointState(name=["a", "b"], position=[0.0] * 2, velocity=[0.0] * 2),
        position="2d",
        velocity="2d",
    )
    data = joints.fill(STAMP, position=[3.0, 4.0])
    assert deserialize_message(data, JointState).position.tolist() == [3.0, 4.0]
    assert typestore().deserialize_cdr(data, "sensor_msgs/msg/JointState").position.tolist() == [
        3.0,
        4.0,
    ], "readers of bags"


def test_what_the_middleware_pads_with_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    rubbish = itertools.cycle([b"\x00\x07\x00", b"\x09\x00\x00"])

    def padded(message: KeyAngle) -> bytes:
        data = bytearray(serialize_message(message))
        data[17:20] = next(rubbish)  # behind the empty frame_id, before the length of notes
        return bytes(data)

    monkeypatch.setattr("pianobot_ros.nodes.topics.template.serialize_message", padded)
    template = Template(KeyAngle(notes=[60], angle=[0.0], velocity=[0.0]), angle="d", velocity="d")
    got = deserialize_message(template.fill(STAMP, angle=0.5, velocity=2.0), KeyAngle)
    assert (
        list(got.notes) == [60] and got.angle.tolist() == [0.5] and got.velocity.tolist() == [2.0]
    )


def test_nested_messages_are_numbers_in_a_row() -> None:
    message = WristState()
    message.header.frame_id = "base"
    template = Template(message, pose="7d", target_pose="7d", safety_state="B", joint_currents="6d")
    got = deserialize_message(
        template.fill(
            STAMP,
            pose=range(1, 8),
            target_pose=range(8, 15),
            safety_state=3,
            joint_currents=[0.5] * 6,
        ),
        WristState,
    )
    assert (
        got.header.frame_id == "base"
        and got.header.stamp == common.time_msg(STAMP)
        and got.safety_state == 3
    )
    assert got.pose == Pose(
        position=Point(x=1.0, y=2.0, z=3.0), orientation=Quaternion(x=4.0, y=5.0, z=6.0, w=7.0)
    )
    assert got.target_pose.orientation.w == 14.0 and list(got.joint_currents) == [0.5] * 6


def test_a_field_that_is_not_in_a_row_is_refused() -> None:
    with pytest.raises(ValueError, match="target_pose"):
        Template(WristState(), target_pose="3d")
    with pytest.raises(AttributeError):
        Template(WristState(), target_poise="7d")
