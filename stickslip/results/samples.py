"""A trajectory read at some times: every quantity by name.

Each quantity is computed for all names together when it is first asked for. Later another name only takes its line of
the same table. In patchworks of large scenes each name is computed by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.mode_equations import AT_HIGH, AT_LOW, FREE, velocity_dependent_in
from stickslip.equations.one_thread import one_thread
from stickslip.equations.path import gauss_nodes
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.model.elements import Sampled
from stickslip.model.laws.table import VelocityDependentForces
from stickslip.model.modes import Mode
from stickslip.model.scene import Scene
from stickslip.results import positions
from stickslip.results.pickled import PickledByFields
from stickslip.results.trajectory import Trajectory, at_rows, columns, grouped

T = TypeVar("T", bound=np.generic)
V = TypeVar("V")

# With more values of states at all times than this, patchworks are read name by name: that costs only what is read.
_WIDE = 2_000_000

_VALUES_AT_ONCE = 1_000_000
_PER_PERIOD = 8

# Gauss nodes per interval at most: exact for polynomials of degree 19, and to the last bit for products of two series.
_MOST_NODES = 10


@dataclass(frozen=True, eq=False)
class Samples(PickledByFields):
    """A trajectory at some times."""

    trajectory: Trajectory = field(repr=False)
    t: Array = field(repr=False)  # (k,): times in s
    # (k,): the piece that each time belongs to: at an event there is one before and one after
    piece_of: Indices = field(repr=False)
    taus: Array = field(repr=False)  # (k,): the times since the start of their pieces in s
    # (size, k): states at these times if they are stored; None if they are computed from the trajectory
    kept: Array | None = field(default=None, repr=False)
    # the rows whose quantities are read: all, or a single one of a large scene
    rows: slice = field(default_factory=lambda: slice(None), repr=False)

    @classmethod
    def at_local(cls, trajectory: Trajectory, piece_of: Indices, taus: Array) -> Samples:
        """Return a trajectory at local times in s of its pieces."""
        stops = trajectory.stops[piece_of]
        # at the end of a piece, start + tau is rounded: the stop is exact
        t = np.where(taus >= trajectory.ends[piece_of], stops, np.minimum(trajectory.starts[piece_of] + taus, stops))
        return cls(trajectory, t, piece_of, taus)

    @classmethod
    def at_times(cls, trajectory: Trajectory, times: Array) -> Samples:
        """Return a trajectory at times in s, right limits at events."""
        piece_of = trajectory.places(times)
        return cls(trajectory, times, piece_of, trajectory.local(piece_of, times))

    @property
    def system(self) -> System:
        """The compiled scene."""
        return self.trajectory.system

    @property
    def scene(self) -> Scene:
        """The simulated scene."""
        return self.system.scene

    @cached_property
    def is_wide(self) -> bool:
        """Whether there are so many values that each name is read by itself."""
        return self.trajectory.is_patchwork and self.system.size * self.t.size > _WIDE and self.kept is None

    @cached_property
    def y(self) -> Array:
        """States, a column for each time.

        Velocities of held bodies follow from the rows that hold them, so that equal velocities are equal to the bit.
        """
        if self.kept is not None:
            return self.kept
        with one_thread(self.system):
            found = self.trajectory.states(self.piece_of, self.taus)
            if self._held:
                drives = self.drive_velocities if self.system.drives else None
                self.trajectory.write_led(self._held, found[: self.system.n], drives)
        return found

    @cached_property
    def _held(self) -> list[tuple[Mask, Indices | slice]]:
        """The sets of held rows, each with the times at which its rows are held."""
        return list(self.trajectory.by_held(self.piece_of))

    # -- by name ------------------------------------------------------------------------------------------

    def body(self, name: str) -> int:
        """Return the number of a body, drive or the ground."""
        return _named(self.system.index, name, "body")

    def row(self, name: str) -> int:
        """Return the number of a contact or another row."""
        return _named(self.system.row_index, name, "contact")

    def velocity(self, body: str) -> Array:
        """Return the velocity of a body or drive, in m/s or rad/s."""
        return self._velocity(self.body(body))

    def _velocity(self, i: int) -> Array:
        n = self.system.n
        if i < n:
            return self._by_itself(i) if self.is_wide else _line(self._lines, i)
        return np.zeros_like(self.t) if i == n + self.system.drives else _line(self.drive_velocities, i - n)

    def _by_itself(self, body: int, integrated: bool = False) -> Array:
        """Return the velocity of one body, or its position (`integrated`) if that is a state."""
        return self.trajectory.of_body(self.piece_of, self.taus, body, integrated)

    def position(self, body: str) -> Array:
        """Return the position of a body or drive, in m or rad, integrated where no spring makes it a state.

        A ValueError says that the motion between the outputs was not kept, so that it cannot be integrated.
        """
        i, n = self.body(body), self.system.n
        state = self.system.position_state.get(i)
        if state is not None:
            return self._by_itself(i, True) if self.is_wide and i < n else _line(self._lines, state)
        if i == n + self.system.drives:
            return np.zeros_like(self.t)
        if not self.trajectory.is_dense and self.trajectory.pieces:
            raise ValueError(
                f"the position of {body!r} was not kept; simulate with dense_output=True, "
                "or let a spring touch the body"
            )
        if i >= n:
            return _line(self._drive_positions, i - n)
        if not self.is_wide:
            return _line(self._body_positions, i)
        start, own = self.scene.bodies[i].position, slice(i, i + 1)
        return np.asarray(start + positions.of_bodies(self.trajectory, self.piece_of, self.taus, own)[0])

    @cached_property
    def _lines(self) -> Array:
        """The states as a view that users cannot change."""
        return for_reading(self.y.view())

    def force(self, row: str) -> Array:
        """Return the force r of a row, in N or N m (``-c_i r`` acts on a body with the coefficient ``c_i``)."""
        return self._read("forces", row)

    def normal(self, row: str) -> Array:
        """Return the normal force of a row in N, zero where it is open."""
        return self._read("normals", row)

    def mode(self, row: str) -> Modes:
        """Return the mode of a row: -1, 0 or +1, or 2 where a gap or stop is open."""
        return self._read("modes", row)

    def forward_level(self, row: str) -> Array:
        """Return the breakaway level of a row forward, positive, in N or N m."""
        return self._read("forward_levels", row)

    def backward_level(self, row: str) -> Array:
        """Return the breakaway level of a row backward, positive, in N or N m."""
        return self._read("backward_levels", row)

    def breakaway(self, row: str) -> Array:
        """Return the breakaway level on the side to which a row slips or is pushed, in N or N m."""
        return self._read("breakaways", row)

    def relative_velocity(self, row: str) -> Array:
        """Return the relative velocity w of a row, in m/s or rad/s."""
        return self._sum(row, self._velocity) if self.is_wide else self._read("relative_velocities", row)

    def power(self, row: str) -> Array:
        """Return the power ``r w`` that a row dissipates, in W."""
        if self.is_wide:
            return self.force(row) * self.relative_velocity(row)
        return self._read("powers", row)

    def stretch(self, row: str) -> Array:
        """Return ``sum c_i x_i`` of a row, in m or rad: the integral of its relative velocity."""
        names = [*self.system.names, *(drive.name for drive in self.scene.drives)]
        return self._sum(row, lambda i: self.position(names[i]))

    def _sum(self, row: str, read: Callable[[int], Array]) -> Array:
        found = np.zeros_like(self.t)
        for i, c in self.system.rows[self.row(row)].coefficients.items():
            found = found + c * read(i)
        return found

    def _read(self, table: str, row: str) -> NDArray[Any]:
        """Return the line of a row in a table; where there are many values, only this line is computed."""
        j = self.row(row)
        if self.is_wide:
            return np.array(getattr(replace(self, rows=slice(j, j + 1)), table)[0])
        line: NDArray[Any] = getattr(self, table)[j]
        return line

    def states_of(self, block: str) -> Array:
        """Return the states of a block, a line each."""
        place = _named(self.system.blocks, block, "block")
        states = slice(place.first, place.first_held)
        return self._clocked(states) if isinstance(place.block, Sampled) else self.y[states]

    def _clocked(self, states: slice) -> Array:
        """Return states that change at samples only: those at the starts of pieces hold in all of the piece."""
        pieces = self.trajectory.pieces
        found = np.empty((states.stop - states.start, self.t.size))
        for number, chosen in grouped(self.piece_of):
            found[:, chosen] = pieces[number].y[states, None]
        return found

    def outputs_of(self, block: str) -> Array:
        """Return the outputs of a block, a line each."""
        place = _named(self.system.blocks, block, "block")
        if isinstance(place.block, Sampled):
            return self._clocked(slice(place.first_held, place.end))
        return self.system.outputs_of(place, self.t, self.y, self.inputs)

    # -- all names at once, when the first is asked for -------------------------------------------------------

    @cached_property
    def inputs(self) -> Array:
        """All inputs of the system, a line each."""
        if self.system.dependence is None:
            return self._loads
        return self.trajectory.inputs(self.piece_of, self.taus, self.y, self._loads)

    @cached_property
    def _loads(self) -> Array:
        """All inputs, without what depends on the state."""
        return self.trajectory.loads_at(self.piece_of, self.taus)

    @cached_property
    def drive_velocities(self) -> Array:
        """Velocities of the drives in m/s or rad/s, a line each."""
        if self.trajectory.is_patchwork:
            # only these lines: a large scene may have very many other inputs
            return for_reading(self.trajectory.drive_velocities(self.piece_of, self.taus))
        return for_reading(self.system.drive_velocities(self._loads))

    def velocities(self) -> Array:
        """Return the velocities of all bodies and drives in m/s or rad/s, a line each."""
        own = self.y[: self.system.n]
        return np.concatenate([own, self.drive_velocities]) if self.system.drives else own

    @cached_property
    def _body_positions(self) -> Array:
        starts = np.array([body.position for body in self.scene.bodies])
        distances = positions.of_bodies(self.trajectory, self.piece_of, self.taus)
        return for_reading(np.add(distances, starts[:, None], out=distances))

    @cached_property
    def _drive_positions(self) -> Array:
        starts = np.array([drive.position for drive in self.scene.drives])
        return for_reading(starts[:, None] + positions.of_drives(self.trajectory, self.t))

    @cached_property
    def relative_velocities(self) -> Array:
        """Relative velocities of all rows in m/s or rad/s."""
        system, y = self.system, self.y
        with one_thread(system):
            w: Array = system.G @ y[: system.n]
            if system.drives:
                w += system.D @ self.drive_velocities
        return for_reading(w)

    @cached_property
    def normals(self) -> Array:
        """Normal forces in N."""
        if not self.trajectory.is_patchwork:
            return for_reading(np.maximum(self.inputs[: self.system.m], 0.0))
        # in patchworks no load depends on the state, so other inputs are not needed
        rows = slice(*self.rows.indices(self.system.m))
        loads = self.trajectory.loads_at(self.piece_of, self.taus, rows)
        return for_reading(np.maximum(loads, 0.0, out=loads))

    @cached_property
    def _modes(self) -> tuple[Modes, Modes]:
        """Modes as the equations know them, and modes that the rows show."""
        inner, shown = self.trajectory.modes(self.piece_of, self.taus, self.rows)
        free = self.system.free[self.rows].nonzero()[0]
        if free.size:
            signs = self.system.sign_of(self.relative_velocities)
            shown[free] = np.where(inner[free] == FREE, signs[free], shown[free])
        return inner, for_reading(shown)

    @property
    def modes(self) -> Modes:
        """Modes that rows show."""
        return self._modes[1]

    @cached_property
    def forward_levels(self) -> Array:
        """Breakaway levels for forces above 0, in N or N m.

        Coefficients rise to the static ones over the dwell time. While a row slips, these are the levels with which it
        would begin to stick.
        """
        return self._levels(0)

    @cached_property
    def backward_levels(self) -> Array:
        """Breakaway levels for forces below 0, in N or N m: the table of `forward_levels` itself if no row differs."""
        return self._levels(1) if self.system.has_sides[self.rows].any() else self.forward_levels

    def _levels(self, side: int) -> Array:
        system, rows = self.system, self.rows
        levels = system.mu_s[side, rows, None] * self.normals
        is_slow = system.dwell[rows] > 0
        if is_slow.any():
            slow = slice(None) if is_slow.all() else is_slow.nonzero()[0]
            static, least, dwell = (x[rows, None][slow] for x in (system.mu_s[side], system.least[side], system.dwell))
            since = self.trajectory.since_when(self.piece_of, self.taus, rows)[slow]
            since -= self.t
            since /= dwell
            lag = np.exp(since, out=since)
            lag *= static - least
            risen = np.subtract(static, lag, out=lag)
            np.copyto(risen, least, where=self.modes[slow] != 0)
            levels[slow] = risen * self.normals[slow]
        if system.all_friction:
            return for_reading(levels)
        if system.has_stops:
            closed = self.modes[system.is_stop[rows]] == (Mode.BACKWARD if side else Mode.FORWARD)
            levels[system.is_stop[rows]] = np.where(closed, np.inf, 0.0)
        # a tie holds any force, a one-way clutch any forward one, and a gap never breaks away
        levels[(system.is_tie | system.is_gap)[rows]] = np.inf
        if side == 0:
            levels[system.is_one_way[rows]] = np.inf
        return for_reading(levels)

    @cached_property
    def breakaways(self) -> Array:
        """Breakaway levels on the side to which rows slip or are pushed, in N or N m."""
        forward, backward = self.forward_levels, self.backward_levels
        if backward is forward:
            return forward
        below = (self.modes < 0) | ((self.modes == 0) & (self.forces < 0))
        return for_reading(np.where(below, backward, forward))

    @cached_property
    def powers(self) -> Array:
        """Powers ``r w`` that rows dissipate, in W."""
        return for_reading(self.forces * self.relative_velocities)

    @cached_property
    def forces(self) -> Array:
        """Forces of rows in N or N m; those of held rows are computed once for each set of held rows."""
        system, trajectory, (inner, _) = self.system, self.trajectory, self._modes
        forces = trajectory.held_forces(self.piece_of, self.taus, self.rows)
        for mode, side in ((1, 0), (-1, 1)):
            sliding = mode * system.mu_c[side, self.rows, None]
            np.multiply(sliding, self.normals, out=forces, where=inner == mode)
        if system.piecewise.count:
            self._push_back(forces)
        self._act(forces)
        if not trajectory.is_patchwork:
            with one_thread(system):
                self._hold(forces)
        return for_reading(forces)

    def _act(self, forces: Array) -> None:
        """Write the forces of rows whose law depends on velocity, and of rows at rest that carry their level."""
        modes, _ = self._modes
        if modes.max(initial=0) >= AT_HIGH:
            for mode, side, sign in ((AT_HIGH, 0, 1.0), (AT_LOW, 1, -1.0)):
                rests, levels = modes == mode, self.backward_levels if side else self.forward_levels
                forces[rests] = sign * levels[rests]
        system = self.system
        if not system.has_velocity_laws:
            return
        at = velocity_dependent_in(modes, system)
        # rows that share a law are computed at once; laws go by their id, since some hold functions without a hash
        alike: dict[int, list[int]] = {}
        for j in np.flatnonzero(at.any(axis=1)).tolist():
            alike.setdefault(id(system.laws.laws[j]), []).append(j)
        for rows in alike.values():
            for mode in np.unique(modes[rows][at[rows]]).tolist():
                self._act_in(forces, rows, mode, at[rows] & (modes[rows] == mode))

    def _act_in(self, forces: Array, rows: list[int], mode: int, some: Mask) -> None:
        """Write the forces of rows with the same law at the times when they are in one mode: where `some` is true."""
        system = self.system
        law = system.laws.laws[rows[0]]
        w, normal = self.relative_velocities[rows][some], self.normals[rows][some]
        slips = abs(mode) == 1
        lag, z = np.zeros(w.size), np.empty((0, w.size))
        if law.core.dwell > 0 and not slips:
            since = self.trajectory.since_when(self.piece_of, self.taus)[rows]
            lag = np.exp((since - self.t)[some] / law.core.dwell)
        if law.character.stiffness is not None:
            z = self.y[[system.bristle_state[j] for j in rows]][some][None]
        kernels = VelocityDependentForces([law], np.array([mode if slips else 0], dtype=np.int8))
        place, time = some.nonzero()
        forces[np.array(rows)[place], time] = kernels.forces(w[None], normal[None], lag[None], z)[0]

    def _push_back(self, forces: Array) -> None:
        """Write the forces of gaps, which in each region are linear in the stretch and its rate."""
        functions = self.system.piecewise
        own = functions.among(self.rows)
        regions = self.trajectory.regions(self.piece_of, self.taus, self.rows)
        for k in functions.is_force[own].nonzero()[0].tolist():
            j = int(functions.row[own][k])
            name = self.system.rows[j].name
            stretch, rate, constant = functions.value[functions.first[own][k] + regions[k]].T
            found = stretch * self.stretch(name) + rate * self.relative_velocity(name) + constant
            forces[j - (self.rows.start or 0)] = found

    def _hold(self, forces: Array) -> None:
        """Write the forces of held rows, from the balance of other forces on the bodies and their accelerations."""
        system, q, sets = self.system, self.inputs, self._held
        if not sets:
            return
        pushes = system.C @ self.y + system.Q @ q - system.GT @ forces
        drives = system.drive_accelerations(q)
        is_even = not drives.any()
        for held, chosen in sets:
            rows, balance = held.nonzero()[0], system.balance(held)
            own, led = columns(pushes, chosen), None if is_even else columns(drives, chosen)
            # drives do not tear rows that hold
            rest = balance.held_forces(own, balance.accelerations(own, led))
            forces[at_rows(rows, chosen)] = rest


def _named(known: Mapping[str, V], name: str, what: str) -> V:
    """Return the entry with a name; if there is none, the error lists the known names."""
    try:
        return known[name]
    except (KeyError, TypeError):
        some = ", ".join(map(repr, list(known)[:10])) or "none"
        raise ValueError(f"no {what} is called {name!r}; known are {some}") from None


def _line(table: NDArray[T], i: int) -> NDArray[T]:
    line: NDArray[T] = table[i]
    return line


def for_reading(table: NDArray[T]) -> NDArray[T]:
    """Return a table, made read-only because its lines are handed out more than once."""
    table.flags.writeable = False
    return table


def integrated(samples: Samples, lines: int, integrand: Callable[[Samples], Array]) -> Array:
    """Return time integrals from the start of the trajectory to the times of samples, by Gauss quadrature.

    The solver's steps, parts of the periods of the loads, and the times themselves bound the intervals. Each interval
    has enough nodes for the polynomials of the steps.

    `integrand` returns a table of `lines` lines at the times of the samples that it is given.
    """
    trajectory, out = samples.trajectory, np.zeros((lines, samples.t.size))
    if not samples.t.size:
        return out
    wanted = dict(grouped(samples.piece_of))
    edges = [_edges(trajectory, k, samples.taus[wanted.get(k, slice(0))]) for k in range(max(wanted) + 1)]
    sizes = np.array([one.size for one in edges])
    number, taus = np.arange(sizes.size).repeat(sizes), np.concatenate(edges)
    # how many intervals lie before each of the samples: a piece has one less than edges
    before = (number + 1j * taus).searchsorted(samples.piece_of + 1j * samples.taus) - samples.piece_of
    begins = (number[1:] == number[:-1]).nonzero()[0]
    most = max(_VALUES_AT_ONCE // (_MOST_NODES * max(samples.system.size + 6 * samples.system.m, 1)), 1)
    base = np.zeros((lines, 1))
    with one_thread(samples.system):
        for first in range(0, begins.size, most):
            some = begins[first : first + most]
            order = max(trajectory.order(k) for k in np.unique(number[some]).tolist())
            nodes, weights = gauss_nodes(min(order + 1, _MOST_NODES))
            middle, half = 0.5 * (taus[some + 1] + taus[some]), 0.5 * (taus[some + 1] - taus[some])
            places = (middle[:, None] + half[:, None] * nodes).ravel()
            values = integrand(Samples.at_local(trajectory, number[some].repeat(nodes.size), places))
            steps = (values.reshape(lines, -1, nodes.size) @ weights) * half
            sums = base + np.concatenate([np.zeros((lines, 1)), steps], axis=1).cumsum(axis=1)
            within = ((before >= first) & (before <= first + some.size)).nonzero()[0]
            out[:, within] = sums[:, before[within] - first]
            base = sums[:, -1:]
    return out


def _edges(trajectory: Trajectory, number: int, wanted: Array) -> Array:
    """Return the local times between which a piece is smooth: steps, wanted times, parts of a period."""
    ends = trajectory.steps(number)
    return np.unique(np.concatenate([ends, wanted, trajectory.loads.periods(0.0, float(ends[-1]), _PER_PERIOD)]))
