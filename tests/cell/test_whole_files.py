"""Text files that are there whole or not at all."""

from __future__ import annotations

import contextlib
import os
import resource
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from pianobot_ros.cell.errors import ConfigError, RecordingError
from pianobot_ros.cell.numbers.whole_files import write_whole
from pianobot_ros.gap import Diagnosis
from pianobot_ros.gap.diagnosis import Closure
from pianobot_ros.piano.gap.diagnosis.diagnose import write_results
from pianobot_ros.piano.gap.simulation.corrections import (
    Correction,
    Corrections,
    cell_id,
    parse_corrections,
    write_corrections,
)


@contextlib.contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Writing beyond ``size`` bytes fails in the middle, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_of_a_file_that_does_not_fit_nothing_is_left(tmp_path: Path) -> None:
    with files_of_at_most(1000), pytest.raises(ConfigError, match=r"cannot write .*twin\.xml: \w"):
        write_whole(tmp_path / "twin.xml", 2000 * "x")
    assert list(tmp_path.iterdir()) == []


def test_what_was_there_stays_until_the_new_file_is_whole(tmp_path: Path) -> None:
    path = write_whole(tmp_path / "folder" / "state.json", "old")
    with files_of_at_most(1000), pytest.raises(ConfigError):
        write_whole(path, 2000 * "x")
    assert path.read_text() == "old"
    assert write_whole(path, "new").read_text() == "new"
    assert [p.name for p in path.parent.iterdir()] == ["state.json"]


def test_a_link_stays_one_and_a_pipe_is_written_into(tmp_path: Path) -> None:
    (tmp_path / "there").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "there")
    write_whole(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "there").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")
    heard: list[str] = []
    reader = threading.Thread(target=lambda: heard.append((tmp_path / "pipe").read_text()))
    reader.start()
    write_whole(tmp_path / "pipe", "told")
    reader.join(60)
    assert heard == ["told"] and (tmp_path / "pipe").is_fifo()


def test_an_overlay_that_did_not_fit_can_be_written_once_there_is_room(tmp_path: Path) -> None:
    found = Corrections({"joint_stiffness": Correction(1.2)}, {}, cell_id())
    with files_of_at_most(50), pytest.raises(ConfigError, match="cannot write"):
        write_corrections(found, tmp_path)
    path = write_corrections(found, tmp_path)
    assert parse_corrections(path.read_text()).parameters == found.parameters


def test_of_a_diagnosis_that_does_not_fit_nothing_is_left(tmp_path: Path) -> None:
    """Half a diagnosis.json is one that ``pianobot diagnose`` does not overwrite."""
    closure = Closure("rms", "1", 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    found = Diagnosis("none", "", (), (), ("none",), (), (), (), closure, (), None, (), 0.0)
    with files_of_at_most(4000), pytest.raises(RecordingError, match="cannot write the report"):
        write_results(found, tmp_path)
    assert list(tmp_path.iterdir()) == []
    write_results(found, tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"diagnosis.json", "report.html"}
