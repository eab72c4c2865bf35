"""Describe a residual that nobody explains: what does it depend on?

The residual of the responsible observable is regressed, block by block held out, on every feature
the recording offers: position-like signals, their speeds, direction, other measured signals (load),
time within the block, time of the session, the block's attributes; as binned means (any shape),
split by direction where that helps (hysteresis), and as a sinusoid where it repeats (with position:
gears, poles; with time: a disturbance of its own clock). The best held-out share wins and is put in
words that name shape, size and unit, so that an engineer can write the missing term.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.diagnosis import Dependency, UnknownDescription
from pianobot_ros.gap.floor.hum import unphased_lines
from pianobot_ros.gap.floor.lines import peak
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.noise import NoiseModel
from pianobot_ros.gap.problem.problem import Index, Problem
from pianobot_ros.gap.problem.types import Array, Signal

BINS = 16
SESSION = "time of the session"
SAMPLES = 6000


@dataclass(frozen=True)
class _Table:
    """Residual (n,) with its block (n,) and named features, each (values (n,), unit)."""

    residual: Array
    group: Array
    features: dict[str, tuple[Array, str]]
    direction: Array | None


def describe(
    problem: Problem, gauge: Gauge, noise: NoiseModel, prediction: Array
) -> UnknownDescription | None:
    """Describe the residual of the observable with the largest gap under `prediction`; None if
    there is nothing to tell.
    """
    each = gauge.gaps(prediction)
    series = [o for o in problem.present if np.isfinite(each[o])]
    if not series:
        return None
    o = max(series, key=lambda k: float(each[k]))
    obs = problem.observables[o]
    table = _table(problem, prediction, o)
    found = (
        sorted(_dependencies(table, obs.unit), key=lambda d: -d.explained)
        if table.residual.size >= 40
        else []
    )
    if obs.kind == "series":
        found = sorted([*found, *_hums(problem, prediction, o)], key=lambda d: -d.explained)
    top = [d for d in found if d.explained > 0.08][:4]
    lead = (
        f"The residual of {obs.name} ({each[o]:.1f} × floor, {float(each[o] * noise.floor[o]):.3g}"
        f" {obs.unit} RMS)"
    )
    if not top:
        text = (
            f"{lead} depends on none of the recorded quantities; suspect something that was not"
            " recorded."
        )
    else:
        rest = [
            d
            for d in found
            if d.explained < 0.05 and not d.by_direction and d.unit and "folded" not in d.feature
        ]
        free = f", and hardly on {_listing([d.feature for d in rest[:3]])}" if rest else ""
        text = f"{lead} {top[0].text} ({100 * top[0].explained:.0f} % of it, held out){free}."
    return UnknownDescription(obs.name, obs.stage, obs.unit, text, tuple(top))


def _hums(problem: Problem, prediction: Array, o: int) -> list[Dependency]:
    """The lines of an observable's residual whose phase nothing recorded tells."""
    cells = [c for c in problem.cells if c.observable == o]
    kept = [(c, problem.mask[c.start : c.stop]) for c in cells]
    rows = [
        (c.t[keep], (problem.y - prediction)[c.start : c.stop][keep])
        for c, keep in kept
        if keep.any()
    ]
    hum = unphased_lines([[row] for row in rows], 0.0)
    if hum is None:
        return []
    line = np.concatenate([own for (own,) in hum.lines])
    whole = np.concatenate([x for _, x in rows])
    explained = float(np.sum(line**2) / max(float(np.sum(whole**2)), 1e-300))
    unit, size = problem.observables[o].unit, float(np.sqrt(2.0) * np.std(line))
    text = (
        f"holds a line of {' and '.join(f'{x:.3g}' for x in hum.hertz)} Hz, amplitude {size:.3g}"
        f" {unit}, on a clock of its own: its phase is another in each block"
    )
    none = np.zeros(0)
    return [Dependency("a clock of its own", "Hz", explained, none, none, none, False, text)]


def _listing(names: list[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " or " + names[-1]


# -- features
# ---------------------------------------------------------------------------------
def _table(problem: Problem, prediction: Array, o: int) -> _Table:
    parts: list[Array] = []
    groups: list[Array] = []
    columns: dict[str, list[Array]] = {}
    units: dict[str, str] = {}
    signal = problem.observables[o].signal
    for c in problem.cells:
        if c.observable != o:
            continue
        keep = problem.mask[c.start : c.stop]
        if not keep.any():
            continue
        t = c.t[keep]
        own = _features(problem, c.block, t, signal, problem.observables[o].kind == "event")
        parts.append((problem.y[c.start : c.stop] - prediction[c.start : c.stop])[keep])
        groups.append(np.full(t.size, c.block))
        for name, (values, unit) in own.items():
            columns.setdefault(name, []).append(values)
            units[name] = unit
    residual, group = np.concatenate(parts), np.concatenate(groups)
    stride = max(1, residual.size // SAMPLES)
    whole = {n: np.concatenate(v) for n, v in columns.items() if len(v) == len(parts)}
    features = {n: (x[::stride], units[n]) for n, x in whole.items() if np.ptp(x) > 0}
    speed = next(
        (x for n, (x, _) in features.items() if n == "velocity" or n.startswith("rate of")), None
    )
    return _Table(
        residual[::stride], group[::stride], features, None if speed is None else np.sign(speed)
    )


def _features(
    problem: Problem, index: int, t: Array, own: str, event: bool
) -> dict[str, tuple[Array, str]]:
    block, start = problem.blocks[index], float(problem.start_of_block[index])
    out: dict[str, tuple[Array, str]] = {}
    offered = getattr(problem.twin, "features", None)
    signals: dict[str, Signal] = dict(offered(block)) if offered is not None else {}
    if not event:
        if not signals:
            for name, s in (*block.inputs.items(), *block.outputs.items()):
                if name != own and np.isfinite(s.y).sum() > 3:
                    signals[name] = s
                    signals[f"rate of {name}"] = Signal(s.t, _rate(s), f"{s.unit}/s")
        for name, s in signals.items():
            ok = np.isfinite(s.y)
            out[name] = (np.interp(t, s.t[ok], s.y[ok]), s.unit)
        out["time since start of the block"] = (t - t[0], "s")
        if problem.on_session_clock:
            out[SESSION] = (t - float(problem.start_of_block.min()), "s")
    else:
        out[SESSION] = (np.full(t.size, start), "s")
    for name, value in block.attributes.items():
        if np.isfinite(value):
            out.setdefault(name, (np.full(t.size, float(value)), ""))  # a feature goes first
    return out


def _rate(s: Signal) -> Array:
    dt = np.maximum(np.diff(s.t), 1e-9)
    ok = np.where(np.isfinite(s.y), s.y, 0.0)
    slope = np.diff(ok) / dt
    width = max(1, min(5, slope.size // 4))
    slope = np.convolve(
        np.pad(slope, width, "edge"), np.ones(2 * width + 1) / (2 * width + 1), "valid"
    )
    return np.append(slope, slope[-1])


# -- regressions
# ---------------------------------------------------------------------------------
def _dependencies(table: _Table, unit: str) -> list[Dependency]:
    out: list[Dependency] = []
    fold = _folds(table.group)
    for name, (x, x_unit) in table.features.items():
        plain = _binned(table, x, None, fold)
        out.append(_shape(table, name, x_unit, unit, x, plain, None))
        if (
            table.direction is not None
            and name not in ("velocity",)
            and not name.startswith("rate of")
        ):
            split = _binned(table, x, table.direction, fold)
            if split > plain + 0.08:
                out.append(_shape(table, name, x_unit, unit, x, split, table.direction))
        wave = _wave(table, x, fold, name == SESSION)
        if wave is not None and wave[0] > plain + 0.05:
            out.append(_sinusoid(table, name, x_unit, unit, x, wave))
    return out


def _folds(group: Array) -> Array:
    blocks = np.unique(group)
    if blocks.size >= 3:
        return np.asarray(np.searchsorted(blocks, group) % min(5, blocks.size))
    return np.asarray((np.arange(group.size) * 10 // group.size) % 5)


def _edges(x: Array) -> Array:
    return np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))


def _cells(x: Array, edges: Array, direction: Array | None) -> Index:
    cell = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(edges.size - 2, 0))
    return np.asarray(cell if direction is None else cell + edges.size * (direction > 0), np.intp)


def _binned(table: _Table, x: Array, direction: Array | None, fold: Array) -> float:
    """Held-out share of the residual's power that binned means over x explain."""
    edges = _edges(x)
    if edges.size < 3:
        return 0.0
    cell = _cells(x, edges, direction)
    size = int(cell.max()) + 1
    left = 0.0
    for k in np.unique(fold):
        train, test = fold != k, fold == k
        n = np.bincount(cell[train], minlength=size)
        mean = np.bincount(cell[train], table.residual[train], minlength=size) / (n + 1.0)
        left += float(np.sum((table.residual[test] - mean[cell[test]]) ** 2))
    return 1.0 - left / max(float(np.sum(table.residual**2)), 1e-300)


def _wave(table: _Table, x: Array, fold: Array, clock: bool) -> tuple[float, float, float] | None:
    """Best sinusoid over x: held-out share, cycles per unit, amplitude; None if x spans too
    little.
    """
    span = float(np.ptp(x))
    if span <= 0 or np.unique(x).size < 40:
        return None
    pick = slice(None, None, max(1, x.size // 1500))
    grid = np.arange(2.0, 160.0, 0.25) / span
    coarse = _strongest(grid, x[pick], table.residual[pick])
    spectrum = (
        peak(x, table.residual) if clock else None
    )  # a disturbance may have many more periods in a session
    if spectrum is not None:
        coarse = _strongest(np.array([coarse, spectrum]), x, table.residual)
    f = _strongest(coarse + np.linspace(-0.25, 0.25, 21) / span, x[pick], table.residual[pick])
    basis = np.array([np.cos(2 * np.pi * f * x), np.sin(2 * np.pi * f * x)]).T
    left, size = 0.0, []
    for j in np.unique(fold):
        train, test = fold != j, fold == j
        c = np.linalg.lstsq(basis[train], table.residual[train], rcond=None)[0]
        size.append(float(np.hypot(*c)))
        left += float(np.sum((table.residual[test] - basis[test] @ c) ** 2))
    return 1.0 - left / max(float(np.sum(table.residual**2)), 1e-300), f, float(np.mean(size))


def _strongest(grid: Array, x: Array, r: Array) -> float:
    """The frequency of a grid at which r over x has most power."""
    return float(
        grid[int(np.argmax(np.abs(np.exp(-2j * np.pi * np.outer(grid, x - x.min())) @ r)))]
    )


# -- words
# ---------------------------------------------------------------------------------
def _means(table: _Table, x: Array, chosen: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    edges = _edges(x)
    cell = _cells(x, edges, None)
    centre, mean, spread = [], [], []
    for k in range(max(edges.size - 1, 1)):
        use = chosen & (cell == k)
        if use.sum() >= 3:
            centre.append(float(np.mean(x[use])))
            mean.append(float(np.mean(table.residual[use])))
            spread.append(float(np.std(table.residual[use])))
    return np.array(centre), np.array(mean), np.array(spread)


def _shape(
    table: _Table,
    name: str,
    x_unit: str,
    unit: str,
    x: Array,
    explained: float,
    direction: Array | None,
) -> Dependency:
    everything = np.ones(x.size, bool)
    centre, mean, spread = _means(table, x, everything)
    if direction is not None:
        up, down = _means(table, x, direction > 0), _means(table, x, direction <= 0)
        gap = float(np.mean(up[1]) - np.mean(down[1])) if up[1].size and down[1].size else 0.0
        text = (
            f"depends on {name} and on the direction of motion (on average {gap:.3g} {unit} apart"
            " between directions)"
        )
        centre, mean, spread = (np.concatenate(pair) for pair in zip(up, down, strict=True))
        return Dependency(name, x_unit, explained, centre, mean, spread, True, text)
    return Dependency(
        name,
        x_unit,
        explained,
        centre,
        mean,
        spread,
        False,
        _words(name, x_unit, unit, centre, mean),
    )


def _words(name: str, x_unit: str, unit: str, x: Array, y: Array) -> str:  # noqa: PLR0911
    if y.size < 3:
        return f"changes with {name}"
    span = float(np.ptp(y))
    rise = np.diff(y)
    at = f" {x_unit}" if x_unit else ""
    size = f"by {span:.3g} {unit} over {x[0]:.3g} to {x[-1]:.3g}{at}"
    odd = np.sign(x)
    if x.min() < 0 < x.max():
        scaled = x / np.max(np.abs(x))
        shapes = {
            "linearly with": scaled,
            "with the sign of": odd,
            "with the square (sign kept) of": scaled * np.abs(scaled),
            "with the magnitude of": np.abs(scaled),
            "with the cube of": scaled**3,
        }
        fits = {k: _share(v, y) for k, v in shapes.items()}
        best = max(fits, key=lambda k: fits[k])
        if fits[best] > 0.85:
            return f"goes {best} {name}, {size}"
    top = float(np.max(np.abs(y - np.median(y))))
    local = np.flatnonzero(np.abs(y - np.median(y)) > 0.3 * top)
    if local.size <= max(4, y.size // 3) and np.ptp(local) < local.size and top > 0:
        edge = 0.5 * (x[local[0] - 1] + x[local[0]]) if local[0] > 0 else x[0]
        end = 0.5 * (x[local[-1]] + x[local[-1] + 1]) if local[-1] < y.size - 1 else x[-1]
        sign = "" if y[local[int(np.argmax(np.abs(y[local])))]] > 0 else "-"
        if local[-1] == y.size - 1:
            return (
                f"sets in where {name} exceeds {edge:.3g}{at} and grows to {sign}{top:.3g} {unit}"
            )
        if local[0] == 0:
            return (
                f"sets in where {name} is below {end:.3g}{at} and grows to {sign}{top:.3g} {unit}"
            )
        return f"appears where {name} is {edge:.3g} to {end:.3g}{at}, up to {sign}{top:.3g} {unit}"
    bend = np.polyfit(x, y, 2)
    if (
        _share(np.asarray(np.polyval(bend, x), float), y) > 0.75
        and x[0] < -bend[1] / (2 * bend[0]) < x[-1]
    ):
        turn, way = -bend[1] / (2 * bend[0]), "lowest" if bend[0] > 0 else "highest"
        return (
            f"is {way} near {name} = {turn:.3g}{at} and {'rises' if bend[0] > 0 else 'falls'}"
            f" to both sides, {size}"
        )
    share = float(np.sum(rise[rise > 0]) / max(np.sum(np.abs(rise)), 1e-300))
    if share > 0.85:
        return f"rises with {name}, {size}"
    if share < 0.15:
        return f"falls with {name}, {size}"
    return f"varies with {name}, {size}"


def _share(shape: Array, y: Array) -> float:
    design = np.array([shape, np.ones(shape.size)]).T
    left = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
    return 1.0 - float(left @ left) / max(float(np.sum((y - y.mean()) ** 2)), 1e-300)


def _sinusoid(
    table: _Table, name: str, x_unit: str, unit: str, x: Array, wave: tuple[float, float, float]
) -> Dependency:
    explained, f, amplitude = wave
    folded = np.mod(x, 1.0 / f)
    centre, mean, spread = _means(table, folded, np.ones(x.size, bool))
    rate = f"{f:.3g} Hz" if x_unit == "s" else f"{f:.3g} periods per {x_unit or 'unit'}"
    if x_unit == "rad":
        rate += f", {2 * np.pi * f:.1f} per turn"
    text = f"repeats with {name} ({rate}), amplitude {amplitude:.3g} {unit}"
    return Dependency(f"{name}, folded", x_unit, explained, centre, mean, spread, False, text)
