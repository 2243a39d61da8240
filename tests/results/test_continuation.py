"""A run that is cut and goes on from `final_scene` is the run that was not cut."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
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
    Gap,
    Gear,
    Karnopp,
    LuGre,
    OneWay,
    PreSlip,
    Result,
    Sampled,
    Scene,
    Spring,
    StateSpace,
    Stop,
    When,
    feedback,
    join,
    output,
    pid,
    piecewise_linear,
    position,
    power,
    relative_velocity,
    saturate,
    simulate,
    sine,
    stretch,
    table,
    triangle,
    velocity,
)
from stickslip.equations.mode_equations import AT_HIGH, AT_LOW
from stickslip.equations.system import System
from stickslip.results.continuation import on_stops

DRY = DryFriction(0.4, 0.25, dwell=0.3)


def dwell() -> Scene:
    """Three blocks on a belt that swings, bound by springs."""
    return Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0, velocity=0.3),
        Body("c", inertia=0.5),
        Drive("belt", velocity=0.5 * sine(1.0, 0.4) + 0.1),
        Spring("a", "b", stiffness=30.0, damping=0.2),
        Spring("b", GROUND, stiffness=10.0, rest=0.1),
        Contact("ca", "a", "belt", DRY, normal=5.0, rested=0.1),
        Contact("cb", "b", "belt", DryFriction(0.3, 0.2, mu_static_backward=0.5), normal=8.0),
        Contact("cc", "c", "belt", DRY, normal=triangle(0.5, 1.0, 1.5, slope=20.0) + 3.0),
    )


def on_a_belt(law: Any) -> Scene:
    """A block on a belt, held by a spring."""
    return Scene(
        Body("a", inertia=1.0, position=0.2),
        Drive("belt", velocity=0.2),
        Spring("a", GROUND, stiffness=20.0),
        Contact("rub", "a", "belt", law, normal=5.0),
    )


def blocks() -> Scene:
    """A mass with dry friction: a PID controller pushes it through a lag, a sampled block reads its position."""
    lag = StateSpace("lag", [[-5.0]], [[5.0]], [[1.0]], inputs=[output("pi")])
    steps = Sampled(
        "steps",
        period=0.13,
        inputs=[position("m")],
        states=[0.0],
        update=lambda t, x, u: 0.5 * x[0] + u[0],
        output=lambda t, x, u: 0.1 * x[0] - 0.2 * u[0],
    )
    return Scene(
        Body("m", inertia=1.0),
        Contact("rub", "m", GROUND, DryFriction(0.8, 0.5, dwell=0.2), normal=1.0),
        lag,
        steps,
        pid("pi", sine(1.0, 0.3) - position("m"), kp=2.0, ki=0.3, kd=1.5, rate=-1 * velocity("m")),
        Force("m", output("lag") + output("steps")),
    )


def sampled() -> Scene:
    """A sampled controller that hunts."""
    controller = pid(
        "pid",
        1 - position("m"),
        kp=3.0,
        ki=4.0,
        kd=6.0,
        rate=-1 * velocity("m"),
        period=0.02,
        low=-4.0,
        high=4.0,
    )
    rub = Contact("rub", "m", GROUND, DryFriction(1.5, 1.0), normal=1.0)
    return Scene(Body("m", inertia=1.0), rub, controller, Force("m", output("pid")))


def gaps() -> Scene:
    """A hammer between gaps and rigid stops behind a one-way clutch and a gear."""
    return Scene(
        Body("motor", inertia=0.2),
        Body("shaft", inertia=0.8),
        Body("hammer", inertia=1.0, velocity=0.4),
        Gear("gear", "motor", "shaft", ratio=2.0),
        OneWay("free", "shaft", "hammer"),
        Gap("gap", "hammer", GROUND, lower=-0.5, upper=0.4, stiffness=200.0, damping=3.0),
        Stop("stop", "shaft", GROUND, lower=-0.8, upper=0.7, restitution=0.6),
        Spring("shaft", GROUND, stiffness=4.0),
        Contact("rub", "hammer", GROUND, DryFriction(0.2, 0.1, dwell=0.1), normal=1.5),
        Force("motor", sine(1.5, 0.6)),
    )


def tables() -> Scene:
    """A block whose normal forces follow its position and velocity through 0; a limited force and a map pull."""
    return Scene(
        Body("a", inertia=1.0, position=-0.3),
        Drive("belt", velocity=sine(0.4, 0.3)),
        Contact("rub", "a", "belt", DRY, normal=1.0 + 4.0 * position("a")),
        Contact("floor", "a", GROUND, DryFriction(0.3, 0.2), normal=0.5 - 2.0 * velocity("a")),
        Force("a", -table(stretch("rub"), [-1.0, 0.0, 0.5], [-2.0, 0.0, 2.5])),
        Force("a", saturate(-3.0 * relative_velocity("rub"), -0.5, 0.5) + sine(1.0, 0.7)),
    )


def functions() -> Scene:
    """A dry pendulum that is driven, whose pivot grows hot and slippery: the heat is a block's state."""
    heat = Block(
        "heat",
        inputs=[power("pivot")],
        states=[0.0],
        derivative=lambda t, x, u: u - 0.1 * x,
        output=lambda t, x, u: x,
    )
    weight = feedback(lambda angle: -9.81 * math.sin(angle), position("bob"))
    pivot = Contact("pivot", "bob", GROUND, DryFriction(0.5, 0.4), normal=2.0 - 0.3 * output("heat"))
    return Scene(Body("bob", inertia=1.0, position=2.0), pivot, heat, Force("bob", weight + sine(2.0, 0.4)))


CASES: dict[str, tuple[Callable[[], Scene], float]] = {
    "dwell": (dwell, 20.0),
    "bristles": (lambda: on_a_belt(LuGre(DRY, stiffness=1e4, damping=50.0)), 10.0),
    "pre-slip": (lambda: on_a_belt(PreSlip(DryFriction(0.4, 0.25), 1e-3)), 10.0),
    "blocks": (blocks, 20.0),
    "sampled": (sampled, 40.0),
    "gaps": (gaps, 20.0),
    "tables": (tables, 20.0),
    "functions": (functions, 20.0),
}
"""Scenes, and how long they are run in s."""
BY_SERIES = [name for name in CASES if name not in ("bristles", "pre-slip", "functions")]
CVODE: dict[str, Any] = {"method": "BDF", "rtol": 1e-12, "atol": 1e-14}
"""The pendulum passes near its upper rest: what solvers err by there grows a thousandfold."""


def belt() -> Scene:
    """Three blocks on a belt that swings, one of them pushed besides."""
    return Scene(*dwell().elements, Force("c", piecewise_linear([0.0, 2.0, 4.0], [0.0, 3.0, -2.0])))


def same_events(one: Result, parts: list[Result], tolerance: float) -> None:
    events = [event for part in parts for event in part.events]
    assert [(e.contact, e.before, e.after) for e in events] == [(e.contact, e.before, e.after) for e in one.events]
    np.testing.assert_allclose([e.t for e in events], [e.t for e in one.events], rtol=0, atol=tolerance)


def cut(scene: Scene, times: list[float], **options: Any) -> list[Result]:
    """Simulate from each time to the next, each from where the one before has ended."""
    parts = []
    for start, stop in itertools.pairwise(times):
        parts.append(simulate(scene, (start, stop), **options))
        scene = parts[-1].final_scene()
    return parts


@pytest.fixture(scope="module")
def whole() -> Result:
    return simulate(belt(), (0.0, 6.0))


@pytest.mark.parametrize("number", range(8))
def test_a_cut_run_has_the_same_events(number: int, whole: Result) -> None:
    assert len(whole.events) > 10
    times = [0.0, *np.sort(np.random.default_rng(number).uniform(0.0, 6.0, 4)).tolist(), 6.0]
    parts = cut(belt(), times)
    same_events(whole, parts, 1e-11)
    for body in "abc":
        assert abs(parts[-1].velocity(body)[-1] - whole.velocity(body)[-1]) < 1e-10
        assert abs(parts[-1].position(body)[-1] - whole.position(body)[-1]) < 1e-10


def check_cut(name: str, cuts: int, tolerance: float, part: float = 1.0, **options: Any) -> None:
    build, stop = CASES[name][0], part * CASES[name][1]
    whole = simulate(build(), (0.0, stop), **options)
    inner = np.sort(np.random.default_rng(0).uniform(0.0, stop, cuts)).tolist()
    parts = cut(build(), [0.0, *inner, stop], **options)
    same_events(whole, parts, tolerance * stop)
    for body in whole.scene.bodies:
        assert abs(parts[-1].velocity(body.name)[-1] - whole.velocity(body.name)[-1]) <= tolerance
        assert abs(parts[-1].position(body.name)[-1] - whole.position(body.name)[-1]) <= tolerance


@pytest.mark.slow
@pytest.mark.parametrize("cuts", [6, 50])
@pytest.mark.parametrize("name", BY_SERIES)
def test_a_run_cut_at_many_times_is_the_run(name: str, cuts: int) -> None:
    """Dwell times, blocks, sample clocks, gaps, stops, tables and normal forces go on to roundoff."""
    check_cut(name, cuts, 1e-12, method="series")


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_run_cut_at_many_times_is_the_run_by_cvode(name: str) -> None:
    check_cut(name, 6, 1e-7, part=0.5, **CVODE)


@pytest.mark.parametrize("law", [LuGre(DRY, stiffness=1e4, damping=50.0), PreSlip(DryFriction(0.4, 0.25), 1e-3)])
def test_bristles_and_slip_states_go_on(law: Any) -> None:
    whole = simulate(on_a_belt(law), (0.0, 3.0), rtol=1e-9)
    parts = cut(on_a_belt(law), [0.0, 0.4, 0.9, 1.7, 3.0], rtol=1e-9)
    same_events(whole, parts, 1e-5)
    assert abs(parts[-1].velocity("a")[-1] - whole.velocity("a")[-1]) < 1e-5


def test_a_slipping_contact_within_its_pre_slip_velocity_keeps_its_memory() -> None:
    """From 1 m/s friction 2.5 N slows a block; at 0.0005 m/s, within the band, it is still on the kinetic level."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("rub", "a", GROUND, PreSlip(DryFriction(0.4, 0.25), 1e-3), normal=10.0),
    )
    first = simulate(scene, (0.0, (1.0 - 5e-4) / 2.5))
    then = first.final_scene()
    assert then.contacts[0].slipping
    assert abs(simulate(then, (0.3998, 0.39981)).force("rub")[0] - 2.5) < 1e-9
    assert abs(simulate(then.replace("rub", slipping=False), (0.3998, 0.39981)).force("rub")[0]) < 2.1


@pytest.mark.parametrize("method", ["series", "BDF", "Adams"])
@pytest.mark.parametrize("stiffness", [50.0, 5.0])
def test_a_run_that_ends_where_a_dead_band_begins_goes_on(method: str, stiffness: float) -> None:
    """At the edge of Karnopp's dead band the velocity is set to 0, whether the block then sticks or is pushed back."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.5),
        Spring("a", GROUND, stiffness=stiffness),
        Contact("rub", "a", GROUND, Karnopp(DryFriction(0.48, 0.3), 0.05), normal=1.0),
    )
    whole = simulate(scene, (0.0, 2.0), method=method)
    for event in whole.events:
        then = simulate(scene, (0.0, event.t), method=method).final_scene()
        rest = simulate(then, (event.t, 2.0), method=method)
        later = [one.after for one in whole.events if one.t > event.t]
        assert rest.mode("rub")[0] == event.after
        assert [one.after for one in rest.events] == later
        assert abs(rest.velocity("a")[-1] - whole.velocity("a")[-1]) < 1e-6


def test_a_run_that_ends_where_pre_slip_does_goes_on() -> None:
    """At breakaway a contact has the pre-slip velocity but for errors of the solver, and slips in the next run."""
    scene = Scene(
        Body("b", inertia=1.0),
        Force("b", sine(2.0, 0.3)),
        Contact("c", "b", GROUND, PreSlip(DryFriction(0.5, 0.4), velocity=0.01), normal=1.0),
        Spring("b", GROUND, stiffness=1.0, damping=0.1),
    )
    whole = simulate(scene, (0.0, 12.0))
    leaves = [event.t for event in whole.events if event.before == 0]
    assert len(leaves) > 5
    parts = cut(scene, [0.0, *leaves, 12.0])
    assert abs(parts[-1].velocity("b")[-1] - whole.velocity("b")[-1]) < 1e-6
    assert abs(parts[-1].position("b")[-1] - whole.position("b")[-1]) < 1e-6


@pytest.mark.parametrize("stop", [1.6, 2.0, 4.0])
def test_a_pile_at_rest_on_stops_goes_on(stop: float) -> None:
    """One body rests on the floor, one on the other: their positions are roundoff, above or below the limit 0."""
    scene = Scene(
        Body("low", inertia=1.0, position=1.0),
        Body("high", inertia=0.5, position=2.0),
        Force("low", -9.81),
        Force("high", -4.9),
        Stop("floor", "low", GROUND, lower=0.0, restitution=0.6),
        Stop("between", "high", "low", lower=0.0, restitution=0.4),
    )
    first = simulate(scene, (0.0, stop))
    then = simulate(first.final_scene(), (stop, 5.0))
    assert not then.events
    assert then.force("floor")[-1] == pytest.approx(first.force("floor")[-1], rel=1e-14)
    assert abs(then.position("high")[-1]) < 1e-15


def test_a_body_at_rest_near_a_limit_of_0_stays_there() -> None:
    """A stop at 1e-9 m is no stop at 0, however long the body lies there."""
    scene = Scene(
        Body("m", inertia=1.0, position=-1.0, velocity=1.0),
        Force("m", 1.0),
        Stop("s", "m", GROUND, upper=1e-9),
    )
    first = simulate(scene, (0.0, 5e6))
    then = first.final_scene()
    assert first.position("m")[-1] == pytest.approx(1e-9, abs=1e-15)
    assert then.bodies[0].position == 1e-9
    assert not simulate(then, (5e6, 6e6)).events


@pytest.mark.parametrize("mode", [0, AT_HIGH, AT_LOW], ids=["held", "at its upper level", "at its lower level"])
@pytest.mark.parametrize("side", [1, -1])
def test_only_a_limit_of_0_takes_roundoff_off(side: int, mode: int) -> None:
    """A stop is closed at 1e-9 m, its other limit being 0, or at 0; the body has been 1e7 m away, with roundoff 1e-8 m.

    A stop at its level, whose load other rows carry, is closed, too.
    """
    limits = sorted([0.0, side * 1e-9])
    system = System(Scene(Body("m", inertia=1.0), Stop("s", "m", GROUND, lower=limits[0], upper=limits[1])))
    for at, then in ((side * 1e-9, side * 1e-9), (side * 1e-12, 0.0)):
        found = on_stops(system, np.array([0.0, at]), np.array([mode], dtype=np.int8), np.array([1e7]))
        assert found.tolist() == [0.0, then]


def test_a_final_scene_is_data_like_any_other() -> None:
    scene = simulate(belt(), (0.0, 1.234)).final_scene()
    assert Scene.from_dict(scene.to_dict()) == scene


def test_what_was_not_kept_cannot_go_on() -> None:
    result = simulate(belt(), (0.0, 1.0), t_eval=[0.5], dense_output=False)
    with pytest.raises(ValueError, match="dense_output=True"):
        result.final_scene()


def test_deflection_and_slip_state_are_checked() -> None:
    with pytest.raises(TypeError, match="slipping must be True or False"):
        Contact("rub", "a", GROUND, DRY, normal=1.0, slipping="yes")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="deflection must be finite"):
        Contact("rub", "a", GROUND, DRY, normal=1.0, deflection=float("inf"))


def test_a_scene_that_is_followed_part_by_part_goes_on() -> None:
    law = DryFriction(0.5, 0.3, dwell=0.1)
    scene = Scene(
        *(Body(f"b{k}", inertia=1.0, position=0.01 * k * k) for k in range(20)),
        *(Spring(f"b{k}", f"b{k + 1}", stiffness=5.0) for k in range(19)),
        Drive("belt", velocity=0.1),
        *(Contact(f"c{k}", f"b{k}", "belt", law, normal=1.0) for k in range(20)),
        Spring("b0", GROUND, stiffness=2.0),
    )
    whole = simulate(scene, (0.0, 6.0))
    assert len(whole.events) > 20
    same_events(whole, cut(scene, [0.0, 1.3, 2.7, 6.0]), 1e-10)


@pytest.mark.parametrize("stop", [0.0, 1.0, 1.5, 1.75])
def test_an_event_that_stops_at_a_sample_does_not_take_it_twice(stop: float) -> None:
    """A counter gives 0, 1, 2, ... N for half a second each: v(3) = (0 + 1 + ... + 5) / 2."""

    def scene() -> Scene:
        counter = Sampled("n", period=0.5, states=[0.0], update=lambda t, x, u: x + 1, output=lambda t, x, u: x)
        return Scene(Body("a", inertia=1.0), counter, Force("a", output("n")))

    first = simulate(scene(), (0.0, 3.0), events=[When("now", TIME - stop, stop=True)])
    if stop == 0.0:
        # 0 at the start is no crossing
        assert first.t[-1] == 3.0
    else:
        assert first.t[-1] == stop
        first = simulate(first.final_scene(), (stop, 3.0))
    assert first.velocity("a")[-1] == pytest.approx(7.5, abs=1e-13)


@pytest.mark.parametrize(
    "options",
    [{"method": "BDF"}, {"method": "Adams"}, {"formulation": "merged"}, {"formulation": "multiplier"}],
)
def test_a_block_cut_off_as_it_comes_to_rest_does_not_slide_back(options: dict[str, Any]) -> None:
    """Friction alone acts on it: it comes to rest once. The first run ends where a solver gives it about -1e-9 m/s."""
    law = DryFriction(0.5, 0.3, stribeck_velocity=0.5)
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("rub", "m", GROUND, law, normal=2.0),
        motion="translation",
    )
    (rest,) = simulate(scene, (0.0, 5.0), **options).events
    for later in (0.0, 1e-13, 1e-12, 1e-11, 1e-10, 1e-9, 1e-8):
        parts = cut(scene, [0.0, rest.t + later, 5.0], **options)
        (event,) = join(parts).events
        assert (event.before, event.after) == (1, 0)
        assert event.t == pytest.approx(rest.t, abs=2e-8)
        v = parts[1].velocity("m")
        # between points polynomials have roundoff
        assert v[-1] == 0.0
        assert v.min() >= -1e-15 * abs(v[0])


@pytest.mark.parametrize("speed", [2.0, 2.3, 2.9, 3.7])
def test_a_run_cut_at_an_impact_on_a_stop_at_0_goes_on(speed: float) -> None:
    """The place at the end has the roundoff of the flight: it may be below 0."""
    scene = Scene(
        Body("ball", inertia=1.5, velocity=speed),
        Force("ball", -2.0),
        Damper("ball", GROUND, damping=0.25),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=1.0),
    )
    whole = simulate(scene, (0.0, 10.0))
    assert len(whole.events) >= 2
    for event in whole.events:
        first, then = cut(scene, [0.0, event.t, 10.0])
        assert first.final_scene().bodies[0].position >= 0.0
        assert then.velocity("ball")[-1] == pytest.approx(whole.velocity("ball")[-1], abs=1e-9)
        assert then.position("ball")[-1] == pytest.approx(whole.position("ball")[-1], abs=1e-9)
