"""One stretch of motion in fixed modes: rates, guards and interpolation in local time.

Time runs from 0 at the segment's start, so that events late in a long run are as sharp as early ones. Guards are
positive while the modes hold: relative velocity times mode of a slipping contact, ``B - lambda`` and
``B + lambda`` of a stuck one.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from stickslip.assembly import ModeSet

__all__ = ["AT_LIMIT", "Segment"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

AT_LIMIT = 1e-10
"""Relative distance within which a contact force is at its breakaway level."""

_ROUNDOFF = 1e-12
_CONSTANT = 1e-7
_DWELL_OVER = 40.0
_NEVER = np.iinfo(np.intp).max


def _line(c0: Array, c1: Array, tau: float | Array) -> Array:
    """Return ``c0 + c1 tau``: one column per time where `tau` is an array."""
    return c0[:, None] + np.multiply.outer(c1, tau) if isinstance(tau, np.ndarray) else c0 + tau * c1


class Segment:
    """The equations of one mode set from time `t` on.

    Parameters
    ----------
    mode_set : ModeSet
    t : float
        Start in s.
    y : array (size,)
        State at the start, velocities of stuck bodies exactly equal.
    since : array (m,)
        When each contact last became stuck, in s.
    at_rest : array (m,) of bool
        Contacts whose relative velocity is 0 at the start.
    stop : float
        The next break in s; it sets the scale below which a rate is zero.
    """

    def __init__(
        self, mode_set: ModeSet, t: float, y: Array, since: Array, at_rest: NDArray[np.bool_], stop: float
    ) -> None:
        self.mode_set, self.t, self.y, self.since, self.at_rest = mode_set, t, y, since, at_rest
        self.horizon = stop - t
        system = self.system = mode_set.system
        q0, q1 = system.loads.at(t)
        self.q0, self.q1 = q0, q1
        self.b0, self.b1 = mode_set.B @ q0, mode_set.B @ q1
        self.h0, self.h1 = mode_set.H @ q0, mode_set.H @ q1
        self.held = np.concatenate([mode_set.stuck, mode_set.pre])
        self.slips, self.helds = mode_set.slip.size, self.held.size
        self.threshold = np.where(at_rest, 0.0, system.coefficients.threshold)[mode_set.slip]
        self._place_curved()
        self._place_levels()
        self.f0 = self.rate(0.0, y)
        self._find_polynomial()

    # -- inputs -------------------------------------------------------------------------------------------

    def _place_curved(self) -> None:
        """Columns of the inputs that no straight line holds, where they matter."""
        curved = self.system.loads.curved
        self.has_curved = bool(curved.size)
        self.has_law = bool(self.mode_set.acting.size)
        if not self.has_curved:
            self.curved_rates = self.has_law
            return
        units = np.zeros((curved.size, self.system.loads.size))
        units[np.arange(curved.size), curved] = 1.0
        self._b_curved = np.column_stack([self.mode_set.B @ unit for unit in units])
        self._h_curved = np.column_stack([self.mode_set.H @ unit for unit in units])
        self.curved_rates = bool(self._b_curved.any()) or self.has_law

    def _curved_inputs(self, tau: float | Array) -> Array:
        return self.system.loads.curved_at(self.t + tau)

    def inputs(self, tau: float | Array) -> Array:
        """Return the whole input vector at local time `tau`, one column per time where that is an array."""
        q = _line(self.q0, self.q1, tau)
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
        return self.system.W @ y + self.system.D @ self.inputs(tau)

    def acting_terms(self, tau: float | Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return relative velocity, normal force, dwell lag and bristle deflection of the acting contacts."""
        mode_set, system = self.mode_set, self.system
        rows = mode_set.acting
        w = self.relative_velocity(tau, y)[rows]
        dwell = system.dwell[rows]
        rate = np.divide(1.0, dwell, out=np.zeros_like(dwell), where=dwell > 0)
        lag = np.exp(-_line((self.t - self.since[rows]) * rate, rate, tau))
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
        rate += _line(self.b0, self.b1, tau)
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
        return matrix + extra.toarray() if isinstance(matrix, np.ndarray) else sparse.csr_array(matrix + extra)

    def second_rate(self, tau: float | Array, y: Array, rate: Array) -> Array:
        """Return ``y''``: exact where the rates are linear, by central difference along the motion elsewhere."""
        if not self.curved_rates:
            return self.mode_set.A @ rate + (self.b1 if rate.ndim == 1 else self.b1[:, None])
        d = self._difference_step
        return (self.rate(tau + d, y + d * rate) - self.rate(tau - d, y - d * rate)) / (2 * d)

    @property
    def _difference_step(self) -> float:
        return 1e-4 * min(self.horizon, self.system.loads.period, 1.0)

    def _find_polynomial(self) -> None:
        """Find out whether the motion is exactly quadratic in time, as it is wherever no spring or damper acts."""
        self.quadratic = False
        if self.curved_rates:
            return
        self.f1 = self.mode_set.A @ self.f0 + self.b1
        self.quadratic = not np.any(self.mode_set.A @ self.f1)
        if self.quadratic and self.mode_set.follow.size:
            self.f1[self.mode_set.follow] = self.f1[self.mode_set.lead]

    def state(self, tau: float | Array) -> Array:
        """Return the state of a quadratic motion."""
        if isinstance(tau, np.ndarray):
            return self.y[:, None] + tau * (self.f0[:, None] + 0.5 * tau * self.f1[:, None])
        return self.y + tau * (self.f0 + (0.5 * tau) * self.f1)

    # -- guards -------------------------------------------------------------------------------------------

    def _place_levels(self) -> None:
        """Breakaway coefficients of the held contacts, upper levels first, then lower ones."""
        system = self.system
        both = np.tile(self.held, 2)
        side = np.repeat([0, 1], self.helds)
        self._contact = both
        self._mu_s = system.mu_s[side, both]
        self._rise = np.where(
            system.dwell[both] > 0, self._mu_s - np.maximum(system.mu_c, system.mu_0)[side, both], 0.0
        )
        tau = system.dwell[both]
        self._rate = np.divide(1.0, tau, out=np.zeros_like(tau), where=tau > 0)
        self._age = (self.t - self.since[both]) * self._rate
        self._rising = bool(np.any((self._rise > 0) & (self._age < _DWELL_OVER)))
        self._n0, self._n1 = self.q0[both], self.q1[both]
        self._is_pre = self.mode_set.pre.size > 0
        if self._is_pre:
            # a contact in pre-slip is held by its pre-slip velocity, whatever presses it together
            pre = np.tile(np.arange(self.helds) >= self.mode_set.stuck.size, 2)
            self._pre = pre
            self._mu_s = np.where(pre, system.coefficients.velocity[both], self._mu_s)
            self._rise, self._n0, self._n1 = (np.where(pre, x, y) for x, y in
                ((0.0, self._rise), (1.0, self._n0), (0.0, self._n1)))
        self._curved_normal = self.has_curved and bool(np.isin(both, self.system.loads.curved).any())
        self._l0, self._l1 = self._mu_s * self._n0, self._mu_s * self._n1

    @property
    def dwell_times(self) -> Array:
        """Dwell times of the stuck contacts whose static coefficients are still rising, each once."""
        rising = (self._rise > 0) & (self._age < _DWELL_OVER)
        return np.unique(1.0 / self._rate[rising]) if self._rising else np.empty(0)

    def _lag(self, tau: float | Array) -> Array:
        """Return how far the static coefficients still are from their final values."""
        decay = np.exp(-_line(self._age, self._rate, tau))
        return self._rise[:, None] * decay if decay.ndim == 2 else self._rise * decay

    def levels(self, tau: float | Array) -> Array:
        """Return the breakaway levels of the stuck contacts, upper then lower."""
        if self._curved_normal:
            lag = self._lag(tau)
            mu_s = self._mu_s[:, None] if lag.ndim == 2 else self._mu_s
            normal = self.normals(tau)[self._contact]
            if self._is_pre:
                normal[self._pre] = 1.0
            return (mu_s - lag) * normal
        level = _line(self._l0, self._l1, tau)
        if self._rising:
            level -= self._lag(tau) * _line(self._n0, self._n1, tau)
        return level

    def watched(self, tau: float | Array, y: Array) -> Array:
        """Return what the guards watch: relative velocity times mode of the slipping contacts (less the velocity
        at which they are held again), the forces of the stuck ones, the relative velocities of those in pre-slip.
        """
        z = self.mode_set.E @ y
        z += _line(self.h0, self.h1, tau)
        if self.threshold.any():
            z[: self.slips] -= self.threshold if z.ndim == 1 else self.threshold[:, None]
        if self.has_curved:
            z += self._h_curved @ self._curved_inputs(tau)
        if self.has_law:
            z += self.mode_set.L @ self.acting_forces(tau, y)
        return z

    def raw_guards(self, tau: float | Array, z: Array) -> Array:
        """Return the guards as they are: slipping contacts, then upper and lower levels of the stuck ones."""
        k, s = self.slips, self.helds
        g = np.empty((k + 2 * s, *z.shape[1:]))
        g[:k] = z[:k]
        if s:
            level = self.levels(tau)
            np.subtract(level[:s], z[k:], out=g[k : k + s])
            np.add(level[s:], z[k:], out=g[k + s :])
        return g

    @cached_property
    def taylor(self) -> tuple[Array, Array, Array]:
        """Guards at the start, their first derivatives and half their second ones."""
        z0 = self.watched(0.0, self.y)
        if self.curved_rates or self.has_curved:
            return self._taylor_by_differences(z0)
        f1 = self.f1
        z1, z2 = self.mode_set.E @ self.f0 + self.h1, 0.5 * (self.mode_set.E @ f1)
        k, s = self.slips, self.helds
        level = self.levels(0.0)
        lag = self._lag(0.0) if self._rising else np.zeros(2 * s)
        slope = self._l1 - lag * self._n1 + lag * self._rate * self._n0
        bend = lag * self._rate * (self._n1 - 0.5 * self._rate * self._n0)
        parts = []
        for z, b in ((z0, level), (z1, slope), (z2, bend)):
            parts.append(np.concatenate([z[:k], b[:s] - z[k:], b[s:] + z[k:]]))
        return parts[0], parts[1], parts[2]

    def _taylor_by_differences(self, z0: Array) -> tuple[Array, Array, Array]:
        d = self._difference_step
        f1 = self.second_rate(0.0, self.y, self.f0) if self.curved_rates else self.f1
        g0 = self.raw_guards(0.0, z0)
        ahead = []
        for tau in (d, 2 * d):
            y = self.y + tau * (self.f0 + 0.5 * tau * f1)
            ahead.append(self.raw_guards(tau, self.watched(tau, y)))
        g1 = (-3 * g0 + 4 * ahead[0] - ahead[1]) / (2 * d)
        g2 = (ahead[1] - 2 * ahead[0] + g0) / (2 * d * d)
        return g0, g1, g2

    @cached_property
    def guard_contacts(self) -> Indices:
        """The contact of each guard."""
        return np.concatenate([self.mode_set.slip, self.held, self.held])

    def guard_scales(self) -> tuple[Array, Array]:
        """Return for each guard the size of what it compares, and the roundoff it carries."""
        k, s = self.slips, self.helds
        y, q = np.abs(self.y), np.abs(self.inputs(0.0))
        system = self.system
        body = abs(system.C) @ y + abs(system.Q) @ q
        body += abs(system.force_of_contacts) @ (system.mu_s.max(axis=0) * q[: system.m])
        z = np.abs(self.watched(0.0, self.y)[k:])
        level = self.levels(0.0)
        groups = self.mode_set.groups
        total = np.bincount(groups._label, weights=body, minlength=system.n)[groups._label]
        force_noise = self._at_ends(total, self.held)
        force_noise[self.mode_set.stuck.size :] = z[self.mode_set.stuck.size :]
        noise = np.concatenate([self._at_ends(body / system.inertia, self.mode_set.slip), force_noise, force_noise])
        speed = self._at_ends(y[: system.n], self.mode_set.slip)
        size = np.concatenate([speed, level[:s] + z, level[s:] + z])
        return size, _ROUNDOFF * noise

    def _at_ends(self, values: Array, contacts: Indices) -> Array:
        system = self.system
        wide = np.append(values, np.zeros(system.drives + 1))
        return wide[system.a[contacts]] + wide[system.b[contacts]]

    def classify(self, fired: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], Indices]:
        """Tell which guards are violated at the start or just after it, and with which order the others leave 0.

        Parameters
        ----------
        fired : array (m,) of bool
            Contacts that an event has just found at their limit.

        Returns
        -------
        violated : array of bool
        order : array of int
            0 where the guard is positive, k where it starts as tau^k, a huge number where it stays 0.
        """
        g0, g1, g2 = self.taylor
        k, s = self.slips, self.helds
        resting = self.at_rest[self.mode_set.slip]
        order = np.zeros(k + 2 * s, dtype=np.intp)
        violated = np.zeros(k + 2 * s, dtype=bool)
        level = 0.5 * (g0[k : k + s] + g0[k + s :])
        if not (resting.any() or np.any(g0 <= 0) or np.any(g0[k:] <= 1e-5 * np.tile(level, 2))):
            return violated, order
        size, noise = self.guard_scales()
        closeness = np.where(fired[self.guard_contacts], 1e-6, AT_LIMIT)
        zero = np.abs(g0) <= closeness * size + noise
        zero[:k] = resting
        violated = ~zero & (g0 < 0)
        if zero.any():
            # a slipping contact's guard is a velocity, so its slope compares with accelerations
            horizon = max(self.horizon, np.finfo(float).tiny)
            tolerance = np.where(np.arange(g0.size) < k, noise * 1e2, (AT_LIMIT * size + noise) / horizon)
            down, up = g1 < -tolerance, g1 > tolerance
            flat = ~down & ~up
            bend = g2 * horizon
            down |= flat & (bend < -tolerance)
            violated |= zero & down
            order[zero & up] = 1
            order[zero & flat & (bend > tolerance)] = 2
            order[zero & flat & (np.abs(bend) <= tolerance)] = _NEVER
        return violated, order

    def arm(self, order: Indices) -> None:
        """Prepare the guards for root finding: a zero at the start is divided out, once or twice.

        CVODE neither reports a root at its start nor sees one within the first tenth of its first step; the
        deflated guard ``g / tau^k`` is positive at the start and has all the later roots.
        """
        self._order = order
        self._once, self._twice = np.flatnonzero(order == 1), np.flatnonzero(order == 2)
        self._idle = np.flatnonzero(order == _NEVER)
        self.armed = order.size - self._idle.size
        self._plain = not (self._once.size or self._twice.size or self._idle.size)
        g0, g1, g2 = self.taylor
        if not self._plain:
            self._place_zeros()
        self.polynomial_guards = self.quadratic and not self.has_curved and not self._rising
        if self.polynomial_guards:
            c0, c1, c2 = g0.copy(), g1.copy(), g2.copy()
            for rows, shift in ((self._once, 1), (self._twice, 2), (self._idle, 3)):
                source = [g0, g1, g2, np.zeros_like(g0), np.zeros_like(g0), np.zeros_like(g0)]
                c0[rows], c1[rows], c2[rows] = (source[shift + i][rows] for i in range(3))
            c0[self._idle] = np.inf
            self.coefficients = (c0, c1, c2)

    def _place_zeros(self) -> None:
        """Find out until when a guard that leaves 0 is roundoff, and how far an idle one may stray from 0."""
        g0, g1, g2 = self.taylor
        size, noise = self.guard_scales()
        slipping = np.arange(size.size) < self.slips
        rough = _ROUNDOFF * size + np.where(slipping, 0.0, noise)
        self._settled = np.zeros_like(rough)
        once, twice = self._once, self._twice
        self._settled[once] = rough[once] / g1[once]
        self._settled[twice] = np.sqrt(rough[twice] / g2[twice])
        flat = np.where(slipping, rough + 1e2 * noise * self.horizon, AT_LIMIT * size + noise)
        self._play = np.abs(g0) + 3 * flat + np.finfo(float).tiny

    def guards(self, tau: float | Array, y: Array | None = None) -> Array:
        """Return the armed guards at local time `tau`; a quadratic motion needs no state."""
        if self.polynomial_guards and not isinstance(tau, np.ndarray):
            c0, c1, c2 = self.coefficients
            return c0 + tau * (c1 + tau * c2)
        return self.armed_guards(tau, self.watched(tau, self.state(tau) if y is None else y))

    def armed_guards(self, tau: float | Array, z: Array) -> Array:
        """Return the armed guards of what is watched."""
        g = self.raw_guards(tau, z)
        return g if self._plain else self._deflate(tau, g)

    def _deflate(self, tau: float | Array, g: Array) -> Array:
        def column(values: Array) -> Array:
            return values[:, None] if g.ndim == 2 else values

        g0, g1, g2 = self.taylor
        g[self._idle] += column(self._play[self._idle])
        for rows, lead, power in ((self._once, g1, 1), (self._twice, g2, 2)):
            if rows.size:
                rest = g[rows] - column(g0[rows])
                if power == 2:
                    rest -= tau * column(g1[rows])
                told = tau > column(self._settled[rows])
                g[rows] = np.where(told, rest / np.where(told, tau, 1.0) ** power, column(lead[rows]))
        return g

    def has_come_to_rest(self, tau: float, y: Array, row: int) -> bool:
        """Tell whether a slipping contact near rest would stay there: its relative acceleration is zero at ``w = 0``.

        A velocity that falls to 0 exponentially never crosses it; one that crosses has a relative acceleration
        of the order of its breakaway force (Breedveld 2000, section 6.2).
        """
        system, j = self.system, int(self.mode_set.slip[row])
        i, k = int(system.a[j]), int(system.b[j])
        inertia = np.append(system.inertia, np.full(system.drives + 1, np.inf))
        sign = self.mode_set.sign[row]
        push = sign * float(self.watched(tau, y)[row])
        if sign * self._relative_acceleration(tau, y, j) > 0:
            return False
        total = 1.0 / inertia[i] + 1.0 / inertia[k]
        equal = y.copy()
        for end, share in ((i, -push / inertia[i] / total), (k, push / inertia[k] / total)):
            if end < system.n:
                equal[end] += share
        scale = float(system.mu_s[:, j].max() * self.normals(tau)[j]) * total
        return abs(self._relative_acceleration(tau, equal, j)) <= _CONSTANT * scale

    def _relative_acceleration(self, tau: float, y: Array, j: int) -> float:
        slopes = self.inputs(tau)[self.system.first_acceleration : self.system.first_acceleration + self.system.drives]
        rates = np.zeros(self.system.loads.size)
        rates[self.system.first_drive : self.system.first_acceleration] = slopes
        return float((self.system.W @ self.rate(tau, y) + self.system.D @ rates)[j])

    # -- many times at once -------------------------------------------------------------------------------

    def exact_velocities(self, taus: Array, states: Array) -> None:
        """Set the velocities of stuck bodies exactly equal, and those of held ones to their holder's, in place."""
        mode_set, system = self.mode_set, self.system
        if mode_set.follow.size:
            states[:, mode_set.follow] = states[:, mode_set.lead]
        for body, holder in zip(mode_set.held.tolist(), mode_set.holder.tolist(), strict=True):
            if holder == system.n + system.drives:
                states[:, body] = 0.0
            else:
                velocity = system.velocities[holder - system.n]
                last = self.inputs(float(taus[-1]))[system.first_drive + holder - system.n]
                states[:-1, body] = [velocity(self.t + tau) for tau in taus[:-1]]
                states[-1, body] = last

    def knots(self, taus: Array, states: Array) -> tuple[Array, Array]:
        """Return first and second derivatives at computed points (rows), for interpolation."""
        columns = states.T
        rates = self.rate(taus, columns)
        return rates.T, self.second_rate(taus, columns, rates).T


def hermite(taus: Array, states: Array, rates: Array, seconds: Array, query: Array) -> Array:
    """Return the quintic Hermite interpolant through values, slopes and curvatures (order 5)."""
    i = np.clip(np.searchsorted(taus, query, side="right") - 1, 0, max(taus.size - 2, 0))
    if taus.size == 1:
        return np.repeat(states, query.size, axis=0)
    h = (taus[i + 1] - taus[i])[:, None]
    x = (query[:, None] - taus[i][:, None]) / h
    u = 1.0 - x
    return (
        u**3 * ((1 + x * (3 + 6 * x)) * states[i] + x * h * ((1 + 3 * x) * rates[i] + 0.5 * x * h * seconds[i]))
        + x**3
        * (
            (1 + u * (3 + 6 * u)) * states[i + 1]
            - u * h * ((1 + 3 * u) * rates[i + 1] - 0.5 * u * h * seconds[i + 1])
        )
    )

