"""What repeats differ by because of an effect of the library.

What repeats differ by is the floor, and what the floor holds is never looked for. But repeats share
a command, and not all that a law acts by: the angle of a roller, the tooth on which an
incremental encoder woke up, the side of a play. A law that acts by that acts otherwise in each of
them, and would make the very floor under which it is not seen. With one repeat it was found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.gap.fitting.fit import Fit
from pianobot_ros.gap.floor.repeats import set_apart
from pianobot_ros.gap.problem.constants import LEADERS, SMALL
from pianobot_ros.gap.problem.problem import Index, Problem
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.grow import screened
from pianobot_ros.gap.search.parameters import Lowered, floor_under, refitted
from pianobot_ros.gap.search.screening import Screened, begin
from pianobot_ros.gap.search.study import Study, affords, make_entry

__all__ = ["what_sets_apart_is_no_scatter"]


def what_sets_apart_is_no_scatter(study: Study) -> Study:
    """The study of the refitted parameters under the floor that is left where effects are taken off
    by which repeats differ; itself where none of those that were screened is one.

    Several may set repeats apart, and none by most of it, or one by most of what another leaves: so
    they are looked for one beside the other.
    """
    base = study.entry("parameters").fit
    for _ in range(study.options.max_effects):
        others = [s for s in study.signatures if s.effect not in base.effects]
        found = screened(study, base, others) if base.effects else study.screened
        begun = _fitted(study, base, found)
        if not begun:
            break
        lower = [(floor, f) for f in begun if (floor := _lowered(study, f)) is not None]
        base = begun[0]
        if lower:
            floor, base = min(lower, key=lambda x: x[0].left)
            study = refitted(study, study.entry("parameters").fit, floor)
    return study


def _fitted(study: Study, base: Fit, found: Sequence[Screened]) -> list[Fit]:
    """Those of the effects `found` that set repeats apart most, fitted on top of `base`."""
    chosen = _setting_apart(study, base, found)
    if not chosen or not affords(study, LEADERS):
        return []
    steps, begun = study.options.triage_iterations, []
    for s in chosen[:LEADERS]:  # what else is open is not asked: one may close it, another this
        fits = [study.fitter.refine(f, steps, f.beyond(base)) for f in begin(study.fitter, base, s)]
        begun += [min(fits, key=lambda f: f.cost)] if fits else []
    return begun


def _lowered(study: Study, fit: Fit) -> Lowered | None:
    """The floor that a fit leaves where repeats scatter far less under it, by blocks that it was
    not fitted to: few blocks are often set apart as any law would.
    """
    entry = make_entry(study, fit)
    return floor_under(study, entry, entry.held_out)


def _setting_apart(study: Study, base: Fit, found: Sequence[Screened]) -> list[Screened]:
    """Those of the effects `found` on top of `base` that take a part that is not small off the
    floor's square of a series that repeats, with the parameters that move along, and predict better
    what is held out; those that take most off first.
    """
    noises = study.fitter.noise.estimates.noises
    residual = study.problem.y - base.prediction
    sets, apart = _sets(study.problem, residual), []
    before = _squares(sets, residual)
    for s in found if sets else ():
        after = _squares(sets, residual - s.moved)
        most = max((x - after[o]) / noises[o].floor ** 2 for o, x in before.items())
        if s.gain > 0.0 and most > SMALL:
            apart.append((most, s))
    return [s for _, s in sorted(apart, key=lambda x: -x[0])]


def _sets(problem: Problem, residual: Array) -> dict[int, list[Index]]:
    """Flat indices (m, n) of the samples that lie side by side in repeats, by observable. Of events
    there are few, and any effect takes some of what they differ by.
    """
    series = [o for o in problem.present if problem.observables[o].kind == "series"]
    sets = {o: [g.at for g in set_apart(problem, o, residual)] for o in series}
    return {o: own for o, own in sets.items() if own}


def _squares(sets: Mapping[int, Sequence[Index]], residual: Array) -> dict[int, float]:
    """Mean square by which repeats differ from their mean, by observable."""
    return {
        o: float(np.mean(np.concatenate([np.var(residual[i], 0, ddof=1) for i in own])))
        for o, own in sets.items()
    }
