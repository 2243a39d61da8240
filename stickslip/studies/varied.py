"""First variations along one motion, and through the jump of velocities in which it ends."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from stickslip.equations.matrices import dense
from stickslip.equations.system import System
from stickslip.events.impact import struck
from stickslip.studies.directions import PART

__all__ = ["VariedImpact", "VariedPiece"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VariedPiece:
    """Variations along one motion.

    Attributes
    ----------
    taus : array (k + 1,)
        Ends of the steps in s since the start of the motion.
    coefficients : array (k, order + 1, size, directions)
        In a step ``S = sum_j coefficients[j] s^j`` with s from 0 to 1.
    since : array (m, directions)
        How the times change at which rows became held.
    begin, end : array (directions,)
        How the times change at which the motion begins and ends.
    until : array (directions,)
        Local times in s up to which the variations exist.
    """

    taus: Array
    coefficients: Array = field(repr=False)
    since: Array = field(repr=False)
    begin: Array
    end: Array
    until: Array

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
    """How velocities jump at an instant; they do not where there is no system.

    Attributes
    ----------
    system : System or None
    before, now, pace : array (d,)
        Velocities of the drives before and after, and their accelerations.
    sides, hit : array (m,)
        At which limits stops are, and which of them are hit.
    """

    system: System | None
    before: Array
    now: Array
    pace: Array
    sides: NDArray[np.int8]
    hit: NDArray[np.bool_]

    def after(
        self, v: Array, system: System | None = None, before: Array | None = None, now: Array | None = None
    ) -> Array:
        """Return the velocities after the jump, by default in the scene itself."""
        if self.system is None:
            return v
        before, now = self.before if before is None else before, self.now if now is None else now
        return struck(system or self.system, v, before, now, self.sides, self.hit).v

    def along(self, v: Array, change: Array, later: float) -> tuple[Array, float]:
        """Return the derivative of the velocities after the jump, and by how much those to the two sides differ.

        Velocities before change by `change`, the time of the jump by `later`. The jump is piecewise linear.
        """
        if self.system is None or not (np.isfinite(change).all() and np.isfinite(later)):
            return change, 0.0
        u = self.pace * later
        largest = max(float(np.abs(change).max(initial=0.0)), float(np.abs(u).max(initial=0.0)))
        if largest == 0:
            return np.zeros_like(change), 0.0
        system, none = self.system, np.zeros_like(self.before)
        # only relative velocities count: what bodies have in common brings no more than its roundoff
        rigid = (~(system.is_friction | system.is_gap)).nonzero()[0]
        w = system.G[rigid] @ v + system.D[rigid] @ self.before
        apart = np.linalg.lstsq(dense(system.G[rigid]), w, rcond=None)[0]
        jump = self.now - self.before
        speeds = np.abs(system.G @ v + system.D @ self.before)[self.hit]
        h = PART * float(speeds.min(initial=np.abs([*v, *self.before, *self.now]).max(initial=0.0))) / largest
        own = self.after(apart, None, none, jump)
        ahead = self.after(apart + h * change, None, h * u, jump + h * u)
        back = self.after(apart - h * change, None, -h * u, jump - h * u)
        return (ahead - back) / (2 * h), float(np.abs(ahead + back - 2 * own).max() / h)
