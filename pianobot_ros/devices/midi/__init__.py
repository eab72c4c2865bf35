"""The digital piano on MIDI: over ALSA or JACK where they are, else over sockets."""

from pianobot_ros.devices.midi.config import MidiConfig, MidiLinkConfig
from pianobot_ros.devices.midi.driver import MidiDriver
from pianobot_ros.devices.midi.message import MidiMessage
from pianobot_ros.devices.midi.transport.ports import (
    TRANSPORTS,
    Transport,
    choose_transport,
    open_transport,
)

__all__ = [
    "TRANSPORTS",
    "MidiConfig",
    "MidiDriver",
    "MidiLinkConfig",
    "MidiMessage",
    "Transport",
    "choose_transport",
    "open_transport",
]
