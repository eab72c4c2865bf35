"""The last part of the demo: the twin adopts the verdict, and a phrase that no strike so far was
like is played before and after. What makes it worse is forgotten.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

from pianobot_ros.cell.recordings.before_after import (
    LAST_REPORT,
    UNHEARD,
    heard,
    is_worse,
    share_closed,
)
from pianobot_ros.cli.demo.requests import adopt, forget

__all__ = ["adopted_lines", "close_the_loop", "play_and_compare"]

REJECTED = "rejected.yaml"
"""What an overlay is called that made the unheard phrase worse."""


def play_and_compare(cell: Any, score: str) -> tuple[Any, list[Any]]:
    """Play a phrase on both cells; the action's result and the comparisons of its strikes."""
    cell.observer.reports.clear()
    played = cell.play(score=score)
    end = time.monotonic() + LAST_REPORT
    while len(cell.observer.reports) < played.strikes and time.monotonic() < end:
        cell.turn()
    return played, list(cell.observer.reports)


def close_the_loop(cell: Any, folder: Path, phrase: str = UNHEARD) -> dict[str, Any]:
    """Play the unheard ``phrase`` on the running ``cell`` before and after its twin adopts the
    verdict in ``folder/diagnosis``; where that made it worse, forget it. Returns what it says.
    """
    from pianobot_ros.piano.gap.adoption.adopt import adoption, read_diagnosis
    from pianobot_ros.piano.gap.simulation.corrections import write_corrections

    cell.tell(f"playing '{phrase}', which no strike so far was like")
    _, before = play_and_compare(cell, phrase)
    verdict = adoption(read_diagnosis(folder / "diagnosis"))
    cell.tell(verdict.sentence)
    after, path = before, None
    if verdict.corrections:
        path = write_corrections(verdict.corrections, folder / "diagnosis")
        adopt(cell, str(path))
        cell.tell(f"playing '{phrase}' again, with the corrected twin")
        _, after = play_and_compare(cell, phrase)
    first, second = heard(before, after), heard(after, before)
    kept = str(path or "")
    if path and is_worse(first, second):
        forget(cell)
        kept = str(path.rename(path.with_name(REJECTED)))
    closed = share_closed(first, second)
    return {
        "message": verdict.sentence,
        "adopted": verdict.corrections.names(),
        "forgotten": kept.endswith(REJECTED),
        "corrections": kept,
        "before": first.to_json(),
        "after": second.to_json(),
        "closed": None if math.isnan(closed) else closed,
    }


def adopted_lines(loop: dict[str, Any]) -> list[str]:
    """The last lines of the demo."""

    def row(name: str, x: dict[str, Any]) -> str:
        err = "unknown" if x["err"] is None else _percent(x["err"], x["err_low"], x["err_high"])
        interval = f"{x['gap']:.2f} ({x['low']:.2f} to {x['high']:.2f})" if x["gap"] else ""
        gap = interval or "unknown"
        return f"| {name} | {err} | {gap} | {x['strikes']} |"

    lines = ["## A phrase that was not used", "", loop["message"], ""]
    lines += ["| twin | Err (95 %) | gap, × floor (95 %) | strikes |", "|---|---|---|---|"]
    lines.append(row("as it was", loop["before"]))
    if loop["adopted"]:
        lines.append(row("corrected", loop["after"]))
    if loop["closed"] is not None and loop["adopted"]:
        lines += ["", _closed_line(loop["closed"])]
    if loop.get("forgotten"):
        lines += ["", f"The twin has forgotten it again; {loop['corrections']} is what it was."]
    return lines


def _percent(value: float, low: float, high: float) -> str:
    return f"{100 * value:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def _closed_line(closed: float) -> str:
    if closed < 0:
        return f"The gap above the floor has grown by {-100 * closed:.0f} %: this did not help."
    if closed >= 1.0:
        return "All of the gap above the floor is gone."
    return f"Of the gap above the floor {100 * closed:.0f} % are gone."
