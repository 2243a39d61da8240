"""Friction forces that depend on velocity, of many contacts at once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.model.laws.dry_friction import DryFriction, Law
from stickslip.model.laws.regularized import Dahl, Karnopp, LuGre, PreSlip

__all__ = ["BRISTLE", "HARD", "LINEAR", "SMOOTH", "ActingForces", "Coefficients"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

HARD, LINEAR, SMOOTH, BRISTLE = 0, 1, 2, 3
"""Kinds of contact: exact sticking; piecewise linear pre-slip; smooth without modes; with a bristle state."""

MEMORY = 0.1
"""A slipping pre-slip contact is back in pre-slip below this part of its pre-slip velocity (eq. 4)."""

_UNDERFLOW, _TINY = 745.0, 1e-300
_STEEPEST = 1e-3
"""Part of the Stribeck velocity below which curves of infinite slope at rest count as no steeper."""
_FASTEST = 1e12
"""Bristles relax at most at this rate in 1/s, also where the normal force vanishes."""


class Coefficients:
    """The coefficients of all contacts' laws as arrays; rows 0 and 1 are for forward and backward slip.

    Parameters
    ----------
    laws : sequence of Law
        One per contact.
    """

    def __init__(self, laws: Sequence[Law]) -> None:
        """Collect the coefficients."""
        cores = [law if isinstance(law, DryFriction) else law.law for law in laws]  # type: ignore[attr-defined]
        sides = (1, -1)
        self.kind = np.array([_kind(law) for law in laws], dtype=np.intp)
        self.mu_s = np.array([[c.mu_s(s) for c in cores] for s in sides]).reshape(2, -1)
        self.mu_c = np.array([[c.mu_c(s) for c in cores] for s in sides]).reshape(2, -1)
        self.mu_0 = np.array([[c.mu_k(0.0, s) for c in cores] for s in sides]).reshape(2, -1)
        self.dwell = np.array([c.dwell for c in cores])
        self.curved = np.array([c.curved for c in cores], dtype=bool)
        banded = [law.velocity if isinstance(law, (PreSlip, Karnopp)) else 0.0 for law in laws]
        self.velocity = np.array(banded)
        arctan = [isinstance(law, PreSlip) and law.shape == "arctan" for law in laws]
        self.arctan = np.array(arctan, dtype=bool)
        stribeck = [c.stribeck_velocity for c in cores]
        self.fall = np.where([v is not None for v in stribeck], self.mu_s - self.mu_c, 0.0)
        self.stribeck = np.array([1.0 if v is None else v for v in stribeck])
        self.exponent = np.array([c.stribeck_exponent for c in cores])
        self.kinetic = {j: c for j, c in enumerate(cores) if c.kinetic is not None}
        self.sigma = np.array([_bristle(law) for law in laws]).reshape(-1, 3)
        self.threshold = np.where(self.kind == LINEAR, MEMORY * self.velocity, self.velocity)
        self.threshold[(self.kind != LINEAR) & (self.kind != HARD)] = 0.0


class _Kinetic:
    """Kinetic coefficients of some contacts as functions of their relative velocities."""

    def __init__(self, c: Coefficients, contacts: Indices, side: Indices | None = None) -> None:
        """Take the coefficients of the side to which `w` points, or of the given ones."""
        sides = [np.full(contacts.size, k) if side is None else side for k in (0, 1)]
        self._level = np.array([c.mu_c[k, contacts] for k in sides])
        self._fall = np.array([c.fall[k, contacts] for k in sides])
        self._velocity, self._exponent = c.stribeck[contacts], c.exponent[contacts]
        # beyond this ratio of speed to Stribeck velocity the exponential is 0, and its argument may overflow
        self._gone = _UNDERFLOW ** (1.0 / self._exponent)
        self._steepest = np.where(self._exponent < 1, _STEEPEST, 0.0)
        self._isotropic = all(np.array_equal(x[0], x[1]) for x in (self._level, self._fall))
        self._bent = bool(self._fall.any())
        self._own = [(row, c.kinetic[j]) for row, j in enumerate(contacts.tolist()) if j in c.kinetic]

    def __call__(self, w: Array) -> Array:
        """Return the coefficients at `w` (k,) or (k, times)."""
        mu = self._of_side(self._level, w)
        if self._bent:
            ratio = np.minimum(np.abs(w) / _like(self._velocity, w), _like(self._gone, w))
            mu = mu + self._of_side(self._fall, w) * np.exp(-(ratio ** _like(self._exponent, w)))
        if self._own:
            mu = np.array(np.broadcast_to(mu, w.shape))
        for row, law in self._own:
            values = [law.mu_k(v, 1) for v in np.ravel(np.abs(w[row])).tolist()]
            mu[row] = np.reshape(values, w[row].shape)
        return mu

    def slope(self, w: Array) -> Array:
        """Return the derivatives with respect to speed at `w` (k,), as they help a solver.

        Where the exponent is below 1 they grow beyond limits towards rest. Newton's method with these is thrown across
        the rest that a contact has just left, which ends in a storm of events: there they are cut off.
        """
        slope = np.zeros_like(w)
        if self._bent:
            ratio = np.clip(np.abs(w) / self._velocity, self._steepest, self._gone)
            moving = w != 0
            ratio[~moving] = 1.0
            power = ratio**self._exponent
            slope = -self._of_side(self._fall, w) * np.exp(-power) * self._exponent * power / ratio
            slope *= moving / self._velocity
        for row, law in self._own:
            slope[row] = law.mu_k_slope(float(abs(w[row])), 1)
        return slope

    def _of_side(self, values: Array, w: Array) -> Array:
        forward = _like(values[0], w)
        return forward if self._isotropic else np.where(w < 0, _like(values[1], w), forward)


class ActingForces:
    """Friction forces of the contacts that act through their velocity, in one set of modes.

    Parameters
    ----------
    coefficients : Coefficients
    contacts : array (k,)
        Which contacts: slipping with a curved kinetic law, in pre-slip, smooth, or with bristles.
    modes : array (m,)
        Modes of all contacts.
    at_level : array (m,) of bool, optional
        Which contacts carry their breakaway level while others hold them at rest.

    Attributes
    ----------
    bristles : array
        Which of `contacts` have bristles.
    """

    def __init__(
        self,
        coefficients: Coefficients,
        contacts: Indices,
        modes: NDArray[np.int8],
        at_level: NDArray[np.bool_] | None = None,
    ) -> None:
        """Sort the contacts by how they act."""
        kind, mode = coefficients.kind[contacts], modes[contacts]
        at_level = np.zeros(contacts.size, dtype=bool) if at_level is None else at_level[contacts]
        self.bristles = np.flatnonzero(kind == BRISTLE)
        self._own = coefficients, contacts
        self._parts: list[tuple[Indices | slice, _Part]] = []
        for chosen, part in (
            (at_level, lambda j: _AtLevel(coefficients, j, modes[j].astype(float))),
            (
                (kind <= LINEAR) & (mode != 0) & ~at_level,
                lambda j: _Slipping(coefficients, j, modes[j].astype(float)),
            ),
            ((kind == LINEAR) & (mode == 0), lambda j: _Building(coefficients, j)),
            (kind == SMOOTH, lambda j: _Smooth(coefficients, j)),
            (kind == BRISTLE, lambda j: self._brush),
        ):
            if chosen.any():
                rows = slice(None) if chosen.all() else np.flatnonzero(chosen)
                self._parts.append((rows, part(contacts[chosen])))

    @cached_property
    def _brush(self) -> _Bristles:
        coefficients, contacts = self._own
        return _Bristles(coefficients, contacts[self.bristles])

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
        r = np.empty_like(w)
        for rows, part in self._parts:
            r[rows] = part.forces(w[rows], normal[rows], lag[rows], z)
        return r

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the derivatives (k,) of the forces with respect to `w`, at fixed bristle deflections."""
        d = np.empty_like(w)
        for rows, part in self._parts:
            d[rows] = part.slopes(w[rows], normal[rows], lag[rows], z)
        return d

    def bristle_rates(self, w: Array, normal: Array, z: Array) -> Array:
        """Return ``z' = w - sigma_0 |w| z / g(w)``."""
        return self._brush.rates(w[self.bristles], normal[self.bristles], z)

    def bristle_slopes(self, w: Array, normal: Array, z: Array) -> tuple[Array, Array]:
        """Return the derivatives of the bristles' rates with respect to `w` and `z`."""
        return self._brush.rate_slopes(w[self.bristles], normal[self.bristles], z)


class _Slipping:
    """Slipping in a known direction, with a kinetic coefficient that depends on speed.

    The step in which a contact comes to rest ends beyond it. There the curve is turned round its value at rest, so that
    it has no kink within the step; a curve that is vertical at rest stays level.
    """

    def __init__(self, coefficients: Coefficients, contacts: Indices, sign: Array) -> None:
        self._sign, self._mu = sign, _Kinetic(coefficients, contacts, (sign < 0).astype(np.intp))
        self._turned = coefficients.exponent[contacts] >= 1

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        sign = _like(self._sign, w)
        speed = sign * w
        beyond = (speed < 0) & _like(self._turned, w)
        if not np.count_nonzero(beyond):
            return sign * self._mu(np.maximum(speed, 0.0)) * normal
        mu = self._mu(np.where(beyond, -speed, np.maximum(speed, 0.0)))
        return sign * np.where(beyond, 2 * self._mu(np.zeros_like(w)) - mu, mu) * normal

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        speed = self._sign * w
        return self._mu.slope(np.where(self._turned, np.abs(speed), np.maximum(speed, 0.0))) * normal


class _AtLevel:
    """Held at rest by others at the breakaway level, which rises with the time at rest (eqs. 8 and 9)."""

    def __init__(self, coefficients: Coefficients, contacts: Indices, sign: Array) -> None:
        c, side = coefficients, (sign < 0).astype(np.intp)
        self._level = sign * c.mu_s[side, contacts]
        self._rise = self._level - sign * np.maximum(c.mu_c, c.mu_0)[side, contacts]

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        return (_like(self._level, w) - _like(self._rise, w) * lag) * normal

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        return np.zeros_like(w)


class _Building:
    """Piecewise linear pre-slip: the force reaches the breakaway level at the pre-slip velocity (eq. 3)."""

    def __init__(self, coefficients: Coefficients, contacts: Indices) -> None:
        c = coefficients
        velocity = c.velocity[contacts]
        self._top = c.mu_s[:, contacts] / velocity
        self._rise = self._top - np.maximum(c.mu_c, c.mu_0)[:, contacts] / velocity
        self._isotropic = bool(
            np.all(self._top[0] == self._top[1]) and np.all(self._rise[0] == self._rise[1])
        )

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        return self.slopes(w, normal, lag, z) * w

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        top, rise = _like(self._top[0], w), _like(self._rise[0], w)
        if not self._isotropic:
            top, rise = (np.where(w < 0, _like(x[1], w), _like(x[0], w)) for x in (self._top, self._rise))
        return (top - rise * lag) * normal


class _Smooth:
    """The smooth steps tanh and arctan, times the kinetic coefficient."""

    def __init__(self, coefficients: Coefficients, contacts: Indices) -> None:
        self._mu = _Kinetic(coefficients, contacts)
        self._velocity, self._arctan = coefficients.velocity[contacts], coefficients.arctan[contacts]

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        return self._mu(w) * normal * self._step(w / _like(self._velocity, w))

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        x = w / self._velocity
        step = self._step(x)
        rise = np.where(self._arctan, 1.0 / (1.0 + (0.5 * np.pi * x) ** 2), 1.0 - step**2) / self._velocity
        return normal * (self._mu(w) * rise + self._mu.slope(w) * np.abs(step))

    def _step(self, x: Array) -> Array:
        return np.where(_like(self._arctan, x), 2 / np.pi * np.arctan(0.5 * np.pi * x), np.tanh(x))


class _Bristles:
    """Bristles that bend until they slip: LuGre, and Dahl without its damping and viscous terms."""

    def __init__(self, coefficients: Coefficients, contacts: Indices) -> None:
        self._mu = _Kinetic(coefficients, contacts)
        self._stiffness, self._damping, self._viscous = coefficients.sigma[contacts].T

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        s0, s1, s2 = (_like(s, w) for s in (self._stiffness, self._damping, self._viscous))
        return s0 * z + s1 * self.rates(w, normal, z) + s2 * w

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        return self._damping * self.rate_slopes(w, normal, z)[0] + self._viscous

    def rates(self, w: Array, normal: Array, z: Array) -> Array:
        return w - self._relaxation(w, normal) * z

    def rate_slopes(self, w: Array, normal: Array, z: Array) -> tuple[Array, Array]:
        speed, g = np.abs(w), self._mu(w) * normal
        free = g * _FASTEST > self._stiffness * speed
        g = np.where(free, g, 1.0)
        by_speed = np.where(free, self._stiffness * (1.0 - speed * self._mu.slope(w) * normal / g) / g, 0.0)
        return 1.0 - z * np.sign(w) * by_speed, -self._relaxation(w, normal)

    def _relaxation(self, w: Array, normal: Array) -> Array:
        """Return ``sigma_0 |w| / g``, the rate at which deflections relax."""
        push = _like(self._stiffness, w) * np.abs(w)
        return push / np.maximum(self._mu(w) * normal, push / _FASTEST + _TINY)


_Part = _Slipping | _AtLevel | _Building | _Smooth | _Bristles


def _like(values: NDArray[Any], w: Array) -> NDArray[Any]:
    return values[:, None] if w.ndim == 2 else values


def _kind(law: Law) -> int:
    if isinstance(law, PreSlip):
        return LINEAR if law.shape == "linear" else SMOOTH
    return BRISTLE if isinstance(law, (LuGre, Dahl)) else HARD


def _bristle(law: Law) -> tuple[float, float, float]:
    if isinstance(law, LuGre):
        return law.stiffness, law.damping, law.viscous
    return (law.stiffness, 0.0, 0.0) if isinstance(law, Dahl) else (0.0, 0.0, 0.0)
