"""With how many examples, and with which, properties are tried.

``pianobot`` is the profile of every run: the same tree is tried with the same examples everywhere,
so that a change is blamed for what it has done and for nothing else. ``search`` is for those who
hunt for bugs: other examples each time, and many more (CONTRIBUTING.md says how it is chosen).
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants

__all__ = ["fewer", "load_profiles"]

SLOW = [HealthCheck.too_slow]  # a busy machine may take any time for one example


def load_profiles() -> None:
    """Name both profiles and take the first."""
    settings.register_profile(
        "pianobot", deadline=None, derandomize=True, suppress_health_check=SLOW
    )
    settings.register_profile(
        "search", deadline=None, max_examples=2000, suppress_health_check=SLOW, print_blob=True
    )
    settings.load_profile("pianobot")
    _take_constants_from_nowhere()


def _take_constants_from_nowhere() -> None:
    """Hypothesis also draws numbers and words that occur in the modules of this tree which are
    imported by then. Which these are depends on the tests that the process ran before.
    """
    collect = providers._get_local_constants

    def constants() -> Constants:
        return Constants() if settings.default.derandomize else collect()

    providers._get_local_constants = constants


def fewer(share: float, suppress: Collection[HealthCheck] = (), **more: Any) -> settings:
    """For a property whose examples are expensive: this share of what the profile asks for."""
    wanted = max(1, round(share * settings.default.max_examples))
    return settings(max_examples=wanted, suppress_health_check=[*SLOW, *suppress], **more)
