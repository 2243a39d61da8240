"""A trajectory read at some times: every quantity by name.

All rows are evaluated together, once for all times, so that asking for every quantity of every name costs hardly more
than asking for one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.mode_equations import AT_HIGH, AT_LOW, FREE, acting_in
from stickslip.equations.path import gauss_nodes
from stickslip.equations.piecewise import Regions
from stickslip.equations.reader import BlockPlace
from stickslip.equations.system import System
from stickslip.model.elements import GROUND, Body, Drive, Sampled
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results import positions
from stickslip.results.trajectory import Trajectory, by_piece

__all__ = ["Samples", "integrated"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Modes = NDArray[np.int8]

_MOST_ENTRIES = 20_000_000
"""Tables larger than this are not kept, but computed block by block for each name asked for."""

_WIDE = 2_000_000
"""States at all times, from so many on, are read by name where that costs no more than what is read."""

_AT_ONCE = 1_000_000
_PER_PERIOD = 8
_MOST_NODES = 10
"""Gauss nodes per step; exact for polynomials of degree 19, and for products of two series to the last bit."""


@dataclass(frozen=True)
class Tables:
    """Quantities of all rows at the times of samples, a line per row.

    Attributes
    ----------
    forces : array (m, k)
        Friction forces in N or N m.
    upper, lower : array (m, k)
        Breakaway levels in N or N m for forces above and below 0; while a row slips, those at which it would stick.
    normals : array (m, k)
        In N.
    modes : array (m, k) of int8
    inputs : array (inputs, k)
        All inputs of the system.
    """

    forces: Array
    upper: Array
    lower: Array
    normals: Array
    modes: Modes
    inputs: Array

    @cached_property
    def breakaway(self) -> Array:
        """Breakaway levels on the side to which rows slip or are pushed."""
        below = (self.modes < 0) | ((self.modes == 0) & (self.forces < 0))
        return np.where(below, self.lower, self.upper)


@dataclass(frozen=True)
class Samples:
    """A trajectory at some times.

    Attributes
    ----------
    trajectory : Trajectory
    t : array (k,)
        Times in s.
    kept : array (size, k) or None
        States there; None where they are read when they are needed.
    piece_of : array (k,) of int
        The piece that each time belongs to: at an event there is one before and one after.
    """

    trajectory: Trajectory = field(repr=False)
    t: Array = field(repr=False)
    kept: Array | None = field(repr=False)
    piece_of: Indices = field(repr=False)

    @classmethod
    def at_local(cls, trajectory: Trajectory, piece_of: Indices, taus: Array) -> Samples:
        """Return a trajectory at local times in s of its pieces."""
        t = np.minimum(trajectory.starts[piece_of] + taus, trajectory.stops[piece_of])
        kept = None if _is_wide(trajectory, t) else trajectory.states(piece_of, taus)
        return cls(trajectory, t, kept, piece_of)

    @classmethod
    def at_times(cls, trajectory: Trajectory, times: Array) -> Samples:
        """Return a trajectory at times in s, right limits at events.

        Raises
        ------
        ValueError
            If a time lies outside, or only the requested outputs were kept.
        """
        piece_of = trajectory.places(times)
        found = cls(trajectory, times, None, piece_of)
        if not _is_wide(trajectory, times):
            found.y  # noqa: B018  (errors are to come now, not when a quantity is read)
        return found

    @property
    def system(self) -> System:
        """The compiled scene."""
        return self.trajectory.system

    @property
    def scene(self) -> Scene:
        """The simulated scene."""
        return self.system.scene

    @cached_property
    def y(self) -> Array:
        """States, a column for each time."""
        return self.trajectory.states(self.piece_of, self.taus) if self.kept is None else self.kept

    @property
    def _by_name(self) -> bool:
        """Whether quantities are read one by one: there are many, and nothing has been computed for all."""
        return "y" not in self.__dict__ and self.kept is None and _is_wide(self.trajectory, self.t)

    @cached_property
    def taus(self) -> Array:
        """The times since the start of their pieces in s."""
        return self.trajectory.local(self.piece_of, self.t)

    # -- by name ------------------------------------------------------------------------------------------

    def body(self, name: str) -> int:
        """Return the number of a body, drive or the ground."""
        try:
            return self.system.index[name]
        except (KeyError, TypeError):
            known = ", ".join(map(repr, list(self.system.index)[:10]))
            raise ValueError(f"no body is called {name!r}; known are {known}") from None

    def row(self, name: str) -> int:
        """Return the number of a contact or another row."""
        try:
            return self._row_of[name]
        except (KeyError, TypeError):
            known = ", ".join(map(repr, list(self._row_of)[:10]))
            raise ValueError(f"no contact is called {name!r}; known are {known or 'none'}") from None

    @cached_property
    def _row_of(self) -> dict[str, int]:
        return {row.name: j for j, row in enumerate(self.system.rows)}

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive, in m/s or rad/s."""
        i = self.body(body)
        return np.zeros_like(self.t) if body == GROUND else self._velocity(i)

    def _velocity(self, i: int) -> Array:
        if i >= self.system.n:
            driven: Array = self.drive_velocities[i - self.system.n]
            return driven
        if self._by_name:
            return self.trajectory.of_body(self.piece_of, self.taus, i)
        found: Array = self.y[i]
        return found

    def position(self, body: str) -> Array:
        """Return the position of a body or drive, in m or rad, integrated where no spring makes it a state."""
        i = self.body(body)
        state = self.system.position_state.get(i)
        if state is not None:
            if self._by_name and i < self.system.n:
                return self.trajectory.of_body(self.piece_of, self.taus, i, integrated=True)
            found: Array = self.y[state]
            return found
        if body == GROUND:
            return np.zeros_like(self.t)
        elements: tuple[Body | Drive, ...] = (*self.scene.bodies, *self.scene.drives)
        n = self.system.n
        way: Array = self._ways[i] if i < n else self._driven_ways[i - n]
        return elements[i].position + way

    def force(self, row: str) -> Array:
        """Return the force r of a row, in N or N m (``-c_i r`` acts on a body with the coefficient ``c_i``)."""
        return self._read(self.row(row), lambda tables: tables.forces)

    def normal(self, row: str) -> Array:
        """Return the normal force of a row in N, zero where it is open."""
        return self._read(self.row(row), lambda tables: tables.normals)

    def mode(self, row: str) -> Modes:
        """Return the mode of a row: -1, 0 or +1, or 2 where a gap is open."""
        return np.asarray(self._read(self.row(row), lambda tables: tables.modes), dtype=np.int8)

    def levels(self, row: str) -> tuple[Array, Array]:
        """Return the breakaway levels of a row forward and backward, both positive, in N or N m."""
        j = self.row(row)
        return self._read(j, lambda tables: tables.upper), self._read(j, lambda tables: tables.lower)

    def breakaway(self, row: str) -> Array:
        """Return the breakaway level on the side to which a row slips or is pushed, in N or N m."""
        return self._read(self.row(row), lambda tables: tables.breakaway)

    def relative_velocity(self, row: str) -> Array:
        """Return the relative velocity w of a row, in m/s or rad/s."""
        found = np.zeros_like(self.t)
        for i, c in self.system.rows[self.row(row)].coefficients.items():
            found = found + c * self._velocity(i)
        return found

    def block(self, name: str) -> BlockPlace:
        """Return where a block stands."""
        try:
            return self.system.blocks[name]
        except (KeyError, TypeError):
            known = ", ".join(map(repr, list(self.system.blocks)[:10]))
            raise ValueError(f"no block is called {name!r}; known are {known or 'none'}") from None

    def states_of(self, block: str) -> Array:
        """Return the states of a block, a line each."""
        place = self.block(block)
        states = slice(place.first, place.first_held)
        return self._clocked(states) if isinstance(place.block, Sampled) else self.y[states]

    def _clocked(self, states: slice) -> Array:
        """Return states that change at samples only, as they are at the starts of pieces."""
        pieces = self.trajectory.pieces
        found = np.empty((states.stop - states.start, self.t.size))
        for number, chosen in by_piece(self.piece_of):
            found[:, chosen] = pieces[number].y[states, None]
        return found

    def outputs_of(self, block: str) -> Array:
        """Return the outputs of a block, a line each."""
        place = self.block(block)
        if isinstance(place.block, Sampled):
            return self._clocked(slice(place.first_held, place.end))
        return self.system.outputs_of(place, self.t, self.y, self.inputs)

    def stretch(self, row: str) -> Array:
        """Return ``sum c_i x_i`` of a row, in m or rad: the integral of its relative velocity."""
        system = self.system
        names = [*system.names, *(drive.name for drive in self.scene.drives)]
        found = np.zeros_like(self.t)
        for i, c in system.rows[self.row(row)].coefficients.items():
            found = found + c * self.position(names[i])
        return found

    # -- all rows at once ---------------------------------------------------------------------------------

    def _read(self, j: int, table: Callable[[Tables], NDArray[Any]]) -> NDArray[Any]:
        system = self.system
        if self._by_name:
            return np.asarray(table(self._of_row(j))[0])
        if max(system.m, 1) * self.t.size <= _MOST_ENTRIES:
            return np.asarray(table(self.tables)[j])
        parts = [np.array(table(block.computed())[j]) for block in self._blocks(_AT_ONCE // system.m + 1)]
        return np.concatenate(parts)

    def _blocks(self, count: int) -> list[Samples]:
        cuts = [slice(first, first + count) for first in range(0, self.t.size, count)]
        return [Samples(self.trajectory, self.t[c], self.y[:, c], self.piece_of[c]) for c in cuts]

    def _of_row(self, j: int) -> Tables:
        """Return the quantities of one row of a scene that is followed part by part: a contact without a curve."""
        system, trajectory = self.system, self.trajectory
        own = np.array([j])
        normal = np.maximum(trajectory.load_at(j, self.piece_of, self.taus), 0.0)[None]
        inner, shown, since, force = trajectory.of_row(self.piece_of, self.taus, j)
        upper, lower = self._levels(normal, shown, (system.dwell[own] > 0).nonzero()[0], since, own)
        coulomb = np.where(inner < 0, system.mu_c[1, j], system.mu_c[0, j])
        force = np.where(inner == 0, force, np.where(np.abs(inner) == 1, inner * coulomb * normal, 0.0))
        return Tables(force, upper, lower, normal, shown, np.empty((0, self.t.size)))

    @cached_property
    def tables(self) -> Tables:
        """All rows' quantities."""
        return self.computed()

    def computed(self) -> Tables:
        """Evaluate all rows at all times; held forces once for each set of held rows."""
        trajectory, system = self.trajectory, self.system
        m = system.m
        q = trajectory.inputs(self.piece_of, self.taus, self.y)
        normals = np.maximum(q[:m], 0.0)
        slow = (system.dwell > 0).nonzero()[0]
        inner, shown, since = trajectory.modes(self.piece_of, self.taus)
        since = since[slow]
        free = (inner == FREE).any(axis=1).nonzero()[0]
        if free.size:
            w = system.relative_velocity(self.y, q)
            shown[free] = np.where(inner[free] == FREE, system.sign_of(w)[free], shown[free])
        upper, lower = self._levels(normals, shown, slow, since)
        forces = self._moving(inner, normals, upper, lower)
        pushed = self._piecewise(q)
        self._hold(q, inner, forces, pushed)
        shows = system.piecewise.is_force.nonzero()[0]
        forces[system.piecewise.row[shows]] = pushed[shows]
        inputs = q[: system.inputs].copy()
        return Tables(forces, upper, lower, normals, shown, inputs)

    def _moving(self, modes: Modes, normals: Array, upper: Array, lower: Array) -> Array:
        """Return the forces of all rows that are not held; those of held ones are left 0."""
        system = self.system
        coulomb = np.where(modes < 0, system.mu_c[1][:, None], system.mu_c[0][:, None])
        forces = np.where(np.abs(modes) == 1, modes * coulomb * normals, 0.0)
        forces = np.where(modes == AT_HIGH, upper, np.where(modes == AT_LOW, -lower, forces))
        at = np.any(acting_in(modes, system), axis=0)
        if at.any():
            for _, chosen in self._by_modes():
                for number, some in chosen:
                    if at[some].any():
                        own = self.trajectory.motion(number)
                        rows = np.ix_(own.equations.acting, np.arange(self.t.size)[some])
                        forces[rows] = own.acting_forces(self.taus[some], self.y[:, some])
        return forces

    def _by_modes(self) -> Iterable[tuple[bytes, list[tuple[int, Indices | slice]]]]:
        """Return the pieces of each set of modes: its equations are built once."""
        groups: dict[bytes, list[tuple[int, Indices | slice]]] = {}
        for number, chosen in self.trajectory.whole(self.piece_of):
            key = self.trajectory.pieces[number].modes.tobytes()
            groups.setdefault(key, []).append((number, chosen))
        return groups.items()

    def _piecewise(self, q: Array) -> Array:
        """Return the values of the piecewise-linear functions, a line each."""
        functions = self.system.piecewise
        found = np.zeros((functions.count, self.t.size))
        if not functions.count:
            return found
        for regions, chosen in self._by_regions():
            at = functions.places(regions)
            found[:, chosen] = (
                functions.value_y[at] @ self.y[:, chosen] + functions.value_q[at] @ q[:, chosen]
            )
        return found

    def _by_regions(self) -> Iterable[tuple[Regions, Indices]]:
        """Return each set of regions, and which times it holds."""
        groups: dict[bytes, list[Indices]] = {}
        every = np.arange(self.t.size)
        for number, chosen in by_piece(self.piece_of):
            groups.setdefault(self.trajectory.pieces[number].regions.tobytes(), []).append(every[chosen])
        for key, places in groups.items():
            yield np.frombuffer(key, dtype=np.int16), np.concatenate(places)

    def _hold(self, q: Array, inner: Modes, forces: Array, pushed: Array) -> None:
        """Write the forces that hold rows: what is left of the forces on the bodies beside their accelerations."""
        for part, some, own in self.trajectory.by_part(self.piece_of):
            held = inner[:, some] == 0
            forces[:, some] = np.where(held, part.forces(own, self.t[some]), forces[:, some])
        system, sets = self.system, list(self.trajectory.by_held(self.piece_of))
        if not sets:
            return
        pushes = system.C @ self.y + system.Q @ q - system.GT @ forces
        if pushed.size:
            pushes += system.piecewise.acts @ pushed
        drives = system.drive_accelerations(q) if system.drives else None
        for held, chosen in sets:
            rows = np.frombuffer(held, dtype=bool).nonzero()[0]
            balance = self.trajectory.balance(held)
            own, led = pushes[:, chosen], None if drives is None else drives[:, chosen]
            rest = balance.held_forces(own, balance.accelerations(own, led), led)
            if isinstance(chosen, slice):
                forces[rows, chosen] = rest
            else:
                forces[rows[:, None], chosen] = rest

    def _levels(
        self, normals: Array, modes: Modes, slow: Indices, since: Array, rows: Indices | slice = slice(None)
    ) -> tuple[Array, Array]:
        """Return the breakaway levels of some rows: static coefficients less what their dwell has not yet raised.

        Those of the rows that `slow` numbers have a dwell, and since when each of them rests is given.
        """
        system = self.system
        mu_s = system.mu_s[:, rows]
        levels = mu_s[:, :, None] * normals
        if slow.size:
            static, least = mu_s[:, slow, None], system.least[:, rows][:, slow, None]
            lag = np.exp(-(self.t - since) / system.dwell[rows][slow, None])
            risen = static - (static - least) * lag
            levels[:, slow] = np.where(modes[slow] == 0, risen, least) * normals[slow]
        if system.has_stops:
            of, shown = system.is_stop, modes[system.is_stop]
            levels[0, of] = np.where(shown == Mode.FORWARD, np.inf, 0.0)
            levels[1, of] = np.where(shown == Mode.BACKWARD, np.inf, 0.0)
        # a tie holds any force, a one-way clutch any forward one, and a gap never breaks away
        levels[:, (system.is_tie | system.is_gap)[rows]] = levels[0, system.is_one_way[rows]] = np.inf
        return levels[0], levels[1]

    @cached_property
    def inputs(self) -> Array:
        """All inputs of the system, a line each."""
        if "tables" in self.__dict__:
            return self.tables.inputs
        return self.trajectory.inputs(self.piece_of, self.taus, self.y)

    @property
    def drive_velocities(self) -> Array:
        """Velocities of the drives in m/s or rad/s, a line each."""
        if "inputs" in self.__dict__ or "tables" in self.__dict__:
            return self.system.drive_velocities(self.inputs)
        return self.system.drive_velocities(self.trajectory.loads_at(self.piece_of, self.taus))

    @property
    def relative_velocities(self) -> Array:
        """Relative velocities of all rows in m/s or rad/s."""
        system = self.system
        w: Array = system.G @ self.y[: system.n]
        return w + system.D @ self.drive_velocities if system.drives else w

    @cached_property
    def _ways(self) -> Array:
        return positions.of_bodies(self.trajectory, self.piece_of, self.taus)

    @cached_property
    def _driven_ways(self) -> Array:
        return positions.of_drives(self.trajectory, self.t)

    def velocities(self) -> Array:
        """Return the velocities of all bodies and drives in m/s or rad/s, a line each."""
        own = self.y[: self.system.n]
        return np.concatenate([own, self.drive_velocities]) if self.system.drives else own

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what follows from the rest."""
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)


def _is_wide(trajectory: Trajectory, t: Array) -> bool:
    """Tell whether states are many, and each is known by itself."""
    return trajectory.system.size * t.size > _WIDE and trajectory.is_patchwork


def integrated(samples: Samples, lines: int, integrand: Callable[[Samples], Array]) -> Array:
    """Return time integrals from the start of the trajectory to the times of samples, by Gauss quadrature.

    Every step of the solver, every part of a period of the loads, and the times themselves bound an interval. Its
    nodes are enough for the polynomials within the steps.

    Parameters
    ----------
    samples : Samples
    lines : int
        How many quantities the integrand has.
    integrand : callable
        Returns them at the times of other samples, a line each.

    Raises
    ------
    ValueError
        If only the requested outputs were kept.
    """
    trajectory = samples.trajectory
    out, base = np.zeros((lines, samples.t.size)), np.zeros(lines)
    if not samples.t.size:
        return out
    held = dict(by_piece(samples.piece_of))
    last = max(held)
    block: list[int] = []
    edges: list[Array] = []
    total = 0
    for number in range(last + 1):
        wanted = samples.taus[held[number]] if number in held else np.empty(0)
        edges.append(_edges(trajectory, number, wanted))
        block.append(number)
        total += edges[-1].size * _MOST_NODES * max(samples.system.size + 6 * samples.system.m, 1)
        if total < _AT_ONCE and number < last:
            continue
        for own, edge, steps in zip(block, edges, _over(trajectory, block, edges, integrand), strict=True):
            sums = base[:, None] + np.cumsum(np.pad(steps, ((0, 0), (1, 0))), axis=1)
            if own in held:
                out[:, held[own]] = sums[:, np.searchsorted(edge, samples.taus[held[own]])]
            base = sums[:, -1]
        block, edges, total = [], [], 0
    return out


def _over(
    trajectory: Trajectory, block: list[int], edges: list[Array], integrand: Callable[[Samples], Array]
) -> list[Array]:
    """Return the integrals between the edges, for each piece of a block."""
    order = max(trajectory.order(number) for number in block)
    nodes, weights = gauss_nodes(min(order + 1, _MOST_NODES))
    middle = np.concatenate([0.5 * (edge[1:] + edge[:-1]) for edge in edges])
    half = np.concatenate([0.5 * (edge[1:] - edge[:-1]) for edge in edges])
    sizes = np.array([edge.size - 1 for edge in edges])
    piece_of = np.repeat(np.array(block, dtype=np.intp), sizes * nodes.size)
    at = Samples.at_local(trajectory, piece_of, (middle[:, None] + half[:, None] * nodes).ravel())
    values = integrand(at)
    steps = (values.reshape(values.shape[0], -1, nodes.size) @ weights) * half
    return np.split(steps, np.cumsum(sizes)[:-1], axis=1)


def _edges(trajectory: Trajectory, number: int, wanted: Array) -> Array:
    """Return the local times between which a piece is smooth: steps, wanted times, parts of a period."""
    ends = trajectory.steps(number)
    edges = np.union1d(ends, wanted)
    period, end = trajectory.loads.period, float(ends[-1])
    if np.isfinite(period) and end > 0:
        parts = int(np.ceil(_PER_PERIOD * end / period))
        edges = np.union1d(edges, np.linspace(0.0, end, parts + 1))
    return edges
