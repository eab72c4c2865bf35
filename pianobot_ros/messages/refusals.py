"""Commands that a cell refused, and whether both cells did.

A node that refuses a command says so on ``/real/refusals`` or ``/sim/refusals``: a DiagnosticArray
whose one status names node and command, says why, and repeats the command's stamp. What one cell
refused and the other obeyed makes the two incomparable for a while.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pianobot_ros.messages.stamps import seconds

__all__ = ["COMMAND_KEY", "LASTING", "Refusal", "one_sided", "refusals"]

COMMAND_KEY = "command_stamp_ns"
LASTING = 1.5
"""s for which a refused command still shows: the conductor repeats the vacuum once a second, and a
wrist that was left behind catches up."""


@dataclass(frozen=True)
class Refusal:
    """``time`` s since the epoch at which a command with the stamp ``command`` (ns; 0: none) on the
    topic ``topic`` was refused, and why.
    """

    time: float
    topic: str
    command: int
    reason: str


def refusals(message: Any) -> list[Refusal]:
    """What a message on ``…/refusals`` says. A status that is not of the form above is left out."""
    found = []
    time = seconds(message.header.stamp)
    for status in message.status:
        _, _, topic = str(status.name).partition(": ")
        stamps = [str(pair.value) for pair in status.values if pair.key == COMMAND_KEY]
        if topic and len(stamps) == 1 and len(stamps[0]) < 20 and stamps[0].isdecimal():
            found.append(Refusal(time, topic, int(stamps[0]), str(status.message)))
    return found


def one_sided(
    real: Iterable[Refusal], sim: Iterable[Refusal], start: float, end: float
) -> tuple[str, Refusal] | None:
    """Which cell alone (``real`` or ``sim``) refused a command that shows between ``start`` and
    ``end`` (s since the epoch), with the last such refusal; None if none did.

    Commands are told apart by topic and stamp, those without a stamp by their number.
    """
    seen = {
        cell: [r for r in given if start - LASTING <= r.time <= end]
        for cell, given in (("real", real), ("sim", sim))
    }
    for cell, other in (("real", "sim"), ("sim", "real")):
        stamped = {(r.topic, r.command) for r in seen[other] if r.command}
        alone = [r for r in seen[cell] if r.command and (r.topic, r.command) not in stamped]
        if alone:
            return cell, alone[-1]
        plain, others = ([r for r in seen[c] if not r.command] for c in (cell, other))
        if len(plain) > len(others):
            return cell, plain[-1]
    return None
