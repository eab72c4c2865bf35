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
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.geometry import keyboard
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.cases.effects import parse_effects
from pianobot_ros.emulator.plant.instruments.held import held
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

__all__ = ["TOGETHER", "LivePlant", "main"]


EXTRAPOLATE = 0.02  # s that the wrist is taken to go on at its last velocity
LATE = 0.1  # s of lateness that is caught up; beyond, the plant skips
# Ticks at a time: to wake up and to enter compiled code costs as much as a tick. With more of them,
# samples would come too late for the force board's bunches.
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


class _Live(NamedTuple):
    """All that the compiled ticks work on; the arrays are changed in place, but for the knots.

    ``wrist`` (4, 6) is pose and twist at the start of the last tick and at its end; ``rows`` (n,
    16) are the samples of n ticks, as the bus takes them.
    """

    simulated: Simulated
    fsr: FsrParameters
    fsr_key: int
    fsr_noise: float
    fsr_memory: Array
    steps: int
    knots: Array
    wrist: Array
    events: Array
    rows: Array


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _live_ticks(
    live_held: Any, head: int, pressure: Array, tick: int, now: float, origin: float, normal: Array
) -> int:
    """The milliseconds until ``now``, one for each row, the first of them the ``tick``-th; ``head``
    of the knots. Fills the rows, with the device time as one without clock effects has it,
    ``normal`` being the noise's source. Returns the number of events.
    """
    live = live_held[0]
    rows, state, fsr_memory = live.rows, live.simulated.state, live.fsr_memory
    wrist, events = live.wrist, live.events
    count = 0
    force, vacuum, reading = np.empty(1), np.empty(1), np.empty(1)
    vacuum[0] = (pressure[0] + pressure[1] + pressure[2]) / 3.0
    for i in range(len(rows)):
        end = now - (len(rows) - 1 - i) * 1e-3
        wrist[0] = wrist[2]
        wrist[1] = wrist[3]
        wrist_at(live.knots, head, end, wrist[2], wrist[3])
        start = end - 1e-3 - origin
        count += plant_tick(
            live.simulated, start, 1e-3, live.steps, wrist, pressure, events[count:]
        )
        row = rows[i]
        row[0], row[1], row[3] = end, state.keys[live.fsr_key, NORMAL], end - origin
        for j in range(12):
            row[4 + j] = state.keys[j, ANGLE]
        force[0] = max(row[1], 0.0)
        fsr_readings(live.fsr, fsr_memory, tick + i, 1e-3, force, vacuum, reading)
        row[2] = reading[0] + live.fsr_noise * normal[(tick + i) % len(normal)]
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
        self._random = np.random.default_rng([case.seed, 5])
        self._normal = self._random.standard_normal(_BLOCK)
        self._live = self._arrays(self.model.simulated, bus.wrist_ring()[0])
        self._held = held(self._live)
        self._waiting: list[tuple[float, int, int, int]] = []
        self._ticks = 0
        self._started = False
        self.origin = 0.0

    def _arrays(self, simulated: Simulated, knots: Array) -> _Live:
        return _Live(
            simulated,
            fsr_parameters(self.case),
            keyboard().notes.index(fsr_config().sensor.note),
            float(noise_levels().fsr * self.case.noise),
            np.zeros(FSR_MEMORY),
            max(1, round(TICK / self.model.step_size)),
            knots,
            np.zeros((4, 6)),
            np.zeros((64, 4)),
            np.zeros((TOGETHER, 16)),
        )

    def warm_up(self) -> None:
        """Compile (or load) everything that a tick needs."""
        knots = np.zeros((4, 13))
        knots[:, 0] = -np.arange(4, 0, -1) * TICK
        knots[:, 3] = 1.0
        live = held(self._arrays(PlantModel(self.case).simulated, knots))
        _live_ticks(live, 4, np.zeros(3), 0, 0.0, 0.0, self._normal)
        MidiSensor(self.case).notes(np.array([[0.0, 1.0, 0.0, 0.1]]))

    def tick(self, now: float) -> None:
        """The ``TOGETHER`` milliseconds that end at ``now`` (monotonic s)."""
        bus, live = self.bus, self._live
        if self._ticks % _BLOCK == 0:
            self._normal = self._random.standard_normal(_BLOCK)
        head = bus.wrist_ring()[1]
        if head == 0:  # no arm yet: nothing moves, but the sensors are there
            count = self._rest(now)
        else:
            if not self._started:
                start = now - TOGETHER * TICK
                wrist_at(live.knots, head, start, live.wrist[2], live.wrist[3])
                self._started = True
            pressure = bus.read_pressure()[1]
            count = _live_ticks(
                self._held, head, pressure, self._ticks, now, self.origin, self._normal
            )
            bus.write_reaction(now, self.model.state.cell[REACTION : REACTION + 3])
        live.rows[:, 3] = self._clock.read(live.rows[:, 3])
        bus.write_samples(live.rows)
        if count:
            self._sound(live.events[:count].copy())
        while self._waiting and self._waiting[0][0] <= now:
            bus.write_event(*heapq.heappop(self._waiting))
        self._ticks += TOGETHER

    def _rest(self, now: float) -> int:
        """The sensors of a cell at rest; no events."""
        rows = self._live.rows
        rows[:, 0] = now - TICK * np.arange(TOGETHER - 1, -1, -1)
        rows[:, 1] = 0.0
        at = self._ticks % _BLOCK
        rows[:, 2] = self._live.fsr_noise * self._normal[at : at + TOGETHER]
        rows[:, 3] = rows[:, 0] - self.origin
        return 0

    def _sound(self, passages: Array) -> None:
        """Let the notes of ``passages`` (n, 4) wait for their time."""
        passages[:, 0] += self.origin
        for note in self._midi.notes(passages):
            heapq.heappush(
                self._waiting,
                (note.time, 0x90 if note.on else 0x80, note.note, int(note.velocity)),
            )

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
