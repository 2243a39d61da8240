"""Slopes of functions by differences over steps within which the functions hardly bend."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stickslip.model.arrays import Array

# A step is short enough if the slopes to its two points differ by less than the first part, if the slope is the same as
# over a longer step but for the second part, or if the bend changes the value by less than the third part.
_BENDS, _SAME, _ROUNDOFF = 1e-5, 1e-6, 1e-8

_SHORTER, _TRIES = 32.0, 8  # by how much a step that is too long is shortened, and how often at most


def slope_by_differences(function: Callable[[float], Array | float], x: float, first: float, second: float) -> Array:
    """Return the slopes of the values of a function at `x` by differences of second order.

    ``f' = (s1 d2 - s2 d1) / (d2 - d1)`` with the slopes ``s = (f(x + d) - f(x)) / d`` to two points. Their distances
    `first` and `second` differ in size: to mirrored points the slopes of an odd function are the same. On which scale
    the function bends is not known. So where the slopes differ, both points are taken nearer, until roundoff is left.
    """
    value = np.asarray(function(x), dtype=float)
    slopes, rough = np.full(value.shape, np.inf), np.ones(value.shape, dtype=bool)
    for _ in range(_TRIES):
        d1, d2 = (x + first) - x, (x + second) - x
        if not d1 or not d2 or d1 == d2:
            break
        s1, s2 = ((np.asarray(function(x + d)) - value) / d for d in (d1, d2))
        last, slopes = slopes, np.where(rough, (s1 * d2 - s2 * d1) / (d2 - d1), slopes)
        apart, reach = np.abs(s1 - s2), max(abs(d1), abs(d2))
        rough &= (apart > _BENDS * np.maximum(np.abs(s1), np.abs(s2))) & (apart * reach > _ROUNDOFF * np.abs(value))
        rough &= np.abs(slopes - last) > _SAME * np.abs(slopes)
        if not rough.any():
            break
        first, second = first / _SHORTER, second / _SHORTER
    return np.where(np.isinf(slopes), 0.0, slopes)
