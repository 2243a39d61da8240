"""Scenes whose events reach only what is near: rows join bodies in trees, and every coupling hands little on.

Numbered from the root out, the bodies beyond a row are those of one interval: the force of a held row is the sum of
what is left of the forces over its side, ``lambda = c sum (F - M v')``. What one body does differently reaches a body
d couplings away with at most the d-th of a chain of majorant series; beyond `hops` that is roundoff.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy

from stickslip.equations.loads import Loads, Stretch
from stickslip.equations.matrices import dense
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices

_ORDER, _POLYNOMIAL = 20, 3
_REMAINDER = 1e-17
_MOST_HOPS = 60


class Forest:
    """The rows and couplings of a scene by body.

    Attributes
    ----------
    period : float
        The shortest period in s of its loads, inf where these are straight.
    child, parent : array (m,) of int
        The ends of each row, the second nearer to the root, -1 where that is the ground or a drive.
    sign : array (m,)
        Coefficient of the child: ``w = sign (v_child - v_parent)``.
    drive : array (m,) of int
        The drive of a row without a parent, -1 for the ground.
    first, last : array (n,) of int
        The interval of places of each body and all beyond it.
    body_at : array (n,) of int
        The body at each place.
    rows_from, rows : array of int
        The rows of body i are ``rows[rows_from[i] : rows_from[i + 1]]``.
    row_of : array (n,) of int or None
        The only row of each body, -1 where it has none, if every row joins one body to the ground or a drive.
    near_from, near, stiffness, damping : arrays
        The same for couplings: force on i from positions and velocities, its own among them.
    order : int
        Terms of the series of velocities.
    unit : float
        Time in s within which a series cut there is right to the last bit, inf where motions are polynomials.
    hops : int
        Couplings beyond which a change is roundoff within this time.
    """

    def __init__(self, system: System, period: float) -> None:
        n, m = system.n, system.m
        self.n, self.m, self.period = n, m, period
        a, b = np.full(m, -1), np.full(m, -1)
        first = np.ones(m)
        self.drive = np.full(m, -1)
        for j, row in enumerate(system.rows):
            for i, c in row.coefficients.items():
                if i >= n:
                    self.drive[j] = i - n
                elif a[j] < 0:
                    a[j], first[j] = i, c
                else:
                    b[j] = i
        self._number(a, b)
        swapped = (b >= 0) & (self.first[np.maximum(b, 0)] > self.first[a])
        self.child, self.parent = np.where(swapped, b, a), np.where(swapped, a, b)
        self.sign = np.where(swapped, -first, first)
        ends = np.concatenate([a, b[b >= 0]])
        own = np.concatenate([np.arange(m), (b >= 0).nonzero()[0]])
        self.rows = own[np.argsort(ends, kind="stable")]
        self.rows_from = np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=n))])
        self.row_of: Indices | None = None
        if not m or (self.parent.max() < 0 and np.bincount(self.child).max() == 1):
            self.row_of = np.full(n, -1)
            self.row_of[self.child] = np.arange(m)
        self._couple(system)
        self._reach(system.inertia)

    @staticmethod
    def why_not(system: System, loads: Loads) -> str | None:
        """Return why the events of a scene are not followed one by one where they are, None if they are."""
        c = system.laws
        if loads.has_functions or system.dependence is not None or system.size > system.first_bristle:
            return "its motions have no series"
        if system.piecewise.count:
            return "some of its forces are piecewise linear"
        if not system.is_friction.all() or not system.hard.all() or c.curved.any() or c.rests_below.any():
            return "not all of its rows are contacts with constant coefficients"
        if not system.alive.all() or (system.mu_c.min(initial=1.0) <= 0) or (system.inertia <= 0).any():
            return "some of its contacts or bodies have no friction or no inertia"
        ends = []
        for row in system.rows:
            values = list(row.coefficients.values())
            free = [i for i in row.coefficients if i < system.n]
            if (
                not free
                or len(values) > 2
                or any(abs(x) != 1 for x in values)
                or sum(values) not in (-1, 0, 1)
            ):
                return "not all of its contacts compare the velocities of two bodies"
            ends.append((free[0], free[1] if len(free) > 1 else system.n))
        if not _is_forest(np.array(ends, dtype=np.intp).reshape(-1, 2), system.n + 1):
            return "its contacts form loops"
        return None

    def _number(self, a: Indices, b: Indices) -> None:
        """Number the bodies so that all beyond a row stand together; first those that touch ground or drives."""
        n = self.n
        joined: list[list[int]] = [[] for _ in range(n)]
        for i, k in zip(a.tolist(), b.tolist(), strict=True):
            if k >= 0:
                joined[i].append(k)
                joined[k].append(i)
        self.first, self.last = np.full(n, -1), np.full(n, -1)
        place = 0
        for root in [*a[b < 0].tolist(), *range(n)]:
            if self.first[root] >= 0:
                continue
            stack = [(root, False)]
            while stack:
                i, left = stack.pop()
                if left:
                    self.last[i] = place - 1
                    continue
                self.first[i] = place
                place += 1
                stack.append((i, True))
                stack += [(k, False) for k in joined[i] if self.first[k] < 0]
        self.body_at = np.argsort(self.first)

    def _couple(self, system: System) -> None:
        n = self.n
        full = scipy.sparse.csr_array(system.C)
        velocity = full[:, :n]
        position = full[:, system.moved_state].tocoo()
        position = scipy.sparse.csr_array(
            (position.data, (position.row, system.moved[position.col])), shape=(n, n)
        )
        self.is_coupled = bool(full.nnz)
        # one pattern for both: their entries stand side by side
        pattern = (abs(velocity) + abs(position)).tocoo()
        i, k = pattern.row, pattern.col
        order = np.lexsort((k, i))
        i, k = i[order], k[order]
        self.near = k.astype(np.intp)
        self.near_from = np.concatenate([[0], np.cumsum(np.bincount(i, minlength=n))])
        self.stiffness, self.damping = (_entries(x, i, k) for x in (position, velocity))
        self.neighbours = [
            [int(x) for x in self.near[self.near_from[j] : self.near_from[j + 1]] if x != j] for j in range(n)
        ]

    def takes(self, stretch: Stretch) -> bool:
        """Tell whether the loads of a stretch are lines and sines, and no sine opens a contact."""
        if stretch.has_functions or not stretch.has_waves:
            return not stretch.has_functions
        last = stretch.value + (stretch.stop - stretch.start) * stretch.slope
        least = np.minimum(stretch.value, last) - stretch.amplitudes
        normals = stretch.sines.entry[stretch.sines.entry < self.m]
        return bool((least[normals] > 0).all() and (stretch.sines.frequency != 0).all())

    def _reach(self, inertia: Array) -> None:
        """Find how long a series holds, and how far a change reaches meanwhile, from chains of majorants."""
        self.order, self.unit, self.hops = _POLYNOMIAL, math.inf, 0
        if math.isfinite(self.period):
            # (omega h)^k / k! is the last term of a sine
            self.order = _ORDER
            self.unit = (_REMAINDER * math.factorial(_ORDER)) ** (1 / _ORDER) * self.period / (2 * math.pi)
        if not self.is_coupled:
            return
        self.order = _ORDER
        row = np.repeat(np.arange(self.n), np.diff(self.near_from))
        own = row == self.near
        norms = []
        for values in (self.stiffness, self.damping):
            size = np.abs(values) / inertia[row]
            norms.append([np.bincount(row[x], size[x], self.n).max(initial=0.0) for x in (own, ~own)])
        (k_own, k_near), (c_own, c_near) = norms
        # |v|, |omega x| <= 1: what they add up to
        omega = math.sqrt(k_own + k_near)
        low, high = 0.0, 100.0 / max(omega, c_own + c_near)
        for _ in range(100):
            h = 0.5 * (low + high)
            terms = _series(omega**2 * h * h, (c_own + c_near) * h, 0.0, 0.0, None, omega * h, _ORDER + 1)
            low, high = (h, high) if terms[-2:].max() <= _REMAINDER else (low, h)
        self.unit = low = min(low, self.unit)
        before = _series(k_own * low**2, c_own * low, 0.0, 0.0, None, 0.0, _ORDER + 2)
        while before.sum() > _REMAINDER and self.hops < _MOST_HOPS:
            self.hops += 1
            before = _series(
                k_own * low**2, c_own * low, k_near * low**2, c_near * low, before, 0.0, _ORDER + 2
            )


def _series(
    k: float, c: float, k_near: float, c_near: float, before: Array | None, x: float, order: int
) -> Array:
    """Return the terms of ``v' = k x + c v`` (`x` and 1 at the start, or led by the terms before), ``x' = v``."""
    v, p = np.zeros(order + 1), np.zeros(order + 1)
    v[0], p[0] = (1.0, x) if before is None else (0.0, 0.0)
    led = np.zeros(order + 1) if before is None else before
    led_p = np.concatenate([[0.0], led[:-1] / np.arange(1, order + 1)])
    for i in range(order):
        v[i + 1] = (k * p[i] + c * v[i] + k_near * led_p[i] + c_near * led[i]) / (i + 1)
        p[i + 1] = v[i] / (i + 1)
    return v


def _entries(matrix: Any, i: Indices, k: Indices) -> Array:
    """Return the entries of a sparse matrix at some places, in order."""
    found = np.zeros(i.size)
    if i.size and matrix.nnz:
        found[:] = dense(matrix[i, k]).ravel()
    return found


def spans(starts: Indices, some: Indices) -> Indices:
    """Return the numbers from ``starts[i]`` up to ``starts[i + 1]`` for some i, one after another."""
    first = starts[some]
    count = starts[some + 1] - first
    return np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())


def _is_forest(ends: Indices, nodes: int) -> bool:
    graph = scipy.sparse.coo_array((np.ones(ends.shape[0]), (ends[:, 0], ends[:, 1])), shape=(nodes, nodes))
    count, _ = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return bool(ends.shape[0] == nodes - count)
