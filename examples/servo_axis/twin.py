"""The servo axis as a twin of the diagnosis: what it predicts, its nuisance parameters, and its library of effects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from examples.servo_axis import kernel
from examples.servo_axis.laws import Scales, library, payload
from examples.servo_axis.log import Log
from examples.servo_axis.segment import Clean, derivative, low_pass, quantisation
from pianobot_ros.gap import Block, Effect, GapError, Observable, Parameter, Signal, Stage
from pianobot_ros.gap.noise import resolution
from pianobot_ros.gap.types import Array

HORIZON = 0.1
"""Seconds of free motion between two re-initialisations from the measured state."""


NUISANCES = ("inertia", "viscous", "effort_offset", "bandwidth", "damping", "feedforward", "integral", "command_gain")


class ServoAxis:
    """Twin of a position-controlled joint.

    `nominal` values may be given (then they are believed to the fraction `trust`); without them they are commissioned from the
    log by linear regression and are believed to a factor. `known` are effects that the twin already has, with their parameters:
    they become nuisances. `reference` says that nominal and known come from another log of the same joint, so that a payload
    may have been added; `missed` is the RMS that this twin already left of each observable there, which is no change.
    """

    stages = (
        Stage("command", "trajectory and transport"), Stage("drive", "position loop and amplifier"),
        Stage("mechanics", "inertia, friction, gravity"), Stage("transmission", "gear and coupling"),
        Stage("sensing", "encoder and time alignment of the columns"), Stage("clock", "time bases"),
    )  # fmt: skip

    def __init__(self, logs: Sequence[Clean], nominal: Mapping[str, float] | None = None,
                 known: Mapping[str, Mapping[str, float]] | None = None, *, trust: float = 0.2,
                 reference: bool = False, missed: Mapping[str, float] | None = None) -> None:  # fmt: skip
        known = dict(known or {})
        self._missed = dict(missed or {})
        self._logs = tuple(logs)
        self._given = dict(nominal or {})
        self._trust = trust
        strangers = set(self._given) - set(NUISANCES)
        if strangers:
            raise GapError(f"unknown nominal parameters {sorted(strangers)}; valid: {', '.join(NUISANCES)}")
        self._has_effort = any(c.effort is not None for c in logs)
        self._has_velocity = any(c.velocity is not None for c in logs)
        self._has_command = any(c.command is not None for c in logs)
        self._known = {n: v for values in known.values() for n, v in values.items()}
        self._nominal = _regress(logs, self._has_effort) | self._given
        self.scales = self._sizes()
        if self._has_command:
            self._nominal = self._commission(logs) | self._nominal
        everything = self._library(reference)
        self.centre = 0.5 * float(max(c.q.max() for c in self._logs) + min(c.q.min() for c in self._logs))
        had = []
        for p in (p for e in everything if e.name in known for p in e.parameters):
            value = float(np.clip(known_value(known, p), p.low, p.high))
            sd = trust if p.log else max(trust * abs(value), 0.02 * p.sd)
            had.append(replace(p, nominal=value, sd=sd))
        self.parameters = (*self._nuisances(), *had)
        self.effects: tuple[Effect, ...] = tuple(e for e in everything if e.name not in known)
        self.observables = self._observables()

    # -- description ----------------------------------------------------------------------------------------------------
    def _sizes(self) -> Scales:
        v = np.concatenate([c.v for c in self._logs])
        q = np.concatenate([c.q for c in self._logs])
        if self._has_effort:
            effort = np.concatenate([c.effort for c in self._logs if c.effort is not None])
            size, unit = float(np.sqrt(np.mean(effort**2))), self._logs[0].log.effort_unit
        else:
            size, unit = float(np.std(np.concatenate([c.a for c in self._logs]))), "rad/s²"
        error = [np.mean((c.command - c.position) ** 2) for c in self._logs if c.command is not None]
        self._rest = float(np.sqrt(np.mean(v**2)))
        waves = _waves(self._logs, self._nominal) if self._has_effort else [8.0, 24.0]
        return Scales(max(size, 1e-9), max(self._rest, 1e-6), float(np.ptp(q)), float(np.sqrt(np.mean(error))) if error else 0.01,
                      self._logs[0].dt, max(float(c.t[-1] - c.t[0]) for c in self._logs), unit, waves)  # fmt: skip

    def _library(self, reference: bool) -> list[Effect]:
        out = []
        for e in (*library(self.scales), *((payload.build(self.scales),) if reference else ())):
            needs_command = e.stage in ("command", "clock") or e.name in ("deadband", "torque_limit", "position_offset")
            needs_effort = e.name in ("torque_droop", "sensor_latency")
            if (needs_command and not self._has_command) or (needs_effort and not self._has_effort):
                continue
            out.append(e)
        return out

    def _nuisances(self) -> tuple[Parameter, ...]:
        n, s = self._nominal, self.scales
        tight = bool(self._given)
        out: list[Parameter] = []

        def log(name: str, unit: str, stage: str, sd: float, span: float = 8.0) -> None:
            sd = self._trust if name in self._given else sd
            out.append(Parameter(name, n[name], n[name] / span, n[name] * span, unit, stage, sd, True))

        if self._has_effort:
            log("inertia", f"{s.effort_unit}·s²/rad", "mechanics", 0.3)
            out.append(Parameter("viscous", n["viscous"], 0.0, max(20 * n["viscous"], 5 * s.effort / s.speed),
                                 f"{s.effort_unit}·s/rad", "mechanics",
                                 max(0.2 * n["viscous"], (0.02 if tight else 0.1) * s.effort / s.speed)))  # fmt: skip
            out.append(Parameter("effort_offset", n.get("effort_offset", 0.0), -3 * s.effort, 3 * s.effort, s.effort_unit,
                                 "drive", (0.03 if tight else 0.1) * s.effort))  # fmt: skip
        else:
            out.append(Parameter("viscous", n["viscous"], 0.0, 50.0, "1/s", "mechanics", max(0.3 * n["viscous"], 0.5)))
        if self._has_command:
            log("bandwidth", "rad/s", "drive", 0.4)
            log("damping", "1", "drive", 0.3, 4.0)
            out.append(Parameter("feedforward", n["feedforward"], -0.2, 1.3, "1", "drive", 0.1 if tight else 0.2))
            out.append(Parameter("integral", n["integral"], 0.0, 60.0, "1/s", "drive", max(0.3 * n["integral"], 0.3)))
            out.append(Parameter("command_gain", n.get("command_gain", 1.0), 0.5, 2.0, "1", "command", 0.01))
        if self._has_velocity:
            out.append(Parameter("velocity_lag", 0.0, -0.05, 0.2, "s", "sensing", 0.01))
        return tuple(out)

    def _observables(self) -> tuple[Observable, ...]:
        """What is compared; `tolerance` is the twin's own error, the encoder's steps, and what the reference left open."""
        out: list[Observable] = []
        steps = np.max([quantisation(c) for c in self._logs], axis=0)

        def add(name: str, stage: str, signal: str, unit: str, mode: Literal["forward", "inverse", "horizon"],
                own: float, sensed: float) -> None:  # fmt: skip
            tolerance = math.sqrt(own**2 + sensed**2 + self._missed.get(name, 0.0) ** 2)
            out.append(Observable(name, stage, signal, unit, mode=mode, floor_hint=1e-6 * own, tolerance=tolerance))

        if self._has_command:
            own = math.hypot(0.05 * max(self.scales.error, 1e-6), 0.1 * self.scales.dt * self.scales.speed)
            add("tracking", "drive", "position", "rad", "forward", own, 0.0)
        if self._has_effort:
            spread = float(np.std(np.concatenate([c.effort for c in self._logs if c.effort is not None])))
            coarse = max(
                resolution(c.log.effort[np.isfinite(c.log.effort)]) for c in self._logs if c.log.effort is not None
            )
            sensed = math.sqrt((self._nominal["inertia"] * steps[2]) ** 2 + (self._nominal["viscous"] * steps[1]) ** 2
                               + coarse**2 / 12.0)  # fmt: skip
            add("effort", "mechanics", "effort", self.scales.effort_unit, "inverse", 0.05 * spread, sensed)
            a = float(np.std(np.concatenate([c.a for c in self._logs])))
            add("free motion", "mechanics", "position", "rad", "horizon", 0.04 * 0.25 * a * HORIZON**2,
                math.hypot(steps[0], 0.6 * HORIZON * steps[1]))  # fmt: skip
        if self._has_velocity:
            spread = float(np.std(np.concatenate([c.velocity for c in self._logs if c.velocity is not None])))
            add("velocity", "sensing", "velocity", "rad/s", "inverse", 0.05 * spread, steps[1])
        return tuple(out)

    def features(self, block: Block) -> dict[str, Signal]:
        """What an unexplained residual may depend on."""
        q, v, a = block.inputs["q"], block.inputs["v"], block.inputs["a"]
        load = self._nominal["inertia"] * a.y
        return {"position": q, "velocity": v, "load": Signal(a.t, load, self.scales.effort_unit)}

    # -- commissioning --------------------------------------------------------------------------------------------------
    def _commission(self, logs: Sequence[Clean]) -> dict[str, float]:
        """Coarse search for the position loop on (at most) the first 20 s."""
        c = next(x for x in logs if x.command is not None)
        n = min(c.t.size, round(20.0 / c.dt))
        assert c.command is not None
        u, du = c.command[:n], np.gradient(c.command[:n], c.dt)
        best, choice = np.inf, {"bandwidth": 30.0, "damping": 0.8, "feedforward": 0.0, "integral": 0.0}
        for ff in (0.0, 0.5, 0.9):
            for wn in (5.0, 9.0, 16.0, 28.0, 50.0, 90.0, 160.0):
                for zeta in (0.6, 1.0):
                    for ki in (0.2, 4.0):
                        trial = {"bandwidth": wn, "damping": zeta, "feedforward": ff, "integral": ki}
                        p = self._vector({**self._nominal, **trial})
                        out = kernel.forward(u, du, c.dt, float(c.q[0]), float(c.v[0]), 0.0, p)[0]
                        rms = float(np.mean(np.abs(out - c.position[:n])))
                        if rms < best:
                            best, choice = rms, trial
        p = self._vector({**choice, **self._nominal})
        self._known.setdefault(
            "peak", float(np.max(np.abs(kernel.forward(u, du, c.dt, float(c.q[0]), float(c.v[0]), 0.0, p)[1])))
        )
        return choice

    def rehearse(self, name: str, command: Array, rate: float) -> Log:
        """What the joint would log if it were given `command` (n,) at `rate` Hz, by the nominal twin."""
        p = self._vector({})
        dt = 1.0 / rate
        q, effort = kernel.forward(command, np.gradient(command, dt), dt, float(command[0]), 0.0, 0.0, p)
        t = np.asarray(np.arange(command.size) * dt, float)
        return Log(name, t, command if self._has_command else None, q, derivative(q, dt) if self._has_velocity else None,
                   effort if self._has_effort else None, self.scales.effort_unit)  # fmt: skip

    def _vector(self, values: Mapping[str, float]) -> Array:
        p = np.zeros(len(kernel.NAMES))
        p[kernel.J], p[kernel.GAIN], p[kernel.VS] = 1.0, 1.0, max(0.03 * self._rest, 1e-6)
        p[kernel.WN], p[kernel.ZETA], p[kernel.PEAK] = 30.0, 0.8, 1e9
        for source in (self._nominal, self._known, values):
            for name, value in source.items():
                index = kernel.INDEX.get(name)
                if index is not None:
                    p[index] = value
        return p

    # -- prediction -----------------------------------------------------------------------------------------------------
    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Array | float]]:
        """Predict tracking, effort, free motion and velocity of every block."""
        del effects  # an absent effect's magnitude is 0, and every law vanishes there
        p = self._vector(values)
        return [self._one(b, p, values) for b in blocks]

    def _one(self, block: Block, p: Array, values: Mapping[str, float]) -> dict[str, Array | float]:
        q, v, a = block.inputs["q"], block.inputs["v"], block.inputs["a"]
        t, dt = q.t, float(np.median(np.diff(q.t)))
        start, span = block.attributes["session_start"], max(block.attributes["session_span"], 1e-9)
        out: dict[str, Array | float] = {}
        if "command" in block.inputs:
            out["tracking"] = self._tracking(block, p, t, dt, (t - start) / span)
        drift = 1.0 + p[kernel.DROOP] * (t - start) / span
        if "effort" in block.outputs:
            smooth, dry = kernel.inverse(q.y, v.y, a.y, dt, p)
            if np.any(dry):  # the measured effort was smoothed, so its steps were too
                dry = low_pass(dry, dt, block.attributes["cutoff"])
            need = (smooth + dry) * drift
            at = block.outputs["effort"].t - p[kernel.LAT]
            out["effort"] = np.interp(at, t, need)
            effort = np.interp(t + p[kernel.LAT], t, block.inputs["effort"].y) / drift
            first = t.size - block.outputs["position"].t.size
            free = kernel.horizon(q.y, v.y, effort, dt, max(2, round(HORIZON / dt)), first, p)
            out["free motion"] = free[first:]
        if "velocity" in block.outputs:
            out["velocity"] = np.interp(block.outputs["velocity"].t - values.get("velocity_lag", 0.0), t, v.y)
        return out

    def _tracking(self, block: Block, p: Array, t: Array, dt: float, session: Array) -> Array:
        command = block.inputs["command"]
        late = p[kernel.DELAY] + p[kernel.SKEW] * session
        u = p[kernel.GAIN] * np.interp(t - late, command.t, command.y)
        if p[kernel.LAG] > 1e-5:
            u = _lag(u, dt, p[kernel.LAG])
        q, v = block.inputs["q"].y, block.inputs["v"].y
        out = kernel.forward(u, np.gradient(u, dt), dt, float(q[0]), float(v[0]),
                             float(block.inputs["error integral"].y[0]), p)[0]  # fmt: skip
        return np.asarray(out[t.size - block.outputs["position"].t.size :])


def known_value(known: Mapping[str, Mapping[str, float]], parameter: Parameter) -> float:
    """Value of a known effect's parameter, its nominal one if it was not given."""
    return next((v[parameter.name] for v in known.values() if parameter.name in v), parameter.nominal)


def _lag(u: Array, dt: float, tau: float) -> Array:
    from scipy.signal import lfilter

    a = float(np.exp(-dt / tau))
    return np.asarray(lfilter([1 - a], [1, -a], u, zi=[a * u[0]])[0])


def _design(c: Clean) -> Array:
    slow = max(0.03 * float(np.sqrt(np.mean(c.v**2))), 1e-9)
    columns = [c.a, c.v, np.ones(c.v.size), np.tanh(c.v / slow), np.sin(c.q), np.cos(c.q)]
    return np.asarray(np.array(columns).T[:: c.step])


def _regress(logs: Sequence[Clean], has_effort: bool) -> dict[str, float]:
    """Inertia and viscous friction by least squares with dry friction and gravity beside them, so that they are not biased."""
    if not has_effort:
        return {"inertia": 1.0, "viscous": 1.0}
    use = [c for c in logs if c.effort is not None]
    x = np.concatenate([_design(c) for c in use])
    y = np.concatenate([c.effort[:: c.step] for c in use if c.effort is not None])
    norm = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    beta = (
        np.linalg.lstsq(
            np.vstack([x / norm, 1e-3 * np.eye(6) * np.sqrt(len(x))]), np.append(y, np.zeros(6)), rcond=None
        )[0]
        / norm
    )
    size, speed = float(np.sqrt(np.mean(y**2))), float(np.sqrt(np.mean(x[:, 1] ** 2)))
    acceleration = float(np.sqrt(np.mean(x[:, 0] ** 2)))
    inertia = float(beta[0]) if beta[0] > 0 else 0.1 * size / max(acceleration, 1e-9)
    return {"inertia": max(inertia, 1e-3 * size / max(acceleration, 1e-9)),
            "viscous": max(float(beta[1]), 0.01 * size / max(speed, 1e-9))}  # fmt: skip


def _waves(logs: Sequence[Clean], nominal: Mapping[str, float], count: int = 3) -> list[float]:
    """Spatial frequencies (per rad) where the effort's residual has most power, by least squares on a grid."""
    use = [c for c in logs if c.effort is not None]
    x = np.concatenate([_design(c) for c in use])
    y = np.concatenate([c.effort[:: c.step] for c in use if c.effort is not None])
    q = np.concatenate([c.q[:: c.step] for c in use])
    r = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    travel = max(float(np.ptp(q)), 1e-3)
    grid = np.arange(max(2.5, 1.5 * 2 * np.pi / travel), 400.0, 0.5 / travel)[:6000]
    stride = max(1, q.size // 4000)
    qs, rs = q[::stride], r[::stride]
    power = np.array([np.abs(np.sum(rs * np.exp(-1j * w * qs))) for w in grid])
    chosen: list[float] = []
    for k in np.argsort(-power):
        if all(abs(grid[k] - w) > 2.0 * 2 * np.pi / travel for w in chosen):
            chosen.append(float(grid[k]))
        if len(chosen) == count:
            break
    del nominal
    return chosen or [8.0]
