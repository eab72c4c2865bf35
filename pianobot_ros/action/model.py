"""The hybrid action as elements and rules: the paper's four modes (Fig. 8, Table 3), and the parts it leaves for later."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.action.elements import (
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
from pianobot_ros.action.parameters import ActionParameters
from pianobot_ros.cell.errors import ConfigError, unknown_name

__all__ = ["PAPER", "PARTS", "ActionModel", "build_model", "mode_name"]

FloatArray = NDArray[np.float64]

PARTS = frozenset({"back_rail", "string", "let_off", "repetition_lever", "backcheck"})
PAPER: frozenset[str] = frozenset()  # Fig. 8 has none of the extra parts
_LEVER = frozenset({"lever", "lever_yields", "lever_screw", "lever_screw_yields"})
_NAMES = {"front_rail": ("bottom", "lift")}
_CARRIERS = frozenset({"coupler", "check", "support"}) | _LEVER


def mode_name(mode: Mode) -> str:
    """Name of the submodel of Fig. 8: ``ACCELERATION``, ``FREE FLIGHT``, ``RAIL STOP`` or ``REPETITION``.

    With the extra parts, whatever carries the hammer counts as the coupler.
    """
    carried, bottomed = bool(mode & _CARRIERS), "front_rail" in mode
    if bottomed:
        return "REPETITION" if carried else "RAIL STOP"
    return "ACCELERATION" if carried else "FREE FLIGHT"


@dataclass(frozen=True)
class ActionModel:
    """Bodies, elements and rules of a hybrid action; ``parts`` says which of :data:`PARTS` it has."""

    parameters: ActionParameters
    parts: frozenset[str]
    bodies: Bodies
    elements: dict[str, Element]
    rules: tuple[Rule, ...]
    _dynamics: dict[Mode, FloatArray] = field(default_factory=dict, repr=False, compare=False)

    def dynamics(self, mode: Mode) -> FloatArray:
        """A (8, 8) of z' = A z in ``mode``."""
        if mode not in self._dynamics:
            self._dynamics[mode] = self.bodies.dynamics([e for n, e in self.elements.items() if n in mode])
        return self._dynamics[mode]

    def load_cell(self, mode: Mode) -> FloatArray:
        """Functional that gives the force between armature and key [N] in ``mode``."""
        a = self.parameters.armature
        acceleration = self.dynamics(mode)[1]
        flexure = row({KEY: a.stiffness, KEY + 1: a.damping, ONE: -a.stiffness * self.bodies.home})
        return np.asarray(row({FORCE: 1.0}) - a.mass * acceleration - flexure)

    def equilibrium(self, mode: Mode, force: float = 0.0) -> FloatArray:
        """State (8,) at rest in ``mode`` under a constant ``force`` [N]. Raises :class:`ConfigError` if there is none."""
        a = self.dynamics(mode)
        z = row({ONE: 1.0, FORCE: force})
        try:
            z[[KEY, HAMMER]] = np.linalg.solve(a[np.ix_([1, 3], [KEY, HAMMER])], -(a[[1, 3]] @ z))
        except np.linalg.LinAlgError as error:
            raise ConfigError("nothing carries the hammer in this mode, so it has no rest position") from error
        return z

    def rest(self) -> tuple[Mode, FloatArray]:
        """Mode and state (8,) before the key is touched.

        With a back rail the key lies on it. Without, as on the paper's rig, ``initial_state.start`` blends between the
        static equilibrium on the flexure (0) and key and hammer both at 0 (1).
        """
        carried: Mode = frozenset({"coupler", "jack"})
        if "back_rail" in self.parts:
            mode = carried | {"back_rail"}
            return mode, self.equilibrium(mode)
        z = self.equilibrium(carried)
        z[[KEY, HAMMER]] *= 1.0 - self.parameters.initial_state.start
        return carried, z

    def energy(self, mode: Mode, z: FloatArray) -> FloatArray:
        """Energy [J] of states ``z`` (..., 8) in ``mode``: it cannot grow while the driving force is zero."""
        total = self.bodies.energy(z)
        for element in self.elements.values():
            if element.name in _LEVER or (element.name == "check" and "check" not in mode):
                continue
            if element.name == "coupler" and "jack" not in mode:
                continue
            if element.name in {"let_off", "let_off_hold"}:
                continue
            total = total + element.stored(z)
        if "let_off" in self.parts:
            total = total + self._let_off_energy(z)
        if "repetition_lever" in self.parts and "jack" not in mode:
            total = total + self._lever_energy(z)
        return total

    def _let_off_energy(self, z: FloatArray) -> FloatArray:
        ramp, hold = self.elements["let_off"], self.elements["let_off_hold"]
        full = ramp.offset + hold.preload / ramp.stiffness if hold.preload else ramp.offset
        stretch = np.clip(z[..., KEY] - ramp.offset, 0.0, full - ramp.offset)
        return np.asarray(0.5 * ramp.stiffness * stretch**2 + hold.preload * np.maximum(z[..., KEY] - full, 0.0))

    def _lever_energy(self, z: FloatArray) -> FloatArray:
        felt, spring = self.elements["lever"], self.elements["lever_yields"]
        top = np.minimum(z[..., KEY], -self.elements["lever_screw"].offset)
        stretch = np.maximum(top - z[..., HAMMER], 0.0)
        beyond = np.maximum(stretch - spring.offset, 0.0)
        inside = np.minimum(stretch, spring.offset)
        return np.asarray(
            0.5 * felt.stiffness * inside**2 + spring.preload * beyond + 0.5 * spring.stiffness * beyond**2
        )


def build_model(
    parameters: ActionParameters, parts: frozenset[str] | set[str] = PAPER, *, rail_pulls: bool = True
) -> ActionModel:
    """The hybrid action with the given extra ``parts``; none gives exactly Fig. 8 and Table 3.

    Table 3 ends the rail contact on position alone, so its damper briefly pulls the rising key. ``rail_pulls=False`` ends it
    when it would pull, as felt does and as MuJoCo's limits do.

    Raises :class:`ConfigError` for an unknown part, and for a repetition lever or backcheck without let-off.
    """
    for part in parts:
        if part not in PARTS:
            raise ConfigError(unknown_name("part", part, PARTS))
    if parts & {"repetition_lever", "backcheck"} and "let_off" not in parts:
        raise ConfigError("repetition_lever and backcheck act only after let-off: add the part let_off")
    if "let_off" in parts and "back_rail" not in parts:
        raise ConfigError("with let_off the hammer no longer returns the key alone: add the part back_rail")
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
    rules = _table_three(coupler)
    rules += _position_contact(rail) if rail_pulls else _contact(rail)
    for name, build in (("back_rail", _back_rail), ("string", _string), ("let_off", _let_off)):
        if name in parts:
            more, switching = build(p)
            elements += more
            rules += switching
    if "let_off" in parts:
        more, switching = _after_let_off(p, parts, coupler)
        elements += more
        rules += switching
    return ActionModel(p, frozenset(parts), bodies, {e.name: e for e in elements}, tuple(rules))


def _table_three(coupler: Element) -> list[Rule]:
    """Transitions a, b, e and f of Table 3: the coupler is made and broken on its own force."""
    c = frozenset({"coupler"})
    return [
        Rule("release", (-coupler.force,), needs=c, removes=c),
        Rule("land", (coupler.force,), needs=frozenset({"jack"}), bars=c, adds=c),
    ]


def _position_contact(element: Element) -> list[Rule]:
    """Transitions c, d, g and h of Table 3: the rail is made and broken on position."""
    own = frozenset({element.name})
    return [
        Rule("bottom", (element.stretch,), bars=own, adds=own),
        Rule("lift", (-element.stretch,), needs=own, removes=own),
    ]


def _contact(element: Element, needs: Mode = frozenset(), bars: Mode = frozenset()) -> list[Rule]:
    """A contact that can only push: made when it is closed and would push, broken when it would pull."""
    own = frozenset({element.name})
    made, broken = _NAMES.get(element.name, (f"{element.name} made", f"{element.name} broken"))
    return [
        Rule(made, (element.stretch, element.force), needs=needs, bars=bars | own, adds=own),
        Rule(broken, (-element.force,), needs=own, removes=own),
    ]


def _back_rail(p: ActionParameters) -> tuple[list[Element], list[Rule]]:
    rail = Element("back_rail", (-1.0, 0.0), 0.0, p.back_rail.stiffness, p.back_rail.damping)
    return [rail], _contact(rail)


def _string(p: ActionParameters) -> tuple[list[Element], list[Rule]]:
    string = Element("string", (0.0, 1.0), p.string.height, p.string.stiffness, p.string.damping)
    return [string], _contact(string)


def _let_off(p: ActionParameters) -> tuple[list[Element], list[Rule]]:
    """The jack meets the let-off button over a ramp, and is out at its end; past it the key bears a constant resistance."""
    escape, ramp = p.string.height - p.let_off.margin, p.let_off.ramp
    resistance = p.let_off.resistance
    on = Element("let_off", (1.0, 0.0), escape - ramp, resistance / ramp)
    hold = Element("let_off_hold", (1.0, 0.0), escape, preload=resistance)
    a, b = frozenset({"let_off"}), frozenset({"let_off_hold"})
    past = row({KEY: 1.0, ONE: -escape})
    return [on, hold], [
        Rule("let-off begins", (on.stretch, -past), bars=a | b, adds=a),
        Rule("let-off ends", (-on.stretch,), needs=a, removes=a),
        Rule("let-off full", (past,), needs=a, removes=a, adds=b),
        Rule("let-off eases", (-past,), needs=b, removes=b, adds=a),
    ]


def _after_let_off(
    p: ActionParameters, parts: frozenset[str] | set[str], coupler: Element
) -> tuple[list[Element], list[Rule]]:
    """Escapement and reset of the jack, and what carries the hammer in between.

    With a repetition lever that is the lever, and below it the whippen; without, only the check and the hammer rest rail: the
    jack stands beside the knuckle and cannot lift it.
    """
    jack = frozenset({"jack"})
    lever = "repetition_lever" in parts
    escape = p.string.height - p.let_off.margin
    past = row({KEY: 1.0, ONE: -escape})
    back = row({KEY: -1.0, ONE: escape - p.let_off.hysteresis})
    seat = p.support.rest_rail if lever else p.support.rest_rail_single
    whippen = Element("support", (1.0, -1.0), p.support.drop, p.support.stiffness, p.support.damping)
    rest = Element("rest_rail", (0.0, -1.0), -seat, p.support.stiffness, p.support.damping)
    elements = [rest]
    rules = _contact(rest)
    if lever:
        more, switching = _lever(p, coupler, escape)
        elements += [whippen, *more]
        rules += [*_contact(whippen, bars=jack), *switching]
        yields = p.repetition_lever.preload / coupler.stiffness
        # The lever stands level with the jack, so the jack slips back as soon as the lever is up, under load or not.
        up = row({KEY: -1.0, HAMMER: 1.0, ONE: yields})
        loaded = frozenset({"lever"})
        rules += [
            Rule("jack back, loaded", (back, up), loaded, jack | {"check"}, jack | {"coupler"}, _LEVER | {"support"})
        ]
    else:
        up = -coupler.stretch  # only a hammer that rides above the jack lets it slip back
    rules += [
        Rule("jack out", (past,), jack, removes=jack | {"coupler"}),
        Rule("jack back", (back, up), bars=jack | {"check", "lever"}, adds=jack, removes=_LEVER | {"support"}),
    ]
    if "backcheck" in parts:
        more, switching = _backcheck(p, coupler)
        elements += more
        rules += switching
    return elements, rules


def _lever(p: ActionParameters, coupler: Element, escape: float) -> tuple[list[Element], list[Rule]]:
    """Repetition lever: felt against the knuckle, a sprung lever that yields beyond its preload, and the drop screw.

    Up to the drop screw it moves with the key; beyond, the screw stops it, so that it cannot press the hammer on the string.
    """
    r = p.repetition_lever
    drop = escape - r.drop
    yields = r.preload / coupler.stiffness
    low = Element("lever", (1.0, -1.0), 0.0, coupler.stiffness, coupler.damping)
    low_soft = Element("lever_yields", (1.0, -1.0), yields, r.stiffness, r.damping, r.preload)
    high = Element("lever_screw", (0.0, -1.0), -drop, coupler.stiffness, coupler.damping)
    high_soft = Element("lever_screw_yields", (0.0, -1.0), yields - drop, r.stiffness, r.damping, r.preload)
    above = row({KEY: 1.0, ONE: -drop})
    rules: list[Rule] = []
    for felt, spring, side in ((low, low_soft, -above), (high, high_soft, above)):
        own, soft = frozenset({felt.name}), frozenset({spring.name})
        rules += [
            Rule(f"{felt.name} made", (felt.stretch, felt.force, side), bars=_LEVER | {"jack"}, adds=own),
            Rule(f"{felt.name} broken", (-felt.force,), needs=own, removes=own),
            Rule(f"{felt.name} gives", (spring.stretch,), needs=own, removes=own, adds=soft),
            Rule(f"{felt.name} recovers", (-spring.stretch,), needs=soft, removes=soft, adds=own),
        ]
    for below, over in ((low, high), (low_soft, high_soft)):
        a, b = frozenset({below.name}), frozenset({over.name})
        rules += [
            Rule(f"{below.name} meets drop screw", (above,), needs=a, removes=a, adds=b),
            Rule(f"{below.name} leaves drop screw", (-above,), needs=b, removes=b, adds=a),
        ]
    return [low, low_soft, high, high_soft], rules


def _backcheck(p: ActionParameters, coupler: Element) -> tuple[list[Element], list[Rule]]:
    """Wedges the falling hammer where it meets the check, for as long as the key stays deep."""
    c = p.backcheck
    own = frozenset({"check"})
    check = Element("check", (1.0, -1.0), 0.0, c.stiffness, c.damping, remembers=True)
    height = p.key.dip - p.string.height + c.catch
    caught = row({KEY: 1.0, HAMMER: -1.0, ONE: -height})
    within = row({KEY: -1.0, HAMMER: 1.0, ONE: height + c.reach})
    deep = row({KEY: 1.0, ONE: -c.key_depth})
    eased = row({KEY: -1.0, ONE: c.release})
    return [check], [
        Rule(
            "hammer checked",
            (caught, within, deep, coupler.rate),
            bars=own | {"jack"},
            adds=own,
            remembers=coupler.stretch,
        ),
        Rule("check releases", (eased,), needs=own, removes=own),
    ]
