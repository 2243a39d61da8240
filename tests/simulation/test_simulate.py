"""`simulate` against exact answers: reference scenes, coupled clutches, relaxation, holding; and what it costs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from reading import times, told
from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Mode,
    Result,
    Scene,
    Signal,
    Spring,
    Stop,
    piecewise_linear,
    simulate,
    sine,
    triangle,
    velocity,
)
from validation.exact import REFERENCES, reference
from validation.published import CLUTCH_EVENTS, CLUTCH_SPEEDS, coupled_clutches

METHODS = ("BDF", "Adams")
TIGHT: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-12}


# Reference scenes


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", REFERENCES)
def test_reference(name: str, method: str) -> None:
    story = reference(name)
    result = simulate(story.scene, (0.0, story.stop), method=method, t_eval=story.t, **TIGHT)
    assert told(result) == [event[1:] for event in story.events]
    exact = [event[0] for event in story.events]
    np.testing.assert_allclose(times(result), exact, rtol=0, atol=1e-7 * story.stop)
    scale = max(1.0, float(np.abs(story.velocities).max()))
    np.testing.assert_allclose(story.seen(result), story.velocities, rtol=0, atol=1e-6 * scale)
    positions = np.array([result.position(body) for body in story.bodies])
    if story.scene.springs:
        scale = max(1.0, float(np.abs(story.positions).max()))
        np.testing.assert_allclose(positions.T, story.positions, rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("name", REFERENCES)
def test_reference_by_series_is_exact(name: str) -> None:
    """The default engine leaves nothing but roundoff, with springs and without."""
    story = reference(name)
    result = simulate(story.scene, (0.0, story.stop), t_eval=story.t)
    assert result.stats["engine"] == "Taylor series"
    exact = [event[0] for event in story.events]
    np.testing.assert_allclose(times(result), exact, rtol=0, atol=3e-14 * max(1.0, story.stop))
    np.testing.assert_allclose(story.seen(result), story.velocities, rtol=0, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pulled-block", "two-blocks", "wave", "flywheels-4-viscous"])
def test_tolerances_buy_accuracy(name: str) -> None:
    story = reference(name)
    exact = np.array([event[0] for event in story.events])
    errors = []
    for rtol in (1e-6, 1e-8, 1e-10, 1e-12):
        result = simulate(story.scene, (0.0, story.stop), method="BDF", rtol=rtol, atol=rtol * 1e-2)
        assert told(result) == [event[1:] for event in story.events]
        errors.append(float(np.abs(np.array(times(result)) - exact).max()))
    assert errors[3] < 1e-8 * story.stop
    assert errors[1] < errors[0] and errors[3] < errors[1]


# Coupled clutches of the Modelica Standard Library


@pytest.mark.parametrize("method", METHODS)
def test_coupled_clutches(method: str) -> None:
    result = simulate(coupled_clutches(), (0.0, 1.5), method=method, **TIGHT)
    closed = [e for e in result.events if e.cause != "open"]
    assert [(e.contact, int(e.before), int(e.after)) for e in closed] == [e[1:] for e in CLUTCH_EVENTS]
    np.testing.assert_allclose([e.t for e in closed], [e[0] for e in CLUTCH_EVENTS], rtol=0, atol=1.5e-7)
    for i, speed in enumerate(CLUTCH_SPEEDS, 1):
        assert result.velocity(f"J{i}")[-1] == pytest.approx(speed, abs=1e-6)
    open_ = result.t > 1.25 + 1e-9
    assert np.all(result.force("clutch1")[open_] == 0) and np.all(result.normal("clutch1")[open_] == 0)


def test_coupled_clutches_stick_exactly_and_hold_within_their_levels() -> None:
    result = simulate(coupled_clutches(), (0.0, 1.5), **TIGHT)
    for name in ("clutch1", "clutch2", "clutch3"):
        stuck = (result.mode(name) == 0) & (result.normal(name) > 0)
        assert stuck.any()
        assert np.all(result.relative_velocity(name)[stuck] == 0)
        assert np.all(np.abs(result.force(name)[stuck]) <= result.breakaway(name)[stuck] * (1 + 1e-9))


# Relaxation: friction that vanishes with the velocity never crosses zero


def relaxing(load: Signal | float, normal: float = 10.0) -> Scene:
    return Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=2.0),
        Damper("a", "b", damping=3.0),
        Contact("c", "a", "b", DryFriction(mu_static=0.5, mu_coulomb=0.0), normal=normal),
        Force("a", load),
    )


@pytest.mark.parametrize("method", METHODS)
def test_relaxation_is_found_holds_and_lets_go(method: str) -> None:
    # stuck, the load F on body a asks F m_b / (m_a + m_b) of the contact: 7.5 N is the limit
    load = piecewise_linear([20, 25, 30, 35], [0, 6, 6, 9])
    result = simulate(relaxing(load), (0.0, 40.0), method=method)
    assert told(result) == [("c", 1, 0), ("c", 0, 1)]
    found, let_go = result.events
    assert found.cause == "relaxation" and let_go.cause == "breakaway"
    # w = exp(-4.5 t): found inside the margin of 1e-6, not before
    assert math.log(1e6) / 4.5 - 0.01 < found.t < math.log(1e12) / 4.5
    assert let_go.t == pytest.approx(32.5, abs=1e-9)
    stuck = result.mode("c") == 0
    assert np.all(result.relative_velocity("c")[stuck] == 0)
    assert result.velocity("a")[stuck][0] == pytest.approx(1 / 3, abs=1e-7)


def test_relaxation_keeps_holding_below_breakaway() -> None:
    result = simulate(relaxing(piecewise_linear([10, 20], [0, 7.4999])), (0.0, 1000.0))
    assert told(result) == [("c", 1, 0)]
    assert result.relative_velocity("c")[-1] == 0.0


@pytest.mark.parametrize("margin", [1e-3, 1e-5])
def test_relaxation_margin_is_the_velocity_found_at(margin: float) -> None:
    """The relative velocity is exp(-4.5 t)."""
    result = simulate(relaxing(0.0), (0.0, 10.0), velocity_margin=margin)
    (event,) = result.events
    assert event.cause == "relaxation"
    assert event.t == pytest.approx(-math.log(margin) / 4.5, rel=1e-9)
    first = result.t.searchsorted(event.t, side="left")
    # the velocities of the two bodies are of the order of 1: their difference has the roundoff of these
    assert 0 < result.relative_velocity("c")[first] <= margin + 1e-15
    assert margin < result.relative_velocity("c")[first - 1]


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("force", "changes"), [(-2e-7, [0]), (2e-7, [])])
def test_relaxation_is_the_same_in_both_directions(side: int, force: float, changes: list[int]) -> None:
    """A force far below the level of 5 N brings a body that it brakes to rest; driven, the body goes on with F / 3."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=side),
        Damper("a", GROUND, damping=3.0),
        Contact("c", "a", GROUND, DryFriction(mu_static=0.5, mu_coulomb=0.0), normal=10.0),
        Force("a", side * force),
    )
    result = simulate(scene, (0.0, 20.0))
    assert [int(event.after) for event in result.events] == changes
    if changes:
        # v = exp(-3 t) + F / 3 (1 - exp(-3 t)) comes to the margin of 1e-6 m/s, and not to 0
        assert result.events[0].cause == "relaxation"
        assert result.events[0].t <= math.log((1 - force / 3) / (1e-6 - force / 3)) / 3 + 1e-9
    else:
        assert result.velocity("a")[-1] == pytest.approx(side * force / 3, rel=1e-6)


@pytest.mark.parametrize("side", [1, -1])
def test_what_leaves_rest_does_not_relax_with_others(side: int) -> None:
    """Inside the margin b grows as exp(t), while a falls into it as exp(-3 t)."""
    rough = DryFriction(mu_static=0.5, mu_coulomb=0.0)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=1.0, velocity=1e-6 * side),
        Damper("a", GROUND, damping=3.0),
        Force("b", 1.0 * velocity("b")),
        Contact("of a", "a", GROUND, rough, normal=10.0),
        Contact("of b", "b", GROUND, rough, normal=10.0),
    )
    result = simulate(scene, (0.0, 5.0), velocity_margin=1e-3)
    assert [(event.contact, event.cause) for event in result.events] == [("of a", "relaxation")]
    assert result.velocity("b")[-1] == pytest.approx(1e-6 * side * math.exp(5.0), rel=1e-6)


@pytest.mark.parametrize("start", [-3.0, -3e4])
@pytest.mark.parametrize("method", ("series", *METHODS))
def test_before_time_0_all_is_the_same(method: str, start: float) -> None:
    """a slows down from 1 m/s with 1 m/s2; the load on b rises with 3 N/s to 6 N, past the level of 2 N at 2/3 s."""
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=v) for name, v in (("a", 1.0), ("b", 0.0))),
        *(Contact(f"of {name}", name, GROUND, DryFriction(0.2, 0.1), normal=10.0) for name in "ab"),
        Force("b", piecewise_linear([start, start + 2.0], [0.0, 6.0])),
    )
    result = simulate(scene, (start, start + 2.0), method=method)
    assert told(result) == [("of b", 0, 1), ("of a", 1, 0)]
    assert [event.t for event in result.events] == pytest.approx([start + 2 / 3, start + 1.0], abs=1e-8, rel=0)
    assert result.t[0] == start and result.t[-1] == start + 2.0
    # impulse of the load after 2/3 s: 6 N s - 2/3 N s; friction: 1 N for 4/3 s
    assert result.velocity("b")[-1] == pytest.approx(6.0 - 2 / 3 - 4 / 3, abs=1e-7)


def test_without_a_velocity_margin_relaxation_is_never_found() -> None:
    """w falls to the solver's errors; below them its sign means nothing. Only with a margin is there an event."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Damper("a", GROUND, damping=3.0),
        Contact("c", "a", GROUND, DryFriction(mu_static=0.5, mu_coulomb=0.0), normal=10.0),
    )
    options: dict[str, Any] = {"rtol": 1e-8, "atol": 1e-200}
    never = simulate(scene, (0.0, 20.0), velocity_margin=0.0, **options)
    assert not never.events
    assert never.sample([5.0]).velocity("a")[0] == pytest.approx(math.exp(-15.0), rel=1e-7)
    (event,) = simulate(scene, (0.0, 20.0), velocity_margin=1e-6, **options).events
    assert event.t == pytest.approx(math.log(1e6) / 3, rel=1e-7)
    assert event.cause == "relaxation"


def test_a_body_decelerating_through_the_margin_is_not_relaxed() -> None:
    """The margin alone decides nothing: a true crossing is found by its root, exactly."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Damper("a", GROUND, damping=0.5),
        Contact("c", "a", GROUND, DryFriction(0.2, 0.1), normal=10.0),
    )
    result = simulate(scene, (0.0, 5.0), velocity_margin=0.1, **TIGHT)
    (event,) = result.events
    assert event.cause == "relative velocity 0"
    assert event.t == pytest.approx(2.0 * math.log(1.5), abs=1e-8)


# Holding for 1e6 s


def train(amplitude: float, count: int, spacing: float) -> Signal:
    signs = np.where(np.arange(count + 1) % 2, amplitude, -amplitude)
    return piecewise_linear(np.arange(count + 1) * spacing, signs)


HOLD = 1e6
LOADS = {
    "triangles": (train(4.999, 500, HOLD / 500), HOLD),
    "sine 0.01 Hz": (sine(4.999, 0.01), HOLD),
    "sine 1 Hz": (sine(4.5, 1.0), HOLD),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", LOADS)
def test_a_stuck_contact_does_not_creep(kind: str) -> None:
    load, stop = LOADS[kind]
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, DryFriction(0.5, 0.4), normal=10.0),
        Force("a", load),
    )
    result = simulate(scene, (0.0, stop))
    assert not result.events
    assert np.all(result.velocity("a") == 0) and np.all(result.position("a") == 0)
    assert np.abs(result.force("c")).max() > 4.9 or kind != "triangles"


@pytest.mark.parametrize("kind", LOADS)
def test_bodies_stuck_to_each_other_do_not_drift_apart(kind: str) -> None:
    """Both move, pushed to and fro and bound by springs; their relative velocity is exactly zero."""
    load, stop = LOADS[kind]
    stop /= 1e4 if kind == "sine 1 Hz" else 1e3
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.3, position=0.25),
        Body("b", inertia=3.0, velocity=0.3),
        Contact("c", "a", "b", DryFriction(2.0, 1.5), normal=10.0),
        Spring("b", GROUND, stiffness=2.0, damping=1.0),
        Spring("a", "b", stiffness=4.0),
        Force("a", load),
    )
    result = simulate(scene, (0.0, stop))
    assert not result.events
    assert np.all(result.relative_velocity("c") == 0)
    apart = result.position("a") - result.position("b")
    assert np.abs(apart - 0.25).max() <= 1e-12 * np.abs(result.position("a")).max()
    assert np.ptp(result.velocity("a")) > 0.1


@pytest.mark.parametrize(
    "velocity",
    [
        pytest.param(
            piecewise_linear([0.0, 10.0, 20.0, 30.0], [0.0, 5.0, -5.0, 0.0]),
            marks=pytest.mark.xfail(strict=True, reason="body and drive are read off differently: 1 ulp apart"),
        ),
        sine(2.0, 0.05),
        sine(1.0, 0.1) + 0.25,
    ],
    ids=["piecewise", "sine", "offset"],
)
def test_a_body_stuck_to_an_accelerating_drive_follows_it_exactly(velocity: Signal) -> None:
    scene = Scene(
        Body("a", inertia=2.0, velocity=velocity(0.0)),
        Drive("belt", velocity=velocity),
        Contact("c", "a", "belt", DryFriction(0.5, 0.4), normal=10.0),
    )
    result = simulate(scene, (0.0, 60.0))
    assert not result.events
    assert np.all(result.relative_velocity("c") == 0)
    if velocity.period:
        np.testing.assert_allclose(result.force("c"), [-2.0 * velocity.slope(t) for t in result.t], atol=1e-9)
    sampled = simulate(scene, (0.0, 60.0), t_eval=np.linspace(0, 60, 301))
    assert np.all(sampled.relative_velocity("c") == 0)
    np.testing.assert_array_equal(sampled.velocity("a"), [velocity(t) for t in sampled.t])


def test_a_body_with_a_spring_stuck_to_the_ground_stays_where_it_is() -> None:
    scene = Scene(
        Body("a", inertia=1.0, position=0.3),
        Contact("c", "a", GROUND, DryFriction(0.5, 0.4), normal=10.0),
        Spring("a", GROUND, stiffness=10.0),
        Force("a", train(1.999, 200, 5000.0)),
    )
    result = simulate(scene, (0.0, HOLD))
    assert not result.events
    assert np.all(result.velocity("a") == 0) and np.all(result.position("a") == 0.3)


# What it costs


def benchmark() -> Scene:
    dry = DryFriction(mu_static=0.2, mu_coulomb=0.1, dwell=0.1)
    pulses = triangle(0.05, 0.10, 0.15, slope=3000) + triangle(0.4, 0.5, 0.6, slope=3000)
    return Scene(
        Body("wheel1", inertia=1.0, velocity=1.0),
        Body("wheel2", inertia=10.0, velocity=1.01),
        Contact("interface", "wheel1", "wheel2", dry, normal=100.0),
        Contact("brake", "wheel1", GROUND, dry, normal=pulses),
    )


BENCHMARK = [
    (0.000909090909090909, "interface", Mode.BACKWARD, Mode.STUCK),
    (0.473006762576147516, "interface", Mode.STUCK, Mode.BACKWARD),
    (0.527593338990130857, "brake", Mode.FORWARD, Mode.STUCK),
    (0.575899715052702889, "brake", Mode.STUCK, Mode.FORWARD),
    (0.653395901643388061, "interface", Mode.BACKWARD, Mode.STUCK),
]


@pytest.mark.parametrize("method", ["auto", *METHODS])
def test_benchmark_and_its_economy(method: str) -> None:
    result = simulate(benchmark(), (0.0, 4.0), method=method)
    assert [(e.contact, e.before, e.after) for e in result.events] == [e[1:] for e in BENCHMARK]
    exact = method == "auto"
    np.testing.assert_allclose(times(result), [e[0] for e in BENCHMARK], rtol=0, atol=1e-15 if exact else 1e-8)
    assert result.velocity("wheel1")[-1] == pytest.approx(0.687838305725714362, rel=1e-15 if exact else 1e-8)
    stats = result.stats
    # no springs, so no positions; one guard for a slipping contact and two for a stuck one; none for an open brake
    assert stats["states"] == 2
    assert stats["guards"] == 3
    assert stats["restarts"] == 5 + 6
    assert stats["events"] == 5
    assert stats["solvers"] == (0 if exact else 1)
    assert stats["steps"] <= (16 if exact else 200)
    assert stats["rate_calls"] <= (64 if exact else 400)
    assert stats["jacobian_calls"] <= (0 if exact else 32)
    assert stats["guard_calls"] <= (0 if exact else 400)


def test_a_contact_without_friction_or_load_costs_nothing() -> None:
    scene = benchmark()
    idle = [
        Contact("smooth", "wheel2", GROUND, DryFriction(0.0, 0.0), normal=100.0),
        Contact("apart", "wheel2", GROUND, DryFriction(0.2, 0.1), normal=0.0),
        Contact("pulled", "wheel2", GROUND, DryFriction(0.2, 0.1), normal=-5.0),
    ]
    bare = simulate(scene, (0.0, 4.0))
    more = simulate(Scene(*scene.elements, *idle), (0.0, 4.0))
    assert told(more) == told(bare)
    np.testing.assert_allclose(times(more), times(bare), rtol=1e-13)
    for count in ("states", "guards", "restarts", "events", "rate_calls", "jacobian_calls"):
        assert more.stats[count] == bare.stats[count]
    for contact in idle:
        assert np.all(more.force(contact.name) == 0)


def test_states_and_guards_follow_the_scene() -> None:
    law = DryFriction(0.5, 0.4)
    slider = Body("a", inertia=1.0, velocity=1.0), Contact("c", "a", GROUND, law, normal=1.0)
    assert simulate(Scene(*slider), (0.0, 0.1)).stats["guards"] == 1
    assert simulate(Scene(*slider), (0.0, 0.1)).stats["states"] == 1
    assert simulate(Scene(*slider), (0.0, 9.0)).stats["guards"] == 2
    sprung = Scene(*slider, Spring("a", GROUND, stiffness=1.0))
    assert simulate(sprung, (0.0, 0.1)).stats["states"] == 2
    damped = Scene(*slider, Spring("a", GROUND, stiffness=0.0, damping=1.0))
    assert simulate(damped, (0.0, 0.1)).stats["states"] == 1
    frictionless = Scene(Body("a", inertia=1.0, velocity=1.0))
    assert simulate(frictionless, (0.0, 9.0)).stats["guards"] == 0


def test_restarts_are_events_and_breaks() -> None:
    load = train(0.2, 50, 1.0)
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, DryFriction(0.5, 0.4), normal=1.0),
        Force("a", load),
    )
    stats = simulate(scene, (0.0, 50.0)).stats
    assert stats["restarts"] == 49 and stats["events"] == 0
    assert stats["rate_calls"] <= 2 * 50


# Outputs


OUTPUTS = {
    "benchmark": (benchmark(), 1.0),
    "clutches": (coupled_clutches(), 1.5),
    "pulled block": (reference("pulled-block-dwell").scene, 40.0),
}


@pytest.mark.parametrize("kind", OUTPUTS)
def test_outputs_at_requested_times_agree_with_the_whole_result(kind: str) -> None:
    scene, stop = OUTPUTS[kind]
    whole = simulate(scene, (0.0, stop))
    wanted = np.linspace(0.0, stop, 173)
    dense = simulate(scene, (0.0, stop), t_eval=wanted)
    lean = simulate(scene, (0.0, stop), t_eval=wanted, dense_output=False)
    np.testing.assert_array_equal(dense.t, wanted)
    np.testing.assert_array_equal(lean.t, wanted)
    # each processor adds products in an order of its own
    np.testing.assert_allclose(dense.y, lean.y, rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose(dense.y, whole(wanted), rtol=0, atol=1e-11)
    assert times(dense) == times(lean) == times(whole)
    at_points = whole(whole.t)
    inside = ~np.isin(whole.t, times(whole))
    np.testing.assert_allclose(at_points[:, inside], whole.y[:, inside], rtol=0, atol=1e-13)
    for contact in scene.contacts:
        name = contact.name
        for quantity in ("force", "breakaway", "mode", "normal", "power", "relative_velocity"):
            a, b = getattr(dense, quantity)(name), getattr(lean, quantity)(name)
            np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12, err_msg=f"{name} {quantity}")
    for body in scene.bodies:
        a, b = dense.velocity(body.name), lean.velocity(body.name)
        np.testing.assert_allclose(a, b, rtol=1e-15, atol=1e-15)
        everywhere = simulate(scene, (0.0, stop), t_eval=np.union1d(wanted, whole.t)).position(body.name)
        np.testing.assert_allclose(
            dense.position(body.name),
            everywhere[np.searchsorted(np.union1d(wanted, whole.t), wanted)],
            atol=1e-12,
        )


@pytest.mark.parametrize("kind", OUTPUTS)
def test_every_event_stands_twice(kind: str) -> None:
    scene, stop = OUTPUTS[kind]
    result = simulate(scene, (0.0, stop))
    for event in result.events:
        at = np.flatnonzero(result.t == event.t)
        assert at.size >= 2
        modes = result.mode(event.contact)[at]
        assert modes[0] == event.before and modes[-1] == event.after


def test_positions_are_the_integrals_of_velocities() -> None:
    result = simulate(benchmark(), (0.0, 1.0))
    fine = np.linspace(0.0, 1.0, 200_001)
    for body in ("wheel1", "wheel2"):
        v = result(fine)[["wheel1", "wheel2"].index(body)]
        integral = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(fine))])
        np.testing.assert_allclose(result.position(body), np.interp(result.t, fine, integral), atol=1e-6)


def test_reruns_are_bit_identical() -> None:
    for scene, stop in OUTPUTS.values():
        first, second = simulate(scene, (0.0, stop)), simulate(scene, (0.0, stop))
        assert first.events == second.events
        assert first.t.tobytes() == second.t.tobytes() and first.y.tobytes() == second.y.tobytes()
        assert first.stats == second.stats


def test_a_breakaway_under_a_curved_normal_force_late_in_time_is_settled_at_once() -> None:
    """At 64 s a root rounds to a time 1e-14 s before it: the guard is positive there, yet counts as at its limit."""
    law = DryFriction(0.3, 0.2)
    for start in (0.0, 64.0):
        normal = sine(4.5, 1.377, phase=-550.166 - 2 * math.pi * 1.377 * (start - 64.0), offset=15.0)
        scene = Scene(
            Body("a", inertia=1.0, position=0.0),
            Drive("plate", velocity=1.0),
            Contact("floor", "a", GROUND, law, normal=normal),
            Spring("a", "plate", stiffness=10.0),
        )
        result = simulate(scene, (start, start + 3.0))
        assert [event.after for event in result.events if event.contact == "floor"][:2] == [1, 0]
        # the spring pulls with 10 (t - start), the level is 0.3 N
        pull = brentq(lambda s, load=normal, start=start: 10 * s - 0.3 * load(start + s), 0.0, 1.0, xtol=1e-14)
        assert result.events[0].t == pytest.approx(start + pull, abs=1e-12)
        assert result.stats["restarts"] < 20


@pytest.mark.parametrize("longest", [1.0, 0.1, 0.01])
def test_a_longest_step_adds_points_and_changes_nothing_else(longest: float) -> None:
    free = simulate(benchmark(), (0.0, 4.0))
    result = simulate(benchmark(), (0.0, 4.0), max_step=longest)
    assert told(result) == told(free)
    assert times(result) == pytest.approx(times(free), abs=1e-15)
    assert np.diff(result.t).max() <= longest * (1 + 1e-12)
    assert result.y[:, -1].tolist() == pytest.approx(free.y[:, -1].tolist(), abs=1e-15)


@pytest.mark.parametrize("formulation", ["contact-force", "merged", "multiplier"])
def test_outputs_before_a_break_do_not_see_the_loads_behind_it(formulation: str) -> None:
    """Far above the Stribeck velocity v = 20 - 10 (t - t^2/2), until the normal force has fallen to 0 at 1 s."""
    law = DryFriction(0.3, 0.2, stribeck_velocity=0.05)
    scene = Scene(
        Body("w", inertia=1.0, velocity=20.0),
        Contact("c", "w", GROUND, law, normal=piecewise_linear([0, 1], [50, 0])),
    )
    t = np.linspace(0, 1, 401)
    result = simulate(scene, (0.0, 2.0), t_eval=t, rtol=1e-10, atol=1e-13, formulation=formulation)
    np.testing.assert_allclose(result.velocity("w"), 20 - 10 * (t - t * t / 2), atol=2e-9)


def test_what_rests_goes_on_by_series_where_the_engine_is_chosen() -> None:
    """While a block rides on the belt ``x = x_s + 0.2 (t - t_s)``; it lets go where the spring pulls with 1 N."""
    law = DryFriction(1.0, 1.0, kinetic=lambda v: 1.0 / (1.0 + 3.0 * abs(v)))
    scene = Scene(
        Drive("belt", velocity=0.2),
        Body("block", inertia=1.0),
        Contact("friction", "block", "belt", law, normal=1.0),
        Spring("block", GROUND, stiffness=1.0),
    )
    chosen, asked = (simulate(scene, (0.0, 40.0), method=method) for method in ("auto", "BDF"))
    assert told(chosen) == told(asked)
    assert chosen.stats["engine"] == asked.stats["engine"] == "CVODE BDF"
    assert chosen.stats["steps"] < asked.stats["steps"]
    sticks, breaks = (np.array([e.t for e in chosen.events if (e.before == 0) is goes]) for goes in (False, True))
    sticks = sticks[: breaks.size]
    np.testing.assert_allclose(breaks, sticks + (1.0 - chosen(sticks)[1]) / 0.2, rtol=0, atol=1e-14)


def test_tolerances_mean_the_same_in_small_units_of_length() -> None:
    """A block is pushed against a wall and rebounds. Without springs only the time span gives a scale of length."""

    def run(length: float, time: float) -> Result:
        speed, force = length / time, length / time**2
        law = DryFriction(0.3, 0.2, stribeck_velocity=0.3 * speed)
        scene = Scene(
            Body("block", inertia=1.0, velocity=-0.5 * speed),
            Contact("floor", "block", GROUND, law, normal=force),
            Stop("wall", "block", GROUND, upper=0.25 * length, restitution=0.9),
            Force("block", 0.7 * force),
        )
        return simulate(scene, (0.0, 3.0 * time), atol=1e-10 * speed)

    base = run(1e-6, 1e-3)
    for length, time in ((1e-3, 1e-6), (1e-6, 1e-6)):
        other = run(length, time)
        np.testing.assert_allclose(np.array(times(other)) / time, np.array(times(base)) / 1e-3, rtol=1e-9, atol=0)
