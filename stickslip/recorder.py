"""What a run keeps: computed points or outputs, and events."""

from __future__ import annotations

from typing import Any

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
        self._sampled: list[Array] = []
        self._sampled_piece: list[int] = []

    def keep(self, segment: Segment, modes: Modes, reached: Reached, stop: float) -> None:
        """Keep the points of a segment that ends at `stop`."""
        if self._outputs is not None:
            wanted, found = self._sample(segment, reached, stop)
            if not self._dense:
                if wanted.size:
                    self._pieces.append(Piece.of(segment, stop, modes, wanted, found, complete=False))
                return
        points = (reached.taus, reached.states)
        self._pieces.append(Piece.of(segment, stop, modes, *points, multipliers=reached.multipliers))

    def _sample(self, segment: Segment, reached: Reached, stop: float) -> tuple[Array, Array]:
        """Keep the outputs within a segment; return their local times and states."""
        assert self._outputs is not None
        first = self._done
        self._done = int(self._outputs.searchsorted(stop, "right" if stop >= self._stop else "left"))
        if self._done == first:
            return np.empty(0), np.empty(0)
        wanted = np.minimum(self._outputs[first : self._done] - segment.t, reached.taus[-1])
        found = interpolate(segment, reached.taus, reached.states, wanted)
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
            rows, numbers = self._sampled, np.array(self._sampled_piece, dtype=np.intp)
            piece_of = np.repeat(numbers, [len(states) for states in rows])
        else:
            t = np.concatenate([np.empty(0), *(piece.times() for piece in pieces)])
            rows = [piece.states for piece in pieces]
            piece_of = np.repeat(np.arange(len(pieces)), [piece.taus.size for piece in pieces])
        y = np.concatenate(rows) if rows else np.empty((0, system.size))
        events = sorted(self.events, key=lambda event: event.t)
        stats = stats | {"events": len(events)}
        return Result(
            system.scene, t, y.T, events, status == 0, status, message, stats, system, pieces, piece_of
        )
