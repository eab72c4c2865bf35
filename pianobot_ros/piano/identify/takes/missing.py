"""Signatures of effects that the nominal model leaves out and that are not in its mechanics."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pianobot_ros.cell.arrays import Array
from pianobot_ros.piano.identify.takes.take import Take
from pianobot_ros.piano.twin.reduced.strike_model import GRID

__all__ = ["NOT_MECHANICAL", "ON_STIFFNESS", "in_force", "in_notes", "share_of"]


ON_STIFFNESS = ("stiffness_drift", "side_of_loading")  # differ from repeat to repeat
NOT_MECHANICAL = frozenset(
    {
        *ON_STIFFNESS,
        "fsr_offset",
        "fsr_curvature",
        "fsr_hysteresis",
        "fsr_creep",
        "midi_curve",
        "trigger_speed",
    }
)
SENSED = 0.05  # N: less does not count as a load
FULL_VELOCITY = 127.0
TEN_NEWTON = 10.0  # N: reference of a sensor's curvature
LOOP = 0.3  # N: change of force over which a sensor's hysteresis turns
CREEP_FROM = 0.01  # s


def share_of(name: str, take: Take, side: float, span: tuple[float, float]) -> float:
    """How much of an effect on the stiffness ``name`` a strike has. ``side``: from which side the
    vacuum came, -1 to 1; ``span``: start and length of the recording, s.
    """
    return side if name == "side_of_loading" else (take.strike.start - span[0]) / span[1]


def in_force(take: Take, force: Array, effects: Mapping[str, float]) -> Array:
    """The sensor's reading (n,) N of a force on the grid."""
    loaded = force > SENSED
    if offset := effects.get("fsr_offset"):
        force = force + offset
    if curvature := effects.get("fsr_curvature"):
        force = force * (1.0 + curvature * force / TEN_NEWTON)
    if hysteresis := effects.get("fsr_hysteresis"):
        force = force * (1.0 - hysteresis * np.tanh(np.gradient(force) * 50 / LOOP))
    if creep := effects.get("fsr_creep"):
        since = GRID * np.cumsum(loaded)
        force = force * (1.0 + creep * np.log10(1.0 + since / CREEP_FROM))
    return force


def in_notes(row: Array, effects: Mapping[str, float]) -> Array:
    """Moment, length, velocity and release velocity (4,) of a note."""
    onset, hold, velocity, release = row
    if bend := effects.get("midi_curve"):
        shares = np.clip(row[2:] / FULL_VELOCITY, 0.0, 1.0)
        velocity, release = row[2:] + 4.0 * bend * shares * (1.0 - shares)
    if slow := effects.get("trigger_speed"):
        delay = slow * 30.0 / np.maximum(row[2:], 5.0)
        onset, hold = onset + delay[0], hold + delay[1] - delay[0]
    return np.array([onset, hold, velocity, release])
