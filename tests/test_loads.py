"""All loads of a scene as one vector: breaks, looking forward and back, curved entries, drives."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip import Signal, piecewise_linear, signal, sine, step, triangle
from stickslip.equations.loads import Loads
from stickslip.model.signal_makers import as_signal

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
    return [*(s(t) for s in SIGNALS), SIGNALS[4].slope(t), 1.0]


def loads() -> Loads:
    return Loads(SIGNALS, [4], 0.0, 1.0)


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


def test_the_vector_holds_signals_then_rates_then_one() -> None:
    q = loads()
    assert q.size == 7
    assert q.curved.tolist() == [2]
    assert q.complete(0.1).tolist() == pytest.approx(values(0.1), abs=1e-12)


@pytest.mark.parametrize(
    "order", [TIMES, TIMES[::-1], [0.5, 0.02, 0.99, 0.0, 0.4, 0.05, 0.45, 0.1, 0.6, 0.3]]
)
def test_the_vector_does_not_depend_on_where_it_was_read_before(order: list[float]) -> None:
    q = loads()
    for t in order:
        assert q.complete(t).tolist() == pytest.approx(values(t), abs=1e-12), t


@settings(deadline=None)
@given(st.lists(st.floats(0.0, 1.0, exclude_max=True), max_size=20))
def test_the_vector_at_any_times_in_any_order(times: list[float]) -> None:
    q = loads()
    for t in times:
        np.testing.assert_allclose(q.complete(t), values(t), rtol=1e-12, atol=1e-11)


def test_lines_and_their_slopes_carry_on_to_the_next_break() -> None:
    q = loads()
    q0, q1 = q.at(0.41)
    assert (q0[2], q1[2]) == (0.0, 0.0)  # a curved entry stands apart
    ahead = q0 + q1 * 0.08
    exact = values(0.49)
    lines = [0, 1, 3, 4, 5, 6]
    np.testing.assert_allclose(ahead[lines], np.array(exact)[lines], rtol=1e-12)


def test_what_is_shared_cannot_be_written_to() -> None:
    q = loads()
    for array in q.at(0.2):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7.0
    q.complete(0.2)[2] = 7.0  # a copy, as one entry is curved
    assert q.complete(0.2).tolist() == pytest.approx(values(0.2), abs=1e-12)


def test_a_drive_s_acceleration_follows_its_velocity() -> None:
    q = Loads([sine(1.0, 0.5), piecewise_linear([0, 1, 2], [0, 3, 3])], [0, 1], 0.0, 2.0)
    assert q.curved.tolist() == [0, 2]
    assert q.complete(0.0).tolist() == pytest.approx([0.0, 0.0, math.pi, 3.0, 1.0])
    assert q.complete(1.0).tolist() == pytest.approx([0.0, 3.0, -math.pi, 0.0, 1.0], abs=1e-12)


def test_curved_entries_at_many_times_are_columns() -> None:
    q = Loads([sine(1.0, 0.5), as_signal(2, ""), signal(math.sqrt)], [0], 0.0, 2.0)
    times = np.array([0.25, 0.5, 1.75])
    assert q.curved.tolist() == [0, 2, 3]
    many = q.curved_at(times)
    assert many.shape == (3, 3)
    for column, t in zip(many.T, times, strict=True):
        np.testing.assert_allclose(column, q.curved_at(float(t)), rtol=1e-15, atol=1e-16)


def test_functions_are_called_within_the_span_only() -> None:
    q = Loads([signal(math.sqrt), signal(lambda t: math.sqrt(2.0 - t))], [1], 0.0, 2.0)
    for t in (0.0, 1.0, 2.0):
        assert np.isfinite(q.complete(t)).all()
    assert np.isfinite(q.curved_at(np.array([-1e-5, 2.0 + 1e-5]))).all()


def test_the_period_is_the_shortest() -> None:
    assert loads().period == 0.25
    assert Loads([BRAKE], [], 0.0, 1.0).period == math.inf
    assert Loads([signal(math.cos)], [], 0.0, 20.0).period == 2.0


def test_a_slow_sine_does_not_hide_that_a_function_is_unknown() -> None:
    assert Loads([sine(1.0, 1e-3), signal(math.cos)], [], 0.0, 20.0).period == 2.0
    assert Loads([sine(1.0, 1e-3) + signal(math.cos)], [], 0.0, 20.0).period == 2.0


def test_fixed_steps_read_every_load_and_stop_at_none() -> None:
    q = Loads(SIGNALS, [4], 0.0, 1.0, stepped=True)
    assert q.breaks == []
    assert q.curved.tolist() == [1, 2, 3, 4, 5]
    assert math.isfinite(q.period)
    for t in (0.6, 0.1):
        np.testing.assert_allclose(q.complete(t), values(t), rtol=1e-12, atol=1e-12)


def test_a_scene_without_loads() -> None:
    q = Loads([], [], 0.0, 1.0)
    assert q.complete(0.5).tolist() == [1.0]
    assert q.curved.size == 0
