"""Which linear solver CVODE is given, and how the exact Jacobian is handed to it.

Small systems are dense. Large ones are banded where an ordering of the states makes the band narrow, as for every
chain. Others are dense up to a size, and beyond it left to SUNDIALS' sparse solver.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices

_DENSE_LIMIT = 60
_DENSE_UNLESS_BANDED = 400
_NARROW = 0.25


def band_order(system: System) -> Indices | None:
    """Return an order of the states in which coupled states stand close together, None for small systems."""
    if system.size <= _DENSE_LIMIT:
        return None
    size, places = system.size, (system.moved_state, system.moved)
    by_rows = scipy.sparse.csr_array(system.abs_GT) @ scipy.sparse.csr_array(system.abs_G)
    by_rows.resize((size, size))
    # of equal degrees the first entry decides: sort the entries, so that the order is always the same
    by_rows.sort_indices()
    springs = scipy.sparse.csr_array(system.piecewise.widest(system.C))
    springs.resize((size, size))
    moves = scipy.sparse.csr_array((np.ones(system.moved.size), places), shape=(size, size))
    total = by_rows + springs + moves
    order = scipy.sparse.csgraph.reverse_cuthill_mckee(scipy.sparse.csr_matrix(total + total.T), symmetric_mode=True)
    return np.asarray(order, dtype=np.intp)


class LinearSolver:
    """Structure of the Jacobian, wide enough for every mode set met so far."""

    def __init__(self) -> None:
        self._kind = ""
        self._size = self._below = self._above = 0
        self._places: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        self._pattern: Any = None

    @property
    def is_sparse(self) -> bool:
        """Whether SUNDIALS' sparse solver is used."""
        return self._kind == "sparse"

    def hold(self, size: int, jacobian_pattern: Callable[[], Any]) -> bool:
        """Make room for a Jacobian of some size and pattern; return whether earlier solvers have no room for it."""
        if size <= _DENSE_LIMIT:
            return self._become("dense", size)
        jacobian = jacobian_pattern()
        is_dense = isinstance(jacobian, np.ndarray)
        matrix = jacobian if is_dense else scipy.sparse.coo_array(jacobian)
        row, column = jacobian.nonzero() if is_dense else (matrix.row, matrix.col)
        offset = column.astype(np.int64) - row
        below, above = int(-offset.min(initial=0)), int(offset.max(initial=0))
        if below + above + 1 <= _NARROW * size:
            grown = self._become("band", size) or below > self._below or above > self._above
            if grown:
                self._below, self._above = max(below, self._below), max(above, self._above)
                self._places = _band(size, self._below, self._above)
            return grown
        if size <= _DENSE_UNLESS_BANDED:
            return self._become("dense", size)
        return self._hold_sparse(scipy.sparse.coo_array(matrix), size)

    def _become(self, kind: str, size: int) -> bool:
        if (kind, size) == (self._kind, self._size):
            return False
        self._kind, self._size = kind, size
        self._below = self._above = 0
        self._pattern = None
        return True

    def _hold_sparse(self, matrix: Any, size: int) -> bool:
        changed = self._become("sparse", size)
        if not changed and np.isin(_place(matrix), self._places).all():
            return False
        pattern = abs(matrix) + scipy.sparse.eye_array(size)
        self._pattern, self._places = sparsity_pattern(pattern if self._pattern is None else pattern + self._pattern)
        return True

    def options(self) -> dict[str, Any]:
        """Return scikit-sundae's options for the linear solver."""
        if self._kind == "band":
            return {"linsolver": "band", "lband": self._below, "uband": self._above}
        if self._kind == "sparse":
            return {"linsolver": "sparse", "sparsity": self._pattern}
        return {"linsolver": "dense"}

    def fill(self, jacobian: Any, out: Array) -> None:
        """Write a Jacobian into scikit-sundae's array: dense, or the data of the sparsity pattern."""
        if self._kind == "dense":
            out[:] = dense(jacobian)
            return
        if self._kind == "band" and isinstance(jacobian, np.ndarray):
            out.ravel()[self._places] = jacobian.ravel()[self._places]
            return
        if self._kind == "sparse":
            out[:] = on_pattern(jacobian, self._places)
            return
        matrix = scipy.sparse.coo_array(jacobian)
        matrix.sum_duplicates()
        out.ravel()[self._places] = 0.0
        out[matrix.row, matrix.col] = matrix.data


def sparsity_pattern(matrix: Any) -> tuple[Any, NDArray[np.int64]]:
    """Return a matrix' pattern as scikit-sundae wants it, and where its entries stand in column-major order."""
    pattern = scipy.sparse.csc_array(matrix)
    pattern.sort_indices()
    pattern.data[:] = 1.0
    # scikit-sundae reads 32-bit indices only
    pattern.indices, pattern.indptr = pattern.indices.astype(np.int32), pattern.indptr.astype(np.int32)
    return pattern, _place(pattern.tocoo())


def on_pattern(matrix: Any, places: NDArray[np.int64]) -> Array:
    """Return the entries of a matrix as the data of a pattern whose entries stand at these places."""
    entries, found = scipy.sparse.coo_array(matrix), np.zeros(places.size)
    entries.sum_duplicates()
    found[np.searchsorted(places, _place(entries))] = entries.data
    return found


def _band(size: int, below: int, above: int) -> NDArray[np.int64]:
    """Return where the entries of a band stand in row-major order."""
    rows = np.arange(size, dtype=np.int64)[:, None]
    columns = rows + np.arange(-below, above + 1)
    inside = (columns >= 0) & (columns < size)
    return (rows * size + columns)[inside]


def _place(matrix: Any) -> NDArray[np.int64]:
    """Return where the entries of a matrix stand in column-major order."""
    return np.asarray(matrix.col.astype(np.int64) * matrix.shape[0] + matrix.row)
