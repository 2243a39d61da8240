"""The kinds of signals: frozen data with a value, a slope and break times."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import brentq

__all__ = ["Clipped", "Constant", "Function", "PiecewiseLinear", "Signal", "Sine", "Sum", "time_scale"]

_SAMPLES_PER_PERIOD = 16
_SAMPLES_AT_LEAST = 20


class Signal:
    """A load over time; ``+`` adds signals and numbers, ``*`` scales by a number."""

    __array_ufunc__ = None
    """NumPy's numbers leave ``+`` and ``*`` to the signal."""

    def __call__(self, t: float) -> float:
        """Return the value at `t` (the right limit where it jumps)."""
        raise NotImplementedError

    def slope(self, t: float) -> float:
        """Return the derivative at `t` (the right limit where it jumps)."""
        raise NotImplementedError

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the times in ``start < t < stop`` at which the value or the slope jumps."""
        return ()

    @property
    def period(self) -> float | None:
        """Shortest time in which the signal oscillates: None where it is piecewise linear, inf if unknown."""
        return None

    def clipped(self, start: float, stop: float) -> Signal:
        """Return ``max(0, signal)``, with its kinks within the time span among the breaks."""
        return Clipped.of(self, start, stop)

    def to_dict(self) -> Any:
        """Return the signal as plain data."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Signal:
        """Return the signal times a number that is not 0."""
        raise NotImplementedError

    def __add__(self, other: Signal | float) -> Signal:
        """Return the sum with a signal or a number."""
        return _sum(self, _signal(other, "a signal's summand"))

    __radd__ = __add__

    def __neg__(self) -> Signal:
        """Return the signal with its sign changed."""
        return self * -1.0

    def __sub__(self, other: Signal | float) -> Signal:
        """Return the difference from a signal or a number."""
        return self + -_signal(other, "a signal's subtrahend")

    def __rsub__(self, other: float) -> Signal:
        """Return a number minus the signal."""
        return -self + other

    def __mul__(self, factor: float) -> Signal:
        """Return the signal times a number."""
        if isinstance(factor, Signal):
            raise TypeError("signals are scaled by numbers, not by signals; use signal(function) for a product")
        number = finite(factor, "a signal's factor")
        return self.scaled(number) if number else Constant(0.0)

    __rmul__ = __mul__


@dataclass(frozen=True)
class Constant(Signal):
    """A number at all times."""

    value: float

    def __call__(self, t: float) -> float:
        """Return the number."""
        return self.value

    def slope(self, t: float) -> float:
        """Return 0."""
        return 0.0

    def clipped(self, start: float, stop: float) -> Signal:
        """Return the number, or 0 where it is negative."""
        return self if self.value >= 0 else Constant(0.0)

    def scaled(self, factor: float) -> Signal:
        """Return the number times another."""
        return Constant(factor * self.value)

    def to_dict(self) -> float:
        """Return the number."""
        return self.value


@dataclass(frozen=True)
class PiecewiseLinear(Signal):
    """Straight lines between points; the end values are held and a repeated time is a jump."""

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __call__(self, t: float) -> float:
        """Return the value at `t`, after the jump where it jumps."""
        times, values = self.times, self.values
        i = bisect_right(times, t)
        if i == 0:
            return values[0]
        if i == len(times):
            return values[-1]
        t0, v0 = times[i - 1], values[i - 1]
        return v0 + (values[i] - v0) * ((t - t0) / (times[i] - t0))

    def before(self, t: float) -> float:
        """Return the left limit at `t`."""
        i = bisect_left(self.times, t)
        return self.values[i] if i < len(self.times) and self.times[i] == t else self(t)

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

    def clipped(self, start: float, stop: float) -> Signal:
        """Return the signal with its negative parts cut off where their lines cross 0."""
        if min(self.values) >= 0:
            return self
        if max(self.values) <= 0:
            return Constant(0.0)
        points = [(self.times[0], self.values[0])]
        for (t0, v0), (t1, v1) in pairwise(zip(self.times, self.values, strict=True)):
            if t1 > t0 and min(v0, v1) < 0 < max(v0, v1):
                points.append((t0 + (t1 - t0) * (v0 / (v0 - v1)), 0.0))
            points.append((t1, v1))
        return PiecewiseLinear(tuple(t for t, _ in points), tuple(max(0.0, v) for _, v in points))

    def scaled(self, factor: float) -> Signal:
        """Return the lines through the scaled values."""
        return PiecewiseLinear(self.times, tuple(factor * v for v in self.values))

    def to_dict(self) -> dict[str, Any]:
        """Return the points."""
        return {"type": "piecewise_linear", "times": list(self.times), "values": list(self.values)}


@dataclass(frozen=True)
class Sine(Signal):
    """``offset + amplitude sin(2 pi frequency t + phase)``."""

    amplitude: float
    frequency: float
    phase: float = 0.0
    offset: float = 0.0

    def __call__(self, t: float) -> float:
        """Return the value at `t`."""
        # whole turns are dropped first: late in a long run the sine is as exact as frequency times t
        angle = 2 * math.pi * math.fmod(self.frequency * t, 1.0) + self.phase
        return self.offset + self.amplitude * math.sin(angle)

    def slope(self, t: float) -> float:
        """Return the derivative at `t`."""
        angle = 2 * math.pi * math.fmod(self.frequency * t, 1.0) + self.phase
        return self.amplitude * 2 * math.pi * self.frequency * math.cos(angle)

    @property
    def period(self) -> float | None:
        """The time of one turn."""
        return 1.0 / abs(self.frequency) if self.frequency else None

    def scaled(self, factor: float) -> Signal:
        """Return the sine with its amplitude and offset scaled."""
        return Sine(factor * self.amplitude, self.frequency, self.phase, factor * self.offset)

    def to_dict(self) -> dict[str, Any]:
        """Return the parameters."""
        return {
            "type": "sine",
            "amplitude": self.amplitude,
            "frequency": self.frequency,
            "phase": self.phase,
            "offset": self.offset,
        }


@dataclass(frozen=True)
class Function(Signal):
    """Any function of time; its jumps and kinks have to be named as breaks."""

    function: Callable[[float], float]
    break_times: tuple[float, ...] = ()
    shortest_period: float | None = None
    factor: float = 1.0

    def __call__(self, t: float) -> float:
        """Return the value at `t`; a ValueError says where it is not a finite number."""
        value = self.function(t)
        if type(value) is not float:
            value = self._number(value, t)
        if not math.isfinite(value):
            raise ValueError(f"{self._label} returned {value} at t={t:g}; return a finite number")
        return self.factor * value

    def _number(self, value: Any, t: float) -> float:
        if not isinstance(value, str) and np.ndim(value) == 0:
            try:
                return float(value)
            except (TypeError, ValueError, OverflowError):
                pass
        raise ValueError(f"{self._label} returned {value!r} at t={t:g}; return one finite number")

    def slope(self, t: float) -> float:
        """Return a difference quotient of second order that looks across no break."""
        h = 1e-5 * min(self.shortest_period or 1.0, 1.0)
        times = self.break_times
        i = bisect_right(times, t)
        behind = t - times[i - 1] if i else math.inf
        ahead = times[i] - t if i < len(times) else math.inf
        if min(behind, ahead) > h:
            left, right = t - h, t + h
            return (self(right) - self(left)) / (right - left)
        h = math.copysign(min(h, 0.4 * max(ahead, behind)), ahead - behind)
        h = (t + h) - t
        return (4 * self(t + h) - 3 * self(t) - self(t + 2 * h)) / (2 * h) if h else 0.0

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the breaks that were named."""
        return self.break_times[bisect_right(self.break_times, start) : bisect_left(self.break_times, stop)]

    @property
    def period(self) -> float | None:
        """The period that was named."""
        return math.inf if self.shortest_period is None else self.shortest_period

    def scaled(self, factor: float) -> Signal:
        """Return the function times a number."""
        return Function(self.function, self.break_times, self.shortest_period, factor * self.factor)

    def to_dict(self) -> Any:
        """Refuse: code is not data."""
        raise ValueError(
            f"{self._label} is code, not data; "
            "sample it into piecewise_linear(times, values) to write it to a file"
        )

    @property
    def _label(self) -> str:
        return f"signal function {getattr(self.function, '__qualname__', repr(self.function))}"


@dataclass(frozen=True)
class Sum(Signal):
    """A sum of signals that no single kind can hold."""

    terms: tuple[Signal, ...]

    def __call__(self, t: float) -> float:
        """Return the sum of the values."""
        return sum(term(t) for term in self.terms)

    def slope(self, t: float) -> float:
        """Return the sum of the slopes."""
        return sum(term.slope(t) for term in self.terms)

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the breaks of all terms."""
        return tuple(sorted({b for term in self.terms for b in term.breaks(start, stop)}))

    @property
    def period(self) -> float | None:
        """The shortest period of the terms."""
        return min((p for term in self.terms if (p := term.period) is not None), default=None)

    def scaled(self, factor: float) -> Signal:
        """Return the sum of the scaled terms."""
        return Sum(tuple(term.scaled(factor) for term in self.terms))

    def to_dict(self) -> dict[str, Any]:
        """Return the terms."""
        return {"type": "sum", "terms": [term.to_dict() for term in self.terms]}


@dataclass(frozen=True)
class Clipped(Signal):
    """``max(0, base)`` within one time span; `positive` tells between which kinks the base is."""

    base: Signal
    kinks: tuple[float, ...]
    positive: tuple[bool, ...]

    @classmethod
    def of(cls, base: Signal, start: float, stop: float) -> Signal:
        """Find the zero crossings of a curved signal, each by root finding."""
        breaks = base.breaks(start, stop)
        zeros: list[float] = []
        for left, right in pairwise((start, *breaks, stop)):
            period = time_scale(base, stop - start)
            zeros += _crossings(base, left, right, math.ceil(_SAMPLES_PER_PERIOD * (right - left) / period))
        points = (start, *sorted({*zeros, *breaks}), stop)
        pieces = [base(0.5 * (a + b)) > 0 for a, b in pairwise(points)]
        known, kinks, positive = set(breaks), [], pieces[:1]
        for t, (before, after) in zip(points[1:], pairwise(pieces), strict=False):
            if before != after or (before and t in known):
                kinks.append(t)
                positive.append(after)
        if not any(positive):
            return Constant(0.0)
        return base if all(positive) else cls(base, tuple(kinks), tuple(positive))

    def __call__(self, t: float) -> float:
        """Return the value at `t`, never negative."""
        return max(0.0, self.base(t)) if self.positive[bisect_right(self.kinks, t)] else 0.0

    def slope(self, t: float) -> float:
        """Return the slope of the base, 0 where that is cut off."""
        return self.base.slope(t) if self.positive[bisect_right(self.kinks, t)] else 0.0

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the zero crossings, and the breaks of the base where it is positive."""
        return self.kinks[bisect_right(self.kinks, start) : bisect_left(self.kinks, stop)]

    @property
    def period(self) -> float | None:
        """The period of the base."""
        return self.base.period

    def clipped(self, start: float, stop: float) -> Signal:
        """Return the signal itself."""
        return self

    def scaled(self, factor: float) -> Signal:
        """Return the clipped signal times a positive number."""
        if factor < 0:
            raise ValueError(f"a clipped signal is scaled by positive numbers, got {factor:g}; scale its base")
        return Clipped(self.base.scaled(factor), self.kinks, self.positive)

    def to_dict(self) -> Any:
        """Refuse: where a signal is clipped depends on the time span."""
        raise ValueError("a clipped signal belongs to one simulation; write the signal it was made from")


def time_scale(signal: Signal, span: float) -> float:
    """Return the shortest period of a signal, infinite if it is piecewise linear.

    Of a function that does not tell its period, a tenth of the time span is all that anybody can hope to see.
    """
    if isinstance(signal, Sum):
        return min(time_scale(term, span) for term in signal.terms)
    if isinstance(signal, Clipped):
        return time_scale(signal.base, span)
    if signal.period is None:
        return math.inf
    return min(signal.period, span / 10) if math.isinf(signal.period) else signal.period


def finite(value: float, what: str) -> float:
    """Return a finite number as a float."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{what} must be a number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{what} must be finite, got {number}")
    return number


def _signal(value: Signal | float, what: str) -> Signal:
    """Return a number as a constant signal and a signal as it is."""
    if isinstance(value, Signal):
        return value
    if callable(value):
        raise TypeError(f"{what} must be a number or a signal, got {value!r}; wrap a function in signal(function)")
    return Constant(finite(value, what))


def _sum(*signals: Signal) -> Signal:
    """Return the sum with all straight lines in one term."""
    terms = [term for s in signals for term in (s.terms if isinstance(s, Sum) else (s,))]
    line: Constant | PiecewiseLinear = Constant(0.0)
    curved: list[Signal] = []
    for term in terms:
        if isinstance(term, (Constant, PiecewiseLinear)):
            line = _straight_sum(line, term)
        else:
            curved.append(term)
    if not curved:
        return line
    if line != Constant(0.0):
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
        left, right = a.before(t) + b.before(t), a(t) + b(t)
        points.append((t, left))
        if right != left:
            points.append((t, right))
    return PiecewiseLinear(tuple(t for t, _ in points), tuple(v for _, v in points))


def _crossings(base: Signal, left: float, right: float, samples: int) -> Iterator[float]:
    """Find where a signal that is smooth between `left` and `right` crosses 0.

    Samples tell where its sign changes. Where it turns around between two samples of one sign, its extremum is
    looked at too, so that short dips are not missed.
    """
    times = np.linspace(left, np.nextafter(right, left), max(samples, _SAMPLES_AT_LEAST) + 1).tolist()
    values = [base(t) for t in times]
    roundoff = 1e-12 * max(map(abs, values))
    near = 1e-15 * max(abs(left), abs(right))
    for i in range(len(times) - 1):
        t0, t1, v0, v1 = times[i], times[i + 1], values[i], values[i + 1]
        inner = [(t0, v0), (t1, v1)]
        if v0 * v1 > 0 and v0 * base.slope(t0) < 0 < v1 * base.slope(t1):
            turn = _root(base.slope, t0, t1)
            value = base(turn)
            if value * v0 < 0 and abs(value) > roundoff:
                inner.insert(1, (turn, value))
        elif v0 == 0 and t0 > left:
            yield t0
        for (a, va), (b, vb) in pairwise(inner):
            if min(va, vb) < 0 < max(va, vb):
                zero = _root(base, a, b)
                if left + near < zero < right - near:
                    yield zero


def _root(function: Callable[[float], float], a: float, b: float) -> float:
    return float(brentq(function, a, b, xtol=1e-16 * (b - a), rtol=1e-15))
