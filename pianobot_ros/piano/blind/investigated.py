"""Blind cases that are investigated: a hidden cell plays what the investigation asks for, and the
investigation sees nothing of it but recordings.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.cell.score import parse_phrase, plan_score
from pianobot_ros.emulator.plant.offline import simulate_commands
from pianobot_ros.gap import GapError
from pianobot_ros.piano.blind.folder import RESULTS
from pianobot_ros.piano.gap.diagnosis.investigate import Goal, investigate

if TYPE_CHECKING:
    from pianobot_ros.emulator.plant.cases.case import Case

__all__ = ["investigate_case"]


def investigate_case(bag: Path, case: Case, goal: Goal, rig: bool) -> dict[str, Any]:
    """Investigate the cell of the ``bag``, which goes on playing; every further round becomes a bag
    ``<bag>+1``, ``<bag>+2`` …, the last diagnosis the case's result. Returns the result's content.
    """
    rounds = 0

    def play(phrase: dict[str, Any]) -> Recording:
        nonlocal rounds
        rounds += 1
        plan = plan_score(parse_phrase(yaml_text(phrase)))
        path = bag.with_name(f"{bag.name}+{rounds}")
        write_bag(simulate_commands(plan, case.in_session(rounds), encoder=rig), path)
        return read_bag(path)

    results = bag.parent / RESULTS
    results.mkdir(exist_ok=True)
    try:
        done = investigate(read_bag(bag), play, goal)
        document = done.diagnosis.to_json() | {"investigation": done.to_json()}
    except (PianobotError, GapError) as error:
        document = {"verdict": "error", "sentence": str(error)}
    text = json.dumps(document, indent=1) + "\n"
    (results / f"{bag.name}.json").write_text(text, encoding="utf-8")
    return document
