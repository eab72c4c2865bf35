"""Make the bag of a killed recorder, or a damaged one, readable for every MCAP and rosbag2
reader.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rosbags.interfaces import Qos
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos

from pianobot_ros.bags.live_writer import LiveWriter, being_written, fresh_directory
from pianobot_ros.bags.message_types import Schema, schema_of, type_hash, typestore
from pianobot_ros.bags.raw_messages import RawMessage, bag_files, read_raw
from pianobot_ros.cell.errors import RecordingError

__all__ = ["Repaired", "is_whole", "repair_bag"]

_CHUNK = 256 * 1024


@dataclass(frozen=True)
class Repaired:
    """What was done: ``original`` is where the damaged file is now; ``skipped`` messages could not
    be kept.
    """

    path: Path
    original: Path | None
    messages: int
    duration: float

    def as_dict(self) -> dict[str, Any]:
        """The same as plain data, paths as text."""
        plain = asdict(self) | {"path": str(self.path)}
        return plain | {"original": str(self.original) if self.original else None}


def is_whole(path: str | Path) -> bool:
    """Whether the bag has its metadata, and rosbags knows its types and can count its messages."""
    from rosbags.highlevel import AnyReader

    path = Path(path)
    if not (path / "metadata.yaml").is_file():
        return False
    try:
        with AnyReader([path], default_typestore=typestore()) as reader:
            return int(reader.message_count) == sum(1 for _ in reader.messages())
    except Exception:
        return False


def repair_bag(path: str | Path) -> Repaired:
    """Copy every message that can be read into a whole bag at the same path; the original is kept
    as ``<path>.damaged``.

    ``path`` is the bag's directory or the .mcap file in it. A bag that is whole is left alone.
    Raises :class:`RecordingError` if nothing can be read, and then changes nothing.
    """
    path = Path(path)
    lonely = path.is_file() and not path.name.startswith(f"{path.parent.name}_")
    directory = path.with_suffix("") if lonely else bag_files(path)[0].parent
    source = path if lonely else directory
    if any(map(being_written, bag_files(source))):
        raise RecordingError(
            f"{path} is being recorded: end the recording first, nothing was changed"
        )
    if not lonely and is_whole(directory):
        messages, first, last = _span(directory)
        return Repaired(directory, None, messages, (last - first) * 1e-9)
    temporary = fresh_directory(directory.with_name(f"{directory.name}.repairing"))
    writer: LiveWriter | None = None
    first, last = 2**63, 0
    try:
        for raw in read_raw(source):
            if writer is None:
                writer = LiveWriter(temporary, chunk_size=_CHUNK)
            if not writer.knows(raw.topic):
                writer.add_topic(raw.topic, raw.type, _offered(raw.qos), _schema(raw))
            writer.write(raw.topic, raw.log_time, raw.data, raw.sent)
            first, last = min(first, raw.log_time), max(last, raw.log_time)
        if writer is None:
            raise RecordingError(
                f"{path} holds no message that can be read: there is nothing to repair"
            )
        writer.close()
    except BaseException:
        if writer is not None:
            writer.abandon()
        _remove(temporary)
        raise
    original = None
    if not lonely:
        original = fresh_directory(directory.with_name(f"{directory.name}.damaged"))
        directory.rename(original)
    else:
        original = path
        directory = fresh_directory(directory)
    # The file is named after its directory.
    _rename_bag(temporary, directory)
    return Repaired(directory, original, writer.messages, (last - first) * 1e-9)


def _schema(raw: RawMessage) -> Schema:
    """The bag's own description of the type, with the right hash; ours if it has none."""
    text, encoding, _ = raw.schema
    if text and encoding in ("ros2msg", "ros2idl"):
        return Schema(text, encoding, type_hash(raw.type, text, encoding))
    return schema_of(raw.type)


def _offered(text: str) -> list[Qos]:
    try:
        return list(parse_qos(text))
    except (ReaderError, KeyError, TypeError, ValueError):
        return []


def _span(directory: Path) -> tuple[int, int, int]:
    count, first, last = 0, 2**63, 0
    for raw in read_raw(directory):
        count, first, last = count + 1, min(first, raw.log_time), max(last, raw.log_time)
    return count, (first if count else 0), last


def _rename_bag(source: Path, target: Path) -> None:
    (old,) = source.glob("*.mcap")
    new = source / f"{target.name}_0.mcap"
    old.rename(new)
    metadata = source / "metadata.yaml"
    metadata.write_text(
        metadata.read_text(encoding="utf-8").replace(old.name, new.name), encoding="utf-8"
    )
    source.rename(target)


def _remove(directory: Path) -> None:
    if directory.is_dir():
        for file in directory.iterdir():
            file.unlink()
        directory.rmdir()
