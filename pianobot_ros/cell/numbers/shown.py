"""Numbers in the units of a reader."""

from __future__ import annotations

__all__ = ["in_kpa"]


def in_kpa(pressure: float) -> str:
    """Pa in whole kPa: what a sensor reads around nothing is no "-0"."""
    return f"{round(pressure / 1e3)} kPa"
