"""Absolute tolerances of slow scenes: accuracy in any unit, also where only a run shows how slow they are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from reading import told

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Dahl,
    Damper,
    DryFriction,
    Force,
    Gap,
    LuGre,
    Sampled,
    Scene,
    Spring,
    StateSpace,
    feedback,
    output,
    piecewise_linear,
    position,
    simulate,
    sine,
    table,
    velocity,
)

TIGHT: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-13}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["BDF", "Adams"])
@pytest.mark.parametrize("kind", ["Dahl", "LuGre", "function", "sum", "table"])
def test_a_slow_motion_of_a_stiff_body_has_the_accuracy_that_was_asked_for(kind: str, method: Any) -> None:
    """``x'' + omega_0^2 x = F sin(omega t)`` from rest, within 1e-8 m: ``v = F omega (cos omega t - cos omega_0 t) /
    (omega_0^2 - omega^2)``. No spring and no velocity at the start shows how slow it is."""
    k, frequency, push = 1e6, 2.0, 1e-2
    own, omega, t = math.sqrt(k), 2 * math.pi * frequency, np.linspace(0.01, 0.5, 100)
    elements: dict[str, Any] = {
        "Dahl": Contact("c", "a", GROUND, Dahl(DryFriction(0.3, 0.2), k), normal=1e5),
        "LuGre": Contact("c", "a", GROUND, LuGre(DryFriction(0.3, 0.2), k), normal=1e5),
        "function": Force("a", feedback(lambda x: -k * x, position("a"))),
        "sum": Force("a", -k * position("a")),
        "table": Force("a", table(position("a"), [-1.0, 1.0], [k, -k])),
    }
    scene = Scene(Body("a", inertia=1.0), elements[kind], Force("a", sine(push, frequency)))
    result = simulate(scene, (0.0, 0.5), method=method)
    exact = push * omega / (k - omega**2) * (np.cos(omega * t) - np.cos(own * t))
    # a solver adds up errors over 80 periods
    assert np.abs(result.sample(t).velocity("a") - exact).max() < 1e-3 * np.abs(exact).max()


@pytest.mark.parametrize("unit", [1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("kind", ["function", "block"])
def test_forces_that_only_the_run_tells_move_bodies_alike_in_all_units_of_length(unit: float, kind: str) -> None:
    """Sticks and slips under ``6 sin(2 pi t)``, which a function of time or a block computes: the same in any unit."""
    turning = 2 * math.pi

    def scene(load: Any, length: float, *elements: Any) -> Scene:
        law = DryFriction(0.4, 0.2, stribeck_velocity=0.1 * length)
        rubs = Contact("c", "a", GROUND, law, normal=10.0 * length)
        return Scene(Body("a", inertia=1.0), rubs, Force("a", load), *elements)

    if kind == "function":
        small = scene(feedback(lambda t: 6.0 * unit * math.sin(turning * t), TIME), unit)
    else:
        A, C = [[0.0, 1.0], [-(turning**2), 0.0]], [[1.0, 0.0]]
        states = [0.0, 6.0 * turning * unit]
        small = scene(output("s"), unit, StateSpace("s", A=A, B=[[], []], C=C, states=states))
    exact = simulate(scene(sine(6.0, 1.0), 1.0), (0.0, 3.0), **TIGHT)
    result = simulate(small, (0.0, 3.0))
    assert told(result) == told(exact)
    wanted = exact.sample(60).velocity("a")
    assert np.abs(result.sample(60).velocity("a") / unit - wanted).max() < 1e-5 * np.abs(wanted).max()


def test_samples_are_taken_once_however_slow_the_scene() -> None:
    times: list[float] = []

    def sampled(t: float, x: Any, u: Any) -> float:
        times.append(t)
        return 1e-9

    block = Sampled("s", period=0.1, inputs=[velocity("a")], output=sampled)
    push = Force("a", feedback(lambda force: force, output("s")))
    simulate(Scene(Body("a", inertia=1.0), Damper("a", GROUND, damping=1.0), block, push), (0.0, 1.05))
    assert times == pytest.approx([0.1 * k for k in range(11)])


def test_a_small_motion_beside_large_forces_that_cancel_takes_no_longer() -> None:
    """Shaken with 1e-9 of its weight, a body on a spring moves with a velocity that is hardly more than roundoff.

    ``v = 7e-8 / (w^2 - 49) (cos 7 t - cos w t)`` with ``w^2 = 1e3``.
    """
    spring = Force("a", feedback(lambda x: -1e3 * x, position("a")))
    shaken = Force("a", feedback(lambda t: 1e-8 * math.sin(7 * t), TIME))
    scene = Scene(Body("a", inertia=1.0, position=0.01), spring, shaken, Force("a", 10.0))
    result = simulate(scene, (0.0, 1.0), rtol=1e-11, atol=1e-13)
    assert result.stats["steps"] < 2000
    exact = 7e-8 / (1e3 - 49) * (np.cos(7 * result.t) - np.cos(math.sqrt(1e3) * result.t))
    np.testing.assert_allclose(result.velocity("a"), exact, rtol=0, atol=5e-12)


def test_a_body_in_equilibrium_is_not_slow_but_at_rest() -> None:
    """Only roundoff of its weight, which a function returns, moves it: one run of a few steps is enough."""
    k, weight = 1e6, 9.81
    push = feedback(lambda x: -weight, position("a"))
    scene = Scene(Body("a", inertia=1.0, position=-weight / k), Force("a", -k * position("a")), Force("a", push))
    result = simulate(scene, (0.0, 1.0), method="BDF")
    assert result.stats["steps"] < 100
    assert np.abs(result.velocity("a")).max() < 1e-15
    np.testing.assert_allclose(result.position("a"), -weight / k, rtol=1e-12, atol=0)


@pytest.mark.parametrize("options", [{"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize(
    "held", [Spring("a", GROUND, stiffness=1e3, rest=0.3), Gap("g", "a", GROUND, upper=0.3, stiffness=1e3)]
)
def test_a_spring_at_rest_but_for_roundoff_tells_no_speed(held: Any, options: dict[str, Any]) -> None:
    """Its stretch is that of ``0.1 + 0.2 - 0.3``, 5.6e-17 m; a smooth push moves the body by a millimetre."""
    push = Force("a", feedback(lambda t: math.sin(7 * t) ** 2, TIME))
    at_rest, nearly = (Scene(Body("a", inertia=1.0, position=x), held, push) for x in (0.3, 0.1 + 0.2))
    exact = simulate(at_rest, (0.0, 1.0), rtol=1e-11, atol=1e-14)
    results = [simulate(scene, (0.0, 1.0), **options) for scene in (at_rest, nearly)]
    assert results[1].stats["steps"] < 1.1 * results[0].stats["steps"]
    assert results[1].position("a")[-1] == pytest.approx(exact.position("a")[-1], abs=1e-7)


@pytest.mark.parametrize("method", ["series", "BDF", "Adams"])
@pytest.mark.parametrize("stop", [20.0, 1e4, 1e6])
def test_a_body_relaxes_to_rest_however_long_the_run(stop: float, method: Any) -> None:
    """Pushed for a second, b runs out on a damper, with v like exp(-2 t); a free body could be fast by the end."""
    push = piecewise_linear([0.0, 1.0, 1.0], [3.0, 3.0, 0.0])
    scene = Scene(
        Body("other", inertia=1.0),
        Body("b", inertia=1.0),
        Damper("b", GROUND, damping=2.0),
        Contact("c", "b", GROUND, DryFriction(0.5, 0.0), normal=4.0),
        *(Force(body, push) for body in ("other", "b")),
    )
    result = simulate(scene, (0.0, stop), method=method)
    (event,) = result.events
    assert event.cause == "relaxation" and 6.0 < event.t < 9.0
    late = np.array([2.0, 3.0, 5.0])
    wanted = 1.5 * (1 - math.exp(-2)) * np.exp(-2 * (late - 1))
    np.testing.assert_allclose(result.sample(late).velocity("b"), wanted, rtol=0, atol=1e-7)
