"""What every test may use comes from the plugin that ships with the package,
``pianobot_ros.testing``; here is only how it is loaded.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from examples import load_profiles

import pianobot_ros
from pianobot_ros.cell.host.priority import cores
from pianobot_ros.cell.motion import geometry
from pianobot_ros.piano.twin.reduced.strike_geometry import key_model
from pianobot_ros.piano.twin.reduced.strike_model import strike_model
from pianobot_ros.testing.browser import chromium, find_chromium

# Before the command line is looked at: --hypothesis-profile=search takes the other one.
load_profiles()

ROOT = Path(__file__).resolve().parents[1]
FORWARD = -5
"""Nice value of tests with nodes and devices: of a core three times what others get."""


# Where the package is installed too, a bare `pytest` has loaded the plugin from there.
if ROOT not in Path(pianobot_ros.__file__).resolve().parents:
    raise pytest.UsageError(
        "the installed pianobot_ros would be tested, not this tree: use `python -m pytest`"
    )

pytest_plugins = ["pianobot_ros.testing"]


def pytest_xdist_auto_num_workers() -> int:
    """Two processes for each core: some tests wait for devices and browsers; with three for each
    the cores do the same in more time.
    """
    return 2 * cores()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first, so that no process ends long after the others; and those
    that start nodes or devices are spread over the others, so that one waits while another
    computes, and few graphs share the cores.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    waiting = {item.path for item in items if item.get_closest_marker("graph")}
    place: dict[Path, float] = {}
    for kind in (True, False):
        found = {item.path: None for item in items if (item.path in waiting) is kind}
        files = sorted(found, key=lambda path: path not in slow)
        place.update({path: k / len(files) for k, path in enumerate(files)})
    items.sort(key=lambda item: place[item.path])


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> None:
    """Of tests side by side those with nodes and devices come first, where that is allowed: they
    run by the clock, and made late by those that only compute they take longer, all of which time
    a running graph costs most of a core.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        graph = item.get_closest_marker("graph") is not None
        with contextlib.suppress(OSError):  # only root may come forward, not in every container
            os.setpriority(os.PRIO_PROCESS, 0, FORWARD if graph else 0)


@pytest.fixture
def choose_keys(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Chooses a key preset for everything that the test builds, and takes it back at its end."""
    monkeypatch.setenv(geometry.KEY_PRESET, "paper")

    def forget() -> None:
        geometry.keyboard.cache_clear()
        key_model.cache_clear()
        strike_model.cache_clear()

    def choose(name: str) -> None:
        geometry.use_key_preset(name)
        forget()

    yield choose
    monkeypatch.undo()
    forget()


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """One for all tests of pages: Playwright knows one at a time in a process."""
    if find_chromium() is None:
        pytest.skip("no Chromium here: install the Debian package chromium")
    with chromium() as found:
        yield found
