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
    "hysteresis", "hysteresis_distance", "backlash", "backlash_share", "backlash_output",
    "elastic_period", "elastic_share", "elastic_damping",
    "position_offset", "encoder_ripple", "encoder_waves", "encoder_phase", "sensor_latency", "clock_skew",
    "payload_gravity", "payload_angle", "payload_inertia",
    "smooth_speed", "peak",
)  # fmt: skip
INDEX = {name: i for i, name in enumerate(NAMES)}
(J, B, OFF, WN, ZETA, FF, KI, GAIN, DELAY, LAG, DEAD, LIMIT, DROOP, FC, FSR, FSL, FSV, MU, MUL, FA, FAL, G, GA, COG, COGW, COGP,
 HY, HYD, BL, BLS, BLO, EP, ES, ED, PO, ER, EW, EPH, LAT, SKEW, PG, PA, PJ, VS, PEAK) = range(len(NAMES))  # fmt: skip

law_stribeck, law_gravity, law_cogging, law_ripple = stribeck.law, gravity.law, cogging.law, encoder_ripple.law
law_deadband, law_hysteresis, law_backlash = deadband.law, hysteresis.advance, backlash.drive


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _dry(v: float, load: float, p: Array) -> float:
    """Dry resistance (effort) irrespective of direction."""
    return float(p[FC] + law_stribeck(v, p[FSR], p[FSL], p[FSV]) + p[MU] * abs(load) + p[MUL] + p[FAL])


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _field(q: float, p: Array) -> float:
    """Torque that depends on position only."""
    return float(law_gravity(q, p[G], p[GA]) + law_gravity(q, p[PG], p[PA]) + law_cogging(q, p[COG], p[COGW], p[COGP]))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _step(s: Array, effort: float, h: float, p: Array) -> None:
    """Advance the state s = (q, v, load q, load v, hysteresis z, loose load's three) by h under the motor's effort."""
    q, v = s[0], s[1]
    elastic = p[EP] > 1e-4
    share = p[ES] if elastic else 0.0
    total = p[J] + p[PJ]
    inertia = total * (1.0 - share)
    field = _field(q, p)
    spring = 0.0
    if elastic:
        w = 2.0 * math.pi / p[EP]
        pull = w * w * (q - s[2]) + 2.0 * p[ED] * w * (v - s[3])
        spring = share * total * pull
        s[3] += h * pull
        s[2] += h * s[3]
    if p[BL] > 0.0 and not elastic:
        heavy = total * p[BLS]
        motor = (effort - p[OFF] - p[B] * v - p[HY] * s[4]) / total
        if law_backlash(s[5:8], q, v, motor - field / total, field, heavy, p[BL], h) == 0.0:  # the load is loose
            field, inertia = 0.0, total - heavy
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
def forward(u: Array, du: Array, dt: float, q0: float, v0: float, integral: float, p: Array) -> Array:
    """Reading (n,) and effort (n,) of the position loop that follows command u (n,) with slope du (n,).

    It starts at q0, v0 with `integral` (rad s) of the past error in the controller.
    """
    n = u.size
    out = np.empty((2, n))
    sub = max(1, math.ceil(dt / min(0.001, 0.2 / p[WN])))
    h = dt / sub
    s = np.zeros(8)
    s[0] = q0 - p[PO] - law_ripple(q0, p[ER], p[EW], p[EPH])
    s[1] = v0
    s[2], s[3], s[5], s[6] = s[0], v0, s[0], v0
    s[4] = 0.0 if v0 == 0 else (1.0 if v0 > 0 else -1.0)
    kp, kd = p[J] * p[WN] * p[WN], 2.0 * p[ZETA] * p[WN] * p[J]
    total = 0.0
    limit = p[PEAK] * (1.0 - p[LIMIT]) if p[LIMIT] > 0.0 else 1e300
    if p[KI] > 0.0:  # what the integrator has gathered, and what it holds on average
        total = integral + (_field(s[0], p) + p[OFF]) / (kp * p[KI])
    effort = 0.0
    for i in range(n):
        reading = s[0] + p[BLO] * (s[5] - s[0]) if p[BL] > 0.0 else s[0]
        out[0, i] = reading + p[PO] + law_ripple(reading, p[ER], p[EW], p[EPH])
        for k in range(sub):
            f = k / sub
            j = min(i + 1, n - 1)
            target, slope = u[i] + f * (u[j] - u[i]), du[i] + f * (du[j] - du[i])
            error = law_deadband(target - s[0], p[DEAD]) if p[DEAD] > 0.0 else target - s[0]
            total += h * error
            effort = kp * (error + p[KI] * total) + kd * (p[FF] * slope - s[1])
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
    """Effort that the measured motion needs, before droop and latency: smooth part and dry part (2, n)."""
    n = q.size
    total = p[J] + p[PJ]
    out = np.empty((2, n))
    elastic = p[EP] > 1e-4
    share = p[ES] if elastic else 0.0
    ql, vl, z = q[0] - p[PO], v[0], 0.0
    loose = np.array([q[0], v[0], 0.0])
    w = 2.0 * math.pi / p[EP] if elastic else 0.0
    sub = max(1, math.ceil(dt * w / 0.3))
    for i in range(n):
        true, vi, ai = _undo(q[i], v[i], a[i], p)
        field = _field(true, p)
        inertial = total * (1.0 - share) * ai
        if elastic:
            h = dt / sub
            pull = 0.0
            for _ in range(sub):
                pull = w * w * (true - ql) + 2.0 * p[ED] * w * (vi - vl)
                vl += h * pull
                ql += h * vl
            inertial += share * total * pull
        if i > 0:
            z = law_hysteresis(z, q[i] - q[i - 1], p[HYD])
        if p[BL] > 0.0 and not elastic:
            heavy = total * p[BLS]
            inertial = (total - heavy) * ai + law_backlash(loose, true, vi, ai, field, heavy, p[BL], dt)
            field = 0.0
        sign = math.tanh(vi / p[VS])
        dry = _dry(vi, inertial + field, p)
        out[0, i] = inertial + p[B] * vi + p[OFF] + field
        out[1, i] = dry * sign + p[FA] * abs(sign) + p[HY] * z
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def horizon(q: Array, v: Array, effort: Array, dt: float, every: int, first: int, p: Array) -> Array:
    """Position (n,) predicted from measured effort, re-initialised from the measured state every `every` samples and at `first`.

    `first` is where the block proper begins, so that repeats are re-initialised at the same places.
    """
    n = q.size
    out = np.empty(n)
    sub = max(1, math.ceil(dt / 0.001))
    h = dt / sub
    s = np.zeros(8)
    z = 0.0
    elastic = p[EP] > 1e-4
    w = 2.0 * math.pi / p[EP] if elastic else 0.0
    fine = max(1, math.ceil(dt * w / 0.3))
    ql, vl = q[0], v[0]
    loose = np.array([q[0], v[0], 0.0])
    for i in range(n):
        true, speed, _ = _undo(q[i], v[i], 0.0, p)
        if i > 0:
            z = law_hysteresis(z, q[i] - q[i - 1], p[HYD])
            if elastic:  # the load is carried along the measured motion, so every horizon starts with the right spring
                for _ in range(fine):
                    vl += dt / fine * (w * w * (true - ql) + 2.0 * p[ED] * w * (speed - vl))
                    ql += dt / fine * vl
            if p[BL] > 0.0 and not elastic:
                law_backlash(loose, true, speed, (v[i] - v[i - 1]) / dt, _field(true, p), p[J] * p[BLS], p[BL], dt)
        if i == 0 or (i - first) % every == 0:
            s[0], s[1], s[2], s[3], s[4] = true, speed, true, speed, z
            if elastic:
                s[2], s[3] = ql, vl
            s[5:8] = loose
        out[i] = s[0] + p[PO] + law_ripple(s[0], p[ER], p[EW], p[EPH])
        for k in range(sub):
            j = min(i + 1, n - 1)
            _step(s, effort[i] + (k / sub) * (effort[j] - effort[i]), h, p)
    return out
