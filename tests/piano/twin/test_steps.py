"""However many steps are done at once, the same compiled code does them."""

from __future__ import annotations

import numpy as np

from pianobot_ros.piano.twin.model import arm
from pianobot_ros.piano.twin.model.cell_model import TwinOptions
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin


def test_single_steps_compile_nothing_and_lead_to_the_same_place() -> None:
    one, many = CellTwin(TwinOptions()), CellTwin(TwinOptions())
    many.step(10)
    known = len(arm._track.signatures)
    for _ in range(10):
        one.step(1)
    assert len(arm._track.signatures) == known, (
        "a twin that keeps real time must not stop to compile"
    )
    assert one.time == many.time and np.allclose(one.data.qpos, many.data.qpos, atol=1e-12)
