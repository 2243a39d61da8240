"""The motion from one instant on while its modes hold: rates, Jacobian, what is watched, and Taylor coefficients."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from stickslip.equations.algebra.floats import Sums, rates_of, smallest_of
from stickslip.equations.algebra.matrices import assembled, dense, scaled
from stickslip.equations.guard_rows import GuardRows
from stickslip.equations.inputs import Inputs, Linked
from stickslip.equations.loads.loads import NO_SINE_TURNS, Segment
from stickslip.equations.mode_equations import ModeEquations
from stickslip.equations.path import Path
from stickslip.model.arrays import Array, Indices

_CANCELLED = 8 * np.finfo(float).eps  # part of the sizes of all forces below which their sum is roundoff


class Expansion:
    """Taylor coefficients ``scale^k f^(k) / k!`` of states, inputs and watched quantities, one row per order.

    `q` are the inputs with dwells, computed when they are first read. `g` are the guards of the modes without their
    constants, None where they have not been computed with the rest.
    """

    __slots__ = ("_q", "g", "y", "z")

    def __init__(self, y: Array, q: Array | Callable[[], Array], z: Array, g: Array | None = None) -> None:
        self.y, self._q, self.z, self.g = y, q, z, g

    @classmethod
    def of(cls, whole: Array, size: int, watched: int, q: Array | Callable[[], Array]) -> Expansion:
        """Return an expansion from its coefficients side by side: `size` states, `watched` quantities, and guards."""
        last = size + watched
        g = whole[:, last:] if whole.shape[1] > last else None
        return cls(whole[:, :size], q, whole[:, size:last], g)

    @property
    def q(self) -> Array:
        """The inputs with dwells."""
        if not isinstance(self._q, np.ndarray):
            self._q = self._q()
        return self._q


class _Lines(NamedTuple):
    """What inputs that are straight lines do to a motion: at its start, and per second.

    `response` is that of rates and watched quantities; `w` and `normal` belong to the rows whose forces depend on
    velocity.
    """

    response: Array
    response_slope: Array
    w: Array
    w_slope: Array
    normal: Array
    normal_slope: Array
    is_steady: bool


class Motion(Inputs):
    """The equations in one set of modes from a state on. Local time tau runs from 0 at the start."""

    def __init__(self, equations: ModeEquations, segment: Segment, t: float, y: Array, since: Array) -> None:
        super().__init__(equations, segment, t, y, since)
        self.has_law = equations.velocity_dependent.size > 0
        self.has_functions = segment.has_functions or not (
            self.dependence is None or self.dependence.is_linear_in(self.table_regions)
        )
        self.is_linear = not (self.has_law or self.has_functions)
        self.is_polynomial = self.is_linear and self.dependence is None and not equations.feeds_back
        if self.is_linear and equations.is_small:
            self.first = self.start = self.expand(0.0, y, 2)

    def __reduce__(self) -> tuple[type[Motion], tuple[ModeEquations, Segment, float, Array, Array]]:
        """Pickle only how a motion begins: all that it caches follows from that."""
        return Motion, (self.equations, self.segment, self.t, self.y, self.since)

    # -- rates -----------------------------------------------------------------------------------------------

    def law_arguments(self, tau: float | Array, y: Array, q: Array | None = None) -> tuple[Array, Array, Array, Array]:
        """Return relative velocity, normal force, dwell lag and bristle deflection of the velocity-dependent rows.

        The inputs `q` need not be given.
        """
        equations = self.equations
        rows, places = equations.velocity_dependent, equations.bristle_places
        lines = None if q is not None or isinstance(tau, np.ndarray) else self._lines
        if lines is not None:
            w: Array = equations.law_velocities @ y
            w += lines.w
            normal = lines.normal
            if not lines.is_steady:
                w += tau * lines.w_slope
                normal = np.maximum(normal + tau * lines.normal_slope, 0.0)
        else:
            q = self.inputs(tau, y) if q is None else q
            w, normal = self.system.relative_velocity(y, q)[rows], np.maximum(q[rows], 0.0)
        return w, normal, self._lag(tau, w), y[places] if places.size else y[:0]

    def _lag(self, tau: float | Array, w: Array) -> Array:
        """Return ``exp(-age / dwell)`` of the velocity-dependent rows, 0 without a dwell; an array like `w`."""
        lag = np.zeros(w.shape)
        some, age, dwell = self._law_dwells
        if some.size:
            lag[some] = np.exp(-(np.add.outer(age, tau).T / dwell).T)
        return lag

    @cached_property
    def _law_dwells(self) -> tuple[Indices, Array, Array]:
        rows = self.equations.velocity_dependent
        dwell = self.system.dwell[rows]
        some = (dwell > 0).nonzero()[0]
        return some, self.t - self.since[rows[some]], dwell[some]

    @cached_property
    def _lines(self) -> _Lines | None:
        """What the inputs do, None unless they are straight lines and the maps are put together."""
        system, equations = self.system, self.equations
        if not equations.is_assembled or self.rises_push or not self.is_straight or self.dependence is not None:
            return None
        value, slope = self.inputs(0.0, self.y), np.zeros(system.inputs_and_dwells)
        slope[: system.inputs] = self.segment.slope
        rows, none = equations.velocity_dependent, np.zeros(system.size)
        w, bend = (system.relative_velocity(none, q)[rows] for q in (value, slope))
        return _Lines(
            equations.respond(value),
            equations.respond(slope),
            w,
            bend,
            np.maximum(value[rows], 0.0) if self.segment.is_steady else value[rows],
            slope[rows],
            self.segment.is_steady,
        )

    @cached_property
    def sums(self) -> Sums | None:
        """Inputs, friction forces and rates of bristles as sums over columns; None where arrays are the better way."""
        equations, dependence = self.equations, self.dependence
        laws, places = equations.laws_in_floats, equations.bristle_places
        if laws is None:
            return None
        # a table that is looked up is no sum, and the heat of bristles would need their states
        if dependence is not None and (
            (dependence.tables and self.table_regions is None) or (dependence.has_heat and places.size)
        ):
            return None
        rows, bristles = equations.velocity_dependent, equations.law.bristles.tolist()
        columns, q = self.in_columns(rows.size + places.size)
        w = self.system.relative_velocity(np.zeros((self.system.size, columns.count)), q)[rows]
        w[:, columns.states] += equations.law_velocities
        forces, rates = [], []
        for k, law in enumerate(laws):
            if k in bristles:
                state = columns.state(places[bristles.index(k)])
                force, rate = columns.add(law, [w[k], q[rows[k]], state], 2).tolist()
                rates.append(rate)
            else:
                (force,) = columns.add(law, [w[k], q[rows[k]]]).tolist()
            forces.append(force)
        return Sums(columns, q, forces, rates)

    @cached_property
    def in_floats(self) -> Callable[[float, Array, Array], None] | None:
        """The rates of a small motion in plain floats: a function of local time, states, and where it writes them."""
        sums, equations = self.sums, self.equations
        if sums is None:
            return None
        rates = equations.respond(sums.inputs)[: self.system.size]
        rates[:, sums.columns.states] += equations.A
        rates[:, sums.forces] += equations.K
        rates[equations.bristle_places] = 0.0
        rates[equations.bristle_places, sums.bristle_rates] = 1.0
        return rates_of(rates, sums.columns.terms)

    @property
    def has_left_in_floats(self) -> Callable[[float, Array], bool] | None:
        """`has_left` of a small motion with tables, in plain floats; None for other motions."""
        if not self.table_regions or self.sums is None:
            return None
        columns, (low, high) = self.sums.columns, self.limits
        x = np.array(columns.looked_up)
        depths = np.concatenate([x, -x])
        depths[:, 0] += np.concatenate([-low, high])
        least = smallest_of(depths[np.isfinite(depths[:, 0])], columns.terms)
        return lambda tau, y: least(tau, y) < 0

    @property
    def is_on_lines(self) -> bool:
        """Whether its maps are put together and its inputs are lines."""
        return self._lines is not None

    def law_forces(self, tau: float | Array, y: Array, q: Array | None = None) -> Array:
        """Return the friction forces that depend on velocity; the inputs `q` need not be given."""
        return self.equations.law.forces(*self.law_arguments(tau, y, q))

    def both(self, tau: float | Array, y: Array, q: Array | None = None) -> Array:
        """Return ``y'`` and what is watched in one array; states are columns where `tau` is an array.

        The inputs `q` need not be given.
        """
        equations = self.equations
        found = self._linear(tau, y, q)
        if self.has_law:
            w, normal, lag, z = self.law_arguments(tau, y, q)
            found += equations.push(equations.law.forces(w, normal, lag, z))
            if equations.bristle_places.size:
                found[equations.bristle_places] = equations.law.bristle_rates(w, normal, z)
        return found

    def _linear(self, tau: float | Array, y: Array, q: Array | None) -> Array:
        """Return ``A y + B q`` and ``E y + H q``."""
        found = self.equations.apply(y)
        lines = None if q is not None or isinstance(tau, np.ndarray) else self._lines
        if lines is None:
            found += self.equations.respond(self.inputs(tau, y) if q is None else q)
        else:
            found += lines.response
            if not lines.is_steady:
                found += tau * lines.response_slope
        return found

    def row_forces(self, tau: float | Array, y: Array) -> Array:
        """Return the forces of all rows, one column per time where `tau` is an array."""
        equations, size, m = self.equations, self.system.size, self.system.m
        found = self.both(tau, y)[size:]
        q = self.inputs(tau, y)
        forces: Array = equations.friction @ q
        forces[equations.elastic] = equations.elastic_forces(y, q)
        if self.has_law:
            forces[equations.velocity_dependent] = self.law_forces(tau, y)
        forces[equations.held] = found[m : m + equations.held.size]
        return forces

    def rate(self, tau: float | Array, y: Array) -> Array:
        """Return ``y' = A y + B q + K e``."""
        return self.both(tau, y)[: self.system.size]

    def relative_accelerations(self, tau: float | Array, y: Array) -> Array:
        """Return how fast the relative velocities of all rows grow, a column per time where `tau` is an array."""
        system = self.system
        return system.relative(self.rate(tau, y)[: system.n], system.drive_accelerations(self.loads(tau)))

    def relative_acceleration(self, tau: float, y: Array, row: int) -> float:
        """Return how fast the relative velocity of a row grows."""
        slopes = self.segment.rate(self.t + tau)
        return float(self.system.relative_velocity(self.rate(tau, y), slopes)[row])

    def rate_beside_velocities(self, tau: float, y: Array, q: Array | None = None) -> Array:
        """Return the rates of all states but velocities: no friction force enters them directly.

        The inputs `q` need not be given.
        """
        equations, size, n = self.equations, self.system.size, self.system.n
        found = self._linear(tau, y, q)[n:size]
        if equations.bristle_places.size:
            w, normal, _, z = self.law_arguments(tau, y, q)
            found[equations.bristle_places - n] = equations.law.bristle_rates(w, normal, z)
        return found

    def watched(self, tau: float | Array, y: Array, q: Array | None = None) -> Array:
        """Return ``z = E y + H q + L e``; the inputs `q` need not be given."""
        equations = self.equations
        shows_laws = self.has_law and equations.is_watched_by_laws
        found = self.both(tau, y, q) if shows_laws else self._linear(tau, y, q)
        return found[self.system.size :]

    def until(self, path: Path, tau: float, hit: bool = False, touched: int | None = None) -> Path:
        """Return a path of this motion up to a local time; its last state has the dependent velocities.

        `hit` and `touched` say why it ends there.
        """
        cut = path.cut(tau)
        last = self.exact(tau, cut.last)
        self.hold_samples(last)
        return Path(cut.taus, cut.coefficients, last, hit, cut.is_chebyshev, touched)

    def hold_samples(self, y: Array) -> None:
        """Write the states of sampled blocks into a later state of this motion, in place.

        Only samples change them; a solver that integrates their rate of 0 may leave roundoff.
        """
        y[self.system.clocked] = self.y[self.system.clocked]

    def jacobian(self, tau: float, y: Array) -> Any:
        """Return ``d y' / d y``, dense or sparse as the scene is; slopes of friction are flatter where that helps."""
        return self._jacobian(tau, y, self._law_slopes(tau, y) if self.has_law else None)

    def true_jacobians(self, taus: Array, y: Array) -> Iterator[Any]:
        """Yield ``d y' / d y`` at some times, for columns of states, with the slopes of friction, however steep."""
        slopes = self._law_slopes(taus, y, true=True) if self.has_law else None
        for i, tau in enumerate(taus.tolist()):
            yield self._jacobian(tau, y[:, i], None if slopes is None else [part[:, i] for part in slopes])

    def _law_slopes(self, tau: float | Array, y: Array, true: bool = False) -> list[Array]:
        """Return the derivatives of forces that depend on velocity by w, and those of bristles.

        These are the derivatives of their rates by w and z, and of the forces by z.
        """
        law, terms = self.equations.law, self.law_arguments(tau, y)
        w, normal, _, z = terms
        slopes = law.slopes(*terms)
        if true:
            slopes = slopes + law.slope_cut(w, normal)
        if not law.bristles.size:
            return [slopes]
        return [slopes, *law.bristle_slopes(w, normal, z), law.by_bristle(w, normal, z)]

    def _jacobian(self, tau: float, y: Array, slopes: list[Array] | None) -> Any:
        """Return ``d y' / d y`` with the `slopes` of forces that depend on velocity, None where there are none."""
        equations = self.equations
        matrix = equations.jacobian()
        if self.dependence is not None:
            matrix = matrix + self._of_dependence(tau, y)
        if slopes is None:
            return matrix
        matrix = matrix + equations.law_jacobian(slopes[0])
        return matrix if len(slopes) == 1 else self._with_bristles(matrix, *slopes[1:])

    @property
    def jacobian_pattern(self) -> Any:
        """A matrix whose entries are those of the Jacobian that may differ from 0."""
        equations = self.equations
        if self.dependence is not None or equations.bristle_places.size:
            return self.jacobian(0.0, self.y)
        return equations.jacobian_pattern

    def _of_dependence(self, tau: float, y: Array) -> Any:
        """Return what inputs that depend on the state add to the Jacobian."""
        equations, system, dependence = self.equations, self.system, self.dependence
        assert dependence is not None
        slopes = self.input_slopes(tau, y)
        found = equations.respond(slopes)
        rows = equations.velocity_dependent
        if rows.size and dependence.rows.size:
            of_forces, of_rates = equations.law.by_normal(*self.law_arguments(tau, y))
            found = found + equations.push(of_forces[:, None] * slopes[rows])
            found[equations.bristle_places] += of_rates[:, None] * slopes[rows[equations.law.bristles]]
        size, n = system.size, system.n
        if not system.sparse:
            full = np.zeros((size, size))
            full[:, dependence.states] = found[:size]
            if equations.dependent.size:
                full[:, :n] = full[:, :n] @ equations.balance.T
            return full
        # entries that are 0 only at this state are kept, because the solver keeps the pattern
        pattern = dependence.pattern(slopes.shape[0])
        some = (equations.respond(pattern) + equations.push(pattern[rows]) != 0)[:size] | (found[:size] != 0)
        some[equations.bristle_places] |= pattern[rows[equations.law.bristles]] != 0
        places = some.nonzero()
        entries = (found[places], (places[0], dependence.states[places[1]]))
        matrix = scipy.sparse.csr_array(entries, shape=(size, size))
        if equations.dependent.size:
            fold = scipy.sparse.block_diag([equations.balance.T, scipy.sparse.eye_array(size - n)], format="csr")
            matrix = scipy.sparse.csr_array(matrix @ fold)
        return matrix

    def _with_bristles(self, matrix: Any, by_w: Array, by_z: Array, by_bristle: Array) -> Any:
        """Add the entries of the bristles: ``dz'/dw W``, ``dz'/dz`` and ``K dr/dz``."""
        places, size = self.equations.bristle_places, self.system.size
        pushed, velocities = self.equations.bristle_maps
        lines, every = dense(scaled(by_w, velocities)), slice(size)
        lines[np.arange(places.size), places] += by_z
        return assembled(size, [(every, every, matrix), (places, every, lines), (every, places, pushed * by_bristle)])

    # -- series ----------------------------------------------------------------------------------------------

    def expand(self, tau: float, y: Array, order: int, scale: float = 1.0, frozen: bool = False) -> Expansion:
        """Return the Taylor coefficients of a linear motion at local time `tau`.

        ``y_{k+1} = (A y_k + B q_k) / (k + 1)``; the state `y` has its dependent velocities written through T. With
        `frozen`, static coefficients keep the values that they have at `tau`, and sines that move nothing are left out.
        """
        equations, size = self.equations, self.system.size
        with_sines = self.segment.has_sines and not (frozen and self.sines_rest)
        if equations.is_small and not (self._rises_with_state or (with_sines and self._rises_with_sines)):
            taylor = equations.taylor(
                order, frozen, self.table_regions, self.segment.sine_turns if with_sines else NO_SINE_TURNS
            )
            if taylor is not None and taylor.reaches(scale):
                x = self._extended(tau, y)
                if with_sines:
                    x = np.concatenate([x, self.segment.sines_and_cosines(self.t + tau)])
                found = taylor.coefficients(x, scale, order)
                own = found[:, :size]
                return Expansion.of(
                    found, size, equations.watched_count, lambda: self._all_series(tau, own, scale, frozen)
                )
        return self._expand_by_orders(tau, y, order, scale, frozen)

    def _expand_by_orders(self, tau: float, y: Array, order: int, scale: float, frozen: bool) -> Expansion:
        """Return what `expand` does, one order after the other."""
        equations, system = self.equations, self.system
        size = system.size
        linked = Linked(self, tau, order, scale, frozen) if self.dependence is not None else None
        q = self._input_series(tau, order, scale, frozen) if linked is None else linked.q
        loads = q if linked is None else linked.loads
        whole = np.zeros((order + 1, size + equations.watched_count))
        ys, zs = whole[:, :size], whole[:, size:]
        ys[0] = y
        finite = False
        act = np.full(order + 1, linked is not None) | q.any(axis=1)
        responses = np.zeros((order + 1, size + equations.watched_count))
        if linked is None and act.any():
            responses[act] = equations.respond(q[act].T).T
        for k in range(order + 1):
            if finite and not act[k]:
                continue
            found = equations.apply(ys[k])
            if act[k]:
                found += responses[k] if linked is None else equations.respond(linked.part(k, ys[k]))
            if not k:
                # Forces that cancel but for roundoff are none. A scene in equilibrium would be followed in small steps.
                sizes = equations.accelerations_by_forces(y, q[0])
                found[: system.n][np.abs(found[: system.n]) <= _CANCELLED * sizes] = 0.0
            zs[k] = found[size:]
            if k == order:
                break
            following = ys[k + 1]
            np.multiply(found[:size], scale / (k + 1), out=following)
            if equations.dependent.size:
                equations.consistent(following, system.drive_velocities(loads[k + 1]))
            finite = linked is None and not following.any()
        return Expansion.of(whole, size, equations.watched_count, q)

    def majorants(self, order: int, from_rates: bool = False, no_new_dwells: bool = False) -> list[tuple[Array, Array]]:
        """Return majorants of the Taylor coefficients of inputs and watched quantities at the start, up to `order`.

        They are the series of the same equations with absolute values, so that nothing cancels. If `from_rates`, terms
        may cancel in the first rates, but not later; if `no_new_dwells`, dwells that begin at the start are left out.
        """
        y, found = self.state_majorants, []
        for k, q in enumerate(self._input_majorants(order, no_new_dwells)):
            if k == 1 and from_rates:
                y = np.abs(self.first.y[1])
            if self.dependence is not None:
                self._add_majorants(q, y, k == 0)
            rate, z = self.equations.majorants(y, q)
            found.append((q, z))
            y = rate / (k + 1)
        return found

    def rate_majorants(self) -> Array:
        """Return majorants of the rates of the states at the start."""
        return self.equations.majorants(self.state_majorants, np.abs(self.start_inputs))[0]

    @cached_property
    def roughness(self) -> list[tuple[Array, Array]] | None:
        """How uncertain velocities of drives leave inputs and watched quantities, as `majorants` of order 0 and 1.

        Where these velocities are the user's functions, the accelerations are differences. None if no such velocity
        bends.
        """
        system, equations = self.system, self.equations
        if self.segment.is_straight or not system.drives:
            return None
        q, y = np.zeros(system.inputs_and_dwells), np.zeros(system.size)
        q[: system.inputs] = self.segment.roughness
        y[: system.n] = abs(equations.balance.U) @ system.drive_velocities(q)
        rate, z = equations.majorants(y, q)
        slope = np.zeros_like(q)
        system.drive_velocities(slope)[:] = system.drive_accelerations(q)
        return [(q, z), (slope, equations.majorants(rate, slope)[1])]

    @property
    def is_balanced(self) -> bool:
        """Whether the forces at the start cancel on all bodies, but for roundoff that is left on some."""
        rate = self.rate(0.0, self.y)[: self.system.n]
        sizes = self.equations.accelerations_by_forces(self.y, self.start_inputs)
        return bool(rate.any() and (np.abs(rate) <= _CANCELLED * sizes).all())

    @cached_property
    def _may_rest(self) -> bool:
        """Whether nothing but springs, dampers, gaps and steady loads and levels acts on bodies."""
        system, segment = self.system, self.segment
        is_steady = segment.is_straight and segment.is_steady and not self.rises_push
        is_plain = not system.has_pushes_by_state and system.size == system.first_bristle
        return self.is_linear and is_steady and is_plain and not system.sparse

    def at_rest(self, tau: float, y: Array) -> Array | None:
        """Return the equilibrium if a state differs from it by roundoff only; else None."""
        if not self._may_rest or self.is_rising(tau):
            return None
        system, equations, n = self.system, self.equations, self.system.n
        rest = y.copy()
        rest[:n] = 0.0
        rest = self.exact(tau, rest)
        rate, q = self.rate(tau, rest), self.inputs(tau, rest)
        comes_to_rest = system.relative_velocity(rest, q)[equations.slip] == 0
        if rate[n:].any() or comes_to_rest.any():
            return None
        return rest if equations.to_equilibrium(rest, q, (y - rest)[:n], rate[:n]) else None

    def guard_majorants(self, rows: GuardRows, order: int, no_new_dwells: bool = False) -> Array:
        """Return majorants of the Taylor coefficients of the guards at the start, an order per row.

        If `no_new_dwells`, dwells that begin there are left out.
        """
        majorant_map = None
        if not (self.dependence is not None or self.segment.has_functions or self._rises_with_sines):
            majorant_map = rows.majorant_map(order, self.segment.sine_turns)
        if majorant_map is None:
            return np.array([rows.majorants(z, q) for q, z in self.majorants(order, no_new_dwells=no_new_dwells)])
        found: Array = (majorant_map @ self.extended_majorants(no_new_dwells)).reshape(order + 1, -1)
        return found

    # -- starts ----------------------------------------------------------------------------------------------

    @cached_property
    def first(self) -> Expansion:
        """Taylor coefficients at the start up to order 1, those of the states up to order 2."""
        if self.is_linear:
            return self.start
        size, q0 = self.system.size, self.start_inputs
        found = self.both(0.0, self.y, None if self.is_on_lines else q0)
        rate, z0 = found[:size], found[size:]
        q1 = self._input_rate(0.0, self.y, rate)
        slope = self._slope(0.0, self.y, rate, q0, q1)
        return Expansion(np.array([self.y, rate, 0.5 * slope[:size]]), np.array([q0, q1]), np.array([z0, slope[size:]]))

    @cached_property
    def start(self) -> Expansion:
        """Taylor coefficients at the start up to order 2: exact if linear, the second by a difference if not."""
        if self.is_linear:
            return self.expand(0.0, self.y, 2)
        first, size, d = self.first, self.system.size, self.difference_step
        bend, (z0, z1), ahead = first.y[2], first.z, self.soon(d)
        rate_ahead = self.rate(d, ahead)
        q1_ahead = self._input_rate(d, ahead, rate_ahead)
        later = self._slope(d, ahead, rate_ahead, self.inputs(d, ahead), q1_ahead)
        z2, q2 = 0.5 * (later[size:] - z1) / d, 0.5 * (q1_ahead - first.q[1]) / d
        # more is known of relative velocities: their second coefficients follow from those of states and drives
        system = self.system
        z2[: system.m] = system.relative(bend[: system.n], 0.5 * system.drive_accelerations(first.q[1]))
        return Expansion(first.y, np.array([*first.q, q2]), np.array([z0, z1, z2]))

    def soon(self, tau: float) -> Array:
        """Return the states at a local time not long after the start, from their first Taylor coefficients there."""
        y, rate, bend = self.first.y
        return np.asarray(y + tau * (rate + tau * bend))

    def _slope(self, tau: float, y: Array, rate: Array, q: Array, dq: Array) -> Array:
        """Return the derivatives of rates and watched quantities along the motion, whose inputs `q` change by `dq`."""
        equations, system = self.equations, self.system
        found = equations.apply(rate) + equations.respond(dq)
        if not self.has_law:
            return found
        law, d = equations.law, self.difference_step
        dw = system.relative_velocity(rate, dq)[equations.velocity_dependent]
        w, normal, lag, z = self.law_arguments(tau, y, q)
        # Normal force, dwell and bristles change slowly and smoothly: a difference gives their part. It is exact where
        # only the normal force changes, along a straight line.
        e = law.forces(w, normal, lag, z)
        _, normal_d, lag_d, _ = self.law_arguments(tau + d, y, q + d * dq)
        z_d = z + d * rate[equations.bristle_places]
        by_time = (law.forces(w, normal_d, lag_d, z_d) - e) / d
        found += equations.push(law.slopes(w, normal, lag, z) * dw + by_time)
        if equations.bristle_places.size:
            now = law.bristle_rates(w, normal, z)
            found[equations.bristle_places] = (law.bristle_rates(w + d * dw, normal_d, z_d) - now) / d
        return found
