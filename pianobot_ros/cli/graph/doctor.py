"""`pianobot doctor`: what is missing on this machine, and how to get it."""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.cell.numbers.config import config_dir

__all__ = ["Check", "examine"]

_RENDERS = 60.0  # s that the graphics may take to answer, on a busy machine


@dataclass(frozen=True)
class Check:
    """One thing looked at: ``state`` is ok, missing (something will not work) or limited (something
    works less well).
    """

    name: str
    state: str
    detail: str
    remedy: str = ""

    def as_dict(self) -> dict[str, str]:
        """The finding as plain data."""
        return asdict(self)


def examine() -> list[Check]:
    """Look at everything that pianobot needs or can use. Never raises: what fails to be examined is
    a finding.
    """
    findings = []
    for look in _LOOKS:
        try:
            findings.append(look())
        except Exception as error:
            findings.append(
                Check(look.__name__.strip("_"), "missing", f"{type(error).__name__}: {error}")
            )
    return findings


def _python() -> Check:
    version = platform.python_version()
    good = (3, 10) <= sys.version_info[:2] <= (3, 13)
    return Check(
        "Python",
        "ok" if good else "missing",
        version,
        "" if good else "install Python 3.10 to 3.13",
    )


def _import(name: str, module: str, remedy: str, state: str = "missing") -> Check:
    try:
        found = importlib.import_module(module)
    except Exception as error:
        return Check(name, state, str(error), remedy)
    return Check(name, "ok", str(getattr(found, "__version__", "importable")))


def _rclpy() -> Check:
    return _import(
        "ROS 2 client library (rclpy)", "rclpy", "run `make install` in the project's directory"
    )


def _messages() -> Check:
    remedy = "run `make install`, or source the workspace that holds pianobot_msgs"
    return _import("pianobot_msgs", "pianobot_msgs.msg", remedy)


def _mujoco() -> Check:
    return _import("MuJoCo", "mujoco", "run `make install`")


def _ur_rtde() -> Check:
    remedy = "run `make install`; on Python 3.13 it is built from source and needs Boost"
    return _import("ur-rtde", "rtde_control", remedy)


def _rtmidi() -> Check:
    remedy = "apt install libasound2; without it MIDI goes over sockets"
    found = _import("python-rtmidi", "rtmidi", remedy, state="limited")
    if found.state != "ok":
        return found
    import rtmidi

    names = {rtmidi.API_LINUX_ALSA: "ALSA", rtmidi.API_UNIX_JACK: "JACK"}
    compiled = ", ".join(names[api] for api in rtmidi.get_compiled_api() if api in names)
    return Check("python-rtmidi", "ok", f"built for {compiled or 'no MIDI system'}")


def _present(name: str, found: str | None, lacking: str, remedy: str) -> Check:
    """Something that one can do without."""
    return Check(name, "ok", found) if found else Check(name, "limited", lacking, remedy)


def _alsa() -> Check:
    found = "/dev/snd/seq" if Path("/dev/snd/seq").exists() else None
    remedy = "a real instrument needs it: modprobe snd-seq"
    return _present("ALSA sequencer", found, "/dev/snd/seq is not there", remedy)


def _jack() -> Check:
    remedy = "apt install jackd2; without it MIDI goes over sockets"
    return _present("JACK server", shutil.which("jackd"), "jackd is not installed", remedy)


def _compiler() -> Check:
    lacking = "needed to rebuild pianobot_msgs only"
    return _present("C++ compiler", shutil.which("c++"), lacking, "apt install g++")


def _rendering() -> Check:
    probe = "import mujoco; mujoco.GLContext(64, 64).make_current()"
    environment = {**os.environ, "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
    remedy = "apt install libegl1; only pictures of the twin need it"
    try:
        run = subprocess.run(
            [sys.executable, "-c", probe],
            capture_output=True,
            env=environment,
            timeout=_RENDERS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return _present("Rendering", None, f"no answer within {_RENDERS:g} s", remedy)
    found = environment["MUJOCO_GL"] if run.returncode == 0 else None
    return _present("Rendering", found, "no OpenGL context", remedy)


def _configuration() -> Check:
    try:
        return Check("Configuration", "ok", str(config_dir()))
    except PianobotError as error:
        return Check(
            "Configuration", "missing", str(error), "run `make install`, or set PIANOBOT_CONFIG"
        )


def _serial_permission() -> Check:
    ports = sorted(str(p) for pattern in ("ttyACM*", "ttyUSB*") for p in Path("/dev").glob(pattern))
    if not ports:
        return Check(
            "Serial ports",
            "limited",
            "no /dev/ttyACM* or /dev/ttyUSB*",
            "plug in the regulator and the FSR reader",
        )
    closed = [p for p in ports if not os.access(p, os.R_OK | os.W_OK)]
    if closed:
        return Check(
            "Serial ports",
            "limited",
            f"no permission for {', '.join(closed)}",
            "add yourself to the group dialout",
        )
    return Check("Serial ports", "ok", ", ".join(ports))


def _ros2_cli() -> Check:
    if path := shutil.which("ros2"):
        return Check("ros2 command", "ok", path)
    return Check(
        "ros2 command",
        "limited",
        "not installed",
        "not needed: `pianobot up` starts the graph without it",
    )


def _disk() -> Check:
    free = shutil.disk_usage(Path.cwd()).free
    state = "ok" if free > 2**30 else "limited"
    return Check(
        "Disk",
        state,
        f"{free / 2**30:.1f} GiB free here",
        "" if state == "ok" else "bags need room: free some",
    )


_LOOKS: tuple[Callable[[], Check], ...] = (
    _python,
    _rclpy,
    _messages,
    _mujoco,
    _ur_rtde,
    _configuration,
    _rtmidi,
    _alsa,
    _jack,
    _serial_permission,
    _rendering,
    _compiler,
    _ros2_cli,
    _disk,
)
