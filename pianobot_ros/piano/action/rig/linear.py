"""The linear models of Table 1: armature (A), with key (AK), with key, whippen and hammer (AKWH).

Table 1 prints the numerator 1/k_M. That is right for neither input: a force in newtons needs 1, and
a current in amperes needs k_M, since F = k_M i. Both are offered here; the printed numerator is off
by k_M = 2.05 (6.2 dB) and 4.2 respectively.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pianobot_ros.cell.arrays import Array, ComplexArray
from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.piano.action.parameters import ActionParameters

__all__ = [
    "PREPARATIONS",
    "Preparation",
    "StateSpace",
    "TransferFunction",
    "antiresonance",
    "damping_ratio",
    "natural_frequency",
    "resonance",
    "state_space",
    "transfer_function",
]

Preparation = Literal["A", "AK", "AKW", "AKWH"]
PREPARATIONS: tuple[Preparation, ...] = ("A", "AK", "AKW", "AKWH")
Input = Literal["force", "current"]


@dataclass(frozen=True)
class TransferFunction:
    """Rational transfer function; coefficients of s, highest power first (input N or A, output
    m).
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def __call__(self, frequency: ArrayLike) -> ComplexArray:
        """Frequency response at ``frequency`` [Hz], any shape."""
        s = 2j * np.pi * np.asarray(frequency, dtype=float)
        return np.asarray(
            np.polyval(self.numerator, s) / np.polyval(self.denominator, s), dtype=complex
        )

    @property
    def poles(self) -> ComplexArray:
        """Roots of the denominator [rad/s]."""
        return np.asarray(np.roots(self.denominator), dtype=complex)

    @property
    def zeros(self) -> ComplexArray:
        """Roots of the numerator [rad/s]."""
        return np.asarray(np.roots(self.numerator), dtype=complex)


@dataclass(frozen=True)
class StateSpace:
    """z' = A z + B F, y = C z, with z = [x, x'] or [x, x', x_H, x_H'] (SI), F in newtons."""

    A: Array
    B: Array
    C: Array


def _moving(parameters: ActionParameters, preparation: str) -> tuple[float, float, float]:
    """Mass, damping and stiffness of what moves rigidly with x [kg, N*s/m, N/m]."""
    if preparation not in PREPARATIONS:
        raise ConfigError(unknown_name("preparation", preparation, PREPARATIONS))
    mass, damping = parameters.armature.mass, parameters.armature.damping
    if preparation != "A":
        mass += parameters.key.mass
        damping += parameters.key.damping
    if "W" in preparation:
        mass += parameters.key.whippen_mass
    return mass, damping, parameters.armature.stiffness


def transfer_function(
    parameters: ActionParameters, preparation: Preparation, input_quantity: Input = "force"
) -> TransferFunction:
    """Table 1 with the right numerator: X/F [m/N] for ``force``, X/I [m/A] for ``current``."""
    mass, damping, stiffness = _moving(parameters, preparation)
    gain = parameters.armature.motor_constant if input_quantity == "current" else 1.0
    own = np.array([mass, damping, stiffness])
    if preparation != "AKWH":
        return TransferFunction((gain,), tuple(own))
    h = parameters.hammer
    coupler = np.array([h.coupler_damping, h.coupler_stiffness])
    hammer = np.array([h.mass, h.coupler_damping + h.bushing_damping, h.coupler_stiffness])
    # (own + Z_c) X = F + Z_c X_H and hammer X_H = Z_c X, with Z_c the coupler.
    denominator = np.convolve(own + np.concatenate([[0.0], coupler]), hammer)
    denominator[2:] -= np.convolve(coupler, coupler)
    return TransferFunction(tuple(gain * hammer), tuple(denominator))


def state_space(parameters: ActionParameters, preparation: Preparation) -> StateSpace:
    """The same models in state space, without gravity."""
    mass, damping, stiffness = _moving(parameters, preparation)
    if preparation != "AKWH":
        a = np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]])
        return StateSpace(a, np.array([0.0, 1.0 / mass]), np.array([1.0, 0.0]))
    h = parameters.hammer
    k, b = h.coupler_stiffness, h.coupler_damping
    a = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-(stiffness + k) / mass, -(damping + b) / mass, k / mass, b / mass],
            [0.0, 0.0, 0.0, 1.0],
            [k / h.mass, b / h.mass, -k / h.mass, -(b + h.bushing_damping) / h.mass],
        ]
    )
    return StateSpace(a, np.array([0.0, 1.0 / mass, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))


def natural_frequency(mass: float, stiffness: float) -> float:
    """Undamped natural frequency [Hz]."""
    return float(np.sqrt(stiffness / mass) / (2 * np.pi))


def damping_ratio(mass: float, damping: float, stiffness: float) -> float:
    """Damping over critical damping (1)."""
    return float(damping / (2 * np.sqrt(mass * stiffness)))


def antiresonance(parameters: ActionParameters, *, damped: bool = False) -> float:
    """Antiresonance of AKWH [Hz]: where the hammer absorbs the key's motion.

    The undamped zero sqrt(k_H / m_H), or with ``damped`` the minimum of |X/F| that a Bode plot
    shows.
    """
    if not damped:
        return natural_frequency(parameters.hammer.mass, parameters.hammer.coupler_stiffness)
    return _extremum(parameters, -1.0, "antiresonance")


def resonance(parameters: ActionParameters, *, damped: bool = False) -> float:
    """Upper resonance of AKWH [Hz]: the higher undamped mode, or with ``damped`` the peak of |X/F|
    above the antiresonance.

    Raises :class:`ConfigError` if damping has smoothed the peak away.
    """
    if damped:
        return _extremum(parameters, 1.0, "resonance")
    mass, _, stiffness = _moving(parameters, "AKWH")
    h = parameters.hammer
    scale = 1 / np.sqrt(np.array([mass, h.mass]))
    k = np.array(
        [
            [stiffness + h.coupler_stiffness, -h.coupler_stiffness],
            [-h.coupler_stiffness, h.coupler_stiffness],
        ]
    )
    return float(np.sqrt(np.linalg.eigvalsh(k * np.outer(scale, scale))[1]) / (2 * np.pi))


def _extremum(parameters: ActionParameters, sign: float, kind: str) -> float:
    """First interior maximum (``sign`` 1) or minimum (-1) of |X/F| in 8 to 60 Hz, on a 1 mHz grid
    [Hz].
    """
    frequency = np.arange(8.0, 60.0, 1e-3)
    slope = np.diff(sign * np.abs(transfer_function(parameters, "AKWH")(frequency)))
    inner = np.flatnonzero(np.diff(np.sign(slope)) < 0) + 1
    if inner.size == 0:
        raise ConfigError(
            f"the response of AKWH shows no {kind} between 8 and 60 Hz: lower its damping"
        )
    return float(frequency[inner[0]])
