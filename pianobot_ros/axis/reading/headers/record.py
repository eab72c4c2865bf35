"""What one column seems to be."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Meaning:
    """What one column seems to be; `rank` orders columns that seem to be the same (lower wins)."""

    header: str
    quantity: str = "other"
    command: bool = False
    joint: str = ""
    unit: str = ""
    rank: int = 0

    @property
    def role(self) -> str:
        """Role in a log: time, command, position, motor, velocity, effort, error, enable, episode,
        foreign or other.
        """
        if self.command:
            return {"position": "command", "effort": "command effort"}.get(self.quantity, "other")
        return self.quantity
