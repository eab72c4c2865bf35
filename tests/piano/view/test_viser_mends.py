"""Messages pushed by a thread while the server's loop goes to wait arrive."""

from __future__ import annotations

import asyncio
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import viser
from viser._messages import SetGuiPanelLabelMessage
from viser.infra._async_message_buffer import AsyncMessageBuffer

from pianobot_ros.piano.view.viser_mends import WakingEvent, deliver_whatever_the_thread

PUSHES = 60_000  # the event of viser 1.1.1 stalls after some thousand
STALLED = 20.0  # s without a delivery


@pytest.fixture
def hasty() -> Iterator[None]:
    """Threads take turns between any two lines."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(usual)


@pytest.mark.long
def test_no_wake_up_is_lost(hasty: None) -> None:
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    buffer = AsyncMessageBuffer(loop, persistent_messages=True)
    buffer.message_event = WakingEvent()
    buffer.window_duration_sec = 0.0
    seen = 0

    async def drain() -> None:
        nonlocal seen
        async for window in buffer.window_generator(0):
            last = window[-1]
            assert isinstance(last, SetGuiPanelLabelMessage) and last.label is not None
            seen = int(last.label)

    drained = asyncio.run_coroutine_threadsafe(drain(), loop)
    for number in range(1, PUSHES + 1):
        buffer.push(SetGuiPanelLabelMessage(str(number)))
        if number % 3 == 0:
            since = time.monotonic()
            while seen < number:
                assert time.monotonic() - since < STALLED, f"stalled after {number} messages"
                time.sleep(0)
    buffer.set_done()
    drained.result(STALLED)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(STALLED)
    loop.close()


def _set_from_a_loop_of_its_own(event: WakingEvent) -> None:
    async def setting() -> None:
        event.set()

    asyncio.run(setting())


@pytest.mark.parametrize("set_it", [WakingEvent.set, _set_from_a_loop_of_its_own])
def test_a_flag_that_another_thread_set_does_not_keep_the_loop_from_waking_who_waits(
    set_it: Callable[[WakingEvent], None],
) -> None:
    """The very course of it: the loop has seen no flag and waits, then it is set without waking."""

    async def course() -> None:
        event = WakingEvent()
        waits = asyncio.ensure_future(event.wait())
        await asyncio.sleep(0)
        await asyncio.to_thread(set_it, event)
        assert event.is_set() and not waits.done()
        event.set()
        assert await asyncio.wait_for(waits, STALLED)

    with ThreadPoolExecutor(1) as pool:  # the test's own thread may be a browser's loop's
        pool.submit(asyncio.run, course()).result(STALLED)


def test_servers_and_their_connections_use_it() -> None:
    deliver_whatever_the_thread()
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        buffer = server._websock_server.get_message_buffer()
        assert isinstance(buffer.message_event, WakingEvent)
    finally:
        server.stop()
