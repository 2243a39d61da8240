"""A linear spring."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.elements.base import Radii
from stickslip.model.elements.book import Book


@dataclass(frozen=True)
class Spring(Radii):
    """A linear spring, with a damper in parallel.

    Its stretch is ``s = radius_a x_a - radius_b x_b``; its pull ``k (s - rest) + c s'`` acts with ``-radius_a`` on `a`
    and with ``+radius_b`` on `b`.

    Parameters
    ----------
    a, b : str
        Names of bodies or drives, or GROUND.
    stiffness, damping : float
        In N/m and N s/m (N m/rad and N m s/rad), not negative.
    rest : float
        Stretch in m or rad at which the spring is free of force.
    radius_a, radius_b : float
        Factors of the velocities of `a` and `b`; not 0. A radius in m turns rad/s into m/s, and the force in N into
        a torque in N m.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, a radius 0, or a number negative or not finite.
    """

    a: str
    b: str
    _: KW_ONLY
    stiffness: float
    damping: float = 0.0
    rest: float = 0.0
    radius_a: float = 1.0
    radius_b: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._not_negative("stiffness")
        self._not_negative("damping")
        self._number("rest")

    def place(self, book: Book) -> None:
        """Enter a coupling."""
        book.couple(self.label, self.coefficients, self.stiffness, self.damping, self.rest)
