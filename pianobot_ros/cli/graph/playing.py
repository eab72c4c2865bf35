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
from pianobot_ros.cli.graph.phrase import played, silent

__all__ = ["check_score", "play_score"]


def check_score(score: str, transpose: int, tempo: float, repeats: int) -> Any:
    """The plan of a score, before anything is started. Raises :class:`ScoreError`."""
    from pianobot_ros.cell.score import plan_score

    return plan_score(load_score(score, transpose=transpose, tempo=tempo).repeated(repeats))


class _Client:
    def __init__(self, timeout: float) -> None:
        from pianobot_ros.nodes.watching.observer import Observer

        self.observer, self._timeout = Observer(), timeout
        self.stopping = False

    def wait(self, done: Callable[[], Any], limit: float, what: Callable[[], str]) -> None:
        """Spin until ``done()``; a :class:`PianobotError` with ``what()`` after ``limit`` s."""
        end = time.monotonic() + limit
        while not done():
            if time.monotonic() > end or self.stopping:
                raise PianobotError("interrupted" if self.stopping else what())
            self.observer.spin(0.05)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Answer of a service of the conductor."""
        client = self.observer.node.create_client(kind, f"/conductor/{name}")
        self.wait(client.service_is_ready, self._timeout, silent)
        answer = client.call_async(request)
        self.wait(answer.done, self._timeout, silent)
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
            timeout,
            lambda: "no conductor is running: start the cell with `pianobot up`",
        )
        goal = PlayPhrase.Goal(
            score=str(path.absolute()) if path.exists() else score, tempo=tempo, repeats=repeats
        )
        with client.transposed(transpose):
            end = played(client.observer, goal, client.wait, plan.duration + 60.0)
    finally:
        client.observer.close()
        signal.signal(signal.SIGINT, before)
    if not end.success:
        raise ScoreError(end.message)
    return {
        "message": end.message,
        "strikes": end.strikes,
        "unreachable": list(end.unreachable),
    }
