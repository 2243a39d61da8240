"""Calls of all that is public, with valid arguments; tests of wrong arguments change these one by one."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

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
    Mode,
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
    benchmark,
    explain,
    feedback,
    join,
    load,
    normal,
    output,
    pid,
    piecewise_linear,
    plots,
    position,
    power,
    relative_velocity,
    saturate,
    signal,
    simulate,
    sine,
    step,
    stretch,
    table,
    triangle,
    velocity,
)

DRY = DryFriction(0.2, 0.1)
SCENE = Scene(
    Body("a", inertia=1.0, velocity=1.0),
    Contact("c", "a", GROUND, DRY, normal=1.0),
    Gap("g", "a", GROUND, upper=2.0, stiffness=1.0),
    StateSpace("s", [[-1.0]], [[1.0]], [[1.0]], inputs=[position("a")]),
)
RESULT = simulate(SCENE, (0.0, 1.0))
JOINED = join([RESULT])


@dataclass(frozen=True)
class Call:
    """A public callable, valid arguments, and which other kinds of values some arguments may have."""

    made: Callable[..., Any]
    given: dict[str, Any]
    also: dict[str, set[str]] = field(default_factory=dict)
    draws: bool = False

    @property
    def name(self) -> str:
        owner = getattr(self.made, "__self__", None)
        name = getattr(self.made, "__qualname__", type(self.made).__name__)
        return name if owner is None else f"{type(owner).__name__}.{name.rpartition('.')[2]}"


def _calls() -> list[Call]:
    ends: dict[str, Any] = {"a": "a", "b": "b"}
    radii = {"radius_a": 1.0, "radius_b": 1.0}
    limits = {"lower": -1.0, "upper": 1.0}
    loads, numbers, alone = {"load"}, {"numbers", "matrix"}, {"number", "load", "numbers"}
    code: dict[str, Any] = {"name": "b", "inputs": [velocity("a")], "states": [0.0], "outputs": 1}
    in_blocks = {"inputs": alone, "states": {"number"}, "outputs": {"none"}}
    elements = [
        Call(
            Body,
            {"name": "a", "inertia": 1.0, "velocity": 0.0, "position": 0.0, "motion": "rotation"},
            {"motion": {"none"}},
        ),
        Call(
            Drive,
            {"name": "a", "velocity": 1.0, "position": 0.0, "motion": "rotation"},
            {"velocity": loads, "motion": {"none"}},
        ),
        Call(
            Contact,
            {
                "name": "c",
                **ends,
                "law": DRY,
                "normal": 1.0,
                "rested": 0.0,
                "deflection": 0.0,
                "slipping": True,
            }
            | radii,
            {"normal": loads},
        ),
        Call(Spring, ends | {"stiffness": 1.0, "damping": 0.0, "rest": 0.0} | radii),
        Call(Damper, ends | {"damping": 1.0} | radii),
        Call(Force, {"body": "a", "signal": 1.0}, {"signal": loads}),
        Call(Tie, {"name": "t", "coefficients": {"a": 1.0, "b": -1.0}}),
        Call(Gear, {"name": "g"} | ends | {"ratio": 2.0}),
        Call(Planetary, {"name": "p", "sun": "s", "carrier": "c", "ring": "r", "ratio": 2.0}),
        Call(Gap, {"name": "g"} | ends | limits | {"stiffness": 1.0, "damping": 0.0} | radii),
        Call(Stop, {"name": "s"} | ends | limits | {"restitution": 0.5} | radii),
        Call(OneWay, {"name": "o"} | ends | radii),
        Call(
            Block,
            code | {"derivative": lambda t, x, u: u[0], "output": lambda t, x, u: x[0]},
            in_blocks | {"output": {"none"}},
        ),
        Call(
            StateSpace,
            {"name": "s", "A": [[0.0]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]], "inputs": [velocity("a")]}
            | {"states": [0.0], "limits": [(-1.0, 1.0)]},
            dict.fromkeys("ABCD", {"number", "none"} | numbers)
            | {"inputs": alone, "states": {"number", "none"}}
            | {"limits": {"none"}},
        ),
        Call(
            Sampled,
            code
            | {"period": 0.1, "update": lambda t, x, u: u[0], "output": lambda t, x, u: x[0]}
            | {"first": 0.0, "held": [0.0]},
            in_blocks | {"first": {"none"}, "held": {"number"}},
        ),
        Call(When, {"name": "w", "quantity": velocity("a"), "direction": 1, "stop": True}),
    ]
    quantities = [
        *(Call(of_body, {"body": "a"}) for of_body in (position, velocity)),
        *(Call(of_row, {"row": "c"}) for of_row in (relative_velocity, stretch, power)),
        Call(normal, {"contact": "c"}),
        Call(type(output).__call__, {"block": "b", "index": 0}),
        Call(lambda function: feedback(function, velocity("a")), {"function": math.sin}),
        Call(
            lambda derivatives: feedback(math.sin, velocity("a"), derivatives=derivatives),
            {"derivatives": [math.cos]},
            {"derivatives": {"none", "function", "result"}},
        ),
        Call(saturate, {"quantity": velocity("a"), "low": -1.0, "high": 1.0}, {"quantity": {"number"}}),
        Call(table, {"quantity": velocity("a"), "xs": [0.0, 1.0], "ys": [0.0, 1.0]}, {"quantity": {"number"}}),
        Call(
            pid,
            {"name": "p", "error": velocity("a"), "kp": 1.0, "ki": 1.0, "kd": 1.0, "rate": velocity("a")}
            | {"low": -1.0, "high": 1.0, "period": 0.1},
            {"error": {"number"}, "rate": {"number", "none"}, "period": {"none"}},
        ),
        Call(velocity("a").__add__, {"other": 1.0}, {"other": loads}),
        Call(velocity("a").__mul__, {"factor": 1.0}),
        Call(velocity("a").__truediv__, {"divisor": 1.0}),
    ]
    optional = ("mu_static_backward", "mu_coulomb_backward", "stribeck_velocity")
    laws = [
        Call(
            DryFriction,
            {"mu_static": 0.2, "mu_coulomb": 0.1, "dwell": 0.1, "stribeck_exponent": 2.0}
            | dict.fromkeys(optional, 0.15),
            {name: {"none"} for name in optional},
        ),
        Call(
            lambda kinetic: DryFriction(0.2, 0.1, kinetic=kinetic),
            {"kinetic": lambda w: 0.1},
            {"kinetic": {"none"}},
        ),
        Call(PreSlip, {"law": DRY, "velocity": 1e-3, "shape": "linear"}),
        Call(Karnopp, {"law": DRY, "velocity": 1e-3}),
        Call(LuGre, {"law": DRY, "stiffness": 1e4, "damping": 10.0, "viscous": 0.0}),
        Call(Dahl, {"law": DRY, "stiffness": 1e4}),
    ]
    signals = [
        Call(piecewise_linear, {"times": [0.0, 1.0], "values": [0.0, 1.0]}),
        Call(triangle, {"start": 0.0, "peak": 1.0, "stop": 2.0, "slope": 1.0}),
        Call(step, {"time": 0.0, "before": 0.0, "after": 1.0}),
        Call(sine, {"amplitude": 1.0, "frequency": 1.0, "phase": 0.0, "offset": 0.0}),
        Call(signal, {"function": math.sin, "breaks": [0.5], "period": 1.0}, {"period": {"none"}}),
        Call(sine(1.0, 1.0).__add__, {"other": 1.0}, {"other": loads}),
        Call(sine(1.0, 1.0).__mul__, {"factor": 1.0}),
    ]
    scenes = [
        Call(
            lambda motion: Scene(Body("a", inertia=1.0), motion=motion),
            {"motion": "rotation"},
            {"motion": {"none"}},
        ),
        Call(SCENE.replace, {"name": "a", "inertia": 1.0}),
        Call(SCENE.with_laws, {"change": lambda law: law}),
        Call(SCENE.regularized, {"velocity": 1e-3, "shape": "linear"}),
        Call(Scene.from_dict, {"data": SCENE.to_dict()}),
        Call(benchmark.flywheel_benchmark, {"law": DRY}),
        Call(benchmark.four_flywheels, {"viscous": 0.0, "law": DRY}),
        Call(
            benchmark.flywheel_chain,
            {"n": 3, "inertias": [1.0] * 3, "velocities": [1.0] * 3, "normals": [1.0] * 2, "viscous": 0.0}
            | {"brake": 1.0, "law": DRY},
            {name: {"none"} for name in ("inertias", "velocities", "normals")} | {"brake": {"none", "load"}},
        ),
    ]
    runs = [
        Call(
            simulate,
            {
                "scene": SCENE,
                "t_span": (0.0, 1.0),
                "formulation": "contact-force",
                "method": "RK4",
                "step": 0.1,
            }
            | {"rtol": 1e-6, "atol": 1e-8, "t_eval": [0.0, 1.0], "velocity_margin": 0.0, "events": []}
            | {"max_step": 1.0, "dense_output": True, "progress": False},
            {"t_eval": {"none"}, "velocity_margin": {"none"}},
        ),
        Call(explain, {"subject": SCENE, "t_span": (0.0, 1.0)}, {"subject": {"result"}, "t_span": {"none"}}),
        Call(join, {"results": [RESULT]}),
        Call(RESULT, {"t": 0.5}, {"t": {"numbers"}}),
    ]
    for read in (RESULT, JOINED):
        runs += [Call(of_body, {"body": "a"}) for of_body in (read.velocity, read.position)]
        for of_row in ("force", "mode", "relative_velocity", "stretch", "power", "normal", "share"):
            runs.append(Call(getattr(read, of_row), {"contact": "c"}))
        runs += [Call(of_block, {"block": "s"}) for of_block in (read.state, read.output)]
        runs += [
            Call(read.breakaway, {"contact": "c", "direction": 1}, {"direction": {"none"}}),
            Call(read.sample, {"times": 5}, {"times": {"numbers"}}),
            Call(read.fit_for_plot, {"points": 0}),
            Call(read.to_csv, {"path": "run.csv", "units": True}, {"units": {"none"}}),
            Call(read.report, {"path": "run.html", "title": "run"}, draws=True),
            Call(read.save, {"path": "run.npz"}),
        ]
    runs += [
        Call(load, {"path": "kept.npz", "scene": SCENE}, {"scene": {"none"}}),
        *(Call(getattr(output, name), {"result": RESULT}) for name in ("columns", "column_units", "summary")),
        Call(output.to_frame, {"result": RESULT}),
        Call(output.to_csv, {"result": RESULT, "path": "run.csv", "units": True}, {"units": {"none"}}),
        Call(output.to_json, {"result": RESULT, "path": "run.json"}),
        Call(output.save, {"result": RESULT, "path": "run.npz"}),
        Call(output.read, {"path": "kept.npz", "scene": SCENE}, {"scene": {"none"}}),
    ]
    of_many = {"bodies": ["a"], "contacts": ["c"]}
    lists = {name: {"none"} for name in (*of_many, "t_span", "axes", "ax")}
    drawings: list[tuple[Callable[..., Any], dict[str, Any]]] = [
        (RESULT.plot, of_many | {"t_span": (0.0, 1.0), "axes": None}),
        (JOINED.plot, of_many | {"t_span": (0.0, 1.0), "axes": None}),
        (SCENE.draw, {"ax": None}),
        (plots.overview, {"result": RESULT} | of_many | {"t_span": (0.0, 1.0), "axes": None}),
        (plots.velocities, {"result": RESULT, "bodies": ["a"], "ax": None}),
        (plots.energy, {"result": RESULT, "ax": None}),
        (plots.block, {"result": RESULT, "name": "s", "ax": None}),
        (plots.stretch, {"result": RESULT, "row": "g", "ax": None}),
        (plots.schematic, {"scene": SCENE, "ax": None}),
    ]
    for of_contact in (plots.characteristic, plots.contact_forces, plots.phase_portrait):
        drawings.append((of_contact, {"result": RESULT, "contact": "c", "ax": None}))
    for of_contacts in (plots.load_of_contacts, plots.modes, plots.normal_forces):
        drawings.append((of_contacts, {"result": RESULT, "contacts": ["c"], "ax": None}))
    pictures = [
        Call(draw, given, {name: lists[name] for name in given if name in lists}, draws=True)
        for draw, given in drawings
    ]
    return [*elements, *quantities, *laws, *signals, *scenes, *runs, *pictures]


CALLS = _calls()

STRANGE: dict[str, list[Any]] = {
    "none": [None],
    "text": ["text", ""],
    "bytes": [b"bytes"],
    "flag": [True, np.bool_(False)],
    "number": [3.0, 1, np.float64(2.0), Mode.STUCK],
    "odd number": [math.nan, math.inf, 10**400, np.array(1.0)],
    "complex": [1j],
    "numbers": [[1.0, 2.0], np.array([1.0, 2.0]), range(3)],
    "empty": [[], ()],
    "texts": [["x"], np.array(["x"])],
    "matrix": [[[1.0]], np.zeros((2, 2))],
    "mixed": [[None], [1.0, "2"]],
    "table": [{}, {"x": None}],
    "set": [{1.0, 2.0}],
    "object": [object(), np.array("x")],
    "function": [lambda *anything: 0.0, int],
    "law": [DRY],
    "body": [Body("z", inertia=1.0)],
    "scene": [SCENE],
    "result": [RESULT],
    "load": [velocity("a"), velocity("a") + sine(1.0, 1.0)],
}
"""Values by their kind."""

LEAKED = re.compile(
    r"__|unsupported operand|object is not|has no attribute|not supported between|must be real number"
    r"|could not convert|unhashable|required positional|unexpected keyword|multiple values|is not iterable|not callable"
    r"|unpack|truth value|ambiguous|'NoneType'|NoneType|subscript|index out of|invalid literal|slice indices"
    r"|has no len|argument of type|inhomogeneous|only .* arrays|float\(\) argument|casting|setting an array"
)
"""What Python and numpy say of their own workings."""
