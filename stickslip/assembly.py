"""A scene compiled: its states, its inputs, and the constant matrices between them.

Everything here is linear in the state ``y = (velocities, positions)``, in the input vector
``q = (normal forces, forces, drive velocities, drive accelerations, 1)`` and in the friction forces of contacts
that act through their velocity. Only bodies that a spring touches have a position.
"""

from __future__ import annotations

import weakref
from copy import copy
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stickslip.connection import unconnected_parts
from stickslip.friction import BRISTLE, HARD, SMOOTH, Coefficients
from stickslip.grouping import Groups
from stickslip.loads import Loads
from stickslip.mode_set import ModeSet
from stickslip.mode_set_dense import DenseModeSet
from stickslip.mode_set_sparse import SparseModeSet
from stickslip.scene import GROUND, Scene
from stickslip.signals import Constant, PiecewiseLinear, Signal

__all__ = ["System"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_DENSE_LIMIT = 100
_REMEMBERED, _REMEMBERED_LARGE = 64, 4
_SHARED, _SHARED_LIMIT = 8, 30
_SPANS = 4
_COMPILED: dict[int, System] = {}


class System:
    """A scene compiled to index arrays and constant matrices.

    Parameters
    ----------
    scene : Scene

    Attributes
    ----------
    loads : Loads
        Over the time span, once it is known.
    quiet : float
        Velocity in m/s or rad/s that the tolerances of a run leave uncertain.
    blur : float
        Part of the forces at an event that is uncertain: roundoff, or what IDA's tolerances leave.
    """

    loads: Loads
    span: tuple[float, float]
    stepped: bool
    quiet: float = 0.0
    blur: float = 1e-12
    normals: list[Signal]
    velocities: list[Signal]

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._spans: dict[tuple[float, float, bool], tuple[list[Signal], Loads]] = {}
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
        self.parts = unconnected_parts(scene)
        # mode sets hold the compiled scene, and live as long as it does
        remembered = _REMEMBERED_LARGE if self.sparse else _REMEMBERED
        self.mode_set = lru_cache(maxsize=remembered)(self._mode_set)
        self.groups = lru_cache(maxsize=remembered)(self._groups)

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
        """Return the compiled scene; it is compiled once, and an equal small one shares it."""
        known = _COMPILED.get(id(scene))
        if known is None:
            try:
                small = len(scene.bodies) + len(scene.contacts) <= _SHARED_LIMIT
                known = _compiled(scene) if small else _compiled.__wrapped__(scene)
            except TypeError:  # a law or load of the user's that has no hash
                known = _compiled.__wrapped__(scene)
            _COMPILED[id(scene)] = known
            # a scene that nobody holds is forgotten
            weakref.finalize(scene, _COMPILED.pop, id(scene), None)
        system = copy(known)
        system.scene = scene
        return system

    def over(self, start: float, stop: float, stepped: bool = False) -> System:
        """Return the same system with its loads over a time span, read as a fixed-step method does if `stepped`."""
        system = copy(self)
        known = self._spans.get((start, stop, stepped))
        if known is None:
            normals = [s.clipped(start, stop) for s in self._normals]
            signals = [*normals, *self._others]
            loads = Loads(signals, range(self.first_drive, len(signals)), start, stop, stepped)
            if len(self._spans) >= _SPANS:
                self._spans.clear()
            known = self._spans[start, stop, stepped] = normals, loads
        system.normals, loads = known
        system.velocities = self._others[len(self._others) - self.drives :]
        system.loads = loads.anew()
        system.span, system.stepped = (start, stop), stepped
        return system

    def __copy__(self) -> System:
        """Share everything: only what belongs to a time span is replaced."""
        system = object.__new__(System)
        system.__dict__.update(self.__dict__)
        return system

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the scene and the span only: all the rest follows from them."""
        return _again, (self.scene, *self.span, self.stepped)

    def _place_laws(self, scene: Scene) -> None:
        c = self.coefficients = Coefficients([contact.law for contact in scene.contacts])
        self.mu_c, self.mu_s, self.mu_0, self.dwell = c.mu_c, c.mu_s, c.mu_0, c.dwell
        # a kinetic curve may begin at 0: then there is friction in motion only
        moves = np.array([j in c.kinetic for j in range(self.m)], dtype=bool)
        self.alive = self.loaded & ((self.mu_s.max(axis=0) > 0) | moves)
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
        # the forces on each body from absolute values of states and inputs, all counted positive
        largest = self.mu_s.max(axis=0, initial=0.0)
        if self.sparse:
            pushed = abs(self.force_of_contacts) @ sparse.diags_array(largest, shape=(self.m, self.inputs))
            self.magnitudes = sparse.hstack([abs(self.C), abs(self.Q) + pushed], format="csr")
        else:
            pushed = np.abs(self.Q)
            pushed[:, : self.m] += np.abs(self.force_of_contacts) * largest
            self.magnitudes = np.hstack([np.abs(self.C), pushed])

    def _matrix(self, triplets: _Triplets, shape: tuple[int, int]) -> Any:
        if not self.sparse:
            dense = np.zeros(shape)
            np.add.at(dense, (triplets.rows, triplets.columns), triplets.values)
            return dense
        matrix = sparse.coo_array((triplets.values, (triplets.rows, triplets.columns)), shape=shape).tocsr()
        matrix.eliminate_zeros()
        return matrix

    def drive_accelerations(self, inputs: Array) -> Array:
        """Return the drives' accelerations in the places of their velocities, among inputs (rows) that are else 0."""
        rates = np.zeros_like(inputs)
        rates[self.first_drive : self.first_acceleration] = inputs[self.first_acceleration : -1]
        return rates

    def at_ends(self, values: Array, contacts: Indices | slice = slice(None)) -> Array:
        """Return the sums of bodies' values (rows) over both ends of contacts; prescribed bodies count nothing."""
        wide = np.concatenate([values, np.zeros((self.drives + 1, *values.shape[1:]))])
        return wide[self.a[contacts]] + wide[self.b[contacts]]

    def sign_of(self, w: Array) -> Array:
        """Return the mode that a law without modes shows: the sign of `w` beyond its pre-slip velocity."""
        limit = self.coefficients.velocity
        return np.where(np.abs(w) > (limit if w.ndim == 1 else limit[:, None]), np.sign(w), 0.0)

    def _mode_set(self, modes: bytes) -> ModeSet:
        """Return the equations in these modes (as bytes)."""
        return (SparseModeSet if self.sparse else DenseModeSet)(self, np.frombuffer(modes, dtype=np.int8))

    def _groups(self, joined: bytes) -> Groups:
        """Return the rigid groups that the contacts of a mask (as bytes) form."""
        mask = np.frombuffer(joined, dtype=bool)
        return Groups(self.inertia, self.a[mask], self.b[mask])


@lru_cache(maxsize=_SHARED)
def _compiled(scene: Scene) -> System:
    system = System(scene)
    # what is kept as long as the scene must not hold it
    del system.scene
    return system


def _again(scene: Scene, start: float, stop: float, stepped: bool) -> System:
    return System.of(scene).over(start, stop, stepped)


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


def _signal(value: Signal | float) -> Signal:
    return value if isinstance(value, Signal) else Constant(float(value))


def _ever_positive(signal: Signal) -> bool:
    match signal:
        case Constant(value=value):
            return value > 0
        case PiecewiseLinear(values=values):
            return max(values) > 0
    return True
