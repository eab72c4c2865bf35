"""What became of the strikes of recorded phrases: ``python benchmarks/live_strikes.py BAG…
[--json]``.

Prints for each bag of a live cell: strikes announced, strikes that the live comparison called
silent on the real or the simulated cell, and how many of these calls were false, since the bag
holds the note, by its stamp, in the strike's window; and setpoints late by more than a cycle, sent
(against their own time) and obeyed (by the setpoint that the arm says it follows).
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from tables import table_head, table_row

from pianobot_ros.bags.message_types import typestore
from pianobot_ros.bags.raw_messages import read_raw
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.messages.events import note_event
from pianobot_ros.cell.messages.stamps import seconds

CYCLE = 0.008  # s between two setpoints
SAME = 0.02  # s between a strike's end as announced and as its comparison says it
EARLY = 0.05  # s by which a note may come before its window
MOVING = 0.03  # m/s of vertical speed from which a delay can be told
TOPICS = ("/command/strike", "/command/wrist", "/real/midi", "/sim/midi", "/gap/live")


COLUMNS = {
    "announced": "strikes",
    "compared": "compared",
    "silent": "called silent",
    "falsely_silent": "falsely",
    "setpoints": "setpoints",
    "late_sent": "sent late",
    "moving": "states moving",
    "late_obeyed": "obeyed late",
}
"""What is counted in a bag, and the table's column for it: setpoints ``late_sent`` of
``setpoints``, ``late_obeyed`` of ``moving`` states of the real arm.
"""
Counts = dict[str, int]


def read(bag: Path) -> dict[str, list[tuple[float, Any]]]:
    """Time of sending (s) and message, by topic."""
    found: dict[str, list[tuple[float, Any]]] = defaultdict(list)
    for raw in read_raw(bag):
        if raw.topic in TOPICS or raw.topic == "/real/wrist/state":
            message = typestore().deserialize_cdr(raw.data, raw.type)
            found[raw.topic].append((raw.sent * 1e-9, message))
    return found


def strikes_of(bag: Path) -> Counts:
    """Look through one bag. Raises :class:`PianobotError` if it is none."""
    data = read(bag)
    marks = [m for _, m in data["/command/strike"]]
    found = dict.fromkeys(COLUMNS, 0) | {"announced": len(marks)}
    onsets = {
        cell: [
            event
            for _, m in data[f"/{cell}/midi"]
            if (event := note_event(m, seconds(m.header.stamp))) is not None and event.on
        ]
        for cell in ("real", "sim")
    }
    for report in (m for _, m in data["/gap/live"]):
        found["compared"] += 1
        end = seconds(report.header.stamp) - report.latency
        for gap in report.keystrokes:
            for cell, missing in (("real", gap.real_missing), ("sim", gap.sim_missing)):
                found["silent"] += missing
                found["falsely_silent"] += missing and any(
                    seconds(m.header.stamp) - EARLY <= e.time <= seconds(m.end)
                    for m in marks
                    if m.note == gap.note and abs(seconds(m.end) - end) < SAME
                    for e in onsets[cell]
                    if e.note == gap.note
                )
    late_setpoints(data, found)
    return found


def late_setpoints(data: dict[str, list[tuple[float, Any]]], found: Counts) -> None:
    """Count setpoints that were sent, and states whose setpoint was obeyed, too late."""
    commands = data["/command/wrist"]
    due = np.array([seconds(m.header.stamp) for _, m in commands])
    sent = np.array([t for t, _ in commands])
    found["setpoints"] = len(commands)
    found["late_sent"] = int(np.sum(sent > due + CYCLE))
    states = [m for _, m in data["/real/wrist/state"]]
    if len(commands) < 2 or not states:
        return
    height = np.array([m.pose.position.z for _, m in commands])
    time = np.array([seconds(m.header.stamp) for m in states])
    target = np.array([m.target_pose.position.z for m in states])
    # Only between setpoints of one stream is there a path to be behind of.
    place = np.clip(np.searchsorted(due, time), 1, len(due) - 1)
    inside = (due[place] - due[place - 1] < 2 * CYCLE) & (time >= due[0]) & (time <= due[-1])
    speed = (height[place] - height[place - 1]) / np.maximum(due[place] - due[place - 1], 1e-6)
    moving = inside & (np.abs(speed) > MOVING)
    behind = (np.interp(time, due, height)[moving] - target[moving]) / speed[moving]
    found["moving"] = int(moving.sum())
    if found["moving"]:
        found["late_obeyed"] = int(np.sum(behind - np.median(behind) > CYCLE))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bags", nargs="+", type=Path, help="bags, or run directories with one")
    parser.add_argument("--json", action="store_true", help="machine-readable output")
    options = parser.parse_args()
    found = {}
    for path in options.bags:
        try:
            found[str(path)] = strikes_of(path / "bag" if (path / "bag").is_dir() else path)
        except PianobotError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
    if options.json:
        print(json.dumps(found))
        return 0
    lines = table_head(["bag", *COLUMNS.values()])
    lines += [table_row((name, *counts.values())) for name, counts in found.items()]
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
