"""Which robots there are, and by which laws of the plant their cases act. Sizes, signs and noise
come from the seeds (`drawing.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from foreign_robots.air import air_plant
from foreign_robots.air.air_twin import CylinderTwin
from foreign_robots.arm import arm_plant
from foreign_robots.arm.arm_twin import ArmTwin
from foreign_robots.cart import cart_plant
from foreign_robots.cart.cart_twin import CartTwin
from foreign_robots.prop import prop_plant
from foreign_robots.prop.prop_twin import PropellerTwin
from foreign_robots.size_in_floors import Robot

Kind = Literal["effect", "none", "parameters", "unknown", "pair"]

# Seeds hold a robot's place in here.
ROBOTS = {
    "arm": Robot(ArmTwin, arm_plant.LAWS, arm_plant.record),
    "cart": Robot(CartTwin, cart_plant.LAWS, cart_plant.record),
    "air": Robot(CylinderTwin, air_plant.LAWS, air_plant.record),
    "prop": Robot(PropellerTwin, prop_plant.LAWS, prop_plant.record),
}
SETS = ("dev", "held", "second", "third")
# Of the cases of nothing in the library and nothing outside of it: none, or wrong parameters only.
WITHOUT_LAW = 3


class CasePlan(NamedTuple):
    """What kind of case, and by which laws of the plant."""

    kind: Kind
    laws: tuple[str, ...] = ()


def plans(
    effects: Sequence[str], unknown: Sequence[str], pair: tuple[str, str], nones: int
) -> list[CasePlan]:
    """A robot's cases: one effect each, none, wrong parameters, outside of the library, two."""
    return [
        *(CasePlan("effect", (law,)) for law in effects),
        *(CasePlan("none") for _ in range(nones)),
        *(CasePlan("parameters") for _ in range(WITHOUT_LAW - nones)),
        *(CasePlan("unknown", (law,)) for law in unknown),
        CasePlan("pair", pair),
    ]


CASES = {
    "dev": {
        "arm": plans(
            [
                "shoulder_bristles",
                "cable_slack",
                "polled_command",
                "hard_clip",
                "saturation_tanh",
                "ripple_triangular",
            ],
            ["wall", "shaker"],
            ("polled_command", "elbow_bristles"),
            nones=2,
        ),
        "cart": plans(
            [
                "gear_bristles",
                "polled_voltage",
                "diode",
                "brush_tyre",
                "second_order_sensor",
                "saturation_tanh",
            ],
            ["oval_wheel", "ice"],
            ("gear_bristles", "second_order_sensor"),
            nones=1,
        ),
        "air": plans(
            [
                "polled_valve",
                "overlap_quadratic",
                "leak_orifice",
                "second_order_sensors",
                "bristles",
                "cushion_orifice",
            ],
            ["rail_bump", "whistle"],
            ("reservoir", "bristles"),
            nones=2,
        ),
        "prop": plans(
            [
                "polled_throttle",
                "duty_power",
                "battery_two_rc",
                "bearing_bristles",
                "inflow_by_speed",
                "second_order_reading",
            ],
            ["desync", "gust"],
            ("polled_throttle", "tip_tanh"),
            nones=1,
        ),
    },
    "held": {
        "arm": plans(
            [
                "shoulder_bearing",
                "elbow_asymmetric",
                "cable_cubic",
                "jittered_command",
                "saturation_knee",
                "ripple_two_harmonics",
            ],
            ["coupling", "slosh"],
            ("fold_back", "elbow_asymmetric"),
            nones=1,
        ),
        "cart": plans(
            [
                "gear_load",
                "jittered_voltage",
                "dead_time",
                "magic_formula",
                "averaging_sensor",
                "drag_cubed",
            ],
            ["brake", "gear_teeth"],
            ("jittered_voltage", "magic_formula"),
            nones=2,
        ),
        "air": plans(
            [
                "spool_second_order",
                "overlap_asymmetric",
                "leak_laminar",
                "sensor_tube",
                "friction_asymmetric",
                "cushion_exponential",
            ],
            ["hose", "compressor_dips"],
            ("regulator", "friction_asymmetric"),
            nones=1,
        ),
        "prop": plans(
            [
                "slew_rate",
                "duty_sine",
                "battery_charge",
                "bearing_load",
                "inflow_second_order",
                "tip_knee",
            ],
            ["ringing_stand", "rubbing_guard"],
            ("averaged_reading", "creep_of_loading"),
            nones=2,
        ),
    },
}
# By the same laws, of other sizes, parameters and noise.
CASES["second"] = CASES["third"] = CASES["held"]
