"""CVODE for motions of any kind: integrate to the first root of the smallest guard."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.engines.dips import first_dip
from stickslip.engines.linear_solver import LinearSolver, band_order
from stickslip.engines.replay import Replay, first_step
from stickslip.engines.sundials import CVODE
from stickslip.engines.work import (
    LOOK_AT_SCENE,
    Interrupted,
    Interruption,
    Progress,
    SolverFailure,
    Work,
    failure_of,
    sound,
)
from stickslip.equations.guards import Guards
from stickslip.equations.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System

__all__ = ["LOCAL", "STEPS_PER_PERIOD", "Cvode", "protected", "without_dips"]

Array = NDArray[np.float64]

STEPS_PER_PERIOD = 8
LOCAL = 0.1
"""Local error allowed per step, as a part of the tolerance asked for: what a run of steps adds up is larger."""

_ROOTS_PER_SOLVER = 20
"""scikit-sundae keeps every event's record on the guard function: a fresh solver now and then."""


_CAREFUL, _SHORTEST = 1e-4, 1e-8
"""First steps of solvers as parts of those that a motion may begin with: of a new one, and of one that is there."""

_Steps = tuple[float, float]
"""Longest and first step in s."""


class Cvode:
    """CVODE for the motions of one simulation.

    Parameters
    ----------
    system : System
    loads : Loads
    method : str
        "BDF" or "Adams".
    rtol : float
    atol : array (size,)
        Tolerances of the states.
    max_step : float
        Longest step in s, infinite for none.
    merged : bool
        Integrate the independent velocities only: the state shrinks and grows (Breedveld 2000, figs. 4 and 5).
    work : Work
    interruption : Interruption
    """

    def __init__(
        self,
        system: System,
        loads: Loads,
        method: str,
        rtol: float,
        atol: Array,
        max_step: float,
        merged: bool,
        work: Work,
        interruption: Interruption,
    ) -> None:
        self._method, self._order, self._period = method, band_order(system), loads.period
        self._rtol, self._atol = LOCAL * rtol, LOCAL * atol
        self._max_step, self._merged = max_step, merged
        self.work, self._interruption = work, interruption
        self.show: Callable[[float], None] | None = None
        self._linear_solver = LinearSolver()
        self._solvers: dict[_Steps, tuple[Any, Any]] = {}
        self._roots: dict[_Steps, int] = {}
        self._replay = Replay(self._rate, self._jacobian)
        self._motion: _Selected
        self._guards: Guards
        self._progress: Progress

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Follow a motion to its first event or to local time `horizon`, whichever comes first."""
        self._motion, self._guards = _Selected(motion, self._order, self._merged), guards

        def solve(tau: float) -> Path:
            self._progress = Progress(tau, self._interruption, self.show)
            return self._solve(tau)

        return without_dips(
            motion, guards, lambda tau: protected(motion, solve, tau, self._interruption, self._last), horizon
        )

    def _last(self) -> float:
        return self._progress.last

    def _solve(self, tau: float) -> Path:
        selected, work = self._motion, self.work
        key, pair = self._solver(selected.motion)
        work.starts += 1
        tolerance = self._rtol, selected.pick(self._atol)
        taken = self._replay.take(*pair, tau, selected.start, self._method, tolerance)
        solution = taken.last
        work.steps += taken.taus.size - 1
        work.rate_calls += solution.nfev
        work.jacobian_calls += solution.njev
        self._roots[key] = self._roots.get(key, 0) + (solution.status == 2)
        path = selected.whole(taken.taus, taken.coefficients, taken.state, solution.status == 2)
        if solution.status < 0:
            raise failure_of(solution, path)
        fine = np.isfinite(taken.coefficients).all(axis=(1, 2))
        if not fine.all():
            raise SolverFailure(
                "the states have become infinite or not a number",
                "look at the forces and laws of the scene there",
                path.until(int(fine.argmin())),
            )
        return path

    def _solver(self, motion: Motion) -> tuple[_Steps, tuple[Any, Any]]:
        max_step = self._max_step
        if not motion.stretch.is_straight:
            max_step = min(max_step, self._period / STEPS_PER_PERIOD)
        if self._linear_solver.hold(self._motion.jacobian(0.0, self._motion.start)):
            self._solvers.clear()
        selected = self._motion
        tolerance = self._rtol, selected.pick(self._atol)
        bend = selected.pick(2.0 * motion.start.y[2])
        first = first_step(bend, selected.start, tolerance, motion.horizon)
        # CVODE's second step may be 10 000 times the first: a solver that starts carefully serves many motions
        fit = [x for m, x in self._solvers if m == max_step and _SHORTEST * first <= x <= first]
        key = max_step, fit[0] if fit else _CAREFUL * first
        if key not in self._solvers or self._roots.get(key, 0) >= _ROOTS_PER_SOLVER:
            self._solvers[key], self._roots[key] = self._make(*key), 0
            self.work.solvers += 1
        return key, self._solvers[key]

    # -- what the solver calls -------------------------------------------------------------------------------

    def _rate(self, tau: float, y: Array, out: Array) -> None:
        self._progress.note(tau)
        out[:] = self._motion.rate(tau, y)

    def _jacobian(self, tau: float, y: Array, rate: Array, out: Array) -> None:
        self._linear_solver.fill(self._motion.jacobian(tau, y), out)

    def _make(self, max_step: float, first: float) -> tuple[Any, Any]:
        """Return a solver that stops at guards, and one that takes the same steps again."""
        replay = self._replay

        def rate(tau: float, y: Array, out: Array) -> None:
            replay.rate(tau, y, out)

        def known_rate(tau: float, y: Array, out: Array) -> None:
            replay.known_rate(tau, y, out)

        def jacobian(tau: float, y: Array, rate: Array, out: Array) -> None:
            self._jacobian(tau, y, rate, out)

        def known_jacobian(tau: float, y: Array, rate: Array, out: Array) -> None:
            replay.known_jacobian(tau, y, rate, out)

        def smallest_guard(tau: float, y: Array, out: Array) -> None:
            self.work.guard_calls += 1
            # a guard that is found negative ends the motion
            pressed = self._interruption.pressed
            out[0] = -1.0 if pressed else sound(self._guards.smallest(tau, self._motion.expand(tau, y)), tau)

        options: dict[str, Any] = {
            "method": self._method,
            "rtol": self._rtol,
            "atol": _shortest(self._motion.pick(self._atol)),
            "max_step": max_step if np.isfinite(max_step) else 0.0,
            "first_step": first,
            **self._linear_solver.options(),
        }
        with warnings.catch_warnings():
            # giving the pattern together with the exact Jacobian is meant
            warnings.simplefilter("ignore", UserWarning)
            solver = CVODE(rate, eventsfn=smallest_guard, num_events=1, jacfn=jacobian, **options)
            return solver, CVODE(known_rate, jacfn=known_jacobian, **options)


class _Selected:
    """The states of a motion as CVODE sees them: all, or reordered, or without the dependent velocities."""

    def __init__(self, motion: Motion, order: NDArray[np.intp] | None, merged: bool) -> None:
        self.motion = motion
        size = motion.y.size
        self._order = np.arange(size) if order is None else order
        self._is_all = order is None and not merged
        self._is_part = False
        if merged:
            stays = np.ones(size, dtype=bool)
            stays[motion.equations.dependent] = False
            # CVODE takes no empty state
            stays[0] |= not stays.any()
            self._order = self._order[stays[self._order]]
            self._is_part = True
        self.start = self.pick(motion.y)

    def pick(self, values: Array) -> Array:
        """Return what belongs to the states that are integrated."""
        return values if self._is_all else values[self._order]

    def expand(self, tau: float, y: Array) -> Array:
        """Return the whole state."""
        if self._is_all:
            return y
        full = np.zeros(self.motion.y.size)
        full[self._order] = y
        return self.motion.exact(tau, full) if self._is_part else full

    def whole(self, taus: Array, coefficients: Array, last: Array, hit: bool) -> Path:
        """Return a path with all states."""
        if not self._is_all:
            full = np.zeros((*coefficients.shape[:2], self.motion.y.size))
            full[:, :, self._order] = coefficients
            coefficients = full
        state = self.expand(float(taus[-1]), last)
        return Path(taus, coefficients, self.motion.exact(float(taus[-1]), state), hit, True)

    def rate(self, tau: float, y: Array) -> Array:
        """Return the rates."""
        return self.pick(self.motion.rate(tau, self.expand(tau, y)))

    def jacobian(self, tau: float, y: Array) -> Any:
        """Return the Jacobian."""
        matrix = self.motion.jacobian(tau, self.expand(tau, y))
        return matrix if self._is_all else matrix[self._order][:, self._order]


def without_dips(motion: Motion, guards: Guards, solve: Callable[[float], Path], horizon: float) -> Path:
    """Advance to the first event, also where it lies between computed points."""
    while True:
        path = solve(horizon)
        missed = first_dip(motion, guards, path)
        if missed is None:
            return path
        if missed >= path.taus[-1]:
            # a root at the very end is none for the solver, however often it is sent there
            return replace(path, hit=True)
        horizon = missed


def protected(
    motion: Motion,
    solve: Callable[[float], Path],
    horizon: float,
    interruption: Interruption,
    last: Callable[[], float],
) -> Path:
    """Advance; where that fails or is interrupted, hand over what was computed before."""
    try:
        path = solve(horizon)
    except (ArithmeticError, ValueError) as fault:
        # a load or a law failed inside the solver, which forgets its points: go there again, but stop short
        size = motion.y.size
        path = Path(np.zeros(1), np.empty((0, 1, size)), motion.y, False, True)
        short = 0.9 * last()
        if short > 0:
            with contextlib.suppress(Exception):
                path = solve(short)
        raise SolverFailure(str(fault), LOOK_AT_SCENE, path) from fault
    if interruption.pressed:
        raise Interrupted(path)
    return path


def _shortest(values: Array) -> float | Array:
    """Return one number where all are equal: a long vector of tolerances takes long to check."""
    return float(values[0]) if np.all(values == values[0]) else values
