"""The live stage map's worker: what it practises on is a recording like any other."""

from __future__ import annotations

import numpy as np

from pianobot_ros.cell_gap.live import StageMap, _practice, stage_map


def test_a_worker_practises_on_strikes_that_every_stage_is_judged_by() -> None:
    found = stage_map(_practice())
    assert isinstance(found, StageMap), found
    assert found.strikes == 2
    measured = {name for name, gap, _ in found.stages if np.isfinite(gap)}
    assert measured == {"wrist", "pneumatics", "hand", "contact", "key", "sensing"}
