"""Loads over time: values, slopes, breaks, arithmetic, clipping, plain data."""

import math
import pickle
from bisect import bisect_left, bisect_right
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stickslip import Signal, piecewise_linear, signal, sine, step, triangle
from stickslip.model.signal_makers import signal_from_dict
from stickslip.model.signals import Constant, Function, PiecewiseLinear, Sine, Sum, as_signal, time_scale

BRAKE = triangle(0.05, 0.10, 0.15, slope=3000) + triangle(0.4, 0.5, 0.6, slope=3000)


def before(t: float) -> float:
    return math.nextafter(t, -math.inf)


def jumping(t: float) -> float:
    return t * t if t < 1 else 5.0 - t


# values, slopes, breaks


@pytest.mark.parametrize(
    ("t", "value", "slope"),
    [
        (-1.0, 0.0, 0.0),
        (0.05, 0.0, 3000.0),
        (0.075, 75.0, 3000.0),
        (0.1, 150.0, -3000.0),
        (0.15, 0.0, 0.0),
        (0.3, 0.0, 0.0),
        (0.45, 150.0, 3000.0),
        (0.5, 300.0, -3000.0),
        (0.6, 0.0, 0.0),
        (9.0, 0.0, 0.0),
    ],
)
def test_the_benchmark_s_brake(t: float, value: float, slope: float) -> None:
    assert BRAKE(t) == pytest.approx(value, abs=1e-12)
    assert BRAKE.slope(t) == pytest.approx(slope, abs=1e-8)


def test_the_brake_breaks_at_its_corners_within_the_span() -> None:
    assert BRAKE.breaks(0.0, 4.0) == (0.05, 0.10, 0.15, 0.4, 0.5, 0.6)
    assert BRAKE.breaks(0.1, 0.5) == (0.15, 0.4)
    assert BRAKE.period is None


def test_end_values_are_held() -> None:
    s = piecewise_linear([1, 2], [3, 5])
    assert [s(t) for t in (-1e9, 1.0, 1.5, 2.0, 1e9)] == [3, 3, 4, 5, 5]
    assert [s.slope(t) for t in (0.9, 1.0, 1.9, 2.0)] == [0, 2, 2, 0]


def test_a_repeated_time_is_a_jump_with_its_right_limit() -> None:
    s = piecewise_linear([0, 1, 1, 2], [0, 1, 5, 7])
    assert isinstance(s, PiecewiseLinear)
    assert (s(before(1.0)), s(1.0)) == (pytest.approx(1.0), 5.0)
    assert s.before(1.0) == 1.0
    assert (s.slope(before(1.0)), s.slope(1.0)) == (1.0, 2.0)
    assert s.breaks(-1, 3) == (0.0, 1.0, 2.0)


def test_a_step_has_one_break() -> None:
    s = step(0.3, before=-1.0, after=2.0)
    assert (s(before(0.3)), s(0.3), s.slope(0.3)) == (-1.0, 2.0, 0.0)
    assert s.breaks(0, 1) == (0.3,)
    assert s.breaks(0.3, 1) == ()
    assert step(0.3, 2.0, 2.0).breaks(0, 1) == ()


def test_points_on_a_line_do_not_break() -> None:
    assert piecewise_linear([0, 1, 2, 3], [0, 2, 4, 0]).breaks(-1, 4) == (0.0, 2.0, 3.0)
    assert piecewise_linear([0, 1, 2], [7, 7, 7]).breaks(-1, 4) == ()


def test_a_constant_has_neither_slope_nor_breaks() -> None:
    c = as_signal(4, "load")
    assert c == Constant(4.0)
    assert (c(0.0), c.slope(0.0), c.breaks(0, 9), c.period) == (4.0, 0.0, (), None)


def test_a_sine_in_hertz() -> None:
    s = sine(2.0, 0.25, phase=math.pi / 6, offset=1.0)
    assert s(0.0) == pytest.approx(2.0)
    assert s(4.0) == pytest.approx(2.0)
    assert s.slope(0.0) == pytest.approx(2.0 * 2 * math.pi * 0.25 * math.cos(math.pi / 6))
    assert s.breaks(0, 100) == ()
    assert s.period == 4.0


def test_a_sine_repeats_exactly_however_late() -> None:
    s = sine(1.0, 1.0)
    assert s(1e9 + 0.125) == s(0.125)
    assert s.slope(1e9 + 0.125) == s.slope(0.125)


def test_a_sine_that_does_not_move_is_a_constant() -> None:
    assert sine(3.0, 0.0, phase=math.pi / 2, offset=1.0) == Constant(4.0)
    assert sine(0.0, 5.0, offset=1.0) == Constant(1.0)
    assert Sine(3.0, 0.0).period is None


@pytest.mark.parametrize("s", [sine(2.0, 3.0, 0.4, 1.0), sine(1.0, 1.0) + step(0.5), sine(1, 1) + sine(2, 7, 1.0)])
def test_slopes_of_curved_signals_are_derivatives(s: Signal) -> None:
    for t in (0.1, 0.37, 0.77):
        assert s.slope(t) == pytest.approx((s(t + 1e-6) - s(t - 1e-6)) / 2e-6, rel=1e-6)


def test_many_values_at_once_are_the_single_ones() -> None:
    times = np.linspace(-0.5, 2.5, 301)
    f = signal(jumping, breaks=[1.0])
    for s in (
        BRAKE,
        sine(1, 2, 0.3, -0.2),
        f + sine(1, 1),
        (sine(1, 2) + BRAKE).clipped(0.0, 2.0),
        Constant(2.0),
    ):
        np.testing.assert_allclose(s.sampled(times), [s(t) for t in times], rtol=0, atol=1e-15)


# functions


def test_a_function_has_its_named_breaks_and_period() -> None:
    f = signal(jumping, breaks=[1.0, 4.0], period=0.5)
    assert (f(0.5), f(1.0)) == (0.25, 4.0)
    assert f.breaks(0, 4) == (1.0,)
    assert f.period == 0.5
    assert signal(jumping).period == math.inf


def test_a_function_is_never_differenced_across_a_break() -> None:
    f = signal(jumping, breaks=[1.0])
    assert f.slope(0.5) == pytest.approx(1.0, rel=1e-9)
    assert f.slope(1.0) == pytest.approx(-1.0, rel=1e-9)
    for t in (before(1.0), 1 - 1e-9, 1 - 7e-6):
        assert f.slope(t) == pytest.approx(2.0, rel=1e-4)
    assert f.slope(1 + 1e-9) == pytest.approx(-1.0, rel=1e-4)


def test_a_function_between_breaks_that_almost_touch_has_a_slope() -> None:
    f = signal(lambda t: 3.0 * t, breaks=[1.0, 1.0 + 1e-7])
    assert f.slope(1.0 + 5e-8) == pytest.approx(3.0, rel=1e-5)
    tight = signal(lambda t: 3.0 * t, breaks=[1.0, math.nextafter(1.0, 2.0)])
    assert math.isfinite(tight.slope(1.0))


def test_a_function_late_in_a_run_has_a_slope() -> None:
    assert signal(lambda t: 2.0 * (t - 1e6)).slope(1e6 + 0.3) == pytest.approx(2.0, rel=1e-9)


@pytest.mark.parametrize("span", [(0.0, 6.0), (0.0, 1e-2), (3.14, 3.15)])
def test_a_function_whose_terms_cancel_has_a_slope(span: tuple[float, float]) -> None:
    """``1 - cos 2 t`` is as rough next to 0 as elsewhere: its roundoff is that of the cosine, 1e-16, over 1e-6 s."""
    f = signal(lambda t: 1 - math.cos(2 * t)).within(*span)
    assert 1e-16 <= f.roundoff <= 1e-14
    for t in np.concatenate([span[0] + np.geomspace(1e-12, 1e-3, 10), [span[0], math.pi, span[1]]]):
        if span[0] <= t <= span[1]:
            assert f.slope(t) == pytest.approx(2 * math.sin(2 * t), abs=2e-9)


def test_a_constant_function_has_no_roundoff() -> None:
    assert signal(lambda t: 2.0).within(0.0, 1.0).roundoff == 0.0
    assert signal(math.sin).roundoff == Constant(1.0).roundoff == 0.0


@pytest.mark.parametrize("value", [np.float64(2.5), np.array(2.5), np.float32(2.5), 2.5])
def test_a_function_may_return_any_single_number(value: Any) -> None:
    assert signal(lambda t: value)(0.0) == 2.5


def test_a_function_may_return_integers_and_truth_values() -> None:
    assert signal(lambda t: t > 1, breaks=[1.0])(2.0) == 1.0
    assert signal(lambda t: 3)(0.0) == 3.0


def inside(t: float) -> float:
    assert 0.0 <= t <= 2.0, "called outside its time span"
    return 3.0 * t * t + 2.0 * t


def test_within_a_time_span_a_function_is_called_there_only() -> None:
    f = signal(inside).within(0.0, 2.0)
    exact = {t: 3.0 * t * t + 2.0 * t for t in (-0.01, 0.0, 1.0, 2.0, 2.01)}
    assert {t: f(t) for t in exact} == pytest.approx(exact, rel=1e-13)
    for t in (-1e-9, 0.0, 1e-7, 1.0, 2.0 - 1e-7, 2.0, 2.0 + 1e-9):
        assert f.slope(t) == pytest.approx(6.0 * t + 2.0, rel=1e-8)
    assert math.isfinite(f(1e9))
    np.testing.assert_allclose(f.sampled(np.array([-0.01, 2.01])), [exact[-0.01], exact[2.01]])
    assert (2 * f)(-0.01) == pytest.approx(2 * exact[-0.01])


def test_sums_and_clipped_signals_keep_within_the_time_span_too() -> None:
    total = (signal(inside) + sine(1.0, 1.0) - 1.0).within(0.0, 2.0)
    # beyond the span the polynomial goes on
    for t in (-1e-5, 2.0 + 1e-5):
        assert total(t) == pytest.approx(3.0 * t * t + 2.0 * t + math.sin(2 * math.pi * t) - 1.0, rel=1e-12)
    for t in (0.0, 2.0):
        assert total.slope(t) == pytest.approx(6.0 * t + 2.0 + 2 * math.pi, rel=1e-8)
    cut = (signal(inside) - 1.0).clipped(0.0, 2.0)
    assert cut.breaks(0.0, 2.0) == pytest.approx((1 / 3,), rel=1e-15)
    assert cut(2.0 + 1e-5) == pytest.approx(3.0 * (2.0 + 1e-5) ** 2 + 2.0 * (2.0 + 1e-5) - 1.0, rel=1e-12)
    assert cut.slope(2.0) == pytest.approx(14.0, rel=1e-8) and cut.slope(0.0) == 0.0
    above = (signal(inside) + 1.0).clipped(0.0, 2.0)
    assert above.slope(0.0) == pytest.approx(2.0)
    assert (BRAKE.within(0.0, 2.0), sine(1, 1).within(0.0, 2.0)) == (BRAKE, sine(1, 1))


def test_a_sine_that_stays_above_0_is_not_looked_through() -> None:
    above = sine(0.1, 1e9, offset=1.0) + piecewise_linear([0.0, 1.0], [0.5, -0.8])
    assert above.clipped(0.0, 1.0) == above
    with pytest.raises(ValueError, match=r"1e\+09 periods of 1e-09 s.* simulate 1e\+06"):
        (above - 0.2).clipped(0.0, 1.0)
    with pytest.raises(ValueError, match="sine: frequency must be at most"):
        sine(1.0, 1e308)


# arithmetic


def test_numbers_and_signals_add_and_scale() -> None:
    s = triangle(0, 1, 2, slope=2)
    assert (s + 1)(1.0) == (1 + s)(1.0) == 3.0
    assert (s - 1)(1.0) == 1.0
    assert (1 - s)(1.0) == -1.0
    assert (-s)(1.0) == -2.0
    assert (2 * s)(0.5) == (s * 2)(0.5) == 2.0
    assert sum([s, s, 1.0])(1.0) == 5.0


def test_numpy_s_numbers_leave_arithmetic_to_the_signal() -> None:
    s = triangle(0, 1, 2, slope=2)
    assert np.float64(2.0) * s == s * 2.0
    assert np.float64(2.0) + s == s + 2.0
    with pytest.raises(TypeError, match="factor must be a number"):
        np.ones(3) * s


def test_a_signal_times_zero_is_nothing() -> None:
    for s in (sine(1, 1), signal(jumping), BRAKE, sine(1, 1) + BRAKE):
        assert s * 0 == Constant(0.0)


def test_straight_lines_add_up_to_straight_lines() -> None:
    assert isinstance(BRAKE + step(1.0) + 3, PiecewiseLinear)
    assert as_signal(1, "") + 2 == Constant(3.0)
    assert sine(1, 1) + 2 == sine(1, 1, offset=2.0)
    total = BRAKE + sine(1, 1) + step(1.0) + signal(jumping, breaks=[1.0]) + 2 + BRAKE
    assert isinstance(total, Sum)
    kinds = [type(term) for term in total.terms]
    assert kinds == [PiecewiseLinear, Sine, Function]


def test_a_sum_breaks_where_its_terms_do() -> None:
    s = sine(1, 2) + step(0.5) + signal(jumping, breaks=[0.5, 1.0])
    assert s.breaks(0, 4) == (0.5, 1.0)
    assert s(0.5) - s(before(0.5)) == pytest.approx(1.0)
    assert (s * -2)(0.7) == pytest.approx(-2 * s(0.7))
    assert (s * -2).breaks(0, 4) == (0.5, 1.0)


def test_the_period_of_a_sum_is_its_shortest() -> None:
    assert (sine(1, 2) + sine(1, 5) + BRAKE).period == pytest.approx(0.2)
    assert (BRAKE + step(1.0)).period is None


def test_the_time_scale_heeds_functions_that_tell_no_period() -> None:
    assert time_scale(sine(1, 1e-3) + signal(jumping), 10.0) == 1.0
    assert time_scale(sine(1, 4) + signal(jumping), 10.0) == 0.25
    assert time_scale((sine(1, 1e-3) + signal(jumping, period=3.0)).clipped(0, 10), 10.0) == 3.0
    assert time_scale(BRAKE, 10.0) == math.inf


numbers = st.floats(-100, 100).map(lambda x: round(x, 3))
times_ = st.lists(st.integers(-20, 20).map(float), min_size=1, max_size=8).map(sorted)


@st.composite
def lines(draw: st.DrawFn) -> PiecewiseLinear:
    times = draw(times_)
    times = [t for i, t in enumerate(times) if i < 2 or times[i - 2] != t]
    values = draw(st.lists(numbers, min_size=len(times), max_size=len(times)))
    s = piecewise_linear(times, values)
    assert isinstance(s, PiecewiseLinear)
    return s


@settings(deadline=None)
@given(lines(), lines(), st.floats(-25, 25))
def test_the_sum_of_lines_is_their_sum_at_every_time(a: PiecewiseLinear, b: PiecewiseLinear, t: float) -> None:
    total = a + b
    assert isinstance(total, PiecewiseLinear)
    for at in (t, *a.times, *b.times):
        assert total(at) == pytest.approx(a(at) + b(at), abs=1e-11)
        assert total.before(at) == pytest.approx(a.before(at) + b.before(at), abs=1e-11)
        assert total.slope(at) == pytest.approx(a.slope(at) + b.slope(at), abs=1e-9)
    assert set(total.breaks(-99, 99)) <= {*a.times, *b.times}


def from_point_to_point(s: PiecewiseLinear, i: int, t: float) -> tuple[float, float]:
    """Value at t and slope of the line from point i on; before the first point and after the last one it is level."""
    if not 0 <= i < len(s.times) - 1:
        return s.values[min(max(i, 0), len(s.times) - 1)], 0.0
    slope = (s.values[i + 1] - s.values[i]) / (s.times[i + 1] - s.times[i])
    return s.values[i] + slope * (t - s.times[i]), slope


@settings(deadline=None)
@given(lines(), st.floats(-25, 25))
def test_lines_agree_with_interpolation_between_jumps(s: PiecewiseLinear, t: float) -> None:
    """At a jump value and slope are those of the line that begins there, `before` is the value of the one that ends."""
    for at in (t, *s.times):
        value, slope = from_point_to_point(s, bisect_right(s.times, at) - 1, at)
        assert s(at) == pytest.approx(value, abs=1e-11)
        assert s.slope(at) == pytest.approx(slope, abs=1e-9)
        assert s.before(at) == pytest.approx(from_point_to_point(s, bisect_left(s.times, at) - 1, at)[0], abs=1e-11)
    if len(set(s.times)) == len(s.times):
        assert s(t) == pytest.approx(np.interp(t, s.times, s.values), abs=1e-11)


@settings(deadline=None)
@given(lines())
def test_lines_keep_within_their_breaks(s: PiecewiseLinear) -> None:
    edges = [-30.0, *s.breaks(-30, 30), 30.0]
    for left, right in pairwise(edges):
        middle = 0.5 * (left + right)
        assert s(left) + s.slope(left) * (middle - left) == pytest.approx(s(middle), abs=1e-9)
        assert s.slope(left) == pytest.approx(s.slope(middle), abs=1e-9)


@settings(deadline=None)
@given(lines(), st.floats(-25, 25))
def test_clipped_lines_are_never_negative(s: PiecewiseLinear, t: float) -> None:
    cut = s.clipped(-25, 25)
    for at in (t, *s.times):
        assert cut(at) == pytest.approx(max(0.0, s(at)), abs=1e-11)
    assert cut.period is None


@settings(deadline=None)
@given(lines(), st.floats(-3, 3), st.floats(-25, 25))
def test_scaled_lines(s: PiecewiseLinear, factor: float, t: float) -> None:
    assert (s * factor)(t) == pytest.approx(factor * s(t), abs=1e-9)


# clipping


def test_a_line_is_clipped_exactly_where_it_crosses_zero() -> None:
    cut = piecewise_linear([0, 3], [-1, 2]).clipped(0, 3)
    assert cut.breaks(0, 3) == (1.0,)
    assert [cut(t) for t in (0.5, 1.0, 2.0)] == [0.0, 0.0, 1.0]
    assert cut.slope(0.5) == 0.0
    assert cut.slope(1.0) == 1.0


def test_values_too_small_to_multiply_are_clipped_too() -> None:
    cut = piecewise_linear([0, 2], [1e-200, -1e-200]).clipped(0, 2)
    assert cut.breaks(0, 3) == (1.0,)
    assert cut(1.5) == 0.0


def test_what_is_positive_or_negative_throughout_is_not_cut() -> None:
    assert BRAKE.clipped(0, 4) is BRAKE
    assert (-BRAKE).clipped(0, 4) == Constant(0.0)
    assert Constant(-3.0).clipped(0, 1) == Constant(0.0)
    wave = sine(1.0, 2.0, offset=1.5)
    assert wave.clipped(0, 4) is wave
    assert sine(1.0, 2.0, offset=-1.5).clipped(0, 4) == Constant(0.0)


def test_points_hidden_below_zero_do_not_break() -> None:
    cut = piecewise_linear([0, 1, 2, 3, 4], [1, -1, -2, -1, 1]).clipped(0, 4)
    assert cut.breaks(0, 4) == (0.5, 3.5)
    hidden = (sine(0.1, 1.0) + piecewise_linear([0, 1, 2, 3, 4], [1, -1, -2, -1, 1])).clipped(0, 4)
    # at 0.5 and 3.5 s the sine is 0, too
    assert hidden.breaks(0, 4) == pytest.approx((0.5, 3.5), rel=1e-15)


def test_a_clipped_sine_has_exact_zero_times() -> None:
    cut = sine(1.0, 1.0).clipped(0.0, 2.75)
    assert cut.breaks(0.0, 2.75) == pytest.approx((0.5, 1.0, 1.5, 2.0, 2.5), rel=3e-16)
    assert [cut(t) for t in (0.25, 0.75, 1.25, 2.7)] == [1.0, 0.0, 1.0, 0.0]
    assert cut.slope(0.75) == 0.0
    assert cut.slope(2.0) == pytest.approx(2 * math.pi)
    assert cut.period == 1.0


def test_the_zero_times_of_an_offset_sine() -> None:
    cut = sine(2.0, 0.5, phase=0.3, offset=1.0).clipped(0.0, 4.0)
    exact = [((7 / 6 + k) * math.pi - 0.3) / math.pi for k in (0, 2)]
    exact += [((11 / 6 + k) * math.pi - 0.3) / math.pi for k in (0, 2)]
    assert cut.breaks(0, 4) == pytest.approx(sorted(t for t in exact if t < 4), rel=1e-15)


def test_short_dips_below_zero_are_seen() -> None:
    # the dip takes 9e-4 of a period, and the search samples 16 times a period
    depth = 4e-6
    cut = sine(1.0, 1.0, offset=1.0 - depth).clipped(0.0, 100.0)
    half = math.acos(1 - depth) / (2 * math.pi)
    exact = sorted(k + 0.75 + s * half for k in range(100) for s in (-1, 1))
    # the depth of the dip is 4e-6 of the values, so roundoff moves its ends more
    assert cut.breaks(0, 100) == pytest.approx(exact, abs=1e-13)
    assert cut(0.75) == 0.0
    assert cut(0.7) > 0.0


def test_a_sine_that_only_touches_zero_does_not_break() -> None:
    wave = sine(1.0, 1.0, offset=1.0)
    assert wave.clipped(0.0, 10.0).breaks(0.0, 10.0) == ()


def test_a_clipped_sum_with_a_curve_has_exact_zero_times() -> None:
    # t - sin(2 pi t) / (2 pi) = 0.75 at t where sin(2 pi t) = 2 pi (t - 0.75)
    total = piecewise_linear([0, 2], [-0.75, 1.25]) + sine(-1 / (2 * math.pi), 1.0)
    (zero,) = total.clipped(0.0, 2.0).breaks(0.0, 1.9)
    assert abs(total(zero)) < 4e-16
    assert total(zero - 1e-12) < 0 < total(zero + 1e-12)


def test_clipping_heeds_jumps_across_zero() -> None:
    total = sine(0.5, 1.0) + step(0.6, before=-1.0, after=1.0)
    cut = total.clipped(0.0, 1.0)
    assert cut.breaks(0.0, 1.0) == (0.6,)
    assert (cut(before(0.6)), cut(0.6)) == (0.0, total(0.6))


def test_clipping_heeds_a_zero_at_a_break() -> None:
    cut = (sine(1.0, 1.0) + step(0.5, 0.0, 1.0) + step(1.5, 0.0, -1.0)).clipped(0.0, 2.0)
    # from the one break to the other the wave is 1 higher and only touches 0; after the other it is negative
    assert cut.breaks(0.0, 2.0) == (0.5, 1.5)
    assert [cut(t) for t in (0.25, 0.5, 1.0, 1.25, 1.5, 1.75)] == pytest.approx([1, 1, 1, 2, 0, 0], abs=1e-15)


def test_a_clipped_function() -> None:
    f = signal(lambda t: math.cos(t) if t < 4 else -1.0, breaks=[4.0])
    cut = f.clipped(0.0, 10.0)
    assert cut.breaks(0.0, 10.0) == pytest.approx((math.pi / 2,), rel=1e-15)
    assert cut.clipped(0.0, 10.0) is cut


waves = st.builds(sine, st.floats(0.1, 10), st.floats(0.1, 5), st.floats(0, 7), st.floats(-12, 12))


@settings(deadline=None)
@given(waves, lines(), st.floats(0, 10))
@example(sine(1.0, 0.75, 0.0, 1.0), PiecewiseLinear((0.0,), (0.0,)), 0.0)
def test_clipped_curves_are_the_positive_part(wave: Signal, s: PiecewiseLinear, t: float) -> None:
    total = wave + s * 0.01
    cut = total.clipped(0.0, 10.0)
    assert cut(t) == pytest.approx(max(0.0, total(t)), abs=1e-9)
    edges = [0.0, *cut.breaks(0, 10), 10.0]
    assert edges == sorted(edges)
    for left, right in pairwise(edges):
        middle = 0.5 * (left + right)
        if cut(middle) > 0:
            assert cut.slope(middle) == total.slope(middle)
        else:
            # where a wave only touches 0 its slope is 0 but for roundoff
            assert abs(cut.slope(middle)) < 1e-12


# data


@pytest.mark.parametrize(
    "s",
    [
        Constant(3.5),
        BRAKE,
        step(1.0, 2.0, -3.0),
        sine(1.0, 2.0, 0.3, 4.0),
        sine(1.0, 2.0) + sine(3.0, 4.0),
        BRAKE + sine(1.0, 2.0) + 5,
    ],
)
def test_plain_data_and_back(s: Signal) -> None:
    assert signal_from_dict(s.to_dict(), "load") == s
    assert pickle.loads(pickle.dumps(s)) == s
    assert hash(s) == hash(pickle.loads(pickle.dumps(s)))


def test_the_short_forms_can_stand_in_a_file() -> None:
    assert signal_from_dict(3, "load") == Constant(3.0)
    data = {"type": "triangle", "start": 0, "peak": 1, "stop": 2, "slope": 5}
    assert signal_from_dict(data, "load") == triangle(0, 1, 2, slope=5)
    assert signal_from_dict({"type": "step", "time": 2}, "load") == step(2)


def test_functions_are_no_data() -> None:
    with pytest.raises(ValueError, match=r"jumping is code, not data; sample it into piecewise_linear"):
        signal(jumping).to_dict()
    with pytest.raises(TypeError, match="Clipped signal is not data"):
        sine(1, 1).clipped(0, 1).to_dict()


def test_functions_of_a_module_can_be_pickled() -> None:
    f = signal(jumping, breaks=[1.0]) * 2
    assert pickle.loads(pickle.dumps(f)) == f
