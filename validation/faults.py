"""Rows over what goes wrong while a simulation runs: each ends in `SimulationError`, with what was computed so far."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any
from unittest import mock

import numpy as np

from stickslip import (
    GROUND,
    Body,
    Contact,
    Damper,
    Drive,
    DryFriction,
    Force,
    PreSlip,
    Result,
    Scene,
    SimulationError,
    Spring,
    signal,
    simulate,
)
from stickslip.model.laws import kinetic
from validation.rows import Row, Tried, Wrong, asked, require
from validation.tried import try_each

Load = Callable[[float], Any]
Fault = tuple[Callable[[], Result], str]
"""What to simulate, and words that the error must hold."""

LAW = DryFriction(0.3, 0.2)
STOP = 1.0
PATIENCE = 30.0
SOLVERS: dict[str, dict[str, Any]] = {
    "contact-force": {},
    "Adams": {"method": "Adams"},
    "merged": asked("merged"),
    "multiplier": {"formulation": "multiplier"},
    "RK4": {"method": "RK4", "step": 1e-3},
    "Euler": {"method": "Euler", "step": 1e-3},
}
_FROM, _TO = 0.51, 0.56
"""When loads fail: between the times at which scales are read off them before anything runs."""


def _fails(t: float) -> bool:
    return _FROM < t < _TO


def _raises(t: float) -> float:
    if _fails(t):
        raise RuntimeError("sensor lost")
    return 1.0


def _divides(t: float) -> float:
    return 1.0 / (0.0 if _fails(t) else 1.0)


def _returns(value: Any, t: float) -> Any:
    return value if _fails(t) else 1.0


LOADS: dict[str, tuple[Load, str]] = {
    "raises": (_raises, "sensor lost"),
    "divides by zero": (_divides, "ZeroDivisionError"),
    "is not a number": (partial(_returns, math.nan), "nan"),
    "is infinite": (partial(_returns, math.inf), "inf"),
    "is an array": (partial(_returns, np.zeros(3)), "one finite number"),
    "is text": (partial(_returns, "1"), "one finite number"),
    "is nothing": (partial(_returns, None), "one finite number"),
}


def loaded(place: str, load: Load) -> Scene:
    """Return a sprung block on a belt, with a load as its force, its normal force or the velocity of the belt."""
    bad = signal(load, period=0.2)
    return Scene(
        Body("block", inertia=1.0, velocity=0.5),
        Drive("belt", velocity=bad if place == "drive" else 1.0),
        Contact("sole", "block", "belt", LAW, normal=bad if place == "normal" else 1.0),
        Spring("block", GROUND, stiffness=1.0),
        Force("block", bad if place == "force" else 0.1),
    )


def sliding(kinetic: Callable[[float], float]) -> Scene:
    """Return a block that a force drives over the ground, ever faster."""
    law = DryFriction(0.3, 0.2, kinetic=kinetic)
    return Scene(
        Body("block", inertia=1.0), Contact("floor", "block", GROUND, law, normal=1.0), Force("block", 1.0)
    )


def _unlawful(value: Any, speed: float) -> Any:
    return 0.2 if speed < 0.3 else value


def rough(**options: Any) -> Result:
    """Simulate an oscillator under a load out of all proportion to the tolerance."""
    load = signal(
        lambda t: 0.1 + (1e12 * math.copysign(1.0, math.sin(1e9 * t * t)) if t > 0.3 else 0.0), period=1.0
    )
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("floor", "a", GROUND, LAW, normal=1.0),
        Spring("a", GROUND, stiffness=1.0),
        Force("a", load),
    )
    return simulate(scene, (0.0, 1e3), rtol=1e-12, atol=1e-300, **options)


def storming() -> Result:
    """Simulate friction that falls infinitely fast at rest, with a solver told so: modes flip every 1e-8 s."""
    law = DryFriction(0.5, 0.4, stribeck_velocity=1e-3, stribeck_exponent=0.5)
    scene = Scene(
        Drive("belt", velocity=0.1),
        Body("block", inertia=1.0),
        Contact("sole", "block", "belt", law, normal=10.0),
        Spring("block", GROUND, stiffness=20.0),
    )
    with mock.patch.object(kinetic, "_STEEPEST", 0.0):
        return simulate(scene, (0.0, 20.0))


def _unstable(method: str, soft: bool) -> Result:
    scene = Scene(Body("a", inertia=1.0, velocity=1.0), Damper("a", GROUND, damping=1e4))
    if soft:
        scene = Scene(
            Body("a", inertia=1.0, velocity=0.1),
            Contact("c", "a", GROUND, PreSlip(LAW, 1e-4), normal=10.0),
            Force("a", 1.0),
        )
    return simulate(scene, (0.0, 1.0), method=method, step=0.01)


def faults_of_users() -> Iterator[tuple[str, Fault]]:
    """Yield by name the loads and laws that fail half-way, in every solver."""
    span = (0.0, STOP)
    for (said, (load, words)), place, (solver, options) in product(
        LOADS.items(), ("force", "normal", "drive"), SOLVERS.items()
    ):
        yield f"{place} {said}, {solver}", (partial(simulate, loaded(place, load), span, **options), words)
    for value, (solver, options) in product((math.nan, math.inf, -math.inf, "x"), SOLVERS.items()):
        scene = sliding(partial(_unlawful, value))
        yield f"kinetic is {value}, {solver}", (partial(simulate, scene, span, **options), "kinetic(")


def faults_of_solvers() -> Iterator[tuple[str, Fault]]:
    """Yield by name what the solvers cannot do."""
    for name in ("contact-force", "Adams", "merged", "multiplier"):
        yield f"a load out of proportion, {name}", (partial(rough, **SOLVERS[name]), "")
    for method, soft in product(("RK4", "Euler"), (False, True)):
        yield (
            f"{method} too coarse for {'a pre-slip velocity' if soft else 'a damper'}",
            (partial(_unstable, method, soft), "is unstable"),
        )
    yield "a storm of events", (storming, "progress in time")


def fault(case: Fault) -> float:
    """Return 0 where a case ends in the right error with a result that can be used; raise `Wrong` otherwise.

    A load found to fail when its zeros are looked for is refused, before anything runs.
    """
    run, words = case
    try:
        run()
    except ValueError as refusal:
        require(words in str(refusal), f"the error does not say {words}: {refusal}")
        return 0.0
    except SimulationError as error:
        text, result = str(error), error.result
        require(words in text, f"the error does not say {words}: {text}")
        require(text.count(";") >= 2, f"the error names no modes or no remedy: {text}")
        require(math.isfinite(error.t) and error.t >= 0.0, f"the error is at {error.t}")
        require(not result.success and result.message == text, "the result does not tell")
        require(bool(np.isfinite(result.y).all()), "the result holds what is no number")
        require(result.t.size == 0 or result.t[-1] <= error.t + 1e-9, "the result goes on after the error")
        if result.t.size > 1:
            middle = 0.5 * (result.t[0] + result.t[-1])
            require(bool(np.isfinite(result(middle)).all()), "the result cannot be read between its points")
        return 0.0
    raise Wrong("an answer where there is none: an error was expected")


def tried(faults: Callable[[], Iterator[tuple[str, Fault]]]) -> Tried:
    """Try all faults of a list."""
    return try_each(((name, partial(fault, case)) for name, case in faults()), limit=PATIENCE)


fault_row = partial(
    Row,
    "Robustness",
    source="an error that names time, modes and remedy; finite results up to there",
    bound=0.0,
    limit=300.0,
    tries="faults at run time",
)
ROWS = [
    fault_row(
        name="faults-of-users",
        what=f"{sum(1 for _ in faults_of_users())} loads and laws that fail half-way, in every solver",
        check=partial(tried, faults_of_users),
    ),
    fault_row(
        name="faults-of-solvers",
        what=f"{sum(1 for _ in faults_of_solvers())} scenes that no solver can do: steps too small, too coarse, storms",
        check=partial(tried, faults_of_solvers),
        quick=False,
    ),
]
