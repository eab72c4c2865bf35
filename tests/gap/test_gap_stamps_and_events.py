"""What a recording says of its session's clock and of events that did not happen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import Block, Signal, diagnose
from pianobot_ros.gap.floor.session.courses import find_drift
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Problem


def run_on(blocks: Sequence[Block], seconds: float = 5.0) -> list[Block]:
    """The same blocks with stamps that run on through the session."""

    def late(signals: Mapping[str, Signal], by: float) -> dict[str, Signal]:
        return {n: Signal(s.t + by, s.y, s.unit) for n, s in signals.items()}

    return [
        replace(b, inputs=late(b.inputs, seconds * i), outputs=late(b.outputs, seconds * i))
        for i, b in enumerate(blocks)
    ]


@pytest.mark.parametrize("n", [2, 6])
def test_stamps_that_start_anew_leave_only_the_order_of_blocks(n: int) -> None:
    anew, on = Problem(Toy(), recordings(n=n)), Problem(Toy(), run_on(recordings(n=n)))
    assert not anew.on_session_clock
    assert on.on_session_clock
    assert np.all(np.diff(anew.start_of_block) > 0)
    np.testing.assert_allclose(np.diff(on.start_of_block), 5.0)
    assert any("only the order" in w for w in anew.warnings)
    assert not any("only the order" in w for w in on.warnings)


@pytest.mark.parametrize("outputs_too", [False, True])
def test_inputs_that_are_stamped_in_other_units_are_told(outputs_too: bool) -> None:
    def in_milliseconds(signals: Mapping[str, Signal]) -> dict[str, Signal]:
        return {n: Signal(1e3 * s.t, s.y, s.unit) for n, s in signals.items()}

    blocks = [
        replace(b, inputs=in_milliseconds(b.inputs), outputs=in_milliseconds(b.outputs))
        if outputs_too
        else replace(b, inputs=in_milliseconds(b.inputs))
        for b in recordings(n=3)
    ]
    told = any("u and " in w and "in seconds" in w for w in Problem(Toy(), blocks).warnings)
    assert told is not outputs_too


def test_pieces_that_overlap_a_little_are_on_one_clock() -> None:
    assert Problem(Toy(), run_on(recordings(n=6), seconds=3.0)).on_session_clock


class Past(Toy):
    """A twin that is told what was commanded some time before a block."""

    def simulate(self, blocks, values, effects):
        own = []
        for b in blocks:
            t, u = b.outputs["x"].t, b.inputs["u"]
            own.append(replace(b, inputs={"u": Signal(t, np.interp(t, u.t, u.y))}))
        return super().simulate(own, values, effects)


def test_an_input_that_begins_in_the_block_before_is_on_one_clock() -> None:
    blocks = []
    for b in run_on(recordings(n=6)):
        t = np.arange(b.inputs["u"].t[0] - 8.0, b.inputs["u"].t[-1], 0.01)
        blocks.append(replace(b, inputs={"u": Signal(t, np.sin(t))}))
    problem = Problem(Past(), blocks)
    assert problem.on_session_clock
    np.testing.assert_allclose(np.diff(problem.start_of_block), 5.0)


@pytest.mark.parametrize("in_order", [False, True])
def test_repeats_that_are_driven_differently_do_not_drift(in_order: bool) -> None:
    """A parameter that is wrong all the time changes repeats that are driven differently by
    different amounts: that is no course over the session, whatever its stamps say.
    """
    blocks = recordings(3, 24, c=0.7)
    rng = np.random.default_rng(0)
    driven = []
    for b in blocks:
        size = 1.0 + 0.2 * rng.normal()
        outputs = {n: Signal(s.t, size * s.y, s.unit) for n, s in b.outputs.items()}
        inputs = {n: Signal(s.t, size * s.y, s.unit) for n, s in b.inputs.items()}
        driven.append(replace(b, inputs=inputs, outputs=outputs))
    problem = Problem(Toy(), run_on(driven) if in_order else driven)
    base = problem.predict(problem.nominal(), ())
    columns = [
        problem.predict(problem.nominal() | {p.name: p.nominal * 1.01}, ()) - base
        for p in problem.parameters
    ]
    share = Options().calibration.material_share
    assert find_drift(problem, problem.y - base, np.column_stack(columns), share) is None


class Grazing(Toy):
    """An onset that happens only where the amplitude k reaches what a block needs."""

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Any]]:
        out = super().simulate(blocks, values, effects)
        for block, prediction in zip(blocks, out, strict=True):
            if values["k"] < block.attributes["needs"]:
                prediction["onset"] = float("nan")
        return out


def grazing(n: int) -> list[Block]:
    """24 blocks of a robot whose k is 0.95, of which `n` barely reach their onset."""
    blocks = recordings(2, 24, k=0.95)
    return [
        replace(b, attributes={"needs": 0.97 if i < n else 0.0}, events={"onset": 0.3 + 0.01 * i})
        if i < n
        else replace(b, attributes={"needs": 0.0})
        for i, b in enumerate(blocks)
    ]


def test_an_event_that_parameters_within_their_errors_make_vanish_is_not_judged() -> None:
    d = diagnose(Grazing(), grazing(3))
    assert any("predicts no onset in 3 of 24 blocks" in w for w in d.warnings)
    assert d.verdict == "parameters"


def test_many_events_that_vanish_are_a_gap() -> None:
    d = diagnose(Grazing(), grazing(12))
    assert not any("predicts no onset" in w for w in d.warnings)
    onset = next(row for row in d.signals if row.name == "onset")
    assert onset.gap > 1.5


def test_events_that_did_not_happen_are_said_and_count() -> None:
    blocks = [replace(b, events={"onset": float("nan")}) for b in recordings(n=6)]
    d = diagnose(Toy(), [*blocks, *recordings(5, n=12)])
    assert any("onset did not happen (NaN) in 6 of 18 blocks" in w for w in d.warnings)
    assert d.verdict == "unknown"
    assert "onset" in d.sentence
    missing = [replace(b, events={}) for b in blocks]
    d = diagnose(Toy(), [*missing, *recordings(5, n=12)])
    assert d.verdict == "none"
    assert not any("did not happen" in w for w in d.warnings)
