"""One stretch of motion in fixed modes, with its guards made ready to find the event that ends it.

Time runs from 0 at the segment's start, so that events late in a long run are as sharp as early ones.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp, inf

import numpy as np
from numpy.typing import NDArray

from stickslip.guards import ROUNDOFF, Guarded

__all__ = ["AT_LIMIT", "Segment"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

AT_LIMIT = 1e-10
"""Relative distance within which a contact force is at its breakaway level."""

_CONSTANT = 1e-7
_DIFFERENCED = 4e-15
_NEVER = np.iinfo(np.intp).max
_FEW = 8


class Segment(Guarded):
    """The motion of one mode set from time `t` on: what is violated at its start, and where its guards have roots."""

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
            acceleration = noise / ROUNDOFF
            tolerance_of_bend = np.where(
                slipping, AT_LIMIT * acceleration, (AT_LIMIT * size + noise) / horizon
            )
            # a force as near to its limit as an event finds it leaves as much of an acceleration
            tolerance = np.where(slipping, closeness * acceleration, tolerance_of_bend)
            bend = g2 * horizon
            if self._differenced:
                d = self._difference_step
                rough = _DIFFERENCED * (acceleration + np.where(slipping, 0.0, size))
                tolerance_of_bend = tolerance_of_bend + rough * horizon / np.where(slipping, d, d * d)
                tolerance = tolerance + np.where(slipping, 0.0, rough / d)
            down, up = g1 < -tolerance, g1 > tolerance
            locked = self.mode_set.locked
            down[:k] &= ~locked
            up[:k] &= ~locked
            bend[:k][locked] = 0.0
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
        if self._plain:
            return np.empty(0, dtype=np.intp)
        rows = self._idle[self._idle < self.slips]
        return self.mode_set.slip[rows[~self.mode_set.locked[rows]]]

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
        rough = ROUNDOFF * size + np.where(slipping, 0.0, noise)
        self._settled = np.full_like(rough, 1e-14 * self.horizon)
        once, twice = self._once, self._twice
        self._settled[once] += rough[once] / g1[once]
        self._settled[twice] += np.sqrt(rough[twice] / g2[twice])
        flat = np.where(slipping, rough + 1e2 * noise * self.horizon, AT_LIMIT * size + noise)
        self._play = np.abs(g0) + 3 * flat + np.finfo(float).tiny
        self._play[: self.slips][self.mode_set.locked] = np.inf

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
        few = (self.exact_guards and self._plain) or self.polynomial_guards
        if not few or self.armed > _FEW:
            return lambda tau, y: float(self.guards(tau).min(initial=np.inf))
        source = self.coefficients if self.polynomial_guards else self._risen
        rows = [row for row in zip(*(c.tolist() for c in source), strict=True) if row[0] < np.inf]
        k = 0 if not self._rising else self.slips
        plain = rows[:k] if self._rising else rows
        lags = (
            zip(self._rise.tolist(), self._age.tolist(), self._rate.tolist(), strict=True)
            if self._rising
            else ()
        )
        held = (
            list(zip(rows[k:], lags, self._n0.tolist(), self._n1.tolist(), strict=False))
            if self._rising
            else []
        )

        def smallest(tau: float, y: Array) -> float:
            least = inf
            for a, b, c in plain:
                value = a + tau * (b + tau * c)
                if value < least:
                    least = value
            for (a, b, c), (rise, age, rate), n0, n1 in held:
                value = a + tau * (b + tau * c) - rise * exp(-(age + tau * rate)) * (n0 + tau * n1)
                if value < least:
                    least = value
            return least

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
        if self.mode_set.locked[row]:
            return False
        system, j = self.system, int(self.mode_set.slip[row])
        i, k = int(system.a[j]), int(system.b[j])
        inertia = np.append(system.inertia, np.full(system.drives + 1, np.inf))
        sign = self.mode_set.sign[row]
        push = sign * float(self.watched(tau, y)[row])
        if sign * self.relative_acceleration(tau, self.rate(tau, y))[j] > 0:
            return False
        total = 1.0 / inertia[i] + 1.0 / inertia[k]
        equal = y.copy()
        for end, share in ((i, -push / inertia[i] / total), (k, push / inertia[k] / total)):
            if end < system.n:
                equal[end] += share
        scale = float(system.mu_s[:, j].max() * self.normals(tau)[j]) * total
        return abs(float(self.relative_acceleration(tau, self.rate(tau, equal))[j])) <= _CONSTANT * scale
