"""What a simulation computed: data, and the quantities read off it by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.modes import Mode
from stickslip.pieces import Piece
from stickslip.reading import Reading
from stickslip.scene import GROUND, Body, Drive, Scene

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from stickslip.energy import EnergyLedger

__all__ = ["Event", "Result", "SimulationError", "SimulationInterrupted"]

Array = NDArray[np.float64]


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


class SimulationError(RuntimeError):
    """A simulation that could not go on.

    Attributes
    ----------
    t : float
        Time in s that was reached.
    modes : dict
        The mode of each contact then.
    result : Result
        All that was computed so far.
    """

    def __init__(self, message: str, t: float, modes: Mapping[str, Mode], result: Result) -> None:
        super().__init__(message)
        self.t, self.modes, self.result = t, dict(modes), result


class SimulationInterrupted(KeyboardInterrupt):
    """A simulation that was interrupted from the keyboard.

    Attributes
    ----------
    result : Result
        All that was computed so far.
    """

    def __init__(self, message: str, result: Result) -> None:
        super().__init__(message)
        self.result = result


@dataclass(frozen=True)
class Result:
    """A simulated motion, in the manner of scipy's `solve_ivp`.

    Attributes
    ----------
    t : array (n,)
        Times in s: every computed point and every event twice (left and right limit), or `t_eval`.
    y : array (size, n)
        States: velocities of the bodies, then positions of what springs touch.
    events : list of Event
        In order of time.
    success : bool
    status : int
        0 where the end was reached, -1 where not.
    message : str
    stats : dict
        What was assembled and how much work was done.
    """

    scene: Scene
    t: Array = field(repr=False)
    y: Array = field(repr=False)
    events: list[Event]
    success: bool
    status: int
    message: str
    stats: dict[str, Any]
    _system: System = field(repr=False)
    _pieces: list[Piece] = field(repr=False)
    _piece_of: NDArray[np.intp] = field(repr=False)

    @property
    def nfev(self) -> int:
        """Number of rate evaluations."""
        return int(self.stats["rate_calls"])

    @property
    def njev(self) -> int:
        """Number of Jacobian evaluations."""
        return int(self.stats["jacobian_calls"])

    # -- by name ------------------------------------------------------------------------------------------

    def _body(self, name: str) -> int:
        try:
            return self._system.index[name]
        except KeyError:
            known = ", ".join(map(repr, list(self._system.index)[:10]))
            raise ValueError(f"no body is called {name!r}; known are {known}") from None

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {contact.name: j for j, contact in enumerate(self.scene.contacts)}

    def _contact(self, name: str) -> int:
        try:
            return self._numbers[name]
        except KeyError:
            known = ", ".join(repr(c.name) for c in self.scene.contacts[:10])
            raise ValueError(f"no contact is called {name!r}; known are {known or 'none'}") from None

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive at the times `t`, in m/s or rad/s.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        return self._reading.velocity(self._body(body))

    def position(self, body: str) -> Array:
        """Return the position of a body or drive at the times `t`, in m or rad.

        It is integrated from the velocities where no spring made it a state.

        Raises
        ------
        ValueError
            If there is no such body, or the points between the outputs were not kept.
        """
        i = self._body(body)
        state = self._system.position_state.get(i)
        if state is not None:
            return self.y[state]
        if body == GROUND:
            return np.zeros_like(self.t)
        elements: tuple[Body | Drive, ...] = (*self.scene.bodies, *self.scene.drives)
        if not all(piece.complete for piece in self._pieces):
            raise ValueError(
                f"the position of {body!r} was not kept; simulate with dense_output=True, "
                "or let a spring touch the body"
            )
        return self._reading.position(i, elements[i].position)

    def force(self, contact: str) -> Array:
        """Return the friction force r of a contact at the times `t`, in N or N m (-r acts on its body a)."""
        return self._reading.forces[self._contact(contact)]

    def breakaway(self, contact: str, direction: int | None = None) -> Array:
        """Return a breakaway level B of a contact at the times `t`, in N or N m, never negative.

        A stuck contact holds forces from ``-breakaway(contact, -1)`` to ``+breakaway(contact, +1)``; the two differ
        where forward and backward coefficients do. While the contact slips they are the levels at which it would
        start to be stuck.

        Parameters
        ----------
        contact : str
            Name of the contact.
        direction : +1 or -1, optional
            +1 (`Mode.FORWARD`) for the level above which it slips forward, -1 (`Mode.BACKWARD`) for the other. By
            default the level on the side of the force: that of the direction in which the contact slips, or, while
            it is stuck, of the sign of its force.

        Raises
        ------
        ValueError
            If there is no such contact or direction.
        """
        j = self._contact(contact)
        if direction is None:
            return self._reading.level(j, None)
        if direction not in (1, -1):
            raise ValueError(
                f"breakaway of contact {contact!r}: direction must be +1 (forward) or -1 (backward), "
                f"got {direction!r}; leave it out for the side of the force"
            )
        return self._reading.level(j, 0 if direction == 1 else 1)

    def mode(self, contact: str) -> NDArray[np.int8]:
        """Return the mode of a contact at the times `t`: -1, 0 or +1."""
        return self._reading.mode(self._contact(contact))

    def relative_velocity(self, contact: str) -> Array:
        """Return ``w = v_a - v_b`` of a contact at the times `t`, in m/s or rad/s."""
        return self._reading.relative_velocity(self._contact(contact))

    def power(self, contact: str) -> Array:
        """Return the power ``r w`` that a contact dissipates at the times `t`, in W."""
        return self.force(contact) * self.relative_velocity(contact)

    def normal(self, contact: str) -> Array:
        """Return the normal force of a contact at the times `t`, in N, zero where it is open."""
        return self._reading.normal(self._contact(contact))

    @cached_property
    def _reading(self) -> Reading:
        return Reading(self._system, self._pieces, self.t, self.y, self._piece_of)

    @cached_property
    def _views(self) -> dict[tuple[str, int], Result]:
        """The same motion at other times, as drawings ask for it again and again."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is only kept to be read again."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    # -- between and beyond -------------------------------------------------------------------------------

    def __call__(self, t: float | Array) -> Array:
        """Return the states at any times of the simulated span, right limits at events.

        Parameters
        ----------
        t : float or array (k,)
            Times in s.

        Returns
        -------
        array (size,) or (size, k)

        Raises
        ------
        ValueError
            If a time lies outside, or only the requested outputs were kept.
        """
        times = np.atleast_1d(np.asarray(t, dtype=float))
        states = self._evaluate(times)
        return states[:, 0] if np.ndim(t) == 0 else states

    def _evaluate(self, times: Array) -> Array:
        pieces = self._pieces
        if not pieces or not all(piece.complete for piece in pieces):
            raise ValueError("the points between the outputs were not kept; simulate with dense_output=True")
        start, stop = pieces[0].start, pieces[-1].stop
        if times.size and not (times.min() >= start and times.max() <= stop):
            raise ValueError(
                f"times must lie in [{start:g}, {stop:g}] s, got {times.min():g} to {times.max():g}"
            )
        place = np.searchsorted([piece.start for piece in pieces], times, side="right") - 1
        states = np.empty((self._system.size, times.size))
        for k in np.unique(place).tolist():
            chosen, piece = place == k, pieces[k]
            states[:, chosen] = piece.states_at(times[chosen] - piece.start).T
        return states

    def energy(self) -> EnergyLedger:
        """Return where the energy went, and by how much the balance is off: a free check of accuracy.

        Raises
        ------
        ValueError
            If only the requested outputs were kept.
        """
        from stickslip.energy import energy

        return energy(self)

    def explain(self) -> str:
        """Return in words what was assembled, which guards were watched, and why each event happened."""
        from stickslip.explain import explain

        return explain(self)

    def to_csv(self, path: str | Path) -> None:
        """Write time, velocities, positions, forces and modes as a table."""
        from stickslip.output import to_csv

        to_csv(self, path)

    def to_frame(self) -> Any:
        """Return the same as a pandas data frame (extra `stickslip[frames]`)."""
        from stickslip.output import to_frame

        return to_frame(self)

    def save(self, path: str | Path) -> None:
        """Write all of the result to an npz file, without loss; `stickslip.load` reads it."""
        from stickslip.output import save

        save(self, path)

    def plot(self, **options: Any) -> Figure:
        """Draw velocities, modes, contact forces against breakaway levels, and normal forces (the paper's fig. 8)."""
        from stickslip import plots

        return plots.overview(self, **options)

    def __str__(self) -> str:
        lines = [self.message, *map(str, self.events)]
        lines.append(", ".join(f"{name}: {value}" for name, value in self.stats.items()))
        return "\n".join(lines)
