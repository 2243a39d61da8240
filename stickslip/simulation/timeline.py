"""Where a run has come to in time; it gives up where time stands still."""

from __future__ import annotations

from collections import deque

from stickslip.equations.system import System

_WITHOUT_PROGRESS = 100
_EVENTS_BETWEEN_LOOKS, _EVENTS_AT_MOST = 500, 1e9


class Timeline:
    """The time of a run, and how often modes have changed on the way there.

    Attributes
    ----------
    start, stop, t : float
        The time span in s, and where in it the run is.
    restarts : int
        Motions that have ended.
    """

    def __init__(self, system: System, start: float, stop: float) -> None:
        self._system = system
        self.start, self.stop, self.t = start, stop, start
        self.restarts = 0
        # restarts without progress, events since the last look at the time, that time, and the rows that changed last
        self._standing = self._events = 0
        self._looked_at = start
        self._recent: deque[int] = deque(maxlen=20)

    @property
    def duration(self) -> float:
        """Length of the time span in s."""
        return self.stop - self.start

    @property
    def gone(self) -> float:
        """How much of the time span has passed, in s."""
        return self.t - self.start

    @property
    def is_over(self) -> bool:
        """Whether the end of the time span has been reached."""
        return self.t >= self.stop

    def note(self, j: int) -> None:
        """Note that the mode of a row has changed."""
        self._recent.append(j)

    def pass_event(self, t: float, j: int) -> None:
        """Go on to an event of a row that was settled without the whole scene."""
        self.note(j)
        self.go_to(t, not self._system.piecewise.count)
        self.restarts += 1

    def go_to(self, t: float, is_event: bool) -> None:
        """Go on to `t`; give up where time stands still, or goes on so slowly that 1e9 events would be needed."""
        whole = self.duration
        stands = t - self.t <= 1e-14 * whole
        self.t = t
        self._standing = self._standing + 1 if stands else 0
        if self._standing > _WITHOUT_PROGRESS + 10 * self._system.m:
            raise ArithmeticError(f"modes flip without progress in time: contacts {self._names()}")
        self._events += is_event
        if self._events >= _EVENTS_BETWEEN_LOOKS * max(self._system.m, 1):
            if (t - self._looked_at) * _EVENTS_AT_MOST < self._events * whole:
                raise ArithmeticError(f"modes flip with hardly any progress in time: contacts {self._names()}")
            self._events, self._looked_at = 0, t

    def _names(self) -> str:
        system = self._system
        # if no row has changed, gaps and stops come to their limits again and again without passing them
        rows = set(self._recent) or set(system.piecewise.row.tolist()) or range(system.m)
        return ", ".join(sorted(repr(system.rows[j].name) for j in rows))
