"""What several benchmarks have in common: tables in Markdown, and the options of those that go
through many cells.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from pianobot_ros.cell.numbers.default_budgets import DIAGNOSIS_BUDGET


def table_row(cells: Iterable[object]) -> str:
    """One line of a table."""
    return "| " + " | ".join(map(str, cells)) + " |"


def table_head(names: Iterable[object]) -> list[str]:
    """The two lines that begin a table with these columns."""
    names = list(names)
    return [table_row(names), "|" + "---|" * len(names)]


def cells_parser(doc: str, cells: int, strikes: int) -> argparse.ArgumentParser:
    """Options of a benchmark that diagnoses so many cells by so many strikes unless told otherwise,
    keeps a line for each and writes a table.
    """
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("--cells", type=int, default=cells)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--strikes", type=int, default=strikes, help="of the first set")
    parser.add_argument("--budget", type=int, default=DIAGNOSIS_BUDGET, help="simulated strikes")
    parser.add_argument("--jobs", type=int, default=1, help="processes, each with a cell")
    parser.add_argument("--lines", type=Path, help="keeps the cells' lines; a run goes on there")
    parser.add_argument("--markdown", type=Path, help="the table is written here too")
    return parser
