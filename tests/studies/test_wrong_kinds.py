"""Arguments of studies of a wrong kind, once accepted or refused in Python's words, are refused in our own words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from calls import LEAKED, RESULT, STRANGE

from stickslip import (
    GROUND,
    Body,
    Contact,
    Drive,
    DryFriction,
    Scene,
    Spring,
    continue_cycle,
    fit,
    limit_cycle,
    linearize,
    sensitivities,
    sweep,
    tradeoff,
    work_precision,
)

BELT = Scene(
    Body("block", inertia=1.0, velocity=0.1),
    Drive("belt", velocity=0.5),
    Spring("block", GROUND, stiffness=1.0),
    Contact("c", "block", "belt", DryFriction(0.4, 0.2), normal=1.0),
)
SPAN = (0.0, 0.5)
DERIVED = sensitivities(BELT, SPAN, ["block.inertia"])
DATA = {"block.velocity": ([0.0, 0.5], [0.1, 0.1])}
ONCE: dict[str, Any] = {"error": lambda result: 0.1, "repeats": 1, "warmup": 0}

TEXTS: set[str] = {"texts"}
TIMES: set[str] = {"none", "number", "numbers", "odd number", "empty"}
CALLS: list[tuple[Callable[[Any], Any], set[str]]] = [
    (lambda x: limit_cycle(BELT, period=x), {"none", "number", "odd number"}),
    (lambda x: limit_cycle(BELT, guess=x), {"none", "number", "odd number"}),
    (lambda x: limit_cycle(BELT, transient=x), {"none", "number", "odd number"}),
    (
        lambda x: continue_cycle(BELT, "belt.velocity", [0.5], period=x),
        {"none", "number", "function", "result"},
    ),
    (lambda x: continue_cycle(BELT, "belt.velocity", [0.5], accuracy=x), {"number"}),
    (lambda x: linearize(BELT, t=x), {"number"}),
    (lambda x: linearize(BELT).select(inputs=x), {"none", "texts", "empty"}),
    (lambda x: sensitivities(BELT, SPAN, x), TEXTS),
    (lambda x: DERIVED.velocity("block", x), TIMES),
    (lambda x: fit(BELT, x, DATA), TEXTS),
    (lambda x: fit(BELT, ["block.inertia"], DATA, seed=x), {"number"}),
    (lambda x: sweep(lambda a: a, {"a": [1.0]}, executor=x, progress=False), {"none"}),
    (lambda x: sweep(lambda a: a, {"a": [1.0]}, executor="serial", progress=x), {"flag"}),
    (lambda x: tradeoff(BELT, SPAN, error=x), {"function", "result"}),
    (lambda x: tradeoff(BELT, SPAN, budget=x), {"number"}),
    (lambda x: tradeoff(BELT, SPAN, progress=x), {"flag"}),
    (lambda x: work_precision({"a": lambda: 1.0}, **ONCE, progress=x), {"flag"}),
    (lambda x: work_precision({"a": lambda: 1.0}, **ONCE).best(error=x), {"none", "number", "odd number"}),
]


@pytest.mark.parametrize(("call", "taken"), CALLS, ids=range(len(CALLS)))
def test_values_of_a_wrong_kind_are_refused_in_our_words(call: Callable[[Any], Any], taken: set[str]) -> None:
    for kind in STRANGE.keys() - taken:
        for value in STRANGE[kind]:
            if kind == "flag" and isinstance(value, np.bool_):
                continue
            with pytest.raises((ValueError, TypeError)) as refused:
                call(value)
            words = str(refused.value).partition("got ")[0]
            assert len(words) > 10 and not LEAKED.search(words), f"{value!r}: {refused.value}"


def test_a_result_is_no_time_of_a_derivative() -> None:
    with pytest.raises(TypeError, match="times must be a sequence of numbers"):
        DERIVED.velocity("block", RESULT)  # type: ignore[arg-type]
