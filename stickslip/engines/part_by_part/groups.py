"""The groups of a scene that is followed part by part: bodies that held rows join have one velocity."""

from __future__ import annotations

import numpy as np
import scipy

from stickslip.engines.part_by_part.knots import Knot
from stickslip.equations.algebra.matrices import split_by
from stickslip.equations.forest import Forest
from stickslip.model.arrays import Indices, Mask

UNLED = -2  # the lead of a group that nothing leads; else it is -1 for the ground, or the number of a drive


class Groups:
    """Which bodies move together; a body alone is the group of its own number, and a knot is a group, too.

    `held` are the rows that are held and belong to trees.

    Attributes
    ----------
    of : array (n,)
        The group of each body.
    lead : array (n,)
        The lead of the group of each body.
    inside : dict
        The rows that hold a group together, or to what leads it.
    count : int
        All numbers of groups, those of former groups too, are smaller.
    """

    def __init__(self, forest: Forest, knots: list[Knot], held: Indices) -> None:
        n = forest.n
        self._forest, self._any_knots = forest, bool(knots)
        self.of, self.lead, self.count = np.arange(n), np.full(n, UNLED), n
        self._members: dict[int, Indices] = {}
        self.inside: dict[int, Indices] = {}
        self._join_trees(held)
        led = held[forest.parent[held] < 0]
        for j, i in zip(led.tolist(), forest.child[led].tolist(), strict=True):
            self.lead[self.bodies(int(self.of[i]))] = forest.drive[j]
            if self.of[i] == i:
                self.inside[i] = np.array([j])
        for knot in knots:
            # nothing leads it as a whole
            self.join(knot.bodies, held[:0], UNLED)

    def _join_trees(self, held: Indices) -> None:
        """Make groups of bodies that held rows join to each other."""
        forest, n = self._forest, self._forest.n
        inner = held[forest.parent[held] >= 0]
        if not inner.size:
            return
        graph = scipy.sparse.coo_array((np.ones(inner.size), (forest.child[inner], forest.parent[inner])), shape=(n, n))
        component = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
        rows = held[np.argsort(component[forest.child[held]], kind="stable")]
        row_component = component[forest.child[rows]]
        for own in split_by(component[forest.body_at], forest.body_at):
            if own.size > 1:
                low, high = np.searchsorted(row_component, [component[own[0]], component[own[0]] + 1])
                self.join(own, rows[low:high], UNLED)

    def bodies(self, g: int) -> Indices:
        """Return the bodies of a group in order of their places."""
        return self._members[g] if g >= self._forest.n else np.array([g])

    def join(self, bodies: Indices, rows: Indices, lead: int) -> None:
        """Make bodies one group, held together by rows."""
        if bodies.size == 1:
            g = int(bodies[0])
        else:
            g = self.count
            self.count += 1
            self._members[g] = bodies
        self.of[bodies] = g
        if rows.size:
            self.inside[g] = rows
        self.lead[bodies] = lead

    def part(self, g: int) -> None:
        """Forget a group."""
        self._members.pop(g, None)
        self.inside.pop(g, None)

    def among(self, bodies: Indices) -> tuple[Indices, Indices, Indices | None]:
        """Return the groups of some bodies, the place of one body of each group, and the place of each body's group.

        The last is None where each body is a group. Here the bodies of a knot are groups of their own.
        """
        groups = self.of[bodies]
        if self._any_knots:
            groups = np.where(self._forest.knot_of[bodies] >= 0, bodies, groups)
        if (groups == bodies).all():
            return groups, np.arange(bodies.size), None
        found, first, own = np.unique(groups, return_index=True, return_inverse=True)
        return found, first, own

    def reach(self, groups: list[int], neighbours: list[list[int]]) -> Indices:
        """Return the bodies of some groups, first, and of all others that these reach by couplings to neighbours."""
        forest, of, lead = self._forest, self.of, self.lead
        if not forest.is_coupled:
            return np.concatenate([self.bodies(g) for g in groups])
        seen = dict.fromkeys(groups)
        edge = groups
        for depth in range(forest.hops):
            following: list[int] = []
            for g in edge:
                own = [g] if g < forest.n else self._members[g].tolist()
                if depth and lead[own[0]] != UNLED:
                    # a change goes no farther through a group that the ground or a drive leads
                    continue
                for i in own:
                    for k in neighbours[i]:
                        other = int(of[k])
                        if other not in seen:
                            seen[other] = None
                            following.append(other)
            edge = following
            if not edge:
                break
        if max(seen) < forest.n:
            return np.array(list(seen))
        return np.concatenate([self.bodies(g) for g in seen])

    def sharing(self, some: Mask) -> Indices:
        """Return the bodies of all groups to which some bodies belong."""
        found = np.zeros(self.count, dtype=bool)
        found[self.of[some]] = True
        return found[self.of].nonzero()[0]
