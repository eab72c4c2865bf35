"""``conductor``: plays phrases on both cells.

Action ``/play_phrase`` (PlayPhrase): plans the score, then streams ``/command/wrist`` at the
arm's rate on an absolute time base, ``/command/vacuum`` when it changes and once a second, and one ``/command/strike``
shortly before each strike. Between phrases nothing is streamed: the arm holds. Cancel brings the wrist up smoothly.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Twist, Vector3
from pianobot_msgs.action import PlayPhrase
from pianobot_msgs.msg import StrikeMark, VacuumCommand, WristCommand, WristState
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.errors import PianobotError, ScoreError
from pianobot_ros.cell.geometry import FINGERS, WristPose
from pianobot_ros.cell.limits import wrist_limits
from pianobot_ros.cell.phrase import parse_phrase
from pianobot_ros.cell.plan import Plan, plan_retreat, plan_score
from pianobot_ros.cell.recording import Strike
from pianobot_ros.cell.score import load_score
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health, HealthLevel

__all__ = ["Conductor", "main"]

MARK_AHEAD = 0.1  # s by which a strike is announced before its window starts
STATE_FRESH = 0.5  # s; an older state of a cell says nothing about where its wrist is
LATE = 0.012  # s; a setpoint later than this is counted


class Conductor(common.PianoNode):
    """The node. Goals are executed on a thread of their own, so that the executor stays free for cancel and states."""

    def __init__(self, **options: Any) -> None:
        super().__init__("conductor", **options)
        self._rate = common.declare(self, "rate", 125.0, "Hz of the wrist setpoints", low=50.0, high=500.0)
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
        self._vacuum = self.create_publisher(VacuumCommand, "/command/vacuum", common.COMMAND_QOS)
        self._strike = self.create_publisher(StrikeMark, "/command/strike", common.EVENT_QOS)
        self._states: dict[str, tuple[float, WristState]] = {}
        for cell in ("real", "sim"):
            self.create_subscription(
                WristState, f"/{cell}/wrist/state", lambda m, c=cell: self._on_state(c, m), common.SENSOR_QOS
            )
        self._lock = threading.Lock()
        self._busy = False
        self._stopping = threading.Event()
        self._playing = ""
        self._late = 0
        self._sent = 0
        self._worst_late = 0.0
        self._server = ActionServer(
            self, PlayPhrase, "/play_phrase", execute_callback=self._execute, goal_callback=self._on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def _on_state(self, cell: str, message: WristState) -> None:
        self._states[cell] = (time.monotonic(), message)

    def diagnose(self) -> Mapping[str, Health]:
        """What is playing, and how punctual the setpoints are."""
        level = HealthLevel.WARN if self._late else HealthLevel.OK
        text = f"playing {self._playing}" if self._playing else "idle"
        values = {"setpoints": self._sent, "late": self._late, "worst_lateness_ms": 1e3 * self._worst_late}
        return {"conductor": Health(level, text, 0.0, values)}

    def shut_down(self) -> None:
        """Bring the wrist up before leaving."""
        self._stopping.set()
        end = time.monotonic() + 4.0
        while self._busy and time.monotonic() < end:
            time.sleep(0.01)
        self._server.destroy()

    # Goals.

    def _on_goal(self, _: Any) -> GoalResponse:
        with self._lock:
            if self._busy or self._stopping.is_set():
                self.get_logger().warning("goal rejected: a phrase is being played; cancel it first")
                return GoalResponse.REJECT
            self._busy = True
        return GoalResponse.ACCEPT

    async def _execute(self, goal: Any) -> PlayPhrase.Result:
        from rclpy.task import Future

        done: Future = Future(executor=self.executor)
        threading.Thread(target=lambda: done.set_result(self._play(goal)), name="play", daemon=True).start()
        await done
        ended, result = done.result()
        {"succeeded": goal.succeed, "canceled": goal.canceled, "aborted": goal.abort}[ended]()
        return result

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
            if self._stopping.is_set() or goal.is_cancel_requested:
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
            self._playing, self._busy = "", False

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
        end = time.monotonic() + float(self.get_parameter("ready_timeout").value)
        while (reasons := self._not_ready()) and time.monotonic() < end and not self._stopping.is_set():
            time.sleep(0.02)
        if reasons:
            raise PianobotError("; ".join(reasons))

    def _not_ready(self) -> list[str]:
        reasons, now = [], time.monotonic()
        for cell in self._require:
            seen, state = self._states.get(cell, (0.0, None))
            node = "ur5_wrist" if cell == "real" else "sim_twin"
            if state is None or now - seen > STATE_FRESH:
                reasons.append(f"the {cell} cell does not report /{cell}/wrist/state: is {node} running and active?")
            elif state.safety_state not in (WristState.SAFETY_NORMAL, WristState.SAFETY_REDUCED):
                reasons.append(
                    f"the {cell} arm is in safety state {state.safety_state}: clear the stop and call /{node}/recover"
                )
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
        """Send the plan on an absolute time base; returns the strikes whose motion has begun."""
        quaternions = Rotation.from_rotvec(plan.rotation).as_quat()
        origin, wall = time.monotonic() + 0.02, time.time_ns() + 20_000_000
        marks, begun, vacuum_row, vacuum_due = list(plan.strikes), 0, -1, 0.0
        upcoming = 0
        for i, t in enumerate(plan.time):
            if self._stopping.is_set() or goal.is_cancel_requested:
                self._retreat(plan, i, quaternions[max(i - 1, 0)])
                return begun
            row = int(np.searchsorted(plan.vacuum_time, t, side="right")) - 1
            if row != vacuum_row or t >= vacuum_due:
                self._send_vacuum(plan.pressure[row])
                vacuum_row, vacuum_due = row, t + 1.0
            while upcoming < len(marks) and marks[upcoming].start <= t + MARK_AHEAD:
                self._strike.publish(_mark(marks[upcoming], wall))
                upcoming += 1
            self._wait(origin + t)
            self._send_wrist(plan.position[i], quaternions[i], plan.velocity[i])
            if begun < len(marks) and marks[begun].start <= t:
                begun += 1
                goal.publish_feedback(
                    PlayPhrase.Feedback(
                        strike=begun, total=len(marks), note=marks[begun - 1].note, progress=float(t / plan.duration)
                    )
                )
        return begun

    def _retreat(self, plan: Plan, i: int, quaternion: np.ndarray) -> None:
        last = max(i - 1, 0)
        path, speeds = plan_retreat(plan.position[last], plan.velocity[last, :3], period=1.0 / self._rate)
        start = time.monotonic()
        for k, (p, v) in enumerate(zip(path, speeds, strict=True)):
            self._wait(start + k / self._rate)
            self._send_wrist(p, quaternion, np.concatenate([v, np.zeros(3)]))

    def _wait(self, due: float) -> None:
        left = due - time.monotonic()
        if left > 0:
            time.sleep(left)
        late = time.monotonic() - due
        self._sent += 1
        self._worst_late = max(self._worst_late, late)
        self._late += late > LATE

    def _send_wrist(self, position: np.ndarray, quaternion: np.ndarray, velocity: np.ndarray) -> None:
        message = WristCommand()
        message.header.stamp, message.header.frame_id = common.time_msg(time.time_ns()), "base"
        x, y, z = position.tolist()
        qx, qy, qz, qw = quaternion.tolist()
        vx, vy, vz, wx, wy, wz = velocity.tolist()
        message.pose = Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))
        message.twist = Twist(linear=Vector3(x=vx, y=vy, z=vz), angular=Vector3(x=wx, y=wy, z=wz))
        self._wrist.publish(message)

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
    return common.run(Conductor, arguments)


if __name__ == "__main__":
    sys.exit(main())
