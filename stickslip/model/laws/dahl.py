"""The Dahl model: bristles without damping and viscous friction."""

from __future__ import annotations

from dataclasses import dataclass

from stickslip.model.laws.dry_friction import DryFriction, register
from stickslip.model.laws.lugre import BristleLaw


@register
@dataclass(frozen=True)
class Dahl(BristleLaw):
    """The Dahl model: ``r = sigma_0 z``, ``z' = w - sigma_0 |w| z / (mu_k N)`` (Dahl 1968).

    Sliding one way from rest, ``r = mu_k N (1 - exp(-sigma_0 x / (mu_k N)))``, whatever the speed. As with
    `LuGre`, z is 0 in an open contact, and a normal force that rises from nearly 0 is refused.

    Parameters
    ----------
    law : DryFriction
        The coefficients; the static one is not used.
    stiffness : float
        sigma_0 in N/m or N m/rad, positive.

    Raises
    ------
    ValueError, TypeError
        If the stiffness is not positive, or the Coulomb coefficient is 0 and the static one is not.
    """

    law: DryFriction
    stiffness: float
