"""Pre-slip, dead bands and bristles beside exact sticking: convergence, stiffness, memory, Jacobians, refusals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from reading import told
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from stickslip import (
    GROUND,
    Body,
    Contact,
    Dahl,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    Karnopp,
    LuGre,
    OneWay,
    PreSlip,
    Scene,
    SimulationError,
    Spring,
    Stop,
    feedback,
    normal,
    piecewise_linear,
    position,
    relative_velocity,
    saturate,
    simulate,
    sine,
    step,
    table,
)
from stickslip.benchmark import BENCHMARK_SPAN, EXACT_EVENTS, flywheel_benchmark, four_flywheels
from stickslip.equations import system
from stickslip.model.laws.dry_friction import Law
from stickslip.simulation.result import Result

STORY = [(e.contact, e.before, e.after) for e in EXACT_EVENTS]
TIGHT: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-13}
TIMES = np.linspace(0.0, 1.0, 501)
DRY = DryFriction(0.4, 0.35)


def block(law: Law, *more: Any, velocity: float = 0.0, normal: Any = 10.0) -> Scene:
    return Scene(Body("a", inertia=1.0, velocity=velocity), Contact("c", "a", GROUND, law, normal=normal), *more)


# Piecewise linear pre-slip


@pytest.fixture(scope="module")
def exact() -> Result:
    return simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=TIMES)


def test_the_papers_benchmark(exact: Result) -> None:
    """At 0.001 rad/s: five mode changes, and "virtually identical results"."""
    result = simulate(flywheel_benchmark().regularized(velocity=1e-3), BENCHMARK_SPAN, **TIGHT)
    assert told(result) == STORY
    for event, true in zip(result.events, EXACT_EVENTS, strict=True):
        assert event.t == pytest.approx(true.t, abs=2e-4)
    assert np.abs(result(TIMES) - exact.y).max() < 1e-3
    stats = result.stats
    assert stats["states"] == 2 and stats["guards"] == 3
    assert stats["restarts"] == 5 + 6
    assert stats["steps"] < 3000 and stats["jacobian_calls"] < 150


def test_first_order_in_the_pre_slip_velocity(exact: Result) -> None:
    """The error is about 0.97 v_pre at its worst, in the velocity of a wheel that should stand still."""
    velocities, errors = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6], []
    for velocity in velocities:
        result = simulate(flywheel_benchmark().regularized(velocity=velocity), (0.0, 1.0), t_eval=TIMES, **TIGHT)
        assert told(result) == STORY
        errors.append(float(np.abs(result.y - exact.y).max()))
    np.testing.assert_allclose(np.array(errors) / velocities, 0.95, atol=0.06)
    order = np.polyfit(np.log(velocities), np.log(errors), 1)[0]
    assert order == pytest.approx(1.0, abs=0.01)


def test_no_tolerance_lowers_the_floor_that_the_pre_slip_velocity_sets(exact: Result) -> None:
    errors = []
    for rtol in (1e-6, 1e-8, 1e-10, 1e-12):
        scene = flywheel_benchmark().regularized(velocity=1e-3)
        result = simulate(scene, (0.0, 1.0), t_eval=TIMES, rtol=rtol, atol=1e-3 * rtol)
        errors.append(float(np.abs(result.y - exact.y).max()))
    np.testing.assert_allclose(errors, errors[-1], rtol=0.05)
    assert 0.9e-3 < errors[-1] < 1e-3


def test_the_least_pre_slip_velocity_that_is_advised_is_enough() -> None:
    def scene(velocity: float) -> Scene:
        contact = Contact("c", "a", GROUND, PreSlip(DryFriction(0.4, 0.2), velocity), normal=10.0)
        return Scene(Body("a", inertia=1.0), contact, Force("a", sine(6.0, 1.0)))

    with pytest.raises(ValueError, match="too small beside velocities of 6 ") as refused:
        simulate(scene(1e-9), (0.0, 1.0))
    advised = float(str(refused.value).split("make it at least ")[1].split(",")[0])
    assert simulate(scene(advised), (0.0, 1.0)).status == 0


@pytest.mark.parametrize("velocity", [1e-6, 1e-7, 1e-8])
def test_the_smallest_velocities_are_limited_by_the_tolerance(exact: Result, velocity: float) -> None:
    """At the default tolerances the error stays near 5e-6 below a velocity of 1e-6, and the cost does not grow."""
    result = simulate(flywheel_benchmark().regularized(velocity=velocity), (0.0, 1.0), t_eval=TIMES)
    assert told(result) == STORY
    assert np.abs(result.y - exact.y).max() < 1e-5
    assert result.stats["steps"] < 600


def test_stiffness_is_inverse_to_the_pre_slip_velocity() -> None:
    """In pre-slip the fastest eigenvalue is ``-mu_s N (1/m1 + 1/m2) / v_pre``; exact sticking has none."""
    for velocity in (1e-2, 1e-4, 1e-6):
        result = simulate(flywheel_benchmark().regularized(velocity=velocity), (0.0, 0.04))
        motion = result.trajectory.motion(-1)
        # dwell: mu_st = 0.2 - 0.1 exp(-t / 0.1) at local time 40
        fastest = np.linalg.eigvals(motion.jacobian(40.0, motion.y)).real.min()
        assert fastest == pytest.approx(-0.2 * 100 * 1.1 / velocity, rel=1e-9)
    hard = simulate(flywheel_benchmark(), (0.0, 0.04)).trajectory.motion(-1)
    assert np.all(np.asarray(hard.jacobian(0.0, hard.y)) == 0)


def test_building_up_in_closed_form() -> None:
    """A constant load F < B in pre-slip: ``v = F v_pre / B (1 - exp(-B t / (m v_pre)))``, below v_pre for ever."""
    result = simulate(block(PreSlip(DryFriction(0.5, 0.3), 0.2), Force("a", 4.0)), (0.0, 1.0), **TIGHT)
    assert not result.events and np.all(result.mode("c") == 0)
    np.testing.assert_allclose(result.velocity("a"), 4 * 0.2 / 5 * -np.expm1(-5 * result.t / 0.2), atol=1e-10)
    np.testing.assert_allclose(result.force("c"), 5.0 * result.velocity("a") / 0.2, rtol=1e-12)


def test_frictional_memory() -> None:
    """Force peaks at 5 N on breaking away only. Slowing down it is 2 N, the Coulomb level, until 0.1 v_pre."""
    load = piecewise_linear([0.0, 6.0, 6.0, 20.0], [0.0, 6.0, 0.0, 0.0])
    result = simulate(block(PreSlip(DryFriction(0.5, 0.2), 0.1), Force("a", load)), (0.0, 20.0), **TIGHT)
    assert told(result) == [("c", 0, 1), ("c", 1, 0)]
    (off, back), v, r = result.events, result.velocity("a"), result.force("c")
    at_off, at_back = (np.flatnonzero(result.t == e.t)[[0, -1]] for e in (off, back))
    assert v[at_off[0]] == pytest.approx(0.1, abs=1e-9) and v[at_back[0]] == pytest.approx(0.01, abs=1e-9)
    np.testing.assert_allclose(r[at_off], [5.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(r[at_back], [2.0, 0.5], atol=1e-6)
    between = (result.mode("c") == 1) & (v < 0.1)
    assert between.any() and np.allclose(r[between], 2.0)
    # m v' = -2 from v = v1 at 6 s down to 0.01
    assert back.t == pytest.approx(6.0 + (result(6.0)[0] - 0.01) / 2.0, abs=1e-7)


def test_dwell_works_in_pre_slip() -> None:
    """The peak at breakaway is ``N (mu_s - (mu_s - mu_c) exp(-t/tau))``, as it is for exact sticking."""
    law, load = DryFriction(0.5, 0.2, dwell=0.2), piecewise_linear([0.0, 1.0], [0.0, 20.0])
    soft = simulate(block(PreSlip(law, 1e-5), Force("a", load)), (0.0, 0.5), **TIGHT)
    hard = simulate(block(law, Force("a", load)), (0.0, 0.5))
    assert told(soft) == told(hard) == [("c", 0, 1)]
    assert soft.events[0].t == pytest.approx(hard.events[0].t, abs=1e-4)
    peak = soft.force("c")[soft.t <= soft.events[0].t].max()
    assert peak == pytest.approx(10 * (0.5 - 0.3 * math.exp(-soft.events[0].t / 0.2)), rel=1e-4)
    again = PreSlip(DryFriction(0.5, 0.2), 1e-5)
    assert simulate(block(again, Force("a", load)), (0.0, 0.5)).events[0].t > soft.events[0].t + 0.01


def test_anisotropic_pre_slip() -> None:
    law = PreSlip(DryFriction(0.4, 0.3, mu_static_backward=0.6, mu_coulomb_backward=0.1), 1e-4)
    for sign, static, coulomb in ((1, 4.0, 3.0), (-1, 6.0, 1.0)):
        load = piecewise_linear([0.0, 8.0], [0.0, 8.0 * sign])
        result = simulate(block(law, Force("a", load)), (0.0, 8.0))
        assert told(result) == [("c", 0, sign)]
        assert result.events[0].t == pytest.approx(static, abs=1e-3)
        assert result.force("c")[-1] == pytest.approx(sign * coulomb)


# Smooth shapes


@pytest.mark.parametrize(("shape", "order"), [("tanh", 1.0), ("arctan", 2 / 3)])
def test_smooth_shapes_converge_to_friction_without_a_peak(shape: Any, order: float) -> None:
    """arctan converges more slowly: its force lacks about v_pre / w of the Coulomb level when the load is near it."""
    flat = DryFriction(0.1, 0.1)
    hard = simulate(flywheel_benchmark(flat), (0.0, 1.0), t_eval=TIMES)
    velocities, errors = [1e-3, 1e-4, 1e-5], []
    for velocity in velocities:
        scene = flywheel_benchmark(DryFriction(0.2, 0.1)).regularized(velocity=velocity, shape=shape)
        result = simulate(scene, (0.0, 1.0), t_eval=TIMES)
        assert result.stats["guards"] == 0 and not result.events
        errors.append(float(np.abs(result.y - hard.y).max()))
    assert np.polyfit(np.log(velocities), np.log(errors), 1)[0] == pytest.approx(order, abs=0.1)
    assert errors[-1] < 1e-3


def test_tanh_sliding_to_rest_in_closed_form() -> None:
    """``m v' = -F tanh(v / v_pre)``: ``sinh(v / v_pre) = sinh(v0 / v_pre) exp(-F t / (m v_pre))``."""
    law = PreSlip(DryFriction(0.5, 0.2), 0.1, "tanh")
    result = simulate(block(law, velocity=1.0), (0.0, 1.0), **TIGHT)
    expected = 0.1 * np.arcsinh(math.sinh(10.0) * np.exp(-2.0 * result.t / 0.1))
    np.testing.assert_allclose(result.velocity("a"), expected, atol=1e-9)


def test_arctan_reaches_its_level_slowly() -> None:
    """At w = 1000 v_pre tanh has reached its level; arctan lacks ``4 / (pi^2 1000)`` of it."""
    for shape, lack in (("tanh", 0.0), ("arctan", 4 / (math.pi**2 * 1e3))):
        result = simulate(block(PreSlip(DryFriction(0.5, 0.2), 1e-3, shape), velocity=1.0), (0.0, 1e-6))
        assert result.force("c")[0] == pytest.approx(2.0 * (1 - lack), rel=1e-6)


# Mixed scenes and Jacobians


def mixed(n: int) -> Scene:
    """Every law in one chain, with springs, dampers, a drive and a load."""
    curve = DryFriction(0.5, 0.3, 0.2, 0.1, mu_static_backward=0.6, mu_coulomb_backward=0.2)
    laws = [
        PreSlip(curve, 0.05),
        PreSlip(curve, 0.05, "tanh"),
        PreSlip(curve, 0.05, "arctan"),
        LuGre(curve, 100.0, 3.0, 0.4),
        Dahl(curve, 50.0),
        curve,
        DryFriction(0.5, 0.4, kinetic=lambda speed: 0.5 / (1 + speed)),
        DryFriction(0.4, 0.3),
    ]
    bodies = [Body(f"b{i}", inertia=1 + 0.1 * (i % 5), velocity=math.sin(3.0 * i)) for i in range(n)]
    contacts = [Contact(f"c{i}", f"b{i}", f"b{i + 1}", laws[i % 8], normal=5.0 + i % 3) for i in range(n - 1)]
    others = [
        Spring("b0", "b3", stiffness=3.0, damping=0.2),
        Damper("b1", GROUND, damping=0.3),
        Drive("d", velocity=sine(0.5, 0.5)),
        Contact("driven", "b2", "d", laws[3], normal=3.0),
        Contact("fed", "b4", "d", laws[3], normal=3.0 + 0.4 * position("b0") - 0.2 * position("b3")),
        Contact("ground", "b0", GROUND, laws[0], normal=sine(2.0, 1.0, offset=3.0)),
        Force("b4", sine(4.0, 0.7)),
    ]
    return Scene(*bodies, *contacts, *others)


@pytest.mark.parametrize(("n", "is_sparse"), [(9, False), (70, True)])
def test_jacobians_are_exact(monkeypatch: pytest.MonkeyPatch, n: int, is_sparse: bool) -> None:
    monkeypatch.setattr(system, "_DENSE_LIMIT", 0 if is_sparse else 3 * n)
    result = simulate(mixed(n), (0.0, 0.2 if n < 20 else 0.03), rtol=1e-5, atol=1e-8)
    pieces = result.trajectory.pieces
    for number in range(0, len(pieces), max(1, len(pieces) // 5)):
        motion, path = result.trajectory.motion(number), pieces[number].path
        assert path is not None
        tau = float(path.taus[-1]) / 2
        y = motion.exact(tau, path.last + 1e-3 * np.sin(np.arange(path.last.size)))
        exact: Any = motion.jacobian(tau, y)
        assert isinstance(exact, np.ndarray) is not is_sparse
        exact = exact.toarray() if is_sparse else exact
        numeric = np.empty_like(exact)
        for i in range(y.size):
            h = 1e-7 * max(abs(y[i]), 1e-4)
            ahead, back = y.copy(), y.copy()
            ahead[i], back[i] = y[i] + h, y[i] - h
            change = motion.rate(tau, motion.exact(tau, ahead)) - motion.rate(tau, motion.exact(tau, back))
            numeric[:, i] = change / (ahead[i] - back[i])
        # dependent velocities follow the independent ones: the Jacobian is compared for independent ones only
        free = np.setdiff1d(np.arange(y.size), motion.equations.dependent)
        assert free.size < y.size or not (motion.equations.modes[motion.system.hard] == 0).any()
        exact, numeric = exact[:, free], numeric[:, free]
        np.testing.assert_allclose(exact, numeric, rtol=1e-5, atol=1e-6 * np.abs(numeric).max())


def test_hard_and_soft_contacts_in_one_scene() -> None:
    """The benchmark with one contact exact and the other in pre-slip keeps its story, to first order."""
    exact = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=TIMES)
    for soft in ("interface", "brake"):
        scene = flywheel_benchmark()
        law = next(c.law for c in scene.contacts if c.name == soft)
        assert isinstance(law, DryFriction)
        result = simulate(scene.replace(soft, law=PreSlip(law, 1e-4)), (0.0, 1.0), t_eval=TIMES, **TIGHT)
        assert told(result) == STORY
        assert np.abs(result.y - exact.y).max() < 1.2e-4
        hard = "brake" if soft == "interface" else "interface"
        stuck = result.mode(hard) == 0
        assert stuck.any() and np.all(result.relative_velocity(hard)[stuck & (result.normal(hard) > 0)] == 0)


@pytest.mark.slow
def test_all_laws_together_agree_with_fixed_steps() -> None:
    bdf = simulate(mixed(9), (0.0, 0.5), **TIGHT)
    rk4 = simulate(mixed(9), (0.0, 0.5), method="RK4", step=2e-4)
    assert told(bdf) == told(rk4) and len(bdf.events) == 3
    assert np.abs(bdf.y[:, -1] - rk4.y[:, -1]).max() < 1e-3


def test_four_flywheels_in_pre_slip() -> None:
    for viscous in (0.0, 5.0):
        hard = simulate(four_flywheels(viscous=viscous), (0.0, 2.0), t_eval=TIMES * 2)
        soft = simulate(four_flywheels(viscous=viscous).regularized(velocity=1e-5), (0.0, 2.0), t_eval=TIMES * 2)
        assert sorted(told(soft)) == sorted(told(hard))
        assert np.abs(soft.y - hard.y).max() < 1e-4


# Karnopp's dead band


def test_karnopp_sticks_at_its_band_and_breaks_away_at_its_level() -> None:
    """``v = 1 - t`` enters the band of 0.01 at 0.99 s; the load passes 2 N at 3 s."""
    law = Karnopp(DryFriction(0.2, 0.1), 0.01)
    load = piecewise_linear([2.0, 4.0], [0.0, 4.0])
    result = simulate(block(law, Force("a", load), velocity=1.0), (0.0, 4.0))
    assert told(result) == [("c", 1, 0), ("c", 0, 1)]
    assert [e.t for e in result.events] == pytest.approx([0.99, 3.0], abs=1e-12)
    stuck = result.mode("c") == 0
    assert np.all(result.velocity("a")[stuck] == 0)
    stepped = simulate(block(law, Force("a", load), velocity=1.0), (0.0, 4.0), method="RK4", step=1e-3)
    assert told(stepped) == told(result)
    assert [e.t for e in stepped.events] == pytest.approx([0.99, 3.0], abs=2.1e-3)


def test_karnopp_on_a_drive() -> None:
    """On a belt at 0.5 m/s: ``w = 1 - 0.5 - t`` enters the band at 0.49 s, and the block goes with the belt."""
    law = Karnopp(DryFriction(0.2, 0.1), 0.01)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Drive("belt", velocity=0.5),
        Contact("c", "a", "belt", law, normal=10.0),
    )
    result = simulate(scene, (0.0, 1.0))
    assert told(result) == [("c", 1, 0)]
    assert result.events[0].t == pytest.approx(0.49, abs=1e-12)
    assert result.velocity("a")[-1] == 0.5


def test_karnopp_errs_by_its_band() -> None:
    """The dead band stops the block too early by exactly the band's velocity over the deceleration of 1 m/s^2."""
    for band in (1e-1, 1e-2, 1e-3):
        result = simulate(block(Karnopp(DryFriction(0.2, 0.1), band), velocity=1.0), (0.0, 2.0))
        assert 1.0 - result.events[0].t == pytest.approx(band, rel=1e-9)
        assert result.position("a")[-1] == pytest.approx(0.5 - 0.5 * band**2, rel=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}])
def test_karnopp_is_led_through_its_band(options: dict[str, Any]) -> None:
    """A block goes with a belt at ``0.5 - t`` m/s: the ground rubs against it one way up to 0.5 s, then the other."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.5),
        Drive("belt", velocity=piecewise_linear([0.0, 1.0], [0.5, -0.5])),
        Contact("hold", "a", "belt", DryFriction(0.5, 0.5), normal=20.0),
        Contact("rub", "a", GROUND, Karnopp(DryFriction(0.2, 0.1), 0.01), normal=10.0),
    )
    result = simulate(scene, (0.0, 1.0), t_eval=np.linspace(0.0, 1.0, 1001), **options)
    assert told(result) == [("rub", 1, -1)]
    assert result.events[0].t == pytest.approx(0.5, abs=1e-12)
    assert result.power("rub").min() >= 0.0
    assert result.force("hold")[490:500] == pytest.approx(0.0)  # 1 N brakes it, and so does the ground
    assert result.force("hold")[-1] == pytest.approx(2.0)


def test_karnopp_takes_others_along_as_it_stops() -> None:
    """``v = 1 - 1.1 t`` enters the band of 0.01 at 0.9 s: then it stands, and the belt at 5 mm/s is faster."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Drive("belt", velocity=0.005),
        Contact("rub", "a", "belt", DryFriction(0.1, 0.1), normal=1.0),
        Contact("c", "a", GROUND, Karnopp(DryFriction(0.2, 0.1), 0.01), normal=10.0),
    )
    result = simulate(scene, (0.0, 1.0))
    assert sorted(told(result)) == [("c", 1, 0), ("rub", 1, -1)]
    assert [e.t for e in result.events] == pytest.approx([0.9, 0.9], abs=1e-12)
    assert result.force("c")[-1] == pytest.approx(0.1)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"method": "RK4", "step": 1e-3}])
@pytest.mark.parametrize(
    "elsewhere",
    [
        [],
        [
            Contact("c2", "z", GROUND, DryFriction(0.2, 0.1), normal=10.0),
            Force("z", piecewise_linear([0, 0.1], [0, 4])),
        ],
        [Drive("d", velocity=step(0.05)), Spring("d", "z", stiffness=1.0)],
        [Contact("c2", "z", GROUND, DryFriction(0.2, 0.1), normal=step(0.05))],
        [
            Body("w", inertia=1.0, velocity=0.15),
            Contact("c2", "w", GROUND, Karnopp(DryFriction(0.2, 0.1), 0.1), normal=10.0),
        ],
    ],
)
def test_karnopp_that_has_left_rest_moves_on_through_its_band(elsewhere: list[Any], options: dict[str, Any]) -> None:
    """A push of 2.01 N breaks the level of 2 N; 1.01 N are left to accelerate 1 kg, whatever happens elsewhere."""
    law = Karnopp(DryFriction(0.2, 0.1), 0.1)
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, law, normal=10.0),
        Force("a", 2.01),
        Body("z", inertia=1.0),
        *elsewhere,
    )
    result = simulate(scene, (0.0, 0.5), **options)
    assert result.velocity("a")[-1] == pytest.approx(0.505, rel=1e-9)
    first = simulate(scene, (0.0, 0.05), **options)
    second = simulate(first.final_scene(), (0.05, 0.5), **options)
    assert second.velocity("a")[-1] == pytest.approx(0.505, rel=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"method": "RK4", "step": 1e-3}])
@pytest.mark.parametrize("step_elsewhere", [False, True])
def test_karnopp_is_stuck_again_where_it_comes_back_into_its_band(
    step_elsewhere: bool, options: dict[str, Any]
) -> None:
    """Pushed by ``F = 3 sin(pi t / 4)`` it breaks loose at 2 N; ``v' = F - 1`` until v has fallen to 0.2 m/s."""
    turning = math.pi / 4
    loose = math.asin(2 / 3) / turning

    def speed(t: float) -> float:
        return 3.0 / turning * (math.cos(turning * loose) - math.cos(turning * t)) - (t - loose)

    back = brentq(lambda t: speed(t) - 0.2, 4.0, 8.0)
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, Karnopp(DryFriction(0.2, 0.1), 0.2), normal=10.0),
        Force("a", sine(3.0, 0.125)),
        *([Body("z", inertia=1.0), Force("z", step(1.0))] if step_elsewhere else []),
    )
    result = simulate(scene, (0.0, back + 0.01), **options)
    first, second = (event for event in result.events if event.contact == "c")
    assert (int(first.before), int(first.after)) == (0, 1) and int(second.before) == 1
    assert [first.t, second.t] == pytest.approx([loose, back], abs=1e-3 if "step" in options else 1e-7)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"formulation": "merged"}])
@pytest.mark.parametrize("start", [-0.02, 0.0])
def test_karnopp_lets_what_a_stop_throws_back_into_its_band_move_on(start: float, options: dict[str, Any]) -> None:
    """On a belt that carries it to a wall, a body bounces ever less, and rests at the wall."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.05, position=start),
        Drive("belt", velocity=0.05),
        Contact("c", "a", "belt", Karnopp(DryFriction(0.2, 0.1), 0.1), normal=10.0),
        Stop("wall", "a", GROUND, upper=0.0, restitution=0.5),
    )
    result = simulate(scene, (0.0, 2.0), **options)
    assert result.position("a").max() < 1e-12
    assert abs(result.velocity("a")[-1]) < 1e-12 and abs(result.position("a")[-1]) < 1e-9


@pytest.mark.parametrize(
    "options", [{}, {"method": "BDF"}, {"formulation": "multiplier"}, {"method": "RK4", "step": 1e-3}]
)
def test_karnopp_turns_no_clutch_forward(options: dict[str, Any]) -> None:
    """The belt of b1 turns round at 0.2 s: 2 m/s^2 brake b1 from 0.1 m/s to 0, where the clutch locks it to b0."""
    law = Karnopp(DryFriction(0.3, 0.2), 1.0)
    scene = Scene(
        Body("b0", inertia=1.0),
        Body("b1", inertia=1.0, velocity=0.1),
        Drive("belt", velocity=piecewise_linear([0.2, 0.2], [0.1, -0.1])),
        Contact("c0", "b0", GROUND, law, normal=20.0),
        Contact("c1", "b1", "belt", law, normal=10.0),
        OneWay("clutch", "b0", "b1"),
    )
    result = simulate(scene, (0.0, 1.0), **options)
    assert told(result) == [("c1", 0, 1), ("clutch", -1, 0)]
    late = 1e-3 if "step" in options else 1e-9
    assert [event.t for event in result.events] == pytest.approx([0.2, 0.25], abs=late)
    assert result.relative_velocity("clutch").max() < 1e-12
    simulate(result.final_scene(), (1.0, 1.1), **options)


def test_karnopp_refuses_two_moving_bodies() -> None:
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=1.0),
        Contact("c", "a", "b", Karnopp(DryFriction(0.2, 0.1)), normal=10.0),
    )
    with pytest.raises(ValueError, match=r"'c'.*both 'a' and 'b' can move, and momentum would not be conserved"):
        simulate(scene, (0.0, 1.0))


# Parameters


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: PreSlip(DryFriction(0.2, 0.1), 0.0), ValueError, "PreSlip: velocity must be positive"),
        (lambda: PreSlip(DryFriction(0.2, 0.1), math.nan), ValueError, "velocity"),
        (lambda: PreSlip(DryFriction(0.2, 0.1), shape="step"), ValueError, "unknown shape 'step'"),  # type: ignore
        (lambda: PreSlip(0.2), TypeError, "law must be DryFriction"),  # type: ignore
        (lambda: Karnopp(DryFriction(0.2, 0.1), -1.0), ValueError, "Karnopp: velocity must be positive"),
        (lambda: LuGre(DryFriction(0.2, 0.1), 0.0), ValueError, "LuGre: stiffness must be positive"),
        (lambda: LuGre(DryFriction(0.2, 0.1), 1.0, damping=-1.0), ValueError, "damping must be at least 0"),
        (lambda: Dahl(DryFriction(0.2, 0.1), -5.0), ValueError, "Dahl: stiffness must be positive"),
        (lambda: Dahl(DryFriction(0.2, 0.0), 5.0), ValueError, "Dahl: mu_coulomb must be positive"),
        (lambda: LuGre(DryFriction(0.0, 0.0), 5.0, viscous=1.0), ValueError, "a Damper for what is viscous"),
    ],
)
def test_parameters_are_checked(make: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make()


def test_scenes_with_these_laws_survive_as_data() -> None:
    dry = DryFriction(0.2, 0.1, dwell=0.1)
    for law in (PreSlip(dry, 1e-4, "arctan"), Karnopp(dry, 1e-2), LuGre(dry, 1e4, 1.0, 0.1), Dahl(dry, 1e3)):
        scene = block(law, velocity=1.0)
        again = Scene.from_dict(scene.to_dict())
        assert again.contacts[0].law == law
    regular = flywheel_benchmark().regularized(velocity=1e-4, shape="tanh")
    assert all(c.law == PreSlip(dry, 1e-4, "tanh") for c in regular.contacts)
    assert all(c.law == PreSlip(dry, 1e-5) for c in regular.regularized(velocity=1e-5).contacts)


@pytest.mark.parametrize("law", [PreSlip(DRY, 1e-3), PreSlip(DRY, 1e-3, "tanh"), Karnopp(DRY, 1e-3), DRY])
def test_a_reversal_without_normal_force_shows_its_direction(law: Law) -> None:
    # v = 1 - t - 0.35 (5 t - 5 t^2) until 0.5 s, then v = 0.0625 - (t - 0.5): it turns over at 0.5625 s and goes on
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("c", "m", GROUND, law, normal=piecewise_linear([0.0, 0.5, 1.5, 2.0], [5.0, 0.0, 0.0, 5.0])),
        Force("m", -1.0),
    )
    result = simulate(scene, (0.0, 1.4))
    (turn,) = result.events
    assert (turn.before, turn.after, turn.cause) == (1, -1, "open")
    assert turn.t == pytest.approx(0.5625, abs=1e-7)
    assert result.mode("c")[-1] == -1
    assert result.velocity("m")[-1] == pytest.approx(-0.8375, abs=1e-7)


@pytest.mark.parametrize("law", [PreSlip(DRY, 1e-3), PreSlip(DRY, 1e-3, "tanh")])
def test_a_gap_whose_damping_is_clipped_presses_a_regularised_contact(law: Law) -> None:
    # far above the pre-slip velocity friction is that of Coulomb: it takes mu times the impulse of the gap, and the
    # momentum that the pad gains is this impulse
    scene = Scene(
        Body("m", inertia=1.0, velocity=3.0),
        Body("pad", inertia=1.0, velocity=1.0),
        Gap("gap", "pad", GROUND, lower=1.0, stiffness=5.0, damping=0.5),
        Contact("c", "m", GROUND, law, normal=normal("gap")),
    )
    result = simulate(scene, (0.0, 2.0))
    lost, gained = 3.0 - result.velocity("m")[-1], result.velocity("pad")[-1] - 1.0
    assert lost == pytest.approx(0.35 * gained, abs=1e-7)


@pytest.mark.parametrize("law", [DRY, PreSlip(DRY, 1e-3), LuGre(DRY, 1e3, 10.0), Dahl(DRY, 1e3)])
@pytest.mark.parametrize("seed", range(8))
def test_a_normal_force_that_ends_at_the_border_of_a_table(law: Law, seed: int) -> None:
    # N = s (a - v t) up to a / v, then 0: the line of the table and the normal force end together but for roundoff
    a, v, s = np.random.default_rng(seed).uniform([0.3, 0.8, 5.0], [0.7, 1.2, 12.0])
    pressed = saturate(s * (a - position("clock")), 0.0, 9.0)
    scene = Scene(
        Body("m", inertia=1.0, velocity=3.0),
        Body("clock", inertia=1.0, velocity=v),
        Contact("c", "m", GROUND, law, normal=pressed),
        Force("m", -1.0),
    )
    result = simulate(scene, (0.0, 1.5))
    impulse = DRY.mu_coulomb * s * a**2 / (2 * v)
    # bristles have to bend first: until then their force is below mu N
    assert result.velocity("m")[-1] == pytest.approx(1.5 - impulse, abs=1e-9 if law is DRY else 5e-3)
    assert not result.events


@pytest.mark.parametrize("law", [LuGre(DRY, 1e3, 10.0), Dahl(DRY, 1e3)])
def test_bristles_that_the_motion_presses_from_nothing_are_refused(law: Law) -> None:
    # solvers follow them wrongly: they found half of the impulse of mu N from 1.5 s on, 0.35 * 1.25 = 0.4375 N s
    pressed = saturate(5.0 - 10.0 * position("clock"), 0.0, 9.0) + saturate(10.0 * position("clock") - 15.0, 0.0, 9.0)
    scene = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Body("clock", inertia=1.0, velocity=1.0),
        Contact("c", "m", GROUND, law, normal=pressed),
        Force("m", -1.0),
    )
    with pytest.raises(SimulationError, match="'c': its normal force rises from 0") as caught:
        simulate(scene, (0.0, 2.0))
    assert caught.value.result.t[-1] == pytest.approx(1.5)
    assert caught.value.result.velocity("m")[-1] == pytest.approx(-0.9375, abs=1e-2)


@pytest.mark.parametrize("law", [LuGre(DRY, 1e3, 10.0), Dahl(DRY, 1e3)])
@pytest.mark.parametrize("seed", [10, 11, 30, 70, 131, 151])
def test_bristles_that_a_table_presses_from_nothing_are_refused(law: Law, seed: int) -> None:
    """The normal force ends at a and rises from 2 a on: roundoff hides on which side of this corner the clock is."""
    a, v, s = np.random.default_rng(seed).uniform([0.3, 0.8, 5.0], [0.7, 1.2, 12.0])
    pressed = table(position("clock"), [0.0, a, 2 * a, 3 * a], [s, 0.0, 0.0, s])
    scene = Scene(
        Body("m", inertia=1.0, velocity=5.0),
        Body("clock", inertia=1.0, velocity=v),
        Contact("c", "m", GROUND, law, normal=pressed),
    )
    with pytest.raises(SimulationError, match="'c': its normal force rises from 0") as caught:
        simulate(scene, (0.0, 2.0))
    assert caught.value.result.t[-1] == pytest.approx(2 * a / v)


@pytest.mark.parametrize("options", [{"method": "BDF", "max_step": 0.1}, {"formulation": "multiplier"}])
def test_bristles_without_friction_do_nothing(options: dict[str, Any]) -> None:
    """One contact has normal force 0, the other coefficients 0; only the spring acts: ``v = cos(w t)``."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Spring("a", GROUND, stiffness=10.0),
        Contact("open", "a", GROUND, LuGre(DRY, 1e3, 10.0), normal=0.0),
        Contact("smooth", "a", GROUND, Dahl(DryFriction(0.0, 0.0), 1e3), normal=5.0),
    )
    result = simulate(scene, (0.0, 3.0), **options)
    assert result.velocity("a")[-1] == pytest.approx(math.cos(math.sqrt(10.0) * 3.0), abs=1e-7)


def test_what_bristles_pull_from_rest_touches_nothing() -> None:
    """Bristles bend over 22.5 mm at 131 m/s to 2.25 N; the contact that lets go at once holds 0.18 N at rest only.

    Its first velocities lie within the tolerances of CVODE; beside later ones they must not look like a fall to 0.
    """
    scene = Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.5, velocity=131.0),
        Contact("pull", "a", "b", Dahl(DryFriction(0.25, 0.25), 100.0), normal=9.0),
        Contact("c", "a", GROUND, DryFriction(0.3, 0.0, dwell=0.05), normal=0.6),
    )
    result = simulate(scene, (0.0, 0.1))
    assert not result.events and result.stats["restarts"] == 0
    bent = 0.0225 / 131.0
    assert result.velocity("a")[-1] == pytest.approx(2.25 * (0.1 - bent * -math.expm1(-0.1 / bent)), rel=1e-4)


def block_on_bristles(law: Law, normal_force: Any, velocity: float, *others: Any) -> Scene:
    contact = Contact("c", "a", GROUND, law, normal=normal_force)
    return Scene(Body("a", inertia=1.0, velocity=velocity), contact, *others)


def pressed_on_a_belt(stiffness: float, normal_force: Any, speed: float, damping: float = 0.0) -> Scene:
    return Scene(
        Body("a", inertia=1.0),
        Drive("belt", velocity=speed),
        Spring("a", GROUND, stiffness=1e3, damping=60.0),
        Contact("c", "a", "belt", LuGre(DryFriction(0.2, 0.2), stiffness, damping), normal=normal_force),
    )


@pytest.mark.parametrize(
    ("stiffness", "normal_force", "speed"),
    [(1e6, 1e-5, 1.0), (30.0, 1e-9, 1.0), (1e9, 1e-2, 1.0), (1e12, 10.0, 1.0), (1e6, 1e-4, 10.0)],
)
@pytest.mark.parametrize("damping", [0.0, 100.0])
def test_bristles_in_steady_sliding_have_the_level_however_fast_they_relax(
    stiffness: float, normal_force: float, speed: float, damping: float
) -> None:
    """``sigma_0 z = mu N`` in steady sliding, also where bristles relax with ``sigma_0 |w| / (mu N) = 5e11 /s``."""
    result = simulate(pressed_on_a_belt(stiffness, normal_force, speed, damping), (0.0, 1.0))
    assert result.force("c")[-1] == pytest.approx(-0.2 * normal_force, rel=1e-4)


@pytest.mark.parametrize(
    ("stiffness", "normal_force"),
    [
        (1e6, 1e-6),
        (30.0, 1e-11),
        (1e13, 10.0),
        (1e9, piecewise_linear([0.0, 0.5], [10.0, 1e-9])),
        (1e13, 10.0 + 1e-3 * position("a")),
        (1e13, feedback(lambda x: 10.0, position("a"))),
    ],
)
def test_bristles_that_relax_faster_than_can_be_followed_end_the_run(stiffness: float, normal_force: Any) -> None:
    """The run ends because the computed friction would exceed its level mu N."""
    with pytest.raises(SimulationError, match=r"contact 'c': its bristles relax faster than 1e\+12 /s"):
        simulate(pressed_on_a_belt(stiffness, normal_force, 1.0), (0.0, 1.0))


@pytest.mark.parametrize(
    "options", [{}, {"rtol": 1e-4, "atol": 1e-6}, {"method": "Adams"}, {"formulation": "multiplier"}]
)
@pytest.mark.parametrize("law", [Dahl(DryFriction(0.4, 0.4), 500.0), LuGre(DryFriction(0.4, 0.4), 500.0, 1.0)])
def test_bristles_whose_normal_force_touches_0_in_sliding_end_the_run_there(law: Law, options: dict[str, Any]) -> None:
    """``N = 10 |x|`` comes to 0 at 0.374 s, where the block passes x = 0 at 1.3 m/s; until then the motion is known."""
    normal = table(position("a"), [-100.0, 0.0, 100.0], [1000.0, 0.0, 1000.0])
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0, position=-0.5),
        Contact("c", "a", GROUND, law, normal=normal),
        Force("a", sine(4.0, 3 / (2 * math.pi))),
        Spring("a", GROUND, stiffness=5.0),
    )
    with pytest.raises(
        SimulationError, match="'c': its normal force comes back from nearly 0 while it slides"
    ) as caught:
        simulate(scene, (0.0, 3.0), **options)
    assert caught.value.t == pytest.approx(0.3745, abs=1e-3)
    assert caught.value.result.position("a")[-1] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("law", [Dahl(DryFriction(0.4, 0.4), 500.0), LuGre(DryFriction(0.4, 0.4), 500.0)])
def test_bristles_are_followed_where_their_normal_force_is_0_at_rest(law: Law) -> None:
    """With ``N = 10 |v|`` they relax at ``500 |v| / (0.4 N) = 125 /s`` whatever the velocity: the motion is linear."""
    normal = table(relative_velocity("c"), [-100.0, 0.0, 100.0], [1000.0, 0.0, 1000.0])
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0, position=-0.5),
        Contact("c", "a", GROUND, law, normal=normal),
        Spring("a", GROUND, stiffness=5.0),
    )
    matrix = np.array([[0.0, -5.0, -500.0], [1.0, 0.0, 0.0], [1.0, 0.0, -125.0]])
    exact = expm(3.0 * matrix) @ [1.0, -0.5, 0.0]
    assert simulate(scene, (0.0, 3.0)).velocity("a")[-1] == pytest.approx(exact[0], abs=1e-7)


@pytest.mark.parametrize("stop", [3.0, 100.0])
@pytest.mark.parametrize("beside", [[], [Body("rotor", inertia=1.0, velocity=3000.0)]])
def test_stiff_bristles_that_hold_are_followed_whatever_others_do(stop: float, beside: list[Any]) -> None:
    """Bristles hold 15 N like a spring of 1e8 N/m: 1 kg moves with ``F / sqrt(sigma_0 m) = 1.5e-3 m/s`` at most."""
    normal_force = piecewise_linear([1.0, 1.0, 2.0, 2.0], [100.0, 0.3, 0.3, 100.0])
    law = LuGre(DryFriction(0.3, 0.2), 1e8, 1e4)
    scene = block_on_bristles(law, normal_force, 0.0, Force("a", step(0.9, 15.0, 0.0)), *beside)
    result = simulate(scene, (0.0, stop))
    assert np.abs(result.velocity("a")).max() < 1.5e-3 and abs(result.velocity("a")[-1]) < 1e-6


@pytest.mark.parametrize("left", [0.0, 0.1 + 0.2 - 0.3])
def test_roundoff_of_a_ramp_to_0_presses_no_bristles(left: float) -> None:
    """Friction takes 0.2 times the impulse of N, 10 N for 0.3 s and a ramp of 0.4 s: v = 2 - 0.2 (3 + 2)."""
    law = LuGre(DryFriction(0.3, 0.2), 1e7, 0.1)
    scene = block_on_bristles(law, piecewise_linear([0.3, 0.7], [10.0, left]), 2.0)
    assert simulate(scene, (0.0, 1.0)).velocity("a")[-1] == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("tolerances", [{}, {"rtol": 1e-10, "atol": 1e-12}, {"rtol": 1e-11, "atol": 1e-13}])
@pytest.mark.parametrize(("law", "force"), [(Dahl, 0.0), (Dahl, -6.0), (LuGre, -6.0)])
def test_bristles_whose_normal_force_ends_on_a_ramp(law: Any, force: float, tolerances: dict[str, Any]) -> None:
    """Also where the block turns round just before: their deflection ends like a small power of the time left."""
    normal_force, push = piecewise_linear([0.3, 0.5], [10.0, 0.0]), Force("a", step(0.3, 0.0, force))
    scene = block_on_bristles(law(DryFriction(0.3, 0.2), 1e3), normal_force, 2.0, push)

    def rates(t: float, y: Any) -> list[float]:
        level = 0.2 * 50.0 * (min(0.5 - t, 0.2))
        return [(force if t > 0.3 else 0.0) - 1e3 * y[1], y[0] - 1e3 * abs(y[0]) / level * y[1]]

    exact: dict[str, Any] = {"method": "LSODA", "rtol": 1e-11, "atol": 1e-13}
    first = solve_ivp(rates, (0.0, 0.3), [2.0, 0.0], **exact).y[:, -1]
    second = solve_ivp(rates, (0.3 + 1e-12, 0.5 - 1e-9), first, **exact).y[:, -1]
    result = simulate(scene, (0.0, 0.7), **tolerances)
    assert result.velocity("a")[-1] == pytest.approx(second[0] + 0.2 * force, abs=2e-7)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("lever", [1.0, -2.0])
@pytest.mark.parametrize("part", [0.0, 1e-15, -1e-15])
@pytest.mark.parametrize(("push", "slope"), [(2.0, 1.6), (0.45, None)])
def test_a_start_at_the_pre_slip_velocity(
    side: int, lever: float, part: float, push: float, slope: float | None
) -> None:
    """2 N, beyond the level of 0.5 N, make it slip against 0.4 N; so do 0.45 N from above the pre-slip velocity.

    From below, 0.45 N slow it down towards 0.45 / 0.5 of the pre-slip velocity.
    """
    law = PreSlip(DryFriction(0.5, 0.4), velocity=0.01)
    scene = Scene(
        Body("b", inertia=1.0, velocity=side * 0.01 * (1 + part) / lever),
        Contact("c", "b", GROUND, law, normal=1.0, radius_a=lever),
        Force("b", side * push * lever),
    )
    result = simulate(scene, (0.0, 10.0 / lever**2), rtol=1e-10, atol=1e-13)
    assert not result.events
    w = result.relative_velocity("c")[-1] * side
    if part > 0 or slope is not None:
        slope = (push - 0.4) * lever**2
        assert result.mode("c")[0] == side
        assert w == pytest.approx(0.01 + slope * 10.0 / lever**2, rel=1e-9)
    else:
        assert result.mode("c")[0] == 0
        assert w == pytest.approx(0.01 * push / 0.5, rel=1e-9)


@pytest.mark.parametrize("options", [{}, {"method": "BDF"}, {"method": "Adams"}, {"formulation": "multiplier"}])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("inertia", [0.7, 1.0, 2.61])
def test_bristles_that_the_speed_itself_presses(inertia: float, side: int, options: dict[str, Any]) -> None:
    """With N = 2 v bristles relax at the rate k = sigma / (2 mu): v' = (F - F_0 - sigma z) / m, z' = v - k z.

    The brake lets go at 0.3 s, F - F_0 grows by 1 N/s from then on; it is the third unknown, and 1 is the fourth.
    """
    stiffness, mu, span = 300.0, 0.46, 1.7
    matrix = np.zeros((4, 4))
    matrix[0, 1:3] = -stiffness / inertia, 1 / inertia
    matrix[1, :2] = 1.0, -stiffness / (2 * mu)
    matrix[2, 3] = 1.0
    wanted = side * (expm(span * matrix) @ [0.0, 0.0, 0.0, 1.0])[0]
    scene = Scene(
        Body("b", inertia=inertia),
        Contact("brake", "b", GROUND, DryFriction(0.3, 0.3), normal=1.0),
        Contact("c", "b", GROUND, Dahl(DryFriction(mu, mu), stiffness), normal=2.0 * side * relative_velocity("c")),
        Force("b", piecewise_linear([0.0, 2.0], [0.0, 2.0 * side])),
    )
    result = simulate(scene, (0.0, 2.0), **options)
    assert result.velocity("b")[-1] == pytest.approx(wanted, abs=1e-7)


@pytest.mark.parametrize("rtol", [1e-5, 1e-6, 1e-7])
def test_contacts_that_the_speed_presses_open_where_it_turns(rtol: float) -> None:
    """Both contacts are pressed with N = -2 v, and open once v turns at 0.012 s, whatever of v is left there."""
    bristles, curve = LuGre(DryFriction(0.21, 0.21), 300.0, 3.0), DryFriction(0.456, 0.38, stribeck_velocity=0.06)
    scene = Scene(
        Body("a", inertia=2.97),
        Body("b", inertia=0.98),
        Contact("under a", GROUND, "a", bristles, normal=2.0 * relative_velocity("under a")),
        Contact("under b", GROUND, "b", curve, normal=2.0 * relative_velocity("under b")),
        Contact("grip", "b", "a", DryFriction(0.338, 0.26), normal=14.33),
        Spring(GROUND, "a", stiffness=24.09, damping=0.27),
        Force("a", sine(4.22, 1.13, 0.0, 1.07)),
        Force("b", -1.25),
    )
    result = simulate(scene, (0.0, 1.0), method="BDF", rtol=rtol)
    exact = simulate(scene, (0.0, 1.0), formulation="multiplier", rtol=1e-9, atol=1e-11)
    before, *after = result.sample([0.0119, 0.0121, 0.02, 0.05]).normal("under b").tolist()
    assert before == pytest.approx(9.977e-6, rel=1e-3)
    assert after == [0.0, 0.0, 0.0]
    assert result.velocity("a")[-1] == pytest.approx(exact.velocity("a")[-1], abs=30 * rtol)
