"""Where a diagnosis begins: twin and blocks together, the nominal prediction and its floor."""

from __future__ import annotations

from collections.abc import Sequence

from pianobot_ros.gap.fitting.evidence import Evidence
from pianobot_ros.gap.fitting.fit import Fitter
from pianobot_ros.gap.fitting.score import folds_of
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.floor.splice import passed_on
from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.errors import SimulationFailed
from pianobot_ros.gap.problem.intake import blocks_that
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Block, Twin
from pianobot_ros.gap.search.parameters import estimated

__all__ = ["open_evidence"]


def open_evidence(
    twin: Twin, blocks: Sequence[Block], seed: int, budget: Budget, jobs: int, options: Options
) -> Evidence:
    """The problem, and the floor by what the nominal twin leaves. Raises GapError for options that
    do not fit the twin, or a twin that does not fit the blocks.
    """
    problem = _problem(twin, blocks, budget, jobs, options).asking(options.only)
    problem = problem.recentred(problem.nominal())
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

    def made(some: Sequence[Block]) -> Problem:
        return Problem(
            twin,
            some,
            min_units=options.min_units,
            jobs=jobs,
            backend=options.backend,
            max_samples=options.max_samples,
            budget=budget,
        )

    try:
        return made(blocks)
    except SimulationFailed:
        nominal = {p.name: p.nominal for p in twin.parameters}
        kept, said = blocks_that(lambda b: twin.simulate([b], nominal, ()), blocks)
        return made(kept).telling(said)
