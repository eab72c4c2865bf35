"""Handing many numbers to compiled code again and again."""

from __future__ import annotations

from typing import Any

from numba import njit, typed

__all__ = ["held"]


@njit(cache=True)  # type: ignore[untyped-decorator]
def held(what: Any) -> Any:
    """``what``, a tuple of numbers and arrays, as the only item of a list of compiled code: to hand
    over a hundred numbers one by one, in each call, costs more than to compute with them.
    """
    result = typed.List()
    result.append(what)
    return result
