"""Which signals are always in proportion: drives with such velocities never move apart between rows of these levers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stickslip.model.signals import Function, PiecewiseLinear, Signal, Sine, Sum

_DIGITS = 13  # to which ratios of numbers are compared: quotients have roundoff


def in_proportion(signals: Sequence[Signal]) -> list[tuple[int, float]]:
    """Return for each signal the first one that it is always in proportion to, and the factor; else itself, and 1."""
    seen: dict[Signal, tuple[int, float]] = {}
    found = []
    for k, signal in enumerate(signals):
        unit, size = _unit(signal)
        try:
            first, first_size = seen.setdefault(unit, (k, size))
        except TypeError:
            # a function that has no hash
            first, first_size = k, size
        found.append((first, size / first_size))
    return found


def _unit(signal: Signal) -> tuple[Signal, float]:
    """Return a signal over its size, and that size: signals in proportion have the same one."""
    match signal:
        case Sine(amplitude, frequency, phase, offset) if amplitude:
            return Sine(1.0, frequency, phase, round(offset / amplitude, _DIGITS)), amplitude
        case PiecewiseLinear(times, values) if any(values):
            size = next(v for v in values if v)
            return PiecewiseLinear(times, tuple(round(v / size, _DIGITS) for v in values)), size
        case Function(factor=factor) if factor:
            return replace(signal, factor=1.0), factor
        case Sum(terms):
            units = [_unit(term) for term in terms]
            size = units[0][1]
            return Sum(tuple(unit.scaled(round(own / size, _DIGITS)) for unit, own in units)), size
    return signal, 1.0
