"""``gap_diagnoser``: where the gap lies, which effect causes it, and how far it shrinks, on the running graph.

Action ``/diagnose_gap`` (DiagnoseGap) diagnoses a bag or the strikes seen live; ``/gap/diagnosis`` (latched) carries the
result, and between diagnoses the stage map, renewed after each strike. The work is done in a niced process of its own.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future as Work
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from pianobot_msgs.action import DiagnoseGap
from pianobot_msgs.msg import (
    Candidate,
    Diagnosis,
    EffectParameter,
    KeyAngle,
    KeyForce,
    MidiEvent,
    StageGap,
    StrikeMark,
    VacuumCommand,
    VacuumState,
    WristCommand,
    WristState,
)
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from scipy.spatial.transform import Rotation

from pianobot_ros.cell.geometry import FINGERS
from pianobot_ros.cell.keystroke import NoteEvent
from pianobot_ros.cell.recording import Strike
from pianobot_ros.cell_gap.live import LATEST, Collector, StageMap, become_polite, diagnose_in_worker, stage_map
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health, HealthLevel

__all__ = ["GapDiagnoser", "main"]

SETTLED = 0.25  # s after a strike's window in which late notes still arrive


class GapDiagnoser(common.PianoNode):
    """The node. One worker process does the computing; a cancelled diagnosis ends that process, and a new one is started."""

    def __init__(self, **options: Any) -> None:
        super().__init__("gap_diagnoser", **options)
        memory = common.declare(self, "memory", 600.0, "s of the live signals that are kept", low=10.0, high=7200.0)
        self._budget = common.declare(self, "budget", 60.0, "s of wall time for a diagnosis", low=5.0, high=3600.0)
        self._collector = Collector(memory)
        self._lock = threading.Lock()
        self._worker: ProcessPoolExecutor | None = None
        self._map: Work[StageMap | str] | None = None
        self._mapped, self._busy, self._last, self._map_age = 0, False, "", math.nan
        self._stopping = threading.Event()
        self._publisher = self.create_publisher(Diagnosis, "/gap/diagnosis", common.LATCHED_QOS)
        self._listen()
        self._server = ActionServer(
            self, DiagnoseGap, "/diagnose_gap", execute_callback=self._execute, goal_callback=self._on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        self._start_worker()
        self.create_timer(0.05, self._tick)

    # Listening.

    def _listen(self) -> None:
        many = 2000
        sensor = common.SENSOR_QOS

        def on(kind: Any, topic: str, callback: Callable[[Any], None], qos: Any) -> None:
            self.create_subscription(kind, topic, callback, qos)

        from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

        deep = QoSProfile(depth=many, history=HistoryPolicy.KEEP_LAST, reliability=sensor.reliability)
        commands = QoSProfile(depth=many, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE)
        on(WristCommand, "/command/wrist", lambda m: self._wrist("command/wrist", m), commands)
        on(VacuumCommand, "/command/vacuum", self._on_vacuum_command, commands)
        on(StrikeMark, "/command/strike", self._on_strike, common.EVENT_QOS)
        on(WristState, "/real/wrist/state", lambda m: self._wrist("real/wrist/state", m), deep)
        on(VacuumState, "/real/vacuum/state", self._on_vacuum, deep)
        on(KeyForce, "/real/fsr", self._on_force, deep)
        on(KeyAngle, "/real/key_angle", self._on_angle, deep)
        on(MidiEvent, "/real/midi", self._on_midi, common.EVENT_QOS)

    def _add(self, name: str, message: Any, value: Any) -> None:
        with self._lock:
            self._collector.add(name, common.seconds(message.header.stamp), value)

    def _wrist(self, name: str, message: WristCommand | WristState) -> None:
        p, q = message.pose.position, message.pose.orientation
        self._add(f"{name}.position", message, (p.x, p.y, p.z))
        length = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
        rotation = Rotation.from_quat((q.x, q.y, q.z, q.w)).as_rotvec() if length > 1e-6 else (0.0, 0.0, 0.0)
        self._add(f"{name}.rotation", message, tuple(rotation))

    def _on_vacuum_command(self, message: VacuumCommand) -> None:
        self._add("command/vacuum.pressure", message, _by_finger(message.fingers, message.pressure))

    def _on_vacuum(self, message: VacuumState) -> None:
        self._add("real/vacuum/state.setpoint", message, _by_finger(message.fingers, message.setpoint))
        self._add("real/vacuum/state.measured", message, _by_finger(message.fingers, message.measured))

    def _on_force(self, message: KeyForce) -> None:
        self._collector.fsr_note = int(message.note)
        self._add("real/fsr.force", message, message.force)

    def _on_angle(self, message: KeyAngle) -> None:
        for note, angle in zip(message.notes, message.angle, strict=False):
            self._add(f"real/key_angle.{int(note)}", message, angle)

    def _on_midi(self, message: MidiEvent) -> None:
        kind = message.status & 0xF0
        if kind in (MidiEvent.NOTE_ON, MidiEvent.NOTE_OFF):
            time_ = common.seconds(message.header.stamp)
            event = NoteEvent(time_, kind == MidiEvent.NOTE_ON, int(message.note), int(message.velocity))
            with self._lock:
                self._collector.note(event)

    def _on_strike(self, m: StrikeMark) -> None:
        start, end = common.seconds(m.header.stamp), common.seconds(m.end)
        strike = Strike(int(m.index), m.phrase, m.condition, m.finger, int(m.note), start, end, m.speed, m.depth, m.hold,
                        m.pressure, m.note_length)  # fmt: skip
        with self._lock:
            self._collector.strike(strike)

    # The stage map.

    def _tick(self) -> None:
        if self._map is not None and self._map.done():
            self._publish_map(self._map)
            self._map = None
        if self._map is None and not self._busy:
            with self._lock:
                finished = self._collector.finished(time.time() - SETTLED)
                if not finished or hash(finished[-1]) == self._mapped:
                    return
                self._mapped = hash(finished[-1])
                recording = self._collector.recording(finished[-LATEST:])
            self._map = self._submit(stage_map, recording)

    def _publish_map(self, work: Work[StageMap | str]) -> None:
        try:
            found = work.result()
        except (BrokenProcessPool, RuntimeError) as error:
            self.get_logger().error(f"the worker ended: {error}; starting another")
            self._start_worker()
            return
        if isinstance(found, str):
            if found != self._last:
                self.get_logger().warning(f"no stage map: {found}")
            self._last = found
            return
        self._last, self._map_age = found.text, time.monotonic()
        message = Diagnosis(sentence=found.text, strikes=found.strikes, json="")
        message.header.stamp = common.time_msg(time.time_ns())
        message.stages = [StageGap(name=n, gap=g, floor=1.0, share=s) for n, g, s in found.stages]
        self._publisher.publish(message)

    # The worker.

    def _start_worker(self) -> None:
        self._end_worker()
        context = multiprocessing.get_context("spawn")
        self._worker = ProcessPoolExecutor(1, mp_context=context, initializer=become_polite)
        self._worker.submit(int)  # so that the process is there before the first strike

    def _end_worker(self) -> None:
        if self._worker is not None:
            for process in list((self._worker._processes or {}).values()):
                process.terminate()
            self._worker.shutdown(wait=False, cancel_futures=True)
            self._worker = None

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Work[Any]:
        assert self._worker is not None
        try:
            return self._worker.submit(function, *arguments)
        except BrokenProcessPool:
            self._start_worker()
            return self._worker.submit(function, *arguments)

    # Goals.

    def _on_goal(self, _: Any) -> GoalResponse:
        if self._busy or self._stopping.is_set():
            self.get_logger().warning("goal rejected: a diagnosis is running; cancel it first")
            return GoalResponse.REJECT
        self._busy = True
        return GoalResponse.ACCEPT

    async def _execute(self, goal: Any) -> DiagnoseGap.Result:
        from rclpy.task import Future

        done: Future = Future(executor=self.executor)
        threading.Thread(target=lambda: done.set_result(self._diagnose(goal)), name="diagnose", daemon=True).start()
        await done
        ended, result = done.result()
        {"succeeded": goal.succeed, "canceled": goal.canceled, "aborted": goal.abort}[ended]()
        return result

    def _diagnose(self, goal: Any) -> tuple[str, DiagnoseGap.Result]:
        result = DiagnoseGap.Result()
        try:
            request = goal.request
            source: Any = request.recording
            if not source:
                with self._lock:
                    finished = self._collector.finished(time.time() - SETTLED)
                    source = self._collector.recording(finished) if finished else None
                if source is None:
                    result.message = "no strikes seen live yet: play a phrase first, or name a recording"
                    return "aborted", result
            work = self._submit(
                diagnose_in_worker, source, request.output, int(request.seed), int(request.strikes), self._budget
            )
            begun = time.monotonic()
            while not work.done():
                if goal.is_cancel_requested or self._stopping.is_set():
                    self._start_worker() if not self._stopping.is_set() else self._end_worker()
                    result.message = "cancelled"
                    return ("canceled" if goal.is_cancel_requested else "aborted"), result
                share = min(0.95, (time.monotonic() - begun) / self._budget)
                goal.publish_feedback(DiagnoseGap.Feedback(stage="comparing effects", progress=share))
                self._stopping.wait(0.2)
            found = work.result()
        except Exception as error:
            result.message = f"the diagnosis failed: {type(error).__name__}: {error}"
            self.get_logger().error(result.message)
            if isinstance(error, BrokenProcessPool):
                self._start_worker()
            return "aborted", result
        finally:
            self._busy = False
        if isinstance(found, str):
            result.message = found
            self.get_logger().error(f"cannot diagnose: {found}")
            return "aborted", result
        result.diagnosis = _message(found)
        self._publisher.publish(result.diagnosis)
        result.success, result.message = True, str(found["sentence"])
        result.report = str(Path(request.output) / "report.html") if request.output else ""
        self._last = result.message
        self.get_logger().info(result.message)
        return "succeeded", result

    def diagnose(self) -> Mapping[str, Health]:
        """What was found last."""
        age = time.monotonic() - self._map_age if math.isfinite(self._map_age) else 0.0
        text = "diagnosing" if self._busy else (self._last or "waiting for strikes")
        return {"gap": Health(HealthLevel.OK, text, age, {"strikes": len(self._collector.strikes)})}

    def shut_down(self) -> None:
        """End the worker."""
        self._stopping.set()
        end = time.monotonic() + 2.0
        while self._busy and time.monotonic() < end:
            time.sleep(0.01)
        self._end_worker()
        self._server.destroy()


def _by_finger(fingers: Sequence[str], values: Sequence[float]) -> tuple[float, ...]:
    named = dict(zip(fingers, values, strict=False))
    return tuple(float(named.get(f, math.nan)) for f in FINGERS)


def _message(document: Mapping[str, Any]) -> Diagnosis:
    """The message of a diagnosis.json."""

    def number(x: Any) -> float:
        return math.nan if x is None else float(x)

    gap = document["gap"]
    message = Diagnosis(
        verdict=document["verdict"], sentence=document["sentence"], credible_set=list(document["credible_set"]),
        gap_floor=number(gap["floor"]), gap_before=number(gap["before"]), gap_refit=number(gap["refit"]),
        gap_after=number(gap["after"]), gap_closed=number(gap["closed"]), gap_closed_low=number(gap["closed_low"]),
        gap_closed_high=number(gap["closed_high"]), strikes=int(document["provenance"].get("strikes", 0)),
        json=json.dumps(document),
    )  # fmt: skip
    message.header.stamp = common.time_msg(time.time_ns())
    message.candidates = [
        Candidate(name=c["name"], stage=c["stage"], probability=number(c["probability"]))
        for c in document["candidates"]
    ]
    message.parameters = [
        EffectParameter(effect=e["name"], name=n, value=number(p["value"]), low=number(p["low"]), high=number(p["high"]),
                        unit=p["unit"])
        for e in document["effects"] for n, p in e["parameters"].items()
    ]  # fmt: skip
    message.stages = [
        StageGap(name=s["name"], gap=number(s["gap"]), floor=number(s["floor"]), share=number(s["share"]))
        for s in document["stages"]
    ]
    return message


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(GapDiagnoser, arguments, timely=False)


if __name__ == "__main__":
    sys.exit(main())
