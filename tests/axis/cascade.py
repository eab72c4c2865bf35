"""A fourth plant of the axis: a position loop around a speed loop that has the integral action, as
most drives are; one joint with cogging and dry friction, or the second joint of an arm.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pianobot_ros.axis.log import Log

LINK, WEIGHT = 0.35, 9.81
OWN = 1.5 * LINK / 2  # kg m, of the forearm itself
FINE = 20  # steps of 0.05 ms in a control period


def waves(rng: np.random.Generator, t: np.ndarray, amplitude: float) -> np.ndarray:
    """Command (n,): four sines that set in slowly."""
    lines = zip((0.15, 0.37, 0.9, 1.7), rng.uniform(0, 6, 4), strict=True)
    sines = (np.sin(2 * np.pi * f * t + p) / (1 + k) for k, (f, p) in enumerate(lines))
    return amplitude * sum(sines) * np.minimum(1, t)


@njit(cache=True)
def run(u, up, loop, joint):
    """Position and effort (n, 2) at 1 kHz; the joint hangs on one at the angle `up` (n,). `loop` is
    gain, integral and share of the speed fed forward; `joint` inertia, viscous and dry friction,
    cogging and gravity.
    """
    gain, integral, forward = loop
    inertia, viscous, coulomb, cogging, gravity = joint
    out = np.empty((u.size, 2))
    h = 1e-3 / FINE
    q, v, held = u[0], 0.0, 0.0
    for i in range(u.size):
        j = min(i + 1, u.size - 1)
        slope = (u[j] - u[i]) * 1e3
        off = 18.0 * (u[i] - q) + forward * slope - v
        held += 1e-3 * off
        effort = gain * off + integral * held
        out[i, 0], out[i, 1] = q, effort
        for _ in range(FINE):
            load = cogging * np.sin(14.0 * q) + gravity * np.sin(q + up[i])
            free = v + h * (effort - viscous * v - load) / inertia
            brake = h * coulomb / inertia
            v = np.sign(free) * max(abs(free) - brake, 0.0)
            q += h * v
    return out


def drive(seed: int, *, coulomb: float = 0.0, cogging: float = 0.0, seconds: float = 16.0) -> Log:
    """A geared joint with half of its speed fed forward, 200 Hz, A."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1e-3)
    u = waves(rng, t, 0.6)
    made = run(u, np.zeros(t.size), (3.0, 40.0, 0.5), (0.17, 0.3, coulomb, cogging, 0.0))[::5]
    n = len(made)
    position = made[:, 0] + 1e-5 * rng.standard_normal(n)
    effort = made[:, 1] + 0.02 * rng.standard_normal(n)
    return Log("drive", t[::5], u[::5], position, None, effort, "A", (), "j")


def moves(t: np.ndarray) -> np.ndarray:
    """Command (n,): a move of 0.8 s every two seconds, with rests between."""
    at = np.array([0.0, 0.9, -0.5, 0.6, 0.0, -0.9, 0.3, 0.0])
    share = np.clip((t % 2.0) / 0.8, 0.0, 1.0)
    k = (t // 2.0).astype(int) % at.size
    return at[k] + (np.roll(at, -1) - at)[k] * share**3 * (10 - 15 * share + 6 * share**2)


def mover(seed: int, gain: float, integral: float) -> Log:
    """A joint with its whole speed fed forward and nothing hidden that makes `moves`, 200 Hz, A."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, 16.0, 1e-3)
    u = moves(t)
    made = run(u, np.zeros(t.size), (gain, integral, 1.0), (0.17, 0.3, 0.0, 0.0, 0.0))[::5]
    noise = np.array([1e-5, 0.02]) * rng.standard_normal((len(made), 2))
    position, effort = (made + noise).T
    return Log("mover", t[::5], u[::5], position, None, effort, "A", (), "j")


def forearm(seed: int, mass: float, seconds: float = 24.0) -> Log:
    """The second joint of an arm whose first one turns its gravity, with `mass` kg at its end."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1e-3)
    up = 0.3 + waves(rng, t, 0.5)
    u = 0.6 + waves(rng, t, 0.6)
    inertia, gravity = 0.14 + mass * LINK**2, WEIGHT * (OWN + mass * LINK)
    made = run(u, up, (5.0, 30.0, 0.7), (inertia, 0.4, 0.5, 0.0, gravity))[::10]
    n = len(made)
    position = made[:, 0] + 2e-5 * rng.standard_normal(n)
    effort = made[:, 1] + 0.05 * rng.standard_normal(n)
    others, names = {"shoulder": up[::10]}, ("shoulder", "elbow")
    return Log(
        "arm",
        t[::10],
        u[::10],
        position,
        None,
        effort,
        "Nm",
        (),
        "elbow",
        others=others,
        joints=names,
    )
