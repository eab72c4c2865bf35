"""When in a session the logs of one joint were made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from pianobot_ros.axis.signals.cleaning import Clean

__all__ = ["in_session"]


def in_session(logs: Sequence[Clean]) -> list[Clean]:
    """The logs with the seconds of the session `before` each: by their clocks where these run on
    from log to log, else as if each began where the one before it ends, since then only their order
    is known.
    """
    lengths = [float(c.t[-1] - c.t[0]) for c in logs]
    spans = sorted((c.log.start, c.log.start + n) for c, n in zip(logs, lengths, strict=True))
    if all(a[1] <= b[0] for a, b in pairwise(spans)):
        before = [c.log.start - spans[0][0] for c in logs]
    else:
        before = (np.cumsum(lengths) - lengths).tolist()
    return [replace(c, before=b) for c, b in zip(logs, before, strict=True)]
