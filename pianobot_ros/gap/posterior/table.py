"""The table of hypotheses with what they weigh, its probabilities by name, and how sure to be.

How sure an answer is goes by its own group, since what makes answers of a group wrong is its own
affair: a named effect may be a foreign cause that looks like it, wrong parameters may hide a weak
effect. So the log odds of the table are scaled and shifted by group of first answers: vector
scaling (Guo, Pleiss, Sun and Weinberger 2017), with what `benchmarks/calibrate.py` learned.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.gap.posterior.verdict import group_of
from pianobot_ros.gap.problem.options import Calibration, Scaling
from pianobot_ros.gap.problem.types import Array

__all__ = [
    "Table",
    "first_of",
    "inclusion",
    "likeliest",
    "masses_of",
    "recalibrated",
    "scaled",
    "surest",
]

PLAIN = ("none", "parameters")


@dataclass(frozen=True)
class Table:
    """`weight` (m,) of hypotheses and `unknown`, which add up to 1; `names` of each one's effects,
    or its own; `hidden`: odds, against "parameters", of effects that may hide behind them;
    `library`: all effects that could be named.
    """

    names: tuple[tuple[str, ...], ...]
    weight: Array
    unknown: float
    hidden: Mapping[str, float]
    library: tuple[str, ...]


def masses_of(table: Table) -> dict[str, float]:
    """Probability by name; a pair's is shared between its members, and effects that may hide share
    that of "parameters".
    """
    masses = {"none": 0.0, "parameters": 0.0, "unknown": table.unknown}
    masses |= dict.fromkeys(table.library, 0.0)
    for names, w in zip(table.names, table.weight, strict=True):
        for name in names:
            masses[name] += float(w) / len(names)
    masses["parameters"] /= 1.0 + sum(table.hidden.values())
    for name, own in table.hidden.items():
        masses[name] += masses["parameters"] * own
    return masses


def inclusion(table: Table, name: str) -> float:
    """Probability that an effect is at work, alone or with others; of any other name its own."""
    beside = sum(
        float(w) * (1.0 - 1.0 / len(names))
        for names, w in zip(table.names, table.weight, strict=True)
        if name in names
    )
    return masses_of(table).get(name, 0.0) + beside


def first_of(masses: Mapping[str, float]) -> str:
    """The likeliest name."""
    return max(masses, key=lambda name: masses[name])


def likeliest(hypotheses: Sequence[tuple[Sequence[str], float]]) -> set[str]:
    """The effects of that hypothesis which is reached by choosing one after the other, by what all
    `hypotheses` (effects, weight) that have those chosen already weigh: the likeliest effect, and a
    further one as long as it is likelier that there is one, whichever it is, than that there is
    none. Empty where there is no hypothesis.

    The heaviest hypothesis would have too few effects: of what a second one may be there are many,
    which share its weight (as inclusion probabilities; Barbieri and Berger 2004, Annals of
    Statistics 32).
    """
    chosen = set[str]()
    while True:
        beside = [(effects, w) for effects, w in hypotheses if chosen < set(effects)]
        alone = [w for effects, w in hypotheses if chosen == set(effects)]
        if not beside or (alone and sum(alone) >= sum(w for _, w in beside)):
            return chosen
        mass = Counter[str]()
        for effects, w in beside:
            mass.update({n: w for n in effects if n not in chosen})
        chosen.add(mass.most_common(1)[0][0])


def recalibrated(table: Table, calibration: Calibration) -> Table:
    """The table as sure as answers like its first one were right."""
    scaling = calibration.scaling.get(group_of(first_of(masses_of(table))))
    return table if scaling is None else scaled(table, scaling)


def scaled(table: Table, scaling: Scaling) -> Table:
    """Log odds times a power, and moved towards *unknown*, what has no effect, and what hides."""
    quiet = np.array([names[0] in PLAIN for names in table.names])
    weight = table.weight**scaling.power * np.exp(np.where(quiet, scaling.quiet, 0.0))
    unknown = table.unknown**scaling.power * np.exp(scaling.unknown)
    total = float(weight.sum() + unknown)
    hidden = {n: float(own * np.exp(scaling.hidden)) for n, own in table.hidden.items()}
    return replace(table, weight=weight / total, unknown=float(unknown / total), hidden=hidden)


def surest(calibration: Calibration) -> float:
    """Probability of an effect that explains all there is and that no other could be."""
    alone = Table((("it",),), np.array([1.0 - calibration.mimic]), calibration.mimic, {}, ("it",))
    return masses_of(recalibrated(alone, calibration))["it"]
