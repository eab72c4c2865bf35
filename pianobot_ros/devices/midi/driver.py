"""Driver of the piano: notes in, the twin's notes out, and none of them left hanging."""

from __future__ import annotations

from collections.abc import Callable

from pianobot_ros.devices.base import CommandRejectedError, Health, HealthLevel
from pianobot_ros.devices.midi.config import MidiConfig
from pianobot_ros.devices.midi.connection import PianoConnection
from pianobot_ros.devices.midi.message import MidiMessage
from pianobot_ros.devices.midi.silence import NOTE_OFF, NOTE_ON

__all__ = ["MidiDriver"]


class MidiDriver:
    """A digital piano. Implements :class:`pianobot_ros.devices.base.Device`.

    Whether the piano is there is judged by what it sends (active sensing, 0xFE): an open port
    proves nothing, and sending to a dead peer raises nothing. A piano that never sends active
    sensing is judged by its port alone.

    Notes sent are tracked. They are released by ``close``, by a guard process if this one is
    killed, and by the sweep over all notes that every connection starts with.

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
        self._on_message = on_message
        self._link = PianoConnection(config, self._take, on_event, guard)
        self._latest: MidiMessage | None = None
        self._received = self._rejected = 0

    # Device.

    def connect(self) -> None:
        """Open the transport and silence the channel of the twin. Raises DeviceUnavailableError."""
        self._link.connect()

    def latest(self) -> MidiMessage | None:
        """Newest note message of the piano, or None."""
        return self._latest

    def write(self, command: MidiMessage) -> MidiMessage:
        """Sound or release a note on the piano; returns what was sent, with the velocity clipped to
        0 to 127.

        Raises:
            CommandRejectedError: no note message, or note or channel out of range.
            DeviceUnavailableError: the piano is away; the note is lost.
        """
        if command.status not in (NOTE_ON, NOTE_OFF) or not (
            0 <= command.note < 128 and 0 <= command.channel < 16
        ):
            self._rejected += 1
            raise CommandRejectedError(f"no note message: {command}")
        velocity = min(max(int(command.velocity), 0), 127)
        sent = MidiMessage(command.status, command.channel, command.note, velocity)
        self._link.send(sent)
        return sent

    @property
    def held(self) -> frozenset[tuple[int, int]]:
        """Channel and note of what this driver lets sound."""
        return self._link.held

    @property
    def description(self) -> str:
        """Transport and port in words."""
        return self._link.description

    def release_all(self) -> None:
        """Release every note that this driver lets sound."""
        self._link.release_all()

    def health(self) -> Health:
        """Link and heartbeat."""
        link, age = self._link, self._link.age
        values: dict[str, float | int | str] = {
            "received": self._received,
            **link.counts,
            "rejected": self._rejected,
            "transport": link.description,
            "held_notes": len(link.held),
            "active_sensing": "yes" if link.senses else "never seen",
            "guard": "running" if link.guarded else "off",
        }
        level, text = HealthLevel.OK, "running"
        if not link.open:
            level, text = HealthLevel.ERROR, link.failure or "not connected"
        elif link.senses and age > self.config.link.silence_timeout:
            level, text = HealthLevel.STALE, f"the piano has been silent for {age:.1f} s"
        elif link.unguarded:
            level = HealthLevel.WARN
            text = "the guard process is gone: a crash may leave a note sounding"
        elif not link.senses:
            text = (
                "connected; this piano sends no active sensing, so a dead link shows only when its"
                " port goes"
            )
        return Health(level, text, age, values)

    def close(self) -> None:
        """Release held notes, end the guard, release the ports. May be called twice."""
        self._link.close()

    def _take(self, note: MidiMessage) -> None:
        self._received += 1
        self._latest = note
        self._on_message(note)
