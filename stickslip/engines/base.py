"""The interface of engines: an engine is made for one simulation and advances motions; a method describes it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from stickslip.engines.progress import Interruption
from stickslip.engines.work import Work
from stickslip.equations.guards.guards import Guards
from stickslip.equations.loads.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System
from stickslip.model.arrays import Array

# Local error that solvers allow per step, as a part of the tolerance asked for: the errors of many steps add up.
LOCAL = 0.1


@dataclass(frozen=True)
class Task:
    """One simulation, as an engine sees it."""

    system: System
    loads: Loads
    rtol: float
    atol: Array  # (size,): tolerances of the states
    speeds: Array  # (n,): velocity scales of the bodies in m/s or rad/s, 0 where none is known
    max_step: float = math.inf  # longest step in s, infinite for none
    step: float = math.nan  # length of fixed steps in s
    # integrate the independent velocities only: the state shrinks and grows (Breedveld 2000, figs. 4 and 5)
    merged: bool = False
    # whether CVODE leaves linear motions in which no guard is a velocity to the series
    exact_at_rest: bool = False
    interruption: Interruption = field(default_factory=Interruption)


class Engine(Protocol):
    """Advances the motions of one simulation."""

    work: Work

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Follow a motion to its first event or to local time `horizon`, whichever comes first."""
        ...


@dataclass(frozen=True)
class Method:
    """What `simulate` has to know about an engine."""

    title: str  # its name in explanations
    make: Callable[[Task], Engine]  # returns the engine of a task
    formulations: tuple[str, ...] = ("contact-force",)  # the formulations that it solves, as `simulate` takes them
    takes_steps: bool = False  # whether it needs the length of fixed steps
    # ``why_not(system, loads)`` says what in a scene the engine cannot follow, None if it can follow all
    why_not: Callable[[System, Loads], str | None] = lambda system, loads: None
    # how many times the velocity error that tolerances allow the range must be in which a smooth law changes sign
    resolution: float = 1e3
    # ratio of the relative errors of forces and of states; 0 where forces follow from the states
    force_uncertainty: float = 0.0
