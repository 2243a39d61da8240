"""Guards that dip below 0 and come back within one step of a solver."""

from __future__ import annotations

import math
from typing import Any

import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Mode, Scene, position, simulate, table

WAYS: list[dict[str, Any]] = [{}, {"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("short", [0.1, 0.03, 3e-3])
def test_a_body_comes_to_rest_in_the_step_in_which_its_brake_lets_go(
    way: dict[str, Any], rtol: float, short: float
) -> None:
    """N = 9 (1 - t), v = v0 - mu (9 t - 4.5 t^2), v0 = 4.5 mu - short: at rest from 1 - (short / 4.5 mu)^(1/2) on.

    Without sticking the velocity would dip to -short at 1 s, where N ends. A solver may pass the dip in one step.
    """
    mu = 0.3
    scene = Scene(
        Body("clock", inertia=1.0, velocity=1.0),
        Body("m", inertia=1.0, velocity=4.5 * mu - short),
        Contact("c", "m", GROUND, DryFriction(mu, mu), normal=table(position("clock"), [0.0, 1.0], [9.0, 0.0])),
    )
    result = simulate(scene, (0.0, 2.0), rtol=rtol, **way)
    (event,) = result.events
    assert (event.before, event.after) == (Mode.FORWARD, Mode.STUCK)
    assert event.t == pytest.approx(1 - math.sqrt(short / (4.5 * mu)), abs=max(1e2 * rtol / math.sqrt(short), 1e-12))
    assert abs(result.velocity("m")[-1]) <= 1e2 * rtol
    assert result.mode("c")[-1] == Mode.STUCK
