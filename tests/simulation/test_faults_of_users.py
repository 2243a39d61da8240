"""Faults of users and solvers while a simulation runs end in `SimulationError`, which holds the result so far."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
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
    PreSlip,
    Result,
    Sampled,
    Scene,
    SimulationError,
    Spring,
    output,
    signal,
    simulate,
    velocity,
)

Load = Callable[[float], Any]
Fault = tuple[Callable[[], Result], str]
"""What to simulate, and words that the error must hold."""

LAW = DryFriction(0.3, 0.2)
STOP = 1.0
SOLVERS: dict[str, dict[str, Any]] = {
    "contact-force": {},
    "Adams": {"method": "Adams"},
    "merged": {"formulation": "merged", "method": "BDF"},
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
    return Scene(Body("block", inertia=1.0), Contact("floor", "block", GROUND, law, normal=1.0), Force("block", 1.0))


def _unlawful(value: Any, speed: float) -> Any:
    return 0.2 if speed < 0.3 else value


def rough(**options: Any) -> Result:
    """Simulate an oscillator under a load out of all proportion to the tolerance."""
    load = signal(lambda t: 0.1 + (1e12 * math.copysign(1.0, math.sin(1e9 * t * t)) if t > 0.3 else 0.0), period=1.0)
    scene = Scene(
        Body("a", inertia=1.0),
        Contact("floor", "a", GROUND, LAW, normal=1.0),
        Spring("a", GROUND, stiffness=1.0),
        Force("a", load),
    )
    return simulate(scene, (0.0, 1e3), rtol=1e-9, atol=1e-300, **options)


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
    """Yield by name simulations that the solvers cannot do."""
    for name in ("contact-force", "Adams", "merged", "multiplier"):
        yield f"a load out of proportion, {name}", (partial(rough, **SOLVERS[name]), "")
    for method, soft in product(("RK4", "Euler"), (False, True)):
        yield (
            f"{method} too coarse for {'a pre-slip velocity' if soft else 'a damper'}",
            (partial(_unstable, method, soft), "is unstable"),
        )


def check(case: Fault) -> None:
    """Run a case: it must end in the right error, with a result that can be used.

    A load that fails in the search for its zeros is refused before anything runs.
    """
    run, words = case
    with pytest.raises((ValueError, SimulationError)) as raised:
        run()
    error, text = raised.value, str(raised.value)
    assert words in text
    if not isinstance(error, SimulationError):
        return
    result = error.result
    # a scene without contacts has no modes to name
    assert text.count(";") >= 1 + bool(error.modes), "the error names no modes or no remedy"
    assert math.isfinite(error.t) and error.t >= 0.0
    assert not result.success and result.message == text
    assert np.isfinite(result.y).all()
    assert result.t.size == 0 or result.t[-1] <= error.t + 1e-9
    if result.t.size > 1:
        assert np.isfinite(result(0.5 * (result.t[0] + result.t[-1]))).all()


@pytest.mark.slow
@pytest.mark.parametrize("case", [pytest.param(case, id=name) for name, case in faults_of_users()])
def test_loads_and_laws_that_fail_half_way(case: Fault) -> None:
    check(case)


@pytest.mark.slow
@pytest.mark.parametrize("case", [pytest.param(case, id=name) for name, case in faults_of_solvers()])
def test_what_no_solver_can_do(case: Fault) -> None:
    check(case)


@pytest.mark.parametrize("method", ["series", "BDF"])
def test_what_grows_without_end_is_kept_up_to_there(method: Any) -> None:
    """v' = 50 v - 0.1 from 1 m/s: v = 0.002 + 0.998 exp(50 t), 1e100 at 4.6052 s."""
    rub = Contact("rub", "m", GROUND, DryFriction(0.1, 0.1), normal=1.0)
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), Force("m", 50 * velocity("m")), rub)
    with pytest.raises(SimulationError, match=r"the motion grows beyond 1e\+100") as caught:
        simulate(scene, (0.0, 100.0), method=method, rtol=1e-9)
    result = caught.value.result
    assert 4.0 < caught.value.t == result.t[-1] < math.log(1e100 / 0.998) / 50 + 1e-3
    assert np.abs(result.velocity("m")).max() < 1e100
    assert result.sample([0.5]).velocity("m")[0] == pytest.approx(0.002 + 0.998 * math.exp(25), rel=1e-5)


def test_what_a_sampled_controller_makes_grow_is_kept_up_to_there() -> None:
    """v' = u, u = -30 v at samples 0.1 s apart: v is multiplied by -2 at each, and 30 * 2**328 is too much."""
    control = Sampled("p", period=0.1, inputs=[velocity("m")], output=lambda t, x, u: -30 * u[0])
    scene = Scene(Body("m", inertia=1.0, velocity=1.0), control, Force("m", output("p")))
    for method in ("series", "BDF"):
        with pytest.raises(SimulationError, match=r"the motion grows beyond 1e\+100") as caught:
            simulate(scene, (0.0, 100.0), method=method)  # type: ignore[arg-type]
        result = caught.value.result
        assert result.velocity("m")[-1] == pytest.approx(2.0**328, rel=1e-6)
        assert result.t[-1] == pytest.approx(32.8)
