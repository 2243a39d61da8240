"""Events of the user: where quantities cross 0 along the paths of a run.

They change nothing in the motion, so they are looked for on the polynomials of its steps: in each step the quantity is
a polynomial of its values at Chebyshev points, and a root is finished on the quantity itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from stickslip.equations.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path, chebyshev_nodes, from_nodes
from stickslip.equations.system import System
from stickslip.model.crossings import root_between
from stickslip.model.when import When

__all__ = ["Borders", "Crossing", "Watch"]

Array = NDArray[np.float64]

_DEGREE = 20
_MORE = 3
"""By how much more than the state's the order of a quantity is taken that is a function of it."""
_PARTS = 4
"""Parts of the shortest period of the loads within which a quantity is a polynomial."""

_ROUGH = 1e-11
"""Part of what adds up in a quantity below which it is 0 at the start."""

_TINY = 1e-14
_AHEAD, _GROWTH, _LEAST = 2.0, 4.0, 1e-9
"""A motion is followed so many times longer than the one before took to a border, and ever further where none comes."""


class Crossing(NamedTuple):
    """A user's event at local time `tau` of a motion, with the sign that the quantity has from then on."""

    tau: float
    event: When
    sign: int


class Watch:
    """Watches the quantities of the user's events, path by path.

    Parameters
    ----------
    system : System
        Compiled with these quantities as the watched ones.
    events : sequence of When
    period : float
        Shortest period in s of the loads, infinite if they are straight.
    """

    def __init__(self, system: System, events: Sequence[When], period: float) -> None:
        self._system, self._events, self._period = system, list(events), period
        self._signs = [0] * len(self._events)

    def crossings(self, motion: Motion, path: Path) -> list[Crossing]:
        """Return the events along a path in order of time, up to the first that stops the simulation."""
        found: list[Crossing] = []
        edges = self._edges(path)
        nodes = chebyshev_nodes(_DEGREE)
        taus = edges[:-1, None] + np.diff(edges)[:, None] * nodes
        values, sizes = self._values(motion, path, taus.ravel())
        values = values.reshape(len(self._events), *taus.shape)
        after = list(self._signs)
        for k, event in enumerate(self._events):
            rough, noise = (part * float(sizes[k].max(initial=0.0)) for part in (_ROUGH, _TINY))
            of_one = self._along(motion, path, k)
            sign = after[k]
            first = values[k, 0, 0] if values[k].size else 0.0
            if sign and abs(first) > rough and (first > 0) != (sign > 0):
                # the quantity has jumped
                sign = -sign
                found.append(Crossing(0.0, event, sign))
            for left, row in enumerate(values[k]):
                least = rough if sign == 0 else noise
                for tau, now in _roots(edges[left], edges[left + 1], row, of_one, least, noise):
                    if sign == -now:
                        found.append(Crossing(tau, event, now))
                    sign = now
            after[k] = sign
        wanted = [one for one in found if one.event.direction in (0, one.sign)]
        wanted.sort(key=lambda one: one.tau)
        self._signs = after
        stops = [one for one in wanted if one.event.stop]
        return [one for one in wanted if one.tau <= stops[0].tau] if stops else wanted

    def _edges(self, path: Path) -> Array:
        edges, end = path.taus, float(path.taus[-1])
        if math.isfinite(self._period) and end > 0:
            parts = math.ceil(_PARTS * end / self._period)
            edges = np.union1d(edges, np.linspace(0.0, end, parts + 1))
        return np.unique(edges)

    def _values(self, motion: Motion, path: Path, taus: Array) -> tuple[Array, Array]:
        """Return the quantities at local times, a line each, and what adds up in them."""
        y = motion.exact(taus, path.at(taus).T)
        q = motion.inputs(taus, y, self._system.for_watched)[: self._system.inputs]
        return self._system.watched_values(q, y, motion.t + taus, taus, motion)

    def _along(self, motion: Motion, path: Path, k: int) -> Callable[[float], float]:
        return lambda tau: float(self._values(motion, path, np.array([tau]))[0][k, 0])


class Borders:
    """Keeps a run in the regions of its tables: each motion follows one line of each, up to the first border.

    The borders of gaps and stops are guards of the engines (`equations/piecewise.py`). Those of tables are not: a table
    may be looked up at what a function returns, and feeds normal forces, blocks and other tables. So its borders are
    found on the path.

    Parameters
    ----------
    system : System
        With tables that depend on the state.
    loads : Loads
        Tells motions the regions.
    """

    def __init__(self, system: System, loads: Loads) -> None:
        assert system.dependence is not None
        self._system, self._loads, self._dependence = system, loads, system.dependence
        # the largest values so far: what comes to a border has their roundoff
        self._sizes = np.zeros(len(system.dependence.tables))
        self._reach = math.inf

    def place(self, y: Array, t: float) -> None:
        """Find the regions in which a state lies; a region at whose border it lies is kept."""
        q = self._system.filled(self._loads.after(t).at(t), y, t)
        regions = self._loads.regions
        found = []
        for k, x in enumerate(self._dependence.looked_up(q, y).tolist()):
            region = self._dependence.region(k, x) if regions is None else regions[k]
            low, high = self._dependence.borders(k, region)
            ends = [abs(value) for value in (x, low, high) if math.isfinite(value)]
            rough = _ROUGH * max(*ends, float(self._sizes[k]))
            inside = low - rough <= x <= high + rough
            found.append(region if inside else self._dependence.region(k, x))
        self._loads.regions = tuple(found)

    def horizon(self, motion: Motion) -> float:
        """Return up to which local time to follow a motion: not much further than to the border that comes next."""
        return min(motion.horizon, self._reach)

    def cut(self, motion: Motion, path: Path) -> Path:
        """Return a path up to the first border; the regions are those beyond it."""
        found = self._cut(motion, path)
        length, whole = float(found.taus[-1]), float(path.taus[-1])
        if length < whole:
            self._reach = max(_AHEAD * length, _LEAST * motion.horizon)
        elif length >= self._reach:
            self._reach = _GROWTH * length
        return found

    def _cut(self, motion: Motion, path: Path) -> Path:
        regions = self._loads.regions
        if path.taus.size < 2 or regions is None:
            return path
        if self._stays_within(motion, path, regions):
            return path
        curved = not self._dependence.read_for_tables.isdisjoint(motion.stretch.bent.tolist())
        # where no load bends what is looked up, this is nearly a polynomial as the state is
        nodes = chebyshev_nodes(_DEGREE if curved else min(_DEGREE, path.coefficients.shape[1] + _MORE))
        taus = path.taus[:-1, None] + np.diff(path.taus)[:, None] * nodes
        values = self._values(motion, path, taus.ravel()).reshape(len(regions), *taus.shape)
        self._sizes = np.maximum(self._sizes, np.abs(values).max(axis=(1, 2)))
        first, left = math.inf, (0, 0)
        for k, region in enumerate(regions):
            for side, border in zip((-1, 1), self._dependence.borders(k, region), strict=True):
                if math.isfinite(border):
                    tau = self._exit(motion, path, k, side, border, side * (border - values[k]))
                    if tau < first:
                        first, left = tau, (k, side)
        if first > path.taus[-1]:
            return path
        k, side = left
        self._loads.regions = (*regions[:k], regions[k] + side, *regions[k + 1 :])
        if first >= path.taus[-1]:
            return path
        return path.cut(first) if first > 0 else path.until(0)

    def _stays_within(self, motion: Motion, path: Path, regions: tuple[int, ...]) -> bool:
        """Tell whether a bound shows that no table is left: what is looked up strays by its coefficients at most."""
        dependence, stretch = self._dependence, motion.stretch
        if dependence.for_tables or not stretch.is_straight:
            return False
        steps = np.diff(path.taus)
        for k, (number, region) in enumerate(zip(dependence.tables, regions, strict=True)):
            part = dependence.argument(number)
            value = path.coefficients[:, :, part.columns] @ part.S[0]
            drift = float(part.P[0] @ stretch.slope[part.places])
            since = motion.t - stretch.start + path.taus[:-1]
            first = value[:, 0] + part.P[0] @ stretch.value[part.places] + drift * since
            strays = np.abs(value[:, 1:]).sum(axis=1) + abs(drift) * steps
            low, high = dependence.borders(k, region)
            if not (np.all(first - strays > low) and np.all(first + strays < high)):
                return False
            self._sizes[k] = max(self._sizes[k], float(np.abs(first).max()))
        return True

    def _exit(self, motion: Motion, path: Path, k: int, side: int, border: float, depths: Array) -> float:
        """Return the first local time at which a table is left over one border, inf if it is not."""
        size = float(np.abs(depths).max()) + abs(border)
        # what has just come to a border has the roundoff of what it was before
        rough, noise = max(_ROUGH * size, _TINY * float(self._sizes[k])), _TINY * size

        def depth(tau: float) -> float:
            return side * (border - float(self._values(motion, path, np.array([tau]))[k, 0]))

        told = False
        for row, (start, stop) in zip(depths, pairwise(path.taus.tolist()), strict=True):
            for tau, sign in _roots(start, stop, row, depth, noise if told else rough, noise):
                if sign < 0:
                    return tau
                told = True
        return math.inf

    def _values(self, motion: Motion, path: Path, taus: Array) -> Array:
        y = motion.exact(taus, path.at(taus).T)
        q = motion.inputs(taus, y, self._dependence.for_tables)
        return self._dependence.looked_up(q[: self._system.inputs], y)


def _roots(
    left: float, right: float, values: Array, exact: Callable[[float], float], rough: float, noise: float
) -> list[tuple[float, int]]:
    """Return where a quantity takes a sign between two times, and which: at `left`, and after each of its roots."""
    signs = np.sign(np.where(np.abs(values) > rough, values, 0.0)).astype(int)
    c = from_nodes(values.size - 1) @ values
    some = int(signs[signs != 0][0]) if signs.any() else 0
    if abs(c[0]) > np.abs(c[1:]).sum() or not some:
        return [(left, some)] if some else []
    c = np.where(np.abs(c) > _TINY * np.abs(c).max(), c, 0.0)
    inner = chebyshev.chebroots(np.trim_zeros(c, "b"))
    real = np.sort(inner[np.abs(inner.imag) < 1e-6].real)
    marks = np.unique(np.concatenate([[-1.0], real[(real > -1.0) & (real < 1.0)], [1.0]]))
    middles = 0.5 * (marks[1:] + marks[:-1])
    found: list[tuple[float, int]] = []
    before: tuple[float, int] | None = None
    for x in [-1.0, *middles.tolist(), 1.0]:
        tau = left + 0.5 * (x + 1.0) * (right - left)
        value = exact(tau)
        if abs(value) <= (rough if before is None else noise):
            continue
        sign = 1 if value > 0 else -1
        if before is None:
            found.append((left, sign))
        elif sign != before[1]:
            root = root_between(exact, before[0], tau)
            found.append((root, sign))
        before = tau, sign
    return found
