"""The main loop: advance to the first event or the next break, settle the modes, repeat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from stickslip.engines.base import Engine, Task
from stickslip.engines.work import LOOK_AT_SCENE, SolverFailure
from stickslip.equations.forest import Forest
from stickslip.equations.guards.at_start import ROUNDOFF
from stickslip.equations.loads.loads import Span
from stickslip.equations.mode_equations import FREE, OPEN
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.events.endings import (
    AtLimit,
    EndState,
    Jump,
    alone_at_limit,
    arrived,
    at_limit,
    at_stops_at_start,
    jumped,
    landed,
    open_from_here,
    shown_at_end,
)
from stickslip.events.impact import Struck, struck
from stickslip.events.rest import until_rest
from stickslip.events.settle import (
    Settled,
    all_pressed,
    at_rest_in_bands,
    carried_on,
    comes_to_rest,
    inputs_before,
    modes_after_break,
    settle,
    with_one,
)
from stickslip.events.situation import Situation, Uncertainty
from stickslip.model.arrays import Array, Mask, Modes
from stickslip.model.modes import Mode
from stickslip.simulation.bands import until_out_of_bands
from stickslip.simulation.borders import TOGETHER, Borders
from stickslip.simulation.local import Ending, Local
from stickslip.simulation.recorder import Recorder, cause_of
from stickslip.simulation.relaxation import Relaxation
from stickslip.simulation.timeline import Timeline
from stickslip.simulation.tolerances import ReachedSizes, Tolerances
from stickslip.simulation.watching import Failed, Watch


class Run:
    """One simulation under way: the engine advances it, `settle` says how it goes on, the recorder keeps it.

    With a forest, motions are followed part by part where possible. `now` is the motion that starts where the
    `timeline` is, and `stopped` the user's event that has stopped the run.
    """

    def __init__(
        self,
        task: Task,
        engine: Engine,
        recorder: Recorder,
        span: Span,
        wanted: Tolerances,
        watch: Watch | None,
        forest: Forest | None,
    ) -> None:
        system = task.system
        self.system, self.loads, self.engine, self.recorder = system, task.loads, engine, recorder
        self._interruption, self._watch = task.interruption, watch
        self.timeline, self._wanted = Timeline(system, span.start, span.stop), wanted
        self._local: Local | None = None
        if forest is not None:
            self._local = Local(forest, engine.work, task.interruption, recorder, self.timeline, watch, wanted.margin)
        # the largest velocity of each body so far, how far each state was from its start, and majorants of the rates
        self._first = system.at_start()
        self._fastest = np.abs(self._first[: system.n])
        self._moved, self._rate_majorants = np.zeros(system.size), np.zeros(system.size)
        self.most_guards = self.samples = 0
        self.now: Settled | None = None
        tables = system.dependence is not None and system.dependence.tables
        self._borders = Borders(system, task.loads, wanted.scale) if tables else None
        self._relaxation = Relaxation(system)
        self.stopped: str | None = None
        # whether the motion from here on must not be followed part by part
        self._as_a_whole = False

    def to_end(self) -> None:
        """Follow the motion to the end of the time span, or to where an event of the user stops it: the main loop."""
        self.begin()
        while not self.timeline.is_over and self.stopped is None:
            self.advance()
            if self._interruption.show is not None:
                self._interruption.show(0.0)
            if self._interruption.pressed:
                raise KeyboardInterrupt

    def begin(self) -> None:
        """Settle the modes at the start."""
        system, t = self.system, self.timeline.t
        nothing = np.zeros(system.m, dtype=bool)
        since = t - np.array([row.rested for row in system.rows])
        start = Situation(t, system.at_start(), None, since, nothing, nothing, moves_on=system.starts_slipping)
        if system.sampled:
            q = inputs_before(system, self.loads.after(t), start)
            start = start._replace(y=self._sample(t, q, start.y))
        before = start.y.copy()
        hit, sides, impact = self._stops_at_start(start.y)
        # as later on, a row that an impact brings into Karnopp's dead band moves on
        struck_rows = system.abs_G @ np.abs(start.y - before)[: system.n] > 0
        situation = start._replace(sides=sides, moves_on=system.starts_slipping | struck_rows)
        self.now = replace(self._settled(situation), impact=impact)
        for j in hit.nonzero()[0].tolist():
            self.recorder.note(t, j, Mode.OPEN, int(self.now.labels[j]), "impact")

    def _stops_at_start(self, y: Array) -> tuple[Mask, Modes, Struck | None]:
        """Let stops rebound, in place, that start at a limit and move into it.

        Returns which stops these are, at which limits stops rest then, and what the impact did.
        """
        system, t = self.system, self.timeline.t
        q = self.loads.after(t).at(t)
        u = system.drive_velocities(q)
        sides = at_stops_at_start(system, y, q, t)
        # A stop that was closed when an earlier run ended makes no impact: its velocity is roundoff. That is a part of
        # the bodies' speeds alone: drives at which the stop rests are as fast.
        rough = ROUNDOFF * (system.abs_G @ np.abs(y[: system.n]))
        hit: Mask = sides * system.relative_velocity(y, q) > rough
        slowest = self._slowest_rebound
        impact = struck(system, y[: system.n], u, u, sides, hit, slowest) if hit.any() else None
        if impact is not None:
            y[: system.n] = impact.v
        sides[sides * system.relative_velocity(y, q) < -slowest] = 0
        return hit, sides, impact

    def advance(self) -> None:
        """Follow the motion to its end, keep it, and settle the next one."""
        now = self.now
        assert now is not None
        self.most_guards = max(self.most_guards, now.guards.armed)
        if self._local is not None and not self._as_a_whole and self._local.takes(now):
            end = self._local.follow(now, self.loads, self._uncertainty)
            if end is not None:
                self._go_on_from_parts(self._local, end)
                return
        self._as_a_whole = False
        path, relaxed = self._path(now)
        t = self._end(now.motion, path, relaxed)
        if self._watch is not None:
            try:
                path, t = self._note_crossings(now.motion, path, t, self._watch)
            except Failed as failed:
                known = now.motion.until(path, failed.tau)
                raise SolverFailure(str(failed), LOOK_AT_SCENE, known) from failed.__cause__
        if self._relaxation.rows.size:
            self._relaxation.note(now.motion, path)
        self.recorder.keep(now, path, t)
        if self._wanted.has_errors or self._wanted.guessed.any():
            self._fastest = np.maximum(self._fastest, path.largest[: self.system.n])
        if self._wanted.may_hide:
            self._moved = np.maximum(self._moved, np.abs(path.points - self._first).max(axis=0))
            self._rate_majorants = np.maximum(self._rate_majorants, now.motion.rate_majorants())
        if self.stopped is not None:
            self.timeline.t = t
            return
        self._go_on(now, path, t, relaxed)

    @property
    def reached(self) -> ReachedSizes:
        """The sizes that the run has reached."""
        system, duration = self.system, self.timeline.duration
        ends = [system.n, system.first_bristle, system.first_block]
        velocities, distances, bristles, moved = np.split(self._moved, ends)
        blocks = np.where(moved > 0, moved + np.abs(self._first[system.first_block :]), 0.0)
        blocks[system.clocked - system.first_block] = 0.0
        if system.dependence is not None and not system.dependence.is_linear:
            # the majorant of a function is not known
            blocks[:] = 0.0
        changes = self._rate_majorants * duration
        return ReachedSizes(
            velocities,
            distances,
            bristles,
            blocks,
            float(changes[: system.n].max(initial=0.0)),
            changes[system.first_block :],
        )

    def _path(self, now: Settled) -> tuple[Path, list[int]]:
        """Return the path of a motion while its modes hold, and the rows that have relaxed to rest at its end."""
        motion = now.motion
        path = self.engine.advance(motion, now.guards, motion.horizon)
        if not np.isfinite(path.last).all():
            raise ArithmeticError(
                "positions or velocities are no longer finite; make forces, stiffnesses or the time smaller"
            )
        motion.hold_samples(path.last)
        if self._borders is not None:
            path = self._borders.cut(motion, path)
        path = until_out_of_bands(motion, now.guards, path)
        wanted = self._wanted
        cut, relaxed = until_rest(motion, now.guards, path, wanted.margin)
        if relaxed and wanted.guessed.any():
            fastest = np.maximum(self._fastest, path.largest[: self.system.n])
            return until_rest(motion, now.guards, path, wanted.relaxation_margin(fastest))
        return cut, relaxed

    @property
    def _slowest_rebound(self) -> Array:
        """Relative velocities (m,) below which stops do not rebound."""
        return self._wanted.slowest_rebound(self._fastest) if self.system.has_stops else self._wanted.margin

    @staticmethod
    def _end(motion: Motion, path: Path, relaxed: list[int]) -> float:
        """Return the time at which a path ends."""
        tau, stop = float(path.taus[-1]), motion.segment.stop
        t = motion.t + tau
        if (tau >= motion.horizon and not (path.has_event or relaxed)) or stop - t <= TOGETHER * abs(stop):
            # the exact time of the break: the sum that led to it has been rounded
            return stop
        return t

    def _note_crossings(self, motion: Motion, path: Path, t: float, watch: Watch) -> tuple[Path, float]:
        """Note the events of the user along a path; return the path and its end, cut where an event stops the run."""
        for one in watch.crossings(motion, path):
            at = t if one.tau >= path.taus[-1] else motion.t + one.tau
            self.recorder.note_user(float(at), one.event.name, one.sign, one.stays)
            if one.event.stop:
                self.stopped = one.event.name
                if one.tau < path.taus[-1]:
                    path = motion.until(path, one.tau)
                return path, at
        return path, t

    def _go_on_from_parts(self, local: Local, ending: Ending) -> None:
        """Settle the whole scene at the end of a motion that was followed part by part."""
        motion = local.now.motion
        end, self._as_a_whole, crossed, self.stopped = ending
        assert end.labels is not None and end.was is not None
        self.most_guards = max(self.most_guards, local.most_guards)
        t, before = end.t, end.labels
        self.now = replace(local.now, labels=before)
        self.timeline.go_to(t, bool(end.fired.any()))
        if self.stopped is not None or self.timeline.is_over or self._interruption.pressed:
            return
        self.timeline.restarts += 1
        at_end = EndState(t, t - motion.t, end.y, end.was)
        self._fastest = np.maximum(self._fastest, end.was[: self.system.n])
        jump = jumped(motion, self.loads, at_end, before, crossed, self._slowest_rebound, None)
        stops = self._come_to_rest(t, local.modes, jump, partial(local.arrived, t))
        touching = (end.touching | (before == 0)) & ~jump.parted | stops
        labels = np.where(stops, 0, before)
        situation = end._replace(y=jump.y, labels=labels, touching=touching, sides=jump.sides, arrived=stops)
        self._settle_all(situation, before, [], jump)

    def _come_to_rest(self, t: float, modes: Modes, jump: Jump, arrived_of: Callable[[Mask], Mask]) -> Mask:
        """Tell which open rows come to rest at the end of a motion: `arrived_of` finds them, or they jump to rest."""
        q = self.loads.after(t).at(t)
        comes = arrived_of(open_from_here(self.system, modes, q)) & ~jump.parted
        return np.asarray(comes | landed(self.system, modes, jump, q))

    def _go_on(self, now: Settled, path: Path, t: float, relaxed: list[int]) -> None:
        """Go on from the end of a path: in the same modes, or with one mode changed, or with all rows settled anew."""
        motion = now.motion
        self.timeline.go_to(t, path.has_event and not now.guards.is_border.any())
        if self.timeline.is_over:
            return
        self.timeline.restarts += 1
        blocks = self._blocks_at_end(motion, path, t)
        following = None if path.has_event or relaxed else self._carried_on(now, path, t, blocks)
        if following is not None:
            self.now = following
            return
        before = shown_at_end(motion, path, now.labels)
        since = np.where(before == 0, motion.since, t)
        alone = None if relaxed or t >= motion.segment.stop else alone_at_limit(now.guards, path)
        if alone is not None and self._enter_regions(now, path.last, t):
            following = with_one(now, t, path.last, since, *alone, self._uncertainty.velocity_uncertainty)
            if following is not None:
                self.now, j = following, alone[0]
                if following.labels[j] != before[j]:
                    self._note(t, j, int(before[j]), True, False, None)
                return
        at = at_limit(motion, now.guards, path, relaxed)
        situation, jump = self._situation(now, path, t, before, since, at, blocks)
        self._settle_all(situation, before, relaxed, jump)

    def _carried_on(self, now: Settled, path: Path, t: float, blocks: Array) -> Settled | None:
        """Return the motion that follows a path without an event at its end, None where rows have to be settled."""
        after, modes = self.loads.after(t), now.motion.equations.modes
        at_sample = self.loads.is_only_sample(t)
        # before the break, an engine may have handed over only a part of the motion, or the path ends at a corner of a
        # table, which is continuous
        if t < now.motion.segment.stop or at_sample:
            holds = modes.max(initial=0) < OPEN and all_pressed(self.system, after, t)
            # a sample may push a row back that comes to rest there
            if holds and at_sample:
                holds = not comes_to_rest(now, t, path.last, path.largest, after.at(t))
            following = modes if holds else None
        else:
            following = modes_after_break(now, after, t, path.last, path.largest)
        if following is None:
            return None
        y = np.concatenate([path.last[: self.system.first_block], blocks])
        self._enter_regions(now, y, t)
        # the segment is read again: now it has the regions just entered
        return carried_on(now, self.loads.after(t), t, y, following)

    def _enter_regions(self, now: Settled, y: Array, t: float) -> bool:
        """Enter the regions of tables at the end of a motion, and tell whether all are the same as before."""
        if self._borders is None:
            return True
        nothing = np.zeros(self.system.m, dtype=bool)
        self._borders.place(Situation(t, y, now.labels, now.motion.since, nothing, nothing))
        return self.loads.after(t).table_regions == now.motion.table_regions

    def _situation(
        self, now: Settled, path: Path, t: float, before: Modes, since: Array, at: AtLimit, blocks: Array
    ) -> tuple[Situation, Jump]:
        """Return what is known at the end of a path, and what impacts and jumping drives do there."""
        motion, system, uncertain = now.motion, self.system, now.guards.velocity_uncertainty
        errors = self._wanted.step_errors(path.last)
        end = EndState(t, float(path.taus[-1]), path.last, path.largest)
        jump = jumped(motion, self.loads, end, now.labels, at.crossed, self._slowest_rebound, errors)
        # rows that show STUCK are at rest; those that no force can hold, only if their velocity is a solver's error
        at_rest = (before == 0) & ~jump.parted
        if motion.equations.open.size or not system.all_hard:
            w = system.relative_velocity(path.last, motion.loads(float(path.taus[-1])))
            rest = self._wanted.velocity_resolution
            rest = rest if uncertain is None else np.maximum(rest, uncertain)
            at_rest &= ((motion.equations.modes != OPEN) & system.hard) | (np.abs(w) <= rest)
        stops = self._come_to_rest(
            t,
            motion.equations.modes,
            jump,
            lambda some: arrived(motion, path, now.labels, some, uncertain),
        )
        # a row that comes to rest in the instant in which an impact parts it moves on
        touching = at.touching & ~jump.parted | at_rest | stops
        y = jump.y
        if system.sampled:
            y = np.concatenate([y[: system.first_block], blocks])
        labels, regions = np.where(stops, 0, before), motion.equations.regions
        moves_on = self._moves_on(now, t, at.fired, jump) if system.has_dead_bands else None
        situation = Situation(
            t,
            y,
            labels,
            since,
            touching,
            at.fired,
            path.largest,
            regions,
            jump.sides,
            path.touched,
            stops,
            moves_on,
        )
        return situation, jump

    def _moves_on(self, now: Settled, t: float, fired: Mask, jump: Jump) -> Mask:
        """Tell which rows move on through Karnopp's dead band: those that have left rest in it, or that were struck."""
        system = self.system
        w = system.relative_velocity(jump.y, self.loads.after(t).at(t))
        inside = np.isin(np.arange(system.m), now.guards.in_band) & ~fired & (now.labels * w > 0)
        return np.asarray(inside | jump.parted & jump.hit.any())

    @property
    def _uncertainty(self) -> Uncertainty:
        """What the errors of the run leave uncertain now."""
        return self._wanted.uncertainty(self._fastest)

    def _settled(self, situation: Situation) -> Settled:
        situation = at_rest_in_bands(self.system, self.loads, situation)
        if self._borders is not None:
            self._borders.place(situation)
        found = settle(self.system, self.loads.after(situation.t), situation, self._uncertainty)
        last = None if self.now is None else self.now.motion
        self._relaxation.check(last, found.motion, self._wanted.velocity_resolution)
        return found

    def _settle_all(self, situation: Situation, before: Modes, relaxed: list[int], jump: Jump) -> None:
        """Settle the whole scene, and note what has changed."""
        t, fired, settled = situation.t, situation.fired, self._settled(situation)
        self.now = settled if jump.impact is None else replace(settled, impact=jump.impact)
        changed = (self.now.labels != before) & (self.now.motion.equations.modes != FREE)
        for j in (changed | jump.hit).nonzero()[0].tolist():
            self._note(t, j, int(before[j]), bool(fired[j]), j in relaxed, jump)

    def _blocks_at_end(self, motion: Motion, path: Path, t: float) -> Array:
        """Return the states of blocks at the end of a path, after the samples that are taken there."""
        system = self.system
        if not system.sampled or t != motion.segment.stop:
            return path.last[system.first_block :]
        q = motion.inputs(float(path.taus[-1]), path.last)[: system.inputs]
        return self._sample(t, q, path.last)[system.first_block :]

    def _sample(self, t: float, q: Array, y: Array) -> Array:
        self.samples += sum(block.is_due(t, self.timeline.start) for _, block, _ in self.system.sampled)
        return self.system.sample(t, self.timeline.start, q, y)

    def _note(self, t: float, j: int, before: int, fired: bool, relaxed: bool, jump: Jump | None) -> None:
        assert self.now is not None
        after = int(self.now.labels[j])
        if jump is not None and jump.hit[j]:
            cause = "impact"
        elif self.system.is_stop[j] and after == Mode.OPEN:
            cause = "force 0" if fired else "leaves with another event"
        elif self.system.is_gap[j] or self.system.is_stop[j]:
            cause = "leaves" if after == Mode.OPEN else "touches"
        elif self.now.motion.equations.modes[j] == OPEN:
            cause = "open"
        elif relaxed:
            cause = "relaxation"
        elif before == 0 and self.system.is_one_way[j]:
            cause = "force 0"
        elif after and jump is not None and jump.parted[j]:
            cause = "jump of velocities"
        else:
            cause = cause_of(before, after, fired)
        self.timeline.note(j)
        self.recorder.note(t, j, before, after, cause)
