"""Special cases of a hypothesis: some of its effects only, or other effects in the place of those
of which they are what is left at `null` (Coulomb friction of one that falls with speed).

A general law can always do what its special case does. It is believed only where it does more.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product

from pianobot_ros.gap.problem.types import Effect

Library = Mapping[str, Effect]


def remainder(library: Library, effect: str) -> str | None:
    """The effect of the library that is left of another one at its `null`; None: nothing is."""
    left = library[effect].remainder
    return left[0] if left is not None and left[0] in library else None


def special_cases(library: Library, effects: Sequence[str]) -> set[frozenset[str]]:
    """Every special case of a hypothesis, "no effect" among them."""
    kept = [{name, remainder(library, name), None} for name in effects]
    cases = {frozenset(name for name in chosen if name) for chosen in product(*kept)}
    return cases - {frozenset(effects)}


def reduced(library: Library, effects: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """The hypothesis with what is left of one of its effects in the place of that."""
    for k, name in enumerate(effects):
        left = remainder(library, name)
        if left is not None and left not in effects:
            yield (*effects[:k], left, *effects[k + 1 :])


def to_special_case(
    library: Library, effects: Sequence[str], values: Mapping[str, float]
) -> dict[str, float]:
    """A hypothesis' values, and what they are in the effects that are left of its own."""
    return dict(values) | {
        its: values[own] for its, own in _same(library, effects) if own in values
    }


def from_special_case(
    library: Library, effects: Sequence[str], values: Mapping[str, float]
) -> dict[str, float]:
    """A special case's values, and what they are in the effects of a hypothesis."""
    return dict(values) | {
        own: values[its] for its, own in _same(library, effects) if its in values
    }


def _same(library: Library, effects: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Names of parameters: of an effect that is left, and of the one that it is left of."""
    for name in effects:
        left = library[name].remainder
        if left is not None:
            yield from left[1].items()
