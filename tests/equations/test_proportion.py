"""Signals that are always in proportion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from stickslip import Signal, piecewise_linear, signal, sine
from stickslip.equations.loads.proportion import in_proportion
from stickslip.model.signals import ZERO

LINES = piecewise_linear([0.0, 1.0, 3.0], [0.0, 0.3, -0.7])
FUNCTION = signal(math.sin)


@pytest.mark.parametrize(
    "base", [sine(0.7, 2.0, 0.4), sine(0.7, 2.0, 0.4) + 0.3, LINES, FUNCTION, FUNCTION + LINES + sine(0.1, 3.0)]
)
@pytest.mark.parametrize("factor", [1.0, -1.0, 3.0, 1 / 7, -0.3])
def test_a_signal_and_its_multiple_are(base: Signal, factor: float) -> None:
    between = sine(0.7, 2.1, 0.4)
    (zeroth, first, second) = in_proportion([base, between, base * factor])
    assert (zeroth, first) == ((0, 1.0), (1, 1.0))
    assert second == (0, pytest.approx(factor, rel=1e-15))


@pytest.mark.parametrize(
    ("one", "other", "factor"),
    [
        (sine(0.3, 1.0, 0.4) + sine(0.2, 2.0), sine(0.2, 2.0) + sine(0.3, 1.0, 0.4), 1.0),
        ((sine(0.3, 1.0) + 0.7) + FUNCTION, FUNCTION + (sine(0.3, 1.0) + 0.7), 1.0),
        (sine(0.3, 1.0) + (FUNCTION + 0.7), 2 * ((sine(0.3, 1.0) + FUNCTION) + 0.7), 2.0),
        (sine(0.3, 1.0, 0.4), sine(0.3, 1.0, 0.4 + math.pi), -1.0),
        (sine(0.3, 1.0), sine(-0.3, 1.0, 2 * math.pi), -1.0),
        (sine(0.3, 1.0, -0.7) + 0.1, sine(-0.6, 1.0, -0.7 - 3 * math.pi) + 0.2, 2.0),
        (sine(0.3, 1.0), sine(0.1, 1.0) + sine(0.2, 1.0), 1.0),
    ],
)
def test_signals_are_however_they_are_written(one: Signal, other: Signal, factor: float) -> None:
    assert in_proportion([one, other])[1] == (0, pytest.approx(factor, rel=1e-14))


@pytest.mark.parametrize(
    "pair",
    [
        (sine(1.0, 2.0), sine(1.0, 2.0, 0.1)),
        (sine(1.0, 2.0) + 0.3, 2 * sine(1.0, 2.0) + 0.3),
        (LINES, piecewise_linear([0.0, 1.0, 3.0], [0.0, 0.3, -0.6])),
        (LINES, piecewise_linear([0.0, 2.0, 3.0], [0.0, 0.3, -0.7])),
        (FUNCTION, signal(math.cos)),
        (FUNCTION + LINES, FUNCTION + 2 * LINES),
        (ZERO, LINES),
    ],
)
def test_others_are_not(pair: tuple[Signal, Signal]) -> None:
    assert in_proportion(pair) == [(0, 1.0), (1, 1.0)]


def test_a_function_without_a_hash_is_by_itself() -> None:
    @dataclass
    class Ramp:
        slope: float

        def __call__(self, t: float) -> float:
            return self.slope * t

    one = signal(Ramp(2.0))
    assert in_proportion([one, one]) == [(0, 1.0), (1, 1.0)]
