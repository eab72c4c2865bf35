"""Documents name files, modules and headings that are there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pianobot_ros"
# The changelog says what things were called when they changed.
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
SOURCES = [
    *DOCUMENTS,
    *(
        p
        for folder in ("pianobot_ros", "benchmarks", "tools", "launch")
        for p in sorted((ROOT / folder).rglob("*.py"))
    ),
]
DOTTED = re.compile(r"(?<![\w/.-])pianobot_ros(?:\.(?!__)\w*[a-z]\w*)+")
FROM_ROOT = re.compile(
    r"(?<![\w/.~-])(?:pianobot_ros|tests|benchmarks|tools|config|docs|launch|msg_schemas)/[\w/.*-]+"
)
# A module or a folder: in a document by its path from the project's folder, from the package's or
# from the document; in code by the end of it.
IN_CODE = re.compile(r"`+([a-z_]\w*(?:/\w+)+(?:\.py|/))`+")
LINK = re.compile(r"\]\(((?!https?:|mailto:)[^)\s]+)\)")


def exists(dotted: str) -> bool:
    """Whether a dotted name is a module of the package, or is named in one."""
    parts = dotted.split(".")[1:]
    place = PACKAGE
    while parts and any(
        (place / f).is_file() for f in (f"{parts[0]}/__init__.py", f"{parts[0]}.py")
    ):
        place = place / parts.pop(0)
    file = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    text = file.read_text(encoding="utf-8")
    return all(re.search(rf"\b{part}\b", text) for part in parts)


def found(place: str, source: Path) -> bool:
    """Whether files of that path, or in code of one that ends so, are there."""
    place = place.rstrip("./")
    if any((base / place).exists() for base in (ROOT, PACKAGE, source.parent)):
        return True
    if any(ROOT.glob(place)):
        return True
    if source in DOCUMENTS and place.endswith(".py"):
        return False
    inside = (PACKAGE, ROOT / "config", ROOT / "tests", ROOT / "benchmarks", ROOT / "docs")
    return any(p for base in inside for p in base.rglob(place))


def headings(document: Path) -> Iterator[str]:
    """The anchors of the headings of a document, as GitHub makes them."""
    for line in document.read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            words = re.sub(r"[^\w\- ]", "", line.lstrip("#").strip().lower())
            yield words.replace(" ", "-")


def read(path: Path) -> tuple[str, str]:
    return str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


def test_dotted_names_are_there() -> None:
    named = {(n, place) for place, text in map(read, SOURCES) for n in DOTTED.findall(text)}
    assert not sorted(n for n in named if not exists(n[0]))


def test_paths_are_there() -> None:
    lost = set()
    for source in SOURCES:
        place, text = read(source)
        named = {m[0] for m in FROM_ROOT.finditer(text) if text[m.end() : m.end() + 1] != "<"}
        named |= set(IN_CODE.findall(text))
        lost |= {(n, place) for n in named if not found(n, source)}
    assert not sorted(lost)


def test_links_lead_somewhere() -> None:
    lost = []
    for document in DOCUMENTS:
        here, text = read(document)
        for link in LINK.findall(text):
            place, _, anchor = link.partition("#")
            target = (document.parent / place).resolve() if place else document
            if not target.exists() or (anchor and anchor not in headings(target)):
                lost.append((link, here))
    assert not lost


def test_every_service_of_a_node_is_in_the_document_of_the_graph() -> None:
    made = re.compile(r"(?:create|add)_service\(\s*\w+,\s*\"~/(\w+)\"")
    files = sorted((PACKAGE / "nodes").rglob("*.py"))
    offered = sorted(name for p in files for name in made.findall(p.read_text(encoding="utf-8")))
    document = (ROOT / "docs" / "graph.md").read_text(encoding="utf-8")
    section = document.partition("\n## Services\n")[2].partition("\n## ")[0]
    told = re.findall(r"^\| `/\w+/(\w+)`", section, re.MULTILINE)
    assert offered and sorted(told) == offered
