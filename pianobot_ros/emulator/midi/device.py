"""``python -m pianobot_ros.emulator.midi``: the emulated digital piano, a process of its own on
MIDI.

It sends what the plant plays on its keys on channel 1, and sounds what it receives. As MIDI 1.0
asks, it sends active sensing, and a receiver that has once heard active sensing falls silent when
it stops.
"""

from __future__ import annotations

import argparse
import json
import random
import select
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from pianobot_ros.devices.midi import (
    TRANSPORTS,
    MidiConfig,
    Transport,
    choose_transport,
    open_transport,
)
from pianobot_ros.emulator.faults import FaultServer, add_cell_arguments, share_of
from pianobot_ros.emulator.serving.bell import Bell
from pianobot_ros.emulator.serving.bus import PlantBus
from pianobot_ros.emulator.serving.served import serve

__all__ = ["Piano", "main"]

_PERIOD = 0.02  # s between two looks at what does not ring
_ALONE = (0.002, 0.01)  # s, shortest and longest, while it plays by its own clock
# s from a key's contact to its message: constant, as of an instrument that scans its keys fast, and
# long enough for the plant's tick and for the bell
_SCAN = 0.004
_LAST_WORDS = 1.0  # s in which what was sent before the piano is switched off still arrives
_ACTIVE_SENSING, _SENSING_PERIOD, _SENSING_LIMIT = b"\xfe", 0.25, 0.33
_NOTE_OFF, _NOTE_ON, _CONTROL, _ALL_OFF = 0x80, 0x90, 0xB0, (120, 123)


class Piano:
    """Keys out, sounds in.

    Args:
        offer: opens the port of the instrument, given the function that receives messages.
        bus: plays what the plant plays; None plays one note over and over with period ``signal`` s
            (0: never).
        sensing: whether it sends active sensing, and obeys it.
    """

    def __init__(
        self,
        offer: Callable[[Callable[[bytes], None]], Transport],
        bus: PlantBus | None = None,
        signal: float = 1.0,
        sensing: bool = True,
    ) -> None:
        self._offer = offer
        self._bus = bus
        self._signal = signal
        self._sensing = sensing
        self.stopping = False
        self._lock = threading.Lock()
        self._sounding: dict[tuple[int, int], int] = {}
        self._received = self._sent = self._sensed_off = 0
        self._last_sense: float | None = None
        self._silent = self._stalled = False
        self._garble = 0.0
        self._random = random.Random(1)
        self._transport: Transport | None = offer(self._receive)
        self._index: int | None = bus.read_events(None).next_index if bus is not None else None
        self._waiting: deque[tuple[float, int, int, int]] = deque()
        self._next_signal = time.monotonic() + signal
        self._signal_on = False
        self._down: set[int] = set()

    @property
    def description(self) -> str:
        """Transport and port."""
        return self._transport.description if self._transport else "unplugged"

    def where(self) -> str:
        """How it can be reached."""
        return f"on {self.description}"

    def status(self) -> dict[str, object]:
        """What sounds by channel (counted from 0), what is pressed, and counters."""
        with self._lock:
            sounding: dict[str, list[int]] = {}
            for channel, note in sorted(self._sounding):
                sounding.setdefault(str(channel), []).append(note)
        return {
            "transport": self.description,
            "sounding": sounding,
            "pressed": sorted(self._down),
            "received": self._received,
            "sent": self._sent,
            "silenced_by_sensing": self._sensed_off,
        }

    # Faults.

    def handlers(self) -> dict[str, Callable[[Sequence[str]], str | None]]:
        """Words of the control socket."""
        return {
            "unplug": lambda _: self._unplug(),
            "replug": lambda _: self._replug(),
            "drop": lambda _: self._drop(),
            "silence": lambda _: setattr(self, "_silent", True),
            "stall": lambda _: setattr(self, "_stalled", True),
            "resume": lambda _: self._resume(),
            "garble": self._set_garble,
            "status": lambda _: json.dumps(self.status()),
        }

    def _unplug(self) -> None:
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()
        with self._lock:  # its supply goes too
            self._sounding.clear()
            self._last_sense = None

    def _replug(self) -> None:
        if self._transport is None:
            self._transport = self._offer(self._receive)

    def _drop(self) -> None:
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()
        self._transport = self._offer(self._receive)

    def _resume(self) -> None:
        self._silent = self._stalled = False

    def _set_garble(self, words: Sequence[str]) -> None:
        self._garble = share_of(words)

    # Sound.

    def _receive(self, message: bytes) -> None:
        if self._stalled:
            return
        if message == _ACTIVE_SENSING:
            self._last_sense = time.monotonic()
            return
        if self._last_sense is not None:
            self._last_sense = time.monotonic()
        kind, channel = message[0] & 0xF0, message[0] & 0x0F
        with self._lock:
            self._received += 1
            if kind == _NOTE_ON and message[2] > 0:
                self._sounding[channel, message[1]] = message[2]
            elif kind in (_NOTE_ON, _NOTE_OFF):
                self._sounding.pop((channel, message[1]), None)
            elif kind == _CONTROL and message[1] in _ALL_OFF:
                for key in [key for key in self._sounding if key[0] == channel]:
                    del self._sounding[key]

    def _obey_sensing(self, now: float) -> None:
        if (
            self._sensing
            and self._last_sense is not None
            and now - self._last_sense > _SENSING_LIMIT
        ):
            with self._lock:
                self._sensed_off += len(self._sounding)
                self._sounding.clear()
                self._last_sense = None

    # Keys.

    def _send(self, message: bytes) -> None:
        transport = self._transport
        if transport is None or self._silent or self._stalled:
            return
        if self._garble and self._random.random() < self._garble:
            at = self._random.randrange(len(message))
            message = (
                message[:at]
                + bytes([message[at] ^ (1 << self._random.randrange(8))])
                + message[at + 1 :]
            )
        transport.send(message)
        self._sent += message != _ACTIVE_SENSING

    def _key(self, status: int, note: int, velocity: int) -> None:
        (self._down.add if status == _NOTE_ON else self._down.discard)(note)
        self._send(bytes([status, note, velocity]))

    def _take_events(self, bus: PlantBus) -> None:
        events = bus.read_events(self._index)
        self._index = events.next_index
        columns = ((events.time + _SCAN), events.status, events.note, events.velocity)
        self._waiting.extend(zip(*(column.tolist() for column in columns), strict=True))

    def _play(self, now: float) -> None:
        if self._bus is not None:
            if self._index is None or self._bus.events_since(self._index):
                self._take_events(self._bus)
            while self._waiting and self._waiting[0][0] <= now:
                self._key(*self._waiting.popleft()[1:])
        elif self._signal and now >= self._next_signal:
            self._next_signal += self._signal / 2.0
            self._signal_on = not self._signal_on
            self._key(_NOTE_ON if self._signal_on else _NOTE_OFF, 64, 75 if self._signal_on else 40)

    def run(self, faults: FaultServer | None, stop: Callable[[], bool] = lambda: False) -> None:
        """Serve until ``stopping`` or ``stop()``."""
        next_sense = 0.0
        readers: list[FaultServer | Bell] = [faults] if faults is not None else []
        readers += [self._bus.bell] if self._bus is not None else []
        shortest, longest = _ALONE
        alone = max(shortest, min(longest, self._signal / 10.0 or longest))
        period = _PERIOD if self._bus is not None else alone
        while not self.stopping and not stop():
            wait = (
                min(period, max(self._waiting[0][0] - time.monotonic(), 0.0))
                if self._waiting
                else period
            )
            ready, _, _ = select.select(readers, [], [], wait)
            for item in ready:
                if isinstance(item, FaultServer):
                    item.service()
                else:
                    item.heard()
            now = time.monotonic()
            self._play(now)
            self._obey_sensing(now)
            if self._sensing and now >= next_sense:
                next_sense = now + _SENSING_PERIOD
                self._send(_ACTIVE_SENSING)

    def close(self) -> None:
        """Release pressed keys and the ports; notes that still sound are told of."""
        end = time.monotonic() + _LAST_WORDS
        while self._sounding and time.monotonic() < end:
            time.sleep(_ALONE[0])
        if sounding := self.status()["sounding"]:
            print(f"switched off while notes sounded: {sounding}", file=sys.stderr, flush=True)
        for note in sorted(self._down):
            self._send(bytes([_NOTE_OFF, note, 64]))
        self._unplug()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(
        prog="python -m pianobot_ros.emulator.midi", description=__doc__
    )
    parser.add_argument(
        "--transport", choices=("auto", *TRANSPORTS), help="default: as midi.yaml says"
    )
    parser.add_argument(
        "--name", help="name of its ports on ALSA or JACK (default: as midi.yaml says)"
    )
    parser.add_argument(
        "--socket",
        metavar="HOST:PORT",
        help="where it listens on sockets (default: as midi.yaml says)",
    )
    add_cell_arguments(parser, "piano")
    parser.add_argument(
        "--signal", type=float, default=1.0, help="s between the notes it plays when alone; 0: none"
    )
    parser.add_argument(
        "--no-sensing", action="store_true", help="neither send nor obey active sensing"
    )
    options = parser.parse_args(arguments)

    def build(bus: PlantBus | None) -> Piano:
        link = MidiConfig.load().link
        kind = choose_transport(options.transport or link.transport)
        name, address = options.name or link.port, options.socket or link.socket

        def offer(receive: Callable[[bytes], None]) -> Transport:
            return open_transport(
                kind, receive, client=name, port=name, socket=address, instrument=True
            )

        return Piano(offer, bus, options.signal, not options.no_sensing)

    return serve("midi", options, build)
