"""The ports of the emulated controller: who listens, who is connected, and what they say."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.emulator.faults import FaultServer
from pianobot_ros.emulator.wrist.control.controller import Controller
from pianobot_ros.emulator.wrist.links import dashboard
from pianobot_ros.emulator.wrist.links.rtde import RtdeSession

__all__ = ["DASHBOARD_PORT", "RTDE_PORT", "SCRIPT_PORTS", "Ports"]

RTDE_PORT = 30004
DASHBOARD_PORT = 29999
SCRIPT_PORTS = (30003, 30002, 30001)

_BACKLOG_LIMIT = 1 << 16  # bytes a client may leave unread before its packages are dropped
# The arm's client library holds one for good, the driver opens another to recover, and somebody
# may look.
_DASHBOARD_CLIENTS = 3
_LONGEST_LINE, _LONGEST_SCRIPT = 1 << 12, 1 << 22  # bytes of what a client has not finished


@dataclass
class _Client:
    """One connection: what is still to be sent, and what was received but is not yet complete."""

    connection: socket.socket
    port: int
    session: RtdeSession | None = None
    outgoing: bytearray = field(default_factory=bytearray)
    incoming: bytes = b""
    dropped: int = 0
    broken: bool = False

    @property
    def streaming(self) -> bool:
        """Whether data packages go to it, and so come from it, cycle by cycle."""
        return self.session is not None and self.session.started

    def send(self, data: bytes) -> None:
        """Send now what the kernel takes, and keep the rest."""
        self.outgoing += data
        self.flush()

    def flush(self) -> None:
        """Send what is left over."""
        try:
            while self.outgoing:
                sent = self.connection.send(self.outgoing, socket.MSG_DONTWAIT)
                del self.outgoing[:sent]
        except BlockingIOError:
            pass
        except OSError:
            self.broken = True

    def publish(self) -> None:
        """Queue the package that is due, unless too much waits already."""
        package = self.session.package() if self.session is not None else None
        if package is None:
            return
        if len(self.outgoing) > _BACKLOG_LIMIT:
            self.dropped += 1
        else:
            self.send(package)

    def close(self, reset: bool) -> None:
        """Hang up, with a TCP reset if asked."""
        if self.session is not None:
            self.session.close()
        if reset:  # lingering for zero seconds makes close() send RST
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.connection.close()


class Ports:
    """Listens on the controller's ports and serves their clients.

    Args:
        host: loopback address; the ports are fixed in the client library, so each robot needs its
            own.
        controller: what the clients talk to.
        log: gets one line for each event.

    Raises:
        DeviceError: a port is taken.
    """

    def __init__(self, host: str, controller: Controller, log: Callable[[str], None]) -> None:
        self._host, self._controller, self._log = host, controller, log
        self._listeners: dict[socket.socket, int] = {}
        self._clients: dict[socket.socket, _Client] = {}
        self.listen()

    def listen(self) -> None:
        """Accept clients from now on. Raises DeviceError if a port is taken."""
        if self._listeners:
            return
        try:
            for port in (RTDE_PORT, DASHBOARD_PORT, *SCRIPT_PORTS):
                self._listeners[_listener(self._host, port)] = port
        except DeviceError:
            self.refuse()
            raise

    def refuse(self) -> None:
        """Accept no more clients; who is connected stays."""
        for listener in self._listeners:
            listener.close()
        self._listeners.clear()

    def serve(self, timeout: float, faults: FaultServer | None, stalled: bool) -> None:
        """Wait up to ``timeout`` s for what ``faults`` and the clients that do not stream send, and
        handle it; while ``stalled`` the clients are left waiting.
        """
        readers: list[socket.socket | FaultServer] = [faults] if faults is not None else []
        writers: list[socket.socket] = []
        if not stalled:
            waited = [key for key, client in self._clients.items() if not client.streaming]
            readers += [*self._listeners, *waited]
            writers = [key for key, client in self._clients.items() if client.outgoing]
        ready, writable, _ = select.select(readers, writers, [], timeout)
        for connection in writable:
            self._clients[connection].flush()
        for item in ready:
            if isinstance(item, FaultServer):
                item.service()
            elif item in self._listeners:
                self._accept(item)
            elif item in self._clients:
                self._read(self._clients[item])
        for client in [client for client in self._clients.values() if client.broken]:
            self._close(client)

    def receive(self) -> None:
        """Handle what the clients that stream have sent. Once a cycle is enough, as the program
        sees it once a cycle; to wake up for each package would cost as much as the cycle.
        """
        for client in [client for client in self._clients.values() if client.streaming]:
            self._read(client)

    def _accept(self, listener: socket.socket) -> None:
        try:
            connection, _ = listener.accept()
        except OSError:
            return
        connection.setblocking(False)
        port = self._listeners[listener]
        if port == DASHBOARD_PORT and self._connected(port) >= _DASHBOARD_CLIENTS:
            with contextlib.suppress(OSError):
                connection.send(dashboard.BUSY, socket.MSG_DONTWAIT)
            connection.close()
            return
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection, self._listeners[listener])
        if client.port == RTDE_PORT:
            client.session = RtdeSession(self._controller, client.send, self._log)
        elif client.port == DASHBOARD_PORT:
            client.send(dashboard.BANNER)
        self._clients[connection] = client

    def status(self) -> dict[str, object]:
        """Ports of those who are connected, and how many packages they did not take."""
        return {
            "clients": sorted(client.port for client in self._clients.values()),
            "dropped": sum(client.dropped for client in self._clients.values()),
        }

    def _connected(self, port: int) -> int:
        return sum(client.port == port for client in self._clients.values())

    def _read(self, client: _Client) -> None:
        try:
            data = client.connection.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._close(client)
            return
        now = time.monotonic()
        try:
            if client.session is not None:
                client.session.receive(data, now)
            elif client.port == DASHBOARD_PORT:
                self._dashboard(client, data, now)
            else:
                self._script(client, data)
        except (ValueError, struct.error) as error:
            self._log(f"connection on port {client.port} closed: {error}")
            self._close(client)

    def _dashboard(self, client: _Client, data: bytes, now: float) -> None:
        *lines, client.incoming = (client.incoming + data).split(b"\n")
        if len(client.incoming) > _LONGEST_LINE:
            raise ValueError("a dashboard command without end")
        for line in lines:
            text = line.decode("utf-8", "replace").strip()
            if text.lower() == "quit":
                client.send(b"Disconnected\n")
                self._close(client)
                return
            client.send(dashboard.answer(text, self._controller, now).encode() + b"\n")

    def _script(self, client: _Client, data: bytes) -> None:
        # A program ends with `end` in the first column.
        client.incoming += data
        while (end := client.incoming.find(b"\nend\n")) >= 0:
            text, client.incoming = client.incoming[: end + 5], client.incoming[end + 5 :]
            self._controller.load_script(text.decode("utf-8", "replace"))
        if len(client.incoming) > _LONGEST_SCRIPT:
            raise ValueError("a script without end")

    def _close(self, client: _Client, reset: bool = False) -> None:
        self._clients.pop(client.connection, None)
        client.close(reset)

    def publish(self) -> None:
        """Send each client the package that is due."""
        for client in self._clients.values():
            client.publish()

    def drop(self, reset: bool) -> None:
        """Hang up on all clients, with a TCP reset if asked."""
        for client in list(self._clients.values()):
            self._close(client, reset)


def _listener(host: str, port: int) -> socket.socket:
    """A socket that listens. Raises DeviceError if the port is taken."""
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(8)
    except OSError as error:
        listener.close()
        raise DeviceError(
            f"cannot listen on {host}:{port} ({error.strerror}): is another emulated UR running"
            " there? Give each its own loopback address with --host 127.0.0.x"
        ) from error
    listener.setblocking(False)
    return listener
