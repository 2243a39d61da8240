"""Sines among the inputs: values, rates and Taylor series of many at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stickslip.model.arrays import Array, Indices


@dataclass(frozen=True)
class Sines:
    """Terms ``amplitude sin(2 pi frequency t + phase)`` of the entries of a vector; frequencies in Hz."""

    entry: Indices
    amplitude: Array
    frequency: Array
    phase: Array

    @classmethod
    def of(cls, terms: Sequence[tuple[int, float, float, float]]) -> Sines:
        """Return sines from entry, amplitude, frequency and phase of each."""
        entry, amplitude, frequency, phase = zip(*terms, strict=True) if terms else ((), (), (), ())
        numbers = (np.array(x, dtype=float) for x in (amplitude, frequency, phase))
        return cls(np.array(entry, dtype=np.intp), *numbers)

    @cached_property
    def turn(self) -> Array:
        """How fast they turn in rad/s."""
        return 2 * math.pi * self.frequency

    def angle(self, t: float) -> Array:
        """Return their angles in rad at a time."""
        # whole turns are dropped first: late in a long run the sine is as exact as frequency times t
        return np.asarray(2 * math.pi * np.fmod(self.frequency * t, 1.0) + self.phase)

    def at(self, t: float, ahead: float = 0.0) -> Array:
        """Return their values at ``t + ahead``."""
        return np.asarray(self.amplitude * np.sin(self.angle(t) + ahead * self.turn))

    def values(self, number: int, t: Array) -> Array:
        """Return the values of one of them at some times."""
        angle = 2 * math.pi * np.fmod(self.frequency[number] * t, 1.0) + self.phase[number]
        return np.asarray(self.amplitude[number] * np.sin(angle))

    def rate(self, t: float) -> Array:
        """Return their rates at a time."""
        return np.asarray(self.turn * self.amplitude * np.cos(self.angle(t)))

    def taylor(self, t: float, order: int, scale: float) -> Array:
        """Return ``scale^k s^(k)(t) / k!`` for k = 0 to `order`, a row each."""
        orders = np.arange(order + 1.0)[:, None]
        factors = np.where(orders > 0, self.turn * scale / np.maximum(orders, 1.0), self.amplitude)
        return np.asarray(np.cumprod(factors, axis=0) * np.sin(self.angle(t) + 0.5 * math.pi * orders))

    def some(self, places: Indices) -> Sines:
        """Return some of them."""
        return Sines(self.entry[places], *self.numbers[:, places])

    def integrals(self, start: float, t: float | Array) -> Array:
        """Return their integrals from `start` to `t`: a number for each, or for one of them at many times."""
        # one product, no difference: the integrals of slow sines are large, and would cancel
        half = math.pi * np.fmod(self.frequency * (t - start), 2.0)
        return np.asarray(self.amplitude / math.pi * np.sin(half) / self.frequency * np.sin(self.angle(start) + half))

    def taylor_of_integrals(self, start: float, t: float, order: int, scale: float) -> Array:
        """Return the Taylor coefficients of `integrals` at `t`, scaled as in `taylor`."""
        found = np.empty((order + 1, self.frequency.size))
        found[0] = self.integrals(start, t)
        found[1:] = self.taylor(t, order - 1, scale) * (scale / np.arange(1.0, order + 1.0)[:, None])
        return found

    @property
    def numbers(self) -> Array:
        """Amplitudes, frequencies and phases, a row each."""
        return np.stack([self.amplitude, self.frequency, self.phase])


NO_SINES = Sines.of(())
