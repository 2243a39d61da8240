"""Scene and modes into equations: states, rates, contact forces, and the rows that guards watch.

Everything here is linear in the state ``y = (velocities, positions)``, in the input vector
``q = (normal forces, forces, drive velocities, drive accelerations, 1)`` and in the friction forces of contacts
whose kinetic law is curved. Only bodies that a spring touches have a position.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, aslinearoperator

from stickslip.grouping import Groups
from stickslip.laws import DryFriction
from stickslip.loads import Loads
from stickslip.scene import GROUND, Scene
from stickslip.signals import Constant, PiecewiseLinear, Signal

__all__ = ["OPEN", "ModeSet", "System"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

OPEN = 2
"""State of a contact that carries no force; -1, 0 and +1 are the modes of the others."""

_DENSE_LIMIT = 100
_REMEMBERED = 64


class System:
    """A scene compiled to index arrays and constant matrices.

    Parameters
    ----------
    scene : Scene
    start, stop : float
        Time span in s, for the breaks of the loads.
    """

    def __init__(self, scene: Scene, start: float, stop: float) -> None:
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
        self._place_positions(scene)
        self._place_inputs(scene, start, stop)
        self._place_laws(scene)
        self._join(scene)
        self._known: OrderedDict[bytes, ModeSet] = OrderedDict()

    def _place_positions(self, scene: Scene) -> None:
        ends = {self.index[e] for s in scene.springs if s.stiffness for e in (s.a, s.b)}
        ends.discard(self.index[GROUND])
        self.placed = np.array(sorted(ends), dtype=np.intp)
        self.size = self.n + self.placed.size
        self.position_state = {int(i): self.n + k for k, i in enumerate(self.placed)}

    def _place_inputs(self, scene: Scene, start: float, stop: float) -> None:
        normals = [_signal(c.normal).clipped(start, stop) for c in scene.contacts]
        forces = [_signal(f.signal) for f in scene.forces]
        velocities = [_signal(d.velocity) for d in scene.drives]
        self.first_force = self.m
        self.first_drive = self.m + len(forces)
        self.first_acceleration = self.first_drive + self.drives
        signals = [*normals, *forces, *velocities]
        self.loads = Loads(signals, range(self.first_drive, len(signals)), start, stop)
        self.normals, self.velocities = normals, velocities
        self.loaded = np.array([_ever_positive(s) for s in normals], dtype=bool)

    def _place_laws(self, scene: Scene) -> None:
        laws = [c.law for c in scene.contacts]
        assert all(isinstance(law, DryFriction) for law in laws)
        self.laws: list[Any] = laws
        self.mu_c = np.array([[law.mu_c(s) for law in laws] for s in (1, -1)]).reshape(2, -1)
        self.mu_s = np.array([[law.mu_s(s) for law in laws] for s in (1, -1)]).reshape(2, -1)
        self.mu_0 = np.array([[law.mu_k(0.0, s) for law in laws] for s in (1, -1)]).reshape(2, -1)
        self.dwell = np.array([law.dwell for law in laws])
        self.curved = np.array([law.curved for law in laws], dtype=bool)
        self.alive = self.loaded & (self.mu_s.max(axis=0) > 0)

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
            inputs.add(body, self.loads.size - 1, k * rest)

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
        self.Q = self._matrix(inputs, (n, self.loads.size))
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
        self.D = self._matrix(driven, (self.m, self.loads.size))
        self.force_of_contacts = -self.G.T.tocsr() if self.sparse else -self.G.T

    def _matrix(self, triplets: _Triplets, shape: tuple[int, int]) -> Any:
        matrix = sparse.coo_array((triplets.values, (triplets.rows, triplets.columns)), shape=shape).tocsr()
        matrix.eliminate_zeros()
        return matrix if self.sparse else matrix.toarray()

    def mode_set(self, modes: NDArray[np.int8]) -> ModeSet:
        """Return the equations in these modes; those used last are kept ready."""
        key = modes.tobytes()
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = ModeSet(self, modes)
            if len(self._known) > _REMEMBERED:
                self._known.popitem(last=False)
        else:
            self._known.move_to_end(key)
        return known


class ModeSet:
    """The equations of a scene in one set of modes.

    With ``v' = M^-1 (F - G^T r)`` and all members of a stuck group accelerating as one body
    (Breedveld 2000, eqs. 5 to 7), the rates are ``y' = A y + B q + K e`` and the watched quantities
    ``z = E y + H q + L e``: relative velocities times mode of the slipping contacts, then forces of the stuck ones.
    ``e`` are the friction forces of slipping contacts whose kinetic law is curved.

    Parameters
    ----------
    system : System
    modes : array (m,)
        -1, 0, +1 or OPEN for each contact.
    """

    def __init__(self, system: System, modes: NDArray[np.int8]) -> None:
        self.system, self.modes = system, modes
        self.stuck = np.flatnonzero(modes == 0)
        self.slip = np.flatnonzero((modes == 1) | (modes == -1))
        self.sign = modes[self.slip].astype(float)
        self.direction = (modes < 0).astype(np.intp)
        self.curved = self.slip[system.curved[self.slip]]
        self.groups = Groups(system.inertia, system.a[self.stuck], system.b[self.stuck])
        n = system.n
        everyone = np.arange(n)
        held = ~self.groups.free
        self.follow = np.flatnonzero((self.groups.leader != everyone) & ~held)
        self.lead = self.groups.leader[self.follow]
        self.held = np.flatnonzero(held)
        self.holder = self.groups.holder[self.held]
        self._kinetic = np.zeros(system.m)
        plain = self.slip[~system.curved[self.slip]]
        self._kinetic[plain] = modes[plain] * system.mu_c[self.direction[plain], plain]
        (self._assemble_sparse if system.sparse else self._assemble_dense)()

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
        n, size, inputs = system.n, system.size, system.loads.size
        C = self._folded(system.C)
        Q = system.Q.copy()
        Q[:, : system.m] += system.force_of_contacts * self._kinetic
        P = system.force_of_contacts[:, self.curved]
        held_inputs = self._held_inputs_dense()
        forces = np.hstack([C, Q, P])
        rates = groups.mean(forces)
        rates[:, size : size + inputs] += held_inputs
        # identical rows may round differently within a product: copy them
        rates[self.follow] = rates[self.lead]
        rows = np.zeros((system.placed.size, forces.shape[1]))
        for k, body in enumerate(system.placed):
            self._position_row(rows[k], int(body))
        rates = np.vstack([rates, rows])
        held_wide = np.zeros_like(forces)
        held_wide[:, size : size + inputs] = held_inputs
        slip_rows = np.hstack([self._folded(system.W), system.D, np.zeros((system.m, self.curved.size))])
        watch_rows = self.sign[:, None] * slip_rows[self.slip]
        self.watch_rows = watch_rows[:, :size]
        watched = np.vstack([watch_rows, groups.contact_forces(forces, held_wide)])
        cuts = (size, size + inputs)
        self.A, self.B, self.K = (np.ascontiguousarray(x) for x in np.split(rates, cuts, axis=1))
        self.E, self.H, self.L = (np.ascontiguousarray(x) for x in np.split(watched, cuts, axis=1))

    def _held_inputs_dense(self) -> Array:
        system = self.system
        held_inputs = np.zeros((system.n, system.loads.size))
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
        pushed = system.force_of_contacts[:, self.curved]
        positions = self._position_rows_sparse()
        self.A = sparse.vstack([self._shared_sparse(C), positions], format="csr")
        nothing = sparse.csr_array((positions.shape[0], self.curved.size))
        self.K = sparse.vstack([self._shared_sparse(pushed), nothing], format="csr")
        self.watch_rows = sparse.diags_array(self.sign) @ self._folded(system.W)[self.slip]
        forces = aslinearoperator(C)
        stuck_forces = LinearOperator(
            (self.stuck.size, n),
            matvec=lambda f: groups.contact_forces(np.ravel(f), np.zeros(n)),
            dtype=float,
        )
        height = self.slip.size + self.stuck.size
        self.E = _Stacked(self.watch_rows, stuck_forces @ forces if C.nnz else None, height)
        unwatched = sparse.csr_array((self.slip.size, self.curved.size))
        self.L = _Stacked(unwatched, stuck_forces @ aslinearoperator(pushed) if self.curved.size else None, height)
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
        return system.Q @ q + system.force_of_contacts @ (self._kinetic * q[: system.m])

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
        slipping = self.sign * (self.system.D[self.slip] @ q)
        return np.r_[slipping, self.groups.contact_forces(self._input_forces(q), self._held_acceleration(q))]

    # -- friction of curved laws --------------------------------------------------------------------------

    def law_jacobian(self, w: Array, normal: Array) -> Any:
        """Return what curved kinetic laws add to ``d y' / d y``: ``K diag(dr/dw) W``."""
        rows = self._folded(self.system.W)[self.curved]
        slopes = self.curved_slopes(w, normal)
        return self.K @ (slopes[:, None] * rows if isinstance(rows, np.ndarray) else sparse.diags_array(slopes) @ rows)

    def curved_forces(self, w: Array, normal: Array) -> Array:
        """Return ``sign mu_k(|w|) N`` of the slipping contacts with a curved law, from their `w` and `normal`."""
        laws, modes = self.system.laws, self.modes
        return np.array(
            [
                modes[j] * laws[j].mu_k(max(modes[j] * w[k], 0.0), modes[j]) * normal[k]
                for k, j in enumerate(self.curved)
            ]
        )

    def curved_slopes(self, w: Array, normal: Array) -> Array:
        """Return the derivatives of `curved_forces` with respect to `w`."""
        laws, modes = self.system.laws, self.modes
        return np.array(
            [laws[j].mu_k_slope(max(modes[j] * w[k], 0.0), modes[j]) * normal[k] for k, j in enumerate(self.curved)]
        )


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
    """Sparse rows above an operator's rows."""

    def __init__(self, top: Any, below: Any, height: int) -> None:
        self._top, self._below, self._height = top, below, height

    def __matmul__(self, y: Array) -> Array:
        values = np.zeros((self._height, *y.shape[1:]))
        split = self._top.shape[0]
        values[:split] = self._top @ y
        if self._below is not None:
            values[split:] = self._below @ y
        return values


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
