"""Counts of an engine's work, and its failures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip.equations.path import Path
from stickslip.model.arrays import Array

# The remedy where a load or a law that the solver calls fails.
LOOK_AT_SCENE = "look at the loads and laws of the scene there"

# SUNDIALS' statuses if the error test or the iteration failed too often; and how many points before that are progress.
_GAVE_UP, _SOME_STEPS = (-3, -4), 10

BEYOND = 1e100  # no velocity or position becomes as large as this unless something feeds it for ever


@dataclass
class Work:
    """Counts of an engine's work."""

    steps: int = 0
    rate_calls: int = 0
    jacobian_calls: int = 0
    guard_calls: int = 0
    solvers: int = 0
    guards_excluded: int = 0
    guards_isolated: int = 0


class SolverFailure(Exception):
    """The solver gave up, or a load or law that it called failed.

    `sentence` says what went wrong, in SUNDIALS' words if SUNDIALS failed, and `remedy` what to try; `path` is the path
    computed before.
    """

    def __init__(self, sentence: str, remedy: str, path: Path) -> None:
        super().__init__(sentence)
        self.sentence, self.remedy, self.path = sentence, remedy, path


class Interrupted(KeyboardInterrupt):
    """Ctrl-C was pressed while a solver was at work.

    `path` is the path computed before.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path


def grows(path: Path) -> SolverFailure:
    """Return the failure of a motion that goes on beyond all bounds after a path."""
    return SolverFailure(f"the motion grows beyond {BEYOND:g}: something feeds it without end", LOOK_AT_SCENE, path)


def within_bounds(points: Array) -> int:
    """Return how many of the states (rows) come before the first that is beyond `BEYOND`."""
    within = (np.abs(points) < BEYOND).all(axis=1)
    return int(np.append(within, False).argmin())


def sound(smallest: float, tau: float) -> float:
    """Return the smallest guard as a solver is to see it: 1 where there are no guards.

    A guard that is not a number is an error: root finding would never see an event any more.
    """
    if math.isnan(smallest):
        raise FloatingPointError(f"a guard is not a number at local time {tau:g}")
    return smallest if smallest < math.inf else 1.0


def solved(solution: Any, path: Path) -> Path:
    """Return the path of a solution of SUNDIALS, or raise its failure with SUNDIALS' own sentence.

    Where a solver could not pass a kink or roundoff after some steps, its path is returned: the motion goes on with a
    new solver. This one has no memory of earlier points. It counts time from 0, so that it can take shorter steps.
    """
    if solution.status >= 0 or (solution.status in _GAVE_UP and path.taus.size > _SOME_STEPS):
        return path
    sentence = f"{solution.message.rstrip('.')} (SUNDIALS status {solution.status})"
    raise SolverFailure(
        sentence,
        "loosen rtol or atol, or tighten atol if it is above the velocities that matter, "
        "or give max_step from the time scale of the loads",
        path,
    )
