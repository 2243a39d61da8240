"""A free body."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.elements.base import MotionKind, Moving
from stickslip.model.elements.book import Book

_LEAST = 1e-300  # smaller numbers have no inverse


@dataclass(frozen=True)
class Body(Moving):
    """A free body: a flywheel, a block, a node of a drive line.

    Parameters
    ----------
    name : str
        Unique among the bodies and drives of the scene.
    inertia : float
        Mass in kg or moment of inertia in kg m^2, positive; or 0 where ties alone decide how the body moves.
    velocity, position : float
        At the start, in m/s or rad/s and in m or rad.
    motion : "rotation" or "translation", optional
        How it moves, where that differs from what the scene says. It changes no number, only the units that are shown.

    Raises
    ------
    ValueError, TypeError
        If a number is not finite, the inertia negative, or the name that of the ground.
    """

    name: str
    _: KW_ONLY
    inertia: float
    velocity: float = 0.0
    position: float = 0.0
    motion: MotionKind | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (inertia := self._number("inertia")) < _LEAST and inertia != 0:
            raise ValueError(
                f"{self.label}: inertia must be positive, got {inertia:g}; "
                "use a Drive for a body of prescribed velocity and GROUND for one at rest"
            )
        self._number("velocity")

    def place(self, book: Book) -> None:
        """Enter a body."""
        book.body(self)
