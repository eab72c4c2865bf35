"""Calls of the twin, of which any may fail."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.errors import GapError, SimulationFailed
from pianobot_ros.gap.problem.types import Array, Block, Signal, Twin

__all__ = ["Raw", "Request", "copies", "refuse_changed", "simulated", "simulated_many"]

Request: TypeAlias = tuple[Mapping[str, float], tuple[str, ...]]
"""Values of parameters by name, and the effects that are added."""
Raw: TypeAlias = "Sequence[Mapping[str, object]] | SimulationFailed"
"""What a twin gives back, a prediction for each block."""


def simulated(twin: Twin, blocks: Sequence[Block], request: Request) -> Raw:
    """One call of the twin; whatever it throws concerns only this candidate."""
    values, effects = request
    try:
        return twin.simulate(blocks, dict(values), tuple(effects))
    except GapError:
        raise
    except Exception as error:  # a user's simulator may fail in any way
        return SimulationFailed(f"{type(error).__name__}: {error}")


def simulated_many(
    twin: Twin,
    blocks: Sequence[Block],
    requests: Sequence[Request],
    budget: Budget,
    jobs: int,
    backend: str | None,
) -> list[Raw]:
    """Several calls of the twin: at once where it can, else in parallel in so many `jobs`."""
    many = getattr(twin, "simulate_many", None)
    if many is not None and len(requests) > 1:
        try:
            return list(many(blocks, [(dict(v), e) for v, e in requests]))
        except GapError:
            raise
        except Exception as error:  # perhaps of one member: find out which below
            budget.failed(f"{type(error).__name__}: {error}")
    if jobs > 1 and len(requests) > 1:
        from joblib import Parallel, delayed, parallel_config

        work = (delayed(simulated)(twin, blocks, r) for r in requests)
        with parallel_config(backend=backend, n_jobs=jobs):  # unlike Parallel(…), knows Dask
            return list(Parallel()(work))
    return [simulated(twin, blocks, r) for r in requests]


def copies(blocks: Sequence[Block]) -> list[Array]:
    """What was recorded (n,) each, to be compared with what a twin leaves of it."""
    return [s.y.copy() for _, s in _recorded(blocks)]


def refuse_changed(blocks: Sequence[Block], before: Sequence[Array]) -> None:
    """Raise GapError where the twin has written into what was recorded, `before` (n,) each."""
    for (name, s), y in zip(_recorded(blocks), before, strict=True):
        if not np.array_equal(s.y, y, equal_nan=True):
            raise GapError(f"simulate changed {name}: let it work on a copy")


def _recorded(blocks: Sequence[Block]) -> list[tuple[str, Signal]]:
    """What was recorded, with what it is called."""
    inputs = [(f"input {n} of block {b.name}", s) for b in blocks for n, s in b.inputs.items()]
    return inputs + [(f"{n} of block {b.name}", s) for b in blocks for n, s in b.outputs.items()]
