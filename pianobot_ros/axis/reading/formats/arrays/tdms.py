"""LabVIEW's measurement files (TDMS): channels in groups, read by npTDMS."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from pianobot_ros.axis.reading.formats.arrays.binary import from_arrays, read_by, with_own_time
from pianobot_ros.axis.reading.formats.table import Table
from pianobot_ros.axis.reading.headers.unit_words import unit_of
from pianobot_ros.gap.problem.types import Array

__all__ = ["tdms_tables"]

UNIT = ("unit_string", "NI_UnitDescription", "Unit")
"""Properties by which LabVIEW, DAQmx and DIAdem state a channel's unit."""


def tdms_tables(path: Path) -> list[Table]:
    """Tables of every group: of channels that are waveforms, which state their own increment, and
    of those that are not. Raises GapError in one line where the file is damaged.
    """
    return read_by(_tables, path)


def _tables(path: Path) -> list[Table]:
    from nptdms import TdmsFile

    made: list[Table] = []
    with TdmsFile.open(path) as file:
        groups = [g for g in file.groups() if g.channels()]
        for group in groups:
            name = path.stem if len(groups) == 1 else f"{path.stem} {group.name}"
            made += _of_group(path, name, group.channels())
    return made


def _of_group(path: Path, name: str, channels: list[Any]) -> list[Table]:
    plain: dict[str, Array] = {}
    waveforms: dict[str, tuple[Array, Any]] = {}
    for c in channels:
        if c.properties.get("wf_increment", 0.0) > 0.0:
            waveforms[c.name] = c.time_track(), c[:]
        else:
            plain[c.name] = c[:]
    units = {c.name: u for c in channels if (u := _unit(c.properties))}
    made = [*from_arrays(path, name, plain), *with_own_time(path, name, waveforms)]
    return [replace(t, units={h: u for h, u in units.items() if h in t.columns}) for t in made]


def _unit(properties: Any) -> str:
    stated = next((str(properties[key]) for key in UNIT if properties.get(key)), "")
    return unit_of(stated)
