"""When guards of a scene that is followed part by part next come to 0: first bounds that cost little, then roots."""

from __future__ import annotations

import math

import numpy as np

from stickslip.engines.part_by_part.parts import Parts
from stickslip.engines.roots import earliest, first_root, first_touch, floor_of_force
from stickslip.engines.work import Work
from stickslip.equations.algebra.polynomials import powers, shifted
from stickslip.equations.guards.at_start import FINEST_ROUNDOFF, ROUNDOFF
from stickslip.equations.inputs import DWELL_OVER
from stickslip.equations.mode_equations import APART, AT_HIGH, AT_LOW, OPEN
from stickslip.model.arrays import Array, Indices, Mask

_WORTH = 0.3  # part of a dwell time for which the series of a rising level is followed
_TERMS_WITH_DWELL = 20

# A derivative above this part of its majorant shows clearly to which side of a border a gap goes.
_CLEAR = 1e-9

# An acceleration above this part of its majorant shows clearly to which side an open row moves.
_MOVES = 1e-6

_AT_ZERO = 1e-11  # part of its size below which a guard is 0 together with another one

_STAYS = -1  # in place of the number of zeros: a gap stays at its border as long as nothing near it changes


class NextRoots:
    """The times before which no guard of each row comes to 0.

    Attributes
    ----------
    when : array (m,)
        No guard of a row comes to 0 before this time.
    is_root : array (m,) of bool
        Rows of which a guard comes to 0 at that time.
    is_live : array (m,) of bool
        Rows whose series hold only until `Parts.series_end`, and not until `Parts.stop`.
    direction : array (m,) of int8
        The side on which a held row is at its limit, or which border of its region a gap is at.
    borders : int
        How many borders gaps may come to; a border at which a gap stays does not count.
    at_once : array of int
        Of the rows that were looked at last, the gaps that go on beyond a border at once.
    level_signs : array (2, m)
        For the forward and the backward level: 1 where a held row lets go above it, -1 where the row carries it and is
        held again below it, and 0 where the row has no such level.
    near_rest : array (m,)
        The velocity at which moving rows without friction may begin to relax to rest.
    """

    def __init__(self, parts: Parts, work: Work, margin: Array) -> None:
        m = parts.forest.m
        self._parts, self._work, self._system = parts, work, parts.system
        self.when = np.full(m, math.inf)
        self.is_root, self.is_live = np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
        self.direction = np.zeros(m, dtype=np.int8)
        self.at_once = np.empty(0, dtype=np.intp)
        system = self._system
        slick = system.is_one_way | system.is_friction & (system.mu_c.min(axis=0, initial=np.inf) == 0)
        self._margin = np.where(slick, margin, 0.0)
        self._from_level = np.zeros((2, m), dtype=bool)
        self.level_signs, self.near_rest = np.zeros((2, m), dtype=np.int8), np.zeros(m)
        self.enter_modes(np.arange(m))
        # of each border, how many zeros at the start of its series are divided out; or _STAYS
        self._zeros = np.zeros(self._system.piecewise.beyond.size, dtype=np.int8)
        self._borders_of, self.borders = np.zeros(m, dtype=np.intp), 0

    def enter_modes(self, rows: Indices) -> None:
        """Enter which guards some rows have in their present modes."""
        system, label, at_level = self._system, self._parts.label[rows], self._parts.at_level[rows]
        is_stop = system.is_stop[rows]
        signs = np.where(system.is_tie[rows], 0, np.ones((2, rows.size), dtype=np.int8))
        signs[0, system.is_one_way[rows] | is_stop & (label > 0) | (at_level == AT_LOW)] = 0
        signs[1, is_stop & (label < 0) | (at_level == AT_HIGH)] = 0
        signs[:, at_level != 0] *= -1
        self.level_signs[:, rows] = signs
        self._signs_differ = bool((self.level_signs != 1).any())
        self.near_rest[rows] = np.where(np.abs(self._parts.mode[rows]) == 1, self._margin[rows], 0.0)

    def look(self, rows: Indices, t: float, is_live: Mask) -> Indices:
        """Find from when on guards of some rows may come to 0; return rows whose guards are 0 or less now.

        The search begins at `t`, where the series of the rows begin. `is_live` says which of these series hold only
        until `Parts.series_end`.
        """
        parts = self._parts
        self.is_live[rows] = is_live
        self.is_root[rows] = False
        self.when[rows] = math.inf
        gaps = rows[:0]
        if parts.elastic.count:
            is_gap = parts.mode[rows] == APART
            rows, gaps = rows[~is_gap], rows[is_gap]
        is_held = parts.mode[rows] == 0
        loose, held = rows[~is_held], rows[is_held]
        if parts.opens:
            # open rows at rest have no guard
            loose = loose[parts.label[loose] != 0]
        watched = parts.label[loose, None] * parts.watched[loose]
        if parts.moves_aside:
            watched[:, 0] -= self.near_rest[loose]
        of_held, which_held, starts = self._held(held, parts.watched[held], t)
        g, which = np.concatenate([watched, of_held]), np.concatenate([loose, which_held])
        late = np.concatenate([parts.started[loose], starts]).nonzero()[0]
        if late.size:
            # divide out the zero of rows that start from rest or from their level
            g[late, :-1], g[late, -1] = g[late, 1:], 0.0
        self.at_once = gaps
        if gaps.size:
            borders, own = self._look_at_gaps(gaps, t)
            g, which = np.concatenate([g, borders]), np.concatenate([which, gaps[own]])
        bad = which[g[:, 0] <= 0]
        span = np.where(self.is_live[which], parts.series_end, parts.stop) - t
        g *= powers(span / parts.unit, g.shape[1])
        when = earliest(g)
        soon = np.isfinite(when).nonzero()[0]
        self._work.guards_excluded += when.size - soon.size
        if soon.size:
            np.minimum.at(self.when, which[soon], t + span[soon] * when[soon])
        if self.at_once.size:
            self.when[self.at_once], self.is_root[self.at_once] = t, True
        return bad

    def start(self, rows: Indices, sides: Indices) -> None:
        """Note from which of their levels held rows start; those that carry a level have a guard for this one only."""
        self._from_level[:, rows] = self._parts.at_level[rows] != 0
        self._from_level[sides, rows] = True

    def _held(self, rows: Indices, force: Array, t: float) -> tuple[Array, Indices, Mask]:
        """Return the guards of held rows as series about `t`, as `force` is, the row of each, and which start at 0.

        Static coefficients that rise stay as they are at `t`.
        """
        parts = self._parts
        g = np.concatenate([-force, force])
        levels = parts.levels(rows, t)
        g[:, : levels.shape[2]] += levels.reshape(g.shape[0], levels.shape[2])
        which = np.concatenate([rows, rows])
        starts = (self._from_level[:, rows] & parts.started[rows]).ravel()
        if not self._signs_differ:
            return g, which, starts
        signs = self.level_signs[:, rows].ravel()
        some = signs.nonzero()[0]
        return signs[some, None] * g[some], which[some], starts[some]

    def _look_at_gaps(self, rows: Indices, t: float) -> tuple[Array, Indices]:
        """Return the guards of gaps whose series begin at `t`, and for each the place of its gap among the rows."""
        g, size, borders, own = self._borders(rows)
        self._zeros[borders] = 0
        now = []
        for k in (np.abs(g[:, 0]) <= ROUNDOFF * size).nonzero()[0].tolist():
            j = int(rows[own[k]])
            is_stop = bool(self._system.is_stop[j])
            if np.abs(g[k, 1:]).sum() <= FINEST_ROUNDOFF * size[k] and not is_stop:
                order = _STAYS
            elif (order := self._way_out(j, g[k], int(borders[k]), t)) < 0 and not is_stop:
                now.append(j)
                self.direction[j] = k - int(own.searchsorted(own[k]))
                order = _STAYS
            elif order <= 0:
                # higher orders and impacts are settled with the whole scene: a guard of 0 asks for that
                g[k], order = 0.0, 0
            self._zeros[borders[k]] = order
        self.at_once = np.array(now, dtype=np.intp)
        self.borders -= int(self._borders_of[rows].sum())
        self._borders_of[rows] = np.bincount(own, self._zeros[borders] != _STAYS, rows.size)
        self.borders += int(self._borders_of[rows].sum())
        return self._divided(g, borders), own

    def _borders(self, rows: Indices) -> tuple[Array, Array, Indices, Indices]:
        """Return the borders of the regions of some gaps as series, and their majorants at the start.

        Then come the numbers of these borders, and for each the place of its gap among the rows.
        """
        parts, elastic = self._parts, self._parts.elastic
        borders, own = elastic.borders(elastic.number[rows])
        factors = self._system.piecewise.border[borders]
        return self._along(parts.watched[rows][own], factors), self._border_sizes(rows[own], factors), borders, own

    def _border_sizes(self, rows: Indices, factors: Array) -> Array:
        """Return the majorants of a border of each of some gaps."""
        x, v = self._stretch_majorants(rows)
        stretch, rate, constant = np.abs(factors.T)
        return np.asarray(stretch * (x + self._parts.unit * v) + rate * v + constant)

    def _along(self, stretches: Array, factors: Array) -> Array:
        """Return expressions of stretches, their rates and 1 as series."""
        stretch, rate, constant = factors.T[:, :, None]
        g = stretch * stretches
        g[:, :-1] += rate / self._parts.unit * np.arange(1.0, g.shape[1]) * stretches[:, 1:]
        g[:, :1] += constant
        return np.asarray(g)

    def _divided(self, g: Array, borders: Indices) -> Array:
        """Divide zeros at the start out of borders, in place; a border at which a gap stays for now becomes 1."""
        zeros = self._zeros[borders]
        for k in (1, 2):
            some = (zeros == k).nonzero()[0]
            if some.size:
                g[some, :-k], g[some, -k:] = g[some, k:], 0.0
        stays = (zeros == _STAYS).nonzero()[0]
        g[stays, 0], g[stays, 1:] = 1.0, 0.0
        return g

    def _way_out(self, j: int, g: Array, border: int, t: float) -> int:
        """Return the order with which a border of a gap leaves 0, negative if downwards; 0 where that is not clear."""
        unit = self._parts.unit
        stretch, rate, _ = np.abs(self._system.piecewise.border[border]).tolist()
        size = self._slope_majorant(j, border)
        if rate:
            size += rate * self._bend_majorant(j, t) * unit
        first, second = g[1:3].tolist()
        if abs(first) > _CLEAR * size:
            return 1 if first > 0 else -1
        if abs(first) > ROUNDOFF * size or rate:
            return 0
        if abs(second) > _CLEAR * 0.5 * stretch * self._bend_majorant(j, t) * unit**2:
            return 2 if second > 0 else -2
        return 0

    def _slope_majorant(self, j: int, border: int) -> float:
        """Return the majorant of a border's slope by its gap's stretch, in units of the series."""
        stretch = abs(float(self._system.piecewise.border[border, 0]))
        return stretch * float(self._stretch_majorants(np.array([j]))[1][0]) * self._parts.unit

    def _bend_majorant(self, j: int, t: float) -> float:
        """Return the majorant of the second derivative of the stretch of a row."""
        parts, forest = self._parts, self._parts.forest
        ends = ((int(forest.child[j]), forest.lever[j, 0]), (int(forest.parent[j]), forest.lever[j, 1]))
        of_drive = abs(forest.lever[j, 2] * parts.prescribed.drive_at(int(forest.drive[j]), t)[1])
        return float(of_drive + sum(abs(c) * parts.acceleration_majorant(i, t) for i, c in ends if i >= 0))

    def _stretch_majorants(self, rows: Indices) -> tuple[Array, Array]:
        """Return majorants of the stretches of some gaps, and of their rates."""
        parts, forest = self._parts, self._parts.forest
        x, v = np.zeros(rows.size), np.zeros(rows.size)
        kinds = [
            (forest.child, parts.position, parts.speed),
            (forest.parent, parts.position, parts.speed),
            (forest.drive, parts.prescribed.drives.start, parts.prescribed.drive_size),
        ]
        for column, (ends, position, speed) in enumerate(kinds):
            some = (ends[rows] >= 0).nonzero()[0]
            end, lever = ends[rows[some]], np.abs(forest.lever[rows[some], column])
            x[some] += lever * np.abs(position[end])
            v[some] += lever * speed[end]
        return x, v

    def moved(self, rows: Indices, t: float) -> Array:
        """Return the quantities that rows watch as series about `t`."""
        parts = self._parts
        c, s = parts.watched[rows], (t - parts.row_origin[rows]) / parts.unit
        return shifted(c, s) if s.any() else c

    def refine(self, j: int) -> None:
        """Find the first root of the guards of a row whose bound `when` is due."""
        parts = self._parts
        t, due = float(parts.row_origin[j]), float(self.when[j])
        self.when[j] = math.inf
        if parts.mode[j] == 0:
            self._refine_held(j, t, due)
            return
        if parts.mode[j] == APART:
            self._refine_gap(j, t)
            return
        span, mode = self._until(j) - t, int(parts.mode[j])
        g = parts.label[j] * parts.watched[j]
        g[0] -= self.near_rest[j]
        if parts.started[j]:
            g = np.append(g[1:], 0.0)
        sticks = abs(mode) == 1 and bool(self._system.holds_more[0 if mode > 0 else 1, j])
        self._enter(j, g * self._units(span, g.size), t, span, 0, self.roundoff_scale(j, t), sticks)

    def _refine_held(self, j: int, t: float, due: float) -> None:
        """Find the first root of a held row; a level that rises is followed for as long as its series holds."""
        parts, system = self._parts, self._system
        until, dwell = self._until(j), float(system.dwell[j])
        is_rising = False
        if parts.dwells[j]:
            # begin shortly before the due time: at the due time itself a guard may be 0
            t = max(t, due - 0.1 * min(until - due, _WORTH * dwell))
            is_rising = (t - parts.since[j]) / dwell < DWELL_OVER
        if is_rising:
            until = min(until, t + _WORTH * dwell)
        span = until - t
        c = self.moved(np.array([j]), t)[0]
        c *= self._units(span, c.size)
        normal = parts.prescribed.normals(np.array([j]), t)[0]
        normal *= self._units(span, normal.size)
        for side, sign in ((0, 1), (1, -1)):
            level_sign = int(self.level_signs[side, j])
            if not level_sign:
                continue
            g = -sign * c
            g[: normal.size] += system.mu_s[side, j] * normal
            if is_rising and system.rise[side, j]:
                lag = float(system.rise[side, j]) * math.exp(-(t - parts.since[j]) / dwell)
                g = _risen(g, lag, span / dwell, normal)
            g *= level_sign
            if self._from_level[side, j] and parts.started[j] and t == parts.row_origin[j]:
                g = np.append(g[1:], 0.0)
            if g[0] <= np.abs(g[1:]).sum():
                self._enter(j, g, t, span, sign, self.roundoff_scale(j, t))
        if is_rising and math.isinf(self.when[j]) and until < self._until(j):
            # no root up to there: bound the next one with the static coefficient at that time, for it never falls
            self.is_root[j] = False
            span = self._until(j) - until
            row = np.array([j])
            g = self._held(row, self.moved(row, until), until)[0]
            g *= self._units(span, c.size)
            self.when[j] = until + span * float(earliest(g).min())

    def _units(self, span: float, count: int) -> Array:
        """Return the powers of a time in units of the series."""
        return np.asarray(powers(np.full(1, span / self._parts.unit), count)[0])

    def _until(self, j: int) -> float:
        return self._parts.series_end if self.is_live[j] else self._parts.stop

    def _refine_gap(self, j: int, t: float) -> None:
        """Find the first root of a gap's borders."""
        span = self._until(j) - t
        g, sizes, borders, _ = self._borders(np.array([j]))
        g = self._divided(g, borders)
        g *= self._units(span, g.shape[1])
        for place, size in enumerate(sizes.tolist()):
            if g[place, 0] <= np.abs(g[place, 1:]).sum():
                # a border that leaves 0 is measured from its value at the start
                border = int(borders[place])
                floor = self._slope_majorant(j, border) if self._zeros[border] == 1 else size
                self._enter(j, g[place], t, span, place, floor)

    def at_zero(self, rows: Indices, t: float, instant: float) -> Mask:
        """Tell which of some rows have a guard that is 0 at time `t`, but for its roundoff and `instant` s."""
        found = np.zeros(rows.size, dtype=bool)
        for place, j in enumerate(rows.tolist()):
            value, rate, size = self._due_guard(j, t)
            found[place] = abs(value) <= _AT_ZERO * size + instant * abs(rate)
        return found

    def _due_guard(self, j: int, t: float) -> tuple[float, float, float]:
        """Return the guard of a row that is due next at time `t`: its value, its rate per second, and its size."""
        parts, row = self._parts, np.array([j])
        c = self.moved(row, t)
        if parts.mode[j] == APART:
            factors = self._system.piecewise.border[[self._due_border(j)]]
            g, size = self._along(c, factors)[0], float(self._border_sizes(row, factors)[0])
        elif parts.mode[j] == 0:
            side, sign = (0, 1) if self.direction[j] > 0 else (1, -1)
            level = parts.levels(row, t)[side, 0]
            g, size = -sign * c[0], self.roundoff_scale(j, t)
            g[: level.size] += level
        else:
            g, size = parts.label[j] * c[0], self.roundoff_scale(j, t)
            g[0] -= self.near_rest[j]
        return float(g[0]), float(g[1]) / parts.unit, size

    def _due_border(self, j: int) -> int:
        """Return the border of its region that a gap comes to next."""
        elastic = self._parts.elastic
        return int(elastic.borders(elastic.number[[j]])[0][self.direction[j]])

    def all_move(self, watched: Array, t: float) -> bool:
        """Tell whether all rows that are not held move at time `t` as their labels say, by more than roundoff.

        `watched` are the series about `t` of what all rows watch.
        """
        parts = self._parts
        rows = ((np.abs(parts.mode) == 1) | (parts.mode == OPEN)).nonzero()[0]
        w, rate = watched[rows, 0], watched[rows, 1] / parts.unit
        rough = ROUNDOFF * (self._stretch_majorants(rows)[1] + np.abs(rate * t))
        return bool((parts.label[rows] * w > rough).all())

    def crosses(self, j: int, t: float) -> bool:
        """Tell whether a gap clearly goes on beyond the border that it comes to at time `t`; a stop never does."""
        if self._system.is_stop[j]:
            return False
        border = self._due_border(j)
        g = self._along(self.moved(np.array([j]), t), self._system.piecewise.border[[border]])[0]
        return self._way_out(j, g, border, t) < 0

    def _enter(self, j: int, g: Array, t: float, span: float, side: int, floor: float, may_touch: bool = False) -> None:
        """Enter the first root of a guard, a polynomial in the time since `t` over `span`, if it is the first one."""
        self._work.guards_isolated += 1
        root = first_touch(g, floor)[0] if may_touch else first_root(g, floor)
        if root is not None and t + span * root < self.when[j]:
            self.when[j], self.is_root[j], self.direction[j] = t + span * root, True, side

    def roundoff_scale(self, j: int, t: float) -> float:
        """Return the size of which the roundoff of a row's guards is a part."""
        parts = self._parts
        forest = parts.forest
        if parts.mode[j] == 0:
            level = float(self._system.mu_s[0, j]) * parts.prescribed.normal_at(j, t)
            if level and not parts.prescribed.rows.have_sines[j]:
                return level
            forces = parts.force_majorant(int(forest.child[j]), t)
            # without a level there is nothing but the forces to measure by
            return floor_of_force(level, forces) if level else forces
        child, parent, drive = np.abs(forest.lever[j]).tolist()
        total = float(child * parts.speed[forest.child[j]])
        if forest.parent[j] >= 0:
            total += parent * float(parts.speed[forest.parent[j]])
        if forest.drive[j] >= 0:
            total += drive * float(parts.prescribed.drive_size[forest.drive[j]])
        return total

    def opens_up(self, rows: Indices, t: float) -> tuple[Indices, Indices]:
        """Return the open rows at rest among some that begin to move at time `t`, and those where that is not clear.

        From then on the labels of the first show where they move.
        """
        parts, forest = self._parts, self._parts.forest
        moved, unclear = [], []
        for j in rows[(parts.mode[rows] == OPEN) & (parts.label[rows] == 0)].tolist():
            w = parts.watched[j]
            left = float(np.abs(w).sum())
            if not left:
                continue
            ends = [int(i) for i in (forest.child[j], forest.parent[j]) if i >= 0]
            size = self._bend_majorant(j, t) * parts.unit + ROUNDOFF * sum(float(parts.speed[i]) for i in ends)
            if abs(w[1]) > _MOVES * size and abs(w[0]) <= ROUNDOFF * self.roundoff_scale(j, t):
                parts.label[j] = 1 if w[1] > 0 else -1
                parts.started[j] = True
                moved.append(j)
            elif left > ROUNDOFF * (size + self.roundoff_scale(j, t)):
                unclear.append(j)
        return np.array(moved, dtype=np.intp), np.array(unclear, dtype=np.intp)

    def turn_over(self, j: int, t: float) -> bool:
        """Let an open row go on to the other side as its velocity passes 0 at `t`; False where that is not clear."""
        parts = self._parts
        c = self.moved(np.array([j]), t)[0]
        if -parts.label[j] * c[1] <= _MOVES * self._bend_majorant(j, t) * parts.unit:
            return False
        parts.watched[j], parts.row_origin[j] = c, t
        parts.label[j], parts.started[j] = -parts.label[j], True
        return not self.look(np.array([j]), t, self.is_live[[j]]).size


def _risen(g: Array, lag: float, rate: float, normal: Array) -> Array:
    """Return a guard less what its dwell withholds, ``lag exp(-rate s)`` times the normal force, with enough terms."""
    found = np.zeros(max(g.size, _TERMS_WITH_DWELL))
    found[: g.size] = g
    decay = lag * np.cumprod(np.append(1.0, -rate / np.arange(1.0, found.size)))
    found -= np.convolve(decay, normal)[: found.size]
    return found
