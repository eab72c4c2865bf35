"""`pianobot axis …`: logs of the joints of any robot, to a verdict."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cli.new_paths import new_report
from pianobot_ros.cli.shared_options import Json, Seed, number, several

if TYPE_CHECKING:
    from pianobot_ros.axis.log import Log
    from pianobot_ros.axis.reading import Request
    from pianobot_ros.gap import Options

__all__ = ["app"]

app = typer.Typer(
    help="Logs of the joints of any robot: what is missing in their twin.", no_args_is_help=True
)

MANY = ("--columns", "--units", "--nominal", "--joint", "--reference")
"""Options that take several values, after one another or each behind its own flag."""


class ManyValues(TyperCommand):
    """A command whose options of `MANY` may be followed by several values."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Write `--columns a=b c=d` as `--columns a=b --columns c=d`."""
        return super().parse_args(ctx, spread(args))


def spread(args: Sequence[str]) -> list[str]:
    """Repeat an option of `MANY` before each of its values.

    What names a file is a log again, unless it follows `--reference` after the logs were given.
    """
    out: list[str] = []
    option, logs, value = "", False, False
    for arg in args:
        if arg.startswith("-") and len(arg) > 1 and not value:
            option = arg if arg in MANY else ""
            value = arg in MANY
            out.append(arg)
        elif option and not value and (logs if option == "--reference" else not Path(arg).exists()):
            out += [option, arg]
        else:
            logs = logs or not (value or (out and out[-1].startswith("--")))
            option, value = (option if value else ""), False
            out.append(arg)
    return out


def pairs(items: Sequence[str], what: str) -> dict[str, str]:
    """NAME=VALUE items as a dictionary; raises PianobotError where a name has two values."""
    out: dict[str, str] = {}
    for item in items:
        name, equals, value = item.partition("=")
        if not equals:
            raise PianobotError(f"{what} wants NAME=VALUE, got {item!r}")
        if out.setdefault(name.strip(), value.strip()) != value.strip():
            raise PianobotError(f"{what} says both {name}={out[name.strip()]} and {item}")
    return out


def lists(items: Sequence[str], what: str) -> dict[str, tuple[str, ...]]:
    """NAME=VALUE items as a dictionary of all values of a name."""
    out: dict[str, tuple[str, ...]] = {}
    for item in items:
        ((name, value),) = pairs([item], what).items()
        out[name] = (*out.get(name, ()), value)
    return out


def asked(columns: Sequence[str] | None, units: Sequence[str] | None, rate: float) -> Request:
    """What the options say of the logs."""
    from pianobot_ros.axis.reading import Request

    return Request(lists(columns or [], "--columns"), pairs(units or [], "--units"), rate)


def numbers(items: Sequence[str], what: str) -> dict[str, float]:
    """NAME=NUMBER items as a dictionary."""
    out = {}
    for name, value in pairs(items, what).items():
        try:
            out[name] = float(value)
        except ValueError:
            out[name] = math.nan
        if not math.isfinite(out[name]):
            raise PianobotError(f"{what} {name} wants a finite number, got {value!r}")
    return out


Logs = Annotated[list[Path], typer.Argument(help="Files, folders or bags.")]
Columns = Annotated[
    list[str] | None,
    typer.Option(
        help="ROLE=HEADER: time, command, position, motor, velocity, effort, error; lists (1,2) and"
        " ranges (1-6) of headers or numbers; - for none."
    ),
]
Units = Annotated[
    list[str] | None, typer.Option(help="ROLE=UNIT, e.g. position=deg time=ms, or JOINT:ROLE=UNIT.")
]

Rate = Annotated[float, number("Hz, where the log has no time stamps.", 0.0)]
Joints = Annotated[list[str] | None, typer.Option(help="Joints by name; all if not given.")]
Model = Annotated[
    Path | None,
    typer.Option(help="URDF or MJCF: gravity and inertia that change with the other joints."),
]


@app.command("columns", cls=ManyValues)
def columns_command(
    logs: Logs,
    columns: Columns = None,
    units: Units = None,
    rate: Rate = 0.0,
    as_json: Json = False,
) -> None:
    """What would be read as what, with units and rates; nothing is computed."""
    from pianobot_ros.axis.reading import listing, read_recordings

    request = asked(columns, units, rate)
    recordings = read_recordings(logs, request)
    if as_json:
        listings = [listing.listing(r) for r in recordings]
        typer.echo(json.dumps({"recordings": listings}, indent=1))
        return
    for recording in recordings:
        for line in listing.text(recording):
            typer.echo(line)


@app.command("diagnose", cls=ManyValues)
def diagnose_command(
    logs: Annotated[list[Path], several("Files, folders or bags of one robot.")],
    columns: Columns = None,
    units: Units = None,
    rate: Rate = 0.0,
    joint: Joints = None,
    nominal: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE: what the twin believes.")
    ] = None,
    reference: Annotated[
        list[Path] | None, typer.Option(help="Logs of the same joint as it was before.")
    ] = None,
    model: Model = None,
    report: Annotated[
        Path | None,
        typer.Option(
            help="Self-contained HTML file; a folder for many joints.", callback=new_report
        ),
    ] = None,
    seed: Seed = 0,
    budget: Annotated[int, typer.Option(min=100, help="Blocks simulated for a joint.")] = 40_000,
    jobs: Annotated[
        int, typer.Option(min=1, help="Processes: joints at a time, or simulations of one.")
    ] = 1,
    as_json: Json = False,
) -> None:
    """Which effect the twin of each joint lacks."""
    believed = numbers(nominal or [], "--nominal") or None
    from pianobot_ros.axis.diagnosis.lines import report_lines
    from pianobot_ros.axis.diagnosis.robot import diagnose_robot, logs_by_joint
    from pianobot_ros.axis.reading import read_recordings

    request = asked(columns, units, rate)
    before = read_recordings(reference, request) if reference else []
    by_joint = modelled(logs_by_joint(read_recordings(logs, request), joint or ()), model)
    found = diagnose_robot(
        by_joint,
        reference=modelled(logs_by_joint(before), model) if before else None,
        nominal=believed,
        seed=seed,
        budget=budget,
        jobs=jobs,
        tell=lambda text: typer.echo(text, err=True),
        options=settings(),
    )
    lines = [json.dumps(found.to_json(), indent=1)] if as_json else report_lines(found)
    for line in lines:
        typer.echo(line)
    if report:
        from pianobot_ros.axis.diagnosis.pages import write_page

        write_page(found, report)


def settings() -> Options:
    """The settings of the axis, as sure as its calibration says where there is one."""
    from pianobot_ros.axis.diagnosis.joint import OPTIONS
    from pianobot_ros.cell.numbers.learned import SERVO_AXIS, load_learned

    return OPTIONS.taught(load_learned(SERVO_AXIS))


def modelled(logs: dict[str, list[Log]], model: Path | None) -> dict[str, list[Log]]:
    """The logs with what a model's file says of each joint, if one is given."""
    if model is None:
        return logs
    from pianobot_ros.axis.diagnosis.robot import with_model
    from pianobot_ros.axis.diagnosis.robot_model import RobotModel

    return with_model(logs, RobotModel(model))


@app.command("predict", cls=ManyValues)
def predict_command(
    logs: Annotated[list[Path], several("Logs that the twin was not fitted to.")],
    fitted: Annotated[Path, typer.Option(help="What `diagnose --json` wrote.")],
    columns: Columns = None,
    units: Units = None,
    rate: Rate = 0.0,
    joint: Joints = None,
    model: Model = None,
    as_json: Json = False,
) -> None:
    """Apply a fitted twin to other logs: the errors of position and effort that it leaves."""
    from pianobot_ros.axis.diagnosis.lines import predicted
    from pianobot_ros.axis.diagnosis.robot import logs_by_joint
    from pianobot_ros.axis.reading import read_recordings
    from pianobot_ros.axis.twin.fitted import models, predict_all

    known = models(fitted)
    request = asked(columns, units, rate)
    by_joint = modelled(logs_by_joint(read_recordings(logs, request), joint or ()), model)
    if len(known) == 1 and len(by_joint) == 1:
        known = dict.fromkeys(by_joint, next(iter(known.values())))
    if not set(known) & set(by_joint):
        raise PianobotError(
            f"{fitted} is of {', '.join(known) or 'no joint'}, the logs of {', '.join(by_joint)}"
        )
    made, problems = predict_all(known, by_joint)
    if as_json:
        typer.echo(json.dumps({"predictions": [p.to_json() for p in made]}, indent=1))
        return
    for line in (*predicted(made), *(f"left out: {p}" for p in problems)):
        typer.echo(line)
