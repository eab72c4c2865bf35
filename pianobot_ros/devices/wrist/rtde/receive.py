"""The controller's state packages, as the client library receives them."""

from __future__ import annotations

import time
from typing import Any

import rtde_receive

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.cell.host.priority import request_realtime, thread_ids
from pianobot_ros.devices.waiting import Waiting
from pianobot_ros.devices.wrist.messages import RawReading
from pianobot_ros.devices.wrist.rtde.control import RECEIVE_PRIORITY, Modes

__all__ = ["StateReceiver"]

_VARIABLES = [
    "timestamp",
    "actual_q",
    "actual_qd",
    "actual_current",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "target_TCP_pose",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "robot_status_bits",
    "safety_status_bits",
    "speed_scaling",
    "target_speed_fraction",
]
_FIRST_PACKAGE = 2.0  # s in which the first one must have come


class StateReceiver:
    """Receives from ``host`` at ``rate`` Hz; returns once a first package is there.

    Raises:
        DeviceError: no package came.
    """

    def __init__(self, host: str, rate: float) -> None:
        before = thread_ids()
        self._client = rtde_receive.RTDEReceiveInterface(host, rate, _VARIABLES, rt_priority=-1)
        request_realtime(threads=thread_ids() - before, priority=RECEIVE_PRIORITY)
        self._sequence = 0
        waiting = Waiting(2.0 / rate)
        while self._client.getTimestamp() <= 0.0:
            if waiting.turn() > _FIRST_PACKAGE:
                raise DeviceError("the UR controller accepted the connection but sends no state")
            time.sleep(1.0 / rate)
        self.modes = self.read_modes()

    @property
    def stamp(self) -> float:
        """The controller's time in the newest package, s."""
        return float(self._client.getTimestamp())

    @property
    def connected(self) -> bool:
        """Whether the controller holds the connection."""
        return bool(self._client.isConnected())

    @property
    def target(self) -> list[float]:
        """Pose (6,) that the controller says it is following."""
        return list(self._client.getTargetTCPPose())

    def read_modes(self) -> Modes:
        """Renew and return ``modes``."""
        self.modes = Modes(
            self._client.getSafetyMode(),
            self._client.getRobotMode(),
            self._client.getRuntimeState(),
        )
        return self.modes

    def reading(self, now: float, time_ns: int, target: list[float], **own: Any) -> RawReading:
        """The newest package, noticed at ``now`` (monotonic s), of the cycle at ``time_ns``;
        ``own``: what the driver knows of itself.
        """
        client = self._client
        self._sequence += 1
        return RawReading(
            sequence=self._sequence,
            time_ns=time_ns,
            monotonic=now,
            controller_time=client.getTimestamp(),
            safety_mode=self.modes.safety,
            robot_mode=self.modes.robot,
            runtime_state=self.modes.runtime,
            speed_scaling=client.getSpeedScaling() * client.getTargetSpeedFraction(),
            pose=client.getActualTCPPose(),
            speed=client.getActualTCPSpeed(),
            target=target,
            q=client.getActualQ(),
            qd=client.getActualQd(),
            current=client.getActualCurrent(),
            **own,
        )

    def disconnect(self) -> None:
        """Let the controller go."""
        self._client.disconnect()
