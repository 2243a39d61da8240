"""A planetary gear."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.elements.base import Held


@dataclass(frozen=True)
class Planetary(Held):
    """A planetary gear: ``(1 + ratio) v_carrier = v_sun + ratio v_ring``.

    Its force lambda acts with ``-(1 + ratio) lambda`` on the carrier, ``+lambda`` on the sun and ``+ratio lambda`` on
    the ring. The law of Modelica's IdealPlanetary: no losses, no inertia.

    Parameters
    ----------
    name : str
        Unique among the contacts and other rows of the scene.
    sun, carrier, ring : str
        Names of bodies or drives, or GROUND.
    ratio : float
        Teeth of the ring over teeth of the sun, positive.

    Raises
    ------
    ValueError, TypeError
        If two members are the same, or the ratio is not a positive number.
    """

    name: str
    _: KW_ONLY
    sun: str
    carrier: str
    ring: str
    ratio: float

    def __post_init__(self) -> None:
        super().__post_init__()
        for part in ("sun", "carrier", "ring"):
            self._identifier(part)
        if len({self.sun, self.carrier, self.ring}) < 3:
            raise ValueError(
                f"{self.label}: sun {self.sun!r}, carrier {self.carrier!r} and ring {self.ring!r} must be three "
                "different bodies; a Gear joins two"
            )
        if (ratio := self._number("ratio")) <= 0:
            raise ValueError(
                f"{self.label}: ratio must be positive, got {ratio:g}; it is teeth of the ring over teeth of the sun"
            )

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficients of the velocities in ``(1 + ratio) v_carrier - v_sun - ratio v_ring = 0``."""
        return {self.sun: -1.0, self.carrier: 1.0 + self.ratio, self.ring: -self.ratio}
