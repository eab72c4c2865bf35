"""Strikes that could be played next."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from piano_twin_cases import record

from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.piano.gap.diagnosis.proposals import candidate_strikes
from pianobot_ros.piano.gap.evidence.blocks import DRIVEN
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin


def test_proposals_can_be_simulated() -> None:
    twin = PianoTwin([record(strikes=8)])
    blocks = candidate_strikes(twin, count=3)
    assert len(twin.blocks) == 8
    nominal = {p.name: p.nominal for p in twin.parameters}
    for block, prediction in zip(blocks, twin.simulate(blocks, nominal, ()), strict=True):
        for observable in twin.observables:
            if observable.kind == "series" and observable.signal in block.outputs:
                assert len(prediction[observable.name]) == block.outputs[observable.signal].t.size  # type: ignore[arg-type]


def test_proposals_reach_what_the_arm_may_do() -> None:
    twin = PianoTwin([record(strikes=8)])
    offered = [b.attributes for b in candidate_strikes(twin)]
    assert all(set(DRIVEN) <= set(a) for a in offered)
    limits = wrist_limits()
    share = [a["speed"] / limits.fastest(a["depth"] + 0.005) for a in offered]
    assert 0.85 < max(share) <= 1.0
    for name, low, high in (("depth", 0.0095, 0.0195), ("hold", 0.12, 1.7), ("speed", 0.06, 0.3)):
        values = sorted(a[name] for a in offered)
        assert values[0] < low and values[-1] > high
        assert max(b - a for a, b in pairwise(np.log(values))) < 0.5  # no gap between the ends
    assert {a["pressure"] for a in offered} == {0.0, -50e3, -100e3}
