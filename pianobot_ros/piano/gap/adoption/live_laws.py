"""Corrections as the running twin takes them: the families' own laws, with the memory that they
need from one piece of a signal to the next.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.gap.effects.base import (
    DEVICES,
    Array,
    ClockLaw,
    ForceLaw,
    LatencyLaw,
    Memory,
    PressureLaw,
    StrikeLaw,
    TriggerLaw,
    VelocityLaw,
    WristLaw,
    acting,
    mechanics,
)
from pianobot_ros.piano.gap.effects.filters import play
from pianobot_ros.piano.gap.evidence.strike_data import PATH
from pianobot_ros.piano.gap.simulation.corrections import Correction, Corrections, cell_id
from pianobot_ros.piano.twin.model.cell_model import PARAMETERS

__all__ = ["LiveLaws", "parse_effects"]


class LiveLaws:
    """The laws of ``corrections`` (see :class:`pianobot_ros.piano.twin.stepping.laws.Laws`).

    ``seed`` of what scatters.
    """

    def __init__(self, corrections: Corrections, seed: int = 0) -> None:
        self.corrections = corrections
        effects = [LIBRARY[name] for name in corrections.effects]
        nominal = {p.name: p.nominal for e in effects for p in e.parameters}
        self._v = dict.fromkeys(PARAMETERS, 1.0) | nominal | corrections.values()
        self.parameters: Mapping[str, float] = {
            n: self._v[n] for n in corrections.parameters if n in PARAMETERS
        }
        self.numbers: Mapping[str, float] = mechanics(effects, self._v)
        self._wrist, self._pressure = acting(effects, WristLaw), acting(effects, PressureLaw)
        self._force, self._velocity = acting(effects, ForceLaw), acting(effects, VelocityLaw)
        self._triggers, self._clocks = acting(effects, TriggerLaw), acting(effects, ClockLaw)
        latency = list(acting(effects, LatencyLaw).values())
        sides = [w.side for w in acting(effects, StrikeLaw).values() if w.side]
        self._side = sum(side(self._v) for side in sides)
        self._spreads = [w.spread for w in latency if w.spread]
        self._delay = sum(self._v[law.delay] for law in latency)
        self.wrist = bool(self._wrist)
        self.feeling = min(
            (w.feels(self._v) for w in self._wrist.values() if w.feels), default=np.inf
        )
        self.vacuum = bool(self._pressure or sides)
        self.reading = bool(self._force)
        self._random = np.random.default_rng([seed, 0xAD0])
        self.reset()

    def reset(self) -> None:
        """Forget what was: the session begins now."""
        self._memory: dict[tuple[str, int], Memory] = {}

    def _recall(self, name: str, place: int) -> Memory:
        return self._memory.setdefault((name, place), Memory())

    def height(self, t: Array, z: Array, force: float) -> Array:
        """Height (n,) m of the wrist."""
        felt = np.full(z.size, force)
        for name, law in self._wrist.items():
            z = np.asarray(law.height(self._v, t, z, felt, self._recall(name, 0)), dtype=float)
        return z

    def pressure(self, t: Array, setpoint: Array) -> Array:
        """Pressure (3,) Pa at the last of the times."""
        out: Array = np.array(setpoint, dtype=float)
        for i in range(out.size):
            p = np.full(t.size, setpoint[i])
            for name, law in self._pressure.items():
                p = law.pressure(self._v, t, p, self._recall(name, i))
            out[i] = p[-1]
        return out

    def stiffness(self, pressure: Array) -> Array:
        """Factors (3,) on the fingers' stiffness: from which side the vacuum was reached."""
        factors = np.ones(len(FINGERS))
        if self._side:
            for i in range(factors.size):
                state = self._memory.setdefault(("side", i), Memory()).state
                middle = play(pressure[i : i + 1].copy(), 2.0 * PATH, state)[0]
                factors[i] += self._side * (middle - pressure[i]) / PATH
        return factors

    def read(self, key: int, t: Array, force: Array) -> Array:
        """Reading (n,) N of a sensor under a force (n,) N."""
        if not force.any() and ("read", key) not in self._memory:
            return force
        self._memory.setdefault(("read", key), Memory())
        out = np.ascontiguousarray(force)
        for name, law in self._force.items():
            out = law.read(self._v, t, out, self._recall(name, key))
        return out

    def velocity(self, x: float) -> float:
        """MIDI velocity, not yet rounded, where the nominal one is x."""
        for law in self._velocity.values():
            x = float(law.velocity(self._v, np.array([x]))[0])
        return x

    def triggers(self) -> tuple[float, float]:
        """Shifts of the trigger angles, rad."""
        shifts = [law.shifts(self._v) for law in self._triggers.values()]
        return sum(s[0] for s in shifts), sum(s[1] for s in shifts)

    def skews(self) -> dict[str, float]:
        """By device how much its clock gains, as a share of its own time."""
        laws = self._clocks.values()
        return {device: sum(law.skew(self._v, device) for law in laws) for device in DEVICES}

    def late(self) -> float:
        """How late the next note event is, s."""
        apart = (float(s(self._v, self._random.random(2))) for s in self._spreads)
        return float(self._delay + sum(apart))


def parse_effects(texts: Sequence[str]) -> Corrections:
    """Effects from texts like ``key_friction.key_friction=0.01``; empty texts are skipped.

    Raises ConfigError for names that the library has not, values that are no numbers or out of
    bounds.
    """
    known = {f"{f.name}.{p.name}": p for f in LIBRARY.values() for p in f.parameters}
    found: dict[str, dict[str, Correction]] = {}
    for text in filter(None, (t.strip() for t in texts)):
        name, _, value = text.partition("=")
        if name not in known:
            raise ConfigError(unknown_name("effect of the twin", name, known))
        bound = known[name]
        try:
            number = float(value)
        except ValueError:
            number = float("nan")
        if not bound.low <= number <= bound.high:
            raise ConfigError(
                f"effect '{text}': give a number from {bound.low:g} to {bound.high:g}"
                f" {bound.unit}, as in {name}={bound.high / 10:g}"
            )
        effect, _, parameter = name.partition(".")
        own = found.setdefault(
            effect,
            {p.name: Correction(p.nominal, unit=p.unit) for p in LIBRARY[effect].parameters},
        )
        own[parameter] = Correction(number, unit=bound.unit)
    return Corrections({}, found, cell_id())
