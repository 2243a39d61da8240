"""Bad signals, laws and elements, and the words that each refusal must hold."""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np

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
    signal,
    sine,
    step,
    triangle,
)
from stickslip.model.laws.dry_friction import Law

DRY = DryFriction(0.2, 0.1)
A, B, BELT = Body("a", inertia=1.0), Body("b", inertia=1.0), Drive("belt", velocity=1.0)
NAN, INF = math.nan, math.inf

Case = tuple[Callable[[], Any], type[Exception], list[str]]
"""What to call, the error it must end in, and words that the message must hold."""


class Glue(Law):
    """A law that no engine can solve."""


def divides(speed: float) -> float:
    """Return 1 over the speed: a kinetic coefficient that fails at rest."""
    return 1.0 / speed


def contact(**changes: Any) -> Contact:
    """Return a good contact with these changes."""
    return Contact(**({"name": "c", "a": "a", "b": "b", "law": DRY, "normal": 1.0} | changes))


def spring(**changes: Any) -> Spring:
    """Return a good spring with these changes."""
    return Spring(**({"a": "a", "b": "b", "stiffness": 1.0} | changes))


SIGNALS: list[Case] = [
    (lambda: piecewise_linear([0, 1], [0]), ValueError, ["2 times and 1 values", "equally many"]),
    (lambda: piecewise_linear([], []), ValueError, ["0 times", "at least one"]),
    (lambda: piecewise_linear([1, 0], [0, 1]), ValueError, ["times must not decrease", "0 after 1", "sort"]),
    (
        lambda: piecewise_linear([0.060000000000000005, 0.06], [0, 1]),
        ValueError,
        ["0.06 after 0.060000000000000005", "sort"],
    ),
    (
        lambda: piecewise_linear([0, 1, 1, 1], [0, 1, 2, 3]),
        ValueError,
        ["time 1 stands three times", "twice"],
    ),
    (lambda: piecewise_linear([0, NAN], [0, 1]), ValueError, ["piecewise_linear: times", "finite", "nan"]),
    (lambda: piecewise_linear([0, 1], [0, INF]), ValueError, ["piecewise_linear: values", "finite", "inf"]),
    (lambda: piecewise_linear(3, 4), TypeError, ["piecewise_linear: times", "sequence", "3"]),  # type: ignore
    (lambda: piecewise_linear("ab", [0, 1]), TypeError, ["times must be a sequence of numbers", "'ab'"]),  # type: ignore
    (lambda: piecewise_linear([[0, 1]], [1]), TypeError, ["times must be a number", "[0, 1]"]),  # type: ignore
    (lambda: piecewise_linear([0, 1e-320], [0, 1]), ValueError, ["too steep", "same time twice"]),
    (
        lambda: triangle(0, 0, 1, slope=1),
        ValueError,
        ["triangle", "start < peak < stop", "0, 0, 1", "in order"],
    ),
    (lambda: triangle(0, 1, 2, slope=NAN), ValueError, ["triangle: slope", "finite", "nan"]),
    (lambda: triangle(0, 1, 2), TypeError, ["slope"]),  # type: ignore
    (lambda: triangle(0, 1, 2, slope="3"), TypeError, ["triangle: slope", "number", "'3'"]),  # type: ignore
    (lambda: step(INF), ValueError, ["step: time", "finite", "inf"]),
    (lambda: step(0, True), TypeError, ["step: before", "number", "True"]),
    (lambda: sine(1, INF), ValueError, ["sine: frequency", "finite", "inf"]),
    (lambda: sine(1, 1j), TypeError, ["sine: frequency", "number", "1j"]),  # type: ignore
    (lambda: sine(Decimal(1), 1), TypeError, ["sine: amplitude", "number", "Decimal"]),  # type: ignore
    (lambda: sine(10**400, 1), ValueError, ["sine: amplitude", "finite", "inf"]),
    (lambda: signal(3), TypeError, ["signal", "callable", "3", "a number is a signal by itself"]),  # type: ignore
    (lambda: signal(sine(1, 1)), TypeError, ["Sine", "a signal already", "as it is"]),
    (lambda: signal(math.cos, breaks=[2, 1]), ValueError, ["breaks must increase", "(2.0, 1.0)", "sort"]),
    (lambda: signal(math.cos, breaks=[1, 1]), ValueError, ["breaks must increase", "drop doubles"]),
    (lambda: signal(math.cos, breaks=1), TypeError, ["signal: breaks", "sequence", "1"]),  # type: ignore
    (lambda: signal(math.cos, period=0), ValueError, ["period must be positive", "0", "leave it out"]),
    (lambda: signal(math.cos, period=INF), ValueError, ["signal: period", "finite", "inf"]),
    (lambda: sine(1, 1) * sine(1, 1), TypeError, ["scaled by numbers", "signal(function)"]),
    (lambda: sine(1, 1) * NAN, ValueError, ["a signal's factor", "finite", "nan"]),
    (lambda: sine(1, 1) + "x", TypeError, ["a signal's summand", "number", "'x'"]),  # type: ignore
    (lambda: sine(1, 1) - math.cos, TypeError, ["subtrahend", "wrap a function in signal(function)"]),  # type: ignore
]

LAWS: list[Case] = [
    (
        lambda: DryFriction(0.1, 0.2),
        ValueError,
        ["mu_static = 0.1", "below mu_coulomb = 0.2", "swap or equalise"],
    ),
    (lambda: DryFriction(-0.2, -0.3), ValueError, ["mu_static must not be negative", "-0.2"]),
    (lambda: DryFriction(0.2, -0.1), ValueError, ["mu_coulomb must not be negative", "-0.1"]),
    (lambda: DryFriction(NAN, 0.1), ValueError, ["mu_static", "finite", "nan"]),
    (lambda: DryFriction("0.2", 0.1), TypeError, ["mu_static", "number", "'0.2'"]),  # type: ignore
    (lambda: DryFriction(None, 0.1), TypeError, ["mu_static", "number", "None"]),  # type: ignore
    (lambda: DryFriction(0.2, 0.1, dwell=-1), ValueError, ["dwell must not be negative", "-1"]),
    (lambda: DryFriction(0.2, 0.1, dwell=None), TypeError, ["dwell", "number", "None"]),  # type: ignore
    (
        lambda: DryFriction(0.2, 0.1, stribeck_velocity=0),
        ValueError,
        ["stribeck_velocity", "positive", "leave it out"],
    ),
    (
        lambda: DryFriction(0.2, 0.1, stribeck_exponent=0),
        ValueError,
        ["stribeck_exponent must be positive", "0"],
    ),
    (
        lambda: DryFriction(0.2, 0.1, mu_static_backward=0.05),
        ValueError,
        ["mu_static_backward = 0.05", "swap"],
    ),
    (
        lambda: DryFriction(0.2, 0.1, mu_coulomb_backward=0.3),
        ValueError,
        ["mu_coulomb_backward = 0.3", "swap"],
    ),
    (
        lambda: DryFriction(0.2, 0.1, kinetic=0.1),
        TypeError,
        ["kinetic must be callable", "0.1", "mu_coulomb"],
    ),  # type: ignore
    (
        lambda: DryFriction(0.2, 0.1, kinetic=lambda v: 0.3),
        ValueError,
        ["kinetic(0) = 0.3", "mu_static = 0.2"],
    ),
    (lambda: DryFriction(0.2, 0.1, kinetic=lambda v: NAN), ValueError, ["kinetic(0)", "finite", "nan"]),
    (lambda: DryFriction(0.2, 0.1, kinetic=lambda v: "x"), TypeError, ["kinetic(0)", "number", "'x'"]),  # type: ignore
    (
        lambda: DryFriction(0.2, 0.1, kinetic=divides),
        ValueError,
        ["kinetic(0) raised ZeroDivisionError", "at rest"],
    ),
    (
        lambda: DryFriction(0.2, 0.1, kinetic=lambda v: 0.1, stribeck_velocity=1),
        ValueError,
        ["either kinetic or stribeck_velocity"],
    ),
    (lambda: DryFriction(0.2, 0.1, mu=0.3), TypeError, ["mu"]),  # type: ignore
    (lambda: PreSlip(0.2), TypeError, ["PreSlip: law must be DryFriction", "0.2"]),  # type: ignore
    (lambda: PreSlip(DRY, velocity=0), ValueError, ["PreSlip: velocity must be positive", "0"]),
    (
        lambda: PreSlip(DRY, shape="cubic"),
        ValueError,
        ["unknown shape 'cubic'", "'linear', 'tanh', 'arctan'"],
    ),  # type: ignore
    (lambda: PreSlip(PreSlip(DRY)), TypeError, ["PreSlip: law must be DryFriction", "PreSlip("]),  # type: ignore
    (lambda: Karnopp(DRY, velocity=-1), ValueError, ["Karnopp: velocity must be positive", "-1"]),
    (lambda: LuGre(DRY, stiffness=0), ValueError, ["LuGre: stiffness must be positive", "0"]),
    (lambda: LuGre(DRY, stiffness=1, damping=-1), ValueError, ["LuGre: damping must be at least 0", "-1"]),
    (lambda: Dahl(DRY, stiffness=NAN), ValueError, ["Dahl: stiffness", "finite", "nan"]),
]

ELEMENTS: list[Case] = [
    (
        lambda: Scene(Body("a", inertia=0)),
        ValueError,
        ["body 'a'", "inertia must be positive", "0", "Drive", "GROUND"],
    ),
    (lambda: Body("a", inertia=-1), ValueError, ["body 'a'", "inertia must be positive", "-1"]),
    (lambda: Body("a", inertia=1e-310), ValueError, ["body 'a'", "inertia must be positive", "1e-310"]),
    (lambda: Body("a", inertia=NAN), ValueError, ["body 'a': inertia", "finite", "nan"]),
    (lambda: Body("a", inertia=INF), ValueError, ["body 'a': inertia", "finite", "inf"]),
    (lambda: Body("a", inertia="1"), TypeError, ["body 'a': inertia", "number", "'1'"]),  # type: ignore
    (lambda: Body("a", inertia=np.ones(2)), TypeError, ["body 'a': inertia", "number", "array([1., 1.])"]),  # type: ignore
    (lambda: Body("a", inertia=1, velocity=INF), ValueError, ["body 'a': velocity", "finite", "inf"]),
    (lambda: Body("a", inertia=1, velocity=sine(1, 1)), TypeError, ["body 'a': velocity", "number", "Sine"]),  # type: ignore
    (lambda: Body("a", inertia=1, position=NAN), ValueError, ["body 'a': position", "finite", "nan"]),
    (lambda: Body(1, inertia=1), TypeError, ["Body: name", "string", "1"]),  # type: ignore
    (lambda: Body("", inertia=1), TypeError, ["Body: name", "not empty", "''"]),
    (
        lambda: Body(GROUND, inertia=1),
        ValueError,
        ["Body", "'ground' is taken", "rename body 'ground'", "join to GROUND"],
    ),
    (
        lambda: Drive(GROUND, velocity=1),
        ValueError,
        ["Drive", "'ground' is taken", "rename drive 'ground'", "join to GROUND"],
    ),
    (lambda: Body("a"), TypeError, ["inertia"]),  # type: ignore
    (lambda: Body("a", 1.0), TypeError, ["positional"]),  # type: ignore
    (lambda: Body("a", inertia=1, mass=1), TypeError, ["mass"]),  # type: ignore
    (lambda: Drive("d", velocity="fast"), TypeError, ["drive 'd': velocity", "number or a signal", "'fast'"]),  # type: ignore
    (lambda: Drive("d", velocity=math.cos), TypeError, ["drive 'd': velocity", "wrap a function in signal"]),  # type: ignore
    (lambda: Drive("d", velocity=NAN), ValueError, ["drive 'd': velocity", "finite", "nan"]),
    (lambda: Drive(None, velocity=1), TypeError, ["Drive: name", "string", "None"]),  # type: ignore
    (lambda: contact(b="a"), ValueError, ["contact 'c'", "'a' to itself", "two different bodies"]),
    (lambda: contact(law=0.2), TypeError, ["contact 'c'", "friction law", "DryFriction(0.2, 0.1)", "0.2"]),
    (lambda: contact(law=Law()), TypeError, ["contact 'c'", "friction law", "DryFriction(0.2, 0.1)"]),
    (lambda: contact(law=Glue()), TypeError, ["contact 'c'", "friction law", "Glue"]),
    (lambda: contact(law=DryFriction), TypeError, ["contact 'c'", "friction law", "class"]),
    (lambda: contact(normal=INF), ValueError, ["contact 'c': normal", "finite", "inf"]),
    (lambda: contact(normal=[1, 2]), TypeError, ["contact 'c': normal", "number", "[1, 2]"]),
    (lambda: contact(rested=-1), ValueError, ["contact 'c': rested must not be negative", "-1"]),
    (lambda: contact(a=A), TypeError, ["Contact: a must be a name", "Body("]),
    (lambda: spring(b="a"), ValueError, ["spring 'a'-'a'", "'a' to itself", "two different bodies"]),
    (lambda: spring(stiffness=-1), ValueError, ["spring 'a'-'b': stiffness must not be negative", "-1"]),
    (lambda: spring(damping=-1), ValueError, ["spring 'a'-'b': damping must not be negative", "-1"]),
    (lambda: spring(rest=NAN), ValueError, ["spring 'a'-'b': rest", "finite", "nan"]),
    (
        lambda: Damper("a", "b", damping=-2),
        ValueError,
        ["damper 'a'-'b': damping must not be negative", "-2"],
    ),
    (lambda: Damper("a", "", damping=2), TypeError, ["Damper: b", "name", "''"]),
    (lambda: Force("a", None), TypeError, ["force on 'a': signal", "number or a signal", "None"]),  # type: ignore
    (lambda: Force(A, 1.0), TypeError, ["Force: body must be a name", "Body("]),  # type: ignore
]
