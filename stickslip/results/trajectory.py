"""The motion between events, piece by piece: small data from which every quantity can be computed at any time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TypeVar, overload

import numpy as np

from stickslip.equations.loads import Loads
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, values
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Modes
from stickslip.model.checks import every_digit
from stickslip.results.patchwork import Patchwork
from stickslip.results.pickled import PickledByFields

T = TypeVar("T")

_AT_ONCE = 2_000_000
"""Coefficients that are put together at once."""


@dataclass(frozen=True)
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
    def end(self) -> float:
        """Local time in s of the end."""
        return self.stop - self.t if self.path is None else float(self.path.taus[-1])

    @classmethod
    def of(cls, patchwork: Patchwork, k: int, path: Path | None) -> Piece:
        """Return a piece of what is known part by part."""
        at, t = np.array([k]), patchwork.starts[k : k + 1]
        inner, shown = patchwork.modes(at, t)
        since = patchwork.since_when(at, t)
        y = patchwork.states(at, t)[:, 0]
        none = np.empty(0, dtype=np.int16)
        stop = float(patchwork.stops[k])
        return cls(float(t[0]), stop, y, inner[:, 0], shown[:, 0], since[:, 0], none, None, None, path)


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


@dataclass(frozen=True)
class Trajectory(PickledByFields):
    """All pieces of a simulated motion, in order of time."""

    system: System = field(repr=False)
    # start and end in s of the loads, and whether a fixed-step method read them
    span: tuple[float, float, bool]
    pieces: Sequence[Piece] = field(repr=False)

    @cached_property
    def loads(self) -> Loads:
        """The inputs over the time span."""
        return self.system.loads(*self.span)

    @cached_property
    def starts(self) -> Array:
        """Start of each piece in s."""
        return self._joined(lambda piece: piece.t, lambda part: part.starts)

    @cached_property
    def stops(self) -> Array:
        """End of each piece in s."""
        return self._joined(lambda piece: piece.stop, lambda part: part.stops)

    @property
    def parts(self) -> Sequence[Piece | Patchwork]:
        """What is stored, in order."""
        return self.pieces.parts if isinstance(self.pieces, Pieces) else self.pieces

    def _joined(self, of_piece: Callable[[Piece], float], of_part: Callable[[Patchwork], Array]) -> Array:
        found = [np.array([of_piece(x)]) if isinstance(x, Piece) else of_part(x) for x in self.parts]
        return np.concatenate([np.empty(0), *found])

    @cached_property
    def is_patchwork(self) -> bool:
        """Whether all of it is known part by part."""
        return bool(self.parts) and all(isinstance(part, Patchwork) for part in self.parts)

    @cached_property
    def is_dense(self) -> bool:
        """Whether the states are known at all times."""
        parts = self.parts
        return bool(parts) and all(isinstance(x, Patchwork) or x.path is not None for x in parts)

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
        return np.clip(times - self.starts[piece_of], 0.0, self.ends[piece_of])

    def order(self, number: int) -> int:
        """Return the degree of the polynomials of a piece."""
        part, _ = self.part(number)
        if isinstance(part, Patchwork):
            return int(part.bodies.terms.shape[1])
        path = part.path
        return 0 if path is None or not path.taus[1:].size else path.coefficients.shape[1] - 1

    @cached_property
    def ends(self) -> Array:
        """Local time in s of the end of each piece."""
        return self._joined(lambda piece: piece.end, lambda part: part.stops - part.starts)

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
        if isinstance(self.pieces, Pieces):
            firsts = self.pieces.firsts
            for one, chosen in by_piece(np.searchsorted(firsts, piece_of, side="right") - 1):
                part = self.pieces.parts[one]
                if isinstance(part, Patchwork):
                    yield part, chosen, piece_of[chosen] - firsts[one]

    def whole(self, piece_of: Indices) -> Iterator[tuple[int, Indices | slice]]:
        """Yield each piece that is stored as a whole and holds times, and which times."""
        if not self.is_patchwork:
            for number, chosen in by_piece(piece_of):
                if isinstance(self.part(number)[0], Piece):
                    yield number, chosen

    def modes(self, piece_of: Indices, taus: Array, rows: slice = slice(None)) -> tuple[Modes, Modes]:
        """Return at local times of pieces the modes of rows as the equations know them, and those shown."""
        inner, shown = np.empty((2, *self._shape(rows, taus)), dtype=np.int8)
        for number, chosen in self.whole(piece_of):
            piece = self.pieces[number]
            inner[:, chosen], shown[:, chosen] = piece.modes[rows, None], piece.labels[rows, None]
        for part, some, own in self.by_part(piece_of):
            inner[:, some], shown[:, some] = part.modes(own, part.starts[own] + taus[some], rows)
        return inner, shown

    def since_when(self, piece_of: Indices, taus: Array, rows: slice = slice(None)) -> Array:
        """Return since when rows rest at local times of pieces, in s."""
        found = np.empty(self._shape(rows, taus))
        for number, chosen in self.whole(piece_of):
            found[:, chosen] = self.pieces[number].since[rows, None]
        for part, some, own in self.by_part(piece_of):
            found[:, some] = part.since_when(own, part.starts[own] + taus[some], rows)
        return found

    def _shape(self, rows: slice, taus: Array) -> tuple[int, int]:
        return len(range(self.system.m)[rows]), taus.size

    def states(self, piece_of: Indices, taus: Array) -> Array:
        """Return the states at local times of pieces, one column each.

        Velocities of held bodies are written through the ties that hold them: equal velocities are equal to the bit.
        """
        found = self.evaluated(piece_of, taus)
        self._tie(piece_of, taus, found)
        return found

    def evaluated(self, piece_of: Indices, taus: Array, integrated: bool = False) -> Array:
        """Return the polynomials of the steps at local times of pieces, one column each.

        If `integrated`, the velocities are, from the start of each piece.
        """
        found = np.empty((self.system.n if integrated else self.system.size, taus.size))
        for part, some, own in self.by_part(piece_of):
            times, begins = part.starts[own] + taus[some], part.starts[own]
            found[:, some] = (
                part.positions(own, times) - part.positions(own, begins)
                if integrated
                else part.states(own, times)
            )
        paths = ((self.pieces[number].path, chosen) for number, chosen in self.whole(piece_of))
        for block in alike(paths):
            _evaluate(block, taus, found, integrated)
        return found

    def moved(self, piece_of: Indices, taus: Array, bodies: slice = slice(None)) -> Array | None:
        """Return how far bodies have come at local times, None where that is not known by itself."""
        if not isinstance(self.pieces, Pieces) or not self.is_patchwork:
            return None
        firsts, base = self.pieces.firsts, np.zeros(self.system.n)[bodies]
        found = np.empty((base.size, taus.size))
        place = np.searchsorted(firsts, piece_of, side="right") - 1
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

        `v` are velocities of the bodies, or what follows the same ties, and `drives` the same of the drives; `held`
        tells which sets of rows hold in which columns.
        """
        for key, chosen in held:
            balance = self.system.balance(key)
            if not balance.dependent.size:
                continue
            led = balance.led_by_bodies @ v[:, chosen]
            if drives is not None:
                led = led + balance.led_by_drives @ drives[:, chosen]
            if isinstance(chosen, slice):
                v[balance.dependent, chosen] = led
            else:
                v[balance.dependent[:, None], chosen] = led

    def by_held(self, piece_of: Indices) -> Iterator[tuple[bytes, Indices | slice]]:
        """Yield each set of held rows but the empty one, as the key of its balance, and which times it holds."""
        groups: dict[bytes, list[Indices | slice]] = {}
        for number, chosen in self.whole(piece_of):
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

    def loads_at(self, piece_of: Indices, taus: Array, only: slice = slice(None)) -> Array:
        """Return the inputs that loads are at local times, as columns: what depends on the state is left out."""
        number = np.searchsorted(self.loads.breaks, self.starts[piece_of], side="right")
        found = np.empty((len(range(self.system.inputs)[only]), taus.size))
        for _, chosen in by_piece(number):
            pieces = piece_of[chosen]
            stretch = self.loads.after(self.starts[pieces[0]])
            found[:, chosen] = stretch.sampled(self.starts[pieces] + taus[chosen], only)
        return found


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


def alike(paths: Iterable[tuple[Path | None, T]]) -> Iterator[list[tuple[Path, T]]]:
    """Yield paths that are evaluated together, with what belongs to each: of the same kind, not too many at once."""
    blocks: dict[tuple[int, bool], list[tuple[Path, T]]] = {}
    entries: dict[tuple[int, bool], int] = {}
    for path, own in paths:
        assert path is not None
        kind = kind_of(path)
        blocks.setdefault(kind, []).append((path, own))
        entries[kind] = entries.get(kind, 0) + path.coefficients.size
        if entries[kind] > _AT_ONCE:
            yield blocks.pop(kind)
            entries[kind] = 0
    yield from blocks.values()


def _evaluate(block: list[tuple[Path, Indices | slice]], taus: Array, out: Array, integrated: bool) -> None:
    """Write the states of paths of the same kind at local times, or integrals, all polynomials at once."""
    terms, is_chebyshev = kind_of(block[0][0])
    if not terms:
        for path, chosen in block:
            out[:, chosen] = 0.0 if integrated else path.last[:, None]
        return
    local = [taus[chosen] for _, chosen in block]
    path_of = np.repeat(np.arange(len(block)), [own.size for own in local])
    t, ends = np.concatenate(local), np.concatenate([path.taus for path, _ in block])
    firsts = np.cumsum([0, *(path.taus.size for path, _ in block)])
    lasts = firsts[1:] - 1
    passed = [path.taus.searchsorted(own, "right") for (path, _), own in zip(block, local, strict=True)]
    begin = np.minimum(firsts[path_of] + np.concatenate(passed), lasts[path_of]) - 1
    h = ends[begin + 1] - ends[begin]
    s = np.divide(t - ends[begin], h, out=np.zeros(t.size), where=h > 0)
    # each path has one end more than steps
    step = begin - path_of
    coefficients = np.concatenate([path.coefficients[:, :, : out.shape[0]] for path, _ in block])
    found = values(coefficients, step, s, is_chebyshev, integrated)
    if integrated:
        lengths = np.delete(np.diff(ends), lasts[:-1])[:, None]
        every = np.arange(lengths.size)
        whole = lengths * values(coefficients, every, np.ones(every.size), is_chebyshev, integrated)
        before = np.cumsum(whole, axis=0) - whole
        found = before[step] - before[firsts[path_of] - path_of] + h[:, None] * found
    else:
        at_end = (t >= ends[lasts[path_of]]).nonzero()[0]
        found[at_end] = np.array([path.last for path, _ in block])[path_of[at_end]]
    for (_, chosen), own in zip(block, np.split(found, np.cumsum([own.size for own in local])), strict=False):
        out[:, chosen] = own.T
