"""``optimizer``: identifies the twin's parameters on the running graph.

Actions ``/optimize_stiffness`` (OptimizeStiffness) and ``/identify_keystroke`` (IdentifyKeystroke),
both with feedback and cancel. The work is done in a thread of low priority, one job at a time. A
search writes its state after every iteration, so that ``resume`` goes on with it after a cancel or
a crash.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pianobot_msgs.action import IdentifyKeystroke, OptimizeStiffness

from pianobot_ros.cell.errors import (
    CancelledError,
    ConfigError,
    PianobotError,
    RecordingError,
    unknown_name,
)
from pianobot_ros.nodes.analysis.live_recording import LiveRecording
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health, HealthLevel
from pianobot_ros.nodes.base.jobs import OneJob
from pianobot_ros.piano.identify.cell.answer import CellAnswer, identify_cell
from pianobot_ros.piano.identify.key.key_estimate import identify_keystroke
from pianobot_ros.piano.identify.key.load_test import read_load_test
from pianobot_ros.piano.identify.state import load_state, plain, save_state
from pianobot_ros.piano.identify.stiffness import StiffnessFit, optimize_stiffness
from pianobot_ros.piano.identify.takes.objective import Objective
from pianobot_ros.piano.identify.takes.references import is_midi, takes_from_reference
from pianobot_ros.piano.identify.takes.take import Take, takes_from_recording

__all__ = ["OptimizerNode", "main"]

LIVE = "live"
ITERATIONS = 30  # "Data-driven Simulation Framework", V-B
FORMS = {"": "paper", "paper": "paper", "hold_once": "hold_once"}
PAPER_WEIGHTS = (0.8, 0.2)

T = TypeVar("T", OptimizeStiffness.Result, IdentifyKeystroke.Result)


class OptimizerNode(common.PianoNode):
    """The node."""

    def __init__(self, **options: Any) -> None:
        super().__init__("optimizer", **options)
        self.declare(
            "live_strikes", 4, "strikes of the running cell to wait for", 1, 200, changes="any"
        )
        self.declare(
            "live_timeout",
            120.0,
            "s to wait for strikes of the running cell",
            1.0,
            3600.0,
            changes="any",
        )
        folder = self.declare(
            "state_directory", "", "folder for the state files of searches; empty: ~/.ros/pianobot"
        )
        self._folder = Path(folder).expanduser() if folder else Path.home() / ".ros" / "pianobot"
        self._job, self._doing = OneJob(self, "the optimizer is busy; cancel its job first"), "idle"
        identify = self._job.executes(
            lambda goal: self._carry_out(goal, IdentifyKeystroke.Result(), self._identify)
        )
        self._servers = [
            self._job.serve(kind, name, execute)
            for kind, name, execute in (
                (OptimizeStiffness, "/optimize_stiffness", self._execute_optimize),
                (IdentifyKeystroke, "/identify_keystroke", identify),
            )
        ]

    def diagnose(self) -> Mapping[str, Health]:
        """What is being worked on."""
        return {"optimizer": Health(HealthLevel.OK, self._doing, age_s=0.0)}

    def shut_down(self) -> None:
        """End the job, if there is one; its state file stays."""
        self._job.close(4.0)
        for server in self._servers:
            server.destroy()

    # Goals.

    async def _execute_optimize(self, goal: Any) -> OptimizeStiffness.Result:
        # Listening begins and ends on the executor's thread, which is the one that looks at the
        # subscriptions.
        live = LiveRecording(self) if goal.request.reference == LIVE else None

        def work(goal: Any) -> tuple[str, OptimizeStiffness.Result]:
            return self._carry_out(
                goal, OptimizeStiffness.Result(), lambda g, r: self._optimize(g, r, live)
            )

        try:
            return await self._job.executes(work)(goal)
        finally:
            if live is not None:
                live.close()

    def _carry_out(self, goal: Any, result: T, work: Callable[[Any, T], None]) -> tuple[str, T]:
        """How the goal ended, and the result, whose message says what went wrong if anything
        did.
        """
        failed = True
        try:
            work(goal, result)
            failed = False
        except PianobotError as error:
            result.message = str(error)
        except Exception as error:
            result.message = f"internal error: {type(error).__name__}: {error}"
        finally:
            self._doing = "idle"
        cancelled = bool(goal.is_cancel_requested)
        result.success = not (failed or cancelled or self._job.stopping.is_set())
        # Two call sites: rclpy allows a logger call only one severity.
        if result.success or cancelled:
            self.get_logger().info(result.message)
        else:
            self.get_logger().error(result.message)
        return ("canceled" if cancelled else "succeeded" if result.success else "aborted"), result

    def _ended(self, goal: Any) -> bool:
        return bool(goal.is_cancel_requested) or self._job.stopping.is_set()

    # Stiffness.

    def _optimize(
        self, goal: Any, result: OptimizeStiffness.Result, live: LiveRecording | None
    ) -> None:
        request = goal.request
        objective = _objective(request)
        about = {
            "reference": request.reference,
            "weights": list(objective.weights),
            "objective": objective.form,
        }
        resume = load_state(request.resume, about) if request.resume else None
        if live is not None:
            takes = self._live_takes(goal, live)
        else:
            takes = _takes(request.reference, lambda: self._ended(goal))
        self._doing = f"optimising stiffness against {request.reference}"
        path = Path(request.resume) if request.resume else self._folder / _file_name(request)

        def progress(search: Mapping[str, Any], feedback: Sequence[float]) -> None:
            save_state(path, search, about)
            iteration, total, *numbers = feedback
            names = ("stiffness", "objective_value", "best_stiffness", "best_objective_value")
            goal.publish_feedback(
                OptimizeStiffness.Feedback(
                    iteration=int(iteration),
                    total=int(total),
                    **dict(zip(names, map(float, numbers), strict=True)),
                )
            )

        fit = optimize_stiffness(
            takes,
            objective,
            iterations=int(request.iterations) or ITERATIONS,
            seed=int(request.seed),
            resume=resume,
            progress=progress,
            cancelled=lambda: self._ended(goal),
        )
        _fill(result, fit, path)
        if not fit.cancelled and not is_midi(request.reference):
            _fill_joint(result, identify_cell(takes))

    def _live_takes(self, goal: Any, live: LiveRecording) -> list[Take]:
        """Takes of the next strikes. Raises :class:`PianobotError` if none come, and
        :class:`CancelledError`.
        """
        wanted = int(self.get_parameter("live_strikes").value)
        timeout = float(self.get_parameter("live_timeout").value)
        end = time.monotonic() + timeout
        while live.strikes < wanted:
            self._doing = f"waiting for strikes of the real cell: {live.strikes} of {wanted}"
            if self._ended(goal):
                raise CancelledError("cancelled while waiting for strikes")
            if time.monotonic() > end:
                raise RecordingError(
                    f"{live.strikes} of {wanted} strikes came within {timeout:g} s: play a phrase,"
                    " or lower live_strikes"
                )
            self._job.stopping.wait(0.05)
        return takes_from_recording(live.recording())

    # Keystroke.

    def _identify(self, goal: Any, result: IdentifyKeystroke.Result) -> None:
        request = goal.request
        if not request.recording:
            raise RecordingError(
                "there is no recording: give a bag directory, or a CSV with time, force and angle"
            )
        self._doing = f"identifying the keystroke from {request.recording}"

        def progress(stage: str, share: float) -> None:
            goal.publish_feedback(IdentifyKeystroke.Feedback(stage=stage, progress=float(share)))

        def cancelled() -> bool:
            return self._ended(goal)

        progress("reading", 0.0)
        test = read_load_test(request.recording, int(request.note) or None, cancelled)
        fit = identify_keystroke(
            test, seed=int(request.seed), progress=progress, cancelled=cancelled
        )
        result.names = [e.name for e in fit.estimates]
        result.units = [e.unit for e in fit.estimates]
        for field in ("value", "low", "high"):
            numbers = [float(getattr(e, field)) for e in fit.estimates]
            setattr(result, "values" if field == "value" else field, numbers)
        result.warnings = list(fit.warnings)
        result.json = json.dumps(plain(fit.as_dict()))
        ended = "cancelled; " if self._ended(goal) else ""
        result.message = (
            f"{ended}{len(fit.estimates)} parameters, error {1e3 * fit.rms:.2f} mrad on presses not"
            " fitted"
        )


def _objective(request: OptimizeStiffness.Goal) -> Objective:
    """Raises :class:`ConfigError` for weights or a form that make no sense."""
    if request.objective not in FORMS:
        raise ConfigError(unknown_name("objective", request.objective, [f for f in FORMS if f]))
    weights = (request.lambda1, request.lambda2)
    return Objective(PAPER_WEIGHTS if weights == (0.0, 0.0) else weights, FORMS[request.objective])  # type: ignore[arg-type]


def _takes(reference: str, cancelled: Callable[[], bool]) -> list[Take]:
    if not reference:
        raise RecordingError(
            "there is no reference: give a standard MIDI file, a bag directory or 'live'"
        )
    return takes_from_reference(reference, cancelled)


def _file_name(request: OptimizeStiffness.Goal) -> str:
    stamp = time.strftime("%Y%m%d-%H%M%S")
    return f"optimize-{Path(request.reference).stem}-{request.seed}-{stamp}.json"


def _fill(result: OptimizeStiffness.Result, fit: StiffnessFit, path: Path) -> None:
    result.stiffness, result.low, result.high = fit.stiffness, fit.profile.low, fit.profile.high
    result.identifiable, result.err = fit.profile.identifiable, fit.err
    result.objective_value = fit.objective
    result.json = json.dumps({**plain(fit.as_dict()), "state_file": str(path)})
    err = f"{100 * fit.err:.2f} %" if math.isfinite(fit.err) else "unknown"
    known = "" if fit.profile.identifiable else ", not identifiable"
    done = (
        f"cancelled after {len(fit.history)} iterations, state in {path}; " if fit.cancelled else ""
    )
    result.message = (
        f"{done}k = {fit.stiffness:.3g} N*m/rad ({fit.profile.low:.3g} to"
        f" {fit.profile.high:.3g}{known}), Err {err}"
    )


def _fill_joint(result: OptimizeStiffness.Result, answer: CellAnswer) -> None:
    """What is known once everything else is estimated too: the level with most strikes, if there
    are several.
    """
    levels = answer.problem.levels
    most = max(range(len(answer.levels)), key=lambda i: len(levels.members(i)))
    known = answer.levels[most]
    result.stiffness, result.low, result.high = known.value, known.low, known.high
    result.identifiable = known.identifiable
    result.json = json.dumps({**json.loads(result.json), "joint": plain(answer.as_dict())})
    open_ = "" if known.identifiable else f", open; what would decide it: {answer.decides}"
    result.message = (
        f"k = {known.value:.3g} N*m/rad ({known.low:.3g} to {known.high:.3g}{open_}) with"
        f" everything estimated, Err {100 * answer.err_after:.2f} %; the paper's procedure, only k"
        f" free: {result.message}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    return common.run(OptimizerNode, arguments, low_priority=True)


if __name__ == "__main__":
    sys.exit(main())
