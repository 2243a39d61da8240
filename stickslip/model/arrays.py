"""Types of arrays, by the numbers that they hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Modes = NDArray[np.int8]


def like(values: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """Return `values` as a column if `other` has columns, one per time; else as they are."""
    return values[:, None] if other.ndim == 2 else values
