"""How long `pianobot axis` takes for a long log, and how much memory.

    python benchmarks/axis_big_log.py [--rows 5000000] [--columns-only] [--dates]

Writes a log of one joint at 1 kHz (command, position, velocity, torque) to a temporary file, runs
the command on it in a process of its own and prints its CPU seconds and peak resident memory.
"""

from __future__ import annotations

import argparse
import math
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

RATE = 1000.0
PIECE = 100_000


def write(path: Path, rows: int, dates: bool) -> None:
    """A joint of 30 rad/s and damping 0.8 that follows slow sines, with gravity and friction in
    its torque.
    """
    rng = np.random.default_rng(0)
    dt, wn, zeta = 1.0 / RATE, 30.0, 0.8
    past = np.zeros(2)
    a = [1.0 + 2 * zeta * wn * dt, -(2.0 + 2 * zeta * wn * dt - (wn * dt) ** 2), 1.0]
    with path.open("w", encoding="utf-8") as file:
        file.write("time,command,position,velocity,torque\n")
        for first in range(0, rows, PIECE):
            t = np.arange(first, min(first + PIECE, rows)) * dt
            u = 0.6 * np.sin(0.7 * t) + 0.3 * np.sin(2.3 * t) + 0.2 * np.sin(0.0031 * t)
            q, past = lfilter([0.0, (wn * dt) ** 2], a, u, zi=past)
            v = np.gradient(q, dt)
            effort = 0.1 * np.gradient(v, dt) + 0.4 * np.sign(v) + 1.5 * np.sin(q)
            noise = rng.standard_normal((2, t.size))
            columns = [t, u, q + 1e-4 * noise[0], v, effort + 0.02 * noise[1]]
            stamps = (
                np.datetime_as_string(
                    np.datetime64("2024-03-01") + (1e9 * t).astype("m8[ns]"), "us"
                )
                if dates
                else [f"{x:.4f}" for x in t]
            )
            body = zip(stamps, *(c.tolist() for c in columns[1:]), strict=True)
            file.writelines(f"{t},{u:.6f},{q:.6f},{v:.5f},{e:.5f}\n" for t, u, q, v, e in body)


def main() -> None:
    """Parse arguments, write, run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=5_000_000)
    parser.add_argument("--columns-only", action="store_true", help="read it only")
    parser.add_argument("--dates", action="store_true", help="ISO dates instead of seconds")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.csv"
        write(path, args.rows, args.dates)
        size = path.stat().st_size / 1e6
        what = "columns" if args.columns_only else "diagnose"
        start = time.monotonic()
        code = "from pianobot_ros.cli.app import main; import sys; sys.exit(main())"
        command = [sys.executable, "-c", code, "axis", what, str(path)]
        done = subprocess.run(command, check=False, text=True, capture_output=True)
        wall = time.monotonic() - start
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(done.stdout, done.stderr, sep="")
        cpu = used.ru_utime + used.ru_stime
        print(
            f"{args.rows} rows, {size:.0f} MB: {what} took {cpu:.1f} s of CPU ({wall:.1f} s),"
            f" {math.ceil(used.ru_maxrss / 1024)} MB at most; exit {done.returncode}"
        )


if __name__ == "__main__":
    main()
