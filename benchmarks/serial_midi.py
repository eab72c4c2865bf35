"""Latency and losses of the serial and MIDI links.

Run: python benchmarks/serial_midi.py [--seconds S]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from pianobot_ros.devices.fsr import FsrConfig, FsrDriver, FsrReading
from pianobot_ros.devices.midi import open_transport

SOCKET = "127.0.0.1:30149"


def quantiles(name: str, seconds: list[float], rest: str) -> None:
    p50, p99 = np.percentile(1e3 * np.asarray(seconds), [50, 99])
    print(f"{name:32s} n {len(seconds):6d}  p50 {p50:6.3f} ms  p99 {p99:6.3f} ms  {rest}")


def serial(duration: float, rate: float) -> None:
    """Delay from the sample's stamp to the driver's callback; the device sends in bunches of 4
    ms.
    """
    with tempfile.TemporaryDirectory() as folder:
        port = Path(folder) / "fsr"
        device = subprocess.Popen(
            [sys.executable, "-m", "pianobot_ros.emulator.fsr", "--link", str(port)],
            stderr=subprocess.PIPE,
        )
        try:
            assert device.stderr is not None
            device.stderr.readline()
            config = FsrConfig.load()
            link = config.link.model_copy(update={"port": str(port)})
            sensor = config.sensor.model_copy(update={"rate": rate})
            delays: list[float] = []

            def note(readings: list[FsrReading]) -> None:
                now = time.time_ns()
                delays.extend(1e-9 * (now - r.time_ns) for r in readings)

            driver = FsrDriver(config.model_copy(update={"link": link, "sensor": sensor}), note)
            driver.connect()
            before = time.process_time()
            time.sleep(duration)
            load = (time.process_time() - before) / duration
            values = driver.health().values
            driver.close()
            rest = (
                f"lost {values['lost_lines']} bad {values['bad_lines']}  {100 * load:.1f} % of a"
                " core"
            )
            quantiles(f"FSR at {rate:.0f} Hz, stamp to host", delays, rest)
        finally:
            device.terminate()
            device.wait()


def midi(duration: float) -> None:
    """One way between two ends of a socket in one process, 100 messages a second."""
    arrived: list[int] = []
    ends = [
        open_transport(
            "socket",
            lambda _: arrived.append(time.perf_counter_ns()),
            client="",
            port="",
            socket=SOCKET,
            instrument=True,
        ),
        open_transport("socket", lambda _: None, client="", port="", socket=SOCKET),
    ]
    sent = []
    for i in range(int(100 * duration)):
        sent.append(time.perf_counter_ns())
        ends[1].send(bytes([0x90, i % 128, 64]))
        time.sleep(0.01)
    time.sleep(0.2)
    for end in reversed(ends):
        end.close()
    delays = [1e-9 * (b - a) for a, b in zip(sent, arrived, strict=False)]
    quantiles("MIDI over sockets, one way", delays, f"lost {len(sent) - len(arrived)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each link")
    seconds = parser.parse_args().seconds
    for rate in (500.0, 1000.0):
        serial(seconds, rate)
    midi(seconds)


if __name__ == "__main__":
    main()
