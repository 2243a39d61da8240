"""Bad input is refused before anything runs, with errors that name the element, the value and the remedy."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from stickslip import GROUND, Drive, DryFriction, Force, Scene, SimulationError, signal, simulate
from validation.bad_elements import NAN, A, Case, contact
from validation.bad_input import TABLES, refusal


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=f"{table} {i}: {case[2][0]}")
        for table, cases in TABLES.items()
        for i, case in enumerate(cases)
    ],
)
def test_bad_input_is_refused(case: Case) -> None:
    assert refusal(case) == 0.0


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
