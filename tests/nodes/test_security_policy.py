"""The policy allows what a node uses, and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.graph


def test_a_node_may_do_what_it_does_and_no_more(ros: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from pianobot_msgs.action import PlayPhrase
    from pianobot_msgs.msg import GapReport, StrikeMark
    from rclpy.action import ActionServer
    from std_srvs.srv import Trigger

    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "tools"))
    from security_policy import policy_of

    node = ros.node("conductor")
    node.create_publisher(StrikeMark, "/command/strike", 10)
    node.create_subscription(GapReport, "/gap/live", lambda _: None, 10)
    node.create_service(Trigger, "~/stop", lambda _, answer: answer)
    server = ActionServer(node, PlayPhrase, "/play_phrase", lambda goal: PlayPhrase.Result())
    found = policy_of(node, ["conductor"])
    (enclave,) = found.iter("enclave")
    assert enclave.get("path") == "/pianobot/conductor"
    allowed = {
        (group.tag, key): [one.text for one in group]
        for group in next(found.iter("profile"))
        for key in group.attrib
    }
    assert "/command/strike" in allowed["topics", "publish"]
    assert allowed["topics", "subscribe"].count("/gap/live") == 1
    assert "/command/strike" not in allowed["topics", "subscribe"]
    assert "/conductor/stop" in allowed["services", "reply"]
    assert allowed["actions", "execute"] == ["/play_phrase"]
    assert not any("_action" in name for names in allowed.values() for name in names)
    with pytest.raises(KeyError):
        policy_of(node, ["stranger"])
    server.destroy()
