"""What the answers to known cells teach: temperatures, scalings, and levels of credible sets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.optimize import minimize

from calibration.views import AS_SET, Answer, Factors, View, answer
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.numbers.learned import (
    Figures,
    Group,
    Learned,
    Reached,
    Scale,
    Sureness,
    Tempered,
)
from pianobot_ros.gap import Scaling
from pianobot_ros.gap.posterior.verdict import group_of
from pianobot_ros.gap.problem.constants import LEVEL
from pianobot_ros.gap.problem.options import Calibration
from pianobot_ros.piano.blind.reliability import calibration_error

__all__ = ["conformal", "fit", "gain_of", "learn"]

WIDTHS = (0.5, 1.0, 1.0, 1.0)
"""Prior standard deviations of ln power and of the three shifts (nats): as sure as the scores say,
within a factor of 1.6 in the power and 2.7 in the odds.
"""
LEAST = 1e-3
"""Probability of the truth below which it costs no more: no cell may decide alone."""
ENOUGH = 20
"""Views of a group that a threshold of its own needs (95 % of fewer is all of them)."""
GROUPS: tuple[Group, ...] = ("effect", "unknown", "quiet")
PARTS = 5
"""Parts of the cells that are left out in turn."""

REACHABLE = 0.999
"""Mass from which a set holds whatever has any probability."""
OCTAVE = math.log(2.0)
"""Prior standard deviation of the logarithm of a temperature's factor."""


def learn(by_factors: Mapping[Factors, Sequence[View]], set_: Calibration) -> Learned:
    """Temperatures of the two kinds of observable, scalings of the groups, each where it pays, and
    levels; with what they reach on these cells and on cells left out. `set_`: what the temperatures
    are factors of.
    """
    factors, tempered = tempering(by_factors)
    learned = learn_scalings(by_factors[factors])
    assert learned.reached is not None
    reached = learned.reached.model_copy(update={"temperatures": tempered})
    chosen = {"series": factors[0] * set_.temperature, "event": factors[1] * set_.event_temperature}
    return learned.model_copy(
        update={"temperatures": chosen if factors != AS_SET else {}, "reached": reached}
    )


def tempering(by_factors: Mapping[Factors, Sequence[View]]) -> tuple[Factors, Tempered]:
    """The likeliest factors, if these predict cells left out better than none by more than a
    standard error, and what they gain there.
    """
    tried = list(by_factors)
    losses = np.array([losses_of([answer(v, {}) for v in by_factors[f]]) for f in tried])
    cost = np.array([0.5 * sum((math.log(x) / OCTAVE) ** 2 for x in f) for f in tried])
    cells = np.array([v.cell for v in by_factors[AS_SET]])
    part = np.unique(cells, return_inverse=True)[1] % PARTS
    gains = np.zeros(cells.size)
    for k in range(PARTS):
        best = int(np.argmin(losses[:, part != k].sum(1) + cost))
        gains[part == k] = (losses[tried.index(AS_SET)] - losses[best])[part == k]
    gain, error = gain_of(gains, cells)
    chosen = tried[int(np.argmin(losses.sum(1) + cost))] if gain > error else AS_SET
    return chosen, Tempered(tried=tried, gain=round(gain, 3), gain_error=round(error, 3))


def learn_scalings(views: Sequence[View]) -> Learned:
    """Scalings of the groups where one pays, and levels, with what they reach on these cells and on
    cells left out.
    """
    cells = np.array([v.cell for v in views])
    group = np.array([v.group for v in views])
    start = [answer(v, {}) for v in views]
    left_out = predicted(views)
    gains = losses_of(start) - losses_of(left_out)
    # one cell has no standard error
    there: list[Group] = [g for g in GROUPS if len(set(cells[group == g])) > 1]
    paid = {g: gain_of(gains[group == g], cells[group == g]) for g in there}
    pays = [g for g, (gain, error) in paid.items() if gain > error]
    scalings = {g: scaling for g, scaling in fit(views).items() if g in pays}
    left_out = [x if v.group in pays else y for v, x, y in zip(views, left_out, start, strict=True)]
    here = [answer(v, scalings) for v in views]
    levels = levels_of(here)
    said = {g: [t for t, own in zip(start, group, strict=True) if own == g] for g in there}
    return Learned(
        scaling={g: scale_of(scaling) for g, scaling in scalings.items()},
        levels=levels,
        reached=Reached(
            views=len(views),
            groups={g: sureness(said[g], *paid[g]) for g in there},
            before=figures(start, {}),
            on_these_cells=figures(here, levels),
            each_cell_left_out=figures(left_out, {}),
        ),
    )


def scale_of(scaling: Scaling) -> Scale:
    """As it is written."""
    return Scale(**{n: round(x, 3) for n, x in asdict(scaling).items()})


def predicted(views: Sequence[View]) -> list[Answer]:
    """Answers by what the other parts of the cells tell, part by part."""
    part = np.unique([v.cell for v in views], return_inverse=True)[1] % PARTS
    known = [fit([v for v, p in zip(views, part, strict=True) if p != k]) for k in range(PARTS)]
    return [answer(v, known[p]) for v, p in zip(views, part, strict=True)]


def fit(views: Sequence[View]) -> dict[Group, Scaling]:
    """The likeliest scaling of each group that has enough views."""
    found: dict[Group, Scaling] = {}
    for group in GROUPS:
        own = [v for v in views if v.group == group]
        if len(own) >= ENOUGH:
            start = np.zeros(len(WIDTHS))
            found[group] = scaling_of(minimize(cost, start, (group, own), "L-BFGS-B").x)
    return found


def scaling_of(x: Array) -> Scaling:
    """Of ln power and three shifts (4,)."""
    return Scaling(float(np.exp(x[0])), *map(float, x[1:]))


def cost(x: Array, group: str, views: Sequence[View]) -> float:
    """Minus the log of prior and likelihood of a scaling."""
    given = [answer(v, {group: scaling_of(x)}) for v in views]
    return float(losses_of(given).sum() + 0.5 * np.sum((x / WIDTHS) ** 2))


def losses_of(given: Iterable[Answer]) -> Array:
    """Log loss of every view (views,)."""
    return np.array([-math.log(max(t.truth, LEAST)) for t in given])


def gain_of(gain: Array, cells: Array) -> tuple[float, float]:
    """Mean gain of the views, and its standard error: views of one cell go together."""
    each = np.array([gain[cells == c].sum() for c in np.unique(cells)])
    error = each.std(ddof=1) * math.sqrt(each.size) if each.size > 1 else math.inf
    return float(gain.mean()), float(error / gain.size)


def levels_of(given: Iterable[Answer]) -> dict[Group, float]:
    """Mass that a credible set must hold, by group of first answers."""
    given = list(given)
    groups = {g: [t.before for t in given if group_of(t.first) == g] for g in GROUPS}
    everyone = [t.before for t in given]
    return {g: conformal(own if len(own) >= ENOUGH else everyone) for g, own in groups.items()}


def sureness(given: Sequence[Answer], gain: float, error: float) -> Sureness:
    """How sure answers are, how often right, and what scaling them gains."""
    return Sureness(
        views=len(given),
        mean_probability=round(float(np.mean([t.probability for t in given])), 3),
        right=round(float(np.mean([t.right for t in given])), 3),
        gain=round(gain, 3),
        gain_error=round(error, 3),
    )


def figures(given: Sequence[Answer], levels: Mapping[Any, float]) -> Figures:
    """How good the answers are; `covered` by credible sets of these levels, else of 0.95."""
    held = [t.before < levels.get(group_of(t.first), LEVEL) for t in given]
    error = calibration_error([t.probability for t in given], [t.right for t in given])
    return Figures(
        mean_log_loss=round(float(losses_of(given).mean()), 3),
        right_first=round(float(np.mean([t.right for t in given])), 3),
        expected_calibration_error=round(error, 3),
        covered=round(float(np.mean(held)), 3),
    )


def conformal(needed: Iterable[float]) -> float:
    """Mass that a set must hold so that a further cell is covered with probability 0.95, were it
    drawn like these (split conformal prediction); never less than is promised, since other robots
    are not drawn like these.

    What too few cells tell, or no mass reaches since the truth had none, stays as it is promised: a
    set of all that is left would be larger and hold no more.
    """
    x = np.sort(np.asarray(list(needed), float))
    rank = math.ceil((x.size + 1) * LEVEL)
    level = float(x[rank - 1]) + 1e-3 if rank <= x.size else 1.0
    return round(max(level, LEVEL), 3) if level < REACHABLE else LEVEL
