"""The regions of tables along a run: each motion follows one line of each table, up to the first border.

The borders of gaps and stops are guards of the engines (`equations/piecewise.py`). Those of tables are not: a table may
be looked up at the value of a function, and feeds normal forces, blocks and other tables. So the borders of tables are
found on the path.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from stickslip.equations.loads.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes
from stickslip.equations.system import System
from stickslip.events.settle import inputs_before
from stickslip.events.situation import Situation
from stickslip.model.arrays import Array
from stickslip.simulation.signs import DEGREE, ROUGH, TINY, signs_along

TOGETHER = 1e-14  # part of a time within which two times count as one
_NEAR = 0.999  # part of a motion's time from which to its end a difference gives rates
_MORE = 3  # by how much the order of the polynomial of a quantity is larger than that of the state


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
        regions = self._loads.table_regions
        self._sizes = np.maximum(self._sizes, self._dependence.argument_majorants(q, y))
        found = []
        for k, x in enumerate(self._dependence.looked_up(q, y).tolist()):
            region = self._dependence.region(k, x) if regions is None else regions[k]
            low, high = self._dependence.borders(k, region)
            ends = [abs(value) for value in (x, low, high) if math.isfinite(value)]
            rough = ROUGH * max(*ends, float(self._sizes[k]))
            inside = low - rough <= x <= high + rough
            found.append(region if inside else self._dependence.region(k, x))
        self._loads.table_regions = tuple(found)
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
        curved = not self._dependence.read_for_tables.isdisjoint(motion.segment.bent.tolist())
        # where no load bends the values at which tables are looked up, they are nearly polynomials, as the state is
        nodes = chebyshev_nodes(DEGREE if curved else min(DEGREE, path.coefficients.shape[1] + _MORE))
        taus = path.taus[:-1, None] + np.diff(path.taus)[:, None] * nodes
        values = self._values(motion, path, taus.ravel()).reshape(len(regions), *taus.shape)
        self._sizes = np.maximum(self._sizes, np.abs(values).max(axis=(1, 2)))
        exits = [
            (self._exit(motion, path, k, side, border, side * (border - values[k])), k, side)
            for k, region in enumerate(regions)
            for side, border in zip((-1, 1), self._dependence.borders(k, region), strict=True)
            if math.isfinite(border)
        ]
        first = min((tau for tau, *_ in exits), default=math.inf)
        if first > path.taus[-1]:
            return path
        # Tables that leave regions at the same time change together: with only some of them changed, a motion would be
        # none of the scene.
        following = list(regions)
        for tau, k, side in exits:
            if tau <= first + TOGETHER * (abs(motion.t) + first):
                following[k] = regions[k] + side
        self._loads.table_regions = tuple(following)
        if first >= path.taus[-1]:
            return path
        return motion.until(path, first)

    def _leave_with_event(self, motion: Motion, path: Path, regions: tuple[int, ...]) -> None:
        """Let tables that come to a border in the instant of an event leave their regions with it.

        The lines beyond the borders decide whether a force that is at its level then goes beyond it.
        """
        last, end = path.taus[-2:].tolist()
        near, instant = max(last, _NEAR * end), TOGETHER * (abs(motion.t) + end)
        before, x = self._values(motion, path, np.array([near, end])).T
        rate = (x - before) / (end - near)
        following = list(regions)
        for k, region in enumerate(regions):
            for side, border in zip((-1, 1), self._dependence.borders(k, region), strict=True):
                rough = instant * abs(float(rate[k])) + TINY * float(self._sizes[k])
                if side * rate[k] > 0 and side * (border - x[k]) <= rough:
                    following[k] = region + side
        self._loads.table_regions = tuple(following)

    def _stays_within(self, motion: Motion, path: Path, regions: tuple[int, ...]) -> bool:
        """Tell whether bounds show that no table leaves its region: values stray by at most their coefficients."""
        dependence, segment = self._dependence, motion.segment
        if dependence.for_tables or not segment.is_straight:
            return False
        steps = np.diff(path.taus)
        for k, (number, region) in enumerate(zip(dependence.tables, regions, strict=True)):
            part = dependence.arguments[number]
            value = path.coefficients[:, :, part.states] @ part.S[0]
            drift = float(part.P[0] @ segment.slope[part.places])
            since = motion.t - segment.start + path.taus[:-1]
            first = value[:, 0] + part.P[0] @ segment.value[part.places] + drift * since
            strays = np.abs(value[:, 1:]).sum(axis=1) + abs(drift) * steps
            low, high = dependence.borders(k, region)
            if not (np.all(first - strays > low) and np.all(first + strays < high)):
                return False
            self._sizes[k] = max(self._sizes[k], float(np.abs(first).max()))
        return True

    def _exit(self, motion: Motion, path: Path, k: int, side: int, border: float, depths: Array) -> float:
        """Return the first local time at which a table leaves its region by one border, inf if it does not."""
        size = float(np.abs(depths).max()) + abs(border)
        # a value that has just come to a border has the roundoff of the largest value before
        rough, noise = max(ROUGH * size, TINY * float(self._sizes[k])), TINY * size

        def depth(tau: float) -> float:
            return side * (border - float(self._values(motion, path, np.array([tau]))[k, 0]))

        sign_known = False
        for row, (start, stop) in zip(depths, pairwise(path.taus.tolist()), strict=True):
            for tau, sign in signs_along(start, stop, row, depth, noise if sign_known else rough, noise):
                if sign < 0:
                    return tau
                sign_known = True
        return math.inf

    def _values(self, motion: Motion, path: Path, taus: Array) -> Array:
        return motion.looked_up(taus, motion.exact(taus, path.at(taus).T))
