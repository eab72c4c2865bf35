"""What goes wrong in logs, mended where that is safe and always said: clock resets, spikes, wraps,
signs, dead columns.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.log import Log
from pianobot_ros.gap.floor.estimate import resolution
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.recordings.spikes import median_of_five, spikes
from pianobot_ros.gap.problem.types import Array

TURN = 2.0 * math.pi
MAGNITUDE = (
    "effort never turns negative and fits the motion only as a magnitude; it was left out"
    " (--columns effort=HEADER takes it as signed)"
)


STEPS = 8
"""Steps of the encoder that a joint must move by at least."""
STRETCH = 0.1
"""s over which work is summed up."""
CERTAIN = 4.0
"""Standard errors from which a sign is certain."""
HUNG, OFTEN = 0.1, 20.0
"""s, and times as long as a number usually stays, for which a position that stays the same may
hang."""
JUMP = 3.0
"""Times the steps that a joint takes from row to row (99 % of them), of a jump after a hang."""
ROUND = 0.9
"""Part of all that is read, of a jump from one end of a device's range to the other."""
CLOSER = 0.7
"""Part of a clock's usual step below which rows are closer than the logger writes them: sorted, the
stamps of before and behind a reset lie between each other.
"""
AT = 0.1
"""Share of a leap within which a joint is where it is sent."""
HUGE = 1e6
"""rad or m; a hundred thousand turns."""


def mended(log: Log) -> Log:
    """`log` without spikes, wraps and dead columns; `notes` say what was done. Raises GapError if
    the axis does not move.
    """
    notes = list(log.notes)
    position = despiked(log.position, "position", notes)
    position = unwrapped(position, "position", notes, comes_round(position))
    command = (
        None
        if log.command is None
        else unwrapped(despiked(log.command, "command", notes), "command", notes)
    )
    known = position[np.isfinite(position)]
    if known.size < 20 or float(np.ptp(known)) == 0.0:
        raise GapError(
            f"{log.name}: the axis never moves (its position is constant){_although(command)}; a"
            " log with motion is needed"
        )
    if known.size > 50 and float(np.std(known)) < 2.0 * _white(known):
        raise GapError(
            f"{log.name}: the axis moves no more than its own noise; a log with motion is needed"
        )
    step = resolution(known)
    if float(np.ptp(known)) < STEPS * step:
        raise GapError(
            f"{log.name}: the axis moves by {float(np.ptp(known)) / step:.0f} steps of its encoder"
            " in all; a log with motion is needed"
        )
    if float(np.max(np.abs(known))) > HUGE:
        raise GapError(
            f"{log.name}: positions up to {float(np.max(np.abs(known))):.2g} {log.unit} are no"
            " joint's; --units position=… or --columns position=HEADER says what they are"
        )
    velocity, effort = (
        None if y is None else _alive(despiked(y, what, notes), what, notes)
        for y, what in ((log.velocity, "velocity"), (log.effort, "effort"))
    )
    return replace(
        log,
        position=position,
        command=command,
        velocity=velocity,
        effort=effort,
        notes=tuple(notes),
    )


def in_order(t: Array, notes: list[str]) -> Array:
    """Time stamps (n,) in the order of recording with resets of the clock undone.

    A clock that was reset comes back to times that it has shown already; rows that are only out of
    order fill a hole that they left, and are for the caller to sort.
    """
    step = np.diff(t)
    forward = step[step > 0]
    if forward.size < 3:
        return t
    typical = float(np.median(forward))
    back = np.flatnonzero(step < -20.0 * typical)
    if back.size == 0 or back.size > 0.01 * t.size:  # none, or a shuffled log
        return t
    gaps = np.diff(np.sort(t))
    closer = float(np.mean(gaps < CLOSER * typical) - np.mean(forward < CLOSER * typical))
    if closer < 0.01 and float(np.max(gaps)) < 20.0 * typical:
        return t  # sorted, the rows are as far apart as they were written
    t = t.copy()
    for k in back:
        t[k + 1 :] += t[k] - t[k + 1] + typical
    notes.append(
        f"the clock jumps back {back.size} time(s); taken as resets, rows kept in the order of"
        " recording"
    )
    return t


def astray(t: Array) -> NDArray[np.bool_]:
    """Time stamps (n,) that are far from those of the rows around them: a damaged row."""
    if t.size < 20:
        return np.zeros(t.size, bool)
    near = median_of_five(t)
    far = 100.0 * max(float(np.median(np.abs(np.diff(t)))), 1e-300)
    return (np.abs(t - near) > far) | _unstamped(t)


def _unstamped(t: Array) -> NDArray[np.bool_]:
    """Stamps (n,) of 0 at either end that are far from the next one: rows from before the clock was
    read, or of an array that was never filled.
    """
    out = np.zeros(t.size, bool)
    step = np.abs(np.diff(t))
    far = 100.0 * float(np.median(step[step > 0.0])) if step.any() else math.inf
    for x, own in ((t, out), (t[::-1], out[::-1])):
        k = int(np.argmax(x != 0.0))
        own[:k] = k > 0 and abs(float(x[k])) > far
    return out


def integral(y: Array, step: Array | float) -> Array:
    """What y (n,) adds up to from 0 on, by trapezoids; samples are `step` (n - 1,) s apart."""
    return np.concatenate([[0.0], np.cumsum(0.5 * step * (y[1:] + y[:-1]))])


def _without_hangs(position: Array, command: Array | None, t: Array, notes: list[str]) -> Array:
    """A position (n,) without the stretches in which its sensor hung: one number to the last digit
    while the command (n,) goes on, and then a jump to where the joint is by now. One that stands,
    since its friction or its drive's dead band holds it, sets out without a jump.
    """
    known = np.flatnonzero(np.isfinite(position))
    if command is None or known.size < 100:
        return position
    step = np.abs(np.diff(position[known]))
    edge = np.flatnonzero(np.concatenate([[True], step > 0.0, [True]]))
    length = np.diff(edge)
    long = length > OFTEN * float(np.median(np.repeat(length, length)))
    jump = JUMP * float(np.quantile(step, 0.99))
    out: Array = position.copy()
    lost = 0.0
    for first, count in zip(edge[:-1][long], length[long], strict=True):
        own = known[first : first + count]
        lasting = float(t[own[-1]] - t[own[0]])
        leaps = first + count < known.size and step[first + count - 1] > jump
        if leaps and lasting > HUNG and np.ptp(command[own]) > 0.0:
            out[own[1:]] = math.nan
            lost += lasting
    if lost:
        notes.append(f"the position hangs for {lost:.3g} s while its command moves: left out")
    return out


def as_read(
    position: Array, command: Array | None, t: Array, notes: list[str]
) -> tuple[Array, Array | None]:
    """A position (n,) and its command (n,) at times t (n,) s without what is no reading: see
    `_since_read` and `_without_hangs`.
    """
    position, command = _since_read(position, command, t, notes)
    return _without_hangs(position, command, t, notes), command


def _since_read(
    position: Array, command: Array | None, t: Array, notes: list[str]
) -> tuple[Array, Array | None]:
    """A position (n,) without the zeros that a program holds before it has read the first one, and
    its command (n,) without those before the first one was given, at times t (n,) s.

    No joint leaves a zero by a leap that all its other steps together stay far below. The command
    must not have been there with it, unless it was as unknown and leaps to the same place; and one
    that the joint rests far from, and then is at, had not been given.
    """
    wanted = np.full(t.size, math.nan) if command is None else command
    first, early = _zeros(position, t), _zeros(wanted, t)
    if 0 < first < t.size:
        leap = abs(float(position[first]))
        there = np.abs(wanted[:first])
        together = first == early and abs(float(position[first] - wanted[first])) < AT * leap
        if together or not np.any(there < 0.5 * leap):
            position = np.where(np.arange(t.size) < first, math.nan, position)
            notes.append(f"the position is 0 in the first {first} row(s), and leaps: left out")
    rest = position[:early]
    if command is None or not early or not np.isfinite(rest).any():
        return position, command
    far, moved = float(np.nanmin(np.abs(rest))), float(np.nanmax(rest) - np.nanmin(rest))
    if max(moved, abs(float(rest[np.isfinite(rest)][-1] - command[early]))) < AT * far:
        command = np.where(np.arange(t.size) < early, math.nan, command)
        notes.append(
            f"the command is 0 in the first {early} row(s), far from where the joint rests, and"
            " then there: none was given yet, left out"
        )
    return position, command


def _zeros(y: Array, t: Array) -> int:
    """How many rows of y (n,) are 0 before it leaps, further than in any other step and by no hole
    in its times t (n,); 0 if there are none.
    """
    known = np.flatnonzero(np.isfinite(y))
    x = y[known]
    if x.size < 100 or x[0] != 0.0 or not x.any():
        return 0
    k = int(np.argmax(x != 0.0))
    step, apart = np.abs(np.diff(x)), np.diff(t[known])
    leaps = step[k - 1] > JUMP * float(np.max(step[k:], initial=0.0))
    whole = apart[k - 1] < 2.0 * float(np.median(apart))
    return int(known[k]) if leaps and whole and k < x.size // 2 else 0


def despiked(y: Array, what: str, notes: list[str]) -> Array:
    """Readings that are far off for a sample or two become NaN (see `spikes`)."""
    y = np.where(np.isfinite(y), y, np.nan)
    known = np.flatnonzero(np.isfinite(y))
    bad = spikes(y[known])
    if bad.any():
        y[known[bad]] = np.nan
        notes.append(f"{int(bad.sum())} spike(s) in {what} left out")
    return y


def unwrapped(y: Array, what: str, notes: list[str], period: float | None = None) -> Array:
    """Angle (n,) without its jumps by a turn, if it looks wrapped; or by the `period` at which it
    comes round, if that is told (0: it does not).
    """
    period = _turns(y) if period is None else period
    if not period:
        return y
    known = np.flatnonzero(np.isfinite(y))
    x = y[known]
    jumps = int((np.abs(np.diff(x)) > 0.5 * period).sum())
    y = y.copy()
    y[known] = np.unwrap(x, period=period)
    size = "a turn" if period == TURN else f"{period:.4g}, at which it comes round"
    notes.append(f"{what} unwrapped at {jumps} jump(s) by {size}")
    return y


def comes_round(position: Array) -> float:
    """Period with which positions (n,) start again, or 0: a turn, or the range of the device, from
    one end of which to the other the readings jump while the joint moves on in one direction.

    That is asked of positions only: a command may jump where a joint cannot.
    """
    x = position[np.isfinite(position)]
    turn = _turns(x)
    if turn or x.size < 20:
        return turn
    span, step = float(np.ptp(x)), np.diff(x)
    at = np.flatnonzero(np.abs(step[1:-1]) > ROUND * span) + 1
    if not 0 < at.size <= 0.1 * x.size:
        return 0.0
    others = np.abs(np.delete(step, at))
    if float(others.max()) > 0.2 * span:
        return 0.0
    way, before, after = -np.sign(step[at]), step[at - 1], step[at + 1]
    on = (way * before > 0.0) & (way * after > 0.0)  # a reading at the end may go to and fro
    if 2 * on.sum() < at.size:
        return 0.0
    periods = np.abs(step[at]) + 0.5 * way * (before + after)
    return float(np.median(periods[on]))


def _turns(y: Array) -> float:
    """A turn, if angles (n,) stay within one and jump by almost a whole one; else 0."""
    x = y[np.isfinite(y)]
    if x.size < 3 or float(np.ptp(x)) > 1.02 * TURN:
        return 0.0
    jumps = np.abs(np.diff(x)) > 0.8 * TURN
    return TURN if 0 < jumps.sum() <= 0.1 * x.size else 0.0


def _although(command: Array | None) -> str:
    """What to say of a joint that stands still while its command moves."""
    known = np.zeros(1) if command is None else command[np.isfinite(command)]
    if not known.size or float(np.ptp(known)) == 0.0:
        return ""
    return (
        f", though its command moves by {float(np.ptp(known)):.3g}: the drive is off, or the"
        " position is another one's (--columns position=HEADER)"
    )


def _alive(y: Array, what: str, notes: list[str]) -> Array | None:
    if np.nanmax(y) - np.nanmin(y) > 0:
        return y
    notes.append(f"{what} is constant throughout and was left out")
    return None


def _white(y: Array) -> float:
    return float(np.sqrt(np.mean((y[:-2] - 2 * y[1:-1] + y[2:]) ** 2) / 6.0))


def oriented(
    log: Log, effort: Array, q: Array, v: Array, a: Array, dt: float, notes: list[str]
) -> Array | None:
    """Effort (n,) of a log positive in the direction of motion, or None if it is only a magnitude;
    smoothed, beside smoothed motion, samples dt (s) apart.

    Whether it ever turns negative is asked of the log's own column: smoothing undershoots.

    A joint takes power from its motor on average, and friction takes power wherever it moves: if
    the effort's work says neither, the column counts the other way round (see `_gives_power`).
    Nothing is judged where the joint moves one way only.
    """
    slow = 0.1 * float(np.sqrt(np.mean(v**2)))
    if (
        slow == 0.0
        or min(float(np.mean(v > slow)), float(np.mean(v < -slow))) < 0.1
        or float(np.std(effort)) == 0.0
    ):
        return effort
    x = np.array([a, v, np.tanh(v / (0.3 * slow)), np.ones(v.size), np.sin(q), np.cos(q)]).T
    fitted, _ = _fitted(x, effort)
    size = float(np.sqrt(np.mean(effort**2)))
    known = effort if log.effort is None else log.effort[np.isfinite(log.effort)]
    positive = float(np.mean(known < -1e-3 * size)) < 1e-3
    if not log.signed and positive and float(np.quantile(effort, 0.05)) < 0.5 * size:
        left = float(np.mean((fitted - effort) ** 2))
        as_size = min(_as_magnitude(x, effort, np.sign(v)), _as_magnitude(x, effort, np.sign(a)))
        if as_size < 0.8 * left:
            notes.append(MAGNITUDE)
            return None
    alone = not any(float(np.ptp(y[np.isfinite(y)])) > 0 for y in log.others.values())
    if _gives_power(effort, q, v, dt, alone):
        notes.append("effort counts against the direction of motion; taken with the other sign")
        return -effort
    return effort


def _gives_power(effort: Array, q: Array, v: Array, dt: float, alone: bool) -> bool:
    """Whether the work of an effort (n,) is negative in all and its friction certainly so. Joints
    that move together pass power to each other, so where this one is not ``alone`` friction must
    take more than all that these terms do not explain. Gravity that another joint turns may look
    like that, where nothing rubs (a sensor of torque behind the gear): an inertia that certainly
    takes power when it speeds up says that the sign is right.

    The work in each of many short stretches is that on inertia, gravity, a constant and dry and
    viscous friction. It needs no acceleration, whose noise and whose likeness to gravity in free
    motion would mislead.
    """
    n = max(2, round(STRETCH / dt))
    ends = np.arange(0, q.size, n)

    def grown(y: Array) -> Array:
        return np.asarray(np.diff(y[ends]))

    def summed(y: Array) -> Array:
        return grown(integral(y, dt))

    x = np.array(
        [grown(y) for y in (0.5 * v**2, -np.cos(q), np.sin(q), q)]
        + [summed(np.abs(v)), summed(v**2)]
    ).T
    x = x / (np.sqrt(np.mean(x**2, axis=0)) + 1e-300)
    work = summed(effort * v)
    if work.size < 3 * x.shape[1] or not float(np.sum(work)) < 0.0 or not np.isfinite(x).all():
        return False
    fitted, beta = _fitted(x, work)
    parts = np.concatenate([np.zeros(4), np.sum(x[:, 4:], axis=0)])
    friction, left = float(parts @ beta), work - fitted
    spread = np.linalg.pinv(x.T @ x) * float(np.sum(left**2)) / (work.size - x.shape[1])
    if beta[0] > CERTAIN * math.sqrt(spread[0, 0]):
        return False
    if not alone:
        return friction < -float(np.sum(np.abs(left)))
    return friction < -CERTAIN * math.sqrt(float(parts @ spread @ parts))


def _as_magnitude(x: Array, effort: Array, sign: Array) -> float:
    """Mean square that a linear model of the motion leaves of |effort|, the lost sign being fitted,
    too.
    """
    fitted = effort
    for _ in range(5):
        fitted, _ = _fitted(x, effort * sign)
        sign = np.where(fitted < 0, -1.0, 1.0)
    return float(np.mean((np.abs(fitted) - effort) ** 2))


def _fitted(x: Array, y: Array) -> tuple[Array, Array]:
    beta = np.linalg.lstsq(x, y, rcond=None)[0]
    return np.asarray(x @ beta), np.asarray(beta)
