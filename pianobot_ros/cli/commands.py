"""The commands that run a graph or play on one: ``up``, ``play``, ``record``."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from pianobot_ros.cell.errors import ConfigError, PianobotError, ScoreError, unknown_name
from pianobot_ros.cell.score import load_score

__all__ = ["check_score", "play_score", "read_parameters", "record", "up"]


def read_parameters(path: Path | None) -> dict[str, dict[str, object]]:
    """Node parameters from a YAML file: node names, below them parameters (``ros__parameters`` may stand between)."""
    if path is None:
        return {}
    from pianobot_ros.cell.config import load_yaml
    from pianobot_ros.graph import NODES

    names = [spec.name for spec in NODES]
    data = load_yaml(path)
    found: dict[str, dict[str, object]] = {}
    for node, values in data.items():
        inner = values.get("ros__parameters", values) if isinstance(values, dict) else None
        if not isinstance(inner, dict):
            raise ConfigError(f"{path}: below '{node}' there must be parameters")
        name = str(node).lstrip("/")
        if name not in names:
            raise ConfigError(f"{path}: {unknown_name('node', name, names)}")
        found[name] = inner
    return found


def up(emulated: bool, config: Path | None, screen: bool, jobs: bool, domain: int | None, run: Path | None) -> None:
    """Run the cell until Ctrl-C."""
    from pianobot_ros.cli.cell import Stopped, isolated_emulation, running_cell

    parameters = read_parameters(config)
    try:
        with running_cell(
            emulated=isolated_emulation() if emulated else None, parameters=parameters, jobs=jobs, screen=screen, run=run,
            domain=domain,
        ) as cell:  # fmt: skip
            cell.tell("ready; Ctrl-C stops everything")
            cell.note = "Ctrl-C stops everything"
            while True:
                cell.turn()
    except Stopped:
        print("stopped", file=sys.stderr)


def check_score(score: str, transpose: int, tempo: float) -> Any:
    """Read a score before anything is started. Raises :class:`ScoreError`."""
    from pianobot_ros.cell.plan import plan_score

    return plan_score(load_score(score, transpose=transpose, tempo=tempo))


def play_score(score: str, transpose: int, tempo: float, repeats: int, timeout: float) -> dict[str, Any]:
    """Play on the running graph; returns what happened."""
    import signal
    import time

    plan = check_score(score, transpose, tempo)
    from pianobot_msgs.action import PlayPhrase
    from rcl_interfaces.srv import SetParameters
    from rclpy.parameter import Parameter

    from pianobot_ros.nodes.observer import Observer

    path = Path(score)
    stopping: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: stopping.append(number))
    observer = Observer()

    def wait(done: Any, limit: float, what: str) -> None:
        end = time.monotonic() + limit
        while not done():
            if time.monotonic() > end or stopping:
                raise PianobotError("interrupted" if stopping else what)
            observer.spin(0.05)

    try:
        wait(observer.conductor_ready, timeout, "no conductor is running: start the cell with `pianobot up`")
        client = observer.node.create_client(SetParameters, "/conductor/set_parameters")
        wait(client.service_is_ready, timeout, "the conductor does not answer")
        request = SetParameters.Request(parameters=[Parameter("transpose", value=transpose).to_parameter_msg()])
        answer = client.call_async(request)
        wait(answer.done, timeout, "the conductor does not answer")
        goal = PlayPhrase.Goal(score=str(path.absolute()) if path.exists() else score, tempo=tempo, repeats=repeats)
        accepted = observer.send(goal)
        wait(accepted.done, timeout, "the conductor does not answer")
        handle = accepted.result()
        if not handle.accepted:
            raise PianobotError("the conductor is playing already: wait, or cancel that phrase")
        result = handle.get_result_async()
        try:
            wait(result.done, repeats * plan.duration + 60.0, "the phrase did not end in time")
        except PianobotError:
            handle.cancel_goal_async()
            end = time.monotonic() + 3.0
            while not result.done() and time.monotonic() < end:
                observer.spin(0.05)
            raise
        played = result.result().result
    finally:
        observer.close()
        signal.signal(signal.SIGINT, before)
    if not played.success:
        raise ScoreError(played.message)
    return {"message": played.message, "strikes": played.strikes, "unreachable": list(played.unreachable)}


def record(output: Path | None) -> int:
    """Record the running graph until Ctrl-C; the node's exit code."""
    from pianobot_ros.graph import ros_arguments

    values = {"output": str(output.absolute())} if output else {}
    process = subprocess.Popen(
        [sys.executable, "-m", "pianobot_ros.nodes.recorder", *ros_arguments(values)], env=os.environ
    )
    while True:
        try:
            return process.wait()
        except KeyboardInterrupt:  # the recorder got it too and closes the bag
            continue
