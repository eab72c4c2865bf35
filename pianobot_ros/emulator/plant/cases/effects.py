"""Every effect that can be injected into the emulated cell: where it acts, by which law, and how
strong it is.

A case gives each effect a magnitude in units of the repeatability floor. ``config/plant.yaml:
effects`` holds, for magnitudes 1, 3 and 10, the value of the effect's physical parameter; between
them it is interpolated on logarithmic axes, below 1 it is proportional. An effect of the library
has four laws (``laws/table.py``), each with sizes of its own: ``joint_friction_law1``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.cell.numbers.config import config_file, load_provenance
from pianobot_ros.emulator.plant.laws.table import law_count

__all__ = [
    "EFFECTS",
    "LEVELS",
    "PlantEffect",
    "parse_effects",
    "physical_parameters",
    "scaled",
    "size_name",
    "split_law",
]

LEVELS = (1.0, 3.0, 10.0)
"""Magnitudes, in units of the floor, at which ``config/plant.yaml`` gives the physical parameter.
"""


@dataclass(frozen=True)
class PlantEffect:
    """One effect. ``low`` and ``high`` bound the physical parameter, in ``unit``; ``in_library``
    says whether the diagnosis has a family of this name."""

    name: str
    stage: str
    law: str
    parameter: str
    unit: str
    low: float
    high: float
    in_library: bool = True


_TABLE = (
    PlantEffect(
        "wrist_delay",
        "wrist",
        "targets wait in a queue, each 0.8 to 1.2 of the mean",
        "mean wait",
        "s",
        2e-4,
        0.1,
    ),
    PlantEffect(
        "wrist_lag",
        "wrist",
        "two extra stages whose time grows with the error",
        "time of both",
        "s",
        2e-4,
        0.2,
    ),
    PlantEffect(
        "wrist_compliance",
        "wrist",
        "9 Hz mass, spring and light damper pushed by the keys",
        "give",
        "m/N",
        1e-6,
        2e-3,
    ),
    PlantEffect(
        "pressure_lag",
        "pneumatics",
        "nozzle, choked below the critical ratio (ISO 6358)",
        "filling time",
        "s",
        1e-3,
        3.0,
    ),
    PlantEffect(
        "pressure_leak",
        "pneumatics",
        "flow through a crack, root of the pressure",
        "droop at -100 kPa",
        "Pa",
        10.0,
        4e4,
    ),
    PlantEffect(
        "regulator_hysteresis",
        "pneumatics",
        "Bouc-Wen hysteresis of the spool",
        "half width",
        "Pa",
        10.0,
        2e4,
    ),
    PlantEffect(
        "joint_friction", "hand", "LuGre bristles in every joint", "Coulomb level", "N*m", 1e-5, 1.0
    ),
    PlantEffect(
        "joint_backlash",
        "hand",
        "rounded gap, weak guide in it, damping at the flanks",
        "half gap",
        "rad",
        1e-5,
        0.08,
    ),
    PlantEffect(
        "joint_hardening",
        "hand",
        "exponential stiffening",
        "extra torque over linear at 0.1 rad",
        "1",
        1e-3,
        20.0,
    ),
    PlantEffect(
        "jamming_hysteresis",
        "hand",
        "yielding grain elements; stiffness remembers pressure",
        "share",
        "1",
        1e-3,
        0.95,
    ),
    PlantEffect(
        "joint_creep",
        "hand",
        "three Kelvin branches over two decades of time",
        "total give",
        "1",
        1e-3,
        0.9,
    ),
    PlantEffect(
        "pad_compliance",
        "contact",
        "Hertzian skin in series with the pad",
        "its depth at 5 N",
        "m",
        1e-6,
        8e-3,
    ),
    PlantEffect(
        "tip_slip",
        "contact",
        "friction that weakens with sliding speed",
        "weakening",
        "1",
        1e-3,
        0.98,
    ),
    PlantEffect(
        "tip_offset", "contact", "pad mounted across the last phalanx", "offset", "m", 1e-6, 6e-3
    ),
    PlantEffect(
        "key_friction", "key", "LuGre bristles in the hinge", "Coulomb level", "N*m", 1e-5, 0.3
    ),
    PlantEffect(
        "key_preload",
        "key",
        "felt under tension and a magnet at rest",
        "torque at rest",
        "N*m",
        1e-5,
        0.4,
    ),
    PlantEffect(
        "hammer",
        "key",
        "separate mass on a coupler, free flight, string and rest rail",
        "inertia",
        "kg*m^2",
        2e-6,
        6e-3,
    ),
    PlantEffect(
        "let_off", "key", "skewed bump of torque before the bottom", "height", "N*m", 1e-5, 0.6
    ),
    PlantEffect(
        "felt_nonlinear",
        "key",
        "Hunt-Crossley felt layer before the rail",
        "thickness",
        "m",
        1e-5,
        5e-3,
    ),
    PlantEffect(
        "midi_velocity_curve",
        "sensing",
        "logistic curve instead of a line",
        "share",
        "1",
        1e-3,
        1.0,
    ),
    PlantEffect(
        "midi_latency",
        "sensing",
        "wait that is shorter for loud notes, then the next 1 ms frame",
        "wait",
        "s",
        1e-5,
        0.2,
    ),
    PlantEffect("midi_jitter", "sensing", "gamma-distributed extra waits", "mean", "s", 1e-5, 0.1),
    PlantEffect(
        "trigger_offset",
        "sensing",
        "contacts mounted low, note-off less than note-on",
        "shift",
        "rad",
        1e-6,
        0.01,
    ),
    PlantEffect("fsr_hysteresis", "sensing", "Bouc-Wen loop on the force", "share", "1", 1e-4, 0.6),
    PlantEffect(
        "fsr_creep",
        "sensing",
        "growth with the logarithm of the time under load",
        "per decade",
        "1",
        1e-4,
        0.6,
    ),
    PlantEffect("fsr_saturation", "sensing", "soft limit", "loss at 5 N", "1", 1e-4, 0.8),
    PlantEffect(
        "clock_skew", "clock", "rate error that wanders by a fifth", "rate error", "1", 1e-7, 0.05
    ),
    # Left out of the library on purpose.
    PlantEffect(
        "arm_vibration",
        "wrist",
        "the arm rings at 11.3 and 27.1 Hz all the time",
        "amplitude",
        "m",
        1e-7,
        3e-3,
        False,
    ),
    PlantEffect(
        "pressure_crosstalk",
        "pneumatics",
        "channels of one manifold pull each other",
        "share",
        "1",
        1e-4,
        0.8,
        False,
    ),
    PlantEffect(
        "stiffness_temperature",
        "hand",
        "joints soften as the cell warms up within 20 s",
        "loss",
        "1",
        1e-3,
        0.8,
        False,
    ),
    PlantEffect(
        "palm_sag",
        "hand",
        "hoses pull the palm down with the vacuum",
        "at -100 kPa",
        "m",
        1e-6,
        6e-3,
        False,
    ),
    PlantEffect(
        "pad_adhesion",
        "contact",
        "the pad sticks after some time and lets go late",
        "pull",
        "N",
        1e-3,
        5.0,
        False,
    ),
    PlantEffect(
        "loose_hinge",
        "key",
        "the key's hinge has vertical play that load takes up",
        "play",
        "m",
        1e-6,
        6e-3,
        False,
    ),
    PlantEffect(
        "magnetic_snap",
        "key",
        "a detent in the middle of the key's travel",
        "torque",
        "N*m",
        1e-5,
        0.4,
        False,
    ),
    PlantEffect(
        "fsr_vacuum",
        "sensing",
        "the force sensor's zero moves with the vacuum",
        "at -100 kPa",
        "N",
        1e-4,
        3.0,
        False,
    ),
    # The same, by processes that nothing in the engine was made for.
    PlantEffect(
        "wrist_quantised",
        "wrist",
        "targets pass through a register of coarse steps",
        "step",
        "m",
        1e-6,
        5e-3,
        False,
    ),
    PlantEffect(
        "pump_depletion",
        "pneumatics",
        "the pump's small reserve: what was drawn lately is missing, for 4 s",
        "loss per 100 kPa drawn, at -100 kPa",
        "Pa",
        1.0,
        4e4,
        False,
    ),
    PlantEffect(
        "grain_fatigue",
        "hand",
        "presses move grains until the vacuum is let go",
        "loss of stiffness",
        "1",
        1e-3,
        0.9,
        False,
    ),
    PlantEffect(
        "finger_coupling",
        "hand",
        "the other fingers' vacuum stiffens this one too",
        "gain at -100 kPa",
        "1",
        1e-3,
        2.0,
        False,
    ),
    PlantEffect(
        "pad_mullins",
        "contact",
        "rubber is softer below its deepest compression so far (Mullins 1969)",
        "softening",
        "1",
        1e-3,
        0.95,
        False,
    ),
    PlantEffect(
        "felt_set",
        "key",
        "the bottom felt stays pressed after a blow and recovers in 2.5 s",
        "set",
        "rad",
        1e-6,
        0.02,
        False,
    ),
    PlantEffect(
        "thixotropic_grease",
        "key",
        "grease in the bushing thickens at rest and thins in motion (Barnes 1997)",
        "damping at rest",
        "N*m*s/rad",
        1e-6,
        1.0,
        False,
    ),
    PlantEffect(
        "fsr_lag", "sensing", "low pass of the amplifier", "time constant", "s", 1e-5, 0.1, False
    ),
    PlantEffect(
        "velocity_scan",
        "sensing",
        "the time between two contacts is counted in scans",
        "period of a scan",
        "s",
        1e-5,
        0.02,
        False,
    ),
    PlantEffect(
        "clock_discipline",
        "clock",
        "runs off for 4 s and is slewed back in 0.3 s, again and again (Mills 1991)",
        "error before it is slewed back",
        "s",
        1e-6,
        0.1,
        False,
    ),
    PlantEffect(
        "stuck_contact",
        "sensing",
        "some notes repeat the last velocity or are lost",
        "probability",
        "1",
        1e-3,
        0.9,
        False,
    ),
)

EFFECTS: Mapping[str, PlantEffect] = {effect.name: effect for effect in _TABLE}
"""All effects by name. Stages in causal order: wrist, pneumatics, hand, contact, key, sensing,
clock.
"""


def split_law(name: str) -> tuple[str, int]:
    """Effect and law of a name such as ``joint_friction_law1``; law 0 where the name says none.
    Raises :class:`ConfigError` for an unknown effect or law.
    """
    base, mark, number = name.rpartition("_law")
    effect, law = (base, int(number)) if mark and number.isdecimal() else (name, 0)
    if effect not in EFFECTS:
        raise ConfigError(unknown_name("effect", effect, EFFECTS))
    if law >= law_count(effect):
        raise ConfigError(f"effect '{effect}' has {law_count(effect)} law(s), counted from 0")
    return effect, law


def size_name(effect: str, law: int) -> str:
    """Name of an effect by one of its laws, as in ``config/plant.yaml``."""
    return f"{effect}_law{law}" if law else effect


def parse_effects(text: str) -> dict[str, float]:
    """``name=magnitude,...`` as on the command line; ``name_law1`` is an effect by its law 1.
    Raises :class:`ConfigError` for unknown names and bad numbers.
    """
    found: dict[str, float] = {}
    for part in filter(None, (p.strip() for p in text.split(","))):
        name, _, size = part.partition("=")
        split_law(name)
        try:
            found[name] = float(size)
        except ValueError:
            raise ConfigError(f"effect '{part}': write name=magnitude, as in {name}=3") from None
    return found


def scaled(name: str, magnitude: float, law: int = 0) -> float:
    """Physical parameter of the effect ``name`` by its law ``law`` at ``magnitude`` (units of the
    floor), within its range.
    """
    name, law = split_law(size_name(name, law))
    if not 0.0 <= magnitude <= 100.0:
        raise ConfigError(
            f"magnitude {magnitude} of {name} is out of range: give 0 to 100 units of the"
            " repeatability floor"
        )
    if magnitude == 0.0:
        return 0.0
    effect, at = EFFECTS[name], _calibration(size_name(name, law))
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


def physical_parameters(
    effects: Mapping[str, float], laws: Mapping[str, int] | None = None
) -> dict[str, float]:
    """Physical parameter by effect, from magnitudes and the laws of those that have another than
    law 0.
    """
    by = laws or {}
    return {name: scaled(name, size, by.get(name, 0)) for name, size in effects.items()}


@lru_cache(maxsize=1)
def _sizes() -> Mapping[str, Mapping[str, Any]]:
    return load_provenance(config_file("plant.yaml"))


def _calibration(name: str) -> tuple[float, ...]:
    effect, _ = split_law(name)
    unit, entry = EFFECTS[effect].unit, _sizes().get(f"effects.{name}")
    if entry is None or entry.get("unit") != unit or len(entry["value"]) != len(LEVELS):
        raise ConfigError(
            f"plant.yaml: effects.{name} must be a list for magnitudes 1, 3 and 10 in {unit}: run"
            " `python -m pianobot_ros.emulator.plant.calibrate --missing --write`"
        )
    return tuple(float(v) for v in entry["value"])
