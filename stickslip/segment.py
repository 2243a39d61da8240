"""One stretch of motion in fixed modes, with its guards made ready to find the event that ends it.

Time runs from 0 at the segment's start, so that events late in a long run are as sharp as early ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from itertools import repeat
from math import inf

import numpy as np
from numpy.typing import NDArray

from stickslip.guards import ROUNDOFF, Guarded
from stickslip.plain_guards import Term, not_positive, smallest_of

__all__ = ["AS_FIRED", "AT_LIMIT", "Segment"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

AT_LIMIT = 1e-10
"""Relative distance within which a contact force is at its breakaway level."""

AS_FIRED = 1e-6
"""The same for a contact that an event has just found there."""

_CONSTANT = 1e-7
_CANCELLED = 1e-12
"""A level this small beside the force, found as the sum of guard and force, is 0."""

_DIFFERENCED, _OF_TIME = 4e-15, 1e-15
_NEVER, _DOWN = np.iinfo(np.intp).max, -1
_TINY = np.finfo(float).tiny
_FEW = 8


class Segment(Guarded):
    """The motion of one mode set from time `t` on: what is violated at its start, and where its guards have roots."""

    def classify(
        self, fired: NDArray[np.bool_], as_fired: float = AS_FIRED
    ) -> tuple[NDArray[np.bool_], Indices]:
        """Tell which guards are violated at the start or just after it, and with which order the others leave 0.

        Parameters
        ----------
        fired : array (m,) of bool
            Contacts that an event has just found at their limit.
        as_fired : float
            How near their limit these count as there.

        Returns
        -------
        violated : array of bool
        order : array of int
            0 where the guard is positive, k where it starts as tau^k, a huge number where it stays 0, -1 where it
            is violated just after the start.
        """
        g0, k = self.taylor[0], self.slips
        violated, order = np.zeros(g0.size, dtype=bool), np.zeros(g0.size, dtype=np.intp)
        # a guard far from 0 on the scale of its level, or simply positive if it is a velocity, needs no closer look
        close = ~(g0 > self.near)
        if np.count_nonzero(self.at_rest):
            close[:k] |= self.at_rest[self.mode_set.slip]
        rows = close.nonzero()[0]
        if rows.size:
            self._look_closer(rows, fired, as_fired, violated, order)
        return violated, order

    def _look_closer(
        self,
        rows: Indices,
        fired: NDArray[np.bool_],
        as_fired: float,
        violated: NDArray[np.bool_],
        order: Indices,
    ) -> None:
        """Classify the guards in `rows`, one by one: they are few as a rule."""
        size, noise = self.guard_scales
        contacts = self.guard_contacts[rows]
        # a force that passes 0 is known no better than the time
        noise = noise.copy()
        noise[self.slips :] += _OF_TIME * abs(self.t) * np.abs(self.taylor[1][self.slips :])
        each = (rows, fired[contacts], self.at_rest[contacts], self.taylor[0][rows], size[rows], noise[rows])
        for row, at_limit, resting, value, scale, rough in zip(*(x.tolist() for x in each), strict=True):
            closeness = as_fired if at_limit else AT_LIMIT
            if resting if row < self.slips else abs(value) <= closeness * scale + rough:
                order[row] = self._way_out(row, closeness, scale, rough)
                violated[row] = order[row] == _DOWN
            else:
                violated[row] = value < 0

    def _way_out(self, row: int, closeness: float, scale: float, rough: float) -> int:
        """Return the order with which a guard leaves 0."""
        slipping = row < self.slips
        if slipping and self.mode_set.locked[row]:
            return _NEVER
        _, slopes, bends = self.taylor
        horizon = max(self.horizon, _TINY)
        slope, bend = float(slopes[row]), float(bends[row]) * horizon
        # a slipping contact's guard is a velocity, so its slope compares with accelerations
        acceleration = rough / ROUNDOFF
        flat = AT_LIMIT * acceleration if slipping else (AT_LIMIT * scale + rough) / horizon
        # a force as near to its limit as an event finds it leaves as much of an acceleration
        steep = closeness * acceleration if slipping else flat
        if self.curved:
            d = self._difference_step
            error = _DIFFERENCED * (acceleration + (0.0 if slipping else scale)) / d
            flat += error * horizon / (1.0 if slipping else d)
            steep += 0.0 if slipping else error
        if abs(slope) > steep:
            return 1 if slope > 0 else _DOWN
        if abs(bend) > flat:
            return 2 if bend > 0 else _DOWN
        return _NEVER

    def loads(self) -> Array:
        """Return ``lambda / B`` towards upper and lower levels, by what both become where both are 0.

        Each level counts on its own side. Infinite where a force meets no level.
        """
        k = self.slips
        noise = self.guard_scales[1][k:]
        # what is left of 0 in a derivative
        rough = noise / max(self.horizon, _TINY)
        if self.curved:
            rough += _DIFFERENCED * noise / ROUNDOFF / self._difference_step
        found, known = np.zeros(noise.size), np.zeros(noise.size, dtype=bool)
        for order, (watched, guards) in enumerate(zip(self.held_terms, self.taylor, strict=True)):
            force = np.concatenate([watched, -watched])
            level = self.levels(0.0) if order == 0 else guards[k:] + force
            least = (noise, rough, 0.0)[order]
            there = ~known & ((np.abs(force) > least) | (level > least))
            meets = level > np.maximum(_CANCELLED * np.abs(force), _TINY)
            ratio = np.divide(force, level, out=np.full_like(force, np.inf), where=meets)
            found[there] = np.where(meets | (force > 0), ratio, -np.inf)[there]
            known |= there
        return found

    def arm(self, order: Indices) -> None:
        """Prepare the guards for root finding: a zero at the start is divided out, once or twice.

        CVODE neither reports a root at its start nor sees one within the first tenth of its first step; the
        deflated guard ``g / tau^k`` is positive at the start and has all the later roots.
        """
        self._plain = not np.count_nonzero(order)
        self.armed = order.size
        if not self._plain:
            self._once, self._twice, self._idle = ((order == k).nonzero()[0] for k in (1, 2, _NEVER))
            self.armed -= self._idle.size
        self.exact_guards = self.quadratic and not self.has_curved
        self.polynomial_guards = self.exact_guards and not self._rising
        self.looked_over = self.polynomial_guards or (self.exact_guards and self._rises_concavely())
        if self.looked_over:
            self.coefficients = self._deflated(*self.risen)

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
        n0, n1 = self._pressing
        steep = (self._rise > 0) & (2 * n1 > n0 * self._rate)
        return not np.count_nonzero(steep) and not np.count_nonzero(self.expansion.z2[self.slips :])

    def _deflated(self, g0: Array, g1: Array, g2: Array) -> tuple[Array, Array, Array]:
        """Return the coefficients of polynomial guards with their zeros at the start divided out."""
        if self._plain:
            return g0, g1, g2
        c0, c1, c2 = g0.copy(), g1.copy(), g2.copy()
        c0[self._once], c1[self._once], c2[self._once] = g1[self._once], g2[self._once], 0.0
        c0[self._twice], c1[self._twice], c2[self._twice] = g2[self._twice], 0.0, 0.0
        c0[self._idle], c1[self._idle], c2[self._idle] = np.inf, 0.0, 0.0
        return c0, c1, c2

    @cached_property
    def _roundoff(self) -> tuple[Array, Array]:
        """Until when a guard that leaves 0 is roundoff, and how far an idle one may stray from 0."""
        g0, g1, g2 = self.taylor
        size, noise = self.guard_scales
        slipping = np.arange(size.size) < self.slips
        rough = ROUNDOFF * size + np.where(slipping, 0.0, noise)
        settled = np.full_like(rough, 1e-14 * self.horizon)
        once, twice = self._once, self._twice
        settled[once] += rough[once] / g1[once]
        settled[twice] += np.sqrt(rough[twice] / g2[twice])
        flat = np.where(slipping, rough + 1e2 * noise * self.horizon, AT_LIMIT * size + noise)
        play = np.abs(g0) + 3 * flat + _TINY
        play[: self.slips][self.mode_set.locked] = np.inf
        return settled, play

    def guards(self, tau: float | Array, y: Array | None = None) -> Array:
        """Return the armed guards at local time `tau`; a quadratic motion needs no state."""
        if not self.exact_guards or isinstance(tau, np.ndarray):
            return self.armed_guards(tau, self.watched(tau, self.state(tau) if y is None else y))
        if self.polynomial_guards:
            c0, c1, c2 = self.coefficients
            return c0 + tau * (c1 + tau * c2)
        g = self.raw_at(tau, self.y)
        return g if self._plain else self._deflate(tau, g)

    def smallest_guard(self, tau: float) -> Callable[[float], float] | None:
        """Return the function of local time whose root before `tau` ends the segment of a quadratic motion.

        Where no guard can come back from below zero it is made of those that are not positive at `tau`; None where
        there are none.
        """
        few = (self.exact_guards and self._plain) or self.polynomial_guards
        if not few or self.armed > _FEW:
            if self.looked_over and not np.count_nonzero(self.guards(tau) <= 0):
                return None
            return lambda tau: float(self.guards(tau).min(initial=inf))
        terms = self._plain_terms()
        if self.looked_over:
            terms = not_positive(terms, tau)
            if not terms:
                return None
        return smallest_of(terms)

    def _plain_terms(self) -> list[Term]:
        source = self.coefficients if self.polynomial_guards else self.risen
        rises: Iterable[Iterable[float]] = repeat(repeat(0.0), 5)
        if self._rising:
            lag = (self._rise, self._age, self._rate, *self._pressing)
            rises = ([*repeat(0.0, self.slips), *values.tolist()] for values in lag)
        return list(zip(*(c.tolist() for c in source), *rises, strict=False))

    def armed_guards(self, tau: float | Array, z: Array) -> Array:
        """Return the armed guards of what is watched."""
        g = self.raw_guards(tau, z)
        return g if self._plain else self._deflate(tau, g)

    def _deflate(self, tau: float | Array, g: Array) -> Array:
        def column(values: Array) -> Array:
            return values[:, None] if g.ndim == 2 else values

        g0, g1, g2 = self.taylor
        settled, play = self._roundoff
        g[self._idle] += column(play[self._idle])
        for rows, lead, power in ((self._once, g1, 1), (self._twice, g2, 2)):
            if rows.size:
                rest = g[rows] - column(g0[rows])
                if power == 2:
                    rest -= tau * column(g1[rows])
                told = tau > column(settled[rows])
                g[rows] = np.where(told, rest / np.where(told, tau, 1.0) ** power, column(lead[rows]))
        return g

    def stays_near_rest(self, margin: float, tau: float) -> bool:
        """Tell whether a slipping contact of a quadratic motion is within `margin` of rest now and at `tau`."""
        k, (c0, c1, c2) = self.slips, self.expansion[-3:]
        near = c0[:k] <= margin
        if not np.count_nonzero(near):
            return False
        return bool(np.any((c0 + tau * (c1 + tau * c2))[:k][near] <= margin))

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
