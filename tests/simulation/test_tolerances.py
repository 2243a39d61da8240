"""Absolute tolerances of slow scenes: accuracy in any unit, also where only a run tells how slow they are."""

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
    LuGre,
    Sampled,
    Scene,
    Spring,
    StateSpace,
    Tie,
    feedback,
    output,
    pid,
    piecewise_linear,
    position,
    simulate,
    sine,
    table,
    velocity,
)

TIGHT: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-13}


@pytest.mark.parametrize("method", ["BDF", "Adams"])
@pytest.mark.parametrize("kind", ["Dahl", "LuGre", "function", "sum", "table"])
def test_a_slow_motion_of_a_stiff_body_has_the_accuracy_that_was_asked_for(kind: str, method: Any) -> None:
    """``x'' + omega_0^2 x = F sin(omega t)`` from rest, within 1e-8 m: ``v = F omega (cos omega t - cos omega_0 t) /
    (omega_0^2 - omega^2)``. No spring and no velocity at the start tells how slow it is."""
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
def test_forces_that_only_the_run_tells_move_bodies_alike_in_all_units_of_length(
    unit: float, kind: str
) -> None:
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
    """Shaken with 1e-9 of its weight, a body on a spring moves with a velocity that is hardly more than roundoff."""
    spring = Force("a", feedback(lambda x: -1e3 * x, position("a")))
    shaken = Force("a", feedback(lambda t: 1e-8 * math.sin(7 * t), TIME))
    scene = Scene(Body("a", inertia=1.0, position=0.01), spring, shaken, Force("a", 10.0))
    assert simulate(scene, (0.0, 1.0), rtol=1e-11, atol=1e-13).stats["steps"] < 2000


def test_a_body_in_equilibrium_is_not_slow_but_at_rest() -> None:
    """What moves it is roundoff of its weight, which a function tells: one run of a few steps is enough."""
    k, weight = 1e6, 9.81
    push = feedback(lambda x: -weight, position("a"))
    scene = Scene(
        Body("a", inertia=1.0, position=-weight / k), Force("a", -k * position("a")), Force("a", push)
    )
    stats = simulate(scene, (0.0, 1.0), method="BDF").stats
    assert stats["steps"] < 100


@pytest.mark.parametrize("spin", [0.0, 300.0])
def test_a_slow_slide_comes_to_rest_beside_a_fast_flywheel(spin: float) -> None:
    """Nothing joins them: v = 1e-5 less 3e-5 t or more, and then rest; the heat is what it had, v^2 / 2."""
    law = DryFriction(0.3, 0.2, stribeck_velocity=0.1)
    scene = Scene(
        Body("slide", inertia=1.0, velocity=1e-5),
        Contact("c", "slide", GROUND, law, normal=1e-4),
        Body("fly", inertia=1.0, velocity=spin),
    )
    result = simulate(scene, (0.0, 4.0))
    assert [event.after.name for event in result.events] == ["STUCK"]
    assert result.velocity("slide")[-1] == 0.0
    assert result.energy().contacts["c"][-1] == pytest.approx(0.5e-10, rel=1e-6)


@pytest.mark.parametrize("radius", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("method", ["series", "BDF", "Adams"])
def test_a_contact_at_a_tiny_radius_stops_its_rotor(method: str, radius: float) -> None:
    """w = 1 - mu N r t / J comes to 0 at 0.5; beside it a flywheel turns, and nothing joins them."""
    scene = Scene(
        Body("rotor", inertia=0.5 * 0.3 * 10.0 * radius, velocity=1.0),
        Body("fly", inertia=1.0, velocity=1.0),
        Contact("pivot", "rotor", GROUND, DryFriction(0.3, 0.3), normal=10.0, radius_a=radius),
    )
    result = simulate(scene, (0.0, 1.0), method=method)
    assert [(event.before, event.after) for event in result.events] == [(1, 0)]
    assert result.events[0].t == pytest.approx(0.5, rel=1e-7)
    assert result.velocity("rotor")[-1] == 0.0


@pytest.mark.parametrize("method", ["series", "BDF"])
def test_an_open_contact_at_a_tiny_radius_shows_how_it_moves(method: str) -> None:
    """What turns with 1 rad/s moves with 1e-9 m/s at 1e-9 m, and nothing holds it."""
    scene = Scene(
        Body("rotor", inertia=1.0, velocity=1.0),
        Contact("pivot", "rotor", GROUND, DryFriction(0.3, 0.3), normal=0.0, radius_a=1e-9),
    )
    assert simulate(scene, (0.0, 1.0), method=method).mode("pivot").tolist()[-1] == 1


@pytest.mark.parametrize("pitch", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("method", ["series", "BDF", "Adams"])
def test_a_table_behind_a_fine_screw_comes_to_rest(method: str, pitch: float) -> None:
    """p w = v, so w = 300 - mu N p t / (J + M p^2) comes to 0 at 0.5, whatever the pitch p."""
    inertia = 1e-2 + pitch * pitch
    scene = Scene(
        Body("motor", inertia=1e-2, velocity=300.0),
        Body("table", inertia=1.0, velocity=300.0 * pitch),
        Tie("screw", {"motor": pitch, "table": -1.0}),
        Contact("slide", "table", GROUND, DryFriction(0.3, 0.3), normal=2000.0 * inertia / pitch),
    )
    result = simulate(scene, (0.0, 1.0), method=method)
    assert [event.after.name for event in result.events] == ["STUCK"]
    assert result.events[0].t == pytest.approx(0.5, rel=1e-7)
    assert result.velocity("motor")[-1] == 0.0


@pytest.mark.parametrize("method", ["series", "BDF", "Adams"])
def test_a_pad_that_creeps_on_a_fast_disc_comes_to_rest(method: str) -> None:
    """The disc drives it with 1 - 0.8 N up to 1 s; from v = 2e-7 the guide then stops it within 0.25 s."""
    law = DryFriction(0.4, 0.4)
    scene = Scene(
        Body("disc", inertia=1.0, velocity=100.0),
        Body("pad", inertia=1e6),
        Contact(
            "brake", "disc", "pad", law, normal=piecewise_linear([0, 1, 1, 5], [2.5, 2.5, 0, 0]), radius_a=0.1
        ),
        Contact("guide", "pad", GROUND, law, normal=2.0),
    )
    result = simulate(scene, (0.0, 5.0), method=method)
    assert [(event.contact, event.after.name) for event in result.events] == [("guide", "STUCK")]
    assert result.events[0].t == pytest.approx(1.25, abs=1e-6)


@pytest.mark.slow
def test_a_servo_drive_turns_its_table_when_it_turns() -> None:
    """Its table is a thousand times as slow as the motor, behind 1 mm/rad: a run 1000 times as tight agrees."""
    reference = piecewise_linear([0.0, 0.5, 5.0], [0.0, 0.05, 0.05])
    controller = pid(
        "controller",
        reference - position("table"),
        kp=20.0,
        ki=200.0,
        kd=0.5,
        rate=-1 * velocity("table"),
        low=-5.0,
        high=5.0,
    )
    scene = Scene(
        Body("motor", inertia=1e-4),
        Body("table", inertia=20.0),
        Contact("bearing", "motor", GROUND, DryFriction(0.02, 0.015), normal=1.0),
        Contact("guide", "table", GROUND, DryFriction(0.12, 0.08, stribeck_velocity=2e-3), normal=200.0),
        Spring("motor", "table", stiffness=1e6, damping=200.0, radius_a=1e-3),
        controller,
        Force("motor", output("controller")),
    )
    found, tight = (
        simulate(scene, (0.0, 5.0), method="BDF", **options)
        for options in ({}, {"rtol": 1e-11, "atol": 1e-14})
    )
    assert [(one.contact, one.after) for one in found.events] == [
        (one.contact, one.after) for one in tight.events
    ]
    for one, other in zip(found.events, tight.events, strict=True):
        assert one.t == pytest.approx(other.t, abs=1e-6)
    assert found.position("table")[-1] == pytest.approx(tight.position("table")[-1], abs=1e-5)
