"""Every table of a file, whatever its format."""

from __future__ import annotations

from pathlib import Path

from pianobot_ros.axis.reading.formats.arrays.channels import channel_tables, described
from pianobot_ros.axis.reading.formats.table import Table, thinned
from pianobot_ros.gap.problem.errors import GapError

__all__ = ["REFUSED", "SUFFIXES", "kind_of", "tables_of"]

SUFFIXES = {
    "text": (".csv", ".tsv", ".txt", ".dat", ".log", ".asc", ".out", ".lvm", ".gz", ".yaml"),
    "arrays": (".npz", ".npy", ".mat", ".parquet", ".feather", ".arrow", ".h5", ".hdf5"),
    "groups": (".tdms",),
    "json": (".json", ".jsonl", ".ndjson"),
    "bags": (".mcap", ".db3", ".bag"),
}

_PICKLED = (
    "pickled files may run any code and are not read; save the arrays with numpy.savez or as CSV"
)
_STORE = "Zarr stores are not read; save the arrays with numpy.savez(name, **dict(group.arrays()))"
_MDF = "MDF files are not read; save them as Parquet: asammdf.MDF(name).export('parquet')"
_SHEET = "spreadsheets are not read; export the sheet as CSV"
_PACKED = "is packed; unpack it, and give what was in it (a bag with its metadata.yaml)"
REFUSED = {
    **dict.fromkeys((".zip", ".7z", ".rar", ".tar", ".tgz", ".bz2", ".xz"), _PACKED),
    **dict.fromkeys((".zst", ".zstd", ".lz4"), _PACKED),
    **dict.fromkeys((".pt", ".pth", ".pkl", ".pickle"), _PICKLED),
    **dict.fromkeys((".xlsx", ".xls", ".ods"), _SHEET),
    **dict.fromkeys((".mf4", ".mdf"), _MDF),
    ".zarr": _STORE,
}
"""Why files with these endings are not read, and what to do."""


def kind_of(path: Path) -> str:
    """text, arrays, groups, json, bags, or "" for what is no log."""
    suffixes = [s.lower() for s in path.suffixes[-2:]]
    if suffixes[-1:] == [".gz"]:
        suffixes = suffixes[:-1]
    last = suffixes[-1] if suffixes else ""
    return next((kind for kind, ends in SUFFIXES.items() if last in ends), "")


def tables_of(path: Path) -> list[Table]:
    """Every table of a file. Raises GapError in one line if it cannot be read."""
    if not path.exists():
        raise GapError(f"{path}: no such log")
    kind = kind_of(path)
    if path.is_file() and path.stat().st_size == 0:
        raise GapError(f"{path.name}: the file is empty")
    if said := REFUSED.get(path.suffix.lower()):
        raise GapError(f"{path.name}: {said}")
    if kind == "bags" or path.is_dir():
        from pianobot_ros.axis.reading.formats.ros_bags import bag_tables as read
    elif kind == "arrays":
        from pianobot_ros.axis.reading.formats.arrays.binary import array_tables as read
    elif kind == "groups":
        from pianobot_ros.axis.reading.formats.arrays.tdms import tdms_tables as read
    elif kind == "json":
        from pianobot_ros.axis.reading.formats.json import json_tables as read
    elif described(path):
        read = channel_tables
    else:
        from pianobot_ros.axis.reading.formats.text import text_tables as read
    tables = read(path)
    if kind == "arrays":
        from pianobot_ros.axis.reading.formats.arrays.told_beside import as_told_beside

        tables = as_told_beside(path, tables)
    return [thinned(t) for t in tables]
