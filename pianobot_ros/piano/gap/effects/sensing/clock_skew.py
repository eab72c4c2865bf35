"""A device's clock runs at another rate than the host's: its stamps drift away in proportion to the
session's time.

Which device it is, is fitted too: a share for each.
"""

from __future__ import annotations

from pianobot_ros.gap import Effect, Parameter
from pianobot_ros.piano.gap.effects.base import DEVICES, ClockLaw, Values


def _skew(v: Values, device: str) -> float:
    return v[f"clock_skew_{device}"] * v["clock_skew"]


def _only(rate: float, *devices: str) -> dict[str, float]:
    return {"clock_skew": rate} | {f"clock_skew_{d}": float(d in devices) for d in DEVICES}


EFFECT = Effect(
    "clock_skew",
    "clock",
    [
        Parameter("clock_skew", 0.0, -0.02, 0.02, "1", sd=5e-4),
        *(Parameter(f"clock_skew_{d}", 0.0, 0.0, 1.0, "1", sd=0.5) for d in DEVICES),
    ],
    [
        _only(s * rate, *which)
        for rate in (1e-4, 1e-3)
        for s in (1, -1)
        for which in (("midi",), ("fsr",), ("wrist",), DEVICES)
    ],
    description="a device's clock drifts away from the host's",
    law=ClockLaw(_skew),
)
