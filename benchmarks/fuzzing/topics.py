"""Messages of every topic that the graph subscribes to, as their decoders get them."""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np

from fuzzing.target import INTEGERS, OutOfLimitsError, Target, changed, number
from pianobot_ros.bags.message_types import Schema, typestore
from pianobot_ros.bags.raw_messages import RawMessage
from pianobot_ros.bags.reading.decode import BagDecoder
from pianobot_ros.cell.errors import CommandRejectedError
from pianobot_ros.cell.messages import columns
from pianobot_ros.cell.messages.command_checks import vacuum_setpoint, wrist_setpoint
from pianobot_ros.cell.messages.events import note_event, strike
from pianobot_ros.cell.messages.refusals import refusals
from pianobot_ros.cell.messages.samples import STREAMS
from pianobot_ros.cell.messages.stamps import seconds
from pianobot_ros.cell.motion.geometry import FINGERS
from pianobot_ros.cell.recordings.commands import CYCLE
from pianobot_ros.devices.wrist.config import UrConfig
from pianobot_ros.devices.wrist.limits.limiter import SetpointLimiter

_TYPES = {
    **{name: stream.type for name, stream in STREAMS.items()},
    "command/strike": "pianobot_msgs/msg/StrikeMark",
    "real/midi": "pianobot_msgs/msg/MidiEvent",
    "real/refusals": "diagnostic_msgs/msg/DiagnosticArray",
}
_PLACES: dict[str, list[columns.Place]] = {
    "wrist/state": [columns.wrist_place(axis) for axis in range(7)],
    "command/wrist": [columns.wrist_place(axis) for axis in range(7)],
    "vacuum/state": [columns.vacuum_place(finger) for finger in FINGERS],
    "command/vacuum": [columns.vacuum_place(finger, 0) for finger in FINGERS],
    "fsr": [columns.force_place],
    "key_angle": [columns.angle_place(64)],
}


_BITS = (8, 16, 32, 64)


class Topics(Target):
    """Messages with numbers that nobody meant, and bytes that are no message."""

    name = "topics"

    def __init__(self) -> None:
        self._store, self._decoder = typestore(), BagDecoder()
        self._names = sorted(_TYPES)
        config = UrConfig.load()
        self._config = config
        self._guard = SetpointLimiter(config.limits, config.workspace, CYCLE)
        self._now = 1.7e9
        self._guard.restart(np.array(config.mount.home), np.zeros(3), self._now)
        self._last = np.array(config.mount.home)

    def make(self, rng: random.Random) -> bytes:
        name = rng.choice(self._names) if rng.random() < 0.7 else "command/wrist"
        message = self._random(_TYPES[name], rng)
        data = bytes(self._store.serialize_cdr(message, _TYPES[name]))
        if rng.random() < 0.3:
            data = changed(data, rng, 3)
        return name.encode() + b"\n" + data

    def _random(self, kind: str, rng: random.Random) -> Any:
        """A message whose fields are drawn from what is plausible and what is not."""
        values = {}
        for field, described in self._store.fielddefs[kind][1]:
            values[field] = self._value(described, field, rng)
        return self._store.types[kind](**values)

    def _value(self, described: Any, field: str, rng: random.Random) -> Any:
        node, what = described
        match int(node):
            case 1:
                return self._base(what[0] if isinstance(what, tuple) else what, field, rng)
            case 2:
                return self._random(what, rng)
            case _:
                inner, size = what
                count = size if int(node) == 3 else rng.choice((0, 1, 3, 3, 3, 12))
                made = [self._value(inner, field, rng) for _ in range(count)]
                base = inner[1][0] if isinstance(inner[1], tuple) else inner[1]
                plain = int(inner[0]) == 1 and base != "string"
                return np.array(made, dtype=_DTYPES[base]) if plain else made

    def _base(self, base: str, field: str, rng: random.Random) -> Any:
        if base == "string":
            return rng.choice(
                (
                    "",
                    "",
                    "",
                    "base",
                    "base",
                    *FINGERS,
                    "x" * 300,
                    "\u20ac",
                    "a: /command/wrist",
                    "7",
                )
            )
        if base.startswith("float"):
            return self._float(field, rng)
        if base == "bool":
            return rng.random() < 0.5
        info = np.iinfo(_DTYPES[base])
        if field == "sec" and rng.random() < 0.7:
            return 1_700_000_000 + rng.randint(-2, 2)
        return min(max(rng.choice(INTEGERS), int(info.min)), int(info.max))

    def _float(self, field: str, rng: random.Random) -> float:
        if field == "w" and rng.random() < 0.6:
            return 1.0
        if field in "xyzw" and rng.random() < 0.7:
            return rng.choice((0.0, 0.0, 0.2, 0.3))
        return number(rng)

    def feed(self, data: bytes) -> bool:
        head, _, body = data.partition(b"\n")
        name = head.decode()
        self._columns(name, body)
        raw = RawMessage(f"/{name}", _TYPES[name], 0, 0, body, Schema("", "ros2msg", ""), "")
        try:
            message = self._decoder.decode(raw)
        except ValueError:
            return False
        if name == "real/refusals":
            return bool(refusals(message))
        if name == "real/midi":
            return note_event(message, 0.0) is not None
        if name == "command/strike":
            return strike(message, seconds(message.header.stamp)) is not None
        try:
            if name == "command/wrist":
                self._wrist(message)
            if name == "command/vacuum":
                vacuum_setpoint(message, FINGERS, self._now)
            rows = np.frombuffer(body, np.uint8)[None]
            message = self._decoder.layout(raw).columns(rows)
            return bool(STREAMS[name].table(message, 1)[1].all())
        except (ValueError, CommandRejectedError):
            return False

    def _columns(self, name: str, body: bytes) -> None:
        places = _PLACES.get(name.removeprefix("real/").removeprefix("sim/"))
        if places is not None and len(body) > 12:
            times, values = columns.table([body], places)
            assert len(times) == len(values) <= 1

    def _wrist(self, message: Any) -> None:
        self._now += CYCLE
        limits = self._config.limits
        setpoint = wrist_setpoint(message)
        sent = self._guard.limit(setpoint, self._now).setpoint
        step = float(np.linalg.norm(sent.position - self._last))
        self._last = sent.position
        low, high = self._config.workspace.low, self._config.workspace.high
        inside = np.all((sent.position >= low) & (sent.position <= high))
        # a late stream may catch up for as long as the limiter's slack
        fast = step > 1.05 * limits.speed * 0.06
        if not inside or fast or not math.hypot(*sent.rotation) < 1.05 * limits.tilt + 0.1:
            raise OutOfLimitsError(f"setpoint {sent}, step {step} m, inside {inside}")


_DTYPES = {
    **{f"{sign}int{bits}": np.dtype(f"{sign}int{bits}") for sign in ("u", "") for bits in _BITS},
    **{name: np.dtype(name) for name in ("float32", "float64", "bool")},
    **dict.fromkeys(("octet", "byte", "char"), np.dtype("int8")),
}
