"""Strikes that could be played next."""

from __future__ import annotations

from piano_twin_cases import record

from pianobot_ros.piano.gap.diagnosis.proposals import candidate_strikes
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
