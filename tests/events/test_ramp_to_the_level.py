"""A force that rises to the breakaway level exactly and stays there, or goes through it beside a velocity of 0."""

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Force, Mode, Scene, piecewise_linear, simulate
from stickslip.equations.system import System
from stickslip.events.settle import settle
from stickslip.events.situation import Situation, Uncertainty


@pytest.mark.parametrize("way", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_a_ramp_that_ends_at_the_level_makes_no_event(way: dict[str, str]) -> None:
    ramp = piecewise_linear([0.0, 1.0, 2.0], [0.0, 5.0, 5.0])
    contact = Contact("c", "a", GROUND, DryFriction(0.5, 0.5), normal=10.0)
    result = simulate(Scene(Body("a", inertia=1.0), contact, Force("a", ramp)), (0.0, 2.0), **way)
    assert not result.events
    assert result.mode("c")[-1] == Mode.STUCK
    assert result.force("c")[-1] == pytest.approx(5.0)


@pytest.mark.parametrize("short", np.geomspace(1e-8, 1e-5, 40).tolist())
def test_a_velocity_that_touches_0_with_nearly_its_level(short: float) -> None:
    """The force to hold it is less than its level by the part `short`: it slips on, or sticks if that is enough."""
    load = piecewise_linear([0.0, 1.0], [0.1 * (1 - short), 1.1])
    scene = Scene(
        Body("b", inertia=1.0), Contact("c", "b", GROUND, DryFriction(0.1, 0.1), normal=1.0), Force("b", load)
    )
    system = System(scene)
    one, yes = np.ones(1, dtype=np.int8), np.ones(1, dtype=bool)
    touching = Situation(0.0, system.at_start(), one, np.zeros(1), yes, yes, touched=0)
    found = settle(
        system, system.loads(0.0, 1.0).after(0.0), touching, Uncertainty(np.full(1, 1e-9), 1e-12, np.full(1, 1e-7))
    )
    assert found.labels[0] == (0 if short > 2e-6 else 1)
