"""When the guards of a scene that is followed part by part are next due: bounds that cost little, then roots."""

from __future__ import annotations

import math

import numpy as np

from stickslip.engines.parts import Parts
from stickslip.engines.roots import earliest, first_root, first_touch
from stickslip.engines.work import Work
from stickslip.equations.inputs import DWELL_OVER
from stickslip.equations.polynomials import powers, shifted
from stickslip.model.arrays import Array, Indices, Mask

_WORTH = 0.3
"""Part of a dwell time for which the series of a rising level is followed."""

_TERMS_WITH_DWELL = 20


class Due:
    """The times before which no guard of a row comes to 0.

    Attributes
    ----------
    when : array (m,)
        No guard of a row comes to 0 before; does so then, where `is_root`.
    is_root : array (m,) of bool
    is_bounded : array (m,) of bool
        Rows whose series hold to the end of those of the parts only, and not to the end of the stretch.
    direction : array (m,) of int8
        The side on which a held row is at its limit.
    """

    def __init__(self, parts: Parts, work: Work) -> None:
        m = parts.forest.m
        self._parts, self._work, self._system = parts, work, parts.system
        self.when = np.full(m, math.inf)
        self.is_root, self.is_bounded = np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
        self.direction = np.zeros(m, dtype=np.int8)

    def look(self, rows: Indices, t: float, is_bounded: Mask) -> Indices:
        """Find from when on guards of some rows may come to 0; return rows whose guards are 0 or less now.

        It is looked for from `t` on, where their series begin; `is_bounded` are rows whose series hold to the end of
        those of the parts only.
        """
        parts = self._parts
        self.is_bounded[rows] = is_bounded
        self.is_root[rows] = False
        self.when[rows] = math.inf
        is_held = parts.mode[rows] == 0
        loose, held = rows[~is_held], rows[is_held]
        watched = parts.label[loose, None] * parts.watched[loose]
        g = np.concatenate([watched, self._held(held, parts.watched[held], t)])
        which = np.concatenate([loose, held, held])
        late = parts.started[loose].nonzero()[0]
        if late.size:
            # what starts from rest: the zero is divided out
            g[late, :-1], g[late, -1] = g[late, 1:], 0.0
        bad = which[g[:, 0] <= 0]
        span = np.where(self.is_bounded[which], parts.end, parts.stop) - t
        g *= powers(span / parts.unit, g.shape[1])
        when = earliest(g)
        soon = np.isfinite(when).nonzero()[0]
        self._work.guards_excluded += when.size - soon.size
        if soon.size:
            np.minimum.at(self.when, which[soon], t + span[soon] * when[soon])
        return bad

    def _held(self, rows: Indices, force: Array, t: float) -> Array:
        """Return the guards of held rows as series about `t`, as `force` is; levels that rise count as they are.

        First come those of all rows forward.
        """
        parts = self._parts
        g = np.concatenate([-force, force])
        levels = parts.levels(rows, t)
        g[:, : levels.shape[2]] += levels.reshape(g.shape[0], levels.shape[2])
        return g

    def moved(self, rows: Indices, t: float) -> Array:
        """Return what rows watch as series about `t`."""
        parts = self._parts
        c, s = parts.watched[rows], (t - parts.row_origin[rows]) / parts.unit
        return shifted(c, s) if s.any() else c

    def refine(self, j: int) -> None:
        """Find the first root of a row's guards from when it is due on."""
        parts = self._parts
        t, due = float(parts.row_origin[j]), float(self.when[j])
        self.when[j] = math.inf
        if parts.mode[j] == 0:
            self._refine_held(j, t, due)
            return
        span, mode = self._until(j) - t, int(parts.mode[j])
        g = parts.label[j] * parts.watched[j]
        if parts.started[j]:
            g = np.append(g[1:], 0.0)
        sticks = abs(mode) == 1 and bool(self._system.holds_more[0 if mode > 0 else 1, j])
        self._enter(j, g * (span / parts.unit) ** np.arange(g.size), t, span, 0, sticks)

    def _refine_held(self, j: int, t: float, due: float) -> None:
        """Find the same of a held row; a level that rises is followed for as long as its series holds."""
        parts, system = self._parts, self._system
        until, dwell = self._until(j), float(system.dwell[j])
        is_rising = False
        if parts.dwells[j]:
            # past the due time; there itself a guard may be 0
            t = max(t, due - 0.1 * min(until - due, _WORTH * dwell))
            is_rising = (t - parts.since[j]) / dwell < DWELL_OVER
        if is_rising:
            until = min(until, t + _WORTH * dwell)
        span = until - t
        c = self.moved(np.array([j]), t)[0]
        c *= (span / parts.unit) ** np.arange(c.size)
        normal = parts.normals(np.array([j]), t)[0]
        normal *= (span / parts.unit) ** np.arange(normal.size)
        for side, sign in ((0, 1), (1, -1)):
            g = -sign * c
            g[: normal.size] += system.mu_s[side, j] * normal
            if is_rising and system.rise[side, j]:
                lag = float(system.rise[side, j]) * math.exp(-(t - parts.since[j]) / dwell)
                g = _risen(g, lag, span / dwell, normal)
            if g[0] <= np.abs(g[1:]).sum():
                self._enter(j, g, t, span, sign)
        if is_rising and math.isinf(self.when[j]) and until < self._until(j):
            # not up to there: look again with the level as it is then, for it never falls below that
            self.is_root[j] = False
            span = self._until(j) - until
            row = np.array([j])
            g = self._held(row, self.moved(row, until), until) * powers(np.full(1, span / parts.unit), c.size)
            self.when[j] = until + span * float(earliest(g).min())

    def _until(self, j: int) -> float:
        return self._parts.end if self.is_bounded[j] else self._parts.stop

    def _enter(self, j: int, g: Array, t: float, span: float, side: int, may_touch: bool = False) -> None:
        """Enter the first root of a guard, a polynomial in the time since `t` over `span`, if it is the first one."""
        self._work.guards_isolated += 1
        floor = self.floor(j, t)
        root = first_touch(g, floor)[0] if may_touch else first_root(g, floor)
        if root is not None and t + span * root < self.when[j]:
            self.when[j], self.is_root[j], self.direction[j] = t + span * root, True, side

    def floor(self, j: int, t: float) -> float:
        """Return what a guard has the roundoff of."""
        parts = self._parts
        forest = parts.forest
        if parts.mode[j] == 0:
            return float(self._system.mu_s[0, j]) * parts.normal_at(j, t)
        total = float(parts.speed[forest.child[j]])
        if forest.parent[j] >= 0:
            total += float(parts.speed[forest.parent[j]])
        elif forest.drive[j] >= 0:
            total += float(parts.drive_size[forest.drive[j]])
        return total


def _risen(g: Array, lag: float, rate: float, normal: Array) -> Array:
    """Return a guard less what its level lacks, ``lag exp(-rate s)`` of the normal force; more terms where needed."""
    found = np.zeros(max(g.size, _TERMS_WITH_DWELL))
    found[: g.size] = g
    decay = lag * np.cumprod(np.append(1.0, -rate / np.arange(1.0, found.size)))
    found -= np.convolve(decay, normal)[: found.size]
    return found
