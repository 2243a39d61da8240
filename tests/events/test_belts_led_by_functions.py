"""A belt whose velocity is a function takes bodies along: its acceleration is a difference, its events are exact."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Mode,
    Result,
    Scene,
    Signal,
    SimulationError,
    Spring,
    piecewise_linear,
    signal,
    simulate,
    sine,
)

SOLVERS: list[dict[str, Any]] = [
    {},
    {"method": "Adams"},
    {"method": "BDF", "formulation": "merged"},
    {"formulation": "multiplier"},
]
LAW = DryFriction(1.0, 1.0)


@pytest.mark.parametrize("options", SOLVERS, ids=str)
@pytest.mark.parametrize("contacts", [1, 2])
@pytest.mark.parametrize("scale", [0.3, 1.0, 5.0])
def test_a_belt_whose_acceleration_rises_from_the_level(scale: float, contacts: int, options: dict[str, Any]) -> None:
    """The belt runs with ``s sinh t``: ``s cosh t`` is beyond what the level gives, s, from the first instant."""
    scene = Scene(
        Body("box", inertia=1.0),
        Drive("belt", velocity=signal(lambda t: scale * math.sinh(t))),
        *[Contact(f"pad{i}", "belt", "box", LAW, normal=scale / contacts) for i in range(contacts)],
    )
    result = simulate(scene, (0.0, 1.0), **options)
    np.testing.assert_allclose(result.velocity("box"), scale * result.t, rtol=0, atol=1e-9 * scale)
    assert not result.events and result.mode("pad0")[-1] == Mode.FORWARD


@pytest.mark.parametrize("options", SOLVERS, ids=str)
def test_two_contacts_let_go_at_the_sum_of_their_levels(options: dict[str, Any]) -> None:
    """The belt runs with ``sin 2 t``; the pads hold 2 kg with 2 N and |2 - 2 t| N: they let go backward together."""
    falling = piecewise_linear([0, 1, 2], [2, 0, 2])
    scene = Scene(
        Body("box", inertia=2.0, velocity=math.sin(1.6)),
        Drive("belt", velocity=signal(lambda t: math.sin(2 * t))),
        Contact("first", "belt", "box", LAW, normal=falling),
        Contact("second", "belt", "box", LAW, normal=2.0),
    )
    result = simulate(scene, (0.8, 1.4), **options)
    expected = scipy.optimize.brentq(lambda t: 4 * math.cos(2 * t) + 2 * t, 1.0, 1.2, xtol=1e-14)
    assert [event.after for event in result.events] == [Mode.BACKWARD] * 2
    np.testing.assert_allclose([event.t for event in result.events], expected, rtol=0, atol=1e-9)


RAISED = sine(-1.0, 1 / math.pi, phase=math.pi / 2, offset=1.0)


@pytest.mark.parametrize("options", SOLVERS, ids=str)
@pytest.mark.parametrize("dwell", [0.0, 0.01])
@pytest.mark.parametrize(("ground", "static"), [(0.0, 1.0), (0.3, 1.0), (0.3, 1.1), (1.2, 1.0), (1.2, 1.3)])
def test_a_belt_that_starts_and_stops_smoothly(
    ground: float, static: float, dwell: float, options: dict[str, Any]
) -> None:
    """``1 - cos 2 t`` touches 0 at 0, pi, 2 pi: the box goes as with the sine, which the series follows exactly."""
    law = DryFriction(static, 1.0, dwell=dwell)

    def run(velocity: Signal, **given: Any) -> Result:
        scene = Scene(
            Body("box", inertia=0.6),
            Drive("belt", velocity=velocity),
            Contact("pad", "belt", "box", law, normal=1.0),
            Contact("floor", "box", GROUND, law, normal=ground),
        )
        return simulate(scene, (0.0, 5.0), t_eval=np.linspace(0, 5, 101), **given)

    expected, result = run(RAISED), run(signal(lambda t: 1 - math.cos(2 * t)), **options)
    assert [event.contact for event in run(RAISED, **options).events] == [event.contact for event in expected.events]
    np.testing.assert_allclose(result.velocity("box"), expected.velocity("box"), rtol=0, atol=1e-7)
    assert result.stats["restarts"] <= 15
    # a rest of the floor at the instant at which the belt rests may be told or not
    of_pad = [[event.after for event in one.events if event.contact == "pad"] for one in (result, expected)]
    assert of_pad[0] == of_pad[1]


@pytest.mark.parametrize("options", SOLVERS, ids=str)
@pytest.mark.parametrize("other", [lambda t: 3 * math.sin(2 * t) / 3, lambda t: 2 * math.sin(t) * math.cos(t), None])
def test_belts_that_move_alike_by_other_formulas(other: Any, options: dict[str, Any]) -> None:
    """Both belts run with ``sin 2 t``; the first box lets go at ``10 t - 9 N - 4 N = 1 kg 2 cos 2 t``."""
    scene = Scene(
        Body("first", inertia=1.0),
        Body("second", inertia=2.0),
        Drive("left", velocity=signal(lambda t: math.sin(2 * t))),
        Drive("right", velocity=sine(1.0, 1 / math.pi) if other is None else signal(other)),
        Contact("outer", "left", "first", LAW, normal=9.0),
        Contact("middle", "first", "second", LAW, normal=4.0),
        Contact("inner", "right", "second", LAW, normal=9.0),
        Force("first", piecewise_linear([0, 2], [0, 20])),
    )
    result = simulate(scene, (0.0, 1.3), **options)
    expected = scipy.optimize.brentq(lambda t: 10 * t - 13 - 2 * math.cos(2 * t), 1.0, 1.3, xtol=1e-14)
    assert {event.contact for event in result.events} == {"outer", "middle"}
    np.testing.assert_allclose([event.t for event in result.events], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("options", SOLVERS, ids=str)
@pytest.mark.parametrize(
    ("velocity", "acceleration"),
    [
        (lambda t: t**3, lambda t: 3 * t**2),
        (lambda t: t**4, lambda t: 4 * t**3),
        (lambda t: 10 * t**3 - 15 * t**4 + 6 * t**5, lambda t: 30 * t**2 - 60 * t**3 + 30 * t**4),
        (lambda t: math.tanh(t) ** 2, lambda t: 2 * math.tanh(t) / math.cosh(t) ** 2),
    ],
)
def test_a_belt_that_begins_slowly_takes_a_box_from_the_floor(
    velocity: Any, acceleration: Any, options: dict[str, Any]
) -> None:
    """The pad gives 0.3 N, which the floor takes, and 0.6 kg times the acceleration, up to 1 N."""
    scene = Scene(
        Body("box", inertia=0.6),
        Drive("belt", velocity=signal(velocity)),
        Contact("pad", "belt", "box", LAW, normal=1.0),
        Contact("floor", "box", GROUND, LAW, normal=0.3),
    )
    times = np.linspace(0.01, 0.2, 20)
    result = simulate(scene, (0.0, 0.2), t_eval=times, **options)
    np.testing.assert_allclose(result.velocity("box"), [velocity(t) for t in times], rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.force("pad"), [0.3 + 0.6 * acceleration(t) for t in times], rtol=0, atol=1e-8)
    assert not result.events
    assert (result.mode("floor") == Mode.FORWARD).all()


@pytest.mark.parametrize("options", SOLVERS, ids=str)
@pytest.mark.parametrize(("stop", "start"), [(10.0, 0.005), (1e3, 0.5), (1e4, 5.0)])
def test_a_belt_rests_until_it_starts(stop: float, start: float, options: dict[str, Any]) -> None:
    """Until the belt starts with ``(t - start)^3``, pad and floor share a load of 0.2 N, whatever the time span."""
    scene = Scene(
        Body("box", inertia=0.6),
        Drive("belt", velocity=signal(lambda t: max(0.0, min(t - start, 1.0)) ** 3, breaks=[start + 1.0])),
        Contact("pad", "belt", "box", LAW, normal=1.0),
        Contact("floor", "box", GROUND, LAW, normal=0.5),
        Force("box", 0.2),
    )
    result = simulate(scene, (0.0, stop), t_eval=[0.0, 0.9 * start], **options)
    first = result.events[0]
    assert (first.contact, first.after) == ("floor", Mode.FORWARD) and start <= first.t <= start + 1e-5
    assert (result.mode("pad") == Mode.STUCK).all() and (result.mode("floor") == Mode.STUCK).all()
    np.testing.assert_allclose(np.abs([result.force("pad"), result.force("floor")]), 0.1, rtol=0, atol=1e-9)


@pytest.mark.parametrize("scale", [1e-5, 1e-3, 1e3])
def test_belts_that_move_alike_fast_or_slowly(scale: float) -> None:
    """The scene of the test above with its time stretched: ``s sin`` and ``2 s sin cos`` differ by roundoff."""
    scene = Scene(
        Body("first", inertia=1.0 / scale),
        Body("second", inertia=2.0 / scale),
        Drive("left", velocity=signal(lambda t: math.sin(2 * scale * t))),
        Drive("right", velocity=signal(lambda t: 2 * math.sin(scale * t) * math.cos(scale * t))),
        Contact("outer", "left", "first", LAW, normal=9.0),
        Contact("middle", "first", "second", LAW, normal=4.0),
        Contact("inner", "right", "second", LAW, normal=9.0),
        Force("first", piecewise_linear([0, 2 / scale], [0, 20])),
    )
    result = simulate(scene, (0.0, 1.3 / scale))
    expected = scipy.optimize.brentq(lambda t: 10 * t - 13 - 2 * math.cos(2 * t), 1.0, 1.3, xtol=1e-14)
    assert [event.contact for event in result.events] == ["outer", "middle"]
    np.testing.assert_allclose([event.t * scale for event in result.events], expected, rtol=0, atol=1e-7)


def test_a_belt_that_stops_and_goes_has_a_roundoff() -> None:
    """Two humps, and rest before and after them: the box slides on the floor while the belt moves."""
    humps = signal(lambda t: 1 - math.cos(2 * (t - 10)) if 10 <= t <= 10 + 2 * math.pi else 0.0)
    scene = Scene(
        Body("box", inertia=0.6),
        Drive("belt", velocity=humps),
        Contact("pad", "belt", "box", LAW, normal=1.0),
        Contact("floor", "box", GROUND, LAW, normal=0.3),
    )
    assert humps.within(0.0, 31.0).roundoff > 0
    result = simulate(scene, (0.0, 31.0), t_eval=[10.2, 12.5, 16.0])
    assert result.stats["restarts"] <= 20
    np.testing.assert_allclose(result.velocity("box"), [humps(t) for t in result.t], rtol=0, atol=1e-9)


@pytest.mark.parametrize("options", SOLVERS, ids=str)
@pytest.mark.parametrize("held", ["by the belt", "by belt and spring", "by belt and floor"])
@pytest.mark.parametrize("offset", [0.0, 1e6], ids=["single precision", "an offset"])
def test_a_belt_known_to_few_digits(offset: float, held: str, options: dict[str, Any]) -> None:
    """The belt runs with ``0.3 cos 3 t``, read in single precision or as the rest of a large number.

    Its acceleration has errors of 1e-5 and more. No step has to follow them: what the belt leads has its velocity.
    """

    def exact(t: float) -> float:
        return 0.3 * math.cos(3 * t)

    def rough(t: float) -> float:
        return (offset + exact(t)) - offset if offset else float(np.float32(exact(t)))

    law, others = DryFriction(0.2, 0.1), []
    if held == "by belt and spring":
        others = [Spring("box", GROUND, stiffness=10.0, damping=0.2)]
    elif held == "by belt and floor":
        others = [Contact("floor", "box", GROUND, law, normal=8.0)]
    runs = [
        simulate(
            Scene(
                Body("box", inertia=1.0),
                Drive("belt", velocity=signal(velocity)),
                Contact("pad", "box", "belt", law, normal=20.0 if held == "by belt and floor" else 5.0),
                *others,
            ),
            (0.0, 3.0),
            **options,
        )
        for velocity in (exact, rough)
    ]
    fine, coarse = ([(event.contact, event.before, event.after) for event in run.events] for run in runs)
    assert fine == coarse
    times = [[event.t for event in run.events] for run in runs]
    np.testing.assert_allclose(*times, rtol=0, atol=1e-6)
    np.testing.assert_allclose(runs[1].y[:, -1], runs[0].y[:, -1], rtol=0, atol=1e-6)
    # velocities in single precision are rough themselves beside the default tolerance
    assert runs[1].stats["steps"] < 5 * runs[0].stats["steps"]


@pytest.mark.parametrize(
    ("velocity", "stop"),
    [
        (lambda t: 0.3 * math.cos(0.03 * t), 300.0),
        (lambda t: 0.3 + 0.3 * math.exp(-(((t - 1.83) / 0.1) ** 2)), 3.0),
        (lambda t: 0.3 + 0.3 * math.exp(-(((t - 18.3) / 0.1) ** 2)), 30.0),
    ],
    ids=["slow", "a pulse", "a pulse in a long run"],
)
def test_a_belt_in_single_precision_that_changes_slowly_or_seldom(
    velocity: Callable[[float], float], stop: float
) -> None:
    """It keeps the same value for many instants: how rough it is shows between them only."""

    def run(f: Callable[[float], float]) -> Result:
        pad = Contact("pad", "box", "belt", DryFriction(0.2, 0.1), normal=5.0)
        return simulate(Scene(Body("box", inertia=1.0), Drive("belt", velocity=signal(f)), pad), (0.0, stop))

    fine, rough = run(velocity), run(lambda t: float(np.float32(velocity(t))))
    assert [event.after for event in rough.events] == [event.after for event in fine.events]
    np.testing.assert_allclose([event.t for event in rough.events], [event.t for event in fine.events], atol=1e-4)
    assert rough.stats["steps"] < 2 * fine.stats["steps"]


def test_a_belt_in_single_precision_beside_a_load_with_many_breaks() -> None:
    """How rough a function is shows between any two breaks, however near."""
    times = np.linspace(0.0, 3.0, 31)
    load = Force("box", piecewise_linear(times, np.cos(7 * times)))

    def run(f: Callable[[float], float]) -> Result:
        pad = Contact("pad", "box", "belt", DryFriction(0.2, 0.1), normal=50.0)
        return simulate(Scene(Body("box", inertia=1.0), Drive("belt", velocity=signal(f)), pad, load), (0.0, 3.0))

    fine = run(lambda t: 0.3 * math.cos(3 * t))
    rough = run(lambda t: float(np.float32(0.3 * math.cos(3 * t))))
    ((caught,), (expected,)) = rough.events, fine.events
    assert caught.after == Mode.STUCK and caught.t == pytest.approx(expected.t, abs=1e-6)
    assert rough.stats["steps"] < 2 * fine.stats["steps"]


def test_a_load_that_fails_later_beside_such_a_belt() -> None:
    """How rough the belt is shows over all of the time, and the load fails only when the motion comes to it."""

    def load(t: float) -> float:
        if t > 2.5:
            raise RuntimeError("no data")
        return 0.1

    scene = Scene(
        Body("box", inertia=1.0),
        Drive("belt", velocity=signal(lambda t: 0.3 * math.cos(t))),
        Contact("pad", "box", "belt", DryFriction(0.2, 0.1), normal=5.0),
        Force("box", signal(load)),
    )
    with pytest.raises(SimulationError, match="no data") as caught:
        simulate(scene, (0.0, 4.0))
    assert 2.0 < caught.value.t <= 2.5
    assert [event.after for event in caught.value.result.events] == [Mode.STUCK]
