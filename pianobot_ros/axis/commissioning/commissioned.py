"""A joint as its logs show it before any hypothesis is fitted: first values and typical sizes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from pianobot_ros.axis.commissioning.around.arm import arm_load
from pianobot_ros.axis.commissioning.around.carried import carried
from pianobot_ros.axis.commissioning.around.other_joints import Others
from pianobot_ros.axis.commissioning.around.stops import free_of
from pianobot_ros.axis.commissioning.position_loop import UNLIMITED, loop
from pianobot_ros.axis.commissioning.regression import regress
from pianobot_ros.axis.commissioning.sizes import model_scale, sizes
from pianobot_ros.axis.laws import Scales, kernel
from pianobot_ros.axis.laws.load.carried_load import CYCLE
from pianobot_ros.axis.signals.cleaning import UNSURE, Clean
from pianobot_ros.gap.problem.types import Array

__all__ = ["Commissioned", "commissioned"]

LEAST = 0.5
"""Of the RMS effort: a load that is smaller tells nothing of its compensation."""
LOADLIKE = ("coulomb", "gravity", "gravity_angle", "constant", "command_delay")
"""What commissioning finds beside the twin's own parameters."""


@dataclass(frozen=True)
class Commissioned:
    """`nominal` values are found in the `logs`, but for those that were `given`; `beside` are load
    and friction that were found with them, `known` the parameters of effects that the twin has.
    """

    logs: tuple[Clean, ...]
    given: Mapping[str, float]
    others: Others
    known: Mapping[str, float]
    nominal: Mapping[str, float]
    beside: Mapping[str, float]
    scales: Scales

    @property
    def unit(self) -> str:
        """Of positions, rad or m."""
        return self.logs[0].log.unit

    def has(self, column: Literal["effort", "velocity", "command", "model", "twist"]) -> bool:
        """Whether any log has this column: efforts, measured velocities, commands, the regressor of
        the robot's model, or the twist between motor and link.
        """
        return any(getattr(c, column) is not None for c in self.logs)

    def vector(self, values: Mapping[str, float]) -> Array:
        """The kernel's parameters in the order of its `NAMES`; what is not given is nominal."""
        p = np.zeros(len(kernel.NAMES))
        for k in (kernel.J, kernel.GAIN, kernel.CW, kernel.MUD):
            p[k] = 1.0
        p[kernel.VS], p[kernel.RS] = max(UNSURE * self.scales.speed, 1e-6), self.scales.rest
        p[kernel.WN], p[kernel.ZETA], p[kernel.PEAK] = 30.0, 0.8, UNLIMITED
        self.others.into(p)
        for source in (self.nominal, self.known, values):
            for name, value in source.items():
                index = kernel.INDEX.get(name)
                if index is not None:
                    p[index] = value
        if not self.has("effort"):
            p[kernel.J] = 1.0 / p[kernel.WN] ** 2
        return p


def _compensated(logs: Sequence[Clean], shown: Array, borne: Array, effort: float) -> float:
    """Share of a load that is in the effort and that the loop need not bear; 0 where it is less
    than half, or the load little beside the RMS `effort`. Loads `shown` in the effort and `borne`
    by the loop are each the factors of the sine and cosine of the angle and a constant.
    """
    q = np.concatenate([c.q for c in logs])
    of = np.array([np.sin(q), np.cos(q), np.ones(q.size)])
    load = shown @ of
    if np.max(np.abs(load)) < LEAST * effort:  # over a short travel sine and constant cancel
        return 0.0
    share = min(1.0 - float(borne @ of @ load) / float(load @ load), 1.0)
    return share if share > 0.5 else 0.0


def commissioned(
    logs: Sequence[Clean],
    given: Mapping[str, float],
    known: Mapping[str, float],
    others: Others,
    plain: bool | None = None,
) -> Commissioned:
    """A joint's first values, and load and friction found beside them; `plain` says whether the
    position loop is, where that is not left to the logs.
    """
    clear = [free_of(c, others.stop) for c in logs]
    found = regress(clear)
    base = {n: v for n, v in found.items() if n not in LOADLIKE} | {
        n: v for n, v in given.items() if n in ("inertia", "viscous")
    }
    if not any(c.effort is not None for c in logs):
        base = {}
    if base and others.arm:  # what the arm turns is not taken for inertia
        told = arm_load([c for c in clear if c.effort is not None], others.arm)
        own = {n: told[n] for n in ("inertia", "viscous") if told.get(n, 0.0) > 0.0}
        base |= {n: v for n, v in own.items() if n not in given}
    scale = model_scale(logs) if any(c.model is not None for c in logs) else 0.0
    first = next((c for c in logs if c.command is not None), None)
    if first is not None:
        hold = first.log.interval
        dry = found.get("coulomb", 0.0)
        found = {**loop(clear, base, given, hold, others, scale, plain, dry), **found}
        known = {"peak": found.pop("peak"), **known}
    borne = np.array([found.pop(n, 0.0) for n in ("loop_sine", "loop_cosine", "loop_offset")])
    beside = {n: found.pop(n) for n in LOADLIKE if n in found}
    if scale:
        found["model_scale"] = scale
    nominal = {**found, **base, **given}
    taken = carried(logs, others.arm)
    known = {**known, **{n: taken[n] for n in CYCLE if n in taken}}
    scales = replace(sizes(logs, nominal), carried=taken, stop=others.stop)
    if base and first is not None:
        size, angle = beside["gravity"], beside["gravity_angle"]
        shown = [size * math.cos(angle), -size * math.sin(angle), beside["constant"]]
        share = _compensated(logs, np.array(shown), borne, scales.effort)
        # an integrator may bear it as well
        nominal = {"load_feedforward": 0.0 if nominal["integral"] > 0.0 else share, **nominal}
    return Commissioned(tuple(logs), given, others, known, nominal, beside, scales)
