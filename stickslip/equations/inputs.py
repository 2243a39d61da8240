"""What drives a motion: loads, inputs that depend on the state, and levels that rise while rows rest."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from functools import cached_property

import numpy as np

from stickslip.equations.algebra.floats import Columns
from stickslip.equations.loads.loads import Segment
from stickslip.equations.mode_equations import ModeEquations
from stickslip.model.arrays import Array, Indices, Mask

DWELL_OVER = 40.0  # dwell times after which a static coefficient has risen to the last bit
_DIFFERENCE = 1e-5

_BESIDE = 1e-11  # part of a border by which a table may be looked up beyond it: roundoff
_NO_ROWS = np.empty(0, dtype=np.intp)
_NO_NUMBERS = np.empty(0)


class Inputs:
    """The inputs along a motion from a state on, and the states that its modes allow.

    `segment` are the loads up to the next break. The state `y` at the start `t` has its dependent velocities written
    through T; each row last became held at `since`.
    """

    def __init__(self, equations: ModeEquations, segment: Segment, t: float, y: Array, since: Array) -> None:
        equations = equations.for_drives_in(segment)
        self.equations, self.segment, self.t, self.y, self.since = equations, segment, t, y, since
        system = self.system = equations.system
        self.horizon = segment.stop - t
        self.dependence, self.table_regions = system.dependence, segment.table_regions
        self.is_straight, self.rises_push = segment.is_straight, equations.rises_push
        self._rising = self._rising_rows = _NO_ROWS
        self._over = -math.inf
        self._age = self._rate = _NO_NUMBERS
        if equations.resting_dwells.size:
            self._place_rising()

    def exact(self, tau: float | Array, y: Array) -> Array:
        """Return a state (or columns) with dependent velocities written through T."""
        equations = self.equations
        if not equations.dependent.size:
            return y
        y = y.copy()
        if not equations.is_driven:
            return equations.consistent(y, _NO_NUMBERS)
        return equations.consistent(y, self.system.drive_velocities(self.loads(tau)))

    @property
    def difference_step(self) -> float:
        """Step in s of differences along the motion."""
        return _DIFFERENCE * min(self.horizon or np.inf, 1.0)

    # -- values --------------------------------------------------------------------------------------------

    def loads(self, tau: float | Array) -> Array:
        """Return the inputs that loads are at local time `tau`, without what depends on the state."""
        if isinstance(tau, np.ndarray):
            return self.segment.sampled(self.t + tau)
        return self.segment.at(self.t, tau)

    def inputs(self, tau: float | Array, y: Array, wanted: Collection[int] | None = None) -> Array:
        """Return inputs and dwells at local time `tau`, one column per time where that is an array.

        Of functions and tables of the state only those with numbers in `wanted` are computed; None for all.
        """
        many = isinstance(tau, np.ndarray)
        q = self.loads(tau)
        if self.dependence is not None:
            y = self.exact(tau, y)
            self.dependence.fill(q, y, self.t + tau, tau, self.friction_of, wanted, self.table_regions)
        if not self.system.dwelling.size:
            return q
        full = np.zeros((self.system.inputs_and_dwells, *q.shape[1:]))
        full[: q.shape[0]] = q
        if self._rising.size:
            age, rate = (self._age[:, None], self._rate[:, None]) if many else (self._age, self._rate)
            decay = np.exp(-(age + rate * tau))
            full[q.shape[0] + self._rising] = decay * q[self._rising_rows]
        return full

    @cached_property
    def start_inputs(self) -> Array:
        """Inputs and dwells at the start."""
        return self.inputs(0.0, self.y)

    def looked_up(self, tau: float | Array, y: Array) -> Array:
        """Return the value at which each table is looked up, a line each, one column per time if `tau` is an array."""
        assert self.dependence is not None
        q = self.inputs(tau, y, self.dependence.for_tables)
        return self.dependence.looked_up(q[: self.system.inputs], self.exact(tau, y))

    def looked_up_by(self, table: int, tau: float, y: Array) -> float:
        """Return the value at which one table is looked up."""
        assert self.dependence is not None
        q = self.inputs(tau, y, self.dependence.for_table(table))
        return self.dependence.looked_up_by(table, q[: self.system.inputs], self.exact(tau, y))

    def has_left(self, tau: float | Array, y: Array) -> Mask | bool:
        """Tell whether a table has left the region whose line the motion follows, for each time.

        The motion need not be followed any further: with that line beyond its region it may grow beyond all bounds.
        """
        if not self.table_regions:
            return False
        low, high = self.limits
        x = self.looked_up(tau, y).T
        return np.asarray(((x < low) | (x > high)).any(axis=-1))

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """The values between which tables are in their regions; a motion may start beyond a region by roundoff."""
        assert self.dependence is not None
        x = self.looked_up(0.0, self.y)
        low, high = self.dependence.all_borders(self.table_regions)
        low, high = np.minimum(low, x), np.maximum(high, x)
        beside = np.maximum(_BESIDE * largest_finite(x, low, high), self.segment.beside)
        return low - beside, high + beside

    def normals(self, tau: float | Array, y: Array) -> Array:
        """Return the normal forces at local time `tau`."""
        return np.maximum(self.inputs(tau, y)[: self.system.m], 0.0)

    def friction_of(self, row: int, w: float, normal: float, tau: float, deflection: Sequence[float]) -> float:
        """Return the friction force of one row at local time `tau`, 0 where it is held."""
        return self.equations.friction_of(row, w, normal, self.t + tau - self.since[row], deflection)

    def in_columns(self, more: int) -> tuple[Columns, Array]:
        """Return inputs and dwells of a small motion as sums over columns, with room for so many `more` terms."""
        system, segment, inputs, t = self.system, self.segment, self.system.inputs, self.t
        dependence, places = self.dependence, self._rising
        most = segment.terms + (0 if dependence is None else dependence.width) + places.size + more
        columns = Columns(system.size, most)
        q = np.zeros((system.inputs_and_dwells, columns.count))
        segment.enter_columns(columns, q[:inputs], t)
        if dependence is not None:
            y = np.eye(system.size, columns.count, columns.states.start)
            if self.equations.dependent.size:
                self.equations.consistent(y, system.drive_velocities(q))
            friction = self.equations.force_in_floats
            dependence.enter_columns(columns, q, y, t, friction, self.table_regions)
        ages, rates = self._age.tolist(), self._rate.tolist()
        for place, row, age, rate in zip(places.tolist(), self._rising_rows.tolist(), ages, rates, strict=True):
            q[inputs + place, columns.add(_withheld, [columns.line(-age, -rate), q[row]])] = 1.0
        return columns, q

    # -- slopes --------------------------------------------------------------------------------------------

    def _input_rate(self, tau: float, y: Array, y_rate: Array) -> Array:
        """Return the derivatives of inputs and dwells along the motion."""
        rate = self.segment.rate(self.t + tau)
        if self.dependence is not None:
            self._add_rates(rate, tau, y, y_rate)
        if not self.system.dwelling.size:
            return rate
        full = np.zeros(self.system.inputs_and_dwells)
        full[: rate.size] = rate
        if self._rising.size:
            rows = self._rising_rows
            decay = np.exp(-(self._age + self._rate * tau))
            normal = self.inputs(tau, y)[rows]
            full[rate.size + self._rising] = decay * (rate[rows] - self._rate * normal)
        return full

    def _add_rates(self, rate: Array, tau: float, y: Array, y_rate: Array) -> None:
        """Add the rates of the inputs that depend on the state, in place; by differences if there are functions."""
        dependence = self.dependence
        assert dependence is not None
        if dependence.is_linear:
            dependence.add_linear(rate, y_rate, self.table_regions)
            return
        d, count = self.difference_step, rate.size
        now, soon, later = (self.inputs(tau + k * d, y + k * d * y_rate)[:count] for k in (0, 1, 2))
        places = dependence.places
        rate[places] = (4 * soon - 3 * now - later)[places] / (2 * d)

    def input_slopes(self, tau: float, y: Array) -> Array:
        """Return the derivatives of inputs and dwells with respect to the states that they depend on."""
        dependence = self.dependence
        assert dependence is not None
        q = self.inputs(tau, y)
        found = dependence.slopes(q, self.exact(tau, y), self.t + tau, tau, self.friction_of, self.table_regions)
        return self._with_dwells(found, tau)

    def input_changes(self, dy: Array, dq: Array) -> Array:
        """Return the changes of inputs and dwells at the start, for changes `dy` of the state and `dq` of loads.

        Each column is one change; a load also changes the inputs that depend on it.
        """
        found = dq.copy()
        if self.dependence is not None:
            self.dependence.add_changes(found[: self.system.inputs], dy, self._slopes_by_arguments)
        return self._with_dwells(found, 0.0)

    def _with_dwells(self, changes: Array, tau: float) -> Array:
        """Enter the changes of dwells, in place: at local time `tau` these follow normal forces."""
        if self._rising.size:
            decay = np.exp(-(self._age + self._rate * tau))
            changes[self.system.inputs + self._rising] = decay[:, None] * changes[self._rising_rows]
        return changes

    # -- levels that rise, and sines -----------------------------------------------------------------------

    def _place_rising(self) -> None:
        """Find the rows whose static coefficient is still rising, and the places of their dwells."""
        equations = self.equations
        places, rows, rate = equations.resting_dwells, equations.resting_rows, equations.resting_rates
        age = (self.t - self.since[rows]) * rate
        young = age < DWELL_OVER
        if np.count_nonzero(young) < young.size:
            places, rows, rate, age = places[young], rows[young], rate[young], age[young]
        self._rising, self._rising_rows, self._rate, self._age = places, rows, rate, age
        if places.size:
            self._over = max(((DWELL_OVER - age) / rate).tolist())

    def is_rising(self, tau: float) -> bool:
        """Tell whether a static coefficient still rises at local time `tau`."""
        return tau < self._over

    @cached_property
    def dwell_times(self) -> Array:
        """Dwell times of the rows whose static coefficients are still rising, each once, in order."""
        return np.unique(1.0 / self._rate) if self._rising.size else np.empty(0)

    def withheld(self, taus: Array) -> Array:
        """Return the part of each rise with a dwell that is still withheld at local times, one column each."""
        found = np.zeros((self.system.dwelling.size, taus.size))
        if self._rising.size:
            found[self._rising] = np.exp(-(self._age[:, None] + np.multiply.outer(self._rate, taus)))
        return found

    @cached_property
    def sines_rest(self) -> bool:
        """Whether sines move nothing: they only push bodies at rest, or press rows at rest."""
        segment, equations = self.segment, self.equations
        if not segment.has_sines:
            return True
        system, entries = self.system, segment.amplitudes.nonzero()[0]
        # each sine by itself: two whose amplitudes cancel still move something
        each = np.zeros((system.inputs_and_dwells, entries.size))
        each[entries, np.arange(entries.size)] = segment.amplitudes[entries]
        rate, _ = equations.majorants(np.zeros(system.size), each.sum(axis=1))
        moved = np.abs(equations.respond(each)[: system.size]) > 1e-12 * rate[:, None]
        return not (moved.any() or system.drive_velocities(each).any())

    @property
    def may_be_bounded(self) -> bool:
        """Whether rising levels and sines bend the guards only, and move nothing."""
        if self.segment.has_sines and self.dependence is not None:
            return False
        return not self.rises_push and self.sines_rest

    # -- series --------------------------------------------------------------------------------------------

    def decay(self, tau: float, order: int, scale: float, frozen: bool) -> tuple[Indices, Indices, Array] | None:
        """Return the rows whose static coefficients rise, the places of their dwells, and the series of these.

        With `frozen` they keep the values that they have at `tau`.
        """
        if not self._rising.size:
            return None
        age = self._age + self._rate * tau
        live = (age < DWELL_OVER).nonzero()[0]
        if not live.size:
            return None
        rows, places = self._rising_rows[live], self.system.inputs + self._rising[live]
        found = np.zeros((order + 1, live.size))
        found[0] = np.exp(-age[live])
        for k in range(0 if frozen else order):
            found[k + 1] = found[k] * (-self._rate[live] * scale / (k + 1))
        return rows, places, found

    def _input_series(self, tau: float, order: int, scale: float, frozen: bool) -> Array:
        """Return the Taylor coefficients of inputs and dwells without what depends on the state, a row per order."""
        series = self.segment.taylor(self.t + tau, order, scale, not (frozen and self.sines_rest))
        if not self.system.dwelling.size:
            return series
        full = np.zeros((order + 1, self.system.inputs_and_dwells))
        full[:, : self.system.inputs] = series
        decaying = self.decay(tau, order, scale, frozen)
        if decaying is not None:
            rows, places, decay = decaying
            for k in range(order + 1):
                full[k, places] = _of_product(decay, series[:, rows], k)
        return full

    def _all_series(self, tau: float, y: Array, scale: float, frozen: bool) -> Array:
        """Return the Taylor coefficients of inputs and dwells, from those of the states."""
        found = self._input_series(tau, y.shape[0] - 1, scale, frozen)
        if self.dependence is not None:
            self.dependence.add_linear(found.T[: self.system.inputs], y.T, self.table_regions)
        return found

    def _extended(self, tau: float, y: Array) -> Array:
        """Return states, inputs, their slopes, dwells and their slopes at local time `tau` without sines."""
        q, slope = self.segment.line(self.t + tau), self.segment.slope
        count = self.system.dwelling.size
        if not count:
            return np.concatenate([y, q, slope])
        dwells = np.zeros(2 * count)
        if tau < self._over:
            rows, places = self._rising_rows, self._rising
            age = self._age + self._rate * tau if tau else self._age
            factor = np.exp(-age)
            if tau:
                factor[age >= DWELL_OVER] = 0.0
            dwells[places] = factor * q[rows]
            dwells[places + count] = factor * slope[rows]
        return np.concatenate([y, q, slope, dwells])

    @property
    def begins_to_rise(self) -> bool:
        """Whether a level begins to rise at the start, so that its age is exact."""
        return self._rising.size > 0 and 0.0 in self._age.tolist()

    def extended_majorants(self, no_new_dwells: bool = False) -> Array:
        """Return majorants of states, inputs, dwells and their slopes at the start, and the amplitudes of sines.

        If `no_new_dwells`, dwells that begin there are left out.
        """
        segment, size = self.segment, self.system.size
        found = np.abs(self._extended(0.0, self.y))
        found[:size] = self.state_majorants
        if not segment.is_steady:
            value = np.abs((self.t - segment.start) * segment.slope)
            value += np.abs(segment.value)
            found[size : size + value.size] = value
        if no_new_dwells:
            begin = size + 2 * self.system.inputs + self._rising[self._age == 0]
            found[begin] = found[begin + self.system.dwelling.size] = 0.0
        return np.concatenate([found, np.abs(segment.sines.amplitude)]) if segment.has_sines else found

    @cached_property
    def state_majorants(self) -> Array:
        """Majorants of the states at the start: their roundoff is a part of these."""
        found, is_driven = np.abs(self.y), self.equations.is_driven
        u = self.system.drive_velocities(np.abs(self.start_inputs)) if is_driven else found[:0]
        return self.equations.write_led_majorants(found, u)

    @property
    def _rises_with_state(self) -> bool:
        """Whether a level rises whose normal force depends on the state."""
        return self.dependence is not None and self._rises_among(self.dependence.rows)

    @property
    def _rises_with_sines(self) -> bool:
        """Whether a level rises whose normal force has sines."""
        return self.segment.has_sines and self._rises_among(self.segment.sine_turns[0])

    def _rises_among(self, rows: Indices | tuple[int, ...]) -> bool:
        """Tell whether a static coefficient of one of these rows still rises at the start."""
        return self._rising.size > 0 and bool(np.isin(self._rising_rows, rows).any())

    # -- majorants -----------------------------------------------------------------------------------------

    def _input_majorants(self, order: int, no_new_dwells: bool = False) -> Array:
        """Return majorants of inputs and dwells at the start, an order per row, without what depends on the state.

        If `no_new_dwells`, dwells that begin there are left out.
        """
        parts = self.segment.majorants(self.t, order)
        if not self.system.dwelling.size:
            return parts
        inputs = self.system.inputs
        found = np.zeros((order + 1, self.system.inputs_and_dwells))
        found[:, :inputs] = parts
        if self._rising.size:
            normals = parts[:, self._rising_rows]
            decay = self.system.decays(order)[:, self._rising]
            rises = np.zeros(normals.shape)
            for k in range(order + 1 if self.segment.has_sines else 2):
                rises[k:] += decay[: order + 1 - k] * normals[k]
            if no_new_dwells:
                rises[:, self._age == 0] = 0.0
            found[:, inputs + self._rising] = rises
        return found

    def _add_majorants(self, q: Array, y: Array, values: bool) -> None:
        """Add majorants of the inputs that depend on the state, in place: of their `values`, or else of their rates."""
        dependence = self.dependence
        assert dependence is not None
        slopes = None if dependence.is_linear else self._slopes_by_arguments
        dependence.add_majorants(q, y, slopes, self.start_inputs if values else None)

    @cached_property
    def _slopes_by_arguments(self) -> list[Array]:
        assert self.dependence is not None
        y = self.exact(0.0, self.y)
        return self.dependence.slopes_by_arguments(
            self.start_inputs, y, self.t, 0.0, self.friction_of, self.table_regions
        )


def largest_finite(*values: Array) -> Array:
    """Return the largest size among some values that are finite."""
    found: Array = np.max(np.where(np.isfinite(values), np.abs(values), 0.0), axis=0)
    return found


class Linked:
    """The Taylor coefficients of inputs that depend linearly on the state, order by order."""

    def __init__(self, motion: Inputs, tau: float, order: int, scale: float, frozen: bool) -> None:
        self._motion = motion
        self.loads = motion.segment.taylor(motion.t + tau, order, scale)
        self.q = np.zeros((order + 1, motion.system.inputs_and_dwells))
        self._decay = motion.decay(tau, order, scale, frozen)

    def part(self, k: int, y: Array) -> Array:
        """Return order `k` of the inputs and dwells from order `k` of the states."""
        motion = self._motion
        full: Array = self.q[k]
        own = full[: motion.system.inputs]
        own[:] = self.loads[k]
        assert motion.dependence is not None
        motion.dependence.add_linear(own, y, motion.table_regions)
        if self._decay is not None:
            rows, places, decay = self._decay
            full[places] = _of_product(decay, self.q[:, rows], k)
        return full


def _of_product(decay: Array, normals: Array, k: int) -> Array:
    """Return order `k` of ``exp(-age - rate tau) N``, the product of both series."""
    return np.asarray((decay[k::-1] * normals[: k + 1]).sum(axis=0))


def _withheld(exponent: float, normal: float) -> float:
    """Return ``exp(-age / dwell) N``: what a level lacks until its dwell is over, but for the factor of its rise."""
    return math.exp(exponent) * normal
