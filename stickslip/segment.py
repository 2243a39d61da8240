"""One stretch of motion in fixed modes, with the guards that end it.

Time runs from 0 at the segment's start, so that events late in a long run are as sharp as early ones. Guards are
positive while the modes hold: relative velocity times mode of a slipping contact, ``B - lambda`` and
``B + lambda`` of a stuck one.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.mode_set import ModeSet
from stickslip.motion import Motion, line

__all__ = ["AT_LIMIT", "Segment"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

AT_LIMIT = 1e-10
"""Relative distance within which a contact force is at its breakaway level."""

_ROUNDOFF = 1e-12
_CONSTANT = 1e-7
_DWELL_OVER = 40.0
_DIFFERENCED = 4e-15
_NEVER = np.iinfo(np.intp).max
_FEW = 8


class Segment(Motion):
    """The motion of one mode set from time `t` on, and its guards.

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
    at_rest : array (m,) of bool
        Contacts whose relative velocity is 0 at the start.
    stop : float
        The next break in s; it sets the scale below which a rate is zero.
    """

    def __init__(
        self,
        system: System,
        mode_set: ModeSet,
        t: float,
        y: Array,
        since: Array,
        at_rest: NDArray[np.bool_],
        stop: float,
    ) -> None:
        super().__init__(system, mode_set, t, y, since, stop)
        self.at_rest = at_rest
        self.held = mode_set.held_contacts
        self.slips, self.helds = mode_set.slip.size, self.held.size
        self.shifted = mode_set.has_threshold
        if self.shifted:
            self.threshold = np.where(at_rest, 0.0, system.coefficients.threshold)[mode_set.slip]
        self._place_levels()
        self.taylor = self._expand()

    # -- guards -------------------------------------------------------------------------------------------

    def _place_levels(self) -> None:
        """Breakaway coefficients of the held contacts, upper levels first, then lower ones."""
        mode_set = self.mode_set
        levels = mode_set.levels
        self._contact, self._mu_s, self._rise, self._rate = levels
        both = self._contact
        self._rising = False
        if mode_set.has_dwell:
            self._age = (self.t - self.since[both]) * self._rate
            self._rising = bool(np.any((self._rise > 0) & (self._age < _DWELL_OVER)))
        self._n0, self._n1 = self.q0[both], self.q1[both]
        if mode_set.pre.size:
            # a contact in pre-slip is held by its pre-slip velocity, whatever presses it together
            self._n0[mode_set.is_pre], self._n1[mode_set.is_pre] = 1.0, 0.0
        self._curved_normal = self.has_curved and bool(np.isin(both, self.system.loads.curved).any())
        self._l0, self._l1 = self._mu_s * self._n0, self._mu_s * self._n1
        self._near = np.zeros(self.slips + both.size)
        self._near[self.slips :] = 1e-5 * self._l0

    @property
    def dwell_times(self) -> Array:
        """Dwell times of the stuck contacts whose static coefficients are still rising, each once."""
        if not self._rising:
            return np.empty(0)
        rising = (self._rise > 0) & (self._age < _DWELL_OVER)
        return np.unique(1.0 / self._rate[rising])

    def _lag(self, tau: float | Array) -> Array:
        """Return how far the static coefficients still are from their final values."""
        decay = np.exp(-line(self._age, self._rate, tau))
        return self._rise[:, None] * decay if decay.ndim == 2 else self._rise * decay

    def levels(self, tau: float | Array) -> Array:
        """Return the breakaway levels of the stuck contacts, upper then lower."""
        if self._curved_normal:
            lag = self._lag(tau) if self._rising else np.zeros((self._contact.size, *np.shape(tau)))
            mu_s = self._mu_s[:, None] if lag.ndim == 2 else self._mu_s
            normal = self.normals(tau)[self._contact]
            if self.mode_set.pre.size:
                normal[self.mode_set.is_pre] = 1.0
            return (mu_s - lag) * normal
        level = line(self._l0, self._l1, tau)
        if self._rising:
            level -= self._lag(tau) * line(self._n0, self._n1, tau)
        return level

    def watched(self, tau: float | Array, y: Array) -> Array:
        """Return what the guards watch: relative velocity times mode of the slipping contacts (less the velocity
        at which they are held again), the forces of the stuck ones, the relative velocities of those in pre-slip.
        """
        z = self.mode_set.E @ y
        z += line(self.h0, self.h1, tau)
        if self.shifted:
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

    def _expand(self) -> tuple[Array, Array, Array]:
        """Return the guards at the start, their first derivatives and half their second ones."""
        if self._differenced:
            return self._taylor_by_differences(self.watched(0.0, self.y))
        c0, c1, c2 = self._risen = self._expand_risen()
        if not self._rising:
            return c0, c1, c2
        k, lag = self.slips, self._lag(0.0)
        g0, g1, g2 = c0.copy(), c1.copy(), c2.copy()
        g0[k:] -= lag * self._n0
        g1[k:] -= lag * (self._n1 - self._rate * self._n0)
        g2[k:] += lag * self._rate * (self._n1 - 0.5 * self._rate * self._n0)
        return g0, g1, g2

    def _expand_risen(self) -> tuple[Array, Array, Array]:
        """Return the same as if all static coefficients had risen to their final values."""
        k = self.slips
        c0, c1, c2 = self.mode_set.spread(self.z)
        c0[k:] += self._l0
        c1[k:] += self._l1
        if self.shifted:
            c0[:k] -= self.threshold
        return c0, c1, c2

    @property
    def _differenced(self) -> bool:
        return self.curved_rates or self.has_curved

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
        # velocities: their rates are known
        k, slip = self.slips, self.mode_set.slip
        g1[:k] = self.mode_set.sign * self._relative_accelerations(0.0, self.f0)[slip]
        g2[:k] = self.mode_set.sign * self._relative_accelerations(d, self.f0 + d * f1)[slip]
        g2[:k] = (g2[:k] - g1[:k]) / (2 * d)
        return g0, g1, g2

    @property
    def guard_contacts(self) -> Indices:
        """The contact of each guard."""
        return self.mode_set.guard_contacts

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
        slip = self.mode_set.slip
        acceleration = self._at_ends(body / system.inertia, slip)
        if system.drives:
            acceleration += (abs(system.D) @ abs(self._drive_accelerations(0.0)))[slip]
        noise = np.concatenate([acceleration, force_noise, force_noise])
        speed = self._at_ends(y[: system.n], slip)
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
        # a guard far from 0 on the scale of its level, or simply positive if it is a velocity, needs no closer look
        if not resting.any() and (g0 > self._near).all():
            return np.zeros(k + 2 * s, dtype=bool), order
        size, noise = self.guard_scales()
        closeness = np.where(fired[self.guard_contacts], 1e-6, AT_LIMIT)
        zero = np.abs(g0) <= closeness * size + noise
        zero[:k] = resting
        violated = ~zero & (g0 < 0)
        if zero.any():
            # a slipping contact's guard is a velocity, so its slope compares with accelerations
            horizon = max(self.horizon, np.finfo(float).tiny)
            slipping = np.arange(g0.size) < k
            tolerance = np.where(slipping, noise * 1e2, (AT_LIMIT * size + noise) / horizon)
            bend, tolerance_of_bend = g2 * horizon, tolerance
            if self._differenced:
                d = self._difference_step
                rough = _DIFFERENCED * (noise / _ROUNDOFF + np.where(slipping, 0.0, size))
                tolerance_of_bend = tolerance + rough * horizon / np.where(slipping, d, d * d)
                tolerance = tolerance + np.where(slipping, 0.0, rough / d)
            down, up = g1 < -tolerance, g1 > tolerance
            flat = ~down & ~up
            down |= flat & (bend < -tolerance_of_bend)
            violated |= zero & down
            order[zero & up] = 1
            order[zero & flat & (bend > tolerance_of_bend)] = 2
            order[zero & flat & (np.abs(bend) <= tolerance_of_bend)] = _NEVER
        return violated, order

    def arm(self, order: Indices) -> None:
        """Prepare the guards for root finding: a zero at the start is divided out, once or twice.

        CVODE neither reports a root at its start nor sees one within the first tenth of its first step; the
        deflated guard ``g / tau^k`` is positive at the start and has all the later roots.
        """
        self._order = order
        self._plain = not order.any()
        self.armed = order.size
        g0, g1, g2 = self.taylor
        if not self._plain:
            self._once, self._twice = np.flatnonzero(order == 1), np.flatnonzero(order == 2)
            self._idle = np.flatnonzero(order == _NEVER)
            self.armed -= self._idle.size
            self._place_zeros()
        self.exact_guards = self.quadratic and not self.has_curved
        self.polynomial_guards = self.exact_guards and not self._rising
        self.looked_over = self.polynomial_guards or (self.exact_guards and self._rises_concavely())
        if self.looked_over:
            self.coefficients = self._deflated(*self._risen)

    @property
    def idle_slips(self) -> Indices:
        """Contacts at rest whose mode is slip but whose relative velocity stays 0, to second order."""
        rows = np.empty(0, dtype=np.intp) if self._plain else self._idle
        return self.mode_set.slip[rows[rows < self.slips]]

    def _rises_concavely(self) -> bool:
        """Tell whether no guard with a rising static coefficient can dip and come back.

        ``N(t) exp(-t/tau)`` is convex while ``N >= 2 N' tau``, so that such a guard is smallest at one of its ends.
        """
        rising = self._rise > 0
        steep = self._n1[rising] * 2 > self._n0[rising] * self._rate[rising]
        return not steep.any() and not self.z[2][self.slips :].any()

    def _deflated(self, g0: Array, g1: Array, g2: Array) -> tuple[Array, Array, Array]:
        """Return the coefficients of polynomial guards with their zeros at the start divided out."""
        if self._plain:
            return g0, g1, g2
        c0, c1, c2 = g0.copy(), g1.copy(), g2.copy()
        c0[self._once], c1[self._once], c2[self._once] = g1[self._once], g2[self._once], 0.0
        c0[self._twice], c1[self._twice], c2[self._twice] = g2[self._twice], 0.0, 0.0
        c0[self._idle], c1[self._idle], c2[self._idle] = np.inf, 0.0, 0.0
        return c0, c1, c2

    def _place_zeros(self) -> None:
        """Find out until when a guard that leaves 0 is roundoff, and how far an idle one may stray from 0."""
        g0, g1, g2 = self.taylor
        size, noise = self.guard_scales()
        slipping = np.arange(size.size) < self.slips
        rough = _ROUNDOFF * size + np.where(slipping, 0.0, noise)
        self._settled = np.full_like(rough, 1e-14 * self.horizon)
        once, twice = self._once, self._twice
        self._settled[once] += rough[once] / g1[once]
        self._settled[twice] += np.sqrt(rough[twice] / g2[twice])
        flat = np.where(slipping, rough + 1e2 * noise * self.horizon, AT_LIMIT * size + noise)
        self._play = np.abs(g0) + 3 * flat + np.finfo(float).tiny

    def guards(self, tau: float | Array, y: Array | None = None) -> Array:
        """Return the armed guards at local time `tau`; a quadratic motion needs no state."""
        if not self.exact_guards or isinstance(tau, np.ndarray):
            return self.armed_guards(tau, self.watched(tau, self.state(tau) if y is None else y))
        if self.polynomial_guards:
            c0, c1, c2 = self.coefficients
            return c0 + tau * (c1 + tau * c2)
        c0, c1, c2 = self._risen
        g = c0 + tau * (c1 + tau * c2)
        g[self.slips :] -= self._lag(tau) * (self._n0 + tau * self._n1)
        return g if self._plain else self._deflate(tau, g)

    def smallest_guard(self) -> Callable[[float, Array], float]:
        """Return the function of local time and state whose root ends the segment: plain arithmetic for few guards."""
        few = self.exact_guards and self._plain or self.polynomial_guards
        if not few or self.armed > _FEW:
            return lambda tau, y: float(self.guards(tau).min(initial=np.inf))
        source = self.coefficients if self.polynomial_guards else self._risen
        rows = [row for row in zip(*(c.tolist() for c in source), strict=True) if row[0] < np.inf]
        if self.polynomial_guards:
            return lambda tau, y: min([a + tau * (b + tau * c) for a, b, c in rows], default=np.inf)
        k = self.slips
        lags = zip(self._rise.tolist(), self._age.tolist(), self._rate.tolist(), strict=True)
        held = list(zip(rows[k:], lags, self._n0.tolist(), self._n1.tolist(), strict=True))

        def smallest(tau: float, y: Array) -> float:
            values = [a + tau * (b + tau * c) for a, b, c in rows[:k]]
            for (a, b, c), (rise, age, rate), n0, n1 in held:
                values.append(a + tau * (b + tau * c) - rise * exp(-(age + tau * rate)) * (n0 + tau * n1))
            return min(values)

        return smallest

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

    def comes_near_rest(self, margin: float, tau: float) -> bool:
        """Tell whether a slipping contact of a quadratic motion is within `margin` of rest now or at `tau`."""
        k = self.slips
        z0, z1, z2 = (z[:k] for z in self.z)
        return bool(np.any(z0 <= margin) or np.any(z0 + tau * (z1 + tau * z2) <= margin))

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
        if sign * self._relative_accelerations(tau, self.rate(tau, y))[j] > 0:
            return False
        total = 1.0 / inertia[i] + 1.0 / inertia[k]
        equal = y.copy()
        for end, share in ((i, -push / inertia[i] / total), (k, push / inertia[k] / total)):
            if end < system.n:
                equal[end] += share
        scale = float(system.mu_s[:, j].max() * self.normals(tau)[j]) * total
        return abs(float(self._relative_accelerations(tau, self.rate(tau, equal))[j])) <= _CONSTANT * scale

    def _relative_accelerations(self, tau: float, rates: Array) -> Array:
        """Return ``w'`` of every contact."""
        return self.system.W @ rates + self.system.D @ self._drive_accelerations(tau)

    def _drive_accelerations(self, tau: float) -> Array:
        """Return the accelerations of the drives, as inputs in the places of their velocities."""
        first, last = self.system.first_drive, self.system.first_acceleration
        rates = np.zeros(self.system.inputs)
        rates[first:last] = self.inputs(tau)[last : 2 * last - first]
        return rates
