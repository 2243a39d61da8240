"""Scene and modes into equations: states, rates, contact forces, and the rows that guards watch.

Everything here is linear in the state ``y = (velocities, positions)``, in the input vector
``q = (normal forces, forces, drive velocities, drive accelerations, 1)`` and in the friction forces of contacts
that act through their velocity. Only bodies that a spring touches have a position.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from copy import copy
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from stickslip.friction import BRISTLE, HARD, LINEAR, SMOOTH, ActingForces, Coefficients
from stickslip.grouping import Groups
from stickslip.loads import Loads
from stickslip.scene import GROUND, Scene
from stickslip.signals import Constant, PiecewiseLinear, Signal

__all__ = ["FREE", "OPEN", "ModeSet", "System"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

OPEN, FREE = 2, 3
"""States of contacts that carry no force and of those whose law knows no modes; the others have -1, 0 or +1."""

_DENSE_LIMIT = 100
_REMEMBERED = 64
_COMPILED: dict[int, System] = {}


class System:
    """A scene compiled to index arrays and constant matrices.

    Parameters
    ----------
    scene : Scene
    """

    loads: Loads

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.names = [body.name for body in scene.bodies]
        n, drives = len(scene.bodies), len(scene.drives)
        self.n, self.drives, self.m = n, drives, len(scene.contacts)
        self.inertia = np.array([body.inertia for body in scene.bodies])
        index = {name: i for i, name in enumerate(self.names)}
        index |= {drive.name: n + i for i, drive in enumerate(scene.drives)}
        index[GROUND] = n + drives
        self.index = index
        self.a = np.array([index[c.a] for c in scene.contacts], dtype=np.intp)
        self.b = np.array([index[c.b] for c in scene.contacts], dtype=np.intp)
        self._place_inputs(scene)
        self._place_positions(scene)
        self._place_laws(scene)
        self._join(scene)
        # mode sets hold the compiled scene, and live as long as it does
        self.mode_set = lru_cache(maxsize=_REMEMBERED)(lambda key: ModeSet(self, np.frombuffer(key, dtype=np.int8)))
        self.groups = lru_cache(maxsize=_REMEMBERED)(self._groups)

    def _place_positions(self, scene: Scene) -> None:
        ends = {self.index[e] for s in scene.springs if s.stiffness for e in (s.a, s.b)}
        ends.discard(self.index[GROUND])
        self.placed = np.array(sorted(ends), dtype=np.intp)
        self.first_bristle = self.n + self.placed.size
        self.position_state = {int(i): self.n + k for k, i in enumerate(self.placed)}

    def _place_inputs(self, scene: Scene) -> None:
        self._normals = [_signal(c.normal) for c in scene.contacts]
        self._others = [_signal(f.signal) for f in scene.forces] + [_signal(d.velocity) for d in scene.drives]
        self.first_force = self.m
        self.first_drive = self.m + len(scene.forces)
        self.first_acceleration = self.first_drive + self.drives
        self.inputs = self.first_acceleration + self.drives + 1
        self.loaded = np.array([_ever_positive(s) for s in self._normals], dtype=bool)

    @classmethod
    def of(cls, scene: Scene) -> System:
        """Return the compiled scene; it is compiled once."""
        known = _COMPILED.get(id(scene))
        if known is None:
            known = _COMPILED[id(scene)] = cls(scene)
            # a scene that nobody holds is forgotten; the compiled one must not hold it
            del known.scene
            weakref.finalize(scene, _COMPILED.pop, id(scene), None)
        system = copy(known)
        system.scene = scene
        return system

    def over(self, start: float, stop: float, stepped: bool = False) -> System:
        """Return the same system with its loads over a time span, read as a fixed-step method does if `stepped`."""
        system = copy(self)
        system.normals = [s.clipped(start, stop) for s in self._normals]
        system.velocities = self._others[len(self._others) - self.drives :]
        signals = [*system.normals, *self._others]
        system.loads = Loads(signals, range(self.first_drive, len(signals)), start, stop, stepped)
        return system

    def _place_laws(self, scene: Scene) -> None:
        c = self.coefficients = Coefficients([contact.law for contact in scene.contacts])
        self.mu_c, self.mu_s, self.mu_0, self.dwell = c.mu_c, c.mu_s, c.mu_0, c.dwell
        self.alive = self.loaded & (self.mu_s.max(axis=0) > 0)
        self.hard = c.kind == HARD
        self.all_hard = bool(self.hard.all())
        self.free = (c.kind == SMOOTH) | (c.kind == BRISTLE)
        bristles = np.flatnonzero(c.kind == BRISTLE)
        self.size = self.first_bristle + bristles.size
        self.bristle_state = {int(j): self.first_bristle + k for k, j in enumerate(bristles)}

    def _join(self, scene: Scene) -> None:
        """Build the constant matrices: forces from states and inputs, relative velocities from both."""
        n, size = self.n, self.size
        self.sparse = n + self.m > _DENSE_LIMIT
        state, inputs = _Triplets(), _Triplets()

        def couple(body: int, other: int, k: float, c: float, rest: float) -> None:
            if body >= n:
                return
            for end, sign in ((body, -1.0), (other, 1.0)):
                if end < n:
                    state.add(body, end, sign * c)
                elif end < n + self.drives:
                    inputs.add(body, self.first_drive + end - n, sign * c)
                if k and end in self.position_state:
                    state.add(body, self.position_state[end], sign * k)
            inputs.add(body, self.inputs - 1, k * rest)

        for spring in scene.springs:
            i, j = self.index[spring.a], self.index[spring.b]
            couple(i, j, spring.stiffness, spring.damping, spring.rest)
            couple(j, i, spring.stiffness, spring.damping, -spring.rest)
        for damper in scene.dampers:
            i, j = self.index[damper.a], self.index[damper.b]
            couple(i, j, 0.0, damper.damping, 0.0)
            couple(j, i, 0.0, damper.damping, 0.0)
        for k, force in enumerate(scene.forces):
            inputs.add(self.index[force.body], self.first_force + k, 1.0)
        self.C = self._matrix(state, (n, size))
        self.Q = self._matrix(inputs, (n, self.inputs))
        self._join_contacts()

    def _join_contacts(self) -> None:
        free, driven = _Triplets(), _Triplets()
        for sign, ends in ((1.0, self.a), (-1.0, self.b)):
            for contact, end in enumerate(ends.tolist()):
                if end < self.n:
                    free.add(contact, end, sign)
                elif end < self.n + self.drives:
                    driven.add(contact, self.first_drive + end - self.n, sign)
        self.G = self._matrix(free, (self.m, self.n))
        self.W = self._matrix(free, (self.m, self.size))
        self.D = self._matrix(driven, (self.m, self.inputs))
        self.force_of_contacts = -self.G.T.tocsr() if self.sparse else -self.G.T

    def _matrix(self, triplets: _Triplets, shape: tuple[int, int]) -> Any:
        matrix = sparse.coo_array((triplets.values, (triplets.rows, triplets.columns)), shape=shape).tocsr()
        matrix.eliminate_zeros()
        return matrix if self.sparse else matrix.toarray()

    def sign_of(self, w: Array) -> Array:
        """Return the mode that a law without modes shows: the sign of `w` beyond its pre-slip velocity."""
        limit = self.coefficients.velocity
        return np.where(np.abs(w) > (limit if w.ndim == 1 else limit[:, None]), np.sign(w), 0.0)

    def _groups(self, joined: bytes) -> Groups:
        """Return the rigid groups that the contacts of a mask (as bytes) form."""
        mask = np.frombuffer(joined, dtype=bool)
        return Groups(self.inertia, self.a[mask], self.b[mask])


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

    def __init__(self, system: System, modes: NDArray[np.int8]) -> None:
        self.system, self.modes = system, modes
        kind = system.coefficients.kind
        self.stuck = np.flatnonzero((modes == 0) & (kind == HARD))
        self.pre = np.flatnonzero((modes == 0) & (kind == LINEAR))
        self.slip = np.flatnonzero((modes == 1) | (modes == -1))
        self.sign = modes[self.slip].astype(float)
        self.direction = (modes < 0).astype(np.intp)
        curved = system.coefficients.curved & (np.abs(modes) == 1)
        self.acting = np.flatnonzero(curved | (modes == FREE) | ((modes == 0) & (kind == LINEAR)))
        self.held_contacts = np.concatenate([self.stuck, self.pre])
        self._place_levels()
        self.law = ActingForces(system.coefficients, self.acting, modes)
        self.bristle_places = np.array([system.bristle_state[j] for j in self.acting[self.law.bristles]], dtype=np.intp)
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
        (self._assemble_sparse if system.sparse else self._assemble_dense)()

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

    def spread(self, watched: tuple[Array, Array, Array]) -> Array:
        """Return what the upper and lower guards make of watched quantities: slipping, ``-lambda``, ``+lambda``."""
        return np.array(watched)[:, self._source] * self._turn

    def apply(self, y: Array) -> Array:
        """Return ``A y`` and ``E y`` in one array."""
        if self.system.sparse:
            return np.concatenate([self.A @ y, self.E @ y])
        return self._AE @ y

    def respond(self, q: Array) -> Array:
        """Return ``B q`` and ``H q`` in one array."""
        if self.system.sparse:
            return np.concatenate([self.B @ q, self.H @ q])
        return self._BH @ q

    # -- forces on bodies ---------------------------------------------------------------------------------

    def _folded(self, matrix: Any) -> Any:
        """Let followers' velocities be read from their leaders, so that nothing feeds back within a group."""
        if not self.follow.size:
            return matrix
        if isinstance(matrix, np.ndarray):
            folded = matrix.copy()
            np.add.at(folded.T, self.lead, matrix.T[self.follow])
            folded[:, self.follow] = 0.0
            return folded
        target = np.arange(matrix.shape[1])
        target[self.follow] = self.lead
        coo = matrix.tocoo()
        folded = sparse.coo_array((coo.data, (coo.row, target[coo.col])), shape=matrix.shape).tocsr()
        folded.eliminate_zeros()
        return folded

    def _assemble_dense(self) -> None:
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
                groups.contact_forces(forces, held_wide),
                slip_rows[self.pre],
            ]
        )
        cuts = (size, size + inputs)
        self.A, self.B, self.K = (np.ascontiguousarray(x) for x in np.split(rates, cuts, axis=1))
        self.E, self.H, self.L = (np.ascontiguousarray(x) for x in np.split(watched, cuts, axis=1))
        self._AE, self._BH = np.vstack([self.A, self.E]), np.vstack([self.B, self.H])

    def _held_inputs_dense(self) -> Array:
        system = self.system
        held_inputs = np.zeros((system.n, system.inputs))
        driven = self.held[self.holder < system.n + system.drives]
        held_inputs[driven, system.first_acceleration + self.groups.holder[driven] - system.n] = 1.0
        return held_inputs

    def _position_row(self, row: Array, body: int) -> None:
        system = self.system
        holder = body if body >= system.n else int(self.groups.holder[body])
        if holder < 0:
            row[self.groups.leader[body]] = 1.0
        elif holder < system.n + system.drives:
            row[system.size + system.first_drive + holder - system.n] = 1.0

    def _assemble_sparse(self) -> None:
        system, groups = self.system, self.groups
        n = system.n
        C = self._folded(system.C)
        pushed = system.force_of_contacts[:, self.acting]
        bristles = sparse.csr_array((system.size - system.first_bristle, system.size))
        self.A = sparse.vstack([self._shared_sparse(C), self._position_rows_sparse(), bristles], format="csr")
        nothing = sparse.csr_array((system.size - n, self.acting.size))
        self.K = sparse.vstack([self._shared_sparse(pushed), nothing], format="csr")
        W = self._folded(system.W)
        slip_rows = sparse.diags_array(self.sign) @ W[self.slip]
        forces = aslinearoperator(C)
        stuck_forces = LinearOperator(
            (self.stuck.size, n),
            matvec=lambda f: groups.contact_forces(np.ravel(f), np.zeros(n)),
            dtype=float,
        )
        self.E = _Stacked(slip_rows, stuck_forces @ forces if C.nnz else None, W[self.pre], self.stuck.size)
        acting = stuck_forces @ aslinearoperator(pushed) if self.acting.size else None
        width = self.acting.size
        silent = [sparse.csr_array((rows, width)) for rows in (self.slip.size, self.pre.size)]
        self.L = _Stacked(silent[0], acting, silent[1], self.stuck.size)
        self.B = _Applied(lambda q: self._rates_of(self._input_forces(q), q))
        self.H = _Applied(self._watched_inputs)

    def _shared_sparse(self, forces: Any) -> Any:
        """Return the accelerations that forces (rows: bodies) cause, the same in every row of a group."""
        groups, n = self.groups, self.system.n
        if not forces.nnz:
            return sparse.csr_array(forces.shape)
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

    def _rates_of(self, forces: Array, q: Array) -> Array:
        system = self.system
        rates = np.zeros(system.size)
        rates[: system.n] = self.groups.mean(forces) + self._held_acceleration(q)
        rates[system.n + self._driven_places] = q[self._driven_inputs]
        return rates

    def _position_rows_sparse(self) -> Any:
        system = self.system
        bodies = system.placed
        holder = np.where(bodies >= system.n, bodies, -1)
        inside = bodies < system.n
        holder[inside] = self.groups.holder[bodies[inside]]
        moving = np.flatnonzero(holder < 0)
        driven = np.flatnonzero((holder >= 0) & (holder < system.n + system.drives))
        self._driven_places, self._driven_inputs = driven, system.first_drive + holder[driven] - system.n
        columns = self.groups.leader[bodies[moving]]
        return sparse.csr_array((np.ones(moving.size), (moving, columns)), shape=(bodies.size, system.size))

    def _watched_inputs(self, q: Array) -> Array:
        driven = self.system.D @ q
        forces = self.groups.contact_forces(self._input_forces(q), self._held_acceleration(q))
        return np.concatenate([self.sign * driven[self.slip], forces, driven[self.pre]])

    @cached_property
    def acting_rows(self) -> Any:
        """Rows that give the relative velocities of the acting contacts."""
        return self._folded(self.system.W)[self.acting]

    def law_jacobian(self, slopes: Array) -> Any:
        """Return what the acting contacts add to ``d y' / d y``: ``K diag(dr/dw) W``."""
        rows = self.acting_rows
        return self.K @ (slopes[:, None] * rows if isinstance(rows, np.ndarray) else sparse.diags_array(slopes) @ rows)


class _Triplets:
    """Entries of a matrix under construction."""

    def __init__(self) -> None:
        self.rows: list[int] = []
        self.columns: list[int] = []
        self.values: list[float] = []

    def add(self, row: int, column: int, value: float) -> None:
        if value:
            self.rows.append(row)
            self.columns.append(column)
            self.values.append(value)


class _Stacked:
    """Sparse rows, an operator's rows (none of them other than zero where it is None), and sparse rows again."""

    def __init__(self, top: Any, middle: Any, below: Any, height: int) -> None:
        self._top, self._middle, self._below, self._height = top, middle, below, height

    def __matmul__(self, y: Array) -> Array:
        middle = np.zeros((self._height, *y.shape[1:])) if self._middle is None else self._middle @ y
        return np.concatenate([self._top @ y, middle, self._below @ y])


class _Applied:
    """A function of a vector that is written like a matrix product."""

    def __init__(self, function: Callable[[Array], Array]) -> None:
        self._function = function

    def __matmul__(self, values: Array) -> Array:
        return self._function(values)


def _signal(value: Signal | float) -> Signal:
    return value if isinstance(value, Signal) else Constant(float(value))


def _ever_positive(signal: Signal) -> bool:
    match signal:
        case Constant(value=value):
            return value > 0
        case PiecewiseLinear(values=values):
            return max(values) > 0
    return True
