"""Slow bodies beside fast ones, and behind levers: a velocity's uncertainty is a part of what its body may reach."""

from __future__ import annotations

import math
from typing import Any

import pytest

from stickslip import (
    GROUND,
    TIME,
    Block,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    OneWay,
    Scene,
    Spring,
    Stop,
    Tie,
    feedback,
    output,
    pid,
    piecewise_linear,
    position,
    signal,
    simulate,
    sine,
    velocity,
)

FLY = Body("fly", inertia=1.0, velocity=300.0)
"""Nothing joins it to anything."""

METHODS = pytest.mark.parametrize("method", ["series", "BDF", "Adams"])


@pytest.mark.parametrize("spin", [0.0, 300.0])
def test_a_slow_slide_comes_to_rest_beside_a_fast_flywheel(spin: float) -> None:
    """Nothing joins them. Friction of 3e-5 N stops 1e-5 m/s; the heat is the first kinetic energy, 0.5e-10 J."""
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
@METHODS
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
    """A rotor that turns with 1 rad/s slides with 1e-9 m/s at a radius of 1e-9 m, and nothing holds it."""
    scene = Scene(
        Body("rotor", inertia=1.0, velocity=1.0),
        Contact("pivot", "rotor", GROUND, DryFriction(0.3, 0.3), normal=0.0, radius_a=1e-9),
    )
    result = simulate(scene, (0.0, 1.0), method=method)
    assert result.mode("pivot").tolist()[-1] == 1
    assert result.relative_velocity("pivot")[-1] == pytest.approx(1e-9, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("pitch", [1e-3, 1e-5, 1e-7])
@METHODS
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


@pytest.mark.slow
def test_a_servo_drive_turns_its_table_when_it_turns() -> None:
    """The table, behind 1 mm/rad, is 1000 times as slow as the motor; a run with 1000 times tighter rtol agrees."""
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
        simulate(scene, (0.0, 5.0), method="BDF", **options) for options in ({}, {"rtol": 1e-11, "atol": 1e-14})
    )
    assert [(one.contact, one.after) for one in found.events] == [(one.contact, one.after) for one in tight.events]
    for one, other in zip(found.events, tight.events, strict=True):
        assert one.t == pytest.approx(other.t, abs=1e-6)
    assert found.position("table")[-1] == pytest.approx(tight.position("table")[-1], abs=1e-5)


@METHODS
@pytest.mark.parametrize("lever", [1.0, 6283.0])
def test_a_slow_ball_rebounds(method: str, lever: float) -> None:
    """The ball's end of the lever meets the stop after 1 s with 1e-5 m/s, and leaves it with half of that."""
    scene = Scene(
        Body("ball", inertia=1.0, velocity=-1e-5 / lever, position=1e-5 / lever),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=0.5, radius_a=lever),
        FLY,
    )
    result = simulate(scene, (0.0, 3.0), method=method)
    assert [event.cause for event in result.events] == ["impact"]
    assert result.events[0].t == pytest.approx(1.0, abs=1e-6)
    assert lever * result.velocity("ball")[-1] == pytest.approx(5e-6, rel=1e-6)


@METHODS
def test_a_slow_slide_that_dies_away_is_not_at_rest(method: str) -> None:
    """``v = 1e-4 exp(-t)``, without friction in motion."""
    scene = Scene(
        Body("slide", inertia=1.0, velocity=1e-4),
        Damper("slide", GROUND, damping=1.0),
        Contact("c", "slide", GROUND, DryFriction(0.3, 0.0), normal=1.0),
        FLY,
    )
    result = simulate(scene, (0.0, 3.0), method=method)
    assert not result.events
    assert result.velocity("slide")[-1] == pytest.approx(1e-4 * math.exp(-3.0), rel=1e-5)


@METHODS
def test_a_slow_slide_that_nothing_holds_moves(method: str) -> None:
    """Pressed with 1e-6 (t - 1) N from 1 s on, it stops where ``1e-7 = 0.15e-6 (t - 1)^2``."""
    scene = Scene(
        Body("slide", inertia=1.0, velocity=1e-7),
        Contact("c", "slide", GROUND, DryFriction(0.3, 0.3), normal=piecewise_linear([1, 2], [0, 1e-6])),
        FLY,
    )
    result = simulate(scene, (0.0, 3.0), method=method)
    assert [(event.before, event.after) for event in result.events] == [(1, 0)]
    assert result.events[0].t == pytest.approx(1.0 + math.sqrt(2.0 / 3.0), rel=1e-6)


@METHODS
def test_a_one_way_clutch_with_a_long_lever_stays_free(method: str) -> None:
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0, velocity=2.0),
        OneWay("clutch", "a", "b", radius_a=1e6),
    )
    result = simulate(scene, (0.0, 1.0), method=method)
    assert not result.events
    assert result.velocity("a")[-1] == 0.0
    assert result.velocity("b")[-1] == 2.0


@METHODS
def test_a_nut_on_a_screw_that_is_led_sticks_to_it(method: str) -> None:
    """It moves with 3e-4 m/s, as the screw of 1e-6 m/rad would lead it, and slips until it is pressed long enough."""
    lever = 1e-6
    scene = Scene(
        Drive("screw", velocity=300.0),
        Body("table", inertia=1.0, velocity=300.0 * lever),
        Contact(
            "nut",
            "table",
            "screw",
            DryFriction(0.3, 0.3),
            normal=piecewise_linear([0.5, 0.6], [0.0, 1e-3]),
            radius_b=lever,
        ),
        Contact("slide", "table", GROUND, DryFriction(0.3, 0.3), normal=5e-4),
    )
    result = simulate(scene, (0.0, 3.0), method=method)
    assert [(event.contact, event.after) for event in result.events] == [("nut", 0)]
    # the nut has given back the impulse that the slide took: 1.5e-4 t = 1.5e-5 + 3e-4 (t - 0.6)
    assert result.events[0].t == pytest.approx(1.1, rel=1e-6)
    assert result.velocity("table")[-1] == pytest.approx(3e-4, rel=1e-9)


@pytest.mark.parametrize("beside", [False, True])
def test_a_load_that_friction_holds_tells_no_speed(beside: bool) -> None:
    """A slide of 1 kg at 1e-4 m/s; 100 N push it, and friction is 2e-4 N more: it stops after 0.5 s."""
    scene = Scene(
        Body("slide", inertia=1.0, velocity=1e-4),
        Force("slide", 100.0),
        Contact("c", "slide", GROUND, DryFriction(0.5, 0.5), normal=2 * (100.0 + 2e-4)),
        *([FLY] if beside else []),
    )
    result = simulate(scene, (0.0, 3.0), method="BDF", rtol=1e-6)
    assert [event.after for event in result.events] == [0]
    assert result.events[0].t == pytest.approx(0.5, rel=1e-5)


def test_a_pulse_that_nothing_foretells_moves_a_slide_beside_a_flywheel() -> None:
    """A Gaussian of 10 ms, which samples miss; the slide lets go where ``5 exp(-x^2) = 0.03``, at 1.00738 s."""
    pulse = signal(lambda t: 5.0 * math.exp(-(((t - 1.03) / 0.01) ** 2)))
    scene = Scene(
        Body("slide", inertia=1.0),
        Force("slide", pulse),
        Contact("c", "slide", GROUND, DryFriction(0.3, 0.3), normal=0.1),
        FLY,
    )
    result = simulate(scene, (0.0, 6.0), method="BDF", max_step=0.01)
    assert [event.after for event in result.events] == [1, 0]
    assert result.events[0].t == pytest.approx(1.03 - 0.01 * math.sqrt(math.log(5.0 / 0.03)), abs=1e-8)


@pytest.mark.parametrize("motor_first", [False, True])
def test_signals_that_do_not_reach_a_slow_slide_leave_it_alone(motor_first: bool) -> None:
    """The slide stops at 1e-4 / 2e-4 = 0.5 s, wherever it stands in the scene."""
    machine = [Body("table", inertia=1.0, velocity=300e-4), Body("motor", inertia=1e-2, velocity=300.0)]
    scene = Scene(
        *(machine[::-1] if motor_first else machine),
        Tie("screw", {"motor": 1e-4, "table": -1.0}),
        Body("slide", inertia=1.0, velocity=1e-4),
        Contact("c", "slide", GROUND, DryFriction(0.5, 0.5), normal=4e-4),
        Force("motor", feedback(lambda u: -1e-5 * u, velocity("motor"))),
    )
    result = simulate(scene, (0.0, 0.9), method="BDF")
    assert [event.after for event in result.events] == [0]
    assert result.events[0].t == pytest.approx(0.5, rel=1e-6)


SIGNALS = {
    "none": (),
    "their own": (Force("fly", -1e-3 * velocity("fly")), Force("slide", -1e-9 * velocity("slide"))),
    "one follows": (Force("fly", 1e-3 * velocity("slide")),),
    "by blocks": (
        pid("governor", 300 - 1 * velocity("fly"), kp=1e-3, ki=1e-3),
        Force("fly", output("governor")),
        pid("feed", -1 * velocity("slide"), kp=1e-9),
        Force("slide", output("feed")),
    ),
}


@pytest.mark.parametrize("signals", SIGNALS.values(), ids=SIGNALS)
@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_a_slow_slide_turns_beside_a_governed_flywheel(method: str, signals: tuple[Block | Force, ...]) -> None:
    """Without friction ``v = 0.001 (0.98 + cos t)`` is negative for 0.4 s; friction of 1e-7 N changes this little."""
    scene = Scene(
        Body("slide", inertia=1.0, velocity=1.98e-3),
        Force("slide", sine(-1e-3, 0.5 / math.pi)),
        Contact("c", "slide", GROUND, DryFriction(0.2, 0.2), normal=5e-7),
        FLY,
        *signals,
    )
    result = simulate(scene, (0.0, 6.0), method=method)
    assert [event.after for event in result.events] == [-1, 1]
    exact = simulate(scene, (0.0, 6.0), method="series")
    for one, other in zip(result.events, exact.events, strict=True):
        assert one.t == pytest.approx(other.t, abs=1e-5)


@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_a_part_that_only_a_signal_moves_moves_as_alone(method: str) -> None:
    """Nothing shows beforehand how fast it will be; it lets go where t^2 is 0.3."""
    part = [
        Body("slide", inertia=1.0),
        Spring("slide", GROUND, stiffness=4.0),
        Contact("c", "slide", GROUND, DryFriction(0.3, 0.3), normal=1.0),
        Force("slide", feedback(lambda t: max(t, 0.0) ** 2, TIME)),
    ]
    alone, beside = (simulate(Scene(*part, *more), (0.0, 2.0), method=method, rtol=1e-9) for more in ([], [FLY]))
    assert [event.after for event in beside.events] == [event.after for event in alone.events]
    assert beside.events[0].t == pytest.approx(math.sqrt(0.3), abs=1e-8)
    assert beside.velocity("slide")[-1] == pytest.approx(alone.velocity("slide")[-1], abs=1e-7)


def test_a_state_whose_roundoff_is_not_known_makes_no_run_longer() -> None:
    """1 N for 1e-8 s only: the velocity is smaller than expected, so the run is repeated. A block adds up roundoff."""

    def scene(*more: Block) -> Scene:
        pulse = piecewise_linear([1.0, 1.0, 1.0 + 1e-8, 1.0 + 1e-8], [0.0, 1.0, 1.0, 0.0])
        rubs = Contact("c", "a", GROUND, DryFriction(0.3, 0.2, stribeck_velocity=1e-9), normal=1e-9)
        return Scene(Body("a", inertia=1.0), rubs, Damper("a", GROUND, damping=1.0), Force("a", pulse), *more)

    def nothing(t: float, x: Any, u: Any) -> list[float]:
        angle = 3e8 * u[0]
        return [math.sin(angle) ** 2 + math.cos(angle) ** 2 - 1]

    block = Block("noise", inputs=[velocity("a")], states=[0.0], derivative=nothing)
    with_block, without = (simulate(one, (0.0, 3.0)) for one in (scene(block), scene()))
    assert with_block.stats["steps"] < 1.5 * without.stats["steps"]
    assert with_block.velocity("a")[-1] == pytest.approx(without.velocity("a")[-1], abs=1e-14)
