"""What the robot's other joints do to this one: they turn its gravity and shift its limit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pianobot_ros.axis.commissioning.regression import inflation
from pianobot_ros.axis.laws import kernel
from pianobot_ros.axis.laws.load import carried_load
from pianobot_ros.axis.laws.load.contact import Contact
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import Clean, counted
from pianobot_ros.axis.signals.segment import DRAWN, MODEL, OTHER, SINCE
from pianobot_ros.gap.problem.types import Array

__all__ = ["Others", "moves", "series_of", "told"]

MOVES = 0.1
"""rad that another joint must move to be looked at."""
TOLD = 10.0
"""Variance inflation of another joint's angle beside this one's motion, from which one command
moves both: 5 or 10 are usual (James et al. 2013, An Introduction to Statistical Learning, 3.3.3).
Of simulated arms with a command for each joint it is at most 4, with one for all 171 and more
(tests/axis/test_axis_one_command.py holds a factor of two to either side).
"""


@dataclass(frozen=True)
class Others:
    """Joints whose signed sum turns gravity (`arm`), the limit that others shift, and the `stop`
    that the joint presses on whatever the others do (first values, and its side).
    """

    arm: Mapping[str, float] = field(default_factory=dict)
    contact: Contact | None = None
    stop: Mapping[str, float] = field(default_factory=dict)

    def carries(self, log: Log) -> bool:
        """Whether joints behind this one turn its gravity, so that its own angle and theirs both
        move what the next links carry; what joints before it turn hangs by the whole angle alone.
        """
        if log.joint not in log.joints:
            return False
        i = log.joints.index(log.joint)
        return any(log.joints.index(n) > i for n in self.arm if n in log.joints)

    def into(self, p: Array) -> None:
        """Put the limit that was found into the kernel's parameters."""
        p[kernel.SSIDE] = self.stop.get("end_stop_side", 0.0)
        if self.contact is not None:
            p[kernel.CSIDE], p[kernel.CL] = self.contact.side, self.contact.limit
            p[kernel.CS1], p[kernel.CS2] = (s for _, s in self.contact.slopes)

    def field(self, p: Array, series: Mapping[str, Array], n: int) -> Array:
        """What other joints add, (n, 4) as sine and cosine of the own angle, inertia and limit of
        the angle, or (0, 4).

        `series` are arrays (n,): other joints' angles (`OTHER` + name), `MODEL`, `DRAWN` beside
        the own angle `q`, and the time `SINCE` the log began, s.
        """
        modelled = all(name in series for name in MODEL) and p[kernel.MS] != 0.0
        turning = (kernel.AG, kernel.AO, kernel.PG, kernel.PGO, kernel.CG)
        bent = any(p[k] != 0.0 for k in turning)
        touched = p[kernel.CK] > 0.0 and self.contact is not None
        drawn = series.get(DRAWN)
        if not modelled and not bent and not touched and drawn is None:
            return kernel.NO_FIELD
        out = np.zeros((n, 4))
        out[:, 3] = p[kernel.CSIDE] * FAR
        if touched and self.contact is not None:
            out[:, 3] = p[kernel.CL]
            for (joint, _), k in zip(self.contact.slopes, (kernel.CS1, kernel.CS2), strict=True):
                out[:, 3] += p[k] * series.get(OTHER + joint, np.zeros(n))
        if bent:
            angle = np.zeros(n)
            for joint, sign in self.arm.items():
                if OTHER + joint in series:
                    angle = angle + sign * series[OTHER + joint]
            for size, hangs in ((kernel.AG, kernel.AGA), (kernel.PG, kernel.PA)):
                out[:, 0] += p[size] * np.cos(angle - p[hangs])
                out[:, 1] += p[size] * np.sin(angle - p[hangs])
            if p[kernel.CG] != 0.0 and SINCE in series:
                when = (p[k] for k in (kernel.CFROM, kernel.CUNTIL, kernel.CSTART, kernel.CPERIOD))
                load = p[kernel.CG] * carried_load.share(series[SINCE], *when)
                out[:, 0] += load * np.cos(angle - p[kernel.CA])
                out[:, 1] += load * np.sin(angle - p[kernel.CA])
                out[:, 2] += load * p[kernel.CR] / carried_load.G
            for size, hangs in ((kernel.AO, kernel.AOA), (kernel.PGO, kernel.PGOA)):
                out[:, 0] += p[size] * math.cos(p[hangs])
                out[:, 1] -= p[size] * math.sin(p[hangs])
        if drawn is not None:  # that much at the measured angle, whatever it is
            out[:, 0] += drawn * np.sin(series["q"])
            out[:, 1] += drawn * np.cos(series["q"])
        if modelled:
            out[:, 0] += p[kernel.MS] * series[MODEL[0]]
            out[:, 1] += p[kernel.MS] * series[MODEL[1]]
            out[:, 2] += p[kernel.J] * (series[MODEL[2]] - 1.0)
        return out

    def to_json(self) -> dict[str, Any]:
        """Plain JSON types."""
        touched = [n for n, _ in self.contact.slopes] if self.contact is not None else []
        return {"arm": dict(self.arm), "contact": touched, "stop": dict(self.stop)}

    @classmethod
    def from_json(cls, held: Mapping[str, Any]) -> Others:
        """What `to_json` wrote; the limit itself is among the values. Raises on other documents."""
        arm = {str(k): float(v) for k, v in held.get("arm", {}).items()}
        joints = [str(n) for n in held.get("contact", ())]
        touched = Contact(1.0, 0.0, tuple((n, 0.0) for n in joints)) if joints else None
        return cls(arm, touched, {str(k): float(v) for k, v in held.get("stop", {}).items()})


def moves(logs: Sequence[Clean], joint: str) -> bool:
    """Whether another joint was logged and moves enough to be asked."""
    if not all(joint in c.others for c in logs):
        return False
    return float(np.ptp(np.concatenate([c.others[joint] for c in logs]))) > MOVES


def told(logs: Sequence[Clean], joint: str) -> bool:
    """Whether a joint's own motion tells the angle of another one: one command moves both, as in a
    gait or a chirp for all legs, and nothing tells whose an effort is.
    """
    kept = [np.flatnonzero(counted(c))[:: c.step] for c in logs]
    own = np.concatenate([_motion(c)[k] for c, k in zip(logs, kept, strict=True)])
    angle = np.concatenate([c.others[joint][k] for c, k in zip(logs, kept, strict=True)])
    return bool(inflation(angle[:, None], own)[0] > TOLD)


def _motion(c: Clean) -> Array:
    return np.column_stack([np.ones(c.q.size), c.q, c.v, c.a])


def series_of(c: Clean) -> dict[str, Array]:
    """What the field of other joints is made of; see `Others.field`."""
    out = {OTHER + name: y for name, y in c.others.items()}
    if c.model is not None:
        out |= dict(zip(MODEL, c.model.T, strict=True))
    if c.drawn is not None:
        out |= {DRAWN: c.drawn, "q": c.q}
    return out


FAR = 1e9
"""rad; a limit that is never reached."""
