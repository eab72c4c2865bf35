"""Compiled mechanics of the axis: position loop forwards, inverse dynamics, and free motion over
short horizons.

All three use the same laws. A law whose magnitude is 0 vanishes exactly, so one kernel serves every
combination of effects. `p` is the parameter vector in the order of `NAMES`; q in rad, v in rad/s,
effort in the log's unit (inertia is then effort per rad/s²).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy.signal import lfilter

from pianobot_ros.axis.laws.drive import cogging, deadband, speed_limit
from pianobot_ros.axis.laws.friction import concave_viscous, hysteresis, presliding, stribeck
from pianobot_ros.axis.laws.load import backlash, end_stop, gravity, spring
from pianobot_ros.axis.laws.sensing import encoder_ripple
from pianobot_ros.gap.problem.types import Array

JOINT = (
    "inertia",
    "viscous",
    "effort_offset",
    "bandwidth",
    "damping",
    "feedforward",
    "integral",
    "command_weight",
    "inertia_feedforward",
    "load_feedforward",
)
"""Parameters of the joint and its position loop, without any effect."""
NAMES = (
    *JOINT,
    "command_middle",
    "command_gain",
    "command_delay",
    "command_lag",
    "deadband",
    "torque_limit",
    "torque_limit_windup",
    "torque_droop",
    "coulomb",
    "stribeck_rise",
    "stribeck_level",
    "stribeck_speed",
    "load_friction",
    "load_friction_level",
    "load_friction_driven",
    "friction_asymmetry",
    "asymmetric_level",
    "gravity",
    "gravity_angle",
    "cogging",
    "cogging_waves",
    "cogging_phase",
    "hysteresis",
    "hysteresis_distance",
    "backlash",
    "backlash_share",
    "backlash_output",
    "backlash_flank",
    "elastic_period",
    "elastic_share",
    "elastic_damping",
    "elastic_output",
    "position_offset",
    "encoder_ripple",
    "encoder_waves",
    "encoder_phase",
    "encoder_loop",
    "sensor_latency",
    "clock_skew",
    "payload_gravity",
    "payload_angle",
    "payload_own",
    "payload_own_angle",
    "payload_inertia",
    "payload_weight",
    "concave_viscous",
    "concave_speed",
    "friction_compensation",
    "warming",
    "warming_time",
    "speed_limit",
    "speed_limit_depth",
    "command_hold",
    "model_scale",
    "arm_gravity",
    "arm_angle",
    "arm_own",
    "arm_own_angle",
    "carried_load",
    "carried_angle",
    "carried_reach",
    "carried_from",
    "carried_until",
    "field_sine",
    "field_cosine",
    "field_inertia",
    "contact",
    "contact_side",
    "contact_limit",
    "contact_slope",
    "contact_slope_2",
    "field_limit",
    "smooth_speed",
    "rest_speed",
    "peak",
    "link_offset",
    "link_lag",
    "end_stop",
    "end_stop_angle",
    "end_stop_side",
    "end_stop_damping",
    "backlash_friction",
    "carried_start",
    "carried_period",
    "spring",
    "spring_angle",
    "presliding",
)
INDEX = {name: i for i, name in enumerate(NAMES)}
(
    J,
    B,
    OFF,
    WN,
    ZETA,
    FF,
    KI,
    CW,
    AFF,
    LFF,
    MID,
    GAIN,
    DELAY,
    LAG,
    DEAD,
    LIMIT,
    WIND,
    DROOP,
    FC,
    FSR,
    FSL,
    FSV,
    MU,
    MUL,
    MUD,
    FA,
    FAL,
    G,
    GA,
    COG,
    COGW,
    COGP,
    HY,
    HYD,
    BL,
    BLS,
    BLO,
    BLF,
    EP,
    ES,
    ED,
    EO,
    PO,
    ER,
    EW,
    EPH,
    EL,
    LAT,
    SKEW,
    PG,
    PA,
    PGO,
    PGOA,
    PJ,
    PW,
    CV,
    CVS,
    FCOMP,
    WARM,
    WARMT,
    VLIM,
    VDEPTH,
    HOLD,
    MS,
    AG,
    AGA,
    AO,
    AOA,
    CG,
    CA,
    CR,
    CFROM,
    CUNTIL,
    XS,
    XC,
    XJ,
    CK,
    CSIDE,
    CL,
    CS1,
    CS2,
    XL,
    VS,
    RS,
    PEAK,
    LO,
    LL,
    SK,
    SA,
    SSIDE,
    SD,
    BLD,
    CSTART,
    CPERIOD,
    RK,
    RA,
    PRE,
) = range(len(NAMES))

law_concave, law_speed_limit = concave_viscous.law, speed_limit.law
law_stribeck, law_gravity, law_cogging, law_ripple = (
    stribeck.law,
    gravity.law,
    cogging.law,
    encoder_ripple.law,
)
law_deadband, law_hysteresis, law_pull = deadband.law, hysteresis.advance, backlash.pull
law_ripple_slope, law_stop, law_spring = encoder_ripple.slope, end_stop.law, spring.law
law_bent, law_slowed = presliding.advance, presliding.slowed

LEVELS = (FC, FSL, MUL, FAL)
"""Levels of dry friction by its laws."""
DRY = (*LEVELS, FSR, MU)
"""All that dry friction is in proportion to."""
NO_FIELD = np.empty((0, 4))
"""No torque from other joints."""
FINE = 0.05  # of a spring's period that a step may take
LEAST = 1e-4  # s, the shortest step; the stiffest spring is stable with it
STIFF = 0.002  # s of a spring's period below which a joint is rigid
FLANK_DAMPING = 0.4  # damping ratio of the load on a flank


def shared(p: Array) -> float:
    """Share of the inertia behind a spring or a gap; 0 in a rigid joint."""
    return float(_coupling(p)[0])


def delayed(t: Array, command: Array, dt: float, p: Array, session: Array) -> Array:
    """The command (n,) as the loop gets it: scaled, late (t in s), filtered; `session` (n,) is time
    as a share of the session, for a clock that runs away.
    """
    late = p[DELAY] + p[HOLD] + p[SKEW] * session
    u = p[GAIN] * np.interp(t - late, t, command)
    if p[LAG] > 1e-5:
        a = math.exp(-dt / p[LAG])
        u = lfilter([1 - a], [1, -a], u, zi=[a * u[0]])[0]
    return np.asarray(u)


# What a step calls allocates nothing, so numba need not count references to arrays, atomically.
_WITHIN = {"cache": True, "_nrt": False}


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _dry(v: float, load: float, p: Array) -> float:
    """Dry resistance (effort) irrespective of direction."""
    share = p[MU] * p[MUD] if load * v < 0.0 else p[MU]  # driven by its load, or driving it
    return float(
        p[FC] + law_stribeck(v, p[FSR], p[FSL], p[FSV]) + share * abs(load) + p[MUL] + p[FAL]
    )


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _drag(v: float, p: Array) -> float:
    """Resistance (effort) that is smooth in the speed, signed like it."""
    out = p[B] * v
    if p[CV] > 0.0:
        out += law_concave(v, p[CV], p[CVS])
    return float(out)


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _at(field: Array, i: int, p: Array) -> None:
    """Put the field of sample i, (n, 4) sine, cosine, added inertia and limit of the angle, into
    the parameters.
    """
    if field.shape[0] > i:
        p[XS], p[XC], p[XJ], p[XL] = field[i, 0], field[i, 1], field[i, 2], field[i, 3]


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _weight(q: float, p: Array) -> float:
    """Torque of what the joint carries."""
    return float(law_gravity(q, p[G], p[GA]) + p[XS] * math.sin(q) + p[XC] * math.cos(q) + p[PW])


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _field(q: float, p: Array) -> float:
    """Torque that depends on the load's position only."""
    push = law_stop(q, p[XL], p[CSIDE], p[CK], 0.0) if p[CK] > 0.0 else 0.0
    return float(push + _weight(q, p) + law_spring(q, p[RK], p[RA]))


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _stopped(q: float, v: float, p: Array) -> float:
    """Torque by which a stop holds the joint back."""
    if p[SK] <= 0.0:
        return 0.0
    damper = 2.0 * p[SD] * math.sqrt(p[SK] * p[J])
    return float(law_stop(q, p[SA], p[SSIDE], p[SK], damper * v))


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _coupling(p: Array) -> tuple[float, float, float, float]:
    """Share of the inertia behind a spring (0 without one), its period s, half its gap rad, its
    damping ratio.
    """
    if p[EP] > STIFF:
        return p[ES], p[EP], 0.0, p[ED]
    if p[BL] > 0.0:
        return p[BLS], p[BLF], 0.5 * p[BL], FLANK_DAMPING
    return 0.0, 1.0, 0.0, 0.0


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def behind(p: Array) -> float:
    """Share of the dry friction that acts behind a gap."""
    return float(p[BLD] if p[BL] > 0.0 and not p[EP] > STIFF else 0.0)


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _dragged(v: float, h: float, inertia: float, p: Array) -> float:
    """Speed of a load in its gap after `h` s of the dry friction that is its own."""
    brake = h * behind(p) * _dry(v, 0.0, p) / inertia
    return float(max(v - brake, 0.0) if v > 0.0 else min(v + brake, 0.0))


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _sensed(s: Array, p: Array) -> float:
    """What the encoder of an elastic joint sees, by where it sits between motor and load."""
    return float(s[0] + p[EO] * (s[2] - s[0]) if p[EP] > STIFF else s[0])


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _longest(p: Array) -> float:
    """Longest step (s) with which motor and load can be integrated; the lighter one is the
    quicker.
    """
    share, period, _, _ = _coupling(p)
    step = max(FINE * period * math.sqrt(1.0 - share), LEAST) if share > 0.0 else 1.0
    stiff = p[SK] + p[RK]
    if stiff > 0.0:
        step = min(step, max(FINE * 2.0 * math.pi * math.sqrt(p[J] / stiff), LEAST))
    return step


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _step(s: Array, effort: float, h: float, p: Array) -> None:
    """Advance the state s by h under the motor's effort: q, v, load q, load v, hysteresis z, and
    dry friction as a share of the level at which it slips.
    """
    q, v = s[0], s[1]
    share, period, half, damping = _coupling(p)
    total = p[J] + p[PJ] + p[XJ]
    inertia = total * (1.0 - share)
    field = _field(q, p)
    carried = 0.0
    if share > 0.0:
        pull = law_pull(q - s[2], v - s[3], half, period, damping)
        carried = share * total * pull
        if half > 0.0:  # the field is the load's, which feels it in the gap too
            pull -= field / (share * total)
            field = 0.0
        s[3] += h * pull
        if half > 0.0:
            s[3] = _dragged(s[3], h, share * total, p)
        s[2] += h * s[3]
    drag = _drag(v, p)
    load = effort - drag
    force = load - p[OFF] - field - carried - p[HY] * s[4] - _stopped(q, v, p)
    if p[COG] != 0.0:
        force -= law_cogging(q, p[COG], p[COGW], p[COGP])
    free = v + h * force / inertia
    direction = 1.0 if free > 0 else -1.0
    dry = (1.0 - behind(p)) * _dry(v, load, p)
    brake = h * max(dry + direction * p[FA], 0.0) / inertia
    if p[PRE] > 0.0:
        new = law_slowed(free, brake, s[5], h, p[PRE])
        s[5] = law_bent(s[5], h * new, p[PRE])
    else:
        new = free - direction * brake if abs(free) > brake else 0.0
    s[4] = law_hysteresis(s[4], h * new, p[HYD])
    s[1] = new
    s[0] = q + h * new


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _bent_at_first(q: float, v: float, effort: float, p: Array) -> float:
    """Dry friction as a share of the level at which it slips, of a joint at q, v whose past is not
    known: what slips in full, and at rest what holds the joint under the effort.
    """
    sign = math.tanh(v / max(p[VS], p[RS]))
    dry = _dry(v, 0.0, p)
    if dry <= 0.0:
        return sign
    holds = (effort - _drag(v, p) - p[OFF] - _field(q, p) - _stopped(q, v, p)) / dry
    return float(sign + (1.0 - abs(sign)) * min(max(holds, -1.0), 1.0))


@njit(**_WITHIN)  # type: ignore[untyped-decorator,unused-ignore]
def _carry(load: Array, q0: float, v0: float, q1: float, v1: float, dt: float, p: Array) -> float:
    """Advance the load (q, v) by dt while the motor goes from q0, v0 to q1, v1; mean acceleration
    by which it is pulled.
    """
    share, period, half, damping = _coupling(p)
    inertia = share * (p[J] + p[PJ] + p[XJ])
    own = _field(q1, p) / inertia if half > 0.0 else 0.0
    sub = max(1, math.ceil(dt / (FINE * period)))
    mean = 0.0
    for k in range(sub):
        f = (k + 0.5) / sub
        pull = law_pull(
            q0 + f * (q1 - q0) - load[0], v0 + f * (v1 - v0) - load[1], half, period, damping
        )
        load[1] += dt / sub * (pull - own)
        if half > 0.0:
            load[1] = _dragged(load[1], dt / sub, inertia, p)
        load[0] += dt / sub * load[1]
        mean += pull / sub
    return mean


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def forward(
    u: Array,
    du: Array,
    dt: float,
    q0: float,
    v0: float,
    integral: float,
    p: Array,
    field: Array,
) -> Array:
    """Reading (n,) and effort (n,) of the position loop that follows command u (n,) with slope du
    (n,).

    It starts at q0, v0 with `integral` (rad s) of the past error in the controller, beside what
    that holds at `command_middle`, the mean command of the log. With integral action the command
    counts with `command_weight` in the proportional part: a position loop around a speed loop that
    has the integral action is such a loop, with a weight below 1 where the speed is not fed forward
    in full. Beside the speed, shares of the inertia's and of the load's effort may be fed forward:
    computed torque, compensation of gravity and of a constant load. `field` (n, 4) or (0, 4) is
    what other joints add to the torque (see `_at`).
    """
    n = u.size
    p = p.copy()
    _at(field, 0, p)
    out = np.empty((2, n))
    sub = max(1, math.ceil(dt / min(0.002, 0.1 / p[WN], _longest(p)) - 1e-9))
    h = dt / sub
    s = np.zeros(6)
    s[0] = q0 - p[PO] - law_ripple(q0, p[ER], p[EW], p[EPH])
    s[1], s[2], s[3] = v0, s[0], v0
    s[4] = 0.0 if v0 == 0 else (1.0 if v0 > 0 else -1.0)
    kp, kd = p[J] * p[WN] * p[WN], 2.0 * p[ZETA] * p[WN] * p[J]
    total = 0.0
    limit = p[PEAK] * (1.0 - p[LIMIT]) if p[LIMIT] > 0.0 else 1e300
    weight = 0.0
    if p[KI] > 0.0:  # what the integrator has gathered, and what it holds on average
        held = _field(p[MID], p) - p[LFF] * (_weight(p[MID], p) + p[OFF]) + p[OFF]
        total = integral + held / (kp * p[KI])
        weight = p[CW] - 1.0
    effort = 0.0
    for i in range(n):
        _at(field, i, p)
        reading = s[0] + p[BLO] * (s[2] - s[0]) if p[BL] > 0.0 else _sensed(s, p)
        out[0, i] = reading + p[PO] + law_ripple(reading, p[ER], p[EW], p[EPH])
        for k in range(sub):
            f = k / sub
            j = min(i + 1, n - 1)
            target, slope = u[i] + f * (u[j] - u[i]), du[i] + f * (du[j] - du[i])
            seen, speed = s[0], s[1]
            if p[EL] > 0.0:  # the controller reads the encoder that errs
                seen += p[EL] * law_ripple(s[0], p[ER], p[EW], p[EPH])
                speed *= 1.0 + p[EL] * law_ripple_slope(s[0], p[ER], p[EW], p[EPH])
            error = law_deadband(target - seen, p[DEAD]) if p[DEAD] > 0.0 else target - seen
            total += h * error
            part = weight * (target - p[MID])  # of the command the integrator holds the rest
            effort = kp * (error + part + p[KI] * total) + kd * (p[FF] * slope - speed)
            if p[AFF] != 0.0:
                effort += p[AFF] * p[J] * (du[j] - du[i]) / dt
            if p[LFF] != 0.0:
                effort += p[LFF] * (_weight(seen, p) + p[OFF])
            if p[FCOMP] > 0.0:
                effort += p[FCOMP] * math.tanh(slope / p[VS])
            if k == 0:
                out[1, i] = min(max(effort, -limit), limit)
            if abs(effort) > limit:
                effort = limit if effort > 0 else -limit
                total -= (1.0 - p[WIND]) * h * error
            if p[VLIM] > 0.0:  # what the supply leaves at this speed
                effort = law_speed_limit(effort, s[1], p[VLIM], (1.0 - p[VDEPTH]) * p[PEAK])
            if i == 0 and k == 0:
                s[5] = _bent_at_first(s[0], s[1], effort, p)
            _step(s, effort, h, p)
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def inverse(q: Array, v: Array, a: Array, dt: float, p: Array, field: Array, felt: Array) -> Array:
    """Effort that the joint's motion needs, before cogging, droop and latency: as smooth as the
    motion, and with steps; and dry friction as a share of the level at which it slips, (3, n). See
    `readings.py`.

    `felt` (n,) is the measured effort. Dry friction is set-valued: at rest it holds whatever is
    felt beside the rest, up to its own size, and how far its contact is bent is what that says.
    `rest_speed` is the speed that cannot be told from rest.
    """
    n = q.size
    p = p.copy()
    _at(field, 0, p)
    out = np.empty((3, n))
    share, _, half, _ = _coupling(p)
    load, z = np.array([q[0], v[0]]), 0.0
    before, speed = load[0], v[0]
    bent = 0.0
    for i in range(n):
        true, vi = q[i], v[i]
        _at(field, i, p)
        total = p[J] + p[PJ] + p[XJ]
        own = _field(true, p) + _stopped(true, vi, p)
        inertial, pulled, row = total * (1.0 - share) * a[i], 0.0, 0
        if share > 0.0:
            pulled = share * total * _carry(load, before, speed, true, vi, dt, p)
            before, speed = true, vi
            if half > 0.0:  # blows of the flanks, and the field is the load's
                row, own = 1, 0.0
        if i > 0:
            z = law_hysteresis(z, q[i] - q[i - 1], p[HYD])
            out[row, i - 1] += (
                0.5 * pulled
            )  # a mean over the time between two samples belongs to both
        sign = math.tanh(vi / max(p[VS], p[RS]))
        dry = (1.0 - behind(p)) * _dry(vi, inertial + pulled + own, p)
        out[0, i] = inertial + _drag(vi, p) + p[OFF] + own
        slack = 1.0 - abs(sign)
        if p[PRE] > 0.0:
            bent = law_bent(bent, q[i] - q[max(i - 1, 0)], p[PRE])
            sign = bent * abs(sign)
        wanted = felt[i] - out[0, i] - pulled - p[FA] * abs(sign) - p[HY] * z
        held = min(max(wanted, dry * (sign - slack)), dry * (sign + slack))
        out[1, i] = held + p[FA] * abs(sign) + p[HY] * z
        if dry > 0.0:
            bent += slack * (held / dry - bent)
        out[2, i] = bent
        out[row, i] += pulled if i == n - 1 else 0.5 * pulled
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def crossed(q: Array, v: Array, dt: float, p: Array, field: Array) -> Array:
    """By how much (n,) a motor that moves with q, v is ahead of the load in its gap."""
    n = q.size
    p = p.copy()
    out = np.zeros(n)
    load = np.array([q[0], v[0]])
    for i in range(n):
        _at(field, i, p)
        k = max(i - 1, 0)
        if i > 0:
            _carry(load, q[k], v[k], q[i], v[i], dt, p)
        out[i] = q[i] - load[0]
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def borne(q: Array, p: Array, field: Array) -> Array:
    """Acceleration (n,) that the load behind a spring or a gap would have by its own weight."""
    p = p.copy()
    out = np.empty(q.size)
    share = _coupling(p)[0]
    for i in range(q.size):
        _at(field, i, p)
        out[i] = _field(q[i], p) / (share * (p[J] + p[PJ] + p[XJ]))
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def horizon(
    q: Array,
    v: Array,
    bent: Array,
    effort: Array,
    dt: float,
    pieces: tuple[int, int],
    p: Array,
    field: Array,
) -> Array:
    """Reading (n,) predicted from measured effort less cogging, re-initialised from the joint's
    motion and from how far the contact is `bent` (n,; see `inverse`) by `pieces`: each so many
    samples, and at the first; see `readings.py`.

    The first is where the block proper begins, so that repeats are re-initialised at the same
    places.
    """
    n = q.size
    every, first = pieces
    p = p.copy()
    p[COG] = 0.0
    out = np.empty(n)
    share = _coupling(p)[0]
    sub = max(1, math.ceil(dt / min(0.002, _longest(p)) - 1e-9))
    h = dt / sub
    s = np.zeros(6)
    z = 0.0
    load = np.array([q[0], v[0]])
    before, last = load[0], v[0]
    for i in range(n):
        _at(field, i, p)
        true, speed = q[i], v[i]
        if i > 0:
            z = law_hysteresis(z, q[i] - q[i - 1], p[HYD])
            if (
                share > 0.0
            ):  # along the measured motion, so every horizon starts with the right spring
                _carry(load, before, last, true, speed, dt, p)
        before, last = true, speed
        if i == 0 or (i - first) % every == 0:
            s[0], s[1], s[2], s[3], s[4], s[5] = true, speed, true, speed, z, bent[i]
            if share > 0.0:
                s[2], s[3] = load[0], load[1]
        reading = _sensed(s, p)
        out[i] = reading + p[PO] + law_ripple(reading, p[ER], p[EW], p[EPH])
        for k in range(sub):
            j = min(i + 1, n - 1)
            _step(s, effort[i] + (k / sub) * (effort[j] - effort[i]), h, p)
    return out
