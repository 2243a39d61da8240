"""Contacts that nothing presses together: their modes are the signs of their relative velocities."""

from __future__ import annotations

import math
from contextlib import nullcontext
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Dahl,
    Damper,
    Drive,
    DryFriction,
    Force,
    LuGre,
    Mode,
    PreSlip,
    Result,
    Sampled,
    Scene,
    Signal,
    Spring,
    Stop,
    Tie,
    output,
    piecewise_linear,
    signal,
    simulate,
    sine,
    step,
    velocity,
)
from validation import part_by_part
from validation.against_oracles import scene_of
from validation.oracle_scenes import FAMILIES

DRY = DryFriction(0.3, 0.2)
LATER = piecewise_linear([1.0, 1.1, 1.2], [0.0, 100.0, 0.0])
FORMULATIONS = ("contact-force", "merged", "multiplier")


def told(result: Result) -> list[tuple[str, int, int]]:
    return sorted((e.contact, int(e.before), int(e.after)) for e in result.events)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("velocity", [1.0, 0.7, 1.3, 1.5842827116307445, 0.2148193423261883])
def test_it_stops_with_the_closed_contact_that_stops_its_body(velocity: float, formulation: str) -> None:
    # a = -(4.9 + 0.2 30): both are at rest at v / 10.9, whatever the roundoff of v there
    scene = Scene(
        Body("wheel", inertia=1.0, velocity=velocity),
        Force("wheel", -4.9),
        Contact("floor", "wheel", GROUND, DRY, normal=30.0),
        Contact("brake", "wheel", GROUND, DRY, normal=LATER),
    )
    result = simulate(scene, (0.0, 2.0), formulation=formulation)
    assert told(result) == [("brake", 1, 0), ("floor", 1, 0)]
    assert [e.t for e in result.events] == pytest.approx([velocity / 10.9] * 2, abs=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_it_stops_with_bodies_that_lock(formulation: str) -> None:
    # b decelerates at 2 m/s^2 on the body that the ground holds
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0, velocity=1.3),
        Contact("hold", "a", GROUND, DRY, normal=100.0),
        Contact("c", "a", "b", DRY, normal=10.0),
        Contact("brake", "b", GROUND, DRY, normal=LATER),
    )
    result = simulate(scene, (0.0, 4.0), formulation=formulation)
    assert told(result) == [("brake", 1, 0), ("c", -1, 0)]
    assert [e.t for e in result.events] == pytest.approx([0.65, 0.65], abs=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_it_turns_over_twice_within_one_parabola(formulation: str) -> None:
    # w = 1 - 3 t + t^2
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Force("a", piecewise_linear([0, 4], [-3, 5])),
        Contact("open", "a", GROUND, DRY, normal=piecewise_linear([4, 5], [0, 10])),
    )
    result = simulate(scene, (0.0, 4.0), t_eval=[0.1, 1.5, 3.0], formulation=formulation)
    assert told(result) == [("open", -1, 1), ("open", 1, -1)]
    roots = [(3 - math.sqrt(5)) / 2, (3 + math.sqrt(5)) / 2]
    assert [e.t for e in result.events] == pytest.approx(roots, abs=1e-12)
    assert result.mode("open").tolist() == [1, -1, 1]


def test_it_turns_over_twice_between_computed_points() -> None:
    # x'' + x = 0.5 sin(2 pi t / 3) sampled coarsely: the same events at every tolerance
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.3),
        Spring("a", GROUND, stiffness=1.0),
        Force("a", sine(0.5, 1.0 / 3.0)),
        Contact("open", "a", GROUND, DRY, normal=piecewise_linear([50, 51], [0, 10])),
    )
    loose, fine = (simulate(scene, (0.0, 40.0), rtol=rtol, atol=rtol) for rtol in (1e-4, 1e-10))
    assert told(loose) == told(fine)
    assert [e.t for e in loose.events] == pytest.approx([e.t for e in fine.events], abs=1e-2)
    # v = A w cos(w t) + (0.3 - A w) cos t with w = 2 pi / 3 and A = 0.5 / (1 - w^2): its roots, by bisection
    w = 2 * math.pi / 3
    swing = 0.5 * w / (1 - w**2)

    def v(t: float) -> float:
        return swing * math.cos(w * t) + (0.3 - swing) * math.cos(t)

    turns = [brentq(v, a, b, xtol=1e-13) for a, b in pairwise(np.linspace(0.0, 40.0, 4001)) if v(a) * v(b) < 0]
    assert len(turns) > 10
    assert [e.t for e in fine.events] == pytest.approx(turns, abs=1e-8)


def test_where_nothing_else_happens_no_root_is_looked_for() -> None:
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("open", "a", GROUND, DRY, normal=piecewise_linear([4, 5], [0, 10])),
    )
    result = simulate(scene, (0.0, 4.0))
    assert not result.events
    assert result.stats["guards_isolated"] == 0


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(
    "normal",
    [
        piecewise_linear([0, 0.5, 0.59], [100, 100, 0]),
        piecewise_linear([0, 0.5, 0.59, 1, 1], [100, 100, -10, -10, 50]),
    ],
    ids=["opens", "opens and closes"],
)
def test_it_does_not_move_on_bodies_that_preloaded_springs_leave_at_rest(normal: Signal, formulation: str) -> None:
    # the springs hold each other within a stuck group: the sum of their forces is roundoff
    law, stiffness = DryFriction(0.9, 0.5), 26.1
    scene = Scene(
        Body("hub", inertia=3.0, position=-0.157),
        Body("a", inertia=0.5, position=0.027),
        Body("b", inertia=0.7, position=-0.078),
        Spring("hub", "a", stiffness=stiffness),
        Spring("hub", "b", stiffness=stiffness),
        Spring("b", "a", stiffness=stiffness / 3),
        Contact("first", "hub", "a", law, normal=100.0),
        Contact("second", "hub", "b", law, normal=100.0),
        Contact("brake", "a", GROUND, law, normal=normal),
    )
    result = simulate(scene, (0.0, 2.0), formulation=formulation)
    assert not result.events
    for body, place in (("hub", -0.157), ("a", 0.027), ("b", -0.078)):
        np.testing.assert_allclose(result.position(body), place, rtol=0, atol=1e-14)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_it_starts_to_move_when_the_load_starts_to_rise(formulation: str) -> None:
    # at t = 1 velocity and acceleration are 0, and the acceleration rises
    scene = Scene(
        Body("h", inertia=1.0),
        Body("a", inertia=1.0),
        Spring("h", "a", stiffness=20.0),
        Force("a", piecewise_linear([1, 2], [0, 10])),
        Contact("j", "h", "a", DRY, normal=100.0),
        Contact("open", "a", GROUND, DRY, normal=piecewise_linear([5, 6], [0, 1])),
    )
    result = simulate(scene, (0.0, 2.0), formulation=formulation)
    assert told(result) == [("open", 0, 1)]
    assert result.events[0].t == 1.0


def test_it_has_rested_since_it_came_to_rest_whatever_others_do() -> None:
    """A brake at rest from the start has dwelt since then when it closes, though another contact let go."""
    dwelling = DryFriction(0.3, 0.2, dwell=0.5)
    scene = Scene(
        Body("held", inertia=1.0),
        Body("pulled", inertia=1.0),
        Contact("brake", "held", GROUND, dwelling, normal=piecewise_linear([2, 2], [0, 10])),
        Contact("floor", "pulled", GROUND, DRY, normal=10.0),
        Force("pulled", piecewise_linear([0, 4], [0, 4])),
    )
    result = simulate(scene, (0.0, 4.0), t_eval=[2.5])
    assert told(result) == [("floor", 0, 1)]
    level = 10.0 * (0.3 - 0.1 * math.exp(-2.5 / 0.5))
    assert result.breakaway("brake") == pytest.approx([level], rel=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_it_moves_with_a_contact_that_lets_go_without_a_jump(formulation: str) -> None:
    """Stribeck friction starts at its static level: the acceleration is 0 at breakaway, and rises."""
    law = DryFriction(0.3, 0.2, stribeck_velocity=0.3)
    scene = Scene(
        Body("w", inertia=1.0),
        Force("w", piecewise_linear([0, 2], [0, 6])),
        Contact("floor", "w", GROUND, law, normal=10.0),
        Contact("open", "w", GROUND, DRY, normal=piecewise_linear([5, 6], [0, 1])),
    )
    result = simulate(scene, (0.0, 1.2), formulation=formulation)
    assert told(result) == [("floor", 0, 1), ("open", 0, 1)]
    assert [e.t for e in result.events] == pytest.approx([1.0, 1.0], abs=1e-9)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_it_moves_with_a_body_that_a_spring_pulls_along(formulation: str) -> None:
    """When the floor lets go, the velocity of q and its first two rates are 0: the third decides."""
    scene = Scene(
        Body("p", inertia=1.0),
        Body("q", inertia=1.0),
        Spring("p", "q", stiffness=5.0),
        Contact("floor", "p", GROUND, DRY, normal=10.0),
        Contact("open", "q", GROUND, DRY, normal=piecewise_linear([5, 6], [0, 1])),
        Force("p", piecewise_linear([0, 1, 2], [0, 3, 6])),
    )
    result = simulate(scene, (0.0, 1.2), formulation=formulation)
    assert told(result) == [("floor", 0, 1), ("open", 0, 1)]
    assert [e.t for e in result.events] == pytest.approx([1.0, 1.0], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("law", [DryFriction(0.0, 0.0), DRY])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_velocity_that_dies_away_keeps_its_mode(law: DryFriction, sign: float) -> None:
    """v = exp(-20 t) never comes to 0, whatever others do meanwhile and at whichever times it is read."""
    bodies = [
        Body("a", inertia=1.0, velocity=sign),
        Damper("a", GROUND, damping=20.0),
        Contact("smooth", "a", GROUND, law, normal=10.0 if law.mu_static == 0 else 0.0),
        # it sticks and slips meanwhile
        Body("b", inertia=1.0, velocity=1.0),
        Contact("floor", "b", GROUND, DRY, normal=10.0),
        Force("b", piecewise_linear([2.0, 2.5, 3.0], [0.0, 8.0, 0.0])),
    ]
    times = [0.1, 0.5, 0.9, 1.3, 2.1, 2.45, 2.7, 3.5, 3.9]
    for formulation in FORMULATIONS:
        for extra in (
            {"rtol": 1e-6},
            {"rtol": 1e-10, "atol": 1e-13},
            {"max_step": 0.01},
            {"max_step": 0.01, "rtol": 1e-6},
            {"dense_output": False},
        ):
            result = simulate(Scene(*bodies), (0.0, 4.0), t_eval=times, formulation=formulation, **extra)  # type: ignore[arg-type]
            assert [e for e in result.events if e.contact == "smooth"] == []
            assert result.mode("smooth").tolist() == [sign] * len(times), (formulation, extra)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_it_rests_with_a_body_that_is_held(formulation: str) -> None:
    """The floor holds its body from 0.5 s to 2.375 s: meanwhile the frictionless contact is at rest too."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=1.0),
        Contact("floor", "b", GROUND, DRY, normal=10.0),
        Contact("smooth", "b", GROUND, DryFriction(0.0, 0.0), normal=10.0),
        Force("b", piecewise_linear([2.0, 3.0], [0.0, 8.0])),
    )
    result = simulate(scene, (0.0, 3.0), formulation=formulation)
    assert told(result) == [("floor", 0, 1), ("floor", 1, 0), ("smooth", 0, 1), ("smooth", 1, 0)]
    assert [e.t for e in result.events] == pytest.approx([0.5, 0.5, 2.375, 2.375], abs=1e-9)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_it_is_named_after_a_motion_that_starts_slowly(formulation: str) -> None:
    """A spring passes on a force that rises from 0: v of the second body starts as t^4, and it moves from the start."""
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Spring("a", "b", stiffness=10.0),
        Contact("open", "b", GROUND, DRY, normal=LATER),
        Force("a", sine(1.0, 0.2)),
    )
    result = simulate(scene, (0.0, 0.9), t_eval=[0.0, 0.4, 0.8], formulation=formulation)
    assert not result.events
    assert result.mode("open").tolist() == [1, 1, 1]
    # 2 v is that of both less that of the stretch of the spring, ``r'' + 20 r = sin(w t)``
    w, t = 2 * math.pi * 0.2, result.t
    stretches = w / (20 - w**2) * (np.cos(w * t) - np.cos(math.sqrt(20) * t))
    exact = 0.5 * ((1 - np.cos(w * t)) / w - stretches)
    np.testing.assert_allclose(result.velocity("b"), exact, rtol=0, atol=1e-8)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_it_turns_with_a_drive_that_jumps(formulation: str) -> None:
    """a at 0.8 m/s, b at 0.2: friction of 2 N between them; the drive leaps from 1.4 to -0.8 m/s, past both."""
    scene = Scene(
        Body("a", inertia=10.0, velocity=0.8),
        Body("b", inertia=10.0, velocity=0.2),
        Body("c", inertia=10.0, velocity=0.8),
        Drive("drive", velocity=piecewise_linear([0.5, 0.5], [1.4, -0.8])),
        Contact("rub", "b", "a", DRY, normal=10.0),
        Contact("held", "c", "a", DRY, normal=10.0),
        Contact("open", "a", "drive", DRY, normal=0.0),
    )
    result = simulate(scene, (0.0, 1.0), formulation=formulation)
    assert told(result) == [("open", -1, 1)]
    assert result.events[0].t == 0.5
    # 2 N brake a and c together, and drive b
    assert result.velocity("a")[-1] == result.velocity("c")[-1] == pytest.approx(0.7, abs=1e-12)
    assert result.velocity("b")[-1] == pytest.approx(0.4, abs=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("held", [["driven"], ["driven", "floor"], ["floor", "driven"]])
def test_it_stops_and_goes_on_with_the_drive_that_its_body_is_held_to(held: list[str], formulation: str) -> None:
    """2 or 4 N of friction stop 1 kg at 1 m/s after 0.5 or 0.25 s; the drive stands still until 2 s."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=1.0),
        Drive("drive", velocity=piecewise_linear([2.0, 3.0], [0.0, 1.0])),
        *(Contact(name, "b", "drive" if name == "driven" else GROUND, DRY, normal=10.0) for name in held),
        Contact("open", "b", GROUND, DRY, normal=0.0),
    )
    result = simulate(scene, (0.0, 2.2), formulation=formulation)
    events = [(e.t, int(e.after)) for e in result.events if e.contact == "open"]
    assert events[0] == (pytest.approx(0.5 / len(held), abs=1e-9), 0)
    if held == ["driven"]:
        # the 1 m/s2 of the drive need 1 N of 3
        assert events[1:] == [(2.0, 1)]


@pytest.mark.parametrize("method", ["series", "BDF"])
@pytest.mark.parametrize("time", [1e-9, 1.0, 1e10])
def test_it_moves_whatever_the_unit_of_time(time: float, method: str) -> None:
    """From rest 1 kg goes 1 m in this time: the force is 2 (1 m) (1 kg) / time^2."""
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("open", "b", GROUND, DRY, normal=0.0),
        Force("b", 2.0 / time**2),
    )
    result = simulate(scene, (0.0, time), method=method)
    assert set(result.mode("open").tolist()) == {1}
    assert result.velocity("b")[-1] * time == pytest.approx(2.0, rel=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}])
def test_a_normal_force_that_dies_away_just_before_its_load_ends(options: dict[str, Any]) -> None:
    """A contact lets go as N = 16355 (3.66 - t) + 26.9 v comes to 44.5 x / 0.294, and opens 4e-14 s before 3.66 s.

    Roundoff of the time decides whether it is open in between. Then the block swings for half a period of
    ``0.5 x'' + 0.2 x' + 44.5 x = 0``.
    """
    stretched = 6.92624817e-06
    scene = Scene(
        Body("b", inertia=0.5, position=stretched),
        Spring("b", GROUND, stiffness=44.5, damping=0.2),
        Contact(
            "c",
            "b",
            GROUND,
            DryFriction(0.294, 0.21),
            normal=piecewise_linear([2.04, 3.64, 3.66], [0.0, 327.1, 0.0]) + 26.9 * velocity("b"),
        ),
    )
    result = simulate(Scene.from_dict(scene.to_dict()), (3.6, 4.1), rtol=1e-10, atol=1e-13, **options)
    assert [(e.before, e.after) for e in result.events] == [(0, -1), (-1, 1)]
    slips, turns = (e.t for e in result.events)
    assert slips == pytest.approx(3.66 - 44.5 * stretched / (0.294 * 16355.0), abs=1e-14)
    assert turns == pytest.approx(3.66 + math.pi / math.sqrt(89.0 - 0.04), abs=1e-7)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_what_relaxes_takes_the_open_contact_with_it_that_joins_it_to_a_body_at_rest(
    options: dict[str, Any],
) -> None:
    """v = exp(-20 t) falls to the margin of 1e-5: then both bodies are held, and the open contact rests."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Damper("a", GROUND, damping=20.0),
        Contact("smooth", "a", GROUND, DryFriction(0.3, 0.0), normal=10.0),
        Body("held", inertia=1.0),
        Contact("floor", "held", GROUND, DRY, normal=10.0),
        Contact("open", "a", "held", DRY, normal=0.0),
        Body("fast", inertia=1.0, velocity=5.0),
        Contact("slides", "fast", GROUND, DRY, normal=1.0),
    )
    result = simulate(scene, (0.0, 1.0), velocity_margin=1e-5, **options)
    assert told(result) == [("open", 1, 0), ("smooth", 1, 0)]
    assert [e.t for e in result.events] == pytest.approx([math.log(1e5) / 20] * 2, abs=1e-4)
    assert result.mode("open")[-1] == 0


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "merged"}])
def test_a_sample_opens_a_contact_in_the_instant_in_which_its_body_comes_to_rest(
    options: dict[str, Any],
) -> None:
    """N is 10 N and 0 in turn: the body gains 0.1 m/s under 1 N, and loses it, to roundoff, under 1 - 0.2 10 N."""
    valve = Sampled(
        "valve",
        period=0.1,
        inputs=(),
        states=(10.0,),
        update=lambda t, x, u: [10.0 - x[0]],
        output=lambda t, x, u: x[0],
        outputs=1,
    )
    scene = Scene(
        valve,
        Body("b", inertia=1.0),
        Force("b", 1.0),
        Contact("c", "b", GROUND, DryFriction(0.2, 0.2), normal=output("valve")),
    )
    result = simulate(scene, (0.0, 1.0), **options)
    assert told(result) == [("c", 0, 1)]
    # it goes 0.005 m in each of the nine periods after the first
    assert result.position("b")[-1] == pytest.approx(9 * 0.005, abs=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_a_contact_that_holds_nothing_opens_at_rest(options: dict[str, Any]) -> None:
    """N = 1.5 - 1.7 v falls to 0 with v = t at 15/17 s, to roundoff. Nothing ever moves the block."""
    scene = Scene(
        Body("block", inertia=1.0),
        Body("other", inertia=1.0),
        Force("other", 1.0),
        Contact("c", "block", GROUND, DRY, normal=1.5 - 1.7 * velocity("other")),
    )
    result = simulate(scene, (0.0, 3.0), **options)
    assert told(result) == []
    assert result.mode("c")[-1] == 0
    assert result.force("c")[-1] == 0.0
    assert not result.velocity("block").any()
    at = result.sample([0.5, 15 / 17, 2.0])
    np.testing.assert_allclose(at.normal("c"), [1.5 - 1.7 * 0.5, 0.0, 0.0], rtol=0, atol=1e-8)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("velocity", "stop"), [(2.0, 1.0), (1.7, 0.8), (-1.9, 0.61), (0.3, 0.7)])
def test_it_comes_to_rest_with_a_drive_that_stops(velocity: float, stop: float, formulation: str) -> None:
    """An open clutch between a motor that runs down to 0 and a wheel at rest: w = 0 from there on, and not before."""
    scene = Scene(
        Drive("motor", velocity=piecewise_linear([0.1, stop, 2.0, 3.0], [velocity, 0.0, 0.0, velocity])),
        Body("wheel", inertia=1.3),
        Contact("clutch", "motor", "wheel", DRY, normal=-1.0),
    )
    result = simulate(scene, (0.0, 2.5), t_eval=[0.0, 1.5, 2.5], formulation=formulation)
    sign = int(math.copysign(1, velocity))
    assert [(e.t, int(e.after)) for e in result.events] == [(stop, 0), (2.0, sign)]
    assert result.mode("clutch").tolist() == [sign, 0, sign]


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("after", [0.0, -0.5])
def test_it_comes_to_rest_where_its_force_ends(after: float, formulation: str) -> None:
    """v = 1 - t up to 1 s; from there on it rests without force, and -0.5 N drive it back."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Force("a", piecewise_linear([1.0, 1.0], [-1.0, after])),
        Contact("open", "a", GROUND, DRY, normal=0.0),
        # others may be settled meanwhile
        Body("b", inertia=1.0, velocity=1.0),
        Contact("floor", "b", GROUND, DRY, normal=2.0),
    )
    result = simulate(scene, (0.0, 3.0), formulation=formulation)
    (event,) = (e for e in result.events if e.contact == "open")
    assert event.t == pytest.approx(1.0, abs=1e-12)
    assert int(event.after) == result.mode("open")[-1] == (0 if after == 0 else -1)


@pytest.mark.parametrize("rtol", [1e-3, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(
    "way",
    [{}, {"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}, {"formulation": "merged"}],
)
def test_an_open_contact_shows_rest_and_what_ends_it_whatever_the_tolerance(way: dict[str, Any], rtol: float) -> None:
    """a stops after 0.5 / (0.3 * 7) s, and b rests beside it until 1 s, when c begins to take it along."""
    dry = DryFriction(0.4, 0.3)
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.5),
        Body("b", inertia=2.0),
        Body("c", inertia=1.5, velocity=1.0),
        Contact("brake", "a", GROUND, dry, normal=7.0),
        Contact("open", "b", "a", dry, normal=0.0),
        Contact("clutch", "c", "b", dry, normal=piecewise_linear([0.0, 1.0, 2.0], [0.0, 0.0, 5.0])),
    )
    result = simulate(scene, (0.0, 1.5), rtol=rtol, atol=1e-2 * rtol, **way)
    stop = 0.5 / 2.1
    assert [(e.contact, e.before, e.after) for e in result.events] == [
        ("brake", Mode.FORWARD, Mode.STUCK),
        ("open", Mode.BACKWARD, Mode.STUCK),
        ("open", Mode.STUCK, Mode.FORWARD),
    ]
    np.testing.assert_allclose([e.t for e in result.events], [stop, stop, 1.0], rtol=0, atol=10 * rtol)


@pytest.mark.parametrize("options", [{}, {"method": "Adams"}])
def test_a_contact_that_creeps_as_it_opens_shows_where_it_moves(options: dict[str, Any]) -> None:
    """2 N make it creep with half the pre-slip velocity; from 1 s on -1 N alone stop it after 0.05 s."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=0.05),
        Contact("c", "b", GROUND, PreSlip(DryFriction(0.4, 0.3), velocity=0.1), normal=step(1.0, 10.0, 0.0)),
        Force("b", step(1.0, 2.0, -1.0)),
    )
    result = simulate(scene, (0.0, 1.5), rtol=1e-8, atol=1e-10, **options)
    assert [(e.before, e.after) for e in result.events] == [(0, 1), (1, -1)]
    assert [e.t for e in result.events] == pytest.approx([1.0, 1.05], abs=1e-8)
    assert result.velocity("b")[-1] == pytest.approx(0.05 - 0.5, abs=1e-8)


def test_with_loose_tolerances_a_slow_crossing_is_one() -> None:
    """A random scene: if its crossing at 0.39 s is taken for a velocity that dies away, modes flip without progress."""
    data = FAMILIES["everything"][0](14)
    scene, span = scene_of(data, 14), (0.0, data["t_end"])
    t = np.linspace(*span, 101)
    exact = simulate(scene, span, t_eval=t).y[:5]
    found = simulate(scene, span, t_eval=t, rtol=1e-3, atol=1e-5, formulation="multiplier").y[:5]
    assert np.abs(found - exact).max() < 1e-2 * np.abs(exact).max()


@pytest.mark.parametrize("method", ["auto", "BDF"])
def test_a_contact_that_a_velocity_presses_from_0_on_closes_while_it_slides(method: str) -> None:
    """A cam swings as ``v = -sin t``; from t = pi on it presses a block of 5 m/s, ``v = 5 - mu (1 + cos t)``.

    This velocity is 0 at the start and where it begins to press: its scale is its size in between.
    """
    scene = Scene(
        Body("cam", inertia=1.0, position=1.0),
        Spring("cam", GROUND, stiffness=1.0),
        Body("block", inertia=1.0, velocity=5.0),
        Contact("dry", "block", GROUND, DryFriction(0.4, 0.2), normal=1.0 * velocity("cam")),
    )
    t = np.array([3.0, 3.2, 4.0, 6.0])
    found = simulate(scene, (0.0, 6.2), t_eval=t, method=method, rtol=1e-10, atol=1e-12)
    right = np.where(t < math.pi, 5.0, 5.0 - 0.2 * (1.0 + np.cos(t)))
    np.testing.assert_allclose(found.velocity("block"), right, rtol=0, atol=1e-8)
    assert not found.events


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"method": "Adams"}, {"method": "RK4", "step": 1e-4}])
@pytest.mark.parametrize("law", [Dahl(DryFriction(0.2, 0.2), 1e3), LuGre(DryFriction(0.2, 0.2), 1e3)])
def test_bristles_that_nothing_presses_are_straight(law: Any, options: dict[str, Any]) -> None:
    """``z' = w - sigma_0 |w| z / (mu N)`` has z -> 0 as N -> 0: closed again, it starts without deflection.

    Pressed with 10 N until 0.3 s and from 1 s on; meanwhile a force of -6 N turns the block round.
    """

    def pressed(t: float, y: Any) -> list[float]:
        return [-1e3 * y[1], y[0] - 1e3 * abs(y[0]) * y[1] / 2.0]

    def after(span: tuple[float, float], v: float) -> float:
        return float(solve_ivp(pressed, span, [v, 0.0], rtol=1e-11, atol=1e-13).y[0, -1])

    turned = after((0.0, 0.3), 2.0) - 6.0 * 0.7
    normal = piecewise_linear([0.3, 0.3, 1.0, 1.0], [10.0, 0.0, 0.0, 10.0])
    scene = Scene(
        Body("a", inertia=1.0, velocity=2.0),
        Contact("c", "a", GROUND, law, normal=normal),
        Force("a", piecewise_linear([0.3, 0.3, 1.0, 1.0], [0.0, -6.0, -6.0, 0.0])),
    )
    result = simulate(scene, (0.0, 1.1), **options)
    at = result.sample([0.5, 1.0, 1.1])
    assert at.velocity("a")[1:] == pytest.approx([turned, after((1.0, 1.1), turned)], abs=1e-7)
    assert simulate(scene, (0.0, 0.5), **options).final_scene().contacts[0].deflection == 0.0
    assert result.power("c").min() > -1e-9


@pytest.mark.parametrize("peak", [2.0, 5.0])
@pytest.mark.parametrize("beside", [False, True])
def test_a_pulse_of_which_nothing_is_seen_at_the_start_moves_it_from_there_on(peak: float, beside: bool) -> None:
    """``3 exp(-((t - peak) / 0.5)^2)`` N push 1 kg: v grows from the start to 3 0.5 sqrt(pi) / 2 at the peak."""
    pulse = signal(lambda t: 3.0 * math.exp(-(((t - peak) / 0.5) ** 2)))
    scene = Scene(
        Body("b", inertia=1.0),
        Force("b", pulse),
        Contact("c", "b", GROUND, DRY, normal=piecewise_linear([peak, peak + 2.0], [0.0, 2.0])),
        *([Body("fly", inertia=1.0, velocity=300.0)] if beside else []),
    )
    result = simulate(scene, (0.0, peak + 0.5), method="BDF", max_step=0.1)
    assert not result.events
    assert (result.mode("c") == Mode.FORWARD).all()
    found = result.sample([peak]).velocity("b")[0]
    assert found == pytest.approx(0.75 * math.sqrt(math.pi), rel=1e-6)


def test_a_loaded_body_that_rings_down_shows_how_it_moves() -> None:
    """``v = exp(-sigma t) (a cos(omega t) + b sin(omega t))``: in 4 s the amplitude falls to 4e-8 of its start."""
    scene = Scene(
        Body("drum", inertia=1.6, velocity=9.46),
        Spring("drum", GROUND, stiffness=11616.0, damping=13.552),
        Contact("brake", "drum", GROUND, DRY, normal=0.0),
        Force("drum", 215.0),
    )
    sigma = 13.552 / 3.2
    omega = math.sqrt(11616.0 / 1.6 - sigma**2)
    b = ((215.0 - 13.552 * 9.46) / 1.6 + sigma * 9.46) / omega
    first = (math.pi / 2 + math.atan(b / 9.46)) / omega
    result = simulate(scene, (0.0, 4.0), method="series")
    assert [event.t for event in result.events] == pytest.approx(
        np.arange(first, 4.0, math.pi / omega).tolist(), abs=1e-7
    )
    assert {event.after for event in result.events} == {-1, 1}


def run(scene: Scene, stop: float, by_parts: bool) -> Result:
    """Follow a scene part by part, or as its size asks."""
    with part_by_part.part_by_part() if by_parts else nullcontext():
        return simulate(scene, (0.0, stop))


HOLDERS = {
    "nothing": (),
    "friction": (Contact("g", "b", GROUND, DryFriction(5.0, 5.0), normal=1.0),),
    "a tie": (Tie("g", {"b": 1.0}),),
    "a stop": (Stop("g", "b", GROUND, lower=0.0, upper=1.0), Force("b", -2.0)),
}


@pytest.mark.parametrize("by_parts", [False, True])
@pytest.mark.parametrize("normal", [step(1.0, 0.0, 1.0), 0.0, -1.0], ids=["pressed on", "none", "apart"])
@pytest.mark.parametrize("holder", HOLDERS)
def test_a_drive_that_jumps_as_an_open_contact_comes_to_rest(holder: str, normal: Any, by_parts: bool) -> None:
    """The belt slows down to 0 in 1 s, and jumps to -1 m/s: friction hands on no impulse, the block stays behind."""
    scene = Scene(
        Body("b", inertia=1.0),
        Drive("belt", velocity=piecewise_linear([0.0, 1.0, 1.0], [1.0, 0.0, -1.0])),
        Contact("c", "b", "belt", DryFriction(0.5, 0.5), normal=normal),
        *HOLDERS[holder],
    )
    result = run(scene, 2.0, by_parts)
    sample = result.sample([0.5, 1.5])
    assert sample.mode("c").tolist() == [-1, 1] and told(result) == [("c", -1, 1)]
    pulled = -0.25 if holder == "nothing" and normal not in (0.0, -1.0) else 0.0
    np.testing.assert_allclose(sample.velocity("b"), [0.0, pulled], rtol=0, atol=1e-13)


@pytest.mark.parametrize("by_parts", [False, True])
@pytest.mark.parametrize("loads", [(), (0.1, 0.2, -0.3)], ids=["no load", "roundoff of loads"])
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_an_open_contact_whose_velocity_jumps_to_0_is_stuck(
    speed: float, loads: tuple[float, ...], by_parts: bool
) -> None:
    """A belt jumps to the speed of a block at 1 s; pressed from 2 s on, the contact has rested for 1 s by then."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=speed),
        Drive("belt", velocity=step(1.0, speed - 0.5, speed)),
        Contact("c", "b", "belt", DryFriction(1.0, 0.5, dwell=1.0), normal=step(2.0, 0.0, 1.0)),
        *(Force("b", load) for load in loads),
    )
    result = run(scene, 4.0, by_parts)
    assert told(result) == [("c", 1, 0)] and result.events[0].t == 1.0
    assert result.sample([3.0]).breakaway("c")[0] == pytest.approx(1.0 - 0.5 * math.exp(-2.0), abs=1e-13)


@pytest.mark.parametrize("by_parts", [False, True])
@pytest.mark.parametrize("start", [0.0, 1.0])
def test_what_roundoff_pushes_beside_an_open_contact_is_seen_to_move(start: float, by_parts: bool) -> None:
    """Open from 1 s on, it rests under ``0.1 + 0.2 - 0.3`` (5.6e-17) N, and moves when 1 N more pushes, from 2 s on."""
    normal = piecewise_linear([0.0, 0.5, 1.0], [10.0, 10.0, 0.0])
    scene = Scene(
        Body("b", inertia=1.0, velocity=start),
        Contact("brake", "b", GROUND, DryFriction(0.4, 0.3), normal=normal),
        *(Force("b", load) for load in (0.1, 0.2, -0.3, step(2.0, 0.0, 1.0))),
    )
    result = run(scene, 4.0, by_parts)
    stopped = [(1, 0)] if start else []
    assert [(e.before, e.after) for e in result.events] == [*stopped, (0, 1)] and result.events[-1].t == 2.0
    assert result.sample([1.9, 2.5]).mode("brake").tolist() == [0, 1]
    assert result.velocity("b")[-1] == pytest.approx(2.0, abs=1e-14)


@pytest.mark.parametrize("by_parts", [False, True])
@pytest.mark.parametrize("after", [0.0, -1.0])
@pytest.mark.parametrize("stop", [2.0, 2.1, 2.3, 2.7])
def test_a_contact_that_opens_in_the_instant_in_which_it_comes_to_rest(
    stop: float, after: float, by_parts: bool
) -> None:
    """Friction of 1 / T N stops a block of 1 m/s and ends then, at T; its level has risen again at 3.5 s."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=1.0),
        Contact(
            "c",
            "b",
            GROUND,
            DryFriction(1.0, 0.5, dwell=0.02),
            normal=piecewise_linear([stop, stop, 3.5, 3.5], [2.0 / stop, after, after, 1.0]),
        ),
        Force("b", step(3.5, 0.0, 0.8)),
    )
    result = run(scene, 5.0, by_parts)
    assert told(result) == [("c", 1, 0)] and result.events[0].t == pytest.approx(stop, abs=1e-12)
    assert np.abs(result.velocity("b")[result.t > stop]).max() < 1e-14


def test_an_open_contact_at_rest_at_the_start_has_rested() -> None:
    """Pressed from 1 s on, it has rested for 3 s then: the rest before the start and the rest in the run add up."""
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("c", "b", GROUND, DryFriction(2.0, 1.0, dwell=1.0), normal=step(1.0, -1.0, 1.0), rested=2.0),
    )
    result = simulate(scene, (0.0, 2.0))
    assert result.sample([1.5]).breakaway("c")[0] == pytest.approx(2.0 - math.exp(-3.5), abs=1e-13)
    first = simulate(scene, (0.0, 0.5))
    on = simulate(first.final_scene(), (0.5, 2.0))
    assert on.sample([1.5]).breakaway("c")[0] == pytest.approx(2.0 - math.exp(-3.5), abs=1e-13)
