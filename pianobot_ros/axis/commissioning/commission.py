"""First values of a twin from the logs themselves: linear regression of effort, and a search for
the position loop with friction and gravity beside it, so that these do not bias it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from pianobot_ros.axis.commissioning.contact_limit import held
from pianobot_ros.axis.commissioning.other_joints import Others, series_of
from pianobot_ros.axis.laws import kernel
from pianobot_ros.axis.laws.load.contact import Contact
from pianobot_ros.axis.signals.cleaning import (
    Clean,
    counted,
    motion_noise,
    quantisation,
    unsure_speed,
)
from pianobot_ros.axis.signals.filtering import low_pass
from pianobot_ros.axis.signals.lateness import beyond_delay
from pianobot_ros.axis.signals.segment import LEAD
from pianobot_ros.gap.problem.types import Array

SECONDS = 30.0
"""How much of the logs the loop's search sees, in windows spread over them."""
ODD = 0.2
"""Residuals of 0.3 of the following error and more count linearly in the search for the loop: they
have other causes (a contact, a limit).
"""
SOFT = 2.0
"""Residuals of so many typical ones count linearly."""


def design(c: Clean) -> Array:
    """Regressors (n, 6) of effort: inertia, viscous, constant, Coulomb, sine and cosine."""
    slow = max(unsure_speed(c), 1e-9)
    a = c.a if c.model is None else c.a * c.model[:, 2]
    columns = [a, c.v, np.ones(c.v.size), np.tanh(c.v / slow), np.sin(c.q), np.cos(c.q)]
    return np.asarray(np.array(columns).T[:: c.step])


def regress(logs: Sequence[Clean]) -> dict[str, float]:
    """Inertia, viscous and Coulomb friction and gravity by robust least squares; noise of the
    encoder's steps does not shrink them. Empty without effort.
    """
    use = [c for c in logs if c.effort is not None]
    if not use:
        return {}
    x, y, _ = _regression(use)
    steps, noise = (np.max([of(c) for c in use], axis=0) for of in (quantisation, motion_noise))
    beta = robust(x, y, _errors(steps))
    # In a single sine the angle would take the acceleration's place, being measured better.
    errors = _errors(noise)
    whole, plain = robust(x, y, errors), robust(x[:, :4], y, errors[:4])
    hangs = _left(x, y, whole, errors) < HELPS * _left(x[:, :4], y, plain, errors[:4])
    if not hangs and plain[0] > beta[0]:
        beta[0] = plain[0]
    size, speed = float(np.sqrt(np.mean(y**2))), float(np.sqrt(np.mean(x[:, 1] ** 2)))
    acceleration = float(np.sqrt(np.mean(x[:, 0] ** 2)))
    usual = 0.1 * size / max(acceleration, 1e-9)
    if use[0].log.inertia > 0 and use[0].log.effort_unit in ("Nm", "N"):
        usual = use[0].log.inertia
    inertia = float(beta[0]) if beta[0] > 0 else usual
    gravity, angle = hanging(beta[4], beta[5])
    return {
        "inertia": max(inertia, 1e-3 * size / max(acceleration, 1e-9)),
        "viscous": max(float(beta[1]), 0.01 * size / max(speed, 1e-9)),
        "coulomb": max(float(beta[3]), 0.0),
        "gravity": gravity,
        "gravity_angle": angle,
    }


def _regression(use: Sequence[Clean]) -> tuple[Array, Array, list[NDArray[np.bool_]]]:
    """Regressors (n, 6) and effort (n,) of all logs, and which samples of each count."""
    kept = [counted(c)[:: c.step] for c in use]
    x = np.concatenate([design(c)[k] for c, k in zip(use, kept, strict=True)])
    y = np.concatenate([c.own_effort[:: c.step][k] for c, k in zip(use, kept, strict=True)])  # type: ignore[index]
    return x, y, kept


def _errors(noise: Array) -> Array:
    """Variances (6,) of the regressors of `design` by the RMS errors (3,) of q, v and a."""
    return np.array([noise[2] ** 2, noise[1] ** 2, 0, 0, 0, 0])


def _left(x: Array, y: Array, beta: Array, noise: Array) -> float:
    """Mean square that coefficients (k,) leave of y (n,), less what the regressors' own errors, of
    variance `noise` (k,), make of it.
    """
    return float(np.mean((y - x @ beta) ** 2) - beta**2 @ noise)


def hanging(sine: float, cosine: float) -> tuple[float, float]:
    """Size of a gravity, and the angle (rad) at which it hangs, from its parts that go with the
    angle's sine and cosine.
    """
    return float(np.hypot(sine, cosine)), float(math.atan2(-cosine, sine))


def robust(x: Array, y: Array, noise: Array) -> Array:
    """Coefficients (k,) of y (n,) on x (n, k) with Huber weights; `noise` (k,) is the variance of
    the regressors' errors.
    """
    norm = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    z, share = x / norm, np.minimum(noise / norm**2, 0.5)
    weight = np.ones(y.size)
    beta = np.zeros(x.shape[1])
    for _ in range(4):
        gram = (z.T * weight) @ z / weight.sum()
        gram += np.diag(1e-6 - share)
        beta = np.linalg.lstsq(gram, (z.T * weight) @ y / weight.sum(), rcond=1e-9)[0]
        off = np.abs(y - z @ beta)
        limit = SOFT * 1.48 * float(np.median(off)) + 1e-12
        weight = np.minimum(1.0, limit / np.maximum(off, 1e-300))
    return np.asarray(beta / norm)


def waves(logs: Sequence[Clean], count: int = 3) -> list[float]:
    """Spatial frequencies (per rad) where the effort's residual has most power, by least squares on
    a grid.
    """
    use = [c for c in logs if c.effort is not None]
    if not use:
        return [8.0, 24.0]
    x = np.concatenate([design(c) for c in use])
    y = np.concatenate([np.asarray(c.own_effort)[:: c.step] for c in use])
    q = np.concatenate([c.q[:: c.step] for c in use])
    r = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    travel = max(float(np.ptp(q)), 1e-3)
    grid = np.arange(max(2.5, 1.5 * 2 * np.pi / travel), 400.0, 0.5 / travel)[:6000]
    stride = max(1, q.size // 4000)
    qs, rs = q[::stride], r[::stride]
    power = np.array([np.abs(np.sum(rs * np.exp(-1j * w * qs))) for w in grid])
    chosen: list[float] = []
    for k in np.argsort(-power):
        if all(abs(grid[k] - w) > 2.0 * 2 * np.pi / travel for w in chosen):
            chosen.append(float(grid[k]))
        if len(chosen) == count:
            break
    return chosen or [8.0]


def rippling(logs: Sequence[Clean], candidates: Sequence[float]) -> dict[str, float]:
    """Cogging at one of the spatial frequencies (per rad), by robust least squares beside inertia,
    friction and gravity; empty where it does not help these.
    """
    use = [c for c in logs if c.effort is not None]
    if not use:
        return {}
    x, y, kept = _regression(use)
    best, found = HELPS * _left(x, y, robust(x, y, np.zeros(6)), np.zeros(6)), dict[str, float]()
    for w in candidates:
        pairs = [
            np.stack([low_pass(of(w * c.position), c.dt, c.cutoff) for of in (np.sin, np.cos)], 1)
            for c in use
        ]
        wave = [z[:: c.step][k] for z, c, k in zip(pairs, use, kept, strict=True)]
        both = np.hstack([x, np.concatenate(wave)])
        beta = robust(both, y, np.zeros(8))
        left = _left(both, y, beta, np.zeros(8))
        if left < best:
            size, phase = float(np.hypot(*beta[6:])), math.atan2(beta[7], beta[6])
            best, found = left, {"cogging": size, "cogging_waves": w, "cogging_phase": phase}
    return found


# -- the position loop -------------------------------------------------------------------------
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
                    _counts(c, others.contact)[i:j],
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


def _counts(c: Clean, touched: Contact | None) -> Array:
    """Weight (n,) of the samples of a log: 0 where nothing was measured or something is touched."""
    free = c.valid
    if touched is not None and all(n in c.others for n, _ in touched.slopes):
        free = free & ~held(c, touched, CONTACT_MARGIN)
    return np.asarray(free, float)


CONTACT_MARGIN = 0.02
"""rad from a limit at which a joint may be in contact."""
LATE = (0.03, 0.08, 0.2)
"""s; dead times from which a search for one begins."""
TYPICAL = (math.log(25.0), math.log(0.8))
"""Bandwidth (rad/s) and damping that are believed where the motion is too slow to tell."""


def loop(
    logs: Sequence[Clean],
    base: Mapping[str, float],
    given: Mapping[str, float],
    hold: float,
    others: Others,
    model_scale: float = 0.0,
    integral: bool | None = None,
) -> dict[str, float]:
    """The position loop's parameters, its unlimited peak effort, and the constant load and friction
    found beside it (effort units of `base`, which holds the inertia; without one, command error).

    `given` values are kept. `hold` (s) is the log's interval: a command is held for one. What
    `others` add to the torque is known, by the robot's model times `model_scale` where there is
    one; what the joint does in contact does not count. `integral` says whether the controller has
    integral action; by default it has where that is worth its while.
    """
    fields = _fields(logs, others, base.get("inertia", 0.0), model_scale)
    search = _Search(_windows(logs, others, fields), base, given, hold)
    if {"bandwidth", "damping", "feedforward", "integral"} <= set(given):
        return search.values_at(search.held(search.start({})), integral=True)
    starts = []
    for wn, zeta, ff, ki in product((6.0, 14.0, 30.0, 70.0), (0.6, 1.2), (0.0, 0.9), (0.0, 2.0)):
        start = search.start({"bandwidth": wn, "damping": zeta, "feedforward": ff, "integral": ki})
        starts.append((float(np.sum(search.residual(start, ki > 0) ** 2)), start, ki > 0))
    starts.sort(key=lambda s: s[0])
    best, chosen, with_integral = math.inf, starts[0][1], False
    for gathers in (False, True) if integral is None else (integral,):
        own = [s for s in starts if s[2] == gathers][: 1 if gathers else 2]
        for _, start, _ in own:
            x, cost = search.refined(start, gathers)
            better = best if not gathers or with_integral else 0.8 * best
            if cost < better:  # integral action has to be worth its while
                best, chosen, with_integral = cost, x, gathers
    late, cost = search.late(starts, with_integral)
    if late is not None and cost < 0.8 * best:  # and so has a dead time
        chosen = late
    return search.values_at(chosen, with_integral)


class _Search:
    """Least squares over windows: loop parameters with load and friction beside them."""

    def __init__(
        self,
        windows: Sequence[_Window],
        base: Mapping[str, float],
        given: Mapping[str, float],
        hold: float,
    ) -> None:
        self.windows, self.base, self.given, self.hold = list(windows), dict(base), given, hold
        errors = [np.mean((w.command[w.past :] - w.position) ** 2) for w in self.windows]
        self.size = max(float(np.sqrt(np.mean(errors))) if errors else 1e-3, 1e-6)
        self.physical = "inertia" in base

    def start(self, values: Mapping[str, float]) -> Array:
        """Search vector: log bandwidth, log damping, feedforward, integral, hold, extras, weight of
        the command, dead time in intervals.
        """
        v = {**values, **self.given}
        head = [math.log(v["bandwidth"]), math.log(v["damping"]), v["feedforward"]]
        return np.array([*head, max(v["integral"], 0.0), 0.5, 0.0, 0.1, 0.0, 0.0, 1.0, 0.0])

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
        p[kernel.GAIN], p[kernel.PEAK], p[kernel.VS] = 1.0, 1e9, 1e-3
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
        prior = [*(0.1 * np.array(away)), *(0.05 * x[5:9]), 0.1 * (x[9] - 1.0), 0.05 * x[10]]
        return np.concatenate([*parts, prior])

    def refined(self, start: Array, integral: bool) -> tuple[Array, float]:
        """Best vector from a start, and its cost."""
        low = [
            math.log(1.0),
            math.log(0.1),
            -0.2,
            0.0,
            -0.25,
            -20.0,
            0.0,
            -20.0,
            -20.0,
            -0.2,
            -0.01,
        ]
        high = [
            math.log(600.0),
            math.log(8.0),
            1.2,
            50.0,
            1.25,
            20.0,
            10.0,
            20.0,
            20.0,
            1.3,
            0.5 / self.hold,
        ]
        if start[10] == 0.0:  # a dead time is asked for by itself
            high[10] = 0.01
        found = least_squares(
            self.residual,
            np.clip(start, np.array(low) + 1e-6, np.array(high) - 1e-6),
            bounds=(low, high),
            x_scale=[0.3, 0.3, 0.3, 1.0, 0.3, 0.3, 0.2, 0.3, 0.3, 0.3, 1.0],
            diff_step=1e-3,
            loss="soft_l1",
            f_scale=ODD,
            max_nfev=10,
            args=(integral,),
        )
        return np.asarray(found.x), float(found.cost)

    def values_at(self, x: Array, integral: bool) -> dict[str, float]:
        """The values by name."""
        p = self.vector(x, integral)
        peaks = [float(np.max(np.abs(self.simulate(w, p)[1]))) for w in self.windows]
        out = {
            "bandwidth": float(p[kernel.WN]),
            "damping": float(p[kernel.ZETA]),
            "feedforward": float(p[kernel.FF]),
            "integral": float(p[kernel.KI]),
            "command_weight": float(p[kernel.CW]),
            "command_hold": float(p[kernel.HOLD]),
            "peak": max(peaks, default=1e9),
        }
        if x[10] > 0.5:
            out["command_delay"] = float(p[kernel.DELAY])
        if not self.physical:
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


# -- other joints ------------------------------------------------------------------------------
def coupling(
    logs: Sequence[Clean], joint: str, names: Sequence[str], touched: Contact | None = None
) -> dict[str, float]:
    """Signed sum of other joints' angles that gravity follows best, by held-out regression: joint
    to +1 or -1; empty if none helps.

    Asked of effort, or of command minus position where none was measured. `names` are all joints
    in the order of the robot; joints next to this one are tried, and pairs of them. What the joint
    does in contact with `touched` does not count.
    """
    if joint not in names:
        return {}
    i = names.index(joint)
    chains = [[k] for k in (i - 1, i + 1)] + [[i - 1, i - 2], [i + 1, i + 2]]
    sums: list[dict[str, float]] = []
    for chain in chains:
        if min(chain) < 0 or max(chain) >= len(names):
            continue
        own = [names[k] for k in chain]
        if all(moves(logs, n) for n in own):
            signs = product((1.0, -1.0), repeat=len(own))
            sums += [dict(zip(own, s, strict=True)) for s in signs]
    if not sums:
        return {}
    kept = [_kept(c, touched) for c in logs]
    x, y, fold = _load_regression(logs, kept)
    if y.size < FEWEST or np.unique(fold).size < 2:
        return {}
    plain = held_out(x, y, fold)
    best, chosen = (HELPS if len(logs) > 1 else HELPS_ONE) * plain, dict[str, float]()
    for theta in sums:
        parts = [turned(c, theta)[k] for c, k in zip(logs, kept, strict=True) if _asked(c)]
        extra = np.concatenate(parts)
        left = held_out(np.hstack([x, extra]), y, fold) * (1.0 + 0.02 * len(theta))
        if left < best:
            best, chosen = left, theta
    return chosen


FEWEST = 20
"""Slow samples without which other joints are not looked at. With 23 to 27 of them 6 of 80
simulated arms seem to hang by a joint that does not turn them, and 75 of 80 that do are found; with
35 it is 1 and 39 of 40 (logs of one run; `tests/axis/cascade.py`)."""
SLOW = 0.3
"""Of the RMS speed; faster samples tell of the loop rather than of the load."""
MOVES = 0.1
"""rad that another joint must move."""
HELPS, HELPS_ONE = 0.87, 0.75
"""Share of the squared held-out residual that another joint's angle may leave, in several logs and
in one, which may only seem to depend on it.
"""


def moves(logs: Sequence[Clean], joint: str) -> bool:
    """Whether another joint was logged and moves enough to be asked."""
    if not all(joint in c.others for c in logs):
        return False
    return float(np.ptp(np.concatenate([c.others[joint] for c in logs]))) > MOVES


def target(c: Clean) -> Array | None:
    """What the load shows in, (n,): effort, or command minus position, beyond what a delay makes of
    it, where none was measured.
    """
    if c.effort is not None:
        return c.own_effort
    if c.command is None:
        return None
    return c.left(beyond_delay(c))


def _asked(c: Clean) -> bool:
    return target(c) is not None


def _kept(c: Clean, touched: Contact | None) -> NDArray[np.intp]:
    """Samples (k,) of which the load is asked: slow ones, ten a second."""
    step = max(1, round(0.1 / c.dt))
    driver = c.q if c.command is None else c.command
    speed = np.abs(np.gradient(driver, c.dt))
    still = (_counts(c, touched) > 0) & (
        speed < max(SLOW * float(np.sqrt(np.mean(speed**2))), 1e-9)
    )
    return np.flatnonzero(still)[::step]


def turned(c: Clean, theta: Mapping[str, float]) -> Array:
    """Sine and cosine (n, 2) of the angle that the signed sum `theta` of other joints' turns."""
    angle = c.q.copy()
    for joint, sign in theta.items():
        angle += sign * c.others[joint]
    return np.stack([np.sin(angle), np.cos(angle)], axis=1)


def arm_load(logs: Sequence[Clean], arm: Mapping[str, float]) -> dict[str, float]:
    """Dry friction, own gravity, and gravity that the signed sum `arm` of other joints' angles
    turns, by robust least squares of effort, or of command minus position where none was measured.
    """
    xs, ys = [], []
    for c in logs:
        y = target(c)
        if y is not None and all(n in c.others for n in arm):
            kept = counted(c)[:: c.step]
            xs.append(np.hstack([design(c), turned(c, arm)[:: c.step]])[kept])
            ys.append(y[:: c.step][kept])
    if not xs:
        return {}
    x = np.concatenate(xs)
    beta = robust(x, np.concatenate(ys), np.zeros(x.shape[1]))
    (own, own_angle), (gravity, angle) = hanging(beta[4], beta[5]), hanging(beta[6], beta[7])
    return {
        "coulomb": max(float(beta[3]), 0.0),
        "arm_own": own,
        "arm_own_angle": own_angle,
        "arm_gravity": gravity,
        "arm_angle": angle,
    }


def _load_regression(
    logs: Sequence[Clean], samples: Sequence[NDArray[np.intp]]
) -> tuple[Array, Array, Array]:
    xs, ys, folds = [], [], []
    for k, (c, kept) in enumerate(zip(logs, samples, strict=True)):
        y = target(c)
        if y is None:
            continue
        slow = max(0.1 * float(np.sqrt(np.mean(c.v**2))), 1e-9)
        x = np.array([np.ones(c.v.size), c.a, c.v, np.tanh(c.v / slow), np.sin(c.q), np.cos(c.q)]).T
        xs.append(x[kept])
        ys.append(y[kept])
        n = kept.size
        folds.append(np.arange(n) * 5 // max(n, 1) if len(logs) < 4 else np.full(n, k % 5))
    return np.concatenate(xs), np.concatenate(ys), np.concatenate(folds)


def held_out(x: Array, y: Array, fold: Array) -> float:
    """Mean squared residual where each fold is predicted from the others; a little ridge."""
    z = x / (np.sqrt(np.mean(x**2, axis=0)) + 1e-12)
    left = np.empty(y.size)
    for k in np.unique(fold):
        a, b = fold != k, fold == k
        gram = z[a].T @ z[a] + 1e-3 * a.sum() * np.eye(z.shape[1])
        left[b] = y[b] - z[b] @ np.linalg.solve(gram, z[a].T @ y[a])
    return float(np.mean(np.minimum(left**2, 9.0 * np.median(left**2))))
