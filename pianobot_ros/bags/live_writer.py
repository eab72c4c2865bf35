"""Writing a bag while it happens: a rosbag2 MCAP directory that a kill at any time leaves readable.

The bag is as rosbag2 of Jazzy writes it: definitions with their comments, RIHS01 type hashes, the
QoS that each topic's publishers offered, and log times that never step back. Each
:meth:`LiveWriter.flush` closes the current chunk and hands it to the operating system, so a killed
process loses what came after the last one. ``metadata.yaml`` is written at the orderly end only;
``pianobot bag repair`` makes it otherwise.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Qos
from rosbags.rosbag2.metadata import dump_qos_v9

from pianobot_ros.bags.message_types import Schema, schema_of
from pianobot_ros.cell.errors import RecordingError

__all__ = ["LiveWriter", "being_written", "fresh_directory"]


@dataclass
class _Topic:
    name: str
    type: str
    channel: int
    digest: str
    qos: list[Any]
    count: int = 0


class LiveWriter:
    """A bag that is being written. ``path`` is its directory, which must not exist yet."""

    def __init__(self, path: str | Path, chunk_size: int = 1024) -> None:
        self.path = Path(path)
        if self.path.exists():
            raise RecordingError(
                f"{self.path} exists already: choose another name, nothing was overwritten"
            )
        try:
            self.path.mkdir(parents=True)
            self.file = self.path / f"{self.path.name}_0.mcap"
            self._stream = self.file.open("wb", buffering=1 << 20)
        except OSError as error:
            raise RecordingError(f"cannot record to {self.path}: {error.strerror}") from error
        with contextlib.suppress(OSError):  # some network disks have no locks
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)  # ends with this process
        # Without compression: it would cost more of a busy core than the disk space is worth.
        self._writer = Writer(self._stream, chunk_size=chunk_size, compression=CompressionType.NONE)
        self._writer.start(profile="ros2", library="pianobot")
        self._schemas: dict[Schema, int] = {}
        self._topics: dict[str, _Topic] = {}
        self._first, self._last = 2**63 - 1, 0
        self.messages = 0
        self._stream.flush()

    def knows(self, topic: str) -> bool:
        """Whether the topic was added."""
        return topic in self._topics

    def add_topic(
        self, topic: str, kind: str, qos: Sequence[Qos] = (), schema: Schema | None = None
    ) -> None:
        """Add a topic of type ``package/msg/Name``.

        Args:
            topic: its name.
            kind: its type.
            qos: what each publisher of the topic offers.
            schema: the type's description; by default that of the installed or known type.

        Raises:
            RecordingError: for a type that is not known.
        """
        schema = schema or schema_of(kind)
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(
                kind, schema.encoding, schema.text.encode()
            )
        offered = dump_qos_v9(list(qos))
        channel = self._writer.register_channel(
            topic,
            "cdr",
            self._schemas[schema],
            {
                "offered_qos_profiles": yaml.safe_dump(offered, sort_keys=False) if qos else "",
                "topic_type_hash": schema.digest,
            },
        )
        self._topics[topic] = _Topic(topic, kind, channel, schema.digest, offered)

    def write(self, topic: str, received: int, data: bytes, sent: int | None = None) -> None:
        """Append a serialized message of an added topic.

        Args:
            topic: where it was published.
            received: ns since the epoch at which it arrived, its log time. A message that is
                written behind a later one takes that one's time, as log times do not step back in
                the order of the file.
            data: the message in CDR.
            sent: ns since the epoch at which it was published; by default ``received``.

        Raises:
            OSError: when the disk is full.
        """
        entry = self._topics[topic]
        self._last = max(self._last, received)
        sent = received if sent is None else sent
        self._writer.add_message(entry.channel, self._last, data, sent, entry.count)
        entry.count += 1
        self.messages += 1
        self._first = min(self._first, self._last)

    def flush(self) -> None:
        """Hand everything to the operating system. Raises OSError when the disk is full."""
        # The library closes a chunk only when it is full; a slow topic would then wait for seconds
        # in this process.
        getattr(self._writer, "_Writer__finalize_chunk")()  # noqa: B009
        self._stream.flush()

    def close(self) -> None:
        """Write summary and metadata. Raises OSError when the disk is full."""
        if self._stream.closed:
            return
        information = self._information()
        inside = yaml.safe_dump(information, sort_keys=False)
        self.flush()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": inside})
        self._writer.finish()
        self._stream.close()
        text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
        (self.path / "metadata.yaml").write_text(text, encoding="utf-8")

    def abandon(self) -> None:
        """Close the file as it is, after a failed write."""
        import contextlib

        with contextlib.suppress(OSError, ValueError):
            self._stream.close()

    def _information(self) -> dict[str, Any]:
        """What metadata.yaml says, in version 9."""
        first = self._first if self.messages else 0
        duration = {"nanoseconds": max(self._last - first, 0)}
        start = {"nanoseconds_since_epoch": first}
        return {
            "version": 9,
            "storage_identifier": "mcap",
            "duration": duration,
            "starting_time": start,
            "message_count": self.messages,
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": t.name,
                        "type": t.type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": t.qos,
                        "type_description_hash": t.digest,
                    },
                    "message_count": t.count,
                }
                for t in self._topics.values()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self.file.name],
            "files": [
                {
                    "path": self.file.name,
                    "starting_time": dict(start),
                    "duration": dict(duration),
                    "message_count": self.messages,
                }
            ],
            "custom_data": None,
            "ros_distro": "jazzy",
        }


def being_written(file: Path) -> bool:
    """Whether a process is still writing a bag's file: not if it was killed."""
    try:
        with file.open("rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # no such file, or a disk without locks
        pass
    return False


def fresh_directory(path: Path) -> Path:
    """``path`` if it is free, else the first free ``path-2``, ``path-3`` …"""
    if not path.exists():
        return path
    return next(
        p for i in itertools.count(2) if not (p := path.with_name(f"{path.name}-{i}")).exists()
    )
