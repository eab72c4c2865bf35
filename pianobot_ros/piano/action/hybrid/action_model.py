"""The hybrid action as elements and rules: the paper's four modes (Fig. 8, Table 3), and the parts
it leaves for later.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.piano.action.hybrid.elements import (
    FORCE,
    HAMMER,
    KEY,
    ONE,
    Bodies,
    Element,
    Mode,
    Rule,
    row,
)
from pianobot_ros.piano.action.hybrid.parts import (
    LEVER,
    after_let_off_part,
    back_rail_part,
    contact,
    let_off_part,
    position_contact,
    string_part,
    table_three_rules,
)
from pianobot_ros.piano.action.hybrid.propagate import Propagator
from pianobot_ros.piano.action.parameters import ActionParameters

__all__ = ["PAPER", "PARTS", "ActionModel", "build_model", "mode_name"]


PARTS = frozenset({"back_rail", "string", "let_off", "repetition_lever", "backcheck"})
PAPER: frozenset[str] = frozenset()  # Fig. 8 has none of the extra parts
_CARRIERS = frozenset({"coupler", "check", "support"}) | LEVER


def mode_name(mode: Mode) -> str:
    """Name of the submodel of Fig. 8: ``ACCELERATION``, ``FREE FLIGHT``, ``RAIL STOP`` or
    ``REPETITION``.

    With the extra parts, whatever carries the hammer counts as the coupler.
    """
    carried, bottomed = bool(mode & _CARRIERS), "front_rail" in mode
    if bottomed:
        return "REPETITION" if carried else "RAIL STOP"
    return "ACCELERATION" if carried else "FREE FLIGHT"


@dataclass(frozen=True)
class ActionModel:
    """Bodies, elements and rules of a hybrid action; ``parts`` says which of :data:`PARTS` it
    has.
    """

    parameters: ActionParameters
    parts: frozenset[str]
    bodies: Bodies
    elements: dict[str, Element]
    rules: tuple[Rule, ...]
    _propagators: dict[Mode, Propagator] = field(default_factory=dict, repr=False, compare=False)

    def propagator(self, mode: Mode) -> Propagator:
        """What propagates states in ``mode``; made once."""
        if mode not in self._propagators:
            a = self.bodies.dynamics([e for n, e in self.elements.items() if n in mode])
            self._propagators[mode] = Propagator(a)
        return self._propagators[mode]

    def dynamics(self, mode: Mode) -> Array:
        """A (8, 8) of z' = A z in ``mode``."""
        return self.propagator(mode).a

    def load_cell(self, mode: Mode) -> Array:
        """Functional that gives the force between armature and key [N] in ``mode``."""
        a = self.parameters.armature
        acceleration = self.dynamics(mode)[1]
        flexure = row({KEY: a.stiffness, KEY + 1: a.damping, ONE: -a.stiffness * self.bodies.home})
        return np.asarray(row({FORCE: 1.0}) - a.mass * acceleration - flexure)

    def equilibrium(self, mode: Mode, force: float = 0.0) -> Array:
        """State (8,) at rest in ``mode`` under a constant ``force`` [N]. Raises
        :class:`ConfigError` if there is none.
        """
        a = self.dynamics(mode)
        z = row({ONE: 1.0, FORCE: force})
        try:
            z[[KEY, HAMMER]] = np.linalg.solve(a[np.ix_([1, 3], [KEY, HAMMER])], -(a[[1, 3]] @ z))
        except np.linalg.LinAlgError as error:
            raise ConfigError(
                "nothing carries the hammer in this mode, so it has no rest position"
            ) from error
        return z

    def rest(self) -> tuple[Mode, Array]:
        """Mode and state (8,) before the key is touched.

        With a back rail the key lies on it. Without, as on the paper's rig, ``initial_state.start``
        blends between the static equilibrium on the flexure (0) and key and hammer both at 0 (1).
        """
        carried: Mode = frozenset({"coupler", "jack"})
        if "back_rail" in self.parts:
            mode = carried | {"back_rail"}
            return mode, self.equilibrium(mode)
        z = self.equilibrium(carried)
        z[[KEY, HAMMER]] *= 1.0 - self.parameters.initial_state.start
        return carried, z

    def energy(self, mode: Mode, z: Array) -> Array:
        """Energy [J] of states ``z`` (..., 8) in ``mode``: it cannot grow while the driving force
        is zero.
        """
        jack = "jack" in mode
        idle = {"let_off", "let_off_hold", *LEVER, "support" if jack else "coupler"}
        if "check" not in mode:
            idle.add("check")
        total = self.bodies.energy(z)
        for element in self.elements.values():
            if element.name not in idle:
                total = total + element.stored(z)
        if "let_off" in self.parts:
            total = total + self._let_off_energy(z)
        if "repetition_lever" in self.parts and not jack:
            total = total + self._lever_energy(z)
        return total

    def _let_off_energy(self, z: Array) -> Array:
        ramp, hold = self.elements["let_off"], self.elements["let_off_hold"]
        full = ramp.offset + hold.preload / ramp.stiffness if hold.preload else ramp.offset
        stretch = np.clip(z[..., KEY] - ramp.offset, 0.0, full - ramp.offset)
        return np.asarray(
            0.5 * ramp.stiffness * stretch**2 + hold.preload * np.maximum(z[..., KEY] - full, 0.0)
        )

    def _lever_energy(self, z: Array) -> Array:
        felt, spring = self.elements["lever"], self.elements["lever_yields"]
        top = np.minimum(z[..., KEY], -self.elements["lever_screw"].offset)
        stretch = np.maximum(top - z[..., HAMMER], 0.0)
        beyond = np.maximum(stretch - spring.offset, 0.0)
        inside = np.minimum(stretch, spring.offset)
        return np.asarray(
            0.5 * felt.stiffness * inside**2
            + spring.preload * beyond
            + 0.5 * spring.stiffness * beyond**2
        )


def build_model(
    parameters: ActionParameters,
    parts: frozenset[str] | set[str] = PAPER,
    *,
    rail_pulls: bool = True,
) -> ActionModel:
    """The hybrid action with the given extra ``parts``; none gives exactly Fig. 8 and Table 3.

    Table 3 ends the rail contact on position alone, so its damper briefly pulls the rising key.
    ``rail_pulls=False`` ends it when it would pull, as felt does and as MuJoCo's limits do.

    Raises :class:`ConfigError` for an unknown part, and for a repetition lever or backcheck without
    let-off.
    """
    for part in parts:
        if part not in PARTS:
            raise ConfigError(unknown_name("part", part, PARTS))
    if parts & {"repetition_lever", "backcheck"} and "let_off" not in parts:
        raise ConfigError(
            "repetition_lever and backcheck act only after let-off: add the part let_off"
        )
    if "let_off" in parts and "back_rail" not in parts:
        raise ConfigError(
            "with let_off the hammer no longer returns the key alone: add the part back_rail"
        )
    p, h = parameters, parameters.hammer
    bodies = Bodies(
        mass=p.moving_mass,
        damping=p.moving_damping,
        stiffness=p.armature.stiffness,
        home=p.initial_state.flexure_home,
        hammer_mass=h.mass,
        hammer_damping=h.bushing_damping,
        hammer_weight=h.weight,
    )
    elements = [
        Element("coupler", (1.0, -1.0), 0.0, h.coupler_stiffness, h.coupler_damping),
        Element("front_rail", (1.0, 0.0), p.key.dip, p.front_rail.stiffness, p.front_rail.damping),
    ]
    coupler, rail = elements
    rules = table_three_rules(coupler)
    rules += position_contact(rail) if rail_pulls else contact(rail)
    for name, build in (
        ("back_rail", back_rail_part),
        ("string", string_part),
        ("let_off", let_off_part),
    ):
        if name in parts:
            more, switching = build(p)
            elements += more
            rules += switching
    if "let_off" in parts:
        more, switching = after_let_off_part(p, parts, coupler)
        elements += more
        rules += switching
    return ActionModel(p, frozenset(parts), bodies, {e.name: e for e in elements}, tuple(rules))
