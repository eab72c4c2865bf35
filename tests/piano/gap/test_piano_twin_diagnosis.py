"""End to end on the emulated cell, whose laws are others than the library's: few strikes, so that
it stays fast.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from piano_twin_cases import record

from pianobot_ros.bags.write import write_bag
from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.piano.gap import diagnose_bag, diagnose_recordings

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


def test_none() -> None:
    found = diagnose_recordings([record()])
    assert found.verdict == "none", found.sentence
    assert found.effects == ()


@pytest.mark.long
def test_wrong_parameters_are_no_effect() -> None:
    errors = (
        ("key_stiffness", 0.18),
        ("joint_stiffness", -0.15),
        ("fsr_gain", 0.1),
        ("key_inertia", -0.15),
    )
    found = diagnose_recordings([record((), errors)])
    assert found.verdict == "parameters", found.sentence
    assert found.parameters["key_stiffness"].value == pytest.approx(1.18, abs=0.06)
    assert found.parameters["fsr_gain"].value == pytest.approx(1.1, abs=0.04)


@pytest.mark.parametrize(
    ("effect", "stage"),
    [
        ("wrist_delay", "wrist"),
        pytest.param("fsr_creep", "sensing", marks=pytest.mark.long),
    ],
)
def test_effect_is_named_and_the_gap_shrinks(effect: str, stage: str) -> None:
    strikes = 24 if stage == "sensing" else 16  # a few dozen events tell latency from jitter
    found = diagnose_recordings(
        [record(((effect, 6.0),), (("key_stiffness", -0.1),), strikes=strikes)]
    )
    assert found.verdict == "effect", found.sentence
    assert effect in found.credible_set
    assert found.effects[0].stage == stage
    assert found.gap.after < found.gap.before
    assert found.gap.closed > 0.5


def test_bag_in_report_out(tmp_path: Path) -> None:
    bag = write_bag(record(strikes=8), tmp_path / "bag")
    seen: list[float] = []
    found = diagnose_bag(
        bag, output=tmp_path / "out", strikes=8, progress=lambda _, x: seen.append(x)
    )
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["verdict"] == found.verdict
    assert set(document) == set(found.to_json())
    assert (tmp_path / "out" / "report.html").stat().st_size > 5000
    assert seen == sorted(seen) and seen[-1] == 1.0


def test_recording_without_motion_is_refused_in_one_line() -> None:
    full = record(strikes=8)
    signals = {k: v for k, v in full.signals.items() if "wrist" not in k}
    with pytest.raises(RecordingError, match="/command/wrist or /real/wrist/state"):
        diagnose_recordings([Recording(signals, full.notes, full.strikes, full.fsr_note)])
