"""Branches of limit cycles: closed forms along them, and where they change and end."""

from __future__ import annotations

import math
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from stickslip import (
    GROUND,
    Body,
    Contact,
    Cycle,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gear,
    Scene,
    Spring,
    Stop,
    continue_cycle,
    limit_cycle,
    sine,
    velocity,
)
from stickslip.model.arrays import Array
from stickslip.studies.cycles import shooting
from stickslip.studies.cycles.continuation import Follower
from stickslip.studies.cycles.cycle import centred
from stickslip.studies.cycles.newton import closed_from
from stickslip.studies.cycles.shooting import Shot
from stickslip.studies.parameters import named_parameters

STIFFNESS, STATIC, COULOMB = 2.0, 1.5, 1.0


def belt(v: float = 0.1, damping: float = 0.0) -> Scene:
    return Scene(
        Body("m", inertia=1.0, velocity=v),
        Drive("belt", velocity=v),
        Spring("m", GROUND, stiffness=STIFFNESS, damping=damping),
        Contact("c", "m", "belt", DryFriction(STATIC, COULOMB), normal=1.0),
    )


def forced(friction: float, frequency: float) -> Scene:
    return Scene(
        Body("m", inertia=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", GROUND, DryFriction(friction, friction), normal=1.0),
        Force("m", sine(1.0, frequency)),
    )


@pytest.mark.slow
def test_periods_of_stick_slip_over_the_speed_of_the_belt() -> None:
    """2 (F_s - F_c) / (k v) + (2 pi - 2 atan((F_s - F_c) / (v sqrt(k m)))) sqrt(m / k)."""
    v = np.array([0.1, 0.2, 0.4, 0.8])
    branch = continue_cycle(belt(), "belt.velocity", v)
    fall, w = STATIC - COULOMB, math.sqrt(STIFFNESS)
    exact = 2 * fall / (STIFFNESS * v) + (2 * math.pi - 2 * np.arctan(fall / (v * w))) / w
    assert np.allclose(branch.periods, exact, atol=1e-12)
    assert branch.stable.all() and not branch.multipliers.any() and branch.points == ()
    assert np.allclose(branch.amplitudes("m"), np.hypot(fall / STIFFNESS, v / w), atol=1e-8)
    assert "belt.velocity" in str(branch)


@pytest.mark.slow
def test_a_long_way_along_a_stribeck_curve_takes_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """The block breaks away at ``k x + c v = mu_s N``, slips until it is as fast as the belt, and is carried back."""
    shots = []
    simulated = shooting.simulated
    monkeypatch.setattr(shooting, "simulated", lambda *args, **options: shots.append(1) or simulated(*args, **options))

    def stribeck(v: float) -> Scene:
        return Scene(
            Body("m", inertia=2.0, velocity=v),
            Drive("belt", velocity=v),
            Spring("m", GROUND, stiffness=200.0, damping=0.5),
            Contact("c", "m", "belt", DryFriction(0.4, 0.25, stribeck_velocity=0.1), normal=20.0),
        )

    def period(v: float) -> float:
        def rate(t: float, y: Array) -> list[float]:
            friction = 20.0 * (0.25 + 0.15 * math.exp(-((10.0 * (v - y[1])) ** 2)))
            return [y[1], (friction - 200.0 * y[0] - 0.5 * y[1]) / 2.0]

        def caught(t: float, y: Array) -> float:
            return y[1] - v if t > 0.1 else -1.0

        caught.terminal = True  # type: ignore[attr-defined]
        away = (0.4 * 20.0 - 0.5 * v) / 200.0
        slip = solve_ivp(rate, (0.0, 5.0), [away, v * (1 - 1e-13)], "DOP853", events=caught, rtol=1e-12, atol=1e-14)
        return float(slip.t[-1] + (away - slip.y[0, -1]) / v)

    branch = continue_cycle(stribeck(0.02), "belt.velocity", [0.02, 0.06])
    assert branch.periods == pytest.approx([period(0.02), period(0.06)], abs=1e-7)
    # the cycle is begun anew in the middle of a motion; sticking still forgets deviations
    assert not branch.multipliers.any() and branch.points == ()
    assert len(shots) <= 30
    cycle = branch.cycles[1]
    assert cycle is not None and centred(cycle) is cycle


def gap(v: float, damping: float) -> float:
    """Return the largest velocity of the block after it broke away, less that of the belt."""
    matrix = np.array([[0.0, 1.0], [-STIFFNESS, -damping]])
    start = np.array([(STATIC - damping * v - COULOMB) / STIFFNESS, v])
    w = math.sqrt(STIFFNESS - damping**2 / 4)
    found = minimize_scalar(
        lambda t: -(expm(matrix * t) @ start)[1],
        bounds=(math.pi / w, 2 * math.pi / w),
        method="bounded",
        options={"xatol": 1e-12},
    )
    return float(-found.fun - v)


@pytest.mark.slow
def test_a_damper_ends_stick_slip_where_the_block_does_not_catch_up_any_more() -> None:
    branch = continue_cycle(belt(damping=0.1), "belt.velocity", [0.1, 0.3, 0.6, 1.0])
    assert [one is None for one in branch.cycles] == [False, False, True, True]
    (end,) = branch.points
    assert end.kind == "end" and "graze 0 at 'c: BACKWARD -> STUCK'" in end.message
    assert end.value == pytest.approx(brentq(gap, 0.2, 1.0, args=(0.1,)), abs=1e-6)
    assert np.isnan(branch.periods[2:]).all() and not branch.stable[2:].any()


def test_a_bar_shows_how_far_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    continue_cycle(belt(0.0), "belt.velocity", [0.1, 0.2, 0.3], progress=True)
    assert "2/2" in capsys.readouterr().err


@pytest.mark.slow
def test_without_a_damper_stick_slip_ends_in_a_family() -> None:
    """At F_s = F_c it meets a cycle that only touches the belt's speed, of a family of neutral cycles that all slip."""
    branch = continue_cycle(belt(0.2), "c.law.mu_static", [1.1, COULOMB])
    (end,) = branch.points
    assert end.kind == "end" and "family of cycles" in end.message and branch.beyond is None
    assert end.value == pytest.approx(COULOMB, abs=1e-6)
    assert end.cycle is not None
    assert end.cycle.period == pytest.approx(2 * math.pi / math.sqrt(STIFFNESS), abs=1e-6)


@pytest.mark.slow
def test_as_the_belt_stops_the_period_grows_without_bound() -> None:
    """The period grows like 2 (F_s - F_c) / (k v), see above."""
    branch = continue_cycle(belt(0.2), "belt.velocity", [0.2, 0.0], accuracy=1e-4)
    (end,) = branch.points
    assert end.kind == "end" and end.message == "the period grows without bound"
    assert end.value == pytest.approx(0.0, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["impacts", "sticking"])
def test_events_pass_the_start_of_a_forced_cycle(kind: str) -> None:
    """Over the phase of its load the cycle stays the same, begun later: its events come earlier by phase / (2 pi) T."""
    scene, period = (hit(0.05, low=False).scene, 2 * math.pi / 1.5)
    if kind == "sticking":
        scene, period = forced(0.5, 0.05), 20.0
    phases = np.linspace(0.0, 2 * math.pi, 5)
    branch = continue_cycle(scene, "forces[0].signal.phase", phases, period=period)
    assert branch.points == ()
    first = branch.cycles[0]
    assert first is not None
    again = np.concatenate([[e.t for e in first.result.events], [e.t + period for e in first.result.events]])
    for phase, cycle in zip(phases, branch.cycles, strict=True):
        assert cycle is not None and cycle.result.t[0] == 0 and cycle.closes < 1e-10
        assert cycle.multipliers == pytest.approx(first.multipliers, abs=1e-9)
        later = phase / (2 * math.pi) * period
        own = [e.t for e in cycle.result.events]
        assert np.abs(np.array(own)[:, None] + later - again).min(axis=1) == pytest.approx(0.0, abs=1e-9)
        at = np.array([0.3, 0.7]) * period
        same = first.result.sample(np.sort((at + later) % period)).position("m")
        assert np.sort(cycle.result.sample(at).position("m")) == pytest.approx(np.sort(same), abs=1e-9)


@pytest.mark.slow
def test_the_frequency_at_which_a_forced_oscillator_begins_to_stick() -> None:
    """There, at the turn of the mass, the spring and the load together push with exactly the friction."""
    branch = continue_cycle(forced(0.5, 0.12), "forces[0].signal.frequency", [0.12, 0.1, 0.09], period=lambda f: 1 / f)
    (point,) = branch.points
    assert point.kind == "sequence" and "'c'" in point.message
    last, first = branch.cycles[1], branch.cycles[2]
    assert last is not None and first is not None and not last.sticks and first.sticks
    cycle = limit_cycle(forced(0.5, point.value * 1.00001), period=1 / (point.value * 1.00001))
    t = np.array([event.t for event in cycle.result.events])
    push = np.sin(2 * math.pi * point.value * t) - cycle.result.sample(t).position("m")
    assert not cycle.sticks and np.abs(push) == pytest.approx(0.5, abs=1e-4)


def test_a_pair_of_multipliers_passes_the_unit_circle_where_no_damping_is_left() -> None:
    """x'' + (c - 0.1) x' + 4 x = sin(pi t): moduli exp(-(c - 0.1) T / 2) with T = 2."""
    scene = Scene(
        Body("m", inertia=1.0),
        Spring("m", GROUND, stiffness=4.0, damping=0.3),
        Force("m", sine(1.0, 0.5) + 0.1 * velocity("m")),
    )
    c = np.array([0.3, 0.2, 0.05])
    branch = continue_cycle(scene, "springs[0].damping", c, period=2.0, accuracy=1e-8)
    assert np.allclose(np.abs(branch.multipliers), np.exp(0.1 - c)[:, None], atol=1e-12)
    assert branch.stable.tolist() == [True, True, False]
    (point,) = branch.points
    assert point.kind == "torus" and point.value == pytest.approx(0.1, abs=1e-8)


def hit(force: float, low: bool) -> Cycle:
    """x'' + x = F sin(1.5 t), a stop at 0.2, e = 0.8: the cycles with one impact a period, in closed form.

    From the impact on ``x = B (k cos t + sin t) + X sin(w t + phase)``, with k = cot(T / 2); it hits with V = q B. B is
    a root of ``(k^2 + m^2) B^2 - 2 s k B + s^2 - X^2``, m = (1 + e q) / w: a fold where |X| = s m / sqrt(k^2 + m^2).
    """
    w, e, s = 1.5, 0.8, 0.2
    period = 2 * math.pi / w
    k = 1 / math.tan(0.5 * period)
    q = (-k * math.sin(period) + math.cos(period) - 1) / (1 + e)
    x, m = force / (1 - w * w), (1 + e * q) / w
    roots = np.sort(np.roots([k * k + m * m, -2 * s * k, s * s - x * x]).real)
    b = roots[1 if low else 0]
    phase = math.atan2((s - k * b) / x, -b * m / x) % (2 * math.pi)
    t = period - phase / w
    place = b * (k * math.cos(t) + math.sin(t)) + x * math.sin(w * t + phase)
    speed = b * (math.cos(t) - k * math.sin(t)) + x * w * math.cos(w * t + phase)
    scene = Scene(
        Body("m", inertia=1.0, position=place, velocity=speed),
        Spring("m", GROUND, stiffness=1.0),
        Stop("wall", "m", GROUND, upper=s, restitution=e),
        Force("m", sine(force, w / (2 * math.pi))),
    )
    cycle = limit_cycle(scene, period=period, transient=0)
    (event,) = cycle.result.events
    assert cycle.result.sample([event.t]).velocity("m")[0] == pytest.approx(-e * q * b, abs=1e-10)
    return cycle


@pytest.mark.slow
def test_a_branch_turns_at_a_fold() -> None:
    """At F = 0.0318142381487888 both cycles of the impact oscillator meet; from there the unstable ones go back."""
    branch = continue_cycle(hit(0.05, low=False), "forces[0].signal.amplitude", [0.05, 0.02])
    (fold,) = branch.points
    assert fold.kind == "fold" and fold.value == pytest.approx(0.0318142381487888, abs=1e-14)
    assert fold.cycle is not None and fold.cycle.multipliers[0] == pytest.approx(1.0, abs=1e-6)
    assert branch.cycles[1] is None and branch.beyond is not None
    (back,) = branch.beyond.cycles
    assert back is not None and not back.stable and branch.beyond.values.tolist() == [0.05]
    other = hit(0.05, low=True)
    assert back.multipliers == pytest.approx(other.multipliers, abs=1e-9)
    lines = branch.plot("m").lines
    assert [list(line.get_xdata()) for line in lines[:2]] == [[0.05, fold.value], [fold.value, 0.05]]
    assert "beyond the fold" in str(branch)
    plt.close("all")


@pytest.mark.slow
def test_a_period_doubles_at_a_flip() -> None:
    """The impact oscillator with its stop at 0: a multiplier is -1 at w = 2.65334772785524, by the trace of its map."""
    scene = Scene(
        Body("m", inertia=1.0, position=-0.1),
        Spring("m", GROUND, stiffness=1.0),
        Stop("wall", "m", GROUND, upper=0.0, restitution=0.8),
        Force("m", sine(1.0, 2.6 / (2 * math.pi))),
    )
    at = np.array([2.64, 2.67]) / (2 * math.pi)
    branch = continue_cycle(scene, "forces[0].signal.frequency", at, period=lambda f: 1 / f, accuracy=1e-8)
    (flip,) = branch.points
    assert flip.kind == "flip" and 2 * math.pi * flip.value == pytest.approx(2.65334772785524, abs=1e-9)
    assert branch.stable.tolist() == [True, False] and branch.cycles[1] is not None
    doubled = limit_cycle(branch.cycles[1].scene.replace("m", position=-0.1), period=2 / at[1])
    assert doubled.stable and len(doubled.sequence) == 2


@pytest.mark.parametrize("values", [[-0.5, 3.0], [-0.5, 0.5, 1.5]])
def test_a_pair_leaves_the_unit_circle_at_negative_damping(values: list[float]) -> None:
    """``x'' - c x' + x = sin(2 pi t)``: multipliers exp((c +- sqrt(c^2 - 4)) / 2), of size 1 at c = 0, real from 2."""
    (point,) = continue_cycle(pushed(), PUSH, values, period=1.0, transient=0).points
    assert point.kind == "torus" and abs(point.value) < 1e-6


def test_a_pair_outside_the_unit_circle_that_becomes_real_passes_nothing() -> None:
    """The multipliers as above become real at c = 2: both are outside the unit circle before and after."""
    branch = continue_cycle(pushed(), PUSH, [1.5, 1.9, 2.5], period=1.0, transient=0)
    assert branch.points == () and np.abs(branch.multipliers[2]) == pytest.approx([math.e**2, math.exp(0.5)], rel=1e-9)


PUSH = "forces[1].signal.terms[0][1]"


def pushed() -> Scene:
    return Scene(
        Body("m", inertia=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Force("m", sine(1.0, 1.0)),
        Force("m", 0.5 * velocity("m")),
    )


@pytest.mark.slow
def test_unstable_cycles_shrink_to_the_sliding_that_loses_its_stability() -> None:
    """They end where ``N mu'(v) = -c``: no fold, and the cycle that sticks at 0.2 m/s is on another branch."""
    static, coulomb, slow, normal, damping = 0.4, 0.25, 0.1, 20.0, 0.5
    hopf = brentq(
        lambda v: damping - normal * (static - coulomb) * 2 * v / slow**2 * math.exp(-((v / slow) ** 2)), 0.1, 0.5
    )
    scene = Scene(
        Body("m", inertia=2.0, position=0.05218517643413383),
        Drive("belt", velocity=0.4),
        Spring("m", GROUND, stiffness=200.0, damping=damping),
        Contact("c", "m", "belt", DryFriction(static, coulomb, stribeck_velocity=slow), normal=normal),
    )
    branch = continue_cycle(limit_cycle(scene, guess=0.6286375467, transient=0), "belt.velocity", [0.4, 0.2])
    (end,) = branch.points
    assert end.kind == "end" and "Hopf" in end.message and end.value == pytest.approx(hopf, abs=2e-7)
    assert branch.cycles[-1] is None and branch.beyond is None


@pytest.mark.slow
def test_a_symmetry_breaks_where_half_a_turn_mirrored_has_the_eigenvalue_minus_1() -> None:
    """Between two stops at 0.1, zeta = 0.02 and e = 0.8: at w = 3.741103955, by the impact map in closed form."""
    scene = Scene(
        Body("m", inertia=1.0),
        Spring("m", GROUND, stiffness=1.0, damping=0.04),
        Stop("s", "m", GROUND, lower=-0.1, upper=0.1, restitution=0.8),
        Force("m", sine(1.0, 2 / math.pi)),
    )
    at = np.array([4.0, 3.0]) / (2 * math.pi)
    branch = continue_cycle(scene, "forces[0].signal.frequency", at, period=lambda f: 1 / f)
    (point,) = branch.points
    # cycles without the symmetry branch off there: the point is a crossing
    assert point.kind == "crossing" and 2 * math.pi * point.value == pytest.approx(3.741103955, abs=1e-6)
    assert branch.cycles[1] is not None and branch.cycles[1].multipliers[0] == pytest.approx(4.342293, abs=1e-6)


@pytest.mark.slow
def test_points_beside_a_change_of_the_sequence_are_found() -> None:
    """An oscillator of den Hartog that stops below w = 2.6 and one at a stop, of another period at 2.65334772785524.

    A drive shakes both; they do not touch each other.
    """
    stiffness = (2.6 / (2 * math.pi * 0.0852681066)) ** 2
    scene = Scene(
        Drive("shaker", velocity=sine(1.0, 2.4 / (2 * math.pi))),
        Body("a", inertia=1.0),
        Spring("a", GROUND, stiffness=stiffness),
        Contact("floor", "a", GROUND, DryFriction(0.4, 0.4), normal=1.0),
        Force("a", velocity("shaker")),
        Body("b", inertia=1.0, position=-0.1),
        Spring("b", GROUND, stiffness=1.0),
        Stop("wall", "b", GROUND, upper=0.0, restitution=0.8),
        Force("b", velocity("shaker")),
    )
    at = np.array([2.4, 2.9]) / (2 * math.pi)
    branch = continue_cycle(scene, "shaker.velocity.frequency", at, period=lambda f: 1 / f, accuracy=1e-4)
    assert [point.kind for point in branch.points] == ["sequence", "flip"]
    assert 2 * math.pi * np.array([point.value for point in branch.points]) == pytest.approx(
        [2.6, 2.65334772785524], abs=1e-4
    )


@pytest.mark.slow
def test_no_step_leads_from_stick_slip_to_a_family_of_cycles() -> None:
    """The wheel sticks in each cycle; the period is the closed form above with mass and stiffness at the rim.

    Near by lies a family of cycles that just miss the speed of the belt.
    """
    v, ratio, radii = 0.1, 3.0, np.array([0.25, 0.2, 0.1])
    scene = Scene(
        Body("motor", inertia=0.01, velocity=ratio * v / 0.25),
        Body("wheel", inertia=0.04, velocity=v / 0.25),
        Drive("belt", velocity=v),
        Gear("gear", "motor", "wheel", ratio=ratio),
        Spring("motor", GROUND, stiffness=0.5),
        Contact("rub", "wheel", "belt", DryFriction(STATIC, COULOMB), normal=1.0, radius_a=0.25),
    )
    mass, stiffness, fall = 0.13 / radii**2, 4.5 / radii**2, STATIC - COULOMB
    slides = (2 * math.pi - 2 * np.arctan(fall / (v * np.sqrt(stiffness * mass)))) * np.sqrt(mass / stiffness)
    branch = continue_cycle(scene, "rub.radius_a", radii)
    assert np.allclose(branch.periods, 2 * fall / (stiffness * v) + slides, atol=1e-9) and branch.points == ()


@pytest.mark.parametrize("name", ["c.normal", "c.normal.scale"])
def test_a_scale_is_the_factor_of_the_load_that_the_scene_has(name: str) -> None:
    """It is the factor of the given scene's load, not of that at the value before. Of 1 N it is the force in N."""
    values = np.array([1.0, 1.2, 1.5])
    fall, w = (STATIC - COULOMB) * values, math.sqrt(STIFFNESS)
    exact = 2 * fall / (STIFFNESS * 0.1) + (2 * math.pi - 2 * np.arctan(fall / (0.1 * w))) / w
    assert np.allclose(continue_cycle(belt(), name, values).periods, exact, atol=1e-10)


@pytest.mark.parametrize("is_forced", [False, True])
def test_the_next_cycle_is_foretold_to_second_order(is_forced: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The prediction uses derivatives at the cycle itself, whatever the parameter was where the branch began."""
    begun, value = (forced(0.5, 0.2), 0.12) if is_forced else (belt(0.1), 0.4)
    name = "forces[0].signal.frequency" if is_forced else "belt.velocity"
    (one,) = named_parameters(begun, [name], "test")
    cycle = limit_cycle(one.set(begun, value), period=1 / value if is_forced else None)
    missed, moved = [], Shot.moved

    def noted(self: Shot, *change: Any) -> Shot:
        missed.append(moved(self, *change))
        return missed[-1]

    monkeypatch.setattr(Shot, "moved", noted)
    first = []
    for change in (2e-3, 1e-3):
        longer = 1 / (value + change) - 1 / value if is_forced else None
        missed.clear()
        closed_from(cycle, one, value, value + change, longer)
        first.append(missed[0].error)
    assert 0 < first[1] < 0.3 * first[0]


def test_a_cycle_is_a_start_too() -> None:
    cycle = limit_cycle(belt())
    branch = continue_cycle(cycle, "springs[0].stiffness", [2.0, 1.9])
    assert isinstance(branch.cycles[1], Cycle)
    again = limit_cycle(branch.cycles[1].scene)
    assert again.period == pytest.approx(branch.periods[1], abs=1e-12)


@pytest.mark.slow
def test_a_first_step_of_nothing_grows() -> None:
    # beyond a fold the first step is a part of the way that may be 0 by roundoff
    (one,) = named_parameters(belt(), ["belt.velocity"], "continue_cycle")
    follower = Follower(one, None, 1e-6)
    branch = follower.follow(limit_cycle(belt()), np.array([0.1, 0.11]), first_step=0.0)
    assert branch.cycles[1] is not None
    assert branch.cycles[1].period == pytest.approx(limit_cycle(belt(0.11)).period, abs=1e-9)


@pytest.mark.slow
def test_the_bifurcation_diagram() -> None:
    branch = continue_cycle(belt(), "belt.velocity", [0.1, 0.2])
    ax = branch.plot("m")
    assert ax.get_xlabel() == "belt.velocity [m/s | rad/s]" and ax.get_ylabel() == "amplitude of m [m | rad]"
    assert np.allclose(ax.lines[0].get_ydata(), branch.amplitudes("m"))
    assert "period" in branch.plot().get_ylabel()
    assert branch.plot(GROUND).get_ylabel() == "amplitude of ground [m | rad]"
    plt.close("all")


@pytest.mark.slow
def test_one_unstable_cycle_between_stable_ones_is_joined_to_them() -> None:
    """Shaw's oscillator (1986): its symmetric cycle is unstable for a while; no text covers that curve."""
    scene = Scene(
        Body("m", inertia=1.0, position=0.3),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", GROUND, DryFriction(0.6, 0.4), normal=1.0),
        Force("m", sine(1.0, 0.0875)),
    )
    values = [0.0875, 0.0955, 0.1035]
    branch = continue_cycle(scene, "forces[0].signal.frequency", values, period=lambda frequency: 1 / frequency)
    assert list(branch.stable) == [True, False, True]
    ax = branch.plot("m")
    dashed = next(line for line in ax.lines if line.get_linestyle() == "--")
    # where the stability changes, the diagram has the cycles there
    x, crossings = dashed.get_xdata(), [point.value for point in branch.points]
    assert x.tolist() == pytest.approx([values[0], crossings[0], values[1], crossings[1], values[2]])
    assert np.isfinite(dashed.get_ydata()[1:4]).all() and list(dashed.get_markevery()) == [2]
    for point in branch.points:
        assert point.cycle is not None
        exact = limit_cycle(point.cycle.scene, period=point.cycle.period, transient=0.0).amplitude("m")
        assert dashed.get_ydata()[x.tolist().index(point.value)] == pytest.approx(exact, rel=1e-6)
    ax.figure.draw(FigureCanvasAgg(ax.figure).get_renderer())
    boxes = [text.get_window_extent() for text in ax.texts]
    assert len(boxes) == 2 and not boxes[0].overlaps(boxes[1])
    for k, box in enumerate(boxes):
        ends = ax.transData.transform(np.column_stack([x, np.fmax(ax.lines[0].get_ydata(), dashed.get_ydata())]))
        between = np.interp(np.linspace(box.x0, box.x1, 9), *ends.T)
        assert ((between < box.y0) | (between > box.y1)).all(), k
    plt.close("all")


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match=r"values must be finite, got \[0.1, inf\]"):
        continue_cycle(belt(), "belt.velocity", [0.1, math.inf])
    with pytest.raises(ValueError, match="rise or fall"):
        continue_cycle(belt(), "belt.velocity", [0.1, 0.3, 0.2])
    with pytest.raises(ValueError, match="where a motion starts"):
        continue_cycle(belt(), "m.velocity", [0.1, 0.3])
    with pytest.raises(TypeError, match="Scene or a Cycle"):
        continue_cycle(1.0, "m.velocity", [0.1, 0.3])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"mu_static' cannot be 0.9 .*leave that value out"):
        continue_cycle(belt(), "c.law.mu_static", [1.5, 0.9])
    with pytest.raises(ValueError, match="has name, velocity"):
        continue_cycle(belt(), "belt.speed", [0.1, 0.3])


def test_options_and_periods_that_are_none_are_refused() -> None:
    scene = Scene(
        Body("block", inertia=1.0, velocity=0.1),
        Drive("belt", velocity=0.3),
        Spring("block", GROUND, stiffness=2.0, damping=0.05),
        Contact("rub", "block", "belt", DryFriction(1.5, 1.0), normal=1.0),
    )
    values = [0.3, 0.2]
    with pytest.raises(TypeError, match="there is no option 'rtoll'; known are guess, transient"):
        continue_cycle(scene, "belt.velocity", values, rtoll=1e-3)
    with pytest.raises(TypeError, match="transient= would find a first cycle, but one was given"):
        continue_cycle(limit_cycle(scene), "belt.velocity", values, transient=0.0)
    for wrong in (lambda value: None, lambda value: "a"):
        with pytest.raises(TypeError, match=r"continue_cycle: period\(0.3\) must be a number"):
            continue_cycle(scene, "belt.velocity", values, period=wrong)
    with pytest.raises(TypeError, match="continue_cycle: period must take a value of the parameter"):
        continue_cycle(scene, "belt.velocity", values, period=lambda value, other: 1.0)


@pytest.mark.slow
def test_a_cycle_of_two_periods_ends_where_both_halves_become_equal() -> None:
    """A bouncing oscillator: cycles of two periods of the load meet those of one at a flip, at 2.65334772785524 rad/s.

    There the cycle of one period has the multiplier -1 (docs/branches.md).
    """
    speeds = np.array([2.70, 2.66, 2.64, 2.60])
    scene = Scene(
        Body("mass", inertia=1.0, position=-0.1),
        Spring("mass", GROUND, stiffness=1.0),
        Stop("wall", "mass", GROUND, upper=0.0, restitution=0.8),
        Force("mass", sine(1.0, speeds[0] / (2 * math.pi))),
    )
    branch = continue_cycle(scene, "forces[0].signal.frequency", speeds / (2 * math.pi), period=lambda f: 2 / f)
    (point,) = branch.points
    assert point.kind == "end" and "a shorter one that is run through several times" in point.message
    assert 2 * math.pi * point.value == pytest.approx(2.65334772785524, rel=1e-5)
    assert [cycle is None for cycle in branch.cycles] == [False, False, True, True]


@pytest.mark.parametrize("amplitudes", [[1.0, 0.7, 0.3], [1.0, 0.8, 0.6, 0.4]], ids=str)
def test_an_oscillator_that_a_weak_load_does_not_move(amplitudes: list[float]) -> None:
    """At rest the load has to pass the level, 0.5 N: below it there is no cycle (den Hartog's oscillator).

    There a step of the branch may end with a contact that is stuck throughout, whose cycle has fewer coordinates.
    """
    frequency = 0.8 / (2 * math.pi)
    scene = Scene(
        Body("m", inertia=1.0),
        Spring("m", GROUND, stiffness=1.0),
        Contact("c", "m", GROUND, DryFriction(0.5, 0.5), normal=1.0),
        Force("m", sine(amplitudes[0], frequency)),
    )
    branch = continue_cycle(scene, "forces[0].signal.amplitude", amplitudes, period=1 / frequency)
    assert [cycle is None for cycle in branch.cycles] == [False] * (len(amplitudes) - 1) + [True]
    changes, end = branch.points
    assert (changes.kind, end.kind) == ("sequence", "end")
    assert end.value == pytest.approx(0.5, abs=5e-3) and end.value > 0.5
    assert "shrink to a state of rest" in end.message


@pytest.mark.slow
def test_beyond_a_fold_a_long_step_does_not_jump_to_turns_of_another_cycle() -> None:
    """Between 3 and 2 rad/s of a drill string: small steps end the branch beyond the fold at 2.24711 rad/s, too."""
    speed = 3.0
    scene = Scene(
        Body("mid", inertia=930.0, velocity=speed),
        Body("bit", inertia=375.0),
        Drive("table", velocity=speed),
        Spring("table", "mid", stiffness=460.0, damping=10.0),
        Spring("mid", "bit", stiffness=300.0, damping=8.0),
        Damper("bit", GROUND, damping=5.0),
        Contact("rock", "bit", GROUND, DryFriction(2500.0, 1000.0), normal=1.0),
        motion="rotation",
    )
    branch = continue_cycle(scene, "table.velocity", [3.0, 2.0])
    assert branch.points[-1].kind == "fold"
    assert branch.points[-1].value == pytest.approx(2.17797578, rel=1e-6)
    assert branch.beyond is not None
    (point,) = branch.beyond.points
    assert point.kind == "end"
    assert point.value == pytest.approx(2.24711, rel=1e-5)
    assert branch.beyond.cycles == (None,)
