"""The position loop: a search over windows of the logs with friction and gravity beside it, so that
these do not bias it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import least_squares

from pianobot_ros.axis.commissioning.around.arm import arm_load
from pianobot_ros.axis.commissioning.around.contact_limit import untouched
from pianobot_ros.axis.commissioning.around.other_joints import Others, series_of
from pianobot_ros.axis.commissioning.regression import hanging
from pianobot_ros.axis.laws import kernel
from pianobot_ros.axis.signals.cleaning import Clean
from pianobot_ros.axis.signals.segment import LEAD, stretches
from pianobot_ros.gap.problem.types import Array

__all__ = ["loop"]

SECONDS = 30.0
"""How much of the logs the loop's search sees, in windows spread over them."""
ODD = 0.2
"""Residuals of 0.3 of the following error and more count linearly in the search for the loop: they
have other causes (a contact, a limit).
"""
MOST_DRY = 100.0
"""Dry friction at most, as what stops the joint so many following errors short of its command."""
FED, LEAST_FED = 0.7, 0.05
"""Share of the inertia's effort that is fed forward where a search for it begins; less is none."""
UNLIMITED = 1e9
"""Effort that no joint asks for: a drive without a limit."""
ALIKE, STAYS = 0.01, 5
"""Share by which efforts at a drive's limit differ at most, and samples on end that they stay."""
LATE = (0.03, 0.08, 0.2)
"""s; dead times from which a search for one begins."""
SETTLED, MOST_TRIALS = 1e-3, 100
"""Share of its cost by which a search's last step may still have gained, and simulations of all
windows at most. What leaves a fifth less is chosen, so neither structure may be cut short: after 10
simulations a drive's cascade left 7.7 with integral action and 4.2 without, and after 28 it left
0.014.
"""
TYPICAL = (math.log(25.0), math.log(0.8))
"""Bandwidth (rad/s) and damping that are believed where the motion is too slow to tell."""


@dataclass(frozen=True)
class _Window:
    """A piece of a log; what was commanded before it (`past`, m samples more) is known, too, since
    a delayed loop obeys it. `field` (n, 4) or (0, 4): what other joints add to the torque.
    """

    t: Array
    command: Array
    past: int
    position: Array
    dt: float
    v0: float
    gathered: float
    middle: float
    weight: Array
    field: Array


def _windows(logs: Sequence[Clean], others: Others, fields: Sequence[Array]) -> list[_Window]:
    """Windows in which the command moves most, spread over all logs; `SECONDS` together. Samples in
    contact with surroundings do not count.
    """
    known = [(c, f) for c, f in zip(logs, fields, strict=True) if c.command is not None]
    use = [c for c, _ in known]
    each = max(4.0, min(10.0, SECONDS / max(len(use), 1)))
    pieces: list[tuple[float, int, Clean, int, int]] = []
    for which, c in enumerate(use):
        n = min(c.t.size, max(50, round(each / c.dt)))
        assert c.command is not None
        for i in range(0, max(c.t.size - n, 0) + 1, n):
            moved = float(np.std(c.command[i : i + n]))
            pieces.append((moved, which, c, i, i + n))
    chosen: list[_Window] = []
    left, seen = SECONDS, dict[int, int]()
    order = sorted(pieces, key=lambda p: -p[0])
    for most in (1, 2, 4, 100):  # one of each log first
        for moved, which, c, i, j in order:
            if left <= 0 or seen.get(which, 0) >= most or moved <= 0:
                continue
            if any(w.t[w.past] == c.t[i] and w.dt == c.dt for w in chosen):
                continue
            seen[which] = seen.get(which, 0) + 1
            left -= (j - i) * c.dt
            past = min(i, math.ceil(LEAD / c.dt))
            assert c.command is not None
            chosen.append(
                _Window(
                    c.t[i - past : j],
                    c.command[i - past : j],
                    past,
                    c.position[i:j],
                    c.dt,
                    float(c.v[i]),
                    float(c.gathered[i]),
                    c.middle,
                    untouched(c, others.contact)[i:j],
                    np.ascontiguousarray(known[which][1][i:j]),
                )
            )
    return chosen


def _fields(
    logs: Sequence[Clean], others: Others, inertia: float, model_scale: float
) -> list[Array]:
    """What other joints add to the torque in each log: gravity that they turn, by regression or by
    the model of the robot, and what their motion draws. A loop that is looked for without it has no
    integral action, since its traces are larger than what that takes away.
    """
    p = np.zeros(len(kernel.NAMES))
    p[kernel.J], p[kernel.MS] = inertia, model_scale
    load = arm_load(logs, others.arm) if others.arm else {}
    p[kernel.AG], p[kernel.AGA] = load.get("arm_gravity", 0.0), load.get("arm_angle", 0.0)
    return [others.field(p, series_of(c), c.t.size) for c in logs]


def loop(
    logs: Sequence[Clean],
    base: Mapping[str, float],
    given: Mapping[str, float],
    hold: float,
    others: Others,
    model_scale: float = 0.0,
    plain: bool | None = None,
    dry: float = 0.0,
) -> dict[str, float]:
    """The position loop's parameters, its unlimited peak effort, and the constant load and friction
    found beside it (effort units of `base`, which holds the inertia; without one, command error).
    With an inertia, `loop_sine`, `loop_cosine` and `loop_offset` are what of gravity and of a
    constant load the loop has to bear.

    `given` values are kept. `hold` (s) is the log's interval: a command is held for one. What
    `others` add to the torque is known, by the robot's model times `model_scale` where there is
    one; what the joint does in contact does not count. A `plain` loop has
    neither integral action nor inertia fed forward, one that is not has the first; by default it
    has what is worth its while, and its drive a limit where that is. `dry` is the friction in a
    measured effort, from which the search begins.
    """
    fields = _fields(logs, others, base.get("inertia", 0.0), model_scale)
    search = _Search(_windows(logs, others, fields), base, given, hold, dry)
    if {"bandwidth", "damping", "feedforward", "integral"} <= set(given):
        return search.values_at(search.held(search.start({})), integral=True)
    x, gathers, cost = _found(search, plain)
    top = _flat_top(logs)
    if math.isfinite(top) and search.physical:
        limited = _Search(search.windows, base, given, hold, dry, top)
        other, with_integral, less = _found(limited, plain)
        if less < 0.8 * cost:  # a limit has to be worth its while, too
            search, x, gathers = limited, other, with_integral
    return search.values_at(x, gathers)


def _found(search: _Search, plain: bool | None) -> tuple[Array, bool, float]:
    """The best vector, whether it has integral action, and its cost."""
    starts = []
    for wn, zeta, ff, ki in product((6.0, 14.0, 30.0, 70.0), (0.6, 1.2), (0.0, 0.9), (0.0, 2.0)):
        start = search.start({"bandwidth": wn, "damping": zeta, "feedforward": ff, "integral": ki})
        starts.append((float(np.sum(search.residual(start, ki > 0) ** 2)), start, ki > 0))
    starts.sort(key=lambda s: s[0])
    best, chosen, with_integral = math.inf, starts[0][1], False
    for gathers in (False, True) if plain is None else (not plain,):
        own = [s for s in starts if s[2] == gathers][: 1 if gathers else 2]
        for _, start, _ in own:
            x, cost = search.refined(start, gathers)
            better = best if not gathers or with_integral else 0.8 * best
            if cost < better:  # integral action has to be worth its while
                best, chosen, with_integral = cost, x, gathers
    if not plain:
        fed, cost = search.fed([chosen, *(x for _, x, _ in starts)], with_integral)
        if cost < 0.8 * best:  # and so has computed torque
            best, chosen = cost, fed
    late, cost = search.late(starts, with_integral)
    if late is not None and cost < 0.8 * best:  # and so has a dead time
        best, chosen = cost, late
    return chosen, with_integral, best


def _flat_top(logs: Sequence[Clean]) -> float:
    """The effort at which all efforts stay for some samples on end, in one direction as in the
    other, as where a drive gives no more; else infinite. Dry friction alone may look the same.
    """
    raw = [c.log.effort for c in logs if c.log.effort is not None]  # smoothed, a top is round
    efforts = [e[np.isfinite(e)] for e in raw]
    if not efforts:
        return math.inf
    tops = [max(float(np.max(way * e, initial=0.0)) for e in efforts) for way in (1.0, -1.0)]
    if min(tops) < (1.0 - ALIKE) * max(tops) or min(tops) <= 0.0:
        return math.inf
    for way, top in zip((1.0, -1.0), tops, strict=True):
        lasts = [np.diff(stretches(way * e > (1.0 - ALIKE) * top)) for e in efforts]
        if max(int(np.max(own, initial=0)) for own in lasts) < STAYS:
            return math.inf
    return max(tops)


class _Search:
    """Least squares over windows: loop parameters with load and friction beside them."""

    def __init__(
        self,
        windows: Sequence[_Window],
        base: Mapping[str, float],
        given: Mapping[str, float],
        hold: float,
        dry: float,
        most: float = UNLIMITED,
    ) -> None:
        self.dry = dry
        self.windows, self.base, self.given, self.hold = list(windows), dict(base), given, hold
        errors = [np.mean((w.command[w.past :] - w.position) ** 2) for w in self.windows]
        self.size = max(float(np.sqrt(np.mean(errors))) if errors else 1e-3, 1e-6)
        self.physical, self.most = "inertia" in base, most

    def start(self, values: Mapping[str, float]) -> Array:
        """Search vector: log bandwidth, log damping, feedforward, integral, hold, extras, weight of
        the command, dead time in intervals, feedforward of inertia.
        """
        v = {**values, **self.given}
        head = [math.log(v["bandwidth"]), math.log(v["damping"]), v["feedforward"]]
        dry = 0.1
        if self.physical and self.dry > 0.0:
            dry = self.dry / (self.base["inertia"] * v["bandwidth"] ** 2 * self.size)
        return np.array([*head, max(v["integral"], 0.0), 0.5, 0.0, dry, 0.0, 0.0, 1.0, 0.0, 0.0])

    def fed(self, starts: Sequence[Array], integral: bool) -> tuple[Array, float]:
        """Best vector whose controller feeds the inertia's effort forward, and its cost."""
        tried = []
        for start in starts:
            x = start.copy()
            x[10], x[11] = 0.0, FED
            tried.append((float(np.sum(self.residual(x, integral) ** 2)), x))
        return self.refined(min(tried, key=lambda own: own[0])[1], integral)

    def late(
        self, starts: Sequence[tuple[float, Array, bool]], integral: bool
    ) -> tuple[Array | None, float]:
        """Best vector with a dead time beyond one interval, and its cost; None without one.

        A loop that is slow enough stands in for a dead time, with the command's speed fed back:
        found without one, it leaves nothing for a delay to explain.
        """
        tried = []
        for start in [x for _, x, with_integral in starts if with_integral == integral]:
            for late in LATE:
                x = start.copy()
                x[10] = late / self.hold
                tried.append((float(np.sum(self.residual(x, integral) ** 2)), x))
        if not tried:
            return None, math.inf
        x, cost = self.refined(min(tried, key=lambda own: own[0])[1], integral)
        return (x, cost) if x[10] > 0.5 else (None, math.inf)

    def held(self, x: Array) -> Array:
        """The vector with the hold at which it fits best: how a log stamps its commands says
        nothing about the joint.
        """
        x = x.copy()
        x[6] = 0.0
        tried = []
        for hold in (0.0, 0.25, 0.5, 0.75, 1.0):
            x[4] = hold
            tried.append((float(np.sum(self.residual(x, integral=True) ** 2)), hold))
        x[4] = min(tried)[1]
        return x

    def vector(self, x: Array, integral: bool) -> Array:
        """The kernel's parameters."""
        p = np.zeros(len(kernel.NAMES))
        wn = self.given.get("bandwidth", math.exp(x[0]))
        p[kernel.WN] = wn
        p[kernel.ZETA] = self.given.get("damping", math.exp(x[1]))
        p[kernel.FF] = self.given.get("feedforward", x[2])
        p[kernel.KI] = self.given.get("integral", x[3] if integral else 0.0)
        p[kernel.CW] = self.given.get("command_weight", x[9])
        p[kernel.HOLD] = self.given.get("command_hold", x[4] * self.hold)
        p[kernel.DELAY] = x[10] * self.hold
        p[kernel.AFF] = self.given.get("inertia_feedforward", x[11])
        p[kernel.GAIN], p[kernel.PEAK], p[kernel.LIMIT], p[kernel.VS] = 1.0, self.most, 1e-9, 1e-3
        p[kernel.J] = self.base.get("inertia", 1.0 / wn**2)
        stiffness = p[kernel.J] * wn**2 * self.size
        p[kernel.OFF], p[kernel.FC] = stiffness * x[5], stiffness * abs(x[6])
        p[kernel.XS], p[kernel.XC] = stiffness * x[7], stiffness * x[8]
        p[kernel.B] = self.base.get("viscous", 0.0) if self.physical else 0.0
        return p

    def simulate(self, w: _Window, p: Array) -> tuple[Array, Array]:
        """Position and effort (n,) of one window."""
        p = p.copy()
        p[kernel.MID] = w.middle
        u = kernel.delayed(w.t, w.command, w.dt, p, np.zeros(w.t.size))[w.past :]
        out = kernel.forward(
            u,
            np.gradient(u, w.dt),
            w.dt,
            float(w.position[0]),
            w.v0,
            w.gathered,
            p,
            w.field,
        )
        return out[0], out[1]

    def residual(self, x: Array, integral: bool) -> Array:
        """Residuals in units of a tenth of the following error, with weak priors."""
        p = self.vector(x, integral)
        parts = []
        for w in self.windows:
            every = max(1, w.position.size // 250)
            off = (self.simulate(w, p)[0] - w.position) * w.weight / (0.1 * self.size)
            part = np.nan_to_num(off[::every], nan=1e3, posinf=1e3, neginf=-1e3)
            parts.append(np.clip(part, -1e3, 1e3) / math.sqrt(max(part.size, 1)))
        away = [(x[0] - TYPICAL[0]) / 1.0, (x[1] - TYPICAL[1]) / 0.5, x[2] - 0.3, x[4] - 0.5]
        extras = [*x[5:9], x[10] * self.hold / LATE[-1], x[11]]
        prior = [*(0.1 * np.array(away)), *(0.05 * np.array(extras)), 0.1 * (x[9] - 1.0)]
        return np.concatenate([*parts, prior])

    def refined(self, start: Array, integral: bool) -> tuple[Array, float]:
        """Best vector from a start, and its cost."""
        low = [0.0, math.log(0.1), -0.2, 0.0, -0.25, -20.0, 0.0, -20.0, -20.0, -0.2, -0.01, -0.01]
        high = [
            math.log(600.0),
            math.log(8.0),
            1.2,
            50.0,
            1.25,
            20.0,
            MOST_DRY,
            20.0,
            20.0,
            1.3,
            0.5 / self.hold,
            1.3,
        ]
        for k in (10, 11):  # a dead time and computed torque are asked for by themselves
            high[k] = 0.01 if start[k] == 0.0 else high[k]
        if start[10] != 0.0:  # which velocity fed back would stand in for
            low[2] = 0.0
        found = least_squares(
            self.residual,
            np.clip(start, np.array(low) + 1e-6, np.array(high) - 1e-6),
            bounds=(low, high),
            x_scale=[0.3, 0.3, 0.3, 1.0, 0.3, 0.3, 0.2, 0.3, 0.3, 0.3, 1.0, 0.3],
            diff_step=1e-3,
            loss="soft_l1",
            f_scale=ODD,
            ftol=SETTLED,
            max_nfev=MOST_TRIALS,
            args=(integral,),
        )
        return np.asarray(found.x), float(found.cost)

    def values_at(self, x: Array, integral: bool) -> dict[str, float]:
        """The values by name."""
        p = self.vector(x, integral)
        p[kernel.PEAK] = UNLIMITED  # what the loop would demand
        peaks = [float(np.max(np.abs(self.simulate(w, p)[1]))) for w in self.windows]
        out = {
            "bandwidth": float(p[kernel.WN]),
            "damping": float(p[kernel.ZETA]),
            "feedforward": float(p[kernel.FF]),
            "integral": float(p[kernel.KI]),
            "command_weight": float(p[kernel.CW]),
            "command_hold": float(p[kernel.HOLD]),
            "inertia_feedforward": float(p[kernel.AFF]) if x[11] > LEAST_FED else 0.0,
            "peak": max(peaks, default=UNLIMITED),
        }
        if x[10] > 0.5:
            out["command_delay"] = float(p[kernel.DELAY])
        if self.physical:
            out |= {
                "loop_sine": float(p[kernel.XS]),
                "loop_cosine": float(p[kernel.XC]),
                "loop_offset": float(p[kernel.OFF]),
            }
        else:
            gravity, angle = hanging(p[kernel.XS], p[kernel.XC])
            out |= {
                "coulomb": float(p[kernel.FC]),
                "gravity": gravity,
                "gravity_angle": angle,
            }
            middle = [float(np.mean(w.position)) for w in self.windows]
            at = float(np.mean(middle)) if middle else 0.0
            field = p[kernel.XS] * math.sin(at) + p[kernel.XC] * math.cos(at)
            out["effort_offset"] = float(p[kernel.OFF] + field)
        return out
