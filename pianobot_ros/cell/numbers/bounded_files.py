"""Files that people write, read within bounds: a regular file of bounded size, YAML of bounded
depth, plain values that are finite and of a sane size; and YAML written so that it is read as that.

Everything that a user hands in as YAML (configuration, parameters, phrases) comes through here, so
that whoever looks at the values need not fear for time, memory or recursion.
"""

from __future__ import annotations

import datetime
import re
from pathlib import Path
from typing import Any

import yaml

from pianobot_ros.cell.errors import ConfigError

__all__ = [
    "LARGEST",
    "LONGEST",
    "Dumper",
    "parse_yaml",
    "plain",
    "read_bytes",
    "regular_file",
    "title",
    "yaml_text",
]

LONGEST = 400_000
"""Bytes of a YAML text: thousands of strikes, read in about a second."""
DEEPEST = 40  # collections within one another
MOST = 100_000  # values of a text, aliases written out
LARGEST = 1e15
"""No number of a configuration is larger: not in any SI unit that it uses."""
WORDIEST = 10_000  # characters of one text


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """As PyYAML's safe one, but ``1e-3`` is a number, as in YAML 1.2, and dates are texts."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in pairs if tag != "tag:yaml.org,2002:timestamp"]
    for first, pairs in _Loader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+\Z"),
    list("-+.0123456789"),
)


class Dumper(yaml.SafeDumper):
    """As PyYAML's safe one, but what the loader above would take for a number is quoted: a text
    like ``6e29471``, which a commit may be called.
    """


Dumper.yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers


def yaml_text(data: Any, dumper: type[yaml.SafeDumper] = Dumper, width: int = 80) -> str:
    """``data`` as YAML that :func:`parse_yaml` reads as what it was, in the order given."""
    return str(yaml.dump(data, Dumper=dumper, sort_keys=False, allow_unicode=True, width=width))


def regular_file(path: Path) -> str:
    """Why ``path`` cannot be read as a file, as the end of a sentence; empty if it can."""
    try:
        if path.is_file():
            return ""
        if path.is_dir():
            return "is a directory, not a file"
        return "is a device or a pipe, not a file" if path.exists() else "does not exist"
    except (OSError, ValueError) as error:  # a name too long, or with a null character
        return f"cannot be looked up ({getattr(error, 'strerror', None) or error})"


def title(path: Path) -> str:
    """A name to show for what is in the file: its stem, as far as that prints."""
    return "".join(c if c.isprintable() else "?" for c in path.stem)[:200]


def read_bytes(path: str | Path, longest: int = LONGEST) -> bytes:
    """The content of a file of at most ``longest`` bytes. Raises :class:`ConfigError`."""
    path = Path(path)
    if reason := regular_file(path):
        raise ConfigError(f"{path} {reason}")
    try:
        with path.open("rb") as file:
            data = file.read(longest + 1)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    if len(data) > longest:
        raise ConfigError(f"{path} is longer than {longest} bytes: is it the right file?")
    return data


def parse_yaml(text: str | bytes, where: str) -> dict[str, Any]:
    """The mapping in a YAML text called ``where``: texts, finite numbers, truth values, lists and
    mappings. Raises :class:`ConfigError` in one line.
    """
    if len(text) > LONGEST:
        raise ConfigError(f"{where} is longer than {LONGEST} bytes: is it the right file?")
    try:
        if isinstance(text, bytes):
            text = text.decode("utf-8")
        _measure(text, where)
        data = yaml.load(text, _Loader)  # derived from the safe one
    except ConfigError:
        raise
    except Exception as error:
        # Not only YAMLError: for some texts PyYAML raises whatever its constructors meet.
        mark = getattr(error, "problem_mark", None)
        at = f" at line {mark.line + 1}" if mark else ""
        problem = " ".join(str(getattr(error, "problem", None) or error).split())[:200]
        raise ConfigError(f"{where} is not valid YAML{at}: {problem}") from error
    if not isinstance(data, dict):
        raise ConfigError(f"{where} must hold a mapping of names to values")
    plain(data, where)
    return data


def _measure(text: str, where: str) -> None:
    """Refuse what would take long or much room to build. An alias counts as what it stands for."""
    sizes: dict[str, int] = {}
    open_: list[tuple[str | None, int]] = []
    total = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.CollectionStartEvent):
            open_.append((event.anchor, total))
            total += 1
            if len(open_) > DEEPEST:
                at = f" at line {event.start_mark.line + 1}" if event.start_mark else ""
                raise ConfigError(f"{where}: more than {DEEPEST} levels deep{at}")
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_.pop()
            if anchor is not None:
                sizes[anchor] = total - before
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
        elif isinstance(event, yaml.AliasEvent):
            if any(anchor == event.anchor for anchor, _ in open_):
                raise ConfigError(f"{where}: '*{event.anchor}' stands for what it is part of")
            total += sizes.get(event.anchor or "", 1)
        if total > MOST:
            raise ConfigError(f"{where} holds more than {MOST} values")


def plain(node: Any, where: str) -> None:
    """Raise :class:`ConfigError` unless ``node`` is made of texts, finite numbers, truth values,
    None, lists and mappings with names, all of a sane size.
    """
    if isinstance(node, dict):
        for name, child in node.items():
            if isinstance(name, bool) or not isinstance(name, (str, int)):
                raise ConfigError(f"{where}: '{str(name)[:40]}' is no name")
            plain(name, where)
            plain(child, f"{where}: {str(name)[:80]}")
    elif isinstance(node, list):
        for i, child in enumerate(node):
            plain(child, f"{where}[{i}]")
    elif isinstance(node, str):
        if len(node) > WORDIEST or not node.replace("\n", " ").replace("\t", " ").isprintable():
            raise ConfigError(f"{where}: a text is too long, or has characters that do not print")
    elif isinstance(node, (int, float)):  # a truth value is an int too
        if not abs(node) <= LARGEST:
            size = node if isinstance(node, float) else "too large"  # to print
            raise ConfigError(f"{where} is {size}: give a finite number of a sane size")
    elif node is not None:
        kind = "a date" if isinstance(node, datetime.date) else f"a {type(node).__name__}"
        raise ConfigError(f"{where} is {kind}: give a text, a number, true or false")
