"""Compiled mechanics of the axis: position loop forwards, inverse dynamics, and free motion over short horizons.

All three use the same laws. A law whose magnitude is 0 vanishes exactly, so one kernel serves every combination of effects.
`p` is the parameter vector in the order of `NAMES`; q in rad, v in rad/s, effort in the log's unit (inertia is then effort
per rad/s²).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from examples.servo_axis.laws import backlash, cogging, deadband, encoder_ripple, gravity, hysteresis, stribeck
from pianobot_ros.gap.types import Array

NAMES = (
    "inertia", "viscous", "effort_offset", "bandwidth", "damping", "feedforward", "integral", "command_gain",
    "command_delay", "command_lag", "deadband", "torque_limit", "torque_droop", "coulomb",
    "stribeck_rise", "stribeck_level", "stribeck_speed", "load_friction", "load_friction_level",
    "friction_asymmetry", "asymmetric_level", "gravity", "gravity_angle", "cogging", "cogging_waves", "cogging_phase",
    "hysteresis", "hysteresis_distance", "backlash", "backlash_share", "backlash_output", "backlash_flank",
    "elastic_period", "elastic_share", "elastic_damping",
    "position_offset", "encoder_ripple", "encoder_waves", "encoder_phase", "encoder_loop", "sensor_latency", "clock_skew",
    "payload_gravity", "payload_angle", "payload_inertia",
    "smooth_speed", "peak",
)  # fmt: skip
INDEX = {name: i for i, name in enumerate(NAMES)}
(J, B, OFF, WN, ZETA, FF, KI, GAIN, DELAY, LAG, DEAD, LIMIT, DROOP, FC, FSR, FSL, FSV, MU, MUL, FA, FAL, G, GA, COG, COGW, COGP,
 HY, HYD, BL, BLS, BLO, BLF, EP, ES, ED, PO, ER, EW, EPH, EL, LAT, SKEW, PG, PA, PJ, VS, PEAK) = range(len(NAMES))  # fmt: skip

law_stribeck, law_gravity, law_cogging, law_ripple = stribeck.law, gravity.law, cogging.law, encoder_ripple.law
law_deadband, law_hysteresis, law_pull = deadband.law, hysteresis.advance, backlash.pull

FINE = 0.05  # of a spring's period that a step may take
LEAST = 1e-4  # s, the shortest step; the stiffest spring is stable with it
STIFF = 0.002  # s of a spring's period below which a joint is rigid
FLANK_DAMPING = 0.4  # damping ratio of the load on a flank


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _dry(v: float, load: float, p: Array) -> float:
    """Dry resistance (effort) irrespective of direction."""
    return float(p[FC] + law_stribeck(v, p[FSR], p[FSL], p[FSV]) + p[MU] * abs(load) + p[MUL] + p[FAL])


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _field(q: float, p: Array) -> float:
    """Torque that depends on position only."""
    return float(law_gravity(q, p[G], p[GA]) + law_gravity(q, p[PG], p[PA]) + law_cogging(q, p[COG], p[COGW], p[COGP]))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _coupling(p: Array) -> tuple[float, float, float, float]:
    """Share of the inertia behind a spring (0 without one), its period s, half its gap rad, its damping ratio."""
    if p[EP] > STIFF:
        return p[ES], p[EP], 0.0, p[ED]
    if p[BL] > 0.0:
        return p[BLS], p[BLF], 0.5 * p[BL], FLANK_DAMPING
    return 0.0, 1.0, 0.0, 0.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _longest(p: Array) -> float:
    """Longest step (s) with which motor and load can be integrated; the lighter one is the quicker."""
    share, period, _, _ = _coupling(p)
    return max(FINE * period * math.sqrt(1.0 - share), LEAST) if share > 0.0 else 1.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _step(s: Array, effort: float, h: float, p: Array) -> None:
    """Advance the state s = (q, v, load q, load v, hysteresis z) by h under the motor's effort."""
    q, v = s[0], s[1]
    share, period, half, damping = _coupling(p)
    total = p[J] + p[PJ]
    inertia = total * (1.0 - share)
    field = _field(q, p)
    spring = 0.0
    if share > 0.0:
        pull = law_pull(q - s[2], v - s[3], half, period, damping)
        spring = share * total * pull
        if half > 0.0:  # the field is the load's, which feels it in the gap too
            pull -= field / (share * total)
            field = 0.0
        s[3] += h * pull
        s[2] += h * s[3]
    load = effort - p[B] * v
    force = effort - p[OFF] - p[B] * v - field - spring - p[HY] * s[4]
    free = v + h * force / inertia
    direction = 1.0 if free > 0 else -1.0
    brake = h * max(_dry(v, load, p) + direction * p[FA], 0.0) / inertia
    new = free - direction * brake if abs(free) > brake else 0.0
    s[4] = law_hysteresis(s[4], h * new, p[HYD])
    s[1] = new
    s[0] = q + h * new


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _carry(load: Array, q0: float, v0: float, q1: float, v1: float, dt: float, p: Array) -> float:
    """Advance the load (q, v) by dt while the motor goes from q0, v0 to q1, v1; mean acceleration by which it is pulled."""
    share, period, half, damping = _coupling(p)
    own = _field(q1, p) / (share * (p[J] + p[PJ])) if half > 0.0 else 0.0
    sub = max(1, math.ceil(dt / (FINE * period)))
    mean = 0.0
    for k in range(sub):
        f = (k + 0.5) / sub
        pull = law_pull(q0 + f * (q1 - q0) - load[0], v0 + f * (v1 - v0) - load[1], half, period, damping)
        load[1] += dt / sub * (pull - own)
        load[0] += dt / sub * load[1]
        mean += pull / sub
    return mean


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def forward(u: Array, du: Array, dt: float, q0: float, v0: float, integral: float, p: Array) -> Array:
    """Reading (n,) and effort (n,) of the position loop that follows command u (n,) with slope du (n,).

    It starts at q0, v0 with `integral` (rad s) of the past error in the controller.
    """
    n = u.size
    out = np.empty((2, n))
    sub = max(1, math.ceil(dt / min(0.001, 0.2 / p[WN], _longest(p))))
    h = dt / sub
    s = np.zeros(5)
    s[0] = q0 - p[PO] - law_ripple(q0, p[ER], p[EW], p[EPH])
    s[1] = v0
    s[2], s[3] = s[0], v0
    s[4] = 0.0 if v0 == 0 else (1.0 if v0 > 0 else -1.0)
    kp, kd = p[J] * p[WN] * p[WN], 2.0 * p[ZETA] * p[WN] * p[J]
    total = 0.0
    limit = p[PEAK] * (1.0 - p[LIMIT]) if p[LIMIT] > 0.0 else 1e300
    if p[KI] > 0.0:  # what the integrator has gathered, and what it holds on average
        total = integral + (_field(s[0], p) + p[OFF]) / (kp * p[KI])
    effort = 0.0
    for i in range(n):
        reading = s[0] + p[BLO] * (s[2] - s[0]) if p[BL] > 0.0 else s[0]
        out[0, i] = reading + p[PO] + law_ripple(reading, p[ER], p[EW], p[EPH])
        for k in range(sub):
            f = k / sub
            j = min(i + 1, n - 1)
            target, slope = u[i] + f * (u[j] - u[i]), du[i] + f * (du[j] - du[i])
            seen, speed = s[0], s[1]
            if p[EL] > 0.0:  # the controller reads the encoder that errs
                seen += p[EL] * law_ripple(s[0], p[ER], p[EW], p[EPH])
                speed *= 1.0 + p[EL] * p[ER] * p[EW] * math.cos(p[EW] * s[0] + p[EPH])
            error = law_deadband(target - seen, p[DEAD]) if p[DEAD] > 0.0 else target - seen
            total += h * error
            effort = kp * (error + p[KI] * total) + kd * (p[FF] * slope - speed)
            if k == 0:
                out[1, i] = min(max(effort, -limit), limit)
            if abs(effort) > limit:
                effort = limit if effort > 0 else -limit
                total -= h * error
            _step(s, effort, h, p)
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _undo(q: float, v: float, a: float, p: Array) -> tuple[float, float, float]:
    """True angle, speed and acceleration of a reading with offset and ripple."""
    if p[ER] == 0.0:
        return q - p[PO], v, a
    true = q - p[PO]
    for _ in range(2):
        true = q - p[PO] - law_ripple(true, p[ER], p[EW], p[EPH])
    slope = p[ER] * p[EW] * math.cos(p[EW] * true + p[EPH])
    speed = v / (1.0 + slope)
    bend = -p[ER] * p[EW] * p[EW] * math.sin(p[EW] * true + p[EPH])
    return true, speed, (a - bend * speed * speed) / (1.0 + slope)


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def inverse(q: Array, v: Array, a: Array, dt: float, p: Array) -> Array:
    """Effort that the measured motion needs, before droop and latency: as smooth as the motion, and with steps (2, n)."""
    n = q.size
    total = p[J] + p[PJ]
    out = np.empty((2, n))
    share, _, half, _ = _coupling(p)
    load, z = np.array([q[0] - p[PO], v[0]]), 0.0
    before, speed = load[0], v[0]
    for i in range(n):
        true, vi, ai = _undo(q[i], v[i], a[i], p)
        field = _field(true, p)
        inertial, pulled, row = total * (1.0 - share) * ai, 0.0, 0
        if share > 0.0:
            pulled = share * total * _carry(load, before, speed, true, vi, dt, p)
            before, speed = true, vi
            if half > 0.0:  # blows of the flanks, and the field is the load's
                row, field = 1, 0.0
        if i > 0:
            z = law_hysteresis(z, q[i] - q[i - 1], p[HYD])
            out[row, i - 1] += 0.5 * pulled  # a mean over the time between two samples belongs to both
        sign = math.tanh(vi / p[VS])
        dry = _dry(vi, inertial + pulled + field, p)
        out[0, i] = inertial + p[B] * vi + p[OFF] + field
        out[1, i] = dry * sign + p[FA] * abs(sign) + p[HY] * z
        out[row, i] += pulled if i == n - 1 else 0.5 * pulled
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def horizon(q: Array, v: Array, effort: Array, dt: float, every: int, first: int, p: Array) -> Array:
    """Position (n,) predicted from measured effort, re-initialised from the measured state every `every` samples and at `first`.

    `first` is where the block proper begins, so that repeats are re-initialised at the same places.
    """
    n = q.size
    out = np.empty(n)
    share = _coupling(p)[0]
    sub = max(1, math.ceil(dt / min(0.001, _longest(p))))
    h = dt / sub
    s = np.zeros(5)
    z = 0.0
    load = np.array([q[0] - p[PO], v[0]])
    before, last = load[0], v[0]
    for i in range(n):
        true, speed, _ = _undo(q[i], v[i], 0.0, p)
        if i > 0:
            z = law_hysteresis(z, q[i] - q[i - 1], p[HYD])
            if share > 0.0:  # along the measured motion, so every horizon starts with the right spring
                _carry(load, before, last, true, speed, dt, p)
        before, last = true, speed
        if i == 0 or (i - first) % every == 0:
            s[0], s[1], s[2], s[3], s[4] = true, speed, true, speed, z
            if share > 0.0:
                s[2:4] = load
        out[i] = s[0] + p[PO] + law_ripple(s[0], p[ER], p[EW], p[EPH])
        for k in range(sub):
            j = min(i + 1, n - 1)
            _step(s, effort[i] + (k / sub) * (effort[j] - effort[i]), h, p)
    return out
