"""Motions near by: of scenes and from starts that differ a little. Weighted sums over them are derivatives."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.loads.loads import Loads, Segment
from stickslip.equations.mode_equations import equations_in
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.model.arrays import Array, Mask
from stickslip.simulation.result import Result
from stickslip.studies.derivatives.directions import CENTRAL, MIRRORED, PART, Direction
from stickslip.studies.derivatives.steep import least_change
from stickslip.studies.derivatives.varied import VariedPiece

# A quantity: a function of a motion, local times (k,) and states (size, k). The last axis of its values is time.
OfMotion = Callable[[Motion, Array, Array], Array]

REST = 1e-11  # part of the speeds of a motion below which a velocity is 0

# If a relative velocity is smaller than this many times the amount by which it differs in scenes near by, its friction
# force may bend too much between these scenes.
_NEAR_ZERO = 100.0

_PART_OF_MOTION = 1e-4  # step of a finite difference, as a part of the size of the motion

# Functions may bend within any small part of large arguments. There steps are shortened by the first number, at most so
# many times, until differences are the same but for the third.
_SHORTER, _TRIES, _SAME = 32.0, 4, 1e-8

_TINY = np.finfo(float).tiny


def total(parts: Sequence[Any]) -> Any:
    """Return the sum of weighted values near by in their order: a central difference of a constant is exactly 0."""
    return sum(parts[1:], parts[0]) if parts else 0.0


def _settled(differences: Iterator[Any]) -> Any:
    """Return the first of differences over shorter and shorter steps that the next one leaves as it is.

    Where they do not settle before roundoff grows, it is the one that changes least.
    """
    best = last = next(differences)
    least = np.inf
    for one in differences:
        change, size = float(np.abs(one - last).max(initial=0.0)), float(np.abs(one).max(initial=0.0))
        if change <= _SAME * size:
            return last
        if change < least:
            best, least = one, change
        last = one
    return best


def _counts(loads: Loads) -> list[int]:
    """Return how often each load breaks."""
    return [len(breaks) for breaks in loads.breaks_of]


class Nearby:
    """The motions near a simulated one, in some directions."""

    def __init__(self, result: Result, directions: Sequence[Direction]) -> None:
        self.result, self.trajectory = result, result.trajectory
        self.system: System = self.trajectory.system
        if self.system.sampled:
            raise ValueError("sensitivities: sampled blocks have no derivatives here; blocks in continuous time have")
        self.directions = list(directions)
        # directions in which loads of the scenes near by have another number of breaks
        counts = _counts(self.trajectory.loads)
        self.lost_breaks = [
            k for k, one in enumerate(directions) if any(_counts(loads) != counts for _, _, loads in one.near)
        ]
        self.near_ones = [() if k in self.lost_breaks else one.near for k, one in enumerate(directions)]
        self.count = len(self.directions)
        self._beside: tuple[Motion | None, dict[int, list[tuple[float, Motion]]]] = None, {}
        # of the number that changes in each direction
        self.sizes = np.array([one.size for one in self.directions])
        # sizes along the whole motion: a state that starts from 0 is not small
        size = np.max([piece.kept_path.largest for piece in self.trajectory.pieces], axis=0)
        n, first = self.system.n, self.system.first_bristle
        self.state_sizes = np.empty(self.system.size)
        for group in (slice(n), slice(n, first), slice(first, None)):
            self.state_sizes[group] = size[group].max(initial=0.0) or 1.0
        rising = self.system.dwell[self.system.dwell > 0]
        self._dwell = float(rising.min(initial=np.inf))
        speeds = [law.core.stribeck_velocity for law in self.system.laws.laws]
        finest = float(self.system.laws.resolution.min(initial=np.inf))
        # speed within which friction forces bend
        self.bend = min([*(one for one in speeds if one is not None), finest])

    def segment_after(self, t: float, loads: Loads) -> Segment:
        """Return the segment of loads near by with the same number as the nominal segment after `t`."""
        number = bisect_right(self.trajectory.loads.every_break, t)
        span = self.trajectory.span
        # loads that break together here may break one after the other there
        ends = [span.start, *loads.every_break, span.stop]
        return loads.after(0.5 * (ends[number] + ends[number + 1]))

    def motion_of(self, number: int) -> Motion:
        """Return the motion of a piece, with its tables in the regions in which they were."""
        loads, dependence = self.trajectory.loads, self.system.dependence
        if dependence is not None and dependence.tables:
            x = self.looked_up(number, np.array([0.5]))[:, 0]
            loads.table_regions = tuple(dependence.region(k, one) for k, one in enumerate(x.tolist()))
        found = self.trajectory.motion(number)
        loads.table_regions = None
        return found

    def looked_up(self, number: int, parts: Array) -> Array:
        """Return the arguments of the tables along a piece, a line each, at parts of its length."""
        piece = self.trajectory.pieces[number]
        taus = parts * piece.end
        return self.trajectory.motion(number).looked_up(taus, piece.kept_path.at(taus).T)

    def near(self, motion: Motion, k: int) -> list[tuple[float, Motion]]:
        """Return the motions of the scenes near by in direction `k`, in the modes of a motion and from its state."""
        if self._beside[0] is not motion:
            # only those of the last motion are kept: they are needed many times
            self._beside = motion, {}
        if k not in self._beside[1]:
            self._beside[1][k] = self._made_near(motion, k)
        return self._beside[1][k]

    def _made_near(self, motion: Motion, k: int) -> list[tuple[float, Motion]]:
        found = []
        for weight, system, loads in self.near_ones[k]:
            equations = equations_in(motion.equations.modes, system, motion.equations.regions)
            segment = self.segment_after(motion.t, loads)
            segment.table_regions = motion.table_regions
            found.append((weight, Motion(equations, segment, motion.t, motion.y, motion.since)))
        return found

    def _along_states(
        self, quantity: OfMotion, motion: Motion, taus: Array, y: Array, S: Array, is_linear: bool
    ) -> Any:
        """Return the derivative of a quantity along S, 0 where nothing changes.

        If the quantity is linear in the state (`is_linear`), the step is long: that makes roundoff small.
        """
        part = float((np.abs(S) / self.state_sizes[:, None]).max(initial=0.0))
        if not part > 0:
            return 0.0

        def difference(h: float) -> Any:
            moved = [(weight / h, y + offset * h * S) for offset, weight in CENTRAL]
            return total([weight * quantity(motion, taus, motion.exact(taus, at)) for weight, at in moved])

        if is_linear:
            return difference(1.0 / part)
        bends = float(np.abs(self.system.G @ S[: self.system.n]).max(initial=0.0)) / self.bend
        h = min(_PART_OF_MOTION / part, PART / bends if bends > 0 else np.inf)
        of = self.system.dependence
        if of is None or of.is_linear:
            return difference(h)
        return _settled(difference(h / _SHORTER**k) for k in range(_TRIES + 1))

    def along_ages(self, motion: Motion, since: Array, y: Array) -> list[tuple[float, Motion, Array]]:
        """Return weights, motions and states whose quantities add up to the derivative along `since`."""
        found = []
        # the step is a part of the shortest dwell time, which may be short beside the motion
        part = float(np.abs(since).max(initial=0.0)) / self._dwell
        if part > 0 and (self.system.dwelling.size or motion.has_law):
            h = _PART_OF_MOTION / part
            for offset, weight in CENTRAL:
                ages = motion.since + offset * h * since
                moved = Motion(motion.equations, motion.segment, motion.t, motion.y, ages)
                found.append((weight / h, moved, y))
        return found

    def slopes(
        self,
        quantity: OfMotion,
        motion: Motion,
        since: Array,
        taus: Array,
        y: Array,
        S: Array,
        is_linear: bool = False,
    ) -> Array:
        """Return the derivatives of a quantity at fixed local times, from the variations S there; directions last."""
        none = np.zeros_like(quantity(motion, taus, y))
        found = np.empty((*none.shape, self.count))
        # functions of the user are not called with NaN, where a variation does not exist
        exists = np.isfinite(S).all(axis=0) & np.isfinite(since).all(axis=0)
        S, since = np.where(exists, S, 0.0), np.where(np.isfinite(since), since, 0.0)
        for k in range(self.count):
            parts = [weight * quantity(near, taus, near.exact(taus, y)) for weight, near in self.near(motion, k)]
            parts += [
                weight * quantity(moved, taus, moved.exact(taus, at))
                for weight, moved, at in self.along_ages(motion, since[:, k], y)
            ]
            parts.append(self._along_states(quantity, motion, taus, y, S[:, :, k], is_linear))
            with np.errstate(invalid="ignore"):
                found[..., k] = sum(parts, none)
        found[..., ~exists] = np.nan
        return found

    def forcing(self, motion: Motion, since: Array, taus: Array, y: Array) -> Array:
        """Return the derivatives of the rates at fixed times and states, (size, k, directions).

        Near relative velocity 0 friction laws bend, or change their sign, and so may functions of it. So if scenes near
        by have other relative velocities there, their states are moved until these are the same, and the effect of this
        shift on the rates is subtracted.
        """
        found = self.slopes(Motion.rate, motion, since, taus, y, np.zeros((*y.shape, self.count)))
        read = np.array(sorted(self.system.reader.velocities_read), dtype=np.intp)
        rows = np.union1d(motion.equations.velocity_dependent, read[~motion.equations.is_held[read]])
        if not rows.size:
            return found
        w = self.system.relative_velocity(y, motion.loads(taus))[rows]
        for k in range(self.count):
            near_ones = self.near(motion, k)
            states = [near.exact(taus, y) for _, near in near_ones]
            apart = [
                w - near.system.relative_velocity(at, near.loads(taus))[rows]
                for (_, near), at in zip(near_ones, states, strict=True)
            ]
            moved = np.max([np.abs(one) for one in apart], axis=0, initial=0.0)
            some = (np.abs(w) < _NEAR_ZERO * moved).any(axis=0).nonzero()[0]
            if not some.size:
                continue
            rates, shift = [], np.zeros((y.shape[0], some.size))
            for (weight, near), at, one in zip(near_ones, states, apart, strict=True):
                change = least_change(near.equations, rows, one[:, some])
                shift += weight * change
                rates.append(weight * near.rate(taus[some], at[:, some] + change))
            found[:, some, k] = total(rates)
            for place, matrix in enumerate(motion.true_jacobians(taus[some], y[:, some])):
                found[:, some[place], k] -= matrix @ shift[:, place]
        return found

    def slopes_at(
        self,
        quantity: OfMotion,
        motion: Motion,
        since: Array,
        tau: float,
        y: Array,
        S: Array,
        is_linear: bool = False,
    ) -> Array:
        """Return `slopes` at one local time, from one state and its variations S."""
        at = np.array([tau])
        return self.slopes(quantity, motion, since, at, y[:, None], S[:, None, :], is_linear)[:, 0]

    def falls(self, quantity: OfMotion, motion: Motion, tau: float, y: Array, linear: Mask | None = None) -> Array:
        """Return the slopes of a quantity along a motion from a state; `linear` marks lines linear in the state."""
        rate = motion.rate(tau, y)
        pace = float((np.abs(rate) / self.state_sizes).max(initial=0.0))
        h = 0.1 * PART * min(1.0 / pace if pace > 0 else np.inf, max(motion.horizon, _TINY))
        stencil = CENTRAL if tau + 2 * h <= motion.horizon else MIRRORED
        offsets = np.array([offset for offset, _ in stencil]) * h
        weights = np.array([weight for _, weight in stencil]) / h

        def slope(taus: Array, states: Array, weights: Array) -> Array:
            return np.asarray(quantity(motion, taus, states) @ weights)

        # states on the parabola that the motion follows: along its tangent, with the change of this
        ahead = motion.rate(tau + offsets, y[:, None] + offsets * rate[:, None])
        found = slope(tau + offsets, y[:, None] + 0.5 * offsets * (rate[:, None] + ahead), weights)
        if pace > 0 and linear is not None and linear.any():
            by_time = slope(tau + offsets, np.repeat(y[:, None], offsets.size, axis=1), weights)
            far = y[:, None] + np.outer(rate, [1.0 / pace, -1.0 / pace])
            by_state = slope(np.array([tau, tau]), far, np.array([0.5 * pace, -0.5 * pace]))
            found[linear] = (by_time + by_state)[linear]
        return found

    def border_slopes(self, y: Array, q: Array, S: Array) -> Array:
        """Return the derivatives of the borders of all gaps and stops, (borders, directions).

        They come from differences of the matrices: differences of the values would have the roundoff of the positions
        of fast bodies.
        """
        found = dense(self.system.piecewise.border_y @ S)
        for k, near_ones in enumerate(self.near_ones):
            if near_ones:
                by_y = total([weight * system.piecewise.border_y for weight, system, _ in near_ones])
                by_q = total([weight * system.piecewise.border_q for weight, system, _ in near_ones])
                found[:, k] += by_y @ y + by_q @ q[: self.system.inputs]
        return np.asarray(found)

    def slopes_along(self, quantity: OfMotion, number: int, varied: VariedPiece, taus: Array) -> Array:
        """Return the derivatives of a quantity at fixed local times of a piece, directions last."""
        motion = self.motion_of(number)
        y = motion.exact(taus, self.trajectory.pieces[number].kept_path.at(taus).T)
        return self.slopes(quantity, motion, varied.since_change, taus, y, varied.at(taus))

    def at_rest(self, motion: Motion) -> Mask:
        """Return the rows whose relative velocity is 0 at the start of a motion."""
        w = self.system.relative_velocity(motion.y, motion.loads(0.0))
        return np.asarray(np.abs(w) <= np.maximum(REST * self.state_sizes[0], self.system.laws.rests_below))
