"""What every engine is: made for one simulation, it advances motions; a method says what it is made for."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from stickslip.engines.progress import Interruption
from stickslip.engines.work import Work
from stickslip.equations.guards import Guards
from stickslip.equations.loads import Loads
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path
from stickslip.equations.system import System

__all__ = ["Engine", "Method", "Task"]


@dataclass(frozen=True)
class Task:
    """One simulation, as an engine sees it.

    Attributes
    ----------
    system : System
    loads : Loads
    rtol : float
    atol : array (size,)
        Tolerances of the states.
    max_step : float
        Longest step in s, infinite for none.
    step : float
        Length of fixed steps in s.
    merged : bool
        Integrate the independent velocities only: the state shrinks and grows (Breedveld 2000, figs. 4 and 5).
    exact_at_rest : bool
        Whether CVODE leaves motions to the series in which all rows are held and all is linear.
    interruption : Interruption
    """

    system: System
    loads: Loads
    rtol: float
    atol: NDArray[np.float64]
    max_step: float = math.inf
    step: float = math.nan
    merged: bool = False
    exact_at_rest: bool = False
    interruption: Interruption = field(default_factory=Interruption)


class Engine(Protocol):
    """Advances the motions of one simulation."""

    work: Work

    def advance(self, motion: Motion, guards: Guards, horizon: float) -> Path:
        """Follow a motion to its first event or to local time `horizon`, whichever comes first."""
        ...


def _can(system: System, loads: Loads) -> str | None:
    return None


@dataclass(frozen=True)
class Method:
    """What `simulate` has to know of an engine.

    Attributes
    ----------
    title : str
        As explanations name it.
    make : callable
        Returns the engine of a task.
    formulations : tuple of str
        Those that it solves, as `simulate` takes them.
    takes_steps : bool
        Whether it needs the length of its steps.
    why_not : callable
        ``why_not(system, loads)`` says what in a scene it cannot follow, None if it can.
    resolution : float
        A velocity range in which a friction force turns over has to be this many times what the tolerances leave
        uncertain.
    force_uncertainty : float
        How many times less accurately than states it knows forces; 0 where they follow from the states.
    """

    title: str
    make: Callable[[Task], Engine]
    formulations: tuple[str, ...] = ("contact-force",)
    takes_steps: bool = False
    why_not: Callable[[System, Loads], str | None] = _can
    resolution: float = 1e3
    force_uncertainty: float = 0.0
