"""Drives as most are: a position loop around a speed loop; and what is found beside such a loop."""

from __future__ import annotations

import numpy as np
import pytest
from cascade import LINK, WEIGHT, drive, forearm, mover

from pianobot_ros.axis.commissioning.regression import finest
from pianobot_ros.axis.diagnosis.joint import diagnose_joint
from pianobot_ros.axis.log import Log
from pianobot_ros.axis.signals.cleaning import clean, counted
from pianobot_ros.axis.twin.servo_axis import ServoAxis


@pytest.mark.parametrize(("gain", "held"), [(3.0, 40.0), (20.0, 200.0)])
def test_a_drive_that_feeds_its_whole_speed_forward_is_found_as_it_is(gain, held):
    """Its search takes 30 simulations: cut short, a loop without integral action seemed better."""
    known = ServoAxis([clean(mover(1, gain, held))]).joint.nominal
    stiffness, inertia = 18.0 * gain + held, 0.17
    assert known["integral"] == pytest.approx(18.0 * held / stiffness, rel=0.05)
    assert known["bandwidth"] == pytest.approx(np.sqrt(stiffness / inertia), rel=0.05)


@pytest.mark.long
def test_a_drive_that_lacks_nothing_is_given_no_delay():
    found = diagnose_joint([drive(1)]).diagnosis
    assert found.verdict in ("none", "parameters")
    twin = ServoAxis([clean(drive(1))])
    assert twin.joint.nominal["command_weight"] < 0.9  # half of the speed is fed forward


@pytest.mark.long
def test_a_second_effect_that_leaves_nothing_is_named_however_small():
    found = diagnose_joint([drive(2, cogging=0.9, coulomb=0.6)]).diagnosis
    assert {e.name for e in found.effects} == {"cogging", "coulomb"}
    values = {n: p.value for e in found.effects for n, p in e.parameters.items()}
    assert values["cogging"] == pytest.approx(0.9, rel=0.1)
    assert values["coulomb"] == pytest.approx(0.6, rel=0.1)


@pytest.mark.long
def test_a_loop_is_found_beside_gravity_that_another_joint_turns():
    """Its trace is larger than what integral action takes away: not known to the search, it had
    left a loop without (4 of 48 arms seemed to have an offset of the sensor).
    """
    loops = [ServoAxis([clean(forearm(seed, 0.0, 20.0))]).joint for seed in (301, 302, 303)]
    assert all(j.others.arm == {"shoulder": 1.0} for j in loops)
    found = np.array([[j.nominal["bandwidth"], j.nominal["integral"]] for j in loops])
    assert found == pytest.approx(np.tile(found.mean(0), (3, 1)), rel=0.25)
    assert found[:, 1].min() > 3.0


def test_gravity_is_followed_in_a_short_log():
    assert ServoAxis([clean(forearm(41, 0.0, 12.0))]).joint.others.arm == {"shoulder": 1.0}


@pytest.mark.long
def test_a_mass_on_an_arm_hangs_by_the_angles_that_turn_its_gravity():
    mass = 0.4  # kg
    found = diagnose_joint([forearm(4, mass)], reference=[forearm(3, 0.0)]).diagnosis
    (effect,) = found.effects
    values = {n: p.value for n, p in effect.parameters.items()}
    assert effect.name == "payload"
    assert values["payload_gravity"] == pytest.approx(mass * WEIGHT * LINK, rel=0.1)
    assert values["payload_inertia"] == pytest.approx(mass * LINK**2, rel=0.1)


@pytest.mark.slow
@pytest.mark.long
def test_nothing_is_carried_where_nothing_was_added():
    found = diagnose_joint([forearm(5, 0.0)], reference=[forearm(3, 0.0)]).diagnosis
    assert found.verdict == "none"


def stamped(samples: float) -> Log:
    """A joint's log at 50 Hz, its efforts that many samples behind the positions that they make."""
    fine = mover(1, 3.0, 40.0)
    late = np.interp(fine.t - 0.02 * samples, fine.t, fine.effort)
    t, command, position, effort = (y[::4] for y in (fine.t, fine.command, fine.position, late))
    return Log("stamped", t, command, position, None, effort, "A", (), "j")


@pytest.mark.slow
@pytest.mark.parametrize("samples", [0.5, -0.5, 3.0])
def test_which_end_of_a_cycle_an_effort_is_stamped_with_is_no_cause(samples):
    found = diagnose_joint([stamped(samples)]).diagnosis
    names = {e.name for e in found.effects}
    assert ("sensor_latency" in names) == (samples > 1.0), names


def test_what_starts_and_stops_alone_show_is_not_known_to_repeat():
    """Of fine waves quick moves pass a part where they begin and where they end, and no more that
    the signals hold; a slow sweep passes all of them, and a sweep through wide ones is no limit.
    """
    quick = clean(mover(1, 3.0, 40.0))
    sweep = 0.05 * quick.log.t
    slow = clean(Log("slow", quick.log.t, sweep, sweep, None, 0.3 + 0.0 * sweep, "A"))
    assert 20.0 < finest([quick]) < 150.0
    assert finest([slow]) > 1000.0
    assert finest([quick, slow]) == finest([slow])
    (cogging,) = (e for e in ServoAxis([quick]).effects if e.name == "cogging")
    high = next(p.high for p in cogging.parameters if p.name == "cogging_waves")
    assert high == pytest.approx(finest([quick]))


def test_effort_at_rest_does_not_count():
    log = drive(6, coulomb=0.4)
    stops = np.where(log.t % 4.0 < 2.0, log.t % 4.0, 2.0) + 2.0 * (log.t // 4.0)
    held = {n: np.interp(stops, log.t, getattr(log, n)) for n in ("command", "position", "effort")}
    c = clean(Log("stops", log.t, held["command"], held["position"], None, held["effort"], "A"))
    inside = (log.t % 4.0 > 2.3) & (log.t % 4.0 < 3.7)
    assert counted(c)[inside].mean() < 0.05
    assert counted(c)[log.t % 4.0 < 1.8].mean() > 0.8
