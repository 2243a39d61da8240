"""What engines count and hand back, and why they fail."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from stickslip.equations.path import Path
from stickslip.model.arrays import Array

# The remedy where what the solver calls fails.
LOOK_AT_SCENE = "look at the loads and laws of the scene there"

# The status where the error test or the iteration has failed too often; and how many steps before it are progress.
_STUCK, _SOME_STEPS = (-3, -4), 10

BEYOND = 1e100  # what no velocity or position comes to unless something feeds it for ever


@dataclass
class Work:
    """Counts of what was done."""

    steps: int = 0
    rate_calls: int = 0
    jacobian_calls: int = 0
    guard_calls: int = 0
    solvers: int = 0
    guards_excluded: int = 0
    guards_isolated: int = 0


class SolverFailure(Exception):
    """The solver gave up, or what it called did.

    `sentence` says what went wrong, in SUNDIALS' words where it was SUNDIALS, and `remedy` what to try; `path` is what
    was computed before.
    """

    def __init__(self, sentence: str, remedy: str, path: Path) -> None:
        super().__init__(sentence)
        self.sentence, self.remedy, self.path = sentence, remedy, path


class Interrupted(KeyboardInterrupt):
    """Ctrl-C was pressed while a solver was at work.

    `path` is what was computed before.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path


def grows(path: Path) -> SolverFailure:
    """Return the failure of a motion that goes on beyond all bounds after a path."""
    return SolverFailure(f"the motion grows beyond {BEYOND:g}: something feeds it without end", LOOK_AT_SCENE, path)


def within_bounds(points: Array) -> int:
    """Return how many of the states, a line each, come before the first that is beyond all bounds."""
    within = (np.abs(points) < BEYOND).all(axis=1)
    return int(np.append(within, False).argmin())


def sound(smallest: float, tau: float) -> float:
    """Return the smallest guard as a solver is to see it: 1 where nothing is watched.

    It is refused where it is not a number: root finding would see no event, for ever.
    """
    if math.isnan(smallest):
        raise FloatingPointError(f"a guard is not a number at local time {tau:g}")
    return smallest if smallest < math.inf else 1.0


def solved(solution: Any, path: Path) -> Path:
    """Return the path of a solution of SUNDIALS, or raise its failure with SUNDIALS' own sentence.

    Where its long memory could not pass a kink or roundoff, the path ends: the motion goes on with a new solver. That
    counts its own time from 0, and so tells shorter steps apart.
    """
    if solution.status >= 0 or (solution.status in _STUCK and path.taus.size > _SOME_STEPS):
        return path
    sentence = f"{solution.message.rstrip('.')} (SUNDIALS status {solution.status})"
    raise SolverFailure(
        sentence,
        "loosen rtol or atol, or tighten atol if it is above the velocities that matter, "
        "or give max_step from the time scale of the loads",
        path,
    )
