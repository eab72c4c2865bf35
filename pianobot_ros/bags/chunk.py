"""The chunk of an MCAP file that is being filled: many small messages, each put in with one write.

The mcap library builds a record field by field, which costs several times as much as all the rest
of recording.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from mcap._chunk_builder import ChunkBuilder
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex

__all__ = ["Chunk"]

# Opcode and length of a record; then of a message its channel, running number and times of arrival
# and sending, ns; of an index its channel and the bytes that follow.
_MESSAGE = struct.Struct("<BQHIQQ")
_INDEX = struct.Struct("<BQHI")
_RECORD = struct.calcsize("<BQ")


@dataclass
class _Index(MessageIndex):  # type: ignore[misc,unused-ignore]
    """Where the messages of one channel lie, written at once."""

    def write(self, stream: RecordBuilder) -> None:
        """Append the record."""
        numbers = [number for record in self.records for number in record]
        size = 8 * len(numbers)
        length = _INDEX.size - _RECORD + size
        stream.write(_INDEX.pack(Opcode.MESSAGE_INDEX, length, self.channel_id, size))
        stream.write(struct.pack(f"<{len(numbers)}Q", *numbers))


class Chunk(ChunkBuilder):  # type: ignore[misc,unused-ignore]
    """Takes the place of the library's, whose bytes it makes."""

    def append(self, channel: int, received: int, sent: int, count: int, data: bytes) -> None:
        """A message, the ``count``-th of its channel; ``received`` is not before the last one's."""
        index = self.message_indices.get(channel)
        if index is None:
            index = self.message_indices[channel] = _Index(channel_id=channel, records=[])
        if self.num_messages == 0:
            self.message_start_time = received
        self.message_end_time = received
        self.num_messages += 1
        index.records.append((received, self.record_writer.count))
        length = _MESSAGE.size - _RECORD + len(data)
        record = _MESSAGE.pack(Opcode.MESSAGE, length, channel, count, received, sent)
        self.record_writer.write(record + data)
