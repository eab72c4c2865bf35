"""Raw messages of a bag, whole, killed or damaged.

A recorder that was killed leaves an MCAP file without its summary and no ``metadata.yaml``; a bad
disk changes bytes anywhere. So files are read front to back, record by record: a chunk whose
checksum is wrong is left out, a file that breaks off gives what comes before, and both are said
once in words.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeAlias

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk
from mcap.records import Schema as McapSchema
from mcap.stream_reader import MAGIC_SIZE, get_chunk_data_stream, read_magic

from pianobot_ros.bags.message_types import Schema
from pianobot_ros.cell.errors import RecordingError

__all__ = ["RawMessage", "bag_files", "other_bags", "read_raw"]

LARGEST_CHUNK = 1 << 30  # bytes; a chunk that says it is larger is damaged
OF_A_RUN = "bag"  # folder of the first bag in the directory of a run
LATEST = 2**63 - 1  # ns since the epoch; a later time is damaged
_KINDS = {*map(int, Opcode), *range(0x80, 0x100)}  # of records: the format's own and private ones
_HEAD = struct.Struct("<BQ")  # of a record: its kind and the length of its content
_MESSAGE = struct.Struct("<HIQQ")  # channel, number, time of recording, time of publication
_ZSTD = b"\x28\xb5\x2f\xfd"  # how a message that rosbag2 compressed begins


class _Message(NamedTuple):
    """A message's record."""

    channel: int
    number: int
    log_time: int
    sent: int
    data: bytes


_Record: TypeAlias = _Message | McapSchema | Channel


class RawMessage(NamedTuple):
    """One serialized message: ``log_time`` when it was recorded and ``sent`` when it was published,
    both ns since the epoch, ``data`` in CDR, ``qos`` what its publishers offered (YAML).
    """

    topic: str
    type: str
    log_time: int
    sent: int
    data: bytes
    schema: Schema
    qos: str


def bag_files(path: str | Path) -> list[Path]:
    """The MCAP or SQLite files of a bag given as directory or file, in order of recording. The
    directory of a run stands for the first bag in it.
    """
    path = Path(path)
    if path.is_file():
        return [path]
    if not path.exists():
        raise RecordingError(f"{path} does not exist: give the directory of a bag or an .mcap file")
    if path.is_dir() and (files := _files_in(path) or _files_in(path / OF_A_RUN)):
        return files
    raise RecordingError(f"{path} holds no .mcap or .db3 file: it is not a rosbag2 bag")


def other_bags(path: str | Path) -> str:
    """Of the directory of a run: which bags it holds beside the one that it stands for, in one
    line; empty if none. A recorder that was started anew, or told to, begins another.
    """
    path = Path(path)
    if not path.is_dir() or _files_in(path):
        return ""
    others = [p for p in path.glob(f"{OF_A_RUN}-*") if p.is_dir() and _files_in(p)]
    names = ", ".join(p.name for p in sorted(others, key=lambda p: (len(p.name), p.name)))
    return f"{path} also holds {names}: not read, name each by its path" if names else ""


def _files_in(folder: Path) -> list[Path]:
    files = (folder.glob(f"*{suffix}") for suffix in (".mcap", ".db3"))
    return next((sorted(f, key=_split_number) for f in map(list, files) if f), [])


def _split_number(file: Path) -> tuple[int, str]:
    """rosbag2 numbers the files of a split bag without leading zeros."""
    digits = file.stem.rsplit("_", 1)[-1]
    return (int(digits) if digits.isdecimal() else -1, file.name)


def read_raw(path: str | Path, warnings: list[str] | None = None) -> Iterator[RawMessage]:
    """All readable messages of a bag in order of writing.

    Args:
        path: directory of a bag, or one file of it.
        warnings: takes a line for each damage that cost messages.

    Raises:
        RecordingError: if it is no bag at all.
    """
    said: list[str] = [] if warnings is None else warnings
    for file in bag_files(path):
        try:
            if file.suffix == ".db3":
                yield from _read_sqlite(file, said)
            else:
                with file.open("rb") as stream:
                    yield from _Mcap(file, stream, said).messages()
        except OSError as error:
            raise RecordingError(f"{file} cannot be read: {error.strerror or error}") from error


class _Mcap:
    """One MCAP file."""

    def __init__(self, file: Path, stream: BinaryIO, said: list[str]) -> None:
        self.file, self.stream, self.said = file, stream, said
        self.size = file.stat().st_size
        self.channels: dict[int, tuple[str, str, Schema, str]] = {}
        self._schemas: dict[int, McapSchema] = {}
        self._starts: list[int] = []  # where the summary says that chunks begin
        self._lost = 0

    def messages(self) -> Iterator[RawMessage]:
        """What can be read."""
        try:
            read_magic(ReadDataStream(self.stream))
        except Exception as error:  # the library raises many kinds for a short or foreign file
            raise self._nothing() from error
        self._read_summary()
        for record in self._records():
            if not isinstance(record, _Message):
                self._learn(record)
                continue
            channel, _, logged, sent, data = record
            known = self.channels.get(channel)
            if known is None or logged > LATEST or sent > LATEST:
                self._lost += 1
                continue
            topic, kind, schema, qos = known
            yield RawMessage(topic, kind, logged, sent, data, schema, qos)
        if not self.channels:
            raise self._nothing()
        if self._lost:
            self.said.append(
                f"{self._lost} messages of {self.file.name} have no known topic or no possible time"
            )

    def _nothing(self) -> RecordingError:
        return RecordingError(
            f"{self.file} is not an MCAP file, or broke off before its first message"
        )

    def _read_summary(self) -> None:
        """Topics and chunks by the summary, which a whole file has at its end."""
        try:
            summary = SeekingReader(self.stream, validate_crcs=True).get_summary()
        except Exception:  # damaged, as any other part may be
            summary = None
        if summary is not None:
            for record in (*summary.schemas.values(), *summary.channels.values()):
                self._learn(record)
            self._starts = sorted(index.chunk_start_offset for index in summary.chunk_indexes)
        self.stream.seek(MAGIC_SIZE)

    def _learn(self, record: McapSchema | Channel) -> None:
        if isinstance(record, McapSchema):
            self._schemas[record.id] = record
        elif (schema := self._schemas.get(record.schema_id)) is not None:
            self.channels[record.id] = (
                record.topic,
                schema.name,
                Schema(
                    schema.data.decode("utf-8", "replace"),
                    schema.encoding,
                    record.metadata.get("topic_type_hash", ""),
                ),
                record.metadata.get("offered_qos_profiles", ""),
            )

    def _records(self) -> Iterator[_Record]:
        """Schemas, channels and messages; after a damaged record from the next known chunk on."""
        place, damaged = MAGIC_SIZE, 0
        while place < self.size:
            next_chunk = next((start for start in self._starts if start > place), None)
            whole = self._whole(place, next_chunk)
            if whole is None and next_chunk is None:
                self.said.append(f"{self.file.name} breaks off after {place} of {self.size} bytes")
                break
            if whole is None:
                damaged, place = damaged + 1, next_chunk or self.size
                continue
            kind, body = whole
            if kind in (Opcode.DATA_END, Opcode.FOOTER):
                break
            try:
                found = list(_parse(kind, body))
            except Exception:  # whatever a library makes of changed bytes
                damaged, found = damaged + 1, []
            yield from found
            place += _HEAD.size + len(body)
        if damaged:
            self.said.append(f"{damaged} damaged parts of {self.file.name} were left out")

    def _whole(self, place: int, next_chunk: int | None) -> tuple[int, bytes] | None:
        """Kind and content of the record at ``place``; None if it is damaged."""
        self.stream.seek(place)
        head = self.stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return None
        kind, length = _HEAD.unpack(head)
        ends = kind in (Opcode.DATA_END, Opcode.FOOTER) and next_chunk is not None
        if kind not in _KINDS or ends or place + _HEAD.size + length > (next_chunk or self.size):
            return None
        return kind, self.stream.read(length)


def _parse(kind: int, body: bytes) -> Iterator[_Record]:
    """What a record says; of a chunk, all records in it."""
    if kind == Opcode.CHUNK:
        yield from _broken_up(Chunk.read(ReadDataStream(BytesIO(body))))
    elif kind == Opcode.MESSAGE:
        yield _message(body)
    elif kind == Opcode.SCHEMA:
        yield McapSchema.read(ReadDataStream(BytesIO(body)))
    elif kind == Opcode.CHANNEL:
        yield Channel.read(ReadDataStream(BytesIO(body)))


def _broken_up(chunk: Chunk) -> Iterator[_Record]:
    if chunk.uncompressed_size > LARGEST_CHUNK:
        raise ValueError("a chunk of more than 1 GiB")
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    content, place = stream.read(size), 0
    while place < size:
        kind, length = _HEAD.unpack_from(content, place)
        start = place + _HEAD.size
        place = start + length
        if place > size:
            raise ValueError("a record that goes beyond its chunk")
        if kind == Opcode.MESSAGE:
            yield _message(content[start:place])
        elif kind != Opcode.CHUNK:
            yield from _parse(kind, content[start:place])


def _message(body: bytes) -> _Message:
    channel, number, logged, sent = _MESSAGE.unpack_from(body)
    return _Message(channel, number, logged, sent, body[_MESSAGE.size :])


def _read_sqlite(file: Path, said: list[str]) -> Iterator[RawMessage]:
    """A file of rosbag2's older storage, with or without its metadata.yaml."""
    topics: dict[int, tuple[str, str, Schema, str]] = {}
    lost = 0
    try:
        connection = sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True)
        try:
            topics = _sqlite_topics(connection)
            for topic_id, time, data in connection.execute(
                "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
            ):
                whole = isinstance(data, bytes) and isinstance(time, int) and 0 <= time <= LATEST
                if not whole or topic_id not in topics:
                    lost += 1
                    continue
                topic, kind, schema, qos = topics[topic_id]
                yield RawMessage(topic, kind, time, time, _plain(data), schema, qos)
        finally:
            connection.close()
    except (sqlite3.Error, zstandard.ZstdError, UnicodeError) as error:
        if not topics:
            raise RecordingError(f"{file} is not a rosbag2 file: {error}") from error
        said.append(f"{file.name} breaks off: {error}")
    if lost:
        said.append(f"{lost} messages of {file.name} cannot be read")


def _plain(data: bytes) -> bytes:
    if not data.startswith(_ZSTD):
        return data
    return zstandard.decompress(data, max_output_size=LARGEST_CHUNK)


def _sqlite_topics(connection: sqlite3.Connection) -> dict[int, tuple[str, str, Schema, str]]:
    """Name, type, schema and QoS of each topic by its number."""
    connection.row_factory = sqlite3.Row
    rows = connection.execute("SELECT * FROM topics").fetchall()
    texts: dict[str, tuple[str, str]] = {}
    tables = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
    if "message_definitions" in {row["name"] for row in tables}:
        texts = {
            row["topic_type"]: (row["encoded_message_definition"], row["encoding"])
            for row in connection.execute("SELECT * FROM message_definitions")
        }
    connection.row_factory = None
    topics = {}
    for row in rows:
        known = {name: value for name, value in dict(row).items() if isinstance(value, str)}
        text, encoding = texts.get(known.get("type", ""), ("", "ros2msg"))
        schema = Schema(text, encoding, known.get("type_description_hash", ""))
        if "name" in known and "type" in known:
            qos = known.get("offered_qos_profiles", "")
            topics[row["id"]] = known["name"], known["type"], schema, qos
    return topics
