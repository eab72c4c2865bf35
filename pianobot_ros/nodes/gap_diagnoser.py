"""``gap_diagnoser``: where the gap lies, which effect causes it, and how far it shrinks, on the running graph.

Action ``/diagnose_gap`` (DiagnoseGap) diagnoses a bag or the strikes seen live; ``/gap/diagnosis`` (latched) carries the
result, and between diagnoses the stage map, renewed after each strike. The work is done in a niced process of its own.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future as Work
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from pianobot_msgs.action import DiagnoseGap
from pianobot_msgs.msg import Candidate, Diagnosis, EffectParameter, StageGap
from rclpy.action import ActionServer, CancelResponse

from pianobot_ros.cell.budget import DIAGNOSIS_BUDGET
from pianobot_ros.cell_gap.live import LATEST, Collector, StageMap, become_polite, diagnose_in_worker, stage_map
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health, HealthLevel
from pianobot_ros.nodes.jobs import OneJob
from pianobot_ros.nodes.live_signals import PERIOD, LiveSignals

__all__ = ["GapDiagnoser", "main"]

SETTLED = PERIOD + 0.25  # s after a strike's window in which its samples and late notes still arrive


class GapDiagnoser(common.PianoNode):
    """The node. One worker process does the computing; a cancelled diagnosis ends that process, and a new one is started."""

    def __init__(self, **options: Any) -> None:
        super().__init__("gap_diagnoser", **options)
        memory = common.declare(self, "memory", 600.0, "s of the live signals that are kept", low=10.0, high=7200.0)
        self._budget = common.declare(
            self, "budget", DIAGNOSIS_BUDGET, "s of wall time for a diagnosis", low=5.0, high=3600.0
        )
        period = common.declare(self, "map_period", 0.8, "least s between two stage maps", low=0.1, high=600.0)
        self._period = period
        self._signals = LiveSignals(self, Collector(memory))
        self._job = OneJob(self, "a diagnosis is running; cancel it first")
        self._worker: ProcessPoolExecutor | None = None
        self._map: Work[StageMap | str] | None = None
        self._mapped, self._last, self._map_age, self._next_map = 0, "", math.nan, 0.0
        self._publisher = self.create_publisher(Diagnosis, "/gap/diagnosis", common.LATCHED_QOS)
        self._server = ActionServer(
            self, DiagnoseGap, "/diagnose_gap", execute_callback=self._job.executes(self._diagnose),
            goal_callback=self._job.accepts, cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip
        self._start_worker()
        self.create_timer(0.25, self._tick)

    # The stage map.

    def _tick(self) -> None:
        if self._map is not None and self._map.done():
            self._publish_map(self._map)
            self._map = None
        if self._map is None and not self._job.busy and time.monotonic() >= self._next_map:
            with self._signals.lock:
                finished = self._signals.collector.finished(time.time() - SETTLED)
                if not finished or hash(finished[-1]) == self._mapped:
                    return
                self._mapped = hash(finished[-1])
                recording = self._signals.collector.recording(finished[-LATEST:])
            self._next_map = time.monotonic() + self._period
            self._map = self._submit(stage_map, recording)

    def _publish_map(self, work: Work[StageMap | str]) -> None:
        try:
            found = work.result()
        except (BrokenProcessPool, RuntimeError) as error:
            self.get_logger().error(f"the worker ended: {error}; starting another")
            self._start_worker()
            return
        except Exception as error:  # a strike that no map can be made of ends neither the node nor the worker
            found = f"{type(error).__name__}: {error}"
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
        for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
            os.environ.setdefault(
                name, "1"
            )  # for the process to come: beside a running cell more threads are in the way
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

    def _diagnose(self, goal: Any) -> tuple[str, DiagnoseGap.Result]:
        result = DiagnoseGap.Result()
        try:
            request = goal.request
            source: Any = request.recording
            if not source:
                with self._signals.lock:
                    finished = self._signals.collector.finished(time.time() - SETTLED)
                    source = self._signals.collector.recording(finished) if finished else None
                if source is None:
                    result.message = "no strikes seen live yet: play a phrase first, or name a recording"
                    return "aborted", result
            work = self._submit(
                diagnose_in_worker, source, request.output, int(request.seed), int(request.strikes), self._budget
            )
            begun = time.monotonic()
            while not work.done():
                if goal.is_cancel_requested or self._job.stopping.is_set():
                    self._start_worker() if not self._job.stopping.is_set() else self._end_worker()
                    result.message = "cancelled"
                    return ("canceled" if goal.is_cancel_requested else "aborted"), result
                share = min(0.95, (time.monotonic() - begun) / self._budget)
                goal.publish_feedback(DiagnoseGap.Feedback(stage="comparing effects", progress=share))
                self._job.stopping.wait(0.2)
            found = work.result()
        except Exception as error:
            result.message = f"the diagnosis failed: {type(error).__name__}: {error}"
            self.get_logger().error(result.message)
            if isinstance(error, BrokenProcessPool):
                self._start_worker()
            return "aborted", result
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
        text = "diagnosing" if self._job.busy else (self._last or "waiting for strikes")
        return {"gap": Health(HealthLevel.OK, text, age, {"strikes": len(self._signals.collector.strikes)})}

    def shut_down(self) -> None:
        """End the worker."""
        self._job.close(2.0)
        self._end_worker()
        self._server.destroy()


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
