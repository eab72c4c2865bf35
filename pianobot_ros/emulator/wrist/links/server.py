"""The clock of the emulated controller.

One thread: ``select`` until the next cycle is due on an absolute time grid, then one cycle of the
controller, then a data package to each RTDE client. An event loop such as asyncio's would be late
by a millisecond at the 99th percentile.
"""

from __future__ import annotations

import gc
import json
import time
from collections.abc import Callable, Sequence
from typing import TextIO

from pianobot_ros.emulator.faults import FaultHandler, FaultServer
from pianobot_ros.emulator.wrist.control.controller import Controller
from pianobot_ros.emulator.wrist.links.ports import Ports

__all__ = ["ControllerServer"]


class _MotionLog:
    """A line of CSV a cycle: what the arm is told, and what it does."""

    def __init__(self, file: TextIO, controller: Controller) -> None:
        self._file, self._controller = file, controller
        self._lines = 0
        file.write("monotonic,mode,program,target_x,target_y,target_z,x,y,z,vx,vy,vz\n")

    def add(self, now: float) -> None:
        """The line of the cycle at ``now`` s."""
        c = self._controller
        target = c.outputs.values["target_TCP_pose"]
        numbers = (*target[:3], *c.motion.pose[:3], *c.motion.twist[:3])
        line = ",".join(f"{value:.6f}" for value in numbers)
        self._file.write(f"{now:.6f},{c.motion.mode},{c.runtime_state.name},{line}\n")
        self._lines += 1
        if self._lines % 64 == 0:
            self._file.flush()


class _ControllerFaults:
    """What happens to the controller itself, by the words of the control socket."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller

    def handlers(self) -> dict[str, FaultHandler]:
        """What each word does."""
        c = self._controller
        return {
            "pstop": lambda _: c.protective_stop("asked for on the fault port"),
            "estop": lambda _: c.emergency_stop(),
            "unlock": self._unlock,
            "killprog": lambda _: c.stop_program("script error asked for on the fault port"),
            "pause": lambda _: c.pause(),
            "play": self._play,
            "speed": self._speed,
        }

    def _unlock(self, _: Sequence[str]) -> None:
        # What a person at the robot does: turns the button back, or confirms on the pendant.
        self._controller.safety.release_button()
        if not self._controller.safety.unlock(time.monotonic()):
            raise ValueError("the robot refuses to unlock a protective stop this early")

    def _play(self, _: Sequence[str]) -> None:
        if not self._controller.play():
            raise ValueError("no program to play, or the robot is stopped")

    def _speed(self, words: Sequence[str]) -> None:
        value = float(words[0])
        if not 0.0 <= value <= 1.0:
            raise ValueError(f"{value:g} is not in [0, 1]")
        self._controller.slider = value


class ControllerServer:
    """The emulated controller on its ports.

    Args:
        host: loopback address to listen on; the ports are fixed in the client library, so each
            robot needs its own.
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
        self._controller = controller
        self._stalled = self._silent = False
        self._lateness = 0.0
        self._cycles = 0
        self._motion_log = _MotionLog(motion_log, controller) if motion_log is not None else None
        self.stopping = False
        self._ports = Ports(host, controller, log)
        self._faults = (
            FaultServer(fault_endpoint, self._fault_handlers()) if fault_endpoint else None
        )

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
                self._ports.serve(due - now, self._faults, self._stalled)
                continue
            if now - due > period:
                # This process was kept waiting. What clients sent meanwhile came in time: it must
                # not look late.
                self._ports.serve(0.0, self._faults, self._stalled)
            if not self._stalled:
                self._ports.receive()
            self._lateness = max(self._lateness, now - due)
            self._cycles += 1
            self._controller.tick(now)
            if not self._stalled and not self._silent:
                self._ports.publish()
            if self._motion_log is not None:
                self._motion_log.add(now)
            # On the grid of cycles, not when this process woke up: the plant must not see our
            # lateness as motion.
            self._controller.advance(due)
            self.stopping = self.stopping or stop()
            due += period
            if now - due > 0.25:  # the process was suspended: do not run after lost cycles
                due = now + period
        self.close()

    def close(self) -> None:
        """Close every socket."""
        self._ports.drop(reset=False)
        self._ports.refuse()
        if self._faults is not None:
            self._faults.close()
            self._faults = None

    # Faults.

    def _fault_handlers(self) -> dict[str, FaultHandler]:
        return {
            "drop": self._fault_drop,
            "stall": lambda _: self._set_stall(stalled=True),
            "silence": lambda _: self._set_silence(),
            "resume": lambda _: self._set_stall(stalled=False),
            "refuse": lambda _: self._ports.refuse(),
            "accept": lambda _: self._ports.listen(),
            **_ControllerFaults(self._controller).handlers(),
            "status": self._fault_status,
        }

    def _fault_drop(self, words: Sequence[str]) -> None:
        if words not in ([], ["rst"]):
            raise ValueError(f"'{' '.join(words)}' is not rst")
        self._ports.drop(reset=bool(words))

    def _set_stall(self, stalled: bool) -> None:
        self._stalled = stalled
        self._silent = False

    def _set_silence(self) -> None:
        self._silent = True

    def _fault_status(self, _: Sequence[str]) -> str:
        status = {
            **self._controller.status(),
            "cycles": self._cycles,
            "worst_lateness_ms": round(self._lateness * 1e3, 3),
            **self._ports.status(),
        }
        self._lateness = 0.0
        return json.dumps(status)
