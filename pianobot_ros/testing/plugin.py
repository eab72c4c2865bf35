"""The fixtures, and what pytest has to tell them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from pianobot_ros.testing.sharing import FAILED, Shared

if TYPE_CHECKING:
    from pianobot_ros.testing.running.emulated_device import EmulatedDevice
    from pianobot_ros.testing.running.process import Processes
    from pianobot_ros.testing.running.ros_context import Ros
    from pianobot_ros.testing.running.running_cell import RunningCell


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Remember that a test has failed, for the fixtures that it shares with others."""
    report = yield
    item.stash[FAILED] = report.failed or item.stash.get(FAILED, False)
    return report


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The number of a ROS domain that is this test's alone on this machine; children get it too."""
    from pianobot_ros.nodes.base.domain import claim_domain
    from pianobot_ros.testing.running.ros_context import on_this_machine

    on_this_machine(monkeypatch)
    with claim_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain.number))
        yield domain.number


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Processes]:
    """A :class:`Processes`: none that it starts outlives the test."""
    from pianobot_ros.testing.running.process import Processes

    with Processes(tmp_path) as made:
        yield made


@pytest.fixture
def ros(ros_domain: int, processes: Processes) -> Iterator[Ros]:
    """A :class:`Ros` in the test's own domain; waiting ends at once when one of ``processes`` has
    ended by itself.
    """
    from pianobot_ros.testing.running.ros_context import Ros

    with Ros(ros_domain, processes.trouble) as made:
        yield made


@pytest.fixture
def emulated_device(tmp_path: Path) -> Iterator[Callable[..., EmulatedDevice]]:
    """Starts emulated devices: ``emulated_device("fsr", *words)`` gives an
    :class:`EmulatedDevice`, which is ended with the test.
    """
    from pianobot_ros.testing.running.emulated_device import EmulatedDevice

    with contextlib.ExitStack() as held:

        def start(name: str, *arguments: str, **options: Any) -> EmulatedDevice:
            return held.enter_context(EmulatedDevice(name, tmp_path, *arguments, **options))

        yield start


@pytest.fixture(scope="module")
def running_cells(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shared[RunningCell]]:
    """Owns the cell of a module; tests ask for ``running_cell``."""
    from pianobot_ros.testing.running.ros_context import on_this_machine
    from pianobot_ros.testing.running.running_cell import RunningCell

    with pytest.MonkeyPatch.context() as patch:
        on_this_machine(patch)
        with Shared(
            lambda: RunningCell(tmp_path_factory.mktemp("cell")), RunningCell.trouble
        ) as shared:
            yield shared


@pytest.fixture
def running_cell(
    running_cells: Shared[RunningCell], request: pytest.FixtureRequest
) -> Iterator[RunningCell]:
    """A :class:`RunningCell`: the whole graph on the emulated cell. The tests of a module share it
    until one of them fails or leaves a node unwell; the next test then gets another.
    """
    with running_cells.lend(request) as cell:
        yield cell
