"""The piano action: linear models and frequency response, the voice-coil rig, the hybrid model, and
its MuJoCo twin.
"""

from __future__ import annotations

from pianobot_ros.piano.action.parameters import ActionParameters, load_parameters

__all__ = ["ActionParameters", "load_parameters"]
