"""What the user says about logs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pianobot_ros.axis.log import ROLES
from pianobot_ros.gap.problem.errors import GapError

__all__ = ["Request"]


@dataclass(frozen=True)
class Request:
    """What the user says about the logs: columns and units by role, and the rate without stamps."""

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    rate: float = 0.0

    def __post_init__(self) -> None:
        for what in (self.columns, self.units):
            for role in what:
                if role not in {*ROLES, "error"}:
                    raise GapError(
                        f"unknown column role {role!r}; valid: {', '.join([*ROLES, 'error'])}"
                    )
