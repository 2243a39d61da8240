"""What a run keeps: computed points or outputs, and events."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.mode_set import OPEN
from stickslip.modes import Mode
from stickslip.pieces import Piece, interpolate
from stickslip.result import Event, Result
from stickslip.segment import Segment
from stickslip.solving import Reached

__all__ = ["Recorder"]

Array = NDArray[np.float64]
Modes = NDArray[np.int8]


class _Parabola(NamedTuple):
    """The outputs within a quadratic motion, not evaluated yet."""

    t: float
    longest: float
    y: Array
    f0: Array
    f1: Array
    outputs: int


class Recorder:
    """Collects the pieces of a motion and its events.

    Parameters
    ----------
    system : System
    outputs : array or None
        Times in s at which outputs are wanted, None for every computed point.
    dense : bool
        Whether computed points are kept besides outputs.
    stop : float
        End of the time span in s.
    """

    def __init__(self, system: System, outputs: Array | None, dense: bool, stop: float) -> None:
        self._system, self._outputs, self._dense, self._stop = system, outputs, dense, stop
        self.events: list[Event] = []
        self._pieces: list[Piece] = []
        self._done = 0
        self._sampled: list[Array | _Parabola] = []
        self._sampled_piece: list[int] = []

    def keep(self, segment: Segment, modes: Modes, reached: Reached, stop: float) -> None:
        """Keep the points of a segment that ends at `stop`."""
        first = self._done
        if self._outputs is not None:
            self._done = int(self._outputs.searchsorted(stop, "right" if stop >= self._stop else "left"))
        count = self._done - first
        if count and self._dense and segment.quadratic and not segment.mode_set.driven:
            f0, f1, longest = segment.f0, segment.f1, float(reached.taus[-1])
            self._sampled.append(_Parabola(segment.t, longest, segment.y, f0, f1, count))
            self._sampled_piece.append(len(self._pieces))
        elif count:
            wanted, found = self._sample(segment, reached, first)
            if not self._dense:
                self._pieces.append(Piece.of(segment, stop, modes, wanted, found, complete=False))
        if self._outputs is not None and not self._dense:
            return
        points = (reached.taus, reached.states)
        self._pieces.append(Piece.of(segment, stop, modes, *points, inner=reached.inner))

    def _sample(self, segment: Segment, reached: Reached, first: int) -> tuple[Array, Array]:
        """Keep the outputs within a segment, from the given one on; return their local times and states."""
        assert self._outputs is not None
        wanted = np.minimum(self._outputs[first : self._done] - segment.t, reached.taus[-1])
        found = interpolate(segment, reached, wanted)
        self._sampled.append(found)
        self._sampled_piece.append(len(self._pieces))
        return wanted, found

    def note(
        self, t: float, j: int, before: int, after: int, segment: Segment, fired: bool, relaxed: bool
    ) -> None:
        """Keep an event, with its cause."""
        if segment.mode_set.modes[j] == OPEN:
            cause = "open"
        elif relaxed:
            cause = "relaxation"
        elif before == 0:
            cause = "breakaway" if fired else "breakaway with another event"
        elif after == 0:
            cause = "relative velocity 0" if fired else "stuck with another event"
        else:
            cause = "reversal"
        self.events.append(Event(t, self._system.scene.contacts[j].name, Mode(before), Mode(after), cause))

    def result(self, message: str, status: int, stats: dict[str, Any]) -> Result:
        """Return all that was kept."""
        system, pieces = self._system, self._pieces
        if self._outputs is not None:
            t = self._outputs[: self._done]
            y, counts = self._sampled_states(t)
            piece_of = np.repeat(np.array(self._sampled_piece, dtype=np.intp), counts)
        else:
            t = np.concatenate([np.empty(0), *(piece.times() for piece in pieces)])
            y = np.concatenate([np.empty((0, system.size)), *(piece.states for piece in pieces)])
            piece_of = np.repeat(np.arange(len(pieces)), [piece.taus.size for piece in pieces])
        events = sorted(self.events, key=lambda event: event.t)
        stats = stats | {"events": len(events)}
        return Result(
            system.scene, t, y.T, events, status == 0, status, message, stats, system, pieces, piece_of
        )

    def _sampled_states(self, t: Array) -> tuple[Array, list[int]]:
        """Return the states (rows) at the outputs `t`, and how many of them each part of the motion has."""
        parts = self._sampled
        counts = [part.outputs if isinstance(part, _Parabola) else len(part) for part in parts]
        parabolas = [part for part in parts if isinstance(part, _Parabola)]
        if len(parabolas) == len(parts) and parts:
            return _along(parabolas, t), counts
        ends = np.cumsum([0, *counts]).tolist()
        rows = [
            _along([part], t[slice(*span)]) if isinstance(part, _Parabola) else part
            for part, span in zip(parts, pairwise(ends), strict=True)
        ]
        return np.concatenate([np.empty((0, self._system.size)), *rows]), counts


def _along(parabolas: Sequence[_Parabola], t: Array) -> Array:
    """Return the states (rows) of quadratic motions that follow one another, all at once."""
    starts, longest, y, f0, f1, counts = (np.array(values) for values in zip(*parabolas, strict=True))
    tau = np.minimum(t - starts.repeat(counts), longest.repeat(counts))[:, None]
    y, f0, f1 = (values.repeat(counts, axis=0) for values in (y, f0, f1))
    return y + tau * (f0 + (0.5 * tau) * f1)
