"""Signals as their users write them, and from files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import Any

from stickslip.model.checks import check_entries, check_takes, finite, sequence
from stickslip.model.signals import Constant, Function, Line, PiecewiseLinear, Signal, Sine, as_signal


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
    return PiecewiseLinear(times, values).checked()


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
    slope = finite(slope, "triangle: slope")
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
    time = finite(time, "step: time")
    return PiecewiseLinear((time, time), (finite(before, "step: before"), finite(after, "step: after")))


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
        If a number is not finite, or the frequency beyond 1e100.
    """
    wave = Sine(
        finite(amplitude, "sine: amplitude"),
        finite(frequency, "sine: frequency"),
        finite(phase, "sine: phase"),
        finite(offset, "sine: offset"),
    ).checked()
    return wave if wave.amplitude and wave.frequency else Constant(wave(0.0))


def signal(function: Callable[[float], float], breaks: Iterable[float] = (), period: float | None = None) -> Signal:
    """Return any function of time as a signal.

    Parameters
    ----------
    function : callable
        ``function(t) -> float``, smooth between the breaks.
    breaks : sequence of float
        Times in s, increasing, at which the value or the slope jumps.
    period : float, optional
        Shortest time in s within which the function rises and falls, positive. Steps are kept below it.

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
        raise TypeError(f"signal: function must be callable, got {function!r}; a number is a signal by itself")
    check_takes(function, 1, "signal: function", "one argument, the time t in s")
    times = sequence(breaks, "signal: breaks")
    if any(b <= a for a, b in pairwise(times)):
        raise ValueError(f"signal: breaks must increase, got {times}; sort them and drop doubles")
    if period is not None and (period := finite(period, "signal: period")) <= 0:
        raise ValueError(f"signal: period must be positive, got {period:g}; leave it out where it is not known")
    return Function(function, times, period)


def signal_from_dict(data: Any, what: str, others: Iterable[str] = ()) -> Signal:
    """Return the signal that `Signal.to_dict` wrote; refuse other data with a message that begins with `what`.

    `others` are the types of quantities, which the message names, too.
    """
    if not isinstance(data, Mapping):
        return as_signal(data, what)
    fields = dict(data)
    kind = fields.pop("type", None)
    if kind == "sum":
        terms = fields.pop("terms", None)
        if fields or not isinstance(terms, (list, tuple)) or not terms:
            raise ValueError(f"{what}: a sum has one entry, 'terms', a list of signals; got {data!r}")
        first, *further = (signal_from_dict(term, what) for term in terms)
        return sum(further, start=first)
    makers: dict[Any, Callable[..., Signal]] = {
        "piecewise_linear": piecewise_linear,
        "triangle": triangle,
        "step": step,
        "line": Line,
        "sine": sine,
    }
    if not isinstance(kind, str) or kind not in makers:
        known = ", ".join([*makers, "sum", *others])
        if "type" not in data:
            raise ValueError(f"{what}: the type of the signal is missing; write type = and one of {known}")
        raise ValueError(f"{what}: unknown signal type {kind!r}; known are {known}")
    check_entries(makers[kind], kind, fields, what, TypeError)
    try:
        return makers[kind](**fields)
    except TypeError as error:
        raise TypeError(f"{what}: {kind}: {error}") from None
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None
