"""A solver taken step by step, and what its own polynomials say within the steps.

CVODE and IDA carry one polynomial through each step, of degree 5 at most for BDF and 12 for Adams: six values hold
all of it, or thirteen. No other interpolant keeps what the tolerances promise: rates at computed points are
errors of the states times the Jacobian, and points further back know nothing of a layer that has just ended.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["INNER", "Points", "Taken", "read_off", "take_steps", "within"]

Array = NDArray[np.float64]

INNER = {"BDF": 4, "Adams": 11}
"""How many values inside a step hold, with those at its ends, the polynomial of a method."""

_MANY, _ROUNDOFF = 5, 1e-14
"""Every second of so many values is read first: where steps are short for stability's sake, degrees are low."""


class Points(Protocol):
    """Computed points (rows) and the values inside the steps between them: step, place, state."""

    @property
    def taus(self) -> Array:
        """Local times in s."""

    @property
    def states(self) -> Array:
        """A row for each time."""

    @property
    def inner(self) -> Array | None:
        """None where no solver took the steps."""


class Taken(NamedTuple):
    """Steps as the solver took them, and what it returned last."""

    taus: Array
    states: Array
    inner: Array
    last: Any


@cache
def nodes(inner: int) -> Array:
    """Return the Chebyshev points from 0 to 1, `inner` of them inside: no others magnify errors less."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(inner + 2) / (inner + 1))


def within(taus: Array, inner: int) -> Array:
    """Return the times inside the steps at which their polynomials are held: a row for each step."""
    return taus[:-1, None] + np.diff(taus)[:, None] * nodes(inner)[1:-1]


def take_steps(solver: Any, tau: float, start: Array, inner: int, reading: Callable[[bool], None]) -> Taken:
    """Let a solver go on to `tau` or to a root, and read its polynomial in each step.

    Parameters
    ----------
    solver : CVODE or IDA
        Ready to take its first step at local time 0.
    tau : float
        Local time in s that it may not pass.
    start : array
        Its unknowns at the start.
    inner : int
        How many values are read within each step.
    reading : callable
        Told when reading begins and ends: the solver looks at its guards then, which must not end anything.
    """
    step = solver.step

    def read(fractions: Array) -> list[Array]:
        return [step(before + x * (now - before), "normal").y for x in fractions.tolist()]

    fractions, few = nodes(inner)[1:-1], inner > _MANY
    taus, states, inside = [0.0], [start], list[Array]()
    now = 0.0
    while True:
        solution = step(tau, "onestep", tau)
        if solution.status < 0:
            break
        before, now = now, float(solution.t)
        taus.append(now)
        states.append(solution.y)
        reading(True)
        if few:
            half = read(fractions[1::2])
            found = _of_low_degree(np.array([states[-2], *half, states[-1]]), inner)
            if found is None:
                found = np.empty((inner, start.size))
                found[1::2], found[::2] = half, read(fractions[::2])
            inside.append(found)
        else:
            inside.append(np.array(read(fractions)))
        if solution.status != 0:
            reading(False)
            break
        # back to the end of the step, or it would be returned once more
        step(now, "normal")
        reading(False)
    shape = (len(inside), inner, start.size)
    return Taken(np.array(taus), np.array(states), np.array(inside).reshape(shape), solution)


def _of_low_degree(half: Array, inner: int) -> Array | None:
    """Return all values inside a step from every second one, where the polynomial's degree is low enough for that."""
    high, fill = _from_half(inner)
    size = np.abs(half).max(axis=0)
    return fill @ half if np.all(np.abs(high @ half) <= _ROUNDOFF * size) else None


@cache
def _from_half(inner: int) -> tuple[Array, Array]:
    """Return what gives the two highest Chebyshev coefficients of every second value, and all values inside."""
    places = 2 * nodes(inner) - 1
    inverse = np.linalg.inv(np.polynomial.chebyshev.chebvander(places[::2], inner // 2 + 1))
    fill = np.polynomial.chebyshev.chebvander(places[1:-1], inner // 2 + 1) @ inverse
    return np.asarray(inverse[-2:], dtype=float), np.asarray(fill, dtype=float)


def read_off(points: Points, query: Array) -> Array:
    """Return the states (rows) at local times, from the polynomial of each step."""
    taus, states, inner = points.taus, points.states, points.inner
    if inner is None or taus.size == 1:
        return np.repeat(states[:1], query.size, axis=0)
    i = np.clip(np.searchsorted(taus, query, side="right") - 1, 0, taus.size - 2)
    h = taus[i + 1] - taus[i]
    away = np.divide(query - taus[i], h, out=np.ones(query.size), where=h > 0)[:, None] - nodes(
        inner.shape[1]
    )
    places = nodes(inner.shape[1])
    last = places.size - 1
    found = np.zeros((query.size, states.shape[1]))
    for k, place in enumerate(places.tolist()):
        others = np.arange(places.size) != k
        weight = np.prod(away[:, others] / (place - places[others]), axis=1)[:, None]
        found += weight * (states[i] if k == 0 else states[i + 1] if k == last else inner[i, k - 1])
    return found
