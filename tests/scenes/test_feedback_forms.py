"""Linear feedback in three forms moves alike: springs and dampers as elements, as sums of quantities, and as code."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
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


@pytest.mark.parametrize("number", range(12))
def test_sums_of_quantities_are_springs_and_dampers(number: int) -> None:
    one, two = (simulate(random_scene(number, form), (0.0, 8.0)) for form in ("elements", "sums"))
    assert two.stats["engine"] == "Taylor series"
    assert [str(e.after) + e.contact for e in one.events] == [str(e.after) + e.contact for e in two.events]
    np.testing.assert_allclose([e.t for e in two.events], [e.t for e in one.events], rtol=0, atol=1e-10)
    for body in "ab":
        assert abs(one.position(body)[-1] - two.position(body)[-1]) < 1e-10
    # the belt gives what one link takes from it, be it an element or a force
    assert two.energy().relative_error < 1e-12


@pytest.mark.parametrize(
    "numbers",
    [range(4), *(pytest.param(range(k, k + 14), marks=pytest.mark.slow) for k in range(4, 32, 14))],
    ids=lambda numbers: str(numbers.start),
)
def test_code_and_sums_agree(numbers: range) -> None:
    for number in numbers:
        one = simulate(random_scene(number, "sums"), (0.0, 8.0))
        two = simulate(random_scene(number, "code"), (0.0, 8.0), rtol=1e-9, atol=1e-11)
        assert (one.stats["engine"], two.stats["engine"]) == ("Taylor series", "CVODE BDF")
        assert [(e.contact, e.before, e.after) for e in one.events] == [
            (e.contact, e.before, e.after) for e in two.events
        ]
        np.testing.assert_allclose([e.t for e in two.events], [e.t for e in one.events], rtol=0, atol=1e-5)
        for body in "ab":
            assert abs(one.position(body)[-1] - two.position(body)[-1]) < 1e-5
            assert abs(one.velocity(body)[-1] - two.velocity(body)[-1]) < 1e-5
