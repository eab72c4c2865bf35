"""`experiment next`: the strikes that best tell the leading hypotheses apart."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.bags.reading.read import read_bag
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET
from pianobot_ros.gap import diagnose
from pianobot_ros.gap.explain.experiment import propose_experiment
from pianobot_ros.piano.gap.diagnosis.proposals import candidate_strikes
from pianobot_ros.piano.gap.diagnosis.settings import options
from pianobot_ros.piano.gap.evidence.blocks import DRIVEN
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

__all__ = ["proposals_from"]


def proposals_from(
    sources: Sequence[Path],
    *,
    count: int = 3,
    seed: int = 0,
    budget: int = DIAGNOSIS_BUDGET,
    progress: Callable[[str, float], None] | None = None,
) -> list[dict[str, Any]]:
    """The best ``count`` proposals, as in diagnosis.json's ``next_experiment``; empty if one
    explanation is left.

    ``sources``: bags, which are diagnosed first, or one diagnosis.json (or its folder), which holds
    one proposal. Raises :class:`RecordingError` for a diagnosis of another robot.
    """
    tell = progress or (lambda *_: None)
    document = _document(sources[0])
    if document is not None:
        if len(sources) > 1:
            raise RecordingError(f"{sources[0]} is a diagnosis: give it alone, or bags")
        return _proposed(document, sources[0])
    tell("reading", 0.05)
    twin = PianoTwin([read_bag(p) for p in sources])
    tell(f"diagnosing {len(twin.blocks)} strikes", 0.1)
    found = diagnose(twin, twin.blocks, seed=seed, budget=budget, options=options())
    tell("comparing experiments", 0.85)
    proposals = propose_experiment(twin, found, candidate_strikes(twin, seed))
    if not proposals:
        return []
    typical = float(np.median([p.gain for p in proposals]))
    return [p.to_json(typical) for p in proposals[:count]]


def _proposed(document: dict[str, Any], where: Path) -> list[dict[str, Any]]:
    """What a diagnosis proposes."""
    proposal = document.get("next_experiment")
    if not proposal:
        return []
    if not set(DRIVEN) <= set(proposal.get("attributes", ())):
        raise RecordingError(f"what {where} proposes is no strike: it is not of a piano cell")
    return [proposal]


def _document(path: Path) -> dict[str, Any] | None:
    """The diagnosis behind a path, None if it is a bag."""
    file = path / "diagnosis.json" if path.is_dir() else path
    if file.suffix != ".json" or not file.is_file():
        return None
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError) as error:
        raise RecordingError(f"{file} is not a diagnosis: {error}") from error
    if not isinstance(document, dict) or "verdict" not in document:
        raise RecordingError(f"{file} is not a diagnosis: it has no verdict")
    return document
