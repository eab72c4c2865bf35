"""Whole numbers as encoders and servos' registers hold them: where their sign and turn stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pianobot_ros.gap.problem.types import Array

__all__ = ["counts_of_a_turn", "signed", "whole"]

USUAL = 4096
"""Counts of a turn where nothing tells them."""
BITS = range(8, 21)
"""Bits of a single-turn encoder."""
CALMER = 0.2
"""Share of a column's leaps below which the same column with its sign is what was meant."""


def whole(y: Array) -> bool:
    """Whether the known ones of y (n,) are whole numbers, and there are some."""
    known = y[np.isfinite(y)]
    return known.size > 0 and bool(np.all(known == np.round(known)))


def signed(y: Array) -> tuple[Array, str] | None:
    """y (n,) with the sign that its top bit holds, and how it was held; None if it holds none.

    Servos send a size with a bit for the direction, or a two's complement that the logger took as
    unsigned. Either leaps by the bit's value where the truth passes zero, and only there.
    """
    known = y[np.isfinite(y)]
    if not whole(y) or float(known.min()) < 0 or not 256 <= float(known.max()) < 2**33:
        return None
    top = 2 ** (int(known.max()).bit_length() - 1)
    made = {
        f"whose sign is the bit of {top}": np.where(y >= top, top - y, y),
        f"that count down from {2 * top}": np.where(y >= top, y - 2 * top, y),
    }
    how = min(made, key=lambda k: (_leaps(made[k], top), _path(made[k])))
    there = _leaps(y, top)
    return (made[how], how) if there and _leaps(made[how], top) < CALMER * there else None


def _leaps(y: Array, top: int) -> int:
    return int(np.sum(np.abs(np.diff(y[np.isfinite(y)])) > top / 2))


def _path(y: Array) -> float:
    return float(np.sum(np.abs(np.diff(y[np.isfinite(y)]))))


def counts_of_a_turn(columns: Sequence[Array]) -> int:
    """Counts of a turn of encoders (n,): the power of two at which one comes round, or `USUAL`."""
    for y in columns:
        known = y[np.isfinite(y)]
        if known.size < 20 or known.min() < 0 or known.max() >= 2**BITS.stop:
            continue
        bits: int = int(known.max()).bit_length()
        step = np.abs(np.diff(known)) / 2.0**bits
        round_again = step > 0.8
        if bits in BITS and round_again.any() and not np.any((step > 0.3) & ~round_again):
            return 1 << bits
    return USUAL
