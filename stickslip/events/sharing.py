"""How rows that lock the same motion share what holds it: the forces of least norm within all limits (MODEL rule 8).

With forces ``lambda_0`` of least norm and the forces N that move nothing, ``lambda = lambda_0 + N z`` holds the same
motion. The shortest z for which all forces are within their limits is a problem of least distances, which Lawson and
Hanson ("Solving least squares problems", 1974, chapter 23) solve in finitely many steps. If there is no such z, the
same steps find the motion that no forces can hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stickslip.equations.algebra.matrices import dense
from stickslip.equations.guards.guards import Guards
from stickslip.equations.motion import Motion
from stickslip.events.nonnegative import nonnegative_least_squares
from stickslip.model.arrays import Array, Indices, Mask

_SOON = 1e-6  # how far ahead to look, as a part of the time in which a guard changes by its own size
_PART = 1e-9
_SELF_STRESS = 1e-9


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
    self_stress = _null_space(dense(motion.system.G[held]) / scale[:, None])
    limits = ((~guards.is_velocity) & (guards.direction != 0) & part[guards.row]).nonzero()[0]
    place = np.searchsorted(held, guards.row[limits])
    free = np.abs(self_stress[place]).max(axis=1, initial=0.0) > _SELF_STRESS
    limits, place = limits[free], place[free]
    side = guards.direction[limits]
    left = soon(motion, guards.start[:, limits])
    # side * (force added) <= left, each force in units of its row
    rows, needed = -side[:, None] * self_stress[place], -left * scale[place]
    size = float(np.abs(needed).max(initial=0.0)) or 1.0
    wide = np.vstack([rows.T, needed / size])
    target = np.zeros(wide.shape[0])
    target[-1] = 1.0
    weights = nonnegative_least_squares(wide, target)
    rest = wide @ weights - target
    some = weights > _PART * weights.max(initial=0.0)
    return Share(guards.row[limits[some]], side[some], bool(abs(rest[-1]) > _SELF_STRESS))


def _null_space(rows: Array) -> Array:
    """Return orthonormal forces that move nothing, a column each."""
    values, vectors = np.linalg.eigh(rows @ rows.T)
    return np.asarray(vectors[:, values <= 1e-11 * values.max(initial=0.0)])


def soon(motion: Motion, start: Array) -> Array:
    """Return guards just after the start of a motion, from their coefficients at the `start`."""
    size, change = np.abs(start[0]).max(initial=0.0), np.abs(start[1]).max(initial=0.0)
    ahead = motion.horizon
    if change > 0:
        ahead = min(ahead, size / change if size > 0 else ahead)
    tau = _SOON * ahead
    return np.asarray(start[0] + tau * (start[1] + tau * start[2]))
