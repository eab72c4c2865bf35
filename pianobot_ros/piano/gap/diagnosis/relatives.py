"""Which families may stand in for one another when one of them is missing from the library.

Declared before any case is scored; the blind check reads it, and docs/effects.md prints it
(``python -m pianobot_ros.piano.gap.diagnosis.relatives``).
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["RELATIVES", "relatives_of", "to_markdown"]

RELATIVES: Mapping[tuple[str, str], str] = {
    ("wrist_delay", "wrist_lag"): "a short lag is a delay at any speed that is played",
    ("pressure_lag", "pressure_leak"): "a leak that regulates slowly is a slow end of a step",
    ("pressure_leak", "regulator_hysteresis"): "both leave the level short, from one side",
    ("joint_friction", "jamming_hysteresis"): "both make a loop of force; only vacuum tells",
    ("joint_friction", "tip_slip"): "a tip that slides more changes the same loop at release",
    ("jamming_hysteresis", "joint_creep"): "both lose force after a press; only hold times tell",
    ("joint_backlash", "pad_compliance"): "both are soft in the first half millimetre",
    ("jamming_hysteresis", "tip_offset"): "a set that earlier strikes left moves the fingertip",
    ("key_preload", "hammer"): "a hammer's weight is a torque against the rest stop",
    ("fsr_hysteresis", "fsr_creep"): "both read more late in a strike than early",
    ("midi_latency", "midi_jitter"): "a jitter has a mean delay",
}
"""Pairs in causal order, and why they are alike."""


def relatives_of(name: str) -> frozenset[str]:
    """Families that are declared inseparable from ``name`` where it is withheld."""
    return frozenset(b if a == name else a for a, b in RELATIVES if name in (a, b))


def to_markdown() -> str:
    """The table of docs/effects.md."""
    rows = [f"| `{a}` | `{b}` | {why} |" for (a, b), why in RELATIVES.items()]
    return "\n".join(["| family | relative | why |", "| -- | -- | -- |", *rows]) + "\n"


if __name__ == "__main__":
    print(to_markdown(), end="")
