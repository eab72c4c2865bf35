"""Messages of ``/gap/diagnosis``: a diagnosis, a stage map, and who leads so far."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterable, Mapping
from typing import Any

from pianobot_msgs.msg import Candidate, Diagnosis, EffectParameter, StageGap

from pianobot_ros.nodes.base import common
from pianobot_ros.piano.gap.diagnosis.live import StageMap

__all__ = ["diagnosis_message", "leaders_message", "map_message"]


def diagnosis_message(document: Mapping[str, Any]) -> Diagnosis:
    """The message of a diagnosis.json."""
    gap = document["gap"]
    message = _stamped(
        Diagnosis(
            verdict=document["verdict"],
            sentence=document["sentence"],
            credible_set=list(document["credible_set"]),
            gap_floor=_number(gap["floor"]),
            gap_before=_number(gap["before"]),
            gap_refit=_number(gap["refit"]),
            gap_after=_number(gap["after"]),
            gap_closed=_number(gap["closed"]),
            gap_closed_low=_number(gap["closed_low"]),
            gap_closed_high=_number(gap["closed_high"]),
            strikes=int(document["provenance"].get("strikes", 0)),
            json=json.dumps(document),
        )
    )
    message.candidates = [
        Candidate(name=c["name"], stage=c["stage"], probability=_number(c["probability"]))
        for c in document["candidates"]
    ]
    message.parameters = [
        EffectParameter(
            effect=e["name"],
            name=n,
            value=_number(p["value"]),
            low=_number(p["low"]),
            high=_number(p["high"]),
            unit=p["unit"],
        )
        for e in document["effects"]
        for n, p in e["parameters"].items()
    ]
    message.stages = [
        StageGap(
            name=s["name"],
            gap=_number(s["gap"]),
            floor=_number(s["floor"]),
            share=_number(s["share"]),
        )
        for s in document["stages"]
    ]
    return message


def map_message(found: StageMap) -> Diagnosis:
    """The message of a stage map, which has no verdict."""
    table = json.dumps({"stage_by_phase": found.phases}) if found.phases else ""
    message = _stamped(Diagnosis(sentence=found.text, strikes=found.strikes, json=table))
    message.stages = [StageGap(name=n, gap=g, floor=1.0, share=s) for n, g, s in found.stages]
    return message


def leaders_message(leaders: Iterable[tuple[str, float]]) -> Diagnosis:
    """The message of the leading candidates and their probabilities, best first; no verdict."""
    candidates = [Candidate(name=n, probability=p) for n, p in leaders]
    return _stamped(
        Diagnosis(
            sentence=f"so far {candidates[0].name} leads; not diagnosed yet", candidates=candidates
        )
    )


def _stamped(message: Diagnosis) -> Diagnosis:
    message.header.stamp = common.time_msg(time.time_ns())
    return message


def _number(x: float | None) -> float:
    """A number of a diagnosis.json, where null stands for what is not known."""
    return math.nan if x is None else float(x)
