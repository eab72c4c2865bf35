"""The live comparison in the terminal: a table where there is a screen, a line for each strike
where there is none.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

__all__ = ["live_view", "strike_line", "strike_rows", "write_picture"]

SHOWN = 12
COLUMNS = {
    "#": 2,
    "note": 4,
    "condition": 8,
    "V_pre m/s": 13,
    "V_rel m/s": 13,
    "T_hold s": 13,
    "T_idle s": 13,
    "peak N": 11,
    "Err": 6,
    "latency": 7,
}
"""Least width of each column."""
PAIRED = ("m/s", "m/s", "s", "s", "N")
"""Units of the five pairs of a strike."""
COLOURS = {"ok": "green", "warning": "yellow", "error": "red", "stale": "magenta"}
SCALES = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "Pa": (1e-3, "kPa"), "N": (1.0, "N")}


def _number(value: float, digits: int = 3) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def strike_rows(report: Any) -> list[str]:
    """Cells of the table for one GapReport."""
    (gap,) = report.keystrokes
    real, sim = gap.real, gap.sim
    pairs = [
        f"{_number(getattr(real, name), digits)} | {_number(getattr(sim, name), digits)}"
        for name, digits in (
            ("v_pre", 3),
            ("v_rel", 3),
            ("t_hold", 3),
            ("t_idle", 3),
            ("peak_force", 2),
        )
    ]
    missing = " and ".join(
        c for c, lost in (("real", gap.real_missing), ("sim", gap.sim_missing)) if lost
    )
    err = (
        f"{missing} silent" if missing else "–" if math.isnan(gap.err) else f"{100 * gap.err:.1f} %"
    )
    return [
        str(report.strike),
        str(gap.note),
        gap.condition,
        *pairs,
        err,
        f"{1e3 * report.latency:.0f} ms",
    ]


def strike_line(report: Any) -> str:
    """One line for a log: of each pair the real cell's number stands first."""
    strike, note, condition, *pairs, err, latency = strike_rows(report)
    named = zip(("V_pre", "V_rel", "T_hold", "T_idle", "peak"), PAIRED, pairs, strict=True)
    told = (f"{name} {pair} {unit}" for name, unit, pair in named)
    head = f"strike {strike}  note {note}  condition {condition}  real | sim:"
    return "  ".join((head, *told, f"Err {err}", f"latency {latency}"))


def write_picture(file: Path, view: RenderableType, width: int = 132) -> None:
    """The view as an SVG picture that fetches no fonts."""
    console = Console(
        record=True, width=width, file=io.StringIO(), force_terminal=True, legacy_windows=False
    )
    console.print(view)
    form = re.sub(r"@font-face \{\{.*?\}\}", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)
    file.write_text(
        console.export_svg(title="pianobot up --emulated", code_format=form), encoding="utf-8"
    )


def live_view(
    reports: Sequence[Any],
    states: Mapping[str, tuple[str, str]],
    twin: Any,
    note: str = "",
    events: Sequence[str] = (),
) -> Group:
    """Strikes, signals of the last strike, and nodes."""
    strikes = Table(title="real | sim", title_justify="left", expand=True)
    for name, width in COLUMNS.items():  # whatever the terminal's width, numbers are shown whole
        strikes.add_column(
            name, no_wrap=True, min_width=width, max_width=16 if name == "condition" else None
        )
    for report in list(reports)[-SHOWN:]:
        strikes.add_row(*strike_rows(report))
    signals = Table(title="signals of the last strike", title_justify="left")
    for name in ("signal", "lag ms", "RMS", "after lag", "floor", "repeats"):
        signals.add_column(name)
    for s in reports[-1].signals if reports else ():
        scale, unit = SCALES.get(s.unit, (1.0, s.unit))
        signals.add_row(
            s.signal,
            _number(1e3 * s.lag, 1),
            f"{_number(scale * s.rms)} {unit}",
            _number(scale * s.rms_aligned),
            _number(scale * s.floor),
            str(s.strikes),
        )
    nodes = Table(title="nodes", title_justify="left")
    nodes.add_column("node")
    nodes.add_column("state")
    for node, (state, message) in sorted(states.items()):
        nodes.add_row(node, Text(f"{state}: {message}"[:70], style=COLOURS.get(state, "")))
    pace = (
        f"real-time factor {twin.real_time_factor:.3f}, jitter p99 {1e3 * twin.jitter_p99:.2f} ms"
        if twin
        else "no twin yet"
    )
    return Group(
        strikes,
        signals,
        nodes,
        Text(pace),
        *(Text(e, style="yellow") for e in list(events)[-4:]),
        Text(note),
    )
