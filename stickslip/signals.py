"""Loads over time: values, slopes and break times.

A signal is frozen data. At a jump its value is the right limit. ``breaks`` are the times at which the
value or the slope jumps: the solver stops there and starts afresh.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

__all__ = [
    "Constant",
    "Function",
    "PiecewiseLinear",
    "Signal",
    "Sine",
    "Sum",
    "as_signal",
    "piecewise_linear",
    "signal",
    "signal_from_dict",
    "sine",
    "step",
    "triangle",
]

_SAMPLES_PER_PERIOD = 16
_SAMPLES_AT_LEAST = 200


class Signal:
    """A load over time; ``+`` adds signals and numbers, ``*`` scales by a number."""

    def __call__(self, t: float) -> float:
        """Return the value at `t` (the right limit where it jumps)."""
        raise NotImplementedError

    def slope(self, t: float) -> float:
        """Return the derivative at `t` (the right limit where it jumps)."""
        raise NotImplementedError

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        """Return the times in ``start < t < stop`` at which the value or the slope jumps."""
        raise NotImplementedError

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
        """Return the signal times a number."""
        raise NotImplementedError

    def __add__(self, other: Signal | float) -> Signal:
        return _add(self, as_signal(other, "a signal's summand"))

    __radd__ = __add__

    def __mul__(self, factor: float) -> Signal:
        if isinstance(factor, Signal):
            raise TypeError("signals are scaled by numbers, not by signals; use signal(function) for a product")
        return self.scaled(_finite(factor, "a signal's factor"))

    __rmul__ = __mul__

    def __neg__(self) -> Signal:
        return self.scaled(-1.0)

    def __sub__(self, other: Signal | float) -> Signal:
        return self + (-as_signal(other, "a signal's subtrahend"))


@dataclass(frozen=True)
class Constant(Signal):
    """A number at all times."""

    value: float

    def __call__(self, t: float) -> float:
        return self.value

    def slope(self, t: float) -> float:
        return 0.0

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        return ()

    def clipped(self, start: float, stop: float) -> Signal:
        return self if self.value >= 0 else Constant(0.0)

    def scaled(self, factor: float) -> Signal:
        return Constant(factor * self.value)

    def to_dict(self) -> Any:
        return self.value


@dataclass(frozen=True)
class PiecewiseLinear(Signal):
    """Straight lines between points; the end values are held and a repeated time is a jump."""

    times: tuple[float, ...]
    values: tuple[float, ...]

    def _piece(self, t: float) -> int:
        return int(np.searchsorted(self.times, t, side="right"))

    def __call__(self, t: float) -> float:
        i = self._piece(t)
        if i == 0:
            return self.values[0]
        if i == len(self.times):
            return self.values[-1]
        t0, t1, v0, v1 = self.times[i - 1], self.times[i], self.values[i - 1], self.values[i]
        return v0 + (v1 - v0) * ((t - t0) / (t1 - t0))

    def slope(self, t: float) -> float:
        i = self._piece(t)
        if i in (0, len(self.times)):
            return 0.0
        return (self.values[i] - self.values[i - 1]) / (self.times[i] - self.times[i - 1])

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        return tuple(t for t in dict.fromkeys(self.times) if start < t < stop)

    def clipped(self, start: float, stop: float) -> Signal:
        if min(self.values) >= 0:
            return self
        times, values = [self.times[0]], [self.values[0]]
        for t1, v1 in zip(self.times[1:], self.values[1:], strict=True):
            t0, v0 = times[-1], values[-1]
            if v0 * v1 < 0 and t1 > t0:
                times.append(t0 + (t1 - t0) * (v0 / (v0 - v1)))
                values.append(0.0)
            times.append(t1)
            values.append(v1)
        return PiecewiseLinear(tuple(times), tuple(max(0.0, v) for v in values))

    def scaled(self, factor: float) -> Signal:
        return PiecewiseLinear(self.times, tuple(factor * v for v in self.values))

    def to_dict(self) -> Any:
        return {"type": "piecewise_linear", "times": list(self.times), "values": list(self.values)}


@dataclass(frozen=True)
class Sine(Signal):
    """``offset + amplitude sin(2 pi frequency t + phase)``."""

    amplitude: float
    frequency: float
    phase: float = 0.0
    offset: float = 0.0

    def __call__(self, t: float) -> float:
        # reduce the turns first: at t = 1e6 s the bare argument has lost six digits
        turns = math.fmod(self.frequency * t, 1.0)
        return self.offset + self.amplitude * math.sin(2 * math.pi * turns + self.phase)

    def slope(self, t: float) -> float:
        turns = math.fmod(self.frequency * t, 1.0)
        omega = 2 * math.pi * self.frequency
        return self.amplitude * omega * math.cos(2 * math.pi * turns + self.phase)

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        return ()

    @property
    def period(self) -> float | None:
        return 1.0 / abs(self.frequency) if self.frequency else None

    def scaled(self, factor: float) -> Signal:
        return Sine(factor * self.amplitude, self.frequency, self.phase, factor * self.offset)

    def to_dict(self) -> Any:
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
        value = self.function(t)
        try:
            number = float(value)
        except (TypeError, ValueError):
            raise ValueError(
                f"signal function {_name(self.function)} returned {value!r} at t={t:g}; return one number"
            ) from None
        if not math.isfinite(number):
            raise ValueError(
                f"signal function {_name(self.function)} returned {number} at t={t:g}; return a finite number"
            )
        return self.factor * number

    def slope(self, t: float) -> float:
        # one-sided at a break, so that a jump is never differenced across
        h = 1e-5 * min(self.period or 1.0, 1.0)
        if any(t - 2 * h < b <= t for b in self.break_times):
            return (-3 * self(t) + 4 * self(t + h) - self(t + 2 * h)) / (2 * h)
        return (self(t + h) - self(t - h)) / (2 * h)

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        return tuple(t for t in self.break_times if start < t < stop)

    @property
    def period(self) -> float | None:
        return math.inf if self.shortest_period is None else self.shortest_period

    def scaled(self, factor: float) -> Signal:
        return Function(self.function, self.break_times, self.shortest_period, factor * self.factor)

    def to_dict(self) -> Any:
        raise ValueError(
            f"signal function {_name(self.function)} is code, not data; "
            "sample it into piecewise_linear(times, values) to write it to a file"
        )


@dataclass(frozen=True)
class Sum(Signal):
    """A sum of signals that no single kind can hold."""

    terms: tuple[Signal, ...]

    def __call__(self, t: float) -> float:
        return sum(term(t) for term in self.terms)

    def slope(self, t: float) -> float:
        return sum(term.slope(t) for term in self.terms)

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        return tuple(sorted({b for term in self.terms for b in term.breaks(start, stop)}))

    @property
    def period(self) -> float | None:
        return min((p for term in self.terms if (p := term.period) is not None), default=None)

    def scaled(self, factor: float) -> Signal:
        return Sum(tuple(term.scaled(factor) for term in self.terms))

    def to_dict(self) -> Any:
        return {"type": "sum", "terms": [term.to_dict() for term in self.terms]}


@dataclass(frozen=True)
class Clipped(Signal):
    """``max(0, base)``: the zero crossings of the base are breaks; `closed` says which pieces are positive."""

    base: Signal
    zeros: tuple[float, ...]
    closed: tuple[bool, ...]

    @classmethod
    def of(cls, base: Signal, start: float, stop: float) -> Signal:
        """Find the zero crossings of a curved signal by sampling, each then by root finding."""
        period = base.period or math.inf
        edges = [start, *base.breaks(start, stop), stop]
        zeros: set[float] = set()
        for left, right in zip(edges[:-1], edges[1:], strict=True):
            last = float(np.nextafter(right, left))
            samples = _SAMPLES_PER_PERIOD * (right - left) / period if math.isfinite(period) else 0.0
            times = np.linspace(left, last, max(math.ceil(samples), _SAMPLES_AT_LEAST) + 1)
            values = np.array([base(float(t)) for t in times])
            for i in np.flatnonzero(values[:-1] * values[1:] < 0):
                zeros.add(float(brentq(base, times[i], times[i + 1], xtol=1e-15 * (stop - start), rtol=1e-15)))
            zeros.update(float(t) for t in times[1:-1][values[1:-1] == 0])
        points = [start, *sorted(zeros | set(base.breaks(start, stop))), stop]
        closed = tuple(base(0.5 * (a + b)) > 0 for a, b in zip(points[:-1], points[1:], strict=True))
        return base if all(closed) else cls(base, tuple(points[1:-1]), closed)

    def _is_closed(self, t: float) -> bool:
        return self.closed[int(np.searchsorted(self.zeros, t, side="right"))]

    def __call__(self, t: float) -> float:
        return max(0.0, self.base(t)) if self._is_closed(t) else 0.0

    def slope(self, t: float) -> float:
        return self.base.slope(t) if self._is_closed(t) else 0.0

    def breaks(self, start: float, stop: float) -> tuple[float, ...]:
        return tuple(z for z in self.zeros if start < z < stop)

    @property
    def period(self) -> float | None:
        return self.base.period


def piecewise_linear(times: Iterable[float], values: Iterable[float]) -> Signal:
    """Return straight lines between the points ``(times[i], values[i])``.

    The end values are held; a time that stands twice is a jump.

    Parameters
    ----------
    times : sequence of float
        Times in s, not decreasing, none more than twice.
    values : sequence of float
        Values at these times, equally many.

    Raises
    ------
    ValueError
        If the points are not finite, not in order, or not equally many.
    """
    times_ = tuple(_finite(t, "piecewise_linear: times") for t in _sequence(times, "piecewise_linear: times"))
    values_ = tuple(_finite(v, "piecewise_linear: values") for v in _sequence(values, "piecewise_linear: values"))
    if len(times_) != len(values_) or not times_:
        raise ValueError(
            f"piecewise_linear: {len(times_)} times and {len(values_)} values; give equally many, at least one"
        )
    for a, b in zip(times_, times_[1:], strict=False):
        if b < a:
            raise ValueError(f"piecewise_linear: times must not decrease, got {b:g} after {a:g}; sort the points")
    for a, c in zip(times_, times_[2:], strict=False):
        if a == c:
            raise ValueError(f"piecewise_linear: time {a:g} stands three times; twice makes a jump")
    return PiecewiseLinear(times_, values_)


def triangle(start: float, peak: float, stop: float, *, slope: float) -> Signal:
    """Return a triangle that rises with `slope` from `start` to `peak` and falls to zero at `stop`.

    Parameters
    ----------
    start, peak, stop : float
        Times in s, ``start < peak < stop``.
    slope : float
        Rise per second before the peak.

    Raises
    ------
    ValueError
        If the times are not in order.
    """
    start, peak, stop = (_finite(t, "triangle: times") for t in (start, peak, stop))
    slope = _finite(slope, "triangle: slope")
    if not start < peak < stop:
        raise ValueError(f"triangle: need start < peak < stop, got {start:g}, {peak:g}, {stop:g}")
    return PiecewiseLinear((start, peak, stop), (0.0, slope * (peak - start), 0.0))


def step(time: float, before: float = 0.0, after: float = 1.0) -> Signal:
    """Return a jump from `before` to `after` at `time` (s).

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    time = _finite(time, "step: time")
    return PiecewiseLinear((time, time), (_finite(before, "step: before"), _finite(after, "step: after")))


def sine(amplitude: float, frequency: float, phase: float = 0.0, offset: float = 0.0) -> Signal:
    """Return ``offset + amplitude sin(2 pi frequency t + phase)``.

    Parameters
    ----------
    amplitude, offset : float
        In the unit of the signal.
    frequency : float
        In Hz.
    phase : float
        In rad.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    return Sine(
        _finite(amplitude, "sine: amplitude"),
        _finite(frequency, "sine: frequency"),
        _finite(phase, "sine: phase"),
        _finite(offset, "sine: offset"),
    )


def signal(
    function: Callable[[float], float], breaks: Iterable[float] = (), period: float | None = None
) -> Signal:
    """Return any function of time as a signal.

    Parameters
    ----------
    function : callable
        ``function(t) -> float``, smooth between the breaks.
    breaks : sequence of float
        Times in s, increasing, at which the value or the slope jumps.
    period : float, optional
        Shortest time in s within which the function rises and falls. Steps are kept below it.

    Raises
    ------
    TypeError
        If `function` is not callable.
    ValueError
        If the breaks are not in order, or the period is not positive.
    """
    if not callable(function):
        raise TypeError(f"signal: function must be callable, got {function!r}; a number is a signal by itself")
    times = tuple(_finite(b, "signal: breaks") for b in _sequence(breaks, "signal: breaks"))
    if any(b <= a for a, b in zip(times, times[1:], strict=False)):
        raise ValueError(f"signal: breaks must increase, got {times}; sort them and drop doubles")
    if period is not None and not _finite(period, "signal: period") > 0:
        raise ValueError(f"signal: period must be positive, got {period}")
    return Function(function, times, period)


def as_signal(value: Signal | float, what: str) -> Signal:
    """Return a number as a constant signal and a signal as it is.

    Raises
    ------
    TypeError
        If it is neither.
    """
    return value if isinstance(value, Signal) else Constant(_finite(value, what))


def signal_from_dict(data: Any, what: str) -> Signal:
    """Return the signal that `Signal.to_dict` wrote.

    Raises
    ------
    ValueError, TypeError
        If the data do not describe a signal.
    """
    if not isinstance(data, dict):
        return as_signal(data, what)
    fields = dict(data)
    kind = fields.pop("type", None)
    makers: dict[str, Callable[..., Signal]] = {
        "piecewise_linear": piecewise_linear,
        "triangle": triangle,
        "step": step,
        "sine": sine,
    }
    if kind == "sum":
        terms = fields.pop("terms", None)
        if fields or not isinstance(terms, list) or not terms:
            raise ValueError(f"{what}: a sum has one entry, 'terms', a list of signals; got {data!r}")
        total = signal_from_dict(terms[0], what)
        for term in terms[1:]:
            total = total + signal_from_dict(term, what)
        return total
    if kind not in makers:
        raise ValueError(f"{what}: unknown signal type {kind!r}; known are {', '.join([*makers, 'sum'])}")
    try:
        return makers[kind](**fields)
    except TypeError as error:
        raise ValueError(f"{what}: {kind}: {error}") from None


def _add(a: Signal, b: Signal) -> Signal:
    match a, b:
        case Constant(value=x), Constant(value=y):
            return Constant(x + y)
        case Constant(value=x), PiecewiseLinear():
            return PiecewiseLinear(b.times, tuple(v + x for v in b.values))
        case PiecewiseLinear(), Constant():
            return _add(b, a)
        case PiecewiseLinear(), PiecewiseLinear():
            return _add_piecewise(a, b)
        case Constant(value=x), Sine():
            return Sine(b.amplitude, b.frequency, b.phase, b.offset + x)
        case Sine(), Constant():
            return _add(b, a)
    terms_a = a.terms if isinstance(a, Sum) else (a,)
    terms_b = b.terms if isinstance(b, Sum) else (b,)
    return Sum(terms_a + terms_b)


def _add_piecewise(a: PiecewiseLinear, b: PiecewiseLinear) -> Signal:
    times: list[float] = []
    values: list[float] = []
    for t in sorted({*a.times, *b.times}):
        left, right = _left(a, t) + _left(b, t), a(t) + b(t)
        times.append(t)
        values.append(left)
        if right != left:
            times.append(t)
            values.append(right)
    return PiecewiseLinear(tuple(times), tuple(values))


def _left(s: PiecewiseLinear, t: float) -> float:
    i = int(np.searchsorted(s.times, t, side="left"))
    return s.values[i] if i < len(s.times) and s.times[i] == t else s(t)


def _sequence(values: Iterable[float], what: str) -> list[float]:
    try:
        return list(values)
    except TypeError:
        raise TypeError(f"{what} must be a sequence of numbers, got {values!r}") from None


def _finite(value: float, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise TypeError(f"{what} must be a number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{what} must be finite, got {value}")
    return number


def _name(function: Callable[..., Any]) -> str:
    return getattr(function, "__qualname__", repr(function))
