"""Which signals are always in proportion: drives with such velocities never move apart between rows of these levers."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence

from stickslip.model.signals import Constant, Function, PiecewiseLinear, Signal, Sine, Sum

_DIGITS = 13  # to which phases, and ratios of numbers, are compared: they have roundoff


def in_proportion(signals: Sequence[Signal]) -> list[tuple[int, float]]:
    """Return for each signal the first one that it is always in proportion to, and the factor; else itself, and 1."""
    seen: dict[Hashable, tuple[int, float]] = {}
    found = []
    for k, signal in enumerate(signals):
        try:
            shape, size = _shape(signal)
        except TypeError:
            # a function that has no hash
            shape, size = k, 1.0
        first, first_size = seen.setdefault(shape, (k, size))
        found.append((first, size / first_size))
    return found


def _shape(signal: Signal) -> tuple[Hashable, float]:
    """Return what signals in proportion have in common, and the size of this one."""
    sums: dict[Hashable, float] = {}
    for atom, factor in _atoms(signal):
        sums[atom] = sums.get(atom, 0.0) + factor
    largest = max(map(abs, sums.values()), default=0.0)
    some = {atom: factor for atom, factor in sums.items() if round(factor / (largest or 1.0), _DIGITS)}
    if not some:
        return None, 1.0
    # the same one in every process
    size = some[min(some, key=repr)]
    return frozenset((atom, round(factor / size, _DIGITS)) for atom, factor in some.items()), size


def _atoms(signal: Signal) -> Iterator[tuple[Hashable, float]]:
    """Yield what a signal is the sum of, each with its factor."""
    match signal:
        case Sum(terms):
            for term in terms:
                yield from _atoms(term)
        case Constant(value):
            yield "one", value
        case Sine(amplitude, frequency, phase, offset):
            # half a turn changes the sign
            turns = round(phase / math.pi)
            yield ("sine", frequency, round(phase - turns * math.pi, _DIGITS)), -amplitude if turns % 2 else amplitude
            yield "one", offset
        case PiecewiseLinear(times, values) if any(values):
            size = next(v for v in values if v)
            yield ("lines", times, tuple(round(v / size, _DIGITS) for v in values)), size
        case Function(function=function, factor=factor):
            yield ("function", function, signal.break_times, signal.limits), factor
        case _:
            yield signal, 1.0
