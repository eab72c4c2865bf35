"""Blocks and twin together: what the twin predicts in the layout of the measured data, which
samples count, and what it has cost so far.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.problem.budget import Budget
from pianobot_ros.gap.problem.constants import (
    LEADERS,
    NEGLIGIBLE,
    RARE,
    ROUNDING,
    RUN_AWAY,
    SMALL,
)
from pianobot_ros.gap.problem.errors import GapError, SimulationFailed
from pianobot_ros.gap.problem.layout import Cell, Index, Layout
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.recordings.features import Features
from pianobot_ros.gap.problem.recordings.unmeasured import bridged_two_ways
from pianobot_ros.gap.problem.twin.calls import (
    Raw,
    Request,
    copies,
    refuse_changed,
    simulated,
    simulated_many,
)
from pianobot_ros.gap.problem.twin.declared import check_declared
from pianobot_ros.gap.problem.types import Array, Block, Effect, Parameter, Twin

__all__ = ["Cell", "Index", "Problem", "Request"]

NO_NUMBERS = "the twin returned NaN for most samples"


class Problem(Layout):
    """Blocks and twin, checked and flattened; what is to be told of them are its `warnings`. It
    stays as it is: what judges fewer samples, or by another twin, is another problem. All that come
    of one count on one `budget`.
    """

    def __init__(
        self,
        twin: Twin,
        blocks: Sequence[Block],
        options: Options | None = None,
        jobs: int = 1,
        budget: Budget | None = None,
    ) -> None:
        check_declared(twin)
        options = options or Options()
        super().__init__(blocks, twin.observables, options)
        self.twin = twin
        self.parameters: tuple[Parameter, ...] = tuple(twin.parameters)
        self.effects: dict[str, Effect] = {e.name: e for e in twin.effects}
        self.jobs, self.backend = jobs, options.backend
        self.budget = budget or Budget()
        self._memo: dict[tuple[object, ...], Array] = {}
        self._mask_unpredicted()
        self.features = Features(twin, self.blocks)
        self.warnings += self.features.warnings

    def nominal(self) -> dict[str, float]:
        """Nominal nuisance values."""
        return {p.name: p.nominal for p in self.parameters}

    def _mask_unpredicted(self) -> None:
        """Samples that the nominal twin leaves NaN are no observations; an effect may not add to
        them (see `_taken`).
        """
        before = copies(self.blocks)
        raw = self._run_blocks(dict(enumerate(self.blocks)), (self.nominal(), ()))
        if isinstance(raw, SimulationFailed):
            self.budget.failed(raw)
            raise raw
        refuse_changed(self.blocks, before)
        nominal = self.flattened(raw)
        self.mask = np.isfinite(nominal)
        self._refuse_absurd(nominal)
        self._mask_dead(nominal)
        self._nominal_y = np.where(self.mask, nominal, self.y)
        self._mask_unmeasured()
        known = {o.name for o in self.observables}
        other = sorted(set().union(*(map(str, r) for r in raw)) - known)
        beside = f"; what it calls {', '.join(other)} is no observable's" if other else ""
        if not self.mask.any():
            raise GapError(
                "nothing is left to compare: the twin predicts nothing but NaN at its nominal"
                f" parameters, or no signal moves{beside}; try twin.simulate on one block"
            )
        self._tell_absent()
        missing = [
            self.observables[o].name for o in self.present if not self.mask[self.obs_of == o].any()
        ]
        if missing:
            self.warnings.append(f"the twin makes no prediction for {', '.join(missing)}{beside}")
            self.present = tuple(o for o in self.present if self.mask[self.obs_of == o].any())
        self._tell_unpredicted()

    def _mask_unmeasured(self) -> None:
        """What rests on samples that are no numbers, by as much as a twin is believed to be wrong
        by, is no observation.
        """
        ways = bridged_two_ways(self.blocks)
        if not ways[0]:
            return
        line, bent = (self._said(self._run_blocks(w, (self.nominal(), ())), w) for w in ways)
        if line is None or bent is None:
            return
        spread = np.array([np.std(self.y[self.obs_of == o]) for o in range(len(self.observables))])
        rests = self.mask & (np.abs(bent - line) > NEGLIGIBLE * spread[self.obs_of])
        self.mask &= ~rests
        self._nominal_y = np.where(rests, self.y, self._nominal_y)
        share = {o: float(np.mean(rests[self.obs_of == o])) for o in self.present}
        found = [f"{self.observables[o].name} ({100 * x:.0f} %)" for o, x in share.items() if x]
        if found:
            self.warnings.append(
                f"not judged, since it rests on samples that are no numbers: {', '.join(found)}"
            )

    def _tell_unpredicted(self) -> None:
        """Say of which observables hardly anything is judged, since the twin predicts NaN."""
        share = {o: float(np.mean(self.mask[self.obs_of == o])) for o in self.present}
        few = [
            f"{self.observables[o].name} ({100 * x:.1f} %)" for o, x in share.items() if x < SMALL
        ]
        if few:
            self.warnings.append(
                "the twin predicts NaN nearly everywhere; only these shares are judged:"
                f" {', '.join(few)}. A measured sample that is no number and is spliced in spreads:"
                " let `simulate` bridge it"
            )

    def _refuse_absurd(self, nominal: Array) -> None:
        """Raise GapError where the nominal twin has run away: nothing can be compared with it."""
        far = np.abs(np.where(self.mask, nominal - self.y, 0.0))
        wild = np.flatnonzero(far > RUN_AWAY * (np.abs(self.y) + self._span))
        if wild.size:
            k = int(wild[0])
            raise GapError(
                f"the nominal twin predicts {self.observables[self.obs_of[k]].name} to be"
                f" {nominal[k]:.3g} where {self.y[k]:.3g} was measured: check units and time stamps"
            )

    def _tell_absent(self) -> None:
        """Events that did not happen although the twin predicts them are easily meant otherwise."""
        absent = self.absent & self.mismatched(self._nominal_y)
        for o in np.unique(self.obs_of[absent]):
            own = self.obs_of == o
            self.warnings.append(
                f"{self.observables[o].name} did not happen (NaN) in {int(np.sum(absent & own))} of"
                f" {int(own.sum())} blocks where the twin predicts it, which counts as gap (leave"
                " it out of a block's events where it was not recorded)"
            )

    def _mask_dead(self, nominal: Array) -> None:
        """A signal that is constant throughout although the twin moves is a dead sensor."""
        dead: list[str] = []
        flat: list[str] = []
        for o in self.present:
            own = self.obs_of == o
            if np.ptp(self.y[own]) > 0 or self.observables[o].kind == "event":
                continue
            x = nominal[own & self.mask]
            moves = x.size > 0 and float(np.ptp(x)) > ROUNDING * float(np.max(np.abs(x)))
            (dead if moves else flat).append(self.observables[o].name)
            if moves:
                self.mask &= ~own
        if dead:
            self.warnings.append(
                f"constant throughout although the twin moves, so left out: {', '.join(dead)}"
            )
        if flat:
            self.warnings.append(f"constant throughout, so they say little: {', '.join(flat)}")

    def without(self, cells: Sequence[Cell], why: str) -> Problem:
        """The problem that judges some cells no more, which are `why`: so few strays are no gap
        (`scatter.py`). Nor does it judge what a block shows behind a series that is one, and is
        spliced in before it.
        """
        order = [stage.name for stage in self.twin.stages]
        place = np.array([order.index(o.stage) for o in self.observables])[self.obs_of]
        mask, named = self.mask.copy(), []
        for c in cells:
            mask[c.start : c.stop] = False
            observable = self.observables[c.observable]
            behind = (self.block_of == c.block) & (place > order.index(observable.stage))
            behind &= mask & (observable.kind == "series")
            mask &= ~behind
            also = " with what lies behind it" if behind.any() else ""
            named.append(f"{observable.name} of {self.blocks[c.block].name}{also}")
        said = [f"{why}, so left out: {', '.join(named)}"]
        other = self._judging(mask, said)
        other.taken_out |= {self.observables[c.observable].name for c in cells}
        return other

    def without_vanished(self, prediction: Array) -> Problem:
        """The problem that judges no more those events that the nominal twin predicts and this one,
        with parameters that fit as well, does not: whether they happen hangs on what is not known
        so exactly. Where that is many of an observable's, it is a gap.
        """
        gone = self.mismatched(prediction) & ~self.mismatched(self._nominal_y) & self.mask
        mask, said = self.mask.copy(), []
        for o in np.unique(self.obs_of[gone]):
            own = (self.obs_of == o) & self.mask
            count = int(np.sum(gone & own))
            if count <= RARE * own.sum():
                mask &= ~(gone & own)
                said.append(
                    f"the twin predicts no {self.observables[o].name} in {count} of"
                    f" {int(own.sum())} blocks at the refitted parameters, so it is not judged"
                    " there"
                )
        return self._judging(mask, said) if said else self

    def of_units(self, units: NDArray[np.bool_]) -> Problem:
        """The problem that judges these units (u,) alone."""
        return self._judging(self.mask & units[self.unit_of], ())

    def _judging(self, mask: NDArray[np.bool_], said: Sequence[str]) -> Problem:
        """This problem with another mask, and what is said of it."""
        other = self.telling(*said)
        other.mask, other._memo = mask, dict(self._memo)
        return other

    def asking(self, only: Sequence[str]) -> Problem:
        """This problem with these effects alone in its library; none given: all. Raises GapError
        for others.
        """
        unknown = [n for n in only if n not in self.effects]
        if unknown:
            raise GapError(
                f"unknown effects {unknown}; the twin has {', '.join(sorted(self.effects))}"
            )
        other = copy.copy(self)
        other.effects = {n: e for n, e in self.effects.items() if n in (only or self.effects)}
        return other

    def telling(self, *said: str) -> Problem:
        """This problem with further warnings."""
        other = copy.copy(self)
        other.warnings = [*self.warnings, *said]
        return other

    def _diverged(self, flat: Array) -> NDArray[np.bool_]:
        """Which samples (size,) that are judged are no prediction."""
        near = RUN_AWAY * (np.abs(self._nominal_y - self.y) + self._span)
        return np.asarray(self.mask & ~(np.abs(flat - self.y) < near))

    @staticmethod
    def _key(values: Mapping[str, float], effects: Sequence[str]) -> tuple[object, ...]:
        return (tuple(sorted(effects)), *sorted(values.items()))

    def recentred(self, values: Mapping[str, float]) -> Problem:
        """The problem with a twin that approximates most exactly at these values; itself where the
        twin approximates nothing.
        """
        move = getattr(self.twin, "recentre", None)
        if move is None:
            return self
        other = copy.copy(self)
        other.twin, other._memo = move(values), {}
        return other

    def predict(self, values: Mapping[str, float], effects: Sequence[str]) -> Array:
        """Flat prediction (size,); raises SimulationFailed if the twin cannot."""
        (result,) = self.predict_many([(values, tuple(effects))])
        if isinstance(result, Exception):
            raise result
        return result

    def predict_many(self, requests: Sequence[Request]) -> list[Array | SimulationFailed]:
        """Several predictions, batched or in parallel where the twin or `jobs` allows; failures
        come back as values.
        """
        keys = [self._key(*r) for r in requests]
        todo = {k: r for k, r in zip(keys, requests, strict=True) if k not in self._memo}
        given = simulated_many(
            self.twin, self.blocks, list(todo.values()), self.budget, self.jobs, self.backend
        )
        answers = zip(todo.items(), given, strict=True)
        blocks = dict(enumerate(self.blocks))
        fresh = {k: self._taken(raw, request, blocks) for (k, request), raw in answers}
        self._memo |= {k: x for k, x in fresh.items() if not isinstance(x, SimulationFailed)}
        self.budget.spend(len(todo), len(self.blocks))
        out = [fresh[k] if k in fresh else self._memo[k] for k in keys]
        while len(self._memo) > 64:
            self._memo.pop(next(iter(self._memo)))
        return out

    def predict_blocks(
        self, blocks: Mapping[int, Block], values: Mapping[str, float], effects: Sequence[str] = ()
    ) -> Array | SimulationFailed:
        """Flat prediction (size,) of these blocks by index, or of other recordings in their place;
        of no use elsewhere. A failure comes back as a value.
        """
        request = values, tuple(effects)
        return self._taken(self._run_blocks(blocks, request), request, blocks)

    def silent(
        self,
        values: Mapping[str, float],
        effects: Sequence[str],
        others: Mapping[int, Block] | None = None,
    ) -> NDArray[np.bool_]:
        """Which samples (size,) that are judged the twin says nothing of, in these blocks or in
        other recordings of them, by index; none where it fails.
        """
        blocks = dict(enumerate(self.blocks)) if others is None else others
        said = self._said(self._run_blocks(blocks, (values, tuple(effects))), blocks)
        return self.mask & (said is not None and np.isnan(said))

    def _run_blocks(self, blocks: Mapping[int, Block], request: Request) -> Raw:
        self.budget.spend(1, len(blocks))
        return simulated(self.twin, list(blocks.values()), request)

    def _said(self, raw: Raw, blocks: Mapping[int, Block]) -> Array | None:
        """What the twin gave for these blocks, by index (size,): NaN where that is no number, and
        elsewhere. None where it failed.
        """
        if isinstance(raw, SimulationFailed):
            return None
        self._one_each(raw, len(blocks))
        each = dict(zip(blocks, raw, strict=True))
        flat = self.flattened([each.get(b, {}) for b in range(len(self.blocks))])
        return np.where(self._diverged(flat), np.nan, flat)

    def _taken(
        self,
        raw: Raw,
        request: Request,
        blocks: Mapping[int, Block],
    ) -> Array | SimulationFailed:
        """What the twin gave for these blocks, by index, as a flat prediction (size,). Where that
        is no number, the twin without one of the effects stands in, so that what an effect says
        nothing of counts neither for nor against it, and the nominal twin where there is none. A
        failure, which is noted, where most of what is judged in these blocks is no number.
        """
        said = self._said(raw, blocks)
        if said is not None:
            judged = self.mask & np.isin(self.block_of, list(blocks))
            silent = judged & np.isnan(said)
            if silent.sum() <= RARE * judged.sum():
                if silent.any():
                    said = np.where(silent, self._with_fewer(request, blocks), said)
                return np.where(np.isfinite(said) & self.mask, said, self._nominal_y)
        failed = raw if isinstance(raw, SimulationFailed) else SimulationFailed(NO_NUMBERS)
        self.budget.failed(failed, request[1])
        return failed

    def _with_fewer(self, request: Request, blocks: Mapping[int, Block]) -> Array:
        """Flat prediction (size,) of these blocks without one of the effects, or without any; NaN
        where none of these says a number.
        """
        values, effects = request
        out = np.full(self.size, np.nan)
        fewer = [tuple(n for n in effects if n != name) for name in effects]
        for few in fewer if len(effects) < 2 else [*fewer, ()]:
            gone = {p.name for n in effects if n not in few for p in self.effects[n].parameters}
            rest = {n: x for n, x in values.items() if n not in gone}
            said = self._said(self._run_blocks(blocks, (rest, few)), blocks)
            out = out if said is None else np.where(np.isnan(out), said, out)
        return out

    def allows(self, calls: float) -> bool:
        """Whether the budget allows so many more predictions of all blocks."""
        return self.budget.allows(round(calls * len(self.blocks)))

    def cells_of(self, observable: int) -> list[Cell]:
        """The cells of an observable, by its index, in which anything is judged."""
        own = (c for c in self.cells if c.observable == observable)
        return [c for c in own if self.mask[c.start : c.stop].any()]

    def judged(self, c: Cell, flat: Array) -> Array:
        """Flat values (size,) of a cell where it is judged (n,)."""
        return flat[c.start : c.stop][self.mask[c.start : c.stop]]

    def per_unit(self, flat: Array) -> Array:
        """Flat values (size,) summed over what is judged, per unit and observable (u, o)."""
        out = np.zeros((self.n_units, len(self.observables)))
        starts, _, units, observables = zip(*self.runs, strict=True)
        sums = np.add.reduceat(np.where(self.mask, flat, 0.0), starts)
        np.add.at(out, (units, observables), sums)
        return out

    def names_of(self, blocks: Sequence[int]) -> str:
        """The names of some blocks, by index, for a sentence: of many the first few."""
        named = [self.blocks[b].name for b in blocks[:LEADERS]]
        return ", ".join([*named, "…"] if len(blocks) > LEADERS else named)
