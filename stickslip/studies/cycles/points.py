"""What changes between two cycles of a branch: multipliers pass the unit circle, or the sequence of modes changes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
import scipy

from stickslip.model.arrays import Complex
from stickslip.studies.cycles.branches import BranchPoint
from stickslip.studies.cycles.cycle import Cycle, from_zero
from stickslip.studies.cycles.phases import alike, in_words
from stickslip.studies.cycles.pseudo_arclength import ERRORS

_MOST_CHANGES = 8  # most changes of the sequence of modes that are looked for between two values

_AT_CIRCLE = 1e-9  # a multiplier within this distance from the unit circle is on neither side of it


class Reached(NamedTuple):
    """A cycle and its value; if the way to a further value ends there, also why, and before which value."""

    cycle: Cycle
    value: float
    why: str = ""
    end: float = np.nan


# Follows a cycle to another value; if the last argument is true, so carefully that no step leads to another branch.
Follow = Callable[[Reached, float, bool], Reached]


def points_between(a: Reached, b: Reached, accuracy: float, follow: Follow) -> list[BranchPoint]:
    """Return where multipliers pass the unit circle or the sequence of modes changes, from one cycle to another."""
    found: list[BranchPoint] = []
    for _ in range(_MOST_CHANGES):
        if alike(a.cycle, b.cycle):
            break
        before, after = _at_change(a, b, accuracy, follow)
        said = in_words(before.cycle, after.cycle)
        if abs(after.value - before.value) > accuracy:
            said += f"; somewhere between {before.value:.9g} and {after.value:.9g}"
        found += _passes(a, before, accuracy, follow)
        found.append(BranchPoint(0.5 * (before.value + after.value), "sequence", said, from_zero(before.cycle)))
        a = after
    return found + (_passes(a, b, accuracy, follow) if alike(a.cycle, b.cycle) else [])


def _at_change(a: Reached, b: Reached, accuracy: float, follow: Follow) -> tuple[Reached, Reached]:
    """Find by bisection the first change of the sequence of modes, and return the cycles before and after it."""
    while abs(b.value - a.value) > accuracy:
        middle = 0.5 * (a.value + b.value)
        if middle in (a.value, b.value):
            break
        for near in (a, b):
            with suppress(*ERRORS):
                one = follow(near, middle, False)
                break
        else:
            break
        a, b = (one, b) if alike(one.cycle, a.cycle) else (a, one)
    return a, b


def _passes(a: Reached, b: Reached, accuracy: float, follow: Follow) -> list[BranchPoint]:
    """Return where multipliers pass the unit circle, from one cycle to another of the same sequence."""
    found = []
    for kind, (test, said) in _PASSES.items():
        # in a family of cycles a multiplier is 1 but for roundoff
        in_family = kind == "crossing" and (a.cycle.neutral or b.cycle.neutral)
        if in_family or test(a.cycle.multipliers) * test(b.cycle.multipliers) >= 0:
            continue
        known = {a.value: a, b.value: b}

        def at(x: float, known: dict[float, Reached] = known, test: Callable[[Complex], float] = test) -> float:
            if x not in known:
                nearest = min(known.values(), key=lambda one: abs(one.value - x))
                known[x] = follow(nearest, x, True)
            return test(known[x].cycle.multipliers)

        try:
            value, where = float(scipy.optimize.brentq(at, a.value, b.value, xtol=accuracy)), ""
        except ERRORS:
            before, after = _around(known, test)
            value, where = 0.5 * (before + after), f"; somewhere between {before:.9g} and {after:.9g}"
        nearest = min(known.values(), key=lambda one: abs(one.value - value))
        if kind != "torus" or _is_pair(nearest.cycle.multipliers):
            found.append(BranchPoint(value, kind, said + where, from_zero(nearest.cycle)))
    return found


def _around(known: dict[float, Reached], test: Callable[[Complex], float]) -> tuple[float, float]:
    """Return the nearest values between which a test changes its sign."""
    values = sorted(known)
    signs = [test(known[x].cycle.multipliers) > 0 for x in values]
    changes = [(x, y) for x, y, s, u in zip(values, values[1:], signs, signs[1:], strict=False) if s != u]
    return min(changes, key=lambda one: one[1] - one[0])


def _product(factors: Complex) -> float:
    """Return a number with the sign of the product of factors, 0 where one of them is 0 within its error."""
    if np.abs(factors).min(initial=1.0) <= _AT_CIRCLE:
        return 0.0
    # scaled: the product of many large factors would overflow
    return float(np.prod(factors / (1.0 + np.abs(factors))).real)


def _pairs(multipliers: Complex) -> Complex:
    """Return 1 less the product of any two: 0 for a complex pair on the unit circle, but also for 2 and 1/2."""
    one, other = np.triu_indices(multipliers.size, 1)
    return np.asarray(1.0 - multipliers[one] * multipliers[other])


def _is_pair(multipliers: Complex) -> bool:
    """Tell whether the two multipliers whose product is nearest to 1 are a complex pair, not two real ones."""
    one = np.triu_indices(multipliers.size, 1)[0][np.abs(_pairs(multipliers)).argmin()]
    return bool(abs(multipliers[one].imag) > _AT_CIRCLE)


# How multipliers pass the unit circle: for each kind a number that changes its sign there, and words.
_PASSES: dict[str, tuple[Callable[[Complex], float], str]] = {
    "crossing": (
        lambda found: _product(1.0 - found),
        "a multiplier passes 1: a symmetry breaks, or another branch crosses",
    ),
    "flip": (lambda found: _product(1.0 + found), "a multiplier passes -1: the period doubles"),
    "torus": (lambda found: _product(_pairs(found)), "a pair of multipliers passes the unit circle"),
}
