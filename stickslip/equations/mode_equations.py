"""The equations of a scene in one set of modes, linear in states and inputs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import (
    MatrixBlock,
    Triplets,
    assembled,
    dense,
    row_maxima,
    scaled,
    stacked,
)
from stickslip.equations.balance import Balance, component_numbers
from stickslip.equations.equilibrium import Equilibrium
from stickslip.equations.guard_rows import GuardRows
from stickslip.equations.loads.loads import Segment, SineTurns, TableRegions
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import CouplingForces, System
from stickslip.equations.taylor import ORDER, TaylorMap, is_small
from stickslip.model.arrays import Array, Indices, Mask, Modes, like
from stickslip.model.laws.table import VelocityDependentForces

_ROUNDOFF_OF_SHARE = 1e-14  # coefficients of a share below this part of its largest are roundoff
_LOCKED = 1e-11  # a row cannot move if elimination leaves no more than this part of its coefficients
_MOST_MAPS = 50

# Sparse maps are put together if the force on one body changes at most so many accelerations on average.
_NEAR = 8

_IN_FLOATS = 48  # terms of the rates up to which plain floats are faster than arrays


# Besides -1, 0 and +1: a row without force; a law without modes; a row that others hold at rest while it carries its
# upper or lower level (MODEL rule 8); a row whose force is a piecewise-linear function, whatever its velocity.
OPEN, FREE, AT_HIGH, AT_LOW, APART = 2, 3, 4, 5, 6

_NO_REGIONS = np.empty(0, dtype=np.int16)


def equations_in(modes: Modes, system: System, regions: Regions = _NO_REGIONS) -> ModeEquations:
    """Return the equations of a system in one set of modes and regions; the system remembers the latest."""
    found: ModeEquations = system.remembered(_made, modes.tobytes() + regions.tobytes())
    return found


def where_nothing_sticks(system: System) -> Modes:
    """Return the modes in which contacts are open and stops and gaps apart; ties hold."""
    apart = system.is_stop | system.is_gap
    return np.select([system.is_tie, apart], [0, APART], OPEN).astype(np.int8)


def no_body_moves(G: Any, balance: Balance, levers: Array) -> Mask:
    """Tell which rows no body can move while the rows of a balance are held; drives may.

    `G` are their coefficients on bodies, and `levers` the largest ones that each row has.
    """
    return np.asarray(row_maxima(G @ balance.T) <= _LOCKED * levers)


def velocity_dependent_in(modes: Modes, system: System) -> Mask:
    """Tell which rows have a force that depends on their velocity; `modes` (m,) or (m, times)."""
    laws = system.laws
    slides, builds = like(laws.curved, modes), like(laws.has_slip_state, modes)
    return np.asarray((modes == FREE) | (slides & (np.abs(modes) == 1)) | (builds & (modes == 0)))


def _made(system: System, key: bytes) -> ModeEquations:
    modes = np.frombuffer(key[: system.m], dtype=np.int8)
    return ModeEquations(system, modes, np.frombuffer(key[system.m :], dtype=np.int16))


class ModeEquations:
    """The equations in one set of modes.

    With ``v = T v_ind + U u`` the rates are ``y' = A y + B q + K e`` and what is watched is ``z = E y + H q + L e``:
    the relative velocities of all rows, the forces of the held ones, the forces that rows at their level would carry
    without a level, and the borders of the regions of piecewise-linear functions. ``e`` are the friction forces that
    depend on velocity. `q` are the inputs of the system, followed by ``exp(-age / dwell) N`` of the rows with a dwell
    time.

    `modes` are for each row -1, 0, +1, OPEN, FREE, AT_HIGH, AT_LOW or APART; `regions` those of the piecewise-linear
    functions.

    Attributes
    ----------
    held, slip, pre, open, free, at_level : array of int
        Rows that are held, slip, are in pre-slip, carry no force, have no modes, or carry their level.
    sticks_at_zero : array of int
        Rows that slip and stick where they come to rest.
    pressed, velocity_dependent, elastic : array of int
        Rows whose normal force depends on the state, whose force depends on velocity, and gaps.
    bristle_places : array of int
        The states of the bristles that move.
    dependent : array of int
        Velocities that follow from others, by way of `T_dependent` and `U_dependent`.
    friction : array or sparse (m, inputs)
        Friction that is linear in the inputs.
    is_assembled : bool
        Whether the maps are put together as matrices; else they are applied step by step.
    is_small : bool
        Whether one matrix may give all Taylor coefficients of a linear motion.
    """

    def __init__(self, system: System, modes: Modes, regions: Regions, balance: Balance | None = None) -> None:
        self.system, self.modes, self.regions = system, modes, regions
        self._place_rows()
        self._place_laws()
        self.balance = system.balance(self.is_held) if balance is None else balance
        self.dependent = self.balance.dependent
        self.T_dependent, self.U_dependent = self.balance.T_dependent, self.balance.U_dependent
        self.is_driven = self.balance.is_driven
        self._place_regions()
        self._place_friction()
        self.shares = self._place_shares() if self.at_level.size else None
        self.watched_count = system.m + self.held.size + self.at_level.size + self.borders.size
        self.guards = GuardRows(self, self.open[:0], modes[:0])
        self._guard_rows: dict[bytes, GuardRows] = {}
        self._quantities = system.size + self.watched_count + self.guards.size
        self.is_small = is_small(system, self._quantities, 0)
        self._maps: dict[tuple[bool, TableRegions, SineTurns], TaylorMap] = {}
        # The map from inputs is put together only where a solver applies it many times, or a Taylor map needs it. Step
        # by step, equal and opposite forces cancel exactly.
        self._responds_at_once = not system.sparse and (self.velocity_dependent.size > 0 or self.is_small)
        acts = self.velocity_dependent.size > 0 or system.has_couplings
        self.is_assembled = not system.sparse or (acts and self.balance.changed_accelerations <= _NEAR * system.n)

    def for_drives_in(self, segment: Segment) -> ModeEquations:
        """Return the equations for the loads of a segment: those of drives that move `together` where they do.

        The forces that tear rows would be 0, but with a roundoff far above that of all others.
        """
        if self.balance.parting is None:
            return self
        rates, rough = self.system.accelerations_of_drives(segment)
        return self if self.balance.torn(rates, rough).any() else self.together

    @cached_property
    def together(self) -> ModeEquations:
        """The same equations without the forces that rows would need to hold drives together that move apart."""
        return ModeEquations(self.system, self.modes, self.regions, self.balance.together)

    # -- rows ------------------------------------------------------------------------------------------------

    def _place_rows(self) -> None:
        """Find what each row does in these modes."""
        system, modes = self.system, self.modes
        at_level, slips = (modes == AT_HIGH) | (modes == AT_LOW), np.abs(modes) == 1
        self.is_held = (modes == 0) & system.hard
        self.held, self.slip = self.is_held.nonzero()[0], slips.nonzero()[0]
        self.sticks_at_zero = (slips & system.hard).nonzero()[0]
        self.pre = ((modes == 0) & system.laws.has_slip_state).nonzero()[0]
        self.open, self.free = (modes == OPEN).nonzero()[0], (modes == FREE).nonzero()[0]
        self.at_level = at_level.nonzero()[0]
        self.pressed = (system.pressed & system.alive).nonzero()[0]
        self.resting_dwells = ((modes == 0) | at_level)[system.dwelling].nonzero()[0]
        self.resting_rows = system.dwelling[self.resting_dwells]
        self.resting_rates = 1.0 / system.dwell[self.resting_rows]
        # a row that carries its level pushes with it: a level that rises changes the motion
        self.rises_push = bool(system.dwelling.size and system.rise[:, self.at_level].any())

    def _place_laws(self) -> None:
        """Collect the laws whose forces depend on velocity."""
        system, modes = self.system, self.modes
        rows = self.velocity_dependent = velocity_dependent_in(modes, system).nonzero()[0]
        directions = np.where(np.abs(modes) == 1, modes, 0)[rows]
        self.law = VelocityDependentForces([system.laws.laws[j] for j in rows.tolist()], directions)
        self.bristle_places = np.array([system.bristle_state[j] for j in rows[self.law.bristles]], dtype=np.intp)
        self._alone: dict[int, VelocityDependentForces] = {}

    # -- piecewise-linear functions --------------------------------------------------------------------------

    def _place_regions(self) -> None:
        """Find the forces from states and inputs, with each function as in its region, and the regions' borders."""
        system, functions = self.system, self.system.piecewise
        self.C, self.Q = system.C, system.Q
        self.borders = self.elastic = np.empty(0, dtype=np.intp)
        if not functions.count:
            return
        at = functions.places(self.regions)
        self.elastic = functions.row[functions.is_force]
        elastic_at = at[functions.is_force]
        self._elastic_y, self._elastic_q = functions.value_y[elastic_at], functions.value_q[elastic_at]
        self.C = self.C + functions.acts @ functions.value_y[at]
        self.Q = self.Q + functions.acts @ functions.value_q[at]
        self.borders = functions.borders_of(self.regions)
        self._border_y = functions.border_y[self.borders]
        self._border_q = functions.border_q[self.borders]

    def elastic_forces(self, y: Array, q: Array) -> Array:
        """Return the forces of the gaps, which are the rows `elastic`."""
        if not self.elastic.size:
            return np.zeros((0, *y.shape[1:]))
        found: Array = self._elastic_y @ y + self._elastic_q @ q[: self.system.inputs]
        return found

    @cached_property
    def _gap_forces(self) -> CouplingForces | None:
        """The forces of the gaps one by one, None if there are no gaps."""
        system, rows = self.system, self.elastic
        if not rows.size:
            return None
        to_ground = np.array([len(system.rows[j].coefficients) == 1 for j in rows.tolist()])
        return CouplingForces(system.abs_GT[:, rows], self._elastic_y, self._elastic_q, to_ground)

    @cached_property
    def _abs_links(self) -> tuple[Any, Any]:
        system = self.system
        return (abs(self.C), abs(self.Q)) if system.piecewise.count else (system.abs_C, system.abs_Q)

    # -- friction that is linear in the inputs ---------------------------------------------------------------

    def _place_friction(self) -> None:
        """Enter the Coulomb friction of slipping rows, and the levels of rows that carry them, by input."""
        system, modes = self.system, self.modes
        side = (modes < 0).astype(np.intp)
        side[modes == AT_LOW] = 1
        self.side = side
        plain, top = self.slip[~system.laws.curved[self.slip]], self.at_level
        total = system.inputs_and_dwells
        entries = Triplets()
        entries.extend(plain, plain, modes[plain] * system.mu_c[side[plain], plain])
        if top.size:
            sign = np.where(modes[top] == AT_HIGH, 1.0, -1.0)
            entries.extend(top, top, sign * system.mu_s[side[top], top])
            rises = system.dwell_place[top] >= 0
            top, lag = top[rises], -sign[rises]
            entries.extend(top, system.inputs + system.dwell_place[top], lag * system.rise[side[top], top])
        self.friction = system.matrix(entries, (system.m, total))

    # -- guards ----------------------------------------------------------------------------------------------

    def guard_rows(self, labels: Modes) -> GuardRows:
        """Return the guards where rows show these labels: also the velocities of open rows that show a mode."""
        if not self.open.size:
            return self.guards
        signs = labels[self.open]
        if not np.count_nonzero(signs):
            return self.guards
        found = self._guard_rows.get(key := signs.tobytes())
        if found is None:
            shows = signs != 0
            found = self._guard_rows[key] = GuardRows(self, self.open[shows], signs[shows])
        return found

    def _place_shares(self) -> Any:
        """Return the map from ``F - M v'`` to the forces that rows at their level would carry without a level.

        With the scaled held rows g, ``share = g_row nu`` and ``(sum g^T g) nu = F - M v'`` (the dual of the bounded
        least norm).
        """
        system, scale, found = self.system, self.system.largest_lever, Triplets()
        rows = np.concatenate([self.held, self.at_level])
        number = component_numbers(system.G[rows])
        held_number, own_number = number[: self.held.size], number[self.held.size :]
        for one in np.unique(own_number).tolist():
            # only the held rows of the same component matter
            top, held = np.flatnonzero(own_number == one), self.held[held_number == one]
            both = dense(system.G[np.concatenate([held, self.at_level[top]])])
            bodies = np.flatnonzero(np.abs(both).any(axis=0))
            units, own = np.split(both[:, bodies], [held.size])
            units = units / scale[held][:, None]
            shares = own / scale[self.at_level[top]][:, None] ** 2 @ np.linalg.pinv(units.T @ units)
            shares[np.abs(shares) <= _ROUNDOFF_OF_SHARE * np.abs(shares).max(axis=1, keepdims=True)] = 0.0
            found.extend(np.repeat(top, bodies.size), np.tile(bodies, top.size), shares.ravel())
        return system.matrix(found, (self.at_level.size, system.n))

    def locked(self, rows: Any, ignore_drives: bool = False) -> Mask:
        """Tell which of some rows cannot move because held rows lock the same motion.

        With `ignore_drives`, rows that only drives can move are among them.
        """
        system, balance = self.system, self.balance
        G, D, levers = system.G[rows], system.D[rows], system.largest_lever[rows]
        if not self.held.size:
            return np.zeros(G.shape[0], dtype=bool)
        found = no_body_moves(G, balance, levers)
        if not ignore_drives:
            found &= row_maxima(system.independent(G @ balance.U + D)) <= _LOCKED * levers
        return found

    @cached_property
    def always_locked(self) -> Mask:
        """All rows that cannot move because held rows lock the same motion."""
        return self.locked(slice(None))

    # -- the maps --------------------------------------------------------------------------------------------

    @cached_property
    def _AE(self) -> Any:
        """The map from states to rates and watched quantities; this and `_KL` only if `is_assembled`."""
        return self._of_states(self._units(self.system.size))

    @cached_property
    def _BH(self) -> Any:
        """The map from inputs, of a small scene."""
        return self._of_inputs(np.eye(self.system.inputs_and_dwells))

    @cached_property
    def _KL(self) -> Any:
        """The map from the forces that depend on velocity."""
        return self._of_friction(self._units(self.system.m)[:, self.velocity_dependent])

    def _units(self, size: int) -> Any:
        return scipy.sparse.eye_array(size, format="csr") if self.system.sparse else np.eye(size)

    @cached_property
    def A(self) -> Any:
        """Rates from states."""
        return self._AE[: self.system.size]

    @cached_property
    def E(self) -> Any:
        """Watched quantities from states."""
        return self._AE[self.system.size :]

    @cached_property
    def H(self) -> Any:
        """Watched quantities from inputs."""
        return self._BH[self.system.size :]

    @cached_property
    def K(self) -> Any:
        """Rates from the forces that depend on velocity."""
        return self._KL[: self.system.size]

    @cached_property
    def L(self) -> Any:
        """Watched quantities from the forces that depend on velocity."""
        return self._KL[self.system.size :]

    @cached_property
    def feeds_back(self) -> bool:
        """Whether states change the rates of velocities or of blocks."""
        if self.system.sparse:
            return self.system.has_couplings
        return bool(self.A[: self.system.n].any() or self.A[self.system.first_block :].any())

    @cached_property
    def _with_guards(self) -> tuple[Array, Array]:
        """The maps to rates, watched quantities and guards, but for constants, from states and from inputs."""
        guards = self.guards
        return np.vstack([self._AE, guards.by_state]), np.vstack([self._BH, guards.by_input])

    def taylor(self, order: int, frozen: bool, table_regions: TableRegions, sine_turns: SineTurns) -> TaylorMap | None:
        """Return the map to Taylor coefficients up to `order` or a higher one, None where it would be large.

        If `frozen`, static coefficients keep their values.
        """
        key = frozen, table_regions, sine_turns
        found = self._maps.get(key)
        if found is None or found.order < order:
            system = self.system
            if not is_small(system, self._quantities, len(sine_turns[0])):
                return None
            of, link = system.dependence, None
            if of is not None:
                link = partial(of.add_linear, regions=table_regions)
            if not frozen and (self.feeds_back or of is not None):
                # the steps after the start need higher orders
                order = max(order, ORDER)
            found = TaylorMap(system, *self._with_guards, self.consistent, order, frozen, link, sine_turns)
            if len(self._maps) >= _MOST_MAPS:
                self._maps.pop(next(iter(self._maps)))
            self._maps[key] = found
        return found

    def apply(self, y: Array) -> Array:
        """Return ``A y`` and ``E y`` in one array, for one state or for columns of them."""
        found: Array = self._AE @ y if self.is_assembled else self._of_states(y)
        return found

    def watch(self, y: Array) -> Array:
        """Return ``E y`` for columns of states."""
        found: Array = self.E @ y if self.is_assembled else self._of_states(y)[self.system.size :]
        return found

    def respond(self, q: Array) -> Array:
        """Return ``B q`` and ``H q`` in one array."""
        found: Array = self._BH @ q if self._responds_at_once else self._of_inputs(q)
        return found

    def push(self, e: Array) -> Array:
        """Return ``K e`` and ``L e`` in one array."""
        if self.is_assembled:
            found: Array = self._KL @ e
            return found
        wide = np.zeros((self.system.m, *e.shape[1:]))
        wide[self.velocity_dependent] = e
        return np.asarray(self._of_friction(wide))

    @cached_property
    def watched_by_laws(self) -> Mask:
        """Which watched quantities the forces that depend on velocity may reach."""
        m, found = self.system.m, np.zeros(self.watched_count, dtype=bool)
        if self.velocity_dependent.size:
            found[m:] = row_maxima(self.L[m:]) > 0 if self.is_assembled else True
        return found

    @cached_property
    def is_watched_by_laws(self) -> bool:
        """Whether the forces that depend on velocity may reach anything that is watched."""
        return bool(self.watched_by_laws.any())

    def _of_states(self, y: Any) -> Any:
        system, n = self.system, self.system.n
        led = self.balance.T @ y[:n]
        moved = stacked(system.size, [(slice(n), led), (slice(n, system.size), y[n:])])
        borders = self._border_y @ moved if self.borders.size else None
        return self._out(self.C @ moved, led, None, None, system.block_C @ moved, borders)

    def _of_inputs(self, q: Any) -> Any:
        system, n = self.system, self.system.n
        u = system.drive_velocities(q)
        led = self.balance.U @ u
        moved = stacked(system.size, [(slice(n), led)])
        given = q[: system.inputs]
        forces = self.C @ moved + self.Q @ given - system.GT @ (self.friction @ q)
        blocks = system.block_C @ moved + system.block_Q @ given
        borders = self._border_y @ moved + self._border_q @ given if self.borders.size else None
        return self._out(forces, led, u, system.drive_accelerations(q), blocks, borders)

    def _of_friction(self, r: Any) -> Any:
        return self._out(-(self.system.GT @ r), None, None, None, None, None)

    def _out(self, forces: Any, v: Any, u: Any, rate: Any, blocks: Any, borders: Any) -> Any:
        """Return rates and watched quantities.

        They follow from forces on the bodies, velocities of bodies and drives, accelerations of drives, rates of blocks
        and values of borders: columns of these, one of each or a sparse matrix, None where there are none.
        """
        system, balance = self.system, self.balance
        n, size, m = system.n, system.size, system.m
        acceleration = balance.accelerations(forces, rate)
        parts: list[tuple[slice | Indices, Any]] = [(slice(n), acceleration)]
        if blocks is not None:
            parts.append((slice(system.first_block, size), blocks))
        if v is not None:
            w = system.G @ v
            parts.append((system.moved_state, v[system.moved]))
            if u is not None:
                parts.append((system.carried_state, u[system.carried]))
                w = w + system.D @ u if system.drives else w
            parts.append((slice(size, size + m), w))
        first = size + m + self.held.size
        if self.held.size:
            parts.append((slice(size + m, first), balance.held_forces(forces, acceleration, rate)))
        if self.shares is not None:
            own = self.shares @ (forces - like(system.inertia, forces) * acceleration)
            parts.append((slice(first, first + self.at_level.size), own))
        if borders is not None:
            parts.append((slice(size + self.watched_count - self.borders.size, size + self.watched_count), borders))
        return stacked(size + self.watched_count, parts)

    def consistent(self, y: Array, u: Array) -> Array:
        """Write the dependent velocities of a state (or rows of its columns) through T, in place."""
        return self._write_led(y, u, self.T_dependent, self.U_dependent)

    def write_led_majorants(self, y: Array, u: Array) -> Array:
        """Write majorants of the dependent velocities into the absolute values of a state, in place."""
        return self._write_led(y, u, *self._abs_led)

    def _write_led(self, y: Array, u: Array, T: Any, U: Any) -> Array:
        if self.dependent.size:
            led = T @ y[: self.system.n]
            y[self.dependent] = led + U @ u if self.is_driven else led
        return y

    @cached_property
    def _abs_led(self) -> tuple[Any, Any]:
        return abs(self.T_dependent), abs(self.U_dependent)

    def mobility(self, row: int) -> float:
        """Return the relative acceleration of a row by a force of 1 N or N m along it."""
        pull = dense(self.system.G[[row]])[0]
        return float(pull @ self.balance.accelerations(pull))

    def friction_of(self, row: int, w: float, normal: float, rested: float, deflection: Sequence[float]) -> float:
        """Return the friction force of one row, 0 where it is held; `rested` is its age in s if it rests."""
        system, mode = self.system, int(self.modes[row])
        if row not in self.velocity_dependent:
            side = int(mode < 0)
            return mode * float(system.mu_c[side, row]) * normal if abs(mode) == 1 else 0.0
        law = self._alone.get(row)
        if law is None:
            sign = self.modes[[row]] if abs(mode) == 1 else np.zeros(1, dtype=np.int8)
            law = self._alone[row] = VelocityDependentForces([system.laws.laws[row]], sign)
        dwell = float(system.dwell[row])
        lag = math.exp(-rested / dwell) if dwell > 0 else 0.0
        one = np.array
        return float(law.forces(one([w]), one([normal]), one([lag]), one(deflection, dtype=float))[0])

    def law_jacobian(self, slopes: Array) -> Any:
        """Return what the velocity-dependent rows add to ``d y' / d y``: ``K diag(dr/dw) W``."""
        system, n = self.system, self.system.n
        if self.is_assembled:
            return self.K @ scaled(slopes, self._led_velocities)
        rows = (system.G @ self.balance.T).tocsr()[self.velocity_dependent]
        pushed = scipy.sparse.csr_array(system.GT)[:, self.velocity_dependent]
        forces = -(pushed @ scaled(slopes, rows))
        return assembled(system.size, [(slice(n), slice(n), self.balance.accelerations(forces))])

    @cached_property
    def bristle_maps(self) -> tuple[Any, Any]:
        """The map from forces of rows with bristles to rates, and that from states to their relative velocities."""
        rows, system = self.law.bristles, self.system
        units = np.zeros((self.velocity_dependent.size, rows.size))
        units[rows, np.arange(rows.size)] = 1.0
        pushed = self.push(units)[: system.size]
        return scipy.sparse.csr_array(pushed) if system.sparse else pushed, self._led_velocities[rows]

    @cached_property
    def jacobian_pattern(self) -> Any:
        """A matrix whose entries are those of ``d y' / d y`` that may differ from 0, but for bristles."""
        if not self.velocity_dependent.size:
            return self.jacobian()
        return self.jacobian() + self.law_jacobian(np.ones(self.velocity_dependent.size))

    def jacobian(self) -> Any:
        """Return ``A``, dense or sparse as the scene is."""
        if self.is_assembled:
            return self.A
        system, T, n, size = self.system, self.balance.T, self.system.n, self.system.size
        fold = scipy.sparse.block_diag([T, scipy.sparse.eye_array(size - n)], format="csr")
        blocks: list[MatrixBlock] = [
            (slice(n), slice(size), self.balance.accelerations((self.C @ fold).tocsr())),
            (system.moved_state, slice(n), T[system.moved]),
            (slice(system.first_block, size), slice(size), system.block_C @ fold),
        ]
        return assembled(size, blocks)

    # -- majorants -------------------------------------------------------------------------------------------

    def accelerations_by_forces(self, y: Array, q: Array) -> Array:
        """Return what all forces would accelerate the bodies by if none of them cancelled, (n,).

        It is 0 where other forces than those of springs, dampers and gaps depend on the state.
        """
        system = self.system
        if system.has_pushes_by_state or self.velocity_dependent.size:
            return np.zeros(system.n)
        q = q[: system.inputs]
        pressed = system.abs_GT @ (system.largest_coefficient * np.abs(q[: system.m]))
        forces = system.coupling_forces.sizes(y, q) + system.abs_push_Q @ np.abs(q) + pressed
        if self._gap_forces is not None:
            forces += self._gap_forces.sizes(y, q)
        return self.balance.majorants(forces, np.abs(system.drive_accelerations(q)))[0]

    @cached_property
    def _equilibrium(self) -> Equilibrium:
        """The equilibrium of the bodies, of scenes with dense matrices."""
        system, n = self.system, self.system.n
        by_place = np.zeros((n, n))
        by_place[:, system.moved] = self.C[:, system.moved_state]
        of_independent = np.delete(self.balance.T, self.dependent, axis=1)
        return Equilibrium(system.inertia, of_independent, by_place, self.C[:, :n])

    def to_equilibrium(self, rest: Array, q: Array, speeds: Array, accelerations: Array) -> bool:
        """Move a state with bodies at rest to the equilibrium, in place, if only roundoff of the places is between.

        The motion has other `speeds` (n,); the bodies at rest would have these `accelerations` (n,).
        """
        system = self.system
        abs_C, abs_Q = self._abs_links
        terms = abs_C @ np.abs(rest) + abs_Q @ np.abs(q[: system.inputs])
        distance = self._equilibrium.distance(terms, speeds, accelerations)
        if distance is None:
            return False
        rest[system.moved_state] += distance[system.moved]
        return True

    def majorants(self, y: Array, q: Array) -> tuple[Array, Array]:
        """Return majorants of the rates and of the watched quantities, from those of states and inputs.

        A majorant is the sum of the absolute values of all terms. The roundoff of a quantity is a part of its majorant.
        """
        system, balance = self.system, self.balance
        n, size, m = system.n, system.size, system.m
        largest = like(system.largest_coefficient, q)
        abs_C, abs_Q = self._abs_links
        forces = abs_C @ y + abs_Q @ q[: system.inputs] + system.abs_GT @ (largest * q[:m])
        found = np.zeros((size + self.watched_count, *q.shape[1:]))
        rate, z = found[:size], found[size:]
        rate[:n], z[m : m + self.held.size] = balance.majorants(forces, system.drive_accelerations(q))
        rate[system.moved_state] = y[system.moved]
        rate[system.carried_state] = system.drive_velocities(q)[system.carried]
        if size > system.first_block:
            blocks = abs(system.block_C) @ y + abs(system.block_Q) @ q[: system.inputs]
            rate[system.first_block :] = blocks
        z[:m] = system.abs_G @ y[:n]
        if system.drives:
            z[:m] += system.abs_D @ system.drive_velocities(q)
        if self.shares is not None:
            first = m + self.held.size
            sizes = forces + like(system.inertia, q) * rate[:n]
            z[first : first + self.at_level.size] = abs(self.shares) @ sizes
        if self.borders.size:
            z[-self.borders.size :] = self.border_majorants(y, q)
        return rate, z

    @cached_property
    def laws_in_floats(self) -> list[Callable[..., Any]] | None:
        """The forces that depend on velocity in plain floats, None where arrays are the better way.

        They are functions of relative velocity and normal force, and of their bristle where there is one.
        """
        if self.system.sparse:
            return None
        terms = np.count_nonzero(self.A) + np.count_nonzero(self.K)
        return self.law.in_floats() if terms <= _IN_FLOATS else None

    def force_in_floats(self, row: int) -> Callable[[float, float], float]:
        """Return the friction force of a row as a function of its relative velocity and normal force, in plain floats.

        It is for equations that have laws in floats, and rows without bristles.
        """
        if row in self.velocity_dependent:
            assert self.laws_in_floats is not None
            return self.laws_in_floats[int(self.velocity_dependent.searchsorted(row))]
        mode = int(self.modes[row])
        level = mode * float(self.system.mu_c[int(mode < 0), row]) if abs(mode) == 1 else 0.0
        return lambda w, normal: level * max(normal, 0.0)

    @cached_property
    def _led_velocities(self) -> Any:
        """The map from states to relative velocities of the velocity-dependent rows, by way of T."""
        return self._from_states(self.system.G @ self.balance.T)

    @cached_property
    def law_velocities(self) -> Any:
        """The map from states to relative velocities of the velocity-dependent rows, without drives."""
        return self._from_states(self.system.G)

    def _from_states(self, from_velocities: Any) -> Any:
        """Return a map from velocities, its velocity-dependent rows only, as a map from all states."""
        some, size = self.velocity_dependent, self.system.size
        return stacked(size, [(slice(self.system.n), from_velocities[some].T)]).T

    def border_majorants(self, y: Array, q: Array) -> Array:
        """Return majorants of the borders, from those of states and inputs."""
        by_state, by_input = self._abs_borders
        return np.asarray(by_state @ y + by_input @ q[: self.system.inputs])

    @cached_property
    def _abs_borders(self) -> tuple[Any, Any]:
        """The maps of `border_majorants`."""
        functions = self.system.piecewise
        return functions.abs_border_y[self.borders], functions.abs_border_q[self.borders]
