"""Cutting recordings into strikes, whatever is missing in them, and what the twin then predicts."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from piano_twin_cases import record

from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.gap import Twin
from pianobot_ros.piano.gap.evidence.blocks import prepare
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin


def without(recording: Recording, *prefixes: str) -> Recording:
    return replace(
        recording,
        signals={k: v for k, v in recording.signals.items() if not k.startswith(prefixes)},
    )


def test_nominal_twin_reproduces_the_nominal_cell() -> None:
    """The plant is a second implementation of the same nominal cell: what is left is noise and
    repeatability.
    """
    twin = PianoTwin([record()])
    assert isinstance(twin, Twin)
    predictions = twin.simulate(twin.blocks, {p.name: p.nominal for p in twin.parameters}, ())
    for name, share in (
        ("wrist.z", 0.01),
        ("force", 0.03),
        ("angle", 0.01),
        ("angle | measured force", 0.02),
    ):
        signal = next(o.signal for o in twin.observables if o.name == name)
        real = np.concatenate([b.outputs[signal].y for b in twin.blocks])
        sim = np.concatenate([np.asarray(p[name]) for p in predictions])
        assert np.sqrt(np.mean((real - sim) ** 2)) < share * np.ptp(real), name


def test_repeats_share_rollouts_without_changing_predictions() -> None:
    twin, plain = PianoTwin([record()]), PianoTwin([record()])
    plain.rollouts.shared = {}
    assert len(twin.rollouts.shared) > len(twin.blocks) // 2
    values = {p.name: p.nominal for p in twin.parameters} | {
        "joint_stiffness": 1.2,
        "key_friction": 0.03,
    }
    shared, exact = (t.simulate(t.blocks, values, ("key_friction",)) for t in (twin, plain))
    nominal = plain.simulate(plain.blocks, {p.name: p.nominal for p in twin.parameters}, ())

    def rms(a: list[Any], b: list[Any]) -> float:
        differences = [
            np.asarray(x["force"]) - np.asarray(y["force"]) for x, y in zip(a, b, strict=True)
        ]
        return float(np.sqrt(np.mean(np.concatenate(differences) ** 2)))

    assert rms(shared, exact) < 0.05 * rms(nominal, exact)


@pytest.mark.parametrize(
    ("missing", "lost"),
    [
        (("real/key_angle",), "angle"),
        (("real/fsr",), "force"),
        (("real/vacuum", "command/vacuum"), "pressure"),
        (("real/wrist",), "wrist.z"),
        (("command/wrist",), "wrist.z"),
    ],
)
def test_missing_signals_cost_only_what_needs_them(missing: tuple[str, ...], lost: str) -> None:
    twin = PianoTwin([without(record(strikes=8), *missing)])
    assert len(twin.blocks) == 8
    assert all(lost not in b.outputs for b in twin.blocks)
    predictions = twin.simulate(twin.blocks, {p.name: p.nominal for p in twin.parameters}, ())
    assert all(np.isfinite(p.get("note.count", 1.0)) for p in predictions)
    for name in ("wrist_delay", "key_friction", "clock_skew", "midi_latency", "fsr_creep"):
        values = {p.name: p.nominal for p in twin.parameters}
        values |= {p.name: p.nominal for e in twin.effects if e.name == name for p in e.parameters}
        if name in {e.name for e in twin.effects}:
            twin.simulate(twin.blocks, values, (name,))


def test_strikes_are_found_without_marks() -> None:
    full = record(strikes=8)
    twin = PianoTwin([replace(full, strikes=[])])
    assert len(twin.blocks) == 8
    assert {b.data.mark.note for b in twin.blocks} == {64}
    assert {b.data.mark.finger for b in twin.blocks} == {"middle"}
    assert any("/command/strike" in w for w in twin.warnings)
    for block, mark in zip(twin.blocks, full.strikes, strict=True):
        assert block.attributes["speed"] == pytest.approx(mark.speed, rel=0.1)
        assert block.attributes["depth"] == pytest.approx(mark.depth, abs=1.5e-3)


def test_killed_recording_loses_only_its_last_strike() -> None:
    full = record(strikes=8)
    end = full.strikes[5].start + 0.5 * (full.strikes[5].end - full.strikes[5].start)
    signals = {
        k: TimeSeries(v.time[v.time < end], v.value[v.time < end], v.unit)
        for k, v in full.signals.items()
    }
    notes = {"real": [n for n in full.notes["real"] if n.time < end]}
    twin = PianoTwin([replace(full, signals=signals, notes=notes)])
    assert len(twin.blocks) == 5
    assert any("ends within a strike" in w for w in twin.warnings)


def test_nothing_played() -> None:
    full = record(strikes=8)
    end = full.strikes[0].start - 0.05
    signals = {
        k: TimeSeries(v.time[v.time < end], v.value[v.time < end], v.unit)
        for k, v in full.signals.items()
    }
    with pytest.raises(RecordingError, match="no strike"):
        PianoTwin([replace(full, signals=signals, notes={}, strikes=[])])


def test_phases_follow_one_another() -> None:
    for block in PianoTwin([record(strikes=8)]).blocks:
        edges = [block.phases[p] for p in ("approach", "press", "bottom", "hold", "release")]
        assert all(a[0] <= a[1] for a in edges)
        assert all(a[1] <= b[0] + 1e-9 for a, b in pairwise(edges))


def test_scatter_needs_three_repeats() -> None:
    assert all("note.scatter" in b.events for b in PianoTwin([record(strikes=16)]).blocks)
    single = record(strikes=16)
    alone = replace(
        single, strikes=[replace(s, condition=f"c{i}") for i, s in enumerate(single.strikes)]
    )
    assert all("note.scatter" not in b.events for b in PianoTwin([alone]).blocks)


def test_strikes_that_the_real_cell_refused_are_left_out() -> None:
    recording = record()
    first, *_, last = (b.name for b in prepare([recording])[0])
    mark = recording.strikes[0]
    refused = replace(recording, refusals=((mark.start + 0.1, mark.start + 0.2, "/command/wrist"),))
    blocks, _, _, warnings = prepare([refused])
    assert first not in {b.name for b in blocks} and last in {b.name for b in blocks}
    assert any("refused or obeyed late by the real cell" in w for w in warnings)
    throughout = replace(recording, refusals=((0.0, 1e3, "/command/wrist"),))
    with pytest.raises(RecordingError, match="late by the real cell in 16 of 16") as error:
        prepare([throughout])
    assert "not one of 16 strikes" in str(error.value) and "record /" not in str(error.value)
