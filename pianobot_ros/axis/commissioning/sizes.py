"""How large things are in the logs of a joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.commissioning.regression import finest, waves
from pianobot_ros.axis.laws import Scales
from pianobot_ros.axis.signals.cleaning import Clean, rest_speed
from pianobot_ros.gap.problem.types import Array

__all__ = ["model_scale", "sizes"]


def sizes(logs: Sequence[Clean], nominal: Mapping[str, float]) -> Scales:
    """Typical sizes of what the logs hold, which scale the effects' parameters."""
    v = np.concatenate([c.v for c in logs])
    q = np.concatenate([c.q for c in logs])
    errors = [np.mean((c.command - c.position) ** 2) for c in logs if c.command is not None]
    error = max(float(np.sqrt(np.mean(errors))), 1e-9) if errors else 0.01
    size, unit = error, f"{logs[0].log.unit} of error"
    if efforts := [c.effort for c in logs if c.effort is not None]:
        effort = np.concatenate(efforts)
        size, unit = float(np.sqrt(np.mean(effort**2))), logs[0].log.effort_unit
    speed = float(np.sqrt(np.mean(v**2)))
    inertia = nominal.get("inertia", 1.0 / nominal.get("bandwidth", 30.0) ** 2)
    high = finest(logs)
    return Scales(
        max(size, 1e-9),
        max(speed, 1e-6),
        float(np.ptp(q)),
        error,
        logs[0].dt,
        max(c.before + float(c.t[-1] - c.t[0]) for c in logs),
        unit,
        waves(logs, high),
        float(np.quantile(np.abs(v), 0.999)),
        inertia,
        logs[0].log.unit,
        inertia * nominal.get("bandwidth", 30.0) ** 2,
        max(rest_speed(c) for c in logs),
        0.5 * float(q.min() + q.max()),
        finest=high,
    )


def model_scale(logs: Sequence[Clean]) -> float:
    """Effort per model torque: 1 where effort is a torque or a force, else by regression."""
    if any(c.effort is not None for c in logs) and logs[0].log.effort_unit in ("Nm", "N"):
        return 1.0
    x, y = [], []
    for c in logs:
        target = c.effort if c.effort is not None else None
        if target is None and c.command is not None:
            target = c.command - c.position
        if c.model is not None and target is not None:
            x.append(weight(c))
            y.append(target)
    a, b = np.concatenate(x), np.concatenate(y)
    slope = float(np.sum((a - a.mean()) * (b - b.mean())) / max(np.sum((a - a.mean()) ** 2), 1e-12))
    return max(slope, 1e-3 * float(np.std(b)) / max(float(np.std(a)), 1e-9))


def with_weight(logs: Sequence[Clean]) -> list[Clean]:
    """The logs with the effort that gravity takes by the model of the robot, where there is one."""
    if not any(c.model is not None for c in logs):
        return list(logs)
    scale = model_scale(logs)
    return [c if c.model is None else replace(c, modelled=scale * weight(c)) for c in logs]


def weight(c: Clean) -> Array:
    """Torque (n,) of gravity by the model of the robot, in its unit."""
    assert c.model is not None
    return np.asarray(c.model[:, 0] * np.sin(c.q) + c.model[:, 1] * np.cos(c.q))
