"""Errors of the diagnosis."""

from __future__ import annotations


class GapError(Exception):
    """The twin, the blocks or the options cannot be diagnosed as they are; the message says what to
    do, in one line.
    """


class SimulationFailed(GapError):  # noqa: N818  (it reads as what happened)
    """The twin could not predict these blocks with these values; the candidate is dropped, not the
    diagnosis.
    """
