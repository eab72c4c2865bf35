"""What ``sim_twin`` publishes, each topic at its own rate, with stamps on wall time."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

from pianobot_msgs.msg import (
    KeyAngle,
    KeyForce,
    Keystroke,
    MidiEvent,
    StrikeMark,
    TwinStatus,
    VacuumState,
    WristState,
)
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from pianobot_ros.cell.arrays import Array
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.recordings.contact_radius import at_contact
from pianobot_ros.cell.recordings.keystroke import Keystroke as Stroke
from pianobot_ros.cell.recordings.keystroke import midi_velocity
from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.session.marks import Marks
from pianobot_ros.nodes.topics.template import Template, sender
from pianobot_ros.nodes.twin.twin_loop import Pace
from pianobot_ros.piano.gap.evidence.session_clocks import SessionClocks
from pianobot_ros.piano.twin.model.arm import JOINTS
from pianobot_ros.piano.twin.stepping.cell_twin import CellTwin, Samples

__all__ = ["Rates", "TwinPublishers"]


@dataclass(frozen=True)
class Rates:
    """Publishing rates, Hz."""

    fsr: float
    key_angle: float
    wrist: float
    vacuum: float
    status: float


class _Timer:
    """Which samples of a stretch are due at a rate: every n-th step, from step number 0 on, or the
    ``last`` of every n.
    """

    def __init__(self, rate: float, step: float, last: bool = False) -> None:
        self.every = max(1, round(1.0 / (rate * step)))
        self._begin = self.every - 1 if last else 0

    def due(self, first: int, count: int) -> range:
        """Indices in a stretch of ``count`` steps, the first being step number ``first``."""
        return range((self._begin - first) % self.every, count, self.every)


class TwinPublishers:
    """The publishers of the simulated cell."""

    def __init__(
        self,
        node: common.PianoNode,
        twin: CellTwin,
        fsr_note: int,
        rates: Rates,
        effects: list[str],
        clock: bool,
    ) -> None:
        def publisher(kind: type, topic: str, qos: Any) -> Any:
            return node.create_publisher(
                kind, topic, qos, event_callbacks=common.publisher_events(node, topic)
            )

        self.twin, self.fsr_note, self.effects = twin, fsr_note, effects
        self.adopted: tuple[list[str], str] = ([], "")
        self.clocks = SessionClocks()
        self._key = twin.cell.notes.index(fsr_note)
        sensor, event = common.SENSOR_QOS, common.EVENT_QOS
        self._send_wrist = sender(publisher(WristState, "/sim/wrist/state", sensor))
        self._send_joints = sender(publisher(JointState, "/sim/joint_states", sensor))
        self._send_vacuum = sender(publisher(VacuumState, "/sim/vacuum/state", sensor))
        self._send_fsr = sender(publisher(KeyForce, "/sim/fsr", sensor))
        self._send_angle = sender(publisher(KeyAngle, "/sim/key_angle", sensor))
        self._midi = publisher(MidiEvent, "/sim/midi", event)
        self._keystroke = publisher(Keystroke, "/sim/keystroke", event)
        self._status = publisher(TwinStatus, "/sim/status", sensor)
        self._clock = publisher(Clock, "/clock", sensor) if clock else None
        step = twin.cell.timestep
        self._fsr_timer, self._angle_timer = _Timer(rates.fsr, step), _Timer(rates.key_angle, step)
        # Of the last step before the loop goes to sleep: nobody waits longer than a wake-up's
        # period to hear that the wrist obeys.
        self._wrist_timer = _Timer(rates.wrist, step, last=True)
        self._vacuum_timer = _Timer(rates.vacuum, step)
        self._status_period, self._next_status = 1.0 / rates.status, 0.0
        self._sequence, self._vacuum_sequence = 0, 0
        self._marks = Marks()
        self._make_templates()

    def _make_templates(self) -> None:
        keys, joints = len(self.twin.cell.notes), len(JOINTS)
        self._force_bytes = Template(
            KeyForce(note=self.fsr_note, counts=-1), force="d", sequence="I"
        )
        angle = KeyAngle(
            notes=list(self.twin.cell.notes), angle=[0.0] * keys, velocity=[0.0] * keys
        )
        self._angle_bytes = Template(angle, angle=f"{keys}d", velocity=f"{keys}d")
        state = WristState(
            joint_currents=[float("nan")] * 6,
            speed_scaling=1.0,
            safety_state=WristState.SAFETY_NORMAL,
            program_running=True,
        )  # no currents: the twin has no motors
        state.header.frame_id = "base"
        self._wrist_bytes = Template(
            state, pose="7d", twist="6d", target_pose="7d", controller_time="d"
        )
        joint = JointState(
            name=[f"{name}_joint" for name in JOINTS],
            position=[0.0] * joints,
            velocity=[0.0] * joints,
        )
        joint.header.frame_id = "base"
        self._joint_bytes = Template(joint, position=f"{joints}d", velocity=f"{joints}d")
        fingers = len(FINGERS)
        vacuum = VacuumState(
            fingers=list(FINGERS), setpoint=[0.0] * fingers, measured=[0.0] * fingers
        )
        self._vacuum_bytes = Template(
            vacuum, setpoint=f"{fingers}d", measured=f"{fingers}d", sequence="I"
        )

    def announce(self, mark: StrikeMark) -> None:
        """A strike to come: says T_N for T_idle, and where on the key the finger lands."""
        self._marks.add(mark)

    def publish(self, samples: Samples, epoch_ns: int, pace: Pace, paused: bool) -> None:
        """Everything that is due in a stretch of steps."""
        count = len(samples.time)
        first = self.twin.steps - count

        def at(seconds: float, device: str) -> int:
            return self.clocks.stamp(device, epoch_ns + round(1e9 * seconds))

        for event in samples.events:
            message = MidiEvent(
                status=MidiEvent.NOTE_ON if event.on else MidiEvent.NOTE_OFF,
                note=event.note,
                velocity=event.velocity,
            )
            message.header.stamp = common.time_msg(at(event.time, "midi"))
            self._midi.publish(message)
        for stroke in samples.strokes:
            self._keystroke.publish(self._stroke(stroke, epoch_ns))

        times = samples.time.tolist()
        for i in self._fsr_timer.due(first, count):
            force = float(samples.force[i, self._key])
            self._send_fsr(
                self._force_bytes.fill(at(times[i], "fsr"), force=force, sequence=self._sequence)
            )
            self._sequence = (self._sequence + 1) % 2**32
        for i in self._angle_timer.due(first, count):
            angle, velocity = samples.angle[i].tolist(), samples.rate[i].tolist()
            self._send_angle(
                self._angle_bytes.fill(at(times[i], "fsr"), angle=angle, velocity=velocity)
            )
        for i in self._wrist_timer.due(first, count):
            self._publish_wrist(samples, i, at(times[i] + self.twin.cell.timestep, "wrist"))
        for i in self._vacuum_timer.due(first, count):
            self._send_vacuum(
                self._vacuum_bytes.fill(
                    at(times[i], "vacuum"),
                    setpoint=self.twin.pressure.tolist(),
                    measured=self.twin.vacuum.tolist(),
                    sequence=self._vacuum_sequence,
                )
            )
            self._vacuum_sequence = (self._vacuum_sequence + 1) % 2**32
        if self._clock is not None:
            now = self.twin.time
            self._clock.publish(Clock(clock=common.time_msg(round(now * 1e9))))
        self._maybe_status(pace, paused)

    def idle(self, pace: Pace) -> None:
        """While paused only the status goes on."""
        self._maybe_status(pace, True)

    def _publish_wrist(self, samples: Samples, i: int, stamp_ns: int) -> None:
        time_ = float(samples.time[i]) + self.twin.cell.timestep
        pose, twist, target = (
            _pose(samples.pose[i]),
            _twist(samples.pose[i], samples.twist[i]),
            _pose(samples.target[i]),
        )
        self._send_wrist(
            self._wrist_bytes.fill(
                stamp_ns, pose=pose, twist=twist, target_pose=target, controller_time=time_
            )
        )
        position, velocity = samples.joint[i].tolist(), samples.speed[i].tolist()
        self._send_joints(self._joint_bytes.fill(stamp_ns, position=position, velocity=velocity))

    def _stroke(self, stroke: Stroke, epoch_ns: int) -> Keystroke:
        onset_ns = self.clocks.stamp("midi", epoch_ns + round(1e9 * stroke.onset))
        mark = self._marks.covering(stroke.note, onset_ns * 1e-9)
        length = 0.0 if mark is None else mark.note_length
        here = at_contact(stroke, self._marks.radius(stroke.note, onset_ns * 1e-9))
        midi = self.twin.trigger.midi
        message = Keystroke(
            note=stroke.note,
            onset=common.time_msg(onset_ns),
            v_pre=here.v_pre,
            v_rel=here.v_rel,
            radius=here.radius,
            velocity_pre=midi_velocity(stroke.v_pre, midi),
            velocity_rel=midi_velocity(stroke.v_rel, midi),
            t_hold=stroke.t_hold,
            t_idle=length - stroke.t_hold if length > 0 else float("nan"),
            peak_force=stroke.peak_force,
        )
        message.header.stamp = common.time_msg(onset_ns + round(1e9 * stroke.t_hold))
        return message

    def _maybe_status(self, pace: Pace, paused: bool) -> None:
        now = time.monotonic()
        if now < self._next_status:
            return
        self._next_status = now + self._status_period
        message = TwinStatus(
            simulated_time=self.twin.time,
            real_time_factor=0.0 if paused else pace.real_time_factor,
            jitter_p50=pace.jitter(50),
            jitter_p99=pace.jitter(99),
            steps=self.twin.steps,
            paused=paused,
            effects=self.effects,
            adopted=self.adopted[0],
            corrections=self.adopted[1],
        )
        message.header.stamp = common.time_msg(time.time_ns())
        self._status.publish(message)


def _pose(pose: Array) -> list[float]:
    """Position and quaternion (x, y, z, w) of a pose (6,)."""
    x, y, z, a, b, c = pose.tolist()
    angle = math.sqrt(a * a + b * b + c * c)
    k = 0.5 - angle * angle / 48 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return [x, y, z, k * a, k * b, k * c, math.cos(0.5 * angle)]


def _twist(pose: Array, rate: Array) -> list[float]:
    """Linear and angular velocity of a pose (6,) with its rate (6,)."""
    x, y, z, u, v, w = rate.tolist()
    _, _, _, a, b, c = pose.tolist()
    # From the rate of the rotation vector to angular velocity, to second order in the (small)
    # rotation.
    p, q, r = 0.5 * (b * w - c * v), 0.5 * (c * u - a * w), 0.5 * (a * v - b * u)
    return [
        x,
        y,
        z,
        u + p + (b * r - c * q) / 3.0,
        v + q + (c * p - a * r) / 3.0,
        w + r + (a * q - b * p) / 3.0,
    ]
