"""The servo axis as a twin of the diagnosis: what it predicts of a block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.axis.commissioning.around import contact_limit
from pianobot_ros.axis.commissioning.around.arm import coupling
from pianobot_ros.axis.commissioning.around.other_joints import Others
from pianobot_ros.axis.commissioning.around.stops import free_of, stop
from pianobot_ros.axis.commissioning.combinations import combinations
from pianobot_ros.axis.commissioning.commissioned import commissioned
from pianobot_ros.axis.laws import kernel
from pianobot_ros.axis.laws.friction import warming
from pianobot_ros.axis.laws.readings import Readings
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import Clean
from pianobot_ros.axis.signals.filtering import derivative
from pianobot_ros.axis.signals.segment import SINCE
from pianobot_ros.axis.twin.choice import observable_effects
from pianobot_ros.axis.twin.description import COMMISSIONED, HORIZON, nuisances, observables
from pianobot_ros.axis.twin.since import Since
from pianobot_ros.gap import Block, Effect, GapError, Signal, Stage
from pianobot_ros.gap.problem.types import Array, Parameter

SIZES = ("inertia", "bandwidth", "damping", "command_gain", "model_scale")
"""Nominal values that are larger than 0 in any joint."""
GRAVITIES = ("gravity", "arm_gravity")


class ServoAxis:
    """Twin of a position-controlled joint.

    `nominal` values may be given (then they are believed to the fraction `trust`); without them
    they are commissioned from the log and are believed to a factor. `known` are effects that the
    twin already has, with their parameters: they become nuisances. `since` says that nominal and
    known come from another log of the same joint, so that a payload may have been added, and what
    is known from there. `repeated`: most motions are made several times. `plain`: whether the
    position loop is, where that is not left to the logs.

    Where no effort was measured, efforts are in rad (or m) of command error: the loop's stiffness
    is 1, the inertia 1/bandwidth².
    """

    stages = (
        Stage("command", "trajectory and transport"),
        Stage("drive", "position loop and amplifier"),
        Stage("mechanics", "inertia and friction"),
        Stage("load", "what the joint carries"),
        Stage("transmission", "gear and coupling"),
        Stage("sensing", "encoder and time alignment of the columns"),
        Stage("clock", "time bases"),
    )

    def __init__(
        self,
        logs: Sequence[Clean],
        nominal: Mapping[str, float] | None = None,
        known: Mapping[str, Mapping[str, float]] | None = None,
        *,
        trust: float = 0.2,
        since: Since | None = None,
        others: Others | None = None,
        repeated: bool = True,
        plain: bool | None = None,
    ) -> None:
        known, given = dict(known or {}), dict(nominal or {})
        strangers = set(given) - set(COMMISSIONED)
        if strangers:
            raise GapError(
                f"unknown nominal parameters {sorted(strangers)}; valid: {', '.join(COMMISSIONED)}"
            )
        for name in SIZES:
            if not given.get(name, 1.0) > 0.0:
                raise GapError(f"nominal {name} is {given[name]:g}: give one larger than 0")
        if others is None:
            first = logs[0].log
            touched = contact_limit.find(logs, first.joint, first.joints)
            pressed = stop(logs) if touched is None else {}
            clear = [free_of(c, pressed) for c in logs]
            arm = dict(since.arm) if since is not None else {}
            arm = arm or coupling(clear, first.joint, first.joints, touched)
            others = Others(arm, touched, pressed)
        had = {n: v for values in known.values() for n, v in values.items()}
        joint = commissioned(logs, given, had, others, plain)
        everything = observable_effects(joint, since is not None)
        for e in everything:  # told by the poses alone, so no matter of comparing explanations
            if e.name == "contact" and e.name not in known:
                known["contact"] = dict(e.starts[0])
                joint = replace(joint, known={**joint.known, **known["contact"]})
        self.joint = joint
        """As commissioned; its `known` are the parameters of the effects that the twin has."""
        theirs = (p for e in everything if e.name in known for p in e.parameters)
        own = (*nuisances(joint, trust), *(_nuisance(p, known, trust) for p in theirs))
        if since is not None:
            own = tuple(since.known(p, joint.has("effort"), joint.unit == "m") for p in own)
            for e in everything:  # gravity that a reference did not have is an added mass
                if e.name in GRAVITIES and e.name not in known:
                    known[e.name] = {}
        self.parameters = own
        self.effects: tuple[Effect, ...] = tuple(e for e in everything if e.name not in known)
        missed = dict(since.missed) if since is not None else {}
        self.observables = observables(joint, missed, repeated)

    @property
    def guesses(self) -> Sequence[Mapping[str, Mapping[str, float]]]:
        """Combinations of effects that commissioning found; see `combinations.py`."""
        return tuple(combinations(self.joint, {e.name for e in self.effects}))

    def features(self, block: Block) -> dict[str, Signal]:
        """What an unexplained residual may depend on."""
        q, v, a = block.inputs["q"], block.inputs["v"], block.inputs["a"]
        scales = self.joint.scales
        load = Signal(a.t, scales.inertia * a.y, scales.effort_unit)
        return {"position": q, "velocity": v, "load": load}

    def rehearse(self, name: str, command: Array, rate: float) -> Log:
        """What the joint would log if it were given `command` (n,) at `rate` Hz, by the nominal
        twin.
        """
        p = self.joint.vector({})
        p[kernel.MID] = float(np.mean(command))
        dt = 1.0 / rate
        slope = np.gradient(command, dt)
        q, effort = kernel.forward(
            command, slope, dt, float(command[0]), 0.0, 0.0, p, kernel.NO_FIELD
        )
        return Log(
            name,
            np.asarray(np.arange(command.size) * dt, float),
            command if self.joint.has("command") else None,
            q,
            derivative(q, dt) if self.joint.has("velocity") else None,
            effort if self.joint.has("effort") else None,
            self.joint.scales.effort_unit,
            unit=self.joint.unit,
            link=q if self.joint.has("twist") else None,
        )

    # Prediction.

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Array | float]]:
        """Predict tracking, effort, free motion, velocity and twist of every block."""
        del effects  # an absent effect's magnitude is 0, and every law vanishes there
        p = self.joint.vector(values)
        return [self._one(b, p, values) for b in blocks]

    def _one(self, block: Block, p: Array, values: Mapping[str, float]) -> dict[str, Array | float]:
        q, v, a = block.inputs["q"], block.inputs["v"], block.inputs["a"]
        t, dt = q.t, float(q.t[-1] - q.t[0]) / (q.t.size - 1)
        start, span = block.attributes["session_start"], max(block.attributes["session_span"], 1e-9)
        p = warmed(p, block.attributes["session_before"] + float(np.mean(t)) - start)
        series = {n: s.y for n, s in block.inputs.items()} | {SINCE: t - start}
        field = self.joint.others.field(p, series, t.size)
        first = round(block.attributes["lead"])
        out: dict[str, Array | float] = {}
        if "command" in series and "position" in block.outputs:
            u = kernel.delayed(t, series["command"], dt, p, (t - start) / span)
            gathered = float(series["error integral"][0])
            p = p.copy()
            p[kernel.MID] = block.attributes["command_middle"]
            slope = np.gradient(u, dt)
            out["tracking"] = kernel.forward(
                u, slope, dt, float(q.y[0]), float(v.y[0]), gathered, p, field
            )[0][first:]
        drift = 1.0 + p[kernel.DROOP] * (t - start) / span
        if block.outputs.keys() & {"effort", "twist"}:
            cutoff, ahead = block.attributes["cutoff"], series.get("twist")
            moved = Readings(series["reading"], (q.y, v.y, a.y), dt, cutoff, ahead).moved(p)
        if "effort" in block.outputs:
            late = p[kernel.LAT] + values.get("effort_stamp", 0.0)
            effort = np.interp(t + late, t, series["effort"]) / drift
            every = max(2, round(HORIZON / dt))
            need, free = moved.compared(field, effort, (every, first))
            at = block.outputs["effort"].t - late
            out["effort"] = np.interp(at, t, need * drift)
            out["free motion"] = free[first:]
        if "velocity" in block.outputs:
            out["velocity"] = np.interp(
                block.outputs["velocity"].t - values.get("velocity_lag", 0.0), t, v.y
            )
        if "twist" in block.outputs:
            out["twist"] = np.interp(block.outputs["twist"].t, t, moved.twist(field))
        return out


def warmed(p: Array, at: float) -> Array:
    """The kernel's parameters with friction as it is at the session time `at`, s."""
    if p[kernel.WARM] == 0.0:
        return p
    p = p.copy()
    factor = warming.law(p[kernel.WARM], p[kernel.WARMT], at)
    p[[kernel.B, kernel.CV, *kernel.DRY]] *= factor
    if p[kernel.FC] == 0.0 and p[kernel.B] == 0.0:  # friction is in the loop's damping
        p[kernel.ZETA] *= factor
    return p


def _nuisance(p: Parameter, known: Mapping[str, Mapping[str, float]], trust: float) -> Parameter:
    """A known effect's parameter as one of the twin's own."""
    given = next((v[p.name] for v in known.values() if p.name in v), p.nominal)
    value = float(np.clip(given, p.low, p.high))
    return replace(p, nominal=value, sd=trust if p.log else max(trust * abs(value), 0.02 * p.sd))
