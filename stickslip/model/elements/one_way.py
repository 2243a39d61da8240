"""A one-way clutch."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.elements.base import Radii, Row
from stickslip.model.elements.book import Book


@dataclass(frozen=True)
class OneWay(Row, Radii):
    """A one-way clutch (freewheel): `a` drives `b`, and `b` may run ahead.

    ``w = radius_a v_a - radius_b v_b <= 0``. Locked at ``w = 0`` while its force lambda is positive; it acts with
    ``-radius_a lambda`` on `a` and ``+radius_b lambda`` on `b`. Running free, ``w < 0``, it carries no force:
    ``0 <= lambda`` complementary to ``-w >= 0``. Its modes are STUCK and BACKWARD.

    Parameters
    ----------
    name : str
        Unique among the contacts and other rows of the scene.
    a, b : str
        Names of bodies or drives, or GROUND.
    radius_a, radius_b : float
        Factors of the velocities of `a` and `b`; not 0.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, or a radius is 0 or not finite.
    """

    called = "one-way clutch"

    name: str
    a: str
    b: str
    _: KW_ONLY
    radius_a: float = 1.0
    radius_b: float = 1.0

    def place(self, book: Book) -> None:
        """Enter a row that is held while its force is positive."""
        book.row(self.name, self.coefficients, kind="one-way")
