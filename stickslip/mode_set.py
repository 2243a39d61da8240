"""The equations of a scene in one set of modes, assembled as small dense or large sparse matrices."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stickslip.friction import HARD, LINEAR, ActingForces

if TYPE_CHECKING:
    from stickslip.assembly import System

__all__ = ["FREE", "OPEN", "DenseModeSet", "Expansion", "ModeSet", "SparseModeSet"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

OPEN, FREE = 2, 3
"""States of contacts that carry no force and of those whose law knows no modes; the others have -1, 0 or +1."""

_NEAR = 1e-5
"""A stuck contact this near its breakaway level, as a part of it, deserves a closer look."""


class Expansion(NamedTuple):
    """Taylor coefficients at the start of a motion that no curved load or law bends.

    Rates are ``f0 + f1 tau``, and exactly so where their next derivatives `bends` are 0; what guards watch is
    ``z0 + z1 tau + z2 tau^2``, the guards are ``c0 + c1 tau + c2 tau^2`` once all static coefficients have risen.
    """

    f0: Array
    f1: Array
    bends: Array
    z0: Array
    z1: Array
    z2: Array
    c0: Array
    c1: Array
    c2: Array


class ModeSet:
    """The equations of a scene in one set of modes.

    With ``v' = M^-1 (F - G^T r)`` and all members of a stuck group accelerating as one body
    (Breedveld 2000, eqs. 5 to 7), the rates are ``y' = A y + B q + K e`` and the watched quantities
    ``z = E y + H q + L e``: relative velocities times mode of the slipping contacts, then forces of the stuck ones.
    ``e`` are the friction forces of the contacts that act through their velocity: slipping with a curved kinetic law,
    in pre-slip, smooth, or with bristles. A contact in pre-slip is watched by its relative velocity.

    Parameters
    ----------
    system : System
    modes : array (m,)
        -1, 0, +1 or OPEN for each contact.
    """

    A: Any
    B: Any
    K: Any
    E: Any
    H: Any
    L: Any

    def __init__(self, system: System, modes: NDArray[np.int8]) -> None:
        self.system, self.modes = system, modes
        kind = system.coefficients.kind
        self.stuck = np.flatnonzero((modes == 0) & (kind == HARD))
        self.pre = np.flatnonzero((modes == 0) & (kind == LINEAR))
        self.slip = np.flatnonzero((modes == 1) | (modes == -1))
        self.loose = np.flatnonzero(modes >= OPEN)
        self.sign = modes[self.slip].astype(float)
        self.direction = (modes < 0).astype(np.intp)
        curved = system.coefficients.curved & (np.abs(modes) == 1)
        self.acting = np.flatnonzero(curved | (modes == FREE) | ((modes == 0) & (kind == LINEAR)))
        self.held_contacts = np.concatenate([self.stuck, self.pre])
        self._place_levels()
        self.law = ActingForces(system.coefficients, self.acting, modes)
        self.bristle_places = np.array(
            [system.bristle_state[j] for j in self.acting[self.law.bristles]], dtype=np.intp
        )
        stuck = np.zeros(system.m, dtype=bool)
        stuck[self.stuck] = True
        self.groups = system.groups(stuck.tobytes())
        n = system.n
        everyone = np.arange(n)
        held = ~self.groups.free
        self.follow = np.flatnonzero((self.groups.leader != everyone) & ~held)
        self.lead = self.groups.leader[self.follow]
        self.held = np.flatnonzero(held)
        self.holder = self.groups.holder[self.held]
        self.kinetic = np.zeros(system.m)
        plain = self.slip[~system.coefficients.curved[self.slip]]
        self.kinetic[plain] = modes[plain] * system.mu_c[self.direction[plain], plain]
        self._assemble()

    def _place_levels(self) -> None:
        """Breakaway coefficients of the held contacts, upper levels first, then lower ones."""
        c = self.system.coefficients
        both = np.tile(self.held_contacts, 2)
        side = np.repeat([0, 1], self.held_contacts.size)
        self.guard_contacts = np.concatenate([self.slip, both])
        slips, helds = self.slip.size, self.held_contacts.size
        self._source = np.concatenate([np.arange(slips + helds), slips + np.arange(helds)])
        self._turn = np.repeat([1.0, -1.0, 1.0], [slips, helds, helds])
        self.is_pre = np.tile(np.arange(self.held_contacts.size) >= self.stuck.size, 2)
        mu_s = np.where(self.is_pre, c.velocity[both], c.mu_s[side, both])
        dwells = (c.dwell[both] > 0) & ~self.is_pre
        rise = np.where(dwells, mu_s - np.maximum(c.mu_c, c.mu_0)[side, both], 0.0)
        rate = np.divide(1.0, c.dwell[both], out=np.zeros(both.size), where=dwells)
        self.levels = (both, mu_s, rise, rate)
        self.has_dwell = bool(dwells.any())
        self.has_threshold = bool(c.threshold[self.slip].any())
        # a contact in pre-slip is held by its pre-slip velocity, whatever presses it together: by the input 1
        one = self.system.inputs - 1
        self.pressed_by = np.where(self.is_pre, one, both)
        self.guard_inputs = np.concatenate([np.full(slips, one), self.pressed_by])
        self.guard_levels = np.concatenate([np.zeros(slips), mu_s])
        self.nearness = _NEAR * self.guard_levels

    def expand(self, y: Array, q0: Array, q1: Array) -> Expansion:
        """Return the Taylor coefficients of the motion from the state `y` under the inputs ``q0 + q1 tau``."""
        size = self.system.size
        values = self.apply(y) + self.respond(q0)
        slopes = self.apply(values[:size]) + self.respond(q1)
        bends = self.apply(slopes[:size])
        z = values[size:], slopes[size:], 0.5 * bends[size:]
        c0, c1, c2 = ((part[self._source].T * self._turn).T for part in z)
        c0 += (self.guard_levels * q0[self.guard_inputs].T).T
        c1 += (self.guard_levels * q1[self.guard_inputs].T).T
        return Expansion(values[:size], slopes[:size], bends[:size], *z, c0, c1, c2)

    def magnitudes(self, values: Array) -> Array:
        """Return what adds up in each guard, from absolute values of states and inputs: rows of speeds, then of forces.

        Their roundoff is that of the guards. The first rows are the speeds of both ends, of slipping contacts
        only; then follow, for each guard, the accelerations of both ends or the forces on both groups.
        """
        system, groups = self.system, self.groups
        body = system.magnitudes @ values
        total = np.zeros_like(body)
        np.add.at(total, groups.leader, body)
        acceleration = self._at_ends((body.T / system.inertia).T, self.slip)
        if system.drives:
            acceleration += (abs(system.D) @ self._drive_accelerations(values[system.size :]))[self.slip]
        speed = self._at_ends(values[: system.n], self.slip)
        force = self._at_ends(total[groups.leader], self.held_contacts)
        return np.concatenate([speed, acceleration, force, force])

    def _drive_accelerations(self, inputs: Array) -> Array:
        """Return the drives' accelerations in the places of their velocities."""
        first, last = self.system.first_drive, self.system.first_acceleration
        rates = np.zeros_like(inputs)
        rates[first:last] = inputs[last : 2 * last - first]
        return rates

    def _at_ends(self, values: Array, contacts: Indices) -> Array:
        """Return the sums over both ends of contacts; prescribed bodies count nothing."""
        system = self.system
        wide = np.concatenate([values, np.zeros((system.drives + 1, *values.shape[1:]))])
        return wide[system.a[contacts]] + wide[system.b[contacts]]

    def _assemble(self) -> None:
        raise NotImplementedError

    def apply(self, y: Array) -> Array:
        """Return ``A y`` and ``E y`` in one array."""
        raise NotImplementedError

    def respond(self, q: Array) -> Array:
        """Return ``B q`` and ``H q`` in one array."""
        raise NotImplementedError

    def _folded(self, matrix: Any) -> Any:
        """Let followers' velocities be read from their leaders, so that nothing feeds back within a group."""
        raise NotImplementedError

    def _parting(self, held: Array, drives: Array) -> Array | None:
        """Return by how much the ends of stuck contacts part, from the accelerations of held bodies and of drives."""
        if not (self.groups.redundant and self.system.drives):
            return None
        ground = np.zeros((1, *held.shape[1:]))
        ends = np.concatenate([held, drives, ground])
        return ends[self.system.a[self.stuck]] - ends[self.system.b[self.stuck]]

    def law_jacobian(self, slopes: Array) -> Any:
        """Return what the acting contacts add to ``d y' / d y``: ``K diag(dr/dw) W``."""
        rows = self.acting_rows
        return self.K @ (
            slopes[:, None] * rows if isinstance(rows, np.ndarray) else sparse.diags_array(slopes) @ rows
        )

    @cached_property
    def locked(self) -> NDArray[np.bool_]:
        """Which slipping contacts cannot move, because others hold both their ends together."""
        system, groups = self.system, self.groups
        whole = np.where(groups.free, groups.leader, groups.holder)
        whole = np.concatenate([whole, np.arange(system.n, system.n + system.drives + 1)])
        return whole[system.a[self.slip]] == whole[system.b[self.slip]]

    @cached_property
    def acting_rows(self) -> Any:
        """Rows that give the relative velocities of the acting contacts."""
        return self._folded(self.system.W)[self.acting]


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
        self.A = self.K = system.nothing
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
