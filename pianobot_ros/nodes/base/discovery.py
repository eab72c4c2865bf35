"""The middleware's settings with which the nodes find each other soon, also after one was
killed.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from pianobot_ros.cell.host.claims import current_domain
from pianobot_ros.cell.host.memory import writable
from pianobot_ros.cell.numbers.config import config_file

__all__ = ["discovery"]

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILES = (
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
)  # up to version 2, and since version 3


def discovery() -> dict[str, str]:
    """Environment for a process of the graph, to be set before its first context: its profile
    unless the user has chosen one, and where ROS logs to for a user without a home, or with one
    that he may not write to (in a container often / or a folder that is not there). Nodes find each
    other on this machine only, unless the variable ``ROS_AUTOMATIC_DISCOVERY_RANGE`` asks for more.
    Raises :class:`PianobotError` for a domain that is none.
    """
    current_domain()
    return _profile() | _logs()


def _logs() -> dict[str, str]:
    if any(os.environ.get(name) for name in ("ROS_HOME", "ROS_LOG_DIR")):
        return {}
    home = os.environ.get("HOME")
    if home and writable(Path(home) / ".ros" / "log"):
        return {}
    return {"ROS_LOG_DIR": str(Path(tempfile.gettempdir()) / f"ros_log_{os.getuid()}")}


def _profile() -> dict[str, str]:
    if any(name in os.environ for name in PROFILES):
        return {}
    if (os.environ.get(RANGE) or "LOCALHOST") == "LOCALHOST":
        # Under this name the middleware adds shared memory, whatever the profile says; so the
        # profile does the rest too.
        return {
            **dict.fromkeys(PROFILES, str(config_file("dds-localhost.xml"))),
            RANGE: "SYSTEM_DEFAULT",
        }
    return dict.fromkeys(PROFILES, str(config_file("dds.xml")))
