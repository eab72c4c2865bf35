# ruff: noqa: PLR0912, PLR0915  (compiled code: flat functions over plain numbers are what the
# compiler turns into fast code)
"""The arm's servo: from target pose to wrist pose, with the effects of the wrist stage."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.numbers.nominal import WristServo, wrist_servo
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.instruments.held import held
from pianobot_ros.emulator.plant.instruments.sensor_noise import noise_levels
from pianobot_ros.emulator.plant.laws.arm import (
    GIVE_TIME,
    first_order,
    hardening_give,
    joint_give,
    next_poll,
    queued,
    rate_limited,
    second_order,
)
from pianobot_ros.emulator.plant.laws.counter_random import normal, uniform
from pianobot_ros.emulator.serving.bus import PlantBus

__all__ = [
    "ArmModel",
    "ArmParameters",
    "ArmState",
    "arm_cycle",
    "arm_parameters",
    "new_arm_state",
]


SUBSTEP = 1e-3  # s
COMPLIANCE_FREQUENCY = 2 * math.pi * 9.0  # rad/s: first mode of an outstretched UR5
COMPLIANCE_DAMPING = 0.2
VOIGT_TIME = 0.02  # s
WANDER_TIME = 1.5  # s
_QUEUE = 256


class ArmParameters(NamedTuple):
    """Constants of the compiled arm; effects by physical parameter."""

    frequency: float
    damping: float
    wander: float  # m
    seed: int
    wrist_delay: float  # s
    wrist_lag: float  # s
    wrist_compliance: float  # m/N
    arm_vibration: float  # m
    wrist_quantised: float  # m
    wrist_delay_law: int
    wrist_lag_law: int
    wrist_compliance_law: int


class ArmState(NamedTuple):
    """What the arm remembers. Arrays, changed in place."""

    servo: Array  # (2, 6) pose and rate of the servo proper
    lag: Array  # (2, 6) the two stages of the extra lag
    deflection: Array  # (2, 3) and its rate
    wander: Array  # (2, 3) and its rate
    queue: Array  # (_QUEUE, 7) release time and target
    counters: NDArray[np.int64]  # (4,) queue head, queue tail, draws, steps
    clock: Array  # (1,) s
    active: Array  # (6,) target in force


@lru_cache(maxsize=1)
def _servo() -> WristServo:
    return wrist_servo()


def arm_parameters(case: Case) -> ArmParameters:
    """The arm of a case."""
    servo = _servo()
    return ArmParameters(
        frequency=servo.natural_frequency,
        damping=servo.damping_ratio,
        wander=noise_levels().wrist_wander * case.repeatability,
        seed=case.seed,
        **case.constants(ArmParameters._fields),
    )


def new_arm_state(pose: ArrayLike) -> ArmState:
    """At rest at ``pose`` (6,), having been told to be there."""
    pose = np.asarray(pose, dtype=float)
    zero = np.zeros(6)
    return ArmState(
        np.stack([pose, zero]),
        np.stack([pose, pose]),
        np.zeros((2, 3)),
        np.zeros((2, 3)),
        np.zeros((_QUEUE, 7)),
        np.zeros(4, dtype=np.int64),
        np.zeros(1),
        pose.copy(),
    )


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def arm_cycle(
    p: ArmParameters,
    s: ArmState,
    target: Array,
    force: Array,
    propagator: Array,
    dt: float,
    pose: Array,
    twist: Array,
) -> None:
    """One controller cycle of ``len(pose)`` substeps of ``dt`` s; writes the wrist's state at the
    end of each substep.
    """
    if (
        p.wrist_delay > 0.0
    ):  # the target waits in a queue; every wait is a little different, order is kept
        release = s.clock[0] + p.wrist_delay * (0.8 + 0.4 * uniform(p.seed, 21, s.counters[2]))
        if p.wrist_delay_law == 1:  # a pure delay
            release = s.clock[0] + p.wrist_delay
        elif p.wrist_delay_law == 2:
            release = next_poll(s.clock[0], p.wrist_delay)
        elif p.wrist_delay_law == 3:
            release = s.clock[0] + queued(p.wrist_delay, uniform(p.seed, 21, s.counters[2]))
        s.counters[2] += 1
        head = s.counters[0]
        if head > 0:
            release = max(release, s.queue[(head - 1) % _QUEUE, 0])
        s.queue[head % _QUEUE, 0] = release
        for c in range(6):
            s.queue[head % _QUEUE, 1 + c] = target[c]
        s.counters[0] = head + 1
    else:
        for c in range(6):
            s.active[c] = target[c]
    for i in range(len(pose)):
        now = s.clock[0]
        earlier, part = s.active.copy(), 0.0
        while s.counters[1] < s.counters[0] and s.queue[s.counters[1] % _QUEUE, 0] < now + dt:
            # A target that is released within the substep counts for what is left of it.
            release = max(s.queue[s.counters[1] % _QUEUE, 0], now)
            for c in range(6):
                earlier[c] += part * (s.active[c] - earlier[c])
                s.active[c] = s.queue[s.counters[1] % _QUEUE, 1 + c]
            part = (now + dt - release) / dt
            s.counters[1] += 1
        for c in range(6):
            aim = s.active[c] if part == 0.0 else earlier[c] + part * (s.active[c] - earlier[c])
            if p.wrist_lag > 0.0 and p.wrist_lag_law == 1:
                aim = s.lag[1, c] = first_order(s.lag[1, c], aim, dt, max(p.wrist_lag, 1e-5))
            elif p.wrist_lag > 0.0 and p.wrist_lag_law == 2:
                band = 0.001 if c < 3 else 0.01
                aim = rate_limited(s.lag[1, c], aim, dt, max(p.wrist_lag, 1e-5), band)
                s.lag[1, c] = aim
            elif p.wrist_lag > 0.0 and p.wrist_lag_law == 3:
                aim = second_order(s.lag, c, aim, dt, max(p.wrist_lag, 1e-5))
            elif (
                p.wrist_lag > 0.0
            ):  # two stages that grow slower with the error they have to make up
                scale = 0.001 if c < 3 else 0.01
                first, second = s.lag[0, c], s.lag[1, c]
                time = (
                    0.5 * p.wrist_lag * (0.85 + 0.3 * math.tanh(abs(aim - second) / (3.0 * scale)))
                )
                weight = 1.0 - math.exp(-dt / max(time, 1e-5))
                first += (aim - first) * weight
                second += (first - second) * weight
                s.lag[0, c], s.lag[1, c] = first, second
                aim = second
            if p.wrist_quantised > 0.0 and c < 3:  # the target passes through a coarse register
                aim = round(aim / p.wrist_quantised) * p.wrist_quantised
            offset, rate = s.servo[0, c] - aim, s.servo[1, c]
            s.servo[0, c] = aim + propagator[0, 0] * offset + propagator[0, 1] * rate
            s.servo[1, c] = propagator[1, 0] * offset + propagator[1, 1] * rate
            pose[i, c], twist[i, c] = s.servo[0, c], s.servo[1, c]
        if p.wrist_compliance > 0.0 and p.wrist_compliance_law > 0:
            for c in range(3):
                give = p.wrist_compliance * (1.0 if c == 2 else 0.6)
                if p.wrist_compliance_law == 1:  # spring and damper side by side (Kelvin, Voigt)
                    aim, time = give * force[c], VOIGT_TIME
                elif p.wrist_compliance_law == 3:  # springs in the joints (Salisbury 1980)
                    aim, time = joint_give(force, c, p.wrist_compliance), GIVE_TIME
                else:
                    aim, time = hardening_give(force[c], give), GIVE_TIME
                moved = first_order(s.deflection[0, c], aim, dt, time) - s.deflection[0, c]
                s.deflection[0, c] += moved
                pose[i, c] += s.deflection[0, c]
                twist[i, c] += moved / dt
        elif p.wrist_compliance > 0.0:  # a lightly damped mass on a spring that the keys push
            w = COMPLIANCE_FREQUENCY
            for c in range(3):
                give = p.wrist_compliance * (1.0 if c == 2 else 0.6)
                pull = (
                    w * w * (give * force[c] - s.deflection[0, c])
                    - 2.0 * COMPLIANCE_DAMPING * w * s.deflection[1, c]
                )
                s.deflection[1, c] += dt * pull
                s.deflection[0, c] += dt * s.deflection[1, c]
                pose[i, c] += s.deflection[0, c]
                twist[i, c] += s.deflection[1, c]
        if (
            p.wander > 0.0
        ):  # slow random wander of the whole arm, smooth: white noise through two equal lags
            for c in range(3):
                kick = (
                    p.wander
                    * 2.0
                    * math.sqrt(dt / WANDER_TIME)
                    / WANDER_TIME
                    * normal(p.seed, 31 + c, s.counters[3])
                )
                pull = -s.wander[0, c] / WANDER_TIME**2 - 2.0 * s.wander[1, c] / WANDER_TIME
                s.wander[1, c] += dt * pull + kick
                s.wander[0, c] += dt * s.wander[1, c]
                pose[i, c] += s.wander[0, c]
                twist[i, c] += s.wander[1, c]
        s.clock[0] = now + dt
        if p.arm_vibration > 0.0:
            for k, (w, share) in enumerate(((2 * math.pi * 11.3, 0.8), (2 * math.pi * 27.1, 0.2))):
                phase = w * s.clock[0] + 2.0 * math.pi * uniform(p.seed, 41, k)
                pose[i, 2] += p.arm_vibration * share * math.sin(phase)
                twist[i, 2] += p.arm_vibration * share * w * math.cos(phase)
        s.counters[3] += 1


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _turn_near(rotation: Array, reference: Array) -> None:
    """Change a rotation vector (3,) to the one of the same rotation that is nearest to
    ``reference``.
    """
    angle = math.sqrt(rotation[0] ** 2 + rotation[1] ** 2 + rotation[2] ** 2)
    if angle < 1e-9:
        return
    best, nearest = 1.0, np.inf
    for k in range(-1, 2):
        factor, distance = 1.0 + 2.0 * math.pi * k / angle, 0.0
        for c in range(3):
            distance += (rotation[c] * factor - reference[c]) ** 2
        if distance < nearest:
            best, nearest = factor, distance
    for c in range(3):
        rotation[c] *= best


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _arm_step(
    arm: Any, target: Array, force: Array, propagator: Array, dt: float, pose: Array, twist: Array
) -> None:
    """One :func:`arm_cycle` of the parameters and the state held by ``arm``; ``target`` gets
    lost.
    """
    parameters, state = arm[0]
    _turn_near(target[3:], state.servo[0, 3:])
    arm_cycle(parameters, state, target, force, propagator, dt, pose, twist)


class ArmModel:
    """The wrist frame as the servo moves it; made once, stepped at the controller's rate.

    Nominally each coordinate of the pose (position m, rotation vector rad, base frame) follows its
    target as a second-order system, solved exactly for a target that is held over the step.
    ``pose`` and ``twist`` are the true state; :meth:`measured` is what the encoders say of it.
    """

    def __init__(self, pose: ArrayLike, case: Case | None = None) -> None:
        self.case = case or Case()
        self._parameters = arm_parameters(self.case)
        noise = noise_levels()
        self._spread = np.repeat([noise.wrist_position, noise.wrist_rotation], 3) * self.case.noise
        self._random = np.random.default_rng([self.case.seed, 1])
        self._propagators: dict[float, Array] = {}
        self.reset(pose)

    @classmethod
    def from_bus(cls, pose: ArrayLike, bus: PlantBus) -> ArmModel:
        """The arm of the cell behind ``bus``, with the effects that its case gives the arm."""
        return cls(pose, Case.from_json(bus.case()))

    def reset(self, pose: ArrayLike) -> None:
        """At rest at ``pose`` (6,)."""
        self.pose: Array = np.array(pose, dtype=float)
        self.twist: Array = np.zeros(6)
        self._held = held((self._parameters, new_arm_state(self.pose)))

    def step(
        self, dt: float, target_pose: ArrayLike, force: ArrayLike = (0.0, 0.0, 0.0)
    ) -> tuple[Array, Array]:
        """Advance by ``dt`` s with ``target_pose`` (6,) held; ``force`` (3,) N is what the keys
        exert on the wrist.

        Returns copies of pose (6,) and its time derivative (6,) at the end of the step. A target's
        rotation vector is taken in the representation nearest to the present one.
        """
        n = max(1, math.ceil(dt / SUBSTEP - 1e-6))
        target = np.array(target_pose, dtype=float)
        pose, twist = np.empty((n, 6)), np.empty((n, 6))
        pull = np.asarray(force, dtype=float)
        _arm_step(self._held, target, pull, self._propagator(dt / n), dt / n, pose, twist)
        self.pose, self.twist = pose[-1], twist[-1]
        return self.pose.copy(), self.twist.copy()

    def measured(self) -> Array:
        """The present pose (6,) with the noise of the arm's encoders."""
        return np.asarray(self.pose + self._spread * self._random.standard_normal(6))

    def _propagator(self, dt: float) -> Array:
        if dt not in self._propagators:
            self._propagators[dt] = servo_propagator(self._parameters, dt)
        return self._propagators[dt]


def servo_propagator(parameters: ArmParameters, dt: float) -> Array:
    """Matrix (2, 2) that carries offset and rate of the servo over ``dt`` s of held target."""
    w, z = parameters.frequency, parameters.damping
    return np.asarray(expm(np.array([[0.0, 1.0], [-w * w, -2 * z * w]]) * dt))
