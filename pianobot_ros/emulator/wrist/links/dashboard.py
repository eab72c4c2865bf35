"""The dashboard server: one text command a line, one line back.

Source: Universal Robots, "Dashboard Server CB-Series" and "Dashboard Server e-Series".
"""

from __future__ import annotations

from collections.abc import Callable

from pianobot_ros.emulator.wrist.control.controller import Controller
from pianobot_ros.emulator.wrist.control.outputs import RuntimeState
from pianobot_ros.emulator.wrist.control.safety import RobotMode, SafetyMode

__all__ = ["BANNER", "BUSY", "answer"]

BANNER = b"Connected: Universal Robots Dashboard Server\n"
BUSY = b"Refused: as many clients as allowed are connected to the Dashboard Server\n"

_PROGRAM = "rtde_control.urp"


def answer(line: str, controller: Controller, now: float) -> str:
    """The answer to one command; ``now`` is monotonic time, s."""
    words = line.strip()
    action = _COMMANDS.get(words.lower())
    if action is not None:
        return action(controller, now)
    lowered = words.lower()
    if lowered.startswith("popup "):
        return "showing popup"
    if lowered.startswith("addtolog "):
        return "Added log message"
    if lowered.startswith("load "):
        return f"File not found: {words[5:]}"
    return f"could not understand: '{words}'"


def _version(controller: Controller, _: float) -> str:
    return f"URSoftware {'.'.join(map(str, controller.model.version))} (Jan 01 2022)"


def _play(controller: Controller, _: float) -> str:
    return "Starting program" if controller.play() else "Failed to execute: play"


def _stop(controller: Controller, _: float) -> str:
    controller.stop_program("stopped from the dashboard")
    return "Stopped"


def _pause(controller: Controller, _: float) -> str:
    if controller.runtime_state is not RuntimeState.PLAYING:
        return "Failed to execute: pause"
    controller.pause()
    return "Pausing program"


def _running(controller: Controller, _: float) -> str:
    return f"Program running: {str(controller.runtime_state is RuntimeState.PLAYING).lower()}"


def _program_state(controller: Controller, _: float) -> str:
    return f"{controller.runtime_state.name} {_PROGRAM}"


def _robot_mode(controller: Controller, _: float) -> str:
    return f"Robotmode: {controller.safety.robot.name}"


def _safety_mode(controller: Controller, _: float) -> str:
    return f"Safetymode: {controller.safety.mode.name}"


def _safety_status(controller: Controller, _: float) -> str:
    return f"Safetystatus: {controller.safety.mode.name}"


def _unlock(controller: Controller, now: float) -> str:
    if controller.safety.unlock(now):
        return "Protective stop releasing"
    return (
        "Cannot unlock protective stop until 5s after occurrence. Always inspect cause of"
        " protective stop before unlocking"
    )


def _close_safety_popup(controller: Controller, _: float) -> str:
    return (
        "closing safety popup"
        if controller.safety.mode is not SafetyMode.PROTECTIVE_STOP
        else "closing popup"
    )


def _power_on(controller: Controller, now: float) -> str:
    return (
        "Powering on"
        if controller.safety.power_on(now)
        else "Failed to power on: emergency stop is pressed"
    )


def _power_off(controller: Controller, _: float) -> str:
    controller.stop_program("power off")
    controller.safety.power_off()
    return "Powering off"


def _brake_release(controller: Controller, now: float) -> str:
    if controller.safety.release_brakes(now):
        return "Brake releasing"
    return "Failed to release the brakes: emergency stop is pressed"


def _restart_safety(controller: Controller, now: float) -> str:
    if not controller.safety.button_pressed:
        controller.safety.mode = SafetyMode.NORMAL
        controller.safety.robot = RobotMode.POWER_OFF
    return "Restarting safety"


_COMMANDS: dict[str, Callable[[Controller, float], str]] = {
    "polyscopeversion": _version,
    "version": lambda c, _: ".".join(map(str, c.model.version)),
    "get robot model": lambda c, _: c.model.arm[:3],
    "get serial number": lambda c, _: "20215300001" if c.model.e_series else "20165300001",
    "is in remote control": lambda c, _: "true",
    "play": _play,
    "stop": _stop,
    "pause": _pause,
    "running": _running,
    "programstate": _program_state,
    "get loaded program": lambda c, _: f"Loaded program: {_PROGRAM}",
    "isprogramsaved": lambda c, _: f"true {_PROGRAM}",
    "robotmode": _robot_mode,
    "safetymode": _safety_mode,
    "safetystatus": _safety_status,
    "unlock protective stop": _unlock,
    "close safety popup": _close_safety_popup,
    "close popup": lambda c, _: "closing popup",
    "power on": _power_on,
    "power off": _power_off,
    "brake release": _brake_release,
    "restart safety": _restart_safety,
    "shutdown": lambda c, _: "Shutting down",
}
