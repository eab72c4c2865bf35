"""Speed of the twin: ``python benchmarks/twin.py [--markdown FILE] [--json FILE]``. All figures
come from one run.

Factors of real time are on CPU time of one thread. RoboPianist's model is stepped in the same run
where ``robopianist`` can be imported, here or by the interpreter of ``--robopianist PYTHON`` (its
dependencies do not go with ours); its sound output is not needed. Where it cannot, what is
published of it is printed instead.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from pianobot_ros.cell.motion.geometry import keyboard, use_key_preset
from pianobot_ros.cell.motion.strike_motion import StrikeMotion
from pianobot_ros.piano.twin.model.arm import ArmTracker
from pianobot_ros.piano.twin.model.cell_model import TIMESTEP, TwinOptions, build_twin
from pianobot_ros.piano.twin.reduced.strike_geometry import key_model
from pianobot_ros.piano.twin.reduced.strike_model import strike_model
from pianobot_ros.piano.twin.stepping.rollout import (
    BatchJob,
    play,
    play_batch,
    reduced,
    strike_commands,
)
from pianobot_ros.piano.twin.stepping.step_laws import StepLaws

SOFT_TO_STIFF = (2.9, 29.0, 115.0)  # N m/rad: 0.05, 0.5 and 2 N m/deg
MOTION = StrikeMotion(speed=0.15, depth=0.014, hold=0.8)
PRESSURE = -30e3
PUBLISHED = {
    "timestep_s": 0.005,
    "control_s": 0.05,
    "source": (
        "robopianist 1.0.10, suite: physics step 5 ms, control 50 ms; its paper (Zakka et al. 2023)"
        " gives no speed"
    ),
}
PROBE = """
import json, sys, time, types
try:
    import pyaudio
except ImportError:
    sys.modules["pyaudio"] = types.ModuleType("pyaudio")  # plays sound; the model does not need it
import mujoco
from robopianist import suite
env = suite.load("RoboPianist-debug-TwinkleTwinkleLittleStar-v0")
model, data = env.physics.model.ptr, env.physics.data.ptr
def factor(step):
    model.opt.timestep = step
    mujoco.mj_resetData(model, data)
    best, n = 1e9, int(2.0 / step)
    for _ in range(3):
        start = time.process_time()
        mujoco.mj_step(model, data, n)
        best = min(best, time.process_time() - start)
    return n * step / best
own = float(model.opt.timestep)
print("RESULT " + json.dumps({"timestep_s": own, "nv": int(model.nv), "mujoco": mujoco.__version__,
                              "real_time_factor": factor(own),
                               "at_our_step": factor(float(sys.argv[1]))}))
"""


def best(
    action: Callable[[], Any], times: int = 5, clock: Callable[[], float] = time.process_time
) -> float:
    """The shortest of several durations, s."""
    durations = []
    for _ in range(times):
        start = clock()
        action()
        durations.append(clock() - start)
    return min(durations)


def stepping(options: TwinOptions) -> float:
    """Real-time factor of the physics of one strike on one thread, controls given; with the felt of
    keys that have it.
    """
    commands = strike_commands({"middle": 64}, MOTION, pressure=PRESSURE)
    twin = build_twin(options)
    twin.set_pressure([PRESSURE] * 3)
    tracker = ArmTracker(twin.timestep, commands.pose[0])
    start = tracker.joint.copy()
    control, _, _ = tracker.advance(commands.at_steps(twin.timestep))
    data = mujoco.MjData(twin.model)
    laws = StepLaws(twin, data, {})
    acting = laws if laws.acts else None

    def run() -> None:
        mujoco.mj_resetData(twin.model, data)
        data.qpos[:6] = start
        laws.reset()
        u, model = data.ctrl, twin.model
        for row in control:
            u[:6] = row
            if acting:
                acting()
            mujoco.mj_step(model, data)

    return commands.duration / best(run)


def tracking() -> float:
    """CPU time of servo law and inverse kinematics per step, s."""
    targets = strike_commands({"middle": 64}, MOTION).at_steps(TIMESTEP)
    tracker = ArmTracker(TIMESTEP, targets[0])

    def run() -> None:
        tracker.reset(targets[0])
        tracker.advance(targets)

    run()
    return best(run) / len(targets)


def one_finger() -> dict[str, float]:
    """Real-time factor of the compiled one-finger model of the searches, and how far its strike is
    from the whole hand's.
    """
    commands = strike_commands({"middle": 64}, MOTION, pressure=PRESSURE)
    whole = play(commands)
    model = strike_model("middle", 64)
    every = 3
    time_, pose = whole.time[::every], whole.pose[::every]
    given = model.input(time_, pose[:, :3], np.zeros(3), PRESSURE, 0.0, float(time_[-1]))
    stroke = model.strike(given)
    angle, _, force = whole.key(64)
    difference = np.interp(stroke.time, whole.time, force) - stroke.force
    return {
        "one_finger_rtf": commands.duration / best(lambda: model.strike(given)),
        "one_finger_strikes_of_2.5s_per_s": (
            1 / best(lambda: model.strike(given)) * commands.duration / 2.5
        ),
        "one_finger_peak_force_off": float(stroke.force.max() / force.max() - 1),
        "one_finger_peak_angle_off": float(stroke.angle.max() / angle.max() - 1),
        "one_finger_force_rms_off": float(np.sqrt(np.mean(difference**2)) / force.max()),
    }


def convergence() -> dict[str, float]:
    """Largest relative change of V_rel, and of peak force, V_pre and T_hold (T_idle is T_hold
    again), when the step is ten times smaller, on white keys and a black one, soft to stiff.
    """
    found = {"v_rel": 0.0, "others": 0.0}
    for finger, note in (("middle", 64), ("thumb", 60), ("middle", 66)):
        commands = strike_commands({finger: note}, MOTION)
        for stiffness in SOFT_TO_STIFF:
            (coarse,), (fine,) = (
                play(commands, reduced(finger, note, timestep=h), stiffness=stiffness).strokes
                for h in (TIMESTEP, TIMESTEP / 10)
            )
            for n in ("peak_force", "v_pre", "v_rel", "t_hold"):
                change = abs(getattr(coarse, n) / getattr(fine, n) - 1)
                kind = "v_rel" if n == "v_rel" else "others"
                found[kind] = max(found[kind], float(change))
    return found


def by_preset() -> dict[str, float]:
    """Real-time factors of whole hand and one-finger model, and convergence, with every preset of
    the keys.
    """
    found = {}
    for name in keyboard().presets:
        use_key_preset(name)
        key_model.cache_clear()
        strike_model.cache_clear()
        found[f"{name}_rtf"] = stepping(TwinOptions())
        found[f"{name}_one_finger_rtf"] = one_finger()["one_finger_rtf"]
        found |= {f"{name}_{kind}_change": x for kind, x in convergence().items()}
    use_key_preset("paper")
    key_model.cache_clear()
    strike_model.cache_clear()
    return found


def batch(options: TwinOptions | None, count: int) -> float:
    """Strikes of 2.5 s per second on two threads, wall time."""
    commands = strike_commands(
        {"middle": 64}, StrikeMotion(speed=0.15, depth=0.014, hold=1.65), pressure=PRESSURE
    )
    jobs = [BatchJob(commands, k) for k in np.linspace(5.0, 30.0, count)]
    play_batch(jobs[:2], options)
    return float(
        count
        / best(lambda: play_batch(jobs, options), 1, time.perf_counter)
        * (commands.duration / 2.5)
    )


def parameter_changes() -> dict[str, float]:
    """Time to change one finger's stiffness, all fingers' pressure, and all parameters, in place,
    s.
    """
    twin = build_twin()
    names = ("joint_stiffness", "joint_damping", "key_stiffness", "key_damping", "key_inertia")

    def each(change: Callable[[int], None]) -> float:
        def run() -> None:
            for k in range(500):
                change(k)

        return best(run) / 500

    return {
        "stiffness_change_s": each(lambda k: twin.set_stiffness("middle", 5.0 + 0.01 * k)),
        "pressure_change_s": each(lambda k: twin.set_pressure([-50.0 * k] * 3)),
        "parameters_change_s": each(
            lambda k: twin.set_parameters(dict.fromkeys(names, 1.0 + 1e-4 * k))
        ),
    }


def robopianist(python: str) -> dict[str, Any]:
    """RoboPianist's piano with two Shadow hands at its own step and at ours, without a policy."""
    ran = subprocess.run(
        [python, "-W", "ignore", "-c", PROBE, str(TIMESTEP)],
        capture_output=True,
        text=True,
        check=False,
        timeout=150,
    )
    found = [line for line in ran.stdout.splitlines() if line.startswith("RESULT ")]
    if not found:
        why = (ran.stderr.strip().splitlines() or ["no output"])[-1]
        return {"measured": False, "why": why, **PUBLISHED}
    return {"measured": True, **json.loads(found[-1][len("RESULT ") :])}


def markdown(r: dict[str, Any], command: str) -> str:
    """The figures as the page ``docs/results/physics/speed.md``."""
    lines = [
        "# Speed of the twin",
        "",
        f"Made by `{command}` on {r['machine']}; nothing in it is random.",
        "",
        "Factors of real time are on the CPU time of one thread.",
        "",
        "| quantity | measured | wanted |",
        "|---|---|---|",
        *(f"| {quantity} | {value} | {wanted} |" for quantity, value, wanted in _figures(r)),
        "",
        _robopianist(r),
        "",
    ]
    return "\n".join(lines)


def _figures(r: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Quantity, what was measured, what is wanted."""
    return [
        *(
            (
                f"whole hand, 12 keys, arm (32 degrees of freedom), keys `{n}`: real time",
                f"{r[f'{n}_rtf']:.0f} x",
                "20 x",
            )
            for n in keyboard().presets
        ),
        ("the same with one finger and one key", f"{r['reduced_mujoco_rtf']:.0f} x", "-"),
        *(
            (
                f"one-finger model of the searches, keys `{n}`: real time",
                f"{r[f'{n}_one_finger_rtf']:.0f} x",
                "400 x",
            )
            for n in keyboard().presets
        ),
        (
            "its strike against the whole hand's: peak force, peak angle",
            (
                f"{100 * r['one_finger_peak_force_off']:+.2f} %,"
                f" {100 * r['one_finger_peak_angle_off']:+.2f} %"
            ),
            "1 %",
        ),
        ("its force, RMS over peak", f"{100 * r['one_finger_force_rms_off']:.2f} %", "-"),
        *(
            (
                f"a tenth of the step ({1e3 * r['timestep_s']:g} ms) changes peak force, V_pre and"
                f" T_hold (T_idle is T_hold again); V_rel by at most, keys `{n}`",
                f"{100 * r[f'{n}_others_change']:.2f} %; {100 * r[f'{n}_v_rel_change']:.2f} %",
                "1 %; 0.5 %",
            )
            for n in keyboard().presets
        ),
        ("strikes of 2.5 s in batch, whole hand, two threads", f"{r['batch_per_s']:.1f} /s", "-"),
        (
            "strikes of 2.5 s in batch, one finger in MuJoCo, two threads",
            f"{r['batch_reduced_per_s']:.1f} /s",
            "-",
        ),
        (
            "the same, one-finger model of the searches, one thread",
            f"{r['one_finger_strikes_of_2.5s_per_s']:.0f} /s",
            "-",
        ),
        ("change of one finger's stiffness", f"{1e6 * r['stiffness_change_s']:.1f} µs", "100 µs"),
        ("change of the vacuum of all fingers", f"{1e6 * r['pressure_change_s']:.1f} µs", "100 µs"),
        (
            "change of all parameters of twelve keys and their contacts",
            f"{1e6 * r['parameters_change_s']:.1f} µs",
            "100 µs",
        ),
        ("wrist servo and inverse kinematics, per step", f"{1e6 * r['tracking_s']:.1f} µs", "-"),
    ]


def _robopianist(r: dict[str, Any]) -> str:
    """One line about another model of piano and hands."""
    other = r["robopianist"]
    if other["measured"]:
        return (
            f"RoboPianist (two Shadow hands, 88 keys, {other['nv']} degrees of freedom, MuJoCo"
            f" {other['mujoco']}), in the same run: {other['real_time_factor']:.0f} x real time at"
            f" its own step of {1e3 * other['timestep_s']:g} ms, {other['at_our_step']:.1f} x at"
            f" our step of {1e3 * r['timestep_s']:g} ms."
        )
    return f"RoboPianist could not be run ({other['why']}). Published: {other['source']}."


def _command(chosen: argparse.Namespace) -> str:
    other = " --robopianist PYTHON" if chosen.robopianist != sys.executable else ""
    return f"python benchmarks/twin.py --markdown {chosen.markdown}{other}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    parser.add_argument("--markdown", type=Path, help="write them as a page to this file")
    parser.add_argument(
        "--robopianist",
        metavar="PYTHON",
        default=sys.executable,
        help="interpreter that has robopianist",
    )
    chosen = parser.parse_args()
    result: dict[str, Any] = {
        "timestep_s": TIMESTEP,
        "machine": (
            f"{os.cpu_count()} cores ({platform.machine()}), Python {platform.python_version()}, "
            f"MuJoCo {mujoco.__version__}"
        ),
        **by_preset(),
        "reduced_mujoco_rtf": stepping(reduced("middle", 64)),
        **one_finger(),
        "tracking_s": tracking(),
        "batch_per_s": batch(None, 40),
        "batch_reduced_per_s": batch(reduced("middle", 64), 80),
        **parameter_changes(),
        "robopianist": robopianist(chosen.robopianist),
    }
    for name, value in result.items():
        print(f"{name:36} {value:.4g}" if isinstance(value, float) else f"{name:36} {value}")
    if chosen.json:
        chosen.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    if chosen.markdown:
        chosen.markdown.write_text(markdown(result, _command(chosen)), encoding="utf-8")


if __name__ == "__main__":
    main()
