"""How fast bodies move with each other: rows, springs, dampers and forces hand velocities on, by their levers."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise, product

import numpy as np

from stickslip.model.arrays import Array


class Transmission:
    """The parts of a scene, and how fast the bodies of each move with each other.

    `joined` are the coefficients of rows, springs and dampers on `n` bodies, and on drives, which join nothing. For
    each pair in `followed`, a force follows the first body and pushes the second: it hands velocities on that way only.

    Attributes
    ----------
    part : array (n,)
        The number of the part that each body belongs to.
    ratio : array (n,)
        Velocities of the bodies if each part moves as one, with a velocity of 1 of the body that stands for it. In a
        loop those levers count that are nearest to 1.
    is_uniform : bool
        Whether all bodies are one part, and the levers within each row, spring and damper are equal.
    """

    def __init__(
        self, n: int, joined: Sequence[Mapping[int, float]], followed: Collection[tuple[int, int]] = ()
    ) -> None:
        parts = _Parts(n)
        for i, j, ratio in sorted(_pairs(n, joined), key=lambda pair: abs(math.log(pair[2]))):
            parts.join(i, j, ratio)
        found = [parts.of(i) for i in range(n)]
        self.part = np.unique([first for first, _ in found], return_inverse=True)[1].astype(np.intp)
        self.ratio = np.array([ratio for _, ratio in found])
        led = [pair for one in joined for pair in _led(n, one)]
        self._led, self._by = np.array([pair[:2] for pair in led], dtype=np.intp).reshape(-1, 2).T
        self._lead = np.array([ratio for *_, ratio in led])
        ends = np.array(list(followed), dtype=np.intp).reshape(-1, 2)
        self._from, self._to = ends[self.part[ends[:, 0]] != self.part[ends[:, 1]]].T
        alike = all(len({abs(c) for c in one.values()}) <= 1 for one in joined)
        self.is_uniform = alike and not self.part.any()

    def led(self, drives: Array) -> Array:
        """Return the velocities that `drives` with these velocities may give the bodies to which they are joined."""
        found = np.zeros(self.ratio.size)
        np.maximum.at(found, self._led, self._lead * np.abs(drives)[self._by])
        return found

    def handed_on(self, speeds: Array) -> Array:
        """Return the velocities that bodies of these `speeds` may give each other; none exceeds the largest speed."""
        fastest = np.zeros(self.part.max(initial=-1) + 1)
        np.maximum.at(fastest, self.part, speeds / self.ratio)
        for _ in range(fastest.size if self._from.size else 0):
            before = fastest.copy()
            given = self.ratio[self._from] * fastest[self.part[self._from]]
            np.maximum.at(fastest, self.part[self._to], given / self.ratio[self._to])
            if (fastest == before).all():
                break
        return np.asarray(np.minimum(self.ratio * fastest[self.part], speeds.max(initial=0.0)))


class _Parts:
    """The parts of `n` bodies while they are joined: each body refers to one of its part, and has its ratio to that."""

    def __init__(self, n: int) -> None:
        self._other, self._ratio = list(range(n)), [1.0] * n

    def of(self, i: int) -> tuple[int, float]:
        """Return the body that stands for the part of a body, and its ratio to that."""
        way = []
        while self._other[i] != i:
            way.append(i)
            i = self._other[i]
        ratio = 1.0
        for k in reversed(way):
            ratio *= self._ratio[k]
            self._other[k], self._ratio[k] = i, ratio
        return i, ratio

    def join(self, i: int, j: int, ratio: float) -> None:
        """Join the parts of two bodies, of which one moves `ratio` times as fast as the other."""
        (one, own), (other, its) = self.of(i), self.of(j)
        if one != other:
            self._other[one], self._ratio[one] = other, ratio * its / own


def _pairs(n: int, joined: Sequence[Mapping[int, float]]) -> Iterator[tuple[int, int, float]]:
    """Return pairs of bodies that something joins, and how many times as fast as the second the first moves."""
    for one in joined:
        levers = [(abs(c), i) for i, c in one.items() if i < n and c]
        for (a, i), (b, j) in pairwise(levers):
            yield i, j, b / a


def _led(n: int, one: Mapping[int, float]) -> Iterator[tuple[int, int, float]]:
    """Return bodies and drives that something joins, and how many times as fast as the drive the body moves."""
    for (i, a), (k, c) in product(one.items(), repeat=2):
        if i < n <= k and a:
            yield i, k - n, abs(c / a)
