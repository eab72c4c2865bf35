"""Speed of the emulated cell: ``python benchmarks/plant.py [--seconds S]``.

Prints the offline cell's speed on the standard strikes, its own convergence, and the live plant's
cost and lateness.
"""

from __future__ import annotations

import argparse
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from pianobot_ros.cell.recordings.commands import CYCLE
from pianobot_ros.emulator.plant.cases.case import Case
from pianobot_ros.emulator.plant.instruments.arm_servo import ArmModel
from pianobot_ros.emulator.plant.live_plant import TOGETHER, LivePlant
from pianobot_ros.emulator.plant.offline import simulate_commands, standard_strikes
from pianobot_ros.emulator.serving.bus import PlantBus


def offline() -> None:
    commands = standard_strikes(0)
    span = float(commands.time[-1] - commands.time[0])
    for label, case in (("nominal", Case()), ("all joint and key effects", Case(_HEAVY))):
        simulate_commands(commands, case)
        best = min(_seconds(lambda case=case: simulate_commands(commands, case)) for _ in range(3))
        print(
            f"offline, {label}: 40 strikes, {span:.1f} s of the cell in {best:.2f} s:"
            f" {span / best:.0f} x real time"
        )
    quiet = Case(repeatability=0.0, noise=0.0)
    short = standard_strikes(2, n=10, repeats=1)
    finest = simulate_commands(short, quiet, step=2.5e-6).signal("real/fsr.force").value
    for step in (2.5e-5, 5e-5, 1e-4):
        force = simulate_commands(short, quiet, step=step).signal("real/fsr.force").value
        error = np.sqrt(np.mean((force - finest) ** 2) / np.mean(finest**2))
        print(
            f"offline, step {step:.1e} s: force off by {100 * error:.3f} % RMS from step 2.5e-06 s"
        )


def live(seconds: float) -> None:
    commands = standard_strikes(0)
    targets = np.hstack([commands.position, commands.rotation])
    with tempfile.TemporaryDirectory() as folder, PlantBus.create(Path(folder) / "bus") as bus:
        plant, arm = LivePlant(bus, Case()), ArmModel(targets[0])
        plant.warm_up()
        arm.step(CYCLE, targets[0])

        def move() -> None:
            due = time.monotonic()
            for target in targets[: round(seconds / CYCLE)]:
                bus.write_wrist(due + CYCLE, *arm.step(CYCLE, target, bus.read_reaction()))
                due += CYCLE
                time.sleep(max(due - time.monotonic(), 0.0))
            bus.request_stop()

        threading.Thread(target=move, daemon=True).start()
        lateness: list[float] = []
        tick = plant.tick

        def timed(now: float) -> None:
            tick(now)
            lateness.append(time.monotonic() - now)

        plant.tick = timed  # type: ignore[method-assign]
        before = time.process_time()
        plant.run()
        used = (time.process_time() - before) / (len(lateness) * TOGETHER * 1e-3)
    p50, p99 = np.percentile(lateness, [50, 99]) * 1e3
    print(
        f"live, three fingers and twelve keys: {used:.2f} cores with the arm's thread, tick done"
        f" {p50:.2f} ms (p50) and {p99:.2f} ms (p99) after its time, skipped {plant.late} times in"
        f" {seconds:g} s"
    )


_HEAVY = {
    "joint_friction": 3.0,
    "joint_creep": 3.0,
    "jamming_hysteresis": 3.0,
    "key_friction": 3.0,
    "hammer": 3.0,
    "pad_compliance": 3.0,
}


def _seconds(run: object) -> float:
    start = time.perf_counter()
    run()  # type: ignore[operator]
    return time.perf_counter() - start


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the live run")
    options = parser.parse_args()
    offline()
    live(options.seconds)
