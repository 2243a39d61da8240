"""CVODE on a clock: where a motion is known in closed form, only the roots of its guards are left to find."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.engine_sundials import CVODE
from stickslip.plain_guards import smallest_of
from stickslip.solving import Work, failure_of, guard_value

__all__ = ["ROOTS_PER_SOLVER", "Clock"]

Array = NDArray[np.float64]

ROOTS_PER_SOLVER = 20
"""scikit-sundae keeps every event's record on the guard function: a fresh solver now and then."""

_IDLE: list[Clock] = []
_START = np.zeros(1)


class Clock:
    """CVODE for ``tau' = 1``, in as few steps as there are roots to find."""

    def __init__(self) -> None:
        self._work = Work()
        self._guard = smallest_of([])
        self._solver: CVODE | None = None
        self._calls = self._roots = self._roots_at_all = 0

    @classmethod
    def get(cls, work: Work) -> Clock:
        """Return a clock for one simulation: one that another has put back, or a new one.

        A solver takes longer to build than to find a root. A clock belongs to one simulation at a time.
        """
        try:
            clock = _IDLE.pop()
        except IndexError:
            clock = cls()
        clock._work, clock._roots = work, 0
        work.solvers += 1
        return clock

    def put_back(self) -> None:
        """Leave the clock to the next simulation."""
        if self._roots_at_all < ROOTS_PER_SOLVER:
            self._guard = smallest_of([])
            _IDLE.append(self)

    def advance(self, guard: Callable[[float], float], tau: float) -> tuple[float, bool]:
        """Return the local time of the first root of the guard up to `tau`, and whether there is one."""
        self._guard = guard
        solver = self._ready()
        solver.init_step(0.0, _START)
        solution: Any = solver.step(tau, "normal", tau)
        hit = solution.status == 2
        self._roots += hit
        self._roots_at_all += hit
        self._work.starts += 1
        self._work.steps += 1
        self._work.rate_calls += solution.nfev
        self._work.jacobian_calls += solution.njev
        self._work.guard_calls += self._calls
        self._calls = 0
        if solution.status < 0:
            raise failure_of(solution, None)
        return float(solution.t), hit

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
            out[0] = guard_value(self._guard(tau), tau)

        return CVODE(
            rate,
            eventsfn=smallest_guard,
            num_events=1,
            linsolver="band",
            lband=0,
            uband=0,
            first_step=0.5 * np.finfo(float).max,
        )
