"""A scene as constants: its states, its inputs, its rows, and the matrices between them.

Everything is linear in the state ``y = (velocities, positions, bristles)``, in the inputs
``q = (normal forces, forces, drive velocities, drive accelerations, 1)`` and in the friction forces of rows whose law
depends on velocity. Only bodies that a spring touches have a position.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.equations.balance import Balance
from stickslip.equations.book import Book
from stickslip.equations.loads import Loads
from stickslip.equations.piecewise import PiecewiseMatrices, Triplets
from stickslip.model.laws.dry_friction import DryFriction
from stickslip.model.laws.table import LawTable
from stickslip.model.scene import Scene
from stickslip.model.signal_makers import Constant, PiecewiseLinear, Signal

__all__ = ["System"]

Array = NDArray[np.float64]

_DENSE_LIMIT = 150
"""Bodies and rows together from which matrices are kept sparse."""

_REMEMBERED, _REMEMBERED_SPARSE = 128, 4
_NO_LAW = DryFriction(0.0, 0.0)


class System:
    """A scene compiled to constant matrices. It never changes.

    Parameters
    ----------
    scene : Scene

    Attributes
    ----------
    n, drives, m, size, inputs : int
        Numbers of bodies, drives, rows, states and inputs.
    G, D : array or sparse (m, n), (m, drives)
        Coefficients of the rows on bodies and drives.
    C, Q : array or sparse (n, size), (n, inputs)
        Forces on the bodies from states and inputs.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        book = Book(scene)
        self.index, self.rows = book.index, book.rows
        self.couplings = book.couplings
        self.names = [body.name for body in book.bodies]
        n, drives, m = len(book.bodies), len(book.drives), len(book.rows)
        self.n, self.drives, self.m = n, drives, m
        self.sparse = n + m > _DENSE_LIMIT
        self.inertia = np.array([body.inertia for body in book.bodies])
        self.normals = [row.normal for row in book.rows]
        self.others = [signal for _, signal in book.forces] + book.signals
        self.others += [_signal(drive.velocity) for drive in book.drives]
        self.first_force, self.first_signal = m, m + len(book.forces)
        self.first_drive = self.first_signal + len(book.signals)
        self.first_acceleration = self.first_drive + drives
        self.inputs = self.first_acceleration + drives + 1
        self._place_states(book)
        self._place_laws(book)
        self._join(book)
        self.piecewise = PiecewiseMatrices(book, self)
        remembered = _REMEMBERED_SPARSE if self.sparse else _REMEMBERED
        self.remembered = lru_cache(maxsize=remembered)(self._made)
        self.balance = lru_cache(maxsize=remembered)(self._balance)

    def _place_states(self, book: Book) -> None:
        stretched = {i for c in book.couplings if c.stiffness for i in c.coefficients}
        self.placed = np.array(sorted(stretched | book.read), dtype=np.intp)
        self.first_bristle = self.n + self.placed.size
        self.position_state = {int(i): self.n + k for k, i in enumerate(self.placed)}

    def _place_laws(self, book: Book) -> None:
        c = self.laws = LawTable([row.law or _NO_LAW for row in book.rows])
        self.is_tie = np.array([row.kind == "tie" for row in book.rows], dtype=bool)
        self.is_one_way = np.array([row.kind == "one-way" for row in book.rows], dtype=bool)
        self.is_gap = np.array([row.kind == "gap" for row in book.rows], dtype=bool)
        self.is_stop = np.array([row.kind == "stop" for row in book.rows], dtype=bool)
        self.has_stops = bool(self.is_stop.any())
        self.restitution = np.array([row.restitution for row in book.rows])
        self.is_friction = ~(self.is_tie | self.is_one_way | self.is_gap | self.is_stop)
        self.all_friction = bool(self.is_friction.all())
        self.mu_c, self.mu_s, self.least, self.dwell = c.mu_c, c.mu_s, c.least, c.dwell
        self.loaded = np.array([_ever_positive(s) for s in self.normals], dtype=bool)
        resists = (self.mu_s.max(axis=0, initial=0.0) > 0) | c.curved
        self.alive = (self.loaded & resists) | ~self.is_friction
        self.hard = c.sticks & ~self.is_gap
        self.all_hard = bool((self.hard | self.is_gap).all())
        self.free = ~(c.sticks | c.has_slip_state)
        bristles = np.flatnonzero(c.has_state)
        self.size = self.first_bristle + bristles.size
        self.bristle_state = {int(j): self.first_bristle + k for k, j in enumerate(bristles)}
        # rise of the static coefficient with the dwell, forward and backward
        rise = np.maximum(self.mu_s - self.least, 0.0)
        self.rise = np.where(self.dwell > 0, rise, 0.0)
        dwells = (self.rise.max(axis=0, initial=0.0) > 0) & self.hard
        self.dwelling = dwells.nonzero()[0]
        self.dwell_place = np.full(self.m, -1)
        self.dwell_place[self.dwelling] = np.arange(self.dwelling.size)
        self.largest_coefficient = np.maximum(self.mu_s, self.least).max(axis=0, initial=0.0)

    def _join(self, book: Book) -> None:
        n, drives = self.n, self.drives
        rows, driven = Triplets(), Triplets()
        for j, row in enumerate(book.rows):
            for i, c in row.coefficients.items():
                (rows if i < n else driven).add(j, i if i < n else i - n, c)
        self.G, self.D = self.matrix(rows, (self.m, n)), self.matrix(driven, (self.m, drives))
        state, inputs = Triplets(), Triplets()
        for link in book.couplings:
            for i, c in link.coefficients.items():
                if i >= n:
                    continue
                for k, e in link.coefficients.items():
                    if link.stiffness:
                        state.add(i, self.position_state[k], -c * e * link.stiffness)
                    if k < n:
                        state.add(i, k, -c * e * link.damping)
                    else:
                        inputs.add(i, self.first_drive + k - n, -c * e * link.damping)
                inputs.add(i, self.inputs - 1, c * link.stiffness * link.rest)
        for k, (i, _) in enumerate(book.forces):
            inputs.add(i, self.first_force + k, 1.0)
        self.C, self.Q = self.matrix(state, (n, self.size)), self.matrix(inputs, (n, self.inputs))
        self.has_couplings = bool(state.values or book.piecewises)
        self.GT = self.G.T.tocsr() if self.sparse else np.ascontiguousarray(self.G.T)
        self.abs_C, self.abs_Q, self.abs_GT = abs(self.C), abs(self.Q), abs(self.GT)
        self.abs_G, self.abs_D = abs(self.G), abs(self.D)
        self.largest_lever = np.array([max(map(abs, row.coefficients.values())) for row in book.rows])
        # places of the velocities whose integrals the positions are
        self.moved = np.array([i for i in self.placed if i < n], dtype=np.intp)
        self.moved_state = np.array([self.position_state[int(i)] for i in self.moved], dtype=np.intp)
        self.carried = np.array([i - n for i in self.placed if i >= n], dtype=np.intp)
        self.carried_state = np.array(
            [self.position_state[int(i)] for i in self.placed if i >= n], dtype=np.intp
        )

    def matrix(self, triplets: Triplets, shape: tuple[int, int]) -> Any:
        """Return entries as a matrix, dense or sparse as the scene is."""
        if not self.sparse:
            dense = np.zeros(shape)
            if triplets.rows:
                np.add.at(dense, (triplets.rows, triplets.columns), triplets.values)
            return dense
        entries = (np.array(triplets.values), (np.array(triplets.rows, int), np.array(triplets.columns, int)))
        matrix = scipy.sparse.coo_array(entries, shape=shape).tocsr()
        matrix.eliminate_zeros()
        return matrix

    def at_start(self) -> Array:
        """Return the state that the scene gives."""
        scene, y = self.scene, np.zeros(self.size)
        y[: self.n] = [body.velocity for body in scene.bodies]
        places: list[Any] = [*scene.bodies, *scene.drives]
        y[self.n : self.first_bristle] = [places[i].position for i in self.placed]
        return y

    def loads(self, start: float, stop: float, stepped: bool = False) -> Loads:
        """Return the inputs over a time span; normal forces are cut off at 0."""
        clipped = [s.clipped(start, stop) for s in self.normals]
        return Loads(
            [*clipped, *self.others], range(self.first_drive, self.first_acceleration), start, stop, stepped
        )

    def drive_velocities(self, q: Array) -> Array:
        """Return the velocities of the drives from the inputs."""
        return q[self.first_drive : self.first_acceleration]

    def drive_accelerations(self, q: Array) -> Array:
        """Return the accelerations of the drives from the inputs."""
        return q[self.first_acceleration : self.inputs - 1]

    def relative_velocity(self, y: Array, q: Array) -> Array:
        """Return ``w`` of every row."""
        w = self.G @ y[: self.n]
        return np.asarray(w + self.D @ self.drive_velocities(q) if self.drives else w)

    def level(self, rows: Any, side: int, q: Array) -> Array:
        """Return the breakaway levels of some rows, forward (0) or backward (1), from inputs and dwells."""
        level: Array = self.mu_s[side, rows] * q[rows]
        place = self.dwell_place[rows]
        rising = place >= 0
        if rising.any():
            level[rising] -= self.rise[side, rows][rising] * q[self.inputs + place[rising]]
        return level

    def sign_of(self, w: Array) -> Array:
        """Return the mode that a law without modes shows: the sign of `w` beyond its pre-slip velocity."""
        limit = self.laws.slips_beyond
        return np.where(np.abs(w) > (limit if w.ndim == 1 else limit[:, None]), np.sign(w), 0.0)

    def _made(self, make: Callable[[System, bytes], Any], key: bytes) -> Any:
        return make(self, key)

    def _balance(self, held: bytes) -> Balance:
        mask = np.frombuffer(held, dtype=bool)
        return Balance(self.inertia, self.G[mask], self.D[mask])

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the scene only: all the rest follows from it."""
        return System, (self.scene,)


def _signal(value: Signal | float) -> Signal:
    return value if isinstance(value, Signal) else Constant(float(value))


def _ever_positive(signal: Signal) -> bool:
    match signal:
        case Constant(value=value):
            return value > 0
        case PiecewiseLinear(values=values):
            return max(values) > 0
    return True
