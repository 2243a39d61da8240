"""All the signals of a scene as one input vector ``q(t)``: straight lines, sines, and functions of the user's.

Between two breaks every signal is a line plus sines, or a function. Lines and sines have Taylor series.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np

from stickslip.equations.algebra.floats import Columns
from stickslip.equations.loads.lines import Lines
from stickslip.equations.loads.sines import NO_SINES, Sines
from stickslip.model.arrays import Array
from stickslip.model.crossings import INSIDE
from stickslip.model.signals import Constant, Function, Line, PiecewiseLinear, Signal, Sine, time_scale

# The entries to which sines are added, and how fast these turn in rad/s.
SineTurns = tuple[tuple[int, ...], tuple[float, ...]]

NO_SINE_TURNS: SineTurns = ((), ())

# The region of each table in which a motion is; None where tables are looked up.
TableRegions = tuple[int, ...] | None

_JUMP = 1e-9  # a signal jumps if it changes by more than this part of its largest value
_TOGETHER = 2e-15  # breaks that differ by this part of their time are the same but for roundoff
_ROUNDOFF = 1e-15  # part of the largest value of a sine that is its roundoff
_SAMPLES = 50  # of the functions of a segment, where these are compared
_MOST_ENTRIES = 10_000  # entries of segments that are kept at most


class Span(NamedTuple):
    """The time span of a run."""

    start: float
    stop: float
    is_stepped: bool = False  # whether a fixed-step method reads the loads


class Loads:
    """The input vector over a time span, segment by segment.

    There is a signal for each entry of the vector; the slopes of those named by `rates`, the accelerations of drives,
    follow as further entries, and a last one is 1. If the loads are `stepped`, a fixed-step method reads them wherever
    its steps fall, and breaks are only where a force or an acceleration jumps; `samples` are further times in s that
    break.

    Attributes
    ----------
    period : float
        Shortest period in s of the signals that oscillate, a tenth of the span where a function tells none.
    breaks : list of float
        Times at which any signal breaks, each once, in order.
    breaks_of : list of tuple of float
        Those of each signal; of a `generic` system all points of piecewise linear ones.
    has_functions : bool
        Whether any signal is a function without a known Taylor series.
    table_regions : tuple of int or None
        The region of each table of the state in which the run is; None where they are looked up.
    beside : array of float
        How far beside its region each table may be looked up: roundoff.
    """

    def __init__(
        self,
        signals: Sequence[Signal],
        rates: Sequence[int],
        start: float,
        stop: float,
        stepped: bool = False,
        samples: Sequence[float] = (),
        generic: bool = False,
    ) -> None:
        self._signals = [signal.within(start, stop) for signal in signals]
        self._rates, self._start, self._stop, self._stepped = list(rates), start, stop, stepped
        self.size = len(signals) + len(rates) + 1
        self.period = min((time_scale(s, stop - start) for s in self._signals), default=math.inf)
        changing = [(i, s) for i, s in enumerate(self._signals) if not isinstance(s, Constant)]
        lines = [(i, s) for i, s in changing if isinstance(s, PiecewiseLinear) and not stepped]
        self._lines, self._lines_at = Lines([s for _, s in lines]), np.array([i for i, _ in lines], dtype=np.intp)
        self._other = [i for i, s in changing if stepped or not isinstance(s, PiecewiseLinear)]
        if stepped and changing and math.isinf(self.period):
            self.period = (stop - start) / 10
        self.breaks_of = [(s.points if generic else s.breaks)(start, stop) for s in self._signals]
        breaks = _apart(self._jumps() if stepped else {b for own in self.breaks_of for b in own})
        self._samples = {t for t in samples if start < t < stop} - breaks
        self.breaks = sorted(breaks | self._samples)
        straight_or_sine = (Constant, Line, PiecewiseLinear, Sine)
        parts = (part for s in self._signals for part in s.parts())
        self.has_functions = stepped or any(not isinstance(part, straight_or_sine) for part in parts)
        levels = [s.value if isinstance(s, Constant) else 0.0 for s in self._signals]
        self._constant = np.array([*levels, *[0.0] * len(rates), 1.0])
        self._known: dict[int, Segment] = {}
        self.table_regions: TableRegions = None
        self.beside = np.zeros(1)

    def _jumps(self) -> set[float]:
        """Return where signals jump, or the velocities of drives kink."""
        values: list[tuple[int, Callable[[float], float]]] = [*enumerate(self._signals)]
        values += [(i, self._signals[i].slope) for i in self._rates]
        return {b for i, value in values for b in _jumps(value, sorted(self.breaks_of[i]))}

    @cached_property
    def every_break(self) -> list[float]:
        """The breaks of all signals in order; a time at which several signals break is repeated."""
        return sorted(chain.from_iterable(self.breaks_of))

    def is_only_sample(self, t: float) -> bool:
        """Tell whether nothing but a sample is taken at `t`: all signals go on as they were."""
        return t in self._samples

    def periods(self, start: float, stop: float, parts: int) -> Array:
        """Return times that cut a span into parts of equal length, at least `parts` of them in each shortest period."""
        count = math.ceil(parts * (stop - start) / self.period) if stop > start else 1
        return np.linspace(start, stop, count + 1) if count > 1 else np.array([start, stop])

    def next_break(self, t: float, stop: float) -> float:
        """Return the first break after `t`, or `stop`."""
        i = bisect_right(self.breaks, t)
        return self.breaks[i] if i < len(self.breaks) else stop

    def after(self, t: float) -> Segment:
        """Return the segment that begins at `t` or goes on there, with the present regions of tables."""
        number = bisect_right(self.breaks, t)
        found = self._known.get(number)
        if found is None:
            start = self.breaks[number - 1] if number else self._start
            found = self._segment(start, self.next_break(t, self._stop))
            if len(self._known) * self.size >= _MOST_ENTRIES:
                self._known.clear()
            self._known[number] = found
        found.table_regions, found.beside = self.table_regions, self.beside
        return found

    def _segment(self, t: float, stop: float) -> Segment:
        value, slope = self._constant.copy(), np.zeros(self.size)
        sines: list[tuple[int, float, float, float]] = []
        functions: list[tuple[int, Signal]] = []
        value[self._lines_at], slope[self._lines_at] = self._lines.at(t)
        # the acceleration of a drive is the slope of its velocity; that of the other signals is added below
        count = len(self._signals)
        place_of_rate = {i: count + k for k, i in enumerate(self._rates)}
        for i, k in place_of_rate.items():
            value[k] = slope[i]
        for i in self._other:
            signal = self._signals[i]
            rate = place_of_rate.get(i)
            if self._stepped:
                functions.append((i, signal))
                if rate is not None:
                    functions.append((rate, _slope(signal, t, stop)))
                continue
            for term in signal.parts(t):
                if isinstance(term, Sine):
                    value[i] += term.offset
                    sines.append((i, term.amplitude, term.frequency, term.phase))
                    if rate is not None:
                        turn = 2 * math.pi * term.frequency
                        sines.append((rate, turn * term.amplitude, term.frequency, term.phase + 0.5 * math.pi))
                elif isinstance(term, (Constant, Line, PiecewiseLinear)):
                    value[i] += term.at(t)
                    slope[i] += term.slope(t)
                    if rate is not None:
                        value[rate] += term.slope(t)
                else:
                    functions.append((i, term))
                    if rate is not None:
                        functions.append((rate, _slope(term, t, stop)))
        return Segment(t, stop, value, slope, sines, functions, self._stepped)


def _apart(breaks: set[float]) -> set[float]:
    """Return breaks, the last of those that differ by roundoff: one signal may cross 0 where another has a corner."""
    found = list[float]()
    for b in sorted(breaks):
        if found and b - found[-1] <= _TOGETHER * abs(b):
            found.pop()
        found.append(b)
    return set(found)


class Segment:
    """The input vector between two breaks: ``q = value + slope (t - start) + sines + functions``.

    `value` and `slope` are the straight part, `bent` the entries that are not straight, `by_functions` those of them in
    which functions have a part. `table_regions` are the regions of tables in which motions begin, and `beside` is how
    far beside these regions tables may be looked up.
    """

    def __init__(
        self,
        start: float,
        stop: float,
        value: Array,
        slope: Array,
        sines: Sequence[tuple[int, float, float, float]],
        functions: Sequence[tuple[int, Signal]],
        is_stepped: bool,
    ) -> None:
        self.start, self.stop, self.value, self.slope = start, stop, value, slope
        self.is_stepped = is_stepped
        self.table_regions: TableRegions = None
        self.beside = np.zeros(1)
        self.is_steady = not slope.any()
        self.has_sines, self.has_functions = bool(sines), bool(functions)
        self.is_straight = not sines and not functions
        self._before_stop = math.nextafter(stop, -math.inf)
        self._functions, self.sines = functions, Sines.of(sines) if sines else NO_SINES
        self.sine_turns: SineTurns = tuple(self.sines.entry.tolist()), tuple(self.sines.turn.tolist())
        by_functions, by_sines = {i for i, _ in functions}, {i for i, *_ in sines}
        self.by_functions = np.array(sorted(by_functions), dtype=np.intp)
        self.bent = np.array(sorted(by_functions | by_sines), dtype=np.intp)

    def at(self, t: float, ahead: float = 0.0) -> Array:
        """Return the inputs at ``t + ahead``; functions count with their left limit at the end of the segment.

        A sum of both times would be rounded: late in a long run that is noise, which solvers follow in tiny steps.
        """
        q = self.line(t, ahead)
        if not self.is_straight:
            if self.has_sines:
                np.add.at(q, self.sines.entry, self.sines.at(t, ahead))
            for i, function in self._functions:
                q[i] += function(min(t + ahead, self._before_stop))
        return q

    def line(self, t: float, ahead: float = 0.0) -> Array:
        """Return the straight part of the inputs at ``t + ahead``."""
        return self.value + (t - self.start + ahead) * self.slope

    @property
    def terms(self) -> int:
        """How many sines and functions there are."""
        return len(self.sine_turns[0]) + len(self._functions)

    @cached_property
    def patterns(self) -> Array:
        """Vectors, a row each, of which the inputs are sums at all times, with factors that depend on time.

        Where some inputs are the user's functions, they are samples.
        """
        if self.has_functions:
            # at uneven times: functions with a period are not met at the same phase each time
            part = np.modf(0.5 * (math.sqrt(5.0) - 1.0) * np.arange(_SAMPLES))[0]
            return self.sampled(self.start + part * (self._before_stop - self.start)).T
        sines, size = self.sines, self.value.size
        turns, own = np.unique(sines.turn, return_inverse=True)
        of_sines = np.zeros((2, turns.size, size))
        for found, part in zip(of_sines, (np.cos(sines.phase), np.sin(sines.phase)), strict=True):
            np.add.at(found, (own, sines.entry), sines.amplitude * part)
        return np.concatenate([self.value[None], self.slope[None], *of_sines])

    @cached_property
    def roughness(self) -> Array:
        """How uncertain the inputs are that are not straight: by their roundoff, slopes of functions by far more."""
        found = _ROUNDOFF * np.where(self.amplitudes > 0, self.amplitudes + np.abs(self.value), 0.0)
        for i, function in self._functions:
            found[i] += function.roundoff
        return found

    def enter_columns(self, columns: Columns, q: Array, t: float) -> None:
        """Enter the inputs, whose local time runs from `t`, as sums over columns."""
        q[:, 0] = self.line(t)
        q[:, 1] = self.slope
        if self.has_sines:
            sines = self.sines
            angles = zip(sines.angle(t).tolist(), sines.turn.tolist(), strict=True)
            for i, amplitude, angle in zip(self.sine_turns[0], sines.amplitude.tolist(), angles, strict=True):
                q[i, columns.add(math.sin, [columns.line(*angle)])] = amplitude
        for i, function in self._functions:
            q[i, columns.add(self._up_to_stop(function), [columns.time(t)])] = 1.0

    def _up_to_stop(self, function: Signal) -> Callable[[float], float]:
        """Return a function with its left limit at the end of the segment."""
        last = self._before_stop
        return lambda t: float(function(min(t, last)))

    def sampled(self, times: Array, only: slice = slice(None)) -> Array:
        """Return the inputs, or some of them, at many times, one column each."""
        first, stop, _ = only.indices(self.value.size)
        q = self.value[only, None].repeat(times.size, axis=1)
        if not self.is_steady:
            slope = self.slope[only]
            sloping = slope.nonzero()[0]
            q[sloping] += np.multiply.outer(slope[sloping], times - self.start)
        for k, i in enumerate(self.sine_turns[0]):
            if first <= i < stop:
                q[i - first] += self.sines.values(k, times)
        for i, function in self._functions:
            if first <= i < stop:
                q[i - first] += function.sampled(np.minimum(times, self._before_stop))
        return q

    def rate(self, t: float) -> Array:
        """Return the slopes of the inputs at `t`, by differences where a signal of the user has none."""
        rate = self.slope.copy()
        if self.has_sines:
            np.add.at(rate, self.sines.entry, self.sines.rate(t))
        for i, function in self._functions:
            rate[i] += function.slope(min(t, self._before_stop))
        return rate

    def just_after(self, t: float, count: int) -> Array:
        """Return numbers with the signs of the first `count` inputs, which are cut off at 0, just after `t`.

        Between two breaks such an input is 0 throughout, or only at single instants.
        """
        if self.is_stepped:
            return self.rate(t)[:count]
        later = t + INSIDE * (self.stop - t)
        if self.is_straight:
            return self.line(later)[:count]
        return np.asarray(self.sampled(np.array([later]), slice(count))[:, 0])

    def taylor(self, t: float, order: int, scale: float = 1.0, sines: bool = True) -> Array:
        """Return ``scale^k q^(k)(t) / k!`` for k = 0 to `order`, a row each; functions are left out.

        Without `sines`, these are left out, too.
        """
        found = np.zeros((order + 1, self.value.size))
        found[0] = self.line(t)
        found[1:2] = scale * self.slope
        if self.has_sines and sines:
            np.add.at(found.T, self.sines.entry, self.sines.taylor(t, order, scale).T)
        return found

    def sines_and_cosines(self, t: float) -> Array:
        """Return the sines at `t`, and after them the cosines with the same amplitudes."""
        angle, amplitude = self.sines.angle(t), self.sines.amplitude
        return np.concatenate([amplitude * np.sin(angle), amplitude * np.cos(angle)])

    def majorants(self, t: float, order: int) -> Array:
        """Return majorants of the Taylor coefficients at `t`, orders 0 to `order` (at least 1), one per row."""
        found = np.zeros((order + 1, self.value.size))
        found[0], found[1] = np.abs(self.value) + np.abs((t - self.start) * self.slope), np.abs(self.slope)
        if self.has_sines:
            size = np.abs(self.sines.amplitude)
            for k, part in enumerate(found):
                np.add.at(part, self.sines.entry, size)
                size = size * np.abs(self.sines.turn) / (k + 1)
        for i, function in self._functions:
            found[0, i] += abs(function.at(min(t, self._before_stop)))
            found[1, i] += abs(function.slope(min(t, self._before_stop)))
        return found

    @property
    def amplitudes(self) -> Array:
        """The sum of the amplitudes of the sines in each entry."""
        found = np.zeros(self.value.size)
        if self.has_sines:
            np.add.at(found, self.sines.entry, np.abs(self.sines.amplitude))
        return found

    @property
    def longest_period(self) -> float:
        """Longest period in s of the sines."""
        return float(1.0 / np.abs(self.sines.frequency).min()) if self.has_sines else 0.0


def _jumps(value: Callable[[float], float], times: Sequence[float]) -> list[float]:
    """Return those of some times at which a value jumps by more than roundoff of its largest."""
    sides = np.array([(value(math.nextafter(t, -math.inf)), value(t)) for t in times]).reshape(-1, 2)
    jumps = np.abs(sides[:, 1] - sides[:, 0]) > _JUMP * np.abs(sides).max(initial=0.0)
    return [t for t, is_jump in zip(times, jumps.tolist(), strict=True) if is_jump]


def _slope(term: Signal, start: float, stop: float) -> Signal:
    """Return the slope of a load within a segment as a load, whose slope is a difference over a part of its period."""
    period = term.period or math.inf
    shortest = period if math.isfinite(period) else None
    limits, known = (start, stop), term.slope_roundoff
    return Function(term.slope, (), shortest, limits=limits, is_slope=True, known_roundoff=known)
