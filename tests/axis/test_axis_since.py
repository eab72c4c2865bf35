"""What a reference log left open is open in the next one."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from pianobot_ros.axis.twin.since import Since
from pianobot_ros.gap import Parameter
from pianobot_ros.gap.diagnosis import Estimate

DAMPING = Parameter("damping", 0.5, 0.1, 3.0, "1", "drive", 0.05, True)
LEAD = Parameter("feedforward", 0.4, -0.2, 1.3, "1", "drive", 0.1)
OFFSET = Parameter("effort_offset", 2.0, -9.0, 9.0, "A", "drive", 0.1)


def since(name: str, value: float, low: float, high: float) -> Since:
    return Since(
        {name: Estimate(value, low, high, "1", value, "drive", by_chance=(low, high))}, {}, {}
    )


@given(value=st.floats(0.2, 2.0), share=st.floats(1.0, 2.0))
def test_the_prior_is_the_references_and_no_narrower_than_it(value: float, share: float) -> None:
    known = since("damping", value, value / share, value * share).known(DAMPING, True, False)
    assert known.nominal == value and (known.low, known.high) == (DAMPING.low, DAMPING.high)
    assert known.sd >= max(DAMPING.sd, 0.5 * math.log(share))
    known = since("feedforward", 0.5, 0.5 - share, 0.5 + share).known(LEAD, True, False)
    assert known.nominal == 0.5 and known.sd >= max(LEAD.sd, 0.5 * share)


def test_what_the_reference_determined_well_is_believed_as_far_as_the_twin_is() -> None:
    known = since("damping", 0.6, 0.599, 0.601).known(DAMPING, True, False)
    assert (known.nominal, known.sd) == (0.6, DAMPING.sd)


def test_what_the_reference_said_nothing_of_stays() -> None:
    assert Since({}, {}, {}).known(DAMPING, True, False) is DAMPING


def test_what_a_lift_weighs_is_its_own_and_no_added_mass_goes_into_it() -> None:
    """An added weight had gone into the offset, as which a lift's own is commissioned."""
    reference = since("effort_offset", 2.0, 1.98, 2.02)
    known = reference.known(OFFSET, True, True)
    assert (known.nominal, known.low, known.high) == (2.0, 1.9, 2.1)
    known = reference.known(OFFSET, True, False)  # a rotary joint's is of the amplifier
    assert (known.low, known.high) == (OFFSET.low, OFFSET.high)
