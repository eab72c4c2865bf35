"""Beyond an angle the joint is pushed back: an end stop, or a thing that it presses on."""

from __future__ import annotations

from numba import njit

from pianobot_ros.axis.laws.scales import Scales
from pianobot_ros.gap import Effect, Parameter


@njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def law(q: float, angle: float, side: float, stiffness: float, pull: float) -> float:
    """Torque (effort) that holds angle q against a spring beyond `angle` towards `side`, +1 or -1,
    and against the `pull` of its damper; it only pushes.
    """
    beyond = side * (q - angle)
    return side * max(stiffness * beyond + side * pull, 0.0) if beyond > 0.0 else 0.0


def effect(s: Scales) -> Effect:
    """Stiffness (effort per rad), angle (rad) and damping ratio of the joint on it; the side is
    told by the log (`Scales.stop`).
    """
    found = s.stop or {"end_stop": s.stiffness, "end_stop_angle": 0.0}
    stiff, angle = found["end_stop"], found["end_stop_angle"]
    least, most = angle - 0.2 * s.travel, angle + 0.2 * s.travel
    return Effect(
        "end_stop",
        "load",
        [
            Parameter("end_stop", 0.0, 0.0, 30.0 * stiff, f"{s.effort_unit}/{s.unit}", sd=stiff),
            Parameter("end_stop_angle", angle, least, most, "rad", sd=0.03 * s.travel),
            Parameter("end_stop_damping", 0.3, 0.0, 2.0, "1", sd=0.3),
        ],
        [{"end_stop": k * stiff, "end_stop_angle": angle} for k in (1.0, 0.3, 3.0)],
        description="a stop, or a thing that the joint presses on, beyond an angle",
        law=law,
    )
