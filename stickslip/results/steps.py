"""The steps of many paths side by side: all their polynomials are evaluated at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate

import numpy as np

from stickslip.equations.path import Path, values, whole_integrals
from stickslip.model.arrays import Array, Complex, Indices, Mask

_COEFFICIENTS_AT_ONCE = 50_000
_LEAST = np.finfo(float).tiny


@dataclass(frozen=True)
class Steps:
    """The steps of paths of one kind, path after path; each path ends with a step of length 0."""

    begins: Array  # (k,): local time at which each begins, in s
    lengths: Array  # (k,): in s
    firsts: Indices  # (p + 1,): the number of the first step of each path, then the number of all steps
    coefficients: Array = field(repr=False)  # (k, terms, size)
    is_chebyshev: bool

    @classmethod
    def of(cls, paths: Sequence[Path]) -> Steps:
        """Return the steps of some paths, at least one; polynomials with fewer terms than others are padded."""
        begins = np.concatenate([path.taus for path in paths])
        firsts = np.array([0, *accumulate([path.taus.size for path in paths])])
        lengths = np.zeros(begins.size)
        # from the end of a path to the next begin, which is 0, the difference is negative
        np.maximum(begins[1:] - begins[:-1], 0.0, out=lengths[:-1])
        terms = max([1, *[path.coefficients.shape[1] for path in paths]])
        coefficients = np.zeros((begins.size, terms, paths[0].last.size))
        for path, first in zip(paths, firsts.tolist(), strict=False):
            steps, own, _ = path.coefficients.shape
            coefficients[first : first + steps, :own] = path.coefficients
            coefficients[first + steps, 0] = path.last
        return cls(begins, lengths, firsts, coefficients, paths[0].is_chebyshev)

    @property
    def paths(self) -> int:
        """How many paths there are."""
        return self.firsts.size - 1

    @property
    def counts(self) -> Indices:
        """How many steps each path has."""
        return self.firsts[1:] - self.firsts[:-1]

    def values(self, path_of: Indices, taus: Array) -> Array:
        """Return the states at local times of paths, a line each."""
        return values(self.coefficients, *self._places(path_of, taus), self.is_chebyshev)

    def integrals(self, path_of: Indices, taus: Array, count: int) -> Array:
        """Return the integrals of the first states from the starts of paths to local times, a line each."""
        own = self.coefficients[:, :, :count]
        step, s = self._places(path_of, taus)
        whole = self.lengths[:, None] * (whole_integrals(own.shape[1], self.is_chebyshev) @ own)
        before = np.cumsum(whole, axis=0) - whole
        inner = self.lengths[step, None] * values(own, step, s, self.is_chebyshev, integrated=True)
        return np.asarray(before[step] - before[self.firsts[path_of]] + inner)

    def _places(self, path_of: Indices, taus: Array) -> tuple[Indices, Array]:
        """Return the step that holds each local time, and where in it, from 0 to 1."""
        step = self._order.searchsorted(path_of + 1j * taus, "right") - 1
        # in a step of length 0 the only time is its begin, and the place is 0
        return step, (taus - self.begins[step]) / np.maximum(self.lengths[step], _LEAST)

    @cached_property
    def _order(self) -> Complex:
        """The path and the begin of each step as one complex number, in rising order.

        Complex numbers are sorted by their real parts, and those with equal real parts by their imaginary parts.
        """
        return np.arange(self.paths).repeat(self.counts) + 1j * self.begins


class Blocks:
    """The steps of many paths in blocks of limited size; if one block holds all, it is kept."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = paths
        self._all = Steps.of(paths) if len(list(_slices(paths))) == 1 else None

    def __iter__(self) -> Iterator[Steps]:
        """Yield all steps in order."""
        if self._all is not None:
            yield self._all
        else:
            yield from (Steps.of(self._paths[some]) for some in _slices(self._paths))

    def of(self, path_of: Indices) -> Iterator[tuple[Mask | slice, Indices, Steps]]:
        """Yield which entries of `path_of` a block holds, the numbers of their paths in it, and its steps."""
        if self._all is not None:
            yield slice(None), path_of, self._all
            return
        is_there = np.zeros(len(self._paths), dtype=bool)
        is_there[path_of] = True
        paths = [self._paths[k] for k in is_there.nonzero()[0].tolist()]
        path_of = (is_there.cumsum() - 1)[path_of]
        in_order = bool((path_of[1:] >= path_of[:-1]).all())
        for some in _slices(paths):
            within: Mask | slice = (path_of >= some.start) & (path_of < some.stop)
            if in_order:
                # reading and writing a slice takes a tenth of the time
                within = slice(*path_of.searchsorted([some.start, some.stop]).tolist())
            yield within, path_of[within] - some.start, Steps.of(paths[some])


def _slices(paths: Sequence[Path]) -> Iterator[slice]:
    """Yield which paths are put side by side: of the same kind, and not too many."""
    first = ends = terms = 0
    for k, path in enumerate(paths):
        ends, terms = ends + path.taus.size, max(terms, path.coefficients.shape[1])
        is_other = path.is_chebyshev != paths[first].is_chebyshev
        if k > first and (is_other or ends * terms * path.last.size > _COEFFICIENTS_AT_ONCE):
            yield slice(first, k)
            first, ends, terms = k, path.taus.size, path.coefficients.shape[1]
    if paths:
        yield slice(first, len(paths))
