"""Combinations of effects that a twin has reason to try, fitted before any search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pianobot_ros.gap.fitting.evidence import told
from pianobot_ros.gap.search.contenders import open_further
from pianobot_ros.gap.search.study import Entry, Study, make_entry, put

__all__ = ["try_guesses"]


def try_guesses(study: Study, calls: int) -> Study:
    """The study with the twin's `guesses` (if it has any), fitted one after the other while the
    best of them leaves something open; `calls` is what a fit takes.

    Each begins with the values that the twin gives it, of the effects and any of its own; what is
    not given begins where the first of them left it.
    """
    guesses: Sequence[Mapping[str, Mapping[str, float]]] = getattr(
        study.problem.twin, "guesses", ()
    )
    library = study.problem.effects
    tried: list[Entry] = []
    for guess in guesses:
        effects = tuple(guess)
        if not effects or len(effects) > study.options.max_effects or set(effects) - set(library):
            continue
        if any(not open_further(study, e.held_out) for e in tried):
            break
        if not study.problem.allows(calls):
            return told(study, "the budget did not allow trying what the twin itself suggests")
        first = tried[0].fit if tried else None
        values = {} if first is None else dict(first.values)
        for own in guess.values():
            values |= own
        v = study.fitter.space(effects).encode(values)
        begun = study.fitter.begun(effects, v)
        if begun is None:
            continue
        fit = study.fitter.refine(begun, study.options.triage_iterations)
        entry = make_entry(study, fit)
        study = put(study, entry)
        tried.append(entry)
    return study
