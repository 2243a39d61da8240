"""Traps of root finding, of the solver library and of friction itself: each test fails where one is not avoided."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from reading import LAW, block, times, told
from scipy.integrate import solve_ivp

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gear,
    Scene,
    SimulationError,
    Spring,
    piecewise_linear,
    signal,
    simulate,
    sine,
    triangle,
)
from stickslip.engines import ida
from stickslip.engines.series import Series
from stickslip.engines.solvers import linear_solver
from stickslip.equations import balance, system
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path


def oscillator(periods: float, normal: float = 0.0) -> tuple[Scene, float]:
    scene = Scene(
        Body("a", inertia=1.0, position=1.0),
        Spring("a", GROUND, stiffness=(2 * math.pi) ** 2),
        Contact("c", "a", GROUND, LAW, normal=normal),
    )
    return scene, periods


def belt(normal: float = 1.0, speed: float = 0.2) -> Scene:
    """Leine's block on a belt: m = k = F_s = 1, friction that falls with speed."""
    law = DryFriction(1.0, 1.0, kinetic=lambda v: 1 / (1 + 3 * abs(v)))
    return Scene(
        Body("m", inertia=1.0),
        Drive("belt", velocity=speed),
        Contact("c", "m", "belt", law, normal=normal),
        Spring("m", GROUND, stiffness=1.0),
    )


# Root finding


@pytest.mark.parametrize("inertia", [1 / 3, 0.7, math.pi, 1e3, 1e-7])
def test_a_guard_off_by_an_ulp_does_not_fire_for_ever(inertia: float) -> None:
    """Velocities after sticking are equal to the last bit, whatever the inertias."""
    scene = Scene(
        Body("a", inertia=inertia, velocity=0.1),
        Body("b", inertia=1.0, velocity=0.7),
        Body("c", inertia=inertia / 7, velocity=-0.3),
        Contact("ab", "a", "b", LAW, normal=1.0),
        Contact("bc", "b", "c", LAW, normal=1.0),
        Spring("a", "c", stiffness=3.0 * inertia, damping=inertia / 3),
        Force("b", sine(1e-3, 0.7)),
    )
    result = simulate(scene, (0.0, 20.0))
    for name, a, b in (("ab", "a", "b"), ("bc", "b", "c")):
        stuck = result.mode(name) == 0
        assert stuck.any()
        assert np.all(result.velocity(a)[stuck] == result.velocity(b)[stuck])
    assert result.stats["restarts"] <= len(result.events)
    # only the load changes the momentum
    momentum = inertia * result.velocity("a") + result.velocity("b") + inertia / 7 * result.velocity("c")
    given = 1e-3 * (1 - np.cos(1.4 * math.pi * result.t)) / (1.4 * math.pi)
    begun = 0.1 * inertia + 0.7 - 0.3 * inertia / 7
    np.testing.assert_allclose(momentum, begun + given, rtol=0, atol=1e-13 * max(1.0, inertia))


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-9])
def test_an_event_right_after_a_start_is_seen(width: float) -> None:
    """A pulse frees the block, which is caught again within a tiny part of any first step."""
    peak = 5.5
    pulse = piecewise_linear([1.0, 1.0, 1.0 + width, 1.0 + width], [0.0, peak, peak, 0.0])
    result = simulate(block(pulse), (0.0, 1e4))
    assert told(result) == [("c", 0, 1), ("c", 1, 0)]
    start, stop = times(result)
    assert start == 1.0
    # accelerated by 1.5 for the width, decelerated by 4
    assert stop - start == pytest.approx(width * (1 + 1.5 / 4), rel=1e-6)


def test_two_crossings_right_after_a_start_are_seen() -> None:
    """A contact released at w = 0 comes back to 0 within 3e-6 s, in a run of 100 s."""
    load = piecewise_linear([0.0, 1e-6, 2e-6, 100.0], [5.0, 5.001, -5.0, -5.0])
    result = simulate(block(load), (0.0, 100.0))
    assert result.mode("c")[0] == 1 and told(result) == [("c", 1, 0)]
    # 1 N and more speed it up to v for 1e-6 s; then v + 1.001 s - 10.001e6 s^2 / 2 = 0
    v, fall = 1e-6 * (1 + 0.001 / 2), 10.001e6
    assert times(result)[-1] == pytest.approx(1e-6 + (1.001 + math.sqrt(1.001**2 + 2 * fall * v)) / fall, abs=1e-17)


def test_a_guard_that_reaches_zero_and_stays_there() -> None:
    """A load rises to the level of 5 N and stays; a slider comes to rest at 1 s, where 4 N begin, and stays at rest."""
    result = simulate(block(piecewise_linear([0, 1], [0, 5])), (0.0, 1e3))
    assert not result.events and np.all(result.velocity("a") == 0)
    stopping = simulate(block(piecewise_linear([1, 1], [0, 4]), velocity=4.0), (0.0, 100.0))
    assert told(stopping) == [("c", 1, 0)] and times(stopping) == [pytest.approx(1.0, abs=1e-12)]


@pytest.mark.parametrize("excess", [1e-4, 1e-8])
def test_two_crossings_inside_one_step_are_seen(excess: float) -> None:
    """A mass on a spring pulls a stuck body: its force exceeds the level for far less than a step."""
    scene = Scene(
        Body("a", inertia=1.0),
        Body("m", inertia=1.0, velocity=0.5 * (1 + excess)),
        Contact("c", "a", GROUND, LAW, normal=1.0),
        Spring("a", "m", stiffness=1.0),
    )
    result = (
        simulate(scene, (0.0, 3.0), rtol=1e-6, atol=1e-12)
        if excess > 1e-6
        else simulate(scene, (0.0, 3.0), rtol=1e-11, atol=1e-13)
    )
    assert told(result)[:1] == [("c", 0, 1)]
    # the spring pulls with 0.5 (1 + excess) sin t
    assert times(result)[0] == pytest.approx(math.asin(1 / (1 + excess)), abs=1e-9)


def test_a_load_that_touches_its_limit_between_samples_of_a_long_window() -> None:
    """No state moves, so nothing holds the step down: the load alone says where to look."""
    result = simulate(block(sine(5 * (1 + 1e-9), 0.01)), (0.0, 60.0))
    assert told(result)[:1] == [("c", 0, 1)]
    # 7e-4 s before the top; there the slope of the load is so small that its roundoff moves the time by 1e-11 s
    assert times(result)[0] == pytest.approx(math.asin(1 / (1 + 1e-9)) / (2 * math.pi * 0.01), abs=1e-9)
    assert not simulate(block(sine(5 * (1 - 1e-9), 0.01)), (0.0, 1e4)).events


def test_an_event_exactly_at_a_load_break_happens_once() -> None:
    """A block comes to rest at 1 s, where its load begins; another lets go at 1 s, where its load jumps from 5 N on."""
    law = DryFriction(0.5, 0.5)
    result = simulate(block(piecewise_linear([1, 2], [0, 4]), 2.0, law, velocity=1.0), (0.0, 2.0))
    assert told(result) == [("c", 1, 0), ("c", 0, 1)]
    assert times(result) == pytest.approx([1.0, 1.25], abs=1e-14)
    peak = simulate(block(piecewise_linear([0, 1, 1, 2], [0, 5, 6, 6])), (0.0, 2.0))
    assert told(peak) == [("c", 0, 1)] and times(peak) == [1.0]


def test_an_event_exactly_at_the_end() -> None:
    law = DryFriction(0.5, 0.5)
    result = simulate(block(0.0, 2.0, law, velocity=1.0), (0.0, 1.0))
    assert result.t[-1] == 1.0 and result.velocity("a")[-1] == pytest.approx(0.0, abs=1e-15)
    # the run ends as the block comes to rest: what happens from there on is not asked
    assert not result.events


@pytest.mark.parametrize("bad", [math.nan, math.inf, "text", None])
def test_a_signal_that_fails_half_way_is_reported(bad: Any) -> None:
    with pytest.raises((SimulationError, ValueError), match=r"signal function.*at t=1"):
        simulate(block(signal(lambda t: 0.1 if t < 1.0 else bad)), (0.0, 2.0))


def test_a_signal_that_raises_half_way_is_reported_with_what_was_computed() -> None:
    late: list[float] = []

    def load(t: float) -> float:
        # a look at the whole span before the start goes well
        late.extend([t] if t > 1.0 else [])
        if t > 1.0 and len(late) > 2000:
            raise ArithmeticError("the load cell broke")
        return 8.0 * math.sin(2 * math.pi * t)

    scene = Scene(
        *block(signal(load, period=1.0)).elements,
        Spring("a", GROUND, stiffness=3.0),
        Damper("a", GROUND, damping=0.1),
    )
    with pytest.raises(SimulationError, match="the load cell broke") as caught:
        simulate(scene, (0.0, 10.0))
    so_far = caught.value.result
    assert not so_far.success and so_far.status < 0 and so_far.events
    assert 1.0 < so_far.t[-1] <= caught.value.t < 10.0
    assert np.all(np.isfinite(so_far.velocity("a"))) and set(caught.value.modes) == {"c"}


def test_a_law_that_returns_nan_is_reported() -> None:
    law = DryFriction(0.5, 0.5, kinetic=lambda v: math.nan if v > 0.3 else 0.3)
    scene = Scene(*block(8.0, 10.0, law).elements, Spring("a", GROUND, stiffness=0.1))
    with pytest.raises(SimulationError, match="kinetic"):
        simulate(scene, (0.0, 2.0))


def test_the_state_after_a_root_is_projected() -> None:
    """The solver returns a state just past its root; here it is exactly at rest, not 1e-17 the other way."""
    result = simulate(block(sine(3.0, 0.7), velocity=1.0), (0.0, 1.0))
    (t,) = times(result)
    right = np.flatnonzero(result.t == t)[-1]
    assert result.velocity("a")[right] == 0.0
    assert np.all(result.velocity("a")[right:] == 0.0)


# The solver library


@pytest.mark.slow
@pytest.mark.parametrize(("method", "work"), [("BDF", "guard_calls"), ("series", "steps")])
def test_many_events_are_neither_mixed_nor_slow(method: str, work: str) -> None:
    """Solvers are used again after events: each of hundreds of events costs no more than each of few."""
    scene = Scene(*block(sine(20.0, 1.0), 10.0, DryFriction(0.4, 0.4)).elements)
    few, many = (simulate(scene, (0.0, stop), method=method) for stop in (10.0, 100.0))
    assert len(many.events) > 8 * len(few.events) > 100
    assert 0 < many.stats[work] / len(many.events) < 1.5 * few.stats[work] / len(few.events)
    assert many.stats["solvers"] < len(many.events) / 10
    np.testing.assert_allclose(times(many)[: len(few.events)], times(few), atol=1e-6)


def test_a_simulation_within_a_simulation() -> None:
    """A load that is itself simulated: two solvers at work at a time do not share their records."""
    inner = block(sine(20.0, 1.0), 10.0, DryFriction(0.4, 0.4))
    expected = simulate(inner, (0.0, 2.0))
    counts = []

    def load(t: float) -> float:
        if len(counts) < 5:
            counts.append(len(simulate(inner, (0.0, 2.0)).events))
        return 20.0 * math.sin(2 * math.pi * t)

    outer = simulate(block(signal(load, period=1.0), 10.0, DryFriction(0.4, 0.4)), (0.0, 2.0))
    assert set(counts) == {len(expected.events)}
    assert told(outer) == told(expected)
    np.testing.assert_allclose(times(outer), times(expected), atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_more_steps_than_the_solver_takes_at_once(method: str) -> None:
    """Hundreds of periods without an event: thousands of steps in one segment."""
    scene, periods = oscillator(100.0)
    result = simulate(scene, (0.0, periods), method=method, rtol=1e-8, atol=1e-10)
    assert result.stats["steps"] > 2500
    end = result.position("a")[-1]
    assert end == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
def test_a_solver_that_gets_nowhere_gives_up() -> None:
    calls = [0]

    def rattling(t: float) -> float:
        """No function of time at all: no step is small enough."""
        calls[0] += t >= 1.0
        if calls[0] > 200_000:
            pytest.fail("no end in sight")
        return 0.0 if t < 1.0 else 1e9 * (-1) ** (calls[0] // 2)

    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0), Force("a", signal(rattling)), Spring("a", GROUND, stiffness=1.0)
    )
    with pytest.raises(SimulationError) as caught:
        simulate(scene, (0.0, 2.0))
    so_far = caught.value.result
    assert not so_far.success and so_far.t.size > 1 and so_far.t[-1] <= caught.value.t < 1.5


@pytest.mark.slow
def test_nothing_is_printed() -> None:
    """SUNDIALS writes its own errors and warnings to stderr."""
    code = (
        "from stickslip import *\n"
        "s = Scene(Body('a', inertia=1.0, velocity=1.0), Spring('a', GROUND, stiffness=1.0),"
        " Contact('c', 'a', GROUND, DryFriction(0.5, 0.4), normal=1.0), Force('a', sine(2.0, 0.3)))\n"
        "simulate(s, (0, 20))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "" and done.stderr == ""


def test_values_between_steps_are_as_good_as_steps() -> None:
    scene, _ = oscillator(3.0)
    result = simulate(scene, (0.0, 3.0), rtol=1e-9, atol=1e-12)
    t = np.linspace(0.0, 3.0, 1001)
    exact = -2 * math.pi * np.sin(2 * math.pi * t)
    at_steps = np.abs(result.velocity("a") + 2 * math.pi * np.sin(2 * math.pi * result.t)).max()
    assert np.abs(result(t)[0] - exact).max() < 2 * at_steps + 1e-9


# Friction


def test_the_mode_is_the_sign_even_where_the_velocity_is_zero() -> None:
    """At breakaway w is still 0: the friction force has its kinetic value and sign at once."""
    for load, mode in ((piecewise_linear([0, 1], [0, 10]), 1), (piecewise_linear([0, 1], [0, -10]), -1)):
        result = simulate(block(load), (0.0, 1.0))
        (event,) = result.events
        assert event.after == mode and event.t == pytest.approx(0.5)
        right = np.flatnonzero(result.t == event.t)[-1]
        assert result.velocity("a")[right] == 0 and result.mode("c")[right] == mode
        assert result.force("c")[right] == pytest.approx(4.0 * mode)
        assert result.force("c")[right - 1] == pytest.approx(5.0 * mode)


def test_slip_starts_from_zero_relative_acceleration() -> None:
    """With mu_k(0) = mu_s the relative acceleration at breakaway is 0: the contact still slips, and stays so."""
    for law in (DryFriction(0.5, 0.5), DryFriction(0.5, 0.4, stribeck_velocity=0.1)):
        result = simulate(block(piecewise_linear([0, 1], [0, 10]), 10.0, law), (0.0, 1.0))
        assert told(result) == [("c", 0, 1)] and result.velocity("a")[-1] > 0.5


def test_locked_motions_are_no_singular_system() -> None:
    """A brake on a wheel that is stuck to the ground already, two contacts between one pair, and a ring."""
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0) for i in range(3)),
        *(Contact(f"c{i}", f"b{i}", f"b{(i + 1) % 3}", LAW, normal=10.0) for i in range(3)),
        Contact("again", "b0", "b1", LAW, normal=10.0),
        Contact("pad", "b0", GROUND, LAW, normal=10.0),
        Contact("brake", "b0", GROUND, LAW, normal=triangle(1, 2, 3, slope=20)),
        Force("b1", sine(3.0, 0.5)),
    )
    result = simulate(scene, (0.0, 4.0))
    assert not result.events and np.all(result.y == 0)
    for contact in scene.contacts:
        assert np.all(np.isfinite(result.force(contact.name)))
    ground = result.force("pad") + result.force("brake")
    np.testing.assert_allclose(ground, [3 * math.sin(math.pi * t) for t in result.t], atol=1e-9)


def test_modes_that_flip_without_end_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where time does not go on, an error names the contacts; the run does not hang."""

    def no_progress(self: Any, motion: Motion, guards: Any, horizon: float) -> Path:
        return Path(np.zeros(2), motion.y[None, None, :].copy(), motion.y, hit=True)

    monkeypatch.setattr(Series, "advance", no_progress)
    with pytest.raises(SimulationError, match="progress in time: contacts 'c'"):
        simulate(block(piecewise_linear([0, 1], [0, 10]), velocity=1.0), (0.0, 1.0))


def test_a_drive_that_passes_zero_at_roundoff_does_not_trap_a_body_between_it_and_the_ground() -> None:
    """The drive's velocity at the root is 1e-16, not 0: within roundoff of the time the drive is at rest."""
    for start in (0.0, 2.9, 1e3):
        velocity = piecewise_linear([start, start + 0.07, start + 2.22], [0.16, -1.0, 0.81])
        scene = Scene(
            Body("a", inertia=1.0),
            Drive("d", velocity=velocity),
            Contact("g", "a", GROUND, LAW, normal=15.0),
            Contact("c", "a", "d", LAW, normal=14.0),
            Force("a", sine(0.5, 0.3)),
        )
        result = simulate(scene, (start, start + 3.0))
        assert [e.contact for e in result.events].count("g") == 0
        assert result.stats["restarts"] < 20


@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_falling_friction_on_a_belt(method: str) -> None:
    """Leine's limit cycle, known to twelve digits: slip 4.29599952548016 s, stick 7.70503176935042 s."""
    result = simulate(belt(), (0.0, 60.0), method=method, rtol=1e-11, atol=1e-13)
    stuck = [e.t for e in result.events if e.after == 0]
    released = [e.t for e in result.events if e.before == 0]
    assert stuck[0] < released[0]
    slip = np.array(stuck[1:]) - released[: len(stuck) - 1]
    stick = np.array(released) - stuck[: len(released)]
    np.testing.assert_allclose(slip[1:], 4.29599952548016, rtol=0, atol=1e-9)
    np.testing.assert_allclose(stick[1:], 7.70503176935042, rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.diff(released)[1:], 12.0010312948306, rtol=0, atol=1e-7)
    fine = np.linspace(released[1], stuck[2], 4001)
    assert result(fine)[1].max() == pytest.approx(1.13394467644166, abs=1e-6)


@pytest.mark.parametrize(
    ("exponent", "velocity"),
    [(2.0, 0.1), (1.0, 0.1), (0.7, 0.1), (0.5, 1e-3), (0.1, 0.1), (2.0, 1e-6), (2.0, 1e6)],
)
def test_stribeck_curves(exponent: float, velocity: float) -> None:
    law = DryFriction(0.5, 0.4, stribeck_velocity=velocity, stribeck_exponent=exponent)
    result = simulate(block(sine(3.0, 0.7), 5.0, law), (0.0, 1.5))
    assert told(result) == [("c", 0, 1), ("c", 1, 0), ("c", 0, -1), ("c", -1, 0)]
    assert times(result)[0] == pytest.approx(math.asin(2.5 / 3) / (1.4 * math.pi), abs=1e-10)


@pytest.mark.parametrize("velocity", [0.1, 1e-3])
def test_stribeck_exponent_one_half(velocity: float) -> None:
    """Friction falls infinitely fast at rest: ``w' = 3 sin(1.4 pi t) - 5 mu_k(w)`` after breakaway, by scipy."""
    law = DryFriction(0.5, 0.4, stribeck_velocity=velocity, stribeck_exponent=0.5)
    first = math.asin(2.5 / 3) / (1.4 * math.pi)
    result = simulate(block(sine(3.0, 0.7), 5.0, law), (0.0, 0.5))
    assert told(result) == [("c", 0, 1)]
    assert times(result)[0] == pytest.approx(first, abs=1e-10)

    def rate(t: float, w: np.ndarray) -> list[float]:
        return [3 * math.sin(1.4 * math.pi * t) - 5 * law.mu_k(max(float(w[0]), 0.0), 1)]

    exact = solve_ivp(rate, (first, 0.5), [0.0], method="DOP853", rtol=1e-10, atol=1e-13).y[0, -1]
    assert result.velocity("a")[-1] == pytest.approx(exact, rel=1e-6)


@pytest.mark.slow
def test_a_storm_that_creeps_on_ends_in_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the true slopes of such a curve near rest, modes flip every 1e-8 s: the run would take a day."""

    def scene(belt: float, exponent: float) -> Scene:
        law = DryFriction(0.5, 0.4, stribeck_velocity=1e-3, stribeck_exponent=exponent)
        return Scene(
            Drive("belt", velocity=belt),
            Body("a", inertia=1.0),
            Contact("c", "a", "belt", law, normal=10.0),
            Spring("a", GROUND, stiffness=20.0),
        )

    assert len(simulate(scene(0.11, 0.5), (0.0, 4.0)).events) == 3
    monkeypatch.setattr("stickslip.model.laws.kinetic._STEEPEST", 0.0)
    monkeypatch.setattr("stickslip.simulation.timeline._EVENTS_BETWEEN_LOOKS", 100)
    with pytest.raises(SimulationError, match="progress in time: contacts 'c'"):
        # another scene: the first one has its law compiled already
        simulate(scene(0.1, 0.3), (0.0, 20.0))


@pytest.mark.parametrize("stribeck", [None, 0.1])
def test_dwell_has_no_effect_beside_a_stribeck_curve(stribeck: float | None) -> None:
    """With a Stribeck curve slow slip meets mu_s: it lets go where ``mu_s N = F``, at 3 s. Dwell alone: earlier."""
    law = DryFriction(0.3, 0.2, dwell=2.0, stribeck_velocity=stribeck)
    (event, *_) = simulate(block(piecewise_linear([0.0, 10.0], [0.0, 10.0]), 10.0, law), (0.0, 4.0)).events
    if stribeck is None:
        assert event.t < 2.8
    else:
        assert event.t == pytest.approx(3.0, abs=1e-9)


# Time and size


def test_short_pulses_in_long_windows() -> None:
    force = block(triangle(5e3, 5e3 + 5e-7, 5e3 + 1e-6, slope=1e9), 1.0)
    result = simulate(force, (0.0, 1e4))
    assert told(result) == [("c", 0, 1), ("c", 1, 0)]
    normal = block(0.0, triangle(5e3, 5e3 + 5e-7, 5e3 + 1e-6, slope=1e12), velocity=1.0)
    braked = simulate(normal, (0.0, 1e4))
    # 0.4 times the area 0.25 N s of the triangle
    assert braked.velocity("a")[-1] == pytest.approx(1.0 - 0.4 * 0.25, rel=1e-6)


def test_events_late_in_a_long_run_are_sharp() -> None:
    start = 1e6
    load = piecewise_linear([start, start + 1.0], [0.0, 10.0])
    (event,) = simulate(block(load), (0.0, start + 1.0)).events
    assert event.t == pytest.approx(start + 0.5, abs=3e-10)


@pytest.mark.parametrize("scale", [1e-12, 1e12])
@pytest.mark.parametrize("quantity", ["length", "time", "mass"])
def test_units_do_not_matter(quantity: str, scale: float) -> None:
    units = {"length": 1.0, "time": 1.0, "mass": 1.0} | {quantity: scale}
    length, time, mass = units["length"], units["time"], units["mass"]
    force = mass * length / time**2

    def scene(length: float, time: float, mass: float, force: float) -> Scene:
        load = piecewise_linear([0, 1 * time, 2 * time, 3 * time, 4 * time], [0, 2 * force, -3 * force, 4 * force, 0])
        return Scene(
            Body("a", inertia=mass, velocity=length / time),
            Body("b", inertia=2 * mass, velocity=0.3 * length / time),
            Contact("c", "a", GROUND, DryFriction(0.5, 0.4, dwell=0.3 * time), normal=force),
            Contact("d", "a", "b", LAW, normal=2 * force),
            Force("a", load),
        )

    first = simulate(scene(1.0, 1.0, 1.0, 1.0), (0.0, 8.0))
    scaled = simulate(scene(length, time, mass, force), (0.0, 8.0 * time))
    assert told(first) == told(scaled) and len(first.events) >= 5
    np.testing.assert_allclose(np.array(times(scaled)) / time, times(first), rtol=1e-12)


def two_on_springs(length: float) -> Scene:
    return Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0, velocity=0.3 * length),
        Contact("c", "a", GROUND, LAW, normal=length),
        Contact("d", "a", "b", LAW, normal=2 * length),
        Spring("a", "b", stiffness=3.0, damping=0.1),
        Spring("b", GROUND, stiffness=1.0),
        Force("a", sine(length, 0.21)),
    )


@pytest.mark.parametrize("length", [1e-12, 1e-6, 1e6, 1e12])
def test_units_with_springs_need_an_absolute_tolerance_to_match(length: float) -> None:
    first = simulate(two_on_springs(1.0), (0.0, 20.0), rtol=1e-9, atol=1e-12)
    scaled = simulate(two_on_springs(length), (0.0, 20.0), rtol=1e-9, atol=1e-12 * length)
    assert told(first) == told(scaled)
    np.testing.assert_allclose(times(scaled), times(first), rtol=0, atol=2e-8)


@pytest.mark.parametrize("velocity", [1e-9, -1e-9])
def test_default_tolerances_suit_what_moves_slowly_in_either_direction(velocity: float) -> None:
    """v = v0 exp(-t), for any v0."""
    scene = Scene(Body("b", inertia=1.0, velocity=velocity), Damper("b", GROUND, damping=1.0))
    result = simulate(scene, (0.0, 3.0), method="BDF")
    assert result.velocity("b")[-1] == pytest.approx(velocity * math.exp(-3), rel=1e-6)


def test_default_tolerances_suit_small_units() -> None:
    first, scaled = (simulate(two_on_springs(length), (0.0, 20.0)) for length in (1.0, 1e-9))
    assert told(first) == told(scaled)
    np.testing.assert_allclose(times(scaled), times(first), rtol=0, atol=1e-6)


@pytest.mark.parametrize("engine", [{}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("geared", [False, True])
def test_a_start_velocity_of_roundoff_changes_nothing(engine: dict[str, Any], geared: bool) -> None:
    """A start velocity of 1e-11 m/s, as an earlier run may leave it, changes nothing.

    Breakaway comes where ``5 + 1.5 sin 1.1 t = 0.845 * 6.26``.
    """
    law = DryFriction(0.845, 0.5815, stribeck_velocity=0.134, stribeck_exponent=1.0)
    load = signal(lambda t: -5.0 - 1.5 * math.sin(1.1 * t), period=5.7)
    ends = []
    for velocity in (0.0, -1.3e-11):
        parts = [Body("b", inertia=6.0, velocity=velocity), Gear("g", "a", "b", ratio=1.0)] if geared else []
        body = Body("a", inertia=1.0 if geared else 7.0, velocity=velocity)
        contact = Contact("c", "a", GROUND, law, normal=6.26)
        result = simulate(Scene(body, contact, Force("a", load), *parts), (0.0, 2.6), method="BDF", **engine)
        assert result.events[-1].t == pytest.approx(math.asin((0.845 * 6.26 - 5.0) / 1.5) / 1.1, abs=1e-9)
        ends.append(result.velocity("a")[-1])
    assert ends[1] == pytest.approx(ends[0], abs=1e-7)


def test_slow_functions_are_the_same_as_fast_ones() -> None:
    """Months in place of seconds: slopes of functions are differences over parts of their own periods."""

    def scene(second: float) -> Scene:
        turn = 2 * math.pi / second
        law = DryFriction(0.5, 0.5, stribeck_velocity=0.05 / second)
        return Scene(
            Body("b", inertia=1.0),
            Drive("d", velocity=signal(lambda t: 0.5 / second * math.sin(turn * t / 3.1), period=3.1 * second)),
            Contact("c", "b", "d", law, normal=4.3 / second**2),
            Force("b", signal(lambda t: 2 / second**2 * math.sin(turn * t / 2.9 + 3.4), period=2.9 * second)),
        )

    first, *others = (simulate(scene(second), (0.0, 6.0 * second), method="BDF") for second in (1.0, 1e5, 1e7))
    assert len(first.events) == 9
    for second, slow in zip((1e5, 1e7), others, strict=True):
        assert told(slow) == told(first)
        np.testing.assert_allclose(np.array(times(slow)) / second, times(first), rtol=0, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("velocity", [0.0, 1e-6])
@pytest.mark.parametrize("delay", [0.0, 1e4])
@pytest.mark.parametrize("damping", [1e2, 1e4, 1e6])
@pytest.mark.parametrize("engine", [{"method": "BDF"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("kind", ["function", "sine with dwell"])
def test_slow_sliding_beside_a_stiff_damper_ends(
    kind: str, engine: dict[str, Any], damping: float, delay: float, velocity: float
) -> None:
    """A load of 3 sin(omega t) moves 1 kg against 1 N and a damper: it rests where ``3 sin(omega t - phi) = k``.

    Here ``tan phi = omega / c`` and ``k = sqrt(1 + tan^2 phi)``; the transient of the start has died away.
    """
    omega = 2 * math.pi / 500.0
    load = sine(3.0, 1 / 500.0)
    if kind == "function":
        load = signal(lambda t: 3.0 * math.sin(omega * t), period=500.0)
    scene = Scene(
        Body("a", inertia=1.0, velocity=velocity),
        Force("a", load),
        Damper("a", GROUND, damping=damping),
        Contact("c", "a", GROUND, DryFriction(0.1, 0.1, dwell=float(kind != "function")), normal=10.0),
    )
    events = simulate(scene, (delay, delay + 500.0), **engine).events[-4:]
    lag = math.atan(omega / damping)
    slip = math.asin(1 / 3) / omega
    rest = (math.pi - math.asin(1 / 3 / math.cos(lag)) + lag) / omega
    assert [(int(e.before), int(e.after)) for e in events] == [(0, 1), (1, 0), (0, -1), (-1, 0)]
    expected = [delay + t for t in (slip, rest, 250.0 + slip, 250.0 + rest)]
    np.testing.assert_allclose([e.t for e in events], expected, rtol=0, atol=1e-4)


# Large scenes


def chain(count: int, springs: bool) -> Scene:
    numbers = np.random.default_rng(count)
    elements: list[Any] = []
    for i in range(count):
        elements.append(Body(f"b{i}", inertia=float(numbers.uniform(0.5, 2)), velocity=float(numbers.uniform(-1, 1))))
    for i in range(count - 1):
        law = DryFriction(
            float(numbers.uniform(0.4, 0.6)),
            float(numbers.uniform(0.2, 0.4)),
            dwell=float(numbers.choice([0.0, 0.1])),
        )
        elements.append(Contact(f"c{i}", f"b{i}", f"b{i + 1}", law, normal=float(numbers.uniform(3, 30))))
        if springs and i % 5 == 0:
            elements.append(Spring(f"b{i}", f"b{i + 1}", stiffness=2.0, damping=0.2))
    for i in range(0, count, 11):
        elements.append(Contact(f"g{i}", f"b{i}", GROUND, LAW, normal=float(numbers.uniform(1, 3))))
    for i in range(0, count - 3, 9):
        elements.append(Contact(f"l{i}", f"b{i}", f"b{i + 3}", LAW, normal=2.0))
    elements.append(Force("b0", piecewise_linear([0, 0.5, 1, 1.5], [0, 20, -20, 0])))
    return Scene(*elements)


LARGE: dict[str, tuple[bool, dict[str, Any], dict[str, float]]] = {
    "series": (True, {"method": "series"}, {}),
    "straight lines": (False, {}, {}),
    "band": (True, {"method": "BDF"}, {"_NARROW": 2.0}),
    "sparse": (True, {"method": "BDF"}, {"_NARROW": 0.0, "_DENSE_UNLESS_BANDED": 0}),
    "multiplier": (True, {"formulation": "multiplier"}, {}),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", LARGE)
def test_large_scenes_move_like_small_ones(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """Sparse matrices, bands and trees instead of dense ones: the same motion."""
    springs, options, limits = LARGE[kind]
    results = [simulate(chain(14, springs), (0.0, 1.5), **options)]
    assert not results[0].trajectory.system.sparse
    for module in (system, linear_solver, ida):
        monkeypatch.setattr(module, "_DENSE_LIMIT", 0)
    monkeypatch.setattr(balance, "_SMALL", 0)
    for name, value in limits.items():
        monkeypatch.setattr(linear_solver, name, value)
    scene = chain(14, springs)  # a new one: the first one is compiled already
    results.append(simulate(scene, (0.0, 1.5), **options))
    assert results[1].trajectory.system.sparse
    small, large = results
    assert told(small) == told(large) and len(small.events) > 15
    np.testing.assert_allclose(times(large), times(small), atol=1e-9)
    np.testing.assert_allclose(large(1.5), small(1.5), atol=1e-8)
    for contact in scene.contacts:
        force = [float(result.force(contact.name)[-1]) for result in results]
        assert force[0] == pytest.approx(force[1], abs=1e-6)


@pytest.mark.slow
def test_a_hundred_and_fifty_bodies() -> None:
    scene = chain(150, springs=False)
    result = simulate(scene, (0.0, 0.1))
    assert result.success and len(result.events) > 5
    # until the first contact sticks all slide: each relative velocity changes evenly, but those of b0, which is loaded
    start = {body.name: body.velocity for body in scene.bodies} | {GROUND: 0.0}
    pushed = dict.fromkeys(start, 0.0)
    for c in scene.contacts:
        friction = math.copysign(c.law.core.mu_coulomb * c.normal(0.0), start[c.a] - start[c.b])
        pushed[c.a] -= friction
        pushed[c.b] += friction
    rate = {body.name: pushed[body.name] / body.inertia for body in scene.bodies} | {GROUND: 0.0}
    stops = [((start[c.b] - start[c.a]) / (rate[c.a] - rate[c.b]), c.name) for c in scene.contacts if c.a != "b0"]
    first, name = min(stop for stop in stops if stop[0] > 0)
    assert result.events[0].contact == name and result.events[0].t == pytest.approx(first, rel=1e-10, abs=0.0)
    for contact in scene.contacts[::10]:
        stuck = result.mode(contact.name) == 0
        assert np.all(result.relative_velocity(contact.name)[stuck] == 0)
