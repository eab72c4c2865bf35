"""The pad under a fingertip, compiled: normal force and friction between one finger and one key."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.emulator.plant.laws.contact import (
    adhesive_slip,
    pulp_in_series,
    soft_finger_in_series,
    spring_in_series,
    stribeck_slip,
)
from pianobot_ros.emulator.plant.laws.row_layout import TOUCH
from pianobot_ros.emulator.plant.mechanics.physics import Plant

__all__ = ["friction_force", "normal_force"]


ADHESION_REACH = 0.0006  # m over which a sticky pad's neck tears
ADHESION_TIME = 0.08  # s of contact until it sticks
TEAR_TIME = 0.05  # s


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def normal_force(plant: Plant, depth: float, rate: float) -> float:
    """Normal force, N, of the pad pressed in by ``depth`` m at ``rate`` m/s; never negative."""
    if depth <= 0.0:
        return 0.0
    if plant.pad_compliance <= 0.0:
        return max(plant.pad_stiffness * depth + plant.pad_damping * rate, 0.0)
    if plant.pad_compliance_law > 0:
        if plant.pad_compliance_law == 1:
            force, share = spring_in_series(plant.pad_stiffness, depth, plant.pad_compliance)
        elif plant.pad_compliance_law == 3:
            force, share = soft_finger_in_series(plant.pad_stiffness, depth, plant.pad_compliance)
        else:
            force, share = pulp_in_series(plant.pad_stiffness, depth, plant.pad_compliance)
        pressed: float = max(force + plant.pad_damping * share * rate, 0.0)
        return pressed
    # A Hertzian skin (force to the power 2/3) in series with the pad; its compression at 5 N is the
    # effect's size. With
    # x = F^(1/3) the depths add up to x^3 + a x^2 = k depth, solved by Newton's method from above.
    a = plant.pad_stiffness * plant.pad_compliance / 2.924017738  # 5^(2/3)
    aim = plant.pad_stiffness * depth
    x = aim ** (1.0 / 3.0)
    for _ in range(6):
        x -= (x * x * (x + a) - aim) / max(x * (3.0 * x + 2.0 * a), 1e-9)
        x = max(x, 1e-6)
    softened = 3.0 * x / (3.0 * x + 2.0 * a)
    total: float = max(x * x * x + plant.pad_damping * softened * rate, 0.0)
    return total


@njit(cache=True, error_model="numpy", forceinline=True, _nrt=False)  # type: ignore[untyped-decorator]
def friction_force(
    plant: Plant, fs: Array, f: int, j: int, load: float, vx: float, vy: float, h: float
) -> tuple[float, float]:
    """Tangential force (x, along the key), N, on a pad that moves at ``vx``, ``vy`` m/s over the
    key.

    Coulomb's cone with elastic sticking: a tangential spring is carried back onto the cone where it
    leaves it.
    """
    k, c = plant.bristle_stiffness, plant.bristle_damping
    coefficient = plant.friction
    if plant.tip_slip > 0.0 and plant.tip_slip_law == 1:  # a dusty tip (Amontons' law)
        coefficient *= 1.0 - plant.tip_slip
    elif plant.tip_slip > 0.0 and plant.tip_slip_law == 2:
        coefficient *= stribeck_slip(plant.tip_slip, math.hypot(vx, vy))
    elif plant.tip_slip > 0.0 and plant.tip_slip_law == 3:
        coefficient *= adhesive_slip(plant.tip_slip, load)
    elif plant.tip_slip > 0.0:  # weakens with sliding speed, and was weaker to begin with
        speed = math.hypot(vx, vy)
        coefficient *= (1.0 - 0.5 * plant.tip_slip) * (
            1.0 - plant.tip_slip * speed / (speed + 0.004)
        )
    zx, zy = fs[f, TOUCH + 2 * j] + h * vx, fs[f, TOUCH + 2 * j + 1] + h * vy
    limit = coefficient * load
    size = k * math.hypot(zx, zy)
    if size > limit:
        scale = limit / size
        zx *= scale
        zy *= scale
    fs[f, TOUCH + 2 * j], fs[f, TOUCH + 2 * j + 1] = zx, zy
    fx, fy = -k * zx - c * vx, -k * zy - c * vy
    size = math.hypot(fx, fy)
    if size > limit:
        scale = limit / size
        fx *= scale
        fy *= scale
    return fx, fy
