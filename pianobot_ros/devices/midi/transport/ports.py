"""Ways to exchange MIDI messages: ALSA or JACK through python-rtmidi, always named, or a socket.

A client connects to the instrument's port; an instrument offers one. Messages are ``bytes`` of one
MIDI message each, and are handed to a callback on a thread of the transport, active sensing
included.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, Protocol

import rtmidi

from pianobot_ros.devices.base import DeviceUnavailableError
from pianobot_ros.devices.midi.transport.sockets import SocketClient, SocketInstrument

__all__ = [
    "TRANSPORTS",
    "Receiver",
    "RtMidiTransport",
    "Transport",
    "choose_transport",
    "open_transport",
]

Receiver = Callable[[bytes], None]
TRANSPORTS = ("alsa", "jack", "socket")

_ANSWER = 15.0  # s that a JACK server may take to say that it is there
_API = {"alsa": rtmidi.API_LINUX_ALSA, "jack": rtmidi.API_UNIX_JACK}


class Transport(Protocol):
    """An open connection. Neither ``alive`` nor ``send`` proves that somebody listens: only
    received messages do.
    """

    @property
    def description(self) -> str:
        """Which transport, API and port, for humans."""

    @property
    def alive(self) -> bool:
        """False once it is known that the other side is gone; True proves nothing."""

    def send(self, message: bytes) -> None:
        """Send one message; what cannot be sent is lost without an error."""

    def close(self) -> None:
        """Release the ports. May be called twice."""


def choose_transport(wanted: str = "auto") -> Literal["alsa", "jack", "socket"]:
    """The transport to use: what was ``wanted``, or for ``auto`` ALSA, else a running JACK server,
    else sockets.

    Raises DeviceUnavailableError if the one wanted is not there.
    """
    if wanted == "auto":
        return "alsa" if not _no_alsa() else "jack" if not _no_jack() else "socket"
    if wanted not in TRANSPORTS:
        raise DeviceUnavailableError(
            f"unknown MIDI transport '{wanted}'; valid: auto, {', '.join(TRANSPORTS)}"
        )
    reason = {"alsa": _no_alsa, "jack": _no_jack}.get(wanted, str)()
    if reason:
        raise DeviceUnavailableError(
            f"no MIDI over {wanted}: {reason}; or set 'transport: socket' in midi.yaml"
        )
    return wanted  # type: ignore[return-value]


def _no_alsa() -> str:
    if _API["alsa"] not in rtmidi.get_compiled_api():
        return "this python-rtmidi was built without ALSA"
    if not Path("/dev/snd/seq").exists():
        return "there is no /dev/snd/seq (load the kernel module snd-seq)"
    return ""


def _no_jack() -> str:
    if _API["jack"] not in rtmidi.get_compiled_api():
        return "this python-rtmidi was built without JACK"
    command = shutil.which("jack_lsp")
    if command is None:
        return "jack_lsp is not installed (apt install jackd2)"
    # Asked in a process of its own: the JACK library inside this one would print its complaints,
    # and may hang.
    try:
        server = os.environ.get("JACK_DEFAULT_SERVER", "default")
        environment = {**os.environ, "JACK_NO_START_SERVER": "1"}
        done = subprocess.run(
            [command, "-s", server],
            env=environment,
            capture_output=True,
            timeout=_ANSWER,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "the JACK server does not answer"
    return "" if done.returncode == 0 else f"no JACK server '{server}' is running"


def open_transport(
    kind: str, receive: Receiver, *, client: str, port: str, socket: str, instrument: bool = False
) -> Transport:
    """Open a transport of :data:`TRANSPORTS`.

    Args:
        kind: as :func:`choose_transport` gives it.
        receive: gets each message.
        client: own name on ALSA or JACK.
        port: part of the name of the instrument's port on ALSA or JACK.
        socket: ``HOST:PORT`` of the instrument on sockets.
        instrument: offer a port instead of connecting to one.

    Raises DeviceUnavailableError, saying what is there instead.
    """
    if kind == "socket":
        return SocketInstrument(socket, receive) if instrument else SocketClient(socket, receive)
    return RtMidiTransport(kind, receive, client, None if instrument else port)


class RtMidiTransport:
    """Ports of python-rtmidi with a named API. ``port`` None offers virtual ports, else it is a
    part of the peer's name.
    """

    def __init__(self, kind: str, receive: Receiver, client: str, port: str | None) -> None:
        if kind == "jack":
            os.environ.setdefault("JACK_NO_START_SERVER", "1")
        self._kind = kind
        self._wanted = port
        self._in = self._out = None
        try:
            self._in = rtmidi.MidiIn(rtapi=_API[kind], name=client)
            self._out = rtmidi.MidiOut(rtapi=_API[kind], name=client)
            self._in.ignore_types(sysex=True, timing=True, active_sense=False)
            self._in.set_callback(lambda event, _: receive(bytes(event[0])))
            if port is None:
                self._in.open_virtual_port("in")
                self._out.open_virtual_port("out")
                self._peer = client
            else:
                self._peer = self._open(self._in, port)
                self._open(self._out, port)
        except (rtmidi.RtMidiError, OSError) as error:
            self.close()
            raise DeviceUnavailableError(f"MIDI over {kind} failed: {error}") from error
        except DeviceUnavailableError:
            self.close()
            raise

    def _open(self, end: Any, port: str) -> str:
        names: list[str] = end.get_ports()
        for index, name in enumerate(names):
            if port in name:
                end.open_port(index)
                return name
        there = ", ".join(names) or "none"
        raise DeviceUnavailableError(
            f"no MIDI port with '{port}' in its name on {self._kind}; ports there: {there}; "
            "switch the piano on, or set 'port' in midi.yaml"
        )

    @property
    def description(self) -> str:
        """API and port."""
        name = rtmidi.get_api_display_name(_API[self._kind])
        return f"{self._kind} ({name}), port '{self._peer}'"

    @property
    def alive(self) -> bool:
        """Whether the peer's port is still listed."""
        if self._out is None:
            return False
        if self._wanted is None:
            return True
        try:
            return any(self._wanted in name for name in self._out.get_ports())
        except rtmidi.RtMidiError:
            return False

    def send(self, message: bytes) -> None:
        """Send one message."""
        out = self._out
        if out is not None:
            with contextlib.suppress(rtmidi.RtMidiError):
                out.send_message(message)

    def close(self) -> None:
        """Release both ports."""
        for end in (self._in, self._out):
            if end is not None:
                with contextlib.suppress(rtmidi.RtMidiError):
                    end.close_port()
                    end.delete()
        self._in = self._out = None
