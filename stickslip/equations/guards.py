"""Guards: what has to stay positive while the modes hold, and what is violated at the start.

``s w`` of a moving row, ``high - lambda`` and ``lambda - low`` of a held one, N of a closed contact whose normal force
depends on the state, and ``-N`` of an open one. A guard that is 0 at the start has its
zero divided out: what is left is positive there and has all the later roots.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.floats import Line, evaluate, forces, lines
from stickslip.equations.matrices import dense
from stickslip.equations.mode_equations import OPEN
from stickslip.equations.motion import Expansion, Motion
from stickslip.equations.path import Path

__all__ = ["AT_LIMIT", "NEVER", "ROUNDOFF", "Guards"]

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]

ROUNDOFF = 1e-12
"""Part of what adds up in a quantity that is uncertain."""

AT_LIMIT = 1e-10
"""Part of its level within which a force is at it."""

_AS_FIRED = 1e-6
"""The same for a row that an event has just found there."""

_NEAR = 1e-5
"""A held row this near to its level, as a part of it, deserves a closer look."""

_NEAR_IN_TIME = 1e-12
_TIME = 1e-15
"""Part of the time that is uncertain."""

_IF_DWELLING = 1e-2
"""Part of what is uncertain by which a velocity passes 0 where the level rises with the dwell."""

_DIFFERENCED = 1e-6
NEVER, _DOWN = np.iinfo(np.intp).max, -1
_TINY = np.finfo(float).tiny
_HIGHEST = 8
_FALSE = np.zeros(1, dtype=bool)


class Guards:
    """The guards of a motion, ready when constructed.

    Parameters
    ----------
    motion : Motion
    labels : array (m,)
        Signs of the relative velocities of rows that carry no force: these are watched, too.
    at_rest : array (m,) of bool
        Rows whose relative velocity is 0 at the start.
    fired : array (m,) of bool
        Rows that an event has just found at their limit.
    uncertain : float
        Velocity in m/s or rad/s by which a row has to pass 0 before that is an event: the errors of a solver, 0 where
        an engine makes none.

    Attributes
    ----------
    row : array of int
        The row of each guard, -1 where it is the border of a region.
    is_border : array of bool
        Guards that are borders of regions.
    violated : array of bool
        Guards that are negative at the start or just after it, but for those of normal forces.
    misjudged : array of int
        Rows that are closed though their normal force is negative, or open though it is positive.
    order : array of int
        0 where a guard is positive at the start, k where it starts as tau^k, NEVER where it stays 0.
    """

    def __init__(
        self,
        motion: Motion,
        labels: NDArray[np.int8],
        at_rest: Mask,
        fired: Mask,
        uncertain: float = 0.0,
    ) -> None:
        # guards of no row have the number -1
        self.motion, self.at_rest, self.uncertain = motion, np.concatenate([at_rest, _FALSE]), uncertain
        equations = motion.equations
        loose = equations.open
        if loose.size:
            loose = loose[labels[loose] != 0]
        self._row, self._turn = equations.guard_row, equations.guard_turn
        self._source, self._mu = equations.guard_source, equations.guard_mu
        self._constant, self._has_constant = equations.guard_constant, equations.has_constant
        self._has_levels = equations.has_levels
        self.is_velocity, self.direction = equations.is_velocity, equations.direction
        self.is_border = equations.is_border
        self._rising, self._rise = equations.rising, equations.rise_of_rising
        self._dwell = equations.dwell_of_rising
        self._is_force, self.is_normal = equations.is_force, equations.is_normal
        if equations.has_threshold:
            self._constant = self._constant.copy()
            slips = equations.slips
            self._constant[:slips] = np.where(self.at_rest[equations.slip], 0.0, equations.threshold)
            self._has_constant = bool(self._constant.any())
        if loose.size:
            none, no = np.zeros(loose.size), np.zeros(loose.size, dtype=bool)
            self._row, self._source = (np.concatenate([x, loose]) for x in (self._row, self._source))
            self._turn = np.concatenate([self._turn, labels[loose]])
            self._mu, self._constant, self.direction = (
                np.concatenate([x, none]) for x in (self._mu, self._constant, self.direction)
            )
            self.is_velocity = np.concatenate([self.is_velocity, ~no])
            self.is_border, self._is_force, self.is_normal = (
                np.concatenate([x, no]) for x in (self.is_border, self._is_force, self.is_normal)
            )
        pressed = equations.pressed
        # functions of the state act on forces; of the others only normal forces may read them
        self._wanted: Any = () if equations.only_velocities else None
        if pressed.size:
            self._watch_normals(pressed)
        self._beside = self._row.size - equations.guard_row.size
        self.row, self._loose = self._row, loose.size
        self.size = self._row.size
        self.violated = np.zeros(self.size, dtype=bool)
        self.order = np.zeros(self.size, dtype=np.intp)
        if self.size:
            self._classify(fired)
        if pressed.size:
            self.misjudged = self.row[self.violated & self.is_normal]
            self.violated &= ~self.is_normal
        else:
            self.misjudged = pressed
        self.is_plain = not self.order.any()
        self.armed = self.size - self._loose
        if not self.is_plain:
            self.armed -= np.count_nonzero(self.order == NEVER)

    def _watch_normals(self, pressed: Indices) -> None:
        """Add the guards of normal forces that depend on the state: N while closed, -N while open."""
        motion, equations = self.motion, self.motion.equations
        none = np.zeros(pressed.size)
        self._row = np.append(self._row, pressed)
        self._source = np.append(self._source, none.astype(np.intp))
        self._turn, self._constant, self.direction = (
            np.append(x, none) for x in (self._turn, self._constant, self.direction)
        )
        self.is_border = np.append(self.is_border, none > 0)
        self._mu = np.append(self._mu, np.where(equations.modes[pressed] == OPEN, -1.0, 1.0))
        self.is_velocity = np.append(self.is_velocity, none > 0)
        self.is_normal, self._is_force = (np.append(x, none == 0) for x in (self.is_normal, self._is_force))
        self._has_levels = True
        if self._wanted is not None:
            self._wanted = motion.for_normals

    # -- values ----------------------------------------------------------------------------------------------

    def raw(self, z: Array, q: Array) -> Array:
        """Return the guards as they are, one column per time where `z` and `q` have columns."""
        many = z.ndim == 2
        if not many:
            g = self._turn * z[self._source]
            if self._has_levels:
                g += self._mu * q[self._row]
            if self._has_constant:
                g += self._constant
            if self._rising.size:
                g[self._rising] -= self._rise * q[self._dwell]
            return g
        g = self._turn[:, None] * z[self._source] + self._mu[:, None] * q[self._row]
        g += self._constant[:, None]
        if self._rising.size:
            g[self._rising] -= self._rise[:, None] * q[self._dwell]
        return g

    def series(self, expansion: Expansion) -> Array:
        """Return the Taylor coefficients of the guards as they are, one row per order."""
        if expansion.g is not None:
            g = expansion.g
            if self._beside:
                own = slice(-self._beside, None)
                beside = expansion.z[:, self._source[own]] * self._turn[own]
                if self._mu[own].any():
                    # normal forces that depend on the state: every order of the inputs is there
                    beside += self._mu[own] * np.array(expansion.q)[:, self._row[own]]
                g = np.concatenate([g, beside], axis=1)
            if self._has_constant:
                g = np.concatenate([g[:1] + self._constant, g[1:]])
            return g
        g = expansion.z[:, self._source]
        g *= self._turn
        for k, q in enumerate(expansion.q):
            if q is None:
                continue
            if self._has_levels:
                g[k] += self._mu * q[self._row]
            if self._rising.size:
                g[k, self._rising] -= self._rise * q[self._dwell]
        if self._has_constant:
            g[0] += self._constant
        return g

    def levels(self, q: Array) -> Array:
        """Return the limits of the guards' forces: breakaway levels, 0 for velocities."""
        level = self._mu * q[self._row]
        if self._rising.size:
            level[self._rising] -= self._rise * q[self._dwell]
        return np.abs(level)

    @cached_property
    def start(self) -> Array:
        """Taylor coefficients of the guards at the start, orders 0 to 2."""
        return self.series(self.motion.start)

    # -- the start -------------------------------------------------------------------------------------------

    def _classify(self, fired: Mask) -> None:
        g0 = self.start[0]
        # whatever is small beside the largest force about, or soon will be gone, deserves a closer look
        near: Array | float = 0.0
        held = self._is_force
        soon = _NEAR_IN_TIME * (abs(self.motion.t) + self.motion.horizon)
        if held.any():
            near = held * (soon * np.abs(self.start[1]) + _NEAR * self.force_scale[held].max())
        if self._has_constant:
            near = near + _NEAR * self._constant
        if self.motion.equations.borders.size:
            size = self.motion.equations.border_magnitudes(
                np.abs(self.motion.y), np.abs(self.motion.start_inputs)
            )
            near = near + np.zeros(self.size)
            near[self.is_border] = _NEAR * size + soon * np.abs(self.start[1, self.is_border])
        close = ~(g0 > near)
        if self.at_rest.any():
            close |= self.is_velocity & self.at_rest[self.row]
        rows = close.nonzero()[0]
        if rows.size:
            self._look_closer(rows, fired)

    def _look_closer(self, rows: Indices, fired: Mask) -> None:
        coefficients, majorant, adds_up = self.start, self.majorant, self._adds_up
        size, has_fired = self.scale, np.append(fired, False)
        functions, of_stop = self.motion.system.piecewise, np.zeros(self.size, dtype=bool)
        of_stop[self.is_border] = functions.is_stop[functions.owner[self.motion.equations.borders]]
        for i in rows.tolist():
            flat = 0.0
            closeness = _AS_FIRED if has_fired[self.row[i]] else AT_LIMIT
            rough = ROUNDOFF * majorant[0, i]
            if self.is_velocity[i] and not self._constant[i]:
                if not self.at_rest[self.row[i]]:
                    self.violated[i] = coefficients[0, i] < -self.uncertain
                    continue
                if self.motion.equations.modes[self.row[i]] == OPEN:
                    # nothing but roundoff is uncertain where no force can hold it
                    limits = [ROUNDOFF * majorant[k, i] for k in (1, 2)]
                else:
                    # where a load is a function, its slopes are as uncertain as the time
                    near = adds_up if self.motion.stretch.is_straight or self.motion.is_linear else majorant
                    found_at = _AS_FIRED * self._given_by_level(i) if has_fired[self.row[i]] else 0.0
                    limits = [
                        max(AT_LIMIT * near[1, i], found_at) + ROUNDOFF * majorant[1, i],
                        AT_LIMIT * near[2, i] + ROUNDOFF * majorant[2, i],
                    ]
            else:
                at_stop = bool(of_stop[i]) and coefficients[0, i] <= 0
                # a stop cannot pass its limit: what is beyond it is what the solver or roundoff left
                if not (at_stop or abs(coefficients[0, i]) <= closeness * size[i] + rough):
                    self.violated[i] = coefficients[0, i] < 0
                    continue
                flat = AT_LIMIT * size[i] + rough
                limits = [ROUNDOFF * majorant[k, i] for k in (1, 2)]
            if not self.motion.is_linear:
                differenced = _DIFFERENCED * majorant[2, i]
                limits[1] += differenced
            order = self._way_out(i, limits, flat)
            self.order[i] = 0 if order == _DOWN else order
            self.violated[i] = order == _DOWN

    def _way_out(self, i: int, limits: list[float], flat: float) -> int:
        """Return the order with which a guard leaves 0: the first one that brings it beyond `flat` by the horizon."""
        if self._never[i]:
            return NEVER
        horizon = self.motion.horizon
        for k, limit in enumerate(limits, start=1):
            value = self.start[k, i]
            if abs(value) > limit and abs(value) * horizon**k > flat:
                return k if value > 0 else _DOWN
        if not self.motion.is_linear:
            return NEVER
        # higher orders, which only springs and oscillating loads have
        coefficients, adds_up, majorant = self._higher
        for k in range(3, _HIGHEST + 1):
            value = coefficients[k, i]
            limit = 10 * (AT_LIMIT * adds_up[k, i] + ROUNDOFF * majorant[k, i])
            if abs(value) > limit and abs(value) * horizon**k > flat:
                return k if value > 0 else _DOWN
        return NEVER

    def _given_by_level(self, i: int) -> float:
        """Return the acceleration that the level of a moving row gives it, all that adds up in it where it has none."""
        system, row = self.motion.system, self.row[i]
        if not system.is_friction[row]:
            return float(self._adds_up[1, i])
        pull = dense(system.G[[row]])[0]
        level = system.mu_s[:, row].max() * self.motion.start_inputs[row]
        return float(level * (pull @ self.motion.equations.balance.accelerations(pull)))

    @cached_property
    def _never(self) -> Mask:
        """Guards of rows that cannot move because held rows lock the same motion."""
        never = np.asarray(self.is_velocity & self.at_rest[self.row])
        rows = never.nonzero()[0]
        never[rows] = self.motion.equations.locked(self.row[rows])
        return never

    @cached_property
    def _higher(self) -> tuple[Array, Array, Array]:
        expansion, adds_up = self.motion.expand(0.0, self.motion.y, _HIGHEST), self._sizes(_HIGHEST)
        return self.series(expansion), adds_up, self._with_time(adds_up)

    @cached_property
    def majorant(self) -> Array:
        """What adds up in the Taylor coefficients of the guards, orders 0 to 2: their roundoff is a part of it."""
        return self._with_time(self._adds_up)

    @cached_property
    def value_majorant(self) -> Array:
        """The same of the guards themselves."""
        return np.asarray(self._with_time(self._sizes(0))[0])

    @cached_property
    def _adds_up(self) -> Array:
        """What adds up in the Taylor coefficients of the guards, orders 0 to 3, at exactly this time."""
        return self._sizes(2)

    def _sizes(self, order: int) -> Array:
        """Return what adds up in the Taylor coefficients of the guards, up to one order more."""
        found = None if self._beside else self.motion.guard_magnitudes(order + 1)
        if found is None:
            found = np.zeros((order + 2, self.size))
            for k, (q, z) in enumerate(self.motion.magnitudes(order + 1)):
                found[k] = np.abs(self._turn) * z[self._source] + np.abs(self._mu) * q[self._row]
                if self._rising.size:
                    found[k, self._rising] += np.abs(self._rise) * q[self._dwell]
        return np.asarray(found)

    def _with_time(self, sizes: Array) -> Array:
        """Return what adds up with the roundoff of the time: it is one of all that changes."""
        late = _TIME / ROUNDOFF * abs(self.motion.t)
        orders = np.arange(1.0, sizes.shape[0])[:, None]
        return np.asarray(sizes[:-1] + late * orders * sizes[1:])

    @cached_property
    def scale(self) -> Array:
        """For each guard the size of what it compares at the start: level and force, or velocities."""
        adds_up = self.is_velocity | self.is_border
        return np.where(adds_up, self.value_majorant + np.abs(self._constant), self.force_scale)

    @cached_property
    def value_scale(self) -> Array:
        """The same for guards of forces and borders; without meaning for velocities."""
        if not self.is_border.any():
            return self.force_scale
        return np.where(self.is_border, self.value_majorant, self.force_scale)

    @cached_property
    def force_scale(self) -> Array:
        """The same for guards of forces; without meaning for others."""
        size = self.levels(self.motion.start_inputs) + np.abs(
            self._turn * self.motion.start.z[0][self._source]
        )
        return np.where(self.is_normal, self.value_majorant, size) if self.is_normal.any() else size

    def sizes(self, tau: float, y: Array, largest: Array) -> Array:
        """Return for each guard the size of what it compares from the start up to a state.

        Where a motion starts from rest, or contacts only begin to be pressed, that is 0 at the start.

        Parameters
        ----------
        tau : float
            Local time in s.
        y : array (size,)
            State there.
        largest : array (size,)
            Bounds of the sizes of the states since the start.
        """
        motion, system = self.motion, self.motion.system
        q = motion.inputs(tau, y)
        speeds = system.abs_G @ largest[: system.n]
        if system.drives:
            speeds = speeds + system.abs_D @ np.abs(system.drive_velocities(q))
        forces = self.levels(q) + np.abs(self._turn * motion.watched(tau, y, q)[self._source])
        # guards of no row have the number -1
        now = np.where(self.is_velocity, np.append(speeds, 0.0)[self.row], forces)
        now[self.is_border] = 0.0
        return np.asarray(np.maximum(np.maximum(self.scale, self.value_majorant), now))

    @cached_property
    def allowance(self) -> Array:
        """By how much sines can lower each guard, where they move nothing."""
        motion, system = self.motion, self.motion.system
        found = np.zeros(self.size)
        amplitudes = motion.stretch.amplitudes
        for i in amplitudes.nonzero()[0].tolist():
            q = np.zeros(system.inputs + system.dwelling.size)
            q[i] = amplitudes[i]
            z = motion.equations.respond(q)[system.size :]
            found += np.abs(self._turn * z[self._source]) + np.abs(self._mu) * q[self._row]
        return found

    def is_followed_frozen(self, i: int) -> bool:
        """Tell whether a guard is the same without rising levels, and without sines that move nothing."""
        return not (self._rising == i).any() and (not self.motion.stretch.has_waves or self.allowance[i] == 0)

    @property
    def idle(self) -> Indices:
        """Moving rows at rest whose relative velocity stays 0."""
        rows = ((self.order == NEVER) & self.is_velocity).nonzero()[0]
        modes = self.motion.equations.modes
        found = self.row[rows]
        return np.asarray(found[np.abs(modes[found]) == 1])

    # -- values with zeros divided out -----------------------------------------------------------------------

    @cached_property
    def _roundoff(self) -> tuple[Array, Array]:
        """Until when a guard that leaves 0 is roundoff, and how far one that stays 0 may stray from it."""
        g = self.start
        noise = ROUNDOFF * self.majorant
        rough = ROUNDOFF * self.scale + noise[0]
        settled = np.full(self.size, 1e-14 * self.motion.horizon)
        for k, rows in ((1, (self.order == 1).nonzero()[0]), (2, self._bent)):
            settled[rows] += (rough[rows] / np.maximum(g[k, rows], _TINY)) ** (1.0 / k)
        settled = np.minimum(settled, 1e-3 * self.motion.horizon)
        flat = np.where(
            self.is_velocity,
            rough + 1e2 * noise[1] * self.motion.horizon,
            AT_LIMIT * self.scale + noise[0],
        )
        stray = np.abs(g[0]) + 3 * flat + _TINY
        stray[self._never] = math.inf
        return settled, stray

    @cached_property
    def _bent(self) -> Indices:
        """Guards that leave 0 without a slope."""
        return ((self.order >= 2) & (self.order < NEVER)).nonzero()[0]

    @cached_property
    def passing(self) -> Indices:
        """Guards of velocities that pass 0."""
        return np.asarray((self.is_velocity & (self._constant == 0)).nonzero()[0])

    @cached_property
    def stick_at_touch(self) -> Mask:
        """Guards of contacts that may stick where their velocity only touches 0: they hold more at rest (MODEL rule 2).

        All others would go on at once: what moves them there is no more than their friction in motion.
        """
        found = np.zeros(self.size, dtype=bool)
        rows = self.row[self.passing]
        mode = self.motion.equations.modes[rows]
        holds_more = self.motion.system.holds_more[np.where(mode < 0, 1, 0), rows]
        found[self.passing] = holds_more & (np.abs(mode) == 1) & (self.order[self.passing] != NEVER)
        return found

    @cached_property
    def leeway(self) -> Array:
        """How far each guard has to go beyond 0 before it has passed it.

        A contact that may stick where its velocity only touches 0 needs none: whether the motion or an error takes it
        beyond 0, it is at rest there. Where its level rises with the dwell only, it is held if it rises fast enough.
        """
        found = np.zeros(self.size)
        found[self.passing] = self.uncertain
        sticks = self.stick_at_touch
        least = np.where(
            np.isin(self.row[sticks], self.motion.system.dwelling), _IF_DWELLING * self.uncertain, 0.0
        )
        beyond = 2 * np.maximum(-self.start[0, sticks], 0.0)
        found[sticks] = np.minimum(self.uncertain, np.maximum(least, beyond))
        return found

    def values(self, tau: float | Array, y: Array, late: bool = False) -> Array:
        """Return the guards at local time `tau` from the state, zeros at the start divided out.

        If `late`, velocities have passed 0 once they are beyond what is uncertain.
        """
        motion = self.motion
        q = motion.inputs(tau, y, self._wanted)
        g = self.raw(motion.watched(tau, y, q), q)

        def column(values: Array) -> Array:
            return values[:, None] if g.ndim == 2 else values

        if late and self.uncertain:
            g += column(self.leeway)
        if self.is_plain:
            return g

        settled, stray = self._roundoff
        stays = (self.order == NEVER).nonzero()[0]
        g[stays] += column(stray[stays])
        for k in (1, 2):
            rows = (self.order == 1).nonzero()[0] if k == 1 else self._bent
            if not rows.size:
                continue
            rest = g[rows] - column(self.start[0, rows])
            if k == 2:
                rest -= tau * column(self.start[1, rows])
            told = tau > column(settled[rows])
            lead = column(np.maximum(self.start[k, rows], _TINY))
            g[rows] = np.where(told, rest / np.where(told, tau, 1.0) ** k, lead)
        return g

    def lower_bounds(self, path: Path) -> Array:
        """Return what no guard goes below in each step of a path, one column each; -inf where that is not known.

        What is linear in states and time is a polynomial like the path, and no Chebyshev polynomial is beyond 1. A
        level that rises with its dwell is not below what it would be without rising from the start of a step on. Zeros
        at the start are not divided out; velocities have passed 0 once they are beyond what is uncertain.
        """
        motion, system, equations = self.motion, self.motion.system, self.motion.equations
        k, order, size = path.coefficients.shape
        is_rising = motion.is_rising(0.0)
        unknown = equations.watched_by_laws[self._source]
        if is_rising:
            unknown[self._rising] |= self._rise < 0
        bends = not motion.is_straight or motion.dependence is not None or (is_rising and motion.rises_push)
        if bends or not path.is_chebyshev or order < 2 or unknown.all():
            return np.full((self.size, k), -math.inf)
        turn, mu = self._turn[:, None], self._mu[:, None]
        z = equations.watch(path.coefficients.reshape(k * order, size).T)
        g = turn[:, :, None] * z[self._source].reshape(-1, k, order)
        half = 0.5 * np.diff(path.taus)
        middle, slope = np.zeros((2, system.inputs + system.dwelling.size, k))
        middle[: system.inputs] = motion.loads(path.taus[:-1] + half)
        slope[: system.inputs] = np.multiply.outer(motion.stretch.slope, half)
        for j, q in enumerate((middle, slope)):
            g[:, :, j] += turn * equations.respond(q)[size:][self._source] + mu * q[self._row]
            if is_rising:
                q[system.inputs :] = motion.withheld(path.taus[:-1]) * q[system.dwelling]
                g[self._rising, :, j] -= self._rise[:, None] * q[self._dwell]
        low = g[:, :, 0] + self._constant[:, None] - np.abs(g[:, :, 1:]).sum(axis=2)
        if self.uncertain:
            low += self.leeway[:, None]
        if self._offset is not None:
            low += self._offset[:, None]
        low[unknown] = -math.inf
        return np.asarray(low)

    def smallest(self, tau: float, y: Array) -> float:
        """Return the smallest guard at a state; velocities have passed 0 once they are beyond what is uncertain."""
        if not self.size:
            return math.inf
        if tau <= self._told:
            return float(self.values(tau, y, late=True).min())
        # no zero of the start is near: its order does not change a sign
        motion, q = self.motion, None
        if self.in_floats is not None and motion.in_floats is not None:
            x = y.tolist()
            return min(evaluate(self.in_floats, tau, x + forces(motion.in_floats[1], tau, x)))
        if self._of_states is not None and self._on_lines is not None:
            value, slope = self._on_lines
            g = self._of_states @ y
            g += value
            if not motion.stretch.is_steady:
                g += tau * slope
            return float(g.min())
        if self._has_levels or self._rising.size or motion.dependence is not None:
            q = motion.inputs(tau, y, self._wanted)
        z = motion.watched(tau, y, q)
        g = self.raw(z, z if q is None else q)
        if self.uncertain:
            g += self.leeway
        if self._offset is not None:
            g += self._offset
        return float(g.min())

    @cached_property
    def _on_lines(self) -> tuple[Array, Array] | None:
        """What `smallest` adds to what states and laws do, of a small motion whose inputs are lines, and its slope."""
        motion = self.motion
        known = None if motion.is_rising(0.0) else motion.watched_on_lines(self._source, self._turn)
        if known is None:
            return None
        value, slope = known[0] + self._constant, known[1]
        if self._has_levels:
            value += self._mu * motion.start_inputs[self._row]
            slope = slope + self._mu * np.append(motion.stretch.slope, 0.0)[self._row]
        if self.uncertain:
            value += self.leeway
        if self._offset is not None:
            value += self._offset
        return value, slope

    @cached_property
    def in_floats(self) -> list[Line] | None:
        """What `smallest` tells once zeros of the start are not near, of a small motion in plain floats."""
        if self.motion.in_floats is None or self._on_lines is None:
            return None
        equations, turn = self.motion.equations, self._turn[:, None]
        return lines(*self._on_lines, turn * equations.E[self._source], turn * equations.L[self._source])

    @cached_property
    def _of_states(self) -> Array | None:
        """The guards from the states of a motion whose inputs are lines, where no law's force reaches them."""
        equations = self.motion.equations
        if self._on_lines is None or equations.watched_by_laws[self._source].any():
            return None
        return np.asarray(self._turn[:, None] * equations.E[self._source])

    @cached_property
    def _told(self) -> float:
        """Until when the sign of some guard that leaves 0 is roundoff."""
        leaves = (self.order > 0) & (self.order < NEVER)
        return float(self._roundoff[0][leaves].max()) if leaves.any() else -1.0

    @cached_property
    def _offset(self) -> Array | None:
        """How far guards that stay 0 may stray from it, 0 for all others."""
        stays = self.order == NEVER
        return np.where(stays, self._roundoff[1], 0.0) if stays.any() else None
