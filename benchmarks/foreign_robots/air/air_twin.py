"""Twin of a pneumatic cylinder with a proportional valve: command, chamber pressures, piston,
contact with a workpiece.

The valve's flow is that of ISO 6358 (critical pressure ratio and sonic conductance); the chambers
are isothermal unless the effect ``heat`` says otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from foreign_robots.twin_tools import (
    Array,
    BlockCache,
    effect,
    lagged,
    magnitude,
    nuisance,
    packed,
    smoothed,
)
from pianobot_ros.gap import Block, Observable, Signal, Stage

AREA = 1.0e-3  # m²
STROKE = 0.12  # m
STOP = 0.119  # m
GAS = 84000.0  # J/kg, gas constant times temperature
ATMOSPHERE = 1.0e5  # Pa
WORKPIECE = 0.08  # m, where the piston meets it
CRITICAL_RATIO = 0.3
SWITCH_PRESSURE = 2.5e5  # Pa
EDGE = 8  # samples at either end where smoothing is poor
HORIZON = 40  # samples
WHOLE_BLOCK = 10**6  # samples
GAS_STEPS, PISTON_STEPS = 5, 8  # a sample


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def valve_flow(conductance: float, upstream: float, downstream: float) -> float:
    """Mass flow (kg/s) by conductance (kg/s/Pa) and pressures (Pa); linear at small differences."""
    if downstream >= upstream:
        return 0.0
    x = (downstream / upstream - CRITICAL_RATIO) / (1 - CRITICAL_RATIO)
    if x <= 0:
        return conductance * upstream
    z = 1 - x * x
    if z > 0.01:
        return conductance * upstream * math.sqrt(z)
    return conductance * upstream * 0.1 * (1 - x) / 0.00501256


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def valve_flows(u: float, pa: float, pb: float, gas: Array, size: Array) -> tuple[float, float]:
    """Flows into both chambers (kg/s) by the spool's opening (-1 to 1) and pressures (Pa)."""
    supply_conductance, exhaust_conductance, supply = gas[0], gas[1], gas[2]
    band, droop = size[0], size[1]
    if band > 0:
        u = math.copysign(max(0.0, abs(u) - band), u)
    if u > 0:
        s = supply - droop * valve_flow(supply_conductance * u, supply, pa)
        return (
            valve_flow(supply_conductance * u, s, pa),
            -valve_flow(exhaust_conductance * u, pb, ATMOSPHERE),
        )
    s = supply - droop * valve_flow(-supply_conductance * u, supply, pb)
    return (
        -valve_flow(-exhaust_conductance * u, pa, ATMOSPHERE),
        valve_flow(-supply_conductance * u, s, pb),
    )


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def chamber_pressures(
    t: Array, command: Array, x: Array, v: Array, first: Array, gas: Array, size: Array
) -> tuple[Array, Array]:
    """Pressures (Pa) of both chambers by command and measured motion (m, m/s)."""
    dead_volume, leak, polytropic = gas[3], size[2], size[3]
    out_a, out_b = np.empty(t.size), np.empty(t.size)
    pa, pb = first[0], first[1]
    dt = t[1] - t[0]
    h = dt / GAS_STEPS
    for k in range(t.size):
        out_a[k] = pa
        out_b[k] = pb
        if k == t.size - 1:
            break
        for j in range(GAS_STEPS):
            f = (j + 0.5) / GAS_STEPS
            u = command[k] + (command[k + 1] - command[k]) * f
            place = x[k] + (x[k + 1] - x[k]) * f
            speed = v[k] + (v[k + 1] - v[k]) * f
            flow_a, flow_b = valve_flows(u, pa, pb, gas, size)
            leaking = leak * (pa - pb)
            exponent = 1 + polytropic
            volume_a = dead_volume + AREA * place
            volume_b = dead_volume + AREA * (STROKE - place)
            pa += h * exponent * (GAS * (flow_a - leaking) - pa * AREA * speed) / volume_a
            pb += h * exponent * (GAS * (flow_b + leaking) + pb * AREA * speed) / volume_b
            pa = max(pa, 2e4)
            pb = max(pb, 2e4)
    return out_a, out_b


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def resisting_force(x: float, v: float, dp: float, piston: Array, size: Array) -> float:
    """Force (N) against the piston: viscous, friction, cushion and workpiece."""
    friction, by_pressure, cushion = size[0], size[1], size[2]
    force = piston[1] * v + (friction + by_pressure * abs(dp)) * math.tanh(v / 0.005)
    if cushion > 0 and x > 0.05 and v > 0:
        force += cushion * v * (x - 0.05) / 0.03
    if x > WORKPIECE:
        force += piston[2] * (x - WORKPIECE) + 200.0 * v
    return float(force)


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def piston_motion(
    t: Array, dp: Array, x0: Array, v0: Array, span: int, piston: Array, size: Array
) -> Array:
    """Positions (m) by measured pressures, from the measured state every ``span`` samples; ``dp``
    (2, n) holds both pressures (Pa).
    """
    pa, pb = dp[0], dp[1]
    out = np.empty(t.size)
    dt = t[1] - t[0]
    h = dt / PISTON_STEPS
    x, v = x0[0], v0[0]
    for k in range(t.size):
        if k % span == 0:
            x, v = x0[k], v0[k]
        out[k] = x
        if k == t.size - 1:
            break
        for j in range(PISTON_STEPS):
            f = (j + 0.5) / PISTON_STEPS
            difference = pa[k] - pb[k] + (pa[k + 1] - pb[k + 1] - pa[k] + pb[k]) * f
            force = difference * AREA
            before = v
            coulomb = size[0] + size[1] * abs(difference)
            if coulomb > 0 and abs(v) < 1e-3 and abs(force) < coulomb:
                v = 0.0
            else:
                against = resisting_force(x, before, difference, piston, size)
                v = before + h * (force - against) / piston[0]
                if coulomb > 0 and before * v < 0:
                    v = 0.0
            x += h * (v + before) / 2
            if x < 0:
                x = 0.0
                v = max(v, 0.0)
            if x > STOP:
                x = STOP
                v = min(v, 0.0)
    return out


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def first_crossing(t: Array, y: Array, level: float) -> float:
    """When ``y`` first rises through the level (s), NaN if it does not."""
    for k in range(1, y.size):
        if y[k - 1] < level <= y[k]:
            return float(t[k - 1] + (t[k] - t[k - 1]) * (level - y[k - 1]) / (y[k] - y[k - 1]))
    return np.nan


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def pressure_of_motion(
    x: Array, v: Array, a: Array, dp: Array, piston: Array, size: Array
) -> Array:
    """Pressure difference (Pa) that a motion takes."""
    out = np.empty(x.size)
    for k in range(x.size):
        out[k] = (piston[0] * a[k] + resisting_force(x[k], v[k], dp[k], piston, size)) / AREA
    return out


class CylinderSignals(NamedTuple):
    """What a block says, in SI units; pressures (2, n) of both chambers, and at the start (2,)."""

    t: Array
    dt: float
    command_t: Array
    command: Array
    position: Array
    speed: Array
    acceleration: Array
    pressures: Array
    first_pressures: Array
    events: frozenset[str]


def signals_of(block: Block) -> CylinderSignals:
    """The signals, motion smoothed."""
    outputs, command = block.outputs, block.inputs["u"]
    t, x = outputs["x"].t, outputs["x"].y
    dt = float(t[1] - t[0])
    chambers = [outputs[n].y for n in ("pa", "pb")]
    return CylinderSignals(
        t,
        dt,
        command.t,
        command.y,
        smoothed(x, dt, 0, 11),
        smoothed(x, dt, 1, 11),
        smoothed(x, dt, 2, 13),
        np.array(chambers),
        np.array([float(y[:6].mean()) for y in chambers]),
        frozenset(block.events),
    )


def resting(s: CylinderSignals) -> NDArray[np.bool_]:
    """Samples (n,) where friction and contact hide the load: ends of the stroke and standstill."""
    x = s.position
    at_end = np.convolve((x < 0.002) | (x > WORKPIECE - 0.002), np.ones(15), "same") > 0
    rest = at_end | (np.abs(s.speed) < 0.004) | (x > WORKPIECE - 0.004)
    rest[:EDGE] = rest[-EDGE:] = True
    return np.asarray(rest)


class CylinderTwin:
    """Pressures from the command, travel from pressures, load from travel."""

    stages = (Stage("valve"), Stage("chambers"), Stage("piston"), Stage("sensors"))
    observables = (
        Observable("pressure_a", "chambers", "pa", "Pa", floor_hint=300.0, tolerance=1000.0),
        Observable("pressure_b", "chambers", "pb", "Pa", floor_hint=300.0, tolerance=1000.0),
        Observable("switch", "valve", "switch", "s", kind="event", floor_hint=8e-4, tolerance=8e-4),
        Observable("travel", "piston", "x", "m", floor_hint=2e-5, tolerance=2e-4),
        Observable(
            "travel_short", "piston", "x", "m", mode="horizon", floor_hint=2e-5, tolerance=1e-4
        ),
        Observable(
            "load", "piston", "dp", "Pa", mode="inverse", floor_hint=500.0, tolerance=2000.0
        ),
        Observable(
            "contact", "piston", "contact", "s", kind="event", floor_hint=2e-4, tolerance=5e-4
        ),
    )
    parameters = (
        nuisance("cs", 2.4e-8, "kg/s/Pa", "valve"),
        nuisance("ce", 2.0e-8, "kg/s/Pa", "valve"),
        nuisance("ps", 6.0e5, "Pa", "valve", 0.05),
        nuisance("vd", 2.0e-5, "m3", "chambers"),
        nuisance("M", 6.0, "kg", "piston"),
        nuisance("b", 60.0, "N s/m", "piston"),
        nuisance("kw", 5.0e4, "N/m", "piston"),
    )
    effects = (
        effect(
            "valve_delay",
            "valve",
            magnitude("delay", 0.01, 0.1, "s"),
            (0.003, 0.012),
            "the valve answers late",
        ),
        effect(
            "valve_deadband",
            "valve",
            magnitude("band", 0.03, 0.6, "1"),
            (0.005, 0.02, 0.1),
            "overlap of the spool",
        ),
        effect(
            "supply_droop",
            "valve",
            magnitude("droop", 1e7, 2e8, "Pa s/kg"),
            (2e6, 1.5e7),
            "supply pressure falls with flow",
        ),
        effect(
            "leak",
            "chambers",
            magnitude("leak", 3e-10, 2e-8, "kg/s/Pa"),
            (1e-10, 1e-9),
            "leak past the piston",
        ),
        effect(
            "heat",
            "chambers",
            magnitude("poly", 0.15, 0.5, "1"),
            (0.05, 0.25),
            "polytropic instead of isothermal",
        ),
        effect(
            "pressure_lag",
            "sensors",
            magnitude("plag", 0.006, 0.08, "s"),
            (0.002, 0.01),
            "pressure sensors lag",
        ),
        effect(
            "friction",
            "piston",
            magnitude("fc", 15.0, 200, "N"),
            (4.0, 25.0),
            "Coulomb friction",
        ),
        effect(
            "seal_friction",
            "piston",
            magnitude("fp", 1e-4, 1e-3, "N/Pa"),
            (2e-5, 1e-4),
            "friction that grows with pressure difference",
        ),
        effect(
            "cushion",
            "piston",
            magnitude("cush", 150.0, 3000, "N s/m"),
            (40.0, 250.0),
            "damping before the workpiece",
        ),
    )

    def __init__(self) -> None:
        self.signals = BlockCache(signals_of)

    def simulate(
        self, blocks: Sequence[Block], values: Mapping[str, float], effects: Sequence[str]
    ) -> list[dict[str, Array | float]]:
        """Pressures, travel and load of every block, and when it switches and makes contact."""
        gas = packed(values, "cs", "ce", "ps", "vd")
        gas_size = packed(values, "band", "droop", "leak", "poly")
        piston, size = packed(values, "M", "b", "kw"), packed(values, "fc", "fp", "cush")
        delay, lag = packed(values, "delay", "plag")
        out = []
        for s in map(self.signals, blocks):
            x, v = s.position, s.speed
            command = np.interp(s.t - delay, s.command_t, s.command)
            a, b = chamber_pressures(s.t, command, x, v, s.first_pressures, gas, gas_size)
            a, b = lagged(a, s.dt, lag), lagged(b, s.dt, lag)
            true = s.pressures
            if lag:  # the true pressures are ahead of the measured ones
                true = true + lag * np.array([smoothed(p, s.dt, 1, 11) for p in true])
            travel = piston_motion(s.t, true, x, v, WHOLE_BLOCK, piston, size)
            load = pressure_of_motion(x, v, s.acceleration, true[0] - true[1], piston, size)
            load = lagged(load, s.dt, lag)
            load[resting(s)] = np.nan
            predicted: dict[str, Array | float] = {
                "pressure_a": a,
                "pressure_b": b,
                "travel": travel,
                "travel_short": piston_motion(s.t, true, x, v, HORIZON, piston, size),
                "load": load,
            }
            if "switch" in s.events:
                predicted["switch"] = first_crossing(s.t, a, SWITCH_PRESSURE)
            if "contact" in s.events:
                predicted["contact"] = first_crossing(s.t, travel, WORKPIECE)
            out.append(predicted)
        return out

    def features(self, block: Block) -> dict[str, Signal]:
        """Motion, pressures, command and time."""
        s = self.signals(block)
        return {
            "position": Signal(s.t, s.position),
            "speed": Signal(s.t, s.speed),
            "acceleration": Signal(s.t, s.acceleration),
            "pressure a": block.outputs["pa"],
            "pressure b": block.outputs["pb"],
            "command": block.inputs["u"],
            "time": Signal(s.t, s.t),
        }
