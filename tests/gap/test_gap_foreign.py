"""Plants whose law is not the library's: a relative of a member is that member, another kind is
unknown, and neither is ever certain.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from gap_toy import Toy, recordings

from pianobot_ros.gap import Block, Diagnosis, Signal, diagnose


def plant(law: Callable[[np.ndarray, np.ndarray], np.ndarray], seed: int = 1) -> list[Block]:
    """Recordings of a robot whose force has one more term of position (m) and speed (m/s)."""
    out = []
    for b in recordings(seed, k=1.1, c=0.55):
        u, f = b.inputs["u"], b.outputs["f"]
        x = 1.1 * u.y
        more = law(x, np.gradient(x, u.t))
        out.append(replace(b, outputs={**b.outputs, "f": Signal(f.t, f.y + more, f.unit)}))
    return out


def probability(d: Diagnosis, name: str) -> float:
    return next(c.probability for c in d.candidates if c.name == name)


@pytest.mark.parametrize(
    ("member", "law"),
    [
        pytest.param("cubic", lambda x, v: 0.6 * x**3 / (1.0 + 0.6 * x**2), marks=pytest.mark.long),
        ("cubic", lambda x, v: 1.2 * x**3 / (1.0 + 0.6 * x**2)),
        pytest.param("friction", lambda x, v: 0.3 * np.tanh(v / 0.3), marks=pytest.mark.long),
        ("friction", lambda x, v: 0.3 * np.sign(v) * (1.0 - 0.25 * np.tanh(np.abs(v)))),
    ],
)
def test_a_bent_relative_is_the_member_or_may_be(member, law):
    d = diagnose(Toy(), plant(law))
    assert member in d.credible_set
    assert probability(d, member) > 0.2
    assert probability(d, "unknown") < 0.8


@pytest.mark.parametrize("law", [lambda x, v: 0.3 * np.sin(8 * x), lambda x, v: 0.3 * (x > 0.5)])
def test_another_kind_of_law_is_unknown_and_told_by_what_refitting_leaves(law):
    d = diagnose(Toy(), plant(law))
    assert d.verdict == "unknown"
    assert probability(d, "unknown") < 0.99
    assert d.unknown is not None
    assert d.unknown.stage == "force"


def test_strays_of_an_event_are_no_gap_that_a_law_leaves():
    rng = np.random.default_rng(3)
    blocks = [
        replace(b, events={"onset": b.events["onset"] + 0.001 * rng.standard_t(1.5)})
        for b in recordings(fc=0.1, n=24)
    ]
    d = diagnose(Toy(), blocks)
    assert [e.name for e in d.effects] == ["friction"]
    assert probability(d, "unknown") < 0.2
