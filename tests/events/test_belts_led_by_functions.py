"""A belt whose velocity is a function takes bodies along: its acceleration is a difference, its events are exact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy

from stickslip import Body, Contact, Drive, DryFriction, Mode, Scene, piecewise_linear, signal, simulate

SOLVERS: list[dict[str, Any]] = [
    {},
    {"method": "Adams"},
    {"method": "BDF", "formulation": "merged"},
    {"formulation": "multiplier"},
]
LAW = DryFriction(1.0, 1.0)


@pytest.mark.parametrize("options", SOLVERS, ids=str)
@pytest.mark.parametrize("contacts", [1, 2])
@pytest.mark.parametrize("scale", [0.3, 1.0, 5.0])
def test_a_belt_whose_acceleration_rises_from_the_level(scale: float, contacts: int, options: dict[str, Any]) -> None:
    """The belt runs with ``s sinh t``: ``s cosh t`` is beyond what the level gives, s, from the first instant."""
    scene = Scene(
        Body("box", inertia=1.0),
        Drive("belt", velocity=signal(lambda t: scale * math.sinh(t))),
        *[Contact(f"pad{i}", "belt", "box", LAW, normal=scale / contacts) for i in range(contacts)],
    )
    result = simulate(scene, (0.0, 1.0), **options)
    np.testing.assert_allclose(result.velocity("box"), scale * result.t, rtol=0, atol=1e-9 * scale)
    assert not result.events and result.mode("pad0")[-1] == Mode.FORWARD


@pytest.mark.parametrize("options", SOLVERS, ids=str)
def test_two_contacts_let_go_at_the_sum_of_their_levels(options: dict[str, Any]) -> None:
    """The belt runs with ``sin 2 t``; the pads hold 2 kg with 2 N and |2 - 2 t| N: they let go backward together."""
    falling = piecewise_linear([0, 1, 2], [2, 0, 2])
    scene = Scene(
        Body("box", inertia=2.0, velocity=math.sin(1.6)),
        Drive("belt", velocity=signal(lambda t: math.sin(2 * t))),
        Contact("first", "belt", "box", LAW, normal=falling),
        Contact("second", "belt", "box", LAW, normal=2.0),
    )
    result = simulate(scene, (0.8, 1.4), **options)
    expected = scipy.optimize.brentq(lambda t: 4 * math.cos(2 * t) + 2 * t, 1.0, 1.2, xtol=1e-14)
    assert [event.after for event in result.events] == [Mode.BACKWARD] * 2
    np.testing.assert_allclose([event.t for event in result.events], expected, rtol=0, atol=1e-9)
