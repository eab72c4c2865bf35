"""Exact event-driven simulation of the hybrid action.

Inside a mode the motion is linear and is propagated by matrix exponentials, so there is no
step-size error. Switching instants
are the first roots of the guards: they are bracketed on a fine grid, with the interior maxima of
each guard checked so that a short touch between two grid points is not missed, and then solved to
machine precision.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import ConfigError, PianobotError
from pianobot_ros.piano.action.hybrid.action_model import ActionModel, mode_name
from pianobot_ros.piano.action.hybrid.elements import (
    FORCE,
    HAMMER,
    HAMMER_VELOCITY,
    KEY,
    KEY_VELOCITY,
    SIZE,
    SLOPE,
    Mode,
    Rule,
)
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.propagate import BLOCK, Propagator

__all__ = ["Event", "History", "Simulator", "Trajectory", "simulate"]


_TOUCH = 1e-10  # a guard above this fires at once; below, it must first grow
_MAX_EVENTS = 20_000
# Letters of Fig. 8 by (mode before, mode after).
_LETTERS = {
    ("ACCELERATION", "FREE FLIGHT"): "a",
    ("FREE FLIGHT", "ACCELERATION"): "b",
    ("FREE FLIGHT", "RAIL STOP"): "c",
    ("RAIL STOP", "FREE FLIGHT"): "d",
    ("RAIL STOP", "REPETITION"): "e",
    ("REPETITION", "RAIL STOP"): "f",
    ("REPETITION", "ACCELERATION"): "g",
    ("ACCELERATION", "REPETITION"): "h",
}


@dataclass(frozen=True)
class Event:
    """A switch at ``time`` [s]: the rule that fired, modes before and after, and the state (8,) at
    that instant.
    """

    time: float
    rule: str
    before: Mode
    after: Mode
    state: Array

    @property
    def letter(self) -> str:
        """Letter of the transition in Fig. 8, empty if the submodel did not change."""
        return _LETTERS.get((mode_name(self.before), mode_name(self.after)), "")


@dataclass(frozen=True)
class History:
    """A trajectory sampled at ``time`` [s] (N,): positions [m], velocities [m/s] and forces [N],
    each (N,), and the modes.

    ``load_cell`` is the force between armature and key, ``coupler`` between key and hammer,
    ``rail`` of the front rail.
    """

    time: Array
    key: Array
    key_velocity: Array
    hammer: Array
    hammer_velocity: Array
    drive: Array
    load_cell: Array
    coupler: Array
    rail: Array
    energy: Array
    mode: tuple[str, ...]


@dataclass(frozen=True)
class _Segment:
    start: float
    stop: float
    mode: Mode
    state: Array


@dataclass
class Trajectory:
    """An exact trajectory: linear segments, and the events between them."""

    model: ActionModel
    segments: list[_Segment] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)

    @property
    def end(self) -> float:
        """Last instant [s]."""
        return self.segments[-1].stop

    def modes(self) -> list[str]:
        """Submodels of Fig. 8 in the order in which they were active, without repeats."""
        names = [mode_name(self.segments[0].mode)]
        for event in self.events:
            name = mode_name(event.after)
            if name != names[-1]:
                names.append(name)
        return names

    def states(self, times: Array) -> tuple[Array, list[Mode]]:
        """States (N, 8) and modes at ascending ``times`` [s] (N,); at an event, those after it."""
        out = np.empty((times.size, SIZE))
        modes: list[Mode] = []
        bounds = np.searchsorted(times, [s.start for s in self.segments], side="left")
        for i, segment in enumerate(self.segments):
            stop = bounds[i + 1] if i + 1 < len(self.segments) else times.size
            inside = times[bounds[i] : stop]
            modes += [segment.mode] * inside.size
            if inside.size:
                out[bounds[i] : stop] = self.model.propagator(segment.mode).along(
                    segment.state, inside - segment.start
                )
        return out, modes

    def sample(self, period: float = 1e-3) -> History:
        """The trajectory at even steps of ``period`` [s] from 0."""
        times = period * np.arange(int(np.floor(self.end / period + 1e-9)) + 1)
        return self.history(np.asarray(times, dtype=float))

    def history(self, times: Array) -> History:
        """The trajectory at ascending ``times`` [s] (N,)."""
        z, modes = self.states(np.asarray(times, dtype=float))
        load, coupler, rail, energy = (np.zeros(times.size) for _ in range(4))
        number = {mode: i for i, mode in enumerate(dict.fromkeys(modes))}
        of = np.array([number[m] for m in modes])
        for mode, i in number.items():
            here = of == i
            load[here] = z[here] @ self.model.load_cell(mode)
            energy[here] = self.model.energy(mode, z[here])
            if "coupler" in mode:
                coupler[here] = z[here] @ self.model.elements["coupler"].force
            if "front_rail" in mode:
                rail[here] = z[here] @ self.model.elements["front_rail"].force
        return History(
            time=np.asarray(times, dtype=float),
            key=z[:, KEY],
            key_velocity=z[:, KEY_VELOCITY],
            hammer=z[:, HAMMER],
            hammer_velocity=z[:, HAMMER_VELOCITY],
            drive=z[:, FORCE],
            load_cell=load,
            coupler=coupler,
            rail=rail,
            energy=energy,
            mode=tuple(mode_name(m) for m in modes),
        )


class _Compiled:
    """A mode made ready: its propagator, and the guards of the rules that apply in it."""

    def __init__(self, propagator: Propagator, rules: tuple[Rule, ...]) -> None:
        self.propagator = propagator
        self.rules = rules
        self.rows = np.array([g for r in rules for g in r.guards]).reshape(-1, SIZE)
        counts = np.array([len(r.guards) for r in rules], dtype=np.intp)
        ends = np.cumsum(counts)
        self.starts = ends - counts
        self.simple = np.flatnonzero(counts == 1)

    def values(self, z: Array) -> Array:
        """Value (..., rules) of each rule, the least of its guards, at states ``z`` (..., 8)."""
        if not self.rules:
            return np.full((*z.shape[:-1], 1), -np.inf)
        return np.asarray(np.minimum.reduceat(z @ self.rows.T, self.starts, axis=-1))

    def polynomials(self, z: Array, rule: int) -> Array:
        """Taylor coefficients (guards, terms) of the guards of ``rule`` over one grid step from
        ``z``.
        """
        first = self.starts[rule]
        guards = self.rows[first : first + len(self.rules[rule].guards)]
        return np.asarray(guards @ np.stack(self.propagator.series(z), axis=1))


class Simulator:
    """Simulates one :class:`ActionModel`; keeps what it prepared for each mode, so reuse it for
    many runs.
    """

    def __init__(self, model: ActionModel) -> None:
        self.model = model
        self._compiled: dict[Mode, _Compiled] = {}

    def run(
        self, profile: ForceProfile, end: float, *, start: tuple[Mode, Array] | None = None
    ) -> Trajectory:
        """Simulate from 0 to ``end`` [s] under ``profile``, from ``start`` (mode, state) or the
        model's rest.

        Raises :class:`ConfigError` for a time that is not positive, and :class:`PianobotError` if
        switching never ends.
        """
        if not end > 0:
            raise ConfigError(f"the end of a simulation must be after 0 s, not {end}")
        mode, z = start if start is not None else self.model.rest()
        path = Trajectory(self.model)
        for begin, stop, force, slope in profile.pieces(end):
            z = z.copy()
            z[FORCE], z[SLOPE] = force, slope
            mode, z = self._piece(path, begin, stop, mode, z)
        return path

    def _piece(
        self, path: Trajectory, begin: float, stop: float, mode: Mode, z: Array
    ) -> tuple[Mode, Array]:
        t = begin
        while True:
            mode, z = self._switch_at_once(path, t, mode, z)
            found = self._next_event(mode, z, stop - t)
            if found is None:
                path.segments.append(_Segment(t, stop, mode, z))
                return mode, self.model.propagator(mode).advance(z, stop - t)
            elapsed, rule = found
            path.segments.append(_Segment(t, t + elapsed, mode, z))
            t += elapsed
            z = self.model.propagator(mode).advance(z, elapsed)
            mode, z = self._fire(path, t, mode, z, rule)

    def _switch_at_once(
        self, path: Trajectory, t: float, mode: Mode, z: Array
    ) -> tuple[Mode, Array]:
        """Fire rules whose guards are already open, until none is."""
        while True:
            compiled = self._compile(mode)
            values = compiled.values(z)
            if not np.any(values > _TOUCH):
                return mode, z
            mode, z = self._fire(path, t, mode, z, compiled.rules[int(np.argmax(values > _TOUCH))])

    def _fire(
        self, path: Trajectory, t: float, mode: Mode, z: Array, rule: Rule
    ) -> tuple[Mode, Array]:
        after, state = rule.apply(mode, z)
        path.events.append(Event(t, rule.name, mode, after, state))
        if len(path.events) > _MAX_EVENTS:
            raise PianobotError(
                f"the action keeps switching at {t:.6f} s ({rule.name}): soften its contacts or"
                " damp them"
            )
        return after, state

    def _compile(self, mode: Mode) -> _Compiled:
        if mode not in self._compiled:
            rules = tuple(r for r in self.model.rules if r.applies(mode))
            self._compiled[mode] = _Compiled(self.model.propagator(mode), rules)
        return self._compiled[mode]

    def _next_event(self, mode: Mode, z: Array, span: float) -> tuple[float, Rule] | None:
        """Time [s] to the first switch within ``span`` from ``z``, and its rule; None if there is
        none.
        """
        compiled = self._compile(mode)
        powers, grid = compiled.propagator.powers, compiled.propagator.grid
        done = 0.0
        while compiled.rules and done < span:
            states = powers @ z
            found = self._first_in_block(compiled, states)
            if found is not None:
                return (done + found[0], found[1]) if done + found[0] <= span else None
            z = states[-1]
            done += BLOCK * grid
        return None

    def _first_in_block(self, compiled: _Compiled, states: Array) -> tuple[float, Rule] | None:
        values = compiled.values(states)
        crossed = np.flatnonzero((values[1:] > 0).any(axis=1))
        last = int(crossed[0]) if crossed.size else BLOCK - 1
        touched = self._first_touch(compiled, states, values, last)
        if touched is not None:
            return touched
        if not crossed.size:
            return None
        grid = compiled.propagator.grid
        times = {
            int(i): _root(compiled.polynomials(states[last], int(i)), grid)
            for i in np.flatnonzero(values[last + 1] > 0)
        }
        first = min(times, key=lambda i: times[i])
        return last * grid + times[first], compiled.rules[first]

    @staticmethod
    def _first_touch(
        compiled: _Compiled, states: Array, values: Array, last: int
    ) -> tuple[float, Rule] | None:
        """A guard that opens and closes again between two grid points, up to point ``last``."""
        grid = compiled.propagator.grid
        rows = compiled.rows[compiled.starts[compiled.simple]]
        rates = states[: last + 2] @ compiled.propagator.a.T @ rows.T
        held = values[: last + 2][:, compiled.simple]
        turns = (rates[:-1] > 0) & (rates[1:] < 0) & (held[:-1] + rates[:-1] * grid > 0)
        for k, j in np.argwhere(turns & (held[:-1] <= 0) & (held[1:] <= 0)):
            rule = int(compiled.simple[j])
            guard = compiled.polynomials(states[k], rule)
            slope = guard[:, 1:] * np.arange(1, guard.shape[1])
            peak = _root(-slope, grid)
            if _value(guard, peak) > _TOUCH:
                return k * grid + _root(guard, peak), compiled.rules[rule]
        return None


def _value(guards: Array, t: float) -> float:
    """Least of the polynomials ``guards`` (guards, terms) at ``t``."""
    least = np.inf
    for coefficients in guards.tolist():
        total = 0.0
        for c in reversed(coefficients):
            total = total * t + c
        least = min(least, total)
    return least


def _root(guards: Array, high: float) -> float:
    """First time [s] in 0 to ``high`` at which the least of ``guards`` is no longer negative; it is
    positive at ``high``.
    """
    if _value(guards, 0.0) >= 0:
        return 0.0
    return float(brentq(lambda t: _value(guards, t), 0.0, high, xtol=1e-16, rtol=1e-14))


def simulate(model: ActionModel, profile: ForceProfile, end: float) -> Trajectory:
    """Simulate ``model`` from rest to ``end`` [s] under ``profile``."""
    return Simulator(model).run(profile, end)
