"""Motions that begin or end at rest where friction has an infinite slope: Stribeck exponents below 1."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.mode_equations import ModeEquations
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, values
from stickslip.model.arrays import Array, Indices
from stickslip.studies.derivatives.radau import radau

# Slopes of friction are compared at these parts of the velocity within which it bends.
_NEAR = 1e-5, 1e-8, 1e-11

# A slope has no bound if it grows by more than the first factor from the first part to the second. It grows faster than
# ``w^(-1/2)`` if by more than the second factor from the second part to the third: nearest to rest, where the curve far
# from it does not count.
_STEEPER, _LOST = 1.5, 1.05 * (_NEAR[1] / _NEAR[2]) ** 0.5

_CROWD = 4.0 ** -np.arange(2.0, 21.0)[::-1]  # further ends of steps beside an end, as parts of the motion
_AT_REST = 1e-8  # part of the speeds below which a relative velocity counts as 0 at an end
_ARRIVES = 0.1  # part of the velocity before the last step below which a row comes to rest in it
_BEGUN = 12  # the place in `_CROWD` of the last end of a step near which a motion has only just begun

# How often relative velocities are integrated at most, each time with the friction of the last ones: errors shrink as
# ``w^d`` does, for d up to 0.65 or so. The last part of a velocity is roundoff.
_ITERATIONS, _ROUNDOFF = 80, 1e-14


def least_change(equations: ModeEquations, rows: Indices, apart: Array) -> Array:
    """Return the least change of states, a column each, that changes the relative velocities of rows by `apart`.

    Held bodies move with what holds them; drives keep their velocities.
    """
    system = equations.system
    ways = equations.consistent(np.eye(system.size)[:, : system.n], np.zeros((system.drives, system.n)))
    lines = dense(system.G[rows] @ ways[: system.n])
    return np.asarray(ways @ np.linalg.lstsq(lines, apart, rcond=None)[0])


def brought_to_rest(motion: Motion, rows: Indices, tau: float, y: Array) -> Array:
    """Return a state with some rows at rest that have come to rest but for roundoff.

    Where the slope of friction has no bound, that roundoff changes the friction by far more.
    """
    w: Array = motion.system.relative_velocity(y, motion.loads(tau))
    return np.asarray(y + least_change(motion.equations, rows, -w[rows]))


class SteepPath:
    """A solver's path, made finer where it begins or ends at rest with friction of infinite slope.

    Its steps, which end at `taus`, crowd towards such an end. Relative velocities that begin from 0 are integrals of
    relative accelerations: differences of velocities would have no correct digits. The path `is_lost` if it begins from
    rest with friction so steep that the start does not determine the motion: ``w' = c w^d`` has solutions that leave 0
    at any time, and for d below 1/2 they grow faster than any motion that other forces cause. It has only just begun
    up to `begun_until`, 0 if it does not begin so. The row `stopping` is the one that such friction brings to rest in
    the last step; None for none, or for several.
    """

    def __init__(self, motion: Motion, path: Path, speed: float, bend: float) -> None:
        self.taus, self._motion, self._path, self._speed = path.taus, motion, path, speed
        self.is_lost, self._rows, self.begun_until = False, np.empty(0, dtype=np.intp), 0.0
        self.stopping: int | None = None
        rows, growth = self._steep_rows(min(bend, speed))
        if not rows.size:
            return
        ends = np.array([0.0, path.taus[-1]])
        y = motion.exact(ends, path.at(ends).T)
        begins, stops = (np.abs(self._relative(ends, y)[rows]) <= _AT_REST * speed).T
        crowd = path.taus[-1] * _CROWD
        if stops.any():
            self.taus = np.union1d(self.taus, path.taus[-1] - crowd)
            last = self.taus[-2:]
            w = np.abs(self._relative(last, self.at(last))[rows])
            if stops.sum() == 1 and w[stops, 1] <= _ARRIVES * w[stops, 0]:
                self.stopping = int(rows[stops][0])
        if begins.any():
            self.taus = np.union1d(self.taus[self.taus >= crowd[0]], np.append(0.0, crowd))
            self.is_lost, self._rows = bool((growth[begins] > _LOST).any()), rows[begins]
            self.begun_until = float(crowd[_BEGUN])

    def at(self, taus: Array) -> Array:
        """Return the states at local times, a column each."""
        y = self._motion.exact(taus, self._path.at(taus).T)
        if not self._rows.size:
            return y
        known, velocities = self._begun
        some = (taus < known[-1]).nonzero()[0]
        i = np.searchsorted(known, taus[some], side="right") - 1
        s = (taus[some] - known[i]) / np.diff(known)[i]
        y[:, some] = self._moved(taus[some], y[:, some], values(velocities, i, s, False).T)
        return y

    def _steep_rows(self, bend: float) -> tuple[Indices, Array]:
        """Return the rows whose friction has an unbounded slope at rest, and by what factor it grows nearest to it."""
        equations = self._motion.equations
        rows = equations.velocity_dependent
        if not rows.size or equations.bristle_places.size:
            return rows[:0], np.empty(0)
        sign, none = equations.modes[rows].astype(float), np.zeros(rows.size)
        z, slopes = np.empty((0, rows.size)), []
        for part in _NEAR:
            w = sign * part * bend
            slopes.append(np.abs(equations.law.slopes(w, none + 1.0, none, z) + equations.law.slope_cut(w, none + 1.0)))
        growth = [after / np.where(before > 0, before, np.inf) for before, after in pairwise(slopes)]
        is_steep = growth[0] > _STEEPER
        return rows[is_steep], growth[1][is_steep]

    def _relative(self, taus: Array, y: Array) -> Array:
        return self._motion.system.relative_velocity(y, self._motion.loads(taus))

    @cached_property
    def _begun(self) -> tuple[Array, Array]:
        """Relative velocities of rows that begin from rest, as integrals, until differences of velocities will do.

        They are given by the ends of steps, and a polynomial for each step.
        """
        motion, rows = self._motion, self._rows
        nodes, weights, to_powers = radau()
        known, velocities, w = [0.0], [], np.zeros(rows.size)
        for begin, end in zip(self.taus[:-1], self.taus[1:], strict=True):
            taus = begin + (end - begin) * nodes
            y = motion.exact(taus, self._path.at(taus).T)
            stages = self._relative(taus, y)[rows]
            for _ in range(_ITERATIONS):
                pace = motion.relative_accelerations(taus, self._moved(taus, y, stages))[rows]
                before, stages = stages, w[:, None] + (end - begin) * pace @ weights.T
                if (np.abs(stages - before) <= _ROUNDOFF * np.abs(stages)).all():
                    break
            velocities.append(to_powers @ np.concatenate([w[None], stages.T]))
            known.append(float(end))
            w = stages[:, -1]
            if np.abs(w).min() > _AT_REST**0.5 * self._speed:
                break
        return np.array(known), np.array(velocities)

    def _moved(self, taus: Array, y: Array, w: Array) -> Array:
        """Return states with other relative velocities `w` of the rows, changed as little as possible."""
        apart = w - self._relative(taus, y)[self._rows]
        return y + least_change(self._motion.equations, self._rows, apart)
