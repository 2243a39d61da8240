"""CVODE on a clock: where a motion is known in closed form, only the roots of its guards are left to find."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sksundae.cvode import CVODE

from stickslip.plain_guards import smallest_of
from stickslip.solving import Work, failure_of

__all__ = ["ROOTS_PER_SOLVER", "Clock"]

Array = NDArray[np.float64]

ROOTS_PER_SOLVER = 20
"""scikit-sundae keeps every event's record on the guard function: a fresh solver now and then."""

_IDLE: list[Clock] = []
_START = np.zeros(1)


class Clock:
    """CVODE for ``tau' = 1``, in as few steps as there are roots to find.

    Parameters
    ----------
    max_step : float
        Longest step in s, infinite for none.
    """

    def __init__(self, max_step: float) -> None:
        self._max_step = max_step
        self._work = Work()
        self._guard = smallest_of([])
        self._solver: CVODE | None = None
        self._calls = self._roots = self._roots_at_all = 0

    @classmethod
    def get(cls, max_step: float, work: Work) -> Clock:
        """Return a clock for one simulation: one that another has put back, or a new one.

        A solver takes longer to build than to find a root. A clock belongs to one simulation at a time.
        """
        try:
            clock = _IDLE.pop() if max_step == math.inf else cls(max_step)
        except IndexError:
            clock = cls(max_step)
        clock._work, clock._roots = work, 0
        work.solvers += 1
        return clock

    def put_back(self) -> None:
        """Leave the clock to the next simulation."""
        if self._max_step == math.inf and self._roots_at_all < ROOTS_PER_SOLVER:
            self._guard = smallest_of([])
            _IDLE.append(self)

    def points(self, tau: float) -> Array:
        """Return computed points from 0 to `tau` in a motion without a root."""
        if self._max_step == math.inf:
            return np.array([0.0, tau])
        return np.linspace(0.0, tau, math.ceil(tau / self._max_step) + 1)

    def advance(self, guard: Callable[[float], float], tau: float) -> tuple[Array, bool]:
        """Return computed points up to local time `tau` or the first root of the guard, and whether it is one."""
        self._guard = guard
        solver = self._ready()
        if self._max_step < math.inf:
            solution: Any = solver.solve(np.array([0.0, tau]), _START)
            taus = solution.t.copy()
        else:
            solver.init_step(0.0, _START)
            solution = solver.step(tau, "normal", tau)
            taus = np.array([0.0, solution.t])
        self._work.starts += 1
        self._work.steps += taus.size - 1
        self._work.rate_calls += solution.nfev
        self._work.jacobian_calls += solution.njev
        self._work.guard_calls += self._calls
        self._calls = 0
        hit = solution.status == 2
        self._roots += hit
        self._roots_at_all += hit
        if solution.status < 0:
            raise failure_of(solution, None)
        return taus, hit

    def _ready(self) -> CVODE:
        if self._solver is None or self._roots >= ROOTS_PER_SOLVER:
            self._work.solvers += self._roots >= ROOTS_PER_SOLVER
            self._solver, self._roots = self._make(), 0
            self._roots_at_all = 0
        return self._solver

    def _make(self) -> CVODE:
        def rate(tau: float, y: Array, out: Array) -> None:
            out[0] = 1.0

        def smallest_guard(tau: float, y: Array, out: Array) -> None:
            self._calls += 1
            smallest = self._guard(tau)
            if math.isnan(smallest):
                raise FloatingPointError(f"a guard is not a number at local time {tau:g}")
            out[0] = smallest if smallest < math.inf else 1.0

        return CVODE(
            rate,
            eventsfn=smallest_guard,
            num_events=1,
            linsolver="band",
            lband=0,
            uband=0,
            first_step=0.5 * np.finfo(float).max,
            max_step=self._max_step if self._max_step < math.inf else 0.0,
        )
