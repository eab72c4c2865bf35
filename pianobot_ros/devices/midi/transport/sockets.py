"""MIDI over TCP, the bytes as on the wire: it fits ``mido.sockets`` at the other end.

mido's own ports are polled; here a thread waits on the socket, which takes milliseconds off the
tail of the latency.
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections.abc import Callable

from pianobot_ros.devices.base import DeviceUnavailableError
from pianobot_ros.devices.midi.transport.parsing import MidiStream

__all__ = ["SocketClient", "SocketInstrument"]

_CONNECT_TIMEOUT = 1.0
_LAST_WORD = 0.05  # s in which the end of a client that died is noticed


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit():
        raise DeviceUnavailableError(f"'{text}' is not HOST:PORT: correct 'socket' in midi.yaml")
    return host, int(port)


class SocketClient:
    """Connected to an instrument that listens."""

    def __init__(self, address: str, receive: Callable[[bytes], None]) -> None:
        self._where = address
        try:
            self._socket = socket.create_connection(_address(address), _CONNECT_TIMEOUT)
        except OSError as error:
            raise DeviceUnavailableError(
                f"no piano listens at {address} ({error.strerror or error}): start it, or set"
                " 'socket' in midi.yaml"
            ) from error
        self._socket.settimeout(None)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._alive = True
        self._lock = threading.Lock()
        self._thread = threading.Thread(
            target=self._run, args=(receive,), name=f"midi {address}", daemon=True
        )
        self._thread.start()

    def _run(self, receive: Callable[[bytes], None]) -> None:
        stream = MidiStream()
        while True:
            try:
                data = self._socket.recv(4096)
            except OSError:
                data = b""
            if not data:
                self._alive = False
                return
            for message in stream.feed(data):
                receive(message)

    @property
    def description(self) -> str:
        """Address of the instrument."""
        return f"socket (TCP, no MIDI system), instrument at {self._where}"

    @property
    def alive(self) -> bool:
        """False once the instrument has closed the connection."""
        return self._alive

    def send(self, message: bytes) -> None:
        """Send one message. A peer that does not read for long loses messages instead of stopping
        the caller.
        """
        if not self._alive:
            return
        with self._lock, contextlib.suppress(BlockingIOError):
            try:
                self._socket.send(message, socket.MSG_DONTWAIT)
            except BlockingIOError:
                raise
            except OSError:
                self._alive = False

    def close(self) -> None:
        """Send what is under way, then close."""
        self._alive = False
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        if self._thread is not threading.current_thread():
            self._thread.join(1.0)


class SocketInstrument:
    """Listens, and exchanges messages with one client at a time, as a cable does. Another one that
    comes meanwhile is let in and its connection closed.
    """

    def __init__(self, address: str, receive: Callable[[bytes], None]) -> None:
        self._where = address
        self._receive = receive
        host, port = _address(address)
        if host != "localhost" and not host.startswith("127."):
            raise DeviceUnavailableError(
                f"an emulated piano listens on this machine only: {address} is not 127.x.y.z:PORT"
            )
        try:
            self._server = socket.create_server((host, port), reuse_port=False)
        except OSError as error:
            raise DeviceUnavailableError(
                f"cannot listen at {address} ({error.strerror or error})"
            ) from error
        self._clients: dict[socket.socket, MidiStream] = {}
        self._wake, self._woken = socket.socketpair()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=f"midi {address}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._closing:
            ready, _, _ = select.select([self._server, self._woken, *self._clients], [], [])
            for end in [end for end in ready if end in self._clients]:
                self._read(end)
            if self._server in ready:
                self._accept()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            client, _ = self._server.accept()
            wait = _LAST_WORD if self._clients else 0.0
            # One that was killed is gone in a moment: its guard comes to release its notes.
            ended, _, _ = select.select(list(self._clients), [], [], wait)
            for end in ended:
                self._read(end)
            if self._clients:
                client.close()
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients[client] = MidiStream()

    def _read(self, client: socket.socket) -> None:
        try:
            data = client.recv(4096)
        except OSError:
            data = b""
        if not data:
            self._clients.pop(client, None)
            client.close()
            return
        for message in self._clients[client].feed(data):
            self._receive(message)

    @property
    def description(self) -> str:
        """Where it listens."""
        return f"socket (TCP, no MIDI system), listening at {self._where}"

    @property
    def alive(self) -> bool:
        """Whether it still listens."""
        return not self._closing

    @property
    def clients(self) -> int:
        """Number of connections."""
        return len(self._clients)

    def send(self, message: bytes) -> None:
        """Send one message to every client."""
        for client in list(self._clients):
            with contextlib.suppress(
                OSError
            ):  # the reading thread takes a dead client off the list
                client.send(message, socket.MSG_DONTWAIT)

    def close(self) -> None:
        """Stop to listen and close every connection."""
        if self._closing:
            return
        self._closing = True
        self._wake.send(b"x")
        self._thread.join(1.0)
        for end in (*self._clients, self._server, self._wake, self._woken):
            end.close()
        self._clients.clear()
