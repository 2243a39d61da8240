"""The equations of a small scene in one set of modes: dense matrices."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stickslip.mode_set import Expansion, ModeSet

__all__ = ["DenseModeSet"]

Array = NDArray[np.float64]


class DenseModeSet(ModeSet):
    """Matrices of a small scene: one product gives all rates and all that guards watch."""

    def _folded(self, matrix: Array) -> Array:
        if not self.follow.size:
            return matrix
        folded = matrix.copy()
        np.add.at(folded.T, self.lead, matrix.T[self.follow])
        folded[:, self.follow] = 0.0
        return folded

    def apply(self, y: Array) -> Array:
        """Return ``A y`` and ``E y`` in one array."""
        return self._AE @ y

    def respond(self, q: Array) -> Array:
        """Return ``B q`` and ``H q`` in one array."""
        return self._BH @ q

    def _assemble(self) -> None:
        system, groups = self.system, self.groups
        n, size, inputs = system.n, system.size, system.inputs
        C = self._folded(system.C)
        Q = system.Q.copy()
        Q[:, : system.m] += system.force_of_contacts * self.kinetic
        P = system.force_of_contacts[:, self.acting]
        held_inputs = self._held_inputs_dense()
        forces = np.hstack([C, Q, P])
        rates = groups.mean(forces)
        rates[:, size : size + inputs] += held_inputs
        # identical rows may round differently within a product: copy them
        rates[self.follow] = rates[self.lead]
        rows = np.zeros((size - n, forces.shape[1]))
        for k, body in enumerate(system.placed):
            self._position_row(rows[k], int(body))
        rates = np.vstack([rates, rows])
        held_wide = np.zeros_like(forces)
        held_wide[:, size : size + inputs] = held_inputs
        slip_rows = np.hstack([self._folded(system.W), system.D, np.zeros((system.m, self.acting.size))])
        watched = np.vstack(
            [
                self.sign[:, None] * slip_rows[self.slip],
                groups.contact_forces(forces, held_wide, self._parting(held_wide, self._drive_inputs(size))),
                slip_rows[self.pre],
            ]
        )
        cuts = (size, size + inputs)
        self.A, self.B, self.K = (np.ascontiguousarray(x) for x in np.split(rates, cuts, axis=1))
        self.E, self.H, self.L = (np.ascontiguousarray(x) for x in np.split(watched, cuts, axis=1))
        self._AE, self._BH = np.vstack([self.A, self.E]), np.vstack([self.B, self.H])
        self._straight = None if self.A.any() else self._expansion()

    def _expansion(self) -> tuple[Array, list[slice]]:
        """Return the matrix that gives all Taylor coefficients at once, where nothing feeds back, and its parts."""
        size, inputs = self.system.size, self.system.inputs
        columns = np.eye(size + 2 * inputs)
        rows = super().expand(columns[:size], columns[size : size + inputs], columns[size + inputs :])
        ends = np.cumsum([0, *(part.shape[0] for part in rows)]).tolist()
        return np.vstack(rows), [slice(*pair) for pair in pairwise(ends)]

    def expand(self, y: Array, q0: Array, q1: Array) -> Expansion:
        """Return the Taylor coefficients of the motion from the state `y` under the inputs ``q0 + q1 tau``."""
        if self._straight is None:
            return super().expand(y, q0, q1)
        matrix, parts = self._straight
        found = matrix @ np.concatenate([y, q0, q1])
        return Expansion(*[found[part] for part in parts])

    @cached_property
    def _magnitudes(self) -> Array:
        return super().magnitudes(np.eye(self.system.size + self.system.inputs))

    def magnitudes(self, values: Array) -> Array:
        """Return what adds up in each guard, from absolute values of states and inputs."""
        return self._magnitudes @ values

    def _held_inputs_dense(self) -> Array:
        system = self.system
        held_inputs = np.zeros((system.n, system.inputs))
        driven = self.held[self.holder < system.n + system.drives]
        held_inputs[driven, system.first_acceleration + self.groups.holder[driven] - system.n] = 1.0
        return held_inputs

    def _drive_inputs(self, size: int) -> Array:
        """Return rows that read the drives' accelerations off the inputs, among the columns of the forces."""
        system = self.system
        rows = np.zeros((system.drives, size + system.inputs + self.acting.size))
        drives = np.arange(system.drives)
        rows[drives, size + system.first_acceleration + drives] = 1.0
        return rows

    def _position_row(self, row: Array, body: int) -> None:
        system = self.system
        holder = body if body >= system.n else int(self.groups.holder[body])
        if holder < 0:
            row[self.groups.leader[body]] = 1.0
        elif holder < system.n + system.drives:
            row[system.size + system.first_drive + holder - system.n] = 1.0
