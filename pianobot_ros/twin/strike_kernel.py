# ruff: noqa: PLR0912, PLR0915  (compiled code: flat functions over plain numbers are what the compiler turns into fast code)
"""Compiled reduced strike: one finger (hinges in its plane and abduction) on one key (hinge, spring, damper, two stops).

The integrator is the one-stage Rosenbrock method with gamma = 1/2 (linearly implicit trapezoidal rule): second order,
A-stable, one small linear system a step, so that light phalanges on stiff joints (time constants of 10 µs) cost no small
steps. Generalised mass is frozen at the rest pose and terms in velocity squared are left out (joint speeds stay near 2 rad/s);
geometry of the tip, gravity and contact are exact. Coordinates: abduction, flexions, key, hammer.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pianobot_ros.twin.strike_laws import (
    CJ,
    CK,
    FE,
    FRICTION_BREAKAWAY,
    FT,
    GRAVITY,
    HE,
    HK,
    HM,
    HW,
    IK,
    JB,
    JC,
    JCT,
    JF,
    JFR,
    JFS,
    JH,
    JHP,
    JM,
    JMY,
    JOINT_STRIBECK,
    KEY_BREAKAWAY,
    KEY_STRIBECK,
    KF,
    KFS,
    KJ,
    KK,
    KP,
    LO,
    LOA,
    LOW,
    PS,
    PSO,
    TD,
    TIP_STRIBECK,
    TR,
    TS,
    TSW,
    dahl_advance,
    dahl_slope,
    felt,
    held_by_friction,
    jack,
    joint_spring,
    let_off,
    pad_spring,
    stribeck,
)  # fmt: skip

Array = NDArray[np.float64]

BRISTLE = 1.0e5  # N/m: tangential stiffness of the sticking tip; Coulomb's law with sticking within 0.03 mm
BRISTLE_DAMPING = 20.0  # N s/m
HAMMER_DAMPING = 5.33  # N s/m, piano-action paper, Table 2
HAMMER_STOP = 1.3  # of the key's largest angle, deeper than a hard press sinks: where the rail stops the hammer
FREE, HELD_KEY = 0, 1


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator,unused-ignore]
def _solve(a: Array, b: Array, n: int) -> None:
    """Solve a x = b in place by elimination (rows are dominated by inertia and damping, so pivoting is not needed)."""
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


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator,unused-ignore]
def roll(mode: int, dt: float, base: Array, velocity: Array, acceleration: Array, frame: Array, stiffness: Array,
         given_angle: Array, given_rate: Array, pitch: Array, length: Array, moment: Array, mass: Array, finger: Array,
         key: Array, p: Array, substeps: int, out: Array) -> int:  # fmt: skip
    """One strike. Fills ``out`` (4, n): key angle rad, key rate rad/s, contact force N, lever arm of the contact m.

    ``base``, ``velocity``, ``acceleration`` (n, 3) of the finger's base on a grid of ``dt`` s; ``frame`` (3, 3) columns: across,
    heading, up; ``stiffness`` (n,) N m/rad; ``finger``: tip radius, abduction ratio, joint damping, pad stiffness, damping,
    friction; ``key``: hinge y, hinge z, inertia, stiffness, damping, max angle, stop k, stop d, rest k, rest d, stop radius,
    height of its surface above the hinge. A free key starts at ``given_angle[0]`` where friction holds it. The lever arm is
    the contact's torque on the key over its normal force.
    Returns 0, or 1 if the state became infinite.
    """
    steps = base.shape[0]
    m = pitch.size
    nf = m + 1
    ik, ih = nf, nf + 1
    hammer = p[HM] > 0.0
    held = mode == HELD_KEY
    size = nf if held else (nf + 2 if hammer else nf + 1)
    radius, ratio = finger[0], finger[1]
    cj = finger[2] * p[CJ]
    kp, cp = finger[3] * p[PS], finger[4]
    mu = finger[5] * (1.0 - p[TS])
    hinge_y, hinge_z, surface = key[0], key[1], key[11]
    inertia, kk, ck = key[2] * p[IK], key[3] * p[KK], key[4] * p[CK]
    top = key[5] - p[FT] / key[10]
    r2 = key[10] * key[10]
    k_stop = key[6] / r2
    hammer_inertia = p[HM] * r2
    hammer_weight = p[HM] * p[HW] * key[10]
    last = pitch[m - 1]
    extra_a = p[TR] * np.cos(last) + p[TD] * np.sin(last)
    extra_b = -p[TR] * np.sin(last) + p[TD] * np.cos(last)

    q, v = np.zeros(nf + 2), np.zeros(nf + 2)
    sine, cosine = np.empty(m), np.empty(m)
    friction_z, jam_z, creep_z = np.zeros(nf), np.zeros(nf), np.zeros(nf)
    if p[JF] > 0.0:  # where friction held the joints after the last strike
        for j in range(nf):
            friction_z[j] = p[JFR]
            q[j] = -p[JF] * p[JFR] / (stiffness[0] * p[KJ] * (ratio if j == 0 else 1.0))
    key_z, bristle_y, bristle_x = 0.0, 0.0, 0.0
    a, rhs = np.empty((nf + 2, nf + 2)), np.empty(nf + 2)
    jn, jt, jx = np.zeros(nf + 2), np.zeros(nf + 2), np.zeros(nf + 2)
    jac = np.zeros((nf, 3))
    if held:
        q[ik] = given_angle[0]
    elif p[KF] > 0.0:
        q[ik] = q[ih] = given_angle[0]
        key_z = held_by_friction(kk * q[ik] + p[KP], p[KF] * (1.0 + p[KFS]))
    relax = 24
    quiet = 0
    for i in range(-relax, steps):
        node = max(i, 0)
        settle = i < 0
        if not settle:
            out[0, i], out[1, i] = q[ik], v[ik]
        count = 1 if (settle or quiet == 1) else (2 if quiet == 2 else substeps)
        h = 0.01 if settle else dt / count
        kj = stiffness[node] * p[KJ]
        for sub in range(count):
            s = 0.0 if settle else (sub + 0.5) * h
            # ---- base and key at mid step
            if held and not settle:
                s0 = sub * h
                q[ik] = given_angle[node] + s0 * given_rate[node]
                if node + 1 < steps:
                    f = s0 / dt
                    slope = given_rate[node + 1]
                    # cubic Hermite of the given angle
                    q[ik] = ((1 + 2 * f) * (1 - f) ** 2 * given_angle[node] + f * (1 - f) ** 2 * dt * given_rate[node]
                             + f * f * (3 - 2 * f) * given_angle[node + 1] + f * f * (f - 1) * dt * slope)  # fmt: skip
                    v[ik] = given_rate[node] + f * (slope - given_rate[node])
            th = q[ik]
            sn, cs = np.sin(th), np.cos(th)
            # ---- kinematics of the tip and first moments
            sa, ca = np.sin(q[0]), np.cos(q[0])
            angle = 0.0
            rho, zeta, mrho = 0.0, 0.0, 0.0
            for j in range(m):
                angle += q[j + 1]
                pj = pitch[j] + angle
                sp, cpj = np.sin(pj), np.cos(pj)
                sine[j], cosine[j] = sp, cpj
                along = length[j] + (extra_a if j == m - 1 else 0.0)
                across = extra_b if j == m - 1 else 0.0
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
            gz -= GRAVITY
            by = base[node, 1] + (velocity[node, 1] + 0.5 * acceleration[node, 1] * s) * s
            bz = base[node, 2] + (velocity[node, 2] + 0.5 * acceleration[node, 2] * s) * s
            cy = by + rho * hy + zeta * uy
            cz = bz + rho * hz + zeta * uz
            jac[0, 0], jac[0, 1], jac[0, 2] = rho * ax, rho * ay, rho * az
            rhs[0] = mrho * (ax * gx + ay * gy + az * gz)
            gh, gu = hx * gx + hy * gy + hz * gz, ux * gx + uy * gy + uz * gz
            trho, tzeta, grho, gzeta = 0.0, 0.0, 0.0, 0.0
            for j in range(m - 1, -1, -1):
                sp, cpj = sine[j], cosine[j]
                along = length[j] + (extra_a if j == m - 1 else 0.0)
                across = extra_b if j == m - 1 else 0.0
                trho += -along * sp - across * cpj
                tzeta += -along * cpj + across * sp
                grho -= moment[j] * sp
                gzeta -= moment[j] * cpj
                jac[j + 1, 0] = trho * hx + tzeta * ux
                jac[j + 1, 1] = trho * hy + tzeta * uy
                jac[j + 1, 2] = trho * hz + tzeta * uz
                rhs[j + 1] = grho * gh + gzeta * gu
            # ---- joints
            for r in range(size):
                for c in range(size):
                    a[r, c] = mass[r, c] if (r < nf and c < nf) else 0.0
            for j in range(nf):
                k_joint = kj * (ratio if j == 0 else 1.0)
                torque, slope = joint_spring(q[j], k_joint, p[JB], p[JH], p[JHP])
                if p[JM] > 0.0:
                    torque = (1.0 - p[JM]) * torque + p[JM] * k_joint * p[JMY] * jam_z[j]
                    slope = (1.0 - p[JM]) * slope + p[JM] * k_joint * p[JMY] * dahl_slope(jam_z[j], v[j], p[JMY])
                if p[JC] > 0.0:
                    torque -= p[JC] * k_joint * creep_z[j]
                if p[JF] > 0.0:
                    level = p[JF] * stribeck(v[j], p[JFS], JOINT_STRIBECK)
                    torque += level * friction_z[j]
                    slope += level * dahl_slope(friction_z[j], v[j], FRICTION_BREAKAWAY)
                c_joint = cj + (0.05 if settle else 0.0)
                rhs[j] -= torque + c_joint * v[j] + 0.5 * h * slope * v[j]
                a[j, j] += 0.5 * h * c_joint + 0.25 * h * h * slope
            # ---- contact
            gap = -sn * (cy - hinge_y) + cs * (cz - hinge_z) - surface - radius
            lever = -cs * (cy - hinge_y) - sn * (cz - hinge_z)
            gap_rate, slip_y, slip_x = -sn * vby + cs * vbz, -(cs * vby + sn * vbz), vbx
            own = 0.0
            depth = -gap
            # the tip rolls: friction acts in the middle of the pad's compression, which is a little less than a radius below
            # the tip's centre and as much below the key's surface
            sunk = 0.5 * max(depth, 0.0)
            arm = radius - sunk
            roll_y, roll_x = -arm * ax, -arm * (ay * cs + az * sn)
            spin_y, spin_x = -arm * ux, -arm * (uy * cs + uz * sn)
            for j in range(nf):
                jn[j] = -sn * jac[j, 1] + cs * jac[j, 2]
                jt[j] = -(cs * jac[j, 1] + sn * jac[j, 2]) + (spin_y if j == 0 else roll_y)
                jx[j] = jac[j, 0] + (spin_x if j == 0 else roll_x)
                own += jn[j] * v[j]
                slip_y += jt[j] * v[j]
                slip_x += jx[j] * v[j]
            jn[ik], jt[ik] = lever, sunk - surface
            own += lever * v[ik]
            slip_y += jt[ik] * v[ik]
            gap_rate += own
            touching = depth - 0.5 * h * own > 0.0
            force = 0.0
            if touching:
                spring, k_pad = pad_spring(max(depth, 0.0), kp, p[PSO])
                if depth < 0.0:
                    spring = k_pad * depth
                c_pad = cp * (k_pad / kp if p[PSO] > 0.0 else 1.0)
                force = spring - c_pad * gap_rate
                if force - 0.5 * h * k_pad * own <= 0.0:
                    touching, force = False, 0.0
            if touching:
                grip = mu * stribeck(np.hypot(slip_y, slip_x), p[TSW], TIP_STRIBECK) / (1.0 + p[TSW])
                limit = grip * max(force, 0.0)
                k_t, d_t = BRISTLE, BRISTLE_DAMPING
                ty = -(k_t * bristle_y + d_t * slip_y)
                tx = -(k_t * bristle_x + d_t * slip_x)
                ahead_y, ahead_x = ty - 0.5 * h * k_t * slip_y, tx - 0.5 * h * k_t * slip_x
                pull = np.sqrt(ahead_y * ahead_y + ahead_x * ahead_x)
                sliding = pull > limit
                dir_y, dir_x = 0.0, 0.0
                if sliding:
                    dir_y, dir_x = ahead_y / pull, ahead_x / pull
                    ty, tx = limit * dir_y, limit * dir_x
                stiff = 0.25 * h * h * k_pad + 0.5 * h * c_pad
                fresh = force - 0.5 * h * k_pad * own
                for r in range(size):
                    # normal force acts along jn; when sliding its friction follows it
                    row = jn[r]
                    value = jn[r] * fresh + jt[r] * ty + jx[r] * tx
                    if sliding:
                        along = grip * (dir_y * jt[r] + dir_x * jx[r])
                        row += along
                        value -= along * 0.5 * h * k_pad * own
                    rhs[r] = value + (rhs[r] if r < nf else 0.0)
                    for c in range(size):
                        a[r, c] += row * stiff * jn[c]
                    if not sliding:
                        w = 0.25 * h * h * k_t + 0.5 * h * d_t
                        rhs[r] -= 0.5 * h * k_t * (jt[r] * slip_y + jx[r] * slip_x)
                        for c in range(size):
                            a[r, c] += w * (jt[r] * jt[c] + jx[r] * jx[c])
            else:
                for r in range(nf, size):
                    rhs[r] = 0.0
            # ---- key and hammer
            if not held:
                torque = kk * th + ck * v[ik] + p[KP]
                slope, drag = kk, ck
                if p[KF] > 0.0:
                    level = p[KF] * stribeck(v[ik], p[KFS], KEY_STRIBECK)
                    torque += level * key_z
                    slope += level * dahl_slope(key_z, v[ik], KEY_BREAKAWAY)
                if p[LO] > 0.0:
                    torque += let_off(th, v[ik], p[LO], p[LOA], p[LOW])
                ahead = th + 0.5 * h * v[ik]
                if ahead > top:
                    push, k_felt = felt(max(th - top, 0.0) * key[10], k_stop, p[FE])
                    total = push * key[10] + key[7] * v[ik]
                    if th < top:
                        total = k_felt * r2 * (th - top) + key[7] * v[ik]
                    if total + 0.5 * h * k_felt * r2 * v[ik] > 0.0:
                        torque += total
                        slope += k_felt * r2
                        drag += key[7]
                elif ahead < 0.0:
                    total = key[8] * th + key[9] * v[ik]
                    if total + 0.5 * h * key[8] * v[ik] < 0.0:
                        torque += total
                        slope += key[8]
                        drag += key[9]
                if settle:
                    torque += 0.5 * v[ik]
                    drag += 0.5
                a[ik, ik] += inertia + 0.5 * h * drag + 0.25 * h * h * slope
                rhs[ik] -= torque + 0.5 * h * slope * v[ik]
                if hammer:
                    stretch, closing = q[ik] - q[ih], v[ik] - v[ih]
                    a[ih, ih] += hammer_inertia
                    rhs[ih] = -hammer_weight
                    hold = jack(th, p[HE])
                    kh, ch = hold * p[HK] * r2, hold * HAMMER_DAMPING * r2
                    if stretch + 0.5 * h * closing > 0.0:
                        push_h = kh * stretch + ch * closing
                        if push_h + 0.5 * h * kh * closing > 0.0:
                            w = 0.25 * h * h * kh + 0.5 * h * ch
                            full = push_h + 0.5 * h * kh * closing
                            rhs[ik] -= full
                            rhs[ih] += full
                            a[ik, ik] += w
                            a[ih, ih] += w
                            a[ik, ih] -= w
                            a[ih, ik] -= w
                    over = q[ih] - HAMMER_STOP * key[5]
                    if over + 0.5 * h * v[ih] > 0.0:
                        rhs[ih] -= key[6] * over + key[7] * v[ih] + 0.5 * h * key[6] * v[ih]
                        a[ih, ih] += 0.25 * h * h * key[6] + 0.5 * h * key[7]
                    if settle:
                        rhs[ih] -= 0.5 * v[ih]
                        a[ih, ih] += 0.25 * h
            if sub == 0 and not settle:
                # the force at the node itself, where the base is half a step behind
                at_node = depth + s * (-sn * velocity[node, 1] + cs * velocity[node, 2])
                shown = 0.0
                if at_node > 0.0:
                    shown, k_node = pad_spring(at_node, kp, p[PSO])
                    shown -= cp * (k_node / kp if p[PSO] > 0.0 else 1.0) * gap_rate
                out[2, i], out[3, i] = max(shown, 0.0), lever
                if touching and force > 0.0:
                    out[3, i] += jt[ik] * ty / force
            _solve(a, rhs, size)
            # ---- update
            moved = 0.0
            for j in range(size):
                step = h * (v[j] + 0.5 * h * rhs[j])
                if j < nf and not settle:
                    if p[JF] > 0.0:
                        friction_z[j] = dahl_advance(friction_z[j], step, FRICTION_BREAKAWAY)
                    if p[JM] > 0.0:
                        jam_z[j] = dahl_advance(jam_z[j], step, p[JMY])
                    if p[JC] > 0.0:
                        creep_z[j] += (q[j] + 0.5 * step - creep_z[j]) * (1.0 - np.exp(-h / p[JCT]))
                if j == ik and p[KF] > 0.0 and not settle:
                    key_z = dahl_advance(key_z, step, KEY_BREAKAWAY)
                q[j] += step
                v[j] += h * rhs[j]
                if j == ih and q[ik] > p[HE] > q[ih] and v[ih] < 0.0:
                    v[ih] = 0.0  # the check holds a hammer that falls back before the jack is under it again
                moved = max(moved, abs(v[j]))
            if touching:
                new_y, new_x = slip_y, slip_x
                for j in range(size):
                    new_y += 0.5 * h * jt[j] * rhs[j]
                    new_x += 0.5 * h * jx[j] * rhs[j]
                bristle_y += h * new_y
                bristle_x += h * new_x
                if sliding:
                    bristle_y, bristle_x = -limit * dir_y / BRISTLE, -limit * dir_x / BRISTLE
            else:
                bristle_y, bristle_x = 0.0, 0.0
            if settle:
                for j in range(size):
                    v[j] *= 0.5
                if held:
                    v[ik] = 0.0
            elif not moved < 1e4:
                return 1
            quiet = 0
            if not settle:
                if moved < 0.02 and abs(velocity[node, 2]) < 5e-4:
                    quiet = 1  # nothing moves
                elif gap > 0.001 and abs(v[ik]) < 0.002:
                    quiet = 2  # the finger is in the air
        if settle and i == -1:
            for j in range(nf + 2):
                v[j] = 0.0
            for j in range(nf):
                creep_z[j] = 0.0
    return 0


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator,unused-ignore]
def drive_key(
    dt: float, force: Array, lever: Array, resting: float, key: Array, p: Array, substeps: int, out: Array
) -> int:
    """The key alone, driven by a given contact force (n,) N on a grid of ``dt`` at levers (n,) m. Fills angle and rate.

    It starts at ``resting`` rad where friction holds it.
    """
    steps = force.size
    inertia, kk, ck = key[2] * p[IK], key[3] * p[KK], key[4] * p[CK]
    top = key[5] - p[FT] / key[10]
    r2 = key[10] * key[10]
    k_stop = key[6] / r2
    hammer = p[HM] > 0.0
    hammer_inertia, hammer_weight = p[HM] * r2, p[HM] * p[HW] * key[10]
    th, w, qh, wh, key_z = 0.0, 0.0, 0.0, 0.0, 0.0
    if p[KP] > 0.0 or hammer:
        th = qh = -(p[KP] + (hammer_weight if hammer else 0.0)) / (key[8] + kk)
    if p[KF] > 0.0:
        th = qh = max(th, resting)
        key_z = held_by_friction(kk * th + p[KP] + (hammer_weight if hammer else 0.0), p[KF] * (1.0 + p[KFS]))
    h = dt / substeps
    for i in range(steps):
        out[0, i], out[1, i] = th, w
        after = min(i + 1, steps - 1)
        for sub in range(substeps):
            f = (sub + 0.5) / substeps
            push = (force[i] + f * (force[after] - force[i])) * (lever[i] + f * (lever[after] - lever[i]))
            torque = kk * th + ck * w + p[KP] - push
            slope, drag = kk, ck
            if p[KF] > 0.0:
                level = p[KF] * stribeck(w, p[KFS], KEY_STRIBECK)
                torque += level * key_z
                slope += level * dahl_slope(key_z, w, KEY_BREAKAWAY)
            if p[LO] > 0.0:
                torque += let_off(th, w, p[LO], p[LOA], p[LOW])
            ahead = th + 0.5 * h * w
            if ahead > top:
                stop, k_felt = felt(max(th - top, 0.0) * key[10], k_stop, p[FE])
                total = stop * key[10] + key[7] * w
                if th < top:
                    total = k_felt * r2 * (th - top) + key[7] * w
                if total + 0.5 * h * k_felt * r2 * w > 0.0:
                    torque += total
                    slope += k_felt * r2
                    drag += key[7]
            elif ahead < 0.0:
                total = key[8] * th + key[9] * w
                if total + 0.5 * h * key[8] * w < 0.0:
                    torque += total
                    slope += key[8]
                    drag += key[9]
            a11 = inertia + 0.5 * h * drag + 0.25 * h * h * slope
            b1 = -(torque + 0.5 * h * slope * w)
            if hammer:
                a22, b2, a12 = hammer_inertia, -hammer_weight, 0.0
                stretch, closing = th - qh, w - wh
                hold = jack(th, p[HE])
                kh, ch = hold * p[HK] * r2, hold * HAMMER_DAMPING * r2
                if stretch + 0.5 * h * closing > 0.0 and kh * stretch + ch * closing + 0.5 * h * kh * closing > 0.0:
                    weight = 0.25 * h * h * kh + 0.5 * h * ch
                    full = kh * stretch + ch * closing + 0.5 * h * kh * closing
                    a11 += weight
                    a22 += weight
                    a12 = -weight
                    b1 -= full
                    b2 += full
                over = qh - HAMMER_STOP * key[5]
                if over + 0.5 * h * wh > 0.0:
                    b2 -= key[6] * over + key[7] * wh + 0.5 * h * key[6] * wh
                    a22 += 0.25 * h * h * key[6] + 0.5 * h * key[7]
                det = a11 * a22 - a12 * a12
                alpha, beta = (a22 * b1 - a12 * b2) / det, (a11 * b2 - a12 * b1) / det
                qh += h * (wh + 0.5 * h * beta)
                wh += h * beta
                if th > p[HE] > qh and wh < 0.0:
                    wh = 0.0
            else:
                alpha = b1 / a11
            step = h * (w + 0.5 * h * alpha)
            if p[KF] > 0.0:
                key_z = dahl_advance(key_z, step, KEY_BREAKAWAY)
            th += step
            w += h * alpha
        if not abs(w) < 1e4:
            return 1
    return 0
