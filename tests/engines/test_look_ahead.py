"""Events in quick succession between the points of a solver: it computes little beyond them in vain."""

from __future__ import annotations

import pytest

from stickslip import GROUND, Body, Contact, Damper, Drive, DryFriction, Scene, Spring, simulate, sine


@pytest.mark.slow
@pytest.mark.parametrize("formulation", ["contact-force", "multiplier"])
def test_a_velocity_that_touches_0_in_every_period(formulation: str) -> None:
    """Once loose, the body comes nearly to rest 700 times a second: the solver must not go to the end each time."""
    scene = Scene(
        Body("a", inertia=0.04),
        Drive("hand", velocity=sine(8.5, 0.07)),
        Spring("a", "hand", stiffness=7.8e5),
        Damper("a", GROUND, damping=0.01),
        Contact("floor", "a", GROUND, DryFriction(0.8, 0.5, dwell=1.2), normal=1.25e6),
    )
    steps = {}
    for stop in (0.88, 0.92):
        stats = simulate(scene, (0.0, stop), formulation=formulation, method="BDF", rtol=1e-6, atol=1e-8).stats
        steps[stop] = stats["steps"]
    # 28 periods of 1/700 s lie between the two ends
    assert stats["restarts"] > 40
    assert steps[0.92] - steps[0.88] < 28 * 500
