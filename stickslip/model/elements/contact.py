"""A friction contact."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.checks import flag
from stickslip.model.elements.base import Radii, Row
from stickslip.model.elements.book import Book
from stickslip.model.laws.dry_friction import DryFriction, Law
from stickslip.model.signals import Load


@dataclass(frozen=True)
class Contact(Row, Radii):
    """A friction contact between two bodies, or between a body and a drive or the ground.

    Its relative velocity is ``w = radius_a v_a - radius_b v_b``; its friction force r acts with ``-radius_a r`` on `a`
    and ``+radius_b r`` on `b` (Breedveld 2000, with the radii of wheels and drums).

    Parameters
    ----------
    name : str
        Unique among the contacts and other rows of the scene.
    a, b : str
        Names of bodies or drives, or GROUND.
    law : Law
        The friction law.
    normal : float, Signal or Quantity
        Normal force in N; where it is negative the contact is open and the force is 0.
    rested : float
        How long in s a contact that is stuck at the start has been stuck already.
    deflection : float
        Of the bristles at the start, in m or rad; laws without bristles have none.
    slipping : bool
        Whether a contact with a pre-slip velocity has slipped already: above a tenth of that velocity it then starts on
        its kinetic level (frictional memory). Within Karnopp's dead band: whether it has broken away there; it then
        moves on.
    radius_a, radius_b : float
        Factors of the velocities of `a` and `b`; not 0. A radius in m turns rad/s into m/s, and the force in N into
        a torque in N m.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, a radius 0, or an argument of the wrong kind.
    """

    name: str
    a: str
    b: str
    law: Law
    _: KW_ONLY
    normal: Load | float
    rested: float = 0.0
    deflection: float = 0.0
    slipping: bool = False
    radius_a: float = 1.0
    radius_b: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.law, Law) or not isinstance(getattr(self.law, "law", self.law), DryFriction):
            raise TypeError(f"{self.label}: law must be a friction law such as DryFriction(0.2, 0.1), got {self.law!r}")
        self._load("normal")
        self._not_negative("rested")
        self._number("deflection")
        object.__setattr__(self, "slipping", flag(self.slipping, f"{self.label}: slipping"))

    def place(self, book: Book) -> None:
        """Enter a row of dry friction."""
        book.row(
            self.name,
            self.coefficients,
            law=self.law,
            normal=self.normal,
            rested=self.rested,
            deflection=self.deflection,
            slipping=self.slipping,
        )
