"""A second axis, to test the diagnosis with: other laws, a finer step, its own noise. It shares no
code with the twin.

Dry friction is a LuGre bristle, elasticity and backlash are two masses with a (dead-zone) spring,
delay is a queue of control ticks, the torque limit is soft, heating is exponential, cogging has a
harmonic and hysteresis is a set of Maxwell slip elements. Effects that the library lacks are in
`LEFT_OUT`.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array

STEP = 2e-4

IN_LIBRARY = (
    "command_delay",
    "command_lag",
    "deadband",
    "torque_limit",
    "torque_droop",
    "coulomb",
    "stribeck",
    "load_friction",
    "asymmetric_friction",
    "gravity",
    "cogging",
    "hysteresis",
    "backlash",
    "elasticity",
    "position_offset",
    "encoder_ripple",
    "sensor_latency",
    "clock_skew",
)
LEFT_OUT = (
    "quadratic_drag",
    "end_stop",
    "mains_torque",
    "sticky_sector",
    "lost_packets",
    "gain_dropout",
)
"""What the axis' library lacked when these were written; it has an *end_stop* by now."""
_SLOTS = (
    "J",
    "b",
    "wn",
    "zeta",
    "ff",
    "ki",
    "level",
    "static",
    "vs",
    "mu",
    "asym",
    "grav",
    "grav_angle",
    "cog",
    "cog_n",
    "cog_ph",
    "slip",
    "slip_d",
    "gap",
    "freq",
    "share",
    "soft_limit",
    "dead",
    "drag",
    "stop_at",
    "stop_k",
    "mains",
    "mains_hz",
    "sector",
    "sector_at",
    "sector_w",
    "dropout",
)
_I = {n: i for i, n in enumerate(_SLOTS)}
(
    _J,
    _B,
    _WN,
    _Z,
    _FF,
    _KI,
    _LEV,
    _STA,
    _VS,
    _MU,
    _AS,
    _GR,
    _GA,
    _CO,
    _CN,
    _CP,
    _SL,
    _SD,
    _GAP,
    _FR,
    _SH,
    _LIM,
    _DEAD,
    _DRAG,
    _STOP,
    _SK,
    _MA,
    _MH,
    _SEC,
    _SECA,
    _SECW,
    _DROP,
) = range(len(_SLOTS))


@dataclass(frozen=True)
class Axis:
    """A robot joint: inertia kg m², viscous Nm s/rad, position loop; `kt` Nm per A converts to the
    logged current.
    """

    inertia: float = 0.02
    viscous: float = 0.05
    bandwidth: float = 30.0
    damping: float = 0.8
    feedforward: float = 0.7
    integral: float = 2.0
    kt: float = 1.0
    encoder: float = 2e-5
    current_noise: float = 0.01
    variation: float = 0.004


@dataclass(frozen=True)
class PlantLog:
    """What the plant logs: (n,) each, with the truth beside it."""

    t: Array
    command: Array
    position: Array
    velocity: Array
    current: Array
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def write(self, path: str | Path, drop: tuple[str, ...] = ()) -> None:
        """Write as CSV without the columns in `drop`."""
        columns = {
            "time": self.t,
            "target_position": self.command,
            "position": self.position,
            "velocity": self.velocity,
            "current_A": self.current,
        }
        kept = {k: v for k, v in columns.items() if k not in drop}
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(kept)
            writer.writerows(
                [[f"{x:.7g}" for x in row] for row in zip(*kept.values(), strict=True)]
            )


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _run(u: Array, du: Array, h: float, p: Array, kick: Array) -> tuple[Array, Array, Array]:  # noqa: PLR0912, PLR0915
    n = u.size
    pos, vel, eff = np.empty(n), np.empty(n), np.empty(n)
    q, v = u[0], 0.0
    share = p[_SH]
    two = p[_FR] > 0 or p[_GAP] > 0
    if not two:
        share = 0.0
    jm, jl = p[_J] * (1 - share), p[_J] * share
    k = jl * (2 * math.pi * p[_FR]) ** 2 if p[_FR] > 0 else jl * (2 * math.pi * 60.0) ** 2
    damp = 2 * 0.06 * math.sqrt(max(k * jl, 1e-30))
    ql, vl, z, total = q, 0.0, 0.0, 0.0
    slips = np.zeros(6)
    for i in range(n):
        error = u[i] - q
        if abs(error) < 0.5 * p[_DEAD]:
            error = 0.0
        elif p[_DEAD] > 0:
            error -= math.copysign(0.5 * p[_DEAD], error)
        total += h * error
        kp = p[_J] * p[_WN] ** 2
        if p[_DROP] > 0 and math.sin(7.3 * i * h) > 1 - p[_DROP]:
            kp *= 0.3
        effort = kp * (error + p[_KI] * total) + 2 * p[_Z] * p[_WN] * p[_J] * (p[_FF] * du[i] - v)
        if p[_LIM] > 0:
            effort = p[_LIM] * math.tanh(effort / p[_LIM] * (1 + 0.15 * abs(effort) / p[_LIM]))
        pos[i], vel[i], eff[i] = q, v, effort
        field = p[_GR] * math.sin(q - p[_GA])
        field += p[_CO] * (math.sin(p[_CN] * q + p[_CP]) + 0.2 * math.sin(2 * p[_CN] * q))
        outer = field
        if q > p[_STOP]:
            outer += p[_SK] * (q - p[_STOP]) ** 2
        outer += p[_MA] * math.sin(2 * math.pi * p[_MH] * i * h) + p[_DRAG] * v * abs(v)
        hysteresis = 0.0
        if p[_SL] > 0:  # Maxwell slip: six springs that slide at different stretches
            for s in range(6):
                reach = p[_SD] * (s + 1) / 3.5
                slips[s] = min(max(slips[s] + h * v, -reach), reach)
                hysteresis += p[_SL] / 6 * slips[s] / reach
        load = abs(effort - p[_B] * v)
        level = p[_LEV] + p[_MU] * load
        if p[_SEC] > 0:
            level += p[_SEC] * math.exp(-(((q - p[_SECA]) / p[_SECW]) ** 2))
        friction = 0.0
        if level + p[_AS] > 0 or p[_STA] > 0 or p[_AS] != 0:  # LuGre
            g = level + p[_AS] * (1.0 if v > 0 else -1.0) + p[_STA] * math.exp(-abs(v / p[_VS]))
            g = max(g, 1e-9)
            sigma0 = g / 4e-4
            before = z
            z = (z + h * v) / (1.0 + h * abs(v) * sigma0 / g)  # implicit: stable at any speed
            dz = (z - before) / h
            friction = sigma0 * z + 0.3 * math.sqrt(sigma0 * p[_J]) * dz * math.exp(
                -abs(v) / max(p[_VS], 1e-6)
            )
        if two:
            stretch = q - ql
            half = 0.5 * p[_GAP]
            if half > 0:
                stretch = (
                    stretch - half
                    if stretch > half
                    else (stretch + half if stretch < -half else 0.0)
                )
            spring = k * stretch + (damp * (v - vl) if stretch != 0.0 else 0.0)
            vl += h * (spring - outer) / jl
            ql += h * vl
            acceleration = (effort + kick[i] - p[_B] * v - friction - hysteresis - spring) / jm
        else:
            acceleration = (effort + kick[i] - p[_B] * v - friction - hysteresis - outer) / p[_J]
        v += h * acceleration
        q += h * v
    return pos, vel, eff


def trajectory(kind: str, seconds: float, rng: np.random.Generator, rate: float) -> Array:
    """Command (n,), rad: "sines", "moves" (trapezoids with rests), "cycle" (one period repeated),
    "chirp", "random".
    """
    n = int(seconds * rate)
    t = np.arange(n) / rate
    amplitude = rng.uniform(0.4, 1.2)
    if kind == "cycle":
        period = rng.uniform(1.5, 3.0)
        w = 2 * np.pi / period
        return np.asarray(
            amplitude
            * (np.sin(w * t) + 0.4 * np.sin(2 * w * t + 1) + 0.15 * np.sin(5 * w * t))
            * np.minimum(1, t / 0.5)
        )
    if kind == "chirp":
        return np.asarray(
            amplitude * np.sin(2 * np.pi * (0.1 * t + 0.5 * (2.0 - 0.1) / seconds * t**2))
        )
    if kind == "moves":
        y = np.zeros(n)
        at, now = 0.5, 0.0
        levels = rng.uniform(-amplitude, amplitude, 4)
        k = 0
        while at < seconds:
            goal = levels[k % 4]
            length = max(0.25, abs(goal - now) / (0.6 + 0.5 * (k % 3)))
            s = np.clip((t - at) / length, 0, 1)
            y = np.where(t >= at, now + (goal - now) * (10 * s**3 - 15 * s**4 + 6 * s**5), y)
            now, at, k = float(goal), at + length + 0.5, k + 1
        return y
    rates = 2 * np.pi * rng.uniform(0.1, 1.3, 6)
    waves = np.array(
        [np.sin(x * t + rng.uniform(0, 6)) / (1 + 0.3 * i) for i, x in enumerate(rates)]
    )
    return np.asarray(amplitude * waves.sum(0) / 2.2 * np.minimum(1, t / 0.5))


def draw_effect(
    name: str, rng: np.random.Generator, axis: Axis, speed: float, error: float
) -> dict[str, float]:
    """Magnitudes of one effect, sized to the axis' own torque, speed and tracking error."""
    torque = axis.inertia * 6 * speed + axis.viscous * speed
    u = rng.uniform
    drawn: dict[str, dict[str, float]] = {
        "command_delay": {"seconds": u(0.008, 0.05)},
        "command_lag": {"seconds": u(0.012, 0.08)},
        "deadband": {"dead": error * u(0.5, 1.5)},
        "torque_limit": {"fraction": u(0.35, 0.75)},
        "torque_droop": {"droop": u(0.1, 0.5)},
        "coulomb": {"level": torque * u(0.1, 0.6)},
        "stribeck": {
            "level": torque * u(0.1, 0.3),
            "static": torque * u(0.2, 0.5),
            "vs": speed * u(0.1, 0.3),
        },
        "load_friction": {"mu": u(0.1, 0.35), "level": torque * 0.02},
        "asymmetric_friction": {
            "level": torque * u(0.2, 0.4),
            "asym": torque * u(0.08, 0.18) * rng.choice([-1, 1]),
        },
        "gravity": {"grav": torque * u(0.3, 2.0), "grav_angle": u(-1, 1)},
        "cogging": {
            "cog": torque * u(0.08, 0.3),
            "cog_n": float(rng.integers(6, 40)),
            "cog_ph": u(0, 6),
        },
        "hysteresis": {"slip": torque * u(0.15, 0.5), "slip_d": u(0.03, 0.12)},
        "backlash": {"gap": u(0.01, 0.05), "share": 0.5, "level": torque * 0.02},
        "elasticity": {"freq": u(3.0, 9.0), "share": u(0.3, 0.6)},
        "position_offset": {"rad": u(0.005, 0.05) * rng.choice([-1, 1])},
        "encoder_ripple": {
            "rad": u(0.002, 0.01),
            "waves": float(rng.choice([1, 2, 4, 8, 16])),
            "phase": u(0, 6),
        },
        "sensor_latency": {"seconds": u(0.008, 0.04)},
        "clock_skew": {"seconds": u(0.02, 0.1) * rng.choice([-1, 1])},
        "quadratic_drag": {"drag": torque * u(0.3, 0.8) / speed**2},
        "end_stop": {"stop_at": u(0.0, 0.3), "stop_k": torque * u(3, 10)},
        "mains_torque": {"mains": torque * u(0.15, 0.4), "mains_hz": u(1.1, 4.7)},
        "sticky_sector": {
            "sector": torque * u(0.4, 1.0),
            "sector_at": u(-0.2, 0.2),
            "sector_w": u(0.05, 0.15),
        },
        "lost_packets": {"share": u(0.1, 0.3)},
        "gain_dropout": {"dropout": u(0.1, 0.4)},
    }
    return drawn[name]


Effects = Mapping[str, Mapping[str, float]]


def record(
    axis: Axis,
    command: Array,
    rate: float,
    rng: np.random.Generator,
    effects: Effects | None = None,
) -> PlantLog:
    """Play `command` (n,) at `rate` Hz on the axis with the effects in it and log at the same
    rate.
    """
    effects = effects or {}
    times = np.arange(command.size) / rate
    fine = np.asarray(np.arange(int((command.size - 1) / rate / STEP) + 1) * STEP, float)
    u = _as_obeyed(command, times, fine, rng, effects)
    p = _slots(axis, effects)
    smooth = np.gradient(u, STEP)
    window = max(1, int(0.008 / STEP))
    smooth = np.convolve(
        np.pad(smooth, window, "edge"), np.ones(2 * window + 1) / (2 * window + 1), "valid"
    )
    kick = (
        _wander(fine.size, rng)
        * axis.variation
        * float(np.std(smooth))
        * axis.inertia
        * axis.bandwidth
    )
    if "torque_limit" in effects:
        free = _run(u, smooth, STEP, p, kick)[2]
        p[_LIM] = effects["torque_limit"]["fraction"] * float(np.quantile(np.abs(free), 0.995))
    q, _, effort = _run(u, smooth, STEP, p, kick)
    pick = np.minimum((times / STEP).astype(int), fine.size - 1)
    q, effort = q[pick], effort[pick]
    if "torque_droop" in effects:
        heat = 1 - np.exp(-2.0 * times / times[-1])
        effort = effort * (1 + effects["torque_droop"]["droop"] * heat)
    if "sensor_latency" in effects:
        effort = np.interp(times - effects["sensor_latency"]["seconds"], times, effort)
    reading = _encoder(q, effects)
    reading = np.round((reading + rng.normal(0, axis.encoder, q.size)) / 1e-5) * 1e-5
    slope = np.gradient(reading, 1 / rate)
    velocity = 0.8 * slope + 0.2 * np.roll(slope, 1) + rng.normal(0, axis.encoder * 30, q.size)
    current = effort / axis.kt
    current = current + rng.normal(0, axis.current_noise * float(np.std(current)), q.size)
    return PlantLog(times, command, reading, velocity, current, effects)


def _as_obeyed(
    command: Array, times: Array, fine: Array, rng: np.random.Generator, effects: Effects
) -> Array:
    """The command (m,) on the fine grid as it reaches the drive."""
    sent = command.copy()
    if "lost_packets" in effects:
        lost = rng.random(command.size // 12 + 1) < effects["lost_packets"]["share"]
        for i in range(1, command.size):
            if lost[i // 12]:
                sent[i] = sent[i - 1]
    late = effects.get("command_delay", {}).get("seconds", 0.0)
    u = (
        np.interp(np.round((fine - late) / 0.002) * 0.002, times, sent)
        if late
        else np.interp(fine, times, sent)
    )
    if "command_lag" in effects:
        u = _cascade(u, effects["command_lag"]["seconds"])
    if "clock_skew" in effects:
        u = np.interp(fine - effects["clock_skew"]["seconds"] * fine / fine[-1], fine, u)
    return np.asarray(u)


def _slots(axis: Axis, effects: Effects) -> Array:
    """Parameters of :func:`_run`."""
    p = np.zeros(len(_SLOTS))
    p[[_J, _B, _WN, _Z, _FF, _KI, _VS, _STOP]] = (
        axis.inertia,
        axis.viscous,
        axis.bandwidth,
        axis.damping,
        axis.feedforward,
        axis.integral,
        0.05,
        1e9,
    )
    for values in effects.values():
        for name, value in values.items():
            if name in _I:
                p[_I[name]] += value if name == "level" else value - p[_I[name]]
    return p


def _encoder(q: Array, effects: Effects) -> Array:
    """What the encoder says of positions (n,), without its noise."""
    reading = q + effects.get("position_offset", {}).get("rad", 0.0)
    if "encoder_ripple" in effects:
        e = effects["encoder_ripple"]
        reading = reading + e["rad"] * (
            np.sin(e["waves"] * q + e["phase"]) + 0.15 * np.sin(2 * e["waves"] * q)
        )
    return reading


def _cascade(u: Array, seconds: float) -> Array:
    out = u.copy()
    a = STEP / (0.5 * seconds + STEP)
    return np.asarray(_filter(_filter(out, a), a))


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _filter(u: Array, a: float) -> Array:  # pragma: no cover
    out = np.copy(u)
    for i in range(1, u.size):
        out[i] = out[i - 1] + a * (u[i] - out[i - 1])
    return out


def _wander(n: int, rng: np.random.Generator) -> Array:
    """Slow disturbance (n,) of unit size: what differs between repeats."""
    knots = max(4, int(n * STEP / 0.3))
    return np.interp(np.linspace(0, knots - 1, n), np.arange(knots), rng.normal(size=knots))
