"""The twin's MuJoCo model, from the configuration of the cell, and the parameters that can change
without recompiling.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.cell.motion.geometry import FINGERS, Hand, Keyboard, hand, keyboard, pivot_radius
from pianobot_ros.cell.numbers.nominal import PARAMETERS, check_factors, stiffness_calibration
from pianobot_ros.piano.twin.model.arm import add_arm
from pianobot_ros.piano.twin.model.hand import abduction_joint, add_hand, flexion_joints, tip_geom
from pianobot_ros.piano.twin.model.keyboard import (
    IMPEDANCE,
    add_key,
    add_stops,
    direct_solref,
    key_geom,
    key_joint,
    rest_tendon,
    touch_sensor,
)
from pianobot_ros.piano.twin.reduced.strike_laws import stable_armature

if TYPE_CHECKING:
    from pianobot_ros.piano.action.mujoco.felt_hinge import FeltActions
    from pianobot_ros.piano.action.mujoco.mujoco_parts import Switchboard

__all__ = [
    "MECHANISMS",
    "PARAMETERS",
    "TIMESTEP",
    "TwinModel",
    "TwinOptions",
    "build_spec",
    "build_twin",
    "stiffness_at",
    "switchboard",
]


TIMESTEP = 4e-4
"""Step of the physics, s: ten times less changes peak force, V_pre and T_hold (so T_idle) by
less than 1 %, V_rel by less than 0.5 % (tests/piano/twin).
"""


SLEEP_SPEED = 1e-9
"""rad/s below which a key that nothing touches is put to sleep: MuJoCo leaves it out of the step
until it is touched. No angle and no force changes by it.
"""

MECHANISMS = ("spring", "action", "felt")

STICK_RATE = 1000.0
"""1/s at which what is left of a sticking fingertip's slip dies out."""

STICK_RATIO = 1e8
"""``impratio``: makes stick rigid while the contact normal is as soft as the pad. A sticking tip
creeps at (inverse mass) x (friction) / (IMPEDANCE x STICK_RATIO x STICK_RATE), some 0.1 mm/s; at
1e6 the force of a held key fell by a quarter in a second. What the slip adds to the normal force is
pad.friction x STICK_RATE x IMPEDANCE x (tip mass) x slip, some 1e-4 N.
"""

SOLVER_TOLERANCE = 1e-13
"""MuJoCo takes it relative to the mean inertia, which the arm's rotors make large: at 1e-10 a light
touch is off by 0.6 %.
"""


@lru_cache(maxsize=1)
def _curve() -> PchipInterpolator:
    table = stiffness_calibration()
    order = np.argsort(table.pressure)
    return PchipInterpolator(np.array(table.pressure)[order], np.array(table.stiffness)[order])


def stiffness_at(pressure: ArrayLike) -> Array:
    """Joint stiffness, N m/rad, at a vacuum pressure (any shape), Pa gauge; held beyond the
    calibrated range.
    """
    curve = _curve()
    return np.asarray(curve(np.clip(pressure, curve.x[0], curve.x[-1])))


@dataclass(frozen=True)
class TwinOptions:
    """What the model holds.

    ``fingers`` and ``notes`` (None: all twelve keys) may be reduced to the striking finger and its
    key; ``mechanism`` is ``spring`` (the soft-hand paper's spring and damper), ``action`` (the
    piano action of the other paper) or ``felt`` (its key and hammer with felt at coupler, rails and
    string); ``parts`` what the action has beyond the paper's (``string``, ``let_off``,
    ``repetition_lever``, ``backcheck``); ``timestep`` s; ``parameters`` factors by name out of
    :data:`PARAMETERS`.
    """

    fingers: tuple[str, ...] = FINGERS
    notes: tuple[int, ...] | None = None
    mechanism: str = "spring"
    parts: frozenset[str] = frozenset()
    timestep: float = TIMESTEP
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.fingers:
            if name not in FINGERS:
                raise ConfigError(unknown_name("finger", name, FINGERS))
        check_factors(self.parameters, PARAMETERS)
        if self.mechanism not in MECHANISMS:
            raise ConfigError(unknown_name("key mechanism", self.mechanism, MECHANISMS))
        if self.parts and self.mechanism != "action":
            raise ConfigError("only the mechanism 'action' has parts: choose it, or give no parts")
        if not 1e-6 <= self.timestep <= 5e-4:
            raise ConfigError(
                f"the physics step is {self.timestep} s: give 1e-6 to 5e-4, beyond which stiff"
                " joints diverge"
            )

    def factor(self, name: str) -> float:
        """The factor of a parameter, 1 if it is not given."""
        return float(self.parameters.get(name, 1.0))


class TwinModel:
    """A compiled model with its indices. The setters change ``model`` in place, in microseconds.

    Dampers are implicit in a way that the constraint solver sees too: with c h as armature, (M + c
    h) dv = h (f - c v) is M dv = h (f - c (v + dv)). MuJoCo's own implicit dampers come after the
    solver, which then takes a tip for half as heavy as the step makes it, so that friction neither
    stops nor lets go when it should. V_rel was 1.9 % off by that where a tip sticks and slips on a
    black key.
    The actions' dampers are switched and act between two bodies, which armature cannot do: with
    ``mechanism="action"`` MuJoCo's own stay.

    Attributes, among others: ``timestep`` s, of the physics; ``implicit`` s, armature for a damper
    of 1: the step, or 0 where MuJoCo's own dampers act.
    """

    def __init__(
        self, model: mujoco.MjModel, options: TwinOptions, hand_model: Hand, board: Keyboard
    ) -> None:
        self.model, self.options, self.hand, self.board = model, options, hand_model, board
        self.timestep = float(model.opt.timestep)  # once: MuJoCo wraps its options at each look
        self.notes = options.notes or board.notes
        self.key_qpos = np.array([model.joint(key_joint(n)).qposadr[0] for n in self.notes])
        self.key_dof = np.array([model.joint(key_joint(n)).dofadr[0] for n in self.notes])
        self.force_index = np.array([model.sensor(touch_sensor(n)).adr[0] for n in self.notes])
        self._flexion = {
            f: np.array([model.joint(j).id for j in flexion_joints(f, hand_model)])
            for f in options.fingers
        }
        self._abduction = {f: model.joint(abduction_joint(f)).id for f in options.fingers}
        self.radius = np.array([pivot_radius(n, board) for n in self.notes])
        self._key_joint = np.array([model.joint(key_joint(n)).id for n in self.notes])
        self._key_body = model.jnt_bodyid[self._key_joint]
        self._nominal_inertia = model.body_inertia[self._key_body].copy()
        self._nominal_mass = model.body_mass[self._key_body].copy()
        spring = options.mechanism == "spring"
        self._rest = (
            np.array([model.tendon(rest_tendon(n)).id for n in self.notes])
            if spring
            else np.zeros(0, dtype=int)
        )
        if spring and board.mechanism.felted:  # acts in each step (StepLaws)
            model.jnt_limited[self._key_joint] = 0
            model.tendon_limited[self._rest] = 0
        self.implicit = 0.0 if options.mechanism == "action" else self.timestep
        model.dof_armature[:] += self.implicit * model.dof_damping
        model.dof_armature[:6] += self.implicit * -model.actuator_biasprm[:6, 2]
        self.set_parameters(options.parameters)
        self.set_pressure(np.zeros(3))

    @property
    def damping(self) -> float:
        """Damping of the finger joints, N m s/rad."""
        return self.hand.joints.damping * self.options.factor("joint_damping")

    def set_stiffness(self, finger: str, stiffness: float) -> None:
        """Stiffness of the finger's hinges, N m/rad; the abduction joint gets its multiple."""
        m = self.model
        k = stiffness * self.options.factor("joint_stiffness")
        c = self.damping
        flexion, abduction = self._flexion[finger], self._abduction[finger]
        m.jnt_stiffness[flexion] = k
        m.jnt_stiffness[abduction] = k * self.hand.joints.abduction_ratio
        along, across = m.jnt_dofadr[flexion], m.jnt_dofadr[abduction]
        m.dof_damping[along] = m.dof_damping[across] = c
        m.dof_armature[along] = self.implicit * c + stable_armature(k, c, self.timestep)
        m.dof_armature[across] = self.implicit * c

    def set_pressure(self, pressure: ArrayLike, factors: ArrayLike = 1.0) -> None:
        """Stiffness of every finger by the calibration from the vacuum (3,) of thumb, index and
        middle, Pa gauge; ``factors`` (3,) on it.
        """
        for name, k in zip(
            FINGERS, np.multiply(stiffness_at(pressure), factors).tolist(), strict=True
        ):
            if name in self._flexion:
                self.set_stiffness(name, k)

    def set_parameters(self, parameters: Mapping[str, float]) -> None:
        """Set the factors; what is not named is nominal. The joints' follow with the next stiffness
        or pressure.
        """
        self.options = replace(self.options, parameters=dict(parameters))
        if self.options.mechanism == "spring":
            self._set_keys()
        self._set_contacts()

    def _set_keys(self) -> None:
        m, mechanism, factor = self.model, self.board.mechanism, self.options.factor
        square = mechanism.reference_radius**2
        joint, dof, tendon = self._key_joint, self.key_dof, self._rest
        m.jnt_stiffness[joint] = mechanism.stiffness * factor("key_stiffness")
        m.dof_damping[dof] = mechanism.damping * factor("key_damping")
        m.body_inertia[self._key_body] = self._nominal_inertia * factor("key_inertia")
        m.body_mass[self._key_body] = self._nominal_mass * factor("key_inertia")
        m.dof_armature[dof] = (
            mechanism.added_inertia * factor("key_inertia") + self.implicit * m.dof_damping[dof]
        )
        inverse = m.dof_invweight0[dof]
        m.jnt_solref[joint] = direct_solref(
            square * mechanism.stop_stiffness, square * mechanism.stop_damping, inverse
        )
        # a soft constraint's damper is explicit: one that stops the key within a step is as much as
        # it can give
        most = 1.0 / (inverse * self.timestep)
        m.tendon_solref_lim[tendon] = direct_solref(
            square * mechanism.rest_stiffness,
            np.minimum(square * mechanism.rest_damping, most),
            m.tendon_invweight0[tendon],
        )

    def _set_contacts(self) -> None:
        m, pad = self.model, self.hand.pad
        inverse_mass = (
            m.body_invweight0[m.geom_bodyid[m.pair_geom1], 0]
            + m.body_invweight0[m.geom_bodyid[m.pair_geom2], 0]
        )
        m.pair_solref[:] = direct_solref(pad.stiffness, pad.damping, inverse_mass)
        m.pair_friction[:, :2] = pad.friction


def build_spec(options: TwinOptions | None = None) -> mujoco.MjSpec:
    """The model as an editable MjSpec."""
    options = options or TwinOptions()
    hand_model, board = hand(), keyboard()
    notes = options.notes or board.notes
    spec = mujoco.MjSpec()
    spec.modelname = "pianobot"
    spec.compiler.degree = False
    spec.option.timestep = options.timestep
    if options.mechanism == "action":
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    else:
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    spec.option.sleep_tolerance = SLEEP_SPEED
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = STICK_RATIO
    spec.option.tolerance = SOLVER_TOLERANCE
    spec.option.gravity = [0.0, 0.0, -9.81]
    wrist = add_arm(spec)
    add_hand(wrist, hand_model, options.fingers, float(stiffness_at(0.0)), 1.0)
    for note in notes:
        add_key(spec, note, board)
        if options.mechanism == "spring":
            add_stops(spec, note, board)
        elif options.mechanism == "action":
            _add_action(spec, note, board, options.parts)
        else:
            _add_felt(spec, note, board)
        for finger in options.fingers:
            spec.add_pair(
                name=f"{tip_geom(finger)}_{key_geom(note)}",
                geomname1=tip_geom(finger),
                geomname2=key_geom(note),
                condim=3,
                friction=[hand_model.pad.friction, hand_model.pad.friction, 0.005, 1e-4, 1e-4],
                solimp=[IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0],
                solref=[-1.0, -1.0],
                solreffriction=[-1e-12, -STICK_RATE * IMPEDANCE],
            )
    return spec


def _add_action(spec: mujoco.MjSpec, note: int, board: Keyboard, parts: frozenset[str]) -> None:
    from pianobot_ros.piano.action.mujoco.hinge import add_action_mechanism

    add_action_mechanism(
        spec, key_geom(note), key_joint(note), radius=pivot_radius(note, board), parts=parts
    )


def _add_felt(spec: mujoco.MjSpec, note: int, board: Keyboard) -> None:
    from pianobot_ros.piano.action.mujoco.felt_hinge import add_felt_key

    add_felt_key(spec, key_geom(note), key_joint(note), radius=pivot_radius(note, board))


def switchboard(twin: TwinModel) -> Switchboard | FeltActions | None:
    """What acts in the keys' actions from step to step, or None if nothing in them remembers."""
    if twin.options.mechanism == "felt":
        from pianobot_ros.piano.action.mujoco.felt_hinge import FeltActions

        return FeltActions(twin.model, [key_joint(n) for n in twin.notes], twin.radius)
    if not twin.options.parts:
        return None
    from pianobot_ros.piano.action import load_parameters
    from pianobot_ros.piano.action.mujoco.hinge import attachment, hinged_action
    from pianobot_ros.piano.action.mujoco.mujoco_parts import Switchboard, has_memory

    parameters = load_parameters()
    action = hinged_action(parameters, twin.options.parts)
    if not has_memory(action):
        return None
    places = [
        attachment(parameters, key_joint(n), pivot_radius(n, twin.board), parts=twin.options.parts)
        for n in twin.notes
    ]
    return Switchboard(twin.model, action, places)


def build_twin(options: TwinOptions | None = None) -> TwinModel:
    """The compiled twin."""
    options = options or TwinOptions()
    return TwinModel(build_spec(options).compile(), options, hand(), keyboard())
