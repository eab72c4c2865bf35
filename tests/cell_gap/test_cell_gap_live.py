"""The live stage map's worker: what it practises on is a recording like any other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pianobot_ros.cell.recording import Signal
from pianobot_ros.cell_gap.live import StageMap, _practice, stage_map


def test_a_worker_practises_on_strikes_that_every_stage_is_judged_by() -> None:
    found = stage_map(_practice())
    assert isinstance(found, StageMap), found
    assert found.strikes == 2
    measured = {name for name, gap, _ in found.stages if np.isfinite(gap)}
    assert measured == {"wrist", "pneumatics", "hand", "contact", "key", "sensing"}


@pytest.mark.parametrize("still", ["fsr", "real/wrist", "real/vacuum", "key_angle", ""])
@pytest.mark.parametrize("count", [1, 2])
def test_strikes_in_which_a_device_says_nothing_new_have_a_map(still: str, count: int) -> None:
    """A finger may miss its key and a sensor may hang: constant signals, or no note, end nothing."""
    practice = _practice()
    signals = {
        name: Signal(
            x.time,
            0.0 * x.value if "fsr" in name or "angle" in name else np.repeat(x.value[:1], len(x.time), 0),
            x.unit,
        )
        if still in name
        else x
        for name, x in practice.signals.items()
    }
    found = stage_map(replace(practice, signals=signals, notes={"real": []}, strikes=practice.strikes[:count]))
    assert isinstance(found, StageMap), found
    assert all(gap >= 0 for _, gap, _ in found.stages if np.isfinite(gap))
