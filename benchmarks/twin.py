"""Speed of the twin: ``python benchmarks/twin.py [--json FILE]``. All figures come from one run, on CPU time where marked.

RoboPianist's model is stepped in the same run if the package ``robopianist`` is installed.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from pianobot_ros.cell.motion import StrikeMotion
from pianobot_ros.twin.arm import ArmTracker
from pianobot_ros.twin.model import TIMESTEP, TwinOptions, build_twin
from pianobot_ros.twin.rollout import Job, play_batch, reduced, strike_commands

MOTION = StrikeMotion(speed=0.15, depth=0.014, hold=0.8)


def best(action: Callable[[], Any], times: int = 5, clock: Callable[[], float] = time.process_time) -> float:
    """The shortest of several durations, s."""
    durations = []
    for _ in range(times):
        start = clock()
        action()
        durations.append(clock() - start)
    return min(durations)


def stepping(options: TwinOptions) -> float:
    """Real-time factor of the physics of one strike on one thread, controls given."""
    commands = strike_commands({"middle": 64}, MOTION, pressure=-30e3)
    twin = build_twin(options)
    tracker = ArmTracker(twin.timestep, commands.pose[0])
    start = tracker.joint.copy()
    control, _, _ = tracker.advance(commands.targets(twin.timestep))
    data = mujoco.MjData(twin.model)

    def run() -> None:
        mujoco.mj_resetData(twin.model, data)
        data.qpos[:6] = start
        u, model = data.ctrl, twin.model
        for row in control:
            u[:6] = row
            mujoco.mj_step(model, data)

    return commands.duration / best(run)


def tracking() -> float:
    """CPU time of servo law and inverse kinematics per step, s."""
    targets = strike_commands({"middle": 64}, MOTION).targets(TIMESTEP)
    tracker = ArmTracker(TIMESTEP, targets[0])

    def run() -> None:
        tracker.reset(targets[0])
        tracker.advance(targets)

    run()
    return best(run) / len(targets)


def numba_strike() -> float | None:
    """Real-time factor of the compiled one-finger model of the searches."""
    try:
        from pianobot_ros.twin.strike import strike_model
    except ImportError:
        return None
    commands = strike_commands({"middle": 64}, MOTION)
    model = strike_model("middle", 64)
    given = model.input(commands.time, commands.pose[:, :3], np.zeros(3), -30e3, 0.0, commands.duration)
    model.strike(given)
    return commands.duration / best(lambda: model.strike(given))


def batch(count: int = 40) -> float:
    """Strikes of 2.5 s per second on two threads, wall time, whole hand."""
    commands = strike_commands({"middle": 64}, StrikeMotion(speed=0.15, depth=0.014, hold=1.65))
    jobs = [Job(commands, k) for k in np.linspace(5.0, 30.0, count)]
    return count / best(lambda: play_batch(jobs), 1, time.perf_counter) * (commands.duration / 2.5)


def parameter_change() -> float:
    """Time to set one finger's stiffness in place, s."""
    twin = build_twin()

    def run() -> None:
        for k in range(1000):
            twin.set_stiffness("middle", 5.0 + 0.01 * k)

    return best(run) / 1000


def pressure_change() -> float:
    """Time to set the stiffness of all fingers from pressure, s."""
    twin = build_twin()

    def run() -> None:
        for k in range(1000):
            twin.set_pressure([-50.0 * k] * 3)

    return best(run) / 1000


def robopianist() -> dict[str, Any]:
    """RoboPianist's piano with two Shadow hands at its own step, no policy."""
    try:
        from robopianist import suite  # type: ignore[import-not-found]
    except ImportError as error:
        return {"installed": False, "why": str(error)}
    env = suite.load("RoboPianist-debug-TwinkleTwinkleLittleStar-v0")
    physics = env.physics
    model, data = physics.model.ptr, physics.data.ptr
    steps = 400
    factor = steps * model.opt.timestep / best(lambda: mujoco.mj_step(model, data, steps), 3)
    return {"installed": True, "real_time_factor": factor, "timestep_s": model.opt.timestep, "nv": int(model.nv)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    chosen = parser.parse_args()
    result: dict[str, Any] = {
        "timestep_s": TIMESTEP,
        "whole_hand_rtf": stepping(TwinOptions()),
        "reduced_mujoco_rtf": stepping(reduced("middle", 64)),
        "reduced_numba_rtf": numba_strike(),
        "tracking_us_per_step": 1e6 * tracking(),
        "batch_strikes_of_2.5s_per_s": batch(),
        "stiffness_change_us": 1e6 * parameter_change(),
        "pressure_change_us": 1e6 * pressure_change(),
        "robopianist": robopianist(),
    }
    for name, value in result.items():
        print(f"{name:32} {value:.4g}" if isinstance(value, float) else f"{name:32} {value}")
    if chosen.json:
        chosen.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
