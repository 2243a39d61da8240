"""Events of the user: located exactly, noted or stopping, without changing the motion."""

from __future__ import annotations

import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Mode,
    Sampled,
    Scene,
    SimulationError,
    Spring,
    Stop,
    When,
    explain,
    feedback,
    load,
    normal,
    output,
    piecewise_linear,
    position,
    power,
    relative_velocity,
    saturate,
    simulate,
    sine,
    table,
    velocity,
)

WAYS: list[dict[str, Any]] = [{}, {"method": "BDF"}, {"formulation": "merged"}, {"formulation": "multiplier"}]


def thrown() -> Scene:
    """A body thrown up at 10 m/s from -1 m: x = -1 + 10 t - 5 t^2, beside a block that friction stops at 2 s."""
    return Scene(
        Body("ball", inertia=1.0, velocity=10.0, position=-1.0),
        Body("block", inertia=1.0, velocity=2.0),
        Force("ball", -10.0),
        Contact("rub", "block", GROUND, DryFriction(0.1, 0.1), normal=10.0),
    )


FIRST, SECOND = 1 - math.sqrt(0.8), 1 + math.sqrt(0.8)


@pytest.mark.parametrize("way", WAYS)
def test_crossings_are_located_and_noted(way: dict[str, Any]) -> None:
    events = [
        When("level", position("ball")),
        When("up", position("ball"), direction=1),
        When("down", position("ball"), direction=-1),
        When("top", velocity("ball") * 2.0),
        When("late", TIME - 2.5),
        When("code", feedback(lambda v: v * v - 1.0, velocity("block"))),
    ]
    plain = simulate(thrown(), (0.0, 3.0), rtol=1e-10, **way)
    result = simulate(thrown(), (0.0, 3.0), rtol=1e-10, events=events, **way)
    assert result.stats["engine"] == plain.stats["engine"]
    found = [(event.contact, event.t, int(event.after)) for event in result.events]
    exact = [
        ("level", FIRST, 1),
        ("up", FIRST, 1),
        ("code", 1.0, -1),
        ("top", 1.0, -1),
        ("level", SECOND, -1),
        ("down", SECOND, -1),
        ("rub", 2.0, 0),
        ("late", 2.5, 1),
    ]
    assert sorted((name, sign) for name, _, sign in found) == sorted((name, sign) for name, _, sign in exact)
    tolerance = 1e-13 if result.stats["engine"] == "Taylor series" else 1e-8
    np.testing.assert_allclose(sorted(t for _, t, _ in found), sorted(t for _, t, _ in exact), rtol=0, atol=tolerance)
    assert result.events[0].cause == "rose through 0"
    assert (result.events[0].before, result.events[0].after) == (Mode.BACKWARD, Mode.FORWARD)
    assert abs(result.velocity("ball")[-1] - plain.velocity("ball")[-1]) < 1e-12
    assert "level" in str(result) and "level" in result.explain()


@pytest.mark.parametrize("way", WAYS)
def test_an_event_may_stop_the_run(way: dict[str, Any], tmp_path: Path) -> None:
    events = [When("down", position("ball"), direction=-1, stop=True), When("late", TIME - 1.95)]
    result = simulate(thrown(), (0.0, 3.0), rtol=1e-10, events=events, **way)
    assert (result.success, result.status) == (True, 1)
    assert result.message.startswith("event 'down' stopped the simulation at t = 1.8944")
    assert [event.contact for event in result.events] == ["down"]
    assert abs(result.t[-1] - SECOND) < 1e-8
    assert abs(result.position("ball")[-1]) < 1e-7
    # it goes on, and does not stop at once
    scene = result.final_scene()
    rest = simulate(scene, (float(result.t[-1]), 3.0), rtol=1e-10, events=events, **way)
    assert (rest.status, [event.contact for event in rest.events]) == (0, ["late", "rub"])
    assert abs(rest.position("ball")[-1] + 16.0) < 1e-7
    result.save(tmp_path / "run.npz")
    again = load(tmp_path / "run.npz")
    np.testing.assert_array_equal(again.position("ball"), result.position("ball"))


def test_many_crossings_of_a_sine_within_one_step() -> None:
    """No body moves, so that the series takes one step; only the load oscillates, 40 times."""
    scene = Scene(
        Body("m", inertia=1.0),
        Contact("rub", "m", GROUND, DryFriction(1.0, 1.0), normal=10.0),
        Force("m", sine(1.0, 4.0)),
    )
    result = simulate(scene, (0.0, 10.0), events=[When("zero", feedback(lambda s: s + 0.5, sine(1.0, 4.0)))])
    # sin = -1/2 at 7/12 and 11/12 of each period
    exact = sorted([(k + part) / 4 for k in range(40) for part in (7 / 12, 11 / 12)])
    np.testing.assert_allclose([event.t for event in result.events], exact, rtol=0, atol=1e-12)


def test_two_crossings_close_to_each_other_and_one_that_only_touches() -> None:
    scene = Scene(Body("m", inertia=1.0, velocity=-1.0, position=0.5), Force("m", 1.0))
    # x = (t - 1)^2 / 2
    events = [When("touch", position("m")), When("near", position("m") - 5e-13)]
    result = simulate(scene, (0.0, 2.0), events=events)
    assert [event.contact for event in result.events] == ["near", "near"]
    np.testing.assert_allclose([event.t for event in result.events], [1 - 1e-6, 1 + 1e-6], rtol=0, atol=1e-9)


def test_quantities_that_jump_cross_by_jumping() -> None:
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("rub", "m", GROUND, DryFriction(0.5, 0.5), normal=1.0),
        Sampled("count", period=0.25, states=0.0, update=lambda t, x, u: x + 1, output=lambda t, x, u: x),
    )
    events = [
        When("third", output("count") - 2.5),
        When("hot", power("rub") - 0.25),
        When("normal", normal("rub") - 2),
    ]
    result = simulate(scene, (0.0, 3.0), events=events)
    assert [(event.contact, event.after) for event in result.events] == [
        ("third", 1),
        ("hot", -1),
        ("rub", 0),
    ]
    np.testing.assert_allclose([event.t for event in result.events], [0.75, 1.0, 2.0], rtol=0, atol=1e-12)


def test_watched_positions_change_no_result() -> None:
    """A scene in which no position is a state gets one for the event only."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=0.5),
        Drive("belt", velocity=sine(1.0, 1.0)),
        Contact("rub", "m", "belt", DryFriction(0.5, 0.3), normal=3.0),
        Spring("m", GROUND, stiffness=1.0),
    )
    plain = simulate(scene, (0.0, 5.0))
    event = When("lap", position("belt") - 0.1)
    watched = simulate(scene, (0.0, 5.0), events=[event, When("slip", relative_velocity("rub"), direction=1)])
    own = [e for e in watched.events if e.contact == "rub"]
    np.testing.assert_allclose([e.t for e in own], [e.t for e in plain.events], rtol=0, atol=1e-12)
    # the belt's position is (1 - cos(2 pi t)) / (2 pi)
    first = math.acos(1 - 0.2 * math.pi) / (2 * math.pi)
    assert abs(next(e.t for e in watched.events if e.contact == "lap") - first) < 1e-12
    assert "Events" in explain(watched)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: When("", TIME), "When: name must be a name"),
        (lambda: When("a", math.sin), "event 'a': quantity must be a quantity, a signal or a number"),  # type: ignore[arg-type]
        (lambda: When("a", TIME, direction=2), "event 'a': direction must be -1, 0 or"),
        (lambda: When("a", TIME, stop=1), "event 'a': stop must be True or False"),  # type: ignore[arg-type]
        (
            lambda: simulate(thrown(), (0, 1), events=[When("a", position("x"))]),
            "event 'a': no body is called 'x'",
        ),
        (
            lambda: simulate(thrown(), (0, 1), events=[When("rub", TIME)]),
            "event 'rub' has the name of another",
        ),
        (lambda: simulate(thrown(), (0, 1), events=[TIME]), "events must be When"),  # type: ignore[list-item]
        (lambda: simulate(thrown(), (0, 1), events=3), "events must be a sequence of When"),  # type: ignore[arg-type]
    ],
)
def test_what_is_refused(make: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        make()


@pytest.mark.parametrize("method", ["series", "BDF"])
def test_a_function_that_turns_often_within_a_step_is_counted(method: Any) -> None:
    """An encoder: v = exp(-0.1 t), so sin(100 x) has passed 0 at every multiple of pi/100 below 10 (1 - 1/e)."""
    scene = Scene(Body("b", inertia=1.0, velocity=1.0), Force("b", -0.1 * velocity("b")))
    tick = When("tick", feedback(lambda x: math.sin(100 * x), position("b")))
    result = simulate(scene, (0.0, 10.0), method=method, events=[tick])
    way = np.arange(1, int(1000 * -math.expm1(-1) / math.pi) + 1) * math.pi / 100
    assert [e.t for e in result.events] == pytest.approx((-10 * np.log1p(-way / 10)).tolist(), abs=1e-6)


@pytest.mark.parametrize("way", [*WAYS, {"method": "RK4", "step": 1e-3}])
def test_what_comes_to_0_and_stays_there_is_an_event(way: dict[str, Any]) -> None:
    """A cone of 20 N m brings 0.1 kg m² at 100 rad/s to 20 kg m² at 50 rad/s after 50 / (20 (1 / 0.1 + 1 / 20)) s."""
    scene = Scene(
        Body("input", inertia=0.1, velocity=100.0),
        Body("output", inertia=20.0, velocity=50.0),
        Contact("cone", "input", "output", DryFriction(1.0, 1.0), normal=20.0),
        Force("input", piecewise_linear([1.0, 1.0], [0.0, 50.0])),
    )
    when = 50 / (20 * (10 + 0.05))
    events = [
        When("synchronous", relative_velocity("cone")),
        When("equal", velocity("output") - velocity("input"), direction=1),
        When("never", relative_velocity("cone"), direction=1),
    ]
    result = simulate(scene, (0.0, 2.0), events=events, **way)
    if "step" in way:
        # a step goes beyond 0 before it sticks
        found = {event.contact: event.cause for event in result.events if event.contact != "cone"}
        assert found == {"synchronous": "fell through 0", "equal": "rose through 0"} and len(result.events) == 4
        return
    tolerance = 1e-13 if way == {} else 1e-8
    cone, synchronous, equal, slips = result.events
    assert (cone.contact, slips.contact, slips.t) == ("cone", "cone", 1.0)  # leaving 0 is no event
    assert (synchronous.contact, synchronous.after, synchronous.cause) == (
        "synchronous",
        Mode.STUCK,
        "fell to 0",
    )
    assert (equal.contact, equal.before, equal.cause) == ("equal", Mode.BACKWARD, "rose to 0")
    assert abs(synchronous.t - when) < tolerance and synchronous.t == equal.t == cone.t
    events = [When("synchronous", relative_velocity("cone"), stop=True)]
    stopped = simulate(scene, (0.0, 2.0), events=events, **way)
    assert (stopped.status, stopped.t[-1]) == (1, synchronous.t)
    further = simulate(stopped.final_scene(), (float(stopped.t[-1]), 2.0), events=events, **way)
    assert further.status == 0 and [event.contact for event in further.events] == ["cone"]


@pytest.mark.slow
@pytest.mark.parametrize("limit", [0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("way", [*WAYS, {"method": "RK4", "step": 0.01}])
def test_what_is_cut_off_comes_to_its_limit_and_stays(way: dict[str, Any], limit: float) -> None:
    """Only the events read the cut velocity: v = cos t is above the limit up to acos(limit), and again before 2 pi."""
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Spring("a", GROUND, stiffness=1.0))
    cut = saturate(velocity("a"), -limit, limit)
    events = [When("top", cut - limit), When("bottom", cut + limit), When("middle", cut)]
    found = [(e.t, e.contact, e.cause) for e in simulate(scene, (0.0, 6.5), events=events, **way).events]
    corner = math.acos(limit)
    assert [one[1:] for one in found] == [
        ("middle", "fell through 0"),
        ("bottom", "fell to 0"),
        ("middle", "rose through 0"),
        ("top", "rose to 0"),
    ]
    exact = [0.5 * math.pi, math.pi - corner, 1.5 * math.pi, 2 * math.pi - corner]
    assert [one[0] for one in found] == pytest.approx(exact, abs=1e-6 if way else 1e-11)


@pytest.mark.parametrize("way", [*WAYS, {"method": "RK4", "step": 0.25}])
def test_a_limit_that_is_reached_at_the_end_of_a_step(way: dict[str, Any]) -> None:
    scene = Scene(Body("a", inertia=1.0, velocity=1.0))
    full = When("full", saturate(position("a"), -1.0, 3.0) - 3.0, stop=True)
    (event,) = simulate(scene, (0.0, 10.0), events=[full], **way).events
    assert (event.cause, event.t) == ("rose to 0", pytest.approx(3.0, abs=1e-12))


def test_a_function_that_fails_names_its_event() -> None:
    scene = Scene(Body("a", inertia=1.0, velocity=1.0))
    events = [
        When("far", position("a") - 9.0),
        When("pole", feedback(lambda v: 1.0 / (v - 1.0), velocity("a"))),
    ]
    with pytest.raises(SimulationError, match=r"event 'pole': feedback function .* raised ZeroDivisionError"):
        simulate(scene, (0.0, 1.0), events=events)


def test_what_dies_away_does_not_come_to_0() -> None:
    """Two bodies on a damper: their difference falls as exp(-20 t), to roundoff long before the load changes."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=1.0, velocity=2.0),
        Damper("a", "b", damping=10.0),
        *[Force(name, piecewise_linear([3.0, 4.0], [0.0, 1.0])) for name in "ab"],
    )
    events = [When("equal", velocity("b") - velocity("a"))]
    assert simulate(scene, (0.0, 6.0), events=events).events == []


def test_a_stop_that_closes_brings_a_velocity_to_0() -> None:
    """A ball of restitution 1/2 falls 5 m: it rests after 1 + 2 (1/2 + 1/4 + ...) = 3 s."""
    scene = Scene(
        Body("ball", inertia=1.0, position=5.0),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=0.5),
        Force("ball", -10.0),
    )
    result = simulate(scene, (0.0, 4.0), events=[When("v", velocity("ball"))])
    assert (result.events[-1].contact, result.events[-1].cause) == ("v", "rose to 0")
    assert abs(result.events[-1].t - 3.0) < 1e-9


@pytest.mark.parametrize("rtol", [1e-8, 1e-11])
@pytest.mark.parametrize("seed", [*range(0, 60, 6), 131, 174])
def test_the_power_of_friction_does_not_fall_through_0(seed: int, rtol: float) -> None:
    """``P = r w`` is 0 where slip reverses, and never below: it may come to 0 and stay, or rise from there."""
    u = random.Random(seed).uniform
    scene = Scene(
        Body("m", inertia=u(0.5, 2), velocity=u(-1, 1)),
        Drive("belt", velocity=sine(u(0.3, 1), u(0.1, 0.5), u(0, 6), u(-0.3, 0.3))),
        Contact("c", "m", "belt", DryFriction(0.5, 0.5), normal=u(0.5, 1)),
        Force("m", sine(u(1, 3), u(0.1, 0.5), u(0, 6))),
    )
    result = simulate(scene, (0.0, 6.0), rtol=rtol, events=[When("p", power("c"))])
    assert any(event.cause == "reversal" for event in result.events)
    assert not [event for event in result.events if event.contact == "p" and "through" in event.cause]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("limit", [0.0, 0.25])
def test_what_bounces_on_a_limit_comes_to_it_once(limit: float, way: dict[str, Any]) -> None:
    """A ball of restitution 1/2 falls 1 m under 10 m/s^2. It rests after sqrt(0.2) (1 + 2 (1/2 + 1/4 + ...)) s.

    Until then its height is a roundoff of the first fall off 0 at every impact, at a limit of 0, too. Flights of this
    roundoff take 1e-7 s, solvers leave out flights of 1e-4 s.
    """
    scene = Scene(
        Body("ball", inertia=1.0, position=1.0 + limit),
        Stop("floor", "ball", GROUND, lower=limit, restitution=0.5),
        Force("ball", -10.0),
    )
    events = [When("height", position("ball") - limit), When("up", position("ball") - limit, direction=1, stop=True)]
    result = simulate(scene, (0.0, 2.0), events=events, **way)
    (only,) = (event for event in result.events if event.contact != "floor")
    assert (only.contact, only.cause) == ("height", "fell to 0")
    assert abs(only.t - 3 * math.sqrt(0.2)) < (1e-4 if way else 3e-7)
    assert result.t[-1] == 2.0


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("start", [0.5, 0.513, 0.526, 0.539])
def test_the_edge_of_a_dead_band_is_no_event(way: dict[str, Any], start: float) -> None:
    """A block lets go, moves forward and sticks again: a quantity that is 0 for all v >= 0 has no event."""
    scene = Scene(
        Body("b", inertia=1.0),
        Contact("c", "b", GROUND, DryFriction(0.3, 0.2), normal=10.0),
        Force("b", piecewise_linear([start, start, start + 0.3, start + 0.3], [0.0, 4.0, 4.0, 0.0])),
    )
    v = velocity("b")
    events = [
        When("cut off", saturate(v, -1.0, 0.0), stop=True),
        When("dead band", table(v, [-1.0, 0.0, 1.0], [-1.0, 0.0, 0.0]), stop=True),
    ]
    result = simulate(scene, (0.0, 2.0), events=events, **way)
    assert [(e.contact, e.after) for e in result.events] == [("c", 1), ("c", 0)] and result.status == 0


@pytest.mark.parametrize("way", [*WAYS, {"max_step": 1e9}])
@pytest.mark.parametrize("many", [1, 20])
def test_what_was_computed_before_a_function_fails_is_kept(way: dict[str, Any], many: int) -> None:
    """``x = t^2 / 2``: the function of an event fails from 1 s on; scenes of many are followed part by part."""

    def known_to_half(x: float) -> float:
        if x > 0.5:
            raise ValueError("beyond")
        return x - 7.0

    scene = Scene(*(Body(f"b{i}", inertia=1.0) for i in range(many)), *(Force(f"b{i}", 1.0) for i in range(many)))
    events = [When("far", feedback(known_to_half, position("b0")))]
    with pytest.raises(SimulationError, match=r"event 'far': .*beyond") as failed:
        simulate(scene, (0.0, 2.0), events=events, **way)
    result = failed.value.result
    assert 0.98 < failed.value.t <= 1.0 and result.t[-1] == failed.value.t
    assert result.velocity("b0")[-1] == pytest.approx(failed.value.t, abs=1e-8)


@pytest.mark.parametrize("way", [*WAYS, {"max_step": 1e9}])
@pytest.mark.parametrize("many", [1, 20])
def test_what_rests_in_an_equilibrium_crosses_nothing(way: dict[str, Any], many: int) -> None:
    """Springs and forces hold the first block but for roundoff; all others slide until 3 N stop them."""
    for seed in range(4):
        rng = np.random.default_rng(seed)
        place, held = float(rng.uniform(-0.5, 0.5)), []
        for stretch, stiffness in zip(rng.uniform(-0.3, 0.3, 2), rng.uniform(1.0, 20.0, 2), strict=True):
            held.append(Spring("b0", GROUND, stiffness=float(stiffness), rest=place - float(stretch)))
            held.append(Force("b0", float(stiffness) * float(stretch)))
        scene = Scene(
            Body("b0", inertia=1.0, position=place),
            *held,
            *(Body(f"b{i}", inertia=1.0, velocity=1.0 + i) for i in range(1, many)),
            *(Contact(f"c{i}", f"b{i}", GROUND, DryFriction(0.3, 0.3), normal=10.0) for i in range(1, many)),
        )
        events = [When("v", velocity("b0"), stop=True), When("x", position("b0") - place, stop=True)]
        result = simulate(scene, (0.0, 6.0), events=events, **way)
        assert result.status == 0
        stopped = range(1, min(many, 17))  # the others are too fast
        assert [e.contact for e in result.events] == [f"c{i}" for i in stopped]
        assert [e.t for e in result.events] == pytest.approx([(1.0 + i) / 3.0 for i in stopped], abs=1e-7)


@pytest.mark.parametrize("way", [*WAYS, {"method": "Adams"}])
def test_a_touch_at_a_break_is_no_rest_however_short_the_step_behind_it(way: dict[str, Any]) -> None:
    """A normal force falls to 0 N at 0.8 s and rises at once; beside a sine the first step of solvers is short.

    The area below it is 7.3 N (0.3 + 0.25 + 0.45 + 0.3) s; the sine gives nothing in its two periods.
    """
    scene = Scene(
        Body("b", inertia=1.0, velocity=-3.0),
        Contact(
            "c",
            "b",
            GROUND,
            DryFriction(0.1, 0.05),
            normal=piecewise_linear([0.3, 0.8, 1.7], [7.3, 0.0, 7.3]),
        ),
        Force("b", sine(0.3, 1.0)),
    )
    result = simulate(scene, (0.0, 2.0), events=[When("lost", normal("c"), stop=True)], **way)
    assert result.status == 0
    assert result.velocity("b")[-1] == pytest.approx(-3.0 + 0.05 * 7.3 * 1.3, abs=1e-7)


@pytest.mark.parametrize("way", [*WAYS, *({"method": m, "rtol": 1e-10, "atol": 1e-12} for m in ("BDF", "Adams"))])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_breaks_away_over_the_corner_of_a_table_does_not_rest_at_once(side: float, way: dict[str, Any]) -> None:
    """``N = 0.5 + 2 |w|`` has its corner where the block breaks away, at 0.05 s: its first motion ends at once."""
    scene = Scene(
        Body("b", inertia=0.5),
        Contact(
            "c",
            "b",
            GROUND,
            DryFriction(0.1, 0.1),
            normal=table(relative_velocity("c"), [-1000.0, 0.0, 1000.0], [2000.5, 0.5, 2000.5]),
        ),
        Force("b", piecewise_linear([0.0, 4.0], [0.0, side * 4.0])),
        Spring("b", GROUND, stiffness=1.0),
    )
    result = simulate(scene, (0.0, 4.0), events=[When("rests", relative_velocity("c"), stop=True)], **way)
    assert result.status == 0
    assert [(e.contact, e.after) for e in result.events] == [("c", Mode(int(side)))]
    assert result.events[0].t == pytest.approx(0.05, abs=1e-9)


@pytest.mark.parametrize("way", WAYS, ids=str)
def test_a_motion_without_length_beside_a_stop(way: dict[str, Any]) -> None:
    """The force ``-x`` ends at 0.5 m, where the body starts: it swings as ``0.5 cos t`` and is never at 0.55 m."""
    scene = Scene(
        Body("body", inertia=1.0, position=0.5),
        Stop("wall", "body", GROUND, upper=1.0),
        Force("body", -1.0 * saturate(position("body"), 0.0, 0.5)),
    )
    marks = [When("beyond", position("body") - 0.55), When("half way", position("body") - 0.25)]
    result = simulate(scene, (0.0, 1.5), events=marks, **way)
    assert [event.contact for event in result.events] == ["half way"]
    assert result.events[0].t == pytest.approx(math.acos(0.5), abs=1e-6)
