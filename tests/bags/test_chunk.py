"""The chunk of the live writer is, byte for byte, that of the mcap library."""

from __future__ import annotations

from mcap._chunk_builder import ChunkBuilder
from mcap.data_stream import RecordBuilder
from mcap.records import Message

from pianobot_ros.bags.chunk import Chunk


def test_messages_and_indices_are_the_librarys() -> None:
    ours, theirs = Chunk(), ChunkBuilder()
    begin = 1_700_000_000_000_000_000
    for i, (channel, data) in enumerate([(2, b"first"), (1, b""), (2, bytes(300)), (3, b"x")]):
        received, sent = begin + 1000 * i, begin + 900 * i
        ours.append(channel, received, sent, 7 * i, data)
        theirs.add_message(Message(channel, received, data, sent, 7 * i))
    about = ("num_messages", "message_start_time", "message_end_time", "count")
    assert [getattr(ours, name) for name in about] == [getattr(theirs, name) for name in about]
    assert list(ours.message_indices) == list(theirs.message_indices) == [2, 1, 3]
    for channel, index in theirs.message_indices.items():
        written = RecordBuilder(), RecordBuilder()
        index.write(written[0])
        ours.message_indices[channel].write(written[1])
        assert written[0].end() == written[1].end()
    assert ours.end() == theirs.end()
    ours.reset()
    assert (ours.num_messages, ours.count, ours.message_indices) == (0, 0, {})
