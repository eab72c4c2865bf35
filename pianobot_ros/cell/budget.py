"""How long a diagnosis may take where nothing else is asked for."""

from __future__ import annotations

__all__ = ["DIAGNOSIS_BUDGET"]

DIAGNOSIS_BUDGET = 120.0
"""s: what 40 strikes against the whole library may take on two cores; two effects need most of it."""
