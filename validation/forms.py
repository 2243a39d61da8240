"""Rows about linear feedback: springs and dampers as elements, as sums of quantities, and as Python functions."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    Result,
    Scene,
    Spring,
    feedback,
    position,
    relative_velocity,
    simulate,
    sine,
    stretch,
    triangle,
    velocity,
)
from validation.rows import Row, require
from validation.tried import try_each

SCENES = 200
STOP = 8.0
TOLERANCES = {"rtol": 1e-9, "atol": 1e-11}


def random_scene(number: int, form: str) -> Scene:
    """Return two blocks on a drive with dry friction, with a normal force that follows a velocity in every third scene.

    Springs and dampers are `elements`, `sums` of quantities, or `code`.
    """
    rng = np.random.default_rng(number)
    k1, k2, c1, c2, inertia1, inertia2 = rng.uniform(0.5, 4.0, 6).tolist()
    radius = float(rng.uniform(0.5, 2.0))
    law = DryFriction(0.5, 0.3, dwell=float(rng.choice([0.0, 0.2])))
    starts = float(rng.uniform(-2, 2)), float(rng.uniform(-1, 1))
    normals = float(rng.uniform(0.5, 3.0)), float(rng.uniform(0.5, 2.0))
    press: Any = normals[1]
    if number % 3 == 2:
        # it opens where the block runs back fast
        follows = feedback(lambda v: 2.0 * v, velocity("a")) if form == "code" else 2.0 * velocity("a")
        press = normals[1] + follows
    base: list[Any] = [
        Body("a", inertia=inertia1, position=starts[0]),
        Body("b", inertia=inertia2, velocity=starts[1]),
        Drive("belt", velocity=0.3 + sine(0.2, 0.31)),
        Contact("ca", "a", "belt", law, normal=normals[0]),
        Contact("cb", "b", "a", law, normal=press, radius_b=radius),
    ]
    load = triangle(1.0, 2.0, 4.0, slope=1.5)
    if form == "elements":
        return Scene(
            *base,
            Spring("a", GROUND, stiffness=k1),
            Damper("a", GROUND, damping=0.1 * c1),
            Spring("b", "a", stiffness=k2, damping=0.1 * c2, radius_b=radius),
            Force("b", load),
        )
    if form == "sums":
        pull = k2 * stretch("cb") + 0.1 * c2 * relative_velocity("cb")
        own = -k1 * position("a") - 0.1 * c1 * velocity("a")
        return Scene(*base, Force("a", own + radius * pull), Force("b", load - pull))
    link = feedback(lambda s, w: k2 * s + 0.1 * c2 * w, stretch("cb"), relative_velocity("cb"))
    own = feedback(lambda x, v: -k1 * x - 0.1 * c1 * v, position("a"), velocity("a"))
    return Scene(*base, Force("a", own + radius * link), Force("b", load - link))


def difference(number: int) -> float:
    """Return the largest difference of event times and of the end by sums and by code; other events are wrong."""
    one = simulate(random_scene(number, "sums"), (0.0, STOP))
    two = simulate(random_scene(number, "code"), (0.0, STOP), **TOLERANCES)
    require(one.stats["engine"] == "Taylor series", f"sums of quantities take {one.stats['engine']}")
    require(two.stats["engine"] == "CVODE BDF", f"functions take {two.stats['engine']}")
    stories = [[(e.contact, int(e.before), int(e.after)) for e in run.events] for run in (one, two)]
    require(
        stories[0] == stories[1], f"{len(stories[1])} events by code, {len(stories[0])} by sums, or others"
    )
    late = max((abs(a.t - b.t) for a, b in zip(one.events, two.events, strict=True)), default=0.0)
    return max(late, *(abs(last(one, body) - last(two, body)).max() for body in "ab"))


def last(result: Result, body: str) -> Any:
    """Return where a body is at the end, and how fast."""
    return np.array([result.position(body)[-1], result.velocity(body)[-1]])


ROWS = [
    Row(
        "Random scenes",
        "feedback-forms",
        f"{SCENES} scenes with linear feedback as sums of quantities and as code: event times in s, states at the end",
        "the same scenes, as sums and by the series",
        partial(try_each, [(f"scene {n}", partial(difference, n)) for n in range(SCENES)], 60.0),
        1e-5,
        quick=False,
        limit=1200.0,
        tries="scenes in two forms",
    )
]
