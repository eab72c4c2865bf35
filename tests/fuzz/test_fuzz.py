"""A short slice of ``benchmarks/fuzz.py``, the same frames each time; and that it finds a bug."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
NAMES = ["serial", "midi", "rtde-client", "rtde-server", "mcap"]
NAMES += ["yaml", "midi-files", "csv", "json", "topics"]


@pytest.fixture(scope="module")
def fuzz() -> Iterator[ModuleType]:
    sys.path.insert(0, str(BENCHMARKS))
    try:
        import fuzz

        yield fuzz
    finally:
        sys.path.remove(str(BENCHMARKS))


@pytest.fixture
def brake(fuzz: ModuleType) -> Iterator[None]:
    """An alarm gives up a frame, as in the benchmark, and not the test."""

    def ring(*_: object) -> None:
        raise fuzz.Hang

    before = signal.signal(signal.SIGALRM, ring)
    yield
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.usefixtures("brake")
def test_every_door_holds(fuzz: ModuleType, name: str) -> None:
    assert set(NAMES) == set(fuzz.TARGETS)
    kind = fuzz.TARGETS[name]
    outcome = fuzz.fuzz(kind, max(5, 200 // kind.cost), seed=7)
    crashes = [(what, text) for what, _, text in outcome.failures if what != "hang"]
    assert not crashes
    assert outcome.frames >= 5


def test_a_check_that_is_missing_is_found(fuzz: ModuleType) -> None:
    with fuzz.seeded_bug():
        outcome = fuzz.fuzz(fuzz.TARGETS["serial"], 2000, seed=7)
    assert outcome.count("limits") or outcome.count("crash")
