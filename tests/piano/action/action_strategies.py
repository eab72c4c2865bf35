"""Random actions and states within bounds that a piano could have."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from pianobot_ros.piano.action import ActionParameters, load_parameters
from pianobot_ros.piano.action.hybrid.elements import (
    HAMMER,
    HAMMER_VELOCITY,
    KEY,
    KEY_VELOCITY,
    ONE,
    row,
)

BASE = load_parameters()


def scale(low: float = 0.4, high: float = 2.5) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


@st.composite
def actions(draw: Any) -> ActionParameters:
    p = BASE
    for section, fields in {
        "armature": ("mass", "damping", "stiffness"),
        "key": ("mass", "damping"),
        "hammer": ("mass", "coupler_damping", "coupler_stiffness", "bushing_damping", "weight"),
        "front_rail": ("stiffness", "damping"),
    }.items():
        old = getattr(p, section)
        p = p.vary(section, **{f: getattr(old, f) * draw(scale()) for f in fields})
    return p.vary("key", dip=draw(st.floats(0.0095, 0.012)))


@st.composite
def states(draw: Any) -> np.ndarray:
    position, speed = st.floats(-0.002, 0.013), st.floats(-1.0, 1.0)
    return row(
        {
            KEY: draw(position),
            HAMMER: draw(position),
            KEY_VELOCITY: draw(speed),
            HAMMER_VELOCITY: draw(speed),
            ONE: 1.0,
        }
    )
