"""Laws in motion: Stribeck, memory, anisotropy, rest, viscous friction, LuGre and Dahl against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from reading import told
from scipy.integrate import solve_ivp

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
    Spring,
    piecewise_linear,
    simulate,
    step,
    triangle,
)
from stickslip.model.laws.dry_friction import Law
from stickslip.model.laws.table import LawTable, VelocityDependentForces, steady_forces

TIGHT: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-12}


def ramp(rate: float, stop: float) -> Any:
    return piecewise_linear([0.0, stop], [0.0, rate * stop])


# Forces and slopes of the laws themselves

STRIBECK = DryFriction(0.5, 0.3, 0.2, 0.1, 1.5, mu_static_backward=0.6, mu_coulomb_backward=0.2)
LAWS: list[Law] = [
    STRIBECK,
    DryFriction(0.5, 0.4, kinetic=lambda speed: 0.5 / (1 + speed)),
    PreSlip(STRIBECK, 0.05),
    PreSlip(STRIBECK, 0.05, "tanh"),
    PreSlip(STRIBECK, 0.05, "arctan"),
    LuGre(STRIBECK, 100.0, 3.0, 0.4),
    Dahl(STRIBECK, 50.0),
]


def acting(laws: list[Law], w: np.ndarray) -> VelocityDependentForces:
    table = LawTable(laws)
    slips = table.sticks | (table.has_slip_state & (np.abs(w) > 0.1))
    return VelocityDependentForces(laws, np.where(slips, np.sign(w), 0).astype(np.int8))


def test_how_each_law_behaves_near_rest() -> None:
    table = LawTable([*LAWS, Karnopp(STRIBECK, 0.01)])
    np.testing.assert_array_equal(table.sticks.nonzero()[0], [0, 1, 7])
    np.testing.assert_array_equal(table.has_slip_state.nonzero()[0], [2])
    np.testing.assert_array_equal(table.has_state.nonzero()[0], [5, 6])
    np.testing.assert_array_equal(table.slips_beyond, [0, 0, 0.05, 0.05, 0.05, 0, 0, 0])
    np.testing.assert_allclose(table.rests_below, [0, 0, 0.005, 0, 0, 0, 0, 0.01], rtol=1e-15)


@pytest.mark.parametrize("w", [-0.7, -0.08, 0.03, 0.3, 2.0])
def test_steady_forces_are_those_of_steady_sliding(w: float) -> None:
    """Bristles have stopped bending: ``sign(w) mu_k N + sigma_2 w``; dwells are over."""
    mu = math.copysign(STRIBECK.mu_k(abs(w), 1 if w > 0 else -1), w)
    building = STRIBECK.mu_s(1 if w > 0 else -1) * w / 0.05
    expected = {
        0: 7.0 * mu,
        2: 7.0 * (mu if abs(w) > 0.05 else building),
        3: 7.0 * abs(mu) * math.tanh(w / 0.05),
        5: 7.0 * mu + 0.4 * w,
        6: 7.0 * mu,
    }
    for place, force in expected.items():
        assert steady_forces(LAWS[place], np.array([w]), 7.0)[0] == pytest.approx(force, rel=1e-13)


@pytest.mark.parametrize("w", [-0.7, -0.08, 0.03, 0.3, 2.0])
def test_forces_follow_their_formulas(w: float) -> None:
    normal, lag, z = 7.0, 0.25, np.array([0.011, -0.02])
    every = np.full(len(LAWS), w)
    forces = acting(LAWS, every).forces(every, np.full(7, normal), np.full(7, lag), z)
    sign, side = math.copysign(1.0, w), 1 if w > 0 else -1
    mu = STRIBECK.mu_k(abs(w), side)
    mu_s, mu_0 = STRIBECK.mu_s(side), STRIBECK.mu_k(0.0, side)
    slipping = abs(w) > 0.1
    g = mu * normal
    rate = w - 100.0 * abs(w) * z[0] / g
    expected = [
        sign * g,
        sign * normal * 0.5 / (1 + abs(w)),
        sign * g if slipping else (mu_s - (mu_s - mu_0) * lag) * normal * w / 0.05,
        g * math.tanh(w / 0.05),
        g * 2 / math.pi * math.atan(0.5 * math.pi * w / 0.05),
        100.0 * z[0] + 3.0 * rate + 0.4 * w,
        50.0 * z[1],
    ]
    np.testing.assert_allclose(forces, expected, rtol=1e-13)
    many = acting(LAWS, every)
    columns = [np.tile(x[:, None], 3) for x in (every, np.full(7, normal), np.full(7, lag), z)]
    np.testing.assert_allclose(many.forces(*columns), np.tile(forces[:, None], 3), rtol=1e-13)


@pytest.mark.parametrize("w", [-0.7, -0.08, 0.03, 0.3, 2.0])
@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__ + getattr(law, "shape", ""))
def test_slopes_are_derivatives(law: Law, w: float) -> None:
    part = acting([law], np.array([w]))
    normal, lag, z = np.array([7.0]), np.array([0.25]), np.array([0.011])[: part.bristles.size]

    def at(x: float, z: np.ndarray) -> tuple[float, float]:
        w = np.array([x])
        rates = part.bristle_rates(w, normal, z)
        return float(part.forces(w, normal, lag, z)[0]), float(rates[0]) if rates.size else 0.0

    h = 1e-6
    (right, up), (left, down) = at(w + h, z), at(w - h, z)
    found = float(part.slopes(np.array([w]), normal, lag, z)[0])
    assert found == pytest.approx((right - left) / (2 * h), rel=1e-5, abs=1e-6)
    if part.bristles.size:
        by_w, by_z = part.bristle_slopes(np.array([w]), normal, z)
        assert by_w[0] == pytest.approx((up - down) / (2 * h), rel=1e-5)
        assert by_z[0] == pytest.approx((at(w, z + h)[1] - at(w, z - h)[1]) / (2 * h), rel=1e-5)
        by_bristle = part.by_bristle(np.array([w]), normal, z)[0]
        assert by_bristle == pytest.approx((at(w, z + h)[0] - at(w, z - h)[0]) / (2 * h), rel=1e-5)


def test_extreme_speeds_neither_overflow_nor_lose_the_law() -> None:
    steep = DryFriction(0.5, 0.3, stribeck_velocity=1e-3, stribeck_exponent=50.0)
    flat = DryFriction(0.5, 0.3, stribeck_velocity=1e-3, stribeck_exponent=0.5)
    for law in (steep, flat):
        for w, mu in ((0.0, 0.5), (1e12, 0.3)):
            part = acting([law], np.array([1.0]))
            values = (np.array([w]), np.ones(1), np.zeros(1), np.empty(0))
            assert part.forces(*values)[0] == pytest.approx(mu)
            assert part.slopes(*values)[0] == pytest.approx(0.0, abs=1e-12)
    for law in (LuGre(steep, 1e5, 10.0), Dahl(steep, 1e5)):
        part = acting([law], np.zeros(1))
        for w in (0.0, 1.0):
            # the contact has just opened
            values = (np.array([w]), np.zeros(1), np.zeros(1), np.array([1e-5]))
            assert np.isfinite(part.forces(*values)).all() and np.isfinite(part.slopes(*values)).all()
            assert np.isfinite(part.bristle_slopes(values[0], values[1], values[3])).all()


# Dry friction


def slider(law: Law, *more: Any, velocity: float = 0.0, normal: Any = 10.0, rested: float = 0.0) -> Scene:
    contact = Contact("c", "a", GROUND, law, normal=normal, rested=rested)
    return Scene(Body("a", inertia=2.0, velocity=velocity), contact, *more)


def test_stribeck_sliding_to_rest() -> None:
    """``m v' = -N (mu_c + d exp(-v/v_s))``: t = m v_s / (mu_c N) ln((exp(v0/v_s) + d/mu_c) / (1 + d/mu_c))."""
    law = DryFriction(0.5, 0.2, stribeck_velocity=0.3, stribeck_exponent=1.0)
    result = simulate(slider(law, velocity=1.0), (0.0, 2.0), **TIGHT)
    assert told(result) == [("c", 1, 0)]
    exact = 2.0 * 0.3 / 2.0 * math.log((math.exp(1.0 / 0.3) + 1.5) / 2.5)
    assert result.events[0].t == pytest.approx(exact, abs=1e-9)
    sliding = result.mode("c") == 1
    v = result.velocity("a")[sliding]
    np.testing.assert_allclose(result.force("c")[sliding], 10 * (0.2 + 0.3 * np.exp(-v / 0.3)), rtol=1e-12)


def test_viscous_friction_is_a_damper_of_its_own() -> None:
    """``m v' = -F_c - c v``: rest at ``t = m/c ln(1 + c v0 / F_c)``; the contact's own force stays Coulomb."""
    result = simulate(
        slider(DryFriction(0.3, 0.2), Damper("a", GROUND, damping=0.5), velocity=3.0), (0.0, 4.0), **TIGHT
    )
    assert told(result) == [("c", 1, 0)]
    assert result.events[0].t == pytest.approx(2.0 / 0.5 * math.log(1 + 0.5 * 3.0 / 2.0), abs=1e-9)
    assert np.all(result.force("c")[result.mode("c") == 1] == 2.0)


@pytest.mark.parametrize(("sign", "static", "coulomb"), [(1, 4.0, 3.0), (-1, 6.0, 1.0)])
def test_anisotropic_coefficients(sign: int, static: float, coulomb: float) -> None:
    """A load of ``+-2 t`` N breaks away at mu_s N of its direction; then ``m v = t^2 - mu_c N t`` from there."""
    law = DryFriction(0.4, 0.3, mu_static_backward=0.6, mu_coulomb_backward=0.1)
    result = simulate(slider(law, Force("a", ramp(2.0 * sign, 5.0))), (0.0, 5.0))
    assert told(result) == [("c", 0, sign)]
    start = static / 2.0
    assert result.events[0].t == pytest.approx(start, rel=1e-12)
    gained = (25.0 - start**2 - coulomb * (5.0 - start)) / 2.0
    assert result.velocity("a")[-1] == pytest.approx(sign * gained, rel=1e-9)
    assert result.force("c")[-1] == pytest.approx(sign * coulomb)


@pytest.mark.parametrize("rested", [0.0, 0.05, 1.0, 1e6])
def test_rest_before_the_start_counts_for_the_dwell(rested: float) -> None:
    """A load of 20 t N meets ``B = 10 (0.5 - 0.3 exp(-(t + rested) / 0.2))``."""
    law = DryFriction(0.5, 0.2, dwell=0.2)
    result = simulate(slider(law, Force("a", ramp(20.0, 1.0)), rested=rested), (0.0, 1.0))
    assert told(result) == [("c", 0, 1)]
    t = result.events[0].t
    assert 20.0 * t == pytest.approx(10 * (0.5 - 0.3 * math.exp(-(t + rested) / 0.2)), rel=1e-9)
    if rested > 10:
        assert t == pytest.approx(0.25, rel=1e-9)


def test_memory_the_peak_exists_only_on_breaking_away() -> None:
    """It breaks away at 5 N, then feels 2 N whether it gains or loses speed; stuck again, it breaks away at 5 N."""
    load = piecewise_linear([0.0, 5.0, 6.0, 6.0, 10.0, 16.0], [0.0, 6.0, 6.0, 0.0, 0.0, 7.2])
    result = simulate(slider(DryFriction(0.5, 0.2), Force("a", load)), (0.0, 16.0), **TIGHT)
    assert [mode[1:] for mode in told(result)] == [(0, 1), (1, 0), (0, 1)]
    assert result.events[0].t == pytest.approx(5.0 / 1.2, rel=1e-12)
    assert result.events[2].t == pytest.approx(10.0 + 5.0 / 1.2, rel=1e-12)
    slips = result.mode("c") == 1
    np.testing.assert_allclose(result.force("c")[slips], 2.0)
    assert np.abs(result.force("c")[~slips]).max() == pytest.approx(5.0, rel=1e-9)


# LuGre


def test_lugre_against_exudyn() -> None:
    """The friction test of Exudyn's examples: a mass pulled by a spring at 0.1 m/s, still stuck at t = 25 s."""
    law = LuGre(DryFriction(1.5, 1.0, stribeck_velocity=0.001), 1e5, math.sqrt(1e5), 0.4)
    scene = Scene(
        Body("m", inertia=1.0),
        Drive("pull", velocity=0.1),
        Spring("m", "pull", stiffness=2.0),
        Contact("c", "m", GROUND, law, normal=1.0),
    )
    result = simulate(scene, (0.0, 25.0))
    assert result.stats["states"] == 4 and result.stats["guards"] == 0 and not result.events
    assert result.position("m")[-1] == pytest.approx(1.908839199226505, abs=1e-6)
    assert result.velocity("m")[-1] == pytest.approx(9.42415459e-6, abs=1e-9)
    assert result.y[-1, -1] == pytest.approx(1.18167955e-5, abs=1e-10)


@pytest.mark.parametrize("speed", [0.05, 0.2, -1.0])
def test_lugre_slides_steadily_on_its_curve(speed: float) -> None:
    """Held at a speed, ``z -> g / sigma_0`` and ``r = g(w) + sigma_2 w``."""
    law = LuGre(DryFriction(0.5, 0.3, stribeck_velocity=0.1), stiffness=200.0, damping=2.0, viscous=0.7)
    scene = Scene(
        Body("a", inertia=1.0, velocity=speed),
        Drive("d", velocity=speed),
        Spring("a", "d", stiffness=400.0, damping=100.0),
        Contact("c", "a", GROUND, law, normal=4.0),
    )
    result = simulate(scene, (0.0, 20.0), **TIGHT)
    w = result.velocity("a")[-1]
    assert w == pytest.approx(speed, abs=1e-6)
    g = 4.0 * (0.3 + 0.2 * math.exp(-((w / 0.1) ** 2)))
    assert result.force("c")[-1] == pytest.approx(math.copysign(g, w) + 0.7 * w, rel=1e-6)


# Dahl


def dahl(load: Any) -> Scene:
    """A body of 2 kg on the ground, with a Dahl contact of 50 N/m that slides at ``mu_c N`` = 2 N."""
    return slider(Dahl(DryFriction(0.4, 0.2), stiffness=50.0), Force("a", load))


def test_dahl_sliding_in_closed_form() -> None:
    """In one direction ``dr/dx = sigma_0 (1 - r/F_c)``: ``r = F_c (1 - exp(-sigma_0 x / F_c))`` whatever the speed."""
    result = simulate(slider(Dahl(DryFriction(0.4, 0.2), stiffness=50.0), velocity=2.0), (0.0, 1.0), **TIGHT)
    going = result.velocity("a") > 0
    x = result.position("a")[going]
    np.testing.assert_allclose(result.force("c")[going], 2.0 * (1 - np.exp(-50.0 * x / 2.0)), atol=1e-7)
    assert x.max() > 0.5


def test_dahl_hysteresis_starts_and_turns_with_the_stiffness() -> None:
    """The slope of r over x is sigma_0 at r = 0, and 2 sigma_0 just after a reversal at full friction."""
    scene = Scene(
        Drive("d", velocity=piecewise_linear([0.0, 1.0, 1.0, 2.0], [1.0, 1.0, -1.0, -1.0])),
        Body("a", inertia=1.0),
        Contact("c", "a", "d", Dahl(DryFriction(0.4, 0.2), stiffness=50.0), normal=10.0),
        Spring("a", GROUND, stiffness=1e6, damping=2e3),
    )
    result = simulate(scene, (0.0, 2.0), t_eval=[0.0, 1e-3, 0.999, 1.0, 1.001, 1.999], **TIGHT)
    r = -result.force("c")
    x = result.position("d") - result.position("a")
    assert (r[1] - r[0]) / (x[1] - x[0]) == pytest.approx(50.0, rel=0.03)
    assert (r[4] - r[3]) / (x[4] - x[3]) == pytest.approx(100.0, rel=0.03)
    np.testing.assert_allclose([r[3], r[5]], [2.0, -2.0], rtol=1e-6)


def test_dahl_creeps_where_dry_friction_holds() -> None:
    """A pulsating load below the friction level moves a Dahl contact a little each time; a hard one never.

    How far, scipy says of ``2 v' = F - r`` and ``r' = 50 (v - |v| r / 2)``, from corner to corner of the load.
    """
    pulses = sum((triangle(k, k + 0.5, k + 1.0, slope=3.0) for k in range(1, 5)), triangle(0.0, 0.5, 1.0, slope=3.0))
    soft = simulate(dahl(pulses), (0.0, 5.0))
    hard = simulate(slider(DryFriction(0.4, 0.2), Force("a", pulses)), (0.0, 5.0))
    assert soft.stats["guards"] == 0 and not soft.events
    y, reached = np.zeros(3), [0.0]
    for k in range(10):

        def rates(t: float, y: Any, k: int = k) -> list[float]:
            load = 3.0 * t if k % 2 == 0 else 1.5 - 3.0 * t
            return [y[1], (load - y[2]) / 2.0, 50.0 * (y[1] - abs(y[1]) * y[2] / 2.0)]

        y = solve_ivp(rates, (0.0, 0.5), y, rtol=1e-9, atol=1e-11).y[:, -1]
        reached += [y[0]] * (k % 2)
    found = soft.sample([0.0, 1.0, 2.0, 3.0, 4.0, 5.0]).position("a")
    np.testing.assert_allclose(found, reached, rtol=0, atol=2e-6)
    assert np.all(np.diff(found) > 0.01)
    assert np.all(hard.velocity("a") == 0) and not hard.events


def test_bristles_of_a_contact_that_jumps_open_and_shut() -> None:
    """``N`` jumps off at 1 s and on at 2 s: no force while open, Coulomb friction before and after."""
    normal = step(1.0, 10.0, 0.0) + step(2.0, 0.0, 10.0)
    for law in (
        Dahl(DryFriction(0.5, 0.4), 1e3),
        LuGre(DryFriction(0.5, 0.4, stribeck_velocity=0.1), 1e3, 5.0),
    ):
        result = simulate(slider(law, Force("a", 6.0), velocity=1.0, normal=normal), (0.0, 3.0), t_eval=[0.9, 1.5, 2.9])
        np.testing.assert_allclose(result.force("c"), [4.0, 0.0, 4.0], atol=1e-6)


def test_a_curve_that_begins_at_the_static_coefficient_but_for_roundoff_is_taken() -> None:
    # 0.2 + 0.1 is 0.30000000000000004
    curve = DryFriction(0.3, 0.3, kinetic=lambda v: 0.2 + 0.1 / (1 + v))
    assert curve.mu_k(0.0, 1) > curve.mu_static
    with pytest.raises(ValueError, match=r"kinetic\(0\) = 0.301 must lie between 0 and mu_static = 0.3"):
        DryFriction(0.3, 0.3, kinetic=lambda v: 0.301)


def test_friction_that_presses_its_contact_on_changes_all_four_coefficients() -> None:
    """With ``N = N0 + gain r`` and ``r = s mu N``: ``r = s mu N0 / (1 - s mu gain)``, gain 0.5."""
    found = DryFriction(0.4, 0.2).self_energised(0.5)
    assert (found.mu_s(1), found.mu_c(1)) == pytest.approx((0.4 / 0.8, 0.2 / 0.9), rel=1e-15)
    assert (found.mu_s(-1), found.mu_c(-1)) == pytest.approx((0.4 / 1.2, 0.2 / 1.1), rel=1e-15)
