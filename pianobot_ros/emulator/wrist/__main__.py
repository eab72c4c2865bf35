"""``python -m pianobot_ros.emulator.wrist``: the emulated UR controller as a process of its own."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.motion.limits import MountConfig
from pianobot_ros.cell.numbers.config import load_section
from pianobot_ros.cell.numbers.nominal import wrist_servo
from pianobot_ros.emulator.plant.instruments.arm_servo import ArmModel
from pianobot_ros.emulator.serving.bus import PlantBus
from pianobot_ros.emulator.wrist.control.controller import CONTROLLERS, Controller
from pianobot_ros.emulator.wrist.control.safety import Safety
from pianobot_ros.emulator.wrist.links.server import ControllerServer
from pianobot_ros.emulator.wrist.motion.joints import Joints
from pianobot_ros.emulator.wrist.motion.kinematics import MODELS, Kinematics, transform
from pianobot_ros.emulator.wrist.motion.mover import Motion, Mount, ServoModel

__all__ = ["main"]

# Elbow up: the configuration in which the arm plays.
_NEAR = np.array([-2.0, -1.6, 2.0, 1.2, 1.57, 2.7])


def build(
    model: str, bus: PlantBus | None, safety: Safety, log: Callable[[str], None]
) -> Controller:
    """The controller of a model (``cb3`` or ``e-series``) with its arm at home, on a plant or
    alone.

    Raises:
        PianobotError: the home position is out of the arm's reach.
    """
    config = load_section("wrist.yaml", MountConfig, "mount")
    kind = CONTROLLERS[model]
    kinematics = Kinematics(MODELS[kind.arm])
    mount = Mount(transform(np.array(config.rotation)), np.array(config.tcp_offset))
    wrist = np.array([*config.home, 0.0, 0.0, 0.0])
    q = kinematics.inverse(mount.flange(wrist), _NEAR)
    if q is None:
        raise PianobotError(
            f"the home position {config.home} in wrist.yaml is out of the {kind.arm}'s reach"
        )
    arm = ArmModel(wrist) if bus is None else ArmModel.from_bus(wrist, bus)
    nominal = wrist_servo()
    servo = ServoModel(nominal.natural_frequency, nominal.damping_ratio)
    tcp = np.array([*config.tcp_offset, 0.0, 0.0, 0.0])
    joints = Joints(kinematics, q, config.payload, np.array(config.payload_centre))
    motion = Motion(arm, servo, joints, mount, tcp)
    controller = Controller(kind, motion, safety, bus, log)
    controller.advance(
        time.monotonic()
    )  # the first step imports and compiles; it must not make the first cycle late
    return controller


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(
        prog="python -m pianobot_ros.emulator.wrist", description=__doc__
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="loopback address to listen on (default %(default)s)"
    )
    parser.add_argument(
        "--model",
        choices=sorted(CONTROLLERS),
        default="cb3",
        help="controller (default %(default)s)",
    )
    parser.add_argument(
        "--bus", help="shared memory of the emulated cell; without it the arm moves alone"
    )
    parser.add_argument(
        "--faults", metavar="ENDPOINT", help="control socket, udp:127.x.y.z:PORT or unix:PATH"
    )
    parser.add_argument(
        "--log", type=Path, metavar="FILE", help="write the motion as CSV, one line a cycle"
    )
    parser.add_argument(
        "--unlock-delay",
        type=float,
        default=5.0,
        help="s after which a protective stop can be unlocked",
    )
    parser.add_argument(
        "--power-time", type=float, default=1.0, help="s that power-on and brake release each take"
    )
    options = parser.parse_args(arguments)

    def log(text: str) -> None:
        print(f"[ur {options.host} {time.monotonic():.3f}] {text}", file=sys.stderr, flush=True)

    with contextlib.ExitStack() as stack:
        try:
            if not options.host.startswith("127."):
                raise PianobotError(
                    f"--host {options.host} is not a loopback address; use 127.x.y.z"
                )
            bus = stack.enter_context(PlantBus.attach(options.bus)) if options.bus else None
            motion_log = stack.enter_context(options.log.open("w")) if options.log else None
            controller = build(
                options.model, bus, Safety(options.unlock_delay, options.power_time), log
            )
            server = ControllerServer(options.host, controller, log, options.faults, motion_log)
        except (PianobotError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: setattr(server, "stopping", True))
        version = ".".join(map(str, controller.model.version))
        log(f"{controller.model.arm} with controller {version} at {controller.model.rate} Hz ready")
        server.run((lambda: bus.stop_requested) if bus is not None else (lambda: False))
    return 0


if __name__ == "__main__":
    sys.exit(main())
