"""Where a function of time crosses 0, and between which times it is positive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from math import ceil, isfinite

import numpy as np
import scipy

_SAMPLES_AT_LEAST = 20
_ROUNDOFF = 1e-12

# Part of an interval where a function may be asked for its sign: seldom where it only touches 0, as halves are.
INSIDE = 0.6180339887


def crossings(
    value: Callable[[float], float],
    slope: Callable[[float], float],
    left: float,
    right: float,
    distance: float,
) -> Iterator[float]:
    """Find the times between `left` and `right` at which a function crosses 0.

    Samples tell where its sign changes. Where it turns round between two samples of one sign, its extremum is
    looked at too, so that short dips are not missed; one that only touches 0 is no crossing. The function is smooth
    from `left` up to but not at `right`, `slope` is its derivative, and `distance` the longest time between samples.
    """
    samples = ceil((right - left) / distance) if isfinite(distance) else 0
    times = np.linspace(left, np.nextafter(right, left), max(samples, _SAMPLES_AT_LEAST) + 1).tolist()
    values = [value(t) for t in times]
    roundoff = _ROUNDOFF * max(map(abs, values))
    near = 1e-15 * max(abs(left), abs(right))
    for (t0, v0), (t1, v1) in pairwise(zip(times, values, strict=True)):
        points = [(t0, v0), (t1, v1)]
        if v0 == 0 and t0 > left:
            yield t0
        elif v0 * v1 > 0 and v0 * slope(t0) < 0 < v1 * slope(t1):
            turn = root_between(slope, t0, t1)
            if v0 * (extremum := value(turn)) < 0 and abs(extremum) > roundoff:
                points.insert(1, (turn, extremum))
        for (a, va), (b, vb) in pairwise(points):
            if min(va, vb) < 0 < max(va, vb) and left + near < (zero := root_between(value, a, b)) < right - near:
                yield zero


def positive_pieces(
    value: Callable[[float], float], slope: Callable[[float], float], ends: Sequence[float], distance: float
) -> tuple[tuple[float, ...], tuple[bool, ...]]:
    """Tell where a function is positive that is smooth between its `ends`: start, breaks and stop.

    Returned are its kinks, which are zero crossings and the breaks at which it is positive, and whether it is positive
    before the first of them, between them, and after the last.
    """
    zeros = {t for left, right in pairwise(ends) for t in crossings(value, slope, left, right, distance)}
    times = sorted(zeros.union(ends))
    pieces = [value(a + INSIDE * (b - a)) > 0 for a, b in pairwise(times)]
    breaks, kinks, positive = set(ends), [], pieces[:1]
    for t, (before, after) in zip(times[1:], pairwise(pieces), strict=False):
        if before != after or (before and t in breaks):
            kinks.append(t)
            positive.append(after)
    return tuple(kinks), tuple(positive)


def root_between(function: Callable[[float], float], a: float, b: float) -> float:
    """Return a root of a function whose signs differ at `a` and `b > a`.

    Its error is roundoff of the root, or of the interval: a function that is a breath above 0 at 0 has a root that no
    bisection reaches otherwise.
    """
    # scipy wraps what it is given in a circle: let go of the function, and of the motion that it knows
    known = [function]

    def value(x: float) -> float:
        return known[0](x)

    try:
        return float(scipy.optimize.brentq(value, a, b, xtol=1e-16 * (b - a), rtol=1e-15, maxiter=1000))
    finally:
        known.clear()
