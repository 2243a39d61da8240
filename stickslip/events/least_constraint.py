"""Which rows at rest begin to move, by Gauss' principle of least constraint.

Forces ``lambda + delta`` instead of those that hold all rows accelerate them by ``w' = -W delta``, where
``W = G M^-1 G^T``. Of the forces within all limits those that follow the laws make ``1/2 delta^T W delta`` as small as
possible (Moreau, "Quadratic programming in mechanics", SIAM Journal on Control 4, 1966): bounded least squares. Where
static and Coulomb levels are equal, w' are the accelerations to come. Elsewhere the rows that begin to move carry less
than their static level, and other rows may let go after them. Where drives tear rows apart their accelerations are
added to w', but the work of the drives is left out: there it only tells where to begin.
"""

from __future__ import annotations

import numpy as np
import scipy

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.events.sharing import soon
from stickslip.model.arrays import Array, Indices, Mask

_AT_REST = 1e-9  # part of the largest relative acceleration below which a row stays at rest
_ROUNDOFF = 1e-14  # part of its terms below which a relative acceleration is roundoff
_TOLERANCE = 1e-14  # of the least squares


def least_constraint(motion: Motion, guards: Guards, part: Mask) -> tuple[Indices, Array]:
    """Return the held rows of a part that have limits, and their relative accelerations; 0 where they stay at rest.

    In this motion all rows of the part are held that may be held, and no other rows are joined to them.
    """
    system, equations = motion.system, motion.equations
    limits = ((~guards.is_velocity) & (guards.direction != 0) & part[guards.row]).nonzero()[0]
    rows, place = np.unique(guards.row[limits], return_inverse=True)
    left, up = soon(motion, guards.start[:, limits]), guards.direction[limits] > 0
    low, high = np.full(rows.size, -np.inf), np.full(rows.size, np.inf)
    low[place[~up]], high[place[up]] = -left[~up], left[up]
    rest = equations.is_held.copy()
    rest[rows] = False
    per_force = np.asarray(system.balance(rest).accelerations(dense(system.GT[:, rows])))
    root = np.sqrt(system.inertia)[:, None] * per_force  # W = root^T root
    # the tolerance is one of numbers near 1
    force, size = float(np.abs(left).max(initial=0.0)) or 1.0, float(np.abs(root).max(initial=0.0)) or 1.0
    low, high = low / force, high / force
    bounds = low, np.maximum(high, np.nextafter(low, np.inf))
    none = np.zeros(root.shape[0])
    delta = force * scipy.optimize.lsq_linear(root / size, none, bounds, method="bvls", tol=_TOLERANCE).x
    accelerations = -root.T @ (root @ delta)
    roundoff = _ROUNDOFF * (np.abs(root.T) @ (np.abs(root) @ np.abs(delta)))
    if equations.balance.parting is not None:
        # what drives tear apart moves even in the motion that holds all rows
        rate = system.drive_accelerations(motion.start.q[0])
        accelerations += system.relative(equations.balance.U @ rate, rate)[rows]
    moves = np.abs(accelerations) > np.maximum(roundoff, _AT_REST * np.abs(accelerations).max(initial=0.0))
    return rows, np.where(moves, accelerations, 0.0)
