"""Look at guards between computed points, where root finding by sign changes is blind.

Two crossings inside one step leave no change of sign. Where a guard dips below 0 and comes back, this module finds the
first place at which it is negative; `passing` finds where it was 0. It also finds velocities that only touch 0, as far
as the solver's errors allow to distinguish them from those that turn above 0. Steps in which a bound excludes both are
left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from stickslip.engines.solvers.guards_along import GuardsAlong
from stickslip.model.arrays import Array, Mask

# Near the quarters of a step, but not even: at even places an oscillation may look like a line.
_PLACES = np.array([0.0, 0.23, 0.49, 0.77, 1.0])

_THIRD = np.zeros((5, 2))  # weights of the two third differences at these places
_THIRD[:4, 0], _THIRD[1:, 1] = (
    6 / 4**3 / np.prod(some[:, None] - some + np.eye(4), axis=1) for some in (_PLACES[:4], _PLACES[1:])
)

# How often a step is halved at most in which third differences are large, and of how many parts at once at most.
_HALVINGS, _AT_MOST = 12, 1000

_SMALL = 0.1  # third differences up to this part of a guard's range in a step are small
_FAR = 0.1  # and so are those up to this part of its least value there
_BEFORE_END = 1e-3  # guards are also looked at this part of the last step before its end
_SUSPICION = 5e-2
_DWELLS = np.geomspace(0.02, 40.0, 24)

# A velocity that turns within this part of its uncertainty above 0 touches 0: errors seldom add up fully.
_TOUCHES = 0.1

# A velocity must first come down from so many times that distance: else a touch may be a ripple.
_FROM_ABOVE = 1e2


class Dip(NamedTuple):
    """Where in local time a guard is negative; `touched` is the row whose relative velocity only touches 0 there."""

    tau: float
    touched: int | None = None


def first_dip(along: GuardsAlong) -> Dip | None:
    """Return the first place between computed points at which a guard is negative or a velocity touches 0."""
    motion, guards, low, taus = along.motion, along.guards, along.low, along.path.taus
    touch = _TOUCHES * np.where(guards.stick_at_touch, guards.uncertain, 0.0)
    close = low <= touch[:, None]
    if along.path.hit and along.falls_at_end(close[:, -1]):
        # guards that fall throughout the last step come to 0 only once, at the end
        close[:, -1] = False
    rows, some = np.flatnonzero(close.any(axis=1)), np.asarray(close.any(axis=0))
    if not rows.size:
        return None
    if not along.is_exact(rows):
        rows = np.arange(guards.size)
    low, touch = low[rows], touch[rows]
    # a turn is found by comparing samples: look at the neighbouring steps, too
    some[:-1] |= some[1:]
    some[1:] |= some[:-1]

    def values(tau: Array) -> Array:
        return along.values(rows, tau, with_leeway=True)

    looks, ends = _looks(values, ~along.are_exact[rows], taus[:-1][some], taus[1:][some])
    extra = []
    if motion.dwell_times.size and np.isinf(low).any():
        since = np.multiply.outer(motion.dwell_times, _DWELLS).ravel()
        extra.append(since[since < taus[-1]])
    if along.path.hit and some[-1]:
        # to see whether a guard that is not negative at the end rises there
        extra.append(taus[-1:] - _BEFORE_END * (taus[-1] - taus[-2]))
    if extra:
        more = np.concatenate(extra)
        looks, which = np.unique(np.append(looks, more), return_index=True)
        ends = np.hstack([ends, values(more)])[:, which]
    begin = np.where(guards.order == 0, guards.first[0], -np.inf)[rows]
    highest = _highest(looks, ends, np.column_stack([begin, low]), taus)
    found = _first_negative(looks, ends, values, np.where(highest >= _FROM_ABOVE * touch[:, None], touch[:, None], 0.0))
    if found is None:
        return None
    tau, row = found
    if row is None:
        return None if along.path.hit and tau >= taus[-1] else Dip(tau)
    # the place of the minimum, once more, between wider bounds
    place = int(looks.searchsorted(tau))
    left, right = looks[max(place - 2, 0)], looks[min(place + 1, looks.size - 1)]
    return Dip(_lowest(values, row, left, right)[0], int(guards.row[rows[row]]))


def _highest(looks: Array, values: Array, low: Array, taus: Array) -> Array:
    """Return the largest known value of each guard up to each look, from its values and its lower bounds in steps."""
    reached = np.maximum.accumulate(np.where(np.isfinite(values), values, -np.inf), axis=1)
    return np.asarray(np.maximum(reached, np.maximum.accumulate(low, axis=1)[:, taus.searchsorted(looks) - 1]))


def _looks(guards: Callable[[Array], Array], bend: Mask, left: Array, right: Array) -> tuple[Array, Array]:
    """Return places in some steps, and the guards there; halve steps in which guards that `bend` are not resolved.

    A solver's error test does not see a function of states that does not act on the motion: the normal force on a
    contact at rest may rise and fall many times within a step.
    """
    places, values = [], []
    for _ in range(_HALVINGS):
        taus = left[:, None] + (right - left)[:, None] * _PLACES
        g = guards(taus.ravel())
        places.append(taus.ravel())
        values.append(g)
        some = g[bend].reshape(-1, *taus.shape)
        least = some.min(axis=2)
        with np.errstate(invalid="ignore"):
            third = np.abs(some @ _THIRD).max(axis=2)
            spread = some.max(axis=2) - least
            turns = ((third > _SMALL * spread) & (third > _FAR * least)).any(axis=0)
        if not 0 < turns.sum() <= _AT_MOST:
            break
        left, right, middle = left[turns], right[turns], taus[turns, 2]
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
    found, which = np.unique(np.concatenate(places), return_index=True)
    # the start is left out: there a motion obeys its modes
    return found[found > 0], np.hstack(values)[:, which[found > 0]]


def _first_negative(
    taus: Array, values: Array, guards: Callable[[Array], Array], touch: Array
) -> tuple[float, int | None] | None:
    """Return the first sampled time with a negative guard, refining where one comes close and turns.

    A guard that turns above 0, but within `touch` (guards, times), touches 0: then its number comes second.
    """
    negative = np.flatnonzero(values.min(axis=0, initial=np.inf) < 0)
    found = (float(taus[negative[0]]), None) if negative.size else None
    # another guard may have turned before that; to see this takes the sample behind the first negative one
    seen = min(int(negative[0]) + 2, taus.size) if negative.size else taus.size
    if seen < 3:
        return found
    places, rows = np.nonzero(_may_dip(taus[:seen], values[:, :seen], touch[:, :seen]).T)
    for place, row in zip(places.tolist(), rows.tolist(), strict=True):
        tau, value = _lowest(guards, row, taus[place], taus[place + 2])
        if found is not None and tau >= found[0]:
            continue
        if value < 0:
            return tau, None
        if 0 < touch[row, place + 1] >= value:
            return tau, row
    return found


def _lowest(guards: Callable[[Array], Array], row: int, left: float, right: float) -> tuple[float, float]:
    """Return where a guard is lowest between two times, and its value there."""
    found = scipy.optimize.minimize_scalar(
        lambda tau: float(guards(np.array([tau]))[row, 0]),
        bounds=(left, right),
        method="bounded",
        options={"xatol": 1e-9 * (right - left)},
    )
    return float(found.x), float(found.fun)


def _may_dip(taus: Array, values: Array, touch: Array) -> Mask:
    """Tell at which inner samples a guard turns and the parabola through its neighbours comes near zero or `touch`."""
    left, middle, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
    before, after = np.diff(taus)[:-1], np.diff(taus)[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        falling, rising = (middle - left) / before, (right - middle) / after
        bend = (rising - falling) / (before + after)
        lowest = middle - (falling + bend * before) ** 2 / (4 * bend)
        near = lowest <= _SUSPICION * bend * np.maximum(before, after) ** 2 + touch[:, 1:-1]
    return np.asarray(near & (middle <= left) & (middle <= right))
