"""The control program: what the script that ``ur_rtde`` uploads does on the controller, as a state
machine.

The script's main loop reads a command id from an integer register each cycle. Real-time commands
are processed every cycle and leave 1 (ready) in the answer register; the others run once, leave 2
(done) and wait until the id returns to 0. A command that blocks (a move, a stop) keeps the main
loop, while servo and speed commands run in threads of their own.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np

from pianobot_ros.emulator.wrist.control.registers import Registers
from pianobot_ros.emulator.wrist.motion.joints import JOINT_LIMIT
from pianobot_ros.emulator.wrist.motion.kinematics import Array, from_pose, to_pose
from pianobot_ros.emulator.wrist.motion.mover import Motion

__all__ = ["ControlProgram", "ProgramError", "program_name"]

REAL_TIME = frozenset({6, 9, 10, 11, 24, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71})
STOP_SCRIPT = 255

_NAME = re.compile(r"\s*(?:def|sec)\s+(\w+)\s*\(")
_OFFSET = re.compile(r"reg_offset_int\s*=\s*(?:#[^\n]*\n)?\s*(\d+)")


class ProgramError(Exception):
    """A script error: the program dies."""


def program_name(text: str) -> str | None:
    """Name of the program that a script text defines."""
    match = _NAME.match(text)
    return match.group(1) if match else None


class ControlProgram:
    """One run of the control script.

    Args:
        text: the uploaded script; only its register offset is read.
        inputs, outputs: the controller's variables by name.
        motion: the arm.
        dt: cycle time, s.
        protective_stop: called by the script command of that name.
    """

    def __init__(
        self,
        text: str,
        *,
        inputs: dict[str, Any],
        outputs: dict[str, Any],
        motion: Motion,
        dt: float,
        protective_stop: Callable[[], None],
    ) -> None:
        offset = _OFFSET.search(text)
        self._client = Registers(inputs, outputs, int(offset.group(1)) if offset else 0)
        self.watchdog: float | None = None  # longest allowed time between two commands, s
        self.counts: dict[int, int] = {}
        self._motion, self._dt = motion, dt
        self._protective_stop = protective_stop
        self._executed = False
        self._blocking = False
        self._asynchronous = False
        self._speeding_joints = False
        self._client.ready(1)
        self._client.progress(-1)

    # Main loop.

    @property
    def watched(self) -> str:
        """Name of the input that the watchdog watches."""
        return self._client.command

    def cycle(self) -> bool:
        """One pass of the main loop. False when the program has ended.

        Raises:
            ProgramError: a script error, for instance a pose that has no inverse kinematics.
        """
        if self._asynchronous and not self._motion.busy:
            self._asynchronous = False
            self._client.progress(-1)
        if self._blocking:
            if self._motion.busy:
                return True
            self._blocking = False
            self._client.ready(2)
        command = self._client.integer(0)
        if command in REAL_TIME:
            self._run(command)
            self._client.ready(1)
        elif command == 0:
            self._executed = False
            self._client.ready(1)
        elif not self._executed:
            if command == STOP_SCRIPT:
                return False
            self._executed = True
            self._run(command)
            self._blocking = self._motion.busy and not self._asynchronous
            if not self._blocking:
                self._client.ready(2)
        return True

    def _run(self, command: int) -> None:
        self.counts[command] = self.counts.get(command, 0) + 1
        action = _ACTIONS.get(command)
        if action is not None:
            action(self)

    # Commands. Numbers are those of the script's own table.

    def _inverse(self, pose: Array, near: Array | None = None) -> Array:
        if not np.all(np.isfinite(pose)):
            raise ProgramError("get_inverse_kin: the pose is not a number")
        q = self._motion.kinematics.inverse(
            self._motion.flange_of(pose), self._motion.joints.q if near is None else near
        )
        if q is None:
            raise ProgramError("get_inverse_kin: unable to find an inverse kinematics solution")
        return q

    def _move(self, start: Callable[[], None]) -> None:
        if self._client.integer(1) == 1:
            self._asynchronous = True
            self._client.progress(0)
        start()

    def _move_j(self) -> None:
        q = self._client.doubles()
        self._move(
            lambda: self._motion.move_joints(q, self._client.double(6), self._client.double(7))
        )

    def _move_j_ik(self) -> None:
        q = self._inverse(self._client.doubles())
        self._move(
            lambda: self._motion.move_joints(q, self._client.double(6), self._client.double(7))
        )

    def _move_l(self) -> None:
        pose = self._client.doubles()
        self._inverse(pose)
        self._move(
            lambda: self._motion.move_line(pose, self._client.double(6), self._client.double(7))
        )

    def _move_l_fk(self) -> None:
        pose = to_pose(self._motion.kinematics.forward(self._client.doubles()) @ self._motion.tcp)
        self._move(
            lambda: self._motion.move_line(pose, self._client.double(6), self._client.double(7))
        )

    def _servo_l(self) -> None:
        # Every cycle: the full inverse kinematics would take a tenth of it, and the arm's own
        # tracking finds what is left.
        flange = self._motion.flange_of(self._client.doubles())
        # what is not a number is not in reach either
        if not self._motion.kinematics.in_reach(flange):
            raise ProgramError("get_inverse_kin: unable to find an inverse kinematics solution")
        self._motion.servo_to(flange)

    def _servo_j(self) -> None:
        q = self._client.doubles()
        if not np.all(np.isfinite(q)):
            raise ProgramError("servoj: the joint angles are not numbers")
        self._motion.servo_to(self._motion.kinematics.forward(q))

    def _speed_l(self) -> None:
        self._speeding_joints = False
        self._motion.speed_tool(
            self._client.doubles(), self._client.double(6), self._client.double(7)
        )

    def _speed_j(self) -> None:
        self._speeding_joints = True
        self._motion.speed_joints(
            self._client.doubles(), self._client.double(6), self._client.double(7)
        )

    def _speed_stop(self) -> None:
        if self._speeding_joints:
            self._motion.stop_joints(self._client.double(0))
        else:
            self._motion.stop_tool(self._client.double(0))

    def _servo_stop(self) -> None:
        self._motion.stop_tool(self._client.double(0))

    def _stop(self, joints: bool) -> None:
        if self._asynchronous:  # the move that is being stopped
            self._asynchronous = False
            self._client.progress(-1)
        stop = self._motion.stop_joints if joints else self._motion.stop_tool
        self._move(lambda: stop(self._client.double(0)))

    def _set_payload(self) -> None:
        self._motion.joints.payload = self._client.double(0)
        self._motion.joints.payload_centre = np.array([self._client.double(i) for i in (1, 2, 3)])

    def _set_tcp(self) -> None:
        self._motion.set_tcp(self._client.doubles())

    def _set_watchdog(self) -> None:
        frequency = self._client.double(0)
        self.watchdog = 1.0 / frequency if frequency > 0.0 else None

    def _inverse_kin(self) -> None:
        self._client.answer(self._inverse(self._client.doubles(), self._client.doubles(6)))

    def _has_solution(self) -> None:
        self._client.answer_integer(
            bool(self._motion.kinematics.solutions(self._motion.flange_of(self._client.doubles())))
        )

    def _pose_is_safe(self) -> None:
        self._has_solution()

    def _joints_are_safe(self) -> None:
        self._client.answer_integer(bool(np.max(np.abs(self._client.doubles())) <= JOINT_LIMIT))

    def _forward_kin_of(self) -> None:
        flange = self._motion.kinematics.forward(self._client.doubles())
        self._client.answer(to_pose(flange @ from_pose(self._client.doubles(6))))

    def _step_time(self) -> None:
        self._client.answer(np.array([self._dt]))


def _nothing(_: ControlProgram) -> None:
    """Accepted without effect: force control, teach mode, digital outputs, payload inertia."""


_ACTIONS: dict[int, Callable[[ControlProgram], None]] = {
    1: ControlProgram._move_j,
    2: ControlProgram._move_j_ik,
    3: ControlProgram._move_l,
    4: ControlProgram._move_l_fk,
    9: ControlProgram._speed_j,
    10: ControlProgram._speed_l,
    11: ControlProgram._servo_j,
    15: ControlProgram._speed_stop,
    16: ControlProgram._servo_stop,
    17: ControlProgram._set_payload,
    24: ControlProgram._servo_l,
    26: ControlProgram._step_time,
    27: lambda p: p._client.answer(p._motion.joints.q),
    28: lambda p: p._client.answer(p._motion.joints.q),
    29: ControlProgram._set_tcp,
    30: ControlProgram._inverse_kin,
    31: lambda p: p._protective_stop(),
    33: lambda p: p._stop(joints=False),
    34: lambda p: p._stop(joints=True),
    35: ControlProgram._set_watchdog,
    36: ControlProgram._pose_is_safe,
    37: ControlProgram._joints_are_safe,
    38: lambda p: p._client.answer(p._motion.joints.torque),
    39: lambda p: p._client.answer(
        to_pose(from_pose(p._client.doubles()) @ from_pose(p._client.doubles(6)))
    ),
    40: lambda p: p._client.answer(to_pose(p._motion.tcp)),
    43: lambda p: p._client.answer(to_pose(p._motion.tool)),
    44: ControlProgram._forward_kin_of,
    46: lambda p: p._client.answer(p._inverse(p._client.doubles())),
    47: lambda p: p._client.answer_integer(p._motion.steady),
    58: lambda p: p._client.answer(to_pose(p._motion.flange)),
    60: ControlProgram._has_solution,
    61: ControlProgram._has_solution,
    69: lambda p: p._client.answer(p._motion.joints.qdd),
    99: _nothing,  # kick of the watchdog: its arrival is the point
}
