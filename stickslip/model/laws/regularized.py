"""Laws without exact sticking: pre-slip velocities, dead bands and bristles, for comparison."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from stickslip.model.laws.dry_friction import DryFriction, Law, register
from stickslip.model.signal_makers import _finite

__all__ = ["Dahl", "Karnopp", "LuGre", "PreSlip"]

Shape = Literal["linear", "tanh", "arctan"]
_SHAPES = ("linear", "tanh", "arctan")


class _Wrapped(Law):
    """A law that takes its coefficients from dry friction."""

    law: DryFriction

    def _check_law(self) -> None:
        if not isinstance(self.law, DryFriction):
            raise TypeError(f"{type(self).__name__}: law must be DryFriction, got {self.law!r}")

    def _check_number(self, name: str, positive: bool) -> None:
        number = _finite(getattr(self, name), f"{type(self).__name__}: {name}")
        if number < 0 or (positive and number == 0):
            wanted = "positive" if positive else "at least 0"
            raise ValueError(f"{type(self).__name__}: {name} must be {wanted}, got {number:g}")
        object.__setattr__(self, name, number)


@register
@dataclass(frozen=True)
class PreSlip(_Wrapped):
    """Friction that builds up over a small velocity, without exact sticking.

    "linear": ``r = mu_st N w / v_pre`` until ``|w| > v_pre``, then ``mu_k N sign(w)`` until
    ``|w| < 0.1 v_pre``: the slip state remembers that the peak exists only on breaking away, and mu_st rises
    with the dwell (Breedveld 2000, eqs. 3, 4, 8 and 9). "tanh" and "arctan": ``r = mu_k(|w|) N tanh(w / v_pre)``
    and ``r = mu_k(|w|) N (2 / pi) arctan(pi w / (2 v_pre))``, smooth, without slip state or dwell, and with
    no peak but that of a Stribeck curve.

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
        """Check the parameters."""
        self._check_law()
        self._check_number("velocity", positive=True)
        if not isinstance(self.shape, str) or self.shape not in _SHAPES:
            raise ValueError(
                f"PreSlip: unknown shape {self.shape!r}; choose from {', '.join(map(repr, _SHAPES))}"
            )


@register
@dataclass(frozen=True)
class Karnopp(_Wrapped):
    """Karnopp's dead band: a contact counts as stuck as soon as ``|w| < velocity`` (Karnopp 1985).

    Only for a contact to the ground or to a drive: within the band one body's velocity is set to the other's,
    which for two moving bodies would invent momentum (Breedveld 2000, section 3).

    Parameters
    ----------
    law : DryFriction
        The coefficients.
    velocity : float
        Half width of the dead band in m/s or rad/s, positive.

    Raises
    ------
    ValueError, TypeError
        If the velocity is not positive.
    """

    law: DryFriction
    velocity: float = 1e-3

    def __post_init__(self) -> None:
        """Check the parameters."""
        self._check_law()
        self._check_number("velocity", positive=True)


@register
@dataclass(frozen=True)
class LuGre(_Wrapped):
    """The LuGre bristle model.

    ``z' = w - sigma_0 |w| z / g(w)``, ``r = sigma_0 z + sigma_1 z' + sigma_2 w``, ``g = mu_k(|w|) N`` with the
    Stribeck curve of the law (Canudas de Wit, Olsson, Astrom and Lischinsky 1995). In steady sliding
    ``r = sign(w) g(w) + sigma_2 w``. The bristles relax at the rate ``sigma_0 |w| / g``: a fixed step must be
    shorter than 2.7 of these times, and a normal force that rises from 0 makes them infinitely stiff.

    Parameters
    ----------
    law : DryFriction
        The coefficients; its Stribeck velocity makes g fall from static to Coulomb friction.
    stiffness : float
        sigma_0 in N/m or N m/rad, positive.
    damping : float
        sigma_1 in N s/m or N m s/rad.
    viscous : float
        sigma_2 in N s/m or N m s/rad.

    Raises
    ------
    ValueError, TypeError
        If a parameter is negative or the stiffness not positive.
    """

    law: DryFriction
    stiffness: float
    damping: float = 0.0
    viscous: float = 0.0

    def __post_init__(self) -> None:
        """Check the parameters."""
        self._check_law()
        self._check_number("stiffness", positive=True)
        self._check_number("damping", positive=False)
        self._check_number("viscous", positive=False)


@register
@dataclass(frozen=True)
class Dahl(_Wrapped):
    """The Dahl model: ``r = sigma_0 z``, ``z' = w - sigma_0 |w| z / (mu_k N)`` (Dahl 1968).

    Sliding one way from rest, ``r = mu_k N (1 - exp(-sigma_0 x / (mu_k N)))``, whatever the speed. As with
    `LuGre`, the normal force should stay above 0.

    Parameters
    ----------
    law : DryFriction
        The coefficients; the static one is not used.
    stiffness : float
        sigma_0 in N/m or N m/rad, positive.

    Raises
    ------
    ValueError, TypeError
        If the stiffness is not positive.
    """

    law: DryFriction
    stiffness: float

    def __post_init__(self) -> None:
        """Check the parameters."""
        self._check_law()
        self._check_number("stiffness", positive=True)
