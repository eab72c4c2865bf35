"""The reduced strike model: statics by hand, convergence, consistency of its three ways of running,
and its limits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from one_strike import given

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.piano.twin.reduced.strike_geometry import finger_model, key_model, stiffness_of
from pianobot_ros.piano.twin.reduced.strike_kernel import _turned
from pianobot_ros.piano.twin.reduced.strike_laws import stribeck
from pianobot_ros.piano.twin.reduced.strike_model import (
    GRID,
    SUBSTEPS,
    StrikeModel,
    key_strokes,
)


@pytest.mark.parametrize(("finger", "note"), [("middle", 64), ("thumb", 62), ("middle", 66)])
@pytest.mark.parametrize("pressure", [0.0, -100e3])
def test_converged_within_one_percent(finger: str, note: int, pressure: float) -> None:
    model, motion = given(finger, note, speed=0.2, pressure=pressure)
    fine = StrikeModel(model.finger, model.key, 100).strike(motion)
    fast = model.strike(motion)
    assert fast.force.max() == pytest.approx(fine.force.max(), rel=0.01)
    assert np.sqrt(np.mean((fast.angle - fine.angle) ** 2)) < 0.01 * fine.angle.max()
    radius, midi = model.key.radius, keyboard().midi
    (a,), (b,) = (key_strokes(s, note, radius, midi) for s in (fast, fine))
    assert a.v_pre == pytest.approx(b.v_pre, rel=0.01)
    assert a.t_hold == pytest.approx(b.t_hold, abs=5e-4)


@pytest.mark.parametrize("stiffness", [0.05, 0.5, 2.0])
@pytest.mark.parametrize(("finger", "note"), [("middle", 64), ("thumb", 62), ("middle", 66)])
def test_all_four_of_eq_2_converge(finger: str, note: int, stiffness: float) -> None:
    """T_idle is T_N less T_hold; the trigger of the release lies above the rest stop's bounce."""
    model, motion = given(finger, note, speed=0.2)
    motion = replace(motion, stiffness=np.full_like(motion.stiffness, stiffness * 180 / np.pi))
    coarse, fine = (
        key_strokes(
            StrikeModel(model.finger, model.key, n).strike(motion),
            note,
            model.key.radius,
            keyboard().midi,
        )
        for n in (SUBSTEPS, 20 * SUBSTEPS)
    )
    assert len(coarse) == len(fine) == 1, "no second note from the bounce"
    a, b = (s[0].with_note_length(2.5) for s in (coarse, fine))
    for name in ("v_pre", "v_rel", "t_hold", "t_idle"):
        assert getattr(a, name) == pytest.approx(getattr(b, name), rel=0.005), name


@pytest.mark.parametrize("note", [64, 66])
def test_key_in_equilibrium_while_held(note: int) -> None:
    """While nothing moves, contact force times lever (with friction's part) balances the key's
    spring and its stop.
    """
    model, motion = given(note=note, hold=0.6)
    stroke = model.strike(motion)
    i = int(np.argmin(np.abs(motion.time - (motion.time[-1] + motion.time[0]) / 2)))
    key = model.key
    stop = key.stop_stiffness * max(stroke.angle[i] - key.max_angle, 0.0)
    assert stroke.force[i] * stroke.lever[i] == pytest.approx(
        key.stiffness * stroke.angle[i] + stop, rel=1e-3
    )


def test_hand_rests_without_touching_before_the_strike() -> None:
    model, motion = given()
    stroke = model.strike(motion)
    assert np.all(stroke.force[:40] == 0)
    assert np.abs(stroke.angle[:40]).max() < 1e-6


def test_splicing_its_own_angle_gives_its_own_force() -> None:
    model, motion = given()
    whole = model.strike(motion)
    alone = model.press(motion, whole.angle, whole.rate)
    assert np.sqrt(np.mean((alone.force - whole.force) ** 2)) < 0.02 * whole.force.max()


def test_splicing_its_own_force_gives_its_own_angle() -> None:
    model, motion = given()
    whole = model.strike(motion)
    alone = model.drive(whole.start, whole.force, whole.lever)
    assert np.sqrt(np.mean((alone.angle - whole.angle) ** 2)) < 0.01 * whole.angle.max()


@pytest.mark.parametrize(
    ("values", "quantity", "sign"),
    [
        ({"key_friction": 0.03}, "force", 1),
        ({"key_preload": 0.05}, "force", 1),
        ({"joint_stiffness": 1.3}, "force", 1),
        ({"joint_backlash": 0.03}, "force", -1),
        ({"joint_creep": 0.4}, "force", -1),
        ({"tip_drop": 1e-3}, "force", 1),
        ({"tip_slip": 0.8}, "force", -1),
        ({"pad_stiffness": 0.3}, "force", -1),
        ({"felt_thickness": 2e-3}, "angle", -1),
        ({"joint_hardening": 100.0}, "force", 1),
        ({"joint_hardening": 100.0, "joint_hardening_power": 1.0}, "force", 1),
        ({"jamming_hysteresis": 0.5, "jamming_yield": 0.01}, "force", -1),
    ],
)
def test_effects_push_the_held_key_where_physics_says(
    values: dict[str, float], quantity: str, sign: int
) -> None:
    model, motion = given(depth=0.016, hold=0.5, pressure=0.0)
    middle = slice(len(motion.time) // 2, len(motion.time) // 2 + 20)
    nominal, changed = model.strike(motion), model.strike(motion, values)
    difference = float(
        np.mean(getattr(changed, quantity)[middle] - getattr(nominal, quantity)[middle])
    )
    scale = float(getattr(nominal, quantity).max())
    assert sign * difference > (-1e-4 if "key_" in next(iter(values)) else 1e-4) * scale


def test_hammer_delays_the_note_and_vanishes_with_its_mass() -> None:
    model, motion = given(speed=0.25)
    radius, midi = model.key.radius, keyboard().midi
    onset = [
        key_strokes(model.strike(motion, {"hammer": m}), 64, radius, midi)[0].onset
        for m in (0.0, 1e-6, 0.05)
    ]
    assert onset[1] == pytest.approx(onset[0], abs=2e-5)
    assert onset[2] > onset[0]


def test_a_hammer_is_carried_at_the_bottom_unless_its_jack_has_escaped() -> None:
    model, motion = given(hold=0.6)
    middle = len(motion.time) // 2

    def held(**values: float) -> float:
        stroke = model.strike(motion, {"hammer": 0.05, **values})
        top = model.key.max_angle
        stop = model.key.stop_stiffness * max(stroke.angle[middle] - top, 0.0)
        spring = model.key.stiffness * stroke.angle[middle]
        return float(stroke.force[middle] * stroke.lever[middle] - spring - stop)

    carried = 0.05 * 5.0 * model.key.radius
    assert held(hammer_weight=5.0) == pytest.approx(carried, rel=0.05)
    assert held(hammer_weight=0.0) == pytest.approx(0.0, abs=0.05 * carried)
    assert held(hammer_weight=5.0, hammer_escape=0.035) == pytest.approx(0.0, abs=0.05 * carried)


def test_joint_friction_keeps_the_hand_where_the_last_strike_left_it() -> None:
    """Held up by friction, the tip touches later; on from there, the strike forgets."""
    model, motion = given(pressure=0.0)
    onset = []
    for rest in (0.0, -0.7):
        stroke = model.strike(motion, {"joint_friction": 0.01, "joint_friction_rest": rest})
        onset.append(np.flatnonzero(stroke.force > 0.02)[0])
    assert onset[0] != onset[1]


def test_friction_is_stronger_near_rest_by_its_static_share() -> None:
    assert stribeck(0.0, 0.4, 0.2) == pytest.approx(1.4)
    assert stribeck(-2.0, 0.4, 0.2) == pytest.approx(1.0, abs=1e-4)
    assert stribeck(0.1, 0.0, 0.2) == 1.0


def test_trigger_on_the_way_down_and_up() -> None:
    model, motion = given()
    (stroke,) = key_strokes(model.strike(motion), 64, model.key.radius, keyboard().midi)
    assert 0.05 < stroke.v_pre < 0.3
    assert 0.05 < stroke.v_rel < 0.5
    assert stroke.t_hold > 0.25


def test_key_inertia_of_a_box_on_its_edge() -> None:
    board, key = keyboard(), key_model(64)
    mass = board.density * board.white.pivot * board.white.width * board.white.thickness
    assert key.inertia == pytest.approx(
        mass * (board.white.pivot**2 + board.white.thickness**2) / 3
    )
    sharp = key_model(66)
    length, height = (
        board.white.pivot - board.black.front,
        board.white.thickness + board.black.height,
    )
    mass = board.density * length * board.black.width * height
    middle = board.black.height - height / 2
    assert sharp.inertia == pytest.approx(
        mass * ((length**2 + height**2) / 12 + (length / 2) ** 2 + middle**2)
    )


def test_finger_mass_matrix_is_positive_and_stiffness_grows_with_vacuum() -> None:
    for name in ("thumb", "index", "middle"):
        assert np.all(np.linalg.eigvalsh(finger_model(name).mass) > 0)
    assert np.all(np.diff(stiffness_of(np.array([0.0, -30e3, -60e3, -100e3]))) > 0)
    assert float(stiffness_of(-200e3)) == float(stiffness_of(-100e3))


def test_too_few_samples_of_the_wrist() -> None:
    model, _ = given()
    with pytest.raises(PianobotError, match="four samples"):
        model.input(np.arange(3.0), np.zeros((3, 3)), np.zeros(3), 0.0, 0.0, 1.0)


def test_grid_has_the_announced_spacing() -> None:
    _, motion = given()
    assert np.allclose(np.diff(motion.time), GRID)


def test_sines_of_near_angles_are_exact_to_rounding() -> None:
    known = np.full(3, np.inf)
    for angle in np.cumsum(np.random.default_rng(0).uniform(-0.02, 0.03, 2000)):
        assert _turned(angle, known) == pytest.approx((np.sin(angle), np.cos(angle)), abs=1e-14)
