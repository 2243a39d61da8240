"""Which modes follow from loads, normal forces and drives, at the start and at events, against hand calculation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from reading import LAW, block, times, told

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    OneWay,
    Scene,
    Signal,
    Spring,
    Stop,
    Tie,
    piecewise_linear,
    signal,
    simulate,
    sine,
    step,
    triangle,
)


def on_drive(velocity: Signal | float, start: float = 0.0, normal: float = 10.0) -> Scene:
    return Scene(
        Body("a", inertia=2.0, velocity=start),
        Drive("d", velocity=velocity),
        Contact("c", "a", "d", LAW, normal=normal),
    )


def near(*values: float, abs: float = 1e-9) -> Any:
    return pytest.approx(list(values), abs=abs)


# A single contact at its limit


@pytest.mark.parametrize(
    ("load", "expected"),
    [
        (5.0, []),
        (piecewise_linear([0, 1], [5, 6]), [0.0]),
        (piecewise_linear([0, 1], [5, 4]), []),
        (piecewise_linear([0, 1, 2], [5, 5, 6]), [1.0]),
        (piecewise_linear([0, 1, 1, 2], [0, 0, 5, 5]), []),
        (piecewise_linear([0, 1, 1, 2], [0, 0, 5, 6]), [1.0]),
        (signal(lambda t: 5 + t * t), [0.0]),
        (signal(lambda t: 5 - t * t), []),
        (signal(lambda t: 5 + t**3), [0.0]),
        (signal(lambda t: 5 + 0.1 * t**5), [0.0]),
        (sine(5.0, 1.0, phase=math.pi / 2), []),
        (sine(-5.0, 1.0, phase=math.pi / 2), []),
    ],
    ids=[
        "constant",
        "up",
        "down",
        "up later",
        "reached",
        "passed",
        "square",
        "minus square",
        "cube",
        "fifth",
        "top",
        "bottom",
    ],
)
def test_load_at_the_threshold(load: Signal | float, expected: list[float]) -> None:
    result = simulate(block(load), (0.0, 2.0))
    released = [e.t for e in result.events if e.before == 0]
    if result.mode("c")[0] == 1:
        released.insert(0, 0.0)
    # a load that leaves its limit ever so slowly is seen when it has left it by 3e-10
    assert released == near(*expected, abs=0.04)


@pytest.mark.parametrize("stiffness", [0.37, 1.0, 11.0])
@pytest.mark.parametrize("velocity", [0.0, -0.1, 0.1])
def test_spring_at_the_threshold(stiffness: float, velocity: float) -> None:
    """A free mass pulls exactly as hard as the contact holds; whether it lets go depends on where the mass moves."""
    scene = Scene(
        Body("a", inertia=1.0),
        Body("m", inertia=0.7, position=0.5 / stiffness, velocity=velocity),
        Contact("c", "a", GROUND, LAW, normal=1.0),
        Spring("a", "m", stiffness=stiffness),
    )
    result = simulate(scene, (0.0, 0.3))
    assert result.mode("c")[0] == (velocity > 0)
    assert not result.events


@pytest.mark.parametrize("excess", [1e-3, 1e-6, 1e-9])
def test_grazing_breakaway(excess: float) -> None:
    level = 5 * (1 + excess)
    loads = {
        "sine": (sine(level, 0.3), math.asin(1 / (1 + excess)) / (2 * math.pi * 0.3)),
        "peak": (piecewise_linear([0, 1, 2], [0, level, 0]), 1 / (1 + excess)),
        "bump": (signal(lambda t: level * math.exp(-((t - 1) ** 2))), 1 - math.sqrt(math.log1p(excess))),
    }
    for name, (load, exact) in loads.items():
        result = simulate(block(load), (0.0, 1.2))
        assert [e.t for e in result.events][:1] == near(exact, abs=1e-7), name
    below = 5 * (1 - excess)
    for load in (
        sine(below, 0.3),
        piecewise_linear([0, 1, 2], [0, below, 0]),
        signal(lambda t: below * math.exp(-((t - 1) ** 2))),
    ):
        assert not simulate(block(load), (0.0, 2.0)).events


@pytest.mark.parametrize("excess", [1e-3, 1e-6, 1e-9])
def test_grazing_breakaway_by_a_spring(excess: float) -> None:
    """The force of a mass that swings about a stuck body peaks between computed steps."""
    for sign, sticks in ((1, False), (-1, True)):
        scene = Scene(
            Body("a", inertia=1.0),
            Body("m", inertia=1.0, velocity=0.5 * (1 + sign * excess)),
            Contact("c", "a", GROUND, LAW, normal=1.0),
            Spring("a", "m", stiffness=1.0),
        )
        result = simulate(scene, (0.0, 3.0), rtol=1e-12, atol=1e-14)
        assert (not result.events) == sticks
        if not sticks:
            assert result.events[0].t == pytest.approx(math.asin(1 / (1 + excess)), abs=2e-6)


def test_unloading_breaks_a_stuck_contact_loose() -> None:
    """With 3 N on it the contact lets go when the normal force has fallen to 6 N."""
    result = simulate(block(3.0, piecewise_linear([1, 3], [10, 0])), (0.0, 3.0))
    assert told(result) == [("c", 0, 1)] and times(result) == near(1.8)


def test_dwell_starts_anew_at_coulomb_level() -> None:
    """As a block comes to rest its level is mu_c N = 2 N, not yet mu_s N = 3 N: it holds 1.8 N, but not 2.2 N."""
    for load, after in ((2.2, -1), (1.8, 0)):
        law = DryFriction(0.3, 0.2, dwell=0.5)
        result = simulate(block(-load, 10.0, law, velocity=1.0), (0.0, 1.0))
        assert told(result)[0] == ("c", 1, after)
        assert times(result)[0] == pytest.approx(1 / (2.0 + load), abs=1e-12)


def test_dwell_counts_from_the_rest_before_the_start() -> None:
    law = DryFriction(0.5, 0.3, dwell=0.7)
    load = piecewise_linear([0, 2], [0, 6])
    t = simulate(block(load, 10.0, law), (0.0, 2.0)).events[0].t
    assert 3 * t == pytest.approx(10 * (0.5 - 0.2 * math.exp(-t / 0.7)), rel=1e-12)
    scene = block(load, 10.0, law).replace("c", rested=1e3)
    assert simulate(scene, (0.0, 2.0)).events[0].t == pytest.approx(5 / 3, rel=1e-12)


@pytest.mark.parametrize("dwell", [1e-12, 1e-9, 1e9, 1e12])
def test_dwell_times_beyond_all_scales(dwell: float) -> None:
    """The load is 3 t N. With a short dwell the level is mu_s N = 5 N at once; with a long one it stays at 3 N."""
    load = piecewise_linear([0, 2], [0, 6])
    (event,) = simulate(block(load, 10.0, DryFriction(0.5, 0.3, dwell=dwell)), (0.0, 2.0)).events
    assert 3 * event.t == pytest.approx(5 if dwell < 1 else 3, rel=1e-6)


@pytest.mark.parametrize("law", [DryFriction(0.5, 0.5), DryFriction(1e6, 1.0), DryFriction(0.5, 0.0)], ids=str)
def test_static_to_coulomb_ratio_has_no_bounds(law: DryFriction) -> None:
    level = 10 * law.mu_static
    load = piecewise_linear([0, 2], [0, 2 * level])
    (event,) = simulate(block(load, 10.0, law), (0.0, 2.0)).events
    assert event.t == pytest.approx(1.0, rel=1e-9)


def test_without_friction_nothing_sticks() -> None:
    result = simulate(block(1.0, 10.0, DryFriction(0.0, 0.0)), (0.0, 1.0))
    assert result.velocity("a")[-1] == pytest.approx(1.0) and np.all(result.force("c") == 0)


def test_anisotropic_contact() -> None:
    law = DryFriction(0.5, 0.4, mu_static_backward=0.2, mu_coulomb_backward=0.1)
    result = simulate(block(piecewise_linear([0, 1, 3, 4], [0, 4.9, -4.9, -4.9]), 10.0, law), (0.0, 4.0))
    assert told(result) == [("c", 0, -1)]
    assert times(result) == near(1 + 6.9 / 4.9)
    late = result.t > 3
    assert np.all(result.force("c")[late] == -1.0)


# Normal forces


def test_normal_force_through_zero_while_stuck_without_a_load() -> None:
    """Nothing pushes the body: open or not, it rests."""
    normal = piecewise_linear([0, 1, 2, 3, 4], [5, 0, -5, 0, 5])
    result = simulate(block(0.0, normal), (0.0, 6.0))
    assert not result.events and np.all(result.velocity("a") == 0)


def test_normal_force_through_zero_while_stuck_with_a_load() -> None:
    """A load of 1 N: released at N = 2, sliding while the contact is open, caught again by friction of 2 N."""
    normal = piecewise_linear([0, 1, 2, 3, 4], [5, 0, -5, 0, 5])
    result = simulate(block(1.0, normal), (0.0, 8.0))
    assert told(result)[0] == ("c", 0, 1) and times(result)[0] == pytest.approx(0.6, abs=1e-12)
    open_ = (result.t > 1) & (result.t < 3)
    assert np.all(result.force("c")[open_] == 0)
    # momentum: 1 N from 0.6 s on, friction 0.4 N(t) from 0.6 to 1 s and from 3 s on
    v4 = (4 - 0.6) - 0.4 * (0.5 * 0.4 * 2) - 0.4 * 2.5
    assert told(result)[1:] == [("c", 1, 0)]
    assert times(result)[1] == pytest.approx(4 + v4, abs=1e-9)


@pytest.mark.parametrize("load", [0.0, 0.01])
def test_normal_force_that_touches_zero(load: float) -> None:
    result = simulate(block(load, piecewise_linear([0, 1, 2], [5, 0, 5])), (0.0, 3.0))
    if load:
        assert told(result) == [("c", 0, 1), ("c", 1, 0)]
        assert times(result)[0] == pytest.approx(1 - 0.01 / 2.5, abs=1e-12)
    else:
        assert not result.events


def test_load_and_normal_force_that_vanish_together() -> None:
    """At t = 1 both are 0, and what follows is settled by their rates: 2.4/2.5 of the level holds, 2.6/2.5 not."""
    normal = piecewise_linear([0, 1, 2], [5, 0, 5])
    holds = simulate(block(piecewise_linear([0, 1, 2], [2.4, 0, 2.4]), normal), (0.0, 2.0))
    assert not holds.events
    breaks = simulate(block(piecewise_linear([0, 1, 2], [2.4, 0, 2.6]), normal), (0.0, 2.0))
    assert told(breaks) == [("c", 0, 1)] and times(breaks) == [1.0]


def test_normal_force_from_zero_on_at_the_start() -> None:
    rising = piecewise_linear([0, 1], [0, 5])
    assert not simulate(block(0.0, rising), (0.0, 2.0)).events
    result = simulate(block(0.1, rising), (0.0, 2.0))
    assert result.mode("c")[0] == 1
    # v = 0.1 t - 0.4 * 2.5 t^2 = 0
    assert told(result) == [("c", 1, 0)] and times(result) == near(0.1)


def test_normal_force_that_jumps() -> None:
    normal = piecewise_linear([0, 1, 1, 2, 2, 3], [5, 5, 1, 1, 5, 5])
    result = simulate(block(1.0, normal), (0.0, 6.0))
    # released by the jump at 1, accelerated by 1 - 0.4 N, then decelerated by 1 N
    assert told(result) == [("c", 0, 1), ("c", 1, 0)] and times(result) == near(1.0, 2.6)
    away = simulate(block(1.0, 5 + -5 * step(1.0) + 5 * step(2.0)), (0.0, 4.0))
    assert told(away) == [("c", 0, 1), ("c", 1, 0)] and times(away) == near(1.0, 3.0)


def test_an_open_contact_is_named_after_the_motion_to_come() -> None:
    result = simulate(block(piecewise_linear([0, 1, 2], [1, -1, -1]), -1.0), (0.0, 3.5))
    assert result.mode("c")[0] == 1
    assert [(e.cause, int(e.before), int(e.after)) for e in result.events] == [("open", 1, -1)]
    # v = t - t^2 until 1 s, and -(t - 1) from there on
    assert times(result) == near(1.0, abs=1e-6)
    assert np.all(result.force("c") == 0)
    still = simulate(block(0.0, -1.0), (0.0, 1.0))
    assert np.all(still.mode("c") == 0) and not still.events


# Drives


def test_drive_velocity_jumps_while_stuck() -> None:
    result = simulate(on_drive(piecewise_linear([1, 1, 2, 2], [0, 1, 1, 0])), (0.0, 4.0))
    assert told(result) == [("c", 0, -1), ("c", -1, 0), ("c", 0, 1), ("c", 1, 0)]
    assert times(result) == near(1.0, 1.5, 2.0, 2.5, abs=1e-12)


def test_jump_of_a_drive_whose_velocity_is_curved() -> None:
    """The drive jumps ahead by 0.5 at t = 1; the body follows at 4 m/s^2 until it has caught up with the sine."""
    wave = sine(0.1, 0.2)
    result = simulate(on_drive(wave + step(1.0, 0.0, 0.5), normal=20.0), (0.0, 3.0))
    assert told(result) == [("c", 0, -1), ("c", -1, 0)]
    caught_up = times(result)[1]
    assert times(result)[0] == 1.0
    assert wave(1.0) + 4.0 * (caught_up - 1.0) == pytest.approx(wave(caught_up) + 0.5, abs=1e-7)


def test_drive_velocity_jump_within_roundoff_is_none() -> None:
    assert not simulate(on_drive(piecewise_linear([1, 1], [1, 1 + 1e-13]), 1.0), (0.0, 3.0)).events
    assert len(simulate(on_drive(piecewise_linear([1, 1], [1, 1 + 1e-9]), 1.0), (0.0, 3.0)).events) == 2


def test_drive_that_accelerates_too_fast_leaves_the_body_behind() -> None:
    result = simulate(on_drive(signal(lambda t: t * t)), (0.0, 2.0))
    assert told(result) == [("c", 0, -1)] and times(result) == near(1.25)


def test_body_slipping_on_a_sine_drive() -> None:
    """The drive's velocity, which is no state, meets the body's, 2 t: 2 t = sin(2 pi 0.7 t)."""
    result = simulate(on_drive(sine(1.0, 0.7)), (0.0, 0.6))
    caught, released = times(result)
    assert told(result) == [("c", -1, 0), ("c", 0, 1)]
    assert 2 * caught == pytest.approx(math.sin(2 * math.pi * 0.7 * caught), abs=1e-9)
    # released where the deceleration of the drive reaches 2.5
    rate = 2 * math.pi * 0.7
    assert released == pytest.approx(math.acos(-2.5 / rate) / rate, abs=1e-9)


def between(velocity: Signal | float, ground: float, drive: float, start: float = 0.0) -> Scene:
    return Scene(
        Body("a", inertia=1.0, velocity=start),
        Drive("d", velocity=velocity),
        Contact("g", "a", GROUND, LAW, normal=ground),
        Contact("c", "a", "d", LAW, normal=drive),
    )


@pytest.mark.parametrize(
    "velocity",
    [piecewise_linear([1, 2], [0, 1]), signal(lambda t: max(0.0, t - 1) ** 2, breaks=(1.0,))],
    ids=["ramp", "square"],
)
@pytest.mark.parametrize(("ground", "drive", "slips", "mode"), [(6.0, 5.0, "c", -1), (5.0, 6.0, "g", 1)])
def test_body_held_by_the_ground_and_by_a_drive_that_starts(
    velocity: Signal, ground: float, drive: float, slips: str, mode: int
) -> None:
    """The weaker contact gives way, at once: the other holds."""
    result = simulate(between(velocity, ground, drive), (0.0, 1.4))
    assert told(result) == [(slips, 0, mode)] and times(result) == near(1.0, abs=1e-4)
    other = "g" if slips == "c" else "c"
    assert np.all(np.abs(result.relative_velocity(other)) < 1e-18)


def test_body_held_by_the_ground_and_by_a_drive_with_equal_strength() -> None:
    """The drive moves from 1 s on: it slips over the body, which the ground holds with as much friction."""
    result = simulate(between(piecewise_linear([1, 2], [0, 1]), 5.0, 5.0), (0.0, 2.0))
    assert told(result) == [("c", 0, -1)] and times(result) == [1.0]
    assert np.all(result.velocity("a") == 0)


def test_body_passed_from_one_drive_to_another() -> None:
    """Drive d sweeps through the velocity at which drive e holds the body."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Drive("d", velocity=piecewise_linear([0, 2], [0, 2])),
        Drive("e", velocity=1.0),
        Contact("c", "a", "d", LAW, normal=5.0),
        Contact("g", "a", "e", LAW, normal=6.0),
    )
    result = simulate(scene, (0.0, 2.0))
    assert told(result) == [("c", 1, -1)] and times(result) == near(1.0)
    assert np.all(result.velocity("a") == 1.0)


def test_two_drives_that_move_alike_hold_together() -> None:
    for velocity in (1.0, sine(1.0, 0.3)):
        start = velocity if isinstance(velocity, float) else 0.0
        scene = Scene(
            Body("a", inertia=1.0, velocity=start),
            Drive("d", velocity=velocity),
            Drive("e", velocity=velocity),
            Contact("c", "a", "d", LAW, normal=5.0),
            Contact("g", "a", "e", LAW, normal=5.0),
        )
        result = simulate(scene, (0.0, 3.0))
        assert not result.events
        np.testing.assert_allclose(result.force("c"), result.force("g"), atol=1e-5)
        # each holds half of what gives the body the acceleration of the drives
        w = 0.0 if velocity == 1.0 else 2 * math.pi * 0.3
        np.testing.assert_allclose(result.force("c"), -0.5 * w * np.cos(w * result.t), atol=1e-5)


# Several contacts at one instant


@pytest.mark.parametrize("arms", [2, 3, 7, 40])
@pytest.mark.parametrize("dwell", [0.0, 0.7])
def test_symmetric_arms_stick_and_slip_together(arms: int, dwell: float) -> None:
    law = DryFriction(0.5, 0.4, dwell=dwell)
    elements: list[Any] = [Body("hub", inertia=2.0, velocity=1.0)]
    for i in range(arms):
        elements += [
            Body(f"a{i}", inertia=1.0, velocity=0.3),
            Contact(f"c{i}", "hub", f"a{i}", law, normal=5.0),
        ]
    elements.append(Force("hub", piecewise_linear([1, 3, 4], [0, 20 * arms, -10 * arms])))
    result = simulate(Scene(*elements), (0.0, 7.0))
    assert len(result.events) % arms == 0 and len(result.events) >= 2 * arms
    for i in range(0, len(result.events), arms):
        together = result.events[i : i + arms]
        assert len({e.t for e in together}) == 1
        assert {e.contact for e in together} == {f"c{j}" for j in range(arms)}
        assert len({(e.before, e.after) for e in together}) == 1
    assert times(result)[0] == pytest.approx(0.7 / (2.0 + arms), rel=1e-12)
    for i in range(1, arms):
        np.testing.assert_array_equal(result.velocity(f"a{i}"), result.velocity("a0"))


def test_the_most_overloaded_contact_slips_and_relieves_the_others() -> None:
    """Pulled at one end, a chain breaks where lambda/B is largest; the rest, relieved, holds."""
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0) for i in range(3)),
        Contact("near", "b0", "b1", LAW, normal=20.0),
        Contact("far", "b1", "b2", LAW, normal=8.0),
        Force("b0", 12.6 * step(1.0)),
    )
    # lambda = 8.4 of 10 N and 4.2 of 4 N: far slips at 3.2 N, near then needs (12.6 + 3.2)/2 = 7.9 N
    result = simulate(scene, (0.0, 2.0))
    assert told(result) == [("far", 0, 1)]
    last = result.t == 2.0
    assert result.force("near")[last][-1] == pytest.approx(7.9)


def test_the_most_overloaded_contact_is_found_by_the_level_on_its_side() -> None:
    """All stuck: lambda_0 = -25.4 of 17 backward, lambda_1 = -13.5 of 8: c1 goes, and then c0 holds -11.9 - 4."""

    def law(forward: float, backward: float) -> DryFriction:
        return DryFriction(forward, forward / 2, mu_static_backward=backward, mu_coulomb_backward=backward / 2)

    scene = Scene(
        Body("b0", inertia=2.0),
        Body("b1", inertia=1.0),
        Body("b2", inertia=2.0),
        Contact("c0", "b0", GROUND, law(0.1, 1.7), normal=10.0),
        Contact("c1", "b1", "b0", law(1.3, 0.4), normal=20.0),
        Contact("c2", "b2", "b1", law(1.0, 1.0), normal=10.0),
        Force("b0", step(1.0, 0, -11.9)),
        Force("b1", step(1.0, 0, -13.5)),
    )
    result = simulate(scene, (0.0, 2.0))
    assert told(result) == [("c1", 0, -1)] and times(result) == [1.0]
    # b1 and b2, 3 kg together, are pulled by 13.5 N against 20 * 0.2 N for 1 s
    assert result.velocity("b1")[-1] == pytest.approx(-9.5 / 3, rel=1e-12)
    assert result.velocity("b2")[-1] == pytest.approx(-9.5 / 3, rel=1e-12)
    assert result.force("c0")[-1] == pytest.approx(-15.9, rel=1e-12)
    assert np.all(result.velocity("b0") == 0)


def test_a_contact_released_by_another_at_the_same_instant() -> None:
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Contact("top", "a", "b", LAW, normal=10.0),
        Contact("floor", "b", GROUND, DryFriction(0.45, 0.45), normal=10.0),
        Force("a", 6.0 * step(1.0)),
    )
    # 6 N: floor (4.5) gives way first; then top carries (6 * 1 + 4.5) / 2 = 5.25 > 5 and slips as well,
    # so that b is driven by 4 N only and stays at rest
    result = simulate(scene, (0.0, 2.0))
    assert told(result) == [("top", 0, 1)] and times(result) == [1.0]
    assert result.velocity("a")[-1] == pytest.approx(6.0 - 4.0, rel=1e-12)
    assert np.all(result.velocity("b") == 0)


def test_a_tie_moves_only_what_can_move() -> None:
    """A light body on a heavy one, both contacts at their limit at once: only the light one starts.

    It starts at 0.75 s, where the load is 1.5 N. Friction of 1.2 N stops it where the impulse beyond 1.2 N is 0:
    that rises by 0.1375 N s up to 1 s and by 0.16 N s up to 1.4 s, and falls by the square of the time from there on.
    """
    scene = Scene(
        Body("light", inertia=1e-6),
        Body("heavy", inertia=1e6),
        Contact("top", "light", "heavy", LAW, normal=3.0),
        Contact("floor", "heavy", GROUND, LAW, normal=3.0),
        Force("light", piecewise_linear([0, 1, 2], [0, 2, 0])),
    )
    result = simulate(scene, (0.0, 2.0))
    assert told(result) == [("top", 0, 1), ("top", 1, 0)]
    assert times(result) == near(0.75, 1.4 + math.sqrt(0.1375 + 0.16), abs=1e-12)
    assert result.sample([1.4]).velocity("light")[0] == pytest.approx(0.2975e6, rel=1e-12)
    assert np.all(result.velocity("heavy") == 0)


def test_coming_to_rest_together_conserves_momentum_exactly() -> None:
    scene = Scene(
        Body("a", inertia=3.0, velocity=1.0),
        Body("m", inertia=0.1),
        Body("b", inertia=3.0, velocity=-1.0),
        Contact("1", "a", "m", LAW, normal=5.0),
        Contact("2", "m", "b", LAW, normal=5.0),
    )
    result = simulate(scene, (0.0, 3.0))
    assert told(result) == [("1", 1, 0), ("2", 1, 0)] and times(result) == near(1.5, 1.5, abs=1e-14)
    for body in "amb":
        assert abs(result.velocity(body)[-1]) < 1e-15


@pytest.mark.parametrize("ratio", [1e6, 1e12])
def test_inertia_ratios(ratio: float) -> None:
    scene = Scene(
        Body("a", inertia=1.0 / ratio, velocity=1.0),
        Body("b", inertia=ratio),
        Contact("c", "a", "b", LAW, normal=3.0),
        Force("a", piecewise_linear([1, 2, 3], [0, 2, 0])),
    )
    result = simulate(scene, (0.0, 4.0))
    assert told(result) == [("c", 1, 0), ("c", 0, 1), ("c", 1, 0)]
    assert times(result)[0] == pytest.approx(1 / (1.2 * ratio), rel=1e-9)
    assert times(result)[1] == pytest.approx(1.75, rel=1e-12)
    left = result.mode("c") == 0
    assert np.all(result.relative_velocity("c")[left] == 0)


def test_disconnected_parts_do_not_feel_each_other() -> None:
    first = block(sine(8.0, 0.4))
    second = Scene(
        Body("x", inertia=1.0, velocity=1.0),
        Contact("k", "x", GROUND, LAW, normal=1.0),
        Spring("x", GROUND, stiffness=10.0),
    )
    both = simulate(Scene(*first.elements, *second.elements), (0.0, 5.0), rtol=1e-10, atol=1e-12)
    for scene in (first, second):
        alone = simulate(scene, (0.0, 5.0), rtol=1e-10, atol=1e-12)
        names = {c.name for c in scene.contacts}
        events = [e for e in both.events if e.contact in names]
        assert [(e.contact, e.after) for e in events] == [(e.contact, e.after) for e in alone.events]
        np.testing.assert_allclose([e.t for e in events], times(alone), atol=1e-7)


# Contacts that lock the same motion


def braked(load: Signal | float, brake: Signal | float, pad: float = 10.0) -> Scene:
    return Scene(
        Body("wheel", inertia=1.0),
        Contact("pad", "wheel", GROUND, LAW, normal=pad),
        Contact("brake", "wheel", GROUND, LAW, normal=brake),
        Force("wheel", load),
    )


def test_a_brake_on_a_wheel_at_rest_does_not_slip() -> None:
    load = piecewise_linear([0, 0.5, 3, 4], [0, 4.9, 4.9, 0])
    result = simulate(braked(load, triangle(1, 2, 3, slope=10)), (0.0, 5.0))
    assert not result.events and np.all(result.velocity("wheel") == 0)
    np.testing.assert_allclose(result.force("pad") + result.force("brake"), [load(t) for t in result.t], atol=1e-9)
    for contact in ("pad", "brake"):
        assert np.all(np.abs(result.force(contact)) <= result.breakaway(contact) + 1e-9)


@pytest.mark.parametrize("formulation", ["contact-force", "merged", "multiplier"])
def test_a_brake_that_closes_takes_its_share_as_soon_as_it_can(formulation: str) -> None:
    # 3 N: the brake carries its level up to the least norm of 1.5 N each, from 3 N of normal force on, at 1.003 s
    load = piecewise_linear([1.0, 1.1, 1.2], [0, 100, 0])
    result = simulate(braked(3.0, load), (0.0, 2.0), t_eval=[1.002, 1.004, 1.05, 1.15], formulation=formulation)
    assert not result.events
    np.testing.assert_allclose(result.force("brake"), [0.5 * 2.0, 1.5, 1.5, 1.5], rtol=1e-9)
    np.testing.assert_allclose(result.force("pad"), [3.0 - 0.5 * 2.0, 1.5, 1.5, 1.5], rtol=1e-9)


def test_equal_contacts_between_the_same_bodies_act_as_one() -> None:
    result = simulate(braked(piecewise_linear([0, 1], [0, 12]), 10.0), (0.0, 1.0))
    assert times(result) == near(10 / 12, 10 / 12)
    np.testing.assert_allclose(result.force("pad"), result.force("brake"), rtol=1e-12)


def test_parallel_contacts_hold_with_the_sum_of_their_levels() -> None:
    """5 + 1.5 N hold together, however they share the load."""
    result = simulate(braked(piecewise_linear([0, 1], [0, 13]), 3.0), (0.0, 1.0))
    assert times(result) == near(0.5, 0.5)


def test_doubled_contact_with_opposite_orientation() -> None:
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=2.0),
        Contact("1", "a", "b", LAW, normal=4.0),
        Contact("2", "b", "a", LAW, normal=4.0),
    )
    result = simulate(scene, (0.0, 1.0))
    assert told(result) == [("1", 1, 0), ("2", -1, 0)]
    assert times(result) == near(1 / (3.2 * 1.5), 1 / (3.2 * 1.5), abs=1e-13)


@pytest.mark.parametrize("contacts", [3, 4, 8])
def test_loops_stick_as_one_and_hold_their_load(contacts: int) -> None:
    """A ring of bodies: the motion is unique, the forces are not; those given carry the load and are the least."""
    bodies = [Body(f"b{i}", inertia=1.0, velocity=0.1) for i in range(contacts)]
    ring = [
        Contact(f"c{i}", f"b{i}", f"b{(i + 1) % contacts}", DryFriction(5.0, 4.0), normal=10.0) for i in range(contacts)
    ]
    result = simulate(Scene(*bodies, *ring, Force("b0", sine(6.0, 0.5))), (0.0, 3.0))
    assert not result.events
    for body in bodies:
        np.testing.assert_array_equal(result.velocity(body.name), result.velocity("b0"))
    # Newton for b1: c0 drags it, c1 holds it back
    drag = result.force("c0") - result.force("c1")
    np.testing.assert_allclose(drag, [6.0 * math.sin(math.pi * t) / contacts for t in result.t], atol=1e-9)
    assert np.abs(sum(result.force(c.name) for c in ring)).max() < 1e-9


def test_a_loop_that_breaks_starts_to_move_everywhere() -> None:
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Contact("ab", "a", "b", LAW, normal=2.0),
        Contact("ag", "a", GROUND, LAW, normal=2.0),
        Contact("bg", "b", GROUND, LAW, normal=20.0),
        Force("a", piecewise_linear([0, 1], [0, 4])),
    )
    result = simulate(scene, (0.0, 1.0))
    # 4 t N come to the two levels of 1 N at 0.5 s; then a is held back by 0.8 N twice
    assert sorted(told(result)) == [("ab", 0, 1), ("ag", 0, 1)] and times(result) == near(0.5, 0.5)
    assert result.velocity("a")[-1] == pytest.approx(2 * (1 - 0.5**2) - 1.6 * 0.5, rel=1e-12)
    assert np.all(result.velocity("b") == 0)


@pytest.mark.parametrize("method", ["auto", "BDF", "Adams"])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e9])
def test_what_left_rest_slips_on_at_the_event_of_another_in_any_unit_of_time(method: str, unit: float) -> None:
    """A pull of t N lets go at 1 s, v = (t - 1)^2 / 2 m/s; the other block stops at 2 s. All times are in `unit`."""
    law = DryFriction(1.0, 1.0)
    scene = Scene(
        Body("pulled", inertia=unit**2),
        Contact("floor", "pulled", GROUND, law, normal=1.0),
        Force("pulled", piecewise_linear([0.0, 4 * unit], [0.0, 4.0])),
        Body("other", inertia=unit**2, velocity=1 / unit),
        Contact("brake", "other", GROUND, law, normal=0.5),
    )
    result = simulate(scene, (0.0, 3 * unit), method=method, atol=1e-10 / unit)
    assert [(e.contact, e.after) for e in result.events] == [("floor", 1), ("brake", 0)]
    assert [e.t / unit for e in result.events] == pytest.approx([1.0, 2.0], abs=1e-7)
    assert result.velocity("pulled")[-1] * unit == pytest.approx(2.0, abs=1e-7)


def test_a_drive_that_comes_to_rest_with_a_corner_shakes_nothing_loose() -> None:
    """Before the break of 3.85 s the belt still has a velocity of 1e-16 m/s: roundoff, and no jump.

    The contact with the belt has rested for so long that its level is 4 times the normal force; after a slip it is 2.
    """
    corner = 3.8500000000000005
    scene = Scene(
        Body("b0", inertia=3.9000000000000004, velocity=-0.9609090909090907),
        Body("b1", inertia=2.6, velocity=0.6936363636363636),
        Body("b3", inertia=1.3, velocity=0.20363636363636362),
        Drive(
            "d",
            velocity=piecewise_linear(
                [1.6500000000000001, 2.75, corner], [0.6363636363636362, 0.3181818181818181, 0.0]
            ),
        ),
        Contact(
            "c0",
            "b1",
            "d",
            DryFriction(4.0, 2.0, dwell=0.05),
            normal=piecewise_linear([2.75, corner, 4.4], [-0.7520661157024792, 1.5041322314049583, 0.3760330578512396]),
        ),
        Contact("c1", "b1", "b3", DryFriction(1.0, 0.5), normal=0.7520661157024792, rested=0.275),
        Contact(
            "c2",
            "b0",
            "b3",
            DryFriction(0.5, 0.5),
            normal=sine(0.7520661157024792, 0.45454545454545453, phase=-math.pi / 2),
        ),
        Force("b3", piecewise_linear([1.1, 1.65, 3.3], [-1.504, 0.0, 0.0])),
        Force("b1", piecewise_linear([3.7, 3.8, 4.4], [0.0, 4.0, 4.0])),
    )
    result = simulate(scene, (0.0, 4.4))
    late = [event for event in result.events if event.t > 3.5]
    assert [(event.contact, int(event.after)) for event in late] == [("c0", 1)] and late[0].t > 4.1
    sample = result.sample([3.84, 3.86])
    assert np.all(sample.breakaway("c0") > 3.99 * sample.normal("c0"))


def test_breaks_that_differ_by_roundoff_are_one() -> None:
    """The belt comes to rest at 3 s, where a normal force of ``sin(pi t / 2 + pi / 2)`` N passes 0, at 3 - 4e-16 s.

    A freewheel stops the block there: nothing slips between the two times.
    """
    scene = Scene(
        Body("b0", inertia=1.0, velocity=1.28),
        Body("b1", inertia=1.0, velocity=-0.41),
        Drive("d", velocity=piecewise_linear([1.0, 1.5, 3.0], [0.0, 1.0, 0.0])),
        Contact("c0", "b0", "d", DryFriction(4.0, 2.0, dwell=0.2), normal=2.0, rested=10.0),
        Contact("c1", "b1", "b0", DryFriction(1.0, 1.0), normal=sine(1.0, 0.25, phase=math.pi / 2)),
        OneWay("free", GROUND, "b0"),
        Spring("b0", "b1", stiffness=2.0, damping=0.1),
        Gap("gap", "b0", "b1", lower=-0.5, upper=0.5, stiffness=10.0),
        Force("b1", piecewise_linear([1.0, 1.0, 2.5, 4.0], [-3.0, 0.0, -3.0, 2.0])),
    )
    result = simulate(scene, (0.0, 4.0))
    assert [(event.contact, event.t) for event in result.events if abs(event.t - 3.0) < 1e-9] == [("free", 3.0)]
    sample = result.sample([2.99, 3.02])
    assert np.all(sample.breakaway("c0") > 3.99 * sample.normal("c0"))


@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_a_geared_wheel_leaves_its_end_stop_as_its_brake_slips(method: str) -> None:
    """The wheel's velocity follows from those of the other members of the gear: at the stop it is their roundoff."""
    scene = Scene(
        Body("a", inertia=0.86),
        Body("b", inertia=0.65),
        Body("c", inertia=0.54),
        Tie("gear", {"a": -1.0, "b": 3.3, "c": -2.3}),
        Contact("brake", "c", GROUND, DryFriction(0.24, 0.24), normal=4.0),
        Stop("end", "c", GROUND, lower=0.0, upper=0.19, radius_a=0.7, radius_b=0.3),
        Spring("a", GROUND, stiffness=53.0, damping=0.57),
        Force("c", sine(8.1, 0.93, 0.0, 2.5)),
    )
    exact = simulate(scene, (0.0, 3.0))
    found = simulate(scene, (0.0, 3.0), method=method, rtol=1e-9, atol=1e-11)
    assert sum(e.cause == "breakaway" for e in exact.events) > 2
    assert [(e.contact, e.after) for e in found.events] == [(e.contact, e.after) for e in exact.events]
    times = np.linspace(0.0, 3.0, 61)
    np.testing.assert_allclose(found(times), exact(times), rtol=0, atol=2e-8)
