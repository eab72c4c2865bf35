"""Names for arrays of numbers, for type hints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "ComplexArray", "IntArray"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
