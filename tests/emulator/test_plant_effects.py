"""Every injected effect changes its own stage, leaves the stages before it alone, and vanishes with
its magnitude.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache, lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from pianobot_ros import gap
from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.emulator.plant.cases.case import PARAMETERS, Case
from pianobot_ros.emulator.plant.cases.draw import KINDS, draw_case
from pianobot_ros.emulator.plant.cases.effects import (
    EFFECTS,
    LEVELS,
    parse_effects,
    scaled,
    size_name,
    split_law,
)
from pianobot_ros.emulator.plant.instruments.sensors import MidiSensor
from pianobot_ros.emulator.plant.laws.table import LAW_COUNT, LAWS, law_count
from pianobot_ros.emulator.plant.mechanics.physics import physics
from pianobot_ros.emulator.plant.offline import simulate_cell, simulate_commands, standard_strikes
from pianobot_ros.piano.gap.effects import NAMES

pytestmark = pytest.mark.slow

FAMILIES = set(NAMES)
EVERY = [size_name(name, law) for name in EFFECTS for law in range(law_count(name))]
MECHANICAL = [n for n in EVERY if EFFECTS[split_law(n)[0]].stage in ("hand", "contact", "key")]
FINE = physics().step / 2
WRIST, PRESSURE, ANGLE = (
    "real/wrist/state.position",
    "real/vacuum/state.measured",
    "real/key_angle.64",
)
FORCE = "real/fsr.force"


@lru_cache(maxsize=1)
def commands() -> Commands:
    return standard_strikes(4, n=2, repeats=1)


@lru_cache(maxsize=1)
def nominal() -> Recording:
    return play({})


def play(physical: dict[str, float], effects: dict[str, float] | None = None) -> Recording:
    case = Case(effects or {}, physical=physical, repeatability=0.0, noise=0.0)
    return simulate_commands(commands(), case, rounded=False)


@cache
def played(name: str) -> Recording:
    """The strikes with an effect at its largest: two tests look at each."""
    return play({}, {name: 10.0})


def notes(recording: Recording) -> Array:
    return np.array([[e.time, e.velocity, e.on] for e in recording.notes["real"]], dtype=float)


def differs(one: Recording, other: Recording) -> set[str]:
    """Names of the signals, the notes (``midi``) and time stamps (``stamps``) in which two
    recordings differ.
    """
    found = {
        n
        for n in (WRIST, PRESSURE, ANGLE, FORCE)
        if not np.array_equal(one.signal(n).value, other.signal(n).value)
    }
    if not np.array_equal(notes(one), notes(other)):
        found.add("midi")
    if not np.array_equal(one.signal(FORCE).time, other.signal(FORCE).time):
        found.add("stamps")
    return found


def test_registry_has_every_family_and_more() -> None:
    assert {name for name, effect in EFFECTS.items() if effect.in_library} == FAMILIES
    assert set(LAWS) == FAMILIES and all(len(laws) == LAW_COUNT for laws in LAWS.values())
    assert sum(not effect.in_library for effect in EFFECTS.values()) >= 17
    for name in EVERY:
        effect = EFFECTS[split_law(name)[0]]
        assert effect.law and effect.unit and effect.low < effect.high
        values = [scaled(name, level) for level in LEVELS]
        assert values == sorted(values) and effect.high >= values[-1] > values[0] > 0
        assert scaled(name, 0.5) == pytest.approx(values[0] / 2)


@pytest.mark.parametrize("name", EVERY)
def test_effect_changes_its_own_stage_and_nothing_before_it(name: str) -> None:
    changed = differs(played(name), nominal())
    match EFFECTS[split_law(name)[0]].stage:
        case "wrist":
            assert WRIST in changed
            assert PRESSURE not in changed
        case "pneumatics":
            assert PRESSURE in changed
            assert WRIST not in changed
        case "hand" | "contact" | "key":
            assert {ANGLE, FORCE} <= changed
            assert not {WRIST, PRESSURE, "stamps"} & changed
        case "sensing":
            assert not {WRIST, PRESSURE, ANGLE, "stamps"} & changed
            assert changed == ({FORCE} if name.startswith("fsr") else {"midi"})
        case "clock":
            assert changed == {"stamps"}


@pytest.mark.parametrize("law", range(LAW_COUNT))
def test_effects_of_no_size_are_none(law: int) -> None:
    nothing = {name: 0.0 for name in EVERY if split_law(name)[1] == law}
    assert set(LAWS) <= {split_law(name)[0] for name in nothing}
    assert differs(play(nothing), nominal()) == set()


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.long
def test_effect_vanishes_with_its_size(name: str) -> None:
    if name.startswith(
        ("stuck_contact", "midi_jitter")
    ):  # lost notes come one by one; the jitter's size is checked by its mean
        return
    tiny = play({name: 1e-4 * EFFECTS[split_law(name)[0]].low})
    for signal in (WRIST, PRESSURE, ANGLE, FORCE):
        a, b = tiny.signal(signal).value, nominal().signal(signal).value
        # Sticking and sliding branch; what they leave must stay far below the floor.
        assert np.sqrt(np.mean((a - b) ** 2)) <= 2e-3 * np.sqrt(np.mean(b**2))
    assert notes(tiny)[:, 0] == pytest.approx(notes(nominal())[:, 0], abs=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("name", MECHANICAL)
@pytest.mark.long
def test_effect_is_the_same_at_a_finer_step(name: str) -> None:
    effect, law = split_law(name)
    size = {effect: LEVELS[-1]}
    coarse, fine = angle_with(size, law, physics().step), angle_with(size, law, FINE)
    assert rms(coarse - fine) < 0.05 * rms(fine - finely())


@lru_cache(maxsize=1)
def finely() -> Array:
    return angle_with({}, 0, FINE)


def angle_with(effects: dict[str, float], law: int, step: float) -> Array:
    """The key's angle (n,) in three strikes, integrated in steps of ``step`` s."""
    case = Case(effects, repeatability=0.0, noise=0.0, laws=dict.fromkeys(effects, law))
    strikes = standard_strikes(4, n=3, repeats=1)
    return simulate_commands(strikes, case, step=step).signal(ANGLE).value


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def everything(recording: Recording) -> list[Array]:
    """All that laws could change."""
    signals = [recording.signal(n).value for n in (WRIST, PRESSURE, ANGLE, FORCE)]
    return [*signals, recording.signal(FORCE).time, notes(recording)]


@pytest.mark.parametrize("name", LAWS)
def test_the_laws_of_an_effect_differ(name: str) -> None:
    seen = [everything(played(size_name(name, law))) for law in range(LAW_COUNT)]
    for one, other in combinations(seen, 2):
        pairs = zip(one, other, strict=True)
        assert not all(np.array_equal(a, b) for a, b in pairs)


@pytest.mark.parametrize("law", [0, 1, 2])
def test_what_is_called_a_latency_is_no_jitter(law: int) -> None:
    """At least half of it is the same for all events, else two families had one law."""
    wait = 0.01
    sensor = MidiSensor(Case(physical={size_name("midi_latency", law): wait}, noise=0.0))
    times = np.arange(200) * 0.1237
    late = [sensor.notes(np.array([[t, 1.0, 0, 0.3]]))[0].time - t for t in times]
    assert np.mean(late) == pytest.approx(wait, rel=0.1)
    assert min(late) > 0.499 * wait
    assert max(late) < 1.501 * wait


def test_left_out_processes_are_none_that_the_engine_was_made_for() -> None:
    engine = " ".join(
        path.read_text(encoding="utf-8").lower()
        for path in Path(gap.__file__ or "").parent.glob("**/*.py")
    )
    words = {
        "pump_depletion": ("deplet", "pump"),
        "grain_fatigue": ("fatigue", "grain"),
        "pad_mullins": ("mullins", "rubber"),
        "felt_set": ("felt",),
        "thixotropic_grease": ("thixotrop", "grease"),
    }
    for name, some in words.items():
        assert not EFFECTS[name].in_library
        assert not any(word in engine for word in some), name


def test_a_case_draws_its_laws_and_nothing_else_changes() -> None:
    drawn = set()
    for seed in range(40):
        old, new = draw_case(seed), draw_case(seed, laws=(0, 1, 2))
        assert old.laws == {}
        assert (old.effects, old.parameters, old.seed) == (new.effects, new.parameters, new.seed)
        drawn |= {new.laws.get(name, 0) for name in new.effects}
        assert draw_case(seed, "unknown", laws=(1, 2)).laws == {}
        assert set(draw_case(seed, laws=(3,)).laws.values()) == {3}
        assert all(law == 2 for law in draw_case(seed, laws=(2,)).laws.values())
        assert Case.from_json(new.to_json()) == new
    assert drawn == {0, 1, 2}
    with pytest.raises(ConfigError, match="some of 0, 1, 2 and 3"):
        draw_case(0, laws=(4,))
    assert Case({"key_friction_law2": 3.0}) == Case({"key_friction": 3.0}, laws={"key_friction": 2})
    with pytest.raises(ConfigError, match="4 law"):
        Case({"key_friction_law4": 3.0})


def test_a_cell_in_another_session_is_the_same_cell_with_other_noise() -> None:
    case = draw_case(3, laws=(0, 1, 2))
    assert case.in_session(0) is case
    again, quiet = case.in_session(1), replace(case, effects={}, repeatability=0.0, noise=0.0)
    assert replace(again, seed=case.seed) == case
    assert len({case.in_session(k).seed for k in range(5)}) == 5
    for cell, differs in ((replace(case, effects={}), True), (quiet, False)):
        first, second = (
            simulate_commands(commands(), c, rounded=False).signal("real/wrist/state.position")
            for c in (cell, cell.in_session(1))
        )
        apart = float(np.std(first.value[:, 2] - second.value[:, 2]))
        assert (apart > 5e-6) is differs


def test_repeated_strikes_repeat_within_the_floor_and_differ() -> None:
    set_of_four = standard_strikes(5, n=8, repeats=4)
    real = simulate_cell(set_of_four, seed=3)
    force = real.signal(FORCE)
    peaks: dict[str, list[float]] = {}
    for strike in real.strikes:
        peaks.setdefault(strike.condition, []).append(
            float(force.between(strike.start, strike.end).value.max())
        )
    for values in peaks.values():
        assert 0 < np.std(values) < 0.03 * np.mean(values) + 0.03
    again = simulate_cell(set_of_four, seed=3)
    assert differs(real, again) == set()
    assert FORCE in differs(real, simulate_cell(set_of_four, seed=4))


def test_stuck_contacts_send_whole_velocities() -> None:
    real = simulate_cell(commands(), effects={"stuck_contact": 10.0}, seed=0)
    assert all(isinstance(n.velocity, int) for n in real.notes["real"])
    assert 64 in {n.velocity for n in real.notes["real"]}  # what it repeats before the first note


def test_recording_has_the_documented_signals() -> None:
    real = simulate_cell(commands(), seed=1)
    for name in (
        "command/wrist.position",
        "command/wrist.rotation",
        WRIST,
        "real/wrist/state.rotation",
    ):
        assert real.signal(name).value.shape == (len(real.signal(name).time), 3)
    for name in ("command/vacuum.pressure", "real/vacuum/state.setpoint", PRESSURE):
        assert real.signal(name).value.shape[1] == 3
    assert np.all(
        real.signal("real/fsr.counts").value == np.rint(real.signal("real/fsr.counts").value)
    )
    assert real.fsr_note == 64
    for signal in real.signals.values():
        assert np.all(np.diff(signal.time) > 0)
    on = [e for e in real.notes["real"] if e.on]
    assert len(on) == len(real.strikes)
    assert all(isinstance(e.velocity, int) and 1 <= e.velocity <= 127 and e.note == 64 for e in on)


@pytest.mark.parametrize("name", PARAMETERS)
def test_parameter_errors_move_what_they_name(name: str) -> None:
    changed = differs(
        simulate_commands(
            commands(), Case({}, {name: 1.2}, repeatability=0.0, noise=0.0), rounded=False
        ),
        nominal(),
    )
    expected = {"fsr_gain": {FORCE}, "midi_velocity_gain": {"midi"}}.get(
        name, {ANGLE, FORCE, "midi"}
    )
    assert changed == expected


def test_drawn_cases_are_of_their_kind() -> None:
    for seed in range(30):
        for kind in KINDS:
            case = draw_case(seed, kind)
            assert case == draw_case(seed, kind)
            assert len(case.effects) == {"effect": 1, "unknown": 1, "two": 2}.get(kind, 0)
            assert all(
                EFFECTS[n].in_library != (kind == "unknown") and 1 <= m <= 10
                for n, m in case.effects.items()
            )
            assert len({EFFECTS[n].stage for n in case.effects}) == len(case.effects)
            assert all(0.8 <= factor <= 1.2 for factor in case.parameters.values())
            assert bool(case.parameters) != (kind == "none")
            assert Case.from_json(case.to_json()) == case


def test_bad_input_gives_one_clear_error() -> None:
    with pytest.raises(ConfigError, match="did you mean 'key_friction'"):
        parse_effects("key_fricton=3")
    with pytest.raises(ConfigError, match="write name=magnitude"):
        parse_effects("key_friction=much")
    with pytest.raises(ConfigError, match="unknown parameter"):
        Case(parameters={"joint_stifness": 1.1})
    with pytest.raises(ConfigError, match="out of range"):
        scaled("hammer", -1.0)
