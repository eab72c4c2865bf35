"""``gap_diagnoser``: where the gap lies, which effect causes it, and how far it shrinks, on the
running graph.

Action ``/diagnose_gap`` (DiagnoseGap) diagnoses a bag or the strikes seen live; ``/gap/diagnosis``
(latched) carries the result, and between diagnoses the stage map, renewed after strikes, at most
every ``map_period`` s. The work is done in a niced process of its own.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future as Work
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from pianobot_msgs.action import DiagnoseGap, Investigate
from pianobot_msgs.msg import Diagnosis

from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.nodes.analysis.diagnosis_messages import (
    diagnosis_message,
    leaders_message,
    map_message,
)
from pianobot_ros.nodes.analysis.diagnosis_process import DiagnosisProcess
from pianobot_ros.nodes.analysis.investigating import Investigating
from pianobot_ros.nodes.analysis.live_signals import PERIOD, LiveSignals
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health, HealthLevel
from pianobot_ros.nodes.base.jobs import OneJob
from pianobot_ros.piano.gap.diagnosis.live import (
    LATEST,
    Collector,
    StageMap,
    background_stage_map,
    diagnose_in_worker,
)

__all__ = ["GapDiagnoser", "main"]

# s after a strike's window in which its samples and late notes still arrive
FINISHED_AFTER = PERIOD + 0.25


class _Refused(Exception):  # noqa: N818 (no error: the goal cannot be carried out)
    """There is nothing to diagnose."""


class GapDiagnoser(common.PianoNode):
    """The node. One worker process does the computing; a cancelled diagnosis ends that process, and
    a new one is started.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("gap_diagnoser", **options)
        memory = self.declare("memory", 600.0, "s of the live signals that are kept", 10.0, 7200.0)
        self._budget = self.declare(
            "budget", DIAGNOSIS_BUDGET, "strikes simulated for a diagnosis", 100, 10_000_000
        )
        self._period = self.declare("map_period", 2.0, "least s between two stage maps", 0.1, 600.0)
        self._signals = LiveSignals(self, Collector(memory))
        self._job = OneJob(self, "a diagnosis is running; cancel it first")
        self._process = DiagnosisProcess(self._job.stopping)
        self._leaders: tuple[tuple[str, float], ...] = ()
        self._map: Work[StageMap | str] | None = None
        self._mapped, self._last, self._map_age, self._next_map = 0, "", math.nan, 0.0
        self._publisher = self.create_publisher(Diagnosis, "/gap/diagnosis", common.LATCHED_QOS)
        self._investigating = Investigating(
            self, self._signals, FINISHED_AFTER, self._job, self._process, self._found
        )
        self._servers = [
            self._job.serve(kind, name, self._job.executes(work))
            for kind, name, work in (
                (DiagnoseGap, "/diagnose_gap", self._diagnose),
                (Investigate, "/investigate", self._investigating.run),
            )
        ]
        self._process.start()
        self.create_timer(0.25, self._tick)

    # The stage map.

    def _tick(self) -> None:
        if self._map is not None and self._map.done():
            self._publish_map(self._map)
            self._map = None
        if self._map is None and not self._job.busy and time.monotonic() >= self._next_map:
            with self._signals.lock:
                finished = self._signals.collector.finished(time.time() - FINISHED_AFTER)
                if not finished or hash(finished[-1]) == self._mapped:
                    return
                self._mapped = hash(finished[-1])
                recording = self._signals.collector.recording(finished[-LATEST:])
            self._next_map = time.monotonic() + self._period
            self._map = self._process.submit(background_stage_map, recording)

    def _publish_map(self, work: Work[StageMap | str]) -> None:
        try:
            found = work.result()
        except BrokenProcessPool as error:
            self.get_logger().error(f"the worker ended: {error}; starting another")
            self._process.start()
            return
        except (
            Exception
        ) as error:  # a strike that no map can be made of ends neither the node nor the worker
            found = f"{type(error).__name__}: {error}"
        if isinstance(found, str):
            if found != self._last:
                self.get_logger().warning(f"no stage map: {found}")
            self._last = found
            return
        self._last, self._map_age = found.text, time.monotonic()
        self._publisher.publish(map_message(found))

    def _found(self, document: Mapping[str, Any]) -> Diagnosis:
        """The message of a diagnosis, which is published too."""
        message = diagnosis_message(document)
        self._publisher.publish(message)
        self._last = message.sentence
        return message

    # Goals.

    def _diagnose(self, goal: Any) -> tuple[str, DiagnoseGap.Result]:
        result = DiagnoseGap.Result()
        request = goal.request
        try:
            found = self._compute(goal, self._source(request.recording))
        except _Refused as refusal:
            result.message = str(refusal)
            return "aborted", result
        except Exception as error:
            result.message = f"the diagnosis failed: {type(error).__name__}: {error}"
            self.get_logger().error(result.message)
            if isinstance(error, BrokenProcessPool):
                self._process.start()
            return "aborted", result
        if found is None:
            result.message = "cancelled"
            return ("canceled" if goal.is_cancel_requested else "aborted"), result
        if isinstance(found, str):
            result.message = found
            self.get_logger().error(f"cannot diagnose: {found}")
            return "aborted", result
        result.report = str(Path(request.output) / "report.html") if request.output else ""
        result.diagnosis = self._found({**found, "report": result.report})
        result.success, result.message = True, str(found["sentence"])
        self.get_logger().info(result.message)
        return "succeeded", result

    def _source(self, named: str) -> str | Recording:
        """What a goal wants diagnosed: the recording that it names, else the strikes seen live."""
        if named:
            # At once: the worker may be busy, or compiling.
            if not Path(named).exists():
                raise _Refused(f"there is no recording at {Path(named).absolute()}")
            return named
        with self._signals.lock:
            collector = self._signals.collector
            if finished := collector.finished(time.time() - FINISHED_AFTER):
                return collector.recording(finished)
        raise _Refused("no strikes seen live yet: play a phrase first, or name a recording")

    def _compute(self, goal: Any, source: str | Recording) -> Any:
        """The diagnosis as a document, or why there is none; None if it was stopped."""
        request = goal.request
        numbers = (int(request.seed), int(request.strikes), self._budget)
        work = self._process.submit(diagnose_in_worker, source, request.output, *numbers)
        while not work.done():
            if goal.is_cancel_requested or self._job.stopping.is_set():
                self._process.restart()
                return None
            self._pass_on(goal)
            self._job.stopping.wait(0.2)
        return work.result()

    def _pass_on(self, goal: Any) -> None:
        """What the worker says, as feedback; who leads, as a diagnosis without verdict."""
        leaders: tuple[tuple[str, float], ...] = ()
        for doing, share, leading in self._process.said():
            leaders = leading
            goal.publish_feedback(DiagnoseGap.Feedback(stage=doing, progress=share))
        if leaders and leaders != self._leaders:
            self._leaders = leaders
            self._publisher.publish(leaders_message(leaders))

    def diagnose(self) -> Mapping[str, Health]:
        """What was found last."""
        age = time.monotonic() - self._map_age if math.isfinite(self._map_age) else 0.0
        text = "diagnosing" if self._job.busy else (self._last or "waiting for strikes")
        values: dict[str, float | int | str] = {
            "strikes": len(self._signals.collector.strikes),
            "dropped": self._signals.dropped,
        }
        return {"gap": Health(HealthLevel.OK, text, age, values)}

    def shut_down(self) -> None:
        """End the worker."""
        self._job.close(2.0)
        self._process.end()
        for server in self._servers:
            server.destroy()
        self._investigating.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(GapDiagnoser, arguments, low_priority=True)


if __name__ == "__main__":
    sys.exit(main())
