"""The regulator's driver against the emulated regulator."""

from __future__ import annotations

import contextlib
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cell_devices as cell
import pytest

from pianobot_ros.devices.base import (
    CommandRejectedError,
    DeviceUnavailableError,
    HealthLevel,
)
from pianobot_ros.devices.fsr import FsrConfig, FsrDriver
from pianobot_ros.devices.serial_line import REGULATOR_DEVICE, LineParser
from pianobot_ros.devices.serial_line.opening import Opening
from pianobot_ros.devices.vacuum import (
    RegulatorConfig,
    RegulatorDriver,
    VacuumReading,
    VacuumSetpoint,
)
from pianobot_ros.emulator.serving.serial_port import SerialPort

WANTED = VacuumSetpoint((-20_000.0, -50_000.0, -80_000.0))


def config_for(
    port: Path, link: dict[str, object] | None = None, **behaviour: float
) -> RegulatorConfig:
    return cell.linked(RegulatorConfig.load(), port, link=link or {}, behaviour=behaviour)


device = cell.device_fixture("vacuum")


def test_setpoints_arrive_are_clipped_and_come_back(device: cell.Device, tmp_path: Path) -> None:
    seen: list[VacuumReading] = []
    with cell.connected(RegulatorDriver(config_for(tmp_path / "port"), seen.append)) as driver:
        assert driver.write(WANTED) == WANTED
        reading = cell.until(
            lambda: next((r for r in seen if r.setpoint == WANTED.pressure), None),
            "setpoint reported",
        )
        assert reading.measured == pytest.approx(
            WANTED.pressure, abs=600.0
        )  # six times the sensor's noise
        assert driver.write(VacuumSetpoint((-2e5, 5.0, 0.0))).pressure == (-100_000.0, 0.0, 0.0)
        for bad in (float("nan"), float("inf")):
            with pytest.raises(CommandRejectedError, match="finite"):
                driver.write(VacuumSetpoint((bad, 0.0, 0.0)))
        cell.until(
            lambda: device.status()["setpoint"] == [-100_000, 0, 0],
            "clipped setpoint at the device",
        )
        assert driver.health().values["rejected"] == 2
        driver.close()
    assert cell.whole([r.sequence for r in seen], driver)
    cell.until(lambda: device.status()["setpoint"] == [0, 0, 0], "vented at close")


def test_unplugged_and_back_the_setpoint_is_sent_again(device: cell.Device, tmp_path: Path) -> None:
    events: list[tuple[HealthLevel, str]] = []
    driver = RegulatorDriver(
        config_for(tmp_path / "port"), on_event=lambda *event: events.append(event)
    )
    driver.connect()
    try:
        driver.write(WANTED)
        cell.until(lambda: device.status()["setpoint"][0] == -20_000, "setpoint")
        device.fault("unplug")
        cell.until(lambda: driver.health().level is HealthLevel.ERROR, "loss noticed")
        with pytest.raises(DeviceUnavailableError):
            driver.write(VacuumSetpoint((-30_000.0, 0.0, 0.0)))
        device.fault("replug")
        cell.until(lambda: driver.health().level is HealthLevel.OK, "back")
        cell.until(lambda: device.status()["setpoint"][0] == -30_000, "setpoint sent again")
        # The setpoint's thread may have sent it before the other one told of the return.
        cell.until(lambda: len(events) == 2, "word of the loss and of the return")
        assert [level for level, _ in events] == [HealthLevel.ERROR, HealthLevel.OK]
    finally:
        driver.close()


def test_garbled_lines_are_counted_and_none_is_believed(
    device: cell.Device, tmp_path: Path
) -> None:
    seen: list[VacuumReading] = []
    held = config_for(tmp_path / "port", vent_after=60.0)  # whatever this process is kept from
    with cell.connected(RegulatorDriver(held, seen.append)) as driver:
        driver.write(WANTED)
        cell.until(lambda: seen and seen[-1].setpoint == WANTED.pressure, "setpoint")
        device.fault("garble 0.3")
        start = len(seen)
        cell.until(
            lambda: driver.health().values["bad_lines"] > 5 and len(seen) > start + 50,
            "garbled lines",
        )
        assert {r.setpoint for r in seen[start:]} == {WANTED.pressure}
        assert driver.health().values["lost_lines"] > 0


@pytest.mark.parametrize("fault", ["silence", pytest.param("stall", marks=pytest.mark.long)])
def test_silence_makes_it_stale_until_it_resumes(
    device: cell.Device, tmp_path: Path, fault: str
) -> None:
    with cell.connected(
        RegulatorDriver(config_for(tmp_path / "port", {"silence_timeout": 0.2}))
    ) as driver:
        cell.until(lambda: driver.health().level is HealthLevel.OK, "running")
        device.fault(fault)
        cell.until(
            lambda: driver.health().level in (HealthLevel.STALE, HealthLevel.ERROR),
            "silence noticed",
        )
        device.fault("resume")
        cell.until(lambda: driver.health().level is HealthLevel.OK, "resumed")


def test_without_a_host_the_device_vents(device: cell.Device, tmp_path: Path) -> None:
    driver = RegulatorDriver(config_for(tmp_path / "port", refresh=0.05, vent_after=0.3))
    driver.connect()
    driver.write(WANTED)
    cell.until(lambda: device.status()["setpoint"][0] == -20_000, "setpoint")
    driver._link.close()  # the host falls silent without a farewell

    def vented() -> bool:
        status = device.status()
        return status["vents"] > 0 and status["setpoint"] == [0, 0, 0]

    cell.until(vented, "vented by itself")
    driver.close()


def test_wrong_ports_say_what_is_wrong(device: cell.Device, tmp_path: Path) -> None:
    with pytest.raises(
        DeviceUnavailableError, match="this is the vacuum regulator, not the FSR reader"
    ):
        FsrDriver(cell.linked(FsrConfig.load(), tmp_path / "port")).connect()
    with pytest.raises(DeviceUnavailableError, match="plug it in, or set 'port' in vacuum.yaml"):
        RegulatorDriver(config_for(tmp_path / "nothing")).connect()
    (tmp_path / "file").touch()
    with pytest.raises(DeviceUnavailableError, match="cannot open"):
        RegulatorDriver(config_for(tmp_path / "file")).connect()
    with contextlib.closing(SerialPort(tmp_path / "silent")):
        quick = config_for(tmp_path / "silent", {"identify_timeout": 0.6})
        with pytest.raises(DeviceUnavailableError, match="nothing answers"):
            RegulatorDriver(quick).connect()


def test_bytes_that_make_no_sense_are_taken_for_a_wrong_baud_rate(tmp_path: Path) -> None:
    parser, enough = LineParser(), threading.Event()
    opening = Opening(config_for(tmp_path / "port").link, REGULATOR_DEVICE, "vacuum.yaml")
    with contextlib.closing(SerialPort(tmp_path / "port")) as port, ThreadPoolExecutor(1) as pool:

        def heard() -> bool:
            port.write(b"\xf3\x81,\x9c*0\n")
            return parser.statistics.bad >= 20 or found.done()

        found = pool.submit(opening.open, parser, enough)
        try:
            cell.until(heard, "broken lines")
        finally:
            enough.set()  # however long they took to come
        with pytest.raises(DeviceUnavailableError, match="wrong 'baud'"):
            found.result()


def test_a_second_driver_does_not_steal_the_port(device: cell.Device, tmp_path: Path) -> None:
    first = RegulatorDriver(config_for(tmp_path / "port"))
    first.connect()
    try:
        with pytest.raises(DeviceUnavailableError, match="in use"):
            RegulatorDriver(config_for(tmp_path / "port")).connect()
    finally:
        first.close()
