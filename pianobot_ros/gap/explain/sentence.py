"""The verdict as one sentence, and what is to be said beside it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

from pianobot_ros.gap.diagnosis import Closure, FoundEffect, UnknownDescription
from pianobot_ros.gap.problem.constants import MOST, SMALL


def sentence(
    verdict: str,
    effects: tuple[FoundEffect, ...],
    gap: Closure,
    unknown: UnknownDescription | None,
    inseparable: tuple[tuple[str, ...], ...],
    shows_in: tuple[str, ...] = (),
    sure: float = 1.0,
    nearest: tuple[str, ...] = (),
) -> str:
    """One plain statement that an engineer can act on; `shows_in` are the observables in which the
    effects close most, `sure` is the verdict's probability (of an effect with all that cannot be
    told from it), `nearest` the effects that leave least of a gap whose cause is unknown: the
    closure is theirs.
    """
    if verdict == "none":
        size = f"{gap.before:.1f}"
        within = "Twin and robot agree within the repeatability floor"
        return (
            f"{within if size == '1.0' else 'Twin and robot differ by nothing systematic'} (gap"
            f" {size} × floor): nothing is claimed."
        )
    if verdict == "parameters":
        closing = ""
        if math.isfinite(gap.closed):
            interval = f"({_percent(gap.closed_low)} to {_percent(gap.closed_high)})"
            closing = f" closes {_percent(gap.closed)} % {interval} of the held-out gap"
        done = f"the twin's parameters{closing or ' brings the gap to the floor'}"
        if sure > MOST:
            return f"No structure is missing: refitting {done}."
        return f"Refitting {done}; whether an effect is missing beside them these data cannot tell."
    if verdict == "unknown":
        described = f"; the residual of {unknown.observable} {_how(unknown)}" if unknown else ""
        text = f"The gap has a cause that no effect of the library explains{described}."
        if nearest and gap.closed_by_effect > SMALL:
            text += (
                f" {' and '.join(nearest)} {'come' if len(nearest) > 1 else 'comes'} nearest:"
                f" {_percent(gap.closed_by_effect)} % of what refitting leaves above the"
                f" floor{_where(shows_in)}."
            )
        return text
    names = " and ".join(f"{e.name} ({e.stage}, {100 * e.probability:.0f} %)" for e in effects)
    word = "Missing effects" if len(effects) > 1 else "Missing effect"
    text = f"{word}: {names}. {_closing(gap, len(effects) > 1, shows_in)}"
    named = {e.name for e in effects}
    like = sorted({n for g in inseparable if named & set(g) for n in g} - named)
    if like:
        text += f" These data cannot tell it from {', '.join(like)}: together {100 * sure:.0f} %."
    return text


def of_rivals(rivals: Mapping[str, float]) -> str:
    """What is nearly as likely as the verdict, with its probabilities; empty without any, as what
    follows.
    """
    each = [f"{name} ({100 * p:.0f} %)" for name, p in rivals.items()]
    return f"Nearly as likely: {', '.join(each)}." if each else ""


def of_odd_values(odd: Mapping[str, float]) -> str:
    """Parameters whose values are implausible, by how many prior deviations they are off."""
    each = [f"{name} by {off:.1f}" for name, off in odd.items()]
    said = (
        f"Their values are implausible ({' and '.join(each)} prior deviations): a cause that the"
        " library lacks may hide in them."
    )
    return said if odd else ""


def of_the_rest(left: Mapping[str, float], unknown: UnknownDescription | None, asked: bool) -> str:
    """The gaps `left` (floors by observable) that named effects do not explain, and what those of
    the largest depend on; whether one more effect was `asked`.
    """
    if not left:
        return ""
    sizes = [f"{size:.1f} floors of {name}" for name, size in left.items()]
    how = f"; it {_how(unknown)}" if unknown and unknown.observable == next(iter(left)) else ""
    why = "The rest was asked of no further effect"
    if asked:
        why = "No effect of the library explains the rest"
    return f"{why}: {' and '.join(sizes)}{how}."


def of_readings(names: Collection[str]) -> str:
    """The observables of which readings were taken out, that may say otherwise."""
    said = (
        f"Some readings of {' and '.join(sorted(names))} are far from all others and were left out,"
        " as the warnings say."
    )
    return said if names else ""


def of_noise(noisy: Collection[str]) -> str:
    """The observables in which what is left above the floor may be noise."""
    said = (
        f"What is left of {' and '.join(noisy)} above the floor is as large at all times and"
        " depends on nothing recorded: where nothing repeats, it passes for noise."
    )
    return said if noisy else ""


def _how(unknown: UnknownDescription) -> str:
    """What the residual depends on."""
    nothing = "depends on none of the recorded quantities"
    return next((d.text for d in unknown.dependencies), nothing)


def _closing(gap: Closure, several: bool, shows_in: tuple[str, ...]) -> str:
    """What refitting closes and what the effects close, apart."""
    share = gap.closed_by_parameters
    refitting = f"Refitting parameters alone closes {_percent(share)} % of the held-out gap"
    if gap.widened:
        refitting = f"Refitting parameters alone widens the held-out gap by {_percent(-share)} %"
    if not math.isfinite(gap.closed_by_effect):
        return (
            f"{refitting} and reaches the floor, so the"
            f" {'effects are' if several else 'effect is'} named for plausibility of the values,"
            " not for closing the gap."
        )
    interval = f"({_percent(gap.closed_by_effect_low)} to {_percent(gap.closed_by_effect_high)})"
    return (
        f"{refitting}; the {'effects close' if several else 'effect closes'}"
        f" {_percent(gap.closed_by_effect)} % {interval} of what that leaves above the"
        f" floor{_where(shows_in)}."
    )


def _where(shows_in: tuple[str, ...]) -> str:
    return f", mostly in {' and '.join(shows_in)}" if shows_in else ""


def _percent(x: float) -> str:
    return f"{round(100 * x)}" if math.isfinite(x) else "?"
