"""Loads at late times: a time of 1e9 s is rounded to 1e-7 s, but not what happens from one event to the next."""

from __future__ import annotations

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, simulate, sine, triangle

LAW = DryFriction(0.2, 0.1, dwell=0.1)


def clutch(start: float) -> Scene:
    """Two flywheels in contact, of which a brake stops one in two pulses."""
    pulses = triangle(start + 0.05, start + 0.1, start + 0.15, slope=3000) + triangle(
        start + 0.4, start + 0.5, start + 0.6, slope=3000
    )
    return Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=10.0, velocity=1.01),
        Contact("interface", "a", "b", LAW, normal=100.0),
        Contact("brake", "a", GROUND, LAW, normal=pulses),
    )


def held(start: float) -> Scene:
    """A body that 4 N at 5 Hz push to and fro, with a level of 8 N; `start` is a number of whole periods."""
    return Scene(
        Body("m", inertia=1.0),
        Contact("brake", "m", GROUND, LAW, normal=40.0),
        Force("m", sine(4.0, 5.0)),
    )


@pytest.mark.parametrize("start", [1e6, 1e9])
@pytest.mark.parametrize("options", [{"formulation": "multiplier"}, {"method": "BDF"}, {}])
@pytest.mark.parametrize("make, span, count", [(clutch, 2.0, 5), (held, 1.0, 0)])
def test_a_scene_moved_in_time_takes_as_many_steps(make, span, count, options, start) -> None:
    early = simulate(make(0.0), (0.0, span), **options)
    late = simulate(make(start), (start, start + span), **options)
    assert len(early.events) == len(late.events) == count
    assert late.stats["steps"] == pytest.approx(early.stats["steps"], rel=0.05, abs=2)
    # times of breaks are rounded
    times = [event.t for event in early.events]
    np.testing.assert_allclose([event.t - start for event in late.events], times, atol=4e-16 * start, rtol=1e-5)
    for body in early.scene.bodies:
        one, other = (run.velocity(body.name)[-1] for run in (early, late))
        assert other == pytest.approx(one, abs=1e-5)


@pytest.mark.parametrize("options", [{"formulation": "multiplier"}, {"method": "BDF"}, {}])
def test_a_short_push_after_a_long_rest_moves_a_block(options) -> None:
    """An impulse of 3 N s after 1e6 s gives 3 m/s to 1 kg, which friction of 0.26 N stops after ``v^2 / (2 a)``."""
    late = 1e6
    scene = Scene(
        Body("m", inertia=1.0),
        Contact("floor", "m", GROUND, DryFriction(0.3, 0.2), normal=1.3),
        Force("m", triangle(late, late + 0.01, late + 0.02, slope=3e4)),
    )
    result = simulate(scene, (0.0, late + 100.0), **options)
    assert result.position("m")[-1] == pytest.approx(3.0**2 / (2 * 0.26), rel=5e-3)
    assert [event.contact for event in result.events] == ["floor", "floor"]
