"""Fixed steps: orders between and across events, mode changes at step ends, and what a step costs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from reading import told

from stickslip import (
    GROUND,
    Body,
    Contact,
    Dahl,
    Damper,
    Drive,
    DryFriction,
    Force,
    Karnopp,
    LuGre,
    PreSlip,
    Scene,
    SimulationError,
    Spring,
    piecewise_linear,
    simulate,
    sine,
    table,
    triangle,
)
from stickslip.benchmark import BENCHMARK_SPAN, EXACT_EVENTS, EXACT_FINAL_VELOCITY, flywheel_benchmark
from stickslip.engines.stability import Unstable

STORY = [(e.contact, e.before, e.after) for e in EXACT_EVENTS]


def order(steps: list[float], errors: list[float]) -> float:
    """The slope of the error over the step, both as logarithms."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


# Between events


def driven(law: DryFriction | Dahl | LuGre, amplitude: float = 0.3) -> Scene:
    """A sprung, damped block that slides forward for as long as it is looked at."""
    return Scene(
        Body("a", inertia=1.0, velocity=5.0),
        Contact("c", "a", GROUND, law, normal=2.0),
        Spring("a", GROUND, stiffness=4.0, damping=0.5),
        Force("a", sine(amplitude, 0.7)),
    )


def sliding(t: float, amplitude: float = 0.3) -> tuple[float, float]:
    """``x'' + 0.5 x' + 4 x = A sin(omega t) - 0.4`` from x = 0, x' = 5, in closed form."""
    omega, decay, own = 2 * math.pi * 0.7, 0.25, math.sqrt(4 - 0.25**2)
    response = amplitude / (4 - omega**2 + 0.5j * omega)  # of exp(i omega t); its imaginary part is wanted

    def forced(t: float) -> complex:
        return response * complex(math.cos(omega * t), math.sin(omega * t))

    a = 0.1 - forced(0).imag
    b = (5.0 - (1j * omega * forced(0)).imag + decay * a) / own
    fade, c, s = math.exp(-decay * t), math.cos(own * t), math.sin(own * t)
    x = fade * (a * c + b * s) + forced(t).imag - 0.1
    v = fade * ((b * own - decay * a) * c - (a * own + decay * b) * s) + (1j * omega * forced(t)).imag
    return x, v


@pytest.mark.parametrize(("method", "expected"), [("RK4", 4.0), ("Euler", 1.0)])
def test_order_between_events(method: str, expected: float) -> None:
    x, v = sliding(0.5)
    steps, errors = [0.02, 0.01, 0.005, 0.0025], []
    for step in steps:
        result = simulate(driven(DryFriction(0.3, 0.2)), (0.0, 0.5), method=method, step=step)
        assert not result.events and result.stats["states"] == 2
        errors.append(math.hypot(result.velocity("a")[-1] - v, result.position("a")[-1] - x))
    assert order(steps, errors) == pytest.approx(expected, abs=0.15)
    assert errors[-1] < (1e-10 if method == "RK4" else 1e-2)


@pytest.mark.parametrize(
    "law",
    [
        DryFriction(0.3, 0.2, stribeck_velocity=2.0),
        DryFriction(0.3, 0.2, kinetic=lambda speed: 0.2 / (1 + speed)),
        Dahl(DryFriction(0.3, 0.2), stiffness=2.0),
        LuGre(DryFriction(0.3, 0.2, stribeck_velocity=2.0), stiffness=2.0, damping=0.3, viscous=0.1),
    ],
    ids=["Stribeck", "kinetic", "Dahl", "LuGre"],
)
def test_order_of_laws_that_depend_on_velocity(law: DryFriction | Dahl | LuGre) -> None:
    exact = simulate(driven(law), (0.0, 0.5), rtol=1e-12, atol=1e-14).y[:, -1]
    steps = [0.05, 0.025, 0.0125]
    errors = [
        float(np.abs(simulate(driven(law), (0.0, 0.5), method="RK4", step=h).y[:, -1] - exact).max()) for h in steps
    ]
    assert order(steps, errors) == pytest.approx(4.0, abs=0.35)
    assert errors[-1] < 2e-7


def test_constant_forces_are_integrated_exactly() -> None:
    scene = Scene(Body("a", inertia=2.0, velocity=3.0), Contact("c", "a", GROUND, DryFriction(0.3, 0.2), normal=10.0))
    for method in ("RK4", "Euler"):
        result = simulate(scene, (0.0, 2.0), method=method, step=0.1)
        np.testing.assert_allclose(result.velocity("a"), 3.0 - result.t, atol=1e-14)


# Across events


def pulled(dwell: float = 0.0) -> Scene:
    """Stuck until the load passes 3 N at t = 3 s; from then on ``v = (t - 3)^2 / 2 + (t - 3)``."""
    law = DryFriction(mu_static=0.3, mu_coulomb=0.2, dwell=dwell)
    return Scene(
        Body("a", inertia=1.0),
        Contact("c", "a", GROUND, law, normal=10.0),
        Force("a", piecewise_linear([0.0, 10.0], [0.0, 10.0])),
    )


@pytest.mark.parametrize("method", ["RK4", "Euler"])
def test_events_make_every_method_first_order(method: str) -> None:
    # steps that never fall on the breakaway, so that it is always found late
    steps = [4.0 / (3 * 2**k + 1 / 3) for k in range(4, 10)]
    errors, late = [], []
    for step in steps:
        result = simulate(pulled(), (0.0, 4.0), method=method, step=step)
        assert told(result) == [("c", 0, 1)]
        late.append(result.events[0].t - 3.0)
        errors.append(abs(result.velocity("a")[-1] - 1.5))
    assert all(0 < delay <= step for delay, step in zip(late, steps, strict=True))
    assert order(steps, errors) == pytest.approx(1.0, abs=0.35)


def test_mode_changes_stand_at_step_ends() -> None:
    result = simulate(flywheel_benchmark(), BENCHMARK_SPAN, method="RK4", step=1e-3)
    assert told(result) == STORY
    for event, exact in zip(result.events, EXACT_EVENTS, strict=True):
        assert event.t == pytest.approx(round(event.t / 1e-3) * 1e-3, abs=1e-12)
        assert -1e-3 < event.t - exact.t < 3e-3


@pytest.mark.slow
@pytest.mark.parametrize("method", ["RK4", "Euler"])
def test_the_benchmark_converges_with_first_order(method: str) -> None:
    # the largest error of nine steps: a single one may happen to end near the five events
    steps, errors = [8e-3, 2e-3, 5e-4], []
    for step in steps:
        found = [
            simulate(flywheel_benchmark(), (0.0, 0.8), method=method, step=step * factor)
            for factor in np.linspace(0.8, 1.2, 9)
        ]
        assert all(told(result) == STORY for result in found)
        errors.append(max(abs(r.velocity("wheel1")[-1] - EXACT_FINAL_VELOCITY) for r in found))
    assert order(steps, errors) == pytest.approx(1.0, abs=0.25)
    assert all(error < 1.3 * step for error, step in zip(errors, steps, strict=True))


def test_velocities_are_projected_conserving_momentum() -> None:
    """No brake: the wheels stick at the mean velocity whatever the step, and stay exactly together."""
    law = DryFriction(0.2, 0.1)
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Body("b", inertia=10.0, velocity=1.01),
        Contact("c", "a", "b", law, normal=100.0),
    )
    for step in (1e-4, 3e-4, 7e-3, 0.1):
        result = simulate(scene, (0.0, 1.0), method="RK4", step=step)
        assert told(result) == [("c", -1, 0)]
        np.testing.assert_allclose(result.velocity("a") + 10 * result.velocity("b"), 11.1, rtol=1e-14)
        stuck = result.mode("c") == 0
        assert np.all(result.relative_velocity("c")[stuck] == 0)
        assert result.velocity("a")[-1] == pytest.approx(11.1 / 11, rel=1e-14)


@pytest.mark.parametrize("velocity", [1e-2, pytest.param(1e-3, marks=pytest.mark.slow)])
def test_pre_slip_tells_the_story_of_the_benchmark(velocity: float) -> None:
    scene = flywheel_benchmark().regularized(velocity=velocity)
    result = simulate(scene, (0.0, 1.0), method="RK4", step=0.1 * velocity)
    assert told(result) == STORY
    exact = simulate(flywheel_benchmark(), (0.0, 1.0), t_eval=np.unique(result.t))
    at = np.searchsorted(exact.t, result.t)
    assert np.abs(result.y - exact.y[:, at]).max() < 1.2 * velocity


@pytest.mark.slow
def test_pre_slip_is_unstable_beyond_the_stiffness_of_its_slope() -> None:
    """``lambda = mu_s N (1/m1 + 1/m2) / v_pre`` is 22000 / s: RK4 holds up to ``2.785 / lambda``, 0.127 ms."""
    scene = flywheel_benchmark().regularized(velocity=1e-3)
    assert told(simulate(scene, (0.0, 1.0), method="RK4", step=1.2e-4)) == STORY
    with pytest.raises(
        SimulationError,
        match=r"RK4 step of 0\.00013 s is unstable: an eigenvalue of -2\.1\de\+04 /s allows 0\.00012\d+ s",
    ):
        simulate(scene, (0.0, 4.0), method="RK4", step=1.3e-4)


# Loads


def test_loads_are_read_where_the_steps_fall() -> None:
    """RK4 is exact for cubics, and so for piecewise linear loads whose kinks stand at step ends."""
    load = piecewise_linear([0.0, 0.5, 1.0, 2.0], [5.0, 9.0, 3.0, 4.0])
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("c", "a", GROUND, DryFriction(0.3, 0.2), normal=triangle(0.5, 1.0, 1.5, slope=10.0) + 5.0),
        Force("a", load),
    )
    result = simulate(scene, (0.0, 2.0), method="RK4", step=0.125)
    assert result.stats["restarts"] == 0
    impulse = 0.5 * 14 * 0.5 + 0.5 * 12 * 0.5 + 0.5 * 7 * 1.0
    assert result.velocity("a")[-1] == pytest.approx(1.0 + impulse - 0.2 * (5.0 * 2.0 + 0.5 * 5.0), rel=1e-13)


def test_a_contact_that_opens_and_closes() -> None:
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("c", "a", GROUND, DryFriction(0.3, 0.2), normal=sine(10.0, 1.0)),
    )
    result = simulate(scene, (0.0, 2.0), method="RK4", step=1e-3)
    exact = simulate(scene, (0.0, 2.0))
    assert told(result) == told(exact)
    assert [e.t for e in result.events] == pytest.approx([e.t for e in exact.events], abs=2e-3)
    assert result.velocity("a")[-1] == exact.velocity("a")[-1] == 0.0


@pytest.mark.parametrize("method", ["RK4", "Euler"])
def test_a_step_ends_where_a_drive_jumps(method: str) -> None:
    """A block held to a belt at 1 m/s, which turns round at 0.3 s, slides from there on with -2 m/s^2."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Drive("belt", velocity=piecewise_linear([0.3, 0.3], [1.0, -1.0])),
        Contact("c", "a", "belt", DryFriction(0.3, 0.2), normal=10.0),
    )
    result = simulate(scene, (0.0, 0.5), method=method, step=0.0007)
    assert told(result) == [("c", 0, 1)] and result.events[0].t == 0.3
    assert result.velocity("a")[-1] == pytest.approx(0.6, rel=1e-12)
    assert abs(result.energy().relative_error) < 1e-12


@pytest.mark.parametrize("method", ["RK4", "Euler"])
@pytest.mark.parametrize(
    ("xs", "ys", "before", "after", "speed"),
    [
        ([-1.0, 1.0, 2.0], [0.0, 1.0, 5.0], 0.0, 3.0, 0.5 * 0.5 + 0.5 * 5.0),
        ([-2.0, 3.0], [-2.0, 3.0], 1.24, 5.94, 0.5 * 1.24 + 0.5 * 3.0),
        ([-1.0, 2.0], [-1.0, 2.0], 0.0, 3.0, 0.5 * 2.0),
    ],
)
def test_a_step_ends_where_a_signal_jumps_over_corners_of_a_table(
    method: str, xs: list[float], ys: list[float], before: float, after: float, speed: float
) -> None:
    load = table(piecewise_linear([0.5, 0.5], [before, after]), xs, ys)
    result = simulate(Scene(Body("a", inertia=1.0), Force("a", load)), (0.0, 1.0), method=method, step=3e-3)
    assert result.velocity("a")[-1] == pytest.approx(speed, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["RK4", "Euler"])
@pytest.mark.parametrize(
    "law",
    [
        Karnopp(DryFriction(0.3, 0.2), 0.1),
        PreSlip(DryFriction(0.3, 0.2), 0.1),
        LuGre(DryFriction(0.3, 0.2), 1e3, 10.0),
        Dahl(DryFriction(0.3, 0.2), 1e3),
    ],
)
def test_a_contact_that_a_jump_opens_is_open_at_once(law: Any, method: str) -> None:
    """Its modes are those of the engines that find events; its memory has an effect when it closes again.

    While it is open, the force alone turns the block round: v = v(0.05) - (t - 0.05).
    """
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.3),
        Contact("c", "a", GROUND, law, normal=piecewise_linear([0.05, 0.05, 0.5, 0.5], [1.0, 0.0, 0.0, 10.0])),
        Force("a", -1.0),
    )
    exact = simulate(scene, (0.0, 1.0))
    result = simulate(scene, (0.0, 1.0), method=method, step=1e-4)
    at, right = result.sample([0.05, 0.25, 0.285, 0.4, 0.6]), exact.sample([0.05, 0.25, 0.285, 0.4, 0.6])
    assert at.velocity("a")[1:4] == pytest.approx(at.velocity("a")[0] - np.array([0.2, 0.235, 0.35]), abs=1e-12)
    assert at.velocity("a") == pytest.approx(right.velocity("a"), abs=3e-4)
    assert at.mode("c").tolist() == right.mode("c").tolist()


@pytest.mark.slow
def test_a_contact_that_slips_where_nothing_presses_it_remembers_that() -> None:
    """Pressed again with 10 N at half the pre-slip velocity, it brakes with all of its kinetic friction: 2 N."""
    normal = piecewise_linear([0.2, 0.2, 0.5, 0.5], [1e-3, 0.0, 0.0, 10.0])
    scene = Scene(
        Body("a", inertia=1.0, velocity=0.05),
        Contact("c", "a", GROUND, PreSlip(DryFriction(0.3, 0.2), 0.1), normal=normal),
    )
    for way in ({}, {"method": "RK4", "step": 1e-4}):
        result = simulate(scene, (0.0, 0.6), **way)
        assert abs(result.sample([0.501]).force("c")[0]) == pytest.approx(2.0, rel=1e-12)


# What it costs, and what is refused


@pytest.mark.parametrize(("method", "stages"), [("RK4", 4), ("Euler", 1)])
def test_work_is_steps_and_stages(method: str, stages: int) -> None:
    scene = driven(DryFriction(0.3, 0.2))
    stats = simulate(scene, (0.0, 0.5), method=method, step=1e-3).stats
    assert stats["steps"] == stats["guard_calls"] == 500
    assert stats["rate_calls"] == stages * 500
    assert stats["jacobian_calls"] == stats["solvers"] == stats["restarts"] == 0


def test_steps_beyond_an_event_are_few_and_counted() -> None:
    result = simulate(pulled(), (0.0, 4.0), method="RK4", step=1e-3)
    assert result.stats["steps"] == 4000
    assert 0 <= result.stats["rate_calls"] - 4 * 4000 <= 4 * 64


def test_the_last_step_ends_the_span() -> None:
    result = simulate(driven(DryFriction(0.3, 0.2)), (0.0, 0.5), method="RK4", step=0.3)
    np.testing.assert_allclose(result.t, [0.0, 0.3, 0.5])
    assert simulate(driven(DryFriction(0.3, 0.2)), (0.0, 0.5), method="RK4", step=7.0).stats["steps"] == 1


@pytest.mark.parametrize(("method", "limit"), [("RK4", 2.7852936), ("Euler", 2.0)])
def test_an_unstable_step_is_refused_and_the_longest_told(method: str, limit: float) -> None:
    """``y' = -100 y``: stable while ``|R(h lambda)| <= 1``."""
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Damper("a", GROUND, damping=100.0))
    longest = limit / 100.0
    result = simulate(scene, (0.0, 10.0), method=method, step=0.999 * longest)
    assert abs(result.velocity("a")[-1]) < 1.0
    message = rf"{method} step of .* is unstable: an eigenvalue of -100 /s allows {longest:.4g} s at most.*BDF"
    with pytest.raises(SimulationError, match=message) as caught:
        simulate(scene, (0.0, 10.0), method=method, step=1.001 * longest)
    assert caught.value.t == 0.0 and not caught.value.result.success
    assert isinstance(caught.value.__cause__, Unstable)
    assert caught.value.__cause__.longest == pytest.approx(longest, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("step", [1e-4, 1.3e-4])
@pytest.mark.parametrize("velocity", [0.0, 1.0])
@pytest.mark.parametrize("damping", [0.0, 1.0])
def test_bristles_that_stiffen_without_limit_are_refused(step: float, velocity: float, damping: float) -> None:
    """The normal force falls to 0 on a ramp. States that overflow must not end in another error."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=velocity),
        Contact(
            "c",
            "a",
            GROUND,
            LuGre(DryFriction(0.3, 0.2), 1e3, damping),
            normal=piecewise_linear([0.0, 0.3], [10.0, 0.0]),
        ),
        Force("a", sine(1.0, 1.0)),
    )
    with pytest.raises(SimulationError, match=r"the RK4 step of .* is unstable"):
        simulate(scene, (0.0, 0.5), method="RK4", step=step)


@pytest.mark.parametrize(("method", "limit"), [("Euler", 2.0), ("RK4", 2.785)])
def test_a_step_that_is_too_long_for_bristles_only_for_a_while_is_refused(method: str, limit: float) -> None:
    """From 0.25 s on ``N = 1``: bristles at w = 0.5 m/s relax with ``sigma_0 w / (mu N)`` = 2.5e4 /s."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact(
            "c",
            "a",
            GROUND,
            LuGre(DryFriction(0.3, 0.2), 1e4, 1.0),
            normal=piecewise_linear([0.25, 0.25], [10.0, 1.0]),
        ),
    )
    with pytest.raises(SimulationError, match=f"at t = 0.25 s: the {method} step of .* is unstable"):
        simulate(scene, (0.0, 1.0), method=method, step=1.1 * limit / 2.4e4)
    result = simulate(scene, (0.0, 1.0), method=method, step=0.9 * limit / 2.5e4)
    assert result.velocity("a")[-1] == pytest.approx(simulate(scene, (0.0, 1.0)).velocity("a")[-1], abs=1e-6)


@pytest.mark.parametrize(("method", "limit"), [("RK4", math.sqrt(8.0)), ("Euler", 1.0)])
def test_an_undamped_oscillation_may_grow_a_little(method: str, limit: float) -> None:
    """x'' = -x: RK4 is stable up to ``2 sqrt 2``, Euler's method at no step, but steps up to 1 are accepted.

    For z = x + i v, z' = -i z: a step multiplies z by the Taylor polynomial of exp(-i step), of degree 4 or 1.
    """
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Spring("a", GROUND, stiffness=1.0))
    result = simulate(scene, (0.0, 5.0), method=method, step=0.999 * limit)
    steps, z = np.diff(result.t), [1j]
    assert steps[0] == pytest.approx(0.999 * limit, rel=1e-12)
    for step in steps:
        z.append(z[-1] * sum((-1j * step) ** k / math.factorial(k) for k in range(5 if method == "RK4" else 2)))
    np.testing.assert_allclose(result.position("a") + 1j * result.velocity("a"), z, rtol=0, atol=1e-12)
    with pytest.raises(SimulationError, match="is unstable"):
        simulate(scene, (0.0, 5.0), method=method, step=1.001 * limit)


@pytest.mark.parametrize("shape", ["tanh", "arctan"])
def test_a_smooth_law_is_looked_at_where_it_passes_through_rest(shape: str) -> None:
    """Sliding at 1 m/s the law is flat; its slope at rest, ``mu N / (m v_pre)`` = 2000 / s, allows 1.39 ms."""
    scene = Scene(
        Body("a", inertia=1.0, velocity=1.0),
        Contact("c", "a", GROUND, DryFriction(0.2, 0.2), normal=10.0),
    ).regularized(1e-3, shape)
    # friction is all but 2 N for the tanh, and 2 N (1 - 4 v_pre / (pi^2 v)) for the arctan
    less = 0.0 if shape == "tanh" else 4e-3 / math.pi**2 * math.log(1 / 0.2)
    sliding = simulate(scene, (0.0, 0.4), method="RK4", step=2e-3)
    assert sliding.velocity("a")[-1] == pytest.approx(0.2 + less, abs=1e-5)
    with pytest.raises(SimulationError, match=r"unstable.*-2e\+03 /s allows 0\.001393 s") as caught:
        simulate(scene, (0.0, 1.0), method="RK4", step=2e-3)
    assert caught.value.t == pytest.approx(0.5, abs=0.15)
    assert simulate(scene, (0.0, 1.0), method="RK4", step=1.3e-3).velocity("a")[-1] == pytest.approx(0.0, abs=1e-9)


def test_what_grows_by_itself_is_no_fault_of_the_step() -> None:
    """On the falling branch of its Stribeck curve a sliding block is unstable: its eigenvalue is 8 exp(-2 v) /s."""
    law = DryFriction(0.6, 0.2, stribeck_velocity=0.5, stribeck_exponent=1.0)
    scene = Scene(Body("a", inertia=1.0, velocity=0.05), Contact("c", "a", GROUND, law, normal=10.0), Force("a", 6.1))
    result = simulate(scene, (0.0, 1.0), method="RK4", step=0.2)
    v = 0.05

    def rate(v: float) -> float:
        return 6.1 - 10.0 * (0.2 + 0.4 * math.exp(-v / 0.5))

    for _ in range(5):
        k1 = rate(v)
        k2 = rate(v + 0.1 * k1)
        k3 = rate(v + 0.1 * k2)
        v += 0.2 / 6 * (k1 + 2 * k2 + 2 * k3 + rate(v + 0.2 * k3))
    assert result.velocity("a")[-1] == pytest.approx(v, rel=1e-12)


@pytest.mark.parametrize("n", [5, 120])
def test_the_longest_step_of_a_chain(n: int) -> None:
    """Equal blocks and springs c: the fastest, k = n - 1, of ``omega_k = 2 sqrt(c/m) sin(k pi / (2n))``."""
    scene = Scene(
        *(Body(f"b{i}", inertia=1.0, velocity=1.0 if i == 0 else 0.0) for i in range(n)),
        *(Spring(f"b{i}", f"b{i + 1}", stiffness=1e4) for i in range(n - 1)),
    )
    fastest = 200.0 * math.sin((n - 1) * math.pi / (2 * n))
    longest = math.sqrt(8.0) / fastest
    result = simulate(scene, (0.0, 0.1), method="RK4", step=0.99 * longest)
    # each step is the Taylor polynomial of degree 4 of exp(step A), where A holds the rates of this chain
    stretch = np.diff(np.eye(n), axis=0)
    rates = np.block([[np.zeros((n, n)), np.eye(n)], [-1e4 * stretch.T @ stretch, np.zeros((n, n))]])
    y = np.eye(2 * n)[n]
    for step in np.diff(result.t):
        terms = [y]
        for k in range(1, 5):
            terms.append(step / k * rates @ terms[-1])
        y = sum(terms)
    np.testing.assert_allclose([result.velocity(f"b{i}")[-1] for i in range(n)], y[n:], rtol=0, atol=1e-12)
    with pytest.raises(SimulationError, match="is unstable"):
        simulate(scene, (0.0, 0.1), method="RK4", step=1.01 * longest)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "RK4"}, "needs step="),
        ({"method": "BDF", "step": 1e-3}, "belongs to the methods RK4 and Euler"),
        ({"method": "RK4", "step": 0.0}, "step must"),
        ({"method": "RK4", "step": 2e-3, "max_step": 1e-3}, "step=0.002 is longer than max_step=0.001"),
        ({"method": "RK4", "step": 1e-3, "formulation": "merged"}, "contact-force formulation"),
        ({"method": "RK4", "step": 1e-3, "formulation": "multiplier"}, "contact-force formulation"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate(pulled(), (0.0, 1.0), **options)


def test_sparse_scenes_step_like_dense_ones() -> None:
    """A chain of 120 blocks with springs is assembled sparse; the first 3 of them, alone, dense."""

    def chain(n: int) -> Scene:
        law = DryFriction(0.3, 0.2, stribeck_velocity=0.1)
        bodies = [Body(f"b{i}", inertia=1.0, velocity=1.0 if i % 3 else -0.5) for i in range(n)]
        contacts = [Contact(f"c{i}", f"b{i}", GROUND, law, normal=5.0) for i in range(n)]
        springs = [Spring(f"b{i}", f"b{i + 1}", stiffness=3.0) for i in range(n - 1) if i % 3 < 2]
        return Scene(*bodies, *contacts, *springs)

    many = simulate(chain(120), (0.0, 1.0), method="RK4", step=5e-3)
    few = simulate(chain(3), (0.0, 1.0), method="RK4", step=5e-3)
    assert many.trajectory.system.sparse and not few.trajectory.system.sparse
    assert told(few) == [c for c in told(many) if c[0] in {"c0", "c1", "c2"}]
    for i in range(120):
        np.testing.assert_allclose(many.y[i, -1], few.y[i % 3, -1], atol=1e-13)
