"""The seam to SUNDIALS: start at a state, advance to the next root or stop."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.engine_clock import ROOTS_PER_SOLVER, Clock
from stickslip.engine_sundials import CVODE
from stickslip.linear_solver import LinearSolver, band_order
from stickslip.progress import Interruption, Progress
from stickslip.scan import first_dip, first_violation, longest_look
from stickslip.segment import Segment
from stickslip.solving import (
    LOOK_AT_SCENE,
    Interrupted,
    Reached,
    SolverFailure,
    Work,
    failure_of,
    guard_value,
)
from stickslip.steps import INNER, take_steps, within

__all__ = ["LOCAL", "STEPS_PER_PERIOD", "Engine"]

Array = NDArray[np.float64]
Guard = Callable[[float, Array], float]

STEPS_PER_PERIOD = 8
_CLOSER = 0.1
LOCAL = 0.1
"""Local error allowed per step, as a part of the tolerance asked for: what a run of steps adds up is larger."""


class _Cvode:
    """A CVODE solver that serves one segment after another."""

    def __init__(self, make: Callable[[Callable[..., None]], CVODE], work: Work, inner: int) -> None:
        self._make, self._work, self._inner = make, work, inner
        self._solver: CVODE | None = None
        self._roots = 0
        self._reading = False

    def advance(self, guard: Guard, y: Array, tau: float) -> Reached:
        """Integrate from local time 0 to `tau` or to the first root of the smallest guard."""
        solver = self._ready(guard)
        solver.init_step(0.0, y)
        taken = take_steps(solver, tau, y, self._inner, self._read)
        self._work.steps += taken.taus.size - 1
        reached = Reached(taken.taus, taken.states, taken.last.status == 2, inner=taken.inner)
        self._count(taken.last, reached)
        sound = np.isfinite(reached.states).all(axis=1)
        if not sound.all():
            raise SolverFailure(
                "the states have become infinite or not a number",
                "look at the forces and laws of the scene there",
                reached.until(max(int(sound.argmin()), 1)),
            )
        return reached

    def _ready(self, guard: Guard) -> CVODE:
        self._guard = guard
        if self._solver is None or self._roots >= ROOTS_PER_SOLVER:
            # scikit-sundae keeps every event's record on the guard function: a fresh one now and then
            self._solver, self._roots = self._make(self._guard_function()), 0
            self._work.solvers += 1
        self._work.starts += 1
        return self._solver

    def _count(self, solution: Any, reached: Reached | None) -> None:
        self._work.rate_calls += solution.nfev
        self._work.jacobian_calls += solution.njev
        self._roots += solution.status == 2
        if solution.status < 0:
            raise failure_of(solution, reached)

    def _read(self, reading: bool) -> None:
        self._reading = reading

    def _guard_function(self) -> Callable[..., None]:
        def smallest_guard(tau: float, y: Array, out: Array) -> None:
            if self._reading:
                out[0] = 1.0
                return
            self._work.guard_calls += 1
            out[0] = guard_value(self._guard(tau, y), tau)

        return smallest_guard


class Engine:
    """CVODE for the segments of one simulation.

    Where the motion is exactly quadratic in time there is nothing to integrate: CVODE then runs on a clock,
    ``tau' = 1``, in as few steps as there are roots to find, and not at all where there are none.

    Parameters
    ----------
    system : System
    method : str
        "BDF" or "Adams".
    rtol : float
    atol : array (size,)
        Tolerances of the states.
    max_step : float
        Longest step in s, infinite for none.
    merged : bool
        Integrate one velocity for each stuck group and none for what is held: the state shrinks and grows.
    """

    def __init__(
        self, system: System, method: str, rtol: float, atol: Array, max_step: float, merged: bool = False
    ) -> None:
        self._method, self._order = method, band_order(system)
        self._rtol, self._atol = LOCAL * rtol, LOCAL * atol
        self._max_step, self._merged = max_step, merged
        self.work = Work()
        self._clock: Clock | None = None
        self._steppers: dict[float, _Cvode] = {}
        self._linear_solver = LinearSolver()
        self._states: _States
        self._progress: Progress
        self.interruption = Interruption()
        self.show: Callable[[float], None] | None = None

    def advance(self, segment: Segment, horizon: float) -> Reached:
        """Follow a segment to its first event or to local time `horizon`, whichever comes first."""
        return self._on_clock(segment, horizon) if segment.quadratic else self._by_steps(segment, horizon)

    # -- quadratic motion ---------------------------------------------------------------------------------

    def _on_clock(self, segment: Segment, horizon: float) -> Reached:
        clock = self._clock = self._clock or Clock.get(self.work)
        stop = first_violation(segment, min(horizon, longest_look(segment)), self._max_step)
        guard = segment.smallest_guard(stop)
        if guard is None:
            return self._in_closed_form(segment, stop, hit=False)
        # CVODE locates roots within 1e-14 of its step: come close where none can be skipped
        while segment.looked_over and guard(_CLOSER * stop) < 0:
            stop *= _CLOSER
        while True:
            tau, hit = clock.advance(guard, stop)
            if segment.looked_over or not hit or tau > _CLOSER * stop:
                return self._in_closed_form(segment, tau, hit)
            stop = max(4 * tau, np.finfo(float).tiny)

    def _in_closed_form(self, segment: Segment, tau: float, hit: bool) -> Reached:
        """Return the start and the end of a quadratic motion, with points between where long steps are refused."""
        if self._max_step == math.inf:
            taus, states = np.array([0.0, tau]), np.array([segment.y, segment.states(tau)])
        else:
            taus = np.linspace(0.0, tau, max(1, math.ceil(tau / self._max_step)) + 1)
            states = segment.states(taus)
        return Reached(taus, states, hit, joined=not segment.mode_set.driven)

    def release(self) -> None:
        """Leave what the next simulation can use."""
        if self._clock is not None:
            self._clock.put_back()

    # -- everything else ----------------------------------------------------------------------------------

    def _by_steps(self, segment: Segment, horizon: float) -> Reached:
        states = self._states = _States(segment, self._order, self._merged)
        self.work.fewest_states = min(self.work.fewest_states, states.start.size)
        stepper = self._stepper(segment)

        def solve(tau: float) -> Reached:
            try:
                reached = stepper.advance(self._smallest_guard, states.start, tau)
            except SolverFailure as failure:
                if failure.reached is not None:
                    failure.reached = states.expanded(failure.reached)
                raise
            return states.expanded(reached)

        return self._without_dips(segment, solve, horizon)

    def _without_dips(self, segment: Segment, solve: Callable[[float], Reached], horizon: float) -> Reached:
        """Advance to the first event, also where it lies between computed points."""
        while True:
            reached = self._protected(segment, solve, horizon)
            missed = first_dip(segment, reached)
            if missed is None:
                return reached
            if missed >= reached.taus[-1]:
                # a root at the very end is none for the solver, however often it is sent there
                return replace(reached, hit=True)
            horizon = missed

    def _protected(self, segment: Segment, solve: Callable[[float], Reached], horizon: float) -> Reached:
        """Advance; where that fails or is interrupted, hand over what was computed before."""
        progress = self._progress = Progress(horizon, self.interruption, self.show)
        try:
            reached = solve(horizon)
        except (ArithmeticError, ValueError) as fault:
            # a load or a law failed inside the solver, which forgets its points: go there again, but stop short
            reached = Reached(np.zeros(1), segment.y[None, :], False)
            if progress.last > 0:
                self._progress = Progress(0.9 * progress.last, self.interruption)
                with contextlib.suppress(Exception):
                    reached = solve(0.9 * progress.last)
            raise SolverFailure(str(fault), LOOK_AT_SCENE, reached) from fault
        if self.interruption.pressed:
            raise Interrupted(reached)
        return reached

    def _smallest_guard(self, tau: float, y: Array) -> float:
        # a guard that is found negative ends the segment
        return -1.0 if self.interruption.pressed else self._states.smallest_guard(tau, y)

    def _stepper(self, segment: Segment) -> _Cvode:
        max_step = self._max_step
        if segment.has_curved:
            max_step = min(max_step, segment.system.loads.period / STEPS_PER_PERIOD)
        if self._linear_solver.hold(self._states.jacobian(0.0, self._states.start)):
            self._steppers.clear()
        stepper = self._steppers.get(max_step)
        if stepper is None:
            options = self._options(max_step)
            stepper = self._steppers[max_step] = _Cvode(
                lambda guard: self._make_stepper(guard, options), self.work, INNER[self._method]
            )
        return stepper

    def _options(self, max_step: float) -> dict[str, Any]:
        options: dict[str, Any] = {
            "method": self._method,
            "rtol": self._rtol,
            "atol": _shortest(self._states.pick(self._atol)),
            "max_step": max_step if np.isfinite(max_step) else 0.0,
        }
        return options | {"jacfn": self._jacobian} | self._linear_solver.options()

    def _make_stepper(self, guard: Callable[..., None], options: dict[str, Any]) -> CVODE:
        def rate(tau: float, y: Array, out: Array) -> None:
            self._progress.note(tau)
            out[:] = self._states.rate(tau, y)

        with warnings.catch_warnings():
            # giving the pattern together with the exact Jacobian is meant
            warnings.simplefilter("ignore", UserWarning)
            return CVODE(rate, eventsfn=guard, num_events=1, **options)

    def _jacobian(self, tau: float, y: Array, rate: Array, out: Array) -> None:
        self._linear_solver.fill(self._states.jacobian(tau, y), out)


class _States:
    """The states of a segment as CVODE sees them: all (static structure), or reordered, or without what is redundant.

    Merged, there is one velocity for each stuck group and none for what is held (dynamic structure, Breedveld 2000,
    figs. 4 and 5).
    """

    def __init__(self, segment: Segment, order: NDArray[np.intp] | None, merged: bool) -> None:
        self._segment, mode_set = segment, segment.mode_set
        size = segment.y.size
        self._order = np.arange(size) if order is None else order
        self._is_all = order is None and not merged
        if merged:
            stays = np.ones(size, dtype=bool)
            stays[mode_set.follow] = stays[mode_set.held] = False
            # CVODE takes no empty state
            stays[0] |= not stays.any()
            self._order = self._order[stays[self._order]]
        self.start = self.pick(segment.y)

    def pick(self, values: Array) -> Array:
        """Return what belongs to the states that are integrated."""
        return values if self._is_all else values[self._order]

    def expand(self, taus: Array, states: Array) -> Array:
        """Return all states (rows)."""
        if self._is_all:
            return states
        full = np.zeros((taus.size, self._segment.y.size))
        full[:, self._order] = states
        self._segment.exact_velocities(taus, full)
        return full

    def expanded(self, reached: Reached) -> Reached:
        """Return the same points with all states."""
        if self._is_all:
            return reached
        assert reached.inner is not None
        steps, places, size = reached.inner.shape
        times = within(reached.taus, places).ravel()
        inner = self.expand(times, reached.inner.reshape(-1, size)) if times.size else np.empty(0)
        states = self.expand(reached.taus, reached.states)
        inner = inner.reshape(steps, places, states.shape[1])
        return Reached(reached.taus, states, reached.hit, inner=inner)

    def _expand_one(self, tau: float, y: Array) -> Array:
        if self._is_all:
            return y
        if self._order.size < self._segment.y.size:
            return self.expand(np.array([tau]), y[None, :])[0]
        full = np.empty_like(y)
        full[self._order] = y
        return full

    def rate(self, tau: float, y: Array) -> Array:
        """Return the rates."""
        return self.pick(self._segment.rate(tau, self._expand_one(tau, y)))

    def smallest_guard(self, tau: float, y: Array) -> float:
        """Return the smallest guard."""
        return float(self._segment.guards(tau, self._expand_one(tau, y)).min(initial=np.inf))

    def jacobian(self, tau: float, y: Array) -> Any:
        """Return the Jacobian."""
        matrix = self._segment.jacobian(tau, self._expand_one(tau, y))
        return matrix if self._is_all else matrix[self._order][:, self._order]


def _shortest(values: Array) -> float | Array:
    """Return one number where all are equal: a long vector of tolerances takes long to check."""
    return float(values[0]) if np.all(values == values[0]) else values
