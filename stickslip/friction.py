"""Friction forces that depend on velocity, of many contacts at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.laws import DryFriction, Law
from stickslip.regularized import Dahl, Karnopp, LuGre, PreSlip

__all__ = ["BRISTLE", "HARD", "LINEAR", "SMOOTH", "Coefficients"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

HARD, LINEAR, SMOOTH, BRISTLE = 0, 1, 2, 3
"""Kinds of contact: exact sticking; piecewise linear pre-slip; smooth without modes; with a bristle state."""

MEMORY = 0.1
"""A slipping pre-slip contact is back in pre-slip below this part of its pre-slip velocity (eq. 4)."""


class Coefficients:
    """The coefficients of all contacts' laws as arrays; rows 0 and 1 are for forward and backward slip.

    Parameters
    ----------
    laws : sequence of Law
        One per contact.
    """

    def __init__(self, laws: Sequence[Law]) -> None:
        cores = [law if isinstance(law, DryFriction) else law.law for law in laws]  # type: ignore[attr-defined]
        sides = (1, -1)
        self.kind = np.array([_kind(law) for law in laws], dtype=np.intp)
        self.mu_s = np.array([[c.mu_s(s) for c in cores] for s in sides]).reshape(2, -1)
        self.mu_c = np.array([[c.mu_c(s) for c in cores] for s in sides]).reshape(2, -1)
        self.mu_0 = np.array([[c.mu_k(0.0, s) for c in cores] for s in sides]).reshape(2, -1)
        self.dwell = np.array([c.dwell for c in cores])
        self.curved = np.array([c.curved for c in cores], dtype=bool)
        self.velocity = np.array([law.velocity if isinstance(law, (PreSlip, Karnopp)) else 0.0 for law in laws])
        self.arctan = np.array([isinstance(law, PreSlip) and law.shape == "arctan" for law in laws], dtype=bool)
        stribeck = [c.stribeck_velocity for c in cores]
        self._fall = np.where([v is not None for v in stribeck], self.mu_s - self.mu_c, 0.0)
        self._v_s = np.array([1.0 if v is None else v for v in stribeck])
        self._delta = np.array([c.stribeck_exponent for c in cores])
        self._kinetic = {j: c for j, c in enumerate(cores) if c.kinetic is not None}
        self.sigma = np.array([_bristle(law) for law in laws]).reshape(-1, 3)
        self.threshold = np.where(self.kind == LINEAR, MEMORY * self.velocity, self.velocity)
        self.threshold[(self.kind != LINEAR) & (self.kind != HARD)] = 0.0

    def mu_k(self, contacts: Indices, side: Indices, speed: Array) -> Array:
        """Return kinetic coefficients at speeds (k,) or (k, times); `side` is 0 or 1, shaped like `speed`."""
        column = (slice(None), None) if speed.ndim == 2 else (slice(None),)
        j = contacts[column]
        ratio = speed / self._v_s[j]
        mu = self.mu_c[side, j] + self._fall[side, j] * np.exp(-(ratio ** self._delta[j]))
        for row, contact in enumerate(contacts.tolist()):
            if contact in self._kinetic:
                law = self._kinetic[contact]
                mu[row] = _each(lambda v, law=law: law.mu_k(v, 1), speed[row])
        return mu

    def mu_k_slope(self, contacts: Indices, side: Indices, speed: Array) -> Array:
        """Return the derivatives of the kinetic coefficients with respect to speed (k,)."""
        ratio = speed / self._v_s[contacts]
        delta = self._delta[contacts]
        moving = np.maximum(ratio, np.finfo(float).tiny)
        slope = -self._fall[side, contacts] * np.exp(-(moving**delta)) * delta * moving ** (delta - 1)
        slope /= self._v_s[contacts]
        for row, contact in enumerate(contacts.tolist()):
            if contact in self._kinetic:
                slope[row] = self._kinetic[contact].mu_k_slope(float(speed[row]), 1)
        return slope


class ActingForces:
    """Friction forces of the contacts that act through their velocity, in one set of modes.

    Parameters
    ----------
    coefficients : Coefficients
    contacts : array (k,)
        Which contacts: slipping with a curved kinetic law, in pre-slip, smooth, or with bristles.
    modes : array (m,)
        Modes of all contacts.
    """

    def __init__(self, coefficients: Coefficients, contacts: Indices, modes: NDArray[np.int8]) -> None:
        self._c, self.contacts = coefficients, contacts
        kind = coefficients.kind[contacts]
        mode = modes[contacts]
        self._sign = mode.astype(float)
        self._slip = np.flatnonzero((kind <= LINEAR) & (mode != 0))
        self._pre = np.flatnonzero((kind == LINEAR) & (mode == 0))
        self._smooth = np.flatnonzero(kind == SMOOTH)
        self.bristles = np.flatnonzero(kind == BRISTLE)

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the forces (k,) or (k, times).

        Parameters
        ----------
        w, normal : array like the result
            Relative velocities and normal forces.
        lag : array like the result
            Part of ``mu_s - mu_c`` that the dwell still withholds, ``exp(-(t - t_start)/tau)``.
        z : array (bristles,) or (bristles, times)
            Bristle deflections.
        """
        c, r = self._c, np.zeros_like(w)
        rows = self._slip
        if rows.size:
            sign = _like(self._sign[rows], w)
            side = np.broadcast_to((sign < 0).astype(np.intp), w[rows].shape)
            speed = np.maximum(sign * w[rows], 0.0)
            r[rows] = sign * c.mu_k(self.contacts[rows], side, speed) * normal[rows]
        rows = self._pre
        if rows.size:
            r[rows] = self._peak(rows, w, lag) * normal[rows] * w[rows] / _like(c.velocity[self.contacts[rows]], w)
        rows = self._smooth
        if rows.size:
            side = (w[rows] < 0).astype(np.intp)
            shape, _ = self._shape(rows, w[rows])
            r[rows] = c.mu_k(self.contacts[rows], side, np.abs(w[rows])) * normal[rows] * shape
        rows = self.bristles
        if rows.size:
            s0, s1, s2 = (_like(s, w) for s in c.sigma[self.contacts[rows]].T)
            r[rows] = s0 * z + s1 * self.bristle_rates(w, normal, z) + s2 * w[rows]
        return r

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the derivatives of the forces with respect to `w`, at fixed bristle deflections."""
        c, d = self._c, np.zeros_like(w)
        rows = self._slip
        if rows.size:
            sign = self._sign[rows]
            side, speed = (sign < 0).astype(np.intp), np.maximum(sign * w[rows], 0.0)
            d[rows] = c.mu_k_slope(self.contacts[rows], side, speed) * normal[rows]
        rows = self._pre
        if rows.size:
            d[rows] = self._peak(rows, w, lag) * normal[rows] / c.velocity[self.contacts[rows]]
        rows = self._smooth
        if rows.size:
            side, speed = (w[rows] < 0).astype(np.intp), np.abs(w[rows])
            shape, slope = self._shape(rows, w[rows])
            mu = c.mu_k(self.contacts[rows], side, speed)
            d[rows] = normal[rows] * (mu * slope + c.mu_k_slope(self.contacts[rows], side, speed) * np.abs(shape))
        rows = self.bristles
        if rows.size:
            _, s1, s2 = c.sigma[self.contacts[rows]].T
            d[rows] = s1 * self.bristle_slopes(w, normal, z)[0] + s2
        return d

    def bristle_rates(self, w: Array, normal: Array, z: Array) -> Array:
        """Return ``z' = w - sigma_0 |w| z / g(w)``."""
        w, speed, g, s0 = self._bristle_terms(w, normal)
        return w - s0 * speed * z / g

    def bristle_slopes(self, w: Array, normal: Array, z: Array) -> tuple[Array, Array]:
        """Return the derivatives of the bristles' rates with respect to `w` and `z`."""
        w, speed, g, s0 = self._bristle_terms(w, normal)
        rows = self.contacts[self.bristles]
        bend = self._c.mu_k_slope(rows, (w < 0).astype(np.intp), speed) * normal[self.bristles]
        sign = np.sign(w)
        return 1.0 - s0 * z * sign * (1.0 / g - speed * bend / g**2), -s0 * speed / g

    def _bristle_terms(self, w: Array, normal: Array) -> tuple[Array, Array, Array, Array]:
        rows, w = self.contacts[self.bristles], w[self.bristles]
        speed = np.abs(w)
        g = self._c.mu_k(rows, (w < 0).astype(np.intp), speed) * normal[self.bristles]
        return w, speed, np.maximum(g, np.finfo(float).tiny), _like(self._c.sigma[rows, 0], w)

    def _peak(self, rows: Indices, w: Array, lag: Array) -> Array:
        """Return the static coefficient after its dwell, ``mu_s - (mu_s - mu_c) lag``."""
        side = (w[rows] < 0).astype(np.intp)
        j = self.contacts[rows]
        j = j[:, None] if w.ndim == 2 else j
        return self._c.mu_s[side, j] - (self._c.mu_s - self._c.mu_c)[side, j] * lag[rows]

    def _shape(self, rows: Indices, w: Array) -> tuple[Array, Array]:
        """Return the smooth step and its derivative."""
        j = self.contacts[rows]
        v, arctan = _like(self._c.velocity[j], w), _like(self._c.arctan[j], w)
        x = w / v
        with np.errstate(over="ignore"):
            step = np.where(arctan, 2 / np.pi * np.arctan(0.5 * np.pi * x), np.tanh(x))
            slope = np.where(arctan, 1.0 / (1.0 + (0.5 * np.pi * x) ** 2), 1.0 - np.tanh(x) ** 2) / v
        return step, slope


def _like(values: Array, w: Array) -> Array:
    return values[:, None] if w.ndim == 2 else values


def _each(function: Any, values: Array) -> Array:
    return np.array([function(float(v)) for v in np.ravel(values)]).reshape(np.shape(values))


def _kind(law: Law) -> int:
    if isinstance(law, PreSlip):
        return LINEAR if law.shape == "linear" else SMOOTH
    return BRISTLE if isinstance(law, (LuGre, Dahl)) else HARD


def _bristle(law: Law) -> tuple[float, float, float]:
    if isinstance(law, LuGre):
        return law.stiffness, law.damping, law.viscous
    return (law.stiffness, 0.0, 0.0) if isinstance(law, Dahl) else (0.0, 0.0, 0.0)
