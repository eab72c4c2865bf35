"""What other threads say reaches a browser.

viser sets an :class:`asyncio.Event` from whatever thread draws, and once more from its own loop's
thread. Where the first falls between the loop's look at the flag and its waiting, the loop waits
with the flag set; every later call then does nothing, since the flag is set, and that browser is
sent nothing more for good. On a busy machine this happened once in some hours of pages
(viser 1.1.1; ``tests/piano/view/test_delivery.py`` brings it about in seconds).
"""

from __future__ import annotations

import asyncio
from typing import Any

from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer

__all__ = ["WakingEvent", "deliver_whatever_the_thread"]


class WakingEvent(asyncio.Event):
    """An event that other threads may set: the flag is seen at once, and who waits is woken by a
    call on the loop's own thread, whether the flag was set by then or not.
    """

    _loop: asyncio.AbstractEventLoop | None

    def set(self) -> None:
        """Set the flag; on the thread of the loop that waits also wake who waits. Any other thread
        may have a loop of its own.
        """
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            here = None
        if here is None or here is not self._loop:  # bound to a loop since somebody waited
            self._value = True
            return
        self._value = False  # or the call would not wake who began to wait meanwhile
        super().set()


class _Buffer(AsyncMessageBuffer):  # type: ignore[misc]
    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.message_event = WakingEvent()


def deliver_whatever_the_thread() -> None:
    """Let every server made from now on, and its connections, wait for messages with that event."""
    _infra.AsyncMessageBuffer = _Buffer
