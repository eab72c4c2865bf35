"""`pianobot investigate`: a client of the action ``/investigate`` of a running graph."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.numbers.default_budgets import (
    INVESTIGATION_GOAL,
    INVESTIGATION_GOALS,
    INVESTIGATION_STRIKES,
)
from pianobot_ros.cli.new_paths import new_diagnosis
from pianobot_ros.cli.shared_options import Json, Seed, Timeout, number

__all__ = ["investigate_command", "register"]


def register(app: typer.Typer) -> None:
    """Add the command to ``app``."""
    app.command("investigate")(investigate_command)


def investigate_command(
    score: Annotated[
        str,
        typer.Option(help="Phrase of the first set, as for `pianobot play`.", show_default="demo"),
    ] = "",
    budget_strikes: Annotated[
        int, typer.Option(min=8, help="Most strikes in all, at least those of the first set.")
    ] = INVESTIGATION_STRIKES,
    goal: Annotated[
        float, number("Probability at which it is enough.", *INVESTIGATION_GOALS)
    ] = INVESTIGATION_GOAL,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Folder for report and diagnosis.json.",
            callback=new_diagnosis,
        ),
    ] = None,
    adopt: Annotated[
        bool, typer.Option(help="Let the twin adopt the verdict, and forget it if it does harm.")
    ] = False,
    seed: Seed = 0,
    timeout: Timeout = 10.0,
    as_json: Json = False,
) -> None:
    """Find the cause of the gap by playing on the running cell."""
    result = _call(
        {
            "score": score,
            "budget_strikes": budget_strikes,
            "goal": goal,
            "output": str(output.absolute()) if output else "",
            "adopt": adopt,
            "seed": seed,
        },
        timeout,
        quiet=as_json,
    )
    if not result.success and result.ended != "cancelled":
        raise PianobotError(result.message)
    if as_json:
        document = json.loads(result.diagnosis.json) if result.diagnosis.json else None
        answer = {"ended": result.ended, "strikes": result.strikes, "diagnosis": document}
        typer.echo(json.dumps(answer | {"message": result.message, "report": result.report}))
        return
    typer.echo(f"{result.message} [{result.ended}, {result.strikes} strikes]")
    if result.report:
        typer.echo(f"Report: {result.report}")
    if result.ended == "cancelled":
        raise typer.Exit(130)


def _call(request: dict[str, Any], timeout: float, *, quiet: bool) -> Any:
    """Send the goal and wait for its result; Ctrl-C cancels it."""
    from pianobot_msgs.action import Investigate
    from rclpy.action import ActionClient

    from pianobot_ros.nodes.watching.observer import Observer

    observer = Observer()
    client = ActionClient(observer.node, Investigate, "/investigate")
    stopping: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: stopping.append(number))

    def turn_until(done: Any, limit: float, what: str) -> None:
        end = time.monotonic() + limit
        while not done():
            if time.monotonic() > end:
                raise PianobotError(what)
            observer.spin(0.1)

    def show(message: Any) -> None:
        f = message.feedback
        likely = ", ".join(f"{c.name} {100 * c.probability:.0f} %" for c in f.leading)
        line = f"{f.strikes} of {f.budget} strikes; {f.doing}: {f.purpose}"
        if not quiet:
            typer.echo(line + (f" ({likely})" if likely else ""), err=True)

    try:
        silent = "no graph answers: start it with `pianobot up`"
        turn_until(client.server_is_ready, timeout, silent)
        sent = client.send_goal_async(Investigate.Goal(**request), show)
        turn_until(sent.done, timeout, silent)
        if not sent.result().accepted:
            raise PianobotError("a diagnosis or an investigation is running: cancel it first")
        result = sent.result().get_result_async()
        while not result.done():
            observer.spin(0.1)
            if stopping:
                stopping.clear()
                sent.result().cancel_goal_async()
        return result.result().result
    finally:
        signal.signal(signal.SIGINT, before)
        client.destroy()
        observer.close()
