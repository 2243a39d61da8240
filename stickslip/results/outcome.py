"""One run of a simulation: its events, how it ended, and its motion at the times of the result."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import Any

from stickslip.model.arrays import Array
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results.samples import Samples
from stickslip.results.sampling import at_steps, fit_for_plot
from stickslip.results.trajectory import Trajectory

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


@dataclass(frozen=True, eq=False)
class Outcome:
    """One run: how it ended, and its motion."""

    scene: Scene
    events: list[Event]
    success: bool
    status: int
    message: str
    stats: dict[str, Any]
    trajectory: Trajectory = field(repr=False)
    _at: Samples | Array | None = field(repr=False)

    @cached_property
    def samples(self) -> Samples:
        """The motion at the times `t`."""
        if isinstance(self._at, Samples):
            return self._at
        if self._at is None:
            return (at_steps if self.trajectory.span.is_stepped else fit_for_plot)(self.trajectory)
        return Samples.at_times(self.trajectory, self._at)
