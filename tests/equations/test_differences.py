"""Derivatives of functions whose arguments are small, or bend them fast, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy

from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Scene,
    Spring,
    feedback,
    output,
    signal,
    simulate,
    velocity,
)
from stickslip.equations.loads.reader import differences


@pytest.mark.parametrize(
    ("function", "slope", "x"),
    [
        # steps of 1e-8 are too long where a function is a logarithm, as the friction of faults is
        (lambda v: 0.6 + 0.01 * math.asinh(v / 1e-12), lambda v: 0.01 / math.hypot(v, 1e-12), 2e-11),
        (lambda v: 0.6 + 0.01 * math.asinh(v / 1e-12), lambda v: 0.01 / math.hypot(v, 1e-12), -3e-9),
        (math.sqrt, lambda v: 0.5 / math.sqrt(v), 1e-14),
        # and steps in proportion to the argument are lost in roundoff here
        (lambda v: 5.0 + v, lambda v: 1.0, 1e-7),
        (lambda v: 5.0 + math.sin(v), lambda v: 1.0, 1e-13),
        (lambda v: math.cos(v) - 1.0, lambda v: -1e-4, 1e-4),
        (lambda v: 3.0 * v, lambda v: 3.0, 0.0),
        (lambda v: 3.0 * v, lambda v: 3.0, 5e-324),
        (lambda v: v * v, lambda v: 4.0, 2.0),
    ],
)
def test_a_step_fits_the_argument(
    function: Callable[[float], float], slope: Callable[[float], float], x: float
) -> None:
    found = differences(lambda a: np.array([function(a[0])]), np.array([x]))
    assert found[0, 0] == pytest.approx(slope(x), rel=1e-4)


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-5, 1e-6, 2e-7, 1e-8, 1e-12])
def test_the_unit_of_an_argument_does_not_matter(size: float) -> None:
    """``tanh(x / s)`` at 0.7 s has the slope ``1 / (s cosh(0.7)^2)``."""
    found = differences(lambda a: np.array([math.tanh(a[0] / size)]), np.array([0.7 * size]))
    assert found[0, 0] * size == pytest.approx(1 / math.cosh(0.7) ** 2, rel=1e-6)


@pytest.mark.parametrize("turned", [0.0, 1e2, 1e4, 1e6])
def test_a_function_may_bend_within_a_small_part_of_its_argument(turned: float) -> None:
    """``sin(50 (x - X))`` at ``X + 0.01`` has the slope ``50 cos(0.5)``, however far a motor has turned."""
    x = turned + 0.01
    found = differences(lambda a: np.array([math.sin(50.0 * (a[0] - turned))]), np.array([x]))
    assert found[0, 0] == pytest.approx(50.0 * math.cos(50.0 * (x - turned)), rel=1e-5)


@pytest.mark.parametrize("frequency", [0.1, 2e2, 2e4, 3.3e5])
def test_a_function_of_time_may_be_fast(frequency: float) -> None:
    """The slope of ``sin(2 pi f t)`` is ``2 pi f cos(2 pi f t)``; no period is told."""
    turn = 2 * math.pi * frequency
    load = signal(lambda t: math.sin(turn * t))
    for part in (0.0, 0.1, 0.24, 0.6):
        assert load.slope(part / frequency) / turn == pytest.approx(math.cos(2 * math.pi * part), abs=1e-5)


def test_a_fault_with_rate_and_state_slips_in_events() -> None:
    # Dieterich and Ruina with the ageing law, half as stiff as critical: mu = a asinh(v / (2 V0) exp(...)); velocities
    # from 2e-11 to 1e-2 m/s. Held against LSODA on the same equations
    a, b, length, mu0, rate, pressure = 0.01, 0.015, 1e-5, 0.6, 1e-6, 5e6
    stiffness = 0.5 * (b - a) * pressure / length
    mass = 1e-2 * stiffness / (2 * math.pi) ** 2

    def friction(v: float, theta: float) -> float:
        return -pressure * a * math.asinh(v / (2 * rate) * math.exp((mu0 + b * math.log(rate * theta / length)) / a))

    start = friction(rate, length / rate) / stiffness
    age = 0.3 * length / rate
    scene = Scene(
        Body("block", inertia=mass, velocity=rate, position=start),
        Drive("plate", velocity=rate),
        Spring("block", "plate", stiffness=stiffness),
        Block(
            "age",
            inputs=[velocity("block")],
            states=[age],
            derivative=lambda t, x, u: [1 - u[0] * x[0] / length],
        ),
        Force("block", feedback(friction, velocity("block"), output("age"))),
    )
    result = simulate(scene, (0.0, 400.0))
    assert result.velocity("block").max() > 5e-3

    def rates(t: float, y: np.ndarray) -> list[float]:
        x, v, theta = y
        force = stiffness * (rate * t - x) + friction(v, theta)
        return [v, force / mass, 1 - v * theta / length]

    told = scipy.integrate.solve_ivp(
        rates, (0.0, 400.0), [start, rate, age], method="LSODA", rtol=1e-9, atol=[1e-15, 1e-15, 1e-9]
    )
    assert result.position("block")[-1] == pytest.approx(told.y[0, -1], abs=1e-8)
    assert result.velocity("block")[-1] == pytest.approx(told.y[1, -1], rel=1e-3)


@pytest.mark.slow
def test_earthquakes_recur_where_steps_are_below_roundoff_of_the_time() -> None:
    # where the block stops, its velocity bends within 1e-14 s: at 1.8e4 s a solver that counts time from 0 cannot
    # tell such steps apart. All cycles are alike
    rate, slip, pressure, mass = 1e-6, 1e-5, 5e6, 1e3

    def friction(w: float, age: float) -> float:
        return pressure * (0.6 + 0.010 * math.log(abs(w) / rate) + 0.015 * math.log(rate * age / slip))

    scene = Scene(
        Body("fault", inertia=mass, velocity=1.1 * rate),
        Drive("plate", velocity=rate),
        Spring("fault", "plate", stiffness=0.5 * 0.005 * pressure / slip),
        Force("fault", pressure * 0.6),
        Block(
            "age",
            inputs=[velocity("fault")],
            states=[1.3 * slip / rate],
            derivative=lambda t, x, u: [1.0 - abs(u[0]) * x[0] / slip],
        ),
        Contact(
            "rock",
            "fault",
            GROUND,
            DryFriction(1.0, 1.0),
            normal=feedback(friction, velocity("fault"), output("age")),
        ),
    )
    result = simulate(scene, (14000.0, 22000.0), atol=1e-16, rtol=1e-9)
    speed = result.velocity("fault")
    quakes = result.t[1:][(speed[:-1] < 1e-3) & (speed[1:] >= 1e-3)]
    assert quakes.size == 11
    np.testing.assert_allclose(np.diff(quakes)[6:], 748.997, atol=2e-3)
