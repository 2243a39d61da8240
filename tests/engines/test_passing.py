"""A velocity has passed 0 where it goes on beyond the solver's errors; the event is then where it was 0."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from stickslip import GROUND, Body, Contact, DryFriction, Force, Scene, simulate, sine

ENGINES: list[dict[str, Any]] = [
    {"method": "BDF"},
    {"method": "Adams"},
    {"method": "Adams", "formulation": "merged"},
    {"formulation": "multiplier"},
    {"method": "series"},
]
TOLERANCES = [1e-5, 1e-8, 1e-10]


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("options", ENGINES)
def test_a_sine_moves_a_body_from_rest_and_back_again_and_again(options: dict[str, Any], rtol: float) -> None:
    """Of v = 0.3/pi (1 - cos(2 pi t)) each minimum touches 0: the open contact never turns round."""
    scene = Scene(
        Body("b", inertia=2.0),
        Contact("open", "b", GROUND, DryFriction(0.3, 0.2), normal=0.0),
        Force("b", sine(1.2, 1.0)),
    )
    result = simulate(scene, (0.0, 7.5), rtol=rtol, atol=1e-2 * rtol, **options)
    assert result.events == []
    assert set(result.mode("open")) == {1}
    late = result.sample(301)
    exact = 0.3 / math.pi * (1 - np.cos(2 * math.pi * late.t))
    np.testing.assert_allclose(late.velocity("b"), exact, rtol=0, atol=1e-12 + 30 * rtol)


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("options", ENGINES)
def test_nor_does_a_freewheel_stick_where_it_touches_rest(options: dict[str, Any], rtol: float) -> None:
    """The same, pressed, with no friction forward."""
    law = DryFriction(0.0, 0.0, mu_static_backward=0.6, mu_coulomb_backward=0.5)
    scene = Scene(
        Body("b", inertia=2.0), Contact("wheel", "b", GROUND, law, normal=10.0), Force("b", sine(1.2, 1.0))
    )
    result = simulate(scene, (0.0, 7.5), rtol=rtol, atol=1e-2 * rtol, **options)
    assert result.events == []


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("options", ENGINES)
def test_what_does_pass_0_does_so_where_it_was_0(options: dict[str, Any], rtol: float) -> None:
    """v = 0.05 - 0.3/pi cos(2 pi t) is 0 at cos(2 pi t) = pi/6, from both sides: open contacts turn there."""
    scene = Scene(
        Body("b", inertia=2.0, velocity=0.05 - 0.3 / math.pi),
        Contact("open", "b", GROUND, DryFriction(0.3, 0.2), normal=0.0),
        Force("b", sine(1.2, 1.0)),
    )
    result = simulate(scene, (0.0, 3.0), rtol=rtol, atol=1e-2 * rtol, **options)
    first = math.acos(math.pi / 6) / (2 * math.pi)
    exact = [k + t for k in range(3) for t in (first, 1 - first)]
    # acceleration there: 0.6 sin(2 pi first) = 0.51 m/s2
    assert [e.t for e in result.events] == pytest.approx(exact, abs=1e-12 + 60 * rtol)
    assert [int(e.after) for e in result.events] == [1, -1] * 3
    # the velocity is 0 there: to the error of a root, not to what is uncertain
    for event in result.events:
        assert abs(result(event.t)[0]) < 1e-14


@pytest.mark.parametrize("options", ENGINES)
def test_a_dip_deeper_than_the_errors_is_one(options: dict[str, Any]) -> None:
    """Of v = 0.3/pi (1 + sin(2 pi t)) less 1e-6 m/s the minima are beyond 0: that is more than the errors."""
    depth, peak = 1e-6, 0.3 / math.pi
    scene = Scene(
        Body("b", inertia=2.0, velocity=peak - depth),
        Contact("open", "b", GROUND, DryFriction(0.3, 0.2), normal=0.0),
        Force("b", sine(1.2, 1.0, phase=0.5 * math.pi)),
    )
    result = simulate(scene, (0.0, 2.5), rtol=1e-10, atol=1e-12, **options)
    half = math.acos(1 - depth / peak) / (2 * math.pi)
    exact = [k + 0.75 + s * half for k in range(2) for s in (-1, 1)]
    # the velocity falls with 0.0027 m/s2 there
    assert [e.t for e in result.events] == pytest.approx(exact, abs=1e-6)
    assert [int(e.after) for e in result.events] == [-1, 1] * 2


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("options", ENGINES)
def test_sticking_is_where_it_was(options: dict[str, Any], rtol: float) -> None:
    """1 m/s against 2 N on 1 kg: stuck at 0.5 s exactly, at rest, having gone 0.25 m."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=1.0), Contact("c", "b", GROUND, DryFriction(0.3, 0.2), normal=10.0)
    )
    result = simulate(scene, (0.0, 1.0), rtol=rtol, atol=1e-2 * rtol, **options)
    (event,) = result.events
    assert event.t == pytest.approx(0.5, abs=1e-12)
    assert result.velocity("b")[-1] == 0.0
    assert result.position("b")[-1] == pytest.approx(0.25, abs=1e-12)
