"""The command ``pianobot``. Bad input gives one line on stderr and exit code 2."""

from __future__ import annotations

import errno
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.claims import LARGEST_DOMAIN
from pianobot_ros.cli.new_paths import new_file, writable_folder
from pianobot_ros.cli.shared_options import Bag, Controls, Host, Json, Timeout, number
from pianobot_ros.cli.shared_options import seed as seed_option
from pianobot_ros.piano.view.address import DEFAULT_HOST

__all__ = ["app", "main"]

app = typer.Typer(
    help="A robot-piano cell, its simulated twin, and the gap between the two.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)
bag_app = typer.Typer(help="Look into bags and repair them.", no_args_is_help=True)
app.add_typer(bag_app, name="bag")

Screen = Annotated[bool, typer.Option("--tui/--no-tui", help="Live table in the terminal.")]
View = Annotated[bool, typer.Option(help="Show the cell in the browser too.")]
Domain = Annotated[
    int | None, typer.Option(min=0, max=LARGEST_DOMAIN, help="ROS_DOMAIN_ID of the graph.")
]
Run = Annotated[
    Path | None,
    typer.Option(
        "--run",
        help="Directory for logs and bag.",
        show_default="runs/<date and time>",
        callback=writable_folder,
    ),
]


@app.callback()
def common(
    key_preset: Annotated[
        str,
        typer.Option(
            help="Keys of twin and plant alike: paper, digital or acoustic (keyboard.yaml)."
        ),
    ] = "",
) -> None:
    """A robot-piano cell, its simulated twin, and the gap between the two."""
    if key_preset:
        from pianobot_ros.cell.motion.geometry import use_key_preset

        use_key_preset(key_preset)


@app.command()
def demo(
    seed: Annotated[int | None, seed_option("Draws the hidden effect.", "at random")] = None,
    screen: Screen = True,
    diagnosis: Annotated[bool, typer.Option(help="Hide an effect and diagnose the bag.")] = True,
    run: Run = None,
    domain: Domain = None,
    picture: Annotated[
        Path | None, typer.Option(help="SVG file for the live table.", callback=new_file)
    ] = None,
    view: View = True,
    as_json: Json = False,
) -> None:
    """The whole story on an emulated cell.

    It hides an effect and plays beside its twin, compared live; then the recorded bag is diagnosed,
    the twin adopts the verdict, and a phrase that was not used is played before and after.
    """
    from pianobot_ros.cli.demo.demonstration import run_demo

    code = run_demo(
        seed=seed,
        screen=screen,
        diagnosis=diagnosis,
        run=run,
        domain=domain,
        as_json=as_json,
        picture=picture,
        view=view,
    )
    if code:
        raise typer.Exit(code)


@app.command()
def up(
    emulated: Annotated[
        bool, typer.Option("--emulated", help="Start the emulated cell and use its devices.")
    ] = False,
    config: Annotated[Path | None, typer.Option(help="YAML file with parameters by node.")] = None,
    screen: Screen = True,
    jobs: Annotated[bool, typer.Option(help="Start the nodes for long jobs too.")] = True,
    view: View = True,
    host: Host = DEFAULT_HOST,
    controls: Controls = False,
    domain: Domain = None,
    run: Run = None,
) -> None:
    """Start the whole graph, watch it, and stop it in order on Ctrl-C."""
    from pianobot_ros.cell.host.claims import current_domain, refuse_second

    refuse_second("graph", current_domain() if domain is None else domain)
    from pianobot_ros.cli.graph import commands

    commands.up(
        emulated,
        config,
        screen,
        jobs,
        domain,
        run,
        page={"host": host, "controls": controls} if view else None,
    )


@app.command()
def play(
    score: Annotated[
        str,
        typer.Argument(
            help="Phrase (YAML), standard MIDI file, or name of a phrase in config/phrases."
        ),
    ],
    transpose: Annotated[int, typer.Option(help="Semitones.")] = 0,
    tempo: Annotated[float, number("Factor on the tempo.")] = 1.0,
    repeats: Annotated[int, typer.Option(min=1, help="How often.")] = 1,
    timeout: Timeout = 10.0,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would be played.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Play a score on the running cell, real and simulated."""
    from pianobot_ros.cli.graph.playing import check_score, play_score

    if dry_run:
        plan = check_score(score, transpose, tempo, repeats)
        notes = [s.note for s in plan.strikes]
        done = {
            "strikes": len(notes),
            "notes": notes,
            "duration": plan.duration,
            "unreachable": list(plan.unreachable),
        }
        text = f"{plan.name}: {len(notes)} strikes, {plan.duration:.1f} s"
    else:
        done = play_score(score, transpose, tempo, repeats, timeout)
        text = str(done["message"])
    if as_json:
        typer.echo(json.dumps(done))
        return
    typer.echo(text)
    for line in done["unreachable"]:
        typer.echo(f"left out or lost: {line}")


@app.command()
def record(
    output: Annotated[
        Path | None,
        typer.Argument(help="Directory of the bag.", show_default="recordings/<date and time>"),
    ] = None,
) -> None:
    """Record a running graph until Ctrl-C."""
    from pianobot_ros.cli.graph import commands

    commands.record(output)


@bag_app.command("info")
def bag_info_command(path: Bag, as_json: Json = False) -> None:
    """Topics, types, counts, rates and gaps."""
    from pianobot_ros.bags.info import bag_info

    info = bag_info(path)
    if as_json:
        typer.echo(json.dumps(info.as_dict()))
        return
    state = "" if info.whole else "; needs repair: pianobot bag repair"
    state = "; still being recorded" if info.recording else state
    typer.echo(
        f"{info.path}: {info.messages} messages in {info.duration:.1f} s, {info.size / 1e6:.1f}"
        f" MB{state}"
    )
    for line in info.damage:
        typer.echo(f"  damaged: {line}")
    if info.others:
        typer.echo(f"  note: {info.others}")
    for t in info.topics:
        gaps = f"{len(t.gaps)} gaps, longest {max(g for _, g in t.gaps):.2f} s" if t.gaps else ""
        typer.echo(f"  {t.name:<24} {t.type:<36} {t.count:>8} {t.rate:>8.1f} Hz  {gaps}")


@bag_app.command("repair")
def bag_repair_command(path: Bag, as_json: Json = False) -> None:
    """Make the bag of a killed recorder readable; the original is kept."""
    from pianobot_ros.bags.raw_messages import other_bags
    from pianobot_ros.bags.repair import repair_bag

    others = other_bags(path)
    done = repair_bag(path)
    if others:
        typer.echo(f"note: {others}", err=True)
    if as_json:
        typer.echo(json.dumps(done.as_dict()))
    elif done.original is None:
        typer.echo(f"{done.path} is whole: {done.messages} messages; nothing was changed")
    else:
        typer.echo(
            f"{done.path}: {done.messages} messages in {done.duration:.1f} s; the original is"
            f" {done.original}"
        )


@app.command("export-model")
def export_model(
    file: Annotated[Path, typer.Argument(help="MJCF file to write (.xml).", callback=new_file)],
    diagnosis: Annotated[
        Path | None,
        typer.Option(help="Diagnosis or overlay whose corrections go into the model."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write the twin as MJCF that stock MuJoCo loads."""
    from pianobot_ros.piano.gap.adoption.export_corrected import export_corrected

    if file.suffix != ".xml":
        raise PianobotError(f"{file} must end in .xml")
    left = export_corrected(file, diagnosis)
    if as_json:
        typer.echo(json.dumps({"file": str(file), "left_out": left}))
        return
    typer.echo(f"wrote {file}")
    for line in left:
        typer.echo(f"not in the model: {line}")


@app.command()
def doctor(as_json: Json = False) -> None:
    """What is missing on this machine, and how to get it."""
    from pianobot_ros.cli.graph.doctor import examine

    findings = examine()
    if as_json:
        typer.echo(json.dumps([f.as_dict() for f in findings]))
    else:
        for f in findings:
            typer.echo(
                f"{f.state:<8} {f.name}: {f.detail}" + (f"  -> {f.remedy}" if f.remedy else "")
            )
    if any(f.state == "missing" for f in findings):
        raise typer.Exit(1)


@app.command("compile")
def compile_() -> None:
    """Compile what the nodes compute with, so that no phrase waits for it (once a machine)."""
    from pianobot_ros.cli.graph.compiling import compile_kernels

    typer.echo("compiling what the nodes compute with (a minute or two, once a machine) …")
    for name, seconds in compile_kernels():
        typer.echo(f"compiled: {name} ({seconds:.0f} s)")


def _register_others() -> None:
    """Commands that live in files of their own; those files import what they need only when
    called.
    """
    from pianobot_ros.cli.analysis import adopt, axis, diagnosis, identify, investigate, optimize
    from pianobot_ros.cli.analysis.reproduce import reproduce
    from pianobot_ros.cli.graph import view

    diagnosis.register(app)
    adopt.register(app)
    investigate.register(app)
    view.register(app)
    app.add_typer(axis.app, name="axis")
    app.add_typer(identify.app, name="identify")
    app.add_typer(optimize.app, name="optimize")
    app.command()(reproduce)


_register_others()


def _told() -> tuple[type[Exception], ...]:
    """The errors whose message is for the user; the engine's own only where it was loaded."""
    engine = sys.modules.get("pianobot_ros.gap.problem.errors")
    return (PianobotError,) if engine is None else (PianobotError, engine.GapError)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    code = 1
    try:
        code = _run(arguments)
    finally:
        watching = sys.modules.get("pianobot_ros.nodes.watching.observer")
        if watching is not None:
            watching.leave(code)
    return code


def _refuse_empty(words: Sequence[str]) -> None:
    """An empty word is a variable that was not set; as a path it would be the folder one is in."""
    for before, word in zip(("pianobot", *words), words, strict=False):
        if re.fullmatch(r"(--[^=]+=)?", word):
            where = word or f"what follows {before}"
            raise PianobotError(f"{where} is empty: write a value, or leave it out")


def _run(arguments: Sequence[str] | None) -> int:
    """The command, and one line for what went wrong."""
    from typer.exceptions import TyperException

    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        _refuse_empty(words)
        result = app(
            words,
            prog_name="pianobot",
            standalone_mode=False,
        )
    except _told() as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except TyperException as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        print(
            message if type(error).__name__ == "NoArgsIsHelpError" else f"error: {message}",
            file=sys.stderr,
        )
        return 2
    except (typer.Abort, KeyboardInterrupt):
        print("interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 1
    except OSError as error:  # of a file or folder that the user named, or of a disk
        if not error.filename and error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise  # with its traceback
        where = f"{error.filename}: " if error.filename else ""
        print(f"error: {where}{error.strerror}", file=sys.stderr)
        return 2
    return result if isinstance(result, int) else 0


if __name__ == "__main__":
    sys.exit(main())
