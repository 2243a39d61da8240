"""Stuck bodies as rigid groups, and the forces that hold them together.

Eq. (1) of Breedveld (2000) holds for every stuck contact of a tree: cut the group at the contact, and
``lambda = (F_A m_B - F_B m_A) / (m_A + m_B)`` with the forces and inertias of the two sides. Contacts that
close a loop make the forces ambiguous; then the forces of least norm are given.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.sparse.linalg import splu

__all__ = ["Groups"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_SMALL = 100


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
        The prescribed body that its group is stuck to, -1 for a free group.
    mass : array (n,)
        Inertia of the whole group of each body.
    """

    def __init__(self, inertia: Array, a: Indices, b: Indices) -> None:
        self.n, self.count = inertia.size, a.size
        self._inertia, self._a, self._b = inertia, a, b
        if self.n + self.count > _SMALL:
            self._grow_tree_sparse()
        else:
            self._grow_tree()
        self.mass = np.bincount(self._label, weights=inertia, minlength=self.n)[self._label]
        self.free = self.holder < 0
        self._sub_mass = self._subtree_sums(inertia)

    def _grow_tree(self) -> None:
        """Walk each group from its root: the prescribed bodies, else the heaviest body."""
        n = self.n
        near: list[list[tuple[int, int]]] = [[] for _ in range(n)]
        fixed: list[tuple[int, int, int]] = []
        for contact, (i, j) in enumerate(zip(self._a.tolist(), self._b.tolist(), strict=True)):
            if i < n and j < n:
                near[i].append((j, contact))
                near[j].append((i, contact))
            else:
                fixed.append((min(i, j), max(i, j), contact))
        parent, edge, holder, label = [-1] * n, [-1] * n, [-1] * n, [-1] * n
        order: list[int] = []

        def walk(first: int, held_by: int) -> None:
            queue = [first]
            for i in queue:
                order.append(i)
                for j, contact in near[i]:
                    if label[j] < 0:
                        label[j], parent[j], edge[j], holder[j] = label[first], i, contact, held_by
                        queue.append(j)

        for i, prescribed, contact in fixed:
            if label[i] < 0:
                label[i], edge[i], holder[i] = i, contact, prescribed
                walk(i, prescribed)
        for i in sorted(range(n), key=lambda i: -self._inertia[i]) if self.count > len(fixed) else range(n):
            if label[i] < 0:
                label[i] = i
                walk(i, -1)
        self._order, self._parent, self._edge = np.array(order), np.array(parent), np.array(edge)
        self.holder, self._label = np.array(holder), np.array(label)
        self._lead()

    def _grow_tree_sparse(self) -> None:
        n = self.n
        a, b = np.minimum(self._a, n), np.minimum(self._b, n)
        ones = np.ones(self.count)
        graph = sparse.coo_array((ones, (a, b)), shape=(n + 2, n + 2))
        _, component = connected_components(graph, directed=False)
        heaviest = np.lexsort((-self._inertia, component[:n]))
        first = heaviest[np.r_[True, np.diff(component[heaviest]) > 0]]
        roots = np.r_[first[component[first] != component[n]], n]
        rows, columns = np.r_[a, np.full(roots.size, n + 1)], np.r_[b, roots]
        graph = sparse.coo_array((np.ones(rows.size), (rows, columns)), shape=(n + 2, n + 2)).tocsr()
        order, parent = breadth_first_order(graph, n + 1, directed=False)
        self._order = order[order < n]
        ahead = parent[:n].astype(np.intp)
        self._edge = np.full(n, -1)
        contacts = np.arange(self.count)
        # the lower of doubled contacts carries the tree
        for child, other in ((a, b), (b, a)):
            tree = (child < n) & (ahead[np.minimum(child, n - 1)] == other)
            self._edge[child[tree][::-1]] = contacts[tree][::-1]
        self._parent = np.where(ahead < n, ahead, -1)
        self.holder = np.full(n, -1)
        self._label = self._labels(component[:n])
        held = np.flatnonzero(ahead == n)
        prescribed = np.maximum(self._a, self._b)[self._edge[held]]
        by_label = np.full(n, -1)
        by_label[self._label[held]] = prescribed
        if held.size and np.unique(prescribed).size > 1:
            self._hold_branches(held, prescribed)
        else:
            self.holder = by_label[self._label]
        self._lead()

    def _labels(self, component: Indices) -> Indices:
        first = np.full(int(component.max(initial=0)) + 1, self.n)
        np.minimum.at(first, component, np.arange(self.n))
        return first[component]

    def _hold_branches(self, held: Indices, prescribed: Indices) -> None:
        """Bodies held by different prescribed bodies share a tree: pass each holder down its own branch."""
        self.holder[held] = prescribed
        label = self._label
        label[held] = held
        is_root = np.zeros(self.n, dtype=bool)
        is_root[held] = True
        for i in self._order:
            if not is_root[i] and self._parent[i] >= 0:
                self.holder[i], label[i] = self.holder[self._parent[i]], label[self._parent[i]]

    def _lead(self) -> None:
        first = np.full(self.n, self.n)
        np.minimum.at(first, self._label, np.arange(self.n))
        self.leader = first[self._label]
        tree = self._edge[self._edge >= 0]
        self.redundant = tree.size < self.count
        self._child = np.flatnonzero(self._edge >= 0)
        self._sign = np.where(self._a[tree] == self._child, 1.0, -1.0)
        self._subtree_solver = None
        if self.redundant:
            self._prepare_least_norm()

    def _prepare_least_norm(self) -> None:
        keep_a, keep_b = self._a < self.n, self._b < self.n
        rows = np.arange(self.count)
        incidence = sparse.coo_array(
            (
                np.r_[np.ones(keep_a.sum()), -np.ones(keep_b.sum())],
                (np.r_[rows[keep_a], rows[keep_b]], np.r_[self._a[keep_a], self._b[keep_b]]),
            ),
            shape=(self.count, self.n),
        ).tocsc()
        pins = np.zeros(self.n)
        pins[self._edge < 0] = 1.0
        laplacian = (incidence.T @ incidence + sparse.diags_array(pins)).tocsc()
        self._incidence, self._laplacian = incidence, splu(laplacian)

    def _subtree_sums(self, values: Array) -> Array:
        """Return for each body the sum over itself and all bodies further from the root."""
        if self.n + self.count <= _SMALL:
            sums = np.array(values)
            parent = self._parent
            for i in self._order[::-1]:
                if parent[i] >= 0:
                    sums[parent[i]] += sums[i]
            return sums
        if not self._child.size:
            return values
        if self._subtree_solver is None:
            child = np.flatnonzero(self._parent >= 0)
            matrix = sparse.eye_array(self.n, format="csc") - sparse.csc_array(
                (np.ones(child.size), (self._parent[child], child)), shape=(self.n, self.n)
            )
            place = np.empty(self.n, dtype=np.intp)
            place[self._order] = np.arange(self.n)
            matrix = matrix.tocoo()
            ordered = sparse.csc_array((matrix.data, (place[matrix.row], place[matrix.col])), shape=matrix.shape)
            self._subtree_solver = splu(ordered, permc_spec="NATURAL", diag_pivot_thresh=0.0)
        sums = np.empty_like(values)
        sums[self._order] = self._subtree_solver.solve(np.ascontiguousarray(values[self._order]))
        return sums

    def mean(self, forces: Array) -> Array:
        """Return each body's group acceleration ``sum F / sum m``, zero where the group is held."""
        if forces.ndim == 1:
            total = np.bincount(self._label, weights=forces, minlength=self.n)[self._label]
            return np.where(self.free, total / self.mass, 0.0)
        total = np.zeros_like(forces)
        np.add.at(total, self._label, forces)
        return np.where(self.free[:, None], total[self._label] / self.mass[:, None], 0.0)

    def contact_forces(self, forces: Array, held_acceleration: Array) -> Array:
        """Return the stuck contacts' forces by eq. (1), least norm where they are not unique.

        Parameters
        ----------
        forces : array (n,) or (n, k)
            All other forces on the free bodies.
        held_acceleration : array like `forces`
            Acceleration of the prescribed body that holds each body, 0 for free groups.

        Returns
        -------
        array (s,) or (s, k)
        """
        wide = forces.ndim == 2
        mass = self.mass[:, None] if wide else self.mass
        inertia = self._inertia[:, None] if wide else self._inertia
        if self.redundant:
            acceleration = self.mean(forces) + held_acceleration
            return self._incidence @ self._laplacian.solve(np.ascontiguousarray(forces - inertia * acceleration))
        child = self._child
        result = np.zeros((self.count, *forces.shape[1:]))
        if not child.size:
            return result
        sub = self._subtree_sums(forces)[child]
        sub_mass = (self._sub_mass[:, None] if wide else self._sub_mass)[child]
        total = self.mean(forces)[child] * mass[child]
        mass, free = mass[child], self.free[child]
        free = free[:, None] if wide else free
        split = (sub * (mass - sub_mass) - (total - sub) * sub_mass) / mass
        held = sub - sub_mass * held_acceleration[child]
        sign = self._sign[:, None] if wide else self._sign
        result[self._edge[child]] = sign * np.where(free, split, held)
        return result

