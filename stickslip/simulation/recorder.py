"""What a run keeps: pieces of motion or outputs, and events."""

from __future__ import annotations

from typing import Any

import numpy as np

from stickslip.equations.loads.loads import Span
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.events.settle import Settled
from stickslip.model.arrays import Array
from stickslip.model.modes import Mode
from stickslip.results.outcome import Event
from stickslip.results.patchwork import Patchwork
from stickslip.results.pieces import Piece, Pieces
from stickslip.results.samples import Samples
from stickslip.results.trajectory import Trajectory
from stickslip.simulation.result import Result


class Recorder:
    """Collects the pieces of a motion and its events.

    `outputs` are the times in s at which outputs are wanted, None for times fit for a plot; if not `dense`, nothing
    else is kept. `fewest_states` is the smallest number of states that did not depend on others.
    """

    def __init__(self, system: System, span: Span, outputs: Array | None, dense: bool) -> None:
        self._system, self._span, self._outputs = system, span, outputs
        self.keeps_paths = dense or outputs is None
        self.events: list[Event] = []
        self.fewest_states = system.size
        self._pieces: list[Piece | Patchwork] = []
        self._done = 0
        self._states: list[Array] = []
        self._counts: list[int] = []

    def keep(self, now: Settled, path: Path, stop: float) -> None:
        """Keep the path of a motion that ends at `stop`."""
        motion = now.motion
        self.fewest_states = min(self.fewest_states, self._system.size - motion.equations.dependent.size)
        if self.keeps_paths:
            self._pieces.append(self._piece(now, stop, path))
        times = self._outputs_until(stop)
        if not times.size:
            return
        taus = np.clip(times - motion.t, 0.0, path.taus[-1])
        self._states.append(motion.exact(taus, path.at(taus).T))
        self._counts.append(taus.size)
        self._pieces.append(self._piece(now, stop, None))

    def keep_patchwork(self, patchwork: Patchwork, held: int) -> None:
        """Keep a motion that is known part by part; at most so many rows of it were held at once."""
        self.fewest_states = min(self.fewest_states, self._system.size - held)
        if self.keeps_paths:
            self._pieces.append(patchwork)
        times = self._outputs_until(patchwork.stop)
        if not times.size:
            return
        piece = np.searchsorted(patchwork.starts, times, side="right") - 1
        self._states.append(patchwork.states(piece, times))
        numbers, counts = np.unique(piece, return_counts=True)
        self._counts += counts.tolist()
        self._pieces += [Piece.of(patchwork, k) for k in numbers.tolist()]

    def _outputs_until(self, stop: float) -> Array:
        """Return the output times since the last call that have to be computed now: none where paths are kept."""
        if self._outputs is None:
            return np.empty(0)
        first = self._done
        self._done = int(self._outputs.searchsorted(stop, "right" if stop >= self._span.stop else "left"))
        return self._outputs[: 0 if self.keeps_paths else self._done][first:]

    @staticmethod
    def _piece(now: Settled, stop: float, path: Path | None) -> Piece:
        motion = now.motion
        equations = motion.equations
        return Piece(
            motion.t,
            stop,
            motion.y,
            equations.modes,
            now.labels,
            motion.since,
            equations.regions,
            None if now.impact is None else now.impact.impulses,
            None if now.impact is None else now.impact.lost,
            path,
        )

    def note(self, t: float, row: int, before: int, after: int, cause: str) -> None:
        """Keep an event."""
        self.events.append(Event(t, self._system.rows[row].name, Mode(before), Mode(after), cause))

    def note_user(self, t: float, name: str, sign: int, stays: bool) -> None:
        """Keep an event of the user."""
        cause = f"{'rose' if sign > 0 else 'fell'} {'to' if stays else 'through'} 0"
        self.events.append(Event(t, name, Mode(-sign), Mode(0 if stays else sign), cause))

    def result(self, message: str, status: int, stats: dict[str, Any]) -> Result:
        """Return all that was kept."""
        trajectory = Trajectory(self._system, self._span, Pieces(tuple(self._pieces)))
        events = sorted(self.events, key=lambda event: event.t)
        stats = stats | {"events": len(events)}
        at: Samples | Array | None = None
        if self._outputs is not None:
            times = self._outputs[: self._done]
            at = times if self.keeps_paths else self._kept(trajectory, times)
        return Result(self._system.scene, events, status >= 0, status, message, stats, trajectory, at)

    def _kept(self, trajectory: Trajectory, times: Array) -> Samples:
        states = np.concatenate([np.empty((self._system.size, 0)), *self._states], axis=1)
        piece_of = np.repeat(np.arange(len(self._pieces)), self._counts)
        return Samples(trajectory, times, piece_of, trajectory.local(piece_of, times), states)


def cause_of(before: int, after: int, fired: bool) -> str:
    """Return the cause of a friction contact's change, as explanations name it; `fired` if it was at its limit."""
    if before == 0:
        return "breakaway" if fired else "breakaway with another event"
    if after == 0:
        return "relative velocity 0" if fired else "stuck with another event"
    return "reversal"
