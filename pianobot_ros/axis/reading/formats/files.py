"""Every table of a file, whatever its format."""

from __future__ import annotations

from pathlib import Path

from pianobot_ros.axis.reading.formats.table import Table, thinned
from pianobot_ros.gap.problem.errors import GapError

__all__ = ["SUFFIXES", "kind_of", "tables_of"]

SUFFIXES = {
    "text": (".csv", ".tsv", ".txt", ".dat", ".log", ".asc", ".out", ".gz"),
    "arrays": (".npz", ".npy", ".mat", ".parquet", ".feather", ".arrow", ".h5", ".hdf5"),
    "json": (".json", ".jsonl", ".ndjson"),
    "bags": (".mcap", ".db3", ".bag"),
}


def kind_of(path: Path) -> str:
    """text, arrays, json, bags, or "" for what is no log."""
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
    if path.suffix.lower() in {".pt", ".pth", ".pkl", ".pickle"}:
        raise GapError(
            f"{path.name}: pickled files may run any code and are not read; save the arrays with"
            " numpy.savez or as CSV"
        )
    if path.suffix.lower() in {".xlsx", ".xls", ".ods"}:
        raise GapError(f"{path.name}: spreadsheets are not read; export the sheet as CSV")
    if kind == "bags" or path.is_dir():
        from pianobot_ros.axis.reading.formats.ros_bags import bag_tables as read
    elif kind == "arrays":
        from pianobot_ros.axis.reading.formats.arrays.binary import array_tables as read
    elif kind == "json":
        from pianobot_ros.axis.reading.formats.json import json_tables as read
    else:
        from pianobot_ros.axis.reading.formats.text import text_tables as read
    return [thinned(t) for t in read(path)]
