"""Describe a residual that nobody explains: what does it depend on?

The residual of the responsible observable is regressed, block by block held out, on every feature
the recording offers: position-like signals, their speeds, direction, other measured signals (load),
time within the block, time of the session, the block's attributes; as binned means (any shape),
split by direction where that helps (hysteresis), and as a sinusoid where it repeats (with position:
gears, poles; with time: a disturbance of its own clock). The best held-out share wins and is put in
words that name shape, size and unit, so that an engineer can write the missing term.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.gap.diagnosis import Dependency, UnknownDescription
from pianobot_ros.gap.fitting.dependence import (
    SESSION,
    Regression,
    Table,
    bins,
    edges_of,
    in_step,
    regressions,
    table_of,
)
from pianobot_ros.gap.floor.measure import Gauge
from pianobot_ros.gap.floor.session.hum import unphased_lines
from pianobot_ros.gap.floor.session.lines import rows_of
from pianobot_ros.gap.problem.constants import (
    BURST,
    FEWEST_SAMPLES,
    LEADERS,
    MOST,
    NEGLIGIBLE,
    SMALL,
    TINY,
)
from pianobot_ros.gap.problem.problem import Problem
from pianobot_ros.gap.problem.types import Array

OWN_CLOCK = "a clock of its own"
BURSTS = "bursts"
LEVEL = "level"
ONE_SIDED = "whether it happens"
FITTED = (OWN_CLOCK, BURSTS, ONE_SIDED)  # to each block, phase or time
PREFIXES, PREFIXED = {-3: "m", -6: "µ", -9: "n"}, {"m", "s", "N", "V", "A", "rad"}


def describe(
    gauge: Gauge, prediction: Array, names: Collection[str] = ()
) -> UnknownDescription | None:
    """Describe the residual of the observable with the largest gap under `prediction`, of those
    with these `names` if any are given; None if there is nothing to tell.
    """
    problem, each = gauge.problem, gauge.gaps(prediction)
    series = [
        o
        for o in problem.present
        if np.isfinite(each[o]) and (not names or problem.observables[o].name in names)
    ]
    if not series:
        return None
    o = max(series, key=lambda k: float(each[k]))
    obs = problem.observables[o]
    found = _one_sided(problem, prediction, o)
    found = found or _regressed(table_of(problem, prediction, o), obs.unit)
    # what keeps its phase in something recorded is told by that
    if obs.kind == "series" and all(d.explained < MOST for d in found):
        found += _hum(problem, prediction, o)
        found += _bursts(problem, prediction, o) if all(d.explained < SMALL for d in found) else []
    found.sort(key=lambda d: -d.explained)
    top = [d for d in found if d.explained > SMALL][:LEADERS]
    rms = float(each[o] * gauge.noise.floor[o])
    lead = f"The residual of {obs.name} ({each[o]:.1f} × floor, {amount(rms, obs.unit)} RMS)"
    if not top:
        text = (
            f"{lead} depends on none of the recorded quantities; suspect something that was not"
            " recorded."
        )
    else:
        rest = [
            d
            for d in found
            if d.explained < SMALL and len(d.curves) < 2 and d.unit and "folded" not in d.feature
        ]
        free = (
            f", and hardly depends on {_listing([d.feature for d in rest[:LEADERS]])}"
            if rest
            else ""
        )
        fitted = top[0].feature in FITTED
        held = "" if fitted else ", held out"
        text = f"{lead} {top[0].text} ({100 * top[0].explained:.0f} % of it{held}){free}."
    return UnknownDescription(obs.name, obs.stage, obs.unit, text, tuple(top))


def _one_sided(problem: Problem, prediction: Array, o: int) -> list[Dependency]:
    """In how many blocks an event is had by one side alone, if most of its residual is of these:
    what stands for that is no time or velocity, which might depend on anything.
    """
    own = (problem.obs_of == o) & problem.mask
    missed = own & problem.mismatched(prediction)
    power = np.where(own, problem.y - prediction, 0.0) ** 2
    share = float(power[missed].sum() / max(power.sum(), TINY))
    if share <= MOST:
        return []
    said = []
    for which, text in (
        (missed & problem.absent, "did not happen in {} where the twin predicts it"),
        (missed & ~problem.absent, "happened in {} where the twin does not predict it"),
    ):
        if which.any():
            names = problem.names_of(problem.block_of[which].tolist())
            said.append(text.format(f"{which.sum()} of {own.sum()} blocks ({names})"))
    text = f"is mostly that it {' and '.join(said)}"
    return [Dependency(ONE_SIDED, "", share, text)]


def _regressed(table: Table, unit: str) -> list[Dependency]:
    """What a residual depends on; or its level, which any feature would explain, where it hardly
    varies or no feature explains most of how it does.
    """
    r, level = table.residual, float(np.mean(table.residual))
    flat = replace(table, residual=r - level, scatter=table.scatter - np.mean(table.scatter))
    found = _distinct(list(regressions(flat)))
    whole = max(float(np.sum(r**2)), TINY)
    rest = float(np.sum(flat.residual**2)) / whole
    if rest > SMALL and any(x.explained > MOST for x in found):
        shape = [replace(x, explained=1.0 - rest + rest * x.explained) for x in found]
        return [_worded(table, x, unit) for x in shape]
    block = np.unique(table.group, return_inverse=True)[1]
    count, total = np.bincount(block), np.bincount(block, r)
    others = (float(np.sum(r)) - total) / np.maximum(r.size - count, 1)  # without each block
    held_out = 1.0 - float(np.sum((r - others[block]) ** 2)) / whole
    text = f"is off by {amount(level, unit)} throughout"
    return [
        Dependency(LEVEL, "", held_out, text),
        *(_worded(flat, replace(x, explained=rest * x.explained), unit) for x in found),
    ]


def _distinct(found: list[Regression]) -> list[Regression]:
    """The regressions without those over a feature that goes with one which explains more: the
    same clock by two names is told once.
    """
    kept: list[Regression] = []
    for r in sorted(found, key=lambda r: -r.explained):
        alike = (
            k.x for k in kept if (k.direction is None, k.wave) == (r.direction is None, r.wave)
        )
        if all(abs(np.corrcoef(r.x, x)[0, 1]) < 1.0 - NEGLIGIBLE for x in alike):
            kept.append(r)
    return kept


def _hum(problem: Problem, prediction: Array, o: int) -> list[Dependency]:
    """The lines of an observable's residual whose phase is another in each block, if any."""
    rows = rows_of(problem, o, problem.y - prediction)
    hum = unphased_lines([[row] for row in rows], 0.0)
    if hum is None:
        return []
    line = np.concatenate([own for (own,) in hum.lines])
    whole = np.concatenate([x for _, x in rows])
    explained = float(np.sum(line**2) / max(float(np.sum(whole**2)), TINY))
    unit, size = problem.observables[o].unit, float(np.sqrt(2.0) * np.std(line))
    text = (
        f"holds a line of {' and '.join(f'{x:.3g}' for x in hum.hertz)} Hz, amplitude"
        f" {amount(size, unit)}, on a clock of its own: its phase is another in each block"
    )
    return [Dependency(OWN_CLOCK, "Hz", explained, text)]


def _bursts(problem: Problem, prediction: Array, o: int) -> list[Dependency]:
    """When an observable's residual is large, if half of its power lies in little of the time: what
    happens now and then, like a link that fails or a brake that drags.
    """
    rows = rows_of(problem, o, problem.y - prediction)
    x = np.concatenate([y for _, y in rows])
    power = np.sort(x**2)[::-1]
    most = int(np.searchsorted(np.cumsum(power), MOST * float(power.sum()))) + 1
    if most > BURST * x.size:
        return []
    apart = SMALL * float(np.median([np.ptp(t) for t, _ in rows]))
    starts: list[float] = []
    for t, y in rows:
        large = t[y**2 >= power[most - 1]]
        starts += large[np.diff(large, prepend=-np.inf) > apart].tolist()
    if len(starts) < 2:  # one moment is no kind of thing
        return []
    when = ", ".join(f"{s:.3g}" for s in sorted(starts)[:LEADERS])
    others = " …" if len(starts) > LEADERS else ""
    clock = f", at {when}{others} s" if problem.on_session_clock else ""
    text = (
        f"comes in {len(starts)} bursts: half of its power lies in {100 * most / x.size:.2g} % of"
        f" the time{clock}"
    )
    return [Dependency(BURSTS, "", MOST, text)]


def _listing(names: list[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " or " + names[-1]


def _worded(table: Table, r: Regression, unit: str) -> Dependency:
    if r.wave is not None:
        return _sinusoid(table, r, unit, r.wave)
    if r.direction is None:
        curve = _curve(table, r.x)
        text = _words(r.feature, r.unit, unit, *curve)
        return Dependency(r.feature, r.unit, r.explained, text, (curve,))
    sides = (r.direction > 0, r.direction <= 0)
    apart = _apart(table, r.x, sides, unit)
    text = f"depends on {r.feature} and on the direction of motion{apart}"
    curves = tuple(_curve(table, r.x, side) for side in sides)
    return Dependency(r.feature, r.unit, r.explained, text, curves)


def _apart(table: Table, x: Array, sides: Sequence[NDArray[np.bool_]], unit: str) -> str:
    """How far the residual is apart between the `sides` of a motion where both pass: on average, or
    where most if that is in one place or has another sign elsewhere.
    """
    cell = bins(x, edges_of(x), None)
    count = [np.bincount(cell[own], minlength=cell.max() + 1) for own in sides]
    both = np.flatnonzero(np.minimum(*count) >= FEWEST_SAMPLES)
    if not both.size:
        return ""
    up, down = (
        np.bincount(cell[own], table.residual[own], cell.max() + 1)[both] / n[both]
        for own, n in zip(sides, count, strict=True)
    )
    gap = up - down
    most, whole = float(gap[int(np.argmax(np.abs(gap)))]), float(np.mean(gap))
    if abs(whole) >= MOST * abs(most):
        return f" (on average {amount(whole, unit)} apart between directions)"
    return f" (up to {amount(abs(most), unit)} apart between directions)"


def _curve(table: Table, x: Array, chosen: NDArray[np.bool_] | bool = True) -> tuple[Array, Array]:
    """Means (n,) of x and of the residual by bins of x, of what is `chosen`."""
    edges = edges_of(x)
    cell = bins(x, edges, None)
    each = [chosen & (cell == k) for k in range(max(edges.size - 1, 1))]
    enough = [use for use in each if use.sum() >= FEWEST_SAMPLES]
    centre, mean = (np.array([np.mean(v[use]) for use in enough]) for v in (x, table.residual))
    return centre, mean


def _words(name: str, x_unit: str, unit: str, x: Array, y: Array) -> str:  # noqa: PLR0911
    if y.size < FEWEST_SAMPLES:
        return f"changes with {name}"
    span = float(np.ptp(y))
    rise = np.diff(y)
    at = f" {x_unit}" if x_unit else ""
    size = f"by {amount(span, unit)} over {x[0]:.3g} to {x[-1]:.3g}{at}"
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
        if fits[best] > 1.0 - SMALL:
            return f"goes {best} {name}, {size}"
    top = float(np.max(np.abs(y - np.median(y))))
    local = np.flatnonzero(np.abs(y - np.median(y)) > MOST * top)
    if 0 < local.size <= y.size // 2 and np.ptp(local) < local.size:
        edge = 0.5 * (x[local[0] - 1] + x[local[0]]) if local[0] > 0 else x[0]
        end = 0.5 * (x[local[-1]] + x[local[-1] + 1]) if local[-1] < y.size - 1 else x[-1]
        far = float(y[local[int(np.argmax(np.abs(y[local])))]])
        most = amount(math.copysign(top, far), unit)
        if local[-1] == y.size - 1:
            return f"sets in where {name} exceeds {edge:.3g}{at} and grows to {most}"
        if local[0] == 0:
            return f"sets in where {name} is below {end:.3g}{at} and grows to {most}"
        return f"appears where {name} is {edge:.3g} to {end:.3g}{at}, up to {most}"
    middle, half = 0.5 * (x[0] + x[-1]), 0.5 * max(float(np.ptp(x)), TINY)
    z = (x - middle) / half
    bend = np.polyfit(z, y, 2)
    turn = middle - half * bend[1] / (2 * bend[0]) if bend[0] else np.inf
    if _share(np.asarray(np.polyval(bend, z), float), y) > 1.0 - SMALL and x[0] < turn < x[-1]:
        way = "lowest" if bend[0] > 0 else "highest"
        return (
            f"is {way} near {name} = {turn:.3g}{at} and {'rises' if bend[0] > 0 else 'falls'}"
            f" to both sides, {size}"
        )
    share = float(np.sum(rise[rise > 0]) / max(np.sum(np.abs(rise)), TINY))
    if share > 1.0 - SMALL:
        return f"rises with {name}, {size}"
    if share < SMALL:
        return f"falls with {name}, {size}"
    return f"varies with {name}, {size}"


def amount(x: float, unit: str) -> str:
    """A number with its unit, by a prefix where a plain unit would leave many noughts."""
    x = float(f"{x:.3g}")
    if unit in PREFIXED and 0.0 < abs(x) < 0.01:
        power = max(3 * math.floor(math.log10(abs(x)) / 3), min(PREFIXES))
        return f"{x / 10.0**power:.3g} {PREFIXES[power]}{unit}"
    return f"{x:g} {unit}"


def _share(shape: Array, y: Array) -> float:
    design = np.array([shape, np.ones(shape.size)]).T
    left = y - design @ np.linalg.lstsq(design, y, rcond=None)[0]
    return 1.0 - float(left @ left) / max(float(np.sum((y - y.mean()) ** 2)), TINY)


def _sinusoid(table: Table, r: Regression, unit: str, wave: tuple[float, float]) -> Dependency:
    (f, amplitude), name, x_unit = wave, r.feature, r.unit
    rate = f"{f:.3g} Hz" if x_unit == "s" else f"{f:.3g} periods per {x_unit or 'unit'}"
    if x_unit == "rad":
        rate += f", {2 * np.pi * f:.1f} per turn"
    text = f"repeats with {name} ({rate}), amplitude {amount(amplitude, unit)}"
    if name == SESSION and in_step(table, r.x, f):
        text = (
            f"changes over the session in step with the blocks, by {amount(amplitude, unit)}: as"
            " what each of them does would, that changes slowly"
        )
    curve = _curve(table, np.mod(r.x, 1.0 / f))
    return Dependency(f"{name}, folded", x_unit, r.explained, text, (curve,))
