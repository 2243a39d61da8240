"""Polynomials through the points that a solver computed.

A step passes the solver's error test where the polynomial through the points before it foresees its end as far as the
tolerances allow. So polynomials through points keep what the tolerances promise between them, too, if each has the
degree up to which its terms fall: points in a layer that has ended say nothing of what follows, and points behind a
kink say nothing of what was before. Rates at the points would say less than the points do: they have the errors of the
states times the Jacobian.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.engines.work import SolverFailure
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes, from_nodes
from stickslip.model.arrays import Array, Indices

_DEGREE = {"BDF": 6, "Adams": 12}
"""Highest degree for the points of a method: about that of its own polynomials."""

_NEGLIGIBLE = 1e-2
"""Error, as a part of the tolerance, from which on a higher degree adds nothing but the errors of the points."""

_AHEAD = 2
"""Terms beyond a degree that tell its error: one alone may be small by chance."""


def path_through(
    motion: Motion, taus: Array, points: Array, tolerance: tuple[float, Any], method: str, hit: bool
) -> Path:
    """Return the path through the points of a solver.

    If some of them are not finite, that is a `SolverFailure`.
    """
    fine = np.isfinite(points).all(axis=1)
    count = taus.size if fine.all() else int(fine.argmin())
    taus, points = taus[:count], points[:count]
    coefficients = through_points(taus, points, tolerance, _DEGREE[method])
    path = Path(taus, coefficients, motion.exact(float(taus[-1]), points[-1]), hit, True)
    if count < fine.size:
        raise SolverFailure(
            "the states have become infinite or not a number",
            "look at the forces and laws of the scene there",
            path,
        )
    return path


def through_points(taus: Array, points: Array, tolerance: tuple[float, Any], degree: int) -> Array:
    """Return Chebyshev coefficients (k, order + 1, size) of the states in each of the steps between `taus` (k + 1,).

    In each step they are Newton's polynomial: through both its ends, and on to the points on that side on which the
    next term stays smaller. Where that leaves more than the tolerance, it is tried on the points before the step alone.

    The tolerance, relative and absolute, is what terms are measured in; `degree` is the highest.
    """
    if (count := taus.size - 1) == 0:
        return np.empty((0, 1, points.shape[1]))
    differences = _Differences(taus, points, tolerance)
    best, first, nodes, error = _newton(differences, np.arange(count), degree, False)
    rough = (error > 1.0).nonzero()[0]
    if rough.size:
        other = _newton(differences, rough, degree, True)
        better = other[3] < error[rough]
        worse = rough[better]
        best[worse], first[:, worse], nodes[:, worse] = (x[..., better] for x in other[:3])
    top = int(best.max())
    terms = np.array([differences.of(k)[0][first[k]] for k in range(top + 1)])
    terms[np.arange(top + 1)[:, None] > best] = 0.0
    x = taus[:-1, None] + np.diff(taus)[:, None] * chebyshev_nodes(top)
    basis = np.ones((count, top + 1, top + 1))
    np.cumprod(x[:, :, None] - nodes[:top].T[:, None, :], axis=2, out=basis[:, :, 1:])
    found: Array = (from_nodes(top) @ basis) @ terms.transpose(1, 0, 2)
    return found


class _Differences:
    """Divided differences of points, from each of them on, and their sizes in tolerances."""

    def __init__(self, taus: Array, points: Array, tolerance: tuple[float, Any]) -> None:
        self.taus, self._known = taus, [(points, np.empty(0))]
        self._weight = 1.0 / (tolerance[0] * np.abs(points) + tolerance[1])

    def of(self, order: int) -> tuple[Array, Array]:
        """Return those of an order, and their sizes."""
        for k in range(len(self._known), order + 1):
            before = self._known[-1][0]
            found = (before[1:] - before[:-1]) / (self.taus[k:] - self.taus[:-k])[:, None]
            self._known.append((found, (np.abs(found) * self._weight[:-k]).max(axis=1)))
        return self._known[order]


def _newton(
    differences: _Differences, steps: Indices, degree: int, only_before: bool
) -> tuple[Indices, Indices, Array, Array]:
    """Choose points for the polynomials of some steps.

    If `only_before`, points behind a step are left out as long as there are others. Returned are for each step the best
    degree; for each degree up to the highest and each step the first of the points; the points themselves, in the order
    in which they are added; and about the error with the best degree, in tolerances.
    """
    taus = differences.taus
    top, most = min(degree, taus.size - 1), min(degree + _AHEAD, taus.size - 1)
    left, start, end = steps, taus[steps], taus[steps + 1]
    first, nodes = np.zeros((most + 1, steps.size), dtype=np.intp), np.zeros((most + 1, steps.size))
    first[0], nodes[0], nodes[1] = steps, start, end
    # how large the products of the terms are at most: (x - start) (x - end) is a quarter of the squared length
    largest, reach = end - start, 0.25 * (end - start)
    sizes = np.empty((most + _AHEAD, steps.size))
    padded = np.concatenate([taus[:1] - 1.0, taus, taus[-1:] + 1.0])
    for k in range(1, most + 1):
        first[k], sizes[k - 1] = left, largest * differences.of(k)[1][left]
        if k == most or (k > _AHEAD and sizes[k - _AHEAD : k].max() <= _NEGLIGIBLE):
            break
        largest = largest * reach
        before, after = padded[left], padded[left + k + 2]
        if only_before:
            goes_left = left > 0
        else:
            ahead = np.concatenate([[np.inf], differences.of(k + 1)[1], [np.inf]])
            goes_left = ahead[left] * (end - before) < ahead[left + 1] * (after - start)
        nodes[k + 1] = np.where(goes_left, before, after)
        reach = np.where(goes_left, end - before, after - start)
        left = left - goes_left
    # what is not known beyond the last term counts as no smaller than that
    sizes[k:] = sizes[k - 1]
    errors = np.maximum(sizes[1 : 1 + top], sizes[2 : 2 + top])
    enough = errors <= _NEGLIGIBLE
    # else the degree with the smallest error, of equal ones the highest
    best = np.where(enough.any(axis=0), 1 + np.argmax(enough, axis=0), top - np.argmin(errors[::-1], axis=0))
    return best, first, nodes, errors[best - 1, np.arange(steps.size)]
