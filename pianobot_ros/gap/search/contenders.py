"""What each step of the search asks of the hypotheses on the table: who leads, by how much, and
what is left open.
"""

from __future__ import annotations

import numpy as np

from pianobot_ros.gap.fitting.evidence import Evidence, open_observables
from pianobot_ros.gap.problem.constants import MUCH, SMALL
from pianobot_ros.gap.problem.twin.special_cases import special_cases
from pianobot_ros.gap.problem.types import Array
from pianobot_ros.gap.search.screening import relief, squared_gaps
from pianobot_ros.gap.search.study import Entry, Study, gaps, standing, stretched


def leaders(study: Study) -> list[Entry]:
    """Hypotheses with effects, best held-out score first; behind them those that are stretched."""
    there = (e for e in study.entries if e.effects)
    return sorted(there, key=lambda e: (stretched(study, e), -standing(study, e)))


def gain(study: Study, e: Entry) -> float:
    """Held-out score gained over refitting alone, in nats that count."""
    return standing(study, e) - standing(study, study.entry("parameters"))


def left(evidence: Evidence, e: Entry) -> float:
    """Squared gap above the floor's square, over all observables, that a hypothesis leaves."""
    return float(np.maximum(gaps(evidence, e) ** 2 - 1.0, 0.0).sum())


def leaves_much(study: Study, e: Entry) -> bool:
    """Whether a hypothesis leaves so much of what refitting leaves that others are looked for
    elsewhere, and that it matters little which is nearest.
    """
    whole = left(study, study.entry("parameters"))
    return not e.effects or left(study, e) > MUCH * whole


def special_cases_of(study: Study, e: Entry) -> list[Entry]:
    """The fitted hypotheses that are special cases of one, refitting alone among them."""
    cases = special_cases(study.problem.effects, e.effects)
    return [s for s in study.entries if s.name != "none" and frozenset(s.effects) in cases]


def open_further(evidence: Evidence, prediction: Array) -> bool:
    """Whether a prediction leaves enough open that a further effect, or a better fit, is worth
    looking for.
    """
    size = evidence.options.calibration.further
    return bool(open_observables(evidence, prediction, size, sigma=0.0))


def out_of_reach(study: Study, gained: float) -> bool:
    """Whether a hypothesis need not be looked at any closer: the best one leaves nothing open, and
    gains far more.
    """
    best = next(iter(leaders(study)), None)
    return (
        best is not None
        and not open_further(study, best.held_out)
        and gained < SMALL * gain(study, best)
    )


def relieves(evidence: Evidence, before: Array, after: Array) -> bool:
    """Whether a prediction relieves any observable that another leaves open: what gains only within
    the floor is never named, so it need not be looked at any closer. So it does where none is open.
    """
    wide = open_observables(evidence, before)
    gone = relief(*(squared_gaps(evidence.gauge, x) for x in (before, after)))
    return not wide or bool(np.any(gone[wide] > SMALL))
