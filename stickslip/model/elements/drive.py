"""A body of prescribed velocity."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.elements.base import MotionKind, Moving
from stickslip.model.elements.book import Book
from stickslip.model.signals import Signal, as_signal


@dataclass(frozen=True)
class Drive(Moving):
    """A body of prescribed velocity: a belt, a motor, a moving plate.

    Parameters
    ----------
    name : str
        Unique among the bodies and drives of the scene.
    velocity : float or Signal
        In m/s or rad/s.
    position : float
        At the start, in m or rad.
    motion : "rotation" or "translation", optional
        How it moves, where that differs from what the scene says. It changes no number, only the units that are shown.

    Raises
    ------
    ValueError, TypeError
        If the velocity is not a signal, the position not finite, or the name that of the ground.
    """

    name: str
    _: KW_ONLY
    velocity: Signal | float
    position: float = 0.0
    motion: MotionKind | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        what = f"{self.label}: velocity"
        object.__setattr__(self, "velocity", as_signal(self.velocity, what).read_by(what))

    def place(self, book: Book) -> None:
        """Enter a drive."""
        book.drive(self)
