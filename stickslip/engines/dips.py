"""Looking at guards between computed points, where root finding by sign changes is blind.

Two crossings inside one step leave no change of sign: where a guard dips below zero and comes back, the first
point at which it is negative is found here, and the solver is sent there. Only steps are looked at in which a bound
does not exclude that.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from stickslip.equations.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path

__all__ = ["first_dip"]

Array = NDArray[np.float64]

_FRACTIONS = np.array([0.25, 0.5, 0.75, 1.0])
_SUSPICION = 5e-2
_FEW_TURNS = 3
_DWELLS = np.geomspace(0.02, 40.0, 24)


def first_dip(motion: Motion, guards: Guards, path: Path) -> float | None:
    """Return the first time between computed points at which a guard is negative, if there is one."""
    taus = path.taus
    if not guards.size or taus.size < 2:
        return None
    low = guards.lower_bounds(path)
    some = np.asarray((low <= 0).any(axis=0))
    if not some.any():
        return None
    # a turn shows beside its neighbours
    some[:-1] |= some[1:]
    some[1:] |= some[:-1]
    looks = (taus[:-1, None] + np.diff(taus)[:, None] * _FRACTIONS)[some].ravel()
    if motion.dwell_times.size and np.isinf(low).any():
        extra = np.multiply.outer(motion.dwell_times, _DWELLS).ravel()
        looks = np.unique(np.concatenate([looks, extra[extra < taus[-1]]]))
    if path.hit and some[-1]:
        looks = looks[:-1]
    if not looks.size:
        return None

    def values(tau: Array) -> Array:
        return guards.values(tau, motion.exact(tau, path.at(tau).T), late=True)

    found = _first_negative(looks, values(looks), values)
    return found if np.isfinite(found) else None


def _first_negative(taus: Array, values: Array, guards: Callable[[Array], Array]) -> float:
    """Return the first sampled time with a negative guard, refining where one comes close and turns."""
    negative = np.flatnonzero(values.min(axis=0, initial=np.inf) < 0)
    last = int(negative[0]) if negative.size else taus.size
    found = float(taus[negative[0]]) if negative.size else np.inf
    if last < 3:
        return found
    places, rows = np.nonzero(_may_dip(taus[:last], values[:, :last]).T)
    if places.size > _FEW_TURNS:
        close = _come_close(guards, taus[places], taus[places + 2], rows)
        places, rows = places[close], rows[close]
    for place, row in zip(places.tolist(), rows.tolist(), strict=True):
        lowest = scipy.optimize.minimize_scalar(
            lambda tau, row=row: float(guards(np.array([tau]))[row, 0]),
            bounds=(taus[place], taus[place + 2]),
            method="bounded",
            options={"xatol": 1e-9 * (taus[place + 2] - taus[place])},
        )
        if lowest.fun < 0:
            return min(found, float(lowest.x))
    return found


def _come_close(
    guards: Callable[[Array], Array], left: Array, right: Array, rows: NDArray[np.intp]
) -> NDArray[np.bool_]:
    """Tell which guards that turn between `left` and `right` come near zero: all together, by narrower parabolas."""

    def at(taus: Array) -> Array:
        return guards(taus)[rows, np.arange(rows.size)]

    middle, half = 0.5 * (left + right), 0.5 * (right - left)
    scale = np.zeros(rows.size)
    for _ in range(3):
        low, value, high = at(middle - half), at(middle), at(middle + half)
        bend = low - 2 * value + high
        scale = np.maximum(scale, np.abs(bend))
        with np.errstate(invalid="ignore", divide="ignore"):
            shift = np.where(bend > 0, 0.5 * (low - high) / bend, 0.0)
        middle, half = middle + np.clip(shift, -1.0, 1.0) * half, half / 8
        middle = np.clip(middle, left + half, right - half)
    return at(middle) <= 1e-6 * scale


def _may_dip(taus: Array, values: Array) -> NDArray[np.bool_]:
    """Tell at which inner samples a guard turns and the parabola through its neighbours comes near zero."""
    left, middle, right = values[:, :-2], values[:, 1:-1], values[:, 2:]
    before, after = np.diff(taus)[:-1], np.diff(taus)[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        falling, rising = (middle - left) / before, (right - middle) / after
        bend = (rising - falling) / (before + after)
        lowest = middle - (falling + bend * before) ** 2 / (4 * bend)
        near = lowest <= _SUSPICION * bend * np.maximum(before, after) ** 2
    return np.asarray(near & (middle <= left) & (middle <= right))
