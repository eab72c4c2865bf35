"""The middleware's settings: nodes get them unless the user has chosen others."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from pathlib import Path

import pytest

from pianobot_ros.graph import discovery

NAMES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def test_new_nodes_announce_themselves_for_some_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    found = discovery()
    assert set(found) == set(NAMES) and len(set(found.values())) == 1
    (announced,) = (e for e in Xml.parse(Path(found[NAMES[0]])).iter() if e.tag.endswith("initialAnnouncements"))
    count, period = (next(e for e in announced.iter() if e.tag.endswith(tag)).text for tag in ("count", "nanosec"))
    assert int(count or 0) * int(period or 0) >= 2e9


@pytest.mark.parametrize("name", NAMES)
def test_what_the_user_has_chosen_stays(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setenv(name, "/mine.xml")
    assert discovery() == {}
