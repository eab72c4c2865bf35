"""How the engine is set for the piano cell."""

from __future__ import annotations

from pianobot_ros.gap import Calibration, Options

__all__ = ["OPTIONS"]

OPTIONS = Options(calibration=Calibration(temperature=15.0, unknown_left=4.0, unknown_near=0.3))
"""The cell's twin is right to a few thousandths of a signal, so what an effect leaves open says more than elsewhere. Its force
has ten thousand samples, and in a cell without any effect hypotheses still differ by a hundred nats.
"""
