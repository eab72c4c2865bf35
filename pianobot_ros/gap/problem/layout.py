"""The measured data laid out once as flat vectors, and any prediction in the same layout.

A *cell* is one observable of one block: a run of samples of the flat vectors (a single sample for
an event). A *unit* is what is scored and resampled as one piece: a block, or a piece of a block
where there are few blocks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.problem.constants import MISSED, MOST
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.options import Options
from pianobot_ros.gap.problem.recordings.intake import sound
from pianobot_ros.gap.problem.types import Array, Block, Observable, usable

Index: TypeAlias = NDArray[np.intp]


@dataclass(frozen=True)
class Cell:
    """One observable of one block: samples [start, stop) of the flat vectors; `kept` indexes the
    block's own samples.
    """

    block: int
    observable: int
    start: int
    stop: int
    t: Array
    kept: Index
    absent: bool = False
    """An event that did not happen in reality: the twin is right if it predicts NaN."""


class Layout:
    """Blocks as flat vectors: `y` (size,) measured, and of every sample its observable `obs_of`,
    block `block_of`, unit `unit_of` and whether it is an event that was `absent` (size,);
    `start_of_block` (blocks,), s of session time, in order alone where the stamps of each block
    start anew (`on_session_clock` is False).
    `taken_out`: observables of which readings far from all others are not judged.
    """

    def __init__(
        self, blocks: Sequence[Block], observables: Sequence[Observable], options: Options
    ) -> None:
        self.observables: tuple[Observable, ...] = tuple(observables)
        self.warnings: list[str]
        self.blocks, self.warnings, mended = sound(blocks, self.observables)
        self.taken_out = frozenset(o.name for o in self.observables if o.signal in mended)
        if not self.blocks:
            raise GapError(
                "nothing to diagnose: give at least one block (two or more repeats per condition"
                " are better)"
            )
        self._set_session()
        self._lay_out(options.max_samples)
        like = [(b.condition, b.history) for b in self.blocks]
        self.repeat_of_block = np.array([like.index(x) for x in like])
        self._cut_units(options.min_units)

    def _set_session(self) -> None:
        """When each block began. Blocks that lie on top of each other in time cannot be of one
        session's clock: then only their order is known. What is compared tells: an input may begin
        earlier, in the block before.
        """
        signals = [(b.outputs or b.inputs).values() for b in self.blocks]
        ends = [[s.t[np.isfinite(s.t)] for s in own] for own in signals]
        ends = [[t[[0, -1]] for t in stamps if t.size] for stamps in ends]
        times = [np.concatenate(e) if e else np.zeros(1) for e in ends]
        first, last = (np.array([f(t) for t in times]) for f in (np.min, np.max))
        lasted = last - first
        before = lasted.sum() - lasted[np.argmax(first)]
        self.on_session_clock = bool(MOST * before <= np.ptp(first))
        self.start_of_block = first if self.on_session_clock else np.cumsum(lasted) - lasted
        if not self.on_session_clock:
            self.warnings.append(
                "the stamps of each block start anew, so only the order of the blocks is known: a"
                " disturbance on its own clock may count as scatter (let stamps run on through the"
                " session)"
            )

    def _lay_out(self, max_samples: int) -> None:
        cells: list[Cell] = []
        ys: list[Array] = []
        at = 0
        self._group = self._group_size(max_samples)
        self._miss = {
            o: self._miss_size(obs) for o, obs in enumerate(self.observables) if obs.kind == "event"
        }
        for b, block in enumerate(self.blocks):
            for o, obs in enumerate(self.observables):
                if obs.kind == "event":
                    value = block.events.get(obs.signal)
                    if value is None:
                        continue
                    absent = not math.isfinite(value)
                    t, y, kept = (
                        np.zeros(1),
                        np.array([0.0 if absent else value], float),
                        np.zeros(1, np.intp),
                    )
                else:
                    absent = False
                    signal = block.outputs.get(obs.signal)
                    if signal is None:
                        continue
                    kept = usable(signal)
                    t, y = signal.t[kept], signal.y[kept]
                group = self._group if obs.kind == "series" else 1
                if group > 1:
                    t, y = _means(t, group), _means(y, group)
                cells.append(Cell(b, o, at, at + y.size, t, kept, absent))
                ys.append(y)
                at += y.size
        if not cells:
            wanted = sorted({o.signal for o in self.observables})
            raise GapError(
                "no block holds any signal or event that the twin predicts; it predicts"
                f" {', '.join(wanted)}"
            )
        self.cells, self.y = tuple(cells), np.concatenate(ys)
        self.size = at
        self.obs_of = np.concatenate([np.full(c.stop - c.start, c.observable) for c in cells])
        self.block_of = np.concatenate([np.full(c.stop - c.start, c.block) for c in cells])
        self.absent = np.concatenate([np.full(c.stop - c.start, c.absent) for c in cells])
        spans = [
            float(np.ptp(self.y[self.obs_of == o])) if np.any(self.obs_of == o) else 0.0
            for o in range(len(self.observables))
        ]
        # what never changes says nothing of how far is far
        self._span = np.where(np.array(spans) > 0.0, spans, np.inf)[self.obs_of]
        present = {c.observable for c in cells}
        lost = [
            f"{o.name} (no block has its {'event' if o.kind == 'event' else 'signal'} {o.signal!r})"
            for i, o in enumerate(self.observables)
            if i not in present
        ]
        if lost:
            self.warnings.append(f"not measured, so not judged: {', '.join(lost)}")
        self.present = tuple(sorted(present))
        conditions = list(dict.fromkeys(b.condition for b in self.blocks))
        self.conditions = tuple(conditions)
        self.condition_of_block = np.array([conditions.index(b.condition) for b in self.blocks])

    def _runs(self) -> list[tuple[int, int, int, int]]:
        """Stretches of samples that belong to one unit and one observable."""
        out = []
        for c in self.cells:
            cuts = np.flatnonzero(np.diff(self.unit_of[c.start : c.stop])) + 1 + c.start
            edges = [c.start, *cuts.tolist(), c.stop]
            out += [(a, b, int(self.unit_of[a]), c.observable) for a, b in pairwise(edges)]
        return out

    def _group_size(self, max_samples: int) -> int:
        """Neighbouring samples are averaged in groups of this size, so that long recordings stay
        affordable.
        """
        series = (o.signal for o in self.observables if o.kind == "series")
        sizes = [b.outputs[n].t.size for n in series for b in self.blocks if n in b.outputs]
        most = min(sizes, default=1) // 24
        return max(1, min(math.ceil(sum(sizes) / max_samples), most))

    def _miss_size(self, obs: Observable) -> float:
        """Residual that stands for an event that one side has and the other has not."""
        seen = [
            b.events[obs.signal]
            for b in self.blocks
            if math.isfinite(b.events.get(obs.signal, math.nan))
        ]
        spread = 0.5 * float(np.std(seen)) if seen else 0.0
        usual = float(np.max(np.abs(seen))) if seen else 0.0
        return max(MISSED * obs.floor_hint, spread) or usual or 1.0

    def _cut_units(self, min_units: int) -> None:
        pieces = max(1, math.ceil(min_units / len(self.blocks)))
        self.unit_of = np.empty(self.size, int)
        ends: dict[int, list[float]] = {}
        for c in self.cells:
            if self.observables[c.observable].kind == "series":
                ends.setdefault(c.block, []).extend((float(c.t[0]), float(c.t[-1])))
        for c in self.cells:
            part, own = np.zeros(c.t.size), ends.get(c.block, [0.0])
            if self.observables[c.observable].kind == "series" and np.ptp(own) > 0:
                part = pieces * (c.t - min(own)) / np.ptp(own)
            piece = np.minimum(part.astype(int), pieces - 1)
            self.unit_of[c.start : c.stop] = c.block * pieces + piece
        used, self.unit_of = np.unique(self.unit_of, return_inverse=True)
        self.n_units = used.size
        self.block_of_unit = used // pieces
        self.runs = self._runs()
        if pieces > 1:
            self.warnings.append(
                f"only {len(self.blocks)} block(s): each was cut into {pieces} pieces of time for"
                " scoring, which is weaker than separate blocks"
            )

    @staticmethod
    def _one_each(predictions: Sequence[object], count: int) -> None:
        if not hasattr(predictions, "__len__"):
            raise GapError(
                f"simulate returned a {type(predictions).__name__}: give a list, a dict for each"
                " block"
            )
        if len(predictions) != count:
            raise GapError(f"simulate returned {len(predictions)} predictions for {count} blocks")
        other = next((p for p in predictions if not hasattr(p, "get")), None)
        if other is not None:
            raise GapError(
                f"simulate returned a {type(other).__name__} for a block: give a dict, a series or"
                " number by observable"
            )

    def flattened(self, predictions: Sequence[Mapping[str, object]]) -> Array:
        """Predictions of all blocks as a flat vector (size,), NaN where there are none."""
        self._one_each(predictions, len(self.blocks))
        out = np.full(self.size, np.nan)
        for c in self.cells:
            obs = self.observables[c.observable]
            value = predictions[c.block].get(obs.name)
            if value is None:
                continue
            if obs.kind == "event":
                out[c.start] = self._event(c, value)
                continue
            try:
                series = np.atleast_1d(np.asarray(value, float))
            except (TypeError, ValueError):
                raise GapError(
                    f"simulate returned a {type(value).__name__} for {obs.name}: give an array, one"
                    " value per measured sample"
                ) from None
            if obs.kind == "series":
                expected = self.blocks[c.block].outputs[obs.signal].t.size
                if series.shape != (expected,):
                    raise GapError(
                        f"simulate returned shape {series.shape} for {obs.name}, expected"
                        f" ({expected},): one value per measured sample"
                    )
            picked = series if c.kept.size == series.size else series[c.kept]
            out[c.start : c.stop] = picked if self._group == 1 else _means(picked, self._group)
        return out

    def mismatched(self, flat: Array) -> NDArray[np.bool_]:
        """Which samples (size,) of a prediction stand for events that one side has and the other
        has not.
        """
        out = np.zeros(self.size, bool)
        for c in self.cells:
            if c.observable in self._miss:
                wrong = float(self.y[c.start]) + self._miss[c.observable]
                out[c.start] = flat[c.start] == wrong
        return out

    def _event(self, c: Cell, value: object) -> float:
        """An event as predicted; where only one side has it, what stands for that."""
        x = float(np.ravel(np.asarray(value, float))[0]) if np.ndim(value) else float(value)  # type: ignore[arg-type]
        happens = math.isfinite(x)
        wrong = float(self.y[c.start]) + self._miss[c.observable]
        return (wrong if happens else 0.0) if c.absent else (x if happens else wrong)


def _means(x: Array, group: int) -> Array:
    """Means of `group` neighbours; the last group may be smaller."""
    whole = x.size // group * group
    means = x[:whole].reshape(-1, group).mean(1)
    return np.asarray(means if whole == x.size else np.append(means, x[whole:].mean()))
