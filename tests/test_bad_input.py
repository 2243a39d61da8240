"""Bad input is refused before anything runs, with errors that name the element, the value and the remedy."""

import math
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np
import pytest

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
    integrate,
    piecewise_linear,
    signal,
    simulate,
    sine,
    step,
    triangle,
)
from stickslip.laws import Law

DRY = DryFriction(0.2, 0.1)
A, B, BELT = Body("a", inertia=1.0), Body("b", inertia=1.0), Drive("belt", velocity=1.0)
BLOCK = Scene(A, Contact("floor", "a", GROUND, DRY, normal=1.0), Force("a", sine(1.0, 1.0)))
NAN, INF = math.nan, math.inf

Case = tuple[Callable[[], Any], type[Exception], list[str]]


class Glue(Law):
    """A law that nothing knows how to solve."""


def divides(speed: float) -> float:
    return 1.0 / speed


def contact(**changes: Any) -> Contact:
    return Contact(**({"name": "c", "a": "a", "b": "b", "law": DRY, "normal": 1.0} | changes))


def spring(**changes: Any) -> Spring:
    return Spring(**({"a": "a", "b": "b", "stiffness": 1.0} | changes))


def data(table: str, **row: Any) -> Scene:
    return Scene.from_dict({table: [row]})


def loaded(load: Any) -> Scene:
    return data("forces", body="a", signal=load)


def law(**changes: Any) -> Scene:
    return data("contacts", name="c", a="a", b="b", normal=1, law=changes)


SIGNALS: list[Case] = [
    (lambda: piecewise_linear([0, 1], [0]), ValueError, ["2 times and 1 values", "equally many"]),
    (lambda: piecewise_linear([], []), ValueError, ["0 times", "at least one"]),
    (lambda: piecewise_linear([1, 0], [0, 1]), ValueError, ["times must not decrease", "0 after 1", "sort"]),
    (
        lambda: piecewise_linear([0, 1, 1, 1], [0, 1, 2, 3]),
        ValueError,
        ["time 1 stands three times", "twice"],
    ),
    (lambda: piecewise_linear([0, NAN], [0, 1]), ValueError, ["piecewise_linear: times", "finite", "nan"]),
    (lambda: piecewise_linear([0, 1], [0, INF]), ValueError, ["piecewise_linear: values", "finite", "inf"]),
    (lambda: piecewise_linear(3, 4), TypeError, ["piecewise_linear: times", "sequence", "3"]),  # type: ignore
    (lambda: piecewise_linear("ab", [0, 1]), TypeError, ["times must be a number", "'a'"]),  # type: ignore
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
        lambda: Body("a", inertia=0),
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

SCENES: list[Case] = [
    (Scene, ValueError, ["no free body", "add at least one Body"]),
    (lambda: Scene(BELT), ValueError, ["no free body", "add at least one Body"]),
    (lambda: Scene([A]), TypeError, ["not an element", "[Body(", "*list"]),  # type: ignore
    (lambda: Scene(A, DRY), TypeError, ["DryFriction(", "not an element", "give Body"]),  # type: ignore
    (lambda: Scene(A, A), ValueError, ["body 'a' stands twice", "rename"]),
    (lambda: Scene(A, Drive("a", velocity=1)), ValueError, ["drive 'a' stands twice", "rename"]),
    (lambda: Scene(Body(GROUND, inertia=1)), ValueError, ["'ground' is taken", "rename body 'ground'"]),
    (lambda: Scene(A, B, contact(), contact()), ValueError, ["contact 'c' stands twice", "rename"]),
    (
        lambda: Scene(A, contact()),
        ValueError,
        ["contact 'c'", "no body is called 'b'", "known are 'a', 'ground'"],
    ),
    (lambda: Scene(A, spring(b="B")), ValueError, ["spring 'a'-'B'", "no body is called 'B'", "known are"]),
    (lambda: Scene(A, BELT, contact(a="belt", b=GROUND)), ValueError, ["contact 'c'", "neither", "join"]),
    (
        lambda: Scene(A, BELT, Damper("belt", GROUND, damping=1)),
        ValueError,
        ["damper", "neither 'belt'", "join"],
    ),
    (lambda: Scene(A, Force("b", 1.0)), ValueError, ["force on 'b'", "known bodies are 'a'"]),
    (lambda: Scene(A, BELT, Force("belt", 1.0)), ValueError, ["force on 'belt'", "drive", "leave it out"]),
    (lambda: Scene(A, Force(GROUND, 1.0)), ValueError, ["force on 'ground'", "leave it out"]),
    (lambda: BLOCK.replace("x", inertia=1), ValueError, ["called 'x'", "known are 'a', 'floor'"]),
    (lambda: BLOCK.replace("a", mass=1), ValueError, ["body 'a'", "unknown field 'mass'", "inertia"]),
    (lambda: BLOCK.replace("a", inertia=0), ValueError, ["body 'a'", "inertia must be positive"]),
    (
        lambda: Scene(A, contact(name="a", b=GROUND)).replace("a", inertia=2),
        ValueError,
        ["a body and a contact are both called 'a'", "rename"],
    ),
    (lambda: BLOCK.with_laws(lambda law: 0.3), TypeError, ["contact 'floor'", "friction law", "0.3"]),  # type: ignore
    (lambda: BLOCK.regularized(velocity=0), ValueError, ["PreSlip: velocity must be positive", "0"]),
    (lambda: BLOCK.regularized(shape="steep"), ValueError, ["unknown shape 'steep'", "'linear'"]),  # type: ignore
]

DATA: list[Case] = [
    (lambda: Scene.from_dict([]), TypeError, ["from_dict", "table", "list"]),  # type: ignore
    (lambda: Scene.from_dict({}), ValueError, ["no free body", "add"]),
    (lambda: Scene.from_dict({"body": []}), ValueError, ["unknown table 'body'", "known are bodies"]),
    (lambda: Scene.from_dict({"bodies": {"name": "a"}}), TypeError, ["bodies must be a list of tables"]),
    (lambda: Scene.from_dict({"bodies": ["a"]}), TypeError, ["bodies[0]", "expected a table", "'a'"]),
    (lambda: data("bodies", name="a"), ValueError, ["bodies[0]", "field 'inertia' is missing", "Body"]),
    (
        lambda: data("bodies", name="a", inertia=1, mass=1),
        ValueError,
        ["bodies[0]", "'mass'", "has name, inertia"],
    ),
    (lambda: data("bodies", name="a", inertia=-1), ValueError, ["bodies[0]", "body 'a'", "positive", "-1"]),
    (lambda: data("bodies", name="a", inertia="1"), TypeError, ["bodies[0]", "body 'a': inertia", "'1'"]),
    (
        lambda: loaded({"type": "saw"}),
        ValueError,
        ["forces[0].signal", "unknown signal type 'saw'", "sine, sum"],
    ),
    (lambda: loaded({"type": ["sine"]}), ValueError, ["forces[0].signal", "unknown signal type ['sine']"]),
    (lambda: loaded({"amplitude": 1}), ValueError, ["forces[0].signal", "unknown signal type None", "sine"]),
    (lambda: loaded({"type": "sine", "amplitude": 1}), TypeError, ["forces[0].signal", "sine", "frequency"]),
    (lambda: loaded({"type": "step", "time": INF}), ValueError, ["forces[0].signal", "step: time", "inf"]),
    (lambda: loaded({"type": "step", "time": 1, "at": 2}), TypeError, ["forces[0].signal", "step", "at"]),
    (lambda: loaded({"type": "sum", "terms": []}), ValueError, ["forces[0].signal", "a list of signals"]),
    (lambda: loaded({"type": "sum", "terms": [1, "x"]}), TypeError, ["forces[0].signal", "number", "'x'"]),
    (
        lambda: loaded([[0, 1], [1, 2]]),
        TypeError,
        ["forces[0]", "force on 'a': signal", "number or a signal"],
    ),
    (lambda: law(mu_static=0.1, mu_coulomb=0.2), ValueError, ["contacts[0].law", "mu_static = 0.1", "swap"]),
    (
        lambda: law(type="Glue"),
        ValueError,
        ["contacts[0].law", "unknown law type 'Glue'", "known are DryFriction"],
    ),
    (lambda: law(mu_static=0.1), TypeError, ["contacts[0].law", "mu_coulomb"]),
    (lambda: law(kinetic="v"), ValueError, ["contacts[0].law", "code", "stribeck_velocity"]),
    (lambda: law(type="PreSlip", law=0.1), TypeError, ["contacts[0].law", "table", "0.1"]),
    (
        lambda: law(type="Dahl", law={"mu_static": 1, "mu_coulomb": 2}, stiffness=1),
        ValueError,
        ["law", "swap"],
    ),
    (
        lambda: data("contacts", name="c", a="a", b="b", normal=1, law=0.2),
        TypeError,
        ["contacts[0].law", "0.2"],
    ),
    (
        lambda: data("contacts", name="c", a="a", b="b", normal=1),
        ValueError,
        ["contacts[0]", "'law' is missing"],
    ),
]


def run(scene: Any = BLOCK, span: Any = (0.0, 1.0), **options: Any) -> Any:
    return simulate(scene, span, **options)


ARGUMENTS: list[Case] = [
    (lambda: run(scene=A), TypeError, ["scene must be a Scene", "Body"]),
    (lambda: run(scene=BLOCK.to_dict()), TypeError, ["scene must be a Scene", "dict"]),
    (lambda: run(span=1.0), ValueError, ["t_span", "two times (start, end)", "1.0"]),
    (lambda: run(span=(0, 1, 2)), ValueError, ["t_span", "two times (start, end)", "(0, 1, 2)"]),
    (lambda: run(span=(1, 0)), ValueError, ["t_span must run forward", "(1, 0)", "swap"]),
    (lambda: run(span=(1, 1)), ValueError, ["t_span must run forward", "(1, 1)"]),
    (lambda: run(span=(0, INF)), ValueError, ["t_span", "finite", "inf"]),
    (lambda: run(span=(NAN, 1)), ValueError, ["t_span", "finite", "nan"]),
    (lambda: run(span="01"), TypeError, ["t_span", "number", "'0'"]),
    (lambda: run(formulation="exact"), ValueError, ["unknown formulation 'exact'", "'contact-force'"]),
    (lambda: run(method="RK45"), ValueError, ["unknown method 'RK45'", "'BDF'", "'RK4'"]),
    (lambda: run(method=None), ValueError, ["unknown method None", "choose from"]),
    (lambda: run(rtol=0), ValueError, ["rtol must lie between", "got 0"]),
    (lambda: run(rtol=1), ValueError, ["rtol must lie between", "0.1", "got 1"]),
    (lambda: run(rtol=1e-20), ValueError, ["rtol must lie between 1e-14", "1e-20"]),
    (lambda: run(rtol="tight"), TypeError, ["rtol", "number", "'tight'"]),
    (lambda: run(atol=0), ValueError, ["atol must lie between", "got 0"]),
    (lambda: run(atol=-1e-9), ValueError, ["atol must lie between", "-1e-09"]),
    (lambda: run(atol=NAN), ValueError, ["atol", "finite", "nan"]),
    (lambda: run(max_step=0), ValueError, ["max_step must lie between", "got 0"]),
    (lambda: run(max_step=-1), ValueError, ["max_step must lie between", "-1"]),
    (lambda: run(max_step=NAN), ValueError, ["max_step", "finite", "nan"]),
    (lambda: run(velocity_margin=-1), ValueError, ["velocity_margin must not be negative", "-1"]),
    (lambda: run(velocity_margin=INF), ValueError, ["velocity_margin", "finite", "inf"]),
    (lambda: run(t_eval=0.5), TypeError, ["t_eval", "sequence of times", "0.5"]),
    (lambda: run(t_eval=["x"]), TypeError, ["t_eval", "sequence of times", "'x'"]),
    (lambda: run(t_eval=[0.5, 0.2]), ValueError, ["t_eval", "increase within [0, 1]", "sort"]),
    (lambda: run(t_eval=[0.5, 0.5]), ValueError, ["t_eval", "increase within [0, 1]"]),
    (lambda: run(t_eval=[0.5, 2.0]), ValueError, ["t_eval", "increase within [0, 1]", "cut"]),
    (lambda: run(t_eval=[-0.5, 0.2]), ValueError, ["t_eval", "increase within [0, 1]"]),
    (lambda: run(t_eval=[0.1, NAN]), ValueError, ["t_eval", "increase within [0, 1]"]),
    (lambda: run(t_eval=[NAN]), ValueError, ["t_eval", "increase within [0, 1]"]),
    (lambda: run(t_eval=[[0.1, 0.2]]), ValueError, ["t_eval", "increase within [0, 1]"]),
    (lambda: run(dense_output=False), ValueError, ["dense_output=False", "give t_eval"]),
    (lambda: run(step=0.1), ValueError, ["step=0.1", "leave it out for BDF"]),
    (lambda: run(method="RK4"), ValueError, ["'RK4' needs step="]),
    (lambda: run(method="Euler", step=0), ValueError, ["step must lie between", "got 0"]),
    (lambda: run(method="RK4", step=0.1, formulation="merged"), ValueError, ["contact-force", "'merged'"]),
    (lambda: run(method="Adams", formulation="multiplier"), ValueError, ["multiplier", "BDF", "'Adams'"]),
    (lambda: run(tolerance=1e-6), TypeError, ["tolerance"]),
    (
        lambda: run(Scene(A, B, contact(law=Karnopp(DRY)))),
        ValueError,
        ["contact 'c'", "'a' and 'b' can move", "use DryFriction"],
    ),
    (
        lambda: run(Scene(A, contact(b=GROUND, normal=signal(lambda t: NAN)))),
        ValueError,
        ["signal function", "returned nan at t=0", "finite number"],
    ),
    (
        lambda: run(Scene(A, contact(b=GROUND, normal=signal(lambda t: np.ones(2))))),
        ValueError,
        ["signal function", "returned array([1., 1.]) at t=0", "one finite number"],
    ),
]


def check(make: Callable[[], Any], error: type[Exception], words: list[str]) -> None:
    with pytest.raises(error) as raised:
        make()
    assert type(raised.value) is error
    for word in words:
        assert word in str(raised.value)


def table(cases: list[Case]) -> Any:
    return pytest.mark.parametrize(
        ("make", "error", "words"),
        [pytest.param(*case, id=f"{i}: {case[2][0]}") for i, case in enumerate(cases)],
    )


@table(SIGNALS)
def test_signals(make: Callable[[], Any], error: type[Exception], words: list[str]) -> None:
    check(make, error, words)


@table(LAWS)
def test_laws(make: Callable[[], Any], error: type[Exception], words: list[str]) -> None:
    check(make, error, words)


@table(ELEMENTS)
def test_elements(make: Callable[[], Any], error: type[Exception], words: list[str]) -> None:
    check(make, error, words)


@table(SCENES)
def test_scenes(make: Callable[[], Any], error: type[Exception], words: list[str]) -> None:
    check(make, error, words)


@table(DATA)
def test_plain_data(make: Callable[[], Any], error: type[Exception], words: list[str]) -> None:
    check(make, error, words)


@table(ARGUMENTS)
def test_arguments_of_simulate(
    make: Callable[[], Any], error: type[Exception], words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def started(*_: Any, **__: Any) -> None:
        pytest.fail("an engine was made before the input was checked")

    for engine in ("Engine", "MultiplierEngine", "FixedStepEngine"):
        monkeypatch.setattr(integrate, engine, started)
    check(make, error, words)


# what can be found out only on the way


def late(value: Any) -> Callable[[float], Any]:
    return lambda t: 1.0 if t < 0.5 else value


@pytest.mark.parametrize(
    ("load", "words"),
    [
        (signal(late(NAN)), ["returned nan at t=", "finite number"]),
        (signal(late(np.ones(2))), ["returned array", "one finite number"]),
        (signal(late("3")), ["returned '3'", "one finite number"]),
        (signal(late(None)), ["returned None", "one finite number"]),
        (signal(late(1j)), ["returned 1j", "one finite number"]),
        (signal(lambda t: 1 / (t - 0.5), breaks=[0.5]), ["ZeroDivisionError", "at t=0.5", "finite number"]),
        (signal(lambda t: math.sqrt(0.5 - t)), ["math domain error", "finite number"]),
    ],
)
@pytest.mark.parametrize("kind", ["force", "normal", "drive"])
def test_loads_that_turn_bad_on_the_way(load: Any, words: list[str], kind: str) -> None:
    elements = {
        "force": (A, Force("a", load)),
        "normal": (A, contact(b=GROUND, normal=load)),
        "drive": (A, Drive("d", velocity=load), contact(b="d")),
    }
    with pytest.raises((SimulationError, ValueError)) as raised:
        simulate(Scene(*elements[kind]), (0.0, 1.0))
    for word in words:
        assert word in str(raised.value)


def test_a_law_that_turns_bad_on_the_way_keeps_what_was_computed() -> None:
    law = DryFriction(0.2, 0.1, kinetic=lambda v: 0.1 if v < 0.5 else NAN)
    scene = Scene(A, contact(b=GROUND, law=law), Force("a", 1.1))
    with pytest.raises(SimulationError, match=r"kinetic\([0-9.]+\) = nan") as raised:
        simulate(scene, (0.0, 1.0))
    assert "laws of the scene" in str(raised.value)
    assert raised.value.modes["c"].name == "FORWARD"
