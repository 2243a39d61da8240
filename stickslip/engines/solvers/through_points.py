"""Polynomials through the points that a solver computed.

A step passes the solver's error test where the polynomial through the points before it predicts its end within the
tolerances. So polynomials through points keep the tolerances between points, too, if each has the degree up to which
its terms fall: points in a layer that has ended say nothing of what follows, and points behind a kink say nothing of
what was before. Rates at the points are less accurate than the points: they have the errors of the states times the
Jacobian.

Adams methods predict their steps from rates, not from points. Where few points of unequal steps leave too large an
error, the rates at these points are used, too. They are no worse than the points, for a motion that is not stiff.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from stickslip.engines.work import SolverFailure, grows, within_bounds
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes, from_nodes
from stickslip.model.arrays import Array, Indices

# Highest degree for the points of a method: about that of its own polynomials.
_DEGREE = {"BDF": 6, "Adams": 12}

# Error, as a part of the tolerance, below which a higher degree adds nothing but the errors of the points.
_NEGLIGIBLE = 1e-2

_AHEAD = 2  # terms beyond a degree from which its error is estimated: one alone may be small by chance
_NO_STEP = 1e-6  # the end of a step shorter than this part of both its neighbours is dropped
_SHORT = 1e-3  # the end of a step of at least this part of its longer neighbour is kept, whatever its roundoff
_OF_START = 5  # points of the first two steps and beyond that tell how a motion begins
_MOST_WITH_RATES = 7  # points around a step whose rates are used at most
_ORDER_WITH_RATES = 2 * _MOST_WITH_RATES - 1  # the order of the polynomial through these points and rates
_AT_ONCE = 2000  # numbers of the states of steps for which polynomials are made at once with rates
_ROUNDOFF = np.finfo(float).eps

_AROUND, _ON_ONE_SIDE = 0.5, (1.0, 0.0)  # parts of the points that lie before a step


def path_through(
    motion: Motion, taus: Array, points: Array, tolerance: tuple[float, Any], method: str, hit: bool
) -> Path:
    """Return the path through the points of a solver.

    If some of them are not finite, or beyond all bounds, that is a `SolverFailure`.
    """
    taus, points = _apart(taus, points, tolerance[0])
    count = max(within_bounds(points), 1)
    is_finite, is_whole = bool(np.isfinite(points[: count + 1]).all()), count == taus.size
    taus, points = taus[:count], points[:count]
    rates = None if method == "BDF" else lambda k: motion.rate(taus[k], points[k].T).T
    # only borders of gaps and stops are compared with places, which are large beside what they move just after 0
    every = _of_all_steps if motion.equations.borders.size else through_points
    coefficients = every(taus, points, tolerance, _DEGREE[method], rates)
    path = Path(taus, coefficients, motion.exact(float(taus[-1]), points[-1]), hit, True)
    if not is_finite:
        raise SolverFailure(
            "the states have become infinite or not a number",
            "look at the forces and laws of the scene there",
            path,
        )
    if not is_whole:
        raise grows(path)
    return path


def _apart(taus: Array, points: Array, rtol: float) -> tuple[Array, Array]:
    """Return points without the ends of tiny steps between long ones: their differences are roundoff.

    The slope over a short step has the roundoff of the states over its length. Over a longer step beside it, this grows
    to the roundoff of the states times the ratio of both lengths.
    """
    steps = np.diff(taus)
    rough = min(_ROUNDOFF / rtol, _SHORT)
    if steps.size < 3 or steps[1:-1].min() >= max(_NO_STEP, rough) * steps.max():
        return taus, points
    shorter, longer = np.minimum(steps[:-2], steps[2:]), np.maximum(steps[:-2], steps[2:])
    kept = np.ones(taus.size, dtype=bool)
    kept[2:-1] = steps[1:-1] >= np.maximum(_NO_STEP * shorter, rough * longer)
    return taus[kept], points[kept]


def _of_all_steps(
    taus: Array, points: Array, tolerance: tuple[float, Any], degree: int, rates: Callable[[Indices], Array] | None
) -> Array:
    """Return `through_points`; if the first step is tiny, later ones without its end.

    Solvers begin with such a step. It shows how a motion begins, but its slope has the roundoff of the states over its
    length. Just behind it guards are near 0 that have left 0: there the errors of the path are to be small, not only
    within the tolerance.
    """
    if taus.size <= _OF_START or taus[1] >= _SHORT * (taus[2] - taus[1]):
        return through_points(taus, points, tolerance, degree, rates)
    start, kept = slice(_OF_START), np.delete(np.arange(taus.size), 1)
    known = None if rates is None else lambda k: rates(kept[k])
    begins = through_points(taus[start], points[start], tolerance, degree, rates)[:2]
    goes_on = through_points(taus[kept], points[kept], tolerance, degree, known)[1:]
    found = np.zeros((taus.size - 1, max(begins.shape[1], goes_on.shape[1]), points.shape[1]))
    found[:2, : begins.shape[1]] = begins
    found[2:, : goes_on.shape[1]] = goes_on
    return found


def through_points(
    taus: Array,
    points: Array,
    tolerance: tuple[float, Any],
    degree: int,
    rates: Callable[[Indices], Array] | None = None,
) -> Array:
    """Return Chebyshev coefficients (k, order + 1, size) of the states in each of the steps between `taus` (k + 1,).

    They are those of Newton's polynomial through both ends of the step and the points around it. Where its error is
    above the tolerance, the points on one side alone are tried, and then points with their `rates`, a function of the
    numbers of points.

    Terms are measured in units of the tolerance, relative and absolute; `degree` is the highest.
    """
    if (count := taus.size - 1) == 0:
        return np.empty((0, 1, points.shape[1]))
    differences, sizes = _differences(taus, points, tolerance, min(degree + _AHEAD, count))
    best, first, nodes, error = _newton(taus, sizes, np.arange(count), degree, _AROUND)
    rough = (error > 1.0).nonzero()[0]
    for before in _ON_ONE_SIDE if rough.size else ():
        other = _newton(taus, sizes, rough, degree, before)
        better = other[3] < error[rough]
        for ours, theirs in zip((best, first, nodes, error), other, strict=True):
            ours[..., rough[better]] = theirs[..., better]
    top = int(best.max())
    orders = np.arange(top + 1)[:, None]
    terms = differences[orders, first[: top + 1]]
    terms[orders > best] = 0.0
    x = taus[:-1, None] + np.diff(taus)[:, None] * chebyshev_nodes(top)
    basis = np.ones((count, top + 1, top + 1))
    np.cumprod(x[:, :, None] - nodes[:top].T[:, None, :], axis=2, out=basis[:, :, 1:])
    found: Array = (from_nodes(top) @ basis) @ terms.transpose(1, 0, 2)
    still = rough[error[rough] > 1.0]
    if still.size and rates is not None:
        found = np.pad(found, ((0, 0), (0, max(_ORDER_WITH_RATES - top, 0)), (0, 0)))
        for some in np.array_split(still, 1 + still.size * points.shape[1] // _AT_ONCE):
            own, errors = _with_rates(taus, points, rates, some, tolerance)
            better = errors < error[some]
            found[some[better]] = 0.0
            found[some[better], : _ORDER_WITH_RATES + 1] = own[better]
    return found


def _with_rates(
    taus: Array, points: Array, rates: Callable[[Indices], Array], steps: Indices, tolerance: tuple[float, Any]
) -> tuple[Array, Array]:
    """Return the Chebyshev coefficients of some steps through points and rates around them, and about their errors.

    Points are added as long as the polynomial, at first a line, changes less with each, and by more than what is
    negligible; the last change is the error.
    """
    counts = np.arange(2, min(_MOST_WITH_RATES, taus.size) + 1)[:, None]
    first = np.minimum(np.maximum(steps - (counts - 2) // 2, 0), taus.size - counts)
    added = np.where(first[1:] < first[:-1], first[1:], first[1:] + counts[1:] - 1)
    own = np.concatenate([steps[None], steps[None] + 1, added])
    length = taus[steps + 1] - taus[steps]
    # each point stands twice: the difference between both is its rate
    places = np.repeat((taus[own] - taus[steps]) / length, 2, axis=0)
    table = np.repeat(points[own], 2, axis=0)
    known, number = np.unique(own, return_inverse=True)
    slopes = rates(known)[number.reshape(own.shape)] * length[:, None]
    terms = table.copy()
    nodes = chebyshev_nodes(_ORDER_WITH_RATES)
    basis = np.ones((*places.shape, nodes.size))
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for order in range(1, places.shape[0]):
            table, gaps = np.diff(table, axis=0), places[order:] - places[:-order]
            if order == 1:
                table[::2], gaps[::2] = slopes, 1.0
            table /= gaps[..., None]
            terms[order] = table[0]
        np.cumprod(nodes - places[:-1, :, None], axis=0, out=basis[1:])
        sums = np.cumsum(basis[..., None] * terms[:, :, None], axis=0)
        ends = points[steps, None], points[steps + 1, None]
        found = np.concatenate([(ends[0] + nodes[:, None] * (ends[1] - ends[0]))[None], sums[3::2]])
        sizes = tolerance[0] * np.maximum(np.abs(ends[0]), np.abs(ends[1])) + tolerance[1]
        changes = (np.abs(np.diff(found, axis=0)) / sizes).max(axis=(2, 3))
    before = np.concatenate([np.full((1, steps.size), np.inf), changes])
    gains = changes < before[:-1]
    enough = gains & (changes <= _NEGLIGIBLE)
    goes_on = np.concatenate([gains & ~enough, np.zeros((1, steps.size), dtype=bool)])
    errors = np.concatenate([np.where(enough, changes, before[:-1]), before[-1:]])
    best, each = np.argmin(goes_on, axis=0), np.arange(steps.size)
    coefficients = from_nodes(_ORDER_WITH_RATES) @ found[best, each]
    # through k points and rates, or the ends alone: beyond the order of the polynomial there is only roundoff
    coefficients[np.arange(_ORDER_WITH_RATES + 1) > 2 * best[:, None] + 1] = 0.0
    return coefficients, errors[best, each]


def _differences(taus: Array, points: Array, tolerance: tuple[float, Any], highest: int) -> tuple[Array, Array]:
    """Return divided differences (order, points, size) from each point on, and their sizes in tolerances."""
    found = np.zeros((highest + 1, *points.shape))
    found[0] = points
    # over very short times they may overflow
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(1, highest + 1):
            np.subtract(found[k - 1, 1 : taus.size - k + 1], found[k - 1, :-k], out=found[k, :-k])
            found[k, :-k] /= (taus[k:] - taus[:-k])[:, None]
        parts = np.abs(found)
        parts /= tolerance[0] * np.abs(points) + tolerance[1]
    # the maximum is taken state by state: to take it of the two or three numbers of each point would take long
    sizes = np.ascontiguousarray(parts.transpose(2, 0, 1)).max(axis=0)
    return found, sizes


def _newton(
    taus: Array, sizes: Array, steps: Indices, degree: int, before: float
) -> tuple[Indices, Indices, Array, Array]:
    """Choose points for the polynomials of some steps.

    `sizes` are those of the divided differences. Of the points outside a step the part `before` lies before it, as long
    as there are any there. Returned are for each step the best degree; for each degree up to the highest and each step
    the first of the points; the points themselves, in the order in which they are added; and an estimate of the error
    with the best degree, in tolerances.
    """
    last = taus.size - 1
    top, most = min(degree, last), min(degree + _AHEAD, last)
    orders, behind = _window(most, before)
    first = np.maximum(np.minimum(steps - behind, last - orders), 0)
    # each order adds the point on the side to which the window has grown
    nodes = taus[np.concatenate([first[:1], np.where(first[1:] < first[:-1], first[1:], first[1:] + orders[1:])])]
    # bounds of the products in the terms over the step: of (x - start) (x - end) it is a quarter of the squared length
    half = 0.5 * (nodes[1] - nodes[0])
    factors = np.abs(nodes[:-1] - (nodes[0] + half))
    factors += half
    factors[1:2] *= 0.25
    terms = np.empty((most + _AHEAD, steps.size))
    with np.errstate(over="ignore", invalid="ignore"):
        terms[:most] = np.cumprod(factors, axis=0) * sizes[orders[1:], first[1:]]
    terms[np.isnan(terms)] = np.inf
    # unknown terms beyond the last one count as large as that
    terms[most:] = terms[most - 1]
    errors = np.maximum(terms[1 : 1 + top], terms[2 : 2 + top])
    enough = errors <= _NEGLIGIBLE
    # else the degree with the smallest error, of equal ones the highest; a line where no error is known
    least = np.where(np.isinf(errors).all(axis=0), 1, top - np.argmin(errors[::-1], axis=0))
    best = np.where(enough.any(axis=0), 1 + np.argmax(enough, axis=0), least)
    return best, first, nodes, errors[best - 1, np.arange(steps.size)]


@lru_cache(maxsize=64)
def _window(highest: int, before: float) -> tuple[Indices, Indices]:
    """Return the orders up to the highest, as a column, and how many points before a step each of them begins."""
    orders = np.arange(highest + 1)[:, None]
    return orders, np.ceil(before * np.maximum(orders - 1, 0)).astype(np.intp)
