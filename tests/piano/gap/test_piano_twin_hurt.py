"""Hurt recordings are cut and simulated, or refused in one line; nothing ends in a traceback."""

from __future__ import annotations

import warnings
from hashlib import sha256

import numpy as np
import pytest
from examples import fewer
from hypothesis import HealthCheck, example, given
from hypothesis import strategies as st
from piano_twin_cases import record

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin
from pianobot_ros.testing.damage import DAMAGES, whole_strikes


def digest(recording: Recording) -> str:
    signals = {k: (s.time.tobytes(), s.value.tobytes()) for k, s in recording.signals.items()}
    return sha256(repr((signals, recording.notes, recording.strikes)).encode()).hexdigest()


KINDS = st.lists(st.sampled_from(sorted(DAMAGES)), min_size=1, max_size=3)


@fewer(0.2, suppress=[HealthCheck.data_too_large])
@given(kinds=KINDS, seed=st.integers(0, 1000))
@example(kinds=["topic_empty", "marks_lost"], seed=0)
@example(kinds=["all_not_a_number", "truncated"], seed=1)
@example(kinds=["clock_stepped_back", "notes_twice"], seed=2)
def test_damage_is_survived(kinds: list[str], seed: int) -> None:
    hurt, random = record(strikes=8), np.random.default_rng(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for kind in kinds:
            hurt = DAMAGES[kind](hurt, random)
        try:
            twin = PianoTwin([hurt])
        except PianobotError as error:
            assert "\n" not in str(error)
            return
        assert 0 < len(twin.blocks) <= 2 * 8
        nominal = {p.name: p.nominal for p in twin.parameters}
        for block in twin.blocks:
            for name, signal in block.outputs.items():
                assert signal.t.size and np.all(np.isfinite(signal.y)), name
            try:
                (prediction,) = twin.simulate([block], nominal, ())
            except PianobotError as error:  # the engine leaves such a block out
                assert "unstable" in str(error)
                continue
            for observable in twin.observables:
                if observable.signal in block.outputs and observable.name in prediction:
                    size = np.asarray(prediction[observable.name]).size
                    assert size == block.outputs[observable.signal].t.size


@pytest.mark.parametrize("kind", sorted(DAMAGES))
def test_damage_hurts(kind: str) -> None:
    """Every kind changes something, and on a copy."""
    full = record(strikes=8)
    before = digest(full)
    hurt = DAMAGES[kind](full, np.random.default_rng(3))
    assert digest(full) == before != digest(hurt)
    assert 0.0 <= whole_strikes(full, hurt) <= 1.0
    assert whole_strikes(full, full) == 1.0
