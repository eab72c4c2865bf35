"""Tables in text: any separator, decimal commas, lists in cells, dates, preambles, rows of units.

A file is read in pieces, so its memory is that of its numbers.
"""

from __future__ import annotations

import csv
import gzip
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, zip_longest
from pathlib import Path

import numpy as np

from pianobot_ros.axis.reading.formats.held import Held, rows_of
from pianobot_ros.axis.reading.formats.lines.bottles import as_dumped, without_brackets
from pianobot_ros.axis.reading.formats.lines.echoed import as_joint_state, without_documents
from pianobot_ros.axis.reading.formats.lines.labelled import without_labels
from pianobot_ros.axis.reading.formats.lines.markup import without_elements
from pianobot_ros.axis.reading.formats.lines.messages import messages
from pianobot_ros.axis.reading.formats.lines.values import (
    BRACKETS,
    LIST,
    comment,
    compact,
    joints_of,
    measured,
    number,
    stamp,
)
from pianobot_ros.axis.reading.formats.lines.wrapped import without_wrappers
from pianobot_ros.axis.reading.formats.table import FEWEST, Table, stem_of
from pianobot_ros.axis.reading.formats.time_file import clocks_of, with_own_clocks
from pianobot_ros.axis.reading.headers.meaning import meaning
from pianobot_ros.axis.reading.headers.unit_words import SECONDS, unit_of
from pianobot_ros.axis.reading.headers.words import eastern, tokens
from pianobot_ros.gap.problem.errors import GapError
from pianobot_ros.gap.problem.types import Array

PIECE = 65_536
"""Lines that are parsed at a time."""
UNITS = {"unit", "units", "einheit"}
"""What a row of units may call itself, also before each column."""
PERIOD = {"interval", "period", "increment"}
"""Words of a row that states the time from one sample to the next."""
LONG = 100
"""Numbers of a line from which on it may be a signal rather than a sample."""
HEAD = 400
"""Lines from which the form of the file is told."""
_WANTED = "give a row for each sample: time, position, velocity or torque, under a header"
_BEHIND = re.compile(r"(?<=\w)\s+\(.*\)$")
"""What a unit is of, behind it (TwinCAT's `mm (Length)`)."""
_ISO = re.compile(r"^\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(\.\d{1,9})?$")
_TIME = re.compile(r"\d:\d\d;\d{3}\s*,")
"""`10:00:50;123` in a row that commas separate."""
_COMMA = re.compile(r"^[-+]?\d*,\d+(?:[eE][-+]?\d+)?$")
_POINT = re.compile(r"^[-+]?\d*\.\d+(?:[eE][-+]?\d+)?$")
_THOUSANDS = re.compile(r"^[-+]?\d{1,3}(?:,\d{3})+(?:\.\d+)?$")
_DECIMAL = re.compile(r"^[-+]?\d+(?:,\d+)?(?:[eE][-+]?\d+)?$")
_RATE = re.compile(
    r"(?:rate|freq|fs|sampling)[^\d\n]*?(\d+(?:\.\d+)?)\s*(k?)hz|(?:rate|freq\w*)\W*hz\W*(\d+(?:\.\d+)?)",
    re.IGNORECASE,
)


def text_tables(path: Path) -> list[Table]:
    """The table of a text file; several where its channels have clocks of their own."""
    lines = _lines(path)
    first = list(islice(lines, HEAD))
    if heard := messages(path, stem_of(path), first, lines):
        return heard
    for form_of_lines in (
        without_wrappers,
        without_elements,
        without_documents,
        without_labels,
        without_brackets,
    ):
        first, lines = form_of_lines(first, lines)
    if any("\x00" in line for line in first):
        raise GapError(
            f"{path.name}: this is no text; CSV, MAT, NPZ, Parquet, HDF5, JSON and bags are read"
        )
    comments = [x for x in first if comment(x)]
    rows = [x for x in first if x.strip() and not comment(x)]
    rows = _upright(rows) or rows
    if len(rows) < 2:
        raise GapError(f"{path.name}: no rows below a header; {_WANTED}")
    form = form_of(rows)
    header, skip, units = form.header(rows, comments)
    names = _unique(header)
    body = chain(rows[skip:], (x for x in lines if x.strip() and not comment(x)))
    held = Held([n for n in names if meaning(n, names).quantity == "time"])
    while piece := list(islice(body, PIECE)):
        held.add(*form.parse(piece, names))
    columns, texts = held.columns(), held.texts
    size = rows_of(columns)
    texts = {k: v for k, v in texts.items() if len(v) == size}
    for key in [k for k, v in texts.items() if measured(v[:HEAD])]:
        if found := measured(texts[key]):
            values = [form.number(c) for c in found[0]]
            columns[key] = np.array([math.nan if v is None else v for v in values])
            units |= {key: found[1]} if found[1] else {}
            del texts[key]
    if not any(np.isfinite(c).any() for c in columns.values()):
        raise GapError(f"{path.name}: holds no numbers; {_WANTED}")
    name, headless = stem_of(path), header[0] == "column0"
    rate = _rate([*comments, *rows[:skip]]) or _every(form, rows[:skip])
    made = Table(path, name, columns, texts, units, joints_of(texts), rate, headless=headless)
    made = replace(made, notes=held.notes(), group=held.group)
    if clocks := clocks_of(made, dict(zip(names, header, strict=True))):
        return with_own_clocks(made, clocks, _unit_of(made.columns[clocks[0]], form, rows[:skip]))
    return [as_dumped(as_joint_state(made))]


def _upright(rows: Sequence[str]) -> list[str]:
    """The lines of a text that holds a signal in each of its few, long lines (row vectors), as a
    line for each sample; [] if it is none.
    """
    if not 0 < len(rows) < FEWEST:
        return []
    form = form_of(rows)
    cells = [(c := form.split(row))[: _reach(c)] for row in rows]
    width = len(cells[0])
    if width < max(LONG, 10 * len(rows)) or any(len(c) != width for c in cells):
        return []
    if any(form.number(c) is None for row in cells for c in row[1:]):
        return []
    return ["\t".join(sample) + "\n" for sample in zip(*cells, strict=True)]


def _unit_of(clock: Array, form: Form, above: Sequence[str]) -> str:
    """The unit of a clock in the first column, where a row above says it with the clock's period
    (`SampleTime[ms]`, 2). TwinCAT writes it with a decimal comma, whatever its numbers have.
    """
    step = float(np.nanmedian(np.diff(clock)))
    for cells in (form.split(row) for row in above):
        m = meaning(cells[0]) if cells else meaning("")
        periods = (number(".".join(cells[1:n]).replace(",", ".")) or 0.0 for n in (2, 3))
        near = any(abs(period - step) < 0.1 * step for period in periods)
        if m.quantity == "time" and m.unit in SECONDS and near:
            return m.unit
    return ""


def _rate(lines: Sequence[str]) -> float:
    """Hz, where the lines before the numbers state a rate; else 0."""
    for line in lines:
        if m := _RATE.search(line):
            return float(m[1] or m[3]) * (1e3 if m[2] else 1.0)
    return 0.0


def _every(form: Form, above: Sequence[str]) -> float:
    """Hz by the period that a row before the numbers states, or the one below its name: as scopes
    do (`Sample Interval,4e-09`, `Sampling time interval(ms),0.667`, Rigol's `Increment`); else 0.
    """
    cells = [form.split(row) for row in above]
    for k, row in enumerate(cells):
        for i, name in enumerate(row):
            if not PERIOD & set(tokens(name)) or form.number(name) is not None:
                continue
            below = cells[k + 1][i : i + 1] if k + 1 < len(cells) else []
            beside = row[i + 1 : i + 2]
            values = [y for c in (*beside, *below) if (y := form.number(c) or 0.0) > 0.0]
            unit = unit_of("".join(row[i + 2 : i + 3])) or meaning(name).unit
            if values:
                return 1.0 / (values[0] * SECONDS.get(unit, 1.0))
    return 0.0


def _lines(path: Path) -> Iterator[str]:
    with path.open("rb") as raw:
        mark = raw.read(4)
    opened = gzip.open if mark[:2] == b"\x1f\x8b" else open
    with opened(path, "rb") as raw:
        start = raw.read(100_000)
    encoding = "utf-16" if mark[:2] in (b"\xff\xfe", b"\xfe\xff") else _encoding(start)
    with opened(path, "rt", encoding=encoding, errors="replace", newline=None) as file:
        yield from file


def _encoding(start: bytes) -> str:
    """UTF-8, or a code page of older programs: the Eastern one in which words are known, else the
    Western one (a ° is one byte there).
    """
    whole = start[: start.rfind(b"\n") + 1]
    for page in ("utf-8-sig", "cp932", "gb18030"):
        try:
            text = whole.decode(page)
        except UnicodeDecodeError:
            continue
        if page == "utf-8-sig" or eastern(text):
            return page
    return "cp1252"


@dataclass(frozen=True)
class Form:
    """How a text is written: its separator and whether commas are decimal points."""

    separator: str
    comma: bool

    def split(self, line: str) -> list[str]:
        """Cells of a line."""
        line = line.rstrip("\r\n")
        if self.separator == " ":
            return _cells(line.strip(), " ")
        return [c.strip() for c in _cells(line, self.separator)]

    def number(self, cell: str) -> float | None:
        """Value of a cell, or None if it is no number."""
        if self.comma and "," in cell:
            cell = cell.replace(".", "").replace(",", ".")
        elif _THOUSANDS.match(cell):
            cell = cell.replace(",", "")
        return number(cell)

    def header(
        self, rows: Sequence[str], comments: Sequence[str]
    ) -> tuple[list[str], int, dict[str, str]]:
        """Headers, how many rows to skip, and units that a row of their own gives."""
        cells = [self.split(r) for r in rows[:60]]
        body = [self.split(r) for r in rows[len(rows) // 2 :][:60]]
        width = int(np.median([_reach(c) for c in body]))
        filled = [i for i in range(width) if self._filled(body, i)]
        full = [k for k, c in enumerate(cells) if len(c) >= width]
        first = next((k for k in full if self._data(cells[k], filled)), len(cells))
        for k in full:  # a preamble of names and values may come before the headers
            if first <= k < len(cells) - 1 and self._labels(cells, k, filled):
                first = next((j for j in full if j > k), len(cells))
        above = [k for k in full if k < first]
        if not above:
            wide = len(cells[first]) if first < len(cells) else width
            behind = self.split(comments[-1].lstrip().lstrip("#%/ ")) if comments else []
            behind = behind[1:] if len(behind) == wide + 1 else behind
            if len(behind) == wide and not self._data(behind, filled):
                return behind, first, {}
            return [f"column{i}" for i in range(wide)], first, {}
        given: list[str] = []
        if len(above) > 1:
            for k in above:
                stated = [unit_of(_BEHIND.sub("", c).strip("[](){} ")) for c in cells[k]]
                if len(stated) > 2 and all(u in SECONDS for u in stated[1:width]):
                    continue  # a scope's units along its screen
                called = any(stated) and UNITS & {c.lower() for c in cells[k]}
                if called or sum(map(bool, stated)) >= max(1, sum(map(bool, cells[k])) // 2):
                    given, above = stated, [j for j in above if j != k]
                    break
        of_units = [k for k in above if UNITS & set(tokens(cells[k][0]))]  # `Vertical Units,CH1:V`
        head = self._head([cells[k] for k in above if k not in of_units] or [cells[above[-1]]])
        names = [c.strip("'\" ") or f"column{i + 1}" for i, c in enumerate(head)]
        clocks = [k for k, (c, u) in enumerate(zip(head, given, strict=False)) if u in SECONDS]
        if len(clocks) == 1 and not head[clocks[0]].strip("'\" "):
            names[clocks[0]] = "time"  # a clock that nothing but its unit tells of
        return names, first, {h: u for h, u in zip(names, given, strict=False) if u}

    def _labels(self, cells: Sequence[Sequence[str]], k: int, filled: Sequence[int]) -> bool:
        """Whether row k holds words alone where the body holds values, for the first time."""
        there = [c for i in filled if (c := cells[k][i])]
        words = len(there) > 1 and not any(map(self._value, there))
        return words and 2 * len(there) > len(filled) and cells[k] not in cells[:k]

    def _head(self, above: Sequence[Sequence[str]]) -> Sequence[str]:
        """Headers from the rows above the numbers: the row that says most of its columns, of two
        the lower; or two rows together, where one alone does not tell the columns apart.
        """
        head, most = above[-1], -1
        for row in above:
            says = [c for c in row if meaning(c).quantity != "other"]
            if len(set(says)) >= max(most, 1):
                head, most = row, len(set(says))
        if (together := _told_apart(head, above)) is not head:
            return together
        if most > 0 and head is not above[-1]:  # labels beside `Label`, over the clock's own name
            below = [*above[-1], *head[len(above[-1]) :]]
            clock = [meaning(b).quantity == "time" for b in below]
            head = [
                b if t and meaning(a).quantity == "other" else a
                for a, b, t in zip(head, below, clock, strict=False)
            ]
        return head

    def _value(self, cell: str) -> bool:
        """Whether a cell holds a number, a list of numbers or a time."""
        if LIST.match(cell):
            return any(number(w) is not None for w in cell.translate(BRACKETS).split())
        return self.number(cell) is not None or stamp(cell) is not None

    def _filled(self, body: Sequence[Sequence[str]], i: int) -> bool:
        """Whether column i holds values in most rows of the body that have any there."""
        there = [c[i] for c in body if len(c) > i and c[i]]
        return bool(there) and sum(map(self._value, there)) > len(there) // 2

    def _data(self, cells: Sequence[str], filled: Sequence[int]) -> bool:
        """Whether a row holds values where the body does; labels may have a number among them."""
        there = [cells[i] for i in filled if i < len(cells) and cells[i]]
        return bool(there) and sum(map(self._value, there)) > len(there) / 2

    def parse(
        self, lines: Sequence[str], names: Sequence[str]
    ) -> tuple[dict[str, Array], dict[str, list[str]]]:
        """Columns of numbers (n,), and columns of words."""
        quick = self._quick(lines, len(names))
        if quick is not None:
            return {name: quick[:, i] for i, name in enumerate(names)}, {}
        rows = self._rows(lines)
        numbers: dict[str, Array] = {}
        words: dict[str, list[str]] = {}
        for i, name in enumerate(names):
            column = [r[i] if i < len(r) else "" for r in rows]
            made = self._column(name, column)
            if made is None:
                words[name] = column
            else:
                numbers.update(made)
        if not numbers:
            numbers = {"": np.full(len(rows), math.nan)}
        return numbers, words

    def _rows(self, lines: Sequence[str]) -> list[list[str]]:
        """Cells of every line; all at once where no quote runs over the end of a line."""
        if self.separator != " ":
            rows = list(csv.reader(lines, delimiter=self.separator, skipinitialspace=True))
            if len(rows) == len(lines):
                return [[c.strip() for c in r] for r in rows]
        return [self.split(line) for line in lines]

    def _quick(self, lines: Sequence[str], width: int) -> Array | None:
        if self.comma and self.separator == ",":  # decimals in quotes
            return None
        if any(map(compact, self.split(lines[0]))):
            return None
        text: Sequence[str] = [x.replace(",", ".") for x in lines] if self.comma else lines
        try:
            got = np.loadtxt(
                text,
                delimiter=None if self.separator == " " else self.separator,
                ndmin=2,
                comments=None,
            )
        except ValueError:
            return None
        return got if got.shape == (len(lines), width) else None

    def _column(self, name: str, cells: Sequence[str]) -> dict[str, Array] | None:
        filled = [c for c in cells if c]
        sample = filled[:: max(1, len(filled) // 100)]
        if sample and sum(LIST.match(c) is not None for c in sample) > len(sample) // 2:
            inside = [number(w) for c in sample[:5] for w in c.translate(BRACKETS).split()]
            words = bool(inside) and all(v is None for v in inside)
            if not words:
                return self._lists(name, cells)
        if sample and all(map(compact, sample)):  # which would be a number, without its last digits
            when = [stamp(c) for c in cells]
            return {name: np.array([math.nan if v is None else v for v in when])}
        if not any(self.number(c) is not None or stamp(c) is not None for c in sample):
            return None
        if (quick := self._at_once(cells, sample)) is not None:
            return {name: quick}
        values = [self.number(c) for c in cells]
        known = sum(v is not None for v in values)
        if known < 0.3 * max(len(filled), 1):
            values = [stamp(c) for c in cells]
            if sum(v is not None for v in values) <= 0.5 * max(len(filled), 1):
                return None
        return {name: np.array([math.nan if v is None else v for v in values])}

    def _at_once(self, cells: Sequence[str], sample: Sequence[str]) -> Array | None:
        """A column (n,) that holds nothing but numbers or nothing but plain ISO dates, quickly."""
        if any(stamp(c) is not None and self.number(c) is None for c in sample[:3]):
            if not all(_ISO.match(c) for c in sample):
                return None
            try:
                when = np.array(cells, "datetime64[ns]")
            except ValueError:
                return None
            seconds = when.astype(np.int64) / 1e9
            return np.where(np.isnat(when), math.nan, seconds)
        try:
            plain = [c.replace(",", ".") for c in cells] if self.comma else cells
            if any("_" in c for c in sample):
                return None
            return np.array([c or "nan" for c in plain], float)
        except ValueError:
            return None

    def _lists(self, name: str, cells: Sequence[str]) -> dict[str, Array]:
        split = [c.translate(BRACKETS).split() for c in cells]
        width = max((len(r) for r in split), default=0)
        if width == 0:
            return {name: np.full(len(split), math.nan)}
        try:
            table = np.array([w for r in split for w in r], float).reshape(len(split), width)
        except ValueError:  # ragged, or with words in it
            got = [[number(w) for w in r] for r in split]
            rows = [[math.nan if v is None else v for v in r] for r in got]
            table = np.array([r + [math.nan] * (width - len(r)) for r in rows])
        return {f"{name}[{k}]" if width > 1 else name: table[:, k] for k in range(width)}


def _told_apart(head: Sequence[str], above: Sequence[Sequence[str]]) -> Sequence[str]:
    """Headers with the rows over and under them, where the same stand several times (`Pos [deg]`)
    and these tell them apart (`Joint 1` over its columns, the others of which are empty).
    """
    said = {c for c in head if c and meaning(c).quantity == "time"}
    once = [c for c in head if c not in said]
    if len(set(once)) == len(once):
        return head
    at = next(k for k, row in enumerate(above) if row is head)
    made = list(head)
    for row in reversed(above[:at]):
        over = _over(row, made)
        made = over if len(set(over)) > len(set(made)) else made
    for row in above[at + 1 :]:
        under = _over(made, row)
        made = under if len(set(under)) > len(set(made)) else made
    if made == list(head):
        return head
    return _with_clock(made, above)


def _with_clock(made: list[str], above: Sequence[Sequence[str]]) -> list[str]:
    """Headers with the time that only another row says (an index of pandas)."""
    if any(meaning(c).quantity == "time" for c in made):
        return made
    clocks = ((k, c) for row in above for k, c in enumerate(row) if meaning(c).quantity == "time")
    k, clock = next(clocks, (-1, ""))
    return [clock if i == k else c for i, c in enumerate(made)]


def _over(upper: Sequence[str], lower: Sequence[str]) -> list[str]:
    """Two rows of headers as one; an empty cell of the upper is of the one before it."""
    out, last = [], ""
    for a, b in zip_longest(upper, lower, fillvalue=""):
        last = a or last
        out.append(f"{last if b else a} {b}".strip())
    return out


def _reach(cells: Sequence[str]) -> int:
    """How many cells a row has up to its last one that is filled: a separator may end it."""
    return max((k + 1 for k, c in enumerate(cells) if c), default=0)


def _cells(line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:  # a cell of more than a hundred thousand characters
        return line.split(separator)


def form_of(rows: Sequence[str]) -> Form:
    """The separator that splits most rows alike, and whether commas are decimal."""
    body = [_outside_quotes(r) for r in rows[len(rows) // 4 :][:80]]
    best, score = " ", 0.0
    for separator in (";", "\t", "|", ","):
        counts = [r.count(separator) for r in body]
        typical = int(np.median(counts)) if counts else 0
        same = sum(c == typical for c in counts) / max(len(counts), 1)
        if separator == ";" and all(map(_of_times, body)):
            continue
        if typical > 0 and same > score + 0.1:
            best, score = separator, same
    if best == "," and all(_DECIMAL.match(c) for r in body[-5:] for c in r.split()):
        best = " "
    cells = [c for r in rows[len(rows) // 4 :][:80] for c in Form(best, False).split(r)]
    points = any(_POINT.match(c) for c in cells)
    return Form(best, not points and any(_COMMA.match(c) for c in cells))


def _of_times(row: str) -> bool:
    """Whether the only semicolon is within a time, as in a trend of Rockwell's."""
    return row.count(";") == 1 < row.count(",") and _TIME.search(row) is not None


def _outside_quotes(line: str) -> str:
    line = re.sub(r'"[^"]*"', "x", line)
    return re.sub(r"[\[\(\{][^\[\]\(\)\{\}]*,[^\[\]\(\)\{\}]*[\]\)\}]", "x", line)


def _unique(header: Sequence[str]) -> list[str]:
    seen: dict[str, int] = {}
    out = []
    for name in header:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return out
