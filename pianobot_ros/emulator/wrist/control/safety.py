"""Robot mode and safety mode: what the buttons, the safety system and the dashboard do to them.

Numbers as in the RTDE guide (robot_mode, safety_mode, safety_status_bits).
"""

from __future__ import annotations

import enum

__all__ = ["RobotMode", "Safety", "SafetyMode"]


class RobotMode(enum.IntEnum):
    """Power state of the arm."""

    POWER_OFF = 3
    IDLE = 5
    RUNNING = 7


class SafetyMode(enum.IntEnum):
    """State of the safety system."""

    NORMAL = 1
    PROTECTIVE_STOP = 3
    ROBOT_EMERGENCY_STOP = 7


_BITS = {
    SafetyMode.NORMAL: 1 << 0,
    SafetyMode.PROTECTIVE_STOP: 1 << 2 | 1 << 10,
    SafetyMode.ROBOT_EMERGENCY_STOP: 1 << 6 | 1 << 7 | 1 << 10,
}


class Safety:
    """The safety state machine.

    Args:
        unlock_delay: seconds after a protective stop during which the dashboard refuses to unlock
            it; 5 s on a real robot.
        power_time: seconds that powering on and releasing the brakes each take.
    """

    def __init__(self, unlock_delay: float, power_time: float) -> None:
        self.mode = SafetyMode.NORMAL
        self.robot = RobotMode.RUNNING
        self.reason = ""
        self.button_pressed = False
        self._unlock_delay = unlock_delay
        self._power_time = power_time
        self._stopped_at = 0.0
        self._pending: tuple[float, RobotMode] | None = None

    @property
    def ready(self) -> bool:
        """Whether the arm can move."""
        return self.mode is SafetyMode.NORMAL and self.robot is RobotMode.RUNNING

    @property
    def bits(self) -> int:
        """``safety_status_bits``."""
        return _BITS[self.mode]

    def tick(self, now: float) -> None:
        """Finish powering on or releasing the brakes when its time has come."""
        if self._pending is not None and now >= self._pending[0]:
            self.robot = self._pending[1]
            self._pending = None

    def protective_stop(self, now: float, reason: str) -> None:
        """Enter the protective stop."""
        if self.mode is SafetyMode.NORMAL:
            self.mode, self.reason, self._stopped_at = SafetyMode.PROTECTIVE_STOP, reason, now

    def emergency_stop(self) -> None:
        """The button is pressed: motors off."""
        self.button_pressed = True
        self.mode, self.reason = SafetyMode.ROBOT_EMERGENCY_STOP, "emergency stop button"
        self.robot, self._pending = RobotMode.POWER_OFF, None

    def release_button(self) -> None:
        """The button is turned back. The arm stays without power until somebody switches it on."""
        if self.button_pressed:
            self.button_pressed = False
            self.mode = SafetyMode.NORMAL

    def unlock(self, now: float) -> bool:
        """Release a protective stop; False while the robot still refuses to."""
        if self.mode is SafetyMode.PROTECTIVE_STOP:
            if now - self._stopped_at < self._unlock_delay:
                return False
            self.mode = SafetyMode.NORMAL
        return True

    def power_on(self, now: float) -> bool:
        """Switch the motors on; False while the emergency stop is pressed."""
        if self.button_pressed:
            return False
        if self.robot is RobotMode.POWER_OFF:
            self._pending = (now + self._power_time, RobotMode.IDLE)
        return True

    def power_off(self) -> None:
        """Switch the motors off."""
        self.robot, self._pending = RobotMode.POWER_OFF, None

    def release_brakes(self, now: float) -> bool:
        """Release the brakes, powering on first where needed; False while the emergency stop is
        pressed.
        """
        if self.button_pressed:
            return False
        if self.robot is not RobotMode.RUNNING:
            steps = 2 if self.robot is RobotMode.POWER_OFF and self._pending is None else 1
            self._pending = (now + steps * self._power_time, RobotMode.RUNNING)
        return True
