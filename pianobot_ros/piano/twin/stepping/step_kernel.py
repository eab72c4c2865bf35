"""Compiled: what the mechanical laws add to a step of the MuJoCo twin. The laws themselves are
those of the reduced strike model (``strike_laws.py``).

Springs are explicit and dampers implicit. So a law adds its torque to the applied forces and, in
the light finger joints, as much armature as an explicit spring of its stiffness needs, as the
nominal springs have it too (``stable_armature``). Nothing here allocates.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pianobot_ros.cell.arrays import Array
from pianobot_ros.piano.twin.reduced import strike_laws as law
from pianobot_ros.piano.twin.reduced.strike_laws import (
    carried,
    dahl_advance,
    dahl_slope,
    felt,
    friction_advance,
    joint_spring,
    let_off_of,
    preload,
    rail_felt,
    relaxed,
    stable_armature,
    stribeck,
)

Index = NDArray[np.int64]

HAMMER_STOP = 1.3  # of the key's largest angle: where the rail stops the hammer
QPOS, DOF, JOINT, SIDEWAYS = range(4)  # columns of the joints' table
TOUCH = 2  # third column of the keys' table, after these: the sensor of the force on it
TIP, KEY, FIRST, PAST = range(4)  # columns of the contacts' table: tip's geom, key, rows of joints
# Memory of a joint: states of the laws, last angle, state of the creep's slow branch.
FRICTION, JAM, CREEP, ANGLE, SLOW = range(5)
HAMMER_ANGLE, SPEED = 1, 2  # memory of a key: [friction, hammer's angle and rate, last angle]
PRELOAD, REST, DRY = 8, 9, 10  # of a key's mechanism: N m, rad, N m
CREEPING = 1e-6  # rad/s: MuJoCo's dry friction lets a key that it holds go by less
DEPTH, ACROSS, ALONG, UP = range(4)  # memory of a contact: compression, tip's place


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator,unused-ignore]
def act_on_joints(
    p: Array,
    h: float,
    implicit: float,
    damping: float,
    joints: Index,
    q: Array,
    v: Array,
    stiffness: Array,
    applied: Array,
    armature: Array,
    memory: Array,
    settling: bool,
) -> None:
    """Laws of the finger joints: what their torque differs by from the nominal spring's. While
    ``settling`` they remember nothing, so that what they hold is counted from rest under gravity.
    ``implicit`` s: armature for a damper of 1 (``TwinModel.implicit``).
    """
    jamming, yields = p[law.JAMMING_HYSTERESIS], p[law.JAMMING_YIELD]
    quick, slow = relaxed(h, p[law.JOINT_CREEP_TIME], p[law.JOINT_CREEP_SPREAD])
    for j in range(joints.shape[0]):
        x, w, k = q[joints[j, QPOS]], v[joints[j, DOF]], stiffness[joints[j, JOINT]]
        own = memory[j]
        step = 0.0 if settling else x - own[ANGLE]
        if p[law.JOINT_FRICTION] > 0.0:
            own[FRICTION] = friction_advance(
                own[FRICTION],
                step,
                p[law.JOINT_FRICTION_BREAKAWAY],
                p[law.JOINT_FRICTION_CREEP],
                h,
            )
        if jamming > 0.0:
            own[JAM] = dahl_advance(own[JAM], step, yields)
        if p[law.JOINT_CREEP] > 0.0 and not settling:
            own[CREEP] += (own[ANGLE] + 0.5 * step - own[CREEP]) * quick
            own[SLOW] += (own[ANGLE] + 0.5 * step - own[SLOW]) * slow
        own[ANGLE] = x
        torque, slope = joint_spring(
            x, k, p[law.JOINT_BACKLASH], p[law.JOINT_HARDENING], p[law.JOINT_HARDENING_POWER]
        )
        if jamming > 0.0:
            torque = (1.0 - jamming) * torque + jamming * k * yields * own[JAM]
            slope = (1.0 - jamming) * slope + jamming * k * yields * dahl_slope(own[JAM], w, yields)
        if p[law.JOINT_CREEP] > 0.0:
            torque -= p[law.JOINT_CREEP] * k * 0.5 * (own[CREEP] + own[SLOW])
        if p[law.JOINT_FRICTION] > 0.0:
            level = p[law.JOINT_FRICTION] * stribeck(
                w, p[law.JOINT_FRICTION_STATIC], law.JOINT_STRIBECK
            )
            torque += level * own[FRICTION]
            slope += level * dahl_slope(own[FRICTION], w, p[law.JOINT_FRICTION_BREAKAWAY])
        applied[joints[j, DOF]] = k * x - torque
        if joints[j, SIDEWAYS]:
            slope -= k
        armature[joints[j, DOF]] = implicit * damping + stable_armature(slope, damping, h)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator,unused-ignore]
def act_on_keys(
    p: Array,
    h: float,
    mechanism: Array,
    keys: Index,
    q: Array,
    v: Array,
    applied: Array,
    touch: Array,
    memory: Array,
) -> None:
    """Laws of the keys. ``mechanism``: largest angle, stop's stiffness N/m and damping N m s/rad,
    radius of the stop, stiffness N/m and damping N s/m at rest, power of the stops' felt (1: they
    are MuJoCo's own springs) and its force, preload and the angle up to which the rest stop
    reaches, dry friction.

    A key that nothing touches and that friction holds gets no torque: it would be held as well, but
    MuJoCo lets only keys sleep on which nothing acts.
    """
    largest, k_stop, c_stop, r = mechanism[0], mechanism[1], mechanism[2], mechanism[3]
    k_rest, c_rest, power, level = mechanism[4], mechanism[5], mechanism[6], mechanism[7]
    top = largest - p[law.FELT_THICKNESS] / r
    for i in range(keys.shape[0]):
        th, w, own = q[keys[i, QPOS]], v[keys[i, DOF]], memory[i]
        torque = preload(th, p[law.KEY_PRELOAD], p[law.KEY_PRELOAD_FADE]) + mechanism[PRELOAD]
        if p[law.KEY_FRICTION] > 0.0:
            own[FRICTION] = friction_advance(
                own[FRICTION],
                th - own[ANGLE],
                p[law.KEY_FRICTION_BREAKAWAY],
                p[law.KEY_FRICTION_CREEP],
                h,
            )
            torque += (
                p[law.KEY_FRICTION]
                * stribeck(w, p[law.KEY_FRICTION_STATIC], law.KEY_STRIBECK)
                * own[FRICTION]
            )
        own[ANGLE] = th
        if p[law.LET_OFF] > 0.0:
            elastic, dry, _ = let_off_of(p, th, w)
            torque += elastic + dry
        if power > 1.0:
            steep = power + p[law.FELT_EXPONENT] - 1.0
            bed, _, _ = rail_felt((th - top) * r, w * r, k_stop, c_stop / (r * r), steep, level)
            rest, _, _ = rail_felt((mechanism[REST] - th) * r, -w * r, k_rest, c_rest, power, level)
            torque += (bed - rest) * r
        elif p[law.FELT_EXPONENT] != 1.0 and th > top:
            x = (th - top) * r
            push, _ = felt(x, k_stop, p[law.FELT_EXPONENT])
            torque += max(push * r + c_stop * w, 0.0) - max(k_stop * x * r + c_stop * w, 0.0)
        if p[law.HAMMER] > 0.0:
            torque += _hammer(p, h, th, w, largest, k_stop * r * r, c_stop, r * r, own)
        if abs(torque) <= mechanism[DRY] and abs(w) < CREEPING and touch[keys[i, TOUCH]] == 0.0:
            torque = 0.0
        applied[keys[i, DOF]] = 0.0 - torque  # not -0.0, which would keep the key awake


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator,unused-ignore]
def _hammer(
    p: Array,
    h: float,
    th: float,
    w: float,
    largest: float,
    k_stop: float,
    c_stop: float,
    r2: float,
    own: Array,
) -> float:
    """One step of the hammer, linearly implicit; returns its torque on the key."""
    qh, wh = own[HAMMER_ANGLE], own[SPEED]
    a, b = p[law.HAMMER] * r2, -p[law.HAMMER] * p[law.HAMMER_WEIGHT] * math.sqrt(r2)
    follows, push = carried(p, th, w, qh, wh, r2, h)
    a += follows
    b += push
    over = qh - HAMMER_STOP * largest
    if over + 0.5 * h * wh > 0.0:
        b -= k_stop * over + c_stop * wh + 0.5 * h * k_stop * wh
        a += 0.25 * h * h * k_stop + 0.5 * h * c_stop
    beta = b / a
    own[HAMMER_ANGLE] = qh + h * (wh + 0.5 * h * beta)
    own[SPEED] = wh + h * beta
    if th > p[law.HAMMER_ESCAPE] > own[HAMMER_ANGLE] and own[SPEED] < 0.0:
        own[SPEED] = 0.0  # the check holds a hammer that falls back before the jack is under it
    torque = float(push - follows * beta)
    return torque if push < 0.0 else max(torque, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator,unused-ignore]
def act_on_tips(
    p: Array,
    h: float,
    contacts: Index,
    joints: Index,
    places: Array,
    radius: Array,
    v: Array,
    angle: Array,
    rate: Array,
    xpos: Array,
    xaxis: Array,
    nominal: Array,
    friction: float,
    solref: Array,
    grip: Array,
    memory: Array,
) -> None:
    """Laws of the fingertips: stiffness and damping of each contact's spring (``solref``), its
    friction (``grip``).

    MuJoCo knows the tips' places of the last step only, so the compression is extrapolated by a
    step. ``places`` of the keys: hinge y and z, height of the surface; ``angle`` and ``rate`` of
    the keys at those places.
    """
    for i in range(contacts.shape[0]):
        tip, key, own = contacts[i, TIP], contacts[i, KEY], memory[i]
        sn, cs = math.sin(angle[key]), math.cos(angle[key])
        y, z = xpos[tip, 1] - places[key, 0], xpos[tip, 2] - places[key, 1]
        depth = sn * y - cs * z + places[key, 2] + radius[i]
        ahead = 2.0 * depth - own[DEPTH]
        vx, vy = (xpos[tip, 0] - own[ACROSS]) / h, (xpos[tip, 1] - own[ALONG]) / h
        vz = (xpos[tip, 2] - own[UP]) / h
        own[DEPTH], own[ACROSS], own[ALONG] = depth, xpos[tip, 0], xpos[tip, 1]
        own[UP] = xpos[tip, 2]
        if p[law.PAD_SOFTENING] > 0.0:
            x = max(ahead, 1e-6)
            whole = x + p[law.PAD_SOFTENING]
            solref[i, 0] = nominal[i, 0] * x / whole
            solref[i, 1] = nominal[i, 1] * x * (x + 2.0 * p[law.PAD_SOFTENING]) / (whole * whole)
        if p[law.TIP_SLIP_WEAKENING] > 0.0:
            wx, wy, wz = 0.0, 0.0, 0.0
            for j in range(contacts[i, FIRST], contacts[i, PAST]):
                turn = v[joints[j, DOF]]
                axis = xaxis[joints[j, JOINT]]
                wx, wy, wz = wx + turn * axis[0], wy + turn * axis[1], wz + turn * axis[2]
            sunk = 0.5 * max(depth, 0.0)
            ny, nz = sn * (radius[i] - sunk), -cs * (radius[i] - sunk)  # to the contact
            cx, cy, cz = vx + wy * nz - wz * ny, vy - wx * nz, vz + wx * ny
            surface = (places[key, 2] - sunk) * rate[key]
            slip = math.hypot(cs * cy + sn * cz + surface, cx)
            share = stribeck(slip, p[law.TIP_SLIP_WEAKENING], p[law.TIP_SLIP_SPEED]) / (
                1.0 + p[law.TIP_SLIP_WEAKENING]
            )
            grip[i, 0] = grip[i, 1] = friction * share
