"""Driver of the piano: notes in, the twin's notes out, and none of them left hanging."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from pianobot_ros.devices.base import CommandRejectedError, DeviceUnavailableError, Health, HealthLevel
from pianobot_ros.devices.midi.config import MidiConfig
from pianobot_ros.devices.midi.guard import Guard
from pianobot_ros.devices.midi.silence import ACTIVE_SENSING, NOTE_OFF, NOTE_ON, note_off, silence_messages
from pianobot_ros.devices.midi.transport import Transport, choose_transport, open_transport

__all__ = ["MidiDriver", "MidiMessage"]


@dataclass(frozen=True)
class MidiMessage:
    """A note message: ``status`` 0x90 or 0x80, ``channel`` 0 to 15, ``note``, ``velocity`` 0 to 127, ``time_ns`` host time of
    arrival (0 for one to be sent)."""

    status: int
    channel: int
    note: int
    velocity: int
    time_ns: int = 0


class MidiDriver:
    """A digital piano. Implements :class:`pianobot_ros.devices.base.Device`.

    Whether the piano is there is judged by what it sends (active sensing, 0xFE): an open port proves nothing, and sending to
    a dead peer raises nothing. A piano that never sends active sensing is judged by its port alone.

    Notes sent are tracked. They are released by ``close``, by a guard process if this one is killed, and by the sweep over
    all notes that every connection starts with.

    Args:
        config: the file ``midi.yaml``.
        on_message: called on the transport's thread with each note message of the piano.
        on_event: called with a level and one line of text when the piano is lost or comes back.
        guard: start the guard process.
    """

    def __init__(
        self,
        config: MidiConfig,
        on_message: Callable[[MidiMessage], None] = lambda message: None,
        on_event: Callable[[HealthLevel, str], None] = lambda level, text: None,
        *,
        guard: bool = True,
    ) -> None:
        self.config = config
        self._on_message, self._on_event = on_message, on_event
        self._with_guard = guard
        self._guard: Guard | None = None
        self._transport: Transport | None = None
        self._lock = threading.RLock()
        self._held: dict[tuple[int, int], float] = {}
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._heard = float("-inf")
        self._senses = False
        self._failure = ""
        self._latest: MidiMessage | None = None
        self._counts = {"received": 0, "sent": 0, "lost": 0, "forgotten": 0, "rejected": 0, "reconnections": 0}

    # Device.

    def connect(self) -> None:
        """Open the transport and silence the channel of the twin. Raises DeviceUnavailableError."""
        if self._thread is not None:
            return
        self._closing.clear()
        self._open()
        self._thread = threading.Thread(target=self._watch, name="midi heartbeat", daemon=True)
        self._thread.start()

    def latest(self) -> MidiMessage | None:
        """Newest note message of the piano, or None."""
        return self._latest

    def write(self, command: MidiMessage) -> MidiMessage:
        """Sound or release a note on the piano; returns what was sent, with the velocity clipped to 0 to 127.

        Raises:
            CommandRejectedError: no note message, or note or channel out of range.
            DeviceUnavailableError: the piano is away; the note is lost.
        """
        if command.status not in (NOTE_ON, NOTE_OFF) or not (0 <= command.note < 128 and 0 <= command.channel < 16):
            self._counts["rejected"] += 1
            raise CommandRejectedError(f"no note message: {command}")
        velocity = min(max(int(command.velocity), 0), 127)
        sounds = command.status == NOTE_ON and velocity > 0
        key = (command.channel, command.note)
        with self._lock:
            transport = self._transport
            if transport is None or not transport.alive:
                self._counts["lost"] += 1
                raise DeviceUnavailableError("the piano is away; the note is lost")
            if sounds:
                self._held[key] = time.monotonic()
                if self._guard is not None:  # told before the note sounds: a kill in between leaves nothing hanging
                    self._guard.hold(*key)
            transport.send(bytes([command.status | command.channel, command.note, velocity]))
            self._counts["sent"] += 1
            if not sounds:
                self._held.pop(key, None)
                if self._guard is not None:
                    self._guard.release(*key)
        return MidiMessage(command.status, command.channel, command.note, velocity)

    @property
    def held(self) -> frozenset[tuple[int, int]]:
        """Channel and note of what this driver lets sound."""
        return frozenset(self._held)

    @property
    def description(self) -> str:
        """Transport and port in words."""
        transport = self._transport
        return transport.description if transport is not None else "not connected"

    def release_all(self) -> None:
        """Release every note that this driver lets sound."""
        with self._lock:
            for channel, note in list(self._held):
                self._release(channel, note)

    def health(self) -> Health:
        """Link and heartbeat."""
        age = time.monotonic() - self._heard
        values: dict[str, float | int | str] = {
            **self._counts,
            "transport": self.description,
            "held_notes": len(self._held),
            "active_sensing": "yes" if self._senses else "never seen",
            "guard": "running" if self._guard is not None and self._guard.running else "off",
        }
        if self._transport is None:
            return Health(HealthLevel.ERROR, self._failure or "not connected", age, values)
        if self._senses and age > self.config.link.silence_timeout:
            return Health(HealthLevel.STALE, f"the piano has been silent for {age:.1f} s", age, values)
        if self._with_guard and (self._guard is None or not self._guard.running):
            return Health(HealthLevel.WARN, "the guard process is gone: a crash may leave a note sounding", age, values)
        if not self._senses:
            text = "connected; this piano sends no active sensing, so a dead link shows only when its port goes"
            return Health(HealthLevel.OK, text, age, values)
        return Health(HealthLevel.OK, "running", age, values)

    def close(self) -> None:
        """Release held notes, end the guard, release the ports. May be called twice."""
        self._closing.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join(2.0)
        with self._lock:
            self.release_all()
            self._drop()
        guard, self._guard = self._guard, None
        if guard is not None:
            guard.dismiss()

    # Inside.

    def _open(self) -> None:
        link = self.config.link
        kind = choose_transport(link.transport)
        transport = open_transport(kind, self._receive, client=link.client, port=link.port, socket=link.socket)
        with self._lock:
            self._transport = transport
            self._senses = False
            self._heard = time.monotonic()
            self._held.clear()
            # A predecessor may have been killed in the middle of a chord.
            for message in silence_messages(self.config.channels.twin):
                transport.send(message)
            if self._with_guard and (self._guard is None or not self._guard.running):
                self._guard = Guard(kind, client=f"{link.client}-guard", port=link.port, socket=link.socket)

    def _drop(self) -> None:
        transport, self._transport = self._transport, None
        if transport is not None:
            transport.close()

    def _release(self, channel: int, note: int) -> None:
        self._held.pop((channel, note), None)
        if self._transport is not None:
            self._transport.send(note_off(channel, note))
        if self._guard is not None:
            self._guard.release(channel, note)

    def _receive(self, message: bytes) -> None:
        now = time.time_ns() - round(1e9 * self.config.link.latency)
        self._heard = time.monotonic()
        if message[0] == ACTIVE_SENSING[0]:
            self._senses = True
            return
        status, channel = message[0] & 0xF0, message[0] & 0x0F
        if status not in (NOTE_ON, NOTE_OFF) or len(message) != 3:
            return
        if status == NOTE_ON and message[2] == 0:  # many instruments send this for a note-off
            status = NOTE_OFF
        self._counts["received"] += 1
        self._latest = MidiMessage(status, channel, message[1], message[2], now)
        self._on_message(self._latest)

    def _watch(self) -> None:
        link = self.config.link
        port_check = 0.0
        while not self._closing.wait(link.heartbeat):
            now = time.monotonic()
            with self._lock:
                transport = self._transport
                if transport is not None:
                    transport.send(ACTIVE_SENSING)
                for (channel, note), since in list(self._held.items()):
                    if now - since > self.config.notes.longest:
                        self._counts["forgotten"] += 1
                        self._release(channel, note)
            if transport is None:
                continue
            silent = self._senses and now - self._heard > link.silence_timeout
            gone = False
            if now >= port_check or silent:
                port_check = now + 1.0
                gone = not transport.alive
            if silent or gone:
                why = "its port is gone" if gone else f"silent for {now - self._heard:.1f} s"
                self._failure = f"the piano is lost: {why}"
                self._on_event(HealthLevel.ERROR, self._failure)
                with self._lock:
                    self.release_all()
                    self._drop()
                self._reopen()

    def _reopen(self) -> None:
        while not self._closing.wait(self.config.link.reconnect_period):
            try:
                self._open()
            except DeviceUnavailableError as error:
                self._failure = str(error)
                continue
            if not self._answers():
                with self._lock:
                    self._drop()
                continue
            self._counts["reconnections"] += 1
            self._on_event(HealthLevel.OK, f"the piano is back: {self.description}")
            return

    def _answers(self) -> bool:
        """Whether a piano that used to send active sensing does so again after opening the port."""
        deadline = time.monotonic() + self.config.link.silence_timeout
        while time.monotonic() < deadline and not self._closing.wait(0.02):
            if self._senses:
                return True
        return False
