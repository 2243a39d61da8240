"""A velocity has passed 0 if it goes beyond 0 by more than the solver's errors; the event is where it was 0."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    OneWay,
    Sampled,
    Scene,
    Spring,
    Stop,
    Tie,
    feedback,
    piecewise_linear,
    position,
    simulate,
    sine,
    step,
    velocity,
)
from validation.against_oracles import difference, scene_of
from validation.oracle_scenes import FAMILIES

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
    """Each minimum of v = 0.3/pi (1 - cos(2 pi t)) touches 0: the mode of the open contact never changes."""
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


@pytest.mark.parametrize("options", ENGINES)
def test_nor_where_a_scene_begins_much_slower(options: dict[str, Any]) -> None:
    """A body at 1e-3 m/s, stopped by 2e-3 N at 0.5 s, moves alone at first; later errors are parts of 0.19 m/s."""
    scene = Scene(
        Body("b", inertia=2.0),
        Contact("open", "b", GROUND, DryFriction(0.3, 0.2), normal=0.0),
        Force("b", sine(1.2, 1.0)),
        Body("slow", inertia=1.0, velocity=1e-3),
        Contact("c", "slow", GROUND, DryFriction(0.3, 0.2), normal=1e-2),
    )
    result = simulate(scene, (0.0, 7.5), rtol=1e-9, atol=1e-11, **options)
    assert [(e.contact, round(e.t, 9)) for e in result.events] == [("c", 0.5)]
    late = result.sample(301)
    exact = 0.3 / math.pi * (1 - np.cos(2 * math.pi * late.t))
    np.testing.assert_allclose(late.velocity("b"), exact, rtol=0, atol=3e-8)
    np.testing.assert_allclose(late.velocity("slow"), np.maximum(1e-3 - 2e-3 * late.t, 0.0), rtol=0, atol=1e-11)


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("options", ENGINES)
def test_nor_does_a_freewheel_stick_where_it_touches_rest(options: dict[str, Any], rtol: float) -> None:
    """The body of the sine, pressed with 10 N, without friction forward."""
    law = DryFriction(0.0, 0.0, mu_static_backward=0.6, mu_coulomb_backward=0.5)
    scene = Scene(Body("b", inertia=2.0), Contact("wheel", "b", GROUND, law, normal=10.0), Force("b", sine(1.2, 1.0)))
    result = simulate(scene, (0.0, 7.5), rtol=rtol, atol=1e-2 * rtol, **options)
    assert result.events == []
    late = result.sample(301)
    exact = 0.3 / math.pi * (1 - np.cos(2 * math.pi * late.t))
    np.testing.assert_allclose(late.velocity("b"), exact, rtol=0, atol=1e-12 + 30 * rtol)


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("options", ENGINES)
def test_nor_does_it_turn_where_a_load_breaks_just_then(options: dict[str, Any], rtol: float) -> None:
    """The contact begins to close at 1 s, when v = 0.3/pi (1 - cos(2 pi t)) touches 0; friction: 0.02 (t - 1) N."""
    scene = Scene(
        Body("b", inertia=2.0),
        Contact("c", "b", GROUND, DryFriction(0.3, 0.2), normal=piecewise_linear([1.0, 2.0], [0.0, 0.1])),
        Force("b", sine(1.2, 1.0)),
    )
    result = simulate(scene, (0.0, 1.5), rtol=rtol, atol=1e-2 * rtol, **options)
    assert result.events == []
    # the momentum that friction has taken by 1.5 s: 0.02 N/s (0.5 s)^2/2
    exact = 0.3 / math.pi * 2 - 0.02 * 0.125 / 2.0
    assert result.velocity("b")[-1] == pytest.approx(exact, abs=1e-12 + 30 * rtol)


@pytest.mark.parametrize("rtol", TOLERANCES)
@pytest.mark.parametrize("options", ENGINES)
def test_what_does_pass_0_does_so_where_it_was_0(options: dict[str, Any], rtol: float) -> None:
    """v = 0.05 - 0.3/pi cos(2 pi t) is 0 at cos(2 pi t) = pi/6, rising and falling: there the mode changes."""
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
    # at an event the velocity is 0 to the error of a root, which is far below the solver's errors
    for event in result.events:
        assert abs(result(event.t)[0]) < 1e-14


@pytest.mark.parametrize("options", ENGINES)
def test_a_dip_deeper_than_the_errors_is_one(options: dict[str, Any]) -> None:
    """The minima of v = 0.3/pi (1 + sin(2 pi t)) - 1e-6 are at -1e-6 m/s: that is more than the errors."""
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
    scene = Scene(Body("b", inertia=1.0, velocity=1.0), Contact("c", "b", GROUND, DryFriction(0.3, 0.2), normal=10.0))
    result = simulate(scene, (0.0, 1.0), rtol=rtol, atol=1e-2 * rtol, **options)
    (event,) = result.events
    assert event.t == pytest.approx(0.5, abs=1e-12)
    assert result.velocity("b")[-1] == 0.0
    assert result.position("b")[-1] == pytest.approx(0.25, abs=1e-12)


# Touches


def pulled_from_rest(law: DryFriction, velocity: float = 0.0, blocks: int = 1) -> Scene:
    """Blocks of 1 kg on springs; load and normal force grow from 0, by 4 N/s and 10 N/s.

    A block slips with ``v'' + W^2 v = J``, J = 4 N/s - 0.2 10 N/s: from rest ``v = J / W^2 (1 - cos W t)``. This is 0
    again at ``T = 2 pi / W``. There the load less the spring's force is 2 N/s T, as large as kinetic friction. Each
    block has a T of its own, the first 1 s.
    """
    elements: list[Any] = []
    for k in range(blocks):
        period, name = 1.0 + 0.001 * k, f"b{k}"
        elements += [
            Body(name, inertia=1.0, velocity=velocity),
            Contact(f"c{k}", name, GROUND, law, normal=piecewise_linear([0.0, 10.0], [0.0, 100.0])),
            Spring(name, GROUND, stiffness=(2 * math.pi / period) ** 2),
            Force(name, piecewise_linear([0.0, 10.0], [0.0, 40.0])),
        ]
    return Scene(*elements)


@pytest.mark.parametrize("rtol", [1e-5, 1e-10])
@pytest.mark.parametrize("options", ENGINES)
def test_what_touches_rest_is_held_where_static_friction_is_larger(options: dict[str, Any], rtol: float) -> None:
    """Stuck at T. The spring keeps 2 N/s T, the level is 3 N/s t: 4 t - 2 T = 3 t at t = 2 T."""
    scene = pulled_from_rest(DryFriction(0.3, 0.2))
    result = simulate(scene, (0.0, 2.5), rtol=rtol, atol=1e-2 * rtol, **options)
    assert [int(e.after) for e in result.events] == [0, 1]
    assert [e.cause for e in result.events] == ["relative velocity 0", "breakaway"]
    # the time of a minimum is known to the solver's error of the slope, at best to the square root of roundoff
    assert [e.t for e in result.events] == pytest.approx([1.0, 2.0], abs=1e-8 + 10 * rtol)
    assert set(result.sample([1.2, 1.5, 1.9]).velocity("b0")) == {0.0}


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-8])
@pytest.mark.parametrize("options", ENGINES)
@pytest.mark.parametrize("dwell", [0.0, 1e-3])
def test_a_short_rest_is_found_with_loose_tolerances_too(options: dict[str, Any], rtol: float, dwell: float) -> None:
    """Begun faster, v = J/W^2 + A cos W t would fall to -1e-3 J/W^2 at T/2: it sticks just before, at t_s.

    The spring then pulls with W^2 x = J t_s + A W sin W t_s. The load is 4 t, the level 3 t: breakaway at t = W^2 x.
    """
    angular, mean = 2 * math.pi, 2 / (4 * math.pi**2)
    amplitude = 1.001 * mean
    scene = pulled_from_rest(DryFriction(0.3, 0.2, dwell=dwell), mean + amplitude)
    result = simulate(scene, (0.0, 1.2), rtol=rtol, atol=1e-2 * rtol, **options)
    sticks = math.acos(-mean / amplitude) / angular
    breaks = 2 * sticks + amplitude * angular * math.sin(angular * sticks)
    assert [int(e.after) for e in result.events] == [0, 1]
    # the velocity falls with 0.014 m/s2 where it comes to 0
    assert [e.t for e in result.events] == pytest.approx([sticks, breaks], abs=1e-9 + 20 * rtol)


@pytest.mark.parametrize("options", ENGINES)
@pytest.mark.parametrize(
    ("law", "held"),
    [
        # as much at rest as in motion: the load grows faster than the level
        (DryFriction(0.2, 0.2), False),
        # the level grows from 2 N on with 2 N/s and with the dwell, 1 N/s or 10 N/s; the load with 4 N/s
        (DryFriction(0.3, 0.2, dwell=1.0), False),
        (DryFriction(0.3, 0.2, dwell=0.1), True),
        # only backward
        (DryFriction(0.2, 0.2, mu_static_backward=0.9), False),
    ],
)
def test_what_touches_rest_slips_on_where_nothing_more_holds_it(
    options: dict[str, Any], law: DryFriction, held: bool
) -> None:
    result = simulate(pulled_from_rest(law), (0.0, 1.4), rtol=1e-9, atol=1e-11, **options)
    assert [int(e.after) for e in result.events][:1] == [0] * held
    if not held:
        exact = 2 / (4 * math.pi**2) * (1 - math.cos(2.8 * math.pi))
        assert result.velocity("b0")[-1] == pytest.approx(exact, abs=1e-7)


@pytest.mark.parametrize("rate", [0.02, 50.0])
@pytest.mark.parametrize(("least", "held"), [(1e-2, False), (1e-3, True)])
@pytest.mark.parametrize("options", ENGINES[::3])
def test_a_touch_is_told_the_same_in_every_unit_of_time(
    options: dict[str, Any], least: float, held: bool, rate: float
) -> None:
    """From rest v = 2 sin wt + B wt; its lowest value, where cos wt = -B/2 for the second time, is `least`."""

    def place(slope: float) -> float:
        return 2 * math.pi - math.acos(-slope / 2)

    slope = brentq(lambda b: 2 * math.sin(place(b)) + b * place(b) - least, 0.1, 1.0)
    pushed = sine(2.0 * rate, rate / (2 * math.pi), phase=math.pi / 2, offset=slope * rate)
    # this normal force makes guards that are no polynomials; as mu_c = 0, it has no effect on the motion
    pressed = feedback(lambda v: rate * (1.0 + 0.1 * v * v), velocity("b"))
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("c", "b", GROUND, DryFriction(1.0, 0.0), normal=pressed),
        Force("b", pushed),
    )
    result = simulate(scene, (0.0, 8.0 / rate), rtol=1e-5, atol=1e-7, **options)
    assert [int(e.after) for e in result.events] == [0, 1] * held
    if held:
        assert rate * result.events[0].t == pytest.approx(place(slope), abs=1e-5)


@pytest.mark.parametrize("options", ENGINES[::3])
def test_a_cam_that_turns_freely_lets_a_brake_go(options: dict[str, Any]) -> None:
    """No moving body feels the normal force: 10 - 0.6 t (1 - cos 10 t) falls below 5 within a long step."""
    cam = feedback(lambda a: 10 - 0.6 * a * (1 - math.cos(10 * a)), position("cam"))
    scene = Scene(
        Body("cam", inertia=1.0, velocity=1.0),
        Body("drum", inertia=1.0),
        Force("drum", 5.0),
        Contact("brake", "drum", GROUND, DryFriction(1.0, 0.8), normal=cam),
    )
    result = simulate(scene, (0.0, 10.0), rtol=1e-5, atol=1e-7, **options)
    first = brentq(lambda t: 5 - 0.6 * t * (1 - math.cos(10 * t)), 4.6, 4.7)
    assert result.events[0].t == pytest.approx(first, abs=1e-9)


@pytest.mark.parametrize(("least", "events"), [(1e-15, 2), (1e-12, 0), (1e-6, 0)])
def test_a_touch_is_one_to_roundoff_where_the_engine_is_exact(least: float, events: int) -> None:
    """A block that begins with the velocity `least` has it again at T."""
    result = simulate(pulled_from_rest(DryFriction(0.3, 0.2), least), (0.0, 2.5))
    assert len(result.events) == events


def test_many_blocks_touch_rest_one_after_another() -> None:
    """Each block touches rest at its own T, as one alone does; the scene is followed block by block."""
    result = simulate(pulled_from_rest(DryFriction(0.3, 0.2), blocks=20), (0.0, 1.1))
    assert result.stats["engine"] == "Taylor series"
    assert [e.contact for e in result.events] == [f"c{k}" for k in range(20)]
    assert [e.t for e in result.events] == pytest.approx([1.0 + 0.001 * k for k in range(20)], abs=1e-12)


SOLVERS = ENGINES[:-1]


@pytest.mark.parametrize("options", SOLVERS)
@pytest.mark.parametrize(("by", "rate"), [("normal force", 1e6), ("normal force", 1e9), ("damper", 1e6)])
def test_a_body_that_comes_to_rest_just_beyond_0_has_passed_it(by: str, rate: float, options: dict[str, Any]) -> None:
    """v' = -rate v - 0.2 passes 0 at log(1 + 5 rate) / rate; on the other side it would end at -0.2 / rate.

    That is nearer to 0 than the solver's errors are. The contact holds the body.
    """
    damped = by == "damper"
    scene = Scene(
        Body("b", inertia=1.0, velocity=1.0),
        Damper("b", GROUND, damping=rate if damped else 0.0),
        Contact(
            "c",
            "b",
            GROUND,
            DryFriction(0.2, 0.2),
            normal=1.0 + (0.0 if damped else 5 * rate) * velocity("b"),
        ),
    )
    result = simulate(scene, (0.0, 1.0), **options)
    (event,) = result.events
    assert (event.before, event.after, event.cause) == (1, 0, "relative velocity 0")
    # the last e-folds are within the tolerance of 1e-8 of the first velocity
    assert event.t == pytest.approx(math.log1p(5 * rate) / rate, rel=0.05)
    assert result.velocity("b")[-1] == 0.0


@pytest.mark.parametrize("options", SOLVERS)
def test_a_one_way_clutch_locks_where_a_strong_damper_lets_it_turn_hardly(options: dict[str, Any]) -> None:
    """The driver runs back at first, then forward; the locked clutch hands on all of the driver's 0.5 N."""
    scene = Scene(
        Body("driver", inertia=1.0, velocity=-1.0),
        Body("driven", inertia=1.0),
        Force("driver", 0.5),
        Damper("driver", GROUND, damping=1e6),
        Contact("brake", "driven", GROUND, DryFriction(0.2, 0.2), normal=10.0),
        OneWay("clutch", "driver", "driven"),
    )
    result = simulate(scene, (0.0, 1.0), **options)
    assert [(e.contact, e.before, e.after) for e in result.events] == [("clutch", -1, 0)]
    assert result.events[0].t == pytest.approx(math.log1p(2e6) / 1e6, rel=1e-4)
    assert result.force("clutch")[-1] == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("options", ENGINES)
def test_what_is_beyond_0_has_not_died_away_whatever_pushes(options: dict[str, Any]) -> None:
    """100 N and -101 N act on 1 kg: v = 0.5 - t. The open contact has one event, where v passes 0 at 0.5 s."""
    scene = Scene(
        Body("b", inertia=1.0, velocity=0.5),
        Body("other", inertia=1.0, velocity=1.0),
        Contact("open", "b", GROUND, DryFriction(0.3, 0.2), normal=piecewise_linear([2.0, 3.0], [0.0, 1.0])),
        Contact("held", "other", GROUND, DryFriction(0.3, 0.2), normal=10.0),
        Force("b", 100.0),
        Force("b", -101.0),
    )
    result = simulate(scene, (0.0, 1.5), rtol=1e-3, atol=1e-5, **options)
    assert [(e.contact, int(e.after)) for e in result.events] == [("open", -1), ("held", 0)]
    assert [e.t for e in result.events] == pytest.approx([0.5, 0.5], abs=1e-3)
    assert result.velocity("b")[-1] == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize("options", ENGINES)
def test_an_open_contact_that_closes_does_not_stop_what_moves(options: dict[str, Any]) -> None:
    """The brake leaves 1.5 N of 31 N from 1 s on. At 3 s the open contact closes, with friction of 0.2 (t - 3) N."""
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("brake", "b", GROUND, DryFriction(0.3, 0.295), normal=100.0),
        Contact("open", "b", GROUND, DryFriction(0.3, 0.2), normal=piecewise_linear([3.0, 4.0], [0.0, 1.0])),
        Force("b", piecewise_linear([0.5, 1.0, 1.0], [0.0, 0.0, 31.0])),
    )
    result = simulate(scene, (0.0, 4.0), rtol=1e-3, atol=1e-5, **options)
    assert result.mode("open")[-1] == 1
    assert result.velocity("b")[-1] == pytest.approx(1.5 * 3 - 0.1, abs=5e-3)


def test_what_begins_beyond_rest_has_passed_it_where_that_is_certain() -> None:
    """A random scene in which a velocity begins beyond 0 by less than its uncertainty, and goes on: no event storm."""
    data = FAMILIES["mixed"][0](20)
    scene = scene_of(data, 20)
    rough = simulate(scene, (0.0, data["t_end"]), method="BDF", rtol=1e-3, atol=1e-5)
    exact = simulate(scene, (0.0, data["t_end"]))
    times = np.linspace(0.0, data["t_end"], 200)
    bodies = len(scene.bodies)
    right = exact(times)[:bodies]
    assert np.abs(rough(times)[:bodies] - right).max() <= 5e-3 * np.abs(right).max()


@pytest.mark.parametrize("formulation", ["contact-force", "multiplier"])
def test_a_light_block_that_is_pulled_slowly_sticks_again(formulation: str) -> None:
    """It lets go at ``k v t + d v = mu N`` with an acceleration of roundoff, jumps, and comes to rest within 0.1 s."""
    k, d, v, level, law = 7e5, 5600.0, 4e-4, 2.5e6, DryFriction(0.17, 0.16, stribeck_velocity=3e-4)
    scene = Scene(
        Drive("plate", velocity=v),
        Body("block", inertia=1e-3),
        Spring("block", "plate", stiffness=k, damping=d),
        Contact("ground", "block", GROUND, law, normal=level),
    )
    result = simulate(scene, (0.0, 1700.0), method="BDF", formulation=formulation, rtol=1e-6, atol=1e-9)
    starts, ends = ([e.t for e in result.events if e.after == mode] for mode in (1, 0))
    assert [e.after for e in result.events] == [1, 0, 1, 0, 1, 0]
    assert starts[0] == pytest.approx((0.17 * level - d * v) / (k * v), rel=1e-9)
    assert all(0 < end - start < 0.1 for start, end in zip(starts, ends, strict=True))
    assert np.all(result.relative_velocity("ground") * result.mode("ground") > -1e-8)


@pytest.mark.slow
def test_a_force_that_is_0_at_the_start_is_no_measure_for_others() -> None:
    """A level that has risen to 3 parts in 10,000 is met to roundoff beside a one-way contact whose force begins at 0.

    The series, cut too early, was 5e-7 N off: the contact let go for half a millisecond in which other engines hold it.
    """
    assert difference("one-way", "contact-force", 163) < 1e-7


@pytest.mark.parametrize("options", [{}, {"method": "Adams"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("speed", [1e5])
def test_samples_do_not_hide_that_a_slow_slide_stops_beside_a_fast_wheel(speed: float, options: dict[str, Any]) -> None:
    """A block is sampled each millisecond; it stops after the integral of ``dv / (10 mu(v) - 1.9)`` over 0 to 0.05 m/s.

    An open clutch joins it to a wheel, and the solver knows the wheel's velocity only to a part of it.
    """
    scene = Scene(
        Body("slide", inertia=1.0, velocity=0.05),
        Contact("rub", "slide", GROUND, DryFriction(0.22, 0.2, stribeck_velocity=1e-4), normal=10.0),
        Force("slide", 1.9),
        Body("wheel", inertia=1.0, velocity=speed),
        Contact("clutch", "wheel", "slide", DryFriction(0.3, 0.3), normal=step(50.0, 0.0, 1.0)),
        Sampled("look", period=1e-3, inputs=[position("slide")], output=lambda t, x, u: [u[0]]),
    )
    result = simulate(scene, (0.0, 0.6), **options)
    slows = [
        quad(lambda v: 1 / (0.1 + 0.2 * math.exp(-((v / 1e-4) ** 2))), *ends)[0] for ends in ((0, 1e-3), (1e-3, 0.05))
    ]
    (event,) = result.events
    assert (event.contact, event.after) == ("rub", 0) and event.t == pytest.approx(sum(slows), abs=1e-7)
    assert result.velocity("slide")[-1] == 0.0


@pytest.mark.parametrize("options", [{"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("speed", [1e2, 1e5])
def test_events_of_others_do_not_hide_it_either(speed: float, options: dict[str, Any]) -> None:
    """A slide stops after 0.02 / (0.1 + 0.05) s beside a wheel as above; a block on a spring oscillates."""
    scene = Scene(
        Body("slide", inertia=1.0, velocity=0.02),
        Contact("rub", "slide", GROUND, DryFriction(0.1, 0.1), normal=1.0),
        Force("slide", -0.05),
        Body("wheel", inertia=1.0, velocity=speed),
        Contact("clutch", "wheel", "slide", DryFriction(0.3, 0.3), normal=step(50.0, 0.0, 1.0)),
        Body("block", inertia=1.0, position=1.0),
        Spring("block", GROUND, stiffness=900.0),
        Contact("other", "block", GROUND, DryFriction(0.5, 0.5), normal=1.0),
    )
    result = simulate(scene, (0.0, 1.0), **options)
    (event,) = (one for one in result.events if one.contact == "rub")
    assert event.after == 0 and event.t == pytest.approx(0.02 / 0.15, abs=1e-6)
    assert result.velocity("slide")[-1] == 0.0


@pytest.mark.parametrize("stop", [5.0, 1e4, 1e6])
@pytest.mark.parametrize("breaks", [[1.0], [1.0, 1.2], [1.0, 1.2, 1.4]])
def test_breaks_of_other_loads_do_not_hide_it_in_a_long_run(breaks: list[float], stop: float) -> None:
    """Friction of 2 N and a damper stop a body that 3 N have pushed for 1 s; a free body could be fast by the end."""
    others = piecewise_linear([0.0, *breaks], [3.0, *[2.0] * (len(breaks) - 1), 0.0])
    scene = Scene(
        Body("free", inertia=1.0),
        Force("free", others),
        Body("b", inertia=1.0),
        Force("b", piecewise_linear([0.0, 1.0, 1.0], [3.0, 3.0, 0.0])),
        Damper("b", GROUND, damping=2.0),
        Contact("c", "b", GROUND, DryFriction(0.5, 0.5), normal=4.0),
    )
    result = simulate(scene, (0.0, stop))
    (event,) = result.events
    assert event.t == pytest.approx(1 + 0.5 * math.log(1 + 0.5 * (1 - math.exp(-2))), abs=1e-7)
    assert result.sample([3.0]).mode("c")[0] == 0


@pytest.mark.parametrize("options", [{"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}])
def test_what_leaves_its_limit_hides_no_other(options: dict[str, Any]) -> None:
    """One stop opens so slowly that its distance is roundoff for a while; meanwhile the other stop is hit."""
    scene = Scene(
        Body("a", inertia=0.31, velocity=-0.14034827701528618),
        Body("b", inertia=1.71, velocity=-1.8281830903657),
        Spring("a", "b", stiffness=95.44, damping=1.45),
        Stop("other", "a", "b", lower=-0.1, upper=0.3),
        Stop("slow", "a", "b", lower=-0.16, upper=0.3, radius_a=0.8, radius_b=-1.4),
        Force("a", piecewise_linear([0.22, 2.95, 3.6], [-7.95, 0.41, -7.13])),
    )
    exact = simulate(scene, (0.0, 3.0), method="series")
    found = simulate(scene, (0.0, 3.0), rtol=1e-10, atol=1e-12, **options)
    assert [event.cause for event in exact.events] == ["impact", "force 0", "impact", "impact", "force 0"]
    assert [event.t for event in found.events] == pytest.approx([event.t for event in exact.events], abs=1e-7)
    times = np.linspace(0.0, 3.0, 61)
    np.testing.assert_allclose(found(times), exact(times), atol=1e-7)


@pytest.mark.parametrize("force", [33.5, 37.0, 40.0, 42.5])
def test_a_run_may_end_within_roundoff_of_a_reversal(force: float) -> None:
    """What is left of the run is shorter than a brake of a Ravigneaux set takes to leave rest by more than roundoff."""
    scene = Scene(
        Body("in", inertia=0.22, velocity=82.0),
        *(Body(name, inertia=m) for name, m in (("s1", 0.0125), ("s2", 0.008), ("c", 0.0155), ("r", 2.6))),
        Tie("t1", {"s1": 1.0, "r": 1.44, "c": -2.44}),
        Tie("t2", {"s2": 1.0, "r": -3.54, "c": 2.54}),
        Contact("k1", "in", "s2", DryFriction(0.0585, 0.0585), normal=1776.0),
        Contact(
            "k2",
            "in",
            "c",
            DryFriction(0.0575, 0.0575, stribeck_velocity=3.75),
            normal=piecewise_linear([0.0225, 0.261], [470.0, 3394.0]),
        ),
        Contact("k3", "s1", GROUND, DryFriction(0.0235, 0.0188), normal=3034.0),
        OneWay("F1", GROUND, "c"),
        Force("in", force),
        Damper("r", GROUND, damping=0.81),
        Contact("load", "r", GROUND, DryFriction(20.0, 20.0), normal=0.854),
    )
    (reversal,) = (event.t for event in simulate(scene, (0.0, 0.15)).events if event.cause == "reversal")
    for places in (*range(-3, 4), -20, 20, -400, 400):
        end = simulate(scene, (0.0, reversal + places * math.ulp(reversal)))
        assert end.velocity("s1")[-1] == pytest.approx(0.0, abs=1e-6)
