"""Several numbers of a scene change at once: only their last values must fit together, not those in between."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import permutations
from typing import Any

import pytest

from stickslip import (
    GROUND,
    Body,
    Contact,
    DryFriction,
    Force,
    Gap,
    Sampled,
    Scene,
    StateSpace,
    continue_cycle,
    fit,
    output,
    piecewise_linear,
    position,
    sensitivities,
    sine,
    table,
    velocity,
)
from stickslip.studies.parameters import named_parameters, with_values
from stickslip.studies.scene_sweep import SceneRuns


def scene(static: float, coulomb: float, lower: float, upper: float) -> Scene:
    return Scene(
        Body("m", inertia=1.0, velocity=1.0),
        Contact("floor", "m", GROUND, DryFriction(static, coulomb), normal=1.0),
        Gap("play", "m", GROUND, lower=lower, upper=upper, stiffness=10.0),
    )


NAMES = ("floor.law.mu_static", "floor.law.mu_coulomb", "play.lower", "play.upper")


@pytest.mark.parametrize("order", list(permutations(range(4))))
def test_the_order_does_not_matter(order: tuple[int, ...]) -> None:
    start, up = (0.5, 0.4, -1.0, 1.0), (0.8, 0.7, 2.0, 3.0)
    for first, last in ((start, up), (up, start)):
        named = named_parameters(scene(*first), [NAMES[k] for k in order], "test")
        assert with_values(scene(*first), named, [last[k] for k in order]) == scene(*last)


def test_values_that_cannot_be_together_are_refused() -> None:
    named = named_parameters(scene(0.5, 0.4, -1.0, 1.0), NAMES, "test")
    with pytest.raises(ValueError, match=r"mu_static = 0.2 is below mu_coulomb = 0.3"):
        with_values(scene(0.5, 0.4, -1.0, 1.0), named, [0.2, 0.3, -2.0, 2.0])


def test_a_sweep_may_vary_two_coefficients_of_a_law() -> None:
    runs = SceneRuns(scene(0.5, 0.4, -1.0, 1.0), (0.0, 20.0), {})
    # 0.5 J at a force of 0.1 N: it comes to rest after 5 m, before the limit of the gap at 10 m
    assert runs(**{NAMES[0]: 0.2, NAMES[1]: 0.1, NAMES[3]: 10.0})["heat floor"] == pytest.approx(0.5)


@pytest.mark.parametrize("name", ["forces[0].signal.terms[0][0].index", "clock.outputs"])
@pytest.mark.parametrize(
    "study",
    [
        lambda scene, name: sensitivities(scene, (0.0, 1.0), [name]),
        lambda scene, name: fit(scene, [name], {"m.velocity": ([0.0, 1.0], [1.0, 0.5])}),
        lambda scene, name: continue_cycle(scene, name, [1.0, 2.0]),
    ],
)
def test_a_number_that_counts_is_no_parameter(study: Callable[[Scene, str], Any], name: str) -> None:
    controlled = Scene(
        Body("m", inertia=1.0, velocity=1.0),
        StateSpace("lag", [[-1.0]], [[1.0]], [[1.0], [2.0]], inputs=[position("m")]),
        Sampled("clock", period=0.1, output=lambda t, x, u: 0.0, outputs=1),
        Force("m", output("lag", 1)),
    )
    with pytest.raises(ValueError, match="is a whole number; name one that can change a little"):
        study(controlled, name)


@pytest.mark.parametrize(
    ("load", "name", "value", "said"),
    [
        (piecewise_linear([0, 1, 2, 4], [0, 1, 1, 0]), "times[1]", 2.5, "times must not decrease, got 2 after 2.5"),
        (piecewise_linear([0, 1, 1, 4], [0, 1, 2, 0]), "times[3]", 1.0, "time 1 stands three times"),
        (table(velocity("m"), [0, 1, 2], [1, 2, 0]), "terms[0][0].xs[1]", 2.5, "xs must increase, got 2 after 2.5"),
        (sine(1.0, 2.0), "frequency", 1e101, "frequency must be at most 1e+100"),
    ],
)
def test_numbers_of_a_load_that_do_not_go_together_are_refused(load: Any, name: str, value: float, said: str) -> None:
    scene = Scene(Body("m", inertia=1.0), Force("m", load))
    (one,) = named_parameters(scene, [f"forces[0].signal.{name}"], "test")
    with pytest.raises(ValueError, match=re.escape(said)):
        one.set(scene, value)


@pytest.mark.parametrize("names", [["scale", "offset"], ["offset", "scale"]])
def test_a_load_and_a_number_of_it_do_not_change_together(names: list[str]) -> None:
    """Offset 3 and scale 2 could be 3 or 6 N."""
    scene = Scene(Body("m", inertia=1.0), Force("m", sine(1.0, 0.5, offset=1.0)))
    given = [f"forces[0].signal.{name}" for name in names]
    with pytest.raises(ValueError, match=re.escape("'forces[0].signal.scale' multiplies 'forces[0].signal.offset'")):
        fit(scene, given, {"m.velocity": ([0.5, 1.0], [1.0, 2.0], 0.1)})
    with pytest.raises(ValueError, match="multiplies"):
        SceneRuns(scene, (0.0, 1.0), {}).at(dict.fromkeys(given, 2.0))
    # one after the other has derivatives
    assert sensitivities(scene, (0.0, 1.0), given).velocity("m").shape == (2,)
