"""A gap: an elastic stop, or the play between teeth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from math import inf, isfinite
from typing import Any

from stickslip.model.arrays import Array
from stickslip.model.elements.base import Radii, Row
from stickslip.model.elements.book import Book
from stickslip.model.modes import Mode
from stickslip.model.piecewise import ONE, RATE, STRETCH, Region
from stickslip.model.quantities import Quantity, relative_velocity, saturate, stretch


@dataclass(frozen=True)
class Gap(Row, Radii):
    """A gap: free between its limits, an elastic stop beyond them. It never pulls.

    Its stretch is ``s = radius_a x_a - radius_b x_b``. Beyond a limit, with the penetration d > 0 and its rate d', it
    pushes back with ``k d + clip(c d', -k d, k d)``: the force starts from 0, and the damper force is never larger
    than the spring force (the law of ElastoGap in the Modelica Standard Library). Its force r acts with ``-radius_a r``
    on `a` and ``+radius_b r`` on `b`, so it is positive at the upper limit and negative at the lower one.

    Its modes are OPEN between the limits, FORWARD beyond the upper one and BACKWARD beyond the lower one. Each change
    of mode is an event. Where the clip begins or ends to act the force has a corner: that is located, too, but it is
    no event, because the mode stays.

    Parameters
    ----------
    name : str
        Unique among the contacts and other rows of the scene.
    a, b : str
        Names of bodies or drives, or GROUND.
    lower, upper : float
        Limits of the stretch in m or rad; infinite where there is none.
    stiffness : float
        k in N/m or N m/rad, positive.
    damping : float
        c in N s/m or N m s/rad, not negative.
    radius_a, radius_b : float
        Factors of the positions of `a` and `b`; not 0.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, the limits are exchanged or both infinite, the stiffness is not positive, the damping
        negative, or a radius 0.
    """

    name: str
    a: str
    b: str
    _: KW_ONLY
    lower: float = -inf
    upper: float = inf
    stiffness: float
    damping: float = 0.0
    radius_a: float = 1.0
    radius_b: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_limits()
        if self._number("stiffness") <= 0:
            raise ValueError(
                f"{self.label}: stiffness must be positive, got {self.stiffness:g}; use a Stop for a rigid limit"
            )
        self._not_negative("damping")

    def place(self, book: Book) -> None:
        """Enter a row whose force is a piecewise-linear function of stretch and relative velocity."""
        book.row(self.name, self.coefficients, kind="gap", regions=self._regions(), pressing=self._pressing)

    def _pushes(self, stretch: Any, rate: Any, one: Any = 1.0) -> Iterator[tuple[Mode, Any, Any, Any]]:
        """Yield for each limit the mode beyond it, the penetration, and the forces of spring and damper there."""
        for side, limit in ((Mode.FORWARD, self.upper), (Mode.BACKWARD, self.lower)):
            if isfinite(limit):
                depth = side * (stretch - limit * one)
                yield side, depth, self.stiffness * depth, self.damping * side * rate

    def _pressing(self) -> Quantity:
        """Return the size of its force: ``max(0, min(2 k d, k d + c d'))``, summed over both limits."""
        found: Quantity = 0.0 * stretch(self.name)
        for _, _, push, drag in self._pushes(stretch(self.name), relative_velocity(self.name)):
            clipped = push + drag - saturate(drag - push, 0.0, inf) if self.damping else push
            found = found + saturate(clipped, 0.0, inf)
        return found

    def _regions(self) -> list[Region]:
        """Return the regions: open, then for each limit those beyond it, with damping clipped, not clipped, clipped."""
        regions: list[Region] = []
        ways_out: list[tuple[Array, int]] = []
        for side, depth, push, drag in self._pushes(STRETCH, RATE, ONE):
            first = 1 + len(regions)
            if self.damping == 0:
                ways_out.append((-depth, first))
                regions.append(Region(side * push, ((depth, 0),), side))
                continue
            # A touch enters the first region: the penetration is 0, so that the damping is more than the spring force.
            inwards, between, outwards = first, first + 1, first + 2
            ways_out.append((-depth, inwards))
            regions += [
                Region(side * 2.0 * push, ((depth, 0), (drag - push, between)), side),
                Region(side * (push + drag), ((depth, 0), (push - drag, inwards), (push + drag, outwards)), side),
                Region(0.0 * ONE, ((depth, 0), (-(push + drag), between)), side),
            ]
        return [Region(0.0 * ONE, tuple(ways_out), Mode.OPEN), *regions]
