"""Properties that every family of effects must have, and the inverses of the sensor laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from examples import fewer
from hypothesis import given
from hypothesis import strategies as st
from piano_twin_cases import record

from pianobot_ros.gap.floor.scatter import MEAN_DEPARTURE
from pianobot_ros.piano.gap.effects import LIBRARY, NAMES
from pianobot_ros.piano.gap.effects.base import Array, Memory
from pianobot_ros.piano.gap.simulation.note_events import note_departures
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


def values(name: str, **own: float) -> dict[str, float]:
    """All parameters of a family."""
    return {p.name: p.nominal for p in LIBRARY[name].parameters} | own


def undone(name: str, v: dict[str, float]) -> float:
    """Largest error (N) of a reading undone."""
    law = LIBRARY[name].law
    return float(np.abs(law.unread(v, TIME, law.read(v, TIME, FORCE)) - FORCE).max())


@fewer(0.3)
@given(
    share=st.floats(-0.3, 0.3),
    scale=st.floats(0.3, 3.0),
    least=st.floats(0.0, 20.0),
    left=st.floats(0.0, 20.0),
)
def test_hysteresis_reading_can_be_undone(
    share: float, scale: float, least: float, left: float
) -> None:
    v = values(
        "fsr_hysteresis",
        fsr_hysteresis=share,
        fsr_hysteresis_scale=scale,
        fsr_hysteresis_from=least,
        fsr_hysteresis_left=min(left, least),
    )
    assert undone("fsr_hysteresis", v) < 0.05 * FORCE.max()


@fewer(0.3)
@given(
    share=st.floats(-0.3, 1.0),
    power=st.floats(-3.0, 0.9),
    time=st.floats(1e-4, 10.0),
    lasting=st.floats(0.0, 1.0),
)
def test_creep_reading_can_be_undone(
    share: float, power: float, time: float, lasting: float
) -> None:
    v = values(
        "fsr_creep",
        fsr_creep=share,
        fsr_creep_power=power,
        fsr_creep_time=time,
        fsr_creep_lasting=lasting,
    )
    assert undone("fsr_creep", v) < 0.02 * FORCE.max()


@pytest.mark.parametrize(
    ("power", "time", "growth"),
    [
        (0.5, 1e-4, np.sqrt),
        (0.0, 1e-3, lambda t: np.log1p(t / 1e-3) / np.log1p(1e3)),
        (-3.0, 0.6, lambda t: (1.0 - (1.0 + t / 0.6) ** -3) / (1.0 - (1.0 + 1 / 0.6) ** -3)),
    ],
)
def test_a_creep_that_ends_and_one_that_lasts_grow_alike_under_a_steady_load(
    power: float, time: float, growth: Callable[[Array], Array]
) -> None:
    """Power, logarithm and nearly an exponential; only the lasting one is left when the load is
    gone, and fades.
    """
    t = 2e-3 * np.arange(1500)
    force = np.where((t > 0.0) & (t < 2.0), 3.0, 0.0)
    inside, after = (t > 0.05) & (t < 1.99), t > 2.01
    for lasting in (0.0, 1.0):
        v = values(
            "fsr_creep",
            fsr_creep=0.1,
            fsr_creep_power=power,
            fsr_creep_time=time,
            fsr_creep_lasting=lasting,
        )
        y = LIBRARY["fsr_creep"].law.read(v, t, force)
        assert np.abs(y[inside] / 3.0 - 1.0 - 0.1 * growth(t[inside])).max() < 0.008
        if lasting:
            assert y[after].max() > 0.05 and np.all(np.diff(y[after]) < 0.0)
        else:
            assert np.all(y[after] == 0.0)


def test_a_loop_in_proportion_closes_at_no_force_and_a_constant_one_stays_open() -> None:
    law = LIBRARY["fsr_hysteresis"].law
    closed = values("fsr_hysteresis", fsr_hysteresis=0.1, fsr_hysteresis_scale=0.05)
    assert law.read(closed, TIME, FORCE)[-1] == 0.0
    wide = closed | {"fsr_hysteresis_from": 20.0, "fsr_hysteresis_left": 20.0}
    memory = Memory()
    first = law.read(wide, TIME, FORCE, memory)
    again = law.read(wide, TIME + 1.0, FORCE, memory)
    assert first[0] == 0.0
    assert 1.5 < first[-1] < 2.0
    assert again[0] == pytest.approx(first[-1])
    held = law.unread(wide, TIME, first, Memory())
    assert np.abs(held - FORCE).max() < 0.01


def test_noise_at_rest_does_not_turn_a_hysteresis_round() -> None:
    """The change between branches is by the path of the force, and noise has a long one."""
    v = values(
        "fsr_hysteresis",
        fsr_hysteresis=0.1,
        fsr_hysteresis_scale=0.1,
        fsr_hysteresis_from=10.0,
        fsr_hysteresis_left=5.0,
    )
    law = LIBRARY["fsr_hysteresis"].law
    t = 1e-3 * np.arange(3000)
    force = np.interp(t, [0.0, 0.1, 0.3, 2.8, 2.9], [0.0, 0.0, 4.0, 4.0, 0.0])
    noisy = law.read(v, t, force) + 0.01 * np.random.default_rng(0).normal(size=t.size)
    assert np.abs(law.unread(v, t, noisy) - force)[t < 2.7].max() < 0.1


def regulated(**own: float) -> Array:
    """Pressures (3,) Pa some time after steps to -50, -20 and -50 kPa from -80 kPa."""
    t = 1e-2 * np.arange(1200)
    steps = np.select([t < 1, t < 4, t < 8], [-80e3, -50e3, -20e3], -50e3)
    v = values("regulator_hysteresis", regulator_hysteresis=2e3, **own)
    p = LIBRARY["regulator_hysteresis"].law.pressure(v, t, steps)
    return np.asarray(p[[350, 750, 1150]])


def test_a_regulator_sticks_by_direction_by_level_or_for_a_while() -> None:
    assert regulated() == pytest.approx([-51e3, -21e3, -49e3])
    assert regulated(regulator_hysteresis_path=0.1) == pytest.approx([-51e3, -21e3, -49e3])
    graded = regulated(regulator_hysteresis_graded=1.0)
    assert graded == pytest.approx([-51e3, -20.4e3, -49e3])
    short = regulated(regulator_hysteresis_path=100.0)  # a share of each step
    assert short == pytest.approx([-50.3e3, -20.6e3, -50.3e3])
    back = regulated(regulator_hysteresis_back=1.0, regulator_hysteresis_time=0.2)
    assert back == pytest.approx([-50e3, -20e3, -50e3], abs=1.0)


def test_a_velocity_curve_rises_whatever_its_shape() -> None:
    x = np.linspace(1.0, 126.0, 200)
    rng = np.random.default_rng(0)
    law, parameters = LIBRARY["midi_velocity_curve"].law, LIBRARY["midi_velocity_curve"].parameters
    for _ in range(200):
        v = {p.name: float(rng.uniform(p.low, p.high)) for p in parameters}
        assert np.all(np.diff(law.velocity(v, x)) > -1e-9)
        assert law.velocity(v, np.array([127.0])) == pytest.approx(127.0)
    v = values("midi_velocity_curve", midi_velocity_knee=0.4)
    slopes = np.diff(law.velocity(v, np.array([20.0, 40.0, 80.0, 100.0])))[[0, 2]] / 20.0
    assert slopes == pytest.approx([0.8, 1.2])


def test_a_jitter_is_a_gaussian_or_a_few_notes_that_wait() -> None:
    def away(**own: float) -> Array:
        v = values("midi_jitter", midi_jitter=2e-3, **own)
        return note_departures(1e-4, 4, v, [LIBRARY["midi_jitter"]])

    plain = away()
    assert np.mean(plain) == pytest.approx(MEAN_DEPARTURE * 2e-3, rel=0.05)
    few = away(midi_jitter_share=0.1, midi_jitter_wait=5.0)
    assert np.quantile(few, 0.7) < 0.3e-3 and np.quantile(few, 0.98) > 8e-3


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
