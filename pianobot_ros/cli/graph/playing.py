"""``pianobot play``: a client of the conductor of a running graph."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from pianobot_ros.cell.errors import PianobotError, ScoreError
from pianobot_ros.cell.score import load_score

__all__ = ["check_score", "play_score"]

SILENT = "the conductor does not answer"


def check_score(score: str, transpose: int, tempo: float, repeats: int) -> Any:
    """The plan of a score, before anything is started. Raises :class:`ScoreError`."""
    from pianobot_ros.cell.score import plan_score

    return plan_score(load_score(score, transpose=transpose, tempo=tempo).repeated(repeats))


class _Client:
    def __init__(self, timeout: float) -> None:
        from pianobot_ros.nodes.watching.observer import Observer

        self.observer, self._timeout = Observer(), timeout
        self.stopping = False

    def wait(self, done: Callable[[], Any], what: str, limit: float | None = None) -> None:
        """Spin until ``done()``; raises :class:`PianobotError` with ``what`` when it takes too
        long.
        """
        end = time.monotonic() + (self._timeout if limit is None else limit)
        while not done():
            if time.monotonic() > end or self.stopping:
                raise PianobotError("interrupted" if self.stopping else what)
            self.observer.spin(0.05)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Answer of a service of the conductor."""
        client = self.observer.node.create_client(kind, f"/conductor/{name}")
        self.wait(client.service_is_ready, SILENT)
        answer = client.call_async(request)
        self.wait(answer.done, SILENT)
        return answer.result()

    @contextlib.contextmanager
    def transposed(self, semitones: int) -> Iterator[None]:
        """The conductor's parameter for the time of one phrase; 0 leaves it as it is."""
        from rcl_interfaces.srv import GetParameters, SetParameters
        from rclpy.parameter import Parameter

        if not semitones:
            yield
            return

        def put(value: int) -> None:
            parameter = Parameter("transpose", value=value).to_parameter_msg()
            self.call(
                SetParameters, "set_parameters", SetParameters.Request(parameters=[parameter])
            )

        answer = self.call(
            GetParameters, "get_parameters", GetParameters.Request(names=["transpose"])
        )
        put(semitones)
        try:
            yield
        finally:
            self.stopping = False  # Ctrl-C ended the phrase; the parameter is put back all the same
            put(int(answer.values[0].integer_value))

    def play(self, goal: Any, limit: float) -> Any:
        """Result of the action; cancels it when interrupted or late."""
        accepted = self.observer.send(goal)
        self.wait(accepted.done, SILENT)
        handle = accepted.result()
        if not handle.accepted:
            raise PianobotError("the conductor is playing already: wait, or cancel that phrase")
        result = handle.get_result_async()
        try:
            self.wait(result.done, "the phrase did not end in time", limit)
        except PianobotError:
            handle.cancel_goal_async()
            end = time.monotonic() + 3.0
            while not result.done() and time.monotonic() < end:
                self.observer.spin(0.05)
            raise
        return result.result().result


def play_score(
    score: str, transpose: int, tempo: float, repeats: int, timeout: float
) -> dict[str, Any]:
    """Play on the running graph; returns what happened."""
    plan = check_score(score, transpose, tempo, repeats)
    from pianobot_msgs.action import PlayPhrase

    client = _Client(timeout)
    path = Path(score)

    def stop(*_: object) -> None:
        client.stopping = True

    before = signal.signal(signal.SIGINT, stop)
    try:
        client.wait(
            client.observer.conductor_ready,
            "no conductor is running: start the cell with `pianobot up`",
        )
        goal = PlayPhrase.Goal(
            score=str(path.absolute()) if path.exists() else score, tempo=tempo, repeats=repeats
        )
        with client.transposed(transpose):
            played = client.play(goal, plan.duration + 60.0)
    finally:
        client.observer.close()
        signal.signal(signal.SIGINT, before)
    if not played.success:
        raise ScoreError(played.message)
    return {
        "message": played.message,
        "strikes": played.strikes,
        "unreachable": list(played.unreachable),
    }
