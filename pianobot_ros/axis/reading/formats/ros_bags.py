"""Tables in ROS bags (MCAP, rosbag2, ROS 1): joint states, controller states, plain numbers."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.reading.formats.json import message_tables
from pianobot_ros.axis.reading.formats.lines.values import RECEIVED
from pianobot_ros.axis.reading.formats.table import JOINTS, Table
from pianobot_ros.gap.problem.errors import GapError

OF_ROS = {"cdr", "ros1", "cdr_be", "cdr_le"}
"""How ROS writes messages."""
DEEP = 4
"""Nested messages are followed to this depth."""
MOST = 64
"""Numbers, or messages, of a list that are followed: more are a scan, or a plan."""
PLANNED = "/JointTrajectory"
"""How the type of a message ends that is sent to a controller."""
BODIES = "geometry_msgs/"
"""Package of messages on where bodies are."""
COMMON = {
    *("actionlib_msgs", "action_msgs", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs"),
    *("lifecycle_msgs", "map_msgs", "nav_msgs", "rcl_interfaces", "rosgraph_msgs", "sensor_msgs"),
    *("shape_msgs", "statistics_msgs", "std_msgs", "stereo_msgs", "tf2_msgs", "visualization_msgs"),
}
"""Packages of ROS itself, whose messages say what they are of: of a joint where they are called so;
and plain numbers (`data`), of whatever their topic is."""
IN_SI = ("sensor_msgs/", "trajectory_msgs/")
"""Packages in which a joint's position is in rad (or m), by their definition."""
PLACES = {"position", "positions"}
INTERFACES = "interface_names"
"""Field that tells the quantities of one joint."""
NAMING = ("name", "joint_names", INTERFACES)
"""Fields whose words call what the arrays beside them hold."""
NAMED = ("name", "joint_name")
"""Fields that name the joint that a message is of."""
CLOCK, OWN_CLOCK = "time", "own time"
"""Header of when a message was made, and of a field `time` within it, of whatever clock."""


def bag_tables(path: Path) -> list[Table]:
    """A table for each topic that holds numbers; columns carry the joints' names."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if path.suffix == ".mcap" and path.is_file() and (in_json := _in_json(path)):
        return in_json
    source = path
    if path.suffix in {".mcap", ".db3"} and (path.parent / "metadata.yaml").is_file():
        source = path.parent
    heard: dict[str, _Topic] = defaultdict(_Topic)
    try:
        with AnyReader([source], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            for connection, time, raw in reader.messages():
                if "Image" in connection.msgtype or "PointCloud" in connection.msgtype:
                    continue
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except Exception:  # a type whose definition the bag lacks
                    continue
                planned = "command" if connection.msgtype.endswith(PLANNED) else ""
                topic = heard[connection.topic]
                values = dict(topic.numbers(message, planned))
                if values:
                    topic.rows.append((_stamp(message, time), values))
    except GapError:
        raise
    except Exception as error:  # whatever a damaged bag makes the library throw
        text = " ".join(str(error).split())[:140]
        cut = path.suffix == ".mcap" or (path.is_dir() and any(path.glob("*.mcap")))
        mend = f"; if it broke off, pianobot bag repair {path.name} mends it" if cut else ""
        raise GapError(f"{path.name}: cannot be read as a bag ({text}){mend}") from None
    made = [topic.table(path, name) for name, topic in heard.items() if topic.rows]
    if not made:
        raise GapError(f"{path.name}: the bag holds no topic with numbers")
    return made


def _in_json(path: Path) -> list[Table]:
    """The tables of an MCAP file whose messages are JSON, [] if they are those of ROS. Raises
    GapError if they are written otherwise.
    """
    from mcap.reader import make_reader

    rows: dict[str, list[dict[str, Any]]] = defaultdict(list)
    written: set[str] = set()
    try:
        with path.open("rb") as file:
            reader = make_reader(file)
            summary = reader.get_summary()
            if summary is not None:
                written = {c.message_encoding for c in summary.channels.values()}
            if "json" in written:
                for _, channel, message in reader.iter_messages():
                    if channel.message_encoding == "json":
                        inner = json.loads(message.data, parse_int=float)
                        if isinstance(inner, dict):
                            rows[channel.topic].append({RECEIVED: 1e-9 * message.log_time, **inner})
    except Exception:  # damaged, whatever that makes the library throw: the reader of bags says how
        return []
    if not rows and written and not written & OF_ROS:
        raise GapError(
            f"{path.name}: its messages are written as {', '.join(sorted(written))}; those of ROS"
            " and in JSON are read"
        )
    return [t for topic, held in rows.items() for t in message_tables(path, topic, held)]


def _stamp(message: Any, logged: int) -> float:
    """Seconds at which a message was made: its header's stamp, else when it was received."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None and (stamp.sec or stamp.nanosec):
        return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
    return 1e-9 * logged


class _Topic:
    """What the messages of a topic held so far: their stamps and numbers, and what they say of
    these.
    """

    def __init__(self) -> None:
        self.rows: list[tuple[float, dict[str, float]]] = []
        self.owners: dict[str, str] = {}
        self.units: dict[str, str] = {CLOCK: "s"}
        self.foreign: set[str] = set()
        self.headers: set[str] = set()
        self.named: set[str] = set()

    def table(self, path: Path, topic: str) -> Table:
        """Its table; columns carry the joints' names."""
        names = dict.fromkeys(k for _, v in self.rows for k in v)
        columns = {CLOCK: np.array([t for t, _ in self.rows])}
        columns |= {k: np.array([v.get(k, math.nan) for _, v in self.rows]) for k in names}
        return Table(
            path,
            topic.strip("/"),
            columns,
            units=self.units,
            of_one_run=True,
            owners=self.owners,
            foreign=frozenset(self.foreign),
            clock=CLOCK,
        )

    def numbers(
        self,
        message: Any,
        prefix: str = "",
        depth: int = 0,
        outer: Sequence[str] = (),
        of: str = "",
    ) -> Iterator[tuple[str, float]]:
        """Numbers of a message; arrays that go with its `name` or `joint_names`, or with the
        `outer` ones of what it is part of, are called by the joint, and so are the messages of a
        list, and all that a message says `of` one joint. A time or duration within it
        (`time_from_start` of a point) is not when it was made.
        """
        names = _names(message) or outer
        if not of and (of := self._of_one(message)):
            prefix = f"{prefix}/{of}" if prefix else of
        for field in getattr(message, "__dataclass_fields__", {}):
            value = getattr(message, field)
            if field.startswith("__") or field in {"header", *NAMING} or hasattr(value, "nanosec"):
                continue
            label = f"{prefix}/{field}" if prefix else OWN_CLOCK if field == CLOCK else field
            if hasattr(value, "__dataclass_fields__") and depth < DEEP:
                yield from self.numbers(value, label, depth + 1, names, of)
            elif _holds_messages(value) and depth < DEEP:
                for called, joint, inner in _listed(label, value, names):
                    yield from self.numbers(inner, called, depth + 1, names, of or joint)
            else:
                for called, joint, x in _series(label, value, names):
                    named = of or ("" if hasattr(message, INTERFACES) else joint)
                    if called not in self.headers:
                        self._note(called, field, named, message.__msgtype__)
                    yield called, x

    def _of_one(self, message: Any) -> str:
        """The one joint that a message says it is of, "" if none: more names than a robot may have
        joints (of events, say) are no joints'.
        """
        name = _called(message)
        if len(self.named) < JOINTS:
            self.named.add(name)
        return name if name in self.named else ""

    def _note(self, header: str, field: str, joint: str, kind: str) -> None:
        """What the type of a message says of one of its numbers, and of which joint it is."""
        self.headers.add(header)
        if joint:
            self.owners[header] = joint
        if field in PLACES and kind.startswith(IN_SI):
            self.units[header] = "rad"
        if kind.partition("/")[0] in COMMON and "Joint" not in kind and field != "data":
            self.foreign.add(header)


def _holds_messages(value: Any) -> bool:
    return isinstance(value, list) and any(hasattr(m, "__dataclass_fields__") for m in value[:1])


def _listed(
    label: str, messages: Sequence[Any], names: Sequence[str]
) -> Iterator[tuple[str, str, Any]]:
    """The messages of a list with what each is called and the joint that it is of: as `names` or it
    itself says, or by its place; one alone, as the point of a trajectory that is streamed, is of
    all joints. The points of a whole trajectory are of times to come, and places of bodies
    (`geometry_msgs`) are no joint's.
    """
    inner = [m for m in messages[:MOST] if hasattr(m, "__dataclass_fields__")]
    inner = [m for m in inner if not m.__msgtype__.startswith(BODIES)]
    if len(inner) == 1:
        yield label, "", inner[0]
    elif not any(hasattr(m, "time_from_start") for m in inner):
        called = len(names) == len(messages) == len(inner)
        for k, message in enumerate(inner):
            joint = names[k] if called else ""
            place = label if _called(message) else f"{label}[{k}]"
            yield (f"{label}/{joint}" if called else place), joint, message


def _series(label: str, value: Any, names: Sequence[str]) -> Iterator[tuple[str, str, float]]:
    """The numbers of a field with what each is called and the joint that is named for it, if any;
    none of a long array, or of what is no number.
    """
    if isinstance(value, (bool, int, float, np.integer, np.floating)):
        yield label, "", float(value)
        return
    values = np.array(value) if isinstance(value, list) and value else value
    if not isinstance(values, np.ndarray) or values.ndim != 1 or values.dtype.kind not in "fiu":
        return
    called = len(names) == values.size
    for k, x in enumerate(values if values.size <= MOST else ()):
        plain = f"{label}[{k}]" if values.size > 1 else label
        yield (f"{label}/{names[k]}" if called else plain), names[k] if called else "", float(x)


def _names(message: Any) -> list[str]:
    for field in NAMING:
        held = getattr(message, field, None)
        if isinstance(held, list) and held and all(isinstance(n, str) for n in held):
            return held
    return []


def _called(message: Any) -> str:
    """What a message calls itself, "" if nothing."""
    said = (getattr(message, field, None) for field in NAMED)
    return next((name for name in said if isinstance(name, str) and name), "")
