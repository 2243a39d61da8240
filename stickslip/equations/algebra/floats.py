"""A small motion written out in plain floats: on a few numbers, arrays cost ten times what they compute.

Quantities are sums over columns: 1, local time, the states, and the values of terms, which are functions of sums over
the columns before them. Terms are friction that depends on velocity, sines, functions of the user, and levels that
rise. The sums become the lines of a Python function, which name only entries that are not 0; terms that no line names
are not computed. Sums with the same pattern of entries share one function, compiled once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stickslip.model.arrays import Array, Indices

STATES = 2  # the first column of the states
_ONE = 2


class Term(NamedTuple):
    """A function of sums, a line of `arguments` each; it returns a number, or `width` of them where that is above 1."""

    function: Callable[..., Any]
    arguments: Array
    width: int = 1


class Columns:
    """The columns of a motion with so many `states`, and at most so many values of `terms`."""

    def __init__(self, states: int, most: int) -> None:
        self.states = slice(STATES, STATES + states)
        self.terms: list[Term] = []
        self.looked_up: list[Array] = []
        """The arguments of tables."""
        self.count = STATES + states + most
        self._next = STATES + states

    def line(self, value: float, slope: float) -> Array:
        """Return the sum ``value + slope tau``."""
        found = np.zeros(self.count)
        found[:STATES] = value, slope
        return found

    def state(self, place: int) -> Array:
        """Return a state as a sum."""
        found = np.zeros(self.count)
        found[STATES + place] = 1.0
        return found

    def time(self, t: float) -> Array:
        """Return the time, where local time runs from `t`."""
        return self.line(t, 1.0)

    def add(self, function: Callable[..., Any], arguments: Sequence[Array] | Array, width: int = 1) -> Indices:
        """Add a term, and return its columns."""
        self.terms.append(Term(function, np.array(arguments), width))
        self._next += width
        return np.arange(self._next - width, self._next)


class Sums(NamedTuple):
    """What moves a small motion, as sums over `columns`: its `inputs` and dwells, a line each.

    The friction forces that depend on velocity are the columns `forces`, the rates of bristles `bristle_rates`.
    """

    columns: Columns
    inputs: Array
    forces: list[int]
    bristle_rates: list[int]


class _Made(NamedTuple):
    """The places of the numbers that a text names, the terms that it calls, and what makes its function of both."""

    numbers: Indices
    terms: list[int]
    make: Callable[..., Any]


def rates_of(rates: Array, terms: Sequence[Term]) -> Callable[[float, Array, Array], None]:
    """Return a function of local time, states and an array that it fills with their rates."""
    found: Callable[[float, Array, Array], None] = _function("rates", rates, terms)
    return found


def smallest_of(guards: Array, terms: Sequence[Term]) -> Callable[[float, Array], float]:
    """Return a function of local time and states that returns the smallest guard."""
    found: Callable[[float, Array], float] = _function("smallest", guards, terms)
    return found


def _function(kind: str, quantities: Array, terms: Sequence[Term]) -> Any:
    entries = np.concatenate([*(term.arguments for term in terms), quantities])
    pattern = (entries != 0).astype(np.int8)
    pattern += entries == 1
    shapes = tuple((len(term.arguments), term.width) for term in terms)
    made = _made(kind, shapes, entries.shape, pattern.tobytes())
    numbers = entries.ravel()[made.numbers].tolist()
    return made.make(*numbers, *(terms[k].function for k in made.terms))


@lru_cache(maxsize=256)
def _made(kind: str, shapes: tuple[tuple[int, int], ...], shape: tuple[int, int], entries: bytes) -> _Made:
    """Return the function of sums with this pattern of entries: 0 for the number 0, 2 for the number 1, else 1.

    The arguments of the terms come first. The `shapes` are how many lines and how many columns of values each term has.
    """
    text = _Text(shapes, np.frombuffer(entries, dtype=np.int8).reshape(shape))
    sums = [text.sum(line) for line in range(text.first_quantity, shape[0])]
    if kind == "rates":
        head, ending = "tau, y, out", [f"out[{k}] = {one}" for k, one in enumerate(sums)]
    else:
        head, ending = "tau, y", [f"return min({', '.join(sums)})" if len(sums) > 1 else f"return {sums[0]}"]
    body = "\n        ".join([*text.start(), *ending])
    outer = ", ".join([*(f"c{k}" for k in range(len(text.numbers))), *(f"f{k}" for k in text.called)])
    space: dict[str, Any] = {}
    exec(f"def make({outer}):\n    def f({head}):\n        {body}\n    return f\n", space)
    return _Made(np.array(text.numbers, dtype=np.intp), text.called, space["make"])


class _Text:
    """Sums as text.

    `numbers` are the places of the entries that it has named so far, and `called` the terms that quantities need.
    """

    def __init__(self, shapes: tuple[tuple[int, int], ...], pattern: NDArray[np.int8]) -> None:
        self._pattern, self.numbers = pattern, list[int]()
        values = sum(width for _, width in shapes)
        self._states = pattern.shape[1] - STATES - values
        self._names = ["", "tau", *_numbered("x", self._states), *_numbered("u", values)]
        lines = accumulate((count for count, _ in shapes), initial=0)
        columns = accumulate((width for _, width in shapes), initial=STATES + self._states)
        self._arguments, self._values = ([slice(*ends) for ends in pairwise(x)] for x in (lines, columns))
        self.first_quantity = self._arguments[-1].stop if shapes else 0
        self.called: list[int] = []
        named = np.asarray(pattern[self.first_quantity :].any(axis=0))
        for k in reversed(range(len(shapes))):
            if named[self._values[k]].any():
                self.called.insert(0, k)
                named |= pattern[self._arguments[k]].any(axis=0)

    def start(self) -> list[str]:
        """Return the lines that name the states and the values of the terms."""
        found = ["".join(f"{name}, " for name in _numbered("x", self._states)) + "= y.tolist()"]
        for k in self.called:
            lines = self._arguments[k]
            given = ", ".join(map(self.sum, range(lines.start, lines.stop)))
            found.append(f"{', '.join(self._names[self._values[k]])} = f{k}({given})")
        return found

    def sum(self, line: int) -> str:
        """Return a line as a sum of the entries that are not 0."""
        parts = []
        for column in self._pattern[line].nonzero()[0].tolist():
            name = self._names[column]
            if self._pattern[line, column] == _ONE and name:
                parts.append(name)
                continue
            number = f"c{len(self.numbers)}"
            parts.append(f"{number} * {name}" if name else number)
            self.numbers.append(line * self._pattern.shape[1] + column)
        return " + ".join(parts) or "0.0"


def _numbered(letter: str, count: int) -> list[str]:
    return [f"{letter}{k}" for k in range(count)]
