"""How often an answer is right, by the probability that it was given."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

__all__ = ["Bin", "bins_of", "calibration_error", "chance_error", "to_svg"]

EDGES = (0.0, 0.4, 0.6, 0.8, 0.9, 0.97, 1.0001)
WIDTH = 0.1
SIZE, MARGIN = 240.0, 36.0


class Bin(NamedTuple):
    """Cases whose probability lies from ``low`` to ``high``: its mean, the share that was right,
    and how many they are.
    """

    low: float
    high: float
    mean: float
    right: float
    cases: int


def bins_of(
    probability: Sequence[float], right: Sequence[bool], edges: Sequence[float] = EDGES
) -> list[Bin]:
    """Bins that hold a case. ``probability`` and ``right`` (n,)."""
    p, hit = np.asarray(probability, dtype=float), np.asarray(right, dtype=float)
    out = []
    for low, high in pairwise(edges):
        inside = (p >= low) & (p < high)
        if inside.any():
            mean, share = float(p[inside].mean()), float(hit[inside].mean())
            out.append(Bin(low, min(high, 1.0), mean, share, int(inside.sum())))
    return out


def calibration_error(probability: Sequence[float], right: Sequence[bool]) -> float:
    """Expected calibration error in ten bins of equal width (Naeini, Cooper and Hauskrecht 2015):
    the mean distance between probability and share of right answers, weighted by cases. NaN
    without cases.
    """
    edges = [*np.arange(0.0, 1.0, WIDTH), 1.0001]
    bins = bins_of(probability, right, edges)
    count = sum(b.cases for b in bins)
    if not count:
        return float("nan")
    return sum(b.cases * abs(b.mean - b.right) for b in bins) / count


def chance_error(probability: Sequence[float], draws: int = 1000, seed: int = 0) -> float:
    """Calibration error that chance alone makes in so many cases (median over draws): what were
    shown if every probability were right. NaN without cases.
    """
    p = np.asarray(probability, dtype=float)
    hits = np.random.default_rng(seed).random((draws, p.size)) < p
    return float(np.median([calibration_error(probability, list(hit)) for hit in hits]))


def to_svg(bins: Sequence[Bin], title: str = "") -> str:
    """A reliability diagram (DeGroot and Fienberg 1983): a dot a bin, its area by the cases."""
    side = SIZE + 2 * MARGIN

    def place(p: float, right: float) -> tuple[float, float]:
        return MARGIN + SIZE * p, MARGIN + SIZE * (1.0 - right)

    most = max((b.cases for b in bins), default=1)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {side:g} {side:g}" '
        f'width="{side:g}" font-family="sans-serif" font-size="10">',
        f"<title>{title or 'Reliability of the first answer'}</title>",
        f'<rect x="{MARGIN:g}" y="{MARGIN:g}" width="{SIZE:g}" height="{SIZE:g}" fill="none" '
        'stroke="gray"/>',
    ]
    (x0, y0), (x1, y1) = place(0.0, 0.0), place(1.0, 1.0)
    parts.append(
        f'<line x1="{x0:g}" y1="{y0:g}" x2="{x1:g}" y2="{y1:g}" stroke="gray" '
        'stroke-dasharray="4 3"/>'
    )
    for b in bins:
        x, y = place(b.mean, b.right)
        radius = 3.0 + 7.0 * (b.cases / most) ** 0.5
        parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="steelblue" '
            f'fill-opacity="0.7"><title>{b.cases} cases: {b.mean:.2f} told, {b.right:.2f} right'
            "</title></circle>"
        )
    middle = side / 2
    parts += [
        f'<text x="{middle:g}" y="{side - 10:g}" text-anchor="middle">probability told</text>',
        f'<text x="12" y="{middle:g}" text-anchor="middle" transform="rotate(-90 12 {middle:g})">'
        "share right</text>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"
