"""Rates that settings state: under their keys, themselves or in a part that holds settings only."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pianobot_ros.axis.reading.headers.words import tokens

__all__ = ["RATES", "STEPS", "numeric", "stated_rate"]

RATES = (
    "fs",
    "rate",
    "fps",
    "freq",
    "frequency",
    "sample_rate",
    "sampling_rate",
    "hz",
    "control_freq",
)
STEPS = ("dt", "ts", "sample_time", "timestep", "period")


def stated_rate(held: Mapping[str, Any]) -> float:
    """Hz that a mapping states (`action_hz: 50`, `dt: 0.02`), itself or in a part that holds
    settings only (`config`); 0 if none.
    """
    parts = [v for v in held.values() if isinstance(v, Mapping)]
    for part in (held, *(p for p in parts if not any(map(numeric, p.values())))):
        for key, value in part.items():
            words = set(tokens(key))
            if not isinstance(value, (int, float)) or isinstance(value, bool):
                continue
            if not 0.0 < value < math.inf:
                continue
            if key.lower() in RATES or "hz" in words:
                return float(value)
            if key.lower() in STEPS:
                return 1.0 / value
    return 0.0


def numeric(value: Any) -> bool:
    """Whether it is a list of numbers, or of rows of them: samples rather than a setting."""
    if not isinstance(value, list) or len(value) < 4:
        return False
    return all(
        isinstance(x, (int, float)) or x is None or (isinstance(x, list) and x and _row(x))
        for x in value[:20]
    )


def _row(value: list[Any]) -> bool:
    return all(isinstance(x, (int, float)) for x in value)
