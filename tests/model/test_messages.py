"""Messages of refused arguments are the package's own: none leaks what Python says of its inner workings."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from calls import CALLS, DRY, LEAKED, RESULT, SCENE, STRANGE

import stickslip
from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Scene,
    Spring,
    explain,
    sensitivities,
    sine,
    velocity,
)
from stickslip.equations.system import System

GOOD = {call.made: call.given for call in CALLS if isinstance(call.made, type)}
"""Constructors, and arguments that they take."""


def said(call: Callable[[], Any]) -> str | None:
    """The message of a refusal, None where there is none."""
    try:
        call()
    except (ValueError, TypeError) as error:
        return str(error)
    return None


@pytest.mark.parametrize("maker", GOOD, ids=lambda m: m.__name__)
def test_missing_and_unknown_arguments_are_named_with_what_there_is(maker: type) -> None:
    good = GOOD[maker]
    assert said(lambda: maker(**good)) is None
    message = said(lambda: maker(**good, colour="red"))
    assert message is not None
    assert message.startswith(f"{maker.__name__}: unknown argument 'colour'; it has {next(iter(good))}, ")
    missing = said(maker)
    assert missing is not None
    assert missing.startswith(f"{maker.__name__}: argument '{next(iter(good))}' is missing; it has ")
    many = said(lambda: maker(*range(30)))
    assert many is not None and many.startswith(f"{maker.__name__}: too many positional arguments; it has ")
    twice = said(lambda: maker(next(iter(good.values())), **good))
    assert twice is not None and f"{maker.__name__}: argument '{next(iter(good))}' is given twice" in twice


@pytest.mark.parametrize(
    "strange", [value for some in STRANGE.values() for value in some], ids=lambda v: type(v).__name__
)
def test_elements_of_scenes_are_elements(strange: Any) -> None:
    message = said(lambda: Scene(strange))
    if isinstance(strange, Body):
        return
    assert message is not None and not LEAKED.search(re.sub(r"Scene: .* is not an element", "", message))


def test_all_constructors_are_looked_at() -> None:
    classes = {
        name
        for name in stickslip.__all__
        if isinstance(thing := getattr(stickslip, name), type) and not issubclass(thing, (BaseException, int))
    }
    # leave out classes that users do not make, or make from other arguments
    made = classes - {
        "Branch",
        "Cycle",
        "Event",
        "Fit",
        "Joined",
        "LinearModel",
        "Quantity",
        "Result",
        "Scene",
        "Sensitivities",
        "Signal",
    }
    assert made <= {maker.__name__ for maker in GOOD}, made - {maker.__name__ for maker in GOOD}


@pytest.mark.parametrize(
    ("written", "message"),
    [
        (lambda v: v**2, r"feedback\(lambda x: x\*\*2, quantity\)"),
        (lambda v: 2 / v, r"feedback\(lambda x: 2 / x, quantity\)"),
        (abs, r"feedback\(lambda x: abs\(x\), quantity\)"),
        (math.sin, r"feedback\(lambda x: math.sin\(x\), quantity\)"),
        (np.sin, r"feedback\(lambda x: np.sin\(x\), quantity\)"),
        (lambda v: np.float64(2.0) ** v, r"feedback\(lambda x: np.power\(x\), quantity\)"),
        (lambda v: np.exp(sine(1.0, 1.0)), r"signal\(lambda t: np.exp\(s\(t\)\)\)"),
        (lambda v: np.array([1.0, 2.0]) * v, "must be a number, got array"),
        (lambda v: np.float64(1.0) < v, "has no value before the simulation runs.*When"),
        (lambda v: v > 1, "has no value before the simulation runs.*When"),
        (lambda v: v * sine(1.0, 1.0), r"feedback\(lambda a, b: a \* b"),
        (lambda v: sine(1.0, 1.0) * v, r"feedback\(lambda a, b: a \* b, signal, quantity\)"),
        (lambda v: sine(1.0, 1.0) ** 2, r"signal\(lambda t: s\(t\)\*\*2\)"),
        (
            lambda v: Body("a", inertia="1 kg"),
            "body 'a': inertia must be a number, got '1 kg'; give it in SI",
        ),
        (
            lambda v: Spring("a", GROUND, stiffness=v),
            r"what changes with time or the motion is a Force\(body, load",
        ),
        (
            lambda v: Body("a", inertia=math.sin),
            r"what changes with time or the motion is a Force\(body, load",
        ),
        (lambda v: RESULT("0.5"), "a result is called with times in s, got '0.5'"),
        (lambda v: RESULT.plot(bodies=["x"]), "no body is called 'x'"),
        (
            lambda v: Scene(Body("a", inertia=1.0), Contact("c", "a", "GROUND", DRY, normal=1.0)),
            "no body is called 'GROUND'; known are 'a', 'ground'; the ground is GROUND, without quotes, or 'ground'",
        ),
        (
            lambda v: sensitivities(SCENE, (0.0, 1.0), ["c.mu_static"]),
            "not 'mu_static'; write 'c.law.mu_static'",
        ),
    ],
)
def test_what_a_new_user_writes_is_answered_with_what_to_write(written: Callable[[Any], Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        written(velocity("a"))


def test_a_signal_is_divided_by_a_number() -> None:
    assert sine(3.0, 1.0) / 2 == sine(1.5, 1.0)
    with pytest.raises(ValueError, match="a signal's divisor must not be 0"):
        sine(3.0, 1.0) / 0


def test_a_dwell_beside_a_stribeck_curve_is_said_to_have_no_effect() -> None:
    # 0.3 + (0.7 - 0.3) is not 0.7 in binary; the curve begins at the static coefficient all the same
    law = DryFriction(0.7, 0.3, dwell=0.5, stribeck_velocity=0.1)
    assert law.least(1) == law.mu_s(1) == 0.7
    scene = Scene(Body("a", inertia=1.0), Contact("c", "a", GROUND, law, normal=1.0))
    assert "dwell 0.5 s (without effect beside a Stribeck curve)" in explain(scene)
    assert System(scene).dwelling.size == 0 and not System(scene).holds_more.any()


def test_numbers_of_numpy_are_numbers() -> None:
    v, two = velocity("a"), np.float64(2.0)
    assert (two * v, two + v, two - v) == (2.0 * v, 2.0 + v, 2.0 - v)
    assert (v * two, v + two, v - two, v / two) == (v * 2.0, v + 2.0, v - 2.0, v / 2.0)
    assert two * sine(1.0, 1.0) == sine(2.0, 1.0) and (two == v, two != v) == (False, True)
