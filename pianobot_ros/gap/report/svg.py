"""Small charts as plain SVG: they need no script, print well, and take their colours from the page
(dark or light).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from pianobot_ros.gap.problem.types import Array

POINTS = 600
"""Points of a curve: more than its chart is wide."""


@dataclass(frozen=True)
class Series:
    """A curve (n,) with its CSS class ("real", "before", "after", "zero")."""

    x: Array
    y: Array
    style: str
    label: str = ""


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round numbers between low and high."""
    span = high - low
    if not math.isfinite(span) or span <= 0:
        return [low]
    raw = span / count
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 2.5, 5, 10) if m * power >= raw)
    first = math.ceil(low / step) * step
    return [round(first + i * step, 12) for i in range(int((high - first) / step + 1e-9) + 1)]


def number(x: float, digits: int = 3) -> str:
    """Short number for a label, of so many significant digits; whole ones are not rounded."""
    if x == 0 or not math.isfinite(x):
        return "0" if x == 0 else "–"
    if 1e-3 <= abs(x) < 1e6:
        return f"{x:.{max(digits, len(str(int(abs(x)))))}g}"
    return f"{x:.{digits - 2}e}".replace("e-0", "e-").replace("e+0", "e")


def alike(*values: float) -> list[str]:
    """Numbers that are to be compared, with so many digits that one sees what they differ by."""
    finite = [v for v in values if math.isfinite(v)]
    span, top = (max(finite) - min(finite), max(map(abs, finite))) if finite else (0.0, 0.0)
    digits = math.floor(math.log10(top / span)) + 2 if span > 0 else 3
    return [number(v, min(max(digits, 3), 9)) for v in values]


def chart(
    lines: Sequence[Series],
    *,
    x_label: str = "",
    y_label: str = "",
    band: float | None = None,
    points: bool = False,
    title: str = "",
) -> str:
    """Line chart; `band` shades ± that much around zero; NaN breaks a line; `points` draws dots
    instead.
    """
    width, height, right, top, bottom = 520, 190, 10, 10, 34
    xs = np.concatenate([ln.x for ln in lines]) if lines else np.zeros(1)
    ys = np.concatenate([ln.y for ln in lines]) if lines else np.zeros(1)
    ys = ys[np.isfinite(ys)]
    x0, x1 = float(np.min(xs)), float(np.max(xs))
    y0, y1 = (float(np.min(ys)), float(np.max(ys))) if ys.size else (0.0, 1.0)
    if band is not None:
        y0, y1 = min(y0, -band), max(y1, band)
    pad = 0.06 * (y1 - y0) or 1.0
    y0, y1 = y0 - pad, y1 + pad
    if x1 <= x0:
        x1 = x0 + 1.0
    levels = ticks(y0, y1, 4)
    # beside the axis' title, where a narrow page enlarges both
    left = 24 + 9 * max(len(number(v)) for v in levels)

    def px(x: float) -> float:
        return left + (x - x0) / (x1 - x0) * (width - left - right)

    def py(y: float) -> float:
        return height - bottom - (y - y0) / (y1 - y0) * (height - top - bottom)

    out = [
        f'<svg class="chart" viewBox="0 0 {width} {height}" role="img"'
        f' aria-label="{escape(title or y_label)}">'
    ]
    out += [_level(v, py(v), left, width - right) for v in levels]
    out += [_mark(v, px(v), height - bottom + 15) for v in ticks(x0, x1, 6)]
    if band is not None:
        out.append(
            f'<rect class="band" x="{left}" width="{width - left - right}" y="{py(band):.1f}"'
            f' height="{max(py(-band) - py(band), 1):.1f}"><title>floor ±'
            f" {number(band)}</title></rect>"
        )
    for ln in lines:
        out.append(_dots(ln, px, py) if points else _path(ln, px, py))
    out.append(
        f'<text class="axis" x="{(left + width - right) / 2:.0f}" y="{height - 4}"'
        f' text-anchor="middle">{escape(x_label)}</text>'
    )
    middle = (top + height - bottom) / 2
    out.append(
        f'<text class="axis" transform="translate(12 {middle:.0f}) rotate(-90)"'
        f' text-anchor="middle">{escape(y_label)}</text>'
    )
    return "".join(out) + "</svg>"


def _level(value: float, y: float, left: float, right: float) -> str:
    """A line of the grid with its number."""
    return (
        f'<line class="grid" x1="{left}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>'
        f'<text class="tick" x="{left - 6}" y="{y + 3.5:.1f}"'
        f' text-anchor="end">{number(value)}</text>'
    )


def _mark(value: float, x: float, y: float) -> str:
    """A number of the horizontal axis."""
    return f'<text class="tick" x="{x:.1f}" y="{y}" text-anchor="middle">{number(value)}</text>'


def _path(line: Series, px, py) -> str:  # type: ignore[no-untyped-def]
    pieces, pen = [], "M"
    x, y = _thin(line.x, line.y)
    for a, b in zip(x, y, strict=True):
        if not math.isfinite(b):
            pen = "M"
            continue
        pieces.append(f"{pen}{px(a):.1f} {py(b):.1f}")
        pen = "L"
    return (
        f'<path class="{line.style}"'
        f' d="{"".join(pieces)}"><title>{escape(line.label)}</title></path>'
    )


def _dots(line: Series, px, py) -> str:  # type: ignore[no-untyped-def]
    dots = (
        f'<circle class="{line.style}" cx="{px(a):.1f}" cy="{py(b):.1f}" r="3"/>'
        for a, b in zip(line.x, line.y, strict=True)
        if math.isfinite(b)
    )
    return "".join(dots)


def _thin(x: Array, y: Array) -> tuple[Array, Array]:
    """At most so many points with the same envelope: the smallest and largest of each run."""
    if x.size <= POINTS:
        return x, y
    run = math.ceil(x.size / (POINTS / 2))
    keep: list[int] = []
    for i in range(0, x.size, run):
        part = y[i : i + run]
        if np.isfinite(part).any():
            keep += sorted({i + int(np.nanargmin(part)), i + int(np.nanargmax(part))})
        else:
            keep.append(i)
    return x[keep], y[keep]


def scale_bar(floor: float, before: float, refit: float, after: float) -> str:
    """The closure on one line: from the floor to the gap before, with what refitting and the effect
    leave. It has no words: those would run into each other where values are close.
    """
    top = max(before, refit, after, floor * 1.2) * 1.04

    def bar(style: str, low: float, high: float) -> str:
        return (
            f'<rect class="{style}" x="{100 * low / top:.2f}%"'
            f' width="{100 * max(high - low, 0.0) / top:.2f}%" y="11" height="22"/>'
        )

    def mark(style: str, value: float, above: int, below: int) -> str:
        x = f"{100 * value / top:.2f}%"
        return f'<line class="mark {style}" x1="{x}" x2="{x}" y1="{above}" y2="{below}"/>'

    parts = [
        bar("band", 0.0, floor),
        bar("bar-before", floor, before),
        bar("bar-closed", max(after, floor), before),
        mark("", floor, 11, 33),
        mark("refit", refit, 11, 44),
        mark("before", before, 0, 33),
        mark("after", after, 0, 33),
    ]
    return (
        '<svg class="bar" role="img" aria-label="held-out gap before and after">'
        f"{''.join(parts)}</svg>"
    )
