"""MIDI over TCP, the bytes as on the wire: it fits ``mido.sockets`` at the other end.

mido's own ports are polled; here a thread waits on the socket, which takes milliseconds off the tail of the latency.
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from collections.abc import Callable

import mido

from pianobot_ros.devices.base import DeviceUnavailableError

__all__ = ["SocketClient", "SocketInstrument"]

_CONNECT_TIMEOUT = 1.0


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
                f"no piano listens at {address} ({error.strerror or error}): start it, or set 'socket' in midi.yaml"
            ) from error
        self._socket.settimeout(None)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._alive = True
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, args=(receive,), name=f"midi {address}", daemon=True)
        self._thread.start()

    def _run(self, receive: Callable[[bytes], None]) -> None:
        parser = mido.Parser()
        while True:
            try:
                data = self._socket.recv(4096)
            except OSError:
                data = b""
            if not data:
                self._alive = False
                return
            parser.feed(data)
            for message in parser:
                receive(bytes(message.bytes()))

    @property
    def description(self) -> str:
        """Address of the instrument."""
        return f"socket (TCP, no MIDI system), instrument at {self._where}"

    @property
    def alive(self) -> bool:
        """False once the instrument has closed the connection."""
        return self._alive

    def send(self, message: bytes) -> None:
        """Send one message. A peer that does not read for long loses messages instead of stopping the caller."""
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
    """Listens, and exchanges messages with every client that comes."""

    def __init__(self, address: str, receive: Callable[[bytes], None]) -> None:
        self._where = address
        self._receive = receive
        try:
            self._server = socket.create_server(_address(address), reuse_port=False)
        except OSError as error:
            raise DeviceUnavailableError(f"cannot listen at {address} ({error.strerror or error})") from error
        self._clients: dict[socket.socket, mido.Parser] = {}
        self._wake, self._woken = socket.socketpair()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name=f"midi {address}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._closing:
            ready, _, _ = select.select([self._server, self._woken, *self._clients], [], [])
            for end in ready:
                if end is self._server:
                    with contextlib.suppress(OSError):
                        client, _ = self._server.accept()
                        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        self._clients[client] = mido.Parser()
                elif end in self._clients:
                    self._read(end)

    def _read(self, client: socket.socket) -> None:
        try:
            data = client.recv(4096)
        except OSError:
            data = b""
        if not data:
            self._clients.pop(client, None)
            client.close()
            return
        parser = self._clients[client]
        parser.feed(data)
        for message in parser:
            self._receive(bytes(message.bytes()))

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
            with contextlib.suppress(OSError):  # the reading thread takes a dead client off the list
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
