"""A force that rises to the breakaway level exactly, at a break of the load, and stays there: nothing lets go."""

import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Force, Mode, Scene, piecewise_linear, simulate


@pytest.mark.parametrize("way", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_a_ramp_that_ends_at_the_level_makes_no_event(way: dict[str, str]) -> None:
    ramp = piecewise_linear([0.0, 1.0, 2.0], [0.0, 5.0, 5.0])
    contact = Contact("c", "a", GROUND, DryFriction(0.5, 0.5), normal=10.0)
    result = simulate(Scene(Body("a", inertia=1.0), contact, Force("a", ramp)), (0.0, 2.0), **way)
    assert not result.events
    assert result.mode("c")[-1] == Mode.STUCK
    assert result.force("c")[-1] == pytest.approx(5.0)
