"""Motions known part by part: for every body and row the series that hold from each event that reached it on.

To read them costs what is read: nothing is stored for the whole scene at an event.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.mode_equations import OPEN
from stickslip.equations.path import Path
from stickslip.equations.polynomials import shifted
from stickslip.equations.system import System

__all__ = ["Patches", "Patchwork", "Series"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Modes = NDArray[np.int8]

_AT_ONCE = 40_000
_DEGREES = (3, 6, 10, 15)
"""Polynomials up to these degrees are evaluated together."""

_IN_COLUMN = 8
"""Times at which one polynomial is evaluated at once."""

_NOTHING = 1e-18


class Patches:
    """Collects what a run expands: at each tick some bodies and rows.

    Parameters
    ----------
    system : System
    t : float
        Start in s.
    unit : float
        Time in s by which the series are scaled.
    labels : array (m,)
        Modes that the rows show at the start: open ones keep theirs.
    drives : (array (d,), array (d, 2))
        Positions, and velocities and accelerations, of the drives at the start `since`.
    since : float
    """

    def __init__(
        self, system: System, t: float, unit: float, labels: Modes, drives: tuple[Array, Array], since: float
    ) -> None:
        self._system, self._unit, self._labels = system, unit, labels.copy()
        self._drives, self._since = drives, since
        self.starts: list[float] = [t]
        self._ticks: list[float] = []
        self._piece: list[int] = []
        self._bodies: list[tuple[Any, ...]] = []
        self._rows: list[tuple[Any, ...]] = []
        self.entries = 0

    def tick(self, t: float, is_event: bool) -> None:
        """Begin what changes at time `t`."""
        if is_event:
            self.starts.append(t)
        self._ticks.append(t)
        self._piece.append(len(self.starts) - 1)

    def bodies(self, bodies: Indices, origin: Array, position: Array, velocity: Array, lead: Array) -> None:
        """Enter the series of some bodies; the rows of `velocity` may have fewer terms than others."""
        self._bodies.append(
            (np.full(bodies.size, len(self._ticks) - 1), bodies, origin, position, lead, velocity)
        )
        self.entries += velocity.size

    def rows(self, rows: Indices, origin: Array, mode: Modes, since: Array, force: Array) -> None:
        """Enter modes of some rows, and series of the forces of those that are held."""
        self._rows.append((np.full(rows.size, len(self._ticks) - 1), rows, origin, mode, since, force))
        self.entries += force.size

    def until(self, stop: float) -> Patchwork:
        """Return all, up to time `stop`."""
        return Patchwork(
            self._system,
            np.array(self.starts),
            stop,
            self._unit,
            self._labels,
            self._drives,
            self._since,
            np.array(self._ticks),
            np.array(self._piece),
            Series.of(self._bodies),
            Series.of(self._rows),
        )


@dataclass(frozen=True)
class Series:
    """Polynomials of many things, those of one thing together and in order of time.

    Attributes
    ----------
    tick, thing : array (r,) of int
        From which tick on an entry holds, and for which body or row.
    origin : array (r,)
    first, second : array (r,)
        Position and lead of a body; mode and start of rest of a row.
    terms : array (r, order + 1)
    """

    tick: Indices
    thing: Indices
    origin: Array
    first: Array
    second: Array
    terms: Array

    @classmethod
    def of(cls, entries: list[tuple[Any, ...]]) -> Series:
        """Return entries in order."""
        width = max((entry[-1].shape[1] for entry in entries), default=0)
        columns = [np.concatenate([entry[k] for entry in entries]) for k in range(5)]
        terms = np.zeros((columns[0].size, width))
        at = 0
        for entry in entries:
            part = entry[-1]
            terms[at : at + part.shape[0], : part.shape[1]] = part
            at += part.shape[0]
        order = np.argsort(columns[1], kind="stable")
        tick, thing, origin, first, second = (column[order] for column in columns)
        return cls(tick, thing, origin, first, second, terms[order])

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what follows from the rest."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)

    @cached_property
    def degree(self) -> Indices:
        """The highest power of each entry that is not 0."""
        some = self.terms != 0
        return np.where(some.any(axis=1), self.terms.shape[1] - 1 - some[:, ::-1].argmax(axis=1), 0)

    def entries(self, ticks: Indices, things: slice | int) -> Indices:
        """Return the entries that hold at some ticks (in order), a line for each thing (all, or one)."""
        if not self.thing.size:
            return np.zeros((0, ticks.size), dtype=np.intp)
        if isinstance(things, slice):
            last = np.append(self.thing[1:] != self.thing[:-1], True)
            begin = np.searchsorted(ticks, self.tick)
            stop = np.where(last, ticks.size, np.append(begin[1:], 0))
            begin[np.append(True, last[:-1])] = 0
            return np.repeat(np.arange(self.tick.size), stop - begin).reshape(-1, ticks.size)
        low, high = np.searchsorted(self.thing, [things, things + 1])
        found: Indices = low + np.searchsorted(self.tick[low:high], ticks, side="right") - 1
        return found

    def values(self, entry: Indices, t: Array, unit: float) -> Array:
        """Return the values of entries (a line for each thing) at times."""
        found: Array = self._values(entry, t, unit, (False,))[0]
        return found

    def integrals(self, entry: Indices, t: Array, unit: float) -> Array:
        """Return the integrals of entries from their origins, and what they begin with."""
        return np.asarray(self._values(entry, t, unit, (True,))[0] + self.first[entry])

    def both(self, entry: Indices, t: Array, unit: float) -> tuple[Array, Array]:
        """Return the values of entries, and their integrals."""
        values, moved = self._values(entry, t, unit, (False, True))
        return values, moved + self.first[entry]

    def _values(self, entry: Indices, t: Array, unit: float, integrated: Sequence[bool]) -> Array:
        found = np.zeros((len(integrated), entry.size))
        flat, t = entry.ravel(), np.broadcast_to(t, entry.shape).ravel()
        for some in _at_once(flat.size if self.terms.shape[1] else 0):
            place, own, run = _columns(flat[some])
            s = (t[some][place] - self.origin[own][run]) / unit
            for part, is_integral in zip(found[:, some], integrated, strict=True):
                terms = self.terms[own]
                if is_integral:
                    terms *= unit / np.arange(1, terms.shape[1] + 1)
                value = _polynomials(terms, run, s)
                part[place] = value * s if is_integral else value
        return found.reshape(-1, *entry.shape)


def _in_order(ticks: Indices) -> Indices | slice:
    """Return in which order ticks follow each other: they mostly do."""
    return slice(None) if (ticks[1:] >= ticks[:-1]).all() else np.argsort(ticks, kind="stable")


def _largest_over(first: Indices, last: Indices, values: Array, size: int) -> Array:
    """Return for each of `size` places the largest value of the ranges from `first` to `last` that hold it, or 0."""
    found = np.zeros(size)
    if not first.size:
        return found
    # a range is two of a power of 2 that overlap; each of these is two of half its length
    powers = np.log2(last - first).astype(np.intp)
    for power in range(int(powers.max()), -1, -1):
        length = 1 << power
        np.maximum(found[length:], found[:-length].copy(), out=found[length:])
        own = powers == power
        np.maximum.at(found, first[own], values[own])
        np.maximum.at(found, last[own] - length, values[own])
    return found


def _at_once(count: int) -> Iterator[slice]:
    """Yield so many things in slices, not too many at once."""
    for first in range(0, count, _AT_ONCE):
        yield slice(first, min(first + _AT_ONCE, count))


def _columns(entry: Indices) -> tuple[Indices, Indices, Indices]:
    """Return the places of equal neighbours, some at once in a column; the entries of runs, and each column's run.

    Times that follow each other read the same entry. The last place of a run fills its last column.
    """
    starts = np.append(True, entry[1:] != entry[:-1]).nonzero()[0]
    ends = np.append(starts[1:], entry.size)
    count = -(-(ends - starts) // _IN_COLUMN)
    run = np.repeat(np.arange(starts.size), count)
    first = starts[run] + _IN_COLUMN * (np.arange(run.size) - np.repeat(np.cumsum(count) - count, count))
    place = np.minimum(first + np.arange(_IN_COLUMN)[:, None], ends[run] - 1)
    return place, entry[starts], run


def _polynomials(terms: Array, run: Indices, s: Array) -> Array:
    """Return the values of polynomials (a line each, for runs of columns of `s`) by Horner's scheme."""
    firsts = np.append(True, run[1:] > run[:-1]).nonzero()[0]
    degree = _degrees(terms, np.maximum.reduceat(np.abs(s).max(axis=0), firsts))[run]
    powers = np.ascontiguousarray(terms.T)[:, run]
    found = np.broadcast_to(powers[0], s.shape).copy()
    low, most = 1, terms.shape[1] - 1
    for high in (*(k for k in _DEGREES if k < most), most):
        some = ((degree >= low) & (degree <= high)).nonzero()[0]
        low = high + 1
        if not some.size:
            continue
        own, x = powers[: high + 1, some], s[:, some]
        value = own[high] * x
        for k in range(high - 1, 0, -1):
            value += own[k]
            value *= x
        found[:, some] += value
    return found


def _degrees(terms: Array, reach: Array) -> Indices:
    """Return for polynomials (a line each) the highest power that counts up to so far from 0."""
    size = np.empty_like(terms)
    size[:, 0], size[:, 1:] = 1.0, reach[:, None]
    np.multiply.accumulate(size, axis=1, out=size)
    size *= np.abs(terms)
    counts = size > _NOTHING * size.max(axis=1, keepdims=True)
    highest = terms.shape[1] - 1 - counts[:, ::-1].argmax(axis=1)
    return np.asarray(np.where(counts.any(axis=1), highest, 0))


@dataclass(frozen=True)
class Patchwork:
    """A motion between two breaks of the loads, with all its events.

    Attributes
    ----------
    starts : array (p,)
        When each piece begins: the start, and every event.
    stop : float
    """

    system: System = field(repr=False)
    starts: Array
    stop: float
    unit: float
    labels: Modes = field(repr=False)
    drives: tuple[Array, Array] = field(repr=False)
    since: float
    ticks: Array = field(repr=False)
    piece_of_tick: Indices = field(repr=False)
    bodies: Series = field(repr=False)
    rows: Series = field(repr=False)

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what follows from the rest."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """Return all but the scene as arrays."""
        found: dict[str, NDArray[Any]] = {
            "starts": self.starts,
            "about": np.array([self.stop, self.unit, self.since]),
            "labels": self.labels,
            "drive positions": self.drives[0],
            "drive velocities": self.drives[1],
            "ticks": self.ticks,
            "piece_of_tick": self.piece_of_tick,
        }
        for name, series in (("bodies", self.bodies), ("rows", self.rows)):
            found |= {f"{name} {one.name}": getattr(series, one.name) for one in fields(series)}
        return found

    @classmethod
    def from_arrays(cls, system: System, arrays: dict[str, NDArray[Any]]) -> Patchwork:
        """Return what `to_arrays` wrote."""
        stop, unit, since = arrays["about"].tolist()
        bodies, rows = (
            Series(**{one.name: arrays[f"{kind} {one.name}"] for one in fields(Series)})
            for kind in ("bodies", "rows")
        )
        return cls(
            system=system,
            starts=arrays["starts"],
            stop=stop,
            unit=unit,
            labels=arrays["labels"],
            drives=(arrays["drive positions"], arrays["drive velocities"]),
            since=since,
            ticks=arrays["ticks"],
            piece_of_tick=arrays["piece_of_tick"],
            bodies=bodies,
            rows=rows,
        )

    @property
    def stops(self) -> Array:
        """End of each piece in s."""
        return np.append(self.starts[1:], self.stop)

    def _ticks(self, piece: Indices, t: Array) -> Indices:
        """Return the tick that holds at times of pieces."""
        by_time = np.searchsorted(self.ticks, t, side="right")
        by_piece = np.searchsorted(self.piece_of_tick, piece, side="right")
        first = np.searchsorted(self.piece_of_tick, piece, side="left")
        return np.asarray(np.maximum(np.minimum(by_time, by_piece) - 1, first))

    def states(self, piece: Indices, t: Array) -> Array:
        """Return the states at times of pieces, a column each."""
        system = self.system
        ticks = self._ticks(piece, t)
        order = _in_order(ticks)
        y = np.empty((system.size, t.size))
        t = t[order]
        entry = self.bodies.entries(ticks[order], slice(None))
        if not system.placed.size:
            y[: system.n] = self._led(self.bodies.values(entry, t, self.unit), entry, t)
        else:
            velocities, places = self.bodies.both(entry, t, self.unit)
            y[: system.n] = self._led(velocities, entry, t)
            y[system.moved_state] = places[system.moved]
            u = self.drives[1][system.carried]
            d = t - self.since
            y[system.carried_state] = self.drives[0][system.carried, None] + d * (
                u[:, :1] + 0.5 * d * u[:, 1:]
            )
        if isinstance(order, slice):
            return y
        found = np.empty_like(y)
        found[:, order] = y
        return found

    def of_body(self, piece: Indices, t: Array, body: int, integrated: bool) -> Array:
        """Return the velocity of one body at times of pieces, or its position."""
        order, entry = self._entries_of(self.bodies, piece, t, body)
        found, own = np.empty(t.size), t[order]
        if integrated:
            found[order] = self.bodies.integrals(entry, own, self.unit)
        else:
            found[order] = self._led(self.bodies.values(entry, own, self.unit)[None], entry[None], own)[0]
        return found

    def of_row(self, piece: Indices, t: Array, row: int) -> tuple[Modes, Modes, Array, Array]:
        """Return of one row modes, those shown, since when it rests, and the force that holds it."""
        order, entry = self._entries_of(self.rows, piece, t, row)
        found = np.empty((4, t.size))
        inner = self.rows.first[entry]
        found[0, order], found[1, order] = inner, np.where(inner == OPEN, self.labels[row], inner)
        found[2, order] = self.rows.second[entry]
        found[3, order] = self.rows.values(entry, t[order], self.unit)
        return found[0].astype(np.int8), found[1].astype(np.int8), found[2], found[3]

    def _entries_of(
        self, series: Series, piece: Indices, t: Array, thing: int
    ) -> tuple[Indices | slice, Indices]:
        """Return an order of times of pieces, and which entries of one thing hold there."""
        ticks = self._ticks(piece, t)
        order = _in_order(ticks)
        return order, series.entries(ticks[order], thing)

    def moved(self, piece: Indices, t: Array) -> Array:
        """Return how far the bodies have come since the start, a column for each time of a piece."""
        ticks = self._ticks(piece, t)
        order = _in_order(ticks)
        found = np.empty((self.system.n, t.size))
        entry = self.bodies.entries(ticks[order], slice(None))
        found[:, order] = self.bodies.integrals(entry, t[order], self.unit) - self.begin[:, None]
        return found

    @cached_property
    def begin(self) -> Array:
        """Positions of the bodies at the start."""
        t = self.starts[:1]
        first = self.bodies.entries(self._ticks(np.zeros(1, dtype=np.intp), t), slice(None))
        return self.bodies.integrals(first, t, self.unit)[:, 0]

    def _led(self, v: Array, entry: Indices, t: Array) -> Array:
        """Return velocities where those of bodies that a drive leads are equal to its own to the bit."""
        lead = self.bodies.second[entry]
        if self.drives[1].size and (on := lead >= 0).any():
            u = self.drives[1]
            led = u[:, :1] + u[:, 1:] * (t - self.since)
            v[on] = led[lead[on].astype(np.intp), np.broadcast_to(np.arange(t.size), entry.shape)[on]]
        return v

    def modes(self, piece: Indices, t: Array) -> tuple[Modes, Modes, Array]:
        """Return modes as the equations know them, modes that rows show, and since when they rest: a column each."""
        ticks = self._ticks(piece, t)
        order = _in_order(ticks)
        entry = np.empty((self.system.m, t.size), dtype=np.intp)
        entry[:, order] = self.rows.entries(ticks[order], slice(None))
        inner = self.rows.first[entry].astype(np.int8)
        shown = np.where(inner == OPEN, self.labels[:, None], inner).astype(np.int8)
        return inner, shown, self.rows.second[entry]

    def modes_of(self, row: int) -> list[tuple[int, int]]:
        """Return for each piece the mode of a row as the equations know it, and the one it shows."""
        ticks = self._ticks(np.arange(self.starts.size), self.starts)
        inner = self.rows.first[self.rows.entries(ticks, row)].astype(int).tolist()
        return [(mode, int(self.labels[row]) if mode == OPEN else mode) for mode in inner]

    def forces(self, piece: Indices, t: Array) -> Array:
        """Return the forces of held rows at times of pieces, a column each; those of other rows mean nothing."""
        ticks = self._ticks(piece, t)
        order = _in_order(ticks)
        found = np.empty((self.system.m, t.size))
        entry = self.rows.entries(ticks[order], slice(None))
        found[:, order] = self.rows.values(entry, t[order], self.unit)
        return found

    # -- how it bends ----------------------------------------------------------------------------------------

    @cached_property
    def steps(self) -> tuple[Array, Indices]:
        """The times at which steps begin, and the piece of each: every piece and every time at which series end."""
        t = np.concatenate([self.starts, self.ticks])
        piece = np.concatenate([np.arange(self.starts.size), self.piece_of_tick])
        order = np.lexsort((t, piece))
        t, piece = t[order], piece[order]
        new = np.append(True, (t[1:] > t[:-1]) | (piece[1:] > piece[:-1]))
        return t[new], piece[new]

    @cached_property
    def _lasts(self) -> Array:
        """Until when each entry of a body holds."""
        last = np.append(self.bodies.thing[1:] != self.bodies.thing[:-1], True)
        begins = self.ticks[self.bodies.tick.astype(np.intp)]
        return np.where(last, self.stop, np.append(begins[1:], self.stop))

    @cached_property
    def ranges(self) -> tuple[Array, Array]:
        """The least and the largest velocities of all bodies, and with them how far each has come."""
        series, n = self.bodies, self.system.n
        low, high = np.full((2, n), np.inf), np.full((2, n), -np.inf)
        for some in _at_once(series.thing.size):
            begins, thing = self.ticks[series.tick[some]], series.thing[some]
            t = begins[:, None] + np.linspace(0.0, 1.0, 5) * (self._lasts[some] - begins)[:, None]
            entry = np.repeat(np.arange(some.start, some.start + thing.size)[:, None], t.shape[1], axis=1)
            for k, values in enumerate(series.both(entry, t, self.unit)):
                np.minimum.at(low[k], thing, values.min(axis=1))
                np.maximum.at(high[k], thing, values.max(axis=1))
        return low, high

    def worst(self, speed: Array, distance: Array) -> Array:
        """Return for each step the largest second derivative, as a part of what is given for each body's."""
        begins, piece = self.steps
        ends = np.append(begins[1:], self.stop)
        h = np.where(np.append(piece[1:] == piece[:-1], True), ends - begins, self.stops[piece] - begins)
        own_begins, own_ends, bend = self._bends(speed, distance)
        first = np.searchsorted(begins, own_begins, side="left")
        last = np.maximum(np.searchsorted(begins, own_ends, side="left"), first + 1)
        return _largest_over(first, last, bend, begins.size) * h * h

    def _bends(self, speed: Array, distance: Array) -> tuple[Array, Array, Array]:
        """Return of all series that bend when they begin and end, and the largest second derivative of each."""
        series = self.bodies
        bent = (series.degree > 0).nonzero()[0]
        bend = np.empty(bent.size)
        k = np.arange(series.terms.shape[1], dtype=float)
        for some in _at_once(bent.size):
            own = bent[some]
            size, thing = np.abs(series.terms[own]), series.thing[own]
            s = (np.abs(self._lasts[own] - series.origin[own]) / self.unit)[:, None]
            # |x''| = |v'| <= sum k |c_k| s^(k-1), and |v''| likewise
            rate = (size * s ** np.maximum(k - 1, 0)) @ k / self.unit / distance[thing]
            lower = (size * s ** np.maximum(k - 2, 0)) @ (k * (k - 1))
            bend[some] = np.maximum(lower / self.unit**2 / speed[thing], rate)
        return self.ticks[series.tick[bent]], self._lasts[bent], bend

    # -- piece by piece --------------------------------------------------------------------------------------

    def ends(self, k: int) -> Array:
        """Return the times at which steps of a piece end, its start among them."""
        own = slice(*np.searchsorted(self.piece_of_tick, [k, k + 1]))
        ticks = self.ticks[own]
        stop = self.starts[k + 1] if k + 1 < self.starts.size else self.stop
        inner = ticks[(ticks > self.starts[k]) & (ticks < stop)]
        return np.concatenate([[self.starts[k]], np.unique(inner), [stop]])

    def path(self, k: int) -> Path:
        """Return the states of all the scene over a piece."""
        system, ends = self.system, self.ends(k)
        t, stop = float(ends[0]), float(ends[-1])
        width = self.bodies.terms.shape[1] + 1
        if stop <= t:
            last = self.states(np.array([k]), np.array([t]))[:, 0]
            return Path(np.zeros(1), np.zeros((0, width, system.size)), last, True)
        ticks = self._ticks(np.full(ends.size - 1, k), ends[:-1])
        entry = self.bodies.entries(ticks, slice(None))
        coefficients = np.zeros((ends.size - 1, width, system.size))
        for i in range(ends.size - 1):
            h = (ends[i + 1] - ends[i]) / self.unit
            own = entry[:, i]
            s = (ends[i] - self.bodies.origin[own]) / self.unit
            v = shifted(self.bodies.terms[own], s)
            lead = self.bodies.second[own]
            on = (lead >= 0).nonzero()[0]
            if on.size:
                u = self.drives[1][lead[on].astype(np.intp)]
                v[on, 0] = u[:, 0] + u[:, 1] * (ends[i] - self.since)
            powers = h ** np.arange(width - 1)
            coefficients[i, :-1, : system.n] = (v * powers).T
            x = v * powers * (h * self.unit / np.arange(1, width))
            if system.placed.size:
                coefficients[i, 1:, system.moved_state] = x[system.moved]
                at = self.bodies.integrals(own[system.moved, None], ends[i : i + 1], self.unit)[:, 0]
                coefficients[i, 0, system.moved_state] = at
                u, d = self.drives[1][system.carried], ends[i] - self.since
                step = h * self.unit
                start = self.drives[0][system.carried] + d * (u[:, 0] + 0.5 * d * u[:, 1])
                coefficients[i, 0, system.carried_state] = start
                coefficients[i, 1, system.carried_state] = step * (u[:, 0] + d * u[:, 1])
                coefficients[i, 2, system.carried_state] = 0.5 * step * step * u[:, 1]
        last = self.states(np.array([k]), np.array([stop]))[:, 0]
        return Path(ends - t, coefficients, last, True)
