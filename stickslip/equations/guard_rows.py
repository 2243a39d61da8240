"""Which guards there are in one set of modes, and of what they are made."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any, Protocol

import numpy as np

from stickslip.equations.algebra.matrices import scaled
from stickslip.equations.loads.loads import SineTurns
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.equations.taylor import is_quickly_made
from stickslip.model.arrays import Array, Indices, Mask, Modes, like


class InModes(Protocol):
    """The equations in one set of modes, as far as guards need them: what rows do, maps, and majorants."""

    system: System
    modes: Modes
    regions: Regions
    side: Indices
    slip: Indices
    held: Indices
    pre: Indices
    open: Indices
    at_level: Indices
    pressed: Indices
    borders: Indices
    is_assembled: bool

    @property
    def E(self) -> Any:
        """The map from states to what is watched."""

    @property
    def H(self) -> Any:
        """The map from inputs to what is watched, of a small scene."""

    def watch(self, y: Array) -> Array:
        """Return what is watched of columns of states."""

    def respond(self, q: Array) -> Array:
        """Return rates, and what is watched, of inputs."""

    def majorants(self, y: Array, q: Array) -> tuple[Array, Array]:
        """Return majorants of the rates and of the watched quantities."""


class GuardRows:
    """Each guard is ``sign z[source] + mu q[row] - rise q[dwell] + constant``.

    First the slipping rows, then the upper and the lower levels of held rows and of rows in pre-slip, then the rows
    that carry their level, then the borders of regions, which belong to no row (-1), then the normal forces that depend
    on the state: N while closed, -N while open. Last come the velocities of open rows that show a mode.

    `loose` are the open rows that show a mode, and `signs` these modes. The levels of `rising` guards rise with a
    dwell: they lack `rise` times the input `dwell`. A held row whose guard comes to 0 is pushed in the `direction` of
    that guard, which is 0 for others.
    """

    def __init__(self, equations: InModes, loose: Indices, signs: Modes) -> None:
        # the equations keep these rows: with a cycle of references only the garbage collector could free both
        self._equations: InModes = weakref.proxy(equations)
        self.loose = loose.size
        system, modes, borders = equations.system, equations.modes, equations.borders
        held, pre, top, slip = equations.held, equations.pre, equations.at_level, equations.slip
        pressed, first = equations.pressed, system.m + held.size
        place = np.empty(system.m, dtype=np.intp)
        place[held], place[top] = system.m + np.arange(held.size), first + np.arange(top.size)
        edges = first + top.size + np.arange(borders.size)
        # the force of a stop is at most 0 at its lower limit, and at least 0 at its upper one
        at_lower = np.zeros(system.m, dtype=bool)
        if system.has_stops:
            functions = system.piecewise
            at_lower[functions.row[functions.is_stop & (equations.regions == 2)]] = True
        upper = held[(system.is_friction | at_lower)[held]]
        lower = held[~(system.is_tie | at_lower)[held]]
        # the lower level of one-way clutches and stops is 0
        holds, mu_s, rises = system.is_friction, system.mu_s, system.rise
        band, side = system.laws.slips_beyond, equations.side
        # the rows of each kind of guard, and their row, source, sign, mu, rise, constant, direction, kind
        kinds: list[tuple[Indices, Callable[[Indices], tuple[Any, ...]]]] = [
            (slip, lambda j: (j, j, modes[j], 0, 0, 0, 0, 0)),
            (upper, lambda j: (j, place[j], -1, mu_s[0, j], rises[0, j], 0, 1, 1)),
            (lower, lambda j: (j, place[j], 1, holds[j] * mu_s[1, j], holds[j] * rises[1, j], 0, -1, 1)),
            (pre, lambda j: (j, j, -1, 0, 0, band[j], 1, 0)),
            (pre, lambda j: (j, j, 1, 0, 0, band[j], -1, 0)),
            (top, lambda j: (j, place[j], 1 - 2 * side[j], -mu_s[side[j], j], -rises[side[j], j], 0, 0, 1)),
            (edges, lambda edge: (-1, edge, 1, 0, 0, 0, 0, 2)),
            (pressed, lambda j: (j, 0, 0, np.where(np.isin(j, equations.open), -1, 1), 0, 0, 0, 3)),
            (loose, lambda j: (j, j, signs, 0, 0, 0, 0, 0)),
        ]
        parts = [columns_of(rows) for rows, columns_of in kinds if rows.size]
        ends = list(accumulate((rows.size for rows, _ in kinds if rows.size), initial=0))

        def column(k: int, dtype: type = float) -> Any:
            found: Any = np.empty(ends[-1], dtype)
            for part, (first, last) in zip(parts, pairwise(ends), strict=True):
                found[first:last] = part[k]
            return found

        self.row: Indices = column(0, np.intp)
        self.source: Indices = column(1, np.intp)
        self.sign, self.mu, rise, self.constant, self.direction = map(column, range(2, 7))
        kind = column(7)
        self.is_velocity, self.is_force, self.is_border, self.is_normal = (kind == k for k in range(4))
        self.reads_forces = bool(self.is_force.any() or borders.size)
        """Whether a guard depends on more than velocities and normal forces."""
        self.without_level = (self.is_force & (self.mu == 0)).nonzero()[0]
        """Forces that have no level, only a sign to keep: of one-way clutches and stops."""
        # a normal force is a force, too
        self.is_force |= self.is_normal
        self.size, self.slips = self.row.size, slip.size
        self.rising = (rise != 0).nonzero()[0]
        self.rise = rise[self.rising]
        self.dwell = system.inputs + system.dwell_place[self.row[self.rising]]
        self.threshold = -system.laws.rests_below[slip]
        self.has_threshold = bool(self.threshold.any())
        self.has_levels, self.has_constant = bool(self.mu.any()), bool(self.constant.any())
        self.has_forces, self.has_borders = bool(self.is_force.any()), bool(borders.size)
        self.may_stick = np.zeros(self.size, dtype=bool)
        self.may_stick[: slip.size] = system.holds_more[side[slip], slip]
        """Velocities of contacts that hold more at rest than in motion."""
        self.has_normals = bool(pressed.size)
        self._majorant_maps: dict[tuple[int, SineTurns], Array | None] = {}

    @cached_property
    def is_dwelling(self) -> Mask:
        """Guards of rows whose level rises with the dwell."""
        return np.isin(self.row, self._equations.system.dwelling)

    @cached_property
    def velocities(self) -> Indices:
        """The guards that are velocities."""
        return np.asarray(self.is_velocity.nonzero()[0])

    @cached_property
    def without_size(self) -> Indices:
        """The guards that compare with 0, or with a limit that may be 0: forces without a level, and borders."""
        return np.append(self.without_level, self.is_border.nonzero()[0])

    @property
    def forces(self) -> slice:
        """The range of the guards that are no velocities; only for scenes without pre-slip velocities."""
        return slice(self.slips, self.size - self.loose)

    @cached_property
    def kinds(self) -> tuple[Indices, list[str]]:
        """Where each kind of quantity begins among states and guards side by side, and its name."""
        system, own = self._equations.system, self.forces
        states = [system.n, system.first_block, system.size]
        ends = [*states, *(system.size + k for k in (own.start, own.stop, self.size))]
        named = zip([0, *ends], ends, ["state", "state", "state", "velocity", "force", "velocity"], strict=False)
        some = [(first, kind) for first, last, kind in named if last > first]
        return np.array([first for first, _ in some]), [kind for _, kind in some]

    @cached_property
    def by_state(self) -> Any:
        """The guards from the states."""
        return scaled(self.sign, self._equations.E[self.source])

    @cached_property
    def by_input(self) -> Array:
        """The guards, but for constants, from the inputs of a small scene."""
        found: Array = self.sign[:, None] * self._equations.H[self.source]
        found[np.arange(self.size), self.row] += self.mu
        found[self.rising, self.dwell] -= self.rise
        return found

    def of_states(self, y: Array) -> Array:
        """Return what columns of states add to the guards."""
        if self._equations.is_assembled:
            return np.asarray(self.by_state @ y)
        return np.asarray(self.sign[:, None] * self._equations.watch(y)[self.source])

    def of_inputs(self, q: Array) -> Array:
        """Return what columns of inputs add to the guards, but for constants."""
        if not self._equations.system.sparse:
            return self.by_input @ q
        z = self._equations.respond(q)[self._equations.system.size :]
        found = self.sign[:, None] * z[self.source] + self.mu[:, None] * q[self.row]
        found[self.rising] -= self.rise[:, None] * q[self.dwell]
        return np.asarray(found)

    def majorant_map(self, order: int, sine_turns: SineTurns) -> Array | None:
        """Return the map to majorants of the Taylor coefficients of the guards, order by order; None if it is large.

        It acts on majorants of states, inputs, their slopes, dwells and their slopes, and on the amplitudes of sines
        (`Inputs.extended_majorants`).
        """
        key = order, sine_turns
        if key not in self._majorant_maps:
            equations, entries = self._equations, np.array(sine_turns[0], dtype=np.intp)
            system, turns = equations.system, np.abs(np.array(sine_turns[1]))
            parts = [system.size, *2 * [system.inputs], *2 * [system.dwelling.size], entries.size]
            columns, found = sum(parts), None
            # to make it takes a product for each order
            if is_quickly_made(system, columns, order * self.size * (order + 1)):
                y, q, slope, dwell, dwell_slope, sines = np.split(np.eye(columns), np.cumsum(parts)[:-1])
                fall, maps = 1.0 / system.dwell[system.dwelling, None], []
                for k in range(order + 1):
                    given = np.concatenate([q, dwell])
                    np.add.at(given, entries, sines)
                    rate, z = equations.majorants(y, given)
                    maps.append(self.majorants(z, given))
                    y, q, slope = rate / (k + 1), slope / (k + 1), np.zeros_like(slope)
                    dwell, dwell_slope = (fall * dwell + dwell_slope) / (k + 1), fall * dwell_slope / (k + 1)
                    sines = turns[:, None] * sines / (k + 1)
                found = np.concatenate(maps)
            self._majorant_maps[key] = found
        return self._majorant_maps[key]

    def majorants(self, z: Array, q: Array) -> Array:
        """Return majorants of the guards, from those of watched quantities and inputs (or columns of them)."""
        sign, mu, rise = (like(np.abs(x), z) for x in (self.sign, self.mu, self.rise))
        found = sign * z[self.source] + mu * q[self.row]
        if self.rising.size:
            found[self.rising] += rise * q[self.dwell]
        return np.asarray(found)
