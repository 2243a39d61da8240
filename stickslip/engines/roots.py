"""The first roots of polynomials on [0, 1], with proof: where Bernstein coefficients are positive there is none."""

from __future__ import annotations

from functools import lru_cache
from math import comb
from operator import ne

import numpy as np

from stickslip.equations.guards.at_start import VALUE_ROUNDOFF
from stickslip.model.arrays import Array, Indices

_DEEPEST = 60
_STEPS = 50.0  # in so many steps the roundoff of a quantity adds up

# Polynomials with at least so many terms are Taylor series, over steps that their remainder limits. Shorter ones are
# exact, and may cover any length of time.
_LONG = 5

# Where a polynomial touches 0 before this part of the interval, the search is repeated with the roundoff there.
_FAR_DOWN = 0.1


@lru_cache(maxsize=64)
def _to_bernstein(order: int) -> Array:
    """Return the matrix from powers to Bernstein coefficients of the same order."""
    rows = [[comb(i, k) / comb(order, k) if k <= i else 0.0 for k in range(order + 1)] for i in range(order + 1)]
    return np.array(rows)


@lru_cache(maxsize=64)
def _halves(order: int) -> tuple[Array, Array]:
    """Return the matrices from Bernstein coefficients to those of the left and of the right half."""
    left = np.array([[comb(i, k) / 2.0**i if k <= i else 0.0 for k in range(order + 1)] for i in range(order + 1)])
    return left, left[::-1, ::-1].copy()


def floor_of_force(size: float, majorant: float) -> float:
    """Return the `floor` of a guard of forces, from the size of what it compares and the sizes of its terms.

    Forces that cancel, and a level that is about to touch 0, have the roundoff of their terms. It does not add up.
    """
    return max(size, majorant / _STEPS)


def may_vanish(coefficients: Array) -> tuple[Indices, Array]:
    """Return the columns of power coefficients (rows by order) that may have a root in (0, 1].

    Their Bernstein coefficients come second, a column each: a polynomial is nowhere below the smallest of its own.
    """
    bernstein = _to_bernstein(coefficients.shape[0] - 1) @ coefficients
    close: Indices = (bernstein.min(axis=0) <= 0).nonzero()[0]
    return close, bernstein[:, close]


def first_root(
    coefficients: Array, floor: float = 0.0, bernstein: Array | None = None, guess: float | None = None
) -> float | None:
    """Return where in (0, 1] a polynomial, positive at 0, first becomes negative, None where it does not.

    Bernstein coefficients of one sign exclude a root, exactly one change of sign isolates one (Descartes); anything
    else is halved. A polynomial that only touches 0, within the roundoff of its terms and of `floor`, has no root. Nor
    has one that comes back from a dip below 0 no deeper than the roundoff of `floor` in many steps. A `guess` of the
    root only saves time, and so do the `bernstein` coefficients.
    """
    c = coefficients.tolist()
    found = _first_crossing(c, _in_bernstein(coefficients, bernstein), floor, guess)
    first = 0.0
    while found is not None and floor:
        back = _back(c, found, _STEPS * VALUE_ROUNDOFF * floor)
        if back is None:
            break
        first = back
        rest = _from(coefficients, first)
        found = _first_crossing(rest.tolist(), _in_bernstein(rest, None), max(floor, _majorant(c, first)), None)
        found = None if found is None else first + found * (1 - first)
    return found


def first_touch(coefficients: Array, floor: float, bernstein: Array | None = None) -> tuple[float | None, bool]:
    """Return where in (0, 1] a polynomial first becomes negative or touches 0, and whether it only touches.

    It touches 0 where it turns no farther from 0 than the roundoff of its terms and of `floor` in many steps.
    """
    c, part = coefficients.tolist(), _STEPS * VALUE_ROUNDOFF
    near = part * max(_majorant(c, 1.0), floor)
    lowered = [c[0] - near, *c[1:]]
    root = _below(lowered, _in_bernstein(coefficients, bernstein) - near, floor)
    if root is not None and root < _FAR_DOWN and len(c) < _LONG:
        # there the terms are smaller: subtract the roundoff of their sizes at each place
        lowered = [a - part * abs(a) for a in c]
        lowered[0] -= part * floor
        root = _below(lowered, _in_bernstein(np.array(lowered), None), floor)
        near = 0.0 if root is None else part * (floor + _majorant(c, root))
    if root is None:
        return None, False
    turn = _turn(lowered, root, 2 * near)
    if turn is not None:
        return min(turn, 1.0), True
    return first_root(coefficients, floor, bernstein, root), False


def _in_bernstein(coefficients: Array, known: Array | None) -> Array:
    return _to_bernstein(coefficients.size - 1) @ coefficients if known is None else known


def _majorant(c: list[float], place: float) -> float:
    """Return the majorant of a polynomial at a place; of a Taylor series, at its end."""
    if place == 1.0 or len(c) >= _LONG:
        return sum(map(abs, c))
    size = 0.0
    for a in c[::-1]:
        size = size * place + abs(a)
    return size


def _turn(c: list[float], root: float, depth: float) -> float | None:
    """Return where a polynomial turns beyond its root, None where it goes below `-depth` or does not turn."""
    value = slope = half = 0.0
    for a in c[::-1]:
        half = half * root + slope
        slope = slope * root + value
        value = value * root + a
    bend = 2 * half
    return root - slope / bend if slope < 0 < bend and slope * slope <= 2 * bend * depth else None


def _back(c: list[float], root: float, touch: float) -> float | None:
    """Return where a polynomial is positive again beyond its root, None where it goes below `-touch` or stays so."""
    turn = _turn(c, root, touch)
    if turn is None:
        return None
    back = root + 3 * (turn - root)
    return back if back < 1 and np.polynomial.polynomial.polyval(back, c) > 0 else None


def _from(coefficients: Array, first: float) -> Array:
    """Return the polynomial on the rest of the interval from `first` on, mapped to [0, 1]."""
    shifted = np.polynomial.Polynomial(coefficients)(np.polynomial.Polynomial([first, 1 - first])).coef
    return np.pad(shifted, (0, coefficients.size - shifted.size))


def _below(c: list[float], bernstein: Array, floor: float) -> float | None:
    """Return where a polynomial is first negative, 0 where it is not positive at the start."""
    return 0.0 if c[0] <= 0 else _first_crossing(c, bernstein, floor, None)


def _first_crossing(c: list[float], bernstein: Array, floor: float, guess: float | None) -> float | None:
    # a half is kept as a map and the coefficients of the whole: most halves behind the first root are never needed
    stack: list[tuple[Array | None, Array, float, float, int]] = [(None, bernstein, 0.0, 1.0, 0)]
    while stack:
        half, of, low, high, depth = stack.pop()
        b = of if half is None else half @ of
        values = b.tolist()
        least = min(values)
        # near the start of the interval the terms of a short polynomial are smaller, and so is their roundoff
        if least >= 0 or least >= -(noise := VALUE_ROUNDOFF * max(_majorant(c, high), floor)):
            continue
        if values[-1] < -noise and values[0] >= -noise and _changes(values, noise) == 1:
            if guess is None:
                guess = low + (high - low) * values[0] / (values[0] - values[-1])
            return _bracketed(c, low, high, guess)
        if values[0] < -noise and depth:
            return low
        if depth >= _DEEPEST:
            if values[-1] < -noise:
                return high
            continue
        left, right = _halves(b.size - 1)
        middle = 0.5 * (low + high)
        stack.append((right, b, middle, high, depth + 1))
        stack.append((left, b, low, middle, depth + 1))
    return None


def _changes(values: list[float], noise: float) -> int:
    signs = [x > 0 for x in values if abs(x) > noise]
    return sum(map(ne, signs, signs[1:]))


def _bracketed(c: list[float], low: float, high: float, guess: float) -> float:
    """Return the one root between `low` and `high`, by Newton's method within the bracket."""
    c = c[::-1]
    s = guess if low < guess < high else 0.5 * (low + high)
    for _ in range(200):
        value = slope = 0.0
        for a in c:
            slope = slope * s + value
            value = value * s + a
        if value == 0:
            return s
        if value < 0:
            high = s
        else:
            low = s
        following = s - value / slope if slope else 0.5 * (low + high)
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - s) <= 4e-16 * high or high - low <= 4e-16 * high:
            return following
        s = following
    return s


def earliest(coefficients: Array) -> Array:
    """Return the first place in [0, 1] where each polynomial (power coefficients, a line each) may be 0, inf for none.

    The graph of a polynomial lies in the convex hull of its Bernstein points: it is not 0 before the hull reaches 0.
    """
    found = np.full(coefficients.shape[0], np.inf)
    others = np.abs(coefficients[:, 1:]).sum(axis=1)
    close = (coefficients[:, 0] <= others).nonzero()[0]
    if not close.size:
        return found
    order = coefficients.shape[1] - 1
    b = coefficients[close] @ _to_bernstein(order).T
    some = (b.min(axis=1) <= 0).nonzero()[0]
    if not some.size:
        return found
    b = b[some]
    place = np.arange(order + 1) / order
    crosses = (b[:, None, :] <= 0) & (b[:, :, None] > 0)
    part = b[:, :, None] / np.where(crosses, b[:, :, None] - b[:, None, :], 1.0)
    crossing = place[:, None] + (place - place[:, None]) * part
    first = np.where(crosses, crossing, np.inf).min(axis=(1, 2))
    # earlier than the crossing by a few roundoffs; 0 where a polynomial is not positive at the start
    first = np.where(b[:, 0] <= 0, 0.0, first * (1 - 1e-12))
    found[close[some]] = np.maximum(first, 0.0)
    return found
