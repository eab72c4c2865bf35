"""Commands that a cell did not obey as given, and whether both cells did not.

A node that refuses a command, or obeys it late, says so on ``/real/refusals`` or
``/sim/refusals``: a DiagnosticArray whose one status names node and command, says why, and repeats
the command's stamp; where it is known, also for how long it shows. What one cell did not obey and
the other did makes the two incomparable for a while.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pianobot_ros.cell.messages.stamps import seconds

__all__ = ["COMMAND_KEY", "LASTING", "LASTING_KEY", "Refusal", "one_sided", "refusals"]

COMMAND_KEY = "command_stamp_ns"
LASTING_KEY = "lasting_s"
LASTING = 1.5
"""s for which a refused command still shows: the conductor repeats the vacuum once a second, and a
wrist that was left behind catches up."""
LONGEST = 60.0
"""s beyond which nothing that was not obeyed is believed to show."""


@dataclass(frozen=True)
class Refusal:
    """``time`` s since the epoch at which a command with the stamp ``command`` (ns; 0: none) on the
    topic ``topic`` was refused, and why; it shows for ``lasting`` s from then on.
    """

    time: float
    topic: str
    command: int
    reason: str
    lasting: float = LASTING

    def shows(self, start: float, end: float) -> bool:
        """Whether it shows between ``start`` and ``end``, s since the epoch."""
        return self.time <= end and start <= self.time + self.lasting


def refusals(message: Any) -> list[Refusal]:
    """What a message on ``…/refusals`` says. A status that is not of the form above is left out.

    A refusal shows from when it was said; what says itself for how long, from the command's time.
    """
    found = []
    said = seconds(message.header.stamp)
    for status in message.status:
        _, _, topic = str(status.name).partition(": ")
        stamps = [str(pair.value) for pair in status.values if pair.key == COMMAND_KEY]
        if topic and len(stamps) == 1 and len(stamps[0]) < 20 and stamps[0].isdecimal():
            command, reason = int(stamps[0]), str(status.message)
            lasting = _lasting(str(pair.value) for pair in status.values if pair.key == LASTING_KEY)
            if lasting is None:
                found.append(Refusal(said, topic, command, reason))
            else:
                found.append(Refusal(1e-9 * command or said, topic, command, reason, lasting))
    return found


def _lasting(said: Iterable[str]) -> float | None:
    """The time that is said, s; None where none, or none that can be, is."""
    try:
        value = float(next(iter(said)))
    except (StopIteration, ValueError):
        return None
    return value if 0.0 <= value <= LONGEST else None


def one_sided(
    real: Iterable[Refusal], sim: Iterable[Refusal], start: float, end: float
) -> tuple[str, Refusal] | None:
    """Which cell alone (``real`` or ``sim``) refused a command that shows between ``start`` and
    ``end`` (s since the epoch), with the last such refusal; None if none did.

    Commands are told apart by topic and stamp, those without a stamp by their number.
    """
    seen = {
        cell: [r for r in given if r.shows(start, end)]
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
