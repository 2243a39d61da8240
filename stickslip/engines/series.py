"""The series engine: linear motions as Taylor series cut at roundoff, events as roots of polynomials.

In one set of modes ``y' = A y + B q(t)`` with inputs that are lines, sines and exponentials: the Taylor coefficients
follow from small products, and so do those of the guards. No step error, nothing is sampled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stickslip.engines.base import Method, Task
from stickslip.engines.progress import CALLS_AT_MOST
from stickslip.engines.roots import first_root, first_touch, floor_of_force, may_vanish
from stickslip.engines.work import BEYOND, SolverFailure, Work, grows
from stickslip.equations.guards.at_start import NEVER
from stickslip.equations.guards.guards import Guards
from stickslip.equations.loads.loads import Loads
from stickslip.equations.motion import Expansion, Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.equations.taylor import ORDER
from stickslip.model.arrays import Array, Indices

_REMAINDER = 1e-17  # remainder of a series over its step, as a part of its largest term
_LAST = ORDER - 1  # the first of the two orders from which the remainder is estimated

# Steps after which a path is handed over, and how many a whole motion may need at the pace of these: they take as many
# evaluations as a solver may.
_AT_ONCE, _AT_MOST = 50_000, CALLS_AT_MOST / ORDER

_LOOK_FOR_REST = 16  # steps after which it is looked whether all has come to rest

_NOTHING = 1e-267  # a remainder below this counts as 0
_LEADING = 4  # order up to which terms mostly decide the step; if all are 0, later ones are looked at, too
_WORTH = 0.3
_SHORTER, _SHORTEST = 1e-6, 1e-200  # a scale that is too long is shortened by the first, down to the second in s
_GROWTH = 4.0  # how much longer than the last step the next may be
_TINY = np.finfo(float).tiny
_LISTED = 5


class _Step(NamedTuple):
    """Power coefficients of the states over a step of length `h`, and where in (0, 1] a guard has its first root.

    `touched` is the row whose relative velocity only touches 0 there.
    """

    terms: Array
    h: float
    root: float | None
    guard: int = -1
    touched: int | None = None

    def up_to_root(self) -> tuple[Array, float]:
        """Return coefficients and length of the step up to its root, or of all of it."""
        if self.root is None or self.root == 1.0:
            return self.terms, self.h
        return self.terms * (self.root ** np.arange(self.terms.shape[0]))[:, None], self.root * self.h


class Series:
    """Follow linear motions exactly."""

    def __init__(self, task: Task) -> None:
        self._max_step, self.work, self._interruption = task.max_step, Work(), task.interruption
        self._guess = math.inf
        self._speed: Array | None = None

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Follow a motion to its first event or to local time `horizon`, whichever comes first."""
        ends, pieces = [0.0], list[Array]()
        tau, y, hit, touched = 0.0, motion.y, False, None
        while tau < horizon and not hit and touched is None and not self._interruption.pressed:
            step = self._next(motion, guards, tau, y, min(horizon - tau, self._max_step), bool(pieces))
            touched = step.touched
            hit = step.root is not None and touched is None
            c, h = step.up_to_root()
            tau = horizon if h == step.h and h >= horizon - tau else tau + h
            # summed row by row: states that are equal stay equal to the last bit
            before, y = y, motion.exact(tau, c.sum(axis=0))
            if not np.abs(y).max(initial=0.0) < BEYOND:
                raise grows(Path(np.array(ends), _padded(pieces, y.size), before, False))
            self.work.steps += 1
            if len(c) == ORDER + 1 and motion.segment.is_straight and not np.count_nonzero(c[-1]):
                # a motion that is a short polynomial is kept as one
                c = c[: max(np.flatnonzero(c.any(axis=1)).tolist(), default=0) + 1]
            # a copy, so that the watched quantities and guards beside the states are not kept
            pieces.append(np.ascontiguousarray(c))
            ends.append(tau)
            if len(pieces) % _LOOK_FOR_REST == 0 and math.isinf(self._max_step) and not hit and touched is None:
                rest = motion.at_rest(tau, y)
                if rest is not None:
                    # no guard changes any more
                    tau, y = horizon, rest
                    pieces.append(rest[None])
                    ends.append(horizon)
                    break
            if motion.has_left(tau, y) or len(pieces) == _AT_ONCE:
                # so that a long motion need not be kept whole: the next path goes on from here
                break
        guard = step.guard if hit else None
        path = Path(np.array(ends), _padded(pieces, y.size), y, hit, touched=touched, guard=guard)
        if len(pieces) == _AT_ONCE and tau * _AT_MOST < _AT_ONCE * horizon:
            raise SolverFailure(
                f"the last {_AT_ONCE} steps took {tau:.3g} s of {horizon:.3g} s: the end is out of reach",
                "simulate a shorter time, or leave out what oscillates or decays so fast",
                path,
            )
        return path

    def _next(self, motion: Motion, guards: Guards, tau: float, y: Array, longest: float, is_begun: bool) -> _Step:
        """Return the step from local time `tau` on; where possible, bound rising levels and sines, not follow them."""
        bends = motion.is_rising(tau) or motion.segment.has_sines
        # where springs and dampers act, bounds are tried after a first step only: they are worth it in long motions
        if bends and (is_begun or motion.is_polynomial) and motion.may_be_bounded:
            step = self._past_bounds(motion, guards, tau, y, longest)
            if step is not None:
                return step
        return self._step(motion, guards, tau, y, longest, False)

    def _past_bounds(self, motion: Motion, guards: Guards, tau: float, y: Array, longest: float) -> _Step | None:
        """Return a step on which no guard comes to 0, however levels rise and sines push meanwhile.

        A level that rises with its dwell is never below the level frozen at `tau`, and a sine lowers no guard by more
        than its amplitude does. Where these bounds exclude a root, neither need be followed. None where the step
        would be short beside dwell times and periods.
        """
        if tau == 0 and motion.segment.has_sines and not guards.is_plain:
            # whether a guard leaves 0 at the start depends on the sine
            return None
        step = self._step(motion, guards, tau, y, longest, True)
        if step.root is None or guards.is_followed_frozen(step.guard):
            # rising levels and sines do not change this guard: its root is the true one
            return step
        if step.touched is not None:
            return None
        if step.root * step.h < _WORTH * motion.dwell_times[:1].max(initial=motion.segment.longest_period):
            return None
        # up to there no guard is 0
        terms, h = step.up_to_root()
        return _Step(terms, h, None)

    def _step(self, motion: Motion, guards: Guards, tau: float, y: Array, longest: float, frozen: bool) -> _Step:
        """Expand the motion at local time `tau`, and look for the first root of a guard within reach."""
        straight = motion.is_straight and not motion.is_rising(tau)
        polynomial = motion.is_polynomial and (frozen or straight)
        # velocities are quadratic in time, and positions cubic
        order = (3 if motion.system.placed.size else 2) if polynomial else ORDER
        if polynomial and tau == 0 and not frozen and order == 2:
            h, scale, expansion = longest, 1.0, motion.start
        else:
            scale = longest if polynomial or math.isinf(self._guess) else min(longest, self._guess)
            if polynomial or scale < longest:
                expansion = motion.expand(tau, y, order, scale, frozen)
            else:
                scale, expansion = _in_numbers(motion, tau, y, scale, frozen)
            h = scale
        terms, g = expansion.y, guards.series(expansion)
        if frozen and motion.segment.has_sines:
            g = np.concatenate([g[:1] - guards.allowance, g[1:]])
        if not polynomial:
            h = scale * self._step_limit(expansion.y, g, guards)
            if h < longest:
                # make h the exact difference of two times: the roundoff of many steps would add up
                h = (tau + h) - tau
            if h < scale or scale < longest:
                # a step that ends with the motion says nothing about longer ones
                self._guess = _GROWTH * h
        self.work.rate_calls += order
        if h != scale:
            stretched = ((h / scale) ** np.arange(order + 1))[:, None]
            terms, g = terms * stretched, g * stretched
        speed = np.abs(y[: motion.system.n])
        self._speed = speed if self._speed is None else np.maximum(self._speed, speed)
        if not guards.is_plain:
            g = _divided(g, guards.order if tau == 0 else np.where(guards.order == NEVER, NEVER, 0))
        root, guard, touches = self._first_root(g, motion, guards, h if tau == 0 else None)
        return _Step(terms, h, root, guard, int(guards.row[guard]) if touches else None)

    @staticmethod
    def _step_limit(y: Array, g: Array, guards: Guards) -> float:
        """Return the step whose remainder is below roundoff, as a part of the step of the coefficients, at most 1.

        The last two terms are compared with the largest one over the step.
        """
        rows = guards.rows
        terms = np.abs(np.concatenate([y, g], axis=1))
        first_block = guards.motion.system.first_block
        if first_block < y.shape[1]:
            # states of blocks have units of their own
            blocks = terms[:, first_block : y.shape[1]]
            blocks /= np.maximum(blocks.max(axis=0), _TINY)
        scale = guards.step_scale
        if scale.size:
            own = terms[:, y.shape[1] :][:, rows.forces]
            own /= scale if min(scale.tolist()) > 0 else _measures(own, scale)
        firsts, kinds = rows.kinds
        sizes = np.maximum.reduceat(terms, firsts, axis=1).T.tolist()
        limit = 1.0
        for kind, size in zip(kinds, sizes, strict=True):
            left = max(size[_LAST:])
            if left < _NOTHING:
                continue
            largest = size[0]
            if kind == "force":
                largest = max(largest, 1.0)
            elif kind == "velocity":
                # measured by its own size, too: a drive may move while no body does
                largest = max(largest, sizes[0][0])
            # s^_LAST times the last terms is to be _REMAINDER times s^k times term k
            found = 0.0
            for k, term in enumerate([largest, *size[1:_LAST]]):
                found = max(found, (term / left * _REMAINDER) ** (1.0 / (_LAST - k)))
                if k >= _LEADING and found:
                    break
            limit = min(limit, found)
        return limit

    @staticmethod
    def _roundoff_scale(guards: Guards, i: int, h0: float | None, fastest: Array) -> float:
        """Return the size of which a guard's roundoff is a part: the largest speeds so far, or forces.

        In the first step, of length `h0`, a border that leaves 0 is measured from its value at the start. So it has
        the roundoff of a velocity times that length. `fastest` are the majorants of relative velocities so far.
        """
        if h0 is not None and guards.is_border[i] and guards.order[i] == 1:
            return float(guards.majorant[1, i]) * h0
        if guards.is_velocity[i]:
            return float(fastest[guards.row[i]])
        return floor_of_force(float(guards.value_scale[i]), float(guards.majorant[0, i]))

    def _first_root(self, g: Array, motion: Motion, guards: Guards, h0: float | None) -> tuple[float | None, int, bool]:
        """Return the first root in (0, 1] of any guard, which guard it is, and if it only touches 0."""
        close, bernstein = may_vanish(g)
        self.work.guards_excluded += g.shape[1] - close.size
        found: float | None = None
        which, touches_only = -1, False
        if not close.size:
            return None, which, touches_only
        may_stick, fastest = guards.stick_at_touch, motion.system.abs_G @ self._speed
        columns = list(zip(close.tolist(), bernstein.T, strict=True))
        if len(columns) > 1:
            # begin with the guard whose root seems to come first: of others only earlier roots matter
            columns.sort(key=lambda one: float(one[1][0] - one[1][-1]) / (float(one[1][0]) or 1.0), reverse=True)
        for i, b in columns:
            c, own = g[:, i], b
            if found is not None:
                c, own = c * found ** np.arange(c.size), None
            scale = self._roundoff_scale(guards, i, h0, fastest)
            root, only = first_touch(c, scale, own) if may_stick[i] else (first_root(c, scale, own), False)
            self.work.guards_isolated += 1
            if root is not None:
                found = root if found is None else found * root
                which, touches_only = i, only
        return found, which, touches_only


def _in_numbers(motion: Motion, tau: float, y: Array, longest: float, frozen: bool) -> tuple[float, Expansion]:
    """Return a scale and the series on it: the longest scale on which no term overflows."""
    scale = longest
    with np.errstate(over="ignore", invalid="ignore"):
        while True:
            expansion = motion.expand(tau, y, ORDER, scale, frozen)
            if scale < _SHORTEST or np.isfinite(expansion.y[-1]).all():
                return scale, expansion
            scale *= _SHORTER


def _measures(terms: Array, scale: Array) -> Array:
    """Return the units in which terms are measured: their scales, or the largest terms where a scale is 0."""
    return np.where(scale > 0, scale, np.maximum(terms.max(axis=0), _TINY))


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
    """Return polynomials with their zeros at the start divided out; those that stay 0 are constants."""
    g = g.copy()
    for k in set(order[order > 0].tolist()):
        columns = (order == k).nonzero()[0]
        if k == NEVER:
            g[:, columns] = np.eye(g.shape[0], 1)
            continue
        g[: g.shape[0] - k, columns] = g[k:, columns]
        g[g.shape[0] - k :, columns] = 0.0
    return g


def why_no_series(system: System, loads: Loads) -> str | None:
    """Return what in a scene has no Taylor series, None if all has one."""
    named: dict[str, list[str]] = {}
    # name laws that never stick before kinetic curves of laws that do
    rows = system.alive.nonzero()[0]
    for j in rows[np.argsort(system.hard[rows], kind="stable")].tolist():
        named.setdefault(system.laws.characters[j].velocity_dependent, []).append(system.rows[j].name)
    for what, names in named.items():
        if what:
            listed = ", ".join(map(repr, names[:_LISTED])) + (", ..." if len(names) > _LISTED else "")
            return f"the force of {listed} depends on velocity ({what})"
    if system.dependence is not None and not system.dependence.is_linear:
        # tables have a Taylor series in each region
        label = next(node.label for node in system.dependence.nodes if node.table is None).rstrip(":")
        return f"{label} depends on the state, of which no Taylor series is known"
    if loads.has_functions:
        return "a load is a function, of which no Taylor series is known"
    return None


SERIES = Method("Taylor series", Series, ("contact-force", "merged"), why_not=why_no_series)
