"""A log on one even grid, with the smoothed motion that the twin compares; what was not measured
stays marked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.filtering import derivative, low_pass
from pianobot_ros.axis.signals.log_repair import mended, oriented
from pianobot_ros.axis.signals.smoothing import Smoothing, smoothing
from pianobot_ros.gap.floor.estimate import resolution
from pianobot_ros.gap.problem.types import Array

MAX_RATE = 250.0
HIGHEST = 15.0
"""Hz; highest cut of the smoothing."""
HOLE = 6.0
"""Sample intervals without a measurement from which a stretch counts as not measured."""


@dataclass(frozen=True)
class Clean:
    """A log on a uniform grid (n,), with the smoothed motion q, v, a and effort that the inverse
    model compares.
    """

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
    """Running integral of command minus position, rad s, without its trend: the past of a
    controller's integral action.
    """
    cutoff: float
    """Of the smoothing, Hz."""
    others: Mapping[str, Array]
    """Smoothed positions (n,) of the robot's other joints."""
    step: int
    """Every `step`-th sample of the smoothed signals is independent enough to be compared."""
    model: Array | None = None
    """What a model of the whole robot says (n, 3): sine and cosine of gravity, inertia."""
    coupling: Array | None = None
    """What the other joints' motion draws of the effort by that model (n,)."""
    drawn: Array | None = None
    """Effort (n,) that other joints' motion draws, as fitted (see `neighbours.py`)."""
    draws: Mapping[str, Array] = field(default_factory=dict)
    """The coefficients of that by joint, as fitted here or known from a reference."""
    modelled: Array | None = None
    """Effort (n,) that holds the joint against gravity, by the model of the robot."""
    twist: Array | None = None
    """By how much (n,) the motor is ahead of what is behind gear and spring, smoothed, rad."""
    before: float = 0.0
    """Seconds of the session before this log."""

    @property
    def middle(self) -> float:
        """Mean command, rad; mean position without one."""
        return float(np.mean(self.position if self.command is None else self.command))

    @property
    def blurred(self) -> bool:
        """Whether it is smoothed further than usual: its acceleration is mostly noise at that, and
        what lasts for milliseconds is lost.
        """
        return self.cutoff < _usual_cutoff(self.dt)

    @property
    def own_effort(self) -> Array | None:
        """Effort (n,) without what other joints draw and what a model of the robot explains."""
        return None if self.effort is None else self.left(self.effort)

    def left(self, effort: Array) -> Array:
        """Of an effort (n,) what other joints' motion and a model of the robot do not explain."""
        for known in (self.drawn, self.modelled):
            effort = effort if known is None else effort - known
        return effort


def _usual_cutoff(dt: float) -> float:
    """What samples `dt` s apart are smoothed at, Hz."""
    return min(HIGHEST, 0.2 / dt)


def clean(log: Log, cutoff: float | None = None) -> Clean:
    """Resample to a uniform grid (at most 250 Hz) and smooth at `cutoff` Hz (default: a fifth of
    the rate, at most 15, and less where that leaves mostly noise; see `smoothing.py`).

    What is wrong with the log is mended first (see `log_repair.py`).
    """
    log = mended(log)
    dt = log.interval
    keep = max(1, math.floor(1.0 / (MAX_RATE * dt) + 1e-6))
    fine = np.arange(log.t[0], log.t[-1] + 0.5 * dt, dt)

    grid = partial(_averaged, log.t, fine, keep)
    position, command = grid(log.position), grid(log.command)
    velocity, effort = grid(log.velocity), grid(log.effort)
    assert position is not None
    t = fine if keep == 1 else fine[: (fine.size // keep) * keep].reshape(-1, keep).mean(1)
    dt *= keep
    fixed = cutoff is not None
    cutoff = cutoff or _usual_cutoff(dt)
    notes = list(log.notes)
    # what smoothing carries over a hole's edges is no measurement
    valid = _valid(log, t, 0.5 / cutoff, notes)
    if effort is not None:
        effort = _oriented(log, position, effort, dt, cutoff, notes)
        log = replace(log, effort=None if effort is None else log.effort)
    if effort is not None and not fixed:
        found = smoothing(position, effort - _modelled(log, t, position), dt, cutoff, valid)
        notes += _said(found, cutoff, t, log)
        cutoff, valid = found.cutoff, valid & ~found.pushed
    smooth = partial(low_pass, dt=dt, cutoff=cutoff)
    q = smooth(position)
    v = derivative(q, dt)
    return Clean(
        replace(log, notes=tuple(notes)),
        t,
        dt,
        position,
        command,
        None if velocity is None else smooth(velocity),
        None if effort is None else smooth(effort),
        q,
        v,
        derivative(v, dt),
        valid,
        _gathered(t, position, command),
        cutoff,
        {name: smooth(x) for name, y in log.others.items() if (x := grid(y)) is not None},
        max(1, round(1.0 / (4.0 * cutoff * dt))),
        None if log.model is None else _on_grid(log.model, log.t, t),
        None if (drawn := grid(log.coupling)) is None else smooth(drawn),
        twist=None if (link := grid(log.link)) is None else smooth(position - link),
    )


def _modelled(log: Log, t: Array, position: Array) -> Array:
    """Effort (m,) at times t that a model of the robot says of the joint's weight and of what the
    others draw, where it is in the model's unit; else 0.
    """
    if log.model is None or log.coupling is None or log.effort_unit not in {"Nm", "N"}:
        return np.zeros(t.size)
    sine, cosine, _ = _on_grid(log.model, log.t, t).T
    drawn = np.interp(t, log.t, log.coupling)
    return np.asarray(sine * np.sin(position) + cosine * np.cos(position) + drawn)


def _averaged(time: Array, fine: Array, keep: int, y: Array | None) -> Array | None:
    """Samples ``y`` (n,) at ``time`` (n,) on the grid ``fine``, whole groups of ``keep`` averaged,
    centred, so that nothing is shifted or aliased; None with fewer than two that are numbers.
    """
    if y is None:
        return None
    ok = np.isfinite(y)
    if ok.sum() < 2:
        return None
    x = np.interp(fine, time[ok], y[ok])
    if keep > 1:
        n = (x.size // keep) * keep
        x = x[:n].reshape(-1, keep).mean(1)
    return np.asarray(x)


def _oriented(
    log: Log, position: Array, effort: Array, dt: float, cutoff: float, notes: list[str]
) -> Array | None:
    """Effort (n,) positive in the direction of motion, or None if it is only a magnitude."""
    q, pull = low_pass(position, dt, cutoff), low_pass(effort, dt, cutoff)
    v = derivative(q, dt)
    turned = oriented(log, pull, q, v, derivative(v, dt), dt, notes)
    if turned is None:
        return None
    return effort if turned is pull else -effort


def _said(found: Smoothing, usual: float, t: Array, log: Log) -> list[str]:
    """What there is to say of a log's smoothing, and of what pushed the joint."""
    out = []
    if found.cutoff < usual:
        out.append(
            f"smoothed at {found.cutoff:.2g} Hz: at {usual:.2g} Hz the acceleration is mostly noise"
        )
    if found.pushed.any():
        when = t[found.pushed]
        out.append(
            f"something outside pushed the joint, with up to {found.push:.2g} {log.effort_unit},"
            f" between {when[0]:.1f} and {when[-1]:.1f} s"
            f" ({found.pushed.sum() * (t[1] - t[0]):.1f} s in all): left out"
        )
    return out


def _on_grid(columns: Array, stamps: Array, t: Array) -> Array:
    return np.stack([np.interp(t, stamps, y) for y in columns.T], axis=1)


def _valid(log: Log, t: Array, margin: float, notes: list[str]) -> NDArray[np.bool_]:
    """Where on the grid t (m,) all columns were measured, less `margin` s around holes."""
    valid = np.ones(t.size, bool)
    for name in ("position", "command", "effort", "link"):
        if (column := getattr(log, name)) is not None:
            valid &= _measured(log.t, column, t, name, margin, notes)
    return valid


def _measured(
    stamps: Array, y: Array, t: Array, name: str, margin: float, notes: list[str]
) -> NDArray[np.bool_]:
    """Where on the grid t (m,) the samples y (n,) at `stamps` were measured, less `margin` s
    around holes; a run of missing samples is a hole, too, and is said.
    """
    x = stamps[np.isfinite(y)]
    if x.size < 2:
        return np.zeros(t.size, bool)
    pace = float(np.median(np.diff(x)))
    left = np.flatnonzero(np.diff(x) > HOLE * pace)
    edges = [(x[k], x[k + 1]) for k in left]
    edges += [(stamps[0] - margin, x[0])] if x[0] - stamps[0] > HOLE * pace else []
    edges += [(x[-1], stamps[-1] + margin)] if stamps[-1] - x[-1] > HOLE * pace else []
    good = np.ones(t.size, bool)
    for a, b in edges:
        good[np.searchsorted(t, a - margin) : np.searchsorted(t, b + margin)] = False
    if edges:
        lost = sum(min(b, stamps[-1]) - max(a, stamps[0]) for a, b in edges)
        share = 100.0 * lost / max(float(stamps[-1] - stamps[0]), 1e-9)
        notes.append(
            f"{name} was not measured in {len(edges)} stretch(es), {share:.2g} % of the time;"
            " they are left out"
        )
    return good


def _known(c: Clean, readings: Array | None) -> Array:
    """Readings (n,) that are numbers, of the log's position unless others are given."""
    y = c.log.position if readings is None else readings
    return np.asarray(y[np.isfinite(y)])


def quantisation(c: Clean, readings: Array | None = None) -> tuple[float, float, float]:
    """RMS error of q, v and a (rad, rad/s, rad/s²) that the steps of the encoder, or of another one
    with these `readings`, leave after smoothing.

    It is the same in every repeat of a motion, so scatter does not show it; differentiated twice it
    can be most of the effort.
    """
    step = resolution(_known(c, readings))
    if step == 0.0:
        return 0.0, 0.0, 0.0
    errors = []
    for shift in (0.0, 0.25, 0.5, 0.75):  # of a step
        true = c.q + shift * step
        smooth = low_pass(step * np.round(true / step), c.dt, c.cutoff) - low_pass(
            true, c.dt, c.cutoff
        )
        slope = derivative(smooth, c.dt)
        errors.append([np.std(smooth), np.std(slope), np.std(derivative(slope, c.dt))])
    averaged = math.sqrt(c.dt / c.log.interval)
    q, v, a = (float(x) / averaged for x in np.sqrt(np.mean(np.square(errors), axis=0)))
    return q, v, a


def vibration(logs: Sequence[Clean]) -> float:
    """RMS (rad) of what smoothing takes from the positions: nothing smoothed can tell of it."""
    return math.sqrt(max(float(np.mean((c.position - c.q)[c.valid] ** 2)) for c in logs))


def effort_noise(logs: Sequence[Clean]) -> float:
    """Density (effort · √s) of the efforts' white noise, the largest of the logs: their deviation
    times the root of the sample interval, which smoothing does not change.
    """
    found = [0.0]
    for log in (c.log for c in logs):
        y = np.zeros(0) if log.effort is None else log.effort[np.isfinite(log.effort)]
        if y.size >= 50:
            found.append(_white(y) * math.sqrt(log.interval))
    return max(found)


def _white(y: Array) -> float:
    """Deviation of a signal's (n,) white noise, by third differences: motion leaves little of
    itself in them.
    """
    noise = np.abs(y[:-3] - 3 * y[1:-2] + 3 * y[2:-1] - y[3:])
    return 1.48 * float(np.median(noise)) / math.sqrt(20.0)


def motion_noise(c: Clean, readings: Array | None = None) -> tuple[float, float, float]:
    """RMS error of q, v and a (rad, rad/s, rad/s²) by noise and steps of the encoder, or of another
    one with these `readings`. The noise is what neighbouring samples of the log disagree by, as it
    comes through smoothing.
    """
    known, steps = _known(c, readings), quantisation(c, readings)
    if known.size < 50:
        return steps
    # Of white noise smoothing leaves its density, whatever the grid that the log was put on.
    white = _white(known) * math.sqrt(c.log.interval / c.dt)
    smooth = low_pass(white * np.random.default_rng(0).standard_normal(2000), c.dt, c.cutoff)
    slope = derivative(smooth, c.dt)
    noise = [float(np.std(x)) for x in (smooth, slope, derivative(slope, c.dt))]
    q, v, a = (math.hypot(*pair) for pair in zip(noise, steps, strict=True))
    return q, v, a


def rest_speed(c: Clean) -> float:
    """Speed (rad/s) that noise and steps of the encoder show where the joint rests: two deviations,
    and at most a tenth of the RMS speed.
    """
    return min(2.0 * motion_noise(c)[1], 0.1 * float(np.sqrt(np.mean(c.v**2))))


UNSURE = 0.03
"""Share of the RMS speed below which the direction of dry friction is not certain."""


def unsure_speed(c: Clean) -> float:
    """Speed (rad/s) below which the direction of dry friction is not certain."""
    return UNSURE * float(np.sqrt(np.mean(c.v**2)))


def counted(c: Clean) -> NDArray[np.bool_]:
    """Samples (n,) whose effort counts: at rest dry friction holds whatever is there, also the
    effort's own noise, so that only what moves tells; all, where hardly anything does.
    """
    least = max(rest_speed(c), unsure_speed(c))
    moves = c.valid & (np.abs(c.v) > least)
    return moves if moves.sum() > 0.2 * c.valid.sum() else c.valid


def _gathered(t: Array, position: Array, command: Array | None) -> Array:
    if command is None:
        return np.zeros(t.size)
    integral = np.cumsum(command - position) * float(np.median(np.diff(t)))
    return np.asarray(integral - np.polyval(np.polyfit(t - t[0], integral, 1), t - t[0]))
