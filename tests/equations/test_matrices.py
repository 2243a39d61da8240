"""Matrices put together from parts are dense or sparse as their parts are, and the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy

from stickslip.equations.algebra.matrices import Triplets, assembled, dense, row_maxima, scaled, stacked


def stored(values: Any, is_sparse: bool) -> Any:
    return scipy.sparse.csr_array(np.array(values)) if is_sparse else np.array(values)


@pytest.mark.parametrize("is_sparse", [False, True])
def test_blocks_add_up(is_sparse: bool) -> None:
    one, two = stored([[1.0, 0.0], [-2.0, 3.0]], is_sparse), stored([[5.0, 7.0, 0.0]], is_sparse)
    found = assembled(3, [(slice(2), slice(1, 3), one), (np.array([1]), slice(3), two)])
    assert scipy.sparse.issparse(found) is is_sparse
    np.testing.assert_array_equal(dense(found), [[0.0, 1.0, 0.0], [5.0, 5.0, 3.0], [0.0, 0.0, 0.0]])


@pytest.mark.parametrize("is_sparse", [False, True])
def test_parts_stand_at_their_rows(is_sparse: bool) -> None:
    one, two = stored([[1.0, 2.0]], is_sparse), stored([[3.0, 0.0], [0.0, -4.0]], is_sparse)
    found = stacked(4, [(slice(1, 2), one), (np.array([3, 0]), two)])
    assert scipy.sparse.issparse(found) is is_sparse
    np.testing.assert_array_equal(dense(found), [[0.0, -4.0], [1.0, 2.0], [0.0, 0.0], [3.0, 0.0]])


@pytest.mark.parametrize("is_sparse", [False, True])
def test_rows_have_factors_and_largest_values(is_sparse: bool) -> None:
    matrix = stored([[1.0, -2.0], [0.0, 0.0], [-0.5, 0.25]], is_sparse)
    found = scaled(np.array([2.0, 3.0, -4.0]), matrix)
    assert scipy.sparse.issparse(found) is is_sparse
    np.testing.assert_array_equal(dense(found), [[2.0, -4.0], [0.0, 0.0], [2.0, -1.0]])
    np.testing.assert_array_equal(row_maxima(matrix), [2.0, 0.0, 0.5])
    for shape in ((3, 0), (0, 3)):
        np.testing.assert_array_equal(row_maxima(stored(np.zeros(shape), is_sparse)), np.zeros(shape[0]))


def test_entries_are_those_that_are_not_0() -> None:
    entries = Triplets()
    entries.add(2, 1, 0.5)
    entries.add(0, 0, 0.0)
    entries.extend(np.array([1, 0, 2]), np.array([0, 1, 2]), np.array([3.0, 0.0, -1.0]))
    assert list(zip(entries.rows, entries.columns, entries.values, strict=True)) == [
        (2, 1, 0.5),
        (1, 0, 3.0),
        (2, 2, -1.0),
    ]
