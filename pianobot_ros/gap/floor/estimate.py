"""What repeats say of the noise: the scatter of every observable, and what in it is no scatter.

Per observable the scatter of the *residual* between repeats of one condition is split into a white
part (sensor noise) and a part that is correlated in time within a block (strike-to-strike
variation), by its autocovariance. The residual rather than the raw signal is used because repeats
are never driven exactly alike, and the twin knows how they were driven. Slow drift over a session
is a gap and not scatter; it was taken out before (`session/courses.py`).

Without repeats the floor is what `unrepeated.py` can tell of it. A warning says that it may be too
low.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.floor.repeats import Repeats, repeats, split, start_of
from pianobot_ros.gap.floor.scatter import by_chance, strays
from pianobot_ros.gap.floor.session.hum import unphased_lines
from pianobot_ros.gap.floor.session.lines import steady_lines
from pianobot_ros.gap.floor.session.wander import growth
from pianobot_ros.gap.floor.unrepeated import drawn_anew, shaped, white_alone
from pianobot_ros.gap.floor.whitening.random_effects import RandomEffects, random_effects
from pianobot_ros.gap.problem.constants import OF_MEDIAN, RARE, ROUNDING, SMALL, TINY
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.problem import Cell, Problem
from pianobot_ros.gap.problem.types import Array


@dataclass(frozen=True)
class Noise:
    """Noise of one observable, in its own unit; `floor` is the total (RMS) a perfect twin would
    leave. `repeats`: whether it is known by any, or estimated without.
    """

    white: float
    correlated: float
    tau: float
    tolerance: float
    hint: float
    repeats: bool
    rounding: float = 0.0
    """RMS of what it is rounded by, where repeats do not show that: they are rounded alike."""
    lasts: float = float("inf")
    """How long (s) an error of the twin stays the same: as long as the signal does, at most."""
    effects: RandomEffects | None = None
    """What of the correlated part is another in each block along known directions, if any is."""

    @property
    def wander(self) -> tuple[float, float]:
        """Deviation and time (s) of what is correlated within a block, beside its own effects."""
        own = self.effects
        return (self.correlated, self.tau) if own is None else (own.correlated, own.tau)

    @property
    def repeatability(self) -> float:
        """RMS scatter of repeats."""
        return float(np.hypot(self.white, self.correlated))

    @property
    def floor(self) -> float:
        """RMS below which nothing is claimed: scatter of repeats, the twin's believed error and the
        sensor's resolution.
        """
        return float(max(np.hypot(self.repeatability, self.tolerance), self.hint, TINY))


@dataclass(frozen=True)
class Estimates:
    """Noise of every observable by its index, the RMS floor by observable and phase, and names of
    observables: whose floor is `estimated` without repeats, leaves out a steady line (`humming`) or
    a few repeats far from the others (`erratic`). `lone`: strays so few that chance makes them,
    which are not judged. `directions` (size, k): those of the random effects, if there are any.
    """

    noises: dict[int, Noise] = field(default_factory=dict)
    phase_floor: dict[tuple[int, str], float] = field(default_factory=dict)
    estimated: list[str] = field(default_factory=list)
    humming: list[str] = field(default_factory=list)
    unphased: list[str] = field(default_factory=list)
    erratic: list[str] = field(default_factory=list)
    lone: list[Cell] = field(default_factory=list)
    directions: Array | None = None

    def keeping(self, other: Estimates, observables: Iterable[int]) -> Estimates:
        """These with the noise of some observables as in `other`."""
        return replace(self, noises={**self.noises, **{o: other.noises[o] for o in observables}})


def estimates(
    problem: Problem,
    residual: Array,
    options: Options,
    values: Mapping[str, float] | None = None,
    directions: Array | None = None,
) -> Estimates:
    """Estimate all noise from a residual (size,). Where nothing repeats, with what the twin makes
    of the sensors' noise by these parameters' `values` (default: nothing). Along `directions`
    (size, k) blocks may differ (default: none).
    """
    found = Estimates(directions=directions)
    under_way = _Estimation(problem, options, drawn_anew(problem, residual, values), found)
    for o in problem.present:
        under_way.found.noises[o] = under_way.noise(o, residual)
    return under_way.found


@dataclass(frozen=True)
class _Estimation:
    """What was `found` so far, one observable after the other; `drawn` (size,): noise drawn anew,
    where nothing repeats.
    """

    problem: Problem
    options: Options
    drawn: Array | None
    found: Estimates

    def noise(self, o: int, residual: Array) -> Noise:
        """Of one observable, by a residual (size,)."""
        problem, obs = self.problem, self.problem.observables[o]
        cells = problem.cells_of(o)
        cells = [c for c in cells if not c.absent] or cells
        y = np.concatenate([problem.judged(c, problem.y) for c in cells])
        spread = float(np.std(y)) if y.size > 1 else abs(float(y[0]))
        tolerance = obs.tolerance if np.isfinite(obs.tolerance) else self.options.tolerance * spread
        rounding = (grid(y) if obs.kind == "event" else resolution(y)) / np.sqrt(12.0)
        hint = max(
            obs.floor_hint,
            rounding,
            1e-9 * max(spread, float(np.max(np.abs(y))), 1e-3),
        )
        groups = repeats(problem, cells, residual)
        if obs.kind == "series":
            residual = self._without_line(o, groups, residual)
        groups = self._without_strays(o, groups, residual, max(hint, tolerance))
        starts = problem.start_of_block
        repeated = [(starts[[c.block for c in g.cells]], residual[g.at]) for g in groups]
        grown = growth(repeated, starts[[c.block for c in cells]])
        if not groups:
            self.found.estimated.append(obs.name)
        if obs.kind == "event":  # nothing is spliced from it
            white = max(_event_scatter(groups, cells, residual), hint) * float(np.sqrt(grown))
            return Noise(white, 0.0, 1.0, tolerance, hint, bool(groups))
        effects = None
        if groups:
            rows = [(g.times, x) for g in groups for x in g.scatter(residual)]
            white, correlated, tau = split([x for _, x in rows], [t for t, _ in rows])
            if self.found.directions is not None:
                noise = max(white, hint), correlated, tau
                effects = random_effects(groups, residual, self.found.directions, noise)
            correlated = float(np.sqrt(correlated**2 + (grown - 1.0) * (white**2 + correlated**2)))
            effects = effects and effects.larger(float(np.sqrt(grown)))
            self._phase_floors(o, groups, residual * np.sqrt(grown), tolerance, hint)
        else:
            white, correlated, tau = white_alone(problem, cells, residual), 0.0, 1.0
            if self.drawn is not None:
                white, correlated, tau = shaped(problem, cells, self.drawn, white)
        rounding *= white < rounding
        white = max(white, hint)
        own = lasting([(c.t, problem.y[c.start : c.stop]) for c in cells], white**2 + correlated**2)
        return Noise(white, correlated, tau, tolerance, hint, bool(groups), rounding, own, effects)

    def _without_line(self, o: int, groups: list[Repeats], residual: Array) -> Array:
        """Residual without a disturbance that is steady in session time, or of one amplitude in
        all blocks: that is a gap and not scatter.
        """
        problem = self.problem
        rows = []
        for g in groups:
            local = g.shortest.t - start_of(problem, g.shortest)
            own = [(start_of(problem, c), c.t, residual[c.start : c.stop]) for c in g.cells]
            rows.append([(local + t0, np.interp(local, t - t0, x)) for t0, t, x in own])
        share, name = self.options.calibration.material_share, problem.observables[o].name
        lines = steady_lines(rows, share) if problem.on_session_clock else None
        if lines is not None:
            self.found.humming.append(name)
        elif (hum := unphased_lines(rows, share)) is not None:
            self.found.unphased.append(f"{name} ({' and '.join(f'{x:.3g}' for x in hum.hertz)} Hz)")
            lines = hum.lines
        else:
            return residual
        residual = residual.copy()
        for g, group, found in zip(groups, rows, lines, strict=True):
            for c, (t, _), line in zip(g.cells, group, found, strict=True):
                residual[c.start : c.stop] -= np.interp(c.t, t, line)
        return residual

    def _without_strays(
        self, o: int, groups: list[Repeats], residual: Array, least: float
    ) -> list[Repeats]:
        """Repeats without the events that are far from the others, or the blocks throughout.

        Of a series most groups must be close as a whole, where there are enough to tell: of three
        repeats that a course was taken out of, two are alike.
        """
        if not groups:
            return []
        rows = [residual[g.at] for g in groups]
        away = [np.sqrt(np.mean((x - np.median(x, 0)) ** 2, axis=1)) for x in rows]
        if len(groups) > 2 and self.problem.observables[o].kind == "series":
            least = max(least, float(np.median([np.sqrt(np.mean(a**2)) for a in away])))
        far = strays(np.concatenate(away), least)
        self._tell_strays(o, groups, far)
        close = np.split(~far, np.cumsum([len(x) for x in rows])[:-1])
        return [g.of(own) for g, own in zip(groups, close, strict=True) if own.sum() > 1]

    def _tell_strays(self, o: int, groups: list[Repeats], far: NDArray[np.bool_]) -> None:
        """Of repeats in groups some are `far` off (sum of n,): left out of it all where chance
        makes so few. Two that are far from each other are one stray; which, only a hypothesis
        tells.
        """
        size_of = [(c, len(g.cells)) for g in groups for c in g.cells]
        astray = [pair for pair, is_far in zip(size_of, far, strict=True) if is_far]
        known = [c for c, size in astray if size > 2]
        pairs = (len(astray) - len(known)) // 2
        if len(known) + pairs <= by_chance(far.size):
            self.found.lone.extend(known)
        else:
            named = self.problem.names_of(sorted(c.block for c, _ in astray))
            name = self.problem.observables[o].name
            self.found.erratic.append(f"{name} ({len(astray)} of {far.size}: {named})")

    def _phase_floors(
        self, o: int, groups: list[Repeats], residual: Array, tolerance: float, hint: float
    ) -> None:
        sums: dict[str, list[float]] = {}
        for g in groups:
            scatter = g.scatter(residual)
            for phase, (t0, t1) in self.problem.blocks[g.shortest.block].phases.items():
                inside = (g.times >= t0) & (g.times <= t1)
                if inside.any():
                    each = np.mean(scatter[:, inside] ** 2, axis=1)
                    sums.setdefault(phase, []).extend(each.tolist())
        for phase, squares in sums.items():
            floor = max(float(np.sqrt(np.mean(squares) + tolerance**2)), hint)
            self.found.phase_floor[o, phase] = floor


def _event_scatter(groups: Sequence[Repeats], cells: Sequence[Cell], residual: Array) -> float:
    """RMS scatter of an event by its repeats; without any a robust one, by what one block differs
    from the next.
    """
    if groups:
        squares = sum(float(np.sum(g.apart(residual) ** 2)) for g in groups)
        return float(np.sqrt(squares / sum(len(g.cells) - 1 for g in groups)))
    values = residual[[c.start for c in cells]]
    if values.size <= 3:
        return 0.0
    return float(OF_MEDIAN * np.median(np.abs(np.diff(values)))) / float(np.sqrt(2.0))


def lasting(pieces: Sequence[tuple[Array, Array]], noise: float) -> float:
    """How long (s) a signal stays the same: its deviation over its RMS rate, both without `noise`
    (variance); infinite where it is only that. `pieces` are its times and values (n,).

    A sine of angular frequency w stays the same for 1/w. The rate is taken over the shortest time
    in which the signal surely changes.
    """
    known = [(t[k], y[k]) for t, y in pieces if (k := np.isfinite(y)).any()]
    variance = float(np.var(np.concatenate([y for _, y in known]))) - noise if known else 0.0
    apart = 1
    while variance > 0.0 and apart < max(t.size for t, _ in known) // 2:
        longer = [(t, y) for t, y in known if t.size > apart]
        squares = np.concatenate([(y[apart:] - y[:-apart]) ** 2 for _, y in longer])
        change = float(np.mean(squares))
        if change > 8.0 * noise:  # three quarters of it are the signal's
            step = float(np.mean(np.concatenate([t[apart:] - t[:-apart] for t, _ in longer])))
            return step * float(np.sqrt(variance / (change - 2.0 * noise)))
        apart *= 2
    return float("inf")


def resolution(y: Array) -> float:
    """Quantisation step of a signal: its smallest common difference if the values sit on few
    levels, else 0.
    """
    levels = np.unique(y)
    if levels.size < 2 or levels.size > RARE * y.size:
        return 0.0
    return float(np.quantile(np.diff(levels), SMALL))


def grid(y: Array) -> float:
    """Step of the coarsest grid on which all values lie, by Euclid's algorithm; 0 if they lie on
    none, or are fewer than three. Events are few: that they have few values may be their
    conditions' doing.
    """
    levels = np.unique(y)
    if levels.size < 3:
        return 0.0
    exact = ROUNDING * float(levels[-1] - levels[0])
    step = 0.0
    for apart in np.diff(levels).tolist():
        rest = apart
        while rest > exact:
            left = step % rest
            step, rest = rest, left if left < rest - exact else 0.0
    return step if step > 1e3 * exact else 0.0
