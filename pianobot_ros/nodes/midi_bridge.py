"""``midi_bridge``: the digital piano, real or emulated, in both directions.

Publishes ``/real/midi`` and, at each note-off, ``/real/keystroke``; sounds ``/sim/midi`` on the instrument, on a channel of its
own, so that the twin can be heard.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

from pianobot_msgs.msg import KeyForce, Keystroke, MidiEvent, StrikeMark
from std_srvs.srv import Trigger

from pianobot_ros.cell.geometry import keyboard
from pianobot_ros.cell.keystroke import NoteEvent, keystrokes_from_midi
from pianobot_ros.devices.base import CommandRejectedError, DeviceUnavailableError
from pianobot_ros.devices.midi import MidiConfig, MidiDriver, MidiMessage, load_config
from pianobot_ros.nodes import common
from pianobot_ros.nodes.common import Health, HealthLevel

__all__ = ["MidiBridge", "main"]

_LOG_PERIOD = 1.0  # s between two log lines about lost notes
_CONTACT = 0.3  # s before note-on from when a peak force belongs to the stroke
_MEMORY = 64  # strike marks and force peaks remembered


class MidiBridge(common.DeviceNode):
    """The lifecycle node; a thin shell around :class:`MidiDriver`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("midi_bridge", **options)
        common.declare(self, "config", "midi.yaml", "file with transport, ports and channels of the piano")
        self._file_config = config = load_config(self.get_parameter("config").value)
        common.declare(
            self,
            "transport",
            config.link.transport,
            "how to reach the piano; auto takes the first there is",
            choices=["auto", "alsa", "jack", "socket"],
        )
        common.declare(self, "port", config.link.port, "part of the name of the piano's ALSA or JACK port")
        common.declare(self, "socket", config.link.socket, "HOST:PORT of a piano on sockets")
        common.declare(self, "sound_twin", True, "play the notes of /sim/midi on the piano")
        common.declare(self, "peak_force", True, "fill in the peak force from /real/fsr/peak")
        common.declare(self, "guard", True, "run a process that releases notes if this one is killed")
        self._driver: MidiDriver | None = None
        self._midi = keyboard().midi
        self._inputs: list[Any] = []
        self._down: dict[int, MidiMessage] = {}
        self._marks: deque[StrikeMark] = deque(maxlen=_MEMORY)
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
        self._events = self._publisher(MidiEvent, "/real/midi")
        self._strokes = self._publisher(Keystroke, "/real/keystroke")
        self._release_service = self.create_service(Trigger, "~/release_notes", self._on_release)
        self._driver = MidiDriver(config, self._on_message, self._on_event, guard=self.get_parameter("guard").value)
        self._driver.connect()
        self.diagnostics.hardware_id = self._driver.description
        self.get_logger().info(f"MIDI over {self._driver.description}")

    def _publisher(self, kind: type, topic: str) -> Any:
        events = common.publisher_events(self, topic)
        return self.create_lifecycle_publisher(kind, topic, common.EVENT_QOS, event_callbacks=events)

    def start(self) -> None:
        """Listen to marks, force peaks and the twin's notes."""
        self._subscribe(StrikeMark, "/command/strike", self._on_mark)
        if self.get_parameter("sound_twin").value:
            self._subscribe(MidiEvent, "/sim/midi", self._on_twin)
        if self.get_parameter("peak_force").value:
            self._subscribe(KeyForce, "/real/fsr/peak", self._on_peak)

    def _subscribe(self, kind: type, topic: str, callback: Any) -> None:
        events = common.subscription_events(self, topic)
        self._inputs.append(self.create_subscription(kind, topic, callback, common.EVENT_QOS, event_callbacks=events))

    def stop(self) -> None:
        """Stop listening and release what sounds."""
        for subscription in self._inputs:
            self.destroy_subscription(subscription)
        self._inputs = []
        if self._driver is not None:
            self._driver.release_all()

    def release(self) -> None:
        """Release notes and ports, and take down publishers."""
        if self._driver is not None:
            self._driver.close()
            self._driver = None
        for name, destroy in (
            ("_events", self.destroy_lifecycle_publisher),
            ("_strokes", self.destroy_lifecycle_publisher),
            ("_release_service", self.destroy_service),
        ):
            if (entity := getattr(self, name, None)) is not None:
                destroy(entity)
                setattr(self, name, None)
        self._down.clear()

    def diagnose(self) -> Mapping[str, Health]:
        """Link and heartbeat."""
        if self._driver is None:
            return {"piano": Health(HealthLevel.STALE, self._last_failure or self.state)}
        health = self._driver.health()
        values = {**health.values, "lifecycle": self.state, "other_channels": self._foreign}
        return {"piano": Health(health.level, health.message, health.age_s, values)}

    # From the piano, on the transport's thread.

    def _on_message(self, message: MidiMessage) -> None:
        if message.channel != self._active_config.channels.instrument:
            self._foreign += 1  # an instrument that echoes the twin's channel must not make its notes real
            return
        event = MidiEvent(status=message.status, channel=message.channel, note=message.note, velocity=message.velocity)
        event.header.stamp = common.time_msg(message.time_ns)
        self._events.publish(event)
        if message.status == MidiEvent.NOTE_ON:
            self._down[message.note] = message
        elif (start := self._down.pop(message.note, None)) is not None:
            self._strokes.publish(self._keystroke(start, message))

    def _keystroke(self, start: MidiMessage, end: MidiMessage) -> Keystroke:
        pair = [NoteEvent(m.time_ns * 1e-9, m is start, m.note, m.velocity) for m in (start, end)]
        stroke = keystrokes_from_midi(pair, self._midi)[0]
        t_hold = 1e-9 * (end.time_ns - start.time_ns)  # exact; seconds since the epoch as a float are not
        message = Keystroke(
            note=start.note,
            v_pre=stroke.v_pre,
            v_rel=stroke.v_rel,
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
        onset = start.time_ns * 1e-9
        for mark in reversed(tuple(self._marks)):
            covered = common.seconds(mark.header.stamp) <= onset <= common.seconds(mark.end)
            if mark.note == start.note and covered:
                return float(mark.note_length)
        return math.nan

    def _peak_force(self, start: MidiMessage, end: MidiMessage) -> float:
        first, last = max(start.time_ns * 1e-9 - _CONTACT, self._last_end.get(start.note, 0.0)), end.time_ns * 1e-9
        self._last_end[start.note] = last
        peaks = [f for n, t, f in tuple(self._force_peaks) if n == start.note and first <= t <= last]
        return max(peaks, default=math.nan)

    def _on_event(self, level: HealthLevel, text: str) -> None:
        self._down.clear()  # what was pressed while the link was away is not known
        # rclpy wants one severity for each calling line.
        if level is HealthLevel.OK:
            self.get_logger().info(text)
        else:
            self.get_logger().error(text)

    def _on_mark(self, message: StrikeMark) -> None:
        self._marks.append(message)

    # To the piano.

    def _on_peak(self, message: KeyForce) -> None:
        self._force_peaks.append((message.note, common.seconds(message.header.stamp), message.force))

    def _on_twin(self, message: MidiEvent) -> None:
        if self._driver is None or message.status not in (MidiEvent.NOTE_ON, MidiEvent.NOTE_OFF):
            return
        channel = self._active_config.channels.twin
        try:
            self._driver.write(MidiMessage(message.status, channel, message.note, message.velocity))
        except (CommandRejectedError, DeviceUnavailableError) as error:
            self.get_logger().warning(f"note of the twin: {error}", throttle_duration_sec=_LOG_PERIOD)

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
    return common.run(MidiBridge, arguments, pace=common.PACE)


if __name__ == "__main__":
    sys.exit(main())
