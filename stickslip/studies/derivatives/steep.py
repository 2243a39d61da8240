"""Where a motion begins or ends at rest with friction of infinite slope there: that of Stribeck exponents below 1."""

from __future__ import annotations

import numpy as np

from stickslip.equations.matrices import dense
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.model.arrays import Array, Indices
from stickslip.studies.derivatives.radau import radau

_NEAR, _NEARER = 1e-5, 1e-8
"""Parts of the velocity within which friction bends, at which slopes are compared."""

_STEEPER = 1.5
"""So many times steeper it is where the slope has no bound."""

_LOST = 1.05 * (_NEAR / _NEARER) ** 0.5
"""The same where it grows faster than ``w^(-1/2)``."""

_CROWD = 4.0 ** -np.arange(2.0, 21.0)[::-1]
"""Points beside an end, as parts of the motion."""

_AT_REST = 1e-8
"""Part of the speeds below which a relative velocity is at rest at an end."""


_ITERATIONS = 4
"""So often relative velocities are integrated with the friction of those before."""


class Steep:
    """A solver's path with what it leaves out there.

    Steps crowd towards such an end. Relative velocities that begin from 0 are integrals of relative accelerations: as
    differences of velocities they have no digits left.
    """

    def __init__(self, motion: Motion, path: Path, speed: float, bend: float) -> None:
        self.taus, self._motion, self._path = path.taus, motion, path
        self._rows: Indices = np.empty(0, dtype=np.intp)
        rows = self._steep_rows(min(bend, speed))
        if not rows.size:
            return
        ends = np.array([0.0, path.taus[-1]])
        y = motion.exact(ends, path.at(ends).T)
        at_rest = np.abs(self._relative(ends, y)[rows]) <= _AT_REST * speed
        crowd = path.taus[-1] * _CROWD
        if at_rest[:, 1].any():
            self.taus = np.union1d(self.taus, path.taus[-1] - crowd)
        if at_rest[:, 0].any():
            self.taus = np.union1d(self.taus[self.taus >= crowd[0]], np.append(0.0, crowd))
            self._rows = rows[at_rest[:, 0]]
            self._follow(_AT_REST**0.5 * speed)

    def at(self, taus: Array) -> Array:
        """Return the states at local times, a column each."""
        y = self._motion.exact(taus, self._path.at(taus).T)
        some = (taus < self._known[-1]).nonzero()[0] if self._rows.size else self._rows
        if not some.size:
            return y
        i = np.searchsorted(self._known, taus[some], side="right") - 1
        s = (taus[some] - self._known[i]) / np.diff(self._known)[i]
        w = (self._velocities[i] * s[:, None, None] ** np.arange(self._velocities.shape[1])[:, None]).sum(
            axis=1
        )
        return self._moved(taus, y, some, w.T)

    @property
    def is_lost(self) -> bool:
        """Whether it begins from rest with friction so steep that what it does then hangs on the beginning itself.

        ``w' = c w^d`` has solutions that leave 0 at any time; for d below 1/2 they outrun all that else accelerates.
        """
        return bool((self._growth[self._rows] > _LOST).any())

    def _steep_rows(self, bend: float) -> Indices:
        """Return the rows whose friction has a slope without bound at rest."""
        equations = self._motion.equations
        self._growth = np.zeros(equations.system.m)
        rows = equations.velocity_dependent
        if not rows.size or equations.bristle_places.size:
            return rows[:0]
        sign, none = equations.modes[rows].astype(float), np.zeros(rows.size)
        z, slopes = np.empty((0, rows.size)), []
        for part in (_NEAR, _NEARER):
            w = sign * part * bend
            slopes.append(
                np.abs(equations.law.slopes(w, none + 1.0, none, z) + equations.law.left_out(w, none + 1.0))
            )
        self._growth[rows] = slopes[1] / np.where(slopes[0] > 0, slopes[0], np.inf)
        return np.asarray(rows[self._growth[rows] > _STEEPER])

    def _relative(self, taus: Array, y: Array) -> Array:
        return self._motion.system.relative_velocity(y, self._motion.inputs(taus, y))

    def _follow(self, until: float) -> None:
        """Integrate the relative accelerations of rows that begin from rest, up to where velocities tell enough."""
        motion, rows, system = self._motion, self._rows, self._motion.system
        nodes, weights, to_powers = radau()
        known, velocities, w = [0.0], [], np.zeros(rows.size)
        for begin, end in zip(self.taus[:-1], self.taus[1:], strict=True):
            taus = begin + (end - begin) * nodes
            y = motion.exact(taus, self._path.at(taus).T)
            q = motion.inputs(taus, y)
            stages = self._relative(taus, y)[rows]
            for _ in range(_ITERATIONS):
                rates = motion.rate(taus, self._moved(taus, y, np.arange(taus.size), stages))
                pace = system.relative(rates[: system.n], system.drive_accelerations(q))[rows]
                stages = w[:, None] + (end - begin) * pace @ weights.T
            velocities.append(to_powers @ np.concatenate([w[None], stages.T]))
            known.append(float(end))
            w = stages[:, -1]
            if np.abs(w).min() > until:
                break
        self._known, self._velocities = np.array(known), np.array(velocities)

    def _moved(self, taus: Array, y: Array, some: Indices, w: Array) -> Array:
        """Return states of which `some` have other relative velocities `w` of the rows, with least changes."""
        equations, system = self._motion.equations, self._motion.system
        ways = equations.consistent(np.eye(system.size)[:, : system.n], np.zeros((system.drives, system.n)))
        apart = w - self._relative(taus[some], y[:, some])[self._rows]
        lines = dense(system.G[self._rows]) @ ways[: system.n]
        y = y.copy()
        y[:, some] += ways @ np.linalg.lstsq(lines, apart, rcond=None)[0]
        return y
