"""Options and arguments that several commands have, and the progress bar of the long ones."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["Bag", "Controls", "Host", "Json", "Output", "progress_bar"]

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
    Path | None, typer.Option("--output", "-o", help="Folder for pictures and result.json.")
]


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
