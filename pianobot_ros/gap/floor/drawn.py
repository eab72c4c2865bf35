"""Repeats that are drawn where none were recorded.

A prediction is made from what was measured upstream, so it repeats no better than that: the noise
of an encoder goes through the twin's belt and comes out slower, larger and correlated. Second
differences of the residual see its fast part alone. What the rest amounts to needs no repeats: the
noise of each measured signal is drawn anew, the twin predicts once more, and what changes is what
one repeat would have differed by (propagation of distributions by a Monte Carlo method, JCGM
101:2008, 5.9). What a repeat differs by in the machine itself, no draw can tell.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.problem.errors import SimulationFailed
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array, Block, Signal

__all__ = ["drawn"]


def drawn(
    problem: Problem, white: Mapping[str, float], values: Mapping[str, float]
) -> Array | None:
    """By how much residuals (size,) change with noise drawn anew, `white` RMS by measured signal,
    by these `values` of the parameters; None if the twin cannot simulate that.
    """
    rng = np.random.default_rng(0)
    blocks = [_noisy(b, white, rng) for b in problem.blocks]
    measured = {o.name: o.signal for o in problem.observables if o.kind == "series"}
    read = [
        {name: b.outputs[s].y for name, s in measured.items() if s in b.outputs} for b in blocks
    ]
    try:
        change = problem.predict_instead(blocks, values) - problem.predict(values, ())
    except SimulationFailed:
        return None
    noise = problem.flattened(read) - problem.y
    return np.where(problem.mask & np.isfinite(noise), noise - change, 0.0)


def _noisy(block: Block, white: Mapping[str, float], rng: np.random.Generator) -> Block:
    outputs = {
        name: Signal(s.t, s.y + white.get(name, 0.0) * rng.standard_normal(s.y.size), s.unit)
        for name, s in block.outputs.items()
    }
    return replace(block, outputs=outputs)
