"""Bad scenes, scene files and arguments of `simulate`, and the words that each refusal must hold."""

from __future__ import annotations

from typing import Any

import numpy as np
from bad_elements import BELT, DRY, INF, NAN, A, B, Case, contact, spring

from stickslip import (
    GROUND,
    Body,
    Damper,
    Drive,
    Force,
    Karnopp,
    Scene,
    signal,
    simulate,
    sine,
)

BLOCK = Scene(A, contact(name="floor", b=GROUND), Force("a", sine(1.0, 1.0)))


def data(table: str, **row: Any) -> Scene:
    """Read a scene file of one row."""
    return Scene.from_dict({table: [row]})


def loaded(load: Any) -> Scene:
    """Read a scene file with a force."""
    return data("forces", body="a", signal=load)


def law(**changes: Any) -> Scene:
    """Read a scene file with a contact of this law."""
    return data("contacts", name="c", a="a", b="b", normal=1, law=changes)


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
    (
        lambda: loaded({"amplitude": 1}),
        ValueError,
        ["forces[0].signal", "the type of the signal is missing", "sum, position, velocity"],
    ),
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
    """Simulate a good scene over a good time span, unless told otherwise."""
    return simulate(scene, span, **options)


ARGUMENTS: list[Case] = [
    (lambda: run(scene=A), TypeError, ["scene must be a Scene", "Body"]),
    (lambda: run(scene=BLOCK.to_dict()), TypeError, ["scene must be a Scene", "dict"]),
    (lambda: run(span=1.0), ValueError, ["t_span", "two times (start, end)", "1.0"]),
    (lambda: run(span=(0, 1, 2)), ValueError, ["t_span", "two times (start, end)", "(0, 1, 2)"]),
    (lambda: run(span=(1, 0)), ValueError, ["t_span must run forward", "(1, 0)", "swap"]),
    (lambda: run(span=(1, 1)), ValueError, ["t_span must run forward", "(1, 1)", "give a later end"]),
    (lambda: run(method="RK4", step=1e-12), ValueError, ["step=1e-12 s makes", "1e+10 are the most"]),
    (lambda: run(method="BDF", max_step=1e-12), ValueError, ["max_step=1e-12 s makes", "shorter time"]),
    (lambda: run(span=(0, INF)), ValueError, ["t_span", "finite", "inf"]),
    (lambda: run(span=(NAN, 1)), ValueError, ["t_span", "finite", "nan"]),
    (lambda: run(span=(-1e308, 1e308)), ValueError, ["the length of t_span", "finite", "inf"]),
    (lambda: run(span=(0.0, 1e300)), ValueError, ["t_span", "1e+99 s", "1e+300", "earlier end"]),
    (lambda: run(span="01"), ValueError, ["t_span must be two times", "'01'"]),
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
    (lambda: run(t_eval=["x"]), TypeError, ["t_eval", "sequence of numbers", "'x'"]),
    (lambda: run(t_eval=[0.5, 0.2]), ValueError, ["t_eval", "increase within [0, 1]", "sort"]),
    (lambda: run(t_eval=[0.1, 0.5, 0.5]), ValueError, ["increase within [0, 1]", "0.5 and then 0.5", "give each once"]),
    (lambda: run(t_eval=[0.5, 2.0]), ValueError, ["t_eval", "increase within [0, 1]", "cut"]),
    # `np.arange(0, 0.3 + 1e-9, 0.1)` ends so
    (lambda: run(span=(0, 0.3), t_eval=[0, 3 * 0.1]), ValueError, ["[0, 0.3] s", "to 0.30000000000000004"]),
    (lambda: run(t_eval=[-0.5, 0.2]), ValueError, ["t_eval", "increase within [0, 1]"]),
    (lambda: run(t_eval=[0.1, NAN]), ValueError, ["t_eval", "increase within [0, 1]"]),
    (lambda: run(t_eval=[NAN]), ValueError, ["t_eval", "increase within [0, 1]"]),
    (lambda: run(t_eval=[[0.1, 0.2]]), ValueError, ["t_eval", "numbers in one line"]),
    (lambda: run(dense_output=False), ValueError, ["dense_output=False", "give t_eval"]),
    (lambda: run(step=0.1), ValueError, ["step=0.1", "leave it out for auto"]),
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
