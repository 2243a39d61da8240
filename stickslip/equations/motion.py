"""The motion from one instant on while its modes hold: rates, Jacobian, what is watched, and Taylor coefficients."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy

from stickslip.equations.floats import LawInFloats, lines, rates_of, remembered
from stickslip.equations.guard_rows import GuardRows
from stickslip.equations.loads import Stretch
from stickslip.equations.matrices import dense
from stickslip.equations.mode_equations import ModeEquations
from stickslip.equations.path import Path
from stickslip.model.arrays import Array, Indices

_DWELL_OVER = 40.0
"""Dwell times after which a static coefficient has risen to the last bit."""

_DIFFERENCE = 1e-5
_NO_BRISTLES = np.empty(0)


class Expansion:
    """Taylor coefficients ``scale^k f^(k) / k!`` of states, inputs and watched quantities, one row per order.

    `q` are the inputs with dwells, None where a whole order is 0; `g` are the guards of the modes, but for constants,
    where they are told at once.
    """

    __slots__ = ("_q", "g", "y", "z")

    def __init__(
        self,
        y: Array,
        q: list[Array | None] | Callable[[], list[Array | None]],
        z: Array,
        g: Array | None = None,
    ) -> None:
        self.y, self._q, self.z, self.g = y, q, z, g

    @property
    def q(self) -> list[Array | None]:
        """The inputs with dwells."""
        if not isinstance(self._q, list):
            self._q = self._q()
        return self._q


class _Lines(NamedTuple):
    """What inputs that are lines in time do: at the start of a motion, and their slopes.

    The response of rates and watched quantities; relative velocities and normal forces of the rows whose forces depend
    on velocity.
    """

    response: Array
    response_slope: Array
    w: Array
    w_slope: Array
    normal: Array
    normal_slope: Array
    is_steady: bool


class _Linked:
    """The Taylor coefficients of inputs that depend linearly on the state, order by order."""

    def __init__(self, motion: Motion, tau: float, order: int, scale: float, frozen: bool) -> None:
        self._motion, self._scale = motion, scale
        self.q: list[Array | None] = []
        self._known: list[Array] = []
        self.loads = motion.stretch.taylor(motion.t + tau, order, scale)
        self._decay = motion.decay(tau, order, scale, frozen)

    def part(self, k: int, y: Array) -> Array:
        """Return order `k` of the inputs and dwells from order `k` of the states."""
        motion, loads = self._motion, self.loads[k]
        inputs = motion.system.inputs
        full = np.zeros(inputs + motion.system.dwelling.size)
        if loads is not None:
            full[:inputs] = loads
        assert motion.dependence is not None
        motion.dependence.add_linear(full[:inputs], y, motion.regions)
        self.q.append(full)
        self._known.append(full)
        if self._decay is not None:
            rows, places, decay = self._decay
            # exp(-age - rate tau) N, as the product of both series
            total = np.zeros(rows.size)
            for i, part in enumerate(self._known):
                total += decay[k - i] * part[rows]
            full[places] = total
        return full


class Motion:
    """The equations in one set of modes from a state on. Local time tau runs from 0 at the start.

    `stretch` are the inputs up to the next break. The state `y` at the start `t` has its dependent velocities written
    through T; each row last became held at `since`.
    """

    def __init__(self, equations: ModeEquations, stretch: Stretch, t: float, y: Array, since: Array) -> None:
        self.equations, self.stretch, self.t, self.y, self.since = equations, stretch, t, y, since
        system = self.system = equations.system
        self.horizon = stretch.stop - t
        self.has_law = equations.velocity_dependent.size > 0
        self.dependence, self.regions = system.dependence, stretch.regions
        self.has_functions = stretch.has_functions or not (
            self.dependence is None or self.dependence.is_linear_in(self.regions)
        )
        self.is_linear = not (self.has_law or self.has_functions)
        self._dwelling = system.dwelling
        self._over = -math.inf
        self.rises_push = equations.rises_push
        if self._dwelling.size:
            self._place_dwells()
        self.is_straight = stretch.is_straight
        self.is_polynomial = self.is_linear and self.dependence is None and not equations.feeds_back

    # -- inputs ----------------------------------------------------------------------------------------------

    def _place_dwells(self) -> None:
        """Rows whose static coefficient is still rising."""
        places = self._rising = self.equations.resting_dwells
        if not places.size:
            return
        rows = self._dwelling[places]
        self._rate = 1.0 / self.system.dwell[rows]
        self._age = (self.t - self.since[rows]) * self._rate
        young = self._age < _DWELL_OVER
        if not young.all():
            self._rising, self._rate, self._age = places[young], self._rate[young], self._age[young]
        if self._rising.size:
            self._over = float(((_DWELL_OVER - self._age) / self._rate).max())

    @cached_property
    def waves_rest(self) -> bool:
        """Whether sines move nothing: they only push on what rests, or press it."""
        stretch, equations = self.stretch, self.equations
        if not stretch.has_waves:
            return True
        pushed = np.zeros(self.system.inputs + self._dwelling.size)
        pushed[: self.system.inputs] = stretch.amplitudes
        y, size = np.zeros(self.system.size), self.system.size
        rate, _ = equations.magnitudes(y, pushed)
        moved = np.abs(equations.respond(pushed)[:size]) > 1e-12 * rate
        drives = pushed[self.system.first_drive : self.system.first_acceleration]
        return not (moved.any() or drives.any() or self._pushes_apart(pushed, rate))

    def _pushes_apart(self, pushed: Array, rate: Array) -> bool:
        """Tell whether two sines that cancel at their peaks move something."""
        size = self.system.size
        for i in self.stretch.amplitudes.nonzero()[0].tolist():
            one = np.zeros(pushed.size)
            one[i] = pushed[i]
            if np.any(np.abs(self.equations.respond(one)[:size]) > 1e-12 * rate):
                return True
        return False

    @property
    def may_be_bounded(self) -> bool:
        """Whether what bends the guards alone, rising levels and sines, moves nothing."""
        has_waves = self.stretch.has_waves
        if has_waves and self.dependence is not None:
            return False
        return not self.rises_push and (self.waves_rest or not has_waves)

    def is_rising(self, tau: float) -> bool:
        """Tell whether a static coefficient still rises at local time `tau`."""
        return tau < self._over

    @cached_property
    def shortest_dwell(self) -> float:
        """Shortest dwell time of the rows whose static coefficients are still rising, 0 where none are."""
        return 1.0 / float(self._rate.max()) if self._dwelling.size and self._rising.size else 0.0

    @property
    def dwell_times(self) -> Array:
        """Dwell times of the rows whose static coefficients are still rising, each once."""
        return np.unique(1.0 / self._rate) if self._dwelling.size and self._rising.size else np.empty(0)

    def withheld(self, taus: Array) -> Array:
        """Return the part of each dwell's rise that is still withheld at local times, one column each."""
        found = np.zeros((self._dwelling.size, taus.size))
        if self._dwelling.size and self._rising.size:
            found[self._rising] = np.exp(-(self._age[:, None] + np.multiply.outer(self._rate, taus)))
        return found

    @property
    def for_normals(self) -> Collection[int]:
        """The functions and tables of the state on which normal forces depend."""
        return () if self.dependence is None else self.dependence.for_normals

    def loads(self, tau: float | Array) -> Array:
        """Return the inputs that loads are at local time `tau`, without what depends on the state."""
        if isinstance(tau, np.ndarray):
            return self.stretch.sampled(self.t + tau)
        return self.stretch.at(self.t + tau)

    def inputs(self, tau: float | Array, y: Array, wanted: Collection[int] | None = None) -> Array:
        """Return inputs and dwells at local time `tau`, one column per time where that is an array.

        Of functions and tables of the state only those `wanted` by number are computed; None for all.
        """
        many = isinstance(tau, np.ndarray)
        q = self.loads(tau)
        if self.dependence is not None:
            y = self.exact(tau, y)
            self.dependence.fill(q, y, self.t + tau, tau, self, wanted, self.regions)
        if not self._dwelling.size:
            return q
        full = np.zeros((q.shape[0] + self._dwelling.size, *q.shape[1:]))
        full[: q.shape[0]] = q
        if self._rising.size:
            age, rate = (self._age[:, None], self._rate[:, None]) if many else (self._age, self._rate)
            decay = np.exp(-(age + rate * tau))
            full[q.shape[0] + self._rising] = decay * q[self._dwelling[self._rising]]
        return full

    def _input_rate(self, tau: float, y: Array, y_rate: Array) -> Array:
        """Return the derivatives of inputs and dwells along the motion."""
        rate = self.stretch.rate(self.t + tau)
        if self.dependence is not None:
            self._add_rates(rate, tau, y, y_rate)
        if not self._dwelling.size:
            return rate
        full = np.zeros(rate.size + self._dwelling.size)
        full[: rate.size] = rate
        if self._rising.size:
            rows = self._dwelling[self._rising]
            decay = np.exp(-(self._age + self._rate * tau))
            normal = self.inputs(tau, y)[rows]
            full[rate.size + self._rising] = decay * (rate[rows] - self._rate * normal)
        return full

    def decay(
        self, tau: float, order: int, scale: float, frozen: bool
    ) -> tuple[Indices, Indices, list[Array]] | None:
        """Return the rows whose static coefficients rise, the places of their dwells, and the series of these."""
        if not (self._dwelling.size and self._rising.size):
            return None
        age = self._age + self._rate * tau
        live = (age < _DWELL_OVER).nonzero()[0]
        if not live.size:
            return None
        rows, places = self._dwelling[self._rising[live]], self.system.inputs + self._rising[live]
        found = [np.exp(-age[live])]
        for k in range(order):
            found.append(found[-1] * (0.0 if frozen else -self._rate[live] * scale / (k + 1)))
        return rows, places, found

    def _add_magnitudes(self, q: Array, y: Array, values: bool) -> None:
        """Add what adds up in the inputs that depend on the state, in place."""
        dependence = self.dependence
        assert dependence is not None
        slopes = None if dependence.is_linear else self._start_slopes
        dependence.add_sizes(q, y, slopes, values)

    @cached_property
    def _start_slopes(self) -> Array:
        return self.input_slopes(0.0, self.y)

    def _add_rates(self, rate: Array, tau: float, y: Array, y_rate: Array) -> None:
        """Add how fast the inputs change that depend on the state, in place: functions by differences."""
        dependence = self.dependence
        assert dependence is not None
        if dependence.is_linear:
            dependence.add_linear(rate, y_rate, self.regions)
            return
        d, count = self.difference_step, rate.size
        now, soon, later = (self.inputs(tau + k * d, y + k * d * y_rate)[:count] for k in (0, 1, 2))
        places = dependence.places
        rate[places] = (4 * soon - 3 * now - later)[places] / (2 * d)

    def _input_series(self, tau: float, order: int, scale: float, frozen: bool) -> list[Array | None]:
        series = self.stretch.taylor(self.t + tau, order, scale, not (frozen and self.waves_rest))
        if not self._dwelling.size:
            return series
        size, count = self.system.inputs, self._dwelling.size
        full: list[Array | None] = []
        for part in series:
            wide = None
            if part is not None:
                wide = np.zeros(size + count)
                wide[:size] = part
            full.append(wide)
        decaying = self.decay(tau, order, scale, frozen)
        if decaying is None:
            return full
        rows, places, decay = decaying
        if frozen:
            for part, wide in zip(series, full, strict=True):
                if part is not None and wide is not None:
                    wide[places] = decay[0] * part[rows]
            return full
        # exp(-age - rate tau) N, as the product of both series
        normals = [None if part is None else part[rows] for part in series]
        known = [k for k, part in enumerate(normals) if part is not None]
        for k in range(order + 1):
            value: Any = sum(decay[k - i] * normals[i] for i in known if i <= k)  # type: ignore[operator, misc]
            wide = full[k]
            if wide is None:
                wide = full[k] = np.zeros(size + count)
            wide[places] = value
        return full

    def normals(self, tau: float | Array, y: Array) -> Array:
        """Return the normal forces at local time `tau`."""
        return np.maximum(self.inputs(tau, y)[: self.system.m], 0.0)

    def friction_of(self, row: int, w: float, normal: float, tau: float, y: Array) -> float:
        """Return the friction force of one row at local time `tau`, 0 where it is held."""
        return self.equations.friction_of(row, w, normal, self.t + tau - self.since[row], y)

    # -- rates -----------------------------------------------------------------------------------------------

    def law_arguments(self, y: Array, q: Array, tau: float | Array) -> tuple[Array, Array, Array, Array]:
        """Return relative velocity, normal force, dwell lag and bristle deflection of the velocity-dependent rows."""
        rows = self.equations.velocity_dependent
        w, normal = self.system.relative_velocity(y, q)[rows], np.maximum(q[rows], 0.0)
        return w, normal, self._lag(tau, w), y[self.equations.bristle_places]

    def _lag(self, tau: float | Array, w: Array) -> Array:
        """Return what the dwell of the velocity-dependent rows still withholds, an array like `w`."""
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
        """What the inputs of a small motion do, where they are lines."""
        system, equations = self.system, self.equations
        if system.sparse or self.rises_push or not self.is_straight or self.dependence is not None:
            return None
        value, slope = self.inputs(0.0, self.y), np.zeros(system.inputs + self._dwelling.size)
        slope[: system.inputs] = self.stretch.slope
        rows, none = equations.velocity_dependent, np.zeros(system.size)
        w, bend = (system.relative_velocity(none, q)[rows] for q in (value, slope))
        return _Lines(
            equations.respond(value),
            equations.respond(slope),
            w,
            bend,
            np.maximum(value[rows], 0.0) if self.stretch.is_steady else value[rows],
            slope[rows],
            self.stretch.is_steady,
        )

    @cached_property
    def in_floats(self) -> Callable[[float, Array, Array], None] | None:
        """The rates of a small motion in plain floats: a function of local time, states, and where it writes them."""
        own, size, equations = self._lines, self.system.size, self.equations
        if own is None or equations.laws_in_floats is None:
            return None

        def made() -> Callable[[float, Array, Array], None]:
            rates = lines(own.response[:size], own.response_slope[:size], equations.A, equations.K)
            return rates_of(rates, self.laws_in_floats)

        return remembered(
            equations.rates_in_floats, made, own.response, own.response_slope, *self.of_laws_on_lines
        )

    @property
    def laws_in_floats(self) -> list[LawInFloats]:
        """The friction forces of a small motion that depend on velocity."""
        own, laws = self._lines, self.equations.laws_in_floats
        if not laws or own is None:
            return []
        velocities = lines(own.w, own.w_slope, self.equations.law_velocities)
        return list(map(LawInFloats, velocities, own.normal.tolist(), own.normal_slope.tolist(), laws))

    @property
    def of_laws_on_lines(self) -> tuple[Array, ...]:
        """Relative velocities, normal forces and their slopes, from which a small motion has its friction forces."""
        own = self._lines
        return () if own is None else (own.w, own.w_slope, own.normal, own.normal_slope)

    @property
    def is_on_lines(self) -> bool:
        """Whether the motion is small and its inputs are lines."""
        return self._lines is not None

    def law_forces(self, tau: float | Array, y: Array) -> Array:
        """Return the friction forces that depend on velocity."""
        return self.equations.law.forces(*self.law_arguments(y, self.inputs(tau, y), tau))

    def law_slopes(self, tau: float, y: Array) -> Array:
        """Return the derivatives of the friction forces that depend on velocity with respect to it."""
        return self.equations.law.slopes(*self.law_arguments(y, self.inputs(tau, y), tau))

    def both(self, tau: float | Array, y: Array, q: Array | None = None) -> Array:
        """Return ``y'`` and what is watched in one array; states are columns where `tau` is an array.

        The inputs `q` need not be given.
        """
        equations = self.equations
        found = self._linear(tau, y, q)
        if self.has_law:
            lines = self._lines
            if lines is None or isinstance(tau, np.ndarray):
                w, normal, lag, z = self.law_arguments(y, self.inputs(tau, y) if q is None else q, tau)
            else:
                w, normal, lag, z = self._law_arguments_on_lines(tau, y, lines)
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

    def _law_arguments_on_lines(
        self, tau: float, y: Array, lines: _Lines
    ) -> tuple[Array, Array, Array, Array]:
        """Return what `law_arguments` does, of a small motion."""
        w: Array = self.equations.law_velocities @ y
        w += lines.w
        normal = lines.normal
        if not lines.is_steady:
            w += tau * lines.w_slope
            normal = np.maximum(normal + tau * lines.normal_slope, 0.0)
        places = self.equations.bristle_places
        return w, normal, self._lag(tau, w), y[places] if places.size else _NO_BRISTLES

    def row_forces(self, tau: float | Array, y: Array) -> Array:
        """Return the forces of all rows, one column per time where `tau` is an array."""
        equations, size, m = self.equations, self.system.size, self.system.m
        found = self.both(tau, y)[size:]
        forces: Array = equations.friction @ self.inputs(tau, y)
        if self.has_law:
            forces[equations.velocity_dependent] = self.law_forces(tau, y)
        forces[equations.held] = found[m : m + equations.held.size]
        return forces

    def rate(self, tau: float | Array, y: Array) -> Array:
        """Return ``y' = A y + B q + K e``."""
        equations, size = self.equations, self.system.size
        lines = self._lines
        if lines is None or isinstance(tau, np.ndarray) or equations.bristle_places.size:
            return self.both(tau, y)[:size]
        found = np.asarray(equations.A @ y)
        found += lines.response[:size]
        if not lines.is_steady:
            found += tau * lines.response_slope[:size]
        if self.has_law:
            found += equations.K @ equations.law.forces(*self._law_arguments_on_lines(tau, y, lines))
        return found

    def watched(self, tau: float | Array, y: Array, q: Array | None = None) -> Array:
        """Return ``z = E y + H q + L e``; the inputs `q` need not be given."""
        equations = self.equations
        reached = self.has_law and equations.is_watched_by_laws
        found = self.both(tau, y, q) if reached else self._linear(tau, y, q)
        return found[self.system.size :]

    def exact(self, tau: float | Array, y: Array) -> Array:
        """Return a state (or columns) with dependent velocities written through T."""
        equations = self.equations
        if not equations.dependent.size:
            return y
        y = np.array(y)
        if not equations.is_driven:
            return equations.consistent(y, np.empty(0))
        return equations.consistent(y, self.system.drive_velocities(self.loads(tau)))

    def until(self, path: Path, tau: float) -> Path:
        """Return a path of this motion up to a local time; its last state has the velocities that solvers leave out."""
        cut = path.cut(tau) if tau > 0 else path.until(0)
        return replace(cut, last=self.exact(tau, cut.last))

    def jacobian(self, tau: float, y: Array) -> Any:
        """Return ``d y' / d y``, dense or sparse as the scene is."""
        equations = self.equations
        matrix = equations.jacobian()
        if self.dependence is not None:
            matrix = matrix + self._of_dependence(tau, y)
        if not self.has_law:
            return matrix
        terms = self.law_arguments(y, self.inputs(tau, y), tau)
        matrix = matrix + equations.law_jacobian(equations.law.slopes(*terms))
        return matrix if not equations.bristle_places.size else self._with_bristles(matrix, terms)

    @property
    def structure(self) -> Any:
        """A matrix whose entries are those of the Jacobian that may differ from 0."""
        equations = self.equations
        if self.dependence is not None or equations.bristle_places.size:
            return self.jacobian(0.0, self.y)
        return equations.structure

    def input_slopes(self, tau: float, y: Array) -> Array:
        """Return the derivatives of inputs and dwells with respect to the states that they depend on."""
        dependence = self.dependence
        assert dependence is not None
        q = self.inputs(tau, y)
        found = dependence.slopes(q, self.exact(tau, y), self.t + tau, tau, self, self.regions)
        if self._dwelling.size and self._rising.size:
            rows = self._dwelling[self._rising]
            decay = np.exp(-(self._age + self._rate * tau))
            found[self.system.inputs + self._rising] = decay[:, None] * found[rows]
        return found

    def _of_dependence(self, tau: float, y: Array) -> Any:
        """Return what inputs that depend on the state add to the Jacobian."""
        equations, system, dependence = self.equations, self.system, self.dependence
        assert dependence is not None
        slopes = self.input_slopes(tau, y)
        found = equations.respond(slopes)
        rows = equations.velocity_dependent
        if rows.size and dependence.rows.size:
            # forces that depend on velocity are multiples of the normal force, but for those of bristles
            w, normal, lag, z = self.law_arguments(y, self.inputs(tau, y), tau)
            pressed = normal > 0
            e = equations.law.forces(w, normal, lag, z)
            part = np.where(pressed, e / np.where(pressed, normal, 1.0), 0.0)
            found = found + equations.push(part[:, None] * slopes[rows])
        size, n = system.size, system.n
        if not system.sparse:
            full = np.zeros((size, size))
            full[:, dependence.columns] = found[:size]
            if equations.dependent.size:
                full[:, :n] = full[:, :n] @ equations.balance.T
            return full
        # entries that may differ from 0 elsewhere are kept, because the solver keeps the pattern
        some = (equations.respond(dependence.pattern(slopes.shape[0])) != 0)[:size] | (found[:size] != 0)
        places = some.nonzero()
        entries = (found[places], (places[0], dependence.columns[places[1]]))
        matrix = scipy.sparse.csr_array(entries, shape=(size, size))
        if equations.dependent.size:
            fold = scipy.sparse.block_diag(
                [equations.balance.T, scipy.sparse.eye_array(size - n)], format="csr"
            )
            matrix = scipy.sparse.csr_array(matrix @ fold)
        return matrix

    def _with_bristles(self, matrix: Any, terms: tuple[Array, Array, Array, Array]) -> Any:
        """Add the entries of the bristles: ``dz'/dw W``, ``dz'/dz`` and ``K dr/dz``."""
        equations, system = self.equations, self.system
        law, places = equations.law, equations.bristle_places
        w, normal, _, z = terms
        by_w, by_z = law.bristle_slopes(w, normal, z)
        some = equations.velocity_dependent[law.bristles]
        size, count, n = system.size, places.size, system.n
        units = np.zeros((equations.velocity_dependent.size, count))
        units[law.bristles, np.arange(count)] = 1.0
        pushed, rows = equations.push(units)[:size], (system.G @ equations.balance.T)[some]
        by_bristle = law.by_bristle(w, normal, z)
        if isinstance(matrix, np.ndarray):
            matrix[places, :n] += by_w[:, None] * dense(rows)
            matrix[places, places] += by_z
            matrix[:, places] += pushed * by_bristle
            return matrix
        rows = scipy.sparse.hstack([rows, scipy.sparse.csr_array((count, size - n))], format="csr")
        own = scipy.sparse.csr_array((np.ones(count), (places, np.arange(count))), shape=(size, count))
        extra = own @ (scipy.sparse.diags_array(by_w) @ rows) + own @ scipy.sparse.diags_array(by_z) @ own.T
        extra = extra + scipy.sparse.csr_array(pushed) @ scipy.sparse.diags_array(by_bristle) @ own.T
        return scipy.sparse.csr_array(matrix + extra)

    # -- series ----------------------------------------------------------------------------------------------

    def expand(self, tau: float, y: Array, order: int, scale: float = 1.0, frozen: bool = False) -> Expansion:
        """Return the Taylor coefficients of a linear motion at local time `tau`.

        ``y_{k+1} = (A y_k + B q_k) / (k + 1)``; the state `y` has its dependent velocities written through T. With
        `frozen`, static coefficients keep the values that they have at `tau`, and sines that move nothing are left out.
        """
        equations, system = self.equations, self.system
        size, n = system.size, system.n
        swings = self.stretch.has_waves and not (frozen and self.waves_rest)
        if not (self._rises_with_state or (swings and self._rises_with_waves)):
            taylor = equations.taylor(order, frozen, self.regions, self.stretch.waves if swings else ((), ()))
            if taylor is not None and taylor.reaches(scale):
                x = self._extended(tau, y)
                if swings:
                    x = np.concatenate([x, self.stretch.swings(self.t + tau)])
                y, z, g = taylor(x, scale)
                return Expansion(y, lambda: self._all_series(tau, y, scale, frozen), z, g)
        linked = _Linked(self, tau, order, scale, frozen) if self.dependence is not None else None
        q = self._input_series(tau, order, scale, frozen) if linked is None else linked.q
        ys, zs = np.zeros((order + 1, size)), np.zeros((order + 1, equations.rows))
        ys[0] = y
        finite = False
        for k in range(order + 1):
            part = q[k] if linked is None else linked.part(k, ys[k])
            if finite and part is None:
                continue
            found = equations.apply(ys[k])
            if part is not None:
                found += equations.respond(part)
            zs[k] = found[size:]
            if k == order:
                break
            following = ys[k + 1]
            np.multiply(found[:size], scale / (k + 1), out=following)
            if equations.dependent.size:
                u = q[k + 1] if linked is None else linked.loads[k + 1]
                led = equations.T_dependent @ following[:n]
                if equations.is_driven and u is not None:
                    led = led + equations.U_dependent @ system.drive_velocities(u)
                following[equations.dependent] = led
            finite = linked is None and not following.any()
        return Expansion(ys, q, zs)

    @cached_property
    def _rises_with_state(self) -> bool:
        """Whether a level rises whose normal force depends on the state."""
        return self.dependence is not None and self._rises_among(self.dependence.rows)

    @cached_property
    def _rises_with_waves(self) -> bool:
        """Whether a level rises to whose normal force sines are added."""
        return self._rises_among(self.stretch.waves[0])

    def _rises_among(self, rows: Indices | tuple[int, ...]) -> bool:
        """Tell whether a static coefficient of one of these rows still rises at the start."""
        if not (self._dwelling.size and self._rising.size):
            return False
        return bool(np.isin(self._dwelling[self._rising], rows).any())

    def _all_series(self, tau: float, y: Array, scale: float, frozen: bool) -> list[Array | None]:
        """Return the Taylor coefficients of inputs and dwells, from those of the states."""
        found = self._input_series(tau, y.shape[0] - 1, scale, frozen)
        if self.dependence is None:
            return found
        size = self.system.inputs + self._dwelling.size
        orders = np.array([np.zeros(size) if part is None else part for part in found])
        self.dependence.add_linear(orders.T[: self.system.inputs], y.T, self.regions)
        return list(orders)

    def _extended(self, tau: float, y: Array) -> Array:
        """Return states, inputs, their slopes, dwells and their slopes at local time `tau` without sines."""
        stretch, size, inputs = self.stretch, self.system.size, self.system.inputs
        count = self._dwelling.size
        x = np.zeros(size + 2 * inputs + 2 * count)
        x[:size] = y
        q, slope = x[size : size + inputs], x[size + inputs : size + 2 * inputs]
        np.multiply(stretch.slope, self.t + tau - stretch.start, out=q)
        q += stretch.value
        slope[:] = stretch.slope
        if count and tau < self._over:
            rows = self._dwelling[self._rising]
            age = self._age + self._rate * tau
            factor = np.exp(-age) if tau == 0 else np.where(age < _DWELL_OVER, np.exp(-age), 0.0)
            dwells = x[size + 2 * inputs :].reshape(2, count)
            dwells[0, self._rising] = factor * q[rows]
            dwells[1, self._rising] = factor * slope[rows]
        return x

    def magnitudes(self, order: int) -> list[tuple[Array, Array]]:
        """Return what adds up in the inputs and in the watched quantities at the start, orders 0 to `order`.

        Their roundoff is a part of it. It is the series of the same equations with nothing cancelled.
        """
        y, found = np.abs(self.y), []
        for k, q in enumerate(self._input_magnitudes(order)):
            if self.dependence is not None:
                self._add_magnitudes(q, y, k == 0)
            rate, z = self.equations.magnitudes(y, q)
            found.append((q, z))
            y = rate / (k + 1)
        return found

    def guard_magnitudes(self, rows: GuardRows, order: int) -> Array:
        """Return the same of guards, an order per row."""
        sizes = None if self.dependence is not None else rows.sizes(order)
        if sizes is None:
            return np.array([rows.majorants(z, q) for q, z in self.magnitudes(order)])
        x = np.concatenate([np.abs(self.y), self._input_magnitudes(order).ravel()])
        found: Array = (sizes @ x).reshape(order + 1, -1)
        return found

    def _input_magnitudes(self, order: int) -> Array:
        """Return what adds up in inputs and dwells at the start, an order per row, without feedback."""
        parts = self.stretch.magnitudes(self.t, order)
        if not self._dwelling.size:
            return parts
        inputs = self.system.inputs
        found = np.zeros((order + 1, inputs + self._dwelling.size))
        found[:, :inputs] = parts
        if self._rising.size:
            normals = parts[:, self._dwelling[self._rising]]
            decay = self.system.decays(order)[:, self._rising]
            rises = np.zeros(normals.shape)
            for k in range(order + 1 if self.stretch.has_waves else 2):
                rises[k:] += decay[: order + 1 - k] * normals[k]
            found[:, inputs + self._rising] = rises
        return found

    # -- starts ----------------------------------------------------------------------------------------------

    @cached_property
    def start_inputs(self) -> Array:
        """Inputs and dwells at the start."""
        return self.inputs(0.0, self.y)

    @cached_property
    def first(self) -> Expansion:
        """Taylor coefficients at the start up to order 1, those of the states up to order 2."""
        if self.is_linear:
            return self.start
        q0 = self.start_inputs
        found = self.both(0.0, self.y, q0)
        rate, z0 = np.split(found, [self.system.size])
        q1 = self._input_rate(0.0, self.y, rate)
        second, z1 = np.split(self._slope(0.0, self.y, rate, q0, q1), [self.system.size])
        return Expansion(np.array([self.y, rate, 0.5 * second]), [q0, q1], np.array([z0, z1]))

    @cached_property
    def start(self) -> Expansion:
        """Taylor coefficients at the start up to order 2: exact if linear, the second by a difference if not."""
        if self.is_linear:
            return self.expand(0.0, self.y, 2)
        first, size, d = self.first, self.system.size, self.difference_step
        (y, rate, bend), (z0, z1) = first.y, first.z
        ahead = y + d * (rate + d * bend)
        rate_ahead = self.rate(d, ahead)
        q1_ahead = self._input_rate(d, ahead, rate_ahead)
        later = self._slope(d, ahead, rate_ahead, self.inputs(d, ahead), q1_ahead)
        q1 = first.q[1]
        assert q1 is not None
        z2, q2 = 0.5 * (later[size:] - z1) / d, 0.5 * (q1_ahead - q1) / d
        return Expansion(first.y, [*first.q, q2], np.array([z0, z1, z2]))

    @property
    def difference_step(self) -> float:
        """Step in s of differences along the motion."""
        return _DIFFERENCE * min(self.horizon or np.inf, 1.0)

    def _slope(self, tau: float, y: Array, rate: Array, q: Array, dq: Array) -> Array:
        """Return the derivatives of rates and watched quantities along the motion, whose inputs `q` change by `dq`."""
        equations, system = self.equations, self.system
        found = equations.apply(rate) + equations.respond(dq)
        if not self.has_law:
            return found
        w, normal, lag, z = self.law_arguments(y, q, tau)
        dw = system.relative_velocity(rate, dq)[equations.velocity_dependent]
        d = self.difference_step
        law = equations.law
        # normal force, dwell and bristles change slowly and smoothly: their part by a difference
        e = law.forces(w, normal, lag, z)
        moved_q = self.inputs(tau + d, y + d * rate)
        _, normal_d, lag_d, _ = self.law_arguments(y, moved_q, tau + d)
        z_d = z + d * rate[equations.bristle_places]
        by_time = (law.forces(w, normal_d, lag_d, z_d) - e) / d
        found += equations.push(law.slopes(w, normal, lag, z) * dw + by_time)
        if equations.bristle_places.size:
            now = law.bristle_rates(w, normal, z)
            found[equations.bristle_places] = (law.bristle_rates(w + d * dw, normal_d, z_d) - now) / d
        return found
