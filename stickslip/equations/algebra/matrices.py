"""Matrices are stored dense or sparse, by size: code that reads them need not ask which."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import scipy

from stickslip.model.arrays import Array, Indices

# Rows and columns of a part of a matrix, and its entries. Rows or columns may be numbers, but not both.
MatrixBlock = tuple[slice | Indices, slice | Indices, Any]


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


def split_by(number: Indices, things: Indices) -> list[Indices]:
    """Return groups of things with the same number, in the order of the numbers."""
    order = np.argsort(number, kind="stable")
    return np.split(things[order], np.flatnonzero(np.diff(number[order])) + 1)


def dense(matrix: Any) -> Array:
    """Return a matrix as a dense array."""
    found: Array = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
    return found


def assembled(size: int, blocks: Sequence[MatrixBlock]) -> Any:
    """Return a square matrix as the sum of blocks, dense or sparse as the first of them is."""
    if isinstance(blocks[0][2], np.ndarray):
        found = np.zeros((size, size))
        for rows, columns, block in blocks:
            found[rows, columns] += dense(block)
        return found
    every = np.arange(size)
    parts = [(every[i], every[j], scipy.sparse.coo_array(block)) for i, j, block in blocks]
    entries = [(i[part.row], j[part.col], part.data) for i, j, part in parts]
    row, column, values = map(np.concatenate, zip(*entries, strict=True))
    return scipy.sparse.csr_array((values, (row, column)), shape=(size, size))


def scaled(factors: Array, matrix: Any) -> Any:
    """Return a matrix with each row multiplied by its factor, dense or sparse as it is."""
    if isinstance(matrix, np.ndarray):
        return factors[:, None] * matrix
    return (scipy.sparse.diags_array(factors) @ matrix).tocsr()


def stacked(rows: int, parts: Sequence[tuple[slice | Indices, Any]]) -> Any:
    """Return an array of so many rows from parts, each at its rows; a sparse matrix if the first part is one."""
    first = parts[0][1]
    if isinstance(first, np.ndarray):
        found = np.zeros((rows, *first.shape[1:]))
        for at, part in parts:
            found[at] = part
        return found
    # the parts one below the other in their order, and last a row of zeros for rows that no part has
    ends = np.cumsum([0, *(part.shape[0] for _, part in parts)])
    place = np.full(rows, ends[-1])
    for (at, _), (begin, end) in zip(parts, pairwise(ends), strict=True):
        place[at] = np.arange(begin, end)
    nothing = scipy.sparse.csr_array((1, first.shape[1]))
    return scipy.sparse.vstack([*(part for _, part in parts), nothing], format="csr")[place]


def row_maxima(matrix: Any) -> Array:
    """Return the largest absolute value in each row (k,)."""
    if not matrix.shape[0] or not matrix.shape[1]:
        return np.zeros(matrix.shape[0])
    if isinstance(matrix, np.ndarray):
        found: Array = np.abs(matrix).max(axis=1)
        return found
    return dense(abs(matrix).max(axis=1)).ravel()
