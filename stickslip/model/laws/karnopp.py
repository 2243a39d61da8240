"""Karnopp's dead band, a baseline."""

from __future__ import annotations

from dataclasses import dataclass, replace

from stickslip.model.laws.base import Character, Use
from stickslip.model.laws.dry_friction import DryFriction, Law, register


@register
@dataclass(frozen=True)
class Karnopp(Law):
    """Karnopp's dead band: a contact counts as stuck as soon as ``|w|`` falls to ``velocity`` (Karnopp 1985).

    A contact that has broken away moves on through the band: it sticks when it comes back into the band, or at
    ``w = 0``. The energy of the motion that ends at the edge of the band is lost: the energy ledger shows it as an
    error. Only for a contact to the ground or to a drive: within the band one body's velocity is set to the other's,
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
        self._check_law()
        self._check_number("velocity", positive=True)

    @property
    def character(self) -> Character:
        """The character of dry friction, but at rest within the band."""
        return replace(self.core.character, rests_below=self.velocity)

    def check_use(self, use: Use) -> None:
        """Refuse a contact between two bodies that can both move."""
        if use.both_move:
            a, b = use.ends
            raise ValueError(
                f"{use.label}: Karnopp's dead band sets a velocity to that of the ground or a drive, but both "
                f"{a!r} and {b!r} can move, and momentum would not be conserved; use DryFriction"
            )
