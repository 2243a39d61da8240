"""A light body on a stiff damper: the terms of its force are large, and breakaway is found all the same."""

from __future__ import annotations

import math
from typing import Any

import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Scene,
    Spring,
    piecewise_linear,
    simulate,
)

LAW = DryFriction(0.35, 0.2)


def scene(rate: float) -> Scene:
    """A block on a belt; the light body's velocity approaches the block's with `rate` in 1/s."""
    return Scene(
        Drive("belt", velocity=0.3),
        Body("block", inertia=1.0, velocity=0.3, position=0.5),
        Body("light", inertia=0.1, velocity=0.3, position=0.5),
        Contact("c", "block", "belt", LAW, normal=5.0),
        Spring("block", GROUND, stiffness=4.0, damping=0.05),
        Spring("light", GROUND, stiffness=0.5),
        Damper("light", "block", damping=0.1 * rate),
    )


def rigid() -> Scene:
    """The same with both bodies in one: the limit of a stiff damper."""
    return Scene(
        Drive("belt", velocity=0.3),
        Body("block", inertia=1.1, velocity=0.3, position=0.5),
        Contact("c", "block", "belt", LAW, normal=5.0),
        Spring("block", GROUND, stiffness=4.5, damping=0.05),
    )


@pytest.mark.parametrize("rate", [3.3e4, 5e4, 7.5e4, 1.1e5])
def test_a_stiff_damper_is_nearly_a_rigid_joint(rate: float) -> None:
    exact = simulate(rigid(), (0.0, 10.0)).events
    found = simulate(scene(rate), (0.0, 10.0)).events
    assert [(e.before, e.after, e.cause) for e in found] == [(e.before, e.after, e.cause) for e in exact]
    assert [e.t for e in found] == pytest.approx([e.t for e in exact], abs=5 / rate)


@pytest.mark.parametrize(
    "options", [{"method": "series"}, {"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}]
)
def test_the_level_has_hardly_risen_beside_large_forces_that_cancel(options: dict[str, Any]) -> None:
    """At 10 m a spring of 1000 N/m is not stretched. The load is t, the level 0.2 - 0.1 exp(-t / 100).

    They meet at 0.1001 s. From there the block moves off with 1e-4 m/s², which the damper soon cancels: v'' < 0.
    """
    far = Scene(
        Body("b", inertia=1.0, position=10.0),
        Spring("b", GROUND, stiffness=1e3, damping=3e4, rest=10.0),
        Contact("c", "b", GROUND, DryFriction(0.2, 0.1, dwell=100.0), normal=1.0),
        Force("b", piecewise_linear([0.0, 1.0], [0.0, 1.0])),
    )
    result = simulate(far, (0.0, 0.101), **options)
    (event,) = result.events
    assert (event.before, event.after, event.cause) == (0, 1, "breakaway")
    assert event.t == pytest.approx(0.2 - 0.1 * math.exp(-event.t / 100), abs=1e-11)  # roundoff of 1e4 N
