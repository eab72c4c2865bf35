"""The profile of every run tries the same examples, whatever the process has done before."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


def drawn() -> list[int]:
    """Whole numbers as a property of this tree would be tried with."""
    seen = []

    @settings(settings.get_profile("pianobot"), max_examples=500)
    @given(st.integers())
    def take(number: int) -> None:
        seen.append(number)

    take()
    return seen


def test_examples_are_the_same_after_another_module_was_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = drawn()
    numbers = [1_000_003 * k for k in range(1, 200)]
    (tmp_path / "imported_meanwhile.py").write_text(f"NUMBERS = {numbers}\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("imported_meanwhile")
    after = drawn()
    assert len(before) == 500
    assert after == before
    assert not set(after) & set(numbers)
