"""All loads of a scene as one vector: breaks, lines, sines and functions between them, Taylor coefficients, drives."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip import Signal, piecewise_linear, signal, sine, step, triangle
from stickslip.equations.loads.lines import Lines
from stickslip.equations.loads.loads import Loads
from stickslip.model.signals import PiecewiseLinear, as_signal

BRAKE = triangle(0.05, 0.10, 0.15, slope=3000) + triangle(0.4, 0.5, 0.6, slope=3000)
SIGNALS: list[Signal] = [
    as_signal(5.0, "load"),
    BRAKE,
    sine(2.0, 4.0),
    step(0.4, 1.0, -2.0),
    piecewise_linear([0.0, 0.5, 1.0], [0.0, 1.0, 0.0]),
]
TIMES = sorted({0.0, 0.02, 0.05, 0.1, 0.3, 0.4, 0.45, 0.5, 0.6, 0.99})


def values(t: float) -> list[float]:
    """Right limits of all signals, the slope of the last, and 1."""
    return [*(s(t) for s in SIGNALS), SIGNALS[4].slope(t), 1.0]


def loads() -> Loads:
    return Loads(SIGNALS, [4], 0.0, 1.0)


def one(load: Signal, start: float = 0.0, stop: float = 2.0) -> Loads:
    return Loads([load], [], start, stop)


# Breaks


def test_the_breaks_of_all_signals_each_once() -> None:
    assert loads().breaks == [0.05, 0.10, 0.15, 0.4, 0.5, 0.6]
    assert Loads(SIGNALS, [4], 0.1, 0.5).breaks == [0.15, 0.4]
    assert Loads([as_signal(1, "")], [], 0, 1).breaks == []


def test_the_next_break() -> None:
    q = loads()
    assert q.next_break(0.0, 1.0) == 0.05
    assert q.next_break(0.05, 1.0) == 0.1
    assert q.next_break(math.nextafter(0.05, 0), 1.0) == 0.05
    assert q.next_break(0.6, 1.0) == 1.0


def test_stretches_run_from_break_to_break() -> None:
    q = loads()
    ends = [0.0, *q.breaks, 1.0]
    for start, stop in pairwise(ends):
        for t in (start, 0.5 * (start + stop), math.nextafter(stop, 0)):
            segment = q.after(t)
            assert (segment.start, segment.stop) == (start, stop)


# Values


def test_the_vector_holds_signals_then_rates_then_one() -> None:
    q = loads()
    assert q.size == 7 and not q.has_functions
    segment = q.after(0.1)
    assert segment.bent.tolist() == [2] and not segment.is_straight
    assert segment.at(0.1).tolist() == pytest.approx(values(0.1), abs=1e-12)


@pytest.mark.parametrize("order", [TIMES, TIMES[::-1], [0.5, 0.02, 0.99, 0.0, 0.4, 0.05, 0.45, 0.1, 0.6, 0.3]])
def test_right_limits_whatever_was_read_before(order: list[float]) -> None:
    q = loads()
    for t in order:
        assert q.after(t).at(t).tolist() == pytest.approx(values(t), abs=1e-12), t


@settings(deadline=None)
@given(st.lists(st.floats(0.0, 1.0, exclude_max=True), max_size=20))
def test_the_vector_at_any_times_in_any_order(times: list[float]) -> None:
    q = loads()
    for t in times:
        np.testing.assert_allclose(q.after(t).at(t), values(t), rtol=1e-12, atol=1e-11)


def test_lines_carry_on_to_the_next_break() -> None:
    """At the end of a segment stands the left limit: a step and a corner there belong to the next one."""
    q = loads()
    before, after = q.after(0.39).at(0.4), q.after(0.4).at(0.4)
    assert (before[3], after[3]) == (1.0, -2.0)
    before, after = q.after(0.49).at(0.5), q.after(0.5).at(0.5)
    assert before[4] == pytest.approx(1.0, rel=1e-15) and after[4] == 1.0
    assert (before[5], after[5]) == (2.0, -2.0)
    assert q.after(0.49).rate(0.5)[[1, 4]].tolist() == [3000.0, 2.0]
    assert q.after(0.5).rate(0.5)[[1, 4]].tolist() == [-3000.0, -2.0]


@settings(deadline=None)
@given(st.lists(st.floats(0.4, 0.5), min_size=1, max_size=9))
def test_many_times_of_a_stretch_are_columns(times: list[float]) -> None:
    segment = loads().after(0.4)
    many = segment.sampled(np.array(times))
    for column, t in zip(many.T, times, strict=True):
        np.testing.assert_allclose(column, segment.at(t), rtol=1e-14, atol=1e-14)


def test_sines_are_sharp_late_in_a_long_run() -> None:
    """Whole turns are dropped before they are multiplied by 2 pi: 0.25 Hz at 1e9 + 1 s is a quarter turn."""
    segment = one(sine(3.0, 0.25), 0.0, 2e9).after(1e9 + 1)
    assert segment.at(1e9 + 1)[0] == pytest.approx(3.0, rel=1e-15)
    assert segment.sampled(np.array([1e9, 1e9 + 3]))[0].tolist() == pytest.approx([0.0, -3.0], abs=1e-14)


def test_a_drive_s_acceleration_follows_its_velocity() -> None:
    q = Loads([sine(1.0, 0.5), piecewise_linear([0, 1, 2], [0, 3, 3])], [0, 1], 0.0, 2.0)
    assert q.after(0.0).bent.tolist() == [0, 2]
    assert q.after(0.0).at(0.0).tolist() == pytest.approx([0.0, 0.0, math.pi, 3.0, 1.0])
    assert q.after(1.0).at(1.0).tolist() == pytest.approx([0.0, 3.0, -math.pi, 0.0, 1.0], abs=1e-12)
    # and the acceleration's own slope: -pi^2 sin(pi t)
    assert q.after(0.5).rate(0.5)[2] == pytest.approx(-(math.pi**2), rel=1e-14)


def test_sums_of_lines_sines_and_functions() -> None:
    load = sine(1.0, 2.0, phase=0.3, offset=0.5) + piecewise_linear([0, 2], [0, 4]) + signal(math.exp)
    segment = one(load).after(0.0)
    assert segment.has_functions and segment.has_sines
    for t in (0.0, 0.7, 1.9):
        exact = 0.5 + math.sin(4 * math.pi * t + 0.3) + 2 * t + math.exp(t)
        assert segment.at(t)[0] == pytest.approx(exact, rel=1e-14)
        rate = 4 * math.pi * math.cos(4 * math.pi * t + 0.3) + 2 + math.exp(t)
        assert segment.rate(t)[0] == pytest.approx(rate, abs=1e-6)


def test_a_normal_force_is_cut_off_at_zero() -> None:
    """``max(2 sin(2 pi t), 0)`` breaks where the sine changes its sign, and is 0 to the bit between."""
    q = one(sine(2.0, 1.0).clipped(0.0, 2.0))
    assert q.breaks == pytest.approx([0.5, 1.0, 1.5], abs=1e-12)
    assert q.after(0.25).at(0.25)[0] == pytest.approx(2.0) and q.after(0.75).at(0.75)[0] == 0
    assert not q.has_functions


# Taylor coefficients


@pytest.mark.parametrize("t", [0.0, 0.03, 0.41, 0.55])
@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_taylor_coefficients_in_closed_form(t: float, scale: float) -> None:
    """A line has two coefficients; ``sin(omega t + phi)`` has ``omega^k sin(omega t + phi + k pi / 2) / k!``."""
    order, omega = 18, 2 * math.pi * 4.0
    table = loads().after(t).taylor(t, order, scale)
    assert table.shape == (order + 1, 7)
    size = (scale * omega) ** np.arange(order + 1) / [math.factorial(k) for k in range(order + 1)]
    wave = 2.0 * size * np.sin(omega * t + 0.5 * math.pi * np.arange(order + 1))
    np.testing.assert_allclose(table[:, 2], wave, rtol=1e-13, atol=1e-13 * size.max())
    lines = [0, 1, 3, 4, 5, 6]
    np.testing.assert_allclose(table[0, lines], np.array(values(t))[lines], rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(table[1, lines], scale * loads().after(t).rate(t)[lines], rtol=1e-15)
    assert not table[2:, lines].any()


def test_series_of_lines_end() -> None:
    q = Loads([BRAKE, as_signal(5.0, "")], [], 0.0, 1.0)
    segment = q.after(0.07)
    assert segment.is_straight and not segment.is_steady
    found = segment.taylor(0.07, 4)
    assert found[0].any() and found[1].any() and not found[2:].any()
    assert q.after(0.2).is_steady and not q.after(0.2).taylor(0.2, 4)[1:].any()


@settings(deadline=None)
@given(st.floats(0.0, 1.0, exclude_max=True), st.integers(2, 12))
def test_majorants_bound_the_coefficients(t: float, order: int) -> None:
    segment = loads().after(t)
    for part, size in zip(segment.taylor(t, order), segment.majorants(t, order), strict=True):
        assert np.all(np.abs(part) <= size * (1 + 1e-12))


# Functions


def test_functions_at_many_times_are_columns() -> None:
    q = Loads([sine(1.0, 0.5), as_signal(2, ""), signal(math.sqrt)], [0], 0.0, 2.0)
    times, segment = np.array([0.25, 0.5, 1.75]), q.after(0.25)
    assert segment.bent.tolist() == [0, 2, 3]
    many = segment.sampled(times)
    assert many.shape == (5, 3)
    for column, t in zip(many.T, times, strict=True):
        np.testing.assert_allclose(column, segment.at(float(t)), rtol=1e-15, atol=1e-15)


def test_functions_are_called_within_the_span_only() -> None:
    called: list[float] = []

    def noted(function: Callable[[float], float]) -> Callable[[float], float]:
        def load(t: float) -> float:
            called.append(t)
            return function(t)

        return load

    rising, falling = noted(math.sqrt), noted(lambda t: math.sqrt(2.0 - t))
    q = Loads([signal(rising), signal(falling)], [1], 0.0, 2.0)
    segment = q.after(0.0)
    for t in (0.0, 1.0, 2.0):
        assert np.isfinite(segment.at(t)).all() and np.isfinite(segment.rate(t)).all()
    assert np.isfinite(segment.sampled(np.array([0.0, 2.0]))).all()
    assert np.isfinite(segment.majorants(0.0, 2)).all()
    assert called and min(called) >= 0.0 and max(called) <= 2.0


def test_a_function_counts_with_its_left_limit_at_the_end_of_its_stretch() -> None:
    load = signal(lambda t: 1.0 if t < 0.5 else 7.0, breaks=[0.5])
    q = one(load)
    assert q.breaks == [0.5]
    assert q.after(0.2).at(0.5)[0] == 1.0 and q.after(0.2).sampled(np.array([0.5]))[0, 0] == 1.0
    assert q.after(0.5).at(0.5)[0] == 7.0


# Time scales


def test_the_period_is_the_shortest() -> None:
    assert loads().period == 0.25
    assert Loads([BRAKE], [], 0.0, 1.0).period == math.inf
    assert Loads([signal(math.cos)], [], 0.0, 20.0).period == 2.0


def test_a_slow_sine_does_not_hide_that_a_function_is_unknown() -> None:
    assert Loads([sine(1.0, 1e-3), signal(math.cos)], [], 0.0, 20.0).period == 2.0
    assert Loads([sine(1.0, 1e-3) + signal(math.cos)], [], 0.0, 20.0).period == 2.0


def test_fixed_steps_read_every_load_and_stop_where_one_or_a_drive_s_acceleration_jumps() -> None:
    """The step jumps at 0.4, the last signal's slope at 0.5; the brake comes to 0 at 0.15 and 0.6 without a jump."""
    q = Loads(SIGNALS, [4], 0.0, 1.0, stepped=True)
    assert q.breaks == [0.4, 0.5] and q.has_functions
    assert Loads(SIGNALS, [], 0.0, 1.0, stepped=True).breaks == [0.4]
    assert math.isfinite(q.period)
    segment = q.after(0.0)
    assert (segment.start, segment.stop) == (0.0, 0.4)
    assert segment.bent.tolist() == [1, 2, 3, 4, 5]
    for t in (0.3, 0.1):
        np.testing.assert_allclose(segment.at(t), values(t), rtol=1e-12, atol=1e-12)


def test_a_scene_without_loads() -> None:
    q = Loads([], [], 0.0, 1.0)
    segment = q.after(0.5)
    assert segment.at(0.5).tolist() == [1.0]
    assert segment.is_straight and segment.is_steady and segment.bent.size == 0


def test_lines_read_together_are_those_read_one_by_one() -> None:
    """Before the first point, after the last one, at kinks and jumps, forwards and back: the same to the bit."""
    rng = np.random.default_rng(5)
    signals = [
        PiecewiseLinear((1.0,), (2.5,)),
        PiecewiseLinear((0.3, 0.3), (-1.0, 4.0)),
        PiecewiseLinear((-1.0, 0.0, 0.0, 7.0), (1.0, 2.0, -3.0, 0.1)),
        *(PiecewiseLinear(tuple(np.sort(rng.uniform(-2, 8, 9))), tuple(rng.normal(size=9))) for _ in range(20)),
    ]
    lines = Lines(signals)
    own = [t for signal in signals for t in signal.times]
    times = [-5.0, 20.0, *own, *own[::-1], *rng.uniform(-3.0, 9.0, 200)]
    for t in times:
        values, slopes = lines.at(float(t))
        assert values.tolist() == [signal.at(float(t)) for signal in signals]
        assert slopes.tolist() == [signal.slope(float(t)) for signal in signals]
    assert [one.size for one in Lines([]).at(1.0)] == [0, 0]
