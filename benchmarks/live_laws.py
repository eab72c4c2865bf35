"""How fast the whole-hand twin runs with one family on, against the nominal twin.

Run: python benchmarks/live_laws.py [--seconds 1.0]
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.piano.gap.adoption.live_laws import LiveLaws, parse_effects
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin
from pianobot_ros.piano.twin.stepping.rollout import strike_commands


def speed(twin: CellTwin, seconds: float) -> float:
    """Simulated seconds for one of processor time, at the live loop's chunks of 4 ms."""
    commands = strike_commands({"middle": 64}, StrikeMotion(0.2, 0.014, 0.2), pressure=-50e3)
    twin.reset(commands.pose[0])
    targets = commands.at_steps(twin.cell.timestep)
    chunk = round(4e-3 / twin.cell.timestep)
    twin.step(chunk, targets[:chunk])
    begun, done = time.process_time(), 0.0
    i = chunk
    while done < seconds:
        twin.step(chunk, targets[i : i + chunk])
        done += chunk * twin.cell.timestep
        i = i + chunk if i + 2 * chunk < len(targets) else chunk
    return done / (time.process_time() - begun)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="simulated, for each family")
    options = parser.parse_args()
    twin = CellTwin()
    speed(twin, 0.2)
    print(f"{'family':<22} {'speed':>7} {'of nominal':>11}")
    for name, family in LIBRARY.items():
        start = family.starts[-1]
        laws = LiveLaws(parse_effects([f"{name}.{n}={x!r}" for n, x in start.items()]))
        pairs = []
        for _ in range(3):
            twin.correct(None)
            plain = speed(twin, options.seconds / 3)
            twin.correct(laws)
            speed(twin, 0.01)
            pairs.append((speed(twin, options.seconds / 3), plain))
        own, plain = np.median(pairs, axis=0)
        print(f"{name:<22} {own:6.2f}x {own / plain:10.2f}", flush=True)


if __name__ == "__main__":
    main()
