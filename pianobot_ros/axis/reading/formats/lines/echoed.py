"""A `sensor_msgs/JointState` as `ros2 topic echo --csv` prints it: values without headers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pianobot_ros.axis.reading.formats.table import Table

__all__ = ["as_joint_state"]

ROLES = ("position", "velocity", "effort")


def as_joint_state(table: Table) -> Table:
    """The table with the headers of a JointState, if it looks like one: seconds and nanoseconds, a
    frame, the joints' names, then as many positions, velocities and efforts; else as it is.
    """
    if not table.headless or table.size < 2:
        return table
    heads = [f"column{k}" for k in range(len(table.columns) + len(table.texts))]
    words = [h for h in heads[3:] if h in table.texts and len(set(table.texts[h])) == 1]
    first = 3 + len(words)
    numbers = heads[first:]
    shares = len(numbers) // len(words) if words else 0
    if (
        words != heads[3:first]
        or not 1 <= shares <= len(ROLES)
        or len(numbers) != shares * len(words)
        or not all(h in table.columns for h in (*heads[:2], *numbers))  # no lists in cells
        or not _stamps(table)
    ):
        return table
    named = {f"{ROLES[k // len(words)]}[{k % len(words)}]": h for k, h in enumerate(numbers)}
    columns = {"sec": table.columns[heads[0]], "nanosec": table.columns[heads[1]]}
    columns |= {name: table.columns[h] for name, h in named.items()}
    note = f"no headers; taken as a JointState with {', '.join(ROLES[:shares])} of each joint"
    return replace(
        table,
        columns=columns,
        texts={},
        joints=tuple(table.texts[h][0] for h in words),
        notes=(*table.notes, note),
        headless=False,
    )


def _stamps(table: Table) -> bool:
    """Whether the first two columns are whole seconds and the nanoseconds beyond."""
    seconds, beyond = table.columns["column0"], table.columns["column1"]
    both = np.stack([seconds, beyond])
    return bool(
        np.all(both == np.round(both))
        and np.all(np.diff(seconds) >= 0)
        and np.all((beyond >= 0) & (beyond < 1e9))
        and float(np.max(beyond)) > 1e6
    )
