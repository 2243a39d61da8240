"""The multiplier formulation: held forces as unknowns of an index-1 DAE, solved by IDA.

Breedveld (2000), figs. 2 and 3: in stick mode one inertia depends on the other. With ``G_H`` the held rows,
``M v' + G_H^T lambda = F`` and ``G_H v' + D_H u' = 0``: the balance itself is the residual. Where rows lock the same
motion, ``Z Z^T lambda`` enters the second equation, with Z the directions in which forces are not unique: so the forces
have the least norm.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
import scipy

from stickslip.engines.base import Method, Task
from stickslip.engines.progress import Progress
from stickslip.engines.solvers.faults import Faults
from stickslip.engines.solvers.follow import LookAhead, Lookout, first_step, follow, longest_step
from stickslip.engines.solvers.linear_solver import on_pattern, sparsity_pattern
from stickslip.engines.solvers.sundials import IDA
from stickslip.engines.solvers.through_points import path_through
from stickslip.engines.solvers.tolerances import SolverTolerances, noise_of_led
from stickslip.engines.work import Work, solved
from stickslip.equations.algebra.matrices import MatrixBlock, assembled, dense
from stickslip.equations.balance import component_numbers, self_stress
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.model.arrays import Array, Indices

_DENSE_LIMIT = 100

# Tolerance of forces over that of states. Forces follow from the states, so that their errors do not add up.
#
# Guards and results do not use the forces of IDA: they take those that the balance gives in the same state.
_OF_FORCES = 100.0


# Over the first step that IDA itself would choose, a motion changes by this part of its tolerance.
_OWN_STEP = 0.5


class Ida:
    """IDA for the motions of one simulation."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._tolerances = SolverTolerances(task)
        self.work, self._look_ahead = Work(), LookAhead()

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Follow a motion to its first event or to local time `horizon`, whichever comes first."""
        equations = _Residual(motion)

        def solve(tau: float, progress: Progress) -> Path:
            return self._solve(motion, guards, equations, tau, progress)

        return follow(motion, guards, horizon, solve, self._task.interruption, self._look_ahead)

    def _solve(self, motion: Motion, guards: Guards, equations: _Residual, horizon: float, progress: Progress) -> Path:
        size, work = motion.y.size, self.work
        lookout = Lookout(guards, self._task.interruption, work, self._look_ahead, self._tolerances)
        faults = Faults(waits=equations.pattern is not None)

        def residual(tau: float, u: Array, rate: Array, out: Array) -> None:
            progress.note(tau)
            equations.residual(tau, u, rate, out)

        def smallest_guard(tau: float, u: Array, rate: Array, out: Array) -> None:
            out[0] = lookout.at(tau, u[:size], u)

        tolerance, options = self._tolerances.now, self._options(motion, equations, horizon)
        solver = IDA(
            faults.of_rates(residual),
            jacfn=faults.of_jacobian(equations.jacobian, equations.unit),
            eventsfn=smallest_guard,
            num_events=1,
            **options,
        )
        solution = solver.solve(np.array([0.0, horizon]), equations.start, equations.start_rate)
        faults.check()
        taus, points = lookout.points_of(solution)
        work.solvers += 1
        work.steps += taus.size - 1
        work.rate_calls += solution.nfev
        work.jacobian_calls += solution.njev
        path = path_through(motion, taus, points[:, :size].copy(), tolerance, "BDF", lookout.found)
        return solved(solution, path)

    def _first_step(self, motion: Motion) -> float:
        """Return a length in s for the first step, 0 for the one that IDA itself would choose.

        Over that step the motion changes by half its tolerance. From rest it is so long that IDA gives up before its
        steps are short enough.
        """
        rtol, atol = self._tolerances.now
        with np.errstate(all="ignore"):
            pace = np.abs(motion.first.y[1]) / (rtol * np.abs(motion.y) + atol)
        longest = first_step(motion, rtol, atol)
        return 0.0 if pace.max(initial=0.0) * longest >= _OWN_STEP else longest

    def _options(self, motion: Motion, equations: _Residual, horizon: float) -> dict[str, Any]:
        # IDA tests the errors of the forces, too. Their tolerance is a part of the largest forces in the balance, and
        # never finer than a force that would change a velocity by its tolerance within the motion. The force of the
        # row itself is no scale: it is 0 for a contact that is just being closed, or that nothing pushes.
        (rtol, atol), (asked, least) = self._tolerances.now, self._tolerances.asked
        of_forces = np.maximum(_OF_FORCES * asked * equations.force_scale, least[0] * equations.impulse_scale / horizon)
        if motion.segment.has_functions and motion.roughness is not None:
            (_, watched), n, m = motion.roughness[0], motion.system.n, motion.system.m
            atol = np.append(np.maximum(atol[:n], noise_of_led(motion, horizon)[1]), atol[n:])
            of_forces = np.maximum(of_forces, watched[m : m + of_forces.size])
        options: dict[str, Any] = {
            "rtol": rtol,
            "atol": np.concatenate([atol, of_forces]),
            "max_step": longest_step(motion, self._task.max_step, self._task.loads.period),
            "first_step": self._first_step(motion),
            "algebraic_idx": list(range(motion.y.size, equations.start.size)) or None,
            "max_num_steps": 100_000,
        }
        if equations.pattern is not None:
            options |= {"linsolver": "sparse", "sparsity": equations.pattern}
        return options


class _Residual:
    """Residual and Jacobian of a motion in all states and all held forces: none is eliminated."""

    def __init__(self, motion: Motion) -> None:
        self._motion, system = motion, motion.system
        held = motion.equations.held
        self._system, self._size = system, motion.y.size
        self._G, self._D = system.G[held], system.D[held]
        start = motion.start
        force = start.z[0, system.m : system.m + held.size]
        self.start = np.concatenate([motion.y, force])
        self.start_rate = np.concatenate([start.y[1], start.z[1, system.m : system.m + held.size]])
        self._scale_forces(force)
        self._null = self._null_space(held)
        self._place_jacobian()

    def _null_space(self, held: Indices) -> Array | None:
        """Return the projector on the directions in which forces are not unique, rows scaled as for the least norm.

        It is scaled so that it turns forces into accelerations as large as such forces would cause.
        """
        if not self._motion.equations.balance.has_loops:
            return None
        scale = self._system.largest_lever[held]
        free = self_stress(self._G, scale)
        part = component_numbers(self._G)
        mobility = np.zeros(part.max() + 1)
        np.maximum.at(mobility, part, 1.0 / (self.impulse_scale * scale**2))
        # the least norm is that of lambda * scale
        return np.asarray(free @ free.T * (mobility[part] * scale)[:, None] * scale)

    def _scale_forces(self, force: Array) -> None:
        motion, system = self._motion, self._system
        held, m = motion.equations.held, system.m
        # the summed sizes of their terms: as a row breaks away the forces on its bodies may cancel
        _, sizes = motion.majorants(1)[0]
        largest = sizes[m : m + held.size].max(initial=0.0)
        levels = system.largest_coefficient[held]
        for tau in (0.0, 0.5 * motion.horizon, motion.horizon):
            # a load that fails at this time fails again when the solver comes to it
            with contextlib.suppress(ArithmeticError, ValueError):
                normal = motion.normals(tau, motion.y)[held]
                largest = max(largest, float((levels * normal).max(initial=0.0)))
        self.force_scale = np.maximum(np.abs(force), largest)
        self.impulse_scale = 1.0 / system.free_mobility[held]

    def residual(self, tau: float, u: Array, rate: Array, out: Array) -> None:
        """Fill in the balance, the other states' rates, and the constraint."""
        motion, system, equations = self._motion, self._system, self._motion.equations
        n, size = system.n, self._size
        y, force = u[:size], u[size:]
        q = motion.inputs(tau, y)
        known = None if motion.is_on_lines else q
        friction = equations.friction @ q
        if motion.has_law:
            friction[equations.velocity_dependent] = motion.law_forces(tau, y, known)
        pushes = equations.C @ y + equations.Q @ q[: system.inputs] - system.GT @ friction
        out[:n] = system.inertia * rate[:n] - pushes + self._G.T @ force
        if size > n:
            out[n:size] = rate[n:size] - motion.rate_beside_velocities(tau, y, known)
        if force.size:
            out[size:] = self._G @ rate[:n]
            if system.drives:
                out[size:] += self._D @ system.drive_accelerations(motion.loads(tau))
            if self._null is not None:
                out[size:] -= self._null @ force

    def _place_jacobian(self) -> None:
        self.pattern: Any = None
        start, total = self._motion.y, self.start.size
        by_states, by_rates = self._by_states(0.0, start), self._by_rates()
        changes = self._motion.has_law or self._motion.dependence is not None
        if total > _DENSE_LIMIT:
            parts = [by_states, by_rates]
            if changes:
                # solvers keep the pattern: it has all places that may differ from 0 later
                parts.append(self._by_states(0.0, start, everywhere=True))
            sizes = [abs(scipy.sparse.csr_array(matrix)) for matrix in parts]
            self.pattern, self._places = sparsity_pattern(sum(sizes, scipy.sparse.eye_array(total)))
        self._rates = self._entries(by_rates)
        self._constant = None if changes else self._entries(by_states)

    def unit(self) -> Array:
        """Return the unit matrix as IDA takes it."""
        return self._entries(scipy.sparse.eye_array(self.start.size))

    def _entries(self, matrix: Any) -> Array:
        """Return a matrix as IDA takes it: dense, or the data of the sparsity pattern."""
        return dense(matrix) if self.pattern is None else on_pattern(matrix, self._places)

    def _by_rates(self) -> Any:
        """Return ``dR/du'``, dense or sparse as the scene is."""
        system, size, total = self._system, self._size, self.start.size
        own = np.concatenate([system.inertia, np.ones(size - system.n), np.zeros(total - size)])
        diagonal = scipy.sparse.diags_array(own) if system.sparse else np.diag(own)
        blocks = [(slice(total), slice(total), diagonal), (slice(size, total), slice(system.n), self._G)]
        return assembled(total, blocks)

    def _by_states(self, tau: float, y: Array, everywhere: bool = False) -> Any:
        """Return ``dR/du``, dense or sparse as the scene is; if `everywhere`, numbers where it may differ from 0."""
        motion, system, size, total = self._motion, self._system, self._size, self.start.size
        equations, law = motion.equations, motion.equations.law
        rows, places = equations.velocity_dependent, equations.bristle_places
        bodies, states, forces = slice(system.n), slice(size), slice(size, total)
        blocks: list[MatrixBlock] = [(bodies, states, -equations.C), (bodies, forces, self._G.T)]
        if size > system.n:
            others = slice(system.n, size)
            rates = motion.jacobian_pattern if everywhere else motion.jacobian(tau, y)
            blocks.append((others, states, -rates[others]))
        if rows.size:
            w, normal, lag, z = motion.law_arguments(tau, y)
            pushed = system.GT[:, rows]
            by_velocity = pushed * (np.ones_like(w) if everywhere else law.slopes(w, normal, lag, z))
            blocks.append((bodies, bodies, by_velocity @ system.G[rows]))
            if places.size:
                by_bristle = np.ones_like(z) if everywhere else law.by_bristle(w, normal, z)
                blocks.append((bodies, places, pushed[:, law.bristles] * by_bristle))
        if motion.dependence is not None:
            blocks.append((bodies, motion.dependence.states, -self._of_dependence(tau, y, everywhere)))
        if self._null is not None:
            blocks.append((forces, forces, -self._null))
        return assembled(total, blocks)

    def _of_dependence(self, tau: float, y: Array, everywhere: bool) -> Array:
        """Return the derivatives of the forces on the bodies, by way of the inputs, by the states that these follow."""
        motion, system = self._motion, self._system
        assert motion.dependence is not None
        inputs = system.inputs_and_dwells
        slopes = motion.dependence.pattern(inputs) if everywhere else motion.input_slopes(tau, y)
        found: Array = system.Q @ slopes[: system.inputs] - system.GT @ (motion.equations.friction @ slopes)
        return found

    def jacobian(self, tau: float, u: Array, rate: Array, residual: Array, cj: float, out: Array) -> None:
        """Fill in ``dR/du + cj dR/du'``."""
        state = self._constant
        if state is None:
            state = self._entries(self._by_states(tau, u[: self._size]))
        out[:] = state + cj * self._rates


IDA_BDF = Method("IDA BDF", Ida, ("multiplier",), force_uncertainty=_OF_FORCES)
