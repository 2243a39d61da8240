"""Derivatives of motions: closed forms, central differences of exact runs, and where none exists."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    Karnopp,
    LuGre,
    Mode,
    OneWay,
    Planetary,
    PreSlip,
    Result,
    Scene,
    Spring,
    StateSpace,
    Stop,
    Tie,
    feedback,
    limit_cycle,
    normal,
    output,
    piecewise_linear,
    position,
    power,
    relative_velocity,
    saturate,
    sensitivities,
    simulate,
    sine,
    step,
    table,
    velocity,
)
from stickslip.benchmark import BENCHMARK_SPAN, flywheel_benchmark
from stickslip.model.arrays import Array
from stickslip.studies.derivatives.sensitivities import Sensitivities
from stickslip.studies.parameters import named_parameters


def decay(friction: float = 0.1) -> Scene:
    """Mass 1 on a spring 1, let go at 1; it comes to rest after five half turns of pi."""
    law = DryFriction(friction, friction)
    return Scene(
        Body("m", inertia=1.0, position=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", GROUND, law, normal=1.0),
    )


def differences(scene: Scene, span: tuple[float, float], name: str, read: Callable[[Result], Any], h: float) -> Any:
    """The derivative of what is read from exact runs, by differences of fourth order."""
    (one,) = named_parameters(scene, [name], "test")
    return differences_of(lambda x: one.set(scene, x), one.value, span, read, h)


def differences_of(
    made: Callable[[float], Scene], x: float, span: tuple[float, float], read: Callable[[Result], Any], h: float
) -> Any:
    """The same at x, of scenes that a function makes of a number."""
    a, b, c, d = (
        np.array(read(simulate(made(x + offset * h), span, rtol=1e-11, atol=1e-13))) for offset in (-2, -1, 1, 2)
    )
    return (a - 8 * b + 8 * c - d) / (12 * h)


def all_of(found: Sensitivities) -> np.ndarray:
    """Derivatives of event times, velocities, positions, heats and forces, a column for each parameter."""
    scene = found.result.scene
    parts = [*found.events, *(found.velocity(b.name) for b in scene.bodies)]
    parts += [found.position(b.name) for b in scene.bodies] + [found.heat(c.name) for c in scene.contacts]
    parts += [found.force(row.name) for row in scene.rows]
    return np.array(parts)


def all_in(result: Result) -> list[float]:
    """The same quantities of a result."""
    scene, heat = result.scene, result.energy().contacts
    parts = [e.t for e in result.events] + [result.velocity(b.name)[-1] for b in scene.bodies]
    return (
        parts
        + [result.position(b.name)[-1] for b in scene.bodies]
        + [heat[c.name][-1] for c in scene.contacts]
        + [result.force(row.name)[-1] for row in scene.rows]
    )


def test_free_decay_with_coulomb_friction() -> None:
    """Each half turn takes 2 mu N / k off the amplitude: x_end = 10 mu - x_0 here, at 5 pi sqrt(m/k) whatever both."""
    found = sensitivities(
        decay(),
        (0.0, 20.0),
        ["m.position", "c.law.mu_coulomb", "c.normal", "m.inertia", "springs[0].stiffness"],
    )
    assert found.reasons == ()
    # mu_static stays 0.1: the contact sticks where 0.1 is more than the spring pulls
    assert np.allclose(found.position("m"), [-1.0, 10.0, 1.0, 0.0, -1.0], atol=1e-9)
    assert np.allclose(found.velocity("m"), 0.0, atol=1e-10)
    turns = np.arange(1, 6)
    assert np.allclose(found.events[:, :3], 0.0, atol=1e-9)
    assert np.allclose(found.events[:, 3], 0.5 * math.pi * turns, atol=1e-8)
    assert np.allclose(found.events[:, 4], -0.5 * math.pi * turns, atol=1e-8)
    # the spring's energy becomes heat: (x_0^2 - x_end^2) / 2
    assert np.allclose(found.heat("c"), [1.0, 0.0, 0.0, 0.0, 0.5], atol=1e-9)
    # the spring is held by the contact: r = -k x
    assert np.allclose(found.force("c"), [1.0, -10.0, -1.0, 0.0, 1.0 - 0.5 + 0.5 - 0.0], atol=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF", "rtol": 1e-10, "atol": 1e-12}])
def test_what_a_belt_that_speeds_up_catches_goes_on_with_it(options: dict[str, Any]) -> None:
    """``v = v0 - 2 t / m`` meets ``u = t / 2`` after 2 s: then only the position depends on the start."""
    scene = Scene(
        Body("b", inertia=2.0, velocity=3.0),
        Drive("belt", velocity=piecewise_linear([0.0, 10.0], [0.0, 5.0])),
        Contact("c", "b", "belt", DryFriction(0.5, 0.2), normal=10.0),
    )
    found = sensitivities(scene, (0.0, 5.0), ["b.velocity", "b.inertia"], **options)
    assert np.allclose(found.events, [[1 / 1.5, 3.0 * 0.5 / 1.5**2]], atol=1e-8)
    assert np.allclose(found.velocity("b"), 0.0, atol=1e-8)
    assert np.allclose(found.position("b"), [2.0, 0.5 * 0.5 * 2.0**2], atol=1e-7)


def test_a_planetary_whose_ring_a_belt_that_speeds_up_catches() -> None:
    """The ring sticks, so its deviation vanishes at once; sun and carrier, which go on, share it."""
    scene = Scene(
        Body("sun", inertia=0.3, velocity=6.0),
        Body("carrier", inertia=0.7, velocity=8 / 3),
        Body("ring", inertia=0.5, velocity=1.0),
        Planetary("gear", sun="sun", carrier="carrier", ring="ring", ratio=2.0),
        Drive("belt", velocity=piecewise_linear([0.0, 4.0], [0.0, 4.0])),
        Contact("c", "ring", "belt", DryFriction(0.8, 0.2), normal=2.0),
        Damper("sun", GROUND, damping=0.1),
    )
    found = sensitivities(scene, (0.0, 2.0), ["c.normal"])
    assert [event.after for event in found.result.events] == [0]
    told = differences(scene, (0.0, 2.0), "c.normal", all_in, 1e-3)
    assert np.allclose(all_of(found)[:, 0], told, rtol=1e-6, atol=1e-8)


def test_a_longer_rest_before_the_start_delays_the_breakaway() -> None:
    """A load of 2 N/s meets ``10 (0.5 - 0.3 exp(-(t + 0.3) / 0.8))``."""
    law = DryFriction(0.5, 0.2, dwell=0.8)
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("c", "b", GROUND, law, normal=10.0, rested=0.3),
        Force("b", piecewise_linear([0.0, 4.0], [0.0, 8.0])),
    )
    found = sensitivities(scene, (0.0, 4.0), ["c.rested"])
    (t,) = (event.t for event in found.result.events)
    rise = 3.0 / 0.8 * math.exp(-(t + 0.3) / 0.8)
    assert 5.0 - 0.8 * rise == pytest.approx(2.0 * t, abs=1e-10)
    assert np.allclose(found.events, rise / (2.0 - rise), rtol=1e-8)


@pytest.mark.parametrize("options", [{}, {"method": "BDF", "rtol": 1e-10, "atol": 1e-12}])
def test_a_ball_is_struck_by_a_table_that_speeds_up(options: dict[str, Any]) -> None:
    """``1 + v0 t`` meets ``t^2 / 4``; from there the ball has 1.5 times the table's velocity less ``v0 / 2``."""
    scene = Scene(
        Body("ball", inertia=1.0, position=1.0, velocity=-1.0),
        Drive("table", velocity=piecewise_linear([0.0, 2.0], [0.0, 1.0])),
        Stop("stop", "ball", "table", lower=0.0, restitution=0.5),
    )
    found = sensitivities(scene, (0.0, 1.0), ["ball.velocity", "stop.restitution"], **options)
    t = 2 * (math.sqrt(2) - 1)
    later = t / (0.5 * t + 1.0)
    assert np.allclose(found.events, [[later, 0.0]], atol=1e-8)
    assert np.allclose(found.velocity("ball"), [0.75 * later - 0.5, 0.5 * t + 1.0], atol=1e-8)


def test_at_other_times() -> None:
    """Up to the first turn x = (x_0 - mu) cos t + mu, with mu N = 0.1."""
    found = sensitivities(decay(), (0.0, 2.0), ["m.position", "c.normal"])
    t = np.array([1.5, 0.3])
    assert np.allclose(found.position("m", t), np.array([np.cos(t), 0.1 - 0.1 * np.cos(t)]).T, atol=1e-12)
    assert np.allclose(found.velocity("m", t), np.array([-np.sin(t), 0.1 * np.sin(t)]).T, atol=1e-12)
    assert np.allclose(found.force("c", t), [[0.0, -0.1]] * 2, atol=1e-12)
    assert found.velocity("m", 0.3).shape == (2,)


def test_a_block_that_a_belt_carries_along() -> None:
    """It sticks at t = m v / (mu N), having moved m v^2 / (2 mu N); then it moves with the belt."""
    scene = Scene(
        Body("m", inertia=2.0),
        Drive("belt", velocity=3.0),
        Contact("c", "m", "belt", DryFriction(0.2, 0.1), normal=10.0),
    )
    names = [
        "belt.velocity",
        "m.inertia",
        "c.law.mu_coulomb",
        "c.law.mu_static",
        "m.velocity",
        "belt.position",
    ]
    found = sensitivities(scene, (0.0, 10.0), names)
    assert np.allclose(found.events[0], [2.0, 3.0, -60.0, 0.0, -2.0, 0.0], atol=1e-9)
    assert np.allclose(found.velocity("m"), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=1e-11)
    # x(T) = v T - m v^2 / (2 mu N) with the way to the velocity of the belt; m (v - v_0)^2 / (2 mu N) in general
    assert np.allclose(found.position("m"), [10.0 - 6.0, -4.5, 90.0, 0.0, 6.0, 0.0], atol=1e-8)
    assert np.allclose(found.position("belt"), [10.0, 0.0, 0.0, 0.0, 0.0, 1.0], atol=1e-10)
    # half of what the belt gives is heat: m v^2 / 2
    assert np.allclose(found.heat("c"), [6.0, 4.5, 0.0, 0.0, -6.0, 0.0], atol=1e-9)


@pytest.mark.slow
def test_the_benchmark_against_differences() -> None:
    scene = flywheel_benchmark()
    names = [
        "wheel1.inertia",
        "wheel2.velocity",
        "interface.law.mu_static",
        "interface.law.dwell",
        "brake.law.mu_coulomb",
        "brake.normal.scale",
        "brake.normal.times[4]",
        "interface.normal",
    ]
    found = sensitivities(scene, BENCHMARK_SPAN, names)
    assert found.reasons == () and len(found.result.events) == 5
    exact = all_of(found)
    for k, one in enumerate(named_parameters(scene, names, "test")):
        told = differences(scene, BENCHMARK_SPAN, one.name, all_in, 1e-5 * one.value)
        assert np.abs(exact[:, k] - told).max() <= 2e-8 * np.abs(told).max(), one.name


@pytest.mark.slow
def test_gears_radii_and_drives_against_differences() -> None:
    """With another ratio r the bodies start as an impulse in the gear leaves them.

    It takes r times as much from the wheel as it gives to the motor: (0.4 * 3 + 0.1 * 6 r) / (0.4 + 0.1 r^2) is the
    velocity of the wheel then, and r times that the one of the motor.
    """
    law = DryFriction(0.5, 0.4, dwell=0.2)
    scene = Scene(
        Body("wheel", inertia=0.4, velocity=3.0),
        Body("car", inertia=2.0, velocity=0.5),
        Body("motor", inertia=0.1, velocity=6.0),
        Drive("road", velocity=sine(0.3, 0.7)),
        Gear("gear", "motor", "wheel", ratio=2.0),
        Contact("tread", "wheel", "car", law, normal=4.0, radius_a=0.3),
        Contact("rub", "car", "road", DryFriction(0.15, 0.1), normal=sine(2.0, 0.4, offset=3.0)),
        Spring("car", "road", stiffness=3.0, damping=0.1, rest=0.1),
    )

    def geared(ratio: float) -> Scene:
        wheel = (0.4 * 3.0 + 0.1 * 6.0 * ratio) / (0.4 + 0.1 * ratio**2)
        started = scene.replace("wheel", velocity=wheel).replace("motor", velocity=ratio * wheel)
        return started.replace("gear", ratio=ratio)

    names = [
        "gear.ratio",
        "tread.radius_a",
        "road.velocity.amplitude",
        "rub.normal.frequency",
        "springs[0].rest",
    ]
    span = (0.0, 4.0)
    found = sensitivities(scene, span, names)
    assert found.reasons == () and len(found.result.events) >= 3
    exact = all_of(found)
    for k, one in enumerate(named_parameters(scene, names, "test")):
        if one.name == "gear.ratio":
            told = differences_of(geared, 2.0, span, all_in, 2e-4)
        else:
            told = differences(scene, span, one.name, all_in, 1e-4 * one.value)
        assert np.abs(exact[:, k] - told).max() <= 1e-8 * np.abs(told).max(), one.name


@pytest.mark.slow
def test_a_kinetic_curve_by_cvode() -> None:
    """A block on a belt with a Stribeck curve sticks and slips. It starts at rest on the belt, however fast that is."""
    law = DryFriction(1.0, 0.6, stribeck_velocity=0.3)
    scene = Scene(
        Body("m", inertia=1.0, velocity=0.2),
        Drive("belt", velocity=0.2),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", "belt", law, normal=1.0),
    )

    def together(speed: float) -> Scene:
        return scene.replace("m", velocity=speed).replace("belt", velocity=speed)

    names = ["c.law.stribeck_velocity", "c.law.mu_static", "belt.velocity", "m.inertia"]
    span = (0.0, 15.0)
    found = sensitivities(scene, span, names)
    assert found.result.stats["engine"] == "CVODE BDF" and len(found.result.events) >= 3
    assert found.reasons == ()
    exact = all_of(found)
    for k, one in enumerate(named_parameters(scene, names, "test")):
        if one.name == "belt.velocity":
            told = differences_of(together, 0.2, span, all_in, 4e-4)
        else:
            told = differences(scene, span, one.name, all_in, 2e-3 * one.value)
        assert np.abs(exact[:, k] - told).max() <= 2e-6 * np.abs(told).max(), one.name


def steep_belt(exponent: float, begin: float = 0.1) -> Scene:
    """Friction falls from rest as ``-w^exponent`` does; for exponents below 1 its slope there has no bound."""
    law = DryFriction(0.5, 0.3, stribeck_velocity=0.15, stribeck_exponent=exponent)
    return Scene(
        Body("b", inertia=1.0, velocity=begin),
        Drive("h", velocity=0.3),
        Spring("b", GROUND, stiffness=6.0, damping=0.1),
        Contact("c", "b", "h", law, normal=2.0),
    )


@pytest.mark.slow
@pytest.mark.parametrize(("exponent", "off"), [(0.6, 1e-6), (0.9, 1e-7), (1.0, 1e-7), (1.5, 1e-7)])
@pytest.mark.parametrize("name", ["h.velocity", "c.law.mu_static", "springs[0].stiffness"])
def test_friction_that_is_steep_at_rest(exponent: float, off: float, name: str) -> None:
    """A block that starts slower than the belt is caught by it, let go, and caught again."""
    scene, span = steep_belt(exponent), (0.0, 4.0)
    found = sensitivities(scene, span, [name])
    assert found.reasons == () and len(found.result.events) >= 3
    told = differences(scene, span, name, all_in, 1e-3)
    assert np.abs(all_of(found)[:, 0] - told).max() <= off * np.abs(told).max()


@pytest.mark.parametrize("exponent", [0.6, 1.0])
def test_a_feedback_that_is_a_spring_changes_no_derivative_where_friction_is_steep_at_rest(exponent: float) -> None:
    law = DryFriction(0.4, 0.3, stribeck_velocity=0.5, stribeck_exponent=exponent)
    elements = Body("m", inertia=1.0, velocity=2.0), Contact("c", "m", GROUND, law, normal=10.0)
    pulls = Spring("m", GROUND, stiffness=5.0), Force("m", feedback(lambda x: -5.0 * x, position("m")))
    found = [sensitivities(Scene(*elements, pull), (0.0, 0.8), ["m.velocity", "m.inertia"]) for pull in pulls]
    assert [one.reasons for one in found] == [(), ()] and len(found[0].result.events) == 1
    assert found[1].events == pytest.approx(found[0].events, rel=1e-6)
    assert found[1].position("m") == pytest.approx(found[0].position("m"), rel=1e-6)


def test_a_slow_ramp_lets_go_a_contact_whose_friction_is_steep_at_rest() -> None:
    """``w' = a t + 0.3 (1 - exp(-(w / 0.2)^(1/2)))`` from the breakaway at 0.7 / a on, solved for ``u = w^(1/2)``.

    There ``2 u u' = a t + 0.3 (1 - exp(-u / 0.2^(1/2)))``, and u begins as k t with ``2 k^2 = a + 0.3 k / 0.2^(1/2)``.
    """

    def last(a: float) -> float:
        c = 0.3 / math.sqrt(0.2)
        k, begin = (c + math.sqrt(c * c + 8 * a)) / 4, 1e-9

        def rate(t: float, u: np.ndarray) -> np.ndarray:
            return np.asarray((a * t - 0.3 * np.expm1(-u / math.sqrt(0.2))) / (2 * u))

        span = begin, 36.0 - 0.7 / a
        return float(solve_ivp(rate, span, [k * begin], method="DOP853", rtol=1e-13, atol=1e-16).y[0, -1]) ** 2

    law = DryFriction(0.7, 0.4, stribeck_velocity=0.2, stribeck_exponent=0.5)
    ramp = Force("m", piecewise_linear([0.0, 100.0], [0.0, 2.0]))
    scene = Scene(Body("m", inertia=1.0), Contact("c", "m", GROUND, law, normal=1.0), ramp)
    found = sensitivities(scene, (0.0, 36.0), ["forces[0].signal.scale"])
    assert found.result.velocity("m")[-1] == pytest.approx(last(0.02), rel=1e-7)
    h = 1e-5
    wanted = (8 * (last(0.02 + h) - last(0.02 - h)) - last(0.02 + 2 * h) + last(0.02 - 2 * h)) / (12 * h)
    assert found.reasons == () and found.velocity("m")[0] == pytest.approx(0.02 * wanted, rel=1e-5)


def test_a_phase_that_only_shifts_the_time_shifts_all_impacts() -> None:
    """Drive and body begin at rest: ``sin(2 pi f t + p)`` makes all impacts ``p / (2 pi f)`` earlier, to first order.

    The velocity before an impact does not change with p, but for roundoff of two terms that cancel.
    """
    found = sensitivities(
        Scene(
            Body("m", inertia=1.0),
            Drive("d", velocity=sine(1.0, 0.35)),
            Spring("m", "d", stiffness=6.0, damping=0.2),
            Stop("st", "m", GROUND, upper=0.5, restitution=0.8),
        ),
        (0.0, 6.0),
        ["d.velocity.phase"],
    )
    assert found.reasons == () and len(found.result.events) == 4
    assert found.events[:, 0] == pytest.approx([-1 / (2 * math.pi * 0.35)] * 4, rel=1e-9)


@pytest.mark.slow
def test_friction_that_falls_too_steeply_from_rest_has_no_derivative() -> None:
    """``w' = c w^d + k v t`` with d < 1/2: the first term outruns the second, which sets when slip begins."""
    found = sensitivities(steep_belt(0.4), (0.0, 4.0), ["h.velocity", "b.velocity"])
    held, freed = (event.t for event in found.result.events[:2])
    assert np.isnan(found.events[2:]).all()
    # up to the first slip there are derivatives: beside differences
    for k, (name, value) in enumerate((("h.velocity", 0.3), ("b.velocity", 0.1))):
        told = differences(found.result.scene, (0.0, 1.0), name, lambda r: [e.t for e in r.events[:2]], 1e-3 * value)
        assert found.events[:2, k] == pytest.approx(told, rel=1e-5)
    assert len(found.reasons) == 2 and "a Stribeck exponent below 1/2" in found.reasons[0]
    # held, b is as fast as the drive
    assert found.velocity("b", [0.5 * (held + freed)])[0] == pytest.approx([1.0, 0.0], abs=1e-9)
    assert np.isnan(found.velocity("b")).all()


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [0.7, 0.9, 1.5])
def test_a_cycle_with_friction_that_is_steep_at_rest_forgets(exponent: float) -> None:
    """A contact sticks: the multiplier is 0."""
    law = DryFriction(0.5, 0.3, stribeck_velocity=0.15, stribeck_exponent=exponent)
    cycle = limit_cycle(
        Scene(
            Body("b", inertia=1.0, velocity=0.1),
            Drive("h", velocity=0.1),
            Spring("b", GROUND, stiffness=6.0),
            Contact("c", "b", "h", law, normal=2.0),
        )
    )
    assert np.abs(cycle.multipliers).max() < 1e-6


@pytest.mark.slow
def test_bristles_that_the_motion_presses_on() -> None:
    law = LuGre(DryFriction(1.5, 1.0, stribeck_velocity=0.05), stiffness=100.0, damping=1.0)
    scene = Scene(
        Body("m", inertia=1.0, velocity=0.1),
        Drive("belt", velocity=0.1),
        Spring("m", GROUND, stiffness=2.0),
        Contact("c", "m", "belt", law, normal=1.0 + 0.6 * position("m")),
    )
    names, span = ["c.law.stiffness", "springs[0].stiffness"], (0.0, 3.0)
    exact = all_of(sensitivities(scene, span, names))
    for k, one in enumerate(named_parameters(scene, names, "test")):
        told = differences(scene, span, one.name, all_in, 1e-3 * one.value)
        assert np.abs(exact[:, k] - told).max() <= 1e-6 * np.abs(told).max(), one.name


@pytest.mark.parametrize("gain", [0.0, 0.05])
def test_the_power_of_bristles_depends_on_their_deflection(gain: float) -> None:
    """``v' = -5 x - (1 - gain v) r`` with ``r = 50 z`` and ``z' = v - 50 |v| z / 3``, against an own solution."""
    law = LuGre(DryFriction(0.3, 0.3), stiffness=50.0, damping=0.0)

    def last(speed: float) -> float:
        def rate(t: float, y: np.ndarray) -> list[float]:
            v, x, z = y
            return [-5 * x - (1 - gain * v) * 50 * z, v, v - 50 * abs(v) * z / 3]

        return float(solve_ivp(rate, (0.0, 0.3), [speed, 0.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-14).y[0, -1])

    scene = Scene(
        Body("m", inertia=1.0, velocity=1.5),
        Contact("c", "m", GROUND, law, normal=10.0),
        Spring("m", GROUND, stiffness=5.0),
        Force("m", gain * power("c")),
    )
    found = sensitivities(scene, (0.0, 0.3), ["m.velocity"])
    wanted = (8 * (last(1.5 + 1e-4) - last(1.5 - 1e-4)) - last(1.5 + 2e-4) + last(1.5 - 2e-4)) / 12e-4
    assert found.velocity("m")[0] == pytest.approx(wanted, abs=1e-7)


@pytest.mark.parametrize("method", ["auto", "BDF"])
def test_a_dead_band_that_is_left_and_entered_again(method: Any) -> None:
    """Pushed by ``F = 3 sin(pi t / 4)`` v falls to the band ``v_K`` at t: ``dt/dv_K = 1 / (F(t) - 1)``."""
    turning, band = math.pi / 4, 0.2
    loose = math.asin(2 / 3) / turning

    def speed(t: float) -> float:
        return 3.0 / turning * (math.cos(turning * loose) - math.cos(turning * t)) - (t - loose)

    back = brentq(lambda t: speed(t) - band, 4.0, 8.0)
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, Karnopp(DryFriction(0.2, 0.1), band), normal=10.0),
        Force("a", sine(3.0, 0.125)),
    )
    found = sensitivities(scene, (0.0, back + 0.01), parameters=["c.law.velocity"], method=method)
    wanted = 1.0 / (3.0 * math.sin(turning * back) - 1.0)
    assert found.events[1, 0] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.slow
def test_bristles_straighten_where_nothing_presses_them() -> None:
    """Their deflection before has no effect on the motion when the contact is pressed again."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=2.0),
        Contact(
            "c",
            "a",
            GROUND,
            LuGre(DryFriction(0.3, 0.2, stribeck_velocity=0.5), 1e3, 1.0),
            normal=piecewise_linear([0.3, 0.3, 1.0, 1.0], [10.0, 0.0, 0.0, 10.0]),
        ),
        Force("a", piecewise_linear([0.3, 0.3, 1.0, 1.0], [0.0, -6.0, -6.0, 0.0])),
    )
    names = ["a.velocity", "c.law.law.mu_coulomb", "c.law.stiffness"]
    found = sensitivities(scene, (0.0, 1.1), parameters=names, rtol=1e-10, atol=1e-12)
    for k, (name, h) in enumerate(zip(names, (1e-3, 1e-4, 1.0), strict=True)):
        wanted = differences(scene, (0.0, 1.1), name, lambda result: result.velocity("a")[-1], h)
        assert found.velocity("a")[k] == pytest.approx(wanted, rel=1e-5, abs=1e-9)


def test_forces_near_rest_where_a_curve_bends_fast() -> None:
    """F = mu(w) N with mu = c + (s - c) exp(-(w/v)^2), beside a body that is a hundred times as fast."""
    law = DryFriction(0.6, 0.3, stribeck_velocity=0.05)
    scene = Scene(
        Body("m", inertia=1.0, velocity=0.2),
        Body("fast", inertia=1.0, velocity=20.0),
        Contact("c", "m", GROUND, law, normal=2.0),
    )
    found = sensitivities(scene, (0.0, 0.15), ["m.velocity", "c.law.stribeck_velocity"])
    w = found.result.sample([0.15]).velocity("m")[0]
    bend = 2.0 * 0.3 * math.exp(-((w / 0.05) ** 2)) * 2 * w / 0.05**2
    by_start, by_curve = found.velocity("m")
    assert 0.02 < w < 0.12
    assert found.force("c")[0] == pytest.approx(-bend * by_start, rel=1e-9)
    assert found.force("c")[1] == pytest.approx(-bend * by_curve + bend * w / 0.05, rel=1e-9)


@pytest.mark.parametrize("kind", ["pressed", "controlled", pytest.param("pendulum", marks=pytest.mark.slow)])
def test_forces_that_depend_on_the_state_against_differences(kind: str) -> None:
    """A contact that its position and velocity open and close; a controller with a state; a dry pendulum."""
    law, other = DryFriction(0.3, 0.2), DryFriction(1.5, 1.0)
    body = Body("m", inertia=1.0, position=0.1, velocity=3.0)
    if kind == "pressed":
        load = 1.0 + 2.0 * position("m") + 0.5 * velocity("m")
        scene = Scene(body, Contact("c", "m", GROUND, law, normal=load), Spring("m", GROUND, stiffness=4.0))
    elif kind == "controlled":
        integral = StateSpace("i", [[0.0]], [[1.0]], [[1.0]], inputs=[position("m")])
        push = Force("m", -2.0 * velocity("m") - 3.0 * position("m") - output("i"))
        scene = Scene(body, Contact("c", "m", GROUND, other, normal=1.0), integral, push)
    else:
        gravity = Force("m", feedback(lambda angle: -9.81 * math.sin(angle), position("m")))
        scene = Scene(body, Contact("c", "m", GROUND, law, normal=2.0), gravity)
    names = ["m.velocity", "m.inertia", "c.law.mu_coulomb"]
    span = (0.0, 1.0 if kind == "pendulum" else 4.0)
    found = sensitivities(scene, span, names)
    assert found.reasons == () and found.result.events
    exact = all_of(found)
    for k, one in enumerate(named_parameters(scene, names, "test")):
        told = differences(scene, span, one.name, all_in, 1e-4 * one.value)
        bound = 1e-6 if kind == "pendulum" else 1e-9
        assert np.abs(exact[:, k] - told).max() <= bound * np.abs(told).max(), one.name


@pytest.mark.slow
def test_a_ball_that_bounces_to_rest() -> None:
    """t_n = sqrt(2 h / g) (1 + 2 (e + e^2 + ... + e^n)); it rests at sqrt(2 h / g) (1 + e) / (1 - e)."""
    height, gravity, e = 1.0, 9.81, 0.5
    scene = Scene(
        Body("ball", inertia=1.0, position=height),
        Force("ball", -gravity),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=e),
    )
    names = ["ball.position", "floor.restitution", "floor.lower", "forces[0].signal", "ball.inertia"]
    found = sensitivities(scene, (0.0, 3.0), names)
    times = np.array([event.t for event in found.result.events])
    assert found.reasons == () and times.size > 20
    n, fall = np.arange(times.size), math.sqrt(2 * height / gravity)
    by_e = 2 * fall * np.cumsum(n * e ** np.maximum(n - 1.0, 0.0))
    exact = [times / (2 * height), by_e, -times / (2 * height), times / (2 * gravity), times / 2]
    # the last rebounds are as slow as roundoff lets them be
    assert np.allclose(found.events[:20], np.transpose(exact)[:20], atol=1e-9)
    assert np.allclose(found.events, np.transpose(exact), atol=1e-5)
    assert np.allclose(found.position("ball"), [0.0, 0.0, 1.0, 0.0, 0.0], atol=1e-9)


def test_rebounds_that_accumulate_while_both_bodies_move_fast() -> None:
    """As above with g = F / m_a; in the end x_a - x_b = h, and the centre of mass moves as before.

    The last rebounds are 1e-8 as fast as the bodies: they are no grazes.
    """
    gap, e, push = 0.5, 0.3, 2.0
    scene = Scene(
        Body("a", inertia=1.0, velocity=5.0),
        Body("b", inertia=3.0, velocity=5.0),
        Force("a", push),
        Stop("play", "a", "b", upper=gap, restitution=e),
    )
    found = sensitivities(scene, (0.0, 2.0), ["play.upper", "forces[0].signal"])
    assert found.reasons == () and len(found.result.events) > 15
    n = np.arange(len(found.result.events))
    times = math.sqrt(2 * gap / push) * (1 + 2 * np.cumsum(np.where(n > 0, e**n, 0.0)))
    assert np.allclose(found.events, np.outer(times, [0.5 / gap, -0.5 / push]), rtol=1e-6)
    assert np.allclose(found.position("a"), [0.75, 0.5 * 2.0**2 / 4], rtol=1e-10)
    assert np.allclose(found.velocity("b"), [0.0, 2.0 / 4], rtol=1e-10, atol=1e-10)


def test_slow_rebounds_from_a_table_whose_speed_changes() -> None:
    """With s = sqrt(V^2 + 2 g h): t_n = (s - V) / g + 2 s / g (e + ... + e^n).

    A small change of the table's speed is larger than the last rebounds; the ball comes to rest on it all the same.
    """
    speed, gravity, height, e = 0.5, 2.0, 1.0, 0.4
    scene = Scene(
        Body("ball", inertia=1.0, position=height),
        Drive("table", velocity=speed),
        Stop("floor", "ball", "table", lower=0.0, restitution=e),
        Force("ball", -gravity),
    )
    found = sensitivities(scene, (0.0, 3.0), ["table.velocity"])
    n = np.arange(len(found.result.events))
    slope = speed / math.sqrt(speed**2 + 2 * gravity * height)
    rebounds = np.cumsum(np.where(n > 0, e**n, 0.0))
    assert found.reasons == () and n.size > 20
    assert np.allclose(found.events[:, 0], (slope - 1 + 2 * slope * rebounds) / gravity, atol=1e-6)
    assert np.allclose([found.position("ball"), found.velocity("ball")], [[3.0], [1.0]], rtol=1e-10)


def test_a_low_flight_does_not_graze() -> None:
    """As above with a floor at 3 m, and a block that comes to rest alone just beyond the peak of a flight 4e-9 m high.

    There a solver begins with short steps, in which the height is constant but for roundoff: these are no minima.
    """
    gravity, height, e, mu = 9.81, 1.0, 0.6, 0.3
    fall = math.sqrt(2 * height / gravity)
    impact = fall * (1 + 2 * sum(e**k for k in range(1, 19)))
    stops_at = impact + 1.01 * fall * e**19
    scene = Scene(
        Body("ball", inertia=2.0, position=3.0 + height),
        Force("ball", -2.0 * gravity),
        Stop("floor", "ball", GROUND, lower=3.0, restitution=e),
        Body("block", inertia=1.0, velocity=mu * gravity * stops_at),
        Contact("rub", "block", GROUND, DryFriction(mu, mu), normal=gravity),
    )
    found = sensitivities(scene, (0.0, 3.0), ["floor.restitution"], method="BDF", rtol=1e-12, atol=1e-14)
    assert found.reasons == ()
    k = np.arange(22)
    times = [event.contact == "floor" for event in found.result.events]
    assert np.allclose(found.events[times, 0][:22], 2 * fall * np.cumsum(k * e ** (k - 1.0)), rtol=1e-6)


def carried_to_a_wall(friction: float, force: float, distance: float) -> tuple[float, float, float]:
    """Return when a cart with a load has come to rest at a wall, and their place and velocity at 1 s.

    A force f < 0 on the cart slows both down with ``a = -f / (m + M)``. At the wall the cart (m) is thrown back with
    e w, the load (M) goes on with w. Friction F ends that within ``(1 + e) w / (F / M + (F + f) / m)``, and both come
    back to the wall. All accelerations are constant, so each time all is r times as fast and as long.
    """
    cart, load, e, start = 0.25, 0.5, 0.5, 1.0
    a = -force / (cart + load)
    w = math.sqrt(start**2 - 2 * a * distance)
    slips = (1 + e) * w / (friction / load + (friction + force) / cart)
    gap = e * w * slips - (friction + force) / cart * slips**2 / 2
    together = w - friction / load * slips
    hit = math.sqrt(together**2 - 2 * a * gap)
    rest = (start - w) / a + (slips + (together - hit) / a) / (1 - hit / w)
    return rest, distance - a * (1 - rest) ** 2 / 2, -a * (1 - rest)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["auto", "BDF"])
def test_a_cart_and_its_load_that_strike_a_wall_ever_more_softly(method: Any) -> None:
    """The friction between them comes to rest in the instant of an impact, but for roundoff."""
    values = np.array([5.0, -0.4, 0.1])
    scene = Scene(
        Body("cart", inertia=0.25, velocity=1.0),
        Body("load", inertia=0.5, velocity=1.0),
        Contact("bed", "load", "cart", DryFriction(1.0, 1.0), normal=values[0]),
        Force("cart", values[1]),
        Stop("wall", "cart", GROUND, upper=values[2], restitution=0.5),
    )
    found = sensitivities(scene, (0.0, 1.0), ["bed.normal", "forces[0].signal", "wall.upper"], method=method)
    assert found.reasons == () and found.result.mode("bed")[-1] == 0
    exact = np.array(
        [
            (np.array(carried_to_a_wall(*(values + h))) - carried_to_a_wall(*(values - h))) / (2e-4 * value)
            for value, h in zip(values, np.diag(1e-4 * values), strict=True)
        ]
    )
    computed = [found.events[-1], found.position("cart"), found.velocity("load")]
    assert np.allclose(np.transpose(computed), exact, atol=1e-6)
    end = [found.result.events[-1].t, found.result.position("cart")[-1], found.result.velocity("load")[-1]]
    assert np.allclose(end, carried_to_a_wall(*values), atol=1e-7)


@pytest.mark.slow
def test_rebounds_that_accumulate_leave_others_alone() -> None:
    """``v = v0 cos t`` of an oscillator that never comes to its stop, beside a ball that comes to rest at 0.6 s."""
    scene = Scene(
        Body("other", inertia=1.0, velocity=1.0),
        Spring("other", GROUND, stiffness=1.0),
        Stop("wide", "other", GROUND, lower=-5.0, upper=5.0),
        Body("ball", inertia=1.0, position=0.2),
        Force("ball", -10.0),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=0.5),
    )
    found = sensitivities(scene, (0.0, 2.0), ["other.velocity"])
    assert not found.reasons and len(found.result.events) > 20
    assert found.velocity("other", [0.5, 0.8, 2.0])[:, 0] == pytest.approx(np.cos([0.5, 0.8, 2.0]), abs=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("speed", [1.7, 1.75, 1.8])
def test_a_ball_chatters_to_rest_on_a_table_that_shakes(speed: float, restitution: float) -> None:
    """However heavy, it moves alike; an oscillator beside it has ``exp(-t / 10) (cos w t - sin(w t) / 10 w)``."""
    scene = Scene(
        Body("other", inertia=1.0),
        Spring("other", GROUND, stiffness=2.0, damping=0.2),
        Body("ball", inertia=1.0),
        Drive("table", velocity=sine(speed, 1.0)),
        Force("ball", -9.81),
        Stop("floor", "ball", "table", lower=0.0, restitution=restitution),
    )
    t, w = 1.2, math.sqrt(1.99)
    found = sensitivities(scene, (0.0, t), ["ball.inertia", "other.velocity"])
    own = math.exp(-0.1 * t) * (math.cos(w * t) - 0.1 / w * math.sin(w * t))
    assert not found.reasons and found.result.mode("floor")[-1] == Mode.BACKWARD
    assert found.velocity("ball", [t])[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert found.velocity("other", [t])[0] == pytest.approx([0.0, own], abs=1e-10)


def test_an_impact_goes_through_a_locked_clutch() -> None:
    """A cart ``x = t^2 / 4`` runs into a wheel that a clutch keeps from running ahead of a drive of velocity d.

    The wheel has the way ``d t - d^2 / 10``. The buffer closes where the cart is 0.1 m ahead, at
    ``t = 2 (d + sqrt(0.9 d^2 + 0.1))``, when the cart has ``t / 2``. The wheel cannot give way, so the cart goes on
    with ``1.5 d - t / 4``.
    """
    d = 0.3
    scene = Scene(
        Body("cart", inertia=1.0),
        Body("wheel", inertia=0.2),
        Drive("drive", velocity=d),
        OneWay("clutch", "wheel", "drive"),
        Stop("buffer", "cart", "wheel", upper=0.1, restitution=0.5),
        Force("wheel", 1.0),
        Force("cart", 0.5),
    )
    found = sensitivities(scene, (0.0, 2.0), ["drive.velocity"])
    root = math.sqrt(0.9 * d**2 + 0.1)
    meet, later = 2 * (d + root), 2 * (1 + 0.9 * d / root)
    assert not found.reasons and found.result.events[1].t == pytest.approx(meet, abs=1e-13)
    assert found.events[1] == pytest.approx([later], rel=1e-10)
    assert found.velocity("cart", [2.0])[0] == pytest.approx([1.5 - 0.75 * later], rel=1e-10)
    assert found.velocity("wheel", [2.0])[0] == pytest.approx([1.0], rel=1e-10)


def test_an_impact_goes_through_a_clutch_with_a_gear() -> None:
    """A motor of inertia 1 under 1 N m drives a wheel of 0.2 by ``v_w = g v_m`` to a stop at 0.2 rad, with e = 0.6.

    With ``m = 1 + 0.2 g^2`` it gets there at ``t = sqrt(0.4 m / g)``, and the wheel goes back with ``-0.6 g t / m``.
    """
    g = 0.5
    scene = Scene(
        Body("motor", inertia=1.0),
        Body("wheel", inertia=0.2),
        OneWay("clutch", "motor", "wheel", radius_a=g),
        Force("motor", 1.0),
        Stop("end", "wheel", GROUND, upper=0.2, restitution=0.6),
    )
    found = sensitivities(scene, (0.0, 1.1), ["clutch.radius_a"])
    m = 1 + 0.2 * g**2
    t = math.sqrt(0.4 * m / g)
    later = 0.5 * t * (0.4 * g / m - 1 / g)
    assert not found.reasons and found.result.events[0].t == pytest.approx(t, abs=1e-13)
    assert found.events[0] == pytest.approx([later], rel=1e-10)
    change = 1e-5
    near = [simulate(scene.replace("clutch", radius_a=g + part), (0.0, 1.1)) for part in (change, -change)]
    for body in ("motor", "wheel"):
        difference = (near[0].velocity(body)[-1] - near[1].velocity(body)[-1]) / (2 * change)
        assert found.velocity(body, [1.1])[0, 0] == pytest.approx(difference, rel=1e-8)


@pytest.mark.parametrize("far", [(), (Stop("far", "b", GROUND, lower=-9.0, upper=9.0),)])
def test_a_geared_impact_on_a_moving_wall(far: tuple[Stop, ...]) -> None:
    """A pair of inertia ``M = m + 4`` is driven by 3 N m to a wall at ``0.5 + V t``, and rebounds with e = 0.5.

    It is there at ``t1``, where ``a t1^2 / 2 - V t1 = 0.5`` with ``a = 3 / M``, and then has
    ``v = V - e (a t1 - V) + a (t - t1)``. A stop that is never met changes nothing.
    """
    m, wall, e, stop = 2.0, -0.1, 0.5, 1.7
    scene = Scene(
        Body("a", inertia=m),
        Body("b", inertia=1.0),
        Gear("g", "a", "b", ratio=0.5),
        Force("a", 3.0),
        Drive("d", velocity=wall),
        Stop("wall", "a", "d", upper=0.5, restitution=e),
        *far,
    )
    found = sensitivities(scene, (0.0, stop), ["a.inertia", "d.velocity", "wall.restitution", "wall.upper"])
    a = 3.0 / (m + 4.0)
    root = math.sqrt(wall**2 + a)
    t1 = (wall + root) / a
    by_a = (1 / (2 * root) - t1) / a
    by_wall = (1 + wall / root) / a
    by_limit = 1 / root
    speed = -e * (t1 + a * by_a) + stop - t1 - a * by_a
    wanted = [
        speed * -a / (m + 4.0),
        1 + e - (1 + e) * a * by_wall,
        -(a * t1 - wall),
        -(1 + e) * a * by_limit,
    ]
    assert not found.reasons
    assert found.velocity("a", [stop])[0] == pytest.approx(wanted, rel=1e-9)


def test_slow_impacts_at_a_large_distance_by_cvode() -> None:
    """As above: t_n = fall (1 + 2 (e + ... + e^n)), whose derivative by the height h above the floor is t_n / (2 h)."""
    height, gravity, e = 1e-2, 0.8, 0.3
    scene = Scene(
        Body("ball", inertia=1.0, position=0.4 + height),
        Body("other", inertia=1.0, velocity=5.0),
        Contact("rub", "other", GROUND, DryFriction(0.2, 0.1, stribeck_velocity=0.5), normal=1.0),
        Spring("other", GROUND, stiffness=1000.0),
        Force("ball", -gravity),
        Stop("floor", "ball", GROUND, lower=0.4, restitution=e),
    )
    found = sensitivities(scene, (0.0, 0.3), ["ball.position"])
    at = [k for k, event in enumerate(found.result.events) if event.contact == "floor"]
    times = np.array([found.result.events[k].t for k in at])
    assert found.reasons == () and times.size > 8
    assert found.result.stats["engine"] == "CVODE BDF"
    n = np.arange(times.size)
    exact = math.sqrt(2 * height / gravity) * (1 + 2 * np.cumsum(np.where(n > 0, e**n, 0.0)))
    assert np.allclose(found.events[at, 0], exact / (2 * height), rtol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["rebounds", "closes", "elastic", "driven"])
def test_stops_and_gaps_against_differences(kind: str) -> None:
    """An oscillator that hits a stop, closes it, or pushes into an elastic one; a geared one between moving stops."""
    body, push = Body("m", inertia=1.0, position=0.5, velocity=1.0), Force("m", sine(1.0, 0.3))
    spring = Spring("m", GROUND, stiffness=1.0, damping=0.1)
    if kind == "driven":
        law = DryFriction(0.3, 0.2)
        extra: list[Any] = [Drive("wall", velocity=sine(0.5, 0.4)), Body("wheel", inertia=0.3, velocity=2.0)]
        extra += [Gear("gear", "wheel", "m", ratio=2.0), Contact("c", "m", "wall", law, normal=1.0)]
        extra += [Stop("w", "m", "wall", upper=1.0, lower=-0.9, restitution=0.6)]
        names = ["wheel.inertia", "w.restitution", "w.lower", "wall.velocity.amplitude", "c.law.mu_coulomb"]
    elif kind == "elastic":
        extra = [Gap("w", "m", GROUND, upper=1.0, stiffness=5.0, damping=0.3)]
        names = ["m.inertia", "w.upper", "w.stiffness", "w.damping"]
    else:
        extra = [Stop("w", "m", GROUND, upper=0.8, restitution=0.7 if kind == "rebounds" else 0.0)]
        names = ["m.inertia", "w.upper", "springs[0].rest", "m.position"]
    scene, span = Scene(body, push, spring, *extra), (0.0, 7.0)
    found = sensitivities(scene, span, names)
    assert found.reasons == () and len(found.result.events) >= 2
    exact = all_of(found)
    for k, one in enumerate(named_parameters(scene, names, "test")):
        told = differences(scene, span, one.name, all_in, 1e-5)
        assert np.abs(exact[:, k] - told).max() <= 1e-8 * np.abs(told).max(), one.name


def test_a_part_that_hops_against_differences() -> None:
    """The gap presses the contact from the instant on in which it touches."""
    scene = Scene(
        Drive("along", velocity=0.3),
        Body("part", inertia=0.5),
        Body("height", inertia=0.5, position=0.01),
        Force("height", -4.0),
        Gap("track", "height", GROUND, lower=0.0, stiffness=400.0, damping=3.0),
        Contact("rub", "part", "along", DryFriction(0.4, 0.35), normal=normal("track")),
    )
    names, span = ["height.position", "track.stiffness", "rub.law.mu_coulomb"], (0.0, 0.3)
    found = sensitivities(scene, span, names)
    assert found.reasons == () and [e.cause for e in found.result.events].count("touches") == 1
    exact = all_of(found)
    for k, one in enumerate(names):
        told = differences(scene, span, one, all_in, 1e-5)
        assert np.abs(exact[:, k] - told).max() <= 1e-8 * np.abs(told).max(), one


def test_the_force_of_a_gap() -> None:
    """A body that dips into an elastic limit of 25 N/m at 1 m/s: the force is 5 sin 5t N, the work 1/2 sin² 5t J."""
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Gap("buffer", "m", GROUND, upper=0.0, stiffness=25.0))
    found, angle = sensitivities(scene, (0.0, 0.2), ["m.velocity", "buffer.stiffness"]), 1.0
    by_stiffness = 0.02 * (5 * math.sin(angle) + 5 * math.cos(angle))
    assert found.force("buffer") == pytest.approx([5 * math.sin(angle), by_stiffness])
    work = [math.sin(angle) ** 2, 0.02 * math.sin(angle) * math.cos(angle)]
    assert found.heat("buffer") == pytest.approx(work)


def test_a_start_at_a_stop() -> None:
    """The body rebounds at once with e v. No start lies beyond the stop: no derivative by the position exists."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=-1.0),
        Force("m", -1.0),
        Stop("w", "m", GROUND, lower=0.0, restitution=0.5),
    )
    found = sensitivities(scene, (0.0, 0.5), ["m.position", "w.restitution", "m.velocity"])
    assert np.isnan(found.position("m")[0]) and "stop 'w' starts at its limit" in found.reasons[0]
    assert np.allclose(found.position("m")[1:], [0.5, -0.25]) and np.allclose(found.events[0, 1:], 0.0)


@pytest.mark.parametrize(
    "kind", ["saturated", *(pytest.param(one, marks=pytest.mark.slow) for one in ("spring", "normal"))]
)
def test_tables_against_differences(kind: str) -> None:
    """Forces and a normal force with corners, which are passed many times."""
    body, law = Body("m", inertia=1.0, position=0.5, velocity=1.0), DryFriction(0.2, 0.1)
    if kind == "spring":
        push: Any = table(position("m"), [-2.0, -0.5, 0.3, 0.8, 2.0], [6.0, 0.8, -0.3, -1.0, -7.0])
    elif kind == "saturated":
        push = saturate(-3 * position("m") - 0.1 * velocity("m"), -0.7, 0.6)
    else:
        push = -2 * position("m")
    normal = table(position("m"), [-1.0, 0.0, 1.0], [0.1, 0.5, 0.2]) if kind == "normal" else 0.3
    scene = Scene(body, Force("m", push), Contact("c", "m", GROUND, law, normal=normal))
    names, span = ["m.inertia", "m.position", "c.law.mu_coulomb"], (0.0, 8.0)
    found = sensitivities(scene, span, names)
    assert found.reasons == () and found.result.events
    exact = all_of(found)
    for k, one in enumerate(named_parameters(scene, names, "test")):
        told = differences(scene, span, one.name, all_in, 1e-4)
        assert np.abs(exact[:, k] - told).max() <= 1e-8 * np.abs(told).max(), one.name


def shaken_bristles(times: list[float], inertia: float, normal: float, stiffness: float) -> np.ndarray:
    """Velocities of a block on LuGre bristles under 3 sin(2 pi t), turn by turn: steps end where |w| has its corner."""
    found, t, y, sign = [], 0.0, np.zeros(2), 1.0

    def rates(t: float, y: np.ndarray, begun: float, sign: float) -> list[float]:
        v, z = y
        g = (0.25 + 0.15 * math.exp(-((v / 0.1) ** 2))) * normal
        rate = v - stiffness * sign * v * z / g
        return [(3.0 * math.sin(2.0 * math.pi * t) - stiffness * z - 2.0 * rate) / inertia, rate]

    def turns(t: float, y: np.ndarray, begun: float, sign: float) -> float:
        return float(y[0] * sign) if t > begun + 1e-9 else 1.0

    turns.terminal, turns.direction = True, -1  # type: ignore[attr-defined]
    for stop in times:
        while t < stop:
            run = solve_ivp(rates, (t, stop), y, "DOP853", rtol=3e-14, atol=1e-17, events=turns, args=(t, sign))
            t, y, sign = run.t[-1], run.y[:, -1], -sign if run.status == 1 else sign
        found.append(y[0])
    return np.array(found)


@pytest.mark.slow
def test_bristles_that_turn_over() -> None:
    """The slopes of their rates jump at each turn, of which there are six."""
    law = LuGre(DryFriction(0.4, 0.25, stribeck_velocity=0.1), stiffness=300.0, damping=2.0)
    scene = Scene(
        Body("m", inertia=1.0),
        Force("m", sine(3.0, 1.0)),
        Contact("c", "m", GROUND, law, normal=10.0),
    )
    names, times, nominal = (
        ["m.inertia", "c.normal", "c.law.stiffness"],
        [0.6, 1.3, 2.0, 2.7],
        [1.0, 10.0, 300.0],
    )
    found = sensitivities(scene, (0.0, 2.7), names, rtol=1e-12, atol=1e-14).velocity("m", times)
    for k, value in enumerate(nominal):
        near = []
        for offset in (-2, -1, 1, 2):
            own = list(nominal)
            own[k] += offset * 3e-4 * value
            near.append(shaken_bristles(times, *own))
        told = (near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 * 3e-4 * value)
        assert np.abs(found[:, k] - told).max() < 3e-8 * np.abs(told).max(), names[k]


def test_a_table_that_stays_at_its_corner_has_no_derivative() -> None:
    pull = table(position("m"), [-2.0, 0.0, 2.0], [6.0, 0.0, -2.0])
    found = sensitivities(Scene(Body("m", inertia=1.0), Force("m", pull)), (0.0, 1.0), ["m.position", "m.inertia"])
    assert np.isnan(found.position("m")[0]) and found.position("m")[1] == 0.0
    assert "stays at its corner 0" in found.reasons[0]


@pytest.mark.parametrize("method", ["auto", "BDF"])
@pytest.mark.parametrize("kind", ["saturated", "table", "two"])
def test_a_normal_force_that_rises_from_a_corner(kind: str, method: Any) -> None:
    """N is 0 up to x = 0 and 5 x beyond; from -1 m at 1 m/s with stiffness k = 4 the body moves as on springs.

    With ``w^2 = k / m`` it is at 0 at ``atan(w) / w`` with ``sqrt(1 + w^2)``. From there on friction adds ``5 mu``
    to the stiffness, up to the reversal after a quarter of a period.
    """
    x = position("m")
    forces = {"saturated": saturate(5 * x, 0.0, 10.0), "table": table(x, [-2.0, 0.0, 1.0], [0.0, 0.0, 5.0])}
    forces["two"] = saturate(3 * x, 0.0, 10.0) + saturate(2 * x, 0.0, 10.0)
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0, position=-1.0),
        Spring("m", GROUND, stiffness=4.0),
        Contact("c", "m", GROUND, DryFriction(0.4, 0.35), normal=forces[kind]),
    )
    options = {} if method == "auto" else {"rtol": 1e-11, "atol": 1e-13}
    names = ["m.inertia", "c.law.mu_coulomb"]
    found = sensitivities(scene, (0.0, 1.3), names, method=method, **options)

    def exact(inertia: complex, mu: complex) -> tuple[complex, complex]:
        """The velocity at 1 s, and the time of the reversal."""
        w, faster = cmath.sqrt(4.0 / inertia), cmath.sqrt((4.0 + 5.0 * mu) / inertia)
        closes = cmath.atan(w) / w
        return cmath.sqrt(1.0 + w * w) * cmath.cos(faster * (1.0 - closes)), closes + 0.5 * math.pi / faster

    h, tolerance = 1e-30, 1e-11 if method == "auto" else 1e-8
    assert found.reasons == ()
    for k, (dm, dmu) in enumerate([(h, 0.0), (0.0, h)]):
        v, t = exact(1.0 + 1j * dm, 0.35 + 1j * dmu)
        assert found.velocity("m", [1.0])[0, k] == pytest.approx(v.imag / h, abs=tolerance)
        assert found.events[0, k] == pytest.approx(t.imag / h, abs=tolerance)


def test_corners_of_two_tables_that_close_a_contact_together() -> None:
    """Both corners are met at 1 s; whether `a` starts a little faster or slower decides which table rises first."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0, position=-1.0),
        Body("b", inertia=1.0, velocity=1.0, position=-1.0),
        Contact(
            "c",
            "a",
            GROUND,
            DryFriction(0.4, 0.35),
            normal=saturate(position("a"), 0.0, 9.0) + saturate(position("b"), 0.0, 9.0),
        ),
    )
    found = sensitivities(scene, (0.0, 1.5), ["a.velocity", "c.law.mu_coulomb"])
    assert np.isnan(found.velocity("a")[0]) and "corners of several tables fall together" in found.reasons[0]
    # v' = -0.7 (t - 1) from t = 1 on
    assert found.velocity("a")[1] == pytest.approx(differences(scene, (0.0, 1.5), "c.law.mu_coulomb", last_of_a, 1e-4))


def last_of_a(result: Result) -> float:
    return float(result.velocity("a")[-1])


def test_a_contact_that_closes_in_the_instant_in_which_a_gap_starts_at_its_limit() -> None:
    """A track that swings presses a part from the start on: its friction pulls it along from 0."""
    scene = Scene(
        Drive("across", velocity=sine(0.06, 25.0, phase=math.pi / 2)),
        Drive("along", velocity=0.15),
        Body("part", inertia=0.1),
        Body("height", inertia=0.1),
        Force("height", -0.981),
        Gap("track", "height", "across", lower=0.0, stiffness=1e5, damping=50.0),
        Contact("rub", "part", "along", DryFriction(0.4, 0.35), normal=normal("track")),
    )
    names, span = ["rub.law.mu_coulomb", "part.inertia", "track.stiffness"], (0.0, 1e-3)
    found = sensitivities(scene, span, names)
    assert found.reasons == ()
    for k, name in enumerate(names):
        h = {"track.stiffness": 1e2}.get(name, 1e-4)
        told = differences(scene, span, name, lambda result: result.velocity("part")[-1], h)
        assert told != 0 and found.velocity("part")[k] == pytest.approx(told, rel=1e-7), name


def test_a_break_that_falls_together_with_another_has_no_derivative_of_its_event() -> None:
    """A block is let go where its normal force jumps down, at a break that stands twice."""
    load = piecewise_linear([0.0, 2.0, 2.0, 4.0], [9.0, 9.0, 1.0, 1.0])
    scene = Scene(
        Body("m", inertia=1.0),
        Contact("c", "m", GROUND, DryFriction(0.5, 0.3), normal=load),
        Force("m", 2.0),
    )
    found = sensitivities(scene, (0.0, 3.0), ["c.normal.times[1]", "c.normal.values[1]", "m.inertia"])
    assert [event.t for event in found.result.events] == [2.0]
    assert np.isnan(found.events[0, 0]) and np.array_equal(found.events[0, 1:], [0.0, 0.0])


def test_series_and_cvode_agree() -> None:
    names = ["m.position", "c.normal", "m.inertia"]
    by_series = all_of(sensitivities(decay(), (0.0, 8.0), names))
    by_cvode = all_of(sensitivities(decay(), (0.0, 8.0), names, method="BDF"))
    assert np.allclose(by_series, by_cvode, atol=1e-7)


def block(*others: Any, velocity: float = 0.0, static: float = 0.2) -> Scene:
    law = DryFriction(static, 0.1)
    return Scene(Body("m", inertia=1.0, velocity=velocity), Contact("c", "m", GROUND, law, normal=10.0), *others)


@pytest.mark.slow
def test_what_comes_to_rest_slowly_does_not_graze() -> None:
    """A stem on a strong spring and damper follows a slow force, and turns where its steady motion does.

    Its acceleration there is 1e-8 of the terms that add up to it. With ``a = k - W^2`` and ``u = c W / a`` it turns at
    ``(pi / 2 + atan u) / W``.
    """
    damping, frequency, stiffness = 300.0, 0.01, 5e4
    turn = 2 * math.pi * frequency
    stem = Scene(
        Body("stem", inertia=1.0),
        Spring("stem", GROUND, stiffness=stiffness, damping=damping),
        Force("stem", sine(3000.0, frequency)),
        Contact("packing", "stem", GROUND, DryFriction(1.0, 1.0), normal=1000.0),
    )
    found = sensitivities(stem, (0.0, 0.3 / frequency), ["springs[0].damping", "springs[0].stiffness"])
    a = stiffness - turn**2
    u = damping * turn / a
    assert not found.reasons
    assert abs(found.result.events[1].t - (math.pi / 2 + math.atan(u)) / turn) < 1e-8
    assert np.allclose(found.events[1], np.array([1.0, -u / turn]) / (a * (1 + u**2)), rtol=1e-4)


def test_a_touch_of_the_level_has_no_derivative() -> None:
    """The force comes to exactly the breakaway level 2 at 0.25 s."""
    found = sensitivities(block(Force("m", sine(2.0, 1.0))), (0.0, 1.0), ["forces[0].signal.amplitude", "m.inertia"])
    assert np.isnan(found.velocity("m")[0]) and found.velocity("m")[1] == 0.0
    assert len(found.reasons) == 1 and "t = 0.25 s on: 'c' grazes" in found.reasons[0]
    assert found.velocity("m", 0.2)[0] == 0.0


def test_an_event_on_a_break_has_no_derivative() -> None:
    """The block would stop just when a force begins to push it."""
    scene = block(Force("m", step(1.0, 0.0, 5.0)), velocity=1.0)
    found = sensitivities(scene, (0.0, 2.0), ["m.velocity", "c.law.mu_static"])
    assert np.isnan(found.velocity("m")[0]) and found.velocity("m")[1] == 0.0
    assert "falls on a break of a load" in found.reasons[0]
    # it is pushed up to its level by a load that has a kink there
    scene = block(Force("m", piecewise_linear([0.0, 1.0, 2.0], [0.0, 2.0, 3.0])))
    found = sensitivities(scene, (0.0, 2.0), ["c.law.mu_static", "c.law.mu_coulomb"])
    assert np.isnan(found.events[0, 0]) and found.events[0, 1] == 0.0
    assert "falls on a break of a load" in found.reasons[0]


@pytest.mark.parametrize("law", [DryFriction(0.3, 0.2), PreSlip(DryFriction(0.3, 0.2), 0.01, "tanh")], ids=repr)
def test_a_load_that_is_0_presses_to_one_side_only(law: Any) -> None:
    """N is cut off below 0: a larger first value presses before 1 s, too, a smaller one only lowers the ramp."""
    load = piecewise_linear([1.0, 2.0, 3.0], [0.0, 2.0, 0.0])
    scene = Scene(Body("m", inertia=1.0, velocity=9.0), Contact("c", "m", GROUND, law, normal=load))
    found = sensitivities(scene, (0.0, 4.0), ["c.normal.values[0]", "c.normal.values[1]", "c.normal.values[2]"])
    first, top, last = found.velocity("m", [2.5, 4.0]).T
    assert np.isnan(first).all() and top == pytest.approx([-0.175, -0.2], abs=1e-6)
    assert last[0] == pytest.approx(-0.2 * 0.125, abs=1e-6) and np.isnan(last[1])
    assert "the normal force of 'c' is 0, and near by it is not, but to one side only" in found.reasons[0]


@pytest.mark.parametrize(
    ("parameter", "why"),
    [
        ("c.normal", "a contact carries no force, and near by it does, but to one side only"),
        ("c.normal.values[1]", "or it begins to be cut off at 0"),
    ],
)
@pytest.mark.parametrize("law", [DryFriction(0.5, 0.5), PreSlip(DryFriction(0.5, 0.5), 0.01, "tanh")], ids=repr)
def test_a_contact_without_any_normal_force_has_no_derivative_by_it(law: Any, parameter: str, why: str) -> None:
    """A body slides at 9 m/s. A normal force brakes it, ``v(2) = 9 - N`` if it is constant; a negative one does not."""
    normal = piecewise_linear([0.0, 1.0, 2.0], [0.0] * 3) if parameter.endswith("]") else 0.0
    scene = Scene(Body("m", inertia=1.0, velocity=9.0), Contact("c", "m", GROUND, law, normal=normal))
    found = sensitivities(scene, (0.0, 2.0), [parameter, "m.velocity"])
    by_normal, by_start = found.velocity("m")
    assert np.isnan(by_normal) and by_start == pytest.approx(1.0, abs=1e-10)
    (reason,) = found.reasons
    assert f"{parameter!r} from t = 0 s on" in reason and why in reason


def test_two_events_at_once_have_no_derivative() -> None:
    law = DryFriction(0.1, 0.1)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=1.0, velocity=1.0),
        Contact("c", "a", GROUND, law, normal=10.0),
        Contact("d", "b", GROUND, law, normal=10.0),
        Spring("a", "b", stiffness=1.0),
    )
    found = sensitivities(scene, (0.0, 2.0), ["a.velocity", "springs[0].stiffness"])
    assert np.isnan(found.events[:, 0]).all() and np.abs(found.events[:, 1]).max() < 1e-12
    assert "'c' and 'd' fall together" in found.reasons[0] and len(found.reasons) == 1


def test_contacts_that_share_a_motion_come_to_rest_together() -> None:
    """Two contacts to one body that a swinging drive holds: one event, and a derivative."""
    law = DryFriction(0.4, 0.3)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=1.0),
        Drive("shaker", velocity=sine(0.2, 0.3)),
        Contact("grip", "b", "shaker", law, normal=30.0),
        Contact("c", "a", "b", law, normal=3.0),
        Contact("d", "a", "shaker", law, normal=2.0),
    )
    names, span = ["c.normal", "a.inertia", "shaker.velocity.amplitude"], (0.0, 2.0)
    found = sensitivities(scene, span, names)
    assert found.reasons == () and [event.contact for event in found.result.events] == ["c", "d"]
    exact = all_of(found)
    for k, one in enumerate(named_parameters(scene, names, "test")):
        told = differences(scene, span, one.name, all_in, 1e-4 * one.value)
        assert np.abs(exact[:, k] - told).max() <= 1e-9 * np.abs(told).max(), one.name


def test_a_start_at_rest_has_no_derivative_with_respect_to_its_velocity() -> None:
    found = sensitivities(block(Force("m", 5.0)), (0.0, 2.0), ["m.velocity", "c.law.mu_coulomb"])
    assert np.isnan(found.velocity("m")[0]) and found.velocity("m")[1] == pytest.approx(-20.0, abs=1e-10)
    assert "the derivatives to the two sides differ" in found.reasons[0]


def test_a_force_that_starts_at_its_level_has_no_derivative() -> None:
    """F = mu_c N + a t with the dwell tau: with a little more push the block slips at once, with less it sticks."""
    law = DryFriction(1.2, 0.8, dwell=0.3)
    scene = Scene(
        Body("m", inertia=1.0),
        Contact("c", "m", GROUND, law, normal=1.0),
        Force("m", 0.8),
        Force("m", piecewise_linear([0.0, 1.0], [0.0, 0.6])),
    )
    found = sensitivities(scene, (0.0, 2.0), ["forces[0].signal", "m.inertia"])
    # it lets go where the push comes to the level, whatever it weighs
    assert np.isnan(found.events[:, 0]).all() and found.events[:, 1] == pytest.approx([0.0], abs=1e-12)
    assert found.reasons[0].endswith("'c' starts at its level: the derivatives to the two sides differ")


def test_a_dwell_that_begins_later_to_both_sides_has_no_derivative() -> None:
    """A block rides on a belt. If the belt is faster or slower by h it slips for h m / (mu_c N) before it sticks."""

    def belt(dwell: float, speed: float = 0.1) -> Scene:
        return Scene(
            Body("m", inertia=1.0, velocity=0.1),
            Drive("b", velocity=speed),
            Spring("m", GROUND, stiffness=2.0),
            Contact("c", "m", "b", DryFriction(1.5, 1.0, dwell=dwell), normal=1.0),
        )

    span = (0.0, 8.0)
    found = sensitivities(belt(5.0), span, ["b.velocity", "c.law.dwell"])
    # it lets go where 0.2 t = 1.5 - 0.5 exp(-t / dwell): the derivatives of both sides by dwell
    t = found.result.events[0].t
    short = 0.5 * math.exp(-t / 5.0)
    assert 0.2 * t == pytest.approx(1.5 - short, rel=1e-12)
    assert np.isnan(found.events[0, 0])
    assert found.events[0, 1] == pytest.approx(-short * t / 25.0 / (0.2 - short / 5.0), rel=1e-9)
    assert "'c' starts at rest, and to both sides its dwell begins later" in found.reasons[0]
    let_go = [
        next(e.t for e in simulate(belt(5.0, 0.1 + h), span).events if "breakaway" in e.cause)
        for h in (-1e-6, 0.0, 1e-6)
    ]
    assert (let_go[1] - let_go[0]) / 1e-6 == pytest.approx(-78.48, abs=0.01)
    assert (let_go[2] - let_go[1]) / 1e-6 == pytest.approx(-78.77, abs=0.01)
    # without a dwell it comes along at once: t = mu_s N / (k v)
    assert sensitivities(belt(0.0), span, ["b.velocity"]).events[0] == pytest.approx([-75.0], abs=1e-9)


@pytest.mark.parametrize("slope", [0.1, -0.02])
def test_friction_of_a_function_has_its_slope_at_rest(slope: float) -> None:
    """m v' = -(0.02 + k v): at rest where the exponential of k t / m is 1 + 50 k v_0; dt/dv_0 = m / (0.02 + k v_0).

    The last step ends at a speed that is roundoff.
    """
    law = DryFriction(0.3, 0.3, kinetic=lambda speed: 0.3 + slope * speed)
    for speed in (0.05, 0.06, 0.07, 0.4):
        scene = Scene(
            Body("m", inertia=1.0, velocity=speed), Contact("c", "m", GROUND, law, normal=1.0), Force("m", 0.28)
        )
        found = sensitivities(scene, (0.0, 60.0), ["m.velocity", "m.inertia"])
        exact = [1.0 / (0.02 + slope * speed), math.log1p(50.0 * slope * speed) / slope]
        assert found.events[0] == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize(("bend", "exponent"), [(1e-4, 0.5), (1e-3, 0.5), (1e-2, 0.5), (1e-3, 0.6), (1e-2, 0.8)])
def test_a_stop_where_friction_is_vertical_at_rest(bend: float, exponent: float) -> None:
    """m w' = F - mu(w): a motion from 1 m/s takes the integral of m / (mu - F), and dt/dw_0 = m / (mu(w_0) - F).

    dt/dm = t / m, and F lengthens it by the integral of m / (mu - F)^2; w = s^4 in both.
    """
    law = DryFriction(0.5, 0.4, stribeck_velocity=bend, stribeck_exponent=exponent)
    scene = Scene(
        Drive("belt", velocity=0.3),
        Body("m", inertia=2.0, velocity=1.3),
        Contact("c", "m", "belt", law, normal=1.0),
        Force("m", 0.35),
    )

    def pull(speed: float) -> float:
        return 0.05 + 0.1 * math.exp(-((speed / bend) ** exponent))

    def lasts(power: int) -> float:
        points = [0.1 * bend**0.25, bend**0.25, 2.0 * bend**0.25]
        return quad(lambda s: 8 * s**3 / pull(s**4) ** power, 0.0, 1.0, epsrel=1e-11, limit=500, points=points)[0]

    names = ["m.velocity", "belt.velocity", "m.inertia", "forces[0].signal.value"]
    found = sensitivities(scene, (0.0, 50.0), names)
    exact = [2.0 / pull(1.0), -2.0 / pull(1.0), lasts(1) / 2.0, lasts(2)]
    assert found.events[0] == pytest.approx(exact, rel=1e-6)
    assert not found.reasons


@pytest.mark.parametrize("scale", [1e-4, 1e-3, 1e-2])
def test_a_function_whose_exponent_is_a_half_has_derivatives(scale: float) -> None:
    """From 0.75 s on m v' = a F - mu(v), with mu = 0.4 + 0.1 exp(-(v / scale)^(1/2)); by differences of own solutions.

    In the square root of the time since then they are smooth.
    """
    law = DryFriction(0.6, 0.5, kinetic=lambda speed: 0.4 + 0.1 * math.exp(-math.sqrt(speed / scale)))
    load = piecewise_linear([0.0, 1.0, 2.0], [0.0, 0.8, 0.8])
    scene = Scene(Body("m", inertia=1.0), Contact("c", "m", GROUND, law, normal=1.0), Force("m", load))
    found = sensitivities(scene, (0.0, 2.0), ["forces[0].signal.scale"])
    assert not found.reasons

    def final(a: float) -> float:
        start = 0.75 / a

        def rate(root: float, y: Array) -> list[float]:
            t = start + root**2
            friction = 0.4 + 0.1 * math.exp(-math.sqrt(max(y[0], 0.0) / scale))
            return [2.0 * root * (a * 0.8 * min(t, 1.0) - friction)]

        return float(
            solve_ivp(rate, (0.0, math.sqrt(2.0 - start)), [0.0], rtol=1e-12, atol=1e-16, max_step=0.01).y[0, -1]
        )

    h = 1e-4
    slope = (final(1.0 + h) - final(1.0 - h)) / (2 * h)
    assert found.velocity("m")[0] == pytest.approx(slope, rel=1e-6)


def test_a_function_with_a_corner_where_a_contact_rests_is_not_crossed() -> None:
    """Friction of 1 N / (1 + 3 |w|): a function of |w| has the derivatives of a smooth one on the side of slip.

    The speed of the belt changes w: near by, at the same velocity of the block, |w| would be on the other side.
    """

    def by_belt(normal: Any, law: DryFriction) -> float:
        scene = Scene(
            Drive("belt", velocity=0.2),
            Body("b", inertia=1.0, velocity=0.2),
            Spring("b", GROUND, stiffness=1.0),
            Contact("c", "b", "belt", law, normal=normal),
        )
        return float(sensitivities(scene, (0.0, 8.0), ["belt.velocity"]).velocity("b")[0])

    one, w = DryFriction(1.0, 1.0), relative_velocity("c")
    exact = by_belt(1.0, DryFriction(1.0, 1.0, kinetic=lambda speed: 1 / (1 + 3 * speed)))
    assert exact == pytest.approx(5.14726233, rel=1e-8)
    assert by_belt(feedback(lambda w: 1 / (1 - 3 * w), w), one) == pytest.approx(exact, rel=1e-8)
    assert by_belt(feedback(lambda w: 1 / (1 + 3 * abs(w)), w), one) == pytest.approx(exact, rel=1e-6)
    given = feedback(
        lambda w: 1 / (1 + 3 * abs(w)),
        w,
        derivatives=lambda w: (3.0 if w <= 0 else -3.0) / (1 + 3 * abs(w)) ** 2,
    )
    assert by_belt(given, one) == pytest.approx(exact, rel=1e-8)


@pytest.mark.parametrize("width", [0.01, 0.003])
def test_heat_on_a_narrow_bump(width: float) -> None:
    """The bump is narrower than the solver's steps. Heat is the energy that is lost: v_0 - v dv/dv_0 by v_0."""
    bump = feedback(lambda x: 1 + 5 * math.exp(-(((x - 0.7) / width) ** 2)), position("m"))
    contact = Contact("c", "m", GROUND, DryFriction(0.1, 0.1), normal=bump)
    found = sensitivities(Scene(Body("m", inertia=1.0, velocity=2.0), contact), (0.0, 1.0), ["m.velocity"], rtol=1e-9)
    lost = 2.0 - found.result.velocity("m")[-1] * float(found.velocity("m")[0])
    assert found.heat("c")[0] == pytest.approx(lost, abs=1e-4)


def test_relaxation_has_no_time() -> None:
    law = DryFriction(0.2, 0.0, kinetic=lambda v: 0.1 * v)
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Contact("c", "m", GROUND, law, normal=10.0))
    found = sensitivities(scene, (0.0, 100.0), ["m.velocity"])
    assert np.isnan(found.events).all() and "velocity margin" in found.reasons[0]
    assert found.position("m") == pytest.approx(1.0, abs=1e-6)


def test_gains_factors_of_feedback_and_levers_are_parameters() -> None:
    """x'' = -k x - mu, x_0 = 1: at 1 s x = (1 + mu / k) cos(w) - mu / k with w = sqrt(k).

    A lever ``v_a + c v_b = 0``: ``(m_a + m_b / c^2) v_a' = F``.
    """
    names = ["forces[0].signal.scale", "forces[0].signal.terms[0][1]"]
    spring = Force("m", -4.0 * position("m"))
    rub = Contact("c", "m", GROUND, DryFriction(0.1, 0.1), normal=4.0)
    found = sensitivities(Scene(Body("m", inertia=1.0, position=1.0), spring, rub), (0.0, 1.0), names)
    k, mu, w = 4.0, -0.4, 2.0
    by_k = -mu / k**2 * (math.cos(w) - 1) - (1 + mu / k) * math.sin(w) / (2 * w)
    assert np.allclose(found.position("m"), [4 * by_k, -by_k], rtol=1e-9)

    lever = Scene(Body("a", inertia=1.0), Body("b", inertia=2.0), Tie("lever", {"a": 1.0, "b": 2.0}), Force("a", 3.0))
    (one,) = sensitivities(lever, (0.0, 1.0), ["lever.coefficients.b"]).velocity("a")
    c = 2.0
    assert one == pytest.approx(3.0 * 4.0 / c**3 / (1.0 + 2.0 / c**2) ** 2, rel=1e-9)


def test_a_function_without_derivatives_is_differenced_finely() -> None:
    """m v' = -v^3: v = v_0 / q with q = sqrt(1 + 2 v_0^2 t / m), and dv/dv_0 = 1 / q^3."""
    scene = Scene(Body("m", inertia=2.0, velocity=1.5), Force("m", feedback(lambda v: -(v**3), velocity("m"))))
    found = sensitivities(scene, (0.0, 3.0), ["m.velocity", "m.inertia"])
    q = math.sqrt(1 + 2 * 1.5**2 * 3.0 / 2.0)
    assert np.allclose(found.velocity("m"), [q**-3, 1.5**3 * 3.0 / 2.0**2 / q**3], rtol=1e-9)


def test_limits_have_the_unit_of_positions() -> None:
    scene = Scene(Body("m", inertia=1.0), Stop("wall", "m", GROUND, upper=1.0, restitution=0.5), motion="translation")
    upper, restitution = named_parameters(scene, ["wall.upper", "wall.restitution"], "test")
    assert upper.unit(scene) == "m" and restitution.unit(scene) == ""


def test_what_is_no_parameter_is_refused() -> None:
    scene = block(Force("m", sine(1.0, 1.0)), Damper("m", GROUND, damping=1.0), Spring("m", GROUND, stiffness=0.0))

    def refused(kind: type[Exception], names: Any, *words: str) -> None:
        with pytest.raises(kind) as told:
            sensitivities(scene, (0.0, 1.0), names)
        for word in words:
            assert word in str(told.value), told.value

    refused(ValueError, ["m.mass"], "'m.mass'", "inertia")
    refused(ValueError, ["x.inertia"], "'x.inertia'", "'c', 'm'")
    refused(ValueError, ["dampers[1].damping"], "1 dampers")
    refused(ValueError, ["forces[0].signal"], "load over time", "scale")
    refused(ValueError, ["c.law"], "c.law.mu_static")
    refused(ValueError, ["c.law.mu_static_backward"], "not set")
    refused(ValueError, ["c.a"], "str")
    refused(ValueError, [], "empty")
    refused(ValueError, ["m.inertia", "m.inertia"], "twice")
    refused(TypeError, "m.inertia", "['m.inertia']")
    refused(TypeError, [1], "name")
    refused(ValueError, ["springs[0].stiffness"], "other states or contacts")
    refused(ValueError, ["c.law.dwell"], "other states or contacts")
    with pytest.raises(TypeError, match="must be a Scene"):
        sensitivities(None, (0.0, 1.0), ["m.inertia"])  # type: ignore[arg-type]


def test_a_parameter_at_its_limit_has_one_side() -> None:
    """m v' = -mu N - c v: t = (m / c) log(1 + c v_0 / (mu N)), so dt/dc = -m v_0^2 / (2 (mu N)^2) = -1/8 at c = 0."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Damper("m", GROUND, damping=0.0),
        Contact("c", "m", GROUND, DryFriction(0.2, 0.2), normal=10.0),
    )
    found = sensitivities(scene, (0.0, 3.0), ["dampers[0].damping", "c.law.mu_coulomb"])
    assert np.allclose(found.events, [[-0.125, -2.5]], atol=1e-9)


def test_a_parameter_belongs_to_what_has_it_of_a_body_and_a_contact_of_one_name() -> None:
    """A body of mass m slows down by mu N / m: v = v0 - mu N t / m."""
    scene = Scene(Body("a", inertia=2.0, velocity=5.0), Contact("a", "a", GROUND, DryFriction(0.3, 0.3), normal=10.0))
    found = sensitivities(scene, (0.0, 1.0), ["a.inertia", "a.normal"])
    assert np.allclose(found.velocity("a"), [3.0 / 4.0, -0.3 / 2.0], rtol=1e-9)
    with pytest.raises(ValueError, match="a body and a contact are both called 'a'; rename one of them"):
        sensitivities(scene, (0.0, 1.0), ["a.name"])


def test_parameters_of_rows_are_counted_through_all_kinds_of_rows() -> None:
    """Of a contact and two stops the row 1 is the first stop: it sends v = -3 back as 3 e, so d v / d e = 3."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=-3.0, position=1.0),
        Contact("rub", "a", GROUND, DryFriction(0.1, 0.1), normal=0.0),
        Stop("near", "a", GROUND, lower=0.0, restitution=0.5),
        Stop("far", "a", GROUND, lower=-5.0, restitution=0.9),
    )
    names = ["rows[1].restitution", "rows[2].restitution", "elements[0].velocity"]
    found = sensitivities(scene, (0.0, 1.0), names)
    assert np.allclose(found.velocity("a"), [3.0, 0.0, -0.5], atol=1e-12)
    assert np.allclose(sensitivities(scene, (0.0, 1.0), ["stops[0].restitution"]).velocity("a"), 3.0, atol=1e-12)
    with pytest.raises(ValueError, match=r"'stops\[0\].restitution' is 'rows\[1\].restitution' by another name"):
        sensitivities(scene, (0.0, 1.0), [*names, "stops[0].restitution"])


def test_functions_are_not_asked_beside_a_derivative_that_does_not_exist() -> None:
    """Two breakaways at 1 s end the derivative by the level of one; later the level of a third contact is touched.

    That level is 1 + v², v = 0.5 cos t; the derivative of v by its start is cos t.
    """
    one, ramp = DryFriction(1.0, 1.0), piecewise_linear([0.0, 10.0], [0.0, 10.0])
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=0.5 if name == "swing" else 0.0) for name in ("a", "b", "swing", "c")),
        *(Contact(f"on {name}", name, GROUND, one, normal=1.0) for name in ("a", "b")),
        *(Force(name, ramp) for name in ("a", "b")),
        Contact("on c", "c", GROUND, one, normal=feedback(lambda v: 1.0 + v * v, velocity("swing"))),
        Force("c", 1.0 - 1e-11),
        Spring("swing", GROUND, stiffness=1.0),
    )
    found = sensitivities(scene, (0.0, 8.0), ["on a.normal", "swing.velocity"])
    assert len(found.reasons) == 1 and "'on a' and 'on b' fall together" in found.reasons[0]
    by_level, by_start = found.velocity("swing", [7.9])[0]
    assert np.isnan(by_level)
    assert by_start == pytest.approx(math.cos(7.9), abs=1e-8)


# Parameters whose change has a far larger or smaller effect than their value suggests


@pytest.mark.parametrize(
    ("start", "stop"), [(0.0, 30.3), pytest.param(0.0, 1000.3, marks=pytest.mark.slow), (1000.0, 1000.7)]
)
def test_by_a_frequency_late_in_a_run(start: float, stop: float) -> None:
    """``v' = sin(2 pi f t)``: ``v = (cos(w start) - cos(w stop)) / w``, and ``dv/df = 2 pi dv/dw``."""
    scene = Scene(Body("m", inertia=1.0), Force("m", sine(1.0, 1.0)))
    found = sensitivities(scene, (start, stop), ["forces[0].signal.frequency"])
    w = 2 * math.pi
    turned = stop * math.sin(w * stop) - start * math.sin(w * start)
    exact = w * (turned / w - (math.cos(w * start) - math.cos(w * stop)) / w**2)
    assert found.reasons == ()
    assert found.velocity("m")[0] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("width", [20.0, 0.5, 0.01])
def test_by_a_break_near_others(width: float) -> None:
    """The peak of a triangle at 100 s: at the part x of the way down dv/dpeak = -(1 - x)^2 / 2 = -0.18 with x = 0.4."""
    load = piecewise_linear([100 - width, 100, 100 + width], [0, 1.0, 0.0])
    scene = Scene(Body("m", inertia=1.0), Force("m", load))
    found = sensitivities(scene, (0.0, 120.0), ["forces[0].signal.times[1]"])
    # v = w / 2 + w (x - x²/2) with x = (t - peak) / w; a peak that is later widens the rise and steepens the fall
    assert found.velocity("m", [100 + 0.4 * width])[0] == pytest.approx(-0.18, abs=1e-9)


@pytest.mark.parametrize("rest", [0.0, 0.1 + 0.2 - 0.3, 1e-12, 1e-9])
def test_by_a_number_that_is_small_beside_what_it_adds_to(rest: float) -> None:
    """``x'' = 2 (rest - x) + (0.7 - x)``: ``dx/drest = 2/3 (1 - cos(sqrt(3) t))``."""
    scene = Scene(
        Body("m", inertia=1.0, position=1.0),
        Spring("m", GROUND, stiffness=2.0, rest=rest),
        Spring("m", GROUND, stiffness=1.0, rest=0.7),
    )
    found = sensitivities(scene, (0.0, 2.0), ["springs[0].rest"])
    assert found.velocity("m")[0] == pytest.approx(2 / 3**0.5 * math.sin(2 * 3**0.5), abs=1e-10)


@pytest.mark.parametrize("phase", [0.0, 1e-16, 1e-9, 100.0])
def test_by_a_phase(phase: float) -> None:
    """``v = (cos(p) - cos(w t + p)) / w``."""
    scene = Scene(Body("m", inertia=1.0), Force("m", sine(1.0, 0.3, phase=phase)))
    found = sensitivities(scene, (0.0, 2.0), ["forces[0].signal.phase"])
    w = 0.6 * math.pi
    assert found.velocity("m")[0] == pytest.approx((math.sin(2 * w + phase) - math.sin(phase)) / w, abs=1e-10)


@pytest.mark.parametrize("dwell", [0.0, 1e-3, 1e-8, 1e-10])
def test_a_dwell_that_is_short_beside_the_motion(dwell: float) -> None:
    """A short dwell only lowers the level just after the block sticks, which holds the block then as well as later."""
    scene = Scene(
        Body("block", inertia=1.0),
        Drive("hand", velocity=0.3),
        Spring("block", "hand", stiffness=2.0),
        Contact("floor", "block", GROUND, DryFriction(1.5, 1.0, dwell=dwell), normal=1.0),
    )
    found = sensitivities(scene, (0.0, 8.0), ["springs[0].stiffness"])
    assert found.events[2, 0] == pytest.approx(-2.7130490329393, rel=1e-10)


def test_the_position_of_a_body_by_its_number() -> None:
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0, position=0.2),
        Contact("c", "m", GROUND, DryFriction(0.1, 0.1), normal=1.0),
    )
    found = sensitivities(scene, (0.0, 1.0), ["bodies[0].position", "m.velocity"])
    np.testing.assert_allclose(found.position("m"), [1.0, 1.0], rtol=1e-12)


def test_at_no_times() -> None:
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Contact("c", "m", GROUND, DryFriction(0.1, 0.1), normal=1.0))
    found = sensitivities(scene, (0.0, 1.0), ["m.inertia", "m.velocity"])
    assert found.velocity("m", []).shape == found.heat("c", []).shape == (0, 2)


def test_fixed_steps_have_no_derivatives() -> None:
    scene = Scene(Body("m", inertia=1.0, velocity=1.0))
    with pytest.raises(ValueError, match="its motion has no derivatives; use 'auto' or"):
        sensitivities(scene, (0.0, 1.0), ["m.inertia"], method="RK4")


def test_points_of_a_load_on_one_line_are_breaks() -> None:
    """By the value in the middle the velocity of a mass 1 changes by the area of a hat, 0 before it begins."""
    load = piecewise_linear([0.5, 1.0, 2.0], [1.0, 1.0, 1.0])
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Force("m", load))
    found = sensitivities(scene, (0.0, 3.0), ["forces[0].signal.values[1]"])
    expected = [0.0, 0.0625, 0.625, 0.75]
    np.testing.assert_allclose(found.velocity("m", [0.25, 0.75, 1.5, 3.0])[:, 0], expected, rtol=1e-9, atol=1e-12)
    assert not found.reasons


@pytest.mark.parametrize(
    ("other", "exists"), [(piecewise_linear([0.5, 1.5], [2.0, 0.0]), True), (step(0.5, 2.0), False)]
)
def test_by_the_time_at_which_another_load_breaks_too(other: Any, exists: bool) -> None:
    """A ramp from 1 at t_0 to 1.1 at 1 s adds 0.05 (1 - t_0). Where the other load jumps no derivative is told."""
    load = piecewise_linear([0.5, 1.0], [1.0, 1.1])
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Force("m", load), Force("m", other))
    found = sensitivities(scene, (0.0, 3.0), ["forces[0].signal.times[0]"])
    before, after = found.velocity("m", [0.25, 3.0])[:, 0]
    assert before == 0.0
    if exists:
        assert after == pytest.approx(-0.05, rel=1e-9) and not found.reasons
    else:
        assert math.isnan(after) and "break together" in found.reasons[0]


def test_a_quantity_that_two_elements_read_may_change_in_one_of_them() -> None:
    """An actuator between two bodies: its limit changes in one of its two forces, against differences of exact runs."""

    def between(limit: float) -> Scene:
        def act(high: float) -> Any:
            return saturate(1.0 - 2.0 * position("a") - 0.4 * velocity("a") + sine(0.1, 0.5), -0.5, high)

        return Scene(
            Body("a", inertia=1.0, velocity=1.0),
            Body("b", inertia=2.0),
            Contact("c", "a", "b", DryFriction(0.5, 0.4), normal=1.0),
            Spring("b", GROUND, stiffness=2.0),
            Force("a", act(limit)),
            Force("b", -1.0 * act(0.6)),
        )

    name, h = "forces[0].signal.terms[0][0].ys[1]", 1e-5
    found = sensitivities(between(0.6), (0.0, 3.0), [name])
    (limit,) = named_parameters(between(0.6), [name], "test")
    near = (limit.set(between(0.6), 0.6 + d) for d in (-h, h))
    low, high = (simulate(scene, (0.0, 3.0)).velocity("a")[-1] for scene in near)
    assert found.velocity("a")[0] == pytest.approx((high - low) / (2 * h), rel=1e-5)
    apart = sensitivities(between(0.6 + 1e-9), (0.0, 3.0), [name])
    assert found.velocity("a")[0] == pytest.approx(apart.velocity("a")[0], rel=1e-7)


def side_by_side(first: float, second: float) -> Scene:
    return Scene(
        Body("a", inertia=1.0),
        Contact("c1", "a", GROUND, DryFriction(1.0, 0.5), normal=first),
        Contact("c2", "a", GROUND, DryFriction(1.0, 0.5), normal=second, radius_a=2.0),
        Force("a", piecewise_linear([0.0, 4.0], [0.0, 8.0])),
    )


@pytest.mark.parametrize(("name", "expected"), [("c1.normal", -0.85), ("c1.law.mu_static", -0.5), ("c2.normal", -1.7)])
def test_equal_contacts_that_hold_one_motion_let_go_together(name: str, expected: float) -> None:
    """The levels N1 + 2 N2 are met by 2 t at t_0; then v' = 2 t - (N1 + 2 N2) / 2 up to the end at T.

    So t_0 = (mu_1 N1 + 2 mu_2 N2) / 2 = 1 and dv/dt_0 = -(2 t_0 - 1) = -1; besides, N1 brakes by 1/2 for T - t_0, and
    N2 by 1.
    """
    scene, stop = side_by_side(1.0, 0.5), 1.7
    found = sensitivities(scene, (0.0, stop), [name])
    assert len(found.result.events) == 2 and found.result.events[0].t == pytest.approx(1.0, rel=1e-12)
    assert found.velocity("a")[0] == pytest.approx(expected, rel=1e-9)
    assert not found.reasons


PULLED = Contact("c", "a", GROUND, DryFriction(1.0, 0.5), normal=1.0)
TWO = Body("a", inertia=1.0, velocity=1.0), Body("b", inertia=1.0, velocity=1.0)


@pytest.mark.parametrize(
    ("scene", "name", "why"),
    [
        # near by the levers of two rows that hold one motion contradict each other, and one of them slips
        (
            Scene(*TWO, *(Contact(n, "a", "b", DryFriction(0.5, 0.5), normal=1.0) for n in "ce"), Force("a", 0.3)),
            "c.radius_b",
            "contradict",
        ),
        (
            Scene(
                *TWO,
                Contact("c", "a", "b", DryFriction(0.5, 0.5), normal=1.0),
                Drive("d", velocity=1.0),
                *(Contact(f"on {n}", n, "d", DryFriction(0.5, 0.5), normal=5.0) for n in "ab"),
            ),
            "on a.radius_a",
            "contradict",
        ),
        # wagons that touch their coupling and roll equally fast: near by they part, or press
        (Scene(*TWO, Gap("g", "a", "b", lower=-1.0, upper=0.0, stiffness=20.0)), "a.velocity", "stays at a limit"),
        (Scene(*TWO, Gap("g", "a", "b", lower=-1.0, upper=0.0, stiffness=20.0)), "a.position", "stays at a limit"),
        # a load that comes exactly to the level of a held contact at a break, and stays there
        (Scene(Body("a", inertia=1.0), PULLED, Force("a", step(0.5, 0.0, 1.0))), "c.normal", "comes to its level"),
        (
            Scene(Body("a", inertia=1.0), PULLED, Force("a", piecewise_linear([0.0, 0.5, 1.0], [0.0, 1.0, 1.0]))),
            "forces[0].signal.values[2]",
            "comes to its level",
        ),
        # bodies that start in touch at a stop: near by they part to one side, and hit to the other
        (Scene(*TWO, Stop("s", "a", "b", upper=0.0, restitution=0.5)), "a.velocity", "starts closed"),
    ],
)
def test_what_is_at_a_border_and_stays_there_has_two_sides(scene: Scene, name: str, why: str) -> None:
    found = sensitivities(scene, (0.0, 1.5), [name])
    assert np.isnan(found.velocity("a")).all() and why in found.reasons[0]
    (parameter,) = named_parameters(scene, [name], "test")
    near = (simulate(parameter.set(scene, parameter.value + h), (0.0, 1.5)) for h in (-1e-5, 0.0, 1e-5))
    low, at, high = (
        np.array([*(r.velocity(b.name)[-1] for b in scene.bodies), *(r.force(c.name)[-1] for c in scene.rows)])
        for r in near
    )
    # differences to the two sides differ indeed
    assert np.abs((high - at) - (at - low)).max() > 0.1 * 1e-5


@pytest.mark.parametrize("name", ["m.position", "rub.normal"])
def test_a_contact_that_comes_to_rest_exactly_at_its_level_has_two_sides(name: str) -> None:
    """It turns at -0.25 after half a turn, where the spring pulls with mu N = 0.25: pulled farther it would go on."""
    scene = Scene(
        Body("m", inertia=1.0, position=0.75),
        Spring("m", GROUND, stiffness=1.0),
        Contact("rub", "m", GROUND, DryFriction(0.25, 0.25), normal=1.0),
    )
    found = sensitivities(scene, (0.0, 9.0), [name])
    before, after = found.position("m", [3.0, 9.0])[:, 0]
    # up to the turn x = 0.25 N + (x_0 - 0.25 N) cos t
    assert before == pytest.approx(math.cos(3.0) if name == "m.position" else 0.25 * (1 - math.cos(3.0)), rel=1e-9)
    assert math.isnan(after)
    assert "exactly at its level" in found.reasons[0]


@pytest.mark.parametrize("name", ["m.inertia", "springs[0].stiffness", "c.normal"])
def test_a_dead_band_that_is_passed_at_once(name: str) -> None:
    """The contact loses its last 0.02 m/s and goes on the other way; beside differences of exact runs."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Spring("m", GROUND, stiffness=4.0, damping=0.2),
        Contact("c", "m", GROUND, Karnopp(DryFriction(0.5, 0.4), velocity=0.02), normal=1.0),
        Force("m", sine(3.0, 0.5)),
    )
    found = sensitivities(scene, (0.0, 2.0), [name])
    assert [event.cause for event in found.result.events] == ["reversal"]
    (parameter,) = named_parameters(scene, [name], "test")
    near = (parameter.set(scene, parameter.value + h) for h in (-1e-5, 1e-5))
    low, high = (simulate(one, (0.0, 2.0)).position("m")[-1] for one in near)
    assert found.position("m")[0] == pytest.approx((high - low) / 2e-5, rel=1e-7)


def test_two_equal_stops_at_once_have_two_sides() -> None:
    """The larger restitution of both decides: there is no derivative by that of one of them."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0), *(Stop(n, "m", GROUND, upper=0.5, restitution=0.5) for n in "st")
    )
    found = sensitivities(scene, (0.0, 1.5), ["s.restitution"])
    assert math.isnan(found.velocity("m")[0]) and "impacts fall together" in found.reasons[0]


def overloaded(*contacts: Contact) -> Scene:
    return Scene(Body("a", inertia=1.0), Body("b", inertia=1.0), *contacts, Force("b", step(0.5, 0.0, 1.5)))


@pytest.mark.parametrize("name", ["c1.normal", "c2.normal", "c1.law.mu_static"])
def test_of_equal_contacts_in_a_row_that_a_jump_overloads_one_lets_go_alone_near_by(name: str) -> None:
    """Held, both carry 1.5. If the first one lets go, both bodies go together, else `b` alone: the motion jumps."""
    law = DryFriction(1.0, 0.5)
    scene = overloaded(Contact("c1", "a", GROUND, law, normal=1.0), Contact("c2", "b", "a", law, normal=1.0))
    found = sensitivities(scene, (0.0, 1.7), [name])
    assert found.velocity("b", 0.4)[0] == 0.0
    assert math.isnan(found.velocity("b")[0])
    assert "a jump of a load overloads 'c1' and 'c2' equally" in found.reasons[0]
    (parameter,) = named_parameters(scene, [name], "test")
    near = (parameter.set(scene, parameter.value + h) for h in (-1e-6, 1e-6))
    low, high = (simulate(one, (0.0, 1.7)).velocity("b")[-1] for one in near)
    assert abs(high - low) > 0.1


def test_equal_contacts_side_by_side_that_a_jump_overloads_let_go_together() -> None:
    """``v' = (1.5 - mu_c (N1 + N2)) / m`` from 0.5 s on, whichever lets go first; `mu_static` does not matter."""
    law = DryFriction(1.0, 0.5)
    scene = overloaded(*(Contact(name, "b", GROUND, law, normal=0.6) for name in ("c1", "c2")))
    found = sensitivities(scene, (0.0, 1.7), ["c1.normal", "c1.law.mu_static", "c1.law.mu_coulomb"])
    assert not found.reasons
    assert found.velocity("b").ravel() == pytest.approx([-0.5 * 1.2, 0.0, -0.6 * 1.2], rel=1e-9, abs=1e-9)


def braking_wagons(place: float, pressure: float = 2e4) -> Scene:
    """Two coupled wagons of 20 t brake from 3 m/s, far from the origin."""
    return Scene(
        Body("a", inertia=2e4, velocity=3.0, position=place),
        Body("b", inertia=2e4, velocity=3.0, position=place),
        Spring("a", "b", stiffness=1e7, damping=1e4),
        Contact("brake", "a", GROUND, DryFriction(0.4, 0.3), normal=sine(1.8e4, 0.7, offset=pressure)),
    )


@pytest.mark.parametrize("place", [0.0, 50.0, 1e3, -5e3])
def test_derivatives_by_a_pressure_do_not_depend_on_the_origin(place: float) -> None:
    """A coupler far from the origin carries no larger force: steps of the pressure stay small beside the pressure."""
    found = sensitivities(braking_wagons(place), (0.0, 30.0), ["brake.normal.offset"])
    step = 0.3
    later, sooner = (simulate(braking_wagons(place, 2e4 + h), (0.0, 30.0)).events[0].t for h in (step, -step))
    assert found.reasons == ()
    assert found.events[0, 0] == pytest.approx((later - sooner) / (2 * step), rel=1e-5)


def test_a_constant_pressure_far_from_the_origin_is_not_refused() -> None:
    """Both wagons stop after 3 m/s * 40 t / (0.3 N), but for the swing of the coupler."""
    wagons = [one for one in braking_wagons(1e3).elements if not isinstance(one, Contact)]
    scene = Scene(*wagons, Contact("brake", "a", GROUND, DryFriction(0.4, 0.3), normal=2e4))
    found = sensitivities(scene, (0.0, 40.0), ["brake.normal"])
    assert found.events[0, 0] == pytest.approx(-3.0 * 4e4 / (0.3 * 2e4**2), rel=1e-3)


@pytest.mark.parametrize("mass", [1.0, 1e6])
def test_a_set_point_is_no_force(mass: float) -> None:
    """With ``F = m tanh((x0 - x) / 0.05)`` the motion, and so its derivatives, do not depend on m."""

    def scene(shift: float = 0.0) -> Scene:
        apart = position("m") - (0.1 + shift)
        return Scene(
            Body("m", inertia=mass, velocity=0.3),
            Force("m", mass * feedback(lambda s: -math.tanh(s / 0.05), apart)),
            Damper("m", GROUND, damping=0.5 * mass),
        )

    name = "forces[0].signal.terms[0][0].arguments[0].signal"
    found = sensitivities(scene(), (0.0, 1.0), [name]).position("m")[0]
    up, down = (simulate(scene(h), (0.0, 1.0), rtol=1e-12, atol=1e-13).position("m")[-1] for h in (1e-5, -1e-5))
    # the number is added to the position: it is the set point with the other sign
    assert found == pytest.approx(-(up - down) / 2e-5, rel=1e-5)


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("speed", [0.0, 1e2, 1e3])
def test_derivatives_do_not_depend_on_the_speed_of_a_wagon(speed: float, given: bool) -> None:
    """A body slows down on a wagon by ``w = v0 exp(-c t)``; at ``w = s atanh(1 - mu)`` a push on a block lets it go.

    So ``dt / dv0 = 1 / (c v0)``, whatever the speed of the wagon.
    """
    c, v0, s = 0.5, 0.05, 0.02
    slope = {"derivatives": lambda w: [1 / s / math.cosh(w / s) ** 2]} if given else {}
    push = feedback(lambda w: math.tanh(w / s), velocity("m") - velocity("wagon"), **slope)
    scene = Scene(
        Drive("wagon", velocity=speed),
        Body("m", inertia=1.0, velocity=speed + v0),
        Body("k", inertia=1.0, velocity=speed),
        Damper("m", "wagon", damping=c),
        Force("k", 1.0 - push),
        Contact("c", "k", "wagon", DryFriction(0.5, 0.4), normal=1.0),
    )
    found = sensitivities(scene, (0.0, 6.0), ["m.velocity"])
    assert found.events[0, 0] == pytest.approx(1 / (c * v0), rel=1e-6)


@pytest.mark.parametrize("turned", [0.0, 1e2, 1e4])
def test_derivatives_do_not_depend_on_the_turns_of_a_motor(turned: float) -> None:
    """A cogging torque of 50 teeth, by a function without derivatives."""

    def scene(speed: float) -> Scene:
        torque = feedback(lambda q: -5.0 * math.sin(50.0 * (q - turned)), position("m"))
        return Scene(
            Body("m", inertia=1.0, position=turned + 0.01, velocity=speed),
            Force("m", torque),
            Damper("m", GROUND, damping=0.1),
        )

    found = sensitivities(scene(0.1), (0.0, 2.0), ["m.velocity"]).position("m")[0]

    # the same motion, x'' = -5 sin(50 x) - 0.1 x', and its derivative by the start by an integrator of its own
    def rates(t: float, y: np.ndarray) -> list[float]:
        x, v, dx, dv = y
        return [v, -5 * math.sin(50 * x) - 0.1 * v, dv, -250 * math.cos(50 * x) * dx - 0.1 * dv]

    told = solve_ivp(rates, (0.0, 2.0), [0.01, 0.1, 0.0, 1.0], method="DOP853", rtol=1e-11, atol=1e-13)
    assert found == pytest.approx(told.y[2, -1], rel=1e-5)


@pytest.mark.parametrize("mass, restitution", [(2.0, 0.5), (1.0, 0.0), (1.0, 1.0)])
def test_after_an_impact_that_brings_a_contact_to_rest_exactly_there_is_no_derivative(
    mass: float, restitution: float
) -> None:
    """With ``m1 = e m2`` the first body has velocity 0 after the impact; its load then drives it on.

    Near by, it turns back or goes on at once: friction has the one or the other direction.
    """
    friction = DryFriction(0.3, 0.2)

    def scene(restitution: float) -> Scene:
        return Scene(
            Body("a", inertia=1.0, velocity=2.0),
            Body("b", inertia=mass, position=0.5),
            Stop("bumper", "a", "b", upper=0.0, restitution=restitution),
            Contact("under a", "a", GROUND, friction, normal=9.81),
            Contact("under b", "b", GROUND, friction, normal=9.81 * mass),
            Force("a", 4.5),
        )

    found = sensitivities(scene(restitution), (0.0, 0.6), ["bumper.restitution"])
    stops = restitution * mass == 1.0
    assert np.isnan(found.position("a")).all() == stops
    assert len(found.reasons) == stops
    if stops:
        (reason,) = found.reasons
        assert "'under a' has relative velocity 0 after an impact and begins to slip" in reason


@pytest.mark.parametrize(("load", "exists"), [(1.9, True), (-1.9, True), (2.1, False), (-2.1, False), (2.9, False)])
def test_a_contact_that_holds_more_at_rest_has_no_derivative_off_rest(load: float, exists: bool) -> None:
    """Friction of 2 N in motion and 3 N at rest: a load beyond 2 N keeps a body going, however slow it starts."""

    def scene(velocity: float) -> Scene:
        law = DryFriction(0.3, 0.2)
        body = Body("box", inertia=1.0, velocity=velocity)
        return Scene(body, Contact("pad", "box", GROUND, law, normal=10.0), Force("box", load))

    found = sensitivities(scene(0.0), (0.0, 2.0), ["box.velocity", "box.inertia"])
    near = [simulate(scene(velocity), (0.0, 2.0)).position("box")[-1] for velocity in (1e-6, -1e-6)]
    if exists:
        assert np.abs(near).max() <= 1e-9
        assert (found.position("box") == 0).all() and not found.reasons
    else:
        assert np.abs(near).max() > 0.1
        assert np.isnan(found.position("box")[0]) and found.position("box")[1] == 0
        assert len(found.reasons) == 1 and "'pad' starts at rest, and near by it slips on" in found.reasons[0]


@pytest.mark.parametrize(("load", "exists"), [(1.5, True), (2.5, False)])
def test_a_contact_that_an_impact_brings_to_rest_and_that_holds_more_at_rest(load: float, exists: bool) -> None:
    """Equal masses exchange their velocities. If the second one is a little lighter, the first one creeps on.

    Friction of 2 N in motion stops it from there on only if the load is less.
    """
    scene = Scene(
        Body("first", inertia=1.0, velocity=2.0),
        Body("second", inertia=1.0, position=0.5),
        Force("first", load),
        Contact("pad", "first", GROUND, DryFriction(0.3, 0.2), normal=10.0),
        Stop("bumper", "first", "second", upper=0.0, restitution=1.0),
    )
    found = sensitivities(scene, (0.0, 1.0), ["second.inertia"])
    assert found.result.mode("pad")[-1] == Mode.STUCK
    assert np.isnan(found.position("first")[0]) != exists
    if not exists:
        assert "'pad' has relative velocity 0 after an impact, and near by it slips on" in found.reasons[0]


def test_two_contacts_that_share_a_load_slip_on_together() -> None:
    """Friction of 1 N each in motion, 1.5 N each at rest, and a load of 2.5 N: no contact alone would slip."""
    pads = (Contact(name, "box", GROUND, DryFriction(0.3, 0.2), normal=5.0) for name in ("left", "right"))
    scene = Scene(Body("box", inertia=1.0), Force("box", 2.5), *pads)
    found = sensitivities(scene, (0.0, 1.0), ["box.velocity"])
    assert np.isnan(found.position("box")).all()
    assert "near by it slips on" in found.reasons[0]
