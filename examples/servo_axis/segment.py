"""One long log into blocks: cycles of a periodic command, else moves between rests, else equal windows; repeats are found."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, filtfilt

from examples.servo_axis.log import Log
from examples.servo_axis.repair import mended, oriented
from pianobot_ros.gap.errors import GapError
from pianobot_ros.gap.noise import resolution
from pianobot_ros.gap.types import Array, Block, Signal

MAX_RATE = 250.0
LEAD = 0.6
"""Seconds of command and position before a block that are handed to the twin, so that delays have a past."""


@dataclass(frozen=True)
class Clean:
    """A log on a uniform grid (n,), with the smoothed motion q, v, a and effort that the inverse model compares."""

    log: Log
    t: Array
    dt: float
    position: Array
    command: Array | None
    velocity: Array | None
    effort: Array | None
    q: Array
    v: Array
    a: Array
    valid: NDArray[np.bool_]
    gathered: Array
    """Running integral of command minus position, rad s, without its trend: the past of a controller's integral action."""
    cutoff: float
    """Of the smoothing, Hz."""
    step: int
    """Every `step`-th sample of the smoothed signals is independent enough to be compared."""


def low_pass(y: Array, dt: float, cutoff: float) -> Array:
    """Zero-phase second-order Butterworth, forwards and backwards; y (n,)."""
    b, a = butter(2, min(0.95, 2 * cutoff * dt))
    return np.asarray(filtfilt(b, a, y, padlen=min(y.size - 1, 50)))


def derivative(y: Array, dt: float) -> Array:
    """Slope (n,) by central differences of fourth order (second at the ends), so that slow logs lose no amplitude."""
    out = np.gradient(y, dt)
    out[2:-2] = (8 * (y[3:-1] - y[1:-3]) - (y[4:] - y[:-4])) / (12 * dt)
    return np.asarray(out)


def clean(log: Log, cutoff: float | None = None) -> Clean:
    """Resample to a uniform grid (at most 250 Hz) and smooth at `cutoff` Hz (default: a quarter of the rate, at most 15).

    What is wrong with the log is mended first (see `repair.py`).
    """
    log = mended(log)
    dt = float(np.median(np.diff(log.t)))
    keep = max(1, math.floor(1.0 / (MAX_RATE * dt) + 1e-6))
    fine = np.arange(log.t[0], log.t[-1] + 0.5 * dt, dt)

    def grid(y: Array | None) -> Array | None:
        if y is None:
            return None
        ok = np.isfinite(y)
        x = np.interp(fine, log.t[ok], y[ok])
        if keep > 1:  # average whole groups, centred, so that nothing is shifted or aliased
            n = (x.size // keep) * keep
            x = x[:n].reshape(-1, keep).mean(1)
        return np.asarray(x)

    position, command = grid(log.position), grid(log.command)
    velocity, effort = grid(log.velocity), grid(log.effort)
    assert position is not None
    t = fine if keep == 1 else fine[: (fine.size // keep) * keep].reshape(-1, keep).mean(1)
    dt *= keep
    cutoff = cutoff or min(15.0, 0.2 / dt)

    def smooth(y: Array) -> Array:
        return low_pass(y, dt, cutoff)

    q = smooth(position)
    v = derivative(q, dt)
    acceleration = derivative(v, dt)
    pull = None if effort is None else smooth(effort)
    if pull is not None:
        notes = list(log.notes)
        pull = oriented(pull, q, v, acceleration, notes)
        log = replace(log, effort=None if pull is None else log.effort, notes=tuple(notes))
    index = np.clip(np.searchsorted(log.t, t), 1, log.t.size - 1)
    hole = (log.t[index] - log.t[index - 1]) > 6 * dt
    if hole.any():  # what the smoothing carries over a hole's edges is no measurement either
        hole = np.convolve(hole, np.ones(2 * round(0.5 / (cutoff * dt)) + 1), "same") > 0
    return Clean(log, t, dt, position, command, None if velocity is None else smooth(velocity),
                 pull, q, v, acceleration, ~hole, _gathered(t, position, command), cutoff,
                 max(1, round(1.0 / (4.0 * cutoff * dt))))  # fmt: skip


def quantisation(c: Clean) -> tuple[float, float, float]:
    """RMS error of q, v and a (rad, rad/s, rad/s²) that the encoder's steps leave after smoothing.

    It is the same in every repeat of a motion, so scatter does not show it; differentiated twice it can be most of the effort.
    """
    known = c.log.position[np.isfinite(c.log.position)]
    step = resolution(known)
    if step == 0.0:
        return 0.0, 0.0, 0.0
    errors = []
    for shift in (0.0, 0.25, 0.5, 0.75):  # of a step
        true = c.q + shift * step
        smooth = low_pass(step * np.round(true / step), c.dt, c.cutoff) - low_pass(true, c.dt, c.cutoff)
        slope = derivative(smooth, c.dt)
        errors.append([np.std(smooth), np.std(slope), np.std(derivative(slope, c.dt))])
    averaged = math.sqrt(c.dt / float(np.median(np.diff(c.log.t))))
    q, v, a = (float(x) / averaged for x in np.sqrt(np.mean(np.square(errors), axis=0)))
    return q, v, a


def _gathered(t: Array, position: Array, command: Array | None) -> Array:
    if command is None:
        return np.zeros(t.size)
    integral = np.cumsum(command - position) * float(np.median(np.diff(t)))
    return np.asarray(integral - np.polyval(np.polyfit(t - t[0], integral, 1), t - t[0]))


def blocks_of(cleaned: Clean, most: int = 40) -> tuple[list[Block], str]:
    """Blocks of one log and one sentence on how it was cut."""
    driver = cleaned.command if cleaned.command is not None else cleaned.q
    if float(np.ptp(driver)) < 1e-6 and float(np.ptp(cleaned.q)) < 1e-6:
        raise GapError(f"{cleaned.log.name}: the axis never moves; a log with motion is needed")
    cuts, how = _cycles(driver, cleaned.dt, most)
    if not cuts:
        cuts, how = _moves(driver, cleaned.dt, most)
    if not cuts:
        cuts, how = _windows(driver.size, cleaned.dt, most)
    conditions = _conditions(driver, cuts)
    margin = round(0.15 / cleaned.dt)  # the smoothing filter's edges
    made = []
    for k, (i, j) in enumerate(cuts):
        i, j = max(i, margin), min(j, driver.size - margin)  # noqa: PLW2901
        if j - i >= 20:
            made.append(_block(cleaned, i, j, f"{cleaned.log.name}:{k}", f"{cleaned.log.name}:{conditions[k]}"))
    if not made:
        raise GapError(f"{cleaned.log.name}: too short to be cut into blocks")
    return made, how


def whole(c: Clean, name: str) -> Block:
    """The whole log as one block (but for the edges of the smoothing filter)."""
    margin = round(0.15 / c.dt)
    return _block(c, margin, c.t.size - margin, name, name)


def _block(c: Clean, i: int, j: int, name: str, condition: str) -> Block:
    lead = max(0, i - round(LEAD / c.dt))
    t, tl = c.t[i:j], c.t[lead:j]
    inputs = {
        "q": Signal(tl, c.q[lead:j], "rad"),
        "v": Signal(tl, c.v[lead:j], "rad/s"),
        "a": Signal(tl, c.a[lead:j], "rad/s²"),
    }
    bad = np.where(c.valid[i:j], 0.0, np.nan)
    outputs = {"position": Signal(t, c.position[i:j] + bad, "rad")}
    if c.command is not None:
        inputs["command"] = Signal(tl, c.command[lead:j], "rad")
        inputs["error integral"] = Signal(tl, c.gathered[lead:j], "rad s")
    sparse = slice(i, j, c.step)
    if c.effort is not None:
        inputs["effort"] = Signal(tl, c.effort[lead:j], c.log.effort_unit)
        outputs["effort"] = Signal(
            c.t[sparse], c.effort[sparse] + np.where(c.valid[sparse], 0.0, np.nan), c.log.effort_unit
        )
    if c.velocity is not None:
        outputs["velocity"] = Signal(c.t[sparse], c.velocity[sparse] + np.where(c.valid[sparse], 0.0, np.nan), "rad/s")
    span = float(c.t[-1] - c.t[0])
    n = len(t)
    phases = {
        "first third": (t[0], t[n // 3]),
        "middle": (t[n // 3], t[2 * n // 3]),
        "last third": (t[2 * n // 3], t[-1]),
    }
    return Block(name, condition, inputs, outputs, {}, {k: (float(a), float(b)) for k, (a, b) in phases.items()},
                 {"session_start": float(c.t[0]), "session_span": span, "start": float(t[0] - c.t[0]),
                  "speed": float(np.max(np.abs(c.v[i:j]))), "travel": float(np.ptp(c.q[i:j])), "cutoff": c.cutoff})  # fmt: skip


def _cycles(x: Array, dt: float, most: int) -> tuple[list[tuple[int, int]], str]:
    """Cycles of a periodic signal: the lag at which it repeats itself (almost) exactly."""
    moving = np.flatnonzero(np.abs(np.gradient(x)) > 0.01 * np.max(np.abs(np.gradient(x))))
    if moving.size < 20:
        return [], ""
    first, last = int(moving[0]), int(moving[-1]) + 1
    y = x[first:last]
    n = y.size
    spread = float(np.std(y))
    centred = y - y.mean()
    least = max(round(0.25 / dt), 10)
    size = 1 << (2 * n).bit_length()
    spectrum = np.fft.rfft(centred, size)
    auto = np.fft.irfft(np.abs(spectrum) ** 2, size)[:n]
    energy = np.cumsum(centred**2)
    lags = np.arange(least, n // 2 + 1)
    if lags.size < 3 or spread == 0:
        return [], ""
    left, right = energy[n - 1 - lags], energy[-1] - energy[lags - 1]
    corr = auto[lags] / np.sqrt(np.maximum(left * right, 1e-30))
    peaks = [k for k in range(1, lags.size - 1) if corr[k] >= corr[k - 1] and corr[k] >= corr[k + 1] and corr[k] > 0.95]
    for k in peaks:
        lag = int(lags[k])
        if float(np.quantile(np.abs(y[lag:] - y[:-lag]), 0.8)) < 0.02 * spread:  # all but a start or a stop
            period = _period(y, lag)
            count = int(n / period + 1e-6)
            group = max(1, math.ceil(count / most), math.ceil(1.0 / (lag * dt)))
            if count // group < 2:
                group = 1
            edges = [first + round(m * group * period) for m in range(count // group + 1)]
            cuts = [(a, min(b, last)) for a, b in pairwise(edges)]
            return cuts, f"{len(cuts)} repeats of a periodic command (period {period * dt:.2f} s)"
    return [], ""


def _period(y: Array, lag: int) -> float:
    """Period in samples, to a fraction of one: the shift by many periods at which the signal matches itself best."""
    many = max(1, y.size // lag - 1)
    best, error = lag * many, math.inf
    for shift in range(max(1, lag * many - many), min(y.size - lag // 2, lag * many + many) + 1):
        misfit = float(np.mean(np.abs(y[shift:] - y[:-shift])))
        if misfit < error:
            best, error = shift, misfit
    return best / many


def _moves(x: Array, dt: float, most: int) -> tuple[list[tuple[int, int]], str]:
    """Moves between rests of at least 0.3 s, cut in the middle of the rests."""
    speed = np.abs(np.gradient(x, dt))
    rest = speed < 0.01 * np.quantile(speed, 0.99)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], rest.astype(int), [0]])))
    rests = [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if (b - a) * dt >= 0.3]
    if len(rests) < 4:
        return [], ""
    middles = [a + min((b - a) // 2, round(0.5 / dt)) for a, b in rests]
    cuts = [(int(a), int(b)) for a, b in pairwise(middles) if (b - a) * dt >= 0.3]
    while len(cuts) > most:
        cuts = [(cuts[i][0], cuts[min(i + 1, len(cuts) - 1)][1]) for i in range(0, len(cuts), 2)]
    return (cuts, f"{len(cuts)} moves between rests") if len(cuts) >= 4 else ([], "")


def _windows(n: int, dt: float, most: int) -> tuple[list[tuple[int, int]], str]:
    count = int(np.clip(n * dt / 2.0, 4, min(most, 24)))
    edges = np.linspace(0, n, count + 1).astype(int)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)), f"{count} equal windows (nothing repeats)"


def _conditions(x: Array, cuts: list[tuple[int, int]]) -> list[int]:
    """Blocks whose driving signal agrees within 2 % of its spread are repeats of one condition."""
    spread = float(np.std(x)) or 1.0
    shapes: list[Array] = []
    labels: list[int] = []
    for i, j in cuts:
        piece = x[i:j]
        for label, shape in enumerate(shapes):
            n = min(piece.size, shape.size)
            if (
                abs(piece.size - shape.size) <= 0.02 * n + 2
                and float(np.sqrt(np.mean((piece[:n] - shape[:n]) ** 2))) < 0.02 * spread
            ):
                labels.append(label)
                break
        else:
            shapes.append(piece)
            labels.append(len(shapes) - 1)
    return labels
