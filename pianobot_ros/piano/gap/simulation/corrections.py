"""What a diagnosis found, as an overlay of the twin that a person can read and edit:
parameters and effects with values, intervals, units and where they come from.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.cell.numbers.bounded_files import Dumper, parse_yaml, read_bytes, yaml_text
from pianobot_ros.cell.numbers.config import config_file, load_provenance
from pianobot_ros.cell.numbers.whole_files import write_whole
from pianobot_ros.gap import Parameter
from pianobot_ros.piano.gap.effects import LIBRARY
from pianobot_ros.piano.gap.effects.base import states_of
from pianobot_ros.piano.gap.simulation.description import nuisances

__all__ = [
    "NOTHING",
    "Correction",
    "Corrections",
    "cell_id",
    "corrected_nuisances",
    "parse_corrections",
    "read_corrections",
    "write_corrections",
]

KIND = "corrections of the twin"
HEAD = """\
# Corrections of the twin: what a diagnosis found. `pianobot adopt` wrote this file.
# Values may be edited within their bounds and lines deleted; docs/adopt.md says what takes it.
# All of them are properties of the cell. What holds for one session alone is not in here.
"""
CELL_FILES = ("hand.yaml", "keyboard.yaml", "wrist_model.yaml", "calibration/stiffness.yaml")


@dataclass(frozen=True)
class Correction:
    """One number: ``value`` with its 95 % interval ``low`` to ``high``, in ``unit``."""

    value: float
    low: float = math.nan
    high: float = math.nan
    unit: str = "1"

    def __str__(self) -> str:
        return f"{self.value:.4g}" + (f" {self.unit}" if self.unit != "1" else "")

    def to_yaml(self) -> dict[str, Any]:
        """As a line of the overlay."""
        interval = {"low": self.low, "high": self.high}
        bounds = {n: _rounded(x) for n, x in interval.items() if math.isfinite(x)}
        return {"value": _rounded(self.value), **bounds, "unit": self.unit}


@dataclass(frozen=True)
class Corrections:
    """An overlay.

    ``parameters`` by name are factors on the nominal cell's; ``effects`` by family hold all their
    parameters that are properties of the cell (``StrikeLaw.states`` are not). ``cell`` is the
    fingerprint of the configuration that they correct; ``source`` says where they come from;
    ``open`` what they leave unexplained, in one line each; ``follows`` is the :attr:`identity` of
    the overlay that the twin had when this one was found (its values are whole nevertheless, not
    differences).
    """

    parameters: Mapping[str, Correction] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, Correction]] = field(default_factory=dict)
    cell: str = ""
    source: Mapping[str, Any] = field(default_factory=dict)
    open: tuple[str, ...] = ()
    follows: str = ""

    def __bool__(self) -> bool:
        """Whether there is anything to correct."""
        return bool(self.parameters or self.effects)

    @property
    def identity(self) -> str:
        """Digest of cell and values: two overlays that make the same twin have the same."""
        numbers = [self.cell, sorted((n, _rounded(x)) for n, x in self.values().items())]
        return hashlib.sha256(json.dumps(numbers).encode()).hexdigest()[:12] if self else ""

    def values(self) -> dict[str, float]:
        """Every number by name."""
        found = {n: c.value for n, c in self.parameters.items()}
        for own in self.effects.values():
            found |= {n: c.value for n, c in own.items()}
        return found

    def names(self) -> list[str]:
        """Every parameter and effect with its values, for people."""
        lines = [f"{n}={c}" for n, c in self.parameters.items()]
        for effect, own in self.effects.items():
            numbers = ", ".join(f"{n}={c}" for n, c in own.items())
            lines.append(f"{effect} ({numbers})")
        return lines

    def beside(self, effects: Mapping[str, Mapping[str, Correction]]) -> Corrections:
        """With these effects too. Raises :class:`ConfigError` for one that it has already."""
        for name in effects:
            if name in self.effects:
                raise ConfigError(f"the effect {name} is switched on already: leave one out")
        return replace(self, effects={**effects, **self.effects}, cell=self.cell or cell_id())

    def to_yaml(self) -> str:
        """The overlay's text."""
        body: dict[str, Any] = {"kind": KIND, "cell": self.cell, "source": dict(self.source)}
        if self.follows:
            body["follows"] = self.follows
        body["parameters"] = {n: c.to_yaml() for n, c in self.parameters.items()}
        body["effects"] = {
            effect: {n: c.to_yaml() for n, c in own.items()} for effect, own in self.effects.items()
        }
        if self.open:
            body["open"] = list(self.open)
        return HEAD + yaml_text(body, _Dumper, width=96)


NOTHING = Corrections()


def corrected_nuisances(corrections: Corrections) -> tuple[Parameter, ...]:
    """What is refitted with every candidate once ``corrections`` are adopted: the nuisances about
    their adopted values, and the parameters of the adopted effects, as wide as they were known.
    """
    values = corrections.values()
    found = [replace(p, nominal=values.get(p.name, p.nominal)) for p in nuisances()]
    for effect, own in corrections.effects.items():
        for p in LIBRARY[effect].parameters:
            c = own.get(p.name, Correction(p.nominal))
            width = (c.high - c.low) / 4.0
            sd = width / max(abs(c.value), 1e-300) if p.log else width
            known = min(max(sd, 0.1 * p.sd), p.sd) if sd > 0 else p.sd
            found.append(replace(p, nominal=c.value, sd=known))
    return tuple(found)


def cell_id() -> str:
    """Fingerprint of the numbers that describe the nominal cell, 12 hexadecimal digits."""
    numbers = {
        f"{name}: {key}": entry["value"]
        for name in CELL_FILES
        for key, entry in load_provenance(config_file(name)).items()
    }
    text = json.dumps(numbers, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def read_corrections(path: str | Path) -> Corrections:
    """The overlay in a file, checked (see :func:`parse_corrections`)."""
    return parse_corrections(read_bytes(path), str(path))


def parse_corrections(text: str | bytes, where: str = "corrections") -> Corrections:
    """The overlay in a YAML text called ``where``.

    States of a session among an effect's parameters are left out. Raises :class:`ConfigError` in
    one line for what is no overlay, one of another cell, unknown names and values outside their
    bounds.
    """
    data = parse_yaml(text, where)
    if data.get("kind") != KIND:
        raise ConfigError(f"{where} is no overlay: 'kind' must be '{KIND}'")
    known = {"kind", "cell", "source", "follows", "parameters", "effects", "open"}
    for name in data:
        if name not in known:
            raise ConfigError(f"{where}: " + unknown_name("name", str(name), known))
    cell = str(data.get("cell") or "")
    if cell != cell_id():
        raise ConfigError(
            f"{where} corrects another cell ({cell or 'none named'}; this one is {cell_id()}):"
            " diagnose a bag of this cell"
        )
    own = {p.name: p for p in nuisances()}
    parameters = _numbers(data.get("parameters"), own, f"{where}: parameters", "parameter")
    effects = {}
    for effect, numbers in _mapping(data.get("effects"), f"{where}: effects").items():
        if effect not in LIBRARY:
            raise ConfigError(f"{where}: " + unknown_name("effect", str(effect), LIBRARY))
        law = LIBRARY[effect]
        bounds = {p.name: p for p in law.parameters}
        found = _numbers(numbers, bounds, f"{where}: {effect}", "parameter")
        if law.magnitude not in found:
            raise ConfigError(f"{where}: {effect} lacks its magnitude '{law.magnitude}'")
        rest = {n: Correction(p.nominal, unit=p.unit) for n, p in bounds.items()}
        states = states_of(law)
        effects[effect] = {n: c for n, c in (rest | found).items() if n not in states}
    left = data.get("open") or []
    return Corrections(
        parameters,
        effects,
        cell,
        _mapping(data.get("source"), f"{where}: source"),
        tuple(str(x) for x in (left if isinstance(left, list) else [left])),
        str(data.get("follows") or ""),
    )


def write_corrections(corrections: Corrections, folder: str | Path) -> Path:
    """Write ``corrections.yaml`` into ``folder``. Raises :class:`ConfigError` where one is already,
    so that nothing is adopted twice by accident.
    """
    path = Path(folder) / "corrections.yaml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("x").close()  # of two that write at once one is refused
    except FileExistsError as error:
        raise ConfigError(
            f"{path} is there already: adopted before? remove it, or give another --output"
        ) from error
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error
    try:
        return write_whole(path, corrections.to_yaml())
    except ConfigError:
        path.unlink()
        raise


class _Dumper(Dumper):
    """Each number of the overlay on one line."""


def _one_line(dumper: yaml.SafeDumper, data: dict[Any, Any]) -> yaml.Node:
    flow = "value" in data
    return dumper.represent_mapping("tag:yaml.org,2002:map", data, flow_style=flow)


_Dumper.add_representer(dict, _one_line)


def _mapping(node: Any, where: str) -> dict[str, Any]:
    if node is None:
        return {}
    if not isinstance(node, dict):
        raise ConfigError(f"{where} must be a mapping of names to values")
    return {str(name): child for name, child in node.items()}


def _numbers(
    node: Any, bounds: Mapping[str, Parameter], where: str, kind: str
) -> dict[str, Correction]:
    found = {}
    for name, entry in _mapping(node, where).items():
        if name not in bounds:
            raise ConfigError(f"{where}: " + unknown_name(kind, name, bounds))
        found[name] = _number(entry, bounds[name], f"{where}: {name}")
    return found


def _number(entry: Any, bound: Parameter, where: str) -> Correction:
    entry = entry if isinstance(entry, dict) else {"value": entry}
    _only(entry, ("value", "low", "high", "unit"), where)
    unit = entry.get("unit", bound.unit)
    if str(unit) != bound.unit:
        raise ConfigError(f"{where} is in '{unit}' but must be in '{bound.unit}'")
    for name in ("value", "low", "high"):
        x = entry.get(name, 0.0)
        if isinstance(x, bool) or not isinstance(x, (int, float)):
            raise ConfigError(f"{where}: {name} is no number")
    if "value" not in entry:
        raise ConfigError(f"{where} has no value")
    value = float(entry["value"])
    slack = 1e-6 * (bound.high - bound.low)  # what rounding to six digits may add
    if not bound.low - slack <= value <= bound.high + slack:
        raise ConfigError(
            f"{where} is {value:g}: it must be from {bound.low:g} to {bound.high:g} {bound.unit}"
        )
    low, high = (float(entry.get(n, math.nan)) for n in ("low", "high"))
    return Correction(min(max(value, bound.low), bound.high), low, high, bound.unit)


def _only(entry: Mapping[str, Any], names: Iterable[str], where: str) -> None:
    for name in entry:
        if name not in names:
            raise ConfigError(f"{where}: " + unknown_name("key", str(name), names))


def _rounded(x: float) -> float:
    """Six significant digits: no interval is narrower, and people read it."""
    return float(f"{x:.6g}")
