"""The controller: variables, safety, program and arm, one cycle at a time. Knows no sockets."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from pianobot_ros.emulator.wrist.control.outputs import CONSTANT, RuntimeState, output_values
from pianobot_ros.emulator.wrist.control.program import ControlProgram, ProgramError, program_name
from pianobot_ros.emulator.wrist.control.safety import Safety, SafetyMode
from pianobot_ros.emulator.wrist.control.variables import Inputs, Outputs
from pianobot_ros.emulator.wrist.motion.kinematics import Array
from pianobot_ros.emulator.wrist.motion.mover import Motion

__all__ = ["CONTROLLERS", "Controller", "ControllerModel", "PlantPort"]

STOP_DECELERATION = 20.0
"""Deceleration of the tool when the safety system or the watchdog stops the arm, m/s^2; assumed."""


@dataclass(frozen=True)
class ControllerModel:
    """A generation of controllers: software version, cycle rate in Hz, and which arm it drives."""

    version: tuple[int, int, int, int]
    rate: int
    arm: str

    @property
    def e_series(self) -> bool:
        """Whether it is an e-series controller."""
        return self.version[0] >= 5


CONTROLLERS = {
    "cb3": ControllerModel((3, 15, 8, 106339), 125, "UR5"),
    "e-series": ControllerModel((5, 11, 6, 1010327), 500, "UR5e"),
}


class PlantPort(Protocol):
    """The other side of the wrist: gets its motion, gives the force on it."""

    def write_wrist(self, t: float, pose: Array, twist: Array) -> None:
        """Tell the plant where the wrist is; pose and twist (6,), base frame."""

    def read_reaction(self) -> Array:
        """What the keys push on the wrist, (3,), N, base frame."""


class Controller:
    """State of the emulated controller.

    Args:
        model: a key of :data:`CONTROLLERS`.
        motion: the arm.
        safety: the safety state machine.
        plant: the cell's plant, or None to run without one.
        log: gets one line for each event.
    """

    def __init__(
        self,
        model: ControllerModel,
        motion: Motion,
        safety: Safety,
        plant: PlantPort | None,
        log: Callable[[str], None],
    ) -> None:
        self.model, self.motion, self.safety = model, motion, safety
        self.dt = 1.0 / model.rate
        self.outputs = Outputs(model.e_series)
        self.inputs = Inputs()
        self.program: ControlProgram | None = None
        self.paused = False
        self.slider = 1.0
        self.events: Counter[str] = Counter()
        self._plant = plant
        self._log = log
        self._time = 0.0
        self._last_kick = 0.0
        self._no_force = np.zeros(3)
        self.outputs.values.update(CONSTANT)
        self._renew_outputs()

    # Programs.

    @property
    def runtime_state(self) -> RuntimeState:
        """What the program is doing."""
        if self.program is None:
            return RuntimeState.STOPPED
        return RuntimeState.PAUSED if self.paused else RuntimeState.PLAYING

    def load_script(self, text: str) -> None:
        """A script arrived: it replaces the running program, and runs if it is the control script
        and the arm is ready.
        """
        name = program_name(text)
        self.stop_program("replaced by another script")
        if name != "rtde_control":
            self._log(f"script '{name}' is not emulated: ignored")
        elif not self.safety.ready:
            self._log(
                f"script '{name}' not started: {self.safety.mode.name}, {self.safety.robot.name}"
            )
        else:
            self.program = ControlProgram(
                text,
                inputs=self.inputs.values,
                outputs=self.outputs.values,
                motion=self.motion,
                dt=self.dt,
                protective_stop=self._script_protective_stop,
            )
            self.paused = False
            self.events["program_start"] += 1
            self._log(f"program '{name}' started")

    def stop_program(self, reason: str) -> None:
        """End the running program; a moving arm brakes."""
        if self.program is not None:
            self._log(f"program stopped: {reason}")
            self.events["program_stop"] += 1
            self.program, self.paused = None, False
            self._brake()

    def pause(self) -> None:
        """Pause the program; a moving arm brakes."""
        if self.program is not None and not self.paused:
            self.paused = True
            self._brake()

    def play(self) -> bool:
        """Continue a paused program; False if there is none or the arm is not ready."""
        if self.program is None or not self.safety.ready:
            return False
        self.paused = False
        return True

    def _brake(self) -> None:
        if self.motion.mode != "hold" and not self.motion.mode.startswith("stop"):
            self.motion.stop_tool(STOP_DECELERATION)

    # Safety.

    def protective_stop(self, reason: str) -> None:
        """Stop the arm and pause the program."""
        if self.safety.mode is SafetyMode.NORMAL:
            self._log(f"protective stop: {reason}")
            self.events["protective_stop"] += 1
            self.safety.protective_stop(time.monotonic(), reason)
            self.pause()
            self._brake()

    def emergency_stop(self) -> None:
        """Stop the arm, end the program, cut the power."""
        self._log("emergency stop")
        self.events["emergency_stop"] += 1
        self.stop_program("emergency stop")
        self._brake()
        self.safety.emergency_stop()

    def _script_protective_stop(self) -> None:
        self.protective_stop("asked for by the program")

    # One cycle.

    def input_written(self, names: tuple[str, ...], now: float) -> None:
        """Note that a client wrote these inputs, for the watchdog."""
        if self.program is not None and self.program.watched in names:
            self._last_kick = now

    def tick(self, now: float) -> None:
        """First half of a cycle: run the program on the newest inputs and renew the outputs.

        ``now`` is monotonic time, s. The outputs hold the arm as it is now and the target that the
        program has just set.
        """
        self._time += self.dt
        self.safety.tick(now)
        self._apply_slider()
        if self.program is not None and not self.paused:
            self._run_program(self.program, now)
        self._renew_outputs()

    def advance(self, now: float) -> None:
        """Second half of a cycle, after the outputs were sent: move the arm to where it is one
        cycle after ``now``.
        """
        force = self._plant.read_reaction() if self._plant is not None else self._no_force
        fault = self.motion.step(self.dt, force, self.slider)
        if fault is not None:
            self.protective_stop(fault)
        if self._plant is not None:
            self._plant.write_wrist(now + self.dt, self.motion.pose, self.motion.twist)

    def _run_program(self, program: ControlProgram, now: float) -> None:
        if program.watchdog is None:
            self._last_kick = now
        elif now - self._last_kick > program.watchdog:
            self.events["watchdog"] += 1
            self.stop_program(f"watchdog: no command for {now - self._last_kick:.3f} s")
            return
        try:
            if not program.cycle():
                self.stop_program("asked for by the client")
        except ProgramError as error:
            self.events["script_error"] += 1
            self.stop_program(f"script error: {error}")

    def _apply_slider(self) -> None:
        if self.inputs.values["speed_slider_mask"] & 1:
            self.slider = min(1.0, max(0.0, float(self.inputs.values["speed_slider_fraction"])))
            self.inputs.values["speed_slider_mask"] = 0

    def _renew_outputs(self) -> None:
        self.outputs.values.update(
            output_values(self._time, self.motion, self.safety, self.runtime_state, self.slider)
        )

    def status(self) -> dict[str, Any]:
        """What the controller is doing, for the fault port."""
        return {
            "time": self._time,
            "program": self.runtime_state.name,
            "mode": self.motion.mode,
            "safety": self.safety.mode.name,
            "robot": self.safety.robot.name,
            "reason": self.safety.reason,
            "slider": self.slider,
            "pose": [round(float(x), 6) for x in self.motion.pose],
            "speed": round(float(np.linalg.norm(self.motion.twist[:3])), 6),
            "commands": dict(self.program.counts) if self.program else {},
            "events": dict(self.events),
        }
