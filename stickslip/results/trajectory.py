"""The motion between events, piece by piece: small data from which every quantity can be computed at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.loads.loads import Loads, Span
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.model.checks import every_digit
from stickslip.results.patchwork import Patchwork
from stickslip.results.pickled import PickledByFields
from stickslip.results.steps import Blocks

T = TypeVar("T", bound=np.generic)

_AT_ONCE = 2_000_000  # coefficients that are put together at once


@dataclass(frozen=True, eq=False)
class Piece:
    """One motion, from one event or break of the loads to the next."""

    # start and end in s
    t: float
    stop: float
    y: Array = field(repr=False)  # (size,): state at the start
    modes: Modes  # (m,): modes as the equations know them
    labels: Modes  # (m,): modes that the rows show: -1, 0 or +1
    since: Array = field(repr=False)  # (m,): when each row last became held, in s
    regions: Regions = field(repr=False)  # (p,): the region of each piecewise-linear function
    # (m,): of the rows, with which it began; None for none
    impulses: Array | None = field(repr=False)
    lost: Array | None = field(repr=False)  # (m,): the energy in J that each row took with its impulse
    path: Path | None = field(repr=False)  # the states; None where only the requested outputs were kept

    @property
    def kept_path(self) -> Path:
        """The states of a run that has kept them."""
        assert self.path is not None
        return self.path

    @property
    def end(self) -> float:
        """Local time in s of the end."""
        return self.stop - self.t if self.path is None else float(self.path.taus[-1])

    @classmethod
    def of(cls, patchwork: Patchwork, k: int, path: Path | None) -> Piece:
        """Return a piece of what is known part by part."""
        at, t = np.array([k]), patchwork.starts[k : k + 1]
        inner, shown = patchwork.modes(at, t)
        since, regions = patchwork.since_when(at, t)[:, 0], patchwork.regions(at, t)[:, 0]
        y = patchwork.states(at, t)[:, 0]
        stop = float(patchwork.stops[k])
        return cls(float(t[0]), stop, y, inner[:, 0], shown[:, 0], since, regions, None, None, path)


@dataclass(frozen=True)
class Pieces(PickledByFields, Sequence[Piece]):
    """Pieces in order, some of them put together from parts when they are asked for."""

    parts: tuple[Piece | Patchwork, ...] = field(repr=False)

    @classmethod
    def of(cls, parts: Sequence[Piece | Patchwork]) -> Sequence[Piece]:
        """Return the pieces that parts hold, in order."""
        plain = tuple(part for part in parts if isinstance(part, Piece))
        return plain if len(plain) == len(parts) else cls(tuple(parts))

    @cached_property
    def firsts(self) -> Indices:
        """The number of the first piece of each part, and that of all."""
        sizes = [part.starts.size if isinstance(part, Patchwork) else 1 for part in self.parts]
        return np.cumsum([0, *sizes])

    def __len__(self) -> int:
        return int(self.firsts[-1])

    @overload
    def __getitem__(self, number: int) -> Piece: ...

    @overload
    def __getitem__(self, number: slice) -> Sequence[Piece]: ...

    def __getitem__(self, number: int | slice) -> Piece | Sequence[Piece]:
        if isinstance(number, slice):
            return [self[k] for k in range(len(self))[number]]
        part, k = self.part(range(len(self))[number])
        return part if isinstance(part, Piece) else Piece.of(part, k, part.path(k))

    def part(self, number: int) -> tuple[Piece | Patchwork, int]:
        """Return what holds a piece, and its number there."""
        place = int(np.searchsorted(self.firsts, number, side="right")) - 1
        return self.parts[place], number - int(self.firsts[place])


@dataclass(frozen=True, eq=False)
class Trajectory(PickledByFields):
    """All pieces of a simulated motion, in order of time."""

    system: System = field(repr=False)
    span: Span
    pieces: Sequence[Piece] = field(repr=False)

    @cached_property
    def loads(self) -> Loads:
        """The inputs over the time span."""
        return self.system.loads(*self.span)

    @cached_property
    def parts(self) -> Sequence[Piece | Patchwork]:
        """What is stored, in order."""
        return self.pieces.parts if isinstance(self.pieces, Pieces) else self.pieces

    @cached_property
    def firsts(self) -> Indices:
        """The number of the first piece of each part."""
        return self.pieces.firsts[:-1] if isinstance(self.pieces, Pieces) else np.arange(len(self.pieces))

    @cached_property
    def starts(self) -> Array:
        """Start of each piece in s."""
        return self._joined(lambda piece: piece.t, lambda part: part.starts)

    @cached_property
    def stops(self) -> Array:
        """End of each piece in s."""
        return self._joined(lambda piece: piece.stop, lambda part: part.stops)

    @cached_property
    def ends(self) -> Array:
        """Local time in s of the end of each piece."""
        return self._joined(lambda piece: piece.end, lambda part: part.stops - part.starts)

    def _joined(self, of_piece: Callable[[Piece], float], of_part: Callable[[Patchwork], Array]) -> Array:
        found: list[float] = []
        for part in self.parts:
            if isinstance(part, Piece):
                found.append(of_piece(part))
            else:
                found += of_part(part).tolist()
        return np.array(found)

    @cached_property
    def is_patchwork(self) -> bool:
        """Whether all of it is known part by part."""
        return not self.whole

    @cached_property
    def is_dense(self) -> bool:
        """Whether the states are known at all times."""
        return bool(self.parts) and all(piece.path is not None for piece in self.whole)

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
            raise ValueError("nothing was computed, the simulation failed at its start")
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
        """Return times in s since the starts of their pieces, none before and none past the end."""
        return np.minimum(np.maximum(times - self.starts[piece_of], 0.0), self.ends[piece_of])

    def order(self, number: int) -> int:
        """Return the degree of the polynomials of a piece."""
        part, _ = self.part(number)
        if isinstance(part, Patchwork):
            return int(part.bodies.terms.shape[1])
        path = part.path
        return 0 if path is None or not path.taus[1:].size else path.coefficients.shape[1] - 1

    def part(self, number: int) -> tuple[Piece | Patchwork, int]:
        """Return what holds a piece, and its number there."""
        return self.pieces.part(number) if isinstance(self.pieces, Pieces) else (self.pieces[number], 0)

    def each_modes(self) -> Iterator[tuple[Modes, float]]:
        """Yield the modes of each piece as the equations know them, and how long it lasts in s."""
        count = max(_AT_ONCE // max(self.system.m, 1), 1)
        for first in range(0, self.starts.size, count):
            numbers = np.arange(first, min(first + count, self.starts.size))
            inner = self.modes(numbers, np.zeros(numbers.size))[0]
            durations = self.stops[numbers] - self.starts[numbers]
            for k, duration in enumerate(durations.tolist()):
                yield np.ascontiguousarray(inner[:, k]), duration

    def steps(self, number: int) -> Array:
        """Return the local times at which steps of a piece end, its start among them."""
        part, k = self.part(number)
        if isinstance(part, Patchwork):
            return np.asarray(part.ends(k) - part.starts[k])
        if part.path is None:
            raise ValueError("the points between the outputs were not kept; simulate with dense_output=True")
        return part.path.taus

    def by_part(self, piece_of: Indices) -> Iterator[tuple[Patchwork, Indices | slice, Indices]]:
        """Yield what is known part by part: the patchwork, which times it holds, and its pieces there."""
        if len(self.whole) == len(self.parts):
            return
        for one, chosen in by_piece(self.firsts.searchsorted(piece_of, side="right") - 1):
            part = self.parts[one]
            if isinstance(part, Patchwork):
                yield part, chosen, piece_of[chosen] - self.firsts[one]

    # -- pieces that are stored as a whole, side by side -----------------------------------------------------

    @cached_property
    def whole(self) -> Sequence[Piece]:
        """The pieces that are stored as a whole."""
        return [part for part in self.parts if isinstance(part, Piece)]

    @cached_property
    def numbers(self) -> Indices:
        """The numbers of the pieces that are stored as a whole."""
        is_whole = np.array([isinstance(part, Piece) for part in self.parts], dtype=bool)
        return np.asarray(self.firsts[is_whole])

    @cached_property
    def steps_of_paths(self) -> Blocks:
        """The steps of the paths of the whole pieces, as far as these were kept."""
        return Blocks([piece.path for piece in self.whole if piece.path is not None])

    @cached_property
    def _place(self) -> Indices:
        """The place of each piece among those, -1 where it has none."""
        found = np.full(self.starts.size, -1)
        found[self.numbers] = np.arange(self.numbers.size)
        return found

    def in_whole(self, piece_of: Indices) -> tuple[Indices | slice, Indices]:
        """Return which times pieces hold that are stored as a whole, and the place of each among these."""
        if len(self.whole) == len(self.parts):
            return slice(None), piece_of
        if not self.whole:
            return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
        place = self._place[piece_of]
        chosen = (place >= 0).nonzero()[0]
        return chosen, place[chosen]

    @cached_property
    def _modes(self) -> Modes:
        """Modes of the whole pieces as the equations know them, and those shown, a column each."""
        both = [[piece.modes for piece in self.whole], [piece.labels for piece in self.whole]]
        return np.array(both, dtype=np.int8).reshape(2, len(self.whole), self.system.m).transpose(0, 2, 1)

    @cached_property
    def _since(self) -> Array:
        """Since when rows rest in the whole pieces, in s, a column each."""
        return np.array([piece.since for piece in self.whole]).reshape(len(self.whole), self.system.m).T

    @cached_property
    def _regions(self) -> Regions:
        """The regions of the piecewise-linear functions in the whole pieces, a column each."""
        regions = np.array([piece.regions for piece in self.whole], dtype=np.int16)
        return regions.reshape(len(self.whole), self.system.piecewise.count).T

    @cached_property
    def _held(self) -> tuple[list[Mask], Indices]:
        """All sets of held rows, the empty one first, and the number of the set of each piece."""
        held = (self._modes[0].T == 0) & self.system.hard
        number = {bytes(self.system.m): 0}
        sets = [number.setdefault(row.tobytes(), len(number)) for row in held]
        return [np.frombuffer(key, dtype=bool) for key in number], np.array(sets)

    # -- what is read of all pieces --------------------------------------------------------------------------

    def _read(
        self,
        piece_of: Indices,
        taus: Array,
        of_whole: Callable[[Indices, Array], NDArray[Any]],
        of_part: Callable[[Patchwork, Indices, Array], NDArray[Any]],
    ) -> NDArray[Any]:
        """Return what is read of pieces at local times, a column for each time.

        `of_whole` takes places among the pieces that are stored as a whole and local times, `of_part` a patchwork, its
        pieces and times.
        """
        chosen, own = self.in_whole(piece_of)
        found = [(chosen, of_whole(own, taus[chosen]))] if own.size or not piece_of.size else []
        for part, some, number in self.by_part(piece_of):
            found.append((some, of_part(part, number, part.starts[number] + taus[some])))
        return side_by_side(found, piece_of.size)

    def modes(self, piece_of: Indices, taus: Array, rows: slice = slice(None)) -> tuple[Modes, Modes]:
        """Return at local times of pieces the modes of rows as the equations know them, and those shown."""
        inner, shown = self._read(
            piece_of,
            taus,
            lambda own, taus: self._modes[:, rows].take(own, axis=2),
            lambda part, own, times: part.modes(own, times, rows),
        )
        return inner, shown

    def since_when(self, piece_of: Indices, taus: Array, rows: slice = slice(None)) -> Array:
        """Return since when rows rest at local times of pieces, in s."""
        return self._read(
            piece_of,
            taus,
            lambda own, taus: self._since[rows].take(own, axis=1),
            lambda part, own, times: part.since_when(own, times, rows),
        )

    def regions(self, piece_of: Indices, taus: Array, rows: slice = slice(None)) -> Regions:
        """Return the regions of the piecewise-linear functions of some rows at local times of pieces."""
        return self._read(
            piece_of,
            taus,
            lambda own, taus: self._regions[self.system.piecewise.among(rows)].take(own, axis=1),
            lambda part, own, times: part.regions(own, times, rows),
        )

    def held_forces(self, piece_of: Indices, taus: Array, rows: slice) -> Array:
        """Return the forces of held rows at local times of pieces where these are known row by row, 0 elsewhere."""
        return self._read(
            piece_of,
            taus,
            lambda own, taus: np.zeros((len(range(self.system.m)[rows]), taus.size)),
            lambda part, own, times: part.forces(own, times, rows),
        )

    def evaluated(self, piece_of: Indices, taus: Array, integrated: bool = False) -> Array:
        """Return the polynomials of the steps at local times of pieces, one column each.

        If `integrated`, the velocities are, from the start of each piece.
        """
        size = self.system.n if integrated else self.system.size

        def of_whole(own: Indices, taus: Array) -> Array:
            found = np.empty((size, taus.size))
            for some, path_of, steps in self.steps_of_paths.of(own):
                local = taus[some]
                read = steps.integrals(path_of, local, size) if integrated else steps.values(path_of, local)
                found[:, some] = read.T
            return found

        def of_part(part: Patchwork, own: Indices, times: Array) -> Array:
            if integrated:
                return part.positions(own, times) - part.positions(own, part.starts[own])
            return part.states(own, times)

        return self._read(piece_of, taus, of_whole, of_part)

    def moved(self, piece_of: Indices, taus: Array, bodies: slice = slice(None)) -> Array | None:
        """Return how far bodies have come at local times, None where that is not known by itself."""
        if not self.is_patchwork:
            return None
        firsts, base = self.firsts, np.zeros(self.system.n)[bodies]
        found = np.empty((base.size, taus.size))
        place = firsts.searchsorted(piece_of, side="right") - 1
        for number, part in enumerate(self.parts):
            assert isinstance(part, Patchwork)
            some = (place == number).nonzero()[0]
            own = piece_of[some] - firsts[number]
            begin, end = part.at_ends[:, bodies]
            base = base - begin
            found[:, some] = base[:, None] + part.positions(own, part.starts[own] + taus[some], bodies)
            base = base + end
        return found

    def of_body(self, piece_of: Indices, taus: Array, body: int, integrated: bool = False) -> Array:
        """Return the velocity of one body at local times, or its position where that is a state.

        Only of what is known part by part.
        """
        found, own_body = np.empty(taus.size), slice(body, body + 1)
        for part, some, own in self.by_part(piece_of):
            read = part.positions if integrated else part.velocities
            found[some] = read(own, part.starts[own] + taus[some], own_body)[0]
        return found

    def write_led(self, held: Iterable[tuple[Mask, Indices | slice]], v: Array, drives: Array | None) -> None:
        """Write what depends on others through the rows that hold it, in place.

        `v` are velocities of the bodies, or what follows the same ties, and `drives` the same of the drives; `held`
        tells which sets of rows hold in which columns.
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
        """Yield each set of held rows but the empty one, as the key of its balance, and which times it holds."""
        chosen, own = self.in_whole(piece_of)
        if not own.size:
            return
        sets, number = self._held
        for k, some in by_piece(number[own]):
            if k:
                yield sets[k], some if isinstance(chosen, slice) else chosen[some]

    def inputs(self, piece_of: Indices, taus: Array, y: Array, loads: Array) -> Array:
        """Return all inputs at local times, where loads and states are these, as columns.

        Only of a scene of which some inputs depend on the state.
        """
        dependence, found, t = self.system.dependence, loads.copy(), self.starts[piece_of] + taus
        assert dependence is not None
        if dependence.is_linear:
            dependence.fill(found, y, t, taus, None)
            return found
        for number, chosen in by_piece(piece_of):
            part, motion = found[:, chosen], self.motion(number)
            dependence.fill(part, y[:, chosen], t[chosen], taus[chosen], motion)
            found[:, chosen] = part
        return found

    def loads_at(self, piece_of: Indices, taus: Array, only: slice = slice(None)) -> Array:
        """Return the inputs that loads are at local times, as columns: what depends on the state is left out."""
        if not taus.size:
            return np.empty((len(range(self.system.inputs)[only]), 0))
        starts = self.starts[piece_of]
        if not self.loads.breaks:
            return self.loads.after(self.starts[0]).sampled(starts + taus, only)
        number = np.array(self.loads.breaks).searchsorted(starts, side="right")
        found = []
        for _, chosen in by_piece(number):
            begins = starts[chosen]
            found.append((chosen, self.loads.after(begins[0]).sampled(begins + taus[chosen], only)))
        return side_by_side(found, taus.size)

    def drive_velocities(self, piece_of: Indices, taus: Array) -> Array:
        """Return the velocities of the drives at local times, as columns."""
        drives = slice(self.system.first_drive, self.system.first_acceleration)
        return self.loads_at(piece_of, taus, drives)


def side_by_side(found: Sequence[tuple[Indices | slice, NDArray[T]]], size: int) -> NDArray[T]:
    """Return columns that were read of several parts, each with the places that it takes among so many in all."""
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
    """Return the columns of a table at some times; those of a few are taken in a third of the time of an index."""
    found: NDArray[T] = table[:, chosen] if isinstance(chosen, slice) else table.take(chosen, axis=1)
    return found


def by_piece(piece_of: Indices) -> Iterator[tuple[int, Indices | slice]]:
    """Yield each piece that holds times, and which times it holds."""
    if not piece_of.size:
        return
    order = None if (piece_of[1:] >= piece_of[:-1]).all() else piece_of.argsort(kind="stable")
    counts = np.bincount(piece_of)
    numbers = counts.nonzero()[0]
    first = 0
    for number, last in zip(numbers.tolist(), counts[numbers].cumsum().tolist(), strict=True):
        yield number, slice(first, last) if order is None else order[first:last]
        first = last
