"""Which engine a simulation takes, and why."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy

from stickslip.engines import METHODS
from stickslip.equations.loads.loads import Loads
from stickslip.equations.mode_equations import equations_in, where_nothing_sticks
from stickslip.equations.system import System

# A decay this many times faster than all oscillations, over this many decay times, is left to an implicit method.
#
# Measured (`benchmarks/border.py`): there the exact series takes about twice as long.
_STIFF, _LONG = 200.0, 5e3

_OF_ONE_SIDE = 3  # regions of a gap that is pressed on one side


def choose(system: System, loads: Loads, formulation: str, method: str, duration: float) -> tuple[str, str]:
    """Return the engine, a key of `METHODS`, and the reason for it.

    Formulation and method are as `simulate` takes them; no run of short `duration` in s is stiff. A ValueError
    says that they do not go together, or that the method cannot follow the scene.
    """
    if formulation == "multiplier" and method in ("auto", "BDF"):
        return "IDA", "forces as unknowns make a differential-algebraic equation"
    if method != "auto":
        known = METHODS[method].formulations
        if formulation not in known:
            solvers = [other.title for other in METHODS.values() if formulation in other.formulations]
            raise ValueError(
                f"simulate: method {method!r} solves the {' or '.join(known)} formulation, not {formulation!r}, "
                f"which is for {', '.join(solvers)}; use 'auto' or 'BDF'"
            )
        if (reason := METHODS[method].why_not(system, loads)) is not None:
            raise ValueError(f"simulate: method {method!r} does not apply: {reason}; use 'auto' or 'BDF'")
        return method, "asked for"
    reason = METHODS["series"].why_not(system, loads) or why_stiff(system, duration)
    if reason is not None:
        return "BDF", reason
    return "series", "loads and laws are linear between events, so that the motion has exact Taylor series"


def why_stiff(system: System, duration: float) -> str | None:
    """Return why a scene is stiff, from dampers, springs, tables and normal forces at each body; None if it is not."""
    widest = system.piecewise.widest(system.C)
    fed = None
    if system.dependence is not None:
        steepest = system.dependence.steepest(system.inputs, system.size)
        pressed = scipy.sparse.diags_array(system.largest_coefficient) @ steepest[: system.m]
        fed = abs(system.Q) @ steepest + system.abs_GT @ pressed
        widest = widest + fed
    fastest, turn = _of_bodies(system, widest)
    if system.size > system.first_block:
        fastest = max(fastest, -float(system.block_C.diagonal(system.first_block).min(initial=0.0)))
    if fastest * duration > _LONG and turn < fastest <= _STIFF * turn and not system.sparse:
        # a body whose velocity decays faster than its springs turn it does not oscillate
        fastest, turn = _decay_and_turn(system)
        if fed is not None:
            turn = max(turn, _of_bodies(system, fed)[1])
    if fastest * duration > _LONG and fastest > _STIFF * turn:
        by = "dampers" if system.dependence is None else "dampers and feedback"
        return f"{by} let velocities decay in {1 / fastest:.3g} s: the scene is stiff"
    return None


def _of_bodies(system: System, links: Any) -> tuple[float, float]:
    """Return the fastest decay and oscillation in 1/s of single bodies, by forces on them from states."""
    heavy = (system.inertia > 0).nonzero()[0]
    damping = links.diagonal()[heavy] / system.inertia[heavy]
    stiffness = [
        links[i, state] / system.inertia[i]
        for i, state in system.position_state.items()
        if i < system.n and system.inertia[i] > 0
    ]
    return float(damping.max(initial=0.0)), max([0.0, *stiffness]) ** 0.5


def _decay_and_turn(system: System) -> tuple[float, float]:
    """Return the fastest decay and the fastest oscillation in 1/s while no contact sticks, but ties hold.

    A motion that decays before it has turned by one radian is no oscillation. Gaps are open, or all pressed on one
    side: of their fastest decays the slowest counts, and of all oscillations the fastest.
    """
    modes, functions = where_nothing_sticks(system), system.piecewise
    last = np.where(functions.is_stop, 0, np.diff([*functions.first, functions.mode.size]) - 1)
    slowest, fastest = math.inf, 0.0
    for region in range(min(int(last.max(initial=0)), _OF_ONE_SIDE) + 1):
        regions = np.minimum(last, region).astype(np.int16)
        values = np.linalg.eigvals(equations_in(modes, system, regions).jacobian())
        turns = np.abs(values.imag)
        slowest = min(slowest, -float(values.real.min(initial=0.0)))
        fastest = max(fastest, float(turns[turns > -values.real].max(initial=0.0)))
    return slowest, fastest
