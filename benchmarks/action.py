"""Speed of the piano action: exact reference, MuJoCo, simulated rig and identification, all in one
run.

python benchmarks/action.py [--repeat 5] [--json]
python benchmarks/action.py --coverage 8    how often the 95 % intervals of Table 2 hold the truth,
over seeds
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import mujoco

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from pianobot_ros.piano.action import load_parameters
from pianobot_ros.piano.action.hybrid.action_model import PARTS, build_model
from pianobot_ros.piano.action.hybrid.force_profile import ForceProfile
from pianobot_ros.piano.action.hybrid.simulator import Simulator
from pianobot_ros.piano.action.mujoco.mujoco_hybrid import hybrid_spec
from pianobot_ros.piano.action.results.features import repeated_note
from pianobot_ros.piano.action.results.paper_tables import truth_of
from pianobot_ros.piano.action.rig.transfer_fit import identify_rig
from pianobot_ros.piano.action.rig.voice_coil import run_trial

STEP = ForceProfile.step(4.1)
SPAN = 2.5  # s of simulated time


def best(function: Callable[[], object], repeat: int) -> float:
    """Shortest of ``repeat`` wall-clock times [s], after one run to warm up."""
    function()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def mujoco_run(step: float, integrator: str) -> Callable[[], object]:
    model = hybrid_spec(load_parameters(), step=step, integrator=integrator).compile()

    def run() -> None:
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = 4.1
        mujoco.mj_step(model, data, nstep=round(SPAN / step))

    return run


def coverage(seeds: int) -> float:
    """Share of all intervals of ``seeds`` full identifications that hold the truth."""
    p = load_parameters()
    held = [
        estimate.holds(truth_of(p, name))
        for seed in range(100, 100 + seeds)
        for name, estimate in identify_rig(p, seed=seed).estimates.items()
    ]
    return sum(held) / len(held)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--coverage", type=int, metavar="SEEDS")
    options = parser.parse_args()
    p = load_parameters()
    if options.coverage:
        print(f"{coverage(options.coverage):.1%} of the 95 % intervals hold the truth")
        return
    paper, full = build_model(p), build_model(p, PARTS)
    warm = Simulator(paper), Simulator(full)
    runs: dict[str, tuple[Callable[[], object], float]] = {
        "exact reference, new model": (lambda: Simulator(build_model(p)).run(STEP, SPAN), SPAN),
        "exact reference, model reused": (lambda: warm[0].run(STEP, SPAN), SPAN),
        "exact reference, all parts, model reused": (lambda: warm[1].run(STEP, SPAN), SPAN),
        "repeated note, new model": (lambda: repeated_note(p, lever=True), 0.6),
        "MuJoCo rk4 1 ms": (mujoco_run(1e-3, "rk4"), SPAN),
        "MuJoCo rk4 0.5 ms": (mujoco_run(5e-4, "rk4"), SPAN),
        "MuJoCo implicitfast 0.1 ms": (mujoco_run(1e-4, "implicitfast"), SPAN),
        "rig, 15-minute trial AKWH": (lambda: run_trial(p, "AKWH", seed=0), p.rig.duration),
    }
    results = {name: (best(run, options.repeat), span) for name, (run, span) in runs.items()}
    start = time.perf_counter()
    identify_rig(p, seed=0)
    results["Table 2 from five trials"] = (
        time.perf_counter() - start,
        4 * p.rig.duration + p.rig.rail_trial_duration,
    )
    if options.json:
        print(
            json.dumps(
                {n: {"wall_s": w, "real_time_factor": s / w} for n, (w, s) in results.items()},
                indent=1,
            )
        )
        return
    print(f"{'':42s} {'wall':>10s} {'x real time':>12s}")
    for name, (wall, span) in results.items():
        print(f"{name:42s} {wall * 1e3:8.2f} ms {span / wall:12.0f}")


if __name__ == "__main__":
    main()
