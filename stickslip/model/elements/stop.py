"""A rigid stop."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from math import inf, isfinite

from stickslip.model.elements.base import Radii, Row
from stickslip.model.elements.book import Book
from stickslip.model.modes import Mode
from stickslip.model.piecewise import ONE, STRETCH, Region


@dataclass(frozen=True)
class Stop(Row, Radii):
    """Rigid limits of the stretch ``s = radius_a x_a - radius_b x_b``: ``lower <= s <= upper``.

    Where s comes to a limit with the relative velocity w it rebounds with ``w+ = -e w-`` (Newton). Ties, locked one-way
    clutches and closed stops hand the impulse on; friction does not, because its force is finite. Where the rebound
    would be slower than the velocity margin, and where e is 0, the stop closes: its force r then keeps s at the limit,
    until r comes to 0. The force acts with ``-radius_a r`` on `a` and ``+radius_b r`` on `b`: it
    is positive at the upper limit and negative at the lower one.

    Its modes are OPEN between the limits, FORWARD while it is closed at the upper one, and BACKWARD at the lower one.
    Each impact is an event, also one from OPEN to OPEN.

    Parameters
    ----------
    name : str
        Unique among the contacts and other rows of the scene.
    a, b : str
        Names of bodies or drives, or GROUND.
    lower, upper : float
        Limits of the stretch in m or rad; infinite where there is none.
    restitution : float
        e, from 0 (no rebound) to 1 (no loss).
    radius_a, radius_b : float
        Factors of the positions of `a` and `b`; not 0.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, the limits are equal, exchanged or both infinite, the restitution is not within
        [0, 1], or a radius 0.
    """

    name: str
    a: str
    b: str
    _: KW_ONLY
    lower: float = -inf
    upper: float = inf
    restitution: float = 0.0
    radius_a: float = 1.0
    radius_b: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_limits()
        if self.lower == self.upper:
            raise ValueError(
                f"{self.label}: lower and upper are both {self.upper:g}, so nothing could move; "
                "use a Tie to hold two bodies together"
            )
        if not 0 <= self._number("restitution") <= 1:
            raise ValueError(f"{self.label}: restitution must be within [0, 1], got {self.restitution:g}")

    def place(self, book: Book) -> None:
        """Enter a row, and its regions: between the limits, at the upper one, at the lower one."""
        none = 0.0 * ONE
        borders = [(self.upper * ONE - STRETCH, 1)] if isfinite(self.upper) else []
        borders += [(STRETCH - self.lower * ONE, 2)] if isfinite(self.lower) else []
        regions = [Region(none, tuple(borders), Mode.OPEN)]
        regions += [Region(none, (), Mode.FORWARD), Region(none, (), Mode.BACKWARD)]
        book.row(self.name, self.coefficients, kind="stop", restitution=self.restitution, regions=regions)
