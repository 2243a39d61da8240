"""What is watched in fixed modes, and the guards made of it.

Guards are positive while the modes hold: relative velocity times mode of a slipping contact, ``B - lambda`` and
``B + lambda`` of a stuck one.
"""

from __future__ import annotations

from functools import cached_property

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
        self._scales: tuple[Array, Array] | None = None
        self._place_levels()

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
        self._near[self.slips :] = 1e-5 * (self.levels(0.0) if self._curved_normal else self._l0)

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

    @cached_property
    def taylor(self) -> tuple[Array, Array, Array]:
        """Return the guards at the start, their first derivatives and half their second ones."""
        if self._differenced:
            return self._taylor_by_differences(self.watched(0.0, self.y))
        c0, c1, c2 = self._risen
        if not self._rising:
            return c0, c1, c2
        k, lag = self.slips, self._lag(0.0)
        g0, g1, g2 = c0.copy(), c1.copy(), c2.copy()
        g0[k:] -= lag * self._n0
        g1[k:] -= lag * (self._n1 - self._rate * self._n0)
        g2[k:] += lag * self._rate * (self._n1 - 0.5 * self._rate * self._n0)
        return g0, g1, g2

    @cached_property
    def _risen(self) -> tuple[Array, Array, Array]:
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
        g1[:k] = self.mode_set.sign * self.relative_acceleration(0.0, self.f0)[slip]
        g2[:k] = self.mode_set.sign * self.relative_acceleration(d, self.f0 + d * f1)[slip]
        g2[:k] = (g2[:k] - g1[:k]) / (2 * d)
        return g0, g1, g2

    @property
    def guard_contacts(self) -> Indices:
        """The contact of each guard."""
        return self.mode_set.guard_contacts

    def guard_scales(self) -> tuple[Array, Array]:
        """Return for each guard the size of what it compares, and the roundoff it carries."""
        if self._scales is None:
            self._scales = self._find_scales()
        return self._scales

    def _find_scales(self) -> tuple[Array, Array]:
        k, s = self.slips, self.helds
        y, q = np.abs(self.y), np.abs(self.inputs(0.0))
        system = self.system
        body = abs(system.C) @ y + abs(system.Q) @ q
        body += abs(system.force_of_contacts) @ (system.mu_s.max(axis=0) * q[: system.m])
        z = np.abs(self.watched(0.0, self.y)[k:])
        level = self.levels(0.0)
        groups = self.mode_set.groups
        total = np.bincount(groups.leader, weights=body, minlength=system.n)[groups.leader]
        force_noise = self._at_ends(total, self.held)
        force_noise[self.mode_set.stuck.size :] = z[self.mode_set.stuck.size :]
        slip = self.mode_set.slip
        acceleration = self._at_ends(body / system.inertia, slip)
        if system.drives:
            acceleration += (abs(system.D) @ abs(self.drive_acceleration(0.0)))[slip]
        noise = np.concatenate([acceleration, force_noise, force_noise])
        speed = self._at_ends(y[: system.n], slip)
        size = np.concatenate([speed, level[:s] + z, level[s:] + z])
        return size, ROUNDOFF * noise

    def _at_ends(self, values: Array, contacts: Indices) -> Array:
        system = self.system
        wide = np.append(values, np.zeros(system.drives + 1))
        return wide[system.a[contacts]] + wide[system.b[contacts]]
