"""Laws 1 to 3 of the wrist's effects, compiled."""

from __future__ import annotations

import math

from numba import njit

from pianobot_ros.cell.arrays import Array

__all__ = [
    "first_order",
    "hardening_give",
    "joint_give",
    "next_poll",
    "queued",
    "rate_limited",
    "second_order",
]

GIVE_TIME = 0.005  # s
GIVE_FORCE = 4.0  # N at which a hardening transmission gives half of what a linear one would
QUEUE_SHARE = 0.4  # of the mean wait that is spent in a queue
BUTTERWORTH = math.sqrt(0.5)  # damping ratio
ACROSS, ALONG, COUPLED = 0.8, 0.29, 0.24  # of an arm's give, see joint_give


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def next_poll(now: float, mean: float) -> float:
    """Time, s, at which a receiver that polls every ``2 * mean`` s next looks (Törngren 1998,
    *Fundamentals of implementing real-time control applications in distributed computer systems*).
    """
    period = 2.0 * mean
    return (math.floor(now / period) + 1.0) * period


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def first_order(y: float, aim: float, dt: float, time: float) -> float:
    """First-order lag of time constant ``time`` s after ``dt`` s of held ``aim`` (Åström and Murray
    2008, *Feedback systems*).
    """
    return y + (aim - y) * (1.0 - math.exp(-dt / time))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def rate_limited(y: float, aim: float, dt: float, time: float, band: float) -> float:
    """Smooth rate limit of ``band / time``: a first-order lag within ``band``, a constant speed far
    from the aim (Åström and Murray 2008; saturation as a hyperbolic tangent).
    """
    most = band * dt / time
    return y + most * math.tanh((aim - y) * (1.0 - math.exp(-dt / time)) / most)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def hardening_give(force: float, give: float) -> float:
    """Deflection, m, of a transmission that stiffens with load: ``give`` m/N at rest (harmonic
    drives: Tuttle and Seering 1996).
    """
    return give * force / (1.0 + abs(force) / GIVE_FORCE)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def queued(mean: float, chance: float) -> float:
    """Wait, s, of ``mean`` s on average: a fixed part, and the exponential one of a queue with one
    server (Kleinrock 1975, *Queueing systems*); ``chance`` is even in (0, 1).
    """
    return mean * (1.0 - QUEUE_SHARE - QUEUE_SHARE * math.log(chance))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def second_order(lag: Array, c: int, aim: float, dt: float, time: float) -> float:
    """Second-order low pass after Butterworth (1930) that trails a ramp by ``time`` s, solved
    exactly for ``dt`` s of held ``aim``.

    ``lag`` (2, n) holds in row 1 what comes out and in row 0 the same plus its rate over the corner
    frequency, so that both rows are the pose at rest.
    """
    corner = 2.0 * BUTTERWORTH / time
    y, rate = lag[1, c] - aim, lag[0, c] - lag[1, c]
    turn = math.sqrt(1.0 - BUTTERWORTH * BUTTERWORTH)
    left = math.exp(-BUTTERWORTH * corner * dt)
    cosine, sine = math.cos(turn * corner * dt), math.sin(turn * corner * dt) / turn
    out: float = aim + left * (y * cosine + (rate + BUTTERWORTH * y) * sine)
    lag[0, c] = out + left * (rate * cosine - (y + BUTTERWORTH * rate) * sine)
    lag[1, c] = out
    return out


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def joint_give(force: Array, c: int, give: float) -> float:
    """Deflection, m, along axis ``c`` of an arm whose joints are springs: a force also pushes it
    where it does not point (Salisbury 1980). For a shoulder 0.5 m behind the wrist and as high, an
    elbow 0.25 m behind and 0.3 m above, joints of one stiffness; ``give`` m/N is the vertical one.
    """
    pushed: float = force[2] + COUPLED * force[1]
    if c == 0:
        pushed = ACROSS * force[0]
    elif c == 1:
        pushed = ALONG * force[1] + COUPLED * force[2]
    return give * pushed
