# ruff: noqa: PLR0912, PLR0915  (compiled code: flat functions over plain numbers are what
# the compiler turns into fast code)
"""Compiled reduced strike: one finger (hinges in its plane and abduction) on one key (hinge,
spring, damper, two stops).

The integrator is the one-stage Rosenbrock method with gamma = 1/2 (linearly implicit trapezoidal
rule): second order, A-stable, one small linear system a step, so that light phalanges on stiff
joints (time constants of 10 µs) cost no small steps. Generalised mass is frozen at the rest pose
and terms in velocity squared are left out (joint speeds stay near 2 rad/s);
geometry of the tip, gravity and contact are exact. Coordinates: abduction, flexions, key, hammer.

A step goes along the causal chain: base and key, tip, joints, contact, key, hammer, each of which
adds to the linear system. numba keeps compiled code by the file of the outermost function, so the
stages stand in the same file. What it keeps names the records by their class, and is found by the
line of the function: after a record's renaming, old code that is kept for the same line cannot be
read, and every function has to move by a line or the cache (``__pycache__/*.nb?``) has to go.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.piano.twin.reduced import strike_laws as law
from pianobot_ros.piano.twin.reduced.strike_laws import (
    carried,
    dahl_advance,
    dahl_slope,
    felt,
    friction_advance,
    held_by_friction,
    joint_spring,
    let_off_of,
    pad_spring,
    preload,
    rail_felt,
    relaxed,
    stribeck,
)
from pianobot_ros.piano.twin.reduced.strike_records import (
    Drive,
    FingerModel,
    Grip,
    KeyModel,
    Scaled,
    StrikeState,
    System,
    TimeStep,
    Tip,
    TipContact,
)

# N/m: tangential stiffness of the sticking tip; Coulomb's law with sticking within 0.03 mm
BRISTLE = 1.0e5
BRISTLE_DAMPING = 20.0  # N s/m
# of the key's largest angle, deeper than a hard press sinks: where the rail stops the hammer
HAMMER_STOP = 1.3
FREE, HELD_KEY = 0, 1
NEAR = 0.01  # rad: an angle whose sine and cosine are known is near within this
RELAX = 24  # steps in which the finger comes to rest before the strike
HELD, BRISTLE_Y, BRISTLE_X = range(3)  # memory of a contact: State.contact
MOVING, STILL, SLOW = range(3)  # how much happens in a step
# rad/s: with joints slower than this a finger that rests on its key needs two steps for five; the
# error against 40 steps is no larger for it
SLOW_JOINTS = 0.3
SLOW_KEY = 0.002  # rad/s: a slower key that nothing touches needs one step

# Sums may be ordered anew and products fused, which moves a result by its rounding; what is no
# number stays none, as the test for a state that became infinite needs.
_KERNEL = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "arcp", "nsz"},
}
_SET_UP = {**_KERNEL, "forceinline": True}
# Stages allocate nothing, so numba need not count the references to their arrays: it counts them
# atomically, at each early return of each step, which took two fifths of a strike's time.
_STAGE = {**_SET_UP, "_nrt": False}


@njit(**_KERNEL)  # type: ignore[untyped-decorator,unused-ignore]
def roll(
    mode: int,
    drive: Drive,
    finger: FingerModel,
    key: KeyModel,
    p: Array,
    substeps: int,
    out: Array,
) -> int:
    """One strike. Fills ``out`` (4, n): key angle rad, key rate rad/s, contact force N, lever arm
    of the contact m, which is the contact's torque on the key over its normal force.

    ``mode``: the key is free, or moves as ``drive`` says; ``p``: the parameter vector.
    Returns 0, or 1 if the state became infinite.
    """
    held, n, joints = mode == HELD_KEY, _scaled(finger, key, p), len(finger.pitch) + 1
    memory = _at_rest(held, drive, finger, key, n, p), _empty_system(joints)
    # how many coordinates there are is written out, so that loops over them are compiled as such
    if held:
        return int(_rolled(joints, drive, finger, key, p, substeps, memory, out))
    if p[law.HAMMER] > 0.0:
        return int(_rolled(joints + 2, drive, finger, key, p, substeps, memory, out))
    return int(_rolled(joints + 1, drive, finger, key, p, substeps, memory, out))


@njit(**_KERNEL)  # type: ignore[untyped-decorator,unused-ignore]
def drive_key(
    dt: float,
    force: Array,
    lever: Array,
    resting: float,
    key: KeyModel,
    p: Array,
    substeps: int,
    out: Array,
) -> int:
    """The key alone, driven by a given contact force (n,) N on a grid of ``dt`` at levers (n,) m.
    Fills angle and rate.

    It starts at ``resting`` rad where friction holds it.
    """
    steps = force.size
    n = _scaled_key(key, p)
    hammer = p[law.HAMMER] > 0.0
    weight = n.hammer_weight if hammer else 0.0
    th, w, qh, wh, held = 0.0, 0.0, 0.0, 0.0, 0.0
    weight += n.key_preload + p[law.KEY_PRELOAD]
    lifted = weight - _rest_push(0.0, key, n)
    if lifted > 0.0 or hammer:
        th = qh = -lifted / (key.rest_stiffness + n.key_stiffness)
    if p[law.KEY_FRICTION] > 0.0:
        th = qh = max(th, resting)
        held = held_by_friction(
            n.key_stiffness * th + weight - _rest_push(th, key, n),
            p[law.KEY_FRICTION] * (1.0 + p[law.KEY_FRICTION_STATIC]),
        )
    for i in range(steps):
        out[0, i], out[1, i] = th, w
        after = min(i + 1, steps - 1)
        untouched = force[i] == 0.0 == force[after]
        count = 1 if untouched and abs(w) < SLOW_KEY else substeps
        h = dt / count
        for sub in range(count):
            f = (sub + 0.5) / count
            push = (force[i] + f * (force[after] - force[i])) * (
                lever[i] + f * (lever[after] - lever[i])
            )
            torque = n.key_stiffness * th + n.key_damping * w - push
            torque, slope, drag = _key_laws(torque, th, w, held, key, n, p, h)
            a11 = n.inertia + 0.5 * h * drag + 0.25 * h * h * slope
            b1 = -(torque + 0.5 * h * slope * w)
            if hammer:
                a12, b2 = 0.0, -n.hammer_weight
                follows, full = carried(p, th, w, qh, wh, n.radius2, h)
                a11 += follows
                a22 = n.hammer_inertia + follows
                a12 -= follows
                b1 -= full
                b2 += full
                stops, back = _rail(qh, wh, key, h)
                a22 += stops
                b2 -= back
                det = a11 * a22 - a12 * a12
                alpha, beta = (a22 * b1 - a12 * b2) / det, (a11 * b2 - a12 * b1) / det
                qh += h * (wh + 0.5 * h * beta)
                wh += h * beta
                if th > p[law.HAMMER_ESCAPE] > qh and wh < 0.0:
                    wh = 0.0
            else:
                alpha = b1 / a11
            step = h * (w + 0.5 * h * alpha)
            if p[law.KEY_FRICTION] > 0.0:
                held = friction_advance(
                    held, step, p[law.KEY_FRICTION_BREAKAWAY], p[law.KEY_FRICTION_CREEP], h
                )
            th += step
            w += h * alpha
        if not abs(w) < 1e4:
            return 1
    return 0


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _rolled(
    size: int,
    drive: Drive,
    finger: FingerModel,
    key: KeyModel,
    p: Array,
    substeps: int,
    memory: tuple[StrikeState, System],
    out: Array,
) -> int:
    """:func:`roll` of ``size`` coordinates, of which a key that is given is none, in the
    ``memory`` that it needs, the state at first among it.
    """
    steps, joints, n = drive.position.shape[0], len(finger.pitch) + 1, _scaled(finger, key, p)
    held, hammer = size == joints, size > joints + 1
    state, system = memory
    q, v = state.q, state.v
    activity = MOVING
    for i in range(-RELAX, steps):
        node = max(i, 0)
        settle = i < 0
        if not settle:
            out[0, i], out[1, i] = q[joints], v[joints]
        count = 1 if (settle or activity == STILL) else (2 if activity == SLOW else substeps)
        h = 0.01 if settle else drive.dt / count
        step = TimeStep(h, settle, joints, size)
        for sub in range(count):
            s = 0.0 if settle else (sub + 0.5) * h
            if held and not settle:
                _place_key(drive, node, sub * h, state, joints)
            tip = _place_tip(drive, finger, n, node, s, settle, state, system)
            stiffness = drive.stiffness[node] * p[law.JOINT_STIFFNESS]
            _load_joints(finger, stiffness, n.joint_damping, p, step, state, system)
            contact = _meet(tip, finger.radius, key, step, state, system)
            touches, force, k_pad, c_pad = _press(contact, h, n, finger.pad_damping, p)
            grip = _grip(touches, contact, force, h, n, p, state)
            if touches:
                _load_contact(contact, force, k_pad, c_pad, grip, step, system)
            else:
                for r in range(joints, size):
                    system.rhs[r] = 0.0
            if not held:
                _load_key(key, n, p, step, state, system)
                if hammer:
                    _load_hammer(key, n, p, step, state, system)
            if sub == 0 and not settle:
                vy, vz = drive.velocity[node, 1], drive.velocity[node, 2]
                shown = _force_at_node(contact, s, vy, vz, n, finger.pad_damping, p)
                out[2, i], out[3, i] = shown, contact.lever
                if touches and force > 0.0:
                    out[3, i] += system.along[joints] * grip.y / force
            _solve(system.a, system.rhs, size)
            moved = _advance(p, step, state, system.rhs)
            _advance_bristles(touches, contact, grip, h, size, state, system)
            if settle:
                for j in range(size):
                    v[j] *= 0.5
                if held:
                    v[joints] = 0.0
            elif not moved < 1e4:
                return 1
            activity = MOVING
            if not settle:
                hovers = contact.gap > 0.001 and abs(v[joints]) < SLOW_KEY
                rests = contact.gap < 0.0 and moved < SLOW_JOINTS
                waits = moved < 0.02 and abs(drive.velocity[node, 2]) < 5e-4
                if hovers or waits:
                    activity = STILL
                elif rests:
                    activity = SLOW
        if i == -1:
            for j in range(joints + 2):
                v[j] = 0.0
            for j in range(joints):
                state.creep[j, 0] = state.creep[j, 1] = 0.0
    return 0


# Set-up.


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _rest_push(th: float, key: KeyModel, n: Scaled) -> float:
    """Torque (N m) by which the rest stop presses down a key that stands still at ``th``."""
    above = key.rest_angle - th
    if above <= 0.0:
        return 0.0
    if key.felt_power <= 1.0:
        return key.rest_stiffness * above
    r = key.stop_radius
    stiff, lossy = key.rest_stiffness / n.radius2, key.rest_damping / n.radius2
    push, _, _ = rail_felt(above * r, 0.0, stiff, lossy, key.felt_power, key.felt_force)
    return float(push * r)


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _scaled(finger: FingerModel, key: KeyModel, p: Array) -> Scaled:
    n = _scaled_key(key, p)
    last = finger.pitch[len(finger.pitch) - 1]
    return Scaled(
        finger.damping * p[law.JOINT_DAMPING],
        finger.pad_stiffness * p[law.PAD_STIFFNESS],
        finger.pad_friction * (1.0 - p[law.TIP_SLIP]),
        p[law.TIP_REACH] * np.cos(last) + p[law.TIP_DROP] * np.sin(last),
        -p[law.TIP_REACH] * np.sin(last) + p[law.TIP_DROP] * np.cos(last),
        n.inertia,
        n.key_stiffness,
        n.key_preload,
        n.key_damping,
        n.top,
        n.radius2,
        n.felt_stiffness,
        n.hammer_inertia,
        n.hammer_weight,
    )


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _scaled_key(key: KeyModel, p: Array) -> Scaled:
    """The numbers of the key; those of the finger are zero."""
    r2 = key.stop_radius * key.stop_radius
    return Scaled(
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        key.inertia * p[law.KEY_INERTIA],
        key.stiffness * p[law.KEY_STIFFNESS],
        key.preload * p[law.KEY_STIFFNESS],
        key.damping * p[law.KEY_DAMPING],
        key.max_angle - p[law.FELT_THICKNESS] / key.stop_radius,
        r2,
        key.stop_stiffness / r2,
        p[law.HAMMER] * r2,
        p[law.HAMMER] * p[law.HAMMER_WEIGHT] * key.stop_radius,
    )


@njit(**_SET_UP)  # type: ignore[untyped-decorator,unused-ignore]
def _at_rest(
    held: bool, drive: Drive, finger: FingerModel, key: KeyModel, n: Scaled, p: Array
) -> StrikeState:
    """Before the finger has come to rest: with friction where it held after the last strike."""
    joints = len(finger.pitch) + 1
    own, hammer = joints, joints + 1
    q, v = np.zeros(joints + 2), np.zeros(joints + 2)
    friction, jam, creep = np.zeros(joints), np.zeros(joints), np.zeros((joints, 2))
    contact = np.zeros(3)
    if p[law.JOINT_FRICTION] > 0.0:
        for j in range(joints):
            friction[j] = p[law.JOINT_FRICTION_REST]
            q[j] = (
                -p[law.JOINT_FRICTION]
                * p[law.JOINT_FRICTION_REST]
                / (
                    drive.stiffness[0]
                    * p[law.JOINT_STIFFNESS]
                    * (finger.abduction_ratio if j == 0 else 1.0)
                )
            )
    if held:
        q[own] = drive.key_angle[0]
    elif p[law.KEY_FRICTION] > 0.0:
        q[own] = q[hammer] = drive.key_angle[0]
        contact[HELD] = held_by_friction(
            n.key_stiffness * q[own]
            + n.key_preload
            + p[law.KEY_PRELOAD]
            - _rest_push(q[own], key, n),
            p[law.KEY_FRICTION] * (1.0 + p[law.KEY_FRICTION_STATIC]),
        )
    return StrikeState(q, v, friction, jam, creep, contact)


@njit(**_SET_UP)  # type: ignore[untyped-decorator,unused-ignore]
def _empty_system(joints: int) -> System:
    most = joints + 2
    return System(
        np.empty((most, most)),
        np.empty(most),
        np.zeros((joints, 3)),
        np.zeros(most),
        np.zeros(most),
        np.zeros(most),
        np.empty(joints - 1),
        np.empty(joints - 1),
        np.full((most, 3), np.inf),
    )


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _turned(angle: float, known: Array) -> tuple[float, float]:
    """Sine and cosine of ``angle`` rad, from those of a near angle where ``known`` (3,) has one:
    its series to the sixth order is exact to rounding within :data:`NEAR`.
    """
    d = angle - known[0]
    if not abs(d) < NEAR:
        known[0], known[1], known[2] = angle, np.sin(angle), np.cos(angle)
        return known[1], known[2]
    d2 = d * d
    s = d * (1.0 - d2 * (1.0 / 6.0) * (1.0 - d2 * (1.0 / 20.0)))
    c = 1.0 - 0.5 * d2 * (1.0 - d2 * (1.0 / 12.0) * (1.0 - d2 * (1.0 / 30.0)))
    return known[1] * c + known[2] * s, known[2] * c - known[1] * s


# The stages of a step.


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _place_key(drive: Drive, node: int, s: float, state: StrikeState, key: int) -> None:
    """A key that is given, ``s`` s after the node: cubic Hermite of its angle."""
    angle, rate = drive.key_angle, drive.key_rate
    state.q[key] = angle[node] + s * rate[node]
    if node + 1 < drive.position.shape[0]:
        f = s / drive.dt
        slope = rate[node + 1]
        state.q[key] = (
            (1 + 2 * f) * (1 - f) ** 2 * angle[node]
            + f * (1 - f) ** 2 * drive.dt * rate[node]
            + f * f * (3 - 2 * f) * angle[node + 1]
            + f * f * (f - 1) * drive.dt * slope
        )
        state.v[key] = rate[node] + f * (slope - rate[node])


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _place_tip(
    drive: Drive,
    finger: FingerModel,
    n: Scaled,
    node: int,
    s: float,
    settle: bool,
    state: StrikeState,
    system: System,
) -> Tip:
    """Kinematics of the tip, its Jacobian, and the torques of gravity and of the base's
    acceleration on the joints.
    """
    frame, velocity, acceleration = drive.frame, drive.velocity, drive.acceleration
    length, moment = finger.length, finger.moment
    sine, cosine, jac, rhs, q = system.sine, system.cosine, system.jacobian, system.rhs, state.q
    m = len(finger.pitch)
    sa, ca = _turned(q[0], system.turns[0])
    angle = 0.0
    rho, zeta, mrho = 0.0, 0.0, 0.0
    for j in range(m):
        angle += q[j + 1]
        sp, cpj = _turned(finger.pitch[j] + angle, system.turns[j + 1])
        sine[j], cosine[j] = sp, cpj
        along = length[j] + (n.along if j == m - 1 else 0.0)
        across = n.across if j == m - 1 else 0.0
        rho += along * cpj - across * sp
        zeta -= along * sp + across * cpj
        mrho += moment[j] * cpj
    # world vectors: heading after abduction and its derivative
    hx = -sa * frame[0, 0] + ca * frame[0, 1]
    hy = -sa * frame[1, 0] + ca * frame[1, 1]
    hz = -sa * frame[2, 0] + ca * frame[2, 1]
    ax = -ca * frame[0, 0] - sa * frame[0, 1]
    ay = -ca * frame[1, 0] - sa * frame[1, 1]
    az = -ca * frame[2, 0] - sa * frame[2, 1]
    ux, uy, uz = frame[0, 2], frame[1, 2], frame[2, 2]
    gx = gy = gz = 0.0
    vbx = vby = vbz = 0.0
    if not settle:
        gx, gy, gz = -acceleration[node, 0], -acceleration[node, 1], -acceleration[node, 2]
        vbx = velocity[node, 0] + acceleration[node, 0] * s
        vby = velocity[node, 1] + acceleration[node, 1] * s
        vbz = velocity[node, 2] + acceleration[node, 2] * s
    gz -= law.GRAVITY
    by = drive.position[node, 1] + (velocity[node, 1] + 0.5 * acceleration[node, 1] * s) * s
    bz = drive.position[node, 2] + (velocity[node, 2] + 0.5 * acceleration[node, 2] * s) * s
    jac[0, 0], jac[0, 1], jac[0, 2] = rho * ax, rho * ay, rho * az
    rhs[0] = mrho * (ax * gx + ay * gy + az * gz)
    gh, gu = hx * gx + hy * gy + hz * gz, ux * gx + uy * gy + uz * gz
    trho, tzeta, grho, gzeta = 0.0, 0.0, 0.0, 0.0
    for j in range(m - 1, -1, -1):
        sp, cpj = sine[j], cosine[j]
        along = length[j] + (n.along if j == m - 1 else 0.0)
        across = n.across if j == m - 1 else 0.0
        trho += -along * sp - across * cpj
        tzeta += -along * cpj + across * sp
        grho -= moment[j] * sp
        gzeta -= moment[j] * cpj
        jac[j + 1, 0] = trho * hx + tzeta * ux
        jac[j + 1, 1] = trho * hy + tzeta * uy
        jac[j + 1, 2] = trho * hz + tzeta * uz
        rhs[j + 1] = grho * gh + gzeta * gu
    y, z = by + rho * hy + zeta * uy, bz + rho * hz + zeta * uz
    return Tip(y, z, vbx, vby, vbz, ax, ay, az, ux, uy, uz)


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _load_joints(
    finger: FingerModel,
    stiffness: float,
    damping: float,
    p: Array,
    step: TimeStep,
    state: StrikeState,
    system: System,
) -> None:
    """Mass, springs, dampers and laws of the joints. ``stiffness`` N m/rad of the flexions."""
    a, rhs, q, v = system.a, system.rhs, state.q, state.v
    h, settle, joints, size = step
    jamming = p[law.JAMMING_HYSTERESIS]
    for r in range(size):
        for c in range(size):
            a[r, c] = finger.mass[r, c] if (r < joints and c < joints) else 0.0
    for j in range(joints):
        k = stiffness * (finger.abduction_ratio if j == 0 else 1.0)
        torque, slope = joint_spring(
            q[j], k, p[law.JOINT_BACKLASH], p[law.JOINT_HARDENING], p[law.JOINT_HARDENING_POWER]
        )
        if jamming > 0.0:
            yields = p[law.JAMMING_YIELD]
            torque = (1.0 - jamming) * torque + jamming * k * yields * state.jam[j]
            slope = (1.0 - jamming) * slope + jamming * k * yields * dahl_slope(
                state.jam[j], v[j], yields
            )
        if p[law.JOINT_CREEP] > 0.0:
            torque -= p[law.JOINT_CREEP] * k * 0.5 * (state.creep[j, 0] + state.creep[j, 1])
        if p[law.JOINT_FRICTION] > 0.0:
            level = p[law.JOINT_FRICTION] * stribeck(
                v[j], p[law.JOINT_FRICTION_STATIC], law.JOINT_STRIBECK
            )
            torque += level * state.friction[j]
            slope += level * dahl_slope(state.friction[j], v[j], p[law.JOINT_FRICTION_BREAKAWAY])
        c_joint = damping + (0.05 if settle else 0.0)
        rhs[j] -= torque + c_joint * v[j] + 0.5 * h * slope * v[j]
        a[j, j] += 0.5 * h * c_joint + 0.25 * h * h * slope


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _meet(
    tip: Tip, radius: float, key: KeyModel, step: TimeStep, state: StrikeState, system: System
) -> TipContact:
    """Where tip and key are to each other, how they move, and by which coordinates.

    The tip rolls: friction acts in the middle of the pad's compression, which is a little less than
    a radius below the tip's centre and as much below the key's surface.
    """
    q, v, jac = state.q, state.v, system.jacobian
    normal, along, across = system.normal, system.along, system.across
    joints: int = step.joints
    sn, cs = _turned(q[joints], system.turns[joints])
    off_y, off_z = tip.y - key.hinge_y, tip.z - key.hinge_z
    gap = -sn * off_y + cs * off_z - key.height - radius
    lever = -cs * off_y - sn * off_z
    gap_rate, slip_y = -sn * tip.base_y + cs * tip.base_z, -(cs * tip.base_y + sn * tip.base_z)
    slip_x = tip.base_x
    own = 0.0
    sunk = 0.5 * max(-gap, 0.0)
    arm = radius - sunk
    roll_y = -arm * tip.flexion_x
    roll_x = -arm * (tip.flexion_y * cs + tip.flexion_z * sn)
    spin_y = -arm * tip.abduction_x
    spin_x = -arm * (tip.abduction_y * cs + tip.abduction_z * sn)
    for j in range(joints):
        normal[j] = -sn * jac[j, 1] + cs * jac[j, 2]
        along[j] = -(cs * jac[j, 1] + sn * jac[j, 2]) + (spin_y if j == 0 else roll_y)
        across[j] = jac[j, 0] + (spin_x if j == 0 else roll_x)
        own += normal[j] * v[j]
        slip_y += along[j] * v[j]
        slip_x += across[j] * v[j]
    normal[joints], along[joints] = lever, sunk - key.height
    own += lever * v[joints]
    slip_y += along[joints] * v[joints]
    gap_rate += own
    return TipContact(gap, gap_rate, own, slip_y, slip_x, lever, sn, cs)


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _press(
    contact: TipContact, h: float, n: Scaled, pad_damping: float, p: Array
) -> tuple[bool, float, float, float]:
    """Whether the tip touches, and with what force N, stiffness N/m and damping N s/m."""
    depth, k = -contact.gap, n.pad_stiffness
    if not depth - 0.5 * h * contact.own > 0.0:
        return False, 0.0, 0.0, 0.0
    spring, k_pad = pad_spring(max(depth, 0.0), k, p[law.PAD_SOFTENING])
    if depth < 0.0:
        spring = k_pad * depth
    c_pad = pad_damping * (k_pad / k if p[law.PAD_SOFTENING] > 0.0 else 1.0)
    force = spring - c_pad * contact.rate
    if force - 0.5 * h * k_pad * contact.own <= 0.0:
        return False, 0.0, 0.0, 0.0
    return True, force, k_pad, c_pad


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _grip(
    touches: bool,
    contact: TipContact,
    force: float,
    h: float,
    n: Scaled,
    p: Array,
    state: StrikeState,
) -> Grip:
    """Friction at the tip: bristles that stick until they pull harder than Coulomb's law allows."""
    if not touches:
        return Grip(False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    weakening = p[law.TIP_SLIP_WEAKENING]
    share = (
        n.friction
        * stribeck(np.hypot(contact.slip_y, contact.slip_x), weakening, p[law.TIP_SLIP_SPEED])
        / (1.0 + weakening)
    )
    limit = share * max(force, 0.0)
    ty = -(BRISTLE * state.contact[BRISTLE_Y] + BRISTLE_DAMPING * contact.slip_y)
    tx = -(BRISTLE * state.contact[BRISTLE_X] + BRISTLE_DAMPING * contact.slip_x)
    ahead_y = ty - 0.5 * h * BRISTLE * contact.slip_y
    ahead_x = tx - 0.5 * h * BRISTLE * contact.slip_x
    pull = np.sqrt(ahead_y * ahead_y + ahead_x * ahead_x)
    to_y, to_x = 0.0, 0.0
    slides = pull > limit
    if slides:
        to_y, to_x = ahead_y / pull, ahead_x / pull
        ty, tx = limit * to_y, limit * to_x
    return Grip(slides, ty, tx, to_y, to_x, limit, share)


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _load_contact(
    contact: TipContact,
    force: float,
    k_pad: float,
    c_pad: float,
    grip: Grip,
    step: TimeStep,
    system: System,
) -> None:
    """The contact's force on every coordinate. It acts along the normal; when the tip slides its
    friction follows it.
    """
    a, rhs = system.a, system.rhs
    normal, along, across = system.normal, system.along, system.across
    h, joints, size = step.h, step.joints, step.size
    stiff = 0.25 * h * h * k_pad + 0.5 * h * c_pad
    fresh = force - 0.5 * h * k_pad * contact.own
    for r in range(size):
        row = normal[r]
        value = normal[r] * fresh + along[r] * grip.y + across[r] * grip.x
        if grip.slides:
            drawn = grip.share * (grip.to_y * along[r] + grip.to_x * across[r])
            row += drawn
            value -= drawn * 0.5 * h * k_pad * contact.own
        rhs[r] = value + (rhs[r] if r < joints else 0.0)
        for c in range(size):
            a[r, c] += row * stiff * normal[c]
        if not grip.slides:
            w = 0.25 * h * h * BRISTLE + 0.5 * h * BRISTLE_DAMPING
            rhs[r] -= 0.5 * h * BRISTLE * (along[r] * contact.slip_y + across[r] * contact.slip_x)
            for c in range(size):
                a[r, c] += w * (along[r] * along[c] + across[r] * across[c])


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _load_key(
    key: KeyModel, n: Scaled, p: Array, step: TimeStep, state: StrikeState, system: System
) -> None:
    """Inertia, spring, damper, stops and laws of the key."""
    at, h = step.joints, step.h
    th, w = state.q[at], state.v[at]
    torque = n.key_stiffness * th + n.key_damping * w
    torque, slope, drag = _key_laws(torque, th, w, state.contact[HELD], key, n, p, h)
    if step.settle:
        torque += 0.5 * w
        drag += 0.5
    system.a[at, at] += n.inertia + 0.5 * h * drag + 0.25 * h * h * slope
    system.rhs[at] -= torque + 0.5 * h * slope * w


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _load_hammer(
    key: KeyModel, n: Scaled, p: Array, step: TimeStep, state: StrikeState, system: System
) -> None:
    """The hammer behind the key."""
    a, rhs, at, h = system.a, system.rhs, step.joints, step.h
    hammer = at + 1
    angle, rate = state.q[hammer], state.v[hammer]
    a[hammer, hammer] += n.hammer_inertia
    rhs[hammer] = -n.hammer_weight
    follows, full = carried(p, state.q[at], state.v[at], angle, rate, n.radius2, h)
    if full != 0.0:
        rhs[at] -= full
        rhs[hammer] += full
        a[at, at] += follows
        a[hammer, hammer] += follows
        a[at, hammer] -= follows
        a[hammer, at] -= follows
    stops, back = _rail(angle, rate, key, h)
    rhs[hammer] -= back
    a[hammer, hammer] += stops
    if step.settle:
        rhs[hammer] -= 0.5 * rate
        a[hammer, hammer] += 0.25 * h


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _key_laws(
    torque: float, th: float, w: float, held: float, key: KeyModel, n: Scaled, p: Array, h: float
) -> tuple[float, float, float]:
    """``torque`` N m and what friction, let-off and the stops add to it at angle ``th`` and rate
    ``w``; stiffness N m/rad and damping N m s/rad of all. ``held``: Dahl's state of the friction.
    """
    slope, drag = n.key_stiffness, n.key_damping
    torque += n.key_preload + preload(th, p[law.KEY_PRELOAD], p[law.KEY_PRELOAD_FADE])
    if p[law.KEY_FRICTION] > 0.0:
        level = p[law.KEY_FRICTION] * stribeck(w, p[law.KEY_FRICTION_STATIC], law.KEY_STRIBECK)
        torque += level * held
        slope += level * dahl_slope(held, w, p[law.KEY_FRICTION_BREAKAWAY])
    if p[law.LET_OFF] > 0.0:
        elastic, dry, follows = let_off_of(p, th, w)
        torque += elastic + dry
        # dry friction never turns a motion around: where a step could, it is wholly implicit
        turns = h * abs(dry) > n.inertia * abs(w) and w != 0.0
        drag += 2.0 * dry / w if turns else follows
    ahead = th + 0.5 * h * w
    if key.felt_power > 1.0:  # in line: as a stage of its own it costs a quarter of the speed
        steep = p[law.FELT_EXPONENT]
        r, side, x = key.stop_radius, 1.0, (th - n.top) * key.stop_radius
        spring, loss = n.felt_stiffness, key.stop_damping / n.radius2
        if x <= 0.0:
            side, x, steep = -1.0, (key.rest_angle - th) * r, 1.0
            spring, loss = key.rest_stiffness / n.radius2, key.rest_damping / n.radius2
        push, k_felt, c_felt = rail_felt(
            x, side * w * r, spring, loss, key.felt_power + steep - 1.0, key.felt_force
        )
        torque += side * push * r
        slope += k_felt * n.radius2
        drag += c_felt * n.radius2
    elif ahead > n.top:
        compressed = max(th - n.top, 0.0) * key.stop_radius
        push, k_felt = felt(compressed, n.felt_stiffness, p[law.FELT_EXPONENT])
        total = push * key.stop_radius + key.stop_damping * w
        if th < n.top:
            total = k_felt * n.radius2 * (th - n.top) + key.stop_damping * w
        if total + 0.5 * h * k_felt * n.radius2 * w > 0.0:
            torque += total
            slope += k_felt * n.radius2
            drag += key.stop_damping
    elif ahead < key.rest_angle:
        total = key.rest_stiffness * (th - key.rest_angle) + key.rest_damping * w
        if total + 0.5 * h * key.rest_stiffness * w < 0.0:
            torque += total
            slope += key.rest_stiffness
            drag += key.rest_damping
    return torque, slope, drag


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _rail(angle: float, rate: float, key: KeyModel, h: float) -> tuple[float, float]:
    """The rail that stops the hammer: its share of the system's matrix, and its torque N m."""
    over = angle - HAMMER_STOP * key.max_angle
    if over + 0.5 * h * rate > 0.0:
        k, c = key.stop_stiffness, key.stop_damping
        return 0.25 * h * h * k + 0.5 * h * c, k * over + c * rate + 0.5 * h * k * rate
    return 0.0, 0.0


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _force_at_node(
    contact: TipContact, s: float, vy: float, vz: float, n: Scaled, pad_damping: float, p: Array
) -> float:
    """The contact's force N at the node itself, where the base, at ``vy`` and ``vz`` m/s, is half a
    step behind.
    """
    depth = -contact.gap + s * (-contact.sine * vy + contact.cosine * vz)
    if not depth > 0.0:
        return 0.0
    shown, k = pad_spring(depth, n.pad_stiffness, p[law.PAD_SOFTENING])
    softer = k / n.pad_stiffness if p[law.PAD_SOFTENING] > 0.0 else 1.0
    shown -= pad_damping * softer * contact.rate
    return float(max(shown, 0.0))


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _advance(p: Array, step: TimeStep, state: StrikeState, rate: Array) -> float:
    """Move on by a step at the accelerations ``rate``, the laws' memory too. Returns the largest
    speed, rad/s.
    """
    h, settle, joints, size = step
    q, v, contact = state.q, state.v, state.contact
    key, hammer = joints, joints + 1
    moved = 0.0
    for j in range(size):
        path = h * (v[j] + 0.5 * h * rate[j])
        if j < joints and not settle:
            if p[law.JOINT_FRICTION] > 0.0:
                state.friction[j] = friction_advance(
                    state.friction[j],
                    path,
                    p[law.JOINT_FRICTION_BREAKAWAY],
                    p[law.JOINT_FRICTION_CREEP],
                    h,
                )
            if p[law.JAMMING_HYSTERESIS] > 0.0:
                state.jam[j] = dahl_advance(state.jam[j], path, p[law.JAMMING_YIELD])
            if p[law.JOINT_CREEP] > 0.0:
                quick, slow = relaxed(h, p[law.JOINT_CREEP_TIME], p[law.JOINT_CREEP_SPREAD])
                state.creep[j, 0] += (q[j] + 0.5 * path - state.creep[j, 0]) * quick
                state.creep[j, 1] += (q[j] + 0.5 * path - state.creep[j, 1]) * slow
        if j == key and p[law.KEY_FRICTION] > 0.0 and not settle:
            contact[HELD] = friction_advance(
                contact[HELD],
                path,
                p[law.KEY_FRICTION_BREAKAWAY],
                p[law.KEY_FRICTION_CREEP],
                h,
            )
        q[j] += path
        v[j] += h * rate[j]
        if j == hammer and q[key] > p[law.HAMMER_ESCAPE] > q[hammer] and v[hammer] < 0.0:
            # the check holds a hammer that falls back before the jack is under it again
            v[hammer] = 0.0
        moved = max(moved, abs(v[j]))
    return moved


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _advance_bristles(
    touches: bool,
    contact: TipContact,
    grip: Grip,
    h: float,
    size: int,
    state: StrikeState,
    system: System,
) -> None:
    """The bristles of the tip follow its slip; those of a sliding tip stay bent as far as they
    hold.
    """
    bristles = state.contact
    if not touches:
        bristles[BRISTLE_Y] = bristles[BRISTLE_X] = 0.0
        return
    slip_y, slip_x = contact.slip_y, contact.slip_x
    for j in range(size):
        slip_y += 0.5 * h * system.along[j] * system.rhs[j]
        slip_x += 0.5 * h * system.across[j] * system.rhs[j]
    bristles[BRISTLE_Y] += h * slip_y
    bristles[BRISTLE_X] += h * slip_x
    if grip.slides:
        bristles[BRISTLE_Y] = -grip.limit * grip.to_y / BRISTLE
        bristles[BRISTLE_X] = -grip.limit * grip.to_x / BRISTLE


@njit(**_STAGE)  # type: ignore[untyped-decorator,unused-ignore]
def _solve(a: Array, b: Array, n: int) -> None:
    """Solve a x = b in place by elimination (rows are dominated by inertia and damping, so pivoting
    is not needed).
    """
    for i in range(n):
        inverse = 1.0 / a[i, i]
        for r in range(i + 1, n):
            factor = a[r, i] * inverse
            if factor != 0.0:
                for c in range(i + 1, n):
                    a[r, c] -= factor * a[i, c]
                b[r] -= factor * b[i]
    for i in range(n - 1, -1, -1):
        total = b[i]
        for c in range(i + 1, n):
            total -= a[i, c] * b[c]
        b[i] = total / a[i, i]
