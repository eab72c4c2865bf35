"""A payload by regression: what a joint's effort has more than the twin of its reference needs."""

from __future__ import annotations

import numpy as np

from pianobot_ros.axis.commissioning.around.arm import turned
from pianobot_ros.axis.commissioning.around.other_joints import series_of
from pianobot_ros.axis.commissioning.commissioned import Commissioned
from pianobot_ros.axis.commissioning.regression import hanging, robust
from pianobot_ros.axis.laws.readings import Readings
from pianobot_ros.axis.signals.cleaning import Clean, counted, quantisation, unsure_speed
from pianobot_ros.gap.problem.types import Array

__all__ = ["payload_load"]


def payload_load(joint: Commissioned) -> dict[str, float]:
    """Values of the payload's parameters by robust least squares; empty without efforts, on a
    linear axis, or where what is added has no inertia.
    """
    logs = [c for c in joint.logs if c.effort is not None]
    if not logs or joint.unit != "rad":
        return {}
    carries = joint.others.carries(logs[0].log)
    xs, ys = [], []
    for c in logs:
        kept = np.flatnonzero(counted(c))[:: c.step]
        xs.append(_design(joint, c, carries)[kept])
        ys.append(_more(joint, c)[kept])
    x, y = np.concatenate(xs), np.concatenate(ys)
    steps = np.max([quantisation(c) for c in logs], axis=0)
    noise = np.zeros(x.shape[1])
    noise[0] = steps[2] ** 2
    beta = robust(x, y, noise)
    if beta[0] <= 0.0:
        return {}
    out = {"payload_inertia": float(beta[0])}
    for k, (size, hangs) in enumerate(
        (("payload_gravity", "payload_angle"), ("payload_own", "payload_own_angle"))
    ):
        if k == 0 or carries:
            sine, cosine = beta[1 + 2 * k : 3 + 2 * k]
            out[size], out[hangs] = hanging(sine, cosine)
    return out


def _design(joint: Commissioned, c: Clean, carries: bool) -> Array:
    """Regressors (n, k): acceleration, sine and cosine of the turned angle (and of the own one),
    direction of motion, constant.
    """
    arm = {name: sign for name, sign in joint.others.arm.items() if name in c.others}
    columns = [c.a, *turned(c, arm).T]
    if carries:
        columns += [np.sin(c.q), np.cos(c.q)]
    slow = max(unsure_speed(c), 1e-9)
    return np.stack([*columns, np.tanh(c.v / slow), np.ones(c.v.size)], axis=1)


def _more(joint: Commissioned, c: Clean) -> Array:
    """Effort (n,) beyond what the twin without a payload needs for the motion."""
    assert c.effort is not None
    p = joint.vector({})
    field = joint.others.field(p, series_of(c), c.t.size)
    return c.effort - Readings.of(c).moved(p).needed(field, c.effort)
