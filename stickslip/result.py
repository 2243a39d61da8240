"""What a simulation computed: data, and the quantities read off it by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from stickslip.assembly import System
from stickslip.modes import Mode
from stickslip.pieces import Piece, interpolate
from stickslip.scene import GROUND, Body, Drive, Scene
from stickslip.segment import Segment

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

    def _contact(self, name: str) -> int:
        for i, contact in enumerate(self.scene.contacts):
            if contact.name == name:
                return i
        known = ", ".join(repr(c.name) for c in self.scene.contacts[:10])
        raise ValueError(f"no contact is called {name!r}; known are {known or 'none'}")

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive at the times `t`, in m/s or rad/s.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        i = self._body(body)
        if body == GROUND:
            return np.zeros_like(self.t)
        first = self._system.first_drive - self._system.n
        if i >= self._system.n:
            return self._per_piece(lambda piece, segment, taus, y: segment.inputs(taus)[first + i])
        if not self._system.drives:
            return self.y[i]

        def as_held(piece: Piece, segment: Segment, taus: Array, y: Array) -> Array:
            # read from the same expression as the drive's, so that the two are equal to the bit
            holder = segment.mode_set.groups.holder[i]
            driven = 0 <= holder < self._system.n + self._system.drives
            return segment.inputs(taus)[first + holder] if driven else y[i]

        return self._per_piece(as_held)

    def position(self, body: str) -> Array:
        """Return the position of a body or drive at the times `t`, in m or rad.

        It is integrated from the velocities where no spring made it a state.

        Raises
        ------
        ValueError
            If there is no such body.
        """
        i = self._body(body)
        state = self._system.position_state.get(i)
        if state is not None:
            return self.y[state]
        if body == GROUND:
            return np.zeros_like(self.t)
        return self._integrated(i)

    def _integrated(self, i: int) -> Array:
        elements: tuple[Body | Drive, ...] = (*self.scene.bodies, *self.scene.drives)
        base = elements[i].position
        if not all(piece.complete for piece in self._pieces):
            raise ValueError(
                f"the position of {elements[i].name!r} was not kept; simulate with dense_output=True, "
                "or let a spring touch the body"
            )
        starts = []
        for piece in self._pieces:
            starts.append(base)
            base += float(piece.displacement(piece.segment(), i, piece.taus[-1:])[0])
        out = np.empty_like(self.t)
        for k, segment, chosen, taus in self._chosen():
            out[chosen] = starts[k] + self._pieces[k].displacement(segment, i, taus)
        return out

    def force(self, contact: str) -> Array:
        """Return the friction force r of a contact at the times `t`, in N or N m (-r acts on its body a)."""
        return self._forces[self._contact(contact)]

    def breakaway(self, contact: str) -> Array:
        """Return the breakaway level B of a contact at the times `t`, in N or N m.

        While the contact slips it is the level at which it would start to be stuck.
        """
        j = self._contact(contact)
        system = self._system
        static, dwell = system.mu_s[:, j], system.dwell[j]
        coulomb = np.maximum(system.mu_c, system.mu_0)[:, j]

        def level(piece: Piece, segment: Segment, taus: Array, y: Array) -> Array:
            normal = segment.normals(taus)[j]
            side = 1 if piece.labels[j] < 0 else 0
            if piece.labels[j] != 0:
                return (coulomb if dwell > 0 else static)[side] * normal
            side = (piece.forces(segment, taus, y)[j] < 0).astype(int) if np.ptp(static) else side
            rise = 0.0 if dwell == 0 else np.exp(-(segment.t + taus - segment.since[j]) / dwell)
            return (static[side] - (static[side] - coulomb[side]) * rise) * normal

        return self._per_piece(level)

    def mode(self, contact: str) -> NDArray[np.int8]:
        """Return the mode of a contact at the times `t`: -1, 0 or +1."""
        j = self._contact(contact)
        return self._per_piece(lambda piece, segment, taus, y: piece.mode(segment, j, taus, y)).astype(
            np.int8
        )

    def relative_velocity(self, contact: str) -> Array:
        """Return ``w = v_a - v_b`` of a contact at the times `t`, in m/s or rad/s."""
        c = self.scene.contacts[self._contact(contact)]
        return self.velocity(c.a) - self.velocity(c.b)

    def power(self, contact: str) -> Array:
        """Return the power ``r w`` that a contact dissipates at the times `t`, in W."""
        return self.force(contact) * self.relative_velocity(contact)

    def normal(self, contact: str) -> Array:
        """Return the normal force of a contact at the times `t`, in N, zero where it is open."""
        j = self._contact(contact)
        return self._per_piece(lambda piece, segment, taus, y: segment.normals(taus)[j])

    @cached_property
    def _forces(self) -> Array:
        out = np.empty((self._system.m, self.t.size))
        for k, segment, chosen, taus in self._chosen():
            out[:, chosen] = self._pieces[k].forces(segment, taus, self.y[:, chosen])
        return out

    def _chosen(self) -> Any:
        """Yield for each piece that holds times: its number, its segment, which times, and the local times."""
        order = np.argsort(self._piece_of, kind="stable")
        numbers, first = np.unique(self._piece_of[order], return_index=True)
        for k, chosen in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
            piece = self._pieces[k]
            yield k, piece.segment(), chosen, np.maximum(self.t[chosen] - piece.start, 0.0)

    def _per_piece(self, quantity: Callable[[Piece, Segment, Array, Array], Array]) -> Array:
        out = np.empty(self.t.size)
        for k, segment, chosen, taus in self._chosen():
            out[chosen] = quantity(self._pieces[k], segment, taus, self.y[:, chosen])
        return out

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
            states[:, chosen] = interpolate(piece.segment(), piece, times[chosen] - piece.start).T
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
