"""Where a function of time crosses 0, and between which times it is positive."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from math import ceil, isfinite

import numpy as np
import scipy

_SAMPLES_AT_LEAST = 20
_ROUNDOFF = 1e-12

# Where in an interval, as a part of its length, the sign of a function is tested: at one half it may just touch 0.
INSIDE = 0.6180339887


def crossings(
    value: Callable[[float], float],
    slope: Callable[[float], float],
    left: float,
    right: float,
    distance: float,
) -> Iterator[float]:
    """Find the times between `left` and `right` at which a function crosses 0.

    Samples show where its sign changes. Where it turns back towards 0 between two samples of one sign, its extremum is
    looked at too, so that short dips are not missed; an extremum that only touches 0 is no crossing. A sample that is
    exactly 0 counts as a crossing. The function is smooth from `left` up to but not at `right`, `slope` is its
    derivative, and `distance` the longest time between samples.
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
    """Return the kinks of ``max(0, f)``, and whether f is positive before the first, between them, and after the last.

    The function f is smooth between its `ends`: start, breaks and stop. Kinks are its zero crossings, and the breaks
    at which it is positive.
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

    Its error is roundoff of the root, or of the length of the interval if that is larger: a root very near 0 would take
    too many bisections to find to its own roundoff.
    """
    # scipy makes a reference cycle with the function that it is given. Emptying the list lets go of `function`, and of
    # the motion that it refers to.
    known = [function]

    def value(x: float) -> float:
        return known[0](x)

    try:
        return float(scipy.optimize.brentq(value, a, b, xtol=1e-16 * (b - a), rtol=1e-15, maxiter=1000))
    finally:
        known.clear()
