"""Link to the UR arm: latency from setpoint to echoed state, jitter of the states, and the stop of
a stale stream.

    python benchmarks/wrist_link.py [--seconds 10] [--stops 20]

Runs the driver against the emulated controller, both generations, and prints percentiles in
milliseconds.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.driver import UrDriver
from pianobot_ros.devices.wrist.wrist_reading import WristReading, WristSetpoint
from pianobot_ros.emulator.wrist.controller_process import EmulatedUr
from pianobot_ros.emulator.wrist.motion.kinematics import Array

RATES = {"cb3": 125.0, "e-series": 500.0}


def percentiles(name: str, seconds: Array) -> None:
    """One line of figures in milliseconds."""
    p50, p99, worst = (1e3 * float(np.percentile(seconds, q)) for q in (50, 99, 100))
    print(f"  {name:<44} p50 {p50:7.2f}   p99 {p99:7.2f}   max {worst:7.2f} ms   n {len(seconds)}")


def stream(driver: UrDriver, rate: float, seconds: float, velocity: float | None = None) -> float:
    """Stream a sine, or a straight line at ``velocity`` m/s along x; returns the time of the last
    write.
    """
    reading = driver.latest()
    assert reading is not None
    start, begun, last = np.array(reading.position), time.monotonic(), 0.0
    for cycle in range(1, round(seconds * rate) + 1):
        t = cycle / rate
        time.sleep(max(0.0, begun + t - time.monotonic()))
        offset = velocity * t if velocity is not None else 0.02 * np.sin(2 * np.pi * 1.0 * t)
        last = time.monotonic()
        driver.write(
            WristSetpoint(start + np.array([offset, 0.0, 0.0]), np.zeros(3), np.zeros(6), begun + t)
        )
    return last


def stops(driver: UrDriver, robot: EmulatedUr, rate: float, count: int) -> tuple[Array, Array]:
    """Time from the last setpoint to the start of braking and to rest (below 20 mm/s), s, for
    strikes of 0.3 m/s.
    """
    lasts = []
    for trial in range(count):
        lasts.append(stream(driver, rate, 0.25, 0.3 if trial % 2 == 0 else -0.3))
        time.sleep(0.3)
    time.sleep(0.6)  # the log is flushed every 64 cycles
    times, _, velocity, modes = robot.motion()
    speed = np.linalg.norm(velocity, axis=1)
    braking = np.array([mode == "stopl" for mode in modes])
    begin = [times[(times > last) & braking][0] - last for last in lasts]
    rest = [times[(times > last) & (speed < 0.02)][0] - last for last in lasts]
    return np.array(begin), np.array(rest)


def measure(model: str, directory: Path, seconds: float, count: int) -> None:
    """All figures of one generation of controllers."""
    rate = RATES[model]
    arrivals: list[float] = []
    clock: list[float] = []
    with EmulatedUr(directory, model) as robot:
        config = UrConfig.load()
        config = config.model_copy(
            update={"link": config.link.model_copy(update={"host": robot.host})}
        )
        begun = time.monotonic()

        def note(reading: WristReading) -> None:
            arrivals.append(reading.monotonic)
            clock.append(reading.controller_time)

        driver = UrDriver(config, on_reading=note)
        driver.connect()
        print(f"{model}, {rate:g} Hz (connected in {time.monotonic() - begun:.2f} s)")
        assert driver.process_id is not None
        worker = psutil.Process(driver.process_id)
        worker.cpu_percent()
        # Several streams, so that the phase between the stream and the controller's cycle differs.
        for _ in range(5):
            stream(driver, rate, seconds / 5)
            time.sleep(0.1)
        load = worker.cpu_percent()
        percentiles("setpoint written to state that echoes it", np.array(driver.latencies()))
        percentiles("interval between states", np.diff(arrivals))
        missing = round((clock[-1] - clock[0]) * rate) + 1 - len(clock)
        print(
            f"  states missed: {missing} of {len(clock) + missing}; driver process {load:.0f} % of"
            " a core"
        )
        begin, rest = stops(driver, robot, rate, count)
        percentiles("last setpoint to braking", begin)
        percentiles("last setpoint to rest, from 0.3 m/s", rest)
        driver.close()


def main() -> None:
    """Print the figures of both generations."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--stops", type=int, default=20)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as directory:
        for model in RATES:
            measure(model, Path(directory), options.seconds, options.stops)


if __name__ == "__main__":
    main()
