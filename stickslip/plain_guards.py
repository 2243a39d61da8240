"""Guards of a small scene in plain arithmetic: a handful of numbers is no work for arrays.

A guard is ``a + b tau + c tau^2``, less ``rise exp(-(age + rate tau)) (n0 + n1 tau)`` while a static coefficient
rises (Breedveld 2000, eqs. 8 and 9).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import exp, inf

__all__ = ["Term", "not_positive", "smallest_of", "value"]

Term = tuple[float, float, float, float, float, float, float, float]
"""The numbers a, b, c, rise, age, rate, n0, n1 of a guard; rise is 0 where nothing rises."""


def value(term: Term, tau: float) -> float:
    """Return a guard at local time `tau`."""
    a, b, c, rise, age, rate, n0, n1 = term
    polynomial = a + tau * (b + tau * c)
    return polynomial - rise * exp(-(age + tau * rate)) * (n0 + tau * n1) if rise else polynomial


def not_positive(terms: Sequence[Term], tau: float) -> list[Term]:
    """Return the guards that are not positive at local time `tau`."""
    return [term for term in terms if value(term, tau) <= 0]


def smallest_of(terms: Sequence[Term]) -> Callable[[float], float]:
    """Return the smallest of some guards as a function of local time."""
    if len(terms) == 1:
        return partial(value, terms[0])
    return lambda tau: min((value(term, tau) for term in terms), default=inf)
