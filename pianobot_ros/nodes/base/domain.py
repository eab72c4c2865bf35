"""A ROS domain that nobody else on this machine uses: for tests, demonstrations and benchmarks.

A domain is claimed by listening on a TCP port that belongs to it, which the middleware itself does
not use. The kernel gives the port to one process only and takes it back however that process ends:
so claims are safe between parallel test runs, checkouts, users and containers that share the
network, and none is ever left behind.
"""

from __future__ import annotations

import random
import socket

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.host.closing import Closing

__all__ = ["Domain", "claim_domain"]

DOMAINS = range(1, 101)
"""Those whose ports lie below the range that Linux gives to anybody (32768 and up)."""

# ports of a domain, by the RTPS standard: multicast at first, then two of each participant
_BASE, _STEP, _FIRST, _EACH = 7400, 250, 10, 2
_PARTICIPANTS = 32  # of a domain on this machine that find each other (config/dds-localhost.xml)


class Domain(Closing):
    """A claimed domain; a context manager that gives it back.

    Attributes:
        number: for ``ROS_DOMAIN_ID``.
    """

    def __init__(self, number: int, claim: socket.socket) -> None:
        self.number = number
        self._claim = claim

    def close(self) -> None:
        """Give the domain back. Safe to call twice."""
        self._claim.close()


def claim_domain() -> Domain:
    """A domain in which no graph lives and which no other caller holds.

    Raises:
        PianobotError: all hundred are taken.
    """
    for number in random.SystemRandom().sample(DOMAINS, len(DOMAINS)):
        if (claim := _claim(number)) is not None:
            return Domain(number, claim)
    raise PianobotError(
        f"all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are in use: end some graphs or tests"
    )


def _claim(number: int) -> socket.socket | None:
    port = _BASE + _STEP * number
    claim = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        claim.bind(("127.0.0.1", port))
        claim.listen(1)  # from here on another socket cannot bind it, whatever its options
        # A graph that was started without a claim holds the port of the domain's multicast, or,
        # where it stays on this machine, those of its participants alone.
        own = [port + _FIRST + _EACH * k for k in range(_PARTICIPANTS)]
        for held in (port, *own):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind(("", held))
    except OSError:
        claim.close()
        return None
    return claim
