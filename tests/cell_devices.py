"""Emulated serial devices and piano as processes, for the tests of drivers and nodes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import pytest

from pianobot_ros.cell.host.closing import Closing, wait_or_kill
from pianobot_ros.devices import base as devices
from pianobot_ros.emulator.faults import send_fault
from pianobot_ros.testing import loopback_host, wait_for

until = wait_for

ConfigT = TypeVar("ConfigT", bound=devices.DeviceConfig)

ROOT = Path(__file__).resolve().parents[1]


def free_address() -> str:
    """HOST:PORT of this machine, for an emulated piano alone: an address of its own, where no
    outgoing connection of anybody takes the port meanwhile.
    """
    return f"{loopback_host()}:30140"


def environment(**extra: str) -> dict[str, str]:
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    return {**os.environ, "PYTHONPATH": path, **extra}


START = 120.0  # s that a device's process may take until it serves
PATIENCE = {"identify_timeout": 30.0, "silence_timeout": 10.0, "reconnect_period": 0.05}
"""Times of a serial link in s: whoever is there is found, and nobody is lost, on a machine that
stands still for seconds."""


def linked(config: ConfigT, port: Path, **sections: dict[str, object]) -> ConfigT:
    """A device's configuration with its link on ``port``, looked for often, patient, and with other
    values in some sections.
    """
    sections["link"] = {**PATIENCE, "port": str(port), **sections.get("link", {})}
    return config.model_copy(
        update={n: getattr(config, n).model_copy(update=v) for n, v in sections.items()}
    )


def whole(sequences: list[int], driver: Any) -> bool:
    """Whether everything that a device sent came once and in order, but for what the closed driver
    knows to be lost: a wire waits for nobody, and a host that stands still for seconds misses
    lines.
    """
    steps = [b - a for a, b in pairwise(sequences)]
    missing = sum(step - 1 for step in steps)
    return all(step > 0 for step in steps) and missing <= driver.health().values["lost_lines"]


class Device(Closing):
    """A process of the emulated cell with its control socket; ready when the constructor
    returns.
    """

    def __init__(self, module: str, directory: Path, *arguments: str, **extra: str) -> None:
        self.endpoint = f"unix:{directory / (module + '.ctl')}"
        self._log = directory / f"{module}.said"
        command = [sys.executable, "-m", f"pianobot_ros.emulator.{module}"]
        with self._log.open("wb") as log:  # a pipe that nobody reads would hold it up
            self.process = subprocess.Popen(
                [*command, "--faults", self.endpoint, *arguments],
                env=environment(**extra),
                stderr=log,
            )
        until(lambda: "] ready " in self.said(), self.said, START, trouble=self._ended)

    def said(self) -> str:
        return self._log.read_text(errors="replace")

    def _ended(self) -> str:
        return "" if self.process.poll() is None else f"it has ended:\n{self.said()}"

    def fault(self, command: str) -> str:
        return send_fault(self.endpoint, command)

    def status(self) -> dict[str, Any]:
        return dict(json.loads(self.fault("status")))

    def close(self) -> None:
        self.process.terminate()
        wait_or_kill(self.process, 5.0)


@contextmanager
def connected(driver: Any) -> Iterator[Any]:
    """``driver``, which is a device's, connected; closed in the end."""
    assert isinstance(driver, devices.Device)
    driver.connect()
    try:
        yield driver
    finally:
        driver.close()


def expect_refused(
    ros: Any, processes: Any, node: str, folder: Path, device: str, says: str
) -> None:
    """The node names what it found where another ``device`` is on its port."""
    port = folder / "port"
    with Device(device, folder, "--link", str(port)):
        processes.python(node, "--ros-args", "-p", f"port:={port}", log="node")
        ros.wait_for(lambda: says in processes.output("node"), "wrong device")


def device_fixture(module: str) -> Any:
    """A fixture: the emulated device, on the port ``port`` of the test's folder."""

    @pytest.fixture
    def device(tmp_path: Path) -> Iterator[Device]:
        with Device(module, tmp_path, "--link", str(tmp_path / "port")) as process:
            yield process

    return device
