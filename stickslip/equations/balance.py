"""Accelerations and held forces: the balance of all forces while some rows are held.

With H the held rows, ``M v' + G_H^T lambda = F`` and ``G_H v' + D_H u' = 0``. Elimination with one dependent velocity
per row, the lightest bodies first, gives ``v = T v_ind + U u``; then

    T^T M T v_ind' = T^T (F - M U u'),    lambda = S^T (F - M v')_dep.

For two bodies that is eq. (1) of Breedveld (2000), ``lambda = F_a - m_a a``. In a tree of contacts it is the sum of
``F - m a`` over the bodies on one side of the row. Rows that lock the same motion leave lambda undetermined; the forces
of least norm are returned.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense, row_maxima, split_by
from stickslip.model.arrays import Array, Indices, Mask, like

# A difference below this part of the subtracted number is 0: numbers of the scene agree in no more digits.
_CANCELLED = 1e-14

_SMALL = 60  # connected rows up to which a component is eliminated densely
_REMEMBERED = 2000  # small components that are remembered; each takes up to some 50 kB
_TINY = 8  # connected rows up to which a component takes so little memory that all those of a scene are remembered
_ZERO = 1e-11

_TORN = 1e-9  # part of its majorant below which a force between drives that move apart is roundoff

# Where drives move apart, the force of the held rows between them is this many times the inertia of the rows' bodies
# times the relative acceleration.
_RIGID = 1e10


class Balance:
    """Accelerations and held forces of one set of held rows.

    `G` and `D` are the coefficients of the held rows on the free bodies and on the drives. For sparse ones,
    ``component(some)`` returns the component that some of these rows form; it may remember components of earlier
    balances. ``independent(coefficients)`` turns coefficients on all drives into coefficients on independent drives:
    the velocities of all others are sums of theirs.

    Attributes
    ----------
    T : array or sparse (n, n)
        Velocities of all bodies from those of the independent ones; the columns of dependent ones are 0.
    U : array or sparse (n, d)
        What the velocities of drives add to those of bodies.
    dependent : array of int
        Bodies whose velocities follow from those of independent bodies and drives.
    T_dependent, U_dependent : array or sparse
        Their rows of T and U.
    loop : array (h,) of int
        The number of the loop of each row whose force is not unique, -1 for all others. Loops that share rows are one.
    parting : array or sparse (h, d) or None
        Map from the accelerations of drives to the forces that rows would need to hold drives together that move apart;
        None where drives cannot tear any rows.
    """

    def __init__(
        self,
        inertia: Array,
        G: Any,
        D: Any,
        component: Callable[[Indices], _Eliminated] | None = None,
        independent: Callable[[Array], Array] = np.asarray,
    ) -> None:
        self._inertia, self._is_sparse = inertia, not isinstance(G, np.ndarray)
        self._n, self.count = inertia.size, G.shape[0]
        self.loop = np.full(self.count, -1)
        self._large: list[tuple[Indices, _Tree]] = []
        if self._is_sparse:
            G, D = G.tocsr(), D.tocsr()
            self._eliminate_many(G, D, component or Components(inertia, G, D, independent).component)
        else:
            part = _Component(inertia, G, D, independent)
            self.T, self.U, self.dependent = part.T, part.U, part.dependent
            self._S = part.S
            self.parting, self.loop = part.parting, part.loop
        self._finish()

    @property
    def changed_accelerations(self) -> float:
        """A bound of how many accelerations a force on each body changes, summed over these forces.

        It is inf where there are large trees.
        """
        led: Any = self.T
        return math.inf if self._large else float((led.count_nonzero(axis=0) ** 2).sum())

    def torn(self, rates: Array, roughness: Array) -> Mask:
        """Tell which rows drives tear that have these accelerations (d,), or (d, k) for each of some accelerations.

        The accelerations are uncertain by their `roughness` (d,).
        """
        if self.parting is None:
            return np.zeros((self.count, *rates.shape[1:]), dtype=bool)
        rough = abs(self.parting) @ (_TORN * np.abs(rates) + like(roughness, rates))
        return np.asarray(np.abs(self.parting @ rates) > rough)

    @cached_property
    def together(self) -> Balance:
        """The same balance for drives that do not move apart: the forces that would hold them together are left out."""
        found = copy.copy(self)
        found.parting = None
        return found

    @cached_property
    def is_driven(self) -> bool:
        """Whether the velocity of any body depends on those of drives."""
        return bool(abs(self.U_dependent).sum() > 0)

    @cached_property
    def has_loops(self) -> bool:
        """Whether the forces of some rows are not unique."""
        return bool(self.loop.max(initial=-1) >= 0)

    def _finish(self) -> None:
        T: Any = self.T
        self.T_dependent, self.U_dependent = T[self.dependent], self.U[self.dependent]
        inertia = self._inertia
        independent = np.ones(self._n, dtype=bool)
        independent[self.dependent] = False
        some = np.flatnonzero(independent)
        self._TT = T.T.tocsr() if self._is_sparse else T.T
        if self._is_sparse:
            reduced = (self._TT @ (scipy.sparse.diags_array(inertia) @ T)).tocsr()
            self._reduced = _inverse_of_blocks(reduced, some)
        else:
            part = T[:, some]
            reduced = (part.T * inertia) @ part
            self._reduced = np.zeros((self._n, self._n))
            diagonal = reduced.diagonal()
            if (diagonal <= 0).any():
                reduced[np.diag_indices(some.size)] = np.where(diagonal > 0, diagonal, 1.0)
            if np.count_nonzero(reduced) == np.count_nonzero(diagonal):
                self._reduced[some, some] = 1.0 / reduced.diagonal()
            else:
                self._reduced[np.ix_(some, some)] = np.linalg.inv(reduced)
            # accelerations of all bodies from the forces on all bodies
            self._mobility = T @ self._reduced @ T.T

    def _eliminate_many(self, G: Any, D: Any, component: Callable[[Indices], _Eliminated]) -> None:
        """Eliminate each connected component of the held rows for itself."""
        n, h, d = self._n, self.count, D.shape[1]
        T, U, S = _Entries(), _Entries(), _Entries()
        dependent: list[Indices] = []
        parting = _Entries()
        single, bodies, c = _alone(G)
        # a body that one row holds to the ground or a drive: c v + D u = 0
        led = D[single].tocoo()
        U.add((bodies[led.row], led.col, -led.data / c[led.row]))
        S.add((single, np.arange(single.size), 1.0 / c))
        dependent.append(bodies)
        first = single.size
        others = np.setdiff1d(np.arange(h), single)
        for rows in split_by(component_numbers(G[others]), others) if others.size else []:
            tree = _Tree.of(self._inertia, G[rows], D[rows]) if rows.size > _SMALL else None
            if tree is not None:
                T.add(tree.T)
                U.add(tree.U)
                own = tree.dependent
                self._large.append((rows, tree))
            else:
                part = component(rows)
                T.add(part.T)
                U.add(part.U)
                own = part.dependent
                i, j, forces = part.S
                S.add((rows[i], first + j, forces))
                if part.loop is not None:
                    self.loop[rows] = np.where(part.loop >= 0, part.loop + first, -1)
                if part.parting is not None:
                    parting.block(rows, np.arange(d), part.parting)
            first += own.size
            dependent.append(own)
        alone = np.setdiff1d(np.arange(n), G.indices)
        T.add((alone, alone, np.ones(alone.size)))
        self.T, self.U = T.matrix((n, n)), U.matrix((n, d))
        self.dependent = np.concatenate(dependent)
        self._S = S.matrix((h, self.dependent.size))
        self.parting = parting.matrix((h, d)) if parting else None

    def consistent(self, v: Array, u: Array) -> Array:
        """Return velocities with dependent ones written through T, the independent ones as they are."""
        led: Array = self.T @ v
        return led + self.U @ u if self.is_driven else led

    def project(self, v: Array, u: Array) -> Array:
        """Return velocities that satisfy the held rows exactly, momentum conserved (MODEL rule 7)."""
        if not self.count:
            return v
        off = v - self.consistent(v, u)
        return self.consistent(v + self._reduced @ (self._TT @ (self._inertia * off)), u)

    def accelerations(self, forces: Array, drives: Array | None = None) -> Array:
        """Return accelerations of all bodies; `forces` are all but those of held rows, `drives` are accelerations."""
        if drives is not None and self.count:
            led = self.U @ drives
            return self._respond(forces - like(self._inertia, led) * led) + led
        return self._respond(forces)

    def _respond(self, forces: Array) -> Array:
        is_sparse = self._is_sparse
        found: Array = self.T @ (self._reduced @ (self._TT @ forces)) if is_sparse else self._mobility @ forces
        return found

    def held_forces(self, forces: Array, acceleration: Array, drives: Array | None = None) -> Array:
        """Return the forces of the held rows; of least norm where they are not unique."""
        if not self.count:
            return np.zeros((0, *forces.shape[1:]))
        rest = forces - like(self._inertia, forces) * acceleration
        found = self._S @ rest[self.dependent]
        for rows, tree in self._large:
            found[rows] = tree.forces(rest)
        if self.parting is not None and drives is not None:
            found = found + self.parting @ drives
        return found

    def majorants(self, forces: Array, drives: Array) -> tuple[Array, Array]:
        """Return majorants of the accelerations and of the held forces: sums of the absolute values of their terms.

        They follow from majorants of the forces on the bodies and of the accelerations of drives.
        """
        inertia = like(self._inertia, forces)
        led = abs(self.U) @ drives if self.is_driven else None
        acceleration: Array = forces if led is None else forces + inertia * led
        for factor in reversed(self._abs_maps[1:]):
            acceleration = factor @ acceleration
        if led is not None:
            acceleration = acceleration + led
        rest = forces + inertia * acceleration
        held: Array = self._abs_maps[0] @ rest[self.dependent]
        for rows, tree in self._large:
            held[rows] = tree.majorants(rest)
        return acceleration, held if self.parting is None else held + abs(self.parting) @ drives

    @cached_property
    def _abs_maps(self) -> tuple[Any, ...]:
        if not self._is_sparse:
            return abs(self._S), np.abs(self._mobility)
        return abs(self._S), abs(self.T), abs(self._reduced), abs(self._TT)


class Components:
    """Eliminates connected components of a scene's rows, and remembers small ones: an event changes only few."""

    def __init__(self, inertia: Array, G: Any, D: Any, independent: Callable[[Array], Array] = np.asarray) -> None:
        self._inertia, self._G, self._D, self._independent = inertia, G, D, independent
        # a memory with less room than one set of held rows needs would forget each component before it comes back
        self._tiny = lru_cache(maxsize=max(_REMEMBERED, G.shape[0]))(self._eliminated)
        self._small = lru_cache(maxsize=_REMEMBERED)(self._eliminated)

    def component(self, rows: Indices) -> _Eliminated:
        """Return the component that some rows form."""
        if rows.size > _SMALL:
            return self._eliminated(rows.tobytes())
        return (self._tiny if rows.size <= _TINY else self._small)(rows.tobytes())

    def are_torn(self, rows: Indices) -> bool:
        """Tell whether drives that move apart tear some rows that are connected."""
        # a tree cannot be torn; small components are remembered anyway
        is_tree = rows.size > _SMALL and _Tree.of(self._inertia, self._G[rows], self._D[rows]) is not None
        return not is_tree and self.component(rows).parting is not None

    def _eliminated(self, key: bytes) -> _Eliminated:
        rows = np.frombuffer(key, dtype=np.intp)
        G, D = self._G[rows], self._D[rows].toarray()
        bodies = np.unique(G.indices)
        found = _Component(self._inertia[bodies], G[:, bodies].toarray(), D, self._independent)
        (i, j), (k, drive), (row, place) = found.T.nonzero(), found.U.nonzero(), found.S.nonzero()
        return _Eliminated(
            (bodies[i], bodies[j], found.T[i, j]),
            (bodies[k], drive, found.U[k, drive]),
            (row, place, found.S[row, place]),
            bodies[found.dependent],
            found.loop if (found.loop >= 0).any() else None,
            found.parting,
        )


class _Eliminated(NamedTuple):
    """A connected component of held rows: entries of T and U, and of S for its rows and dependent bodies.

    `loop` is None where all forces are unique.
    """

    T: tuple[Indices, Indices, Array]
    U: tuple[Indices, Indices, Array]
    S: tuple[Indices, Indices, Array]
    dependent: Indices
    loop: Indices | None
    parting: Array | None


def _alone(G: Any) -> tuple[Indices, Indices, Array]:
    """Return the rows with a single body on which no other row acts, these bodies, and the coefficients."""
    on_body = np.bincount(G.indices, minlength=G.shape[1])
    rows = (np.diff(G.indptr) == 1).nonzero()[0]
    places = G.indptr[rows]
    rows = rows[on_body[G.indices[places]] == 1]
    places = G.indptr[rows]
    return rows, G.indices[places].astype(np.intp), G.data[places]


def component_numbers(G: Any) -> Indices:
    """Return a number for each row: rows that share a body, directly or by way of other rows, have the same number."""
    if isinstance(G, np.ndarray):
        number = np.arange(G.shape[0])
        for column in (G != 0).T:
            if (own := number[column]).size > 1:
                number[np.isin(number, own)] = own.min()
        return number
    return components_of(G)[0]


def components_of(G: Any) -> tuple[Indices, Indices]:
    """Return the numbers of `component_numbers` of sparse rows, and those of the bodies: others where no row acts."""
    held = scipy.sparse.csr_array((np.ones(G.nnz), G.indices, G.indptr), shape=G.shape)
    graph = scipy.sparse.block_array([[None, held], [held.T, None]], format="csr")
    component = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    rows, bodies = np.split(np.asarray(component, dtype=np.intp), [G.shape[0]])
    return rows, bodies


class _Component:
    """Gauss-Jordan elimination of some rows, columns of light bodies first."""

    def __init__(self, inertia: Array, G: Array, D: Array, independent: Callable[[Array], Array]) -> None:
        h, n = G.shape
        scale = np.maximum(row_maxima(G), row_maxima(D))
        scale[scale == 0] = 1.0
        work = np.concatenate([G, D, np.eye(h)], axis=1)
        work /= scale[:, None]
        order = np.argsort(inertia, kind="stable")
        pivots: list[int] = []
        done = 0
        for column in order.tolist():
            if done == h:
                break
            below = np.abs(work[done:, column])
            row = done + int(below.argmax())
            if below[row - done] <= _ZERO:
                continue
            if row != done:
                work[[done, row]] = work[[row, done]]
            work[done] /= work[done, column]
            others = work[:, column].nonzero()[0]
            others = others[others != done]
            if others.size:
                work[others] = _difference(work[others], work[others, column][:, None] * work[done])
            pivots.append(column)
            done += 1
        self.dependent = np.array(pivots, dtype=np.intp)
        last = n + D.shape[1]
        reduced, drives, combine = work[:done, :n], work[:done, n:last], work[:done, last:]
        self.T = np.eye(n)
        self.T[self.dependent] = -reduced
        self.T[:, self.dependent] = 0.0
        self.U = np.zeros((n, D.shape[1]))
        self.U[self.dependent] = -drives
        self.S = combine.T
        self.loop = np.full(h, -1)
        self.parting: Array | None = None
        if done < h:
            self._least_norm(inertia, G, D, independent, work[done:, last:], scale)

    def _least_norm(
        self, inertia: Array, G: Array, D: Array, independent: Callable[[Array], Array], null: Array, scale: Array
    ) -> None:
        """Subtract from the forces the part that no body feels; rows are scaled to their largest coefficient."""
        links = np.abs(null) > _ZERO
        number = np.unique(component_numbers(links), return_inverse=True)[1]
        self.loop = np.where(links.any(axis=0), number[links.argmax(axis=0)], -1)
        null = np.where(links, null, 0.0)
        # for the forces of scaled rows: lambda * scale
        unit = null * scale
        gram = np.linalg.pinv(unit @ unit.T)
        # loops that share no row do not affect each other
        gram[number[:, None] != number] = 0.0
        free = unit.T @ gram @ unit
        # no entry of a projection is above 1: below this it is roundoff
        free[np.abs(free) <= _CANCELLED] = 0.0
        spread = np.abs(free) @ (scale[:, None] * np.abs(self.S)) / scale[:, None]
        self.S = _difference(self.S, free @ (scale[:, None] * self.S) / scale[:, None], spread)
        if D.any():
            D = independent(D)
            off = null @ D
            off[np.abs(off) <= _ZERO * np.maximum(np.abs(null) @ np.abs(D), 1.0)] = 0.0
            if off.any():
                # only the bodies of a loop make it stiff
                of_loop = np.array([links[number == k].any(axis=0) for k in range(number.max() + 1)])
                stiff = _RIGID * ((of_loop @ np.abs(G) > 0) @ inertia)
                stiff[stiff == 0] = _RIGID
                wide = stiff[number][:, None] * off
                parting, size = null.T @ gram @ wide, np.abs(null.T) @ np.abs(gram) @ np.abs(wide)
                parting[np.abs(parting) <= _ZERO * size] = 0.0
                self.parting = parting


def self_stress(G: Any, levers: Array) -> Array:
    """Return orthonormal forces of rows that accelerate no body, a column each; rows are scaled to their `levers`."""
    unit = dense(G) / levers[:, None]
    values, vectors = np.linalg.eigh(unit @ unit.T)
    return np.asarray(vectors[:, values <= _ZERO * values.max(initial=0.0)])


def _difference(a: Array, b: Array, size: Array | None = None) -> Array:
    """Return ``a - b``, exactly 0 where it is roundoff of `size`, by default ``|b|``."""
    found: Array = a - b
    found[np.abs(found) <= _CANCELLED * (np.abs(b) if size is None else size)] = 0.0
    return found


@dataclass(frozen=True)
class _Tree:
    """A large component without loops: triangular once its bodies are in order from the root out."""

    T: tuple[Any, ...]
    U: tuple[Any, ...]
    dependent: Indices
    solver: Any
    order: Indices
    gain: float

    @classmethod
    def of(cls, inertia: Array, G: Any, D: Any) -> _Tree | None:
        """Return the tree that rows of at most two bodies each form, None where they form none."""
        h, bodies = G.shape[0], np.unique(G.indices)
        per_row = np.diff(G.indptr)
        driven = np.flatnonzero(np.diff(D.indptr))
        fixed = np.flatnonzero(per_row == 1)
        if per_row.max() > 2 or h > bodies.size or fixed.size > 1 or h != bodies.size - 1 + fixed.size:
            return None
        place = np.full(int(bodies.max()) + 1, -1)
        place[bodies] = np.arange(bodies.size)
        root = int(place[G.indices[G.indptr[fixed[0]]]]) if fixed.size else int(inertia[bodies].argmax())
        two = np.flatnonzero(per_row == 2)
        ends = place[np.stack([G.indices[G.indptr[two]], G.indices[G.indptr[two] + 1]])]
        size = bodies.size
        graph = scipy.sparse.coo_array((np.ones(two.size), (ends[0], ends[1])), shape=(size, size)).tocsr()
        order, _ = scipy.sparse.csgraph.breadth_first_order(graph, root, directed=False)
        rank = np.empty(size, dtype=np.intp)
        rank[order] = np.arange(size)
        # each row belongs to the one of its bodies that is further from the root
        outer = np.where(rank[ends[0]] > rank[ends[1]], ends[0], ends[1])
        row_of = np.full(size, -1)
        row_of[outer] = two
        if fixed.size:
            row_of[root] = fixed[0]
        some = order if fixed.size else order[1:]
        rows = row_of[some]
        dependent = bodies[some]
        square = G[rows][:, dependent].tocsc()
        solver = scipy.sparse.linalg.splu(square.T.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0)
        T: tuple[Any, ...] = (np.empty(0, int), np.empty(0, int), np.empty(0))
        U = T
        if driven.size:
            drives = D[rows]
            columns = np.unique(drives.indices)
            solved = [solver.solve(-drives[:, [c]].toarray()[:, 0], "T") for c in columns]
            U = (
                np.tile(dependent, columns.size),
                np.repeat(columns, dependent.size),
                np.concatenate(solved),
            )
        if not fixed.size:
            top = bodies[root]
            along = solver.solve(-G[rows][:, [top]].toarray()[:, 0], "T")
            T = (np.append(dependent, top), np.full(size, top), np.append(along, 1.0))
        back = np.empty(h, dtype=np.intp)
        back[rows] = np.arange(rows.size)
        gain, sizes = 1.0, np.abs(G.data)
        if sizes.min() != 1.0 or sizes.max() != 1.0:
            # along a path through the tree, ratios of coefficients multiply: a rest of 1 at each body shows how far
            farthest = float(np.abs(solver.solve(np.ones(dependent.size))).max())
            gain = farthest / sizes.min() * sizes.max()
        return cls(T, U, dependent, solver, back, gain)

    def forces(self, rest: Array) -> Array:
        """Return the forces of the rows from the rests ``F - M v'`` of the forces on all bodies."""
        return np.asarray(self.solver.solve(rest[self.dependent])[self.order])

    def majorants(self, rest: Array) -> Array:
        """Return bounds of majorants of these forces, from those of the rests."""
        total = self.gain * rest[self.dependent].sum(axis=0)
        return np.broadcast_to(total, (self.dependent.size, *rest.shape[1:]))


class _Entries:
    """Entries of a sparse matrix under construction."""

    def __init__(self) -> None:
        self._parts: list[tuple[Any, Any, Any]] = []

    def __bool__(self) -> bool:
        return bool(self._parts)

    def add(self, part: tuple[Any, Any, Any]) -> None:
        self._parts.append(part)

    def block(self, rows: Indices, columns: Indices, values: Array) -> None:
        i, j = values.nonzero()
        self._parts.append((rows[i], columns[j], values[i, j]))

    def matrix(self, shape: tuple[int, int]) -> Any:
        rows, columns, values = (np.concatenate(x) for x in zip(*self._parts, strict=True))
        return scipy.sparse.csr_array((values, (rows, columns)), shape=shape)


def _inverse_of_blocks(matrix: Any, some: Indices) -> Any:
    """Return the inverse of a block diagonal matrix on some of its rows, 0 elsewhere."""
    diagonal = matrix.diagonal()
    size = matrix.shape[0]
    if matrix.nnz == np.count_nonzero(diagonal):
        values = np.zeros(size)
        safe = some[diagonal[some] > 0]
        values[safe] = 1.0 / diagonal[safe]
        return scipy.sparse.diags_array(values, format="csr")
    _, component = scipy.sparse.csgraph.connected_components(matrix, directed=False)
    entries = _Entries()
    for own in split_by(component[some], some):
        block = matrix[own][:, own].toarray()
        entries.block(own, own, np.linalg.inv(block) if block.any() else np.zeros_like(block))
    return entries.matrix((size, size))
