"""First variations along one motion, and through the jump of velocities in which it ends."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.system import System
from stickslip.events.impact import struck
from stickslip.model.arrays import Array, Indices, Mask, Modes
from stickslip.studies.derivatives.directions import PART


@dataclass(frozen=True)
class VariedPiece:
    """Variations along one motion."""

    taus: Array  # (k + 1,): ends of the steps in s since the start of the motion
    # (k, order + 1, size, directions): in a step ``S = sum_j coefficients[j] s^j`` with s from 0 to 1
    coefficients: Array = field(repr=False)
    since_change: Array = field(repr=False)  # (m, directions): changes of the times at which rows became held
    # (directions,): changes of the times at which the motion begins and ends
    begin_change: Array
    end_change: Array
    until: Array  # (directions,): local times in s up to which the variations exist

    def at(self, taus: Array) -> Array:
        """Return S at local times, (size, k, directions)."""
        c = self.coefficients
        if not c.shape[0]:
            return np.zeros((c.shape[2], taus.size, c.shape[3]))
        i = np.clip(np.searchsorted(self.taus, taus, side="right") - 1, 0, c.shape[0] - 1)
        h = self.taus[i + 1] - self.taus[i]
        s = np.divide(taus - self.taus[i], h, out=np.zeros(taus.size), where=h > 0)[:, None, None]
        found = c[i, -1].copy()
        for j in range(c.shape[1] - 2, -1, -1):
            found *= s
            found += c[i, j]
        found = np.moveaxis(found, 0, 1)
        return np.asarray(np.where(taus[:, None] < self.until, found, np.nan))


@dataclass(frozen=True)
class VariedImpact:
    """How velocities jump at an instant, if they do.

    The jump depends only on the relative velocities of rows that impacts reach, and is piecewise linear in them. So its
    differences are taken at the smallest velocities of bodies and drives that have these relative velocities: beside a
    large velocity that all have in common, they would be roundoff.
    """

    system: System
    jumps: bool
    v: Array  # (n,): velocities of the bodies before
    # (d,): velocities of the drives before and after, and their accelerations
    before: Array
    now: Array
    pace: Array
    # (m,): at which limits stops are, which of them are hit, and which rows are closed before
    sides: Modes
    hit: Mask
    closed: Mask

    def after(self) -> Array:
        """Return the velocities after the jump."""
        if not self.jumps:
            return self.v
        return struck(self.system, self.v, self.before, self.now, self.sides, self.hit).v

    def near(self, system: System, before: Array, now: Array) -> Array:
        """Return the velocities after the same jump in a scene near by.

        The jump is taken at the same relative velocities and continued linearly to those of the scene near by: a slow
        impact might not happen there.
        """
        if not self.jumps:
            return self.v
        own = self._relative(system, before)
        (v, u), (change, drive_change) = self._least(system, self._own), self._least(system, own - self._own)
        jump = now - before
        moved, _ = self._linear(system, v, u, change, drive_change, jump)
        met = struck(system, v, u, u + jump, self.sides, self.hit).v
        return np.asarray(self.v - v - change + met + moved)

    def along(self, change: Array, later: float) -> tuple[Array, float]:
        """Return the derivative of the velocities after the jump, and by how much its one-sided derivatives differ.

        Velocities before the jump change by `change`, its time by `later`. The jump is piecewise linear.
        """
        if not (self.jumps and np.isfinite(change).all() and np.isfinite(later)):
            return change, 0.0
        return self._linear(self.system, *self._apart, change, self.pace * later, self.now - self.before)

    @cached_property
    def _own(self) -> Array:
        return self._relative(self.system, self.before)

    @cached_property
    def _apart(self) -> tuple[Array, Array]:
        # only relative velocities matter: a velocity that all bodies have in common would only add roundoff
        return self._least(self.system, self._own)

    @cached_property
    def _rigid(self) -> Indices:
        return np.asarray((~(self.system.is_friction | self.system.is_gap)).nonzero()[0])

    def _relative(self, system: System, before: Array) -> Array:
        """Return the relative velocities of the rows that impacts reach."""
        return np.asarray(system.G[self._rigid] @ self.v + system.D[self._rigid] @ before)

    def _least(self, system: System, w: Array) -> tuple[Array, Array]:
        """Return the smallest velocities at which the rows that impacts reach have the relative velocities `w`."""
        levers = np.hstack([dense(system.G[self._rigid]), system.D[self._rigid]])
        found = np.asarray(np.linalg.lstsq(levers, w, rcond=None)[0], dtype=float)
        return found[: system.n], found[system.n :]

    def _linear(
        self, system: System, v: Array, u: Array, change: Array, drive_change: Array, jump: Array
    ) -> tuple[Array, float]:
        """Return the derivative of the velocities after the jump, and by how much its one-sided derivatives differ.

        Before the jump the velocities `v` of bodies change by `change`, those `u` of drives by `drive_change`. Drives
        jump by `jump`.
        """
        change = self._kept_closed(system, change, drive_change)
        largest = max(float(np.abs(change).max(initial=0.0)), float(np.abs(drive_change).max(initial=0.0)))
        if largest == 0:
            return np.zeros_like(change), 0.0
        speeds = np.abs(self.system.G @ self.v + self.system.D @ self.before)[self.hit]
        h = PART * float(speeds.min(initial=np.abs([*self.v, *self.before, *self.now]).max(initial=0.0)))
        h /= largest

        def jumped(part: float) -> Array:
            # only the jump: for bodies that nothing hits it is exactly 0, and their velocities leave no roundoff
            bodies, drives = v + part * change, u + part * drive_change
            return struck(system, bodies, drives, drives + jump, self.sides, self.hit).v - bodies

        own, ahead, back = (jumped(part) for part in (0.0, h, -h))
        return change + (ahead - back) / (2 * h), float(np.abs(ahead + back - 2 * own).max() / h)

    def _kept_closed(self, system: System, change: Array, drive_change: Array) -> Array:
        """Return the changes of velocities without the part that opens rows which are closed before the jump.

        These rows are closed in all scenes near by: a change of the state that opens one goes with a change of the
        scene that closes it. Each of the two alone would cause another jump.
        """
        rows = self.closed.nonzero()[0]
        if not rows.size:
            return change
        levers = dense(system.G[rows])
        opening = levers @ change + system.D[rows] @ drive_change
        return np.asarray(change - np.linalg.lstsq(levers, opening, rcond=None)[0])
