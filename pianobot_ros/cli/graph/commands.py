"""The commands that run a graph or record one: ``up``, ``record``."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import NoReturn

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.piano.view.address import warn_if_open

__all__ = ["read_parameters", "record", "up"]


def read_parameters(path: Path | None) -> dict[str, dict[str, object]]:
    """Node parameters from a YAML file: node names, below them parameters (``ros__parameters`` may
    stand between).
    """
    if path is None:
        return {}
    from pianobot_ros.cell.numbers.config import load_yaml
    from pianobot_ros.nodes.graph import NODES

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


def up(
    emulated: bool,
    config: Path | None,
    screen: bool,
    jobs: bool,
    domain: int | None,
    run: Path | None,
    page: dict[str, object] | None = None,
) -> None:
    """Run the cell until Ctrl-C. ``page`` has the parameters of the page in the browser; None: no
    page.
    """
    from pianobot_ros.cli.graph.running_cell import Stopped, isolated_emulation, running_cell

    parameters = read_parameters(config)
    if page is not None:
        warn_if_open(str(page["host"]))
        parameters["viewer"] = {**page, **parameters.get("viewer", {})}
    try:
        with running_cell(
            emulated=isolated_emulation() if emulated else None,
            parameters=parameters,
            jobs=jobs,
            screen=screen,
            run=run,
            domain=domain,
            view=page is not None,
        ) as cell:
            cell.tell("ready; Ctrl-C stops everything")
            cell.note = "Ctrl-C stops everything"
            while True:
                cell.turn()
    except Stopped:
        print("stopped", file=sys.stderr)


def record(output: Path | None) -> NoReturn:
    """Record the running graph until Ctrl-C. This process becomes the recorder, so that every
    signal reaches it.
    """
    from pianobot_ros.nodes.graph import ros_arguments

    values = {"output": str(output.absolute())} if output else {}
    node = ["-m", "pianobot_ros.nodes.watching.recorder", *ros_arguments(values)]
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, *node])
