"""Quantities of all contacts and bodies at the times of a result, many segments at once.

What one contact or body does is read off the states and the loads, as arrays over all times. Only the forces of
stuck contacts need the rigid groups that they form: they are found once for every set of modes that occurs, for all
contacts together, and kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from stickslip.assembly import System
from stickslip.friction import HARD, LINEAR, ActingForces
from stickslip.mode_set import FREE, OPEN
from stickslip.pieces import Piece, mode_shown
from stickslip.side_by_side import SideBySide

__all__ = ["Reading"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_NUMBERS_AT_ONCE = 200_000
_Kind = tuple[NDArray[np.int8], list[int], Indices]
"""Modes of all contacts, the pieces in them, and their times."""


class Reading:
    """What is read off the pieces of a motion at given times.

    Parameters
    ----------
    system : System
    pieces : sequence of Piece
    t : array (n,)
        Times in s.
    y : array (size, n)
        The states then.
    piece_of : array (n,)
        The number of the piece to which each time belongs.
    """

    def __init__(
        self, system: System, pieces: Sequence[Piece], t: Array, y: Array, piece_of: Indices
    ) -> None:
        self._system, self._all, self._y = system, pieces, y
        numbers, self._place = np.unique(piece_of, return_inverse=True)
        self._numbers = numbers
        self._pieces = [pieces[k] for k in numbers.tolist()]
        self._starts = np.array([piece.start for piece in self._pieces])
        self._stops = np.array([piece.stop for piece in self._pieces])
        self._taus = np.maximum(t - self._starts[self._place], 0.0)

    # -- loads and velocities -----------------------------------------------------------------------------

    def _input(self, entry: int) -> Array:
        return self._system.loads.along(entry, self._starts, self._stops, self._place, self._taus)

    def normal(self, j: int) -> Array:
        """Return the normal force of a contact."""
        return np.maximum(self._input(j), 0.0)

    def velocity(self, i: int) -> Array:
        """Return the velocity of a body, a drive, or the ground, by its number."""
        system = self._system
        if i >= system.n + system.drives:
            return np.zeros_like(self._taus)
        if i >= system.n:
            return self._input(system.first_drive + i - system.n)
        if not self._drives_rub:
            return self._y[i]
        # a body that is stuck to a drive is read from the same expression as the drive, so that the two are equal
        holder = self._holders[:, i][self._place]
        found = self._y[i].copy()
        for drive in np.unique(holder[(holder >= 0) & (holder < system.n + system.drives)]).tolist():
            found[holder == drive] = self.velocity(drive)[holder == drive]
        return found

    def relative_velocity(self, j: int) -> Array:
        """Return ``v_a - v_b`` of a contact."""
        return self.velocity(int(self._system.a[j])) - self.velocity(int(self._system.b[j]))

    @cached_property
    def _drives_rub(self) -> bool:
        first = self._system.n
        ends = np.concatenate([self._system.a, self._system.b])
        return bool(np.any((ends >= first) & (ends < first + self._system.drives)))

    # -- modes and levels ---------------------------------------------------------------------------------

    def _labels(self, j: int) -> NDArray[np.int8]:
        return self._table_of_labels[j][self._place]

    @cached_property
    def _table_of_labels(self) -> NDArray[np.int8]:
        return self._table([piece.labels for piece in self._pieces]).astype(np.int8)

    @cached_property
    def _table_of_codes(self) -> NDArray[np.int8]:
        return self._table([piece.modes for piece in self._pieces]).astype(np.int8)

    @cached_property
    def _table_of_ages(self) -> Array:
        """How long each contact has been stuck at the start of each piece, in s."""
        return self._starts - self._table([piece.since for piece in self._pieces])

    def _table(self, rows: list[NDArray[Any]]) -> NDArray[Any]:
        """Return a row per contact of what pieces hold."""
        return np.ascontiguousarray(np.array(rows).reshape(len(rows), self._system.m).T)

    def mode(self, j: int) -> NDArray[np.int8]:
        """Return the modes of a contact."""
        labels = self._labels(j)
        codes = self._table_of_codes[j]
        if not np.any(codes >= OPEN):
            return labels
        system = self._system
        a, b = (self._raw_velocity(int(ends[j])) for ends in (system.a, system.b))
        limit = float(system.coefficients.velocity[j])
        return mode_shown(codes[self._place], labels, a - b, limit, self._taus).astype(np.int8)

    def _raw_velocity(self, i: int) -> Array:
        return self._y[i] if i < self._system.n else self.velocity(i)

    def level(self, j: int, side: int | None) -> Array:
        """Return the breakaway level of a contact: forward (side 0), backward (1), or where it is pushed (None)."""
        system = self._system
        static, dwell = system.mu_s[:, j], float(system.dwell[j])
        coulomb = np.maximum(system.mu_c, system.mu_0)[:, j]
        normal = self.normal(j)
        if dwell == 0 and (static[0] == static[1] or side is not None):
            return float(static[side or 0]) * normal
        labels = self._labels(j)
        if side is not None:
            sides = np.full(labels.size, side)
        else:
            sides = (labels < 0).astype(np.intp)
            stuck = labels == 0
            if static[0] != static[1] and stuck.any():
                sides[stuck] = self.forces[j][stuck] < 0
        level = static[sides]
        if dwell > 0:
            age = self._table_of_ages[j][self._place] + self._taus
            lag = np.where(labels == 0, np.exp(-np.maximum(age, 0.0) / dwell), 1.0)
            level = level - (static - coulomb)[sides] * lag
        return level * normal

    # -- forces -------------------------------------------------------------------------------------------

    @property
    def forces(self) -> Array:
        """Friction forces of all contacts (rows)."""
        return self._solved[0]

    @property
    def _holders(self) -> NDArray[np.int32]:
        """For each piece (rows) the prescribed body that each body is stuck to, -1 for none."""
        return self._solved[1]

    @cached_property
    def _solved(self) -> tuple[Array, NDArray[np.int32]]:
        """Return the friction forces, and the holders where drives rub on bodies: all from one look at each group."""
        system = self._system
        forces = np.zeros((system.m, self._taus.size))
        holders = np.full((len(self._pieces) if self._drives_rub else 0, system.n), -1, dtype=np.int32)
        steady, varying = system.loads.steady()
        inputs = {entry: self._input(entry) for entry in varying}
        for kinds in _batches(self._by_modes(), _NUMBERS_AT_ONCE // (system.n + system.m + 1)):
            columns = np.concatenate([chosen for _, _, chosen in kinds])
            q = np.repeat(steady[:, None], columns.size, axis=1)
            for entry, values in inputs.items():
                q[entry] = values[columns]
            forces[:, columns], held_by = self._forces_in(kinds, columns, q)
            if self._drives_rub:
                for (_, members, _), holder in zip(kinds, held_by, strict=True):
                    holders[members] = holder
        self._take_multipliers(forces)
        return forces, holders

    def _by_modes(self) -> Iterator[_Kind]:
        """Yield each set of modes, the pieces that are in it, and their times."""
        kinds: dict[bytes, list[int]] = {}
        for k, piece in enumerate(self._pieces):
            kinds.setdefault(piece.modes.tobytes(), []).append(k)
        kind_of = np.empty(len(self._pieces), dtype=np.intp)
        for kind, members in enumerate(kinds.values()):
            kind_of[members] = kind
        of_times = kind_of[self._place]
        order = np.argsort(of_times, kind="stable")
        cuts = np.searchsorted(of_times[order], np.arange(1, len(kinds)))
        parts = np.split(order, cuts) if kinds else []
        for (modes, members), chosen in zip(kinds.items(), parts, strict=True):
            yield np.frombuffer(modes, dtype=np.int8), members, chosen

    def _forces_in(
        self, kinds: Sequence[_Kind], columns: Indices, q: Array
    ) -> tuple[Array, NDArray[np.intp]]:
        """Return the forces of all contacts at the times `columns`, in each of some sets of modes.

        The inputs are the columns of `q`. Besides, return for each set of modes (rows) what holds each body.
        """
        system, y = self._system, self._y[:, columns]
        coefficients = system.coefficients
        widths = [chosen.size for _, _, chosen in kinds]
        in_modes = np.array([modes for modes, _, _ in kinds])
        modes = np.repeat(in_modes.T, widths, axis=1)
        normals = np.maximum(q[: system.m], 0.0)
        slipping = (np.abs(modes) == 1) & ~coefficients.curved[:, None]
        mu = np.where(modes < 0, system.mu_c[1][:, None], system.mu_c[0][:, None])
        found = np.where(slipping, (modes * mu) * normals, 0.0)
        first = 0
        for own, width in zip(in_modes, widths, strict=True):
            curved = coefficients.curved & (np.abs(own) == 1)
            acting = np.flatnonzero(curved | (own == FREE) | ((own == 0) & (coefficients.kind == LINEAR)))
            if acting.size:
                some = slice(first, first + width)
                terms = columns[some], y[:, some], q[:, some], normals[:, some]
                found[acting, some] = self._acting_forces(own, acting, *terms)
            first += width
        stuck = (in_modes == 0) & (coefficients.kind == HARD)
        if not stuck.any():
            return found, np.full((len(kinds), system.n), -1)
        pushed = system.C @ y + system.Q @ q + system.force_of_contacts @ found
        lots = SideBySide(system, stuck, widths)
        solved = lots.forces(pushed, q[system.first_acceleration : -1])
        return np.where(np.repeat(stuck.T, widths, axis=1), solved, found), lots.holder

    def _acting_forces(
        self, modes: NDArray[np.int8], acting: Indices, chosen: Indices, y: Array, q: Array, normals: Array
    ) -> Array:
        """Return the forces of the contacts that act through their velocity."""
        system = self._system
        law = ActingForces(system.coefficients, acting, modes)
        places = [system.bristle_state[j] for j in acting[law.bristles].tolist()]
        w = system.W[acting] @ y
        if system.drives:
            w = w + system.D[acting] @ q
        dwell = system.dwell[acting]
        lag = np.zeros_like(w)
        for row in np.flatnonzero(dwell > 0).tolist():
            age = self._table_of_ages[acting[row]][self._place[chosen]] + self._taus[chosen]
            lag[row] = np.exp(-age / dwell[row])
        return law.forces(w, normals[acting], lag, y[places])

    def _take_multipliers(self, forces: Array) -> None:
        """Replace the forces of stuck contacts by those that a solver found as unknowns of its own."""
        if not any(piece.multipliers for piece in self._pieces):
            return
        order = np.argsort(self._place, kind="stable")
        cuts = np.searchsorted(self._place[order], np.arange(1, len(self._pieces)))
        hard = self._system.coefficients.kind == HARD
        for piece, chosen in zip(self._pieces, np.split(order, cuts), strict=True):
            stuck = np.flatnonzero((piece.modes == 0) & hard)
            if piece.multipliers is not None and stuck.size:
                curve = CubicHermiteSpline(piece.taus, *piece.multipliers)
                forces[np.ix_(stuck, chosen)] = curve(self._taus[chosen]).T

    # -- positions ----------------------------------------------------------------------------------------

    def position(self, i: int, base: float) -> Array:
        """Return the position of a body or drive that is no state, `base` at the start of the motion."""
        if not self._taus.size:
            return np.empty(0)
        if i < self._system.n:
            return base + self._travelled[self._row_of[i]]
        return base + self._travel_of_drive(i)

    @cached_property
    def _row_of(self) -> dict[int, int]:
        """Rows of the bodies whose positions are no states, by the bodies' numbers."""
        without = (i for i in range(self._system.n) if i not in self._system.position_state)
        return {i: row for row, i in enumerate(without)}

    @cached_property
    def _travelled(self) -> Array:
        """How far each body whose position is no state has gone (rows), all from one look at each piece."""
        bodies = np.array(list(self._row_of), dtype=np.intp)
        wholes = np.zeros((len(self._all), bodies.size))
        found = np.empty((bodies.size, self._taus.size))
        quick = np.array([piece.parabola is not None for piece in self._all], dtype=bool)
        if quick.any():
            y, f0, f1 = self._parabolas(bodies)
            last = np.array([piece.taus[-1] for piece in self._all])[:, None]
            wholes = last * (y + last * (f0 / 2 + last * f1 / 6))
            number, tau = self._numbers[self._place], self._taus[:, None]
            found = (tau * (y[number] + tau * (f0[number] / 2 + tau * f1[number] / 6))).T
        chosen = self._times_of_pieces()
        for k in np.flatnonzero(~quick).tolist():
            own = chosen[k]
            wholes[k], found[:, own] = self._all[k].displacements(bodies, self._taus[own])
        before = np.cumsum(np.vstack([np.zeros(bodies.size), wholes]), axis=0)
        return found + before[self._numbers[self._place]].T

    def _times_of_pieces(self) -> list[Indices]:
        """Return which times belong to each piece of the whole motion."""
        order = np.argsort(self._place, kind="stable")
        number = self._numbers[self._place[order]]
        return np.split(order, np.searchsorted(number, np.arange(1, len(self._all))))

    def _parabolas(self, bodies: Indices) -> tuple[Array, Array, Array]:
        """Return the velocities at the start of each piece (rows), their slopes and bends, 0 where not quadratic."""
        found = np.zeros((3, len(self._all), bodies.size))
        for k, piece in enumerate(self._all):
            if piece.parabola is not None:
                for row, values in zip(found, (piece.states[0], *piece.parabola), strict=True):
                    row[k] = values[bodies]
        y, f0, f1 = found
        return y, f0, f1

    def _travel_of_drive(self, i: int) -> Array:
        """Return how far a drive has gone: three-point Gauss between times so close that no turn hides there."""
        loads, entry = self._system.loads, self._system.first_drive + i - self._system.n
        chosen = self._times_of_pieces()
        edges = []
        for piece, some in zip(self._all, chosen, strict=True):
            last = float(piece.taus[-1])
            own = np.concatenate([loads.looks(last, 1), np.minimum(self._taus[some], last)])
            edges.append(np.unique(own))
        counts = [edge.size - 1 for edge in edges]
        middle = np.concatenate([0.5 * (edge[1:] + edge[:-1]) for edge in edges])
        half = np.concatenate([0.5 * np.diff(edge) for edge in edges])
        nodes, weights = np.polynomial.legendre.leggauss(3)
        starts, stops = (np.array([getattr(p, name) for p in self._all]) for name in ("start", "stop"))
        taus = (middle[:, None] + half[:, None] * nodes).ravel()
        place = np.repeat(np.arange(len(self._all)), np.array(counts) * nodes.size)
        velocity = loads.along(entry, starts, stops, place, taus)
        sums = np.cumsum(np.append(0.0, half * (velocity.reshape(-1, nodes.size) @ weights)))
        found, first = np.empty(self._taus.size), 0
        for edge, some in zip(edges, chosen, strict=True):
            found[some] = sums[first + np.searchsorted(edge, np.minimum(self._taus[some], edge[-1]))]
            first += edge.size - 1
        return found


def _batches(kinds: Iterable[_Kind], width: int) -> Iterator[list[_Kind]]:
    """Yield sets of modes together that have about as many times, none of them with more than `width` times in all."""
    parts = [
        (modes, members, chosen[first : first + width])
        for modes, members, chosen in kinds
        for first in range(0, chosen.size, max(width, 1))
    ]
    batch: list[_Kind] = []
    for part in sorted(parts, key=lambda part: part[2].size):
        if batch and (len(batch) + 1) * part[2].size > width:
            yield batch
            batch = []
        batch.append(part)
    if batch:
        yield batch
