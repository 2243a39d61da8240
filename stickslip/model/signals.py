"""Loads over time, as frozen data: they have a value and a slope at every time, add up and scale.

At a jump the value is the right limit. ``breaks`` are the times at which the value or the slope jumps: the solver stops
there and starts afresh.
"""

from __future__ import annotations

import math
import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np

from stickslip.model.arrays import Array
from stickslip.model.checks import as_number, every_digit, finite, name_of
from stickslip.model.crossings import positive_pieces
from stickslip.model.slopes import FARTHER, STEP, slope_by_differences

_SAMPLES_PER_PERIOD = 16
_MOST_PERIODS = 1e6  # looking for zeros in this many periods takes half a minute
_HIGHEST_FREQUENCY = 1e100  # largest frequency in 1/s whose powers and products do not overflow
_PARTS = tuple(math.fmod(0.6180339887 * k, 1.0) for k in range(1, 21))  # of a time span, where functions are looked at
_JUMP = 1e-3  # a change over next to no time is a jump beyond this part of the largest value
_QUANTA = 4.0  # times the least change of a function that a difference of its values is uncertain
_ROUGH = 1e-11  # part of the largest value beyond which roundoff asks for longer differences
_FINE = 1e-14  # the same part for which differences over the usual step are best
_SHORTEST = 1e-9  # step in s over which a function mostly changes
_LONG = 0.05  # part of a time span over which a function changes unless it is constant there
_SURELY = 1e-12  # part of the sizes of its terms by which the lower bound of a sum must be above 0, for roundoff

# The method of a load that answers where a number or an array of NumPy stands on the left.
_REFLECTED: dict[np.ufunc, str] = {
    np.add: "__radd__",
    np.subtract: "__rsub__",
    np.multiply: "__rmul__",
    np.true_divide: "__rtruediv__",
    **dict.fromkeys((np.less, np.less_equal, np.greater, np.greater_equal), "__lt__"),
}


class Load:
    """A force, a normal force or an input: a signal, or a quantity of the motion."""

    kind: ClassVar[str] = ""
    """Its type in scene files; empty where it cannot be written to one."""

    def to_dict(self) -> Any:
        """Return the load as plain data."""
        if not self.kind:
            raise TypeError(f"a {type(self).__name__} signal is not data; write the signal it was made from")
        fields = {name: list(x) if isinstance(x, tuple) else x for name, x in vars(self).items()}
        return {"type": self.kind} | fields

    def checked(self) -> Self:
        """Return the load; refuse numbers that do not go together, such as times out of order."""
        return self

    def __pow__(self, exponent: Any) -> Any:
        raise TypeError(self._not_linear(f"x**{exponent!r}"))

    def __rtruediv__(self, dividend: Any) -> Any:
        raise TypeError(self._not_linear(f"{dividend!r} / x"))

    def __abs__(self) -> Any:
        raise TypeError(self._not_linear("abs(x)"))

    def __float__(self) -> float:
        # functions such as math.sin call this
        raise TypeError(self._not_linear("math.sin(x)"))

    def __lt__(self, other: Any) -> Any:
        raise TypeError(
            "a load has no value before the simulation runs, so it cannot be compared; "
            "use When(name, quantity - limit) for a crossing, saturate(...) for a limit, "
            "feedback(...) for anything else"
        )

    __le__ = __gt__ = __ge__ = __lt__

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """Let the load compute ``+`` and ``*`` with NumPy's numbers; refuse NumPy's functions."""
        if ufunc in (np.equal, np.not_equal):
            return ufunc is np.not_equal
        if ufunc in _REFLECTED and inputs[-1] is self:
            return getattr(self, _REFLECTED[ufunc])(inputs[0])
        raise TypeError(self._not_linear(f"np.{ufunc.__name__}(x)"))

    def _not_linear(self, shown: str) -> str:
        """Return a message that says what to write for a function that is not linear."""
        if isinstance(self, Signal):
            of_time = re.sub(r"\bx\b", "s(t)", shown)
            return f"signals are only added and scaled; write a function of time: signal(lambda t: {of_time})"
        return f"quantities are only added and scaled; use feedback(lambda x: {shown}, quantity)"


class Signal(Load):
    """A load over time: ``signal(t)`` is its value; ``+`` adds signals and numbers, ``*`` scales by a number."""

    def __call__(self, t: float) -> float:
        """Return the value at `t` (the right limit where it jumps)."""
        return self.at(finite(t, "a signal is called with one time in s, which"))

    def at(self, t: float) -> float:
        """Return the value at `t`, which is known to be a number."""
        raise NotImplementedError

    @property
    def roundoff(self) -> float:
        """How uncertain the values are; 0 where that is the roundoff of their terms."""
        return 0.0

    @property
    def slope_roundoff(self) -> float:
        """How uncertain slopes are at least; 0 where that is little."""
        return 0.0

    def slope(self, t: float) -> float:
        """Return the derivative at `t` (the right limit where it jumps)."""
        raise NotImplementedError

    def sampled(self, times: Array) -> Array:
        """Return the values at many times."""
        return np.array([self.at(t) for t in times.tolist()])

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the times in ``start < t < stop`` at which the value or the slope jumps."""
        return ()

    def points(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the breaks, and the points that would be breaks if the signal had other values there."""
        return self.breaks(start, stop)

    @property
    def period(self) -> float | None:
        """Shortest time in which the signal oscillates: None where it is piecewise linear, inf if unknown."""
        return None

    def parts(self, t: float | None = None) -> Iterator[Signal]:
        """Yield the lines, sines and functions that add up to the signal from `t` up to its next break.

        Without `t`, yield all that are part of the signal at any time.
        """
        yield self

    def clipped(self, start: float, stop: float) -> Signal:
        """Return ``max(0, signal)``, with its kinks within the time span among the breaks."""
        return Clipped.of(self, start, stop)

    def within(self, start: float, stop: float) -> Signal:
        """Return the signal for one time span: functions are called within it only."""
        return self

    def read_by(self, what: str) -> Signal:
        """Return the signal as read by `what`: messages about its functions begin with that."""
        return self

    def scaled(self, factor: float) -> Signal:
        """Return the signal times a number that is not 0."""
        raise TypeError(f"a {type(self).__name__} signal cannot be scaled; scale the signal it was made from")

    def __add__(self, other: Signal | float) -> Signal:
        if _is_quantity(other):
            return NotImplemented
        return _sum(self, as_signal(other, "a signal's summand"))

    __radd__ = __add__

    def __neg__(self) -> Signal:
        return self * -1.0

    def __sub__(self, other: Signal | float) -> Signal:
        if _is_quantity(other):
            return NotImplemented
        return self + -as_signal(other, "a signal's subtrahend")

    def __rsub__(self, other: float) -> Signal:
        return -self + other

    def __mul__(self, factor: float) -> Signal:
        if isinstance(factor, Signal):
            raise TypeError("signals are scaled by numbers, not by signals; use signal(function) for a product")
        if isinstance(factor, Load):
            raise TypeError(
                "signals are scaled by numbers; use feedback(lambda a, b: a * b, signal, quantity) for a product"
            )
        number = finite(factor, "a signal's factor")
        return self.scaled(number) if number else ZERO

    __rmul__ = __mul__

    def __truediv__(self, divisor: float) -> Signal:
        number = finite(divisor, "a signal's divisor")
        if number == 0:
            raise ValueError("a signal's divisor must not be 0")
        return self * (1.0 / number)


@dataclass(frozen=True)
class Constant(Signal):
    """A number at all times."""

    value: float

    def at(self, t: float) -> float:
        """Return the number."""
        return self.value

    def slope(self, t: float) -> float:
        """Return 0."""
        return 0.0

    def clipped(self, start: float, stop: float) -> Signal:
        """Return the number, or 0 where it is negative."""
        return self if self.value >= 0 else ZERO

    def scaled(self, factor: float) -> Signal:
        """Return the number times another."""
        return Constant(factor * self.value)

    def to_dict(self) -> float:
        """Return the number."""
        return self.value


ZERO = Constant(0.0)


@dataclass(frozen=True)
class Line(Signal):
    """A straight line for all times: ``offset + rise t``."""

    kind = "line"
    rise: float
    offset: float = 0.0

    def at(self, t: float) -> float:
        """Return the value at `t`."""
        return self.offset + self.rise * t

    def slope(self, t: float) -> float:
        """Return the rise."""
        return self.rise

    def clipped(self, start: float, stop: float) -> Signal:
        """Return the line within the time span, cut off where it crosses 0."""
        return PiecewiseLinear((start, stop), (self.at(start), self.at(stop))).clipped(start, stop)

    def scaled(self, factor: float) -> Signal:
        """Return the line times a number."""
        return Line(factor * self.rise, factor * self.offset)


@dataclass(frozen=True)
class PiecewiseLinear(Signal):
    """Straight lines between points; the end values are held and a repeated time is a jump."""

    kind = "piecewise_linear"
    times: tuple[float, ...]
    values: tuple[float, ...]

    def checked(self) -> Self:
        """Return the lines; refuse times out of order or thrice the same, and lines too steep for a number."""
        for (t0, v0), (t1, v1) in pairwise(zip(self.times, self.values, strict=True)):
            if t1 < t0:
                order = f"{every_digit(t1)} after {every_digit(t0)}"
                raise ValueError(f"piecewise_linear: times must not decrease, got {order}; sort the points")
            if t1 > t0 and not math.isfinite((v1 - v0) / (t1 - t0)):
                raise ValueError(
                    f"piecewise_linear: the line from {t0:g} s to {t1:g} s is too steep for a number; "
                    "give the same time twice to make it a jump"
                )
        for t0, t2 in zip(self.times, self.times[2:], strict=False):
            if t0 == t2:
                raise ValueError(f"piecewise_linear: time {t0:g} stands three times; twice makes a jump")
        return self

    def at(self, t: float) -> float:
        """Return the value at `t`, after the jump where it jumps."""
        _, _, start, value, rise, length = self.line(t)
        return value + rise * ((t - start) / length) if rise else value

    def line(self, t: float) -> tuple[float, float, float, float, float, float]:
        """Return the line that begins or goes on at `t`: since when and until when it holds, and its numbers.

        These are the time and the value at its start, its rise, and its length in s. Before the first point and after
        the last one, where values are held, the rise is 0 over 1 s.
        """
        times, values = self.times, self.values
        i = bisect_right(times, t)
        if i == 0:
            return -math.inf, times[0], 0.0, values[0], 0.0, 1.0
        since, value = times[i - 1], values[i - 1]
        if i == len(times):
            return since, math.inf, 0.0, value, 0.0, 1.0
        return since, times[i], since, value, values[i] - value, times[i] - since

    def before(self, t: float) -> float:
        """Return the left limit at `t`."""
        i = bisect_left(self.times, t)
        return self.values[i] if i < len(self.times) and self.times[i] == t else self.at(t)

    def slope(self, t: float) -> float:
        """Return the slope of the line that begins or goes on at `t`."""
        return self._slope_of(bisect_right(self.times, t))

    def _slope_of(self, i: int) -> float:
        """Return the slope of the line that ends at point `i`."""
        if i in (0, len(self.times)):
            return 0.0
        return (self.values[i] - self.values[i - 1]) / (self.times[i] - self.times[i - 1])

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the times of the kinks and jumps; a point in the middle of a line is none."""
        found = []
        i, end = bisect_right(self.times, start), bisect_left(self.times, stop)
        while i < end:
            t = self.times[i]
            after = bisect_right(self.times, t, lo=i)
            if self.values[after - 1] != self.values[i] or self._slope_of(i) != self._slope_of(after):
                found.append(t)
            i = after
        return tuple(found)

    def points(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the times of all points."""
        some = slice(bisect_right(self.times, start), bisect_left(self.times, stop))
        return tuple(dict.fromkeys(self.times[some]))

    def clipped(self, start: float, stop: float) -> Signal:
        """Return the signal with its negative parts cut off where their lines cross 0."""
        if min(self.values) >= 0:
            return self
        if max(self.values) <= 0:
            return ZERO
        points = [(self.times[0], self.values[0])]
        for (t0, v0), (t1, v1) in pairwise(zip(self.times, self.values, strict=True)):
            if t1 > t0 and min(v0, v1) < 0 < max(v0, v1):
                points.append((t0 + (t1 - t0) * (v0 / (v0 - v1)), 0.0))
            points.append((t1, v1))
        return PiecewiseLinear(tuple(t for t, _ in points), tuple(max(0.0, v) for _, v in points))

    def scaled(self, factor: float) -> Signal:
        """Return the lines through the scaled values."""
        return PiecewiseLinear(self.times, tuple(factor * v for v in self.values))


@dataclass(frozen=True)
class Sine(Signal):
    """``offset + amplitude sin(2 pi frequency t + phase)``."""

    kind = "sine"
    amplitude: float
    frequency: float
    phase: float = 0.0
    offset: float = 0.0

    def checked(self) -> Self:
        """Return the sine; refuse a frequency whose powers would overflow."""
        if abs(self.frequency) > _HIGHEST_FREQUENCY:
            raise ValueError(f"sine: frequency must be at most {_HIGHEST_FREQUENCY:g} in size, got {self.frequency:g}")
        return self

    def _angle(self, t: float) -> float:
        # whole turns are dropped first: late in a long run the sine is as exact as frequency times t
        return 2 * math.pi * math.fmod(self.frequency * t, 1.0) + self.phase

    def at(self, t: float) -> float:
        """Return the value at `t`."""
        return self.offset + self.amplitude * math.sin(self._angle(t))

    def slope(self, t: float) -> float:
        """Return the derivative at `t`."""
        return self.amplitude * 2 * math.pi * self.frequency * math.cos(self._angle(t))

    @property
    def period(self) -> float | None:
        """The time of one turn."""
        return 1.0 / abs(self.frequency) if self.frequency else None

    def scaled(self, factor: float) -> Signal:
        """Return the sine with its amplitude and offset scaled."""
        return Sine(factor * self.amplitude, self.frequency, self.phase, factor * self.offset)


@dataclass(frozen=True)
class Function(Signal):
    """Any function of time; its jumps and kinks have to be named as breaks."""

    function: Callable[[float], float]
    break_times: tuple[float, ...] = ()
    shortest_period: float | None = None
    factor: float = 1.0
    limits: tuple[float, float] = (-math.inf, math.inf)
    reader: str = field(default="", compare=False, repr=False)
    is_slope: bool = field(default=False, compare=False, repr=False)
    """Whether the values are slopes of another function: differences, which are far more rough."""
    known_roundoff: float = field(default=0.0, compare=False, repr=False)
    """How uncertain the values are at least."""

    def at(self, t: float) -> float:
        """Return the value at `t`; a ValueError says where it is not a finite number."""
        low, high = self.limits
        if not low <= t <= high:
            return self._beyond(t, low if t < low else high)
        try:
            value = self.function(t)
        except Exception as error:
            raise ValueError(f"{self._label} raised {error!r} at t={t:g}; return a finite number") from error
        if type(value) is not float or not math.isfinite(value):
            if not math.isfinite(number := as_number(value)):
                raise ValueError(f"{self._label} returned {value!r} at t={t:g}; return one finite number")
            value = number
        return self.factor * value

    def _beyond(self, t: float, limit: float) -> float:
        """Return the value at `t` beyond a `limit` of the time span, extrapolated by a parabola."""
        half = 0.5 * (self.limits[1] - self.limits[0])
        d = max(-half, min(t - limit, half))
        return 3 * self.at(limit) - 3 * self.at(limit - d) + self.at(limit - 2 * d)

    @property
    def roundoff(self) -> float:
        """How uncertain the values are, 0 without a time span.

        At some times it is measured by how much they change at least; the largest of these changes counts.
        """
        return self._measured[0]

    @cached_property
    def _measured(self) -> tuple[float, float]:
        """The roundoff of the values, and the largest value that was met."""
        (low, high), found, largest = self.limits, 0.0, 0.0
        for part in _PARTS if math.isfinite(high - low) else ():
            t = low + part * (high - low)
            with suppress(ValueError):
                value = self.at(t)
                found, largest = max(found, self._least_change(t, value)), max(largest, abs(value))
        # where a function jumps from one instant to the next, that is no roundoff
        return max(self.known_roundoff, _QUANTA * found if found <= _JUMP * largest else 0.0), largest

    def _least_change(self, t: float, value: float) -> float:
        """Return by how much the value at `t` changes at least later, 0 where it stays the same for long."""
        low, high = self.limits
        step = math.ulp(max(abs(low), abs(high)))
        same, longest = 0.0, min(high - t, _LONG * (high - low))
        while (change := abs(self.at(t + step) - value)) == 0 and step < longest:
            same, step = step, min(8 * step, longest)
        if change and step > _SHORTEST:
            # what has been the same for long changes by a quantum from one instant to the next, or begins to grow
            while same < (middle := 0.5 * (same + step)) < step:
                after = abs(self.at(t + middle) - value)
                same, step, change = (middle, step, change) if after == 0 else (same, middle, after)
        return change

    @property
    def slope_roundoff(self) -> float:
        """How uncertain slopes are at least where the values are rough."""
        return self.roundoff / self._step if self._farther > 1 and not self.is_slope else 0.0

    @property
    def _step(self) -> float:
        """The step in s over which the function is differenced."""
        return self._farther * (3e-6 * self.shortest_period if self.shortest_period else STEP)

    @cached_property
    def _farther(self) -> float:
        """How much longer than others the differences of a function are that is more rough: single precision, say."""
        if self.is_slope:
            return FARTHER
        roundoff, largest = self._measured
        return (roundoff / (_FINE * largest)) ** (1 / 3) if roundoff > _ROUGH * largest else 1.0

    def slope(self, t: float) -> float:
        """Return a difference quotient of second order; no break and no limit lies between its points."""
        # the function feels the roundoff of its time
        h = self._step if self.shortest_period else max(self._step, 1e-9 * self._farther * abs(t))
        times = self.break_times
        i = bisect_right(times, t)
        behind = t - max(self.limits[0], times[i - 1] if i else -math.inf)
        ahead = min(self.limits[1], times[i] if i < len(times) else math.inf) - t
        if min(behind, ahead) > 2 * h:
            return slope_by_differences(self.at, t, h, -2 * h, self.roundoff)
        h = math.copysign(min(h, 0.4 * max(ahead, behind)), ahead - behind)
        return slope_by_differences(self.at, t, h, 2 * h, self.roundoff)

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the given breaks between `start` and `stop`."""
        return self.break_times[bisect_right(self.break_times, start) : bisect_left(self.break_times, stop)]

    @property
    def period(self) -> float | None:
        """The given period; inf if none was given."""
        return math.inf if self.shortest_period is None else self.shortest_period

    def scaled(self, factor: float) -> Signal:
        """Return the function times a number."""
        return replace(self, factor=factor * self.factor)

    def within(self, start: float, stop: float) -> Signal:
        """Return the signal for one time span: the function is called within it only."""
        return replace(self, limits=(start, stop))

    def read_by(self, what: str) -> Signal:
        """Return the function as read by `what`, for messages."""
        return replace(self, reader=what)

    def to_dict(self) -> Any:
        """Refuse: code is not data."""
        raise ValueError(f"{self._name} is code, not data; sample it into piecewise_linear(times, values) for a file")

    @property
    def _name(self) -> str:
        return f"signal function {name_of(self.function)}"

    @property
    def _label(self) -> str:
        return f"{self.reader}: {self._name}" if self.reader else self._name


@dataclass(frozen=True)
class Sum(Signal):
    """A sum of signals that no single kind can hold."""

    terms: tuple[Signal, ...]

    def at(self, t: float) -> float:
        """Return the sum of the values."""
        return sum(term.at(t) for term in self.terms)

    def slope(self, t: float) -> float:
        """Return the sum of the slopes."""
        return sum(term.slope(t) for term in self.terms)

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the breaks of all terms."""
        return tuple(sorted({b for term in self.terms for b in term.breaks(start, stop)}))

    def points(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the points of all terms."""
        return tuple(sorted({b for term in self.terms for b in term.points(start, stop)}))

    @property
    def period(self) -> float | None:
        """The shortest period of the terms."""
        return min((p for term in self.terms if (p := term.period) is not None), default=None)

    def parts(self, t: float | None = None) -> Iterator[Signal]:
        """Yield the parts of all terms."""
        for term in self.terms:
            yield from term.parts(t)

    def within(self, start: float, stop: float) -> Signal:
        """Return the sum for one time span."""
        return Sum(tuple(term.within(start, stop) for term in self.terms))

    def read_by(self, what: str) -> Signal:
        """Return the sum as read by `what`."""
        return Sum(tuple(term.read_by(what) for term in self.terms))

    def scaled(self, factor: float) -> Signal:
        """Return the sum of the scaled terms."""
        return Sum(tuple(term.scaled(factor) for term in self.terms))

    def to_dict(self) -> dict[str, Any]:
        """Return the terms."""
        return {"type": "sum", "terms": [term.to_dict() for term in self.terms]}


@dataclass(frozen=True)
class Clipped(Signal):
    """``max(0, base)`` within one time span; `positive` says before, between and after `kinks` whether the base is."""

    base: Signal
    kinks: tuple[float, ...]
    positive: tuple[bool, ...]

    @classmethod
    def of(cls, base: Signal, start: float, stop: float) -> Signal:
        """Return a curved signal cut off where it is negative; its zero crossings are found as roots."""
        base = base.within(start, stop)
        least, size = _lower_bound(base)
        if least > _SURELY * size:
            return base
        period = time_scale(base, stop - start)
        if stop - start > _MOST_PERIODS * period:
            raise ValueError(
                f"a normal force may come to 0 in {(stop - start) / period:.3g} periods of {period:.3g} s, too "
                f"many to look through; simulate {_MOST_PERIODS:g} of them at most, or keep it above 0"
            )
        distance = period / _SAMPLES_PER_PERIOD
        ends = (start, *base.breaks(start, stop), stop)
        kinks, positive = positive_pieces(base.at, base.slope, ends, distance)
        if not any(positive):
            return ZERO
        return base if all(positive) else cls(base, kinks, positive)

    def _is_positive(self, t: float) -> bool:
        return self.positive[bisect_right(self.kinks, t)]

    def at(self, t: float) -> float:
        """Return the value at `t`, never negative."""
        return max(0.0, self.base.at(t)) if self._is_positive(t) else 0.0

    def slope(self, t: float) -> float:
        """Return the slope of the base, 0 where the base is cut off."""
        return self.base.slope(t) if self._is_positive(t) else 0.0

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the zero crossings, and the breaks of the base where it is positive."""
        return self.kinks[bisect_right(self.kinks, start) : bisect_left(self.kinks, stop)]

    @property
    def period(self) -> float | None:
        """The period of the base."""
        return self.base.period

    def parts(self, t: float | None = None) -> Iterator[Signal]:
        """Yield the parts of the base, none where the base is cut off."""
        if t is None or self._is_positive(t):
            yield from self.base.parts(t)

    def clipped(self, start: float, stop: float) -> Signal:
        """Return the signal itself."""
        return self


def _lower_bound(signal: Signal) -> tuple[float, float]:
    """Return a lower bound of a signal, -inf where none is known, and the sum of the sizes of its parts."""
    least = size = 0.0
    for part in signal.parts():
        match part:
            case Constant(value=low):
                lowest, most = low, abs(low)
            case PiecewiseLinear(values=values):
                lowest, most = min(values), max(map(abs, values))
            case Sine(amplitude=amplitude, offset=offset):
                lowest, most = offset - abs(amplitude), abs(offset) + abs(amplitude)
            case _:
                return -math.inf, 0.0
        least, size = least + lowest, size + most
    return least, size


def time_scale(signal: Signal, span: float) -> float:
    """Return the shortest period of a signal, infinite if it is piecewise linear.

    For a function whose period is not known, a tenth of the time span is assumed.
    """
    periods = [part.period for part in signal.parts() if part.period is not None]
    return min((span / 10 if math.isinf(period) else period for period in periods), default=math.inf)


def as_signal(value: Signal | float, what: str) -> Signal:
    """Return a number as a constant signal and a signal as it is; refuse others, with a message about `what`."""
    if isinstance(value, Signal):
        return value
    if callable(value):
        raise TypeError(f"{what} must be a number or a signal, got {value!r}; wrap a function in signal(function)")
    try:
        return Constant(finite(value, what))
    except TypeError:
        raise TypeError(f"{what} must be a number or a signal, got {value!r}") from None


def _is_quantity(value: object) -> bool:
    """Tell whether a summand is a quantity: quantities add signals themselves."""
    return isinstance(value, Load) and not isinstance(value, Signal)


def _sum(*signals: Signal) -> Signal:
    """Return the sum with all straight lines in one term."""
    terms = [term for s in signals for term in (s.terms if isinstance(s, Sum) else (s,))]
    line: Constant | PiecewiseLinear = ZERO
    curved: list[Signal] = []
    for term in terms:
        if isinstance(term, (Constant, PiecewiseLinear)):
            line = _straight_sum(line, term)
        else:
            curved.append(term)
    if not curved:
        return line
    if isinstance(line, Constant) and isinstance(wave := curved[0], Sine):
        curved[0] = replace(wave, offset=wave.offset + line.value)
    elif line != ZERO:
        curved.insert(0, line)
    return curved[0] if len(curved) == 1 else Sum(tuple(curved))


def _straight_sum(a: Constant | PiecewiseLinear, b: Constant | PiecewiseLinear) -> Constant | PiecewiseLinear:
    if isinstance(a, Constant):
        if isinstance(b, Constant):
            return Constant(a.value + b.value)
        return PiecewiseLinear(b.times, tuple(a.value + v for v in b.values))
    if isinstance(b, Constant):
        return _straight_sum(b, a)
    points: list[tuple[float, float]] = []
    for t in sorted({*a.times, *b.times}):
        left, right = a.before(t) + b.before(t), a.at(t) + b.at(t)
        points.append((t, left))
        if right != left:
            points.append((t, right))
    return PiecewiseLinear(tuple(t for t, _ in points), tuple(v for _, v in points))
