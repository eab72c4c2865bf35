"""What stands in for samples that were not measured: a signal that stopped for a while is bridged
by whoever splices it in, and no bridge is the motion that there was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pianobot_ros.gap.problem.types import Array, Block, Signal, usable

__all__ = ["bridged_two_ways"]


def bridged_two_ways(blocks: Sequence[Block]) -> tuple[dict[int, Block], dict[int, Block]]:
    """The blocks, by index, of which outputs have samples that are no numbers: with straight lines
    in their place, and with what these may miss. Where what is predicted differs between the two,
    it rests on what was not measured.
    """
    lines: dict[int, Block] = {}
    others: dict[int, Block] = {}
    for k, block in enumerate(blocks):
        plain, bent = dict(block.outputs), dict(block.outputs)
        for name, s in block.outputs.items():
            known = usable(s)
            if 2 < known.size < s.y.size:
                y = np.interp(s.t, s.t[known], s.y[known])
                plain[name] = Signal(s.t, y, s.unit)
                bent[name] = Signal(s.t, y + _missed(s, known, y), s.unit)
                lines[k] = replace(block, outputs=plain)
                others[k] = replace(block, outputs=bent)
    return lines, others


def _missed(s: Signal, known: np.ndarray, y: Array) -> Array:
    """What straight lines `y` (n,) may miss in the gaps of a signal (n,): a bow, up and down in
    turn, as high as the signal bows (RMS) over as many of its samples elsewhere.
    """
    out, sign = np.zeros(y.size), 1.0
    for a, b in zip(known[:-1].tolist(), known[1:].tolist(), strict=True):
        if b > a + 1:
            half = max(1, min((b - a) // 2, (y.size - 1) // 2))
            bow = y[half:-half] - 0.5 * (y[: -2 * half] + y[2 * half :])
            x = (np.arange(a, b) - a) / (b - a)
            out[a:b] = sign * float(np.sqrt(np.mean(bow**2))) * 4.0 * x * (1.0 - x)
            sign = -sign
    return out
