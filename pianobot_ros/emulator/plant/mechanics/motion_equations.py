# ruff: noqa: PLR0912, PLR0915  (compiled code: flat functions over plain numbers are what the
# compiler turns into fast code)
"""Equations of motion of fingers and keys, and their integrator, compiled.

A finger is a chain of phalanges in a plane that turns about the wrist's vertical axis at the
finger's base. With the absolute pitch phi_i of each phalanx as coordinate the chain obeys

    sum_j A_ij cos(phi_i - phi_j) phi_j'' + A_ij sin(phi_i - phi_j) phi_j'^2 = B_i a . d_i + joints
    + contact + abduction

with d_i the direction in which phalanx i moves its end and a gravity minus the base's acceleration.
Integration is the
linearly implicit midpoint rule: everything is evaluated at the predicted midpoint, and the stiff
joint springs and dampers enter the matrix, (M + h/2 C + h^2/4 K) dv = h f. Second order, and stable
for phalanges of a few grams on joints of 100 N m/rad. Contact, keys and wrist are soft on this
scale and are taken at the predicted midpoint.

The stages of a step allocate nothing, here and in the modules beside, so numba need not count the
references to their arrays (`_nrt`): it counts them atomically, for half of the time of a step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.plant.laws.counter_random import normal
from pianobot_ros.emulator.plant.laws.row_layout import (
    ABDUCTION,
    ADHESION,
    ANGLE,
    CHANGE,
    CLEAR,
    COUNT,
    DAMPING_OFF,
    DEEPEST,
    DRAWS,
    FELT_SET,
    FRONT,
    GREASE,
    HEIGHT,
    HEIGHT_AIM,
    INERTIA,
    KEY_INERTIA,
    KEY_RADIUS,
    LEFT,
    LENGTH,
    MOMENT,
    NORMAL,
    PHI,
    RADIUS,
    RATE,
    REACTION,
    REAR,
    REST,
    RIGHT,
    SOUNDING,
    SPEED,
    SPEED_CHANGE,
    STIFFNESS,
    STIFFNESS_OFF,
    SUNK,
    TOP,
    TORQUE,
    TOUCH,
)
from pianobot_ros.emulator.plant.mechanics.finger_joints import joint_torque
from pianobot_ros.emulator.plant.mechanics.key_torque import key_torque, relax_key
from pianobot_ros.emulator.plant.mechanics.physics import GRAVITY, Model, Plant, Simulated, State
from pianobot_ros.emulator.plant.mechanics.touch import (
    ADHESION_REACH,
    ADHESION_TIME,
    TEAR_TIME,
    friction_force,
    normal_force,
)

__all__ = ["advance"]


class BaseMotion(NamedTuple):
    """Position and velocity (3, 3) of each finger's base at the start of a tick; accelerations (2,
    3, 3) at its start and end, linear in between; and the heading, lateral and vertical ``axes``
    (2, 3, 3, 3) of each finger's plane at start and end.
    """

    position: Array
    velocity: Array
    acceleration: Array
    axes: Array


CLEAR_AFTER = 0.03  # s without contact after which the next strike's variation is drawn
SLANT = math.sqrt(0.5)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def advance(
    plant: Simulated, start: float, h: float, steps: int, motion: BaseMotion, events: Array
) -> int:
    """Advance fingers and all keys by ``steps`` steps of ``h`` s. MIDI events (time, on, key,
    contact speed) are appended to ``events`` (n, 4); returns their number.
    """
    model, state, fingers = plant
    base, base_rate, base_acceleration, axes = motion
    ks, cell = state.keys, state.cell
    span = h * steps
    count = 0
    cell[REACTION : REACTION + 3] = 0.0
    point, speed, push = np.empty(3), np.empty(3), np.empty(3)
    frame, turning = np.empty((3, 3)), np.empty((3, 3))
    acceleration = np.empty(3)
    phi, rate, sine, cosine, force, matrix = (
        np.empty(4),
        np.empty(4),
        np.empty(4),
        np.empty(4),
        np.empty(4),
        np.empty((4, 4)),
    )
    for step in range(steps):
        middle = (step + 0.5) * h
        for j in range(12):
            ks[j, TORQUE] = 0.0
            ks[j, NORMAL] = 0.0
        for f in fingers:
            _vary(model.plant, state, f, h)
            for i in range(3):
                a0, a1 = base_acceleration[0, f, i], base_acceleration[1, f, i]
                slope = (a1 - a0) / span
                acceleration[i] = a0 + slope * middle
                speed[i] = base_rate[f, i] + a0 * middle + 0.5 * slope * middle * middle
                point[i] = (
                    base[f, i]
                    + base_rate[f, i] * middle
                    + middle * middle * (0.5 * a0 + slope * middle / 6.0)
                )
                for a in range(3):
                    turning[a, i] = (axes[1, f, a, i] - axes[0, f, a, i]) / span
                    frame[a, i] = axes[0, f, a, i] + turning[a, i] * middle
            point[2] += state.fingers[f, HEIGHT]
            _finger(
                model,
                state,
                f,
                h,
                point,
                speed,
                acceleration,
                frame,
                turning,
                push,
                phi,
                rate,
                sine,
                cosine,
                force,
                matrix,
            )
            for i in range(3):
                cell[REACTION + i] += push[i] / steps
        for j in range(12):
            if (
                ks[j, NORMAL] != 0.0
                or ks[j, TORQUE] != 0.0
                or ks[j, ANGLE] != 0.0
                or ks[j, SPEED] != 0.0
            ):
                count = _key(model, ks, j, h, start + step * h, events, count)
            elif ks[j, FELT_SET] != 0.0 or ks[j, GREASE] != 0.0:
                relax_key(ks, j, h)
    return count


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def _vary(plant: Plant, state: State, f: int, h: float) -> None:
    """Strike-to-strike variation: new values once the finger has been clear of the keys for a
    while.
    """
    fs, cell = state.fingers, state.cell
    if fs[f, CLEAR] < 0.0 or (fs[f, CLEAR] < CLEAR_AFTER <= fs[f, CLEAR] + h):
        n = int(cell[DRAWS])
        cell[DRAWS] = n + 1.0
        fs[f, HEIGHT_AIM] = plant.height_spread * normal(plant.seed, 11, n)
        fs[f, STIFFNESS_OFF] = plant.stiffness_spread * normal(plant.seed, 12, n)
        fs[f, DAMPING_OFF] = plant.damping_spread * normal(plant.seed, 13, n)
        fs[f, CLEAR] = max(fs[f, CLEAR], 0.0)
    fs[f, CLEAR] += h
    fs[f, HEIGHT] += (fs[f, HEIGHT_AIM] - fs[f, HEIGHT]) * (h / 0.02)


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def _finger(
    model: Model,
    state: State,
    f: int,
    h: float,
    base: Array,
    speed: Array,
    acceleration: Array,
    frame: Array,
    turning: Array,
    push: Array,
    phi: Array,
    rate: Array,
    sine: Array,
    cosine: Array,
    force: Array,
    matrix: Array,
) -> None:
    """One step of finger ``f``; ``push`` becomes the contact force on it (base frame)."""
    plant, hand, fs = model.plant, model.hand, state.fingers
    n = int(hand[f, COUNT])
    for i in range(n):
        phi[i] = fs[f, PHI + i] + 0.5 * h * fs[f, RATE + i]
        rate[i] = fs[f, RATE + i] + 0.5 * fs[f, CHANGE + i]
        sine[i], cosine[i] = math.sin(phi[i]), math.cos(phi[i])
    psi = fs[f, ABDUCTION] + 0.5 * h * fs[f, ABDUCTION + 1]
    psi_rate = fs[f, ABDUCTION + 1] + 0.5 * fs[f, ABDUCTION + 2]
    cp, sp = math.cos(psi), math.sin(psi)
    # The plane's axes after abduction: heading, lateral = d heading / d psi, vertical.
    hx, hy, hz = (
        cp * frame[0, 0] + sp * frame[1, 0],
        cp * frame[0, 1] + sp * frame[1, 1],
        cp * frame[0, 2] + sp * frame[1, 2],
    )
    lx, ly, lz = (
        cp * frame[1, 0] - sp * frame[0, 0],
        cp * frame[1, 1] - sp * frame[0, 1],
        cp * frame[1, 2] - sp * frame[0, 2],
    )
    zx, zy, zz = frame[2, 0], frame[2, 1], frame[2, 2]
    fx, fy, fz, roll, twist = _contact(
        model,
        state,
        f,
        h,
        n,
        base,
        speed,
        turning,
        sine,
        cosine,
        rate,
        psi_rate,
        (hx, hy, hz),
        (lx, ly, lz),
        (zx, zy, zz),
    )
    push[0], push[1], push[2] = fx, fy, fz
    # What acts on every gram: gravity minus the base's acceleration, along the plane's axes.
    ax, ay, az = -acceleration[0], -acceleration[1], -GRAVITY - acceleration[2]
    a_head, a_up, a_side = (
        ax * hx + ay * hy + az * hz,
        ax * zx + ay * zy + az * zz,
        ax * lx + ay * ly + az * lz,
    )
    f_head, f_up = fx * hx + fy * hy + fz * hz, fx * zx + fy * zy + fz * zz
    f_side = fx * lx + fy * ly + fz * lz

    reach, swing, turn_inertia, turn_moment = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        total, along = 0.0, 0.0
        for j in range(n):
            same = cosine[i] * cosine[j] + sine[i] * sine[j]
            cross = sine[i] * cosine[j] - cosine[i] * sine[j]
            matrix[i, j] = hand[f, INERTIA + 4 * i + j] * same
            total -= hand[f, INERTIA + 4 * i + j] * cross * rate[j] * rate[j]
            along += hand[f, INERTIA + 4 * i + j] * cosine[j]
        pull = hand[f, MOMENT + i] * (-sine[i] * a_head - cosine[i] * a_up)
        tip = hand[f, LENGTH + i] * (-sine[i] * f_head - cosine[i] * f_up)
        force[i] = total + pull + tip - psi_rate * psi_rate * sine[i] * along
        turn_inertia += cosine[i] * along
        swing -= 2.0 * sine[i] * rate[i] * along
        reach += hand[f, LENGTH + i] * cosine[i]
        turn_moment += hand[f, MOMENT + i] * cosine[i]
    if (
        plant.tip_offset != 0.0
    ):  # the tip's offset across the last phalanx (see _contact) has a lever of its own
        if plant.tip_offset_law == 0:
            force[n - 1] -= plant.tip_offset * (cosine[n - 1] * f_head - sine[n - 1] * f_up)
        elif plant.tip_offset_law == 1:  # along it
            force[n - 1] -= plant.tip_offset * (sine[n - 1] * f_head + cosine[n - 1] * f_up)
        elif plant.tip_offset_law == 3:  # half way between
            lever = plant.tip_offset * SLANT
            force[n - 1] -= lever * (cosine[n - 1] * f_head - sine[n - 1] * f_up)
            force[n - 1] -= lever * (sine[n - 1] * f_head + cosine[n - 1] * f_up)
    # Friction acts in the middle of the pad's compression, below the tip's axis: it turns the last
    # phalanx and the finger.
    force[n - 1] += roll
    k = fs[f, STIFFNESS] * (1.0 + fs[f, STIFFNESS_OFF])
    c = plant.joint_damping * (1.0 + fs[f, DAMPING_OFF])
    for i in range(n):
        before = phi[i - 1] if i > 0 else 0.0
        before_rate = rate[i - 1] if i > 0 else 0.0
        e = phi[i] - before - hand[f, REST + i]
        torque, kt, ct = joint_torque(plant, fs, f, i, k, c, e, rate[i] - before_rate, h)
        stiff = 0.5 * h * ct + 0.25 * h * h * kt
        torque += 0.5 * ct * (fs[f, CHANGE + i] - (fs[f, CHANGE + i - 1] if i > 0 else 0.0))
        force[i] += torque
        matrix[i, i] += stiff
        if i > 0:
            force[i - 1] -= torque
            matrix[i - 1, i - 1] += stiff
            matrix[i, i - 1] -= stiff
            matrix[i - 1, i] -= stiff
    # Cholesky, in place.
    for i in range(n):
        for j in range(i):
            for m in range(j):
                matrix[i, j] -= matrix[i, m] * matrix[j, m]
            matrix[i, j] /= matrix[j, j]
            matrix[i, i] -= matrix[i, j] * matrix[i, j]
        matrix[i, i] = math.sqrt(matrix[i, i])
    for i in range(n):
        x = h * force[i]
        for j in range(i):
            x -= matrix[i, j] * force[j]
        force[i] = x / matrix[i, i]
    for i in range(n - 1, -1, -1):
        x = force[i]
        for j in range(i + 1, n):
            x -= matrix[j, i] * force[j]
        force[i] = x / matrix[i, i]
    for i in range(n):
        old = fs[f, RATE + i]
        fs[f, RATE + i] = old + force[i]
        fs[f, PHI + i] += h * (old + 0.5 * force[i])
        fs[f, CHANGE + i] = force[i]
    # Abduction: a hinge about the vertical axis with its own spring.
    ka = k * plant.abduction_ratio
    torque = (
        reach * f_side
        + twist
        + turn_moment * a_side
        - ka * psi
        - c * fs[f, ABDUCTION + 1]
        - swing * psi_rate
    )
    change = h * torque / (turn_inertia + 0.5 * h * c + 0.25 * h * h * ka)
    fs[f, ABDUCTION] += h * (fs[f, ABDUCTION + 1] + 0.5 * change)
    fs[f, ABDUCTION + 1] += change
    fs[f, ABDUCTION + 2] = change


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def _contact(
    model: Model,
    state: State,
    f: int,
    h: float,
    n: int,
    base: Array,
    speed: Array,
    turning: Array,
    sine: Array,
    cosine: Array,
    rate: Array,
    psi_rate: float,
    head: tuple[float, float, float],
    side: tuple[float, float, float],
    up: tuple[float, float, float],
) -> tuple[float, float, float, float, float]:
    """Force (x, y, z) of all keys on finger ``f``, friction's torque on its last phalanx and about
    its plane's vertical axis; keys get theirs in the state."""
    plant, hand, board = model.plant, model.hand, model.board
    fs, ks = state.fingers, state.keys
    forward, height, forward_rate, height_rate = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        forward += hand[f, LENGTH + i] * cosine[i]
        height -= hand[f, LENGTH + i] * sine[i]
        forward_rate -= hand[f, LENGTH + i] * sine[i] * rate[i]
        height_rate -= hand[f, LENGTH + i] * cosine[i] * rate[i]
    if (
        plant.tip_offset != 0.0
    ):  # a pad glued on beside its place: tip moved across the last phalanx
        if plant.tip_offset_law == 0:
            forward -= plant.tip_offset * sine[n - 1]
            height -= plant.tip_offset * cosine[n - 1]
            forward_rate -= plant.tip_offset * cosine[n - 1] * rate[n - 1]
            height_rate += plant.tip_offset * sine[n - 1] * rate[n - 1]
        elif plant.tip_offset_law == 1:  # glued on along the last phalanx, too far out
            forward += plant.tip_offset * cosine[n - 1]
            height -= plant.tip_offset * sine[n - 1]
            forward_rate -= plant.tip_offset * sine[n - 1] * rate[n - 1]
            height_rate -= plant.tip_offset * cosine[n - 1] * rate[n - 1]
        elif plant.tip_offset_law == 3:  # glued on at 45 degrees: across and along at once
            ahead = plant.tip_offset * SLANT * (cosine[n - 1] - sine[n - 1])
            below = plant.tip_offset * SLANT * (cosine[n - 1] + sine[n - 1])
            forward += ahead
            height -= below
            forward_rate -= below * rate[n - 1]
            height_rate -= ahead * rate[n - 1]
    z = base[2] + forward * head[2] + height * up[2]
    radius = hand[f, RADIUS]
    if plant.tip_offset_law == 2:  # a pad that is too thick all around
        radius += plant.tip_offset
    if z - radius > plant.hinge_z + board[1, TOP] + 0.004:
        return 0.0, 0.0, 0.0, 0.0, 0.0
    x = base[0] + forward * head[0] + height * up[0]
    y = base[1] + forward * head[1] + height * up[1]
    vx = (
        speed[0]
        + forward_rate * head[0]
        + height_rate * up[0]
        + forward * (psi_rate * side[0] + turning[0, 0])
    )
    vy = (
        speed[1]
        + forward_rate * head[1]
        + height_rate * up[1]
        + forward * (psi_rate * side[1] + turning[0, 1])
    )
    vz = (
        speed[2]
        + forward_rate * head[2]
        + height_rate * up[2]
        + forward * (psi_rate * side[2] + turning[0, 2])
    )
    vx += height * turning[2, 0]
    vy += height * turning[2, 1]
    vz += height * turning[2, 2]
    spin = rate[
        n - 1
    ]  # positive: the tip pitches down, its underside moves backwards (against the heading)
    fx, fy, fz, roll, twist = 0.0, 0.0, 0.0, 0.0, 0.0
    held = False
    for j in range(12):
        beside = max(board[j, LEFT] - x, x - board[j, RIGHT], 0.0)
        if beside >= radius:
            fs[f, TOUCH + 2 * j] = 0.0
            fs[f, TOUCH + 2 * j + 1] = 0.0
            continue
        before = max(board[j, FRONT] - y, y - board[j, REAR], 0.0)
        gap2 = beside * beside + before * before
        if gap2 >= radius * radius:
            fs[f, TOUCH + 2 * j] = 0.0
            fs[f, TOUCH + 2 * j + 1] = 0.0
            continue
        theta = ks[j, ANGLE] + 0.5 * h * ks[j, SPEED]
        omega = ks[j, SPEED] + 0.5 * ks[j, SPEED_CHANGE]
        ct, st = math.cos(theta), math.sin(theta)
        ry, rz = y - plant.hinge_y, z - plant.hinge_z
        lever = -ry * ct - rz * st  # distance from the hinge along the key, towards the player
        above = -ry * st + rz * ct  # height above the hinge across the key
        lift = radius - math.sqrt(radius * radius - gap2)
        depth = radius - lift - (above - board[j, TOP]) - ks[j, SUNK]
        sunk = 0.5 * max(
            depth, 0.0
        )  # the skin that sticks or slides is in the middle of the pad's compression
        skin, arm = board[j, TOP] - sunk, radius - sunk
        along_rate = (
            -vy * ct - vz * st - omega * skin
        )  # sliding towards the player, seen from the key
        depth_rate = -(-vy * st + vz * ct + omega * lever)
        if plant.pad_adhesion > 0.0 and depth > -ADHESION_REACH:
            # Grows while the pad is pressed, pulls all the time, and tears as a neck once the pad
            # lifts off.
            stick = fs[f, ADHESION]
            neck = 1.0 if depth > 0.0 else 1.0 + depth / ADHESION_REACH
            pull = -plant.pad_adhesion * stick * neck
            fy += -pull * st
            fz += pull * ct
            ks[j, TORQUE] += pull * lever
            ks[j, NORMAL] += pull
            fs[f, ADHESION] += h * (
                (1.0 - stick) / ADHESION_TIME if depth > 0.0 else -stick / TEAR_TIME
            )
        load = normal_force(plant, depth, depth_rate)
        if plant.pad_mullins > 0.0 and depth > 0.0:
            # rubber is softer below its deepest compression so far (Mullins 1969), and heals slowly
            fs[f, DEEPEST] = max(depth, fs[f, DEEPEST] * (1.0 - h / 8.0))
            load *= 1.0 - plant.pad_mullins * (1.0 - depth / fs[f, DEEPEST])
        if load <= 0.0:
            if depth <= 0.0:
                fs[f, TOUCH + 2 * j] = 0.0
                fs[f, TOUCH + 2 * j + 1] = 0.0
            continue
        held = True
        # Velocity of the pad's skin: the tip's axis plus the last phalanx's spin about it and the
        # finger's about the vertical.
        side_x, up_x = side[1] * ct + side[2] * st, up[1] * ct + up[2] * st
        skin_x = vx - arm * (spin * side_x + psi_rate * up_x)
        skin_along = along_rate - arm * (spin * side[0] + psi_rate * up[0])
        tx, ta = friction_force(plant, fs, f, j, load, skin_x, skin_along, h)
        fx += tx
        fy += -load * st - ta * ct
        fz += load * ct - ta * st
        roll -= arm * (tx * side_x + ta * side[0])
        twist -= arm * (tx * up_x + ta * up[0])
        ks[j, NORMAL] += load
        ks[j, TORQUE] += load * lever - ta * skin
        if plant.loose_hinge > 0.0:
            aim = plant.loose_hinge * math.tanh(load / 1.5)
            ks[j, SUNK] += (aim - ks[j, SUNK]) * (h / 0.004)
    if held:
        fs[f, CLEAR] = 0.0
    return fx, fy, fz, roll, twist


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def _key(model: Model, ks: Array, j: int, h: float, start: float, events: Array, count: int) -> int:
    """One step of key ``j`` under the fingers' torque; appends note events where a trigger is
    passed.
    """
    plant, board = model.plant, model.board
    theta, omega = ks[j, ANGLE], ks[j, SPEED]
    damping = plant.key_damping
    torque, k, c = key_torque(plant, ks, j, theta + 0.5 * h * omega, omega, damping, h)
    inertia = board[j, KEY_INERTIA]
    change = h * (torque + ks[j, TORQUE]) / (inertia + 0.5 * h * c + 0.25 * h * h * k)
    new_rate = omega + change
    new = theta + h * (omega + 0.5 * change)
    if ks[j, NORMAL] == 0.0:
        ks[j, SUNK] *= 1.0 - h / 0.004
        if abs(new) < 1e-9 and abs(new_rate) < 1e-6:
            new, new_rate, change = 0.0, 0.0, 0.0
    ks[j, ANGLE], ks[j, SPEED], ks[j, SPEED_CHANGE] = new, new_rate, change
    on = plant.trigger_on + plant.trigger_offset
    off = plant.trigger_off + 0.6 * plant.trigger_offset
    if plant.trigger_offset_law == 1:  # the whole strip of contacts sits low
        off = plant.trigger_off + plant.trigger_offset
    elif plant.trigger_offset_law == 2:  # worn rubber: closes late, opens early
        off = plant.trigger_off + 1.3 * plant.trigger_offset
    elif plant.trigger_offset_law == 3:  # a contact of its own for note-on alone
        off = plant.trigger_off
    if ks[j, SOUNDING] == 0.0 and theta < on <= new:
        part = (on - theta) / (new - theta)
        count = _event(
            events, count, start + part * h, 1.0, j, board[j, KEY_RADIUS] * (omega + part * change)
        )
        ks[j, SOUNDING] = 1.0
    elif ks[j, SOUNDING] == 1.0 and new < off <= theta:
        part = (theta - off) / (theta - new)
        count = _event(
            events,
            count,
            start + part * h,
            0.0,
            j,
            board[j, KEY_RADIUS] * abs(omega + part * change),
        )
        ks[j, SOUNDING] = 0.0
    return count


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def _event(events: Array, count: int, t: float, on: float, j: int, speed: float) -> int:
    if count < len(events):
        events[count, 0], events[count, 1], events[count, 2], events[count, 3] = t, on, j, speed
        count += 1
    return count
