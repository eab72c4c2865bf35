"""Configuration with provenance: every number in ``config/`` carries its unit and its source.

A section of a file is described by a pydantic model whose numeric fields are made with
:func:`quantity`. In YAML such a field reads ``{value: 0.25, unit: m/s, source: "data sheet, p.
3"}``; the loader checks that unit and source are there and that the unit is the one the model
declares, and hands plain numbers to the model.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pianobot_ros.cell.errors import ConfigError, unknown_name
from pianobot_ros.cell.numbers.bounded_files import parse_yaml, read_bytes, regular_file

__all__ = [
    "Section",
    "SpringDamper",
    "checked",
    "config_dir",
    "config_file",
    "configured",
    "first_problem",
    "load_provenance",
    "load_section",
    "load_yaml",
    "quantity",
]


class Section(BaseModel):
    """Base of every configuration section: immutable, strict about names, all numbers finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


M = TypeVar("M", bound=Section)

_QUANTITY_KEYS = frozenset({"value", "unit", "source", "note", "alternatives"})


def quantity(unit: str, *, low: float | None = None, high: float | None = None) -> Any:
    """A number, or list or mapping of numbers, in ``unit``. ``low`` and ``high`` bound a scalar,
    inclusive.
    """
    return Field(ge=low, le=high, json_schema_extra={"unit": unit})


class SpringDamper(Section):
    """A linear spring and damper that act along a line."""

    stiffness: float = quantity("N/m", low=0.0)
    damping: float = quantity("N*s/m", low=0.0)


def config_dir() -> Path:
    """Directory of the configuration in force.

    ``PIANOBOT_CONFIG`` if set; else ``config/`` of the source tree; else the installed
    ``share/pianobot_ros/config`` of the ament prefixes or of this Python. Raises
    :class:`ConfigError` if there is none.
    """
    if chosen := os.environ.get("PIANOBOT_CONFIG"):
        path = Path(chosen)
        if not path.is_dir():
            raise ConfigError(
                f"PIANOBOT_CONFIG is '{chosen}', which is not a directory: point it at a copy of"
                " config/"
            )
        return path
    source = Path(__file__).resolve().parents[3] / "config"
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p] + [
        Path(sys.prefix)
    ]
    for path in [source, *(p / "share" / "pianobot_ros" / "config" for p in prefixes)]:
        if path.is_dir():
            return path
    raise ConfigError(
        "no configuration found: set PIANOBOT_CONFIG to a copy of the project's config/ directory"
    )


def config_file(name: str) -> Path:
    """Path of the file ``name`` in :func:`config_dir`, which must exist."""
    path = config_dir() / name
    if reason := regular_file(path):
        raise ConfigError(f"configuration file '{name}' in {path.parent} {reason}")
    return path


def load_yaml(path: str | Path) -> dict[str, Any]:
    """The mapping in a YAML file. Raises :class:`ConfigError` with the line for broken YAML."""
    return parse_yaml(read_bytes(path), str(path))


def load_section(path: str | Path, model: type[M], key: str | None = None) -> M:
    """Load a section from a YAML file into ``model``.

    ``path`` is a file, or the name of one in :func:`config_dir`; ``key`` picks one section of it.
    Raises :class:`ConfigError` in one line for unknown names, missing units or sources, wrong units
    and values out of range.
    """
    file = _find(path)
    data: Any = load_yaml(file)
    where = file.name
    if key is not None:
        if key not in data:
            raise ConfigError(f"{where}: " + unknown_name("section", key, map(str, data)))
        data, where = data[key], f"{file.name}: {key}"
    try:
        return checked(model, _plain(data, model, where))
    except ValidationError as error:
        raise ConfigError(f"{where}: {first_problem(error)}") from error


def configured(path: str, model: type[M], key: str | None = None) -> Callable[[], M]:
    """A function that gives a section of the configuration in force, which is read once (see
    :func:`load_section`).
    """
    return cache(partial(load_section, path, model, key))


def checked(model: type[M], data: Any) -> M:
    """``data``, as YAML gives it, in ``model``: a truth value is no number, a text neither. Raises
    pydantic's ValidationError.
    """
    # As JSON, since only there pydantic takes a list for a tuple although it is strict.
    return model.model_validate_json(json.dumps(data), strict=True)


def first_problem(error: ValidationError) -> str:
    """Field and reason of the first of pydantic's complaints."""
    first = error.errors()[0]
    at = ".".join(str(part) for part in first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    return f"{at}: {message}" if at else message


def _find(path: str | Path) -> Path:
    """A file as it was given, else the one of that name in the configuration."""
    found = Path(path)
    if found.is_absolute() or regular_file(found) != "does not exist":
        return found
    return config_file(str(path))


def load_provenance(path: str | Path) -> dict[str, dict[str, Any]]:
    """Every quantity of a file by dotted name, with its ``value``, ``unit``, ``source`` and any
    ``note``. Raises :class:`ConfigError` for values that are no numbers.
    """
    file = _find(path)
    found: dict[str, dict[str, Any]] = {}

    def walk(node: Any, name: str) -> None:
        if _is_quantity(node):
            _check_numbers(node, f"{file.name}: {name}")
            found[name] = dict(node)
        elif isinstance(node, Mapping):
            for key, child in node.items():
                walk(child, f"{name}.{key}" if name else str(key))

    walk(load_yaml(file), "")
    return found


def _is_quantity(node: Any) -> bool:
    return isinstance(node, Mapping) and "value" in node


def _plain(node: Any, annotation: Any, where: str) -> Any:
    """``node`` with each quantity replaced by its value, after its unit and source were checked
    against ``annotation``.
    """
    annotation = _of_optional(annotation)
    if isinstance(node, list):
        return [
            _plain(child, _value_type(annotation), f"{where}[{i}]") for i, child in enumerate(node)
        ]
    if not isinstance(node, Mapping):
        return node
    if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
        inner = _value_type(annotation)
        return {name: _plain(child, inner, f"{where}: {name}") for name, child in node.items()}
    plain: dict[str, Any] = {}
    for name, child in node.items():
        field = annotation.model_fields.get(name)
        if field is None:
            raise ConfigError(
                f"{where}: " + unknown_name("name", str(name), annotation.model_fields)
            )
        at = f"{where}: {name}"
        extra = field.json_schema_extra
        unit = extra.get("unit") if isinstance(extra, dict) else None
        if _is_quantity(child):
            plain[name] = _checked_value(child, unit, at)
        elif unit is not None:
            raise ConfigError(
                f"{at} needs value, unit and source, as in {{value: 1.0, unit: {unit}, source: …}}"
            )
        else:
            plain[name] = _plain(child, field.annotation, at)
    return plain


def _of_optional(annotation: Any) -> Any:
    """T of ``T | None``; any other type as it is."""
    arguments = get_args(annotation)
    others = [a for a in arguments if a is not type(None)]
    return others[0] if len(others) == 1 < len(arguments) else annotation


def _value_type(annotation: Any) -> Any:
    """The type of the values of a ``dict[str, T]``, ``list[T]`` or ``tuple[T, ...]``; None if there
    is none.
    """
    arguments = [a for a in get_args(annotation) if a is not Ellipsis]
    inner = arguments[-1] if arguments else None
    return inner if get_args(inner) or isinstance(inner, type) else None


def _checked_value(child: Mapping[str, Any], wanted: Any, at: str) -> Any:
    for part in ("unit", "source"):
        if not str(child.get(part) or "").strip():
            raise ConfigError(
                f"{at} has no {part}: every number in config/ carries unit and source"
            )
    if unknown := set(child) - _QUANTITY_KEYS:
        name = min(map(str, unknown))
        raise ConfigError(f"{at}: " + unknown_name("key", name, _QUANTITY_KEYS))
    if wanted is not None and str(child["unit"]) != wanted:
        raise ConfigError(f"{at} is in '{child['unit']}' but must be in '{wanted}'")
    _check_numbers(child, at)
    return child["value"]


def _check_numbers(quantity: Mapping[str, Any], at: str) -> None:
    """Raise :class:`ConfigError` unless value and alternatives of a quantity are made of numbers: a
    truth value is none, a text neither.
    """

    def check(node: Any, at: str) -> None:
        if isinstance(node, Mapping):
            for name, child in node.items():
                check(child, f"{at}: {name}")
        elif isinstance(node, list):
            for i, child in enumerate(node):
                check(child, f"{at}[{i}]")
        elif isinstance(node, bool) or not isinstance(node, (int, float)):
            raise ConfigError(f"{at} is {json.dumps(node)[:40]}: give a number")

    check(quantity["value"], at)
    check(quantity.get("alternatives", []), f"{at}: alternatives")
