# ruff: noqa: PLR0912, PLR0915  (compiled code: flat functions over plain numbers are what the compiler turns
# into fast code)
"""Joint laws of the soft fingers, compiled: torque of one joint with its tangents, and what the
joint remembers.
"""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.plant.laws.hand import (
    bouc_wen,
    dahl_slider,
    eyring_creep,
    gear_play,
    grown_flank,
    jammed_soil,
    maxwell_slip,
    meeting_bones,
    piecewise_hardening,
    regularised_friction,
    sharp_flank,
)
from pianobot_ros.emulator.plant.laws.row_layout import BRISTLE, CREEP, SLIDERS
from pianobot_ros.emulator.plant.mechanics.physics import Plant

__all__ = ["joint_torque", "stiffness_at"]


CREEP_TIMES = (0.04, 0.25, 1.6)  # s
CREEP_WEIGHTS = (0.40, 0.35, 0.25)
SINGLE_CREEP_TIME = 0.3  # s, law 1
POWER_CREEP_TIMES = (0.01, 0.2, 4.0)  # s, law 2: a power of time by three branches (Schapery 1969)
POWER_CREEP_WEIGHTS = (0.15, 0.30, 0.55)
PRESLIDING = 0.006  # rad, Bouc and Wen's friction
YIELD_ANGLES = (0.008, 0.03, 0.07)  # rad
YIELD_WEIGHTS = (0.5, 0.3, 0.2)


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def stiffness_at(curve: Array, pressure: float) -> float:
    """Joint stiffness, N m/rad, of the calibration curve at ``pressure`` Pa, held beyond its ends.

    ``curve`` (5, m): coefficients of a cubic from each level, highest power first, and the levels,
    ascending.
    """
    last = curve.shape[1] - 1
    x = min(max(pressure, curve[4, 0]), curve[4, last])
    i = 0
    while i < last - 1 and x > curve[4, i + 1]:
        i += 1
    d = x - curve[4, i]
    value: float = ((curve[0, i] * d + curve[1, i]) * d + curve[2, i]) * d + curve[3, i]
    return value


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def joint_torque(
    plant: Plant, fs: Array, f: int, j: int, k: float, c: float, e: float, rate: float, h: float
) -> tuple[float, float, float]:
    """Torque on joint ``j`` of finger ``f`` at deflection ``e`` and its tangent stiffness and
    damping.

    ``k`` and ``c`` are the nominal stiffness and damping, ``h`` the step over which memory
    advances.
    """
    if not plant.joint_effects:
        return -k * e - c * rate, k, c
    strain = e
    torque, kt, ct = 0.0, 0.0, c
    if (
        plant.joint_creep > 0.0
    ):  # Kelvin branches over two decades of time give way one after the other
        lost = 0.0
        if plant.joint_creep_law == 1:  # a standard linear solid (Zener 1948)
            aim = plant.joint_creep * e
            fs[f, CREEP + j] += (aim - fs[f, CREEP + j]) * (h / (SINGLE_CREEP_TIME + h))
            lost = fs[f, CREEP + j]
        elif plant.joint_creep_law == 3:
            total = plant.joint_creep
            lost = eyring_creep(fs[f, CREEP + j], total * e, total, h)
            fs[f, CREEP + j] = lost
        else:
            for b in range(3):
                weight, time = CREEP_WEIGHTS[b], CREEP_TIMES[b]
                if plant.joint_creep_law == 2:
                    weight, time = POWER_CREEP_WEIGHTS[b], POWER_CREEP_TIMES[b]
                aim = plant.joint_creep * weight * e
                fs[f, CREEP + 4 * b + j] += (aim - fs[f, CREEP + 4 * b + j]) * (h / (time + h))
                lost += fs[f, CREEP + 4 * b + j]
        strain = e - lost
    if plant.joint_backlash > 0.0 and plant.joint_backlash_law == 3:
        # the nominal spring and damper turn a shaft with play (Nordin, Galic and Gutman 1997)
        twist, twisting, flank = gear_play(fs, f, j, strain, rate, plant.joint_backlash, c / k, h)
        torque -= k * twist + c * (twisting - rate)
        if flank:
            kt += k
        else:
            ct -= c
    elif plant.joint_backlash > 0.0 and plant.joint_backlash_law > 0:
        if plant.joint_backlash_law == 1:
            elastic, slope = sharp_flank(strain, plant.joint_backlash)
        else:
            elastic, slope = grown_flank(strain, plant.joint_backlash)
        torque -= k * elastic
        kt += k * slope
    elif (
        plant.joint_backlash > 0.0
    ):  # rounded gap with a weak guide in it and damping where the flanks are struck
        gap = plant.joint_backlash
        soft = 0.15 * gap
        up, down = (strain - gap) / soft, (-strain - gap) / soft
        engaged = 1.0 / (1.0 + math.exp(-min(max(up, down, -40.0), 40.0)))
        flank = soft * (_softplus(up) - _softplus(down))
        torque -= k * (0.97 * flank + 0.03 * strain)
        kt += k * (0.97 * engaged + 0.03)
        if strain * rate > 0.0:
            ct += 1.5 * c * engaged * (1.0 - engaged) * 4.0
        torque -= (ct - c) * rate
    else:
        torque -= k * strain
        kt += k
    if plant.joint_hardening > 0.0 and plant.joint_hardening_law > 0:
        scale = plant.joint_hardening * k * 0.1
        if plant.joint_hardening_law == 1:  # a cubic (Duffing 1918)
            x = strain / 0.1
            torque -= scale * x * x * x
            kt += 3.0 * scale / 0.1 * x * x
        else:
            extra, slope = piecewise_hardening(strain, scale)
            if plant.joint_hardening_law == 3:
                extra, slope = meeting_bones(strain, scale)
            torque -= extra
            kt += slope
    elif (
        plant.joint_hardening > 0.0
    ):  # exponential stiffening, a tenth of a radian being the reference
        x = min(abs(strain) / 0.06, 12.0)
        scale = plant.joint_hardening * k * 0.1 / 2.6279
        torque -= math.copysign(scale * (math.exp(x) - 1.0 - x), strain)
        kt += scale / 0.06 * (math.exp(x) - 1.0)
    if plant.jamming_hysteresis > 0.0 and plant.jamming_hysteresis_law > 0:
        # law 1: one Dahl element; law 2: one element that yields early (Iwan 1966); law 3: soil
        share, z = plant.jamming_hysteresis, fs[f, SLIDERS + j]
        if plant.jamming_hysteresis_law == 1:
            z = dahl_slider(z, h * rate, 0.03)
        elif plant.jamming_hysteresis_law == 3:
            z = jammed_soil(fs, f, j, h * rate)
        else:
            z = min(max(z + h * rate, -0.02), 0.02)
        fs[f, SLIDERS + j] = z
        torque += share * k * (strain - z)
    elif (
        plant.jamming_hysteresis > 0.0
    ):  # grains that slip: part of the stiffness yields element by element
        share = plant.jamming_hysteresis
        for b in range(3):
            limit = YIELD_ANGLES[b]
            slip = strain - fs[f, SLIDERS + 4 * b + j]
            if slip > limit:
                fs[f, SLIDERS + 4 * b + j] = strain - limit
                slip = limit
            elif slip < -limit:
                fs[f, SLIDERS + 4 * b + j] = strain + limit
                slip = -limit
            torque += share * YIELD_WEIGHTS[b] * k * (strain - slip)
    if plant.joint_friction > 0.0 and plant.joint_friction_law == 1:
        friction, ratio = regularised_friction(plant.joint_friction, rate, 0.02, 0.25, 0.4)
        torque -= friction
        ct += ratio
    elif plant.joint_friction > 0.0 and plant.joint_friction_law == 2:
        z = bouc_wen(fs[f, BRISTLE + j], h * rate / PRESLIDING)
        fs[f, BRISTLE + j] = z
        torque -= plant.joint_friction * z
        kt += 0.5 * plant.joint_friction / PRESLIDING
    elif plant.joint_friction > 0.0 and plant.joint_friction_law == 3:
        friction, stuck = maxwell_slip(fs, f, j, plant.joint_friction, rate, h)
        torque -= friction
        kt += 0.5 * stuck
    elif (
        plant.joint_friction > 0.0
    ):  # LuGre bristles: 2 mrad of presliding, 40 % more at rest than in motion
        level = plant.joint_friction
        sigma = level / 0.002
        stribeck = level * (1.0 + 0.4 * math.exp(-((rate / 0.25) ** 2)))
        z = fs[f, BRISTLE + j]
        z_new = (z + h * rate) / (1.0 + h * abs(rate) * sigma / stribeck)
        fs[f, BRISTLE + j] = z_new
        micro = 0.3 * math.sqrt(sigma * 2e-5)
        torque -= sigma * z_new + micro * (z_new - z) / h
        kt += 0.5 * sigma
        ct += micro
    return torque - c * rate, kt, ct


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def _softplus(x: float) -> float:
    if x > 30.0:
        return x
    return math.log1p(math.exp(max(x, -40.0)))
