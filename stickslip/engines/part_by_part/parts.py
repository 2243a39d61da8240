"""The series of a scene part by part: every body and row has its own, from the last event that reached it on.

Bodies that held rows join are a group, with one velocity. A knot is a group, too, though its bodies may have different
velocities. After an event only a `Patch` is expanded anew: the groups that the event reaches within the time for which
series hold. The series of all others go on.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy

from stickslip.engines.part_by_part.elastic import Elastic
from stickslip.engines.part_by_part.groups import UNLED, Groups
from stickslip.engines.part_by_part.knots import Knot, Knots
from stickslip.engines.part_by_part.prescribed import Prescribed
from stickslip.engines.work import Work
from stickslip.equations.algebra.polynomials import powers, shifted
from stickslip.equations.forest import Forest, spans
from stickslip.equations.loads.loads import Segment
from stickslip.equations.mode_equations import APART, AT_HIGH, AT_LOW, OPEN
from stickslip.equations.motion import Motion
from stickslip.model.arrays import Array, Indices, Mask, Modes

_DENSE_LIMIT = 120  # bodies in a patch beyond which its matrices are sparse


class Patch(NamedTuple):
    """Bodies that an event reaches, and the forces of all others on them."""

    t: float
    bodies: Indices  # (k,)
    # (k,): their velocities and positions at `t`
    v: Array
    x: Array
    coupling: Array  # (k,): force of springs and dampers on each at `t`
    both: Any  # (k, 2 k): forces of springs and dampers from velocities and positions within
    outer: Array  # (k, order + 1): series of the force from bodies outside
    # couplings: the place of a body in the patch, and the body that it is coupled to
    row: Indices
    near: Indices


class Parts:
    """All series of a scene, and the loads between two breaks.

    Parameters
    ----------
    forest : Forest
    knots : Knots
    elastic : Elastic
        Regions and forces of gaps; the same for all motions of a run.
    motion : Motion
        Where to begin; its inputs must be straight.
    labels : array (m,)
        Modes that open rows show.
    work : Work

    Attributes
    ----------
    velocity : array (n, order + 1)
        Taylor coefficients of each body's velocity, in powers of the time since `origin` over `unit`.
    position, origin : array (n,)
        Position and time at which they begin.
    watched : array (m, order + 1)
        Taylor coefficients of what each row watches: the force of a held row, the stretch of a gap, the relative
        velocity of any other.
    started : array (m,) of bool
        Rows that start from rest or from a level, and gaps that have just come into their regions.
    mode : array (m,)
        Modes of rows as the equations have them, but 0 for rows that carry their level.
    at_level : array (m,)
        AT_HIGH or AT_LOW for rows that carry their level, 0 for others.
    any_at_level : bool
        Whether there are such rows.
    groups : Groups
        Which bodies move together.
    prescribed : Prescribed
        Loads and drives.
    series_end : float
        Time until which the series of bodies that springs, dampers or sines move hold.
    """

    def __init__(
        self, forest: Forest, knots: Knots, elastic: Elastic, motion: Motion, labels: Modes, work: Work
    ) -> None:
        self.forest, self.work, self.system = forest, work, motion.system
        system, n, m = motion.system, forest.n, forest.m
        equations = motion.equations
        self.inertia, self.mu = system.inertia, system.mu_c
        self._knots = knots.at(equations)
        self.prescribed = prescribed = Prescribed(forest, motion)
        self.stop, self.unit, self.has_series = prescribed.stop, prescribed.unit, prescribed.has_series
        count = forest.order + 1
        self._ascending = np.arange(1.0, count + 2)
        self._inverse = 1.0 / self._ascending
        self._factorial = np.cumprod(np.append(1.0, self._ascending))
        self.elastic = elastic
        elastic.begin(equations.regions)
        # whether couplings or sines act on every body, whatever gaps do
        self._all_bend = bool((forest.coupled | prescribed.feels_sines).all())
        # bodies at gaps to drives
        self._led = np.zeros(n, dtype=bool)
        self._led[forest.child[forest.gaps[forest.drive[forest.gaps] >= 0]]] = True
        self._any_led = bool(self._led.any())
        self.mode, self.label = np.zeros((2, m), dtype=np.int8)
        self.at_level, self._is_loose = np.zeros(m, dtype=np.int8), np.zeros(m, dtype=bool)
        self.since = motion.since.copy()
        self.enter_modes(np.arange(m), equations.modes, labels)
        self.groups = Groups(forest, self._knots, ((self.mode == 0) & forest.in_tree).nonzero()[0])
        self.started = np.zeros(m, dtype=bool)
        self._place = np.full(n, -1)
        self.velocity, self.watched = np.zeros((n, count)), np.zeros((m, count))
        self.position, self.origin = np.zeros(n), np.full(n, motion.t)
        self.velocity[:, 0] = motion.y[:n]
        self.position[system.moved] = motion.y[system.moved_state]
        self.speed = np.abs(motion.y[:n])
        self.row_origin = np.full(m, motion.t)
        self.series_end, self.renewed_at = self.stop, motion.t
        self.dwells = system.rise.max(axis=0, initial=0.0) > 0
        self._any_dwells = bool(self.dwells.any())
        self._enter_forces()

    def enter_modes(self, rows: Indices, modes: Modes, labels: Modes) -> None:
        """Enter the modes of some rows as the equations have them, and those that they show."""
        at_level = np.where((modes == AT_HIGH) | (modes == AT_LOW), modes, 0)
        self.at_level[rows], self.mode[rows], self.label[rows] = at_level, np.where(at_level != 0, 0, modes), labels
        self.any_at_level, self.opens = bool(self.at_level.any()), bool((self.mode == OPEN).any())
        # rows in no tree that move or carry no force
        self._is_loose[rows] = ~self.forest.in_tree[rows] & ((np.abs(modes) == 1) | (modes == OPEN))
        self.moves_aside = bool(self._is_loose.any())

    def enter_knot(self, number: int, knot: Knot) -> int:
        """Let a knot go on in other modes; return how many more velocities depend on others than before."""
        before, self._knots[number] = self._knots[number], knot
        self.enter_friction(knot.bodies)
        return knot.dependent - before.dependent

    def _enter_forces(self) -> None:
        """Enter the loads, the constant parts of the forces of gaps, and friction among the forces on all bodies."""
        self._given = self.prescribed.force.copy()
        self._given[:, 0] += self.elastic.constant
        self._force = self._given.copy()
        self.enter_friction(np.arange(self.forest.n))

    def go_on(self, before: Segment, after: Segment, changes: Indices) -> Mask | None:
        """Go on beyond a break of the loads; return the bodies that feel it (n,).

        The rows `changes` are open from there on if they were not, and closed if they were open. None where sines
        change or drives jump; then nothing is done.
        """
        felt = self.prescribed.go_on(before, after, self._bound)
        if felt is None:
            return None
        self.stop = self.series_end = self.prescribed.stop
        self.renewed_at = after.start
        self.mode[changes] = np.where(self.mode[changes] == OPEN, self.label[changes], OPEN)
        self.opens = bool((self.mode == OPEN).any())
        self._enter_forces()
        feels, bodies = np.split(felt, [self.forest.m])
        rows = np.concatenate([feels.nonzero()[0], changes])
        ends = np.concatenate([self.forest.child[rows], self.forest.parent[rows]])
        bodies[ends[ends >= 0]] = True
        return bodies

    @property
    def _bound(self) -> Mask:
        """Held rows in knots that a drive may tear, or set in motion in spite of rows at their level."""
        forest, knot = self.forest, self.forest.knot_of_row
        held: Mask = (self.mode == 0) & (knot >= 0)
        if held.any():
            held &= (np.bincount(knot[held])[np.where(held, knot, 0)] > 1) | forest.has_drives
        return held

    @property
    def is_bent(self) -> Mask:
        """Bodies that follow no polynomial: couplings or sines act on them, or drives with sines lead them."""
        lead, prescribed = self.groups.lead, self.prescribed
        free = lead == UNLED
        bent = np.asarray(prescribed.bends_with[lead] if prescribed.drives_have_sines else free)
        if self._all_bend:
            return bent
        bent = bent & (~free | self.elastic.coupled | prescribed.feels_sines)
        if self.forest.row_of is None:
            # a body is bent if any body of its group is
            bent[self.groups.sharing(bent)] = True
        return np.asarray(bent)

    def bends(self, bodies: Indices) -> bool:
        """Tell whether the series of some bodies hold for a limited time only."""
        if not self.has_series:
            return False
        prescribed, lead = self.prescribed, self.groups.lead[bodies]
        bent = prescribed.bends_with[lead]
        if not self._all_bend:
            bent = bent & ((lead != UNLED) | self.elastic.coupled[bodies])
        return bool(bent.any() or prescribed.feels_sines[bodies].any())

    def enter_friction(self, bodies: Indices) -> None:
        """Enter the friction of moving rows among the forces on some bodies."""
        forest = self.forest
        if forest.row_of is not None and bodies.size == 1 and forest.knot_of[i := int(bodies[0])] < 0:
            # a short cut for most events of a fault: the general way below would make each a tenth slower
            j = int(forest.row_of[i])
            mode = int(self.mode[j]) if j >= 0 else 0
            self._force[i] = self._given[i]
            if abs(mode) == 1:
                self._force[i, :2] -= forest.sign[j] * mode * self.mu[int(mode < 0), j] * self.prescribed.normal[j]
            return
        force, rows = self._given[bodies], self._contacts_at(bodies)
        self._add_friction(force, bodies, rows, self.prescribed.normal[rows])
        self._force[bodies] = force

    def _add_friction(self, force: Array, bodies: Indices, rows: Indices, normals: Array) -> None:
        """Add the friction of some contacts, where they move or carry their level, to forces on bodies, a line each."""
        forest, place = self.forest, self._place
        coefficient = self._coefficients(rows)
        some = coefficient.nonzero()[0]
        if not some.size:
            return
        rows, push = rows[some], coefficient[some, None] * normals[some]
        place[bodies] = np.arange(bodies.size)
        for ends, lever in ((forest.child[rows], forest.lever[rows, 0]), (forest.parent[rows], forest.lever[rows, 1])):
            within = ((ends >= 0) & (place[ends] >= 0)).nonzero()[0]
            np.subtract.at(force[:, : push.shape[1]], place[ends[within]], lever[within, None] * push[within])
        place[bodies] = -1

    def _coefficients(self, rows: Indices) -> Array:
        """Return the friction of contacts as parts of their normal forces, with its sign; 0 for those held or open."""
        mode = self.mode[rows]
        found = np.where(np.abs(mode) == 1, mode * self.mu[(mode < 0).astype(np.intp), rows], 0.0)
        if self.any_at_level:
            static, at_level = self.system.mu_s[:, rows], self.at_level[rows]
            found = np.where(at_level == AT_HIGH, static[0], np.where(at_level == AT_LOW, -static[1], found))
        return np.asarray(found)

    def _contacts_at(self, bodies: Indices) -> Indices:
        """Return the contacts of some bodies, in trees and in knots."""
        return distinct(self.forest.contacts_at[spans(self.forest.contacts_from, bodies)])

    def rows_at(self, bodies: Indices) -> Indices:
        """Return the rows of some bodies; a row between two of them stands twice."""
        return self.forest.rows[spans(self.forest.rows_from, bodies)]

    def pass_borders(self, rows: Indices, places: Modes) -> Indices:
        """Let gaps go on beyond one border each, given by its place in the region; return the groups at their ends."""
        elastic = self.elastic
        gaps = elastic.number[rows]
        bodies = elastic.enter(gaps, elastic.beyond(gaps, places))
        self.label[rows] = elastic.labels(gaps)
        self._given[bodies, 0] = self.prescribed.force[bodies, 0] + elastic.constant[bodies]
        self.enter_friction(bodies)
        return np.unique(self.groups.of[bodies])

    # -- values ----------------------------------------------------------------------------------------------

    def at(self, bodies: Indices, t: float) -> tuple[Array, Array]:
        """Return velocities and positions of some bodies at time `t`."""
        s = (t - self.origin[bodies]) / self.unit
        terms = powers(s, self.velocity.shape[1])
        terms *= self.velocity[bodies]
        return terms.sum(axis=1), self.position[bodies] + self.unit * s * (terms @ self._inverse[:-1])

    def rates(self, bodies: Indices, t: float) -> tuple[Array, Array]:
        """Return velocities and accelerations of some bodies at time `t`."""
        v, a = self._about(bodies, t)[:, :2].T
        return v, a / self.unit

    def forces_at(self, bodies: Indices, t: float) -> Array:
        """Return the series of loads and friction on some bodies from time `t` on: three terms, more with sines."""
        prescribed, unit = self.prescribed, self.unit
        d = t - prescribed.start
        moved = np.array([[1.0, 0.0, 0.0], [d, unit, 0.0], [d * d, 2 * d * unit, unit * unit]])
        straight = np.asarray(self._force[bodies] @ moved)
        if self._any_led and self._led[bodies].any():
            straight = self._with_led_gaps(straight, bodies, t)
        if not (prescribed.has_sines and prescribed.feels_sines[bodies].any()):
            return straight
        found = prescribed.sine_forces(bodies, t)
        found[:, : straight.shape[1]] += straight
        if prescribed.rows.has_any:
            rows = self._contacts_at(bodies)
            rows = rows[prescribed.rows.have_sines[rows]]
            self._add_friction(found, bodies, rows, prescribed.rows.series(rows, t, found.shape[1], unit))
        return found

    def _with_led_gaps(self, force: Array, bodies: Indices, t: float) -> Array:
        """Return series of forces on bodies with those added that gaps to drives exert as the drives move."""
        forest, prescribed = self.forest, self.prescribed
        counts = forest.gaps_from[bodies + 1] - forest.gaps_from[bodies]
        rows = forest.gaps_at[spans(forest.gaps_from, bodies)]
        own = np.repeat(np.arange(bodies.size), counts)
        some = (forest.drive[rows] >= 0).nonzero()[0]
        rows, own = rows[some], own[some]
        stretch, rate, _ = self.elastic.values(self.elastic.number[rows]).T
        push = stretch[:, None] * prescribed.drive_positions(forest.drive[rows], t)
        u = prescribed.drive_velocities(forest.drive[rows], t)
        push[:, : u.shape[1]] += rate[:, None] * u
        push *= -(forest.lever[rows, 0] * forest.lever[rows, 2])[:, None]
        found = np.zeros((bodies.size, max(push.shape[1], force.shape[1])))
        found[:, : force.shape[1]] = force
        np.add.at(found[:, : push.shape[1]], own, push)
        return found

    def acceleration_majorant(self, i: int, t: float) -> float:
        """Return the majorant of the acceleration of a body at time `t`: roundoff is a part of it."""
        groups = self.groups
        lead = int(groups.lead[i])
        if lead != UNLED:
            return 0.0 if lead < 0 else self.prescribed.drive_acceleration_majorant(lead)
        inertia = self.inertia[groups.bodies(int(groups.of[i]))]
        return self.force_majorant(i, t) / float(inertia.sum() if self.forest.knot_of[i] < 0 else inertia.min())

    def force_majorant(self, i: int, t: float) -> float:
        """Return the majorant of the force on a body, and on all that move with it, at time `t`."""
        forest, bodies = self.forest, self.groups.bodies(int(self.groups.of[i]))
        places, own = spans(forest.near_from, bodies), self.forces_at(bodies, t)[:, 0]
        v, x = np.abs(self.at(forest.near[places], t))
        total = np.abs(self._given[bodies, 0]).sum() + np.abs(own).sum()
        return float(total + forest.stiffest[places] @ x + forest.most_damped[places] @ v)

    def levels(self, rows: Indices, t: float) -> Array:
        """Return the series of breakaway levels from time `t` on, forward and backward (2, k, terms).

        Static coefficients that rise with the dwell stay as they are at `t`: levels change with the normal forces only.
        """
        static = self.system.mu_s[:, rows]
        if self._any_dwells and (some := self.dwells[rows]).any():
            # the part of static coefficients that the dwell still withholds
            dwell = np.where(some, self.system.dwell[rows], 1.0)
            static -= self.system.rise[:, rows] * np.exp(-(t - self.since[rows]) / dwell)
        return np.asarray(static[:, :, None] * self.prescribed.normals(rows, t))

    def state(self, t: float) -> Array:
        """Return the state of the whole scene at time `t`."""
        system = self.system
        y = np.empty(system.size)
        v, x = self.at(np.arange(self.forest.n), t)
        y[: system.n] = v
        y[system.moved_state] = x[system.moved]
        if system.carried.size:
            y[system.carried_state] = self.prescribed.drives.positions(system.carried, np.array([t]))[:, 0]
        return y

    def some_states(self, states: Indices, times: Array) -> tuple[Array, Array]:
        """Return states at many times, a column each, from the series that hold now, and the sizes of their terms.

        All other states are 0.
        """
        system, n, speed = self.system, self.system.n, self.speed
        y, sizes = np.zeros((2, system.size, times.size))
        bodies = states[states < n]
        y[bodies] = self._along(self.velocity[bodies], bodies, times)
        sizes[bodies] = np.maximum(np.abs(y[bodies]), speed[bodies, None])
        places = states[(states >= n) & (states < n + system.moved.size)]
        bodies = system.moved[places - n]
        rates = self._along(self.velocity[bodies] * self._inverse[:-1], bodies, times)
        since, start = times - self.origin[bodies, None], self.position[bodies, None]
        y[places] = start + since * rates
        sizes[places] = np.abs(start) + since * speed[bodies, None]
        places = states[states >= n + system.moved.size]
        if places.size:
            drives = system.carried[places - n - system.moved.size]
            y[places] = self.prescribed.drives.positions(drives, times)
            sizes[places] = np.abs(y[places])
        return y, sizes

    def gained(self, states: Indices, t: float) -> Array:
        """Return how far the majorants of forces at `t` change velocities among some states in the time `unit`.

        For all other states it is 0.
        """
        found = np.zeros(self.system.size)
        for i in states[states < self.system.n].tolist():
            found[i] = self.acceleration_majorant(i, t) * self.unit
        return found

    def _along(self, series: Array, bodies: Indices, times: Array) -> Array:
        """Return the values of one series of each body at many times."""
        s = (times - self.origin[bodies, None]) / self.unit
        found = np.zeros(s.shape)
        for c in series.T[::-1]:
            found *= s
            found += c[:, None]
        return found

    # -- patches ---------------------------------------------------------------------------------------------

    def reach(self, groups: list[int]) -> Indices:
        """Return the bodies of some groups, first, and of all others that these reach."""
        return self.groups.reach(groups, self.elastic.neighbours)

    def patch(self, bodies: Indices, t: float) -> Patch:
        """Return some bodies at time `t` with all that decides how they go on."""
        v, x = self.at(bodies, t)
        k = bodies.size
        if not self.has_series:
            nothing = np.empty(0, dtype=np.intp)
            return Patch(t, bodies, v, x, np.zeros(k), None, np.zeros((k, 0)), nothing, nothing)
        forest, place = self.forest, self._place
        places = spans(forest.near_from, bodies)
        counts = forest.near_from[bodies + 1] - forest.near_from[bodies]
        rows = row = np.repeat(np.arange(k), counts)
        near = forest.near[places]
        place[bodies] = np.arange(k)
        column = place[near]
        place[bodies] = -1
        stiffness, damping = self.elastic.stiffness[places], self.elastic.damping[places]
        out = (column < 0).nonzero()[0]
        outer = np.zeros((k, self.velocity.shape[1]))
        if out.size:
            x_out = self._positions_about(near[out], t)
            v_out = x_out[:, 1:] * (self._ascending[:-1] / self.unit)
            np.add.at(outer, row[out], stiffness[out, None] * x_out[:, :-1] + damping[out, None] * v_out)
            within = (column >= 0).nonzero()[0]
            row, column, stiffness, damping = row[within], column[within], stiffness[within], damping[within]
        both = _side_by_side(damping, stiffness, row, column, k)
        return Patch(t, bodies, v, x, both @ np.concatenate([v, x]) + outer[:, 0], both, outer, rows, near)

    def _positions_about(self, bodies: Indices, t: float) -> Array:
        """Return the positions of bodies as series about `t`, with a term more than velocities."""
        x = np.empty((bodies.size, self.velocity.shape[1] + 1))
        x[:, 0] = self.position[bodies]
        np.multiply(self.velocity[bodies], self.unit * self._inverse[:-1], out=x[:, 1:])
        s = (t - self.origin[bodies]) / self.unit
        return shifted(x, s) if s.any() else x

    def expand(self, patch: Patch, v: Array) -> tuple[Indices, Array]:
        """Expand the bodies of a patch anew from velocities `v`, and the quantities that their rows watch.

        Returns all rows of these bodies, and those of them that are held.
        """
        forest, bodies, t, unit = self.forest, patch.bodies, patch.t, self.unit
        groups, first, own = self.groups.among(bodies)
        knots = self._knots_of(bodies) if self._knots else []
        lead, inertia = self.groups.lead[bodies[first]], self.inertia[bodies]
        push = self.forces_at(bodies, t)
        series = np.zeros((first.size, self.velocity.shape[1]))
        series[:, 0] = v[first]
        led = (lead != UNLED).nonzero()[0]
        share = 1.0 / (inertia if own is None else np.bincount(own, inertia))
        if led.size:
            share[led] = series[led, 0] = 0.0
            driven = led[lead[led] >= 0]
            if driven.size:
                u = self.prescribed.drive_velocities(lead[driven], t)
                series[driven, : u.shape[1]] = u
        u = self.prescribed.drive_series(t) if knots else np.empty((0, 0))
        for knot, at in knots:
            series[at if own is None else own[at], 1:] = knot.led @ u[:, 1:]
        if self.has_series:
            force = self._coupled(patch, first, own, share, push, series, knots)
        else:
            force = push
            total = push if own is None else np.stack([np.bincount(own, x) for x in push.T], axis=1)
            total = share[:, None] * total
            for knot, at in knots:
                total[at if own is None else own[at]] = knot.mobility @ push[at]
            series[:, 1:4] += unit * total * self._inverse[:3]
        for knot, at in knots:
            place = at if own is None else own[at]
            series[place] = knot.consistent(series[place], u)
        self.work.steps += 1
        self.work.rate_calls += series.shape[1] - 1
        velocity = series if own is None else series[own]
        self.velocity[bodies], self.position[bodies], self.origin[bodies] = velocity, patch.x, t
        self.speed[bodies] = np.maximum(self.speed[bodies], np.abs(v))
        terms = force.shape[1]
        rest = force - (inertia[:, None] * velocity[:, 1 : terms + 1]) * (self._ascending[:terms] / unit)
        rows, held = self._watch(patch, rest, groups)
        for knot, at in knots:
            rested = np.concatenate([knot.held, knot.at_level])
            self.watched[rested] = 0.0
            self.watched[rested, : rest.shape[1]] = knot.forces(rest[at])
            self.row_origin[rested] = t
            rows, held = np.concatenate([rows, rested]), np.concatenate([held, knot.held])
        if self.moves_aside:
            loose = self._loose_at(bodies)
            self.watched[loose], self.row_origin[loose] = self._relative_velocities(loose, t), t
            rows = np.concatenate([rows, loose])
        if self.elastic.count:
            gaps = distinct(forest.gaps_at[spans(forest.gaps_from, bodies)])
            # closed stops are held
            gaps = gaps[self.mode[gaps] == APART]
            self.watched[gaps], self.row_origin[gaps] = self._stretches(gaps, t), t
            rows = np.concatenate([rows, gaps])
        return rows, held

    def _knots_of(self, bodies: Indices) -> list[tuple[Knot, Indices]]:
        """Return the knots among some bodies in which a row is held, and where their bodies stand."""
        place, number = self._place, self.forest.knot_of[bodies]
        found = [self._knots[k] for k in np.unique(number[number >= 0]).tolist() if self._knots[k].rests]
        if not found:
            return []
        place[bodies] = np.arange(bodies.size)
        both = [(knot, place[knot.bodies]) for knot in found]
        place[bodies] = -1
        return both

    def _coupled(
        self,
        patch: Patch,
        first: Indices,
        own: Indices | None,
        share: Array,
        push: Array,
        series: Array,
        knots: list[tuple[Knot, Indices]],
    ) -> Array:
        """Fill in the series of the groups' velocities; return those of the forces on the bodies."""
        k, unit, both = patch.bodies.size, self.unit, patch.both
        order = series.shape[1] - 1
        fixed = patch.outer
        fixed[:, : push.shape[1]] += push
        # derivatives by time over `unit`, i! times the coefficients: one map leads from each to the next
        factorial = self._factorial[: order + 1, None]
        given = fixed[:, :order].T * factorial[:-1]
        if not self.prescribed.drives_have_sines:
            given = given[: 1 + int(np.flatnonzero(given.any(axis=1)).max(initial=0))]
        # bodies that drives lead follow these
        factor, led = unit * share, series[:, 1 : 1 + len(given)].T * factorial[1 : 1 + len(given)]
        if own is not None:
            given = np.array([np.bincount(own, g)[own] for g in given])
            factor, led = factor[own], led[:, own]
        pulled = [(at, unit * (given[:, at] @ knot.mobility.T)) for knot, at in knots]
        given *= factor
        for at, rate in pulled:
            given[:, at] = rate
        given += led
        z = np.zeros((order + 1, 2 * k))
        z[0, :k], z[0, k:] = series[:, 0] if own is None else series[own, 0], patch.x
        lines, count = list(z), len(given)
        follow: Callable[[Array, Array], object]
        if scipy.sparse.issparse(both):

            def follow(now: Array, following: Array) -> None:
                f = both @ now
                np.multiply(factor, f if own is None else np.bincount(own, f)[own], out=following[:k])
                for knot, at in knots:
                    following[at] = unit * (knot.mobility @ f[at])
                np.multiply(unit, now[:k], out=following[k:])

        else:
            step = np.zeros((2 * k, 2 * k))
            step[:k] = factor[:, None] * (both if own is None else (own[:, None] == own) @ both)
            for knot, at in knots:
                step[at] = unit * (knot.mobility @ both[at])
            step[np.arange(k, 2 * k), np.arange(k)] = unit
            # the method itself: a function around it would take as long as the product
            follow = step.dot

        for now, following, rates, part in zip(lines, lines[1:], z[1:, :k], given, strict=False):
            follow(now, following)
            np.add(rates, part, out=rates)
        for now, following in pairwise(lines[count:]):
            follow(now, following)
        z /= factorial
        series[:] = z[:, first].T
        fixed[:, :order] += both @ z[:order].T
        return fixed[:, :order]

    def _watch(self, patch: Patch, rest: Array, groups: Indices) -> tuple[Indices, Array]:
        """Enter the quantities that rows of a patch watch: forces of held rows, relative velocities of all others."""
        forest, t, bodies = self.forest, patch.t, patch.bodies
        rows = distinct(self.rows_at(bodies))
        place = self._place
        place[bodies] = np.arange(bodies.size)
        is_held = self.mode[rows] == 0
        held, loose = rows[is_held], rows[~is_held]
        self.watched[rows] = 0.0
        if held.size:
            child = forest.child[held]
            alone = self.groups.of[child] < forest.n
            single = held[alone]
            self.watched[single, : rest.shape[1]] = forest.sign[single, None] * rest[place[child[alone]]]
            for g in groups[groups >= forest.n].tolist():
                members, inside = self.groups.bodies(g), self.groups.inside[g]
                sums = np.zeros((members.size + 1, rest.shape[1]))
                np.cumsum(rest[place[members]], axis=0, out=sums[1:])
                at = forest.first[members]
                child = forest.child[inside]
                low = np.searchsorted(at, forest.first[child])
                high = np.searchsorted(at, forest.last[child], side="right")
                self.watched[inside, : rest.shape[1]] = forest.sign[inside, None] * (sums[high] - sums[low])
        if loose.size:
            self.watched[loose] = self._relative_velocities(loose, t)
        place[bodies] = -1
        self.row_origin[rows] = t
        return rows, held

    def _relative_velocities(self, rows: Indices, t: float) -> Array:
        """Return the relative velocities of some rows as series about `t`."""
        forest = self.forest
        found = forest.lever[rows, 0, None] * self._about(forest.child[rows], t)
        has = (forest.parent[rows] >= 0).nonzero()[0]
        if has.size:
            found[has] += forest.lever[rows[has], 1, None] * self._about(forest.parent[rows[has]], t)
        on = (forest.drive[rows] >= 0).nonzero()[0]
        if on.size:
            u = self.prescribed.drive_velocities(forest.drive[rows[on]], t)
            found[on, : u.shape[1]] += forest.lever[rows[on], 2, None] * u
        return found

    def _loose_at(self, bodies: Indices) -> Indices:
        """Return the rows at some bodies that move, or carry no force, and are in no tree."""
        rows = self.forest.aside_at[spans(self.forest.aside_from, bodies)]
        return distinct(rows[self._is_loose[rows]])

    def _about(self, bodies: Indices, t: float) -> Array:
        """Return the velocities of bodies as series about `t`; those of bodies just expanded are so already."""
        v = self.velocity[bodies]
        s = (t - self.origin[bodies]) / self.unit
        moved = s.nonzero()[0]
        if moved.size:
            v[moved] = shifted(v[moved], s[moved])
        return v

    def _stretches(self, gaps: Indices, t: float) -> Array:
        """Return the stretches of some gaps as series about `t`."""
        forest = self.forest
        found = np.zeros((gaps.size, self.velocity.shape[1]))
        for ends, lever in ((forest.child, 0), (forest.parent, 1)):
            some = (ends[gaps] >= 0).nonzero()[0]
            found[some] += forest.lever[gaps[some], lever, None] * self._positions_about(ends[gaps[some]], t)[:, :-1]
        some = (forest.drive[gaps] >= 0).nonzero()[0]
        if some.size:
            x = self.prescribed.drive_positions(forest.drive[gaps[some]], t)
            found[some, : x.shape[1]] += forest.lever[gaps[some], 2, None] * x
        return found

    def live_rows(self, patch: Patch, rows: Indices) -> Mask:
        """Tell which rows of a patch watch bodies moved by couplings or sines: their series last until `series_end`."""
        if not self.has_series:
            return np.zeros(rows.size, dtype=bool)
        forest, bodies = self.forest, patch.bodies
        live = self.is_bent
        live[bodies[patch.row[live[patch.near]]]] = True
        if self.prescribed.has_sines:
            live |= self.prescribed.feels_sines
        if forest.row_of is None:
            groups = np.unique(self.groups.of[bodies[live[bodies]]])
            for g in groups[groups >= forest.n].tolist():
                live[self.groups.bodies(g)] = True
        elif not (self.elastic.count or self.moves_aside):
            return np.asarray(live[forest.child[rows]])
        parent = forest.parent[rows]
        return np.asarray(live[forest.child[rows]] | (live[np.maximum(parent, 0)] & (parent >= 0)))


def distinct(numbers: Indices) -> Indices:
    """Return some numbers in order, each once; for few of them numpy's `unique` takes four times as long."""
    if numbers.size < 2:
        return numbers
    found = np.sort(numbers)
    new = np.empty(found.size, dtype=bool)
    new[0] = True
    np.not_equal(found[1:], found[:-1], out=new[1:])
    return found[new]


def _side_by_side(first: Array, second: Array, row: Indices, column: Indices, size: int) -> Any:
    """Return two matrices of the same pattern, rows in order, side by side; sparse where they are large."""
    if size > _DENSE_LIMIT:
        starts = np.concatenate([[0], 2 * np.cumsum(np.bincount(row, minlength=size))])
        entries = np.stack([first, second], axis=1).ravel()
        columns = np.stack([column, size + column], axis=1).ravel()
        return scipy.sparse.csr_array((entries, columns, starts), shape=(size, 2 * size))
    found = np.zeros((size, 2 * size))
    found[row, column], found[row, size + column] = first, second
    return found
