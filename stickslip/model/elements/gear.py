"""A pair of gears, a belt, a chain, a lever."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.elements.base import Held, Link


@dataclass(frozen=True)
class Gear(Held, Link):
    """A pair of gears: ``v_a = ratio v_b``; its force lambda acts with -lambda on `a` and ``+ratio lambda`` on `b`.

    The law of Modelica's IdealGear: no losses, no backlash, no inertia.

    Parameters
    ----------
    name : str
        Unique among the contacts and other rows of the scene.
    a, b : str
        Names of bodies or drives, or GROUND.
    ratio : float
        Not 0; negative where the shafts turn against each other.

    Raises
    ------
    ValueError, TypeError
        If the ends are the same, or the ratio is 0 or not finite.
    """

    name: str
    a: str
    b: str
    _: KW_ONLY
    ratio: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._not_zero("ratio", "a Tie with one member holds a body still")

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients of the velocities in ``v_a - ratio v_b = 0``."""
        return {self.a: 1.0, self.b: -self.ratio}
