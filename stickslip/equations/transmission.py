"""How fast bodies move with each other: what ties, springs, dampers and friction hand on, by their levers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from stickslip.model.arrays import Array, Indices


class Transmission:
    """The parts of a scene, and how fast the bodies of each move with each other.

    `joined` are the coefficients of rows, springs and dampers on `n` bodies, and on drives, which join nothing. If
    `is_one`, forces that follow bodies join all of them.

    Attributes
    ----------
    part : array (n,)
        The number of the part that each body belongs to.
    ratio : array (n,)
        Velocities of the bodies where all of their part move with one whose velocity is 1. In a loop those levers count
        that are nearest to 1.
    """

    def __init__(self, n: int, joined: Sequence[Mapping[int, float]], is_one: bool) -> None:
        ends = [
            (k, i, abs(c)) for k, one in enumerate(joined, start=n) for i, c in one.items() if i < n and c
        ]
        joint, body, lever = np.array(ends).reshape(-1, 3).T
        place, size, logs = (joint.astype(np.intp), body.astype(np.intp)), n + len(joined), np.log(lever)
        graph = scipy.sparse.csr_array((1.0 + np.abs(logs), place), (size, size))
        part: Indices = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
        self.part: Indices = np.zeros(n, dtype=np.intp) if is_one else part[:n]
        self.ratio = np.ones(n)
        if logs.any():
            # along a tree the rate of each joint is its lever times the velocity of the body
            joint, body = scipy.sparse.csgraph.minimum_spanning_tree(graph).nonzero()
            lever = scipy.sparse.csr_array((logs, place), (size, size))[joint, body]
            first, count = np.unique(part, return_index=True)[1], joint.size
            rows = np.concatenate([np.arange(count), np.arange(count), np.arange(count, size)])
            signs = np.repeat([1.0, -1.0, 1.0], [count, count, first.size])
            equations = scipy.sparse.csc_array(
                (signs, (rows, np.concatenate([joint, body, first]))), (size, size)
            )
            wanted = np.concatenate([lever, np.zeros(first.size)])
            self.ratio = np.exp(scipy.sparse.linalg.spsolve(equations, wanted)[:n])

    @property
    def is_uniform(self) -> bool:
        """Whether all bodies move with each other, one as fast as the other."""
        return not self.part.any() and bool((self.ratio == 1.0).all())

    def handed_on(self, speeds: Array) -> Array:
        """Return the velocities that bodies may have from each other; none is faster than the fastest."""
        fastest = np.zeros(self.part.max(initial=-1) + 1)
        np.maximum.at(fastest, self.part, speeds / self.ratio)
        return np.asarray(np.minimum(self.ratio * fastest[self.part], speeds.max(initial=0.0)))
