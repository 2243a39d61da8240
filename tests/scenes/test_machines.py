"""Gears, planetaries, ties, one-way clutches and radii against closed forms, in every formulation and engine."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gear,
    Mode,
    OneWay,
    Planetary,
    Result,
    Scene,
    Spring,
    Tie,
    explain,
    load,
    piecewise_linear,
    signal,
    simulate,
    sine,
    step,
)

EXACT: dict[str, Any] = {"method": "series"}
ENGINES: dict[str, tuple[dict[str, Any], float]] = {
    "series": (EXACT, 1e-9),
    "BDF": ({"method": "BDF"}, 2e-6),
    "Adams": ({"method": "Adams"}, 2e-6),
    "merged": ({"formulation": "merged", "method": "BDF"}, 2e-6),
    "multiplier": ({"formulation": "multiplier"}, 2e-6),
    "RK4": ({"method": "RK4", "step": 1e-3}, 1e-2),
}
every_engine = pytest.mark.parametrize(("options", "off"), ENGINES.values(), ids=ENGINES)


def dry(static: float, coulomb: float | None = None) -> DryFriction:
    return DryFriction(static, static if coulomb is None else coulomb)


def times(result: Result, name: str) -> list[float]:
    return [event.t for event in result.events if event.contact == name]


def check(result: Result, name: str, expected: list[float], off: float) -> None:
    found = times(result, name)
    assert len(found) == len(expected), found
    np.testing.assert_allclose(found, expected, rtol=0, atol=off)


def balanced(result: Result, off: float) -> None:
    assert result.success
    assert result.energy().relative_error < max(off, 1e-12)


# -- ties -------------------------------------------------------------------------------------------------


def two_shafts(torque: Any) -> Scene:
    return Scene(
        Body("1", inertia=0.1),
        Body("2", inertia=4.0),
        Gear("teeth", "1", "2", ratio=5),
        Contact("bearing 1", "1", GROUND, dry(0.8, 0.5), normal=1),
        Contact("bearing 2", "2", GROUND, dry(7.5, 6), normal=1),
        Force("1", torque),
    )


@every_engine
def test_a_gear_with_friction_on_both_shafts(options: dict[str, Any], off: float) -> None:
    """Seen from shaft 1 the inertia is 0.1 + 4/25 = 0.26 and the friction 0.5 + 6/5 = 1.7: 3 N m give 5 rad/s^2."""
    result = simulate(two_shafts(piecewise_linear([0, 2, 2], [3, 3, 0])), (0, 5), **options)
    at = result.sample([1.0, 1.9])
    np.testing.assert_allclose(at.velocity("1"), [5.0, 9.5], atol=10 * off)
    np.testing.assert_allclose(at.force("teeth"), 2.0, atol=off)
    assert (result.mode("teeth") == 0).all()
    stop = 2 + 10 / (1.7 / 0.26)
    assert stop - 2 == pytest.approx(1.529411764705882, abs=1e-14)
    for name in ("bearing 1", "bearing 2"):
        check(result, name, [stop], off)
    assert np.array_equal(result.velocity("1"), 5 * result.velocity("2"))
    assert np.abs(result.position("1") - 5 * result.position("2")).max() < 1e-12
    balanced(result, off)


@every_engine
def test_both_shafts_break_loose_at_the_sum_of_their_levels(options: dict[str, Any], off: float) -> None:
    """Static torques 0.8 and 7.5/5 hold together: 2.3 N m; below it each carries some of it, above it both slip."""
    result = simulate(two_shafts(piecewise_linear([0, 4], [0, 4])), (0, 4), **options)
    check(result, "bearing 1", [2.3], off)
    check(result, "bearing 2", [2.3], off)
    before = result.sample([1.0])
    assert before.force("bearing 1") + before.force("bearing 2") / 5 == pytest.approx(1.0, abs=1e-9)


@every_engine
def test_modelica_rotational_first(options: dict[str, Any], off: float) -> None:
    scene = Scene(
        Body("1", inertia=0.1),
        Body("2", inertia=2),
        Body("3", inertia=2),
        Gear("gear", "1", "2", ratio=10),
        Damper("2", GROUND, damping=10),
        Spring("2", "3", stiffness=1e4),
        Force("1", sine(10, frequency=5)),
    )
    result = simulate(scene, (0, 1), **options)
    assert result.position("3")[-1] == pytest.approx(0.1628616428799686, abs=off)
    assert result.velocity("3")[-1] == pytest.approx(-0.1381452799183233, abs=off)
    # one is a state and one the integral of a velocity
    gap = np.abs(result.position("1") - 10 * result.position("2")).max()
    assert gap < (1e-12 if options is EXACT else off)
    balanced(result, off)


@every_engine
def test_positions_that_springs_read_obey_the_ties(options: dict[str, Any], off: float) -> None:
    scene = Scene(
        Body("sun", inertia=1, velocity=3),
        Body("carrier", inertia=2, velocity=2.5),
        Body("ring", inertia=0, velocity=(2.5 * 2.5 - 3) / 1.5),
        Planetary("p", sun="sun", carrier="carrier", ring="ring", ratio=1.5),
        *(Spring(name, GROUND, stiffness=k) for name, k in (("sun", 5), ("carrier", 3), ("ring", 7))),
        Contact("brake", "ring", GROUND, dry(0.5, 0.3), normal=1),
    )
    result = simulate(scene, (0, 10), **options)
    sun, carrier, ring = (result.position(name) for name in ("sun", "carrier", "ring"))
    assert np.abs(2.5 * carrier - sun - 1.5 * ring).max() < 1e-12
    assert result.events
    balanced(result, off)


@every_engine
def test_a_planetary_shifts(options: dict[str, Any], off: float) -> None:
    """Sun 1, carrier 10, ring without inertia; load torque 20 on the carrier, ratio 1.5, first by hand.

    Brake closed: v_sun = 2.5 v_c, so 16.25 a = 2.5 20 - 20 on the carrier; without torque the load turns it back.
    """
    f = piecewise_linear([0, 2, 2.1], [0, 0, 1])
    scene = Scene(
        Body("sun", inertia=1),
        Body("carrier", inertia=10),
        Body("ring", inertia=0),
        Planetary("gear", sun="sun", carrier="carrier", ring="ring", ratio=1.5),
        Contact("clutch", "sun", "ring", dry(100), normal=f),
        Contact("brake", "ring", GROUND, dry(100), normal=1 - f),
        Force("sun", step(0.5, 0, 20)),
        Force("carrier", -20),
    )
    result = simulate(scene, (0, 5), **options)
    a0, a1 = -20 / 16.25, 30 / 16.25
    assert result.sample([1.9]).velocity("carrier")[0] == pytest.approx(a0 * 0.5 + a1 * 1.4, abs=10 * off)
    # the clutch, slipping forward, gives c = 100 f from the sun to the ring; the teeth give lambda to the sun:
    # 2.5 a = 20 - c + lambda and 10 a = -20 - 2.5 lambda, so the brake carries 1.5 lambda + c = -300/13 + 25/13 c
    c = (100 + 300 / 13) / (1 + 25 / 13)
    loose = 2 + c / 1000
    check(result, "brake", [loose], off)
    w_carrier = a0 * 0.5 + a1 * 1.5 + a1 * (loose - 2) - 2.5 / 16.25 * 1000 * (loose - 2) ** 2 / 2
    assert result.sample([loose]).velocity("carrier")[0] == pytest.approx(w_carrier, abs=20 * off)
    # the ring has no inertia: 1.5 lambda = 100 (1 - f) - 100 f from then on
    lock = next(e.t for e in result.events if e.contact == "clutch" and e.after == Mode.STUCK)
    x0, x1 = loose - 2, lock - 2
    span, area = x1 - x0, 1000 * (x1**2 - x0**2) / 2
    push = (100 * span - 2 * area) / 1.5
    w_sun = 2.5 * w_carrier + 20 * span - area + push
    w_carrier -= (2.5 * push + 20 * span) / 10
    assert w_sun == pytest.approx(w_carrier, abs=100 * off)
    # then all turn as one under 20 - 20 and the falling torque of the brake
    w_carrier -= 1000 * (0.1 - x1) ** 2 / 2 / 11
    assert result.velocity("carrier")[-1] == pytest.approx(w_carrier, abs=50 * off)
    if options is EXACT:
        assert np.array_equal(result.velocity("sun")[-1:], result.velocity("ring")[-1:])
    off_tie = 2.5 * result.velocity("carrier") - result.velocity("sun") - 1.5 * result.velocity("ring")
    assert np.abs(off_tie).max() < 4e-15
    balanced(result, off)


@every_engine
def test_a_lever_shares_a_force(options: dict[str, Any], off: float) -> None:
    """Masses 1 and 2 at arms 2 and 1: v_a = 2 v_b; a force of 6 on b moves b with 6 / (2 + 4 1) = 1."""
    scene = Scene(Body("a", inertia=1), Body("b", inertia=2), Tie("lever", {"a": 1, "b": -2}), Force("b", 6))
    result = simulate(scene, (0, 2), **options)
    assert result.velocity("a")[-1] == pytest.approx(4.0, abs=10 * off)
    # the tie's force is what accelerates a, and acts on it with -1
    np.testing.assert_allclose(result.force("lever"), -2.0, atol=1e-9)
    np.testing.assert_allclose(result.relative_velocity("lever"), 0.0, atol=1e-15)
    assert not result.power("lever").any()
    balanced(result, off)


@every_engine
def test_a_drive_turns_a_gear_and_its_power_counts(options: dict[str, Any], off: float) -> None:
    """A motor at 10 t turns a shaft of 3 at 5 t against a torque of 4: the shaft needs 3 * 5 + 4 = 19, 19 * 5 t W."""
    scene = Scene(
        Body("shaft", inertia=3),
        Drive("motor", velocity=piecewise_linear([0, 2], [0, 20])),
        Gear("teeth", "motor", "shaft", ratio=2),
        Contact("bearing", "shaft", GROUND, dry(4), normal=1),
    )
    result = simulate(scene, (0, 2), **options)
    at = result.sample([0.5, 1.0])
    np.testing.assert_allclose(at.velocity("shaft"), [2.5, 5.0], atol=1e-12)
    # lambda acts with +2 on the shaft
    np.testing.assert_allclose(at.force("teeth"), 19 / 2, atol=1e-9)
    assert result.energy().drives[-1] == pytest.approx(19 * 5 * 2, abs=100 * off)
    balanced(result, off)


def test_a_drive_that_jumps_takes_what_is_tied_along_and_friction_slips() -> None:
    """The jump goes through the teeth. Friction is finite: b slips, speeds up by 2 / 4 rad/s^2, sticks 4 s later."""
    scene = Scene(
        Body("a", inertia=1),
        Body("b", inertia=4),
        Drive("motor", velocity=step(1.0, 0, 4)),
        Gear("teeth", "a", "motor", ratio=0.5),
        Contact("clutch", "a", "b", dry(2), normal=1),
    )
    result = simulate(scene, (0, 6))
    at = result.sample([1.0, 2.0])
    np.testing.assert_array_equal(at.velocity("a"), [2.0, 2.0])
    np.testing.assert_allclose(at.velocity("b"), [0.0, 0.5], atol=1e-14)
    assert [(e.t, e.after) for e in result.events] == [(1.0, Mode.FORWARD), (pytest.approx(5.0), Mode.STUCK)]


@every_engine
def test_a_body_without_inertia_slips_with_the_drive_that_it_is_tied_to(options: dict[str, Any], off: float) -> None:
    """Friction takes 0.2 N m either way: the drive's work is 0.2 times the way of a body at 2 sin(2 pi t) rad/s."""
    scene = Scene(
        Body("z", inertia=0),
        Drive("m", velocity=sine(1, frequency=1)),
        Gear("g", "z", "m", ratio=2),
        Contact("k", "z", GROUND, dry(0.3, 0.2), normal=1),
    )
    result = simulate(scene, (0, 0.9), **options)
    np.testing.assert_allclose(result.velocity("z"), 2 * result.velocity("m"), atol=1e-15)
    way = 2 * (3 + math.cos(0.2 * math.pi)) / (2 * math.pi)
    assert result.energy().drives[-1] == pytest.approx(0.2 * way, abs=10 * off)
    assert result.sample([0.25]).force("g")[0] == pytest.approx(-0.2, abs=1e-12)


def test_a_tie_to_the_ground_holds() -> None:
    scene = Scene(Body("a", inertia=1), Body("b", inertia=1), Tie("t", {"a": 3, GROUND: 1}), Force("a", 6))
    result = simulate(scene, (0, 1))
    assert not result.velocity("a").any()
    np.testing.assert_allclose(result.force("t"), 2.0)


def test_gears_that_lock_each_other_hold_everything() -> None:
    """Two ratios between the same shafts leave no motion; both teeth share the torque."""
    scene = Scene(
        Body("a", inertia=1),
        Body("b", inertia=1),
        Gear("one", "a", "b", ratio=1),
        Gear("two", "a", "b", ratio=2),
        Force("a", 1.0),
    )
    result = simulate(scene, (0, 1))
    assert not result.velocity("a").any() and not result.velocity("b").any()
    # a: one + two = 1; b: one + 2 two = 0
    np.testing.assert_allclose(result.force("one"), 2.0)
    np.testing.assert_allclose(result.force("two"), -1.0)


def test_a_contact_beside_a_gear_of_the_same_ratio_never_slips() -> None:
    """The gear holds any force: a contact whose share exceeds its level carries its level, at rest."""
    scene = Scene(
        Body("a", inertia=1),
        Body("b", inertia=1),
        Gear("teeth", "a", "b", ratio=1),
        Contact("pad", "a", "b", dry(1, 0.5), normal=1),
        Force("a", piecewise_linear([0, 10], [0, 20])),
    )
    result = simulate(scene, (0, 10))
    assert not result.events
    at = result.sample([1.0, 9.0])
    # half of the force goes to b; pad and gear carry equal parts of it until the pad is at its level of 1
    np.testing.assert_allclose(at.force("pad"), [0.5, 1.0], atol=1e-9)
    np.testing.assert_allclose(at.force("teeth"), [0.5, 8.0], atol=1e-9)


def test_small_residuals_at_the_start_are_projected_and_larger_ones_refused() -> None:
    def scene(residual: float) -> Scene:
        return Scene(
            Body("a", inertia=1, velocity=2 + residual),
            Body("b", inertia=1, velocity=1),
            Gear("g", "a", "b", ratio=2),
        )

    result = simulate(scene(1e-10), (0, 1))
    assert np.array_equal(result.velocity("a"), 2 * result.velocity("b"))
    # momentum along the motion is kept: 2 v_a + v_b over 2^2 + 1
    assert result.velocity("b")[0] == pytest.approx(1 + 2e-10 / 5, abs=1e-15)
    with pytest.raises(ValueError, match=r"gear 'g': the velocities at the start break it by 1.00\d*e-06"):
        simulate(scene(1e-6), (0, 1))


# -- radii ------------------------------------------------------------------------------------------------


def car(torque: float) -> Scene:
    return Scene(
        Body("car", inertia=1200, velocity=20),
        Body("wheel", inertia=4, velocity=20 / 0.3),
        Contact("road", "wheel", "car", dry(0.8), normal=1200 * 9.81, radius_a=0.3),
        Contact("brake", "wheel", GROUND, dry(1), normal=torque),
    )


@every_engine
def test_a_braked_wheel_rolls(options: dict[str, Any], off: float) -> None:
    result = simulate(car(2500), (0, 4), **options)
    check(result, "brake", [2.986666666666667], off)
    assert result.position("car")[-1] == pytest.approx(29.86666666666667, abs=10 * off)
    assert not times(result, "road")
    assert np.abs(0.3 * result.velocity("wheel") - result.velocity("car")).max() < 1e-14
    # m a is what the road carries
    assert result.sample([1.0]).force("road")[0] == pytest.approx(-1200 * 20 / 2.986666666666667, rel=1e-9)
    balanced(result, off)


@pytest.mark.parametrize(("torque", "rolls"), [(2929.91, True), (2929.93, False)])
def test_the_wheel_slides_beyond_the_limit(torque: float, rolls: bool) -> None:
    """T = mu m g (r + J / (m r)) = 2929.92 N m.

    A wheel that slides is braked by T - mu m g r, and mu g brakes the car; rolling both share T r / (m r^2 + J).
    """
    result = simulate(car(torque), (0, 1))
    assert (result.mode("road")[-1] == 0) == rolls
    if rolls:
        car_slows = torque * 0.3 / (1200 * 0.3**2 + 4)
        wheel_slows = car_slows / 0.3
    else:
        car_slows, wheel_slows = 0.8 * 9.81, (torque - 0.8 * 1200 * 9.81 * 0.3) / 4
    assert result.velocity("car")[-1] == pytest.approx(20 - car_slows, rel=1e-12)
    assert result.velocity("wheel")[-1] == pytest.approx(20 / 0.3 - wheel_slows, rel=1e-12)


def test_negative_radii_turn_the_other_way() -> None:
    """A negative radius is a belt crossed: the same as a positive one with the velocity's sign changed."""

    def scene(sign: float) -> Scene:
        return Scene(
            Body("a", inertia=1, velocity=3.0),
            Body("b", inertia=2, velocity=sign * 0.5),
            Contact("c", "a", "b", dry(20, 10), normal=1, radius_a=0.5, radius_b=sign * 0.25),
            Spring("a", "b", stiffness=7, damping=0.1, radius_a=0.5, radius_b=sign * 2, rest=0.1),
        )

    plain, turned = (simulate(scene(sign), (0, 5), t_eval=np.linspace(0, 5, 51)) for sign in (1.0, -1.0))
    assert plain.events == turned.events and plain.events
    np.testing.assert_allclose(plain.velocity("a"), turned.velocity("a"), atol=1e-13)
    np.testing.assert_allclose(plain.velocity("b"), -turned.velocity("b"), atol=1e-13)
    np.testing.assert_allclose(plain.force("c"), turned.force("c"), atol=1e-13)


@every_engine
def test_a_spring_at_radii_oscillates_with_them(options: dict[str, Any], off: float) -> None:
    """Stretch 0.5 x_a with k = 8: effective stiffness 2, mass 0.5, so omega = 2; 0.5 x_a - rest = 0 at x_a = 1."""
    scene = Scene(Body("a", inertia=0.5, position=1.3), Spring("a", GROUND, stiffness=8, rest=0.5, radius_a=0.5))
    result = simulate(scene, (0, 2), **options)
    np.testing.assert_allclose(result.position("a"), 1 + 0.3 * np.cos(2 * result.t), atol=off)
    np.testing.assert_allclose(result.energy().spring, 0.5 * 8 * (0.15 * np.cos(2 * result.t)) ** 2, atol=off)
    balanced(result, off)


def test_radii_of_a_damper() -> None:
    """A brake fan at radius 3: torque 9 c w, so the speed falls by exp(-9 c t / J)."""
    result = simulate(Scene(Body("a", inertia=2, velocity=5), Damper("a", GROUND, damping=0.5, radius_a=3)), (0, 1))
    np.testing.assert_allclose(result.velocity("a"), 5 * np.exp(-9 * 0.5 / 2 * result.t), atol=1e-12)
    assert result.energy().heat[-1] == pytest.approx(25 * (1 - math.exp(-4.5)), abs=1e-11)


# -- one-way clutches -------------------------------------------------------------------------------------


def freewheel() -> Scene:
    engaged = piecewise_linear([0.3, 0.3, 0.95, 0.95, 1.6, 1.6], [0, 3, 3, 0, 0, 3])
    return Scene(
        Body("in", inertia=1, velocity=-0.5),
        Body("out", inertia=1),
        OneWay("free", "in", "out"),
        Contact("clutch", "in", "out", dry(12.5, 0.5), normal=engaged),
        Force("in", sine(10, frequency=3)),
    )


@pytest.mark.parametrize("name", ["series", "BDF", "multiplier", "RK4"])
def test_modelica_one_way_clutch(name: str) -> None:
    """At 1.5 s the relative velocity touches 0: no event with the series; solvers may find some within their errors."""
    options, off = ENGINES[name]
    result = simulate(freewheel(), (0, 2), **options)
    expected = [0.0802800002413492, 1 / 6, 0.430677395670009, 0.95, 1.05, 7 / 6, 1.756204447415]
    if name == "series":
        check(result, "free", expected, off)
    else:
        found = [t for t in times(result, "free") if abs(t - 1.5) > 1e-4]
        np.testing.assert_allclose(found, expected, atol=off)
    assert result.velocity("in")[-1] == result.velocity("out")[-1] == pytest.approx(-0.25, abs=off)
    assert result.position("in")[-1] == pytest.approx(-0.2123499945496375, abs=off)
    assert set(result.mode("free").tolist()) == {-1, 0}
    assert result.relative_velocity("free").max() < 2 * off
    if name != "RK4":
        assert result.force("free").min() > -1e-9
    balanced(result, 10 * off)


@every_engine
def test_a_one_way_clutch_drives_and_lets_run_ahead(options: dict[str, Any], off: float) -> None:
    """3 N m drive inertias 1 and 2 to 1 rad/s in 1 s, with 2 N m in the clutch; then a torque of -1 on `a` frees b."""
    scene = Scene(
        Body("a", inertia=1),
        Body("b", inertia=2),
        OneWay("clutch", "a", "b"),
        Force("a", piecewise_linear([1, 1], [3, -1])),
    )
    result = simulate(scene, (0, 2), **options)
    check(result, "clutch", [1.0], off)
    assert result.sample([0.5]).force("clutch")[0] == pytest.approx(2.0, abs=1e-9)
    assert result.velocity("a")[-1] == pytest.approx(0.0, abs=10 * off)
    assert result.velocity("b")[-1] == pytest.approx(1.0, abs=10 * off)
    assert not result.force("clutch")[result.t > 1.1].any()
    balanced(result, off)


def test_a_drive_that_jumps_forward_takes_the_clutch_along() -> None:
    """The clutch hands jumps of the motor up on to b at once; where the motor drops, b runs ahead."""
    scene = Scene(
        Body("b", inertia=2),
        Drive("motor", velocity=piecewise_linear([1, 1, 2, 2], [0, 3, 3, 1])),
        OneWay("clutch", "motor", "b"),
        Contact("drag", "b", GROUND, dry(1), normal=1),
    )
    result = simulate(scene, (0, 8))
    at = result.sample([0.5, 1.0, 1.5, 3.0, 7.0])
    np.testing.assert_allclose(at.velocity("b"), [0, 3, 3, 2.5, 1], atol=1e-12)
    # 3 - (t - 2) / 2 = 1 at t = 6
    np.testing.assert_allclose(times(result, "clutch"), [2.0, 6.0], atol=1e-12)
    np.testing.assert_allclose(at.force("clutch"), [0, 1, 1, 0, 1], atol=1e-12)


def test_a_one_way_clutch_at_radii() -> None:
    """A chain from a sprocket of 0.1 m to one of 0.04 m: v_b >= 2.5 v_a; the rider's torque 10 gives 4 at the wheel."""
    scene = Scene(
        Body("pedals", inertia=1e-3),
        Body("wheel", inertia=2.0),
        OneWay("hub", "pedals", "wheel", radius_a=0.1, radius_b=0.04),
        Force("pedals", piecewise_linear([1, 1], [10, 0])),
        Damper("pedals", GROUND, damping=1.0),
    )
    result = simulate(scene, (0, 3))
    at = result.sample([0.5, 3.0])
    tau = (1e-3 + 2 * 6.25) / 1.0
    assert at.velocity("wheel")[0] == pytest.approx(25 * (1 - math.exp(-0.5 / tau)), rel=1e-9)
    assert at.velocity("wheel")[1] == pytest.approx(25 * (1 - math.exp(-1 / tau)), rel=1e-9)
    assert [(e.t, e.after) for e in result.events] == [(1.0, Mode.BACKWARD)]


def test_two_one_way_clutches_rectify() -> None:
    """A lever swings; one clutch drives the shaft forward, one to the ground keeps it from turning back."""
    scene = Scene(
        Body("out", inertia=1e-3),
        Drive("lever", velocity=sine(2, frequency=1)),
        OneWay("drive", "lever", "out"),
        OneWay("back stop", GROUND, "out"),
        Damper("out", GROUND, damping=10),
        Force("out", -1.0),
    )
    result = simulate(scene, (0, 3))
    assert result.velocity("out").min() > -1e-11
    assert result.force("back stop").min() >= 0 and result.force("drive").min() > -1e-12
    # the damper asks so much of it that it stays on the lever to the end: it turns by 2/pi each time
    assert result.position("out")[-1] == pytest.approx(3 * 2 / np.pi, rel=1e-12)
    assert [(e.contact, e.after) for e in result.events[:2]] == [("drive", Mode.BACKWARD), ("back stop", Mode.STUCK)]
    assert [e.t for e in result.events[:4]] == pytest.approx([0.5, 0.5, 1.0, 1.0], abs=1e-9)


@every_engine
@pytest.mark.parametrize(
    "wheels",
    [
        [Body("a", inertia=2.0), Body("b", inertia=1.0), *(Force(x, f) for x in "ab" for f in (0.1, 0.2, -0.3))],
        [Body("a", inertia=0.7), Body("b", inertia=0.1), Force("a", 7.0), Force("b", 1.0)],
        [Body("a", inertia=0.9), Body("b", inertia=0.3), Force("a", 0.3), Force("b", 0.1)],
    ],
    ids=["loads that cancel", "10 rad/s^2", "1/3 rad/s^2"],
)
def test_a_clutch_whose_force_is_roundoff_stays_locked_while_others_move(
    wheels: list[Any], options: dict[str, Any], off: float
) -> None:
    """Both wheels accelerate alike, so nothing goes through the clutch; a slider beside it stops after 1 / 0.3 s."""
    scene = Scene(
        *wheels,
        OneWay("clutch", "b", "a"),
        Body("slider", inertia=1.0, velocity=1.0),
        Contact("rub", "slider", GROUND, dry(0.3), normal=1.0),
    )
    result = simulate(scene, (0.0, 6.0), **options)
    assert [event.contact for event in result.events] == ["rub"]
    check(result, "rub", [1 / 0.3], off)
    pull = sum(one.signal(0.0) for one in wheels if isinstance(one, Force) and one.body == "a")
    assert result.velocity("b")[-1] == pytest.approx(6.0 * pull / wheels[0].inertia, rel=1e-9, abs=1e-12)


# -- older elements ---------------------------------------------------------------------------------------


@every_engine
def test_launch(options: dict[str, Any], off: float) -> None:
    scene = Scene(
        Body("engine", inertia=0.2, velocity=200),
        Body("vehicle", inertia=5),
        Contact("clutch", "engine", "vehicle", dry(150), normal=1),
        Force("engine", 100),
        Force("vehicle", -20),
    )
    result = simulate(scene, (0, 1), **options)
    check(result, "clutch", [0.7246376811594203], off)
    locked = result.sample([0.7246376811594203 + (1e-3 if off > 1e-3 else 1e-6)])
    assert locked.velocity("engine")[0] == pytest.approx(18.84057971014493, abs=max(100 * off, 1e-4))
    assert result.energy().contacts["clutch"][-1] == pytest.approx(10869.5652173913, rel=max(off, 1e-9))
    assert result.force("clutch")[-1] == pytest.approx(96.92307692307692, abs=1e-9)


@every_engine
def test_a_freewheel_from_an_anisotropic_law(options: dict[str, Any], off: float) -> None:
    law = DryFriction(0, 0, mu_static_backward=0.6, mu_coulomb_backward=0.5)
    scene = Scene(
        Body("m", inertia=1),
        Contact("c", "m", GROUND, law, normal=10),
        Force("m", sine(3, frequency=0.25, phase=math.pi)),
    )
    result = simulate(scene, (0, 5), **options)
    at = result.sample([1.9, 3.0, 5.0])
    np.testing.assert_allclose(at.velocity("m"), [0, 6 / math.pi, 6 / math.pi], atol=off)


# -- files, words, pictures -------------------------------------------------------------------------------


def everything() -> Scene:
    return Scene(
        Body("sun", inertia=1, velocity=2.5),
        Body("carrier", inertia=3, velocity=1),
        Body("ring", inertia=0),
        Body("out", inertia=2, velocity=2),
        Drive("motor", velocity=0.5),
        Planetary("planets", sun="sun", carrier="carrier", ring="ring", ratio=1.5),
        OneWay("free", "carrier", "out", radius_b=0.5),
        Tie("belt", {"idler": 1, "motor": -2.0}),
        Body("idler", inertia=1, velocity=1),
        Gear("teeth", "shaft", "out", ratio=-2),
        Body("shaft", inertia=0.1, velocity=-4),
        Contact("brake", "ring", GROUND, dry(2, 1), normal=piecewise_linear([0, 3], [1, 0])),
        Contact("pad", "idler", "out", dry(0.4, 0.3), normal=1, radius_a=0.5, radius_b=-1),
        Spring("shaft", GROUND, stiffness=0.3, radius_a=0.2),
        Damper("sun", "motor", damping=0.1, radius_b=2),
        Force("carrier", sine(4, frequency=0.5)),
    )


def test_scene_files_hold_machines_and_leave_defaults_out() -> None:
    scene = everything()
    data = scene.to_dict()
    assert Scene.from_dict(data) == scene
    assert data["one_ways"] == [{"name": "free", "a": "carrier", "b": "out", "radius_b": 0.5}]
    assert data["ties"] == [{"name": "belt", "coefficients": {"idler": 1.0, "motor": -2.0}}]
    assert data["gears"] == [{"name": "teeth", "a": "shaft", "b": "out", "ratio": -2.0}]
    assert "radius_a" not in data["dampers"][0]
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert hash(scene.ties[0]) == hash(Tie("belt", {"motor": -2, "idler": 1}))
    assert scene.replace("teeth", ratio=3).gears[0].ratio == 3


@pytest.mark.slow
def test_results_of_machines_go_into_files_words_and_pictures(tmp_path: Any) -> None:
    scene = everything()
    result = simulate(scene, (0, 4))
    balanced(result, 1e-9)
    result.save(tmp_path / "r.npz")
    again = load(tmp_path / "r.npz")
    for row in scene.rows:
        assert np.array_equal(again.force(row.name), result.force(row.name))
        np.testing.assert_array_equal(result.mode(row.name), again.mode(row.name))
    result.to_csv(tmp_path / "r.csv")
    assert "force teeth" in (tmp_path / "r.csv").read_text(encoding="utf-8").splitlines()[0]
    words = result.explain() + explain(scene)
    for piece in ("planets: - 1 sun + 2.5 carrier - 1.5 ring = 0", "free: 1 carrier - 0.5 out <= 0", "ring"):
        assert piece in words
    assert "1 one-way clutch" in words
    assert set(result.energy().contacts) == {"brake", "pad"}
    result.plot().savefig(tmp_path / "r.png")
    from stickslip import plots

    plots.phase_portrait(result, "free").figure.savefig(tmp_path / "p.png")
    with pytest.raises(ValueError, match="one-way clutch 'free' has no friction law"):
        plots.characteristic(result, "free")


def test_a_continued_run_goes_on_as_if_it_had_not_been_cut() -> None:
    """Velocities at the end of a run are accepted at the start of the next one."""
    scene = everything()
    whole = simulate(scene, (0, 4), t_eval=[1.0, 4.0])
    bodies = {b.name: whole.velocity(b.name)[0] for b in scene.bodies}
    cut = scene
    for name, v in bodies.items():
        cut = cut.replace(name, velocity=v, position=simulate(scene, (0, 1)).position(name)[-1])
    # a planetary's velocities hold to roundoff, not to the bit
    rest = simulate(cut, (1, 4))
    for name in bodies:
        assert rest.velocity(name)[-1] == pytest.approx(whole.velocity(name)[-1], abs=1e-9)


# -- bad input --------------------------------------------------------------------------------------------

A, B = Body("a", inertia=1), Body("b", inertia=1)
D1, D2 = Drive("d1", velocity=1), Drive("d2", velocity=sine(1, frequency=1))

REFUSED: dict[str, tuple[Any, type[Exception], list[str]]] = {
    "tie of nothing": (lambda: Tie("t", {}), ValueError, ["tie 't'", "at least one"]),
    "tie of a list": (lambda: Tie("t", ["a", "b"]), TypeError, ["tie 't'", "dict", "['a', 'b']"]),
    "tie with 0": (lambda: Tie("t", {"a": 1, "b": 0}), ValueError, ["'b' must not be 0", "leave 'b' out"]),
    "tie with nan": (lambda: Tie("t", {"a": math.nan}), ValueError, ["coefficient of 'a'", "finite"]),
    "tie with text": (lambda: Tie("t", {"a": "1"}), TypeError, ["coefficient of 'a'", "number", "'1'"]),
    "tie of a number": (lambda: Tie("t", {3: 1.0}), TypeError, ["names of bodies", "3"]),
    "tie without a name": (lambda: Tie("", {"a": 1.0}), TypeError, ["Tie: name", "''"]),
    "tie of strangers": (lambda: Scene(A, Tie("t", {"a": 1, "x": 1})), ValueError, ["'x'", "known", "'a'"]),
    "tie of drives": (
        lambda: Scene(A, D1, Tie("t", {"d1": 1, GROUND: 1})),
        ValueError,
        ["tie 't'", "free to move", "Body"],
    ),
    "gear 0": (lambda: Gear("g", "a", "b", ratio=0), ValueError, ["gear 'g': ratio must not be 0", "Tie"]),
    "gear inf": (lambda: Gear("g", "a", "b", ratio=math.inf), ValueError, ["gear 'g': ratio", "finite"]),
    "gear to itself": (lambda: Gear("g", "a", "a", ratio=2), ValueError, ["'a' to itself", "two different"]),
    "planetary of two": (
        lambda: Planetary("p", sun="a", carrier="b", ring="a", ratio=2),
        ValueError,
        ["planetary 'p'", "three different", "Gear"],
    ),
    "planetary -1": (
        lambda: Planetary("p", sun="a", carrier="b", ring="c", ratio=-1),
        ValueError,
        ["planetary 'p': ratio must be positive", "-1", "teeth"],
    ),
    "planetary of strangers": (
        lambda: Scene(A, B, Planetary("p", sun="a", carrier="b", ring="c", ratio=2)),
        ValueError,
        ["planetary 'p'", "'c'", "known"],
    ),
    "one-way to itself": (lambda: OneWay("o", "a", "a"), ValueError, ["one-way clutch 'o'", "'a' to itself"]),
    "one-way radius": (
        lambda: OneWay("o", "a", "b", radius_b=0),
        ValueError,
        ["one-way clutch 'o': radius_b must not be 0"],
    ),
    "contact radius": (
        lambda: Contact("c", "a", "b", dry(1), normal=1, radius_a=0.0),
        ValueError,
        ["contact 'c': radius_a must not be 0", "use 1"],
    ),
    "spring radius": (
        lambda: Spring("a", "b", stiffness=1, radius_b=math.nan),
        ValueError,
        ["spring 'a'-'b': radius_b", "finite"],
    ),
    "damper radius": (
        lambda: Damper("a", "b", damping=1, radius_a="2"),
        TypeError,
        ["damper 'a'-'b': radius_a", "number", "'2'"],
    ),
    "one name twice": (
        lambda: Scene(A, B, Gear("c", "a", "b", ratio=1), Contact("c", "a", "b", dry(1), normal=1)),
        ValueError,
        ["'c' stands twice", "rename"],
    ),
    "two ties of a name": (
        lambda: Scene(A, B, Gear("c", "a", "b", ratio=1), OneWay("c", "a", "b")),
        ValueError,
        ["one-way clutch 'c' stands twice"],
    ),
    "no inertia, no tie": (
        lambda: Scene(A, Body("b", inertia=0), Contact("c", "a", "b", dry(1), normal=1)),
        ValueError,
        ["body 'b': inertia must be positive, got 0", "Tie"],
    ),
    "no inertia but among themselves": (
        lambda: Scene(A, Body("b", inertia=0), Body("c", inertia=0), Gear("g", "b", "c", ratio=2)),
        ValueError,
        ["body 'b'", "ties alone do not decide"],
    ),
    "no inertia, one-way clutch": (
        lambda: Scene(A, Body("b", inertia=0), OneWay("o", "a", "b")),
        ValueError,
        ["body 'b'", "ties alone do not decide"],
    ),
    "broken at the start": (
        lambda: simulate(Scene(Body("x", inertia=1, velocity=1), B, Gear("g", "x", "b", ratio=2)), (0, 1)),
        ValueError,
        ["gear 'g'", "break it by 1", "'x' 1", "'b' 0"],
    ),
    "turned forward at the start": (
        lambda: simulate(Scene(Body("x", inertia=1, velocity=1), B, OneWay("o", "x", "b")), (0, 1)),
        ValueError,
        ["one-way clutch 'o'", "relative velocity at the start is 1", "exchange a and b"],
    ),
    "tied drives": (
        lambda: simulate(Scene(A, D1, D2, Gear("g", "a", "d1", ratio=1), Gear("h", "a", "d2", ratio=1)), (0, 1)),
        ValueError,
        ["'d1', 'd2'", "leave a tie out"],
    ),
    "unknown field": (
        lambda: Scene.from_dict({"bodies": [{"name": "a", "inertia": 1}], "gears": [{"name": "g", "teeth": 3}]}),
        ValueError,
        ["gears[0]", "unknown field 'teeth'", "ratio"],
    ),
    "missing field": (
        lambda: Scene.from_dict({"bodies": [{"name": "a", "inertia": 1}], "gears": [{"name": "g"}]}),
        ValueError,
        ["gears[0]", "'a' is missing"],
    ),
    "unknown row": (lambda: simulate(Scene(A), (0, 1)).force("g"), ValueError, ["'g'"]),
}


@pytest.mark.parametrize(("make", "kind", "words"), REFUSED.values(), ids=REFUSED)
def test_bad_input_is_refused(make: Any, kind: type[Exception], words: list[str]) -> None:
    with pytest.raises(kind) as caught:
        make()
    assert type(caught.value) is kind
    for word in words:
        assert word in str(caught.value)


def test_laws_and_loads_that_are_code_go_with_ties() -> None:
    """CVODE takes them: w' = (cos t) / 5 for a gear of 2 with unit inertias."""
    scene = Scene(A, B, Gear("g", "a", "b", ratio=2), Force("b", signal(math.cos)))
    result = simulate(scene, (0, 3))
    np.testing.assert_allclose(result.velocity("b"), np.sin(result.t) / 5, atol=1e-7)


@pytest.mark.parametrize(
    "options", [{"method": "series"}, {"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}]
)
def test_a_clutch_that_only_touches_stays_free(options: dict[str, Any]) -> None:
    """Modelica's freewheel beside a dry clutch: at 1.5 s the relative velocity touches 0 with slope 0."""
    scene = Scene(
        Body("in", inertia=1, velocity=-0.5),
        Body("out", inertia=1),
        OneWay("free", "in", "out"),
        Contact(
            "clutch",
            "in",
            "out",
            DryFriction(12.5, 0.5),
            normal=piecewise_linear([0.3, 0.3, 0.95, 0.95, 1.6, 1.6], [0, 3, 3, 0, 0, 3]),
        ),
        Force("in", sine(10, frequency=3)),
    )
    result = simulate(scene, (0, 2), **options)
    assert not [event for event in result.events if 1.2 < event.t < 1.6]
    off = 1e-9 if options == EXACT else 2e-6
    assert result.velocity("in")[-1] == pytest.approx(-0.25, abs=off)
    assert result.velocity("out")[-1] == pytest.approx(-0.25, abs=off)
    assert result.position("in")[-1] == pytest.approx(-0.2123499945496375, abs=off)


@pytest.mark.parametrize("options", [{"method": "series"}, {"method": "BDF"}, {"formulation": "multiplier"}])
def test_a_drive_that_comes_back_to_0_at_the_very_end(options: dict[str, Any]) -> None:
    """The drive is 0 at 1 s and at 2 s: a zero within roundoff of the end of the span is at its end, and no event."""
    scene = Scene(
        Drive("motor", velocity=sine(0.9035492188790291, frequency=0.5)),
        Body("wheel", inertia=0),
        Body("other", inertia=0.318),
        Tie("belt", {"motor": 1.0, "wheel": -0.5}),
        Contact("dry", "wheel", GROUND, DryFriction(0.5, 0.3), normal=2.206),
    )
    result = simulate(scene, (0, 2), **options)
    assert times(result, "dry") == pytest.approx([1.0], abs=1e-9)


def test_a_drive_that_starts_from_roundoff_is_no_contradiction() -> None:
    """sin(pi) is 1.2e-16 and not 0: the wheel tied to it starts from rest all the same."""
    scene = Scene(
        Drive("motor", velocity=sine(2.0, frequency=0.5, phase=math.pi)),
        Body("wheel", inertia=1),
        Tie("belt", {"motor": 1.0, "wheel": -1.0}),
    )
    assert simulate(scene, (0, 1)).velocity("wheel")[-1] == pytest.approx(0.0, abs=1e-12)
    half = simulate(scene, (0, 0.5))
    assert half.velocity("wheel")[-1] == pytest.approx(-2.0)
