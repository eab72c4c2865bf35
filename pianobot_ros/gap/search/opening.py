"""Where a diagnosis begins: twin and blocks together, the nominal prediction and its floor, anew
where recordings turn out to be accidents; and where its search does, at combinations of effects
that a twin has reason to try.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.gap.fitting.evidence import Evidence, told
from pianobot_ros.gap.fitting.fit import Fitter
from pianobot_ros.gap.fitting.score import folds_of
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.splice import passed_on
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.constants import NEGLIGIBLE
from pianobot_ros.gap.problem.errors import GapError, SimulationFailed
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.recordings.intake import blocks_that
from pianobot_ros.gap.problem.types import Block, Effect, Twin
from pianobot_ros.gap.search.contenders import open_further
from pianobot_ros.gap.search.parameters import estimated
from pianobot_ros.gap.search.study import Entry, Study, affords, make_entry, put

__all__ = ["never_vanishing", "not_vanishing", "open_evidence", "try_guesses", "without_accidents"]


def open_evidence(
    twin: Twin, blocks: Sequence[Block], seed: int, budget: Budget, jobs: int, options: Options
) -> Evidence:
    """The problem, and the floor by what the nominal twin leaves. Raises GapError for options that
    do not fit the twin, or a twin that does not fit the blocks.
    """
    if isinstance(blocks, Block):
        raise GapError("the recording is one Block: give a list, [block]")
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise GapError(f"the seed is {seed!r}; give a whole number, 0 or more")
    blocks = tuple(blocks)
    for k, b in enumerate(blocks):
        if not isinstance(b, Block):
            raise GapError(f"block {k} is a {type(b).__name__}: give a list of Block")
    problem = _problem(twin, blocks, budget, jobs, options).asking(options.only)
    return _opened(problem.recentred(problem.nominal()), options, seed)


def never_vanishing(evidence: Evidence) -> list[str]:
    """What is said of effects that do not vanish at their null, asked of the first block alone: to
    ask all would cost a screening.
    """
    problem, out = evidence.problem, []
    first, nominal = {0: problem.blocks[0]}, problem.nominal()
    for effect in problem.effects.values():
        if effect.remainder is not None:
            continue
        vanished = nominal | effect.shrunk(effect.starts[0], 0.0)
        at_null = problem.predict_blocks(first, vanished, (effect.name,))
        if not isinstance(at_null, Exception):
            change = np.where(problem.block_of == 0, at_null - evidence.nominal, 0.0)
            floors = np.nan_to_num(evidence.gauge.gaps(problem.y + change))
            out += [not_vanishing(effect)] if floors.max() > NEGLIGIBLE else []
    return out


def not_vanishing(effect: Effect) -> str:
    """What is said of an effect that does not vanish at its null."""
    return (
        f"{effect.name} does not vanish where {effect.magnitude} is {effect.null:g}: it must,"
        " whatever its other parameters (Effect.magnitude says which parameter is its size)"
    )


def without_accidents(evidence: Evidence, study: Study) -> Evidence:
    """The evidence from which `study` came, without the recordings that are far further from what
    its best hypothesis predicts than all others: so few as chance brings are accidents, which
    nothing need explain. Itself where there are none.

    Which of some repeats are strays is known from the start (`scatter.py`). Of a recording that
    nothing repeats only hypotheses tell, since an effect may show in a single one.
    """
    problem, gauge = study.problem, study.gauge
    squares = gauge.squares(min(study.entries, key=lambda e: e.gap).held_out)
    far = gauge.strays(squares) & ~gauge.more_strays_than_chance(squares)
    cells = [c for o in problem.present for c in problem.cells_of(o) if far[c.block, o]]
    if not cells:
        return evidence
    said = (
        "far further from what the best hypothesis predicts than all other recordings, which is an"
        " accident unless it comes back when it is recorded again"
    )
    return _opened(evidence.problem.without(cells, said), evidence.options, evidence.seed)


def _opened(problem: Problem, options: Options, seed: int) -> Evidence:
    """The evidence of a problem, by what the nominal twin leaves."""
    nominal = problem.predict(problem.nominal(), ())
    problem, found = estimated(problem, problem.y - nominal, options, problem.nominal())
    noise = passed_on(NoiseModel(problem, options, found), problem.nominal())
    return Evidence(
        problem,
        options,
        seed,
        folds_of(problem, options.folds, seed),
        nominal,
        Fitter(problem, noise),
        Gauge(problem, noise),
        tuple(problem.warnings),
    )


def _problem(
    twin: Twin, blocks: Sequence[Block], budget: Budget, jobs: int, options: Options
) -> Problem:
    """The problem of the blocks that the twin can simulate."""
    try:
        return Problem(twin, blocks, options, jobs, budget)
    except SimulationFailed:
        budget.failures, budget.last_failure = 0, ""  # told of the blocks instead
        nominal = {p.name: p.nominal for p in twin.parameters}
        kept, said = blocks_that(
            lambda b: twin.simulate([b], nominal, ()), blocks, twin.observables
        )
        return Problem(twin, kept, options, jobs, budget).telling(said)


def try_guesses(study: Study) -> Study:
    """The study with the twin's `guesses` (if it has any), fitted one after the other while the
    best of them leaves something open.

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
        if not affords(study):
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
