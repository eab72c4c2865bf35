"""A node that is interrupted while it loads ends silently."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Collection
from pathlib import Path

__all__ = ["end_silently_while_loading"]


def end_silently_while_loading(nodes: Collection[str]) -> None:
    """Take SIGINT until ``running.run`` has handlers of its own, if this process is one of
    ``nodes``.

    A node loads for seconds, and Python would end with a traceback and as if it had been killed.
    """
    if _is_program(nodes) and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda *_: os._exit(0))


def _is_program(nodes: Collection[str]) -> bool:
    """Whether this process is a node that is being loaded, as a module or by its executable."""
    name = sys.argv[0] if sys.argv else ""
    return name == "-m" or Path(name).name in nodes
