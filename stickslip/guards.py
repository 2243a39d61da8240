"""What is watched in fixed modes, and the guards made of it.

Guards are positive while the modes hold: relative velocity times mode of a slipping contact, ``B - lambda`` and
``B + lambda`` of a stuck one.
"""

from __future__ import annotations

from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.mode_set import ModeSet
from stickslip.motion import Motion, line

__all__ = ["ROUNDOFF", "Guarded"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

ROUNDOFF = 1e-12
"""Relative roundoff that forces and velocities are credited with."""

_DWELL_OVER = 40.0


class Guarded(Motion):
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
        self._contact, self._mu_s, self._rise, self._rate = mode_set.levels
        self._rising = False
        if mode_set.has_dwell:
            self._age = (t - since[self._contact]) * self._rate
            self._rising = bool(np.count_nonzero((self._rise > 0) & (self._age < _DWELL_OVER)))

    def with_modes(self, modes: NDArray[np.int8]) -> Self:
        """Return the motion from the same start in other modes."""
        mode_set = self.system.mode_set(modes.tobytes())
        stop = self.t + self.horizon
        return type(self)(self.system, mode_set, self.t, self.y, self.since, self.at_rest, stop)

    @cached_property
    def _pressing(self) -> tuple[Array, Array]:
        """Normal forces of the held contacts and their slopes, for upper and lower levels, 1 for those in pre-slip."""
        return self.q0[self.mode_set.pressed_by], self.q1[self.mode_set.pressed_by]

    @cached_property
    def _curved_normal(self) -> bool:
        return self.has_curved and bool(np.isin(self._contact, self.system.loads.curved).any())

    @cached_property
    def near(self) -> Array:
        """Values up to which a guard at the start deserves a closer look; 0 for velocities."""
        q = self.inputs(0.0) if self.has_curved else self.q0
        return self.mode_set.nearness * np.maximum(q[self.mode_set.guard_inputs], np.finfo(float).tiny)

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
            normal = np.maximum(self.inputs(tau)[self.mode_set.pressed_by], 0.0)
            return (mu_s - lag) * normal
        n0, n1 = self._pressing
        level = line(self._mu_s * n0, self._mu_s * n1, tau)
        if self._rising:
            level -= self._lag(tau) * line(n0, n1, tau)
        return level

    def watched(self, tau: float | Array, y: Array) -> Array:
        """Return what the guards watch: relative velocity times mode of the slipping contacts (less the velocity
        at which they are held again), the forces of the stuck ones, the relative velocities of those in pre-slip.
        """
        z = self.mode_set.E @ y
        _, _, h0, h1 = self._responses
        z += line(h0, h1, tau)
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

    @cached_property
    def taylor(self) -> tuple[Array, Array, Array]:
        """Return the guards at the start, their first derivatives and half their second ones."""
        if self.curved:
            return self._taylor_by_differences(self.watched(0.0, self.y))
        c0, c1, c2 = self.risen
        if not self._rising:
            return c0, c1, c2
        (n0, n1), rate = self._pressing, self._rate
        k, lag = self.slips, self._lag(0.0)
        g0, g1, g2 = c0.copy(), c1.copy(), c2.copy()
        g0[k:] -= lag * n0
        g1[k:] -= lag * (n1 - rate * n0)
        g2[k:] += lag * rate * (n1 - 0.5 * rate * n0)
        return g0, g1, g2

    @property
    def risen(self) -> tuple[Array, Array, Array]:
        """The same as if all static coefficients had risen to their final values."""
        c0, c1, c2 = self.expansion[-3:]
        if self.shifted:
            c0 = c0.copy()
            c0[: self.slips] -= self.threshold
        return c0, c1, c2

    @property
    def curved(self) -> bool:
        """Whether a load or a law bends the guards, so that their Taylor coefficients come from differences."""
        return self.curved_rates or self.has_curved

    def _taylor_by_differences(self, z0: Array) -> tuple[Array, Array, Array]:
        d, f1 = self._difference_step, self._second
        g0 = self.raw_guards(0.0, z0)
        g1, g2 = self._differences(g0, *map(self.raw_guards, (d, 2 * d), self._watched_ahead))
        # velocities: their rates are known
        k, slip = self.slips, self.mode_set.slip
        g1[:k] = self.mode_set.sign * self.relative_acceleration(0.0, self.f0)[slip]
        g2[:k] = self.mode_set.sign * self.relative_acceleration(d, self.f0 + d * f1)[slip]
        g2[:k] = (g2[:k] - g1[:k]) / (2 * d)
        return g0, g1, g2

    @cached_property
    def _second(self) -> Array:
        return self.second_rate(0.0, self.y, self.f0) if self.curved_rates else self.f1

    @cached_property
    def _watched_ahead(self) -> tuple[Array, Array]:
        """What is watched one and two difference steps after the start."""
        d = self._difference_step
        one, two = (
            self.watched(tau, self.y + tau * (self.f0 + 0.5 * tau * self._second)) for tau in (d, 2 * d)
        )
        return one, two

    def _differences(self, now: Array, one: Array, two: Array) -> tuple[Array, Array]:
        """Return the first derivative and half the second one, from values one and two steps ahead."""
        d = self._difference_step
        return (-3 * now + 4 * one - two) / (2 * d), (two - 2 * one + now) / (2 * d * d)

    @cached_property
    def held_terms(self) -> tuple[Array, Array, Array]:
        """What is watched of the held contacts at the start, its first derivative and half its second one.

        Levels that differ forward and backward, or rise, leave no way to tell it from the guards.
        """
        k = self.slips
        if not self.curved:
            e = self.expansion
            return e.z0[k:], e.z1[k:], e.z2[k:]
        now = self.watched(0.0, self.y)[k:]
        return now, *self._differences(now, *(ahead[k:] for ahead in self._watched_ahead))

    @property
    def guard_contacts(self) -> Indices:
        """The contact of each guard."""
        return self.mode_set.guard_contacts

    @cached_property
    def guard_scales(self) -> tuple[Array, Array]:
        """For each guard the size of what it compares, and the roundoff it carries."""
        k = self.slips
        q = self.inputs(0.0) if self.has_curved else self.q0
        found = self.mode_set.magnitudes(np.abs(np.concatenate([self.y, q])))
        speed, noise = found[:k], ROUNDOFF * found[k:]
        z = np.abs(self.watched(0.0, self.y) if self.curved else self.expansion.z0)[k:]
        if self.mode_set.pre.size:
            noise[k:][self.mode_set.is_pre] = ROUNDOFF * np.tile(z[self.mode_set.stuck.size :], 2)
        # a level that is 0 one way is as uncertain as the one the other way
        level = self.levels(0.0)
        level = np.maximum(level[: self.helds], level[self.helds :])
        return np.concatenate([speed, level + z, level + z]), noise

    def raw_at(self, tau: float, y: Array) -> Array:
        """Return the guards as they are at one time of an armed segment."""
        if self.curved or not self.quadratic:
            return self.raw_guards(tau, self.watched(tau, y))
        c0, c1, c2 = self.risen
        g = c0 + tau * (c1 + tau * c2)
        if self._rising:
            n0, n1 = self._pressing
            g[self.slips :] -= self._lag(tau) * (n0 + tau * n1)
        return g
