"""``conductor``: plays phrases on both cells.

Action ``/play_phrase`` (PlayPhrase): plans the score, then streams ``/command/wrist`` at the
arm's rate on an absolute time base, ``/command/vacuum`` when it changes and once a second, and one ``/command/strike``
shortly before each strike. Between phrases nothing is streamed: the arm holds. Cancel brings the wrist up smoothly.

Each setpoint is sent ``lead`` seconds before the time that it is stamped with, and both cells obey it at that time: a delay of
this process, or on the way, does not shape the motion.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pianobot_msgs.action import PlayPhrase
from pianobot_msgs.msg import StrikeMark, VacuumCommand, WristCommand, WristState
from rclpy.action import ActionServer, CancelResponse
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.clocks import wall_offset_ns
from pianobot_ros.cell.errors import PianobotError, ScoreError
from pianobot_ros.cell.geometry import FINGERS, WristPose
from pianobot_ros.cell.limits import wrist_limits
from pianobot_ros.cell.phrase import parse_phrase
from pianobot_ros.cell.plan import Plan, plan_retreat, plan_score
from pianobot_ros.cell.recording import Strike
from pianobot_ros.cell.score import load_score
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health, HealthLevel
from pianobot_ros.nodes.following import Following
from pianobot_ros.nodes.jobs import OneJob
from pianobot_ros.nodes.polled import PolledSubscription, stream_qos
from pianobot_ros.nodes.template import Template

__all__ = ["Conductor", "main"]

MARK_AHEAD = 0.1  # s by which a strike is announced before its window starts
STATE_FRESH = 0.5  # s; an older state of a cell says nothing about where its wrist is
LATE = 0.012  # s; a setpoint that comes so long after its time is counted
BLIND = 2.5  # s without a state of a required cell, or with an arm that does not obey, after which a phrase is given up; a driver
# that starved its controller's watchdog has its program back in one
NODE = {"real": "ur5_wrist", "sim": "sim_twin"}
WATCH = 0.1  # s between two looks at the cells while a phrase plays


class Conductor(common.PianoNode):
    """The node. Goals are executed on a thread of their own, so that the executor stays free for cancel and states."""

    def __init__(self, **options: Any) -> None:
        super().__init__("conductor", **options)
        self._rate = common.declare(self, "rate", 125.0, "Hz of the wrist setpoints", low=50.0, high=500.0)
        self._lead = common.declare(
            self, "lead", 0.05, "s by which a setpoint is sent before it is to be obeyed", low=0.0, high=0.15
        )
        self._require = common.declare(
            self,
            "require",
            ["real", "sim"],
            "cells that must report their wrist before a phrase is played",
            read_only=True,
        )
        common.declare(
            self, "ready_timeout", 5.0, "s to wait for the cells at the start of a phrase", low=0.0, high=120.0
        )
        common.declare(self, "transpose", 0, "semitones added to every score", low=-60, high=60)
        for cell in self._require:
            if cell not in ("real", "sim"):
                raise PianobotError(f"conductor: parameter 'require' names '{cell}'; valid: real, sim")
        self._wrist = self.create_publisher(WristCommand, "/command/wrist", common.command_publisher_qos(), event_callbacks=
                                            common.publisher_events(self, "/command/wrist"))  # fmt: skip
        self._vacuum = self.create_publisher(VacuumCommand, "/command/vacuum", common.EVENT_QOS)
        self._strike = self.create_publisher(StrikeMark, "/command/strike", common.EVENT_QOS)
        self._states: dict[str, tuple[float, WristState]] = {}
        # Looked at only when needed: 250 messages a second would cost more than everything else here.
        self._streams = {
            cell: PolledSubscription(self, WristState, f"/{cell}/wrist/state", stream_qos(1))
            for cell in ("real", "sim")
        }
        self._guard = OneJob(self, "a phrase is being played; cancel it first")
        self._origin, self._wall = 0.0, 0  # time 0 of the phrase: monotonic s, and ns since the epoch
        setpoint = WristCommand()
        setpoint.header.frame_id = "base"
        self._setpoint = Template(setpoint, pose="7d", twist="6d")
        self._playing = ""
        self._late = self._sent = 0
        self._worst_late = 0.0
        self._server = ActionServer(
            self, PlayPhrase, "/play_phrase", execute_callback=self._guard.executes(self._play, polite=False),
            goal_callback=self._guard.accepts, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def _look(self) -> None:
        """Take the newest state of each cell."""
        for cell, stream in self._streams.items():
            if taken := stream.take():
                self._states[cell] = (time.monotonic(), deserialize_message(taken[-1][0], WristState))

    def diagnose(self) -> Mapping[str, Health]:
        """What is playing, and how many setpoints came after their time."""
        level = HealthLevel.WARN if self._late else HealthLevel.OK
        text = f"playing {self._playing}" if self._playing else "idle"
        values = {"setpoints": self._sent, "late": self._late, "worst_lateness_ms": 1e3 * self._worst_late}
        return {"conductor": Health(level, text, 0.0, values)}

    def shut_down(self) -> None:
        """Bring the wrist up before leaving."""
        self._guard.close(4.0)
        self._server.destroy()

    # Goals.

    def _play(self, goal: Any) -> tuple[str, PlayPhrase.Result]:
        result = PlayPhrase.Result()
        try:
            plan = self._plan(goal.request)
            result.unreachable = list(plan.unreachable)
            for line in plan.unreachable:
                self.get_logger().warning(f"left out: {line}")
            self._playing = plan.name
            self.get_logger().info(f"playing {plan.name}: {len(plan.strikes)} strikes, {plan.duration:.1f} s")
            played = self._stream(plan, goal)
            result.strikes = played
            if self._guard.stopping.is_set() or goal.is_cancel_requested:
                result.message = f"cancelled after {played} of {len(plan.strikes)} strikes; the wrist is up"
                return ("canceled" if goal.is_cancel_requested else "aborted"), result
            result.success, result.message = True, f"{plan.name}: {played} strikes played"
        except PianobotError as error:
            result.message = str(error)
            self.get_logger().error(f"cannot play: {error}")
            return "aborted", result
        except Exception as error:
            self.get_logger().error(f"playing failed: {type(error).__name__}: {error}")
            result.message = f"internal error: {error}"
            return "aborted", result
        else:
            self.get_logger().info(result.message)
            return "succeeded", result
        finally:
            self._playing = ""

    def _plan(self, request: PlayPhrase.Goal) -> Plan:
        tempo, transpose = request.tempo or 1.0, int(self.get_parameter("transpose").value)
        if request.phrase_yaml and request.score:
            raise ScoreError("give score or phrase_yaml, not both")
        if request.phrase_yaml:
            score = parse_phrase(request.phrase_yaml, transpose=transpose, tempo=tempo)
        elif request.score:
            score = load_score(request.score, transpose=transpose, tempo=tempo)
        else:
            raise ScoreError("there is no score: give a file, the name of a phrase, or phrase_yaml")
        self._wait_ready()
        return plan_score(score.repeated(int(request.repeats)), self._start_pose(), period=1.0 / self._rate)

    def _wait_ready(self) -> None:
        """Wait until every required cell reports a wrist that can move. Raises :class:`PianobotError` saying which does not."""
        self._look()
        self._states.clear()  # what comes from now on counts: a node may have died a moment ago
        end = time.monotonic() + float(self.get_parameter("ready_timeout").value)
        while (reasons := self._not_ready()) and time.monotonic() < end and not self._guard.stopping.is_set():
            time.sleep(0.02)
        if reasons:
            raise PianobotError("; ".join(reasons))

    def _watch(self, t: float, sent: np.ndarray, following: Mapping[str, Following]) -> list[str]:
        """Why the phrase cannot go on at its time ``t`` s, when ``sent`` was the last position (3,) m: empty if it can."""
        if reasons := self._not_ready():
            return reasons
        for cell, follows in following.items():
            p = self._states[cell][1].target_pose.position
            follows.look(t, sent.tolist(), [p.x, p.y, p.z])
        return [
            f"the {cell} arm does not move with the setpoints: /command/wrist does not reach {NODE[cell]}"
            for cell, follows in following.items()
            if follows.deaf
        ]

    def _not_ready(self) -> list[str]:
        self._look()
        reasons, now = [], time.monotonic()
        for cell in self._require:
            seen, state = self._states.get(cell, (0.0, None))
            node = NODE[cell]
            if state is None or now - seen > STATE_FRESH:
                reasons.append(f"the {cell} cell does not report /{cell}/wrist/state: is {node} running and active?")
            elif state.safety_state not in (WristState.SAFETY_NORMAL, WristState.SAFETY_REDUCED):
                reasons.append(
                    f"the {cell} arm is in safety state {state.safety_state}: clear the stop and call /{node}/recover"
                )
            elif state.controller_time > 0.0 and not state.program_running:
                reasons.append(f"the program of the {cell} arm does not run: call /{node}/recover")
        return reasons

    def _start_pose(self) -> WristPose:
        """Where the wrist is: the real one first, since the arm moves on from there."""
        for cell in ("real", "sim"):
            seen, state = self._states.get(cell, (0.0, None))
            if state is not None and time.monotonic() - seen < STATE_FRESH:
                p, q = state.pose.position, state.pose.orientation
                roll, pitch, yaw = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_euler("xyz")
                return WristPose(x=p.x, y=p.y, z=p.z, roll=roll, pitch=pitch, yaw=yaw)
        x, y, z = wrist_limits().home
        return WristPose(x=x, y=y, z=z)

    # Streaming.

    def _stream(self, plan: Plan, goal: Any) -> int:
        """Send the plan on an absolute time base; returns the strikes whose motion has begun.

        Raises :class:`PianobotError` if a cell stops obeying on the way.
        """
        quaternions = Rotation.from_rotvec(plan.rotation).as_quat()
        ahead = self._lead + 0.02
        self._origin = time.monotonic() + ahead
        self._wall = round(1e9 * self._origin) + wall_offset_ns()
        marks, begun, vacuum_row, vacuum_due = list(plan.strikes), 0, -1, 0.0
        upcoming, obeyed, look = 0, 0.0, 0.0
        following = {cell: Following(BLIND) for cell in self._require}
        reasons: list[str] = []
        for i, t in enumerate(plan.time.tolist()):
            if self._guard.stopping.is_set() or goal.is_cancel_requested:
                self._retreat(plan, i, quaternions[max(i - 1, 0)])
                return begun
            now = t - self._lead  # the vacuum is not sent ahead: its regulator obeys at once
            row = max(int(np.searchsorted(plan.vacuum_time, now, side="right")) - 1, 0)
            if row != vacuum_row or now >= vacuum_due:
                self._send_vacuum(plan.pressure[row])
                vacuum_row, vacuum_due = row, now + 1.0
            while upcoming < len(marks) and marks[upcoming].start <= t + MARK_AHEAD:
                self._strike.publish(_mark(marks[upcoming], self._wall))
                upcoming += 1
            if t >= look:
                look, reasons = t + WATCH, self._watch(t, plan.position[max(i - 1, 0)], following)
                obeyed = obeyed if reasons else t
                if t - obeyed > BLIND:
                    self._retreat(plan, i, quaternions[max(i - 1, 0)])
                    raise PianobotError(f"given up after {begun} of {len(marks)} strikes: {'; '.join(reasons)}")
            self._send_wrist(t, plan.position[i], quaternions[i], plan.velocity[i])
            if begun < len(marks) and marks[begun].start <= t:
                begun += 1
                goal.publish_feedback(
                    PlayPhrase.Feedback(
                        strike=begun, total=len(marks), note=marks[begun - 1].note, progress=float(t / plan.duration)
                    )
                )
        if reasons and plan.duration - obeyed > STATE_FRESH:
            raise PianobotError(f"played to the end, but {'; '.join(reasons)}")
        return begun

    def _retreat(self, plan: Plan, i: int, quaternion: np.ndarray) -> None:
        """Up, on from the last setpoint that was sent."""
        last = max(i - 1, 0)
        path, speeds = plan_retreat(plan.position[last], plan.velocity[last, :3], period=1.0 / self._rate)
        for k, (p, v) in enumerate(zip(path, speeds, strict=True)):
            self._send_wrist(float(plan.time[i]) + k / self._rate, p, quaternion, np.concatenate([v, np.zeros(3)]))

    def _wait(self, due: float) -> None:
        left = due - time.monotonic()
        if left > 0:
            time.sleep(left)
        late = time.monotonic() - due
        self._sent += 1
        self._worst_late = max(self._worst_late, late)
        self._late += late > self._lead + LATE

    def _send_wrist(self, t: float, position: np.ndarray, quaternion: np.ndarray, velocity: np.ndarray) -> None:
        """The setpoint for time ``t`` s of the phrase, when its turn has come."""
        self._wait(self._origin + t - self._lead)
        pose, twist = [*position.tolist(), *quaternion.tolist()], velocity.tolist()
        self._wrist.publish(self._setpoint.fill(self._wall + round(1e9 * t), pose=pose, twist=twist))

    def _send_vacuum(self, pressure: np.ndarray) -> None:
        message = VacuumCommand(fingers=list(FINGERS), pressure=pressure.tolist())
        message.header.stamp = common.time_msg(time.time_ns())
        self._vacuum.publish(message)


def _mark(strike: Strike, origin_ns: int) -> StrikeMark:
    message = StrikeMark(
        index=strike.index, phrase=strike.phrase, condition=strike.condition, finger=strike.finger, note=strike.note,
        speed=float(strike.speed), depth=float(strike.depth), hold=float(strike.hold), pressure=float(strike.pressure),
        note_length=float(strike.note_length),
    )  # fmt: skip
    message.header.stamp = common.time_msg(origin_ns + round(1e9 * strike.start))
    message.end = common.time_msg(origin_ns + round(1e9 * strike.end))
    return message


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(Conductor, arguments, pace=common.PACE)


if __name__ == "__main__":
    sys.exit(main())
