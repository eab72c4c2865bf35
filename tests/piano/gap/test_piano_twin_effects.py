"""Properties that every family of effects must have, and the inverses of the sensor laws."""

from __future__ import annotations

import numpy as np
import pytest
from examples import fewer
from hypothesis import given
from hypothesis import strategies as st
from piano_twin_cases import record

from pianobot_ros.piano.gap.effects import LIBRARY, NAMES
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

FORCE = np.concatenate(
    [np.zeros(50), 4 * np.sin(np.linspace(0, np.pi, 300)) ** 2, np.full(100, 0.0)]
)
TIME = 1e-3 * np.arange(FORCE.size)


@pytest.fixture(scope="module")
def twin() -> PianoTwin:
    return PianoTwin([record(strikes=8)])


def test_canonical_names() -> None:
    assert tuple(LIBRARY) == NAMES
    assert all(LIBRARY[n].name == n for n in NAMES)
    assert len(set(NAMES)) == 27


@pytest.mark.parametrize("name", NAMES)
def test_vanishes_at_null_and_acts_at_every_start(name: str, twin: PianoTwin) -> None:
    effect = LIBRARY[name]
    if name not in {e.name for e in twin.effects}:
        assert name == "midi_jitter"  # needs three repeats
        return
    blocks = twin.blocks
    nominal = {p.name: p.nominal for p in twin.parameters}
    own = {p.name: p.nominal for p in effect.parameters}
    reference = twin.simulate(blocks, nominal, ())

    def change(values: dict[str, float]) -> float:
        changed = twin.simulate(blocks, nominal | own | values, (name,))
        worst = 0.0
        for a, b in zip(reference, changed, strict=True):
            for key in a:
                x, y = np.asarray(a[key], float), np.asarray(b[key], float)
                spread = max(float(np.ptp(x)) if x.size > 1 else abs(float(x)), 1e-9)
                difference = np.abs(x - y) / spread
                worst = max(
                    worst, float(np.nanmax(difference)) if np.isfinite(difference).any() else 0.0
                )
        return worst

    assert change({effect.magnitude: effect.null}) < 1e-6
    for start in effect.starts:
        assert change(dict(start)) > 1e-4, start


@pytest.mark.parametrize("name", NAMES)
def test_bounds_hold_all_starts(name: str) -> None:
    effect = LIBRARY[name]
    limits = {p.name: (p.low, p.high) for p in effect.parameters}
    for start in effect.starts:
        for key, value in start.items():
            assert limits[key][0] <= value <= limits[key][1]
    assert effect.description


@fewer(0.3)
@given(share=st.floats(-0.3, 0.3), scale=st.floats(0.3, 3.0), least=st.floats(0.0, 20.0))
def test_hysteresis_reading_can_be_undone(share: float, scale: float, least: float) -> None:
    law = LIBRARY["fsr_hysteresis"].law
    v = {"fsr_hysteresis": share, "fsr_hysteresis_scale": scale, "fsr_hysteresis_from": least}
    assert np.abs(law.unread(v, TIME, law.read(v, TIME, FORCE)) - FORCE).max() < 0.05 * FORCE.max()


@fewer(0.3)
@given(share=st.floats(-0.3, 1.0), power=st.floats(0.05, 1.0))
def test_creep_reading_can_be_undone(share: float, power: float) -> None:
    law, v = LIBRARY["fsr_creep"].law, {"fsr_creep": share, "fsr_creep_power": power}
    assert np.abs(law.unread(v, TIME, law.read(v, TIME, FORCE)) - FORCE).max() < 0.02 * FORCE.max()


@fewer(0.3)
@given(loss=st.floats(0.0, 0.3), knee=st.floats(1.0, 8.0))
def test_saturated_reading_can_be_undone(loss: float, knee: float) -> None:
    law, v = LIBRARY["fsr_saturation"].law, {"fsr_saturation": loss, "fsr_saturation_knee": knee}
    reading = law.read(v, TIME, FORCE)
    assert np.all(reading <= FORCE + 1e-12)
    if FORCE.max() <= 5.0 and loss < 0.1:
        assert np.abs(law.unread(v, TIME, reading) - FORCE).max() < 1e-6 * FORCE.max() + 1e-9


def test_delay_moves_and_lag_damps() -> None:
    z = np.sin(40 * TIME)
    delay, lag = LIBRARY["wrist_delay"].law.height, LIBRARY["wrist_lag"].law.height
    moved = delay({"wrist_delay": 0.02}, TIME, z, FORCE)
    assert np.allclose(moved[100:], z[80:-20], atol=1e-9)
    slow = lag({"wrist_lag": 0.02}, TIME, z, FORCE)
    assert np.ptp(slow[200:]) == pytest.approx(np.ptp(z[200:]) / np.hypot(1, 40 * 0.02), rel=0.02)
