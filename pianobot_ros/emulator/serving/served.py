"""What every emulated device's process does around its loop: bus, fault port, signals, the line
that says it is ready.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import signal
import sys
from collections.abc import Callable
from typing import Protocol

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.emulator.faults import FaultHandler, FaultServer
from pianobot_ros.emulator.serving.bus import PlantBus

__all__ = ["Served", "serve"]


class Served(Protocol):
    """A device with a loop."""

    stopping: bool

    def handlers(self) -> dict[str, FaultHandler]:
        """Words of the control socket."""

    def run(self, faults: FaultServer | None, stop: Callable[[], bool]) -> None:
        """Serve until ``stopping`` or ``stop()``."""

    def close(self) -> None:
        """Release the device's port."""

    def where(self) -> str:
        """How to reach the device, to be read after the word ready."""


def serve(
    name: str, options: argparse.Namespace, build: Callable[[PlantBus | None], Served]
) -> int:
    """Attach to ``options.bus`` (None: alone), build the device, listen for faults at
    ``options.faults`` and serve until SIGINT
    or SIGTERM. Returns the exit code: 2 after bad input, with one line on stderr."""
    with contextlib.ExitStack() as stack:
        try:
            bus = stack.enter_context(PlantBus.attach(options.bus)) if options.bus else None
            device = build(bus)
            stack.callback(device.close)
            faults = (
                stack.enter_context(FaultServer(options.faults, device.handlers()))
                if options.faults
                else None
            )
        except (PianobotError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 2

        def end(*_: object) -> None:
            device.stopping = True

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, end)
        gc.collect()
        gc.freeze()  # what is there now stays; collecting it again would cost tens of milliseconds
        print(f"[{name}] ready {device.where()}", file=sys.stderr, flush=True)
        device.run(faults, (lambda: bus.stop_requested) if bus is not None else (lambda: False))
    return 0
