"""The motion between events, piece by piece: small data from which every quantity can be computed at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.balance import Balance
from stickslip.equations.loads import Loads
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System

__all__ = ["Piece", "Trajectory", "balances_kept", "by_piece", "kind_of"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Modes = NDArray[np.int8]

_BALANCE_BYTES = 32_000_000
"""Memory for balances of forces that are kept, because to build one takes as long as to evaluate many times."""

_DENSE_BYTES, _SPARSE_BYTES = 32, 200
_AT_ONCE = 2_000_000
"""Coefficients that are evaluated at once."""


@dataclass(frozen=True)
class Piece:
    """One motion, from one event or break of the loads to the next.

    Attributes
    ----------
    t, stop : float
        Start and end in s.
    y : array (size,)
        State at the start.
    modes : array (m,) of int8
        Modes as the equations know them.
    labels : array (m,) of int8
        Modes that the rows show: -1, 0 or +1.
    since : array (m,)
        When each row last became held, in s.
    path : Path or None
        The states; None where only the requested outputs were kept.
    """

    t: float
    stop: float
    y: Array = field(repr=False)
    modes: Modes
    labels: Modes
    since: Array = field(repr=False)
    path: Path | None = field(repr=False)

    @property
    def end(self) -> float:
        """Local time in s of the end."""
        return self.stop - self.t if self.path is None else float(self.path.taus[-1])


@dataclass(frozen=True)
class Trajectory:
    """All pieces of a simulated motion, in order of time.

    Attributes
    ----------
    system : System
    span : (float, float, bool)
        Start and end in s of the loads, and whether a fixed-step method read them.
    pieces : sequence of Piece
    """

    system: System = field(repr=False)
    span: tuple[float, float, bool]
    pieces: Sequence[Piece] = field(repr=False)
    _balances: dict[bytes, Balance] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def loads(self) -> Loads:
        """The inputs over the time span."""
        return self.system.loads(*self.span)

    @cached_property
    def starts(self) -> Array:
        """Start of each piece in s."""
        return np.array([piece.t for piece in self.pieces])

    @cached_property
    def stops(self) -> Array:
        """End of each piece in s."""
        return np.array([piece.stop for piece in self.pieces])

    @cached_property
    def is_dense(self) -> bool:
        """Whether the states are known at all times."""
        return bool(self.pieces) and all(piece.path is not None for piece in self.pieces)

    def motion(self, number: int) -> Motion:
        """Return the motion of a piece, built again."""
        piece = self.pieces[number]
        equations = equations_in(piece.modes, self.system)
        return Motion(equations, self.loads.after(piece.t), piece.t, piece.y, piece.since)

    def places(self, times: Array) -> Indices:
        """Return the piece that holds each time, the later one at an event.

        Raises
        ------
        ValueError
            If a time lies outside, or only the requested outputs were kept.
        """
        if not times.size:
            return np.empty(0, dtype=np.intp)
        if not self.pieces:
            raise ValueError("nothing was computed, the simulation failed at its start")
        if not self.is_dense:
            raise ValueError("the points between the outputs were not kept; simulate with dense_output=True")
        start, stop = self.pieces[0].t, self.pieces[-1].stop
        if not (times.min() >= start and times.max() <= stop):
            raise ValueError(
                f"times must lie in [{start:g}, {stop:g}] s, got {times.min():g} to {times.max():g}"
            )
        return np.searchsorted(self.starts, times, side="right") - 1

    def local(self, piece_of: Indices, times: Array) -> Array:
        """Return times in s since the starts of their pieces, none before and none past the end."""
        return np.clip(times - self.starts[piece_of], 0.0, self.ends[piece_of])

    def order(self, number: int) -> int:
        """Return the degree of the polynomials of a piece."""
        path = self.pieces[number].path
        return 0 if path is None or not path.taus[1:].size else path.coefficients.shape[1] - 1

    @cached_property
    def ends(self) -> Array:
        """Local time in s of the end of each piece."""
        return np.array([piece.end for piece in self.pieces])

    def states(self, piece_of: Indices, taus: Array) -> Array:
        """Return the states at local times of pieces, one column each.

        Velocities of held bodies are written through the ties that hold them: equal velocities are equal to the bit.

        Parameters
        ----------
        piece_of : array (k,) of int
            The piece of each time.
        taus : array (k,)
            Times in s since its start.
        """
        found = self.evaluated(piece_of, taus)
        self._tie(piece_of, taus, found)
        return found

    def evaluated(
        self, piece_of: Indices, taus: Array, change: Callable[[Path, int], Path] | None = None
    ) -> Array:
        """Return the polynomials of the steps at local times of pieces, one column each.

        Parameters
        ----------
        piece_of : array (k,) of int
            The piece of each time.
        taus : array (k,)
            Times in s since its start.
        change : callable, optional
            What to make of a path first, and of the number of velocities.
        """
        n = self.system.n
        found = np.empty((self.system.size if change is None else n, taus.size))
        blocks: dict[tuple[int, bool], list[tuple[Path, Indices | slice]]] = {}
        entries: dict[tuple[int, bool], int] = {}
        for number, chosen in by_piece(piece_of):
            path = self.pieces[number].path
            assert path is not None
            if change is not None:
                path = change(path, n)
            kind = kind_of(path)
            blocks.setdefault(kind, []).append((path, chosen))
            entries[kind] = entries.get(kind, 0) + path.coefficients.size
            if entries[kind] > _AT_ONCE:
                _evaluate(blocks.pop(kind), taus, found)
                entries[kind] = 0
        for block in blocks.values():
            _evaluate(block, taus, found)
        return found

    def _tie(self, piece_of: Indices, taus: Array, y: Array) -> None:
        """Write the velocities that depend on others through them, in place."""
        held = list(self.by_held(piece_of))
        if not held:
            return
        system = self.system
        drives = None
        if system.drives:
            drives = system.drive_velocities(self.loads_at(piece_of, taus))
        self.write_led(held, y[: system.n], drives)

    def write_led(
        self, held: Iterable[tuple[bytes, Indices | slice]], v: Array, drives: Array | None
    ) -> None:
        """Write what depends on others through the rows that hold it, in place.

        Parameters
        ----------
        held : iterable of (bytes, array of int or slice)
            Sets of held rows, and the columns in which each holds.
        v : array (n, k)
            Velocities of the bodies, or what follows the same ties.
        drives : array (d, k) or None
            The same of the drives.
        """
        for key, chosen in held:
            balance = self.balance(key)
            if not balance.dependent.size:
                continue
            led = balance.led_by_bodies @ v[:, chosen]
            if drives is not None:
                led = led + balance.led_by_drives @ drives[:, chosen]
            if isinstance(chosen, slice):
                v[balance.dependent, chosen] = led
            else:
                v[balance.dependent[:, None], chosen] = led

    def balance(self, held: bytes) -> Balance:
        """Return the balance of forces where some rows are held."""
        found = self._balances.get(held)
        if found is None:
            found = self.system.balance(held)
            if len(self._balances) < balances_kept(self.system):
                self._balances[held] = found
        return found

    def by_held(self, piece_of: Indices) -> Iterator[tuple[bytes, Indices | slice]]:
        """Yield each set of held rows but the empty one, as the key of its balance, and which times it holds."""
        groups: dict[bytes, list[Indices | slice]] = {}
        for number, chosen in by_piece(piece_of):
            held = (self.pieces[number].modes == 0) & self.system.hard
            if held.any():
                groups.setdefault(held.tobytes(), []).append(chosen)
        every = np.arange(piece_of.size)
        for held_rows, places in groups.items():
            whole = places[0] if len(places) == 1 else np.concatenate([every[place] for place in places])
            yield held_rows, whole

    def inputs(self, piece_of: Indices, taus: Array, y: Array) -> Array:
        """Return all inputs at local times and states there, as columns."""
        found = self.loads_at(piece_of, taus)
        dependence = self.system.dependence
        if dependence is None:
            return found
        t = self.starts[piece_of] + taus
        if dependence.is_linear:
            dependence.fill(found, y, t, taus, None)
            return found
        for number, chosen in by_piece(piece_of):
            part, motion = found[:, chosen], self.motion(number)
            dependence.fill(part, y[:, chosen], t[chosen], taus[chosen], motion)
            found[:, chosen] = part
        return found

    def loads_at(self, piece_of: Indices, taus: Array) -> Array:
        """Return the inputs that loads are at local times, as columns: what depends on the state is left out."""
        number = np.searchsorted(self.loads.breaks, self.starts[piece_of], side="right")
        found = np.empty((self.system.inputs, taus.size))
        for _, chosen in by_piece(number):
            pieces = piece_of[chosen]
            stretch = self.loads.after(self.starts[pieces[0]])
            found[:, chosen] = stretch.sampled(self.starts[pieces] + taus[chosen])
        return found

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what follows from the rest."""
        return {one.name: getattr(self, one.name) for one in fields(self)} | {"_balances": {}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


def balances_kept(system: System) -> int:
    """Return how many balances of forces a trajectory keeps."""
    rows = system.n + system.m
    return _BALANCE_BYTES // (_SPARSE_BYTES * rows if system.sparse else _DENSE_BYTES * rows**2)


def by_piece(piece_of: Indices) -> Iterator[tuple[int, Indices | slice]]:
    """Yield each piece that holds times, and which times it holds."""
    if not piece_of.size:
        return
    if (piece_of[1:] >= piece_of[:-1]).all():
        ends = [0, *((piece_of[1:] != piece_of[:-1]).nonzero()[0] + 1).tolist(), piece_of.size]
        for first, last in pairwise(ends):
            yield int(piece_of[first]), slice(first, last)
        return
    order = np.argsort(piece_of, kind="stable")
    numbers, firsts = np.unique(piece_of[order], return_index=True)
    yield from zip(numbers.tolist(), np.split(order, firsts[1:]), strict=True)


def kind_of(path: Path) -> tuple[int, bool]:
    """Return what paths have in common that are evaluated together: the number of terms and their basis."""
    return (path.coefficients.shape[1] if path.taus.size > 1 else 0), path.is_chebyshev


def _evaluate(block: list[tuple[Path, Indices | slice]], taus: Array, out: Array) -> None:
    """Write the states of paths of the same kind at local times, all polynomials at once."""
    steps, places, first = [], [], 0
    for path, chosen in block:
        local, ends = taus[chosen], path.taus
        count = ends.size - 1
        if not count:
            out[:, chosen] = path.last[:, None]
            continue
        step = np.clip(np.searchsorted(ends, local, side="right") - 1, 0, count - 1)
        h = ends[step + 1] - ends[step]
        places.append(np.divide(local - ends[step], h, out=np.zeros(local.size), where=h > 0))
        steps.append(step + first)
        first += count
    if not steps:
        return
    moving = [(path, chosen) for path, chosen in block if path.taus.size > 1]
    coefficients = np.concatenate([path.coefficients for path, _ in moving])
    values = _polynomials(
        coefficients, np.concatenate(steps), np.concatenate(places), block[0][0].is_chebyshev
    )
    first = 0
    for path, chosen in moving:
        local = taus[chosen]
        own = values[first : first + local.size]
        own[local >= path.taus[-1]] = path.last
        out[:, chosen] = own.T
        first += local.size


def _polynomials(coefficients: Array, step: Indices, s: Array, is_chebyshev: bool) -> Array:
    """Return the values of polynomials ``step`` at ``s``, by Clenshaw's or Horner's scheme."""
    highest = coefficients.shape[1] - 1
    if not is_chebyshev:
        s = s[:, None]
        value: Array = coefficients[step, highest]
        for j in range(highest - 1, -1, -1):
            value *= s
            value += coefficients[step, j]
        return value
    x = 2 * s[:, None] - 1
    later = np.zeros((step.size, coefficients.shape[2]))
    now = later
    for j in range(highest, 0, -1):
        now, later = coefficients[step, j] + 2 * x * now - later, now
    return np.asarray(coefficients[step, 0] + x * now - later)
