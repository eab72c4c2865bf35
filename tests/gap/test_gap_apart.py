"""What repeats differ by because of an effect of the library is no scatter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from gap_toy import Toy, recordings

from pianobot_ros.gap import Block, Diagnosis, Effect, Parameter, Signal, diagnose


class Geared(Toy):
    """The toy with a gear, whose ripple goes with an angle that is measured, and that each motion
    begins with as the one before has left it; in a wind that is measured, another one each time.
    """

    effects = (
        *Toy.effects,
        Effect(
            "ripple",
            "force",
            (Parameter("a", 0, 0, 1, "N", sd=0.1), Parameter("phase", 0, -7, 7, "rad", sd=2)),
            [{"a": 0.1, "phase": x} for x in (0.0, 1.57, 3.14, -1.57)],
        ),
        Effect("draught", "force", (Parameter("w", 0, -1, 1, "N", sd=0.1),), [{"w": 0.1}]),
    )

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, object]]:
        out = super().simulate(blocks, values, effects)
        for b, prediction in zip(blocks, out, strict=True):
            if "ripple" in effects:
                angle = b.inputs["angle"].y
                prediction["f"] = prediction["f"] + values["a"] * np.sin(angle + values["phase"])
            if "draught" in effects:
                prediction["f"] = prediction["f"] + values["w"] * b.inputs["wind"].y
        return out


def geared(a: float, w: float = 0.0, **more: float) -> Diagnosis:
    """Of a gear whose ripple is no pure sine, repeats of which begin at another angle each, and of
    a draught that is not quite in proportion to the wind.
    """
    rng, blocks = np.random.default_rng(4), []
    for b in recordings(5, **more):
        f = b.outputs["f"]
        angle = rng.uniform(0.0, 6.0) + 5.0 * (f.t - f.t[0]) ** 0.8
        ripple = a * (np.sin(angle + 0.8) + 0.2 * np.sin(2.0 * angle))
        wind = rng.uniform(-1.0, 1.0) + 0.5 * np.sin(f.t - f.t[0] + rng.uniform(0.0, 6.0))
        push = w * wind * (1.0 + 0.1 * np.abs(wind))
        blocks.append(
            replace(
                b,
                inputs={**b.inputs, "angle": Signal(f.t, angle), "wind": Signal(f.t, wind)},
                outputs={**b.outputs, "f": Signal(f.t, f.y + ripple + push, "N")},
            )
        )
    return diagnose(Geared(), blocks)


def test_an_effect_that_sets_repeats_apart_is_no_scatter() -> None:
    found = geared(0.15)
    assert [e.name for e in found.effects] == ["ripple"]
    assert any("repeats differ in f by what ripple explains" in w for w in found.warnings)


def test_it_is_found_beside_one_that_does_not() -> None:
    assert {e.name for e in geared(0.15, d=0.03).effects} == {"ripple", "delay"}


def test_two_of_which_neither_makes_most_of_what_sets_repeats_apart_are_no_scatter() -> None:
    found = geared(0.15, w=0.15)
    assert {e.name for e in found.effects} == {"ripple", "draught"}
    assert any("repeats differ in f by what" in w for w in found.warnings)


def test_without_it_the_floor_is_what_it_was() -> None:
    found = geared(0.0)
    assert found.verdict == "none"
    assert not any("explains" in w for w in found.warnings)
