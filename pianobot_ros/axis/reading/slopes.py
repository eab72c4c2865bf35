"""Tables without headers that hold one quantity of all joints after the other: their numbers tell
which columns are the slopes of which.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from pianobot_ros.axis.reading.columns.relations import (
    CLOSE,
    EQUAL,
    LEAD,
    LEFT,
    SLOPE,
    lead,
    left_over,
)
from pianobot_ros.axis.reading.source import Source, of_channels
from pianobot_ros.axis.signals.log_repair import integral
from pianobot_ros.gap.problem.types import Array

__all__ = ["in_blocks"]

ROWS = 4000
"""Rows that are compared; slopes are integrated over all."""
NOISE = 0.1
"""Share of a position's variance about a line that the integral of a noisy velocity leaves."""
MOVING = 0.05
"""Share of the largest motion of a block from which a joint counts as moving."""
ALIKE = 0.25
"""Logarithm within which the joints' factors agree: all have one unit and one clock."""
CLEAR = 1e-3
"""Share of a position's variance that only its own slope leaves, whatever the factor is: an effort
would have to be viscous but for a thirtieth."""
ROUNDED = 1e-4
"""Share of an error's variance that the rounding of the two numbers that it is of leaves."""
SURE = 3
"""Joints whose agreement tells that columns are slopes, whatever their factor is."""
FILLED = 0.99
"""Share of the rows in which a clock has a value."""
TICKS = 0.99999
"""Correlation with time of a column that is another clock."""
FIRST = 2
"""Blocks that may stand before the positions: their commands, and those commands' slopes."""


@dataclass(frozen=True)
class Slopes:
    """For columns i and j: share of i that the integral of j leaves, and its factor (n, n); how far
    each moves, and its integral (n,), lines apart. `drift` is the factor with the lines (n, n):
    where it differs, j does not say how far i comes.
    """

    left: Array
    factor: Array
    moves: Array
    sums: Array
    drift: Array


def in_blocks(source: Source, clock: str, rows: NDArray[np.intp], t: Array) -> tuple[Source, str]:
    """A table without headers with the roles of its columns, and what to say of it; the source as
    it is and "" where no columns are the slopes of others.

    Joints are 1 to n, a single one has no name. After the positions come their velocities, then the
    efforts; a block that the positions follow is their command. `rows` and their times t (n,) in s
    are those of the log.
    """
    heads = [h for h in source.table.columns if h != clock and not _counts(source.table.columns[h])]
    unnamed = source.table.headless or of_channels(source.table)
    if not unnamed or t.size < 100:
        return source, ""
    ticks = [h for h in heads if _ticks(t, source.table.columns[h][rows])]
    if len(ticks) == 1:  # a computer's clock beside a controller's: no block begins with it
        heads.remove(ticks[0])
    if len(heads) < 2:
        return source, ""
    own = [source.table.columns[h] for h in heads]
    y, moved = (np.stack(c, 1) for c in zip(*(_few(t, c[rows]) for c in own), strict=True))
    still = int(np.argmax(np.ptp(y, axis=0) > 0))
    for first in range(still + 1):  # a counter that stands, a mode, may be of no block
        found = _slopes(_every(t), y[:, first:], moved[:, first:])
        if at := _blocks(found):
            n, _ = at[0]
            roles = _roles(y[:, first:], found, n, [i for _, i in at])
            return _told(source, heads[first:], n, roles)
    found = _slopes(_every(t), y, moved)
    roles = _by_error(y, found) or _anywhere(y, found) or _beside_a_pair(y, found)
    return _told(source, heads, 1, roles) if roles else (source, "")


def _blocks(found: Slopes) -> list[tuple[int, int]]:
    """Size of the blocks of columns and place of each that is followed by its slopes, [] if none
    is, or not among the first.
    """
    count = found.moves.size
    for n in range(1, count // 2 + 1):
        at = [(n, i) for i in range(count // n - 1) if _sloped(found, i, i + 1, n)]
        if at and at[0][1] <= FIRST and not _moves_on(found, at[0][1], n):
            return at
    return []


def _counts(y: Array) -> bool:
    """Whether a column only counts the rows."""
    step = np.diff(y)
    return bool(step[0] != 0 and np.all(step == step[0]))


def _ticks(t: Array, y: Array) -> bool:
    """Whether a column rises with time as a clock does, but for a few rows that hold none."""
    known = np.isfinite(y)
    x = y[known]
    if known.mean() < FILLED or np.any(np.diff(x) < 0) or x[0] == x[-1]:
        return False
    return float(np.corrcoef(t[known], x)[0, 1]) > TICKS


def _whole(y: Array) -> Array:
    """A column (n,) with its holes bridged."""
    known = np.isfinite(y)
    if known.all():
        return y
    at = np.arange(y.size)
    return np.interp(at, at[known], y[known]) if known.any() else np.zeros(y.size)


def _every(x: Array) -> Array:
    return x[:: -(-x.size // ROWS)]


def _few(t: Array, y: Array) -> tuple[Array, Array]:
    """A column (n,) and its integral over all rows, both at a few of them."""
    y = _whole(y)
    return _every(y), _every(integral(y, np.diff(t)))


def _slopes(t: Array, y: Array, moved: Array) -> Slopes:
    """What the integral `moved` (n, k) of each of some columns y (n, k) leaves of each."""
    line, _ = np.linalg.qr(np.stack([np.ones(t.size), t - t.mean()], 1))

    def sized(x: Array) -> tuple[Array, Array]:
        size = np.max(np.abs(x), 0)  # no square overflows
        size = np.where(size > 0, size, 1.0)
        return x / size, size

    def apart(x: Array) -> Array:
        return np.asarray(x - line @ (line.T @ x))

    (y, here), (moved, there) = sized(y), sized(moved)
    q, p, level = apart(y), apart(moved), moved - moved.mean(0)
    power, theirs, both = (q**2).sum(0), (p**2).sum(0), q.T @ p
    with np.errstate(divide="ignore", invalid="ignore"):
        left = 1.0 - both**2 / (power[:, None] * theirs)
        scale = here[:, None] / there
        factor, drift = both / theirs * scale, y.T @ level / (level**2).sum(0) * scale
    return Slopes(left, factor, np.sqrt(power) * here, np.sqrt(theirs) * there, drift)


def _moving(found: Slopes, block: int, n: int) -> NDArray[np.intp]:
    """Columns of a block of n whose joints move."""
    own = np.arange(block * n, block * n + n)
    reach = found.moves[own]
    return np.asarray(own[reach > MOVING * reach.max()])


def _sloped(found: Slopes, block: int, slopes: int, n: int) -> bool:
    """Whether a block of n columns holds the slopes of another one: of nearly all joints that move,
    by one factor; a few joints need the factor of one unit, or, where others rest beside them,
    that hardly anything is left and how far they come is told, too.
    """
    own = _moving(found, block, n)
    if not own.size:
        return False
    theirs = own + (slopes - block) * n
    left, factor = found.left[own, theirs], found.factor[own, theirs]
    close = (left < NOISE) & (factor > 0)
    if 4 * close.sum() < 3 * own.size:
        return False
    size = np.log(factor[close])
    if float(np.ptp(size)) > 2 * ALIKE:
        return False
    with np.errstate(divide="ignore", invalid="ignore"):
        steady = np.abs(np.log(found.drift[own, theirs] / factor)) < ALIKE / 2
    clear = own.size < n and bool(np.all(steady[close] & (left[close] < CLEAR)))
    return close.sum() >= SURE or clear or bool(np.all(np.abs(size) < ALIKE / 2))


def _moves_on(found: Slopes, block: int, n: int) -> bool:
    """Whether a joint of a block of n rests whose slope, in the next block, adds up to more than
    its noise can, beside what others move: the blocks begin elsewhere.
    """
    own = _moving(found, block, n)
    rest = np.setdiff1d(np.arange(block * n, block * n + n), own)
    factor = float(np.median(np.abs(found.factor[own, own + n])))
    return bool(np.any((factor * found.sums[rest + n]) ** 2 > NOISE * found.moves[own].min() ** 2))


def _of(y: Array, found: Slopes, slopes: int, n: int) -> int:
    """The block of positions whose slopes another one holds."""

    def left(block: int) -> float:
        own = _moving(found, block, n)
        return float(np.median(found.left[own, own + (slopes - block) * n]))

    count = y.shape[1] // n
    blocks = [b for b in range(count) if b != slopes and _sloped(found, b, slopes, n)]
    return _followed(y, found, n, min(blocks, key=left), slopes)


def _followed(y: Array, found: Slopes, n: int, place: int, slopes: int) -> int:
    """The last block that clearly follows `place` and has the same slopes: a command has nearly
    those of its position, and goes before it. Where a fed-forward loop leaves no lag, a measured
    speed is the slope of what was measured.
    """
    for other in range(y.shape[1] // n):
        apart = other not in {place, slopes} and _sloped(found, other, slopes, n)
        if apart and _leads(y, place, other, n, found, LEAD):
            place = other
    return place


def _roles(y: Array, found: Slopes, n: int, at: Sequence[int]) -> dict[str, int]:
    """Block of each role: of two with slopes the one that goes before the other is the command."""
    count = y.shape[1] // n
    pairs = [(_of(y, found, i + 1, n), i + 1) for i in at]
    place, speed = pairs[0]
    for other, slopes in pairs[1:]:
        if _leads(y, place, other, n, found):
            place, speed = other, slopes
    rest = [b for b in range(count) if b not in {place, speed}]
    wanted = [b for b in rest if _leads(y, b, place, n, found)]
    wanted = wanted or [b for b in rest if _beside(y, b, place, n, found)]
    roles = {"position": place, "velocity": speed, **({"command": wanted[0]} if wanted else {})}
    behind, taken = speed + 1, {b for pair in pairs for b in pair}
    if behind < count and behind not in {*wanted, *taken}:
        speeds = {speed, *(b for b in rest if any(_sloped(found, w, b, n) for w in wanted))}
        if not any(_sloped(found, b, behind, n) for b in speeds - {behind}):
            roles["effort"] = behind  # and neither measured nor commanded accelerations
    return roles


def _by_error(y: Array, found: Slopes) -> dict[str, int]:
    """Columns of the roles of one joint of which one is the small difference of two others: their
    error, command minus position, whichever of the two goes before the other. {} if none is.
    """
    moving = np.flatnonzero(np.ptp(y, axis=0) > 0).tolist()
    power = np.var(y, axis=0)
    of = [
        (error, wanted, place)
        for error, wanted, place in permutations(moving, 3)
        if power[error] < CLOSE * power[place]
        if np.var(y[:, error] - y[:, wanted] + y[:, place]) < ROUNDED * power[error]
    ]
    if len(of) != 1:
        return {}
    ((_, wanted, place),) = of
    rest = [k for k in moving if k not in of[0]]
    speeds = [k for k in rest if found.left[place, k] < SLOPE and _sloped(found, place, k, 1)]
    spare = [k for k in rest if k not in speeds]
    roles = {"position": place, "command": wanted}
    roles |= {"velocity": speeds[0]} if len(speeds) == 1 else {}
    return roles | ({"effort": spare[0]} if len(spare) == 1 else {})


def _anywhere(y: Array, found: Slopes) -> dict[str, int]:
    """Columns of the roles of one joint whose velocity does not stand behind its position, {} if
    none is clearly its slope: what it follows is its command, and what alone is left its effort.
    """
    count = y.shape[1]
    pairs = [
        (float(found.left[i, j]), i, j)
        for i in range(count)
        for j in range(count)
        if i != j and found.left[i, j] < SLOPE and _sloped(found, i, j, 1)
    ]
    if len({speed for _, _, speed in pairs}) != 1:  # none, or several joints
        return {}
    _, place, speed = min(pairs)
    place = _followed(y, found, 1, place, speed)
    rest = [b for b in range(count) if b not in {place, speed}]
    wanted = [b for b in rest if _leads(y, b, place, 1, found)][:1]
    spare = [b for b in rest if b not in wanted]
    roles = {"position": place, "velocity": speed}
    roles |= {"command": wanted[0]} if wanted else {}
    return roles | ({"effort": spare[0]} if len(spare) == 1 else {})


def _beside_a_pair(y: Array, found: Slopes) -> dict[str, int]:
    """Columns of the roles of one joint without a velocity: of three that move a command, the
    position that follows it, and what alone is left, the effort; {} where that is not clear, or it
    is what the two make (their difference, say).
    """
    moving = np.flatnonzero(np.ptp(y, axis=0) > 0).tolist()
    pairs = [
        (i, j)
        for i in moving
        for j in moving
        if i != j and left_over(y[:, i], y[:, j]) < CLOSE and _leads(y, j, i, 1, found)
    ]
    if len(moving) != 3 or len(pairs) != 1:
        return {}
    ((place, wanted),) = pairs
    (spare,) = set(moving) - {place, wanted}
    of = np.stack([y[:, place], y[:, wanted], np.ones(y.shape[0])], 1)
    rest = y[:, spare] - of @ np.linalg.lstsq(of, y[:, spare], rcond=None)[0]
    if float(np.var(rest)) < SLOPE * float(np.var(y[:, spare])):
        return {}
    return {"position": place, "command": wanted, "effort": spare}


def _leads(y: Array, first: int, second: int, n: int, found: Slopes, least: float = 0.0) -> bool:
    """Whether most moving joints of a block follow those of another one."""
    own = _moving(found, second, n)
    before = own + (first - second) * n
    follow = [
        left_over(y[:, i], y[:, j]) < LEFT and lead(y[:, j], y[:, i]) > least
        for i, j in zip(own, before, strict=True)
    ]
    return 2 * sum(follow) > len(follow)


def _beside(y: Array, first: int, second: int, n: int, found: Slopes) -> bool:
    """Whether most moving joints of two blocks are alike, and the first does not clearly come
    behind: a command that its position hardly lags.
    """
    own = _moving(found, second, n)
    alike = [EQUAL < left_over(y[:, i], y[:, i + (first - second) * n]) < CLOSE for i in own]
    return 2 * sum(alike) > len(alike) and _leads(y, first, second, n, found, -LEAD)


def _told(
    source: Source, heads: Sequence[str], n: int, roles: Mapping[str, int]
) -> tuple[Source, str]:
    of = {
        heads[block * n + k]: (role, str(k + 1) if n > 1 else "")
        for role, block in roles.items()
        for k in range(n)
    }
    made = []
    for m in source.meanings:
        role, joint = of.get(m.header, ("", ""))
        wanted = role == "command"
        quantity = "position" if wanted else role
        told = replace(m, quantity=quantity, command=wanted, joint=joint, rank=0)
        made.append(told if role else replace(m, quantity="other", command=False))
    where = ", ".join(f"{role}={_range(heads, b, n)}" for role, b in roles.items())
    how = "velocities as the slopes of positions" if "velocity" in roles else "who follows whom"
    said = (
        f"no headers{_silent(heads)}; columns taken by their numbers, {how}: {where}"
        " (--columns says otherwise)"
    )
    return replace(source, meanings=tuple(made)), said


def _silent(heads: Sequence[str]) -> str:
    return "" if heads[0].startswith("column") else " that say a signal"


def _range(heads: Sequence[str], block: int, n: int) -> str:
    first, last = (heads[block * n + k].removeprefix("column") for k in (0, n - 1))
    return first if n == 1 else f"{first}-{last}"
