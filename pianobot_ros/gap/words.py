"""The verdict as one sentence."""

from __future__ import annotations

import math

from pianobot_ros.gap.diagnosis import Closure, FoundEffect, UnknownDescription


def sentence(verdict: str, effects: tuple[FoundEffect, ...], gap: Closure,
             unknown: UnknownDescription | None, inseparable: tuple[tuple[str, ...], ...]) -> str:  # fmt: skip
    """One plain sentence that an engineer can act on."""
    if verdict == "none":
        return (
            f"Twin and robot agree within the repeatability floor (gap {gap.before:.1f} × floor): nothing is claimed."
        )
    closing = ""
    if math.isfinite(gap.closed):
        interval = f"({_percent(gap.closed_low)} to {_percent(gap.closed_high)})"
        closing = f" closes {100 * gap.closed:.0f} % {interval} of the held-out gap"
    if verdict == "parameters":
        return f"No structure is missing: refitting the twin's parameters{closing or ' brings the gap to the floor'}."
    if verdict == "unknown":
        told = (
            f"; the residual of {unknown.observable} {unknown.dependencies[0].text}"
            if unknown and unknown.dependencies
            else ""
        )
        return f"The gap has a cause that no effect of the library explains{told}."
    names = " and ".join(f"{e.name} ({e.stage}, {100 * e.probability:.0f} %)" for e in effects)
    word = "Missing effects" if len(effects) > 1 else "Missing effect"
    text = f"{word}: {names}; adding {'them' if len(effects) > 1 else 'it'}{closing}."
    named = {e.name for e in effects}
    like = sorted({n for g in inseparable if named & set(g) for n in g} - named)
    if like:
        text += f" These data cannot tell it from {', '.join(like)}."
    return text


def _percent(x: float) -> str:
    return f"{100 * x:.0f}" if math.isfinite(x) else "?"
