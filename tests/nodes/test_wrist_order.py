"""A WristCommand read from its bytes, and how long ``ur5_wrist`` waits for the next."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pianobot_msgs.msg import WristCommand
from rclpy.serialization import deserialize_message, serialize_message

from pianobot_ros.cell.errors import CommandRejectedError
from pianobot_ros.cell.messages.wrist_order import WristOrder
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.devices.ur5_wrist import (
    COMMAND_PERIOD,
    STREAM_PERIOD,
    pause_after,
)
from pianobot_ros.nodes.topics.polled import Taken

NUMBERS = st.tuples(*[st.floats(allow_nan=False)] * 13)
FRAMES = st.text(st.characters(blacklist_categories=("Cs",), blacklist_characters="\x00"))


def command(
    frame: str = "base", numbers: tuple[float, ...] = (0.0,) * 13, stamp_ns: int = 0
) -> bytes:
    message = WristCommand()
    message.header.frame_id = frame
    message.header.stamp = common.time_msg(stamp_ns)
    p, q = message.pose.position, message.pose.orientation
    v, w = message.twist.linear, message.twist.angular
    p.x, p.y, p.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z = numbers
    return bytes(serialize_message(message))


@given(FRAMES, NUMBERS, st.integers(0, 2**31 * 10**9 - 1))
def test_the_bytes_say_what_the_message_says(
    frame: str, numbers: tuple[float, ...], stamp_ns: int
) -> None:
    data = command(frame, numbers, stamp_ns)
    order = WristOrder.read(data)
    assert order == WristOrder.of(deserialize_message(data, WristCommand))
    assert (order.frame, order.numbers, order.stamp_ns) == (frame, numbers, stamp_ns)


@given(st.binary(max_size=200))
def test_bytes_that_are_no_command_are_refused_or_read(data: bytes) -> None:
    try:
        assert len(WristOrder.read(data).numbers) == 13
    except CommandRejectedError as error:
        assert "wrist setpoint" in str(error)


def test_a_command_that_is_cut_is_refused() -> None:
    data = command()
    for length in range(len(data) - 8):
        with pytest.raises(CommandRejectedError, match="damaged"):
            WristOrder.read(data[:length])
    with pytest.raises(CommandRejectedError, match="little-endian"):
        WristOrder.read(b"\x00\x00" + data[2:])


@pytest.mark.parametrize(
    ("ahead", "pause"),
    [
        ([], COMMAND_PERIOD),  # silence: the next may be to be obeyed at once
        ([0.045], STREAM_PERIOD),
        ([0.037, 0.045], STREAM_PERIOD),
        ([0.045, 0.0], COMMAND_PERIOD),
        ([0.02], COMMAND_PERIOD),  # so little ahead that a look may take too much of it
        ([-0.01], COMMAND_PERIOD),
        ([0.5], COMMAND_PERIOD),  # of another clock: obeyed at once
        ([None], COMMAND_PERIOD),  # without a stamp: obeyed at once
    ],
)
def test_it_looks_as_often_as_what_comes_is_urgent(ahead: list[float | None], pause: float) -> None:
    now = time.time_ns()
    stamps = [0 if a is None else now + round(1e9 * a) for a in ahead]
    assert pause_after([Taken(command(stamp_ns=s), now, now) for s in stamps], now) == pause
    assert pause_after([Taken(b"", now, now)], now) == COMMAND_PERIOD
