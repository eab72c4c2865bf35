"""A pytest plugin for nodes that work with the cell: the harness of pianobot's own tests.

pytest finds it by itself where pianobot is installed; ``pytest -p pianobot_ros.testing`` does where
it is not. Nothing is imported or changed until a test asks for a fixture:

``ros_domain``
    the number of a ROS domain that no other test, worker or checkout on this machine uses,
``ros``
    a :class:`Ros`: a context in that domain, nodes that are spun while the test waits, recorded
    messages, service calls,
``processes``
    a :class:`Processes`: starts nodes and other programs, and ends them with the test,
``emulated_device``
    starts single :class:`EmulatedDevice`: arm, regulator, force sensor or piano,
``running_cell``
    a :class:`RunningCell`: the whole graph on the emulated cell, shared by the tests of a module.

Everything waits by :func:`wait_for`: for a condition, never for a time.
``docs/tutorial-testing.md`` shows how a node of one's own is tested with it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from pianobot_ros.testing.plugin import (
    emulated_device,
    processes,
    pytest_runtest_makereport,
    ros,
    ros_domain,
    running_cell,
    running_cells,
)

if TYPE_CHECKING:
    from pianobot_ros.testing.running.emulated_device import (
        EmulatedDevice,
        free_port,
        loopback_host,
    )
    from pianobot_ros.testing.running.process import Process, Processes
    from pianobot_ros.testing.running.ros_context import Ros
    from pianobot_ros.testing.running.running_cell import RunningCell
    from pianobot_ros.testing.sharing import Shared
    from pianobot_ros.testing.waiting import TIMEOUT, NotInTime, wait_for

__all__ = [
    "TIMEOUT",
    "EmulatedDevice",
    "NotInTime",
    "Process",
    "Processes",
    "Ros",
    "RunningCell",
    "Shared",
    "emulated_device",
    "free_port",
    "loopback_host",
    "processes",
    "pytest_runtest_makereport",
    "ros",
    "ros_domain",
    "running_cell",
    "running_cells",
    "wait_for",
]

_HOMES = {
    "running.running_cell": ("RunningCell",),
    "running.emulated_device": ("EmulatedDevice", "free_port", "loopback_host"),
    "running.process": ("Process", "Processes"),
    "running.ros_context": ("Ros",),
    "sharing": ("Shared",),
    "waiting": ("TIMEOUT", "NotInTime", "wait_for"),
}


def __getattr__(name: str) -> Any:
    """Import the rest when it is asked for: pytest loads this module in every run of everybody."""
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{home}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
