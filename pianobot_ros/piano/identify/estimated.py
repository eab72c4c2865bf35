"""What every identified value is said with."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Estimated"]


@dataclass(frozen=True)
class Estimated:
    """A value with the interval that holds it."""

    name: str
    value: float
    low: float
    high: float
    unit: str
