"""A recording that says what the twin had adopted is diagnosed from there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from piano_twin_cases import record

from pianobot_ros.cell.errors import RecordingError
from pianobot_ros.piano.gap.adoption.live_laws import parse_effects
from pianobot_ros.piano.gap.simulation.corrections import Correction
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin


def test_adopted_values_are_nominal_and_adopted_effects_in_every_candidate() -> None:
    plain = record(strikes=8)
    adopted = replace(
        parse_effects(["key_friction.key_friction=0.02"]),
        parameters={"joint_stiffness": Correction(1.2, 1.1, 1.3)},
    )
    nominal = PianoTwin([plain])
    twin = PianoTwin([replace(plain, corrections=adopted.to_yaml())])
    own = {p.name: p.nominal for p in twin.parameters}
    assert own["joint_stiffness"] == 1.2
    assert own["key_friction"] == 0.02
    assert "key_friction" not in {e.name for e in twin.effects}
    values = {p.name: p.nominal for p in nominal.parameters}
    names = ("key_friction", "key_friction_static")
    wanted = nominal.simulate(
        nominal.blocks,
        values | {"joint_stiffness": 1.2} | {n: own[n] for n in names},
        ["key_friction"],
    )
    got = twin.simulate(twin.blocks, own, [])
    for a, b in zip(wanted, got, strict=True):
        for name in a:
            assert np.asarray(b[name]) == pytest.approx(np.asarray(a[name]), nan_ok=True), name


def test_recordings_of_twins_that_differ_are_not_diagnosed_together() -> None:
    plain = record(strikes=8)
    text = parse_effects(["key_friction.key_friction=0.02"]).to_yaml()
    with pytest.raises(RecordingError, match="one by one"):
        PianoTwin([plain, replace(plain, corrections=text)])
