"""All the signals of a scene as one input vector ``q(t)``, piecewise linear but for its curved entries."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from stickslip.signals import Constant, Signal, time_scale

__all__ = ["PER_PERIOD", "Loads"]

Array = NDArray[np.float64]

PER_PERIOD = 16
"""Times per period at which curved loads are looked at."""


class Loads:
    """The input vector and its slope from one break to the next.

    Parameters
    ----------
    signals : sequence of Signal
        One per entry of the vector.
    rates : sequence of int
        Signals whose slopes follow the values as further entries (the accelerations of drives).
    start, stop : float
        The time span in s.
    stepped : bool
        Whether a fixed-step method reads the loads wherever its steps fall: then nothing breaks, and every
        signal that changes counts as curved.

    Attributes
    ----------
    size : int
        Number of entries: the signals, the rates, and a 1.
    curved : array of int
        Entries that no straight line holds.
    period : float
        Shortest period of the curved signals in s, a tenth of the span where they tell none.
    breaks : list of float
        Times at which any signal breaks, each once, in order.
    """

    def __init__(
        self,
        signals: Sequence[Signal],
        rates: Sequence[int],
        start: float,
        stop: float,
        stepped: bool = False,
    ) -> None:
        """Collect the breaks, and load the values at the start."""
        signals = [s.within(start, stop) for s in signals]
        count = len(signals)
        self.size = count + len(rates) + 1
        self._signals, self._rates = signals, list(rates)
        bends = [s.period is not None or (stepped and not isinstance(s, Constant)) for s in signals]
        curved = [i for i in range(count) if bends[i]]
        accelerations = [place for place, i in enumerate(rates) if bends[i]]
        self.curved = np.array([*curved, *(count + place for place in accelerations)], dtype=np.intp)
        self._functions: list[Callable[[float], float]] = [signals[i] for i in curved]
        self._functions += [signals[rates[place]].slope for place in accelerations]
        self.period = min((time_scale(s, stop - start) for s in signals), default=math.inf)
        if curved and math.isinf(self.period):
            self.period = (stop - start) / 10
        self._breaking: dict[float, list[int]] = {}
        for i, s in enumerate(() if stepped else signals):
            for t in s.breaks(start, stop):
                self._breaking.setdefault(t, []).append(i)
        self.breaks = sorted(self._breaking)
        self._is_curved = np.zeros(self.size, dtype=bool)
        self._is_curved[self.curved] = True
        self._start, self._stop = start, stop
        self._value = np.zeros(self.size)
        self._slope = np.zeros(self.size)
        self._since = np.full(self.size, start)
        self._value[-1] = 1.0
        self._loaded = 0
        self._last = (math.nan, self._value, self._slope)
        self._load(range(count), start)

    def anew(self) -> Loads:
        """Return the same loads for another simulation, as they are at the start."""
        other = copy(self)
        other._value, other._slope, other._since = self._value.copy(), self._slope.copy(), self._since.copy()
        other._last = (math.nan, other._value, other._slope)
        return other

    def _load(self, entries: Sequence[int] | range, t: float) -> None:
        for i in entries:
            if not self._is_curved[i]:
                signal = self._signals[i]
                self._value[i], self._slope[i], self._since[i] = signal(t), signal.slope(t), t
        for place, i in enumerate(self._rates):
            if not self._is_curved[i]:
                self._value[len(self._signals) + place] = self._slope[i]

    def _turn_to(self, t: float) -> None:
        """Load what has broken up to `t`: one break further as a rule, everything after a look back."""
        passed = bisect_right(self.breaks, t)
        if passed == self._loaded:
            return
        if passed == self._loaded + 1:
            last = self.breaks[passed - 1]
            self._load(self._breaking[last], last)
        else:
            self._load(range(len(self._signals)), self.breaks[passed - 1] if passed else self._start)
        self._loaded = passed

    def next_break(self, t: float, stop: float) -> float:
        """Return the first break after `t`, or `stop`."""
        i = bisect_right(self.breaks, t)
        return self.breaks[i] if i < len(self.breaks) else stop

    def at(self, t: float) -> tuple[Array, Array]:
        """Return the piecewise linear entries' values and slopes at `t`, right limits, zero where curved.

        The arrays are kept for the next call at the same time, and cannot be written to.
        """
        known, value, slope = self._last
        if t != known:
            self._turn_to(t)
            value, slope = self._value + self._slope * (t - self._since), self._slope.copy()
            value.flags.writeable = slope.flags.writeable = False
            self._last = (t, value, slope)
        return value, slope

    def steady(self) -> tuple[Array, list[int]]:
        """Return a value for each entry, and the entries that do not keep it all the time."""
        varies = np.zeros(self.size, dtype=bool)
        varies[: len(self._signals)] = [not isinstance(s, Constant) for s in self._signals]
        varies[len(self._signals) : -1] = varies[self._rates]
        return self._value.copy(), np.flatnonzero(varies).tolist()

    def along(self, entry: int, starts: Array, stops: Array, place: NDArray[np.intp], taus: Array) -> Array:
        """Return one entry at many times: the left limits at the ends of the stretches to which they belong.

        Parameters
        ----------
        entry : int
        starts, stops : array (k,)
            Times in s at which stretches begin and end; no signal breaks within one.
        place : array (n,) of int
            The stretch to which each time belongs.
        taus : array (n,)
            Times in s since its start.
        """
        count = len(self._signals)
        if entry == self.size - 1:
            return np.ones_like(taus)
        if self._is_curved[entry]:
            function = self._functions[int(np.flatnonzero(self.curved == entry)[0])]
            times = np.minimum(starts[place] + taus, np.nextafter(stops, -math.inf)[place])
            return self._sample(function, times)
        signal = self._signals[entry if entry < count else self._rates[entry - count]]
        if isinstance(signal, Constant):
            return np.full_like(taus, signal.value if entry < count else 0.0)
        since = [self._start, *signal.breaks(self._start, self._stop)]
        slopes = np.array([signal.slope(t) for t in since])
        last = np.maximum(np.searchsorted(since, starts, side="right") - 1, 0)
        if entry >= count:
            return slopes[last][place]
        values = np.array([signal(t) for t in since])
        value = values[last] + slopes[last] * (starts - np.array(since)[last])
        return value[place] + taus * slopes[last][place]

    def looks(self, tau: float, fewest: int) -> Array:
        """Return times from 0 to `tau` so close that no turn of a curved load hides between them."""
        count = math.ceil(PER_PERIOD * tau / self.period) if self.curved.size else 0
        return np.linspace(0.0, tau, max(count, fewest) + 1)

    def curved_at(self, t: float | Array) -> Array:
        """Return the values of the curved entries at `t`, one column per time where that is an array."""
        if isinstance(t, np.ndarray):
            return np.array([self._sample(function, t) for function in self._functions])
        return np.array([function(t) for function in self._functions])

    @staticmethod
    def _sample(function: Callable[[float], float], times: Array) -> Array:
        if isinstance(function, Signal):
            return function.sampled(times)
        return np.array([function(float(t)) for t in times])

    def complete(self, t: float) -> Array:
        """Return the whole input vector at `t`, right limits."""
        value = self.at(t)[0]
        if self.curved.size:
            value = value.copy()
            value[self.curved] = self.curved_at(t)
        return value
