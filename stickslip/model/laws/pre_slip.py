"""Pre-slip: friction that builds up over a small velocity (Breedveld 2000, section 6.1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from stickslip.model.arrays import Array, like
from stickslip.model.laws.base import Character, Kernel
from stickslip.model.laws.dry_friction import DryFriction, Law, register
from stickslip.model.laws.kinetic import Kinetic

Shape = Literal["linear", "tanh", "arctan"]

_MEMORY = 0.1  # part of the pre-slip velocity below which a slipping contact is back in pre-slip (eq. 4)


class _Building(Kernel):
    """Piecewise linear: the force reaches the breakaway level at the pre-slip velocity (eq. 3)."""

    def __init__(self, laws: Sequence[PreSlip]) -> None:
        velocity = np.array([law.velocity for law in laws])
        sides = [[(law.core.mu_s(s), law.core.least(s)) for law in laws] for s in (1, -1)]
        top, least = np.moveaxis(np.array(sides), 2, 0) / velocity
        self._top, self._rise = top, top - least

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        return self.slopes(w, normal, lag, z) * w

    def in_floats(self, place: int) -> Callable[[float, float], float] | None:
        if self._rise[:, place].any():
            return None
        forward, backward = self._top[:, place].tolist()
        return lambda w, normal: (backward if w < 0 else forward) * max(normal, 0.0) * w

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        top, rise = (np.where(w < 0, like(x[1], w), like(x[0], w)) for x in (self._top, self._rise))
        return np.asarray((top - rise * lag) * normal)


class Smooth(Kernel):
    """The kinetic coefficient times a smooth step of ``x = w / velocity``."""

    def __init__(self, laws: Sequence[Any]) -> None:
        self._mu = Kinetic([law.core for law in laws])
        self._velocity = np.array([law.velocity for law in laws])

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return ``mu_k N step(w / velocity)``."""
        return self._mu(w) * normal * self.step(w / like(self._velocity, w))

    def in_floats(self, place: int) -> Callable[[float, float], float]:
        """Return the force of one contact as a function of relative velocity and normal force."""
        forward, backward = (self._mu.of_one(place, side) for side in (1, -1))
        velocity = float(self._velocity[place])

        def force(w: float, normal: float) -> float:
            mu = (backward if w < 0 else forward)(abs(w))
            return mu * max(normal, 0.0) * float(self.step(np.array(w / velocity)))

        return force

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        """Return the derivatives with respect to `w`."""
        velocity = like(self._velocity, w)
        x = w / velocity
        rise = self.step_slope(x) / velocity
        return np.asarray(normal * (self._mu(w) * rise + self._mu.slope(w) * np.abs(self.step(x))))

    def step(self, x: Array) -> Array:
        """Return a step from -1 to 1, odd in `x`."""
        raise NotImplementedError

    def step_slope(self, x: Array) -> Array:
        """Return its derivative."""
        raise NotImplementedError


class _Tanh(Smooth):
    def step(self, x: Array) -> Array:
        return np.tanh(x)

    def step_slope(self, x: Array) -> Array:
        return 1.0 - np.tanh(x) ** 2


class _Arctan(Smooth):
    def step(self, x: Array) -> Array:
        return 2 / np.pi * np.arctan(0.5 * np.pi * x)

    def step_slope(self, x: Array) -> Array:
        return 1.0 / (1.0 + (0.5 * np.pi * x) ** 2)


_SHAPES: dict[str, type[Kernel]] = {"linear": _Building, "tanh": _Tanh, "arctan": _Arctan}


@register
@dataclass(frozen=True)
class PreSlip(Law):
    """Friction that builds up over a small velocity, without exact sticking.

    "linear": ``r = mu_st N w / v_pre`` until ``|w| > v_pre``, then ``mu_k N sign(w)`` until
    ``|w| < 0.1 v_pre``: the slip state remembers that the peak exists only on breaking away, and mu_st rises
    with the dwell (Breedveld 2000, eqs. 3, 4, 8 and 9); an open contact counts as slipping. "tanh" and
    "arctan": ``r = mu_k(|w|) N tanh(w / v_pre)`` and ``r = mu_k(|w|) N (2 / pi) arctan(pi w / (2 v_pre))``,
    smooth, without slip state or dwell, and with no peak but that of a Stribeck curve.

    Parameters
    ----------
    law : DryFriction
        The coefficients.
    velocity : float
        Pre-slip velocity v_pre in m/s or rad/s, positive.
    shape : str
        "linear", "tanh" or "arctan".

    Raises
    ------
    ValueError, TypeError
        If the velocity is not positive or the shape unknown.
    """

    law: DryFriction
    velocity: float = 1e-3
    shape: Shape = "linear"

    def __post_init__(self) -> None:
        self._check_law()
        self._check_number("velocity", positive=True)
        if not isinstance(self.shape, str) or self.shape not in _SHAPES:
            raise ValueError(f"PreSlip: unknown shape {self.shape!r}; choose from {', '.join(map(repr, _SHAPES))}")

    @property
    def character(self) -> Character:
        """The linear shape has a slip state; smooth shapes have no modes."""
        is_linear = self.shape == "linear"
        return Character(
            has_slip_state=is_linear,
            slips_beyond=self.velocity,
            rests_below=_MEMORY * self.velocity if is_linear else 0.0,
            resolution=self.velocity,
            velocity_dependent="a pre-slip velocity",
        )

    @property
    def kernel(self) -> type[Kernel]:
        """The forces below the pre-slip velocity for the linear shape, at all velocities for smooth ones."""
        return _SHAPES[self.shape]
