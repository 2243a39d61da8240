"""Follow a motion with a solver of SUNDIALS: also to events between its points; what was computed is never lost."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from stickslip.engines.dips import first_dip
from stickslip.engines.passing import back_to_zero
from stickslip.engines.progress import Interruption, Progress
from stickslip.engines.work import LOOK_AT_SCENE, Interrupted, SolverFailure
from stickslip.equations.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.path import Path

__all__ = ["LOCAL", "follow", "longest_step"]

LOCAL = 0.1
"""Local error allowed per step, as a part of the tolerance asked for: what a run of steps adds up is larger."""

_STEPS_PER_PERIOD = 8

_SHORT = (0.9, 0.5, 0.25, 0.1)
"""How far to go again where something failed, as parts of the time at which it did: steps grow tenfold at most."""


def longest_step(motion: Motion, max_step: float, period: float) -> float:
    """Return the longest step in s: a part of the loads' period, or a solver at rest steps over what happens."""
    return max_step if motion.stretch.is_straight else min(max_step, period / _STEPS_PER_PERIOD)


def follow(
    motion: Motion,
    guards: Guards,
    horizon: float,
    solve: Callable[[float, Progress], Path],
    interruption: Interruption,
) -> Path:
    """Advance to the first event, also where it lies between computed points.

    Parameters
    ----------
    motion : Motion
    guards : Guards
    horizon : float
        Local time in s.
    solve : callable
        ``solve(horizon, progress)`` advances to the first event that the solver notices.
    interruption : Interruption
    """
    while True:
        path = _protected(motion, horizon, solve, interruption)
        missed = first_dip(motion, guards, path)
        if missed is None:
            return back_to_zero(motion, guards, path)
        if missed.touched is not None:
            return replace(motion.until(path, missed.tau), touched=missed.touched)
        if missed.tau >= path.taus[-1]:
            # a root at the very end is none for the solver, however often it is sent there
            return back_to_zero(motion, guards, replace(path, hit=True))
        horizon = missed.tau


def _protected(
    motion: Motion, horizon: float, solve: Callable[[float, Progress], Path], interruption: Interruption
) -> Path:
    """Advance; where that fails or is interrupted, hand over what was computed before."""
    progress = Progress(horizon, interruption)
    try:
        path = solve(horizon, progress)
    except (ArithmeticError, ValueError) as fault:
        # a load or a law failed inside the solver, which forgets its points: go there again, but stop short
        size = motion.y.size
        path = Path(np.zeros(1), np.empty((0, 1, size)), motion.y, False, True)
        reached = progress.last
        for short in [part * reached for part in _SHORT if reached > 0]:
            with contextlib.suppress(Exception):
                path = solve(short, Progress(short, interruption))
                break
        raise SolverFailure(str(fault), LOOK_AT_SCENE, path) from fault
    if interruption.pressed:
        raise Interrupted(path)
    return path
