"""Follow a motion with a solver of SUNDIALS, also to events between its points; keep what it computed if it fails."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from stickslip.engines.progress import Interruption, OutOfReach, Progress
from stickslip.engines.solvers.dips import first_dip
from stickslip.engines.solvers.guards_along import GuardsAlong
from stickslip.engines.solvers.passing import back_from_end, back_to_zero
from stickslip.engines.solvers.tolerances import SolverTolerances
from stickslip.engines.work import LOOK_AT_SCENE, Interrupted, SolverFailure, Work, sound
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.model.arrays import Array

_STEPS_PER_PERIOD = 8

_ROOT = 2  # the status of a solver that has been stopped by a guard
_FIRST = 1e-3  # longest first step as a part of the time ahead

# After more than so many steps beyond an event are lost, the next path goes at most so many times as far as the event.
_LOST, _FARTHER = 200, 2.0

# A solver creeps if so many steps lead over less than this part of the time ahead.
_CREEPING, _NOWHERE = 1000, 1e-3

_ATTEMPTS = 3  # how often in a row a motion goes on from shortly before a failure

# How far to go again after a failure, as parts of the time of the failure. Steps grow tenfold at most.
_RETRIES = (0.9, 0.5, 0.25, 0.1)


def longest_step(motion: Motion, max_step: float, period: float) -> float:
    """Return the longest step in s, 0 for no limit, as in SUNDIALS.

    It is a part of the loads' period: a solver at rest might step over a load that comes and goes.
    """
    longest = max_step if motion.segment.is_straight else min(max_step, period / _STEPS_PER_PERIOD)
    return longest if np.isfinite(longest) else 0.0


def first_step(motion: Motion, rtol: float, atol: Array) -> float:
    """Return a length in s for the first step: over it the motion bends by a small part of its tolerance."""
    with np.errstate(all="ignore"):
        bend = np.abs(2.0 * motion.first.y[2]) / (rtol * np.abs(motion.y) + atol)
    worst = min(float(bend.max(initial=0.0)), 1e300)
    longest = _FIRST * motion.horizon
    return min(longest, 0.1 / worst**0.5) if worst > 0 else longest


class LookAhead:
    """How far a solver goes before guards between its points are looked at: points beyond an event there are lost."""

    def __init__(self) -> None:
        self.longest = np.inf
        self.failed = 0
        """How often in a row something has failed."""
        self.crept = -np.inf
        """Time in s up to which a solver has crept the last time."""

    def note(self, path: Path, missed: float | None) -> None:
        """Note the time of an event that the solver `missed` on a path: where much was lost, next paths are shorter."""
        self.longest *= _FARTHER
        if missed is not None and path.taus.size - path.taus.searchsorted(missed) > _LOST:
            self.longest = _FARTHER * missed


class Lookout:
    """Watches the smallest guard at the points of a solver, and stops it behind the first one that is negative.

    It also stops the solver where tables have left their regions, where its tolerances have to be others, and where it
    creeps. A body may come to rest in a finite time, as under a force that grows like the root of the speed; its rest
    is found only when the path is looked at. If nothing has come to rest, the next solver goes on from there and may
    creep.
    `end` is the point at which the solver is stopped: local time in s and unknowns.
    """

    def __init__(
        self,
        guards: Guards,
        interruption: Interruption,
        work: Work,
        look_ahead: LookAhead,
        tolerances: SolverTolerances,
    ) -> None:
        self._guards, self._interruption, self._work, self._look_ahead = guards, interruption, work, look_ahead
        self._tolerances = tolerances
        self._has_left = guards.motion.has_left_in_floats or guards.motion.has_left
        self._calls, self._looked_at = 0, 0.0
        self._goes_on = math.isclose(look_ahead.crept, guards.motion.t, rel_tol=1e-12)
        self.end: tuple[float, Array] | None = None
        self.found = False
        """Whether it has found a guard negative."""

    def at(self, tau: float, y: Array, unknowns: Array) -> float:
        """Return the guard that the solver is to see in a state; `unknowns` are the solver's own variables there."""
        if self.end is not None:
            # the root is found on the path later: end the solver's own search for it
            return 0.0
        self._work.guard_calls += 1
        value = sound(self._guards.smallest(tau, y), tau)
        self.found = value <= 0 < tau
        ends = not self.found and (self._interruption.pressed or self._has_left(tau, y) or self._should_restart(tau, y))
        if not (self.found or ends):
            return value
        self.end = tau, unknowns.copy()
        # only the sign counts from here on, but not 0: solvers ignore a guard that has been exactly 0 since their start
        return -1.0

    def _should_restart(self, tau: float, y: Array) -> bool:
        """Tell, after many steps each time, whether the solver creeps; also if its tolerances are adapted then."""
        self._calls += 1
        if self._calls % _CREEPING:
            return False
        return self._tolerances.adapt(self._guards.motion, tau, y) or self._creeps(tau)

    def _creeps(self, tau: float) -> bool:
        """Tell whether the last steps, many of them, have covered next to no time."""
        if self._goes_on:
            return False
        covered, self._looked_at = tau - self._looked_at, tau
        creeps = covered < _NOWHERE * self._guards.motion.horizon
        if creeps:
            self._look_ahead.crept = self._guards.motion.t + tau
        return creeps

    def points_of(self, solution: Any) -> tuple[Array, Array]:
        """Return local times and unknowns at the ends of the steps that a solver has taken."""
        taus, points = solution.t, solution.y
        if solution.status < 0 and taus.size > 1:
            # after a failure the last point stands twice
            taus, points = taus[:-1], points[:-1]
        if self.end is None:
            # copies, because these are parts of arrays with room for many more steps
            return taus.copy(), points.copy()
        if solution.status == _ROOT:
            # the last point is not the end of a step: it is the root that the solver took from the guards it was given
            taus, points = taus[:-1], points[:-1]
        before = int(taus.searchsorted(self.end[0]))
        return np.append(taus[:before], self.end[0]), np.concatenate([points[:before], self.end[1][None]])


def follow(
    motion: Motion,
    guards: Guards,
    horizon: float,
    solve: Callable[[float, Progress], Path],
    interruption: Interruption,
    look_ahead: LookAhead,
) -> Path:
    """Advance to the first event, also where it lies between computed points, or as far as the solver may go.

    ``solve(horizon, progress)`` advances to the first point at which a guard is negative. If it fails or is
    interrupted, the path that is handed over ends at the first event, too.
    """
    try:
        path = _protected(motion, min(horizon, look_ahead.longest), solve, interruption, look_ahead)
    except SolverFailure as failure:
        with contextlib.suppress(ArithmeticError, ValueError):
            failure.path = _to_first_event(motion, guards, failure.path, look_ahead)
        raise
    path = _to_first_event(motion, guards, path, look_ahead)
    if interruption.pressed:
        raise Interrupted(path)
    return path


def _to_first_event(motion: Motion, guards: Guards, path: Path, look_ahead: LookAhead) -> Path:
    """Return a path up to the first event on it, whether the solver has seen this event or not."""
    if not guards.size or path.taus.size < 2:
        return path
    along = GuardsAlong(motion, guards, path)
    missed = first_dip(along)
    look_ahead.note(path, None if missed is None else missed.tau)
    if missed is not None and missed.touched is not None:
        return motion.until(path, missed.tau, touched=missed.touched)
    if missed is not None or path.hit:
        path = back_to_zero(along, float(path.taus[-1]) if missed is None else missed.tau)
    return back_from_end(along, path)


def _protected(
    motion: Motion,
    horizon: float,
    solve: Callable[[float, Progress], Path],
    interruption: Interruption,
    look_ahead: LookAhead,
) -> Path:
    """Advance; where that fails, hand over what was computed before.

    Solvers try states that the motion may never come to, for example far beyond rest. So after a failure the motion
    goes on from a point shortly before, with the shorter steps of a new start.
    """
    progress = Progress(horizon, interruption)
    try:
        path = solve(horizon, progress)
    except (ArithmeticError, ValueError) as fault:
        # a load or a law failed inside the solver, which forgets its points: go there again, but stop short
        path = Path.of_start(motion.y)
        reached = progress.last
        for short in [part * reached for part in _RETRIES if reached > 0]:
            with contextlib.suppress(Exception):
                path = solve(short, Progress(short, interruption))
                break
        look_ahead.failed += 1
        if path.taus.size > 1 and look_ahead.failed <= _ATTEMPTS and not isinstance(fault, OutOfReach):
            return path
        remedy = fault.remedy if isinstance(fault, OutOfReach) else LOOK_AT_SCENE
        raise SolverFailure(str(fault), remedy, path) from fault
    look_ahead.failed = 0
    return path
