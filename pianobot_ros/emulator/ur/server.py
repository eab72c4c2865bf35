"""Sockets and clock of the emulated controller.

One thread: ``select`` until the next cycle is due on an absolute time grid, then one cycle of the controller, then a data
package to each RTDE client. An event loop such as asyncio's would be late by a millisecond at the 99th percentile.
"""

from __future__ import annotations

import gc
import json
import select
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TextIO

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.emulator.faults import FaultHandler, FaultServer
from pianobot_ros.emulator.ur import dashboard
from pianobot_ros.emulator.ur.controller import Controller
from pianobot_ros.emulator.ur.session import RtdeSession

__all__ = ["DASHBOARD_PORT", "RTDE_PORT", "SCRIPT_PORTS", "Server"]

RTDE_PORT = 30004
DASHBOARD_PORT = 29999
SCRIPT_PORTS = (30003, 30002, 30001)

_BACKLOG_LIMIT = 1 << 16  # bytes a client may leave unread before its packages are dropped


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


class Server:
    """The emulated controller on its ports.

    Args:
        host: loopback address to listen on; the ports are fixed in the client library, so each robot needs its own.
        controller: the controller.
        log: gets one line for each event.
        fault_endpoint: control socket for faults, or None.
        motion_log: file that gets one line of CSV a cycle, or None.

    Raises:
        DeviceError: a port is taken.
    """

    def __init__(
        self,
        host: str,
        controller: Controller,
        log: Callable[[str], None],
        fault_endpoint: str | None = None,
        motion_log: TextIO | None = None,
    ) -> None:
        self._host = host
        self._controller = controller
        self._log = log
        self._listeners: dict[socket.socket, int] = {}
        self._clients: dict[socket.socket, _Client] = {}
        self._stalled = self._silent = False
        self._lateness = 0.0
        self._cycles = 0
        self._motion_log = motion_log
        self.stopping = False
        self._listen()
        self._faults = FaultServer(fault_endpoint, self._fault_handlers()) if fault_endpoint else None
        if motion_log is not None:
            motion_log.write("monotonic,mode,program,target_x,target_y,target_z,x,y,z,vx,vy,vz\n")

    # Life.

    def run(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Serve until ``stopping`` is set or ``stop``, asked once a cycle, says so."""
        gc.collect()
        gc.freeze()  # what is there now stays; collecting it again would cost milliseconds
        period = self._controller.dt
        due = time.monotonic() + period
        while not self.stopping:
            now = time.monotonic()
            if now < due:
                self._serve(due - now)
                continue
            if now - due > period:
                # This process was kept waiting. What clients sent meanwhile came in time: it must not look late.
                self._serve(0.0)
            self._lateness = max(self._lateness, now - due)
            self._cycles += 1
            self._controller.tick(now)
            if not self._stalled and not self._silent:
                self._publish()
            if self._motion_log is not None:
                self._log_motion(now)
            # On the grid of cycles, not when this process woke up: the plant must not see our lateness as motion.
            self._controller.advance(due)
            self.stopping = self.stopping or stop()
            due += period
            if now - due > 0.25:  # the process was suspended: do not run after lost cycles
                due = now + period
        self.close()

    def close(self) -> None:
        """Close every socket."""
        self._close_clients(reset=False)
        self._refuse()
        if self._faults is not None:
            self._faults.close()
            self._faults = None

    # Sockets.

    def _listen(self) -> None:
        for port in (RTDE_PORT, DASHBOARD_PORT, *SCRIPT_PORTS):
            listener = socket.socket()
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                listener.bind((self._host, port))
                listener.listen(8)
            except OSError as error:
                listener.close()
                self._refuse()
                raise DeviceError(
                    f"cannot listen on {self._host}:{port} ({error.strerror}): is another emulated UR running there? "
                    "Give each its own loopback address with --host 127.0.0.x"
                ) from error
            listener.setblocking(False)
            self._listeners[listener] = port

    def _refuse(self) -> None:
        for listener in self._listeners:
            listener.close()
        self._listeners.clear()

    def _serve(self, timeout: float) -> None:
        readers: list[socket.socket | FaultServer] = [self._faults] if self._faults is not None else []
        writers: list[socket.socket] = []
        if not self._stalled:
            readers += [*self._listeners, *self._clients]
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

    def _accept(self, listener: socket.socket) -> None:
        try:
            connection, _ = listener.accept()
        except OSError:
            return
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection, self._listeners[listener])
        if client.port == RTDE_PORT:
            client.session = RtdeSession(self._controller, client.send, self._log)
        elif client.port == DASHBOARD_PORT:
            client.send(dashboard.BANNER)
        self._clients[connection] = client

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

    def _close(self, client: _Client, reset: bool = False) -> None:
        self._clients.pop(client.connection, None)
        if client.session is not None:
            client.session.close()
        if reset:  # lingering for zero seconds makes close() send RST
            client.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.connection.close()

    def _close_clients(self, reset: bool) -> None:
        for client in list(self._clients.values()):
            self._close(client, reset)

    def _publish(self) -> None:
        for client in self._clients.values():
            if client.session is None:
                continue
            package = client.session.package()
            if package is None:
                continue
            if len(client.outgoing) > _BACKLOG_LIMIT:
                client.dropped += 1
            else:
                client.send(package)

    def _log_motion(self, now: float) -> None:
        assert self._motion_log is not None
        c = self._controller
        target = c.outputs.values["target_TCP_pose"]
        numbers = (*target[:3], *c.motion.pose[:3], *c.motion.twist[:3])
        line = ",".join(f"{value:.6f}" for value in numbers)
        self._motion_log.write(f"{now:.6f},{c.motion.mode},{c.runtime_state.name},{line}\n")
        if self._cycles % 64 == 0:
            self._motion_log.flush()

    # Faults.

    def _fault_handlers(self) -> dict[str, FaultHandler]:
        return {
            "drop": self._fault_drop,
            "stall": lambda _: self._set_stall(stalled=True),
            "silence": lambda _: self._set_silence(),
            "resume": lambda _: self._set_stall(stalled=False),
            "refuse": lambda _: self._refuse(),
            "accept": lambda _: self._listen() if not self._listeners else None,
            "pstop": lambda _: self._controller.protective_stop("asked for on the fault port"),
            "estop": lambda _: self._controller.emergency_stop(),
            "unlock": self._fault_unlock,
            "killprog": lambda _: self._controller.stop_program("script error asked for on the fault port"),
            "pause": lambda _: self._controller.pause(),
            "play": self._fault_play,
            "speed": self._fault_speed,
            "status": self._fault_status,
        }

    def _fault_drop(self, words: Sequence[str]) -> None:
        if words not in ([], ["rst"]):
            raise ValueError(f"'{' '.join(words)}' is not rst")
        self._close_clients(reset=bool(words))

    def _set_stall(self, stalled: bool) -> None:
        self._stalled = stalled
        self._silent = False

    def _set_silence(self) -> None:
        self._silent = True

    def _fault_unlock(self, _: Sequence[str]) -> None:
        # What a person at the robot does: turns the button back, or confirms on the pendant.
        self._controller.safety.release_button()
        if not self._controller.safety.unlock(time.monotonic()):
            raise ValueError("the robot refuses to unlock a protective stop this early")

    def _fault_play(self, _: Sequence[str]) -> None:
        if not self._controller.play():
            raise ValueError("no program to play, or the robot is stopped")

    def _fault_speed(self, words: Sequence[str]) -> None:
        value = float(words[0])
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"{value:g} is not in [0, 1]")
        self._controller.slider = value

    def _fault_status(self, _: Sequence[str]) -> str:
        status = {
            **self._controller.status(),
            "cycles": self._cycles,
            "worst_lateness_ms": round(self._lateness * 1e3, 3),
            "clients": sorted(client.port for client in self._clients.values()),
            "dropped": sum(client.dropped for client in self._clients.values()),
        }
        self._lateness = 0.0
        return json.dumps(status)
