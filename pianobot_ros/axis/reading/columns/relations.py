"""What the numbers say where the names do not: which column follows which."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.reading.columns.assemble import Column, chosen
from pianobot_ros.axis.reading.columns.unit_scales import upside_down
from pianobot_ros.axis.reading.formats.table import some_of
from pianobot_ros.axis.reading.headers.phrases import said_actual
from pianobot_ros.axis.reading.headers.vocabulary import ACTUAL, BARE, COMMAND, WORDS
from pianobot_ros.axis.reading.headers.words import tokens
from pianobot_ros.axis.signals.log_repair import STEPS, TURN, comes_round, integral, unwrapped
from pianobot_ros.gap.problem.types import Array

FEWEST_ROWS = 20
"""Rows in which two columns are both known, for anything to be said of them."""
ROWS = 4000
"""Rows that are looked at."""
LEFT = 0.3
"""Share of a column's variance that one which follows another may leave at most."""
CLOSE = 0.1
"""The same, where nothing but the numbers says that the two belong together."""
SLOPE = 0.02
"""Share of a position's variance about a line that the integral of its velocity leaves at most."""
EQUAL = 1e-9
"""Share below which two columns are the same."""
LEAD = 0.2
"""Correlation between a command's speed and its distance from what follows it."""
FOLLOWS = 0.5
"""Correlation of a position with its command, at the lag at which it is largest, at least."""
SAME_WAY = 0.9
"""Correlation of a position with the sum of its steps, at least."""
PLACES = WORDS["position"]
WEAK = 4
"""Rank from which on an effort is one by a letter or a word like "output" only."""
SIDES = {"left", "right", "l", "r", "lh", "rh", "upper", "lower", "inner", "outer", "finger"}
"""Words that tell two joints apart."""


def left_over(q: Array, u: Array) -> float:
    """Share of the variance of q (n,) that u (n,) leaves, with a constant apart; inf if unknown, as
    of what never changes.
    """
    ok = np.isfinite(q) & np.isfinite(u)
    if ok.sum() < FEWEST_ROWS or float(np.ptp(q[ok])) == 0.0:  # its variance is that of rounding
        return np.inf
    power = float(np.var(q[ok]))
    return float(np.var(q[ok] - u[ok])) / power if power > 0 else np.inf


def lead(u: Array, q: Array) -> float:
    """How clearly u (n,) goes before q (n,): correlation of u's speed with u - q; 0 if unknown."""
    ok = np.isfinite(q) & np.isfinite(u)
    if ok.sum() < FEWEST_ROWS:
        return 0.0
    speed, apart = np.gradient(u[ok]), u[ok] - q[ok]
    size = float(np.std(speed) * np.std(apart))
    return float(np.mean((speed - speed.mean()) * (apart - apart.mean()))) / size if size else 0.0


def paired(columns: Sequence[Column], notes: list[str]) -> list[Column]:
    """Columns of which a joint's positions that nothing but a unit tells of are its command and its
    position, where one follows the other: their words are of a language that nobody here reads. So
    are those that nothing but "actual" sets apart, as PLCs call them.
    """
    commanded = {c.joint for c in columns if c.role == "command"}
    made: dict[str, Column] = {}
    for joint in dict.fromkeys(c.joint for c in columns if c.role == "position"):
        own = [c for c in columns if c.role == "position" and c.joint == joint]
        bare = {tuple(tokens(c.header)) for c in own}
        actual = {said for c in own if (said := said_actual(c.header))} & bare
        vague = all(c.rank >= BARE for c in own)
        if len(own) < 2 or joint in commanded or not (vague or actual):
            continue
        silent = [replace(c, role="") for c in own]
        for u, q in _pairs(silent, silent)[:1]:
            made[u.header] = replace(u, role="command")
            made[q.header] = replace(q, role="position", rank=min(q.rank, BARE - 1))
            notes.append(_follows(q, u))
    return [made.get(c.header, c) for c in columns]


def related(
    columns: Sequence[Column], spare: Sequence[Column], t: Array, notes: list[str]
) -> list[Column]:
    """Columns with commands and positions found by who follows whom, where names are silent.

    `spare` are columns that no name says anything of; t (n,) in s. A command goes before its
    position and differs from it; two are only taken as a pair if neither fits another column
    better.
    """
    found = _speeds(_not_twice(columns, notes), t, notes)
    commanded = {c.joint for c in found if c.role == "command"}
    places = [c for c in found if c.role == "position"]
    weak = [c for c in found if c.role == "effort" and c.rank >= WEAK]
    orphans = [c for c in found if c.role == "command" and not _has(places, c.joint)]
    if not places:  # a named command may have an unnamed position; or nothing has a name
        spare = [*spare, *(c for c in found if tokens(c.header) == ["current"])]
        pairs = _pairs([*orphans, *spare], spare)
        if not pairs and len(orphans) == len(spare) == 1 and _moves(spare[0].y):
            (u,), (q,) = orphans, spare
            notes.append(f"{q.header} is all that there is beside {u.header}: the position")
            found = [*(c for c in found if c is not u), replace(u, joint="")]
            return [*found, replace(q, role="position", joint="")]
    else:
        lonely = [c for c in places if c.joint not in commanded]
        pairs = _pairs([*orphans, *spare, *weak, *lonely], lonely)
    if not pairs and not {c.role for c in found} & {"command", "effort", "command effort"}:
        pairs = _side_by_side(places or [c for c in spare if _place(c.header)])
        places = [] if pairs else places
    for u, q in pairs:
        joint = q.joint if places else ("" if len(pairs) == 1 else _whose(u, q))
        found = [c for c in found if c is not u and c is not q]
        found.append(replace(u, role="command", joint=joint, unit=u.unit or q.unit))
        found.append(replace(q, role="position", joint=joint, rank=min(q.rank, BARE - 1)))
        notes.append(_follows(q, u))
    order = {c.header: k for k, c in enumerate([*columns, *spare])}
    found.sort(key=lambda c: order[c.header])
    if pairs and not places:  # what only might have been a position is none beside what is one
        paired = {c.header for pair in pairs for c in pair}
        found = [c for c in found if c.role != "position" or c.header in paired]
    elif pairs:
        found = [c for c in found if c.role != "position" or c.rank < BARE]
    return found


def _whose(command: Column, position: Column) -> str:
    """The joint of a pair that nothing but the numbers joined: as a named command says, else as the
    position's column is called.
    """
    first, second = (command, position) if command.role == "command" else (position, command)
    return first.joint or second.joint


def _not_twice(columns: Sequence[Column], notes: list[str]) -> list[Column]:
    """Columns without positions that are another joint's command once more: a controller's input
    beside its setpoint, say.
    """
    commands = [c for c in columns if c.role == "command"]
    out = []
    for c in columns:
        again = [
            u.header
            for u in commands
            if c.role == "position" and u.joint != c.joint
            if left_over(_few(c.y), _few(u.y)) < EQUAL
        ]
        if again:
            notes.append(f"{c.header} is {again[0]} once more and was left out")
        else:
            out.append(c)
    return out


def in_step(names: Sequence[str], own: Sequence[Column], columns: Sequence[Column]) -> list[str]:
    """For each of some commands' joints the joint of the position that follows it, [] if that is
    not clear.
    """
    places = {c.joint: c for c in columns if c.role == "position"}
    out = []
    for name in names:
        u = next(c for c in own if c.joint == name)
        y = _few(u.y)
        left = {joint: left_over(_few(q.y), y) for joint, q in places.items()}
        best = min(left, key=lambda j: left[j])
        if left[best] > LEFT:
            return []
        out.append(best)
    return out if len(set(out)) == len(out) else []


def _moves(y: Array) -> bool:
    known = y[np.isfinite(y)]
    return known.size > 2 and float(np.ptp(known)) > 0


def _has(columns: Sequence[Column], joint: str) -> bool:
    return any(c.joint == joint for c in columns)


def _few(y: Array) -> Array:
    return y if y.size <= ROWS else y[:: -(-y.size // ROWS)]


def _follows(q: Column, u: Column) -> str:
    return (
        f"{q.header} follows {u.header}, which is taken as its command (--columns command=HEADER"
        " says otherwise)"
    )


def _pairs(leaders: Sequence[Column], followers: Sequence[Column]) -> list[tuple[Column, Column]]:
    """Pairs of a command and its position, each the other's best; what moves by a few steps of its
    encoder rests, and follows nothing.
    """
    left: list[tuple[float, Column, Column]] = []
    followers = [b for b in followers if np.unique(b.y[np.isfinite(b.y)]).size > STEPS]
    for a in leaders:
        for b in followers:
            if a is b or (a.role == b.role == "position" and _two_joints(a.joint, b.joint)):
                continue
            if _both_measured(a.header, b.header):
                continue
            share = left_over(_few(b.y), _few(a.y))
            if EQUAL < share < LEFT:
                left.append((share, a, b))
    out: list[tuple[Column, Column]] = []
    used: set[int] = set()
    for _, a, b in sorted(left, key=lambda pair: pair[0]):
        if {id(a), id(b)} & used:
            continue
        used |= {id(a), id(b)}
        if lead(a.y, b.y) > LEAD:
            out.append((a, b))
        elif b in leaders and a in followers and lead(b.y, a.y) > LEAD:
            out.append((b, a))
    return out


def _both_measured(a: str, b: str) -> bool:
    """Whether the same word calls both what was measured (`A_Act` of a tool's orientation beside
    `AxisPos_Act3`): neither is then the other's command.
    """
    first, second = (set(tokens(re.split(r"[/.]", h)[-1])) for h in (a, b))
    return bool(first & second & ACTUAL) and not (first | second) & COMMAND


def _speeds(columns: Sequence[Column], t: Array, notes: list[str]) -> list[Column]:
    """Columns in which what may be a position, but is another one's slope, is a velocity: of a
    state, say, that has both.
    """
    places = [c for c in columns if c.role == "position"]
    out = []
    for c in columns:
        of = [q for q in places if c.role == "position" and c.rank >= BARE and _slope(q.y, c.y, t)]
        if of:
            notes.append(f"{c.header} is the slope of {of[0].header}, which makes it a velocity")
        out.append(replace(c, role="velocity", joint=of[0].joint, unit="") if of else c)
    return out


def _slope(q: Array, v: Array, t: Array) -> bool:
    """Whether v (n,) is the slope of q (n,): its integral leaves hardly more of q than a line."""
    ok = np.isfinite(q) & np.isfinite(v)
    if q is v or ok.sum() < 100:
        return False
    x, q, v = t[ok], q[ok], v[ok]
    moved = integral(v, np.diff(x))
    if not math.isfinite(float(np.var(moved)) + float(np.var(q))):  # squares that overflow
        return False
    lines = np.array([moved, np.ones(x.size), x - x[0]]).T
    beta = np.linalg.lstsq(lines, q, rcond=None)[0]
    left = float(np.var(q - lines @ beta))
    without = float(np.var(q - np.polyval(np.polyfit(x, q, 1), x)))
    return left < SLOPE * without and 0.9 < float(beta[0]) < 1.1


def _side_by_side(columns: Sequence[Column]) -> list[tuple[Column, Column]]:
    """The one pair of a command and its position among the columns of one nameless array: of a log
    that would tell nothing else.
    """
    of = [(c, m) for c in columns if (m := _place(c.header))]
    pairs = [
        (a, b)
        for a, m in of
        for b, n in of
        if m[1] == n[1] and abs(int(m[2]) - int(n[2])) == 1 and lead(a.y, b.y) > LEAD
        if EQUAL < left_over(_few(b.y), _few(a.y)) < CLOSE
    ]
    return pairs if len(pairs) == 1 else []


def _place(header: str) -> re.Match[str] | None:
    return re.fullmatch(r"(.*)\[(\d+)\]", header)


def _two_joints(a: str, b: str) -> bool:
    """Whether two names are those of two joints of one robot: they differ by a number or a side."""
    apart = set(a.split()) ^ set(b.split())
    return not apart or any(w.isdigit() or w in SIDES for w in apart)


def likenesses(columns: Sequence[Column]) -> dict[str, float]:
    """How much positions are like their commands, by the command's header (NaN where that cannot be
    told), for those that only a word like "control" or "action" calls so.
    """
    joints = {c.joint for c in columns if c.role == "position"}
    places = {j: chosen([c for c in columns if c.joint == j])["position"] for j in joints}
    return {
        c.header: _likeness(places[c.joint].y, c.y)
        for c in columns
        if c.role == "command" and c.joint in places and not set(tokens(c.header)) & PLACES
    }


def not_followed(runs: Sequence[Mapping[str, float]]) -> frozenset[str]:
    """Headers of what is no command, as the positions of most runs do not follow it; that is so of
    a whole array (`action[0]`, …) where it is so of more than half of it.
    """
    of: dict[str, list[float]] = {}
    for run in runs:
        for header, alike in run.items():
            of.setdefault(header, []).append(alike)
    told_of = {h: [a for a in likeness if not math.isnan(a)] for h, likeness in of.items()}
    known = {h: float(np.median(likeness)) for h, likeness in told_of.items() if likeness}
    arrays: dict[str, list[str]] = {}
    for header in of:
        arrays.setdefault(re.sub(r"\d+", "", header), []).append(header)
    out: set[str] = set()
    for headers in arrays.values():
        told = [h for h in headers if h in known]
        alone = {h for h in told if known[h] <= FOLLOWS}
        out |= set(headers) if 2 * len(alone) > len(told) else alone
    return frozenset(out)


def without(
    columns: Sequence[Column], no_commands: Collection[str], notes: list[str]
) -> list[Column]:
    """Columns of which those commands that no position follows are an effort, or nothing where
    efforts were measured or the positions move by them: steps, speeds.
    """
    efforts = {c.joint for c in columns if c.role == "effort"}
    places = {c.joint: c.y for c in columns if c.role == "position"}
    out, left = [], []
    for c in columns:
        if c.role != "command" or c.header not in no_commands:
            out.append(c)
            continue
        left.append(c.header)
        drives = set(tokens(c.header)) & {"ctrl", "control", "action", "cmd"}
        step = c.joint in places and _summed(places[c.joint], c.y) > SAME_WAY
        if drives and c.joint not in efforts and not step:
            out.append(replace(c, role="command effort", unit=""))
    if left:
        notes.append(f"the positions do not follow {some_of(left, 4)}: no command")
    return out


def _likeness(q: Array, u: Array) -> float:
    """Largest correlation of q (n,) with u (n,), which may go before it; 0 where u's sum is more
    like q, NaN where there is none to tell.
    """
    ok = np.isfinite(q) & np.isfinite(u)
    if ok.sum() < 100:
        return math.nan
    q, u = unwound(q[ok], u[ok])
    if min(float(np.std(q)), float(np.std(u))) <= 0:
        return math.nan
    if upside_down(u, q):
        return 1.0
    best = max(
        float(np.corrcoef(q[k:], u[: u.size - k])[0, 1])
        for k in (0, 1, 2, 4, 8, 16, 32)
        if np.std(q[k:]) > 0 and np.std(u[: u.size - k]) > 0
    )
    return best if best > _summed(q, u) else 0.0


def unwound(q: Array, u: Array) -> tuple[Array, Array]:
    """Positions q (n,) and a command u (n,) without jumps by what the positions come round at; and
    angles in degrees or rad without those by a turn.
    """
    period = comes_round(q)
    if period:
        q = unwrapped(q, "", [], period)
        u = unwrapped(u, "", [], period) if np.ptp(u) <= 1.02 * period else u
    for turn in (TURN, 360.0):
        q, u = (unwrapped(y * (TURN / turn), "", []) * (turn / TURN) for y in (q, u))
    return q, u


def _summed(q: Array, u: Array) -> float:
    """Correlation of q (n,) with the sum of u (n,), a line apart: near 1 if u are q's steps."""
    ok = np.isfinite(q) & np.isfinite(u)
    if ok.sum() < 100:
        return 0.0
    lines = np.column_stack([np.ones(ok.sum()), np.linspace(-1.0, 1.0, ok.sum())])
    both = np.column_stack([q[ok], np.cumsum(u[ok] - u[ok].mean())])
    left = both - lines @ np.linalg.lstsq(lines, both, rcond=None)[0]
    size = float(np.prod(np.std(left, axis=0)))
    return float(np.mean(left[:, 0] * left[:, 1])) / size if size > 0 else 0.0
