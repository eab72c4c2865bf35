"""Where the page is served, and who can reach it there."""

from __future__ import annotations

import socket
import sys

from pianobot_ros.cell.errors import PianobotError

__all__ = ["DEFAULT_HOST", "DEFAULT_PORT", "check_address", "is_loopback", "warn_if_open"]

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8130


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    return host in ("localhost", "::1") or host.startswith("127.")


def warn_if_open(host: str) -> None:
    """Say so on stderr where others than this machine reach the page."""
    if not is_loopback(host):
        print(
            f"warning: the page at {host} has no password: everybody who reaches this address sees"
            " it, and uses its controls if it has any",
            file=sys.stderr,
        )


def check_address(host: str, port: int) -> None:
    """Raise PianobotError unless this machine can serve at an address and a port exists."""
    if not 0 <= port <= 65535:
        raise PianobotError(f"port {port} does not exist: give 1 to 65535, or 0 for any free one")
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.bind(address)
    except OSError as error:
        raise PianobotError(
            f"cannot serve the page at '{host}': {error.strerror or error}; give an address of"
            " this machine"
        ) from error
