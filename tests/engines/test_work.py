"""Statuses of a solver: after which a new solver goes on, and which end the run."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from stickslip.engines.work import SolverFailure, solved
from stickslip.equations.path import Path


@pytest.mark.parametrize(
    ("status", "steps", "goes_on"),
    [
        (0, 1, True),
        (2, 1, True),
        (-3, 40, True),
        (-3, 3, False),
        (-4, 40, True),
        (-4, 3, False),
        (-1, 40, False),
    ],
)
def test_where_a_solver_fails_after_many_steps_a_new_one_goes_on(status: int, steps: int, goes_on: bool) -> None:
    path = Path(np.linspace(0.0, 1.0, steps + 1), np.zeros((steps, 2, 1)), np.zeros(1), False)
    said = SimpleNamespace(status=status, message="It failed.")
    if goes_on:
        assert solved(said, path) is path
        return
    with pytest.raises(SolverFailure, match=rf"It failed \(SUNDIALS status {status}\)") as caught:
        solved(said, path)
    assert caught.value.path is path
