"""Motion in fixed modes, in local time: inputs, rates, and interpolation between computed points."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stickslip.assembly import System
from stickslip.mode_set import ModeSet

__all__ = ["PER_PERIOD", "Motion", "hermite", "line"]

Array = NDArray[np.float64]

PER_PERIOD = 16
"""Times per period at which curved loads are looked at."""


def line(c0: Array, c1: Array, tau: float | Array) -> Array:
    """Return ``c0 + c1 tau``: one column per time where `tau` is an array."""
    return c0[:, None] + np.multiply.outer(c1, tau) if isinstance(tau, np.ndarray) else c0 + tau * c1


class Motion:
    """The equations of one mode set from time `t` on, without regard to when the modes end.

    Parameters
    ----------
    system : System
        With its loads.
    mode_set : ModeSet
    t : float
        Start in s.
    y : array (size,)
        State at the start, velocities of stuck bodies exactly equal.
    since : array (m,)
        When each contact last became stuck, in s.
    stop : float
        The next break in s.
    """

    def __init__(
        self, system: System, mode_set: ModeSet, t: float, y: Array, since: Array, stop: float
    ) -> None:
        self.system, self.mode_set, self.t, self.y, self.since = system, mode_set, t, y, since
        self.horizon = stop - t
        self._before_stop = math.nextafter(stop, -math.inf)
        self.q0, self.q1 = system.loads.at(t)
        self._place_curved()
        self._expand()

    # -- inputs -------------------------------------------------------------------------------------------

    @cached_property
    def _responses(self) -> tuple[Array, Array, Array, Array]:
        """Constant and slope of the rates, then of what is watched: ``B q`` and ``H q`` of the straight inputs."""
        size = self.system.size
        constant, slope = self.mode_set.respond(self.q0), self.mode_set.respond(self.q1)
        return constant[:size], slope[:size], constant[size:], slope[size:]

    def _place_curved(self) -> None:
        """Columns of the inputs that no straight line holds, where they matter."""
        curved = self.system.loads.curved
        self.has_curved = curved.size > 0
        self.has_law = self.mode_set.acting.size > 0
        if not self.has_curved:
            self.curved_rates = self.has_law
            return
        units = np.zeros((curved.size, self.system.inputs))
        units[np.arange(curved.size), curved] = 1.0
        responses = np.column_stack([self.mode_set.respond(unit) for unit in units])
        self._b_curved, self._h_curved = np.split(responses, [self.system.size])
        self.curved_rates = bool(self._b_curved.any()) or self.has_law

    def _curved_inputs(self, tau: float | Array) -> Array:
        # at the end of the segment a load may jump: what counts is its left limit
        times = np.minimum(self.t + tau, self._before_stop)
        return self.system.loads.curved_at(times if isinstance(tau, np.ndarray) else float(times))

    def looks(self, tau: float, fewest: int) -> Array:
        """Return times from 0 to `tau` so close that no turn of a curved load hides between them."""
        count = math.ceil(PER_PERIOD * tau / self.system.loads.period) if self.has_curved else 0
        return np.linspace(0.0, tau, max(count, fewest) + 1)

    def inputs(self, tau: float | Array) -> Array:
        """Return the whole input vector at local time `tau`, one column per time where that is an array."""
        q = line(self.q0, self.q1, tau)
        if self.has_curved:
            q[self.system.loads.curved] = self._curved_inputs(tau)
        return q

    def normals(self, tau: float | Array) -> Array:
        """Return the normal forces at local time `tau`."""
        return np.maximum(self.inputs(tau)[: self.system.m], 0.0)

    def closed(self, tau: float) -> NDArray[np.bool_]:
        """Tell which contacts are pressed together at local time `tau`."""
        return self.system.alive & (self.inputs(tau)[: self.system.m] > 0)

    def relative_velocity(self, tau: float | Array, y: Array) -> Array:
        """Return ``w = v_a - v_b`` of every contact."""
        w = self.system.W @ y
        return w + self.system.D @ self.inputs(tau) if self.system.drives else w

    def acting_terms(self, tau: float | Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return relative velocity, normal force, dwell lag and bristle deflection of the acting contacts."""
        mode_set, system = self.mode_set, self.system
        rows = mode_set.acting
        w = self.relative_velocity(tau, y)[rows]
        dwell = system.dwell[rows]
        rate = np.divide(1.0, dwell, out=np.zeros_like(dwell), where=dwell > 0)
        lag = np.exp(-line((self.t - self.since[rows]) * rate, rate, tau))
        lag[dwell == 0] = 0.0
        return w, self.normals(tau)[rows], lag, y[mode_set.bristle_places]

    def acting_forces(self, tau: float | Array, y: Array) -> Array:
        """Return the friction forces of the contacts that act through their velocity."""
        return self.mode_set.law.forces(*self.acting_terms(tau, y))

    # -- rates --------------------------------------------------------------------------------------------

    def rate(self, tau: float | Array, y: Array) -> Array:
        """Return ``y' = A y + b0 + b1 tau`` and what is curved; states are columns where `tau` is an array."""
        mode_set = self.mode_set
        rate = mode_set.A @ y
        b0, b1, _, _ = self._responses
        rate += line(b0, b1, tau)
        if self.has_curved:
            rate += self._b_curved @ self._curved_inputs(tau)
        if self.has_law:
            w, normal, lag, z = self.acting_terms(tau, y)
            rate += mode_set.K @ mode_set.law.forces(w, normal, lag, z)
            if mode_set.bristle_places.size:
                rate[mode_set.bristle_places] = mode_set.law.bristle_rates(w, normal, z)
        if mode_set.follow.size:
            rate[mode_set.follow] = rate[mode_set.lead]
        return rate

    def jacobian(self, tau: float, y: Array) -> Any:
        """Return the matrix ``d y' / d y``, dense or sparse as the scene is."""
        mode_set = self.mode_set
        if not self.has_law:
            return mode_set.A
        terms = self.acting_terms(tau, y)
        matrix = mode_set.A + mode_set.law_jacobian(mode_set.law.slopes(*terms))
        return matrix if not mode_set.bristle_places.size else self._with_bristles(matrix, terms)

    def _with_bristles(self, matrix: Any, terms: tuple[Array, Array, Array, Array]) -> Any:
        """Add the entries of the bristles: ``dz'/dw W``, ``dz'/dz`` and ``K dr/dz``."""
        mode_set = self.mode_set
        law, places = mode_set.law, mode_set.bristle_places
        w, normal, _, z = terms
        by_w, by_z = law.bristle_slopes(w, normal, z)
        sigma = self.system.coefficients.sigma[mode_set.acting[law.bristles]]
        size, count = self.system.size, places.size
        rows = sparse.csr_array(mode_set.acting_rows)[law.bristles]
        own = sparse.csr_array((np.ones(count), (places, np.arange(count))), shape=(size, count))
        pushed = sparse.csc_array(mode_set.K)[:, law.bristles]
        extra = own @ (sparse.diags_array(by_w) @ rows) + own @ sparse.diags_array(by_z) @ own.T
        extra = extra + pushed @ sparse.diags_array(sigma[:, 0] + sigma[:, 1] * by_z) @ own.T
        return (
            matrix + extra.toarray() if isinstance(matrix, np.ndarray) else sparse.csr_array(matrix + extra)
        )

    def second_rate(self, tau: float | Array, y: Array, rate: Array) -> Array:
        """Return ``y''``: exact where the rates are linear, by differences along the motion elsewhere."""
        if not self.curved_rates:
            b1 = self._responses[1]
            return self.mode_set.A @ rate + (b1 if rate.ndim == 1 else b1[:, None])
        if not isinstance(tau, np.ndarray):
            return self.second_rate(np.array([tau]), y[:, None], rate[:, None])[:, 0]
        d = self._difference_step
        # central, but never across the ends of the segment, where loads turn
        first, last = tau < d, tau > self.horizon - d
        middle = np.where(first, d, np.where(last, -d, 0.0))
        ahead, behind = (self.rate(tau + step, y + step * rate) for step in (middle + d, middle - d))
        found = (ahead - behind) / (2 * d)
        for ends, side in ((first, d), (last & ~first, -d)):
            if ends.any():
                near, far = (
                    self.rate(tau[ends] + step, y[:, ends] + step * rate[:, ends])
                    for step in (side, 2 * side)
                )
                found[:, ends] = (-3 * rate[:, ends] + 4 * near - far) / (2 * side)
        return found

    @property
    def _difference_step(self) -> float:
        return 1e-4 * min(self.horizon or np.inf, self.system.loads.period, 1.0)

    def _expand(self) -> None:
        """Find the Taylor coefficients at the start, and whether the motion is exactly quadratic in time.

        It is wherever no spring or damper acts.
        """
        self.quadratic = False
        if self.has_curved or self.has_law:
            self.f0 = self.rate(0.0, self.y)
            if self.curved_rates:
                return
        mode_set = self.mode_set
        self.expansion = mode_set.expand(self.y, self.q0, self.q1)
        self.f0, self.f1 = self.expansion.f0, self.expansion.f1
        if mode_set.follow.size:
            # identical rows may round differently within a product
            self.f0[mode_set.follow], self.f1[mode_set.follow] = (
                self.f0[mode_set.lead],
                self.f1[mode_set.lead],
            )
        self.quadratic = not np.count_nonzero(self.expansion.bends)

    def state(self, tau: float | Array) -> Array:
        """Return the state of a quadratic motion, one column per time where `tau` is an array."""
        return self.states(tau).T if isinstance(tau, np.ndarray) else self.states(tau)

    def states(self, tau: float | Array) -> Array:
        """Return the state of a quadratic motion, one row per time where `tau` is an array."""
        if isinstance(tau, np.ndarray):
            tau = tau[:, None]
        return self.y + tau * (self.f0 + (0.5 * tau) * self.f1)

    def relative_acceleration(self, tau: float, rates: Array) -> Array:
        """Return ``w'`` of every contact."""
        return self.system.W @ rates + self.system.D @ self.drive_acceleration(tau)

    @property
    def open_velocity(self) -> tuple[Array, Array, Array]:
        """Relative velocities of the open contacts in a quadratic motion: columns of coefficients."""
        rows, system = self.mode_set.open_rows, self.system
        w0, w1, w2 = rows @ self.y, rows @ self.f0, 0.5 * (rows @ self.f1)
        if system.drives:
            contacts = self.mode_set.open
            w0 = w0 + (system.D @ self.q0)[contacts]
            w1 = w1 + (system.D @ self.q1)[contacts]
        return w0[:, None], w1[:, None], w2[:, None]

    def drive_acceleration(self, tau: float) -> Array:
        """Return the accelerations of the drives, as inputs in the places of their velocities."""
        return self.system.drive_accelerations(self.inputs(tau))

    # -- many times at once -------------------------------------------------------------------------------

    def exact_velocities(self, taus: Array, states: Array) -> None:
        """Set the velocities of stuck bodies exactly equal, and those of held ones to their holder's, in place."""
        mode_set, system = self.mode_set, self.system
        if mode_set.follow.size:
            states[:, mode_set.follow] = states[:, mode_set.lead]
        if not mode_set.held.size:
            return
        for holder in set(mode_set.holder.tolist()):
            bodies = mode_set.held[mode_set.holder == holder]
            if holder == system.n + system.drives:
                states[:, bodies] = 0.0
            else:
                velocity = system.velocities[holder - system.n].sampled(self.t + taus)
                # the left limit where the velocity jumps at the end
                velocity[-1] = self.inputs(float(taus[-1]))[system.first_drive + holder - system.n]
                states[:, bodies] = velocity[:, None]

    def between(self, taus: Array, states: Array) -> Callable[[Array], Array]:
        """Return the interpolant of points that a fixed step has computed (rows): Hermite, order 5.

        A friction law has a kink at rest, and second rates by differences would reach across it: with a law acting
        the interpolant is the cubic one, order 3, whose error is no larger than that of the steps.
        """
        columns = states.T
        rates = self.rate(taus, columns)
        seconds = None if self.has_law else self.second_rate(taus, columns, rates).T
        return lambda query: hermite(taus, states, rates.T, seconds, query)


def hermite(taus: Array, states: Array, rates: Array, seconds: Array | None, query: Array) -> Array:
    """Return the Hermite interpolant through values, slopes and, where they are given, curvatures."""
    i = np.clip(np.searchsorted(taus, query, side="right") - 1, 0, max(taus.size - 2, 0))
    if taus.size == 1:
        return np.repeat(states, query.size, axis=0)
    h = (taus[i + 1] - taus[i])[:, None]
    x = (query[:, None] - taus[i][:, None]) / h
    u = 1.0 - x
    if seconds is None:
        left, right = (1 + 2 * x) * states[i] + x * h * rates[i], states[i + 1]
        return u * u * left + x * x * ((1 + 2 * u) * right - u * h * rates[i + 1])
    return u**3 * (
        (1 + x * (3 + 6 * x)) * states[i] + x * h * ((1 + 3 * x) * rates[i] + 0.5 * x * h * seconds[i])
    ) + x**3 * (
        (1 + u * (3 + 6 * u)) * states[i + 1]
        - u * h * ((1 + 3 * u) * rates[i + 1] - 0.5 * u * h * seconds[i + 1])
    )
