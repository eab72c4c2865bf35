"""Configuration of the piano's MIDI link (``config/midi.yaml``)."""

from __future__ import annotations

from typing import Literal

from pydantic import field_validator, model_validator

from pianobot_ros.cell.numbers.config import Section, quantity
from pianobot_ros.devices.base import DeviceConfig

__all__ = [
    "ChannelsConfig",
    "MidiConfig",
    "MidiLinkConfig",
    "NotesConfig",
    "socket_address",
]


def socket_address(text: str) -> tuple[str, int]:
    """Host and port of ``HOST:PORT``. Raises ValueError."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(f"'{text}' is not HOST:PORT")
    return host, int(port)


class MidiLinkConfig(Section):
    """How to reach the instrument."""

    transport: Literal["auto", "alsa", "jack", "socket"]
    port: str
    socket: str
    client: str
    heartbeat: float = quantity("s", low=0.05, high=0.3)
    silence_timeout: float = quantity("s", low=0.33, high=10)
    reconnect_period: float = quantity("s", low=0.05, high=10)
    latency: float = quantity("s", low=0, high=0.1)

    @field_validator("socket")
    @classmethod
    def _address(cls, text: str) -> str:
        socket_address(text)
        return text


class ChannelsConfig(Section):
    """MIDI channels, counted from 0."""

    instrument: int = quantity("1", low=0, high=15)
    twin: int = quantity("1", low=0, high=15)

    @model_validator(mode="after")
    def _apart(self) -> ChannelsConfig:
        if self.instrument == self.twin:
            raise ValueError(
                "instrument and twin need different channels, or their notes cannot be told apart"
            )
        return self


class NotesConfig(Section):
    """What is done about forgotten notes."""

    longest: float = quantity("s", low=0.5, high=600)


class MidiConfig(DeviceConfig):
    """The whole file."""

    link: MidiLinkConfig
    channels: ChannelsConfig
    notes: NotesConfig
