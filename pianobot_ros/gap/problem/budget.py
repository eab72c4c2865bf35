"""What a diagnosis may use and has used: so many simulated blocks, so that the same data get the
same answer on any machine, however busy it is.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

BLOCKS = 40_000
"""Simulated blocks: a thousand predictions of 40 strikes, enough to fit a library of 30 effects and
the pairs of the best; about half a minute of one core for the piano cell."""
LIMIT = 1800.0
"""s of wall time: an emergency brake, far from what the budget takes."""


class Budget:
    """The meter: `spent` of the simulated `blocks`, the `calls` and `failures` of the twin with
    what the last one said, and the emergency brake, which has `struck` or not. Started when made.
    """

    def __init__(self, blocks: int = BLOCKS, limit: float = LIMIT) -> None:
        self.blocks, self.limit, self._whole = blocks, limit, blocks
        self.spent = self.calls = self.failures = 0
        self.last_failure = ""
        self.struck = False
        self._start = time.monotonic()

    def spend(self, calls: int, blocks: int) -> None:
        """Note so many simulations of so many blocks each."""
        self.calls += calls
        self.spent += calls * blocks

    def renew(self) -> None:
        """Allow as much once more, for a search that begins anew."""
        self.blocks = self.spent + self._whole

    def failed(self, why: object, effects: Sequence[str] = ()) -> None:
        """Note a simulation, with these effects, that failed."""
        beside = f", with {' and '.join(effects)}" if effects else ""
        self.failures += 1
        self.last_failure = f"{why}{beside}"

    def allows(self, blocks: int) -> bool:
        """Whether so many more blocks may be simulated."""
        self.struck = self.struck or self.elapsed() > self.limit
        return not self.struck and self.spent + blocks <= self.blocks

    def elapsed(self) -> float:
        """Wall seconds since the start: for the report, and the brake; nothing else is decided by
        it."""
        return time.monotonic() - self._start
