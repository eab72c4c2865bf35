"""The cell under ``ros2 launch``: the nodes of ``pianobot_ros/nodes/graph.py``, in its order, each
restarted as often as it says there.

ros2 launch pianobot_ros cell.launch.py [emulated:=true] [jobs:=false] [view:=false]
    [config:=parameters.yaml]

Ctrl-C ends every node in order of its own shutdown: the hardware is brought to rest and the bag is
closed. The lifecycle nodes configure and activate themselves; ``autostart: false`` in the
configuration leaves that to a lifecycle manager.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from launch.action import Action
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    ExecuteProcess,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
)
from launch.event_handlers import OnProcessExit, OnProcessIO
from launch.events import Shutdown
from launch.events.process import ProcessExited, ProcessIO
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node

from launch import LaunchContext, LaunchDescription
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cli.graph.commands import read_parameters
from pianobot_ros.cli.graph.running_cell import isolated_emulation
from pianobot_ros.nodes.graph import NodeSpec, cell_graph

RESTART_DELAY = 1.0  # s
STOP_TIMEOUT = "10"  # s; a node's own limit for its shutdown is 8
BAD_INPUT = 2  # exit code of a node that refuses its parameters: trying again does not help


def _flag(context: LaunchContext, name: str) -> bool:
    return bool(LaunchConfiguration(name).perform(context) == "true")


def _chosen(context: LaunchContext, addresses: dict[str, dict[str, object]] | None) -> list[Action]:
    """Actions that start and watch every node. Raises :class:`PianobotError` for a configuration
    that names no node.
    """
    path = LaunchConfiguration("config").perform(context)
    nodes = cell_graph(
        addresses,
        parameters=read_parameters(Path(path) if path else None),
        jobs=_flag(context, "jobs"),
        without=() if _flag(context, "view") else ("viewer",),
    )
    return [action for spec in nodes for action in _watched(spec)]


def _watched(spec: NodeSpec) -> list[Action]:
    kind = LifecycleNode if spec.hardware else Node
    node = kind(
        package="pianobot_ros",
        executable=spec.name,
        name=spec.name,
        namespace="",
        output="screen",
        parameters=[dict(spec.parameters)] if spec.parameters else None,
        respawn=spec.restarts > 0,
        respawn_delay=RESTART_DELAY,
        respawn_max_retries=spec.restarts,
        sigterm_timeout=STOP_TIMEOUT,
    )
    deaths = 0

    def on_exit(event: ProcessExited, context: LaunchContext) -> list[Action]:
        nonlocal deaths
        deaths += 1
        if event.returncode != BAD_INPUT and deaths <= spec.restarts:
            return []
        if spec.optional and event.returncode != BAD_INPUT:
            return []
        return _end(context, f"{spec.name} does not run (exit code {event.returncode})")

    return [node, RegisterEventHandler(OnProcessExit(target_action=node, on_exit=on_exit))]


def _end(context: LaunchContext, reason: str) -> list[Action]:
    # Once only: launch_ros does not bear a second shutdown.
    if context.is_shutdown or getattr(context.locals, "ending", False):
        return []
    context.extend_globals({"ending": True})
    return [EmitEvent(event=Shutdown(reason=reason))]


def _emulated(context: LaunchContext) -> list[Action]:
    """The emulated cell at addresses of its own; the nodes start once it has printed them."""
    # Links to pseudo-terminals and sockets, which not every file system has.
    folder = Path(tempfile.mkdtemp(prefix="pianobot-"))
    words = ["--name", folder.name.removeprefix("pianobot-"), "--directory", str(folder)]
    words += isolated_emulation().arguments
    cell = ExecuteProcess(
        cmd=[sys.executable, "-m", "pianobot_ros.emulator", *words],
        name="emulator",
        output="screen",
        sigterm_timeout=STOP_TIMEOUT,
    )
    printed, started = bytearray(), False

    def on_stdout(event: ProcessIO) -> list[Action]:
        nonlocal started
        printed.extend(event.text)
        line, end, _ = bytes(printed).partition(b"\n")
        if started or not end:
            return []
        started = True
        return _chosen(context, json.loads(line))

    def on_exit(event: ProcessExited, context: LaunchContext) -> list[Action]:
        return _end(context, f"the emulated cell ended (exit code {event.returncode})")

    return [
        RegisterEventHandler(OnProcessIO(target_action=cell, on_stdout=on_stdout)),
        RegisterEventHandler(OnProcessExit(target_action=cell, on_exit=on_exit)),
        cell,
    ]


def _start(context: LaunchContext) -> list[Action]:
    try:
        nodes = _chosen(context, None)  # also checks the configuration before anything is started
    except PianobotError as error:
        raise RuntimeError(" ".join(str(error).split())) from error
    return _emulated(context) if _flag(context, "emulated") else nodes


def generate_launch_description() -> LaunchDescription:
    reach = EnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", default_value="LOCALHOST")
    flags = ["true", "false"]
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "emulated",
                default_value="false",
                choices=flags,
                description=(
                    "Start the emulated cell too and use its devices, on this machine only."
                ),
            ),
            DeclareLaunchArgument(
                "config", default_value="", description="YAML file with parameters by node."
            ),
            DeclareLaunchArgument(
                "jobs",
                default_value="true",
                choices=flags,
                description="Also start the nodes for long jobs (diagnosis, optimisation).",
            ),
            DeclareLaunchArgument(
                "view",
                default_value="true",
                choices=flags,
                description="Also show the cell in the browser.",
            ),
            SetEnvironmentVariable("ROS_AUTOMATIC_DISCOVERY_RANGE", reach),
            OpaqueFunction(function=_start),
        ]
    )
