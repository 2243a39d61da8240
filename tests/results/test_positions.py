"""Positions that no spring makes states: integrals of velocities over steps, events, drives and whatever is held."""

from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gear,
    Result,
    Scene,
    piecewise_linear,
    signal,
    simulate,
    sine,
    triangle,
)

ENGINES: list[dict[str, Any]] = [
    {},
    {"method": "BDF", "rtol": 1e-10, "atol": 1e-12},
    {"method": "Adams", "rtol": 1e-10, "atol": 1e-12},
    {"formulation": "multiplier", "rtol": 1e-9, "atol": 1e-11},
]


@pytest.mark.parametrize("options", ENGINES)
def test_a_body_that_slips_and_is_then_carried_by_a_swinging_drive(options: dict[str, Any]) -> None:
    # the drive needs at most 0.2 * 2 pi * 0.25 = 0.314 m/s2, below mu_s N/m = 6 m/s2: once stuck, it rides along;
    # u = 0.2 sin(pi t/2); before that the block brakes with 4 m/s2 from 1 m/s: w = 1 - 4 t - u(t) = 0
    scene = Scene(
        Body("b", inertia=1.0, velocity=1.0, position=2.0),
        Drive("d", velocity=sine(0.2, 0.25), position=-1.0),
        Contact("c", "b", "d", DryFriction(0.6, 0.4), normal=10.0),
    )
    t = np.linspace(0.0, 3.0, 61)
    result = simulate(scene, (0.0, 3.0), t_eval=t, **options)
    (event,) = result.events
    s = event.t
    assert 1 - 4 * s - 0.2 * np.sin(0.5 * np.pi * s) == pytest.approx(0.0, abs=1e-9)

    def drive(t: Any) -> Any:
        return -1.0 + 0.4 / np.pi * (1 - np.cos(0.5 * np.pi * t))

    def block(t: Any) -> Any:
        slid = 2.0 + s - 2 * s**2
        return np.where(t < s, 2.0 + t - 2 * t**2, slid + drive(t) - drive(s))

    np.testing.assert_allclose(result.position("d"), drive(t), rtol=0, atol=1e-13)
    near = 1e-8 if options else 1e-13
    np.testing.assert_allclose(result.position("b"), block(t), rtol=0, atol=near)
    # in whatever order the times come, and from wherever on
    some = np.array([2.0, 0.1, 1.5, s, 1.5])
    np.testing.assert_allclose(result.sample(some).position("b"), block(some), rtol=0, atol=near)
    np.testing.assert_allclose(result.sample(some[:1]).position("b"), block(some[:1]), rtol=0, atol=near)


def test_bodies_on_a_gear_go_ways_in_its_ratio() -> None:
    # b turns half as fast as a: 2 kg m2 + 4 kg m2/4 = 3 kg m2 under 6 N m for 1 s, then none
    scene = Scene(
        Body("a", inertia=2.0),
        Body("b", inertia=4.0, position=1.0),
        Gear("gear", "a", "b", ratio=2.0),
        Force("a", piecewise_linear([1.0, 1.0], [6.0, 0.0])),
    )
    result = simulate(scene, (0.0, 2.0), t_eval=[0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(result.position("a"), [0.0, 0.25, 1.0, 3.0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(result.position("b"), [1.0, 1.125, 1.5, 2.5], rtol=0, atol=1e-14)


def test_a_drive_whose_velocity_is_a_function_a_triangle_or_jumps() -> None:
    scene = Scene(
        Body("b", inertia=1.0),
        Drive("function", velocity=signal(lambda t: float(np.exp(-t)))),
        Drive("triangle", velocity=triangle(0.5, 1.0, 2.0, slope=6.0)),
        Drive("jumps", velocity=piecewise_linear([0.0, 1.0, 1.0, 2.0], [1.0, 1.0, -1.0, -1.0]), position=5.0),
        Contact("c", "b", GROUND, DryFriction(0.2, 0.1), normal=1.0),
    )
    t = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    result = simulate(scene, (0.0, 2.0), t_eval=t)
    np.testing.assert_allclose(result.position("function"), 1 - np.exp(-t), rtol=0, atol=1e-12)
    np.testing.assert_allclose(result.position("triangle"), [0.0, 0.0, 0.75, 0.75 + 1.125, 2.25], rtol=0, atol=1e-14)
    np.testing.assert_allclose(result.position("jumps"), [5.0, 5.5, 6.0, 5.5, 5.0], rtol=0, atol=1e-14)


def _by_quadrature(result: Result, body: str) -> Any:
    """The integral of velocities read densely, by Simpson's rule on 100,000 points."""
    fine = result.sample(100_001)
    v, h = fine.velocity(body), fine.t[1] - fine.t[0]
    return fine.t[::2], np.concatenate([[0.0], np.cumsum(h / 3 * (v[:-1:2] + 4 * v[1::2] + v[2::2]))])


@pytest.mark.parametrize("options", ENGINES)
def test_ways_are_the_integrals_of_the_velocities_that_are_read(options: dict[str, Any]) -> None:
    law = DryFriction(0.5, 0.3, dwell=0.1)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=2.0, velocity=-0.5),
        Body("c", inertia=0.5),
        Drive("d", velocity=sine(0.4, 0.7)),
        Contact("ab", "a", "b", law, normal=6.0),
        Contact("bd", "b", "d", law, normal=triangle(0.3, 1.0, 2.0, slope=30.0)),
        Contact("cb", "c", "b", law, normal=3.0),
        Force("c", sine(3.0, 1.1)),
    )
    result = simulate(scene, (0.0, 3.0), **options)
    assert len(result.events) > 5
    for body in ("a", "b", "c", "d"):
        t, x = _by_quadrature(result, body)
        # velocities have kinks at the events: a step of Simpson's rule across one is off by less than 1e-8 m
        np.testing.assert_allclose(result.sample(t[::2500]).position(body), x[::2500], rtol=0, atol=1e-8)
