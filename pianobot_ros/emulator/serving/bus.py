"""The wiring loom of the emulated cell: shared memory between the plant and the emulated devices.

One file, mapped by every process of the cell; each value and each ring (wrist knots, samples,
events) has one writer and any number of readers, see
:mod:`~pianobot_ros.emulator.serving.shared_memory`.

All times are ``time.monotonic()`` in seconds, which is one clock for all processes of a machine.
The file belongs on a memory file system (``/dev/shm``), and the cell's launcher creates and removes
it.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.host.memory import memory_folder
from pianobot_ros.emulator.serving.bell import Bell
from pianobot_ros.emulator.serving.shared_memory import BusError, SharedMemory

__all__ = ["BusError", "BusSamples", "Events", "PlantBus", "WristKnots", "default_path"]


_MAGIC = 0x70626F74_62757301  # "pbotbus", layout version 1
_CASE_BYTES = 8192
_KNOTS, _SAMPLES, _EVENTS = 256, 8192, 4096
_SAMPLE_WIDTH, _KNOT_WIDTH, _EVENT_WIDTH = 16, 13, 4

_LAYOUT = np.dtype(
    [
        ("magic", "<u8"),
        ("case_size", "<u8"),
        ("case", "u1", (_CASE_BYTES,)),
        ("ready", "<f8"),
        ("heartbeat", "<f8"),
        ("stop", "<u8"),
        ("pressure_sequence", "<u8"),
        ("pressure", "<f8", (4,)),
        ("reaction_sequence", "<u8"),
        ("reaction", "<f8", (4,)),
        ("knot_head", "<u8"),
        ("knots", "<f8", (_KNOTS, _KNOT_WIDTH)),
        ("sample_head", "<u8"),
        ("samples", "<f8", (_SAMPLES, _SAMPLE_WIDTH)),
        ("event_head", "<u8"),
        ("events", "<f8", (_EVENTS, _EVENT_WIDTH)),
    ],
    align=True,
)


@dataclass(frozen=True)
class WristKnots:
    """States of the wrist frame: ``time`` (n,) s, ``pose`` (n, 6) m and rotation vector rad,
    ``twist`` (n, 6) m/s, rad/s.
    """

    next_index: int
    time: Array
    pose: Array
    twist: Array


class BusSamples(NamedTuple):
    """Rows of the 1 kHz ring, oldest first.

    Attributes: ``next_index`` to pass to the next read; ``lost`` rows overwritten before they were
    read; ``time`` (n,) s; ``force`` (n,) true normal force on the key with the force sensor, N;
    ``reading`` (n,) what the sensor makes of it before the converter, N by the nominal calibration
    (sensor effects and noise included); ``device_time`` (n,) the same instant on the
    microcontroller's own clock, s, with an arbitrary origin; ``angles`` (n, 12) key angles, rad,
    lowest note first.
    """

    next_index: int
    lost: int
    time: Array
    force: Array
    reading: Array
    device_time: Array
    angles: Array


@dataclass(frozen=True)
class Events:
    """MIDI events, oldest first: ``time`` (n,) s at which the instrument sends, ``status`` 0x90 or
    0x80, note, velocity.
    """

    next_index: int
    lost: int
    time: Array
    status: NDArray[np.int64]
    note: NDArray[np.int64]
    velocity: NDArray[np.int64]


class PlantBus(SharedMemory):
    """Shared memory of one emulated cell. Make it with :meth:`create` (launcher) or :meth:`attach`
    (everyone else).

    ``bell`` rings when there are new events: these are rare, and who looked for them often enough
    would hardly sleep.
    """

    def __init__(self, path: Path, *, create: bool) -> None:
        super().__init__(path, _LAYOUT, create=create)
        try:
            self.bell = Bell(path.with_name(f"{path.name}.bell"), create=create)
        except OSError as error:
            super().close()
            raise BusError(
                f"the emulated cell at {path} has no bell ({error.strerror}): start it anew"
            ) from error

    @classmethod
    def create(cls, path: str | Path, case: Mapping[str, Any] | None = None) -> PlantBus:
        """A fresh bus at ``path`` (an old file there is replaced). ``case`` says what the cell is
        (JSON), see :meth:`case`.
        """
        text = json.dumps(dict(case or {})).encode()
        if len(text) > _CASE_BYTES:
            raise BusError(
                f"the description of the emulated cell has {len(text)} bytes, at most"
                f" {_CASE_BYTES} fit"
            )
        bus = cls(Path(path), create=True)
        bus._view["case"][0, : len(text)] = np.frombuffer(text, dtype=np.uint8)
        bus._view["case_size"][0] = len(text)
        bus._view["magic"][0] = _MAGIC
        return bus

    @classmethod
    def attach(cls, path: str | Path) -> PlantBus:
        """The bus at ``path``. Raises :class:`BusError` if there is none."""
        bus = cls(Path(path), create=False)
        if int(bus._view["magic"][0]) != _MAGIC:
            bus.close()
            raise BusError(
                f"{path} is not the shared memory of this version of the emulated cell: start the"
                " cell anew"
            )
        return bus

    def case(self) -> dict[str, Any]:
        """What the launcher said this cell is: seed, effects and parameter errors, for the models
        inside the devices.
        """
        size = int(self._view["case_size"][0])
        return dict(json.loads(bytes(self._view["case"][0, :size]).decode() or "{}"))

    # liveness

    def beat(self, *, ready: bool = False) -> None:
        """The plant's sign of life, and once that it is ready."""
        now = time.monotonic()
        self._view["heartbeat"][0] = now
        if ready:
            self._view["ready"][0] = now

    def age(self) -> float:
        """Seconds since the plant's last sign of life; infinite before the first."""
        beat = float(self._view["heartbeat"][0])
        return time.monotonic() - beat if beat else float("inf")

    @property
    def ready(self) -> bool:
        """Whether the plant has started."""
        return bool(self._view["ready"][0])

    def request_stop(self) -> None:
        """Ask every process of the cell to end."""
        self._view["stop"][0] = 1

    @property
    def stop_requested(self) -> bool:
        """Whether the cell is to end."""
        return bool(self._view["stop"][0])

    # inputs of the plant

    def write_wrist(self, t: float, pose: ArrayLike, twist: ArrayLike) -> None:
        """Append the wrist frame's state at time ``t``: pose (6,) m and rotation vector in the base
        frame, twist (6,).

        ``twist`` is the time derivative of ``pose``, coordinate by coordinate. The plant
        interpolates between states with cubics, so write the state at the *end* of the controller's
        cycle as soon as it is known, i.e. with ``t`` one cycle ahead; behind the last state the
        plant extrapolates for 20 ms and then holds. Only the arm writes here.
        """
        knot = np.empty(_KNOT_WIDTH)
        knot[0], knot[1:7], knot[7:] = t, pose, twist
        self._append("knot", knot)

    def read_wrist(self, since_index: int = 0) -> WristKnots:
        """States written since ``since_index`` (0: the newest 128 at most)."""
        _, head, rows = self._rows("knot", since_index)
        return WristKnots(head, rows[:, 0], rows[:, 1:7], rows[:, 7:13])

    def wrist_ring(self) -> tuple[Array, int]:
        """The ring of wrist states itself, rows of time, pose and twist, and how many were ever
        written; read only.
        """
        return self._view["knots"][0], self._head("knot")

    def write_pressure(self, t: float, pressure: ArrayLike) -> None:
        """True gauge pressure (3,), Pa (negative is vacuum), of thumb, index and middle. Only the
        regulator writes here.
        """
        self._write("pressure", t, pressure)

    def read_pressure(self) -> tuple[float, Array]:
        """Time and pressure (3,) last written; time 0 before the first."""
        return self._read("pressure")

    # outputs of the plant

    def write_reaction(self, t: float, force: ArrayLike) -> None:
        """Force (3,), N, that the keys exert on the wrist, base frame. Only the plant writes
        here.
        """
        self._write("reaction", t, force)

    def read_reaction(self) -> Array:
        """Force (3,), N, that the keys exert on the wrist now, base frame."""
        return self._read("reaction")[1]

    def write_samples(self, rows: ArrayLike) -> None:
        """Append a row (16,) or rows (n, 16): time, force, reading, device time, twelve angles.
        Only the plant writes here.
        """
        self._append("sample", rows)

    def read_samples(self, since_index: int | None = None) -> BusSamples:
        """Samples since ``since_index``; None gives none of the past, only the index to go on
        from.
        """
        lost, head, rows = self._rows("sample", since_index)
        return BusSamples(head, lost, rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], rows[:, 4:])

    def write_event(self, t: float, status: int, note: int, velocity: int) -> None:
        """Append a MIDI event that the instrument sends now. Only the plant writes here."""
        self._append("event", np.array([t, status, note, velocity], dtype=float))
        self.bell.ring()

    def events_since(self, index: int) -> bool:
        """Whether there are events that :meth:`read_events` from ``index`` on would return."""
        return self._head("event") > index

    def read_events(self, since_index: int | None = None) -> Events:
        """Events since ``since_index``; None gives none of the past, only the index to go on
        from.
        """
        lost, head, rows = self._rows("event", since_index)
        status, note, velocity = (rows[:, i].astype(np.int64) for i in (1, 2, 3))
        return Events(head, lost, rows[:, 0], status, note, velocity)

    def close(self) -> None:
        """Let go of memory and bell; the creator also removes them."""
        self.bell.close()
        super().close()


def default_path(name: str = "cell") -> Path:
    """Where the bus of the cell ``name`` lives: a file in shared memory, else in the temporary
    directory.
    """
    return memory_folder() / f"pianobot-{os.getuid()}-{name}.bus"
