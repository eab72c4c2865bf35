"""The one list of the nodes of a cell: who they are, in which order they start, and what happens
when one dies.

``pianobot up`` and ``launch/cell.launch.py`` both start what :func:`cell_graph` says.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from pianobot_ros.cell.errors import ConfigError, unknown_name

__all__ = ["MODULES", "NODES", "NodeSpec", "cell_graph", "ros_arguments"]


@dataclass(frozen=True)
class NodeSpec:
    """One node.

    ``name`` is its executable too, and its file's, in ``folder`` of ``nodes/``; ``device`` the
    device of the emulated cell that it talks to; ``hardware`` nodes are lifecycle nodes that
    configure and activate themselves; ``moves`` True if the arm must stop when the node dies;
    ``job`` True if it waits for long jobs; ``restarts`` how often it is started again before the
    cell is brought to a safe stop; an ``optional`` node is then given up, and the cell goes on
    without it.
    """

    name: str
    folder: str
    device: str = ""
    hardware: bool = False
    moves: bool = False
    job: bool = False
    restarts: int = 3
    optional: bool = False
    parameters: Mapping[str, Any] = field(default_factory=dict)

    @property
    def module(self) -> str:
        """Python module with its main function."""
        return f"pianobot_ros.nodes.{self.folder}.{self.name}"


NODES: tuple[NodeSpec, ...] = (
    NodeSpec("recorder", "watching"),
    NodeSpec("gap_monitor", "watching"),
    NodeSpec("sim_twin", "twin"),
    NodeSpec("vacuum_regulator", "devices", device="vacuum", hardware=True),
    NodeSpec("fsr_reader", "devices", device="fsr", hardware=True),
    NodeSpec("midi_bridge", "devices", device="midi", hardware=True),
    NodeSpec("ur5_wrist", "devices", device="wrist", hardware=True, moves=True),
    NodeSpec("conductor", "playing", moves=True),
    NodeSpec("gap_diagnoser", "analysis", job=True),
    NodeSpec("optimizer", "analysis", job=True),
    NodeSpec("viewer", "watching", optional=True),
)
"""In the order of starting: those that listen first, so that nothing is missed; stopped in the
reverse order.
"""

MODULES: dict[str, str] = {spec.name: spec.module for spec in NODES}
"""The Python module of each node, by its name."""


def cell_graph(
    addresses: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    parameters: Mapping[str, Mapping[str, Any]] | None = None,
    without: Sequence[str] = (),
    jobs: bool = True,
) -> tuple[NodeSpec, ...]:
    """The nodes to start.

    ``addresses`` are those that the emulated cell prints, by device; without them the nodes take
    theirs from ``config/``. ``parameters`` by node; ``without`` names of nodes to leave out;
    ``jobs`` False leaves out those that wait for long jobs. Raises :class:`ConfigError` for a name
    that is no node.
    """
    names = [spec.name for spec in NODES]
    for name in (*without, *(parameters or {})):
        if name not in names:
            raise ConfigError(unknown_name("node", name, names))
    chosen = []
    for spec in NODES:
        if spec.name in without or (spec.job and not jobs):
            continue
        found = dict(spec.parameters)
        if addresses is not None and spec.device in addresses:
            found |= {_ADDRESS[k]: v for k, v in addresses[spec.device].items() if k in _ADDRESS}
        chosen.append(replace(spec, parameters={**found, **(parameters or {}).get(spec.name, {})}))
    return tuple(chosen)


# From what a device calls its address to what the node calls it; the instrument's own name is the
# port that the bridge seeks.
_ADDRESS = {
    "host": "host",
    "port": "port",
    "name": "port",
    "socket": "socket",
    "transport": "transport",
}


def ros_arguments(parameters: Mapping[str, Any]) -> list[str]:
    """Command line words that set the parameters of a node."""
    if not parameters:
        return []
    words = ["--ros-args"]
    for name, value in parameters.items():
        words += ["-p", f"{name}:={_yaml(value)}"]
    return words


def _yaml(value: Any) -> str:
    # JSON is YAML; a string is quoted, so that an address stays one.
    return json.dumps(value)
