"""Bristles that bend until they slip: the LuGre model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stickslip.model.arrays import Array, like
from stickslip.model.laws.base import Character, Kernel, Use
from stickslip.model.laws.dry_friction import DryFriction, Law, register
from stickslip.model.laws.kinetic import Kinetic

_TINY = 1e-300

# Part of its largest value below which a normal force is nearly 0, and the number of times at which that is sought.
NEARLY_OPEN, _SAMPLES = 1e-4, 101

MAX_RATE = 1e12  # bristles relax at most at this rate in 1/s, also where the normal force vanishes


class _Bristles(Kernel):
    """``r = sigma_0 z + sigma_1 z' + sigma_2 w`` with ``z' = w - sigma_0 |w| z / g(w)``."""

    has_state = True

    def __init__(self, laws: Sequence[BristleLaw]) -> None:
        self._mu = Kinetic([law.core for law in laws])
        self._stiffness, self._damping, self._viscous = np.array([law.sigma for law in laws]).T

    def forces(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        s0, s1, s2 = (like(s, w) for s in (self._stiffness, self._damping, self._viscous))
        return np.asarray(s0 * z + s1 * self.rates(w, normal, z) + s2 * w)

    def in_floats(self, place: int) -> Callable[[float, float, float], tuple[float, float]]:
        forward, backward = (self._mu.of_one(place, side) for side in (1, -1))
        stiffness, damping, viscous = (float(s[place]) for s in (self._stiffness, self._damping, self._viscous))

        def force_and_rate(w: float, normal: float, z: float) -> tuple[float, float]:
            push = stiffness * abs(w)
            level = (backward if w < 0 else forward)(abs(w)) * max(normal, 0.0)
            least = push / MAX_RATE + _TINY
            # a velocity that is NaN gives a rate that is NaN
            rate = w - push / (level if level > least else least) * z
            return stiffness * z + damping * rate + viscous * w, rate

        return force_and_rate

    def slopes(self, w: Array, normal: Array, lag: Array, z: Array) -> Array:
        return np.asarray(like(self._damping, w) * self.rate_slopes(w, normal, z)[0] + like(self._viscous, w))

    def rates(self, w: Array, normal: Array, z: Array) -> Array:
        return w - self.relaxation(w, normal) * z

    def rate_slopes(self, w: Array, normal: Array, z: Array) -> tuple[Array, Array]:
        speed, g, stiffness = np.abs(w), self._mu(w) * normal, like(self._stiffness, w)
        uncapped = g * MAX_RATE > stiffness * speed
        g = np.where(uncapped, g, 1.0)
        by_speed = np.where(uncapped, stiffness * (1.0 - speed * self._mu.slope(w) * normal / g) / g, 0.0)
        return 1.0 - z * np.sign(w) * by_speed, -self.relaxation(w, normal)

    def by_normal(self, w: Array, normal: Array, lag: Array, z: Array) -> tuple[Array, Array]:
        uncapped = self._mu(w) * normal * MAX_RATE > self._stiffness * np.abs(w)
        rate = np.where(uncapped, self.relaxation(w, normal) * z / np.where(uncapped, normal, 1.0), 0.0)
        return np.asarray(self._damping * rate), rate

    def by_state(self, w: Array, normal: Array, z: Array) -> Array:
        return np.asarray(like(self._stiffness, w) - like(self._damping, w) * self.relaxation(w, normal))

    def relaxation(self, w: Array, normal: Array) -> Array:
        """Return ``sigma_0 |w| / g``, the rate at which deflections relax."""
        push = like(self._stiffness, w) * np.abs(w)
        return np.asarray(push / np.maximum(self._mu(w) * normal, push / MAX_RATE + _TINY))


class BristleLaw(Law):
    """A law whose force is that of a bristle with a state of its own, its deflection."""

    stiffness: float

    def __post_init__(self) -> None:
        """Check coefficients and stiffness."""
        self._check_law()
        self._check_number("stiffness", positive=True)
        core, name = self.core, type(self).__name__
        least = min(core.mu_c(1), core.mu_c(-1))
        works = max(core.mu_s(1), core.mu_s(-1), self.sigma[2]) > 0
        if least == 0 and works and core.kinetic is None:
            raise ValueError(
                f"{name}: mu_coulomb must be positive, got 0: bristles without sliding friction are infinitely stiff; "
                "use DryFriction, and a Damper for what is viscous"
            )

    @property
    def sigma(self) -> tuple[float, float, float]:
        """Stiffness, damping and viscous friction."""
        return self.stiffness, 0.0, 0.0

    @property
    def character(self) -> Character:
        """Without modes, with a state."""
        return Character(stiffness=self.stiffness, velocity_dependent="bristles")

    @property
    def kernel(self) -> type[Kernel]:
        """The forces at all velocities."""
        return _Bristles

    def check_use(self, use: Use) -> None:
        """Refuse a normal force that rises from 0, or nearly 0, without a jump: there bristles are infinitely stiff."""
        if use.normal is None:
            return
        pressed = use.normal.clipped(use.start, use.stop)
        times = [use.start, *pressed.breaks(use.start, use.stop)]
        foot = next((t for t in times if pressed(t) == 0 and pressed.slope(t) > 0), None)
        if foot is not None:
            raise ValueError(
                f"{use.label}: its normal force rises from 0 at t = {foot:g}, where a bristle is infinitely stiff; "
                "let it start above 0, or use DryFriction"
            )
        # From nearly 0 it rises by powers of ten within one step, and the solver keeps the stiffness from before.
        near = NEARLY_OPEN * max(pressed(t) for t in [*times, *np.linspace(use.start, use.stop, _SAMPLES)])
        beyond = use.normal - near
        for t in beyond.clipped(use.start, use.stop).breaks(use.start, use.stop):
            if abs(beyond(t)) <= 1e-6 * near and beyond.slope(t) > 0:
                raise ValueError(
                    f"{use.label}: its normal force comes back from nearly 0 at t = {t:g}, where a bristle is all but "
                    f"infinitely stiff; let it stay above {near:.3g}, or use DryFriction"
                )


@register
@dataclass(frozen=True)
class LuGre(BristleLaw):
    """The LuGre bristle model.

    ``z' = w - sigma_0 |w| z / g(w)``, ``r = sigma_0 z + sigma_1 z' + sigma_2 w``, ``g = mu_k(|w|) N`` with the
    Stribeck curve of the law (Canudas de Wit, Olsson, Astrom and Lischinsky 1995). In steady sliding
    ``r = sign(w) g(w) + sigma_2 w``. The bristles relax at the rate ``sigma_0 |w| / g``: a fixed step must be
    shorter than 2.7 relaxation times ``g / (sigma_0 |w|)``. In an open contact z is 0. A normal force that rises from
    less than a ten-thousandth of its largest value makes bristles all but infinitely stiff and is refused. Bristles
    relax at most at 1e12 /s; where their friction exceeds its level by a ten-thousandth for that reason, the run ends
    in an error.

    Parameters
    ----------
    law : DryFriction
        The coefficients; its Stribeck velocity makes g fall from static to Coulomb friction.
    stiffness : float
        sigma_0 in N/m or N m/rad, positive.
    damping : float
        sigma_1 in N s/m or N m s/rad, not negative.
    viscous : float
        sigma_2 in N s/m or N m s/rad, not negative.

    Raises
    ------
    ValueError, TypeError
        If a parameter is negative, the stiffness is not positive, or the Coulomb coefficient is 0 beside static or
        viscous friction that is not.
    """

    law: DryFriction
    stiffness: float
    damping: float = 0.0
    viscous: float = 0.0

    def __post_init__(self) -> None:
        self._check_number("damping", positive=False)
        self._check_number("viscous", positive=False)
        super().__post_init__()

    @property
    def sigma(self) -> tuple[float, float, float]:
        """Stiffness, damping and viscous friction."""
        return self.stiffness, self.damping, self.viscous
