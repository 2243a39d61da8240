"""Bad input is refused before anything runs, with errors that name the element, the value and the remedy."""

import functools
import math
from collections.abc import Callable
from typing import Any
from unittest import mock

import numpy as np
import pytest
from bad_elements import ELEMENTS, LAWS, NAN, SIGNALS, A, Case, contact
from bad_machines import MACHINES
from bad_scenes import ARGUMENTS, DATA, SCENES

from stickslip import (
    GROUND,
    Drive,
    DryFriction,
    Force,
    Scene,
    SimulationError,
    feedback,
    signal,
    simulate,
    triangle,
    velocity,
)

TABLES: dict[str, list[Case]] = {
    "signals": SIGNALS,
    "laws": LAWS,
    "elements": ELEMENTS,
    "machines": MACHINES,
    "scenes": SCENES,
    "scene-files": DATA,
    "arguments": ARGUMENTS,
}


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=f"{table} {i}: {case[2][0]}")
        for table, cases in TABLES.items()
        for i, case in enumerate(cases)
    ],
)
def test_bad_input_is_refused(case: Case) -> None:
    make, kind, words = case
    started = mock.Mock(side_effect=AssertionError("an engine was made before the input was checked"))
    with mock.patch("stickslip.simulation.simulate.Task", started), pytest.raises(kind) as raised:
        make()
    assert type(raised.value) is kind
    for word in words:
        assert word in str(raised.value)


@pytest.mark.parametrize(
    ("function", "declared"),
    [
        (lambda t, w: t * w, "(t, w)"),
        (lambda: 1.0, "()"),
        (lambda *, t: t, "(*, t)"),
        (math.atan2, ""),
        (functools.partial(lambda t, w: t), "(t, w)"),
    ],
)
def test_a_signal_of_more_than_time_is_refused_where_it_is_made(function: Callable[..., float], declared: str) -> None:
    with pytest.raises(TypeError, match="signal: function must take one argument, the time t in s") as raised:
        signal(function)
    assert declared in str(raised.value)


@pytest.mark.parametrize(
    "function",
    [math.sin, np.sin, abs, lambda t, scale=2.0: t * scale, functools.partial(lambda a, t: a * t, 2.0)],
)
def test_a_signal_of_time_alone_is_taken(function: Callable[[float], float]) -> None:
    assert signal(function)(0.5) == pytest.approx(float(function(0.5)))


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (
            {"law": {"mu_statc": 0.2, "mu_coulomb": 0.1}},
            ["law: unknown field 'mu_statc'; a DryFriction has mu_static"],
        ),
        ({"law": {"mu_static": 0.2}}, ["law: field 'mu_coulomb' is missing; a DryFriction needs it"]),
        (
            {"law": {"type": "PreSlip", "law": {"mu_static": 0.2, "mu_coulomb": 0.1}, "speed": 1.0}},
            ["law: unknown field 'speed'; a PreSlip has law, velocity"],
        ),
        (
            {"normal": {"type": "sine", "amplitud": 1.0}},
            ["normal: unknown field 'amplitud'; a sine has amplitude"],
        ),
        (
            {"normal": {"type": "triangle", "start": 1.0}},
            ["normal: field", "is missing; a triangle needs it"],
        ),
    ],
)
def test_misspelt_entries_of_a_file_are_named(row: dict[str, Any], words: list[str]) -> None:
    contacts = {
        "name": "c",
        "a": "a",
        "b": "ground",
        "law": {"mu_static": 0.2, "mu_coulomb": 0.1},
        "normal": 1.0,
    }
    data = {"bodies": [{"name": "a", "inertia": 1.0}], "contacts": [contacts | row]}
    with pytest.raises(TypeError, match=r"contacts\[0\]") as raised:
        Scene.from_dict(data)
    for word in words:
        assert word in str(raised.value)
    for leak in ("__init__", "keyword argument", "positional"):
        assert leak not in str(raised.value)


# faults that only a run can find


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
    whose = {"force": "force on 'a': signal", "normal": "contact 'c': normal", "drive": "drive 'd': velocity"}
    with pytest.raises((SimulationError, ValueError)) as raised:
        simulate(Scene(*elements[kind]), (0.0, 1.0))
    for word in [*words, f"{whose[kind]}: signal function"]:
        assert word in str(raised.value)


def test_a_function_in_a_sum_or_among_arguments_is_named_with_its_element() -> None:
    bad = signal(late(NAN))
    inner = feedback(lambda x, v: x - v, 2 * bad + 1, velocity("a"))
    for load in (triangle(0.1, 0.2, 0.3, slope=1) - bad, velocity("a") + bad, inner):
        with pytest.raises((SimulationError, ValueError), match=r"force on 'a'.*: signal function"):
            simulate(Scene(A, Force("a", load)), (0.0, 1.0))


def test_a_law_that_turns_bad_on_the_way_keeps_what_was_computed() -> None:
    law = DryFriction(0.2, 0.1, kinetic=lambda v: 0.1 if v < 0.5 else NAN)
    scene = Scene(A, contact(b=GROUND, law=law), Force("a", 1.1))
    with pytest.raises(SimulationError, match=r"kinetic\([0-9.]+\) = nan") as raised:
        simulate(scene, (0.0, 1.0))
    assert "laws of the scene" in str(raised.value)
    assert raised.value.modes["c"].name == "FORWARD"
