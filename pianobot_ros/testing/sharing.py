"""One expensive object for several tests, without letting one test's failure fail the others."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Generic, TypeVar

import pytest

__all__ = ["FAILED", "Shared"]

T = TypeVar("T")

FAILED = pytest.StashKey[bool]()
"""Set by the plugin on a test that has failed."""


class Shared(Generic[T]):
    """Lends one object to test after test, and makes another after a failure.

    Args:
        make: gives a context manager of the object.
        trouble: why an object cannot be lent again, or an empty string.

    Use it in two fixtures, a wide one that owns and a narrow one that lends::

        @pytest.fixture(scope="module")
        def arms():
            with Shared(make_arm) as shared:
                yield shared

        @pytest.fixture
        def arm(arms, request):
            with arms.lend(request) as arm:
                yield arm
    """

    def __init__(
        self,
        make: Callable[[], AbstractContextManager[T]],
        trouble: Callable[[T], str] = lambda _: "",
    ) -> None:
        self._make, self._trouble = make, trouble
        self._held = contextlib.ExitStack()
        self._object: T | None = None

    @contextlib.contextmanager
    def lend(self, request: pytest.FixtureRequest) -> Iterator[T]:
        """The object for one test. If the test fails, or leaves trouble behind, the next one gets
        another.
        """
        if self._object is None:
            self._object = self._held.enter_context(self._make())
        try:
            yield self._object
        finally:
            if request.node.stash.get(FAILED, False) or self._trouble(self._object):
                self.close()

    def close(self) -> None:
        """End the object, if there is one."""
        self._object = None
        self._held.close()

    def __enter__(self) -> Shared[T]:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
