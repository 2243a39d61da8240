"""Velocities that come to 0 in a finite time without passing through it: a solver would creep there for ever."""

from __future__ import annotations

import math
from typing import Any

import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Scene, simulate

WAYS = ({"method": "BDF"}, {"method": "Adams"}, {"formulation": "merged"}, {"formulation": "multiplier"})


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("stop", [2.1, 1e3])
def test_a_damper_of_the_root_of_the_speed(way: dict[str, Any], stop: float) -> None:
    """``v' = -sqrt(v)`` from 1: ``v = (1 - t / 2)^2`` until 2 s, then 0; the way is 2/3 m."""
    root = DryFriction(0.0, 0.0, kinetic=math.sqrt)
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Contact("c", "m", GROUND, root, normal=1.0))
    result = simulate(scene, (0.0, stop), velocity_margin=1e-8, **way)
    (event,) = result.events
    assert event.cause == "relaxation"
    # it sticks where v = 1e-8, the margin: 2 sqrt(1e-8) s before 2 s
    assert event.t == pytest.approx(2.0 - 2e-4, abs=1e-5)
    assert result.velocity("m")[-1] == 0.0
    assert result.position("m")[-1] == pytest.approx(2 / 3, abs=1e-6)
    assert result.stats["steps"] < 10_000
