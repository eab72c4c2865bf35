"""Tables in binary files: NumPy, MATLAB, Parquet, Feather and HDF5."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from pianobot_ros.axis.reading.formats.arrays.rates import RATES, STEPS, stated_rate
from pianobot_ros.axis.reading.formats.arrays.stacks import runs_apart
from pianobot_ros.axis.reading.formats.table import JOINTS, Table, grouped, some_of
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.unit_words import unit_of
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

CLOCKS = ("time", "Time", "timestamps")
"""What structures call the time of the signal beside it."""
_INDEXED = re.compile(r"\[\d+\]$")
OBJECTS = (
    "holds MATLAB objects (timeseries, tables), which only MATLAB opens; save their Time and Data"
    " as arrays, or the signals as structures with time"
)


CELLS = (
    "holds nothing but cells of arrays ({}); save the arrays of one run, with their time, as arrays"
    " of one length"
)
PICKLED = (
    "holds pickled objects, which may run any code and are not read; of your own file save the"
    " arrays: numpy.savez(name, **numpy.load(file, allow_pickle=True).item())"
)


def array_tables(path: Path) -> list[Table]:
    """Every table of a binary file."""
    suffix = path.suffix.lower()
    reader = {
        ".npz": _npz,
        ".npy": _npy,
        ".mat": _mat,
        ".parquet": _arrow,
        ".feather": _arrow,
        ".arrow": _arrow,
    }.get(suffix, _hdf5)
    return read_by(reader, path)


def read_by(reader: Callable[[Path], list[Table]], path: Path) -> list[Table]:
    """What ``reader`` makes of a file. Raises GapError where it cannot."""
    try:
        return reader(path)
    except GapError:
        raise
    except Exception as error:  # whatever a damaged file makes its library throw
        kind = path.suffix.lower()[1:]
        raise GapError(f"{path.name}: cannot be read as {kind} ({_short(error)})") from None


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


def from_arrays(path: Path, name: str, arrays: Mapping[str, Any]) -> list[Table]:
    """Tables of named arrays of any shape; scalars may give the rate, texts the joints' names."""
    numbers: dict[str, Array] = {}
    rate = 0.0
    joints: tuple[str, ...] = ()
    for key, value in arrays.items():
        x = np.asarray(value)
        word = key.rsplit("/", 1)[-1].lower()
        if x.dtype.kind in "USO" and _of_joints(word):
            joints = _names(x.ravel().tolist()) or joints
        if x.dtype.kind == "M":
            x = x.astype("datetime64[ns]").astype(np.int64) / 1e9
        if x.dtype.kind not in "fiub":
            continue
        if x.size == 1:
            only = float(x.ravel()[0])
            if word in RATES and only > 0:
                rate = only
            elif word in STEPS and only > 0:
                rate = 1.0 / only
            continue
        numbers[key] = x
    numbers, notes = runs_apart(path, numbers, joints)
    longest = max((x.size for x in numbers.values()), default=0)
    series: dict[str, Array] = {}
    for key, x in numbers.items():
        tall = x.T if x.ndim == 2 and x.shape[0] < x.shape[1] and x.shape[0] <= 32 else x
        if tall.ndim in (1, 2) and tall.shape[0] >= 2 and tall.size * 200 >= longest:
            series[key] = tall.astype(float)
    made = grouped(path, name, series, rate=rate, joints=joints, notes=notes)
    return [replace(t, headless=True) for t in made] if _nameless(series) and not joints else made


def _nameless(series: Mapping[str, Array]) -> bool:
    """Whether a file holds nothing but a matrix whose name says of no signal: a table whose columns
    have no headers.
    """
    return len(series) == 1 and all(
        x.ndim == 2 and x.shape[1] > 2 and meaning(key).quantity == "other"
        for key, x in series.items()
    )


def _of_joints(key: str) -> bool:
    """Whether a key is called like a list of joints' names."""
    return "joint" in key.lower() or "name" in key.lower()


def _names(held: Any) -> tuple[str, ...]:
    """Names in a list of texts, or in a text that commas divide; () if it is none."""
    texts = held.split(",") if isinstance(held, str) and "," in held else held
    listed = isinstance(texts, list) and 0 < len(texts) < JOINTS
    words = listed and all(isinstance(x, (str, bytes)) for x in texts)
    return tuple(_text(x).strip() for x in texts) if words else ()


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value).strip()


def _npz(path: Path) -> list[Table]:
    with np.load(path, allow_pickle=False) as held:
        plain = _without_pickles(held)
        if held.files and not plain:
            raise GapError(f"{path.name}: {PICKLED}")
        return from_arrays(path, path.stem, plain)


def _without_pickles(held: Any) -> dict[str, Any]:
    out = {}
    for key in held.files:
        try:
            out[key] = held[key]
        except ValueError:  # a pickled object, which is not opened
            continue
    return out


def _npy(path: Path) -> list[Table]:
    try:
        x = np.load(path, allow_pickle=False)
    except ValueError as error:
        raise GapError(f"{path.name}: {PICKLED}") if "pickle" in str(error) else error from None
    if x.dtype.names:
        return from_arrays(path, path.stem, {n: x[n] for n in x.dtype.names})
    if x.ndim > 2:  # runs side by side
        return from_arrays(path, path.stem, {path.stem: x})
    x = np.atleast_2d(np.asarray(x, float))
    x = x.T if x.shape[0] < x.shape[1] and x.shape[0] <= 64 else x
    columns = {f"column{i}": x[:, i] for i in range(x.shape[1])}
    return [Table(path, path.stem, columns, headless=True)]


def _mat(path: Path) -> list[Table]:
    from scipy.io import loadmat

    try:
        held = loadmat(path, squeeze_me=True, simplify_cells=True)
    except NotImplementedError:  # version 7.3 is HDF5
        return _hdf5(path)
    flat: dict[str, Any] = {}
    series: dict[str, tuple[Array, Any]] = {}
    _flatten("", {k: v for k, v in held.items() if not k.startswith("__")}, flat, series)
    made = [*from_arrays(path, path.stem, flat), *with_own_time(path, path.stem, series)]
    if not made and "__function_workspace__" in held:
        raise GapError(f"{path.name}: {OBJECTS}")
    cells = [key for key, value in flat.items() if np.asarray(value).dtype.kind == "O"]
    if not made and cells:
        raise GapError(f"{path.name}: {CELLS.format(some_of(cells, 6))}")
    return made


def with_own_time(path: Path, label: str, series: Mapping[str, tuple[Array, Any]]) -> list[Table]:
    """Signals that each have a time (n,) s of their own: a table for those that share it, called
    ``label`` or, where it is a single one, by its name.
    """
    made: list[Table] = []
    rest = dict(series)
    while rest:
        t, _ = next(iter(rest.values()))
        same = {k: v for k, (own, v) in rest.items() if np.array_equal(own, t)}
        rest = {k: v for k, v in rest.items() if k not in same}
        name = next(iter(same)) if len(same) == 1 else label
        made += from_arrays(path, name, {"time": t, **same})
    return made


def _flatten(
    prefix: str, value: Any, out: dict[str, Any], series: dict[str, tuple[Array, Any]]
) -> None:
    """Structures as `a.b`, arrays of them as `a[0].b`; the names of cells of texts are kept. What
    Simulink and others keep beside times of their own goes to `series`.
    """
    if _structures(value):
        for k, held in enumerate(value):
            own, data = _called(held, f"{prefix}[{k}]")
            _flatten(own, data, out, series)
    elif not isinstance(value, Mapping):
        out[prefix] = value
    else:
        _record(prefix, value, out, series)


def _called(held: Mapping[str, Any], place: str) -> tuple[str, Any]:
    """What a structure in an array calls itself, with its unit, and its data, as dSPACE's recorders
    write signals; else its place in the array and itself.
    """
    name, unit = (str(held.get(key, "")).strip() for key in ("Name", "Unit"))
    if not name or "Data" not in held or any(key in held for key in CLOCKS):
        return place, held
    return f"{name} [{unit}]" if unit_of(unit) else name, held["Data"]


def _record(
    prefix: str,
    value: Mapping[str, Any],
    out: dict[str, Any],
    series: dict[str, tuple[Array, Any]],
) -> None:
    t = np.asarray(next((value[k] for k in CLOCKS if k in value), None))
    inner = value.get("signals", value)
    signals = inner if _structures(inner) else [inner]
    found = [y for y in (_signal(s, t) for s in signals) if y is not None] if prefix else []
    names = [str(n) for n in np.atleast_1d(value.get("elements_names", ()))]
    for k, (y, label) in enumerate(found):
        own = label or str(value.get("Name") or (f"{prefix}[{k}]" if len(found) > 1 else prefix))
        own = own if own not in series else f"{prefix}[{k}]"
        rows = y.T if y.ndim == 2 and y.shape[0] == t.size else np.atleast_2d(y)
        if len(names) == len(rows) > 1:  # YARP's telemetry says whose each row is
            series |= {f"{own}.{n}": (t, row) for n, row in zip(names, rows, strict=True)}
        else:
            series[own] = t, y
    if not found:
        for key, held in value.items():
            _flatten(f"{prefix}.{key}" if prefix else str(key), held, out, series)


def _structures(value: Any) -> bool:
    several = isinstance(value, (list, np.ndarray)) and len(np.shape(value)) == 1
    return several and 0 < len(value) <= JOINTS and all(isinstance(x, Mapping) for x in value)


def _signal(held: Any, t: Array) -> tuple[Array, str] | None:
    """Values of a structure (n,) or (n, k) at times t (n,), and its label; None if it has none."""
    if not isinstance(held, Mapping) or t.dtype.kind != "f" or t.ndim != 1 or t.size < 2:
        return None
    key = next((k for k in ("values", "Data", "data", "Values") if k in held), "")
    y = np.squeeze(np.asarray(held.get(key)))
    if y.dtype.kind not in "fiub" or y.ndim not in (1, 2) or t.size not in y.shape:
        return None
    label = held.get("label")
    return y, label.strip() if isinstance(label, str) else ""


def _arrow(path: Path) -> list[Table]:
    import pyarrow as pa
    from pyarrow import feather, parquet

    table = parquet.read_table(path) if path.suffix == ".parquet" else feather.read_table(path)
    columns: dict[str, Array] = {}
    texts: dict[str, list[str]] = {}
    for name in table.column_names:
        column = table[name].combine_chunks()
        if pa.types.is_dictionary(column.type):  # words that come again and again
            column = column.dictionary_decode()
        kind = column.type
        if pa.types.is_timestamp(kind):
            columns[name] = column.cast(pa.timestamp("ns")).cast(pa.int64()).to_numpy() / 1e9
        elif pa.types.is_string(kind) or pa.types.is_large_string(kind):
            texts[name] = [str(x) for x in column.to_pylist()]
        elif pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind):
            flat = np.asarray(column.flatten().to_numpy(zero_copy_only=False), float)
            width = flat.size // max(len(column), 1)
            if width and width * len(column) == flat.size:
                for k in range(width):
                    columns[f"{name}[{k}]" if width > 1 else name] = flat.reshape(-1, width)[:, k]
        elif pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind):
            columns[name] = np.asarray(column.to_numpy(zero_copy_only=False), float)
    joints, rate = _lerobot(path)
    return [Table(path, path.stem, columns, texts, joints=joints, rate=rate)]


def _lerobot(path: Path) -> tuple[tuple[str, ...], float]:
    """Joint names and frame rate of a LeRobot data set, from `meta/info.json` above the file."""
    for folder in list(path.parents)[:4]:
        info = folder / "meta" / "info.json"
        if info.is_file():
            try:
                meta = json.loads(info.read_text(encoding="utf-8"))
                names = meta.get("features", {}).get("observation.state", {}).get("names") or ()
                names = names.get("motors", ()) if isinstance(names, dict) else names
                each = chain.from_iterable(n if isinstance(n, list) else [n] for n in names)
                joints = tuple(str(n).removesuffix(".pos") for n in each)
                return joints, float(meta.get("fps", 0.0))
            except (ValueError, AttributeError, TypeError):
                return (), 0.0
    return (), 0.0


def _hdf5(path: Path) -> list[Table]:
    import h5py

    arrays: dict[str, Any] = {}
    units: dict[str, str] = {}
    with h5py.File(path, "r") as file:

        def take(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.ndim <= 3 and item.size < 5e8:
                plain = item.dtype.kind in "fiubSOV" and not (
                    item.ndim == 3 and item.dtype == np.uint8
                )
                if plain and not name.startswith("#"):  # what MATLAB's objects consist of
                    value = item[()]
                    fields = item.dtype.names or ()  # of rows that are records
                    arrays.update({f"{name}/{f}": value[f] for f in fields} or {name: value})
                    units[name] = _unit_stated(item)

        file.visititems(take)
        rate, joints = _stated(file), _joints_stated(file, list(arrays))
        if not arrays and "#subsystem#" in file:
            raise GapError(f"{path.name}: {OBJECTS}")
    folders: dict[str, dict[str, Any]] = {}
    for name, value in _with_items(arrays).items():
        top = name.split("/", 2)
        key = "/".join(top[:2]) if len(top) > 2 and top[0] == "data" else ""
        folders.setdefault(key, {})[name[len(key) :].lstrip("/")] = value
    made: list[Table] = []
    for key, held in folders.items():
        label = f"{path.stem} {key.rsplit('/', 1)[-1]}".strip()
        for t in from_arrays(path, label, {"rate": rate} | held if rate else held):
            names = {h: f"{key}/{_INDEXED.sub('', h)}".lstrip("/") for h in t.columns}
            stated = {h: u for h, name in names.items() if (u := units.get(name, ""))}
            made.append(replace(t, units=stated, joints=t.joints or joints))
    return made


def _joints_stated(file: Any, names: Sequence[str]) -> tuple[str, ...]:
    """Names of the joints that an attribute lists, of the file, of a group, or of a data set of
    positions that is as wide; () if none does.
    """
    groups = [item for item in file.values() if hasattr(item, "keys")]
    of = [file[n] for n in names if n in file and meaning(n).role == "position"]
    for owner in (file, *groups, *of):
        for key, value in owner.attrs.items():
            plain = value.tolist() if hasattr(value, "tolist") else _plain(value)
            found = _names(plain) if _of_joints(key) else ()
            if found and (owner not in of or owner.shape[-1:] == (len(found),)):
                return found
    return ()


def _unit_stated(item: Any) -> str:
    """The unit that an attribute of a data set states, "" if none that is known."""
    told = {key.lower(): value for key, value in item.attrs.items()}
    stated = next((told[k] for k in ("unit", "units") if k in told), "")
    return unit_of(_text(stated)) if isinstance(stated, (str, bytes)) else ""


def _with_items(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Arrays by name; a block beside a list of its columns' names, as pandas stores a table, is an
    array for each.
    """
    out = dict(arrays)
    for key, names in arrays.items():
        block = key.removesuffix("_items") + "_values"
        values = np.asarray(out.get(block))
        if key.endswith("_items") and values.ndim == 2 and values.shape[1] == np.size(names):
            del out[block], out[key]
            columns = zip(np.ravel(names), values.T, strict=True)
            out |= {_text(name): column for name, column in columns}
    return out


def _stated(file: Any) -> float:
    """Hz that attributes of an HDF5 file or of its groups state, also in JSON; 0 if none."""
    groups = [item for item in file.values() if hasattr(item, "keys")]
    for owner in (file, *groups):
        told = {key: _plain(value) for key, value in owner.attrs.items()}
        for held in (told, *(v for v in told.values() if isinstance(v, Mapping))):
            if rate := stated_rate(held):
                return rate
    return 0.0


def _plain(value: Any) -> Any:
    """An attribute's value as Python has it; what is no JSON stays a text."""
    if isinstance(value, (str, bytes)):
        try:
            return json.loads(value)
        except (ValueError, RecursionError):
            return value
    return value.item() if isinstance(value, np.generic) else value
