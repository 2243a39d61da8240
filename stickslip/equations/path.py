"""How a motion went: a polynomial in each step, and why it ended."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial.chebyshev import chebint, chebvander
from numpy.polynomial.polynomial import polyint

from stickslip.equations.algebra.polynomials import powers
from stickslip.model.arrays import Array, Indices

_FEW = 400  # values of Chebyshev polynomials up to which cosines are faster than the recurrence
_AT_ONCE = 50_000  # coefficients that are evaluated at once


@dataclass(frozen=True)
class Path:
    """The states of one motion as a polynomial in each step."""

    taus: Array  # (k + 1,): ends of the steps in s since the start of the motion, the first 0
    # (k, order + 1, size): in step i the state is ``sum_j coefficients[i, j] p_j(s)``, s from 0 to 1 over it
    coefficients: Array
    last: Array  # (size,): the state at the end
    hit: bool  # whether a guard came to 0 at the end
    is_chebyshev: bool = False  # whether ``p_j(s) = T_j(2 s - 1)``; ``s^j`` if not
    touched: int | None = None  # the row whose relative velocity touches 0 at the end, None for none
    guard: int | None = None  # the guard that came to 0 at the end, None where that is not known

    @property
    def has_event(self) -> bool:
        """Whether something came to its limit at the end."""
        return self.hit or self.touched is not None

    @property
    def points(self) -> Array:
        """The states at the ends of the steps, one row each."""
        first = self.coefficients[:, 0]
        if self.is_chebyshev:
            first = self._at_start(self.coefficients)
        return np.concatenate([first, self.last[None, :]])

    @staticmethod
    def _at_start(coefficients: Array) -> Array:
        return np.asarray(coefficients[:, 0::2].sum(axis=1) - coefficients[:, 1::2].sum(axis=1))

    @staticmethod
    def of_start(y: Array) -> Path:
        """Return the path of a motion that has not been followed yet: its first state."""
        return Path(np.zeros(1), np.empty((0, 1, y.size)), y, False, True)

    def state(self, tau: float) -> Array:
        """Return the state at one local time."""
        found: Array = self.at(np.array([tau]))[0]
        return found

    def at(self, taus: Array) -> Array:
        """Return the states at local times, one row each."""
        c = self.coefficients
        if not c.shape[0]:
            return np.repeat(self.last[None, :], taus.size, axis=0)
        i = np.minimum(np.maximum(self.taus.searchsorted(taus, "right") - 1, 0), c.shape[0] - 1)
        h = self.taus[i + 1] - self.taus[i]
        s = np.divide(taus - self.taus[i], h, out=np.zeros(taus.size), where=h > 0)
        found = values(c, i, s, self.is_chebyshev)
        found[taus >= self.taus[-1]] = self.last
        return found

    @cached_property
    def largest(self) -> Array:
        """A bound of the sizes of the states along the path."""
        if not self.coefficients.shape[0]:
            return np.abs(self.last)
        return np.asarray(np.abs(self.coefficients).sum(axis=1).max(axis=0))

    def cut(self, tau: float) -> Path:
        """Return the path up to local time `tau`, within it."""
        if tau <= 0:
            return Path(self.taus[:1], self.coefficients[:0], self.points[0], False, self.is_chebyshev)
        i = min(max(int(self.taus.searchsorted(tau)) - 1, 0), self.coefficients.shape[0] - 1)
        pieces = self.coefficients[: i + 1].copy()
        part = (tau - self.taus[i]) / (self.taus[i + 1] - self.taus[i])
        order = pieces.shape[1] - 1
        if self.is_chebyshev:
            basis = chebyshev_values(2 * part * chebyshev_nodes(order) - 1, order)
            pieces[i] = from_nodes(order) @ basis @ pieces[i]
        else:
            pieces[i] *= (part ** np.arange(order + 1))[:, None]
        return Path(np.append(self.taus[: i + 1], tau), pieces, self.state(tau), False, self.is_chebyshev)


def values(coefficients: Array, step: Indices, s: Array, is_chebyshev: bool, integrated: bool = False) -> Array:
    """Return the values of the polynomials of some steps at places from 0 to 1, or their integrals from 0 on."""
    _, terms, size = coefficients.shape
    weights = np.ascontiguousarray(_weights(s, terms, is_chebyshev, integrated))
    found = np.empty((s.size, size))
    # not too many at once: they are to fit into the processor's cache
    count = _AT_ONCE // (terms * size) + 1
    for first in range(0, s.size, count):
        some = slice(first, first + count)
        np.matmul(weights[some, None], coefficients.take(step[some], axis=0), out=found[some, None])
    return found


def _weights(s: Array, terms: int, is_chebyshev: bool, integrated: bool) -> Array:
    """Return the weights of the coefficients at places from 0 to 1, a line each."""
    highest = terms if integrated else terms - 1
    basis = chebyshev_values(2 * s - 1, highest) if is_chebyshev else powers(s, highest + 1)
    return np.asarray(basis @ _integrals(terms, is_chebyshev) if integrated else basis)


@lru_cache(maxsize=64)
def whole_integrals(terms: int, is_chebyshev: bool) -> Array:
    """Return the weights of the coefficients in the integral over a whole step of length 1."""
    return np.asarray(_weights(np.ones(1), terms, is_chebyshev, integrated=True)[0])


@lru_cache(maxsize=64)
def _integrals(terms: int, is_chebyshev: bool) -> Array:
    """Return the coefficients of the integrals of the first polynomials, a column each."""
    each = np.eye(terms)
    return np.asarray(chebint(each, lbnd=-1, scl=0.5) if is_chebyshev else polyint(each))


def chebyshev_values(x: Array, order: int) -> Array:
    """Return the Chebyshev polynomials up to an order at some places from -1 to 1, one row each."""
    if x.size * order > _FEW:
        return np.asarray(chebvander(x, order))
    # for few values this takes a fourth of the time
    return np.asarray(np.cos(np.multiply.outer(np.arccos(np.minimum(np.maximum(x, -1.0), 1.0)), np.arange(order + 1))))


@lru_cache(maxsize=32)
def chebyshev_nodes(order: int) -> Array:
    """Return the Chebyshev points from 0 to 1, both ends among them."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(order + 1) / max(order, 1))


@lru_cache(maxsize=32)
def from_nodes(order: int) -> Array:
    """Return the matrix from values at the Chebyshev points to Chebyshev coefficients."""
    places = 2 * chebyshev_nodes(order) - 1
    return np.asarray(np.linalg.inv(chebvander(places, order)))


@lru_cache(maxsize=64)
def gauss_nodes(count: int) -> tuple[Array, Array]:
    """Return nodes from -1 to 1 and weights of the Gauss-Legendre rule, exact for polynomials of order 2 count - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return nodes, weights
