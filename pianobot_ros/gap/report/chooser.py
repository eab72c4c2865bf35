"""The chart in which a reader chooses signal and block: data and script within the page."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from importlib.resources import files

from pianobot_ros.gap.diagnosis import Trace
from pianobot_ros.gap.problem.types import Array

__all__ = ["chooser"]

DIGITS = 5  # significant ones of what is drawn


def chooser(traces: Sequence[Trace]) -> str:
    """HTML with two lists, a chart of measured, twin before, refitted and after, and its values
    under the pointer. Without a script, and on paper, what was chosen last or nothing is seen.
    """
    data = [
        {"signal": t.observable}
        | {name: getattr(t, name) for name in ("block", "condition", "unit", "floor")}
        | {name: _short(getattr(t, name)) for name in ("t", "real", "before", "refit", "after")}
        for t in traces
    ]
    # A name from a recording can so neither end the script element nor begin another one.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    script = files("pianobot_ros.gap.report").joinpath("templates/chooser.js").read_text("utf-8")
    return (
        '<div class="chooser"><label>signal <select id="signal"></select></label> <label>block '
        '<select id="block"></select></label><div id="chosen"></div><p class="legend" id="values">'
        f'</p></div><script type="application/json" id="traces">{text}</script>'
        f"<script>{script}</script>"
    )


def _short(values: Array) -> list[float | None]:
    return [float(f"{v:.{DIGITS}g}") if math.isfinite(v) else None for v in values.tolist()]
