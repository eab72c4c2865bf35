"""What the piano cell's twin says of itself to the diagnosis: stages, observables, nuisances, and
the blocks that it simulates.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pianobot_ros.gap import Block, Effect, Observable, Parameter, Signal, Stage
from pianobot_ros.piano.gap.effects.base import (
    ForceLaw,
    LatencyLaw,
    PressureLaw,
    TriggerLaw,
    VelocityLaw,
    WristLaw,
)
from pianobot_ros.piano.gap.evidence.strike_data import StrikeData

__all__ = [
    "SCATTER",
    "STAGES",
    "StrikeBlock",
    "features",
    "is_judged",
    "nuisances",
    "observables",
    "with_data",
]

# of a signal's spread: what the reduced model may be wrong by (0.1 % against another
# implementation)
PRECISION = 0.003
# likewise where the key moves as measured: the encoder's noise passes through a stiff contact
SPLICED = 0.005
# likewise where the key moves under the measured force, which is sampled too rarely for the first
# touch
DRIVEN = 0.008
SCATTER = 3e-4  # s: what the moment of a note scatters by for reasons of measurement alone

STAGES = (
    Stage("wrist", "arm and servo: command to wrist motion"),
    Stage("pneumatics", "vacuum setpoint to pressure"),
    Stage("hand", "finger joints"),
    Stage("contact", "fingertip on key"),
    Stage("key", "key and action"),
    Stage("sensing", "force sensor, key contacts and MIDI"),
    Stage("clock", "time stamps"),
)


@dataclass(frozen=True, kw_only=True)
class StrikeBlock(Block):
    """A strike as the engine sees it, with what the twin needs to simulate it."""

    data: StrikeData


def with_data(block: Block, data: StrikeData) -> StrikeBlock:
    """``block`` with what the twin needs to simulate it."""
    return StrikeBlock(**vars(block), data=data)


def observables(
    blocks: Sequence[StrikeBlock], rig: bool, sensor: bool, link_scatter: float
) -> list[Observable]:
    """What is compared. ``rig``: the key's angle was measured; ``sensor``: the force;
    ``link_scatter``: s by which stamps of notes scatter on their way.
    """
    out = [
        Observable("wrist.z", "wrist", "wrist.z", "m", tolerance=5e-6),
        Observable("pressure", "pneumatics", "pressure", "Pa", tolerance=20.0),
    ]
    force, angle = _spread(blocks, "force"), _spread(blocks, "angle")
    if rig and sensor:
        out.append(
            Observable(
                "force | key as measured",
                "hand",
                "force",
                "N",
                mode="inverse",
                tolerance=SPLICED * force,
            )
        )
        out.append(
            Observable(
                "angle | measured force",
                "key",
                "angle",
                "rad",
                tolerance=DRIVEN * angle,
                spliced="force",
                gain="fsr_gain",
            )
        )
    if sensor:
        out.append(Observable("force", "contact", "force", "N", tolerance=PRECISION * force))
    if rig:
        out.append(Observable("angle", "key", "angle", "rad", tolerance=PRECISION * angle))
    source = " | measured angle" if rig else ""
    stage = "sensing" if rig else "key"
    out += _note_observables(source, stage)
    if sensor and not rig:
        behind = _note_observables(" | measured force", "key")
        out += [replace(o, spliced="force", gain="fsr_gain") for o in behind]
    out.append(Observable("note.count", "sensing", "note.count", "1", "event", floor_hint=0.1))
    out.append(
        Observable(
            "note.scatter",
            "sensing",
            "note.scatter",
            "s",
            "event",
            floor_hint=2e-4,
            tolerance=0.6 * float(np.hypot(SCATTER if rig else 2 * SCATTER, link_scatter)),
        )
    )
    return out


def _spread(blocks: Iterable[Block], signal: str) -> float:
    values = [b.outputs[signal].y for b in blocks if signal in b.outputs]
    return float(np.std(np.concatenate(values))) if values else 1.0


def is_judged(effect: Effect, blocks: Iterable[Block]) -> bool:
    """Whether anything was recorded in which the effect could show."""
    signals: set[str] = set()
    events: set[str] = set()
    for block in blocks:
        signals |= set(block.outputs)
        events |= set(block.events)
    match effect.law:
        case WristLaw():
            return "wrist.z" in signals or bool(events)
        case PressureLaw():
            return "pressure" in signals
        case ForceLaw():
            return "force" in signals
        case LatencyLaw(delay=delay) if delay != effect.magnitude:
            return "note.scatter" in events
        case VelocityLaw() | TriggerLaw() | LatencyLaw():
            return bool(events)
    return True


def features(block: StrikeBlock) -> dict[str, Signal]:
    """What an unexplained residual may depend on."""
    data = block.data
    t = data.grid
    stroke = data.nominal
    out = {
        "time in the strike": Signal(t, t - t[0], "s"),
        "time in the session": Signal(t, t, "s"),
    }
    if stroke is not None:
        angle = data.angle if data.angle is not None else stroke.angle
        rate = data.rate if data.rate is not None else stroke.rate
        force = data.reading if data.reading is not None else stroke.force
        out |= {
            "key angle": Signal(t, angle, "rad"),
            "key speed": Signal(t, rate, "rad/s"),
            "contact force": Signal(t, force, "N"),
        }
    if data.given is not None:
        out["wrist height"] = Signal(t, data.given.position[:, 2], "m")
        out["wrist speed"] = Signal(t, data.given.velocity[:, 2], "m/s")
    out["pressure"] = Signal(
        t, np.broadcast_to(np.asarray(data.pressure, dtype=float), t.shape), "Pa"
    )
    return out


def _note_observables(source: str, stage: str) -> list[Observable]:
    return [
        Observable(
            f"note.onset{source}",
            stage,
            "note.onset",
            "s",
            "event",
            floor_hint=2e-4,
            tolerance=1e-4,
        ),
        Observable(
            f"note.velocity{source}",
            stage,
            "note.velocity",
            "1",
            "event",
            floor_hint=0.4,
            tolerance=0.3,
        ),
        Observable(
            f"note.hold{source}", stage, "note.hold", "s", "event", floor_hint=2e-4, tolerance=2e-4
        ),
        Observable(
            f"note.release{source}",
            stage,
            "note.release",
            "1",
            "event",
            floor_hint=0.4,
            tolerance=0.35,
        ),
    ]


def nuisances() -> tuple[Parameter, ...]:
    """Factors of the numbers that may be wrong without any structure missing."""

    def factor(name: str, stage: str, sd: float = 0.25) -> Parameter:
        return Parameter(name, 1.0, 0.4, 2.5, "1", stage, sd, log=True)

    return (
        factor("joint_stiffness", "hand"),
        factor("joint_damping", "hand"),
        factor("key_stiffness", "key"),
        factor("key_damping", "key"),
        factor("key_inertia", "key"),
        factor("fsr_gain", "sensing"),
        factor("midi_velocity_gain", "sensing"),
    )
