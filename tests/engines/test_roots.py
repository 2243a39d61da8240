"""First roots of polynomials on (0, 1]: as numpy finds them, none missed, none made up, tangencies too."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.polynomial import polynomial

from stickslip.engines.roots import earliest, first_root, first_touch, may_vanish

Array = np.ndarray


def from_roots(*roots: complex, sign: float = 1.0) -> Array:
    """A polynomial with these roots that is positive at 0, largest coefficient 1."""
    c = polynomial.polyfromroots(roots).real
    return sign * c / (np.sign(c[0]) * np.abs(c).max())


def by_numpy(c: Array) -> list[float]:
    """Roots in (0, 1], the first one first."""
    found = polynomial.polyroots(polynomial.polytrim(c, 1e-12))
    return sorted(r.real for r in found if abs(r.imag) < 1e-9 and 0 < r.real <= 1)


def suspected(c: Array) -> bool:
    return may_vanish(c[:, None])[0].size == 1


# Simple roots


@pytest.mark.parametrize("root", [1e-9, 1e-3, 0.1, 0.5, 0.999, 1.0 - 1e-9])
@pytest.mark.parametrize("others", [(), (1.5,), (-0.3, 2.0), (1 + 1j, 1 - 1j), (0.5 + 1j, 0.5 - 1j, 3.0)])
def test_one_root(root: float, others: tuple[complex, ...]) -> None:
    c = from_roots(root, *others)
    assert suspected(c)
    assert first_root(c) == pytest.approx(root, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("distance", [0.3, 1e-2, 1e-4])
def test_the_first_of_two_roots(distance: float) -> None:
    """A double crossing leaves the signs at both ends equal."""
    for first in (0.05, 0.4, 0.6):
        c = from_roots(first, first + distance, -2.0)
        assert c[0] > 0 and c.sum() > 0 and suspected(c)
        assert first_root(c) == pytest.approx(first, abs=1e-15 / distance)


def test_the_first_of_many_roots() -> None:
    c = from_roots(*(0.1 * k for k in range(1, 8)))
    assert first_root(c) == pytest.approx(0.1, rel=1e-10)


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=19))
def test_random_polynomials_have_the_roots_that_numpy_finds(values: list[float]) -> None:
    c = np.array(values)
    c[0] = abs(c[0])
    assume(c[0] > 1e-3)
    found = first_root(c)
    samples = polynomial.polyval(np.linspace(0.0, 1.0, 2001), c)
    if found is None:
        # no root was missed
        assert samples.min() > -1e-14 * np.abs(c).sum()
    else:
        assert 0 < found <= 1 and suspected(c)
        noise = 1e-14 * np.abs(c).sum()
        assert abs(polynomial.polyval(found, c)) < noise
        assert polynomial.polyval(np.linspace(0.0, found, 501), c).min() > -noise
    roots = by_numpy(c)
    clear = [r for r in roots if abs(polynomial.polyval(r, polynomial.polyder(c))) > 1e-3]
    if found is not None and roots and clear == roots:
        # numpy finds roots as eigenvalues, with the roundoff of the largest one: a step of Newton's method removes it
        root = roots[0] - polynomial.polyval(roots[0], c) / polynomial.polyval(roots[0], polynomial.polyder(c))
        assert found == pytest.approx(root, abs=1e-9)
    if not suspected(c):
        assert found is None and samples.min() >= 0


@settings(deadline=None, max_examples=200)
@given(st.integers(1, 18), st.integers(0, 2**32 - 1))
def test_series_of_high_order_that_die_away(order: int, seed: int) -> None:
    """Coefficients fall from order to order, as those of Taylor series do."""
    c = np.random.default_rng(seed).normal(size=order + 1) / 2.0 ** np.arange(order + 1)
    c[0] = abs(c[0])
    found = first_root(c)
    samples = polynomial.polyval(np.linspace(0.0, 1.0, 4001), c)
    below = np.flatnonzero(samples < 0)
    if below.size:
        assert found is not None
        assert (below[0] - 1) / 4000 - 1e-12 <= found <= below[0] / 4000 + 1e-12
    elif found is not None:
        # it dips below 0 between two samples
        assert abs(polynomial.polyval(found, c)) < 1e-14


# Double roots


@pytest.mark.parametrize("place", [0.2, 0.5, 0.77, 0.9])
@pytest.mark.parametrize("gap", [1e-2, 1e-6, 1e-10, 1e-13])
def test_a_minimum_just_above_zero_has_no_root(place: float, gap: float) -> None:
    c = np.array([place**2 + gap, -2 * place, 1.0])
    assert first_root(c) is None


@pytest.mark.parametrize("place", [0.2, 0.5, 0.77, 0.9])
@pytest.mark.parametrize("depth", [1e-2, 1e-6, 1e-10, 1e-13])
def test_a_minimum_just_below_zero_has_one(place: float, depth: float) -> None:
    """``(s - p)^2 = d`` first at ``p - sqrt(d)``, to the roundoff of d."""
    c = np.array([place**2 - depth, -2 * place, 1.0])
    assert suspected(c)
    assert first_root(c) == pytest.approx(place - depth**0.5, abs=1e-15 / depth**0.5)


@pytest.mark.parametrize("place", [0.25, 0.5, 0.75])
def test_a_polynomial_that_touches_zero_has_none(place: float) -> None:
    """Exact in binary: the minimum is 0 to the bit."""
    assert first_root(np.array([place**2, -2 * place, 1.0])) is None
    assert first_root(np.convolve([place**2, -2 * place, 1.0], [1.0, 1.0])) is None


@pytest.mark.parametrize("place", [0.3, 0.6, 0.9])
def test_a_touch_to_roundoff_counts_as_none(place: float) -> None:
    found = first_root(np.array([place**2, -2 * place, 1.0]))
    assert found is None or found == pytest.approx(place, abs=3e-8)


@pytest.mark.parametrize("place", [0.25, 0.5])
def test_a_crossing_after_a_touch_is_found(place: float) -> None:
    c = np.convolve([place**2, -2 * place, 1.0], [0.875, -1.0])
    assert first_root(c) == pytest.approx(0.875, rel=1e-12)


def test_a_triple_root_crosses() -> None:
    # to the cube root of roundoff
    assert first_root(np.array([0.125, -0.75, 1.5, -1.0])) == pytest.approx(0.5, abs=3e-5)


# Ends and trifles


def test_a_root_at_the_end_belongs_to_the_step_to_come() -> None:
    """A polynomial that is 0 at 1 has not crossed 0; one that is negative there has."""
    assert first_root(np.array([1.0, -1.0])) is None
    assert first_root(np.array([1.0, -1.0 - 1e-12])) == pytest.approx(1.0, abs=2e-12)


def test_no_root() -> None:
    for c in ([1.0], [1.0, 0.0, 0.0], [1.0, 2.0], [1.0, -0.5], [0.3, 0.0, 1.0], [1.0, -1.0, 0.5]):
        assert first_root(np.array(c)) is None


def test_what_leaves_zero_upwards_has_no_root_there() -> None:
    assert first_root(np.array([0.0, 1.0])) is None
    assert first_root(np.array([0.0, 1.0, -2.0])) == pytest.approx(0.5, rel=1e-14)


@pytest.mark.parametrize("size", [1e-300, 1e-30, 1e30, 1e300])
def test_sizes_do_not_matter(size: float) -> None:
    assert first_root(size * np.array([1.0, -3.0, 1.0])) == pytest.approx((3 - 5**0.5) / 2, rel=1e-14)


def test_columns_that_cannot_vanish_are_left_out() -> None:
    c = np.array(
        [
            [1.0, 1.0, 1.0, 0.5, 1.0],
            [0.0, -2.0, -0.9, -1.0, -3.0],
            [0.0, 0.0, -0.05, 1.0, 3.0],
        ]
    )
    # 0.5 - s + s^2 = (s - 1/2)^2 + 1/4 and 1 - 3 s + 3 s^2 = 3 (s - 1/2)^2 + 1/4 have no root either, but their
    # Bernstein coefficients are not all positive: such columns may be kept
    for many in (1, 20):
        close, bernstein = may_vanish(np.tile(c, many))
        assert not np.isin(close % 5, (0, 2)).any() and (close % 5 == 1).sum() == many
        # those of a parabola are c0, c0 + c1 / 2 and c0 + c1 + c2
        by_hand = np.array([[1.0, 1.0, 1.0, 0.5, 1.0], [1.0, 0.0, 0.55, 0.0, -0.5], [1.0, -1.0, 0.05, 0.5, 1.0]])
        np.testing.assert_allclose(bernstein, by_hand[:, close % 5], atol=1e-15)
    assert may_vanish(c[:, [0, 2]])[0].size == 0
    assert [first_root(one) for one in c.T] == [None, pytest.approx(0.5, rel=1e-15), None, None, None]


@settings(deadline=None)
@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_a_column_left_out_is_positive(order: int, seed: int) -> None:
    c = np.random.default_rng(seed).uniform(-1, 1, (order + 1, 20))
    c[0] = np.abs(c[0]) + 0.5
    close, _ = may_vanish(c)
    left_out = np.setdiff1d(np.arange(20), close)
    values = polynomial.polyval(np.linspace(0.0, 1.0, 201), c[:, left_out])
    assert values.min(initial=1.0) > 0


def test_a_dip_of_roundoff_is_none_but_what_comes_after_is_found() -> None:
    # (s - 0.3)^2 - 1e-14 dips to -1e-14: where `floor` says that terms have the size 1, that is roundoff
    dip = np.array([0.09 - 1e-14, -0.6, 1.0])
    assert first_root(dip) == pytest.approx(0.3 - 1e-7, abs=1e-8)
    assert first_root(dip, floor=1.0) is None
    assert first_root(dip, floor=1e-3) == pytest.approx(0.3 - 1e-7, abs=1e-8)
    # after the dip it passes 0 at 0.8
    later = np.convolve(dip, [0.8, -1.0])
    assert first_root(later, floor=1.0) == pytest.approx(0.8, rel=1e-14)
    # two dips before the root
    twice = np.convolve(later, [0.25 - 1e-14, -1.0, 1.0])
    assert first_root(twice, floor=1.0) == pytest.approx(0.8, rel=1e-14)
    # a deeper dip has a root
    deep = np.array([0.09 - 1e-11, -0.6, 1.0])
    assert first_root(deep, floor=1.0) == pytest.approx(0.3 - 1e-11**0.5, rel=1e-9)
    # a dip that has not come back to 0 by the end has a root
    assert first_root(np.array([1.0 - 1e-14, -2.0, 1.0]), floor=1.0) == pytest.approx(1 - 1e-7, abs=1e-8)


@pytest.mark.parametrize("depth", [-1e-14, 0.0, 1e-14])
@pytest.mark.parametrize("place", [1e-3, 0.3, 0.9])
def test_a_touch_is_found_where_it_is_asked_for(place: float, depth: float) -> None:
    touches = np.convolve([place**2 + depth, -2 * place, 1.0], [2.0, -1.0])
    found, only = first_touch(touches, 1.0)
    assert only and found == pytest.approx(place, abs=1e-9)
    # a minimum 1e-11 above 0 is no touch, and one 1e-11 below 0 is a crossing
    assert first_touch(touches + np.array([1e-11, 0.0, 0.0, 0.0]), 1.0) == (None, False)
    if place > 1e-3:
        found, only = first_touch(touches - np.array([1e-11, 0.0, 0.0, 0.0]), 1.0)
        assert not only and found == pytest.approx(place - (1e-11 / (2 - place)) ** 0.5, rel=1e-6)
    # a root before the touch is found first
    first = np.convolve(touches, [0.5 * place, -1.0])
    assert first_touch(first, 1.0) == (pytest.approx(0.5 * place, rel=1e-9), False)


@pytest.mark.parametrize("length", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("gap", [1e-3, 0.4, 0.499])
def test_roots_far_down_have_the_roundoff_of_the_terms_there(length: float, gap: float) -> None:
    """``gap - t + t^2 / 2`` over a long time: its root is ``1 - sqrt(1 - 2 gap)``."""
    c = np.array([gap, -length, 0.5 * length**2])
    root = 2 * gap / (1 + (1 - 2 * gap) ** 0.5)
    assert first_root(c, floor=gap) == pytest.approx(root / length, rel=1e-14)
    place, only = first_touch(c, gap)
    assert place == pytest.approx(root / length, rel=1e-14) and not only
    # a parabola with its minimum above 0 has no root, and one with its minimum at 0 touches it
    assert first_root(c + np.array([0.501 - gap, 0.0, 0.0]), floor=0.5) is None
    assert first_touch(c + np.array([0.501 - gap, 0.0, 0.0]), 0.5) == (None, False)
    assert first_touch(c + np.array([0.5 - gap, 0.0, 0.0]), 0.5) == (
        pytest.approx(1 / length, rel=1e-6),
        True,
    )


# Tangencies, decided as exact arithmetic decides


def sign_changes(values: list[Fraction]) -> int:
    signs = [value > 0 for value in values if value]
    return sum(a != b for a, b in pairwise(signs))


def exactly_has_a_root(c: Array) -> bool:
    """Whether the polynomial of these doubles has a root in (0, 1], by Sturm's chain in fractions."""
    chain = [[Fraction(float(x)) for x in c]]
    chain.append([k * x for k, x in enumerate(chain[0])][1:])
    while len(chain[-1]) > 1:
        rest, by = chain[-2][:], chain[-1]
        while len(rest) >= len(by):
            factor, offset = rest[-1] / by[-1], len(rest) - len(by)
            for i, x in enumerate(by):
                rest[offset + i] -= factor * x
            rest.pop()
        while rest and not rest[-1]:
            rest.pop()
        if not rest:
            break
        chain.append([-x for x in rest])
    return sign_changes([p[0] for p in chain]) > sign_changes([sum(p, Fraction(0)) for p in chain])


@pytest.mark.parametrize("seed", range(10))
def test_grazes_are_decided_as_exact_arithmetic_decides(seed: int) -> None:
    """1,000 in all: a parabola within 1e-9 to 1e-13 of touching 0, times a positive polynomial."""
    rng = np.random.default_rng(seed)
    for _ in range(100):
        place, distance = rng.uniform(0.05, 0.95), rng.choice([-1, 1]) * 10 ** rng.uniform(-13, -9)
        positive = [np.append(1.0, rng.uniform(-0.3, 0.3, k)) for k in (1, *rng.integers(1, 4, 2))]
        c = np.array([place**2 + distance, -2 * place, 1.0]) * rng.uniform(0.2, 5.0)
        for factor in positive:
            c = polynomial.polymul(c, factor)
        assert (first_root(c) is not None) == exactly_has_a_root(c), (c, distance)
        if distance < 0:
            assert earliest(c[None, :])[0] <= place
