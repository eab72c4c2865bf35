"""The cells as a phrase sees them: whether their wrists can move, and whether they follow."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence

import numpy as np
from pianobot_msgs.msg import WristState
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.messages.poses import is_rotation, quaternion
from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.cell.motion.wrist_poses import WristPose
from pianobot_ros.nodes.playing.following import Following
from pianobot_ros.nodes.topics.polled import PolledSubscription, stream_qos

__all__ = ["STATE_FRESH", "Cells"]

STATE_FRESH = 0.5  # s; an older state of a cell says nothing about where its wrist is
NODE = {"real": "ur5_wrist", "sim": "sim_twin"}


class Cells:
    """The newest wrist state of each cell, looked at only when needed: 250 messages a second would
    cost the conductor more than everything else it does. ``require`` names the cells without which
    no phrase is played; waiting ends when ``stopping`` is set.
    """

    def __init__(self, node: Node, require: Sequence[str], stopping: threading.Event) -> None:
        self.require, self._stopping = require, stopping
        self._states: dict[str, tuple[float, WristState]] = {}
        self._streams = {
            cell: PolledSubscription(node, WristState, f"/{cell}/wrist/state", stream_qos(1))
            for cell in ("real", "sim")
        }

    def look(self) -> None:
        """Take the newest state of each cell."""
        for cell, stream in self._streams.items():
            if taken := stream.take():
                self._states[cell] = (
                    time.monotonic(),
                    deserialize_message(taken[-1][0], WristState),
                )

    def forget(self) -> None:
        """What comes from now on counts: a node may have died a moment ago."""
        self.look()
        self._states.clear()

    @property
    def stopped(self) -> bool:
        """Whether an arm that has been seen is in a safety stop."""
        return any(not _is_safe(state) for _, state in self._states.values())

    def missing(self, limit: float) -> list[str]:
        """Why the cells are not ready after ``limit`` s; empty as soon as they are."""
        end = time.monotonic() + limit
        while (
            (reasons := self.not_ready()) and time.monotonic() < end and not self._stopping.is_set()
        ):
            time.sleep(0.02)
        return reasons

    def watch(self, t: float, sent: np.ndarray, following: Mapping[str, Following]) -> list[str]:
        """Why the phrase cannot go on at its time ``t`` s, when ``sent`` was the last position (3,)
        m: empty if it can.
        """
        if reasons := self.not_ready():
            return reasons
        for cell, follows in following.items():
            p = self._states[cell][1].target_pose.position
            follows.look(t, sent.tolist(), [p.x, p.y, p.z])
        return [
            f"the {cell} arm does not move with the setpoints: {NODE[cell]} does not hear"
            " /command/wrist, or refuses it"
            for cell, follows in following.items()
            if follows.deaf
        ]

    def not_ready(self) -> list[str]:
        """Why the required cells are not ready now."""
        self.look()
        reasons, now = [], time.monotonic()
        for cell in self.require:
            seen, state = self._states.get(cell, (0.0, None))
            node = NODE[cell]
            if state is None or now - seen > STATE_FRESH:
                reasons.append(
                    f"the {cell} cell does not report /{cell}/wrist/state: is {node} running and"
                    " active?"
                )
            elif not _is_safe(state):
                reasons.append(
                    f"the {cell} arm is in safety state {state.safety_state}: clear the stop and"
                    f" call /{node}/recover"
                )
            elif state.controller_time > 0.0 and not state.program_running:
                reasons.append(f"the program of the {cell} arm does not run: call /{node}/recover")
        return reasons

    def start_pose(self) -> WristPose:
        """Where the wrist is: the real one first, since the arm moves on from there."""
        for cell in ("real", "sim"):
            seen, state = self._states.get(cell, (0.0, None))
            if state is None or time.monotonic() - seen >= STATE_FRESH:
                continue
            p, turn = state.pose.position, quaternion(state.pose)
            if is_rotation(*turn):
                roll, pitch, yaw = Rotation.from_quat(turn).as_euler("xyz")
                return WristPose(x=p.x, y=p.y, z=p.z, roll=roll, pitch=pitch, yaw=yaw)
        x, y, z = wrist_limits().home
        return WristPose(x=x, y=y, z=z)


def _is_safe(state: WristState) -> bool:
    return state.safety_state in (WristState.SAFETY_NORMAL, WristState.SAFETY_REDUCED)
