"""What a live recording leaves open about its time stamps: one constant by device and recording,
fitted with every candidate.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.numbers.config import Section, load_section, quantity
from pianobot_ros.cell.recordings.recording import Recording
from pianobot_ros.gap import Parameter

__all__ = ["DeviceClock", "is_live", "link_parameters", "note_scatter", "stamp_parameter"]

LIMIT = 8.0  # standard deviations
CLOCK = 86_400.0  # s since the epoch: a clock that was set, or has run for a day


@dataclass(frozen=True)
class DeviceClock:
    """A device's stamps are `late` s, and its clock has `gained` that share of its own time."""

    late: float = 0.0
    gained: float = 0.0

    def true_time(self, stamps: Array) -> Array:
        """The times of stamps (n,), s."""
        exact = not (self.late or self.gained)
        return stamps if exact else (stamps - self.late) * (1.0 - self.gained)

    def shift(self, stamp: float) -> float:
        """How much later than a stamp its time is, s."""
        return (stamp - self.late) * (1.0 - self.gained) - stamp


class Stamps(Section):
    """``config/link.yaml``: standard deviation of each device's constant stamp error."""

    wrist: float = quantity("s", low=0, high=0.1)
    fsr: float = quantity("s", low=0, high=0.1)
    midi: float = quantity("s", low=0, high=0.1)


class Scatter(Section):
    """Standard deviation of a single stamp, where it is not small beside the device's own."""

    midi: float = quantity("s", low=0, high=0.1)


@cache
def link_parameters() -> tuple[Parameter, ...]:
    """Nuisances ``wrist_stamp``, ``fsr_stamp`` and ``midi_stamp``, s: stamps are later than the
    measurements by so much.
    """
    stamps = load_section("link.yaml", Stamps, "stamps")
    devices = {"wrist": stamps.wrist, "fsr": stamps.fsr, "midi": stamps.midi}
    return tuple(
        Parameter(stamp_parameter(name), 0.0, -LIMIT * sd, LIMIT * sd, "s", "clock", sd)
        for name, sd in devices.items()
        if sd > 0
    )


@cache
def note_scatter() -> float:
    """By how much the stamps of notes scatter on their way, s."""
    return load_section("link.yaml", Scatter, "scatter").midi


def stamp_parameter(device: str) -> str:
    """Name of a device's parameter."""
    return f"{device}_stamp"


def is_live(recording: Recording) -> bool:
    """Whether its stamps came over links: nodes recorded it, which publish the arm's joints and the
    twin, or a computer's clock stamped it. A computed cell stamps exactly, and counts from 0.
    """
    named = any(name.startswith(("sim/", "real/joint_states")) for name in recording.signals)
    return named or recording.epoch > CLOCK
