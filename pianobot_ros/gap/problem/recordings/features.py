"""What a recording offers to lay an unexplained residual beside: what the twin says that it may
depend on, with what drives the machine; else all that was recorded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array, Block, Signal, Twin, usable

__all__ = ["Features", "is_rate", "rate"]

RATE = "rate of "


class Features:
    """The signals that each block offers, with their rates, reckoned once; of those that the twin
    offers it alone says which rates they have. What it failed to say is in `warnings`.
    """

    def __init__(self, twin: Twin, blocks: Sequence[Block]) -> None:
        self._blocks = blocks
        self._offered, self.warnings = _offered(twin, blocks)
        self._drive: dict[int, dict[str, Signal]] = {}
        self._recorded: dict[int, dict[str, Signal]] = {}

    def driving(self, block: int) -> dict[str, Signal]:
        """The inputs of a block, with their rates, beside what the twin offers, if it does, and not
        among that: what drives the machine may always be what a residual depends on.
        """
        if block not in self._drive:
            offered = self._offered[block]
            values = [s.y for s in offered.values()]
            inputs = self._blocks[block].inputs.items() if offered else ()
            beside = {n: s for n, s in inputs if n not in offered and not _among(s, values)}
            self._drive[block] = _with_rates(beside)
        return self._drive[block]

    def beside(self, block: int, signal: str, predicted: Signal) -> dict[str, Signal]:
        """What a block offers to a residual of a `signal`, which is offered itself as `predicted`:
        what was measured holds the residual.
        """
        if self._offered[block]:
            return {**self._offered[block], **self.driving(block)}
        if block not in self._recorded:
            b = self._blocks[block]
            self._recorded[block] = _with_rates({**b.inputs, **b.outputs})
        own = _with_rates({signal: predicted})
        measured = {signal, RATE + signal} - set(own)
        known = {**self._recorded[block], **own}
        return {n: s for n, s in known.items() if n not in measured}


def is_rate(feature: str) -> bool:
    """Whether a feature by its name is a rate."""
    return feature == "velocity" or feature.startswith(RATE)


def _offered(twin: Twin, blocks: Sequence[Block]) -> tuple[list[dict[str, Signal]], list[str]]:
    """What the twin says that an unexplained residual may depend on, by block and name: its samples
    that are numbers. Nothing where it fails to say, and a warning.
    """
    offer = getattr(twin, "features", None)
    if offer is None:
        return [{} for _ in blocks], []
    found, failed = [], []
    for block in blocks:
        try:
            given = dict(offer(block))
        except Exception as error:
            failed.append(f"{block.name}: {type(error).__name__}: {error}")
            given = {}
        for name, s in given.items():
            if not isinstance(s, Signal):
                raise GapError(f"feature {name} is a {type(s).__name__}: give a Signal")
        kept = ((name, s, usable(s)) for name, s in given.items())
        found.append({name: Signal(s.t[k], s.y[k], s.unit) for name, s, k in kept if k.size})
    if not failed:
        return found, []
    return found, [
        f"features failed in {len(failed)} of {len(blocks)} blocks, so what is left is not laid"
        f" beside them there (the last: {failed[-1]})"
    ]


def _among(s: Signal, values: Sequence[Array]) -> bool:
    """Whether a signal's samples that are numbers are one of `values` (n,), whatever its name."""
    own = s.y[usable(s)]
    return any(np.array_equal(own, y) for y in values)


def _with_rates(known: Mapping[str, Signal]) -> dict[str, Signal]:
    """Signals by name, each with its rate, of which there are some numbers."""
    out = {}
    for name, s in known.items():
        if np.isfinite(s.y).sum() > 3:
            out[name] = s
            out[RATE + name] = Signal(s.t, rate(s), f"{s.unit}/s")
    return out


def rate(s: Signal) -> Array:
    """Slope (n,) of a signal at its stamps, smoothed."""
    ok = np.isfinite(s.y)
    t, first = np.unique(s.t[ok], return_index=True)  # in order, each once
    slope = np.gradient(s.y[ok][first], t) if t.size > 1 else np.zeros(1)
    width = max(1, min(5, slope.size // 4))
    slope = np.convolve(
        np.pad(slope, width, "edge"), np.ones(2 * width + 1) / (2 * width + 1), "valid"
    )
    return np.interp(s.t, t, slope)
