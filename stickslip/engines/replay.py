"""The polynomials of CVODE's steps, read by letting it take the same steps once more.

CVODE carries one polynomial through each step. Asking for its values while stepping costs a call for each value. So it
first runs alone to the end, and what it asks for, the rates, is kept. Then a second solver, which is told the
same in the same order, takes the same steps to the last bit, and hands over all values in one call.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.engines.steps import DEGREE, Taken
from stickslip.equations.path import chebyshev_nodes, from_nodes

__all__ = ["Replay"]

Array = NDArray[np.float64]

_LOW = 6
"""Degree that is tried first, half of the highest: high ones are rare where steps are short for stability's sake."""

_ROOT = 2
"""The status of a solver that has stopped at a root."""

_NEARLY = 1 - 1e-12
"""A step that is shortened not to pass a time ends this near to it at least."""

_NEGLIGIBLE = 1e-2
"""Part of the tolerances that the last coefficients of a polynomial may be."""

_FIRST = 1e-3
"""Longest first step as a part of the time ahead."""


class Replay:
    """Rates of one run of CVODE, in the order in which it asked for them.

    Parameters
    ----------
    rate : callable
        ``rate(tau, y, out)``.
    jacobian : callable
        ``jacobian(tau, y, rate, out)``.
    """

    def __init__(self, rate: Callable[..., None], jacobian: Callable[..., None]) -> None:
        self._rate, self._jacobian = rate, jacobian
        self._rates: list[Array] = []
        self._next, self._farthest = 0, 0.0

    # -- what the first solver calls, and the second ---------------------------------------------------------

    def rate(self, tau: float, y: Array, out: Array) -> None:
        """Compute a rate and keep it."""
        self._rate(tau, y, out)
        self._rates.append(out.copy())
        if tau > self._farthest:
            self._farthest = tau

    def known_rate(self, tau: float, y: Array, out: Array) -> None:
        """Return the next rate; none is known beyond the last step, which ends the second run at once."""
        out[:] = self._rates[self._next] if self._next < len(self._rates) else np.nan
        self._next += 1

    def known_jacobian(self, tau: float, y: Array, rate: Array, out: Array) -> None:
        """Compute a Jacobian again."""
        if self._next <= len(self._rates):
            self._jacobian(tau, y, rate, out)
        else:
            out[:] = 0.0

    # -- the two runs ----------------------------------------------------------------------------------------

    def take(
        self, solver: Any, second: Any, tau: float, start: Array, method: str, tolerance: tuple[float, Any]
    ) -> Taken:
        """Let a solver go on to local time `tau` or to a root, and return its steps and their polynomials.

        Parameters
        ----------
        solver, second : CVODE
            With the same options, among them the length of the first step; the first one with a guard.
        tau : float
        start : array
            Its unknowns at the start.
        method : str
            "BDF" or "Adams".
        tolerance : (float, float or array)
            Relative and absolute.
        """
        self._rates.clear()
        self._farthest = 0.0
        found = solver.solve(np.array([0.0, tau]), start)
        taus, points = found.t, found.y
        if found.status < 0 and taus.size > 1:
            # the last point has been returned twice
            taus, points = taus[:-1], points[:-1]
        degree, count = DEGREE[method], taus.size - 1
        if not count:
            return Taken(taus, np.empty((0, degree + 1, start.size)), start, found)
        # a step that ends in a root went beyond it: a solver that may go no farther than the first one ever went takes
        # the same steps, and then there is nothing left to do. One that tried to go to `tau` itself was shortened
        # there, by a part of what was left to `tau`
        stop = self._farthest if found.status == _ROOT and self._farthest < _NEARLY * tau else tau
        ask = partial(self._ask, second, taus, points, stop=max(stop, float(taus[-1])))
        if degree <= _LOW:
            return Taken(
                taus, from_nodes(degree) @ ask(np.arange(count), degree, 1), points[-1].copy(), found
            )
        low = ask(np.arange(count), _LOW, 1)
        coefficients = np.zeros((count, degree + 1, start.size))
        coefficients[:, : _LOW + 1] = from_nodes(_LOW) @ low
        allowed = _NEGLIGIBLE * (tolerance[0] * np.abs(points[1:]) + tolerance[1])
        high = (np.abs(coefficients[:, _LOW - 1 : _LOW + 1]) > allowed[:, None]).any(axis=(1, 2)).nonzero()[0]
        if high.size:
            # every second place of the high degree is one of the low degree
            values = ask(high, degree, 2)
            values[:, ::2] = low[high]
            coefficients[high] = from_nodes(degree) @ values
        return Taken(taus, coefficients, points[-1].copy(), found)

    def _ask(
        self,
        second: Any,
        taus: Array,
        points: Array,
        steps: NDArray[np.intp],
        degree: int,
        stride: int,
        stop: float,
    ) -> Array:
        """Return the values of some steps at the Chebyshev points of a degree: at both ends, and every `stride`-th."""
        inner = chebyshev_nodes(degree)[1:-1:stride]
        before, after = taus[steps], taus[steps + 1]
        times = (before[:, None] + (after - before)[:, None] * inner).ravel()
        # times so close that rounding makes them one are asked for once
        asked, place = np.unique(np.append(times, stop), return_inverse=True)
        self._next = 0
        told = second.solve(np.concatenate([[0.0], asked]), points[0]).y[1:]
        if told.shape[0] < asked.size - 1:
            raise ArithmeticError("the solver did not take the same steps once more")
        values = np.empty((steps.size, degree + 1, points.shape[1]))
        values[:, 0], values[:, -1] = points[steps], points[steps + 1]
        values[:, 1:-1:stride] = told[place[:-1]].reshape(steps.size, inner.size, -1)
        return values


def first_step(second_derivative: Array, y: Array, tolerance: tuple[float, Any], longest: float) -> float:
    """Return a length in s for the first step: over it, the solution bends by a small part of its tolerance."""
    with np.errstate(all="ignore"):
        bend = np.abs(second_derivative) / (tolerance[0] * np.abs(y) + tolerance[1])
    worst = min(float(bend.max(initial=0.0)), 1e300)
    return min(_FIRST * longest, 0.1 / worst**0.5) if worst > 0 else _FIRST * longest
