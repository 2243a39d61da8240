"""What a simulation computed: data, and the quantities read off it by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from stickslip.assembly import System
from stickslip.mode_set import FREE, OPEN
from stickslip.modes import Mode
from stickslip.scene import GROUND, Scene
from stickslip.segment import Segment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from stickslip.energy import EnergyLedger

__all__ = ["Event", "Piece", "Result", "SimulationError"]

Array = NDArray[np.float64]

_POINTS_PER_PERIOD = 16


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


@dataclass(frozen=True)
class Piece:
    """The computed points of one segment, from which the segment can be built again."""

    system: System = field(repr=False)
    start: float
    stop: float
    modes: NDArray[np.int8]
    labels: NDArray[np.int8]
    since: Array
    at_rest: NDArray[np.bool_]
    taus: Array
    states: Array
    complete: bool = True
    multipliers: tuple[Array, Array] | None = None

    @classmethod
    def of(
        cls,
        segment: Segment,
        stop: float,
        labels: NDArray[np.int8],
        taus: Array,
        states: Array,
        complete: bool = True,
        multipliers: tuple[Array, Array] | None = None,
    ) -> Piece:
        """Return the computed points (rows) of a segment."""
        modes = segment.mode_set.modes
        since, at_rest = segment.since, segment.at_rest
        return cls(segment.system, segment.t, stop, modes, labels, since, at_rest, taus, states, complete, multipliers)

    def segment(self) -> Segment:
        """Return the segment again."""
        mode_set = self.system.mode_set(self.modes.tobytes())
        return Segment(self.system, mode_set, self.start, self.states[0], self.since, self.at_rest, self.stop)


def interpolate(segment: Segment, knots: Array, states: Array, taus: Array) -> Array:
    """Return the states (rows) of a segment at local times `taus`, from its computed points."""
    if segment.quadratic:
        found = np.ascontiguousarray(segment.state(taus).T)
    else:
        found = segment.between(knots, states)(taus)
    if taus.size:
        segment.exact_velocities(taus, found)
    return found


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
        system = self._system
        elements = (*self.scene.bodies, *self.scene.drives)
        base = elements[i].position
        if not all(piece.complete for piece in self._pieces):
            raise ValueError(
                f"the position of {elements[i].name!r} was not kept; simulate with dense_output=True, "
                "or let a spring touch the body"
            )
        starts = []
        for piece in self._pieces:
            starts.append(base)
            base += float(_displacement(piece, piece.segment(), i, system, piece.taus[-1:])[0])
        out = np.empty_like(self.t)
        for k, segment, chosen, taus in self._chosen():
            out[chosen] = starts[k] + _displacement(self._pieces[k], segment, i, system, taus)
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
            side = (self._forces_at(piece, segment, taus, y)[j] < 0).astype(int) if np.ptp(static) else side
            rise = 0.0 if dwell == 0 else np.exp(-(segment.t + taus - segment.since[j]) / dwell)
            return (static[side] - (static[side] - coulomb[side]) * rise) * normal

        return self._per_piece(level)

    def mode(self, contact: str) -> NDArray[np.int8]:
        """Return the mode of a contact at the times `t`: -1, 0 or +1."""
        j = self._contact(contact)
        return self._per_piece(lambda piece, segment, taus, y: _mode(piece, segment, j, taus, y)).astype(np.int8)

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
            out[:, chosen] = self._forces_at(self._pieces[k], segment, taus, self.y[:, chosen])
        return out

    def _forces_at(self, piece: Piece, segment: Segment, taus: Array, y: Array) -> Array:
        system = self._system
        mode_set = segment.mode_set
        forces = np.zeros((system.m, taus.size))
        normals = segment.normals(taus)
        forces[mode_set.slip] = mode_set.kinetic[mode_set.slip][:, None] * normals[mode_set.slip]
        if mode_set.acting.size:
            forces[mode_set.acting] = segment.acting_forces(taus, y)
        if piece.multipliers is not None and mode_set.stuck.size:
            forces[mode_set.stuck] = CubicHermiteSpline(piece.taus, *piece.multipliers)(taus).T
        elif mode_set.stuck.size:
            first = mode_set.slip.size
            forces[mode_set.stuck] = segment.watched(taus, y)[first : first + mode_set.stuck.size]
        return forces

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
            raise ValueError(f"times must lie in [{start:g}, {stop:g}] s, got {times.min():g} to {times.max():g}")
        place = np.searchsorted([piece.start for piece in pieces], times, side="right") - 1
        states = np.empty((self._system.size, times.size))
        for k in np.unique(place).tolist():
            chosen, piece = place == k, pieces[k]
            states[:, chosen] = interpolate(piece.segment(), piece.taus, piece.states, times[chosen] - piece.start).T
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

    def plot(self, **options: Any) -> Figure:
        """Draw velocities, modes, contact forces against breakaway levels, and normal forces (the paper's fig. 8)."""
        from stickslip import plots

        return plots.overview(self, **options)

    def __str__(self) -> str:
        lines = [self.message, *map(str, self.events)]
        lines.append(", ".join(f"{name}: {value}" for name, value in self.stats.items()))
        return "\n".join(lines)


def _mode(piece: Piece, segment: Segment, j: int, taus: Array, y: Array) -> Array:
    if piece.modes[j] < OPEN:
        return np.full(taus.size, piece.labels[j])
    w = segment.relative_velocity(taus, y)
    if piece.modes[j] == FREE:
        return segment.system.sign_of(w)[j]
    sign = np.sign(w[j])
    sign[taus == 0.0] = piece.labels[j]
    return sign


def _displacement(piece: Piece, segment: Segment, i: int, system: System, taus: Array) -> Array:
    """Return the integral of body i's velocity from the piece's start, by three-point Gauss on each step."""
    knots = piece.taus
    if segment.has_curved:
        # a quadratic motion has few computed points, whatever a curved drive does between them
        count = int(np.ceil(_POINTS_PER_PERIOD * knots[-1] / system.loads.period))
        knots = np.union1d(knots, np.linspace(0.0, knots[-1], max(count, 1) + 1))
    nodes, weights = np.polynomial.legendre.leggauss(3)

    def integral(left: Array, right: Array) -> Array:
        middle, half = 0.5 * (left + right), 0.5 * (right - left)
        points = np.clip(middle[:, None] + half[:, None] * nodes, 0.0, knots[-1])
        flat = points.ravel()
        if i < system.n:
            velocity = interpolate(segment, piece.taus, piece.states, flat)[:, i]
        else:
            velocity = segment.inputs(flat)[system.first_drive + i - system.n]
        return half * (velocity.reshape(points.shape) @ weights)

    whole = np.concatenate([[0.0], np.cumsum(integral(knots[:-1], knots[1:]))])
    step = np.clip(np.searchsorted(knots, taus, side="right") - 1, 0, max(knots.size - 2, 0))
    return whole[step] + integral(knots[step], taus)
