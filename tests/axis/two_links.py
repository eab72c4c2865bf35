"""A fifth plant of the axis: an arm of two links in MuJoCo, whose links share inertia and turn each
other's gravity; each joint has a position loop around a speed loop with integral action.
"""

from __future__ import annotations

import mujoco
import numpy as np

from pianobot_ros.axis.log import Log

FIRST, REACH = 0.35, 0.3  # m, from shoulder to elbow and on to the tip
ARM = f"""<mujoco><option timestep="0.0005" integrator="implicitfast"/>
<worldbody><body pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="0.5" frictionloss="{{0}}"
armature="0.05"/><geom type="capsule" fromto="0 0 0 {FIRST} 0 0" size="0.03" mass="1.8"/>
<body pos="{FIRST} 0 0"><joint name="elbow" axis="0 1 0" damping="0.3" frictionloss="0.4"
armature="0.04"/><geom type="capsule" fromto="0 0 0 {REACH} 0 0" size="0.025" mass="1.0"/>
<body pos="{REACH} 0 0"><geom type="sphere" size="0.03" mass="{{1}}"/></body></body></body>
</worldbody><actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator></mujoco>"""
LOOPS = np.array([(12.0, 9.0, 25.0), (15.0, 6.0, 20.0)])
"""Of each joint: gain of position, 1/s, of speed, N m s, and of its integral, N m."""
STEPS = 10  # of the loops in a sample of the log
REST = 3000  # steps in which it comes to rest first


def shoulder(seed: int, mass: float = 1e-4, friction: float = 0.6, seconds: float = 30.0) -> Log:
    """A log of the shoulder, 100 Hz, with `mass` kg at the tip."""
    model = mujoco.MjModel.from_xml_string(ARM.format(friction, mass))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1e-3)
    command = np.stack([0.4 + _waves(rng, t, 0.4), 0.5 + _waves(rng, t, 0.5)], axis=1)
    speed = np.gradient(command, t, axis=0)
    data.qpos[:] = command[0]
    gathered = np.zeros(2)
    rows = []
    for i in range(-REST, t.size):
        moving = speed[i] if i >= 0 else 0.0
        error = LOOPS[:, 0] * (command[max(i, 0)] - data.qpos) + 0.6 * moving - data.qvel
        gathered += 1e-3 * error
        data.ctrl[:] = LOOPS[:, 1] * error + LOOPS[:, 2] * gathered
        if i >= 0 and i % STEPS == 0:
            rows.append((*data.qpos, data.ctrl[0]))
        mujoco.mj_step(model, data, 2)
    own, elbow, effort = np.array(rows).T
    return Log(
        "arm",
        t[::STEPS],
        command[::STEPS, 0],
        own + 2e-5 * rng.standard_normal(own.size),
        None,
        effort + 0.03 * rng.standard_normal(own.size),
        "Nm",
        (),
        "shoulder",
        others={"elbow": elbow + 2e-5 * rng.standard_normal(own.size)},
        joints=("shoulder", "elbow"),
    )


def _waves(rng: np.random.Generator, t: np.ndarray, amplitude: float) -> np.ndarray:
    """Sines (n,) that set in within a second."""
    lines = (np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.13, 0.31, 0.77, 1.4))
    return amplitude * sum(x / (1 + k) for k, x in enumerate(lines)) * np.minimum(1.0, t)
