"""Raw messages of a bag, whole or killed.

A recorder that was killed leaves an MCAP file without its summary and no ``metadata.yaml``. Reading front to back, and
stopping quietly where the file breaks off, works for both.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader, ReaderError

from pianobot_ros.cell.errors import RecordingError

__all__ = ["RawMessage", "bag_files", "read_raw"]

# What a file that breaks off in the middle of a record or of a compressed chunk makes the readers raise.
_BROKEN_OFF = (
    McapError,
    EOFError,
    struct.error,
    zlib.error,
    RuntimeError,
    ValueError,
    OverflowError,
    UnicodeDecodeError,
)


@dataclass(frozen=True)
class RawMessage:
    """One serialized message: ``log_time`` ns since the epoch, ``data`` in CDR, ``definition`` the schema's text."""

    topic: str
    type: str
    log_time: int
    data: bytes
    definition: str


def bag_files(path: str | Path) -> list[Path]:
    """The MCAP or SQLite files of a bag given as directory or file, in order of recording."""
    path = Path(path)
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise RecordingError(f"{path} does not exist: give the directory of a bag or an .mcap file")
    files = sorted(path.glob("*.mcap"), key=_split_number) or sorted(path.glob("*.db3"), key=_split_number)
    if not files:
        raise RecordingError(f"{path} holds no .mcap or .db3 file: it is not a rosbag2 bag")
    return files


def _split_number(file: Path) -> tuple[int, str]:
    """rosbag2 numbers the files of a split bag without leading zeros."""
    digits = file.stem.rsplit("_", 1)[-1]
    return (int(digits) if digits.isdigit() else -1, file.name)


def read_raw(path: str | Path) -> Iterator[RawMessage]:
    """All readable messages of a bag in order of writing. Raises :class:`RecordingError` if it is no bag at all."""
    for file in bag_files(path):
        if file.suffix == ".db3":
            yield from _read_sqlite(file)
        else:
            yield from _read_mcap(file)


def _read_mcap(file: Path) -> Iterator[RawMessage]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    with file.open("rb") as stream:
        try:
            for record in StreamReader(stream).records:
                if isinstance(record, Message):
                    channel = channels[record.channel_id]
                    schema = schemas[channel.schema_id]
                    yield RawMessage(
                        channel.topic, schema.name, record.log_time, record.data, schema.data.decode("utf-8", "replace")
                    )
                elif isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Footer):
                    return
        except _BROKEN_OFF as error:
            if not channels:
                raise RecordingError(f"{file} is not an MCAP file, or broke off before its first message") from error


def _read_sqlite(file: Path) -> Iterator[RawMessage]:
    try:
        with Reader(file.parent) as reader:
            for connection, time, data in reader.messages():
                yield RawMessage(connection.topic, connection.msgtype, time, data, connection.msgdef.data)
    except ReaderError as error:
        raise RecordingError(f"{file.parent} cannot be read: {error}") from error
