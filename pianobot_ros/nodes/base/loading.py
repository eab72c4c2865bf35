"""What a node does before it loads, which takes seconds beside a graph that runs."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.claims import current_domain, refuse_second

__all__ = ["begin_loading"]

_NAMES = ("__node:=", "__name:=", "__ns:=")


def begin_loading(nodes: Mapping[str, str]) -> None:
    """If this process is one of ``nodes`` (module by name): end at once, as bad input, where
    another has its name; and end silently on SIGINT, until ``running.run`` has handlers of its own
    (Python would end with a traceback and as if it had been killed).
    """
    if not (name := _program(nodes)):
        return
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, lambda *_: os._exit(0))
    if any(word in text for text in sys.argv[1:] for word in _NAMES):
        return  # it goes by another name, which it claims once it is made
    try:
        refuse_second(name, current_domain())
    except PianobotError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        os._exit(2)


def _program(nodes: Mapping[str, str]) -> str:
    """The node that this process is, as a module or by its executable; "" if it is none."""
    name = Path(sys.argv[0]).name if sys.argv else ""
    if name == "-m":  # Python looks for the module, through its packages
        return next((name for name, module in nodes.items() if module in sys.orig_argv), "")
    return name if name in nodes else ""
