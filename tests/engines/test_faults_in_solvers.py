"""What fails within a sparse solver is an error where the solver may be left, and not the end of the process."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from stickslip import GROUND, Body, Force, Scene, SimulationError, Spring, feedback, position, simulate, velocity
from stickslip.engines.solvers.faults import Faults


def chain(count: int, first: Any) -> list[Any]:
    """Return bodies on a chain of springs; the first one is pushed."""
    elements: list[Any] = [Force("b0", first)]
    for k in range(count):
        elements.append(Body(f"b{k}", inertia=1.0, position=1.0))
        elements.append(Spring(f"b{k}", f"b{k - 1}" if k else GROUND, stiffness=10.0))
    return elements


def failing(call: int) -> Any:
    """Return a force whose function fails from a call on; its derivatives call it, too."""
    calls = itertools.count(1)

    def pull(x: float, v: float) -> float:
        if next(calls) >= call:
            raise ValueError("no more")
        return -x - v

    return feedback(pull, position("b0"), velocity("b0"))


@pytest.mark.parametrize("call", [1, 10, 11, 12, 13, 14, 20, 50, 200])
def test_a_function_may_fail_in_any_call_of_ida(call: int) -> None:
    with pytest.raises(SimulationError, match="no more"):
        simulate(Scene(*chain(120, failing(call))), (0.0, 5.0), formulation="multiplier")


@pytest.mark.slow
@pytest.mark.parametrize("call", [1, 8, 9, 10, 12, 50])
@pytest.mark.parametrize("method", ["BDF", "Adams"])
def test_a_function_may_fail_in_any_call_of_cvode(method: str, call: int) -> None:
    """Springs between bodies far apart in the chain make the Jacobian sparse, not banded."""
    count = 260
    ends = [(k, (37 * k + 11) % count) for k in range(0, count, 3)]
    across = [Spring(f"b{i}", f"b{j}", stiffness=0.1) for i, j in ends if abs(i - j) > 1]
    with pytest.raises(SimulationError, match="no more"):
        simulate(Scene(*chain(count, failing(call)), *across), (0.0, 5.0), method=method)


def test_a_fault_waits_for_the_first_jacobian() -> None:
    faults, out = Faults(waits=True), np.ones(2)

    def fails(out: Any) -> None:
        raise ArithmeticError("first")

    rates, jacobian = faults.of_rates(fails), faults.of_jacobian(fails, lambda: 7.0)
    rates(out)
    assert out.tolist() == [0.0, 0.0]
    jacobian(out)
    assert out.tolist() == [7.0, 7.0]
    with pytest.raises(ArithmeticError, match="first"):
        rates(out)
    faults.clear()
    faults.check()
    with pytest.raises(ArithmeticError, match="first"):
        rates(out)
