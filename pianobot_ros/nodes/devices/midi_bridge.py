"""``midi_bridge``: the digital piano, real or emulated, in both directions.

Publishes ``/real/midi`` and, at each note-off, ``/real/keystroke``; sounds ``/sim/midi`` on the
instrument, on a channel of its own, so that the twin can be heard.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from pianobot_msgs.msg import KeyForce, Keystroke, MidiEvent, StrikeMark
from std_srvs.srv import Trigger

from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.cell.recordings.contact_radius import at_contact
from pianobot_ros.cell.recordings.keystroke import NoteEvent, keystrokes_from_midi
from pianobot_ros.devices.base import CommandRejectedError, DeviceUnavailableError
from pianobot_ros.devices.midi import MidiConfig, MidiDriver, MidiMessage
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.base.common import Health, HealthLevel
from pianobot_ros.nodes.session.marks import Marks

__all__ = ["MidiBridge", "main"]

_LOG_PERIOD = 1.0  # s between two log lines about lost notes
_CONTACT = 0.3  # s before note-on from when a peak force belongs to the stroke
_MEMORY = 64  # force peaks remembered


class MidiBridge(common.DeviceNode):
    """The lifecycle node; a thin shell around :class:`MidiDriver`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("midi_bridge", **options)
        self._file_config = config = self.load_config(
            MidiConfig, "transport, ports and channels of the piano"
        )
        self.declare(
            "transport",
            config.link.transport,
            "how to reach the piano; auto takes the first there is",
            choices=["auto", "alsa", "jack", "socket"],
        )
        self.declare("port", config.link.port, "part of the name of the piano's ALSA or JACK port")
        self.declare("socket", config.link.socket, "HOST:PORT of a piano on sockets")
        self.declare("sound_twin", True, "play the notes of /sim/midi on the piano")
        self.declare("peak_force", True, "fill in the peak force from /real/fsr/peak")
        self.declare("guard", True, "run a process that releases notes if this one is killed")
        self._driver: MidiDriver | None = None
        self._midi = keyboard().midi
        self._down: dict[int, MidiMessage] = {}
        self._marks = Marks()
        self._force_peaks: deque[tuple[int, float, float]] = deque(maxlen=_MEMORY)
        self._last_end: dict[int, float] = {}
        self._foreign = 0

    def _config(self) -> MidiConfig:
        config = self._file_config
        link = {name: self.get_parameter(name).value for name in ("transport", "port", "socket")}
        return config.model_copy(update={"link": config.link.model_copy(update=link)})

    # Lifecycle.

    def setup(self) -> None:
        """Open the transport; notes that a predecessor left sounding are silenced."""
        self._active_config = config = self._config()
        self._events = self.add_publisher(MidiEvent, "/real/midi", common.EVENT_QOS)
        self._strokes = self.add_publisher(Keystroke, "/real/keystroke", common.EVENT_QOS)
        self.add_service(Trigger, "~/release_notes", self._on_release)
        self._driver = MidiDriver(
            config, self._on_message, self.on_event, guard=self.get_parameter("guard").value
        )
        self._driver.connect()
        self.diagnostics.hardware_id = self._driver.description
        self.get_logger().info(f"MIDI over {self._driver.description}")

    def start(self) -> None:
        """Listen to marks, force peaks and the twin's notes."""
        self.add_subscription(StrikeMark, "/command/strike", self._on_mark, common.EVENT_QOS)
        if self.get_parameter("sound_twin").value:
            self.add_subscription(MidiEvent, "/sim/midi", self._on_twin, common.EVENT_QOS)
        if self.get_parameter("peak_force").value:
            self.add_subscription(KeyForce, "/real/fsr/peak", self._on_peak, common.EVENT_QOS)

    def stop(self) -> None:
        """Release what sounds."""
        if self._driver is not None:
            self._driver.release_all()

    def release(self) -> None:
        """Release notes and ports."""
        super().release()
        self._down.clear()

    def diagnose(self) -> Mapping[str, Health]:
        """Link and heartbeat."""
        return self.health_of("piano", self._driver, other_channels=self._foreign)

    # From the piano, on the transport's thread.

    def _on_message(self, message: MidiMessage) -> None:
        if message.channel != self._active_config.channels.instrument:
            self._foreign += (
                1  # an instrument that echoes the twin's channel must not make its notes real
            )
            return
        event = MidiEvent(
            status=message.status,
            channel=message.channel,
            note=message.note,
            velocity=message.velocity,
        )
        event.header.stamp = common.time_msg(message.time_ns)
        self._events.publish(event)
        if message.status == MidiEvent.NOTE_ON:
            self._down[message.note] = message
        elif (start := self._down.pop(message.note, None)) is not None:
            self._strokes.publish(self._keystroke(start, message))

    def _keystroke(self, start: MidiMessage, end: MidiMessage) -> Keystroke:
        pair = [NoteEvent(m.time_ns * 1e-9, m is start, m.note, m.velocity) for m in (start, end)]
        reported = keystrokes_from_midi(pair, self._midi)[0]
        stroke = at_contact(reported, self._marks.radius(start.note, start.time_ns * 1e-9))
        t_hold = 1e-9 * (
            end.time_ns - start.time_ns
        )  # exact; seconds since the epoch as a float are not
        message = Keystroke(
            note=start.note,
            v_pre=stroke.v_pre,
            v_rel=stroke.v_rel,
            radius=stroke.radius,
            velocity_pre=start.velocity,
            velocity_rel=end.velocity,
            t_hold=t_hold,
            t_idle=self._note_length(start) - t_hold,
            peak_force=self._peak_force(start, end),
        )
        message.header.stamp = common.time_msg(end.time_ns)
        message.onset = common.time_msg(start.time_ns)
        return message

    def _note_length(self, start: MidiMessage) -> float:
        mark = self._marks.covering(start.note, start.time_ns * 1e-9)
        return math.nan if mark is None else float(mark.note_length)

    def _peak_force(self, start: MidiMessage, end: MidiMessage) -> float:
        first, last = (
            max(start.time_ns * 1e-9 - _CONTACT, self._last_end.get(start.note, 0.0)),
            end.time_ns * 1e-9,
        )
        self._last_end[start.note] = last
        peaks = [
            f for n, t, f in tuple(self._force_peaks) if n == start.note and first <= t <= last
        ]
        return max(peaks, default=math.nan)

    def on_event(self, level: HealthLevel, text: str) -> None:
        """Log what the driver reports, and forget the keys that were down: what was pressed while
        the link was away is not known.
        """
        self._down.clear()
        super().on_event(level, text)

    def _on_mark(self, message: StrikeMark) -> None:
        self._marks.add(message)

    # To the piano.

    def _on_peak(self, message: KeyForce) -> None:
        self._force_peaks.append(
            (message.note, common.seconds(message.header.stamp), message.force)
        )

    def _on_twin(self, message: MidiEvent) -> None:
        if self._driver is None or message.status not in (MidiEvent.NOTE_ON, MidiEvent.NOTE_OFF):
            return
        channel = self._active_config.channels.twin
        try:
            self._driver.write(MidiMessage(message.status, channel, message.note, message.velocity))
        except (CommandRejectedError, DeviceUnavailableError) as error:
            self.get_logger().warning(
                f"note of the twin: {error}", throttle_duration_sec=_LOG_PERIOD
            )

    def _on_release(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._driver is None:
            response.message = "not connected"
            return response
        held = len(self._driver.held)
        self._driver.release_all()
        response.success, response.message = True, f"{held} note(s) released"
        return response


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point."""
    sys.setswitchinterval(2e-4)  # a note's stamp must not wait for what the executor is doing
    return common.run(MidiBridge, arguments, realtime=common.REALTIME_PRIORITY)


if __name__ == "__main__":
    sys.exit(main())
