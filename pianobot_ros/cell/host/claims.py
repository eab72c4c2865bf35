"""Names of which a ROS domain has one on this machine.

ROS lets two nodes have one name. Both answer the same calls and send to the same topics, and two
conductors would both command the arm. The kernel gives a name to one process only and takes it back
however that process ends, so a node that was killed can be started anew at once, which the
middleware, which believes in the dead for a while, would not allow.
"""

from __future__ import annotations

import os
import socket
import sys
from pathlib import Path

from pianobot_ros.cell.errors import PianobotError

__all__ = ["LARGEST_DOMAIN", "claim_name", "current_domain", "refuse_second"]

LARGEST_DOMAIN = 232
"""Domain whose ports all fit below 65536 (DDSI-RTPS 2.5, 9.6.1)."""
_LIST = Path("/proc/net/unix")
"""What the kernel knows of names, one a line, at its end; a zero byte at the front is an @."""


def current_domain() -> int:
    """The domain of this process's environment. Raises :class:`PianobotError` for what is none."""
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not text.isdecimal() or int(text) > LARGEST_DOMAIN:
        raise PianobotError(
            f"ROS_DOMAIN_ID is '{text[:40]}': give a number from 0 to {LARGEST_DOMAIN}"
        )
    return int(text)


def claim_name(name: str, domain: int) -> socket.socket:
    """Make this process the only ``name`` of a domain on this machine, until the socket is closed
    or the process ends, however it ends. Other systems than Linux have no such sockets: there
    every claim succeeds.

    Raises:
        PianobotError: another process has the name.
    """
    claim = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    if sys.platform == "linux":
        try:
            claim.bind(f"\0{_path(name, domain)}")  # of the network, not of the disk
        except OSError as error:
            claim.close()
            raise _taken(name, domain) from error
    return claim


def refuse_second(name: str, domain: int) -> None:
    """Look, without taking it, whether another process has the name: for programs that load for
    seconds before they claim it, and would only then be refused.

    Raises:
        PianobotError: another process has the name.
    """
    try:
        known = _LIST.read_text(encoding="utf-8", errors="replace")
    except OSError:  # another system: the claim itself decides
        return
    if f" @{_path(name, domain)}\n" in known:
        raise _taken(name, domain)


def _path(name: str, domain: int) -> str:
    return f"pianobot/{domain}/{name.strip('/')}"


def _taken(name: str, domain: int) -> PianobotError:
    return PianobotError(
        f"another {name.strip('/')} runs in ROS domain {domain} on this machine: end it, or"
        " choose another ROS_DOMAIN_ID"
    )
