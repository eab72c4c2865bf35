"""The families' laws in the running twin: signals in pieces, and the same change as in the reduced
strike model.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pytest

from pianobot_ros.cell.errors import ConfigError
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.recordings.commands import Commands
from pianobot_ros.piano.gap.adoption.live_laws import LiveLaws, parse_effects
from pianobot_ros.piano.gap.effects import LIBRARY, NAMES
from pianobot_ros.piano.gap.effects.base import (
    Array,
    ForceLaw,
    Memory,
    PressureLaw,
    StrikeLaw,
    WristLaw,
    mechanics,
)
from pianobot_ros.piano.twin.model.cell_model import PARAMETERS
from pianobot_ros.piano.twin.reduced.strike_model import Stroke, strike_model
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin
from pianobot_ros.piano.twin.stepping.rollout import Run, play, reduced, strike_commands

TIME = 1e-3 * np.arange(1200)
FORCE = 4.0 * np.clip(np.sin(8.0 * TIME), 0.0, None)
HEIGHT = -0.01 * np.clip(np.sin(9.0 * TIME), 0.0, None)
PRESSURE = np.where(TIME > 0.3, -60e3, 0.0) + np.where(TIME > 0.8, 30e3, 0.0)
STRIKE = ("middle", 64)
LEVEL = -50e3
FINE = 1e-4  # s: a quarter of the live step, so that the laws are compared and not the steps

SIGNALS = [n for n, f in LIBRARY.items() if isinstance(f.law, (WristLaw, PressureLaw, ForceLaw))]
MECHANICAL: Mapping[str, dict[str, float]] = {
    "joint_friction": {"joint_friction": 0.1},
    "joint_backlash": {"joint_backlash": 0.03},
    "joint_hardening": {"joint_hardening": 1500.0},
    "jamming_hysteresis": {"jamming_hysteresis": 0.4, "jamming_yield": 0.01},
    "joint_creep": {"joint_creep": 0.3, "joint_creep_time": 0.08},
    "pad_compliance": {"pad_compliance": 2.0},
    "tip_slip": {"tip_slip": 0.5},
    "tip_offset": {"tip_offset": 8e-4},
    "key_friction": {"key_friction": 0.06},
    "key_preload": {"key_preload": 0.08},
    "hammer": {"hammer": 0.06},
    "let_off": {"let_off": 0.5},
    "felt_nonlinear": {"felt_nonlinear": 1.0},
}
# the hammer comes back down within 2 ms: a step more or less there is a tenth of the change
LOOSE: Mapping[str, float] = {"hammer": 0.13}


def values(name: str, start: Mapping[str, float]) -> dict[str, float]:
    """All parameters of a family."""
    return {p.name: p.nominal for p in LIBRARY[name].parameters} | dict(start)


def laws(name: str, start: Mapping[str, float]) -> LiveLaws:
    """The family alone, as the running twin takes it."""
    return LiveLaws(parse_effects([f"{name}.{n}={x!r}" for n, x in start.items()]))


@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_in_pieces_comes_out_as_the_whole(name: str) -> None:
    law, v = LIBRARY[name].law, values(name, LIBRARY[name].starts[-1])

    def act(cut: slice, memory: Memory | None) -> Array:
        if isinstance(law, WristLaw):
            return np.asarray(law.height(v, TIME[cut], HEIGHT[cut], FORCE[cut], memory))
        if isinstance(law, PressureLaw):
            return np.asarray(law.pressure(v, TIME[cut], PRESSURE[cut], memory))
        return np.asarray(law.read(v, TIME[cut], FORCE[cut], memory))

    whole = act(slice(None), None)
    memory, cuts = Memory(), [0, 1, 2, 7, 100, 311, 312, 900, 1200]
    parts = [act(slice(a, b), memory) for a, b in pairwise(cuts)]
    assert np.abs(np.concatenate(parts) - whole).max() < 1e-9 * max(np.abs(whole).max(), 1e-9)
    plain = {WristLaw: HEIGHT, PressureLaw: PRESSURE, ForceLaw: FORCE}[type(law)]
    assert np.abs(whole - plain).max() > 1e-3 * np.ptp(plain)


def live(own: LiveLaws | None, motion: StrikeMotion) -> Run:
    """A strike of the MuJoCo twin."""
    finger, note = STRIKE
    commands = strike_commands({finger: note}, motion, pressure=LEVEL)
    return play(commands, reduced(finger, note, timestep=FINE), laws=own)


def small(run: Run, numbers: Mapping[str, float] | None) -> Stroke:
    """The same strike by the reduced model, under the wrist's motion in ``run``."""
    model = strike_model(*STRIKE)
    every = round(1e-3 / FINE)
    t, pose = run.time[::every], run.pose[::every]
    start, end = float(t[0]) + 0.1, float(t[-1]) - 0.02
    return model.strike(model.input(t, pose[:, :3], pose[0, 3:], LEVEL, start, end), numbers)


@pytest.fixture(scope="module")
def nominal() -> tuple[Run, Stroke]:
    run = live(None, StrikeMotion(0.15, 0.014, 0.15))
    return run, small(run, None)


@pytest.mark.parametrize("name", MECHANICAL)
def test_a_mechanical_law_makes_the_same_change_in_both_models(
    name: str, nominal: tuple[Run, Stroke]
) -> None:
    before, model_before = nominal
    v = values(name, MECHANICAL[name])
    run = live(laws(name, MECHANICAL[name]), StrikeMotion(0.15, 0.014, 0.15))
    model = small(run, mechanics([LIBRARY[name]], dict.fromkeys(PARAMETERS, 1.0) | v))
    t = model.time
    changes, off = [], []
    for column, signal in ((0, "angle"), (2, "force")):
        old = getattr(model_before, signal)
        own = np.interp(t, run.time, run.key(64)[column])
        change = own - np.interp(t, before.time, before.key(64)[column])
        wanted = getattr(model, signal) - old
        changes.append(wanted / old.max())
        off.append((change - wanted) / old.max())
    share = float(np.sqrt(np.mean(np.square(off)) / np.mean(np.square(changes))))
    assert share < LOOSE.get(name, 0.05)


def test_every_family_acts_in_the_running_twin_or_on_its_stamps() -> None:
    for name in NAMES:
        effect = LIBRARY[name]
        own = laws(name, effect.starts[-1])
        acts = (
            isinstance(effect.law, StrikeLaw),
            own.wrist,
            own.vacuum,
            own.reading,
            own.triggers() != (0.0, 0.0),
            abs(own.velocity(60.0) - 60.0) > 0.01,
            any(own.late() for _ in range(40)),
            any(own.skews().values()),
        )
        assert any(acts), name


def test_wrist_and_vacuum_move_by_the_law() -> None:
    commands = strike_commands({"middle": 64}, StrikeMotion(0.15, 0.014, 0.15), pressure=LEVEL)
    plain = play(commands, reduced(*STRIKE))
    late = play(commands, reduced(*STRIKE), laws=laws("wrist_delay", {"wrist_delay": 0.02}))
    moved = np.interp(plain.time - 0.02, plain.time, plain.pose[:, 2])
    assert np.abs(late.pose[60:, 2] - moved[60:]).max() < 1e-6
    law = LIBRARY["wrist_compliance"].law
    for lag in (0.01, 0.002):
        soft = laws("wrist_compliance", {"wrist_compliance": 1e-3, "wrist_compliance_time": lag})
        yields = play(commands, reduced(*STRIKE), laws=soft)
        wanted = law.height(soft._v, yields.time, plain.pose[:, 2], yields.key(64)[2])
        change = wanted - plain.pose[:, 2]
        off = yields.pose[:, 2] - wanted
        assert np.sqrt(np.mean(off**2)) < 0.05 * np.sqrt(np.mean(change**2))
    twin = CellTwin(reduced(*STRIKE), laws=laws("pressure_lag", {"pressure_lag": 0.1}))
    twin.command_vacuum({"middle": -60e3})
    twin.step(round(0.1 / twin.cell.timestep))
    assert twin.vacuum[2] == pytest.approx(-60e3 * (1.0 - np.exp(-1.0)), rel=0.05)


def test_notes_are_told_as_the_laws_have_it() -> None:
    commands = strike_commands({"middle": 64}, StrikeMotion(0.15, 0.014, 0.15), pressure=LEVEL)

    def strike(name: str, **start: float) -> Run:
        return play(commands, reduced(*STRIKE), laws=laws(name, start))

    plain = play(commands, reduced(*STRIKE))
    late = strike("midi_latency", midi_latency=0.01)
    assert late.events[0].time - plain.events[0].time == pytest.approx(0.01)
    assert late.strokes[0].t_hold == pytest.approx(plain.strokes[0].t_hold)
    deep = strike("trigger_offset", trigger_offset=4e-3)
    assert deep.strokes[0].onset > plain.strokes[0].onset
    bent = strike("midi_velocity_curve", midi_velocity_curve=0.5)
    gain = keyboard().midi.velocity_gain
    velocity = LIBRARY["midi_velocity_curve"].law.velocity(
        values("midi_velocity_curve", {"midi_velocity_curve": 0.5}),
        np.array([plain.strokes[0].v_pre * gain]),
    )
    assert bent.strokes[0].v_pre * gain == pytest.approx(float(velocity[0]), rel=1e-6)


def test_corrections_come_and_go() -> None:
    commands: Commands = strike_commands({"middle": 64}, StrikeMotion(0.15, 0.014, 0.15))
    twin = CellTwin(reduced(*STRIKE), commands.pose[0])
    targets = commands.at_steps(twin.cell.timestep)
    first = twin.step(len(targets), targets).force
    several = {
        "joint_friction": 0.1,
        "tip_offset": 1e-3,
        "felt_thickness": 1e-3,
        "pad_softening": 1e-4,
        "pad_compliance": 1.0,
    }
    texts = [
        f"{n}.{p.name}={several[p.name]}"
        for n, f in LIBRARY.items()
        for p in f.parameters
        if p.name in several
    ]
    twin.correct(LiveLaws(parse_effects([*texts, "felt_nonlinear.felt_nonlinear=0.5"])))
    twin.reset()
    changed = twin.step(len(targets), targets).force
    assert np.abs(changed - first).max() > 0.05 * first.max()
    twin.correct(None)
    twin.reset()
    assert np.array_equal(twin.step(len(targets), targets).force, first)


REFUSED = {
    "key_friction.key_frictoin=0.1": "did you mean",
    "key_friction.key_friction=high": "from 0 to 0.3",
    "key_friction.key_friction=7": "from 0 to 0.3",
}


@pytest.mark.parametrize(("text", "said"), REFUSED.items())
def test_effects_are_refused_in_one_line(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse_effects([text])
