"""Slopes of functions by differences over steps within which the functions hardly bend."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

# A step is short enough if the slopes to its two points differ by less than the first part, if the slope is the same as
# over a longer step but for the second part, or if the bend changes the value by less than the third part.
_BENDS, _SAME, _ROUNDOFF = 3e-5, 1e-6, 1e-8

_SHORTER, _TRIES = 32.0, 8  # by how much a step that is too long is shortened, and how often at most


def slopes_by_differences(
    function: Callable[[float], Sequence[float]], x: float, first: float, second: float
) -> list[float]:
    """Return the slopes of the values of a function at `x` by differences of second order.

    ``f' = (s1 d2 - s2 d1) / (d2 - d1)`` with the slopes ``s = (f(x + d) - f(x)) / d`` to two points. Their distances
    `first` and `second` differ in size: to mirrored points the slopes of an odd function are the same. On which scale
    the function bends is not known. So where the slopes differ, both points are taken nearer, until roundoff is left.
    """
    values = function(x)
    slopes, rough = [math.inf] * len(values), list(range(len(values)))
    for _ in range(_TRIES):
        d1, d2 = (x + first) - x, (x + second) - x
        if not rough or not d1 or not d2 or d1 == d2:
            break
        near, far, reach, left = function(x + d1), function(x + d2), max(abs(d1), abs(d2)), []
        for k in rough:
            value = values[k]
            s1, s2 = (near[k] - value) / d1, (far[k] - value) / d2
            last, slopes[k] = slopes[k], (s1 * d2 - s2 * d1) / (d2 - d1)
            apart = abs(s1 - s2)
            bends = apart > _BENDS * max(abs(s1), abs(s2)) and apart * reach > _ROUNDOFF * abs(value)
            if bends and abs(slopes[k] - last) > _SAME * abs(slopes[k]):
                left.append(k)
        rough, first, second = left, first / _SHORTER, second / _SHORTER
    return [slope if slope < math.inf else 0.0 for slope in slopes]


def slope_by_differences(function: Callable[[float], float], x: float, first: float, second: float) -> float:
    """Return the slope of a function of one value, as `slopes_by_differences` does: fast where it hardly bends."""
    d1, d2 = (x + first) - x, (x + second) - x
    if d1 and d2 and d1 != d2:
        value = function(x)
        s1, s2 = (function(x + d1) - value) / d1, (function(x + d2) - value) / d2
        if abs(s1 - s2) <= _BENDS * abs(s1):
            return (s1 * d2 - s2 * d1) / (d2 - d1)
    return slopes_by_differences(lambda at: (function(at),), x, first, second)[0]
