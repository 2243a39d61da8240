"""What a solver hands back: computed points, counts of its work, or why it failed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["LOOK_AT_SCENE", "Interrupted", "Reached", "SolverFailure", "Work", "failure_of", "guard_value"]

Array = NDArray[np.float64]

LOOK_AT_SCENE = "look at the loads and laws of the scene there"
"""The remedy where what the solver calls fails."""


class SolverFailure(Exception):
    """The solver gave up, or what it called did.

    Parameters
    ----------
    sentence : str
        What went wrong, in SUNDIALS' words where it was SUNDIALS.
    remedy : str
        What to try.
    reached : Reached, optional
        The points computed before.
    """

    def __init__(self, sentence: str, remedy: str, reached: Reached | None = None) -> None:
        super().__init__(sentence)
        self.sentence, self.remedy, self.reached = sentence, remedy, reached


class Interrupted(KeyboardInterrupt):
    """Ctrl-C was pressed while a solver was at work.

    Parameters
    ----------
    reached : Reached
        The points computed before.
    """

    def __init__(self, reached: Reached) -> None:
        super().__init__()
        self.reached = reached


@dataclass
class Work:
    """Counts of what was done."""

    steps: int = 0
    rate_calls: int = 0
    jacobian_calls: int = 0
    guard_calls: int = 0
    starts: int = 0
    solvers: int = 0
    fewest_states: float = np.inf


@dataclass(frozen=True)
class Reached:
    """Computed points of a segment, the first at its start; `hit` tells whether the last is at a root.

    Within the steps the values `inner` (step, place, state) hold the solver's polynomials; a closed form and fixed
    steps have none. Where events were found by forces from other equations than those of the guards, ties are
    `rough_ties`. In a closed form the velocities of stuck bodies are `joined` to the last bit.
    """

    taus: Array
    states: Array
    hit: bool
    rough_ties: bool = False
    joined: bool = False
    inner: Array | None = None

    def until(self, count: int) -> Reached:
        """Return the first `count` points."""
        inner = None if self.inner is None else self.inner[: count - 1]
        return Reached(self.taus[:count], self.states[:count], False, self.rough_ties, inner=inner)


def guard_value(smallest: float, tau: float) -> float:
    """Return the smallest guard as a solver is to see it: 1 where nothing is watched.

    Raises
    ------
    FloatingPointError
        If it is not a number: root finding would see no event, for ever.
    """
    if math.isnan(smallest):
        raise FloatingPointError(f"a guard is not a number at local time {tau:g}")
    return smallest if smallest < math.inf else 1.0


def failure_of(solution: Any, reached: Reached | None) -> SolverFailure:
    """Return SUNDIALS' failure with its own sentence."""
    sentence = f"{solution.message.rstrip('.')} (SUNDIALS status {solution.status})"
    return SolverFailure(
        sentence, "loosen rtol or atol, or give max_step from the time scale of the loads", reached
    )
