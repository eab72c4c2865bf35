"""The live plant against the offline one, the bus, and the cell's launcher."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.cell.host.halted import still_living
from pianobot_ros.emulator.cell import CellOptions, EmulatedCell
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.instruments.arm_servo import ArmModel
from pianobot_ros.emulator.plant.instruments.pneumatics import RegulatorModel
from pianobot_ros.emulator.plant.live_plant import TOGETHER, LivePlant
from pianobot_ros.emulator.plant.offline import CYCLE, simulate_commands, standard_strikes
from pianobot_ros.emulator.serving.bus import BusError, PlantBus
from pianobot_ros.testing import wait_for

QUIET = Case(repeatability=0.0, noise=0.0)


def test_live_plant_agrees_with_offline(tmp_path: Path) -> None:
    commands = standard_strikes(3, n=2, repeats=1)
    case = Case({"key_friction": 5.0, "wrist_compliance": 5.0}, repeatability=0.0, noise=0.0)
    offline = simulate_commands(commands, case, fingers=("thumb", "index", "middle"))
    targets = np.hstack([commands.position, commands.rotation])
    start = 1000.0
    with PlantBus.create(tmp_path / "bus", case.to_json()) as bus:
        plant, arm = LivePlant(bus, case), ArmModel.from_bus(targets[0], bus)
        plant.origin = start
        bus.write_wrist(start, targets[0], np.zeros(6))
        forces = []
        for k, target in enumerate(targets):
            now = start + k * CYCLE
            bus.write_wrist(now + CYCLE, *arm.step(CYCLE, target, bus.read_reaction()))
            at = np.searchsorted(commands.vacuum_time, now - start + 1e-6, side="right") - 1
            bus.write_pressure(now, commands.pressure[at])
            since = bus.read_samples().next_index
            for i in range(TOGETHER, 9, TOGETHER):
                plant.tick(now + i * 1e-3)
            forces.append(bus.read_samples(since).force)
        events = bus.read_events(0)
    force, expected = np.concatenate(forces), offline.signal("real/fsr.force").value
    every = round(
        1e3 * (offline.signal("real/fsr.force").time[1] - offline.signal("real/fsr.force").time[0])
    )
    force = force[every - 1 :: every]
    assert force == pytest.approx(expected[: len(force)], abs=0.02)
    notes = offline.notes["real"]
    assert events.time - start == pytest.approx([n.time for n in notes], abs=5e-5)
    assert list(events.velocity) == [n.velocity for n in notes]
    assert list(events.status == 0x90) == [n.on for n in notes]


def test_bus_tells_readers_what_they_lost(tmp_path: Path) -> None:
    with PlantBus.create(tmp_path / "bus") as bus, PlantBus.attach(tmp_path / "bus") as reader:
        rows = np.arange(16.0 * 10).reshape(10, 16)
        bus.write_samples(rows)
        got = reader.read_samples(0)
        assert (got.next_index, got.lost) == (10, 0)
        assert np.array_equal(got.angles, rows[:, 4:])
        assert np.array_equal(got.reading, rows[:, 2])
        bus.write_samples(np.zeros((6000, 16)))
        late = reader.read_samples(got.next_index)
        assert late.lost > 0
        assert late.lost + len(late.time) == 6000
        assert len(reader.read_samples(None).time) == 0
        bus.write_event(1.5, 0x90, 64, 80)
        event = reader.read_events(0)
        assert (event.time[0], event.status[0], event.note[0], event.velocity[0]) == (
            1.5,
            0x90,
            64,
            80,
        )
        bus.write_reaction(1.0, [1.0, 2.0, 3.0])
        assert list(reader.read_reaction()) == [1.0, 2.0, 3.0]
        assert not reader.ready
        bus.beat(ready=True)
        assert reader.ready and reader.age() < 10.0


def test_bus_refuses_what_is_none(tmp_path: Path) -> None:
    with pytest.raises(BusError, match="start `python -m"):
        PlantBus.attach(tmp_path / "nothing")
    (tmp_path / "other").write_bytes(b"something else")
    with pytest.raises(BusError, match="not the shared memory"):
        PlantBus.attach(tmp_path / "other")


def test_nominal_arm_is_a_second_order_system() -> None:
    arm = ArmModel(np.zeros(6), QUIET)
    target = np.array([0.01, 0.0, -0.02, 0.0, 0.1, 0.0])
    for k in range(1, 40):
        pose, twist = arm.step(CYCLE, target, [0.0, 0.0, 5.0])
        x = 60.0 * k * CYCLE
        assert pose == pytest.approx(target * (1 - (1 + x) * np.exp(-x)), abs=1e-12)
        assert twist == pytest.approx(target * 60.0 * x * np.exp(-x), abs=1e-10)
    assert np.array_equal(arm.measured(), pose)


def test_arm_follows_the_shorter_way_of_a_rotation() -> None:
    arm = ArmModel([0, 0, 0, 3.1, 0, 0], QUIET)
    for _ in range(100):
        pose, _ = arm.step(CYCLE, [0, 0, 0, -3.1, 0, 0])
    assert pose[3] == pytest.approx(2 * np.pi - 3.1, abs=1e-6)


def test_compliant_arm_gives_way_under_the_keys() -> None:
    arm = ArmModel(
        np.zeros(6), Case(physical={"wrist_compliance": 1e-4}, repeatability=0.0, noise=0.0)
    )
    for _ in range(1000):
        pose, _ = arm.step(CYCLE, np.zeros(6), [0.0, 0.0, 5.0])
    assert pose[2] == pytest.approx(5e-4, rel=1e-3)


def test_regulators_nominal_and_with_each_effect() -> None:
    down, up = np.full(3, -50e3), np.full(3, -20e3)

    def settle(physical: dict[str, float]) -> tuple[float, float]:
        model = RegulatorModel(case=Case(physical=physical, noise=0.0))
        ends = []
        for aim in (down, up, np.full(3, -80e3), down):
            for _ in range(100):
                measured = model.step(0.01, aim)
            ends.append(float(measured[0]))
        return ends[0], ends[-1]

    assert settle({}) == (-50e3, -50e3)
    leak = settle({"pressure_leak": 1000.0})
    assert leak[0] == pytest.approx(-50e3 + 1000 * np.sqrt(0.5), rel=1e-3)
    before, after = settle({"regulator_hysteresis": 500.0})
    assert abs(before - after) > 300.0
    lag = RegulatorModel(case=Case(physical={"pressure_lag": 1.0}, noise=0.0))
    first = lag.step(0.01, down)[0]
    assert -2000.0 < first < -500.0


def launched(processes: Any, name: str, folder: Path, *words: str) -> Any:
    """The launcher with the plant alone."""
    cell = ("--name", name, "--directory", str(folder), "--devices", "plant")
    return processes.python("pianobot_ros.emulator", *cell, *words, log="cell")


def bus_of(processes: Any) -> str:
    """Where the launched cell has its bus, once it is ready."""

    def ready() -> str:
        lines = processes.output("cell").splitlines(keepends=True)
        return next((x for x in lines if x.startswith("{") and x.endswith("\n")), "")

    line = wait_for(ready, "ready", 120.0)
    return str(json.loads(line)["plant"]["bus"])


@pytest.mark.graph
def test_launcher_starts_and_stops_the_cell(processes: Any, tmp_path: Path) -> None:
    name = f"test{os.getpid()}"
    secret = tmp_path / "secret.json"
    cell = launched(
        processes, name, tmp_path, "--draw", "effect", "--seed", "5", "--secret", str(secret)
    )
    address = bus_of(processes)
    assert "effects" not in processes.output("cell")
    assert len(json.loads(secret.read_text())["effects"]) == 1
    assert secret.stat().st_mode & 0o077 == 0
    with PlantBus.attach(address) as bus:
        assert bus.ready
        for _ in range(2):
            bus.write_wrist(1.0, np.zeros(6), np.zeros(6))
        samples = bus.read_samples(0)
        wait_for(lambda: len(bus.read_samples(samples.next_index).time) > 100, "samples")
        children = psutil.Process(cell.pid).children(recursive=True)
        assert children
        assert cell.end(signal.SIGINT) == 0
    assert not Path(address).exists()
    assert still_living(children, 60.0) == []


@pytest.mark.graph
def test_no_device_outlives_a_killed_launcher(processes: Any, tmp_path: Path) -> None:
    name = f"test{os.getpid()}k"
    cell = launched(processes, name, tmp_path)
    address = bus_of(processes)
    children = psutil.Process(cell.pid).children(recursive=True)
    cell.kill()
    assert still_living(children, 60.0) == []
    for left in (address, f"{address}.bell"):
        Path(left).unlink()


def test_launcher_names_a_device_that_fails(tmp_path: Path) -> None:
    options = CellOptions(
        host="192.0.2.1", directory=tmp_path, bus=tmp_path / "bus", devices=("wrist",)
    )  # of no machine; and no name, for which a server of names would be asked
    with pytest.raises(DeviceError, match="emulated wrist has ended"):
        EmulatedCell(QUIET, options).start(60.0)
    assert not (tmp_path / "bus").exists()
