"""The twin with its corrections as MJCF, and what of them MuJoCo has no place for."""

from __future__ import annotations

from pathlib import Path

from pianobot_ros.piano.gap.adoption.adopt import corrections_of
from pianobot_ros.piano.gap.adoption.live_laws import LiveLaws
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.gap.effects.base import StrikeLaw
from pianobot_ros.piano.gap.simulation.corrections import NOTHING
from pianobot_ros.piano.twin.export.mjcf import export_model
from pianobot_ros.piano.twin.export.native_laws import missing_of
from pianobot_ros.piano.twin.model.cell_model import TwinOptions

__all__ = ["export_corrected"]

SENSING = ("fsr_gain", "midi_velocity_gain")


def export_corrected(path: str | Path, diagnosis: str | Path | None = None) -> list[str]:
    """Write the twin to ``path``, with the corrections of a diagnosis or an overlay if one is
    named. Returns what is not in the model, by name and with its value; the file's head says it
    too.
    """
    corrections = NOTHING if diagnosis is None else corrections_of(str(diagnosis))
    laws = LiveLaws(corrections)
    sensing = [(n, c) for n, c in corrections.parameters.items() if n in SENSING]
    left = [f"{n} = {c.value:.6g} (sensing)" for n, c in sensing]
    for effect, own in corrections.effects.items():
        law, stage = LIBRARY[effect].law, LIBRARY[effect].stage
        if not isinstance(law, StrikeLaw):
            left += [f"{effect}.{n} = {c} ({stage})" for n, c in own.items()]
        elif law.side:
            side = law.side(corrections.values())
            left.append(f"{effect}: stiffness by the side of the vacuum = {side:.6g}")
    export_model(path, TwinOptions(parameters=laws.parameters), numbers=laws.numbers, left=left)
    return left + missing_of(laws.numbers)
