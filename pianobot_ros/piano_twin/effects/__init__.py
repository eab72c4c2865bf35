"""The library of structural effects of the piano cell: a file per family, each with its law and
where it acts.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.piano_twin.effects.base import Family

__all__ = ["LIBRARY", "NAMES", "Family", "library_without"]

NAMES = (
    "wrist_delay",
    "wrist_lag",
    "wrist_compliance",
    "pressure_lag",
    "pressure_leak",
    "regulator_hysteresis",
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
    "midi_velocity_curve",
    "midi_latency",
    "midi_jitter",
    "trigger_offset",
    "fsr_hysteresis",
    "fsr_creep",
    "fsr_saturation",
    "clock_skew",
)
"""Canonical names, in causal order."""

LIBRARY: dict[str, Family] = {name: import_module(f"{__name__}.{name}").FAMILY for name in NAMES}


def library_without(names: Iterable[str]) -> list[Family]:
    """The families but ``names``. Raises :class:`ConfigError` for a name that is not in it."""
    left = dict(LIBRARY)
    for name in names:
        if left.pop(name, None) is None and name not in LIBRARY:
            raise ConfigError(unknown_name("family", name, NAMES))
    return list(left.values())
