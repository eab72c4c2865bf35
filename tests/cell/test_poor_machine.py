"""What a container may lack: a home, shared memory with room in it, a first process that asks how
orphans ended, a short path for temporary files.
"""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from pianobot_ros.cell.host import compiled_code, memory
from pianobot_ros.cell.host.halted import living, still_living
from pianobot_ros.emulator.faults import FaultServer, send_fault
from pianobot_ros.emulator.serving.bus import BusError, PlantBus, default_path
from pianobot_ros.nodes.base.discovery import discovery

NOWHERE = Path("/dev/null/below")
"""Where nobody, root included, can make a folder."""


def test_without_writable_shared_memory_temporary_files_serve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "_MEMORY", tmp_path)
    assert default_path().parent == tmp_path
    monkeypatch.setattr(memory, "_MEMORY", NOWHERE)
    assert default_path().parent.is_dir()
    assert memory.writable(tmp_path / "not" / "yet") and not memory.writable(NOWHERE)


def test_a_bus_for_which_there_is_no_room_is_refused_in_one_line(tmp_path: Path) -> None:
    """Its first use would be the end of the process, by SIGBUS."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        with pytest.raises(BusError, match="make room in") as error:
            PlantBus.create(tmp_path / "bus")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("home", [None, "", str(NOWHERE)])
def test_without_a_home_ros_logs_among_temporary_files(
    monkeypatch: pytest.MonkeyPatch, home: str | None
) -> None:
    for name in ("HOME", "ROS_HOME", "ROS_LOG_DIR"):
        monkeypatch.delenv(name, raising=False)
    if home is not None:
        monkeypatch.setenv("HOME", home)
    assert memory.writable(Path(discovery()["ROS_LOG_DIR"]))
    monkeypatch.setenv("ROS_HOME", "/mine")
    assert "ROS_LOG_DIR" not in discovery(), "what the user has chosen stays"


def test_in_a_home_ros_logs_where_it_always_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ROS_HOME", "ROS_LOG_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert "ROS_LOG_DIR" not in discovery()


def test_compiled_code_has_a_place_where_neither_package_nor_home_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = Path(compiled_code.__file__).parents[2]
    for name in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert compiled_code.folder_of_compiled_code(package) == {}
    monkeypatch.setattr(compiled_code, "writable", lambda _: False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (place,) = compiled_code.folder_of_compiled_code(package).values()
    again = compiled_code.folder_of_compiled_code(package)
    assert again == {"NUMBA_CACHE_DIR": place} and Path(place).parent == tmp_path
    Path(place).chmod(0o777)  # anybody could put code there
    assert compiled_code.folder_of_compiled_code(package) != again
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/mine")
    assert compiled_code.folder_of_compiled_code(package) == {}


def test_who_has_ended_lives_no_more_though_its_parent_has_not_asked() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        process = psutil.Process(child.pid)
        assert living([process]) == still_living([process], 0.0) == [process]
        assert child.stdin is not None
        child.stdin.close()
        assert still_living([process], 60.0) == []
        assert process.is_running(), "the kernel still knows it"


def test_the_path_of_a_control_socket_may_be_longer_than_the_kernel_takes(tmp_path: Path) -> None:
    folder = tmp_path / ("a folder with a long name " * 6).strip()
    folder.mkdir()
    endpoint = f"unix:{folder / 'fsr.ctl'}"
    with FaultServer(endpoint, {"status": lambda _: "here"}) as server:
        server.start_thread()
        assert send_fault(endpoint, "status") == "here"
    assert list(folder.iterdir()) == []
