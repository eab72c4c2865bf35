"""The node ``sim_twin``: it obeys, answers on wall time, and says what is wrong with its
parameters.
"""

from __future__ import annotations

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray

from pianobot_ros.cell.messages.refusals import refusals
from pianobot_ros.cell.messages.stamps import nanoseconds

pytestmark = pytest.mark.graph


def messages():  # type: ignore[no-untyped-def]
    return pytest.importorskip("pianobot_msgs.msg")


def make(ros, **parameters):  # type: ignore[no-untyped-def]
    from rclpy.parameter import Parameter

    from pianobot_ros.nodes.twin.sim_twin import SimTwin

    overrides = [Parameter(name, value=value) for name, value in parameters.items()]
    return ros.add(SimTwin(context=ros.context, parameter_overrides=overrides))


def command(m, z: float, x: float = 0.0):  # type: ignore[no-untyped-def]
    from pianobot_ros.cell.motion.wrist_poses import wrist_pose

    pose = wrist_pose({"middle": 64})
    message = m.WristCommand()
    message.pose.position.x, message.pose.position.y = pose.x + x, pose.y
    message.pose.position.z = pose.z + z
    message.pose.orientation.w = 1.0
    return message


def commanded(ros):  # type: ignore[no-untyped-def]
    """The twin, a node beside it, and that one's publishers of wrist and vacuum commands."""
    m, node = messages(), make(ros)
    test = ros.node("test")
    kinds = {"/command/wrist": m.WristCommand, "/command/vacuum": m.VacuumCommand}
    made = [ros.publisher(kind, topic) for topic, kind in kinds.items()]
    ros.matched(*made)
    return node, test, *made


class Stream:
    """A setpoint, streamed at the controller's rate and a little ahead, as the conductor does: a
    moment that the machine takes must not become a jump.
    """

    PERIOD, AHEAD = 8_000_000, 150_000_000  # ns

    def __init__(self, node, publisher):  # type: ignore[no-untyped-def]
        self.message = None
        self.publisher = publisher
        self.next = time.time_ns()
        node.create_timer(0.008, self.publish)

    def publish(self) -> None:
        from pianobot_ros.nodes.base import common

        while self.next < time.time_ns() + self.AHEAD:
            if self.message is not None:
                self.message.header.stamp = common.time_msg(self.next)
                self.publisher.publish(self.message)
            self.next += self.PERIOD


def test_a_commanded_strike_is_played_and_reported_on_wall_time(ros, processes) -> None:  # type: ignore[no-untyped-def]
    m = messages()
    from sensor_msgs.msg import JointState

    from pianobot_ros.nodes.base import common

    # A process of its own, as a user starts it: what the test itself does must not hold it up.
    effects = ["key_friction.key_friction=0.001"]
    # Fewer messages than usual: the test takes each of them, on a core that it shares.
    rates = {"status_rate": 10.0, "fsr_rate": 125.0, "key_angle_rate": 50.0, "vacuum_rate": 50.0}
    processes.node("sim_twin", effects=effects, **rates)
    test = ros.node("test")
    received = {}
    for kind, topic, qos in (
        (m.WristState, "wrist/state", common.SENSOR_QOS),
        (m.KeyForce, "fsr", common.SENSOR_QOS),
        (m.KeyAngle, "key_angle", common.SENSOR_QOS),
        (m.VacuumState, "vacuum/state", common.SENSOR_QOS),
        (m.TwinStatus, "status", common.SENSOR_QOS),
        (JointState, "joint_states", common.SENSOR_QOS),
        (m.MidiEvent, "midi", common.EVENT_QOS),
        (m.Keystroke, "keystroke", common.EVENT_QOS),
    ):
        received[topic] = []
        test.create_subscription(kind, "/sim/" + topic, received[topic].append, qos)
    wrist = ros.publisher(m.WristCommand, "/command/wrist")
    vacuum = ros.publisher(m.VacuumCommand, "/command/vacuum")
    marks = ros.publisher(m.StrikeMark, "/command/strike")
    ros.wait_for(
        lambda: min(p.get_subscription_count() for p in (wrist, vacuum, marks)) > 0,
        "subscriptions",
        timeout=600.0,  # the first start on a machine compiles the laws
    )
    stream = Stream(test, wrist)
    now = time.time()
    mark = m.StrikeMark(note=64, note_length=9.0, end=common.time_msg(round((now + 60) * 1e9)))
    mark.header.stamp = common.time_msg(round(now * 1e9))
    marks.publish(mark)
    vacuum.publish(m.VacuumCommand(fingers=["middle"], pressure=[-40e3]))
    stream.message = command(m, 0.003)
    ros.wait_for(
        lambda: received["vacuum/state"] and received["vacuum/state"][-1].measured[2] == -40e3,
        "vacuum",
    )
    target = command(m, 0.0).pose.position.z

    def height() -> float:
        return (
            received["wrist/state"][-1].pose.position.z - target if received["wrist/state"] else 9.0
        )

    ros.wait_for(lambda: abs(height() - 0.003) < 1e-4, "the wrist above the key")
    stream.message = command(m, -0.014)
    ros.wait_for(lambda: any(e.status == m.MidiEvent.NOTE_ON for e in received["midi"]), "note-on")
    ros.wait_for(lambda: received["fsr"][-1].force > 1.0 and height() < -0.0139, "force")
    stream.message = command(m, 0.005)
    ros.wait_for(
        lambda: bool(received["keystroke"]),
        lambda: f"the keystroke of {received['midi']}, {received['status'][-1]}",
    )
    # between topics there is no order
    ros.wait_for(
        lambda: len(received["midi"]) >= 2 and all(received.values()),
        lambda: f"the rest of {[topic for topic, found in received.items() if found]}",
    )
    stroke = received["keystroke"][0]
    on, off = received["midi"]
    assert (on.note, off.note, stroke.note) == (64, 64, 64)
    assert (on.velocity, off.velocity) == (stroke.velocity_pre, stroke.velocity_rel)
    assert common.seconds(off.header.stamp) - common.seconds(on.header.stamp) == pytest.approx(
        stroke.t_hold, abs=1e-5
    )
    assert stroke.t_idle == pytest.approx(9.0 - stroke.t_hold)
    assert stroke.peak_force >= max(f.force for f in received["fsr"]) - 1e-6 > 1.0
    assert now - 1 < common.seconds(stroke.onset) < time.time()
    assert {f.counts for f in received["fsr"]} == {-1} and {f.note for f in received["fsr"]} == {64}
    assert list(received["key_angle"][-1].notes) == list(range(60, 72))
    assert len(received["joint_states"][-1].position) == 6
    ros.wait_for(lambda: received["status"][-1].simulated_time > 0.2, "status")
    assert received["status"][-1].effects == effects


def test_pause_and_reset(ros) -> None:  # type: ignore[no-untyped-def]
    messages()
    from std_srvs.srv import SetBool, Trigger

    node = make(ros, status_rate=10.0)
    test = ros.node("test")
    pause = test.create_client(SetBool, "/sim_twin/pause")
    reset = test.create_client(Trigger, "/sim_twin/reset")
    ros.wait_for(lambda: pause.service_is_ready() and reset.service_is_ready(), "services")
    ros.wait_for(lambda: node.twin.time > 0.3, "some simulated time")
    assert ros.wait_for(pause.call_async(SetBool.Request(data=True))).message == "paused"
    ros.wait_for(lambda: node.loop.health().message == "paused")
    seen: list[float] = []

    def still() -> bool:
        seen.append(node.twin.time)
        return len(seen) > 20 and seen[-1] == seen[-20]

    ros.wait_for(still, "standing still")
    assert ros.wait_for(reset.call_async(Trigger.Request())).success
    ros.wait_for(lambda: node.twin.time == 0.0, "reset")
    ros.wait_for(pause.call_async(SetBool.Request(data=False)))
    ros.wait_for(lambda: node.twin.time > 0.1, "running again")
    node.shut_down()


def test_bad_commands_are_refused_and_the_twin_goes_on(ros) -> None:  # type: ignore[no-untyped-def]
    m = messages()
    from pianobot_ros.nodes.base import common

    node, _, wrist, vacuum = commanded(ros)
    refused = ros.record(DiagnosticArray, "/sim/refusals")
    ros.matched(node.refusals._publisher)
    before = node.twin.target.copy()
    lost, crooked, elsewhere, below = (command(m, 0.0) for _ in range(4))
    lost.pose.position.z = float("nan")
    crooked.pose.orientation.w = 0.0
    elsewhere.header.frame_id = "tool0"
    below.pose.position.z = -0.3
    waited = command(m, 0.0)
    waited.header.stamp = common.time_msg(time.time_ns() - 10**9)
    for bad in (lost, crooked, elsewhere, below, command(m, 0.05, x=3.0), waited):
        wrist.publish(bad)
    old = m.VacuumCommand(fingers=["thumb"], pressure=[-1.0])
    old.header.stamp = common.time_msg(time.time_ns() - 10**10)
    vacuum.publish(old)
    vacuum.publish(m.VacuumCommand(fingers=["pinky"], pressure=[-1.0]))
    vacuum.publish(m.VacuumCommand(fingers=["thumb"], pressure=[]))
    ros.wait_for(lambda: node.refusals.count == 9, "nine refusals")
    mark = node.twin.time
    ros.wait_for(lambda: node.twin.time > mark + 0.2, "time to go on")
    assert (node.twin.target == before).all() and not node.twin.pressure.any()
    assert node.loop.faults == 0
    assert node.diagnose()["physics"].values["rejected"] == 9
    ros.wait_for(lambda: len(refused) >= 9, "word of them")
    # each topic keeps its order; between topics there is none
    found = [r for message in refused for r in refusals(message)]
    of_wrist, of_vacuum = (
        [r for r in found if r.topic == topic] for topic in ("/command/wrist", "/command/vacuum")
    )
    assert (len(of_wrist), len(of_vacuum)) == (6, 3)
    for word, refusal in zip(("finite", "length", "tool0"), of_wrist, strict=False):
        assert word in refusal.reason
    assert of_vacuum[0].command == nanoseconds(old.header.stamp)
    node.shut_down()


def test_a_jump_is_followed_as_fast_as_the_arm_may_and_the_vacuum_ends_at_its_range(  # type: ignore[no-untyped-def]
    ros, monkeypatch
) -> None:
    m = messages()
    from pianobot_ros.cell.motion.limits import wrist_limits

    node, test, wrist, vacuum = commanded(ros)
    stream = Stream(test, wrist)
    stream.message = command(m, 0.05, x=0.1)
    wanted = stream.message.pose.position.x
    refused = ros.record(DiagnosticArray, "/sim/refusals")
    ros.matched(node.refusals._publisher)
    obeyed: list[tuple[float, float]] = []
    command_wrist = node.loop.command_wrist

    def watched(pose, stamp_ns=0) -> None:  # type: ignore[no-untyped-def]
        obeyed.append((1e-9 * stamp_ns, float(pose[0])))
        command_wrist(pose, stamp_ns)

    monkeypatch.setattr(node.loop, "command_wrist", watched)
    vacuum.publish(m.VacuumCommand(fingers=["thumb"], pressure=[-9e9]))
    ros.wait_for(lambda: abs(node.twin.target[0] - wanted) < 1e-4, "the far setpoint")
    assert node.obedience.clamped > 5  # 0.1 m at 0.8 m/s takes more than 15 cycles
    ros.wait_for(lambda: refused, "word of it")
    assert "clamped by the" in refusals(refused[0])[0].reason and node.refusals.count == 0
    at, x = np.array(obeyed).T
    assert max(np.abs(np.diff(x)) / np.diff(at)) < 1.1 * wrist_limits().speed, "a teleport"
    ros.wait_for(lambda: node.twin.pressure[0] == -100e3, "the lowest pressure")
    node.shut_down()


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"effects": ["key_frictoin.key_friction=1"]}, "did you mean"),
        ({"parameters": ["joint_damping=much"]}, "name=factor"),
        ({"mechanism": "hammer"}, "spring"),
        ({"step": 0.1}, "step"),
    ],
)
def test_bad_parameters_say_what_to_do(ros, parameters, words) -> None:  # type: ignore[no-untyped-def]
    messages()
    from pianobot_ros.cell.errors import ConfigError

    with pytest.raises(ConfigError, match=words):
        make(ros, **parameters)


def test_corrections_are_adopted_named_and_forgotten(ros, tmp_path) -> None:  # type: ignore[no-untyped-def]
    m = messages()
    from pianobot_msgs.srv import Adopt
    from sensor_msgs.msg import TimeReference
    from std_srvs.srv import Trigger

    from pianobot_ros.nodes.base import common
    from pianobot_ros.piano.gap.adoption.live_laws import parse_effects

    text = parse_effects(["key_friction.key_friction=0.02", "pressure_lag.pressure_lag=0.1"])
    other = parse_effects(["midi_latency.midi_latency=0.01"])
    path = tmp_path / "corrections.yaml"
    path.write_text(text.to_yaml(), encoding="utf-8")
    node = make(ros, status_rate=10.0, corrections=str(path))
    test = ros.node("test")
    status: list[object] = []
    test.create_subscription(m.TwinStatus, "/sim/status", status.append, common.SENSOR_QOS)
    adopt = test.create_client(Adopt, "/sim_twin/adopt")
    forget = test.create_client(Trigger, "/sim_twin/forget")
    ros.wait_for(lambda: adopt.service_is_ready() and forget.service_is_ready(), "services")

    def reported(names: list[str]) -> None:
        ros.wait_for(lambda: bool(status) and list(status[-1].adopted) == names, "status")

    def ask(what: str):  # type: ignore[no-untyped-def]
        return ros.wait_for(adopt.call_async(Adopt.Request(corrections=what)))

    reported(text.names())
    assert status[-1].corrections == text.to_yaml()
    refused = ask(other.to_yaml())
    assert not refused.success and "forget first" in refused.message
    assert not ask(str(path)).success
    reported(text.names())
    assert ros.wait_for(forget.call_async(Trigger.Request())).success
    reported([])
    assert not ros.wait_for(forget.call_async(Trigger.Request())).success
    bad = ask(other.to_yaml().replace("value: 0.01", "value: 7"))
    assert not bad.success and "from 0 to 0.2" in bad.message and "\n" not in bad.message
    assert ask(other.to_yaml()).success
    reported(other.names())
    ros.wait_for(lambda: node.twin.laws is not None and node.twin.laws.late() == 0.01, "the law")
    assert ros.wait_for(forget.call_async(Trigger.Request())).success

    # a clock: what the diagnosis found is its rate, where it stands is what this session shows
    sights = test.create_publisher(TimeReference, "/gap/clocks", common.EVENT_QOS)
    ros.wait_for(lambda: sights.get_subscription_count() > 0, "who looks at clocks")
    force: list[object] = []
    test.create_subscription(
        m.KeyForce, "/sim/fsr", lambda f: force.append((f, time.time())), common.SENSOR_QOS
    )
    clock = parse_effects(["clock_skew.clock_skew=1e-3", "clock_skew.clock_skew_fsr=1"])
    for _ in range(3):
        sent = time.time_ns()
        seen = TimeReference(time_ref=common.time_msg(sent + 5 * 10**8), source="fsr")
        seen.header.stamp = common.time_msg(sent)
        sights.publish(seen)
    assert ask(clock.to_yaml()).success

    def ahead() -> float:
        message, now = force[-1]
        return common.seconds(message.header.stamp) - now

    ros.wait_for(lambda: bool(force) and 0.3 < ahead() < 0.6, "stamps of that clock")
    node.shut_down()
