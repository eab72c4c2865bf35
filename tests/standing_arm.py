"""An arm that stands where it is told, for tests of those who command it."""

from __future__ import annotations

from typing import Any

from pianobot_ros.testing import Ros

__all__ = ["standing_arm"]

PERIOD = 0.02  # s between two states


def standing_arm(ros: Ros, safety: int = 1, hears: bool = True) -> Any:
    """Publish the state of an arm at home that takes each setpoint as its target; returns that
    state.

    It has a beat of its own, which ends with its node: an arm does not wait for the test's executor
    to get through its messages.

    Args:
        ros: where its node lives.
        safety: its safety state.
        hears: whether it takes setpoints at all.
    """
    from pianobot_msgs.msg import WristCommand, WristState
    from rclpy.serialization import deserialize_message

    from pianobot_ros.cell.motion.limits import wrist_limits
    from pianobot_ros.nodes.topics.polled import Beat, PolledSubscription, stream_qos

    node = ros.node("arm")
    states = ros.publisher(WristState, "/real/wrist/state")
    state = WristState(safety_state=safety)
    place = state.pose.position
    place.x, place.y, place.z = wrist_limits().home
    state.pose.orientation.w = 1.0
    state.target_pose = state.pose
    commands = []
    if hears:
        commands = [PolledSubscription(node, WristCommand, "/command/wrist", stream_qos(10))]

    def beat() -> None:
        for stream in commands:
            for taken in stream.take()[-1:]:
                state.target_pose = deserialize_message(taken.data, WristCommand).pose
        states.publish(state)

    Beat(node, beat, PERIOD, "arm").start()
    return state
