"""What ends a motion: which row is at its limit then."""

from __future__ import annotations

from typing import Any

import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, piecewise_linear, simulate


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_the_contact_that_is_at_its_level_at_the_end_lets_go(options: dict[str, Any]) -> None:
    """Both hold 3 N. One is loaded with 1 N/s, the other with 2.5 N and 0.01 N/s: that one is nearer before."""
    law = DryFriction(0.3, 0.2)
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Contact("fast", "a", GROUND, law, normal=10.0),
        Contact("near", "b", GROUND, law, normal=10.0),
        Force("a", piecewise_linear([0.0, 10.0], [0.0, 10.0])),
        Force("b", piecewise_linear([0.0, 10.0], [2.5, 2.6])),
    )
    (event,) = simulate(scene, (0.0, 5.0), **options).events
    assert (event.contact, event.cause) == ("fast", "breakaway")
    assert event.t == pytest.approx(3.0, abs=1e-9)
