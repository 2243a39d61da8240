"""Viscous friction."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.elements.base import Radii
from stickslip.model.elements.book import Book


@dataclass(frozen=True)
class Damper(Radii):
    """Viscous friction: ``c w`` with ``w = radius_a v_a - radius_b v_b``.

    It acts with ``-radius_a`` on `a` and with ``+radius_b`` on `b`.

    Parameters
    ----------
    a, b : str
        Names of bodies or drives, or GROUND.
    damping : float
        In N s/m or N m s/rad, not negative.
    radius_a, radius_b : float
        Factors of the velocities of `a` and `b`; not 0. A radius in m turns rad/s into m/s, and the force in N into
        a torque in N m.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, a radius 0, or the damping negative or not finite.
    """

    a: str
    b: str
    _: KW_ONLY
    damping: float
    radius_a: float = 1.0
    radius_b: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._not_negative("damping")

    def place(self, book: Book) -> None:
        """Enter a coupling without stiffness."""
        book.couple(self.label, self.coefficients, 0.0, self.damping, 0.0)
