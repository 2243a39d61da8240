"""The motions of parts that nothing connects, simulated one by one, as one result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from stickslip.assembly import System
from stickslip.mode_set import OPEN
from stickslip.pieces import Piece, interpolant
from stickslip.result import Result, SimulationError, SimulationInterrupted
from stickslip.scene import Scene
from stickslip.segment import Segment

__all__ = ["simulate_apart"]

Array = NDArray[np.float64]
Run = Callable[[Scene, float], Result]

_SAME = 1e-14
"""Times closer than this part of the span are one."""


def simulate_apart(system: System, run: Run, sampled: bool) -> Result:
    """Return the motion of a scene from those of its parts: none of them feels the others' steps and events.

    Parameters
    ----------
    system : System
        The whole scene, over its time span.
    run : callable
        Simulates a scene up to a time in s.
    sampled : bool
        Whether outputs are wanted at given times.

    Raises
    ------
    SimulationError, SimulationInterrupted
        Of the part that came least far, with what was computed of all parts up to there.
    """
    start, stop = system.span
    failure: SimulationError | SimulationInterrupted | None = None
    results: dict[int, Result] = {}
    for number, part in enumerate(system.parts):
        try:
            results[number] = run(part, stop)
        except (SimulationError, SimulationInterrupted) as error:
            failure, results[number] = error, error.result
            stop = _end(error.result, start)
            if stop == start:
                raise _again(failure, _nothing(system, failure)) from failure
    if failure is None:
        return _join(system, list(results.values()), sampled, results[0].message, 0)
    cut = [
        results[k] if _end(results[k], start) == stop else run(part, stop)
        for k, part in enumerate(system.parts)
    ]
    raise _again(failure, _join(system, cut, sampled, str(failure), -1)) from failure


def _end(result: Result, start: float) -> float:
    return result._pieces[-1].stop if result._pieces else start


def _again(
    failure: SimulationError | SimulationInterrupted, result: Result
) -> SimulationError | SimulationInterrupted:
    if isinstance(failure, SimulationInterrupted):
        return SimulationInterrupted(str(failure), result)
    return SimulationError(str(failure), failure.t, failure.modes, result)


def _nothing(system: System, failure: SimulationError | SimulationInterrupted) -> Result:
    none = np.empty(0, dtype=np.intp)
    stats = failure.result.stats
    y = np.empty((system.size, 0))
    return Result(system.scene, np.empty(0), y, [], False, -1, str(failure), stats, system, [], none)


class _Part:
    """The result of a part, and where its states and contacts stand among those of the whole.

    Parameters
    ----------
    result : Result
    whole : System
    """

    def __init__(self, result: Result, whole: System) -> None:
        self.result, own = result, result._system
        bodies = [whole.index[name] for name in own.names]
        names = {number: name for name, number in own.index.items()}
        positions = [whole.position_state[whole.index[names[int(i)]]] for i in own.placed]
        numbers = {contact.name: j for j, contact in enumerate(whole.scene.contacts)}
        contacts = [numbers[contact.name] for contact in result.scene.contacts]
        bristles = [whole.bristle_state[contacts[j]] for j in own.bristle_state]
        self.columns = np.array([*bodies, *positions, *bristles], dtype=np.intp)
        self.contacts = np.array(contacts, dtype=np.intp)
        self.starts = np.array([piece.start for piece in result._pieces])
        self._followed: tuple[Piece, Segment, Callable[[Array], Array]] | None = None

    def piece_at(self, t: float) -> Piece:
        """Return the piece that begins at `t` or goes on there."""
        return self.result._pieces[int(np.searchsorted(self.starts, t, side="right")) - 1]

    def follow(self, piece: Piece) -> tuple[Segment, Callable[[Array], Array]]:
        """Return the segment of a piece and its states as a function of local times, kept while it is asked for."""
        if self._followed is None or self._followed[0] is not piece:
            segment = piece.segment()
            self._followed = piece, segment, interpolant(segment, piece.taus, piece.states)
        return self._followed[1:]


def _join(system: System, results: Sequence[Result], sampled: bool, message: str, status: int) -> Result:
    parts = [_Part(result, system) for result in results]
    count = min(result.t.size for result in results)
    if sampled and not all(piece.complete for result in results for piece in result._pieces):
        pieces, piece_of = _pieces_of_outputs(system, parts, count)
    else:
        pieces = _pieces(system, parts)
        piece_of = np.repeat(np.arange(len(pieces)), [piece.taus.size for piece in pieces])
    if sampled:
        t, y = results[0].t[:count], np.empty((system.size, count))
        for part in parts:
            y[part.columns] = part.result.y[:, :count]
        if pieces and pieces[0].complete:
            starts = np.array([piece.start for piece in pieces])
            piece_of = np.searchsorted(starts, t, side="right") - 1
    else:
        t = np.concatenate([piece.times() for piece in pieces])
        y = np.concatenate([piece.states for piece in pieces]).T
    events = sorted((e for result in results for e in result.events), key=lambda event: event.t)
    stats: Counter[str] = Counter()
    for result in results:
        stats.update(result.stats)
    success = status == 0
    return Result(system.scene, t, y, events, success, status, message, dict(stats), system, pieces, piece_of)


def _pieces(system: System, parts: Sequence[_Part]) -> list[Piece]:
    """Return pieces of the whole motion: one from each end of any part's piece to the next."""
    start = float(parts[0].starts[0])
    stop = parts[0].result._pieces[-1].stop
    same = _SAME * (stop - start)
    ends = np.unique(np.concatenate([part.starts for part in parts]))
    ends = ends[np.diff(ends, prepend=-np.inf) > same]
    ends = np.append(ends[ends < stop - same], stop)
    return [_piece(system, parts, *span, same) for span in pairwise(ends.tolist())]


def _piece(system: System, parts: Sequence[_Part], start: float, stop: float, same: float) -> Piece:
    active = [part.piece_at(start + same) for part in parts]
    times = np.unique(np.concatenate([piece.start + piece.taus for piece in active]))
    inside = times[(times > start + same) & (times < stop - same)]
    taus = np.array([0.0, *(inside - start).tolist(), stop - start])
    states = np.empty((taus.size, system.size))
    joined = _Modes.none(system)
    forces: dict[int, tuple[Array, Array]] = {}
    for part, piece in zip(parts, active, strict=True):
        segment, at = part.follow(piece)
        local = np.clip(start - piece.start + taus, 0.0, piece.taus[-1])
        local[0] = 0.0 if start - piece.start <= same else local[0]
        local[-1] = piece.taus[-1] if piece.stop - stop <= same else local[-1]
        rows = states[:, part.columns] = at(local)
        joined.take(part, piece, segment, float(local[0]), rows[0])
        forces |= _multipliers(part, piece, segment, local)
    multipliers = None if active[0].multipliers is None else _stacked(forces, taus.size)
    return joined.piece(system, start, stop, taus, states, multipliers=multipliers)


def _multipliers(part: _Part, piece: Piece, segment: Segment, local: Array) -> dict[int, tuple[Array, Array]]:
    """Return forces and their slopes at local times, by contacts of the whole."""
    stuck = segment.mode_set.stuck
    if piece.multipliers is None or not stuck.size:
        return {}
    curve = CubicHermiteSpline(piece.taus, *piece.multipliers)
    values, slopes = curve(local), curve.derivative()(local)
    return {int(part.contacts[j]): (values[:, k], slopes[:, k]) for k, j in enumerate(stuck.tolist())}


def _stacked(forces: dict[int, tuple[Array, Array]], count: int) -> tuple[Array, Array]:
    """Return forces and slopes (columns) in the order of their contacts."""
    values, slopes = (
        np.column_stack([np.empty((count, 0)), *(forces[j][k] for j in sorted(forces))]) for k in (0, 1)
    )
    return values, slopes


def _pieces_of_outputs(
    system: System, parts: Sequence[_Part], count: int
) -> tuple[list[Piece], NDArray[np.intp]]:
    """Return pieces that hold outputs only, and to which of them each output belongs."""
    numbers = np.array([part.result._piece_of[:count] for part in parts])
    firsts = np.flatnonzero(np.any(np.diff(numbers, axis=1, prepend=-1) != 0, axis=0)).tolist()
    pieces = []
    for first, last in pairwise([*firsts, count]):
        active = [part.result._pieces[int(numbers[k, first])] for k, part in enumerate(parts)]
        start, stop = max(piece.start for piece in active), min(piece.stop for piece in active)
        t = parts[0].result.t[first:last]
        states = np.empty((t.size, system.size))
        joined = _Modes.none(system)
        for part, piece in zip(parts, active, strict=True):
            states[:, part.columns] = part.result.y[:, first:last].T
            joined.take_output(part, piece, t[0], start, states[0, part.columns])
        pieces.append(joined.piece(system, start, stop, t - start, states, complete=False))
    return pieces, np.repeat(np.arange(len(pieces)), np.diff([*firsts, count]))


@dataclass(frozen=True)
class _Modes:
    """The modes of all contacts in one piece of the whole."""

    modes: NDArray[np.int8]
    labels: NDArray[np.int8]
    since: Array
    at_rest: NDArray[np.bool_]

    @classmethod
    def none(cls, system: System) -> _Modes:
        m = system.m
        return cls(np.zeros(m, np.int8), np.zeros(m, np.int8), np.zeros(m), np.zeros(m, dtype=bool))

    def take(self, part: _Part, piece: Piece, segment: Segment | None, tau: float, y: Array) -> None:
        """Take over those of a part from local time `tau` of its piece on."""
        self.modes[part.contacts], self.labels[part.contacts] = piece.modes, piece.labels
        self.since[part.contacts] = piece.since
        if tau == 0.0:
            self.at_rest[part.contacts] = piece.at_rest
        elif segment is not None:
            for j in np.flatnonzero(piece.modes >= OPEN).tolist():
                self.labels[part.contacts[j]] = piece.mode(segment, j, np.array([tau]), y[:, None])[0]

    def take_output(self, part: _Part, piece: Piece, t: float, start: float, y: Array) -> None:
        """Take over those of a part for a piece of outputs from `start` on, whose first output is at `t`."""
        segment = piece.segment() if start > piece.start and np.any(piece.modes >= OPEN) else None
        self.take(part, piece, segment, t - piece.start, y)

    def piece(
        self,
        system: System,
        start: float,
        stop: float,
        taus: Array,
        states: Array,
        complete: bool = True,
        multipliers: tuple[Array, Array] | None = None,
    ) -> Piece:
        return Piece(
            system,
            start,
            stop,
            self.modes,
            self.labels,
            self.since,
            self.at_rest,
            taus,
            states,
            complete,
            multipliers,
        )
