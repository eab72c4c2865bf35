"""The piano cell as one twin of the diagnosis engine: its stages and its effects (a file per
family).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__all__ = ["PianoTwin", "diagnose_bag", "diagnose_recordings"]

if TYPE_CHECKING:
    from pianobot_ros.piano.gap.diagnosis.diagnose import diagnose_bag, diagnose_recordings
    from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin


def __getattr__(name: str) -> Any:
    """Import on first use: numba and scipy take a second."""
    if name in ("diagnose_bag", "diagnose_recordings"):
        from pianobot_ros.piano.gap.diagnosis import diagnose

        return getattr(diagnose, name)
    if name == "PianoTwin":
        from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

        return PianoTwin
    raise AttributeError(f"module {__name__} has no attribute {name}")
