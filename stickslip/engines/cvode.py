"""CVODE for motions of any kind: integrate to the first root of the smallest guard."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from stickslip.engines.base import Method, Task
from stickslip.engines.progress import Progress
from stickslip.engines.series import Series
from stickslip.engines.solvers.faults import Faults
from stickslip.engines.solvers.follow import LookAhead, Lookout, first_step, follow, longest_step
from stickslip.engines.solvers.linear_solver import LinearSolver, band_order
from stickslip.engines.solvers.sundials import CVODE
from stickslip.engines.solvers.through_points import path_through
from stickslip.engines.solvers.tolerances import SolverTolerances, noise_of_led
from stickslip.engines.work import Work, solved
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.model.arrays import Array, Indices

# Scikit-sundae keeps a record of every event on the guard function: after so many events a solver is replaced.
_EVENTS_PER_SOLVER = 20

# Parts of the longest first step that a motion allows: the first step of a new solver, and the least one with which an
# existing solver is used again.
_CAREFUL, _SHORTEST = 1e-4, 1e-8

_Options = tuple[int, float, float]  # how often tolerances have changed, longest and first step in s


class _Solver:
    """A solver of scikit-sundae, what fails in it, and how many events have stopped it."""

    def __init__(self, own: Any, faults: Faults) -> None:
        self.own, self.faults = own, faults
        self.events = 0


class _CurrentMotion:
    """The motion that is followed now, for the callbacks of solvers.

    Solvers do not refer to the engine: such a cycle of references could only be freed by the garbage collector.
    """

    motion: Selected
    rate: Callable[[float, Array, Array], None]
    lookout: Lookout
    progress: Progress
    has_begun: bool

    def __init__(self) -> None:
        self.linear_solver = LinearSolver()

    def jacobian(self, tau: float, y: Array) -> Any:
        """Return the Jacobian; the first one is that at the state which the Taylor series at the start gives for `tau`.

        CVODE predicts its first point from rates alone, and from rest these are roundoff. At that point bristles that
        nothing presses yet are as stiff as can be. With a Jacobian that is too stiff CVODE accepts any step as solved.
        """
        whole = None if self.has_begun else self.motion.motion.soon(tau)
        self.has_begun = True
        if whole is None or not np.isfinite(whole).all():
            whole = self.motion.expand(tau, y)
        return self.motion.jacobian(tau, whole)


class Cvode:
    """CVODE for the motions of one simulation.

    `kind` is BDF or Adams.
    """

    def __init__(self, task: Task, kind: str) -> None:
        self._task, self._kind, self._order = task, kind, band_order(task.system)
        self._tolerances = SolverTolerances(task, for_stiff=kind == "BDF")
        self.work, self._look_ahead = Work(), LookAhead()
        self._series: Series | None = None
        if task.exact_at_rest:
            self._series = Series(task)
            self._series.work = self.work
        self._now = _CurrentMotion()
        self._solvers: dict[_Options, _Solver] = {}

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Follow a motion to its first event or to local time `horizon`, whichever comes first."""
        if self._series is not None and motion.is_linear and not guards.is_velocity.any():
            return self._series.advance(motion, guards, horizon)
        atol = self._tolerances.now[1][: motion.system.n]
        of_positions, of_velocities = noise_of_led(motion, horizon)
        # accelerations that are too rough are not integrated
        merged = self._task.merged or bool((of_velocities > atol).any())
        pace = float((atol / np.maximum(of_positions, atol)).min())
        self._now.motion = selected = Selected(motion, self._order, merged, pace)
        self._now.rate = selected.writes_rates()
        self._now.lookout = Lookout(guards, self._task.interruption, self.work, self._look_ahead, self._tolerances)
        return follow(motion, guards, horizon, self._solve, self._task.interruption, self._look_ahead)

    def _solve(self, tau: float, progress: Progress) -> Path:
        selected, lookout, work = self._now.motion, self._now.lookout, self.work
        self._now.progress, self._now.has_begun = progress, False
        solver, tolerance = self._solver(selected), self._tolerances.now
        lookout.end = None
        solver.faults.clear()
        solution = solver.own.solve(np.array([0.0, tau]), selected.start)
        solver.faults.check()
        taus, points = lookout.points_of(solution)
        work.steps += taus.size - 1
        work.rate_calls += solution.nfev
        work.jacobian_calls += solution.njev
        solver.events += solution.status == 2
        path = path_through(
            selected.motion,
            taus,
            selected.whole(taus, points),
            tolerance,
            self._kind,
            lookout.found,
        )
        return solved(solution, path)

    def _solver(self, selected: Selected) -> _Solver:
        motion = selected.motion
        max_step = longest_step(motion, self._task.max_step, self._task.loads.period)
        if self._now.linear_solver.hold(selected.start.size, lambda: selected.pick_both(motion.jacobian_pattern)):
            self._solvers.clear()
        first, changes = first_step(motion, *self._tolerances.now), self._tolerances.changes
        # CVODE's second step may be 10 000 times the first: a solver that starts carefully serves many motions
        fit = [x for k, m, x in self._solvers if (k, m) == (changes, max_step) and _SHORTEST * first <= x <= first]
        key = changes, max_step, fit[0] if fit else _CAREFUL * first
        if key not in self._solvers or self._solvers[key].events >= _EVENTS_PER_SOLVER:
            self._solvers[key] = self._make(*key[1:])
            self.work.solvers += 1
        return self._solvers[key]

    def _make(self, max_step: float, first: float) -> _Solver:
        """Return a solver; its callbacks serve whatever motion is followed when they are called."""
        now = self._now

        def rate(tau: float, y: Array, out: Array) -> None:
            now.progress.note(tau)
            now.rate(tau, y, out)

        def jacobian(tau: float, y: Array, rate: Array, out: Array) -> None:
            now.linear_solver.fill(now.jacobian(tau, y), out)

        def smallest_guard(tau: float, y: Array, out: Array) -> None:
            out[0] = now.lookout.at(tau, now.motion.expand(tau, y), y)

        rtol, atol = self._tolerances.now
        faults = Faults(waits=now.linear_solver.is_sparse)
        own = CVODE(
            faults.of_rates(rate),
            method=self._kind,
            rtol=rtol,
            atol=_shortest(now.motion.pick(atol)),
            max_step=max_step,
            first_step=first,
            jacfn=faults.of_jacobian(jacobian, lambda: 0.0),
            eventsfn=smallest_guard,
            num_events=1,
            **now.linear_solver.options(),
        )
        return _Solver(own, faults)


class Selected:
    """The states of a motion as CVODE sees them: all, or reordered, or without the dependent velocities.

    CVODE refuses an empty state. Where all states are dependent velocities, it integrates these once more, so that its
    steps follow how they change: times a `pace` below 1 where they are rough, so that no step follows their noise.
    """

    def __init__(self, motion: Motion, order: Indices | None, merged: bool, pace: float = 1.0) -> None:
        self.motion, self._pace = motion, pace
        size = motion.y.size
        self._order = np.arange(size) if order is None else order
        self._is_all = order is None and not merged
        self._is_part = self._is_led = False
        if merged:
            stays = np.ones(size, dtype=bool)
            stays[motion.equations.dependent] = False
            self._is_led = not stays.any()
            self._order = self._order[stays[self._order] | self._is_led]
            self._is_part = True
        self.start = self.pick(motion.y)

    def pick(self, values: Array) -> Array:
        """Return the values of the states that are integrated."""
        return values if self._is_all else values[self._order]

    def expand(self, tau: float, y: Array) -> Array:
        """Return the whole state."""
        if self._is_all:
            return y
        full = np.zeros(self.motion.y.size)
        full[self._order] = y
        return self.motion.exact(tau, full) if self._is_part else full

    def whole(self, taus: Array, points: Array) -> Array:
        """Return points with all states."""
        if self._is_all:
            return points
        full = np.zeros((taus.size, self.motion.y.size))
        full[:, self._order] = points
        return self.motion.exact(taus, full.T).T

    def writes_rates(self) -> Callable[[float, Array, Array], None]:
        """Return the function that writes the rates of the integrated states."""
        in_floats = self.motion.in_floats if self._is_all else None
        return in_floats or self._in_arrays

    def _in_arrays(self, tau: float, y: Array, out: Array) -> None:
        whole = self.expand(tau, y)
        out[:] = self.pick(self._pace * whole if self._is_led else self.motion.rate(tau, whole))

    def jacobian(self, tau: float, whole: Array) -> Any:
        """Return the Jacobian in a whole state."""
        return self.pick_both(self.motion.jacobian(tau, whole))

    def pick_both(self, matrix: Any) -> Any:
        """Return the rows and columns of the states that are integrated."""
        return matrix if self._is_all else matrix[self._order][:, self._order]


def _shortest(values: Array) -> float | Array:
    """Return one number where all are equal: a long vector of tolerances takes long to check."""
    return float(values[0]) if np.all(values == values[0]) else values


_FORMULATIONS = ("contact-force", "merged")
BDF = Method("CVODE BDF", lambda task: Cvode(task, "BDF"), _FORMULATIONS)

# Adams methods are not made for stiffness: they must resolve the velocities of smooth laws better.
ADAMS = Method("CVODE Adams", lambda task: Cvode(task, "Adams"), _FORMULATIONS, resolution=1e4)
