"""Brings the arm back after a protective stop, a released emergency stop, or the death of its program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

__all__ = ["Dashboard", "Outcome", "Recovery"]

_STEP_PERIOD = 0.25  # s between two dashboard commands
_UNLOCK_LIMIT = 9.0  # s; the robot refuses to unlock during the first 5 s
_POWER_LIMIT = 30.0  # s for power-on and brake release

_NORMAL, _REDUCED, _PROTECTIVE_STOP = 1, 2, 3
_POWERED = (4, 5)  # power on, idle
_RUNNING = 7
_HOPELESS = {
    4: "the robot is in recovery mode: move it back into its limits on the pendant, then recover again",
    5: "safeguard stop: close the safeguard, then recover again",
    6: "emergency stop: release the button, then recover again",
    7: "emergency stop: release the button, then recover again",
    8: "safety violation: restart the safety system on the pendant",
    9: "safety fault: restart the safety system on the pendant",
}


class Dashboard(Protocol):
    """The commands needed of the dashboard client; each raises RuntimeError if the robot refuses."""

    def closeSafetyPopup(self) -> None: ...  # noqa: N802, D102
    def unlockProtectiveStop(self) -> None: ...  # noqa: N802, D102
    def powerOn(self) -> None: ...  # noqa: N802, D102
    def brakeRelease(self) -> None: ...  # noqa: N802, D102
    def disconnect(self) -> None: ...  # noqa: D102


@dataclass(frozen=True)
class Outcome:
    """Whether the arm obeys again, and one line that says so or why not."""

    ok: bool
    message: str


class Recovery:
    """One recovery, a step at a time, so that the state keeps flowing meanwhile.

    Args:
        dashboard: opens a connection to the dashboard.
        start_control: uploads and starts the control program.
        now: monotonic time, s.
    """

    def __init__(self, dashboard: Callable[[], Dashboard], start_control: Callable[[], None], now: float) -> None:
        self._open, self._start_control = dashboard, start_control
        self._dashboard: Dashboard | None = None
        self._begun, self._next = now, now
        self._done: list[str] = []
        self._last_refusal = ""

    def step(self, now: float, safety_mode: int, robot_mode: int, *, program_running: bool) -> Outcome | None:
        """Do the next thing; an outcome when there is nothing left to do."""
        if now < self._next:
            return None
        self._next = now + _STEP_PERIOD
        try:
            outcome = self._advance(now, safety_mode, robot_mode, program_running)
        except RuntimeError as error:
            outcome = Outcome(ok=False, message=f"recovery failed: {' '.join(str(error).split())}")
        if outcome is not None and self._dashboard is not None:
            self._dashboard.disconnect()
        return outcome

    def _advance(self, now: float, safety: int, robot: int, program_running: bool) -> Outcome | None:
        if safety in _HOPELESS:
            return Outcome(ok=False, message=_HOPELESS[safety])
        if self._dashboard is None:
            self._dashboard = self._open()
        if safety == _PROTECTIVE_STOP:
            return self._unlock(self._dashboard, now)
        if robot != _RUNNING:
            return self._power(self._dashboard, now, robot)
        if not program_running:
            self._start_control()
            self._done.append("control program started")
        return Outcome(ok=True, message=", ".join(self._done) or "nothing to recover: the arm is ready")

    def _unlock(self, dashboard: Dashboard, now: float) -> Outcome | None:
        if now - self._begun > _UNLOCK_LIMIT:
            return Outcome(ok=False, message=f"the protective stop cannot be unlocked: {self._last_refusal}")
        try:
            dashboard.closeSafetyPopup()
            dashboard.unlockProtectiveStop()
            self._note("protective stop unlocked")
        except RuntimeError as error:
            self._last_refusal = " ".join(str(error).split())
        return None

    def _power(self, dashboard: Dashboard, now: float, robot: int) -> Outcome | None:
        if now - self._begun > _POWER_LIMIT:
            return Outcome(ok=False, message="the robot did not power up: look at the pendant")
        if robot in _POWERED:
            self._once("brakes released", dashboard.brakeRelease)
        else:
            self._once("motors switched on", dashboard.powerOn)
        return None

    def _once(self, what: str, action: Callable[[], None]) -> None:
        if what not in self._done:
            action()
            self._done.append(what)

    def _note(self, what: str) -> None:
        if what not in self._done:
            self._done.append(what)
