"""What a simulation hands back beside the motion: events, and how it ended; and what can be drawn of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any, Protocol

from stickslip.model.modes import Mode
from stickslip.results.samples import Samples

Target = str | PathLike[str]


@dataclass(frozen=True)
class Event:
    """A contact or another row changes its mode, or a quantity that the user watches comes to 0.

    Attributes
    ----------
    t : float
        Time in s.
    contact : str
        Name of the contact, of the row, or of the user's `When`.
    before, after : Mode
        Modes before and after; of a `When` the signs of its quantity, ``STUCK`` where that stays at 0.
    cause : str
        Why, in a few words.
    """

    t: float
    contact: str
    before: Mode
    after: Mode
    cause: str = ""

    def __str__(self) -> str:
        return f"{self.t:.12g} s  {self.contact}: {self.before.name} -> {self.after.name} ({self.cause})"


class Outcome(Protocol):
    """One run, as explanations and files read it."""

    @property
    def samples(self) -> Samples:
        """The motion at the run's times."""

    @property
    def events(self) -> list[Event]:
        """Events in order of time."""

    @property
    def success(self) -> bool:
        """Whether the run came to its end, or to a `When` that stops it."""

    @property
    def status(self) -> int:
        """0 where the end was reached, 1 where a `When` stopped the run, -1 where it failed."""

    @property
    def message(self) -> str:
        """How it ended, in words."""

    @property
    def stats(self) -> Mapping[str, Any]:
        """Counts of the work done."""
