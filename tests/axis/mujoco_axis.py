"""A third plant of the servo axis, simulated by MuJoCo: its flanks are joint limits, its loop
closes on the encoder that errs.
"""

from __future__ import annotations

import mujoco
import numpy as np

from pianobot_ros.axis.log import Log

INERTIA, VISCOUS, KP = 0.05, 0.08, 60.0
KD = 2 * 0.8 * np.sqrt(KP * INERTIA) - VISCOUS
TRUE = {
    "inertia": INERTIA,
    "viscous": VISCOUS,
    "bandwidth": float(np.sqrt(KP / INERTIA)),
    "damping": float(KD / (2 * np.sqrt(KP * INERTIA))),
    "feedforward": 0.0,
    "integral": 0.0,
}
LOAD = 0.4  # share of the inertia that hangs behind the gap
STEP = 5e-4  # s
XML = """
<mujoco><compiler angle="radian"/>
<option timestep="{step}" integrator="implicitfast"><flag contact="disable"/></option>
<worldbody><body><joint name="motor" axis="0 1 0" damping="{viscous}" {stop}
stiffness="{spring}" springref="{slack}"/>
<inertial pos="0 0 0" mass="0.1" diaginertia="{motor} {motor} {motor}"/>
{load}</body></worldbody></mujoco>"""
STOP = 'limited="true" range="-3 {}" solreflimit="0.02 1"'
LOAD_BODY = """<body><joint axis="0 1 0" damping="0.002" limited="true"
range="-{half} {half}" solreflimit="0.004 0.8"/>
<inertial pos="0 0 0" mass="0.1" diaginertia="{load} {load} {load}"/></body>"""


def motion(rate: float, seconds: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Times and command (n,): three sines."""
    t = np.arange(0, seconds, 1 / rate)
    waves = zip(
        rng.uniform(0.2, 0.6, 3), rng.uniform(0.2, 1.2, 3), rng.uniform(0, 6, 3), strict=True
    )
    return t, sum(a * np.sin(2 * np.pi * f * t + p) for a, f, p in waves) * np.minimum(1, t / 0.5)


def log(
    seed: int,
    *,
    gap: float = 0.0,
    ripple: float = 0.0,
    hum: float = 0.0,
    stop: float = 0.0,
    spring: tuple[float, float] = (0.0, 0.0),
    rate: float = 100.0,
    both: bool = False,
) -> Log:
    """25 s with a gap (rad) to the load, an encoder that errs three times a turn (rad), a torque of
    7.3 Hz (N m), a soft `stop` at an angle (rad), or a `spring` (N m/rad) that is slack at an angle
    (rad); with `both` the load's position too.
    """
    rng = np.random.default_rng(seed)
    t, u = motion(rate, 25.0, rng)
    load = LOAD_BODY.format(half=gap / 2, load=LOAD * INERTIA) if gap else ""
    motor = INERTIA * (1 - LOAD if gap else 1.0)
    model = mujoco.MjModel.from_xml_string(
        XML.format(
            step=STEP,
            viscous=VISCOUS,
            motor=motor,
            load=load,
            stop=STOP.format(stop) * bool(stop),
            spring=spring[0],
            slack=spring[1],
        )
    )
    data = mujoco.MjData(model)
    data.qpos[0] = u[0]
    steps = round(1 / rate / STEP)
    fine = np.interp(np.arange(len(t) * steps) * STEP, t, u)
    q, v, effort, link = np.empty((4, len(t)))
    for i, target in enumerate(fine):
        reading = data.qpos[0] + ripple * np.sin(3 * data.qpos[0] + 0.7)
        torque = KP * (target - reading) - KD * data.qvel[0]
        if i % steps == 0:
            q[i // steps], v[i // steps], effort[i // steps] = reading, data.qvel[0], torque
            link[i // steps] = np.sum(data.qpos)  # the load's angle is that from the motor
        data.qfrc_applied[0] = torque + hum * np.sin(2 * np.pi * 7.3 * data.time)
        mujoco.mj_step(model, data)
    noise = 2e-4 * rng.standard_normal((3, len(t)))
    behind = link + 2e-4 * rng.standard_normal(len(t)) if both else None
    noisy = q + noise[0], v + 20 * noise[1], effort + 0.2 * KP * noise[2]
    return Log("mujoco", t, u, *noisy, "N m", link=behind)
