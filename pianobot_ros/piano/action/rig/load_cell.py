"""What the rig's load cell tells: the key's own driving point, and the front rail under a press.

The paper fits X/I, in which the armature is a part of the model. Between armature and key sits a
load cell: its force F and the displacement X give the key without the armature. F has noise, so
X/F is the ratio of two responses to the current, which the noise has nothing to do with (the
current as an instrument), and not H1 of X over F, which noise in F would pull down. F jumps with
every step of the current, by the key's share of the mass that moves; that part is resampled as the
current is, and only the rest is smooth enough to interpolate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from pianobot_ros.cell.arrays import Array, ComplexArray
from pianobot_ros.piano.action.parameters import ActionParameters
from pianobot_ros.piano.action.rig.frf import FrequencyResponse, transfer_estimate
from pianobot_ros.piano.action.rig.transfer_fit import (
    FIRST_GUESS,
    HALF_WIDTH_95,
    STAGES,
    RigEstimate,
    stacked,
    value_of,
    with_values,
)
from pianobot_ros.piano.action.rig.voice_coil import Trial, TrialKind, resample, run_trial

__all__ = ["DrivingPoint", "RailPress", "compliance", "driving_point", "press_rail"]

Name = tuple[str, str]
DURATION = 240.0  # s of noise for each preparation
PRESSES = (0.15, 0.3, 0.6)  # s from no force to the largest, for each press and its release
PRESS_FORCE = 12.0  # N, the largest
INSIDE = 1e-4  # m past the rail from which a sample counts
SMOOTH = 15  # samples of a local cubic that gives velocity and acceleration


@dataclass(frozen=True)
class DrivingPoint:
    """X/F (m/N) at the key as measured, ``response`` with its frequencies; ``estimates`` by
    (section, field) from it alone; ``parameters`` with them.
    """

    response: FrequencyResponse
    estimates: Mapping[Name, RigEstimate]
    parameters: ActionParameters


def compliance(p: ActionParameters, preparation: TrialKind, frequency: Array) -> ComplexArray:
    """X/F (m/N) at the key of ``AK`` or ``AKWH`` without the armature, at ``frequency`` (n,) Hz."""
    s = 2j * np.pi * np.asarray(frequency)
    own = p.key.mass * s**2 + p.key.damping * s
    if preparation == "AKWH":
        h = p.hammer
        coupler = h.coupler_damping * s + h.coupler_stiffness
        carried = h.mass * s**2 + h.bushing_damping * s
        own = own + coupler * carried / (coupler + carried)
    return np.asarray(1.0 / own, dtype=complex)


def driving_point(
    p: ActionParameters,
    preparation: TrialKind,
    *,
    seed: int,
    duration: float = DURATION,
    known: ActionParameters | None = None,
) -> DrivingPoint:
    """Run ``AK`` or ``AKWH`` on the simulated rig and fit the key (``AK``) or the hammer
    (``AKWH``, with the key of ``known``) to the load cell's X/F.
    """
    trial = run_trial(p, preparation, seed=seed, duration=duration)
    found = known or p.vary("key", mass=FIRST_GUESS * p.key.mass)
    for _ in range(1 if known else 4):  # the key's mass says how much F jumps, and F says the mass
        found_point = _fit(p, preparation, trial, found)
        found = found_point.parameters
    return found_point


def _fit(
    p: ActionParameters, preparation: TrialKind, trial: Trial, start: ActionParameters
) -> DrivingPoint:
    settings, a = p.frequency_response, p.armature
    jump = a.motor_constant * start.key.mass / (a.mass + start.key.mass)
    smooth = replace(trial, force=trial.force - jump * trial.current)
    even = resample(smooth, p.rig.mean_period)
    even = replace(even, force=even.force + jump * even.current)
    moved, felt = (
        transfer_estimate(even.current, x, even.period, settings, hold=even.hold).band(
            settings.fit_low, settings.fit_high, every=2
        )
        for x in (even.displacement, even.force)
    )
    ratio = moved.response / felt.response
    coherence = np.clip(moved.coherence * felt.coherence, 1e-6, 1 - 1e-12)
    sigma = np.abs(ratio) * np.sqrt((1 - coherence) / (2 * moved.averages * coherence))
    names = STAGES[preparation]
    scale = np.array([value_of(start, name) for name in names])

    def residual(log_ratio: Array) -> Array:
        varied = with_values(start, names, scale * np.exp(log_ratio))
        return stacked(ratio - compliance(varied, preparation, moved.frequency), sigma)

    found = least_squares(residual, np.full(len(names), np.log(FIRST_GUESS)), x_scale=0.1)
    variance = 2 * found.cost / max(1, found.fun.size - len(names))
    spread = HALF_WIDTH_95 * np.sqrt(variance * np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    values = scale * np.exp(found.x)
    estimates = {
        n: RigEstimate(float(v), float(v * np.exp(-s)), float(v * np.exp(s)))
        for n, v, s in zip(names, values, spread, strict=True)
    }
    response = FrequencyResponse(
        moved.frequency, ratio, np.asarray(coherence), moved.hold, moved.averages
    )
    return DrivingPoint(response, estimates, with_values(start, names, values))


@dataclass(frozen=True)
class RailPress:
    """Presses of the key against the front rail: ``displacement`` (n,) m and ``force`` (n,) N of
    the load cell at ``time`` (n,) s; what was fitted to them, each with its 95 % interval.
    """

    time: Array
    displacement: Array
    force: Array
    stiffness: RigEstimate
    damping: RigEstimate


def press_rail(p: ActionParameters, *, seed: int) -> RailPress:
    """The paper's supplemental experiment: press the key (no hammer) against the front rail, record
    force and displacement, and fit a constant stiffness and damping to them.
    """
    edges = np.concatenate([[0.0], np.repeat(PRESSES, 2)]).cumsum()

    def drive(t: float) -> float:
        i = min(int(np.searchsorted(edges, t, side="right")) - 1, len(edges) - 2)
        share = (1 - np.cos(np.pi * (t - edges[i]) / (edges[i + 1] - edges[i]))) / 2
        return PRESS_FORCE * float(share if i % 2 == 0 else 1 - share)

    a, rail, mass = p.armature, p.front_rail, p.armature.mass + p.key.mass

    def forces(t: float, x: float, v: float) -> float:
        """Acceleration of armature and key."""
        deep = x - p.key.dip
        felt = max(rail.stiffness * deep + rail.damping * v, 0.0) if deep > 0 else 0.0
        return (drive(t) - a.stiffness * x - p.moving_damping * v - felt) / mass

    time = np.arange(0.0, float(edges[-1]), p.rig.mean_period)
    path = solve_ivp(
        lambda t, z: [z[1], forces(t, z[0], z[1])],
        (0.0, float(time[-1])),
        [0.0, 0.0],
        t_eval=time,
        max_step=1e-3,
        rtol=1e-8,
        atol=1e-10,
    ).y
    pushed = np.array([drive(t) for t in time])
    rate = np.array([forces(t, x, v) for t, x, v in zip(time, *path, strict=True)])
    force = pushed - a.mass * rate - a.damping * path[1] - a.stiffness * path[0]
    force = force + np.random.default_rng(seed).normal(0.0, p.rig.load_cell_noise, time.size)
    moved = np.round(path[0] * p.rig.encoder_resolution) / p.rig.encoder_resolution
    step = p.rig.mean_period
    x, v, acceleration = (savgol_filter(moved, SMOOTH, 3, deriv=d, delta=step) for d in range(3))
    inside = x > p.key.dip + INSIDE
    columns = np.column_stack([x, v, np.ones_like(x)])[inside]
    own = p.key.mass * acceleration + p.key.damping * v
    found, *_ = np.linalg.lstsq(columns, (force - own)[inside], rcond=None)
    left = (force - own)[inside] - columns @ found
    spread = HALF_WIDTH_95 * _spread(columns, left)
    return RailPress(
        time,
        moved,
        force,
        RigEstimate(float(found[0]), float(found[0] - spread[0]), float(found[0] + spread[0])),
        RigEstimate(float(found[1]), float(found[1] - spread[1]), float(found[1] + spread[1])),
    )


def _spread(columns: Array, left: Array) -> Array:
    """Standard deviations; neighbours within the smoothing say the same."""
    inverse = np.linalg.inv(columns.T @ columns)
    variance = float(left @ left) / max(1, left.size / SMOOTH - columns.shape[1])
    return np.asarray(np.sqrt(variance * np.diag(inverse)))
