"""What a comparison with a reference may not claim."""

from __future__ import annotations

from dataclasses import replace

from pianobot_ros.gap import Diagnosis

__all__ = ["within_reference"]

SWAP = {"none": "unknown", "unknown": "none"}


def within_reference(result: Diagnosis, reference: Diagnosis) -> Diagnosis:
    """The result; but *unknown* where it says that nothing has changed and the twin leaves the
    reference itself unexplained: what is smaller than that would not be seen.
    """
    if reference.verdict != "unknown" or result.verdict != "none":
        return result
    candidates = tuple(replace(c, name=SWAP.get(c.name, c.name)) for c in result.candidates)
    sentence = (
        "Unknown: the twin leaves more open on the reference itself than has changed since, so that"
        " a change would not be seen."
    )
    return replace(
        result,
        verdict="unknown",
        sentence=sentence,
        candidates=candidates,
        credible_set=tuple(SWAP.get(n, n) for n in result.credible_set),
    )
