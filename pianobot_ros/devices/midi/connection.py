"""The way to the piano: opened, watched by its heartbeat, and opened again when it is lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from pianobot_ros.devices.attended import Attended, in_one_line
from pianobot_ros.devices.base import DeviceUnavailableError, HealthLevel
from pianobot_ros.devices.midi.config import MidiConfig
from pianobot_ros.devices.midi.guard import Guard
from pianobot_ros.devices.midi.message import MidiMessage, note_message
from pianobot_ros.devices.midi.silence import ACTIVE_SENSING, silence_messages
from pianobot_ros.devices.midi.sounding import Sounding
from pianobot_ros.devices.midi.transport.ports import Transport, choose_transport, open_transport
from pianobot_ros.devices.waiting import Waiting

__all__ = ["PianoConnection"]


class PianoConnection:
    """The transport to one piano, with the notes that it lets sound. ``on_note`` is called on the
    transport's thread; ``guarded``: start the guard process. The rest is as in
    :class:`~pianobot_ros.devices.midi.driver.MidiDriver`.
    """

    def __init__(
        self,
        config: MidiConfig,
        on_note: Callable[[MidiMessage], None],
        on_event: Callable[[HealthLevel, str], None],
        guarded: bool,
    ) -> None:
        self._config, self._on_note, self._on_event = config, on_note, on_event
        self._with_guard = guarded
        self._transport: Transport | None = None
        self._lock = threading.RLock()
        self._sounding = Sounding()
        self._closing = threading.Event()
        self._thread: Attended | None = None
        self._heard = float("-inf")
        self._sensed = False  # ever
        self.senses = False
        self.failure = ""
        self.counts = {"sent": 0, "lost": 0, "forgotten": 0, "reconnections": 0, "faults": 0}

    def connect(self) -> None:
        """Open the transport and silence the channel of the twin. Raises DeviceUnavailableError."""
        if self._thread is not None:
            return
        self._closing.clear()
        self._open()
        self._thread = Attended(self._watch, "midi heartbeat", self._fault)
        self._thread.start()

    def send(self, message: MidiMessage) -> None:
        """Sound or release a note. Raises DeviceUnavailableError."""
        sounds, key = message.sounds, (message.channel, message.note)
        with self._lock:
            transport = self._transport
            if transport is None or not transport.alive:
                self.counts["lost"] += 1
                raise DeviceUnavailableError("the piano is away; the note is lost")
            if sounds:
                self._sounding.begin(key)
            transport.send(
                bytes([message.status | message.channel, message.note, message.velocity])
            )
            self.counts["sent"] += 1
            if not sounds:
                self._sounding.end(key)

    @property
    def held(self) -> frozenset[tuple[int, int]]:
        """Channel and note of what this link lets sound."""
        return self._sounding.keys

    @property
    def description(self) -> str:
        """Transport and port in words."""
        transport = self._transport
        return transport.description if transport is not None else "not connected"

    @property
    def open(self) -> bool:
        """Whether there is a transport."""
        return self._transport is not None

    @property
    def age(self) -> float:
        """Time since anything was heard of the piano, s; infinite before."""
        return time.monotonic() - self._heard

    @property
    def guarded(self) -> bool:
        """Whether the guard process runs."""
        guard = self._sounding.guard
        return guard is not None and guard.running

    @property
    def unguarded(self) -> bool:
        """Whether the guard process should run and does not."""
        return self._with_guard and not self.guarded

    def release_all(self) -> None:
        """Release every note that this link lets sound."""
        with self._lock:
            self._sounding.release(self._transport)

    def close(self) -> None:
        """Release held notes, end the guard, release the ports. May be called twice."""
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join(2.0)
        with self._lock:
            self.release_all()
            self._drop()
        guard, self._sounding.guard = self._sounding.guard, None
        if guard is not None:
            guard.dismiss()

    def _open(self) -> None:
        """Raises DeviceUnavailableError, also for a piano that used to send active sensing and does
        not do so again: notes that are sent to an open port may go nowhere.
        """
        link = self._config.link
        kind = choose_transport(link.transport)
        self.senses = False
        transport = open_transport(
            kind, self._receive, client=link.client, port=link.port, socket=link.socket
        )
        if self._sensed and not _answers(self, link.silence_timeout, self._closing):
            transport.close()
            raise DeviceUnavailableError(f"the piano is silent: {transport.description}")
        with self._lock:
            self._transport = transport
            self._heard = time.monotonic()
            self._sounding.forget()
            # A predecessor may have been killed in the middle of a chord.
            for message in silence_messages(self._config.channels.twin):
                transport.send(message)
            if self.unguarded:
                self._sounding.guard = Guard(
                    kind, client=f"{link.client}-guard", port=link.port, socket=link.socket
                )

    def _drop(self) -> None:
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()

    def _fault(self, text: str) -> None:
        self.counts["faults"] += 1
        self._on_event(HealthLevel.ERROR, f"internal error: {text}")

    def _receive(self, message: bytes) -> None:
        """On the transport's thread, which must outlive whatever is wrong with one message."""
        try:
            self._take(message)
        except Exception as error:
            self._fault(in_one_line(error))

    def _take(self, message: bytes) -> None:
        now = time.time_ns() - round(1e9 * self._config.link.latency)
        self._heard = time.monotonic()
        if message[:1] == ACTIVE_SENSING:
            self.senses = self._sensed = True
            return
        note = note_message(message, now)
        if note is not None:
            self._on_note(note)

    def _watch(self) -> None:
        link = self._config.link
        port_check = 0.0
        silence, heard = Waiting(2.0 * link.heartbeat), self._heard
        while not self._closing.wait(link.heartbeat):
            now = time.monotonic()
            with self._lock:
                transport = self._transport
                if transport is not None:
                    transport.send(ACTIVE_SENSING)
                self.counts["forgotten"] += self._sounding.release(
                    transport, self._config.notes.longest
                )
            if transport is None:
                self._reopen()
            if self._heard != heard or transport is None:
                heard = self._heard
                silence.begin()
                continue
            why = ""
            if self.senses and silence.turn() > link.silence_timeout:
                why = f"silent for {now - self._heard:.1f} s"
            if now >= port_check or why:
                port_check = now + 1.0
                why = why if transport.alive else "its port is gone"
            if why:
                self._lose(f"the piano is lost: {why}")

    def _lose(self, why: str) -> None:
        self.failure = why
        self._on_event(HealthLevel.ERROR, why)
        with self._lock:
            self.release_all()
            self._drop()

    def _reopen(self) -> None:
        while not self._closing.wait(self._config.link.reconnect_period):
            try:
                self._open()
            except DeviceUnavailableError as error:
                self.failure = str(error)
                continue
            self.counts["reconnections"] += 1
            self._on_event(HealthLevel.OK, f"the piano is back: {self.description}")
            return


def _answers(link: PianoConnection, limit: float, closing: threading.Event) -> bool:
    """Whether the piano sends active sensing within ``limit`` s on the port that was just
    opened.
    """
    look = 0.02  # s
    waiting = Waiting(2.0 * look)
    while not link.senses and waiting.turn() < limit and not closing.wait(look):
        pass
    return link.senses
