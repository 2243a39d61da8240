"""Polynomials in each step, in powers and in Chebyshev's: read, cut, bounded, as numpy's polynomials say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import chebyshev, polynomial

from stickslip.equations.path import Path, chebyshev_nodes, from_nodes

Array = np.ndarray
TAUS = np.array([0.0, 0.5, 0.75, 2.0])


def made(is_chebyshev: bool, order: int = 5, size: int = 3, seed: int = 1) -> Path:
    """A continuous path of three steps."""
    c = np.random.default_rng(seed).uniform(-1, 1, (3, order + 1, size))
    start = np.zeros(size)
    for piece in c:
        piece[0] += start - value(piece, 0.0, is_chebyshev)
        start = value(piece, 1.0, is_chebyshev)
    return Path(TAUS, c, start, hit=True, is_chebyshev=is_chebyshev)


def value(piece: Array, s: float, is_chebyshev: bool) -> Array:
    found = chebyshev.chebval(2 * s - 1, piece) if is_chebyshev else polynomial.polyval(s, piece)
    return np.asarray(found)


def expected(path: Path, tau: float) -> Array:
    """The state by numpy's polynomials."""
    i = min(int(np.searchsorted(TAUS, tau, side="right")) - 1, 2)
    s = (tau - TAUS[i]) / (TAUS[i + 1] - TAUS[i])
    return value(path.coefficients[i], s, path.is_chebyshev)


both = pytest.mark.parametrize("is_chebyshev", [False, True], ids=["powers", "chebyshev"])


@both
def test_states_at_any_time(is_chebyshev: bool) -> None:
    path = made(is_chebyshev)
    taus = np.linspace(0.0, 2.0, 41)
    found = path.at(taus)
    assert found.shape == (41, 3)
    for tau, row in zip(taus, found, strict=True):
        np.testing.assert_allclose(row, expected(path, tau), rtol=1e-13, atol=1e-13)


@both
def test_points_are_the_ends_of_the_steps(is_chebyshev: bool) -> None:
    path = made(is_chebyshev)
    np.testing.assert_allclose(path.points, path.at(TAUS), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(path.points[-1], path.last)
    # the end is the state to the bit, whatever the polynomial makes of it
    nudged = Path(TAUS, path.coefficients, path.last + 1e-12, True, is_chebyshev)
    np.testing.assert_array_equal(nudged.at(np.array([2.0, 2.5])), [nudged.last] * 2)


@both
def test_order_of_the_times_does_not_matter(is_chebyshev: bool) -> None:
    path = made(is_chebyshev)
    taus = np.array([1.9, 0.1, 0.5, 1.9, 0.0])
    np.testing.assert_array_equal(path.at(taus), np.array([path.at(np.array([tau]))[0] for tau in taus]))


@both
def test_a_path_without_steps_stands_still(is_chebyshev: bool) -> None:
    state = np.array([1.0, -2.0])
    path = Path(np.zeros(1), np.empty((0, 1, 2)), state, True, is_chebyshev)
    np.testing.assert_array_equal(path.at(np.array([0.0, 1.0])), [state, state])
    np.testing.assert_array_equal(path.largest, [1.0, 2.0])
    np.testing.assert_array_equal(path.points, [state])


@both
def test_a_path_that_is_cut_at_its_start_has_no_steps(is_chebyshev: bool) -> None:
    path = made(is_chebyshev)
    first = path.cut(0.0)
    np.testing.assert_array_equal(first.taus, TAUS[:1])
    assert first.coefficients.shape[0] == 0 and not first.hit
    np.testing.assert_array_equal(first.last, path.points[0])


@both
@pytest.mark.parametrize("tau", [0.1, 0.5, 0.6, 0.75, 1.3, 1.999])
def test_a_cut_path_is_the_same_up_to_there(is_chebyshev: bool, tau: float) -> None:
    path = made(is_chebyshev)
    cut = path.cut(tau)
    assert cut.taus[-1] == tau and not cut.hit and cut.is_chebyshev is is_chebyshev
    np.testing.assert_array_equal(cut.taus[:-1], TAUS[tau > TAUS])
    taus = np.linspace(0.0, tau, 33)
    np.testing.assert_allclose(cut.at(taus), path.at(taus), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(cut.last, path.at(np.array([tau]))[0])
    # the path that was cut does not change
    np.testing.assert_array_equal(path.coefficients, made(is_chebyshev).coefficients)


@both
@settings(deadline=None)
@given(st.integers(0, 12), st.integers(0, 1000))
def test_nothing_is_larger_than_the_bound(is_chebyshev: bool, order: int, seed: int) -> None:
    path = made(is_chebyshev, order, 2, seed)
    found = np.abs(path.at(np.linspace(0.0, 2.0, 101))).max(axis=0)
    assert np.all(found <= path.largest * (1 + 1e-12))


def test_the_bound_is_met() -> None:
    """``T_3`` and ``s^3`` are 1 at their end."""
    c = np.zeros((1, 4, 1))
    c[0, 3] = 1.0
    for is_chebyshev in (True, False):
        assert Path(np.array([0.0, 1.0]), c, np.ones(1), False, is_chebyshev).largest.tolist() == [1.0]


@pytest.mark.parametrize("order", range(13))
def test_values_at_the_nodes_become_coefficients(order: int) -> None:
    nodes = chebyshev_nodes(order)
    assert nodes.size == order + 1 and nodes[0] == 0 and (order == 0 or nodes[-1] == 1)
    assert np.all(np.diff(nodes) > 0)
    c = np.random.default_rng(order).uniform(-1, 1, (order + 1, 2))
    there = chebyshev.chebval(2 * nodes - 1, c).T
    np.testing.assert_allclose(from_nodes(order) @ there, c, rtol=0, atol=1e-13)


@both
@pytest.mark.parametrize("tau", [0.0, 0.1, 0.5, 0.6, 1.3, 1.999, 2.0])
def test_the_state_at_one_time_is_that_of_many(is_chebyshev: bool, tau: float) -> None:
    path = made(is_chebyshev)
    np.testing.assert_allclose(path.state(tau), path.at(np.array([tau]))[0], rtol=1e-14, atol=1e-14)
