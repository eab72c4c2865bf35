"""Options and arguments that several commands have, and the progress bar of the long ones."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cli.new_paths import new_result

__all__ = [
    "Bag",
    "Controls",
    "Host",
    "Json",
    "Output",
    "Seed",
    "Timeout",
    "number",
    "progress_bar",
    "seed",
    "several",
]


def number(text: str, least: float | None = None, most: float | None = None) -> Any:
    """An option that takes a number. A range alone would let nan pass, which compares with
    nothing: a wait of nan s never ends.
    """
    return typer.Option(help=text, min=least, max=most, callback=_finite)


def _finite(value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number")
    return value


def seed(text: str = "Everything random derives from it.", default: str | bool = True) -> Any:
    """An option that takes a seed: what each generator of random numbers here takes. ``default``
    says in words which one it is if none is given.
    """
    return typer.Option(help=text, min=0, max=2**32 - 1, show_default=default)


def several(text: str) -> Any:
    """An argument that takes recordings, which are all to count."""
    return typer.Argument(help=text, callback=_different)


def _different(paths: list[Path]) -> list[Path]:
    """Strikes of a recording that is there twice would pass for repeats without any scatter."""
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise PianobotError(f"{path} is given twice: name each recording once")
        seen.add(path.resolve())
    return paths


Bag = Annotated[Path, typer.Argument(help="Bag directory or .mcap file.")]
Json = Annotated[bool, typer.Option("--json", help="Machine-readable output.")]
Host = Annotated[
    str,
    typer.Option(help="Address to serve at; another than loopback opens it to the network."),
]
Controls = Annotated[
    bool, typer.Option("--controls", help="Let browsers play, diagnose and adopt (graph only).")
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", help="Folder for pictures and result.json.", callback=new_result
    ),
]

Seed = Annotated[int, seed()]
Timeout = Annotated[float, number("s to wait for a running cell.", 0.0)]


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[[str, float], None]]:
    """A progress bar on stderr (text, share 0 to 1); nothing with ``quiet`` or where stderr is no
    terminal.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda *_: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=1.0)
        yield lambda text, share: progress.update(task, description=text, completed=share)
