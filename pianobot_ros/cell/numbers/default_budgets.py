"""What a diagnosis may cost where nothing else is asked for."""

from __future__ import annotations

__all__ = ["DIAGNOSIS_BUDGET"]

DIAGNOSIS_BUDGET = 40_000
"""Simulated strikes: a thousand predictions of 40 strikes, about half a minute of a core. Work and
not time is counted, so that the answer does not depend on how busy the machine is."""
