"""Signals that are multiples and sums of others."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from stickslip import Signal, piecewise_linear, signal, sine
from stickslip.equations.loads.sums import made_of_others
from stickslip.model.signals import ZERO

LINES = piecewise_linear([0.0, 1.0, 3.0], [0.0, 0.3, -0.7])
FUNCTION = signal(math.sin)


@pytest.mark.parametrize(
    "base", [sine(0.7, 2.0, 0.4), sine(0.7, 2.0, 0.4) + 0.3, LINES, FUNCTION, FUNCTION + LINES + sine(0.1, 3.0)]
)
@pytest.mark.parametrize("factor", [1.0, -1.0, 3.0, 1 / 7, -0.3])
def test_a_signal_and_its_multiple_are(base: Signal, factor: float) -> None:
    between = sine(0.7, 2.1, 0.4)
    assert made_of_others([base, between, base * factor]) == [{0: 1.0}, {1: 1.0}, {0: pytest.approx(factor, rel=1e-14)}]


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
    assert made_of_others([one, other])[1] == {0: pytest.approx(factor, rel=1e-14)}


@pytest.mark.parametrize(
    ("first", "second", "wanted", "factors"),
    [
        (sine(0.3, 1.0), sine(0.2, 2.0), sine(0.6, 1.0) - sine(0.2, 2.0), (2.0, -1.0)),
        (LINES, sine(0.2, 2.0), sine(0.1, 2.0) + LINES, (1.0, 0.5)),
        (LINES, piecewise_linear([0.5, 2.0], [0.0, 1.0]), LINES + piecewise_linear([0.5, 2.0], [0.0, 3.0]), (1.0, 3.0)),
        (FUNCTION, signal(math.cos), FUNCTION - 0.5 * signal(math.cos), (1.0, -0.5)),
        # every sine is a sum of any two others of its frequency
        (sine(1.0, 2.0), sine(1.0, 2.0, math.pi / 3), sine(1.0, 2.0, 2 * math.pi / 3), (-1.0, 1.0)),
    ],
)
def test_a_sum_is(first: Signal, second: Signal, wanted: Signal, factors: tuple[float, float]) -> None:
    found = made_of_others([first, sine(5.0, 7.0), second, wanted])[3]
    assert found == {0: pytest.approx(factors[0], rel=1e-13), 2: pytest.approx(factors[1], rel=1e-13)}


def test_a_hundred_drives_of_one_frequency_are_sums_of_two() -> None:
    found = made_of_others([sine(1.0 + k, 2.0, 0.1 * k) for k in range(100)])
    assert all(set(one) <= {0, 1} for one in found)


def test_of_many_signals_that_share_a_part_none_is_looked_for() -> None:
    found = made_of_others([sine(1.0, 1.0 + k) + LINES.scaled(1.0 + k) for k in range(2000)])
    assert found == [{k: 1.0} for k in range(2000)]


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
    assert made_of_others(pair) == [{0: 1.0}, {1: 1.0}]


def test_a_function_without_a_hash_is_by_itself() -> None:
    @dataclass
    class Ramp:
        slope: float

        def __call__(self, t: float) -> float:
            return self.slope * t

    one = signal(Ramp(2.0))
    assert made_of_others([one, one]) == [{0: 1.0}, {1: 1.0}]
