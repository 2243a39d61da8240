"""A body of prescribed velocity."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass

from stickslip.model.elements.base import Book, Named
from stickslip.model.signals import Signal

__all__ = ["Drive"]


@dataclass(frozen=True)
class Drive(Named):
    """A body of prescribed velocity: a belt, a motor, a moving plate.

    Parameters
    ----------
    name : str
        Unique in the scene.
    velocity : float or Signal
        In m/s or rad/s.
    position : float
        At the start, in m or rad.

    Raises
    ------
    ValueError, TypeError
        If the velocity is not a signal, the position not finite, or the name that of the ground.
    """

    name: str
    _: KW_ONLY
    velocity: Signal | float
    position: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields."""
        self._free_name()
        self._signal("velocity")
        self._number("position")

    def place(self, book: Book) -> None:
        """Enter a drive."""
        book.drive(self)
