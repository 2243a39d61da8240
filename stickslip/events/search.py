"""Try mode sets one after another until one is consistent (MODEL rules 3 and 8)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stickslip.equations.algebra.matrices import split_by
from stickslip.equations.balance import Balance, component_numbers
from stickslip.equations.guards.at_start import AT_LIMIT, ROUNDOFF
from stickslip.equations.guards.guards import Guards
from stickslip.equations.loads.loads import Segment
from stickslip.equations.mode_equations import APART, AT_HIGH, AT_LOW, ModeEquations, equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.piecewise import Regions
from stickslip.equations.system import System
from stickslip.events.collapse import collapse, torn_apart
from stickslip.events.least_constraint import least_constraint
from stickslip.events.sharing import can_relieve, share
from stickslip.events.situation import Inconsistent, Situation
from stickslip.model.arrays import Array, Indices, Mask, Modes

_ALONG = 1e-9  # part of the largest relative acceleration below which a row does not move along
_MOST_TRIALS = 1000
_PATIENCE = 750  # trials after which rows are no longer let go one after another


class Search:
    """Try mode sets until one is consistent.

    `labels` are 0 for rows at rest, else the signs of their velocities. `candidates` are rows that may be held.
    `regions` are the regions of the piecewise-linear functions in which the search begins.
    """

    def __init__(
        self,
        system: System,
        segment: Segment,
        now: Situation,
        labels: Modes,
        candidates: Mask,
        regions: Regions,
        velocity_uncertainty: Array | None,
    ) -> None:
        self._system, self._segment, self._now, self._y = system, segment, now, now.y
        self._labels, self._candidates, self._regions = labels, candidates, regions
        self._at_level, self._velocity_uncertainty = now.at_level(system), velocity_uncertainty
        self._sides = np.zeros(system.m, dtype=np.int8) if now.sides is None else now.sides.copy()
        self._tried: list[Modes] = []
        self._place_of: dict[bytes, int] = {}
        self._is_patient = True

    def at_rest(self, labels: Modes) -> Mask:
        """Tell which rows start from rest: those that are tried held, and open ones that will leave it."""
        return np.asarray(self._candidates | (self._labels == 0) & (labels != 0))

    def run(self, trial: Modes) -> tuple[Motion, Guards]:
        """Return the first consistent motion; the `trial` begins with all rows held that may be held."""
        motion, guards = self._build(trial)
        if guards.is_plain and not np.count_nonzero(guards.violated) and motion.equations.balance.parting is None:
            return motion, guards
        # rows that bodies join, directly or by other rows, are a part: its forces accelerate no bodies of another part
        self._rows_of = [np.arange(self._system.m)]
        self._part_of_row, self._part_of_body = (np.zeros(k, dtype=np.intp) for k in (self._system.m, self._system.n))
        if motion.equations.balance.has_loops:
            self._divide()
        while len(self._tried) < _MOST_TRIALS:
            self._place_of.setdefault(trial.astype(np.int8).tobytes(), len(self._tried))
            self._tried.append(trial)
            following = self._improved(trial, motion, guards)
            if following is None:
                return self._held_where_they_stay(motion, guards)
            trial = self._new(following)
            motion, guards = self._build(trial)
        raise Inconsistent((self._candidates & ~self._system.is_tie).nonzero()[0])

    def _divide(self) -> None:
        """Divide the rows into parts: where rows lock the same motion, each may act on all others of its part."""
        system = self._system
        rows = (self._candidates | system.is_stop).nonzero()[0]
        self._part_of_row = np.full(system.m, -1)
        self._part_of_row[rows] = number = np.unique(component_numbers(system.G[rows]), return_inverse=True)[1]
        row, body = system.G[rows].nonzero()
        self._part_of_body[body] = number[row]
        others = (self._part_of_row < 0).nonzero()[0]
        self._part_of_row[others] = self._part_of_row.max(initial=-1) + 1 + np.arange(others.size)
        self._rows_of = split_by(self._part_of_row, np.arange(system.m))

    def _changed(self, trial: Modes, following: Modes) -> list[int]:
        """Return the parts in which modes differ."""
        if len(self._rows_of) == 1:
            return [0]
        return [int(part) for part in np.unique(self._part_of_row[trial != following])]

    def _new(self, following: Modes) -> Modes:
        """Return the modes to try next: those that follow, unless they have been tried before.

        Then releasing one row after another has run in a circle, in the parts that have changed since. There rows share
        what they hold, beginning from the first trial, in which all rows are held that may be held. If these modes have
        been tried, too, the modes by least constraint are tried: also once where many trials have led nowhere.
        """
        if (since := self._place(following)) is None:
            if self._is_patient and len(self._tried) >= _PATIENCE:
                self._is_patient = False
                return self._at_once(following)
            return following
        circling = self._circling(following, since) or list(range(len(self._rows_of)))
        start = self._reset(following, self._tried[0], circling)
        following = self._shared(start, circling)
        if self._place(following) is None:
            return following
        following = self._least_constrained(start, circling)
        if self._place(following) is not None:
            following = self._shared(following, circling)
        # what was tried before may be consistent now: stops that close on the way remove roundoff of the velocities
        if self._place(following) is not None and self._improved(following, *self._build(following)) is not None:
            raise Inconsistent(self._candidates_of(circling))
        return following

    def _at_once(self, following: Modes) -> Modes:
        """Return modes by least constraint in the parts in which trials go on, unless these have been tried."""
        changing = self._circling(following, len(self._tried) // 2)
        found = self._least_constrained(self._reset(following, self._tried[0], changing), changing)
        return found if self._place(found) is None else following

    def _circling(self, following: Modes, since: int) -> list[int]:
        """Return the parts in which modes have changed from a trial on."""
        turns = np.array(self._tried[since:])
        return [part for part, own in enumerate(self._rows_of) if (turns[:, own] != following[own]).any()]

    def _place(self, trial: Modes) -> int | None:
        """Return the place of modes among those tried before, None if they are new."""
        return self._place_of.get(trial.astype(np.int8).tobytes())

    def _reset(self, trial: Modes, first: Modes, parts: list[int]) -> Modes:
        """Return the modes of a trial, with those of the `first` one in some parts."""
        found = trial.copy()
        for part in parts:
            found[self._rows_of[part]] = first[self._rows_of[part]]
        return found

    def _build(self, trial: Modes) -> tuple[Motion, Guards]:
        """Return the motion in some modes, its piecewise-linear functions in the regions that it enters.

        The functions are continuous: regions that meet at a border agree there about all forces, and about the first
        derivative with which the border leaves 0. So stepping over each violated border leads to the right region.
        """
        seen: set[bytes] = set()
        functions = self._system.piecewise
        if self._system.has_stops:
            row = functions.row[functions.is_stop]
            side = np.where(self._sides[row] > 0, 1, 2)
            self._regions = self._regions.copy()
            self._regions[functions.is_stop] = np.where(trial[row] == APART, 0, side)
        while True:
            motion, guards = self._of(equations_in(trial, self._system, self._regions))
            seen.add(self._regions.tobytes())
            if not motion.equations.borders.size:
                return motion, guards
            over = guards.violated[guards.is_border]
            over &= ~functions.is_stop[functions.owner[motion.equations.borders]]
            if not over.any():
                return motion, guards
            following = self._beyond(motion, over)
            if following.tobytes() in seen:
                return motion, guards
            self._regions = following

    def _of(self, equations: ModeEquations) -> tuple[Motion, Guards]:
        """Return the motion from here on with these equations, and its guards."""
        motion = Motion(equations, self._segment, self._now.t, self._y, self._now.since)
        return motion, Guards(motion, self._labels, self._candidates, self._at_level, self._velocity_uncertainty)

    def _beyond(self, motion: Motion, over: Mask) -> Regions:
        """Return the regions beyond some of the borders; if several belong to one function, the first counts."""
        functions, following = self._system.piecewise, self._regions.copy()
        for border in motion.equations.borders[over][::-1].tolist():
            following[functions.owner[border]] = functions.beyond[border]
        return following

    def _improved(self, trial: Modes, motion: Motion, guards: Guards) -> Modes | None:
        """Return the modes to try next, None if these are consistent."""
        if not np.count_nonzero(guards.violated):
            return self._let_go(trial, motion, guards)
        violated = guards.violated & ~guards.is_border
        if (again := self._closed_again(trial, motion, guards)) is not None:
            return again
        if not violated.any():
            return None
        part, following = self._part_of_row[guards.row], trial.copy()
        over = (violated & ~guards.is_velocity).nonzero()[0]
        slow = (violated & guards.is_velocity).nonzero()[0]
        slow = slow[~np.isin(part[slow], part[over])]
        # a contact in pre-slip passes its limit and slips; all others come to rest
        in_band = (trial[guards.row[slow]] == 0) & ~self._system.hard[guards.row[slow]]
        following[guards.row[slow]] = np.where(in_band, -guards.rows.sign[slow], 0)
        carrying = over[guards.direction[over] == 0]
        if carrying.size:
            # the share of a row that carries its level is within the level again: the row is held
            following[guards.row[carrying]] = 0
            over = over[~np.isin(part[over], part[carrying])]
        if not over.size:
            return following
        torn: dict[int, tuple[Indices, Array]] = {}
        for rows, side in collapse(motion, guards):
            # one loop of a part after another
            torn.setdefault(int(self._part_of_row[rows[0]]), (rows, side))
        for rows, side in torn.values():
            self._release(following, motion, guards, rows, side)
        over = _nearer(guards, over[~np.isin(part[over], list(torn))])
        if not over.size:
            return following
        ratio = self._ratios(motion, guards, over)
        first = over[self._farthest(motion, guards.row[over], ratio)]
        rows, side = guards.row[first], guards.direction[first]
        spared = self._spared(motion, rows, side, guards.start[1, first])
        if spared.any():
            # other rows can carry what is beyond the level of these
            following[rows[spared]] = _carrying(side[spared])
            others = ~np.isin(self._part_of_row[rows], self._part_of_row[rows[spared]])
            rows, side = rows[others], side[others]
        if rows.size:
            self._release(following, motion, guards, rows, side)
        return following

    def _let_go(self, trial: Modes, motion: Motion, guards: Guards) -> Modes | None:
        """Return modes in which no row carries its level that moves, and none holds drives together that move apart.

        A row carries its level while others hold it at rest: these may have been let go after it. Drives that begin to
        move apart tear rows at once, however small the forces still are. None if there are no such rows.
        """
        following = trial.copy()
        if (top := moving_at_level(motion)).size:
            following[top] = self._moving(top, np.where(trial[top] == AT_HIGH, 1.0, -1.0))
            return following
        for rows, side in collapse(motion, guards):
            self._release(following, motion, guards, rows, side)
        if not (following == trial).all():
            return following
        torn = torn_apart(motion)
        if not self._system.is_friction[torn].any():
            return None
        # none of them can give way alone
        parts = np.unique(self._part_of_row[torn]).tolist()
        following = self._least_constrained(self._reset(trial, self._tried[0], parts), parts)
        return None if (following == trial).all() else following

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
        system = self._system
        u = system.drive_velocities(self._segment.at(self._now.t))
        self._y = system.with_held(self._y, u, (trial == 0) & system.hard)

    def _farthest(self, motion: Motion, rows: Indices, ratio: Array) -> Mask:
        """Tell which rows go first: the largest ratios of force to level, ties within roundoff together.

        Held rows share forces only with those that they are joined to by bodies: where there are no loops, each set of
        joined rows has a largest ratio of its own.
        """
        if rows.size == 1:
            return np.ones(1, dtype=bool)
        equations, number = motion.equations, self._part_of_row[rows]
        if not (equations.at_level.size or equations.balance.has_loops):
            number = component_numbers(self._system.G[equations.held])[np.searchsorted(equations.held, rows)]
        each = np.zeros(number.max() + 1)
        np.maximum.at(each, number, ratio)
        return np.asarray(ratio >= each[number] * (1 - AT_LIMIT))

    def _release(self, following: Modes, motion: Motion, guards: Guards, rows: Indices, side: Array) -> None:
        """Set rows moving, in place, that others cannot spare, and with them rows at their level that move along.

        A row whose level points against its motion would carry less than its level. It is held again, and the others
        carry their level in its place, unless those modes have been tried.
        """
        system, modes = self._system, motion.equations.modes
        top = motion.equations.at_level
        top = top[np.isin(self._part_of_row[top], self._part_of_row[rows])]
        following[rows] = self._moving(rows, side)
        if not top.size:
            return
        way = np.where(modes[top] == AT_HIGH, 1.0, -1.0)
        # in a symmetric loop a held row may be just at its level because another one carries its own
        tied = (np.abs(guards.first[0]) <= AT_LIMIT * guards.value_scale) & (guards.direction != 0)
        tied &= np.isin(self._part_of_row[guards.row], self._part_of_row[top]) & ~np.isin(guards.row, rows)
        top, way = np.append(top, guards.row[tied]), np.append(way, guards.direction[tied])
        rest = motion.equations.is_held.copy()
        rest[rows] = rest[top] = False
        given = system.balance(rest).accelerations(system.GT[:, rows] @ side)
        along = np.asarray(system.G[top] @ given) * way
        # a row that others hold does not move along, but for roundoff
        rough = ROUNDOFF * np.asarray(system.abs_G[top] @ np.abs(given))
        for part in np.unique(self._part_of_row[top]).tolist():
            own, mine = self._part_of_row[top] == part, self._part_of_row[rows] == part
            least = max(_ALONG * np.abs(along[own]).max(), rough[own].max())
            moves = own & (along > least)
            goes, against = top[moves], bool((along[own & (modes[top] != 0)] < -least).any())
            following[top[own]] = 0
            if against:
                following[goes] = modes[goes]
                # of these only those carry their level that other rows lock
                spared = mine.nonzero()[0]
                others = equations_in(following, system, self._regions)
                locks = others.locked(rows[spared], ignore_drives=True)
                spared = spared[locks & ~_part_ends(system, self._segment, others.balance, rows[spared])]
                following[rows[spared]] = _carrying(side[spared])
                rows_of_part = self._rows_of[part]
                if not any((trial[rows_of_part] == following[rows_of_part]).all() for trial in self._tried):
                    continue
            following[goes] = self._moving(goes, way[moves])
            following[rows[mine]] = self._moving(rows[mine], side[mine])

    def _moving(self, rows: Indices, side: Array) -> Modes:
        """Return the modes of rows that are let go to the side to which they are pushed; no clutch runs forward."""
        system, sign = self._system, np.sign(side)
        sign = np.where(system.is_one_way[rows], np.minimum(sign, 0.0), sign)
        return np.where(system.is_stop[rows], APART, sign).astype(np.int8)

    def _spared(self, motion: Motion, rows: Indices, side: Array, slopes: Array) -> Mask:
        """Tell which of some held rows others can spare: in each loop all that tie, if they can be spared together.

        If not, they are tried one after another, those first whose guards fall fastest. But none of them is spared if
        the others cannot take force from all of them at once: they go together.
        """
        held, balance = motion.equations.held, motion.equations.balance
        spared = np.zeros(rows.size, dtype=bool)
        if not balance.has_loops:
            return spared
        loop = balance.loop[np.searchsorted(held, rows)]
        ties = (loop >= 0).nonzero()[0]
        spared[ties] = self._can_spare(motion, rows[ties])
        for number in np.unique(loop[ties[~spared[ties]]]).tolist():
            own = (loop == number).nonzero()[0]
            if own.size > 1 and not can_relieve(self._system, held[balance.loop == number], rows[own], side[own]):
                spared[own] = False
                continue
            for place in own[np.argsort(slopes[own], kind="stable")].tolist():
                spared[place] = True
                spared[place] = self._can_spare(motion, rows[own[spared[own]]]).all()
        return spared

    def _can_spare(self, motion: Motion, rows: Indices) -> Mask:
        """Tell for some rows whether others of their part still hold everything if these only carry their level."""
        system, balance = self._system, motion.equations.balance
        rest = motion.equations.is_held.copy()
        rest[rows] = False
        others = system.balance(rest)
        count = [np.bincount(self._part_of_body[b.dependent], minlength=len(self._rows_of)) for b in (balance, others)]
        part = self._part_of_row[rows]
        torn = part[_part_ends(system, self._segment, others, rows)]
        return np.asarray((count[0] == count[1])[part] & ~np.isin(part, torn))

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

    def _shared(self, trial: Modes, parts: list[int]) -> Modes:
        """Return modes in which the held rows of some parts share what they hold, or let go together.

        In the trial all rows of these parts are held that may share.
        """
        motion, guards, found = *self._build(trial), trial.copy()
        for part in parts:
            own = share(motion, guards, self._part_of_row == part)
            if own is not None:
                found[own.rows] = _carrying(own.side) if own.holds else self._moving(own.rows, own.side)
        return found

    def _least_constrained(self, trial: Modes, parts: list[int]) -> Modes:
        """Return modes in which those rows of some parts move that move by least constraint.

        In the trial all rows of these parts are held that may be held.
        """
        motion, guards, found = *self._build(trial), trial.copy()
        if motion.equations.balance.parting is not None:
            motion, guards = self._of(motion.equations.together)
        for part in parts:
            rows, accelerations = least_constraint(motion, guards, self._part_of_row == part)
            found[rows] = np.where(accelerations == 0, 0, self._moving(rows, accelerations))
        return found

    def _held_where_they_stay(self, motion: Motion, guards: Guards) -> tuple[Motion, Guards]:
        """Let rows that were released, but stay at rest now that others move, be held again if they can.

        Where their share would be beyond their level, they carry their level if others can hold the rest.
        """
        if guards.is_plain or not (staying := guards.stays_zero).size:
            return motion, guards
        trial = motion.equations.modes.copy()
        trial[staying] = 0
        seen, others = set[tuple[int, bytes]](), dict[int, Iterator[Modes]]()
        while True:
            again = self._build(trial)
            following = self._improved(trial, *again)
            if following is None:
                equations = again[0].equations
                # drives may move later what carries its level: without a level its velocity is watched
                torn = _part_ends(self._system, self._segment, equations.balance, equations.at_level)
                return (motion, guards) if torn.any() else again
            moves = _moves(trial, following)
            for part in self._changed(trial, following):
                own = self._rows_of[part]
                key = part, following[own].tobytes()
                if part in others or moves[own].any() or key in seen:
                    found = next(others.setdefault(part, self._without(motion, staying, part)), None)
                    if found is None:
                        return motion, guards
                    following[own] = found
                seen.add(key)
            trial = following

    def _without(self, motion: Motion, staying: Indices, part: int) -> Iterator[Modes]:
        """Yield modes of a part whose rows that stay at rest cannot all be held: shared, then those of the motion."""
        modes, own = motion.equations.modes, self._rows_of[part]
        trial = modes.copy()
        trial[staying] = trial[motion.equations.at_level] = 0
        shared = self._shared(trial, [part])
        if not _moves(trial, shared).any():
            yield shared[own]
        yield modes[own]

    def _candidates_of(self, parts: list[int]) -> Indices:
        """Return the rows of some parts that may be held, but for ties."""
        may_be_held: Mask = self._candidates & ~self._system.is_tie & np.isin(self._part_of_row, parts)
        return may_be_held.nonzero()[0]


def moving_at_level(motion: Motion) -> Indices:
    """Return the rows that carry their level though they begin to move."""
    system, equations, start = motion.system, motion.equations, motion.start
    top = equations.at_level[~equations.locked(equations.at_level)]
    if not top.size:
        return np.asarray(top)
    moves = np.zeros(top.size, dtype=bool)
    for y, q in zip(start.y[1:], start.q[1:], strict=True):
        v, u = y[: system.n], system.drive_velocities(q)
        rough = system.abs_G[top] @ np.abs(v) + system.abs_D[top] @ np.abs(u)
        moves |= np.abs(system.relative(v, u)[top]) > ROUNDOFF * rough
    # what only drives can move they move if they ever part: the derivatives of functions are rough
    if moves.any():
        led = equations.locked(top, ignore_drives=True)
        moves[led] &= _part_ends(system, motion.segment, equations.balance, top[led])
    return np.asarray(top[moves])


def _part_ends(system: System, segment: Segment, others: Balance, rows: Indices) -> Mask:
    """Tell for some rows whether drives that move apart in a segment part their ends if only the `others` hold."""
    if not system.drives:
        return np.zeros(rows.size, dtype=bool)
    rates, rough = system.accelerations_of_drives(segment)
    parted = np.abs(system.relative(others.U @ rates, rates)[rows])
    uncertain = (system.abs_G @ (abs(others.U) @ rough) + system.abs_D @ rough)[rows, None]
    return np.asarray((parted > _ALONG * np.abs(rates).max(axis=0) + uncertain).any(axis=1))


def _moves(trial: Modes, following: Modes) -> Mask:
    """Tell which rows move in the `following` modes, but did not in the `trial`."""
    return np.asarray((following != trial) & np.isin(following, (-1, 1, APART)))


def _carrying(side: Array) -> Modes:
    """Return the modes of rows that carry their level on these sides."""
    return np.where(side > 0, AT_HIGH, AT_LOW).astype(np.int8)


def _nearer(guards: Guards, over: Indices) -> Indices:
    """Return some guards of held rows, but of two limits of the same row only the nearer: its force points there.

    Both are passed only in roundoff, where a level comes down to a force of almost 0.
    """
    value, row = guards.first[0, over], guards.row[over]
    least = np.full(guards.motion.system.m, np.inf)
    np.minimum.at(least, row, value)
    return np.asarray(over[value <= least[row]])
