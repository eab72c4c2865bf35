"""The beat beside the executor: it calls, it ends, and what goes wrong in it is not silent."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from pianobot_ros.nodes.base import common
from pianobot_ros.nodes.topics.polled import Beat, PolledSubscription, Watch, stream_qos
from pianobot_ros.testing import wait_for

pytestmark = pytest.mark.graph


def test_it_calls_until_it_is_closed(ros: Any) -> None:
    node, calls = ros.node("beating"), []
    beat = Beat(node, lambda: calls.append(threading.current_thread().name), 0.001, "drum")
    assert not calls, "not before it is started"
    beat.start()
    wait_for(lambda: len(calls) > 5, "calls without an executor")
    beat.close()
    count = len(calls)
    assert set(calls) == {"drum"} and not beat._thread.is_alive()
    assert len(calls) == count


def test_what_it_raises_is_raised_by_the_executor(ros: Any) -> None:
    def work() -> None:
        raise ValueError("broken")

    Beat(ros.node("beating"), work, 0.001, "drum").start()
    with pytest.raises(ValueError, match="broken"):
        ros.wait_for(lambda: False, "the error")


def test_it_ends_with_its_node(ros: Any) -> None:
    from std_msgs.msg import String

    node = ros.node("beating")
    stream = PolledSubscription(node, String, "/words", stream_qos(5))
    taken: list[tuple[bytes, int]] = []
    beat = Beat(node, lambda: taken.extend(stream.take()), 0.001, "drum")
    beat.start()
    ros.executor.remove_node(node)
    node.destroy_node()
    wait_for(lambda: not beat._thread.is_alive(), "the thread ended")
    assert beat._error is None


def test_a_watch_hands_on_every_message_in_order(ros: Any) -> None:
    from std_msgs.msg import String

    node, heard = ros.node("listening"), []
    watch = Watch(
        PolledSubscription(node, String, "/words", stream_qos(100, True)), heard.append, 0.002
    )
    out = ros.node("speaking").create_publisher(String, "/words", common.EVENT_QOS)
    ros.wait_for(lambda: out.get_subscription_count() == 1, "the subscriber")
    for k in range(50):
        out.publish(String(data=str(k)))
    wait_for(lambda: len(heard) == 50, "fifty messages")
    assert [m.data for m in heard] == [str(k) for k in range(50)]
    watch.close()
