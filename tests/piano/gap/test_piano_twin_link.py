"""Stamps of a live cell: their constant errors are fitted, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from piano_twin_cases import record

from pianobot_ros.cell.recordings.recording import Recording, TimeSeries
from pianobot_ros.piano.gap.evidence.time_stamps import is_live, link_parameters
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

LATE = 4e-4  # s


def board_late(recording: Recording) -> Recording:
    """The same with the stamps of force and angle too late, as a link leaves them."""
    on_board = ("real/fsr.", "real/key_angle")
    signals = {
        k: TimeSeries(s.time + LATE, s.value, s.unit) if k.startswith(on_board) else s
        for k, s in recording.signals.items()
    }
    return replace(recording, signals=signals)


def test_only_what_nodes_recorded_is_live() -> None:
    computed = record()
    assert not is_live(computed)
    assert is_live(
        replace(
            computed,
            signals=computed.signals
            | {"real/joint_states.position": TimeSeries.__new__(TimeSeries)},
        )
    )
    assert is_live(replace(computed, epoch=1.7e9)), "whatever else was recorded beside it"


def test_a_computed_recording_has_no_stamp_parameters() -> None:
    names = {p.name for p in link_parameters()}
    assert names == {"wrist_stamp", "fsr_stamp", "midi_stamp"}
    assert not names & {p.name for p in PianoTwin([record()]).parameters}
    assert names < {p.name for p in PianoTwin([record()], live=True).parameters}


def test_the_stamp_parameter_undoes_late_stamps() -> None:
    late = record(seed=4)  # a set in which the lateness is far above the repeatability
    twin = PianoTwin([board_late(late)], live=True)
    nominal = {p.name: p.nominal for p in twin.parameters}

    def misfit(stamp: float) -> dict[str, float]:
        predictions = twin.simulate(twin.blocks, nominal | {"fsr_stamp": stamp}, ())
        found = {}
        for name, signal in (
            ("angle", "angle"),
            ("force", "force"),
            ("force | key as measured", "force"),
        ):
            pairs = zip(twin.blocks, predictions, strict=True)
            found[name] = float(
                np.mean([np.mean((b.outputs[signal].y - p[name]) ** 2) for b, p in pairs])
            )
        onsets = [
            b.events["note.onset"] - float(p["note.onset | measured angle"])
            for b, p in zip(twin.blocks, predictions, strict=True)
            if "note.onset | measured angle" in p and "note.onset" in b.events
        ]
        found["onset"] = float(np.nanmean(onsets) ** 2)
        return found

    uncorrected, corrected = misfit(0.0), misfit(LATE)
    for name, value in corrected.items():
        assert value < 0.8 * uncorrected[name], name


def test_scatter_of_the_link_counts_before_the_instruments() -> None:
    plain, live = (PianoTwin([record()], live=live) for live in (False, True))
    values = {p.name: p.nominal for p in live.parameters}
    a, b = (t.simulate(t.blocks, values, ())[0]["note.scatter"] for t in (plain, live))
    assert float(b) > float(a)
