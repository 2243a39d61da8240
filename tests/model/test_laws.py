"""Friction laws: coefficients, Stribeck curves, anisotropy, plain data."""

import json
import math
import pickle
from dataclasses import FrozenInstanceError, dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stickslip import Dahl, DryFriction, Karnopp, LuGre, PreSlip
from stickslip.model.laws.dry_friction import Law, law_from_dict

PLAIN = DryFriction(0.2, 0.1)
STRIBECK = DryFriction(0.4, 0.1, stribeck_velocity=0.05, stribeck_exponent=1.5)
SKEW = DryFriction(0.2, 0.1, mu_static_backward=0.5, mu_coulomb_backward=0.3)


def lubricated(speed: float) -> float:
    return 0.1 + 0.02 * speed


def test_plain_friction_does_not_depend_on_speed() -> None:
    assert not PLAIN.curved
    assert [PLAIN.mu_k(v, 1) for v in (0.0, 1.0, 1e300)] == [0.1, 0.1, 0.1]
    assert PLAIN.mu_k_slope(1.0, 1) == 0.0
    assert (PLAIN.mu_s(1), PLAIN.mu_s(-1), PLAIN.dwell) == (0.2, 0.2, 0.0)


def test_numbers_become_floats() -> None:
    law = DryFriction(1, np.float32(0.5), dwell=np.int64(2), stribeck_velocity=1, stribeck_exponent=2)
    values = (law.mu_static, law.mu_coulomb, law.dwell, law.stribeck_velocity, law.stribeck_exponent)
    assert values == (1.0, 0.5, 2.0, 1.0, 2.0)
    assert all(type(v) is float for v in values)


def test_the_stribeck_curve_falls_from_static_to_coulomb() -> None:
    assert STRIBECK.curved
    assert STRIBECK.mu_k(0.0, 1) == 0.4
    assert STRIBECK.mu_k(0.05, 1) == pytest.approx(0.1 + 0.3 / math.e)
    assert STRIBECK.mu_k(0.1, 1) == pytest.approx(0.1 + 0.3 * math.exp(-(2**1.5)))
    assert STRIBECK.mu_k(1e6, 1) == 0.1


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0, 40.0])
def test_the_stribeck_curve_never_overflows(exponent: float) -> None:
    law = DryFriction(0.4, 0.1, stribeck_velocity=1e-300, stribeck_exponent=exponent)
    assert law.mu_k(1e300, 1) == pytest.approx(0.1)
    assert law.mu_k_slope(1e300, 1) == pytest.approx(0.0, abs=1e-200)


def test_equal_coefficients_with_a_stribeck_velocity_are_plain() -> None:
    law = DryFriction(0.2, 0.2, stribeck_velocity=0.1)
    assert law.mu_k(0.05, 1) == 0.2
    assert law.mu_k_slope(0.05, 1) == 0.0


@settings(deadline=None)
@given(st.floats(1e-3, 1.0), st.sampled_from([-1, 1]), st.floats(0.5, 3.0))
def test_slopes_are_derivatives(speed: float, direction: int, exponent: float) -> None:
    law = DryFriction(0.4, 0.1, stribeck_velocity=0.2, stribeck_exponent=exponent, mu_static_backward=0.6)
    h = 1e-5 * speed
    difference = (law.mu_k(speed + h, direction) - law.mu_k(speed - h, direction)) / (2 * h)
    assert law.mu_k_slope(speed, direction) == pytest.approx(difference, rel=1e-5, abs=1e-7)


def test_the_slope_at_rest_is_finite() -> None:
    """It is the slope just beside rest: 0 with the exponent 1.5, and -(mu_s - mu_c) / v_s with the exponent 1."""
    assert abs(STRIBECK.mu_k_slope(0.0, 1)) < 1e-40
    linear = DryFriction(0.4, 0.1, stribeck_velocity=0.2, stribeck_exponent=1.0)
    assert linear.mu_k_slope(0.0, 1) == pytest.approx(-1.5, rel=1e-12)


@pytest.mark.parametrize("exponent", [0.5, 0.8])
@pytest.mark.parametrize("speed", [1e-7, 1e-5, 1e-2])
def test_steep_slopes_are_derivatives(speed: float, exponent: float) -> None:
    """mu' = -(mu_s - mu_c) p r^p exp(-r^p) / v with r = v / v_s: a solver is given less near rest, a user is not."""
    law = DryFriction(0.4, 0.1, stribeck_velocity=0.2, stribeck_exponent=exponent)
    power = (speed / 0.2) ** exponent
    exact = -0.3 * exponent * power * math.exp(-power) / speed
    assert law.mu_k_slope(speed, 1) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e-10])
def test_slopes_of_functions_do_not_depend_on_the_unit_of_speed(scale: float) -> None:
    law = DryFriction(0.4, 0.1, kinetic=lambda v: 0.1 + 0.3 * math.exp(-v / scale))
    assert law.mu_k_slope(0.7 * scale, 1) * scale == pytest.approx(-0.3 * math.exp(-0.7), rel=1e-6)


def test_forward_and_backward_may_differ() -> None:
    assert (SKEW.mu_s(1), SKEW.mu_c(1), SKEW.mu_k(1.0, 1)) == (0.2, 0.1, 0.1)
    assert (SKEW.mu_s(-1), SKEW.mu_c(-1), SKEW.mu_k(1.0, -1)) == (0.5, 0.3, 0.3)
    one = DryFriction(0.2, 0.1, mu_static_backward=0.5)
    assert (one.mu_s(-1), one.mu_c(-1)) == (0.5, 0.1)


def test_any_other_kinetic_curve() -> None:
    law = DryFriction(0.2, 0.1, kinetic=lubricated)
    assert law.curved
    assert law.mu_k(2.0, 1) == law.mu_k(2.0, -1) == pytest.approx(0.14)
    assert law.mu_k_slope(2.0, 1) == pytest.approx(0.02)
    assert law.mu_k_slope(0.0, 1) == pytest.approx(0.02)


@pytest.mark.parametrize("shape", [(), (1,)], ids=["of no dimension", "of one number"])
def test_a_kinetic_curve_that_returns_arrays(shape: tuple[int, ...]) -> None:
    """As interpolators of scipy do."""
    law = DryFriction(0.2, 0.1, kinetic=lambda v: np.full(shape, lubricated(v)))
    assert law.mu_k(2.0, 1) == DryFriction(0.2, 0.1, kinetic=lubricated).mu_k(2.0, 1)
    assert law.least(1) == 0.1


def test_a_kinetic_curve_that_returns_two_numbers_is_refused() -> None:
    with pytest.raises(TypeError, match=r"kinetic\(0\) must be a number"):
        DryFriction(0.2, 0.1, kinetic=lambda v: np.array([0.1, 0.1]))
    law = DryFriction(0.2, 0.1, kinetic=lambda v: 0.1 if v < 1 else np.array([0.1, 0.1]))
    with pytest.raises(ValueError, match=r"kinetic\(2\) = array\(\[0.1, 0.1\]\); return a finite number"):
        law.mu_k(2.0, 1)


@pytest.mark.parametrize("value", [math.nan, math.inf, -0.1])
def test_a_kinetic_curve_that_gives_nonsense_while_it_runs(value: float) -> None:
    law = DryFriction(0.2, 0.1, kinetic=lambda v: 0.1 if v < 1 else value)
    with pytest.raises(ValueError, match=r"kinetic\(2\).*at least 0"):
        law.mu_k(2.0, 1)


def test_laws_are_frozen_and_compare_by_value() -> None:
    assert DryFriction(0.2, 0.1) == PLAIN
    assert hash(DryFriction(0.2, 0.1)) == hash(PLAIN)
    with pytest.raises(FrozenInstanceError):
        PLAIN.mu_static = 0.3  # type: ignore[misc]


@pytest.mark.parametrize(
    "law", [PreSlip(PLAIN), Karnopp(PLAIN), LuGre(PLAIN, stiffness=1e4), Dahl(PLAIN, stiffness=1e4), PLAIN]
)
def test_every_law_has_dry_friction_at_its_core(law: Law) -> None:
    assert law.core is PLAIN
    assert pickle.loads(pickle.dumps(law)) == law


@pytest.mark.parametrize(
    "law",
    [
        PLAIN,
        STRIBECK,
        SKEW,
        DryFriction(0.2, 0.1, dwell=0.1),
        PreSlip(STRIBECK, velocity=1e-2, shape="tanh"),
        Karnopp(SKEW),
        LuGre(STRIBECK, stiffness=1e4, damping=10.0),
        Dahl(PLAIN, stiffness=1e3),
    ],
)
def test_plain_data_and_back(law: Law) -> None:
    data = law.to_dict()
    assert law_from_dict(json.loads(json.dumps(data)), "law") == law
    assert data["type"] == type(law).__name__


def test_defaults_are_left_out_of_the_data() -> None:
    assert PLAIN.to_dict() == {"type": "DryFriction", "mu_static": 0.2, "mu_coulomb": 0.1}
    assert law_from_dict({"mu_static": 0.2, "mu_coulomb": 0.1}, "law") == PLAIN


def test_a_kinetic_curve_is_no_data() -> None:
    with pytest.raises(ValueError, match=r"DryFriction\.kinetic is code, not data"):
        DryFriction(0.2, 0.1, kinetic=lubricated).to_dict()


def test_another_law_keeps_its_parameters() -> None:
    @dataclass(frozen=True)
    class Mine(Law):
        law: DryFriction
        extra: float = 1.0

    assert Mine(PLAIN, 2.0).core is PLAIN
    assert Mine(PLAIN, 2.0).to_dict() == {"type": "Mine", "law": PLAIN.to_dict(), "extra": 2.0}
