"""The series engine: linear motions as Taylor series cut at roundoff, events as roots of polynomials.

In one set of modes ``y' = A y + B q(t)`` with inputs that are lines, sines and exponentials: the Taylor coefficients
follow from small products, and so do those of the guards. No step error, nothing is sampled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stickslip.engines.base import Method, Task
from stickslip.engines.roots import first_root, first_touch, may_vanish
from stickslip.engines.work import BEYOND, SolverFailure, Work, grows
from stickslip.equations.guards import Guards
from stickslip.equations.guards_at_start import NEVER
from stickslip.equations.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.equations.taylor import ORDER
from stickslip.model.arrays import Array, Indices

_REMAINDER = 1e-17
_TO_LAST = np.arange(ORDER - 1.0, 0.0, -1.0)
"""How many orders there are from each one to the last but one."""

_AT_ONCE, _AT_MOST = 50_000, 1e9
"""Steps after which what was followed is handed over, and how many of them a motion may need at that pace."""

_LOG_REMAINDER = math.log(_REMAINDER)
_NOTHING, _NONE = 1e-250, 1e-267
"""Sizes below which a term counts as 0, and which 0 then has beside it."""

_BY_CHANCE = 1e-3
"""Part of what a guard becomes below which its value at the start may be small by chance."""

_WORTH = 0.3
_GROWTH = 4.0
"""How much longer than the last step the next may be."""
_TINY = np.finfo(float).tiny
_LISTED = 5


class _Step(NamedTuple):
    """Power coefficients of the states over a step of length `h`, and where in (0, 1] a guard has its first root.

    `touched` is the row whose relative velocity only touches 0 there.
    """

    coefficients: Array
    h: float
    root: float | None
    guard: int = -1
    touched: int | None = None


class Series:
    """Follow linear motions exactly."""

    def __init__(self, task: Task) -> None:
        self._max_step, self.work, self._interruption = task.max_step, Work(), task.interruption
        self._guess = math.inf
        self._speed: Array | None = None

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Follow a motion to its first event or to local time `horizon`, whichever comes first."""
        self.work.starts += 1
        watched = (guards.order < NEVER).nonzero()[0]
        ends = [0.0]
        pieces: list[Array] = []
        tau, y, hit, touched = 0.0, motion.y, False, None
        while tau < horizon and not hit and touched is None and not self._interruption.pressed:
            longest = min(horizon - tau, self._max_step)
            step = None
            bends = motion.is_rising(tau) or motion.stretch.has_waves
            # where springs and dampers act, a first step tells whether the motion is a long one
            if bends and (pieces or motion.is_polynomial) and motion.may_be_bounded:
                step = self._past_bounds(motion, guards, watched, tau, y, longest)
            if step is None:
                step = self._step(motion, guards, watched, tau, y, longest, False)
            touched = step.touched
            hit = step.root is not None and touched is None
            s, c = 1.0 if step.root is None else step.root, step.coefficients
            if s != 1.0:
                c = c * (s ** np.arange(c.shape[0]))[:, None]
            tau = horizon if s == 1.0 and step.h >= horizon - tau else tau + s * step.h
            before, y = y, motion.exact(tau, c.sum(axis=0))
            if not np.abs(y).max(initial=0.0) < BEYOND:
                raise grows(Path(np.array(ends), _padded(pieces, y.size), before, False))
            self.work.steps += 1
            pieces.append(c)
            ends.append(tau)
            if motion.has_left(tau, y):
                break
            if len(pieces) == _AT_ONCE:
                # nobody need keep a long motion whole: it goes on from here
                break
        path = Path(np.array(ends), _padded(pieces, motion.y.size), y, hit, touched=touched)
        if len(pieces) == _AT_ONCE and tau * _AT_MOST < _AT_ONCE * horizon:
            raise SolverFailure(
                f"the last {_AT_ONCE} steps took {tau:.3g} s of {horizon:.3g} s: the end is out of reach",
                "simulate a shorter time, or leave out what oscillates or decays so fast",
                path,
            )
        return path

    def _past_bounds(
        self, motion: Motion, guards: Guards, watched: Indices, tau: float, y: Array, longest: float
    ) -> _Step | None:
        """Return a step on which no guard comes to 0, whatever levels rise and sines push meanwhile.

        A level that rises with its dwell is not below what it would be without rising any more, and a sine lowers no
        guard by more than its amplitude: where that excludes a root, neither need be followed. None where the step
        would be short beside dwells and periods.
        """
        if tau == 0 and motion.stretch.has_waves and not guards.is_plain:
            # a guard that leaves 0 is told from it by what the sine does
            return None
        step = self._step(motion, guards, watched, tau, y, longest, True)
        if step.root is None:
            return step
        if guards.is_followed_frozen(step.guard):
            # what rises or swings does not change this guard
            return step
        if step.touched is not None:
            return None
        if step.root * step.h < _WORTH * max(motion.shortest_dwell, motion.stretch.longest_period):
            return None
        # up to there no guard is 0
        powers = np.arange(step.coefficients.shape[0])
        return _Step(step.coefficients * (step.root**powers)[:, None], step.root * step.h, None)

    def _step(
        self,
        motion: Motion,
        guards: Guards,
        watched: Indices,
        tau: float,
        y: Array,
        longest: float,
        frozen: bool,
    ) -> _Step:
        """Expand the motion at local time `tau`, and look for the first root of a guard within reach."""
        straight = motion.is_straight and not motion.is_rising(tau)
        polynomial = motion.is_polynomial and (frozen or straight)
        # velocities are quadratic in time, and positions cubic
        order = (3 if motion.system.placed.size else 2) if polynomial else ORDER
        if polynomial and tau == 0 and not frozen and order == 2:
            h, scale, expansion = longest, 1.0, motion.start
        else:
            scale = longest if polynomial or math.isinf(self._guess) else min(longest, self._guess)
            h, expansion = scale, motion.expand(tau, y, order, scale, frozen)
        g = guards.series(expansion)
        if frozen and motion.stretch.has_waves:
            g[0] -= guards.allowance
        if not polynomial:
            h = scale * self._reach(expansion.y, g, guards)
            if h < longest:
                # it begins and ends at times that are numbers: what many steps round adds up
                h = (tau + h) - tau
            if h < scale or scale < longest:
                # a step that ends with the motion says nothing about longer ones
                self._guess = _GROWTH * h
        self.work.rate_calls += order
        root, touched, guard, c = None, None, -1, expansion.y
        if watched.size < guards.size:
            g = g[:, watched]
        if h != scale:
            stretched = ((h / scale) ** np.arange(order + 1))[:, None]
            g, c = g * stretched, c * stretched
        if watched.size:
            if tau == 0 and not guards.is_plain:
                g = _divided(g, guards.order[watched])
            self._note_speed(motion, y)
            root, which, touches = self._first(g, motion, guards, watched)
            guard = int(watched[which])
            touched = int(guards.row[guard]) if touches else None
        if motion.stretch.is_straight and not np.count_nonzero(c[-1]):
            # a motion that is a short polynomial is kept as one
            c = c[: int(np.flatnonzero(c.any(axis=1)).max(initial=0)) + 1]
        return _Step(c, h, root, guard, touched)

    @staticmethod
    def _reach(y: Array, g: Array, guards: Guards) -> float:
        """Return the step, in units of that of the coefficients, whose remainder is below roundoff.

        The last two terms are compared with the largest one over the step; at most the step of the coefficients.
        """
        rows = guards.rows
        terms = np.abs(np.concatenate([y, g[:, rows.by_kind]], axis=1))
        if rows.others.size:
            own, scale = slice(-rows.others.size, None), guards.value_scale[rows.others]
            largest = terms[:, own].max(axis=0)
            if np.count_nonzero(scale < _BY_CHANCE * largest):
                # a force that is 0 by chance is no scale: what adds up in it is
                scale = np.maximum(scale, guards.majorant[0, rows.others])
            terms[:, own] /= np.where(scale > 0, scale, np.maximum(largest, _TINY))
        sizes = np.maximum.reduceat(terms, rows.kinds, axis=1).T
        if rows.others.size:
            sizes[-1, 0] = max(sizes[-1, 0], 1.0)
        if rows.velocities.size:
            # a drive may turn while no state does
            of_guards = sizes[-2 if rows.others.size else -1]
            of_guards[0] = max(of_guards[0], sizes[0, 0])
        last = ORDER - 1
        terms = np.log(np.maximum(sizes[:, :last], _NOTHING))
        terms -= np.log(np.maximum(sizes[:, last:].max(axis=1), _NONE))[:, None] - _LOG_REMAINDER
        # s^last times the last terms is the remainder of s^k times the term k
        terms /= _TO_LAST
        return math.exp(min(terms.max(axis=1).min(), 0.0))

    def _note_speed(self, motion: Motion, y: Array) -> None:
        speed = np.abs(y[: motion.system.n])
        self._speed = speed if self._speed is None else np.maximum(self._speed, speed)

    def _floor(self, motion: Motion, guards: Guards, some: Indices) -> Array:
        """Return what some guards have the roundoff of: the largest speeds so far, or forces at the start."""
        found, moving = guards.value_scale[some], guards.is_velocity[some]
        if np.count_nonzero(moving):
            found[moving] = (motion.system.abs_G @ self._speed)[guards.row[some[moving]]]
        return found

    def _first(
        self, g: Array, motion: Motion, guards: Guards, watched: Indices
    ) -> tuple[float | None, int, bool]:
        """Return the first root in (0, 1] of any column of power coefficients, its column, and if it only touches 0."""
        close = may_vanish(g)
        self.work.guards_excluded += g.shape[1] - close.size
        found: float | None = None
        which, touches_only = -1, False
        if not close.size:
            return None, which, touches_only
        some = watched[close]
        floors, touches = self._floor(motion, guards, some), guards.stick_at_touch[some]
        for i, floor, may_stick in zip(close.tolist(), floors.tolist(), touches.tolist(), strict=True):
            c = g[:, i]
            if found is not None:
                # only what comes before is of interest
                c = c * found ** np.arange(c.size)
            root, only = first_touch(c, floor) if may_stick else (first_root(c, floor), False)
            self.work.guards_isolated += 1
            if root is not None:
                found = root if found is None else found * root
                which, touches_only = i, only
        return found, which, touches_only


def _padded(pieces: list[Array], size: int) -> Array:
    """Return the coefficients of all steps in one array."""
    if len(pieces) == 1:
        return pieces[0][None]
    order = max((c.shape[0] for c in pieces), default=1)
    found = np.zeros((len(pieces), order, size))
    for k, c in enumerate(pieces):
        found[k, : c.shape[0]] = c
    return found


def _divided(g: Array, order: Indices) -> Array:
    """Return polynomials with their zeros at the start divided out."""
    g = g.copy()
    for k in set(order[order > 0].tolist()):
        columns = (order == k).nonzero()[0]
        g[: g.shape[0] - k, columns] = g[k:, columns]
        g[g.shape[0] - k :, columns] = 0.0
    return g


def why_no_series(system: System, loads: Loads) -> str | None:
    """Return what in a scene has no Taylor series, None if all has one."""
    named: dict[str, list[str]] = {}
    # laws that never stick before curves of those that do
    rows = system.alive.nonzero()[0]
    for j in rows[np.argsort(system.hard[rows], kind="stable")].tolist():
        named.setdefault(system.laws.characters[j].velocity_dependent, []).append(system.rows[j].name)
    for what, names in named.items():
        if what:
            listed = ", ".join(map(repr, names[:_LISTED])) + (", ..." if len(names) > _LISTED else "")
            return f"the force of {listed} depends on velocity ({what})"
    if system.dependence is not None and not system.dependence.is_linear:
        # tables have one in each region
        label = next(node.label for node in system.dependence.nodes if node.table is None).rstrip(":")
        return f"{label} depends on the state, of which no Taylor series is known"
    if loads.has_functions:
        return "a load is a function, of which no Taylor series is known"
    return None


SERIES = Method("Taylor series", Series, ("contact-force", "merged"), why_not=why_no_series)
