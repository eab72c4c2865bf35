"""The cylinder itself: Heun's rule at 0.1 ms, other laws than the twin's.

Valve flow by ISO 6358 like the twin's; bristles are LuGre's (Canudas de Wit and others 1995) with
their damping left out, exact in travelled distance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numba import njit

from foreign_robots.plant_tools import (
    Array,
    PlantLaw,
    correlated_noise,
    delay_and_lag,
    polled,
    second_order_lag,
    session,
    sizes_by_place,
    smooth_step,
    stepping_times,
)
from pianobot_ros.gap import Block, Signal

SAMPLE, SAMPLES, STEP = 0.0025, 180, 0.0001  # s, 1, s
AREA, STROKE, STOP, WORKPIECE = 1.0e-3, 0.12, 0.119, 0.08  # m², m, m, m
GAS, ATMOSPHERE, CRITICAL_RATIO = 84000.0, 1.0e5, 0.3  # J/kg, Pa, 1
SWITCH_PRESSURE = 2.5e5  # Pa
PARAMETERS = ("cs", "ce", "ps", "vd", "M", "b", "kw")
RETRACTING = 5  # the condition that retracts

LAWS = {
    "polled_valve": PlantLaw("valve_delay", 0.0002, 0.05, "valve island polls the command every T"),
    "spool_second_order": PlantLaw("valve_delay", 0.0006, 0.05, "second-order spool"),
    "overlap_quadratic": PlantLaw(
        "valve_deadband", 0.0002, 0.5, "overlap that opens quadratically"
    ),
    "overlap_asymmetric": PlantLaw(
        "valve_deadband", 0.0002, 0.4, "overlap wider towards retract, jump behind it"
    ),
    "reservoir": PlantLaw("supply_droop", 0.3, 300, "small reservoir that empties and refills"),
    "regulator": PlantLaw(
        "supply_droop", 1e5, 3e8, "regulator droop with 20 ms lag, square root of flow"
    ),
    "leak_orifice": PlantLaw(
        "leak", 1e-11, 3e-8, "leak past the piston as an orifice (square root)"
    ),
    "leak_laminar": PlantLaw(
        "leak", 1e-11, 3e-8, "laminar compressible leak (difference of squares)"
    ),
    "heat_to_wall": PlantLaw("heat", 0.003, 0.4, "gas temperature with heat loss to the wall"),
    "heat_by_direction": PlantLaw("heat", 0.003, 0.6, "expansion adiabatic, filling less so"),
    "second_order_sensors": PlantLaw("pressure_lag", 0.0002, 0.06, "second-order pressure sensors"),
    "sensor_tube": PlantLaw("pressure_lag", 0.0002, 0.06, "tube: half delay, half lag"),
    "bristles": PlantLaw("friction", 0.2, 120, "LuGre with Stribeck"),
    "friction_asymmetric": PlantLaw("friction", 0.2, 120, "Stribeck, larger when retracting"),
    "cushion_orifice": PlantLaw("cushion", 2, 40000, "cushion orifice: speed squared beyond 55 mm"),
    "cushion_exponential": PlantLaw(
        "cushion", 2, 8000, "viscous cushion, exponential from 45 mm on"
    ),
    "rail_bump": PlantLaw("unknown:jam", 0.3, 150, "rail bump from 25 to 40 mm"),
    "hose": PlantLaw("unknown:hose", 5, 9000, "hose that pulls back by position squared"),
    "whistle": PlantLaw("unknown:whistle", 0.5, 200, "25 Hz force on its own clock"),
    "compressor_dips": PlantLaw(
        "unknown:pulse", 1000, 2e5, "compressor dips: supply falls at fixed times after start"
    ),
}
(
    POLLED_VALVE,
    SPOOL_SECOND_ORDER,
    OVERLAP_QUADRATIC,
    OVERLAP_ASYMMETRIC,
    RESERVOIR,
    REGULATOR,
    LEAK_ORIFICE,
    LEAK_LAMINAR,
    HEAT_TO_WALL,
    HEAT_BY_DIRECTION,
    SECOND_ORDER_SENSORS,
    SENSOR_TUBE,
    BRISTLES,
    FRICTION_ASYMMETRIC,
    CUSHION_ORIFICE,
    CUSHION_EXPONENTIAL,
    RAIL_BUMP,
    HOSE,
    WHISTLE,
    COMPRESSOR_DIPS,
) = range(len(LAWS))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def valve_flow(conductance: float, upstream: float, downstream: float) -> float:
    """Mass flow (kg/s) by conductance (kg/s/Pa) and pressures (Pa)."""
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
def spool_opening(u: float, size: Array) -> float:
    """The valve's opening (-1 to 1) behind its overlap."""
    if size[OVERLAP_QUADRATIC] > 0:
        a = abs(u)
        w = size[OVERLAP_QUADRATIC]
        opening = 0.0
        if a > 1.4 * w:
            opening = min((a - 0.6 * w) ** 2 / (0.8 * w), a - w)
        elif a > 0.6 * w:
            opening = (a - 0.6 * w) ** 2 / (1.6 * w)
        return math.copysign(opening, u)
    if size[OVERLAP_ASYMMETRIC] > 0:
        w = size[OVERLAP_ASYMMETRIC] if u > 0 else 1.4 * size[OVERLAP_ASYMMETRIC]
        a = abs(u)
        return math.copysign(a - 0.85 * w, u) if a > w else 0.0
    return u


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def supply_pressure(supply: float, missing: float, time: float, size: Array) -> float:
    """Pressure (Pa) before the valve; ``missing`` is what reservoir or regulator lack of it."""
    if size[RESERVOIR] > 0 or size[REGULATOR] > 0:
        supply = supply - missing
    if size[COMPRESSOR_DIPS] > 0:
        dips = math.exp(-(((time - 0.12) / 0.02) ** 2)) + math.exp(-(((time - 0.3) / 0.02) ** 2))
        supply = supply - size[COMPRESSOR_DIPS] * dips
    return supply


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def leak_flow(pa: float, pb: float, size: Array) -> float:
    """Flow (kg/s) past the piston from chamber a to b."""
    if size[LEAK_ORIFICE] > 0:
        difference = abs(pa - pb)
        orifice = size[LEAK_ORIFICE] * math.copysign(math.sqrt(difference * 2e5), pa - pb)
        return float(orifice * difference / (difference + 5e3))
    if size[LEAK_LAMINAR] > 0:
        return float(size[LEAK_LAMINAR] * (pa * pa - pb * pb) / 6e5)
    return 0.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def resisting_force(
    x: float, v: float, z: float, time: float, phase: float, piston: Array, size: Array
) -> float:
    """Force (N) against the piston at a place (m) and a speed (m/s)."""
    force = piston[1] * v
    if size[BRISTLES] > 0:
        force += size[BRISTLES] * (0.85 + 0.4 * math.exp(-((v / 0.03) ** 2))) * z
    if size[FRICTION_ASYMMETRIC] > 0:
        side = size[FRICTION_ASYMMETRIC] * (1.0 if v > 0 else 1.3)
        force += side * (0.9 + 0.5 * math.exp(-abs(v) / 0.03)) * z
    if size[CUSHION_ORIFICE] > 0 and x > 0.055 and v > 0:
        force += size[CUSHION_ORIFICE] * v * v * (x - 0.055) / 0.025
    if size[CUSHION_EXPONENTIAL] > 0 and x > 0.045 and v > 0:
        force += size[CUSHION_EXPONENTIAL] * v * (math.exp((x - 0.045) / 0.015) - 1) / 9
    if size[RAIL_BUMP] > 0 and 0.025 < x < 0.040:
        bump = size[RAIL_BUMP] * math.sin(math.pi * (x - 0.025) / 0.015)
        force += bump * math.tanh(v / 0.01)
    if size[HOSE] > 0:
        force += size[HOSE] * (x - 0.01) * abs(x - 0.01) * 3
    if size[WHISTLE] > 0:
        force += size[WHISTLE] * math.sin(2 * math.pi * 25 * time + phase)
    if x > WORKPIECE:
        force += piston[2] * (x - WORKPIECE) + 200.0 * v
    return float(force)


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def supply_rate(flow: float, missing: float, size: Array) -> float:
    """How fast (Pa/s) the pressure that the supply lacks grows with the flow (kg/s) drawn."""
    if size[RESERVOIR] > 0:
        return float(size[RESERVOIR] * 1e5 * flow * 10 / 1.0 - missing / 0.08)
    if size[REGULATOR] > 0:
        return float((size[REGULATOR] * math.sqrt(max(flow, 0.0) * 0.005) - missing) / 0.02)
    return 0.0


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def valve_flows(
    u: float, pa: float, pb: float, supply: float, gas: Array
) -> tuple[float, float, float]:
    """Flows (kg/s) into both chambers and from the supply."""
    if u > 0:
        drawn = valve_flow(gas[0] * u, supply, pa)
        return drawn, -valve_flow(gas[1] * u, pb, ATMOSPHERE), drawn
    drawn = valve_flow(-gas[0] * u, supply, pb)
    return -valve_flow(-gas[1] * u, pa, ATMOSPHERE), drawn, drawn


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def rates(
    state: Array,
    command: float,
    cylinder: Array,
    size: Array,
    bristles: float,
    disturbance: float,
    time: float,
    phase: float,
    out: Array,
) -> None:
    """Time derivatives of both pressures (Pa), place (m), speed (m/s), what the supply lacks (Pa)
    and both chambers' relative excess of temperature, into ``out``.
    """
    dead_volume = cylinder[3]
    pa, pb, x, v, missing = state[0], state[1], state[2], state[3], state[4]
    u = spool_opening(command, size)
    supply = supply_pressure(cylinder[2], missing, time, size)
    flow_a, flow_b, drawn = valve_flows(u, pa, pb, supply, cylinder)
    out[4] = supply_rate(drawn, missing, size)
    leak = leak_flow(pa, pb, size)
    volume_a = dead_volume + AREA * x
    volume_b = dead_volume + AREA * (STROKE - x)
    rate_a = (GAS * (flow_a - leak) - pa * AREA * v) / volume_a
    rate_b = (GAS * (flow_b + leak) + pb * AREA * v) / volume_b
    out[5] = out[6] = 0.0
    if size[HEAT_TO_WALL] > 0:
        out[5] = size[HEAT_TO_WALL] * rate_a / pa - state[5] / 0.06
        out[6] = size[HEAT_TO_WALL] * rate_b / pb - state[6] / 0.06
        rate_a = rate_a + pa * out[5]
        rate_b = rate_b + pb * out[6]
    exponent_a = exponent_b = 1.0
    if size[HEAT_BY_DIRECTION] > 0:
        exponent_a = 1 + size[HEAT_BY_DIRECTION] * (1.0 if v > 0 else 0.4)
        exponent_b = 1 + size[HEAT_BY_DIRECTION] * (1.0 if v < 0 else 0.4)
    out[0] = exponent_a * rate_a
    out[1] = exponent_b * rate_b
    force = (pa - pb) * AREA + disturbance
    against = resisting_force(x, v, bristles, time, phase, cylinder[4:], size)
    out[2] = v
    out[3] = (force - against) / cylinder[4]


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def stroke(
    command: Array, disturbance: Array, cylinder: Array, size: Array, start: Array, phase: float
) -> Array:
    """Pressures (Pa), place (m) and speed (m/s), (4, n), at every step from the state ``start``
    (7,), by command (-1 to 1) and disturbing force (N).
    """
    h = STEP
    out = np.zeros((4, command.size))
    k1, k2 = np.zeros(7), np.zeros(7)
    y = start
    z = 0.0
    spool, spool_speed = command[0], 0.0
    for k in range(command.size):
        u = command[k]
        if size[SPOOL_SECOND_ORDER] > 0:
            w = 2 / size[SPOOL_SECOND_ORDER]
            spool_speed += h * (w * w * (command[k] - spool) - 2 * 0.9 * w * spool_speed)
            spool += h * spool_speed
            u = spool
        out[0, k], out[1, k], out[2, k], out[3, k] = y[0], y[1], y[2], y[3]
        rates(y, u, cylinder, size, z, disturbance[k], k * h, phase, k1)
        rates(y + h * k1, u, cylinder, size, z, disturbance[k], k * h + h, phase, k2)
        y = y + 0.5 * h * (k1 + k2)
        if y[2] < 0:
            y[2] = 0.0
            y[3] = max(y[3], 0.0)
        if y[2] > STOP:
            y[2] = STOP
            y[3] = min(y[3], 0.0)
        if y[3] != 0:
            s = math.copysign(1.0, y[3])
            z = s + (z - s) * math.exp(-abs(y[3]) * h / 0.0005)
    return out


# Where the piston starts (m), by condition.
STARTS = (0.01, 0.01, 0.01, 0.01, 0.02, 0.075, 0.04, 0.015)


def commanded(t: Array, condition: int) -> Array:
    """The valve's command (-1 to 1) of a stroke."""
    sine = np.sin(2 * np.pi * 4 * (t - 0.03))
    up = smooth_step(t, 0.03, 0.02)
    there = 0.7 * smooth_step(t, 0.03, 0.05) - 0.9 * smooth_step(t, 0.2, 0.05)
    return [
        0.5 * up,
        0.8 * up,
        1.0 * up,
        0.35 * smooth_step(t, 0.03, 0.2),
        0.9 * up - 1.6 * smooth_step(t, 0.14, 0.03),
        -0.6 * up,
        0.4 * sine * smooth_step(t, 0.03, 0.05),
        there + 0.6 * smooth_step(t, 0.33, 0.04),
    ][condition]


def record(
    parameters: Mapping[str, float], effects: Mapping[str, float], seed: int, repeats: int = 4
) -> list[Block]:
    """Blocks of every condition, ``repeats`` times, with these laws at these sizes."""
    size, t = sizes_by_place(LAWS, effects), stepping_times(SAMPLES, SAMPLE, STEP)
    return session(record_stroke, parameters, size, t, seed, len(STARTS), repeats)


def risen(t: Array, y: Array, level: float) -> float:
    """The first stamp (s) at which ``y`` has risen to the level, NaN if it does not."""
    up = np.flatnonzero((y[1:] >= level) & (y[:-1] < level))
    return float(t[up[0] + 1]) if up.size else float("nan")


def record_stroke(
    parameters: Mapping[str, float],
    size: Array,
    t: Array,
    which: tuple[int, int],
    seed: tuple[int, int],
) -> Block:
    """One block: ``which`` repeat and condition, with noise by ``seed``."""
    repeat, condition = which
    random, random_of_laws = np.random.default_rng(seed), np.random.default_rng([*seed, 7])
    command = commanded(t, condition)
    received = command
    if size[POLLED_VALVE]:
        received = polled(t, command, size[POLLED_VALVE], random_of_laws.uniform())
    cylinder = np.array([parameters[n] for n in PARAMETERS])
    cylinder[2] *= 1 + 0.004 * random.standard_normal()
    cylinder[5] *= 1 + 0.03 * random.standard_normal()
    disturbance = correlated_noise(random, t.size, STEP, 0.8, 0.05)
    disturbance = disturbance + 0.4 * random.standard_normal()
    start = np.zeros(7)
    start[0] = start[1] = 2.0e5 * (1 + 0.01 * random.standard_normal())
    start[2] = STARTS[condition] + 0.0003 * random.standard_normal()
    phase = random_of_laws.uniform(0, 6.28)
    pa, pb, place, _ = stroke(received, disturbance, cylinder, size, start, phase)
    if tau := size[SECOND_ORDER_SENSORS]:
        pa, pb = second_order_lag(pa, STEP, tau), second_order_lag(pb, STEP, tau)
    if tau := size[SENSOR_TUBE]:
        pa, pb = delay_and_lag(pa, STEP, tau), delay_and_lag(pb, STEP, tau)
    every = round(SAMPLE / STEP)
    stamps = t[::every]
    seen_a, seen_b, seen_x = (
        y[::every] + sd * random.standard_normal(SAMPLES)
        for y, sd in ((pa, 800), (pb, 800), (place, 2e-5))
    )
    events = {}
    if condition != RETRACTING:  # it only grazes the levels
        for name, y, level, sd in (
            ("switch", pa, SWITCH_PRESSURE, 2e-4),
            ("contact", place, WORKPIECE, 3e-4),
        ):
            time = risen(t, y, level)
            events[name] = time if np.isnan(time) else time + sd * random.standard_normal()
    return Block(
        f"{condition}.{repeat}",
        f"stroke{condition}",
        {"u": Signal(stamps, command[::every], "1")},
        {
            "pa": Signal(stamps, seen_a, "Pa"),
            "pb": Signal(stamps, seen_b, "Pa"),
            "x": Signal(stamps, seen_x, "m"),
            "dp": Signal(stamps, seen_a - seen_b, "Pa"),
        },
        events=events,
        attributes={"command": float(np.abs(command).max()), "start": STARTS[condition]},
    )
