"""Rigid stops against closed forms, in every formulation and engine."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    Mode,
    OneWay,
    Result,
    Scene,
    SimulationError,
    Spring,
    Stop,
    Tie,
    explain,
    feedback,
    load,
    piecewise_linear,
    simulate,
    sine,
    step,
    velocity,
)

ENGINES: dict[str, tuple[dict[str, Any], float]] = {
    "series": ({"method": "series"}, 1e-11),
    "BDF": ({"method": "BDF"}, 2e-6),
    "Adams": ({"method": "Adams"}, 2e-6),
    "merged": ({"formulation": "merged", "method": "BDF"}, 2e-6),
    "multiplier": ({"formulation": "multiplier"}, 2e-6),
}
every_engine = pytest.mark.parametrize(("options", "off"), ENGINES.values(), ids=ENGINES)


def times(result: Result, name: str) -> list[float]:
    return [event.t for event in result.events if event.contact == name]


def balanced(result: Result, off: float) -> None:
    assert result.success
    assert result.energy().relative_error < max(off, 1e-12)


@every_engine
def test_a_slider_between_rigid_stops(options: dict[str, Any], off: float) -> None:
    """m = 1, mu g = 0.5, e = 0.8 from the middle at 5 m/s: ``v^2`` falls by 2 mu g s along each way s."""
    scene = Scene(
        Body("slider", inertia=1, position=0.5, velocity=5),
        Contact("dry", "slider", GROUND, DryFriction(0.5, 0.5), normal=1),
        Stop("walls", "slider", GROUND, lower=0, upper=1, restitution=0.8),
    )
    result = simulate(scene, (0, 5), **options)
    expected = [0.1005050633883347, 0.3572033884104603, 0.6926271833524003]
    expected += [1.146233217046369, 1.80978775573666, 3.178058493638328]
    np.testing.assert_allclose(times(result, "walls"), expected, rtol=0, atol=off)
    hits = [event for event in result.events if event.contact == "walls"]
    assert {(e.before, e.after, e.cause) for e in hits} == {(Mode.OPEN, Mode.OPEN, "impact")}
    rest = result.events[-1]
    assert (rest.contact, rest.after) == ("dry", Mode.STUCK)
    assert rest.t == pytest.approx(3.800109416415555, abs=off)
    assert result.position("slider")[-1] == pytest.approx(0.096736837632, abs=max(off, 1e-12))
    balanced(result, off)
    ledger = result.energy()
    assert ledger.impacts["walls"][-1] + ledger.contacts["dry"][-1] == pytest.approx(12.5, abs=30 * off)
    assert "struck its upper limit at relative velocity 4.9497" in result.explain()


def last_bounce(height: float, restitution: float, drag: float) -> float:
    """Return the time of the last bounce of a ball of 1 kg let go at a height, with a drag of ``drag v^2`` in N.

    From a height h it falls for ``acosh(exp(k h)) / sqrt(g k)``, and has ``v^2 = g (1 - exp(-2 k h)) / k`` then. Thrown
    up at v it rises for ``atan(v sqrt(k / g)) / sqrt(g k)``, by ``log(1 + k v^2 / g) / 2 k``.
    """
    g, k, t = 9.81, drag, 0.0
    while height > 1e-16:
        # acosh(1 + x) for small x
        x = math.expm1(k * height)
        t += math.log1p(x + math.sqrt(x * (x + 2))) / math.sqrt(g * k)
        v = restitution * math.sqrt(-g * math.expm1(-2 * k * height) / k)
        t += math.atan(v * math.sqrt(k / g)) / math.sqrt(g * k)
        height = math.log1p(k * v**2 / g) / (2 * k)
    return t


@pytest.mark.parametrize("method", ["auto", "Adams"])
@pytest.mark.parametrize("restitution", [0.5, 0.6])
@pytest.mark.parametrize("height", [0.05, 0.25, 0.3, 0.5])
def test_a_ball_bounces_to_rest_in_air(height: float, restitution: float, method: Any) -> None:
    """Only a function moves the ball, so the solver cannot know the ball's speed in advance."""
    scene = Scene(
        Body("ball", inertia=1.0, position=height),
        Stop("ground", "ball", GROUND, lower=0.0, restitution=restitution),
        Force("ball", feedback(lambda v: -9.81 - 0.01 * v * abs(v), velocity("ball"))),
    )
    result = simulate(scene, (0.0, 3.0), method=method)
    assert [event.cause for event in result.events] == ["impact"] * len(result.events)
    assert result.mode("ground")[-1] == Mode.BACKWARD and result.velocity("ball")[-1] == 0
    assert result.events[-1].t == pytest.approx(last_bounce(height, restitution, 0.01), abs=1e-4)
    assert abs(result.position("ball")[-1]) < 1e-10


@every_engine
def test_a_bouncing_ball_comes_to_rest(options: dict[str, Any], off: float) -> None:
    """Falls from 1 m: impacts at ``t1 (1 + 2 e + 2 e^2 + ...)``, which end at ``t1 (1 + e)/(1 - e)``; then it rests."""
    g, e = 9.81, 0.6
    scene = Scene(
        Body("ball", inertia=2.0, position=1.0),
        Force("ball", -2.0 * g),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=e),
    )
    result = simulate(scene, (0, 3), **options)
    t1 = math.sqrt(2 / g)
    expected = [t1 * (1 + 2 * sum(e**k for k in range(1, n))) for n in range(1, 12)]
    np.testing.assert_allclose(times(result, "floor")[:11], expected, rtol=0, atol=10 * off)
    end = result.events[-1]
    assert (end.before, end.after, end.cause) == (Mode.OPEN, Mode.BACKWARD, "impact")
    # rebounds below the velocity margin do not happen
    assert end.t == pytest.approx(t1 * (1 + e) / (1 - e), abs=1e-9 if off < 1e-9 else 1e-4)
    assert result.velocity("ball")[-1] == 0
    assert abs(result.position("ball")[-1]) < 1e-9
    assert result.force("floor")[-1] == pytest.approx(-2 * g, abs=1e-9)
    balanced(result, off)
    assert result.energy().impacts["floor"][-1] == pytest.approx(2 * g, abs=30 * off)


@pytest.mark.parametrize("height", [1e-6, 1e-9])
@pytest.mark.parametrize("others", [0, 1, 2, 4], ids=["nothing", "a spindle", "its brake", "a motor"])
def test_a_ball_bounces_to_rest_whatever_else_spins(others: int, height: float) -> None:
    """A ball that falls for 0.5 s rebounds with e = 1/2 until 1.5 s; a spindle of 1e5 rad/s does not touch it."""
    dry = DryFriction(0.4, 0.3)
    spindle = [
        Body("spindle", inertia=1.0, velocity=1e5, motion="rotation"),
        Contact("brake", "spindle", GROUND, dry, normal=step(0.9, 0.0, 1.0)),
        Drive("motor", velocity=1e5, motion="rotation"),
        Contact("clutch", "spindle", "motor", dry, normal=1.0),
    ]
    scene = Scene(
        Body("ball", inertia=1.0, position=height, motion="translation"),
        Force("ball", -8.0 * height),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=0.5),
        *spindle[:others],
    )
    result = simulate(scene, (0.0, 3.0))
    impacts = times(result, "floor")
    np.testing.assert_allclose(impacts[:20], 1.5 - 2.0 ** -np.arange(20), rtol=0, atol=1e-12)
    assert impacts[-1] == pytest.approx(1.5, abs=1e-9)
    assert result.sample([1.1]).position("ball")[0] == pytest.approx(0.06 * height, rel=1e-9)


@every_engine
@pytest.mark.parametrize("stop", [1e4, 1e6])
def test_a_ball_bounces_however_long_the_run(stop: float, options: dict[str, Any], off: float) -> None:
    """Falling for the whole span it would get far faster than it does; it rests after ``t1 (1 + e)/(1 - e)``."""
    g, e, height = 9.81, 0.8, 0.2
    scene = Scene(
        Body("ball", inertia=1.0, position=height),
        Force("ball", -g),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=e),
    )
    result = simulate(scene, (0.0, stop), **options)
    t1 = math.sqrt(2 * height / g)
    expected = [t1 * (1 + 2 * sum(e**k for k in range(1, n))) for n in range(1, 12)]
    np.testing.assert_allclose(times(result, "floor")[:11], expected, rtol=0, atol=10 * off)
    assert result.events[-1].t == pytest.approx(t1 * (1 + e) / (1 - e), abs=1e-4)
    assert result.sample([t1 * (1 + 2 * e + e**2)]).position("ball")[0] == pytest.approx(height * e**4, abs=off)


@every_engine
@pytest.mark.parametrize("start", [1e4, 1e6, 1e8])
def test_a_ball_bounces_to_rest_on_a_moving_plate_however_late(
    start: float, options: dict[str, Any], off: float
) -> None:
    """It falls on the plate with 8 (1 + 1e-3) m/s^2, and rebounds with e = 1/2: it rests after three times its fall."""
    scene = Scene(
        Body("plate", inertia=1e3, velocity=1.0),
        Body("ball", inertia=1.0, velocity=1.0, position=1.0),
        Stop("floor", "ball", "plate", lower=0.0, restitution=0.5),
        Force("ball", -8.0),
        Force("plate", 8.0),
    )
    result = simulate(scene, (start, start + 4.0), **options)
    fall = math.sqrt(2.0 / 8.008)
    impacts = np.array(times(result, "floor")) - start
    np.testing.assert_allclose(impacts[:5], fall * (3 - 2.0 ** (1 - np.arange(5))), rtol=0, atol=off + 1e-14 * start)
    assert impacts[-1] == pytest.approx(3 * fall, abs=1e-3 + 1e-10 * start)
    assert result.events[-1].after == Mode.BACKWARD and len(impacts) < 50


@pytest.mark.parametrize("stop", [2.0, 100.0, 1e3])
@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("plate", [0.0, sine(1e-3, 0.1)], ids=["at rest", "shaken"])
def test_the_last_flights_of_a_ball_leave_others_alone(plate: Any, restitution: float, stop: float) -> None:
    """The last flights are shorter than roundoff of a long run's time; a block on a spring turns at k pi / 10 s."""
    scene = Scene(
        Body("ball", inertia=1.0, position=0.02),
        Force("ball", -9.81),
        Drive("plate", velocity=plate),
        Stop("floor", "ball", "plate", lower=0.0, restitution=restitution),
        Body("block", inertia=1.0, position=0.03),
        Spring("block", GROUND, stiffness=100.0),
        Contact("rub", "block", GROUND, DryFriction(0.5, 0.3), normal=0.5),
    )
    result = simulate(scene, (0.0, stop), method="series")
    np.testing.assert_allclose(times(result, "rub")[:3], np.pi / 10 * np.arange(1, 4), rtol=0, atol=1e-12)
    rest = math.sqrt(0.04 / 9.81) * (1 + restitution) / (1 - restitution)
    assert times(result, "floor")[-1] == pytest.approx(rest, abs=1e-4 if plate else 1e-11 + 1e-12 * stop)


@every_engine
@pytest.mark.parametrize("ratio", [10.0, 1e6])
def test_a_ball_that_turns_a_flywheel_bounces_like_any_other(ratio: float, options: dict[str, Any], off: float) -> None:
    """The load moves ball and flywheel: the ball falls for 0.5 s with 8 m/s^2, rebounds with e = 1/2 until 1.5 s."""
    scene = Scene(
        Body("ball", inertia=1.0, position=1.0),
        Body("flywheel", inertia=2.0),
        Gear("screw", "flywheel", "ball", ratio=ratio),
        Force("ball", -8.0 * (1.0 + 2.0 * ratio**2)),
        Stop("floor", "ball", GROUND, lower=0.0, restitution=0.5),
    )
    result = simulate(scene, (0.0, 3.0), **options)
    impacts = times(result, "floor")
    np.testing.assert_allclose(impacts[:10], 1.5 - 2.0 ** -np.arange(10), rtol=0, atol=off)
    assert impacts[-1] == pytest.approx(1.5, abs=1e-9 if off < 1e-9 else 2e-3)
    assert result.sample([1.1]).position("ball")[0] == pytest.approx(0.06, abs=off)


@every_engine
@pytest.mark.parametrize("heights", [(1e-5, 1.0), (1e-6, 1e6)])
def test_balls_that_land_together_rebound_each_for_itself(
    heights: tuple[float, float], options: dict[str, Any], off: float
) -> None:
    """Both fall for 0.5 s and rebound with e = 1/2 at ``1.5 - 2^-k`` s, however high the other one falls."""
    scene = Scene(
        *(Body(f"b{k}", inertia=1.0, position=height) for k, height in enumerate(heights)),
        *(Force(f"b{k}", -8.0 * height) for k, height in enumerate(heights)),
        *(Stop(f"s{k}", f"b{k}", GROUND, lower=0.0, restitution=0.5) for k in range(2)),
    )
    result = simulate(scene, (0.0, 3.0), **options)
    for k, height in enumerate(heights):
        impacts = times(result, f"s{k}")
        np.testing.assert_allclose(impacts[:10], 1.5 - 2.0 ** -np.arange(10), rtol=0, atol=off)
        assert impacts[-1] == pytest.approx(1.5, abs=1e-9 if off < 1e-9 else 1e-3)
        assert result.sample([1.1]).position(f"b{k}")[0] == pytest.approx(0.06 * height, rel=max(off, 1e-9))


def test_a_start_beyond_a_limit_of_0_by_roundoff() -> None:
    """``0.3 - 3 * 0.1`` is 5.6e-17 below 0: the body lies on the floor. A start 1e-12 below is refused."""
    law = Stop("floor", "m", GROUND, lower=0.0)
    result = simulate(Scene(Body("m", inertia=1.0, position=0.3 - 3 * 0.1), law, Force("m", -1.0)), (0.0, 1.0))
    assert not result.events and result.force("floor")[-1] == -1.0
    with pytest.raises(ValueError, match="beyond its lower limit 0"):
        simulate(Scene(Body("m", inertia=1.0, position=-1e-12), law), (0.0, 1.0))


@pytest.mark.parametrize("origin", [300.0, 1e4, 1e6])
def test_a_ball_bounces_on_a_plate_wherever_the_origin_is(origin: float) -> None:
    """The last flights are far lower than roundoff of the positions; the velocities still show them."""

    def dropped(at: float) -> Result:
        scene = Scene(
            Body("ball", inertia=1.0, position=at + 1.0),
            Body("plate", inertia=10.0, position=at),
            Stop("contact", "ball", "plate", lower=0.0, restitution=0.5),
            Force("ball", -9.81),
            Spring("plate", GROUND, stiffness=1000.0, damping=10.0, rest=at),
        )
        return simulate(scene, (0.0, 4.0))

    here, there = dropped(0.0), dropped(origin)
    impacts = times(there, "contact")
    assert 20 < len(impacts) <= len(here.events)
    assert impacts[:15] == pytest.approx(times(here, "contact")[:15], abs=1e-14 * max(origin, 1e3))
    assert there.velocity("ball")[-1] == pytest.approx(here.velocity("ball")[-1], abs=1e-12 * max(origin, 1e3))
    assert there.mode("contact")[-1] == Mode.BACKWARD


def test_a_solver_does_not_rebound_where_the_flight_is_roundoff() -> None:
    """A ball on a floor at 0.4 m, impacts as above with e = 0.06. After the fourth it would rebound with 5e-7 m/s.

    This flight would be 2e-13 m high, which a solver cannot resolve beside 0.4 m: the stop closes.
    """
    g, e, height = 0.8, 0.06, 1e-3
    scene = Scene(
        Body("ball", inertia=2.0, position=0.4 + height),
        Body("other", inertia=1.0, velocity=1.0),
        Contact("rub", "other", GROUND, DryFriction(0.2, 0.1, stribeck_velocity=0.5), normal=1.0),
        Force("ball", -2.0 * g),
        Stop("floor", "ball", GROUND, lower=0.4, restitution=e),
    )
    result = simulate(scene, (0, 1), method="BDF", rtol=1e-12, atol=1e-14)
    t1 = math.sqrt(2 * height / g)
    found = times(result, "floor")
    exact = [t1 * (1 + 2 * sum(e**k for k in range(1, n))) for n in range(1, len(found) + 1)]
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-7)
    assert len(found) == 4
    assert result.events[-1].after == Mode.BACKWARD
    assert result.velocity("ball")[-1] == 0


@pytest.mark.parametrize("ahead", [1e-4, 1e-6, 1e-7])
def test_a_rebound_is_there_however_soon_the_run_ends(ahead: float) -> None:
    """A ball falls on a floor at 1 m with 1 m/s, e = 1/2: it flies for 1 s, 1/2 s, ... with g = 1 m/s^2.

    After impact n its velocity is ``2^-n``, and ``2^-n - ahead`` a little later.
    """
    floor = Stop("floor", "ball", GROUND, lower=1.0, restitution=0.5)
    ball = Scene(Body("ball", inertia=1.0, position=1.0, velocity=-1.0), Force("ball", -1.0), floor)
    for n in range(1, 21):
        at = 2.0 - 4.0 * 0.5**n
        result = simulate(ball, (0.0, at + ahead))
        if ahead < 2.0 * 0.5**n:
            assert len(result.events) == n
            assert result.velocity("ball")[-1] == pytest.approx(0.5**n - ahead, abs=1e-12)


@every_engine
def test_a_run_may_end_within_roundoff_of_an_impact(options: dict[str, Any], off: float) -> None:
    """The body of 1 m/s comes to the wall at 0.5 s and rebounds with 0.25 m/s; friction slows it by 0.1 m/s^2.

    Where the end of the run is so near, a solver may find the impact too late: then the run ends before it.
    """
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.05),
        Contact("rub", "a", GROUND, DryFriction(0.1, 0.1), normal=1.0),
        Stop("wall", "a", GROUND, upper=0.5125, restitution=0.25),
    )
    (hit,) = (e.t for e in simulate(scene, (0.0, 0.6), **options).events if e.contact == "wall")
    for ahead in (1e-15, 1e-14, 3e-14, 1e-13, 3e-13, 1e-12, 1e-11, 1e-10):
        v = float(simulate(scene, (0.0, hit + ahead), **options).velocity("a")[-1])
        assert min(abs(v + 0.25), abs(v - 1.0)) < 10 * off


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}])
def test_a_rebound_that_does_not_happen_is_in_the_ledger(options: dict[str, Any]) -> None:
    """A body of 3 kg at 1 m/s comes to a belt at 2 m/s, which takes it along: e = 0.6, but the margin is 0.7 m/s.

    The belt gives ``m v_belt (v_belt - v) = 6 J``: the body goes from 1.5 J to 6 J, ``m (v_belt - v)^2 / 2 = 1.5 J``
    are lost.
    """
    scene = Scene(
        Drive("belt", velocity=2.0),
        Body("a", inertia=3.0, position=0.5, velocity=1.0),
        Stop("stop", "a", "belt", lower=0.0, restitution=0.6),
    )
    result = simulate(scene, (0.0, 1.0), velocity_margin=0.7, **options)
    (event,) = result.events
    assert event.t == pytest.approx(0.5, abs=1e-9)
    assert result.velocity("a")[-1] == 2.0
    ledger = result.energy()
    assert ledger.drives[-1] == pytest.approx(6.0, rel=1e-9)
    assert ledger.impacts["stop"][-1] == pytest.approx(1.5, rel=1e-9)
    assert ledger.relative_error < 1e-12


def test_an_event_elsewhere_does_not_end_a_low_flight() -> None:
    """The ball that falls by 1 m to 3 m, impacts at ``t_n = t1 (1 + 2 e + ... + 2 e^n)``: flight 22 is 1.7e-10 m high.

    A block that slides alone comes to rest as the ball falls back: at ``t = v / (mu g)``. The ball rebounds as before.
    """
    g, e, mu = 9.81, 0.6, 0.3
    t1 = math.sqrt(2 / g)
    before = t1 * (1 + 2 * sum(e**k for k in range(1, 22)))
    stops_at = before + 0.9 * 2 * t1 * e**22
    scene = Scene(
        Body("ball", inertia=2.0, position=4.0),
        Force("ball", -2.0 * g),
        Stop("floor", "ball", GROUND, lower=3.0, restitution=e),
        Body("block", inertia=1.0, velocity=mu * g * stops_at),
        Contact("rub", "block", GROUND, DryFriction(mu, mu), normal=g),
    )
    result = simulate(scene, (0.0, 3.0))
    assert times(result, "rub") == pytest.approx([stops_at], abs=1e-12)
    found = times(result, "floor")
    np.testing.assert_allclose(
        found[:30], [t1 * (1 + 2 * sum(e**k for k in range(1, n))) for n in range(1, 31)], rtol=0, atol=1e-10
    )
    end = result.events[-1]
    assert (end.contact, end.cause, end.after) == ("floor", "impact", Mode.BACKWARD)
    assert end.t == pytest.approx(t1 * (1 + e) / (1 - e), abs=1e-6)


@every_engine
def test_resting_at_a_stop_with_friction_until_lifted_off(options: dict[str, Any], off: float) -> None:
    """Pressed with 3 N, from 1 s on with 4 - t N: at 6 s the pull is 2 N, friction's level; contact and stop let go."""
    scene = Scene(
        Body("block", inertia=1.0, position=1.0),
        Force("block", piecewise_linear([0, 1, 9], [3, 3, -5])),
        Contact("dry", "block", GROUND, DryFriction(2, 1), normal=1),
        Stop("end", "block", GROUND, upper=1.0),
    )
    result = simulate(scene, (0, 7), **options)
    assert {(e.contact, e.after) for e in result.events} == {("dry", Mode.BACKWARD), ("end", Mode.OPEN)}
    # stop and friction share the load; both let go where friction alone cannot hold
    assert times(result, "dry") == pytest.approx([6.0], abs=off)
    assert result.mode("end")[0] == Mode.FORWARD
    assert result.mode("end")[-1] == Mode.OPEN
    assert result.force("end").min() > -1e-9
    total = result.force("end") + result.force("dry")
    early = result.t < 6
    np.testing.assert_allclose(total[early], np.where(result.t < 1, 3, 4 - result.t)[early], rtol=0, atol=1e-9)
    t = 7 - 6
    assert result.velocity("block")[-1] == pytest.approx(-(t + t * t / 2), abs=10 * off)
    balanced(result, off)


@every_engine
def test_a_load_lifts_a_body_off_its_stop(options: dict[str, Any], off: float) -> None:
    """A force ``sin(pi t / 2)``: it presses the body against the stop for 2 s, then lifts it off."""
    scene = Scene(
        Body("m", inertia=1.0, position=0.0),
        Force("m", sine(1.0, frequency=0.25)),
        Stop("end", "m", GROUND, upper=0.0),
    )
    result = simulate(scene, (0, 3), **options)
    assert [(e.before, e.after, e.cause) for e in result.events] == [(Mode.FORWARD, Mode.OPEN, "force 0")]
    assert result.events[0].t == pytest.approx(2.0, abs=off)
    # x'' = sin(pi t / 2) from 2 s on: x' = -(2/pi) (1 + cos(pi t/2))
    at = result.sample([1.0, 3.0])
    assert at.force("end")[0] == pytest.approx(1.0, abs=1e-9)
    assert at.velocity("m")[1] == pytest.approx(-2 / math.pi, abs=off)


def cradle(play: float) -> Scene:
    """Five equal balls of diameter 1; the first comes with 1 m/s from 1 m away."""
    return Scene(
        *(
            Body(
                f"{k}",
                inertia=1.0,
                position=(1 + play) * k - (1.0 if k == 0 else 0.0),
                velocity=float(k == 0),
            )
            for k in range(5)
        ),
        *(Stop(f"{k}-{k + 1}", f"{k}", f"{k + 1}", upper=-1.0, restitution=1.0) for k in range(4)),
    )


@every_engine
def test_a_cradle_of_five(options: dict[str, Any], off: float) -> None:
    """With play the impact goes from ball to ball. Where all touch, Newton's law at all stops moves four alike.

    Balls 2 to 5 get ``v``, ball 1 ``v - 1``: momentum ``5 v - 1 = 1``, so v = 0.4, and no energy is lost.
    """
    apart = simulate(cradle(1e-3), (0, 3), **options)
    assert [e.contact for e in apart.events] == ["0-1", "1-2", "2-3", "3-4"]
    np.testing.assert_allclose([apart.velocity(f"{k}")[-1] for k in range(5)], [0, 0, 0, 0, 1], atol=max(off, 1e-12))
    np.testing.assert_allclose([e.t for e in apart.events], [1.001, 1.002, 1.003, 1.004], atol=off)
    touching = simulate(cradle(0.0), (0, 3), **options)
    final = [touching.velocity(f"{k}")[-1] for k in range(5)]
    np.testing.assert_allclose(final, [-0.6, 0.4, 0.4, 0.4, 0.4], rtol=0, atol=max(off, 1e-12))
    balanced(touching, off)


@every_engine
def test_a_ball_between_closing_walls(options: dict[str, Any], off: float) -> None:
    """The wall comes with 1/2 m/s: each of its blows adds 1 m/s to the speed of the ball."""
    scene = Scene(
        Drive("wall", velocity=-0.5, position=1.0),
        Body("ball", inertia=1.0, position=0.5, velocity=1.0),
        Stop("right", "ball", "wall", upper=0.0, restitution=1.0),
        Stop("left", "ball", GROUND, lower=0.0, restitution=1.0),
    )
    result = simulate(scene, (0, 1.7), **options)
    expected, x, v, t = [], 0.5, 1.0, 0.0
    while True:
        # to the wall at 1 - t/2, and back to 0
        meet = (1 - t / 2 - x) / (v + 0.5)
        t, x, v = t + meet, x + v * meet, v + 1.0
        back = t + x / v
        if back > 1.7:
            break
        expected += [t, back]
        t, x = back, 0.0
    expected = [t for t in [*expected, t] if t < 1.7]
    np.testing.assert_allclose([e.t for e in result.events], expected, rtol=0, atol=20 * off)
    balanced(result, off)
    assert result.energy().drives[-1] == pytest.approx(0.5 * (result.velocity("ball")[-1] ** 2 - 1), abs=1e3 * off)


def test_a_ball_that_walls_crush_is_an_error() -> None:
    scene = Scene(
        Drive("wall", velocity=-0.5, position=1.0),
        Body("ball", inertia=1.0, position=0.5),
        Stop("right", "ball", "wall", upper=0.0),
        Stop("left", "ball", GROUND, lower=0.0),
    )
    with pytest.raises(SimulationError, match="'left'") as caught:
        simulate(scene, (0, 3))
    assert "Gap" in str(caught.value)
    assert caught.value.t == pytest.approx(2.0)


@every_engine
def test_an_impact_through_gears_and_clutches(options: dict[str, Any], off: float) -> None:
    """A rack hits its end: the impulse passes the gear, and the one-way clutch lets the flywheel run ahead.

    Inertia at the rack 1 + 4/0.5^2 = 17 with the gear ``v = 0.5 w``; e = 0.5: v goes from 1 to -0.5.
    """
    scene = Scene(
        Body("rack", inertia=1.0, velocity=1.0),
        Body("pinion", inertia=4.0, velocity=2.0),
        Body("flywheel", inertia=3.0, velocity=2.0),
        Gear("teeth", "rack", "pinion", ratio=0.5),
        OneWay("free", "pinion", "flywheel"),
        Contact("bearing", "flywheel", GROUND, DryFriction(0.3, 0.3), normal=1.0),
        Stop("end", "rack", GROUND, upper=2.0, restitution=0.5),
    )
    result = simulate(scene, (0, 3), **options)
    # the bearing slows all of it: 0.3 * 2 N at the rack, inertia 1 + (4 + 3) * 4
    a = 0.6 / 29
    hit = (1 - math.sqrt(1 - 4 * a)) / a
    assert times(result, "end") == pytest.approx([hit], abs=off)
    speed = 1 - a * hit
    after = result.sample([hit + 1e-9])
    assert after.velocity("rack")[0] == pytest.approx(-0.5 * speed, abs=1e3 * off)
    assert after.velocity("pinion")[0] == pytest.approx(-speed, abs=1e3 * off)
    assert after.velocity("flywheel")[0] == pytest.approx(2 * speed, abs=1e3 * off)
    lost = result.energy().impacts
    assert lost["end"][-1] == pytest.approx(0.5 * 17 * speed**2 * 0.75, abs=1e3 * off)
    assert lost["free"][-1] == 0
    balanced(result, off)


@every_engine
def test_a_jump_of_a_drive_is_counted(options: dict[str, Any], off: float) -> None:
    """A drive that jumps from 0 to 2 m/s takes a tied wheel with it: it gives ``J u^2 / 2``, and nothing is lost.

    A wheel behind a one-way clutch is caught: the drive gives ``J u^2``, and half of it is lost there.
    """
    scene = Scene(
        Drive("motor", velocity=piecewise_linear([0, 1, 1, 3], [0, 0, 2, 2])),
        Body("tied", inertia=3.0),
        Body("caught", inertia=5.0),
        Tie("belt", {"motor": 1.0, "tied": -1.0}),
        OneWay("clutch", "motor", "caught"),
    )
    result = simulate(scene, (0, 3), **options)
    ledger = result.energy()
    assert ledger.kinetic[-1] == pytest.approx(16.0, abs=off)
    # velocities of the drive change while the clutch is locked: half of its jump acts on average
    assert ledger.relative_error < max(off, 1e-12)
    assert ledger.drives[-1] == pytest.approx(16.0 + ledger.impacts["clutch"][-1], abs=off)


def test_stops_in_files_words_and_pictures(tmp_path: Path) -> None:
    scene = Scene(
        Body("m", inertia=1, position=2, velocity=-1),
        Spring("m", GROUND, stiffness=1.0),
        Stop("end", "m", GROUND, lower=-0.5, restitution=0.25, radius_a=0.5),
    )
    assert Scene.from_dict(scene.to_dict()) == scene
    result = simulate(scene, (0, 12))
    result.save(tmp_path / "it.npz")
    again = load(tmp_path / "it.npz")
    assert again.events == result.events
    assert again.energy().relative_error < 1e-12
    copied = pickle.loads(pickle.dumps(result))
    assert np.array_equal(copied.sample(50).force("end"), result.sample(50).force("end"))
    assert "rigid at -0.5, restitution 0.25" in explain(scene)
    assert "impacts of 'end'" in str(result.energy())
    result.to_csv(tmp_path / "it.csv")
    result.plot()
    assert (result.stretch("end") >= -0.5 - 1e-12).all()


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({}, "neither lower nor upper"),
        ({"lower": 2, "upper": 1}, "lower must not be above upper, got 2 and 1"),
        ({"lower": 1, "upper": 1}, "both 1, so nothing could move; use a Tie"),
        ({"upper": 1, "restitution": -0.1}, "restitution must be within [0, 1], got -0.1"),
        ({"upper": 1, "restitution": 1.1}, "restitution must be within [0, 1], got 1.1"),
        ({"upper": 1, "restitution": math.nan}, "restitution"),
        ({"upper": math.nan}, "upper"),
        ({"lower": math.inf}, "lower"),
        ({"upper": 1, "radius_a": 0}, "radius_a must not be 0"),
    ],
)
def test_bad_stops_are_refused(values: dict[str, Any], said: str) -> None:
    with pytest.raises((ValueError, TypeError), match="stop 's'") as caught:
        Stop("s", "a", "b", **values)
    assert said in str(caught.value)


def test_bad_starts_are_refused() -> None:
    def start(position: float) -> Scene:
        return Scene(Body("m", inertia=1, position=position), Stop("s", "m", GROUND, lower=-1, upper=1))

    with pytest.raises(ValueError, match=r"stop 's'.* stretch is 1\.5, beyond its upper limit 1; give its bodies"):
        simulate(start(1.5), (0, 1))
    with pytest.raises(ValueError, match=r"stop 's'.* stretch is -3, beyond its lower limit -1"):
        simulate(start(-3.0), (0, 1))
    with pytest.raises(ValueError, match="fixed-step method cannot locate impacts; use method='series'"):
        simulate(start(0.0), (0, 1), method="RK4", step=0.01)
    assert simulate(start(1.0), (0, 1)).mode("s")[0] == Mode.FORWARD


def test_a_start_at_a_limit_that_goes_on_into_it_rebounds_at_once() -> None:
    scene = Scene(Body("m", inertia=1, position=1.0, velocity=2.0), Stop("s", "m", GROUND, upper=1, restitution=0.5))
    result = simulate(scene, (0, 1))
    assert result.velocity("m")[0] == -1.0
    assert [(e.t, e.cause) for e in result.events] == [(0.0, "impact")]


def test_of_many_stops_those_rebound_at_once_that_start_at_a_limit() -> None:
    scene = Scene(
        *(Body(name, inertia=1, position=1.0, velocity=2.0) for name in "ab"),
        Stop("s", "a", GROUND, upper=1, restitution=0.5),
        Stop("far", "b", GROUND, upper=4, restitution=0.5),
    )
    result = simulate(scene, (0, 2))
    assert [(e.t, e.contact, e.cause) for e in result.events] == [
        (0.0, "s", "impact"),
        (1.5, "far", "impact"),
    ]
    assert result.velocity("a")[0] == -1.0


@pytest.mark.parametrize(("one", "other"), [(-3.0, -3.0), (3.0, 3.0), (0.1 + 0.2, 0.3), (-0.3, -0.1 - 0.2)])
def test_what_starts_together_at_a_stop_goes_on_together(one: float, other: float) -> None:
    """Both sides of a closed stop move with one velocity but for roundoff, forward or backward: there is no impact."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=one),
        Body("b", inertia=2.0, velocity=other),
        Stop("s", "a", "b", upper=0, restitution=0.5),
    )
    result = simulate(scene, (0, 1))
    assert result.events == []
    assert result.velocity("a")[-1] == result.velocity("b")[-1] == pytest.approx(one, rel=1e-15)


def test_a_stop_that_parts_as_another_is_hit_gives_no_energy() -> None:
    """The wall throws A back with 1 m/s, into B, which moves away with 0.5 m/s: both go on with (1 + 0.5) / 2 m/s."""
    scene = Scene(
        Body("A", inertia=1.0, velocity=1.0),
        Body("B", inertia=1.0, velocity=-0.5),
        Stop("wall", "A", GROUND, upper=0.0, restitution=1.0),
        Stop("between", "A", "B", lower=0.0, restitution=1.0),
    )
    result = simulate(scene, (0, 1))
    assert result.velocity("A")[0] == pytest.approx(-0.75, abs=1e-15)
    assert result.velocity("B")[0] == pytest.approx(-0.75, abs=1e-15)
    assert result.energy().kinetic[0] < 0.5 * (1.0 + 0.25)


def test_rebounds_that_end_keep_the_momentum() -> None:
    """Bodies of 1 and 3 kg, pressed together by 1 N: they keep 1.1 kg m/s, also where rebounds become roundoff."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.5, position=0.7),
        Body("b", inertia=3.0, velocity=0.2),
        Stop("stop", "a", "b", upper=0.8, restitution=0.3),
        Force("a", 1.0),
        Force("b", -1.0),
    )
    result = simulate(scene, (0.0, 1.0))
    assert result.mode("stop")[-1] == Mode.FORWARD
    np.testing.assert_allclose(result.velocity("a") + 3.0 * result.velocity("b"), 1.1, rtol=0, atol=1e-14)
    assert result.energy().relative_error < 1e-14


@pytest.mark.parametrize(("step", "options"), [(0, {}), (3, {}), (4, {}), (7, {}), (1, {"formulation": "multiplier"})])
def test_what_is_pressed_against_a_stop_stays_there_as_friction_turns_over(step: int, options: dict[str, Any]) -> None:
    """30 N press a block against a swinging belt; friction of 1.2 N on the ground changes its sign with the velocity.

    In that instant the block is at rest; friction alone could hold it, but the load presses it on against the stop.
    """
    frequency, phase = 0.3 + 0.05 * step, 0.2 * step
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.0, position=-0.1),
        Drive("belt", velocity=sine(0.7, frequency, phase)),
        Contact("rub", "a", GROUND, DryFriction(0.3, 0.2, dwell=0.05), normal=6.0),
        Stop("stop", "a", "belt", upper=0.02, restitution=0.3),
        Force("a", 30.0),
    )
    result = simulate(scene, (0.0, 10.0), **options)
    w = 2 * math.pi * frequency
    turns = np.array([e.t for e in result.events if e.contact == "rub" and e.t > 3.0])
    assert turns.size >= 4
    np.testing.assert_allclose(np.sin(w * turns + phase), 0.0, rtol=0, atol=1e-6)
    late = result.sample(np.linspace(3.0, 10.0, 201))
    assert (late.mode("stop") == Mode.FORWARD).all()
    pressed = 30.0 - 0.7 * w * np.cos(w * late.t + phase) - late.force("rub")
    np.testing.assert_allclose(late.force("stop"), pressed, rtol=0, atol=1e-5)
    assert not [e for e in result.events if e.contact == "stop" and e.t > 3.0]


@pytest.mark.parametrize("lower", [-math.inf, -1e12, -1e30])
@pytest.mark.parametrize(("duration", "method"), [(2.0, "BDF"), (2.0, "series"), (1e3, "series"), (1e6, "series")])
def test_a_limit_near_by_is_met_however_long_the_run_or_far_the_other_limit(
    lower: float, duration: float, method: str
) -> None:
    """``x = t - t^2 / 2`` meets 0.499 at ``1 - sqrt(1 - 2 * 0.499)``, and with e = 1 never comes back."""
    stop = Stop("wall", "m", GROUND, lower=lower, upper=0.499, restitution=1.0)
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Force("m", -1.0), stop)
    result = simulate(scene, (0.0, duration), method=method)
    met = 1 - 0.002**0.5
    (event,) = result.events
    assert event.cause == "impact" and event.after is Mode.OPEN
    assert event.t == pytest.approx(met, abs=1e-14 if method == "series" else 1e-7)
    flown = duration - met
    place = 0.499 - (1 - met) * flown - 0.5 * flown**2
    assert result.position("m")[-1] == pytest.approx(place, rel=1e-13 if method == "series" else 1e-7)


@pytest.mark.parametrize("length", [1e-6, 1e-3])
@pytest.mark.parametrize("bodies", [1, 40])
def test_an_impact_soon_in_a_run_of_months(length: float, bodies: int) -> None:
    """``x = t + t^2 / 2`` meets `length` at ``sqrt(1 + 2 length) - 1`` and stays there, alone and among others."""
    scene = Scene(
        *(Body(f"m{k}", inertia=1.0, velocity=1.0) for k in range(bodies)),
        *(Force(f"m{k}", 1.0) for k in range(bodies)),
        *(Stop(f"s{k}", f"m{k}", GROUND, upper=(k + 1) * length) for k in range(bodies)),
    )
    result = simulate(scene, (0.0, 5e6))
    limits = length * np.arange(1, bodies + 1)
    met = 2 * limits / (1 + np.sqrt(1 + 2 * limits))
    np.testing.assert_allclose([event.t for event in result.events], met, rtol=1e-13)
    np.testing.assert_allclose([result.position(f"m{k}")[-1] for k in range(bodies)], limits, rtol=1e-13)


@pytest.mark.parametrize("method", ["auto", "BDF"])
@pytest.mark.parametrize("start", [0.0, 2.66, 1e3])
@pytest.mark.parametrize("place", [0.0, 1e-19, 1e-16])
def test_what_starts_at_a_limit_but_for_roundoff_rebounds(place: float, start: float, method: Any) -> None:
    """A ball of -2 m/s and a restitution of 1/2 leaves with 1 m/s, wherever the clock stands."""
    scene = Scene(
        Body("ball", inertia=1.0, velocity=-2.0, position=place),
        Stop("floor", "ball", GROUND, lower=0.0, upper=5.0, restitution=0.5),
    )
    result = simulate(scene, (start, start + 2.0), method=method)
    assert [event.cause for event in result.events] == ["impact"]
    assert result.velocity("ball")[-1] == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("limit", [0.35, 1000.0])
@pytest.mark.parametrize("creep", [1e-5, 1e-8])
def test_what_happens_just_before_an_impact_is_none(limit: float, creep: float) -> None:
    """A ball bounces on a stop and rubs on a drive that creeps towards it: before each impact the slip reverses.

    It rises against 10.81 N and falls with 8.81 N: a flight that begins with u ends with u sqrt(8.81 / 10.81).
    """
    scene = Scene(
        Body("ball", inertia=1.0, position=limit + 0.1),
        Force("ball", -9.81),
        Drive("creep", velocity=-creep),
        Contact("rub", "ball", "creep", DryFriction(0.2, 0.2), normal=5.0),
        Stop("floor", "ball", GROUND, lower=limit, restitution=0.3),
    )
    result = simulate(scene, (0.0, 2.0))
    t, v, expected = math.sqrt(0.2 / 8.81), math.sqrt(0.2 * 8.81), []
    for _ in range(8):
        expected.append(t)
        u = 0.3 * v
        v = u * math.sqrt(8.81 / 10.81)
        t += u / 10.81 + v / 8.81
    impacts = [event.t for event in result.events if event.contact == "floor"]
    assert impacts[:8] == pytest.approx(expected, abs=10 * creep)
    assert len(result.events) < 60 and result.mode("floor")[-1] == -1
    assert result.position("ball")[-1] == pytest.approx(limit, abs=1e-11 * limit)


def test_impacts_at_two_stops_that_accumulate_end_together() -> None:
    """A body in the narrowing corner of two stops: within 1e-9 s it is struck by both in turn, faster and faster."""
    scene = Scene(
        *(Body(name, inertia=m) for name, m in {"a": 1.19, "b": 0.21, "c": 1.74, "d": 0.75}.items()),
        Drive("drive", velocity=1.89),
        Tie("mesh", {"a": -2.2, "d": 1.0}),
        Contact(
            "ca", "c", "a", DryFriction(0.19, 0.19), normal=piecewise_linear([0.13, 1.72, 2.45], [0.97, 0.0, 4.49])
        ),
        Contact("ground", "a", GROUND, DryFriction(0.37, 0.37), normal=3.01),
        Spring("a", GROUND, stiffness=4.84, damping=0.14),
        Contact("ba", "b", "a", DryFriction(0.484, 0.39), normal=8.04),
        Gap("gap", "d", "c", stiffness=225.46, damping=1.48, lower=-0.1, upper=0.21, radius_a=1.8, radius_b=1.8),
        Stop("driven", "b", "drive", lower=-0.56, upper=0.43, restitution=0.5, radius_a=1.7, radius_b=1.4),
        Stop("play", "c", "b", lower=-0.11, upper=0.51),
        Force("b", 0.75),
        Force("c", piecewise_linear([0.54, 3.56], [-1.31, -5.64])),
    )
    exact, found = simulate(scene, (0.0, 3.0)), simulate(scene, (0.0, 3.0), method="BDF", rtol=1e-10, atol=1e-12)
    assert len(exact.events) == len(found.events) < 40
    times = np.linspace(0.01, 2.99, 61)
    np.testing.assert_allclose(exact(times), found(times), atol=1e-6)


@pytest.mark.parametrize("rtol", [1e-7, 1e-8, 1e-9])
def test_rebounds_lower_than_a_step_may_err_come_to_an_end(rtol: float) -> None:
    """Each impact leaves 0.6 of the speed: there are some 25. A flight must not gain speed by the error of a step."""
    scene = Scene(
        Body("idle", inertia=1.51),
        Body("ball", inertia=1.72),
        Body("first", inertia=0.61),
        Body("second", inertia=2.07),
        Contact("c", "idle", GROUND, DryFriction(0.3, 0.3), normal=5.0),
        Stop("end", "ball", GROUND, lower=-0.4, upper=0.4, restitution=0.6, radius_a=0.4),
        Stop("hook", "ball", "first", upper=0.18),
        OneWay("freewheel", "first", "second"),
        Force("ball", -7.66),
        Force("second", piecewise_linear([0.26, 0.75], [-6.29, 9.56])),
    )
    exact, found = simulate(scene, (0.0, 3.0)), simulate(scene, (0.0, 3.0), method="BDF", rtol=rtol, atol=0.01 * rtol)
    assert len(found.events) <= len(exact.events)
    times = np.linspace(0.0, 3.0, 61)
    np.testing.assert_allclose(found(times), exact(times), rtol=0, atol=300 * rtol)
    assert found.velocity("ball")[-1] == 0.0


def test_a_stop_that_hardly_leaves_its_limit_is_not_struck_by_roundoff() -> None:
    """The stop opens with almost no acceleration; a gear sets its velocity, with the roundoff of other velocities."""
    scene = Scene(
        Body("a", inertia=1.49),
        Body("b", inertia=0.51),
        Body("c", inertia=1.55),
        Contact(
            "rub",
            "a",
            "b",
            DryFriction(0.156, 0.12, stribeck_velocity=0.27),
            normal=piecewise_linear([0.89, 1.59, 2.78], [5.75, 2.22, 5.21]) + 5.0 * velocity("a"),
        ),
        Tie("gear", {"c": -1.0, "b": 2.5, "a": -1.5}),
        Stop("first", "b", GROUND, lower=-0.1, upper=0.08),
        Stop("second", "b", "a", upper=0.3, restitution=0.6, radius_a=0.8, radius_b=1.1),
        Stop("third", GROUND, "b", lower=0.0, upper=0.3, radius_a=0.3, radius_b=1.9),
        Spring("b", "a", stiffness=30.36, damping=0.43, radius_b=0.7),
        Force("c", sine(4.75, 0.32, 0.0, 2.67)),
        Force("b", -0.67),
    )
    result, exact = (
        simulate(scene, (0.0, 3.0), **options)
        for options in ({}, {"formulation": "multiplier", "rtol": 1e-9, "atol": 1e-11})
    )
    assert len(result.events) < 20
    times = np.linspace(0.0, 3.0, 31)
    np.testing.assert_allclose(result(times), exact(times), rtol=0, atol=1e-6)
