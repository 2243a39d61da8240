"""Stuck bodies as rigid groups, and the forces that hold them together.

Eq. (1) of Breedveld (2000) holds for every stuck contact of a tree: cut the group at the contact, and
``lambda = (F_A m_B - F_B m_A) / (m_A + m_B)`` with the forces and inertias of the two sides. That is
``F_A - m_A a`` with the acceleration ``a`` of the whole group, and so it is computed: in this form it also
holds for groups that a prescribed body holds. Contacts that close a loop make the forces ambiguous; then the
forces of least norm are given.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.sparse.linalg import splu

__all__ = ["Groups"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_SMALL = 100
_RIGID = 1e10
"""Force between prescribed bodies that part, as a multiple of inertia times relative acceleration."""


class Groups:
    """The rigid groups that stuck contacts form, and the map from body forces to contact forces.

    Parameters
    ----------
    inertia : array (n,)
        Inertias of the free bodies.
    a, b : array (s,)
        Ends of the stuck contacts: free bodies below n, prescribed ones from n on.

    Attributes
    ----------
    leader : array (n,)
        For each free body the first free body of its group.
    holder : array (n,)
        The prescribed body that its group is stuck to, -1 for a free group; of several, the first contact's.
    free : array (n,)
        Whether its group is free.
    moves_together : bool
        Whether any free group has more than one member.
    mass : array (n,)
        Inertia of the whole group of each body.
    redundant : bool
        Whether contacts close loops, so that their forces are not unique.
    """

    def __init__(self, inertia: Array, a: Indices, b: Indices) -> None:
        """Find the groups, and prepare what their forces need."""
        self.n, self.count = inertia.size, a.size
        self._inertia, self._a, self._b = inertia, a, b
        self._is_small = self.n + self.count <= _SMALL
        (self._group_few if self._is_small else self._group_many)()
        self.free = self.holder < 0
        self.moves_together = bool(np.any(self.free & (self.leader != np.arange(self.n))))
        self.mass = self.totals(inertia)
        self._child = np.flatnonzero(self._edge >= 0)
        self._carrier = self._edge[self._child]
        self.redundant = self._child.size < self.count
        if self.redundant:
            self._prepare_least_norm()
        else:
            self._sign = np.where(a[self._carrier] == self._child, 1.0, -1.0)
            self._sums = self._prepare_sums()
            self._sub_mass = self._sums(inertia)

    # -- trees: each body but the roots has a parent, and an edge, the contact that joins it to that ---------

    def _group_few(self) -> None:
        """Walk each group from its root: the body that a prescribed one holds, or the heaviest."""
        n = self.n
        near: list[list[tuple[int, int]]] = [[] for _ in range(n)]
        fixed: list[tuple[int, int, int]] = []
        for contact, (i, j) in enumerate(zip(self._a.tolist(), self._b.tolist(), strict=True)):
            if i < n and j < n:
                near[i].append((j, contact))
                near[j].append((i, contact))
            else:
                fixed.append((min(i, j), max(i, j), contact))
        parent, edge, holder, leader = [-1] * n, [-1] * n, [-1] * n, [-1] * n
        order: list[int] = []

        def walk(root: int, contact: int, held_by: int) -> None:
            members = [root]
            leader[root], edge[root] = root, contact
            for i in members:
                for j, between in near[i]:
                    if leader[j] < 0:
                        leader[j], parent[j], edge[j] = root, i, between
                        members.append(j)
            first = min(members)
            for i in members:
                leader[i], holder[i] = first, held_by
            order.extend(members)

        for i, prescribed, contact in fixed:
            if leader[i] < 0:
                walk(i, contact, prescribed)
        for i in sorted(range(n), key=lambda i: -self._inertia[i]):
            if leader[i] < 0:
                walk(i, -1, -1)
        self._order, self._parent, self._edge = np.array(order), np.array(parent), np.array(edge)
        self.holder, self.leader = np.array(holder), np.array(leader)

    def _group_many(self) -> None:
        """Do the same with sparse graphs: one tree from a root above all groups."""
        n, contacts = self.n, np.arange(self.count)
        inner = (self._a < n) & (self._b < n)
        a, b = self._a[inner], self._b[inner]
        graph = sparse.coo_array((np.ones(a.size), (a, b)), shape=(n, n))
        count, group = connected_components(graph, directed=False)
        first = np.empty(count, dtype=np.intp)
        first[group[::-1]] = np.arange(n)[::-1]
        self.leader = first[group]
        # assigned in reverse, the first contact's (or body's) value remains
        fixed = contacts[~inner][::-1]
        held, prescribed = (f(self._a[fixed], self._b[fixed]) for f in (np.minimum, np.maximum))
        root, root_edge, holder = np.empty(count, dtype=np.intp), np.full(count, -1), np.full(count, -1)
        by_weight = np.argsort(self._inertia, kind="stable")
        root[group[by_weight]] = by_weight
        root[group[held]], root_edge[group[held]], holder[group[held]] = held, fixed, prescribed
        self.holder = holder[group]
        rows, columns = np.r_[a, np.full(count, n)], np.r_[b, root]
        graph = sparse.coo_array((np.ones(rows.size), (rows, columns)), shape=(n + 1, n + 1))
        order, parent = breadth_first_order(graph.tocsr(), n, directed=False)
        self._order = order[1:]
        self._parent = np.where(parent[:n] < n, parent[:n], -1).astype(np.intp)
        self._edge = np.full(n, -1)
        for child, other in ((a, b), (b, a)):
            tree = self._parent[child] == other
            self._edge[child[tree][::-1]] = contacts[inner][tree][::-1]
        self._edge[root] = root_edge

    def _prepare_sums(self) -> Callable[[Array], Array]:
        """Return a function that sums values over each body and all bodies further from the root."""
        child = np.flatnonzero(self._parent >= 0)
        if not child.size:
            return np.array
        if self._is_small:
            outside_in = [(i, p) for i in self._order[::-1].tolist() if (p := int(self._parent[i])) >= 0]

            def add_up(values: Array) -> Array:
                sums = np.array(values)
                for i, above in outside_in:
                    sums[above] += sums[i]
                return sums

            return add_up
        # one column per body, from the roots out: 1 for itself and -1 for the body it hangs on
        place = np.empty(self.n + 1, dtype=np.int32)
        place[self._order] = np.arange(self.n)
        above = self._parent[self._order]
        hangs = above >= 0
        ends = np.cumsum(1 + hangs, dtype=np.int32)
        rows, values = np.empty(ends[-1], dtype=np.int32), np.ones(ends[-1])
        rows[ends - 1] = np.arange(self.n)
        rows[ends[hangs] - 2], values[ends[hangs] - 2] = place[above[hangs]], -1.0
        matrix = sparse.csc_array((values, rows, np.append(np.int32(0), ends)), shape=(self.n, self.n))
        solver = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0)

        order = self._order

        def solve(values: Array) -> Array:
            sums = np.empty_like(values)
            sums[order] = solver.solve(values[order])
            return sums

        return solve

    # -- loops ---------------------------------------------------------------------------------------------

    def _prepare_least_norm(self) -> None:
        """Prepare ``lambda = G x`` with ``G^T G x = F - m a``: forces of that form have the least norm."""
        ends = np.r_[self._a, self._b]
        rows = np.tile(np.arange(self.count), 2)
        signs = np.repeat([1.0, -1.0], self.count)
        inner = ends < self.n
        triplets = (signs[inner], (rows[inner], ends[inner]))
        self._incidence = sparse.coo_array(triplets, shape=(self.count, self.n)).tocsc()
        # x counts by differences within a free group: it is 0 at its root
        pins = sparse.diags_array((self._edge < 0).astype(float))
        self._laplacian = splu((self._incidence.T @ self._incidence + pins).tocsc())

    def _least_norm(self, forces: Array) -> Array:
        """Return the contact forces of least norm whose resultants are the `forces` on the bodies."""
        found = self._incidence @ self._laplacian.solve(forces)
        # long chains are badly conditioned: solve once more for what is left
        return found + self._incidence @ self._laplacian.solve(forces - self._incidence.T @ found)

    # -- what is asked of the groups -----------------------------------------------------------------------

    def mean(self, forces: Array) -> Array:
        """Return each body's group acceleration ``sum F / sum m``, zero where the group is held."""
        wide = (slice(None), None) if forces.ndim == 2 else slice(None)
        return np.where(self.free[wide], self.totals(forces) / self.mass[wide], 0.0)

    def totals(self, values: Array) -> Array:
        """Return for each body the sum of values (rows) over its group."""
        if values.ndim == 1:
            return np.bincount(self.leader, weights=values, minlength=self.n)[self.leader]
        total = np.zeros_like(values)
        np.add.at(total, self.leader, values)
        return total[self.leader]

    def contact_forces(self, forces: Array, held_acceleration: Array, parting: Array | None = None) -> Array:
        """Return the stuck contacts' forces by eq. (1), least norm where they are not unique.

        Parameters
        ----------
        forces : array (n,) or (n, k)
            All other forces on the free bodies.
        held_acceleration : array like `forces`
            Acceleration of the prescribed body that holds each body, 0 for free groups.
        parting : array (s,) or (s, k), optional
            Relative acceleration ``a_a - a_b`` of each contact when every group follows its holder. It is not
            0 where a group is stuck to prescribed bodies that accelerate differently: not all of its contacts
            can stay stuck, and the forces on the way from one body to the other come out huge.

        Returns
        -------
        array (s,) or (s, k)
        """
        wide = (slice(None), None) if forces.ndim == 2 else slice(None)
        acceleration = self.mean(forces) + held_acceleration
        if self.redundant:
            found = self._least_norm(forces - self._inertia[wide] * acceleration)
            if parting is not None and parting.any():
                stiff = _RIGID * self.mass[np.minimum(self._a, self._b)][wide] * parting
                found += stiff - self._least_norm(self._incidence.T @ stiff)
            return found
        found = np.zeros((self.count, *forces.shape[1:]))
        child = self._child
        if child.size:
            cut = self._sums(forces)[child] - self._sub_mass[child][wide] * acceleration[child]
            found[self._carrier] = self._sign[wide] * cut
        return found
