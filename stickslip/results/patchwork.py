"""Motions known part by part: every body and row has its own series, a new one from each event that reached it on.

Nothing is stored for the whole scene at an event, and reading costs only what is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.loads.drives import Drives
from stickslip.equations.loads.sines import Sines
from stickslip.equations.mode_equations import AT_HIGH, AT_LOW, OPEN
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.results.pickled import PickledByFields

T = TypeVar("T", bound=np.generic)

_VALUES_AT_ONCE = 64_000  # they fit into the cache of the processor

# Fields of a patchwork that stand in files under their own names.
_ARRAYS = ("starts", "ticks", "piece_of_tick")

_SHOWN_FACTOR = 10


def packed(mode: Modes, shown: Modes) -> Modes:
    """Return one number for each row: its mode as the equations know it and, if it is open, the mode that it shows.

    The number of an open row is OPEN plus ten times the mode that it shows.
    """
    return np.asarray(np.where(mode == OPEN, OPEN + _SHOWN_FACTOR * shown, mode), dtype=np.int8)


def _unpacked() -> Modes:
    """Return for each number of `packed`, taken without sign, the mode in the equations and the mode shown."""
    found = np.stack(2 * [np.arange(256, dtype=np.uint8).astype(np.int8)])
    for shown in (-1, 0, 1):
        found[:, (OPEN + _SHOWN_FACTOR * shown) % 256] = OPEN, shown
    # a row that carries its level shows rest
    found[1, [AT_HIGH, AT_LOW]] = 0
    return found


_UNPACKED = _unpacked()

_IN_ENTRY = 3  # times of an entry from which the range of its values is taken


class Patches:
    """Collects the series that a run computes: at each tick those of some bodies and rows.

    A tick is a time from which new series hold. `unit` is the time in s by which the series are scaled.
    """

    def __init__(self, system: System, t: float, unit: float, drives: Drives) -> None:
        self._system, self._unit, self._drives = system, unit, drives
        self.starts: list[float] = [t]
        self._ticks: list[float] = []
        self._piece: list[int] = []
        self._bodies: list[tuple[Any, ...]] = []
        self._rows: list[tuple[Any, ...]] = []
        self.entries = 0

    def tick(self, t: float, is_event: bool) -> None:
        """Begin a tick at time `t`; an event begins a piece, too."""
        if is_event:
            self.starts.append(t)
        self._ticks.append(t)
        self._piece.append(len(self.starts) - 1)

    def bodies(self, bodies: Indices, origin: Array, position: Array, velocity: Array, lead: Array) -> None:
        """Enter the series of some bodies; `velocity` may have fewer terms than in other entries."""
        self._bodies.append((len(self._ticks) - 1, bodies, origin, position, lead, velocity))
        self.entries += velocity.size

    def rows(self, rows: Indices, origin: Array, mode: Modes, since: Array, force: Array) -> None:
        """Enter modes of some rows, and series of the forces of those that are held; other series are ignored.

        `since` is the time since when a row rests, but for a gap the number of its region.
        """
        force = np.where(mode[:, None] == 0, force, 0.0)
        self._rows.append((len(self._ticks) - 1, rows, origin, mode, since, force))
        self.entries += force.size

    def until(self, stop: float) -> Patchwork:
        """Return all that was entered as a patchwork that ends at time `stop`."""
        return Patchwork(
            self._system,
            np.array(self.starts),
            stop,
            self._unit,
            self._drives,
            np.array(self._ticks),
            np.array(self._piece),
            SeriesOfMany.of(self._bodies),
            SeriesOfMany.of(self._rows),
        )


@dataclass(frozen=True)
class SeriesOfMany(PickledByFields):
    """Polynomials of many things, which are bodies or rows: those of one thing together and in order of time."""

    # (r,): from which tick on an entry holds, and for which body or row
    tick: Indices
    thing: Indices
    origin: Array  # (r,)
    # (r,): of a body its position and its lead; of a row its mode and when it came to rest, of a gap its region
    first: Array
    second: Array
    terms: Array  # (r, order + 1)

    @classmethod
    def of(cls, entries: list[tuple[Any, ...]]) -> SeriesOfMany:
        """Return entries in order; each one holds the number of a tick, and the other fields for some things."""
        width = max(1, *(entry[-1].shape[1] for entry in entries))
        ticks = np.repeat([entry[0] for entry in entries], [entry[1].size for entry in entries])
        columns = [ticks, *(np.concatenate([entry[k] for entry in entries]) for k in range(1, 5))]
        terms = np.zeros((ticks.size, width))
        at = 0
        for entry in entries:
            part = entry[-1]
            terms[at : at + part.shape[0], : part.shape[1]] = part
            at += part.shape[0]
        order = np.argsort(columns[1], kind="stable")
        tick, thing, origin, first, second = (column[order] for column in columns)
        return cls(tick, thing, origin, first, second, terms[order])

    @cached_property
    def firsts(self) -> Indices:
        """The first entry of each thing, and how many entries there are."""
        return self.thing.searchsorted(np.arange(int(self.thing[-1]) + 2 if self.thing.size else 1))

    def valid(self, ticks: Indices, things: slice) -> ValidEntries:
        """Return which entries of some things hold at some ticks, which are in rising order."""
        first, stop, _ = things.indices(self.firsts.size - 1)
        firsts = self.firsts[first : stop + 1]
        low, high = int(firsts[0]), int(firsts[-1])
        begins = ticks.searchsorted(self.tick[low:high])
        # the first entry of a thing holds from the first tick on, its last one up to the last
        begins[firsts[:-1] - low] = 0
        ends = np.append(begins[1:], ticks.size)
        ends[firsts[1:] - low - 1] = ticks.size
        return ValidEntries(slice(low, high), ends - begins, (stop - first, ticks.size))

    def in_blocks(self, ticks: Indices, things: slice) -> Iterator[tuple[slice, ValidEntries]]:
        """Yield blocks of some things, one at least, and which of their entries hold at some ticks."""
        first, stop, _ = things.indices(self.firsts.size - 1)
        count = _VALUES_AT_ONCE // max(ticks.size, 1) + 1
        for begin in range(first, max(stop, first + 1), count):
            some = slice(begin, min(begin + count, stop))
            yield some, self.valid(ticks, some)

    @cached_property
    def is_bent(self) -> Mask:
        """Which entries are not constant."""
        return np.asarray(self.terms[:, 1:].any(axis=1))

    @cached_property
    def is_moved(self) -> Mask:
        """Which entries have integrals that are not constant."""
        return np.asarray(self.is_bent | (self.terms[:, 0] != 0))

    def values(self, valid: ValidEntries, t: Array, unit: float, integrated: bool = False) -> Array:
        """Return the values of entries at times, or their integrals, which begin with `first`.

        The times have the shape of `valid`, or are one line that holds for each of its things.
        """
        own, counts = valid.entries, valid.counts
        begin, bent = (self.first, self.is_moved) if integrated else (self.terms[:, 0], self.is_bent)
        begin, bent = begin[own], bent[own] & (counts > 0)
        found = begin.repeat(counts)
        if not bent.any():
            return found.reshape(valid.shape)
        places: slice | Indices = slice(None)
        if not bent.all():
            places = bent.repeat(counts).nonzero()[0]
            own = bent.nonzero()[0] + own.start if isinstance(own, slice) else own[bent]
            begin, counts = begin[bent], counts[bent]
        orders = np.ascontiguousarray(self.terms[own].T)
        if integrated:
            factors = unit / np.arange(1, orders.shape[0] + 1)
            orders = np.concatenate([begin[None], orders * factors[:, None]])
        s = valid.of_all(t)[places]
        s -= self.origin[own].repeat(counts)
        s /= unit
        value = orders[-1].repeat(counts)
        for order in orders[-2::-1]:
            value *= s
            value += order.repeat(counts)
        found[places] = value
        return found.reshape(valid.shape)


@dataclass(frozen=True)
class ValidEntries:
    """Which entries of series hold at some times, one thing after the other."""

    entries: slice | Indices  # the entries of these things
    counts: Indices  # at how many times in a row each of them holds
    shape: tuple[int, int]  # how many things and times there are

    def spread(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return at each time the value of the entry that holds then, a line for each thing."""
        return values[self.entries].repeat(self.counts).reshape(self.shape)

    def of_all(self, t: Array) -> Array:
        """Return times, given in the full shape or as one line that holds for each thing, as one flat array."""
        found = np.empty(self.shape)
        found[:] = t
        return found.ravel()


def _largest_over(first: Indices, last: Indices, values: Array, size: int) -> Array:
    """Return for each of `size` places the largest value of the ranges from `first` to `last` that hold it, or 0."""
    found = np.zeros(size)
    if not first.size:
        return found
    # each range is covered by two that overlap and have a power of 2 as length; each of these by two of half its length
    powers = np.log2(last - first).astype(np.intp)
    begins, values = np.append(first, last - (1 << powers)), np.append(values, values)
    both = np.append(powers, powers)
    for power in range(int(powers.max()), -1, -1):
        length = 1 << power
        np.maximum(found[length:], found[:-length].copy(), out=found[length:])
        own = both == power
        np.maximum.at(found, begins[own], values[own])
    return found


@dataclass(frozen=True)
class Patchwork(PickledByFields):
    """A motion without breaks of the loads inside, with all its events."""

    system: System = field(repr=False)
    starts: Array  # (p,): when each piece begins: the start, and every event
    stop: float
    unit: float
    drives: Drives = field(repr=False)
    ticks: Array = field(repr=False)
    piece_of_tick: Indices = field(repr=False)
    bodies: SeriesOfMany = field(repr=False)
    rows: SeriesOfMany = field(repr=False)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Return all but the scene as arrays."""
        found: dict[str, NDArray[Any]] = {name: getattr(self, name) for name in _ARRAYS}
        drives = self.drives
        found["about"] = np.array([self.stop, self.unit, drives.since])
        found["drive positions"], found["drive velocities"] = drives.start, drives.velocity
        found["swinging drives"], found["sines of drives"] = drives.sines.entry, drives.sines.numbers
        for name, series in (("bodies", self.bodies), ("rows", self.rows)):
            found |= {f"{name} {one.name}": getattr(series, one.name) for one in fields(series)}
        return found

    @classmethod
    def from_arrays(cls, system: System, arrays: dict[str, NDArray[Any]]) -> Patchwork:
        """Return the patchwork from which `to_arrays` made these."""
        stop, unit, since = arrays["about"].tolist()
        bodies, rows = (
            SeriesOfMany(**{one.name: arrays[f"{kind} {one.name}"] for one in fields(SeriesOfMany)})
            for kind in ("bodies", "rows")
        )
        own: dict[str, Any] = {name: arrays[name] for name in _ARRAYS}
        sines = Sines(arrays["swinging drives"], *arrays["sines of drives"])
        drives = Drives(arrays["drive positions"], arrays["drive velocities"], since, sines)
        return cls(system, stop=stop, unit=unit, drives=drives, bodies=bodies, rows=rows, **own)

    @cached_property
    def stops(self) -> Array:
        """End of each piece in s."""
        return np.append(self.starts[1:], self.stop)

    @cached_property
    def durations(self) -> Array:
        """How long each piece lasts, in s."""
        return self.stops - self.starts

    def times(self, piece: Indices, taus: Array) -> Array:
        """Return the times at which a patchwork is read for local times of pieces: times of the whole motion."""
        return self.starts[piece] + taus

    def _ticks(self, piece: Indices, t: Array) -> Indices:
        """Return the tick that holds at times of pieces."""
        by_time = self.ticks.searchsorted(t, side="right")
        by_piece = self.piece_of_tick.searchsorted(piece, side="right")
        first = self.piece_of_tick.searchsorted(piece, side="left")
        return np.asarray(np.maximum(np.minimum(by_time, by_piece) - 1, first))

    def _in_order(self, piece: Indices, t: Array) -> tuple[Indices, Array, Indices | slice]:
        """Return the ticks at times of pieces and these times, both sorted by tick, and where each given one stands."""
        ticks = self._ticks(piece, t)
        if (ticks[1:] >= ticks[:-1]).all():
            return ticks, t, slice(None)
        order = np.argsort(ticks, kind="stable")
        return ticks[order], t[order], np.argsort(order)

    def _read(
        self,
        series: SeriesOfMany,
        piece: Indices,
        t: Array,
        things: slice,
        read: Callable[[ValidEntries, Array], NDArray[T]],
    ) -> NDArray[T]:
        """Return what `read` finds for some things at times of pieces, a line each; the times may be in any order."""
        ticks, t, back = self._in_order(piece, t)
        blocks = [read(valid, t) for _, valid in series.in_blocks(ticks, things)]
        found = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
        return found[:, back]

    def states(self, piece: Indices, t: Array) -> Array:
        """Return the states at times of pieces, a column each."""
        system, n = self.system, self.system.n
        ticks, t, back = self._in_order(piece, t)
        y = np.empty((system.size, t.size))
        for bodies, valid in self.bodies.in_blocks(ticks, slice(None)):
            y[bodies] = self._velocity(valid, t)
            first, stop = system.moved.searchsorted((bodies.start, bodies.stop))
            if stop > first:
                x = self._position(valid, t)
                y[n + first : n + stop] = x[system.moved[first:stop] - bodies.start]
        y[system.carried_state] = self.drives.positions(system.carried, t)
        return y[:, back]

    def velocities(self, piece: Indices, t: Array, bodies: slice = slice(None)) -> Array:
        """Return velocities of bodies at times of pieces; bodies that a drive leads have its velocity, to the bit."""
        return self._read(self.bodies, piece, t, bodies, self._velocity)

    def _velocity(self, valid: ValidEntries, t: Array) -> Array:
        v, lead = self.bodies.values(valid, t, self.unit), self.bodies.second[valid.entries]
        is_led = lead >= 0
        if is_led.any():
            places = is_led.repeat(valid.counts).nonzero()[0]
            drives = lead[is_led].astype(np.intp).repeat(valid.counts[is_led])
            v.ravel()[places] = self.drives.velocities(drives, valid.of_all(t)[places])
        return v

    def positions(self, piece: Indices, t: Array, bodies: slice = slice(None)) -> Array:
        """Return positions of bodies at times of pieces."""
        return self._read(self.bodies, piece, t, bodies, self._position)

    def distances(self, piece: Indices, t: Array) -> Array:
        """Return how far the bodies have come since the starts of pieces, a column each."""
        return self.positions(piece, t) - self.positions(piece, self.starts[piece])

    def _position(self, valid: ValidEntries, t: Array) -> Array:
        return self.bodies.values(valid, t, self.unit, integrated=True)

    @cached_property
    def at_ends(self) -> Array:
        """Positions of the bodies at the start and at the end, a line each."""
        firsts, n = self.bodies.firsts, self.system.n
        entries = np.stack([firsts[:-1], firsts[1:] - 1], axis=1).ravel()
        ends = ValidEntries(entries, np.ones(entries.size, dtype=np.intp), (n, 2))
        return self._position(ends, np.array([self.starts[0], self.stop])).T

    def modes(self, piece: Indices, t: Array, rows: slice = slice(None)) -> Modes:
        """Return modes of rows at times of pieces as the equations know them, and modes that they show: (2, m, k)."""
        inner = self._read(self.rows, piece, t, rows, lambda valid, _: valid.spread(self.rows.first))
        found: Modes = _UNPACKED[:, inner.astype(np.uint8)]
        functions = self.system.piecewise
        if functions.count:
            own = functions.among(rows)
            places = functions.first[own, None] + self.regions(piece, t, rows)
            found[1, functions.row[own] - (rows.start or 0)] = functions.mode[places]
        return found

    def regions(self, piece: Indices, t: Array, rows: slice = slice(None)) -> Regions:
        """Return the regions of the gaps among some rows at times of pieces, a line each."""
        functions = self.system.piecewise
        own = functions.row[functions.among(rows)] - (rows.start or 0)
        told = self._read(self.rows, piece, t, rows, lambda valid, _: valid.spread(self.rows.second))
        return told[own].astype(np.int16)

    def since_when(self, piece: Indices, t: Array, rows: slice = slice(None)) -> Array:
        """Return since when rows rest at times of pieces, in s; for gaps the numbers of their regions."""
        return self._read(self.rows, piece, t, rows, lambda valid, _: valid.spread(self.rows.second))

    def forces(self, piece: Indices, t: Array, rows: slice = slice(None)) -> Array:
        """Return the forces of rows at times of pieces where they are held, 0 elsewhere."""
        return self._read(self.rows, piece, t, rows, lambda valid, t: self.rows.values(valid, t, self.unit))

    # -- ranges and second derivatives -----------------------------------------------------------------------

    @cached_property
    def steps(self) -> tuple[Array, Indices]:
        """The times at which steps begin, and the piece of each: all ticks, of several at one time only the first."""
        t, piece = self.ticks, self.piece_of_tick
        is_new = np.append(True, (t[1:] > t[:-1]) | (piece[1:] > piece[:-1]))
        return t[is_new], piece[is_new]

    @cached_property
    def _lasts(self) -> Array:
        """Until when each entry of a body holds."""
        lasts = np.append(self.ticks[self.bodies.tick[1:]], self.stop)
        lasts[self.bodies.firsts[1:] - 1] = self.stop
        return lasts

    @property
    def ranges(self) -> tuple[Array, Array]:
        """The least and the largest velocities and positions of all bodies: two arrays (2, n)."""
        return self._course[:2]

    @cached_property
    def _course(self) -> tuple[Array, Array, Array]:
        """The ranges of velocities and positions of the bodies, and bounds of ``|v'|`` and ``|v''|`` of each entry.

        ``|v'| <= sum k |c_k| s^(k-1)``, and ``|v''|`` is at most the derivative of that.
        """
        series, last = self.bodies, self._lasts
        begins = self.ticks[series.tick]
        t = begins + np.arange(_IN_ENTRY)[:, None] / (_IN_ENTRY - 1) * (last - begins)
        s, longest = (t - series.origin) / self.unit, np.abs(last - series.origin) / self.unit
        found, bounds = np.zeros((2, *s.shape)), np.zeros((2, last.size))
        for k in range(series.terms.shape[1] - 1, -1, -1):
            c = series.terms[:, k]
            found *= s
            found[0] += c
            found[1] += c / (k + 1)
            if k:
                bounds[1] *= longest
                bounds[1] += bounds[0]
                bounds[0] *= longest
                bounds[0] += k * np.abs(c)
        found[1] *= s * self.unit
        found[1] += series.first
        starts = series.firsts[:-1]
        low = np.minimum.reduceat(found.min(axis=1), starts, axis=1)
        high = np.maximum.reduceat(found.max(axis=1), starts, axis=1)
        return low, high, bounds / [[self.unit], [self.unit**2]]

    def worst(self, speed: Array, distance: Array) -> Array:
        """Return for each step, scaled to length 1, the largest second derivative as a part of the one allowed.

        `speed` and `distance` are those allowed for the velocity and the position of each body.
        """
        series, (begins, _) = self.bodies, self.steps
        bend = (self._course[2] / [distance[series.thing], speed[series.thing]]).max(axis=0)
        bent = bend.nonzero()[0]
        first = begins.searchsorted(self.ticks[series.tick[bent]])
        last = np.maximum(begins.searchsorted(self._lasts[bent]), first + 1)
        h = np.append(begins[1:], self.stop) - begins
        return _largest_over(first, last, bend[bent], begins.size) * h * h

    # -- piece by piece --------------------------------------------------------------------------------------

    def ends(self, k: int) -> Array:
        """Return the times at which steps of a piece end, its start among them."""
        own = slice(*np.searchsorted(self.piece_of_tick, [k, k + 1]))
        ticks = self.ticks[own]
        stop = self.starts[k + 1] if k + 1 < self.starts.size else self.stop
        inner = ticks[(ticks > self.starts[k]) & (ticks < stop)]
        return np.concatenate([[self.starts[k]], np.unique(inner), [stop]])
