"""Slopes of functions by differences over steps within which the functions hardly bend."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

# A step is short enough if the slopes to its two points differ by less than the first part, if the slope is the same as
# over a longer step but for the second part, or if the bend changes the value by less than the third part.
_BENDS, _SAME, _ROUNDOFF = 3e-5, 1e-6, 1e-8

STEP = 1e-6  # in s, over which a function of time without a period is differenced
FARTHER = 10.0  # by this factor points are farther apart for a slope of slopes: these are differences themselves
SLOPES_STEP = 1e-5  # both together: the uncertainty of a slope over this step is that of the slope of slopes

_SHORTER, _TRIES = 32.0, 8  # by how much a step that is too long is shortened, and how often at most


def slopes_by_differences(
    function: Callable[[float], Sequence[float]], x: float, first: float, second: float, roundoff: float = 0.0
) -> list[float]:
    """Return the slopes of the values of a function at `x` by differences of second order.

    ``f' = (s1 d2 - s2 d1) / (d2 - d1)`` with the slopes ``s = (f(x + d) - f(x)) / d`` to two points. Their distances
    `first` and `second` differ in size: to mirrored points the slopes of an odd function are the same. On which scale
    the function bends is not known. So where the slopes differ, both points are taken nearer. If that ends in
    roundoff, the slope counts that changes least from step to step. If the `roundoff` of the values is known, the
    points are not taken so near that it decides. Where the values at all three points are equal, the slope is 0.
    """
    values = function(x)
    slopes, rough = [0.0] * len(values), list(range(len(values)))
    best, least = slopes.copy(), [math.inf] * len(values)
    for number in range(_TRIES):
        d1, d2 = (x + first) - x, (x + second) - x
        if not rough or not d1 or not d2 or d1 == d2:
            break
        near, far, reach, left = function(x + d1), function(x + d2), max(abs(d1), abs(d2)), []
        for k in rough:
            value = values[k]
            if near[k] == value == far[k]:
                slopes[k] = 0.0
                continue
            s1, s2 = (near[k] - value) / d1, (far[k] - value) / d2
            slope, apart = (s1 * d2 - s2 * d1) / (d2 - d1), abs(s1 - s2)
            change = abs(slope - slopes[k]) if number else math.inf
            if change * min(abs(d1), abs(d2)) <= roundoff:
                # the slope over the longer step is the better one, and stays
                continue
            slopes[k] = slope
            if change <= least[k]:
                best[k], least[k] = slope, change
            bends = apart > _BENDS * max(abs(s1), abs(s2)) and apart * reach > _ROUNDOFF * abs(value)
            if bends and change > _SAME * abs(slope):
                left.append(k)
        rough, first, second = left, first / _SHORTER, second / _SHORTER
    for k in rough:
        slopes[k] = best[k]
    return slopes


def slope_by_differences(
    function: Callable[[float], float], x: float, first: float, second: float, roundoff: float = 0.0
) -> float:
    """Return the slope of a function of one value, as `slopes_by_differences` does: fast where it hardly bends."""
    d1, d2 = (x + first) - x, (x + second) - x
    if d1 and d2 and d1 != d2:
        value = function(x)
        s1, s2 = (function(x + d1) - value) / d1, (function(x + d2) - value) / d2
        if abs(s1 - s2) <= _BENDS * abs(s1):
            return (s1 * d2 - s2 * d1) / (d2 - d1)
    return slopes_by_differences(lambda at: (function(at),), x, first, second, roundoff)[0]
