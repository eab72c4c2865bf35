"""Print what is too large or named twice: the figures that CONTRIBUTING.md sets limits for.

    python tools/house.py [FOLDER …]

Classes over 200 lines, functions over 60 (those that numba compiles are listed apart), functions
with more than 8 parameters (commands aside, whose parameters are options), classes and files that
share a name, folders with more than 9 rooms, modules that import each other in a circle, and lines
with ``fmt: skip``.
Without folders: ``pianobot_ros``, ``benchmarks`` and ``tools``.
"""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

CLASS_LINES, FUNCTION_LINES, PARAMETERS, ROOMS = 200, 60, 8, 9
COMPILED = ("njit", "jit", "vectorize", "guvectorize", "compiled")
# What does not count at the top of a package: its version, and the engine, which stands for itself.
BESIDE = ("__init__.py", "gap")
COMMON_FILES = ("__init__.py", "__main__.py")

Function = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass
class House:
    """Findings: a heading, and the lines below it."""

    classes: list[str] = field(default_factory=list)
    functions: list[str] = field(default_factory=list)
    kernels: list[str] = field(default_factory=list)
    parameters: list[str] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    names: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    files: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    def read(self, path: Path) -> None:
        """Add what ``path`` holds."""
        text = path.read_text(encoding="utf-8")
        if path.name not in COMMON_FILES:
            self.files[path.name].append(str(path))
        lines = enumerate(text.splitlines(), 1)
        self.skipped += [f"{path}:{n}" for n, line in lines if line.endswith("# fmt: skip")]
        tree = ast.parse(text)
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                self.names[node.name].append(f"{path}:{node.lineno}")
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                self._class(node, path)
            elif isinstance(node, Function):
                self._function(node, path)

    def _class(self, node: ast.ClassDef, path: Path) -> None:
        if (length := _length(node)) > CLASS_LINES:
            self.classes.append(f"{length:4} {path}:{node.lineno} {node.name}")

    def _function(self, node: ast.FunctionDef | ast.AsyncFunctionDef, path: Path) -> None:
        compiled = any(name in COMPILED for name in _decorators(node))
        if (length := _length(node)) > FUNCTION_LINES:
            found = f"{length:4} {path}:{node.lineno} {node.name}"
            (self.kernels if compiled else self.functions).append(found)
        count = _parameters(node)
        # A command's parameters are its options, each by a name of its own.
        command = "command" in _decorators(node)
        if count > PARAMETERS and not compiled and not command:
            self.parameters.append(f"{count:4} {path}:{node.lineno} {node.name}")


def _length(node: ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines from the first of the definition to its last, decorators aside."""
    return (node.end_lineno or node.lineno) - node.lineno + 1


def _decorators(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[str]:
    for decorator in node.decorator_list:
        called = decorator.func if isinstance(decorator, ast.Call) else decorator
        if isinstance(called, ast.Attribute):
            yield called.attr
        elif isinstance(called, ast.Name):
            yield called.id


def _parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Parameters that a caller may give, ``self`` and ``cls`` aside."""
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return sum(argument.arg not in ("self", "cls") for argument in given)


def is_room(path: Path) -> bool:
    """Whether a file or folder counts: a folder of modules or a module, an ``__init__.py`` only if
    it defines something.
    """
    if path.is_dir():
        return any(path.glob("*.py"))
    if path.name != "__init__.py":
        return path.suffix == ".py"
    handed_on = (ast.Import, ast.ImportFrom, ast.Expr)  # Expr: the docstring, a call
    return any(
        not isinstance(node, handed_on) and ast.unparse(node).split(" ")[0] != "__all__"
        for node in ast.parse(path.read_text(encoding="utf-8")).body
    )


def crowded(package: Path) -> list[str]:
    """Folders of ``package`` with more than ``ROOMS`` rooms; its own top if it is a package and not
    a folder of scripts, without what stands ``BESIDE``.
    """
    folders = sorted(p for p in package.rglob("*") if p.is_dir())
    if (package / "__init__.py").is_file():
        folders.insert(0, package)
    found = []
    for folder in folders:
        beside = BESIDE if folder == package else ()
        count = sum(is_room(path) for path in folder.iterdir() if path.name not in beside)
        if count > ROOMS:
            found.append(f"{count:4} {folder}")
    return found


def imported_modules(package: Path) -> dict[str, set[str]]:
    """Of every module of ``package`` those of it that it imports, wherever the import stands."""
    paths = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    found = {}
    for module, path in paths.items():
        names: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
                inside = {f"{node.module}.{alias.name}" for alias in node.names}
                names |= (inside & paths.keys()) or {node.module}
        found[module] = (names & paths.keys()) - {module}
    return found


def circles(imports: Mapping[str, Collection[str]]) -> list[list[str]]:
    """Modules that reach each other by imports, circle by circle (strongly connected parts)."""
    reached = {start: _reached(start, imports) for start in imports}
    rounds = {
        frozenset(b for b in reached[a] if a in reached[b]) for a in imports if a in reached[a]
    }
    return sorted(sorted(circle) for circle in rounds)


def _reached(start: str, imports: Mapping[str, Collection[str]]) -> set[str]:
    found: set[str] = set()
    front = [start]
    while front:
        new = set(imports[front.pop()]) - found
        found |= new
        front += new
    return found


def _homonyms(found: dict[str, list[str]]) -> list[str]:
    shared = {name: places for name, places in found.items() if len(places) > 1}
    return [
        f"{len(places):4} {name}: {', '.join(places)}" for name, places in sorted(shared.items())
    ]


def main() -> None:
    """Read the folders and print the findings."""
    house = House()
    full, rounds = [], []
    for folder in sys.argv[1:] or ("pianobot_ros", "benchmarks", "tools"):
        for path in sorted(Path(folder).rglob("*.py")):
            house.read(path)
        full += crowded(Path(folder))
        rounds += [", ".join(circle) for circle in circles(imported_modules(Path(folder)))]
    findings = {
        f"classes over {CLASS_LINES} lines": sorted(house.classes, reverse=True),
        f"functions over {FUNCTION_LINES} lines": sorted(house.functions, reverse=True),
        f"compiled functions over {FUNCTION_LINES} lines": sorted(house.kernels, reverse=True),
        f"functions with more than {PARAMETERS} parameters": sorted(house.parameters, reverse=True),
        "public classes of one name": _homonyms(house.names),
        "files of one name": _homonyms(house.files),
        f"folders of more than {ROOMS} rooms": full,
        "circles of imports": rounds,
        "fmt: skip": house.skipped,
    }
    for heading, lines in findings.items():
        print(f"{len(lines)} {heading}", *(f"  {line}" for line in lines), sep="\n")
    print("Total:", ", ".join(f"{len(lines)} {heading}" for heading, lines in findings.items()))


if __name__ == "__main__":
    main()
