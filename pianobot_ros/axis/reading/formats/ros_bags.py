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
from pianobot_ros.axis.reading.formats.table import Table
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
NAMING = ("name", "joint_names", "interface_names")
"""Fields whose words call what the arrays beside them hold."""


def bag_tables(path: Path) -> list[Table]:
    """A table for each topic that holds numbers; columns carry the joints' names."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    if path.suffix == ".mcap" and path.is_file() and (in_json := _in_json(path)):
        return in_json
    source = path
    if path.suffix in {".mcap", ".db3"} and (path.parent / "metadata.yaml").is_file():
        source = path.parent
    rows: dict[str, list[tuple[float, dict[str, float]]]] = defaultdict(list)
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
                values = dict(_numbers(message, planned))
                if values:
                    rows[connection.topic].append((_stamp(message, time), values))
    except GapError:
        raise
    except Exception as error:  # whatever a damaged bag makes the library throw
        text = " ".join(str(error).split())[:140]
        cut = path.suffix == ".mcap" or (path.is_dir() and any(path.glob("*.mcap")))
        mend = f"; if it broke off, pianobot bag repair {path.name} mends it" if cut else ""
        raise GapError(f"{path.name}: cannot be read as a bag ({text}){mend}") from None
    made = []
    for topic, held in rows.items():
        names = list(dict.fromkeys(k for _, v in held for k in v))
        columns = {"time": np.array([t for t, _ in held])}
        for name in names:
            columns[name] = np.array([v.get(name, math.nan) for _, v in held])
        made.append(Table(path, topic.strip("/"), columns, of_one_run=True))
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


def _numbers(
    message: Any, prefix: str = "", depth: int = 0, outer: Sequence[str] = ()
) -> Iterator[tuple[str, float]]:
    """Numbers of a message; arrays that go with its `name` or `joint_names`, or with the `outer`
    ones of what it is part of, are called by the joint, and so are the messages of a list. A time
    or duration within it (`time_from_start` of a point) is not when it was made.
    """
    names = _names(message) or outer
    for field in getattr(message, "__dataclass_fields__", {}):
        if field.startswith("__") or field in {"header", *NAMING}:
            continue
        value = getattr(message, field)
        label = f"{prefix}/{field}" if prefix else field
        if hasattr(value, "nanosec"):
            continue
        if isinstance(value, (bool, int, float, np.integer, np.floating)):
            yield label, float(value)
        elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "fiu":
            yield from _series(label, value, names)
        elif isinstance(value, list) and value and isinstance(value[0], (int, float)):
            yield from _series(label, np.array(value, float), names)
        elif hasattr(value, "__dataclass_fields__") and depth < DEEP:
            yield from _numbers(value, label, depth + 1, names)
        elif isinstance(value, list) and depth < DEEP:
            for own, inner in _listed(label, value, names):
                yield from _numbers(inner, own, depth + 1, names)


def _listed(label: str, messages: Sequence[Any], names: Sequence[str]) -> Iterator[tuple[str, Any]]:
    """The messages of a list, each called by the joint that it is of, or by its place; one alone,
    as the point of a trajectory that is streamed, is of all joints. The points of a whole
    trajectory are of times to come, and places of bodies (`geometry_msgs`) are no joint's.
    """
    inner = [m for m in messages[:MOST] if hasattr(m, "__dataclass_fields__")]
    inner = [m for m in inner if not m.__msgtype__.startswith(BODIES)]
    if len(inner) == 1:
        yield label, inner[0]
    elif not any(hasattr(m, "time_from_start") for m in inner):
        called = len(names) == len(messages) == len(inner)
        for k, message in enumerate(inner):
            yield (f"{label}/{names[k]}" if called else f"{label}[{k}]"), message


def _series(label: str, values: Any, names: Sequence[str]) -> Iterator[tuple[str, float]]:
    if values.size > MOST:
        return
    for k, x in enumerate(values):
        plain = f"{label}[{k}]" if values.size > 1 else label
        yield (f"{label}/{names[k]}" if k < len(names) == values.size else plain), float(x)


def _names(message: Any) -> list[str]:
    for field in NAMING:
        held = getattr(message, field, None)
        if isinstance(held, list) and held and all(isinstance(n, str) for n in held):
            return held
    return []
