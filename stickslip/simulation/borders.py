"""The regions of tables along a run: each motion follows one line of each table, up to the first border.

The borders of gaps and stops are guards of the engines (`equations/piecewise.py`). Those of tables are not: a table may
be looked up at the value of a function, and feeds normal forces, blocks and other tables. So the borders of tables are
found on the path.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from stickslip.equations.inputs import largest_finite
from stickslip.equations.loads.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes, from_nodes
from stickslip.equations.system import System
from stickslip.events.settle import inputs_before
from stickslip.events.situation import Situation
from stickslip.model.arrays import Array, Indices, Mask
from stickslip.simulation.signs import DEGREE, ROUGH, TINY, signs_along

TOGETHER = 1e-14  # part of a time within which two times count as one
_NEAR = 0.999  # part of a motion's time from which to its end a difference gives rates
_FEW = 4  # borders up to which each is looked at along the whole path
_MORE = 3  # by how much the order of the polynomial of a quantity is larger than that of the state


class _Side(NamedTuple):
    """One border of each table: depths within it at points, their noise, and the tables that may leave by it.

    Below `rough` a depth counts as 0 before its sign is known.
    """

    depths: Array
    noise: Array
    rough: Array
    may_leave: Indices

    @property
    def has_left(self) -> Mask:
        """Whether a table that may leave has left, at each point."""
        depths: Array = self.depths[self.may_leave]
        return depths < -self.rough[self.may_leave, None, None]


class Borders:
    """Finds the regions of the tables along a run, and notes them in the loads, where motions read them."""

    def __init__(self, system: System, loads: Loads, scale: Array) -> None:
        """Take states to have at least the sizes `scale`: a state that is always at rest shows no size."""
        assert system.dependence is not None
        self._system, self._loads, self._dependence = system, loads, system.dependence
        # for each table the largest size so far of what it is looked up at: later values have its roundoff
        self._sizes = system.dependence.argument_majorants_of_states(scale, loads.size)

    def place(self, now: Situation) -> None:
        """Find the regions in which a state lies; a region at whose border it lies is kept."""
        y, q = now.y, inputs_before(self._system, self._loads.after(now.t), now)
        self._sizes = np.maximum(self._sizes, self._dependence.argument_majorants(q, y))
        x, regions = self._dependence.looked_up(q, y), self._loads.table_regions
        if regions is None:
            self._loads.table_regions = tuple(map(self._dependence.region, range(x.size), x.tolist()))
        else:
            low, high = self._dependence.all_borders(regions)
            rough = ROUGH * np.maximum(self._sizes, largest_finite(x, low, high))
            outside = ((x < low - rough) | (x > high + rough)).nonzero()[0].tolist()
            self._go_to(regions, {k: self._dependence.region(k, float(x[k])) for k in outside})
        # so motions count a region as left only where that is certain
        self._loads.beside = 2 * TINY * self._sizes

    def cut(self, motion: Motion, path: Path) -> Path:
        """Return a path up to the first border, and note the regions beyond it."""
        regions = self._loads.table_regions
        if path.taus.size < 2 or regions is None:
            return path
        if path.has_event:
            self._leave_with_event(motion, path, regions)
        if self._stays_within(motion, path, regions):
            return path
        exits = self._exits(motion, path, self._dependence.all_borders(regions))
        first = min((tau for tau, *_ in exits), default=math.inf)
        if first > path.taus[-1]:
            return path
        # Tables that leave regions at the same time change together: with only some of them changed, a motion would be
        # none of the scene.
        together = first + TOGETHER * (abs(motion.t) + first)
        self._go_to(regions, {k: regions[k] + side for tau, k, side in exits if tau <= together})
        if first >= path.taus[-1]:
            return path
        return motion.until(path, first)

    def _go_to(self, regions: tuple[int, ...], changes: dict[int, int]) -> None:
        """Note the regions of tables: `regions` but for some."""
        if changes:
            regions = tuple(changes.get(k, region) for k, region in enumerate(regions))
        self._loads.table_regions = regions

    def _leave_with_event(self, motion: Motion, path: Path, regions: tuple[int, ...]) -> None:
        """Let tables that come to a border in the instant of an event leave their regions with it.

        The lines beyond the borders decide whether a force that is at its level then goes beyond it.
        """
        last, end = path.taus[-2:].tolist()
        near, instant = max(last, _NEAR * end), TOGETHER * (abs(motion.t) + end)
        if near == end:
            # so short a path has no rates
            return
        before, x = self._values(motion, path, np.array([near, end])).T
        rate = (x - before) / (end - near)
        rough = instant * np.abs(rate) + TINY * self._sizes
        changes: dict[int, int] = {}
        for side, border in zip((-1, 1), self._dependence.all_borders(regions), strict=True):
            leaves = (side * rate > 0) & (side * (border - x) <= rough)
            changes |= {k: regions[k] + side for k in leaves.nonzero()[0].tolist()}
        self._go_to(regions, changes)

    def _stays_within(self, motion: Motion, path: Path, regions: tuple[int, ...]) -> bool:
        """Tell whether bounds show that no table leaves its region: values stray by at most their coefficients."""
        dependence, segment = self._dependence, motion.segment
        if dependence.for_tables or not segment.is_straight:
            return False
        part, c = dependence.looked_up_forms, path.coefficients
        own = c[:, :, part.states].reshape(c.shape[0] * c.shape[1], part.states.size)
        value = (part.S @ own.T).reshape(part.S.shape[0], *c.shape[:2])
        drift = part.P @ segment.slope[part.places]
        since = motion.t - segment.start + path.taus[:-1]
        first = value[:, :, 0] + (part.P @ segment.value[part.places])[:, None] + drift[:, None] * since
        strays = np.abs(value[:, :, 1:]).sum(axis=2) + np.abs(drift)[:, None] * np.diff(path.taus)
        low, high = dependence.all_borders(regions)
        if not ((first - strays).min(axis=1) > low).all() or not ((first + strays).max(axis=1) < high).all():
            return False
        self._sizes = np.maximum(self._sizes, np.abs(first).max(axis=1))
        return True

    def _exits(self, motion: Motion, path: Path, borders: Array) -> list[tuple[float, int, int]]:
        """Return local times at which tables leave their regions, with their numbers and sides; the first are there.

        Where many tables leave, only the time until the first one has left is looked at.
        """
        curved = not self._dependence.read_for_tables.isdisjoint(motion.segment.bent.tolist())
        # where no load bends the values at which tables are looked up, they are nearly polynomials, as the state is
        nodes = chebyshev_nodes(DEGREE if curved else min(DEGREE, path.coefficients.shape[1] + _MORE))
        ends = path.taus
        while True:
            taus = ends[:-1, None] + np.diff(ends)[:, None] * nodes
            values = self._values(motion, path, taus.ravel()).reshape(-1, *taus.shape)
            sizes = np.maximum(self._sizes, np.abs(values).max(axis=(1, 2)))
            sides = [self._side(side, border, values, sizes) for side, border in zip((-1, 1), borders, strict=True)]
            beyond = np.any([one.has_left.any(axis=0) for one in sides], axis=0).ravel()
            if sum(one.may_leave.size for one in sides) <= _FEW or not beyond[:-1].any():
                break
            # the next point, too: tables that leave together are beyond there
            left = float(taus.ravel()[beyond.argmax() + 1])
            if left > 0.5 * ends[-1]:
                break
            ends = np.append(ends[ends < left], left)
        self._sizes = sizes
        found = []
        for one, side, border in zip(sides, (-1, 1), borders, strict=True):
            for k in one.may_leave.tolist():

                def depth(tau: float, k: int = k, side: int = side, border: float = float(border[k])) -> float:
                    return side * (border - motion.looked_up_by(k, tau, path.at(np.array([tau]))[0]))

                tau = _exit(ends, one.depths[k], depth, float(one.rough[k]), float(one.noise[k]))
                found.append((tau, k, side))
        return found

    @staticmethod
    def _side(side: int, border: Array, values: Array, sizes: Array) -> _Side:
        """Return how deep the arguments of tables are within their borders to one side."""
        depths = side * (border[:, None, None] - values)
        size = np.abs(depths).max(axis=(1, 2)) + np.abs(border)
        c = values @ from_nodes(values.shape[2] - 1).T
        strays = np.abs(c[:, :, 1:]).sum(axis=2)
        # a value that has just come to a border has the roundoff of the largest value before
        noise, rough = TINY * size, np.maximum(ROUGH * size, TINY * sizes)
        stays = (side * (border[:, None] - c[:, :, 0]) > strays).all(axis=1) & (depths.min(axis=(1, 2)) > rough)
        return _Side(depths, noise, rough, (np.isfinite(border) & ~stays).nonzero()[0])

    def _values(self, motion: Motion, path: Path, taus: Array) -> Array:
        return motion.looked_up(taus, path.at(taus).T)


def _exit(taus: Array, depths: Array, depth: Callable[[float], float], rough: float, noise: float) -> float:
    """Return the first of local times at which a depth falls below 0, inf if it does not.

    `depths` are those at the Chebyshev points between two of `taus` each. Below `rough` a depth counts as 0 before its
    sign is known, below `noise` after.
    """
    sign_known = False
    for row, (start, stop) in zip(depths, pairwise(taus.tolist()), strict=True):
        for tau, sign in signs_along(start, stop, row, depth, noise if sign_known else rough, noise):
            if sign < 0:
                return tau
            sign_known = True
    return math.inf
