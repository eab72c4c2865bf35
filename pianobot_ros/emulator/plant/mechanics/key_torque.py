# ruff: noqa: PLR0912, PLR0915  (compiled code: flat functions over plain numbers are what the
# compiler turns into fast code)
"""Torques on a key, compiled: spring, damper, stops, and the effects of action and hinge."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.plant.laws.hand import bouc_wen, dahl_slider, regularised_friction
from pianobot_ros.emulator.plant.laws.key import (
    button_click,
    button_cosine,
    button_triangle,
    coiled_spring,
    hung_hammer,
    knuckle_hammer,
    magnet,
    relaxing_felt,
    slotted_hammer,
    stop_felt,
    wool_felt,
)
from pianobot_ros.emulator.plant.laws.row_layout import (
    FELT_SET,
    GREASE,
    HAMMER,
    HAMMER_SPEED,
    KEY_BRISTLE,
)
from pianobot_ros.emulator.plant.mechanics.physics import Plant

__all__ = ["key_torque", "relax_key"]


COUPLER_STIFFNESS = 72.0  # N m/rad: 1892 N/m of the piano-action paper's Table 2 at 195 mm
STRING_ANGLE = 0.052  # rad at which the hammer's flight ends
ESCAPE_START, ESCAPE_END = 0.038, 0.042  # rad of the key over which the jack leaves the knuckle
KEY_PRESLIDING = 1.2e-3  # rad, Bouc and Wen's friction
KEY_DAHL = 5e-4  # rad over which Dahl's friction turns
FELT_SET_TIME, GREASE_TIME = 2.5, 1.5  # s of recovery
LIGHTEST = 5e-6  # kg m^2
FELT_FORCE = 600.0  # N/m: force at full depth per thickness of the felt
SNAP_ANGLE, SNAP_WIDTH = 0.017, 0.0035  # rad
LET_OFF_START, LET_OFF_TOP, LET_OFF_END = (
    0.024,
    0.033,
    0.0355,
)  # rad: gathers slowly, lets go suddenly


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def key_torque(
    plant: Plant, ks: Array, j: int, theta: float, omega: float, damping: float, h: float
) -> tuple[float, float, float]:
    """Torque on key ``j`` without the finger, and its tangent stiffness and damping."""
    k, c = plant.key_stiffness, damping
    torque = -plant.resting_torque - k * theta - c * omega
    bottom = plant.max_angle
    if plant.felt_set > 0.0:  # the felt stays pressed after it was hit and comes back slowly
        ks[j, FELT_SET] += (
            h * (plant.felt_set - ks[j, FELT_SET]) / 0.15
            if theta > bottom + ks[j, FELT_SET]
            else -h * ks[j, FELT_SET] / FELT_SET_TIME
        )
        bottom += ks[j, FELT_SET]
    if plant.thixotropic_grease > 0.0:  # grease that thickens at rest (Barnes 1997)
        broken = abs(omega) / 0.05
        rest = 1.0 - ks[j, GREASE]  # the state is what motion has broken, 0 for a key long at rest
        ks[j, GREASE] += h * (broken * rest - ks[j, GREASE] / GREASE_TIME)
        torque -= plant.thixotropic_grease * max(1.0 - ks[j, GREASE], 0.0) * omega
        c += plant.thixotropic_grease * max(1.0 - ks[j, GREASE], 0.0)
    if plant.felt_power > 1.0:
        side = 1.0 if theta > bottom else -1.0
        pressed = theta - bottom if theta > bottom else plant.rest_angle - theta
        stiff, lossy = plant.stop_stiffness, plant.stop_damping
        if side < 0.0:
            stiff, lossy = plant.rest_stiffness, plant.rest_damping
        push, kf, cf = stop_felt(
            pressed,
            side * omega,
            stiff,
            lossy,
            plant.felt_power,
            plant.felt_force * plant.reference_radius,
        )
        torque -= side * push
        k += kf
        c += cf
    elif theta > bottom:
        push = plant.stop_stiffness * (theta - bottom) + plant.stop_damping * omega
        if push > 0.0:
            torque -= push
            k += plant.stop_stiffness
            c += plant.stop_damping
    elif theta < plant.rest_angle:
        push = plant.rest_stiffness * (plant.rest_angle - theta) - plant.rest_damping * omega
        if push > 0.0:
            torque += push
            k += plant.rest_stiffness
            c += plant.rest_damping
    if (
        plant.felt_nonlinear > 0.0
    ):  # a felt layer before the rail, after Hunt and Crossley (1975), exponent 2.5
        depth = theta * plant.reference_radius - (
            plant.max_angle * plant.reference_radius - plant.felt_nonlinear
        )
        if plant.felt_nonlinear_law == 1:  # Hertz' contact, without loss
            ratio = min(max(depth, 0.0) / plant.felt_nonlinear, 1.5)
            torque -= plant.reference_radius * FELT_FORCE * plant.felt_nonlinear * ratio**1.5
        elif plant.felt_nonlinear_law == 2:
            ratio = min(max(depth, 0.0) / plant.felt_nonlinear, 1.5)
            push = FELT_FORCE * plant.felt_nonlinear * relaxing_felt(ks, j, ratio, h)
            torque -= plant.reference_radius * push
        elif plant.felt_nonlinear_law == 3:
            ratio = min(max(depth, 0.0) / plant.felt_nonlinear, 1.5)
            push = FELT_FORCE * plant.felt_nonlinear * wool_felt(ratio)
            torque -= plant.reference_radius * push
        elif depth > 0.0:
            ratio = min(depth / plant.felt_nonlinear, 1.5)
            push = (
                FELT_FORCE
                * plant.felt_nonlinear
                * ratio
                * ratio
                * math.sqrt(ratio)
                * (1.0 + 4.0 * omega * plant.reference_radius)
            )
            torque -= plant.reference_radius * max(push, 0.0)
    if plant.key_friction > 0.0 and plant.key_friction_law == 1:
        friction, ratio = regularised_friction(plant.key_friction, omega, 0.01, 0.05, 0.3)
        torque -= friction
        c += ratio
    elif plant.key_friction > 0.0 and plant.key_friction_law == 2:
        z = bouc_wen(ks[j, KEY_BRISTLE], h * omega / KEY_PRESLIDING)
        ks[j, KEY_BRISTLE] = z
        torque -= plant.key_friction * z
        k += 0.5 * plant.key_friction / KEY_PRESLIDING
    elif plant.key_friction > 0.0 and plant.key_friction_law == 3:  # Dahl (1968)
        z = dahl_slider(ks[j, KEY_BRISTLE], h * omega, KEY_DAHL)
        ks[j, KEY_BRISTLE] = z
        torque -= plant.key_friction * z / KEY_DAHL
        k += 0.5 * plant.key_friction / KEY_DAHL
    elif plant.key_friction > 0.0:  # LuGre on the hinge's bushing: 0.4 mrad of presliding
        level = plant.key_friction
        sigma = level / 0.0004
        stribeck = level * (1.0 + 0.3 * math.exp(-((omega / 0.05) ** 2)))
        z = ks[j, KEY_BRISTLE]
        z_new = (z + h * omega) / (1.0 + h * abs(omega) * sigma / stribeck)
        ks[j, KEY_BRISTLE] = z_new
        torque -= sigma * z_new
        torque -= 0.01 * (z_new - z) / h * min(level / 0.02, 1.0)
        k += 0.5 * sigma
    if (
        plant.key_preload > 0.0 and theta > -0.001
    ):  # a felt under tension and a magnet at the rest position
        near = 1.0 / (1.0 + max(theta, 0.0) / 0.006)
        # Smooth at 0, where the rest stop takes the preload.
        if plant.key_preload_law == 1:  # a wound spring
            torque -= plant.key_preload
        elif plant.key_preload_law == 2:
            torque -= magnet(plant.key_preload, theta)
        elif plant.key_preload_law == 3:
            torque -= coiled_spring(plant.key_preload, theta)
        else:
            torque -= plant.key_preload * (0.65 + 0.35 * near * near)
    if plant.let_off > 0.0 and plant.let_off_law == 1:
        torque -= plant.let_off * button_cosine(theta)
    elif plant.let_off > 0.0 and plant.let_off_law == 2:
        torque -= plant.let_off * button_click(theta, omega)
    elif plant.let_off > 0.0 and plant.let_off_law == 3:
        torque -= plant.let_off * button_triangle(theta, omega)
    elif plant.let_off > 0.0 and LET_OFF_START < theta < LET_OFF_END:
        if theta < LET_OFF_TOP:
            rise = (theta - LET_OFF_START) / (LET_OFF_TOP - LET_OFF_START)
            bump = rise * rise * (3.0 - 2.0 * rise)
        else:
            fall = (LET_OFF_END - theta) / (LET_OFF_END - LET_OFF_TOP)
            bump = fall * (2.0 - fall)
        way = 0.6 + 0.4 * math.tanh(
            omega / 0.02
        )  # the jack slips back under the knuckle with little resistance
        torque -= plant.let_off * bump * way
    if plant.magnetic_snap > 0.0:
        x = (theta - SNAP_ANGLE) / SNAP_WIDTH
        torque += (
            -plant.magnetic_snap
            * 1.6487
            * x
            * math.exp(-0.5 * x * x)
            * (1.0 if omega >= 0.0 else -0.5)
        )
    if plant.hammer > 0.0 and plant.hammer_law == 1:
        torque += knuckle_hammer(ks, j, plant.hammer, theta, omega, h)
    elif plant.hammer > 0.0 and plant.hammer_law == 2:
        torque += hung_hammer(ks, j, plant.hammer, theta, omega, h)
    elif plant.hammer > 0.0 and plant.hammer_law == 3:
        torque += slotted_hammer(ks, j, plant.hammer, theta, omega, h)
    elif plant.hammer > 0.0:
        torque += _hammer(plant, ks, j, theta, omega, h)
    return torque, k, c


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def relax_key(ks: Array, j: int, h: float) -> None:
    """What a key at rest forgets in ``h`` s."""
    ks[j, FELT_SET] *= 1.0 - h / FELT_SET_TIME
    ks[j, GREASE] *= 1.0 - h / GREASE_TIME


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def _hammer(plant: Plant, ks: Array, j: int, theta: float, omega: float, h: float) -> float:
    """Advance the hammer of key ``j`` (semi-implicit Euler); the torque it puts on the key."""
    inertia = max(
        plant.hammer, LIGHTEST
    )  # the explicit step needs some mass; a lighter hammer is this one, scaled
    angle, rate = ks[j, HAMMER], ks[j, HAMMER_SPEED]
    engaged = min(max((ESCAPE_END - theta) / (ESCAPE_END - ESCAPE_START), 0.0), 1.0)
    push = COUPLER_STIFFNESS * (theta - angle) + math.sqrt(COUPLER_STIFFNESS * inertia) * (
        omega - rate
    )
    push = engaged * push if theta > angle and push > 0.0 else 0.0
    rate += h * (push / inertia - 25.0)  # rad/s^2: gravity on a hammer geared up five times
    if angle < -0.0005:  # rest rail
        rate += h * (-4e5 * (angle + 0.0005) - 600.0 * rate)
    elif angle > STRING_ANGLE and rate > 0.0:
        rate *= -0.55
    elif (
        theta > ESCAPE_START and angle < ESCAPE_START and rate < 0.0
    ):  # caught by the check while the key is down
        rate = 0.0
    ks[j, HAMMER] = angle + h * rate
    ks[j, HAMMER_SPEED] = rate
    return -push * plant.hammer / inertia
