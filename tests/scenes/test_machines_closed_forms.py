"""Machines that a user would try, each against a closed form: clutches, gaps and stops beside each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    OneWay,
    Planetary,
    PreSlip,
    Result,
    Scene,
    SimulationError,
    Spring,
    Stop,
    piecewise_linear,
    signal,
    simulate,
    sine,
)

both_engines = pytest.mark.parametrize(
    ("options", "off"),
    [({"method": "series"}, 1e-12), ({"method": "BDF", "rtol": 1e-9, "atol": 1e-11}, 1e-7)],
    ids=["series", "BDF"],
)


def times(result: Result, name: str) -> list[float]:
    return [event.t for event in result.events if event.contact == name]


@both_engines
def test_a_ball_on_a_vibrating_table(options: dict[str, Any], off: float) -> None:
    """It leaves where A w^2 sin(w t) = g, flies a parabola, and lands without rebound."""
    a, w, g = 0.02, 30.0, 9.81
    scene = Scene(
        Drive("table", velocity=sine(a * w, frequency=w / (2 * math.pi), phase=math.pi / 2)),
        Body("ball", inertia=0.3, velocity=a * w),
        Force("ball", -0.3 * g),
        Stop("floor", "ball", "table", lower=0.0),
    )
    result = simulate(scene, (0.0, 0.2), **options)
    leaves = math.asin(g / (a * w * w)) / w
    x, v = a * math.sin(w * leaves), a * w * math.cos(w * leaves)

    def above(t: float) -> float:
        flown = t - leaves
        return x + v * flown - 0.5 * g * flown**2 - a * math.sin(w * t)

    lands = brentq(above, leaves + 0.02, leaves + 0.2, xtol=1e-15)
    assert times(result, "floor")[:2] == pytest.approx([leaves, lands], abs=off)


@both_engines
def test_a_clutch_beside_a_spring_lets_go(options: dict[str, Any], off: float) -> None:
    """Torques 2 and t - 1 on unit inertias: the clutch carries 1.5 - t/2; then s'' + 8 s = 3 - t of the spring."""
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        OneWay("clutch", "a", "b"),
        Spring("a", "b", stiffness=4.0),
        Force("a", 2.0),
        Force("b", piecewise_linear([0.0, 10.0], [-1.0, 9.0])),
    )
    result = simulate(scene, (0.0, 4.0), **options)
    assert times(result, "clutch") == pytest.approx([3.0], abs=off)
    swing = math.sqrt(8.0)
    assert result.stretch("clutch")[-1] == pytest.approx(-(1.0 - math.sin(swing) / swing) / 8.0, abs=off)
    assert result.relative_velocity("clutch")[-1] == pytest.approx(-(1.0 - math.cos(swing)) / 8.0, abs=off)


@both_engines
def test_a_planetary_overruns(options: dict[str, Any], off: float) -> None:
    """A clutch to the ground carries the ring against 6 on the sun, until 2 t on the ring takes over at 1.5 s."""
    scene = Scene(
        Body("sun", inertia=1.0),
        Body("carrier", inertia=3.0),
        Body("ring", inertia=0.5),
        Planetary("gear", sun="sun", carrier="carrier", ring="ring", ratio=2.0),
        OneWay("hold", GROUND, "ring"),
        Force("sun", 6.0),
        Force("ring", piecewise_linear([0.0, 10.0], [0.0, 20.0])),
    )
    result = simulate(scene, (0.0, 5.0), **options)
    assert times(result, "hold") == pytest.approx([1.5], abs=off)
    # held: 12 a = 18 on the carrier; free: 12 a = 6 + 8 t
    carrier = 1.5 * 1.5 + (6.0 * 3.5 + 4.0 * (25.0 - 2.25)) / 12.0
    assert result.velocity("carrier")[-1] == pytest.approx(carrier, abs=10 * off)


@both_engines
def test_an_impact_through_a_planetary(options: dict[str, Any], off: float) -> None:
    """The carrier rebounds from 1 to -0.5: the tie's impulse L gives the sun L and the ring 2 L, 3 (-1.5) = 5 L."""
    scene = Scene(
        Body("sun", inertia=1.0, velocity=3.0),
        Body("carrier", inertia=2.0, velocity=1.0),
        Body("ring", inertia=1.0),
        Planetary("gear", sun="sun", carrier="carrier", ring="ring", ratio=2.0),
        Stop("end", "carrier", GROUND, upper=0.5, restitution=0.5),
    )
    result = simulate(scene, (0.0, 1.0), **options)
    found = [result.velocity(name)[-1] for name in ("sun", "carrier", "ring")]
    assert found == pytest.approx([2.1, -0.5, -1.8], abs=off)


@both_engines
def test_a_bumper_before_a_rigid_end(options: dict[str, Any], off: float) -> None:
    """3 m/s into 100 N/m at 0.5 m, rigid at 0.6 m with restitution 0.5: sqrt(8) there, back with sqrt(8/4 + 1)."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=3.0),
        Gap("bumper", "m", GROUND, upper=0.5, stiffness=100.0),
        Stop("end", "m", GROUND, upper=0.6, restitution=0.5),
    )
    result = simulate(scene, (0.0, 0.5), **options)
    assert times(result, "end") == pytest.approx([0.5 / 3 + math.asin(1 / 3) / 10], abs=off)
    assert result.velocity("m")[-1] == pytest.approx(-math.sqrt(3.0), abs=10 * off)


@both_engines
def test_what_two_stops_leave_no_room_stays(options: dict[str, Any], off: float) -> None:
    """Each stop carries the load while the load points towards it."""
    scene = Scene(
        Body("m", inertia=1.0),
        Stop("left", "m", GROUND, lower=0.0),
        Stop("right", "m", GROUND, upper=0.0),
        Force("m", sine(3.0, frequency=1.0)),
    )
    result = simulate(scene, (0.0, 1.0), **options).sample([0.25, 0.75])
    assert not result.velocity("m").any()
    np.testing.assert_allclose(result.force("right"), [3.0, 0.0], atol=off)
    np.testing.assert_allclose(result.force("left"), [0.0, -3.0], atol=off)


@both_engines
def test_a_dwelling_contact_holds_a_body_at_its_stop(options: dict[str, Any], off: float) -> None:
    """The load turns at 1 s; friction holds it up to 0.8 - 0.3 exp(-t / 0.5), then both let go."""
    scene = Scene(
        Body("m", inertia=1.0),
        Contact("floor", "m", GROUND, DryFriction(0.8, 0.5, dwell=0.5), normal=1.0),
        Stop("end", "m", GROUND, upper=0.0),
        Force("m", piecewise_linear([0.0, 10.0], [1.0, -9.0])),
    )
    result = simulate(scene, (0.0, 3.0), **options)
    goes = brentq(lambda t: t - 1.0 - 0.8 + 0.3 * math.exp(-t / 0.5), 1.0, 3.0, xtol=1e-15)
    assert times(result, "floor") == pytest.approx([goes], abs=off)
    assert times(result, "end") == pytest.approx([goes], abs=off)


@both_engines
@pytest.mark.parametrize("velocity", [piecewise_linear([0.0, 4.0], [1.0, -1.0]), sine(1.0, 0.125, math.pi / 2)])
def test_a_drive_that_turns_round_jams_two_clutches(velocity: Any, options: dict[str, Any], off: float) -> None:
    """Of two shafts geared against each other neither may run ahead of the belt, which turns round at 2 s.

    A contact could give way there; the clutches cannot.
    """
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0),
        Drive("belt", velocity=velocity),
        Gear("gear", "a", "b", ratio=-1.0),
        OneWay("first", "a", "belt"),
        OneWay("second", "b", "belt"),
        Contact("rub", "a", "belt", DryFriction(0.5, 0.2), normal=1.0),
    )
    with pytest.raises(SimulationError, match="'gear', 'first', 'second' are pressed together") as caught:
        simulate(scene, (0.0, 3.0), **options)
    assert caught.value.t == pytest.approx(2.0, abs=1e3 * off)


def test_a_clutch_lets_go_of_a_drive_whose_velocity_is_a_function() -> None:
    """A belt at ``sin(5 t) + 0.3`` m/s drives 3 kg against 1.3 N up to ``15 cos(5 t) = -1.3``, and catches them later.

    The belt's acceleration is known by differences only: the clutch force that comes to 0 has their roundoff.
    """
    scene = Scene(
        Body("a", inertia=3.0, velocity=0.3),
        Body("z", inertia=1.0, velocity=-1.0),
        Drive("belt", velocity=signal(lambda t: math.sin(5.0 * t) + 0.3, period=0.4)),
        OneWay("free", "belt", "a"),
        Contact("rub", "a", "z", PreSlip(DryFriction(0.2, 0.2), 0.03, "tanh"), normal=4.0),
        Force("a", -0.5),
    )
    result = simulate(scene, (0.0, 1.5))
    leaves = math.acos(-1.3 / 15.0) / 5.0

    def behind(t: float) -> float:
        return math.sin(5.0 * leaves) - 1.3 / 3.0 * (t - leaves) - math.sin(5.0 * t)

    assert times(result, "free") == pytest.approx([leaves, brentq(behind, 1.0, 1.5)], abs=1e-7)
    assert result.stats["restarts"] == 2
