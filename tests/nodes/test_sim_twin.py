"""The node ``sim_twin``: it obeys, answers on wall time, and says what is wrong with its parameters."""

from __future__ import annotations

import time

import pytest

pytestmark = pytest.mark.graph


def messages():  # type: ignore[no-untyped-def]
    return pytest.importorskip("pianobot_msgs.msg")


def make(ros, **parameters):  # type: ignore[no-untyped-def]
    from rclpy.parameter import Parameter

    from pianobot_ros.nodes.sim_twin import SimTwin

    overrides = [Parameter(name, value=value) for name, value in parameters.items()]
    return ros.add(SimTwin(context=ros.context, parameter_overrides=overrides))


def command(m, z: float, x: float = 0.0):  # type: ignore[no-untyped-def]
    from pianobot_ros.cell.geometry import wrist_pose

    pose = wrist_pose({"middle": 64})
    message = m.WristCommand()
    message.pose.position.x, message.pose.position.y = pose.x + x, pose.y
    message.pose.position.z = pose.z + z
    message.pose.orientation.w = 1.0
    return message


def test_a_commanded_strike_is_played_and_reported_on_wall_time(ros) -> None:  # type: ignore[no-untyped-def]
    m = messages()
    from sensor_msgs.msg import JointState

    from pianobot_ros.nodes import common

    node = make(ros, status_rate=10.0, effects=["key_friction.key_friction=0.001"])
    test = ros.node("test")
    received = {}
    for kind, topic, qos in (
        (m.WristState, "wrist/state", common.SENSOR_QOS), (m.KeyForce, "fsr", common.SENSOR_QOS),
        (m.KeyAngle, "key_angle", common.SENSOR_QOS), (m.VacuumState, "vacuum/state", common.SENSOR_QOS),
        (m.TwinStatus, "status", common.SENSOR_QOS), (JointState, "joint_states", common.SENSOR_QOS),
        (m.MidiEvent, "midi", common.EVENT_QOS), (m.Keystroke, "keystroke", common.EVENT_QOS),
    ):  # fmt: skip
        received[topic] = []
        test.create_subscription(kind, "/sim/" + topic, received[topic].append, qos)
    wrist = test.create_publisher(m.WristCommand, "/command/wrist", common.COMMAND_QOS)
    vacuum = test.create_publisher(m.VacuumCommand, "/command/vacuum", common.COMMAND_QOS)
    marks = test.create_publisher(m.StrikeMark, "/command/strike", common.EVENT_QOS)
    ros.spin_until(lambda: min(p.get_subscription_count() for p in (wrist, vacuum, marks)) > 0, what="subscriptions")
    now = time.time()
    mark = m.StrikeMark(note=64, note_length=9.0, end=common.time_msg(round((now + 60) * 1e9)))
    mark.header.stamp = common.time_msg(round(now * 1e9))
    marks.publish(mark)
    vacuum.publish(m.VacuumCommand(fingers=["middle"], pressure=[-40e3]))
    wrist.publish(command(m, 0.003))
    ros.spin_until(
        lambda: received["vacuum/state"] and received["vacuum/state"][-1].measured[2] == -40e3, what="vacuum"
    )
    target = command(m, 0.0).pose.position.z

    def height() -> float:
        return received["wrist/state"][-1].pose.position.z - target if received["wrist/state"] else 9.0

    ros.spin_until(lambda: abs(height() - 0.003) < 1e-4, what="the wrist above the key")
    wrist.publish(command(m, -0.014))
    ros.spin_until(lambda: any(e.status == m.MidiEvent.NOTE_ON for e in received["midi"]), what="note-on")
    ros.spin_until(lambda: received["fsr"][-1].force > 1.0 and height() < -0.0139, what="force")
    wrist.publish(command(m, 0.005))
    ros.spin_until(lambda: bool(received["keystroke"]), what="the keystroke")
    stroke = received["keystroke"][0]
    on, off = received["midi"]
    assert (on.note, off.note, stroke.note) == (64, 64, 64)
    assert (on.velocity, off.velocity) == (stroke.velocity_pre, stroke.velocity_rel)
    assert common.seconds(off.header.stamp) - common.seconds(on.header.stamp) == pytest.approx(stroke.t_hold, abs=1e-5)
    assert stroke.t_idle == pytest.approx(9.0 - stroke.t_hold)
    assert stroke.peak_force >= max(f.force for f in received["fsr"]) - 1e-6 > 1.0
    assert now - 1 < common.seconds(stroke.onset) < time.time()
    assert {f.counts for f in received["fsr"]} == {-1} and {f.note for f in received["fsr"]} == {64}
    assert list(received["key_angle"][-1].notes) == list(range(60, 72))
    assert len(received["joint_states"][-1].position) == 6
    ros.spin_until(lambda: received["status"][-1].simulated_time > 0.2, what="status")
    assert received["status"][-1].effects == ["key_friction.key_friction=0.001"]
    node.shut_down()


def test_pause_and_reset(ros) -> None:  # type: ignore[no-untyped-def]
    messages()
    from std_srvs.srv import SetBool, Trigger

    node = make(ros, status_rate=10.0)
    test = ros.node("test")
    pause = test.create_client(SetBool, "/sim_twin/pause")
    reset = test.create_client(Trigger, "/sim_twin/reset")
    ros.spin_until(lambda: pause.service_is_ready() and reset.service_is_ready(), what="services")
    ros.spin_until(lambda: node.twin.time > 0.3, what="some simulated time")
    assert ros.wait_for(pause.call_async(SetBool.Request(data=True))).message == "paused"
    ros.spin_until(lambda: node.loop.health().message == "paused")
    seen: list[float] = []

    def still() -> bool:
        seen.append(node.twin.time)
        return len(seen) > 20 and seen[-1] == seen[-20]

    ros.spin_until(still, what="standing still")
    assert ros.wait_for(reset.call_async(Trigger.Request())).success
    ros.spin_until(lambda: node.twin.time == 0.0, what="reset")
    ros.wait_for(pause.call_async(SetBool.Request(data=False)))
    ros.spin_until(lambda: node.twin.time > 0.1, what="running again")
    node.shut_down()


def test_bad_commands_are_refused_and_the_twin_goes_on(ros) -> None:  # type: ignore[no-untyped-def]
    m = messages()
    from pianobot_ros.nodes import common

    node = make(ros)
    test = ros.node("test")
    wrist = test.create_publisher(m.WristCommand, "/command/wrist", common.COMMAND_QOS)
    vacuum = test.create_publisher(m.VacuumCommand, "/command/vacuum", common.COMMAND_QOS)
    ros.spin_until(lambda: wrist.get_subscription_count() > 0 and vacuum.get_subscription_count() > 0)
    before = node.twin.target.copy()
    wrist.publish(command(m, float("nan")))
    crooked = command(m, 0.0)
    crooked.pose.orientation.w = 0.0
    wrist.publish(crooked)
    vacuum.publish(m.VacuumCommand(fingers=["pinky"], pressure=[-1.0]))
    vacuum.publish(m.VacuumCommand(fingers=["thumb"], pressure=[]))
    mark = node.twin.time
    ros.spin_until(lambda: node.twin.time > mark + 0.2, what="time to go on")
    assert (node.twin.target == before).all() and not node.twin.pressure.any()
    wrist.publish(command(m, 0.05, x=3.0))  # out of the arm's reach
    ros.spin_until(lambda: node.loop.faults > 0, what="a complaint")
    wrist.publish(command(m, 0.05))
    ros.spin_until(lambda: abs(node.twin.pose[2] - node.twin.target[2]) < 1e-3 and node.twin.target[0] < 1.0)
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
