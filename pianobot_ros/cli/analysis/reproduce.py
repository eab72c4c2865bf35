"""`pianobot reproduce`: every result of both papers beside the paper's, in one command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pianobot_ros.cli.new_paths import writable_folder
from pianobot_ros.cli.shared_options import seed as seed_option

__all__ = ["reproduce"]


def reproduce(
    output: Annotated[
        Path,
        typer.Option(help="Directory for plots, tables and figures.", callback=writable_folder),
    ] = Path("docs/results/physics"),
    seed: Annotated[int, seed_option("Seed of the simulated rig's noise.")] = 0,
) -> None:
    """Reproduce the experiments of both papers: plots and tables `ours | paper`."""
    from rich.console import Console

    from pianobot_ros.piano.action.results.write import write_results as write_action
    from pianobot_ros.piano.twin.experiments.comparison import write_results as write_hand

    console = Console()
    command = f"pianobot reproduce --seed {seed}"
    with console.status("the piano action: rig, transfer functions, hybrid model …"):
        action = write_action(output, seed, command=command)
    with console.status("the soft hand: single note, glissando, two-note stretch …"):
        write_hand(output, seed, command=command)
    for page in (action, output / "hand.md"):
        typer.echo(page.read_text(encoding="utf-8"))
    console.print(f"written: {action} and {output / 'hand.md'}")
