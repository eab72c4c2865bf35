"""The library of structural effects of the piano cell: a folder per stage, in it a file per effect
with its law.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.gap import Effect

__all__ = ["LIBRARY", "NAMES", "library_without"]

_FOLDERS: dict[str, tuple[str, ...]] = {
    "wrist": (
        "wrist_delay",
        "wrist_lag",
        "wrist_compliance",
    ),
    "pneumatics": (
        "pressure_lag",
        "pressure_leak",
        "regulator_hysteresis",
    ),
    "hand": (
        "joint_friction",
        "joint_backlash",
        "joint_hardening",
        "jamming_hysteresis",
        "joint_creep",
    ),
    "contact": (
        "pad_compliance",
        "tip_slip",
        "tip_offset",
    ),
    "key": (
        "key_friction",
        "key_preload",
        "hammer",
        "let_off",
        "felt_nonlinear",
    ),
    "sensing": (
        "midi_velocity_curve",
        "midi_latency",
        "midi_jitter",
        "trigger_offset",
        "fsr_hysteresis",
        "fsr_creep",
        "fsr_saturation",
        "clock_skew",
    ),
}

NAMES = tuple(name for names in _FOLDERS.values() for name in names)
"""Canonical names, in causal order."""

LIBRARY: dict[str, Effect] = {
    name: import_module(f"{__name__}.{folder}.{name}").EFFECT
    for folder, names in _FOLDERS.items()
    for name in names
}


def library_without(names: Iterable[str]) -> list[Effect]:
    """The families but ``names``. Raises :class:`ConfigError` for a name that is not in it."""
    left = dict(LIBRARY)
    for name in names:
        if left.pop(name, None) is None and name not in LIBRARY:
            raise ConfigError(unknown_name("family", name, NAMES))
    return list(left.values())
