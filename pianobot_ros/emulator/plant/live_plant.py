"""The plant in real time: a process that ticks between the emulated devices, two milliseconds at a
time.
"""

from __future__ import annotations

import argparse
import heapq
import json
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.cases.effects import parse_effects
from pianobot_ros.emulator.plant.instruments.sensor_noise import noise_levels
from pianobot_ros.emulator.plant.instruments.sensors import (
    FSR_MEMORY,
    FsrParameters,
    MidiSensor,
    SensorClock,
    fsr_config,
    fsr_parameters,
    fsr_readings,
)
from pianobot_ros.emulator.plant.laws.row_layout import ANGLE, NORMAL, REACTION
from pianobot_ros.emulator.plant.mechanics.physics import Simulated
from pianobot_ros.emulator.plant.mechanics.plant_model import TICK, PlantModel, plant_tick
from pianobot_ros.emulator.serving.bus import PlantBus

__all__ = ["LivePlant", "main"]


EXTRAPOLATE = 0.02  # s that the wrist is taken to go on at its last velocity
LATE = 0.1  # s of lateness that is caught up; beyond, the plant skips
# Ticks in one: to wake up and to enter compiled code costs as much as a tick itself. More would make
# the newest sample older than the force board's bunches allow.
TOGETHER = 2
_BLOCK = 4096


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def wrist_at(knots: Array, head: int, t: float, pose: Array, twist: Array) -> None:
    """Wrist state at ``t`` from the ring of knots: cubic between two, straight on behind the last,
    held before the first.
    """
    size = len(knots)
    oldest = max(0, head - size // 2)
    i = head - 1
    while i > oldest and knots[i % size, 0] > t:
        i -= 1
    a = knots[i % size]
    if i == head - 1 or a[0] > t:
        ahead = min(max(t - a[0], 0.0), EXTRAPOLATE)
        going = 1.0 if 0.0 <= t - a[0] < EXTRAPOLATE else 0.0
        for c in range(6):
            pose[c] = a[1 + c] + ahead * a[7 + c]
            twist[c] = going * a[7 + c]
        return
    b = knots[(i + 1) % size]
    span = b[0] - a[0]
    u = (t - a[0]) / span
    for c in range(6):
        p0, p1, v0, v1 = a[1 + c], b[1 + c], a[7 + c] * span, b[7 + c] * span
        d = p1 - p0
        c2, c3 = 3.0 * d - 2.0 * v0 - v1, v0 + v1 - 2.0 * d
        pose[c] = p0 + u * (v0 + u * (c2 + u * c3))
        twist[c] = (v0 + u * (2.0 * c2 + 3.0 * u * c3)) / span


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _live_ticks(
    plant: Simulated,
    start: float,
    steps: int,
    knots: Array,
    head: int,
    wrist: Array,
    pressure: Array,
    events: Array,
    rows: Array,
    fsr_key: int,
    fsr: FsrParameters,
    fsr_memory: Array,
    tick: int,
) -> int:
    """The milliseconds that end at the times in the first column of ``rows`` (n, 16), the
    ``tick``-th and those that follow; ``start`` on the plant's clock. ``wrist`` (4, 6) is pose and
    twist at start and end of the last one; fills the rows, without noise and device time. Returns
    the number of ``events``.
    """
    count = 0
    state = plant.state
    force, vacuum, reading = np.empty(1), np.empty(1), np.empty(1)
    vacuum[0] = (pressure[0] + pressure[1] + pressure[2]) / 3.0
    for i in range(len(rows)):
        wrist[0] = wrist[2]
        wrist[1] = wrist[3]
        wrist_at(knots, head, rows[i, 0], wrist[2], wrist[3])
        begin = start + i * 1e-3
        count += plant_tick(plant, begin, 1e-3, steps, wrist, pressure, events[count:])
        rows[i, 1] = state.keys[fsr_key, NORMAL]
        for j in range(12):
            rows[i, 4 + j] = state.keys[j, ANGLE]
        force[0] = max(rows[i, 1], 0.0)
        fsr_readings(fsr, fsr_memory, tick + i, 1e-3, force, vacuum, reading)
        rows[i, 2] = reading[0]
    return count


class LivePlant:
    """The plant of one case on a bus: :meth:`tick` is two milliseconds of it, :meth:`run` its life
    in real time.
    """

    def __init__(self, bus: PlantBus, case: Case) -> None:
        self.bus = bus
        self.case = case
        self.model = PlantModel(case)
        self.late = 0
        self._midi = MidiSensor(case)
        self._clock = SensorClock(case)
        self._fsr = fsr_parameters(case)
        self._fsr_memory = np.zeros(FSR_MEMORY)
        self._noise = noise_levels().fsr * case.noise
        self._random = np.random.default_rng([case.seed, 5])
        self._normal = self._random.standard_normal(_BLOCK)
        self._key = keyboard().notes.index(fsr_config().sensor.note)
        self._steps = max(1, round(TICK / self.model.step_size))
        self._wrist = np.zeros((4, 6))
        self._events = np.zeros((64, 4))
        self._rows = np.zeros((TOGETHER, 16))
        self._waiting: list[tuple[float, int, int, int]] = []
        self._ticks = 0
        self._started = False
        self.origin = 0.0

    def warm_up(self) -> None:
        """Compile (or load) everything that a tick needs."""
        model = PlantModel(self.case)
        knots = np.zeros((4, 13))
        knots[:, 0] = -np.arange(4, 0, -1) * TICK
        knots[:, 3] = 1.0
        _live_ticks(
            model.simulated,
            0.0,
            self._steps,
            knots,
            4,
            np.zeros((4, 6)),
            np.zeros(3),
            self._events,
            np.zeros((TOGETHER, 16)),
            self._key,
            self._fsr,
            np.zeros(FSR_MEMORY),
            0,
        )
        MidiSensor(self.case).notes(np.array([[0.0, 1.0, 0.0, 0.1]]))

    def tick(self, now: float) -> None:
        """The ``TOGETHER`` milliseconds that end at ``now`` (monotonic s)."""
        rows = self._rows
        rows[:, 0] = [now - TICK * before for before in range(TOGETHER - 1, -1, -1)]
        count = self._move(now)
        if self._ticks % _BLOCK == 0:
            self._normal = self._random.standard_normal(_BLOCK)
        at = self._ticks % _BLOCK
        rows[:, 2] += self._noise * self._normal[at : at + TOGETHER]
        rows[:, 3] = self._clock.read(rows[:, 0] - self.origin)
        self.bus.write_samples(rows)
        if count:
            passages = self._events[:count].copy()
            passages[:, 0] += self.origin
            for note in self._midi.notes(passages):
                heapq.heappush(
                    self._waiting,
                    (note.time, 0x90 if note.on else 0x80, note.note, int(note.velocity)),
                )
        while self._waiting and self._waiting[0][0] <= now:
            self.bus.write_event(*heapq.heappop(self._waiting))
        self._ticks += TOGETHER

    def _move(self, now: float) -> int:
        """Fingers, keys and force sensor until ``now``, into the rows; returns the number of
        events.
        """
        bus, start = self.bus, now - TOGETHER * TICK
        knots, head = bus.wrist_ring()
        if head == 0:  # no arm yet: nothing moves, but the sensors are there
            self._rows[:, 1:3] = 0.0
            return 0
        if not self._started:
            wrist_at(knots, head, start, self._wrist[2], self._wrist[3])
            self._started = True
        count = _live_ticks(
            self.model.simulated,
            start - self.origin,
            self._steps,
            knots,
            head,
            self._wrist,
            bus.read_pressure()[1],
            self._events,
            self._rows,
            self._key,
            self._fsr,
            self._fsr_memory,
            self._ticks,
        )
        bus.write_reaction(now, self.model.state.cell[REACTION : REACTION + 3])
        return count

    def run(self) -> None:
        """Tick until the bus asks to stop. Late by less than ``LATE`` it catches up, beyond that it
        skips and counts.
        """
        self.origin = time.monotonic()
        self.bus.beat(ready=True)
        due = self.origin
        while not self.bus.stop_requested:
            due += TOGETHER * TICK
            now = time.monotonic()
            if now < due:
                time.sleep(due - now)
            elif now - due > LATE:
                self.late += 1
                due = now
            self.tick(due)
            if self._ticks % 16 == 0:
                self.bus.beat()


def main(arguments: Sequence[str] | None = None) -> int:
    """``python -m pianobot_ros.emulator.plant``."""
    parser = argparse.ArgumentParser(
        prog="python -m pianobot_ros.emulator.plant", description=__doc__
    )
    parser.add_argument(
        "--bus", required=True, help="shared memory of the cell; made if it does not exist"
    )
    parser.add_argument(
        "--seed", type=int, default=None, help="random seed (default: of the bus, else 0)"
    )
    parser.add_argument(
        "--effects", default="", help="name=magnitude,... in units of the repeatability floor"
    )
    parser.add_argument(
        "--secret", type=Path, help="write what this cell is to FILE, readable by its owner only"
    )
    options = parser.parse_args(arguments)
    try:
        effects = parse_effects(options.effects)
        made = not Path(options.bus).exists()
        bus = (
            PlantBus.create(options.bus, Case(effects, seed=options.seed or 0).to_json())
            if made
            else PlantBus.attach(options.bus)
        )
        with bus:
            case = Case.from_json(bus.case())
            if effects or options.seed is not None:
                case = Case(
                    effects or case.effects,
                    case.parameters,
                    seed=case.seed if options.seed is None else options.seed,
                )
            if options.secret:
                write_secret(options.secret, case)
            plant = LivePlant(bus, case)
            plant.warm_up()
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda *_: bus.request_stop())
            print("ready", flush=True)
            plant.run()
            if plant.late:
                print(f"the plant was too late {plant.late} times and skipped", file=sys.stderr)
    except PianobotError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def write_secret(path: Path, case: Case) -> None:
    """Put the description of ``case`` into a file that only its owner can read."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(mode=0o600)
    path.write_text(json.dumps(case.to_json(), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
