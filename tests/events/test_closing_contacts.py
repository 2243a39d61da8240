"""A sine presses a contact again where it crosses 0: roundoff there may not keep the contact open."""

import math

import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Scene, simulate, sine


@pytest.mark.parametrize("method", ["auto", "BDF", "RK4"])
@pytest.mark.parametrize("periods", [0, 1, 2, 5])
def test_a_contact_pressed_by_a_sine_closes_in_every_period(method: str, periods: int) -> None:
    """v falls by 2/pi in every first half of a period, and comes to 0 in that after `periods` whole ones.

    There v = 1 - (1 - cos(2 pi t)) / pi if it began with 1 and t counts from the period's start.
    """
    speed = 0.5 + 2 / math.pi * periods
    scene = Scene(
        Body("a", inertia=1.0, velocity=speed),
        Contact("c", "a", GROUND, DryFriction(0.3, 0.2), normal=sine(10.0, 1.0)),
    )
    options = {"step": 1e-3} if method == "RK4" else {}
    result = simulate(scene, (0.0, periods + 1.0), method=method, **options)
    (event,) = (e for e in result.events if e.cause != "open")
    exact = periods + math.acos(1 - 0.5 * math.pi) / (2 * math.pi)
    assert event.t == pytest.approx(exact, abs={"auto": 1e-13, "BDF": 1e-6, "RK4": 2e-3}[method])
    assert result.velocity("a")[-1] == 0.0
