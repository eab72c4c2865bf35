"""How laboratories record: what is no robot's must not pass for a cause, or is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import Block, Diagnosis, Options, Signal, diagnose
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array


def changed(
    blocks: Sequence[Block], name: str, how: Callable[[Array, Array], Array]
) -> list[Block]:
    """The blocks with other readings of an output, by its stamps since it began and readings."""
    out = []
    for b in blocks:
        s = b.outputs[name]
        out.append(replace(b, outputs={**b.outputs, name: replace(s, y=how(s.t - s.t[0], s.y))}))
    return out


def told(result: Diagnosis, *words: str) -> bool:
    return any(all(w in x for w in words) for x in result.warnings)


@pytest.mark.parametrize("step", [0.2, 0.4])
def test_what_a_coarse_sensor_rounds_is_no_cause(step: float) -> None:
    """Repeats are rounded alike, so that their scatter shows nothing of what is predicted from
    it.
    """
    blocks = changed(recordings(), "x", lambda t, y: step * np.round(y / step))
    assert diagnose(Toy(), blocks).verdict == "none"


def test_what_rests_on_samples_that_are_no_numbers_is_not_judged() -> None:
    """The toy takes them for 0."""
    blocks = recordings()
    broken = changed(blocks[:3], "x", lambda t, y: np.where((t > 1.0) & (t < 2.0), np.nan, y))
    problem = Problem(Toy(), [*broken, *blocks[3:]])
    for c in problem.cells:
        if problem.observables[c.observable].name == "f":
            inside = (c.t > 1.2) & (c.t < 1.8)
            assert problem.mask[c.start : c.stop][inside].any() == (c.block > 2)
    assert any("not judged" in x and "f (" in x for x in problem.warnings)
    assert diagnose(Toy(), [*broken, *blocks[3:]]).verdict == "none"


def test_a_signal_that_stops_is_told() -> None:
    blocks = recordings()
    s = blocks[0].outputs["x"]
    kept = (s.t < 1.0) | (s.t > 2.0)
    # alone: the toy reckons the force at the stamps of x
    short = replace(blocks[0], outputs={"x": Signal(s.t[kept], s.y[kept], "m")})
    short = replace(short, inputs={"u": Signal(s.t[kept], blocks[0].inputs["u"].y[kept], "m")})
    said = Problem(Toy(), [short, *blocks[1:]]).warnings
    assert any("x has no samples for a tenth" in w and "1 of 12" in w for w in said)
    assert not any("has no samples for a tenth" in w for w in Problem(Toy(), blocks).warnings)


def test_a_single_missing_sample_costs_nothing_else() -> None:
    def without(t: Array, y: Array) -> Array:
        return np.where(np.arange(t.size) % 50 == 7, np.nan, y)

    blocks = changed(recordings(), "x", without)
    problem = Problem(Toy(), blocks)
    own = problem.obs_of == 1
    assert np.mean(problem.mask[own]) > 0.97


def test_a_signal_that_comes_late_is_told() -> None:
    result = diagnose(Toy(), recordings(d=0.05), options=Options(only=("friction",)))
    assert result.verdict == "unknown"
    assert told(result, "x comes 0.0", "later than the nominal twin predicts")


def test_the_end_of_a_sensors_range_is_told() -> None:
    blocks = changed(recordings(), "x", lambda t, y: np.minimum(y, 0.5))
    result = diagnose(Toy(), blocks)
    assert result.verdict == "unknown"
    assert told(result, "x often stands at 0.5")


def test_blocks_that_begin_elsewhere_are_told() -> None:
    blocks = changed(recordings(), "x", lambda t, y: y + 0.8 * np.exp(-t / 0.1))
    result = diagnose(Toy(), blocks, options=Options(only=("friction",)))
    assert result.verdict == "unknown"
    assert told(result, "first tenth of the blocks")


def test_one_condition_alone_is_told() -> None:
    assert told(diagnose(Toy(), recordings(conditions=1)), "all blocks are of one condition")
    assert not told(diagnose(Toy(), recordings()), "all blocks are of one condition")


def test_what_a_tolerance_excuses_is_told() -> None:
    class Lenient(Toy):
        observables = tuple(
            replace(o, tolerance=0.5) if o.name == "f" else o for o in Toy.observables
        )

    result = diagnose(Lenient(), recordings(odd=0.2))
    assert result.verdict in ("none", "parameters")
    assert told(result, "what is left of f", "tolerance")
    assert not told(diagnose(Lenient(), recordings()), "what is left of f")
