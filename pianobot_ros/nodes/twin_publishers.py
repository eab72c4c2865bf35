"""What ``sim_twin`` publishes, each topic at its own rate, with stamps on wall time."""

from __future__ import annotations

import time
from array import array
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, Twist
from numpy.typing import NDArray
from pianobot_msgs.msg import KeyAngle, KeyForce, Keystroke, MidiEvent, StrikeMark, TwinStatus, VacuumState, WristState
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from pianobot_ros.cell.geometry import FINGERS
from pianobot_ros.cell.keystroke import Keystroke as Stroke
from pianobot_ros.cell.keystroke import midi_velocity
from pianobot_ros.nodes import common
from pianobot_ros.nodes.twin_loop import Pace
from pianobot_ros.twin.arm import JOINTS
from pianobot_ros.twin.cell import Samples, Twin

__all__ = ["Rates", "TwinPublishers"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rates:
    """Publishing rates, Hz."""

    fsr: float
    wrist: float
    vacuum: float
    status: float


class _Timer:
    """Which samples of a chunk are due at a rate: every n-th step."""

    def __init__(self, rate: float, step: float) -> None:
        self.every = max(1, round(1.0 / (rate * step)))

    def due(self, first: int, count: int) -> range:
        """Indices in a chunk of ``count`` steps, the first being step number ``first``."""
        return range(-first % self.every, count, self.every)


class TwinPublishers:
    """The publishers of the simulated cell."""

    def __init__(
        self, node: common.PianoNode, twin: Twin, fsr_note: int, rates: Rates, effects: list[str], clock: bool
    ) -> None:
        def publisher(kind: type, topic: str, qos: Any) -> Any:
            return node.create_publisher(kind, topic, qos, event_callbacks=common.publisher_events(node, topic))

        self.twin, self.fsr_note, self.effects = twin, fsr_note, effects
        self._key = twin.cell.notes.index(fsr_note)
        sensor, event = common.SENSOR_QOS, common.EVENT_QOS
        self._wrist = publisher(WristState, "/sim/wrist/state", sensor)
        self._joints = publisher(JointState, "/sim/joint_states", sensor)
        self._vacuum = publisher(VacuumState, "/sim/vacuum/state", sensor)
        self._fsr = publisher(KeyForce, "/sim/fsr", sensor)
        self._angle = publisher(KeyAngle, "/sim/key_angle", sensor)
        self._midi = publisher(MidiEvent, "/sim/midi", event)
        self._keystroke = publisher(Keystroke, "/sim/keystroke", event)
        self._status = publisher(TwinStatus, "/sim/status", sensor)
        self._clock = publisher(Clock, "/clock", sensor) if clock else None
        step = twin.cell.timestep
        self._fsr_timer, self._wrist_timer = _Timer(rates.fsr, step), _Timer(rates.wrist, step)
        self._vacuum_timer, self._status_period = _Timer(rates.vacuum, step), 1.0 / rates.status
        self._next_status = 0.0
        self._sequence, self._vacuum_sequence = 0, 0
        self._marks: dict[int, tuple[float, float, float]] = {}
        self._notes = array("B", twin.cell.notes)
        self._names = [f"{name}_joint" for name in JOINTS]

    def announce(self, mark: StrikeMark) -> None:
        """A strike to come: keeps its note length for T_idle."""
        self._marks[mark.note] = (common.seconds(mark.header.stamp), common.seconds(mark.end), mark.note_length)

    def publish(self, samples: Samples, epoch_ns: int, pace: Pace, paused: bool) -> None:
        """Everything that is due in a chunk."""
        count = len(samples.time)
        first = self.twin.steps - count

        def stamp(seconds: float) -> Time:
            return common.time_msg(epoch_ns + round(1e9 * seconds))

        for event in samples.events:
            message = MidiEvent(
                status=MidiEvent.NOTE_ON if event.on else MidiEvent.NOTE_OFF, note=event.note, velocity=event.velocity
            )
            message.header.stamp = stamp(event.time)
            self._midi.publish(message)
        for stroke in samples.strokes:
            self._keystroke.publish(self._stroke(stroke, epoch_ns))
        for i in self._fsr_timer.due(first, count):
            self._publish_key(samples, i, stamp(float(samples.time[i])))
        for i in self._wrist_timer.due(first, count):
            self._publish_wrist(samples, i, stamp(float(samples.time[i]) + self.twin.cell.timestep))
        for i in self._vacuum_timer.due(first, count):
            self._publish_vacuum(stamp(float(samples.time[i])))
        if self._clock is not None:
            now = self.twin.time
            self._clock.publish(Clock(clock=common.time_msg(round(now * 1e9))))
        self._maybe_status(pace, paused)

    def idle(self, pace: Pace) -> None:
        """While paused only the status goes on."""
        self._maybe_status(pace, True)

    def _publish_key(self, samples: Samples, i: int, stamp: Time) -> None:
        force = KeyForce(
            note=self.fsr_note, force=float(samples.force[i, self._key]), counts=-1, sequence=self._sequence
        )
        force.header.stamp = stamp
        self._fsr.publish(force)
        self._sequence = (self._sequence + 1) % 2**32
        angle = KeyAngle()
        angle.header.stamp = stamp
        angle.notes = self._notes
        angle.angle = array("d", samples.angle[i].tobytes())
        angle.velocity = array("d", samples.rate[i].tobytes())
        self._angle.publish(angle)

    def _publish_wrist(self, samples: Samples, i: int, stamp: Time) -> None:
        state = WristState()
        state.header.stamp, state.header.frame_id = stamp, "base"
        state.pose = _pose(samples.pose[i])
        state.twist = _twist(samples.pose[i], samples.twist[i])
        state.target_pose = _pose(self.twin.target)
        state.joint_currents = [float("nan")] * 6  # the twin has no motors
        state.controller_time = float(samples.time[i]) + self.twin.cell.timestep
        state.speed_scaling = 1.0
        state.safety_state = WristState.SAFETY_NORMAL
        state.program_running = True
        self._wrist.publish(state)
        joints = JointState(name=self._names, position=samples.joint[i].tolist())
        joints.velocity = self.twin.tracker.speed.tolist()
        joints.header = state.header
        self._joints.publish(joints)

    def _publish_vacuum(self, stamp: Time) -> None:
        values = self.twin.pressure.tolist()
        message = VacuumState(fingers=list(FINGERS), setpoint=values, measured=values, sequence=self._vacuum_sequence)
        message.header.stamp = stamp
        self._vacuum_sequence = (self._vacuum_sequence + 1) % 2**32
        self._vacuum.publish(message)

    def _stroke(self, stroke: Stroke, epoch_ns: int) -> Keystroke:
        onset_ns = epoch_ns + round(1e9 * stroke.onset)
        start, end, length = self._marks.get(stroke.note, (0.0, 0.0, 0.0))
        known = length > 0 and start <= onset_ns * 1e-9 <= end
        midi = self.twin.trigger.midi
        message = Keystroke(
            note=stroke.note, onset=common.time_msg(onset_ns), v_pre=stroke.v_pre, v_rel=stroke.v_rel,
            velocity_pre=midi_velocity(stroke.v_pre, midi), velocity_rel=midi_velocity(stroke.v_rel, midi),
            t_hold=stroke.t_hold, t_idle=length - stroke.t_hold if known else float("nan"), peak_force=stroke.peak_force,
        )  # fmt: skip
        message.header.stamp = common.time_msg(onset_ns + round(1e9 * stroke.t_hold))
        return message

    def _maybe_status(self, pace: Pace, paused: bool) -> None:
        now = time.monotonic()
        if now < self._next_status:
            return
        self._next_status = now + self._status_period
        message = TwinStatus(
            simulated_time=self.twin.time, real_time_factor=0.0 if paused else pace.real_time_factor,
            jitter_p50=pace.jitter(50), jitter_p99=pace.jitter(99), steps=self.twin.steps, paused=paused,
            effects=self.effects,
        )  # fmt: skip
        message.header.stamp = common.time_msg(time.time_ns())
        self._status.publish(message)


def _pose(pose: Array) -> Pose:
    message = Pose()
    message.position.x, message.position.y, message.position.z = (float(v) for v in pose[:3])
    x, y, z, w = Rotation.from_rotvec(pose[3:]).as_quat().tolist()
    message.orientation.x, message.orientation.y, message.orientation.z, message.orientation.w = x, y, z, w
    return message


def _twist(pose: Array, rate: Array) -> Twist:
    message = Twist()
    message.linear.x, message.linear.y, message.linear.z = (float(v) for v in rate[:3])
    # From the rate of the rotation vector to angular velocity, to second order in the (small) rotation.
    half = 0.5 * np.cross(pose[3:], rate[3:])
    spin = rate[3:] + half + np.cross(pose[3:], half) / 3.0
    message.angular.x, message.angular.y, message.angular.z = (float(v) for v in spin)
    return message
