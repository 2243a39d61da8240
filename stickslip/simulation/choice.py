"""Which engine a simulation takes, and why."""

from __future__ import annotations

import math

from stickslip.equations.loads import Loads
from stickslip.equations.system import System
from stickslip.model.laws.kernels import BRISTLE, LINEAR, SMOOTH
from stickslip.simulation.arguments import FIXED

__all__ = ["ENGINES", "choose", "why_no_series"]

ENGINES = {
    "series": "Taylor series",
    "BDF": "CVODE BDF",
    "Adams": "CVODE Adams",
    "IDA": "IDA BDF",
    "RK4": "RK4 with fixed steps",
    "Euler": "Euler with fixed steps",
}
"""Names of the engines as explanations write them."""

_STIFF, _LONG = 100.0, 1e4
"""A decay this many times faster than all oscillations, over this many decay times, is left to an implicit method."""

_LISTED = 5


def choose(
    system: System, loads: Loads, formulation: str, method: str, duration: float = math.inf
) -> tuple[str, str]:
    """Return the engine, a key of `ENGINES`, and the reason for it.

    Parameters
    ----------
    system : System
    loads : Loads
        Over the time span.
    formulation, method : str
        As `simulate` takes them.
    duration : float
        Length of the time span in s: a short run is no stiff one.

    Raises
    ------
    ValueError
        If formulation and method do not go together, or a series is asked for where there is none.
    """
    if formulation == "multiplier":
        if method not in ("auto", "BDF"):
            raise ValueError(
                f"simulate: IDA, which solves the multiplier formulation, is a BDF method, not {method!r}"
            )
        return "IDA", "forces as unknowns make a differential-algebraic equation"
    if method in FIXED:
        if formulation != "contact-force":
            raise ValueError(
                f"simulate: fixed steps solve the contact-force formulation, not {formulation!r}"
            )
        return method, "asked for"
    if method in ("BDF", "Adams"):
        return method, "asked for"
    reason = why_no_series(system, loads)
    if method == "series":
        if reason is not None:
            raise ValueError(f"simulate: method 'series' does not apply: {reason}; use 'auto' or 'BDF'")
        return "series", "asked for"
    if reason is not None:
        return "BDF", reason
    if (stiff := _why_stiff(system, duration)) is not None:
        return "BDF", stiff
    return "series", "loads and laws are linear between events, so that the motion has exact Taylor series"


def why_no_series(system: System, loads: Loads) -> str | None:
    """Return what in a scene has no Taylor series, None if all has one."""
    kinds = system.coefficients.kind
    named = {
        "a pre-slip velocity": (kinds == LINEAR) | (kinds == SMOOTH),
        "bristles": kinds == BRISTLE,
        "a kinetic curve": system.coefficients.curved,
    }
    for what, rows in named.items():
        names = [system.rows[j].name for j in (rows & system.alive).nonzero()[0].tolist()]
        if names:
            listed = ", ".join(map(repr, names[:_LISTED])) + (", ..." if len(names) > _LISTED else "")
            return f"the force of {listed} depends on velocity ({what})"
    if system.dependence is not None and not system.dependence.is_linear:
        return f"{system.dependence.nodes[0].label} depends on the state, of which no Taylor series is known"
    if loads.has_functions:
        return "a load is a function, of which no Taylor series is known"
    return None


def _why_stiff(system: System, duration: float) -> str | None:
    """Return that a scene is stiff, from the dampers and springs at each body."""
    heavy = (system.inertia > 0).nonzero()[0]
    damping = -system.C.diagonal()[heavy] / system.inertia[heavy]
    fastest = float(damping.max(initial=0.0))
    stiffness = [
        -system.C[i, state] / system.inertia[i]
        for i, state in system.position_state.items()
        if i < system.n and system.inertia[i] > 0
    ]
    turn = max([0.0, *stiffness]) ** 0.5
    if system.size > system.first_block:
        fastest = max(fastest, -float(system.block_C.diagonal(system.first_block).min(initial=0.0)))
    if fastest * duration > _LONG and fastest > _STIFF * turn:
        return f"dampers let velocities decay in {1 / fastest:.3g} s: the scene is stiff"
    return None
