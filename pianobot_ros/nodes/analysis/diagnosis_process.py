"""The process in which diagnoses are computed, beside a spinning node."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.queues import SimpleQueue
from typing import Any

from pianobot_ros.piano.gap.diagnosis.live import Said, start_worker

__all__ = ["DiagnosisProcess"]


class DiagnosisProcess:
    """One process. What runs in it is ended by ending the process; another one is
    started in its place, unless ``stopping`` is set.
    """

    def __init__(self, stopping: threading.Event) -> None:
        self._stopping = stopping
        self._pool: ProcessPoolExecutor | None = None
        self._said: SimpleQueue[Said]

    def start(self) -> None:
        """Start a process, and end the one that there was."""
        self.end()
        for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
            # for the process to come: beside a running cell more threads are in the way
            os.environ.setdefault(name, "1")
        context = multiprocessing.get_context("spawn")
        self._said = context.SimpleQueue()  # a new one, since a process may end amid a word
        self._pool = ProcessPoolExecutor(
            1, mp_context=context, initializer=start_worker, initargs=(self._said,)
        )
        self._pool.submit(int)  # so that the process is there before the first strike

    def end(self) -> None:
        """End the process and what runs in it."""
        if self._pool is not None:
            for process in list((self._pool._processes or {}).values()):
                process.terminate()
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = None

    def restart(self) -> None:
        """End what is being computed."""
        self.end()
        if not self._stopping.is_set():
            self.start()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The result to come of ``function(*arguments)``."""
        assert self._pool is not None
        try:
            return self._pool.submit(function, *arguments)
        except BrokenProcessPool:
            self.start()
            return self._pool.submit(function, *arguments)

    def said(self) -> Iterator[Said]:
        """What the running diagnosis has said of its progress since the last call."""
        while not self._said.empty():
            yield self._said.get()
