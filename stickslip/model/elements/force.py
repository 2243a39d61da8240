"""An external force or torque."""

from __future__ import annotations

from dataclasses import dataclass

from stickslip.model.elements.base import Element, listed
from stickslip.model.elements.book import Book
from stickslip.model.signals import Load


@dataclass(frozen=True)
class Force(Element):
    """An external force or torque on a body.

    Parameters
    ----------
    body : str
        Name of a free body.
    signal : float, Signal or Quantity
        In N or N m.

    Raises
    ------
    TypeError
        If the force is neither a signal nor a quantity.
    """

    body: str
    signal: Load | float

    def __post_init__(self) -> None:
        self._identifier("body")
        self._load("signal")

    @property
    def label(self) -> str:
        """How messages name the element."""
        return f"force on {self.body!r}"

    def check_ends(self, free: frozenset[str], known: frozenset[str]) -> None:
        """Refuse a force on anything but a free body."""
        if self.body not in free:
            remedy = f"known bodies are {listed(free)}"
            if self.body in known:
                remedy = "no force changes the velocity of a drive or of the ground; leave it out"
            raise ValueError(f"{self.label}: no free body is called {self.body!r}; {remedy}")

    def place(self, book: Book) -> None:
        """Enter a force."""
        book.push(self.body, self.signal)
