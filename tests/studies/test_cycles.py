"""Limit cycles: periods and multipliers in closed form, unstable cycles, and motions without a cycle."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve

from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Cycle,
    CycleError,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    LuGre,
    PreSlip,
    Scene,
    Signal,
    Spring,
    StateSpace,
    Stop,
    feedback,
    limit_cycle,
    output,
    piecewise_linear,
    position,
    saturate,
    simulate,
    sine,
    step,
    velocity,
)
from stickslip.simulation.simulate import compiled
from stickslip.studies.cycles import newton, search

BELT_PERIOD = 7.61125925410131
"""2 (F_s - F_c) / (k v) + (2 pi - 2 atan((F_s - F_c) / (v sqrt(k m)))) / w, k 2, m 1, v 0.1, F_s 1.5, F_c 1."""

VALVE_PERIOD = 212.247296
"""Of the valve below, to 1e-6."""

HUNTING_PERIOD = 23.264512417163
"""Of the slide below, to 1e-11."""

BELT_SLOPE = -46.2962962962963


def belt(v: float = 0.1, law: DryFriction | None = None) -> Scene:
    return Scene(
        Body("m", inertia=1.0, velocity=v),
        Drive("belt", velocity=v),
        Spring("m", GROUND, stiffness=2.0),
        Contact("c", "m", "belt", law or DryFriction(1.5, 1.0), normal=1.0),
    )


def pulled(law: DryFriction | None = None) -> Scene:
    """The belt's scene seen from the belt: a hand pulls the block by the spring, and all positions drift."""
    return Scene(
        Body("m", inertia=1.0),
        Drive("hand", velocity=0.1),
        Spring("m", "hand", stiffness=2.0),
        Contact("c", "m", GROUND, law or DryFriction(1.5, 1.0), normal=1.0),
    )


def den_hartog(friction: float = 0.5, ratio: float = 0.8) -> tuple[Scene, float]:
    scene = Scene(
        Body("m", inertia=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", GROUND, DryFriction(friction, friction), normal=1.0),
        Force("m", sine(1.0, ratio / (2 * math.pi))),
    )
    return scene, 2 * math.pi / ratio


def test_a_block_on_a_belt() -> None:
    cycle = limit_cycle(belt())
    assert cycle.period == pytest.approx(BELT_PERIOD, abs=1e-13)
    assert cycle.multipliers.tolist() == [0.0]
    assert cycle.stable and cycle.sticks and not cycle.forced and cycle.closes < 1e-14
    assert sorted(cycle.sequence) == ["c: BACKWARD -> STUCK", "c: STUCK -> BACKWARD"]
    assert cycle.sensitivities(["belt.velocity"]) == pytest.approx([BELT_SLOPE], abs=1e-9)
    # it slips around F_c / k with the amplitude sqrt(((F_s - F_c) / k)^2 + m v^2 / k)
    assert cycle.amplitude("m") == pytest.approx(math.hypot(0.25, 0.1 / math.sqrt(2)), abs=1e-9)
    assert "forgets" in str(cycle) and "stable" in str(cycle)


def test_the_scene_of_a_cycle_repeats_it() -> None:
    cycle = limit_cycle(belt())
    result = simulate(cycle.scene, (0.0, 5 * cycle.period), method="BDF", rtol=1e-10, atol=1e-12)
    times = np.array([event.t for event in result.events])
    assert np.allclose(times[2:] - times[:-2], BELT_PERIOD, atol=1e-7)


def test_positions_that_nothing_reads_may_drift() -> None:
    cycle = limit_cycle(pulled())
    assert cycle.period == pytest.approx(BELT_PERIOD, abs=1e-12)
    slopes = cycle.sensitivities(["hand.velocity", "c.law.mu_static"])
    # stick phase 2 (F_s - F_c) / (k v), and the slip phase
    ratio = (1.5 - 1.0) / (0.1 * math.sqrt(2.0))
    by_static = 2 / (2.0 * 0.1) - 2 / math.sqrt(2.0) / (1 + ratio**2) / (0.1 * math.sqrt(2.0))
    assert slopes == pytest.approx([BELT_SLOPE, by_static], abs=1e-8)
    moved = cycle.result.position("m")
    assert moved[-1] - moved[0] == pytest.approx(0.1 * BELT_PERIOD, abs=1e-12)


def test_dwell_remembers_how_long_the_contact_stuck() -> None:
    """The breakaway level depends on the time stuck before: a multiplier that is not 0, whatever the start."""
    scene = pulled(DryFriction(1.5, 1.0, dwell=2.0))
    cycle = limit_cycle(scene)
    stuck = [event.t for event in simulate(scene, (0.0, 200.0)).events if event.after == 0]
    assert stuck[-1] - stuck[-2] == pytest.approx(cycle.period, abs=1e-10)
    gaps = np.diff(stuck)[3:8] - cycle.period
    assert gaps[1:] / gaps[:-1] == pytest.approx(cycle.multipliers[0].real * np.ones(4), rel=0.02)


@pytest.mark.slow
def test_forced_oscillator_of_den_hartog() -> None:
    """Frequency ratio 0.8, friction ratio 0.5: the moduli are exact to 14 digits."""
    scene, period = den_hartog()
    cycle = limit_cycle(scene, period=period)
    assert cycle.period == period and cycle.forced and cycle.stable and not cycle.sticks
    assert np.abs(cycle.multipliers) == pytest.approx([0.49815078400816] * 2, abs=1e-13)
    twice = limit_cycle(scene, period=2 * period)
    assert np.abs(twice.multipliers) == pytest.approx([0.49815078400816**2] * 2, abs=1e-13)


def test_hunting_of_a_pid_controller() -> None:
    """Armstrong and Amin (1996): period, amplitude, and the square of the slope of the half-period map."""
    scene = Scene(
        Body("m", inertia=1.0, position=0.07),
        Contact("c", "m", GROUND, DryFriction(1.5, 1.0), normal=1.0),
        StateSpace("integral", [[0.0]], [[1.0]], [[1.0]], inputs=[position("m")]),
        Force("m", -6 * velocity("m") - 3 * position("m") - 4 * output("integral")),
    )
    cycle = limit_cycle(scene)
    assert cycle.period == pytest.approx(23.3692722930883, abs=1e-12)
    assert cycle.amplitude("m") == pytest.approx(0.0672401469208670, abs=1e-14)
    # the flow over a period adds up terms of size 1: derivatives are right to about 1e-12 of these
    assert cycle.multipliers[0] == pytest.approx(0.0886262150448**2, abs=1e-11)
    assert cycle.multipliers[1] == 0 and len(cycle.sequence) == 4


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [2.2, 2.4, 2.8])
def test_an_oscillator_that_hits_a_stop_once_a_period(ratio: float) -> None:
    """x'' + x = sin(w t), a stop at 0: det = e^2 and a trace in closed form (Shaw and Holmes 1983)."""
    e, period = 0.8, 2 * math.pi / ratio
    scene = Scene(
        Body("m", inertia=1.0, position=-0.1),
        Spring("m", GROUND, stiffness=1.0),
        Stop("wall", "m", GROUND, upper=0.0, restitution=e),
        Force("m", sine(1.0, ratio / (2 * math.pi))),
    )
    cycle = limit_cycle(scene, period=period)
    # after the impact x = A cos t + B sin t + X sin(w t + phase), and x(T) = x(0) = 0
    ratio_ab = 1 / math.tan(0.5 * period)
    speed = (-ratio_ab * math.sin(period) + math.cos(period) - 1) / (1 + e)
    b = -abs(1 / (1 - ratio**2)) / math.hypot(ratio_ab, (1 + e * speed) / ratio)
    push, hit = -ratio_ab * b * (1 - ratio**2), speed * b
    (event,) = cycle.result.events
    assert event.cause == "impact"
    assert cycle.result.sample([event.t]).velocity("m")[0] == pytest.approx(-e * hit, abs=1e-12)
    saltation = np.array([[-e, 0.0], [(1 + e) * push / hit, -e]])
    turn = np.array([[math.cos(period), math.sin(period)], [-math.sin(period), math.cos(period)]])
    exact = np.linalg.eigvals(saltation @ turn)
    assert np.sort_complex(cycle.multipliers) == pytest.approx(np.sort_complex(exact.astype(complex)), abs=1e-11)


@pytest.mark.slow
def test_a_cycle_that_rests_at_a_stop() -> None:
    """Without restitution the rest at the stop forgets the motion before; the cycle may begin at rest."""
    for phase in (0.0, 1.66):
        scene = Scene(
            Body("m", inertia=1.0, position=-0.1),
            Spring("m", GROUND, stiffness=1.0, damping=0.1),
            Stop("wall", "m", GROUND, upper=0.2),
            Force("m", sine(1.0, 0.6 / (2 * math.pi), phase=phase)),
        )
        cycle = limit_cycle(scene, period=2 * math.pi / 0.6)
        assert cycle.multipliers.tolist() == [0.0, 0.0] and cycle.closes < 1e-14
        assert sorted(cycle.sequence) == ["wall: FORWARD -> OPEN", "wall: OPEN -> FORWARD"]


def test_stick_slip_against_a_stop() -> None:
    scene = Scene(*belt().elements, Stop("w", "m", GROUND, lower=0.35)).replace("m", position=0.5)
    cycle = limit_cycle(scene)
    # from F_s/k to the stop, from there until it is as fast as the belt, and with it to F_s/k
    w, v = math.sqrt(2.0), 0.1
    slip = (math.atan2(v / w, 0.25) + math.acos(-0.15 / math.hypot(0.25, v / w))) / w
    back = math.asin(v / (0.15 * w)) / w
    stick = (0.25 + 0.15 * math.cos(w * back)) / v
    assert cycle.period == pytest.approx(slip + back + stick, abs=1e-12)
    assert cycle.multipliers.tolist() == [0.0] and "w: OPEN -> OPEN" in cycle.sequence
    by_limit = cycle.sensitivities(["w.lower"])
    assert by_limit == pytest.approx([-12.1525043], abs=1e-6)


def test_a_family_of_cycles_is_neutral() -> None:
    scene = Scene(Body("m", inertia=1.0, position=1.0), Spring("m", GROUND, stiffness=4.0))
    cycle = limit_cycle(scene)
    assert cycle.period == pytest.approx(math.pi, abs=1e-12)
    assert cycle.neutral and not cycle.stable and abs(cycle.multipliers[0]) == pytest.approx(1.0, abs=1e-7)


def leine(velocity: float = 0.0, position: float = 0.0, damping: float = 0.0) -> Scene:
    """The oscillator of Leine et al. (1998), with a damper."""
    law = DryFriction(1.0, 1.0, kinetic=lambda v: 1.0 / (1.0 + 3.0 * abs(v)))
    return Scene(
        Body("m", inertia=1.0, velocity=velocity, position=position),
        Drive("belt", velocity=0.2),
        Spring("m", GROUND, stiffness=1.0, damping=damping),
        Contact("c", "m", "belt", law, normal=1.0),
    )


@pytest.mark.slow
def test_leine_belt() -> None:
    cycle = limit_cycle(leine(0.2))
    assert cycle.period == pytest.approx(12.0010312948306, abs=3e-9)
    assert cycle.multipliers.tolist() == [0.0]


@pytest.mark.slow
def test_an_unstable_cycle_lies_between_rest_and_stick_slip() -> None:
    """With a damper the block at rest on the running belt is stable, and so is stick-slip."""
    start = 1 / 1.6 + 0.13
    cycle = limit_cycle(leine(position=start, damping=1.2), guess=2 * math.pi, transient=0)
    assert not cycle.stable and cycle.sequence == () and cycle.period == pytest.approx(6.3321659579, abs=1e-8)
    # deviations grow by the multiplier in each turn
    body = cycle.scene.bodies[0]
    (growth,) = np.abs(cycle.multipliers)
    for part in (1e-4, -1e-4):
        off = cycle.scene.replace("m", position=body.position + part, velocity=body.velocity)
        result = simulate(off, (0.0, 3 * cycle.period), rtol=1e-11, atol=1e-13)
        size = [np.ptp(result.sample(np.linspace(k, k + 1, 2001) * cycle.period).position("m")) for k in (0, 1, 2)]
        sizes = np.array(size) - 2 * cycle.amplitude("m")
        assert sizes[2] / sizes[1] == pytest.approx(growth, rel=0.02)


def test_two_blocks_on_a_belt() -> None:
    scene = Scene(
        *(Body(name, inertia=1.0, velocity=0.1) for name in "ab"),
        Drive("belt", velocity=0.1),
        Spring("a", GROUND, stiffness=2.0),
        Spring("b", GROUND, stiffness=2.2),
        Spring("a", "b", stiffness=1.0),
        *(Contact(f"c{name}", name, "belt", DryFriction(1.5, 1.0), normal=1.0) for name in "ab"),
    )
    cycle = limit_cycle(scene)
    assert cycle.stable and cycle.multipliers.size == 3 and np.count_nonzero(cycle.multipliers) == 1
    result = simulate(cycle.scene, (0.0, 10 * cycle.period))
    last = [event.t for event in result.events if event.contact == "ca" and event.after == 0]
    assert np.diff(last) == pytest.approx(cycle.period * np.ones(len(last) - 1), abs=1e-11)


def test_what_whirls_does_not_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Froude's pendulum on a fast shaft: each turn is like the one before, but a force reads the angle, which grows."""
    monkeypatch.setattr(search, "_TRIES", 2)
    scene = Scene(
        Body("p", inertia=1.0, velocity=3.0),
        Drive("shaft", velocity=4.0),
        Contact("c", "p", "shaft", DryFriction(0.5, 0.2, stribeck_velocity=1.0), normal=1.0),
        Force("p", feedback(lambda angle: -math.sin(angle), position("p"))),
        motion="rotation",
    )
    with pytest.raises(CycleError, match=r"the position of 'p' goes on, by 4(\.0\d)? in a second, and forces read it"):
        limit_cycle(scene)


@pytest.mark.slow
def test_a_cycle_that_a_motion_only_passes_by(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two blocks on a belt (Galvanetto and Bishop 1994) come near an unstable cycle first, and end on another."""

    def curve(level: float) -> DryFriction:
        return DryFriction(level, level, kinetic=lambda w: level / (1 + 3 * w))

    scene = Scene(
        Body("a", inertia=1.0, position=0.2),
        Body("b", inertia=1.0, position=0.1),
        Drive("belt", velocity=0.3),
        Spring("a", GROUND, stiffness=1.0),
        Spring("b", GROUND, stiffness=1.0),
        Spring("a", "b", stiffness=1.2),
        Contact("ca", "a", "belt", curve(1.0), normal=1.0),
        Contact("cb", "b", "belt", curve(1.3), normal=1.0),
    )
    cycle = limit_cycle(scene)
    assert cycle.stable
    late = simulate(scene, (0.0, 600.0)).events
    sticks = [event.t for event in late if event.contact == "ca" and event.after == 0]
    assert cycle.period == pytest.approx(sticks[-1] - sticks[-3], rel=1e-6)
    # without more transients it is the unstable one
    monkeypatch.setattr(search, "_AWAY", 0)
    passed = limit_cycle(scene)
    assert passed.period == pytest.approx(9.2046, rel=1e-4)
    assert abs(passed.multipliers[0]) > 1.4


@pytest.mark.slow
def test_a_longer_transient_leads_nearer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where Newton's method fails from a transient, the search goes on after a longer one."""
    tried: list[search.Shot] = []

    def closed(shot: search.Shot) -> Cycle:
        tried.append(shot)
        if len(tried) < 3:
            raise CycleError("too far away")
        return newton.closed(shot)

    monkeypatch.setattr(search, "closed", closed)
    assert limit_cycle(belt()).period == pytest.approx(BELT_PERIOD, abs=1e-12)
    assert len(tried) == 3
    tried = tried[:1]
    scene, period = den_hartog()
    assert abs(limit_cycle(scene, period=period).multipliers[0]) == pytest.approx(0.49815078400816, abs=1e-8)
    assert len(tried) == 3


@pytest.mark.slow
def test_early_events_do_not_tell_of_a_motion_that_dies_away() -> None:
    """Two blocks stick a few times and then slide for good, and a damper lets that decay."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.2),
        Body("b", inertia=1.21, velocity=0.2),
        Drive("belt", velocity=0.2),
        Spring("a", GROUND, stiffness=1.71),
        Spring("a", "b", stiffness=1.81),
        Spring("b", GROUND, stiffness=1.24, damping=0.2),
        Contact("ca", "a", "belt", DryFriction(1.0, 0.5, dwell=0.5), normal=1.0),
        Contact("cb", "b", "belt", DryFriction(1.0, 0.5, dwell=0.5), normal=1.3),
    )
    with pytest.raises(CycleError, match=r"does not change|has died away"):
        limit_cycle(scene)


@pytest.mark.parametrize("after", [False, True])
def test_a_start_on_an_impact(after: bool) -> None:
    """A ball that hits a wall with 1 m/s, e = 0.8, and regains it by x'' = 0.1 x' - x - F: from before or after it.

    The flight from -e back to x = 0 with 1 m/s gives F and the period.
    """
    e, growth, w = 0.8, 0.05, math.sqrt(1 - 0.05**2)

    def flown(t: float, force: float) -> tuple[float, float]:
        # about x = -F: from F and the velocity -e
        b = (-e - growth * force) / w
        place = math.exp(growth * t) * (force * math.cos(w * t) + b * math.sin(w * t))
        turned = math.exp(growth * t) * w * (b * math.cos(w * t) - force * math.sin(w * t))
        return place - force, growth * place + turned

    period, force = fsolve(lambda u: np.array(flown(*u)) - [0.0, 1.0], [3.6, 0.3], xtol=1e-12)
    scene = Scene(
        Body("m", inertia=1.0, velocity=-e if after else 1.0),
        Spring("m", GROUND, stiffness=1.0),
        Force("m", 0.1 * velocity("m") - float(force)),
        Stop("wall", "m", GROUND, upper=0.0, restitution=e),
    )
    cycle = limit_cycle(scene, transient=0, guess=3.5)
    assert cycle.period == pytest.approx(period, abs=1e-9)
    # the flow multiplies areas by exp(0.1 T), an impact by e^2; the other multiplier is 1
    assert cycle.multipliers == pytest.approx([e * e * math.exp(0.1 * period)], abs=1e-8)


def test_what_has_no_cycle() -> None:
    rests = Scene(
        Body("m", inertia=1.0, position=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", GROUND, DryFriction(0.1, 0.1), normal=1.0),
    )
    with pytest.raises(CycleError, match="does not change"):
        limit_cycle(rests)
    with pytest.raises(CycleError, match="does not change"):
        limit_cycle(Scene(Body("m", inertia=1.0, position=1.0), Spring("m", GROUND, stiffness=1.0, damping=0.5)))


@pytest.mark.parametrize("speed", [1e-4, 1e-6])
def test_a_period_much_longer_than_a_turn(speed: float) -> None:
    """The block slips for 2 s in 5000 s, or in 500 000 s."""
    cycle = limit_cycle(belt(speed))
    slip = (2 * math.pi - 2 * math.atan(0.5 / (speed * math.sqrt(2.0)))) / math.sqrt(2.0)
    assert cycle.period == pytest.approx(0.5 / speed + slip, rel=1e-13)
    assert list(cycle.multipliers) == [0.0]


def test_what_is_left_of_a_motion_that_shrinks() -> None:
    # swings decay as exp(-0.04 t): within a quarter of the 20 periods to exp(-0.04 * 5 periods)
    scene = Scene(
        Body("block", inertia=1.0, position=1.0),
        Spring("block", GROUND, stiffness=1.0, damping=0.08),
    )
    period = 2 * math.pi / math.sqrt(1 - 0.04**2)
    assert search.left_of(simulate(scene, (0.0, 20 * period))) == pytest.approx(math.exp(-0.04 * 5 * period), rel=1e-5)


def test_a_load_in_resonance_has_no_cycle() -> None:
    scene = Scene(
        Body("m", inertia=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Force("m", sine(1.0, 1 / (2 * math.pi))),
    )
    with pytest.raises(CycleError, match="resonance"):
        limit_cycle(scene, period=2 * math.pi, transient=0)


@pytest.mark.slow
def test_a_curve_at_rest_bends_no_derivative() -> None:
    """m = k = 1 on a belt; mu = 0.5 + 0.5 exp(-(w / 0.5)^2). Differences of the period by DOP853, located events."""
    scene = Scene(
        Body("m", inertia=1.0, velocity=0.3),
        Drive("b", velocity=0.3),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", "b", DryFriction(1.0, 0.5, stribeck_velocity=0.5), normal=1.0),
    )
    cycle = limit_cycle(scene)
    assert cycle.period == pytest.approx(8.800997321321, abs=1e-9)
    assert cycle.sensitivities(["b.velocity"])[0] == pytest.approx(-8.70680483, abs=1e-7)


def test_a_motion_of_two_periods_is_said_to_be_one() -> None:
    """A load that repeats after 1 s, on an oscillator without damping whose own period is 2 s."""
    scene = Scene(
        Body("m", inertia=1.0, position=1.0),
        Spring("m", GROUND, stiffness=math.pi**2),
        Force("m", sine(1.0, 1.0)),
    )
    with pytest.raises(CycleError, match="only after 2 periods"):
        limit_cycle(scene, period=1.0)


@pytest.mark.slow
def test_a_cycle_that_only_gaps_hold_together() -> None:
    """A body with play swings by itself; nothing but the gap reads its position."""
    scene = Scene(
        Body("m", inertia=1.0, position=0.5),
        Gap("g", "m", GROUND, lower=-0.2, upper=0.2, stiffness=10.0),
        Force("m", saturate(velocity("m"), -0.3, 0.3) - 0.2 * velocity("m")),
    )
    cycle = limit_cycle(scene)
    touches = [event.t for event in simulate(scene, (0.0, 200.0)).events if event.after == 1]
    assert cycle.period == pytest.approx(touches[-1] - touches[-2], abs=1e-9)
    assert cycle.stable and cycle.multipliers.size == 1
    sides = [limit_cycle(scene.replace("g", stiffness=10.0 + h)).period for h in (-1e-3, 1e-3)]
    assert cycle.sensitivities(["g.stiffness"]) == pytest.approx([(sides[1] - sides[0]) / 2e-3], abs=1e-8)


def test_a_wrong_guess_of_the_period() -> None:
    """A guess of two periods finds one; a guess of half a period is refused, and the message gives the period."""
    assert limit_cycle(belt(), guess=15.2).period == pytest.approx(BELT_PERIOD, abs=1e-12)
    with pytest.raises(CycleError, match=r"comes back after 7\.61126 s; give guess=7\.61126"):
        limit_cycle(belt(), guess=3.8)


def test_small_loads_have_a_period_too() -> None:
    """1e-13 N move a mass of 1e-12 kg, whose damper leaves exp(-c T / (2 m)) of deviations after a period of 10 s."""
    scene = Scene(
        Body("m", inertia=1e-12),
        Spring("m", GROUND, stiffness=1e-12, damping=2e-13),
        Force("m", sine(1e-13, 0.1)),
    )
    with pytest.raises(ValueError, match="the loads do not repeat with the period 7 s"):
        limit_cycle(scene, period=7.0)
    assert np.abs(limit_cycle(scene, period=10.0).multipliers) == pytest.approx([math.exp(-1.0)] * 2, abs=1e-12)


def test_a_short_pulse_that_comes_once_is_no_load_of_a_period() -> None:
    once = sine(1.0, 1.0) + piecewise_linear([0.501, 0.5015, 0.502], [0.0, 300.0, 0.0])
    scene = Scene(Body("m", inertia=1.0), Spring("m", GROUND, stiffness=1.0, damping=0.3), Force("m", once))
    with pytest.raises(ValueError, match="the loads do not repeat with the period 1 s"):
        limit_cycle(scene, period=1.0)


def test_bad_arguments_are_refused() -> None:
    scene, period = den_hartog()
    with pytest.raises(ValueError, match="give their period"):
        limit_cycle(scene)
    with pytest.raises(ValueError, match="do not repeat"):
        limit_cycle(scene, period=0.9 * period)
    with pytest.raises(ValueError, match="not both"):
        limit_cycle(scene, period=period, guess=1.0)
    with pytest.raises(ValueError, match="period must be a positive time"):
        limit_cycle(scene, period=-1.0)
    with pytest.raises(ValueError, match="transient must be"):
        limit_cycle(scene, period=period, transient=-1.0)
    brush = LuGre(DryFriction(1.5, 1.0), 1e4, 10.0, 0.0)
    with pytest.raises(ValueError, match="laws with bristles"):
        limit_cycle(belt().with_laws(lambda law: brush))
    with pytest.raises(ValueError, match="give a guess"):
        limit_cycle(belt(), transient=0)
    with pytest.raises(TypeError, match="must be a Scene"):
        limit_cycle("belt")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="has name, velocity"):
        limit_cycle(belt()).sensitivities(["belt.speed"])


def belt_with_a_push(push: Signal) -> Scene:
    return Scene(
        Body("block", inertia=1.0, velocity=0.1),
        Drive("belt", velocity=0.1),
        Spring("block", GROUND, stiffness=2.0),
        Contact("rub", "block", "belt", DryFriction(1.5, 1.0), normal=1.0),
        StateSpace("lag", -1.0, 1.0, 0.5, inputs=[push]),
        Force("block", output("lag")),
    )


@pytest.mark.parametrize("push", [step(5.0), piecewise_linear([3.0, 50.0], [0.0, 1.0])])
def test_a_load_that_changes_late_is_no_constant_one(push: Signal) -> None:
    """A cycle starts at t = 0 again: the load would change in each period."""
    with pytest.raises(ValueError, match="of loads that become constant give the last values"):
        limit_cycle(belt_with_a_push(push))


def test_points_between_which_nothing_changes_are_a_constant_load() -> None:
    """The push only moves the block: the period is that without it."""
    cycle = limit_cycle(belt_with_a_push(piecewise_linear([0.5, 50.0], [1.0, 1.0])))
    assert abs(cycle.period - BELT_PERIOD) < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize(("second", "metre"), [(1.0, 1.0), (1e-3, 1e-3), (1e3, 1.0)])
def test_units_do_not_matter_where_only_a_block_holds_a_body(second: float, metre: float) -> None:
    """A slide hunts whose position only states of its controller read: the first transient is as long as its turns."""
    error, force = metre - position("slide"), metre / second**2
    controller = StateSpace(
        "controller",
        [[0.0, 0.0], [0.0, -50.0 / second]],
        [[1.0], [50.0 / second]],
        [[4.0 / second**3, 3.0 / second**2]],
        inputs=[error],
    )
    scene = Scene(
        Body("slide", inertia=1.0),
        Contact("guide", "slide", GROUND, DryFriction(1.5, 1.0), normal=force),
        Damper("slide", GROUND, damping=6.0 / second),
        controller,
        Force("slide", output("controller")),
    )
    # a pair of roots of s^3 + 6 s^2 + 3 s + 4 and a lag
    assert search.longest_turn(compiled(scene)) == pytest.approx(7.36 * second, rel=0.01)
    found = limit_cycle(scene)
    assert found.period == pytest.approx(HUNTING_PERIOD * second, rel=1e-10)
    assert len(found.sequence) == 4


def test_hunting_of_a_sticking_valve() -> None:
    """A valve stem with stiction in the level control of a tank: jumps of 0.36 m/s, then micrometres a second.

    Half a period is the time from breakaway to breakaway late in a run by DOP853 (rtol 1e-12) with located events.
    """
    mass, area, stiffness, damping, static, coulomb = 1.36, 0.0645, 52538.0, 612.0, 1708.0, 1423.0
    rest = 0.02 * stiffness / area  # Pa
    scene = Scene(
        Body("stem", inertia=mass, position=0.02),
        StateSpace("level", 0.0, [[-1.5, 2.5]], 1.0, inputs=[position("stem"), 0.014], states=[1.0]),
        StateSpace("pi", 0.0, 1.0, 1.2e3, 4e4, inputs=[output("level") - 1.0]),
        StateSpace("diaphragm", -2.0, 2.0, 1.0, inputs=[output("pi") + rest], states=[rest]),
        Force("stem", area * output("diaphragm")),
        Spring("stem", GROUND, stiffness=stiffness, damping=damping),
        Contact("packing", "stem", GROUND, DryFriction(1.0, coulomb / static), normal=static),
    )
    cycle = limit_cycle(scene, transient=2000.0)
    assert cycle.stable and abs(cycle.period - VALVE_PERIOD) < 1e-4


def test_damped_belt_is_another_cycle() -> None:
    scene = Scene(*belt().elements, Damper("m", GROUND, damping=0.05))
    cycle = limit_cycle(scene)
    result = simulate(scene, (0.0, 60.0))
    stuck = [event.t for event in result.events if event.after == 0]
    assert stuck[-1] - stuck[-2] == pytest.approx(cycle.period, abs=1e-12)
    assert abs(cycle.period - limit_cycle(belt()).period) > 1e-3


# Blocks that read the time, stops that stay closed, and searches without success


@pytest.mark.slow
@pytest.mark.parametrize("period", [None, 5.0])
def test_a_block_that_reads_the_time_is_refused(period: float | None) -> None:
    scene = Scene(
        Body("m", inertia=1.0, position=1.0),
        Spring("m", GROUND, stiffness=3.0, damping=0.2),
        Block("b", inputs=[position("m")], states=[0.0], derivative=lambda t, x, u: [math.cos(t) - x[0]]),
        Force("m", output("b")),
    )
    with pytest.raises(ValueError, match=r"block 'b': its derivative does not .* it reads the time"):
        limit_cycle(scene, period=period)
    cycle = limit_cycle(scene, period=2 * math.pi)
    assert cycle.stable and cycle.closes < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [0.01, 0.1, 0.3])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_ball_that_rests_on_a_table_moves_with_it(amplitude: float, restitution: float) -> None:
    """The table shakes with less than g, so the ball stays on it: deviations vanish, and the multipliers are 0."""
    scene = Scene(
        Body("ball", inertia=0.1, position=0.1),
        Drive("table", velocity=sine(amplitude, 2.0)),
        Stop("s", "ball", "table", lower=0.0, restitution=restitution),
        Force("ball", -0.981),
    )
    cycle = limit_cycle(scene, period=0.5)
    np.testing.assert_allclose(cycle.multipliers, [0.0, 0.0], atol=1e-9)
    assert cycle.sequence == ()


def test_a_dog_clutch_that_stays_closed() -> None:
    """Both bodies move as one against the damper: the multiplier is ``exp(-c T / (m_a + m_b))``."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=1.7, velocity=1.0),
        Stop("g", "a", "b", upper=0.0, restitution=0.5),
        Force("a", sine(1.0, 0.5, offset=3.0)),
        Damper("b", GROUND, damping=0.3),
    )
    found = limit_cycle(scene, period=2.0).multipliers
    np.testing.assert_allclose(found, [math.exp(-0.3 * 2 / 2.7), 0.0, 0.0], atol=1e-9)


@pytest.mark.slow
def test_a_search_in_chaos_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """The Lorenz equations pull a body. The search tries longer and longer transients, up to a limit of steps."""
    monkeypatch.setattr(search, "_MOST_STEPS", 10_000)
    block = Block(
        "l",
        inputs=[position("m")],
        states=[1.0, 1.0, 1.0],
        derivative=lambda t, x, u: [
            10 * (x[1] - x[0]),
            x[0] * (28 - x[2]) - x[1],
            x[0] * x[1] - 8 / 3 * x[2],
        ],
    )
    pulled = Body("m", inertia=1.0, position=0.5), Spring("m", GROUND, stiffness=1.0, damping=0.3)
    with pytest.raises(CycleError, match=r"within 75.3982 s the motion does not come back to where it was"):
        limit_cycle(Scene(*pulled, block, Force("m", output("l"))))


@pytest.mark.slow
def test_what_has_died_away_is_said_to_have() -> None:
    scene = Scene(
        Body("block", inertia=1.0, velocity=0.1),
        Drive("belt", velocity=5.0),
        Spring("block", GROUND, stiffness=2.0, damping=0.05),
        Contact("rub", "block", "belt", DryFriction(1.5, 1.0), normal=1.0),
    )
    with pytest.raises(CycleError, match=r"the motion has died away by .* it seems to come to a steady state"):
        limit_cycle(scene)


@pytest.mark.slow
def test_what_comes_back_once_by_chance_has_no_period_for_that() -> None:
    """A chaotic block on a belt under a sine (Popp and Stelter 1990): it is once near where it was 7 periods ago.

    Roundoff decides whether Newton's method comes from there to the one smooth orbit, which never sticks: its amplitude
    is 0.5 / (1.41^2 - 1), and without damping its multipliers have the size 1.
    """
    period = 2 * math.pi / 1.41
    scene = Scene(
        Body("block", inertia=1.0),
        Drive("belt", velocity=1.0),
        Spring("block", GROUND, stiffness=1.0),
        Contact("rub", "block", "belt", DryFriction(0.4, 0.25), normal=10.0),
        Force("block", sine(0.5, 1 / period)),
    )
    try:
        cycle = limit_cycle(scene, period=period)
    except CycleError as failure:
        assert "repeats only after" not in str(failure)
    else:
        assert cycle.period == period
        assert not cycle.stable
        assert np.abs(cycle.multipliers) == pytest.approx(1.0, abs=1e-9)
        assert cycle.amplitude("block") == pytest.approx(0.5 / (1.41**2 - 1), rel=1e-9)


@pytest.mark.parametrize("second", [0.0, 5.0])
def test_a_tie_is_no_position_of_its_own(second: float) -> None:
    """Geared shafts on springs are one oscillator ``2 x'' + 0.4 x' + k x``; multipliers have the size ``exp(-0.1)``."""
    springs = [Spring("n", GROUND, stiffness=second)] if second else []
    scene = Scene(
        Body("m", inertia=1.0),
        Body("n", inertia=1.0),
        Gear("g", "m", "n", ratio=1.0),
        Force("m", sine(1.0, 1.0)),
        Spring("m", GROUND, stiffness=20.0, damping=0.4),
        *springs,
    )
    found = limit_cycle(scene, period=1.0)
    assert found.stable and np.abs(found.multipliers) == pytest.approx(np.full(2, math.exp(-0.1)), rel=1e-8)


def test_a_geared_stick_slip_oscillator_is_that_of_one_body() -> None:
    """The same inertia and stiffness on one shaft or on two: the same period, and sticking forgets all deviations."""

    def stick_slip(*shafts: Any, inertia: float, stiffness: float) -> Scene:
        return Scene(
            Body("m", inertia=inertia, velocity=0.1),
            Drive("belt", velocity=0.1),
            Contact("c", "m", "belt", DryFriction(1.5, 1.0), normal=1.0),
            Spring("m", GROUND, stiffness=stiffness),
            *shafts,
        )

    shafts = (
        Body("n", inertia=1.0, velocity=0.1),
        Gear("g", "m", "n", ratio=1.0),
        Spring("n", GROUND, stiffness=0.5),
    )
    one = limit_cycle(stick_slip(inertia=2.0, stiffness=2.0))
    two = limit_cycle(stick_slip(*shafts, inertia=1.0, stiffness=1.5))
    assert two.period == pytest.approx(one.period, rel=1e-10)
    assert two.stable and not one.multipliers.any() and not two.multipliers.any()


@pytest.mark.slow
@pytest.mark.parametrize("anchor", ["table", GROUND])
def test_where_a_drive_is_does_not_deviate(anchor: str) -> None:
    """Hits on a table that swings: two multipliers, those of the body, whether or not a spring reads the table's place.

    Their product is ``exp(-c T / m)`` by damping, times ``e^2`` for each impact.
    """
    scene = Scene(
        Body("a", inertia=6.0, position=-0.1),
        Spring("a", anchor, stiffness=6.0, damping=0.3),
        Drive("table", velocity=sine(0.4, 0.4)),
        Stop("wall", "a", "table", upper=0.0, restitution=0.8),
    )
    found = limit_cycle(scene, period=7.5)
    hits = len(found.result.events)
    assert hits and found.stable and found.multipliers.size == 2
    wanted = math.exp(-0.3 * 7.5 / 6.0) * 0.8 ** (2 * hits)
    assert np.prod(found.multipliers).real == pytest.approx(wanted, rel=1e-7)


def beside_a_stronger_one() -> Scene:
    """Two contacts hold one motion; the weaker one is at its level, which rises as it rests."""
    return Scene(
        Body("m", inertia=1.0, velocity=0.1),
        Body("n", inertia=0.3),
        Spring("m", GROUND, stiffness=2.0),
        Spring("n", "m", stiffness=3.0, damping=0.1),
        Drive("belt", velocity=0.1),
        Contact("strong", "m", "belt", DryFriction(1.5, 1.0), normal=1.0),
        Contact("rub", "m", "belt", DryFriction(1.0, 0.2, dwell=2.0), normal=0.2),
    )


def beside_a_closed_stop() -> Scene:
    return Scene(
        Body("m", inertia=1.0),
        Body("n", inertia=1.0),
        Spring("m", GROUND, stiffness=4.0),
        Spring("n", "m", stiffness=3.0, damping=0.5),
        Stop("wall", "m", GROUND, upper=0.1),
        Contact("rub", "m", GROUND, DryFriction(1.2, 0.4, dwell=3.0), normal=1.0),
        Force("m", sine(4.0, 1 / 4.0, 0.0, 2.0)),
    )


def creeping() -> Scene:
    """Below its pre-slip velocity a contact creeps, at a level that rises meanwhile."""
    return Scene(
        Body("m", inertia=1.0, velocity=0.1),
        Drive("belt", velocity=0.1),
        Spring("m", GROUND, stiffness=2.0, damping=0.1),
        Contact("rub", "m", "belt", PreSlip(DryFriction(1.5, 1.0, dwell=1.0), velocity=0.02), normal=1.0),
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "options", "until"),
    [
        (beside_a_stronger_one(), {}, 400.0),
        (beside_a_closed_stop(), {"period": 4.0, "transient": 40.0}, 400.0),
        (creeping(), {"transient": 60.0}, 200.0),
    ],
)
def test_a_level_that_rises_at_rest_closes_whatever_holds_the_contact(
    scene: Scene, options: dict[str, Any], until: float
) -> None:
    """A long run comes to the same cycle; from the start of the cycle the second period is the first."""
    cycle = limit_cycle(scene, **options)
    run = simulate(scene, (0.0, until))
    rests = [event.t for event in run.events if event.contact == "rub" and event.after == 0]
    assert cycle.period == pytest.approx(rests[-1] - rests[-2], rel=1e-7)
    again = simulate(cycle.scene, (0.0, 2 * cycle.period))
    first, second = np.array([event.t for event in again.events]).reshape(2, -1)
    np.testing.assert_allclose(second - first, cycle.period, rtol=1e-7)


def test_a_body_at_rest_where_the_cycle_begins_has_its_own_multipliers() -> None:
    """Body b swings apart from a: ``exp((-c/2m +- i sqrt(k/m - (c/2m)^2)) T)``; body a sticks at the start."""
    m, k, c = 1.293, 1.855, 0.288
    scene = Scene(
        Body("a", inertia=1.3, velocity=0.1),
        Drive("belt", velocity=0.1),
        Spring("a", GROUND, stiffness=1.05, damping=0.03),
        Contact("rub", "a", "belt", DryFriction(1.5, 1.0, dwell=1.6), normal=1.0),
        Body("b", inertia=m, velocity=0.1),
        Spring("b", GROUND, stiffness=k, damping=c),
    )
    cycle = limit_cycle(scene)
    decay = 0.5 * c / m
    own = np.exp((-decay + 1j * math.sqrt(k / m - decay**2)) * cycle.period)
    np.testing.assert_allclose(cycle.multipliers[:2].real, own.real, rtol=1e-6)
    np.testing.assert_allclose(np.sort(cycle.multipliers[:2].imag), np.sort([own.imag, -own.imag]), rtol=1e-6)
