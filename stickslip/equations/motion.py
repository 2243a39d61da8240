"""The motion from one instant on while its modes hold: rates, Jacobian, what is watched, and Taylor coefficients."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.equations.loads import Stretch
from stickslip.equations.matrices import dense
from stickslip.equations.mode_equations import ModeEquations

__all__ = ["Expansion", "Motion"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

_DWELL_OVER = 40.0
"""Dwell times after which a static coefficient has risen to the last bit."""

_DIFFERENCE = 1e-5


class Expansion:
    """Taylor coefficients ``scale^k f^(k) / k!`` of states, inputs and watched quantities, one row per order.

    Attributes
    ----------
    y : array (order + 1, size)
    q : list of array or None
        Inputs with dwells; None where a whole order is 0.
    z : array (order + 1, rows)
    g : array (order + 1, guards) or None
        The guards of the modes, but for constants, where they are told at once.
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


class Motion:
    """The equations in one set of modes from a state on. Local time tau runs from 0 at the start.

    Parameters
    ----------
    equations : ModeEquations
    stretch : Stretch
        The inputs up to the next break.
    t : float
        Start in s.
    y : array (size,)
        State at the start, dependent velocities written through T.
    since : array (m,)
        When each row last became held, in s.
    """

    def __init__(self, equations: ModeEquations, stretch: Stretch, t: float, y: Array, since: Array) -> None:
        self.equations, self.stretch, self.t, self.y, self.since = equations, stretch, t, y, since
        system = self.system = equations.system
        self.horizon = stretch.stop - t
        self.has_law = equations.acting.size > 0
        self.is_linear = not (self.has_law or stretch.has_functions)
        self._dwelling = system.dwelling
        self._over = -math.inf
        self.rises_push = equations.rises_push
        if self._dwelling.size:
            self._place_dwells()
        self.is_straight = stretch.is_straight
        self.is_polynomial = not (stretch.has_functions or self.has_law or equations.feeds_back)

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
        return not self.rises_push and (self.waves_rest or not self.stretch.has_waves)

    def is_rising(self, tau: float) -> bool:
        """Tell whether a static coefficient still rises at local time `tau`."""
        return tau < self._over

    @property
    def dwell_times(self) -> Array:
        """Dwell times of the rows whose static coefficients are still rising, each once."""
        return np.unique(1.0 / self._rate) if self._dwelling.size and self._rising.size else np.empty(0)

    def inputs(self, tau: float | Array) -> Array:
        """Return inputs and dwells at local time `tau`, one column per time where that is an array."""
        many = isinstance(tau, np.ndarray)
        q = (
            self.stretch.sampled(self.t + tau)
            if isinstance(tau, np.ndarray)
            else self.stretch.at(self.t + tau)
        )
        if not self._dwelling.size:
            return q
        full = np.zeros((q.shape[0] + self._dwelling.size, *q.shape[1:]))
        full[: q.shape[0]] = q
        if self._rising.size:
            age, rate = (self._age[:, None], self._rate[:, None]) if many else (self._age, self._rate)
            decay = np.exp(-(age + rate * tau))
            full[q.shape[0] + self._rising] = decay * q[self._dwelling[self._rising]]
        return full

    def _input_rate(self, tau: float) -> Array:
        rate = self.stretch.rate(self.t + tau)
        if not self._dwelling.size:
            return rate
        full = np.zeros(rate.size + self._dwelling.size)
        full[: rate.size] = rate
        if self._rising.size:
            rows = self._dwelling[self._rising]
            decay = np.exp(-(self._age + self._rate * tau))
            normal = self.stretch.at(self.t + tau)[rows]
            full[rate.size + self._rising] = decay * (rate[rows] - self._rate * normal)
        return full

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
        if not self._rising.size:
            return full
        age = self._age + self._rate * tau
        live = (age < _DWELL_OVER).nonzero()[0]
        rows, places = self._dwelling[self._rising[live]], size + self._rising[live]
        if frozen:
            factor = np.exp(-age[live])
            for part, wide in zip(series, full, strict=True):
                if part is not None and wide is not None:
                    wide[places] = factor * part[rows]
            return full
        # exp(-age - rate tau) N, as the product of both series
        decay = [np.exp(-age[live])]
        for k in range(order):
            decay.append(decay[-1] * (-self._rate[live] * scale / (k + 1)))
        normals = [None if part is None else part[rows] for part in series]
        known = [k for k, part in enumerate(normals) if part is not None]
        for k in range(order + 1):
            value = sum(decay[k - i] * normals[i] for i in known if i <= k)
            wide = full[k]
            if wide is None:
                wide = full[k] = np.zeros(size + count)
            wide[places] = value
        return full

    def normals(self, tau: float | Array) -> Array:
        """Return the normal forces at local time `tau`."""
        return np.maximum(self.inputs(tau)[: self.system.m], 0.0)

    # -- rates -----------------------------------------------------------------------------------------------

    def acting_terms(self, y: Array, q: Array, tau: float | Array) -> tuple[Array, Array, Array, Array]:
        """Return relative velocity, normal force, dwell lag and bristle deflection of the acting rows."""
        rows = self.equations.acting
        w, normal = self.system.relative_velocity(y, q)[rows], np.maximum(q[rows], 0.0)
        return w, normal, self._lag(tau, w), y[self.equations.bristle_places]

    def _lag(self, tau: float | Array, w: Array) -> Array:
        """Return what the dwell of the acting rows still withholds, an array like `w`."""
        lag = np.zeros(w.shape)
        some, age, dwell = self._acting_dwells
        if some.size:
            lag[some] = np.exp(-(np.add.outer(age, tau).T / dwell).T)
        return lag

    @cached_property
    def _acting_dwells(self) -> tuple[Indices, Array, Array]:
        rows = self.equations.acting
        dwell = self.system.dwell[rows]
        some = (dwell > 0).nonzero()[0]
        return some, self.t - self.since[rows[some]], dwell[some]

    @cached_property
    def _lines(self) -> tuple[Array, Array, Array, Array, Array, Array] | None:
        """What the inputs of a small motion do, where they are lines: each a value at the start and a slope.

        Rates and watched quantities; relative velocities, and normal forces, of the acting rows.
        """
        system, equations = self.system, self.equations
        if system.sparse or self.rises_push or not self.is_straight:
            return None
        value, slope = self.inputs(0.0), np.zeros(system.inputs + self._dwelling.size)
        slope[: system.inputs] = self.stretch.slope
        rows, none = equations.acting, np.zeros(system.size)
        w, bend = (system.relative_velocity(none, q)[rows] for q in (value, slope))
        return equations.respond(value), equations.respond(slope), w, bend, value[rows], slope[rows]

    def acting_forces(self, tau: float | Array, y: Array) -> Array:
        """Return the friction forces that depend on velocity."""
        return self.equations.law.forces(*self.acting_terms(y, self.inputs(tau), tau))

    def law_slopes(self, tau: float, y: Array) -> Array:
        """Return the derivatives of the friction forces that depend on velocity with respect to it."""
        return self.equations.law.slopes(*self.acting_terms(y, self.inputs(tau), tau))

    def both(self, tau: float | Array, y: Array) -> Array:
        """Return ``y'`` and what is watched in one array; states are columns where `tau` is an array."""
        equations = self.equations
        found = self._linear(tau, y)
        if self.has_law:
            lines = None if isinstance(tau, np.ndarray) else self._lines
            if lines is None:
                w, normal, lag, z = self.acting_terms(y, self.inputs(tau), tau)
            else:
                w = equations.acting_velocities @ y
                w += lines[2] + tau * lines[3]
                normal = np.maximum(lines[4] + tau * lines[5], 0.0)
                lag, z = self._lag(tau, w), y[equations.bristle_places]
            found += equations.push(equations.law.forces(w, normal, lag, z))
            if equations.bristle_places.size:
                found[equations.bristle_places] = equations.law.bristle_rates(w, normal, z)
        return found

    def _linear(self, tau: float | Array, y: Array) -> Array:
        """Return ``A y + B q`` and ``E y + H q``."""
        found = self.equations.apply(y)
        lines = None if isinstance(tau, np.ndarray) else self._lines
        if lines is None:
            found += self.equations.respond(self.inputs(tau))
        else:
            found += lines[0] + tau * lines[1]
        return found

    def row_forces(self, tau: float | Array, y: Array) -> Array:
        """Return the forces of all rows, one column per time where `tau` is an array."""
        equations, size, m = self.equations, self.system.size, self.system.m
        found = self.both(tau, y)[size:]
        forces: Array = equations.friction @ self.inputs(tau)
        if self.has_law:
            forces[equations.acting] = self.acting_forces(tau, y)
        forces[equations.held] = found[m : m + equations.held.size]
        return forces

    def rate(self, tau: float | Array, y: Array) -> Array:
        """Return ``y' = A y + B q + K e``."""
        return self.both(tau, y)[: self.system.size]

    def watched(self, tau: float | Array, y: Array) -> Array:
        """Return ``z = E y + H q + L e``."""
        equations = self.equations
        # the laws' forces reach what is watched only where forces are
        watches_forces = equations.held.size or equations.at_level.size
        found = self.both(tau, y) if watches_forces else self._linear(tau, y)
        return found[self.system.size :]

    def exact(self, tau: float | Array, y: Array) -> Array:
        """Return a state (or columns) with dependent velocities written through T."""
        equations = self.equations
        if not equations.dependent.size:
            return y
        y = np.array(y)
        if not equations.is_driven:
            return equations.consistent(y, np.empty(0))
        return equations.consistent(y, self.system.drive_velocities(self.inputs(tau)))

    def jacobian(self, tau: float, y: Array) -> Any:
        """Return ``d y' / d y``, dense or sparse as the scene is."""
        equations = self.equations
        matrix = equations.jacobian()
        if not self.has_law:
            return matrix
        terms = self.acting_terms(y, self.inputs(tau), tau)
        matrix = matrix + equations.law_jacobian(equations.law.slopes(*terms))
        return matrix if not equations.bristle_places.size else self._with_bristles(matrix, terms)

    def _with_bristles(self, matrix: Any, terms: tuple[Array, Array, Array, Array]) -> Any:
        """Add the entries of the bristles: ``dz'/dw W``, ``dz'/dz`` and ``K dr/dz``."""
        equations, system = self.equations, self.system
        law, places = equations.law, equations.bristle_places
        w, normal, _, z = terms
        by_w, by_z = law.bristle_slopes(w, normal, z)
        acting = equations.acting[law.bristles]
        size, count, n = system.size, places.size, system.n
        rows = scipy.sparse.csr_array((system.G @ equations.balance.T)[acting])
        rows = scipy.sparse.hstack([rows, scipy.sparse.csr_array((count, size - n))], format="csr")
        own = scipy.sparse.csr_array((np.ones(count), (places, np.arange(count))), shape=(size, count))
        units = np.zeros((equations.acting.size, count))
        units[law.bristles, np.arange(count)] = 1.0
        pushed = scipy.sparse.csr_array(equations.push(units)[:size])
        extra = own @ (scipy.sparse.diags_array(by_w) @ rows) + own @ scipy.sparse.diags_array(by_z) @ own.T
        extra = extra + pushed @ scipy.sparse.diags_array(law.by_bristle(w, normal, z)) @ own.T
        return (
            matrix + dense(extra)
            if isinstance(matrix, np.ndarray)
            else scipy.sparse.csr_array(matrix + extra)
        )

    # -- series ----------------------------------------------------------------------------------------------

    def expand(self, tau: float, y: Array, order: int, scale: float = 1.0, frozen: bool = False) -> Expansion:
        """Return the Taylor coefficients of a linear motion at local time `tau`.

        ``y_{k+1} = (A y_k + B q_k) / (k + 1)``; the state `y` has its dependent velocities written through T. With
        `frozen`, static coefficients keep the values that they have at `tau`, and sines that move nothing are left out.
        """
        equations, system = self.equations, self.system
        size, n = system.size, system.n
        if not self.stretch.has_waves or (frozen and self.waves_rest):
            taylor = equations.taylor(order, frozen)
            if taylor is not None and taylor.reaches(scale):
                y, z, g = taylor(self._extended(tau, y), scale)
                return Expansion(y, lambda: self._input_series(tau, order, scale, frozen), z, g)
        q = self._input_series(tau, order, scale, frozen)
        ys, zs = np.zeros((order + 1, size)), np.zeros((order + 1, equations.rows))
        ys[0] = y
        finite = False
        for k in range(order + 1):
            part = q[k]
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
                u = q[k + 1]
                led = equations.T_dependent @ following[:n]
                if equations.is_driven and u is not None:
                    led = led + equations.U_dependent @ system.drive_velocities(u)
                following[equations.dependent] = led
            finite = not following.any()
        return Expansion(ys, q, zs)

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
        size = self.system.inputs + self._dwelling.size
        y, found = np.abs(self.y), []
        parts = self.stretch.magnitudes(self.t, order)
        for k in range(order + 1):
            q = np.zeros(size)
            q[: self.system.inputs] = parts[k]
            if self._dwelling.size and self._rising.size:
                rows = self._dwelling[self._rising]
                fall = [self._rate**i / math.factorial(i) for i in range(k + 1)]
                q[self.system.inputs + self._rising] = sum(fall[i] * parts[k - i][rows] for i in range(k + 1))
            rate, z = self.equations.magnitudes(y, q)
            found.append((q, z))
            y = rate / (k + 1)
        return found

    # -- starts ----------------------------------------------------------------------------------------------

    @cached_property
    def start_inputs(self) -> Array:
        """Inputs and dwells at the start."""
        return self.inputs(0.0)

    @cached_property
    def start(self) -> Expansion:
        """Taylor coefficients at the start up to order 2: exact if linear, the second by a difference if not."""
        if self.is_linear:
            return self.expand(0.0, self.y, 2)
        size = self.system.size
        found = self.both(0.0, self.y)
        rate = found[:size]
        slope = self._slope(0.0, self.y, rate)
        second, z1 = slope[:size], slope[size:]
        d = self.difference_step
        ahead = self.y + d * (rate + 0.5 * d * second)
        later = self._slope(d, ahead, self.rate(d, ahead))
        z2 = 0.5 * (later[size:] - z1) / d
        y = np.array([self.y, rate, 0.5 * second])
        q = [self.inputs(0.0), self._input_rate(0.0), np.zeros_like(self.inputs(0.0))]
        q[2] = 0.5 * (self._input_rate(d) - q[1]) / d
        return Expansion(y, list(q), np.array([found[size:], z1, z2]))

    @property
    def difference_step(self) -> float:
        """Step in s of differences along the motion."""
        return _DIFFERENCE * min(self.horizon or np.inf, 1.0)

    def _slope(self, tau: float, y: Array, rate: Array) -> Array:
        """Return the derivatives of rates and watched quantities along the motion."""
        equations, system = self.equations, self.system
        dq = self._input_rate(tau)
        found = equations.apply(rate) + equations.respond(dq)
        if not self.has_law:
            return found
        q = self.inputs(tau)
        w, normal, lag, z = self.acting_terms(y, q, tau)
        dw = system.relative_velocity(rate, dq)[equations.acting]
        d = self.difference_step
        law = equations.law
        # normal force, dwell and bristles change slowly and smoothly: their part by a difference
        e = law.forces(w, normal, lag, z)
        moved_q = self.inputs(tau + d)
        _, normal_d, lag_d, _ = self.acting_terms(y, moved_q, tau + d)
        z_d = z + d * rate[equations.bristle_places]
        by_time = (law.forces(w, normal_d, lag_d, z_d) - e) / d
        found += equations.push(law.slopes(w, normal, lag, z) * dw + by_time)
        if equations.bristle_places.size:
            now = law.bristle_rates(w, normal, z)
            found[equations.bristle_places] = (law.bristle_rates(w + d * dw, normal_d, z_d) - now) / d
        return found
