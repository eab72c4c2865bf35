"""Reduced strike model, MuJoCo twin and plant are three solutions of the same nominal laws, on
white keys and on black ones.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from pianobot_ros.cell.motion.geometry import FINGERS, keyboard
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.laws.row_layout import ANGLE, KEY_INERTIA, NORMAL, TOP
from pianobot_ros.emulator.plant.mechanics.plant_model import PlantModel
from pianobot_ros.piano.twin.model.arm import ArmTracker
from pianobot_ros.piano.twin.model.keyboard import key_inertia
from pianobot_ros.piano.twin.reduced.strike_geometry import key_model
from pianobot_ros.piano.twin.reduced.strike_model import Stroke, key_strokes, strike_model
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin
from pianobot_ros.piano.twin.stepping.rollout import Run, play, reduced, strike_commands


class Wanted(NamedTuple):
    """A strike, and the vacuum Pa that it is played with."""

    finger: str
    note: int
    motion: StrikeMotion
    pressure: float


@pytest.fixture(params=["paper", "acoustic"])
def keys(request: pytest.FixtureRequest, choose_keys: Callable[[str], None]) -> str:
    """The keys in force."""
    choose_keys(request.param)
    return str(request.param)


@pytest.fixture(params=[(0.1, 0.0), (0.25, -100e3)], ids=["slow", "fast"])
def wanted(request: pytest.FixtureRequest, keys: str, finger: str, note: int) -> Wanted:
    """Slow by a soft finger or fast by a stiff one, white key or black, on either keys."""
    speed, pressure = request.param
    return Wanted(finger, note, StrikeMotion(speed, 0.014, 0.15), pressure)


on_white_and_black = pytest.mark.parametrize(
    ("finger", "note"), [("middle", 64), ("thumb", 62), ("middle", 66), ("thumb", 61)]
)


def both(finger: str, note: int, motion: StrikeMotion, pressure: float) -> tuple[Run, Stroke]:
    """The same strike by the twin and by the reduced model."""
    run = play(strike_commands({finger: note}, motion, pressure=pressure), reduced(finger, note))
    model = strike_model(finger, note)
    every = max(1, round(1e-3 / float(np.median(np.diff(run.time)))))
    time, pose = run.time[::every], run.pose[::every]
    given = model.input(
        time, pose[:, :3], pose[0, 3:], pressure, float(time[0]) + 0.02, float(time[-1]) - 0.02
    )
    return run, model.strike(given)


@on_white_and_black
def test_same_strike(wanted: Wanted) -> None:
    finger, note, motion, pressure = wanted
    run, stroke = both(finger, note, motion, pressure)
    angle, _, force = run.key(note)
    real_angle, real_force = (
        np.interp(stroke.time, run.time, angle),
        np.interp(stroke.time, run.time, force),
    )
    assert np.sqrt(np.mean((stroke.angle - real_angle) ** 2)) < 0.01 * real_angle.max()
    assert np.sqrt(np.mean((stroke.force - real_force) ** 2)) < 0.01 * real_force.max()
    assert stroke.force.max() == pytest.approx(force.max(), rel=0.01)
    middle = (stroke.time > stroke.time[0] + 0.4 * np.ptp(stroke.time)) & (
        stroke.time < stroke.time[0] + 0.6 * np.ptp(stroke.time)
    )
    assert np.mean(stroke.force[middle]) == pytest.approx(np.mean(real_force[middle]), rel=0.005)
    (ours,) = key_strokes(stroke, note, key_model(note).radius, keyboard().midi)
    (theirs,) = run.strokes
    # Dahl's friction gives way before it slips, MuJoCo's does not
    late, slow = (1e-3, 0.02) if key_model(note).friction else (5e-4, 0.01)
    assert ours.onset == pytest.approx(theirs.onset, abs=late)
    assert ours.v_pre == pytest.approx(theirs.v_pre, rel=slow)
    assert ours.t_hold == pytest.approx(theirs.t_hold, rel=0.01)


def test_a_sticking_fingertip_does_not_creep() -> None:
    """Coulomb's friction holds: a hand that stands still presses a second later as before."""
    commands = strike_commands({"middle": 64}, StrikeMotion(0.1, 0.013, 1.5), pressure=-50e3)
    twin = CellTwin(reduced("middle", 64), commands.pose[0])
    twin.command_vacuum(dict.fromkeys(FINGERS, -50e3))
    force = twin.step(round(1.8 / twin.cell.timestep), commands.at_steps(twin.cell.timestep)).force[
        :, 0
    ]
    early, late = force[round(0.8 / twin.cell.timestep)], force[-1]
    assert late == pytest.approx(early, rel=0.01)


@on_white_and_black
def test_the_plant_plays_the_same_strike(wanted: Wanted) -> None:
    finger, note, motion, pressure = wanted
    commands = strike_commands({finger: note}, motion, pressure=pressure)
    _, pose, twist = ArmTracker(1e-3, commands.pose[0]).advance(commands.at_steps(1e-3))
    plant = PlantModel(Case(repeatability=0.0), fingers=[FINGERS.index(finger)])
    key = keyboard().notes.index(note)
    last, felt = (commands.pose[0], np.zeros(6)), np.empty((len(pose), 2))
    for i, state in enumerate(zip(pose, twist, strict=True)):
        plant.tick(*last, *state, np.full(3, pressure))
        last = state
        felt[i] = plant.state.keys[key, [NORMAL, ANGLE]]
    time = 1e-3 * np.arange(1, len(pose) + 1)
    model = strike_model(finger, note)
    stroke = model.strike(
        model.input(time, pose[:, :3], pose[0, 3:], pressure, 0.02, float(time[-1]) - 0.02)
    )
    force, angle = (np.interp(stroke.time, time, column) for column in felt.T)
    struck = key_model(note)
    either_way = 2 * struck.friction / struck.radius  # N: dry friction may hold the key up or down
    assert stroke.force.max() == pytest.approx(force.max(), rel=0.005, abs=either_way)
    assert np.sqrt(np.mean((stroke.force - force) ** 2)) < 0.005 * force.max() + 0.5 * either_way
    near = 0.003 if either_way else 0.002
    assert np.sqrt(np.mean((stroke.angle - angle) ** 2)) < near * angle.max()


@pytest.mark.parametrize("keys", ["paper", "digital"])
def test_a_key_comes_home_against_its_friction(
    keys: str, choose_keys: Callable[[str], None]
) -> None:
    choose_keys(keys)
    motion = StrikeMotion(0.2, 0.014, 0.1)
    run, stroke = both("middle", 64, motion, -50e3)
    commands = strike_commands({"middle": 64}, motion, pressure=-50e3)
    _, pose, twist = ArmTracker(1e-3, commands.pose[0]).advance(commands.at_steps(1e-3))
    plant, last = PlantModel(Case(repeatability=0.0)), (commands.pose[0], np.zeros(6))
    for state in zip(pose, twist, strict=True):
        plant.tick(*last, *state, np.full(3, -50e3))
        last = state
    ends = run.key(64)[0][-1], stroke.angle[-1], plant.state.keys[4, ANGLE]
    assert max(map(abs, ends)) < 2e-4


@pytest.mark.parametrize("note", [60, 61, 64, 66, 71])
def test_keys_are_the_same_wood_on_the_same_hinge(note: int) -> None:
    key, board = key_model(note), keyboard()
    plant = PlantModel(Case(), fingers=[0]).model
    row = plant.board[board.notes.index(note)]
    assert key.inertia == pytest.approx(key_inertia(note, board), rel=1e-12)
    assert row[KEY_INERTIA] == pytest.approx(key.inertia, rel=1e-12)
    assert key.hinge_z == plant.plant.hinge_z == board.origin[2]
    assert key.height == row[TOP] == (board.black.height if note in (61, 66) else 0.0)
