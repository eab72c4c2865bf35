"""Strikes that could be played next: candidates for the engine to choose from, and the phrase that
plays the chosen ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import FINGERS, pivot_radius
from pianobot_ros.cell.motion.limits import wrist_limits
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.cell.motion.wrist_poses import wrist_pose
from pianobot_ros.cell.numbers.bounded_files import yaml_text
from pianobot_ros.cell.numbers.whole_files import write_whole
from pianobot_ros.cell.recordings.commands import CYCLE
from pianobot_ros.cell.recordings.keystroke import NoteEvent
from pianobot_ros.cell.recordings.recording import Recording, Strike, TimeSeries
from pianobot_ros.cell.score.midi_file import SLOWEST
from pianobot_ros.piano.gap.evidence.blocks import prepare
from pianobot_ros.piano.gap.simulation.description import StrikeBlock, with_data
from pianobot_ros.piano.gap.simulation.note_events import NoteSensor
from pianobot_ros.piano.gap.simulation.piano_twin import PianoTwin

__all__ = ["candidate_strikes", "phrase_of", "write_phrase"]

DEPTHS = (0.009, 0.020)  # m
HOLDS = (0.1, 2.0)  # s
LEVELS = (0.0, -50e3, -100e3)  # Pa


def candidate_strikes(twin: PianoTwin, seed: int = 0, count: int = 24) -> list[StrikeBlock]:
    """Blocks of strikes that could be played next, with the signals that this cell records; the
    twin can simulate them.

    Speed, depth, hold and pressure evenly cover all that the arm may do (Latin hypercube: McKay,
    Beckman and Conover 1979): laws that agree amid the first set part at its ends. The key is the
    one struck most.
    """
    marks = [b.data.mark for b in twin.blocks]
    (finger, note), _ = Counter((m.finger, m.note) for m in marks).most_common(1)[0]
    random = np.random.default_rng([seed, 0xE9])

    def spread() -> Array:
        return np.asarray((random.permutation(count) + random.uniform(size=count)) / count)

    depths = np.round(DEPTHS[0] + (DEPTHS[1] - DEPTHS[0]) * spread(), 4)
    holds = np.round(HOLDS[0] * (HOLDS[1] / HOLDS[0]) ** spread(), 2)
    levels = random.permutation(np.resize(LEVELS, count))
    limits, blocks = wrist_limits(), []
    for i, (depth, hold, level, share) in enumerate(
        zip(depths.tolist(), holds.tolist(), levels.tolist(), spread().tolist(), strict=True)
    ):
        fastest = limits.fastest(depth + StrikeMotion.clearance)
        speed = round(SLOWEST * (fastest / SLOWEST) ** share, 3)
        motion = StrikeMotion(speed, depth, hold)
        blocks.append(_propose(twin, i, finger, note, motion, level))
    return blocks


def _propose(
    twin: PianoTwin, index: int, finger: str, note: int, motion: StrikeMotion, level: float
) -> StrikeBlock:
    pose = wrist_pose({finger: note})
    lead = 0.3
    t = np.arange(0.0, lead + motion.duration + 0.4, CYCLE)
    height = np.where(t >= lead, motion.height(t - lead), motion.clearance)
    position = np.tile(pose.position, (len(t), 1))
    position[:, 2] += height
    rotation = np.tile(pose.rotation.as_rotvec(), (len(t), 1))
    pressure = np.full((len(t), len(FINGERS)), level)
    strike = Strike(
        index,
        "proposed",
        f"proposal {index + 1}",
        finger,
        note,
        lead - 0.02,
        lead + motion.duration + 0.15,
        motion.speed,
        motion.depth,
        motion.hold,
        level,
        motion.duration + 0.15,
    )
    signals = {
        "command/wrist.position": TimeSeries(t, position, "m"),
        "command/wrist.rotation": TimeSeries(t, rotation, "rad"),
        "command/vacuum.pressure": TimeSeries(t[:1], pressure[:1], "Pa"),
    }
    if "pressure" in {s for b in twin.blocks for s in b.outputs}:
        signals["real/vacuum/state.setpoint"] = signals["real/vacuum/state.measured"] = TimeSeries(
            t, pressure, "Pa"
        )
    recording = Recording(signals, {}, [strike], note, source="proposal")
    _, found, (session,), _ = prepare([recording])
    data = next(iter(found.values()))
    assert session.wrist is not None and data.nominal is not None
    # What would be measured is what the nominal twin does: that is what gets spliced in.
    grid, stroke = data.grid, data.nominal
    wrist = np.column_stack([np.interp(t, session.time, session.wrist[:, i]) for i in range(3)])
    signals["real/wrist/state.position"] = TimeSeries(t, wrist, "m")
    if twin.sensor:
        signals["real/fsr.force"] = TimeSeries(grid, stroke.force, "N")
    if twin.rig:
        signals[f"real/key_angle.{note}"] = TimeSeries(grid, stroke.angle, "rad")
    full = {p.name: p.nominal for p in twin.parameters}
    played = NoteSensor(full, []).events(stroke, note, pivot_radius(note))
    notes = []
    if np.isfinite(played["note.hold"]):
        on = data.start + played["note.onset"]
        notes = [
            NoteEvent(on, True, note, round(played["note.velocity"])),
            NoteEvent(on + played["note.hold"], False, note, round(played["note.release"])),
        ]
    recorded = replace(recording, signals=signals, notes={"real": notes})
    (block,), found, _, _ = prepare([recorded])
    name = f"proposal {index + 1}"
    data = replace(next(iter(found.values())), name=name)
    return with_data(replace(block, name=name, condition=name), data)


def phrase_of(
    proposals: Sequence[dict[str, Any]], repeats: int = 4, name: str = "next experiment"
) -> dict[str, Any]:
    """A phrase (docs/phrases.md) that plays the proposals, each ``repeats`` times in shuffled
    rounds.
    """
    strikes = []
    for p in proposals:
        a = p["attributes"]
        strikes.append(
            {
                "note": int(a["note"]),
                "finger": FINGERS[int(a["finger"])],
                "speed": float(a["speed"]),
                "depth": float(a["depth"]),
                "hold": float(a["hold"]),
                "pressure": float(a["pressure"]),
                "condition": str(p["name"]),
                "repeats": repeats,
            }
        )
    pairs = sorted({" and ".join(p["separates"]) for p in proposals if p.get("separates")})
    text = (
        f"Proposed by the diagnosis to tell {'; '.join(pairs)} apart."
        if pairs
        else "Proposed by the diagnosis."
    )
    return {"name": name, "description": text, "order": "shuffled", "seed": 0, "strikes": strikes}


def write_phrase(phrase: dict[str, Any], path: str | Path) -> Path:
    """Write a phrase as YAML."""
    return write_whole(path, yaml_text(phrase))
