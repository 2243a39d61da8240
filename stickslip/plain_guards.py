"""Guards of a small scene in plain arithmetic: a handful of numbers is no work for arrays.

A guard is ``a + b tau + c tau^2``, less ``rise exp(-(age + rate tau)) (n0 + n1 tau)`` while a static coefficient
rises (Breedveld 2000, eqs. 8 and 9).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import exp, inf

__all__ = ["Term", "not_positive", "smallest_of"]

Term = tuple[float, float, float, float, float, float, float, float]
"""The numbers a, b, c, rise, age, rate, n0, n1 of a guard; rise is 0 where nothing rises."""


def not_positive(terms: Sequence[Term], tau: float) -> list[Term]:
    """Return the guards that are not positive at local time `tau`."""
    return [term for term in terms if smallest_of([term])(tau) <= 0]


def smallest_of(terms: Sequence[Term]) -> Callable[[float], float]:
    """Return the smallest of some guards as a function of local time."""

    def smallest(tau: float) -> float:
        least = inf
        for a, b, c, rise, age, rate, n0, n1 in terms:
            value = a + tau * (b + tau * c)
            if rise:
                value -= rise * exp(-(age + tau * rate)) * (n0 + tau * n1)
            if value < least:
                least = value
        return least

    return smallest
