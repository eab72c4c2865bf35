"""Rollouts are remembered by everything that they depend on."""

from __future__ import annotations

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from piano_twin_cases import record
from scipy.ndimage import gaussian_filter

from pianobot_ros.cell.motion.geometry import pivot_radius
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.gap.effects.base import ForceLaw
from pianobot_ros.piano.gap.evidence.time_stamps import DeviceClock
from pianobot_ros.piano.gap.simulation import rollouts
from pianobot_ros.piano.gap.simulation.force_sensor import ForceSensor
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin
from pianobot_ros.piano.twin.reduced.strike_laws import HAND_ALONE, KEY_ALONE, NAMES, NULLS

ON = {  # laws that must be on for a number of theirs to show
    "joint_friction": 0.02,
    "joint_backlash": 0.01,
    "joint_hardening": 20.0,
    "jamming_hysteresis": 0.3,
    "joint_creep": 0.3,
    "pad_softening": 3e-4,
    "tip_slip": 0.3,
    "tip_slip_weakening": 0.5,
    "joint_friction_static": 0.4,
    "joint_friction_rest": 0.4,
    "key_friction": 0.03,
    "key_friction_static": 0.4,
    "hammer": 1e-3,
    "let_off": 0.05,
    "felt_exponent": 1.5,
}
RICH = NULLS | ON
PLAIN = ForceSensor([], {"fsr_gain": 1.0})
EXACT = DeviceClock()


def moved(name: str) -> dict[str, float]:
    x = RICH[name]
    return RICH | {name: 1.3 * x if x else 1e-3}


@pytest.fixture(scope="module")
def twin() -> PianoTwin:
    return PianoTwin([record(strikes=8)])


@pytest.mark.parametrize("name", NAMES)
def test_a_number_that_changes_a_rollout_is_in_its_key(twin: PianoTwin, name: str) -> None:
    data = twin.blocks[0].data
    assert data.reading is not None and data.given is not None
    assert data.angle is not None and data.rate is not None and data.push is not None

    def press(values: dict[str, float]) -> np.ndarray:
        assert data.given is not None and data.angle is not None and data.rate is not None
        return data.model.press(data.given, data.angle, data.rate, values).force

    def drive(values: dict[str, float]) -> np.ndarray:
        assert data.push is not None
        lever = data.model.key.radius - values["tip_reach"]
        return data.model.drive(data.start, data.push, lever, values).angle

    acts = [not np.array_equal(roll(RICH), roll(moved(name))) for roll in (press, drive)]
    assert not (acts[0] and name in KEY_ALONE)
    assert not (acts[1] and name in HAND_ALONE)
    store = rollouts.Rollouts(twin.blocks)
    for values in (RICH, moved(name)):
        store.strike(data, values)
        store.held(data, values)
        store.driven(data, values, PLAIN)
    assert len(store._kept["strike"]) == 2
    assert len(store._kept["press"]) == 2 - (name in KEY_ALONE)
    assert len(store._kept["drive"]) == 2 - (name in HAND_ALONE)


def test_a_new_number_is_in_every_key(twin: PianoTwin) -> None:
    store, data = rollouts.Rollouts(twin.blocks), twin.blocks[0].data
    for x in (0.0, 1.0):
        values = NULLS | {"a law of tomorrow": x}
        store.held(data, values)
        store.driven(data, values, PLAIN)
    assert len(store._kept["press"]) == len(store._kept["drive"]) == 2


def test_how_the_force_is_read_is_in_the_key(twin: PianoTwin) -> None:
    data, nominal = twin.blocks[0].data, {"fsr_gain": 1.0}
    cases = [
        (PLAIN, EXACT),
        (ForceSensor([], {"fsr_gain": 1.1}), EXACT),
        (PLAIN, DeviceClock(2e-3)),
    ]
    for effect in (e for e in LIBRARY.values() if isinstance(e.law, ForceLaw)):
        values = nominal | {p.name: p.nominal for p in effect.parameters}
        size = next(p for p in effect.parameters if p.name == effect.magnitude)
        strengths = [size.nominal + share * (size.high - size.nominal) for share in (0.1, 0.3)]
        cases += [(ForceSensor([effect], values | {size.name: x}), EXACT) for x in strengths]
    store = rollouts.Rollouts(twin.blocks)
    angles = [store.driven(data, RICH, *case).angle for case in cases]
    for case, angle in zip(cases, angles, strict=True):
        fresh = rollouts.Rollouts(twin.blocks).driven(data, RICH, *case).angle
        assert np.array_equal(angle, fresh)
    for i, angle in enumerate(angles):
        assert not any(np.array_equal(angle, other) for other in angles[:i])


def test_recentring_gives_another_twin_and_leaves_this_one(twin: PianoTwin) -> None:
    nominal = {p.name: p.nominal for p in twin.parameters}
    values = nominal | {"joint_stiffness": 1.3}
    before = twin.simulate(twin.blocks, values, ())
    other = twin.recentre(values)
    exact = other.simulate(twin.blocks, values, ())
    for a, b in zip(before, twin.simulate(twin.blocks, values, ()), strict=True):
        assert np.array_equal(a["force"], b["force"])
    assert any(
        not np.array_equal(a["force"], b["force"]) for a, b in zip(before, exact, strict=True)
    )
    again = pickle.loads(pickle.dumps(other)).simulate(twin.blocks[:1], values, ())
    assert np.array_equal(again[0]["force"], exact[0]["force"])


def test_a_force_on_a_chord_acts_where_the_hand_lands(twin: PianoTwin) -> None:
    """Thumb on a white key and middle finger on a black one land at the usual point of neither."""
    data = twin.blocks[0].data
    mark = replace(data.mark, finger="middle", note=66)
    other = replace(mark, finger="thumb", note=62)
    for strikes, lever in (([mark], pivot_radius(66)), ([mark, other], 0.127)):
        recording = replace(data.session.recording, strikes=strikes)
        own = replace(data, mark=mark, session=replace(data.session, recording=recording))
        assert own.lever == pytest.approx(lever, abs=1e-3)
    used: list[float] = []
    model = SimpleNamespace(drive=lambda start, force, lever, *_: used.append(lever))
    chord = replace(own, model=model)  # type: ignore[arg-type]
    twin.rollouts.driven(chord, RICH | {"tip_reach": 0.0}, PLAIN)
    assert used == [own.lever]


@pytest.mark.parametrize("name", ["fsr_creep", "fsr_hysteresis"])
def test_a_sensor_goes_on_from_what_earlier_strikes_left(name: str) -> None:
    effect, plain = LIBRARY[name], record(strikes=8)
    values = {p.name: p.nominal for p in effect.parameters} | dict(effect.starts[-1])
    noisy = plain.signals["real/fsr.force"]
    force = replace(noisy, value=np.where(noisy.value > 0.1, gaussian_filter(noisy.value, 3), 0.0))
    plain = replace(plain, signals={**plain.signals, "real/fsr.force": force})
    reading = replace(force, value=effect.law.read(values, force.time, force.value))
    bent = replace(plain, signals={**plain.signals, "real/fsr.force": reading})
    sensor = ForceSensor([effect], values | {"fsr_gain": 1.0})
    left = []
    for before, after in zip(PianoTwin([plain]).blocks, PianoTwin([bent]).blocks, strict=True):
        old, new = before.data.reading, after.data.reading
        assert old is not None and new is not None
        assert np.abs(sensor.undone(after.data, new) - old).max() < 0.02
        assert np.abs(sensor.read(after.data, old) - new).max() < 0.02
        left.append(float(np.median(new[:20] - old[:20])))
    assert left[0] == pytest.approx(0.0, abs=1e-3)
    assert min(left[1:]) > 0.005


def test_repeats_by_a_clock_that_gains_are_each_in_their_true_place() -> None:
    """One rollout for several repeats gives the forces of a rollout of each."""
    exact, rate = record(strikes=16), 3e-4
    board = ("real/fsr", "real/key_angle")
    late = {
        name: replace(signal, time=signal.time * (1.0 + rate)) if name.startswith(board) else signal
        for name, signal in exact.signals.items()
    }
    twins = [PianoTwin([replace(exact, signals=late)]) for _ in range(2)]
    assert twins[1].rollouts.shared
    twins[1].rollouts.shared.clear()
    values = {p.name: p.nominal for p in (*twins[0].parameters, *LIBRARY["clock_skew"].parameters)}
    values |= {"clock_skew": rate, "clock_skew_fsr": 1.0}
    one, each = (
        [p["force | key as measured"] for p in t.simulate(t.blocks, values, ("clock_skew",))]
        for t in twins
    )
    most = max(float(np.max(force)) for force in each)
    for a, b in zip(one, each, strict=True):
        assert np.sqrt(np.mean((a - b) ** 2)) < 0.005 * most
