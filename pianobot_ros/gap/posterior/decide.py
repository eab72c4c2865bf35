"""From probabilities to a verdict, and the hypothesis that it rests on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pianobot_ros.gap.diagnosis import Verdict
from pianobot_ros.gap.fitting.score import difference
from pianobot_ros.gap.posterior.judge import alone, surely_better
from pianobot_ros.gap.posterior.probabilities import Posterior
from pianobot_ros.gap.posterior.verdict import credible_set, level_of
from pianobot_ros.gap.search.study import Entry, Study, standing, temperatures, tempered

__all__ = ["Judgement", "decide"]


@dataclass(frozen=True)
class Judgement:
    """`sure`: probability of the verdict, of an effect with all that cannot be told from it;
    `best`: the hypothesis that it rests on; `ranked`: names with their probabilities, those of the
    verdict first; `inseparable`: groups of names that the data cannot tell apart.
    """

    verdict: Verdict
    sure: float
    best: Entry
    ranked: tuple[tuple[str, float], ...]
    credible: tuple[str, ...]
    inseparable: tuple[tuple[str, ...], ...]

    @property
    def named(self) -> tuple[str, ...]:
        """Effects of the verdict, strongest first."""
        if self.verdict != "effect":
            return ()
        return tuple(n for n, _ in self.ranked if n in self.best.effects)


def decide(found: Posterior) -> Judgement:
    """What is likeliest: an effect (with all that cannot be told from it), wrong parameters,
    nothing, or a cause that the library lacks.
    """
    study, best, masses, named = found.study, found.best, found.masses, found.named
    # What single effects do alone says nothing of those that are named together.
    alone_named = named is not None and len(named.effects) == 1
    may = found.admission.possible if alone_named else found.admission.admits
    single = [e for e in study.entries if len(e.effects) == 1 and may(e)]
    inseparable = _inseparable(study, single)
    own = set(named.effects) if named else set()
    candidates = own.union(*(g for g in inseparable if set(g) & own))
    totals: dict[Verdict, float] = {
        "effect": sum(masses[n] for n in sorted(candidates)),
        "parameters": masses["parameters"],
        "none": masses["none"],
        "unknown": found.table.unknown,
    }
    hidden = sum(masses[n] for n in found.table.hidden if n not in candidates)
    verdict = max(totals, key=lambda k: totals[k] + hidden * (k == "parameters"))
    if verdict == "effect" and named is not None:
        best = named
    if verdict in ("parameters", "none"):
        best = study.entry(verdict)
    ranked = sorted(masses.items(), key=lambda kv: -kv[1])
    if verdict == "effect":
        lead = sorted(best.effects, key=lambda n: (-alone(study, n), -masses[n]))
        ranked = [(n, masses[n]) for n in lead] + [kv for kv in ranked if kv[0] not in lead]
    names, probabilities = [n for n, _ in ranked], [p for _, p in ranked]
    credible = credible_set(names, probabilities, level_of(study.options.calibration, names[0]))
    shown = {*credible, *best.effects}
    return Judgement(
        verdict,
        totals[verdict],
        best,
        tuple(ranked),
        credible,
        tuple(g for g in inseparable if set(g) & shown),
    )


def _inseparable(study: Study, single: Sequence[Entry]) -> tuple[tuple[str, ...], ...]:
    """Groups of names that the data cannot tell apart: the scores of these hypotheses, in nats that
    count, tie within one standard error, or a nat, and not since each explains what the other does
    not.
    """
    entries = sorted(single, key=lambda e: -standing(study, e))
    scores = {e.name: tempered(study, e) for e in entries}
    out: list[tuple[str, ...]] = []
    taken: set[str] = set()
    for i, e in enumerate(entries):
        if e.name in taken:
            continue
        group = [e.name]
        for other in entries[i + 1 :]:
            gain, se = difference(study.problem, scores[e.name], scores[other.name])
            if gain < max(se, 1.0) and not _in_turn(study, e, other):
                group.append(other.name)
        if len(group) > 1:
            out.append(tuple(group))
            taken |= set(group)
    return tuple(out)


def _in_turn(study: Study, a: Entry, b: Entry) -> bool:
    """Whether each of two hypotheses surely predicts some observable better than the other does, by
    more than a nat.
    """
    more = ((a.scored.each - b.scored.each) / temperatures(study)).sum(0)
    return bool(
        np.any(surely_better(study, b, a) & (more > 1.0))
        and np.any(surely_better(study, a, b) & (more < -1.0))
    )
