"""A small motion written out in plain floats: on a few numbers, arrays cost ten times what they compute.

It covers motions whose inputs are lines between breaks, with friction that slips in known directions. Then the rates,
and the guards but for levels that rise, are ``c + c' tau + row (y, e)``, with the friction forces ``e`` that depend on
velocity. Each becomes a line of a Python function, which names only what is not 0; forces that no line names are not
computed. Functions of the same shape are compiled once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from types import CodeType
from typing import Any, NamedTuple, TypeVar

import numpy as np

from stickslip.model.arrays import Array

_Made = TypeVar("_Made")
_MOST = 50
"""Functions that are remembered of one set of modes."""


class Line(NamedTuple):
    """``value + slope tau + row x``."""

    value: float
    slope: float
    row: list[float]


class LawInFloats(NamedTuple):
    """A contact whose friction depends on its relative velocity: that, its normal force, and its law."""

    w: Line
    normal: float
    normal_slope: float
    law: Callable[[float, float], float]


def lines(value: Array, slope: Array, *parts: Array) -> list[Line]:
    """Return quantities as lines; the parts of their rows stand side by side."""
    return [Line(*x) for x in zip(value.tolist(), slope.tolist(), np.hstack(parts).tolist(), strict=True)]


def rates_of(rates: list[Line], laws: list[LawInFloats]) -> Callable[[float, Array, Array], None]:
    """Return a function of local time, states and an array that it fills with their rates."""
    text = _Text(rates, laws)
    found: Callable[[float, Array, Array], None] = text.function(
        "tau, y, out", [f"out[{k}] = {text.sum(rate)}" for k, rate in enumerate(rates)]
    )
    return found


def smallest_of(guards: list[Line], laws: list[LawInFloats]) -> Callable[[float, Array], float]:
    """Return a function of local time and states that tells the smallest guard."""
    text = _Text(guards, laws)
    sums = ", ".join(map(text.sum, guards))
    found: Callable[[float, Array], float] = text.function(
        "tau, y", [f"return min({sums})" if len(guards) > 1 else f"return {sums}"]
    )
    return found


def remembered(known: dict[bytes, _Made], make: Callable[[], _Made], *numbers: Array) -> _Made:
    """Return what has been made of these numbers before, else make it: a motion often comes back with the same."""
    key = b"".join([part.tobytes() for part in numbers])
    if key not in known:
        if len(known) >= _MOST:
            known.pop(next(iter(known)))
        known[key] = make()
    return known[key]


class _Text:
    """The numbers that a function names, and its lines up to the forces that it needs."""

    def __init__(self, quantities: list[Line], laws: list[LawInFloats]) -> None:
        size = len(quantities[0].row) - len(laws)
        self._known: dict[str, Any] = {}
        self._columns = ["", "tau", *(f"x{i}" for i in range(size)), *(f"e{k}" for k in range(len(laws)))]
        self._lines = ["".join(f"x{i}, " for i in range(size)) + "= y.tolist()"]
        for k, (w, normal, slope, law) in enumerate(laws):
            if any(line.row[size + k] for line in quantities):
                self._known[f"law{k}"] = law
                pressed = f"max({self.sum(Line(normal, slope, []))}, 0.0)"
                self._lines.append(f"e{k} = law{k}({self.sum(w)}, {pressed})")

    def sum(self, line: Line) -> str:
        """Return a line as a sum of the terms that are not 0."""
        terms = []
        for number, column in zip([line.value, line.slope, *line.row], self._columns, strict=False):
            if number == 1 and column:
                terms.append(column)
            elif number:
                self._known[name := f"c{len(self._known)}"] = number
                terms.append(f"{name} * {column}" if column else name)
        return " + ".join(terms) or "0.0"

    def function(self, arguments: str, ending: list[str]) -> Any:
        """Return the function."""
        body = "\n    ".join([*self._lines, *ending])
        exec(_compiled(f"def f({arguments}):\n    {body}\n"), self._known)
        return self._known["f"]


@lru_cache(maxsize=256)
def _compiled(text: str) -> CodeType:
    return compile(text, __name__, "exec")
