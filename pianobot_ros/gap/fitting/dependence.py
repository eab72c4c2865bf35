"""What a residual depends on: regressions on every feature that the recording offers, by held-out
blocks.

Binned means over a feature (any shape), split by direction of motion where that helps (hysteresis),
and a sinusoid where the residual repeats with it (with position: gears, poles; with time: a
disturbance of its own clock).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from pianobot_ros.gap.floor.session.lines import line_of, peak, waves
from pianobot_ros.gap.problem.constants import (
    LEADERS,
    LEVEL,
    MOST,
    PIECES,
    SAMPLES,
    SMALL,
    TINY,
)
from pianobot_ros.gap.problem.problem import Index, Problem
from pianobot_ros.gap.problem.recordings.features import is_rate
from pianobot_ros.gap.problem.types import Array, Observable, Signal

BINS = 16
SESSION = "time of the session"
OWN_TIME = "time since start of the block"
RESOLVED = 160
"""Most periods over the whole of a feature that are looked for (numerical)."""
FEWEST, FEWEST_EVENTS = 40, 10
"""Samples of a series, and events, below which a residual has no shape (numerical)."""


@dataclass(frozen=True)
class Table:
    """Residual (n,) with its block (n,) and named features, each (values (n,), unit); its `scatter`
    (n,), what the repeats of a condition have not in common; and the names of those features that
    are no state of the machine but `drive` it.
    """

    residual: Array
    group: Array
    features: dict[str, tuple[Array, str]]
    direction: Array | None
    scatter: Array
    drive: frozenset[str] = frozenset()

    def against_clock(self) -> tuple[Table, float]:
        """The table for what hangs on the time of the session, and the share of the power that it
        has: what repeats have in common comes back with each cycle of the moves, and would look
        like a line of that period.
        """
        whole = max(float(np.sum(self.residual**2)), TINY)
        return replace(self, residual=self.scatter), float(np.sum(self.scatter**2)) / whole


@dataclass(frozen=True)
class Share:
    """Held-out share of a residual's power that is `explained`, and what is `surely`, as blocks
    differ (lower end, one-sided `LEVEL`): of noise that is slow each block has little more than a
    level, and what a few levels go with by chance predicts one block and fails in another.
    """

    explained: float
    surely: float

    def times(self, part: float) -> Share:
        """The share of the whole, of which the residual is a `part`."""
        return Share(part * self.explained, part * self.surely)


def _share(r: Array, told: Array, group: Array) -> Share:
    """The share of r (n,) that is `told` (n,), held out: of ratios from block to block (`group`,
    (n,)), or from piece to piece of fewer than three.
    """
    block = np.unique(group, return_inverse=True)[1]
    if block.max() < 2:
        block = np.arange(r.size) * PIECES // r.size
    each, count = np.bincount(block, r**2), int(block.max()) + 1
    whole = max(float(each.sum()), TINY)
    gain = each - np.bincount(block, (r - told) ** 2)
    explained = float(gain.sum()) / whole
    error = np.sqrt(count / (count - 1.0) * np.sum((gain - explained * each) ** 2)) / whole
    return Share(explained, explained - float(stdtrit(count - 1, LEVEL) * error))


@dataclass(frozen=True)
class Regression:
    """A residual over one feature `x` (n,): the held-out share of its power that is `explained`, by
    `direction` of motion (n,) too or as a `wave` (cycles per unit, amplitude), if so.
    """

    feature: str
    unit: str
    x: Array
    explained: float
    surely: float
    """What it explains at least (:class:`Share`)."""
    direction: Array | None = None
    wave: tuple[float, float] | None = None


def explained_share(problem: Problem, prediction: Array, o: int) -> float:
    """The largest held-out share of an observable's residual that any regression surely explains,
    over one feature or over all together.
    """
    table = table_of(problem, prediction, o)
    return max((recurrent_share(table).surely, *(r.surely for r in regressions(table))))


def recurrent_share(table: Table) -> Share:
    """Share of the residual's power that other moments tell at which the machine was nearly in the
    same state: by all features together, since what a law lacks is seldom a function of one.

    A state that comes back is a repeat, also where no condition does. The moments are of other
    blocks, or of other pieces of the same one between which the state went elsewhere: noise that is
    slow is alike in what lies side by side. It may outlast a swing that comes back, so what is
    alike throughout a piece of the same block tells nothing.
    """
    pick = slice(None, None, max(1, table.residual.size // SAMPLES))
    r, block = table.residual[pick], table.group[pick]
    known = {n: x for n, (x, _) in table.features.items() if n not in table.drive}
    columns = [x[pick] for n, x in known.items() if n not in (SESSION, OWN_TIME)]
    moving = [x for x in columns if any(np.ptp(x[block == b]) > 0 for b in np.unique(block))]
    if len(moving) < 2 or r.size < FEWEST:
        return Share(0.0, 0.0)
    state = np.array([(x - x.mean()) / x.std() for x in moving]).T
    square = (state**2).sum(1)
    apart = np.sqrt(np.maximum(square[:, None] + square - 2.0 * state @ state.T, 0.0))
    parts = _pieces(block)
    near, far = (np.array([f(apart[:, p], 1) for p in parts]).T for f in (np.min, np.max))
    like = np.array([r[p][np.argmin(apart[:, p], 1)] for p in parts]).T
    piece = np.repeat(np.arange(len(parts)), [p.size for p in parts])
    piece = piece[np.argsort(np.concatenate(parts))]
    of = np.array([block[p[0]] for p in parts])
    near = _come_back(near, far, piece, of)
    level = np.array([float(np.mean(r[p])) for p in parts])
    like -= np.where(block[:, None] == of, level, 0.0)
    best = np.argsort(near, 1)[:, :LEADERS]
    there = np.isfinite(np.take_along_axis(near, best, 1))
    told = np.where(there, np.take_along_axis(like, best, 1), 0.0).sum(1) / (there.sum(1) + 1.0)
    return _share(r, told, block)


def _come_back(near: Array, far: Array, piece: Index, block: Array) -> Array:
    """How far (n, p) each sample's state is from the nearest of each piece; infinite where the
    state has not been elsewhere between them, by twice that at least. `far` (n, p): the same to the
    farthest; `piece` (n,) of each sample, `block` (p,) of each piece.
    """
    out, count = np.array(near, float), block.size
    for k in range(count):
        rows = piece == k
        out[rows, k] = np.inf
        for way in (range(k + 1, count), range(k - 1, -1, -1)):
            between = np.zeros(int(rows.sum()))
            for other in way:
                if block[other] != block[k]:
                    break
                back = near[rows, other] < MOST * between
                out[rows, other] = np.where(back, near[rows, other], np.inf)
                between = np.maximum(between, far[rows, other])
    return out


def _pieces(block: Array) -> list[Index]:
    """Samples of each piece of each block (n,), in order: fewer of each where there are many."""
    blocks = np.unique(block)
    count = max(1, 4 * PIECES // blocks.size)
    cut = (np.array_split(np.flatnonzero(block == b), count) for b in blocks)
    return [p for pieces in cut for p in pieces if p.size]


def regressions(table: Table) -> Iterator[Regression]:
    """The residual over each of its features; over none where it is short. Apart by direction, or
    as a wave, where that explains more than a small share more.
    """
    fold = _folds(table.group)
    events = np.unique(table.group).size == table.residual.size
    enough = table.residual.size >= (FEWEST_EVENTS if events else FEWEST)
    for name, (x, unit) in table.features.items() if enough else ():
        own, share = table.against_clock() if name == SESSION else (table, 1.0)
        plain = _binned(own, x, None, fold).times(share)
        yield Regression(name, unit, x, plain.explained, plain.surely)
        if own.direction is not None and not is_rate(name):
            apart = _binned(own, x, own.direction, fold).times(share)
            if apart.explained > plain.explained + SMALL:
                yield Regression(name, unit, x, apart.explained, apart.surely, own.direction)
        wave = _wave(own, x, fold, name == SESSION)
        if wave is not None and share * wave[0].explained > plain.explained + SMALL:
            of = wave[0].times(share)
            yield Regression(name, unit, x, of.explained, of.surely, wave=wave[1:])


def table_of(problem: Problem, prediction: Array, o: int) -> Table:
    """An observable's residual under a prediction (size,) with all features."""
    parts: list[Array] = []
    groups: list[Array] = []
    alike: dict[tuple[int, int], list[int]] = {}
    columns: dict[str, list[Array]] = {}
    units: dict[str, str] = {}
    drive: set[str] = set()
    obs, left = problem.observables[o], problem.y - prediction
    for c in problem.cells_of(o):
        t = c.t[problem.mask[c.start : c.stop]]
        predicted = Signal(t, problem.judged(c, prediction), obs.unit)
        own = _features(problem, c.block, predicted, obs)
        drive.update(problem.features.driving(c.block) if obs.kind == "series" else ())
        parts.append(problem.judged(c, left))
        alike.setdefault((int(problem.condition_of_block[c.block]), t.size), []).append(len(groups))
        groups.append(np.full(t.size, c.block))
        for name, (values, unit) in own.items():
            columns.setdefault(name, []).append(values)
            units[name] = unit
    residual, group = np.concatenate(parts), np.concatenate(groups)
    stride = max(1, residual.size // (4 * SAMPLES))
    whole = {n: np.concatenate(v) for n, v in columns.items() if len(v) == len(parts)}
    features = {n: (x[::stride], units[n]) for n, x in whole.items() if np.ptp(x) > 0}
    direction = next((np.sign(x) for n, (x, _) in features.items() if is_rate(n)), None)
    scatter = np.concatenate(_apart(parts, alike.values()))[::stride]
    every = residual[::stride], group[::stride], features, direction, scatter
    return Table(*every, frozenset(drive))


def _apart(parts: Sequence[Array], alike: Iterable[Sequence[int]]) -> list[Array]:
    """The parts (n,) less what those that are `alike` have in common."""
    out = list(parts)
    for members in alike:
        if len(members) > 1:
            common = np.mean([parts[k] for k in members], axis=0)
            for k in members:
                out[k] = parts[k] - common
    return out


def _features(
    problem: Problem, index: int, predicted: Signal, obs: Observable
) -> dict[str, tuple[Array, str]]:
    """What a block offers at the stamps of what is `predicted` of it: values (n,) and unit by
    name.
    """
    block, t = problem.blocks[index], predicted.t
    out: dict[str, tuple[Array, str]] = {}
    if obs.kind == "series":
        for name, s in problem.features.beside(index, obs.signal, predicted).items():
            ok = np.isfinite(s.y)
            out[name] = (np.interp(t, s.t[ok], s.y[ok]), s.unit)
        out[OWN_TIME] = (t - t[0], "s")
        if problem.on_session_clock:
            out[SESSION] = (t - float(problem.start_of_block.min()), "s")
    else:
        out[SESSION] = (np.full(t.size, float(problem.start_of_block[index])), "s")
    for name, value in block.attributes.items():
        if np.isfinite(value):
            column = np.full(t.size, float(value))
            out.setdefault(name, (column, block.units.get(name, "")))  # a feature goes first
    return out


def _folds(group: Array) -> Array:
    """Fold (n,) of samples by their blocks, in no step with a cycle of moves: each fold would hold
    whole conditions, and what tells these apart could never be predicted.
    """
    blocks = np.unique(group)
    if blocks.size >= 3:
        mixed = np.random.default_rng(0).permutation(blocks.size)
        return np.asarray(mixed[np.searchsorted(blocks, group)] % min(5, blocks.size))
    return np.asarray((np.arange(group.size) * 10 // group.size) % 5)


def edges_of(x: Array) -> Array:
    """Edges of bins that hold equally many of x (n,), or one each of few values."""
    few = np.unique(x)
    if few.size <= BINS:
        return np.append(few, np.inf)
    return np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))


def bins(x: Array, edges: Array, direction: Array | None) -> Index:
    """The bin of each of x (n,), another one by `direction` (n,)."""
    cell = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(edges.size - 2, 0))
    return np.asarray(cell if direction is None else cell + edges.size * (direction > 0), np.intp)


def _binned(table: Table, x: Array, direction: Array | None, fold: Array) -> Share:
    """Held-out share of the residual's power that binned means over x explain."""
    edges = edges_of(x)
    if edges.size < 3:
        return Share(0.0, 0.0)
    cell = bins(x, edges, direction)
    size, told = int(cell.max()) + 1, np.zeros(x.size)
    for k in np.unique(fold):
        train, test = fold != k, fold == k
        n = np.bincount(cell[train], minlength=size)
        mean = np.bincount(cell[train], table.residual[train], minlength=size) / (n + 1.0)
        told[test] = mean[cell[test]]
    return _share(table.residual, told, table.group)


def _wave(table: Table, x: Array, fold: Array, clock: bool) -> tuple[Share, float, float] | None:
    """Best sinusoid over x: held-out share, cycles per unit, amplitude; None if x spans too
    little, or nothing without one of the folds. Its frequency is held out too: the strongest of
    many explains noise.
    """
    slowest = _slowest(table, x)
    least = min(float(np.ptp(x[fold != j])) for j in np.unique(fold))
    if np.unique(x).size < FEWEST or not (least > 0.0 and slowest * float(np.ptp(x)) < RESOLVED):
        return None
    told, size = np.zeros(x.size), []
    for j in np.unique(fold):
        train, test = fold != j, fold == j
        f = _frequency(x[train], table.residual[train], clock, slowest)
        c = line_of([(x[train], table.residual[train])], f)
        size.append(float(np.hypot(*c)))
        told[test] = waves(x[test], [f]) @ c
    share = _share(table.residual, told, table.group)
    return share, _frequency(x, table.residual, clock, slowest), float(np.mean(size))


def in_step(table: Table, x: Array, f: float) -> bool:
    """Whether a line of f Hz over the session's time x (n,) gets out of step with the blocks by
    less than a turn in the whole session: nothing tells it from a slow course of what each block
    does, as of a motor that warms up while a program plays at even intervals.
    """
    block = np.unique(table.group, return_inverse=True)[1]
    starts = np.full(block.max() + 1, np.inf)
    np.minimum.at(starts, block, x)
    turns = f * np.diff(np.sort(starts))
    return bool(np.ptp(np.cumsum(turns - np.round(turns))) < 1.0) if turns.size > 1 else False


def _slowest(table: Table, x: Array) -> float:
    """The frequency over x (n,) of which half of the samples' blocks see a whole period: of what is
    slower each block has a level alone, and a few levels are on some wave by chance.
    """
    block = np.unique(table.group, return_inverse=True)[1]
    low, high = np.full(block.max() + 1, np.inf), np.full(block.max() + 1, -np.inf)
    np.minimum.at(low, block, x)
    np.maximum.at(high, block, x)
    return 1.0 / max(float(np.median((high - low)[block])), TINY)


def _frequency(x: Array, r: Array, clock: bool, slowest: float) -> float:
    """The frequency, of none slower than that, at which r over x has most power."""
    span = float(np.ptp(x))
    coarse = _about(x, r, slowest * span) / span
    # a disturbance may have many more periods in a session
    spectrum = peak(x, r) if clock else None
    if spectrum is not None and spectrum >= slowest:
        coarse = _strongest(np.array([coarse, spectrum]), x, r)
    pick = slice(None, None, max(1, x.size // SAMPLES))
    return _strongest(coarse + np.linspace(-0.25, 0.25, 21) / span, x[pick], r[pick])


def _about(x: Array, r: Array, fewest: float) -> float:
    """Periods over the whole of x at which r has most power, 2 and the `fewest` to 160 of them, to
    a quarter.
    """
    cells, first = 1024, min(max(8, int(np.ceil(4.0 * fewest))), 4 * RESOLVED - 1)
    at = np.minimum((x - x.min()) / float(np.ptp(x)) * cells, cells - 1).astype(int)
    power = np.abs(np.fft.rfft(np.bincount(at, r, cells), 4 * cells))[first : 4 * RESOLVED]
    return 0.25 * (first + int(np.argmax(power)))


def _strongest(grid: Array, x: Array, r: Array) -> float:
    """The frequency of a grid at which r over x has most power."""
    return float(
        grid[int(np.argmax(np.abs(np.exp(-2j * np.pi * np.outer(grid, x - x.min())) @ r)))]
    )
