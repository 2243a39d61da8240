"""Rows about going on: a run that is cut at many times, each part from the final scene of the one before."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from stickslip import (
    GROUND,
    Block,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gap,
    Gear,
    LuGre,
    OneWay,
    PreSlip,
    Result,
    Sampled,
    Scene,
    Spring,
    StateSpace,
    Stop,
    feedback,
    output,
    pid,
    position,
    power,
    relative_velocity,
    saturate,
    simulate,
    sine,
    stretch,
    table,
    triangle,
    velocity,
)
from validation.rows import Row, Wrong, worst

continuation_row = partial(Row, "Continuation")
CUTS = 50
DRY = DryFriction(0.4, 0.25, dwell=0.3)


def dwell() -> Scene:
    """Three blocks on a belt that swings, bound by springs."""
    return Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=2.0, velocity=0.3),
        Body("c", inertia=0.5),
        Drive("belt", velocity=0.5 * sine(1.0, 0.4) + 0.1),
        Spring("a", "b", stiffness=30.0, damping=0.2),
        Spring("b", GROUND, stiffness=10.0, rest=0.1),
        Contact("ca", "a", "belt", DRY, normal=5.0, rested=0.1),
        Contact("cb", "b", "belt", DryFriction(0.3, 0.2, mu_static_backward=0.5), normal=8.0),
        Contact("cc", "c", "belt", DRY, normal=triangle(0.5, 1.0, 1.5, slope=20.0) + 3.0),
    )


def on_a_belt(law: Any) -> Scene:
    """A block on a belt, held by a spring."""
    return Scene(
        Body("a", inertia=1.0, position=0.2),
        Drive("belt", velocity=0.2),
        Spring("a", GROUND, stiffness=20.0),
        Contact("rub", "a", "belt", law, normal=5.0),
    )


def blocks() -> Scene:
    """A motor with a lag, and a controller that swings with it, against dry friction; a counter reads it in samples."""
    lag = StateSpace("lag", [[-5.0]], [[5.0]], [[1.0]], inputs=[output("pi")])
    steps = Sampled(
        "steps",
        period=0.13,
        inputs=[position("m")],
        states=[0.0],
        update=lambda t, x, u: 0.5 * x[0] + u[0],
        output=lambda t, x, u: 0.1 * x[0] - 0.2 * u[0],
    )
    return Scene(
        Body("m", inertia=1.0),
        Contact("rub", "m", GROUND, DryFriction(0.8, 0.5, dwell=0.2), normal=1.0),
        lag,
        steps,
        pid("pi", sine(1.0, 0.3) - position("m"), kp=2.0, ki=0.3, kd=1.5, rate=-1 * velocity("m")),
        Force("m", output("lag") + output("steps")),
    )


def sampled() -> Scene:
    """A sampled controller that hunts."""
    controller = pid(
        "pid",
        1 - position("m"),
        kp=3.0,
        ki=4.0,
        kd=6.0,
        rate=-1 * velocity("m"),
        period=0.02,
        low=-4.0,
        high=4.0,
    )
    rub = Contact("rub", "m", GROUND, DryFriction(1.5, 1.0), normal=1.0)
    return Scene(Body("m", inertia=1.0), rub, controller, Force("m", output("pid")))


def gaps() -> Scene:
    """A hammer between gaps and rigid stops behind a one-way clutch and a gear."""
    return Scene(
        Body("motor", inertia=0.2),
        Body("shaft", inertia=0.8),
        Body("hammer", inertia=1.0, velocity=0.4),
        Gear("gear", "motor", "shaft", ratio=2.0),
        OneWay("free", "shaft", "hammer"),
        Gap("gap", "hammer", GROUND, lower=-0.5, upper=0.4, stiffness=200.0, damping=3.0),
        Stop("stop", "shaft", GROUND, lower=-0.8, upper=0.7, restitution=0.6),
        Spring("shaft", GROUND, stiffness=4.0),
        Contact("rub", "hammer", GROUND, DryFriction(0.2, 0.1, dwell=0.1), normal=1.5),
        Force("motor", sine(1.5, 0.6)),
    )


def tables() -> Scene:
    """A block whose normal force follows its way through 0, pulled by a limited force and by a map."""
    return Scene(
        Body("a", inertia=1.0, position=-0.3),
        Drive("belt", velocity=sine(0.4, 0.3)),
        Contact("rub", "a", "belt", DRY, normal=1.0 + 4.0 * position("a")),
        Contact("floor", "a", GROUND, DryFriction(0.3, 0.2), normal=0.5 - 2.0 * velocity("a")),
        Force("a", -table(stretch("rub"), [-1.0, 0.0, 0.5], [-2.0, 0.0, 2.5])),
        Force("a", saturate(-3.0 * relative_velocity("rub"), -0.5, 0.5) + sine(1.0, 0.7)),
    )


def functions() -> Scene:
    """A dry pendulum that is driven, whose pivot grows hot and slippery: the heat is a block's state."""
    heat = Block(
        "heat",
        inputs=[power("pivot")],
        states=[0.0],
        derivative=lambda t, x, u: u - 0.1 * x,
        output=lambda t, x, u: x,
    )
    weight = feedback(lambda angle: -9.81 * math.sin(angle), position("bob"))
    pivot = Contact("pivot", "bob", GROUND, DryFriction(0.5, 0.4), normal=2.0 - 0.3 * output("heat"))
    return Scene(Body("bob", inertia=1.0, position=2.0), pivot, heat, Force("bob", weight + sine(2.0, 0.4)))


CASES: dict[str, tuple[Callable[[], Scene], float, str]] = {
    "dwell": (dwell, 20.0, "blocks on a belt that swings, with dwell times"),
    "bristles": (lambda: on_a_belt(LuGre(DRY, stiffness=1e4, damping=50.0)), 10.0, "a block with bristles"),
    "pre-slip": (
        lambda: on_a_belt(PreSlip(DryFriction(0.4, 0.25), 1e-3)),
        10.0,
        "a block with a slip state",
    ),
    "blocks": (blocks, 20.0, "a controller, a lag and a sampled filter around a block with friction"),
    "sampled": (sampled, 40.0, "a sampled controller with limits that hunts"),
    "gaps": (gaps, 20.0, "gap, stop, one-way clutch and gear"),
    "tables": (tables, 20.0, "tables, limits, and normal forces that follow the motion through 0"),
    "functions": (functions, 20.0, "a driven pendulum whose pivot's heat is a block's state"),
}
ONLY_CVODE = ("bristles", "pre-slip", "functions")
SERIES: dict[str, Any] = {"method": "series"}
CVODE: dict[str, Any] = {"method": "BDF", "rtol": 1e-12, "atol": 1e-14}
"""The pendulum passes near its upper rest: what solvers err by there grows a thousandfold."""


def difference(one: Result, parts: list[Result]) -> float:
    """Return the largest difference of event times over the span, and of the end; other events are wrong."""
    events = [event for part in parts for event in part.events]
    story = [[(e.contact, int(e.before), int(e.after)) for e in run] for run in (events, one.events)]
    if story[0] != story[1]:
        k = next((k for k, (a, b) in enumerate(zip(*story, strict=False)) if a != b), min(map(len, story)))
        raise Wrong(f"event {k} of {len(story[0])} is another than in one run of {len(story[1])}")
    span = float(one.t[-1] - one.t[0])
    late = max((abs(a.t - b.t) / span for a, b in zip(events, one.events, strict=True)), default=0.0)
    names = [body.name for body in one.scene.bodies]
    ends = [[run.velocity(name)[-1] for name in names] for run in (parts[-1], one)]
    ways = [[run.position(name)[-1] for name in names] for run in (parts[-1], one)]
    return max(late, worst(ends[0], ends[1], 1.0), worst(ways[0], ways[1], 1.0))


def continued(name: str, options: dict[str, Any], cuts: int = CUTS, seed: int = 0) -> tuple[float, str]:
    """Return by how much a run that is cut differs from one that is not."""
    build, stop, _ = CASES[name]
    whole = simulate(build(), (0.0, stop), **options)
    inner = np.sort(np.random.default_rng(seed).uniform(0.0, stop, cuts)).tolist()
    parts, scene = [], build()
    for start, end in itertools.pairwise([0.0, *inner, stop]):
        parts.append(simulate(scene, (start, end), **options))
        scene = parts[-1].final_scene()
    return difference(whole, parts), f"{len(whole.events)} events; {whole.stats['engine']}"


def rows(cuts: int = CUTS) -> list[Row]:
    """Return the rows: each scene by CVODE, and by the series where it has one."""
    engines = [(name, "BDF", CVODE, 1e-7) for name in CASES]
    engines += [(name, "series", SERIES, 1e-12) for name in CASES if name not in ONLY_CVODE]
    return [
        continuation_row(
            f"continued-{name}/{engine}",
            f"{CASES[name][2]}: events and end of a run cut at {cuts} random times",
            "the same run in one",
            partial(continued, name, options, cuts),
            bound,
            quick=engine == "series",
            limit=120.0,
        )
        for name, engine, options, bound in engines
    ]
