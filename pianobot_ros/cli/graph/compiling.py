"""Compile once what the nodes and the diagnosis compute with, so that no phrase waits for it.

Numba keeps what it has compiled beside the sources. On a fresh machine that takes most of a
minute, and every process that needs the same code at the same time compiles it anew.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from pianobot_ros.cell.host.priority import cores

__all__ = ["compile_kernels"]


def _plant() -> None:
    """The emulated cell, recorded and live."""
    from pianobot_ros.emulator.plant.cases.case import Case
    from pianobot_ros.emulator.plant.instruments.pneumatics import RegulatorModel
    from pianobot_ros.emulator.plant.live_plant import LivePlant
    from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
    from pianobot_ros.emulator.serving.bus import PlantBus

    simulate_cell(standard_strikes(1, 1, repeats=1), seed=1)
    with TemporaryDirectory() as folder, PlantBus.create(Path(folder) / "bus") as bus:
        LivePlant(bus, Case()).warm_up()
    RegulatorModel().step(1e-3, (0.0, 0.0, 0.0))


def _arm() -> None:
    """The emulated arm."""
    from pianobot_ros.emulator.wrist.__main__ import build
    from pianobot_ros.emulator.wrist.control.safety import Safety

    build("cb3", None, Safety(0.0, 0.0), lambda _: None)


def _twin() -> None:
    """The running twin with every law of the library."""
    from pianobot_ros.piano.gap.adoption.prepare import prepare_laws

    prepare_laws()


def _strike() -> None:
    """The twin of one finger and one key."""
    import numpy as np

    from pianobot_ros.cell.motion.wrist_poses import wrist_pose
    from pianobot_ros.piano.twin.reduced.strike_model import strike_model

    pose, time = wrist_pose({"middle": 64}), np.arange(0.0, 0.1, 0.002)
    wrist = np.tile(pose.position, (len(time), 1))
    model = strike_model("middle", 64)
    model.strike(model.input(time, wrist, pose.rotation.as_rotvec(), -50e3, 0.0, 0.1))


def _diagnosis() -> None:
    """What else a diagnosis needs: the sensors' filters, the floor, the splices."""
    from pianobot_ros.emulator.plant.offline import simulate_cell, standard_strikes
    from pianobot_ros.piano.gap.diagnosis.diagnose import diagnose_recordings

    commands = standard_strikes(2, 12, repeats=3)
    diagnose_recordings([simulate_cell(commands, effects={"wrist_delay": 8.0})], budget=1)


def _axis() -> None:
    """The twin of another robot's joint, and what its diagnosis needs."""
    import numpy as np

    from pianobot_ros.axis.diagnosis.joint import diagnose_logs
    from pianobot_ros.axis.log import Log

    time = np.arange(0.0, 16.0, 0.01)
    command = 0.5 * np.sin(2.0 * time) + 0.2 * np.sin(5.0 * time)
    position = np.interp(time - 0.05, time, command)
    speed = np.gradient(position, time)
    effort = 0.1 * np.gradient(speed, time) + 0.3 * speed
    diagnose_logs([Log("log", time, command, position, speed, effort, "Nm")], budget=1)


KERNELS: dict[str, Callable[[], None]] = {
    "emulated cell": _plant,
    "emulated arm": _arm,
    "running twin": _twin,
    "strike": _strike,
    "robot joint": _axis,
}


def compile_kernels() -> Iterator[tuple[str, float]]:
    """Compile everything, a process for each core; yields what is done, and s since the start."""
    begun = time.monotonic()
    # Each begins anew: one forked from a process with threads and graphics may end at any moment.
    fresh = get_context("spawn")
    with ProcessPoolExecutor(max_workers=cores(), mp_context=fresh) as pool:
        waiting = {pool.submit(work): name for name, work in KERNELS.items()}
        for done in as_completed(waiting):
            done.result()
            yield waiting[done], time.monotonic() - begun
        # Last: it uses what the others compile.
        pool.submit(_diagnosis).result()
        yield "diagnosis", time.monotonic() - begun
