"""Matrices are stored dense or sparse, by size: what reads them need not ask."""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.model.arrays import Array, Indices


class Triplets:
    """Entries of a matrix under construction."""

    def __init__(self) -> None:
        self.rows: list[int] = []
        self.columns: list[int] = []
        self.values: list[float] = []

    def add(self, row: int, column: int, value: float) -> None:
        """Enter a value; values at the same place add up."""
        if value:
            self.rows.append(row)
            self.columns.append(column)
            self.values.append(value)

    def extend(self, rows: Indices, columns: Indices, values: Array) -> None:
        """Enter many values."""
        some = values.nonzero()[0]
        self.rows += rows[some].tolist()
        self.columns += columns[some].tolist()
        self.values += values[some].tolist()


def dense(matrix: Any) -> Array:
    """Return a matrix as a dense array."""
    found: Array = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
    return found


def row_maxima(matrix: Any) -> Array:
    """Return the largest absolute value in each row (k,)."""
    if not matrix.shape[0] or not matrix.shape[1]:
        return np.zeros(matrix.shape[0])
    if isinstance(matrix, np.ndarray):
        found: Array = np.abs(matrix).max(axis=1)
        return found
    return dense(abs(matrix).max(axis=1)).ravel()
