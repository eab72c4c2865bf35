"""The families of effects: stage, range of strengths, and by which laws each of them acts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

__all__ = [
    "FAMILIES",
    "IN_LIBRARY",
    "MECHANICAL",
    "OUTSIDE",
    "Acting",
    "Effects",
    "Family",
    "acting",
]

MECHANICAL = (
    "wrist_compliance",
    "joint_friction",
    "joint_backlash",
    "joint_hardening",
    "jamming_hysteresis",
    "joint_creep",
    "pad_compliance",
    "tip_slip",
    "tip_offset",
    "key_friction",
    "key_preload",
    "hammer",
    "let_off",
    "felt_nonlinear",
    "joint_quadratic_damping",
    "key_spring_cubic",
)
"""Families that act in the compiled mechanics, in the order of its arrays of laws and strengths."""
(
    WRIST_COMPLIANCE,
    JOINT_FRICTION,
    JOINT_BACKLASH,
    JOINT_HARDENING,
    JAMMING_HYSTERESIS,
    JOINT_CREEP,
    PAD_COMPLIANCE,
    TIP_SLIP,
    TIP_OFFSET,
    KEY_FRICTION,
    KEY_PRELOAD,
    HAMMER,
    LET_OFF,
    FELT_NONLINEAR,
    JOINT_QUADRATIC_DAMPING,
    KEY_SPRING_CUBIC,
) = range(16)


class Acting(NamedTuple):
    """An effect at work: ``law`` 1 or 2 (0: none) and ``strength`` in the unit of its family."""

    law: int
    strength: float


Effects = Mapping[str, Acting]
"""Effects at work by the names of their families."""


def acting(effects: Effects, name: str) -> Acting:
    """How the family ``name`` acts; law 0 if it does not."""
    return effects.get(name, Acting(0, 0.0))


class Family(NamedTuple):
    """A family of effects: the ``stage`` where it acts, and for each of its laws the strength at
    which a search begins, the largest one, and a phrase. ``unit`` is that of the strengths.
    """

    stage: str
    start: tuple[float, ...]
    bound: tuple[float, ...]
    phrases: tuple[str, ...]
    unit: str


def _family(
    stage: str,
    start: float | tuple[float, ...],
    bound: float | tuple[float, ...],
    unit: str,
    *phrases: str,
) -> Family:
    """A family whose laws share ``start`` and ``bound`` where these are one number."""
    starts = start if isinstance(start, tuple) else (start,) * len(phrases)
    bounds = bound if isinstance(bound, tuple) else (bound,) * len(phrases)
    return Family(stage, starts, bounds, phrases, unit)


_KNOWN = {
    "wrist_delay": _family(
        "wrist",
        0.001,
        0.03,
        "s",
        "dead time that drifts by 30 % with a period of 7 s (buffer drift)",
        "targets averaged over twice the delay (linear-phase smoothing)",
    ),
    "wrist_lag": _family(
        "wrist",
        0.001,
        0.05,
        "s",
        "servo detuned: lower natural frequency, still critically damped",
        "two-path target: 40 % through a slow first-order lag",
    ),
    "wrist_compliance": _family(
        "wrist",
        2e-05,
        0.0003,
        "m/N, m/N at 3 N",
        "Zener arm: 60 % with 12 ms, 40 % with 150 ms",
        "softening give, F^0.7 through 15 ms",
    ),
    "pressure_lag": _family(
        "pneumatics",
        0.05,
        0.4,
        "s",
        "second order, damping ratio 0.7 (regulator overshoots)",
        "first order whose time grows at deep vacuum (isothermal blow-down)",
    ),
    "pressure_leak": _family(
        "pneumatics",
        300,
        8000,
        "Pa at -100 kPa",
        "compressible laminar leak, patm^2 - p^2, 60 ms",
        "P-controller's droop: 1.6 times at the step, recovering to 0.7 in 0.4 s",
    ),
    "regulator_hysteresis": _family(
        "pneumatics",
        200,
        5000,
        "Pa",
        "Coleman-Hodgdon-like exponential loop over 25 kPa",
        "dead-band controller whose width varies by 30 % at every step",
    ),
    "joint_friction": _family(
        "hand",
        0.005,
        0.08,
        "N*m",
        "Threlfall: 1-exp(-3 v/v0), no memory",
        "Dupont elasto-plastic single state",
    ),
    "joint_backlash": _family(
        "hand",
        0.001,
        0.02,
        "rad",
        "smooth dead zone, e - g tanh(e/g)",
        "play operator: spring behind a hysteretic slot",
    ),
    "joint_hardening": _family(
        "hand",
        0.3,
        8,
        "1 at 0.1 rad",
        "locking: k e/(1-(e/em)^2)",
        "quadratic, only when bent back",
    ),
    "jamming_hysteresis": _family(
        "hand",
        0.06,
        0.6,
        "1",
        "six elasto-plastic elements 4 to 50 mrad, share grows with vacuum",
        "Perzyna overstress: relaxes in 30 ms beyond 4 mrad",
    ),
    "joint_creep": _family(
        "hand",
        0.08,
        0.7,
        "1",
        "stretched exponential by five Prony branches 0.02 to 4 s",
        "two branches 0.06 and 1.5 s, strong when soft, little when jammed",
    ),
    "pad_compliance": _family(
        "contact",
        (0.0002, 0.05),
        (0.003, 0.7),
        "m, 1",
        "blunt pad: k d^2/(d+d0)",
        "viscoelastic pad: share of stiffness relaxes in 25 ms",
    ),
    "tip_slip": _family(
        "contact",
        0.1,
        0.95,
        "1",
        "two-level Coulomb: static and kinetic",
        "slip weakening with the path slid, 0.5 mm (Ida)",
    ),
    "tip_offset": _family(
        "contact",
        0.0002,
        0.003,
        "m",
        "pad mounted 20 deg from along the last phalanx",
        "worn pad: smaller radius",
    ),
    "key_friction": _family(
        "key",
        0.006,
        0.06,
        "N*m",
        "bushing friction that grows with the contact load, tanh of speed",
        "elasto-plastic, half as strong on the way up",
    ),
    "key_preload": _family(
        "key",
        0.02,
        0.12,
        "N*m",
        "rest magnet fading with the square of the angle",
        "over-centre spring, raised cosine over the travel",
    ),
    "hammer": _family(
        "key",
        0.0004,
        0.004,
        "kg*m^2",
        "hammer with weight on a unilateral jack spring, flies, rebounds from a string",
        "bilateral viscoelastic 45 Hz coupling",
    ),
    "let_off": _family(
        "key",
        0.03,
        0.25,
        "N*m",
        "Lorentzian elastic bump at 31 mrad",
        "sawtooth ratchet 24 to 38 mrad, 30 % on the way back",
    ),
    "felt_nonlinear": _family(
        "key",
        0.0002,
        0.003,
        "m",
        "exponential felt layer before the rail",
        "parabolic layer with 35 % loss when unloading",
    ),
    "midi_velocity_curve": _family(
        "sensing", 0.1, 1.5, "1", "parabola added, zero at both ends", "arctangent curve blended"
    ),
    "midi_latency": _family(
        "sensing",
        0.001,
        0.02,
        "s",
        "note-on late, note-off by three quarters of it",
        "late with 15 % even scatter",
    ),
    "midi_jitter": _family(
        "sensing",
        0.0015,
        0.02,
        "s",
        "lognormal waits, sigma 0.8",
        "half of the events wait evenly up to four means",
    ),
    "trigger_offset": _family(
        "sensing",
        0.0005,
        0.01,
        "rad",
        "contacts high: on by d, off by 0.8 d earlier",
        "on deeper by d, off by half",
    ),
    "fsr_hysteresis": _family(
        "sensing",
        0.03,
        0.6,
        "1",
        "lobe on the way down from the remembered maximum",
        "Prandtl-Ishlinskii, eight exponentially spaced plays",
    ),
    "fsr_creep": _family(
        "sensing",
        0.03,
        0.8,
        "1",
        "stretched exponential, beta 0.5, 0.5 s under load",
        "traps filled by load and emptied in 0.8 s",
    ),
    "fsr_saturation": _family(
        "sensing", 0.01, 0.3, "1", "exponential approach to a ceiling", "softplus knee at 3 N"
    ),
    "clock_skew": _family(
        "clock",
        7e-05,
        0.003,
        "1",
        "sensor clock: rate error falls to 40 % after 40 % of the session",
        "constant rate error of the MIDI stamps",
    ),
}
_FOREIGN = {
    "servo_underdamped": _family(
        "wrist", 0.1, 0.6, "1", "servo's damping ratio below one: overshoot"
    ),
    "pressure_limit_cycle": _family(
        "pneumatics",
        300,
        5000,
        "Pa at -100 kPa",
        "regulator hunts at 2.7 Hz in proportion to the vacuum",
    ),
    "joint_quadratic_damping": _family(
        "hand", 0.005, 0.3, "N*m*s^2/rad^2", "joint torque with the square of the speed"
    ),
    "key_spring_cubic": _family(
        "key", 0.1, 6, "1", "key spring stiffens with the cube of the angle"
    ),
    "fsr_inertia": _family(
        "sensing", 0.003, 0.2, "kg", "force sensor carries a mass that the key accelerates"
    ),
    "encoder_eccentricity": _family(
        "sensing", 0.0002, 0.002, "rad", "key angle sensor errs sinusoidally with the angle"
    ),
    "mains_hum": _family("sensing", 0.08, 0.6, "N", "50 Hz on the force sensor"),
}
FAMILIES: Mapping[str, Family] = _KNOWN | _FOREIGN
"""All families by name."""
IN_LIBRARY = tuple(_KNOWN)
"""Those which the library of the diagnosis has, too, by laws of its own."""
OUTSIDE = tuple(_FOREIGN)
"""Those which it does not have."""
