"""Messages of refused arguments are the package's own: none leaks what Python says of its inner workings."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import stickslip
from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Dahl,
    Damper,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    Karnopp,
    LuGre,
    OneWay,
    Planetary,
    PreSlip,
    Sampled,
    Scene,
    Spring,
    StateSpace,
    Stop,
    Tie,
    When,
    explain,
    feedback,
    piecewise_linear,
    position,
    power,
    saturate,
    sensitivities,
    signal,
    simulate,
    sine,
    step,
    table,
    triangle,
    velocity,
)
from stickslip.equations.system import System

DRY = DryFriction(0.2, 0.1)
SCENE = Scene(Body("a", inertia=1.0, velocity=1.0), Contact("c", "a", GROUND, DRY, normal=1.0))
RESULT = simulate(SCENE, (0.0, 1.0))

GOOD: dict[Callable[..., Any], dict[str, Any]] = {
    Body: {"name": "a", "inertia": 1.0, "velocity": 0.0, "position": 0.0},
    Drive: {"name": "a", "velocity": 1.0, "position": 0.0},
    Contact: {
        "name": "c",
        "a": "a",
        "b": "b",
        "law": DRY,
        "normal": 1.0,
        "rested": 0.0,
        "radius_a": 1.0,
        "radius_b": 1.0,
    },
    Spring: {
        "a": "a",
        "b": "b",
        "stiffness": 1.0,
        "damping": 0.0,
        "rest": 0.0,
        "radius_a": 1.0,
        "radius_b": 1.0,
    },
    Damper: {"a": "a", "b": "b", "damping": 1.0, "radius_a": 1.0, "radius_b": 1.0},
    Force: {"body": "a", "signal": 1.0},
    Tie: {"name": "t", "coefficients": {"a": 1.0, "b": -1.0}},
    Gear: {"name": "g", "a": "a", "b": "b", "ratio": 2.0},
    Planetary: {"name": "p", "sun": "s", "carrier": "c", "ring": "r", "ratio": 2.0},
    Gap: {
        "name": "g",
        "a": "a",
        "b": "b",
        "lower": -1.0,
        "upper": 1.0,
        "stiffness": 1.0,
        "damping": 0.0,
        "radius_a": 1.0,
        "radius_b": 1.0,
    },
    Stop: {
        "name": "s",
        "a": "a",
        "b": "b",
        "lower": -1.0,
        "upper": 1.0,
        "restitution": 0.5,
        "radius_a": 1.0,
        "radius_b": 1.0,
    },
    OneWay: {"name": "o", "a": "a", "b": "b", "radius_a": 1.0, "radius_b": 1.0},
    Block: {
        "name": "b",
        "inputs": [velocity("a")],
        "states": [0.0],
        "derivative": lambda t, x, u: u[0],
        "output": lambda t, x, u: x[0],
        "outputs": 1,
    },
    StateSpace: {
        "name": "s",
        "A": [[0.0]],
        "B": [[1.0]],
        "C": [[1.0]],
        "D": [[0.0]],
        "inputs": [velocity("a")],
        "states": [0.0],
    },
    Sampled: {
        "name": "d",
        "period": 0.1,
        "inputs": [velocity("a")],
        "states": [0.0],
        "update": lambda t, x, u: u[0],
        "output": lambda t, x, u: x[0],
    },
    When: {"name": "w", "quantity": velocity("a"), "direction": 1, "stop": True},
    position: {"body": "a"},
    velocity: {"body": "a"},
    power: {"row": "c"},
    feedback: {"function": math.sin, "derivatives": [math.cos]},
    saturate: {"quantity": velocity("a"), "low": -1.0, "high": 1.0},
    table: {"quantity": velocity("a"), "xs": [0.0, 1.0], "ys": [0.0, 1.0]},
    DryFriction: {
        "mu_static": 0.2,
        "mu_coulomb": 0.1,
        "dwell": 0.1,
        "mu_static_backward": 0.3,
        "mu_coulomb_backward": 0.2,
    },
    PreSlip: {"law": DRY, "velocity": 1e-3, "shape": "linear"},
    Karnopp: {"law": DRY, "velocity": 1e-3},
    LuGre: {"law": DRY, "stiffness": 1e4, "damping": 10.0},
    Dahl: {"law": DRY, "stiffness": 1e4},
    piecewise_linear: {"times": [0.0, 1.0], "values": [0.0, 1.0]},
    triangle: {"start": 0.0, "peak": 1.0, "stop": 2.0, "slope": 1.0},
    step: {"time": 0.0, "before": 0.0, "after": 1.0},
    sine: {"amplitude": 1.0, "frequency": 1.0, "phase": 0.0, "offset": 0.0},
    signal: {"function": math.sin, "breaks": (), "period": 1.0},
    simulate: {
        "scene": SCENE,
        "t_span": (0.0, 1.0),
        "formulation": "contact-force",
        "method": "BDF",
        "rtol": 1e-6,
        "atol": 1e-8,
        "t_eval": [0.0, 1.0],
        "velocity_margin": 0.0,
        "max_step": 1.0,
    },
    explain: {"subject": SCENE, "t_span": (0.0, 1.0)},
    Scene.replace: {"self": SCENE, "name": "a", "inertia": 1.0},
    Scene.regularized: {"self": SCENE, "velocity": 1e-3, "shape": "linear"},
    Scene.from_dict: {"data": SCENE.to_dict()},
    RESULT.sample: {"times": 5},
    RESULT.velocity: {"body": "a"},
    RESULT.force: {"contact": "c"},
    RESULT.mode: {"contact": "c"},
    RESULT.share: {"contact": "c"},
    RESULT.breakaway: {"contact": "c", "direction": 1},
}
"""What can be called, and arguments that it takes."""

STRANGE: list[Any] = [
    None,
    "text",
    "",
    b"bytes",
    True,
    1j,
    math.nan,
    math.inf,
    10**400,
    [],
    ["x"],
    {},
    {"x": None},
    {1, 2},
    object(),
    int,
    math.sin,
    np.array([1.0, 2.0]),
    np.array("x"),
    np.zeros((2, 2)),
    DRY,
    Body("z", inertia=1.0),
    SCENE,
]

LEAKED = re.compile(
    r"__|unsupported operand|object is not|has no attribute|not supported between|must be real number"
    r"|could not convert|unhashable|required positional|unexpected keyword|multiple values|is not iterable|not callable"
    r"|unpack|truth value|ambiguous|'NoneType'|NoneType|subscript|index out of|invalid literal|slice indices"
    r"|has no len|argument of type|inhomogeneous|only .* arrays|float\(\) argument|casting|setting an array"
)
"""What Python and numpy say of their own workings."""


def said(call: Callable[[], Any]) -> str | None:
    """The message of a refusal, None where there is none."""
    try:
        call()
    except (ValueError, TypeError) as error:
        return str(error)
    return None


def own_words(message: str) -> str:
    """A message without what it quotes: values may be anything."""
    return re.sub(r"got .*", "", message, flags=re.DOTALL)


CASES = [(maker, name) for maker, given in GOOD.items() for name in given if name != "self"]


@pytest.mark.parametrize(
    ("maker", "name"), CASES, ids=[f"{getattr(m, '__qualname__', m)}-{n}" for m, n in CASES]
)
def test_strange_values_are_refused_in_our_own_words(maker: Callable[..., Any], name: str) -> None:
    for value in STRANGE:
        given = dict(GOOD[maker])
        self = [given.pop("self")] if "self" in given else []
        given[name] = value
        message = said(lambda self=self, given=given: maker(*self, **given))  # type: ignore[misc]
        if message is not None:
            assert not LEAKED.search(own_words(message)), f"{name}={value!r}: {message}"
            assert len(message) > 15, f"{name}={value!r}: {message}"


@pytest.mark.parametrize("maker", [m for m in GOOD if isinstance(m, type)], ids=lambda m: m.__name__)
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


@pytest.mark.parametrize("strange", [*STRANGE, (), (1,)], ids=lambda v: type(v).__name__)
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
    # what users do not make, or make from other arguments
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
        (lambda v: v > 1, "has no value before the simulation runs.*When"),
        (lambda v: v * sine(1.0, 1.0), r"feedback\(lambda a, b: a \* b"),
        (lambda v: sine(1.0, 1.0) * v, r"feedback\(lambda a, b: a \* b, signal, quantity\)"),
        (lambda v: sine(1.0, 1.0) ** 2, r"signal\(lambda t: s\(t\)\*\*2\)"),
        (
            lambda v: Body("a", inertia="1 kg"),
            "body 'a': inertia must be a number, got '1 kg'; give it in SI",
        ),
        (lambda v: RESULT("0.5"), "a result is called with times in s, got '0.5'"),
        (lambda v: RESULT.plot(bodies=["x"]), "no body is called 'x'"),
        (
            lambda v: Scene(Body("a", inertia=1.0), Contact("c", "a", "GROUND", DRY, normal=1.0)),
            "no body is called 'GROUND'; known are 'a', 'ground'; the ground is GROUND, without quotes",
        ),
        (
            lambda v: sensitivities(SCENE, (0.0, 1.0), ["c.mu_static"]),
            "not 'mu_static'; write 'c.law.mu_static'",
        ),
    ],
)
def test_what_a_new_user_writes_is_answered_with_what_to_write(
    written: Callable[[Any], Any], message: str
) -> None:
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
