"""The motion between events, piece by piece: small data from which every quantity can be computed at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.loads.loads import Loads, Span
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.model.checks import every_digit
from stickslip.results.patchwork import Patchwork
from stickslip.results.pickled import PickledByFields
from stickslip.results.pieces import Piece, Pieces, WholePieces

NOTHING_KEPT = "nothing was kept: the run failed at its start, or came to none of the times asked for"

T = TypeVar("T", bound=np.generic)

_MODES_AT_ONCE = 2_000_000


@dataclass(frozen=True, eq=False)
class Trajectory(PickledByFields):
    """All pieces of a simulated motion, in order of time."""

    system: System = field(repr=False)
    span: Span
    pieces: Pieces = field(repr=False)

    @cached_property
    def loads(self) -> Loads:
        """The inputs over the time span."""
        return self.system.loads(*self.span)

    @property
    def parts(self) -> Sequence[Piece | Patchwork]:
        """The stored parts in order of time: whole pieces and patchworks."""
        return self.pieces.parts

    @cached_property
    def whole(self) -> WholePieces:
        """The pieces that are stored as a whole."""
        return WholePieces(self.system, [part for part in self.parts if isinstance(part, Piece)])

    @cached_property
    def patchworks(self) -> Sequence[Patchwork]:
        """The patchworks in order of time."""
        return [part for part in self.parts if isinstance(part, Patchwork)]

    @cached_property
    def _holders(self) -> Sequence[WholePieces | Patchwork]:
        """Objects that hold the pieces: all whole ones together, then each patchwork with its own."""
        return [self.whole, *self.patchworks]

    @cached_property
    def numbers(self) -> Sequence[Indices]:
        """The numbers of the whole pieces, then those of the pieces of each patchwork."""
        firsts = self.pieces.firsts
        is_whole = np.array([isinstance(part, Piece) for part in self.parts], dtype=bool)
        ends = zip(firsts[:-1][~is_whole].tolist(), firsts[1:][~is_whole].tolist(), strict=True)
        return [firsts[:-1][is_whole], *(np.arange(first, last) for first, last in ends)]

    @cached_property
    def starts(self) -> Array:
        """Start of each piece in s."""
        return self._of_all(lambda part: part.starts)

    @cached_property
    def stops(self) -> Array:
        """End of each piece in s."""
        return self._of_all(lambda part: part.stops)

    @cached_property
    def ends(self) -> Array:
        """Local time in s of the end of each piece."""
        return self._of_all(lambda part: part.durations)

    def _of_all(self, read: Callable[[WholePieces | Patchwork], Array]) -> Array:
        if not self.patchworks:
            return read(self.whole)
        found = np.empty(len(self.pieces))
        for numbers, part in zip(self.numbers, self._holders, strict=True):
            found[numbers] = read(part)
        return found

    @cached_property
    def is_patchwork(self) -> bool:
        """Whether all pieces are in patchworks."""
        return not self.whole.pieces

    @cached_property
    def is_dense(self) -> bool:
        """Whether the states are known at all times."""
        return bool(self.parts) and self.whole.is_dense

    def motion(self, number: int) -> Motion:
        """Return the motion of a piece, built again."""
        piece = self.pieces[number]
        equations = equations_in(piece.modes, self.system, piece.regions)
        return Motion(equations, self.loads.after(piece.t), piece.t, piece.y, piece.since)

    def places(self, times: Array) -> Indices:
        """Return the piece that holds each time, the later one at an event."""
        if not times.size:
            return np.empty(0, dtype=np.intp)
        if not self.pieces:
            raise ValueError(NOTHING_KEPT)
        if not self.is_dense:
            raise ValueError("the points between the outputs were not kept; simulate with dense_output=True")
        start, stop = self.starts[0], self.stops[-1]
        if not (times.min() >= start and times.max() <= stop):
            raise ValueError(
                f"times must lie in [{start:g}, {stop:g}] s, got "
                f"{every_digit(times.min())} to {every_digit(times.max())}"
            )
        return np.searchsorted(self.starts, times, side="right") - 1

    def local(self, piece_of: Indices, times: Array) -> Array:
        """Return times in s since the starts of their pieces, clipped to the pieces."""
        return np.minimum(np.maximum(times - self.starts[piece_of], 0.0), self.ends[piece_of])

    def order(self, number: int) -> int:
        """Return the degree of the polynomials of a piece."""
        part, _ = self.pieces.part(number)
        if isinstance(part, Patchwork):
            return int(part.bodies.terms.shape[1])
        path = part.path
        return 0 if path is None or not path.taus[1:].size else path.coefficients.shape[1] - 1

    def each_modes(self) -> Iterator[tuple[Modes, float]]:
        """Yield the modes of each piece as the equations know them, and how long it lasts in s."""
        count = max(_MODES_AT_ONCE // max(self.system.m, 1), 1)
        for first in range(0, self.starts.size, count):
            numbers = np.arange(first, min(first + count, self.starts.size))
            inner = self.modes(numbers, np.zeros(numbers.size))[0]
            durations = self.stops[numbers] - self.starts[numbers]
            for k, duration in enumerate(durations.tolist()):
                yield np.ascontiguousarray(inner[:, k]), duration

    def steps(self, number: int) -> Array:
        """Return the local times at which steps of a piece end, its start among them."""
        part, k = self.pieces.part(number)
        if isinstance(part, Patchwork):
            return np.asarray(part.ends(k) - part.starts[k])
        if part.path is None:
            raise ValueError("the points between the outputs were not kept; simulate with dense_output=True")
        return part.path.taus

    # -- what is read of all pieces --------------------------------------------------------------------------

    @cached_property
    def _places(self) -> tuple[Indices, Indices]:
        """The number in `_holders` of what holds each piece, and the number of the piece there."""
        holder, own = np.empty((2, len(self.pieces)), dtype=np.intp)
        for k, numbers in enumerate(self.numbers):
            holder[numbers], own[numbers] = k, np.arange(numbers.size)
        return holder, own

    def _by_part(self, piece_of: Indices) -> Iterator[tuple[WholePieces | Patchwork, Indices | slice, Indices]]:
        """Yield each holder of some of these pieces, their places in `piece_of`, and their numbers in the holder."""
        if not self.patchworks or not piece_of.size:
            yield self.whole, slice(None), piece_of
            return
        holder, own = self._places
        for k, chosen in grouped(holder[piece_of]):
            yield self._holders[k], chosen, own[piece_of[chosen]]

    def _read(
        self,
        piece_of: Indices,
        taus: Array,
        read: Callable[[WholePieces | Patchwork, Indices, Array], NDArray[Any]],
    ) -> NDArray[Any]:
        """Return what `read` finds for pieces at local times, a column for each time."""
        found = [
            (chosen, read(part, own, part.times(own, taus[chosen]))) for part, chosen, own in self._by_part(piece_of)
        ]
        return side_by_side(found, piece_of.size)

    def modes(self, piece_of: Indices, taus: Array, rows: slice = slice(None)) -> tuple[Modes, Modes]:
        """Return at local times of pieces the modes of rows as the equations know them, and those shown."""
        inner, shown = self._read(piece_of, taus, lambda part, own, times: part.modes(own, times, rows))
        return inner, shown

    def since_when(self, piece_of: Indices, taus: Array, rows: slice = slice(None)) -> Array:
        """Return since when rows rest at local times of pieces, in s."""
        return self._read(piece_of, taus, lambda part, own, times: part.since_when(own, times, rows))

    def regions(self, piece_of: Indices, taus: Array, rows: slice = slice(None)) -> Regions:
        """Return the regions of the piecewise-linear functions of some rows at local times of pieces."""
        return self._read(piece_of, taus, lambda part, own, times: part.regions(own, times, rows))

    def held_forces(self, piece_of: Indices, taus: Array, rows: slice) -> Array:
        """Return the forces of held rows at local times of pieces where these are known row by row, 0 elsewhere."""
        return self._read(piece_of, taus, lambda part, own, times: part.forces(own, times, rows))

    def states(self, piece_of: Indices, taus: Array) -> Array:
        """Return the states at local times of pieces from the polynomials of the steps, one column each."""
        return self._read(piece_of, taus, lambda part, own, times: part.states(own, times))

    def distances(self, piece_of: Indices, taus: Array) -> Array:
        """Return how far the bodies have come since the starts of pieces at local times, one column each."""
        return self._read(piece_of, taus, lambda part, own, times: part.distances(own, times))

    def distances_from_start(self, piece_of: Indices, taus: Array, bodies: slice = slice(None)) -> Array | None:
        """Return how far bodies have come since the first start; None unless all pieces are in patchworks."""
        if not self.is_patchwork:
            return None
        base = np.zeros(self.system.n)[bodies]
        found = np.empty((base.size, taus.size))
        holder, own = self._places
        for k, part in enumerate(self.patchworks, 1):
            some = (holder[piece_of] == k).nonzero()[0]
            number = own[piece_of[some]]
            begin, end = part.at_ends[:, bodies]
            base = base - begin
            found[:, some] = base[:, None] + part.positions(number, part.times(number, taus[some]), bodies)
            base = base + end
        return found

    def of_body(self, piece_of: Indices, taus: Array, body: int, integrated: bool = False) -> Array:
        """Return the velocity of one body at local times, or its position where that is a state.

        All pieces must be in patchworks.
        """
        found, own_body = np.empty(taus.size), slice(body, body + 1)
        for part, some, own in self._by_part(piece_of):
            assert isinstance(part, Patchwork)
            read = part.positions if integrated else part.velocities
            found[some] = read(own, part.times(own, taus[some]), own_body)[0]
        return found

    def write_led(self, held: Iterable[tuple[Mask, Indices | slice]], v: Array, drives: Array | None) -> None:
        """Overwrite the velocities of bodies that follow others through held rows.

        `v` are velocities or distances of the bodies, a column for each time, and `drives` those of the drives; `held`
        are sets of held rows, each with the columns in which they are held.
        """
        for rows, chosen in held:
            balance = self.system.balance(rows)
            if not balance.dependent.size:
                continue
            led = balance.T_dependent @ v[:, chosen]
            if drives is not None and balance.is_driven:
                led = led + balance.U_dependent @ drives[:, chosen]
            v[at_rows(balance.dependent, chosen)] = led

    def by_held(self, piece_of: Indices) -> Iterator[tuple[Mask, Indices | slice]]:
        """Yield the sets of held rows in whole pieces, but the empty one, each with its places in `piece_of`."""
        sets, set_of = self.whole.held_sets
        for part, chosen, own in self._by_part(piece_of):
            if part is not self.whole:
                continue
            for k, some in grouped(set_of[own]):
                if k:
                    yield sets[k], np.arange(piece_of.size)[chosen][some] if self.patchworks else some

    def inputs(self, piece_of: Indices, taus: Array, y: Array, loads: Array) -> Array:
        """Return all inputs at local times, as columns, from these loads and states.

        Derivatives of blocks, which no result reads, stay 0. Some inputs of the scene must depend on the state.
        """
        dependence, found, t = self.system.dependence, loads.copy(), self.starts[piece_of] + taus
        assert dependence is not None
        if dependence.is_linear:
            dependence.fill(found, y, t, taus, None)
            return found
        for number, chosen in grouped(piece_of):
            part, motion = found[:, chosen], self.motion(number)
            dependence.fill(part, y[:, chosen], t[chosen], taus[chosen], motion.friction_of, dependence.but_rates)
            found[:, chosen] = part
        return found

    def loads_at(self, piece_of: Indices, taus: Array, only: slice = slice(None)) -> Array:
        """Return the inputs at local times, as columns, without what depends on the state."""
        if not taus.size:
            return np.empty((len(range(self.system.inputs)[only]), 0))
        starts = self.starts[piece_of]
        if not self.loads.breaks:
            return self.loads.after(self.starts[0]).sampled(starts + taus, only)
        number = np.array(self.loads.breaks).searchsorted(starts, side="right")
        found = []
        for _, chosen in grouped(number):
            begins = starts[chosen]
            found.append((chosen, self.loads.after(begins[0]).sampled(begins + taus[chosen], only)))
        return side_by_side(found, taus.size)

    def drive_velocities(self, piece_of: Indices, taus: Array) -> Array:
        """Return the velocities of the drives at local times, as columns."""
        drives = slice(self.system.first_drive, self.system.first_acceleration)
        return self.loads_at(piece_of, taus, drives)


def side_by_side(found: Sequence[tuple[Indices | slice, NDArray[T]]], size: int) -> NDArray[T]:
    """Return as one table the columns that were read from several parts, each with their places among all `size`."""
    if len(found) == 1:
        return found[0][1]
    first = found[0][1]
    whole = np.empty((*first.shape[:-1], size), dtype=first.dtype)
    for chosen, part in found:
        whole[..., chosen] = part
    return whole


def at_rows(rows: Indices, chosen: Indices | slice) -> tuple[Indices, Indices | slice]:
    """Return the index of some rows of a table at some times."""
    return (rows if isinstance(chosen, slice) else rows[:, None]), chosen


def columns(table: NDArray[T], chosen: Indices | slice) -> NDArray[T]:
    """Return the columns of a table at some times; for a few, `take` needs a third of the time of an index."""
    found: NDArray[T] = table[:, chosen] if isinstance(chosen, slice) else table.take(chosen, axis=1)
    return found


def grouped(number_of: Indices) -> Iterator[tuple[int, Indices | slice]]:
    """Yield each number in `number_of`, and the places where it stands."""
    if not number_of.size:
        return
    order = None if (number_of[1:] >= number_of[:-1]).all() else number_of.argsort(kind="stable")
    counts = np.bincount(number_of)
    numbers = counts.nonzero()[0]
    first = 0
    for number, last in zip(numbers.tolist(), counts[numbers].cumsum().tolist(), strict=True):
        yield number, slice(first, last) if order is None else order[first:last]
        first = last
