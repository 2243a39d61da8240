"""Tolerances of positions far from 0 may not hide velocities beside stiff springs."""

from __future__ import annotations

import math
from typing import Any

import pytest
from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Scene,
    Spring,
    feedback,
    position,
    simulate,
)

SPEED, STIFFNESS, WAVE = 1e-7, 1e6, 1e-4


def friction(x: float) -> float:
    """Return 0.1 times a normal force that varies with the place."""
    return 2.0 + 0.6 * math.sin(2.0 * math.pi * x / WAVE)


def slow_guide() -> Scene:
    """Return a slider that a stiff spring leads over 0.2 mm in 2000 s; it breaks away first."""
    normal = feedback(lambda x: 10.0 * friction(x), position("slider"))
    return Scene(
        Body("slider", inertia=1.0, velocity=SPEED),
        Drive("motor", velocity=SPEED),
        Spring("slider", "motor", stiffness=STIFFNESS),
        Damper("slider", "motor", damping=200.0),
        Contact(
            "guide",
            "slider",
            GROUND,
            DryFriction(0.1, 0.1, kinetic=lambda w: 0.1 + 0.05 * w / (w + 1e-3)),
            normal=normal,
        ),
    )


@pytest.mark.parametrize("options", [{}, {"formulation": "merged"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("rtol", [1e-6, 1e-7, 1e-8, 1e-9])
def test_a_slow_motion_far_from_0_beside_a_stiff_spring(rtol: float, options: dict[str, Any]) -> None:
    """Inertia plays no part: the spring carries the friction. The solver took up to 300,000 steps."""
    stop = 2.0 * WAVE / SPEED
    result = simulate(slow_guide(), (0.0, stop), rtol=rtol, **options)

    def excess(x: float) -> float:
        return STIFFNESS * (SPEED * stop - x) - friction(x)

    # the damper carries 1e-5 of the friction, and the speed adds 5e-5 of it
    assert result.position("slider")[-1] == pytest.approx(brentq(excess, 0.0, 1.0, xtol=1e-18), abs=2e-10)
    assert result.stats["steps"] < 6000


def test_tolerances_grow_with_the_roundoff_of_a_long_way() -> None:
    """Over 60 waves a solver that keeps the absolute tolerances of its start takes 1.6 times as many steps."""
    result = simulate(slow_guide(), (0.0, 60.0 * WAVE / SPEED))
    assert result.stats["steps"] < 22_000
