"""Combinations of effects that a twin has reason to try, fitted before any search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pianobot_ros.gap.search.study import Entry, Study, make_entry, open_observables

__all__ = ["try_guesses"]


def try_guesses(study: Study, names: Sequence[str], calls: int) -> None:
    """Fit the twin's `guesses` (if it has any) one after the other while the best of them leaves
    something open; `calls` is what a fit takes.

    Each begins with the effects' values as the twin gives them, and the twin's own where the first
    of them left these.
    """
    guesses: Sequence[Mapping[str, Mapping[str, float]]] = getattr(
        study.problem.twin, "guesses", ()
    )
    tried: list[Entry] = []
    for guess in guesses:
        effects = tuple(guess)
        if not effects or len(effects) > study.options.max_effects or set(effects) - set(names):
            continue
        if any(not _open(study, e) for e in tried):
            return
        if not study.problem.allows(calls):
            study.warn("the budget did not allow trying what the twin itself suggests")
            return
        first = tried[0].fit if tried else None
        values = {} if first is None else dict(first.values)
        for own in guess.values():
            values |= own
        v = study.fitter.space(effects).encode(values)
        fit = study.fitter.refine(study.fitter.start(effects, v), study.options.triage_iterations)
        entry = make_entry(study, fit)
        study.entries.append(entry)
        tried.append(entry)


def _open(study: Study, entry: Entry) -> bool:
    size = study.options.calibration.further
    return bool(open_observables(study, entry.held_out, size, sigma=0.0))
