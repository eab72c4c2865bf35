"""MIDI over TCP: one client, on this machine, within bounds."""

from __future__ import annotations

import pytest
from cell_devices import free_address

from pianobot_ros.devices.base import DeviceUnavailableError
from pianobot_ros.devices.midi.transport.parsing import MidiStream
from pianobot_ros.devices.midi.transport.sockets import SocketClient, SocketInstrument
from pianobot_ros.testing import wait_for

NOTE = b"\x90\x40\x40"


def test_one_client_at_a_time_and_the_next_when_it_is_gone() -> None:
    heard: list[bytes] = []
    instrument = SocketInstrument(free_address(), heard.append)
    address = instrument.description.rsplit(" ", 1)[-1]
    first = SocketClient(address, lambda _: None)
    wait_for(lambda: instrument.clients == 1, "the first client")
    second = SocketClient(address, lambda _: None)
    wait_for(lambda: not second.alive, "the second client to be shown out")
    first.send(NOTE)
    wait_for(lambda: heard == [NOTE], "a note of the first client")
    first.close()
    third = SocketClient(address, lambda _: None)
    third.send(NOTE)
    wait_for(lambda: heard == [NOTE] * 2, "a note of the third client")
    for end in (second, third, instrument):
        end.close()


@pytest.mark.parametrize("address", ["0.0.0.0:5000", ":5000", "192.0.2.1:5000"])
def test_an_emulated_piano_listens_on_this_machine_only(address: str) -> None:
    with pytest.raises(DeviceUnavailableError, match=r"127\.|HOST:PORT"):
        SocketInstrument(address, lambda _: None)


def test_a_message_without_end_takes_bounded_room() -> None:
    """Found by fuzzing: a system-exclusive message that never ends grew for ever."""
    stream = MidiStream()
    for _ in range(100):
        assert stream.feed(b"\xf0" + b"\x01" * 4096) == []
        assert stream._fed <= 65_536
    assert stream.feed(NOTE) == [NOTE]
