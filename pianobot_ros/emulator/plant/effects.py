"""Every effect that can be injected into the emulated cell: where it acts, by which law, and how strong it is.

A case gives each effect a magnitude in units of the repeatability floor. ``config/plant.yaml: effects`` holds, for
magnitudes 1, 3 and 10, the value of the effect's physical parameter; between them it is interpolated on logarithmic axes,
below 1 it is proportional.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pianobot_ros.cell.config import config_file, load_provenance
from pianobot_ros.cell.errors import ConfigError, unknown_name

__all__ = ["EFFECTS", "LEVELS", "Effect", "parse_effects", "physical_parameters", "scaled"]

LEVELS = (1.0, 3.0, 10.0)
"""Magnitudes, in units of the floor, at which ``config/plant.yaml`` gives the physical parameter."""


@dataclass(frozen=True)
class Effect:
    """One effect. ``low`` and ``high`` bound the physical parameter, in ``unit``; ``in_library`` says whether the diagnosis
    has a family of this name."""

    name: str
    stage: str
    law: str
    parameter: str
    unit: str
    low: float
    high: float
    in_library: bool = True


_TABLE = (
    Effect("wrist_delay", "wrist", "targets wait in a queue, each 0.8 to 1.2 of the mean", "mean wait", "s", 2e-4, 0.1),
    Effect("wrist_lag", "wrist", "two extra stages whose time grows with the error", "time of both", "s", 2e-4, 0.2),
    Effect("wrist_compliance", "wrist", "9 Hz mass, spring and light damper pushed by the keys", "give", "m/N", 1e-6, 2e-3),
    Effect("pressure_lag", "pneumatics", "nozzle, choked below the critical ratio (ISO 6358)", "filling time", "s", 1e-3, 3.0),
    Effect("pressure_leak", "pneumatics", "flow through a crack, root of the pressure", "droop at -100 kPa", "Pa", 10.0, 4e4),
    Effect("regulator_hysteresis", "pneumatics", "Bouc-Wen hysteresis of the spool", "half width", "Pa", 10.0, 2e4),
    Effect("joint_friction", "hand", "LuGre bristles in every joint", "Coulomb level", "N*m", 1e-5, 1.0),
    Effect("joint_backlash", "hand", "rounded gap, weak guide in it, damping at the flanks", "half gap", "rad", 1e-5, 0.08),
    Effect("joint_hardening", "hand", "exponential stiffening", "extra torque over linear at 0.1 rad", "1", 1e-3, 20.0),
    Effect("jamming_hysteresis", "hand", "yielding grain elements; stiffness remembers pressure", "share", "1", 1e-3, 0.95),
    Effect("joint_creep", "hand", "three Kelvin branches over two decades of time", "total give", "1", 1e-3, 0.9),
    Effect("pad_compliance", "contact", "Hertzian skin in series with the pad", "its depth at 5 N", "m", 1e-6, 8e-3),
    Effect("tip_slip", "contact", "friction that weakens with sliding speed", "weakening", "1", 1e-3, 0.98),
    Effect("tip_offset", "contact", "pad mounted across the last phalanx", "offset", "m", 1e-6, 6e-3),
    Effect("key_friction", "key", "LuGre bristles in the hinge", "Coulomb level", "N*m", 1e-5, 0.3),
    Effect("key_preload", "key", "felt under tension and a magnet at rest", "torque at rest", "N*m", 1e-5, 0.4),
    Effect("hammer", "key", "separate mass on a coupler, free flight, string and rest rail", "inertia", "kg*m^2", 2e-6, 6e-3),
    Effect("let_off", "key", "skewed bump of torque before the bottom", "height", "N*m", 1e-5, 0.6),
    Effect("felt_nonlinear", "key", "Hunt-Crossley felt layer before the rail", "thickness", "m", 1e-5, 5e-3),
    Effect("midi_velocity_curve", "sensing", "logistic curve instead of a line", "share", "1", 1e-3, 1.0),
    Effect("midi_latency", "sensing", "wait that is shorter for loud notes, then the next 1 ms frame", "wait", "s", 1e-5, 0.2),
    Effect("midi_jitter", "sensing", "gamma-distributed extra waits", "mean", "s", 1e-5, 0.1),
    Effect("trigger_offset", "sensing", "contacts mounted low, note-off less than note-on", "shift", "rad", 1e-6, 0.01),
    Effect("fsr_hysteresis", "sensing", "Bouc-Wen loop on the force", "share", "1", 1e-4, 0.6),
    Effect("fsr_creep", "sensing", "growth with the logarithm of the time under load", "per decade", "1", 1e-4, 0.6),
    Effect("fsr_saturation", "sensing", "soft limit", "loss at 5 N", "1", 1e-4, 0.8),
    Effect("clock_skew", "clock", "rate error that wanders by a fifth", "rate error", "1", 1e-7, 0.05),
    # Left out of the library on purpose.
    Effect("arm_vibration", "wrist", "the arm rings at 11.3 and 27.1 Hz all the time", "amplitude", "m", 1e-7, 3e-3, False),
    Effect("pressure_crosstalk", "pneumatics", "channels of one manifold pull each other", "share", "1", 1e-4, 0.8, False),
    Effect("stiffness_temperature", "hand", "joints soften as the cell warms up within 20 s", "loss", "1", 1e-3, 0.8, False),
    Effect("palm_sag", "hand", "hoses pull the palm down with the vacuum", "at -100 kPa", "m", 1e-6, 6e-3, False),
    Effect("pad_adhesion", "contact", "the pad sticks after some time and lets go late", "pull", "N", 1e-3, 5.0, False),
    Effect("loose_hinge", "key", "the key's hinge has vertical play that load takes up", "play", "m", 1e-6, 6e-3, False),
    Effect("magnetic_snap", "key", "a detent in the middle of the key's travel", "torque", "N*m", 1e-5, 0.4, False),
    Effect("fsr_vacuum", "sensing", "the force sensor's zero moves with the vacuum", "at -100 kPa", "N", 1e-4, 3.0, False),
    Effect("stuck_contact", "sensing", "some notes repeat the last velocity or are lost", "probability", "1", 1e-3, 0.9, False),
)  # fmt: skip

EFFECTS: Mapping[str, Effect] = {effect.name: effect for effect in _TABLE}
"""All effects by name. Stages in causal order: wrist, pneumatics, hand, contact, key, sensing, clock."""


def parse_effects(text: str) -> dict[str, float]:
    """``name=magnitude,...`` as on the command line. Raises :class:`ConfigError` for unknown names and bad numbers."""
    found: dict[str, float] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, _, size = part.partition("=")
        if name not in EFFECTS:
            raise ConfigError(unknown_name("effect", name, EFFECTS))
        try:
            found[name] = float(size)
        except ValueError:
            raise ConfigError(f"effect '{part}': write name=magnitude, as in {name}=3") from None
    return found


def scaled(name: str, magnitude: float) -> float:
    """Physical parameter of the effect ``name`` at ``magnitude`` (units of the floor), within its range."""
    if name not in EFFECTS:
        raise ConfigError(unknown_name("effect", name, EFFECTS))
    if not 0.0 <= magnitude <= 100.0:
        raise ConfigError(
            f"magnitude {magnitude} of {name} is out of range: give 0 to 100 units of the repeatability floor"
        )
    if magnitude == 0.0:
        return 0.0
    effect, at = EFFECTS[name], _calibration()[name]
    if magnitude <= LEVELS[0]:
        value = at[0] * magnitude
    else:
        logs = np.log(at)
        if magnitude > LEVELS[-1]:
            slope = (logs[2] - logs[1]) / np.log(LEVELS[2] / LEVELS[1])
            value = float(np.exp(logs[2] + slope * np.log(magnitude / LEVELS[2])))
        else:
            value = float(np.exp(np.interp(np.log(magnitude), np.log(LEVELS), logs)))
    return min(value, effect.high)


def physical_parameters(effects: Mapping[str, float]) -> dict[str, float]:
    """Physical parameter by effect, from magnitudes."""
    return {name: scaled(name, magnitude) for name, magnitude in effects.items()}


@lru_cache(maxsize=1)
def _calibration() -> dict[str, tuple[float, ...]]:
    found = load_provenance(config_file("plant.yaml"))
    table = {}
    for name, effect in EFFECTS.items():
        entry = found.get(f"effects.{name}")
        if entry is None or entry.get("unit") != effect.unit or len(entry["value"]) != len(LEVELS):
            raise ConfigError(
                f"plant.yaml: effects.{name} must be a list for magnitudes 1, 3 and 10 in {effect.unit}: "
                "run `python -m pianobot_ros.emulator.plant.calibrate`"
            )
        table[name] = tuple(float(v) for v in entry["value"])
    return table
