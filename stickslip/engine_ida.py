"""The multiplier formulation: contact forces as unknowns of an index-1 DAE, solved by IDA.

Breedveld (2000), figs. 2 and 3: in stick mode one inertia depends on the other. With ``G_S`` the rows of the stuck
contacts, ``M v' = F - G_S^T lambda`` and ``G_S v' + D_S u' = 0``; inserting the first into the second makes it an
algebraic equation for lambda, of index 1.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stickslip.engine import STEPS_PER_PERIOD, Engine
from stickslip.engine_sundials import IDA
from stickslip.linear_solver import sparsity_pattern
from stickslip.progress import Interruption, Progress
from stickslip.segment import Segment
from stickslip.solving import Reached, failure_of, guard_value

__all__ = ["OF_FORCES", "MultiplierEngine"]

Array = NDArray[np.float64]

_DENSE_LIMIT = 100
OF_FORCES = 100.0
"""How much looser forces are judged than states: they follow from these, and nothing adds up their errors."""


class MultiplierEngine(Engine):
    """IDA for the segments of one simulation; unknowns are the states and the forces of the stuck contacts."""

    def advance(self, segment: Segment, horizon: float) -> Reached:
        """Follow a segment to its first event or to local time `horizon`, whichever comes first."""
        equations = _Equations(segment)
        return self._without_dips(segment, lambda tau: self._solve(segment, equations, tau), horizon)

    def _solve(self, segment: Segment, equations: _Equations, horizon: float) -> Reached:
        equations.progress = self._progress
        with warnings.catch_warnings():
            # giving the pattern together with the exact Jacobian is meant
            warnings.simplefilter("ignore", UserWarning)
            solver = IDA(equations.residual, **self._ida_options(segment, equations))
        solution = solver.solve(np.array([0.0, horizon]), equations.start, equations.start_rate)
        work = self.work
        work.solvers += 1
        work.starts += 1
        work.rate_calls += solution.nfev
        work.jacobian_calls += solution.njev
        work.guard_calls += equations.guard_calls
        work.steps += solution.t.size - 1
        size = segment.y.size
        forces = (solution.y[:, size:].copy(), solution.yp[:, size:].copy())
        reached = Reached(solution.t.copy(), solution.y[:, :size].copy(), solution.status == 2, forces)
        if solution.status < 0:
            raise failure_of(solution, reached)
        return reached

    def _ida_options(self, segment: Segment, equations: _Equations) -> dict[str, Any]:
        max_step = self._max_step
        if segment.has_curved:
            max_step = min(max_step, segment.system.loads.period / STEPS_PER_PERIOD)
        # IDA tests the error of the forces too: judge them by what they are compared with, but no finer than the
        # roundoff of the forces that they balance, which a contact that is just being closed would have it do
        of_forces = np.maximum(OF_FORCES * self._rtol * equations.force_scale, equations.force_noise)
        of_forces[of_forces == 0] = self._atol.min()
        atol = np.concatenate([self._atol, of_forces])
        options: dict[str, Any] = {
            "rtol": self._rtol,
            "atol": atol,
            "max_step": max_step if np.isfinite(max_step) else 0.0,
            "algebraic_idx": list(range(segment.y.size, equations.start.size)) or None,
            "eventsfn": equations.guard_function(self.interruption),
            "num_events": 1,
            "jacfn": equations.jacobian,
            "max_num_steps": 100_000,
        }
        if equations.pattern is not None:
            options |= {"linsolver": "sparse", "sparsity": equations.pattern}
        return options


class _Equations:
    """Residual, Jacobian and guards of a segment, assembled without reducing anything."""

    def __init__(self, segment: Segment) -> None:
        self._segment, mode_set, system = segment, segment.mode_set, segment.system
        self._system, self._mode_set = system, mode_set
        self._G, self._D = system.G[mode_set.stuck], system.D[mode_set.stuck]
        self._pushed, self._C = system.force_of_contacts, system.C
        if system.sparse:
            self._GM = self._G @ sparse.diags_array(1.0 / system.inertia)
            self._gram = self._with_null_space((self._GM @ self._G.T).toarray())
        else:
            self._GM = self._G / system.inertia
            self._gram = self._with_null_space(self._GM @ self._G.T)
        self._first_force = segment.y.size
        force = segment.watched(0.0, segment.y)[segment.slips : segment.slips + mode_set.stuck.size]
        slope = segment.held_terms[1][: mode_set.stuck.size]
        self.start = np.concatenate([segment.y, force])
        self.start_rate = np.concatenate([segment.f0, slope])
        # a level may be 0 one way
        level = np.abs(segment.levels(0.0)).reshape(2, -1).max(axis=0)[: mode_set.stuck.size]
        self.force_scale = level + np.abs(force)
        self.force_noise = segment.guard_scales[1][segment.slips :][: mode_set.stuck.size]
        self.guard_calls = 0
        self.progress: Progress
        self._place_jacobian()

    def _with_null_space(self, gram: Array) -> Array:
        """Add ``Z Z^T`` over the directions in which forces are not unique: the solution has the least norm."""
        if not self._mode_set.groups.redundant:
            return gram
        incidence = self._G if isinstance(self._G, np.ndarray) else self._G.toarray()
        values, vectors = np.linalg.eigh(incidence @ incidence.T)
        free = vectors[:, values < 1e-9 * values.max()]
        return gram + free @ free.T * np.trace(gram) / gram.shape[0]

    def _forces(self, tau: float, y: Array) -> Array:
        """Return all forces on the bodies but those of the stuck contacts."""
        segment, system, mode_set = self._segment, self._system, self._mode_set
        q = segment.inputs(tau)
        friction = mode_set.kinetic * np.maximum(q[: system.m], 0.0)
        if segment.has_law:
            friction[mode_set.acting] = segment.acting_forces(tau, y)
        return self._C @ y + system.Q @ q + self._pushed @ friction

    def residual(self, tau: float, u: Array, rate: Array, out: Array) -> None:
        """Fill in ``M v' - F + G_S^T lambda``, the other states' rates, and the constraint on lambda."""
        self.progress.note(tau)
        segment, system = self._segment, self._system
        n, size = system.n, self._first_force
        y, force = u[:size], u[size:]
        acting = self._forces(tau, y)
        out[:n] = system.inertia * rate[:n] - acting + self._G.T @ force
        if size > n:
            out[n:size] = rate[n:size] - segment.rate(tau, y)[n:]
        out[size:] = self._gram @ force - self._GM @ acting - self._D @ segment.drive_acceleration(tau)

    def _place_jacobian(self) -> None:
        self.pattern: Any = None
        total = self.start.size
        if total <= _DENSE_LIMIT:
            self._constant = self._blocks(self._segment.y, 0.0).toarray()
            return
        self.pattern, self._places = sparsity_pattern(
            abs(self._blocks(self._segment.y, 0.0)) + sparse.eye_array(total)
        )

    def _blocks(self, y: Array, tau: float) -> Any:
        """Return the part of the Jacobian that does not belong to the rates."""
        segment, system, mode_set = self._segment, self._system, self._mode_set
        n = system.n
        by_state = sparse.csr_array(self._C)
        if segment.has_law:
            rows = sparse.csr_array(system.W)[mode_set.acting]
            slopes = mode_set.law.slopes(*segment.acting_terms(tau, y))
            pushed = sparse.csc_array(self._pushed)[:, mode_set.acting]
            by_state = by_state + pushed @ sparse.diags_array(slopes) @ rows
        others = sparse.csr_array(segment.jacobian(tau, y))[n:]
        if not self._mode_set.stuck.size:
            return sparse.vstack([-by_state, -others], format="csr")
        return sparse.block_array(
            [
                [-by_state, sparse.csr_array(self._G.T)],
                [-others, None],
                [-(sparse.csr_array(self._GM) @ by_state), sparse.csr_array(self._gram)],
            ],
            format="csr",
        )

    def jacobian(self, tau: float, u: Array, rate: Array, residual: Array, cj: float, out: Array) -> None:
        """Fill in ``dR/du + cj dR/du'``."""
        size, n = self._first_force, self._system.n
        diagonal = np.concatenate([self._system.inertia, np.ones(size - n), np.zeros(u.size - size)])
        if self.pattern is None:
            out[:] = self._blocks(u[:size], tau).toarray() if self._segment.has_law else self._constant
            out[np.arange(u.size), np.arange(u.size)] += cj * diagonal
            return
        matrix = self._blocks(u[:size], tau) + sparse.diags_array(cj * diagonal)
        coo = sparse.coo_array(matrix)
        out[:] = 0.0
        out[np.searchsorted(self._places, coo.col.astype(np.int64) * u.size + coo.row)] = coo.data

    def guard_function(self, interruption: Interruption) -> Callable[..., None]:
        """Return the smallest guard, read off the multipliers."""
        segment, size = self._segment, self._first_force
        slips, stuck = segment.slips, self._mode_set.stuck.size

        def smallest_guard(tau: float, u: Array, rate: Array, out: Array) -> None:
            self.guard_calls += 1
            if interruption.pressed:
                # a guard that is found negative ends the segment
                out[0] = -1.0
                return
            z = segment.watched(tau, u[:size])
            z[slips : slips + stuck] = u[size:]
            out[0] = guard_value(float(segment.armed_guards(tau, z).min(initial=np.inf)), tau)

        return smallest_guard
