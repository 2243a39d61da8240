"""The guards of a motion: which there are, their values, and their Taylor coefficients."""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property

import numpy as np

from stickslip.equations.motion import Expansion, Motion
from stickslip.model.arrays import Array, Indices, Mask, Modes

# Distances from the edge of a dead band, as parts of the band: within the first a velocity is at the edge, beyond the
# second it is outside for certain.
AT_BAND, _BEYOND_BAND = 1e-6, 1e-5


class GuardValues:
    """The guards of a motion.

    The velocity of a row that carries no force is a guard, too, if its label in `labels` is not 0. `at_rest` are rows
    whose relative velocity is 0 at the start. `in_band` are rows that start within Karnopp's dead band; if None, they
    are found from their velocities.

    Attributes
    ----------
    first : array (orders, guards)
        Taylor coefficients at the start, orders 0 and 1 at least.
    row : array of int
        The row of each guard, -1 where it is the border of a region.
    is_border : array of bool
        Guards that are borders of regions.
    in_band : array of int
        Rows that start within Karnopp's dead band: they stick at velocity 0, not at the edge of the band.
    """

    def __init__(self, motion: Motion, labels: Modes, at_rest: Mask, in_band: Indices | None = None) -> None:
        self.motion, self.at_rest = motion, at_rest
        rows = self.rows = motion.equations.guard_rows(labels)
        self.row, self.size, self.direction = rows.row, rows.size, rows.direction
        self.is_velocity, self.is_border, self.is_normal = rows.is_velocity, rows.is_border, rows.is_normal
        # the row of a border is -1: it reads the False at the end
        self.rests = rows.is_velocity & (np.append(at_rest, False) if rows.has_borders else at_rest)[rows.row]
        self._constant, self._has_constant = rows.constant, rows.has_constant
        self.in_band: Indices = np.empty(0, dtype=np.intp)
        if rows.has_threshold:
            self._constant = rows.constant.copy()
            slips = slice(rows.slips)
            # a row that starts from rest, or within Karnopp's dead band because others lead it, sticks at velocity 0
            speed = rows.sign[slips] * motion.first.z[0][rows.source[slips]]
            within = (speed <= -(1 + AT_BAND) * rows.threshold) & motion.system.hard[rows.row[slips]]
            within = within | self.rests[slips] if in_band is None else np.isin(rows.row[slips], in_band)
            self._constant[slips] = np.where(within, 0.0, rows.threshold)
            self.in_band = np.asarray(rows.row[slips][within & (rows.threshold < 0)], dtype=np.intp)
            self._has_constant = bool(self._constant.any())
        self.first = self.series(motion.first)
        # if no guard reads a force, functions of the state reach guards only by way of normal forces
        self._wanted: Collection[int] | None = None
        if not rows.reads_forces and motion.dependence is not None:
            self._wanted = motion.dependence.for_normals

    def beyond_bands(self, taus: Array, states: Array) -> Array:
        """Return how far the velocities of the rows `in_band` are beyond their dead bands, one column per time.

        A motion ends where this is positive: in the next one the edge of the band is a guard.
        """
        motion, system, rows = self.motion, self.motion.system, self.in_band
        u = motion.loads(taus) if system.drives else np.empty(0)
        w = system.relative_velocity(motion.exact(taus, states), u)[rows]
        return np.asarray(np.abs(w) - (1 + _BEYOND_BAND) * system.laws.rests_below[rows, None])

    def raw(self, z: Array, q: Array) -> Array:
        """Return the guards, their zeros not divided out, one column per time where `z` and `q` have columns."""
        rows, column = self.rows, (slice(None), None) if z.ndim == 2 else slice(None)
        g: Array = rows.sign[column] * z[rows.source]
        if rows.has_levels:
            g += rows.mu[column] * q[rows.row]
        if self._has_constant:
            g += self._constant[column]
        if rows.rising.size:
            g[rows.rising] -= rows.rise[column] * q[rows.dwell]
        return g

    def raw_at(self, tau: float | Array, y: Array) -> Array:
        """Return the guards at local times from the states, their zeros not divided out."""
        q = self.motion.inputs(tau, y, self._wanted)
        return self.raw(self.motion.watched(tau, y, q), q)

    def series(self, expansion: Expansion) -> Array:
        """Return the Taylor coefficients of the guards, their zeros not divided out, one row per order."""
        rows = self.rows
        if expansion.g is not None:
            g: Array = self.completed(expansion.g, expansion.z)
            return np.concatenate([g[:1] + self._constant, g[1:]]) if self._has_constant else g
        g = rows.sign * expansion.z[:, rows.source]
        if rows.has_levels:
            g += rows.mu * expansion.q[:, rows.row]
        if rows.rising.size:
            g[:, rows.rising] -= rows.rise * expansion.q[:, rows.dwell]
        if self._has_constant:
            g[0] += self._constant
        return g

    def completed(self, g: Array, z: Array) -> Array:
        """Return the guards `g` of the modes, followed by those of open rows that show a mode, from the watched `z`."""
        rows = self.rows
        if not rows.loose:
            return g
        own = slice(-rows.loose, None)
        return np.concatenate([g, z[..., rows.source[own]] * rows.sign[own]], axis=-1)

    @cached_property
    def start(self) -> Array:
        """Taylor coefficients of the guards at the start, orders 0 to 2."""
        return self.first if self.motion.is_linear else self.series(self.motion.start)
