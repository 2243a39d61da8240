"""What a simulation hands back beside the motion: events, and how it ended; and what can be drawn of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any, Protocol, Self

from stickslip.model.arrays import Array, Modes
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results.samples import Samples

Target = str | PathLike[str]


@dataclass(frozen=True)
class Event:
    """A contact changes its mode.

    Attributes
    ----------
    t : float
        Time in s.
    contact : str
        Name of the contact.
    before, after : Mode
        Modes before and after.
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
        """Whether the end was reached."""

    @property
    def status(self) -> int:
        """0 where the end was reached, -1 where not."""

    @property
    def message(self) -> str:
        """How it ended, in words."""

    @property
    def stats(self) -> Mapping[str, Any]:
        """Counts of the work done."""


class Runs(Protocol):
    """One run, or several in a row."""

    @property
    def runs(self) -> Sequence[Outcome]:
        """Each of them, in order of time."""


class Drawable(Runs, Protocol):
    """What plots read of a result."""

    @property
    def scene(self) -> Scene:
        """What was simulated."""

    @property
    def events(self) -> list[Event]:
        """Events in order of time."""

    @property
    def message(self) -> str:
        """How it ended, in words."""

    @property
    def is_dense(self) -> bool:
        """Whether the motion between the outputs was kept."""

    @property
    def t(self) -> Array:
        """Times in s."""

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive at the times `t`."""

    def position(self, body: str) -> Array:
        """Return the position of a body or drive at the times `t`."""

    def relative_velocity(self, contact: str) -> Array:
        """Return ``w`` of a row at the times `t`."""

    def stretch(self, contact: str) -> Array:
        """Return the stretch of a row at the times `t`."""

    def force(self, contact: str) -> Array:
        """Return the force of a row at the times `t`."""

    def breakaway(self, contact: str, direction: int | None = None) -> Array:
        """Return a contact's breakaway level at the times `t`."""

    def normal(self, contact: str) -> Array:
        """Return a contact's normal force at the times `t`."""

    def mode(self, contact: str) -> Modes:
        """Return a row's modes at the times `t`."""

    def output(self, block: str) -> Array:
        """Return the outputs of a block at the times `t`."""

    def state(self, block: str) -> Array:
        """Return the states of a block at the times `t`."""

    def energy(self) -> Any:
        """Return the energy ledger."""

    def sample(self, times: int) -> Self:
        """Return the same motion at so many evenly spaced times."""

    def fit_for_plot(self, points: int = 0) -> Self:
        """Return the same motion at times between which straight lines look like it."""


def check_result(result: Any, what: str) -> None:
    """Refuse what is no result of a simulation.

    `what` begins the message.
    """
    if not hasattr(result, "runs"):
        raise TypeError(
            f"{what}: expected a Result, got {type(result).__name__}; simulate(scene, t_span) returns one"
        )
