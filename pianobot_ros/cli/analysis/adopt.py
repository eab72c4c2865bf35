"""`pianobot adopt`: what a diagnosis found becomes an overlay of the twin."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Annotated

import typer

from pianobot_ros.cli.new_paths import writable_folder

__all__ = ["adopt_command", "register"]


def register(app: typer.Typer) -> None:
    """Add the command to ``app``."""
    app.command("adopt")(adopt_command)


def adopt_command(
    diagnosis: Annotated[Path, typer.Argument(help="A diagnosis.json, its folder, or a run.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Folder for corrections.yaml.",
            show_default="the diagnosis' own",
            callback=writable_folder,
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable output.")] = False,
) -> None:
    """Write what a diagnosis found as corrections that the twin can adopt."""
    from pianobot_ros.piano.gap.adoption.adopt import adoption, diagnosis_file, read_diagnosis
    from pianobot_ros.piano.gap.simulation.corrections import write_corrections

    found = adoption(read_diagnosis(diagnosis))
    path = None
    if found.corrections:
        now = datetime.now(timezone.utc).isoformat(timespec="seconds")
        dated = replace(found.corrections, source={**found.corrections.source, "adopted": now})
        path = write_corrections(dated, output or diagnosis_file(diagnosis).parent)
    if as_json:
        document = {
            "corrections": str(path) if path else None,
            "adopted": found.corrections.names(),
            "identity": found.corrections.identity,
            "open": list(found.corrections.open),
            "message": found.sentence,
        }
        typer.echo(json.dumps(document))
        return
    typer.echo(found.sentence)
    for line in found.corrections.names():
        typer.echo(f"  {line}")
    if path:
        typer.echo(f"Corrections: {path} (sim_twin takes it as corrections:={path})")
