"""The main loop of scenes with many events that reach few bodies: only what an event changes is followed anew.

`Run` settles the whole scene at every event. Here the scene is settled as a whole at the start, where several rows are
at their limits at once, and at breaks of the loads where what rests may begin to move. Every other event is settled
within the groups at both ends of its row, or within the knot to which the row belongs, and only the bodies that it
reaches are expanded anew. So are the bodies that feel a break.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip.engines.part_by_part.elastic import Elastic
from stickslip.engines.part_by_part.groups import UNLED
from stickslip.engines.part_by_part.knots import Knots
from stickslip.engines.part_by_part.next_roots import NextRoots
from stickslip.engines.part_by_part.parts import Parts, Patch, distinct
from stickslip.engines.progress import Interruption
from stickslip.engines.work import Work
from stickslip.equations.forest import Forest
from stickslip.equations.guards.at_start import ROUNDOFF
from stickslip.equations.guards.guards import Guards
from stickslip.equations.loads.loads import Loads
from stickslip.equations.mode_equations import APART, OPEN
from stickslip.equations.motion import Motion
from stickslip.events.endings import arrives
from stickslip.events.settle import Settled, open_or_close
from stickslip.events.situation import Situation, Uncertainty
from stickslip.events.trees import CLEAR, Tree, TreeModes, settle_tree
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.results.patchwork import Patches, packed
from stickslip.simulation.borders import TOGETHER
from stickslip.simulation.knot_scenes import KnotScene, KnotScenes
from stickslip.simulation.recorder import Recorder, cause_of
from stickslip.simulation.timeline import Timeline
from stickslip.simulation.watching import Failed, Watch

# Events that come this near to each other may be in one instant: a part of the unit of time of the series, or of the
# time between breaks where motions are polynomials.
_TIE = 1e-11

_MOST_AT_ONCE = 4  # borders that gaps may pass in one instant before the whole scene is settled
_NONE = np.empty(0, dtype=np.intp)

# Renewals without an event between after which it is looked whether all bodies are so slow, as parts of their places
# in the unit of time of the series, that they may have come to rest.
_LOOK_FOR_REST, _SLOW = 16, 1e-12

# Renewals without an event between, at most, after which it is looked whether the whole scene could take steps that are
# longer by so many times: light bodies on stiff springs make the unit of time short though they hardly move.
_IDLE, _LONGER = 64, 4.0
_REMAINDER = 1e-17

_FLUSH = 50  # series for each body and row after which a run that keeps only outputs hands over what it has


class Ending(NamedTuple):
    """The instant at which the whole scene is to be settled, and how the motion from there on is to be followed."""

    situation: Situation
    is_whole: bool  # whether it is not to be followed part by part
    crossed: Indices  # borders of stops that have been found at 0
    stopped: str | None = None  # the user's event that stops the run there


class Local:
    """Follows the motion of a scene part by part.

    Where the recorder keeps only outputs, series are handed over to it from time to time and then forgotten. The
    timeline notes every event, and the user's events are looked for between these. A row that moves without friction
    may relax to rest within the `margin`: there the whole scene is followed.

    Attributes
    ----------
    now : Settled
        The motion that is followed, from the last break of the loads on. Its modes are those of the start: `modes` has
        those that hold now.
    most_guards : int
        The largest number of guards so far.
    """

    def __init__(
        self,
        forest: Forest,
        work: Work,
        interruption: Interruption,
        recorder: Recorder,
        timeline: Timeline,
        watch: Watch | None,
        margin: Array,
    ) -> None:
        self._forest, self._work, self._interruption = forest, work, interruption
        self._knots, self._elastic = Knots(forest), Elastic(forest)
        self._recorder, self._timeline, self._watch = recorder, timeline, watch
        self._margin = margin
        self.most_guards = self._held = self._most_held = self._armed = 0
        self._bad = self._opened = _NONE
        self._any_slick = False
        self._renewals, self._until_look, self._seems_at_rest = 0, _LOOK_FOR_REST, False
        self._idle, self._patience = 0, _IDLE
        self._stopped: str | None = None

    @cached_property
    def _knot_scenes(self) -> KnotScenes:
        return KnotScenes(self.now.motion.system, self._forest.knots)

    @property
    def modes(self) -> Modes:
        """The modes of all rows; also 0 for those that carry their level."""
        return self._parts.mode

    def arrived(self, t: float, some: Mask) -> Mask:
        """Tell which of some rows have come to rest at time `t`, where the whole scene is to be settled."""
        parts, roots = self._parts, self._next_roots
        found = np.zeros(parts.mode.size, dtype=bool)
        rows = (some & (parts.label != 0)).nonzero()[0]
        if rows.size:
            w, rate = roots.moved(rows, t)[:, :2].T / np.array([[1.0], [parts.unit]])
            speeds = np.array([roots.roundoff_scale(j, t) for j in rows.tolist()]) + np.abs(rate * t)
            duration = t - parts.row_origin[rows]
            found[rows] = arrives(w, rate, duration, parts.label[rows], ROUNDOFF * speeds)
        return found

    def takes(self, now: Settled) -> bool:
        """Tell whether a motion can be followed part by part.

        No guard may be 0 at its start but for borders, and those that leave 0 with a slope.
        """
        motion = now.motion
        # impacts are kept with motions of the whole scene
        if now.impact is not None or not (self._forest.takes(motion.segment) and _is_plain(now)):
            return False
        # one long step of the whole scene is cheaper than many parts that roundoff keeps moving
        if self._seems_at_rest:
            self._seems_at_rest = False
            if motion.at_rest(0.0, motion.y) is not None:
                self._until_look = _LOOK_FOR_REST
                return False
        return not motion.is_balanced

    def follow(self, now: Settled, loads: Loads, uncertain: Uncertainty) -> Ending | None:
        """Follow a motion and all its events up to the instant at which the whole scene is to be settled.

        Returns None if it is to be followed as a whole from its start on.
        """
        motion, guards = now.motion, now.guards
        # series are exact: what is uncertain now stays so
        self.now, self._loads, self._uncertain = now, loads, uncertain
        parts = self._parts = Parts(self._forest, self._knots, self._elastic, motion, now.labels, self._work)
        self._next_roots = roots = NextRoots(parts, self._work, self._margin)
        everything = np.arange(self._forest.n)
        self._held = motion.equations.dependent.size
        self._armed = self._armed_among(np.arange(parts.mode.size))
        self._seen = motion.t
        self._begin(motion.t)
        started = self._enter_starts(guards, np.arange(parts.mode.size))
        self._expand(parts.patch(everything, motion.t), motion.y[: self._forest.n], motion.t, started)
        slick = (roots.near_rest > 0).nonzero()[0]
        self._any_slick = bool(slick.size)
        near_rest = (parts.label[slick] * parts.watched[slick, 0] <= roots.near_rest[slick]).any()
        if self._bad.size or self._opened.size or near_rest:
            return None
        return self._loop()

    # -- the loop --------------------------------------------------------------------------------------------

    def _loop(self) -> Ending:
        parts = self._parts
        due, is_root = self._next_roots.when, self._next_roots.is_root
        tie = self._tie
        while not self._interruption.pressed:
            j = int(due.argmin()) if due.size else 0
            t = float(due[j]) if due.size else parts.stop
            if t >= parts.series_end:
                ending = self._beyond_series()
                if ending is not None:
                    return ending
                tie = self._tie
                continue
            if not is_root[j]:
                self._next_roots.refine(j)
                continue
            instant = TOGETHER * abs(t)
            near = (due <= t + max(tie, instant)).nonzero()[0]
            if near.size > 1:
                rough = near[~is_root[near]]
                for k in rough.tolist():
                    self._next_roots.refine(k)
                if rough.size:
                    continue
                # over a long span a unit of time says little about how near two events are
                near = near[(near == j) | self._next_roots.at_zero(near, t, instant)]
            if self._stops_until(t):
                return self._ending(self._seen, _NONE, False)
            if parts.stop - t <= TOGETHER * abs(parts.stop):
                # the exact time of the break: the sum that led to it has been rounded
                return self._ending(parts.stop, near, self._any_gap(near))
            if self._any_slick and self._next_roots.near_rest[near].any():
                return self._ending(t, _NONE, True)
            if not (self._cross(near, t) if parts.mode[j] == APART else self._event(near, t)):
                # a gap at a border goes on with the whole scene: here it would come up again at once
                return self._ending(t, near, self._any_gap(near))
            if self._bad.size:
                return self._ending(t, _NONE, True)
        return self._ending(self._last, _NONE, False)

    @property
    def _tie(self) -> float:
        """How near to each other events have to come in s to be in one instant."""
        parts = self._parts
        return _TIE * (parts.unit if parts.has_series else parts.stop - parts.renewed_at)

    def _beyond_series(self) -> Ending | None:
        """Go on where series end: renew them, or go on beyond a break of the loads; an ending where that cannot be."""
        t, is_break = self._parts.series_end, self._parts.series_end >= self._parts.stop
        if self._stops_until(t):
            return self._ending(self._seen, _NONE, False)
        if is_break and not self._goes_on():
            return self._ending(t, _NONE, False)
        if is_break and self._bad.size == 1 and not self._opened.size and self._lets_go(int(self._bad[0]), t):
            # the row is settled: what it has changed is looked at as after any event
            return self._ending(t, _NONE, True) if self._bad.size else None
        if not is_break:
            self._renew(t)
        if self._bad.size or self._opened.size:
            return self._ending(t, _NONE if is_break else self._bad, self._any_gap(self._bad))
        if not is_break and self._looks_at_rest():
            return self._ending(t, _NONE, False)
        if not is_break and self._idles():
            return self._ending(t, _NONE, True)
        return None

    def _stops_until(self, t: float) -> bool:
        """Note the events of the user up to a change at time `t`, and tell whether one stops the run before it."""
        watch, begin = self._watch, self._seen
        self._seen = t
        if watch is None or t <= begin:
            return False
        try:
            found = watch.crossings_of_parts(self.now.motion, self._parts, begin, t)
        except Failed as failed:
            # keep what was computed before
            self._timeline.t = begin + failed.tau
            self._recorder.keep_patchwork(self._patches.until(self._timeline.t), self._most_held)
            raise ValueError(str(failed)) from failed.__cause__
        for one in found:
            at = min(begin + one.tau, t)
            self._recorder.note_user(at, one.event.name, one.sign, one.stays)
            if one.event.stop:
                self._seen, self._stopped = at, one.event.name
                return True
        return False

    def _goes_on(self) -> bool:
        """Go on beyond a break of the loads; False where the whole scene is to be settled there.

        Forces, normal forces and accelerations of drives may change there: a contact that moves and is pressed from
        then on slips, and one that is no longer pressed goes on without friction. Rows that the break takes beyond
        their limits are the `_bad` ones afterwards, as after each expansion.
        """
        parts, motion, t = self._parts, self.now.motion, self._parts.stop
        if t >= self._timeline.stop:
            return False
        after = self._loads.after(t)
        changes = open_or_close(parts.mode, motion.system, after, t, after.at(t)).nonzero()[0]
        if not (self._forest.takes(after) and self._can_change(changes)):
            return False
        watched = self._next_roots.moved(np.arange(self._forest.m), t)
        if not self._next_roots.all_move(watched, t):
            return False
        felt = parts.go_on(motion.segment, after, changes)
        if felt is None:
            return False
        self._timeline.go_to(t, False)
        self._timeline.restarts += 1
        self.now = replace(self.now, motion=Motion(motion.equations, after, t, parts.state(t), parts.since.copy()))
        # what is kept of one stretch of time has one motion of all drives: where one kinks, another stretch begins
        self._tick(t, True, begins_anew=parts.prescribed.drives.since == t)
        self._expand_anew(t, felt)
        self._enter_rows(changes)
        # the velocity of a contact has a guard while it is pressed
        opened = int(np.count_nonzero(parts.mode[changes] == OPEN))
        self._armed += (changes.size - opened) - opened
        # what the other rows watch goes on as before, but has been looked at up to the break only
        others = (parts.row_origin != t).nonzero()[0]
        if others.size:
            parts.watched[others], parts.row_origin[others], parts.started[others] = watched[others], t, False
            bad = self._next_roots.look(others, t, np.zeros(others.size, dtype=bool))
            self._bad = np.concatenate([self._bad, bad])
        if not self._bad.size:
            self._count_guards()
        return True

    def _lets_go(self, j: int, t: float) -> bool:
        """Settle what changes where a break takes one held row beyond its level; False where that is not clear."""
        parts, knot = self._parts, int(self._forest.knot_of_row[j])
        if parts.mode[j] or parts.at_level[j]:
            return False
        if knot >= 0:
            # it is settled as the whole scene would be, however clear the force is
            return self._event_in_knot(knot, np.array([j]), t, False)
        force = float(parts.watched[j, 0])
        level = float(parts.levels(np.array([j]), t)[int(force < 0), 0, 0])
        return abs(force) > (1 + CLEAR) * level and self._event_in_tree(j, t, 1 if force > 0 else -1, False)

    def _can_change(self, rows: Indices) -> bool:
        """Tell whether rows that move may be pressed, or no longer be pressed, without the whole scene."""
        return bool(self._parts.mode[rows].all()) and not (rows.size and self._any_slick)

    def _renew(self, t: float) -> None:
        """Expand all bodies anew whose series end at `t`."""
        self._parts.renewed_at, self._parts.series_end = t, self._parts.stop
        self._tick(t, False)
        self._expand_anew(t, np.zeros(self._forest.n, dtype=bool))

    def _expand_anew(self, t: float, some: Mask) -> None:
        """Expand some bodies anew, and all those whose series end."""
        parts, forest = self._parts, self._forest
        live = parts.is_bent
        live[forest.near_body[live[forest.near]]] = True
        live[forest.child[self._next_roots.is_live]] = True
        bodies = parts.groups.sharing(live | some)
        self._bad = self._opened = _NONE
        if bodies.size:
            patch = parts.patch(bodies, t)
            self._expand(patch, patch.v, t, _NONE)

    def _expand(self, patch: Patch, v: Array, t: float, started: Indices) -> None:
        """Expand a patch, enter it among the results, and look at its guards.

        `started` are rows that begin to slip, and gaps in new regions.
        """
        parts = self._parts
        rows, held = parts.expand(patch, v)
        parts.started[rows], parts.started[started] = False, True
        self._enter_bodies(patch.bodies)
        self._enter_rows(np.concatenate([held, started]))
        self._opened = unclear = _NONE
        if parts.opens:
            self._opened, unclear = self._next_roots.opens_up(rows, t)
            self._enter_rows(self._opened)
        live = parts.live_rows(patch, rows)
        if parts.series_end >= parts.stop and parts.bends(patch.bodies):
            parts.series_end = min(parts.stop, t + parts.unit)
        self._bad = self._next_roots.look(rows, t, live)
        if unclear.size:
            self._bad = np.concatenate([self._bad, unclear])

    def _looks_at_rest(self) -> bool:
        """Tell whether all bodies may have come to rest; the next look comes after twice as long, unless they have."""
        self._renewals += 1
        if self._renewals < self._until_look:
            return False
        self._renewals = 0
        parts, system = self._parts, self.now.motion.system
        speeds, places = np.split(np.abs(parts.state(parts.renewed_at)), [system.n])
        slow = speeds.max(initial=0.0) * parts.unit <= _SLOW * places.max(initial=0.0)
        self._seems_at_rest = bool(slow) and not system.sparse
        if self._seems_at_rest:
            self._until_look *= 2
        return self._seems_at_rest

    def _idles(self) -> bool:
        """Tell whether nothing has happened for long, and the whole scene could go on in longer steps."""
        self._idle += 1
        parts, system = self._parts, self.now.motion.system
        if self._idle < self._patience or system.sparse:
            return False
        self._idle = 0
        # the last terms of the series are to be below roundoff of the first ones at the end of a step
        sizes = np.abs(parts.velocity).max(axis=0)
        left = float(sizes[-2:].max())
        reach = left * _LONGER ** (sizes.size - 2)
        found = bool(reach <= _REMAINDER * max(float(sizes[0]), float(sizes[1])))
        # what has idled once will soon do so again
        self._patience = max(self._patience // 4, 1) if found else _IDLE
        return found

    # -- one event -------------------------------------------------------------------------------------------

    def _event(self, rows: Indices, t: float) -> bool:
        """Settle what rows at their limits change, and go on; False where the whole scene is to be settled."""
        if (self._parts.mode[rows] == APART).any():
            return False
        if rows.size == 1 and self._parts.mode[rows[0]] == OPEN:
            return self._turn_over(int(rows[0]), t)
        if rows.size == 1 and self._forest.in_tree[rows[0]]:
            return self._event_in_tree(int(rows[0]), t, int(self._next_roots.direction[rows[0]]), True)
        knots = self._forest.knot_of_row[rows]
        return bool(knots[0] >= 0 and (knots == knots[0]).all()) and self._event_in_knot(int(knots[0]), rows, t, True)

    def _event_in_tree(self, j: int, t: float, side: int, fired: bool) -> bool:
        """Settle the groups at both ends of a row, which lets go in the direction `side` if it is held.

        It has been found at its limit if it has `fired`.
        """
        parts, forest = self._parts, self._forest
        before = int(parts.mode[j])
        groups = [int(parts.groups.of[forest.child[j]])]
        if forest.parent[j] >= 0 and (other := int(parts.groups.of[forest.parent[j]])) != groups[0]:
            groups.append(other)
        reached = parts.reach(groups)
        patch = parts.patch(reached, t)
        since = float(parts.since[j])
        if before:
            parts.since[j] = t
        tree, where = self._tree(j, groups, patch, before)
        outcome = settle_tree(forest, tree, side if before == 0 else 0)
        if outcome is None or outcome.mode[0] == before:
            parts.since[j] = since
            return False
        self._timeline.pass_event(t, j)
        self._change(t, tree, outcome, groups, patch, where, before, fired)
        return True

    def _event_in_knot(self, number: int, rows: Indices, t: float, fired: bool) -> bool:
        """Settle a knot of which some rows are at their limits, or beyond these at a break if they have not `fired`."""
        parts, system = self._parts, self.now.motion.system
        scene = self._knot_scenes[number]
        if scene is None:
            return False
        has_fired, is_open = np.isin(scene.rows, rows) & fired, np.zeros(system.m, dtype=bool)
        is_open[scene.rows] = parts.mode[scene.rows] == OPEN
        arrived = self.arrived(t, is_open)[scene.rows]
        found = scene.settled(parts, self.now.motion.segment, t, has_fired, arrived, self._uncertain)
        if found is None or not _is_plain(found):
            return False
        self._timeline.pass_event(t, int(rows[0]))
        self._change_knot(number, scene, found, has_fired, t)
        return True

    def _enter_starts(self, guards: Guards, rows: Indices) -> Indices:
        """Note which guards leave 0 with a slope, and return their rows; `rows` are all rows of the guards."""
        some = ((guards.order == 1) & ~guards.is_border).nonzero()[0]
        found: Indices = rows[guards.row[some]]
        self._next_roots.start(found, (guards.direction[some] < 0).astype(np.intp))
        return found

    def _change_knot(self, number: int, scene: KnotScene, found: Settled, has_fired: Mask, t: float) -> None:
        """Enter the new modes of a knot, and expand the bodies that they reach."""
        parts, roots = self._parts, self._next_roots
        own, inner, rows = found.motion.equations, ~scene.is_gap, scene.rows
        group = int(parts.groups.of[scene.bodies[0]])
        patch = parts.patch(parts.reach([group]), t)
        v = patch.v
        v[: scene.bodies.size] = found.motion.y[: scene.bodies.size]
        before = parts.label[rows]
        self._armed -= self._armed_among(rows[inner])
        parts.enter_modes(rows[inner], own.modes[inner], found.labels[inner])
        parts.since[rows[inner]] = found.motion.since[inner]
        roots.enter_modes(rows[inner])
        self._armed += self._armed_among(rows[inner])
        self._any_slick = bool((roots.near_rest > 0).any())
        self._held += parts.enter_knot(number, scene.knot_in(own))
        self._most_held = max(self._most_held, self._held)
        self._tick(t, True)
        self._expand(patch, v, t, self._enter_starts(found.guards, rows))
        self._enter_rows(rows[inner])
        self._count_guards()
        noted = [
            (j, was, int(parts.label[j]), self._cause(j, was, fired))
            for j, was, fired in zip(rows.tolist(), before.tolist(), has_fired.tolist(), strict=True)
            if parts.label[j] != was
        ]
        noted += [(j, 0, int(parts.label[j]), "open") for j in self._opened.tolist() if j not in rows]
        self._note(noted, t)

    def _cause(self, j: int, before: int, fired: bool) -> str:
        """Return the cause of the change of a row in a knot."""
        if self._parts.mode[j] == OPEN:
            return "open"
        if before == 0 and self.now.motion.system.is_one_way[j]:
            return "force 0"
        return cause_of(before, int(self._parts.label[j]), fired)

    def _armed_among(self, rows: Indices) -> int:
        """Return how many guards some rows have while they move or are held."""
        mode = self._parts.mode[rows]
        of_held = self._next_roots.level_signs[:, rows[mode == 0]]
        return int(np.count_nonzero(np.abs(mode) == 1) + np.count_nonzero(of_held))

    def _turn_over(self, j: int, t: float) -> bool:
        """Let an open row go on as its velocity passes 0; nothing else changes."""
        was = int(self._parts.label[j])
        if not self._next_roots.turn_over(j, t):
            return False
        self._timeline.pass_event(t, j)
        self._tick(t, True)
        self._enter_rows(np.array([j]))
        self._bad = _NONE
        self._recorder.note(t, j, was, -was, "open")
        return True

    def _cross(self, rows: Indices, t: float) -> bool:
        """Let gaps that come to borders go on beyond them; False where the whole scene is to be settled."""
        parts, roots = self._parts, self._next_roots
        if not ((parts.mode[rows] == APART).all() and all(roots.crosses(j, t) for j in rows.tolist())):
            return False
        self._timeline.pass_event(t, int(rows[0]))
        self._tick(t, True)
        self._go_beyond(rows, t)
        return True

    def _go_beyond(self, rows: Indices, t: float) -> None:
        """Let gaps go on beyond borders, and beyond further borders that gaps come to in the same instant."""
        parts, gaps = self._parts, self._forest.gaps
        before, opened = parts.label[gaps], list[int]()
        for _ in range(_MOST_AT_ONCE):
            groups = parts.pass_borders(rows, self._next_roots.direction[rows])
            patch = parts.patch(parts.reach(groups.tolist()), t)
            self._expand(patch, patch.v, t, rows)
            opened += self._opened.tolist()
            rows = self._next_roots.at_once
            if not rows.size or self._bad.size:
                break
        else:
            self._bad = rows
        self._count_guards()
        changed = (parts.label[gaps] != before).nonzero()[0]
        noted = [(j, 0, "open") for j in opened]
        for j, was in zip(gaps[changed].tolist(), before[changed].tolist(), strict=True):
            noted.append((j, was, "leaves" if parts.label[j] == OPEN else "touches"))
        for j, was, cause in sorted(noted):
            self._recorder.note(t, j, was, int(parts.label[j]), cause)

    def _tree(self, j: int, groups: list[int], patch: Patch, before: int) -> tuple[Tree, Indices]:
        """Return the groups at both ends of a row as one tree, and where its bodies stand in the patch."""
        parts, forest, t = self._parts, self._forest, patch.t
        # the bodies of a patch begin with those of the groups themselves
        where = np.arange(sum(parts.groups.bodies(g).size for g in groups))
        if len(groups) > 1:
            where = np.argsort(forest.first[patch.bodies[where]])
        bodies = patch.bodies[where]
        inside = [parts.groups.inside[g] for g in groups if g in parts.groups.inside]
        rows = np.concatenate(inside) if inside else _NONE
        rows = np.concatenate([[j], rows[rows != j]])
        force = patch.coupling[where] + parts.forces_at(bodies, t)[:, 0]
        normal = parts.prescribed.normals(rows, t)[:, 0]
        forward, backward = parts.mu[:, rows] * normal
        if before:
            friction = forest.sign[j] * before * (forward[0] if before > 0 else backward[0])
            force[bodies == forest.child[j]] += friction
            if forest.parent[j] >= 0:
                force[bodies == forest.parent[j]] -= friction
        led = rows[forest.parent[rows] < 0]
        lead = None
        if led.size:
            k = int(forest.drive[led[0]])
            lead = parts.prescribed.drive_at(k, t)[1]
        to_forward, to_backward = parts.levels(rows, t)[:, :, 0]
        tree = Tree(bodies, parts.inertia[bodies], force, rows, to_forward, to_backward, forward, backward, lead)
        return tree, where

    def _change(
        self,
        t: float,
        tree: Tree,
        outcome: TreeModes,
        groups: list[int],
        patch: Patch,
        where: Indices,
        before: int,
        fired: bool,
    ) -> None:
        """Enter new modes, and expand the bodies that they reach."""
        parts, forest = self._parts, self._forest
        rows, mode = tree.rows, outcome.mode
        v = patch.v
        if before:
            # equal velocities, momentum conserved
            if where.size > 1:
                v[where] = v[where] @ tree.inertia / tree.inertia.sum()
            held = rows[(mode == 0) & (forest.parent[rows] < 0)]
            if tree.lead is not None and not held.size:
                k = int(forest.drive[rows[forest.parent[rows] < 0][0]])
                v[where] = parts.prescribed.drive_at(k, t)[0]
        self._regroup(tree, outcome, groups)
        old = parts.mode[rows]
        changed = (mode != old).nonzero()[0]
        which = rows[changed]
        parts.mode[which] = parts.label[which] = mode[changed]
        parts.since[which] = t
        ends = np.concatenate([forest.child[which], forest.parent[which]])
        parts.enter_friction(distinct(ends[ends >= 0]))
        self._tick(t, True)
        self._expand(patch, v, t, which[mode[changed] != 0])
        were, are = old[changed].tolist(), mode[changed].tolist()
        self._held += are.count(0) - were.count(0)
        self._armed += are.count(0) - were.count(0)
        self._most_held = max(self._most_held, self._held)
        self._count_guards()
        noted = [
            (j, a, b, cause_of(a, b, fired and j == rows[0])) for j, a, b in zip(which.tolist(), were, are, strict=True)
        ]
        noted += [(j, 0, int(parts.label[j]), "open") for j in self._opened.tolist()]
        self._note(noted, t)

    def _note(self, events: list[tuple[int, int, int, str]], t: float) -> None:
        """Keep the events of one instant, and let gaps go on that come to borders in it, too."""
        for event in sorted(events):
            self._recorder.note(t, *event)
        if self._next_roots.at_once.size and not self._bad.size:
            self._go_beyond(self._next_roots.at_once, t)

    def _count_guards(self) -> None:
        self.most_guards = max(self.most_guards, self._armed + self._next_roots.borders)

    def _regroup(self, tree: Tree, outcome: TreeModes, groups: list[int]) -> None:
        """Form the groups that go on together."""
        parts, forest = self._parts, self._forest
        rows, mode, group = tree.rows, outcome.mode, outcome.group
        for g in groups:
            parts.groups.part(g)
        if tree.bodies.size == 1:
            led = mode[0] == 0
            parts.groups.join(tree.bodies, rows if led else rows[:0], int(forest.drive[rows[0]]) if led else UNLED)
            return
        place = np.searchsorted(forest.first[tree.bodies], forest.first[forest.child[rows]])
        for one in np.unique(group).tolist():
            bodies = tree.bodies[group == one]
            own = rows[(mode == 0) & (group[place] == one)]
            led = own[forest.parent[own] < 0]
            lead = int(forest.drive[led[0]]) if led.size else UNLED
            parts.groups.join(bodies, own, lead)

    # -- results ---------------------------------------------------------------------------------------------

    def _begin(self, t: float) -> None:
        parts = self._parts
        self._patches = Patches(self.now.motion.system, t, parts.unit, parts.prescribed.drives)
        self._most_held = self._held
        self._last = t
        self._patches.tick(t, False)
        rows = np.arange(self._forest.m)
        self._patches.rows(rows, parts.row_origin[rows], self._inner(rows), self._since(rows), np.zeros((rows.size, 0)))

    def _tick(self, t: float, is_event: bool, begins_anew: bool = False) -> None:
        parts = self._parts
        self._last = t
        if is_event:
            self._renewals = self._idle = 0
        most = _FLUSH * (self._forest.n + self._forest.m) * parts.velocity.shape[1]
        if begins_anew or (not self._recorder.keeps_paths and self._patches.entries > most):
            self._recorder.keep_patchwork(self._patches.until(t), self._most_held)
            self._begin(t)
            self._enter_bodies(np.arange(self._forest.n))
            self._enter_rows((parts.mode == 0).nonzero()[0])
            return
        self._patches.tick(t, is_event)

    def _enter_bodies(self, bodies: Indices) -> None:
        parts = self._parts
        lead = parts.groups.lead[bodies].astype(float)
        self._patches.bodies(bodies, parts.origin[bodies], parts.position[bodies], parts.velocity[bodies], lead)

    def _enter_rows(self, rows: NDArray[Any]) -> None:
        parts = self._parts
        self._patches.rows(rows, parts.row_origin[rows], self._inner(rows), self._since(rows), parts.watched[rows])

    def _inner(self, rows: NDArray[Any]) -> Modes:
        """Return the modes of rows as results have them: open ones with what they show."""
        parts = self._parts
        mode: Modes = parts.mode[rows]
        if parts.any_at_level:
            mode = np.where(parts.at_level[rows] != 0, parts.at_level[rows], mode)
        return packed(mode, parts.label[rows]) if parts.opens else mode

    def _since(self, rows: Indices) -> Array:
        """Return since when contacts rest, and in which regions gaps are."""
        parts, elastic = self._parts, self._parts.elastic
        found = parts.since[rows]
        if elastic.count:
            number = elastic.number[rows]
            found = np.where(number >= 0, elastic.region[number], found)
        return found

    def _any_gap(self, rows: Indices) -> bool:
        return bool((self._parts.mode[rows] == APART).any())

    def _ending(self, t: float, fired_rows: Indices, is_whole: bool) -> Ending:
        """Hand over what is known, and say where the whole scene is to be settled."""
        parts, system = self._parts, self.now.motion.system
        self._recorder.keep_patchwork(self._patches.until(t), self._most_held)
        fired, touching = np.zeros(system.m, dtype=bool), np.zeros(system.m, dtype=bool)
        crossed = [
            int(parts.elastic.borders(parts.elastic.number[[j]])[0][self._next_roots.direction[j]])
            for j in fired_rows[(parts.mode[fired_rows] == APART) & system.is_stop[fired_rows]].tolist()
        ]
        # the state itself shows which gaps are at borders
        fired_rows = fired_rows[parts.mode[fired_rows] != APART]
        fired[fired_rows] = True
        touching[fired_rows] = parts.mode[fired_rows] != 0
        y = parts.state(t)
        largest = np.abs(y)
        largest[: system.n] = np.maximum(largest[: system.n], parts.speed)
        since = np.where(parts.label == 0, parts.since, t)
        regions = parts.elastic.region.copy()
        situation = Situation(t, y, parts.label.copy(), since, touching, fired, largest, regions)
        return Ending(situation, is_whole, np.array(crossed, dtype=np.intp), self._stopped)


def _is_plain(now: Settled) -> bool:
    """Tell whether a motion starts so that it can be followed part by part, with loads that can."""
    guards, equations = now.guards, now.motion.equations
    if equations.rises_push or equations.balance.parting is not None:
        return False
    return bool(((guards.order <= 1) | guards.is_border).all()) and now.motion.horizon > 0
