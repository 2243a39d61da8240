"""Guards: quantities that stay positive while the modes hold.

They are ``s w`` of a row that moves in the direction s, ``high - lambda`` and ``lambda - low`` of a held row, N of a
closed contact whose normal force depends on the state, and ``-N`` of an open one. A guard that is 0 at the start is
divided by a power of the time: the quotient is positive at the start and has all later roots of the guard.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from stickslip.equations.algebra.floats import smallest_of
from stickslip.equations.guards.at_start import (
    AT_LIMIT,
    FINEST_ROUNDOFF,
    NEVER,
    ROUNDOFF,
    VALUE_ROUNDOFF,
    GuardsAtStart,
)
from stickslip.equations.path import Path
from stickslip.model.arrays import Array, Indices, Mask, like

# A guard that is beyond 0 by this part of its leeway has passed 0: what is missing of the leeway is roundoff.
FULLY = 0.999

# The least leeway of a contact that may stick where it touches 0, as a part of what is uncertain of its velocity, if
# its level rises with the dwell.
_IF_DWELLING = 1e-2

_LOOKS = 5  # times along a path, both ends among them, at which loads are sampled for the majorants of guards

_TINY = np.finfo(float).tiny


class Guards(GuardsAtStart):
    """The guards of a motion, ready when constructed, and their values along it."""

    def at_end(self, path: Path) -> tuple[Array, Array]:
        """Return the guards at the end of a path, and for each the size of what it compares from the start to the end.

        The size at the start alone may be 0: where a motion starts from rest, or contacts only begin to be pressed.
        """
        motion, rows, tau = self.motion, self.rows, float(path.taus[-1])
        system, y = motion.system, path.last
        q = motion.inputs(tau, y)
        z = motion.watched(tau, y, q)
        g = self.raw(z, q)
        force = rows.sign * z[rows.source]
        size = np.abs(force) + np.abs(g - force)
        some = rows.velocities
        if some.size:
            speeds = system.abs_G @ path.largest[: system.n]
            if system.drives:
                speeds = speeds + system.abs_D @ np.abs(system.drive_velocities(motion.loads(tau)))
            # a row that a solver has only just begun to move has no speed yet
            size[some] = np.maximum(speeds[self.row[some]], self.uncertain[some])
        some = rows.without_size
        if some.size:
            # Stretches, and forces without a level, are compared with 0. At the start and at the end they may be 0
            # themselves: their majorant along the path is their size.
            size[self.is_border] = 0.0
            size[some] = np.maximum(size[some], self._majorant_along(path, q)[some])
        if rows.has_normals and system.dependence is not None:
            # the states that a normal force depends on may be 0 at the start and at the end: their largest sizes count
            pressed = system.dependence.normal_majorants(np.abs(q), path.largest)
            size[self.is_normal] = pressed[self.row[self.is_normal]]
        start = self.majorant[0] + np.abs(self._constant) if self._has_constant else self.majorant[0]
        g = self._divided(g, tau)
        if not self.is_plain:
            # quotients by a power of the time compare with sizes again, whatever the unit of time
            g[self.order == 1] *= self.motion.horizon
            g[self._bent] *= self.motion.horizon**2
        return g, np.maximum(start, size)

    def nearest(self, part: Array, path: Path) -> Mask:
        """Tell which guard came to 0 at the end of a path; the one nearest to 0 where the path does not name it.

        `part` are the guards at the end as parts of their sizes, zeros at the start divided out.
        """
        found = path.guard
        if found is None:
            left = self._leaves * np.minimum(self.order, 2)
            passed = float(path.taus[-1]) / self.motion.horizon
            found = int(np.where(self.order == NEVER, np.inf, np.abs(part) * passed**left).argmin())
        return np.asarray(np.arange(self.size) == found)

    def _majorant_along(self, path: Path, last: Array) -> Array:
        """Return majorants of the guards along a path that ends with the inputs `last`.

        Loads that are neither lines nor sines are sampled a few times on the way.
        """
        motion, segment = self.motion, self.motion.segment
        q = np.maximum(np.abs(motion.start_inputs), np.abs(last))
        if segment.has_functions or motion.dependence is not None:
            taus = np.linspace(0.0, float(path.taus[-1]), _LOOKS)[1:-1]
            q = np.maximum(q, np.abs(motion.inputs(taus, path.at(taus).T)).max(axis=1))
        if segment.has_sines:
            amplitudes = segment.amplitudes
            q[: amplitudes.size] += amplitudes
        return self.rows.majorants(motion.equations.majorants(path.largest, q)[1], q)

    def row_and_direction(self, i: int) -> tuple[int, int] | None:
        """Return the row that sticks or lets go where a guard comes to 0, and its direction; None where no row does.

        The direction is 0 for a row that sticks.
        """
        if i < self.rows.slips or (self.direction[i] and not self.is_velocity[i]):
            return int(self.row[i]), int(self.direction[i])
        return None

    @cached_property
    def allowance(self) -> Array:
        """By how much sines can lower each guard at most, if they move nothing."""
        motion, system = self.motion, self.motion.system
        found = np.zeros(self.size)
        amplitudes = motion.segment.amplitudes
        for i in amplitudes.nonzero()[0].tolist():
            q = np.zeros(system.inputs_and_dwells)
            q[i] = amplitudes[i]
            found += self.rows.majorants(np.abs(motion.equations.respond(q)[system.size :]), q)
        return found

    def is_followed_frozen(self, i: int) -> bool:
        """Tell whether a guard is the same in a frozen expansion, without rising levels and sines that move nothing."""
        return i not in self.rows.rising and (not self.motion.segment.has_sines or self.allowance[i] == 0)

    # -- values with zeros divided out -----------------------------------------------------------------------

    @cached_property
    def _roundoff(self) -> tuple[Array, Array]:
        """Local times until which guards that leave 0 are roundoff, and how far guards that stay 0 may stray from 0."""
        g = self.start if self._bent.size else self.first
        noise = ROUNDOFF * self.majorant
        rough = ROUNDOFF * self.scale + noise[0] + self.unfelt + self._roughness[0]
        settled = np.full(self.size, 1e-14 * self.motion.horizon)
        for k in set(self.order[self._leaves].tolist()):
            rows = (self.order == k).nonzero()[0]
            leads = np.maximum(g[k, rows] if k <= 2 else self._higher[0][k, rows], _TINY)
            # a lead that is next to 0 may make the quotient overflow
            with np.errstate(over="ignore"):
                settled[rows] += (rough[rows] / leads) ** (1.0 / k)
                if k > 1:
                    # a slope that is roundoff may bring the guard below 0 again
                    slope = FINEST_ROUNDOFF * self.majorant[1, rows]
                    settled[rows] += (slope / leads) ** (1.0 / (k - 1))
        # the time itself has roundoff: at the very end of a run that may be all that is left
        settled = np.minimum(settled, max(1e-3 * self.motion.horizon, ROUNDOFF * abs(self.motion.t)))
        flat = np.where(
            self.is_velocity,
            rough + 1e2 * noise[1] * self.motion.horizon,
            AT_LIMIT * self.scale + noise[0] + self.unfelt,
        )
        # a velocity that stays 0 may drift by roundoff over the whole motion; that of a row that lets go will move
        flat[self.lets_go] = rough[self.lets_go]
        stray = np.abs(g[0]) + 3 * flat + _TINY
        stray[self._never] = math.inf
        return settled, stray

    @cached_property
    def _bent(self) -> Indices:
        """Guards that leave 0 without a slope."""
        return ((self.order >= 2) & (self.order < NEVER)).nonzero()[0]

    @cached_property
    def _falls(self) -> Array:
        """The slopes of the guards `_bent`, which are roundoff, where they are negative; 0 where they are positive.

        These slopes are subtracted. A positive one is not: it helps the guard to leave 0, and without it a short step
        would leave nothing but errors.
        """
        return np.asarray(np.minimum(self.start[1, self._bent], 0.0))

    def still_at_rest(self, tau: float) -> Indices:
        """Return the rows that leave rest at the start, but have moved by no more than roundoff by a local time."""
        if self.is_plain:
            return np.empty(0, dtype=np.intp)
        leaves = self.is_velocity & (self.order > 0) & (tau <= self._roundoff[0])
        return np.asarray(self.row[leaves], dtype=np.intp)

    def is_roundoff_at(self, tau: float) -> Mask:
        """Tell which guards leave 0 at the start, and are still roundoff at a local time."""
        return np.asarray(tau <= self.each_roundoff_until)

    def roundoff_until(self, rows: Indices) -> Array:
        """Return the local times until which velocities of some rows that leave 0 are roundoff, -1 for all others."""
        found = np.full(self.motion.system.m, -1.0)
        leaves = self.is_velocity & self._leaves
        found[self.row[leaves]] = self.each_roundoff_until[leaves]
        return np.asarray(found[rows])

    @cached_property
    def passing(self) -> Indices:
        """Guards of velocities that are compared with 0, not with the edge of a band."""
        return np.asarray((self.is_velocity & (self._constant == 0)).nonzero()[0])

    @property
    def stick_at_touch(self) -> Mask:
        """Guards of contacts that may stick where their velocity only touches 0 (MODEL rule 2).

        These contacts hold more at rest than in motion. All others would go on at once: where a velocity touches 0, the
        force that drives the contact is its friction in motion, and they hold no more.
        """
        found = self.rows.may_stick
        if self.rows.has_threshold:
            found = found & (self._constant == 0)
        return found if self.is_plain else found & (self.order != NEVER)

    @cached_property
    def leeway(self) -> Array:
        """How far each guard has to go beyond 0 before it has passed 0.

        A contact that may stick where its velocity only touches 0 needs no leeway: whether the motion or an error takes
        it beyond 0, it is at rest there. If its level rises with the dwell, it is held only if the level rises fast
        enough: it has a small leeway. If it starts beyond 0, it has twice that distance. Where loads bend, a level may
        come down to a force that is 0, and go up again: then their roundoff decides nothing.
        """
        found = np.zeros(self.size)
        if self.rows.has_forces and not (self.motion.segment.is_straight and self.motion.dependence is None):
            forces = self.rows.is_force & ~self.is_normal
            found[forces] = VALUE_ROUNDOFF * self.majorant[0, forces]
        found[self.passing] = self.uncertain[self.passing]
        sticks = self.stick_at_touch
        if not sticks.any():
            return found
        uncertain = self.uncertain[sticks]
        least = np.where(self.rows.is_dwelling[sticks], _IF_DWELLING * uncertain, 0.0)
        beyond = 2 * np.maximum(-self.first[0, sticks], 0.0)
        found[sticks] = np.minimum(uncertain, np.maximum(least, beyond))
        return found

    def values(self, tau: float | Array, y: Array, with_leeway: bool = False) -> Array:
        """Return the guards at local time `tau` from the state, zeros at the start divided out.

        If `with_leeway`, the leeway is added: guards are negative only once they have passed 0.
        """
        g = self.raw_at(tau, y)
        if with_leeway and self.velocity_uncertainty is not None:
            g += like(self.leeway, g)
        return self._divided(g, tau)

    def _divided(self, g: Array, tau: float | Array) -> Array:
        """Divide zeros at the start out of the guards `g`, in place, and return `g`."""
        if self.is_plain:
            return g
        settled = self._roundoff[0]
        if self._offset is not None:
            g += like(self._offset, g)
        for k in (1, 2):
            rows = (self.order == 1).nonzero()[0] if k == 1 else self._bent
            if not rows.size:
                continue
            start = self.first if k == 1 else self.start
            rest = g[rows] - like(self._start_values[rows], g)
            if k == 2:
                rest -= tau * like(self._falls, g)
            known = tau > like(settled[rows], g)
            lead = like(np.maximum(start[k, rows], _TINY), g)
            g[rows] = np.where(known, rest / np.where(known, tau, 1.0) ** k, lead)
        return g

    def undivided(self, taus: Array, y: Array) -> Array:
        """Return the guards at local times from the states; guards that leave 0 less their values at the start."""
        g = self.raw_at(taus, y)
        if not self.is_plain:
            self._subtract_start(g, taus)
        return g

    def along(self, path: Path) -> tuple[Array, Mask, Array]:
        """Return Chebyshev coefficients (guards, k, order) of the guards in each step of a path.

        A guard that is linear in states and time is a polynomial, as the path is. Zeros at the start are not divided
        out: from guards that leave 0 their values at the start are subtracted. Returned are also which guards are
        exactly these polynomials, and lower bounds of all guards in each step (guards, k), -inf where none is known.
        The bounds hold because no Chebyshev polynomial is larger than 1, and because a static coefficient that rises
        with its dwell is not below its value at the start of a step. Their leeway is added to the bounds.
        """
        motion, system, equations = self.motion, self.motion.system, self.motion.equations
        k, order, size = path.coefficients.shape
        is_rising, dependence = motion.is_rising(0.0), motion.dependence
        unknown = equations.watched_by_laws[self.rows.source]
        if is_rising:
            unknown[self.rows.rising] |= (self.rows.rise < 0) | (dependence is not None)
        is_linear = dependence is None or dependence.is_linear_in(motion.table_regions)
        bends = not motion.is_straight or not is_linear or (is_rising and motion.rises_push)
        if bends:
            # relative velocities are still sums of states and lines, unless velocities of drives are no lines
            unknown |= ~self.is_velocity | system.lead_drives(motion.segment.bent)
        if not path.is_chebyshev or order < 2 or unknown.all():
            return np.zeros((self.size, k, order)), np.zeros_like(unknown), np.full((self.size, k), -math.inf)
        y = path.coefficients.reshape(k * order, size).T
        g = self.rows.of_states(y).reshape(-1, k, order)
        q = self._inputs_along(path, y, is_linear=dependence is not None and not bends)
        g[:, :, : q.shape[2]] += self.rows.of_inputs(q.reshape(q.shape[0], -1)).reshape(g.shape[0], k, -1)
        if self._has_constant:
            g[:, :, 0] += self._constant[:, None]
        if not self.is_plain:
            half = 0.5 * np.diff(path.taus)
            self._subtract_start(g[:, :, 0], path.taus[:-1] + half)
            if self._bent.size:
                g[self._bent, :, 1] -= np.multiply.outer(self._falls, half)
        low = g[:, :, 0] - np.abs(g[:, :, 1:]).sum(axis=2)
        if self.velocity_uncertainty is not None:
            low += self.leeway[:, None]
        low[unknown] = -math.inf
        is_exact = ~unknown
        if is_rising:
            is_exact[self.rows.rising] = False
        return g, is_exact, low

    def _inputs_along(self, path: Path, y: Array, is_linear: bool) -> Array:
        """Return Chebyshev coefficients (inputs, k, orders) of the inputs in each step, from those of the states.

        Inputs that depend on the state are included only if they are linear in it: `is_linear`.
        """
        motion, system = self.motion, self.motion.system
        k, order, _ = path.coefficients.shape
        half = 0.5 * np.diff(path.taus)
        found = np.zeros((system.inputs_and_dwells, k, order if is_linear else 2))
        given = found[: system.inputs]
        given[:, :, 0] = motion.loads(path.taus[:-1] + half)
        given[:, :, 1] = np.multiply.outer(motion.segment.slope, half)
        if motion.is_rising(0.0):
            found[system.inputs :] = motion.withheld(path.taus[:-1])[:, :, None] * found[system.dwelling]
        if is_linear:
            assert motion.dependence is not None
            columns = given.reshape(-1, k * order)
            exact = motion.equations.consistent(np.array(y), system.drive_velocities(columns))
            motion.dependence.add_linear(columns, exact, motion.table_regions)
        return found

    def _subtract_start(self, g: Array, taus: Array) -> None:
        """Subtract from guards that leave 0 their values at the start, in place.

        Guards that stay 0 are raised by how far they may stray.
        """
        if self._offset is not None:
            g += self._offset[:, None]
        first = (self.order == 1).nonzero()[0]
        g[first] -= self._start_values[first, None]
        if self._bent.size:
            g[self._bent] -= self._start_values[self._bent, None] + np.multiply.outer(self._falls, taus)

    def smallest(self, tau: float, y: Array) -> float:
        """Return the smallest guard at a state, leeways added."""
        if not self.size:
            return math.inf
        if tau <= self.any_roundoff_until:
            return float(self.values(tau, y, with_leeway=True).min())
        # zeros at the start are behind: dividing by a power of the time would change no sign
        if self.in_floats is not None:
            return self.in_floats(tau, y)
        motion, q = self.motion, None
        if self.rows.has_levels or self.rows.rising.size or motion.dependence is not None:
            q = motion.inputs(tau, y, self._wanted)
        z = motion.watched(tau, y, q)
        g = self.raw(z, z if q is None else q)
        if self.velocity_uncertainty is not None:
            g += self.leeway
        if self._lift is not None:
            g += self._lift
        return float(g.min())

    @cached_property
    def in_floats(self) -> Callable[[float, Array], float] | None:
        """What `smallest` returns for a small motion after `any_roundoff_until`, in plain floats; None for others."""
        sums, rows = self.motion.sums, self.rows
        if sums is None or not self.size:
            return None
        found = rows.of_inputs(sums.inputs)
        found[:, sums.columns.states] += rows.by_state
        found[:, sums.forces] += rows.sign[:, None] * self.motion.equations.L[rows.source]
        found[:, 0] += self._constant
        if self.velocity_uncertainty is not None:
            found[:, 0] += self.leeway
        if self._lift is not None:
            found[:, 0] += self._lift
        return smallest_of(found, sums.columns.terms)

    @cached_property
    def any_roundoff_until(self) -> float:
        """Local time until which the sign of some guard that leaves 0 is roundoff; -1 if no guard leaves 0."""
        return float(self.each_roundoff_until.max(initial=-1.0))

    @cached_property
    def each_roundoff_until(self) -> Array:
        """Local time until which the sign of each guard is roundoff, -1 for guards that do not leave 0."""
        return np.where(self._leaves, self._roundoff[0], -1.0) if self._leaves.any() else np.full(self.size, -1.0)

    @cached_property
    def _leaves(self) -> Mask:
        """Guards that leave 0."""
        return np.asarray((self.order > 0) & (self.order < NEVER))

    @cached_property
    def _start_values(self) -> Array:
        """What is subtracted from guards that leave 0: their values at the start.

        A contact that is hardly pressed may be so for long: its positive guard comes to 0 where it does.
        """
        found = self.first[0]
        return np.asarray(np.where(self.felt > 0, np.minimum(found, 0.0), found))

    @cached_property
    def _offset(self) -> Array | None:
        """How far guards that are 0 at the start may stray beyond it, 0 for all others; None if none may.

        These are guards that stay 0. Guards that leave 0 and may have kinks are raised by next to nothing: as long as
        such a guard is exactly 0, it is not negative.
        """
        leaves = np.where(self._leaves & (self.felt > 0), _TINY, 0.0)
        found = np.where(self.order == NEVER, self._roundoff[1], leaves)
        return found if found.any() else None

    @cached_property
    def _lift(self) -> Array | None:
        """What is added to guards before their signs are read; None if no guard is 0 at the start.

        It is `_offset`, and for guards that leave 0 how far below 0 the errors of a solver let them start.
        """
        if self.is_plain:
            return None
        below = np.where(self._leaves, np.maximum(-self.first[0], 0.0), 0.0)
        return below if self._offset is None else below + self._offset
