"""Devices that mean harm, and clients that mean harm to the emulated ones."""

from __future__ import annotations

import math
import random
import struct
import time

import numpy as np

from fuzzing.target import INTEGERS, OutOfLimitsError, Target, changed, number
from pianobot_ros.cell.errors import DeviceError
from pianobot_ros.devices.fsr import FsrConfig, FsrDriver, FsrReading
from pianobot_ros.devices.midi import MidiConfig, MidiDriver, MidiMessage
from pianobot_ros.devices.midi.transport.parsing import MidiStream
from pianobot_ros.devices.serial_line import Identity, LineParser
from pianobot_ros.devices.serial_line.framing import crc16
from pianobot_ros.devices.vacuum import RegulatorConfig, RegulatorDriver, VacuumReading
from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.driver import UrDriver
from pianobot_ros.devices.wrist.messages import RawReading
from pianobot_ros.devices.wrist.rtde.receive import StateStream
from pianobot_ros.devices.wrist.rtde.wire import MessageType, frame
from pianobot_ros.devices.wrist.wrist_reading import WristReading
from pianobot_ros.emulator.wrist.__main__ import build
from pianobot_ros.emulator.wrist.control.safety import Safety
from pianobot_ros.emulator.wrist.links import dashboard
from pianobot_ros.emulator.wrist.links.rtde import RtdeSession


class Serial(Target):
    """Lines of the force board and the regulator, with the right checksum."""

    name = "serial"

    def __init__(self) -> None:
        self._fsr = FsrDriver(FsrConfig.load(), self._forces)
        self._vacuum = RegulatorDriver(RegulatorConfig.load(), self._pressures)
        self._parser = LineParser()
        self._accepted = 0

    def make(self, rng: random.Random) -> bytes:
        lines = []
        for _ in range(rng.randint(1, 3)):
            kind = rng.choice("FFFPPPIAEQRSWNz0")
            fields = [self._field(rng) for _ in range(rng.choice((0, 1, 2, 2, 3, 3, 7, 7, 8, 30)))]
            if kind == "P" and rng.random() < 0.6:
                fields = [
                    str(rng.randrange(2**32)),
                    *(str(rng.randint(-99999, 9)) for _ in "123456"),
                ]
                fields[rng.randrange(7)] = self._field(rng)
            sequence = str(rng.choice((*INTEGERS, 1, 2, 3)))
            body = ",".join([kind, sequence, *fields]).encode("latin-1")
            body = changed(body, rng, 2) if rng.random() < 0.2 else body
            body = body.replace(b"\n", b"")
            lines.append(b"%s*%04X\n" % (body, crc16(body)))
        return b"".join(lines)

    def _field(self, rng: random.Random) -> str:
        if rng.random() < 0.2:
            return rng.choice(
                ("", "-", "nan", "1e9", "0x1", " 1", "1.5", "a=b", "\u00b2", "9" * 90)
            )
        return str(rng.choice(INTEGERS) if rng.random() < 0.5 else rng.randint(-110_000, 110_000))

    def feed(self, data: bytes) -> bool:
        before, lines = self._accepted, self._parser.feed(data)
        for line in lines:
            Identity.from_line(line)
        self._fsr._on_lines(lines, time.time_ns())
        self._vacuum._on_lines(lines, time.time_ns())
        return self._accepted > before

    def _forces(self, readings: list[FsrReading]) -> None:
        self._accepted += 1
        for reading in readings:
            top = self._fsr.calibration.top
            if not (0 <= reading.counts <= top and math.isfinite(reading.force)):
                raise OutOfLimitsError(f"force reading {reading}")

    def _pressures(self, reading: VacuumReading) -> None:
        self._accepted += 1
        if not all(-101_325 <= p <= 0 for p in reading.setpoint) or not all(
            -110_000 <= p <= 50_000 for p in reading.measured
        ):
            raise OutOfLimitsError(f"pressures {reading}")


_DATA = bytes(byte & 127 for byte in range(256))  # each byte as one that is no status


class MidiTarget(Target):
    """Bytes of an instrument, whole messages and fragments."""

    name = "midi"

    def __init__(self) -> None:
        self._driver = MidiDriver(MidiConfig.load(), self._note, guard=False)
        self._stream = MidiStream()
        self._accepted = 0

    def make(self, rng: random.Random) -> bytes:
        match rng.randrange(4):
            case 0:
                return rng.randbytes(rng.randint(1, 40))
            case 1:  # a message without end
                return b"\xf0" + rng.randbytes(rng.choice((5, 5, 40, 4000))).translate(_DATA)
            case 2:
                return bytes((rng.choice((0x90, 0x80, 0xB0, 0xFE)), *rng.randbytes(2)))
            case _:
                return changed(b"\x90\x40\x40\x80\x40\x00" * 3, rng)

    def feed(self, data: bytes) -> bool:
        before = self._accepted
        for message in self._stream.feed(data):
            self._driver._link._take(message)
        return self._accepted > before

    def _note(self, message: MidiMessage) -> None:
        self._accepted += 1
        if message.status not in (0x80, 0x90) or max(message.note, message.velocity) > 127:
            raise OutOfLimitsError(f"note {message}")


class RtdeController(Target):
    """What a hostile controller says: frames, and the states in them as the driver gets them."""

    name = "rtde-client"

    def __init__(self) -> None:
        self._driver = UrDriver(UrConfig.load(), self._reading)
        self._accepted = 0
        self._stream = StateStream()
        self._good = struct.pack(">diiIdd36d", 1.0, 1, 7, 2, 1.0, 1.0, *[0.0] * 36)

    def make(self, rng: random.Random) -> bytes:
        frames = b""
        for _ in range(rng.randint(1, 3)):
            state = bytearray(self._good)
            for _ in range(rng.randint(1, 5)):
                at = rng.randrange(0, len(state) - 8)
                at = len(state) - 8 * rng.randint(1, 36) if rng.random() < 0.6 else at
                state[at : at + 8] = struct.pack(">d", number(rng))
            kinds = (*[MessageType.DATA_PACKAGE] * 8, MessageType.TEXT_MESSAGE, 0, 255)
            body = bytes((rng.choice((0, 1, 1, 1, 255)),)) + state
            body = body if rng.random() < 0.9 else changed(body, rng, 2)
            frames += frame(rng.choice(kinds), body)
        return frames if rng.random() < 0.95 else changed(frames, rng, 1)

    def feed(self, data: bytes) -> bool:
        before = self._accepted
        try:
            self._stream.feed(data)
        except DeviceError:  # the connection is lost, and made anew
            self._stream = StateStream()
        if len(self._stream.state) > 1:
            own = {"applied": 1, "latency": 0.0, "behind": 0.0, "servoing": True}
            said = self._stream.reading(1, 1.0, 1, **own).pack()
            self._driver._take_reading(RawReading.unpack(said))
        return self._accepted > before

    def _reading(self, reading: WristReading) -> None:
        self._accepted += 1
        numbers = np.concatenate([reading.position, reading.rotation, reading.q, reading.currents])
        if not (np.isfinite(numbers).all() and np.abs(numbers).max() < 1e4):
            raise OutOfLimitsError(f"reading {reading}")
        int(reading.safety), bool(reading.program_running)


_RECIPE = "input_double_register_0,input_int_register_0,speed_slider_mask,speed_slider_fraction"


class RtdeClient(Target):
    """What a hostile client says to the emulated controller: RTDE, programs, dashboard."""

    name = "rtde-server"

    def __init__(self) -> None:
        self._controller = build("cb3", None, Safety(0.1, 0.1), lambda _: None)
        self._now = 0.0
        self._sent = 0
        self._open()

    def _open(self) -> None:
        self._session = RtdeSession(self._controller, self._send, lambda _: None)

    def _send(self, data: bytes) -> None:
        self._sent += len(data)

    def make(self, rng: random.Random) -> bytes:
        if rng.random() < 0.1:
            words = rng.choice(
                ("play", "stop", "power on", "brake release", "popup x", "load \u20ac", "")
            )
            return b"D" + changed(words.encode() or b"?", rng, 1)
        if rng.random() < 0.05:
            return b"P" + changed(b"def rtde_control():\n  servoj(1)\nend\n", rng)
        frames = b""
        for _ in range(rng.randint(1, 4)):
            kind = rng.choice([v for k, v in vars(MessageType).items() if k.isupper()] + [0, 255])
            frames += frame(kind, self._payload(kind, rng))
        return b"R" + (frames if rng.random() < 0.95 else changed(frames, rng, 1))

    def _payload(self, kind: int, rng: random.Random) -> bytes:
        names = _RECIPE if rng.random() < 0.7 else rng.choice(("", ",,", "timestamp", "x" * 5000))
        match kind:
            case MessageType.SETUP_OUTPUTS:
                names = "timestamp,target_q" if rng.random() < 0.5 else names
                made = struct.pack(">d", number(rng)) + names.encode()
            case MessageType.SETUP_INPUTS:
                made = names.encode()
            case MessageType.DATA_PACKAGE:
                values = struct.pack(">diId", number(rng), rng.randint(-99, 99), 1, number(rng))
                made = bytes((rng.choice((0, 1, 1, 1, 2, 255)),)) + values
            case _:
                made = rng.randbytes(rng.randrange(5))
        return made if rng.random() < 0.8 else changed(made or b"x", rng, 2)

    def feed(self, data: bytes) -> bool:
        kind, body = data[:1], data[1:]
        self._now += self._controller.dt
        refused = False
        if kind == b"D":
            dashboard.answer(body.decode("utf-8", "replace"), self._controller, self._now)
        elif kind == b"P":
            self._controller.load_script(body.decode("utf-8", "replace"))
        else:
            try:  # as the server does: what cannot be followed ends the connection
                self._session.receive(body, self._now)
            except (ValueError, struct.error):
                refused = True
                self._session.close()
                self._open()
        self._controller.tick(self._now)
        self._session.package()
        self._controller.advance(self._now)
        numbers = [*self._controller.motion.pose, self._controller.slider]
        if not np.isfinite(numbers).all() or not 0.0 <= self._controller.slider <= 1.0:
            raise OutOfLimitsError(f"the emulated arm is at {numbers}")
        return not refused


def wire_targets() -> list[type[Target]]:
    """All of them."""
    return [Serial, MidiTarget, RtdeController, RtdeClient]
