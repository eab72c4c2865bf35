"""The wiring loom of the emulated cell: shared memory between the plant and the emulated devices.

One file, mapped by every process of the cell. Each value has one writer and any number of readers and is guarded by a
sequence lock: the writer makes the sequence odd, writes, makes it even; a reader takes a copy and reads again if the
sequence was odd or has changed. Rings (wrist knots, samples, events) have one writer, who raises the head after the row
is complete; a reader who was lapped is told how many rows it lost.

All times are ``time.monotonic()`` in seconds, which is one clock for all processes of a machine. The file belongs on a
memory file system (``/dev/shm``), and the cell's launcher creates and removes it.
"""

from __future__ import annotations

import contextlib
import json
import mmap
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pianobot_ros.cell.errors import DeviceError

__all__ = ["BusError", "Events", "PlantBus", "Samples", "WristKnots", "default_path"]

Array = NDArray[np.float64]

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


class BusError(DeviceError):
    """The shared memory of the emulated cell is missing, not ready, or from another version."""


@dataclass(frozen=True)
class WristKnots:
    """States of the wrist frame: ``time`` (n,) s, ``pose`` (n, 6) m and rotation vector rad, ``twist`` (n, 6) m/s, rad/s."""

    next_index: int
    time: Array
    pose: Array
    twist: Array


@dataclass(frozen=True)
class Samples:
    """Rows of the 1 kHz ring, oldest first.

    Attributes: ``next_index`` to pass to the next read; ``lost`` rows overwritten before they were read; ``time`` (n,) s;
    ``force`` (n,) true normal force on the key with the force sensor, N; ``reading`` (n,) what the sensor makes of it
    before the converter, N by the nominal calibration (sensor effects and noise included); ``device_time`` (n,) the
    same instant on the microcontroller's own clock, s, with an arbitrary origin; ``angles`` (n, 12) key angles, rad, lowest
    note first.
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
    """MIDI events, oldest first: ``time`` (n,) s at which the instrument sends, ``status`` 0x90 or 0x80, note, velocity."""

    next_index: int
    lost: int
    time: Array
    status: NDArray[np.int64]
    note: NDArray[np.int64]
    velocity: NDArray[np.int64]


class PlantBus:
    """Shared memory of one emulated cell. Make it with :meth:`create` (launcher) or :meth:`attach` (everyone else)."""

    def __init__(self, path: Path, *, create: bool) -> None:
        self.path = path
        flags = os.O_RDWR | (os.O_CREAT | os.O_TRUNC if create else 0)
        try:
            descriptor = os.open(path, flags, 0o600)
        except OSError as error:
            raise BusError(
                f"no emulated cell at {path} ({error.strerror}): start `python -m pianobot_ros.emulator`"
            ) from error
        try:
            if create:
                os.ftruncate(descriptor, _LAYOUT.itemsize)
            elif os.fstat(descriptor).st_size != _LAYOUT.itemsize:
                raise BusError(
                    f"{path} is not the shared memory of this version of the emulated cell: start the cell anew"
                )
            self._map = mmap.mmap(descriptor, _LAYOUT.itemsize)
        finally:
            os.close(descriptor)
        self._data: Any = np.frombuffer(self._map, dtype=_LAYOUT, count=1)
        self._view = {name: self._data[name] for name in _LAYOUT.names or ()}
        self._created = create

    @classmethod
    def create(cls, path: str | Path, case: Mapping[str, Any] | None = None) -> PlantBus:
        """A fresh bus at ``path`` (an old file there is replaced). ``case`` says what the cell is (JSON), see :meth:`case`."""
        text = json.dumps(dict(case or {})).encode()
        if len(text) > _CASE_BYTES:
            raise BusError(f"the description of the emulated cell has {len(text)} bytes, at most {_CASE_BYTES} fit")
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
            raise BusError(f"{path} is not the shared memory of this version of the emulated cell: start the cell anew")
        return bus

    def case(self) -> dict[str, Any]:
        """What the launcher said this cell is: seed, effects and parameter errors, for the models inside the devices."""
        size = int(self._view["case_size"][0])
        return dict(json.loads(bytes(self._view["case"][0, :size]).decode() or "{}"))

    # ---- liveness -------------------------------------------------------------------------------------------------

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

    # ---- inputs of the plant --------------------------------------------------------------------------------------

    def write_wrist(self, t: float, pose: ArrayLike, twist: ArrayLike) -> None:
        """Append the wrist frame's state at time ``t``: pose (6,) m and rotation vector in the base frame, twist (6,).

        ``twist`` is the time derivative of ``pose``, coordinate by coordinate. The plant interpolates between states with
        cubics, so write the state at the *end* of the controller's cycle as soon as it is known, i.e. with ``t`` one cycle
        ahead; behind the last state the plant extrapolates for 20 ms and then holds. Only the arm writes here.
        """
        head = int(self._view["knot_head"][0])
        row = self._view["knots"][0, head % _KNOTS]
        row[0] = t
        row[1:7] = pose
        row[7:13] = twist
        self._view["knot_head"][0] = head + 1

    def read_wrist(self, since_index: int = 0) -> WristKnots:
        """States written since ``since_index`` (0: the newest 128 at most)."""
        first, head, rows = self._rows("knots", "knot_head", _KNOTS, since_index)
        del first
        return WristKnots(head, rows[:, 0], rows[:, 1:7], rows[:, 7:13])

    def wrist_ring(self) -> tuple[Array, int]:
        """The ring of wrist states itself, rows of time, pose and twist, and how many were ever written; read only."""
        return self._view["knots"][0], int(self._view["knot_head"][0])

    def write_pressure(self, t: float, pressure: ArrayLike) -> None:
        """True gauge pressure (3,), Pa (negative is vacuum), of thumb, index and middle. Only the regulator writes here."""
        self._write("pressure", t, pressure)

    def read_pressure(self) -> tuple[float, Array]:
        """Time and pressure (3,) last written; time 0 before the first."""
        return self._read("pressure")

    # ---- outputs of the plant -------------------------------------------------------------------------------------

    def write_reaction(self, t: float, force: ArrayLike) -> None:
        """Force (3,), N, that the keys exert on the wrist, base frame. Only the plant writes here."""
        self._write("reaction", t, force)

    def read_reaction(self) -> Array:
        """Force (3,), N, that the keys exert on the wrist now, base frame."""
        return self._read("reaction")[1]

    def write_samples(self, rows: ArrayLike) -> None:
        """Append rows (n, 16): time, force, reading, device time, twelve angles. Only the plant writes here."""
        self._append("samples", "sample_head", _SAMPLES, np.asarray(rows, dtype=float).reshape(-1, _SAMPLE_WIDTH))

    def read_samples(self, since_index: int | None = None) -> Samples:
        """Samples since ``since_index``; None gives none of the past, only the index to go on from."""
        if since_index is None:
            since_index = int(self._view["sample_head"][0])
        first, head, rows = self._rows("samples", "sample_head", _SAMPLES, since_index)
        return Samples(head, first - since_index, rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3], rows[:, 4:])

    def write_event(self, t: float, status: int, note: int, velocity: int) -> None:
        """Append a MIDI event that the instrument sends now. Only the plant writes here."""
        self._append("events", "event_head", _EVENTS, np.array([[t, status, note, velocity]], dtype=float))

    def read_events(self, since_index: int | None = None) -> Events:
        """Events since ``since_index``; None gives none of the past, only the index to go on from."""
        if since_index is None:
            since_index = int(self._view["event_head"][0])
        first, head, rows = self._rows("events", "event_head", _EVENTS, since_index)
        status, note, velocity = (rows[:, i].astype(np.int64) for i in (1, 2, 3))
        return Events(head, first - since_index, rows[:, 0], status, note, velocity)

    # ---- mechanics of the locks -----------------------------------------------------------------------------------

    def _write(self, name: str, t: float, value: ArrayLike) -> None:
        sequence, block = self._view[f"{name}_sequence"], self._view[name]
        start = int(sequence[0])
        sequence[0] = start + 1
        block[0, 0] = t
        block[0, 1:] = value
        sequence[0] = start + 2

    def _read(self, name: str) -> tuple[float, Array]:
        sequence, block = self._view[f"{name}_sequence"], self._view[name]
        while True:
            before = int(sequence[0])
            copy = block[0].copy()
            if before % 2 == 0 and int(sequence[0]) == before:
                return float(copy[0]), copy[1:]
            time.sleep(0)

    def _append(self, ring: str, head_name: str, size: int, rows: Array) -> None:
        head = int(self._view[head_name][0])
        for i, row in enumerate(rows):
            self._view[ring][0, (head + i) % size] = row
            self._view[head_name][0] = head + i + 1

    def _rows(self, ring: str, head_name: str, size: int, since: int) -> tuple[int, int, Array]:
        """First index, end index and rows of a ring from ``since`` on; half the ring is kept as margin against the writer."""
        while True:
            head = int(self._view[head_name][0])
            first = max(since, head - size // 2)
            index = np.arange(first, max(head, first)) % size
            rows = np.array(self._view[ring][0, index])
            if int(self._view[head_name][0]) - first < size:
                return first, head, rows

    def close(self) -> None:
        """Let go of the memory; the creator also removes the file."""
        if self._map.closed:
            return
        self._view.clear()
        self._data = None
        with contextlib.suppress(BufferError):  # someone still holds an array that points here
            self._map.close()
        if self._created:
            with contextlib.suppress(FileNotFoundError):
                self.path.unlink()

    def __enter__(self) -> PlantBus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def default_path(name: str = "cell") -> Path:
    """Where the bus of the cell ``name`` lives: a file in shared memory, else in the temporary directory."""
    base = Path("/dev/shm") if Path("/dev/shm").is_dir() else Path(os.environ.get("TMPDIR", "/tmp"))
    return base / f"pianobot-{os.getuid()}-{name}.bus"
