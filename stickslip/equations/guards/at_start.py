"""Which guards are violated at the start of a motion, and how guards that are 0 there leave 0."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from stickslip.equations.guards.values import GuardValues
from stickslip.equations.mode_equations import OPEN
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.model.slopes import SLOPES_STEP

# The uncertainty of a quantity, as a part of its majorant: the sum of the sizes of its terms.
ROUNDOFF = 1e-12

AT_LIMIT = 1e-10  # part of its level within which a force is at its level
_AS_FIRED = 1e-6  # the same for a row that an event has just found at its limit
VALUE_ROUNDOFF = 2e-15  # part of its majorant by which a value that is 0 may be beyond 0
FINEST_ROUNDOFF = 1e-15  # part of its majorant within which a stop is at its limit, and a slope may be 0
_NEAR = 1e-5  # guards this near to 0, as a part of the largest force, are looked at more closely
_NEAR_IN_TIME = 1e-12  # so are guards that come to 0 within this part of the time
_SOON = 1e-6  # part of a motion after which a guard is compared with its slope
_AT_ONCE = 1e-9  # a normal force that passes 0 within this part of a motion does so at once
_HARDLY = 1e-3  # part of the least normal force that a solver feels below which a contact is hardly pressed
_UNFELT = 1e-6  # part of the least force that a solver feels within which a force counts as 0
TIME = 1e-15  # the uncertainty of the time, as a part of it

# The uncertainty of second and higher Taylor coefficients, as a part of their majorants, in motions that are not
# linear: there these coefficients are differences.
DIFFERENCED = 1e-6

NEVER, _DOWN = np.iinfo(np.intp).max, -1
HIGHEST = 8  # order up to which coefficients are computed where lower ones are 0
_ORDERS = np.arange(1.0, HIGHEST + 2)[:, None]
_NO_ROWS = np.empty(0, dtype=np.intp)


class GuardsAtStart(GuardValues):
    """The guards of a motion and what they are at its start, ready when constructed.

    `fired` are rows that an event has just found at their limit. The velocity of a row has to be beyond 0 by its
    `velocity_uncertainty`, the errors of a solver, before that is an event; None where velocities are exact.

    Attributes
    ----------
    violated : array of bool
        Guards that are negative at the start or just after it, except those of normal forces.
    misjudged : array of int
        Rows that are closed though their normal force is negative, or open though it is positive.
    order : array of int
        0 where a guard is positive at the start, k where it starts as tau^k, NEVER where it stays 0.
    is_plain : bool
        Whether no guard is 0 at the start: all orders are 0.
    armed : int
        How many guards may end the motion: not those that stay 0, nor those of open rows.
    lets_go : array of bool
        Velocities of rows that an event lets go, though their orders 1 and 2 do not show that they leave 0.
    """

    def __init__(
        self,
        motion: Motion,
        labels: Modes,
        at_rest: Mask,
        fired: Mask,
        velocity_uncertainty: Array | None = None,
    ) -> None:
        super().__init__(motion, labels, at_rest)
        self.velocity_uncertainty = velocity_uncertainty
        self.violated = np.zeros(self.size, dtype=bool)
        self.order = np.zeros(self.size, dtype=np.intp)
        self.lets_go = np.zeros(self.size, dtype=bool)
        self.is_plain = True
        if self.size:
            self._classify(fired)
        self.misjudged = _NO_ROWS
        if self.rows.has_normals:
            self.misjudged = self.row[self.violated & self.is_normal]
            self.violated &= ~self.is_normal
        self.armed = self.size - self.rows.loose
        if not self.is_plain:
            self.armed -= int(np.count_nonzero(self.order == NEVER))

    @cached_property
    def uncertain(self) -> Array:
        """How far the velocity of each guard's row has to be beyond 0 before that is an event."""
        if self.velocity_uncertainty is None:
            return np.zeros(self.size)
        return np.asarray(self.velocity_uncertainty[self.row] + self._roughness[0])

    # -- the start -----------------------------------------------------------------------------------------

    def _classify(self, fired: Mask) -> None:
        g0, rows = self.first[0], self.rows
        # guards that are small beside the largest force, or come to 0 within roundoff of the time, need a closer look
        near: Array | float = 0.0
        soon = _NEAR_IN_TIME * (abs(self.motion.t) + self.motion.horizon)
        if rows.has_forces:
            largest = max((rows.is_force * self.force_scale).tolist())
            of_forces = rows.is_force * (soon * np.abs(self.first[1]) + _NEAR * largest)
            if rows.without_level.size:
                # where loads and springs cancel, even the largest force may be their roundoff
                of_forces[rows.without_level] += ROUNDOFF * self.majorant[0, rows.without_level]
            near = of_forces
        if self._has_constant:
            near = near + _NEAR * self._constant
        if rows.has_borders:
            size = self.motion.equations.border_majorants(self.motion.state_majorants, np.abs(self.motion.start_inputs))
            near = near + np.zeros(self.size)
            near[self.is_border] = _NEAR * size + soon * np.abs(self.first[1, self.is_border])
        # where loads cancel, a guard that an event has found at 0 may be their roundoff: more than it seems to compare
        close = ~(g0 > near) | self.rests | (rows.is_force & fired[self.row])
        some = close.nonzero()[0]
        if some.size:
            self._look_closer(some.tolist(), fired)

    def _look_closer(self, close: list[int], fired: Mask) -> None:
        """Find which of the guards near 0 are 0, and how these leave 0."""
        motion = self.motion
        for i in close:
            passes_0 = self.is_velocity[i] and not self._constant[i]
            has_fired, of_stop = self._at_limit(i, fired)
            if passes_0:
                found = self._roundoff_of_velocity(i, has_fired) if self.rests[i] else None
            else:
                found = self._roundoff_of_level(i, has_fired, of_stop)
            if found is None:
                self.violated[i] = self.first[0, i] < (-self.uncertain[i] if passes_0 else 0.0)
                continue
            limits, flat = found
            if not motion.is_linear:
                limits[1] += DIFFERENCED * self._majorant_from_rates[2, i]
            order = self._way_out(i, limits, flat)
            if order == _DOWN:
                self.violated[i] = True
            else:
                self.order[i], self.is_plain = order, False
                moves = self.is_velocity[i] and not motion.is_linear and not self._never[i]
                self.lets_go[i] = has_fired and moves and order == NEVER

    def _at_limit(self, i: int, fired: Mask) -> tuple[bool, bool]:
        """Tell whether the row of a guard has been found at its limit, and whether the guard bounds a stop."""
        if not self.is_border[i]:
            # that a row has come to its limit says nothing about its normal force
            return bool(fired[self.row[i]] and not self.is_normal[i]), False
        functions = self.motion.system.piecewise
        owner = functions.owner[self.motion.equations.borders[np.count_nonzero(self.is_border[:i])]]
        of_stop, row = bool(functions.is_stop[owner]), functions.row[owner]
        # a stop that was closed counts as found at its limit, too, wherever a solver or roundoff has left it
        return of_stop and bool(fired[row] or self.at_rest[row]), of_stop

    def _roundoff_of_velocity(self, i: int, has_fired: bool) -> tuple[list[float], float]:
        """Return bounds below which orders 1 and 2 of a velocity that is 0 are roundoff, and a flatness of 0."""
        motion, majorant = self.motion, self.majorant
        rough = [ROUNDOFF * float(majorant[k, i]) + float(self._roughness[k, i]) for k in (1, 2)]
        if (speed := float(self._roughness[0, i])) and self._is_torn_if_held(int(self.row[i])):
            # where a velocity touches 0, its slope may turn before it has changed the velocity by its roundoff
            rough[0] += 2 * math.sqrt(speed * abs(float(self.start[2, i])))
        if motion.equations.modes[self.row[i]] == OPEN:
            # no force can hold an open row: nothing but roundoff is uncertain
            return rough, 0.0
        # where a load is a function, its slopes have the roundoff of the time, too
        near = self._majorant_at_exact_time if motion.segment.is_straight or motion.is_linear else majorant
        majorant_1, second = float(near[1, i]), AT_LIMIT * float(near[2, i]) + rough[1]
        most = AT_LIMIT * majorant_1 + rough[0]
        if not has_fired and abs(self.first[1, i]) > most:
            # it moves, whatever its level gives
            return [most, second], 0.0
        given = self._given_at_level(i)
        found_at = _AS_FIRED * given if has_fired else 0.0
        # A row whose force is beyond its level is not held. Then its acceleration must count as motion, even if it is
        # small: otherwise neither mode is allowed.
        first = max(AT_LIMIT * (min(majorant_1, given) or majorant_1), found_at) + rough[0]
        return [first, second], 0.0

    def _is_torn_if_held(self, row: int) -> bool:
        """Tell whether drives would tear rows if a row were held, too: then no level decides whether it is."""
        equations = self.motion.equations
        return equations.balance.parting is not None or self.motion.system.is_torn_with(equations.is_held, row)

    def _roundoff_of_level(self, i: int, has_fired: bool, of_stop: bool) -> tuple[list[float], float] | None:
        """Return bounds below which orders 1 and 2 of a guard at its level are roundoff, and its flatness.

        A guard that is within its flatness of 0 up to the horizon stays 0. None where the guard is not at its level.
        """
        coefficients, majorant = self.first, self.majorant
        rough = ROUNDOFF * majorant[0, i] + self._roughness[0, i]
        tolerance = (_AS_FIRED if has_fired else AT_LIMIT) * self.scale[i] + rough
        if of_stop and coefficients[0, i] <= 0:
            # a stop cannot pass its limit: where it is beyond, that is an error of the solver or roundoff
            tolerance = np.inf
        elif of_stop and not has_fired:
            # a stop in flight counts as open down to roundoff: at its limit it rebounds
            tolerance = FINEST_ROUNDOFF * majorant[0, i]
        tolerance, rough = tolerance + self.unfelt[i], rough + self.unfelt[i]
        if not abs(coefficients[0, i]) <= tolerance:
            return None
        limits = [ROUNDOFF * majorant[k, i] for k in (1, 2)]
        if of_stop and coefficients[1, i] > limits[0]:
            # A stop that has rebounded leaves its limit, however soon the motion ends. But the points of a solver show
            # no distance below roundoff.
            return limits, 0.0 if self.velocity_uncertainty is None else rough
        return limits, AT_LIMIT * self.scale[i] + rough

    def _way_out(self, i: int, limits: list[float], flat: float) -> int:
        """Return the order with which a guard leaves 0: the first one that brings it beyond `flat` by the horizon.

        _DOWN where the guard becomes negative, NEVER where it stays 0.
        """
        if self._never[i]:
            return NEVER
        horizon = self.motion.horizon
        for k, limit in enumerate(limits, start=1):
            value = (self.first if k == 1 else self.start)[k, i]
            if abs(value) <= limit:
                continue
            change = abs(value) * horizon**k
            if k == 1 and change < self.felt[i] and (self._misleads(i) or not self.is_normal[i]):
                return NEVER
            if change > flat:
                return k if value > 0 else _DOWN
        if not self.motion.is_linear:
            return NEVER
        # higher orders, which only springs and oscillating loads have
        coefficients, at_exact_time, majorant = self._higher
        for k in range(3, HIGHEST + 1):
            value = coefficients[k, i]
            limit = 10 * (AT_LIMIT * at_exact_time[k, i] + ROUNDOFF * majorant[k, i])
            if abs(value) > limit and abs(value) * horizon**k > flat:
                return k if value > 0 else _DOWN
        return NEVER

    def _misleads(self, i: int) -> bool:
        """Tell whether a guard does not follow its slope: then this is but the error of a difference."""
        motion, tau = self.motion, _SOON * self.motion.horizon
        try:
            change = float(self.raw_at(tau, motion.soon(tau))[i]) - self.first[0, i]
        except (ArithmeticError, ValueError):
            # a function that fails there fails again if the motion comes there
            return True
        expected = tau * self.first[1, i]
        return not abs(change - expected) <= 0.5 * abs(expected)

    def _given_at_level(self, i: int) -> float:
        """Return the acceleration of a row by its level and a force as large, which its guard compares while held.

        For a row without a level it is the majorant of its acceleration.
        """
        system, row = self.motion.system, self.row[i]
        if not system.is_friction[row]:
            return float(self._majorant_at_exact_time[1, i])
        level = system.mu_s[:, row].max() * self.motion.start_inputs[row]
        return float(2 * level * self.motion.equations.mobility(row))

    @cached_property
    def felt(self) -> Array:
        """The least normal forces that a solver feels where they depend on the state, and levels as small; else 0.

        Up to the horizon such a force changes a velocity by the errors of the solver. A normal force that is a function
        of the state may leave 0 more slowly than any power that is looked at, or be 0 but for its own roundoff.
        """
        found = np.zeros(self.size)
        if self.motion.is_linear or self.velocity_uncertainty is None or not self.rows.has_normals:
            return found
        system, rows = self.motion.system, self.row[self.is_normal]
        forces = self.velocity_uncertainty[rows] / (system.free_mobility[rows] * self.motion.horizon)
        # coefficients below 1 may grow with the velocity
        normals = forces / np.maximum(system.largest_coefficient[rows], 1.0)
        found[self.is_normal] = normals
        # the levels of a contact that is hardly pressed are as small
        of_row = np.zeros(system.m)
        of_row[rows] = np.where(np.abs(self.first[0, self.is_normal]) <= _HARDLY * normals, forces, 0.0)
        levels = self.rows.is_force & ~self.is_normal
        found[levels] = of_row[self.row[levels]]
        return found

    @cached_property
    def unfelt(self) -> Array:
        """Forces that count as 0, see `felt`; 0 where all forces count."""
        return _UNFELT * self.felt

    @cached_property
    def _never(self) -> Mask:
        """Guards of rows that cannot move because held rows lock the same motion."""
        found: Mask = self.rests.copy()
        equations, some = self.motion.equations, self.row[self.rests]
        # in a large scene this is computed only for the few rows that are needed
        found[found] = equations.locked(some) if equations.system.sparse else equations.always_locked[some]
        return found

    def soon_right(self, rows: Indices) -> bool:
        """Tell whether rows are misjudged at the start only: their normal forces at once pass 0 to the right side."""
        value, rate = self.first[:2, self.is_normal & np.isin(self.row, rows)]
        return bool(((rate > 0) & (-value <= _AT_ONCE * rate * self.motion.horizon)).all())

    def right_now(self, rows: Indices) -> bool:
        """Tell whether the normal forces of rows have the right sign at the start, whatever they do just after it."""
        return bool((self.first[0, self.is_normal & np.isin(self.row, rows)] >= 0).all())

    @property
    def stays_zero(self) -> Indices:
        """Rows in a mode of motion whose relative velocity is 0 at the start and stays 0."""
        rows = ((self.order == NEVER) & self.is_velocity).nonzero()[0]
        modes = self.motion.equations.modes
        found = self.row[rows]
        return np.asarray(found[np.abs(modes[found]) == 1])

    # -- what is roundoff ----------------------------------------------------------------------------------

    @cached_property
    def _higher(self) -> tuple[Array, Array, Array]:
        motion = self.motion
        at_exact_time = motion.guard_majorants(self.rows, HIGHEST + 1)
        return self.series(motion.expand(0.0, motion.y, HIGHEST)), at_exact_time, self._with_time(at_exact_time)

    @cached_property
    def majorant(self) -> Array:
        """Majorants of the Taylor coefficients of the guards, orders 0 to 2: their roundoff is a part of these."""
        found = self._with_time(self._majorant_at_exact_time, self._majorant_without_new_dwells)
        if np.count_nonzero(found > 2 * self._majorant_at_exact_time[:-1]):
            found = np.minimum(found, self._with_time(self._majorant_at_exact_time, self._majorant_from_rates))
        return found

    @cached_property
    def _roughness(self) -> Array:
        """How uncertain orders 0 to 2 of the guards are beside roundoff: accelerations of drives may be differences."""
        if self.motion.roughness is None:
            return np.zeros((3, self.size))
        found = [self.rows.majorants(z, q) for q, z in self.motion.roughness]
        return np.array([*found, found[1] / SLOPES_STEP])

    @cached_property
    def _majorant_from_rates(self) -> Array:
        """The same up to order 3, from rates in which forces have cancelled.

        Otherwise two forces that cancel beside a stiff damper would count in all higher orders, more in each.
        """
        majorants = self.motion.majorants(3, from_rates=True)
        return np.array([self.rows.majorants(z, q) for q, z in majorants])

    @cached_property
    def _majorant_at_exact_time(self) -> Array:
        """The same up to order 3, as if the time were exact."""
        return self.motion.guard_majorants(self.rows, 3)

    @property
    def _majorant_without_new_dwells(self) -> Array:
        """The same up to order 3, without dwells that begin now: their age is exact."""
        motion = self.motion
        return motion.guard_majorants(self.rows, 3, True) if motion.begins_to_rise else self._majorant_at_exact_time

    def _with_time(self, majorants: Array, changes: Array | None = None) -> Array:
        return with_time(majorants, majorants if changes is None else changes, self.motion.t)

    @cached_property
    def scale(self) -> Array:
        """For each guard the size of what it compares at the start: level and force, or velocities."""
        by_majorant = self.is_velocity | self.is_border
        return np.where(by_majorant, self.majorant[0] + np.abs(self._constant), self.force_scale)

    @cached_property
    def value_scale(self) -> Array:
        """The size of what guards of forces and borders compare at the start; without meaning for velocities."""
        if not self.rows.has_borders:
            return self.force_scale
        return np.where(self.is_border, self.majorant[0], self.force_scale)

    @property
    def step_scale(self) -> Array:
        """For guards that are no velocities the size of what they compare at the start, or their majorant if more."""
        own = self.rows.forces
        return np.maximum(self.value_scale[own], self.majorant[0, own])

    @cached_property
    def force_scale(self) -> Array:
        """The size of what guards of forces compare at the start, force and level; without meaning for others."""
        force = self.rows.sign * self.motion.first.z[0][self.rows.source]
        size = np.abs(force) + np.abs(self.first[0] - force)
        return np.asarray(np.where(self.is_normal, self.majorant[0], size) if self.rows.has_normals else size)


def with_time(majorants: Array, changes: Array, t: float) -> Array:
    """Return majorants of Taylor coefficients, an order per row, with the roundoff of the time added.

    `majorants` hold for an exact time. An error of the time changes each order by the next order of `changes`; so the
    highest order is left out.
    """
    late = TIME / ROUNDOFF * abs(t) * _ORDERS[: majorants.shape[0] - 1]
    return np.asarray(majorants[:-1] + late * changes[1:])
