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


def number(x: float) -> str:
    """Short number for a label."""
    if x == 0 or not math.isfinite(x):
        return "0" if x == 0 else "–"
    return (
        f"{x:.3g}" if 1e-3 <= abs(x) < 1e4 else f"{x:.1e}".replace("e-0", "e-").replace("e+0", "e")
    )


def chart(
    lines: Sequence[Series],
    *,
    width: int = 520,
    height: int = 190,
    x_label: str = "",
    y_label: str = "",
    band: float | None = None,
    points: bool = False,
    title: str = "",
) -> str:
    """Line chart; `band` shades ± that much around zero; NaN breaks a line; `points` draws dots
    instead.
    """
    left, right, top, bottom = 58, 10, 10, 34
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

    def px(x: float) -> float:
        return left + (x - x0) / (x1 - x0) * (width - left - right)

    def py(y: float) -> float:
        return height - bottom - (y - y0) / (y1 - y0) * (height - top - bottom)

    out = [
        f'<svg class="chart" viewBox="0 0 {width} {height}" role="img"'
        f' aria-label="{escape(title or y_label)}">'
    ]
    out += [_level(v, py(v), left, width - right) for v in ticks(y0, y1, 4)]
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


def _thin(x: Array, y: Array, limit: int = 600) -> tuple[Array, Array]:
    """Fewer points with the same envelope: first, smallest and largest of each run."""
    if x.size <= limit:
        return x, y
    run = math.ceil(x.size / (limit / 2))
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
    leave.
    """
    width, height, left, right = 760, 112, 20, 20
    top = max(before, refit, after, floor * 1.2) * 1.04

    def px(v: float) -> float:
        return left + v / top * (width - left - right)

    y = 50
    out = [
        f'<svg class="chart wide" viewBox="0 0 {width} {height}" role="img" aria-label="held-out'
        ' gap before and after">'
    ]
    out.append(
        f'<rect class="band" x="{px(0):.1f}" y="{y - 11}" width="{px(floor) - px(0):.1f}"'
        ' height="22"/>'
    )
    out.append(
        f'<rect class="bar-before" x="{px(floor):.1f}" y="{y - 11}"'
        f' width="{max(px(before) - px(floor), 0):.1f}" height="22"/>'
    )
    if before > after:
        out.append(
            f'<rect class="bar-closed" x="{px(max(after, floor)):.1f}" y="{y - 11}" '
            f'width="{max(px(before) - px(max(after, floor)), 0):.1f}" height="22"/>'
        )
    marks = [
        ("floor", floor, 88, "below"),
        ("before", before, 24, "above"),
        ("parameters refitted", refit, 106, "below"),
        ("after", after, 24, "above"),
    ]
    for label, v, at, side in marks:
        y1, y2 = (y + 13, at - 11) if side == "below" else (y - 13, at + 4)
        anchor = "start" if px(v) < 120 else ("end" if px(v) > width - 120 else "middle")
        out.append(f'<line class="mark" x1="{px(v):.1f}" x2="{px(v):.1f}" y1="{y1}" y2="{y2}"/>')
        out.append(
            f'<text class="tick strong" x="{px(v):.1f}" y="{at}" text-anchor="{anchor}">{label}'
            f" {v:.2f}</text>"
        )
    return "".join(out) + "</svg>"
