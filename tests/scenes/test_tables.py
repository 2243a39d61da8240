"""Saturations and tables: lines of the state whose corners are located; exact in the series engine."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gear,
    Mode,
    PreSlip,
    Sampled,
    Scene,
    SimulationError,
    Spring,
    StateSpace,
    When,
    explain,
    feedback,
    normal,
    output,
    position,
    relative_velocity,
    saturate,
    simulate,
    sine,
    table,
    velocity,
)

WAYS: list[dict[str, Any]] = [{}, {"method": "BDF"}, {"formulation": "merged"}, {"formulation": "multiplier"}]


def exact(result: Any, loose: float = 1e-7) -> float:
    return 1e-12 if result.stats["engine"] == "Taylor series" else loose


@pytest.mark.parametrize("way", WAYS)
def test_a_saturated_spring(way: dict[str, Any]) -> None:
    """F = -clip(4 x, -1, 1) from x = 1: a parabola up to sqrt(3/2) s, a sine of 2 rad/s between, four times."""
    scene = Scene(Body("m", inertia=1.0, position=1.0), Force("m", -saturate(4 * position("m"), -1.0, 1.0)))
    result = simulate(scene, (0.0, 10.0), rtol=1e-9, **way)
    first = math.sqrt(1.5)
    period = 4 * (first + math.atan2(0.5, first) / 2)
    at = result.sample([first, period / 2, period])
    np.testing.assert_allclose(at.position("m"), [0.25, -1.0, 1.0], rtol=0, atol=10 * exact(result))
    corners = [piece.stop for piece in result.trajectory.pieces]
    assert abs(corners[0] - first) < exact(result)
    assert abs(corners[1] - (period / 2 - first)) < exact(result)
    assert result.energy().relative_error < 1e-7
    if not way:
        assert result.stats["engine"] == "Taylor series"
        assert "Taylor series" in explain(scene)


@pytest.mark.parametrize("way", WAYS)
def test_a_torque_map(way: dict[str, Any]) -> None:
    """v' = 1 + v up to 1, then 3 - v: v = e^t - 1 up to ln 2, then 3 - 2 e^(ln 2 - t)."""
    scene = Scene(Body("m", inertia=1.0), Force("m", table(velocity("m"), [0.0, 1.0, 3.0], [1.0, 2.0, 0.0])))
    result = simulate(scene, (0.0, 3.0), rtol=1e-9, **way)
    assert abs(result.sample([math.log(2)]).velocity("m")[0] - 1.0) < exact(result)
    assert abs(result.velocity("m")[-1] - (3.0 - 2 * math.exp(math.log(2) - 3.0))) < exact(result)


def random_scene(number: int, form: str) -> Scene:
    rng = np.random.default_rng(number)
    xs = np.sort(rng.uniform(-1.0, 1.0, 4)).tolist()
    ys = rng.uniform(-2.0, 2.0, 4).tolist()
    limit = float(rng.uniform(0.2, 1.0))
    x, w = position("a") - 0.3 * position("b"), relative_velocity("rub")
    if form == "tables":
        one, two = table(x, xs, ys), saturate(2 * w, -limit, limit)
    else:
        one = feedback(lambda s: float(np.interp(s, xs, ys)), x)
        two = feedback(lambda s: min(max(2 * s, -limit), limit), w)
    return Scene(
        Body("a", inertia=1.0, position=float(rng.uniform(-1, 1)), velocity=0.5),
        Body("b", inertia=2.0, velocity=-0.5),
        Drive("belt", velocity=sine(0.4, 0.3)),
        Contact("rub", "a", "belt", DryFriction(0.5, 0.3, dwell=0.2), normal=1.0),
        Spring("a", "b", stiffness=3.0),
        Spring("b", GROUND, stiffness=1.0),
        Force("a", one),
        Force("b", two + 0.3 * one),
    )


@pytest.mark.parametrize("number", range(6))
def test_tables_are_the_functions_that_they_are(number: int) -> None:
    """Against functions with kinks, which the solver steps over, within what that costs."""
    one = simulate(random_scene(number, "tables"), (0.0, 8.0))
    two = simulate(random_scene(number, "code"), (0.0, 8.0), rtol=1e-10, atol=1e-12, max_step=0.01)
    assert (one.stats["engine"], two.stats["engine"]) == ("Taylor series", "CVODE BDF")
    assert [(e.contact, e.after) for e in one.events] == [(e.contact, e.after) for e in two.events]
    np.testing.assert_allclose([e.t for e in one.events], [e.t for e in two.events], rtol=0, atol=1e-5)
    for body in "ab":
        assert abs(one.position(body)[-1] - two.position(body)[-1]) < 1e-6
    assert one.energy().relative_error < 1e-11


def test_a_cut_run_with_tables_goes_on() -> None:
    whole = simulate(random_scene(3, "tables"), (0.0, 8.0))
    first = simulate(random_scene(3, "tables"), (0.0, 2.345))
    rest = simulate(first.final_scene(), (2.345, 8.0))
    events = [*first.events, *rest.events]
    np.testing.assert_allclose([e.t for e in events], [e.t for e in whole.events], rtol=0, atol=1e-11)


@pytest.mark.parametrize("way", WAYS)
def test_limits_of_a_block_and_jumps_over_corners(way: dict[str, Any]) -> None:
    """A gain of 10 limited to 2 pushes a body; a sampled output jumps over both corners of a saturation."""
    scene = Scene(
        Body("m", inertia=1.0),
        StateSpace("gain", -1.0, 0.0, 0.0, 10.0, inputs=[1.0 - velocity("m")], limits=[(-2.0, 2.0)]),
        Body("n", inertia=1.0),
        Sampled("swing", period=1.0, states=5.0, update=lambda t, x, u: -x, output=lambda t, x, u: x),
        Force("m", output("gain")),
        Force("n", saturate(output("swing"), -1.0, 1.0)),
    )
    result = simulate(scene, (0.0, 2.5), rtol=1e-9, **way)
    # v = 2 t up to 0.8, then 1 - 0.2 e^(-10 (t - 0.4))
    assert abs(result.velocity("m")[-1] - (1 - 0.2 * math.exp(-21.0))) < exact(result)
    assert abs(result.sample([0.4]).velocity("m")[0] - 0.8) < exact(result)
    assert abs(result.velocity("n")[-1] - 0.5) < exact(result)
    np.testing.assert_allclose(result.sample([0.1, 0.4]).output("gain"), [2.0, 2.0], atol=exact(result))


# Normal forces that depend on the state


@pytest.mark.slow
@pytest.mark.parametrize("way", [*WAYS, {"method": "RK4", "step": 1e-4}])
@pytest.mark.parametrize("form", ["sum", "code"])
def test_normal_force_from_a_spring(way: dict[str, Any], form: str) -> None:
    """Mass 1, mu 0.3, N = 2 + 5 x, from 3 m/s."""
    load: Any = 2 + 5 * position("m") if form == "sum" else feedback(lambda x: 2 + 5 * x, position("m"))
    scene = Scene(Body("m", inertia=1.0, velocity=3.0), Contact("rub", "m", GROUND, DryFriction(0.3, 0.3), normal=load))
    result = simulate(scene, (0.0, 2.0), rtol=1e-9, **way)
    tolerance = 5e-5 if "step" in way else exact(result)
    assert abs(result.events[0].t - 1.150383072918354) < tolerance
    assert abs(result.position("m")[-1] - 2.081934729198171) < tolerance
    assert abs(result.normal("rub")[-1] - 12.40967364599086) < 5 * tolerance
    assert result.energy().relative_error < 1e-7


@pytest.mark.parametrize("way", WAYS)
def test_a_contact_opens_and_closes_where_its_normal_force_comes_to_0(way: dict[str, Any]) -> None:
    """While x > 0, ``x'' = -10 x + 8 x - 0.8 sign(v) x``: pi / 2 / sqrt(1.2) s in, pi / 2 / sqrt(2.8) s out.

    While x < 0 the contact is open: half a period of pi / sqrt(10) s.
    """
    scene = Scene(
        Body("m", inertia=1.0, position=1.0),
        Spring("m", GROUND, stiffness=10.0),
        Contact("rub", "m", GROUND, DryFriction(0.3, 0.2), normal=4 * position("m")),
        Force("m", 2.0 * normal("rub")),
    )
    # the load 2 N = 8 x pushes outward: x'' = -1.2 x inward, -2.8 x outward
    result = simulate(scene, (0.0, 4.0), rtol=1e-9, **way)
    slow, free = math.pi / 2 / math.sqrt(1.2), math.pi / math.sqrt(10.0)
    at = result.sample([slow, slow + free])
    np.testing.assert_allclose(at.position("m"), [0.0, 0.0], atol=10 * exact(result))
    np.testing.assert_allclose(at.velocity("m"), [-math.sqrt(1.2), math.sqrt(1.2)], atol=10 * exact(result))
    top = slow + free + math.pi / 2 / math.sqrt(2.8)
    assert abs(result.sample([top]).position("m")[0] - math.sqrt(1.2 / 2.8)) < 10 * exact(result)
    assert (result.sample([slow + 0.1]).normal("rub") == 0).all()
    assert result.energy().relative_error < 1e-7


@pytest.mark.parametrize("way", WAYS)
def test_unloading_by_the_state_breaks_a_contact_loose(way: dict[str, Any]) -> None:
    """A block under 3 N is pressed with 10 N less 2 N per m that another body travels: loose at N = 6, x = 2."""
    scene = Scene(
        Body("m", inertia=1.0),
        Body("lifter", inertia=1.0, velocity=1.0),
        Contact("rub", "m", GROUND, DryFriction(0.5, 0.5), normal=10 - 2 * position("lifter")),
        Force("m", 3.0),
    )
    result = simulate(scene, (0.0, 7.0), rtol=1e-9, **way)
    assert abs(result.events[0].t - 2.0) < exact(result)
    # a = 3 - 0.5 (10 - 2 t) = t - 2 up to t = 5, then 3
    assert abs(result.velocity("m")[-1] - (4.5 + 6.0)) < 10 * exact(result)


@pytest.mark.parametrize("way", WAYS)
def test_a_block_that_presses_itself_on_as_it_goes(way: dict[str, Any]) -> None:
    """From rest at x = 0 under -1 N, N = -2 x: x'' = -1 - x, so x = cos t - 1, and it stays where it stops, at pi."""
    rub = Contact("rub", "m", GROUND, DryFriction(0.5, 0.5), normal=-2 * position("m"))
    result = simulate(Scene(Body("m", inertia=1.0), rub, Force("m", -1.0)), (0.0, 5.0), rtol=1e-9, **way)
    (event,) = result.events
    assert (event.before, event.after) == (-1, 0)
    assert abs(event.t - math.pi) < 10 * exact(result)
    assert abs(result.position("m")[-1] + 2.0) < 10 * exact(result)


def test_a_stiff_spring_between_limits_is_followed_from_border_to_border() -> None:
    """F = -clip(1e4 x, -1e4, 1e4) from x = 0 at 200 m/s: a sine inside, a parabola outside."""
    spring = Force("m", -saturate(1e4 * position("m"), -1e4, 1e4))
    result = simulate(Scene(Body("m", inertia=1.0, velocity=200.0), spring), (0.0, 1.0))
    # inside x = 2 sin(100 t) up to asin(1/2) = pi/6; outside it falls from 200 cos(pi/6) to minus that with 1e4 m/s^2
    half = 2 * math.pi / 600 + 2 * 200 * math.cos(math.pi / 6) / 1e4
    turns = int(1.0 / half)
    at = result.sample([k * half for k in range(1, turns + 1)])
    np.testing.assert_allclose(at.position("m"), 0.0, atol=1e-10)
    # to the end of the span from each border it would be many times as many
    assert result.stats["engine"] == "Taylor series"
    assert result.stats["steps"] < 20 * turns


def test_steep_tables_and_normal_forces_are_stiff() -> None:
    """A limit of 1 N on -1e6 v: v falls with 1 m/s^2 to 1e-6 m/s; the implicit BDF follows the fast decay then."""
    for scene in (
        Scene(Body("m", inertia=1.0, velocity=1.0), Force("m", -saturate(1e6 * velocity("m"), -1.0, 1.0))),
        Scene(Body("m", inertia=1.0, velocity=1.0), Force("m", -table(velocity("m"), [0.0, 1e-6], [0.0, 1.0]))),
    ):
        result = simulate(scene, (0.0, 3.0))
        assert result.stats["engine"] == "CVODE BDF"
        assert abs(result.sample([0.5]).velocity("m")[0] - 0.5) < 1e-6
        assert abs(result.velocity("m")[-1]) < 1e-8


@pytest.mark.parametrize("load", [100 * velocity("m"), 10 * position("m")])
def test_what_grows_without_end_is_an_error(load: Any) -> None:
    with pytest.raises(SimulationError, match="the motion grows beyond"):
        simulate(Scene(Body("m", inertia=1.0, velocity=1.0), Force("m", load)), (0.0, 99.0), method="series")


@pytest.mark.parametrize(("way", "span"), [({}, 3.0), ({"method": "series"}, 20.0), ({"method": "BDF"}, 1.0)])
def test_what_grows_fast_stops_growing_at_the_limits(way: dict[str, Any], span: float) -> None:
    """v' = clip(50 v, -0.2, 0.2): exp(50 t) up to ln(4) / 50, which would be 1e65 after 3 s; from there on 0.2 t."""
    push = Force("m", saturate(50 * velocity("m"), -0.2, 0.2))
    result = simulate(Scene(Body("m", inertia=1.0, velocity=1e-3), push), (0.0, span), rtol=1e-9, **way)
    assert abs(result.velocity("m")[-1] - (0.004 + 0.2 * (span - math.log(4) / 50))) < exact(result, 1e-9)
    assert len(result.trajectory.pieces) == 2


@pytest.mark.parametrize("method", ["auto", "BDF"])
def test_a_steep_push_in_the_direction_of_motion(method: Any) -> None:
    """``v' = clip(50 v, -0.2, 0.2) - x - 0.05 sign(v)``: between its limits, where v turns over, it grows."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", GROUND, DryFriction(0.05, 0.05), normal=1.0),
        Force("m", saturate(50 * velocity("m"), -0.2, 0.2)),
    )
    result = simulate(scene, (0.0, 9.0), method=method, rtol=1e-10)
    turns, t, y, s = [], 0.0, [0.0, 1.0], 1.0
    for _ in range(2):
        # by hand from border to border: s v falls to 0.004, to 0, where friction turns over, and to -0.004
        for edge, friction in ((0.004, s), (0.0, s), (-0.004, -s)):

            def rate(_: float, y: Any, s: float = s, edge: float = edge, r: float = friction) -> list[float]:
                return [y[1], (0.2 * s if edge > 0 else 50 * y[1]) - y[0] - 0.05 * r]

            def over(_: float, y: Any, s: float = s, edge: float = edge) -> float:
                return float(s * y[1] - edge)

            over.terminal, over.direction = True, -1.0  # type: ignore[attr-defined]
            found = solve_ivp(rate, (t, t + 9.0), y, events=over, rtol=1e-11, atol=1e-13, max_step=0.1)
            t, y = found.t[-1], found.y[:, -1]
            turns += [t] * (edge == 0)
        s = -s
    np.testing.assert_allclose([event.t for event in result.events[:2]], turns, rtol=0, atol=1e-7)


def test_leading_shoe_of_a_drum_brake() -> None:
    """N = F a / (b - mu c): F 100, a .3, b .15, c .1, mu .4; drum of radius .2, J 2, from 50 rad/s."""
    shoe = DryFriction(0.4, 0.4).self_energised(0.1 / 0.15)
    scene = Scene(
        Body("drum", inertia=2.0, velocity=50.0),
        Contact("shoe", "drum", GROUND, shoe, normal=100 * 0.3 / 0.15, radius_a=0.2),
    )
    result = simulate(scene, (0.0, 6.0))
    assert abs(result.events[0].t - 4.58333333333333) < 1e-11
    assert abs(result.sample([1.0]).force("shoe")[0] / 0.4 - 272.72727272727) < 1e-9
    with pytest.raises(ValueError, match=r"with mu = 1.5 forward and gain 0.666667 the contact locks"):
        DryFriction(1.5, 1.5).self_energised(0.1 / 0.15)
    with pytest.raises(ValueError, match="coefficients must be constant"):
        DryFriction(0.5, 0.4, dwell=0.1).self_energised(0.1)


@pytest.mark.parametrize("options", [*WAYS, {"method": "Adams"}])
def test_a_contact_that_a_table_closes_at_its_corner(options: dict[str, Any]) -> None:
    """N = 2 (x - 1) from x = 1 on; a body under 1 N goes x = t² / 2, then u = x - 1 follows u'' = 1 - 0.6 u.

    With w² = 0.6, u = (1 - cos(w s)) / 0.6 + sqrt(2) / w sin(w s), which turns where tan(w s) = -0.6 sqrt(2) / w.
    """
    scene = Scene(
        Body("b", inertia=1.0),
        Force("b", 1.0),
        Contact(
            "c",
            "b",
            GROUND,
            DryFriction(0.3, 0.3),
            normal=table(position("b"), [-5.0, 1.0, 20.0], [0.0, 0.0, 38.0]),
        ),
    )
    result = simulate(scene, (0.0, 8.0), **options)
    w = math.sqrt(0.6)
    (event,) = result.events
    assert (event.before, event.after) == (1, 0)
    turns = math.sqrt(2) + (math.pi - math.atan(0.6 * math.sqrt(2) / w)) / w
    assert abs(event.t - turns) < exact(result)


@pytest.mark.parametrize(
    "options", [{}, {"formulation": "merged", "method": "BDF"}, {"formulation": "merged", "method": "Adams"}]
)
def test_a_corner_and_a_stop_of_the_user_where_a_gear_leads_a_body(options: dict[str, Any]) -> None:
    """x'' = 0.4 F with F = 1 up to x = 1, then u = x - 1 follows u'' = 0.4 (1 + u); the other goes twice as fast."""
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Gear("gear", "a", "b", ratio=2.0),
        Force("a", table(position("b"), [-9.0, 1.0, 99.0], [1.0, 1.0, 99.0])),
    )
    w, after = math.sqrt(0.4), 1.5
    speed = math.sqrt(0.8)
    v = w * math.sinh(w * after) + speed * math.cosh(w * after)
    result = simulate(scene, (0.0, math.sqrt(5.0) + after), **options)
    assert abs(result.velocity("b")[-1] - v) < exact(result)
    assert abs(result.velocity("a")[-1] - 2 * v) < exact(result)
    half = When("half way", position("b") - 0.5, stop=True)
    stopped = simulate(scene, (0.0, 5.0), events=[half], **options)
    assert abs(stopped.t[-1] - math.sqrt(2.5)) < exact(stopped)
    assert abs(stopped.velocity("a")[-1] - 2 * 0.4 * math.sqrt(2.5)) < exact(stopped)
    assert abs(stopped.final_scene().bodies[0].velocity - 2 * 0.4 * math.sqrt(2.5)) < exact(stopped)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("push", [0.0, 6.0])
def test_a_table_of_the_velocity_has_its_corner_where_it_turns(way: dict[str, Any], push: float) -> None:
    """Damped forward only, on a spring that is stronger than the friction: one event for each turn."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("c", "m", GROUND, DryFriction(0.05, 0.05), normal=push / 6.0),
        Spring("m", GROUND, stiffness=3.0),
        Force("m", -0.5 * saturate(velocity("m"), 0.0, math.inf)),
    )
    result = simulate(scene, (0.0, 3.5), **way)
    assert [(int(event.before), int(event.after)) for event in result.events] == [(1, -1), (-1, 1)]
    # x'' + x' / 2 + 3 x = -push / 120 up to the turn, x'' + 3 x = push / 120 from there
    damped = math.sqrt(3.0 - 0.25**2)
    first = math.atan2(damped, 0.25 + push / 120) / damped
    found = [event.t for event in result.events]
    np.testing.assert_allclose(found, [first, first + math.pi / math.sqrt(3.0)], atol=exact(result))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("law", [DryFriction(0.3, 0.2), DryFriction(0.3, 0.2, stribeck_velocity=0.3)])
def test_tables_that_are_left_together(way: dict[str, Any], law: DryFriction) -> None:
    """Two tables of one velocity cancel. Their corners coincide: between two corners the contact would be pressed.

    The body swings as ``x'' + 3 x = sin(pi t)`` says: its velocity goes as cos(pi t) - cos(sqrt(3) t), which is 0 where
    ``pi t = 2 pi k - sqrt(3) t`` or ``2 pi k + sqrt(3) t``.
    """
    forward = saturate(velocity("m"), 0.0, math.inf)
    twice = saturate(2.0 * velocity("m"), 0.0, math.inf)
    scene = Scene(
        Body("m", inertia=1.0),
        Body("rests", inertia=1.0),
        Contact("c", "m", "rests", law, normal=twice - 2.0 * forward),
        Force("m", sine(1.0, 0.5)),
        Spring("m", GROUND, stiffness=3.0),
    )
    result = simulate(scene, (0.0, 5.0), **way)
    story = [(int(event.before), int(event.after), event.cause) for event in result.events]
    assert story == [(sign, -sign, "open") for sign in (1, -1, 1, -1)]
    w = math.sqrt(3.0)
    turns = [2 * math.pi * k / (math.pi + w) for k in (1, 2, 3)] + [2 * math.pi / (math.pi - w)]
    np.testing.assert_allclose([event.t for event in result.events], turns, rtol=0, atol=exact(result, 1e-5))
    x = (math.sin(5.0 * math.pi) - math.pi / w * math.sin(5.0 * w)) / (3.0 - math.pi**2)
    assert abs(result.position("m")[-1] - x) < exact(result, 1e-5)
    assert not result.velocity("rests").any()


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_what_hardly_leaves_a_corner_is_not_followed_in_steps_of_nothing(way: dict[str, Any]) -> None:
    """A body that is damped forward only is carried along from rest, very slowly at first.

    It is as fast as its carrier for the first time where the equations of both, solved by scipy, say so.
    """
    rubs = DryFriction(0.4, 0.2, stribeck_velocity=0.3)
    scene = Scene(
        Body("carried", inertia=1.0),
        Body("carrier", inertia=1.3, velocity=1.0),
        Contact("floor", "carrier", GROUND, rubs, normal=3.0),
        Contact(
            "top",
            "carried",
            "carrier",
            DryFriction(0.3, 0.2),
            normal=saturate(position("carrier") - 0.2, 0.0, math.inf),
        ),
        Force("carrier", sine(2.0, 0.7)),
        Force("carried", -0.5 * saturate(velocity("carried"), 0.0, math.inf)),
    )
    result = simulate(scene, (0.0, 5.0), **way)
    assert len(result.events) == 19
    assert result.stats["restarts"] < 30

    def rates(t: float, y: Any) -> list[float]:
        v, u, normal = y[1], y[3], max(y[2] - 0.2, 0.0)
        floor = 3.0 * (0.2 + 0.2 * math.exp(-((u / 0.3) ** 2)))
        return [v, 0.2 * normal - 0.5 * v, u, (2 * math.sin(1.4 * math.pi * t) - floor - 0.2 * normal) / 1.3]

    def together(_: float, y: Any) -> float:
        return float(y[3] - y[1])

    together.terminal = True  # type: ignore[attr-defined]
    found = solve_ivp(rates, (0.0, 2.0), [0.0, 0.0, 0.0, 1.0], events=together, rtol=1e-10, atol=1e-12, max_step=0.05)
    assert (result.events[0].contact, result.events[0].after) == ("top", 0)
    assert abs(result.events[0].t - found.t[-1]) < 1e-6
    at = result.sample([result.events[0].t])
    for body, (x, v) in zip(("carried", "carrier"), found.y[:, -1].reshape(2, 2), strict=True):
        assert abs(at.position(body)[0] - x) < 1e-6 and abs(at.velocity(body)[0] - v) < 1e-6


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("law", [DryFriction(0.3, 0.2), PreSlip(DryFriction(0.3, 0.2), 1e-2)])
def test_a_normal_force_of_roundoff_is_none(way: dict[str, Any], law: Any) -> None:
    """The normal force rises to 5.1 N and falls again; at the end its parts cancel, but for 9e-16 N.

    From there on the body swings freely: it turns every half period of pi / sqrt(3) s, as far to the one side as to
    the other.
    """
    x, peak, (first, top, end) = position("clock"), 5.1, (0.3, 0.6, 1.3)
    rises = peak / (top - first) * (saturate(x, first, top) - first)
    falls = peak / (end - top) * (saturate(x, top, end) - top)
    scene = Scene(
        Body("clock", inertia=1.0, velocity=1.0),
        Body("m", inertia=1.0, velocity=0.6),
        Contact("c", "m", GROUND, law, normal=rises - falls),
        Spring("m", GROUND, stiffness=3.0),
    )
    result = simulate(scene, (0.0, 5.0), **way)
    assert result.normal("c")[-1] < 1e-14
    late = [event for event in result.events if event.t > end + 0.01]
    assert [(int(e.before), int(e.after), e.cause) for e in late] == [(-1, 1, "open"), (1, -1, "open")]
    assert abs(late[1].t - late[0].t - math.pi / math.sqrt(3.0)) < exact(result, 1e-5)
    turns = result.sample([late[0].t, late[1].t]).position("m")
    assert turns[0] < -0.1 and abs(turns[0] + turns[1]) < exact(result, 1e-5)


@pytest.mark.parametrize("way", WAYS)
def test_a_corner_far_from_0_where_a_body_rests(way: dict[str, Any]) -> None:
    """At 1000 m a position has the roundoff of 1000 m, also where a table reads its distance from 1000 m.

    The motion is the one at 0 m without the table, which reads 0 all the time.
    """
    rubs = DryFriction(0.4, 0.2, stribeck_velocity=0.3)

    def at(start: float, *load: Any) -> Scene:
        return Scene(
            Body("rests", inertia=1.0, position=start),
            Body("moves", inertia=1.3, velocity=1.0, position=start),
            Contact("floor", "moves", GROUND, rubs, normal=3.0),
            Contact("held", "rests", GROUND, rubs, normal=10.0),
            Spring("rests", "moves", stiffness=3.0),
            Force("moves", sine(2.0, 0.7)),
            *load,
        )

    corner = table(position("rests") - 1000.0, [-1.0, 0.0, 1.0], [1.0, 0.0, -2.0])
    result = simulate(at(1000.0, Force("moves", corner)), (0.0, 5.0), **way)
    assert result.stats["restarts"] < 40
    assert not result.velocity("rests").any()
    np.testing.assert_allclose(result.position("rests"), 1000.0, rtol=1e-15)
    near = simulate(at(0.0), (0.0, 5.0), **way)
    assert [(e.contact, e.after) for e in result.events] == [(e.contact, e.after) for e in near.events]
    np.testing.assert_allclose([e.t for e in result.events], [e.t for e in near.events], rtol=0, atol=1e-5)
    assert abs(result.position("moves")[-1] - 1000.0 - near.position("moves")[-1]) < 1e-5


@pytest.mark.parametrize("method", ["auto", "BDF", "Adams"])
@pytest.mark.parametrize("after", [0.0, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("corner", [0.3, 1.0 / 3.0, 1.0])
def test_a_force_that_comes_to_its_level_at_corners_lets_go_if_it_goes_on(
    method: str, after: float, corner: float
) -> None:
    """Two tables of time add up to 0.4 * 10 N at a corner of both; beyond it to more, or not."""
    parts = [[0.0, 2.0, after], [0.0, 2.0, 2.0]]
    times = [0.0, corner, 2 * corner]
    scene = Scene(
        Body("m", inertia=1.0),
        Contact("floor", "m", GROUND, DryFriction(0.4, 0.2), normal=10.0),
        *(Force("m", table(TIME, times, ys)) for ys in parts),
        motion="translation",
    )
    result = simulate(scene, (0.0, 2 * corner), method=method)
    if after <= 2.0:
        assert len(result.events) == 0
        assert result.velocity("m")[-1] == 0.0
    else:
        (event,) = result.events
        assert event.after == Mode.FORWARD
        assert event.t == pytest.approx(corner, rel=1e-9)
        # 4 N + (t - corner) / corner - 2 N moves it
        assert result.velocity("m")[-1] == pytest.approx(2.5 * corner, rel=1e-6)


def _saturated_drive(number: int, delay: float) -> list[Any]:
    """A slider with a controller whose force is limited, and a table of that force beside it."""
    name, x, v = f"b{number}", position(f"b{number}"), velocity(f"b{number}")
    force = saturate(50.0 * (1.0 + delay - x), -8.0, 8.0)
    return [
        Body(name, inertia=1.0),
        Contact(f"c{number}", name, GROUND, DryFriction(0.4, 0.3), normal=10.0),
        Force(name, force - v),
        Force(name, table(force - 2.0 * v, [-5.0, 0.0, 5.0], [-0.1, 0.0, 0.4])),
    ]


@pytest.mark.parametrize("count, way", [(3, {}), (24, {}), (5, {"method": "BDF", "rtol": 1e-10, "atol": 1e-12})])
def test_many_tables_are_as_each_alone(count: int, way: dict[str, Any]) -> None:
    """Drives that do not know of each other move as each alone; two of them leave every corner together."""
    delays = [0.03 * max(number, 1) for number in range(count)]
    drives = [_saturated_drive(number, delay) for number, delay in enumerate(delays)]
    t = np.linspace(0.0, 5.0, 101)
    together = simulate(Scene(*(element for drive in drives for element in drive)), (0.0, 5.0), **way)
    rough = 1e-7 if way else 1e-13
    for number in {0, 1, 2, count // 2, count - 1}:
        alone = simulate(Scene(*drives[number]), (0.0, 5.0), **way)
        name, contact = f"b{number}", f"c{number}"
        of_both = [[(e.t, e.cause) for e in run.events if e.contact == contact] for run in (together, alone)]
        assert [cause for _, cause in of_both[0]] == [cause for _, cause in of_both[1]]
        assert np.allclose([at for at, _ in of_both[0]], [at for at, _ in of_both[1]], rtol=0, atol=rough)
        assert np.abs(together.sample(t).position(name) - alone.sample(t).position(name)).max() < rough
        assert len(of_both[0]) == 3  # it turns, turns again, and sticks: that corners are left is no event
    assert np.abs(together.position("b0") - together.position("b1")).max() < 1e-14


@pytest.mark.parametrize("method", ["auto", "BDF", "Adams"])
def test_a_wheel_that_rolls_freely_beside_others_that_slip(method: Any) -> None:
    """Three tyres whose friction is a table of their own slip move as three forces that are odd tables of it.

    The slip of the free wheel leaves 0 as the square of time, and its sign is roundoff as the others begin to slip.
    """
    tyres = [
        (0.30008448022908063, 4358.6, 0.2015, 1318.3, 6.75, 0.4025, 0.0),
        (0.35103107181933824, 4105.5, 2.977, 4128.1, 8.7, 1.384, -1290.4080422146003),
        (0.3947749655690612, 505.86, 0.4245, 411.27, 9.88, 0.449, 156.99),
    ]
    for k in (0, 3, 10):
        speed = 17.261227220800222 * (1 + 1e-3 * k)
        contacts: list[Any] = [Body("car", inertia=298.6, velocity=speed)]
        forces = contacts.copy()
        for i, (radius, peak, at_peak, far, at_far, inertia, torque) in enumerate(tyres):
            wheel, places = f"w{i}", [-at_far, -at_peak, 0.0, at_peak, at_far]
            both = [Body(wheel, inertia=inertia, velocity=speed / radius), Force(wheel, torque)]
            normal = table(relative_velocity(f"t{i}"), places, [far, peak, 0.0, peak, far])
            contacts += [*both, Contact(f"t{i}", "car", wheel, DryFriction(1.0, 1.0), radius_b=radius, normal=normal)]
            slip = velocity("car") - radius * velocity(wheel)
            push = table(slip, places, [-far, -peak, 0.0, peak, far])
            forces += [*both, Force("car", -push), Force(wheel, radius * push)]
        ends = [simulate(Scene(*some), (0.0, 0.5), method=method) for some in (contacts, forces)]
        for body in ("car", "w0", "w1", "w2"):
            found, exact = (end.velocity(body)[-1] for end in ends)
            assert found == pytest.approx(exact, rel=1e-5)
