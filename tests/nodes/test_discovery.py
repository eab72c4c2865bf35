"""The middleware's settings: nodes get them unless the user has chosen others."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from pathlib import Path
from typing import Any

import psutil
import pytest

from pianobot_ros.cell.errors import PianobotError
from pianobot_ros.nodes.base import domain as domains
from pianobot_ros.nodes.base.discovery import PROFILES, RANGE, discovery
from pianobot_ros.nodes.base.domain import claim_domain
from pianobot_ros.testing import Ros

pytestmark = pytest.mark.graph


@pytest.fixture(params=["SUBNET", "LOCALHOST"])
def no_choice(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user who has chosen no profile."""
    for name in PROFILES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(RANGE, request.param)


@pytest.mark.usefixtures("no_choice")
def test_nodes_announce_themselves_often() -> None:
    found = discovery()
    assert len({found[name] for name in PROFILES}) == 1
    (announced,) = (
        e for e in Xml.parse(Path(found[PROFILES[0]])).iter() if e.tag.endswith("leaseAnnouncement")
    )
    assert sum(int(e.text or 0) for e in announced) <= 500_000_000, (
        "ns; a restarted node waits so long for the others"
    )


@pytest.mark.parametrize("name", PROFILES)
def test_what_the_user_has_chosen_stays(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv(name, "/mine.xml")
    assert not discovery().keys() & {*PROFILES, RANGE}


@pytest.mark.parametrize("asked", [None, "", "LOCALHOST", "SUBNET"])
def test_nodes_stay_on_this_machine_unless_asked_otherwise(
    monkeypatch: pytest.MonkeyPatch, asked: str | None
) -> None:
    for name in PROFILES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delenv(RANGE, raising=False)
    if asked is not None:
        monkeypatch.setenv(RANGE, asked)
    found = discovery()
    assert (Path(found[PROFILES[0]]).name == "dds.xml") == (asked == "SUBNET")
    assert ("127.0.0.1" in Path(found[PROFILES[0]]).read_text()) == (asked != "SUBNET")


@pytest.mark.usefixtures("no_choice")
def test_a_node_keeps_off_shared_memory(ros: Any, processes: Any) -> None:
    """What a killed node leaves there makes its successor deaf."""
    node = processes.python("pianobot_ros.nodes.playing.conductor")
    tester = ros.node("tester")
    ros.wait_for(lambda: "conductor" in tester.get_node_names(), "the node in the graph")
    mapped = [
        m.path for m in psutil.Process(node.pid).memory_maps() if "fastrtps_" in Path(m.path).name
    ]
    assert not [path for path in mapped if path.startswith("/dev/shm")]


def test_a_domain_in_which_a_node_lives_is_not_given_to_others(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a claim of its own too: a node that had outlived its test spoke into another one."""
    with claim_domain() as domain:
        number = domain.number
    monkeypatch.setattr(domains, "DOMAINS", range(number, number + 1))
    with Ros(number) as ros:
        ros.node("left")
        with pytest.raises(PianobotError, match="in use"):
            claim_domain()
    claim_domain().close()
