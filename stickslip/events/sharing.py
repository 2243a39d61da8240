"""How rows that lock the same motion share what holds it: the forces of least norm within all limits (MODEL rule 8).

With forces ``lambda_0`` of least norm and the forces N that move nothing, ``lambda = lambda_0 + N z`` holds the same
motion. The shortest z for which all forces are within their limits is a problem of least distances, which Lawson and
Hanson ("Solving least squares problems", 1974, chapter 23) solve in finitely many steps. If there is no such z, the
same steps find the motion that no forces can hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from stickslip.equations.balance import self_stress
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.equations.system import System
from stickslip.events.nonnegative import nonnegative_least_squares
from stickslip.model.arrays import Array, Indices, Mask

_SOON = 1e-6  # how far ahead to look, as a part of the time in which a guard changes by its own size
_PART = 1e-9
_SELF_STRESS = 1e-9
_LARGE = 2000  # held rows of a loop that are too many to look at all changes of their forces


@dataclass(frozen=True)
class Share:
    """Rows whose limits matter."""

    rows: Indices
    side: Array  # +1 where the upper limit matters, -1 where the lower one
    # whether forces within all limits exist: then the rows carry their limit, else they move
    holds: bool


def share(motion: Motion, guards: Guards, part: Mask) -> Share | None:
    """Return how the held rows of a part share what they hold just after the start, None where nothing is shared.

    In this motion all rows of the part are held that may share, and no other rows are joined to them.
    """
    equations = motion.equations
    own = part[equations.held]
    held = equations.held[own]
    if not (equations.balance.loop[own] >= 0).any():
        return None
    scale = motion.system.largest_lever[held]
    stress = self_stress(motion.system.G[held], scale)
    limits = ((~guards.is_velocity) & (guards.direction != 0) & part[guards.row]).nonzero()[0]
    place = np.searchsorted(held, guards.row[limits])
    free = np.abs(stress[place]).max(axis=1, initial=0.0) > _SELF_STRESS
    limits, place = limits[free], place[free]
    side = guards.direction[limits]
    left = soon(motion, guards.start[:, limits])
    # side * (force added) <= left, each force in units of its row
    rows, needed = -side[:, None] * stress[place], -left * scale[place]
    size = float(np.abs(needed).max(initial=0.0)) or 1.0
    wide = np.vstack([rows.T, needed / size])
    target = np.zeros(wide.shape[0])
    target[-1] = 1.0
    weights = nonnegative_least_squares(wide, target)
    rest = wide @ weights - target
    some = weights > _PART * weights.max(initial=0.0)
    return Share(guards.row[limits[some]], side[some], bool(abs(rest[-1]) > _SELF_STRESS))


def can_relieve(system: System, held: Indices, rows: Indices, side: Array) -> bool:
    """Tell whether the `held` rows of a loop can take force from some of them, pushed to a `side`, all at once.

    Their forces may change by all that moves nothing. Of large loops this is not asked: it would take long.
    """
    if held.size > _LARGE:
        return True
    free = self_stress(system.G[held], system.largest_lever[held])
    # find the change that takes most from the row from which it takes least
    takes = np.column_stack([side[:, None] * free[np.searchsorted(held, rows)], np.ones(rows.size)])
    most = np.append(np.zeros(free.shape[1]), -1.0)
    found = scipy.optimize.linprog(most, A_ub=takes, b_ub=np.zeros(rows.size), bounds=(-1.0, 1.0))
    return bool(found.status != 0 or -found.fun > _SELF_STRESS)


def soon(motion: Motion, start: Array) -> Array:
    """Return guards just after the start of a motion, from their coefficients at the `start`."""
    size, change = np.abs(start[0]).max(initial=0.0), np.abs(start[1]).max(initial=0.0)
    ahead = motion.horizon
    if change > 0:
        ahead = min(ahead, size / change if size > 0 else ahead)
    tau = _SOON * ahead
    return np.asarray(start[0] + tau * (start[1] + tau * start[2]))
