"""A plan as streams of commands, on an absolute time base."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from pianobot_msgs.action import PlayPhrase
from pianobot_msgs.msg import StrikeMark, VacuumCommand, WristCommand
from rclpy.node import Node
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.host.wall_clock import wall_offset_ns
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.score import Plan, plan_retreat
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.playing.cells import STATE_FRESH, Cells
from pianobot_ros.nodes.playing.following import Following
from pianobot_ros.nodes.session.lost_strikes import LATE, Passage
from pianobot_ros.nodes.session.marks import mark_message
from pianobot_ros.nodes.topics.template import Template

__all__ = ["Streamer"]

MARK_AHEAD = 0.1  # s by which a strike is announced before its window starts
# s without a state of a required cell, or with an arm that does not obey, after which a phrase is
# interrupted; a driver that starved its controller's watchdog has its program back in one
BLIND = 2.5
WATCH = 0.1  # s between two looks at the cells while a phrase plays
# s in which the cells follow what was sent in one go by a process that had been held up; what they
# say before is of the time before
ANSWER = 0.3


class Streamer:
    """Sends plans at ``rate`` Hz, each setpoint ``lead`` s before it is to be obeyed, and meanwhile
    calls the ``listeners`` ten times a second. Counts the setpoints that it ``sent``, those that
    came ``late``, and the worst lateness, s.
    """

    def __init__(
        self,
        node: Node,
        rate: float,
        lead: float,
        cells: Cells,
        listeners: Sequence[Callable[[], None]],
    ) -> None:
        self._rate, self._lead, self._cells, self._listeners = rate, lead, cells, listeners
        self.wrist = node.create_publisher(
            WristCommand,
            "/command/wrist",
            common.command_publisher_qos(),
            event_callbacks=common.publisher_events(node, "/command/wrist"),
        )
        self._vacuum = node.create_publisher(VacuumCommand, "/command/vacuum", common.EVENT_QOS)
        self._strike = node.create_publisher(StrikeMark, "/command/strike", common.EVENT_QOS)
        # time 0 of the phrase: monotonic s, and ns since the epoch
        self._origin, self._wall = 0.0, 0
        setpoint = WristCommand()
        setpoint.header.frame_id = "base"
        self._setpoint = Template(setpoint, pose="7d", twist="6d")
        self.late = self.sent = 0
        self.worst_late = 0.0

    def play(self, plan: Plan, goal: Any, first: int, ended: Callable[[], bool]) -> Passage:
        """Send the plan on an absolute time base, until its end or until a cell stops obeying."""
        quaternions = Rotation.from_rotvec(plan.rotation).as_quat()
        setpoints = np.hstack([plan.position, quaternions, plan.velocity])
        # the vacuum is not sent ahead: its regulator obeys at once
        in_force = np.searchsorted(plan.vacuum_time, plan.time - self._lead, side="right") - 1
        vacuum_rows = np.maximum(in_force, 0).tolist()
        ahead = self._lead + 0.02
        self._origin = time.monotonic() + ahead
        self._wall = round(1e9 * self._origin) + wall_offset_ns()
        take = Passage(1e-9 * self._wall)
        marks, vacuum_row, vacuum_due = list(plan.strikes), -1, 0.0
        obeyed, look = 0.0, 0.0
        following = {cell: Following(BLIND) for cell in self._cells.require}
        reasons: list[str] = []
        for i, t in enumerate(plan.time.tolist()):
            if ended():
                self._retreat(plan, i, quaternions[max(i - 1, 0)])
                return take
            now, row = t - self._lead, vacuum_rows[i]
            if row != vacuum_row or now >= vacuum_due:
                self._send_vacuum(plan.pressure[row])
                vacuum_row, vacuum_due = row, now + 1.0
            while take.announced < len(marks) and marks[take.announced].start <= t + MARK_AHEAD:
                self._strike.publish(mark_message(marks[take.announced], self._wall))
                take.announced += 1
            if time.monotonic() - self._due(t) > WATCH:
                look = t + ANSWER
            if t >= look:
                for listen in self._listeners:
                    listen()
                look = t + WATCH
                reasons = self._cells.watch(t, plan.position[max(i - 1, 0)], following)
                obeyed = obeyed if reasons else t
                take.trouble += [t] if reasons else []
                if t - obeyed > BLIND:
                    self._retreat(plan, i, quaternions[max(i - 1, 0)])
                    take.reasons = reasons
                    return take
            if self._send_wrist(t, setpoints[i].tolist()):
                take.trouble.append(t)
            if take.begun < len(marks) and marks[take.begun].start <= t:
                take.begun += 1
                goal.publish_feedback(
                    PlayPhrase.Feedback(
                        strike=first + take.begun,
                        total=first + len(marks),
                        note=marks[take.begun - 1].note,
                        progress=float(t / plan.duration),
                    )
                )
        if reasons and plan.duration - obeyed > STATE_FRESH:
            take.reasons = reasons
        return take

    def _retreat(self, plan: Plan, i: int, quaternion: np.ndarray) -> None:
        """Up, on from the last setpoint that was sent."""
        last = max(i - 1, 0)
        path, speeds = plan_retreat(
            plan.position[last], plan.velocity[last, :3], period=1.0 / self._rate
        )
        for k, (p, v) in enumerate(zip(path, speeds, strict=True)):
            self._send_wrist(
                float(plan.time[i]) + k / self._rate, [*p, *quaternion, *v, 0.0, 0.0, 0.0]
            )

    def _due(self, t: float) -> float:
        """When the setpoint for time ``t`` s of the phrase is to be sent, monotonic s."""
        return self._origin + t - self._lead

    def _wait(self, due: float) -> bool:
        """Wait for the time ``due``; returns whether a setpoint that is sent now comes late."""
        left = due - time.monotonic()
        if left > 0:
            time.sleep(left)
        late = time.monotonic() - due
        self.sent += 1
        self.worst_late = max(self.worst_late, late)
        missed = late > self._lead + LATE
        self.late += missed
        return missed

    def _send_wrist(self, t: float, setpoint: Sequence[float]) -> bool:
        """The setpoint for time ``t`` s of the phrase, position, quaternion and velocity in a row,
        when its turn has come; returns whether it came late.
        """
        data = self._setpoint.fill(
            self._wall + round(1e9 * t), pose=setpoint[:7], twist=setpoint[7:]
        )
        late = self._wait(self._due(t))
        self.wrist.publish(data)
        return late

    def _send_vacuum(self, pressure: np.ndarray) -> None:
        message = VacuumCommand(fingers=list(FINGERS), pressure=pressure.tolist())
        message.header.stamp = common.time_msg(time.time_ns())
        self._vacuum.publish(message)
