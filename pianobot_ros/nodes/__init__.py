"""ROS 2 nodes: thin shells around the rooms that know no ROS."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from pianobot_ros.graph import NODES


def _is_program() -> bool:
    """Whether this process is a node that is being loaded, as a module or by its executable."""
    name = sys.argv[0] if sys.argv else ""
    return name == "-m" or Path(name).name in {spec.name for spec in NODES}


# A node loads for seconds, and Python would end with a traceback and as if it had been killed.
# From ``running.run`` on the node has handlers of its own.
if _is_program() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, lambda *_: os._exit(0))
