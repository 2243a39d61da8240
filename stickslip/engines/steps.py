"""A SUNDIALS solver taken step by step, and what its own polynomials say within the steps.

CVODE and IDA carry one polynomial through each step, of degree 5 at most for BDF and 12 for Adams: six values hold
all of it, or thirteen. No other interpolant keeps what the tolerances promise: rates at computed points are errors of
the states times the Jacobian, and points further back know nothing of a layer that has just ended.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.path import chebyshev_nodes, from_nodes

__all__ = ["DEGREE", "Taken", "take_steps"]

Array = NDArray[np.float64]

DEGREE = {"BDF": 5, "Adams": 12}
"""Highest degree of a method's polynomials."""

_MANY, _ROUNDOFF = 6, 1e-14
"""Every second of so many values is read first: where steps are short for stability's sake, degrees are low."""


class Taken(NamedTuple):
    """Steps as the solver took them, Chebyshev coefficients within them, and what it returned last."""

    taus: Array
    coefficients: Array
    state: Array
    last: Any


def take_steps(solver: Any, tau: float, start: Array, degree: int, reading: Callable[[bool], None]) -> Taken:
    """Let a solver go on to `tau` or to a root, and read its polynomial in each step.

    Parameters
    ----------
    solver : CVODE or IDA
        Ready to take its first step at local time 0.
    tau : float
        Local time in s that it may not pass.
    start : array
        Its unknowns at the start.
    degree : int
        Highest degree of its polynomials.
    reading : callable
        Told when reading begins and ends: the solver looks at its guards then, which must not end anything.
    """
    step = solver.step

    def read(fractions: Array) -> list[Array]:
        return [step(before + x * (now - before), "normal").y for x in fractions.tolist()]

    fractions, few = chebyshev_nodes(degree)[1:-1], degree > _MANY
    taus, pieces = [0.0], list[Array]()
    now, state = 0.0, start
    while True:
        solution = step(tau, "onestep", tau)
        if solution.status < 0:
            break
        before, now = now, float(solution.t)
        taus.append(now)
        previous, state = state, np.array(solution.y)
        reading(True)
        found = None
        if few:
            half = read(fractions[1::2])
            found = _of_low_degree(np.array([previous, *half, state]), degree)
            if found is None:
                values = np.empty((degree + 1, start.size))
                values[0], values[-1] = previous, state
                values[2:-1:2], values[1:-1:2] = half, read(fractions[::2])
                found = from_nodes(degree) @ values
        else:
            found = from_nodes(degree) @ np.array([previous, *read(fractions), state])
        pieces.append(found)
        if solution.status != 0:
            reading(False)
            break
        # back to the end of the step, or it would be returned once more
        step(now, "normal")
        reading(False)
    coefficients = np.array(pieces).reshape(len(pieces), degree + 1, start.size)
    return Taken(np.array(taus), coefficients, state, solution)


def _of_low_degree(half: Array, degree: int) -> Array | None:
    """Return the coefficients from every second value, where the polynomial's degree is low enough for that."""
    inverse = _from_half(degree)
    found = inverse @ half
    size = np.abs(half).max(axis=0)
    if np.any(np.abs(found[-2:]) > _ROUNDOFF * size):
        return None
    return np.concatenate([found, np.zeros((degree + 1 - found.shape[0], half.shape[1]))])


@cache
def _from_half(degree: int) -> Array:
    """Return the matrix from every second value to the Chebyshev coefficients of half the degree."""
    places = 2 * chebyshev_nodes(degree)[::2] - 1
    return np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(places, degree // 2)))
