"""What the twin obeys: the checks and limits of the arm and of the regulator, applied to the same
commands.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from pianobot_ros.cell.host.wall_clock import AHEAD
from pianobot_ros.cell.messages.command_checks import vacuum_setpoint, wrist_setpoint
from pianobot_ros.cell.messages.stamps import nanoseconds
from pianobot_ros.cell.messages.wrist_order import WristOrder
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.motion.limits import LimitsConfig, WorkspaceConfig
from pianobot_ros.cell.numbers.config import load_section
from pianobot_ros.cell.recordings.commands import CYCLE
from pianobot_ros.devices.vacuum.config import RegulatorConfig
from pianobot_ros.devices.wrist.limits.limiter import SetpointLimiter
from pianobot_ros.nodes.twin.twin_loop import CATCH_UP, TwinLoop

__all__ = ["TwinCommands"]


class TwinCommands:
    """Decodes, checks and limits commands, and hands them to the loop with the time at which they
    are due. Called on one thread.
    """

    def __init__(self, loop: TwinLoop) -> None:
        self._loop = loop
        self._limits = load_section("wrist.yaml", LimitsConfig, "limits")
        workspace = load_section("wrist.yaml", WorkspaceConfig, "workspace")
        self._range = RegulatorConfig.load().limits
        self._limiter = SetpointLimiter(self._limits, workspace, CYCLE)
        self._last = float("-inf")  # time of the last setpoint, s since the epoch
        self._starts = -1
        self._sent = np.zeros(6)
        self.clamped = 0

    def wrist(self, order: WristOrder, sent: float) -> str:
        """Obey a WristCommand as the arm would that has it as soon as it was ``sent`` (s since the
        epoch); returns the limits that changed it, empty if none did. Raises
        :class:`CommandRejectedError`.
        """
        setpoint = wrist_setpoint(order, now=sent)
        self._limiter.check(setpoint)
        now = time.time()
        # The stream's own time: that the machine is busy must not look like a jump. A stamp that
        # the twin can no longer catch up with is of another clock.
        at = setpoint.stamp if now - CATCH_UP < setpoint.stamp <= now + AHEAD else now
        if self._loop.starts != self._starts:
            self._starts, self._sent = self._loop.starts, self._loop.twin.pose
            self._last = float("-inf")
        if not 0.0 <= at - self._last <= self._limits.stale:
            self._limiter.restart(self._sent[:3], self._sent[3:], at)
        self._last = at
        limited = self._limiter.limit(setpoint, at)
        self.clamped += bool(limited.clamped)
        self._sent = np.concatenate([limited.setpoint.position, limited.setpoint.rotation])
        self._loop.command_wrist(self._sent, order.stamp_ns)
        return limited.clamped

    def vacuum(self, message: Any, sent: float) -> str:
        """Obey a VacuumCommand as the regulator would that has it as soon as it was ``sent``; its
        range is both cells'. Returns and raises what :meth:`wrist` does.
        """
        wanted = vacuum_setpoint(message, FINGERS, sent)
        low, high = self._range.lowest, self._range.highest
        pressure = {finger: min(max(p, low), high) for finger, p in wanted.items()}
        self._loop.command_vacuum(pressure, nanoseconds(message.header.stamp))
        clamped = any(abs(pressure[finger] - p) > 1.0 for finger, p in wanted.items())
        self.clamped += clamped
        return "vacuum" if clamped else ""
