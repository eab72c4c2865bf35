"""The emulated force board sends in step with its samples, so that the host's stamps are off by the
same in every run.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pianobot_ros.devices.serial_line import Line
from pianobot_ros.emulator.fsr.device import Fsr
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.serving.bus import PlantBus
from pianobot_ros.emulator.serving.serial_port import SerialPort


@pytest.fixture
def board(tmp_path: Path) -> Iterator[tuple[Fsr, PlantBus]]:
    with PlantBus.create(tmp_path / "bus", Case().to_json()) as bus:
        device = Fsr(SerialPort(tmp_path / "fsr"), bus)
        try:
            assert device.obey(Line("R", 1, ("500",))) is None
            yield device, bus
        finally:
            device.close()


@pytest.mark.parametrize("phase", [0.0, 0.0004, 0.0009, 0.0013, 0.00152, 0.00158, 0.0019, 0.0031])
def test_the_last_sample_of_a_bunch_is_always_of_one_age(
    board: tuple[Fsr, PlantBus], phase: float
) -> None:
    device, bus = board
    start = 100.0
    due, ticks = start + phase, 0
    ages, stamps = [], []
    for _ in range(40):
        due += device.period
        while start + 1e-3 * ticks <= due:
            row = np.zeros(16)
            row[0] = row[3] = start + 1e-3 * ticks
            bus.write_samples(row)
            ticks += 1
        lines = device.measure(due)
        stamps += [1e-6 * int(str(line[1])) for line in lines]
        ages.append(due - stamps[-1])
    assert np.ptp(ages[3:]) < 2e-6, "after a first bunch or two"
    assert ages[-1] == pytest.approx(0.0016, abs=2e-5)
    assert np.allclose(np.diff(stamps), 0.002, atol=2e-6), "and no sample is lost or sent twice"
