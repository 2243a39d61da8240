"""Quantities of the motion, on which forces, normal forces and the inputs of blocks may depend.

Sums and multiples of quantities and signals are linear: they enter the matrices of the equations. `feedback` is any
smooth function of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, Self, cast

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.checks import (
    as_number,
    check_entries,
    check_name,
    check_takes,
    finite,
    in_order,
    limit,
    name_of,
    sequence,
    whole,
)
from stickslip.model.signal_makers import signal_from_dict
from stickslip.model.signals import ZERO, Constant, Line, Load, Signal, as_signal


class Quantity(Load):
    """A load that depends on the motion; ``+`` and ``-`` take quantities, signals and numbers, ``*`` takes a number."""

    def __add__(self, other: Load | float) -> Expression:
        return _sum(as_expression(self), as_expression(other, "a quantity's summand"))

    __radd__ = __add__

    def __neg__(self) -> Expression:
        return self * -1.0

    def __sub__(self, other: Load | float) -> Expression:
        return self + -as_expression(other, "a quantity's subtrahend")

    def __rsub__(self, other: Load | float) -> Expression:
        return -self + other

    def __mul__(self, factor: float) -> Expression:
        if isinstance(factor, Load):
            raise TypeError(
                "quantities are scaled by numbers; use feedback(lambda a, b: a * b, first, second) for a product"
            )
        number, own = finite(factor, "a quantity's factor"), as_expression(self)
        return _sum(Expression(tuple((atom, number * c) for atom, c in own.terms), own.signal * number))

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Expression:
        number = finite(divisor, "a quantity's divisor")
        if number == 0:
            raise ValueError("a quantity's divisor must not be 0")
        return self * (1.0 / number)

    def inner(self) -> tuple[Quantity, ...]:
        """Return the quantities that this one is made of."""
        return ()

    def __str__(self) -> str:
        return f"{self.kind}({', '.join(map(str, self.inner() or vars(self).values()))})"

    def walk(self) -> Iterator[Quantity]:
        """Yield the quantity and all that it is made of."""
        yield self
        for part in self.inner():
            yield from part.walk()


@dataclass(frozen=True)
class Expression(Quantity):
    """``sum factor quantity + signal``."""

    kind = "expression"
    terms: tuple[tuple[Quantity, float], ...]
    signal: Signal = ZERO

    def inner(self) -> tuple[Quantity, ...]:
        """Return the terms."""
        return tuple(atom for atom, _ in self.terms)

    def __str__(self) -> str:
        parts = [str(atom) if factor == 1 else f"{factor:.6g} {atom}" for atom, factor in self.terms]
        if self.signal != ZERO or not parts:
            parts.append(f"{self.signal.value:.6g}" if isinstance(self.signal, Constant) else "s(t)")
        return " + ".join(parts).replace("+ -", "- ")

    def to_dict(self) -> dict[str, Any]:
        """Return terms and signal."""
        terms = [{"factor": factor, "quantity": atom.to_dict()} for atom, factor in self.terms]
        data: dict[str, Any] = {"type": self.kind, "terms": terms}
        return data if self.signal == ZERO else data | {"signal": self.signal.to_dict()}


@dataclass(frozen=True)
class Position(Quantity):
    """Position of a body or drive in m or rad."""

    kind = "position"
    body: str


@dataclass(frozen=True)
class Velocity(Quantity):
    """Velocity of a body or drive in m/s or rad/s."""

    kind = "velocity"
    body: str


@dataclass(frozen=True)
class OfRow(Quantity):
    """A quantity of a contact or another row."""

    row: str


@dataclass(frozen=True)
class RelativeVelocity(OfRow):
    """``w`` of a row in m/s or rad/s."""

    kind = "relative_velocity"


@dataclass(frozen=True)
class Stretch(OfRow):
    """``radius_a x_a - radius_b x_b`` of a row in m or rad."""

    kind = "stretch"


@dataclass(frozen=True)
class Normal(OfRow):
    """Normal force of a contact in N, or size of the force of a gap; 0 where it is open."""

    kind = "normal"


@dataclass(frozen=True)
class Power(OfRow):
    """Power ``r w`` that a row turns into heat, in W."""

    kind = "power"


@dataclass(frozen=True)
class Output(Quantity):
    """An output of a block."""

    kind = "output"
    block: str
    index: int = 0


@dataclass(frozen=True)
class Feedback(Quantity):
    """A smooth function of quantities."""

    kind = "feedback"
    function: Callable[..., float]
    arguments: tuple[Expression, ...]
    derivatives: Callable[..., Any] | tuple[Callable[..., float], ...] | None = None

    @property
    def label(self) -> str:
        """How messages name the function."""
        return f"feedback function {name_of(self.function)}"

    def inner(self) -> tuple[Quantity, ...]:
        """Return the arguments."""
        return self.arguments

    def to_dict(self) -> dict[str, Any]:
        """Refuse: code is not data."""
        raise ValueError(
            f"{self.label} is code, not data; write a table(quantity, xs, ys) or a sum of quantities for a file"
        )

    def value(self, arguments: Sequence[float]) -> float:
        """Return the function's value; a ValueError says where it is not a finite number."""
        try:
            found = self.function(*arguments)
        except Exception as error:
            raise ValueError(f"raised {error!r}") from error
        number = found if type(found) is float else as_number(found)
        if not math.isfinite(number):
            raise ValueError(f"returned {found!r}")
        return number

    def slopes(self, arguments: Sequence[float]) -> Array:
        """Return the derivatives with respect to the arguments, from the given functions."""
        given = self.derivatives
        assert given is not None
        try:
            if callable(given):
                found = np.atleast_1d(np.asarray(given(*arguments), dtype=float))
            else:
                found = np.array([float(one(*arguments)) for one in given])
        except Exception as error:
            raise ValueError(f"has derivatives that raised {error!r}") from error
        if found.shape != (len(arguments),) or not np.isfinite(found).all():
            raise ValueError(
                f"has derivatives that returned {found.tolist()!r}, but {len(arguments)} finite numbers are needed"
            )
        return found


@dataclass(frozen=True)
class Table(Quantity):
    """Straight lines through points over a quantity, with given slopes before the first and after the last."""

    kind = "table"
    quantity: Expression
    xs: tuple[float, ...]
    ys: tuple[float, ...]
    before: float = 0.0
    after: float = 0.0

    def checked(self) -> Self:
        """Return the table; refuse points out of order, and lines too steep for a number."""
        for (x0, y0), (x1, y1) in pairwise(zip(self.xs, self.ys, strict=True)):
            if not x0 < x1:
                raise ValueError(f"table: xs must increase, got {x1:g} after {x0:g}; sort the points")
            if not math.isfinite((y1 - y0) / (x1 - x0)):
                raise ValueError(f"table: the line from {x0:g} to {x1:g} is too steep for a number")
        return self

    def inner(self) -> tuple[Quantity, ...]:
        """Return the quantity that is looked up."""
        return (self.quantity,)

    def to_dict(self) -> dict[str, Any]:
        """Return the points and the quantity."""
        data: dict[str, Any] = {"type": self.kind, "quantity": self.quantity.to_dict()}
        data |= {"xs": list(self.xs), "ys": list(self.ys)}
        if self.before or self.after:
            data |= {"before": self.before, "after": self.after}
        return data

    @property
    def lines(self) -> list[tuple[float, float]]:
        """Value at 0 and slope of each line, the ones before the first and after the last point among them."""
        points = list(zip(self.xs, self.ys, strict=True))
        inner = [(y1 - y0) / (x1 - x0) for (x0, y0), (x1, y1) in pairwise(points)]
        slopes = [self.before, *inner, self.after]
        return [(y - slope * x, slope) for (x, y), slope in zip([points[0], *points], slopes, strict=True)]


def position(body: str) -> Quantity:
    """Return the position of a body or drive, in m or rad, as a quantity.

    Parameters
    ----------
    body : str
        Name of a body or drive, or GROUND.

    Raises
    ------
    TypeError
        If it is no name.
    """
    return Position(check_name(body, "position: body"))


def velocity(body: str) -> Quantity:
    """Return the velocity of a body or drive, in m/s or rad/s, as a quantity.

    Parameters
    ----------
    body : str
        Name of a body or drive, or GROUND.

    Raises
    ------
    TypeError
        If it is no name.
    """
    return Velocity(check_name(body, "velocity: body"))


def relative_velocity(row: str) -> Quantity:
    """Return ``w = radius_a v_a - radius_b v_b`` of a contact or another named row, in m/s or rad/s, as a quantity.

    Parameters
    ----------
    row : str
        Name of a contact, tie, gear, clutch, gap or stop.

    Raises
    ------
    TypeError
        If it is no name.
    """
    return RelativeVelocity(check_name(row, "relative_velocity: row"))


def stretch(row: str) -> Quantity:
    """Return ``radius_a x_a - radius_b x_b`` of a contact or another named row, in m or rad, as a quantity.

    Parameters
    ----------
    row : str
        Name of a contact, tie, gear, clutch, gap or stop.

    Raises
    ------
    TypeError
        If it is no name.
    """
    return Stretch(check_name(row, "stretch: row"))


def normal(contact: str) -> Quantity:
    """Return the normal force of a contact, or the size of the force of a gap, in N, as a quantity.

    It is 0 where the contact or the gap is open. So a gap may press a contact: a part that hops on a track.

    Parameters
    ----------
    contact : str
        Name of a contact or of a gap.

    Raises
    ------
    TypeError
        If it is no name.
    """
    return Normal(check_name(contact, "normal: contact"))


def power(row: str) -> Quantity:
    """Return the power ``r w`` that a contact turns into heat, in W, as a quantity; held rows make none.

    It is a product, so it has no Taylor series: CVODE takes the scene.

    Parameters
    ----------
    row : str
        Name of a contact.

    Raises
    ------
    TypeError
        If it is no name.
    """
    return Power(check_name(row, "power: row"))


def output(block: str, index: int = 0) -> Quantity:
    """Return an output of a block, counted from 0, as a quantity.

    Parameters
    ----------
    block : str
        Name of a block.
    index : int
        Which output, from 0 on.

    Raises
    ------
    TypeError, ValueError
        If the name is no name, or the number no number from 0 on.
    """
    return Output(check_name(block, "output: block"), whole(index, "output: index"))


TIME = Expression((), Line(1.0))  # the time t in s, as a quantity


def feedback(
    function: Callable[..., float],
    *quantities: Load | float,
    derivatives: Callable[..., Any] | Sequence[Callable[..., float]] | None = None,
) -> Quantity:
    """Return a smooth function of quantities as a quantity: ``function(*values)``.

    Parameters
    ----------
    function : callable
        Called with one number per quantity; returns a finite number. It should be smooth: where it bends, use
        `saturate` or `table`. Give friction that falls vertically from rest, such as ``exp(-sqrt(w))``, as ``kinetic=``
        of the law: only there is a contact that leaves rest along it followed closely.
    *quantities : Quantity, Signal or float
        Its arguments.
    derivatives : callable or sequence of callable, optional
        A function of the same arguments that returns all derivatives, or one function for each. They help the solver;
        without them differences are taken.

    Raises
    ------
    TypeError
        If `function` cannot be called with so many arguments, or an argument is no quantity.
    """
    if not callable(function) or isinstance(function, Load):
        raise TypeError(f"feedback: function must be callable, got {function!r}")
    if not quantities:
        raise TypeError("feedback: give at least one quantity, such as feedback(math.sin, position('bob'))")
    arguments = tuple(as_expression(q, f"feedback: argument {k + 1}") for k, q in enumerate(quantities))
    count = len(arguments)
    taken = f"{count} argument{'s' * (count > 1)}, one for each quantity"
    check_takes(function, count, "feedback: function", taken)
    if derivatives is not None and not callable(derivatives):
        given = tuple(in_order(derivatives, "feedback: derivatives", "functions"))
        if len(given) != count or not all(callable(one) for one in given):
            raise TypeError(
                f"feedback: derivatives must be a function, or one function for each of the {count} "
                f"quantities, got {derivatives!r}"
            )
        return Feedback(function, arguments, given)
    return Feedback(function, arguments, derivatives)


def saturate(quantity: Load | float, low: float, high: float) -> Quantity:
    """Return a quantity cut off below `low` and above `high`; its corners are located like events.

    Parameters
    ----------
    quantity : Quantity
    low, high : float
        The limits, in the unit of the quantity; -inf and inf for none.

    Raises
    ------
    TypeError, ValueError
        If it is no quantity, or the limits are not in order.
    """
    own = as_expression(quantity, "saturate: quantity")
    lowest, highest = limit(low, -math.inf, "saturate: low"), limit(high, math.inf, "saturate: high")
    if not lowest < highest:
        raise ValueError(f"saturate: low must be below high, got {lowest:g} and {highest:g}; exchange them")
    limits = tuple(x for x in (lowest, highest) if math.isfinite(x))
    if not limits:
        return own
    return Table(own, limits, limits, float(lowest == -math.inf), float(highest == math.inf))


def table(quantity: Load | float, xs: Sequence[float], ys: Sequence[float]) -> Table:
    """Return straight lines through points ``(xs[i], ys[i])`` over a quantity; the end values are held.

    Its corners are located like events, and it is exact in the series engine.

    Parameters
    ----------
    quantity : Quantity
    xs : sequence of float
        Values of the quantity, increasing.
    ys : sequence of float
        Values of the table there, equally many.

    Raises
    ------
    TypeError, ValueError
        If it is no quantity, or the points are not in order or not equally many.
    """
    own = as_expression(quantity, "table: quantity")
    places, values = sequence(xs, "table: xs"), sequence(ys, "table: ys")
    if len(places) != len(values) or len(places) < 2:
        raise ValueError(f"table: {len(places)} xs and {len(values)} ys; give equally many, at least two")
    return Table(own, places, values).checked()


def as_expression(value: Load | float, what: str = "a quantity") -> Expression:
    """Return a quantity, a signal or a number as an expression; refuse others with a message that names `what`."""
    if isinstance(value, Expression):
        return value
    if isinstance(value, Quantity):
        return Expression(((value, 1.0),))
    if not isinstance(value, Signal) and callable(value):
        raise TypeError(
            f"{what} must be a quantity, a signal or a number, got {value!r}; "
            "wrap a function of the state in feedback(function, ...), one of time in signal(function)"
        )
    try:
        return Expression((), as_signal(cast(Any, value), what))
    except TypeError:
        raise TypeError(f"{what} must be a quantity, a signal or a number, got {value!r}") from None


def as_load(value: Load | float, what: str) -> Signal | Expression:
    """Return a load in its simplest form: a number or signal as a signal, a quantity as an expression."""
    if not isinstance(value, Quantity):
        return as_signal(cast(Any, value), what).read_by(what)
    own = as_expression(value)
    signal = own.signal.read_by(what)
    return Expression(own.terms, signal) if own.terms else signal


def load_from_dict(data: Any, what: str) -> Load:
    """Return the signal or quantity that `to_dict` wrote; refuse other data with a message that begins with `what`."""
    kind = data.get("type") if isinstance(data, Mapping) else None
    makers = _MAKERS | {"table": partial(_read_table, what), "expression": partial(_read_expression, what)}
    if not isinstance(kind, str) or kind not in makers:
        return signal_from_dict(data, what, makers)
    fields = {name: value for name, value in data.items() if name != "type"}
    check_entries(makers[kind], kind, fields, what)
    try:
        return makers[kind](**fields)
    except (TypeError, ValueError) as error:
        text = str(error)
        raise type(error)(text if text.startswith(what) else f"{what}: {text}") from None


def _read_expression(what: str, terms: Any, signal: Any = 0.0) -> Load:
    if not isinstance(terms, (list, tuple)):
        raise TypeError(f"{what}: terms must be a list of tables, got {terms!r}")
    total = as_expression(load_from_dict(signal, f"{what}.signal"))
    for number, term in enumerate(terms):
        place = f"{what}.terms[{number}]"
        if not isinstance(term, Mapping) or set(term) != {"factor", "quantity"}:
            raise ValueError(f"{place}: expected a table with 'factor' and 'quantity', got {term!r}")
        total = total + as_expression(load_from_dict(term["quantity"], f"{place}.quantity")) * term["factor"]
    return total


def _read_table(what: str, quantity: Any, xs: Any, ys: Any, before: Any = 0.0, after: Any = 0.0) -> Load:
    own = as_expression(load_from_dict(quantity, f"{what}.quantity"))
    before, after = finite(before, f"{what}.before"), finite(after, f"{what}.after")
    places = sequence(xs, f"{what}.xs")
    # `saturate` with one limit makes a table of one point, which `table` refuses
    found = table(own, xs, ys) if len(places) > 1 else Table(own, places, sequence(ys, f"{what}.ys"))
    return replace(found, before=before, after=after)


# Makers of the quantities that are made of names, by the types that files give them.
_MAKERS: dict[str, Callable[..., Load]] = {
    maker.__name__: maker for maker in (position, velocity, relative_velocity, stretch, power, output)
}
_MAKERS["normal"] = lambda row: normal(row)  # noqa: PLW0108  (files call its argument row)


def _sum(*parts: Expression) -> Expression:
    """Return the sum with each quantity once."""
    factors: dict[Quantity, float] = {}
    total: Signal = ZERO
    for part in parts:
        for atom, factor in part.terms:
            factors[atom] = factors.get(atom, 0.0) + factor
        total = total + part.signal
    return Expression(tuple((atom, factor) for atom, factor in factors.items() if factor), total)
