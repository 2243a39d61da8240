"""The equations of a large scene in one set of modes: sparse matrices and index arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stickslip.mode_set import ModeSet

__all__ = ["SparseModeSet"]

Array = NDArray[np.float64]


class SparseModeSet(ModeSet):
    """Sparse matrices and index arrays of a large scene; what a springless scene does not need is not built."""

    def _folded(self, matrix: Any) -> Any:
        if not self.follow.size:
            return matrix
        target = np.arange(matrix.shape[1])
        target[self.follow] = self.lead
        coo = matrix.tocoo()
        folded = sparse.coo_array((coo.data, (coo.row, target[coo.col])), shape=matrix.shape).tocsr()
        folded.eliminate_zeros()
        return folded

    def apply(self, y: Array) -> Array:
        """Return ``A y`` and ``E y`` in one array."""
        return np.concatenate([self.A @ y, self.E @ y])

    def respond(self, q: Array) -> Array:
        """Return ``B q`` and ``H q`` in one array."""
        forces = self._input_forces(q)
        held = self._held_acceleration(q)
        rates = np.zeros(self.system.size)
        rates[: self.system.n] = self.groups.mean(forces) + held
        rates[self.system.n + self._driven_places] = q[self._driven_inputs]
        driven = self.system.D @ q
        accelerations = q[self.system.first_acceleration : -1]
        contact_forces = self.groups.contact_forces(forces, held, self._parting(held, accelerations))
        return np.concatenate([rates, self.sign * driven[self.slip], contact_forces, driven[self.pre]])

    def _assemble(self) -> None:
        system = self.system
        self._place_positions()
        self.A = self.K = sparse.csr_array((system.size, system.size))
        spring_forces = None
        if system.C.nnz or system.size > system.n:
            spring_forces = self._folded(system.C)
            bristles = sparse.csr_array((system.size - system.first_bristle, system.size))
            self.A = sparse.vstack(
                [self._shared(spring_forces), self._position_rows(), bristles], format="csr"
            )
        self.E = _Watched(self, spring_forces)
        self.L = _Watched(self, None)
        if self.acting.size:
            pushed = system.force_of_contacts[:, self.acting]
            unmoved = sparse.csr_array((system.size - system.n, self.acting.size))
            self.K = sparse.vstack([self._shared(pushed), unmoved], format="csr")
            self.L = _Watched(self, pushed, moves=False)

    def _shared(self, forces: Any) -> Any:
        """Return the accelerations that forces (rows: bodies) cause, the same in every row of a group."""
        groups, n = self.groups, self.system.n
        members = sparse.csr_array((1.0 / groups.mass, (groups.leader, np.arange(n))), shape=(n, n))
        keep = sparse.diags_array(groups.free.astype(float)).tocsr()
        rates = keep @ (members @ forces).tocsr()[groups.leader]
        rates.eliminate_zeros()
        return rates

    def _input_forces(self, q: Array) -> Array:
        system = self.system
        return system.Q @ q + system.force_of_contacts @ (self.kinetic * q[: system.m])

    def _held_acceleration(self, q: Array) -> Array:
        system = self.system
        acceleration = np.zeros(system.n)
        driven = self.held[self.holder < system.n + system.drives]
        acceleration[driven] = q[system.first_acceleration + self.groups.holder[driven] - system.n]
        return acceleration

    def _place_positions(self) -> None:
        """Find out which positions follow a free group and which a drive."""
        system = self.system
        bodies = system.placed
        holder = np.where(bodies >= system.n, bodies, -1)
        inside = bodies < system.n
        holder[inside] = self.groups.holder[bodies[inside]]
        self._moving = np.flatnonzero(holder < 0)
        driven = np.flatnonzero((holder >= 0) & (holder < system.n + system.drives))
        self._driven_places, self._driven_inputs = driven, system.first_drive + holder[driven] - system.n

    def _position_rows(self) -> Any:
        system, moving = self.system, self._moving
        columns = self.groups.leader[system.placed[moving]]
        return sparse.csr_array(
            (np.ones(moving.size), (moving, columns)), shape=(system.placed.size, system.size)
        )


class _Watched:
    """Rows of a large scene that guards watch: velocity differences by index, contact forces by the groups' trees."""

    def __init__(self, mode_set: SparseModeSet, forces: Any, moves: bool = True) -> None:
        system, groups = mode_set.system, mode_set.groups
        self._groups, self._forces, self._n, self._moves = groups, forces, system.n, moves
        self._stuck = mode_set.stuck.size
        leader = np.append(groups.leader, np.full(system.drives + 1, system.n))
        self._a, self._b = (
            [leader[end[rows]] for rows in (mode_set.slip, mode_set.pre)] for end in (system.a, system.b)
        )
        self._sign = mode_set.sign

    def __matmul__(self, y: Array) -> Array:
        wide = (slice(None), None) if y.ndim == 2 else slice(None)
        forces = np.zeros((self._stuck, *y.shape[1:]))
        if self._forces is not None:
            acting = self._forces @ y
            forces = self._groups.contact_forces(acting, np.zeros_like(acting))
        # prescribed bodies are no states: their velocities are inputs
        velocity = np.zeros((self._n + 1, *y.shape[1:]))
        if self._moves:
            velocity[:-1] = y[: self._n]
        slip, pre = (velocity[a] - velocity[b] for a, b in zip(self._a, self._b, strict=True))
        return np.concatenate([self._sign[wide] * slip, forces, pre])
