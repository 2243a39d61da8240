"""Loads over time, as their users write them.

A signal is frozen data. At a jump its value is the right limit. ``breaks`` are the times at which the
value or the slope jumps: the solver stops there and starts afresh.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from stickslip.model.checks import check_entries, check_takes_one, sequence
from stickslip.model.checks import finite as _finite
from stickslip.model.signals import (
    Clipped,
    Constant,
    Line,
    Load,
    PiecewiseLinear,
    Signal,
    Sine,
    Sum,
    as_signal,
    time_scale,
)

__all__ = [
    "Clipped",
    "Constant",
    "Function",
    "Line",
    "Load",
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
    "time_scale",
    "triangle",
]


@dataclass(frozen=True)
class Function(Signal):
    """Any function of time; its jumps and kinks have to be named as breaks."""

    function: Callable[[float], float]
    break_times: tuple[float, ...] = ()
    shortest_period: float | None = None
    factor: float = 1.0
    limits: tuple[float, float] = (-math.inf, math.inf)

    def __call__(self, t: float) -> float:
        """Return the value at `t`; a ValueError says where it is not a finite number."""
        low, high = self.limits
        if not low <= t <= high:
            return self._beyond(t, low if t < low else high)
        try:
            value = self.function(t)
        except Exception as error:
            raise ValueError(f"{self._label} raised {error!r} at t={t:g}; return a finite number") from error
        if type(value) is not float:
            value = self._number(value, t)
        if not math.isfinite(value):
            raise ValueError(f"{self._label} returned {value} at t={t:g}; return a finite number")
        return self.factor * value

    def _beyond(self, t: float, limit: float) -> float:
        """Go on as the parabola that the function is near its limit."""
        half = 0.5 * (self.limits[1] - self.limits[0])
        d = max(-half, min(t - limit, half))
        return 3 * self(limit) - 3 * self(limit - d) + self(limit - 2 * d)

    def _number(self, value: Any, t: float) -> float:
        if not isinstance(value, str) and np.ndim(value) == 0:
            try:
                return float(value)
            except (TypeError, ValueError, OverflowError):
                pass
        raise ValueError(f"{self._label} returned {value!r} at t={t:g}; return one finite number")

    def slope(self, t: float) -> float:
        """Return a difference quotient of second order that looks across no break and no limit."""
        h = 1e-5 * min(self.shortest_period or 1.0, 1.0)
        times = self.break_times
        i = bisect_right(times, t)
        behind = t - max(self.limits[0], times[i - 1] if i else -math.inf)
        ahead = min(self.limits[1], times[i] if i < len(times) else math.inf) - t
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
        return replace(self, factor=factor * self.factor)

    def within(self, start: float, stop: float) -> Signal:
        """Return the signal for one time span: the function is called within it only."""
        return replace(self, limits=(start, stop))

    def to_dict(self) -> Any:
        """Refuse: code is not data."""
        raise ValueError(
            f"{self._label} is code, not data; sample it into piecewise_linear(times, values) for a file"
        )

    @property
    def _label(self) -> str:
        return f"signal function {getattr(self.function, '__qualname__', repr(self.function))}"


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
    ValueError, TypeError
        If the points are not finite, not in order, or not equally many.
    """
    times, values = sequence(times, "piecewise_linear: times"), sequence(values, "piecewise_linear: values")
    if len(times) != len(values) or not times:
        raise ValueError(
            f"piecewise_linear: {len(times)} times and {len(values)} values; give equally many, at least one"
        )
    for (t0, v0), (t1, v1) in pairwise(zip(times, values, strict=True)):
        if t1 < t0:
            raise ValueError(
                f"piecewise_linear: times must not decrease, got {t1:g} after {t0:g}; sort the points"
            )
        if t1 > t0 and not math.isfinite((v1 - v0) / (t1 - t0)):
            raise ValueError(
                f"piecewise_linear: the line from {t0:g} s to {t1:g} s is too steep for a number; "
                "give the same time twice to make it a jump"
            )
    for t0, t2 in zip(times, times[2:], strict=False):
        if t0 == t2:
            raise ValueError(f"piecewise_linear: time {t0:g} stands three times; twice makes a jump")
    return PiecewiseLinear(times, values)


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
    ValueError, TypeError
        If a number is not finite or the times are not in order.
    """
    start, peak, stop = sequence((start, peak, stop), "triangle: times")
    slope = _finite(slope, "triangle: slope")
    if not start < peak < stop:
        raise ValueError(
            f"triangle: need start < peak < stop, got {start:g}, {peak:g}, {stop:g}; put the times in order"
        )
    return piecewise_linear((start, peak, stop), (0.0, slope * (peak - start), 0.0))


def step(time: float, before: float = 0.0, after: float = 1.0) -> Signal:
    """Return a jump at one time: `before` until then, `after` from then on.

    Parameters
    ----------
    time : float
        In s.
    before, after : float
        In the unit of the signal.

    Raises
    ------
    ValueError, TypeError
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
    ValueError, TypeError
        If a number is not finite.
    """
    wave = Sine(
        _finite(amplitude, "sine: amplitude"),
        _finite(frequency, "sine: frequency"),
        _finite(phase, "sine: phase"),
        _finite(offset, "sine: offset"),
    )
    return wave if wave.amplitude and wave.frequency else Constant(wave(0.0))


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
        If `function` is not callable, takes more or less than one argument, or is a signal already.
    ValueError
        If the breaks are not in order, or the period is not positive.
    """
    if isinstance(function, Signal):
        raise TypeError(f"signal: {function!r} is a signal already; use it as it is")
    if not callable(function):
        raise TypeError(
            f"signal: function must be callable, got {function!r}; a number is a signal by itself"
        )
    check_takes_one(function, "signal: function", "the time t in s")
    times = sequence(breaks, "signal: breaks")
    if any(b <= a for a, b in pairwise(times)):
        raise ValueError(f"signal: breaks must increase, got {times}; sort them and drop doubles")
    if period is not None and (period := _finite(period, "signal: period")) <= 0:
        raise ValueError(
            f"signal: period must be positive, got {period:g}; leave it out where it is not known"
        )
    return Function(function, times, period)


def signal_from_dict(data: Any, what: str) -> Signal:
    """Return the signal that `Signal.to_dict` wrote.

    Raises
    ------
    ValueError, TypeError
        If the data do not describe a signal; `what` begins the message.
    """
    if not isinstance(data, Mapping):
        return as_signal(data, what)
    fields = dict(data)
    kind = fields.pop("type", None)
    if kind == "sum":
        terms = fields.pop("terms", None)
        if fields or not isinstance(terms, (list, tuple)) or not terms:
            raise ValueError(f"{what}: a sum has one entry, 'terms', a list of signals; got {data!r}")
        total = signal_from_dict(terms[0], what)
        for term in terms[1:]:
            total = total + signal_from_dict(term, what)
        return total
    makers: dict[Any, Callable[..., Signal]] = {
        "piecewise_linear": piecewise_linear,
        "triangle": triangle,
        "step": step,
        "line": Line,
        "sine": sine,
    }
    if not isinstance(kind, str) or kind not in makers:
        raise ValueError(f"{what}: unknown signal type {kind!r}; known are {', '.join([*makers, 'sum'])}")
    check_entries(makers[kind], kind, fields, what)
    try:
        return makers[kind](**fields)
    except TypeError as error:
        raise TypeError(f"{what}: {kind}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None
