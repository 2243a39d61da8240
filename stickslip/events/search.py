"""Try mode sets one after another until one is consistent (MODEL rules 3 and 8)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from stickslip.equations.balance import Balance, joined
from stickslip.equations.guards import Guards
from stickslip.equations.guards_at_start import AT_LIMIT, ROUNDOFF
from stickslip.equations.loads import Stretch
from stickslip.equations.mode_equations import APART, AT_HIGH, AT_LOW, equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.events.collapse import collapse
from stickslip.events.sharing import share
from stickslip.events.situation import Inconsistent, Situation
from stickslip.model.arrays import Array, Indices, Mask, Modes

_ALONG = 1e-9
"""Part of the largest relative acceleration below which a row does not move along."""

_ENUMERATED = 6
_MOST_TRIALS = 1000


class Search:
    """Try mode sets until one is consistent.

    `labels` are 0 for rows at rest, else the signs of their velocities; `candidates` are rows that may be held, and
    `regions` those in which the search begins.
    """

    def __init__(
        self,
        system: System,
        stretch: Stretch,
        now: Situation,
        labels: Modes,
        candidates: Mask,
        regions: Regions,
        velocity_uncertainty: float,
    ) -> None:
        self._system, self._stretch, self._now, self._y = system, stretch, now, now.y
        self._labels, self._candidates, self._regions = labels, candidates, regions
        self._at_level, self._velocity_uncertainty = now.at_level(system), velocity_uncertainty
        none = np.zeros(system.m, dtype=np.int8)
        self._sides = none if now.sides is None else now.sides.copy()
        self._tried: dict[bytes, None] = {}

    def at_rest(self, labels: Modes) -> Mask:
        """Tell which rows start from rest: those that are tried held, and open ones that will leave it."""
        return np.asarray(self._candidates | (self._labels == 0) & (labels != 0))

    def run(self, trial: Modes) -> tuple[Motion, Guards]:
        """Return the first consistent motion."""
        while True:
            if self._was_tried(trial):
                # one by one ran in a circle: look at all that is shared together
                trial = self._shared()
                if self._was_tried(trial):
                    return self._enumerate()
            self._tried[trial.tobytes()] = None
            motion, guards = self._build(trial)
            following = self._improved(trial, motion, guards)
            if following is None:
                return self._held_where_they_stay(motion, guards)
            trial = following

    def _build(self, trial: Modes) -> tuple[Motion, Guards]:
        """Return the motion in some modes, its piecewise-linear functions in the regions that it goes into.

        The functions are continuous: regions that meet at a border agree there about all forces, and about the first
        derivative with which the border leaves 0. So stepping over each border that is violated ends in the region.
        """
        seen: set[bytes] = set()
        functions = self._system.piecewise
        if self._system.has_stops:
            row = functions.row[functions.is_stop]
            side = np.where(self._sides[row] > 0, 1, 2)
            self._regions = self._regions.copy()
            self._regions[functions.is_stop] = np.where(trial[row] == APART, 0, side)
        while True:
            equations = equations_in(trial, self._system, self._regions)
            motion = Motion(equations, self._stretch, self._now.t, self._y, self._now.since)
            guards = Guards(
                motion, self._labels, self._candidates, self._at_level, self._velocity_uncertainty
            )
            seen.add(self._regions.tobytes())
            if not equations.borders.size:
                return motion, guards
            over = guards.violated[guards.is_border]
            over &= ~functions.is_stop[functions.owner[equations.borders]]
            if not over.any():
                return motion, guards
            following = self._beyond(motion, over)
            if following.tobytes() in seen:
                return motion, guards
            self._regions = following

    def _beyond(self, motion: Motion, over: Mask) -> Regions:
        """Return the regions beyond some of the borders; of those of one function the first counts."""
        functions, following = self._system.piecewise, self._regions.copy()
        for border in motion.equations.borders[over][::-1].tolist():
            following[functions.owner[border]] = functions.beyond[border]
        return following

    def _improved(self, trial: Modes, motion: Motion, guards: Guards) -> Modes | None:
        """Return the modes to try next, None if these are consistent."""
        if not np.count_nonzero(guards.violated):
            return None
        violated = guards.violated & ~guards.is_border
        if (again := self._closed_again(trial, motion, guards)) is not None:
            return again
        if not violated.any():
            return None
        over = (violated & ~guards.is_velocity).nonzero()[0]
        following = trial.copy()
        carrying = over[guards.direction[over] == 0]
        if carrying.size:
            # the share of a row that carries its level is within it again: it holds
            following[guards.row[carrying]] = 0
            return following
        if not over.size:
            following[guards.row[violated]] = 0
            return following
        if (torn := collapse(motion, guards)) is not None:
            return self._released(trial, motion, *torn)
        ratio = self._ratios(motion, guards, over)
        first = over[self._farthest(motion, guards.row[over], ratio)]
        rows, side = guards.row[first], guards.direction[first]
        spared = self._spared(motion, rows, guards.start[1, first])
        if spared.any():
            # others can carry what is beyond their level
            following[rows[spared]] = _carrying(side[spared])
            return following
        return self._released(trial, motion, rows, side)

    def _closed_again(self, trial: Modes, motion: Motion, guards: Guards) -> Modes | None:
        """Return modes in which stops are closed that would pass their limit, None if there are none."""
        functions, borders = self._system.piecewise, motion.equations.borders
        over = guards.violated[guards.is_border]
        over &= functions.is_stop[functions.owner[borders]]
        if not over.any():
            return None
        following = trial.copy()
        for border in borders[over].tolist():
            row = functions.row[functions.owner[border]]
            following[row] = 0
            self._sides[row] = 1 if functions.beyond[border] == 1 else -1
        self._stay_together(following)
        return following

    def _stay_together(self, trial: Modes) -> None:
        """Conserve momentum where a stop closes that rebounds so slowly that its flight would be roundoff."""
        system, n = self._system, self._system.n
        u = system.drive_velocities(self._stretch.at(self._now.t))
        held = (trial == 0) & system.hard
        self._y = self._y.copy()
        self._y[:n] = system.balance(held).project(self._y[:n], u)

    def _farthest(self, motion: Motion, rows: Indices, ratio: Array) -> Mask:
        """Tell which rows go first: the largest ratios of force to level, ties within roundoff together.

        Held rows share forces only with those that they are joined to by bodies: where there are no loops, each set of
        joined rows has a largest ratio of its own.
        """
        equations = motion.equations
        largest = np.full(rows.size, ratio.max())
        if rows.size > 1 and not (equations.at_level.size or equations.balance.has_loops):
            number = joined(self._system.G[equations.held])[np.searchsorted(equations.held, rows)]
            each = np.zeros(number.max() + 1)
            np.maximum.at(each, number, ratio)
            largest = each[number]
        return np.asarray(ratio >= largest * (1 - AT_LIMIT))

    def _released(self, trial: Modes, motion: Motion, rows: Indices, side: Array) -> Modes:
        """Set rows moving that nothing can spare, and with them those that carry their level along the same motion.

        Rows at a level that is turned against this motion would carry less: they hold again, and the others carry
        their level in their place.
        """
        system, following = self._system, trial.copy()
        top = ((trial == AT_HIGH) | (trial == AT_LOW)).nonzero()[0]
        if top.size:
            rest = motion.equations.is_held.copy()
            rest[rows] = False
            push = system.GT[:, rows] @ side
            given = system.balance(rest).accelerations(push)
            along = np.asarray(system.G[top] @ given)
            along *= np.where(trial[top] == AT_HIGH, 1.0, -1.0)
            # what others hold does not move along, but for roundoff
            rough = ROUNDOFF * np.asarray(system.abs_G[top] @ np.abs(given)).max()
            least = max(_ALONG * np.abs(along).max(), rough)
            following[top] = 0
            if np.any(along < -least):
                following[top[along > least]] = trial[top[along > least]]
                following[rows] = _carrying(side)
                if following.tobytes() not in self._tried:
                    return following
            let_go = top[along > least]
            following[top] = 0
            following[let_go] = self._moving(let_go, np.where(trial[let_go] == AT_HIGH, 1, -1))
        following[rows] = self._moving(rows, side)
        return following

    def _moving(self, rows: Indices, side: Array) -> Modes:
        """Return the modes of rows that are let go to the side to which they are pushed."""
        return np.where(self._system.is_stop[rows], APART, np.sign(side)).astype(np.int8)

    def _spared(self, motion: Motion, rows: Indices, slopes: Array) -> Mask:
        """Tell which of some held rows others can spare: in each loop, of rows that tie all together where that goes.

        Where it does not, those go first whose guards fall fastest.
        """
        held, balance = motion.equations.held, motion.equations.balance
        spared = np.zeros(rows.size, dtype=bool)
        if not balance.has_loops:
            return spared
        loop = balance.loop[np.searchsorted(held, rows)]
        for number in np.unique(loop[loop >= 0]).tolist():
            ties = (loop == number).nonzero()[0]
            if self._can_spare(motion, rows[ties]):
                spared[ties] = True
                continue
            for place in ties[np.argsort(slopes[ties], kind="stable")].tolist():
                spared[place] = True
                spared[place] = self._can_spare(motion, rows[ties[spared[ties]]])
        return spared

    def _can_spare(self, motion: Motion, rows: Indices) -> bool:
        """Tell whether the other held rows hold all that is held when some rows carry what is their level only."""
        balance = motion.equations.balance
        rest = motion.equations.is_held.copy()
        rest[rows] = False
        others = self._system.balance(rest)
        return others.dependent.size == balance.dependent.size and not self._parts(motion, others, rows)

    def _parts(self, motion: Motion, others: Balance, rows: Indices) -> bool:
        """Tell whether drives that move apart part the ends of some rows when only others hold."""
        system = self._system
        if not system.drives:
            return False
        for q in motion.start.q:
            rate = system.drive_accelerations(q)
            led = system.G[rows] @ (others.U @ rate) + system.D[rows] @ rate
            if np.abs(led).max() > _ALONG * np.abs(rate).max(initial=0.0):
                return True
        return False

    def _ratios(self, motion: Motion, guards: Guards, over: Indices) -> Array:
        """Return force to level for violated guards of held rows, by their rates where both are 0."""
        found = np.empty(over.size)
        expansion, noise = motion.start, ROUNDOFF * guards.majorant
        for place, i in enumerate(over.tolist()):
            sign, ratio = guards.direction[i], np.inf
            source = int(guards.rows.source[i])
            for k in range(3):
                level = float(guards.start[k, i] + sign * expansion.z[k, source])
                force = sign * float(expansion.z[k, source])
                if abs(force) > noise[k, i] or abs(level) > noise[k, i]:
                    ratio = force / level if level > noise[k, i] else np.inf
                    break
            found[place] = min(ratio, np.finfo(float).max)
        return found

    def _was_tried(self, trial: Modes) -> bool:
        return trial.tobytes() in self._tried or len(self._tried) > _MOST_TRIALS

    def _shared(self) -> Modes:
        """Return the modes in which the rows that were tried held at first share what they hold, or let go together."""
        trial = np.frombuffer(next(iter(self._tried)), dtype=np.int8).copy()
        found = share(*self._build(trial))
        if found is not None:
            rows, side = found.rows, found.side
            trial[rows] = _carrying(side) if found.holds else self._moving(rows, side)
        return trial

    def _held_where_they_stay(self, motion: Motion, guards: Guards) -> tuple[Motion, Guards]:
        """Let rows that were released, but stay at rest now that others move, be held again if they can.

        Where their share would be beyond their level, they carry their level if others can spare the rest.
        """
        if guards.is_plain or not (staying := guards.stays_zero).size:
            return motion, guards
        trial = motion.equations.modes.copy()
        trial[staying] = 0
        seen = set[bytes]()
        while trial.tobytes() not in seen:
            seen.add(trial.tobytes())
            again = self._build(trial)
            following = self._improved(trial, *again)
            if following is None:
                return again
            if np.any((following != trial) & np.isin(following, (-1, 1, APART))):
                # one more row would move
                break
            trial = following
        return self._sharing(motion, staying) or (motion, guards)

    def _sharing(self, motion: Motion, staying: Indices) -> tuple[Motion, Guards] | None:
        """Return the motion in which rows that stay at rest share with all others what they hold, None if none does."""
        trial = motion.equations.modes.copy()
        trial[staying] = trial[motion.equations.at_level] = 0
        found = share(*self._build(trial))
        if found is None or not found.holds:
            return None
        trial[found.rows] = _carrying(found.side)
        again = self._build(trial)
        return again if self._improved(trial, *again) is None else None

    def _enumerate(self) -> tuple[Motion, Guards]:
        """Try every combination where releasing one after another ran in a circle."""
        rows = (self._candidates & ~self._system.is_tie).nonzero()[0]
        if rows.size <= _ENUMERATED:
            for trial in self._combinations(rows):
                found = self._build(trial)
                if not found[1].violated.any():
                    return found
        raise Inconsistent(rows)

    def _combinations(self, rows: Indices) -> Iterator[Modes]:
        base = np.frombuffer(next(iter(self._tried)), dtype=np.int8)
        system = self._system
        choices = [
            (0, APART) if system.is_stop[j] else (0, -1) if system.is_one_way[j] else (0, 1, -1) for j in rows
        ]
        for values in sorted(product(*choices), key=np.count_nonzero):
            trial = base.copy()
            trial[rows] = values
            yield trial


def _carrying(side: Array) -> Modes:
    """Return the modes of rows that carry their level on these sides."""
    return np.where(side > 0, AT_HIGH, AT_LOW).astype(np.int8)
