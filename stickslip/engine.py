"""The seam to SUNDIALS: start at a state, advance to the next root or stop. The only importer of sksundae."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from sksundae.cvode import CVODE

from stickslip.scan import first_dip, first_violation, longest_look
from stickslip.segment import Segment

__all__ = ["Engine", "Reached", "SolverFailure", "Work"]

Array = NDArray[np.float64]
Guard = Callable[[float, Array], float]

_ROOTS_PER_SOLVER = 20
_DENSE_LIMIT = 100
STEPS_PER_PERIOD = 8
LOCAL = 0.1
"""Local error allowed per step, as a part of the tolerance asked for: what a run of steps adds up is larger."""


class SolverFailure(Exception):
    """The solver gave up.

    Parameters
    ----------
    tau : float
        Local time reached.
    status : int
        SUNDIALS' return code.
    sentence : str
        SUNDIALS' message for it.
    """

    def __init__(self, tau: float, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.tau, self.status, self.sentence = tau, status, sentence


@dataclass
class Work:
    """Counts of what was done."""

    steps: int = 0
    rate_calls: int = 0
    jacobian_calls: int = 0
    guard_calls: int = 0
    starts: int = 0
    solvers: int = 0
    fewest_states: float = np.inf


@dataclass(frozen=True)
class Reached:
    """Computed points of a segment, the first at its start; `hit` tells whether the last is at a root.

    Where the contact forces are unknowns of their own, `multipliers` holds them and their slopes.
    """

    taus: Array
    states: Array
    hit: bool
    multipliers: tuple[Array, Array] | None = None

    def until(self, count: int) -> Reached:
        """Return the first `count` points."""
        forces = self.multipliers
        cut = None if forces is None else (forces[0][:count], forces[1][:count])
        return Reached(self.taus[:count], self.states[:count], False, cut)


class _Cvode:
    """A CVODE solver that serves one segment after another."""

    def __init__(self, make: Callable[[Callable[..., None]], CVODE], work: Work) -> None:
        self._make, self._work = make, work
        self._solver: CVODE | None = None
        self._roots = 0

    def advance(self, guard: Guard, y: Array, tau: float) -> Reached:
        """Integrate from local time 0 to `tau` or to the first root of the smallest guard."""
        solution = self._ready(guard).solve(np.array([0.0, tau]), y)
        self._work.steps += solution.t.size - 1
        return Reached(solution.t.copy(), solution.y.copy(), self._counted(solution, float(solution.t[-1])))

    def leap(self, guard: Guard, y: Array, tau: float) -> tuple[float, bool]:
        """Do the same, but return only the time reached and whether it is at a root."""
        solver = self._ready(guard)
        solver.init_step(0.0, y)
        solution = solver.step(tau, "normal", tau)
        self._work.steps += 1
        return solution.t, self._counted(solution, solution.t)

    def _ready(self, guard: Guard) -> CVODE:
        self._guard = guard
        if self._solver is None or self._roots >= _ROOTS_PER_SOLVER:
            # scikit-sundae keeps every event's record on the guard function: a fresh one now and then
            self._solver, self._roots = self._make(self._guard_function()), 0
            self._work.solvers += 1
        self._work.starts += 1
        return self._solver

    def _counted(self, solution: Any, tau: float) -> bool:
        work = self._work
        work.rate_calls += solution.nfev
        work.jacobian_calls += solution.njev
        if solution.status < 0:
            raise SolverFailure(tau, solution.status, solution.message)
        self._roots += solution.status == 2
        return solution.status == 2

    def _guard_function(self) -> Callable[..., None]:
        def smallest_guard(tau: float, y: Array, out: Array) -> None:
            self._work.guard_calls += 1
            smallest = self._guard(tau, y)
            if smallest != smallest:
                raise FloatingPointError(f"a guard is not a number at local time {tau:g}")
            out[0] = smallest if smallest < np.inf else 1.0

        return smallest_guard


class Engine:
    """CVODE for the segments of one simulation.

    Where the motion is exactly quadratic in time there is nothing to integrate: CVODE then runs on a clock,
    ``tau' = 1``, in as few steps as there are roots to find.

    Parameters
    ----------
    size : int
        Number of states.
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
        self, size: int, method: str, rtol: float, atol: Array, max_step: float, merged: bool = False
    ) -> None:
        self._size, self._method = size, method
        self._rtol, self._atol = LOCAL * rtol, LOCAL * atol
        self._max_step, self._merged = max_step, merged
        self.work = Work()
        self._clock = _Cvode(self._make_clock, self.work)
        self._steppers: dict[Any, _Cvode] = {}
        self._pattern: Any = None
        self._segment: Segment

    def advance(self, segment: Segment, horizon: float) -> Reached:
        """Follow a segment to its first event or to local time `horizon`, whichever comes first."""
        self._segment = segment
        return self._on_clock(segment, horizon) if segment.quadratic else self._by_steps(segment, horizon)

    # -- quadratic motion ---------------------------------------------------------------------------------

    def _make_clock(self, guard: Callable[..., None]) -> CVODE:
        def rate(tau: float, y: Array, out: Array) -> None:
            out[0] = 1.0

        return CVODE(
            rate,
            eventsfn=guard,
            num_events=1,
            linsolver="band",
            lband=0,
            uband=0,
            first_step=0.5 * np.finfo(float).max,
            max_step=self._max_step if np.isfinite(self._max_step) else 0.0,
        )

    def _on_clock(self, segment: Segment, horizon: float) -> Reached:
        stop = first_violation(segment, min(horizon, longest_look(segment)))
        guard, start = segment.smallest_guard(), np.zeros(1)
        points = np.isfinite(self._max_step)
        while True:
            if points:
                reached = self._clock.advance(guard, start, stop)
                taus, hit = reached.taus, reached.hit
            else:
                tau, hit = self._clock.leap(guard, start, stop)
                taus = np.array([0.0, tau])
            # CVODE locates roots within 1e-14 of its step: come closer where the step was far too long
            if not hit or taus[-1] > 0.1 * stop:
                break
            stop = max(4 * float(taus[-1]), np.finfo(float).tiny)
        return Reached(taus, segment.state(taus).T, hit)

    # -- everything else ----------------------------------------------------------------------------------

    def _by_steps(self, segment: Segment, horizon: float) -> Reached:
        self._states = _States(segment) if self._merged else _AllStates(segment)
        self.work.fewest_states = min(self.work.fewest_states, self._states.start.size)
        stepper = self._stepper(segment)
        guards = self._states.guards

        def guard(tau: float, y: Array) -> float:
            return float(guards(tau, y).min(initial=np.inf))

        while True:
            reached = stepper.advance(guard, self._states.start, horizon)
            states = self._states.expand_many(reached.taus, reached.states)
            missed = first_dip(segment, reached.taus, states, reached.hit)
            if missed is None:
                return Reached(reached.taus, states, reached.hit)
            horizon = missed

    def _stepper(self, segment: Segment) -> _Cvode:
        max_step = self._max_step
        if segment.has_curved:
            max_step = min(max_step, segment.system.loads.period / STEPS_PER_PERIOD)
        size = self._states.start.size
        if self._size > _DENSE_LIMIT:
            self._widen_pattern(segment)
        stepper = self._steppers.get((max_step, size))
        if stepper is None:
            stepper = self._steppers[max_step, size] = _Cvode(
                lambda guard: self._make_stepper(guard, self._options(max_step)), self.work
            )
        return stepper

    def _options(self, max_step: float) -> dict[str, Any]:
        options: dict[str, Any] = {
            "method": self._method,
            "rtol": self._rtol,
            "atol": _shortest(self._states.pick(self._atol)),
            "max_step": max_step if np.isfinite(max_step) else 0.0,
        }
        if self._pattern is None:
            return options | {"jacfn": self._dense_jacobian}
        return options | {"jacfn": self._sparse_jacobian, "linsolver": "sparse", "sparsity": self._pattern}

    def _make_stepper(self, guard: Callable[..., None], options: dict[str, Any]) -> CVODE:
        def rate(tau: float, y: Array, out: Array) -> None:
            out[:] = self._states.rate(tau, y)

        with warnings.catch_warnings():
            # giving the pattern together with the exact Jacobian is meant
            warnings.simplefilter("ignore", UserWarning)
            return CVODE(rate, eventsfn=guard, num_events=1, **options)

    def _dense_jacobian(self, tau: float, y: Array, rate: Array, out: Array) -> None:
        matrix = self._states.jacobian(tau, y)
        out[:] = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()

    def _sparse_jacobian(self, tau: float, y: Array, rate: Array, out: Array) -> None:
        matrix = sparse.coo_array(self._states.jacobian(tau, y))
        out[:] = 0.0
        out[np.searchsorted(self._places, _place(matrix))] = matrix.data

    def _widen_pattern(self, segment: Segment) -> None:
        """Let the sparsity pattern hold this segment's Jacobian; solvers of a narrower pattern are let go."""
        matrix = sparse.coo_array(self._states.jacobian(0.0, self._states.start))
        known = self._pattern if self._pattern is not None and self._pattern.shape == matrix.shape else None
        if known is not None and np.isin(_place(matrix), self._places).all():
            return
        pattern = abs(matrix) + sparse.eye_array(matrix.shape[0])
        pattern = sparse.csc_array(pattern if known is None else pattern + known)
        pattern.sort_indices()
        pattern.data[:] = 1.0
        self._pattern, self._places = pattern, _place(pattern.tocoo())
        self._steppers.clear()


class _AllStates:
    """The states of a segment as CVODE sees them: all of them (static structure)."""

    def __init__(self, segment: Segment) -> None:
        self.start, self.guards = segment.y, segment.guards
        self.rate, self.jacobian = segment.rate, segment.jacobian

    def pick(self, values: Array) -> Array:
        """Return what belongs to the states that are integrated."""
        return values

    def expand_many(self, taus: Array, states: Array) -> Array:
        """Return all states (rows)."""
        return states


class _States:
    """One velocity for each stuck group, none for what is held (dynamic structure, Breedveld 2000, figs. 4 and 5)."""

    def __init__(self, segment: Segment) -> None:
        self._segment, mode_set = segment, segment.mode_set
        stays = np.ones(segment.y.size, dtype=bool)
        stays[mode_set.follow] = stays[mode_set.held] = False
        self._stays = np.flatnonzero(stays)
        self.start = segment.y[self._stays]

    def pick(self, values: Array) -> Array:
        """Return what belongs to the states that are integrated."""
        return values[self._stays]

    def _expand(self, tau: float, y: Array) -> Array:
        return self.expand_many(np.array([tau]), y[None, :])[0]

    def expand_many(self, taus: Array, states: Array) -> Array:
        """Return all states (rows)."""
        full = np.zeros((taus.size, self._segment.y.size))
        full[:, self._stays] = states
        self._segment.exact_velocities(taus, full)
        return full

    def rate(self, tau: float, y: Array) -> Array:
        """Return the rates of the states that are left."""
        return self._segment.rate(tau, self._expand(tau, y))[self._stays]

    def guards(self, tau: float, y: Array) -> Array:
        """Return the guards."""
        return self._segment.guards(tau, self._expand(tau, y))

    def jacobian(self, tau: float, y: Array) -> Any:
        """Return the Jacobian of the states that are left."""
        return self._segment.jacobian(tau, self._expand(tau, y))[self._stays][:, self._stays]


def _shortest(values: Array) -> float | Array:
    """Return one number where all are equal: a long vector of tolerances takes long to check."""
    return float(values[0]) if np.all(values == values[0]) else values


def _place(matrix: Any) -> NDArray[np.int64]:
    """Return where the entries of a matrix stand in column-major order."""
    return matrix.col.astype(np.int64) * matrix.shape[0] + matrix.row
