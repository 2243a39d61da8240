"""Quantities as data: sums, files, and what is refused."""

from __future__ import annotations

import math
import pickle
from typing import Any

import pytest

from stickslip import (
    GROUND,
    TIME,
    Body,
    Contact,
    Drive,
    DryFriction,
    Force,
    Gear,
    Scene,
    feedback,
    normal,
    output,
    position,
    power,
    relative_velocity,
    saturate,
    sine,
    stretch,
    table,
    triangle,
    velocity,
)
from stickslip.model.quantities import Expression, as_expression, as_load
from stickslip.model.signals import Constant

LAW = DryFriction(0.2, 0.1)


def scene_with(load: Any) -> Scene:
    return Scene(
        Body("a", inertia=1.0),
        Body("b", inertia=1.0),
        Gear("gear", "a", "b", ratio=2.0),
        Contact("rub", "a", GROUND, LAW, normal=1.0),
        Force("a", load),
    )


def test_sums_keep_each_quantity_once_and_all_signals_together() -> None:
    load = 2 * position("a") - velocity("b") + 3.0 + triangle(0, 1, 2, slope=1) + position("a") / 2 - sine(1, 1)
    assert dict(load.terms) == {position("a"): 2.5, velocity("b"): -1.0}
    assert load.signal(1.0) == pytest.approx(4.0)
    assert 1.0 - velocity("a") == Expression(((velocity("a"), -1.0),), Constant(1.0))
    assert sine(1, 1) + velocity("a") == velocity("a") + sine(1, 1)
    assert (sine(1, 1) - velocity("a")).terms == ((velocity("a"), -1.0),)
    assert as_load(velocity("a") - velocity("a") + 2.0, "it") == Constant(2.0)


def test_time_is_a_straight_line() -> None:
    load = as_load(2 * TIME - 1, "it")
    assert [load(t) for t in (-1.0, 0.0, 3.0)] == [-3.0, -1.0, 5.0]  # type: ignore[operator]
    clipped = load.clipped(0.0, 2.0)  # type: ignore[union-attr]
    assert clipped.breaks(0.0, 2.0) == pytest.approx((0.5,), abs=1e-15)
    assert [clipped(t) for t in (0.0, 0.5, 2.0)] == pytest.approx([0.0, 0.0, 3.0], abs=1e-15)


@pytest.mark.parametrize(
    "load",
    [
        position("a"),
        2 * velocity("a") - 3 * relative_velocity("rub") + stretch("gear") + 1.0 + sine(1, 2),
        power("rub") + normal("rub") * 0.5,
        saturate(5 * position("a"), -1.0, 2.0) + TIME,
        saturate(position("a"), 0.0, math.inf),
        table(position("a") + TIME, [0, 1, 3], [0, 2, -1]) * 2,
    ],
)
def test_scenes_with_quantities_are_data(load: Any) -> None:
    scene = scene_with(load)
    again = Scene.from_dict(scene.to_dict())
    assert again == scene
    assert again.to_dict() == scene.to_dict()
    assert pickle.loads(pickle.dumps(scene)) == scene


def test_code_is_no_data() -> None:
    scene = scene_with(1.0 + feedback(math.sin, position("a")))
    with pytest.raises(ValueError, match="force on 'a': feedback function sin is code, not data"):
        scene.to_dict()


def test_lines_of_a_table() -> None:
    assert table(position("a"), [0, 1, 3], [0, 2, -1]).lines == [(0, 0), (0, 2), (3.5, -1.5), (-1, 0)]  # type: ignore[attr-defined]
    assert saturate(position("a"), -1, 2).lines == [(-1, 0), (0, 1), (2, 0)]  # type: ignore[attr-defined]
    assert saturate(position("a"), 0, math.inf).lines == [(0, 0), (0, 1)]  # type: ignore[attr-defined]
    assert saturate(position("a"), -math.inf, math.inf) == as_expression(position("a"))


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: position(3), TypeError, "position: body must be a name"),  # type: ignore[arg-type]
        (lambda: normal(""), TypeError, "normal: contact must be a name"),
        (lambda: output("a", -1), ValueError, "output: index must be a whole number from 0 on, got -1"),
        (lambda: output("a", 0.5), TypeError, "output: index must be a whole number"),  # type: ignore[arg-type]
        (lambda: position("a") * velocity("a"), TypeError, "quantities are scaled by numbers; use feedback"),  # type: ignore[arg-type]
        (lambda: sine(1, 1) * velocity("a"), TypeError, "signals are scaled by numbers"),  # type: ignore[arg-type]
        (lambda: position("a") * math.nan, ValueError, "a quantity's factor must be finite"),
        (lambda: position("a") / 0, ValueError, "a quantity's divisor must not be 0"),
        (lambda: position("a") + "b", TypeError, "must be a quantity, a signal or a number"),  # type: ignore[operator]
        (lambda: position("a") + math.sin, TypeError, "wrap a function of the state in feedback"),  # type: ignore[operator]
        (lambda: feedback(math.sin), TypeError, "feedback: give at least one quantity"),
        (lambda: feedback(3, position("a")), TypeError, "feedback: function must be callable"),  # type: ignore[arg-type]
        (lambda: feedback(lambda x: x, position("a"), 2.0), TypeError, "must take 2 arguments, one for each"),
        (
            lambda: feedback(lambda x, y: x, position("a"), 2.0, derivatives=[math.cos]),
            TypeError,
            "one function for each of the 2 quantities",
        ),
        (
            lambda: saturate(position("a"), 2.0, 1.0),
            ValueError,
            "saturate: low must be below high, got 2 and 1",
        ),
        (lambda: table(position("a"), [0, 0], [1, 2]), ValueError, "table: xs must increase"),
        (lambda: table(position("a"), [0, 1], [1]), ValueError, "table: 2 xs and 1 ys"),
        (
            lambda: Drive("d", velocity=velocity("a")),
            TypeError,
            "drive 'd': velocity must be a number or a signal",
        ),  # type: ignore[arg-type]
    ],
)
def test_what_is_refused(make: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make()


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (position("c"), "force on 'a': no body is called 'c'; known are 'a', 'b', 'ground'"),
        (1 + 2 * feedback(math.sin, velocity("c")), "force on 'a': no body is called 'c'"),
        (stretch("c"), "force on 'a': no contact is called 'c'; known are 'gear', 'rub'"),
        (normal("gear"), "force on 'a': gear 'gear' has no normal force to read; name a contact, or a Gap"),
        (power("gear"), "force on 'a': gear 'gear' has no power to read"),
    ],
)
def test_a_scene_knows_what_its_quantities_name(load: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        scene_with(load)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"type": "position"}, r"forces\[0\].signal: field 'body' is missing"),
        ({"type": "position", "body": "a", "x": 1}, r"forces\[0\].signal: unknown field 'x'"),
        (
            {"type": "expression", "terms": [{"factor": 1}]},
            r"signal.terms\[0\]: expected a table with 'factor'",
        ),
        ({"type": "expression", "terms": 3}, r"forces\[0\].signal: terms must be a list"),
        ({"type": "feedback"}, r"forces\[0\].signal: unknown signal type 'feedback'"),
        (
            {"type": "table", "quantity": {"type": "position", "body": "a"}, "xs": 1, "ys": [1]},
            r"signal.xs must be a s",
        ),
    ],
)
def test_files_that_describe_no_quantity(data: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        Scene.from_dict({"bodies": [{"name": "a", "inertia": 1.0}], "forces": [{"body": "a", "signal": data}]})


def test_quantities_are_printed_as_they_are_written() -> None:
    error = 0.1 - position("slide")
    assert str(100 * error - 10 * velocity("slide")) == "-100 position(slide) - 10 velocity(slide) + 10"
    assert str(error + sine(1.0, 2.0)) == "-1 position(slide) + s(t)"
    assert str(feedback(math.sin, position("bob"))) == "feedback(position(bob))"
    assert str(error - error) == "0"
