"""What a chart says beside its lines."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from pianobot_ros.piano.view.charts import StageChart
from pianobot_ros.piano.view.tape.tape import StageGaps


class Gui:
    def add_uplot(self, **given: Any) -> Any:
        return SimpleNamespace(**given)


def test_a_stage_that_is_not_measured_now_is_told_where_its_last_value_stays() -> None:
    chart = StageChart(Gui(), 100)
    measured = StageGaps(1.0, 3, {"wrist": 1.0, "hand": 3.5})
    chart.update([measured])
    assert "not measured" not in chart.handle.title
    chart.update([measured, StageGaps(2.0, 6, {"wrist": 1.2, "hand": np.nan})])
    assert chart.handle.title.endswith("hand: not measured now")
    assert chart.handle.data[2].tolist() == [3.5, 3.5]
    chart.update([measured, StageGaps(2.0, 6, {"wrist": 1.2, "hand": 2.0})] * 2)
    assert "not measured" not in chart.handle.title
