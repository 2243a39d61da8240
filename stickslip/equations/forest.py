"""Scenes whose events reach only bodies near by: rows join bodies in trees, and every coupling passes on little.

Bodies are numbered from the root out, so that the bodies beyond a row are an interval. The force of a held row is a sum
over these: ``lambda = c sum (F - M v')``. If the motion of one body changes, that of a body d couplings away changes by
the d-th of a chain of majorant series at most; beyond `hops` couplings that is roundoff.

Bodies that rows join in any other way form a knot: by loops, ties, one-way clutches, stops, or with radii. A scene may
have many knots, but not one that holds most of its bodies.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.loads.loads import Loads, Segment
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Mask

_ORDER, _POLYNOMIAL = 20, 3
_REMAINDER = 1e-17
_MOST_HOPS = 60

# Most bodies of one knot, and the largest part of all: it is settled as a whole at each of its events.
_LARGEST_KNOT, _MOST_IN_ONE_KNOT = 200, 0.5


class Forest:
    """The rows and couplings of a scene by body.

    Attributes
    ----------
    period : float
        The shortest period in s of its loads, inf where these are straight.
    child, parent : array (m,) of int
        The ends of each row; the parent is nearer to the root, -1 where it is the ground or a drive.
    lever : array (m, 3)
        Coefficients of child, parent and drive.
    sign : array (m,)
        Coefficient of the child: for a contact, ``w = sign (v_child - v_parent)``.
    drive : array (m,) of int
        The drive of a row without a parent, -1 for the ground; one of them where a tie has several.
    has_drives : array (m,) of bool
        Rows with several drives.
    first, last : array (n,) of int
        The first and the last place of each body and all bodies beyond it.
    body_at : array (n,) of int
        The body at each place.
    in_tree : array (m,) of bool
        The rows that join bodies in trees: contacts.
    gaps : array of int
        The rows whose stretch has limits: gaps and stops.
    piecewise : PiecewiseMatrices
        Their regions and forces.
    knots : list of arrays of int
        The bodies of each knot.
    knot_of, knot_of_row : arrays (n,), (m,) of int
        The knot of each body and row, -1 for none.
    rows_from, rows : array of int
        The rows in trees at body i are ``rows[rows_from[i] : rows_from[i + 1]]``.
    contacts_from, contacts_at, gaps_from, gaps_at, aside_from, aside_at : array of int
        The same for contacts in trees and knots, for gaps and stops, and for rows in no tree that join at most two
        bodies and may move.
    row_of : array (n,) of int or None
        The row in a tree at each body, -1 for none. None unless all of these rows join one body to the ground or a
        drive, and no body has two.
    near_from, near, near_body, stiffness, damping : arrays
        The same for couplings. The entries of a body, the `near_body`, are the forces on it by position and velocity of
        other bodies `near`, and by its own. Gaps have entries, too, which are 0 here.
    coupled : array (n,) of bool
        Which bodies springs, dampers or forces that follow the motion act on.
    gap_entries : arrays
        The entries that gaps have: number of the entry, of the gap, and factor of the gap's force there.
    stiffest, most_damped : arrays
        Bounds of the sizes of `stiffness` and `damping`, whichever regions gaps are in.
    neighbours : list of lists of int
        The bodies that feel each one: by springs and dampers, or by forces that follow it.
    order : int
        Order of the series of velocities.
    unit : float
        Time in s within which series of this order are right to the last bit, inf where motions are polynomials.
    hops : int
        Number of couplings beyond which a change is roundoff within this time.
    """

    def __init__(self, system: System, period: float) -> None:
        n, m = system.n, system.m
        self.n, self.m, self.period = n, m, period
        a, b = np.full(m, -1), np.full(m, -1)
        # coefficients of the first body, of the second one, and of a drive
        lever = np.zeros((m, 3))
        self.drive, self.has_drives = np.full(m, -1), np.zeros(m, dtype=bool)
        for j, row in enumerate(system.rows):
            for i, c in row.coefficients.items():
                if i >= n:
                    self.has_drives[j] = self.drive[j] >= 0
                    self.drive[j], lever[j, 2] = i - n, c
                elif a[j] < 0:
                    a[j], lever[j, 0] = i, c
                else:
                    b[j], lever[j, 1] = i, c
        self.in_tree, self.knot_of, self.knot_of_row = _knots(system)
        self.knots = [(self.knot_of == k).nonzero()[0] for k in range(int(self.knot_of.max(initial=-1)) + 1)]
        contacts = self.in_tree.nonzero()[0]
        self.gaps, self.piecewise = (system.is_gap | system.is_stop).nonzero()[0], system.piecewise
        self._number(a[contacts], b[contacts])
        swapped = (b >= 0) & (self.first[np.maximum(b, 0)] > self.first[a])
        lever[swapped] = lever[swapped][:, [1, 0, 2]]
        self.child, self.parent, self.lever = np.where(swapped, b, a), np.where(swapped, a, b), lever
        self.sign = lever[:, 0]
        self.rows_from, self.rows = _by_end(a, b, contacts, n)
        touching = (self.in_tree | (self.knot_of_row >= 0) & system.is_friction).nonzero()[0]
        self.contacts_from, self.contacts_at = _by_end(a, b, touching, n)
        self.gaps_from, self.gaps_at = _by_end(a, b, self.gaps, n)
        aside = (~self.in_tree & ~system.is_gap & ~system.is_tie).nonzero()[0]
        self.aside_from, self.aside_at = _by_end(a, b, aside, n)
        self.row_of: Indices | None = None
        if not contacts.size or (self.parent[contacts].max() < 0 and np.bincount(self.child[contacts]).max() == 1):
            self.row_of = np.full(n, -1)
            self.row_of[self.child[contacts]] = contacts
        self._couple(system)
        self._find_unit_and_hops(system)

    @staticmethod
    def why_not(system: System, loads: Loads) -> str | None:
        """Return why a scene cannot be followed part by part, None if it can."""
        c = system.laws
        if loads.has_functions or system.dependence is not None or system.size > system.first_bristle:
            return "its motions have no series"
        if not system.all_hard or c.curved.any() or c.rests_below.any():
            return "not all of its contacts have constant coefficients"
        if (system.inertia <= 0).any():
            return "some of its bodies have no inertia"
        if any(min(row.coefficients) >= system.n for row in system.rows if row.kind != "gap"):
            return "some of its rows join no body"
        knot_of = _knots(system)[1]
        sizes = np.bincount(knot_of[knot_of >= 0])
        if sizes.max(initial=0) > min(_LARGEST_KNOT, _MOST_IN_ONE_KNOT * system.n):
            return "too many of its bodies are joined by loops, ties, clutches, stops or radii"
        return None

    def _number(self, a: Indices, b: Indices) -> None:
        """Number the bodies so that all beyond a row are an interval; those at the ground or drives are first roots."""
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
        position = scipy.sparse.csr_array((position.data, (position.row, system.moved[position.col])), shape=(n, n))
        self.is_coupled = bool(full.nnz or system.is_gap.any())
        both = (abs(velocity) + abs(position)).tocoo()
        self.neighbours: list[list[int]] = [[] for _ in range(n)]
        for i, k in zip(both.row.tolist(), both.col.tolist(), strict=True):
            if i != k:
                self.neighbours[k].append(i)
        # couplings and gaps have one pattern of entries
        ends = np.stack([self.child, self.parent], axis=1)[self.gaps]
        gap, one, other = ((ends[:, :, None] >= 0) & (ends[:, None, :] >= 0)).nonzero()
        own_i, own_k = ends[gap, one], ends[gap, other]
        keys, place = np.unique(np.concatenate([both.row * n + both.col, own_i * n + own_k]), return_inverse=True)
        i, k = keys // n, keys % n
        self.near_body, self.near = i.astype(np.intp), k.astype(np.intp)
        self.near_from = np.concatenate([[0], np.cumsum(np.bincount(i, minlength=n))])
        self.stiffness, self.damping = (_entries(x, i, k) for x in (position, velocity))
        self.coupled = np.bincount(self.near_body, (self.stiffness != 0) | (self.damping != 0), n) > 0
        # what gaps add: entry, gap, and the factor of the gap's own stiffness and damping
        lever = self.lever[self.gaps]
        entries, factor = place[both.nnz :], -lever[gap, one] * lever[gap, other]
        self.gap_entries = entries, gap, factor
        self.stiffest, self.most_damped = np.abs(self.stiffness), np.abs(self.damping)
        if self.gaps.size:
            steepest = np.maximum.reduceat(np.abs(system.piecewise.value), system.piecewise.first)
            np.add.at(self.stiffest, entries, np.abs(factor) * steepest[gap, 0])
            np.add.at(self.most_damped, entries, np.abs(factor) * steepest[gap, 1])

    def takes(self, segment: Segment) -> bool:
        """Tell whether the loads of a segment are lines and sines, and no sine opens a contact."""
        if not segment.has_sines:
            return True
        last = segment.value + (segment.stop - segment.start) * segment.slope
        least = np.minimum(segment.value, last) - segment.amplitudes
        normals = segment.sines.entry[segment.sines.entry < self.m]
        return bool((least[normals] > 0).all() and (segment.sines.frequency != 0).all())

    def _find_unit_and_hops(self, system: System) -> None:
        """Find how long a series holds, and how far a change reaches meanwhile, from chains of majorants."""
        self.order, self.unit, self.hops = _POLYNOMIAL, math.inf, 0
        if math.isfinite(self.period):
            # (omega h)^k / k! is the last term of a sine
            self.order = _ORDER
            self.unit = (_REMAINDER * math.factorial(_ORDER)) ** (1 / _ORDER) * self.period / (2 * math.pi)
        if not self.is_coupled:
            return
        self.order = _ORDER
        row = self.near_body
        own = row == self.near
        norms = []
        for bounds in (self.stiffest, self.most_damped):
            size = bounds / system.inertia[row]
            norms.append([np.bincount(row[x], size[x], self.n).max(initial=0.0) for x in (own, ~own)])
        (k_own, k_near), (c_own, c_near) = norms
        # majorants of the terms for |v|, |omega x| <= 1
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
            before = _series(k_own * low**2, c_own * low, k_near * low**2, c_near * low, before, 0.0, _ORDER + 2)


def _series(k: float, c: float, k_near: float, c_near: float, before: Array | None, x: float, order: int) -> Array:
    """Return the terms of the series of ``v' = k x + c v``, ``x' = v``.

    At the start they are 1 and `x`. With the terms `before`, of a body nearer to the change, both are 0 there, and that
    body pushes by `k_near` and `c_near`.
    """
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


def _by_end(a: Indices, b: Indices, rows: Indices, n: int) -> tuple[Indices, Indices]:
    """Return some rows listed by the bodies at which they end; first, where in the list each body begins."""
    second = rows[b[rows] >= 0]
    ends, own = np.concatenate([a[rows], b[second]]), np.concatenate([rows, second])
    return np.concatenate([[0], np.cumsum(np.bincount(ends, minlength=n))]), own[np.argsort(ends, kind="stable")]


def spans(starts: Indices, some: Indices) -> Indices:
    """Return the numbers from ``starts[i]`` up to ``starts[i + 1]`` for some i, one after another."""
    first = starts[some]
    count = starts[some + 1] - first
    return np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())


def _knots(system: System) -> tuple[Mask, Indices, Indices]:
    """Return which rows join bodies in trees, and of each body and row the number of its knot, -1 for none."""
    n, joins = system.n, system.alive & ~system.is_gap
    G = scipy.sparse.csr_array(system.abs_G)[joins.nonzero()[0]]
    bodies = np.diff(G.indptr)
    first = G.indices[G.indptr[:-1]]
    # a row joins all of its bodies
    ends = np.repeat(first, bodies)
    graph = scipy.sparse.coo_array((np.ones(ends.size), (ends, G.indices)), shape=(n, n))
    count, component = scipy.sparse.csgraph.connected_components(graph, directed=False)
    own = component[first]
    plain = np.array([_compares_velocities(row.coefficients) for row in system.rows], dtype=bool)
    plain &= system.is_friction & (system.mu_c.min(axis=0, initial=np.inf) > 0)
    inner, led = np.bincount(own[bodies > 1], minlength=count), np.bincount(own[bodies == 1], minlength=count)
    knotted = (inner >= np.bincount(component, minlength=count)) | (led > 1)
    knotted[own[~plain[joins]]] = True
    number = np.where(knotted, np.cumsum(knotted) - 1, -1)
    of_row = np.full(system.m, -1)
    of_row[joins] = number[own]
    return joins & (of_row < 0), number[component], of_row


def _compares_velocities(coefficients: Mapping[int, float]) -> bool:
    """Tell whether a row has the velocity of one body relative to another, or to the ground, without radii."""
    return sorted(coefficients.values()) in ([-1.0, 1.0], [-1.0], [1.0])
